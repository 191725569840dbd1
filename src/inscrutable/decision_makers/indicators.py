"""The cheapest decision that meets an indicator measure (a, b, c), a goal that is met or missed, for many beliefs in one pass.

Whether a candidate meets (a) does not depend on the belief; for (b) and (c) the ends of its consistent set decide.
So one scan per belief finds the cheapest candidate that does. Two searches then lower its regret: toward the optimal decision
as far as the goal allows, and around the belief in the cheapest direction. The beliefs of a block take each step together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import ConsistentSets, consistent_sets
from inscrutable.adversaries.plausibility import gap_compared, nearest_explanation
from inscrutable.decision_makers.candidates import Candidates, distinct_of
from inscrutable.errors import InputError
from inscrutable.geometry import BeliefSet
from inscrutable.geometry.crossings import Bracket, narrowed, side
from inscrutable.privacy import Infeasibility, NonExistence, NonUniqueness, PrivacyMeasure
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


def is_streamed(measure: PrivacyMeasure) -> bool:
    """Whether the measure is one of the three that the scan computes; a user's own measure is called set by set."""
    return type(measure) in (Infeasibility, NonUniqueness, NonExistence)


class Cheapest(NamedTuple):
    """For beliefs (T,X), the number of the cheapest decision in the table (−1: none) and its regret."""

    found: np.ndarray  # (T,)
    regrets: Array  # (T,)


class Indicator:
    """A measure for a problem: which decisions meet it under which belief. A user's own measure is called set by set."""

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
            met[t] = self.judges(beliefs[t], sets[int(t)])
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
        """Return the regret up to which a belief counts as consistent with a decision of state costs (…,X): a member of an
        ill-conditioned set may lie beside its computed ends, but the decision has no regret under it."""
        return np.asarray(tolerances.FEASIBILITY * np.abs(costs).max(axis=-1))

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

    def gap_reaches(self, action: Array) -> bool:
        """Return whether the plausibility gap of a decision (U,) reaches the margin."""
        return gap_compared(self.problem, action, self.margin) >= self.margin


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
        """Whether a decision that passes the scan meets the goal; answers that hold for all beliefs are kept."""
        if self._proved[d]:
            return True
        if self.goal.compares_gaps:
            self._proved[d] = self.goal.gap_reaches(self._sets.actions[self.number[d]])
            if not self._proved[d]:
                self._kind[d] = self._never
            return bool(self._proved[d])
        if self.goal.rule is NonExistence and regret <= self.goal.slack(self._arrays[0][d]) and self._kind[d] >= 0:
            return self.goal.judges(belief, self._sets[int(self.number[d])])
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


_DIRECTIONS = 100
"""Directions tried around a belief: without them 2 of 120 decisions that keep a distance of .01 pay up to 50 % more. With 300
or 900 none of 34 problems of 13 beliefs differs by 1e-4, in 1.2 and 1.6 times the time."""


class Block(NamedTuple):
    """Beliefs with their optimal decisions, and a decision of each that meets the goal, found among candidates."""

    beliefs: Array  # (n,X)
    optimal: Array  # (n,U)
    optimal_costs: Array  # (n,)
    members: Array  # (n,X): a belief that explains the decision
    explained: np.ndarray  # (n,): whether there is one
    actions: Array  # (n,U)

    def pick(self, which: np.ndarray) -> Block:
        """Return the part of some beliefs."""
        return Block(*(part[which] for part in self))


def cheaper(goal: Indicator, block: Block, members: Array | None) -> Array:
    """Return decisions (n,U) that meet the goal at no more regret than those of the block.

    `members` (M,X) are beliefs that explain candidates: directions in which to look.
    """
    actions = _Shortening(goal, block).best()
    if members is None:
        return actions
    around = np.flatnonzero(block.explained)
    if around.size:
        part = block.pick(around)._replace(actions=actions[around])
        actions[around] = _cheapest_direction(goal, part, members, goal.least * (1.0 + tolerances.SLACK_SAFETY))
    return actions


