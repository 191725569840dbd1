"""Quadratic programmes over bounds and a few equalities, eight beliefs at a time.

min ½u'H(π)u + g(π)'u with H(π) = Σ π_i H_i, g(π) = Σ π_i g_i over {l ≤ u ≤ h, A u = b}.

Block principal pivoting: guess which coordinates are free, F, and at which bound the others, B; then

    H_FF u_F = A_F'ν − (g_F + H_FB u_B),   A_F u_F = b − A_B u_B.

If l ≤ u_F ≤ h, and the multiplier of each bound, its entry of H u + g − A'ν, is ≥ 0 at a lower and ≤ 0 at an upper
one, u is the minimiser. Otherwise every coordinate that offends changes sides; where that does not help, the last of
them alone does, which ends for positive definite H. The guess is what the last belief but a few held, and nothing larger
than the free coordinates of eight neighbouring beliefs is ever factored. A coordinate that is free in another lane
only has a row of the unit matrix in this one: it changes no digit of the answer.

Source: Júdice and Pires, A block principal pivoting algorithm for large-scale strictly monotone linear
complementarity problems, Computers & Operations Research 21 (1994).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from inscrutable.kernels.lanes import LANES, minus_dot, mix, plus_mix, times

_ROUNDS = 60  # block exchanges before a belief is left to another method; three to six are usual
_PATIENCE = 3  # exchanges in a row that may fail to lower the number of offenders


@njit(error_model="numpy")
def _cholesky(factor: Any, n: int, pivot: float, ok: Any) -> None:
    """H = L L' in place, row i at i·n, with 1/L_jj on the diagonal; ok turns False where a pivot shrinks too far."""
    before = np.empty(LANES)
    for j in range(n):
        for lane in range(LANES):
            before[lane] = factor[j * n + j, lane]
        minus_dot(factor, j * n + j, factor, j * n, factor, j * n, j)
        for lane in range(LANES):
            left = factor[j * n + j, lane]
            if not left > pivot * before[lane]:
                ok[lane] = False
                left = 1.0
            factor[j * n + j, lane] = 1.0 / np.sqrt(left)
        for i in range(j + 1, n):
            minus_dot(factor, i * n + j, factor, i * n, factor, j * n, j)
            times(factor, i * n + j, factor, j * n + j)


@njit(error_model="numpy")
def _forward(factor: Any, n: int, x: Any, first: int) -> None:
    """x = L⁻¹ x, rows first to first + n."""
    for i in range(n):
        minus_dot(x, first + i, factor, i * n, x, first, i)
        times(x, first + i, factor, i * n + i)


@njit(error_model="numpy")
def _backward(factor: Any, n: int, x: Any) -> None:
    """x = L'⁻¹ x."""
    for i in range(n - 1, -1, -1):
        times(x, i, factor, i * n + i)
        for k in range(i):
            minus_dot(x, k, factor, i * n + k, x, i, 1)


@njit(error_model="numpy")
def _step(factor: Any, columns: Any, small: Any, n: int, x: Any, nu: Any) -> None:
    """With x = −∇_F and ν = what A u lacks: ν = S⁻¹(ν − C'L⁻¹x) and x = L'⁻¹(L⁻¹x + C ν), C = L⁻¹A_F', S = C'C."""
    n_equal = nu.shape[0]
    _forward(factor, n, x, 0)
    for e in range(n_equal):
        minus_dot(nu, e, columns, e * n, x, 0, n)
    if n_equal > 0:
        _forward(small, n_equal, nu, 0)
        _backward(small, n_equal, nu)
    for e in range(n_equal):
        for lane in range(LANES):
            nu[e, lane] = -nu[e, lane]
        for a in range(n):
            minus_dot(x, a, columns, e * n + a, nu, e, 1)
        for lane in range(LANES):
            nu[e, lane] = -nu[e, lane]
    _backward(factor, n, x)


