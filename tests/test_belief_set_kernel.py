"""The kernels of belief sets against their definitions: the NumPy hulls, the polytopes and the plain judge of trials."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from inscrutable import tolerances
from inscrutable.decision_makers import CounterAdversarialDecisionMaker, LocalSearch
from inscrutable.decision_makers.search.trials import DefinedJudge, QuadraticJudge, judge_for
from inscrutable.geometry import BeliefSet
from inscrutable.geometry.hulls import affine_hulls, described_sets, kernel_limits, sum_zero_basis
from inscrutable.kernels.belief_members import distance_in_hull
from inscrutable.kernels.belief_sets import hull_of, room_for
from inscrutable.privacy import DesiredObfuscation, Infeasibility, MaximalObfuscation
from inscrutable.problems import MarkowitzProblem, Polyhedron, QuadraticProblem, box, simplex
from oracles.segments import clip_to_segments

SEEDS = st.integers(0, 2**32 - 1)
LIMITS = kernel_limits(tolerances.EXPLAINED)


def defined_sets(equalities, inequalities):
    """Dimension, both ends and residual of stacked systems as the NumPy functions define them."""
    hulls = affine_hulls(equalities, tolerances.EXPLAINED)
    dimension = hulls.dimension.copy()
    ends = np.zeros((len(equalities), 2, equalities.shape[2]))
    for size in (0, 1):
        which = np.flatnonzero(hulls.dimension == size)
        if which.size:
            cut = clip_to_segments(hulls, inequalities, which)
            longer = np.linalg.norm(cut.end - cut.start, axis=1) > tolerances.SAME_BELIEF
            dimension[which] = np.where(cut.present, longer.astype(int), -1)
            ends[which] = np.stack([cut.start, cut.end], axis=1) * cut.present[:, None, None]
    return dimension, ends, hulls.residual


def assert_as_defined(equalities, inequalities, accuracy=1e-9):
    dimension, ends = described_sets(equalities, inequalities, tolerances.EXPLAINED)
    expected, corners, _ = defined_sets(equalities, inequalities)
    np.testing.assert_array_equal(dimension, expected)
    for i in np.flatnonzero((dimension == 0) | (dimension == 1)):
        # A direction has two signs.
        apart = min(np.abs(ends[i] - corners[i]).max(), np.abs(ends[i, ::-1] - corners[i]).max())
        assert apart <= accuracy, (equalities[i], inequalities[i])
    return dimension


def systems(rng, n, k, m, n_states, rank, noise=0.0):
    """Equalities of a given rank that an interior or a face belief solves, up to noise, and inequalities it meets."""
    belief = rng.dirichlet(np.ones(n_states), size=n)
    if n_states > 1 and rng.random() < 0.5:
        belief[:, rng.integers(n_states)] = 0.0
        belief /= belief.sum(axis=1, keepdims=True)
    factors = rng.normal(size=(n, k, rank))
    rows = rng.normal(size=(n, rank, n_states))
    rows -= (rows @ belief[:, :, None]) / (belief**2).sum(axis=1)[:, None, None] * belief[:, None]
    equalities = factors @ rows + noise * rng.normal(size=(n, k, n_states))
    inequalities = rng.normal(size=(n, m, n_states))
    inequalities *= np.sign(inequalities @ belief[:, :, None]) * rng.choice([1.0, 1.0, 1.0, -1.0], size=(n, 1, 1))
    largest = np.abs(equalities).max(axis=(1, 2), initial=0.0)[:, None, None]
    return equalities / np.where(largest > 0, largest, 1.0), inequalities


@settings(max_examples=80, deadline=None)
@given(SEEDS, st.integers(1, 6), st.integers(0, 7), st.integers(0, 4), st.sampled_from([0.0, 1e-13, 1e-3]))
def test_points_segments_and_nothing_are_as_defined(seed, n_states, k, m, noise):
    rng = np.random.default_rng(seed)
    rank = int(rng.integers(0, min(k, n_states) + 1))
    assert_as_defined(*systems(rng, 5, k, m, n_states, rank, noise))


@pytest.mark.parametrize("n_states", [2, 3, 5])
@pytest.mark.parametrize("size", [1e-6, 1e-8, 1e-9, 1e-11, 1e-13])
def test_near_singular_equations_are_as_defined(n_states, size):
    """A singular value far below the others, above and below what determines a coordinate, and bands of every width."""
    rng = np.random.default_rng(n_states)
    for _ in range(20):
        equalities, inequalities = systems(rng, 3, n_states - 1, 2, n_states, n_states - 1)
        left, singular, right = np.linalg.svd(equalities @ sum_zero_basis(n_states))
        singular[:, -1] = size
        rounded = left[:, :, : singular.shape[1]] @ (singular[:, :, None] * right) @ sum_zero_basis(n_states).T
        # A coordinate, or the end of a band, is known to rounding over the singular value.
        accuracy = max(1e-9, 1e-14 / size) if 2 * size > tolerances.EXPLAINED else 1e-9
        assert_as_defined(rounded, inequalities, accuracy)
        # A residual that a step within the simplex removes, and one that no step can.
        assert_as_defined(rounded + 0.5 * size * left[:, :, n_states - 2, None], inequalities, accuracy)
        assert_as_defined(rounded + equalities.sum(axis=2, keepdims=True) / n_states, inequalities, accuracy)


def test_a_row_is_met_up_to_what_the_residual_leaves_open():
    """π_1 = π_2 known to 1e-6 of the gradient's scale: a belief may be off by 7e-5."""
    equalities = np.array([[[1e-6, -1e-6]]])
    for gap, dimension in ((1e-5, 0), (1e-3, -1)):
        assert assert_as_defined(equalities, np.array([[[1.0, -1.0 - gap]]])) == dimension


