"""The paper's five measures of privacy Ψ, functions of the true belief π and the consistent beliefs Π(u)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries import ConsistentSets
from inscrutable.errors import InputError
from inscrutable.geometry import BeliefSet
from inscrutable.validation import Array


class Values(NamedTuple):
    """Privacy of M decisions: exact where `exact`, else an upper bound."""

    privacies: Array
    exact: np.ndarray


class Reference(NamedTuple):
    """A measure that is ± the distance from a point to the consistent set."""

    point: Array
    sign: float


class PrivacyMeasure(ABC):
    """A map (belief, consistent set) → privacy, larger is better, −∞ where the goal is missed.

    The paper's five use only a set's distance, its gap and whether it holds another belief, so that they apply to
    `ImpliedViews` of a mean as well as to a `BeliefSet`; for `DesiredObfuscation` the target must then be a function.

    A subclass gives `__call__`; `values` may be overridden for many decisions at once.

    Source: the paper, Section III-C.

    Example:
        >>> class Entropy(PrivacyMeasure):
        ...     def __call__(self, belief, belief_set):
        ...         centre = belief_set.center()
        ...         return float(-(centre * np.log(centre)).sum())
        >>> half = BeliefSet(np.array([[1.0, -1.0]]), np.zeros((0, 2)))
        >>> round(Entropy()([1.0, 0.0], half), 4)
        0.6931
    """

    searches_actions: bool = False
    """Whether decisions that no belief explains can be best, so that decoys are not enough."""

    judges_empty: bool = False
    """Whether the measure is defined for empty sets, so that `on_empty` does not apply."""

    is_indicator: bool = False
    """Whether the only values are 0, the goal is met, and −∞; the cheapest decision is then the best."""

    @abstractmethod
    def __call__(self, belief: ArrayLike, belief_set: BeliefSet) -> float:
        """Return Ψ for the true belief (X,) and the naive observer's set."""

    def values(self, belief: Array, sets: ConsistentSets) -> Values:
        """Return Ψ of many decisions, shape (M,), exact or as upper bounds."""
        judged = {int(first): self(belief, sets[int(first)]) for first in np.unique(sets.distinct)}
        return Values(np.array([judged[int(first)] for first in sets.distinct]), np.ones(len(sets), dtype=bool))

    def exact_values(self, belief: Array, sets: ConsistentSets, wanted: np.ndarray) -> Array:
        """Return Ψ of many decisions, shape (M,): exact where `wanted` (M,), and −∞ for an empty set unless Ψ judges it."""
        privacies, exact = self.values(belief, sets)
        privacies = privacies.copy()
        unclear = np.flatnonzero(~exact & wanted)
        for first in np.unique(sets.distinct[unclear]):
            privacies[unclear[sets.distinct[unclear] == first]] = self(belief, sets[int(first)])
        return privacies if self.judges_empty else np.where(sets.dimension < 0, -np.inf, privacies)

    def reference(self, belief: Array) -> Reference | None:
        """Return the point and sign of a measure that is a distance, or None."""
        return None

    def upper_bound(self, belief: Array) -> float:
        """Return a number that Ψ cannot exceed for a true belief (X,)."""
        return 0.0 if self.is_indicator else float("inf")

    def least_distance(self) -> float | None:
        """Return the distance from the true belief at which the goal is met, or None where there is no such distance."""
        return None

    def at_step(self, step: int) -> PrivacyMeasure:
        """Return the measure in force at a step of a sequence."""
        return self

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"


class MaximalObfuscation(PrivacyMeasure):
    """Distance of the true belief from the consistent beliefs Π(u).

    Formula: Ψ(u) = dist(π, Π(u)) in the Euclidean norm, in [0, √2]; +∞ for an empty set.

    Cost: one projection. Source: the paper, Section III-C, measure (e) and eq. (14).

    Example:
        >>> point = BeliefSet(np.array([[1.0, -1.0]]), np.zeros((0, 2)))
        >>> round(MaximalObfuscation()([1.0, 0.0], point), 4)
        0.7071
    """

    def __call__(self, belief: ArrayLike, belief_set: BeliefSet) -> float:
        """Return dist(π, Π)."""
        return belief_set.distance(belief)

    def values(self, belief: Array, sets: ConsistentSets) -> Values:
        """Return dist(π, Π) of many decisions; for sets of dimension two and more the distance to a member."""
        return Values(sets.bounds(belief), sets.dimension < 2)

    def reference(self, belief: Array) -> Reference:
        """Return the true belief and the sign +1: privacy grows with the distance."""
        return Reference(belief, 1.0)

    def upper_bound(self, belief: Array) -> float:
        """Return the distance to the farthest corner of the simplex."""
        return float(np.linalg.norm(belief - np.eye(belief.size), axis=1).max())


