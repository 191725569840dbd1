"""The best decision on a face whose consistent sets are larger than points: where to start, then climbs and lines.

Toward a point the best decision is found through its decoy, for the least distance to a set is the least distance to any
of its members. Away from a point the sets themselves are followed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from inscrutable.kernels.climb import Aim, climb, quadratic_step
from inscrutable.kernels.face_ascent import ascend, cost_model
from inscrutable.kernels.face_lines import best_step, decision_value, interval
from inscrutable.kernels.faces import cholesky
from inscrutable.kernels.projection import project
from inscrutable.kernels.set_distance import cost_at, nearest_belief

_FARTHEST = 1.5  # more than any two beliefs are apart
_STEEP = 10.0
_STARTS = 2
_TRIES = 4
_SHRINK = 0.5


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def _afford(curves: Any, slacks: Any, aim: Any, near: float, w: Any, centre: Any) -> bool:
    """Move an admissible v toward the least cost of the face until the budget allows it; `centre` is filled with that."""
    k = w.size - 1
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


@njit(cache=True, nogil=True, error_model="numpy")
def _explain(curves: Any, rows: Any, aim: Any, rules: Any, w: Any, y: Any, rounds: int) -> bool:
    """Replace (w, y) by an affordable decision of the face and a belief that explains it."""
    steep = aim.price
    if aim.limit < np.inf:
        steep = max(_STEEP / max(aim.limit, 1e-300), aim.price)
    nearby = Aim(aim.belief, aim.belief, -1.0, aim.optimal_cost, np.inf, steep)
    if not climb(curves, rows, nearby, rules, y, w, rounds) < np.inf:
        return False
    return bool(cost_at(curves, aim.belief, w) - aim.optimal_cost <= aim.limit)


@njit(cache=True, nogil=True, error_model="numpy")
def _start(
    curves: Any,
    rows: Any,
    n_set_rows: int,
    scale: float,
    aim: Any,
    rules: Any,
    w: Any,
    y: Any,
    member: Any,
    active: Any,
    centre: Any,
    rounds: int,
) -> float:
    """Move w to an admissible, affordable and explained decision, as near as can be; returns its value."""
    slacks = rows[n_set_rows:]
    direction = np.zeros(w.size - 1)
    if _admit(slacks, rules.near, w) and _afford(curves, slacks, aim, rules.near, w, centre):
        value = decision_value(
            curves, rows[:n_set_rows], scale, aim, rules, w, direction, 0.0, w.copy(), member, active
        )
        if value > -np.inf:
            return value
    if not _explain(curves, rows, aim, rules, w, y, rounds):
        return -np.inf
    return decision_value(curves, rows[:n_set_rows], scale, aim, rules, w, direction, 0.0, w.copy(), member, active)


@njit(cache=True, nogil=True, error_model="numpy")
def _line(
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


@njit(cache=True, nogil=True, error_model="numpy")
def _dearest(aim: Any, best: float) -> float:
    """The largest regret worth a look: under a price, what costs more is worth less than what is known."""
    if aim.price > 0.0:
        return float(min(aim.limit, (_FARTHEST - best) / aim.price))
    return float(aim.limit)


@njit(cache=True, nogil=True, error_model="numpy")
def _look_around(
    curves: Any, rows: Any, n_set_rows: int, scale: float, aim: Any, rules: Any, w: Any, best: float, found: Any
) -> int:
    """Fill the best decisions (_STARTS, k+1) on lines through w, at most one a side; returns how many there are.

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


@njit(cache=True, nogil=True, error_model="numpy")
def _keep(
    curves: Any,
    set_rows: Any,
    scale: float,
    aim: Any,
    rules: Any,
    trial: Any,
    best: float,
    w: Any,
    member: Any,
    y: Any,
    active: Any,
) -> float:
    """Take over a trial that is better."""
    direction = np.zeros(w.size - 1)
    value = decision_value(curves, set_rows, scale, aim, rules, trial, direction, 0.0, trial.copy(), y, active)
    if value > best:
        w[:] = trial
        member[:] = y
        return value
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def _with_equations(curves: Any, rows: Any, scale: float) -> Any:
    """The rows behind those of G'π = 0."""
    n_states, k = curves.shape[0], curves.shape[1] - 1
    held = np.empty((k + rows.shape[0], n_states, k + 1))
    for a in range(k):
        held[a] = curves[:, a] / scale
    held[k:] = rows
    return held


@njit(cache=True, nogil=True, error_model="numpy")
def search_face(
    curves: Any, rows: Any, n_set_rows: int, scale: float, aim: Any, rules: Any, w: Any, nearest: Any, rounds: int
) -> float:
    """Improve the decision w of a face whose sets are larger than points; returns sign·distance (less price·regret).

    `nearest` holds a decoy to begin with where w itself is not explained, and is replaced by the nearest member of the
    set found. −∞ where nothing allowed and explained is found.
    """
    k = w.size - 1
    set_rows = rows[:n_set_rows]
    active = np.zeros(k + n_set_rows, dtype=np.bool_)
    member = nearest.copy()
    centre = w.copy()
    best = _start(curves, rows, n_set_rows, scale, aim, rules, w, nearest, member, active, centre, rounds)
    if not best > -np.inf or k == 0:
        nearest[:] = member
        return best
    trial, y = w.copy(), member.copy()
    if aim.sign < 0.0:
        if climb(curves, rows, aim, rules, y, trial, rounds) < np.inf:
            best = _keep(curves, set_rows, scale, aim, rules, trial, best, w, member, y, active)
        nearest[:] = member
        return best
    if k == 1:
        best = _line(curves, rows, n_set_rows, scale, aim, rules, w, best, rounds)
        nearest_belief(curves, set_rows, scale, w, aim.point, rules, nearest, active)
        return best
    held = _with_equations(curves, rows, scale)
    found = np.empty((_STARTS, k + 1))
    n_found = _look_around(curves, rows, n_set_rows, scale, aim, rules, centre, best, found)
    own, own_member = w.copy(), member.copy()
    for s in range(n_found + 1):
        if s < n_found:
            trial[:] = found[s]
            nearest_belief(curves, set_rows, scale, trial, aim.point, rules, y, active)
        else:
            trial[:] = own
            y[:] = own_member
        if ascend(curves, held, n_set_rows, scale, aim, rules, trial, y, rounds) > -np.inf:
            best = _keep(curves, set_rows, scale, aim, rules, trial, best, w, member, y, active)
    nearest[:] = member
    return best
