"""Prices at which a sequential rule spends a long-run mean regret, found by simulating the observer's law.

Every trial draws the same random numbers, so that the mean regret depends on the price alone. The path of the observer's law
is drawn: u_t by its probability under p_t; no belief is drawn, and every step's mean regret is exact. Decisions that are
never disclosed are not simulated: they cost nothing and reveal nothing. The mean of p_t over all paths is the prior, so that
linear functions of p_t have known means: as control variates they reduce the standard error tenfold (Glasserman, Monte Carlo
Methods in Financial Engineering, 2003, section 4.1).
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from inscrutable import tolerances
from inscrutable.decision_makers.sequential.laws import ChainLaw
from inscrutable.decision_makers.sequential.prices import PriceCalibration, PriceStatus
from inscrutable.decision_makers.sequential.seen import Knowledge
from inscrutable.decision_makers.sequential.step import Prices, StepRule, StepTable
from inscrutable.errors import SolverError
from inscrutable.validation import Array

_LOGGER = logging.getLogger(__name__)

_SHARES = (float("inf"), 1.0, 0.3, 0.1, 0.03)
"""Prices of information that are tried, in units of the prior loss per nat; infinite: information alone counts. Prices 0.01
and 0 gain nothing (.138 and .137 against .137 on a resting chain of three states) and take three times as long as all
others."""
_PATHS = 2  # simulated at a time, on as many threads
_COARSE, _FINE, _LAST = 40, 150, 1000
"""Steps of each path: to compare prices, to find one, and to measure it. Of nine chains over markets one loses or gains up to
.8 % of the prior loss with 20 or 80 steps at first; with 75 next, one leaves 3 % of its budget, with 300 none gains over .2 %.
With 500 at last standard errors are a tenth larger, in .6 times the time, with 2,000 a fourth smaller, in 1.3 times."""
_BATCH = 50
"""Steps whose mean counts as one observation. On six chains of 28 beliefs that rest with .5 to .98 the stated errors of a mean
regret are .13 to .98 of the spread of 40 runs, with 17 steps .09 to .89, with 150 .18 to .97."""
_NEAR, _NARROW = 0.02, 1.02
"""Relative differences of regrets near enough, and of equal prices. With .01 or .05, and with 1.1, losses of four chains change
by .05 % at most."""
_MOST_TRIALS, _DOUBLINGS = 12, 24  # with 6 and 12 none of these chains changes


class PriceTrial(NamedTuple):
    """Long-run means at one price of regret; the loss is counted from the table's floor."""

    price: float
    regret: float
    regret_se: float
    loss: float
    loss_se: float
    bits: float


class _Market(NamedTuple):
    """Data that all trials share."""

    table: StepTable
    law: ChainLaw
    limit: float
    draws: Array  # (P,T) uniform numbers
    reads: Array | None = None  # (P,T,period) the same for the public symbols; None where nothing is public


def calibrated(
    table: StepTable, law: ChainLaw, limit: float, asked: float | None, rng: np.random.Generator
) -> PriceCalibration:
    """Return the prices of largest simulated loss whose simulated mean regret is the limit."""
    draws = rng.random((_PATHS, _LAST))
    reads = None if law.n_public is None else rng.random((*draws.shape, table.period))
    market = _Market(table, law, limit, draws, reads)
    silence, unit = _silence(table), table.unit
    if silence <= limit or not unit > 0:
        return _silent(market, float("inf") if asked is None else asked, silence)
    if np.isfinite(table.turnover):
        _check_turnover(market)
    prices = [share * unit for share in _SHARES] if asked is None else [asked]
    found = []
    for told in prices:
        try:
            found.append((told, *_bracket(market, told, silence, _COARSE)))
            _LOGGER.info(
                "information_price %.4g: the observer's mean loss is about %.4g", told, _loss_at(limit, *found[-1][1:])
            )
        except SolverError as error:
            if len(prices) == 1:
                raise
            _LOGGER.warning("information_price %.4g was left out of the comparison: %s", told, error)
    if not found:
        raise SolverError("no price of information gave steps that could be solved")
    found.sort(key=lambda each: _loss_at(limit, each[1], each[2]))
    while True:
        told, *ends = found.pop()
        try:
            long = _refined(market, told, (ends[0], ends[1]))
            return replace(long, loss=long.loss + table.floor)
        except SolverError as error:  # longer simulations may reach laws that short ones did not
            if not found:
                raise
            _LOGGER.warning("information_price %.4g was replaced by the next best: %s", told, error)