class DesiredObfuscation(PrivacyMeasure):
    """Closeness of the consistent beliefs to a belief of the agent's choice.

    Formula: Ψ(u) = −dist(π^d, Π(u)), in [−√2, 0]; −∞ for an empty set.

    Args:
        target: π^d as (X,), one per step as (T,X), or a function belief → belief.

    Raises:
        InputError: The target is not a belief, or a step beyond the last row is asked for.

    Cost: one projection. Source: the paper, Section III-C, measure (d).

    Example:
        >>> point = BeliefSet(np.array([[1.0, -1.0]]), np.zeros((0, 2)))
        >>> DesiredObfuscation([0.5, 0.5])([1.0, 0.0], point)
        0.0
    """

    def __init__(self, target: ArrayLike | Callable[[Array], ArrayLike]) -> None:
        if callable(target):
            self.target: Array | Callable[[Array], ArrayLike] = target
        else:
            points = validation.finite_array(target, "target", ndim=(1, 2))
            if not points.size:
                raise InputError(f"target has shape {points.shape}, expected at least one belief")
            self.target = validation.beliefs(points, points.shape[-1], "target")

    def __repr__(self) -> str:
        target = self.target
        named = getattr(target, "__name__", "function") if callable(target) else target.tolist()
        return f"DesiredObfuscation({named})"

    def target_for(self, belief: Array) -> Array:
        """Return π^d for a true belief (X,)."""
        if callable(self.target):
            return validation.beliefs(self.target(belief), belief.size, "target")
        if self.target.ndim != 1:
            raise InputError(
                f"the target has one belief for each of {len(self.target)} steps: call decide_many, which uses them in order"
            )
        return validation.beliefs(self.target, belief.size, "target")

    def targets_for(self, beliefs: Array) -> Array:
        """Return π^d for the true beliefs (T,X) of a path, shape (T,X)."""
        if not callable(self.target) and self.target.shape == (beliefs.shape[1],):
            return np.broadcast_to(self.target, beliefs.shape)
        targets = [self.at_step(step).target_for(belief) for step, belief in enumerate(beliefs)]  # type: ignore[attr-defined]
        return np.array(targets)

    def at_step(self, step: int) -> PrivacyMeasure:
        """Return the measure with the target of one step."""
        if callable(self.target) or self.target.ndim == 1:
            return self
        if step >= len(self.target):
            raise InputError(f"the target has {len(self.target)} steps, step {step} was asked for")
        return DesiredObfuscation(self.target[step])

    def __call__(self, belief: ArrayLike, belief_set: BeliefSet) -> float:
        """Return −dist(π^d, Π)."""
        point = belief_set.point(belief)
        target = belief_set.point(self.target(point), "target") if callable(self.target) else self.target_for(point)
        return 0.0 - belief_set.distance(target)  # not −0.0 at the target

    def values(self, belief: Array, sets: ConsistentSets) -> Values:
        """Return −dist(π^d, Π) of many decisions, exactly."""
        return Values(0.0 - sets.distances(self.target_for(belief)), np.ones(len(sets), dtype=bool))

    def upper_bound(self, belief: Array) -> float:
        """Return 0, reached where the target is in the set."""
        return 0.0

    def reference(self, belief: Array) -> Reference:
        """Return the target and the sign −1: privacy falls with the distance."""
        return Reference(self.target_for(belief), -1.0)


