"""The best decoy on one face whose consistent sets are single beliefs: sequential quadratic programming, exact curvature.

A *climb* is such a local search, from a start to a local optimum.

With z the n = X−1 coordinates of y = z B' + const, minimise over the face

    −sign ½‖y − p‖²  under  ρ(y) ≤ r           (one decision), or
    −sign ‖y − p‖ + price·ρ(y)                  (an atom of a lottery),

under rows f_r(y) ≥ 0: probabilities, multipliers, slacks. All functions and their two derivatives come from `faces`; the
quadratic programme of each step is convexified along the rows that were active before, and its step is pulled back onto
the rows before it is judged.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.faces import (
    add_regret_curvature,
    add_row_curvature,
    cholesky,
    cost_under,
    regret_slope,
    row_slope,
    row_value,
    solve_kkt,
)
from inscrutable.kernels.options import inlined, integer, internal, uncounted
from inscrutable.kernels.projection import NO_EQUALITIES, at_unit_length, project_in, room_for
from inscrutable.kernels.rounding import NO_DISTANCE, TINY

# Newton steps onto the rows: from a start, from a step's end, and to see whether they hold.
_FIRST_TURNS, _LATER_TURNS, _NO_TURNS = integer(8), integer(3), integer(0)
_TRIALS_A_ROUND = 6
_NEARBY = 1e-3  # a row is left out of the steps until its value has come below this
_SHIFTS, _FIRST_SHIFT = 60, 1e-3  # of the Hessian, in units of its size
_GROWTH = 4.0  # of the shift, from one to the next
_CONVEX = 1e-9  # least share of a pivot that may remain
SHORTER, SHORTEST = 0.3, 1e-3  # a step that does not help is cut to this share, and given up below that


class Aim(NamedTuple):
    """The objective: distance from `point` times `sign`, under a budget or at a price."""

    belief: Any  # (X,) the true belief
    point: Any  # (X,)
    sign: float
    optimal_cost: float
    limit: float  # largest regret; infinite where a price is set
    price: float  # 0 where a budget is set


class Rules(NamedTuple):
    """Tolerances and the basis of the reduced coordinates."""

    pivot: float  # least share of a pivot that may remain
    near: float  # violation of a row that counts as none
    accuracy: float  # gain that is not worth a step
    rank: float  # equations of a set below this, relative to the gradient, determine nothing
    explained: float  # largest residual of an explained decision
    on_face: float  # largest violation of a row of a set
    inside: float  # share of a budget that is spent, so that rounding cannot break it
    spent: float  # a budget of which no more than this share is left counts as spent
    basis: Any  # (X, n) orthonormal, columns sum to zero


class _Place(NamedTuple):
    """Factor and derivatives at a decoy, k free coordinates."""

    factor: Any  # (k,k) Cholesky factor of the Hessian of its expected cost
    gradients: Any  # (X,k) of the states' costs
    slopes: Any  # (X,k) of its decision
    budget: Any  # (X,) slope of the regret


class _Lines(NamedTuple):
    """The rows at a decoy as half-spaces of the step, the budget's last."""

    units: Any  # (c,n)
    sides: Any  # (c,)
    lengths: Any  # (c,)
    live: Any  # (m,) rows that have come near


@inlined
def _loss(aim: Any, y: Any, regret: float) -> float:
    total = 0.0
    for i in range(y.size):
        total += (y[i] - aim.point[i]) * (y[i] - aim.point[i])
    if aim.limit < np.inf:
        return float(-aim.sign * 0.5 * total)
    return float(-aim.sign * np.sqrt(total) + aim.price * regret)


@inlined
def _shortfall(rows: Any, y: Any, w: Any, over: float, live: Any) -> float:
    """The largest violation of any row, and of the budget relative to itself; rows that come near are marked live."""
    worst = max(over, 0.0)
    for r in range(rows.shape[0]):
        value = row_value(rows[r], y, w)
        worst = max(worst, -value)
        if value <= _NEARBY:
            live[r] = True
    return worst


