"""Searches along lines of decisions of one face, the distance of the consistent set being judged at every trial.

Along v + t d the regret is a quadratic of t and every slack is affine, so what is affordable and admissible is one interval.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import kernel, part
from inscrutable.kernels.set_distance import cost_at, nearest_belief

_SAMPLES = 48
_PEAKS = 3
_GOLDEN = 0.3819660112501051


@kernel
def interval(
    curves: Any, slacks: Any, aim: Any, w: Any, direction: Any, limit: float, near: float
) -> tuple[float, float]:
    """The steps along `direction` (k,) that all slacks and the budget allow; empty where the first exceeds the second."""
    k = direction.size
    low, high = -1e6, 1e6
    for r in range(slacks.shape[0]):
        value, speed = slacks[r, 0, k], 0.0
        for a in range(k):
            value += slacks[r, 0, a] * w[a]
            speed += slacks[r, 0, a] * direction[a]
        if abs(speed) <= 1e-13:
            if value < -near:
                return 1.0, -1.0
        elif speed > 0.0:
            low = max(low, -value / speed)
        else:
            high = min(high, -value / speed)
    if limit < np.inf:
        bend, lean = 0.0, 0.0
        for i in range(aim.belief.size):
            for a in range(k):
                inner, along = 0.0, 0.0
                for c in range(k + 1):
                    inner += curves[i, a, c] * w[c]
                for c in range(k):
                    along += curves[i, a, c] * direction[c]
                bend += 0.5 * aim.belief[i] * direction[a] * along
                lean += aim.belief[i] * direction[a] * inner
        excess = cost_at(curves, aim.belief, w) - aim.optimal_cost - limit
        if bend > 0.0:
            root = lean * lean - 4.0 * bend * excess
            if root < 0.0:
                return 1.0, -1.0
            # The two roots without cancellation.
            root = np.sqrt(root)
            q = -0.5 * (lean + root) if lean > 0.0 else -0.5 * (lean - root)
            first = q / bend
            second = excess / q if q != 0.0 else 0.0
            low, high = max(low, min(first, second)), min(high, max(first, second))
    return low, high


@kernel
def decision_value(
    curves: Any,
    set_rows: Any,
    scale: float,
    aim: Any,
    rules: Any,
    w: Any,
    direction: Any,
    t: float,
    trial: Any,
    nearest: Any,
    active: Any,
) -> float:
    """sign·distance − price·regret of the decision at v + t d; −∞ where no belief explains it."""
    k = direction.size
    for a in range(k):
        trial[a] = w[a] + t * direction[a]
    trial[k] = 1.0
    distance = nearest_belief(curves, set_rows, scale, trial, aim.point, rules, nearest, active)
    if not distance < np.inf:
        return -np.inf
    value = aim.sign * distance
    if aim.price > 0.0:
        value -= aim.price * (cost_at(curves, aim.belief, trial) - aim.optimal_cost)
    return float(value)


@part
def _refine(
    curves: Any,
    set_rows: Any,
    scale: float,
    aim: Any,
    rules: Any,
    w: Any,
    direction: Any,
    bracket: Any,
    value: float,
    rounds: int,
) -> tuple[float, float]:
    """Golden sections inside the bracket (left, best, right), `value` being the middle's; the best step and its value."""
    trial, nearest = np.empty(w.size), np.empty(aim.point.size)
    active = np.empty(w.size - 1 + set_rows.shape[0], dtype=np.bool_)
    left, best, right = bracket
    for _ in range(rounds):
        # The larger part is cut, so that the best point stays inside.
        t = best + _GOLDEN * (right - best) if right - best > best - left else best - _GOLDEN * (best - left)
        found = decision_value(curves, set_rows, scale, aim, rules, w, direction, t, trial, nearest, active)
        if found > value:
            if t > best:
                left = best
            else:
                right = best
            best, value = t, found
        elif t > best:
            right = t
        else:
            left = t
    return best, value


@kernel
def best_step(
    curves: Any,
    set_rows: Any,
    scale: float,
    aim: Any,
    rules: Any,
    w: Any,
    direction: Any,
    low: float,
    high: float,
    rounds: int,
) -> tuple[float, float]:
    """The best step in [low, high] and its value: even samples, then golden sections around the highest peaks."""
    trial, nearest = np.empty(w.size), np.empty(aim.point.size)
    active = np.empty(w.size - 1 + set_rows.shape[0], dtype=np.bool_)
    values = np.empty(_SAMPLES)
    peaks = np.full(_SAMPLES, -np.inf)
    gap = (high - low) / (_SAMPLES - 1)
    for s in range(_SAMPLES):
        values[s] = decision_value(
            curves, set_rows, scale, aim, rules, w, direction, low + s * gap, trial, nearest, active
        )
    for s in range(_SAMPLES):
        if (s == 0 or values[s] >= values[s - 1]) and (s == _SAMPLES - 1 or values[s] >= values[s + 1]):
            peaks[s] = values[s]
    best_t, best = low, -np.inf
    for _ in range(_PEAKS):
        s = int(peaks.argmax())
        if not peaks[s] > -np.inf:
            break
        peaks[s] = -np.inf
        middle = low + s * gap
        bracket = (max(low, middle - gap), middle, min(high, middle + gap))
        t, value = _refine(curves, set_rows, scale, aim, rules, w, direction, bracket, values[s], rounds)
        if value > best:
            best_t, best = t, value
    return best_t, best
