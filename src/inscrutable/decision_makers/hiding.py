"""What decision makers that hide a belief have in common: a problem, a goal, a budget, and candidates solved once."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from inscrutable.budgets import Budget, as_budget
from inscrutable.decision_makers.arguments import checked_measure, checked_on_empty
from inscrutable.decision_makers.candidates import Candidates, as_candidates, near_decoys
from inscrutable.decision_makers.described import Described
from inscrutable.errors import InputError
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem, checked_problem

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
        # The two have types that cannot be mistaken, so that either may come first.
        if isinstance(measure, (Budget, float, int, str)) and not isinstance(measure, bool):
            measure, budget = self._swapped(measure, budget)
        self.measure = checked_measure(measure)
        self.budget = as_budget(budget)
        self.on_empty = checked_on_empty(on_empty)
        self._given = candidates
        self._candidates: Candidates | None = None

    @staticmethod
    def _swapped(budget: Any, measure: Any) -> tuple[Any, Any]:
        """A measure, None where none was given, and a budget that came in its place."""
        if isinstance(measure, PrivacyMeasure):
            return measure, budget
        if measure == DEFAULT_BUDGET:
            return None, budget
        raise InputError(f"two budgets were given, {budget!r} and {measure!r}; expected (problem, measure, budget)")

    @property
    def candidates(self) -> Candidates:
        """The candidates, solved at first use and kept."""
        if self._candidates is None:
            self._candidates = candidates_for(self.problem, self.measure, self._given)
        return self._candidates

    @property
    def between_choices(self) -> bool:
        """Whether decisions between choices are allowed: unless they are whole numbers and so are all candidates."""
        return not self.problem.is_discrete or bool(((self.candidates.actions % 1.0) != 0.0).any())


def candidates_for(
    problem: DecisionProblem, measure: PrivacyMeasure, given: Candidates | ArrayLike | None
) -> Candidates:
    """Return given candidates, or the default: decoys, and decisions beside them where unexplained ones can be best."""
    if given is None and measure.searches_actions:
        return near_decoys(problem)
    return as_candidates(problem, given)
