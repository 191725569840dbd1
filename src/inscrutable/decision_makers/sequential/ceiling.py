"""An upper bound of every causal rule: the one-shot loss with the long-run law as the prior.

V1(r) = max_K {E L : E ρ ≤ r} is jointly concave in r and the prior, so that the mean loss of any rule whose decisions are
disclosed exactly and at once is at most V1 of its mean regret. Any price s and estimates μ bound it:

    V1(r) ≤ Σ_b p_b max_m (g_b(μ_m) − s ρ_bm) + s r,

g_b(μ) = |x_b − μ|², or the cost of mixed answers to a rival.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.aware.stackelberg_answers import least_tempting_answer, matrix_game
from inscrutable.decision_makers.sequential.stakes import Stakes
from inscrutable.decision_makers.sequential.step import Prices, Step, StepRule, StepTable
from inscrutable.errors import SolverError
from inscrutable.validation import Array

_MOST_PRICES = 24
"""At most eight are needed in 24 chains over markets; with six, twelve bounds are up to .02 % of the prior loss larger."""
_MOST_ROUNDS = 20
"""Rounds in which a rival's answers to decisions of probability 0 are added; two or three are usual."""
_FORBIDDEN = 1_000_000.0
"""Price of a decision that a cap forbids, in units of the prior loss: with 100 and 1e9 none of 15 bounds under caps changes."""
_INSIDE = 0.1
"""Share of the way between two prices that a new one keeps from either. With less these 24 take as many steps; with .2, two
bounds are up to .02 % of the prior loss larger; with .5, five up to .06 %, in 1.2 times the steps."""
_LAST_PRICE = 0.1
"""Price of information of the last step, in least prices of a rule, from whose estimates the bound is taken. With the least
price itself, 40 bounds on three to eight beliefs are 2e-4 of the prior loss above the largest loss, at most 4e-4; with this
one 2e-5, at most 7e-5."""
_BESIDE = 0.95
"""Factor to the next price where a step was not solved: none of 162 in these 24."""


class _Line(NamedTuple):
    """The step at a price, and the line below the bounds at all prices: E L + s (r − E ρ) of that step."""

    price: float
    step: Step
    limit: float

    @property
    def slope(self) -> float:
        """r − E ρ."""
        return self.limit - self.step.regret

    def at(self, price: float) -> float:
        """Return what no bound at a price can be less than."""
        return self.step.loss + self.slope * price

    def meeting(self, other: _Line) -> float:
        """Return the price at which two lines of different slopes meet."""
        return (other.step.loss - self.step.loss) / (self.slope - other.slope)


def ceiling_of(table: StepTable, limit: float) -> float:
    """Return a bound on the mean loss at a mean regret, for rules on the table's decisions."""
    silence = float((table.prior.weights @ table.regrets).min())
    rounding = tolerances.COST_ROUNDING * float(np.abs(table.optimal_costs).max())
    if silence <= limit + rounding or not table.unit > 0:
        return table.prior_loss
    best = _best_price(table, limit, table.unit / silence)
    if best is None:
        return table.prior_loss
    last = _step(table, best.price, _LAST_PRICE * tolerances.LEAST_INFORMATION_PRICE)
    return min(table.prior_loss, bound_at(table, best.price, limit, last or best.step))


def _best_price(table: StepTable, limit: float, price: float) -> _Line | None:
    """The least line at the price that it was found at, from a first price; None where no step was solved."""
    best: _Line | None = None
    low: _Line | None = None
    high: _Line | None = None
    for _ in range(_MOST_PRICES):
        step = _step(table, price)
        if step is None:
            price *= _BESIDE
            continue
        found = _Line(price, step, limit)
        if best is None or found.at(price) < best.at(best.price):
            best = found
        low, high = (found, high) if found.slope < 0 else (low, found)
        if low is None or high is None:
            price *= 2.0 if high is None else 0.5
            continue
        price = low.meeting(high)
        if best.at(best.price) - low.at(price) <= tolerances.CEILING_GAP * table.unit:
            break
        edge = _INSIDE * (high.price - low.price)
        price = float(np.clip(price, low.price + edge, high.price - edge))
    return best


def _step(table: StepTable, price: float, least: float = tolerances.LEAST_INFORMATION_PRICE) -> Step | None:
    """The step at a price of regret and the least price of information; None where it is not solved."""
    try:
        return StepRule(table, Prices(price, 0.0), least).step(table.prior.weights)
    except SolverError:
        return None


def bound_at(table: StepTable, price: float, limit: float, step: Step) -> float:
    """Return the bound at a price, with the estimates of a step at that price."""
    stakes, estimates = _all_estimates(table, step, price)
    worth = stakes.gains(estimates) - price * table.regrets
    if table.allowed is not None:
        worth = np.where(table.allowed, worth, -np.inf)
    return float(table.prior.weights @ (worth.max(axis=1) + table.stakes.spare)) + price * limit


def _all_estimates(table: StepTable, step: Step, price: float) -> tuple[Stakes, Array]:
    """Estimates after all decisions, and the stakes that they are of.

    Those of decisions of probability 0 are the ones with the largest least reduced cost.
    """
    stakes, numbers, estimates = step.stakes, step.numbers, step.estimates
    levels = (stakes.gains(estimates) - price * table.regrets[:, numbers]).max(axis=1)
    offers = stakes.base[:, None] - price * table.regrets - levels[:, None]
    if table.allowed is not None:
        offers = np.where(table.allowed, offers, -_FORBIDDEN * table.unit)
    offers[table.prior.weights < tolerances.UNHEARD_BELIEF] = (
        -_FORBIDDEN * table.unit
    )  # what tempts them counts nothing
    if stakes.width:
        stakes, estimates, found = _mixed_answers(stakes, estimates, -offers, tolerances.CEILING_GAP * table.unit)
    else:
        from inscrutable.decision_makers.aware.stackelberg_solver import least_tempting

        found = least_tempting(stakes.points, offers, tolerances.LEAST_TEMPTING * table.unit)
    found[numbers] = estimates
    return stakes, np.asarray(found)


def _mixed_answers(stakes: Stakes, some: Array, paid: Array, near: float) -> tuple[Stakes, Array, Array]:
    """Stakes, the mixed answers `some` (n,d) in their coordinates, and those to every decision (M,d) of the largest least
    reduced cost.

    Where one of these and of the pure answers leaves no belief a negative reduced cost, it is taken; else they are mixed by a
    linear programme. A rival with infinitely many answers then adds its best ones to the beliefs that are still tempted by
    more than `near`, until there are none.
    """
    for _ in range(_MOST_ROUNDS):
        pool = np.unique(np.vstack([some, stakes.pure]), axis=0)
        gains = stakes.gains(pool) - stakes.base[:, None]
        worst, which = least_tempting_answer(gains, paid)
        found: Array = pool[which]
        tempted = list[Array]()
        for m in np.flatnonzero(worst > 0.0):
            share, worth, law = matrix_game(gains, paid[:, m])
            found[m] = share @ pool
            if worth > near:
                tempted.append(law)
        more = stakes.joined(np.array(tempted).T, near) if tempted else None
        if more is None:
            break
        stakes, some = more, more.widened(some, stakes.width)
    return stakes, some, found
