"""Goals that are met or missed (measures a, b, c): the cheapest decision that meets one, for many beliefs in one pass.

Whether a candidate meets (a) does not depend on the belief, for (b) and (c) it is read off the ends of its consistent set.
So one scan per belief finds the cheapest candidate that does, and `indicator_polish` makes it cheaper still.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import ConsistentSets, consistent_sets
from inscrutable.adversaries.level_test import LevelTest
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.distinct import distinct_of
from inscrutable.errors import InputError
from inscrutable.geometry import BeliefSet
from inscrutable.privacy import Infeasibility, NonExistence, NonUniqueness, PrivacyMeasure
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


def is_streamed(measure: PrivacyMeasure) -> bool:
    """Whether the measure is one of the three that the scan knows; a user's own goal is judged set by set."""
    return type(measure) in (Infeasibility, NonUniqueness, NonExistence)


class Cheapest(NamedTuple):
    """For beliefs (T,X), the number of the cheapest decision in the table (−1: none) and its regret."""

    found: np.ndarray  # (T,)
    regrets: Array  # (T,)


class Indicator:
    """A measure for a problem: which decisions meet it under which belief. A user's own judges set by set."""

    def __init__(self, problem: DecisionProblem, measure: PrivacyMeasure, on_empty: str = "exclude") -> None:
        self.problem, self.measure = problem, measure
        self.rule = type(measure) if is_streamed(measure) else None
        self._judges_empty = measure.judges_empty or on_empty != "exclude"
        self.margin = measure.margin if isinstance(measure, Infeasibility) else 0.0
        distance = measure.least_distance()
        self.least = tolerances.SAME_BELIEF if distance is None else distance

    def met_by(self, beliefs: Array, actions: Array, regrets: Array, members: Array | None = None) -> np.ndarray:
        """Return whether decisions (n,U) of known regret meet the goal under beliefs (n,X), one by one; gaps of
        unexplained ones are not compared. `members` (n,X) are beliefs that they are optimal for, where known."""
        sets = consistent_sets(self.problem, actions, members if self.rule is NonExistence else None)
        if self.rule is Infeasibility:
            return np.asarray(sets.dimension < 0)
        if self.rule is NonUniqueness:
            return self._by_corners(beliefs, sets)
        if self.rule is None:
            return np.array([self.judges(belief, sets[t]) for t, belief in enumerate(beliefs)], dtype=bool)
        met = np.asarray(sets.bounds(beliefs) >= self.least)
        close = regrets <= self.slack(self.problem.state_costs(actions))
        for t in np.flatnonzero(met & ((sets.dimension >= 2) | (close & (sets.dimension >= 0)))):
            met[t] = self.is_far(beliefs[t], sets[int(t)])
        return met

    def judges(self, belief: Array, found: BeliefSet) -> bool:
        """Return whether the measure itself says that a set meets the goal."""
        if found.is_empty and not self._judges_empty:
            return False
        privacy = self.measure(belief, found)
        if np.isnan(privacy):
            raise InputError(f"{self.measure!r} is NaN for {found!r}; a measure must give a number, −inf or inf")
        return bool(privacy == 0.0)

    def slack(self, costs: Array) -> Array:
        """Return the regret up to which a belief may be a member of a decision of state costs (…,X): one of an
        ill-conditioned set may lie beside the ends that are known of it, but it leaves no regret."""
        return np.asarray(tolerances.FEASIBILITY * np.abs(costs).max(axis=-1))

    def is_far(self, belief: Array, found: BeliefSet) -> bool:
        """Return whether a set keeps the distance; projections decide, and the described set where they are close to it."""
        least, greatest = found.rough_distances(belief)
        if greatest < self.least - tolerances.ROUGH_DISTANCE:
            return False
        return least > self.least + tolerances.ROUGH_DISTANCE or self.measure(belief, found) == 0.0

    def _by_corners(self, beliefs: Array, sets: ConsistentSets) -> np.ndarray:
        apart = np.maximum(np.abs(sets.start - beliefs).max(axis=1), np.abs(sets.end - beliefs).max(axis=1))
        met = (sets.dimension >= 0) & (apart > self.least)
        for t in np.flatnonzero(sets.dimension >= 2):
            met[t] = self.measure(beliefs[t], sets[int(t)]) == 0.0
        return np.asarray(met)

    @property
    def compares_gaps(self) -> bool:
        """Whether an unexplained decision must also miss every explanation by a margin."""
        return self.rule is Infeasibility and self.margin > 0.0


