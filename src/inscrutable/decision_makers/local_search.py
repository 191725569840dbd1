"""The paper's method: a local solver over the decision, from random affordable starts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import minimize

from inscrutable import validation
from inscrutable.decision_makers.candidate_sources import random_actions
from inscrutable.decision_makers.search.goal import Goal, Judgement
from inscrutable.geometry.crossings import first_met
from inscrutable.kernels.threads import one_blas_thread
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


class _Watched:
    """The objective of the local solver; remembers the best trial that may be played."""

    def __init__(self, problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, limit: float) -> None:
        self.optimal = np.asarray(problem.solve(belief))
        self.goal = Goal(problem, belief, limit, float(problem.state_costs(self.optimal) @ belief), measure)
        equalities = problem.constraints.A_eq
        self.free = null_space(equalities) if len(equalities) else np.eye(self.optimal.size)
        self.forget()

    def forget(self) -> None:
        """Forget all trials."""
        self.best: Array | None = None
        self.best_key = (-np.inf, -np.inf)
        self.worst = 0.0

    def judged(self, actions: Array) -> Judgement:
        """Judge trials (n,U): explained ones alone, unless decisions that no belief explains are sought.

        Near the optimal decision most decisions are explained by no belief. They would hide nothing from an observer who
        allows for rounding.
        """
        return self.goal.judged(actions, explained=not self.goal.measure.searches_actions)

    def losses(self, actions: Array) -> tuple[list[float], float]:
        """Minus the privacies of trials (n,U), and the first one's excess; remembers the best admissible affordable one."""
        found = self.judged(actions)
        excess = [regret - self.goal.limit for regret in found.regrets.tolist()]
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

    def slope(self, action: Array) -> Array:
        """The gradient (U,) of the expected cost at a trial; zero where the trial is not finite."""
        if not np.isfinite(action).all():
            return np.zeros(action.size)
        return np.asarray(self.goal.belief @ self.goal.problem.cost_gradients(action))


def search_locally(
    problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, limit: float, method: LocalSearch
) -> Array | None:
    """Return the best decision found, or None where no start was affordable and explained."""
    watched = _Watched(problem, belief, measure, limit)
    for _ in range(method.n_starts):
        start = _affordable_start(watched, method.rng)
        if start is None:
            continue
        if not measure.is_indicator:
            _run(watched, start)
        elif watched.best is not None:
            watched.best = _cheaper(watched, watched.best)
    return watched.best


def privacies_by_start(
    problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, limit: float, method: LocalSearch
) -> Array:
    """Return the privacy that each start alone leads to, shape (n_starts,), of a measure that is no indicator; −∞ for a
    start that was not affordable and explained."""
    watched = _Watched(problem, belief, measure, limit)
    reached = np.full(method.n_starts, -np.inf)
    for number in range(method.n_starts):
        watched.forget()
        start = _affordable_start(watched, method.rng)
        if start is not None:
            _run(watched, start)
        reached[number] = watched.best_key[0]
    return reached


def _affordable_start(watched: _Watched, rng: np.random.Generator) -> Array | None:
    """Return the first decision that a belief explains among random ones, each moved to a random point between the optimal
    decision and the end of the budget."""
    away = random_actions(watched.goal.problem, _TRIES_A_START, rng=rng) - watched.optimal
    shares = rng.uniform(size=len(away))
    # One by one where judging a start takes a search of its own.
    block = 1 if watched.goal.measure.searches_actions else _BLOCK
    for first in range(0, len(away), block):
        part = slice(first, first + block)
        reach = watched.goal.along_steps(watched.optimal, away[part], _ACCURACY)
        affordable = np.floor(reach / _STEP) * _STEP * shares[part]
        starts = watched.optimal + affordable[:, None] * away[part]
        explained = np.flatnonzero(watched.judged(starts).privacies > -np.inf)
        if explained.size:
            start = np.asarray(starts[explained[0]])
            watched.losses(start[None])
            return start
    return None


def _cheaper(watched: _Watched, reached: Array) -> Array:
    """The cheapest decision on the line to the optimal one that still meets an indicator measure."""
    way = reached - watched.optimal

    def meets(share: float) -> bool:
        found = watched.judged((watched.optimal + share * way)[None])
        return bool(found.privacies[0] == 0.0 and found.admissible[0])

    return np.asarray(watched.optimal + first_met(meets) * way)


class _Descent:
    """Loss, constraints (≥ 0 where met) and their gradients for the solver, computed once a point, in coordinates along the
    equalities, so that finite differences stay on them."""

    def __init__(self, watched: _Watched, start: Array) -> None:
        region = watched.goal.problem.constraints.in_decision
        free = watched.free
        self._watched, self._free = watched, free
        self._scale = max(watched.goal.limit, np.finfo(float).tiny)
        self._around = start + np.vstack([np.zeros(free.shape[1]), _DIFFERENCE * np.eye(free.shape[1])]) @ free.T
        self._room = region.b_ub - region.A_ub @ start
        self._normals = region.A_ub @ free
        self._rules = np.empty(1 + len(self._room))
        self._rule_slopes = np.vstack([np.zeros(free.shape[1]), -self._normals])
        self._loss, self._slope = 0.0, np.zeros(free.shape[1])
        self._key = b""

    def _look(self, v: Array) -> None:
        key = v.tobytes()
        if key == self._key:
            return
        trials = self._around + self._free @ v
        losses, excess = self._watched.losses(trials)
        self._loss = losses[0]
        self._slope = np.array([(loss - losses[0]) / _DIFFERENCE for loss in losses[1:]])
        self._rules[0] = -excess / self._scale
        self._rules[1:] = self._room - self._normals @ v
        self._rule_slopes[0] = self._watched.slope(trials[0]) @ self._free / -self._scale
        self._key = key

    def loss(self, v: Array) -> tuple[float, Array]:
        """Return the loss, and its gradient by forward differences."""
        self._look(v)
        return self._loss, self._slope

    def rules(self, v: Array) -> Array:
        """Return the unspent share of the budget and the slack of every row."""
        self._look(v)
        return self._rules

    def rule_slopes(self, v: Array) -> Array:
        """Return the derivatives of `rules`."""
        self._look(v)
        return self._rule_slopes


def _run(watched: _Watched, start: Array) -> None:
    descent = _Descent(watched, start)
    rules: Any = {"type": "ineq", "fun": descent.rules, "jac": descent.rule_slopes}
    origin = np.zeros(watched.free.shape[1])
    with one_blas_thread():  # else its last digits, and where it ends, differ with the cores
        minimize(descent.loss, origin, jac=True, method="SLSQP", constraints=rules)
