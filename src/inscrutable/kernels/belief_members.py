"""Whether sets of beliefs {π ∈ Δ : P π = 0, Q π ≥ 0} of dimension two and more are empty, without their vertices.

On the hull π = o + D't that `belief_sets` finds, with rows N t ≥ b scaled to unit length, o is projected on N t ≥ b + depth.
If the projection exists, the ball of radius `depth` about it lies in the set. If not, the contradicting rows have weights
y ≥ 0 with y'N = 0; where y'b > 0 the set is empty (Farkas). Otherwise the answer is `UNKNOWN`.

600 sets of linear costs over four states take 5 ms; their linear programmes take 1.4 s.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.belief_sets import LARGER, along, band, hull_of, room_for
from inscrutable.kernels.options import inlined, internal, kernel
from inscrutable.kernels.projection import NO_EQUALITIES, project_in
from inscrutable.kernels.projection import room_for as projection_room
from inscrutable.kernels.references import by_reference, release
from inscrutable.tolerances import (
    LEAST_MEMBER_DEPTH,
    MEMBER_DEPTH,
    ON_FACE,
    SIMPLEX_DIAMETER,
    STATIONARITY,
    SURE_CONFLICT,
)

EMPTY, UNKNOWN, HELD = -1, 0, 1


@internal
def _scaled_rows(rows: Any, n_given: int, size: int, room: Any, normals: Any, sides: Any) -> int:
    """Write the rows Q π ≥ 0 and π ≥ 0 in the coordinates of the hull; return how many, −1 where a constant one fails."""
    n_states = rows.shape[1]
    count = 0
    for r in range(n_given + n_states):
        total = 0.0
        for a in range(size):
            normals[count, a] = along(rows, n_given, r, room.directions[a])
            total += normals[count, a] * normals[count, a]
        length = np.sqrt(total)
        value = along(rows, n_given, r, room.origin)
        if length <= ON_FACE:
            if value < -ON_FACE:
                return -1
            continue
        for a in range(size):
            normals[count, a] /= length
        sides[count] = -value / length
        count += 1
    return count


@inlined
def _least_slack(normals: Any, sides: Any, count: int, size: int, place: Any) -> float:
    least = np.inf
    for r in range(count):
        total = -sides[r]
        for a in range(size):
            total += normals[r, a] * place[a]
        least = min(least, total)
    return least


@internal
def _contradict(normals: Any, sides: Any, count: int, size: int, weights: Any) -> bool:
    """Whether the weights y prove that no belief satisfies all rows N t ≥ b, even if each is relaxed by `SURE_CONFLICT`:
    y'b − max |y'N t| > SURE_CONFLICT Σy over the coordinates t of beliefs, which `SIMPLEX_DIAMETER` bounds."""
    total, conflict = 0.0, 0.0
    for r in range(count):
        if weights[r] > 0.0:
            total += weights[r]
            conflict += weights[r] * sides[r]
    if total == 0.0:
        return False
    left = 0.0
    for a in range(size):
        inner = 0.0
        for r in range(count):
            if weights[r] > 0.0:
                inner += weights[r] * normals[r, a]
        left += inner * inner
    return bool(conflict - SIMPLEX_DIAMETER * np.sqrt(left) > SURE_CONFLICT * total)


@inlined
def _write_member(room: Any, place: Any, out: Any) -> None:
    for s in range(out.size):
        total = room.origin[s]
        for a in range(place.size):
            total += place[a] * room.directions[a, s]
        out[s] = total


@kernel
def find_members(equalities: Any, inequalities: Any, basis: Any, tolerance: float, verdict: Any, members: Any) -> None:
    """Say of stacked sets P (n,k,X), Q (n,m,X) with a hull of dimension two or more whether they are `HELD`, with a member
    (n,X), or `EMPTY`; `UNKNOWN` where that takes linear programmes, and for all others."""
    n, k, n_states = equalities.shape
    m = inequalities.shape[1]
    room = room_for(k, n_states)
    sides, deeper, weights = np.empty(m + n_states), np.empty(m + n_states), np.empty(m + n_states)
    for i in range(n):
        verdict[i] = UNKNOWN
        size, _, _ = hull_of(equalities[i], k, basis, tolerance, room)
        if size < LARGER:
            continue
        banded = False
        for a in range(size):
            banded = banded or np.isfinite(band(room, a, tolerance)[0])
        if banded:
            continue
        normals, place = np.empty((m + n_states, size)), np.empty(size)
        count = _scaled_rows(inequalities[i], m, size, room, normals, sides)
        if count < 0:
            verdict[i] = EMPTY
            continue
        made = projection_room(size, count)
        memory = by_reference(made)
        for depth in (MEMBER_DEPTH, LEAST_MEMBER_DEPTH):
            for r in range(count):
                deeper[r] = sides[r] + depth
            place[:] = 0.0
            if project_in(normals, deeper, count, NO_EQUALITIES, STATIONARITY, place, weights, memory):
                if _least_slack(normals, sides, count, size, place) > 0.5 * depth:
                    verdict[i] = HELD
                    _write_member(room, place, members[i])
                break
            if _contradict(normals, sides, count, size, weights):
                verdict[i] = EMPTY
                break
        release(made)
