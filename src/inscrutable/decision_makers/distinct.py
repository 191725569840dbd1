"""The distinct decisions among candidates, as scans read them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable.decision_makers.candidates import Candidates
from inscrutable.validation import Array

LARGER = 2


class Distinct(NamedTuple):
    """Admissible decisions, one of each kind, by rising number among the candidates."""

    number: np.ndarray  # (D,) which candidate each one is
    costs: Array  # (D,X) state costs
    start: Array  # (D,X) of the consistent set: a point, a segment's end, or a member
    along: Array  # (D,X) end − start
    kind: np.ndarray  # (D,) −1 nothing explains it, 0 a point, 1 a segment, 2 a larger set

    def pick(self, which: np.ndarray) -> Distinct:
        """Return some of them."""
        return Distinct(*(part[which] for part in self))


def distinct_of(candidates: Candidates) -> Distinct:
    """Return the distinct admissible candidates, found at first use and kept with them."""
    return candidates.once("distinct", lambda: _found(candidates))


def _found(candidates: Candidates) -> Distinct:
    sets = candidates.sets
    usable = np.flatnonzero(candidates.usable)
    first = np.full(len(candidates), -1)
    first[sets.distinct[usable][::-1]] = usable[::-1]  # of equal decisions the one that is written last, the first
    number = np.sort(first[first >= 0])
    costs, start, end = (np.ascontiguousarray(each[number]) for each in (candidates.state_costs, sets.start, sets.end))
    kind = np.minimum(sets.dimension[number], LARGER).astype(np.int64)
    return Distinct(number, costs, start, end - start, kind)
