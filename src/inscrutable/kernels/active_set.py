"""Quadratic programmes over bounds and a few equalities, eight beliefs at a time, and the costs of their decisions.

min ½u'H(π)u + g(π)'u with H(π) = Σ π_i H_i, g(π) = Σ π_i g_i over {l ≤ u ≤ h, A u = b}.

Block principal pivoting: guess which coordinates are free, F, and at which bound the others, B; then

    H_FF u_F = A_F'ν − (g_F + H_FB u_B),   A_F u_F = b − A_B u_B.

If l ≤ u_F ≤ h, and the multiplier of each bound, its entry of H u + g − A'ν, is ≥ 0 at a lower and ≤ 0 at an upper
one, u is the minimiser. Otherwise every violating coordinate changes sides; where that does not help, the last of
them alone does, which ends for positive definite H. The first guess is the active set of a belief solved shortly before.
Only the rows of coordinates that are free for one of eight neighbouring beliefs are factored. A coordinate that is free in
another lane only has a row of the unit matrix in this one: it changes no digit of the answer.

Of H_FF = L D L', with ones on the diagonal of L, the product L D is kept row by row, n = |F| numbers to a row, with 1/D_jj
on its diagonal; below it stand the rows A_F and −∇_F, which the same elimination turns into C = A_F L'⁻¹ and
y = L⁻¹(−∇_F). What each row of the array `lanes` holds is named below.

Source: Júdice and Pires, A block principal pivoting algorithm for large-scale strictly monotone linear
complementarity problems, Computers & Operations Research 21 (1994).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.calls import deferred
from inscrutable.kernels.lanes import LANES, blank, entry, inverse, load, magnitude, some, spread, store, where
from inscrutable.kernels.options import internal, kernel, uncounted, uncounted_kernel

_ROUNDS = 60  # block exchanges before a belief is left to another method; three to six are usual
_PATIENCE = 3.0  # exchanges in a row that may fail to lower the number of violations
_ROOM = 256  # entries of the first matrices; larger ones are made when needed
_TILE = 4  # rows or columns worked on together; arrays have room for a last tile that is not full
_LANES = _SOUND, _SCALE, _OFFENDERS, _FEWEST, _LEFT = 0, 1, 2, 3, 4  # rows of `lanes`; _LEFT is the patience left


@internal
def _eliminate(matrix: Any, n: int, first: int, rows: int, pivot: float, diagonal: Any, lanes: Any) -> None:
    """Divide rows first to `rows` by L', and where first is 0 make L D; a lane whose pivot shrinks too far is not sound."""
    for j in range(first, n):
        store(diagonal, j, load(matrix, j * n + j))
    for j in range(n):
        if j >= first:
            left = load(diagonal, j)
            sound = left > spread(pivot) * load(matrix, j * n + j)
            store(lanes, _SOUND, where(sound, load(lanes, _SOUND), spread(0.0)))
            store(matrix, j * n + j, inverse(where(sound, left, spread(1.0))))
        scale = load(matrix, j * n + j)
        for i in range(max(j + 1, first), rows, _TILE):
            p, q, r, s = i * n, (i + 1) * n, (i + 2) * n, (i + 3) * n
            a, b, c, d = load(matrix, p + j), load(matrix, q + j), load(matrix, r + j), load(matrix, s + j)
            for k in range(j):
                other = load(matrix, j * n + k) * load(matrix, k * n + k)
                a -= load(matrix, p + k) * other
                b -= load(matrix, q + k) * other
                c -= load(matrix, r + k) * other
                d -= load(matrix, s + k) * other
            store(matrix, p + j, a)
            store(matrix, q + j, b)
            store(matrix, r + j, c)
            store(matrix, s + j, d)
            store(diagonal, i, load(diagonal, i) - a * a * scale)
            store(diagonal, i + 1, load(diagonal, i + 1) - b * b * scale)
            store(diagonal, i + 2, load(diagonal, i + 2) - c * c * scale)
            store(diagonal, i + 3, load(diagonal, i + 3) - d * d * scale)


