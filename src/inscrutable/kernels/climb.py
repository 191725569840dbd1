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
    cost_at,
    regret_slope,
    row_slope,
    row_value,
    solve_kkt,
)
from inscrutable.kernels.options import integer, internal, uncounted
from inscrutable.kernels.projection import NO_EQUALITIES, at_unit_length, project_in, room_for
from inscrutable.kernels.references import by_reference, release
from inscrutable.kernels.rounding import NO_DISTANCE
from inscrutable.tolerances import EXPLAINED, PIVOT, POLISH, TINY

MET = EXPLAINED  # violation of a row that counts as none
PROJECTED = 0.01 * MET  # the same for the linearised rows that steps are projected on
NO_GAIN = POLISH**1.5  # gain that is not worth a step
FIRST_TURNS, LATER_TURNS = integer(8), integer(3)  # Newton steps onto the rows, from a start and from a step's end
_MOST_TRIALS = 180  # most trials of a climb: a few times the number of the slowest stored instance
_NEARBY = 1e-3
"""A row is left out of the steps until its value has come below this. With 1e-4 one of 960 decisions loses .006 %; where none
is left out two lotteries lose, up to .4 %, in up to 1.1 times the time."""
_MOST_SHIFTS, _FIRST_SHIFT = 60, 1e-3
"""Most shifts of the Hessian, and the first one in units of its size. With twelve, 10 of 960 decisions lose up to 12 %; with a
first one of .01 or .0001, five or six lose up to 4 %, three to five gain up to .1 %, and lotteries differ to either side."""
_GROWTH = 4.0
"""Factor from one shift to the next. With 2, one of 600 decisions over two to seven states, and with 10,
two lose up to 19 %."""
_CONVEX = 1e-9  # least share of a pivot that may remain
_ACROSS = 3.0
"""Curvature across rows that held, over the largest of the rest. With 1, 25 of these 600 lose up to 19 %, with 10 two."""
SHORTER, SHORTEST = 0.3, 1e-3
"""A step that does not help is cut to this share, and given up below that. With .15, two of 960 decisions lose, up to 1.7 %,
and two lotteries, .6 %; given up below .01, five decisions lose, up to 6 %, and three gain, as fast."""


class Aim(NamedTuple):
    """The objective: distance from `point` times `sign`, under a budget or at a price."""

    belief: Any  # (X,) the true belief
    point: Any  # (X,)
    sign: float
    optimal_cost: float
    limit: float  # largest regret; infinite where a price is set
    price: float  # 0 where a budget is set
    unit: float  # an excess of MET times this counts as none: the limit, or for smaller ones the rounding of costs over MET


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


@uncounted
def _loss(aim: Any, y: Any, regret: float) -> float:
    total = 0.0
    for i in range(y.size):
        total += (y[i] - aim.point[i]) * (y[i] - aim.point[i])
    if aim.limit < np.inf:
        return float(-aim.sign * 0.5 * total)
    return float(-aim.sign * np.sqrt(total) + aim.price * regret)


@uncounted
def _shortfall(rows: Any, y: Any, w: Any, over: float, live: Any) -> float:
    """The largest violation of any row, and of the budget relative to itself; rows that come near are marked live."""
    worst = max(over, 0.0)
    for r in range(rows.shape[0]):
        value = row_value(rows[r], y, w)
        worst = max(worst, -value)
        if value <= _NEARBY:
            live[r] = True
    return worst


@uncounted
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


@uncounted
def largest_in(matrix: Any, n: int) -> float:
    """The largest entry of the leading n×n block, in absolute value."""
    size = 0.0
    for i in range(n):
        for k in range(n):
            size = max(size, abs(matrix[i, k]))
    return size


@uncounted
def factor_shifted(hessian: Any, n_shifted: int, size: float, growth: float, factor: Any) -> None:
    """Fill the Cholesky factor of the first W + τI, I in the first `n_shifted` coordinates, that is positive definite: with
    τ = 0, then from a thousandth of `size`, that of W there, each τ `growth` times the former."""
    n, tau = factor.shape[0], 0.0
    for _ in range(_MOST_SHIFTS):
        positive = True
        for i in range(n):
            for k in range(n):
                factor[i, k] = hessian[i, k]
            if i < n_shifted:
                factor[i, i] += tau
            positive = positive and factor[i, i] > 0.0
        if positive and cholesky(factor, n, _CONVEX):
            return
        tau = max(growth * tau, _FIRST_SHIFT * size, TINY)


