"""The sensor fitted to steps of a filter, with its accuracy."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.sensor.groups import UNCLEAR, Groups, column_errors, grouped, moved
from inscrutable.adversaries.sensor.results import EstimatedSensor, SensorStatus
from inscrutable.adversaries.sensor.scales import Scales, scaled
from inscrutable.adversaries.sensor.steps import FilterSteps
from inscrutable.errors import InputError
from inscrutable.validation import Array

QUANTILE = 1.959963984540054
"""Quantile of the standard normal law for 95 % intervals."""

_SEPARATED = 3.0
"""A step's symbol is certain where the second nearest column is this many times as far off."""

_DOUBTFUL = 0.05
"""Share of doubtful steps from which symbols count as overlapping."""

_DROWNED = 0.5
"""Noise, relative to the differences between symbols' beliefs, from which symbols count as overlapping."""

_EXCESS = 6.0
"""Row sums this many standard deviations from one are not explained by noise."""


class SensorFit(NamedTuple):
    """A fitted sensor with its accuracy.

    Args:
        probabilities: Shape (X,Y).
        intervals: Shape (X,Y,2).
        groups: The steps by symbol.
        status: Whether the steps determine the sensor.
        residual: Largest distance of a belief from the filter's.
        noise: Standard deviation of a belief's error in any direction of the simplex.
        n_unseen: Number of last columns, of symbols never observed or of the same effect as others.
    """

    probabilities: Array
    intervals: Array
    groups: Groups
    status: SensorStatus
    residual: float
    noise: float
    n_unseen: int


def square(transition: Array) -> Array:
    """Return a transition (X,X), or raise `InputError`."""
    if transition.shape[0] != transition.shape[1]:
        raise InputError(f"transition has shape {transition.shape}, expected a square matrix (X,X)")
    return transition


def nothing_known(n_states: int, n_symbols: int, symbols: np.ndarray, status: SensorStatus) -> EstimatedSensor:
    """Return the uninformative sensor, with intervals [0, 1]."""
    even = np.full((n_states, n_symbols), 1.0 / n_symbols)
    return EstimatedSensor(even, symbols, 0.0, status, np.tile([0.0, 1.0], (n_states, n_symbols, 1)))


def fitted(steps: FilterSteps, n_symbols: int | None, groups: Groups | None = None) -> SensorFit:
    """Return the sensor fitted to steps, which may be grouped already, with at least one step per symbol."""
    found = _in_order(grouped(steps, n_symbols)) if groups is None else groups
    if groups is None and n_symbols is None:
        found = _without_jumps(steps, found)
    found = _with_unclear(steps, found) if groups is None else found
    used = found.symbols >= 0
    count = len(found.columns)
    noise = _noise(found, steps.held.shape[1])
    counts = np.bincount(found.symbols[used], minlength=count)
    errors = noise * column_errors(steps, found)
    n_unseen = 0 if n_symbols is None else n_symbols - count
    scales = scaled(found.columns, counts, errors, has_unseen=n_unseen > 0)
    excess = scales.excess
    if n_symbols is None and excess > _EXCESS:
        n_unseen, scales = 1, scaled(found.columns, counts, errors, has_unseen=True)
    sensor, spread = _filled(found.columns, errors, scales, n_unseen)
    shown = steps.shown(found.columns)
    residual = float(np.linalg.norm(steps.held[:, None] - shown, axis=2).min(axis=1).max())
    limits = np.clip(np.stack([sensor - QUANTILE * spread, sensor + QUANTILE * spread], axis=2), 0.0, 1.0)
    if groups is None and n_symbols is not None and n_unseen:
        limits[:, :, 0] = 0.0  # symbols with proportional columns are one group, which they share in any way
    status = _status(steps, found, scales, n_unseen, excess=excess, noise=noise)
    return SensorFit(sensor, limits, found, status, residual, noise, n_unseen)


def _noise(groups: Groups, n_states: int) -> float:
    """Standard deviation of a belief's coordinate, estimated from the residuals of grouped steps."""
    used = groups.symbols >= 0
    freedom = max(int(used.sum()) - len(groups.columns), 1) * max(n_states - 1, 1)
    return float(np.sqrt((groups.misses[used] ** 2).sum() / freedom))


def _without_jumps(steps: FilterSteps, groups: Groups) -> Groups:
    """Drop groups of a single step for which the other columns leave no probability: no filter makes such a step."""
    counts = np.bincount(groups.symbols[groups.symbols >= 0], minlength=len(groups.columns))
    often = np.flatnonzero(counts > 1)
    if not 0 < len(often) < len(counts):
        return groups
    places = np.full(len(counts) + 1, -1)  # the last one is that of -1
    places[often] = np.arange(len(often))
    rest = Groups(groups.columns[often], places[groups.symbols], groups.misses)
    errors = _noise(rest, steps.held.shape[1]) * column_errors(steps, rest)
    scales = scaled(rest.columns, counts[often], errors)
    return rest if scales.is_determined and scales.excess <= _EXCESS else groups


def _in_order(groups: Groups) -> Groups:
    """Number symbols in order of appearance; drop duplicate columns and columns without steps."""
    kept: list[int] = []
    target = {}
    for symbol in dict.fromkeys(groups.symbols[groups.symbols >= 0].tolist()):
        column = groups.columns[symbol]
        near = (
            j for j, known in enumerate(kept) if np.abs(groups.columns[known] - column).max() <= tolerances.SAME_BELIEF
        )
        target[symbol] = next(near, len(kept))
        if target[symbol] == len(kept):
            kept.append(symbol)
    symbols = np.array([target.get(int(each), each) for each in groups.symbols], dtype=np.int64)
    return Groups(groups.columns[kept], symbols, groups.misses)