@inlined
def _write_row(slope: Any, value: float, basis: Any, lines: Any, r: int) -> None:
    """Row r of the step's programme, value + slope·δ ≥ 0 in the reduced coordinates, at unit length."""
    for c in range(basis.shape[1]):
        total = 0.0
        for i in range(slope.size):
            total += basis[i, c] * slope[i]
        lines.units[r, c] = total
    lines.sides[r], lines.lengths[r] = at_unit_length(lines.units[r], value)


@uncounted
def _linearise(rows: Any, y: Any, w: Any, place: Any, left: float, basis: Any, lines: Any, slope: Any) -> None:
    """The live rows at y, the budget's last; `slope` (X,) is memory."""
    m = rows.shape[0]
    for r in range(m):
        if not lines.live[r]:
            lines.units[r, :] = 0.0
            lines.sides[r], lines.lengths[r] = -1.0, 1.0
            continue
        row_slope(rows[r], y, w, place.slopes, slope)
        _write_row(slope, row_value(rows[r], y, w), basis, lines, r)
    if lines.units.shape[0] > m:
        for i in range(y.size):
            slope[i] = -place.budget[i]
        _write_row(slope, left, basis, lines, m)


@inlined
def largest_in(matrix: Any, n: int) -> float:
    """The largest entry of the leading n×n block, in absolute value."""
    size = 0.0
    for i in range(n):
        for k in range(n):
            size = max(size, abs(matrix[i, k]))
    return size


@inlined
def _convexified(matrix: Any, bends: tuple[int, float, float], factor: Any) -> None:
    """Factor matrix + shift, with the least of a few shifts of the first coordinates that makes it positive definite."""
    (n_shifted, size, growth), n, shift = bends, factor.shape[0], 0.0
    for _ in range(_SHIFTS):
        positive = True
        for i in range(n):
            for k in range(n):
                factor[i, k] = matrix[i, k]
            if i < n_shifted:
                factor[i, i] += shift
            positive = positive and factor[i, i] > 0.0
        if positive and cholesky(factor, n, _CONVEX):
            return
        shift = max(growth * shift, _FIRST_SHIFT * size, TINY)


class StepRoom(NamedTuple):
    """Memory of a quadratic programme in n coordinates with m rows."""

    factor: Any  # (n,n)
    turned: Any  # (m,n)
    moved: Any  # (m,)
    lengths: Any  # (m,)
    projection: Any


@internal
def step_room(size: int, n_rows: int) -> StepRoom:
    """Return memory for quadratic programmes in `size` coordinates with `n_rows` rows."""
    return StepRoom(
        np.empty((size, size)), np.empty((n_rows, size)), np.empty(n_rows), np.empty(n_rows), room_for(size, n_rows)
    )


@uncounted
def quadratic_step(model: Any, lines: Any, near: float, step: Any, weights: Any, room: Any) -> bool:
    """Minimise ½d'Wd + slope·d under rows N d ≥ b: with W = LL' the projection of −L⁻¹ slope in x = L'd.

    model: (W (n,n), slope (n,), (in how many of the first coordinates W is bent where it is not convex, the size of W there,
    how bends grow)); lines: (N (m,n) at unit length, b (m,), how many of the first rows are equalities). `step` (n,) and
    the multipliers `weights` (m,), of either sign for equalities, are filled; where False is returned they say nothing.
    """
    (hessian, slope, bends), (units, sides, n_equal) = model, lines
    factor, turned, moved, lengths, projection = room
    n = step.size
    _convexified(hessian, bends, factor)
    for i in range(n):
        total = -slope[i]
        for k in range(i):
            total -= factor[i, k] * step[k]
        step[i] = total / factor[i, i]
    for r in range(sides.size):
        length = 0.0
        for i in range(n):
            total = units[r, i]
            for k in range(i):
                total -= factor[i, k] * turned[r, k]
            turned[r, i] = total / factor[i, i]
            length += turned[r, i] * turned[r, i]
        length = np.sqrt(length) if length > 0.0 else 1.0
        for i in range(n):
            turned[r, i] /= length
        moved[r] = sides[r] / length
        lengths[r] = length
    if not project_in(turned, moved, sides.size, n_equal, near, step, weights, projection):
        return False
    for r in range(sides.size):
        weights[r] /= lengths[r]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            step[i] -= factor[k, i] * step[k]
        step[i] /= factor[i, i]
    return True


