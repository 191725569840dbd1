"""The nearest point under linear rows against DAQP, HiGHS, closed forms, and the conditions of optimality themselves."""

from __future__ import annotations

from typing import Any

import daqp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog

from inscrutable.kernels.projection import project_in, room_for
from sizes import instances
from strategies import SEEDS

Array = NDArray[np.float64]

NEAR = 1e-10
ROUNDING = 1e-8  # of points and multipliers: near, times the condition of the rows drawn here


def unit(rows: Array) -> Array:
    return np.ascontiguousarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def projected(rows: Array, sides: Array, n_equal: int, point: Array, near: float = NEAR) -> tuple[bool, Array, Array]:
    x, multipliers = np.array(point, dtype=float), np.full(len(rows), np.nan)
    before = rows.copy(), sides.copy()
    possible = project_in(rows, sides, len(rows), n_equal, near, x, multipliers, room_for(x.size, len(rows)))
    assert np.array_equal(rows, before[0])
    assert np.array_equal(sides, before[1])
    return bool(possible), x, multipliers


def is_feasible(rows: Array, sides: Array, n_equal: int) -> bool:
    """Whether HiGHS finds any point."""
    answer: Any = linprog(
        np.zeros(rows.shape[1]),
        A_ub=-rows[n_equal:],
        b_ub=-sides[n_equal:],
        A_eq=rows[:n_equal],
        b_eq=sides[:n_equal],
        bounds=(None, None),
        method="highs",
    )
    return bool(answer.status == 0)


def by_daqp(rows: Array, sides: Array, n_equal: int, point: Array) -> Array:
    upper = np.full(len(rows), 1e30)
    upper[:n_equal] = sides[:n_equal]
    sense = np.zeros(len(rows), dtype=np.int32)
    sense[:n_equal] = 5
    x, _, flag, _ = daqp.solve(
        np.eye(point.size), -point, rows, upper, sides, sense, primal_tol=1e-11, dual_tol=1e-11, progress_tol=1e-14
    )
    assert flag == 1
    return np.asarray(x)


def assert_is_nearest(rows: Array, sides: Array, n_equal: int, point: Array, x: Array, multipliers: Array) -> None:
    """x − p = N'λ, λ ≥ 0 for inequalities and zero where slack: for this convex programme, a proof."""
    slack = rows @ x - sides
    assert slack[n_equal:].min(initial=0.0) >= -ROUNDING
    assert np.abs(slack[:n_equal]).max(initial=0.0) <= ROUNDING
    assert multipliers[n_equal:].min(initial=0.0) >= -1e-12 * (1.0 + np.abs(multipliers).max(initial=0.0))
    scale = 1.0 + np.abs(multipliers).max(initial=0.0)
    np.testing.assert_allclose(rows.T @ multipliers, x - point, atol=ROUNDING * scale)
    assert np.abs(multipliers * slack).max(initial=0.0) <= ROUNDING * scale


def drawn(rng: np.random.Generator, size: int, n_rows: int, n_equal: int, wish: str) -> tuple[Array, Array, int]:
    """Unit rows around a point that satisfies them; "repeated" copies rows, "corner" lets all meet in that point,
    "whole" has small whole coefficients, so that rows depend on each other."""
    rows = rng.integers(-2, 3, (n_rows, size)).astype(float) if wish == "whole" else rng.normal(size=(n_rows, size))
    rows[np.abs(rows).sum(axis=1) == 0, 0] = 1.0
    rows = unit(rows)
    n_equal = min(n_equal, size, n_rows)
    copies = rng.integers(0, n_rows, n_rows) if wish == "repeated" and n_rows else np.zeros(0, dtype=int)
    rows = np.vstack([rows, rows[copies]])
    inside = rng.normal(size=size)
    loose = 0.0 if wish == "corner" else rng.exponential(size=len(rows))
    sides = rows @ inside - loose
    sides[:n_equal] = rows[:n_equal] @ inside
    for c, r in enumerate(copies):  # some copies repeat the side as well, and those of equalities lie on them
        sides[n_rows + c] = sides[r] if rng.uniform() < 0.5 or r < n_equal else sides[n_rows + c]
    return np.ascontiguousarray(rows), sides, n_equal


