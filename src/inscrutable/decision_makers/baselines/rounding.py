"""Decisions on a coarse grid."""

from __future__ import annotations

from itertools import product

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.decision_makers.baselines.rule import RuleDecisionMaker
from inscrutable.decision_makers.candidate_sources import is_simplex
from inscrutable.errors import InputError, ModelError
from inscrutable.mechanisms.priors import rounded_to_grid
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_MOST_COORDINATES = 12
"""The most coordinates that are rounded up or down in every combination, 4,096 of them."""


class RoundingDecisionMaker(RuleDecisionMaker):
    """The optimal decision rounded to multiples of a step.

    Formula: on the simplex the nearest multiples of h that sum to one (largest remainders); elsewhere the cheapest feasible
    one of the neighbours h⌊u*/h⌋ + h b, b ∈ {0,1}^U. Often no belief explains a rounded decision; its privacy is then
    infinite, and `NearOptimalAdversary` is the observer to use.

    Args:
        problem: The decision problem, with decisions between choices.
        step: h, above 0, in the decision's unit; on the simplex 1/h is a whole number.

    Raises:
        InputError: The step does not divide one, decisions are finite choices, or off the simplex there are more than 12
            coordinates.
        ModelError: No neighbour of an optimal decision is feasible; found when deciding.

    Cost: one forward solve per belief, and off the simplex 2^U costs. Source: published weights as they are met, rounded to
    a few digits; Hamilton's method of largest remainders.

    Example:
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> print(RoundingDecisionMaker(problem, 0.1).decide([0.9, 0.1]).action)
        [0.5 0.5]
    """

    _shown = ("step",)

    def __init__(self, problem: DecisionProblem, step: float) -> None:
        super().__init__(problem)
        if self.problem.is_discrete:
            raise InputError(f"choices of {problem!r} are whole numbers already: there is nothing to round")
        self.step = validation.positive(step, "step")
        self._steps: int | None = None
        if is_simplex(self.problem):
            self._steps = round(1.0 / self.step)
            if self._steps < 1 or abs(self._steps * self.step - 1.0) > tolerances.WHOLE_STEPS:
                raise InputError(f"step must divide one, as 0.1 or 1/30 does, got {self.step:g}: weights sum to one")
        elif self.problem.n_actions > _MOST_COORDINATES:
            raise InputError(
                f"{self.problem.n_actions} coordinates off the simplex have too many neighbours: at most "
                f"{_MOST_COORDINATES} can be rounded"
            )

    def _points(self, beliefs: Array) -> Array:
        optimal = np.atleast_2d(self.problem.solve_points(beliefs))
        if self._steps is not None:
            return np.asarray(rounded_to_grid(optimal, self._steps) / self._steps)
        ups = np.array(list(product((0, 1), repeat=self.problem.n_actions)))
        return np.array([self._cheapest(*each, ups) for each in zip(beliefs, optimal, strict=True)])

    def _cheapest(self, belief: Array, optimal: Array, ups: np.ndarray) -> Array:
        near = self.step * (np.floor(optimal / self.step + tolerances.WHOLE_STEPS) + ups)
        near = near[self.problem.constraints.violation(near) <= tolerances.FEASIBILITY]
        if not len(near):
            raise ModelError(
                f"no feasible decision in multiples of {self.step:g} next to the optimal {optimal}: take a finer step"
            )
        return np.asarray(near[(self.problem.state_costs(near) @ belief).argmin()])
