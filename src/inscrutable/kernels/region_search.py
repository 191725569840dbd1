"""The search over critical regions: climbs from the starts, then in the regions beyond the nearly active rows.

The search for a belief depends on its own starts alone. It takes turns: climbs from the most promising starts, then in the
neighbours of the best regions; the values found decide which regions come next. Where the programme of a region is missing,
the search of that belief waits until it is made.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.calls import deferred
from inscrutable.kernels.climb import MET
from inscrutable.kernels.copies import put, put_descending
from inscrutable.kernels.faces import cost_at, row_value
from inscrutable.kernels.options import integer, internal, kernel, uncounted, uncounted_kernel
from inscrutable.kernels.references import by_reference, release
from inscrutable.kernels.region_climb import (
    ClimbRoom,
    Optima,
    aim_of,
    climb_decoy,
    climb_room,
    search_set,
)
from inscrutable.kernels.regions import UNKNOWN, decision_in, face_of, has_multipliers, locate
from inscrutable.kernels.set_distance import NO_ROW, nearest_belief
from inscrutable.tolerances import POLISH, ROW_IN_REACH

AT_STARTS, AT_NEIGHBOURS, ENDED = integer(0), integer(1), integer(2)
"""Stages of a search: it climbs from its starts, then in the neighbours of the best regions."""
_PROMISE = 1.15
"""The largest distance at a climb's end, over that at its start; starts that promise less than is found are skipped. With 1.5
for sets larger than points none of 4,160 decisions, most over two and three states, changes by 1e-9 of itself."""
_PROMISE_AT_PRICE, _SET_PROMISE_AT_PRICE = 1.015, 1.2
"""The same at a price, where starts already stand at their best budget: nothing is lost on 430 beliefs of X = 2, 3, 4. With
1.015 for sets 3 of 4,160 lotteries, most over two and three states, lose up to .4 % and three gain up to 3.6 %; where none is
skipped one of 3,200 loses .1 % and nine gain up to 3.6 %, in 1.15 times the time."""
BEST, FAR, FREED = integer(0), integer(1), integer(2)
"""Sources of climbs, rows of `Turn.decoys`: the best decision of a region, its farthest belief, and from FREED on the beliefs
of freed rows."""
NO_START = integer(-1)
_LINES = integer(-1)  # in place of a way into a region: lines through its cheapest decision
_UNMET = 1e6  # below all distances: rows that are zero at no belief of a decision come last
_INWARD = (0.01, 0.001)
"""A climb beyond a row starts this share of the way from the decision on the row to the belief: where the budget is spent and
the row is active no feasible step is left. Where the first leads to no decision the second follows: of 2,800 decisions over
three to six states with 2 to 8 assets, 3 lose up to 31 % without the second; with it alone, 1 of 500 over four loses 85 %."""


class Table(NamedTuple):
    """Distinct admissible decisions that a belief explains."""

    costs: Any  # (D,X) state costs
    decoys: Any  # (D,X) a belief that each is optimal for
    region: Any  # (D,) number of the region
    places: Any  # (D,A) coordinates of the decoys in the directions that decisions identify


class Starts(NamedTuple):
    """Where the searches of T beliefs begin, belief by belief."""

    first: Any  # (T+1,)
    region: Any  # (n,)
    decoys: Any  # (n,X)
    actions: Any  # (n,U)
    bonus: Any  # (n,) is added to the promise of a start: it comes earlier, and is not skipped
    promise: Any  # (n,) no larger value is expected of a start; filled by its search
    order: Any  # (n,) places among the starts of each belief, the most promising first; filled by its search


class Explored(NamedTuple):
    """The best decisions of the regions that the searches of T beliefs visited, C at most each, and their states.

    Where consistent sets are larger than points a region has an entry for each orthant in which climbs ended.
    """

    stage: Any  # (T,) AT_STARTS, AT_NEIGHBOURS or ENDED
    patience: Any  # (T,) how many more regions may have neighbours without gain before the search ends
    n_missing: Any  # (T,) regions that must be made before the search goes on
    missing: Any  # (T,P,2) region and row whose other side each is
    n_begun: Any  # (T,) starts looked at
    value_before: Any  # (T,) the best value before the last region's neighbours were climbed
    potential_before: Any  # (T,) the best potential then
    count: Any  # (T,) entries
    region: Any  # (T,C)
    orthant: Any  # (T,C) of the farthest belief, seen from the aim's point; 0 where consistent sets are points
    optima: Optima  # of the entries, (T,C,…)
    expanded: Any  # (T,C) whether the neighbours were climbed
    n_tried: Any  # (T,)
    tried: Any  # (T,Q,2) regions that were climbed, each with the `_way` into it, or with _LINES


class Limits(NamedTuple):
    """Numbers that bound a search."""

    patience: int  # regions whose neighbours bring no gain before it ends
    climbs: int  # P, climbs of a turn
    freed: int  # tight rows of a region that are freed, where a decision has a set larger than a point


class Turn(NamedTuple):
    """The climbs that come next in the search of one belief, P at most, and memory for them."""

    n_climbs: Any  # (1,)
    region: Any  # (P,)
    start: Any  # (P,) the start of each climb, or NO_START
    source: Any  # (P,) where that is NO_START
    decoys: Any  # (2+F,X) of the sources, for F freed rows
    actions: Any  # (2,U) at BEST and FAR; freed rows have the first
    optima: Optima  # one, of the last climb
    values: Any  # (R,) sign × distance of the best members at which a tight row's multiplier is zero
    order: Any  # (R,) of these
    members: Any  # (R,X)
    climb: ClimbRoom


@internal
def _turn_room(n_states: int, n_actions: int, n_rows: int, limits: Any) -> Turn:
    """Return memory for searches in a problem."""
    size, number, most = n_actions + 1, np.int64, limits.climbs
    optima = Optima(
        np.empty(1), np.empty(1), np.empty(1), np.empty(1), np.empty((1, n_states)), np.empty((1, size)), np.empty(1),
        np.empty((1, n_states)), np.empty((1, size)),
    )  # fmt: skip
    return Turn(
        np.zeros(1, dtype=number), np.empty(most, dtype=number), np.empty(most, dtype=number),
        np.empty(most, dtype=number), np.empty((FREED + limits.freed, n_states)), np.empty((FREED, n_actions)), optima,
        np.empty(n_rows), np.empty(n_rows, dtype=number), np.empty((n_rows, n_states)),
        climb_room(n_states, n_actions, n_rows),
    )  # fmt: skip


@uncounted
def _largest(numbers: Any, count: int) -> float:
    """The largest of the first `count` numbers, −∞ of none."""
    top = -np.inf
    for e in range(count):
        top = max(top, numbers[e])
    return top


@uncounted
def _orthant(belief: Any, point: Any) -> int:
    """The signs of belief − point, a bit a state."""
    bits = 0
    for i in range(point.size):
        bits = 2 * bits + (1 if belief[i] > point[i] else 0)
    return bits


@uncounted
def _record(reached: Any, t: int, number: int, orthant: int, optima: Any) -> None:
    """Keep the best decision of each region and orthant; where there is no room the worst is dropped."""
    kept, value, potential = reached.optima, optima.value[0], optima.potential[0]
    is_nearest = not potential > value
    potential = max(value, potential)
    if not potential > -np.inf:
        return
    e, worst = -1, -1
    for other in range(reached.count[t]):
        if reached.region[t, other] == number and reached.orthant[t, other] == orthant:
            e = other
        if worst < 0 or kept.value[t, other] < kept.value[t, worst]:
            worst = other
    if e < 0:
        e = worst
        if reached.count[t] < reached.region.shape[1]:
            e = reached.count[t]
            reached.count[t] += 1
        reached.expanded[t, e] = False
        reached.region[t, e], reached.orthant[t, e] = number, orthant
        kept.value[t, e], kept.potential[t, e] = -np.inf, -np.inf
    if value > kept.value[t, e]:
        kept.value[t, e], kept.privacy[t, e] = value, optima.privacy[0]
        kept.regret[t, e], kept.price[t, e] = optima.regret[0], optima.price[0]
        put(optima.nearest[0], kept.nearest[t, e])
        put(optima.place[0], kept.place[t, e])
    if potential > kept.potential[t, e]:
        kept.potential[t, e] = potential
        put(optima.nearest[0] if is_nearest else optima.far[0], kept.far[t, e])
        put(optima.place[0] if is_nearest else optima.far_place[0], kept.far_place[t, e])


@uncounted
def _way(source: int, decoy: Any, point: Any) -> int:
    """Number of a way into a region: 0 from the best decision of a neighbour; 1, 3, 5, … from farthest beliefs in each
    orthant; 2, 4, 6, … from beliefs of freed rows. With one way for all, 1 of 800 decisions over three states loses 7 %."""
    return 0 if source == BEST else 1 + 2 * _orthant(decoy, point) + (1 if source >= FREED else 0)


@uncounted
def _is_new(reached: Any, t: int, region: int, way: int) -> bool:
    """Mark a way into a region as tried; False where it was, or where no room is left: the search ends after this turn."""
    count = reached.n_tried[t]
    for other in range(count):
        if reached.tried[t, other, 0] == region and reached.tried[t, other, 1] == way:
            return False
    if count == reached.tried.shape[1]:
        reached.stage[t] = ENDED
        return False
    reached.tried[t, count, 0], reached.tried[t, count, 1] = region, way
    reached.n_tried[t] += 1
    return True


@uncounted
def _ask_in(turn: Any, number: int, source: int, start: int) -> None:
    """Ask for a climb in a region, from a source or a start."""
    j = turn.n_climbs[0]
    turn.region[j], turn.source[j], turn.start[j] = number, source, start
    turn.n_climbs[0] += 1


@uncounted
def _ask(regions: Any, number: int, row: int, source: int, t: int, search: Any) -> None:
    """Ask for a climb in the region beyond a row, or for that region where it is missing."""
    reached, turn = search
    other = regions.beyond[number, row]
    if other == UNKNOWN or regions.size[other] == UNKNOWN:
        j = reached.n_missing[t]
        reached.missing[t, j, 0], reached.missing[t, j, 1] = number, row
        reached.n_missing[t] += 1
    else:
        _ask_in(turn, other, source, NO_START)


@uncounted
def _ask_at_corner(regions: Any, number: int, w: Any, belief: Any, source: int, t: int, search: Any) -> None:
    """Ask for the regions beyond the rows whose multiplier or slack is zero at a decision and a belief that explains it."""
    n_states, first = belief.size, regions.n_set_rows[number]
    rows = face_of(regions, number, n_states).rows
    if has_multipliers(regions, number, n_states):
        for r in range(regions.n_observable[number]):
            if row_value(rows[n_states + r], belief, w) <= ROW_IN_REACH:
                _ask(regions, number, regions.observable[number, r], source, t, search)
    for row in range(regions.tight.shape[1]):
        if not regions.tight[number, row]:
            if row_value(rows[first], belief, w) <= ROW_IN_REACH:
                _ask(regions, number, row, source, t, search)
            first += 1


@uncounted
def _ask_for_freed(regions: Any, number: int, aim: Any, basis: Any, w: Any, t: int, search: Any) -> None:
    """Where the set of a decision is larger than a point: ask for the few tight rows that lead to the best members if freed.

    Where no member has a zero multiplier at this decision, the least multipliers at the farthest belief count instead: other
    decisions of the region may meet those rows.
    """
    _, turn = search
    n_states, n_observable, far = basis.shape[0], regions.n_observable[number], turn.decoys[FAR]
    face = face_of(regions, number, n_states)
    for r in range(n_observable):
        distance = nearest_belief(face, w, aim.point, basis, n_states + r, turn.members[r], turn.climb.distance)
        turn.values[r] = aim.sign * distance
        if not distance < np.inf:
            put(far, turn.members[r])
            turn.values[r] = -_UNMET - row_value(face.rows[n_states + r], far, w)
    put_descending(turn.values[:n_observable], turn.order)
    for j in range(min(turn.decoys.shape[0] - FREED, n_observable)):
        r = turn.order[j]
        put(turn.members[r], turn.decoys[FREED + j])
        _ask(regions, number, regions.observable[number, r], FREED + j, t, search)


@uncounted
def _ask_around(regions: Any, aim: Any, basis: Any, t: int, search: Any) -> None:
    """Ask for the neighbours of the region of largest potential not expanded yet; where there is none the search has ended."""
    reached, turn = search
    found, e = reached.optima, -1
    for other in range(reached.count[t]):
        if not reached.expanded[t, other] and (e < 0 or found.potential[t, other] > found.potential[t, e]):
            e = other
    if e < 0:
        reached.stage[t] = ENDED
        return
    n_states = basis.shape[0]
    number = reached.region[t, e]
    size, is_point = regions.size[number] + 1, regions.is_point[number]
    w, v, far = found.place[t, e, :size], found.far_place[t, e, :size], turn.decoys[FAR]
    put(found.far[t, e], far)
    decision_in(regions, number, v, turn.actions[FAR])
    put(turn.actions[FAR], turn.actions[BEST])
    is_set = aim.sign > 0.0 and not is_point
    if found.value[t, e] > -np.inf:
        nearest = turn.decoys[BEST]
        put(found.nearest[t, e], nearest)
        decision_in(regions, number, w, turn.actions[BEST])
        if not has_multipliers(regions, number, n_states):  # no tight row has one of its own
            for r in range(regions.n_observable[number]):
                _ask(regions, number, regions.observable[number, r], BEST, t, search)
        elif not is_point and not is_set:
            _ask_for_freed(regions, number, aim, basis, w, t, search)
        _ask_at_corner(regions, number, w, nearest, BEST, t, search)
    if is_set:
        _ask_at_corner(regions, number, v, far, FAR, t, search)
        if has_multipliers(regions, number, n_states):
            _ask_for_freed(regions, number, aim, basis, v, t, search)
    if reached.n_missing[t] > 0:
        return
    reached.expanded[t, e] = True
    _is_new(reached, t, number, _way(BEST, far, aim.point))
    count, turn.n_climbs[0] = turn.n_climbs[0], 0
    for j in range(count):
        region, source = turn.region[j], turn.source[j]
        if _is_new(reached, t, region, _way(source, turn.decoys[source], aim.point)):
            _ask_in(turn, region, source, NO_START)


@uncounted
def _put_starts_in_order(starts: Any, aim: Any, regions: Any, basis: Any, t: int, room: Any) -> None:
    """Bound the values that climbs may reach from the starts of a belief, and sort the starts by it, the largest first."""
    n_states, first, last = aim.point.size, starts.first[t], starts.first[t + 1]
    for s in range(first, last):
        number, decoy = starts.region[s], starts.decoys[s]
        w = room.place[: regions.size[number] + 1]
        locate(regions, number, starts.actions[s], w)
        face = face_of(regions, number, n_states)
        starts.promise[s] = starts.bonus[s]
        # Toward a target nothing is better than the target itself.
        if aim.sign > 0.0:
            distance, on_set = np.inf, not regions.is_point[number]
            if on_set:
                distance = nearest_belief(face, w, aim.point, basis, NO_ROW, room.member, room.distance)
            if not distance < np.inf:
                distance = 0.0
                for i in range(n_states):
                    distance += (decoy[i] - aim.point[i]) * (decoy[i] - aim.point[i])
                distance = np.sqrt(distance)
            if aim.price > 0.0:
                distance *= _SET_PROMISE_AT_PRICE if on_set else _PROMISE_AT_PRICE
            else:
                distance *= _PROMISE
            starts.promise[s] += distance
        if aim.price > 0.0:
            starts.promise[s] -= aim.price * (cost_at(face.curves, aim.belief, w) - aim.optimal_cost)
    put_descending(starts.promise[first:last], starts.order[first:last])


@uncounted
def _ask_for_starts(starts: Any, top: float, reached: Any, t: int, turn: Any) -> None:
    """Ask for the next starts that promise more than is found: one, then three times as many as before."""
    first, last = starts.first[t], starts.first[t + 1]
    s, room = first + reached.n_begun[t], max(1, 3 * reached.n_begun[t])
    while s < last and turn.n_climbs[0] < room:
        start = first + starts.order[s]
        if starts.promise[start] > top + POLISH:
            _ask_in(turn, starts.region[start], BEST, start)
        s += 1
    reached.n_begun[t] = s - first


@uncounted
def _plan(aim: Any, regions: Any, starts: Any, basis: Any, patience: int, t: int, search: Any) -> None:
    """Ask for the climbs of the next turn: none where regions are missing for it, and where the search has ended."""
    reached, turn = search
    turn.n_climbs[0], reached.n_missing[t] = 0, 0
    top = _largest(reached.optima.value[t], reached.count[t])
    if reached.stage[t] == AT_STARTS:
        if reached.n_begun[t] == 0:
            _put_starts_in_order(starts, aim, regions, basis, t, turn.climb)
        _ask_for_starts(starts, top, reached, t, turn)
        if turn.n_climbs[0] > 0:
            return
        reached.stage[t], reached.patience[t] = AT_NEIGHBOURS, patience
    potential = _largest(reached.optima.potential[t], reached.count[t])
    if top > reached.value_before[t] or potential > reached.potential_before[t] + POLISH:
        reached.patience[t] = patience
    reached.value_before[t], reached.potential_before[t] = top, potential
    while reached.stage[t] != ENDED and reached.patience[t] > 0 and turn.n_climbs[0] == 0 and reached.n_missing[t] == 0:
        _ask_around(regions, aim, basis, t, search)
        if reached.n_missing[t] == 0:
            reached.patience[t] -= 1
    if reached.n_missing[t] > 0:
        turn.n_climbs[0] = 0
    elif turn.n_climbs[0] == 0:
        reached.stage[t] = ENDED


@uncounted
def _begin_climb(starts: Any, belief: Any, turn: Any, j: int) -> None:
    """Where a climb of a turn begins: at a start, or where the last climbs came to rest."""
    source, start, room = turn.source[j], turn.start[j], turn.climb
    if start != NO_START:
        put(starts.decoys[start], room.begin)
        put(starts.decoys[start], room.other)
        put(starts.actions[start], room.action)
    else:
        put(turn.actions[FAR if source == FAR else BEST], room.action)
        for i in range(belief.size):
            decoy = turn.decoys[source, i]
            room.begin[i] = decoy + _INWARD[0] * (belief[i] - decoy)
            room.other[i] = decoy + _INWARD[1] * (belief[i] - decoy)


@deferred(kernel)
def search_regions(steps: Any, aims: Any, regions: Any, starts: Any, basis: Any, limits: Any, reached: Any) -> None:
    """Search for beliefs `steps` (n,) within `Limits`, each until it has ended or asks for regions that are missing."""
    # Where tight rows depend on one another, their cone of multipliers may have more facets than there are rows.
    n_rows = max(regions.tight.shape[1], regions.n_set_rows.max())
    room = _turn_room(basis.shape[0], regions.bounds[0].size, n_rows, limits)
    turn, regions, starts, reached = (
        by_reference(room),
        by_reference(regions),
        by_reference(starts),
        by_reference(reached),
    )
    search = (reached, turn)
    optima = turn.optima
    for t in steps:
        aim = aim_of(aims, t)
        while True:
            _plan(aim, regions, starts, basis, limits.patience, t, search)
            count = turn.n_climbs[0]
            if count == 0:
                break
            floor = _largest(reached.optima.value[t], reached.count[t])
            for j in range(count):
                number = turn.region[j]
                _begin_climb(starts, aim.belief, turn, j)
                climb_decoy(number, aim, regions, basis, optima, turn.climb)
                # No set is farther than its members: a region whose farthest decoy is worth less than what is known is left
                # out. Where it is worth as much it may be what is known, and the region may have other local optima.
                is_hopeless = -np.inf < optima.potential[0] < floor - MET
                if aim.sign > 0.0 and not regions.is_point[number] and not is_hopeless:
                    has_lines = _is_new(reached, t, number, _LINES)
                    search_set(number, turn, aim, floor, has_lines, regions, basis)
                orthant = 0 if regions.is_point[number] else _orthant(optima.far[0], aim.point)
                _record(reached, t, number, orthant, optima)
    release(room)


class BestStarts(NamedTuple):
    """Where searches for T beliefs begin."""

    candidate: Any  # (T,S) the candidates that are the best of their region and orthant, in order; −1 behind the last
    n_worth: Any  # (T,) how many candidates are affordable, or at a price have a positive value
    ends: Any  # (T,Q,X) the best ends of the budget, one an orthant; NaN where there is none


@deferred(kernel)
def best_starts(low: int, high: int, aims: Any, table: Any, axes: Any, n_regions: int, found: Any) -> None:
    """Fill the `BestStarts` of beliefs low..high.

    Distances are those in the directions `axes` (X,A), and orthants those of the first few. An end is where √ρ, taken as
    linear on the ray to a candidate that is too dear, meets the budget.
    """
    costs, decoys, region, places = table.costs, table.decoys, table.region, table.places
    chosen, n_worth, ends = found.candidate, found.n_worth, found.ends
    n_states, n_orthants = aims.beliefs.shape[1], ends.shape[1]
    best, which = np.empty((n_regions, n_orthants)), np.empty((n_regions, n_orthants), dtype=np.int64)
    values = np.empty(chosen.shape[1])
    far, n_signs = np.empty(n_orthants), int(np.log2(n_orthants))
    origin, home = np.empty(axes.shape[1]), np.empty(axes.shape[1])
    for t in range(low, high):
        belief, sign, limit, price = aims.beliefs[t], aims.sign, aims.limits[t], aims.prices[t]
        for c in range(origin.size):
            origin[c], home[c] = 0.0, 0.0
            for i in range(n_states):
                origin[c] += aims.points[t, i] * axes[i, c]
                home[c] += belief[i] * axes[i, c]
        best[:] = -np.inf
        which[:] = -1
        far[:] = -np.inf
        ends[t] = np.nan
        n_worth[t] = 0
        for d in range(costs.shape[0]):
            regret = -aims.optimal_costs[t]
            for i in range(n_states):
                regret += belief[i] * costs[d, i]
            orthant = 0
            for c in range(n_signs):
                orthant = 2 * orthant + (1 if places[d, c] > origin[c] else 0)
            total = 0.0
            if regret > limit:
                share = np.sqrt(limit / regret)
                for c in range(origin.size):
                    apart = home[c] + share * (places[d, c] - home[c]) - origin[c]
                    total += apart * apart
                if sign * total > far[orthant]:
                    far[orthant] = sign * total
                    for i in range(n_states):
                        ends[t, orthant, i] = belief[i] + share * (decoys[d, i] - belief[i])
                continue
            for c in range(origin.size):
                total += (origin[c] - places[d, c]) * (origin[c] - places[d, c])
            value = sign * total
            if price > 0.0:
                value = sign * np.sqrt(total) - price * regret
            n_worth[t] += price == 0.0 or value > 0.0
            if value > best[region[d], orthant]:
                best[region[d], orthant] = value
                which[region[d], orthant] = d
        _put_largest(best, which, chosen[t], values)


@uncounted
def _put_largest(best: Any, which: Any, index: Any, values: Any) -> None:
    """Fill the numbers `which` (f,o) of the largest of `best` (f,o), in order, and these `values`."""
    index[:] = -1
    values[:] = -np.inf
    last = index.size - 1
    for f in range(best.shape[0]):
        for o in range(best.shape[1]):
            if which[f, o] < 0 or not best[f, o] > values[last]:
                continue
            s = last
            while s > 0 and best[f, o] > values[s - 1]:
                values[s], index[s] = values[s - 1], index[s - 1]
                s -= 1
            values[s], index[s] = best[f, o], which[f, o]


@deferred(uncounted_kernel)
def read_actions(steps: Any, entries: Any, regions: Any, reached: Any, actions: Any) -> None:
    """Fill the decisions (n,U) of entries (n,) of beliefs (n,)."""
    for j in range(steps.size):
        t, e = steps[j], entries[j]
        number = reached.region[t, e]
        decision_in(regions, number, reached.optima.place[t, e, : regions.size[number] + 1], actions[j])
