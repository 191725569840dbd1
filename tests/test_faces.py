"""Faces of bounds and few general rows against the general decompositions, and against the definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import null_space

from inscrutable import Polyhedron, QuadraticProblem, box, simplex
from inscrutable.decision_makers.search.partition import face_programme
from inscrutable.geometry.cones import decomposed_rows, stationarity_rows
from inscrutable.geometry.held_coordinates import held_coordinates
from sizes import instances
from strategies import SEEDS


def bounds(rng, size, count):
    """Bounds on `count` different coordinates, from either side and of any length."""
    rows = np.zeros((count, size))
    rows[np.arange(count), rng.permutation(size)[:count]] = rng.choice([-1.0, 1.0], count) * rng.exponential(size=count)
    return rows


def quadratic(rng, n_states, region):
    factors = rng.normal(size=(n_states, region.n_actions, region.n_actions))
    linear, constants = rng.normal(size=(n_states, region.n_actions)), rng.normal(size=n_states)
    return QuadraticProblem(factors @ factors.transpose(0, 2, 1), linear, constants, constraints=region)


@pytest.mark.parametrize(
    ("region", "rows"),
    [
        (simplex(4) & box(np.zeros(4), np.array([2e-4, 1.0, 1.0, 1.0])), [0, 4]),  # both bounds of one weight
        (simplex(3), [0, 1, 2]),  # nothing is held
        (simplex(4) & Polyhedron([[1.0, 1.0, 0.0, 0.0], [-1.0, -1.0, 0.0, 0.0]], [0.6, -0.5]), [4, 5]),
    ],
)
def test_a_face_whose_rows_contradict_each_other_has_no_decision(region, rows):
    """Decisions halfway between opposite bounds were searched as if they were on both."""
    problem = quadratic(np.random.default_rng(0), 3, region)
    tight = np.zeros(len(region.b_ub), dtype=bool)
    tight[rows] = True
    face = face_programme(problem, tight)
    assert (face.rows @ np.append(np.zeros(face.span.shape[1]), 1.0) < 0.0).all()
    assert (face_programme(problem, np.zeros_like(tight)).rows[:3, :, -1] == np.eye(3)).all()


# --- stationarity rows --------------------------------------------------------------------------------------------------


@settings(max_examples=instances(200), deadline=None)
@given(SEEDS, st.integers(1, 12), st.integers(0, 12), st.integers(0, 2), st.integers(0, 3), st.booleans())
def test_rows_are_those_of_the_decomposition(seed, size, n_bounds, n_general, n_equal, repeated):
    """Independent rows: P and Q agree entry by entry, in the order of the active rows, repeats merged."""
    rng = np.random.default_rng(seed)
    n_bounds = min(n_bounds, size)
    n_general = min(n_general, size - n_bounds)
    equalities = rng.normal(size=(min(n_equal, size - n_bounds - n_general), size))
    active = rng.permutation(np.vstack([bounds(rng, size, n_bounds), rng.normal(size=(n_general, size))]))
    if repeated and n_bounds:
        single = active[(active != 0).sum(axis=1) == 1]
        active = np.vstack([active, 2.0 * single[:1], single[-1:] / 3.0])
    found, expected = stationarity_rows(active, equalities), decomposed_rows(active, equalities)
    assert found.equalities.shape == expected.equalities.shape
    face = held_coordinates(active, equalities)
    size_of_inverse = 1.0 if face is None else np.abs(face.reflections.inverse).max(initial=1.0)
    np.testing.assert_allclose(found.equalities, expected.equalities, atol=1e-12 * size_of_inverse)
    np.testing.assert_allclose(found.inequalities, expected.inequalities, atol=1e-12 * size_of_inverse**2)


@pytest.mark.parametrize(("size", "kept"), [(1, 1), (2, 1), (5, 2), (30, 29), (30, 30)])
def test_a_simplex_takes_the_short_way(size, kept):
    region = simplex(size)
    assert held_coordinates(region.A_ub[kept:], region.A_eq) is not None


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(2, 7), st.integers(1, 2))
def test_a_coordinate_fixed_from_both_sides_has_no_sign(seed, size, n_fixed):
    """The cone is that of the decomposition, which enumerates facets; a fixed coordinate's gradient is free."""
    rng = np.random.default_rng(seed)
    one_sided = -np.eye(size)[: rng.integers(1, size)]
    active = rng.permutation(np.vstack([one_sided, 0.5 * np.eye(size)[:n_fixed], -np.eye(size)[:n_fixed]]))
    equalities = np.ones((1, size))
    found, expected = stationarity_rows(active, equalities), decomposed_rows(active, equalities)
    np.testing.assert_allclose(found.equalities, expected.equalities, atol=1e-12)
    for _ in range(20):
        pushes = rng.normal(size=len(active)) + rng.choice([0.0, 2.0])
        gradient = -active.T @ pushes - equalities[0] * rng.normal()
        inside = [(rows.inequalities @ gradient).min(initial=0.0) > -1e-9 for rows in (found, expected)]
        assert inside[0] == inside[1]