def _with_unclear(steps: FilterSteps, groups: Groups) -> Groups:
    """Mark unclear steps; where they alone made up a group, the others are grouped again without them."""
    found = _marked(steps, groups)
    if len(found.columns) == len(groups.columns):
        return found
    clear = found.symbols != UNCLEAR
    again = grouped(steps.of(clear), len(groups.columns))
    symbols, misses = found.symbols.copy(), found.misses.copy()
    symbols[clear], misses[clear] = again.symbols, again.misses
    return _marked(steps, _in_order(Groups(again.columns, symbols, misses)))


def _marked(steps: FilterSteps, groups: Groups) -> Groups:
    """Mark the steps of exact beliefs in which two columns lead to beliefs no further apart than a few errors of the fit.

    Near a sure state rounding, or an error of the transition, decides which column is nearest. The belief before a step alone
    decides whether it is marked, and not its symbol, so that the frequencies of the other steps are not biased.
    """
    used = groups.symbols >= 0
    if _noise(groups, steps.held.shape[1]) > tolerances.EXACT_BELIEFS:
        return groups
    shown = steps.shown(groups.columns)
    error = np.linalg.norm(steps.held[used] - shown[used, groups.symbols[used]], axis=1).max()
    unclear = np.zeros(len(used), dtype=bool)
    for one, other in combinations(range(len(groups.columns)), 2):
        unclear |= np.linalg.norm(shown[:, one] - shown[:, other], axis=1) <= _SEPARATED * error
    if unclear[used].all():
        return groups
    return _in_order(groups._replace(symbols=np.where(used & unclear, UNCLEAR, groups.symbols)))


def _filled(columns: Array, errors: Array, scales: Scales, n_unseen: int) -> tuple[Array, Array]:
    """Return the sensor (X,Y), the missing probability shared among unseen symbols, and its standard deviations."""
    sensor = (columns * scales.factors[:, None]).T
    spread = np.hypot(columns * scales.spread[:, None], errors * scales.factors[:, None]).T
    if n_unseen:
        rest = scales.rest[:, None] / n_unseen
        sensor = np.column_stack([sensor, np.tile(rest, (1, n_unseen))])
        spread = np.column_stack([spread, np.tile(np.maximum(rest, 1.0 / len(rest)), (1, n_unseen))])
    sums = sensor.sum(axis=1, keepdims=True)
    known = sums[:, 0] > 0.0  # else the state is impossible in all beliefs, and its row is unknown
    sensor[known] /= sums[known]
    sensor[~known], spread[~known] = 1.0 / sensor.shape[1], 1.0
    return sensor, spread


def _status(
    steps: FilterSteps, groups: Groups, scales: Scales, n_unseen: int, *, excess: float, noise: float
) -> SensorStatus:
    count = len(groups.columns)
    if len(groups.outlying):
        return SensorStatus.INCONSISTENT
    if int((groups.symbols >= 0).sum()) <= count + n_unseen and count > 1:
        return SensorStatus.TOO_FEW_STEPS
    if n_unseen:
        return SensorStatus.TOO_FEW_SYMBOLS
    if excess > _EXCESS:
        return SensorStatus.INCONSISTENT
    if is_overlapping(steps, groups.columns, noise):
        return SensorStatus.OVERLAPPING
    return SensorStatus.IDENTIFIED if scales.is_determined else SensorStatus.SCALES_BY_FREQUENCY


def is_overlapping(steps: FilterSteps, columns: Array, noise: float) -> bool:
    """Whether the noise is too large to tell the symbols of columns (Y,X) apart."""
    return noise > tolerances.EXACT_BELIEFS and (_doubtful(steps, columns) > _DOUBTFUL or _drowned(steps, noise))


def _doubtful(steps: FilterSteps, columns: Array) -> float:
    """Return the share of steps that another symbol explains nearly as well."""
    if len(columns) < 2:
        return 0.0
    least, second = np.sort(steps.misses(columns), axis=1)[:, :2].T
    return float(np.mean(second <= _SEPARATED * least + tolerances.REACHED_BELIEF))


def _drowned(steps: FilterSteps, noise: float) -> bool:
    """Whether the noise is about as large as the distances between the beliefs after different symbols."""
    changes = float(np.sqrt(np.mean((steps.held - steps.predicted) ** 2)))
    return noise > _DROWNED * changes


def bootstrapped(steps: FilterSteps, fit: SensorFit, draws: int, rng: np.random.Generator) -> Array:
    """Return 95 % intervals (X,Y,2) from resampled steps, which keep their symbols."""
    used = np.flatnonzero(fit.groups.symbols >= 0)
    found = [
        again.probabilities
        for again in (_resampled(steps, fit, rng.choice(used, len(used))) for _ in range(draws))
        if again.probabilities.shape == fit.probabilities.shape
    ]
    return spanned([*found, fit.probabilities])


def spanned(tables: Sequence[Array]) -> Array:
    """Return the 95 % intervals (…,2) of the entries of several tables."""
    low, high = np.quantile(tables, [0.025, 0.975], axis=0)
    return np.stack([low, high], axis=-1)


def _resampled(steps: FilterSteps, fit: SensorFit, some: np.ndarray) -> SensorFit:
    """Return the fit of a resample of the steps; symbols without steps are left out."""
    return fitted(steps.of(some), None, regrouped(steps.of(some), fit.groups.symbols[some], fit.groups.columns))


def regrouped(steps: FilterSteps, symbols: np.ndarray, columns: Array) -> Groups:
    """Return steps with known symbols and their fitted columns, starting from first columns (Y,X)."""
    present, places = np.unique(symbols, return_inverse=True)
    found = np.array([moved(steps.of(places == j), columns[y]) for j, y in enumerate(present)])
    return Groups(found, places, steps.misses(found)[np.arange(len(places)), places])
