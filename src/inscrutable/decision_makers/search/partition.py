"""The critical regions of a problem with quadratic costs: numbered as they are found, their programmes made on demand.

A region is the face of the feasible set on which the same rows are tight; its programme holds costs and rows in the face's own
coordinates, as kernels read them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import RLock
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.geometry.held_coordinates import held_coordinates
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.kernels.faces import place_on_face
from inscrutable.kernels.regions import UNKNOWN, Regions
from inscrutable.kernels.set_distance import Face
from inscrutable.problems import Polyhedron, QuadraticProblem
from inscrutable.validation import Array

_MOST_FLOATS = 1 << 26
"""The most floating-point numbers in stored programmes, half a gigabyte; beyond, all are deleted. With 90 actions and eight
states a region takes 30,000."""


class Partition:
    """The regions of a problem by number; `arrays` is what kernels read."""

    def __init__(self, problem: QuadraticProblem) -> None:
        region = problem.constraints
        self.problem, self._lock, self._searches = problem, RLock(), 0
        self._normals, self._sides = region.A_ub / region.row_scale[:, None], region.b_ub / region.row_scale
        self._observed = region.observed_slack
        self._bounds = tuple(np.ascontiguousarray(side) for side in problem.constraints.coordinate_bounds)
        self.forget()

    def __getstate__(self) -> dict[str, object]:
        """A lock cannot be pickled: another process makes its own."""
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state, _lock=RLock(), _searches=0)

    def forget(self) -> None:
        """Begin anew, with no region known."""
        n_rows = len(self.problem.constraints.b_ub)
        self._numbers: dict[bytes, int] = {}
        self._curves, self._rows, self._charts = _Flat(), _Flat(), _Flat()
        numbers, table, truths = np.empty(0, np.int64), np.empty((0, n_rows), np.int64), np.empty((0, n_rows), np.bool_)
        self._table = Regions(
            size=numbers, n_rows=numbers, n_set_rows=numbers, scale=np.empty(0), is_point=np.empty(0, np.bool_),
            curve_at=numbers, row_at=numbers, chart_at=numbers, curves=None, rows=None, charts=None, tight=truths,
            n_observable=numbers, observable=table, beyond=table, bounds=self._bounds,
        )  # fmt: skip

    @contextmanager
    def searched(self, patterns: np.ndarray) -> Iterator[None]:
        """Keep the numbers of regions fixed inside the block. On entry, where no other thread searches and the programmes take
        too much memory, all are deleted and the tight rows `patterns` (n,R) numbered anew."""
        with self._lock:
            if self._searches == 0 and self._curves.size + self._rows.size + self._charts.size > _MOST_FLOATS:
                self.forget()
                self.numbers(patterns)
            self._searches += 1
        try:
            yield
        finally:
            with self._lock:
                self._searches -= 1

    @property
    def count(self) -> int:
        """How many regions have a number."""
        return len(self._numbers)

    @property
    def arrays(self) -> Regions:
        """The regions as kernels read them. The sizes are a copy: a programme that another thread makes later stays UNKNOWN,
        because these flat arrays may not hold it."""
        with self._lock:
            return self._table._replace(
                size=self._table.size.copy(),
                curves=self._curves.values,
                rows=self._rows.values,
                charts=self._charts.values,
            )

    def holding(self, actions: Array) -> np.ndarray:
        """Return the numbers (n,) of the regions in which an observer finds decisions (n,U)."""
        return self.numbers(self._slacks(actions) < self._observed)

    def holding_some(self, actions: Array) -> tuple[np.ndarray, np.ndarray]:
        """Return the decision and the number of each region: those of `holding`, then, for decisions with a row slack by less
        than `min_slack`, the regions in which that row is loose."""
        slack = self._slacks(actions)
        seen, exact = slack < self._observed, slack <= tolerances.FEASIBILITY
        other = np.flatnonzero((seen != exact).any(axis=1))
        return np.concatenate([np.arange(len(actions)), other]), self.numbers(np.concatenate([seen, exact[other]]))

    def _slacks(self, actions: Array) -> Array:
        return np.asarray(self._sides - actions @ self._normals.T)

    def numbers(self, patterns: np.ndarray) -> np.ndarray:
        """Return the numbers of the regions with the tight rows `patterns` (n,R), new ones for new patterns."""
        with self._lock:
            found = np.empty(len(patterns), dtype=np.int64)
            for i, tight in enumerate(patterns):
                key = tight.tobytes()
                if key not in self._numbers:
                    if len(self._numbers) == len(self._table.size):
                        self._grow()
                    self._table.tight[len(self._numbers)] = tight
                    self._numbers[key] = len(self._numbers)
                found[i] = self._numbers[key]
            return found

    def _grow(self) -> None:
        """Make room for as many regions again; their numbers are UNKNOWN."""
        more = max(64, len(self._table.size))
        self._table = Regions(*(
            _longer(column, more, UNKNOWN if column.dtype == np.int64 else 0) if isinstance(column, np.ndarray) else column
            for column in self._table
        ))  # fmt: skip

    def make(self, numbers: np.ndarray) -> None:
        """Make the programmes of regions that have none yet."""
        with self._lock:
            table = self._table
            for number in sorted(set(numbers[table.size[numbers] == UNKNOWN].tolist())):
                face = face_programme(self.problem, table.tight[number].copy())
                table.size[number], table.n_rows[number] = face.span.shape[1], len(face.rows)
                table.n_set_rows[number], table.scale[number] = face.n_set_rows, face.scale
                table.is_point[number] = face.has_single_beliefs
                table.curve_at[number] = self._curves.append(face.curves)
                table.row_at[number] = self._rows.append(face.rows)
                table.chart_at[number] = self._charts.append(np.concatenate([face.origin, face.span.ravel()]))
                table.n_observable[number] = len(face.observable)
                table.observable[number, : len(face.observable)] = face.observable

    def reach(self, pairs: np.ndarray) -> None:
        """Make the regions beyond rows, given as pairs (n,2) of region and row."""
        with self._lock:
            for number, row in np.unique(pairs, axis=0):
                if self._table.beyond[number, row] == UNKNOWN:
                    other = self._table.tight[number].copy()
                    other[row] = not other[row]
                    beyond = self.numbers(other[None])[0]  # the table may grow
                    self._table.beyond[number, row], self._table.beyond[beyond, row] = beyond, number
                self.make(self._table.beyond[number, row : row + 1])


class _Flat:
    """Numbers end to end; room doubles as they are added."""

    def __init__(self) -> None:
        self.values, self.size = np.empty(1024), 0

    def append(self, added: Array) -> int:
        """Append numbers; return where they begin."""
        first, self.size = self.size, self.size + added.size
        if self.size > self.values.size:
            self.values = _longer(self.values, max(self.values.size, added.size), 0)
        self.values[first : self.size] = added.ravel()
        return first


def _longer(values: np.ndarray, more: int, fill: float) -> np.ndarray:
    return np.concatenate([values, np.full((more, *values.shape[1:]), fill, dtype=values.dtype)])


class FaceProgramme(NamedTuple):
    """Everything on the decisions u = origin + span v of a face; rows are ≥ 0, shape (m, X, k+1)."""

    tight: np.ndarray  # (n,) which inequality rows are tight
    origin: Array  # (U,)
    span: Array  # (U, k)
    curves: Array  # (X, k+1, k+1)
    rows: Array  # probabilities, multipliers, then slacks
    n_set_rows: int  # how many of them describe the consistent set
    scale: float  # size of the gradients
    bounds: tuple[Array, Array]  # (U,) values that single rows leave to coordinates
    observable: np.ndarray  # numbers of the tight rows that bind the consistent set: not those of mere copies

    @property
    def arrays(self) -> Face:
        """Costs and rows as kernels read them."""
        return Face(self.curves, self.rows, self.n_set_rows, self.scale)

    @property
    def has_single_beliefs(self) -> bool:
        """Whether almost every decision of the face is optimal for one belief: gradients of X states have rank X − 1."""
        n_states, k = len(self.curves), self.span.shape[1]
        if k < n_states - 1:
            return False
        somewhere = np.append(np.random.default_rng(0).normal(size=k), 1.0)
        apart = sum_zero_basis(n_states).T @ (self.curves[:, :k] @ somewhere)
        return bool(np.linalg.matrix_rank(apart, tol=tolerances.RANK * self.scale) == n_states - 1)

    def w(self, action: Array) -> Array:
        """Return (v, 1) for the coordinates v of the face's decision nearest to `action`."""
        return np.append(self.span.T @ (action - self.origin), 1.0)

    def action(self, place: Array) -> Array:
        """Return the decision (U,) at coordinates (k,); rounding beside a tight bound is removed."""
        found = np.empty(len(self.origin))
        place_on_face(self.origin, self.span, self.bounds, place, found)
        return found


