"""The costs that explain observed decisions, and the beliefs consistent with a decision under them."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.adversaries.cost_family import CostFamily, ExplainedDecisions, pieces_of
from inscrutable.errors import InputError
from inscrutable.saved import Saved, Summarised, saved_choice
from inscrutable.validation import Array


@saved_choice
class CostStatus(Enum):
    """Whether decisions identify the parameter of a cost; the text says what to do.

    Example:
        >>> CostStatus.IDENTIFIED.value
        'identified: one value explains every decision'
    """

    IDENTIFIED = "identified: one value explains every decision"
    INTERVAL = "an interval of values explains every decision: decisions that hold more than X assets would narrow it"
    SEVERAL = "several intervals of values explain every decision: more decisions would separate them"
    AT_BOUND = "the values that explain every decision reach the bounds given: widen these"
    UNEXPLAINED = (
        "no value explains every decision: were they rounded, is the cost of another kind, are bounds too tight?"
    )


@dataclass(frozen=True, eq=False, repr=False)
class LearnedCost(Summarised, Saved):
    """The values of a cost's parameter that explain every decision seen.

    Formula: {θ : for every u_t some π ∈ Δ makes u_t optimal under the cost θ}.

    Args:
        parameter: The value where it is identified, else the midpoint of the values; NaN where no value explains all decisions.
        intervals: Intervals outside of which no value explains every decision, in ascending order, shape (K,2).
        residual: Largest KKT residual of a decision at `parameter`, relative to the gradient's scale; negative where rounding
            leaves slack.
        status: Whether the parameter is identified, and what to do otherwise.
        rounding: Largest error of a coordinate of the decisions.
        family: The family of costs; None in a loaded result.

    Source: inverse optimisation with unknown objective and unknown beliefs; the paper's outlook in Section V.

    Example:
        >>> LearnedCost(2.0, np.array([[1.5, 2.5]]), 0.0, CostStatus.INTERVAL).is_identified
        False
    """

    parameter: float
    intervals: Array
    residual: float
    status: CostStatus
    rounding: float = 0.0
    family: CostFamily | None = field(default=None, repr=False, metadata={"saved": False})

    @property
    def is_identified(self) -> bool:
        """Whether exactly one value explains every decision."""
        return self.status == CostStatus.IDENTIFIED

    @property
    def interval(self) -> tuple[float, float]:
        """The least and the greatest value that may explain every decision; NaN where there is none."""
        if not len(self.intervals):
            return float("nan"), float("nan")
        return float(self.intervals[0, 0]), float(self.intervals[-1, 1])

    def contains(self, parameter: float) -> bool:
        """Return whether a value lies in one of the intervals."""
        return bool(((self.intervals[:, 0] <= parameter) & (parameter <= self.intervals[:, 1])).any())

    def consistent_beliefs(self, action: ArrayLike) -> UnionBeliefs:
        """Return the beliefs that explain a decision under some cost that explains every observed decision.

        Args:
            action: u, shape (U,), with the same rounding as the decisions learned from.

        Raises:
            InputError: The decision is not feasible, or this result was loaded and holds no cost.
        """
        if self.family is None:
            raise InputError("a loaded result has no costs: learn again")
        explained = self.family.explained(action, self.rounding)
        if explained.count != 1:
            raise InputError(f"action must be one decision, got {explained.count}")
        return UnionBeliefs(explained, self.intervals, self.family.problem.n_states)

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        listed = ", ".join(f"[{low:.7g}, {high:.7g}]" for low, high in self.intervals)
        return (
            f"parameter {self.parameter:.9g}\nintervals {listed or 'none'}\nresidual  {self.residual:.3g}\n"
            f"status    {self.status.value}"
        )


class UnionBeliefs:
    """The union of Π(u) over the costs that are still possible.

    Formula: {π ∈ Δ : ∃ θ in the intervals, λ ≥ 0, ν : G_θ(u)π + A_act'λ + A_eq'ν = 0}, which need not be convex.

    Args:
        explained: The decision, under the family of costs.
        intervals: The possible values of the parameter, shape (K,2).
        n_states: Number of states X.

    Source: the paper, Theorem 1, for every cost that is still possible.

    Example:
        >>> from inscrutable.adversaries import CostLearningAdversary
        >>> adversary = CostLearningAdversary.risk_aversion([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], (0.5, 2.0))
        >>> beliefs = adversary.learn([[0.55, 0.45]]).consistent_beliefs([0.55, 0.45])
        >>> beliefs.bounds().round(2).tolist(), beliefs.contains([0.75, 0.25])
        ([[0.75, 1.0], [0.0, 0.25]], True)
    """

    def __init__(self, explained: ExplainedDecisions, intervals: Array, n_states: int) -> None:
        self._explained = explained
        self.n_states = n_states
        self._intervals = intervals
        self._programmes = [explained.programme(low, high, 0) for low, high in pieces_of(intervals)]

    def __reduce__(self) -> tuple[object, ...]:
        """Return what another process makes the same set of."""
        return type(self), (self._explained, self._intervals, self.n_states)

    @property
    def is_empty(self) -> bool:
        """Whether no belief explains the decision under any of the costs."""
        return not any(each.residual() <= self._explained.tolerance for each in self._programmes)

    def contains(self, belief: ArrayLike) -> bool:
        """Return whether a belief (X,) explains the decision under one of the costs."""
        held = validation.one_belief(belief, self.n_states)
        return any(each.residual_of(held) <= self._explained.tolerance for each in self._programmes)

    def bounds(self) -> Array:
        """Return outer bounds of each state's probability, shape (X,2); NaN where the set is empty.

        The only error is the relaxation on each of 16 pieces of an interval.
        """
        limits = np.full((self.n_states, 2), np.nan)
        if not self._programmes:
            return limits
        for i, unit in enumerate(np.eye(len(limits))):
            most: Any = self._explained.tolerance
            limits[i, 0] = min(each.extreme(unit, most) for each in self._programmes)
            limits[i, 1] = -min(each.extreme(-unit, most) for each in self._programmes)
        return np.where(np.isfinite(limits), limits, np.nan)
