"""Trial decisions of a local search, judged a handful at a time: what they cost, whether they may be played, and Ψ."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import consistent_sets
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.geometry.hulls import kernel_limits, sum_zero_basis
from inscrutable.privacy import PrivacyMeasure
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem, QuadraticProblem, quadratic_problem
from inscrutable.validation import Array

_MOST_ACTIONS = 50
"""Beyond this many coordinates of a decision the plain definition, built on matrix products, is faster."""
_MOST_PATTERNS = 512


class Judgement(NamedTuple):
    """What is known about trials (n,U)."""

    privacies: Array  # (n,): −∞ outside the feasible set or, where that matters, where no belief explains the trial
    costs: Array  # (n,): π·s(u)
    slopes: Array  # (n, U): gradient of the cost
    admissible: np.ndarray  # (n,)


Judge = Callable[[Array], Judgement]
"""Judges trials (n,U) under one belief."""


def judge_for(problem: DecisionProblem, belief: Array, measure: PrivacyMeasure) -> Judge:
    """Return what judges trials (n,U) under a belief (X,): a kernel for distances under quadratic costs, else NumPy."""
    reference = measure.reference(belief)
    plain = DefinedJudge(problem, belief, measure)
    if reference is None or measure.judges_empty or problem.n_actions > _MOST_ACTIONS:
        return plain
    form, quadratic = problem.quadratic_form(), quadratic_problem(problem)
    if form is None or quadratic is None or form.lift is not None:
        return plain
    return QuadraticJudge(quadratic, belief, reference)


class DefinedJudge:
    """The definition, for every problem and measure."""

    def __init__(self, problem: DecisionProblem, belief: Array, measure: PrivacyMeasure) -> None:
        self._problem, self._belief, self._measure = problem, belief, measure
        self._far = tolerances.FEASIBILITY if measure.judges_empty else tolerances.FINITE_DIFFERENCE

    def __call__(self, trials: Array) -> Judgement:
        """Return the judgement of trials (n,U)."""
        problem, measure = self._problem, self._measure
        outside = problem.constraints.violation(trials)
        sets = consistent_sets(problem, trials)
        values = measure.values(self._belief, sets)
        privacies = values.privacies.copy()
        for index in np.flatnonzero(~values.exact & (outside <= self._far)):
            privacies[index] = measure(self._belief, sets[int(index)])
        if not measure.judges_empty:
            privacies[sets.dimension < 0] = -np.inf
        return Judgement(
            np.where(outside <= self._far, privacies, -np.inf),
            np.asarray(problem.state_costs(trials) @ self._belief),
            np.einsum("x,nxu->nu", self._belief, problem.cost_gradients(trials)),
            problem.constraints.is_admissible(trials),
        )


class QuadraticJudge:
    """The same for quadratic costs and measures that are ± a distance, in one kernel call."""

    def __init__(self, problem: QuadraticProblem, belief: Array, reference: Reference) -> None:
        from inscrutable.kernels import trials as kernel

        region, size = problem.constraints, problem.n_actions
        n_rows = len(region.b_ub)
        self._problem, self._point = problem, reference.point
        hessians, linear, constants = map(_own, (problem.hessians, problem.linear, problem.constants))
        least = tolerances.LEAST_DIFFERENCE * problem.smooth_form().size
        equal_scales = np.abs(region.A_eq).max(axis=1, initial=0.0)
        rows = (region.A_ub, region.b_ub, region.row_scale, region.A_eq, region.b_eq, equal_scales)
        self._fixed = (
            kernel.Costs(hessians, linear, constants, least),
            kernel.Region(*map(_own, rows)),
            kernel.Slack(region.observed_slack, tolerances.FEASIBILITY, float(region.min_slack)),
        )
        self._goal = kernel.Sought(
            _own(belief), _own(reference.point), float(reference.sign), tolerances.FINITE_DIFFERENCE
        )
        self._rest = (self._goal, sum_zero_basis(problem.n_states), kernel_limits(tolerances.EXPLAINED))
        self._patterns = kernel.Patterns(
            np.zeros((0, n_rows), dtype=np.bool_),
            np.zeros((0, 0, size)),
            np.zeros((0, 0, size)),
            np.zeros((0, 2), dtype=np.int64),
        )
        self._judged = kernel.Judged
        self._judge_trials, self._all = kernel.judge_trials, kernel.ALL

    def __call__(self, trials: Array) -> Judgement:
        """Return the judgement of trials (n,U)."""
        n, size = trials.shape
        found = Judgement(np.empty(n), np.empty(n), np.empty((n, size)), np.empty(n, dtype=np.bool_))
        tight = np.empty(self._patterns.tight.shape[1], dtype=np.bool_)
        judged = self._judged(found.costs, found.slopes, found.privacies, found.admissible, tight)
        held = np.ascontiguousarray(trials)
        answer = self._judge_trials(held, self._fixed, self._patterns, *self._rest, judged)
        while answer >= 0:
            self._learn(tight)
            answer = self._judge_trials(held, self._fixed, self._patterns, *self._rest, judged)
        if answer != self._all:
            for index in np.flatnonzero(np.isnan(found.privacies)):
                distance = belief_set_of(self._problem, held[index]).distance(self._point)
                found.privacies[index] = self._goal.sign * distance if np.isfinite(distance) else -np.inf
        return found

    def _learn(self, tight: np.ndarray) -> None:
        """Add a tight pattern to those the kernel knows."""
        from inscrutable.kernels.trials import Patterns

        rows = self._problem.constraints.stationarity(tight)
        known = self._patterns
        kept = len(known.tight) if len(known.tight) < _MOST_PATTERNS else 0
        counts = np.array([[len(rows.equalities), len(rows.inequalities)]])
        self._patterns = Patterns(
            np.vstack([known.tight[:kept], tight[None]]),
            _padded(known.residual_rows[:kept], rows.equalities),
            _padded(known.multiplier_rows[:kept], rows.inequalities),
            np.vstack([known.counts[:kept], counts]),
        )


def _own(values: Array) -> Array:
    """A writable copy in C order: one type, so that the kernel is compiled once."""
    return np.array(values, dtype=np.float64, order="C")


def _padded(stack: Array, rows: Array) -> Array:
    """The stack with one more member, all padded to the largest number of rows."""
    most = max(stack.shape[1], len(rows))
    wider = np.zeros((len(stack) + 1, most, rows.shape[1]))
    wider[:-1, : stack.shape[1]] = stack
    wider[-1, : len(rows)] = rows
    return wider
