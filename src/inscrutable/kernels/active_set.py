"""Quadratic programmes over bounds and a few equalities, solved along a path of beliefs.

min ½u'H(π)u + g(π)'u with H(π) = Σ π_i H_i, g(π) = Σ π_i g_i over {l ≤ u ≤ h, A u = b}.

A primal active-set method: the feasible set does not depend on the belief, so the last decision is a feasible start for
the next belief, and neighbouring beliefs mostly hold the same assets. With F the free coordinates and B the others,

    u_F = W'ν − z,   W = A_F H_FF⁻¹,   z = H_FF⁻¹ (g_F + H_FB u_B),   (A_F H_FF⁻¹ A_F') ν = b − A_B u_B + A_F z,

so nothing larger than the held assets is ever factored. The multiplier of a coordinate at its bound is its entry of
H u + g − A'ν, to be ≥ 0 at the lower and ≤ 0 at the upper bound.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange


@njit(cache=True)
def _cholesky(matrix: Any, n: int, pivot: float) -> bool:
    """Factor the leading n×n block in place into its lower triangle; False where a pivot shrinks below `pivot`."""
    for j in range(n):
        diagonal = matrix[j, j]
        original = diagonal
        for k in range(j):
            diagonal -= matrix[j, k] * matrix[j, k]
        if not diagonal > pivot * original:
            return False
        root = np.sqrt(diagonal)
        matrix[j, j] = root
        for i in range(j + 1, n):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total / root
    return True


@njit(cache=True)
def _solve_factored(factor: Any, n: int, x: Any) -> None:
    """Overwrite x with (L L')⁻¹ x."""
    for i in range(n):
        total = x[i]
        for k in range(i):
            total -= factor[i, k] * x[k]
        x[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * x[k]
        x[i] = total / factor[i, i]


@njit(cache=True)
def _gradient(belief: Any, hessians: Any, linear: Any, u: Any, out: Any) -> None:
    """out = H(π) u + g(π), reading only the rows of held coordinates."""
    n_states, size = linear.shape
    for j in range(size):
        total = 0.0
        for i in range(n_states):
            total += belief[i] * linear[i, j]
        out[j] = total
    for k in range(size):
        if u[k] != 0.0:
            for i in range(n_states):
                weight = belief[i] * u[k]
                if weight != 0.0:
                    row = hessians[i, k]
                    for j in range(size):
                        out[j] += weight * row[j]


@njit(cache=True)
def _newton(
    belief: Any,
    hessians: Any,
    free: Any,
    n_free: int,
    gradient: Any,
    equalities: Any,
    unmet: Any,
    work: Any,
    pivot: float,
) -> bool:
    """Step p on the free coordinates to the minimiser of the face: work.step and work.nu; False where singular.

    H_FF p = A_F'ν − ∇_F, A_F p = unmet.
    """
    factor, columns, small, step, nu = work
    n_states = belief.size
    n_equal = equalities.shape[0]
    for a in range(n_free):
        for c in range(a + 1):
            total = 0.0
            for i in range(n_states):
                total += belief[i] * hessians[i, free[a], free[c]]
            factor[a, c] = total
    if not _cholesky(factor, n_free, pivot):
        return False
    for a in range(n_free):
        step[a] = -gradient[free[a]]
    _solve_factored(factor, n_free, step)
    for e in range(n_equal):
        for a in range(n_free):
            columns[e, a] = equalities[e, free[a]]
        _solve_factored(factor, n_free, columns[e])
    for e in range(n_equal):
        total = unmet[e]
        for a in range(n_free):
            total -= equalities[e, free[a]] * step[a]
        nu[e] = total
        for d in range(e + 1):
            inner = 0.0
            for a in range(n_free):
                inner += equalities[e, free[a]] * columns[d, a]
            small[e, d] = inner
    if n_equal > 0:
        if not _cholesky(small, n_equal, pivot):
            return False
        _solve_factored(small, n_equal, nu)
    for e in range(n_equal):
        for a in range(n_free):
            step[a] += nu[e] * columns[e, a]
    return True


@njit(cache=True)
def _left_over(equalities: Any, sides: Any, u: Any, out: Any) -> None:
    """out = b − A u."""
    for e in range(sides.size):
        total = sides[e]
        for j in range(u.size):
            total -= equalities[e, j] * u[j]
        out[e] = total


@njit(cache=True)
def _advance(free: Any, n_free: int, step: Any, region: Any, u: Any, state: Any) -> bool:
    """u += θ p with the longest θ ≤ 1 inside the bounds; a coordinate that stops it is put on its bound. True if θ = 1."""
    lower, upper = region[0], region[1]
    length = 1.0
    blocking = -1
    for a in range(n_free):
        j = free[a]
        if step[a] < 0.0 and u[j] + step[a] < lower[j]:
            reach = (lower[j] - u[j]) / step[a]
        elif step[a] > 0.0 and u[j] + step[a] > upper[j]:
            reach = (upper[j] - u[j]) / step[a]
        else:
            continue
        if reach < length:
            length = max(reach, 0.0)
            blocking = a
    for a in range(n_free):
        u[free[a]] += length * step[a]
    if blocking >= 0:
        j = free[blocking]
        state[j] = -1 if step[blocking] < 0.0 else 1
        u[j] = lower[j] if step[blocking] < 0.0 else upper[j]
    return blocking < 0


@njit(cache=True)
def _settle(free: Any, n_free: int, step: Any, region: Any, near: float, u: Any) -> None:
    """u += p on the free coordinates, kept inside the bounds; what ends within `near` of a bound is put on it."""
    lower, upper = region[0], region[1]
    for a in range(n_free):
        j = free[a]
        u[j] = min(max(u[j] + step[a], lower[j]), upper[j])
        if u[j] - lower[j] <= near:
            u[j] = lower[j]
        elif upper[j] - u[j] <= near:
            u[j] = upper[j]


@njit(cache=True)
def _entering(gradient: Any, region: Any, nu: Any, state: Any, least: float) -> int:
    """The bound whose multiplier has the wrong sign by most, beyond `least`; −1 for none."""
    lower, upper, equalities, _ = region
    found = -1
    for j in range(state.size):
        if state[j] != 0 and lower[j] < upper[j]:
            reduced = gradient[j]
            for e in range(nu.size):
                reduced -= equalities[e, j] * nu[e]
            if state[j] * reduced > least:
                least = state[j] * reduced
                found = j
    return found


@njit(cache=True)
def _solve_one(
    belief: Any, costs: Any, region: Any, limits: Any, u: Any, state: Any, free: Any, gradient: Any, work: Any
) -> bool:
    """Move the feasible u to the minimiser; state is −1, 0, +1 per coordinate. False where the method gave up."""
    hessians, linear = costs
    _, _, equalities, sides = region
    pivot, stationarity = limits
    step, nu = work[3], work[4]
    unmet = np.empty(sides.size)
    for _ in range(50 + 10 * u.size):
        _gradient(belief, hessians, linear, u, gradient)
        scale = np.abs(gradient).max()
        n_free = 0
        for j in range(u.size):
            if state[j] == 0:
                free[n_free] = j
                n_free += 1
        _left_over(equalities, sides, u, unmet)
        if n_free < sides.size or not _newton(belief, hessians, free, n_free, gradient, equalities, unmet, work, pivot):
            return False
        if not _advance(free, n_free, step, region, u, state):
            continue
        # One more step with the factors at hand removes the rounding of the first; then the multipliers are read.
        _gradient(belief, hessians, linear, u, gradient)
        _left_over(equalities, sides, u, unmet)
        _refine(free, n_free, gradient, equalities, unmet, work)
        _settle(free, n_free, step, region, stationarity, u)
        entering = _entering(gradient, region, nu, state, stationarity * scale)
        if entering < 0:
            return _is_stationary(belief, costs, region, stationarity * scale, stationarity, u, state, gradient, nu)
        state[entering] = 0
    return False


@njit(cache=True)
def _is_stationary(
    belief: Any, costs: Any, region: Any, allowed: float, relative: float, u: Any, state: Any, gradient: Any, nu: Any
) -> bool:
    """Whether H u + g − A'ν vanishes on the free coordinates and A u = b, both to a few roundings."""
    hessians, linear = costs
    equalities, sides = region[2], region[3]
    n_equal, size = equalities.shape
    _gradient(belief, hessians, linear, u, gradient)
    for j in range(size):
        if state[j] == 0:
            reduced = gradient[j]
            for e in range(n_equal):
                reduced -= equalities[e, j] * nu[e]
            if not abs(reduced) <= allowed:
                return False
    for e in range(n_equal):
        total = -sides[e]
        size_of = abs(sides[e])
        for j in range(size):
            total += equalities[e, j] * u[j]
            size_of = max(size_of, abs(equalities[e, j] * u[j]))
        if not abs(total) <= relative * size_of:
            return False
    return True


@njit(cache=True)
def _refine(free: Any, n_free: int, gradient: Any, equalities: Any, unmet: Any, work: Any) -> None:
    """The Newton step again, with the factors at hand."""
    factor, columns, small, step, nu = work
    n_equal = equalities.shape[0]
    for a in range(n_free):
        step[a] = -gradient[free[a]]
    _solve_factored(factor, n_free, step)
    for e in range(n_equal):
        total = unmet[e]
        for a in range(n_free):
            total -= equalities[e, free[a]] * step[a]
        nu[e] = total
    if n_equal > 0:
        _solve_factored(small, n_equal, nu)
    for e in range(n_equal):
        for a in range(n_free):
            step[a] += nu[e] * columns[e, a]


@njit(cache=True, parallel=True)
def solve_path(
    beliefs: Any, costs: Any, region: Any, limits: Any, start: Any, chunk: int, actions: Any, solved: Any
) -> None:
    """Fill actions (T,U) for beliefs (T,X) in order; chunks of fixed length are independent, whatever the threads.

    `costs` is (hessians (X,U,U), linear (X,U)), `region` (lower, upper, equalities, sides), `limits` (least share of a
    pivot that may remain, largest KKT residual relative to the gradient); `start` (U,) is feasible. Where solved[t]
    stays False the caller must use another method.
    """
    count, size = actions.shape
    n_equal = region[2].shape[0]
    for block in prange((count + chunk - 1) // chunk):
        factor = np.empty((size, size))
        columns = np.empty((n_equal, size))
        small = np.empty((n_equal, n_equal))
        step = np.empty(size)
        nu = np.empty(n_equal)
        work = (factor, columns, small, step, nu)
        gradient = np.empty(size)
        free = np.empty(size, dtype=np.int64)
        state = np.empty(size, dtype=np.int64)
        u = start.copy()
        for j in range(size):
            state[j] = -1 if u[j] <= region[0][j] else (1 if u[j] >= region[1][j] else 0)
        for t in range(block * chunk, min(count, (block + 1) * chunk)):
            ok = _solve_one(beliefs[t], costs, region, limits, u, state, free, gradient, work)
            solved[t] = ok
            if not ok:
                u[:] = start
                for j in range(size):
                    state[j] = -1 if u[j] <= region[0][j] else (1 if u[j] >= region[1][j] else 0)
            actions[t] = u
