"""Inverse optimisation of one decision: the beliefs for which it is optimal."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances
from inscrutable.adversaries.plausibility import gap_compared
from inscrutable.errors import ModelError
from inscrutable.geometry import BeliefSet
from inscrutable.problems import DecisionProblem, SmoothForm, checked_problem
from inscrutable.validation import Array


def belief_set_of(problem: DecisionProblem, u: Array, tolerance: float = tolerances.EXPLAINED) -> BeliefSet:
    """Return the consistent beliefs of a decision (U,) that is known to be feasible."""
    explaining = problem.explaining_rows(u)
    if explaining is not None:
        equalities: Array = np.zeros((0, problem.n_states))
        inequalities = explaining
    else:
        form = smooth_form_of(problem)
        point, region = form.variables(u), form.constraints
        rows = region.stationarity(region.tight_rows(point))
        scaled = scaled_gradients(form.gradients(point[None]), region.equality_span, form.size)[0].T
        equalities, inequalities = rows.equalities @ scaled, rows.inequalities @ scaled
    gap = partial(gap_compared, problem, u)
    return BeliefSet(equalities, inequalities, tolerance, gap, problem.state_names)


def scaled_gradients(gradients: Array, common: Array, size: float) -> Array:
    """Return gradients (M,X,U) divided by their largest entry.

    The part along the equalities (orthonormal basis `common`, shape (U,e)) carries no information about the belief: where it
    dominates, the divisor is a thousand times the other part. Where terms of this `size` cancel, the remainder is rounding.
    Where the other part is rounding in all states, they have the same costs, and every belief explains the decision.
    """
    largest = np.abs(gradients).max(axis=(1, 2), initial=0.0)
    across = np.abs(gradients - gradients @ common @ common.T).max(axis=(1, 2), initial=0.0)
    scale = np.clip(tolerances.COMMON_COST * across, tolerances.LEAST_DIFFERENCE * largest, largest)
    scale = np.maximum(scale, tolerances.LEAST_DIFFERENCE * size)
    terms = np.maximum(largest, size)
    scale = np.where(across <= tolerances.STATIONARITY * terms, terms, scale)
    return np.asarray(gradients / np.where(scale > 0, scale, 1.0)[:, None, None])


def smooth_form_of(problem: DecisionProblem) -> SmoothForm:
    """Return the smooth form of a problem whose decisions are not explained row by row, or raise `ModelError`."""
    form = problem.without_common_costs.smooth_form()
    if form is None:
        raise ModelError(
            f"{problem!r} has neither a smooth form nor explaining rows, so that no belief set can be computed"
        )
    return form


def plausibility_gap(problem: DecisionProblem, action: ArrayLike) -> float:
    """Return r(u) = min_π ρ(π,u), the least regret of a decision under any belief (inverse-optimality gap).

    Formula: min_{π ∈ Δ} max_{v ∈ C} π·(s(u) − s(v)); zero exactly when some belief explains the decision.

    Args:
        problem: The decision problem.
        action: u, shape (U,), feasible.

    Returns:
        The gap, in the cost's unit, at least 0.

    Raises:
        InputError: `action` is not a feasible decision.
        ModelError: The problem has neither a smooth form nor `explaining_rows`.
        SolverError: The cutting planes did not converge.

    Cost: some tens of forward solves. Source: a detection statistic on top of the paper's Theorem 1.

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem(np.zeros((2, 2)), [np.eye(2), 2 * np.eye(2)], 1.0)
        >>> round(plausibility_gap(problem, [1.0, 0.0]), 6)
        0.5
    """
    u = checked_problem(problem).check_action(action)
    return belief_set_of(problem, u).plausibility_gap
