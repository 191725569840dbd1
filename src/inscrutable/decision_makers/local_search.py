"""The paper's way: a local solver on the decision itself, from random affordable starts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import minimize

from inscrutable import tolerances, validation
from inscrutable.adversaries import consistent_sets
from inscrutable.decision_makers.candidates import random_actions
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_TRIES_A_START = 200
_HALVINGS = 30
_UNEXPLAINED = 2.0
_DIFFERENCE = float(np.sqrt(np.finfo(float).eps))


@dataclass(frozen=True)
class LocalSearch:
    """SLSQP over the decision, from random affordable starts: the paper's solver, with its local optima.

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
        self.problem, self.belief, self.measure, self.limit = problem, belief, measure, limit
        self.optimal_cost = float(problem.optimal_cost(belief))
        self.best: Array | None = None
        self.best_key = (-np.inf, -np.inf)
        self.worst = 0.0

    def privacies(self, actions: Array) -> Array:
        """Privacy of trials (n,U), −∞ for those outside the feasible set or, where that matters, unexplained."""
        outside = self.problem.constraints.violation(actions)
        far = tolerances.FEASIBILITY if self.measure.judges_empty else tolerances.FINITE_DIFFERENCE
        sets = consistent_sets(self.problem, actions)
        values = self.measure.values(self.belief, sets)
        privacies = values.privacies.copy()
        for index in np.flatnonzero(~values.exact & (outside <= far)):
            privacies[index] = self.measure(self.belief, sets[int(index)])
        if not self.measure.judges_empty:
            privacies[sets.dimension < 0] = -np.inf
        return np.where(outside <= far, privacies, -np.inf)

    def excess(self, actions: Array) -> Array:
        """Cost above what the budget allows, for trials (U,) or (n,U)."""
        return np.asarray(self.problem.state_costs(actions) @ self.belief - self.optimal_cost - self.limit)

    def losses(self, actions: Array) -> Array:
        """Return minus the privacy of trials (n,U), and remember the best admissible affordable one."""
        privacies, excess = self.privacies(actions), self.excess(actions)
        playable = np.isfinite(privacies) & (excess <= 0) & self.problem.constraints.is_admissible(actions)
        for index in np.flatnonzero(playable):
            key = (float(privacies[index]), -float(excess[index]))
            if key > self.best_key:
                self.best, self.best_key = actions[index].copy(), key
        self.worst = max(self.worst, -float(privacies[np.isfinite(privacies)].min(initial=np.inf)))
        # Beyond the plausible set the privacy is undefined: worse than any belief could be, so the solver turns back.
        return np.where(np.isfinite(privacies), -privacies, self.worst + _UNEXPLAINED)


def search_locally(
    problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, limit: float, method: LocalSearch
) -> Array | None:
    """Return the best decision found, or None where no start was affordable and explained."""
    watched = _Watched(problem, belief, measure, limit)
    optimal = problem.solve(belief)
    for _ in range(method.n_starts):
        start = _affordable_start(watched, optimal, method.rng)
        if start is None:
            continue
        if not measure.is_indicator:
            _run(watched, start)
        elif watched.best is not None:
            watched.best = _cheaper(watched, optimal, watched.best)
    return watched.best


def _affordable_start(watched: _Watched, optimal: Array, rng: np.random.Generator) -> Array | None:
    """The first of some random decisions, moved at random between the optimal one and the budget's end, that a belief
    explains."""
    away = random_actions(watched.problem, _TRIES_A_START, rng=rng) - optimal
    shares = _affordable_shares(watched, optimal, away) * rng.uniform(size=len(away))
    starts = optimal + shares[:, None] * away
    # One by one where judging a start takes a search of its own.
    block = 1 if watched.measure.searches_actions else len(starts)
    for first in range(0, len(starts), block):
        explained = np.flatnonzero(watched.privacies(starts[first : first + block]) > -np.inf)
        if explained.size:
            start = np.asarray(starts[first + explained[0]])
            watched.losses(start[None])
            return start
    return None


def _affordable_shares(watched: _Watched, optimal: Array, away: Array) -> Array:
    """The longest shares of the steps `away` (n,U) that the budget affords, at most one: the cost is convex along them."""
    low = np.zeros(len(away))
    high = np.where(watched.excess(optimal + away) <= 0, 0.0, 1.0)
    low[high == 0.0] = 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        fits = watched.excess(optimal + middle[:, None] * away) <= 0
        low = np.where((high > low) & fits, middle, low)
        high = np.where((high > low) & ~fits, middle, high)
    return low


def _cheaper(watched: _Watched, optimal: Array, reached: Array) -> Array:
    """The cheapest decision on the line to the optimal one that still meets an indicator measure."""
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        trial = (optimal + middle * (reached - optimal))[None]
        if watched.privacies(trial)[0] == 0.0 and watched.problem.constraints.is_admissible(trial)[0]:
            high = middle
        else:
            low = middle
    return np.asarray(optimal + high * (reached - optimal))


def _run(watched: _Watched, start: Array) -> None:
    region = watched.problem.constraints
    scale = max(watched.limit, np.finfo(float).tiny)
    # Steps along the equalities only, so that finite differences stay on them.
    free = null_space(region.A_eq) if len(region.b_eq) else np.eye(start.size)
    rules: list[Any] = [
        {"type": "ineq", "fun": lambda v: np.array([-watched.excess(start + free @ v) / scale])},
        {
            "type": "ineq",
            "fun": lambda v: region.b_ub - region.A_ub @ (start + free @ v),
            "jac": lambda v: -region.A_ub @ free,
        },
    ]
    steps = np.vstack([np.zeros(free.shape[1]), _DIFFERENCE * np.eye(free.shape[1])])

    def loss(v: Array) -> tuple[float, Array]:
        values = watched.losses(start + (v + steps) @ free.T)
        return float(values[0]), (values[1:] - values[0]) / _DIFFERENCE

    minimize(loss, np.zeros(free.shape[1]), jac=True, method="SLSQP", constraints=rules, options={"maxiter": 100})
