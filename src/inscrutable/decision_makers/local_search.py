"""The paper's method: a local solver over the decision, from random affordable starts."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.optimize import minimize

from inscrutable import validation
from inscrutable.decision_makers.candidate_sources import random_actions
from inscrutable.decision_makers.search.goal import Goal, Judgement
from inscrutable.geometry.crossings import first_met
from inscrutable.kernels.calls import one_blas_thread
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_TRIES_A_START, _BLOCK = 200, 16
"""Random decisions among which a start is looked for, and how many are judged at once. Of 40 problems over two to five states,
two have fewer starts with 60, and two have more with 600, in 1.3 times the time. With five or 48 at once all take as long, one
by one twice as long, all at once up to 1.5 times."""
_UNEXPLAINED = 2.0
"""Loss of a trial that no belief explains, above the largest: of 50 problems with at most as many assets as states, one loses
two of three starts with 0 or 6; with .7, five gain and five lose up to 2 %."""
_STEP = 2.0**-30
"""Starts lie on multiples of this share of the way to the budget's end: the solver's answer may depend on the last digits of
its start, and these must not depend on the root finder."""
_ACCURACY = 2.0**-45
"""Accuracy of these ends: one in thirty thousand is rounded to another multiple."""
_DIFFERENCE = float(np.sqrt(np.finfo(float).eps))
"""Step of forward differences. With a fifth of it, 10 of these 50 lose up to 1.2 % and two gain a start; with three times as
much six gain up to 2 %."""


@dataclass(frozen=True)
class LocalSearch:
    """The paper's solver: SLSQP over the decision, from random affordable starts, which finds local optima.

    A start is drawn uniformly from the feasible set and moved toward the optimal decision until it is affordable; starts
    that no belief explains are drawn again, because the privacy there is undefined. Trials that no belief explains
    are penalised, and the best admissible, affordable, explained trial is returned.

    Args:
        n_starts: Number of starts, at least 1.
        rng: Source of the starts.

    Raises:
        InputError: `n_starts` is not a whole number of at least 1, or `rng` is not a generator.

    Cost: some hundred evaluations of the privacy per start. Source: the paper, eq. (8) and Section V.

    Example:
        >>> LocalSearch(n_starts=3, rng=np.random.default_rng(0)).n_starts
        3
    """

    n_starts: int = 1
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0), repr=False)

    def __post_init__(self) -> None:
        validation.count(self.n_starts, "n_starts")
        validation.generator(self.rng)


class _Search:
    """The searches for one belief: what they may do, and how decisions are judged."""

    def __init__(self, problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, limit: float) -> None:
        self.optimal = np.asarray(problem.solve(belief))
        self.goal = Goal(problem, belief, limit, float(problem.state_costs(self.optimal) @ belief), measure)
        self.free = problem.constraints.directions()

    def judged(self, actions: Array) -> Judgement:
        """Judge trials (n,U): explained ones alone, unless decisions that no belief explains are sought.

        Near the optimal decision most decisions are explained by no belief. They would hide nothing from an observer who
        allows for rounding.
        """
        return self.goal.judged(actions, explained=not self.goal.measure.searches_actions)

    def slope(self, action: Array) -> Array:
        """The gradient (U,) of the expected cost at a trial; zero where that is not finite."""
        if not np.isfinite(action).all():
            return np.zeros(action.size)
        return np.asarray(self.goal.belief @ self.goal.problem.cost_gradients(action))


class _Watched:
    """The objective of the local solver from one start; remembers the best trial that may be played."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.best: Array | None = None
        self.best_key = (-np.inf, -np.inf)
        self.worst = 0.0

    def losses(self, actions: Array, found: Judgement) -> tuple[list[float], float]:
        """Minus the privacies of trials (n,U), and the first one's excess; remembers the best admissible affordable one."""
        excess = [regret - self.limit for regret in found.regrets.tolist()]
        losses = (-found.privacies).tolist()
        for index, playable in enumerate(found.admissible.tolist()):
            if losses[index] == np.inf:
                continue
            self.worst = max(self.worst, losses[index])
            key = (-losses[index], -excess[index])
            if playable and excess[index] <= 0 and key > self.best_key:
                self.best, self.best_key = actions[index].copy(), key
        # Where no belief explains a trial its loss is above that of every belief, so that the solver turns back.
        turned = [self.worst + _UNEXPLAINED if loss == np.inf else loss for loss in losses]
        return turned, excess[0]


