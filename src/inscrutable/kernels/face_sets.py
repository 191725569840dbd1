"""Decisions on a face whose consistent sets are larger than points: an affordable start, the best on a line, and on the
axes and diagonals of what the budget allows."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.climb import quadratic_step
from inscrutable.kernels.face_ascent import cost_model
from inscrutable.kernels.face_lines import best_step, decision_value, interval
from inscrutable.kernels.faces import cholesky
from inscrutable.kernels.options import kernel, part
from inscrutable.kernels.projection import project
from inscrutable.kernels.set_distance import cost_at

_FARTHEST = 1.5  # more than any two beliefs are apart
_TRIES = 4
_SHRINK = 0.5


@part
def _admit(slacks: Any, near: float, w: Any) -> bool:
    """Move v to the nearest decision that satisfies all slack rows."""
    m, k = slacks.shape[0], w.size - 1
    units, sides, weights, place = np.empty((m, k)), np.empty(m), np.empty(m), w[:k].copy()
    last = 0
    for r in range(m):
        length = 0.0
        for a in range(k):
            units[last, a] = slacks[r, 0, a]
            length += slacks[r, 0, a] ** 2
        length = np.sqrt(length)
        if length <= 1e-13:
            if slacks[r, 0, k] < -near:
                return False
            continue
        units[last] /= length
        sides[last] = -slacks[r, 0, k] / length
        last += 1
    if not project(units[:last], sides, last, 0, 0.01 * near, place, weights):
        return False
    w[:k] = place
    return True


@part
def _cheapest(curves: Any, slacks: Any, aim: Any, near: float, w: Any, step: Any) -> bool:
    """Fill the way from an admissible v to the least cost of the face under the true belief, inside the slacks."""
    m, k = slacks.shape[0], w.size - 1
    units, sides, turned = np.empty((m, k)), np.empty(m), np.empty((m, k))
    slope, bend, factor = np.empty(k), np.empty((k, k)), np.empty((k, k))
    weights, moved = np.empty(m), np.empty(m)
    cost_model(curves, aim.belief, w, slope, bend)
    last = 0
    for r in range(m):
        length, value = 0.0, slacks[r, 0, k]
        for a in range(k):
            length += slacks[r, 0, a] ** 2
            value += slacks[r, 0, a] * w[a]
        length = np.sqrt(length)
        if length > 1e-13:
            units[last] = slacks[r, 0, :k] / length
            sides[last] = -max(value, 0.0) / length
            last += 1
    return quadratic_step(
        bend, slope, units[:last], sides[:last], 0.01 * near, factor, turned[:last], moved[:last], step, weights[:last]
    )


@kernel
def afford(curves: Any, slacks: Any, aim: Any, near: float, w: Any, centre: Any) -> bool:
    """Move v onto the slacks, and toward the least cost of the face until the budget allows it; `centre` is filled with
    the decision of least cost."""
    k = w.size - 1
    if not _admit(slacks, near, w):
        return False
    step = np.empty(k)
    if k == 0 or not _cheapest(curves, slacks, aim, near, w, step):
        return bool(cost_at(curves, aim.belief, w) - aim.optimal_cost <= aim.limit)
    centre[:k] = w[:k] + step
    centre[k] = 1.0
    if cost_at(curves, aim.belief, w) - aim.optimal_cost <= aim.limit:
        return True
    if cost_at(curves, aim.belief, centre) - aim.optimal_cost > aim.limit:
        return False
    step *= -1.0
    _, high = interval(curves, slacks, aim, centre, step, aim.limit, near)
    w[:k] = centre[:k] + max(min(high, 1.0), 0.0) * step
    return True


@kernel
def walk_line(
    curves: Any, rows: Any, n_set_rows: int, scale: float, aim: Any, rules: Any, w: Any, best: float, rounds: int
) -> float:
    """Move w to the best decision of a face with one free coordinate, if that is better."""
    direction = np.ones(1)
    low, high = interval(curves, rows[n_set_rows:], aim, w, direction, _dearest(aim, best), rules.near)
    if low > high:
        return best
    t, value = best_step(curves, rows[:n_set_rows], scale, aim, rules, w, direction, low, high, rounds)
    if value > best:
        w[0] += t
        return value
    return best


@part
def _dearest(aim: Any, best: float) -> float:
    """The largest regret worth a look: under a price, what costs more is worth less than what is known."""
    if aim.price > 0.0:
        return float(min(aim.limit, (_FARTHEST - best) / aim.price))
    return float(aim.limit)


@kernel
def look_around(
    curves: Any, rows: Any, n_set_rows: int, scale: float, aim: Any, rules: Any, w: Any, best: float, found: Any
) -> int:
    """Fill the best decisions (n, k+1) on lines through w, at most one a side; returns how many there are.

    The lines are the axes and diagonals of the ellipsoid that the budget allows.
    """
    k = w.size - 1
    slacks, set_rows = rows[n_set_rows:], rows[:n_set_rows]
    slope, factor, direction = np.empty(k), np.empty((k, k)), np.empty(k)
    cost_model(curves, aim.belief, w, slope, factor)
    if not cholesky(factor, k, rules.pivot):
        return 0
    limit = _dearest(aim, best)
    values = np.full(found.shape[0], -np.inf)
    trial, member = np.empty(k + 1), np.empty(aim.point.size)
    active = np.empty(k + n_set_rows, dtype=np.bool_)
    for first in range(k):
        for second in range(-first, first + 1):
            # second = 0: the axis; ±c: the diagonals with axis c − 1.
            direction[:] = 0.0
            direction[first] = 1.0
            if second != 0:
                direction[abs(second) - 1] = 1.0 if second > 0 else -1.0
            for a in range(k - 1, -1, -1):
                for c in range(a + 1, k):
                    direction[a] -= factor[c, a] * direction[c]
                direction[a] /= factor[a, a]
            low, high = interval(curves, slacks, aim, w, direction, limit, rules.near)
            if low > high:
                continue
            for end in (low, high):
                top, step, share = -np.inf, 0.0, 1.0
                for _ in range(_TRIES):
                    value = decision_value(
                        curves, set_rows, scale, aim, rules, w, direction, share * end, trial, member, active
                    )
                    if value > top:
                        top, step = value, share * end
                    share *= _SHRINK
                worst = values.argmin()
                if top > values[worst]:
                    values[worst] = top
                    found[worst, :k] = w[:k] + step * direction
                    found[worst, k] = 1.0
    n_found = 0
    order = np.argsort(-values)
    found[:] = found[order]
    for value in values:
        n_found += value > -np.inf
    return n_found
