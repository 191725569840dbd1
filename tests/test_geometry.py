"""Simplex grids and belief sets built from rows: points, segments, polygons, and what shrinks to them."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from inscrutable import BeliefSet, FiniteProblem, InputError, consistent_beliefs, simplex_grid
from inscrutable.geometry.cones import stationarity_rows
from oracles import consistent
from sizes import instances
from strategies import SEEDS

# --- grids --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n", "resolution"), [(1, 1), (1, 7), (2, 1), (2, 10), (3, 40), (4, 9), (6, 4)])
def test_a_grid_has_all_multiples_once(n, resolution):
    grid = simplex_grid(n, resolution)
    assert grid.shape == (comb(resolution + n - 1, n - 1), n)
    np.testing.assert_allclose(grid.sum(axis=1), 1, atol=1e-15)
    whole = grid * resolution
    np.testing.assert_allclose(whole, whole.round(), atol=1e-12)
    assert len({tuple(row) for row in whole.round().astype(int).tolist()}) == len(grid)
    for corner in np.eye(n):
        assert (grid == corner).all(axis=1).sum() == 1
    np.testing.assert_array_equal(grid, grid[np.lexsort(grid.T[::-1])])


@pytest.mark.parametrize("arguments", [(0, 3), (3, 0), (2.0, 3), (3, True), (3, -1), ("3", 3)])
def test_a_grid_needs_whole_numbers(arguments):
    with pytest.raises(InputError, match="whole number"):
        simplex_grid(*arguments)


@pytest.mark.parametrize(("n", "resolution", "finest"), [(10, 60, 18), (3, 10**6, 6687), (1000, 2, 1)])
def test_a_grid_that_would_fill_the_memory_is_refused_before_it_does(n, resolution, finest):
    with pytest.raises(InputError, match=f"{comb(resolution + n - 1, n - 1):,} points.* at most {finest}$"):
        simplex_grid(n, resolution)
    assert comb(finest + n - 1, n - 1) * n <= 2**26 < comb(finest + n, n - 1) * n


# --- belief sets by hand ------------------------------------------------------------------------------------------------


def nothing(n):
    return np.zeros((0, n))


def test_no_rows_is_the_whole_simplex():
    whole = BeliefSet(nothing(4), nothing(4))
    assert whole.dimension == 3
    assert not whole.is_empty
    np.testing.assert_allclose(np.sort(whole.vertices(), axis=0), np.sort(np.eye(4), axis=0), atol=1e-9)
    np.testing.assert_allclose(whole.bounds(), np.tile([0, 1], (4, 1)), atol=1e-9)
    assert whole.distance([0.1, 0.2, 0.3, 0.4]) == 0
    assert BeliefSet(nothing(1), nothing(1)).vertices().tolist() == [[1.0]]


@pytest.mark.parametrize(
    ("equalities", "inequalities", "dimension", "corners"),
    [
        ([[1, -1, 0], [0, 1, -1]], [], 0, [[1 / 3, 1 / 3, 1 / 3]]),
        ([[1, -1, 0]], [], 1, [[0, 0, 1], [0.5, 0.5, 0]]),
        ([[0, 0, 1]], [], 1, [[1, 0, 0], [0, 1, 0]]),  # an edge of the simplex
        ([[0, 1, 1]], [], 0, [[1, 0, 0]]),  # a corner, reached through an equality
        ([], [[1, -1, 0]], 2, [[1, 0, 0], [0.5, 0.5, 0], [0, 0, 1]]),
        ([], [[1, -1, 0], [-1, 1, 0]], 1, [[0, 0, 1], [0.5, 0.5, 0]]),  # two inequalities make an equality
        ([], [[1, -1, -1], [-1, 0.5, 0.5]], -1, []),
        ([], [[0, -1, -1]], 0, [[1, 0, 0]]),  # an inequality met at a corner only
        ([], [[0, 0, -1]], 1, [[1, 0, 0], [0, 1, 0]]),  # … on an edge only
        ([[1, -1, 0]], [[0, 0, -1]], 0, [[0.5, 0.5, 0]]),
        ([[1, -1, 0]], [[-1, 0, 0.1]], 1, [[0, 0, 1], [1 / 12, 1 / 12, 10 / 12]]),
        ([[1, 1, 1]], [], -1, []),  # Σπ = 0 is impossible
        ([[1, 1, -1], [2, 2, -2]], [], 1, [[0.5, 0, 0.5], [0, 0.5, 0.5]]),  # twice the same row
        ([[0, 0, 0]], [[0, 0, 0]], 2, np.eye(3)),  # rows that say nothing
        ([], [[-1, -1, -1]], -1, []),
    ],
)
def test_sets_by_hand(equalities, inequalities, dimension, corners):
    rows = [np.array(block, dtype=float).reshape(-1, 3) for block in (equalities, inequalities)]
    found = BeliefSet(*rows)
    assert found.dimension == dimension
    assert found.is_empty == (dimension < 0)
    corners = np.array(corners, dtype=float).reshape(-1, 3)
    vertices = found.vertices()
    assert vertices.shape == corners.shape
    if len(corners):
        apart = np.abs(vertices[:, None] - corners[None]).max(axis=2)
        assert apart.min(axis=0).max() < 1e-8
        assert apart.min(axis=1).max() < 1e-8
        np.testing.assert_allclose(found.center(), corners.mean(axis=0), atol=1e-8)
        for target in ([1, 0, 0], [0.2, 0.3, 0.5], [0, 0.5, 0.5]):
            expected = consistent.hull_distance(np.array(target, dtype=float), corners)
            assert found.distance(target) == pytest.approx(expected, abs=1e-8)
    else:
        assert found.distance([1, 0, 0]) == np.inf


@pytest.mark.parametrize("n", [2, 3, 4])
def test_a_direction_that_hardly_matters_is_free_within_the_tolerance(n):
    """|1e-8 (π_1 − ½)| <= 1e-10 is |π_1 − ½| <= .01, whatever the rank is taken to be."""
    row = np.full(n, -0.5e-8)
    row[0] += 1e-8
    found = BeliefSet(row[None], nothing(n), 1e-10)
    assert found.dimension == n - 1
    np.testing.assert_allclose(found.bounds()[0], [0.49, 0.51], atol=1e-6)
    assert found.contains(np.append([0.509], np.full(n - 1, 0.491 / (n - 1))))
    assert not found.contains(np.append([0.511], np.full(n - 1, 0.489 / (n - 1))))
    assert found.distance(np.eye(n)[0]) == pytest.approx(0.49 * np.sqrt(n / (n - 1)), abs=1e-5)


def test_empty_sets_answer_every_query():
    nobody = BeliefSet(np.ones((1, 2)), nothing(2))
    assert nobody.is_empty
    assert nobody.dimension == -1
    assert np.isnan(nobody.nearest([0.5, 0.5])).all()
    assert np.isnan(nobody.bounds()).all()
    assert nobody.bounds().shape == (2, 2)
    assert np.isnan(nobody.center()).all()
    assert not nobody.contains([0.5, 0.5])
    assert nobody.residual == pytest.approx(1.0)
    assert np.isnan(nobody.plausibility_gap)  # it was given no way to ask
    assert BeliefSet(np.ones((1, 2)), nothing(2), gap=lambda enough: 0.25).plausibility_gap == 0.25
    with pytest.raises(InputError, match="empty"):
        nobody.sample(3, rng=np.random.default_rng(0))


def test_queries_refuse_what_is_not_a_belief():
    half = BeliefSet(np.array([[1.0, -1.0]]), nothing(2))
    for query in (half.distance, half.nearest, half.contains):
        with pytest.raises(InputError, match="sums to"):
            query([0.5, 0.6])
        with pytest.raises(InputError, match="3 entries, expected one per state: 2"):
            query([0.5, 0.25, 0.25])
        with pytest.raises(InputError, match="nan"):
            query([np.nan, 1.0])
    with pytest.raises(InputError, match="whole number"):
        half.sample(0, rng=np.random.default_rng(0))
    with pytest.raises(InputError, match=r"numpy\.random\.Generator"):
        half.sample(3, rng=0)


@pytest.mark.parametrize("query", ["distance", "nearest", "contains"])
def test_single_belief_queries_refuse_many(query):
    half = BeliefSet(np.array([[1.0, -1.0, 0.0]]), nothing(3))
    with pytest.raises(InputError, match="one belief"):
        getattr(half, query)(np.eye(3))


# --- belief sets against oracles ----------------------------------------------------------------------------------------


def random_set(rng, n, n_equal, n_rows):
    """Rows through a random belief, so that the set holds it, on its boundary for some."""
    inside = rng.dirichlet(np.ones(n))
    equalities = rng.normal(size=(n_equal, n))
    equalities -= (equalities @ inside)[:, None]
    inequalities = rng.normal(size=(n_rows, n))
    inequalities += (rng.choice([0.0, 0.3], n_rows) - inequalities @ inside)[:, None]
    scale = max(np.abs(equalities).max(initial=0), np.abs(inequalities).max(initial=0), 1e-300)
    return inside, equalities / scale, inequalities / scale


@settings(max_examples=instances(200), deadline=None)
@given(SEEDS, st.integers(2, 6), st.integers(0, 3), st.integers(0, 6))
def test_random_sets_project_as_a_general_solver_does(seed, n, n_equal, n_rows):
    assume(n_equal <= n - 1)
    rng = np.random.default_rng(seed)
    inside, equalities, inequalities = random_set(rng, n, n_equal, n_rows)
    found = BeliefSet(equalities, inequalities)
    assert found.contains(inside)
    corners = found.vertices()
    assert np.abs(corners @ equalities.T).max(initial=0) < 1e-8
    assert (corners @ inequalities.T).min(initial=0) > -1e-8
    target = rng.dirichlet(np.ones(n))
    nearest = found.nearest(target)
    assert found.distance(target) == pytest.approx(np.linalg.norm(target - nearest))
    assert found.distance(target) <= np.linalg.norm(target - inside) + 1e-12
    # Variational inequality of a projection: no corner lies on the target's side of the plane at the nearest point.
    assert ((corners - nearest) @ (target - nearest)).max() < 1e-7
    if len(corners) <= 8:
        assert found.distance(target) == pytest.approx(consistent.hull_distance(target, corners), abs=1e-7)


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.integers(3, 5), st.integers(1, 4))
def test_random_sets_project_as_slsqp_does(seed, n, n_rows):
    rng = np.random.default_rng(seed)
    inside, equalities, inequalities = random_set(rng, n, 1, n_rows)
    target = rng.dirichlet(np.ones(n))
    rules = [
        {"type": "eq", "fun": lambda y: np.append(equalities @ y, y.sum() - 1)},
        {"type": "ineq", "fun": lambda y: np.append(inequalities @ y, y)},
    ]
    answer = minimize(
        lambda y: ((y - target) ** 2).sum(), inside, constraints=rules, method="SLSQP", options={"ftol": 1e-15}
    )
    assume(answer.success and rules[1]["fun"](answer.x).min() > -1e-9)
    distance = BeliefSet(equalities, inequalities).distance(target)
    assert distance == pytest.approx(float(np.sqrt(answer.fun)), abs=1e-5)


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.integers(2, 5))
def test_samples_are_members_and_fill_the_set(seed, n):
    rng = np.random.default_rng(seed)
    _, _, inequalities = random_set(rng, n, 0, 2)
    found = BeliefSet(nothing(n), inequalities)
    points = found.sample(200, rng=rng)
    assert points.shape == (200, n)
    np.testing.assert_allclose(points.sum(axis=1), 1, atol=1e-9)
    assert points.min() >= 0
    assert (points @ inequalities.T).min(initial=0) > -1e-8
    np.testing.assert_array_equal(
        found.sample(5, rng=np.random.default_rng(9)), found.sample(5, rng=np.random.default_rng(9))
    )


def test_samples_of_a_triangle_are_uniform():
    """A quarter of the area of {π_1 >= π_2} lies beyond the middle of the two sides that meet in (1, 0, 0)."""
    found = BeliefSet(nothing(3), np.array([[1.0, -1.0, 0.0]]))
    points = found.sample(4000, rng=np.random.default_rng(0))
    # In barycentric coordinates of the corners (1,0,0), (½,½,0), (0,0,1): shares π_1 − π_2, 2π_2, π_3.
    shares = np.column_stack([points[:, 0] - points[:, 1], 2 * points[:, 1], points[:, 2]])
    np.testing.assert_allclose((shares > 0.5).mean(axis=0), 0.25, atol=0.03)


@pytest.mark.parametrize("n", [8, 11])
def test_samples_of_many_dimensions_are_uniform(n: int, fresh_rng: np.random.Generator) -> None:
    """A repeated row makes the simplex a polytope like any other; its uniform law is Dirichlet's."""
    drawn = BeliefSet(nothing(n), np.eye(n)[:1]).sample(3000, rng=fresh_rng)
    assert drawn.min() >= 0.0
    exact = fresh_rng.dirichlet(np.ones(n), 300_000)
    for of in (lambda points: points.max(axis=1), lambda points: points[:, 0] ** 2, lambda points: points[:, -1]):
        assert of(drawn).mean() == pytest.approx(of(exact).mean(), abs=4.5 * of(exact).std() / np.sqrt(len(drawn)))


