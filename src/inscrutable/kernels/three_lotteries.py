"""Lotteries for three states: propose, polish, verify.

Two candidates on the envelope are climbed at the price of their chord, until one pass over the leaves of `search`, most of
which their bounds exclude, shows that no candidate lies above the chord at its slope.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.options import bare_kernel, woven
from inscrutable.kernels.three_leaves import (
    ABSENT,
    FIRST_POLYGON,
    NONE,
    POLISHED,
    SLOTS,
    TARGET,
    Plane,
    Scene,
    best_above,
    here_of,
    judge_slot,
)
from inscrutable.kernels.three_sets import climb_edge, polygon_distance
from inscrutable.kernels.three_states import (
    SIZE,
    Ground,
    Here,
    bench,
    climb_three,
    in_space,
)
from inscrutable.tolerances import CHORD, NEAR_ATOMS, SAME_PRICE

_TURNS = 40


class Pair(NamedTuple):
    """A, affordable, and B, unaffordable or ABSENT."""

    name: Any  # (2,) of a candidate, POLISHED, OWN, TARGET, ABSENT
    face: Any  # (2,)
    place: Any  # (2,2)
    regret: Any  # (2,)
    privacy: Any  # (2,)


@woven
def _put(pair: Pair, side: int, name: int, face: int, z0: float, z1: float, regret: float, privacy: float) -> None:
    pair.name[side], pair.face[side] = name, face
    pair.place[side, 0], pair.place[side, 1] = z0, z1
    pair.regret[side], pair.privacy[side] = regret, privacy
    if pair.name[1] != ABSENT and not pair.privacy[1] > pair.privacy[0]:
        pair.name[1] = ABSENT


@woven
def _judge(plane: Plane, here: Here, d: int, known: Any) -> tuple[float, float]:
    """Regret and privacy of the decision in a slot, or of a polygon."""
    b0, b1, b2 = here.b0, here.b1, here.b2
    if d <= FIRST_POLYGON:
        n = FIRST_POLYGON - d
        cost = b0 * plane.polygon_costs[0, n] + b1 * plane.polygon_costs[1, n] + b2 * plane.polygon_costs[2, n]
        return max(cost - here.optimal, 0.0), here.sign * known[n]
    return judge_slot(plane.slots, here, d)


@woven
def _chord(pair: Pair) -> float:
    if pair.name[1] == ABSENT:
        return 0.0
    return float((pair.privacy[1] - pair.privacy[0]) / (pair.regret[1] - pair.regret[0]))


@woven
def climb_any(
    ground: Ground, face: int, rules: Any, here: Here, aim: Any, z0: float, z1: float, on: Any
) -> tuple[bool, float, float, float, float, float]:
    """Climb from z on a face of any size: whether all went well, z, regret, privacy and price.

    aim: limit (infinite at a price), price.
    """
    k = ground.faces[face, SIZE]
    if k >= 2:
        return climb_three(ground, face, rules, here, aim, z0, z1, on)
    if k == 1:
        return climb_edge(ground, face, rules, here, aim, z0, z1)
    return False, z0, z1, 0.0, 0.0, 0.0


@woven
def _copy(pair: Pair) -> None:
    """A becomes B as well."""
    pair.name[1], pair.face[1] = pair.name[0], pair.face[0]
    pair.place[1, 0], pair.place[1, 1] = pair.place[0, 0], pair.place[0, 1]
    pair.regret[1], pair.privacy[1] = pair.regret[0], pair.privacy[0]


@woven
def _polish(pair: Pair, ground: Ground, rules: Any, here: Here, aim: Any, near: float, on: Any) -> tuple[bool, float]:
    """Climb both atoms, or one where they are near each other: whether it is a single one now, and its price."""
    limit, price = aim
    first, z0, z1 = 0, 0.0, 0.0
    if pair.name[1] != ABSENT and pair.face[0] >= 0 and pair.face[0] == pair.face[1]:
        x0, x1 = pair.place[1, 0] - pair.place[0, 0], pair.place[1, 1] - pair.place[0, 1]
        if x0 * x0 + x1 * x1 < near * near:
            share = (limit - pair.regret[0]) / (pair.regret[1] - pair.regret[0])
            z0, z1 = pair.place[0, 0] + share * x0, pair.place[0, 1] + share * x1
            first = -1
    # One loop over the point between them, A and B: a climb is much code, and here it stands once.
    for side in range(first, 2):
        seat = max(side, 0)
        face, most = pair.face[seat], limit
        if side >= 0:
            z0, z1, most = pair.place[side, 0], pair.place[side, 1], np.inf
            if pair.name[side] == ABSENT or face < 0:
                continue
        if ground.faces[face, SIZE] == 0:
            continue
        ok, z0, z1, regret, privacy, reached = climb_any(ground, face, rules, here, (most, price), z0, z1, on)
        if not ok:
            continue
        if side < 0:
            if privacy - price * regret >= pair.privacy[0] - price * pair.regret[0]:
                pair.name[1] = ABSENT
                _put(pair, 0, POLISHED, face, z0, z1, regret, privacy)
                return True, reached
            continue
        # One that leaves its side takes the other's place where it is better there.
        to = 0 if regret <= limit else 1
        if pair.name[to] == ABSENT or privacy - price * regret >= pair.privacy[to] - price * pair.regret[to]:
            _put(pair, to, POLISHED, face, z0, z1, regret, privacy)
    return False, price


@woven
def _start(pair: Pair, scene: Scene, t: int, limit: float) -> None:
    """Begin with what is known beforehand."""
    pair.name[1] = ABSENT
    _put(pair, 0, scene.first, -1, 0.0, 0.0, scene.first_regrets[t], scene.first_privacies[t])
    regret = scene.target_regrets[t]
    if regret < np.inf:
        _put(pair, 0 if regret <= limit else 1, TARGET, -1, 0.0, 0.0, regret, 0.0)


@woven
def _take(pair: Pair, plane: Plane, d: int, limit: float, regret: float, privacy: float) -> None:
    """A decision found above the chord takes the place of A or of B."""
    side = 0 if regret <= limit else 1
    if d <= FIRST_POLYGON:
        n = FIRST_POLYGON - d
        z0, z1 = plane.polygon_decoys[0, n], plane.polygon_decoys[1, n]
        _put(pair, side, d, plane.polygon_faces[n], z0, z1, regret, privacy)
    else:
        _put(pair, side, d, plane.face[d], plane.decoys[0, d], plane.decoys[1, d], regret, privacy)


@woven
def _settle_lottery(
    plane: Plane, rules: Any, scene: Scene, t: int, here: Here, limit: float, pair: Pair, tools: Any
) -> tuple[bool, bool, float]:
    """The lottery of one belief, left in the pair: whether it is proved against all candidates, is single, and its price."""
    scan, known, on = tools
    single, price, climbed_at, merge = False, 0.0, np.nan, NEAR_ATOMS
    _start(pair, scene, t, limit)
    proposing = True
    for _ in range(_TURNS):
        if pair.name[0] == TARGET or not limit > 0.0:
            # Nothing is nearer than the target itself, and nothing is for free.
            pair.name[1] = ABSENT
            return True, False, 0.0
        if not single:
            price = _chord(pair)
            if not proposing and not abs(price - climbed_at) <= SAME_PRICE * price:
                climbed_at = price
                single, price = _polish(pair, plane.ground, rules, here, (limit, price), merge, on)
                continue
        floor = pair.privacy[0] - price * pair.regret[0] + CHORD
        d = best_above(
            plane.slots, plane.leaves, plane.bands, plane.n_leaves, plane.polygon_costs, here, price,
            floor - price * here.optimal, known, scan,
        )  # fmt: skip
        if d == NONE:
            if not proposing:
                return True, single, price
            proposing = False
            continue
        regret, privacy = _judge(plane, here, d, known)
        if single:
            # Two decisions are better than the one: they must come nearer than this to be merged again.
            merge *= 0.1
            if regret <= limit:
                _copy(pair)
        single, climbed_at = False, np.nan
        _take(pair, plane, d, limit, regret, privacy)
    return False, False, 0.0


@woven
def _write(plane: Plane, rules: Any, limit: float, single: bool, pair: Pair, t: int, c: int, out: Any) -> None:
    """Write the lottery of one belief and budget; a single decision is both atoms."""
    index, faces, places, regrets, privacies, probabilities, _, _ = out
    share = 0.0
    two = not single and pair.name[1] != ABSENT
    if two:
        share = max(limit - pair.regret[0], 0.0) / (pair.regret[1] - pair.regret[0])
    probabilities[t, c, 0], probabilities[t, c, 1] = 1.0 - share, share
    for side in range(2):
        s = side if two else 0
        name = pair.name[s]
        if name <= FIRST_POLYGON:
            name = plane.polygons[FIRST_POLYGON - name]
        elif name >= 0:
            name = plane.name[name]
        index[t, c, side], faces[t, c, side] = name, pair.face[s]
        regrets[t, c, side], privacies[t, c, side] = pair.regret[s], pair.privacy[s]
        y0, y1, y2 = in_space(rules.basis, pair.place[s, 0], pair.place[s, 1])
        places[t, c, side, 0], places[t, c, side, 1], places[t, c, side, 2] = y0, y1, y2


@bare_kernel
def lotteries_three(low: int, high: int, scene: Scene, plane: Plane, rules: Any, out: Any, tools: Any) -> None:
    """Fill the lotteries of the beliefs low..high, each by itself, for B budgets each.

    out: index (T,B,2), face (T,B,2), decoys (T,B,2,3), regrets, privacies, probabilities (T,B,2), prices (T,B), and
    failures (T,B), True where the general search is needed. tools: memory of `lottery_tools`, every call its own.
    """
    scan, known, on, pair = tools
    prices, failures = out[6], out[7]
    for t in range(low, high):
        here = here_of(scene, t)
        for n in range(known.size):
            known[n] = polygon_distance(plane.ground, plane.polygon_faces[n], rules, here.p0, here.p1)
        for c in range(prices.shape[1]):
            limit = scene.limits[t, c] * rules.inside
            found, single, price = _settle_lottery(plane, rules, scene, t, here, limit, pair, (scan, known, on))
            failures[t, c], prices[t, c] = not found, price
            if found:
                _write(plane, rules, limit, single, pair, t, c, out)


def lottery_tools(plane: Plane) -> tuple[Any, ...]:
    """Return the memory that `lotteries_three` works in."""
    pair = Pair(np.empty(2, np.int64), np.empty(2, np.int64), np.empty((2, 2)), np.empty(2), np.empty(2))
    return *search_tools(plane), pair


def search_tools(plane: Plane) -> tuple[Any, ...]:
    """Return memory for bounds, one leaf's values and the leaves alive; the polygons; and climbs."""
    n = max(plane.leaves.shape[1], plane.n_leaves + plane.bands.shape[1])
    scan = (np.empty(n), np.empty(2 * SLOTS), np.empty(n, np.int64))
    return scan, np.empty(plane.polygons.size), bench(plane.ground)
