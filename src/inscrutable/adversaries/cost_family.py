"""Decisions under costs with one unknown parameter: the parameter values that explain all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries.stationarity_programme import Conditions, Programme, conditions_of
from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array

Family = Callable[[float], DecisionProblem]

Piece = tuple[float, float]

_PIECES, _FINEST = 16, 256
"""Pieces of the bounds at the start, and accuracy of an interval's ends as a share of it. With 5 and 48 pieces intervals of 30
learned costs move within this accuracy, in .9 and 1.5 times the time; with a third of the accuracy they grow by up to .7 %,
with three times the accuracy they take as long."""
_MOST_KEPT = 4096  # costs remembered, a limit of memory: these 30 take less than 1,400


class CostFamily:
    """Decision problems with one unknown parameter between two bounds, as `CostLearningAdversary` takes them."""

    def __init__(self, problem_of: Family, bounds: Sequence[float], tolerance: float) -> None:
        if not callable(problem_of):
            raise InputError(f"family must give a decision problem for a number, got {problem_of!r}")
        limits = validation.finite_array(bounds, "bounds", ndim=1)
        if limits.shape != (2,) or not limits[0] < limits[1]:
            raise InputError(f"bounds must be two ascending numbers, got {limits.tolist()}")
        self.problem_of = problem_of
        self.bounds = float(limits[0]), float(limits[1])
        self.tolerance = validation.positive(tolerance, "tolerance")
        self.problem = checked_problem(problem_of(self.bounds[0]))

    def explained(self, actions: ArrayLike, rounding: float) -> ExplainedDecisions:
        """Return the decisions (T,U); raise `InputError` where one violates the feasible set by more than its rounding."""
        return ExplainedDecisions(self.problem_of, self._checked(actions, rounding), rounding, self.tolerance)

    def _checked(self, actions: ArrayLike, rounding: float) -> Array:
        problem = self.problem
        if not rounding:
            points = np.atleast_2d(problem.check_actions(actions))
        else:
            points = np.atleast_2d(validation.finite_array(problem.as_points(actions), "actions", ndim=(1, 2)))
            region = problem.constraints.in_decision
            for rows, sides, both in ((region.A_ub, region.b_ub, False), (region.A_eq, region.b_eq, True)):
                off = points @ rows.T - sides
                beyond = (np.abs(off) if both else off) - rounding * np.abs(rows).sum(axis=1)
                bad = np.argwhere(beyond > tolerances.FEASIBILITY * np.maximum(1.0, np.abs(rows).max(initial=0.0)))
                if bad.size:
                    raise InputError(f"action row {bad[0][0]} is outside the feasible set by more than its rounding")
        if not len(points):
            raise InputError("actions has no rows; expected at least one decision")
        if problem.explaining_rows(points[0]) is not None:
            raise InputError(f"costs without gradients cannot be learned: {problem!r}")
        return points


class ExplainedDecisions:
    """Decisions (T,U), known to ±`rounding`, that one cost of the family must explain, each with its own belief."""

    def __init__(self, family: Family, actions: Array, rounding: float, tolerance: float) -> None:
        self._made_of = family, actions, rounding, tolerance
        self.tolerance = tolerance + tolerances.LINEAR_PROGRAMME
        self.count = len(actions)

        @lru_cache(maxsize=_MOST_KEPT)
        def conditions(parameter: float) -> list[Conditions]:
            return conditions_of(checked_problem(family(parameter)), actions, rounding)

        self._conditions = conditions

    def __reduce__(self) -> tuple[object, ...]:
        """The conditions remembered cannot be pickled: a copy finds its own."""
        return type(self), self._made_of

    def programme(self, low: float, high: float, number: int) -> Programme:
        """Return the programme of one decision for the parameters in an interval."""
        return Programme(self._conditions(low)[number], self._conditions(high)[number])

    def residual(self, parameter: float) -> float:
        """Return the largest, over decisions, of the least residual under one cost."""
        return max(self.programme(parameter, parameter, number).residual() for number in range(self.count))

    def intervals(self, low: float, high: float) -> Array:
        """Return intervals (K,2) outside of which no parameter explains every decision.

        Decisions cut the intervals one after another; a second round refines ends that were small beside the interval of an
        earlier decision.
        """
        whole = _length(low, high)
        found = np.array([[low, high]])
        freest_first = np.argsort([each.normals.shape[1] for each in self._conditions(low)], kind="stable")
        for number in (*freest_first, *freest_first):
            left: list[Piece] = []
            for first, last in found.tolist():
                count = int(np.ceil(_PIECES * _length(first, last) / whole))
                left += self._explaining(int(number), _spaced(first, last, count))
            found = _merged(left)
        return found

    def _explaining(self, number: int, ends: list[float]) -> list[Piece]:
        """Return the pieces that contain every parameter between the ends that explains one decision, by bisection.

        A piece is kept where both its ends explain the decision, dropped where the relaxed conditions fail, and halved
        otherwise, until it is small relative to its interval or to the parameter.
        """

        @cache
        def holds(parameter: float) -> bool:
            return self.programme(parameter, parameter, number).explains(self.tolerance)

        kept: list[Piece] = []
        waiting = list(pairwise(ends))
        while waiting:
            still: list[Piece] = []
            for piece in waiting:
                if holds(piece[0]) and holds(piece[1]):
                    kept.append(piece)
                elif self.programme(*piece, number).explains(self.tolerance):
                    still.append(piece)
            clusters = _merged([*kept, *still])
            fine = [_is_fine(piece, clusters) for piece in still]
            kept += [piece for piece, done in zip(still, fine, strict=True) if done]
            waiting = [half for piece, done in zip(still, fine, strict=True) if not done for half in _halved(piece)]
        return kept


def pieces_of(intervals: Array) -> list[Piece]:
    """Return the intervals (K,2) cut into pieces on which the relaxation is tight."""
    found: list[Piece] = []
    for low, high in intervals:
        found += list(pairwise(_spaced(low, high, _PIECES)))
    return found


def _spaced(low: float, high: float, count: int) -> list[float]:
    """Return the ends of pieces: of equal ratio where the parameter is positive, else of equal length."""
    if not high - low > tolerances.PARAMETER * max(abs(low), abs(high)):
        return [low, high]
    inner = np.geomspace(low, high, count + 1) if low > 0 else np.linspace(low, high, count + 1)
    return [low, *inner[1:-1].tolist(), high]


def _length(low: float, high: float) -> float:
    return float(np.log(high / low)) if low > 0 else high - low


def _halved(piece: Piece) -> list[Piece]:
    low, high = piece
    middle = float(np.sqrt(low * high)) if low > 0 else 0.5 * (low + high)
    return [(low, middle), (middle, high)]


def _merged(pieces: list[Piece]) -> Array:
    """Merge adjacent pieces, shape (K,2)."""
    found: list[list[float]] = []
    for low, high in sorted(pieces):
        if found and low <= found[-1][1]:
            found[-1][1] = max(found[-1][1], high)
        else:
            found.append([low, high])
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def _is_fine(piece: Piece, clusters: Array) -> bool:
    low, high = piece
    own = clusters[(clusters[:, 0] <= low) & (high <= clusters[:, 1])][0]
    size = max(abs(low), abs(high))
    narrow = high - low <= tolerances.PARAMETER * size
    # Halve like `_spaced`: by ratio where the parameter is positive, so that both ends have the same relative accuracy.
    return bool(narrow or _length(low, high) <= _length(*own) / _FINEST)