@njit(error_model="numpy")
def _prepare(belief: Any, costs: Any, region: Any, free: Any, n: int, state: Any, pivot: float, work: Any) -> None:
    """Form and factor H_FF and S; a coordinate not free in a lane has a row of the unit matrix there."""
    hessians, size, n_states = costs[0], state.shape[0], belief.shape[0]
    equalities = region[2]
    factor, columns, small, ok = work
    for a in range(n):
        for c in range(a + 1):
            row = a * n + c
            mix(factor, row, belief, 0, hessians, (free[a] * size + free[c]) * n_states, n_states)
    for a in range(n):
        for lane in range(LANES):
            if state[free[a], lane] != 0:
                for c in range(a):
                    factor[a * n + c, lane] = 0.0
                for i in range(a + 1, n):
                    factor[i * n + a, lane] = 0.0
                factor[a * n + a, lane] = 1.0
    _cholesky(factor, n, pivot, ok)
    n_equal = equalities.shape[0]
    for e in range(n_equal):
        for a in range(n):
            for lane in range(LANES):
                columns[e * n + a, lane] = equalities[e, free[a]] if state[free[a], lane] == 0 else 0.0
        _forward(factor, n, columns, e * n)
        for d in range(e + 1):
            # minus the minus: S_ed = Σ_a C_ea C_da
            for lane in range(LANES):
                small[e * n_equal + d, lane] = 0.0
            minus_dot(small, e * n_equal + d, columns, e * n, columns, d * n, n)
            for lane in range(LANES):
                small[e * n_equal + d, lane] = -small[e * n_equal + d, lane]
    _cholesky(small, n_equal, pivot, ok)


@njit(error_model="numpy")
def _gradient(belief: Any, costs: Any, u: Any, rows: Any, n: int, weights: Any, out: Any) -> None:
    """out[j] = (H(π) u + g(π))_j for the n given rows j, reading only the columns of coordinates that are not zero."""
    hessians, linear = costs
    size, n_states = u.shape[0], belief.shape[0]
    for r in range(n):
        mix(out, rows[r], belief, 0, linear, rows[r] * n_states, n_states)
    for k in range(size):
        some = False
        for lane in range(LANES):
            some |= u[k, lane] != 0.0
        if some:
            for i in range(n_states):
                for lane in range(LANES):
                    weights[i, lane] = belief[i, lane]
                times(weights, i, u, k)
            for r in range(n):
                plus_mix(out, rows[r], weights, 0, hessians, (k * size + rows[r]) * n_states, n_states)


@njit(error_model="numpy")
def _offenders(u: Any, reduced: Any, region: Any, state: Any, limits: Any, offends: Any, counts: Any) -> None:
    """Mark what is free outside its bounds, by more than `near`, or held there against its multiplier; count by lane."""
    lower, upper = region[0], region[1]
    near, scale = limits
    for lane in range(LANES):
        counts[lane] = 0
    for j in range(u.shape[0]):
        may_move = lower[j] < upper[j]
        for lane in range(LANES):
            side = state[j, lane]
            if side == 0:
                below, above = u[j, lane] < lower[j] - near, u[j, lane] > upper[j] + near
                found = -1 if below else (1 if above else 0)
            else:
                found = 2 if may_move and side * reduced[j, lane] > near * scale[lane] else 0
            offends[j, lane] = found
            if found != 0:
                counts[lane] += 1


@njit(error_model="numpy")
def _exchange(offends: Any, state: Any, lane: int, only_last: bool) -> None:
    """What offends changes sides."""
    for j in range(state.shape[0] - 1, -1, -1):
        found = offends[j, lane]
        if found != 0:
            state[j, lane] = 0 if found == 2 else found
            if only_last:
                return


