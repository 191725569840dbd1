"""Upper limits on an observer's long-run errors, from errors that may be correlated over time."""

from __future__ import annotations

import numpy as np
from scipy import optimize, special

from inscrutable.validation import Array

_REPLICATES = 999
_LEAST_TAIL = 10
"""Samples that are expected beyond the level of a limit: many secrets together have a level near one."""
_MOST_AT_ONCE = 2**22
"""Drawn blocks that are held in memory at once."""
_LEAST_BLOCKS = 10
_QUIET_LAGS = 5
"""Number of successive insignificant autocorrelations that end the memory of a series."""


def memory(series: Array) -> int:
    """Return the lag after which autocorrelations are insignificant, at least 0.

    Formula: the least m with |ρ(m+1)|, …, |ρ(m+5)| < 2 √(log10 n / n).
    Source: Politis, Adaptive bandwidth choice, Journal of Nonparametric Statistics 15 (2003).
    """
    apart = autocorrelations(series)
    bound = 2.0 * np.sqrt(np.log10(len(series)) / len(series))
    quiet = np.abs(apart[1:]) < bound
    for lag in range(len(quiet)):
        if quiet[lag : lag + _QUIET_LAGS].all():
            return lag
    return len(quiet)


def autocorrelations(series: Array) -> Array:
    """Return ρ(0), …, ρ(n/4) of a series (n,) by Fourier transform; 0 where it does not vary."""
    centred = series - series.mean()
    size = 2 ** int(np.ceil(np.log2(2 * len(series))))
    power = np.abs(np.fft.rfft(centred, size)) ** 2
    found = np.fft.irfft(power, size)[: len(series) // 4 + 1]
    return np.asarray(found / found[0] if found[0] > 0 else np.zeros_like(found))


def design_effect(series: Array) -> float:
    """Return the design effect: variance of the mean of a series over that of independent draws, at least 1.

    Formula: 1 + 2 Σ_k λ(k/2m) ρ(k), λ flat to ½ and then falling to 0 at 1, m the `memory`; values below 1 count as 1.
    """
    reach = memory(series)
    if reach == 0:
        return 1.0
    apart = autocorrelations(series)[1 : 2 * reach + 1]
    taper = np.minimum(1.0, 2.0 * (1.0 - np.arange(1, len(apart) + 1) / (2.0 * reach)))
    return max(1.0, float(1.0 + 2.0 * (taper * apart).sum()))


def share_limit(wrong: Array, level: float) -> float:
    """Return the Clopper–Pearson upper limit on the share of wrong rows, at the effective number of independent rows.

    Formula: the `level` quantile of Beta(k/D + 1, (n − k)/D), k of n rows wrong, D the `design_effect`.
    Source: Clopper and Pearson (1934); Korn and Graubard, Survey Methodology 24 (1998), for D.

    If each error has a probability of at least R given the past, the number of errors is stochastically larger than binomial,
    and with D = 1 the limit is below R with probability at most 1 − level.
    """
    worth = design_effect(wrong)
    count, right = float(wrong.sum()) / worth, float((1.0 - wrong).sum()) / worth
    return 1.0 if right <= 0 else float(special.betaincinv(count + 1.0, right, level))


def mean_limit(series: Array, level: float, rng: np.random.Generator) -> float:
    """Return the upper limit on the mean of losses by a studentised circular block bootstrap.

    Formula: mean − t s, t the 1 − level quantile of (mean* − mean)/s*, samples of blocks of b neighbouring rows, s² the
    variance of block means over their number; b the larger of n^(1/3) and the `memory`, at most n/10.
    Source: Götze and Künsch, Annals of Statistics 24 (1996).
    """
    rows = len(series)
    length = int(np.clip(max(round(rows ** (1.0 / 3.0)), memory(series)), 1, max(rows // _LEAST_BLOCKS, 1)))
    running = np.concatenate([[0.0], np.concatenate([series, series[: length - 1]]).cumsum()])
    means = (running[length : length + rows] - running[:rows]) / length
    n_blocks = rows // length
    centre = float(series.mean())
    spread = float(np.sqrt(((means - centre) ** 2).mean() / n_blocks))
    if not spread > 0:
        return centre
    count = max(_REPLICATES, _LEAST_TAIL * int(np.ceil(1.0 / (1.0 - level))) - 1)
    most = max(_MOST_AT_ONCE // n_blocks, 1)
    parts = [
        _deviations(means[rng.integers(rows, size=(min(most, count - first), n_blocks))], centre)
        for first in range(0, count, most)
    ]
    # An order statistic, not an interpolation: samples that do not vary are infinite.
    place = max(int(np.floor((1.0 - level) * (count + 1))) - 1, 0)
    return centre - float(np.partition(np.concatenate(parts), place)[place]) * spread


def _deviations(drawn: Array, centre: float) -> Array:
    """Return (mean* − mean)/s* of samples of blocks (R,n), 0 for a sample that is the mean throughout."""
    error = drawn.std(axis=1, ddof=1) / np.sqrt(drawn.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        deviation = (drawn.mean(axis=1) - centre) / error
    return np.where(np.isnan(deviation), 0.0, deviation)


def ratio_limit(series: Array, base: Array, level: float, rng: np.random.Generator) -> float:
    """Return the upper limit on the ratio of the mean losses of two observers in the same rows, at most 1.

    Formula: the ratio q at which the `mean_limit` of series − q·base is 0, the same rows being drawn for every q.
    Source: Fieller, Journal of the Royal Statistical Society B 16 (1954).
    """
    seed = int(rng.integers(2**32))

    def above(ratio: float) -> float:
        return mean_limit(series - ratio * base, level, np.random.default_rng(seed))

    if above(1.0) >= 0.0:
        return 1.0
    return 0.0 if above(0.0) <= 0.0 else float(optimize.brentq(above, 0.0, 1.0))
