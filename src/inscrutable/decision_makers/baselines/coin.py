"""A coin between the optimal decision and another one that does not depend on the belief; randomised response."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.decision_makers.baselines.candidate_lotteries import CandidateLotteries
from inscrutable.decision_makers.baselines.lottery import DrawingDecisionMaker
from inscrutable.decision_makers.candidates import make_candidates
from inscrutable.decision_makers.results import DecisionStatus
from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem, FiniteProblem
from inscrutable.validation import Array


class CoinDecisionMaker(DrawingDecisionMaker):
    """At random the optimal decision or that of a fixed decoy belief, or of a decoy belief drawn from a list.

    Formula: K(u*(y)|π) = p, K(u*(π)|π) = 1 − p, with one decoy y for every belief; the expected regret p ρ(π,u*(y)) is
    linear in p. At p = 1 nothing leaks. Where both decisions are the same the lottery has one atom. Of n decoys each is
    drawn with probability p/n.

    Args:
        problem: The decision problem.
        probability: p in [0, 1], the probability of the decoy's decision.
        decoy: y, a belief, shape (X,), or several, (n,X); None is the uniform one. The mean of a prior gives the cheapest
            constant decision under that prior, whose expected regret is the silence regret.

    Raises:
        InputError: The probability is not in [0, 1], or a decoy is no belief.

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
        self.decoy = validation.beliefs(given, n_states, "decoy", names=self.problem.state_names)
        if not len(self.decoy):
            raise InputError("decoy has no rows; expected at least one belief")
        self._played: Array | None = None  # the decoys' decisions where they are not the first of tied ones

    @classmethod
    def response(cls, problem: FiniteProblem, epsilon: float) -> CoinDecisionMaker:
        """Return ε-randomised response over K choices.

        Formula: the best choice with probability e^ε/(e^ε + K − 1), each other one with 1/(e^ε + K − 1).

        Args:
            problem: Every choice must be the best one in some state.
            epsilon: ε, at least 0, in nats: no choice is more than e^ε times as likely under one belief as under another.

        Raises:
            InputError: The problem is no `FiniteProblem`, a choice is the best in no state, or ε is negative.

        Source: Warner (1965); Kairouz, Bonawitz and Ramage, Discrete distribution estimation under local privacy (2016).

        Example:
            >>> from inscrutable import FiniteProblem
            >>> maker = CoinDecisionMaker.response(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), np.log(3))
            >>> maker.decide([0.2, 0.8]).probabilities
            array([0.25, 0.75])
        """
        if not isinstance(problem, FiniteProblem):
            raise InputError(f"randomised response needs a FiniteProblem, got {problem!r}")
        states, n_choices = np.eye(problem.n_states), problem.n_choices
        best = problem.tied(states)
        never = np.flatnonzero(~best.any(axis=0)).tolist()
        if never:
            raise InputError(
                f"randomised response needs choices each of which is the best in some state; {never} are not"
            )
        odds = np.exp(-validation.non_negative(epsilon, "epsilon"))
        found = cls(problem, n_choices * odds / (1.0 + (n_choices - 1) * odds), decoy=states[best.argmax(axis=0)])
        found._played = np.eye(n_choices)
        return found

    def _lotteries(self, beliefs: Array) -> CandidateLotteries:
        decoys = np.atleast_2d(self.decoy)
        both = np.vstack([decoys, beliefs])
        solved = self.problem.solve_points(both)
        if self._played is not None:
            solved[: len(decoys)] = self._played
        candidates = make_candidates(self.problem, solved, both)
        drawn, often = np.unique(candidates.same_as[: len(decoys)], return_counts=True)
        own = candidates.same_as[len(decoys) :, None]
        optimal = (beliefs * candidates.state_costs[len(decoys) :]).sum(axis=1)
        regrets = np.maximum(beliefs @ candidates.state_costs[drawn].T - optimal[:, None], 0.0)
        same = drawn == own  # equal decisions are one atom, the first
        shares = self.probability * often / len(decoys) + np.where(same, 1.0 - self.probability, 0.0)
        rest = np.where(same.any(axis=1, keepdims=True), 0.0, 1.0 - self.probability)
        numbers = np.hstack([np.broadcast_to(drawn, same.shape), own])
        statuses = (DecisionStatus.RULE_OF_THUMB,) * len(beliefs)
        return CandidateLotteries(
            self.problem,
            candidates,
            beliefs,
            numbers,
            np.hstack([shares, rest]),
            np.hstack([np.where(same, 0.0, regrets), np.zeros((len(beliefs), 1))]),
            optimal,
            statuses,
        )