@settings(max_examples=instances(500))
@given(
    SEEDS,
    st.integers(1, 7),
    st.integers(0, 20),
    st.integers(0, 3),
    st.sampled_from(["plain", "repeated", "corner", "whole"]),
)
def test_nearest_point_as_daqp_finds_it(seed: int, size: int, n_rows: int, n_equal: int, wish: str) -> None:
    rng = np.random.default_rng(seed)
    rows, sides, n_equal = drawn(rng, size, n_rows, n_equal, wish)
    point = rng.normal(size=size) * 3.0
    possible, x, multipliers = projected(rows, sides, n_equal, point)
    assert possible
    assert_is_nearest(rows, sides, n_equal, point, x, multipliers)
    if len(rows) and np.linalg.matrix_rank(rows[:n_equal]) == n_equal:
        np.testing.assert_allclose(x, by_daqp(rows, sides, n_equal, point), atol=1e-6)


@given(SEEDS, st.integers(1, 7), st.integers(1, 14), st.integers(0, 9))
def test_infeasible_rows_are_refused_and_only_they(seed: int, size: int, n_rows: int, n_equal: int) -> None:
    """Random sides, more equalities than coordinates among them: whatever HiGHS says, unless it is a close call."""
    rng = np.random.default_rng(seed)
    rows, n_equal = unit(rng.normal(size=(n_rows, size))), min(n_equal, n_rows)
    sides = rng.normal(size=n_rows) - 0.5
    relaxed, strict = sides.copy(), sides.copy()
    relaxed[n_equal:] -= 1e-6
    strict[n_equal:] += 1e-6
    feasible = is_feasible(rows, relaxed, n_equal)
    if feasible != is_feasible(rows, strict, n_equal):
        return
    point = rng.normal(size=size)
    possible, x, multipliers = projected(rows, sides, n_equal, point)
    assert possible == feasible
    if possible:
        assert_is_nearest(rows, sides, n_equal, point, x, multipliers)


@given(SEEDS, st.integers(1, 7))
def test_on_the_simplex_the_closed_form(seed: int, size: int) -> None:
    """max(p − τ, 0) with Σ = 1, τ from the sorted entries; the sum's row comes first, as an equality."""
    rng = np.random.default_rng(seed)
    point = rng.normal(size=size)
    rows = np.vstack([np.full((1, size), 1.0 / np.sqrt(size)), np.eye(size)])
    sides = np.append(1.0 / np.sqrt(size), np.zeros(size))
    possible, x, multipliers = projected(rows, sides, 1, point)
    falling = np.sort(point)[::-1]
    level = (np.cumsum(falling) - 1.0) / np.arange(1, size + 1)
    shift = level[np.flatnonzero(falling > level)[-1]]
    assert possible
    np.testing.assert_allclose(x, np.maximum(point - shift, 0.0), atol=1e-12)
    assert_is_nearest(rows, sides, 1, point, x, multipliers)
    np.testing.assert_allclose(multipliers[0], -shift * np.sqrt(size), atol=1e-12)


def test_a_half_space_and_a_box() -> None:
    rows = np.array([[0.6, 0.8]])
    possible, x, multipliers = projected(rows, np.array([2.0]), 0, np.array([1.0, -1.0]))
    assert possible
    np.testing.assert_allclose(x, [1.0 + 0.6 * 2.2, -1.0 + 0.8 * 2.2], atol=1e-15)
    np.testing.assert_allclose(multipliers, [2.2], atol=1e-15)
    box = np.vstack([np.eye(3), -np.eye(3)])
    possible, x, multipliers = projected(box, np.array([0.0, 0, 0, -1, -1, -1]), 0, np.array([-2.0, 0.3, 5.0]))
    assert possible
    np.testing.assert_allclose(x, [0.0, 0.3, 1.0], atol=1e-15)
    np.testing.assert_allclose(multipliers, [2.0, 0, 0, 0, 0, 4.0], atol=1e-15)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_equality_is_met_from_either_side(side: float) -> None:
    possible, x, multipliers = projected(np.array([[1.0, 0.0]]), np.array([0.5]), 1, np.array([0.5 - side, 7.0]))
    assert possible
    np.testing.assert_allclose(x, [0.5, 7.0])
    np.testing.assert_allclose(multipliers, [side])


