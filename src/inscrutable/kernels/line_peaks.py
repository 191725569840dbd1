"""The best decision on a face with one free coordinate, in a few dozen trials: even samples, then Brent's method at peaks.

Between three samples a concave function rises above the middle one by at most its larger fall to the other two; a peak
that promises less than what is known is left alone, and so is one at an end beyond which the function would go on rising.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.face_lines import interval
from inscrutable.kernels.options import bare, part
from inscrutable.kernels.set_distance import nearest_in

_SAMPLES = 24
_PEAKS = 3
_ROUNDS = 40
_GOLDEN = 0.3819660112501051
_INWARD, _NARROW = 1e-4, 1e-8


@bare
def _next_trial(left: float, best: float, right: float, known: Any) -> float:
    """The top of the parabola through the best three trials where it is well inside, else a golden section.

    known: best, second and third value, and the places of the last two.
    """
    first, second = best - known[3], best - known[4]
    up, down = first * (known[0] - known[2]), second * (known[0] - known[1])
    bend = 2.0 * (up - down)
    if abs(bend) > 0.0:
        t = float(best - (first * up - second * down) / bend)
        if left < t < right and abs(t - best) < 0.4 * (right - left) and t != best:
            return t
    return best + _GOLDEN * (right - best) if right - best > best - left else best - _GOLDEN * (best - left)


@bare
def _value(
    curves: Any,
    set_rows: Any,
    scale: float,
    aim: Any,
    rules: Any,
    w: Any,
    t: float,
    trial: Any,
    nearest: Any,
    room: Any,
) -> float:
    """sign·distance of the decision at v + t; −∞ where no belief explains it."""
    trial[0], trial[1] = w[0] + t, 1.0
    distance = nearest_in(curves, set_rows, scale, trial, aim.point, rules, nearest, room[0], room[1])
    return float(aim.sign * distance) if distance < np.inf else -np.inf


@part
def _refine(
    curves: Any,
    set_rows: Any,
    scale: float,
    aim: Any,
    rules: Any,
    w: Any,
    bracket: Any,
    values: Any,
    trial: Any,
    nearest: Any,
    room: Any,
) -> tuple[float, float]:
    """The best step inside a bracket (left, middle, right) of three values."""
    left, best, right = bracket
    known = np.array([values[1], values[0], values[2], left, right])
    narrow = _NARROW * (right - left)
    for turn in range(_ROUNDS):
        t = _next_trial(left, best, right, known)
        if turn % 3 == 2:
            # Where the parabola creeps toward a kink from one side, cut the larger part.
            t = best + _GOLDEN * (right - best) if right - best > best - left else best - _GOLDEN * (best - left)
        if abs(t - best) < 0.1 * narrow:
            t = best + narrow if right - best > best - left else best - narrow
        value = _value(curves, set_rows, scale, aim, rules, w, t, trial, nearest, room)
        if value > known[0]:
            if t > best:
                left = best
            else:
                right = best
            known[2], known[4] = known[1], known[3]
            known[1], known[3] = known[0], best
            known[0], best = value, t
        else:
            if t > best:
                right = t
            else:
                left = t
            if value > known[1]:
                known[2], known[4] = known[1], known[3]
                known[1], known[3] = value, t
            elif value > known[2]:
                known[2], known[4] = value, t
        if right - left <= 4.0 * narrow:
            break
    return best, known[0]


@part
def best_on_line(
    curves: Any,
    rows: Any,
    n_set_rows: int,
    scale: float,
    aim: Any,
    rules: Any,
    w: Any,
    y: Any,
    best: float,
    active: Any,
    memory: Any,
) -> float:
    """Move w to the best decision of the line and y to its nearest belief, if above `best`; returns the best value."""
    direction, trial, nearest = np.ones(1), np.empty(2), np.empty(y.size)
    room = (active, memory)
    set_rows = rows[:n_set_rows]
    low, high = interval(curves, rows[n_set_rows:], aim, w, direction, aim.limit, rules.near)
    if not low <= high:
        return best
    gap = (high - low) / (_SAMPLES - 1)
    values, peaks = np.full(_SAMPLES + 2, -np.inf), np.full(_SAMPLES, -np.inf)
    for s in range(_SAMPLES):
        t = low + s * gap
        values[s + 1] = _value(curves, set_rows, scale, aim, rules, w, t, trial, nearest, room)
    for s in range(_SAMPLES):
        if values[s + 1] >= values[s] and values[s + 1] >= values[s + 2]:
            peaks[s] = values[s + 1]
    top, step = best, np.nan
    for _ in range(_PEAKS):
        s = int(peaks.argmax())
        value, t = peaks[s], low + s * gap
        if not value > -np.inf:
            break
        peaks[s] = -np.inf
        left, right = values[s], values[s + 2]
        bracket, three = (t - gap, t, t + gap), (left, value, right)
        if s == 0 or s == _SAMPLES - 1:
            inward = t + _INWARD * gap if s == 0 else t - _INWARD * gap
            beside = _value(curves, set_rows, scale, aim, rules, w, inward, trial, nearest, room)
            if beside <= value:
                if value > top:
                    top, step = value, t
                continue
            edge = low if s == 0 else high
            other = low + gap if s == 0 else high - gap
            bracket, three = (min(edge, other), inward, max(edge, other)), (max(value, left), beside, max(value, right))
        rise = max(three[1] - three[0], three[1] - three[2])
        if three[1] + rise <= top:
            continue
        t, value = _refine(curves, set_rows, scale, aim, rules, w, bracket, three, trial, nearest, room)
        if value > top:
            top, step = value, t
    if step == step:
        w[0] += step
        w[1] = 1.0
        step = 0.0
        top = _value(curves, set_rows, scale, aim, rules, w, step, trial, y, room)
    return top
