"""The best of many decisions for three states without visiting most of them.

Decisions lie in slots, SLOTS to a leaf, as near each other in the plane as can be. The bound of `search` excludes most
leaves, and only what is left is read.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.options import bare, woven
from inscrutable.tolerances import LENGTH, TINY

NONE = -1
TARGET = -3
POLISHED, ABSENT = -1, -9
FIRST_POLYGON = -16  # polygons are named from here downwards while searched
SLOTS = 32


class Plane(NamedTuple):
    """Decisions in slots and their leaves, in the plane of beliefs; both run along the last axis.

    What one loop reads is one array: the compiled loops check that arrays do not overlap, and many would take long.
    """

    slots: Any  # (8,S) 0–2 costs, 3–4 start of a segment or the one belief, 5–6 along a segment or 0, 7 1/length² or 0
    decoys: Any  # (2,S)
    face: Any  # (S,)
    name: Any  # (S,) number of the decision
    leaves: Any  # (13,L) 0–1 centre, 2 radius, 3 reach, 4–6 least costs s_c − e, 7–9 and 10–12 their slopes; filled up
    spacing: Any  # (1,) typical distance between neighbouring decisions
    polygons: Any  # (N,) numbers of the decisions with a polygon of beliefs; they are in no leaf
    polygon_costs: Any  # (3,N)
    polygon_faces: Any  # (N,)
    polygon_decoys: Any  # (2,N)


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
def bound_leaves(leaves: Any, scene: Scene, t: int, price: float, out: Any) -> None:
    """Upper bounds of Ψ − price·π·s, leaf by leaf."""
    p0, p1 = scene.points[t, 0], scene.points[t, 1]
    b0, b1, b2 = scene.beliefs[t, 0], scene.beliefs[t, 1], scene.beliefs[t, 2]
    sign = scene.sign
    away = 0.5 if sign > 0.0 else 0.0
    near = 0.0 if sign > 0.0 else 1.0
    for n in range(out.size):
        x0, x1, r = leaves[0, n] - p0, leaves[1, n] - p1, leaves[2, n]
        distance = np.sqrt(x0 * x0 + x1 * x1)
        inverse = sign / max(distance, LENGTH)
        cost = b0 * leaves[4, n] + b1 * leaves[5, n] + b2 * leaves[6, n]
        e0 = x0 * inverse - price * (b0 * leaves[7, n] + b1 * leaves[8, n] + b2 * leaves[9, n])
        e1 = x1 * inverse - price * (b0 * leaves[10, n] + b1 * leaves[11, n] + b2 * leaves[12, n])
        # What the distance may exceed its linear model by.
        rest = away * r * r * inverse + near * leaves[3, n]
        out[n] = sign * distance - price * cost + np.sqrt(e0 * e0 + e1 * e1) * r + rest


@woven
def bar_dear_leaves(leaves: Any, scene: Scene, t: int, most: float, out: Any) -> None:
    """A bound that nothing reaches where all decisions of a leaf cost more than `most` (π·s)."""
    b0, b1, b2 = scene.beliefs[t, 0], scene.beliefs[t, 1], scene.beliefs[t, 2]
    for n in range(out.size):
        cost = b0 * leaves[4, n] + b1 * leaves[5, n] + b2 * leaves[6, n]
        j0 = b0 * leaves[7, n] + b1 * leaves[8, n] + b2 * leaves[9, n]
        j1 = b0 * leaves[10, n] + b1 * leaves[11, n] + b2 * leaves[12, n]
        # Without a branch, so that leaves are taken by the lane.
        out[n] -= max(cost - np.sqrt(j0 * j0 + j1 * j1) * leaves[2, n] - most, 0.0) / TINY


@woven
def read_leaf(
    slots: Any,
    leaf: int,
    belief: tuple[float, float, float],
    p0: float,
    p1: float,
    sign: float,
    price: float,
    values: Any,
) -> None:
    """Ψ − price·π·s of a leaf's decisions."""
    b0, b1, b2 = belief
    low = leaf * SLOTS
    for q in range(SLOTS):
        d = low + q
        x0, x1 = p0 - slots[3, d], p1 - slots[4, d]
        share = min(max((x0 * slots[5, d] + x1 * slots[6, d]) * slots[7, d], 0.0), 1.0)
        x0 -= share * slots[5, d]
        x1 -= share * slots[6, d]
        cost = b0 * slots[0, d] + b1 * slots[1, d] + b2 * slots[2, d]
        values[q] = sign * np.sqrt(x0 * x0 + x1 * x1) - price * cost


@woven
def cost_of_slot(slots: Any, scene: Scene, t: int, d: int) -> float:
    """π·s of the decision in a slot."""
    b0, b1, b2 = scene.beliefs[t, 0], scene.beliefs[t, 1], scene.beliefs[t, 2]
    return float(b0 * slots[0, d] + b1 * slots[1, d] + b2 * slots[2, d])


@woven
def judge_slot(slots: Any, scene: Scene, t: int, d: int) -> tuple[float, float]:
    """Regret and privacy of the decision in a slot."""
    x0, x1 = scene.points[t, 0] - slots[3, d], scene.points[t, 1] - slots[4, d]
    share = min(max((x0 * slots[5, d] + x1 * slots[6, d]) * slots[7, d], 0.0), 1.0)
    x0 -= share * slots[5, d]
    x1 -= share * slots[6, d]
    regret = cost_of_slot(slots, scene, t, d) - scene.optimal_costs[t]
    return max(regret, 0.0), scene.sign * np.sqrt(x0 * x0 + x1 * x1)


@bare
def best_above(
    plane: Plane, scene: Scene, t: int, price: float, floor: float, known: Any, bounds: Any, values: Any
) -> int:
    """The slot or polygon of largest Ψ − price·π·s above `floor`, or NONE; bounds are (L,), values (SLOTS,)."""
    b0, b1, b2 = scene.beliefs[t, 0], scene.beliefs[t, 1], scene.beliefs[t, 2]
    p0, p1 = scene.points[t, 0], scene.points[t, 1]
    best = NONE
    for n in range(known.size):
        cost = b0 * plane.polygon_costs[0, n] + b1 * plane.polygon_costs[1, n] + b2 * plane.polygon_costs[2, n]
        if scene.sign * known[n] - price * cost > floor:
            floor, best = scene.sign * known[n] - price * cost, FIRST_POLYGON - n
    bound_leaves(plane.leaves, scene, t, price, bounds)
    for leaf in range(plane.face.size // SLOTS):
        if bounds[leaf] > floor:
            read_leaf(plane.slots, leaf, (b0, b1, b2), p0, p1, scene.sign, price, values)
            for q in range(SLOTS):
                if values[q] > floor:
                    floor, best = values[q], leaf * SLOTS + q
    return best