def _silent(market: _Market, told: float, silence: float) -> PriceCalibration:
    """The price at which decisions reveal nothing; public symbols make both regret and loss smaller, by simulation."""
    table, limit, alone = market.table, market.limit, np.isinf(told)
    price = tolerances.SILENT_PRICE / max(silence, np.finfo(float).tiny) * (1.0 if alone else max(table.unit, 1.0))
    if market.law.n_public is None or not table.unit > 0:
        trial = PriceTrial(price, min(silence, limit), 0.0, table.prior_loss - table.floor, 0.0, 0.0)
    else:
        trial = tried(market, Prices(price, told), _LAST)
    return replace(_made(limit, told, [trial]), loss=trial.loss + table.floor, status=PriceStatus.SILENT)


def _check_turnover(market: _Market) -> None:
    """Raise `SolverError` where the cheapest decision within reach of the last one costs more than the budget."""
    table, chain = market.table, market.law.chain
    moves = np.cumsum(sparse.csr_array(chain.transition).toarray(), axis=1)
    spent = np.empty(market.draws.shape)
    for path, draws in zip(spent, market.draws, strict=True):
        sums, kept = np.cumsum(chain.prior.weights), -1
        for t, draw in enumerate(draws):
            belief = min(int(np.searchsorted(sums, draw * sums[-1], side="right")), len(sums) - 1)
            near = table.within_reach(kept)
            kept = int(near[table.regrets[belief, near].argmin()])
            path[t], sums = table.regrets[belief, kept], moves[belief]
    batches = spent.reshape(-1, _BATCH).mean(axis=1)
    if batches.mean() - 3.0 * batches.std() / np.sqrt(len(batches)) > market.limit:
        raise SolverError(
            f"no rule was found that keeps the budget, a mean regret of {market.limit:.3g}: the cheapest decision within a "
            f"turnover of {table.turnover:g} of the last one costs {batches.mean():.3g} on average, by simulation. Take a "
            "larger budget or turnover, or do without the sequential rule (in a backtest: --no-sequential)"
        )


def _silence(table: StepTable) -> float:
    """The least mean regret a step of a constant value; infinite where the cap allows none to all beliefs."""
    regrets = table.regrets if table.allowed is None else np.where(table.allowed, table.regrets, np.inf)
    held = table.prior.weights > 0
    return float((table.prior.weights[held] @ regrets[held]).min()) / table.period