@internal
def _back(matrix: Any, n: int, row: int) -> None:
    """x = L'⁻¹ D⁻¹ x for the row that starts at `row`."""
    for i in range(n - 1, -1, -1):
        x = load(matrix, row + i) * load(matrix, i * n + i)
        store(matrix, row + i, x)
        for k in range(i):
            store(matrix, row + k, load(matrix, row + k) - load(matrix, i * n + k) * x)


@uncounted
def _guess(region: Any, state: Any, u: Any, free: Any, held: Any) -> Any:
    """Put u at its bounds, and at zero where free; list what is free in some lane and what is held in some."""
    lower, upper = region[0], region[1]
    # Typed as they end: for a plain literal the functions called with them would be compiled a second time.
    n, n_held, zero = np.int64(0), np.int64(0), spread(0.0)
    for j in range(u.shape[0]):
        side = load(state, j)
        is_free = side == zero
        store(u, j, where(is_free, zero, where(side < zero, entry(lower, j), entry(upper, j))))
        if some(is_free):
            free[n] = j
            n += 1
        if some(side != zero):
            held[n_held] = j
            n_held += 1
    return n, n_held


@uncounted
def _assemble(belief: Any, hessians: Any, rows: Any, state: Any, free: Any, n: int, n_equal: int, out: Any) -> None:
    """H_FF over A_F, and H_FF once more; a coordinate not free in a lane has a row of the unit matrix and of zeros there."""
    (matrix, curved), size, n_states = out, state.shape[0], belief.shape[0]
    zero = spread(0.0)
    for a in range(n):
        j = free[a]
        mine = load(state, j) == zero
        for c in range(a + 1):
            place = (j * size + free[c]) * n_states
            total = spread(0.0)
            for i in range(n_states):
                total += load(belief, i) * entry(hessians, place + i)
            total = where(mine & (load(state, free[c]) == zero), total, zero)
            store(matrix, a * n + c, total)
            store(curved, a * n + c, total)
            store(curved, c * n + a, total)
        store(matrix, a * n + a, where(mine, load(matrix, a * n + a), spread(1.0)))
        for e in range(n_equal):
            store(matrix, (n + e) * n + a, where(mine, entry(rows, e * size + j), zero))
    for k in range((n + n_equal) * n, (n + n_equal + _TILE) * n):
        store(matrix, k, zero)


@internal
def _residual(belief: Any, costs: Any, region: Any, rows: Any, n_rows: int, room: Any) -> None:
    """H u + g − A'ν in the given rows, reading only the columns of coordinates that are not zero.

    The largest |H u + g| met so far is the scale.
    """
    hessians, linear = costs
    u, reduced, nu, _, weights, _, lanes, columns, _, _ = room
    transposed, n_equal = region[5], region[3].size
    n_states, n, zero = belief.shape[0], 0, spread(0.0)
    for k in range(u.shape[0]):
        value = load(u, k)
        if some(value != zero):
            columns[n] = k * u.shape[0] * n_states
            for i in range(n_states):
                store(weights, n * n_states + i, load(belief, i) * value)
            n += 1
    for k in range(n, n + (-n) % _TILE):
        columns[k] = 0
        for i in range(n_states):
            store(weights, k * n_states + i, zero)
    for r in range(n_rows):
        total = spread(0.0)
        for i in range(n_states):
            total += load(belief, i) * entry(linear, rows[r] * n_states + i)
        store(reduced, rows[r], total)
    for k in range(0, n, _TILE):
        a, b, c, d = columns[k], columns[k + 1], columns[k + 2], columns[k + 3]
        first, second, third, fourth = k * n_states, (k + 1) * n_states, (k + 2) * n_states, (k + 3) * n_states
        # Two rows at a time, each one sum in the columns' order: what is zero in a lane changes no digit there.
        for r in range(0, n_rows, 2):
            one, two = rows[r], rows[min(r + 1, n_rows - 1)]
            start, next_start = one * n_states, two * n_states
            total, other = load(reduced, one), load(reduced, two)
            for i in range(n_states):
                total += load(weights, first + i) * entry(hessians, a + start + i)
                other += load(weights, first + i) * entry(hessians, a + next_start + i)
            for i in range(n_states):
                total += load(weights, second + i) * entry(hessians, b + start + i)
                other += load(weights, second + i) * entry(hessians, b + next_start + i)
            for i in range(n_states):
                total += load(weights, third + i) * entry(hessians, c + start + i)
                other += load(weights, third + i) * entry(hessians, c + next_start + i)
            for i in range(n_states):
                total += load(weights, fourth + i) * entry(hessians, d + start + i)
                other += load(weights, fourth + i) * entry(hessians, d + next_start + i)
            store(reduced, one, total)
            store(reduced, two, other)
    largest = load(lanes, _SCALE)
    for r in range(n_rows):
        total = load(reduced, rows[r])
        largest = where(magnitude(total) > largest, magnitude(total), largest)
        for e in range(n_equal):
            total -= entry(transposed, rows[r] * n_equal + e) * load(nu, e)
        store(reduced, rows[r], total)
    store(lanes, _SCALE, largest)


