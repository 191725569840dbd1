"""The point nearest to a given one under linear rows: a dual active-set method for a handful of coordinates.

min ½‖x − p‖² over N x ≥ b, the first `n_equal` rows as equalities. Rows enter one by one, the most violated first; with Q
an orthonormal basis of the active normals the step is z = (I − QQ')n for a new normal n, and the multipliers η move by −R⁻¹Q'n.
(Goldfarb and Idnani 1983, with the identity as Hessian.)
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.options import integer, kernel, uncounted, uncounted_kernel
from inscrutable.kernels.rounding import DEPENDENT, FLAT

NO_EQUALITIES = integer(0)
_NONE = integer(0)


class ProjectionRoom(NamedTuple):
    """Memory of a projection, for searches that make many."""

    active: Any  # (n+1,)
    entered: Any  # (m,)
    eta: Any  # (n+1,)
    basis: Any  # (n+1,n)
    upper: Any  # (n+1,n+1)
    across: Any  # (n,)
    along: Any  # (n+1,)
    normal: Any  # (n,)


@kernel
def room_for(size: int, n_rows: int) -> ProjectionRoom:
    """Return memory for projections in `size` coordinates on at most `n_rows` rows."""
    return ProjectionRoom(
        np.empty(size + 1, dtype=np.int64), np.empty(n_rows, dtype=np.bool_), np.empty(size + 1),
        np.empty((size + 1, size)), np.empty((size + 1, size + 1)), np.empty(size), np.empty(size + 1), np.empty(size),
    )  # fmt: skip


@uncounted
def at_unit_length(row: Any, value: float) -> tuple[float, float]:
    """Scale a row n·x + value ≥ 0 to unit length; returns b of n·x ≥ b, and the former length. A flat row is void."""
    length = 0.0
    for i in range(row.size):
        length += row[i] * row[i]
    length = np.sqrt(length)
    if length <= FLAT:
        length, value = 1.0, max(value, 0.0)
    for i in range(row.size):
        row[i] /= length
    return -value / length, length


@uncounted
def _orthonormal(rows: Any, active: Any, first: int, n_active: int, basis: Any, upper: Any) -> None:
    """basis (q,n) and upper triangle R with rows[active]' = basis' R, from column `first` on, by modified Gram-Schmidt."""
    size = rows.shape[1]
    for c in range(first, n_active):
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


@uncounted
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


@uncounted
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


@uncounted
def _without(leaving: int, active: Any, eta: Any, n_active: int) -> int:
    """Take an active row out; returns how many are left."""
    for c in range(leaving, n_active - 1):
        active[c] = active[c + 1]
        eta[c] = eta[c + 1]
    return n_active - 1


@uncounted_kernel
def project_in(
    rows: Any, sides: Any, n_rows: int, n_equal: int, near: float, x: Any, multipliers: Any, room: Any
) -> bool:
    """Move x (n,) to the nearest point of the rows, each of unit length; False where no point satisfies them.

    `near` is the violation that counts as none. multipliers (m,) are filled; those of equalities have either sign. Where
    rows contradict each other they are the proof y: y'N = 0 and y'b ≠ 0; where the search gave up they are zero.
    """
    size = x.size
    active, entered, eta, normal = room.active, room.entered, room.eta, room.normal
    basis, upper, across, along = room.basis, room.upper, room.across, room.along
    for r in range(n_rows):
        multipliers[r] = 0.0
        entered[r] = False
    n_active, n_split = _NONE, _NONE
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
        for i in range(size):
            normal[i] = sign * rows[new, i]
        entering = 0.0
        entered[new] = True
        while True:
            _orthonormal(rows, active, n_split, n_active, basis, upper)
            n_split = n_active
            for i in range(size):
                along[i] = 0.0
            left = _split(normal, n_active, basis, upper, across, along)
            longest, leaving = np.inf, -1
            for c in range(n_active):
                if active[c] >= n_equal and along[c] > 0.0 and eta[c] / along[c] < longest:
                    longest, leaving = eta[c] / along[c], c
            if n_active >= size or left <= DEPENDENT:
                if violation >= -near:  # nothing left to remove: the row repeats active ones
                    break
                if leaving < 0:
                    multipliers[new] = sign
                    for c in range(n_active):
                        multipliers[active[c]] = -along[c]
                    return False
                step = longest
            else:
                step = min(longest, -violation / left)
                for i in range(size):
                    x[i] += step * across[i]
                violation += step * left
            for c in range(n_active):
                eta[c] -= step * along[c]
            entering += step
            if step < longest or leaving < 0:
                active[n_active] = new
                eta[n_active] = sign * entering
                n_active += 1
                break
            entered[active[leaving]] = False
            n_active, n_split = _without(leaving, active, eta, n_active), leaving
    return False