def tried(market: _Market, prices: Prices, n_steps: int) -> PriceTrial:
    """Return the means of a simulation."""
    rule = StepRule(market.table, prices)
    if market.law.is_still:  # nothing leaks after the first step
        step = rule.step(market.law.start())
        lost = step.loss - market.table.floor
        return PriceTrial(prices.regret, step.regret / market.table.period, 0.0, lost, 0.0, 0.0)
    with ThreadPoolExecutor(len(market.draws)) as pool:
        reads: Any = [None] * len(market.draws) if market.reads is None else market.reads[:, :n_steps]
        paths = list(pool.map(lambda *drawn: _followed(rule, market.law, *drawn), market.draws[:, :n_steps], reads))
    figures = np.concatenate(paths, axis=1)  # the law's first steps are anchors of the controls: nothing is left out
    values, controls = figures[:3], figures[3:]
    values = values - _slopes(controls, values).T @ controls
    count = max(figures.shape[1] // _BATCH, 2)
    batches = np.array([part.mean(axis=1) for part in np.array_split(values, count, axis=1)])
    errors = batches.std(axis=0, ddof=1) / np.sqrt(len(batches))
    # The floor is that of an observer without the public symbols: one who reads them may lose less.
    least = -np.inf if market.table.stakes.ignores_public else 0.0
    regret, loss, bits = np.maximum(values.mean(axis=1), [0.0, least, 0.0])
    if regret <= tolerances.COST_ROUNDING * np.abs(market.table.optimal_costs).max():
        regret = 0.0
    return PriceTrial(prices.regret, float(regret), float(errors[0]), float(loss), float(errors[1]), float(bits))


def _slopes(controls: Array, values: Array) -> Array:
    """Regression of values (V,T) on controls (C,T), shape (C,V); 0 where the law hardly moves and both are constant."""
    centred = controls - controls.mean(axis=1, keepdims=True)
    ridge = tolerances.STILL_CONTROL * controls.shape[1] * np.eye(len(controls))
    return np.asarray(np.linalg.solve(centred @ centred.T + ridge, centred @ values.T))


def _controls(table: StepTable) -> Array:
    """Functions of the belief of mean 0 and variance 1 under the prior, shape (C,B): coordinates, their products, and regrets
    of three decisions."""
    points = table.stakes.points
    first, second = np.triu_indices(points.shape[1])
    some = np.unique(np.linspace(0, table.n_values - 1, 3).astype(int))
    found = np.hstack([points, points[:, first] * points[:, second], table.regrets[:, some]])
    found = found - table.prior.weights @ found
    spread = np.sqrt(table.prior.weights @ found**2)
    return np.asarray((found / np.where(spread > 0.0, spread, 1.0)).T)


def _followed(rule: StepRule, law: ChainLaw, draws: Array, reads: Array | None) -> Array:
    """Mean regret, mean loss, bits and control variates of every disclosed step along the observer's path, shape (3+C,T)."""
    controls, stakes = _controls(rule.table), rule.table.stakes
    found = np.empty((3 + len(controls), len(draws)))
    state, kept, step, read = law.start(), -1, None, None
    passed: list[tuple[Array, int | None]] = []  # the law after every step, and the public symbol before it
    if reads is not None:
        read = law.drawn(state, float(reads[0, -1]))
        state = law.moved(state, read)
    for t, draw in enumerate(draws):
        step = rule.step(state, kept, step)
        found[:3, t] = (
            step.regret / rule.table.period,
            step.loss - stakes.floor(state),
            step.bits / rule.table.period,
        )
        found[3:, t] = controls @ state
        order = np.argsort(step.numbers)  # nearby laws then draw the same
        levels = step.played[order].cumsum()
        atom = order[min(int(np.searchsorted(levels, draw * levels[-1], side="right")), len(order) - 1)]
        kept = int(step.numbers[atom])
        state = law.seen(state, step.rows[:, atom])
        if reads is None:
            state = law.later(state, rule.table.period)
        else:
            for uniform in reads[(t + 1) % len(reads)]:
                passed.append((state, read))
                read = law.drawn(state, float(uniform))
                state = law.moved(state, read)
    if stakes.ignores_public:
        knowledge = Knowledge(law, rule.table.disclosure.schedule.lag, rule.table.loss)
        losses = np.array([knowledge.after(*each)[1] for each in passed])
        found[1] = losses.reshape(len(draws), -1).mean(axis=1) - rule.table.floor
    return found


def _bracket(market: _Market, told: float, silence: float, n_steps: int) -> tuple[PriceTrial, PriceTrial]:
    """Return trials with regrets above and below the limit; one trial twice where its regret is near enough."""
    unit = 1.0 if np.isinf(told) else market.table.unit + told
    price = unit / silence if np.isfinite(silence) else unit / market.limit
    low = high = None
    for _ in range(_DOUBLINGS):
        trial = tried(market, Prices(price, told), n_steps)
        if abs(trial.regret - market.limit) <= _NEAR * market.limit:
            return trial, trial
        if trial.regret > market.limit:
            low, price = trial, 2.0 * price
        else:
            high, price = trial, 0.5 * price
        if low is not None and high is not None:
            return _narrowed(market, told, (low, high), n_steps)
    assert low is not None or high is not None
    last = low if high is None else high
    return last, last  # type: ignore[return-value]


def _narrowed(
    market: _Market, told: float, ends: tuple[PriceTrial, PriceTrial], n_steps: int
) -> tuple[PriceTrial, PriceTrial]:
    """Narrow such a bracket by interpolation between the logarithms of regrets and prices."""
    low, high = ends
    for _ in range(_MOST_TRIALS):
        if high.price <= low.price * _NARROW:
            break
        trial = tried(market, Prices(_between(market.limit, low, high), told), n_steps)
        if abs(trial.regret - market.limit) <= _NEAR * market.limit:
            return trial, trial
        low, high = (trial, high) if trial.regret > market.limit else (low, trial)
    return low, high


def _between(limit: float, low: PriceTrial, high: PriceTrial) -> float:
    """The price where a line through the logarithms of two trials meets the limit."""
    share = np.log(low.regret / limit) / np.log(low.regret / max(high.regret, tolerances.SILENT_PRICE * low.regret))
    return float(low.price * (high.price / low.price) ** np.clip(share, 0.15, 0.85))


def _share(limit: float, low: PriceTrial, high: PriceTrial) -> float:
    """The probability of the lower price at which the mean regret is the limit."""
    return float(np.clip((limit - high.regret) / max(low.regret - high.regret, np.finfo(float).tiny), 0.0, 1.0))


def _loss_at(limit: float, low: PriceTrial, high: PriceTrial) -> float:
    if low is high:
        return low.loss * limit / low.regret if low.regret > limit else low.loss
    share = _share(limit, low, high)
    return share * low.loss + (1.0 - share) * high.loss


def _refined(market: _Market, told: float, ends: tuple[PriceTrial, PriceTrial]) -> PriceCalibration:
    """Return the calibration at a price of information, refined by long simulations."""
    if ends[0] is not ends[1]:  # the regret jumps over the limit
        low, high = (tried(market, Prices(each.price, told), _LAST) for each in ends)
        if low.regret > market.limit > high.regret:
            return _made(market.limit, told, [low, high])
    near, slope = _nearest(market.limit, ends), -1.0
    for n_steps, most in ((_FINE, 4), (_LAST, 5)):
        near, slope = _approached(market, Prices(near.price, told), slope, n_steps, most)
    return _met(_made(market.limit, told, [near]))


def _nearest(limit: float, trials: Sequence[PriceTrial]) -> PriceTrial:
    return min(trials, key=lambda each: abs(each.regret - limit))


def _approached(market: _Market, prices: Prices, slope: float, n_steps: int, most: int) -> tuple[PriceTrial, float]:
    """Return the trial of `n_steps` steps nearest to the limit, and the last slope d log regret / d log price.

    Trials of another length have another error, so that their regrets do not bracket the limit.
    """
    limit, trials = market.limit, list[PriceTrial]()
    low = high = None
    for _ in range(most):
        trial = tried(market, prices, n_steps)
        trials.append(trial)
        if abs(trial.regret - limit) <= max(tolerances.SPENDING_MET * limit, 0.5 * trial.regret_se):
            break
        low, high = (trial, high) if trial.regret > limit else (low, trial)
        slope = _slope(trials[-2], trial) if len(trials) > 1 else slope
        if low is not None and high is not None:
            price = _between(limit, low, high)
        elif trial.regret > 0:
            apart = np.log(max(limit, tolerances.TINY) / trial.regret) / slope
            price = trial.price * float(np.exp(np.clip(apart, *np.log([0.7, 1.4]))))
        else:
            break
        prices = prices._replace(regret=price)
    return _nearest(limit, trials), slope


def _met(found: PriceCalibration) -> PriceCalibration:
    """The same with its status; raises `SolverError` where the regret is above the budget."""
    apart, near = found.regret - found.budget, max(_NEAR * found.budget, 3.0 * found.regret_se)
    if apart > near:
        raise SolverError(
            f"no price was found at which the long-run mean regret is {found.budget:g}: it is {found.regret:g} at "
            f"{found.regret_prices[0]:g}; a larger budget or more candidates can be met"
        )
    if apart < -near:
        return replace(found, status=PriceStatus.BELOW)
    return found if abs(apart) <= _NEAR * found.budget else replace(found, status=PriceStatus.WITHIN_ERROR)


def _slope(one: PriceTrial, other: PriceTrial) -> float:
    """d log regret / d log price of two trials with the same draws; −1 where they are too near, or one is constant."""
    apart = np.log(other.price / one.price)
    if abs(apart) < tolerances.SAME_PRICES or not min(one.regret, other.regret) > 0:
        return -1.0
    return float(np.clip(np.log(other.regret / one.regret) / apart, -5.0, -0.3))


def _made(limit: float, told: float, trials: Sequence[PriceTrial]) -> PriceCalibration:
    if len(trials) == 1:
        shares, status = np.ones(1), PriceStatus.CALIBRATED
    else:
        share = _share(limit, *trials)
        shares, status = np.array([share, 1.0 - share]), PriceStatus.MIXED_PRICE
    means: dict[str, Any] = {
        name: float(shares @ [getattr(each, name) for each in trials]) for name in ("regret", "loss", "bits")
    }
    errors: dict[str, Any] = {
        name: float(np.sqrt(((shares * [getattr(each, name) for each in trials]) ** 2).sum()))
        for name in ("regret_se", "loss_se")
    }
    return PriceCalibration(
        np.array([each.price for each in trials]), told, shares, **means, **errors, budget=limit, status=status
    )
