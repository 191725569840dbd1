"""A coin between the optimal decision and always the same other one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.decision_makers.baselines.lots import Lots
from inscrutable.decision_makers.baselines.lottery import DrawingDecisionMaker
from inscrutable.decision_makers.candidates import make_candidates
from inscrutable.decision_makers.results import DecisionStatus
from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class CoinDecisionMaker(DrawingDecisionMaker):
    """A coin between the optimal decision and that of a fixed decoy.

    Formula: K(u*(y)|π) = p, K(u*(π)|π) = 1 − p, with one decoy y for every belief; the expected regret p ρ(π,u*(y)) is
    linear in p. At p = 1 nothing leaks. Where both decisions are the same it is played for certain.

    Args:
        problem: The decision problem.
        probability: p in [0, 1], of the decoy's decision.
        decoy: y, a belief, shape (X,); None is the uniform one. The mean of a prior gives the cheapest constant decision
            under that prior, whose expected regret is the silence regret.

    Raises:
        InputError: The probability is not in [0, 1], or the decoy is no belief.

    Cost: one forward solve per belief. Source: Warner, Randomized response (1965).

    Example:
        >>> from inscrutable import FiniteProblem
        >>> maker = CoinDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), 0.25, decoy=[1.0, 0.0])
        >>> found = maker.decide([0.2, 0.8])
        >>> found.actions, found.probabilities
        (array([0, 1]), array([0.25, 0.75]))
    """

    _shown = ("probability",)

    def __init__(self, problem: DecisionProblem, probability: float, decoy: ArrayLike | None = None) -> None:
        super().__init__(problem)
        self.probability = validation.non_negative(probability, "probability")
        if self.probability > 1:
            raise InputError(f"probability must be at most 1, got {self.probability:g}")
        n_states = self.problem.n_states
        given = np.full(n_states, 1.0 / n_states) if decoy is None else decoy
        self.decoy = validation.one_belief(given, n_states, "decoy", names=self.problem.state_names)

    def _lots(self, beliefs: Array) -> Lots:
        both = np.vstack([self.decoy, beliefs])
        candidates = make_candidates(self.problem, self.problem.solve_points(both), both)
        own = candidates.same_as[1:]
        optimal = (beliefs * candidates.state_costs[1:]).sum(axis=1)
        regret = np.maximum(beliefs @ candidates.state_costs[0] - optimal, 0.0)
        numbers = np.stack([np.zeros(len(beliefs), dtype=np.int64), own], axis=1)
        # The same decision twice is one atom: the first takes all.
        decoy = np.where(own == 0, 1.0, self.probability)
        shares = np.stack([decoy, 1.0 - decoy], axis=1)
        regrets = np.stack([np.where(own == 0, 0.0, regret), np.zeros(len(beliefs))], axis=1)
        statuses = (DecisionStatus.RULE_OF_THUMB,) * len(beliefs)
        return Lots(self.problem, candidates, beliefs, numbers, shares, regrets, optimal, statuses)
