"""Searches along lines of decisions of one face, the distance of the consistent set being judged at every trial.

Along v + t d the regret is a quadratic of t and every slack is affine, so what is affordable and admissible is one interval.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import bare, woven
from inscrutable.kernels.set_distance import NO_ROW, cost_at, nearest_belief

SAMPLES = 48
"""Even samples of what beliefs explain on a line; with 16 a few lotteries over three states lose up to 2e-4."""
_PEAKS = 3
_HALVINGS = 10  # toward the end of what beliefs explain; golden sections go on where the best place is there
_DIFFERENCE = 1e-6  # of a line's length; the root of a double's accuracy, and some
_GOLDEN = 0.3819660112501051


@bare
def interval(face: Any, aim: Any, w: Any, direction: Any, limit: float, near: float) -> tuple[float, float]:
    """The steps along `direction` (k,) that all slacks and the budget allow; empty where the first exceeds the second."""
    k, curves = direction.size, face.curves
    low, high = -1e6, 1e6
    for r in range(face.n_set_rows, face.rows.shape[0]):
        value, speed = face.rows[r, 0, k], 0.0
        for a in range(k):
            value += face.rows[r, 0, a] * w[a]
            speed += face.rows[r, 0, a] * direction[a]
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


@bare
def decision_value(face: Any, aim: Any, rules: Any, trial: Any, nearest: Any, room: Any) -> float:
    """sign·distance − price·regret of the decision at `trial`; −∞ where no belief explains it."""
    distance = nearest_belief(face, trial, aim.point, rules, NO_ROW, nearest, room)
    if not distance < np.inf:
        return -np.inf
    value = aim.sign * distance
    if aim.price > 0.0:
        value -= aim.price * (cost_at(face.curves, aim.belief, trial) - aim.optimal_cost)
    return float(value)


@woven
def _refine(face: Any, aim: Any, rules: Any, bracket: Any, rounds: int, work: Any) -> tuple[float, float]:
    """Golden sections inside the bracket (left, best, right, value of the best); the best place and its value."""
    trial, nearest, _, room = work
    left, best, right, value = bracket
    for _ in range(rounds):
        # The larger part is cut, so that the best point stays inside.
        t = best + _GOLDEN * (right - best) if right - best > best - left else best - _GOLDEN * (best - left)
        trial[0] = t
        found = decision_value(face, aim, rules, trial, nearest, room)
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


@woven
def _explained_end(face: Any, aim: Any, rules: Any, known: float, end: float, work: Any) -> tuple[float, float]:
    """The last place from `known` to `end` whose decision some belief explains, and one behind it that none does."""
    trial, nearest, _, room = work
    trial[0] = end
    if decision_value(face, aim, rules, trial, nearest, room) > -np.inf:
        return end, end
    inside, outside = known, end
    for _ in range(_HALVINGS):
        trial[0] = 0.5 * (inside + outside)
        if decision_value(face, aim, rules, trial, nearest, room) > -np.inf:
            inside = trial[0]
        else:
            outside = trial[0]
    return inside, outside


@woven
def best_place(
    face: Any, aim: Any, rules: Any, line: tuple[float, float, float], floor: float, rounds: int, work: Any
) -> float:
    """The best place on a line (first, known, last) of the one free coordinate.

    Even samples of what beliefs explain around the known place, and golden sections around the highest peaks that promise more
    than `floor`. work: (trial (2,), nearest (X,), values (S,), `DistanceRoom`).
    """
    trial, nearest, values, room = work
    first, known, last = line
    trial[0], trial[1] = min(max(known, first), last), 1.0
    if not decision_value(face, aim, rules, trial, nearest, room) > -np.inf:
        return known
    known = trial[0]
    low, below = _explained_end(face, aim, rules, known, first, work)
    high, above = _explained_end(face, aim, rules, known, last, work)
    n_samples = values.size
    gap = (high - low) / (n_samples - 1)
    for s in range(n_samples):
        trial[0] = low + s * gap
        values[s] = decision_value(face, aim, rules, trial, nearest, room)
    best_t, best, before = known, floor, np.inf
    for _ in range(_PEAKS):
        # The highest peak below the last one.
        top, peak = -np.inf, -1
        for s in range(n_samples):
            rises = s == 0 or values[s] >= values[s - 1]
            if rises and (s == n_samples - 1 or values[s] >= values[s + 1]) and top < values[s] < before:
                top, peak = values[s], s
        if peak < 0:
            break
        before, middle = top, low + peak * gap
        # A peak is above its sample by no more than its neighbours are below.
        fall = 0.0
        for s in (peak - 1, peak + 1):
            if 0 <= s < n_samples:
                fall = max(fall, top - values[s])
        if top > best:
            best_t, best = middle, top
        if top + fall <= best:
            continue
        bracket = (middle - gap if peak > 0 else below, middle, middle + gap if peak < n_samples - 1 else above, top)
        t, value = _refine(face, aim, rules, bracket, rounds, work)
        if value > best:
            best_t, best = t, value
    return float(best_t)


@woven
def line_weight(face: Any, aim: Any, rules: Any, w: Any, ends: Any, work: Any) -> float:
    """The budget's multiplier for ½Ψ² at the place w: ΨΨ'/ρ', the slopes being differences toward the farther end."""
    low, high = ends
    trial, nearest, _, room = work
    place, step = w[0], _DIFFERENCE * (high - low)
    if high - place < place - low:
        step = -step
    here = nearest_belief(face, w, aim.point, rules, NO_ROW, nearest, room)
    regret = cost_at(face.curves, aim.belief, w)
    trial[0], trial[1] = place + step, 1.0
    there = nearest_belief(face, trial, aim.point, rules, NO_ROW, nearest, room)
    less = regret - cost_at(face.curves, aim.belief, trial)
    trial[0] = place
    return float(here * (here - there) / less) if there < here and less > 0.0 else 0.0