def test_a_set_with_a_tolerance_is_sampled_as_without(fresh_rng: np.random.Generator) -> None:
    """Eight dimensions, six of them thin: hundreds of corners, which cannot be divided into simplices in minutes."""
    rows, inside = fresh_rng.normal(size=(6, 9)), fresh_rng.dirichlet(np.full(9, 3.0))
    rows -= (rows @ inside)[:, None]
    thin, flat = (BeliefSet(rows / np.abs(rows).max(), np.zeros((0, 9)), tolerance) for tolerance in (1e-6, 1e-9))
    assert (thin.dimension, flat.dimension) == (8, 2)
    drawn, exact = thin.sample(2000, rng=fresh_rng), flat.sample(100_000, rng=fresh_rng)
    assert thin.violation(drawn).max() <= 1.001e-6
    error = exact.std(axis=0) / np.sqrt(len(drawn))
    assert (np.abs(drawn.mean(axis=0) - exact.mean(axis=0)) <= 4.5 * error + 1e-5).all()
    np.testing.assert_allclose(drawn.std(axis=0), exact.std(axis=0), rtol=0.1, atol=1e-5)


def test_bounds_of_many_dimensions_are_those_of_the_corners(fresh_rng: np.random.Generator) -> None:
    rows = fresh_rng.normal(size=(2, 12))
    found = BeliefSet(nothing(12), rows - 0.9 * rows.mean(axis=1, keepdims=True))
    assert found.dimension == 11
    corners = found.vertices()
    np.testing.assert_allclose(found.bounds(), np.column_stack([corners.min(axis=0), corners.max(axis=0)]), atol=1e-8)


