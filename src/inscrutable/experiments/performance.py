"""Performance of a sequence of portfolios: returns, turnover, cost, and an interval for a difference of Sharpe ratios.

Nothing is annualised silently: a `Frequency` names the factor, and every annual figure says that it was used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.errors import InputError
from inscrutable.validation import Array

REPLICATES = 2000
"""Bootstrap samples: the 95 % quantile then has a simulation error below one percentage point of coverage."""

LEVEL = 0.95
"""Coverage asked of an interval."""

_BLOCK_OF_WORK = 4_000_000


class Frequency(NamedTuple):
    """The frequency of rows, as a count per year and as a word."""

    per_year: float
    word: str

    @property
    def step(self) -> str:
        """The word as that of a model's step; a few days need not hold a weekend."""
        return "trading day" if self.word == "day" else self.word


_KNOWN = (
    (0.9, 4.5, Frequency(252.0, "trading day")),
    (4.5, 10.0, Frequency(52.0, "week")),
    (26.0, 36.0, Frequency(12.0, "month")),
    (80.0, 100.0, Frequency(4.0, "quarter")),
    (350.0, 380.0, Frequency(1.0, "year")),
)
_DAY = 0.9, 1.2  # days between rows of seven a week, of which some are missing; five a week are 1.4 apart on average
_HOUR = 0.9 / 24, 1.1 / 24


def frequency_of(dates: pd.DatetimeIndex) -> Frequency:
    """Return the number of rows per year, from the median distance of the dates.

    252 for trading days, 365.25 for days with weekends, 52 for weeks, 12 for months, 4 for quarters, 1 for years; other
    distances d give 365.25 / d, below a day with the mean of d, which counts the nights.

    Args:
        dates: At least two dates, increasing.

    Raises:
        InputError: Fewer than two dates.

    Example:
        >>> frequency_of(pd.date_range("2020-01", periods=24, freq="ME"))
        Frequency(per_year=12.0, word='month')
    """
    if len(dates) < 2:
        raise InputError(f"{len(dates)} dates do not determine how often a row comes; expected at least 2")
    apart = np.diff(dates.to_numpy()) / np.timedelta64(1, "D")
    days, mean = float(np.median(apart)), float(apart.mean())
    if days <= _DAY[0]:
        return Frequency(365.25 / mean, "hour" if _HOUR[0] < days <= _HOUR[1] else "period")
    if mean <= _DAY[1] and {5, 6} <= set(dates.day_of_week):
        return Frequency(365.25, "day")
    for low, high, frequency in _KNOWN:
        if low < days <= high:
            return frequency
    return Frequency(365.25 / days, "period")


@dataclass(frozen=True, eq=False)
class Performance:
    """Returns of one sequence of portfolios, before and after the cost of trading.

    Formula: annual return (Π(1 + r_t))^(n/T) − 1, annual volatility s(r) √n, annual Sharpe ratio mean(e)/s(e) √n with
    e_t = r_t − riskless_t, n rows per year, s the sample standard deviation (divisor T − 1). The factor √n assumes returns
    uncorrelated in time (Lo, Financial Analysts Journal 58, 2002).

    Args:
        gross: Simple return of each row, shape (T,), as a fraction.
        net: The same after the cost of the trades that set up the portfolio, shape (T,).
        traded: Bought plus sold to set up the portfolio, shape (T,), as a fraction of wealth.
        riskless: Return of the riskless asset over the same rows, shape (T,); zeros if none is given.
        frequency: Rows a year.

    Example: see `track_portfolios`.
    """

    gross: Array
    net: Array
    traded: Array
    riskless: Array
    frequency: Frequency

    def annual_return(self, *, net: bool = False) -> float:
        """Return the compound return per year as a fraction."""
        grown = float(np.prod(np.maximum(1.0 + self._returns(net), 0.0)))  # what is ruined stays so
        return float(grown ** (self.frequency.per_year / len(self.gross)) - 1.0)

    def volatility(self, *, net: bool = False) -> float:
        """Return the standard deviation of the returns, scaled to a year, as a fraction."""
        return float(self._returns(net).std(ddof=1) * np.sqrt(self.frequency.per_year))

    def sharpe_ratio(self, *, net: bool = False) -> float:
        """Return the Sharpe ratio of the excess returns, scaled to a year; NaN where they do not vary."""
        return sharpe_ratio(self.excess(net=net)) * float(np.sqrt(self.frequency.per_year))

    def excess(self, *, net: bool = False) -> Array:
        """Return the returns in excess of the riskless ones, shape (T,)."""
        return np.asarray(self._returns(net) - self.riskless)

    @cached_property
    def turnover(self) -> float:
        """Purchases plus sales per year, as a fraction of wealth; without the first purchase."""
        later = self.traded[1:]
        return float(later.mean() * self.frequency.per_year) if len(later) else 0.0

    def _returns(self, net: bool) -> Array:
        return self.net if net else self.gross


