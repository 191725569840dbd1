"""The paper's way: a local solver on the decision itself, from random affordable starts."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import minimize

from inscrutable import tolerances, validation
from inscrutable.adversaries import consistent_sets
from inscrutable.decision_makers.candidates import random_candidates
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_TRIES_A_START = 200


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

    def privacy(self, action: Array) -> float:
        outside = float(self.problem.constraints.violation(action))
        if not outside <= tolerances.FINITE_DIFFERENCE:
            return -np.inf
        if self.measure.judges_empty and outside > tolerances.FEASIBILITY:
            return -np.inf
        sets = consistent_sets(self.problem, action[None])
        empty = sets.dimension[0] < 0
        if empty and not self.measure.judges_empty:
            return -np.inf
        if sets.dimension[0] >= 2 or self.measure.reference(self.belief) is None:
            return float(self.measure(self.belief, sets[0]))
        return float(self.measure.values(self.belief, sets).privacies[0])

    def excess(self, action: Array) -> float:
        return float(self.problem.state_costs(action) @ self.belief) - self.optimal_cost - self.limit

    def __call__(self, action: Array) -> float:
        value = self.privacy(action)
        excess = self.excess(action)
        key = (value, -excess)
        if (
            np.isfinite(value)
            and excess <= 0
            and key > self.best_key
            and self.problem.constraints.is_admissible(action)
        ):
            self.best, self.best_key = action.copy(), key
        # Beyond the plausible set the privacy is undefined: worse than any belief could be, so the solver turns back.
        return -value if np.isfinite(value) else 2.0


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
        if measure.reference(belief) is not None:
            _run(watched, start)
        elif watched.best is not None:
            watched.best = _cheaper(watched, optimal, watched.best)
    return watched.best


def _affordable_start(watched: _Watched, optimal: Array, rng: np.random.Generator) -> Array | None:
    drawn = random_candidates(watched.problem, _TRIES_A_START, rng=rng).actions
    for target in drawn:
        share = _affordable_share(watched, optimal, target) * rng.uniform()
        start = optimal + share * (target - optimal)
        if watched(start) < 2.0:
            return np.asarray(start)
    return None


def _affordable_share(watched: _Watched, optimal: Array, target: Array) -> float:
    low, high = 0.0, 1.0
    if watched.excess(target) <= 0:
        return 1.0
    while high - low > tolerances.FEASIBILITY:
        middle = 0.5 * (low + high)
        if watched.excess(optimal + middle * (target - optimal)) <= 0:
            low = middle
        else:
            high = middle
    return low


def _cheaper(watched: _Watched, optimal: Array, reached: Array) -> Array:
    """The cheapest decision on the line to the optimal one that still meets an indicator measure."""
    low, high = 0.0, 1.0
    while high - low > tolerances.FEASIBILITY:
        middle = 0.5 * (low + high)
        trial = optimal + middle * (reached - optimal)
        if watched.privacy(trial) == 0.0 and watched.problem.constraints.is_admissible(trial):
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

    def loss(v: Array) -> float:
        return watched(np.asarray(start + free @ v))

    minimize(loss, np.zeros(free.shape[1]), method="SLSQP", constraints=rules, options={"maxiter": 100})
