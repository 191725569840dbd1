"""Any affordable decision, all equally likely."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inscrutable.budgets import Budget, as_budget
from inscrutable.decision_makers.baselines.candidate_lotteries import CandidateLotteries
from inscrutable.decision_makers.baselines.lottery import CandidateLottery
from inscrutable.decision_makers.candidates import Candidates, make_candidates
from inscrutable.decision_makers.results import DecisionStatus
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class UniformDecisionMaker(CandidateLottery):
    """A decision drawn uniformly from the candidates that the budget allows.

    Formula: K(u|π) = 1/|A(π)| on A(π) = {candidates u : ρ(π,u) ≤ budget}. The budget holds for every single decision.
    Where A(π) is empty the optimal decision is played, with the status `NO_AFFORDABLE_PRIVACY`.

    Args:
        problem: The decision problem.
        budget: A share of |c*|, or a `Budget`.
        candidates: Decisions to draw from; None is about 5,000 decoys. Decisions (M,U) are accepted. Equal ones count once,
            inadmissible ones are left out.
        on_empty: "exclude" leaves out candidates that no belief explains, "infinite" keeps them: their privacy is
            infinite, and an observer detects that the decision is not optimal.

    Raises:
        InputError: An argument is malformed, or no candidate is left.

    Cost: one product per belief. Source: the feasible set of the paper's eq. (8), without its goal.

    Example:
        >>> from inscrutable import FiniteProblem
        >>> maker = UniformDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), Budget.regret(0.2))
        >>> maker.decide_many([[0.55, 0.45], [0.9, 0.1]]).probabilities
        array([[0.5, 0.5],
               [1. , 0. ]])
    """

    _shown = ("budget",)

    def __init__(
        self,
        problem: DecisionProblem,
        budget: Budget | float = 0.1,
        *,
        candidates: Candidates | ArrayLike | None = None,
        on_empty: str = "exclude",
    ) -> None:
        super().__init__(problem, candidates, on_empty)
        self.budget = as_budget(budget)

    def _lotteries(self, beliefs: Array) -> CandidateLotteries:
        optimal = np.atleast_1d(self.problem.optimal_cost(beliefs))
        regrets = self._regrets(beliefs, optimal)
        affordable = regrets <= self.budget.limits(optimal)[:, None]
        candidates, numbers = self.candidates, np.tile(self.choices, (len(beliefs), 1))
        bare = np.flatnonzero(~affordable.any(axis=1))
        if bare.size:
            own = make_candidates(self.problem, self.problem.solve_points(beliefs[bare]), beliefs[bare])
            numbers[bare, 0] = len(candidates) + np.arange(bare.size)
            regrets[bare, 0], affordable[bare, 0] = 0.0, True
            candidates = candidates.joined(own)
        statuses = [DecisionStatus.RULE_OF_THUMB] * len(beliefs)
        for step in bare:
            statuses[step] = DecisionStatus.NO_AFFORDABLE_PRIVACY
        shares = affordable / affordable.sum(axis=1, keepdims=True)
        return CandidateLotteries(self.problem, candidates, beliefs, numbers, shares, regrets, optimal, tuple(statuses))
