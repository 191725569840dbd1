"""Quadratic programmes solved by an active set and polished on it.

min ½u'Hu + g'u over C. DAQP finds the active set; the KKT equations on it are then solved directly, so that the
stationarity residual is a few roundings and coordinates at a bound are exactly on it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import daqp
import numpy as np
from scipy.linalg import null_space

from inscrutable import tolerances
from inscrutable.errors import ModelError, SolverError
from inscrutable.linear_programmes import Rows, minimum
from inscrutable.problems.constraints import Polyhedron
from inscrutable.validation import Array

_CHUNK_ENTRIES = 8_000_000
_MOST_REPAIRS = 50
_EQUALITY = 5
_MOST_NAMED = 6


@dataclass(frozen=True, eq=False)
class Layout:
    """A feasible set as bounds on coordinates and general rows; row numbers refer to the polyhedron's inequalities."""

    lower: Array  # (U,)
    upper: Array  # (U,)
    general: Array  # (n, U)
    sides: Array  # (n,)
    equalities: Array  # (e, U)
    equality_sides: Array  # (e,)

    @cached_property
    def asked(self) -> _Asked:
        """The set as DAQP reads it, the same for all programmes."""
        n_actions, n_rows = self.lower.size, self.sides.size
        sense = np.zeros(n_actions + n_rows + self.equality_sides.size, dtype=np.int32)
        sense[n_actions + n_rows :] = _EQUALITY
        fixed = np.flatnonzero(self.lower == self.upper)
        sense[fixed] = _EQUALITY
        return _Asked(
            np.vstack([self.general, self.equalities]),
            np.concatenate([self.lower, np.full(n_rows, -np.inf), self.equality_sides]),
            np.concatenate([self.upper, self.sides, self.equality_sides]),
            sense,
            fixed,
        )


class _Asked(NamedTuple):
    """Rows with their sides, bounds first; which are equalities; and the coordinates whose two bounds are one."""

    rows: Array
    lower: Array
    upper: Array
    sense: np.ndarray
    fixed: np.ndarray


def layout_of(region: Polyhedron) -> Layout:
    """Split the rows of a polyhedron into bounds on one coordinate, general rows and equalities."""
    lower, upper = region.coordinate_bounds
    return Layout(lower, upper, *region.general_rows, region.A_eq, region.b_eq)


@dataclass(frozen=True)
class _Working:
    """Working set of one programme: −1, 0, +1 per coordinate at its lower bound, free, upper; and general rows."""

    bounds: np.ndarray
    rows: np.ndarray

    def key(self) -> bytes:
        return self.bounds.tobytes() + self.rows.tobytes()