@njit(error_model="numpy")
def _point(belief: Any, costs: Any, region: Any, state: Any, pivot: float, vectors: Any, work: Any) -> Any:
    """The minimiser u of the guessed face and H u + g − A'ν there, both after one refinement of u and ν."""
    lower, upper, _, sides, rows, transposed = region
    u, reduced, x, nu, more, weights, free, everything, scale = vectors
    factor, columns, small, ok = work
    size, n_equal = u.shape[0], sides.size
    n = 0
    for j in range(size):
        some = False
        for lane in range(LANES):
            side = state[j, lane]
            u[j, lane] = 0.0 if side == 0 else (lower[j] if side < 0 else upper[j])
            some |= side == 0
        if some:
            free[n] = j
            n += 1
    if n * n > factor.shape[0]:
        factor = np.empty((min(size, n + 8) ** 2, LANES))
    _prepare(belief, costs, region, free, n, state, pivot, (factor, columns, small, ok))
    for lane in range(LANES):
        scale[lane] = 0.0
        for e in range(n_equal):
            nu[e, lane] = 0.0
    for attempt in range(2):
        # u is first zero on F, then a minimiser but for rounding, which the same step with what is left removes.
        _gradient(belief, costs, u, everything if attempt else free, size if attempt else n, weights, reduced)
        for e in range(n_equal):
            mix(more, e, u, 0, rows, e * size, size)
            for lane in range(LANES):
                more[e, lane] = sides[e] - more[e, lane]
        # Terms may cancel in the gradient of the minimiser, so the largest of g_F + H_FB u_B counts as well.
        for r in range(size if attempt else n):
            for lane in range(LANES):
                scale[lane] = max(scale[lane], abs(reduced[everything[r] if attempt else free[r], lane]))
        if attempt:
            for e in range(n_equal):
                for lane in range(LANES):
                    nu[e, lane] = -nu[e, lane]
            for j in range(size):
                plus_mix(reduced, j, nu, 0, transposed, j * n_equal, n_equal)
            for e in range(n_equal):
                for lane in range(LANES):
                    nu[e, lane] = -nu[e, lane]
        for a in range(n):
            for lane in range(LANES):
                x[a, lane] = -reduced[free[a], lane] if state[free[a], lane] == 0 else 0.0
        _step(factor, columns, small, n, x, more)
        for a in range(n):
            for lane in range(LANES):
                u[free[a], lane] += x[a, lane]
        for e in range(n_equal):
            for lane in range(LANES):
                nu[e, lane] += more[e, lane]
    return factor, n


@njit(error_model="numpy")
def _settled(belief: Any, costs: Any, region: Any, state: Any, near: float, vectors: Any, n: int, good: Any) -> None:
    """Put u inside its bounds, exactly on those it is near; good where H u + g = A'ν on F and A u = b still hold."""
    lower, upper, equalities, sides, _, transposed = region
    u, reduced, _, nu, _, weights, free, _, scale = vectors
    n_equal = sides.size
    for a in range(n):
        j = free[a]
        for lane in range(LANES):
            value = min(max(u[j, lane], lower[j]), upper[j])
            if value - lower[j] <= near:
                value = lower[j]
            elif upper[j] - value <= near:
                value = upper[j]
            u[j, lane] = value
    _gradient(belief, costs, u, free, n, weights, reduced)
    for a in range(n):
        j = free[a]
        for lane in range(LANES):
            total = reduced[j, lane]
            for e in range(n_equal):
                total -= transposed[j * n_equal + e] * nu[e, lane]
            if state[j, lane] == 0 and not abs(total) <= near * scale[lane]:
                good[lane] = False
    for e in range(n_equal):
        for lane in range(LANES):
            total = -sides[e]
            largest = abs(total)
            for j in range(u.shape[0]):
                part = equalities[e, j] * u[j, lane]
                total += part
                largest = max(largest, abs(part))
            if not abs(total) <= near * largest:
                good[lane] = False