def track_portfolios(
    weights: ArrayLike,
    returns: ArrayLike,
    frequency: Frequency,
    *,
    cost: float = 0.0,
    riskless: ArrayLike | None = None,
) -> Performance:
    """Return the performance of portfolios that are each held over one row of returns and then traded into the next.

    Formula: r_t = w_t·R_t; the weights drift to w_t (1 + R_t)/(1 + r_t) while they are held, so the next portfolio
    trades q_{t+1} = Σ |w_{t+1} − drifted w_t| (bought plus sold); net return (1 + r_t)(1 − cost·q_t) − 1. The first purchase
    does not count (q_0 = 0): it is the same for every investor who starts from cash.

    Args:
        weights: w_t, shape (T,U), published before the return of row t is known.
        returns: R_t, shape (T,U), simple returns earned over row t, fractions.
        frequency: Rows a year.
        cost: Cost per unit traded as a fraction of it, at least 0; 0.001 is ten basis points.
        riskless: Riskless return over each row, shape (T,); None is zero.

    Raises:
        InputError: Shapes disagree, fewer than two rows, an entry is not finite, a negative cost.

    Cost: O(T U).

    Example:
        >>> monthly = Frequency(12.0, "month")
        >>> held = track_portfolios([[1.0, 0.0], [0.5, 0.5]], [[0.1, 0.0], [0.0, 0.2]], monthly, cost=0.01)
        >>> held.gross.round(4).tolist(), held.traded.round(4).tolist(), held.net.round(4).tolist()
        ([0.1, 0.1], [0.0, 1.0], [0.1, 0.089])
    """
    held = validation.finite_array(weights, "weights", ndim=2)
    moves = validation.finite_array(returns, "returns", ndim=2)
    if held.shape != moves.shape or len(held) < 2:
        raise InputError(f"weights {held.shape} and returns {moves.shape} must have one shape (T,U) with T >= 2")
    rate = validation.non_negative(cost, "cost")
    base = np.zeros(len(held)) if riskless is None else validation.finite_array(riskless, "riskless", ndim=1)
    if base.shape != (len(held),):
        raise InputError(f"riskless has {base.size} entries, expected one per row: {len(held)}")
    gross = (held * moves).sum(axis=1)
    grown = held * (1.0 + moves)
    wealth = 1.0 + gross[:, None]
    # After a total loss there is no wealth to drift or trade.
    drifted = np.divide(grown, wealth, out=held.copy(), where=wealth > 0)
    traded = np.concatenate([[0.0], np.abs(held[1:] - drifted[:-1]).sum(axis=1)])
    return Performance(gross, (1.0 + gross) * (1.0 - rate * traded) - 1.0, traded, base, frequency)


_ROUNDINGS = 8.0  # units of rounding of 1 + r by which constant excess returns may differ


def sharpe_ratio(excess: Array) -> float:
    """Return mean over sample standard deviation of excess returns (T,), per row; NaN where they vary by rounding alone."""
    if np.ptp(excess) <= _ROUNDINGS * np.finfo(np.float64).eps:
        return float("nan")
    return float(np.mean(excess) / np.std(excess, ddof=1))


class SharpeDifference(NamedTuple):
    """Difference of two Sharpe ratios, per row of returns, and an interval for it."""

    difference: float
    low: float
    high: float


