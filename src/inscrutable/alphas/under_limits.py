"""The simulated cost of hiding a private mean under inequalities, and the rule that spends a budget.

Under inequalities the regret of deciding for m̂ is at most (m̂ − m)'Θ(m̂ − m), because weights at a limit do not move. A rule
with tr(ΘE) above the budget may therefore cost at most the budget.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.alphas.error_law import root_of, sizes_of
from inscrutable.alphas.problem import AlphaProblem
from inscrutable.alphas.risk import FactorRisk
from inscrutable.errors import SolverError
from inscrutable.validation import Array

_MOST_LIMITS = 40
_LEAST_FITTED = 30
"""Draws from which a control variate is fitted. With 5 and 10, .63 and .74 of 300 means of silence lay within two errors."""


class SimulatedRegret(NamedTuple):
    """A simulated mean regret per step, its standard error, and the regret of silence with the same draws."""

    mean: float
    standard_error: float
    silence: float = float("nan")


def drawn_means(prior: Array | FactorRisk, draws: int, rng: np.random.Generator) -> Array:
    """Return draws of m − m̄ with covariance S, shape (draws,k)."""
    if not isinstance(prior, FactorRisk):
        root = root_of(prior, sizes_of(prior))[0]
        return np.asarray(rng.standard_normal((draws, root.shape[1])) @ root.T)
    root = root_of(prior.factor_covariance, sizes_of(prior.factor_covariance))[0]
    common = rng.standard_normal((draws, root.shape[1])) @ root.T @ prior.exposures.T
    return np.asarray(common + np.sqrt(prior.specific) * rng.standard_normal(common.shape))


def simulation(problem: AlphaProblem, means: Array) -> Callable[[Array, float], SimulatedRegret]:
    """Return a function of estimates (T,k) and tr(ΘE) that gives their mean regret for means (T,k), at most tr(ΘE).

    The control variate is (m̂ − m)'Θ(m̂ − m), whose mean is tr(ΘE) and which is the regret itself where no limit is reached. The
    optima for the means are solved for once.
    """
    alphas, gamma = problem.alphas(means), problem.risk_aversion

    def costs(estimates: Array) -> Array:
        actions = problem.optimum(estimates)
        return np.asarray(gamma * problem.risk.quadratic(actions.T) - (alphas * actions).sum(axis=1))

    least = costs(means)

    def simulated(estimates: Array, most: float) -> SimulatedRegret:
        regrets, errors = costs(estimates) - least, estimates - means
        bounds = (errors * problem.theta_times(errors.T).T).sum(axis=1)
        shift, apart, count = float(bounds.mean()) - most, bounds - bounds.mean(), len(bounds)
        square = max(float(apart @ apart), tolerances.TINY)
        slope = float(apart @ regrets) / square
        is_free = np.abs(regrets - bounds).max() <= tolerances.FEASIBILITY * bounds.max()  # no draw reaches a limit
        # A mean regret is above zero, however the line through few draws goes.
        if (count < _LEAST_FITTED and not is_free) or slope * shift >= float(regrets.mean()):
            error = regrets.std(ddof=1) / np.sqrt(count)
            return SimulatedRegret(min(float(regrets.mean()), most), float(error))
        left = regrets - slope * (bounds - most)
        error = left.std(ddof=2) * np.sqrt(1.0 / count + shift**2 / square)  # the slope's own error too
        return SimulatedRegret(min(float(left.mean()), most), float(error))

    return simulated


def spending(
    cost: Callable[[float], SimulatedRegret], target: float, most: float, at_most: SimulatedRegret
) -> tuple[float, SimulatedRegret]:
    """Return the limit on tr(ΘE) at which the simulated regret is the target, and that regret.

    Args:
        cost: Function of the limit that returns the simulated regret, at most the limit, from the same draws at every limit.
        target: The regret to spend, above zero and below that of silence.
        most: tr(ΘE) of silence.
        at_most: The simulated regret of silence.

    Raises:
        SolverError: The search found no limit that spends the target.
    """
    found = cost(target)
    limit, low, high, below, above = target, target, most, found.mean - target, at_most.mean - target
    for _ in range(_MOST_LIMITS):
        if abs(found.mean - target) <= tolerances.SIMULATED_SPENT * target:
            return limit, found
        limit = low - below * (high - low) / (above - below)  # regula falsi, Illinois
        found = cost(limit)
        apart = found.mean - target
        if apart > 0.0:
            high, above, below = limit, apart, below * 0.5
        else:
            low, below, above = limit, apart, above * 0.5
    raise SolverError(f"no limit was found at which the simulated regret is {target:g}; pass more draws")
