"""The consistent beliefs of one decision on a face, and the member nearest to a point.

At w = (v, 1) the beliefs that explain the decision are {π ∈ Δ : G'π = 0, Σ π_i R_ri·w ≥ 0}, with the gradients
G_i = C_i[:k,:] w in the face's coordinates and the rows R of the probabilities and multipliers.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import bare_kernel, kernel, woven
from inscrutable.kernels.projection import carved, project_in


@woven
def _equalities(
    curves: Any, scale: float, w: Any, rules: Any, units: Any, sides: Any, used: Any, work: Any, right: Any, row: Any
) -> int:
    """Orthonormal rows of G'π = 0 in the reduced coordinates; −1 where they contradict each other."""
    n_states, n = rules.basis.shape
    k = w.size - 1
    for a in range(k):
        mean = 0.0
        for i in range(n_states):
            total = 0.0
            for c in range(k + 1):
                total += curves[i, a, c] * w[c]
            row[i] = total
            mean += total / n_states
        right[a] = -mean
        for c in range(n):
            total = 0.0
            for i in range(n_states):
                total += rules.basis[i, c] * row[i]
            work[a, c] = total
    for a in range(k):
        used[a] = False
    n_equal = 0
    while n_equal < n:
        largest, which = rules.rank * scale, -1
        for a in range(k):
            if not used[a]:
                length = 0.0
                for c in range(n):
                    length += work[a, c] * work[a, c]
                length = np.sqrt(length)
                if length > largest:
                    largest, which = length, a
        if which < 0:
            break
        used[which] = True
        for c in range(n):
            units[n_equal, c] = work[which, c] / largest
        sides[n_equal] = right[which] / largest
        for a in range(k):
            if not used[a]:
                total = 0.0
                for c in range(n):
                    total += work[a, c] * units[n_equal, c]
                for c in range(n):
                    work[a, c] -= total * units[n_equal, c]
                right[a] -= total * sides[n_equal]
        n_equal += 1
    for a in range(k):
        if not used[a] and abs(right[a]) > rules.explained * scale:
            return -1
    return n_equal


@woven
def _inequalities(
    rows: Any, w: Any, rules: Any, first: int, units: Any, sides: Any, number: Any, coefficients: Any
) -> int:
    """Unit rows of Σ π_i R_ri·w ≥ 0 from `first` on, and which r each is; returns where they end, −1 where one is broken."""
    n_states, n = rules.basis.shape
    k = w.size - 1
    last = first
    for r in range(rows.shape[0]):
        mean = 0.0
        for i in range(n_states):
            total = 0.0
            for c in range(w.size):
                total += rows[r, i, c] * w[c]
            coefficients[i] = total
            mean += total / n_states
        length = 0.0
        for c in range(n):
            total = 0.0
            for i in range(n_states):
                total += rules.basis[i, c] * coefficients[i]
            units[last, c] = total
            length += total * total
        length = np.sqrt(length)
        if length <= 1e-13:
            if mean < -rules.explained:
                return -1
            continue
        for c in range(n):
            units[last, c] /= length
        sides[last] = -mean / length
        number[last - first] = k + r
        last += 1
    return last


@kernel
def nearest_belief(
    curves: Any, rows: Any, scale: float, w: Any, point: Any, rules: Any, out: Any, active: Any
) -> float:
    """Fill the consistent belief nearest to `point` (X,) and return its distance; infinite where there is none.

    `rows` are the face's probabilities and multipliers, `scale` is the size of the gradients; `active` (k+m,) says which
    equations and rows hold it there.
    """
    n_states, n = rules.basis.shape
    m = rows.shape[0]
    k, most = w.size - 1, n + m
    floats = most * (n + 2) + k * n + k + n_states + n + (n + 1) * (2 * n + 4) + n
    flat, whole, bits = np.empty(floats), np.empty(m + n + 1, dtype=np.int64), np.empty(most, dtype=np.bool_)
    units, at = flat[: most * n].reshape((most, n)), most * n
    sides, multipliers, at = flat[at : at + most], flat[at + most : at + 2 * most], at + 2 * most
    work, at = flat[at : at + k * n].reshape((k, n)), at + k * n
    right, row, z, at = (
        flat[at : at + k],
        flat[at + k :][:n_states],
        flat[at + k + n_states :][:n],
        at + k + n_states + n,
    )
    number = whole[:m]
    room = carved(flat[at:], whole[m:], bits, n, most)
    n_equal = _equalities(curves, scale, w, rules, units, sides, active, work, right, row)
    if n_equal < 0:
        return np.inf
    last = _inequalities(rows, w, rules, n_equal, units, sides, number, row)
    if last < 0:
        return np.inf
    for c in range(n):
        total = 0.0
        for i in range(n_states):
            total += rules.basis[i, c] * (point[i] - 1.0 / n_states)
        z[c] = total
    if not project_in(units, sides, last, n_equal, rules.on_face, z, multipliers, room):
        return np.inf
    for r in range(k, k + m):
        active[r] = False
    for r in range(n_equal, last):
        active[number[r - n_equal]] = multipliers[r] > 0.0
    square = 0.0
    for i in range(n_states):
        total = 1.0 / n_states
        for c in range(n):
            total += rules.basis[i, c] * z[c]
        out[i] = total
        square += (total - point[i]) ** 2
    return float(np.sqrt(square))


@bare_kernel
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