@inlined
def _curvature(curves: Any, rows: Any, aim: Any, y: Any, place: Any, weights: Any, out: Any) -> None:
    """Hessian of the loss minus the weighted rows; the budget's weight is the last. out: ((X,X), memory (X+2,k))."""
    full, scratch = out
    n_states = y.size
    square = 0.0
    for i in range(n_states):
        square += (y[i] - aim.point[i]) * (y[i] - aim.point[i])
    length = np.sqrt(square)
    on_regret = aim.price
    if aim.limit < np.inf:
        on_regret = weights[rows.shape[0]]
    for i in range(n_states):
        for k in range(n_states):
            same = 1.0 if i == k else 0.0
            if aim.limit < np.inf:
                full[i, k] = -aim.sign * same
            else:
                along = (y[i] - aim.point[i]) * (y[k] - aim.point[k]) / max(square, TINY)
                full[i, k] = -aim.sign * (same - along) / max(length, NO_DISTANCE)
    if on_regret != 0.0:
        add_regret_curvature(curves, aim.belief, y, place.gradients, place.slopes, on_regret, scratch, full)
    for r in range(rows.shape[0]):
        if weights[r] != 0.0:
            add_row_curvature(curves, rows[r], y, place.factor, place.slopes, -weights[r], scratch, full)


@uncounted
def _model(curves: Any, rows: Any, aim: Any, basis: Any, y: Any, place: Any, held: Any, out: Any) -> None:
    """Slope and Hessian of the step's programme in the reduced coordinates.

    held: (multipliers of the rows, their unit normals); out: (slope (n,), Hessian (n,n), memory of `_curvature`).
    """
    (weights, units), (slope, hessian, memory) = held, out
    n_states, n = basis.shape
    _curvature(curves, rows, aim, y, place, weights, memory)
    full, _ = memory
    length = 0.0
    for i in range(n_states):
        length += (y[i] - aim.point[i]) * (y[i] - aim.point[i])
    length = max(np.sqrt(length), NO_DISTANCE)
    size = 0.0
    for c in range(n):
        total = 0.0
        for i in range(n_states):
            pull = -aim.sign * (y[i] - aim.point[i])
            if not aim.limit < np.inf:
                pull = pull / length + aim.price * place.budget[i]
            total += basis[i, c] * pull
        slope[c] = total
        for d in range(n):
            total = 0.0
            for i in range(n_states):
                for k in range(n_states):
                    total += basis[i, c] * full[i, k] * basis[k, d]
            hessian[c, d] = total
            size = max(size, abs(total))
    for r in range(units.shape[0]):
        if weights[r] != 0.0:
            for c in range(n):
                for d in range(n):
                    hessian[c, d] += 3.0 * size * units[r, c] * units[r, d]


@uncounted
def _restore(face: Any, aim: Any, rules: Any, turns: int, y: Any, w: Any, place: Any, room: Any) -> tuple[bool, float]:
    """Pull y the shortest way onto the linearised rows until all hold: whether they do, and the regret reached.

    room: (`_Lines`, multipliers (c,), step (n,), slope (X,), `ProjectionRoom`), all but the lines of no use afterwards.
    """
    curves, rows = face.curves, face.rows
    lines, moved, step, normal, projection = room
    regret = 0.0
    for turn in range(turns + 1):
        if not solve_kkt(curves, y, rules.pivot, w, place.factor, place.gradients, place.slopes):
            return False, regret
        regret = cost_under(curves, aim.belief, w, place.gradients) - aim.optimal_cost
        over = (regret - aim.limit) / aim.limit if aim.limit < np.inf else 0.0
        if _shortfall(rows, y, w, over, lines.live) <= rules.near:
            return True, regret
        if turn == turns:
            return False, regret
        regret_slope(aim.belief, place.gradients, place.slopes, place.budget)
        _linearise(rows, y, w, place, aim.limit - regret, rules.basis, lines, normal)
        step[:] = 0.0
        units, sides = lines.units, lines.sides
        if not project_in(units, sides, sides.size, NO_EQUALITIES, 0.01 * rules.near, step, moved, projection):
            return False, regret
        _move(rules.basis, y, step, 1.0, y)
    return False, regret


