"""Single decisions for three states: the best candidates of every face and octant, climbed within the budget.

A candidate lies inside the budget by up to its spacing, so the one that climbs highest need not be the highest itself: the
best of each face and octant around the point is climbed where it is at most some spacings below the best known.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.options import bare, bare_kernel, woven
from inscrutable.kernels.three_leaves import (
    FIRST_POLYGON,
    POLISHED,
    SLOTS,
    TARGET,
    Plane,
    Scene,
    bar_dear_leaves,
    bound_leaves,
    cost_of_slot,
    here_of,
    judge_slot,
    largest,
    live_leaves,
    read_leaf,
)
from inscrutable.kernels.three_lotteries import climb_any, search_tools
from inscrutable.kernels.three_sets import polygon_distance
from inscrutable.kernels.three_states import Here, in_space
from inscrutable.tolerances import CLIMB

_MOST_CLIMBS = 16
_SLACK = 1.5  # spacings that a candidate may lack to the best decision


class Heap(NamedTuple):
    """The best candidate of every face and octant, and those that are filled."""

    privacy: Any  # (8K,)
    slot: Any  # (8K,)
    filled: Any  # (8K+1,) how many, then which


class Best(NamedTuple):
    """The best decision known: its name, face, place, regret, privacy and price."""

    name: int
    face: int
    z0: float
    z1: float
    regret: float
    privacy: float
    price: float


@woven
def _keep(plane: Plane, here: Here, d: int, privacy: float, heap: Heap) -> None:
    """A decision becomes the best of its face and octant, unless there is a better one."""
    x0, x1 = plane.decoys[0, d] - here.p0, plane.decoys[1, d] - here.p1
    group = 8 * plane.face[d]
    group += 4 if x0 > 0.0 else 0
    group += 2 if x1 > 0.0 else 0
    group += 1 if abs(x0) > abs(x1) else 0
    if heap.slot[group] < 0:
        heap.filled[0] += 1
        heap.filled[heap.filled[0]] = group
    if heap.slot[group] < 0 or privacy > heap.privacy[group]:
        heap.privacy[group], heap.slot[group] = privacy, d


@bare
def _collect(plane: Plane, here: Here, limit: float, floor: float, scan: Any, heap: Heap) -> None:
    """Keep the best affordable candidate of every face and octant, among those little below `floor` and the best."""
    bounds, values, live = scan
    most, slack = here.optimal + limit, _SLACK * plane.spacing[0]
    belief = (here.b0, here.b1, here.b2)
    bound_leaves(plane.leaves, plane.bands, plane.n_leaves, here, 0.0, bounds)
    bar_dear_leaves(plane.leaves, plane.bands, plane.n_leaves, here, most, bounds)
    for n in range(live_leaves(bounds, len(plane.slots), floor - slack, live)):
        leaf = live[n]
        if bounds[leaf] > floor - slack:
            read_leaf(plane.slots[leaf], belief, here.p0, here.p1, here.sign, 0.0, values)
            if largest(values) <= floor - slack:
                continue
            for q in range(SLOTS):
                d = leaf * SLOTS + q
                if values[q] > floor - slack and cost_of_slot(plane.slots, here, d) <= most:
                    floor = max(floor, values[q])
                    _keep(plane, here, d, values[q], heap)


@woven
def _chosen(heap: Heap) -> int:
    """The group of the best candidate that is kept and was not climbed from, −1 where there is none."""
    chosen = -1
    for n in range(1, heap.filled[0] + 1):
        group = heap.filled[n]
        if heap.slot[group] >= 0 and (chosen < 0 or heap.privacy[group] > heap.privacy[chosen]):
            chosen = group
    return chosen


@woven
def _climb_best(plane: Plane, rules: Any, here: Here, limit: float, best: Best, scan: Any, heap: Heap, on: Any) -> Best:
    """Climb from the kept candidates, the best first, and empty the heap."""
    _collect(plane, here, limit, best.privacy, scan, heap)
    for _ in range(_MOST_CLIMBS):
        chosen = _chosen(heap)
        if chosen < 0 or heap.privacy[chosen] <= best.privacy - _SLACK * plane.spacing[0]:
            break
        d = heap.slot[chosen]
        heap.slot[chosen] = -1
        face, z0, z1 = plane.face[d], plane.decoys[0, d], plane.decoys[1, d]
        if heap.privacy[chosen] > best.privacy:
            regret, privacy = judge_slot(plane.slots, here, d)
            best = Best(plane.name[d], face, z0, z1, regret, privacy, best.price)
        ok, z0, z1, regret, privacy, price = climb_any(plane.ground, face, rules, here, (limit, 0.0), z0, z1, on)
        # An end as good as the candidate it began from is a decision that was climbed to: no better one was passed by.
        if ok and (privacy > best.privacy or (best.name >= 0 and privacy > best.privacy - CLIMB)):
            best = Best(POLISHED, face, z0, z1, regret, privacy, price)
    for n in range(1, heap.filled[0] + 1):
        heap.slot[heap.filled[n]] = -1
    heap.filled[0] = 0
    return best


@woven
def _known(plane: Plane, scene: Scene, t: int, limit: float, known: Any) -> Best:
    """The best of what needs no search: the decision known beforehand, the target's, and polygons."""
    best = Best(scene.first, -1, 0.0, 0.0, scene.first_regrets[t], scene.first_privacies[t], 0.0)
    if scene.target_regrets[t] <= limit:
        best = Best(TARGET, -1, 0.0, 0.0, scene.target_regrets[t], 0.0, 0.0)
    b0, b1, b2 = scene.beliefs[t, 0], scene.beliefs[t, 1], scene.beliefs[t, 2]
    for n in range(known.size):
        cost = b0 * plane.polygon_costs[0, n] + b1 * plane.polygon_costs[1, n] + b2 * plane.polygon_costs[2, n]
        regret, privacy = max(cost - scene.optimal_costs[t], 0.0), scene.sign * known[n]
        if regret <= limit and privacy > best.privacy:
            z0, z1 = plane.polygon_decoys[0, n], plane.polygon_decoys[1, n]
            best = Best(FIRST_POLYGON - n, plane.polygon_faces[n], z0, z1, regret, privacy, 0.0)
    return best


