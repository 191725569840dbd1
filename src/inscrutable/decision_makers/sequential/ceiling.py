"""What no causal rule can exceed: the loss of one shot with the long-run law as the prior.

V1(r) = max_K {E L : E ρ ≤ r} is concave in r and in the prior together, so that the mean loss of any rule whose decisions are
seen exactly and at once is at most V1 of its mean regret. Any price s and estimates μ bound it:

    V1(r) ≤ Σ_b p_b max_m (|x_b − μ_m|² − s ρ_bm) + s r.
"""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.sequential.step import Prices, StepRule, StepTable
from inscrutable.errors import SolverError
from inscrutable.validation import Array

_PRICES = 24
_RANGE = 64.0
_FORBIDDEN = 1_000_000.0
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def ceiling_of(table: StepTable, limit: float) -> float:
    """Return a bound on the mean loss at a mean regret, for rules on the table's decisions."""
    law = table.prior.weights
    silence = float((law @ table.regrets).min())
    unit = table.prior_loss
    if silence <= limit or not unit > 0:
        return unit
    low, high = np.log(unit / silence / _RANGE), np.log(unit / silence * _RANGE)
    best = unit
    inner = [high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)]
    values = [_bound(table, float(np.exp(each)), limit) for each in inner]
    for _ in range(_PRICES):  # convex in the price
        best = min(best, *values)
        if values[0] < values[1]:
            high, inner[1], values[1] = inner[1], inner[0], values[0]
            inner[0] = high - _GOLDEN * (high - low)
            values[0] = _bound(table, float(np.exp(inner[0])), limit)
        else:
            low, inner[0], values[0] = inner[0], inner[1], values[1]
            inner[1] = low + _GOLDEN * (high - low)
            values[1] = _bound(table, float(np.exp(inner[1])), limit)
    return min(best, *values)


def _bound(table: StepTable, price: float, limit: float) -> float:
    """The bound at a price, with the estimates of the step of the least price of information."""
    law, points = table.prior.weights, table.points
    try:
        step = StepRule(table, Prices(price, 0.0)).step(law)
    except SolverError:
        return np.inf
    estimates = _all_estimates(table, step.numbers, step.estimates, price)
    squares = (points**2).sum(axis=1)[:, None] - 2.0 * points @ estimates.T + (estimates**2).sum(axis=1)
    worth = squares - price * table.regrets
    if table.allowed is not None:
        worth = np.where(table.allowed, worth, -np.inf)
    return float(law @ worth.max(axis=1)) + price * limit


def _all_estimates(table: StepTable, numbers: np.ndarray, estimates: Array, price: float) -> Array:
    """Estimates after all decisions: of those that are not played the ones that tempt least."""
    from inscrutable.decision_makers.aware.stackelberg_solver import least_tempting

    points = table.points
    squares = (points**2).sum(axis=1)[:, None]
    played = squares - 2.0 * points @ estimates.T + (estimates**2).sum(axis=1) - price * table.regrets[:, numbers]
    levels = played.max(axis=1)
    offers = squares - price * table.regrets - levels[:, None]
    if table.allowed is not None:
        offers = np.where(table.allowed, offers, -_FORBIDDEN * table.prior_loss)
    found = least_tempting(points, offers, tolerances.LEAST_TEMPTING * table.prior_loss)
    found[numbers] = estimates
    return np.asarray(found)