def solve_programmes(hessians: Array, linear: Array, layout: Layout) -> Array:
    """Return the minimisers, shape (n, U), of n programmes with hessians (n,U,U) and linear terms (n,U)."""
    n, n_actions = linear.shape
    actions = np.empty((n, n_actions))
    step = max(1, _CHUNK_ENTRIES // (n_actions * n_actions))
    for first in range(0, n, step):
        part = slice(first, min(first + step, n))
        actions[part] = _solve_chunk(hessians[part], linear[part], layout)
    return actions


def _solve_chunk(hessians: Array, linear: Array, layout: Layout) -> Array:
    scale = np.maximum(np.abs(hessians).max(axis=(1, 2)), np.abs(linear).max(axis=1))
    scale = np.where(scale > 0, scale, 1.0)
    hessians = hessians / scale[:, None, None]
    linear = linear / scale[:, None]
    rough = np.empty_like(linear)
    groups: dict[bytes, tuple[_Working, list[int]]] = {}
    for i in range(linear.shape[0]):
        rough[i], working = _rough_solution(hessians[i], linear[i], layout)
        groups.setdefault(working.key(), (working, []))[1].append(i)
    actions = np.empty_like(rough)
    for working, members in groups.values():
        index = np.array(members)
        solved, ok = _on_working_set(hessians[index], linear[index], layout, working)
        actions[index] = solved
        for i in index[~ok]:
            actions[i] = _repair(hessians[i], linear[i], layout, working, rough[i])
    return actions


def _rough_solution(hessian: Array, linear: Array, layout: Layout) -> tuple[Array, _Working]:
    n_actions = linear.size
    n_rows = layout.sides.size
    asked = layout.asked
    u, _, flag, info = daqp.solve(
        hessian, linear, asked.rows, asked.upper, asked.lower, asked.sense.copy(), primal_tol=tolerances.FEASIBILITY
    )
    endless = _endless_direction(hessian, linear, layout) if flag == -3 else None
    if endless is not None:
        raise _no_minimum(endless)
    if flag < 1:
        # DAQP fails on some near-singular programmes; the repair can start from any feasible point.
        return _feasible_point(layout), _Working(np.zeros(n_actions, dtype=np.int8), np.zeros(n_rows, dtype=bool))
    multiplier = np.asarray(info["lam"])
    bounds = np.sign(multiplier[:n_actions]).astype(np.int8)
    bounds[asked.fixed] = -1
    return np.asarray(u), _Working(bounds, multiplier[n_actions : n_actions + n_rows] > 0)


def _endless_direction(hessian: Array, linear: Array, layout: Layout) -> Array | None:
    """A direction of the set's recession cone without curvature along which the cost falls; None where there is none."""
    open_sides = zip(np.isinf(layout.lower), np.isinf(layout.upper), strict=True)
    bounds = [(-1.0 if below else 0.0, 1.0 if above else 0.0) for below, above in open_sides]
    flat = np.vstack([layout.equalities, hessian])
    level = Rows(layout.general, np.zeros(layout.sides.size))
    steepest = minimum(linear, level, Rows(flat, np.zeros(len(flat))), bounds)
    return steepest.x if steepest.value < -tolerances.LINEAR_PROGRAMME else None


def _no_minimum(direction: Array) -> ModelError:
    return ModelError(
        f"the cost has no minimum over the feasible set: it is unbounded below along {_told(direction)}; "
        "bound these, for instance with & box(lower, upper)"
    )


def _told(direction: Array) -> str:
    moved = np.flatnonzero(np.abs(direction) > tolerances.FEASIBILITY)
    parts = ", ".join(f"u[{j}] {direction[j]:+.3g}" for j in moved[:_MOST_NAMED])
    return f"{parts} …" if len(moved) > _MOST_NAMED else parts


def _feasible_point(layout: Layout) -> Array:
    bounds = [
        (None if np.isinf(low) else low, None if np.isinf(high) else high)
        for low, high in zip(layout.lower, layout.upper, strict=True)
    ]
    nothing = np.zeros(layout.lower.size)
    return minimum(
        nothing, Rows(layout.general, layout.sides), Rows(layout.equalities, layout.equality_sides), bounds
    ).x


def _on_working_set(hessians: Array, linear: Array, layout: Layout, working: _Working) -> tuple[Array, np.ndarray]:
    """Solve the KKT equations of programmes that share a working set; return which answers are minimisers."""
    free = np.flatnonzero(working.bounds == 0)
    held = np.flatnonzero(working.bounds != 0)
    normals = np.vstack([layout.general[working.rows], layout.equalities])
    sides = np.concatenate([layout.sides[working.rows], layout.equality_sides])
    n, k = linear.shape[0], free.size
    actions = np.empty_like(linear)
    actions[:, held] = np.where(working.bounds[held] < 0, layout.lower[held], layout.upper[held])
    if k + normals.shape[0]:
        matrix = np.zeros((n, k + sides.size, k + sides.size))
        matrix[:, :k, :k] = hessians[:, free[:, None], free]
        matrix[:, :k, k:] = normals[:, free].T
        matrix[:, k:, :k] = normals[:, free]
        right = np.empty((n, k + sides.size))
        right[:, :k] = -linear[:, free] - np.einsum("nij,nj->ni", hessians[:, free[:, None], held], actions[:, held])
        right[:, k:] = sides - actions[:, held] @ normals[:, held].T
        try:
            solution = np.linalg.solve(matrix, right[..., None])[..., 0]
            solution += np.linalg.solve(matrix, (right - np.einsum("nij,nj->ni", matrix, solution))[..., None])[..., 0]
        except np.linalg.LinAlgError:  # one singular matrix is enough
            if n == 1:
                return actions, np.zeros(1, dtype=bool)
            alone = [_on_working_set(hessians[[i]], linear[[i]], layout, working) for i in range(n)]
            return np.concatenate([each for each, _ in alone]), np.concatenate([ok for _, ok in alone])
        actions[:, free] = solution[:, :k]
        multipliers = np.asarray(solution[:, k:], dtype=np.float64)
    else:
        multipliers = np.zeros((n, 0))
    return _judge(hessians, linear, layout, working, actions, multipliers)


def _judge(
    hessians: Array, linear: Array, layout: Layout, working: _Working, actions: Array, multipliers: Array
) -> tuple[Array, np.ndarray]:
    tolerance = tolerances.STATIONARITY
    clipped = np.clip(actions, layout.lower, layout.upper)
    clipped = np.where(np.abs(clipped - layout.lower) <= tolerance, layout.lower, clipped)
    clipped = np.where(np.abs(layout.upper - clipped) <= tolerance, layout.upper, clipped)
    with np.errstate(invalid="ignore"):
        moved = np.abs(clipped - actions).max(axis=1)
        broken = (actions @ layout.general.T - layout.sides).max(axis=1, initial=-np.inf)
        normals = np.vstack([layout.general[working.rows], layout.equalities])
        unmet = np.abs(actions @ layout.equalities.T - layout.equality_sides).max(axis=1, initial=0.0)
        gradient = np.einsum("nij,nj->ni", hessians, actions) + linear + multipliers @ normals
        size = 1.0 + np.abs(actions).max(axis=1)
        residual = np.abs(gradient[:, working.bounds == 0]).max(axis=1, initial=0.0)
        pushing = (gradient * working.bounds)[:, working.bounds != 0].max(axis=1, initial=0.0)
        pulling = -multipliers[:, : int(working.rows.sum())].min(axis=1, initial=0.0)
        ok = (np.maximum(moved, unmet) <= tolerance * size) & (broken <= tolerance * size)
        ok &= (np.maximum(residual, pushing) <= tolerance * size) & (pulling <= tolerance * size)
    return clipped, ok


def _repair(hessian: Array, linear: Array, layout: Layout, working: _Working, start: Array) -> Array:
    """A primal active-set method from DAQP's point, for singular or degenerate programmes."""
    u = np.clip(start, layout.lower, layout.upper)
    bounds = np.where(u <= layout.lower, -1, np.where(u >= layout.upper, 1, 0)).astype(np.int8)
    rows = layout.sides - layout.general @ u <= tolerances.FEASIBILITY
    fixed = layout.lower == layout.upper
    best, best_residual = u, np.inf
    is_curved = bool(np.linalg.eigvalsh(hessian)[0] > tolerances.CURVATURE)
    for _ in range(_MOST_REPAIRS + 4 * u.size):
        free = np.flatnonzero(bounds == 0)
        normals = np.vstack([layout.general[rows], layout.equalities])
        sides = np.concatenate([layout.sides[rows], layout.equality_sides])
        slide = None if is_curved else _flat_descent(hessian, linear, u, free, normals)
        if slide is None:
            step, multipliers = _newton_step(hessian, linear, u, free, normals, sides)
            length, blocking = _longest_step(u, step, layout, bounds, rows)
        else:
            step = slide
            length, blocking = _longest_step(u, step, layout, bounds, rows, most=np.inf)
            if blocking is None:
                raise _no_minimum(step)
        u = np.clip(u + length * step, layout.lower, layout.upper)
        if blocking is not None:
            kind, j = blocking
            if kind == "row":
                rows[j] = True
            else:
                bounds[j] = -1 if kind == "lower" else 1
                u[j] = layout.lower[j] if kind == "lower" else layout.upper[j]
            continue
        gradient = hessian @ u + linear + multipliers @ normals
        pushing = np.where(fixed, -np.inf, gradient * bounds)
        pulling = -multipliers[: int(rows.sum())]
        worst = max(pushing.max(initial=0.0), pulling.max(initial=0.0))
        residual = max(worst, np.abs(gradient[bounds == 0]).max(initial=0.0))
        if residual < best_residual:
            best, best_residual = u.copy(), residual
        if worst <= tolerances.STATIONARITY:
            break
        if pushing.max(initial=0.0) >= pulling.max(initial=0.0):
            bounds[int(pushing.argmax())] = 0
        else:
            rows[np.flatnonzero(rows)[int(pulling.argmax())]] = False
    best = np.where(np.abs(best - layout.lower) <= tolerances.STATIONARITY, layout.lower, best)
    if best_residual > tolerances.EXPLAINED:
        raise SolverError(f"a quadratic programme kept a KKT residual of {best_residual:.1e} relative to its scale")
    return best


def _flat_descent(hessian: Array, linear: Array, u: Array, free: np.ndarray, normals: Array) -> Array | None:
    """The steepest direction along the working set in which the cost falls linearly; None where there is none."""
    ways = null_space(normals[:, free], rcond=tolerances.STATIONARITY) if len(normals) else np.eye(free.size)
    curvatures, axes = np.linalg.eigh(ways.T @ hessian[np.ix_(free, free)] @ ways)
    flat = ways @ axes[:, curvatures <= tolerances.CURVATURE]
    slope = flat @ (flat.T @ (hessian @ u + linear)[free])
    steepness = np.abs(slope).max(initial=0.0)
    if steepness <= tolerances.STATIONARITY:
        return None
    step = np.zeros(u.size)
    step[free] = -slope / steepness
    return step


def _newton_step(
    hessian: Array, linear: Array, u: Array, free: np.ndarray, normals: Array, sides: Array
) -> tuple[Array, Array]:
    k = free.size
    matrix = np.zeros((k + sides.size, k + sides.size))
    matrix[:k, :k] = hessian[np.ix_(free, free)]
    matrix[:k, k:] = normals[:, free].T
    matrix[k:, :k] = normals[:, free]
    right = np.concatenate([-(hessian @ u + linear)[free], sides - normals @ u])
    solution = np.linalg.lstsq(matrix, right, rcond=tolerances.STATIONARITY)[0]
    solution += np.linalg.lstsq(matrix, right - matrix @ solution, rcond=tolerances.STATIONARITY)[0]
    step = np.zeros(u.size)
    step[free] = solution[:k]
    return step, solution[k:]


def _longest_step(
    u: Array, step: Array, layout: Layout, bounds: np.ndarray, rows: np.ndarray, most: float = 1.0
) -> tuple[float, tuple[str, int] | None]:
    length: float = most
    blocking = None
    tiny = tolerances.STATIONARITY
    for j in np.flatnonzero((bounds == 0) & (np.abs(step) > tiny)):
        limit = layout.lower[j] if step[j] < 0 else layout.upper[j]
        reach = (limit - u[j]) / step[j]
        if reach < length:
            length, blocking = max(reach, 0.0), ("lower" if step[j] < 0 else "upper", int(j))
    speed = layout.general @ step
    for j in np.flatnonzero(~rows & (speed > tiny)):
        reach = (layout.sides[j] - layout.general[j] @ u) / speed[j]
        if reach < length:
            length, blocking = max(reach, 0.0), ("row", int(j))
    return length, blocking
