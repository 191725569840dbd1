"""What a search for one belief works on."""

from __future__ import annotations

from typing import NamedTuple

from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class Goal(NamedTuple):
    """What a search works on: a problem, a belief, an allowed regret and a distance to grow or shrink."""

    problem: DecisionProblem
    belief: Array
    limit: float
    reference: Reference
    optimal_cost: float
