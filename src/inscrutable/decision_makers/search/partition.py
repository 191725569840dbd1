"""The critical regions of a problem with quadratic costs: numbered as they are met, their programmes made when asked for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

import numpy as np

from inscrutable.decision_makers.search.faces import FaceProgramme, face_programme
from inscrutable.kernels.regions import UNKNOWN, Regions
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array

_MOST_FLOATS = 1 << 26
"""Numbers kept of programmes, half a gigabyte; beyond, a search begins again with none. Ninety actions and eight states take
30,000 a region."""


class Partition:
    """The regions of a problem by number; `arrays` is what kernels read."""

    def __init__(self, problem: QuadraticProblem) -> None:
        self.problem, self._lock, self._searches = problem, RLock(), 0
        self._bounds = tuple(np.ascontiguousarray(side) for side in problem.constraints.coordinate_bounds)
        self.forget()

    def __getstate__(self) -> dict[str, object]:
        """Another process makes its own lock."""
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state, _lock=RLock(), _searches=0)

    def forget(self) -> None:
        """Begin anew, with no region known."""
        n_rows = len(self.problem.constraints.b_ub)
        self._numbers: dict[bytes, int] = {}
        self._programmes: dict[int, FaceProgramme] = {}
        self._columns = [np.empty(0, dtype=np.int64) for _ in range(7)]
        self._scale, self._is_point = np.empty(0), np.empty(0, dtype=np.bool_)
        self._tight = np.empty((0, n_rows), dtype=np.bool_)
        self._told, self._beyond = (np.empty((0, n_rows), dtype=np.int64) for _ in range(2))
        self._flat = [_Flat() for _ in range(3)]

    @contextmanager
    def searched(self, patterns: np.ndarray) -> Iterator[None]:
        """Inside, numbers of regions stay what they are. Before, where no other thread searches and the programmes take more
        memory than is meant for them, all are forgotten, and `patterns` (n,R) numbered anew."""
        with self._lock:
            if self._searches == 0 and sum(flat.size for flat in self._flat) > _MOST_FLOATS:
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
        """All regions as kernels read them."""
        with self._lock:
            size, n_rows, n_set_rows, curve_at, row_at, chart_at, n_told = self._columns
            curves, rows, charts = (flat.values for flat in self._flat)
            return Regions(
                size, n_rows, n_set_rows, self._scale, self._is_point, curve_at, row_at, chart_at, curves, rows, charts,
                self._tight, n_told, self._told, self._beyond, self._bounds,
            )  # fmt: skip

    def numbers(self, patterns: np.ndarray) -> np.ndarray:
        """Return the numbers of the regions with the tight rows `patterns` (n,R), new ones for new patterns."""
        with self._lock:
            found = np.empty(len(patterns), dtype=np.int64)
            for i, tight in enumerate(patterns):
                key = tight.tobytes()
                number = self._numbers.setdefault(key, len(self._numbers))
                if number == len(self._scale):
                    self._grow()
                if number == len(self._numbers) - 1:
                    self._tight[number] = tight
                found[i] = number
            return found

    def _grow(self) -> None:
        more = max(64, len(self._scale))
        self._columns = [_longer(column, more, UNKNOWN) for column in self._columns]
        self._scale, self._is_point = _longer(self._scale, more, 0), _longer(self._is_point, more, 0)
        self._tight = _longer(self._tight, more, 0)
        self._told, self._beyond = _longer(self._told, more, UNKNOWN), _longer(self._beyond, more, UNKNOWN)

    def programme(self, number: int) -> FaceProgramme:
        """Return the programme of a region."""
        self.make(np.array([number]))
        return self._programmes[number]

    def make(self, numbers: np.ndarray) -> None:
        """Make the programmes of regions that have none yet."""
        with self._lock:
            for number in sorted(set(numbers[self._columns[0][numbers] == UNKNOWN].tolist())):
                face = face_programme(self.problem, self._tight[number].copy())
                self._programmes[int(number)] = face
                places = [flat.size for flat in self._flat]
                chart = np.concatenate([face.origin, face.span.ravel()])
                for flat, values in zip(self._flat, (face.curves.ravel(), face.rows.ravel(), chart), strict=True):
                    flat.append(values)
                row = (len(face.place), len(face.rows), face.n_set_rows, *places, len(face.told))
                for column, value in zip(self._columns, row, strict=True):
                    column[number] = value
                self._scale[number], self._is_point[number] = face.scale, face.has_single_beliefs
                self._told[number, : len(face.told)] = face.told

    def reach(self, pairs: np.ndarray) -> None:
        """Make the regions beyond rows, given as pairs (n,2) of region and row."""
        with self._lock:
            for number, row in np.unique(pairs, axis=0):
                if self._beyond[number, row] == UNKNOWN:
                    other = self._tight[number].copy()
                    other[row] = not other[row]
                    beyond = self.numbers(other[None])[0]
                    self._beyond[number, row], self._beyond[beyond, row] = beyond, number
                self.make(self._beyond[number, row : row + 1])


class _Flat:
    """Numbers end to end; room doubles as they are added."""

    def __init__(self) -> None:
        self.values, self.size = np.empty(1024), 0

    def append(self, added: Array) -> None:
        """Add numbers behind the last."""
        if self.size + added.size > self.values.size:
            self.values = _longer(self.values, max(self.values.size, added.size), 0)
        self.values[self.size : self.size + added.size] = added
        self.size += added.size


def _longer(values: np.ndarray, more: int, fill: float) -> np.ndarray:
    return np.concatenate([values, np.full((more, *values.shape[1:]), fill, dtype=values.dtype)])
