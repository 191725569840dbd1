"""The lottery of largest expected privacy for many beliefs: the two atoms on the concave envelope, without the envelope.

At a price μ the best decision maximises Ψ − μ ρ. Between an affordable point A and an unaffordable point B the envelope's
value at the budget is that of the chord, and a decision above the chord at its slope replaces A or B, until there is none:
a few passes over the leaves of `search`, of which most are skipped.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.options import kernel, part
from inscrutable.kernels.search import LARGER, SEGMENT
from inscrutable.kernels.set_distance import nearest_belief

NONE = -1
FIRST_SEED = -2
_UNDERBID = 0.7


class Arena(NamedTuple):
    """The face programmes of an atlas, end to end."""

    size: Any  # (K,) free coordinates
    n_rows: Any  # (K,)
    n_set_rows: Any  # (K,)
    scale: Any  # (K,)
    curve_at: Any  # (K,) where the curves of each begin
    row_at: Any  # (K,)
    curves: Any  # flat
    rows: Any  # flat


@part
def curves_of(arena: Any, face: int, n_states: int) -> Any:
    """The costs (X, k+1, k+1) of a face."""
    k = arena.size[face] + 1
    first = arena.curve_at[face]
    return arena.curves[first : first + n_states * k * k].reshape((n_states, k, k))


@part
def rows_of(arena: Any, face: int, n_states: int) -> Any:
    """The rows (m, X, k+1) of a face."""
    k, m = arena.size[face] + 1, arena.n_rows[face]
    first = arena.row_at[face]
    return arena.rows[first : first + m * n_states * k].reshape((m, n_states, k))


@part
def _prepare(
    belief: Any, point: Any, sign: float, centre: Any, costs: Any, excess: Any, slope: Any, radius: Any, work: Any
) -> None:
    """What the leaves' bounds have in common for all prices; leaves run along the last axis of every array.

    work: 0 sign·‖c − p‖, 1 π·(s_c − e), then X rows of sign·d, X rows of J'π, and the least cost that a leaf can have.
    """
    n_states, n_leaves = centre.shape
    for leaf in range(n_leaves):
        work[0, leaf] = 0.0
        work[1, leaf] = 0.0
    for i in range(n_states):
        for leaf in range(n_leaves):
            away = centre[i, leaf] - point[i]
            work[2 + i, leaf] = away
            work[0, leaf] += away * away
            work[1, leaf] += belief[i] * (costs[i, leaf] - excess[i, leaf])
    for leaf in range(n_leaves):
        work[0, leaf] = sign * np.sqrt(work[0, leaf])
    for i in range(n_states):
        for leaf in range(n_leaves):
            work[2 + i, leaf] /= max(abs(work[0, leaf]), 1e-12) * sign
            work[2 + n_states + i, leaf] = 0.0
    for k in range(n_states):
        for i in range(n_states):
            for leaf in range(n_leaves):
                work[2 + n_states + k, leaf] += slope[k, i, leaf] * belief[i]
    last = 2 + 2 * n_states
    for leaf in range(n_leaves):
        work[last, leaf] = 0.0
    for k in range(n_states):
        for leaf in range(n_leaves):
            work[last, leaf] += work[2 + n_states + k, leaf] ** 2
    for leaf in range(n_leaves):
        work[last, leaf] = work[1, leaf] - np.sqrt(work[last, leaf]) * radius[leaf]


@part
def _bounds(price: float, sign: float, n_states: int, radius: Any, reach: Any, work: Any, out: Any) -> None:
    """Upper bounds of Ψ − price·π·s, leaf by leaf."""
    for leaf in range(out.size):
        out[leaf] = 0.0
    for k in range(n_states):
        for leaf in range(out.size):
            lean = work[2 + k, leaf] - price * work[2 + n_states + k, leaf]
            out[leaf] += lean * lean
    for leaf in range(out.size):
        rest = reach[leaf]
        if sign > 0.0:
            rest = 0.5 * radius[leaf] * radius[leaf] / max(work[0, leaf], 1e-12)
        out[leaf] = work[0, leaf] - price * work[1, leaf] + np.sqrt(out[leaf]) * radius[leaf] + rest


@part
def _privacy(point: Any, sign: float, d: int, decoys: Any, start: Any, along: Any, square: Any, kind: Any) -> float:
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
    return float(sign * np.sqrt(total))


@part
def _scan_three(
    belief: Any,
    point: Any,
    sign: float,
    price: float,
    optimal_cost: float,
    low: int,
    high: int,
    floor: float,
    limit: float,
    costs: Any,
    decoys: Any,
    start: Any,
    along: Any,
    square: Any,
    kind: Any,
    known: Any,
) -> tuple[int, float]:
    """`_scan` for three states, the most common number, with its sums written out.

    Ψ − price·ρ > floor without roots: the squared distance against the square of floor + price·ρ.
    """
    best = NONE
    b0, b1, b2 = belief[0], belief[1], belief[2]
    p0, p1, p2 = point[0], point[1], point[2]
    for d in range(low, high):
        regret = max(b0 * costs[d, 0] + b1 * costs[d, 1] + b2 * costs[d, 2] - optimal_cost, 0.0)
        x0, x1, x2 = p0 - decoys[d, 0], p1 - decoys[d, 1], p2 - decoys[d, 2]
        if kind[d] == SEGMENT:
            x0, x1, x2 = p0 - start[d, 0], p1 - start[d, 1], p2 - start[d, 2]
            share = (x0 * along[d, 0] + x1 * along[d, 1] + x2 * along[d, 2]) / square[d]
            share = min(max(share, 0.0), 1.0)
            x0, x1, x2 = x0 - share * along[d, 0], x1 - share * along[d, 1], x2 - share * along[d, 2]
        total = x0 * x0 + x1 * x1 + x2 * x2
        if kind[d] == LARGER:
            if not np.isnan(known[d]):
                if known[d] == -np.inf:
                    continue
                total = known[d] * known[d]
            elif sign < 0.0:
                total = 0.0
        least = floor + price * regret
        wins = least < 0.0 or total > least * least
        if sign < 0.0:
            wins = least < 0.0 and total < least * least
        if wins and regret <= limit:
            floor = sign * np.sqrt(total) - price * regret
            best = d
    return best, floor


@part
def _scan(
    belief: Any,
    point: Any,
    sign: float,
    price: float,
    optimal_cost: float,
    low: int,
    high: int,
    floor: float,
    costs: Any,
    decoys: Any,
    start: Any,
    along: Any,
    square: Any,
    kind: Any,
    known: Any,
    limit: float,
) -> tuple[int, float]:
    """The best of the decisions low..high with a regret of at most `limit`, if above `floor`; and the new floor.

    known (D,): exact privacies of larger sets under this belief, NaN where not judged yet, −∞ for one never to be taken.
    """
    best = NONE
    for d in range(low, high):
        cost = 0.0
        total = 0.0
        for i in range(belief.size):
            cost += belief[i] * costs[d, i]
            total += (point[i] - decoys[d, i]) ** 2
        regret = max(cost - optimal_cost, 0.0)
        if regret > limit:
            continue
        if kind[d] == SEGMENT:
            privacy = _privacy(point, sign, d, decoys, start, along, square, kind)
        elif kind[d] == LARGER and not np.isnan(known[d]):
            privacy = known[d]
        elif kind[d] == LARGER and sign < 0.0:
            privacy = 0.0
        else:
            privacy = sign * np.sqrt(total)
        if privacy - price * regret > floor:
            floor = privacy - price * regret
            best = d
    return best, floor


@part
def _best(
    belief: Any,
    point: Any,
    sign: float,
    price: float,
    optimal_cost: float,
    limit: float,
    floor: float,
    table: Any,
    leaves: Any,
    work: Any,
    bounds: Any,
    known: Any,
) -> int:
    """The decision of largest Ψ − price·ρ above `floor`; larger sets by their bound."""
    first, radius, reach = leaves
    costs, decoys, start, along, square, kind, _, _ = table
    _bounds(price, sign, belief.size, radius, reach, work, bounds)
    shift = price * optimal_cost
    top = 0
    if limit < np.inf:
        for leaf in range(bounds.size):
            if work[2 + 2 * belief.size, leaf] - optimal_cost > limit:
                bounds[leaf] = -np.inf
    for leaf in range(bounds.size):
        if bounds[leaf] > bounds[top]:
            top = leaf
    best = NONE
    if bounds.size == 0:
        return best
    # The most promising leaf first: its best decision rules most of the others out.
    for turn in range(-1, bounds.size):
        leaf = top if turn < 0 else turn
        if not bounds[leaf] + shift > floor or (leaf == top and turn >= 0):
            continue
        low, high = first[leaf], first[leaf + 1]
        if belief.size == 3:
            found, floor = _scan_three(
                belief, point, sign, price, optimal_cost, low, high, floor, limit,
                costs, decoys, start, along, square, kind, known,
            )  # fmt: skip
        else:
            found, floor = _scan(
                belief, point, sign, price, optimal_cost, low, high, floor, costs,
                decoys, start, along, square, kind, known, limit
            )  # fmt: skip
        if found != NONE:
            best = found
    return best


@part
def _judge(d: int, face: Any, point: Any, sign: float, place_at: Any, places: Any, arena: Any, rules: Any) -> float:
    """Exact privacy of a decision that a larger set of beliefs explains; −∞ where its set is found empty.

    The decision is taken as it is, not from its decoy: with copies of an asset a decoy has many decisions on a face.
    """
    number, n_states = face[d], point.size
    k, m = arena.size[number], arena.n_set_rows[number]
    curves, rows = curves_of(arena, number, n_states), rows_of(arena, number, n_states)
    w = places[place_at[d] : place_at[d] + k + 1]
    nearest, active = np.empty(n_states), np.empty(k + m, dtype=np.bool_)
    distance = nearest_belief(curves, rows[:m], arena.scale[number], w, point, rules, nearest, active)
    return sign * distance if distance < np.inf else -np.inf


@part
def _regret(belief: Any, optimal_cost: float, costs: Any, d: int) -> float:
    total = -optimal_cost
    for i in range(belief.size):
        total += belief[i] * costs[d, i]
    return max(total, 0.0)


@part
def _offer(atom: int, regret: float, privacy: float, limit: float, found: Any, regrets: Any, privacies: Any) -> None:
    """Take a point as A where it is affordable, else as B; a B that is no more private than A is dropped."""
    side = 0 if regret <= limit else 1
    found[side], regrets[side], privacies[side] = atom, regret, privacy
    if found[1] != NONE and not privacies[1] > privacies[0]:
        found[1] = NONE


@part
def _next(
    scene: Any, price: float, most: float, floor: float, scan: Any, face: Any, arena: Any, rules: Any, judged: Any
) -> tuple[int, float, float]:
    """The best decision above `floor` with its regret and privacy, larger sets judged exactly until none could win."""
    belief, point, sign, optimal_cost = scene
    table, leaves, work, bounds, known = scan
    costs, decoys, start, along, square, kind, place_at, places = table
    while True:
        d = _best(belief, point, sign, price, optimal_cost, most, floor, table, leaves, work, bounds, known)
        if d == NONE:
            return d, 0.0, 0.0
        if kind[d] != LARGER:
            return (
                d,
                _regret(belief, optimal_cost, costs, d),
                _privacy(point, sign, d, decoys, start, along, square, kind),
            )
        if not np.isnan(known[d]):
            return d, _regret(belief, optimal_cost, costs, d), known[d]
        known[d] = _judge(d, face, point, sign, place_at, places, arena, rules)
        judged[0] += 1
        judged[judged[0]] = d


@part
def _close_chord(
    scene: Any,
    limit: float,
    gap: float,
    scan: Any,
    face: Any,
    arena: Any,
    rules: Any,
    judged: Any,
    seeds: Any,
    found: Any,
    regrets: Any,
    privacies: Any,
) -> None:
    """Replace A and B until no decision and no seed lies above their chord, or above A where there is no B."""
    for _ in range(10 + 2 * face.size):
        price = 0.0
        if found[1] != NONE:
            price = (privacies[1] - privacies[0]) / (regrets[1] - regrets[0])
        floor = privacies[0] - price * regrets[0] + gap
        better = False
        for s in range(seeds.shape[0]):
            if seeds[s, 1] - price * seeds[s, 0] > floor:
                _offer(FIRST_SEED - s, seeds[s, 0], seeds[s, 1], limit, found, regrets, privacies)
                better = True
                break
        if better:
            continue
        d, regret, privacy = _next(scene, price, np.inf, floor, scan, face, arena, rules, judged)
        if d == NONE:
            return
        _offer(d, regret, privacy, limit, found, regrets, privacies)


@kernel
def search_lotteries(
    low: int,
    high: int,
    beliefs: Any,
    points: Any,
    sign: float,
    optimal_costs: Any,
    limits: Any,
    seeds: Any,
    table: Any,
    face: Any,
    leaves: Any,
    models: Any,
    arena: Any,
    rules: Any,
    gap: float,
    atoms: Any,
    regrets: Any,
    privacies: Any,
) -> None:
    """Fill atoms (T,3), regrets and privacies for beliefs low..high: A affordable, B unaffordable, S the best single one.

    seeds (T,s,2) are regrets and privacies of points known beforehand, the first affordable, named FIRST_SEED,
    FIRST_SEED − 1, …; NONE as B: A is the best of all. Gains below `gap` are not looked for.
    """
    centre, leaf_costs, excess, slope = models
    kind = table[5]
    n_states, n_leaves = centre.shape
    work, bounds = np.empty((3 + 2 * n_states, n_leaves)), np.empty(n_leaves)
    known, judged = np.full(kind.size, np.nan), np.zeros(kind.size + 1, dtype=np.int64)
    scan = (table, leaves, work, bounds, known)
    for t in range(low, high):
        belief, point, optimal_cost, limit = beliefs[t], points[t], optimal_costs[t], limits[t]
        scene = (belief, point, sign, optimal_cost)
        _prepare(belief, point, sign, centre, leaf_costs, excess, slope, leaves[1], work)
        found, regret, privacy = atoms[t], regrets[t], privacies[t]
        found[:] = NONE
        found[0], regret[0], privacy[0] = FIRST_SEED, seeds[t, 0, 0], seeds[t, 0, 1]
        for s in range(seeds.shape[1]):
            if seeds[t, s, 1] > privacy[0] and seeds[t, s, 0] <= limit:
                _offer(FIRST_SEED - s, seeds[t, s, 0], seeds[t, s, 1], limit, found, regret, privacy)
        d, guess, worth = _next(scene, 0.0, limit, privacy[0] + gap, scan, face, arena, rules, judged)
        if d != NONE:
            _offer(d, guess, worth, limit, found, regret, privacy)
        found[2], regret[2], privacy[2] = found[0], regret[0], privacy[0]
        if sign > 0.0 and regret[2] > 0.0:
            # Regret grows with the square of the distance, roughly: a little below that price B is near.
            price = _UNDERBID * 0.5 * privacy[2] / regret[2]
            d, guess, worth = _next(
                scene, price, np.inf, privacy[2] - price * regret[2] + gap, scan, face, arena, rules, judged
            )
            if d != NONE:
                _offer(d, guess, worth, limit, found, regret, privacy)
        _close_chord(scene, limit, gap, scan, face, arena, rules, judged, seeds[t], found, regret, privacy)
        for j in range(1, judged[0] + 1):
            known[judged[j]] = np.nan
        judged[0] = 0
