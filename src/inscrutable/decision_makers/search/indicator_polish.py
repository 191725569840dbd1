"""From the cheapest candidate that meets a goal to a cheaper decision: toward the optimal one as far as the goal allows,
and around the belief in the cheapest direction. All beliefs of a block take each step together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.level_test import LevelTest
from inscrutable.decision_makers.indicators import Indicator
from inscrutable.geometry.crossings import Bracket, narrowed, side
from inscrutable.privacy import NonUniqueness
from inscrutable.validation import Array

_NEAR = 8.0 * tolerances.POLISH
_DIRECTIONS = 300
"""Looked at around a belief: without them 2 of 120 decisions that keep a distance of .01 pay up to 50 % more."""


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
    """The way from the optimal decision (0) to the one that meets the goal (1): by the decoys on the ray to a member, or
    straight on where no belief explains the decision."""

    def __init__(self, goal: Indicator, block: Block) -> None:
        self._goal, self._block = goal, block
        self._tests = [LevelTest(goal.problem, goal.margin) for _ in block.beliefs] if goal.compares_gaps else []

    def best(self) -> Array:
        """Return the decisions where the ways stop to meet the goal, or those of the block where these cost less."""
        block = self._block
        everyone = np.arange(len(block.beliefs))
        ends = self._bracket()
        values = Bracket(np.full(everyone.size, -np.inf), np.full(everyone.size, np.inf))
        shares = narrowed(lambda which, tried: side(self._meets(which, tried)), ends, values).inside
        found = self._trials(everyone, shares)
        keep = (shares == 1.0) | (self._regrets(everyone, found) > self._regrets(everyone, block.actions))
        for i in np.flatnonzero(~keep) if self._tests else ():
            keep[i] = not self._tests[i].reaches(found[i])
        found[keep] = block.actions[keep]
        return found

    def _bracket(self) -> Bracket:
        """Where each way is first known to meet and to miss the goal; a decoy is no farther from its set than itself, so
        nothing nearer than the goal's distance can meet it, and a little beyond it most do."""
        block, by_corners = self._block, self._goal.rule is NonUniqueness
        ends = Bracket(np.ones(len(block.beliefs)), np.zeros(len(block.beliefs)))
        away = block.members - block.beliefs
        length = np.abs(away).max(axis=1) if by_corners else np.sqrt((away**2).sum(axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            guess = self._goal.least / length
        hopeful = np.flatnonzero(block.explained & (guess < 1.0 - _NEAR))
        if hopeful.size:
            beyond = guess[hopeful] + _NEAR
            before = np.maximum(guess[hopeful] - _NEAR, 0.0)
            fits = self._meets(hopeful, beyond)
            fits &= (before == 0.0) | ~self._meets(hopeful, before)
            ends.inside[hopeful[fits]], ends.outside[hopeful[fits]] = beyond[fits], before[fits]
        return ends

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

    def _meets(self, which: np.ndarray, shares: Array) -> np.ndarray:
        trials = self._trials(which, shares)
        decoys = self._decoys(which, shares) if self._block.explained[which].all() else None
        meets = _admitted(self._goal, self._block.beliefs[which], trials, self._regrets(which, trials), decoys)
        for place in np.flatnonzero(meets) if self._tests else ():
            meets[place] = self._tests[which[place]].reaches(trials[place], proved=False)
        return meets


def _regrets(goal: Indicator, block: Block, actions: Array) -> Array:
    costs = (goal.problem.state_costs(actions) * block.beliefs).sum(axis=1)
    return np.asarray(np.maximum(costs - block.optimal_costs, 0.0))


def _admitted(
    goal: Indicator, beliefs: Array, actions: Array, regrets: Array, decoys: Array | None = None
) -> np.ndarray:
    admissible: np.ndarray = goal.problem.constraints.is_admissible(actions)
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
    # The optimal decision is known to miss the goal, and what costs more than the best is not wanted.
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
