"""Decisions under a family of costs with one unknown parameter: which values explain every one of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.stationarity_programme import Conditions, Programme, conditions_of
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array

Family = Callable[[float], DecisionProblem]

_PIECES = 16
_FINEST = 256
_MOST_KEPT = 4096
"""Costs remembered, and a multiple of the pieces an interval is cut into."""


class ExplainedDecisions:
    """Decisions (T,U), known to ±`rounding`, that one cost of the family has to explain, each by a belief of its own."""

    def __init__(self, family: Family, actions: Array, rounding: float, tolerance: float) -> None:
        self._actions, self._rounding = actions, rounding
        self.tolerance = tolerance + tolerances.LINEAR_PROGRAMME
        self._order = list(range(len(actions)))

        @lru_cache(maxsize=_MOST_KEPT)
        def conditions(parameter: float) -> list[Conditions]:
            return conditions_of(checked_problem(family(parameter)), actions, rounding)

        self._conditions = conditions

    def programme(self, low: float, high: float, number: int) -> Programme:
        """Return the programme of one decision for parameters between two."""
        return Programme(self._conditions(low)[number], self._conditions(high)[number])

    def residual(self, parameter: float) -> float:
        """Return the largest of the decisions' least residuals under one cost."""
        return max(self.programme(parameter, parameter, number).residual() for number in self._order)

    def is_possible(self, low: float, high: float) -> bool:
        """Return whether no decision rules out all parameters between two; the last to do so is asked first."""
        for place, number in enumerate(self._order):
            if self.programme(low, high, number).residual() > self.tolerance:
                self._order.insert(0, self._order.pop(place))
                return False
        return True

    def intervals(self, low: float, high: float) -> Array:
        """Return intervals (K,2) outside of which no parameter explains every decision, by branching on the parameter.

        A piece is dropped where even the relaxed conditions fail, kept where both its ends explain everything, and halved
        otherwise, until it is small beside the interval it belongs to or beside the parameter itself.
        """
        ends = _spaced(low, high, _PIECES).tolist()
        kept: list[tuple[float, float]] = []
        open_pieces = [piece for piece in pairwise(ends) if self.is_possible(*piece)]
        while open_pieces:
            still = []
            for piece in open_pieces:
                if self.is_possible(piece[0], piece[0]) and self.is_possible(piece[1], piece[1]):
                    kept.append(piece)
                else:
                    still.append(piece)
            clusters = _merged([*kept, *still])
            fine = [piece for piece in still if _is_fine(piece, clusters)]
            kept += fine
            halves = [half for piece in still if piece not in fine for half in _halved(piece)]
            open_pieces = [half for half in halves if self.is_possible(*half)]
        return _merged(kept)


def pieces_of(intervals: Array) -> list[tuple[float, float]]:
    """Return the intervals (K,2) cut into pieces on which a relaxation is tight."""
    found: list[tuple[float, float]] = []
    for low, high in intervals:
        ends = _spaced(low, high, _PIECES).tolist() if high > low else [low, high]
        found += list(pairwise(ends))
    return found


def _spaced(low: float, high: float, count: int) -> Array:
    ends = np.geomspace(low, high, count + 1) if low > 0 else np.linspace(low, high, count + 1)
    ends[0], ends[-1] = low, high
    return np.asarray(ends)


def _halved(piece: tuple[float, float]) -> list[tuple[float, float]]:
    low, high = piece
    middle = float(np.sqrt(low * high)) if low > 0 else 0.5 * (low + high)
    return [(low, middle), (middle, high)]


def _merged(pieces: list[tuple[float, float]]) -> Array:
    """Pieces that touch as one, shape (K,2)."""
    found: list[list[float]] = []
    for low, high in sorted(pieces):
        if found and low <= found[-1][1]:
            found[-1][1] = max(found[-1][1], high)
        else:
            found.append([low, high])
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def _is_fine(piece: tuple[float, float], clusters: Array) -> bool:
    low, high = piece
    own = clusters[(clusters[:, 0] <= low) & (high <= clusters[:, 1])][0]
    size = max(abs(low), abs(high))
    return bool(high - low <= max((own[1] - own[0]) / _FINEST, tolerances.PARAMETER * size))