@internal
def _residual_of_free(region: Any, state: Any, n: int, curved: Any, base: Any, room: Any) -> None:
    """H u + g − A'ν in the rows of a lane's free coordinates, from the part `base` that those at their bounds make."""
    u, reduced, nu, _, _, _, lanes, _, free, _ = room
    transposed, n_equal, zero = region[5], region[3].size, spread(0.0)
    largest = load(lanes, _SCALE)
    for a in range(n):
        total = load(base, a)
        for c in range(n):
            total += load(curved, a * n + c) * load(u, free[c])
        mine = load(state, free[a]) == zero
        total = where(mine, total, zero)
        largest = where(magnitude(total) > largest, magnitude(total), largest)
        for e in range(n_equal):
            total -= entry(transposed, free[a] * n_equal + e) * load(nu, e)
        store(reduced, free[a], where(mine, total, load(reduced, free[a])))
    store(lanes, _SCALE, largest)


@uncounted
def _improve(region: Any, state: Any, factors: Any, n: int, again: int, pivot: float, room: Any) -> None:
    """One Newton step of u and ν on the guessed free coordinates: from u_F = 0 to its minimiser, then again for the rounding.

    x = L'⁻¹ D⁻¹(y + C'ν) and ν = S⁻¹(r − C D⁻¹ y) with S = C D⁻¹ C' and r = b − A u.
    """
    matrix, small = factors
    u, reduced, nu, _, _, diagonal, lanes, _, free, _ = room
    sides, rows = region[3], region[4]
    n_equal, size, zero = sides.size, u.shape[0], spread(0.0)
    last, lacks = (n + n_equal) * n, n_equal * n_equal
    for a in range(n):
        store(matrix, last + a, where(load(state, free[a]) == zero, zero - load(reduced, free[a]), zero))
    _eliminate(matrix, n, (n + n_equal) * again, n + n_equal + 1, pivot, diagonal, lanes)
    for e in range(n_equal):
        for d in range((e + 1) * (1 - again)):
            total = spread(0.0)
            for k in range(n):
                total += load(matrix, (n + e) * n + k) * load(matrix, (n + d) * n + k) * load(matrix, k * n + k)
            store(small, e * n_equal + d, total)
        total = entry(sides, e)
        for j in range(size):
            total -= load(u, j) * entry(rows, e * size + j)
        for k in range(n):
            total -= load(matrix, (n + e) * n + k) * load(matrix, last + k) * load(matrix, k * n + k)
        store(small, lacks + e, total)
    _eliminate(small, n_equal, n_equal * again, n_equal + 1, pivot, diagonal, lanes)
    _back(small, n_equal, lacks)
    for e in range(n_equal):
        more = load(small, lacks + e)
        store(nu, e, load(nu, e) + more)
        for k in range(n):
            store(matrix, last + k, load(matrix, last + k) + load(matrix, (n + e) * n + k) * more)
    _back(matrix, n, last)
    for a in range(n):
        store(u, free[a], load(u, free[a]) + load(matrix, last + a))


