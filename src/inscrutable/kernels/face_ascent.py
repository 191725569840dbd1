"""The decision on one face whose consistent set is farthest from a point: sequential quadratic programming.

With z = 1/X + B s the belief of the set nearest to p, every row is F_r(v, z) = Σ z_i R_ri·w = 0 (stationarity) or ≥ 0
(probabilities, multipliers, slacks). For φ(v) = ½‖z − p‖², A = ∂F/∂s of the active rows, (AA')η = A(s − s_p),
E = Σ η_r ∂²F_r/∂v∂s and J = ∂F/∂v + A E',

    ∂φ/∂v = −Σ η_r ∂F_r/∂v,   ∂²φ/∂v² = J'(AA')⁻¹J − E E'.

A step moves v and a member of the set together, so that decisions that no belief explains are seen before they are tried.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.climb import (
    FIRST_TURNS,
    LATER_TURNS,
    MET,
    NO_GAIN,
    PROJECTED,
    SHORTER,
    SHORTEST,
    factor_shifted,
    largest_in,
    quadratic_step,
    step_room,
)
from inscrutable.kernels.copies import put
from inscrutable.kernels.faces import cholesky, cost_at, row_value, solve_factored
from inscrutable.kernels.options import integer, internal, uncounted
from inscrutable.kernels.projection import at_unit_length, project_in
from inscrutable.kernels.references import by_reference, release
from inscrutable.kernels.rounding import FLAT, NO_DISTANCE
from inscrutable.kernels.set_distance import NO_ROW, nearest_belief

_NONE = integer(0)
_WITNESS = 1e-2
"""Curvature of the member's coordinates, as a share of the decision's. Of 840 decisions and lotteries where states outnumber
actions, .001 loses in 13, up to 25 %; with .1 seven gain, 4 % at most, and three lose .02 %."""
_LEAST_WITNESS = 1e-12  # least share of it, where the decision has none: the model stays positive definite
_ACROSS = 3.0
"""Curvature across rows that held, over the largest of the rest; with 1 or 10, some ten of these 840 differ to either side."""
_LEAST_SQUARE = 1e-8  # least square of a unit row's part along the decision; below it the row is the member's alone
_GROWTH = 2.0
"""Factor of the shift that makes the model convex; with 4 or 10, some eight of these 840 differ to either side."""
_TRIALS = 60  # most trials of an ascent; over six states and four assets one takes 14 on average
_CREEP = 1e-5
"""An ascent ends where its last gain and the next one promised, each repeated in all trials left, are less than this share of
the value: half to two thirds of all trials gain less."""
_OF_SHORTFALL = 0.25
"""It also ends where they are less than this share of the shortfall from the best known value. Of 5,400 decisions and
lotteries over three to eight states and fewer assets none loses .05 %, two gain, up to 1.3 %, and those over six to eight
states take 10 to 19 % less time; with 1, eight lose, up to 13 %."""
_EASE = 0.01  # unit of the member's coordinates: it follows a decision almost for free


@internal
def set_distance_model(
    rows: Any, point: Any, basis: Any, w: Any, z: Any, active: Any, slope: Any, hessian: Any
) -> None:
    """Fill ∂φ/∂v and ∂²φ/∂v² in the first k coordinates; `rows` (m, X, k+1) with equalities first, `active` says which hold."""
    n_states, n = basis.shape
    k = w.size - 1
    normals, moves = np.zeros((n, n)), np.zeros((n, k))
    chosen = np.empty(n, dtype=np.int64)
    gram, eta = np.empty((n, n)), np.zeros(n)
    q = _NONE
    for r in range(active.size):
        if not active[r] or q == n:
            continue
        chosen[q] = r
        for i in range(n_states):
            along = rows[r, i, k]
            for a in range(k):
                along += rows[r, i, a] * w[a]
                moves[q, a] += z[i] * rows[r, i, a]
            for c in range(n):
                normals[q, c] += basis[i, c] * along
        q += 1
    for r in range(q):
        for i in range(n_states):
            for c in range(n):
                eta[r] += normals[r, c] * basis[i, c] * (z[i] - point[i])
        for t in range(q):
            gram[r, t] = 0.0
            for c in range(n):
                gram[r, t] += normals[r, c] * normals[t, c]
    for a in range(k):
        slope[a] = 0.0
        for b in range(k):
            hessian[a, b] = 0.0
    if not cholesky(gram, q, FLAT):
        return
    solve_factored(gram, q, eta)
    twist = np.zeros((k, n))
    for r in range(q):
        for a in range(k):
            slope[a] -= eta[r] * moves[r, a]
            for c in range(n):
                for i in range(n_states):
                    twist[a, c] += eta[r] * rows[chosen[r], i, a] * basis[i, c]
    column = np.empty(n)
    for a in range(k):
        for r in range(q):
            for c in range(n):
                moves[r, a] += normals[r, c] * twist[a, c]
    for b in range(k):
        for r in range(q):
            column[r] = moves[r, b]
        solve_factored(gram, q, column)
        for a in range(k):
            for r in range(q):
                hessian[a, b] += moves[r, a] * column[r]
            for c in range(n):
                hessian[a, b] -= twist[a, c] * twist[b, c]


@internal
def cost_model(curves: Any, belief: Any, w: Any, slope: Any, curvature: Any) -> None:
    """Gradient and Hessian of the expected cost in v."""
    k = w.size - 1
    for a in range(k):
        slope[a] = 0.0
        for c in range(k + 1):
            total = 0.0
            for i in range(belief.size):
                total += belief[i] * curves[i, a, c]
            slope[a] += total * w[c]
            if c < k:
                curvature[a, c] = total


@internal
def _write_rows(rows: Any, basis: Any, place: Any, cost_slope: Any, left: float, lines: Any) -> None:
    """The rows at (v, z) and the budget behind them, linear in the step of (v, s), at unit length."""
    (w, z), (units, sides, lengths) = place, lines
    n_states, n = basis.shape
    k = w.size - 1
    m = rows.shape[0]
    for r in range(units.shape[0]):
        value = left
        units[r, :] = 0.0
        if r < m:
            value = 0.0
            for i in range(n_states):
                along = rows[r, i, k]
                for a in range(k):
                    along += rows[r, i, a] * w[a]
                    units[r, a] += z[i] * rows[r, i, a]
                value += z[i] * along
                for c in range(n):
                    units[r, k + c] += basis[i, c] * along / _EASE
        else:
            for a in range(k):
                units[r, a] = -cost_slope[a]
        sides[r], lengths[r] = at_unit_length(units[r], value)


@internal
def _pull(curves: Any, rows: Any, aim: Any, basis: Any, turns: int, place: Any, lines: Any, memory: Any) -> bool:
    """Move (v, z) onto the rows and the budget by Newton steps; False where that fails. memory: a `StepRoom`."""
    (w, z), (units, sides, _) = place, lines
    n_states, n = basis.shape
    k = w.size - 1
    m = rows.shape[0]
    slope, curvature = np.empty(k), np.empty((k, k))
    step = np.empty(k + n)
    for turn in range(turns + 1):
        left = aim.limit - cost_at(curves, aim.belief, w) + aim.optimal_cost
        worst = -left / aim.unit if aim.limit < np.inf else 0.0
        for r in range(m):
            value = row_value(rows[r], z, w)
            worst = max(worst, abs(value) if r < k else -value)
        if worst <= MET:
            return True
        if turn == turns:
            return False
        cost_model(curves, aim.belief, w, slope, curvature)
        _write_rows(rows, basis, place, slope, left, lines)
        step[:] = 0.0
        if not project_in(units, sides, sides.size, k, PROJECTED, step, memory.moved, memory.projection):
            return False
        for a in range(k):
            w[a] += step[a]
        for c in range(n):
            for i in range(n_states):
                z[i] += basis[i, c] * step[k + c] / _EASE
    return False


@internal
def _model(curves: Any, rows: Any, aim: Any, basis: Any, place: Any, active: Any, known: Any, out: Any) -> float:
    """Slope and Hessian of the step's programme; returns the budget's multiplier.

    known: (the distance, the budget's multiplier, whether that is more than a guess).
    """
    (w, z), (slope, hessian), (distance, weight, is_known) = place, out, known
    k = w.size - 1
    cost_slope, curvature = np.empty(k), np.empty((k, k))
    cost_model(curves, aim.belief, w, cost_slope, curvature)
    slope[:] = 0.0
    hessian[:, :] = 0.0
    set_distance_model(rows, aim.point, basis, w, z, active, slope, hessian)
    length = max(distance, NO_DISTANCE)
    for a in range(k):
        for b in range(k):
            if aim.limit < np.inf:
                hessian[a, b] *= -aim.sign
            else:
                hessian[a, b] = -aim.sign * (hessian[a, b] - slope[a] * slope[b] / (length * length)) / length
    inner, square = 0.0, 0.0
    for a in range(k):
        if aim.limit < np.inf:
            slope[a] *= -aim.sign
        else:
            slope[a] = -aim.sign * slope[a] / length + aim.price * cost_slope[a]
        inner -= slope[a] * cost_slope[a]
        square += cost_slope[a] * cost_slope[a]
    if aim.limit < np.inf and not is_known and square > 0.0:
        weight = max(inner / square, 0.0)
    cost_weight = weight if aim.limit < np.inf else aim.price
    size = 0.0
    for a in range(k):
        for b in range(k):
            hessian[a, b] += cost_weight * curvature[a, b]
            size = max(size, abs(hessian[a, b]))
    for c in range(k, slope.size):
        hessian[c, c] = max(_WITNESS * size, _LEAST_WITNESS)
    return float(weight)


@uncounted
def _bend_rows(rows: Any, basis: Any, top: float, weights: Any, lines: Any, hessian: Any) -> None:
    """Add the curvature −Σ weight ∂²F/∂v∂s of the rows, and a large one across the active rows."""
    (units, lengths), (n_states, n) = lines, basis.shape
    k = hessian.shape[0] - n
    for r in range(lengths.size):
        if weights[r] == 0.0:
            continue
        if r < rows.shape[0]:
            for a in range(k):
                for c in range(n):
                    total = 0.0
                    for i in range(n_states):
                        total += rows[r, i, a] * basis[i, c]
                    total *= weights[r] / _EASE
                    hessian[a, k + c] -= total
                    hessian[k + c, a] -= total
        square = 0.0
        for a in range(k):
            square += units[r, a] * units[r, a]
        across = _ACROSS * top / max(square, _LEAST_SQUARE)
        for a in range(k + n):
            for b in range(k + n):
                hessian[a, b] += across * units[r, a] * units[r, b]


@internal
def _next_step(
    curves: Any, rows: Any, aim: Any, basis: Any, place: Any, known: Any, lines: Any, model: Any
) -> tuple[float, float]:
    """Fill the step from (w, z) and the multipliers of the lines; returns the gain that is promised, −1 where there is no step,
    and the budget's multiplier.

    Near multipliers of the last step the rows' curvature may shorten a step to nothing where a long one helps. Then one
    without it counts: else 1 of 400 decisions over six states loses 32 %, two .2 %.

    known: that of `_model`; model: (active rows, slope, Hessian, step, multipliers of the last step, memory).
    """
    (w, z), (units, sides, lengths) = place, lines
    active, slope, hessian, step, weights, memory = model
    k, m, has_budget = w.size - 1, rows.shape[0], aim.limit < np.inf
    promise, weight = -1.0, 0.0
    for _ in range(2):
        is_bent = bool(np.any(weights != 0.0))
        weight = _model(curves, rows, aim, basis, (w, z), active, known, (slope, hessian))
        top = largest_in(hessian, k)
        _bend_rows(rows, basis, top, weights, (units, lengths), hessian)
        # Convex in the decision; the member's own coordinates are not to be held back.
        factor_shifted(hessian, k, top, _GROWTH, memory.factor)
        promise = -1.0
        if quadratic_step(slope, units, sides, k, step, weights, memory):
            promise = 0.0
            for a in range(k):
                promise -= slope[a] * step[a]
            for r in range(lengths.size):
                weights[r] /= lengths[r]
            if has_budget:  # the model is of ½Ψ²
                promise, weight = promise / max(known[0], MET), weights[m]
        if promise > NO_GAIN or not is_bent:
            break
        weights[:] = 0.0
    return promise, float(weight)


@internal
def _move(w: Any, z: Any, step: Any, share: float, basis: Any, trial: Any, member: Any) -> None:
    """A share of the step from (w, z)."""
    k = w.size - 1
    for a in range(k):
        trial[a] = w[a] + share * step[a]
    for i in range(z.size):
        member[i] = z[i]
        for c in range(basis.shape[1]):
            member[i] += share * basis[i, c] * step[k + c] / _EASE


@internal
def ascend(face: Any, rows: Any, aim: Any, basis: Any, w: Any, z: Any, floor: float, room: Any) -> tuple[float, float]:
    """Improve the decision w, explained by z; both are replaced. Returns the value, −∞ where the search fails, and the budget's
    multiplier.

    `rows` begin with the k equalities, followed by the face's rows; `floor` is the best value known; `room` is a
    `DistanceRoom`.
    """
    n_states, n = basis.shape
    k = w.size - 1
    size, m = k + n, rows.shape[0]
    curves, has_budget = face.curves, aim.limit < np.inf
    lines = m + 1 if has_budget else m
    units, sides, lengths, weights = np.empty((lines, size)), np.empty(lines), np.empty(lines), np.zeros(lines)
    stepping = step_room(size, lines)
    hessian, slope, step, memory = np.empty((size, size)), np.empty(size), np.empty(size), by_reference(stepping)
    cost_slope, curvature = np.empty(k), np.empty((k, k))
    trial, member, nearest = w.copy(), z.copy(), np.empty(n_states)
    written, active = (units, sides, lengths), room.active[: k + face.n_set_rows]
    model = (active, slope, hessian, step, weights, memory)
    best, share, weight = np.inf, 1.0, 0.0
    for turn in range(_TRIALS):
        loss, distance, known = np.inf, np.inf, best < np.inf
        turns = LATER_TURNS if known else FIRST_TURNS
        if _pull(curves, rows, aim, basis, turns, (trial, member), written, memory):
            distance = nearest_belief(face, trial, aim.point, basis, NO_ROW, nearest, room)
        if distance < np.inf:
            loss = -aim.sign * distance
            if aim.price > 0.0:
                loss += aim.price * (cost_at(curves, aim.belief, trial) - aim.optimal_cost)
        if not loss < best:
            if not known:
                return -np.inf, 0.0
            share *= SHORTER
            if share < SHORTEST:
                break
        else:
            gain = best - loss
            best = loss
            put(trial, w)
            put(nearest, z)
            enough = max(_CREEP * abs(best), _OF_SHORTFALL * (floor + best))
            creeps = share == 1.0 and (_TRIALS - turn) * gain <= enough
            share = 1.0
            cost_model(curves, aim.belief, w, cost_slope, curvature)
            left = aim.limit - cost_at(curves, aim.belief, w) + aim.optimal_cost
            _write_rows(rows, basis, (w, z), cost_slope, left, written)
            state = (distance, weight, known)
            promise, weight = _next_step(curves, rows, aim, basis, (w, z), state, written, model)
            if promise <= NO_GAIN or (creeps and (_TRIALS - turn) * promise <= enough):
                break
        _move(w, z, step, share, basis, trial, member)
    release(stepping)
    return -best, weight
