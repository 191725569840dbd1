"""The least rate to high accuracy: a primal–dual interior-point method on the law of few columns.

This module uses arrays alone. G(q) = max_{s ≥ 0} −Σ_b p_b log Σ_m q_m e^{−s d_bm} − s r is convex, and G(q) + Σ q over q ≥ 0
has its minimum at a law of least rate. On the central path 1 − c_m = t / q_m > 0, so that the bound holds as it is and the gap
is t times the number of columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.aware.rate_distortion_steps import Source, meeting_slope, moments
from inscrutable.validation import Array

_MOST_STEPS = 60
"""With 180, the steps of 23 curves from 21 by 36 to 136 by 136 are the same; with 20, two rates change within the gap."""
_TO_BOUNDARY = 0.95
"""Share of the way to the boundary that a step goes at most. With .8 these curves take 1.1 times as long, with .99 as long."""
_TINY = np.finfo(float).tiny


@dataclass(eq=False)
class _Point:
    """A law with the price that meets the budget there, and the quantities of Newton's step."""

    law: Array
    slope: float
    ratios: Array  # e^{−s d} / z, (B,m)
    value: float  # G
    gains: Array  # c, (m,)
    turn: Array  # ∂c/∂s, (m,), negative
    variance: float


def newton_law(source: Source, regret: float, law: Array, slope: float, goal: float) -> tuple[Array, float, int]:
    """Return a law with log max c ≤ goal [nats] on these columns, its price, and the steps taken."""
    n = len(law)
    point = _at(source, regret, law, slope)
    centre = max(goal, float(np.log(point.gains.max()))) / n
    duals = centre / point.law
    for step in range(_MOST_STEPS):
        if np.log(point.gains.max() * point.law.sum()) <= goal:  # c of the law that is returned, whose sum is one
            return point.law / point.law.sum(), point.slope, step
        hessian = _hessian(source, point)
        hessian[np.diag_indices(n)] += duals / point.law
        slopes = point.gains - 1.0 + centre / point.law
        move = np.asarray(np.linalg.solve(hessian, slopes), dtype=np.float64)
        change = centre / point.law - duals - duals / point.law * move
        length, dual_length = _longest(point.law, move), _longest(duals, change)
        ahead = _searched(source, regret, point, (move, length), centre)
        if ahead is None:
            break
        point = ahead
        duals = duals + dual_length * change
        mean = float(point.law @ duals) / n
        centre = max(mean * (0.1 if min(length, dual_length) > 0.7 else 0.4), 0.15 * goal / n)
    return point.law / point.law.sum(), point.slope, _MOST_STEPS


def _at(source: Source, regret: float, law: Array, slope: float) -> _Point:
    slope = meeting_slope(source, law, regret, slope, tolerances.REGRET_NEAR)
    kernel = source.kernel(slope)
    held = np.maximum(kernel @ law, _TINY)
    kernel /= held[:, None]
    value = float(-(source.weights @ np.log(held)))
    if slope <= 0.0:
        return _Point(law, 0.0, kernel, value, source.weights @ kernel, np.zeros(len(law)), 1.0)
    means, variance = moments(source, kernel, law)
    turn = (source.weights * means) @ kernel - source.weights @ (kernel * source.excess)
    return _Point(law, slope, kernel, value - slope * regret, source.weights @ kernel, turn, variance)


def _hessian(source: Source, point: _Point) -> Array:
    scaled = point.ratios * np.sqrt(source.weights)[:, None]
    hessian = scaled.T @ scaled
    if point.variance > 0:
        hessian += np.outer(point.turn, point.turn / point.variance)
    return np.asarray(hessian)


def _longest(values: Array, move: Array) -> float:
    down = move < 0
    if not down.any():
        return 1.0
    return min(1.0, _TO_BOUNDARY / float((-move[down] / values[down]).max()))


def _searched(source: Source, regret: float, point: _Point, step: tuple[Array, float], centre: float) -> _Point | None:
    """Halve the step until the barrier function falls; None where it no longer does."""
    move, length = step
    before = point.value + point.law.sum() - centre * np.log(point.law).sum()
    while length > tolerances.NEWTON_STEP:
        law = point.law + length * move
        guess = point.slope + length * float(point.turn @ move) / max(point.variance, _TINY)
        ahead = _at(source, regret, law, float(np.clip(guess, 0.3 * point.slope, 3.0 * point.slope)))
        after = ahead.value + law.sum() - centre * np.log(law).sum()
        if after <= before + tolerances.BARRIER_ROUNDING * max(1.0, abs(before)):
            return ahead
        length *= 0.5
    return None