def sharpe_difference(
    first: ArrayLike,
    second: ArrayLike,
    *,
    rng: np.random.Generator,
    block: int | None = None,
    replicates: int = REPLICATES,
    level: float = LEVEL,
) -> SharpeDifference:
    """Return SR(first) − SR(second) with a studentised circular block bootstrap interval.

    Formula: Δ ± q s(Δ), q the `level` quantile of |Δ* − Δ|/s(Δ*) over samples made of blocks of b neighbouring rows
    of both series, and s by the delta method: with g_t the influence of row t on Δ, s² is the mean square of the sums
    of g over blocks of b rows, divided by b T (for the data over all circular blocks, which is the Bartlett kernel;
    for a sample over the blocks drawn). The interval is therefore valid under fat tails and under correlation, of the two
    series and in time up to b rows.

    Args:
        first: Excess returns, shape (T,).
        second: Excess returns of the same rows, shape (T,).
        rng: Source of the samples.
        block: b, at least 1; None is the nearest whole number to T^(1/3).
        replicates: Number of samples, at least 1.
        level: Coverage, between 0 and 1.

    Returns:
        The difference (standard deviations with divisor T − 1) and the interval, per row; multiply by √n for a year.
        NaN where one of the series does not vary.

    Raises:
        InputError: The series differ in length, have fewer than two rows or entries that are not finite.

    Cost: O(replicates · T). Source: Ledoit and Wolf, Journal of Empirical Finance 15 (2008), Section 3.2.2.

    Example:
        >>> draw = np.random.default_rng(0)
        >>> base = draw.normal(0.01, 0.04, 240)
        >>> found = sharpe_difference(base + 0.01, base, rng=draw)
        >>> found.low < found.difference < found.high
        True
    """
    if np.shape(first) != np.shape(second) or len(np.shape(first)) != 1 or np.size(first) < 2:
        shapes = f"{np.shape(first)} and {np.shape(second)}"
        raise InputError(f"expected two series of one length of at least 2, got shapes {shapes}")
    both = np.stack([validation.finite_array(series, "returns", ndim=1) for series in (first, second)])
    validation.generator(rng)
    validation.count(replicates, "replicates")
    if not 0.0 < validation.number_of(level, "level") < 1.0:
        raise InputError(f"level must be between 0 and 1, got {level:g}")
    rows = both.shape[1]
    length = round(rows ** (1.0 / 3.0)) if block is None else min(validation.count(block, "block"), rows)
    difference = sharpe_ratio(both[0]) - sharpe_ratio(both[1])
    if not np.isfinite(difference):
        return SharpeDifference(float("nan"), float("nan"), float("nan"))
    if np.array_equal(both[0], both[1]):
        return SharpeDifference(0.0, 0.0, 0.0)
    centre, influence = _influence(both[:, None, :])
    around = _block_sums(np.concatenate([influence[0], influence[0, : length - 1]])[None], length, 1)
    error = float(np.sqrt((around**2).mean() / (length * rows)))
    deviations = _studentised(both, float(centre[0]), length, replicates, rng)
    # An order statistic, not an interpolation: samples that do not vary are infinite. Two rows vary by their signs alone.
    reach = float(np.sort(deviations)[int(np.ceil(level * replicates)) - 1]) * error if error > 0 else 0.0
    reach = reach if rows > 2 else np.inf
    return SharpeDifference(difference, difference - reach, difference + reach)


def _influence(series: Array) -> tuple[Array, Array]:
    """Return Δ of pairs of series (2,N,T) with divisor T, shape (N,), and the influence of every row on it, (N,T)."""
    mean = series.mean(axis=2, keepdims=True)
    spread = series.std(axis=2, keepdims=True)
    # NaN where a series does not vary; the caller counts such samples.
    with np.errstate(divide="ignore", invalid="ignore"):
        score = (series - mean) / spread
        ratio = mean / spread
        # d(μ/σ) = dμ/σ − (μ/2σ³) dσ²: with the row's score z and the ratio Δ, this is z − ½ Δ (z² − 1).
        own = score - 0.5 * ratio * (score**2 - 1.0)
        return np.asarray((ratio[0] - ratio[1])[:, 0]), np.asarray(own[0] - own[1])


def _block_sums(series: Array, length: int, step: int) -> Array:
    """Sums over the whole blocks of `length` columns that begin at every `step`-th column."""
    running = np.concatenate([np.zeros((len(series), 1)), series.cumsum(axis=1)], axis=1)
    first = np.arange(0, series.shape[1] - length + 1, step)
    return np.asarray(running[:, first + length] - running[:, first])


def _studentised(both: Array, centre: float, length: int, replicates: int, rng: np.random.Generator) -> Array:
    """|Δ* − Δ|/s(Δ*) of the bootstrap samples; a sample in which a series does not vary counts as infinite."""
    rows = both.shape[1]
    blocks = -(-rows // length)
    found = np.empty(replicates)
    at_once = max(1, _BLOCK_OF_WORK // rows)
    for start in range(0, replicates, at_once):
        count = min(at_once, replicates - start)
        first = rng.integers(rows, size=(count, blocks, 1))
        chosen = ((first + np.arange(length)) % rows).reshape(count, -1)[:, :rows]
        value, influence = _influence(both[:, chosen])
        sums = _block_sums(influence, length, length)
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.sqrt((sums**2).mean(axis=1) / (length * rows))
            deviation = np.abs(value - centre) / error
        found[start : start + count] = np.where(np.isfinite(deviation), deviation, np.inf)
    return found
