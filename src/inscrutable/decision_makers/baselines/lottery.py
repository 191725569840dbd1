"""Decision makers that draw from a list by a rule which depends on the present belief alone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.decision_makers.arguments import Described, checked_on_empty
from inscrutable.decision_makers.baselines.candidate_lotteries import CandidateLotteries, cleaned
from inscrutable.decision_makers.candidate_sources import as_candidates
from inscrutable.decision_makers.candidates import Candidates, distinct_of
from inscrutable.decision_makers.results import MixedDecision, MixedDecisions
from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array


class DrawingDecisionMaker(Described, ABC):
    """A rule that gives a lottery for every belief; a subclass gives the lotteries, the rest follows."""

    is_memoryless = True
    """Whether the lottery depends on the present belief alone, so that it is a mechanism."""

    def __init__(self, problem: DecisionProblem) -> None:
        self.problem = checked_problem(problem)

    @abstractmethod
    def _lotteries(self, beliefs: Array) -> CandidateLotteries:
        """Return the lotteries for beliefs (T,X)."""

    def decide(self, belief: ArrayLike) -> MixedDecision:
        """Return the lottery for one belief (X,)."""
        return self.decide_many(validation.one_belief(belief, self.problem.n_states, names=self.problem.state_names))[0]

    def decide_many(self, beliefs: ArrayLike) -> MixedDecisions:
        """Return the lotteries for beliefs (T,X); privacy is the paper's measure (e), against the naive observer."""
        return self._cleaned(beliefs).results()

    def table(self, beliefs: ArrayLike) -> tuple[Array, np.ndarray, Array]:
        """Return points (M,U), and for beliefs (T,X) the numbers (T,k) of those in the lottery and their shares (T,k).

        The same lotteries as `decide_many`, without the consistent beliefs of each decision.
        """
        lotteries = self._cleaned(beliefs)
        return lotteries.candidates.actions, lotteries.numbers, lotteries.shares

    def _cleaned(self, beliefs: ArrayLike) -> CandidateLotteries:
        return cleaned(
            self._lotteries(validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names))
        )


class CandidateLottery(DrawingDecisionMaker):
    """A rule that draws from fixed candidates: the distinct admissible ones that some belief explains."""

    def __init__(
        self, problem: DecisionProblem, candidates: Candidates | ArrayLike | None, on_empty: str = "exclude"
    ) -> None:
        super().__init__(problem)
        self.on_empty = checked_on_empty(on_empty)
        self._given = candidates

    @cached_property
    def candidates(self) -> Candidates:
        """The candidates, solved at first use and kept."""
        return as_candidates(self.problem, self._given)

    @cached_property
    def choices(self) -> np.ndarray:
        """Which candidates can be drawn: the numbers of distinct admissible ones, shape (D,)."""
        found = distinct_of(self.candidates)
        numbers = found.number if self.on_empty == "infinite" else found.number[found.kind >= 0]
        if not len(numbers):
            raise InputError(
                f"no candidate can be drawn: {self.candidates.summary()}; give others, or none for decoys"
                + ("" if self.on_empty == "infinite" else ', or set on_empty="infinite"')
            )
        return numbers

    def _regrets(self, beliefs: Array, optimal_costs: Array) -> Array:
        """ρ(π_t,u) of every choice, shape (T,D)."""
        costs = beliefs @ self.candidates.state_costs[self.choices].T
        return np.asarray(np.maximum(costs - optimal_costs[:, None], 0.0))
