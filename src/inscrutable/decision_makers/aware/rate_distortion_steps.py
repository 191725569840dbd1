"""Blahut–Arimoto steps and the price of regret.

This module uses arrays alone. With q the law of the played columns and s ≥ 0 the price of regret in nats per unit, the best
rows for q are K_bm = q_m e^{−s d_bm} / z_b, z_b = Σ_m q_m e^{−s d_bm}; c_m = Σ_b p_b e^{−s d_bm} / z_b is how much more often
column m is then played than under q, and is at most 1 for the best law.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances
from inscrutable.validation import Array

_TINY = np.finfo(float).tiny
_MOST_SLOPES = 200  # against endless loops; with 66 36 curves do not change


@dataclass(frozen=True, eq=False)
class Source:
    """The data: weights p (B,), excess regrets d ≥ 0 (B,M) over each row's least, allowed places or None."""

    weights: Array
    excess: Array
    allowed: np.ndarray | None = None

    def kernel(self, slope: float) -> Array:
        """Return e^{−s d}, zero where a column is forbidden."""
        values = np.exp(-slope * self.excess)
        return values if self.allowed is None else values * self.allowed

    def some(self, columns: np.ndarray) -> Source:
        """Return the same with some of the columns."""
        allowed = None if self.allowed is None else np.ascontiguousarray(self.allowed[:, columns])
        return Source(self.weights, np.ascontiguousarray(self.excess[:, columns]), allowed)


def squared_cycle(kernel: Array, weights: Array, law: Array, target: float) -> tuple[Array, int]:
    """A squared cycle of Blahut–Arimoto: the law, and the steps taken, a single one where log max c was at most `target`."""
    first, value, top = _step(kernel, weights, law)
    if top <= target:
        return law, 1
    second, _, _ = _step(kernel, weights, first)
    move = first - law
    change = second - first - move
    length = max(1.0, float(np.linalg.norm(move)) / max(float(np.linalg.norm(change)), _TINY))
    ahead = law + 2.0 * length * move + length * length * change
    while length > 1.0 and ahead.min() < 0:
        length = 0.5 * (length + 1.0) if length > 1.1 else 1.0
        ahead = law + 2.0 * length * move + length * length * change
    ahead = np.maximum(ahead, 0.0)
    after, reached, _ = _step(kernel, weights, ahead / ahead.sum())
    return after if reached <= value else second, 3


def _step(kernel: Array, weights: Array, law: Array) -> tuple[Array, float, float]:
    """One Blahut–Arimoto step: the next law, −Σ p log z and log max c before it."""
    held = np.maximum(kernel @ law, _TINY)
    gains = (weights / held) @ kernel
    after = law * gains
    return after / after.sum(), float(-(weights @ np.log(held))), float(np.log(gains.max()))


def mean_regret(kernel: Array, spread: Array, weights: Array, law: Array) -> float:
    """Return the rows' mean excess regret, from the kernel and the kernel times the excess."""
    return float(weights @ ((spread @ law) / np.maximum(kernel @ law, _TINY)))


def meeting_slope(
    source: Source, law: Array, regret: float, slope: float, near: float = tolerances.REGRET_MET
) -> float:
    """Return the price at which the rows of a law cost at most `regret`, and hardly less; zero where it does not bind."""
    if np.isinf(regret):
        return 0.0
    used = np.flatnonzero(law > 0)
    if used.size < len(law):
        source, law = source.some(used), law[used]
    aim = regret * (1.0 - near)
    low, high = 0.0, np.inf
    for _ in range(_MOST_SLOPES):
        kernel = source.kernel(slope)
        held = np.maximum(kernel @ law, _TINY)
        kernel /= held[:, None]
        means, variance = moments(source, kernel, law)
        mean = float(source.weights @ means)
        if abs(mean - aim) <= near * regret or (slope == 0.0 and mean <= regret):
            return slope
        low, high = (slope, high) if mean > aim else (low, slope)
        step = slope + mean * np.log(mean / aim) / variance if mean > 0 and variance > 0 else np.nan
        if not low < step < high:
            step = 2.0 * max(low, _TINY) if np.isinf(high) else 0.5 * (low + high)
            step = 0.0 if low == 0.0 and high * regret < near else step
        if np.isfinite(high) and high - low <= 4 * np.finfo(float).eps * high:
            return high
        slope = float(step)
    return high if np.isfinite(high) else slope


def moments(source: Source, ratios: Array, law: Array) -> tuple[Array, float]:
    """Mean excess regret of every row K = q ∘ ratios (B,), and the mean of the rows' variances."""
    first = ratios * source.excess
    means = first @ law
    first *= source.excess
    return means, max(float(source.weights @ (first @ law - means**2)), 0.0)