class NonExistence(PrivacyMeasure):
    """Whether the true belief is absent from the consistent beliefs.

    Formula: Ψ(u) = 0 if dist(π, Π(u)) ≥ margin (or > 0 at margin 0), −∞ otherwise; an empty set counts as absence.

    Args:
        margin: Least distance, dimensionless, at least 0. The paper has 0, which an arbitrarily small change of the decision
            meets.

    Raises:
        InputError: The margin is negative or not finite.

    Cost: one projection. Source: the paper, Section III-C, measure (c).

    Example:
        >>> point = BeliefSet(np.array([[1.0, -1.0]]), np.zeros((0, 2)))
        >>> NonExistence()([0.5, 0.5], point)
        -inf
    """

    judges_empty = True
    is_indicator = True

    def __init__(self, margin: float = tolerances.NON_EXISTENCE_MARGIN) -> None:
        self._margin = validation.non_negative(margin, "margin")

    @property
    def margin(self) -> float:
        """The margin, fixed at construction."""
        return self._margin

    def __call__(self, belief: ArrayLike, belief_set: BeliefSet) -> float:
        """Return 0 if the true belief misses the set by the margin, else −∞."""
        return float(self._reached(np.asarray(belief_set.distance(belief))))

    def __repr__(self) -> str:
        return f"NonExistence(margin={self.margin:g})"

    def least_distance(self) -> float:
        """Return the margin."""
        return max(self.margin, tolerances.SAME_BELIEF)

    def _reached(self, distances: Array) -> Array:
        # At margin 0 a distance of rounding size is membership.
        return np.where(distances >= self.least_distance(), 0.0, -np.inf)

    def values(self, belief: Array, sets: ConsistentSets) -> Values:
        """Return 0 or −∞ for many decisions; for sets of dimension two and more by the distance to a member."""
        bounds = self._reached(sets.bounds(belief))
        return Values(bounds, (sets.dimension < 2) | np.isneginf(bounds))


class NonUniqueness(PrivacyMeasure):
    """Whether the consistent beliefs contain a belief other than the true one.

    Formula: Ψ(u) = 0 if ∃ z ∈ Π(u) with z ≠ π, −∞ otherwise; as written it does not ask for π ∈ Π(u).

    Cost: the set's corners. Source: the paper, Section III-C, measure (b).

    Example:
        >>> segment = BeliefSet(np.array([[1.0, -1.0, 0.0]]), np.zeros((0, 3)))
        >>> NonUniqueness()([0.5, 0.5, 0.0], segment)
        0.0
    """

    is_indicator = True

    def __call__(self, belief: ArrayLike, belief_set: BeliefSet) -> float:
        """Return 0 if the set holds another belief, else −∞."""
        return 0.0 if belief_set.holds_another(belief) else -np.inf

    def values(self, belief: Array, sets: ConsistentSets) -> Values:
        """Return 0 or −∞ for many decisions."""
        other = (sets.dimension >= 2) | ((sets.dimension >= 0) & (sets.apart(belief) > tolerances.SAME_BELIEF))
        return Values(np.where(other, 0.0, -np.inf), sets.dimension < 2)


class Infeasibility(PrivacyMeasure):
    """Whether no belief explains the decision; an observer can detect that.

    Formula: Ψ(u) = 0 if r(u) = min_π ρ(π,u) ≥ margin, −∞ otherwise.

    Args:
        margin: Least plausibility gap, in the cost's unit, at least 0. The paper has 0 (Π(u) = ∅).

    Raises:
        InputError: The margin is negative or not finite.

    Cost: the plausibility gap, some tens of forward solves. Source: the paper, Section III-C, measure (a).

    Example:
        >>> nothing = BeliefSet(np.array([[1.0, 0.5]]), np.zeros((0, 2)), gap=lambda enough: 0.2)
        >>> Infeasibility(margin=0.1)([0.5, 0.5], nothing)
        0.0
    """

    searches_actions = True
    judges_empty = True
    is_indicator = True

    def __init__(self, margin: float = tolerances.INFEASIBILITY_MARGIN) -> None:
        self._margin = validation.non_negative(margin, "margin")

    @property
    def margin(self) -> float:
        """The margin, fixed at construction."""
        return self._margin

    def __repr__(self) -> str:
        return f"Infeasibility(margin={self.margin:g})"

    def __call__(self, belief: ArrayLike, belief_set: BeliefSet) -> float:
        """Return 0 if the set is empty by the margin, else −∞."""
        if not belief_set.is_empty:
            return -np.inf
        return 0.0 if self.margin == 0 or belief_set.gap_reaches(self.margin) else -np.inf

    def values(self, belief: Array, sets: ConsistentSets) -> Values:
        """Return 0 as an upper bound for empty sets, −∞ for the others."""
        empty = sets.dimension < 0
        return Values(np.where(empty, 0.0, -np.inf), ~empty | (self.margin == 0))