@uncounted
def _exchange(region: Any, state: Any, near: float, room: Any) -> bool:
    """Change the side of coordinates beyond a bound by more than `near` or with a multiplier of the wrong sign; any left?"""
    u, reduced, _, moved, _, _, lanes, _, _, _ = room
    lower, upper = region[0], region[1]
    zero, one, margin = spread(0.0), spread(1.0), spread(near)
    against, found = margin * load(lanes, _SCALE), spread(0.0)
    for j in range(u.shape[0]):
        side, value = load(state, j), load(u, j)
        low, high = entry(lower, j), entry(upper, j)
        out = where(value < low - margin, zero - one, where(value > high + margin, one, zero))
        stays = where((low < high) & (side * load(reduced, j) > against), zero, side)
        to = where(side == zero, out, stays)
        store(moved, j, to)
        found += where(to == side, zero, one)
    sound = load(lanes, _SOUND) > zero
    offends = sound & (found > zero)
    store(lanes, _OFFENDERS, load(lanes, _OFFENDERS) + where(sound, found, one))
    if not some(offends):
        return False
    fewest = load(lanes, _FEWEST)
    fewer = found < fewest
    left = where(fewer, spread(_PATIENCE), load(lanes, _LEFT) - one)
    store(lanes, _FEWEST, where(offends & fewer, found, fewest))
    store(lanes, _LEFT, where(offends, left, load(lanes, _LEFT)))
    taken = zero
    for j in range(u.shape[0] - 1, -1, -1):
        side, to = load(state, j), load(moved, j)
        store(state, j, where(offends & ((left > zero - one) | (taken == zero)), to, side))
        taken = where(to == side, taken, one)
    return True


@uncounted
def _put_inside(region: Any, state: Any, near: float, n: int, curved: Any, base: Any, room: Any) -> Any:
    """Put u inside its bounds, exactly on those it is near; sound where H u + g = A'ν on F and A u = b still hold."""
    u, reduced, _, _, _, _, lanes, _, free, _ = room
    lower, upper, _, sides, rows, _ = region
    size, zero, margin = u.shape[0], spread(0.0), spread(near)
    good = where(load(lanes, _OFFENDERS) == zero, load(lanes, _SOUND), zero)
    allowed = margin * load(lanes, _SCALE)
    for a in range(n):
        value, low, high = load(u, free[a]), entry(lower, free[a]), entry(upper, free[a])
        value = where(value - low <= margin, low, where(high - value <= margin, high, value))
        store(u, free[a], value)
    _residual_of_free(region, state, n, curved, base, room)
    for a in range(n):
        fine = (magnitude(load(reduced, free[a])) <= allowed) | (load(state, free[a]) != zero)
        good = where(fine, good, zero)
    for e in range(sides.size):
        total = zero - entry(sides, e)
        largest = magnitude(total)
        for j in range(size):
            product = entry(rows, e * size + j) * load(u, j)
            total += product
            largest = where(magnitude(product) > largest, magnitude(product), largest)
        good = where(magnitude(total) <= margin * largest, good, zero)
    store(lanes, _SOUND, good)


@internal
def _solve_group(belief: Any, costs: Any, region: Any, limits: Any, state: Any, factors: Any, room: Any) -> Any:
    """Exchange until no lane has a violation; leaves the minimisers in `room`, valid where `_SOUND` holds."""
    pivot, near = limits
    matrix, small, curved, base = factors
    u, reduced, nu, _, _, _, lanes, _, free, held = room
    size, n_equal = u.shape[0], nu.shape[0]
    store(lanes, _SOUND, spread(1.0))
    store(lanes, _FEWEST, spread(size + 1.0))
    store(lanes, _LEFT, spread(_PATIENCE))
    for attempt in range(1, _ROUNDS + 1):
        n, n_held = _guess(region, state, u, free, held)
        if (n + n_equal + _TILE) * n > matrix.shape[0]:
            matrix = blank((n + 2 * _TILE + n_equal + _TILE) * (n + 2 * _TILE))
            curved = blank((n + 2 * _TILE) * (n + 2 * _TILE))
        _assemble(belief, costs[0], region[4], state, free, n, n_equal, (matrix, curved))
        store(lanes, _SCALE, spread(0.0))
        store(lanes, _OFFENDERS, spread(0.0))
        for e in range(n_equal):
            store(nu, e, spread(0.0))
        _residual(belief, costs, region, free, n, room)
        for a in range(n):
            store(base, a, load(reduced, free[a]))
        for again in range(2):
            if again == 1:
                _residual_of_free(region, state, n, curved, base, room)
            _improve(region, state, (matrix, small), n, again, pivot, room)
            if again == 0:
                _residual(belief, costs, region, held, n_held, room)
            offended = _exchange(region, state, near, room)
            if offended and attempt < _ROUNDS:
                break
        if not offended or attempt == _ROUNDS:
            _put_inside(region, state, near, n, curved, base, room)
            break
    return matrix, small, curved, base