@given(SEEDS, st.integers(1, 7))
def test_a_point_inside_stays_to_the_last_digit(seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    rows, sides, _ = drawn(rng, size, 10, 0, "plain")
    inside = np.linalg.lstsq(rows, sides + 1.0, rcond=None)[0]
    sides = np.minimum(sides, rows @ inside - 1e-3)
    possible, x, multipliers = projected(rows, sides, 0, inside)
    assert possible
    assert np.array_equal(x, inside)
    assert not multipliers.any()


def test_without_rows_or_without_coordinates() -> None:
    assert projected(np.zeros((0, 3)), np.zeros(0), 0, np.arange(3.0))[0]
    assert projected(np.zeros((0, 0)), np.zeros(0), 0, np.zeros(0))[0]
    assert projected(np.zeros((2, 0)), np.array([0.0, -1.0]), 0, np.zeros(0))[0]
    assert projected(np.zeros((2, 0)), np.array([0.0, -1.0]), 1, np.zeros(0))[0]
    assert not projected(np.zeros((2, 0)), np.array([0.0, 1.0]), 0, np.zeros(0))[0]


def test_equalities_that_repeat_or_contradict_each_other() -> None:
    rows = np.array([[1.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    point = np.array([3.0, -1.0])
    possible, x, multipliers = projected(rows, np.array([1.0, 1.0, -1.0, 0.0]), 3, point)
    assert possible
    np.testing.assert_allclose(x, [1.0, 0.0])
    assert_is_nearest(rows, np.array([1.0, 1.0, -1.0, 0.0]), 3, point, x, multipliers)
    assert not projected(rows, np.array([1.0, 1.1, -1.0, 0.0]), 3, point)[0]
    assert not projected(rows, np.array([1.0, 0.9, -1.0, 0.0]), 3, point)[0]


@pytest.mark.parametrize("gap", [-1e-3, 1e-3])
def test_opposite_rows_meet_or_do_not(gap: float) -> None:
    """1 + gap ≤ x ≤ 1 with other rows about; a slab as thin as a thousandth is possible, one turned around is not."""
    rng = np.random.default_rng(0)
    normal = unit(rng.normal(size=(1, 4)))
    rows = np.vstack([normal, -normal, unit(rng.normal(size=(5, 4)))])
    sides = np.append([1.0 + gap, -1.0], np.full(5, -50.0))
    possible, x, _ = projected(rows, sides, 0, rng.normal(size=4))
    assert possible == (gap < 0)
    if possible:
        assert sides[0] - ROUNDING <= normal[0] @ x <= 1.0 + ROUNDING


def test_a_violation_below_near_counts_as_none() -> None:
    rows, point = np.array([[1.0, 0.0]]), np.array([-1e-6, 2.0])
    assert np.array_equal(projected(rows, np.zeros(1), 0, point, near=1e-5)[1], point)
    assert projected(rows, np.zeros(1), 0, point, near=1e-7)[1][0] == 0.0


def test_rows_beyond_the_count_are_not_read() -> None:
    rows, sides = np.vstack([np.eye(2), [[np.nan, np.nan]]]), np.array([0.0, 0.0, np.nan])
    x, multipliers = np.array([-1.0, 1.0]), np.full(3, 7.0)
    assert project_in(rows, sides, 2, 0, NEAR, x, multipliers, room_for(x.size, 2))
    assert np.array_equal(x, [0.0, 1.0])
    assert np.array_equal(multipliers, [1.0, 0.0, 7.0])


@given(SEEDS, st.integers(2, 7), st.floats(3.0, 6.0))
def test_rows_that_nearly_repeat_each_other(seed: int, size: int, decades: float) -> None:
    """Pairs of rows turned by 1e-3 to 1e-6: feasible within the tolerance, and no farther than any drawn feasible point."""
    rng = np.random.default_rng(seed)
    base = unit(rng.normal(size=(size, size)))
    rows = np.vstack([base, unit(base + 10.0**-decades * rng.normal(size=base.shape))])
    inside = rng.normal(size=size)
    sides = rows @ inside - np.where(rng.uniform(size=len(rows)) < 0.5, 0.0, rng.exponential(size=len(rows)))
    point = rng.normal(size=size) * 2.0
    possible, x, _ = projected(rows, sides, 0, point)
    assert possible
    assert (rows @ x - sides).min() >= -1e-7
    assert np.linalg.norm(x - point) <= np.linalg.norm(inside - point) + 1e-7
    np.testing.assert_allclose(x, by_daqp(rows, sides, 0, point), atol=1e-4)
