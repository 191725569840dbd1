"""Trial decisions of a local search, judged a handful at a time: what they cost, whether they may be played, and Ψ."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import consistent_sets
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class Judgement(NamedTuple):
    """What is known about trials (n,U)."""

    privacies: Array  # (n,): −∞ outside the feasible set or, where that matters, where no belief explains the trial
    costs: Array  # (n,): π·s(u)
    slopes: Array  # (n, U): gradient of the cost
    admissible: np.ndarray  # (n,)


class Judge:
    """Judges trials under one belief (X,), for every problem and measure."""

    def __init__(self, problem: DecisionProblem, belief: Array, measure: PrivacyMeasure) -> None:
        self._problem, self._belief, self._measure = problem, belief, measure
        self._far = tolerances.FEASIBILITY if measure.judges_empty else tolerances.FINITE_DIFFERENCE

    def __call__(self, trials: Array) -> Judgement:
        """Return the judgement of trials (n,U); a solver's trial that is not finite may not be played."""
        problem, measure = self._problem, self._measure
        is_finite = np.asarray(np.isfinite(trials).all(axis=1))
        trials = np.where(is_finite[:, None], trials, 0.0)
        outside = problem.constraints.violation(trials)
        sets = consistent_sets(problem, trials)
        values = measure.values(self._belief, sets)
        privacies = values.privacies.copy()
        for index in np.flatnonzero(~values.exact & (outside <= self._far)):
            privacies[index] = measure(self._belief, sets[int(index)])
        if not measure.judges_empty:
            privacies[sets.dimension < 0] = -np.inf
        return Judgement(
            np.where(is_finite & (outside <= self._far), privacies, -np.inf),
            np.where(is_finite, problem.state_costs(trials) @ self._belief, np.inf),
            np.einsum("x,nxu->nu", self._belief, problem.cost_gradients(trials)),
            is_finite & problem.constraints.is_admissible(trials),
        )