@pytest.mark.parametrize("tilt", [0.0, 1e-12, 1e-9, 1e-6])
def test_doubtful_rows_are_decomposed(tilt):
    """Rows that nearly repeat each other on the free coordinates, and one that nearly vanishes there."""
    equalities = np.array([[1.0, 1.0, 1.0, 1.0], [1.0, 1.0, 1.0 + tilt, 0.0]])
    active = -np.eye(4)[3:]
    assert held_coordinates(active, equalities) is None
    assert held_coordinates(-np.eye(4)[:2], np.array([[1.0, 1.0, tilt, -tilt]])) is None
    found, expected = stationarity_rows(active, equalities), decomposed_rows(active, equalities)
    np.testing.assert_array_equal(found.equalities, expected.equalities)
    np.testing.assert_array_equal(found.inequalities, expected.inequalities)


def test_no_rows_leave_every_gradient():
    rows = stationarity_rows(np.zeros((0, 3)), np.zeros((0, 3)))
    np.testing.assert_array_equal(rows.equalities, np.eye(3))
    assert rows.inequalities.shape == (0, 3)


# --- face programmes ----------------------------------------------------------------------------------------------------


def regions(rng, size):
    """The simplex, a box with two equalities, one with a fixed coordinate, and one with general rows."""
    lower, upper = -rng.uniform(0.1, 1.0, size), rng.uniform(0.1, 1.0, size)
    middle = 0.5 * (lower + upper)
    general = rng.normal(size=(3, size))
    equal = np.vstack([np.ones(size), np.arange(size)])
    fixed_lower, fixed_upper = lower.copy(), upper.copy()
    fixed_lower[0] = fixed_upper[0] = 0.25
    return [
        simplex(size),
        box(lower, upper) & Polyhedron(A_eq=equal, b_eq=equal @ middle),
        box(fixed_lower, fixed_upper),
        box(lower, upper) & Polyhedron(general, general @ middle + 1.0, equal[:1], equal[:1] @ middle),
        Polyhedron(general, general @ middle + 1.0),
        simplex(size) & box(np.zeros(size), np.full(size, 0.8)),
    ]


