"""Consistent beliefs of many decisions, one small system at a time: {π ∈ Δ : P π = 0, Q π ≥ 0}.

With B an orthonormal basis of the directions that keep Σπ, the columns of P B are rotated until they are orthogonal (one-sided
Jacobi, a singular value decomposition):

    P B V = W,   σ_j = ‖W_j‖,   π = 1/X + B V t,   t_j = −W_j·(P 1/X) / σ_j² where σ_j determines a coordinate.

Directions with a singular value below the rank tolerance stay free, within the band in which the residual stays below the
tolerance: none is a point, one a segment to cut with the inequalities. Larger sets are left to `kernels.belief_members`.

No two beliefs are farther apart than `SIMPLEX_DIAMETER`: a direction with σ times that below the tolerance has no band.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.copies import put, put_rows
from inscrutable.kernels.deferred import deferred
from inscrutable.kernels.options import inlined, internal, kernel
from inscrutable.tolerances import ON_FACE, RANK, SAME_BELIEF, SIMPLEX_DIAMETER

LARGER = 2
"""Dimension reported for whatever is not empty, a point or a segment."""
_SWEEPS = 40
_ROUNDING = float(np.finfo(np.float64).eps)


class Room(NamedTuple):
    """The hull of one system and the space to find it in; free directions come first."""

    columns: Any  # (k, X-1): P B, then W
    turn: Any  # V
    lengths: Any  # (X-1,): σ, rising
    aligned: Any  # (X-1,): −W_j·(P 1/X) / σ_j
    target: Any  # (k,): −P 1/X
    origin: Any  # (X,)
    directions: Any  # (X-1, X)


@internal
def room_for(n_rows: int, n_states: int) -> Any:
    """Return space for systems of at most `n_rows` equalities."""
    free = n_states - 1
    return Room(
        np.empty((n_rows, free)),
        np.empty((free, free)),
        np.empty(free),
        np.empty(free),
        np.empty(n_rows),
        np.empty(n_states),
        np.empty((free, n_states)),
    )


@inlined
def _rotate(matrix: Any, n_rows: int, p: int, q: int, cosine: float, sine: float) -> None:
    for r in range(n_rows):
        first, second = matrix[r, p], matrix[r, q]
        matrix[r, p] = cosine * first - sine * second
        matrix[r, q] = sine * first + cosine * second


@inlined
def _orthogonalise(room: Any, n_rows: int, rounding: float) -> None:
    """Rotate the columns until they are orthogonal, then sort them by rising length."""
    columns, turn, lengths = room.columns, room.turn, room.lengths
    free = lengths.size
    for a in range(free):
        for b in range(free):
            turn[a, b] = 1.0 if a == b else 0.0
    turning = True
    for _ in range(_SWEEPS):
        if not turning:
            break
        turning = False
        for p in range(free - 1):
            for q in range(p + 1, free):
                first, second, inner = 0.0, 0.0, 0.0
                for r in range(n_rows):
                    first += columns[r, p] * columns[r, p]
                    second += columns[r, q] * columns[r, q]
                    inner += columns[r, p] * columns[r, q]
                largest = max(first, second)
                if abs(inner) > rounding * np.sqrt(first * second) and abs(inner) > rounding * rounding * largest:
                    turning = True
                    ratio = (second - first) / (2.0 * inner)
                    tangent = (1.0 if ratio >= 0.0 else -1.0) / (abs(ratio) + np.sqrt(1.0 + ratio * ratio))
                    cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
                    _rotate(columns, n_rows, p, q, cosine, cosine * tangent)
                    _rotate(turn, free, p, q, cosine, cosine * tangent)
    for a in range(free):
        total = 0.0
        for r in range(n_rows):
            total += columns[r, a] * columns[r, a]
        lengths[a] = np.sqrt(total)
    for a in range(1, free):
        b = a
        while b > 0 and lengths[b] < lengths[b - 1]:
            lengths[b], lengths[b - 1] = lengths[b - 1], lengths[b]
            # A quarter turn exchanges two columns, up to a sign.
            _rotate(columns, n_rows, b - 1, b, 0.0, 1.0)
            _rotate(turn, free, b - 1, b, 0.0, 1.0)
            b -= 1


@inlined
def _project(equalities: Any, n_rows: int, basis: Any, room: Any) -> None:
    """columns = P B, target = −P 1/X."""
    n_states, free = basis.shape
    for r in range(n_rows):
        total = 0.0
        for x in range(n_states):
            total += equalities[r, x]
        room.target[r] = -total / n_states
        for a in range(free):
            total = 0.0
            for x in range(n_states):
                total += equalities[r, x] * basis[x, a]
            room.columns[r, a] = total


@inlined
def _residual(equalities: Any, n_rows: int, room: Any, rank: float) -> float:
    """The least residual ‖P π‖∞: a step along a free direction lowers it by at most σ times the simplex's size."""
    worst = 0.0
    for r in range(n_rows):
        total = 0.0
        for x in range(room.origin.size):
            total += equalities[r, x] * room.origin[x]
        for a in range(room.lengths.size):
            length = room.lengths[a]
            if 0.0 < length <= rank:
                removable = min(max(room.aligned[a], -SIMPLEX_DIAMETER * length), SIMPLEX_DIAMETER * length)
                total += room.columns[r, a] / length * removable
        worst = max(worst, abs(total))
    return worst