def test_ties_faces_and_corners_by_hand():
    """Rows in whole numbers, so that both sides meet the tie exactly."""
    cases = [
        ([[1, -1, 0]], [[0, 0, 1]], 1),  # a segment that ends on a face
        ([[1, -1, 0], [1, -1, 0]], [[1, -1, 0]], 1),  # a row twice, an inequality tight all along
        ([[1, -1, 0]], [[-1, 0, 0]], 0),  # only the end (0, 0, 1) is left
        ([[1, -1, 0]], [[-1, -1, -1]], -1),
        ([[1, 0, 0], [0, 1, 0]], [[1, 1, 0]], 0),  # a corner of the simplex
        ([[1, 1, 1]], [[1, 0, 0]], -1),  # no belief at all
        ([[0, 0, 0]], [[1, 0, 0]], 2),
        ([[1, 1, 0]], [[1, 0, 0]], 0),  # the equality holds only at a corner
        ([[2, -1, -1]], [[0, 1, -1], [0, -1, 1]], 0),  # a segment cut to its middle from both sides
        ([[1, 1, -1e-12]], [[1, 0, 0]], 0),
    ]
    for equalities, inequalities, dimension in cases:
        rows = (np.array([equalities], dtype=float), np.array([inequalities], dtype=float))
        assert assert_as_defined(*rows)[0] == dimension, equalities
    nothing = np.zeros((2, 0, 1))
    assert assert_as_defined(nothing, nothing).tolist() == [0, 0]


def test_rows_within_and_beyond_the_tolerance():
    """Touching inequalities, by amounts on either side of the face tolerance."""
    equalities = np.array([[[1.0, -1.0, 0.0]]])
    found = []
    for gap in (0.0, 1e-10, 5e-10, 1e-8, 1e-6):
        inequalities = np.array([[[-0.5 - gap, -0.5 - gap, 0.5], [0.5, 0.5, -0.5 - gap]]])
        found.append(int(assert_as_defined(equalities, inequalities)[0]))
    assert found[0] == 0
    assert found[-1] == -1


@njit
def dimension_and_distance(equalities, inequalities, basis, limits, point):
    """Dimension of the hull, and the distance from a point to the set where that is two or more."""
    k, m, n_states = equalities.shape[0], inequalities.shape[0], basis.shape[0]
    hull = room_for(k, n_states)
    dimension, _, _ = hull_of(equalities, k, basis, limits, hull)
    if dimension < 2:
        return dimension, np.nan
    return dimension, distance_in_hull(equalities, inequalities, (k, m), dimension, limits, hull, point)


@settings(max_examples=100, deadline=None)
@given(SEEDS, st.integers(3, 6), st.integers(0, 5), st.integers(2, 4))
def test_distances_are_those_of_the_belief_set(seed, n_states, m, size):
    rng = np.random.default_rng(seed)
    rank = max(n_states - 1 - size, 0)
    equalities, inequalities = (each[0] for each in systems(rng, 1, n_states, m, n_states, rank))
    expected = BeliefSet(equalities, inequalities)
    for target in [*rng.dirichlet(np.ones(n_states), 5), np.eye(n_states)[0]]:
        rows = (equalities, inequalities, sum_zero_basis(n_states), LIMITS)
        dimension, distance = dimension_and_distance(*rows, target)
        assert dimension in (-1, n_states - 1 - rank)
        if dimension >= 2:
            assert distance == pytest.approx(expected.distance(target), abs=1e-9)


def test_distances_from_polygons_by_hand():
    def distance(rows, target):
        held = (np.zeros((0, 3)), np.array(rows, dtype=float).reshape(-1, 3))
        return dimension_and_distance(*held, sum_zero_basis(3), LIMITS, np.array(target, dtype=float))[1]

    assert distance([], [0.2, 0.3, 0.5]) == 0.0
    assert distance([[2, -1, -1]], [0, 0.5, 0.5]) == pytest.approx(np.sqrt(1.5) / 3, abs=1e-15)
    assert distance([[2, -1, -1]], [1, 0, 0]) == 0.0
    assert distance([[-1, -1, -1]], [1, 0, 0]) == np.inf
    # 0 <= π_1 − π_2 <= π_3/10 has the corners (1, 1, 0)/2, (0, 0, 1) and (1, 0, 10)/11; the foot is on the edge of the
    # first and the last.
    assert distance([[1, -1, 0], [-1, 1, 0.1]], [1, 0, 0]) == pytest.approx(np.sqrt(1 / 2 - 1 / 602), abs=1e-12)
    assert distance([[1, -1, 0], [-1, 1, 0]], [1, 0, 0]) == pytest.approx(np.sqrt(0.5), abs=1e-12)  # no width