@settings(max_examples=instances(100), deadline=None)
@given(SEEDS, st.integers(3, 9), st.integers(1, 4), st.integers(0, 5))
def test_a_face_programme_says_what_the_problem_says(seed, size, n_states, kind):
    """Costs, gradients, multipliers and slacks at any point of the face are those of the problem."""
    rng = np.random.default_rng(seed)
    region = regions(rng, size)[kind]
    problem = quadratic(rng, n_states, region)
    tight = region.tight_rows(problem.solve(rng.dirichlet(np.ones(n_states))))
    if rng.uniform() < 0.5 and not tight.all():
        tight[rng.choice(np.flatnonzero(~tight))] = True
    normals = np.vstack([region.A_ub[tight], region.A_eq])
    sides = np.concatenate([region.b_ub[tight], region.b_eq])
    if _conflict(normals, sides):
        return
    face = face_programme(problem, tight)
    k = face.span.shape[1]
    assert k == (null_space(normals).shape[1] if len(normals) else size)
    np.testing.assert_allclose(face.span.T @ face.span, np.eye(k), atol=1e-12)
    place = rng.normal(size=k)
    action = face.origin + face.span @ place
    np.testing.assert_allclose(normals @ action, sides, atol=1e-9)
    np.testing.assert_allclose(face.origin @ face.span, 0.0, atol=1e-9)
    w = np.append(place, 1.0)
    np.testing.assert_allclose(0.5 * face.curves @ w @ w, problem.state_costs(action), rtol=1e-8, atol=1e-8)
    gradients = problem.cost_gradients(action)
    np.testing.assert_allclose((face.curves @ w)[:, :k], gradients @ face.span, rtol=1e-8, atol=1e-8)
    n_multipliers = face.n_set_rows - n_states
    np.testing.assert_array_equal(face.rows[:n_states] @ w, np.eye(n_states))
    multipliers = gradients @ stationarity_rows(region.A_ub[tight], region.A_eq).inequalities.T
    assert multipliers.shape[1] == n_multipliers
    np.testing.assert_allclose(face.rows[n_states : face.n_set_rows] @ w * face.scale, multipliers.T, atol=1e-7)
    least = region.min_slack * (1 + 1e-5)
    slacks = np.broadcast_to((region.slacks(action)[~tight] - least)[:, None], (int((~tight).sum()), n_states))
    np.testing.assert_allclose(face.rows[face.n_set_rows :] @ w, slacks, atol=1e-9)


def _conflict(normals, sides):
    """Whether no decision has all rows tight, or the rows are close to dependent."""
    if not len(normals):
        return False
    singular = np.linalg.svd(normals, compute_uv=False)
    point = np.linalg.lstsq(normals, sides, rcond=None)[0]
    doubtful = np.any((singular > 1e-9) & (singular < 1e-2))
    return bool(doubtful or np.abs(normals @ point - sides).max() > 1e-9)


@settings(max_examples=50, deadline=None)
@given(SEEDS, st.integers(2, 30), st.integers(1, 4))
def test_held_coordinates_sit_on_their_bounds(seed, size, n_states):
    rng = np.random.default_rng(seed)
    lower, upper = rng.uniform(-0.3, 0.0, size), rng.uniform(0.1, 0.4, size)
    problem = quadratic(rng, n_states, box(lower, upper) & Polyhedron(A_eq=np.ones((1, size)), b_eq=[0.0]))
    best = problem.solve(np.full(n_states, 1.0 / n_states))
    slacks = problem.constraints.slacks(best)
    near = (slacks > 1e-12) & (slacks < problem.constraints.observed_slack)  # these count as on their bounds
    assume(not near.any())
    face = face_programme(problem, problem.constraints.tight_rows(best))
    action = face.action(face.span.T @ (best - face.origin))
    at_bound = (best == lower) | (best == upper)
    np.testing.assert_array_equal(action[at_bound], best[at_bound])
    np.testing.assert_allclose(action, best, atol=1e-11)


def test_an_action_beside_a_bound_is_put_on_it():
    """Rounding beside any bound is removed, also that of a coordinate the face leaves free."""
    problem = quadratic(np.random.default_rng(0), 2, simplex(3))
    face = face_programme(problem, np.zeros(3, dtype=bool))
    for bound in ([0.0, 0.4, 0.6], [0.5, 0.5, 0.0]):
        place = face.span.T @ (np.add(bound, [3e-13, -6e-13, 3e-13]) - face.origin)
        action = face.action(place)
        assert np.count_nonzero(action == 0.0) == 1
        np.testing.assert_allclose(action, bound, atol=1e-12)


def test_coordinate_bounds_are_the_tightest_of_the_single_rows():
    region = Polyhedron([[-2.0, 0], [-1, 0], [0, 4], [0, 1], [1, 1]], [0.0, -0.5, 2.0, 3.0, 9.0])
    lower, upper = region.coordinate_bounds
    np.testing.assert_array_equal(lower, [0.5, -np.inf])
    np.testing.assert_array_equal(upper, [np.inf, 0.5])
    assert not np.signbit(simplex(2).coordinate_bounds[0]).any()
