"""Decisions among candidates alone, as in the paper's programme: several beliefs then share a decision."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inscrutable.budgets import Budget
from inscrutable.decision_makers import Candidates
from inscrutable.decision_makers.envelope import best_mixture, concave_envelope
from inscrutable.decision_makers.scores import Scores, score
from inscrutable.privacy import MaximalObfuscation
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class _Lotteries(NamedTuple):
    """Lotteries in the form that `mechanism` takes."""

    actions: Array  # (T, 2, U)
    probabilities: Array  # (T, 2)


class CandidateDecisionMaker:
    """The CDM, or with `mixes` the PDM, restricted to candidates and the optimal decision, without local refinement."""

    def __init__(
        self, problem: DecisionProblem, budget: Budget, candidates: Candidates, *, mixes: bool = False
    ) -> None:
        self.problem, self.budget, self.candidates, self.mixes = problem, budget, candidates, mixes

    def decide_many(self, beliefs: ArrayLike) -> Any:
        """Return each belief's most private affordable candidate, or lottery of two; otherwise the optimal decision."""
        held = np.asarray(beliefs, dtype=np.float64)
        costs = np.atleast_1d(self.problem.optimal_cost(held))
        limits = self.budget.limits(costs)
        actions = np.repeat(self.problem.solve_points(held)[:, None], 2, axis=1)
        shares = np.tile([1.0, 0.0], (len(held), 1))
        for step, belief in enumerate(held):
            scores = score(belief, float(costs[step]), self.candidates, MaximalObfuscation(), "exclude")
            if self.mixes:
                self._mix(scores, float(limits[step]), actions[step], shares[step])
                continue
            index = scores.best(float(limits[step]))
            if index is not None:
                actions[step] = self.candidates.actions[index]
        return _Lotteries(self.problem.as_actions(actions), shares)

    def _mix(self, scores: Scores, limit: float, actions: Array, shares: Array) -> None:
        """Overwrite rows with the best lottery; the optimal decision stays where the row already has it."""
        corners = scores.settled(concave_envelope)
        regrets = np.concatenate([[0.0], scores.regrets[corners]])
        privacies = np.concatenate([[0.0], scores.privacies[corners]])
        mixed = best_mixture(regrets, privacies, limit)
        if mixed is None:
            return
        for place, (index, share) in enumerate(zip(mixed.indices, mixed.probabilities, strict=True)):
            shares[place] = share
            if index > 0:
                actions[place] = self.candidates.actions[corners[index - 1]]