@bare_kernel
def singles_three(low: int, high: int, scene: Scene, plane: Plane, rules: Any, out: Any, tools: Any) -> None:
    """Fill the best single decisions of the beliefs low..high, each by itself, for B budgets each.

    out: index (T,B) of a candidate, POLISHED, or the name of one known beforehand; face (T,B), decoys (T,B,3), regrets,
    privacies, prices (T,B). tools: memory of `single_tools`, every call its own.
    """
    name, faces, places, regrets, privacies, prices = out
    scan, known, on, heap = tools
    for t in range(low, high):
        here = here_of(scene, t)
        for n in range(known.size):
            known[n] = polygon_distance(plane.ground, plane.polygon_faces[n], rules, here.p0, here.p1)
        for c in range(prices.shape[1]):
            limit = scene.limits[t, c] * rules.inside
            best = _known(plane, scene, t, limit, known)
            if limit > 0.0 and best.name != TARGET:
                best = _climb_best(plane, rules, here, limit, best, scan, heap, on)
            number = best.name
            if number <= FIRST_POLYGON:
                number = plane.polygons[FIRST_POLYGON - number]
            name[t, c], faces[t, c] = number, best.face
            regrets[t, c], privacies[t, c], prices[t, c] = best.regret, best.privacy, best.price
            y0, y1, y2 = in_space(rules.basis, best.z0, best.z1)
            places[t, c, 0], places[t, c, 1], places[t, c, 2] = y0, y1, y2


def single_tools(plane: Plane) -> tuple[Any, ...]:
    """Return the memory that `singles_three` works in."""
    n_groups = 8 * len(plane.ground.faces)
    heap = Heap(np.empty(n_groups), np.full(n_groups, -1), np.zeros(n_groups + 1, np.int64))
    return *search_tools(plane), heap