@njit(error_model="numpy")
def _solve_lanes(belief: Any, costs: Any, region: Any, limits: Any, state: Any, vectors: Any, work: Any) -> Any:
    """Exchange until every lane has its minimiser in the first array returned, or is not solved in the second."""
    pivot, near = limits
    u, reduced, scale = vectors[0], vectors[1], vectors[8]
    factor, columns, small, ok = work
    size = u.shape[0]
    answer = np.empty((size, LANES))
    offends = np.empty((size, LANES), dtype=np.int8)
    counts = np.empty(LANES, dtype=np.int64)
    fewest = np.full(LANES, size + 1)
    patience = np.full(LANES, _PATIENCE)
    good = np.empty(LANES, dtype=np.bool_)
    open_lane = np.ones(LANES, dtype=np.bool_)
    solved = np.zeros(LANES, dtype=np.bool_)
    for lane in range(LANES):
        ok[lane] = True
    for _ in range(_ROUNDS):
        factor, n = _point(belief, costs, region, state, pivot, vectors, (factor, columns, small, ok))
        _offenders(u, reduced, region, state, (near, scale), offends, counts)
        ended = False
        for lane in range(LANES):
            good[lane] = open_lane[lane] and ok[lane] and counts[lane] == 0
            ended |= good[lane]
        if ended:
            _settled(belief, costs, region, state, near, vectors, n, good)
        left = False
        for lane in range(LANES):
            if not open_lane[lane]:
                continue
            if not ok[lane] or counts[lane] == 0:
                open_lane[lane] = False
                solved[lane] = good[lane]
                for j in range(size):
                    answer[j, lane] = u[j, lane]
                continue
            left = True
            if counts[lane] < fewest[lane]:
                fewest[lane], patience[lane] = counts[lane], _PATIENCE
            else:
                patience[lane] -= 1
            _exchange(offends, state, lane, patience[lane] < 0)
        if not left:
            break
    return answer, solved, factor


@njit(error_model="numpy")
def _sides_of(start: Any, region: Any, state: Any, lane: int) -> None:
    """−1, 0, +1 for each coordinate of a decision at its lower bound, between, at its upper bound."""
    for j in range(start.size):
        state[j, lane] = -1 if start[j] <= region[0][j] else (1 if start[j] >= region[1][j] else 0)


@njit(cache=True, nogil=True, error_model="numpy")
def solve_path(beliefs: Any, costs: Any, region: Any, limits: Any, start: Any, actions: Any, solved: Any) -> None:
    """Fill actions (T,U) for beliefs (T,X) in order.

    `costs` is (H_jki at (j·U + k)·X + i, g_ji at j·X + i), `region` (lower, upper, equalities, sides, the equalities'
    entries row by row, column by column), `limits` (least share of a pivot that may remain, largest KKT residual
    relative to the gradient); the assets that `start` (U,) holds are the first guess. Where solved[t] stays False the
    caller must use another method.
    """
    count, size = actions.shape
    n_states, n_equal = beliefs.shape[1], region[3].size
    ok = np.ones(LANES, dtype=np.bool_)
    work = (np.empty((256, LANES)), np.empty((n_equal * size, LANES)), np.empty((n_equal * n_equal, LANES)), ok)
    vectors = (
        np.empty((size, LANES)),
        np.empty((size, LANES)),
        np.empty((size, LANES)),
        np.empty((n_equal, LANES)),
        np.empty((n_equal, LANES)),
        np.empty((n_states, LANES)),
        np.empty(size, dtype=np.int64),
        np.arange(size),
        np.zeros(LANES),
    )
    belief = np.empty((n_states, LANES))
    state = np.empty((size, LANES), dtype=np.int8)
    for lane in range(LANES):
        _sides_of(start, region, state, lane)
    for first in range(0, count, LANES):
        for lane in range(LANES):
            # A last group that is not full repeats its last belief.
            for i in range(n_states):
                belief[i, lane] = beliefs[min(first + lane, count - 1), i]
        answer, done, factor = _solve_lanes(belief, costs, region, limits, state, vectors, work)
        work = (factor, work[1], work[2], ok)
        last = -1
        for lane in range(min(LANES, count - first)):
            solved[first + lane] = done[lane]
            for j in range(size):
                actions[first + lane, j] = answer[j, lane]
            if done[lane]:
                last = lane
        for lane in range(LANES):
            if last < 0:
                _sides_of(start, region, state, lane)
            elif lane != last:
                for j in range(size):
                    state[j, lane] = state[j, last]
