"""Sets of beliefs against hulls from Jacobi rotations, cut row by row."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from inscrutable import tolerances
from inscrutable.geometry.hulls import described_sets, sum_zero_basis
from oracles.hulls import affine_hulls
from oracles.segments import clip_to_segments
from sizes import instances

SEEDS = st.integers(0, 2**32 - 1)


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
    for _ in range(instances(20)):
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


def best_slack(equalities, inequalities):
    """The largest least slack of any belief that solves the equations, by HiGHS."""
    n_states = equalities.shape[1]
    rows = np.vstack([inequalities, np.eye(n_states)])
    found = linprog(
        np.append(np.zeros(n_states), -1.0),
        A_ub=np.hstack([-rows, np.ones((len(rows), 1))]),
        b_ub=np.zeros(len(rows)),
        A_eq=np.hstack([np.vstack([equalities, np.ones(n_states)]), np.zeros((len(equalities) + 1, 1))]),
        b_eq=np.append(np.zeros(len(equalities)), 1.0),
        bounds=(None, None),
    )
    return -found.fun if found.status == 0 else -np.inf


@pytest.mark.parametrize("slope", [0.0, 1e-10, 3e-9, 1e-8, 1e-6])
def test_a_row_that_is_almost_flat_on_a_line_hides_no_contradiction(slope, fresh_rng):
    """Such rows come of decisions at a former weight: a line on which the others contradict each other counted as a belief."""
    verdicts = set()
    for _ in range(80):
        n_states = int(fresh_rng.integers(3, 6))
        equalities, inequalities = systems(fresh_rng, 1, n_states, 4, n_states, n_states - 2)
        flat = np.full((1, 1, n_states), fresh_rng.uniform(0.01, 0.5)) + slope * fresh_rng.normal(size=(1, 1, n_states))
        rows = np.concatenate([inequalities, flat], axis=1)
        slack = best_slack(equalities[0], rows[0])
        if abs(slack) > 1e-7:
            dimension = described_sets(equalities, rows, tolerances.EXPLAINED)[0][0]
            assert (dimension >= 0) == (slack > 0.0)
            verdicts.add(slack > 0.0)
    assert verdicts == {True, False}