# --- trials of a local search ---------------------------------------------------------------------------------------


def market(rng, n_states, size, kind):
    factors = rng.normal(size=(n_states, size, size + 2))
    covariances = factors @ factors.transpose(0, 2, 1) / size
    means = rng.normal(size=(n_states, size))
    if kind == "copies" and size > 1:
        means[:, -1] = means[:, 0]
        covariances[:, -1] = covariances[:, 0]
        covariances[:, :, -1] = covariances[:, :, 0]
    if kind == "near singular":
        covariances = covariances[:, :1, :1] * np.ones((size, size)) + 1e-9 * covariances
    if kind == "same regimes":
        means[-1], covariances[-1] = means[0], covariances[0]
    region = simplex(size)
    if kind == "sectors":
        first = (np.arange(size) < size // 2 + 1).astype(float)
        region = region & Polyhedron([first, -first], [0.8, -0.1]) & box(np.zeros(size), np.full(size, 0.9))
    if kind == "no equality":
        region = box(np.full(size, -0.5), np.ones(size))
    return QuadraticProblem(covariances, means, rng.normal(size=n_states), constraints=region)


KINDS = ["plain", "copies", "near singular", "same regimes", "sectors", "no equality"]


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=25, deadline=None)
@given(SEEDS, st.integers(1, 4), st.integers(1, 5))
def test_trials_are_judged_as_defined(kind, seed, n_states, size):
    rng = np.random.default_rng(seed)
    problem = market(rng, n_states, max(size, 3) if kind == "sectors" else size, kind)
    size = problem.n_actions
    belief = rng.dirichlet(np.ones(n_states))
    if n_states > 1:
        belief[0] = 0.0  # a regime of probability zero
        belief /= belief.sum()
    decoys = np.vstack([rng.dirichlet(np.ones(n_states), 6), np.eye(n_states)])
    optimal = problem.solve(decoys)
    trials = np.vstack([optimal, np.eye(size), rng.dirichlet(np.ones(size), 4), optimal + 1e-8 * rng.normal(size=size)])
    trials = np.vstack([trials, 2.0 * optimal[:1] - 1.0])
    target = rng.dirichlet(np.ones(n_states))
    for measure in (MaximalObfuscation(), DesiredObfuscation(target)):
        judge = judge_for(problem, belief, measure)
        assert isinstance(judge, QuadraticJudge)
        found, expected = judge(trials), DefinedJudge(problem, belief, measure)(trials)
        np.testing.assert_array_equal(found.admissible, expected.admissible)
        np.testing.assert_array_equal(np.isneginf(found.privacies), np.isneginf(expected.privacies))
        finite = np.isfinite(expected.privacies)
        np.testing.assert_allclose(found.privacies[finite], expected.privacies[finite], atol=1e-8)
        np.testing.assert_allclose(found.costs, expected.costs, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.slopes, expected.slopes, rtol=1e-12, atol=1e-12)


def test_what_is_not_a_number_is_unexplained_and_inadmissible():
    problem = market(np.random.default_rng(0), 2, 3, "plain")
    found = judge_for(problem, np.array([0.3, 0.7]), MaximalObfuscation())(
        np.array([[np.nan, 0.5, 0.5], [np.inf, 0.0, 0.0]])
    )
    assert not found.admissible.any()
    assert np.isneginf(found.privacies).all()


def test_other_problems_and_measures_use_the_definition():
    problem = market(np.random.default_rng(0), 2, 3, "plain")
    belief = np.array([0.3, 0.7])
    assert isinstance(judge_for(problem, belief, Infeasibility()), DefinedJudge)

    class Dearer(QuadraticProblem):
        def state_costs(self, actions):
            return 2.0 * super().state_costs(actions)

    dearer = Dearer(problem.hessians, problem.linear, constraints=problem.constraints)
    assert isinstance(judge_for(dearer, belief, MaximalObfuscation()), DefinedJudge)


@pytest.mark.parametrize("seed", range(3))
def test_the_local_solver_reaches_the_same_privacy_either_way(seed, monkeypatch):
    """Paths may part by rounding; the better of some starts is the same to the solver's accuracy or a little apart."""
    rng = np.random.default_rng(seed)
    factors = rng.normal(size=(3, 3, 6))
    problem = MarkowitzProblem(0.1 * rng.normal(size=(3, 3)), 0.1 * factors @ factors.transpose(0, 2, 1), 5.0)
    belief = rng.dirichlet(np.ones(3))

    def privacy():
        method = LocalSearch(6, np.random.default_rng(seed))
        return CounterAdversarialDecisionMaker(problem, budget=0.1, method=method).decide(belief).privacy

    fast = privacy()
    monkeypatch.setattr("inscrutable.decision_makers.local_search.judge_for", DefinedJudge)
    assert fast == pytest.approx(privacy(), abs=2e-2)