def face_programme(problem: QuadraticProblem, tight: np.ndarray) -> FaceProgramme:
    """Return the face on which the inequality rows `tight` hold with equality.

    Cost: where tight rows are bounds and few others, products with the Hessians' rows of the free coordinates.
    """
    region, (n_states, size) = problem.constraints, problem.linear.shape
    chart = _chart(region, tight)
    origin, k = chart.origin, chart.span.shape[1]
    support = np.flatnonzero(origin)
    gradients = problem.linear + origin[support] @ problem.hessians[:, support]  # (X, U)
    field = np.empty((n_states, k + 1, size))  # gradients in the face's coordinates: the last row is the origin's
    field[:, :k], field[:, k] = chart.along(problem.hessians), gradients
    curves = np.empty((n_states, k + 1, k + 1))
    curves[:, :, :k] = chart.project(field)
    curves[:, :k, k] = curves[:, k, :k]
    curves[:, k, k] = (gradients + problem.linear) @ origin + 2.0 * problem.constants
    scale = max(float(np.abs(gradients).max()), np.finfo(float).tiny)
    multipliers = chart.multipliers(field).transpose(2, 0, 1)
    idle = problem.idle_rows[tight]
    if idle.any() and len(multipliers) == len(idle):
        multipliers = multipliers[~idle]
    loose = ~tight
    falling, lengths = region.A_ub[loose], region.row_scale[loose]
    n_set_rows = n_states + len(multipliers)
    rows = np.zeros((n_set_rows + len(falling), n_states, k + 1))
    rows[np.arange(n_states), np.arange(n_states), k] = 1.0
    np.divide(multipliers, scale, out=rows[n_states:n_set_rows])
    slacks = rows[n_set_rows:]
    slacks[:, :, :k] = -(chart.project(falling) / lengths[:, None])[:, None]
    slacks[:, :, k] = ((region.b_ub[loose] - falling @ origin) / lengths - region.played_slack)[:, None]
    if _contradict(region, tight, origin):  # opposite bounds, met halfway: the face is empty, so no row of it holds
        rows[:, :, :k], rows[:, :, k] = 0.0, -1.0
    observable = np.flatnonzero(tight & ~problem.idle_rows)
    return FaceProgramme(
        tight, origin, chart.span, curves, rows, n_set_rows, scale, region.coordinate_bounds, observable
    )