class IndicatorTable:
    """The distinct admissible candidates that can meet a goal, as the scan reads them; `number` says which each one is."""

    def __init__(self, goal: Indicator, candidates: Candidates) -> None:
        from inscrutable.kernels import indicators as kernel

        sets, table = candidates.sets, distinct_of(candidates)
        if goal.rule is Infeasibility:
            table = table.pick(np.flatnonzero(table.kind < 0))
        self.goal, self._sets, self.number = goal, sets, table.number
        self._arrays = table.costs, table.start, table.along
        self._never, self._larger = kernel.NEVER, kernel.LARGER
        self._kind = (
            np.full(len(table.kind), self._larger, table.kind.dtype) if goal.rule is None else table.kind.copy()
        )
        self._proved = np.zeros(len(self.number), dtype=bool)
        self._scan = kernel.cheapest_that_meet
        rules: dict[type | None, int] = {Infeasibility: kernel.BY_EMPTINESS, NonExistence: kernel.BY_DISTANCE}
        self.starts = sets.start[sets.dimension >= 0] if goal.measure.least_distance() is not None else None
        self._rule = rules.get(goal.rule, kernel.BY_CORNERS), goal.least

    def cheapest(self, beliefs: Array, optimal_costs: Array, limits: Array) -> Cheapest:
        """Return the cheapest candidates that meet the goal under beliefs (T,X) at regrets of at most `limits` (T,)."""
        count = len(beliefs)
        answer = Cheapest(np.full(count, -1), np.full(count, np.inf))
        floors = np.full(count, -1.0)
        left = np.arange(count)
        while left.size:
            found, regrets = answer.found[left], np.empty(left.size)
            asked = (beliefs[left], optimal_costs[left], limits[left], floors[left])
            self._scan(self._arrays, self._kind, self._rule, asked, (found, regrets))
            answer.found[left], answer.regrets[left], floors[left] = found, regrets, regrets
            again = zip(left, found, regrets, strict=True)
            left = left[[d >= 0 and not self._holds(beliefs[t], int(d), float(regret)) for t, d, regret in again]]
        return answer

    def _holds(self, belief: Array, d: int, regret: float) -> bool:
        """Whether a decision that the scan takes for one that meets the goal does; what is true for all beliefs is kept."""
        if self._proved[d]:
            return True
        if self.goal.compares_gaps:
            # A test of its own for each, so that the answer does not depend on who asks first.
            test = LevelTest(self.goal.problem, self.goal.margin)
            self._proved[d] = test.reaches(self._sets.actions[self.number[d]])
            if not self._proved[d]:
                self._kind[d] = self._never
            return bool(self._proved[d])
        if self.goal.rule is NonExistence and regret <= self.goal.slack(self._arrays[0][d]) and self._kind[d] >= 0:
            return self.goal.is_far(belief, self._sets[int(self.number[d])])
        if self._kind[d] < self._larger:
            return True
        return self.goal.judges(belief, self._sets[int(self.number[d])])


def table_of(
    problem: DecisionProblem, measure: PrivacyMeasure, candidates: Candidates, on_empty: str = "exclude"
) -> IndicatorTable:
    """Return the table of a goal; that of a known one is kept with the candidates."""
    goal = Indicator(problem, measure, on_empty)
    if goal.rule is None:
        return IndicatorTable(goal, candidates)
    return candidates.once((goal.rule, goal.margin), lambda: IndicatorTable(goal, candidates))
