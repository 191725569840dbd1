"""The point nearest to a given one under linear rows: a dual active-set method for a handful of coordinates.

min ½‖x − p‖² over N x ≥ b, the first `n_equal` rows as equalities. Rows enter one by one, the most violated first; with Q
an orthonormal basis of the active normals the step is z = (I − QQ')n for a new normal n, and the multipliers η move by −R⁻¹Q'n.
(Goldfarb and Idnani 1983, with the identity as Hessian.)
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import kernel, part


@part
def _orthonormal(rows: Any, active: Any, n_active: int, basis: Any, upper: Any) -> None:
    """basis (q,n) and upper triangle R with rows[active]' = basis' R, by modified Gram-Schmidt."""
    size = rows.shape[1]
    for c in range(n_active):
        for i in range(size):
            basis[c, i] = rows[active[c], i]
        for k in range(c):
            inner = 0.0
            for i in range(size):
                inner += basis[k, i] * basis[c, i]
            upper[k, c] = inner
            for i in range(size):
                basis[c, i] -= inner * basis[k, i]
        length = 0.0
        for i in range(size):
            length += basis[c, i] * basis[c, i]
        length = np.sqrt(length)
        upper[c, c] = length
        for i in range(size):
            basis[c, i] /= length


@part
def _split(normal: Any, n_active: int, basis: Any, upper: Any, across: Any, along: Any) -> float:
    """across = (I − QQ')n, along = R⁻¹Q'n; returns ‖across‖²."""
    size = normal.size
    for i in range(size):
        across[i] = normal[i]
    for k in range(n_active):
        inner = 0.0
        for i in range(size):
            inner += basis[k, i] * across[i]
        along[k] = inner
        for i in range(size):
            across[i] -= inner * basis[k, i]
    for k in range(n_active - 1, -1, -1):
        for c in range(k + 1, n_active):
            along[k] -= upper[k, c] * along[c]
        along[k] /= upper[k, k]
    total = 0.0
    for i in range(size):
        total += across[i] * across[i]
    return total


@part
def _most_violated(rows: Any, sides: Any, n_rows: int, n_equal: int, x: Any, near: float, entered: Any) -> int:
    worst, least = -1, near
    for r in range(n_rows):
        if entered[r]:
            continue
        total = -sides[r]
        for i in range(x.size):
            total += rows[r, i] * x[i]
        if r < n_equal:
            return r
        if -total > least:
            worst, least = r, -total
    return worst


@kernel
def project(rows: Any, sides: Any, n_rows: int, n_equal: int, near: float, x: Any, multipliers: Any) -> bool:
    """Move x (n,) to the nearest point of the rows, each of unit length; False where they leave nothing.

    `near` is the violation that counts as none. multipliers (m,) are filled; those of equalities have either sign.
    """
    size = x.size
    active = np.empty(size + 1, dtype=np.int64)
    eta = np.zeros(size + 1)
    basis = np.empty((size + 1, size))
    upper = np.empty((size + 1, size + 1))
    across = np.empty(size)
    along = np.empty(size + 1)
    entered = np.zeros(n_rows, dtype=np.bool_)
    for r in range(n_rows):
        multipliers[r] = 0.0
    n_active = 0
    for _ in range(20 + 4 * n_rows):
        new = _most_violated(rows, sides, n_rows, n_equal, x, near, entered)
        if new < 0:
            for c in range(n_active):
                multipliers[active[c]] = eta[c]
            return True
        total = -sides[new]
        for i in range(size):
            total += rows[new, i] * x[i]
        sign = -1.0 if new < n_equal and total > 0.0 else 1.0
        violation = sign * total
        entering = 0.0
        entered[new] = True
        while True:
            _orthonormal(rows, active, n_active, basis, upper)
            for i in range(size):
                along[i] = 0.0
            room = _split(sign * rows[new], n_active, basis, upper, across, along)
            longest, leaving = np.inf, -1
            for c in range(n_active):
                if active[c] >= n_equal and along[c] > 0.0 and eta[c] / along[c] < longest:
                    longest, leaving = eta[c] / along[c], c
            if n_active >= size or room <= 1e-14:
                if violation >= -near:  # nothing left to remove: the row repeats active ones
                    break
                if leaving < 0:
                    return False
                step = longest
            else:
                step = min(longest, -violation / room)
                for i in range(size):
                    x[i] += step * across[i]
                violation += step * room
            for c in range(n_active):
                eta[c] -= step * along[c]
            entering += step
            if step < longest or leaving < 0:
                active[n_active] = new
                eta[n_active] = sign * entering
                n_active += 1
                break
            entered[active[leaving]] = False
            for c in range(leaving, n_active - 1):
                active[c] = active[c + 1]
                eta[c] = eta[c + 1]
            n_active -= 1
    return False
