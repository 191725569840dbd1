"""How times are taken: repeated, the cold first call apart, long loops cut short and said so."""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from benchmarks.table import seconds_text

PATIENCE = 60.0  # seconds


class Timing(NamedTuple):
    """A duration, how it was taken, and what the timed call returned last."""

    seconds: float
    how: str
    result: Any = None

    @property
    def text(self) -> str:
        """As it is printed."""
        return seconds_text(self.seconds, self.how)


def best_of(tries: int, call: Callable[[int], Any], *, patience: float = PATIENCE) -> Timing:
    """The least time of `call(0)`, `call(1)`, …, after a first `call(-1)` that is not counted; old results are freed.

    Once `patience` seconds are spent no further try is begun; if the first call alone takes them, it is the result.
    """
    begun = time.perf_counter()
    result = call(-1)
    spent = time.perf_counter() - begun
    if spent > patience:
        return Timing(spent, "first call", result)
    times: list[float] = []
    while len(times) < tries and (not times or time.perf_counter() - begun <= patience):
        result = None
        gc.collect()
        started = time.perf_counter()
        result = call(len(times))
        times.append(time.perf_counter() - started)
    return Timing(min(times), f"best of {len(times)}", result)


def median_of(call: Callable[[Any], Any], inputs: Iterable[Any]) -> Timing:
    """The median time of single calls, one for each input; the results are kept in order."""
    times, results = [], []
    for given in inputs:
        started = time.perf_counter()
        results.append(call(given))
        times.append(time.perf_counter() - started)
    return Timing(statistics.median(times), f"median of {len(times)}", results)


def loop(call: Callable[[int], Any], n: int, budget: float) -> Timing:
    """The time of `call(i)` for i = 0 … n−1, from four evenly placed runs of neighbours if all would exceed `budget` s.

    A run of neighbours keeps what a warm start is worth. The result is the indices done and what was returned.
    """
    call(0)
    started = time.perf_counter()
    call(1 % n)
    each = time.perf_counter() - started
    length = max(1, int(budget / each / 4))
    if 4 * length >= n:
        indices = np.arange(n)
    else:
        starts = np.linspace(0, n - length, 4).astype(int)
        indices = np.unique(np.concatenate([np.arange(start, start + length) for start in starts]))
    started = time.perf_counter()
    results = [call(int(i)) for i in indices]
    spent = (time.perf_counter() - started) * n / len(indices)
    how = "once" if len(indices) == n else f"extrapolated from {len(indices):,}"
    return Timing(spent, how, (indices, results))