def _contradict(region: Polyhedron, tight: np.ndarray, origin: Array) -> bool:
    """Whether not even the point of least squares has the rows `tight` tight and the equalities met."""
    slacks = (region.b_ub[tight] - region.A_ub[tight] @ origin) / region.row_scale[tight]
    off = [slacks, (region.A_eq @ origin - region.b_eq) / np.abs(region.A_eq).max(axis=1)]
    return bool(np.abs(np.concatenate(off)).max(initial=0.0) > tolerances.FEASIBILITY * max(1.0, np.abs(origin).max()))


class _Chart(NamedTuple):
    """Coordinates of a face and the maps to them."""

    origin: Array  # (U,) the point of least norm among those with the held coordinates
    span: Array  # (U, k) orthonormal
    along: Callable[[Array], Array]  # (…,U,n) -> (…,k,n)
    project: Callable[[Array], Array]  # (…,U) -> (…,k)
    multipliers: Callable[[Array], Array]  # gradients (…,U) -> multipliers (…,m)


def _chart(region: Polyhedron, tight: np.ndarray) -> _Chart:
    active = region.A_ub[tight]
    face = held_coordinates(active, region.A_eq)
    if face is None:
        return _decomposed_chart(region, tight)
    lower, upper = region.coordinate_bounds
    point = np.zeros(active.shape[1])
    point[face.held] = np.where(face.signs > 0, upper[face.held], lower[face.held])
    point[face.fixed] = 0.5 * (lower[face.fixed] + upper[face.fixed])
    sides = np.concatenate([region.b_ub[tight][face.active], region.b_eq])
    return _Chart(face.nearest_point(point, sides), face.span(), face.along, face.project, face.multipliers)


def _decomposed_chart(region: Polyhedron, tight: np.ndarray) -> _Chart:
    """The chart for any rows, by singular value decompositions."""
    normals = np.vstack([region.A_ub[tight], region.A_eq])
    span = np.ascontiguousarray(region.directions(tight))
    origin = np.linalg.lstsq(normals, np.concatenate([region.b_ub[tight], region.b_eq]), rcond=None)[0]
    inequalities = region.stationarity(tight).inequalities
    return _Chart(
        origin, span, lambda M: span.T @ M, lambda stack: stack @ span, lambda gradients: gradients @ inequalities.T
    )