@uncounted
def _sides_of(start: Any, region: Any, state: Any) -> None:
    """−1, 0, +1 for each coordinate of a decision at its lower bound, between, at its upper bound, in every lane."""
    for j in range(start.size):
        side = -1.0 if start[j] <= region[0][j] else (1.0 if start[j] >= region[1][j] else 0.0)
        store(state, j, spread(side))


@kernel
def solve_path(
    beliefs: Any, order: Any, costs: Any, region: Any, limits: Any, start: Any, actions: Any, solved: Any
) -> None:
    """Fill the rows `order` of actions (T,U) for those of beliefs (T,X), one after the other.

    `costs` is (H_jki at (j·U + k)·X + i, g_ji at j·X + i), `region` (lower, upper, equalities, sides, the equalities'
    entries row by row, column by column), `limits` (least share of a pivot that may remain, largest KKT residual
    relative to the gradient); the assets that `start` (U,) holds are the first guess. Where solved[t] stays False the
    caller must use another method.
    """
    count, size = order.size, actions.shape[1]
    n_states, n_equal = beliefs.shape[1], region[3].size
    room_at_first = _ROOM + n_equal
    factors = (
        blank(room_at_first),  # L D of H_FF, A_F and −∇_F below it
        blank((n_equal + _TILE) * n_equal),  # that of S
        blank(room_at_first),  # H_FF
        blank(size),  # H_FB u_B + g_F
    )
    belief, state = blank(n_states), blank(size)
    room = (
        blank(size),  # u
        blank(size),  # H u + g − A'ν
        blank(n_equal),  # ν
        blank(size),  # the sides that coordinates move to
        blank((size + _TILE) * n_states),  # π_i u_k
        blank(size + n_equal + _TILE),  # what is left of the diagonal
        blank(n_equal + len(_LANES)),
        np.empty(size + _TILE, dtype=np.int64),
        np.empty(size, dtype=np.int64),
        np.empty(size, dtype=np.int64),
    )
    u, lanes = room[0], room[6]
    _sides_of(start, region, state)
    for first in range(0, count, LANES):
        for lane in range(LANES):
            # A last group that is not full repeats its last belief.
            for i in range(n_states):
                belief[i, lane] = beliefs[order[min(first + lane, count - 1)], i]
        factors = _solve_group(belief, costs, region, limits, state, factors, room)
        last = -1
        for lane in range(min(LANES, count - first)):
            if lanes[_SOUND, lane] > 0.0:
                last = lane
                solved[order[first + lane]] = True
                for j in range(size):
                    actions[order[first + lane], j] = u[j, lane]
        if last < 0:
            _sides_of(start, region, state)
        else:
            for j in range(size):
                store(state, j, spread(state[j, last]))


@deferred(uncounted_kernel)
def quadratic_costs(actions: Any, hessians: Any, linear: Any, costs: Any) -> None:
    """Fill ½ u'H_i u + g_i'u of decisions u (T,U) for all states i, shape (T,X): H_jki at (j·U + k)·X + i, g_ji at j·X + i.

    Coordinates that are zero take no part: a portfolio of many assets holds few.
    """
    size, n_states = actions.shape[1], costs.shape[1]
    for t in range(len(actions)):
        costs[t] = 0.0
        for j in range(size):
            u = actions[t, j]
            if u != 0.0:
                for i in range(n_states):
                    costs[t, i] += u * (linear[j * n_states + i] + 0.5 * u * hessians[(j * size + j) * n_states + i])
                for k in range(j):
                    both = u * actions[t, k]
                    if both != 0.0:
                        for i in range(n_states):
                            costs[t, i] += both * hessians[(j * size + k) * n_states + i]
