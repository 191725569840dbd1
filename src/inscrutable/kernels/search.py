"""The best of many decisions under one belief, without visiting most of them.

Decisions are kept in leaves of neighbouring decoys y around a centre c, with an affine model of their state costs,
s ≥ s_c + J(y − c) − e entry by entry. A privacy is at most ‖y − p‖ (sign +) or −‖y − p‖ + reach (sign −), so with d the unit
vector from p to c, every decision of a leaf of radius R has

    Ψ − μ π·s  ≤  ±‖c − p‖ − μ π·s_c + ‖± d − μ J'π‖ R + R²/(2‖c − p‖) [sign +] + μ π·e + reach [sign −].

Leaves whose bound cannot win are skipped. Decisions that more than a segment of beliefs explain are judged by the distance
to one member; where such a one could win, the caller judges the set itself.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from inscrutable.kernels.options import kernel

POINT, SEGMENT, LARGER = 0, 1, 2


class Table(NamedTuple):
    """Distinct admissible decisions that a belief explains, leaf by leaf."""

    costs: Any  # (D,X) state costs
    decoys: Any  # (D,X) a belief that each is optimal for
    start: Any  # (D,X) of a segment
    along: Any  # (D,X) end − start
    square: Any  # (D,) squared length
    kind: Any  # (D,) POINT, SEGMENT, LARGER
    face: Any  # (D,) number of the face


class Leaves(NamedTuple):
    """Groups of neighbouring decisions and what bounds them."""

    first: Any  # (L+1,) where each leaf begins
    centre: Any  # (L,X)
    radius: Any  # (L,)
    reach: Any  # (L,) largest distance of a member of a set from its decoy
    costs: Any  # (L,X) at the centre
    slope: Any  # (L,X,X) J', by coordinate of y
    excess: Any  # (L,X)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _quick_distance(decoys: Any, start: Any, along: Any, square: Any, kind: Any, d: int, point: Any) -> float:
    """Distance from a point to the set of a decision, or to its decoy where the set is larger than a segment."""
    total = 0.0
    if kind[d] == SEGMENT:
        share = 0.0
        for i in range(point.size):
            share += (point[i] - start[d, i]) * along[d, i]
        share = min(max(share / square[d], 0.0), 1.0)
        for i in range(point.size):
            total += (point[i] - start[d, i] - share * along[d, i]) ** 2
    else:
        for i in range(point.size):
            total += (point[i] - decoys[d, i]) ** 2
    return float(np.sqrt(total))


@kernel
def best_by_face(
    table: Any, belief: Any, point: Any, sign: float, most: float, basis: Any, best: Any, which: Any
) -> int:
    """Fill the best quick privacy (K,Q) and its decision (−1: none) by face and by orthant of the decoy around the
    point, among decisions whose expected cost is at most `most`; returns how many are affordable."""
    costs, decoys, start, along = table.costs, table.decoys, table.start, table.along
    square, kind, face = table.square, table.kind, table.face
    n_states, n = basis.shape
    axes = 0
    while 2 ** (axes + 1) <= best.shape[1] and axes < n:
        axes += 1
    best[:] = -np.inf
    which[:] = -1
    affordable = 0
    for d in range(costs.shape[0]):
        cost = 0.0
        for i in range(n_states):
            cost += belief[i] * costs[d, i]
        if cost > most:
            continue
        affordable += 1
        privacy = sign * _quick_distance(decoys, start, along, square, kind, d, point)
        orthant = 0
        for c in range(axes):
            total = 0.0
            for i in range(n_states):
                total += basis[i, c] * (decoys[d, i] - point[i])
            orthant = 2 * orthant + (1 if total > 0.0 else 0)
        if privacy > best[face[d], orthant]:
            best[face[d], orthant] = privacy
            which[face[d], orthant] = d
    return affordable
