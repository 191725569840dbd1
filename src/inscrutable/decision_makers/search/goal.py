"""The regret allowed under a belief, how far it reaches along rays and steps, and the privacy of decisions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import consistent_sets
from inscrutable.geometry.crossings import farthest
from inscrutable.privacy import MaximalObfuscation, PrivacyMeasure
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class Judgement(NamedTuple):
    """Privacy, regret and admissibility of decisions (n,U)."""

    privacies: Array  # (n,): −∞ outside the feasible set or, where that matters, where no belief explains the decision
    regrets: Array  # (n,): not cut off at zero; ∞ where a decision is not finite
    admissible: np.ndarray  # (n,)


@dataclass(frozen=True)
class Goal:
    """A problem, a belief, an allowed regret, and a privacy to make large."""

    problem: DecisionProblem
    belief: Array
    limit: float
    optimal_cost: float
    measure: PrivacyMeasure = field(default_factory=MaximalObfuscation)

    def regrets(self, actions: Array) -> Array:
        """Return ρ(π,u) of decisions (…,U), not cut off at zero."""
        return np.asarray(self.problem.state_costs(actions) @ self.belief - self.optimal_cost)

    def along_rays(self, optimal: Array, ends: Array, accuracy: float) -> tuple[Array, Array]:
        """Return the longest affordable shares (n,) of the ways to beliefs (n,X), and the decisions there (n,U).

        `accuracy` is the share of the root of the limit that may stay unspent.
        """

        def decided(which: np.ndarray, shares: Array) -> Array:
            mixed = np.maximum(self.belief + shares[:, None] * (ends[which] - self.belief), 0.0)
            return self.problem.solve_points(mixed / mixed.sum(axis=1, keepdims=True))

        return self._along(decided, np.tile(optimal, (len(ends), 1)), accuracy)

    def along_steps(self, start: Array, steps: Array, accuracy: float) -> Array:
        """Return the longest affordable shares (n,) of steps (n,U) from an affordable decision (U,)."""

        def moved(which: np.ndarray, shares: Array) -> Array:
            return np.asarray(start + shares[:, None] * steps[which])

        return self._along(moved, np.tile(start, (len(steps), 1)), accuracy, min(accuracy, tolerances.POLISH))[0]

    def _along(
        self,
        way: Callable[[np.ndarray, Array], Array],
        kept: Array,
        accuracy: float,
        width: float = tolerances.POLISH,
    ) -> tuple[Array, Array]:
        """Return the longest affordable shares of paths from decisions `kept` (n,U), and the last affordable decisions."""

        def excess(which: np.ndarray, shares: Array) -> Array:
            actions = way(which, shares)
            values = self._excess(actions)
            kept[which[values <= 0]] = actions[values <= 0]
            return values

        spare = accuracy * float(np.sqrt(self.limit))
        return farthest(excess, self._excess(kept), spare=spare, width=width), kept

    def _excess(self, actions: Array) -> Array:
        """√ρ − √limit with the sign of ρ − limit to the last digit: both over the sum of the roots."""
        regrets = self.regrets(actions)
        roots = np.sqrt(np.maximum(regrets, 0.0)) + np.sqrt(self.limit)
        return np.asarray((regrets - self.limit) / np.maximum(roots, tolerances.TINY))

    @cached_property
    def reference(self) -> Reference:
        """The point and the sign of a measure that follows ± a distance."""
        reference = self.measure.reference(self.belief)
        assert reference is not None, "only measures that follow a distance are searched on rays"
        return reference

    def judged(self, actions: Array, *, explained: bool = False) -> Judgement:
        """Return the judgement of decisions (n,U), each by itself; one that is not finite is not admissible.

        With `explained` what no belief explains has the privacy −∞, whatever the measure says of it.
        """
        problem, measure = self.problem, self.measure
        is_finite = np.asarray(np.isfinite(actions).all(axis=1))
        actions = np.where(is_finite[:, None], actions, 0.0)
        # Finite differences step a little outside the feasible set; where decisions are unexplained that may change Ψ.
        far = tolerances.FEASIBILITY if measure.judges_empty else tolerances.FINITE_DIFFERENCE
        inside = is_finite & (problem.constraints.violation(actions) <= far)
        sets = consistent_sets(problem, actions)
        privacies = measure.exact_values(self.belief, sets, inside)
        if explained:
            privacies = np.where(sets.dimension < 0, -np.inf, privacies)
        return Judgement(
            np.where(inside, privacies, -np.inf),
            np.where(is_finite, self.regrets(actions), np.inf),
            is_finite & problem.is_admissible(actions),
        )
