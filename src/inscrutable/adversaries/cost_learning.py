"""The observer who knows neither the agent's cost nor its beliefs, and learns the cost from decisions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries.cost_family import CostFamily
from inscrutable.adversaries.learned_costs import CostStatus, LearnedCost
from inscrutable.problems import DecisionProblem, MarkowitzProblem, Polyhedron
from inscrutable.validation import Array


class CostLearningAdversary:
    """The observer who learns one parameter of the agent's cost from decisions alone.

    Formula: {θ : ∀t ∃ π_t ∈ Δ, λ ≥ 0, ν : G_θ(u_t)π_t + A_act'λ + A_eq'ν = 0}. A decision with more free coordinates than
    states over-determines its belief and usually identifies θ; other decisions leave an interval.

    Args:
        family: Returns the decision problem for a value of the parameter. Gradients should be affine in the parameter, such as
            the risk aversion or an error of the means along one direction. Otherwise the intervals are accurate to the square
            of a piece's width, which starts at a sixteenth of the bounds.
        bounds: The least and the greatest value considered.
        tolerance: Largest KKT residual of an explained decision, relative to the gradient's scale.

    Raises:
        InputError: Bounds are not two ascending numbers, or the family returns no decision problem, or costs without gradients.

    Cost: about 10 ms per decision, mostly non-negative least squares. Linear programmes decide undecided cases and all rounded
    decisions, about 0.1 s per decision. Source: inverse optimisation: the paper's Theorem 1 with an unknown cost parameter.

    Example:
        >>> means, covariances = [[0.3, 0.1, 0.0], [0.0, 0.1, 0.25]], [np.diag([1.0, 2.0, 3.0]), np.diag([3.0, 1.0, 1.0])]
        >>> agent = MarkowitzProblem(means, covariances, 0.7)
        >>> adversary = CostLearningAdversary.risk_aversion(means, covariances, (0.1, 10.0))
        >>> learned = adversary.learn(agent.solve([[0.6, 0.4], [0.3, 0.7]]))
        >>> learned.is_identified, round(learned.parameter, 6)
        (True, 0.7)
    """

    def __init__(
        self,
        family: Callable[[float], DecisionProblem],
        bounds: Sequence[float],
        *,
        tolerance: float = tolerances.EXPLAINED,
    ) -> None:
        self._family = CostFamily(family, bounds, tolerance)

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return self._family.problem.n_states

    @classmethod
    def risk_aversion(
        cls,
        means: ArrayLike,
        covariances: ArrayLike,
        bounds: Sequence[float],
        constraints: Polyhedron | None = None,
    ) -> CostLearningAdversary:
        """Return the adversary of a Markowitz investor whose risk aversion γ is unknown.

        Args:
            means: μ_i, shape (X,U).
            covariances: Σ_i, shape (X,U,U).
            bounds: The least and the greatest γ considered, above 0.
            constraints: The feasible set; None is `simplex(U)`.

        Raises:
            InputError: As `MarkowitzProblem`.
            ModelError: As `MarkowitzProblem`.
        """
        return cls(partial(_investor, means, covariances, constraints), bounds)

    def learn(self, actions: ArrayLike, *, rounding: float = 0.0) -> LearnedCost:
        """Return the values of the parameter that explain every decision.

        Args:
            actions: u_0..u_{T-1}, shape (T,U); the belief behind each is unknown.
            rounding: Largest error of a coordinate: 0.0005 for weights rounded to 0.001. The intervals then contain every value
                that explains some unrounded decisions that round to `actions`: exactly for quadratic costs, to first order
                otherwise.

        Raises:
            InputError: A decision is outside the feasible set by more than its rounding, or `rounding` is negative.
        """
        exactness = validation.non_negative(rounding, "rounding")
        explained = self._family.explained(actions, exactness)
        low, high = self._family.bounds
        intervals = explained.intervals(low, high)
        parameter = residual = float("nan")
        if len(intervals):
            widest = intervals[int(np.argmax(intervals[:, 1] - intervals[:, 0]))]
            parameter = float(np.clip(widest.mean(), low, high))
            residual = explained.residual(parameter)
        return LearnedCost(parameter, intervals, residual, self._status(intervals), exactness, self._family)

    def _status(self, intervals: Array) -> CostStatus:
        if not len(intervals):
            return CostStatus.UNEXPLAINED
        low, high = intervals[0, 0], intervals[-1, 1]
        least, most = self._family.bounds
        if len(intervals) == 1 and high - low <= tolerances.IDENTIFIED * max(abs(low), abs(high), most - least):
            return CostStatus.IDENTIFIED
        if low <= least or high >= most:
            return CostStatus.AT_BOUND
        return CostStatus.INTERVAL if len(intervals) == 1 else CostStatus.SEVERAL

    def __repr__(self) -> str:
        return f"CostLearningAdversary({self._family.problem!r}, bounds {self._family.bounds})"


def _investor(
    means: ArrayLike, covariances: ArrayLike, constraints: Polyhedron | None, risk_aversion: float
) -> MarkowitzProblem:
    return MarkowitzProblem(means, covariances, risk_aversion, constraints)
