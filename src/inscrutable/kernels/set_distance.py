"""The consistent beliefs of one decision on a face, and the member nearest to a point.

At w = (v, 1) the beliefs that explain the decision are {π ∈ Δ : G'π = 0, Σ π_i R_ri·w ≥ 0}, with the gradients
G_i = C_i[:k,:] w in the face's coordinates and the rows R of the probabilities and multipliers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.calls import deferred
from inscrutable.kernels.copies import put
from inscrutable.kernels.options import integer, kernel, uncounted, uncounted_kernel
from inscrutable.kernels.projection import project_in, room_for
from inscrutable.kernels.references import by_reference, release
from inscrutable.kernels.rounding import FLAT
from inscrutable.tolerances import EXPLAINED, ON_FACE, RANK, SAME_BELIEF

NO_ROW = integer(-1)


class Face(NamedTuple):
    """Costs and rows of decisions with k free coordinates, of X states."""

    curves: Any  # (X, k+1, k+1)
    rows: Any  # (m, X, k+1)
    n_set_rows: int  # how many of the rows describe the consistent set: probabilities, then multipliers
    scale: float  # size of the gradients


class DistanceRoom(NamedTuple):
    """Memory for distances on faces of at most K coordinates and M rows; `active` is a result."""

    active: Any  # (K+M,) which of the k equations and of the set's rows hold the nearest belief
    units: Any  # (n+M+1, n)
    sides: Any  # (n+M+1,)
    multipliers: Any  # (n+M+1,)
    number: Any  # (n+M+1,) of the set's row behind each unit row
    equations: Any  # (K,n)
    right: Any  # (K,)
    coefficients: Any  # (X,)
    place: Any  # (n,)
    projection: Any


@kernel
def distance_room(n_states: int, n_free: int, n_rows: int) -> DistanceRoom:
    """Return memory for faces of at most `n_free` free coordinates and `n_rows` rows."""
    n, most = n_states - 1, n_states + n_rows
    return DistanceRoom(
        np.zeros(n_free + n_rows, dtype=np.bool_), np.empty((most, n)), np.empty(most), np.empty(most),
        np.empty(most, dtype=np.int64), np.empty((n_free, n)), np.empty(n_free), np.empty(n_states), np.empty(n),
        room_for(n, most),
    )  # fmt: skip


@uncounted
def _equalities(face: Any, w: Any, basis: Any, room: Any) -> int:
    """Orthonormal rows of G'π = 0 in the reduced coordinates; −1 where they contradict each other."""
    n_states, n = basis.shape
    k = w.size - 1
    used, work, right = room.active, room.equations, room.right
    for a in range(k):
        mean = 0.0
        for i in range(n_states):
            total = 0.0
            for c in range(k + 1):
                total += face.curves[i, a, c] * w[c]
            room.coefficients[i] = total
            mean += total / n_states
        right[a] = -mean
        for c in range(n):
            total = 0.0
            for i in range(n_states):
                total += basis[i, c] * room.coefficients[i]
            work[a, c] = total
    for a in range(k):
        used[a] = False
    n_equal = 0
    while n_equal < n:
        largest, which = RANK * face.scale, -1
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
            room.units[n_equal, c] = work[which, c] / largest
        room.sides[n_equal] = right[which] / largest
        for a in range(k):
            if not used[a]:
                total = 0.0
                for c in range(n):
                    total += work[a, c] * room.units[n_equal, c]
                for c in range(n):
                    work[a, c] -= total * room.units[n_equal, c]
                right[a] -= total * room.sides[n_equal]
        n_equal += 1
    for a in range(k):
        if not used[a] and abs(right[a]) > EXPLAINED * face.scale:
            return -1
    return n_equal


@uncounted
def _inequalities(face: Any, w: Any, basis: Any, n_equal: int, reversed_row: int, room: Any) -> int:
    """Unit rows of Σ π_i R_ri·w ≥ 0 from `n_equal` on, and which r each is; returns where they end, −1 where one is broken.

    The row `reversed_row` comes once more, with its sign reversed: it is zero then.
    """
    n_states, n = basis.shape
    last = n_equal
    for j in range(face.n_set_rows + (reversed_row >= 0)):
        r, sign = j, 1.0
        if j == face.n_set_rows:
            r, sign = reversed_row, -1.0
        mean, least = 0.0, np.inf
        for i in range(n_states):
            total = 0.0
            for c in range(w.size):
                total += face.rows[r, i, c] * w[c]
            room.coefficients[i] = sign * total
            mean += sign * total / n_states
            least = min(least, sign * total)
        if least > 0.0:  # no belief breaks it
            continue
        length = 0.0
        for c in range(n):
            total = 0.0
            for i in range(n_states):
                total += basis[i, c] * room.coefficients[i]
            room.units[last, c] = total
            length += total * total
        length = np.sqrt(length)
        if length <= FLAT:
            if mean < -EXPLAINED:
                return -1
            continue
        for c in range(n):
            room.units[last, c] /= length
        room.sides[last] = -mean / length
        room.number[last] = r
        last += 1
    return last


@uncounted_kernel
def nearest_belief(face: Any, w: Any, point: Any, basis: Any, reversed_row: int, out: Any, room: Any) -> float:
    """Fill `out` with the consistent belief nearest to `point` (X,) and return its distance; infinite where there is none.

    `reversed_row` is a row of the set that shall be zero, or NO_ROW. `room.active` says which equations and rows hold the
    belief there.
    """
    n_states, n = basis.shape
    k, active, z = w.size - 1, room.active, room.place
    n_equal = _equalities(face, w, basis, room)
    if n_equal < 0:
        return np.inf
    last = _inequalities(face, w, basis, n_equal, reversed_row, room)
    if last < 0:
        return np.inf
    for c in range(n):
        total = 0.0
        for i in range(n_states):
            total += basis[i, c] * (point[i] - 1.0 / n_states)
        z[c] = total
    if not project_in(room.units, room.sides, last, n_equal, ON_FACE, z, room.multipliers, room.projection):
        return np.inf
    for r in range(face.n_set_rows):
        active[k + r] = False
    for r in range(n_equal, last):
        if room.multipliers[r] > 0.0:
            active[k + room.number[r]] = True
    square = 0.0
    for i in range(n_states):
        total = 1.0 / n_states
        for c in range(n):
            total += basis[i, c] * z[c]
        out[i] = total
        square += (total - point[i]) * (total - point[i])
    return float(np.sqrt(square))


@deferred(kernel)
def is_explained_once(face: Any, w: Any, basis: Any, n_rows: int) -> bool:
    """Whether one belief alone explains the decision: the consistent beliefs nearest to all corners are the same.

    `n_rows` is the number of rows of the consistent set.
    """
    n_states = basis.shape[0]
    made = distance_room(n_states, w.size - 1, n_rows)
    room = by_reference(made)
    first, found, corner = np.empty(n_states), np.empty(n_states), np.zeros(n_states)
    for i in range(n_states):
        corner[:] = 0.0
        corner[i] = 1.0
        if nearest_belief(face, w, corner, basis, NO_ROW, found, room) == np.inf:
            return False
        if i == 0:
            put(found, first)
        for j in range(n_states):
            if abs(found[j] - first[j]) > SAME_BELIEF:
                return False
    release(made)
    return True