class StepRoom(NamedTuple):
    """Memory of a quadratic programme in n coordinates with m rows."""

    factor: Any  # L (n,n) of the Hessian W = LL'
    turned: Any  # (m,n) rows N L⁻ᵀ at unit length
    moved: Any  # (m,) their sides
    lengths: Any  # (m,) their former lengths
    projection: Any


@internal
def step_room(size: int, n_rows: int) -> StepRoom:
    """Return memory for quadratic programmes in `size` coordinates with `n_rows` rows."""
    return StepRoom(
        np.empty((size, size)), np.empty((n_rows, size)), np.empty(n_rows), np.empty(n_rows), room_for(size, n_rows)
    )


@uncounted
def quadratic_step(slope: Any, units: Any, sides: Any, n_equal: int, step: Any, weights: Any, room: Any) -> bool:
    """Minimise ½d'LL'd + slope·d under rows N d ≥ b, the first `n_equal` equalities: the projection of −L⁻¹ slope in x = L'd.

    L (n,n) is the factor in `room`, N the `units` (m,n), each of unit length, b the `sides` (m,). `step` (n,) and the
    multipliers `weights` (m,), of either sign for equalities, are filled; where False is returned they say nothing.
    """
    factor, turned, moved, lengths = room.factor, room.turned, room.moved, room.lengths
    n = step.size
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
    if not project_in(turned, moved, sides.size, n_equal, PROJECTED, step, weights, room.projection):
        return False
    for r in range(sides.size):
        weights[r] /= lengths[r]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            step[i] -= factor[k, i] * step[k]
        step[i] /= factor[i, i]
    return True


@uncounted
def _curvature(curves: Any, rows: Any, aim: Any, y: Any, place: Any, weights: Any, out: Any) -> None:
    """Hessian in y of the loss minus Σ weight_r f_r, plus the budget's weight, the last one, times ρ.

    With d = y − p it is −sign·I of the loss −sign ½‖d‖², and −sign (I − dd'/‖d‖²)/‖d‖ + price ∂²ρ of the loss at a price.
    out: (Hessian (X,X), memory (X+1,k)).
    """
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
    """Slope and Hessian of the step's programme in the reduced coordinates, B'(∂loss) and B'(`_curvature`)B.

    Across every row with a multiplier a large curvature is added: the last steps went along it.
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
                    hessian[c, d] += _ACROSS * size * units[r, c] * units[r, d]


@uncounted
def _restore(face: Any, aim: Any, basis: Any, turns: int, y: Any, w: Any, place: Any, room: Any) -> tuple[bool, float]:
    """Pull y the shortest way onto the linearised rows until all hold: whether they do, and the regret reached.

    room: (`_Lines`, multipliers (c,), step (n,), slope (X,), `ProjectionRoom`), all but the lines of no use afterwards.
    """
    curves, rows = face.curves, face.rows
    lines, moved, step, normal, projection = room
    regret = 0.0
    for turn in range(turns + 1):
        if not solve_kkt(curves, y, PIVOT, w, place.factor, place.gradients, place.slopes):
            return False, regret
        regret = cost_at(curves, aim.belief, w) - aim.optimal_cost
        over = (regret - aim.limit) / aim.unit if aim.limit < np.inf else 0.0
        if _shortfall(rows, y, w, over, lines.live) <= MET:
            return True, regret
        if turn == turns:
            return False, regret
        regret_slope(aim.belief, place.gradients, place.slopes, place.budget)
        _linearise(rows, y, w, place, aim.limit - regret, basis, lines, normal)
        step[:] = 0.0
        units, sides = lines.units, lines.sides
        if not project_in(units, sides, sides.size, NO_EQUALITIES, PROJECTED, step, moved, projection):
            return False, regret
        _move(basis, y, step, 1.0, y)
    return False, regret


@uncounted
def _move(basis: Any, origin: Any, step: Any, share: float, out: Any) -> None:
    """out = origin + share·basis step."""
    for i in range(origin.size):
        total = origin[i]
        for c in range(step.size):
            total += share * basis[i, c] * step[c]
        out[i] = total


@uncounted
def _price_of_budget(aim: Any, y: Any, budget: Any) -> float:
    """The budget's multiplier if its slope were along y − p: a first guess.

    Without it 14 of 1,440 decisions lose, up to 12 %.
    """
    length, lean = 0.0, 0.0
    for i in range(y.size):
        length += (y[i] - aim.point[i]) * (y[i] - aim.point[i])
        lean += (y[i] - aim.point[i]) * budget[i]
    return length / lean if aim.sign > 0.0 and lean > 0.0 else 0.0


@internal
def _place_for(n_states: int, k: int) -> _Place:
    """Memory for a decoy's decision with k free coordinates."""
    return _Place(np.empty((k, k)), np.empty((n_states, k)), np.empty((n_states, k)), np.empty(n_states))


