"""The exponential mechanism: the cheaper a decision, the likelier."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.decision_makers.baselines.candidate_lotteries import CandidateLotteries
from inscrutable.decision_makers.baselines.lottery import CandidateLottery
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.results import DecisionStatus
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class ExponentialDecisionMaker(CandidateLottery):
    """A decision drawn with a probability that falls exponentially with its regret.

    Formula: K(u|π) ∝ exp(−ε ρ(π,u)) over the candidates. ε = 0 is the uniform law, ε → ∞ the cheapest candidate. As costs
    differ by at most Δ = max |c(i,u) − c(i,u')| between candidates, the odds of two decisions change by at most exp(2εΔ)
    between any two beliefs. Candidates of a probability below `tolerances.PROBABILITY` are never drawn; the bound on the odds
    holds up to that probability.

    Args:
        problem: The decision problem.
        epsilon: ε, at least 0, per unit of cost.
        candidates: Decisions to draw from; None is about 5,000 decoys. Decisions (M,U) are accepted. Equal ones count once,
            inadmissible ones are left out.
        on_empty: "exclude" leaves out candidates that no belief explains, "infinite" keeps them.

    Raises:
        InputError: An argument is malformed, or no candidate is left.

    Cost: one product per belief. Source: McSherry and Talwar, Mechanism design via differential privacy (2007).

    Example:
        >>> from inscrutable import FiniteProblem
        >>> maker = ExponentialDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), np.log(3))
        >>> maker.decide([1.0, 0.0]).probabilities
        array([0.75, 0.25])
    """

    _shown = ("epsilon",)

    def __init__(
        self,
        problem: DecisionProblem,
        epsilon: float,
        *,
        candidates: Candidates | ArrayLike | None = None,
        on_empty: str = "exclude",
    ) -> None:
        super().__init__(problem, candidates, on_empty)
        self.epsilon = validation.non_negative(epsilon, "epsilon")

    def _lotteries(self, beliefs: Array) -> CandidateLotteries:
        optimal = np.atleast_1d(self.problem.optimal_cost(beliefs))
        regrets = self._regrets(beliefs, optimal)
        shares = np.exp(-self.epsilon * (regrets - regrets.min(axis=1, keepdims=True)))
        shares /= shares.sum(axis=1, keepdims=True)
        numbers = np.broadcast_to(self.choices, shares.shape)
        statuses = (DecisionStatus.RULE_OF_THUMB,) * len(beliefs)
        return CandidateLotteries(self.problem, self.candidates, beliefs, numbers, shares, regrets, optimal, statuses)
