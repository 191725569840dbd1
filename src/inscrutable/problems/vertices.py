"""Optimal vertices of linear costs for many beliefs: each vertex found by one linear programme, then recognised.

A vertex is optimal for the gradient g exactly when its rows give P g = 0 and Q g ≥ 0 (`geometry.cones`). Where an entry of
Q g is zero, several vertices are optimal; the one that is least in a fixed direction d is taken, recognised by
Q (g + εd) ≥ 0 for small ε.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.errors import ModelError, SolverError
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems.constraints import Polyhedron
from inscrutable.validation import Array

_MOST_VERTICES = 4096
_GOLDEN = 0.6180339887498949


class _Vertex(NamedTuple):
    """A vertex and the rows of its cell of beliefs; without rows where there would be too many."""

    point: Array  # (U,)
    equal: Array  # (k, X)
    signs: Array  # (m, X)
    ties: Array  # (m,) the fixed direction in the same rows
    known: bool


class _Known(NamedTuple):
    """The vertices found so far. A new one makes another table, so that a thread reads one that is whole."""

    vertices: tuple[_Vertex, ...]
    points: Array  # (n,U)


class VertexTable:
    """The vertices found so far for costs (X,U) over a polyhedron."""

    def __init__(self, costs: Array, region: Polyhedron) -> None:
        self._costs, self._region = costs, region
        # Multiples of the golden ratio: no two vertices with round coordinates are equal along it.
        self._direction = 0.5 + (np.arange(1, costs.shape[1] + 1) * _GOLDEN) % 1.0
        self._known = _Known((), np.zeros((0, costs.shape[1])))

    def solve(self, held: Array) -> Array:
        """Return an optimal vertex (T,U) for each belief (T,X)."""
        found = np.empty((len(held), self._costs.shape[1]))
        left = np.arange(len(held))
        known = self._known
        if known.vertices:
            left = self._recognise(known, held, found)
        while left.size:
            vertex = self._by_programme(held[left[0]])
            mine = self._optimal(vertex, held[left])
            mine[0] = True  # despite rounding
            found[left[mine]] = vertex.point
            left = left[~mine]
        return found

    def _recognise(self, known: _Known, held: Array, found: Array) -> np.ndarray:
        """Fill in the beliefs whose cheapest known vertex is proved optimal; return the others."""
        costs = held @ self._costs @ known.points.T
        margin = tolerances.STATIONARITY * np.maximum(np.abs(costs).max(axis=1), self._size(held))
        best = costs <= (costs.min(axis=1) + margin)[:, None]
        chosen = np.where(best, known.points @ self._direction, np.inf).argmin(axis=1)
        proved = np.zeros(len(held), dtype=bool)
        for number in np.unique(chosen):
            mine = np.flatnonzero(chosen == number)
            proved[mine] = self._optimal(known.vertices[number], held[mine])
        found[proved] = known.points[chosen[proved]]
        return np.flatnonzero(~proved)

    def _optimal(self, vertex: _Vertex, held: Array) -> np.ndarray:
        if not vertex.known:
            return np.zeros(len(held), dtype=bool)
        tiny = (tolerances.STATIONARITY * self._size(held))[:, None]
        signs = held @ vertex.signs.T
        falls = (signs > tiny) | ((signs >= -tiny) & (vertex.ties >= -tolerances.STATIONARITY))
        return np.asarray(falls.all(axis=1) & (np.abs(held @ vertex.equal.T) <= tiny).all(axis=1))

    def _size(self, held: Array) -> Array:
        """Return the size (T,) of what the gradients add up; they may cancel."""
        return np.asarray((held @ np.abs(self._costs)).max(axis=1))

    def _by_programme(self, belief: Array) -> _Vertex:
        gradient = belief @ self._costs
        gradient[np.abs(gradient) <= tolerances.STATIONARITY * self._size(belief[None])] = 0.0
        scale = np.abs(gradient).max()
        gradient = gradient / scale if scale > 0 else gradient
        region = self._region
        below, equal = Rows(region.A_ub, region.b_ub), Rows(region.A_eq, region.b_eq)
        answer = minimise(gradient, below, equal)
        if answer.status != OPTIMAL:
            raise ModelError(f"the cost has no minimum over the feasible set: {answer.message}")
        vertex = self._vertex_at(self._exact(answer.x))
        if not self._optimal(vertex, belief[None])[0]:
            level = Rows(np.vstack([region.A_ub, gradient]), np.append(region.b_ub, gradient @ vertex.point))
            tied = minimise(self._direction, level, equal)
            if tied.status == OPTIMAL:
                other = self._vertex_at(self._exact(tied.x))
                if gradient @ other.point <= gradient @ vertex.point + tolerances.FEASIBILITY:
                    vertex = other
        self._keep(vertex)
        return vertex

    def _keep(self, vertex: _Vertex) -> None:
        known = self._known
        seen = np.abs(known.points - vertex.point).max(axis=1, initial=0.0) <= tolerances.SAME_ACTION
        if not seen.any() and len(known.vertices) < _MOST_VERTICES:
            self._known = _Known((*known.vertices, vertex), np.vstack([known.points, vertex.point]))

    def _exact(self, point: Array) -> Array:
        """Solve the rows that are tight at a vertex as HiGHS returns it, bounds to the last digit."""
        region = self._region
        tight = region.slacks(point) <= tolerances.FEASIBILITY * max(1.0, float(np.abs(point).max()))
        normals = np.vstack([region.A_ub[tight], region.A_eq])
        if len(normals):
            sides = np.concatenate([region.b_ub[tight], region.b_eq])
            point = point + np.linalg.lstsq(normals, sides - normals @ point, rcond=tolerances.ON_FACE)[0]
        for limit in region.coordinate_bounds:
            near = np.abs(point - limit) <= tolerances.FEASIBILITY * np.maximum(1.0, np.abs(point))
            point = np.where(near, limit, point)
        return np.asarray(point) + 0.0

    def _vertex_at(self, point: Array) -> _Vertex:
        region = self._region
        tight = region.slacks(point) <= tolerances.FEASIBILITY * max(1.0, float(np.abs(point).max()))
        n_states = len(self._costs)
        try:
            rows = region.stationarity(tight)
        except SolverError:
            return _Vertex(point, np.zeros((0, n_states)), np.zeros((0, n_states)), np.zeros(0), False)
        return _Vertex(
            point,
            rows.equalities @ self._costs.T,
            rows.inequalities @ self._costs.T,
            rows.inequalities @ self._direction,
            True,
        )