@internal
def decide_on_face(face: Any, y: Any, w: Any) -> None:
    """Fill w (k+1,) with the decision of y (X,) on a face."""
    place = _place_for(y.size, w.size - 1)
    solve_kkt(face.curves, y, PIVOT, w, place.factor, place.gradients, place.slopes)


@internal
def climb(face: Any, aim: Any, basis: Any, y: Any, w: Any) -> tuple[float, float]:
    """Improve y (X,) on a face and leave its decision in w (k+1,); returns the least loss, infinite where none is allowed, and
    the budget's multiplier."""
    curves, rows, has_budget = face.curves, face.rows, aim.limit < np.inf
    n_states, n = basis.shape
    k, m = w.size - 1, rows.shape[0]
    count = m + 1 if has_budget else m
    place = _place_for(n_states, k)
    lines = _Lines(np.empty((count, n)), np.empty(count), np.empty(count), np.zeros(m, dtype=np.bool_))
    step, slope, hessian, weights = np.empty(n), np.empty(n), np.empty((n, n)), np.zeros(count)
    stepping, curving = step_room(n, count), (np.empty((n_states, n_states)), np.empty((n_states + 1, k)))
    memory = by_reference(stepping)
    trial, normal = y.copy(), np.empty(n_states)
    room = (lines, memory.moved, slope, normal, memory.projection)
    best, share = np.inf, 1.0
    for _ in range(_MOST_TRIALS):
        has_start = best < np.inf
        turns = LATER_TURNS if has_start else FIRST_TURNS
        allowed, regret = _restore(face, aim, basis, turns, trial, w, place, room)
        loss = _loss(aim, trial, regret)
        if allowed and loss < best:
            gain, best = best - loss, loss
            for i in range(n_states):
                y[i] = trial[i]
            if gain <= NO_GAIN and share == 1.0:
                break
            regret_slope(aim.belief, place.gradients, place.slopes, place.budget)
            _linearise(rows, y, w, place, aim.limit - regret, basis, lines, normal)
            if has_budget and not has_start:
                weights[m] = _price_of_budget(aim, y, place.budget)
            share = 1.0
            _model(curves, rows, aim, basis, y, place, (weights, lines.units), (slope, hessian, curving))
            factor_shifted(hessian, n, largest_in(hessian, n), _GROWTH, memory.factor)
            if not quadratic_step(slope, lines.units, lines.sides, NO_EQUALITIES, step, weights, memory):
                break
            promise = 0.0
            for c in range(n):
                promise -= slope[c] * step[c]
            for r in range(count):
                weights[r] /= lines.lengths[r]
            if promise <= NO_GAIN:
                break
        else:
            share *= SHORTER
            if not has_start or share < SHORTEST:
                break
        _move(basis, y, step, share, trial)
    solve_kkt(curves, y, PIVOT, w, place.factor, place.gradients, place.slopes)
    release(stepping)
    return best, weights[m] if has_budget else 0.0
