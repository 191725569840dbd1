"""Decisions on one face of the feasible set as functions of the decoy y, with first and second derivatives.

On a face u = u_0 + Z v with k free coordinates v, so that with w = (v, 1) the state costs are c(i,·) = ½ w'C_i w and
everything else is a row  f_r(y) = Σ y_i R_ri·w: probabilities, slacks of loose constraints, multipliers of tight ones.
The decision of y on the face minimises Σ y_i c(i,·):

    H(y) v = −h(y),  H = Σ y_i C_i[:k,:k],  h = Σ y_i C_i[:k,k].

Let G_i = C_i[:k,:] w be the gradients (X,k) and T = G H⁻¹. Then ∂v/∂y_i = −T_i and, for regrets under the belief π,

    ∂ρ/∂y = −T (G'π),   ∂²ρ/∂y² = T G' + T B' + B T' + T H(π−y) T',   B_i = C_i[:k,:k] T'π,
    ∂f_r/∂y_i = R_ri·w − b·T_i,   ∂²f_r/∂y² = T D' + D T',   D_i = C_i[:k,:k] H⁻¹b − R_ri[:k],   b = Σ y_i R_ri[:k].
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import uncounted, uncounted_kernel
from inscrutable.tolerances import STATIONARITY


@uncounted
def cholesky(matrix: Any, n: int, pivot: float) -> bool:
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


@uncounted
def solve_factored(factor: Any, n: int, x: Any) -> None:
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


@uncounted
def solve_kkt(curves: Any, y: Any, pivot: float, w: Any, factor: Any, gradients: Any, slopes: Any) -> bool:
    """Fill w (k+1,), the Cholesky factor of H(y), G and T; False where the face has no unique decision."""
    n_states = y.size
    k = w.size - 1
    for a in range(k):
        for c in range(a + 1):
            total = 0.0
            for i in range(n_states):
                total += y[i] * curves[i, a, c]
            factor[a, c] = total
        total = 0.0
        for i in range(n_states):
            total -= y[i] * curves[i, a, k]
        w[a] = total
    w[k] = 1.0
    if not cholesky(factor, k, pivot):
        return False
    solve_factored(factor, k, w)
    for i in range(n_states):
        for a in range(k):
            total = curves[i, a, k]
            for c in range(k):
                total += curves[i, a, c] * w[c]
            gradients[i, a] = total
            slopes[i, a] = total
        solve_factored(factor, k, slopes[i])
    return True


@uncounted_kernel
def place_on_face(origin: Any, span: Any, bounds: Any, w: Any, out: Any) -> None:
    """Fill the decision u_0 + Z v (U,); a coordinate that differs from a bound of its own by rounding is put on it."""
    low, high = bounds
    for j in range(out.size):
        total = origin[j]
        for a in range(span.shape[1]):
            total += span[j, a] * w[a]
        if abs(total - low[j]) <= STATIONARITY:
            total = low[j]
        if abs(total - high[j]) <= STATIONARITY:
            total = high[j]
        out[j] = total


@uncounted
def cost_at(curves: Any, belief: Any, w: Any) -> float:
    """Σ π_i ½ w'C_i w."""
    total = 0.0
    for i in range(belief.size):
        for a in range(w.size):
            inner = 0.0
            for c in range(w.size):
                inner += curves[i, a, c] * w[c]
            total += 0.5 * belief[i] * w[a] * inner
    return total


@uncounted
def regret_slope(belief: Any, gradients: Any, slopes: Any, out: Any) -> None:
    """∂ρ/∂y = −T (G'π)."""
    n_states, k = gradients.shape
    for i in range(n_states):
        out[i] = 0.0
    for a in range(k):
        total = 0.0
        for i in range(n_states):
            total += belief[i] * gradients[i, a]
        for i in range(n_states):
            out[i] -= total * slopes[i, a]


@uncounted
def add_symmetric(slopes: Any, other: Any, weight: float, out: Any) -> None:
    """out += weight (T D' + D T')."""
    n_states, k = slopes.shape
    for i in range(n_states):
        for j in range(i + 1):
            total = 0.0
            for a in range(k):
                total += slopes[i, a] * other[j, a] + other[i, a] * slopes[j, a]
            out[i, j] += weight * total
            if i != j:
                out[j, i] += weight * total


@uncounted
def add_regret_curvature(
    curves: Any, belief: Any, y: Any, gradients: Any, slopes: Any, weight: float, scratch: Any, out: Any
) -> None:
    """out += weight ∂²ρ/∂y²; scratch is (X+1, k).

    T G' and T H(π−y) T' are symmetric, so with B the sum is T D' + D T' for D = B + ½G + ½ T H(π−y).
    """
    n_states, k = gradients.shape
    mean = scratch[n_states]
    for a in range(k):
        total = 0.0
        for i in range(n_states):
            total += belief[i] * slopes[i, a]
        mean[a] = total
    for j in range(n_states):
        for a in range(k):
            total = 0.5 * gradients[j, a]
            for c in range(k):
                total += curves[j, a, c] * mean[c]
                twisted = 0.0
                for i in range(n_states):
                    twisted += (belief[i] - y[i]) * curves[i, a, c]
                total += 0.5 * twisted * slopes[j, c]
            scratch[j, a] = total
    add_symmetric(slopes, scratch[:n_states], weight, out)


@uncounted
def row_value(row: Any, y: Any, w: Any) -> float:
    """Σ y_i R_i·w for a row (X, k+1)."""
    total = 0.0
    for i in range(y.size):
        inner = 0.0
        for a in range(w.size):
            inner += row[i, a] * w[a]
        total += y[i] * inner
    return total


@uncounted
def row_slope(row: Any, y: Any, w: Any, slopes: Any, out: Any) -> None:
    """R_i·w − b·T_i for every state i."""
    n_states, k = slopes.shape
    for i in range(n_states):
        total = row[i, k]
        for a in range(k):
            total += row[i, a] * w[a]
        out[i] = total
    for a in range(k):
        b = 0.0
        for i in range(n_states):
            b += y[i] * row[i, a]
        if b != 0.0:
            for i in range(n_states):
                out[i] -= b * slopes[i, a]


@uncounted
def add_row_curvature(
    curves: Any, row: Any, y: Any, factor: Any, slopes: Any, weight: float, scratch: Any, out: Any
) -> None:
    """out += weight ∂²f/∂y²; scratch is (X+1, k)."""
    n_states, k = slopes.shape
    q = scratch[n_states]
    for a in range(k):
        total = 0.0
        for i in range(n_states):
            total += y[i] * row[i, a]
        q[a] = total
    solve_factored(factor, k, q)
    for i in range(n_states):
        for a in range(k):
            total = -row[i, a]
            for c in range(k):
                total += curves[i, a, c] * q[c]
            scratch[i, a] = total
    add_symmetric(slopes, scratch[:n_states], weight, out)
