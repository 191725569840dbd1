"""The best mixture of columns at an expected cost, for many rows at once: concave envelopes, two atoms each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class Envelopes:
    """Per row: the value, its slope in the budget, and two columns with the share of the dearer one."""

    values: Array  # (B,)
    prices: Array  # (B,)
    cheap: np.ndarray  # (B,)
    dear: np.ndarray  # (B,)
    share: Array  # (B,), of the dear column

    def rows(self, n_columns: int) -> Array:
        """Return the mixtures as rows of probabilities (B,M)."""
        rows = np.zeros((len(self.share), n_columns))
        each = np.arange(len(rows))
        np.add.at(rows, (each, self.cheap), 1.0 - self.share)
        np.add.at(rows, (each, self.dear), self.share)
        return rows


def row_envelopes(costs: Array, gains: Array, limits: Array, allowed: np.ndarray | None = None) -> Envelopes:
    """Return max Σ k gains with Σ k costs ≤ limit, Σ k = 1, for every row of (B,M); each row has an affordable column.

    Between a cheap and a dear column the price is their slope; the column that is best at that price replaces one of
    them, until none is better.
    """
    if allowed is not None:
        gains = np.where(allowed, gains, -np.inf)
        costs = np.where(allowed, costs, np.inf)
    rows = np.arange(len(limits))
    cheap = costs.argmin(axis=1)
    dear = gains.argmax(axis=1)
    finite = np.where(np.isfinite(costs), costs, 0.0)
    within = costs[rows, dear] <= limits
    cheap = np.where(within, dear, cheap)
    prices = np.zeros(len(limits))
    values = gains[rows, dear].copy()
    left = np.flatnonzero(~within)
    while left.size:
        low, high = cheap[left], dear[left]
        run = costs[left, high] - costs[left, low]
        price = np.maximum((gains[left, high] - gains[left, low]) / run, 0.0)
        reduced = gains[left] - price[:, None] * finite[left]
        best = reduced.argmax(axis=1)
        reached = gains[left, low] - price * costs[left, low]
        met = reduced[np.arange(left.size), best] <= reached + tolerances.ENVELOPE * (1.0 + np.abs(reached))
        prices[left], values[left] = price, reached + price * limits[left]
        over = costs[left, best] > limits[left]
        dear[left[~met & over]] = best[~met & over]
        cheap[left[~met & ~over]] = best[~met & ~over]
        left = left[~met]
    run = costs[rows, dear] - costs[rows, cheap]
    room = np.where(run > 0, limits - costs[rows, cheap], 0.0)
    share = np.clip(room / np.where(run > 0, run, 1.0), 0.0, 1.0)
    return Envelopes(values, prices, cheap, dear, share)
