"""The common part of decision makers against an aware observer: a prior, a budget, and one stored solution."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.budgets import Budget, as_budget
from inscrutable.decision_makers.arguments import Described
from inscrutable.decision_makers.aware.columns import Columns, allowed_places, columns_of
from inscrutable.decision_makers.aware.guarantees import Guarantee
from inscrutable.decision_makers.candidate_sources import as_candidates
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.results import MixedDecision, MixedDecisions, Progress
from inscrutable.errors import InputError
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.priors import checked_prior, without_copies
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array


class Options(NamedTuple):
    """Settings beside problem, budget, prior and candidates."""

    worst_regret: Budget | None
    plausible_only: bool
    gap: float


class PriorTable(NamedTuple):
    """Regrets of all decisions under all beliefs of a prior, and where a cap allows them."""

    columns: Columns
    optimal_costs: Array  # (B,)
    regrets: Array  # (B,M)
    allowed: np.ndarray | None  # (B,M)

    @property
    def least(self) -> Array:
        """The least allowed regret of every belief, shape (B,); infinite where none is allowed."""
        regrets = self.regrets if self.allowed is None else np.where(self.allowed, self.regrets, np.inf)
        return np.asarray(regrets.min(axis=1, initial=np.inf))


class HasMechanism(Protocol):
    """The part of a solution that every such decision maker needs."""

    @property
    def mechanism(self) -> Mechanism:
        """K on the prior's beliefs and the decisions that are played."""


Solution = TypeVar("Solution", bound=HasMechanism)


class AwareDecisionMaker(Described, ABC, Generic[Solution]):
    """The common part: one solve, kept; arguments as in `RateDistortionDecisionMaker`."""

    _shown = ("budget", "prior")

    def __init__(
        self,
        problem: DecisionProblem,
        budget: Budget | float,
        prior: Prior,
        candidates: Candidates | ArrayLike | None,
        options: Options,
        guarantees: tuple[Guarantee, ...] = (),
    ) -> None:
        self.problem = checked_problem(problem)
        self.budget = as_budget(budget)
        self.prior = without_copies(checked_prior(prior, self.problem))
        self.options, self.guarantees = options, guarantees
        self._given = candidates
        self._columns: Columns | None = None
        self._solution: Solution | None = None

    @abstractmethod
    def _solve(self, progress: Progress | None) -> Solution:
        """Solve for the prior and the budget."""

    @abstractmethod
    def decide_many(self, beliefs: ArrayLike, *, progress: Progress | None = None) -> MixedDecisions:
        """Return the lotteries for beliefs (T,X)."""

    def solve(self, *, progress: Progress | None = None) -> Self:
        """Solve now, not at first use; only the first call solves. `progress` is called with (steps done, most steps)."""
        if self._solution is None:
            self._solution = self._solve(progress)
        return self

    @property
    def _found(self) -> Solution:
        self.solve()
        assert self._solution is not None
        return self._solution

    @property
    def mechanism(self) -> Mechanism:
        """K on the prior's beliefs and the decisions that are played."""
        return self._found.mechanism

    def decide(self, belief: ArrayLike) -> MixedDecision:
        """Return the lottery for one belief (X,), also outside the prior's support unless there are guarantees."""
        return self.decide_many(
            validation.one_belief(belief, self.problem.n_states, names=self.problem.state_names)[None]
        )[0]

    @property
    def columns(self) -> Columns:
        """The distinct decisions to choose from, found at first use and kept."""
        if self._columns is None:
            candidates = as_candidates(self.problem, self._given)
            self._columns = columns_of(self.problem, candidates, self.options.plausible_only)
            if self._given is None:
                # The cheapest constant decision: at the silence regret it suffices, and decoys alone may miss it.
                self._columns = self._columns.joined(self.prior.mean[None])
        return self._columns

    def _table(self, columns: Columns) -> PriorTable:
        beliefs = self.prior.beliefs
        costs = np.asarray(self.problem.optimal_cost(beliefs))
        regrets = columns.clear_regrets(beliefs, costs)
        return PriorTable(columns, costs, regrets, allowed_places(regrets, self.options.worst_regret, costs))


def checked_options(worst_regret: Budget | float | None, plausible_only: bool, gap: float) -> Options:
    """Return the options, or raise `InputError`."""
    if not isinstance(plausible_only, bool):
        raise InputError(f"plausible_only must be True or False, got {plausible_only!r}")
    return Options(
        None if worst_regret is None else as_budget(worst_regret), plausible_only, validation.positive(gap, "gap")
    )