class _Shortening:
    """The path from the optimal decision (0) to the one that meets the goal (1): the decisions of decoys on the ray to a
    member, or a straight line where no belief explains the decision."""

    def __init__(self, goal: Indicator, block: Block) -> None:
        self._goal, self._block = goal, block

    def best(self) -> Array:
        """Return the last decisions on the paths that meet the goal, or those of the block where these cost less."""
        block = self._block
        everyone = np.arange(len(block.beliefs))
        ends = Bracket(np.ones(everyone.size), np.zeros(everyone.size))
        if self._goal.compares_gaps:
            lacking = self._lacking(block.actions, np.ones(everyone.size, dtype=bool))
            values = Bracket(np.minimum(lacking, 0.0), np.full(everyone.size, self._goal.margin))
        else:
            values = Bracket(side(everyone >= 0), side(everyone < 0))
        shares = narrowed(self._missed, ends, values).inside
        found = self._trials(everyone, shares)
        keep = (shares == 1.0) | (self._regrets(everyone, found) > self._regrets(everyone, block.actions))
        found[keep] = block.actions[keep]
        return found

    def _trials(self, which: np.ndarray, shares: Array) -> Array:
        part = self._block.pick(which)
        trials: Array = part.optimal + shares[:, None] * (part.actions - part.optimal)
        if part.explained.any():
            trials[part.explained] = self._goal.problem.solve_points(self._decoys(which, shares)[part.explained])
        return trials

    def _decoys(self, which: np.ndarray, shares: Array) -> Array:
        part = self._block.pick(which)
        return np.asarray(part.beliefs + shares[:, None] * (part.members - part.beliefs))

    def _regrets(self, which: np.ndarray, actions: Array) -> Array:
        return _regrets(self._goal, self._block.pick(which), actions)

    def _missed(self, which: np.ndarray, shares: Array) -> Array:
        """At most 0 where the trials meet the goal: what their gaps lack to a margin, or the side alone."""
        trials = self._trials(which, shares)
        decoys = self._decoys(which, shares) if self._block.explained[which].all() else None
        meets = _admitted(self._goal, self._block.beliefs[which], trials, self._regrets(which, trials), decoys)
        return self._lacking(trials, meets) if self._goal.compares_gaps else side(meets)

    def _lacking(self, trials: Array, unexplained: np.ndarray) -> Array:
        """The margin less the plausibility gaps of trials (n,U)."""
        lacking = np.full(len(trials), self._goal.margin)
        for place in np.flatnonzero(unexplained):
            lacking[place] -= nearest_explanation(self._goal.problem, trials[place])[1]
        return lacking


def _regrets(goal: Indicator, block: Block, actions: Array) -> Array:
    costs = (goal.problem.state_costs(actions) * block.beliefs).sum(axis=1)
    return np.asarray(np.maximum(costs - block.optimal_costs, 0.0))


def _admitted(
    goal: Indicator, beliefs: Array, actions: Array, regrets: Array, decoys: Array | None = None
) -> np.ndarray:
    admissible: np.ndarray = goal.problem.is_admissible(actions)
    return np.asarray(admissible & goal.met_by(beliefs, actions, regrets, decoys))


def _cheapest_direction(goal: Indicator, block: Block, members: Array, radius: float) -> Array:
    """Return the cheapest of the decisions for decoys at the goal's distance, in directions of `members`, and the block's."""
    directions = [_spread_directions(members, belief, radius) for belief in block.beliefs]
    of = np.repeat(np.arange(len(directions)), list(map(len, directions)))
    if not of.size:
        return block.actions
    decoys = block.beliefs[of] + radius * np.concatenate(directions)
    tried = goal.problem.solve_points(decoys)
    regrets = _regrets(goal, block.pick(of), tried)
    # The optimal decision misses the goal, and what costs more than the best is of no use.
    own = np.abs(tried - block.optimal[of]).max(axis=1) <= tolerances.SAME_ACTION
    regrets[own | (regrets > _regrets(goal, block, block.actions)[of])] = np.inf
    queues = []
    for t in range(len(block.beliefs)):
        place = np.flatnonzero((of == t) & np.isfinite(regrets))
        queues.append(place[np.argsort(regrets[place], kind="stable")])
    best = block.actions.copy()
    taken, width = 0, 1
    while any(len(queue) > taken for queue in queues):
        looked = [queue[taken : taken + width] for queue in queues]
        chosen = np.concatenate(looked)
        meets = _admitted(goal, block.beliefs[of[chosen]], tried[chosen], regrets[chosen], decoys[chosen])
        for t in np.unique(of[chosen[meets]]):
            best[t] = tried[chosen[meets & (of[chosen] == t)][0]]
            queues[t] = queues[t][:0]
        taken, width = taken + width, 4 * width
    return best


def _spread_directions(members: Array, belief: Array, radius: float) -> Array:
    """Return unit vectors from a belief toward members farther than a radius, `_DIRECTIONS` at most, evenly spread."""
    away = members - belief
    length = np.linalg.norm(away, axis=1)
    far = np.flatnonzero(length > radius)
    if far.size > _DIRECTIONS:
        far = far[np.linspace(0, far.size - 1, _DIRECTIONS).astype(np.int64)]
    return np.asarray(away[far] / length[far, None])