def search_locally(
    problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, limit: float, method: LocalSearch
) -> Array | None:
    """Return the best decision found, or None where no start was affordable and explained."""
    search = _Search(problem, belief, measure, limit)
    best = max(_searched(search, method), key=lambda watched: watched.best_key).best
    return best if best is None or not measure.is_indicator else _cheaper(search, best)


def privacies_by_start(
    problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, limit: float, method: LocalSearch
) -> Array:
    """Return the privacy that each start alone leads to, shape (n_starts,), of a measure that is no indicator; −∞ for a
    start that was not affordable and explained."""
    found = _searched(_Search(problem, belief, measure, limit), method)
    return np.array([watched.best_key[0] for watched in found])


def _searched(search: _Search, method: LocalSearch) -> list[_Watched]:
    """The searches from all starts, one after the other, each with what it found."""
    found = []
    with one_blas_thread():  # else its last digits, and where it ends, differ with the cores
        for _ in range(method.n_starts):
            watched = _Watched(search.goal.limit)
            start = _affordable_start(search, watched, method.rng)
            if start is not None and not search.goal.measure.is_indicator:
                _run(search, watched, start)
            found.append(watched)
    return found


def _affordable_start(search: _Search, watched: _Watched, rng: np.random.Generator) -> Array | None:
    """Return the first decision that a belief explains among random ones, each moved to a random point between the optimal
    decision and the end of the budget."""
    away = random_actions(search.goal.problem, _TRIES_A_START, rng=rng) - search.optimal
    shares = rng.uniform(size=len(away))
    # One by one where judging a start takes a search of its own.
    block = 1 if search.goal.measure.searches_actions else _BLOCK
    for first in range(0, len(away), block):
        part = slice(first, first + block)
        reach = search.goal.along_steps(search.optimal, away[part], _ACCURACY)
        affordable = np.floor(reach / _STEP) * _STEP * shares[part]
        starts = search.optimal + affordable[:, None] * away[part]
        judged = search.judged(starts)
        explained = np.flatnonzero(judged.privacies > -np.inf)
        if explained.size:
            best = explained[:1]
            watched.losses(starts[best], Judgement._make(column[best] for column in judged))
            return np.asarray(starts[best[0]])
    return None


def _cheaper(search: _Search, reached: Array) -> Array:
    """The cheapest decision on the line to the optimal one that still meets an indicator measure."""
    way = reached - search.optimal

    def meets(share: float) -> bool:
        found = search.judged((search.optimal + share * way)[None])
        return bool(found.privacies[0] == 0.0 and found.admissible[0])

    return np.asarray(search.optimal + first_met(meets) * way)


def _run(search: _Search, watched: _Watched, start: Array) -> None:
    """Run the solver from one start, in coordinates along the equalities, so that finite differences stay on them."""
    region, free = search.goal.problem.constraints.in_decision, search.free
    origin = np.zeros(free.shape[1])
    around = start + np.vstack([origin, _DIFFERENCE * np.eye(origin.size)]) @ free.T
    room, normals = region.b_ub - region.A_ub @ start, region.A_ub @ free
    scale = max(watched.limit, np.finfo(float).tiny)

    @lru_cache(1)  # the solver asks for each of them at the same point
    def look(point: bytes) -> Any:
        """The loss, its gradient by forward differences; the share of the budget left, the slack of every row, slopes."""
        v = np.frombuffer(point)
        trials = around + free @ v
        losses, excess = watched.losses(trials, search.judged(trials))
        gradient = np.array([(loss - losses[0]) / _DIFFERENCE for loss in losses[1:]])
        rules = np.append(-excess / scale, room - normals @ v)
        slopes = np.vstack([search.slope(trials[0]) @ free / -scale, -normals])
        return losses[0], gradient, rules, slopes

    def loss(v: Array) -> Any:
        return look(v.tobytes())[:2]

    rules: Any = {"type": "ineq", "fun": lambda v: look(v.tobytes())[2], "jac": lambda v: look(v.tobytes())[3]}
    minimize(loss, origin, jac=True, method="SLSQP", constraints=rules)
