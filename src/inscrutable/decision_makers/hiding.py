"""The arguments of the CDM and the PDM, and the case that both search."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, TypeVar

from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.budgets import Budget, as_budget, is_budget
from inscrutable.decision_makers.arguments import Described, checked_measure, checked_on_empty
from inscrutable.decision_makers.candidate_sources import candidates_for
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.proofs.certified import MOST_CALLS, Proofs, check_provable
from inscrutable.decision_makers.results import Decision, Decisions, MixedDecision, MixedDecisions, Progress, counted
from inscrutable.decision_makers.search.region_search import SearchSpace, space_of
from inscrutable.errors import InputError
from inscrutable.privacy import DesiredObfuscation, MaximalObfuscation, PrivacyMeasure
from inscrutable.problems import DecisionProblem, checked_problem, quadratic_problem
from inscrutable.validation import Array

One = TypeVar("One", Decision, MixedDecision)
Many = TypeVar("Many", Decisions, MixedDecisions)
DISTANCES = MaximalObfuscation, DesiredObfuscation
"""The measures that are ± the distance to a belief."""


@dataclass(frozen=True, eq=False)
class Case:
    """All that a search for decisions needs besides the beliefs to hide."""

    problem: DecisionProblem
    candidates: Candidates
    measure: PrivacyMeasure
    budget: Budget
    on_empty: str = "exclude"

    @cached_property
    def space(self) -> SearchSpace:
        """The search space of the kernels, for quadratic costs."""
        return space_of(self.problem, self.candidates)

    @cached_property
    def is_quadratic_distance(self) -> bool:
        """Whether kernels know the problem and the measure: costs of a quadratic form, and ± the distance to a belief."""
        is_distance = type(self.measure) in DISTANCES and self.on_empty == "exclude"
        return is_distance and quadratic_problem(self.problem) is not None


DEFAULT_BUDGET = 0.1
"""A share of |c*|, as in the paper."""


class HidingDecisionMaker(Described, ABC, Generic[One, Many]):
    """The common part of the CDM and the PDM; arguments as there."""

    _shown = ("measure", "budget")
    _proofs: Proofs | None = None
    _prove: Callable[..., One]
    _stack: Callable[[list[One], DecisionProblem], Many]

    def __init__(
        self,
        problem: DecisionProblem,
        measure: Any,
        budget: Any,
        candidates: Candidates | ArrayLike | None,
        on_empty: str,
    ) -> None:
        self.problem = checked_problem(problem)
        # Measures and budgets differ in type, so that either may come first.
        if isinstance(measure, (Budget, float, int)) or (isinstance(measure, str) and is_budget(measure)):
            measure, budget = self._swapped(measure, budget)
        self.measure = checked_measure(measure)
        self.budget = as_budget(budget)
        self.on_empty = checked_on_empty(on_empty)
        self._given = candidates

    @staticmethod
    def _swapped(budget: Any, measure: Any) -> tuple[Any, Any]:
        """A measure, None where none was given, and a budget that came in its place."""
        if isinstance(measure, PrivacyMeasure):
            return measure, budget
        if measure == DEFAULT_BUDGET:
            return None, budget
        raise InputError(f"two budgets were given, {budget!r} and {measure!r}; expected (problem, measure, budget)")

    def _prove_within(self, gap: float | None, most_calls: int = MOST_CALLS) -> None:
        """Ask for proofs with a relative gap; None asks for none."""
        if gap is not None:
            check_provable(self.measure, self.on_empty)
            self._proofs = Proofs(self.problem, self.budget, gap, most_calls)

    def decide(self, belief: ArrayLike) -> One:
        """Return the decision or lottery for one belief (X,).

        Cost: a decision about 0.15 ms for three states, up to 0.2 s for eight states and ninety actions; a local search some
        0.1 s. A lottery takes two or three times as long.
        """
        held = validation.one_belief(belief, self.problem.n_states, names=self.problem.state_names)
        if isinstance(self.measure, DesiredObfuscation):
            self.measure.target_for(held)  # refuses a target for every step
        return self._decided(held[None], None)[0]  # type: ignore[return-value]

    def decide_many(self, beliefs: ArrayLike, *, progress: Progress | None = None) -> Many:
        """Return the decisions for beliefs (T,X), each the one that `decide` returns; a target per step is used in turn."""
        held = validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)
        return self._decided(held, progress)

    def _decided(self, beliefs: Array, progress: Progress | None) -> Many:
        if self._proofs is None:
            return self._found(beliefs, progress)
        found, proved, prove = self._found(beliefs, None), [], type(self)._prove
        for step, belief in counted(beliefs, progress):
            measure = self.measure.at_step(step)
            proved.append(prove(self._proofs, belief, measure, found[step], self.between_choices))
        return self._stack(proved, self.problem)

    @abstractmethod
    def _found(self, beliefs: Array, progress: Progress | None) -> Many:
        """The decisions for beliefs (T,X), without proofs."""

    @cached_property
    def candidates(self) -> Candidates:
        """The candidates, solved at first use and kept."""
        return candidates_for(self.problem, self.measure, self._given, self.on_empty)

    @cached_property
    def case(self) -> Case:
        """The case to search."""
        return Case(self.problem, self.candidates, self.measure, self.budget, self.on_empty)

    @property
    def between_choices(self) -> bool:
        """Whether decisions between choices are allowed: unless they are whole numbers and so are all candidates."""
        return not self.problem.is_discrete or bool(((self.candidates.actions % 1.0) != 0.0).any())
