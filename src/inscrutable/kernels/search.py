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

from inscrutable.kernels.options import kernel, part

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
    places: Any  # (D,A) first reduced coordinates of the decoys


class Leaves(NamedTuple):
    """Groups of neighbouring decisions and what bounds them."""

    first: Any  # (L+1,) where each leaf begins
    centre: Any  # (L,X)
    radius: Any  # (L,)
    reach: Any  # (L,) largest distance of a member of a set from its decoy
    costs: Any  # (L,X) at the centre
    slope: Any  # (L,X,X) J', by coordinate of y
    excess: Any  # (L,X)


@part
def _segment_square(start: Any, along: Any, square: Any, d: int, point: Any) -> float:
    """Squared distance from a point to the segment of a decision."""
    share, total = 0.0, 0.0
    for i in range(point.size):
        share += (point[i] - start[d, i]) * along[d, i]
    share = min(max(share / square[d], 0.0), 1.0)
    for i in range(point.size):
        total += (point[i] - start[d, i] - share * along[d, i]) ** 2
    return total


@kernel
def best_by_face(
    table: Any, belief: Any, point: Any, sign: float, most: float, basis: Any, best: Any, which: Any
) -> int:
    """Fill the best quick privacy (K,Q) and its decision (−1: none) by face and by orthant of the decoy around the
    point, among decisions whose expected cost is at most `most`; returns how many are affordable.

    The square of a distance decides; its root is taken at the end.
    """
    costs, decoys, start, along = table.costs, table.decoys, table.start, table.along
    square, kind, face, places = table.square, table.kind, table.face, table.places
    n_states, axes = basis.shape[0], min(places.shape[1], int(np.log2(best.shape[1])))
    origin = np.zeros(axes)
    for c in range(axes):
        for i in range(n_states):
            origin[c] += basis[i, c] * point[i]
    best[:] = -np.inf
    which[:] = -1
    affordable = 0
    three = n_states == 3
    for d in range(costs.shape[0]):
        if three:
            cost = belief[0] * costs[d, 0] + belief[1] * costs[d, 1] + belief[2] * costs[d, 2]
        else:
            cost = 0.0
            for i in range(n_states):
                cost += belief[i] * costs[d, i]
        if cost > most:
            continue
        affordable += 1
        if kind[d] == SEGMENT:
            total = _segment_square(start, along, square, d, point)
        elif three:
            total = (point[0] - decoys[d, 0]) ** 2 + (point[1] - decoys[d, 1]) ** 2 + (point[2] - decoys[d, 2]) ** 2
        else:
            total = 0.0
            for i in range(n_states):
                total += (point[i] - decoys[d, i]) ** 2
        orthant = 0
        for c in range(axes):
            orthant = 2 * orthant + (1 if places[d, c] > origin[c] else 0)
        number = face[d]
        if sign * total > best[number, orthant]:
            best[number, orthant] = sign * total
            which[number, orthant] = d
    for number in range(best.shape[0]):
        for orthant in range(best.shape[1]):
            if which[number, orthant] >= 0:
                best[number, orthant] = sign * np.sqrt(abs(best[number, orthant]))
    return affordable