# --- multiplier cones ---------------------------------------------------------------------------------------------------


@settings(max_examples=150, deadline=None)
@given(SEEDS, st.integers(1, 5), st.integers(0, 6), st.integers(0, 2), st.booleans())
def test_cone_rows_accept_exactly_the_combinations(seed, size, n_active, n_equal, degenerate):
    """−g = A'λ + E'ν with λ >= 0 ⇔ P g = 0 and Q g >= 0, decided here by non-negative least squares."""
    from scipy.optimize import nnls

    rng = np.random.default_rng(seed)
    active, equalities = rng.normal(size=(n_active, size)), rng.normal(size=(n_equal, size))
    if degenerate and n_active >= 2:
        active[1] = 2 * active[0]
        active[-1] = active[0] + active[n_active // 2]
    rows = stationarity_rows(active, equalities)
    generators = np.vstack([active, equalities, -equalities]).T
    for _ in range(6):
        gradient = rng.normal(size=size)
        if rng.uniform() < 0.7 and generators.size:
            gradient = -generators @ rng.exponential(size=generators.shape[1])
        gradient /= np.linalg.norm(gradient)
        residual = nnls(generators, -gradient)[1] if generators.size else 1.0
        accepted = np.abs(rows.equalities @ gradient).max(initial=0) < 1e-8 and bool(
            (rows.inequalities @ gradient).min(initial=0) > -1e-8
        )
        assume(residual < 1e-10 or residual > 1e-5)
        assert accepted == (residual < 1e-10)


@pytest.mark.parametrize("n", [3, 4, 5])
@pytest.mark.parametrize("gap", [-1e-6, -2e-9, -5e-10, -2e-10, 0.0, 2e-10, 5e-10, 2e-9, 1e-6])
def test_rows_that_almost_conflict_give_an_answer(n, gap):
    """π_1 − π_2 >= gap/2 and <= −gap/2: a thin set, a set without interior, or none; never an error."""
    row = np.zeros(n)
    row[:2] = 1.0, -1.0
    found = BeliefSet(nothing(n), np.vstack([row, -row]) - gap / 2)
    if gap > 1e-8:
        assert found.is_empty
        return
    assert found.is_empty or found.dimension in (n - 2, n - 1)
    if not found.is_empty:
        middle = np.full(n, 1 / n)
        assert found.distance(middle) <= 1e-8
        assert found.distance(np.eye(n)[0]) == pytest.approx(1 / np.sqrt(2), abs=1e-5)
        np.testing.assert_allclose(found.bounds()[:2], [[0, 0.5], [0, 0.5]], atol=1e-5)
    assert found.is_empty is False or gap > 0


def test_samples_are_uniform_where_many_rows_are_alike() -> None:
    """Against rejection from the simplex of 11 states; from the analytic centre alone the mean is a sixth of this one."""
    costs = np.ones((11, 201))
    costs[:, 0], costs[0, 1:] = 0.0, -0.5
    costs[1:, 1:] += 0.1 * np.random.default_rng(201).random((10, 200))
    found = consistent_beliefs(FiniteProblem(costs), 0)
    drawn = np.random.default_rng(3).dirichlet(np.ones(11), 40_000)
    inside = drawn[(drawn @ (costs - costs[:, :1]) >= 0.0).all(axis=1)]
    sample = found.sample(800, rng=np.random.default_rng(1))
    error = np.sqrt(sample.var(axis=0) / len(sample) + inside.var(axis=0) / len(inside))
    assert (np.abs(sample.mean(axis=0) - inside.mean(axis=0)) <= 4.5 * error).all()