@internal
def hull_of(equalities: Any, n_rows: int, basis: Any, tolerance: float, room: Any) -> tuple[int, float, float]:
    """Write the affine hull of P π = 0, 1'π = 1 into `room`; return its dimension (−1 empty), residual and noise."""
    n_states, free = basis.shape
    _project(equalities, n_rows, basis, room)
    _orthogonalise(room, n_rows, _ROUNDING)
    for x in range(n_states):
        room.origin[x] = 1.0 / n_states
    n_free, smallest = 0, 1.0
    for a in range(free - 1, -1, -1):
        length = room.lengths[a]
        total = 0.0
        for r in range(n_rows):
            total += room.columns[r, a] * room.target[r]
        room.aligned[a] = total / length if length > 0.0 else 0.0
        for x in range(n_states):
            total = 0.0
            for b in range(free):
                total += basis[x, b] * room.turn[b, a]
            room.directions[a, x] = total
        if length > RANK:
            smallest = length  # they fall
            for x in range(n_states):
                room.origin[x] += room.aligned[a] / length * room.directions[a, x]
        else:
            n_free += 1
    residual = _residual(equalities, n_rows, room, RANK)
    noise = max(ON_FACE, tolerance / smallest) if n_rows * free > 0 else ON_FACE
    return (n_free if residual <= tolerance else -1), residual, noise


@inlined
def band(room: Any, axis: int, explained: float) -> tuple[float, float]:
    """Lowest and highest coordinate along a free direction at which the residual stays below the tolerance."""
    length = room.lengths[axis]
    if SIMPLEX_DIAMETER * length <= explained:
        return -np.inf, np.inf
    return (room.aligned[axis] - explained) / length, (room.aligned[axis] + explained) / length


@inlined
def along(rows: Any, n_rows: int, r: int, vector: Any) -> float:
    """Row r of Q, or of π ≥ 0 after the last one, times a vector."""
    if r >= n_rows:
        return float(vector[r - n_rows])
    total = 0.0
    for x in range(vector.size):
        total += rows[r, x] * vector[x]
    return total


@inlined
def _onto_simplex(room: Any, step: float, out: Any) -> None:
    """out = the point at `step` along the first direction, with rounding outside the simplex removed."""
    total = 0.0
    for x in range(out.size):
        value = room.origin[x]
        if step != 0.0:
            value += step * room.directions[0, x]
        out[x] = max(value, 0.0)
        total += out[x]
    if total > 0.0:
        for x in range(out.size):
            out[x] /= total


@inlined
def _cut_segment(rows: Any, n_rows: int, noise: float, tolerance: float, room: Any) -> tuple[bool, float, float]:
    """Whether some of a line satisfies the inequalities, and its first and last step."""
    low, high = band(room, 0, tolerance)
    steepest = np.inf
    for r in range(n_rows + room.origin.size):
        value = along(rows, n_rows, r, room.origin)
        slope = along(rows, n_rows, r, room.directions[0])
        if abs(slope) <= noise:
            if value < -noise:
                return False, 0.0, 0.0
        else:
            steepest = min(steepest, abs(slope))
            if slope > 0.0:
                low = max(low, -value / slope)
            else:
                high = min(high, -value / slope)
    if not (np.isfinite(low) and np.isfinite(high)):
        return False, 0.0, 0.0
    if low > high:
        if low - high > 2.0 * noise / min(steepest, 1.0):
            return False, 0.0, 0.0
        low = high = 0.5 * (low + high)
    return True, low, high


@internal
def cut_hull(rows: Any, n_rows: int, dimension: int, noise: float, tolerance: float, room: Any, ends: Any) -> int:
    """Cut a hull of dimension 0 or 1 with Q π ≥ 0 and π ≥ 0; write both ends, return the dimension that is left."""
    if dimension == 0:
        for r in range(n_rows + room.origin.size):
            if along(rows, n_rows, r, room.origin) < -noise:
                return -1
        _onto_simplex(room, 0.0, ends[0])
        _onto_simplex(room, 0.0, ends[1])
        return 0
    present, low, high = _cut_segment(rows, n_rows, noise, tolerance, room)
    if not present:
        return -1
    _onto_simplex(room, low, ends[0])
    _onto_simplex(room, high, ends[1])
    total = 0.0
    for x in range(room.origin.size):
        apart = ends[1, x] - ends[0, x]
        total += apart * apart
    return 1 if np.sqrt(total) > SAME_BELIEF else 0


@kernel
def affine_hull(equalities: Any, basis: Any, tolerance: float, origin: Any, directions: Any, bands: Any) -> int:
    """Fill the affine hull of P π = 0, 1'π = 1: its point nearest to the middle of the simplex (X,), orthonormal directions
    (X-1,X), the free ones first, and the band along each of these (X-1,2). Returns its dimension, −1 where it is empty."""
    n_rows, n_states = equalities.shape
    room = room_for(n_rows, n_states)
    dimension, _, _ = hull_of(equalities, n_rows, basis, tolerance, room)
    put(room.origin, origin)
    put_rows(room.directions, directions)
    for axis in range(dimension):
        bands[axis, 0], bands[axis, 1] = band(room, axis, tolerance)
    return int(dimension)


@deferred(kernel)
def describe_sets(
    low: int, high: int, equalities: Any, inequalities: Any, basis: Any, tolerance: float, dimension: Any, ends: Any
) -> None:
    """Dimension and both ends (n, 2, X) of the sets low..high of stacked systems P (n,k,X), Q (n,m,X).

    Sets of dimension two and more have the dimension of their hull; their ends are not written.
    """
    _, k, n_states = equalities.shape
    room = room_for(k, n_states)
    for i in range(low, high):
        size, _, noise = hull_of(equalities[i], k, basis, tolerance, room)
        if 0 <= size < LARGER:
            size = cut_hull(inequalities[i], inequalities.shape[1], size, noise, tolerance, room, ends[i])
        dimension[i] = size