@inlined
def _move(basis: Any, origin: Any, step: Any, share: float, out: Any) -> None:
    """out = origin + share·basis step."""
    for i in range(origin.size):
        total = origin[i]
        for c in range(step.size):
            total += share * basis[i, c] * step[c]
        out[i] = total


@inlined
def _price_of_budget(aim: Any, y: Any, budget: Any) -> float:
    """The budget's multiplier if its slope were along y − p: a first guess."""
    length, lean = 0.0, 0.0
    for i in range(y.size):
        length += (y[i] - aim.point[i]) * (y[i] - aim.point[i])
        lean += (y[i] - aim.point[i]) * budget[i]
    return length / lean if aim.sign > 0.0 and lean > 0.0 else 0.0


@internal
def climb(face: Any, aim: Any, rules: Any, y: Any, w: Any, rounds: int) -> tuple[float, float]:
    """Improve y (X,) on a face and leave its decision in w (k+1,); returns the least loss, infinite where none is allowed, and
    the budget's multiplier."""
    curves, rows, has_budget = face.curves, face.rows, aim.limit < np.inf
    n_states, n = rules.basis.shape
    k, m = w.size - 1, rows.shape[0]
    count = m + 1 if has_budget else m
    place = _Place(np.empty((k, k)), np.empty((n_states, k)), np.empty((n_states, k)), np.empty(n_states))
    lines = _Lines(np.empty((count, n)), np.empty(count), np.empty(count), np.zeros(m, dtype=np.bool_))
    step, slope, hessian, weights = np.empty(n), np.empty(n), np.empty((n, n)), np.zeros(count)
    memory, curving = step_room(n, count), (np.empty((n_states, n_states)), np.empty((n_states + 2, k)))
    trial, normal = y.copy(), np.empty(n_states)
    room = (lines, memory.moved, slope, normal, memory.projection)
    best, share, turns = np.inf, 1.0, _FIRST_TURNS
    for _ in range(rounds * _TRIALS_A_ROUND):
        allowed, regret = _restore(face, aim, rules, turns, trial, w, place, room)
        loss = _loss(aim, trial, regret)
        if allowed and loss < best:
            gain, best = best - loss, loss
            for i in range(n_states):
                y[i] = trial[i]
            if gain <= rules.accuracy and share == 1.0:
                break
            regret_slope(aim.belief, place.gradients, place.slopes, place.budget)
            _linearise(rows, y, w, place, aim.limit - regret, rules.basis, lines, normal)
            if turns == _FIRST_TURNS and has_budget:
                weights[m] = _price_of_budget(aim, y, place.budget)
            share, turns = 1.0, _LATER_TURNS
            _model(curves, rows, aim, rules.basis, y, place, (weights, lines.units), (slope, hessian, curving))
            below = (lines.units, lines.sides, NO_EQUALITIES)
            if not quadratic_step(
                (hessian, slope, (n, largest_in(hessian, n), _GROWTH)), below, 0.01 * rules.near, step, weights, memory
            ):
                break
            promise = 0.0
            for c in range(n):
                promise -= slope[c] * step[c]
            for r in range(count):
                weights[r] /= lines.lengths[r]
            if promise <= rules.accuracy:
                break
        else:
            share *= SHORTER
            if turns == _FIRST_TURNS or share < SHORTEST:
                break
        _move(rules.basis, y, step, share, trial)
    if not has_budget and aim.sign < 0.0:
        # The distance has a kink at the point itself, where steps by slopes do not end.
        for i in range(n_states):
            trial[i] = aim.point[i]
        allowed, regret = _restore(face, aim, rules, _NO_TURNS, trial, w, place, room)
        loss = _loss(aim, trial, regret)
        if allowed and loss < best:
            best = loss
            for i in range(n_states):
                y[i] = trial[i]
    solve_kkt(curves, y, rules.pivot, w, place.factor, place.gradients, place.slopes)
    return best, weights[m] if has_budget else 0.0
