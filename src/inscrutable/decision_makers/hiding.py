"""The arguments of the CDM and the PDM, and the case that both search."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from numpy.typing import ArrayLike

from inscrutable.budgets import Budget, as_budget, is_budget
from inscrutable.decision_makers.arguments import Described, checked_measure, checked_on_empty
from inscrutable.decision_makers.candidate_sources import candidates_for
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.search.region_search import SearchSpace, space_of
from inscrutable.errors import InputError
from inscrutable.privacy import DesiredObfuscation, MaximalObfuscation, PrivacyMeasure
from inscrutable.problems import DecisionProblem, checked_problem, quadratic_problem


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
        is_distance = type(self.measure) in (MaximalObfuscation, DesiredObfuscation) and self.on_empty == "exclude"
        return is_distance and quadratic_problem(self.problem) is not None


DEFAULT_BUDGET = 0.1
"""A share of |c*|, as in the paper."""


class HidingDecisionMaker(Described):
    """The common part of the CDM and the PDM; arguments as there."""

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

    @cached_property
    def candidates(self) -> Candidates:
        """The candidates, solved at first use and kept."""
        return candidates_for(self.problem, self.measure, self._given)

    @cached_property
    def case(self) -> Case:
        """The case to search."""
        return Case(self.problem, self.candidates, self.measure, self.budget, self.on_empty)

    @property
    def between_choices(self) -> bool:
        """Whether decisions between choices are allowed: unless they are whole numbers and so are all candidates."""
        return not self.problem.is_discrete or bool(((self.candidates.actions % 1.0) != 0.0).any())
