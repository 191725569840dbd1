"""Decisions on a face whose consistent sets are larger than points: the cheapest, and the best on the axes and diagonals of
the ellipsoid that the budget allows around it."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.climb import MET, factor_shifted, quadratic_step, step_room
from inscrutable.kernels.copies import put, put_shifted
from inscrutable.kernels.face_ascent import cost_model
from inscrutable.kernels.faces import cholesky, cost_at
from inscrutable.kernels.options import internal, uncounted
from inscrutable.kernels.projection import NO_EQUALITIES, at_unit_length
from inscrutable.kernels.references import by_reference, release
from inscrutable.kernels.rounding import FLAT
from inscrutable.kernels.set_distance import NO_ROW, nearest_belief
from inscrutable.tolerances import PIVOT, SIMPLEX_DIAMETER

_LONGEST = 1e6  # step along an unbounded line
_NO_INTERVAL = (1.0, -1.0)
_TRIES = 4
"""Decisions tried on a line, from its end on. With one, 4 of 600 decisions over two to seven states lose up to 10 %; with ten
none changes."""
_SHRINK = 0.5  # of the step, from one to the next


@internal
def move_to_cheapest(face: Any, aim: Any, w: Any) -> None:
    """Move v to the least cost of the face under the true belief, inside the slacks."""
    first, k = face.n_set_rows, w.size - 1
    m = face.rows.shape[0] - first
    units, sides, weights = np.empty((m, k)), np.empty(m), np.empty(m)
    slope, curvature, step = np.empty(k), np.empty((k, k)), np.empty(k)
    cost_model(face.curves, aim.belief, w, slope, curvature)
    for r in range(m):
        # value + row·step ≥ 0; where no coordinate moves a row, it holds everywhere or nowhere.
        value = face.rows[first + r, 0, k]
        for a in range(k):
            units[r, a] = face.rows[first + r, 0, a]
            value += face.rows[first + r, 0, a] * w[a]
        sides[r], _ = at_unit_length(units[r], value)
    room = step_room(k, m)
    factor_shifted(curvature, k, 0.0, 1.0, room.factor)
    if quadratic_step(slope, units, sides, NO_EQUALITIES, step, weights, by_reference(room)):
        put_shifted(w, 1.0, step, w)
    release(room)


@uncounted
def _interval(face: Any, w: Any, direction: Any, linear: float, quadratic: float, excess: float) -> tuple[float, float]:
    """The steps t along `direction` (k,) that all slacks and the budget allow; empty where the first exceeds the second.

    Along v + t d every slack is affine, and the regret less its limit is excess + t linear + t² quadratic: one interval.
    """
    k, low, high = direction.size, -_LONGEST, _LONGEST
    for r in range(face.n_set_rows, face.rows.shape[0]):
        value, speed = face.rows[r, 0, k], 0.0
        for a in range(k):
            value += face.rows[r, 0, a] * w[a]
            speed += face.rows[r, 0, a] * direction[a]
        if abs(speed) <= FLAT:
            if value < -MET:
                return _NO_INTERVAL
        elif speed > 0.0:
            low = max(low, -value / speed)
        else:
            high = min(high, -value / speed)
    if excess > -np.inf:
        root = linear * linear - 4.0 * quadratic * excess
        if root < 0.0:
            return _NO_INTERVAL
        # The two roots without cancellation.
        root = np.sqrt(root)
        q = -0.5 * (linear + root) if linear > 0.0 else -0.5 * (linear - root)
        first = q / quadratic
        second = excess / q if q != 0.0 else 0.0
        low, high = max(low, min(first, second)), min(high, max(first, second))
    return low, high


@uncounted
def is_allowed(face: Any, aim: Any, trial: Any) -> bool:
    """Whether no slack is negative and the regret is within the budget."""
    for r in range(face.n_set_rows, face.rows.shape[0]):
        slack = 0.0
        for a in range(trial.size):
            slack += face.rows[r, 0, a] * trial[a]
        if slack < -MET:
            return False
    # Rounding may end a climb a little beyond the budget; the aim's limit leaves room for that.
    return bool(cost_at(face.curves, aim.belief, trial) - aim.optimal_cost <= aim.limit + MET * aim.unit)


@uncounted
def decision_value(face: Any, aim: Any, basis: Any, trial: Any, nearest: Any, room: Any) -> float:
    """sign·distance − price·regret of the decision at `trial`; −∞ where no belief explains it."""
    distance = nearest_belief(face, trial, aim.point, basis, NO_ROW, nearest, room)
    if not distance < np.inf:
        return -np.inf
    value = aim.sign * distance
    if aim.price > 0.0:
        value -= aim.price * (cost_at(face.curves, aim.belief, trial) - aim.optimal_cost)
    return float(value)


@uncounted
def _end_value(face: Any, aim: Any, basis: Any, line: Any, end: float, work: Any) -> tuple[float, float]:
    """The best of a few steps toward the end of a line (w, direction), and its value."""
    w, direction = line
    trial, member, room = work
    top, step, share = -np.inf, 0.0, 1.0
    for _ in range(_TRIES):
        put_shifted(w, share * end, direction, trial)
        value = decision_value(face, aim, basis, trial, member, room)
        if value > top:
            top, step = value, share * end
        share *= _SHRINK
    return step, top


@internal
def look_around(face: Any, aim: Any, basis: Any, w: Any, best: float, found: Any, room: Any) -> int:
    """Fill the best decisions (n, k+1) on lines through w, at most one a side; returns how many there are.

    The lines are the axes and diagonals of the ellipsoid that the budget allows. With a climb from w alone instead, 10 of 2,700
    decisions and lotteries lose, up to 10.6 %.
    """
    k = w.size - 1
    slope, factor, direction = np.empty(k), np.empty((k, k)), np.empty(k)
    cost_model(face.curves, aim.belief, w, slope, factor)
    if not cholesky(factor, k, PIVOT):
        return 0
    limit = aim.limit
    if aim.price > 0.0:  # a larger regret costs more than any distance gains on the best value
        limit = min(limit, (SIMPLEX_DIAMETER - best) / aim.price)
    excess = cost_at(face.curves, aim.belief, w) - aim.optimal_cost - limit
    values = np.full(found.shape[0], -np.inf)
    trial, member = w.copy(), np.empty(aim.point.size)
    for first in range(k):
        for second in range(-first, first + 1):
            # second = 0: the axis; ±c: the diagonals with axis c − 1.
            direction[:] = 0.0
            direction[first] = 1.0
            if second != 0:
                direction[abs(second) - 1] = 1.0 if second > 0 else -1.0
            # With LL' the curvature, d = L'⁻¹e and d'LL'd = e'e.
            linear, quadratic = 0.0, 0.5 if second == 0 else 1.0
            for a in range(k - 1, -1, -1):
                for c in range(a + 1, k):
                    direction[a] -= factor[c, a] * direction[c]
                direction[a] /= factor[a, a]
                linear += slope[a] * direction[a]
            low, high = _interval(face, w, direction, linear, quadratic, excess)
            if low > high:
                continue
            for end in (low, high):
                step, top = _end_value(face, aim, basis, (w, direction), end, (trial, member, room))
                # Keep the best, in order.
                s = values.size - 1
                if not top > values[s]:
                    continue
                while s > 0 and top > values[s - 1]:
                    values[s] = values[s - 1]
                    put(found[s - 1], found[s])
                    s -= 1
                values[s] = top
                put_shifted(w, step, direction, found[s])
                found[s, k] = 1.0
    n_found = 0
    for value in values:
        n_found += value > -np.inf
    return n_found
