"""The error, leakage and regret of a rule on private means, for one decision or per step."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from inscrutable import tolerances
from inscrutable.alphas.error_law import ErrorLaw, law_between, root_of
from inscrutable.alphas.factored_law import FactoredErrorLaw
from inscrutable.alphas.observed import Moves
from inscrutable.alphas.one_decision import least_information, most_error
from inscrutable.alphas.over_time import least_bits, most_error_over_time, share_between, told_exactly
from inscrutable.saved import saved_choice
from inscrutable.validation import Array


@saved_choice
class AlphaStatus(Enum):
    """Whether a rule on private means is optimal.

    Example:
        >>> AlphaStatus.SILENT.value
        'the budget pays for silence: the constant decision is played, and nothing leaks'
    """

    OPTIMAL = "optimal: no rule does better at this regret, up to the gap"
    BOUNDED = "its bound is further away than the gap: a rule that does a little better may exist"
    SILENT = "the budget pays for silence: the constant decision is played, and nothing leaks"
    AT_MOST = "with inequalities: it costs and leaks at most what is stated, and no ceiling is known"


@dataclass(frozen=True, eq=False)
class Plan:
    """A rule's law and its figures per step.

    Args:
        law: Covariances before and after a decision.
        regret: tr(ΘE).
        bits: Leakage of a decision about m.
        error: tr(QE).
        ceiling: The fewest bits, or the largest error, of any rule at this regret.
    """

    law: ErrorLaw | FactoredErrorLaw
    regret: float
    bits: float
    error: float
    ceiling: float


def plan_of_factors(law: FactoredErrorLaw, weights: Array | None) -> Plan:
    """Return the plan of least information at one decision about many alphas."""
    error = float(law.diagonal().sum()) if weights is None else float(np.sum(weights * law.covariance))
    return Plan(law, law.regret, law.bits, error, law.bits)


def plan_once(
    theta: Array, prior: Array, limit: float, weights: Array, is_error: bool, units: Array | None = None
) -> Plan:
    """Return the best plan for one decision; `units` as of `root_of`."""
    law = most_error(theta, prior, weights, limit, units) if is_error else least_information(theta, prior, limit, units)
    error = law.weighed(weights)
    return Plan(law, max(law.weighed(theta), 0.0), law.bits, error, error if is_error else law.bits)


def plan_over_time(moves: Moves, theta: Array, limit: float, weights: Array, is_error: bool) -> Plan:
    """Return the best stationary plan, in the subspace that the belief can reach, at a limit below the regret of silence."""
    units, scaled = np.ones(len(theta)) if moves.units is None else moves.units, moves.scaled()
    basis = scaled.reached()
    inside, into = scaled.within(basis), units[:, None] * basis
    costs, gains = into.T @ theta @ into, into.T @ weights @ into
    if not basis.shape[1]:
        return silent_plan(np.zeros_like(theta), theta, weights, is_error)
    if limit <= tolerances.COST_ROUNDING * float(np.sum(costs * inside.innovation)):  # lost in rounding
        found = told_exactly(inside, costs, gains if is_error else None)
    elif is_error:
        found = most_error_over_time(inside, costs, gains, limit)
    else:
        found = least_bits(inside, costs, limit)
    law = ErrorLaw(into @ found.law.basis, found.law.dual @ (basis / units[:, None]).T, found.law.shares)
    return Plan(law, found.regret, law.bits, law.weighed(weights), found.bound)


def silent_plan(silence: Array, theta: Array, weights: Array, is_error: bool, units: Array | None = None) -> Plan:
    """Return the silent plan: E is the error covariance of an observer without decisions; `units` as of `root_of`."""
    law = law_between(root_of(silence, units), silence)
    error = law.weighed(weights)
    return Plan(law, law.weighed(theta), 0.0, error, error if is_error else 0.0)


def gap_of(plan: Plan, is_error: bool) -> float:
    """Return the difference of a plan's figure and its bound, as a share of the larger."""
    return share_between(plan.error if is_error else plan.bits, plan.ceiling)


def is_met(gap: float) -> bool:
    """Return whether a gap counts as zero."""
    return gap <= tolerances.OVER_TIME_GAP
