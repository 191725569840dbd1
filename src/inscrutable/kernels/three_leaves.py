"""The best of many decisions for three states without visiting most of them.

Decisions lie in slots, SLOTS to a leaf, as near each other in the plane as can be. The bound of `search` excludes most
leaves, and only what is left is read.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.options import bare, woven
from inscrutable.kernels.three_states import Ground, Here
from inscrutable.tolerances import LENGTH, TINY

NONE = -1
TARGET = -3
POLISHED, ABSENT = -1, -9
FIRST_POLYGON = -16  # polygons are named from here downwards while searched
SLOTS = 32


class Plane(NamedTuple):
    """Decisions in slots and their leaves, in the plane of beliefs; both run along the last axis.

    Models of leaves are filled up to the processor's lanes. What one loop reads is one array: the compiled loops check
    that arrays do not overlap, and many would take long.
    """

    slots: Any  # (L,8,SLOTS) 0–2 costs, 3–4 start of a segment or the one belief, 5–6 along a segment or 0, 7 1/length² or 0
    decoys: Any  # (2,S)
    face: Any  # (S,)
    name: Any  # (S,) number of the decision
    leaves: Any  # (12,L') of points: 0–1 centre, 2 radius, 3–5 least costs s_c − e, 6–8 and 9–11 their slopes
    bands: Any  # (9,L'') of segments: 0–1 the middle one's start, 2–3 along it, 4 1/length², 5 how far off, 6–8 least costs
    n_leaves: int  # how many leaves are of points; the rest is of segments
    spacing: Any  # (1,) typical distance between neighbouring decisions
    polygons: Any  # (N,) numbers of the decisions with a polygon of beliefs; they are in no leaf
    polygon_costs: Any  # (3,N)
    polygon_faces: Any  # (N,)
    polygon_decoys: Any  # (2,N)
    ground: Ground


class Scene(NamedTuple):
    """What the lotteries of T beliefs start from; one affordable decision, `first`, is known beforehand."""

    beliefs: Any  # (T,3)
    points: Any  # (T,2) far from which (sign +) or near which (−) beliefs shall be inferred
    sign: float
    optimal_costs: Any  # (T,)
    limits: Any  # (T,B)
    first: int  # its name
    first_regrets: Any  # (T,)
    first_privacies: Any  # (T,)
    target_regrets: Any  # (T,) of the decision with the target among its beliefs; infinite where there is none


@woven
def here_of(scene: Scene, t: int) -> Here:
    """One belief of a scene."""
    b0, b1, b2 = scene.beliefs[t, 0], scene.beliefs[t, 1], scene.beliefs[t, 2]
    return Here(b0, b1, b2, scene.points[t, 0], scene.points[t, 1], scene.sign, scene.optimal_costs[t])


@woven
def bound_leaves(leaves: Any, bands: Any, n_leaves: int, here: Here, price: float, out: Any) -> None:
    """Upper bounds of Ψ − price·π·s, leaf by leaf; `n_leaves` of points, then those of segments."""
    p0, p1 = here.p0, here.p1
    b0, b1, b2 = here.b0, here.b1, here.b2
    sign = here.sign
    away = 0.5 if sign > 0.0 else 0.0
    for n in range(leaves.shape[1]):
        x0, x1, r = leaves[0, n] - p0, leaves[1, n] - p1, leaves[2, n]
        distance = np.sqrt(x0 * x0 + x1 * x1)
        inverse = sign / max(distance, LENGTH)
        cost = b0 * leaves[3, n] + b1 * leaves[4, n] + b2 * leaves[5, n]
        e0 = x0 * inverse - price * (b0 * leaves[6, n] + b1 * leaves[7, n] + b2 * leaves[8, n])
        e1 = x1 * inverse - price * (b0 * leaves[9, n] + b1 * leaves[10, n] + b2 * leaves[11, n])
        # What the distance may exceed its linear model by.
        out[n] = sign * distance - price * cost + np.sqrt(e0 * e0 + e1 * e1) * r + away * r * r * inverse
    for n in range(bands.shape[1]):
        x0, x1 = p0 - bands[0, n], p1 - bands[1, n]
        share = min(max((x0 * bands[2, n] + x1 * bands[3, n]) * bands[4, n], 0.0), 1.0)
        x0 -= share * bands[2, n]
        x1 -= share * bands[3, n]
        cost = b0 * bands[6, n] + b1 * bands[7, n] + b2 * bands[8, n]
        out[n_leaves + n] = sign * np.sqrt(x0 * x0 + x1 * x1) + bands[5, n] - price * cost


@woven
def bar_dear_leaves(leaves: Any, bands: Any, n_leaves: int, here: Here, most: float, out: Any) -> None:
    """A bound that nothing reaches where all decisions of a leaf cost more than `most` (π·s)."""
    b0, b1, b2 = here.b0, here.b1, here.b2
    for n in range(n_leaves):
        cost = b0 * leaves[3, n] + b1 * leaves[4, n] + b2 * leaves[5, n]
        j0 = b0 * leaves[6, n] + b1 * leaves[7, n] + b2 * leaves[8, n]
        j1 = b0 * leaves[9, n] + b1 * leaves[10, n] + b2 * leaves[11, n]
        # Without a branch, so that leaves are taken by the lane.
        out[n] -= max(cost - np.sqrt(j0 * j0 + j1 * j1) * leaves[2, n] - most, 0.0) / TINY
    for n in range(bands.shape[1]):
        cost = b0 * bands[6, n] + b1 * bands[7, n] + b2 * bands[8, n]
        out[n_leaves + n] -= max(cost - most, 0.0) / TINY


@woven
def read_leaf(
    slots: Any,
    belief: tuple[float, float, float],
    p0: float,
    p1: float,
    sign: float,
    price: float,
    values: Any,
) -> None:
    """Ψ − price·π·s of the decisions in SLOTS slots."""
    b0, b1, b2 = belief
    for q in range(SLOTS):
        x0, x1 = p0 - slots[3, q], p1 - slots[4, q]
        share = min(max((x0 * slots[5, q] + x1 * slots[6, q]) * slots[7, q], 0.0), 1.0)
        x0 -= share * slots[5, q]
        x1 -= share * slots[6, q]
        cost = b0 * slots[0, q] + b1 * slots[1, q] + b2 * slots[2, q]
        values[q] = sign * np.sqrt(x0 * x0 + x1 * x1) - price * cost


@woven
def largest(values: Any) -> float:
    """The largest of SLOTS values, by halves so that they are taken by the lane; the memory behind them is used."""
    for q in range(SLOTS // 2):
        values[SLOTS + q] = max(values[q], values[SLOTS // 2 + q])
    for q in range(SLOTS // 4):
        values[SLOTS + q] = max(values[SLOTS + q], values[SLOTS + SLOTS // 4 + q])
    top = values[SLOTS]
    for q in range(1, SLOTS // 4):
        top = max(top, values[SLOTS + q])
    return float(top)


@woven
def cost_of_slot(slots: Any, here: Here, d: int) -> float:
    """π·s of the decision in a slot."""
    leaf, q = d // SLOTS, d % SLOTS
    b0, b1, b2 = here.b0, here.b1, here.b2
    return float(b0 * slots[leaf, 0, q] + b1 * slots[leaf, 1, q] + b2 * slots[leaf, 2, q])


@woven
def judge_slot(slots: Any, here: Here, d: int) -> tuple[float, float]:
    """Regret and privacy of the decision in a slot."""
    leaf, q = d // SLOTS, d % SLOTS
    x0, x1 = here.p0 - slots[leaf, 3, q], here.p1 - slots[leaf, 4, q]
    share = min(max((x0 * slots[leaf, 5, q] + x1 * slots[leaf, 6, q]) * slots[leaf, 7, q], 0.0), 1.0)
    x0 -= share * slots[leaf, 5, q]
    x1 -= share * slots[leaf, 6, q]
    regret = cost_of_slot(slots, here, d) - here.optimal
    return max(regret, 0.0), here.sign * np.sqrt(x0 * x0 + x1 * x1)


@woven
def live_leaves(bounds: Any, count: int, floor: float, live: Any) -> int:
    """List the leaves whose bound exceeds `floor`, without a branch: how many there are."""
    n = 0
    for leaf in range(count):
        live[n] = leaf
        n += bounds[leaf] > floor
    return n


@bare
def best_above(
    slots: Any,
    leaves: Any,
    bands: Any,
    n_leaves: int,
    polygon_costs: Any,
    here: Here,
    price: float,
    floor: float,
    known: Any,
    scan: Any,
) -> int:
    """The slot or polygon of largest Ψ − price·π·s above `floor`, or NONE. known: distances of the polygons."""
    bounds, values, live = scan
    b0, b1, b2, p0, p1, sign = here.b0, here.b1, here.b2, here.p0, here.p1, here.sign
    best = NONE
    for n in range(known.size):
        cost = b0 * polygon_costs[0, n] + b1 * polygon_costs[1, n] + b2 * polygon_costs[2, n]
        if sign * known[n] - price * cost > floor:
            floor, best = sign * known[n] - price * cost, FIRST_POLYGON - n
    bound_leaves(leaves, bands, n_leaves, here, price, bounds)
    for n in range(live_leaves(bounds, len(slots), floor, live)):
        leaf = live[n]
        if bounds[leaf] <= floor:
            continue
        read_leaf(slots[leaf], (b0, b1, b2), p0, p1, sign, price, values)
        if largest(values) > floor:
            for q in range(SLOTS):
                if values[q] > floor:
                    floor, best = values[q], leaf * SLOTS + q
    return best
