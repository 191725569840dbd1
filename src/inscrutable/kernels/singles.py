"""The most private decision for many beliefs and several budgets: candidates first, then climbs on their faces.

From the best affordable candidate of every face and orthant the face is climbed, and then the faces beyond the rows at
which the best climb ended.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.climb import Aim, climb_in, climb_sizes
from inscrutable.kernels.face_sets import afford
from inscrutable.kernels.faces import cholesky, row_slope, row_value, settle, solve_factored
from inscrutable.kernels.leaf_reading import best_candidate, bound_leaves, collect, take_best
from inscrutable.kernels.line_peaks import best_on_line
from inscrutable.kernels.lotteries import curves_of, rows_of
from inscrutable.kernels.options import bare, kernel, part
from inscrutable.kernels.prices import budget_price
from inscrutable.kernels.set_distance import cost_at, nearest_in, nearest_sizes

OPTIMAL, FOUND, UNKNOWN = 0, 1, 2
"""How a search ended: nothing better than the optimal decision, a decision on a face, or it met a face it does not know."""
_ROUNDS = 30
_STEEP = 10.0
_MOST_STARTS = 12


class Path(NamedTuple):
    """The beliefs (T,X), the point (T,X) each is judged by, and what is known about them."""

    beliefs: Any
    points: Any
    sign: float
    costs: Any  # (T,) optimal
    own: Any  # (T,) face of the optimal decision, −1: none known
    limits: Any  # (T,B)


class Numbers(NamedTuple):
    """Numbers that decide which starts are worth a climb."""

    promise: float  # how much farther than its start a climb may come to rest, away from a point
    margin: float  # how much nearer, toward one
    reach: float  # a multiplier or slack below this stopped a climb
    few: float  # with fewer affordable candidates the faces around the optimal decision are climbed as well
    gain: float  # of privacy that is not worth a climb


class Work(NamedTuple):
    """Memory of one thread."""

    least: Any  # (L,) of cost
    likely: Any  # (L,) cost at the centre
    far: Any  # (L,) ‖c − p‖
    row: Any  # (L,)
    cost: Any  # (n,) of a leaf's candidates
    away: Any  # (n,)
    best: Any  # (K,Q) quick privacy by face and orthant
    which: Any  # (K,Q)
    touched: Any  # (K·Q,) slots in use, and how many at the end
    tried: Any  # (K,) stamp
    place: Any  # (3,k+1) the best decision, a trial, the least cost
    belief: Any  # (4,X) its nearest belief, a trial's, two starts
    rows: Any  # (R,)
    active: Any  # (k+m,)
    memory: Any  # of climbs and projections: floats, integers, truth values


class Outcome(NamedTuple):
    """What is found for T beliefs and B budgets."""

    privacy: Any  # (T,B)
    regret: Any  # (T,B)
    face: Any  # (T,B)
    decoy: Any  # (T,B,X)
    price: Any  # (T,B)
    state: Any  # (T,B)
    at_rest: Any  # (T,) privacy of the optimal decision, toward a point


@bare
def _on_face(arena: Any, face: int, n_states: int) -> tuple[Any, Any]:
    """The costs (X, k+1, k+1) and rows (m, X, k+1) of a face, for bare callers: nobody counts these references."""
    k, m, first, begin = arena.size[face] + 1, arena.n_rows[face], arena.curve_at[face], arena.row_at[face]
    curves, rows = arena.curves[first : first + n_states * k * k], arena.rows[begin : begin + m * n_states * k]
    return curves.reshape((n_states, k, k)), rows.reshape((m, n_states, k))


@bare
def _copy(source: Any, target: Any) -> None:
    for i in range(target.size):
        target[i] = source[i]


@bare
def _judge(arena: Any, number: int, aim: Any, rules: Any, w: Any, member: Any, work: Any) -> float:
    """sign·distance of an affordable and explained decision of a face, and its nearest belief; else −∞."""
    n_states, m = aim.belief.size, arena.n_set_rows[number]
    curves, rows = _on_face(arena, number, n_states)
    if cost_at(curves, aim.belief, w) - aim.optimal_cost > aim.limit * (1.0 + rules.near):
        return -np.inf
    distance = nearest_in(curves, rows[:m], arena.scale[number], w, aim.point, rules, member, work.active, work.memory)
    return float(aim.sign * distance) + 0.0 if distance < np.inf else -np.inf


@bare
def _climb_face(arena: Any, number: int, aim: Any, rules: Any, y: Any, w: Any, work: Any) -> bool:
    n_states = aim.belief.size
    curves, rows = _on_face(arena, number, n_states)
    return climb_in(curves, rows, aim, rules, y, w, _ROUNDS, work.memory) < np.inf


@part
def _search_sets(arena: Any, number: int, aim: Any, rules: Any, y: Any, w: Any, work: Any) -> tuple[float, bool]:
    """The best decision of a face with larger sets, and whether this search knows how."""
    n_states, k = aim.belief.size, arena.size[number]
    curves, rows = curves_of(arena, number, n_states), rows_of(arena, number, n_states)
    factor, sides = np.empty((k, k)), np.empty((2, n_states, k))
    if not settle(curves, y, rules.pivot, w, factor, sides[0], sides[1]):
        return -np.inf, False
    value, trial, member = -np.inf, work.place[2, : k + 1], work.belief[2]
    _copy(w, trial)
    if afford(curves, rows[arena.n_set_rows[number] :], aim, rules.near, trial, w):
        value = _judge(arena, number, aim, rules, trial, member, work)
    if not value > -np.inf:
        # No belief explains it: climb toward the true belief, where the budget ends at the latest.
        nearby = Aim(aim.belief, aim.belief, -1.0, aim.optimal_cost, np.inf, _STEEP / aim.limit)
        if _climb_face(arena, number, nearby, rules, y, trial, work):
            value = _judge(arena, number, aim, rules, trial, member, work)
    _copy(trial, w)
    _copy(member, y)
    if not value > -np.inf or k == 0:
        return value, True
    if aim.sign < 0.0:
        if _climb_face(arena, number, aim, rules, member, trial, work):
            other = _judge(arena, number, aim, rules, trial, member, work)
            if other > value:
                _copy(trial, w)
                _copy(member, y)
                value = other
        return value, True
    if k > 1:
        return value, False
    m = arena.n_set_rows[number]
    return best_on_line(curves, rows, m, arena.scale[number], aim, rules, w, y, value, work.active, work.memory), True


@bare
def _search_face(
    arena: Any, number: int, aim: Any, rules: Any, least: float, y: Any, w: Any, work: Any
) -> tuple[float, bool]:
    """Climb a face from y: privacy above `least` or −∞, and whether the face was searched to the end. y becomes the
    nearest belief of the decision w (k+1,)."""
    n = rules.basis.shape[1]
    if arena.size[number] < n:
        return _search_sets(arena, number, aim, rules, y, w, work)
    if not _climb_face(arena, number, aim, rules, y, w, work):
        return -np.inf, True
    total = 0.0
    for i in range(y.size):
        total += (y[i] - aim.point[i]) ** 2
    if aim.sign > 0.0 and np.sqrt(total) <= least:
        return -np.inf, True
    # Where the costs of states are alike, more than the decoy explains the decision.
    return _judge(arena, number, aim, rules, w, y, work), True


@bare
def _improve(arena: Any, number: int, aim: Any, rules: Any, found: Any, value: Any, work: Any) -> bool:
    """Search a face from work.belief[1] and keep what is better; False where the face cannot be searched here.

    found: face, whether all was searched. value: privacy.
    """
    k = arena.size[number]
    y, w = work.belief[1], work.place[1, : k + 1]
    privacy, known = _search_face(arena, number, aim, rules, value[0], y, w, work)
    if privacy > value[0]:
        value[0], found[0] = privacy, number
        _copy(y, work.belief[0])
        _copy(w, work.place[0, : k + 1])
    return known


@bare
def _stops(arena: Any, book: Any, number: int, reach: float, w: Any, y: Any, rows_hit: Any) -> int:
    """The rows that may have stopped a climb at the decision w of a face; returns how many."""
    n_states, k = y.size, arena.size[number]
    _, rows = _on_face(arena, number, n_states)
    m, n_rows = arena.n_set_rows[number], book.tight.shape[1]
    held = 0
    for r in range(n_rows):
        held += book.tight[number, r]
    everything = k < n_states - 1 or m - n_states != held
    count, at_tight, at_loose = 0, n_states, m
    for r in range(n_rows):
        if book.tight[number, r]:
            if everything or row_value(rows[at_tight], y, w) <= reach:
                rows_hit[count] = r
                count += 1
            at_tight += 1
        else:
            if row_value(rows[at_loose], y, w) <= reach:
                rows_hit[count] = r
                count += 1
            at_loose += 1
    return count


@bare
def _improve_beyond(
    arena: Any, book: Any, numbers: Any, stamp: int, aim: Any, rules: Any, found: Any, value: Any, work: Any
) -> bool:
    """Search the faces beyond the rows that stopped the best climb, as long as that helps; False: one is not known."""
    rows_hit, start = work.rows, work.belief[3]
    known = True
    while found[0] >= 0:
        number = found[0]
        work.tried[number] = stamp
        place, before = work.place[0, : arena.size[number] + 1], value[0]
        _copy(work.belief[0], start)
        for c in range(_stops(arena, book, number, numbers.reach, place, start, rows_hit)):
            other = book.beyond[number, rows_hit[c]]
            if other < 0:
                known = False
            elif work.tried[other] != stamp:
                work.tried[other] = stamp
                _copy(start, work.belief[1])
                known = _improve(arena, other, aim, rules, found, value, work) and known
        if value[0] == before:
            break
    return known


@part
def _own_bend(arena: Any, number: int, belief: Any, rules: Any, bend: Any, w: Any, slopes: Any) -> bool:
    """At the true belief on the optimal decision's face: the regret's curvature in reduced coordinates."""
    n_states, n = rules.basis.shape
    k = arena.size[number]
    factor, gradients = np.empty((k, k)), np.empty((n_states, k))
    curves = curves_of(arena, number, n_states)
    if not settle(curves, belief, rules.pivot, w, factor, gradients, slopes):
        return False
    for c in range(n):
        for e in range(n):
            bend[c, e] = 0.0
            for a in range(k):
                left, right = 0.0, 0.0
                for i in range(n_states):
                    left += rules.basis[i, c] * slopes[i, a]
                    right += rules.basis[i, e] * gradients[i, a]
                bend[c, e] += left * right
    return True


@bare
def _step_inside(belief: Any, basis: Any, step: Any, share: float, out: Any) -> None:
    """out = belief + basis step, the step cut to `share` and to the simplex."""
    room = share
    for i in range(belief.size):
        along = 0.0
        for c in range(step.size):
            along += basis[i, c] * step[c]
        out[i] = along
        if along < 0.0:
            room = min(room, -0.999 * belief[i] / along)
    for i in range(belief.size):
        out[i] = belief[i] + room * out[i]


@part
def _improve_around(
    arena: Any, book: Any, numbers: Any, own: int, few: bool, aim: Any, rules: Any, found: Any, value: Any, work: Any
) -> bool:
    """Climb the optimal decision's face from the ends of the affordable ellipsoid's axes and, where candidates are few,
    the faces beyond the rows that the ellipsoid meets; False where one is not known."""
    n_states, n = rules.basis.shape
    k = arena.size[own]
    if k < n:
        return True
    bend, w, slopes = np.empty((n, n)), np.empty(k + 1), np.empty((n_states, k))
    if not _own_bend(arena, own, aim.belief, rules, bend, w, slopes):
        return False
    sizes, axes = np.linalg.eigh(bend)
    step, known = np.empty(n), True
    for c in range(n):
        length = np.sqrt(2.0 * aim.limit / max(sizes[c], 1e-14 * max(sizes[n - 1], 1e-300)))
        for side in range(2):
            for e in range(n):
                step[e] = axes[e, c] * (1.0 - 2.0 * side)
            _step_inside(aim.belief, rules.basis, step, length, work.belief[1])
            total = 0.0
            for i in range(n_states):
                total += (work.belief[1, i] - aim.point[i]) ** 2
            if c == 0 or aim.sign < 0.0 or numbers.promise * np.sqrt(total) > value[0]:
                known = _improve(arena, own, aim, rules, found, value, work) and known
    if not few:
        return known
    if not cholesky(bend, n, 1e-13):
        return False
    rows, slope, lean = rows_of(arena, own, n_states), np.empty(n_states), np.empty(n)
    at_tight, at_loose = n_states, arena.n_set_rows[own]
    for r in range(book.tight.shape[1]):
        at = at_tight if book.tight[own, r] else at_loose
        at_tight += book.tight[own, r]
        at_loose += not book.tight[own, r]
        row_slope(rows[at], aim.belief, w, slopes, slope)
        for c in range(n):
            lean[c] = 0.0
            for i in range(n_states):
                lean[c] += rules.basis[i, c] * slope[i]
            step[c] = -lean[c]
        solve_factored(bend, n, step)
        fall, height = 0.0, max(row_value(rows[at], aim.belief, w), 0.0)
        for c in range(n):
            fall -= lean[c] * step[c]
        # The cheapest way to the row costs ½ height²/fall.
        if not fall > 0.0 or 0.5 * height * height > 1.5 * fall * aim.limit:
            continue
        other = book.beyond[own, r]
        if other < 0:
            known = False
            continue
        _step_inside(aim.belief, rules.basis, step, height / fall, work.belief[1])
        known = _improve(arena, other, aim, rules, found, value, work) and known
    return known


@bare
def _improve_leaving(arena: Any, book: Any, own: int, aim: Any, rules: Any, found: Any, value: Any, work: Any) -> bool:
    """Where many beliefs share the optimal decision: the faces on which another decision begins."""
    if arena.size[own] >= rules.basis.shape[1]:
        return True
    known = True
    for r in range(book.tight.shape[1]):
        if book.tight[own, r]:
            other = book.beyond[own, r]
            _copy(aim.belief, work.belief[1])
            known = other >= 0 and _improve(arena, other, aim, rules, found, value, work) and known
    return known


@part
def _search(
    arena: Any, book: Any, numbers: Any, own: int, stamp: int, aim: Any, rules: Any, found: Any, value: Any, work: Any
) -> bool:
    """The best decision for one belief and budget, into `found`, `value` and `work`; False where it needs more faces."""
    n_states = aim.belief.size
    most = aim.optimal_cost + aim.limit
    found[0], value[0] = -1, -np.inf
    known = True
    d = best_candidate(book, aim.belief, aim.point, aim.sign, most, work)
    if d >= 0:
        for i in range(n_states):
            work.belief[1, i] = book.decoys[i, d]
        known = _improve(arena, book.face[d], aim, rules, found, value, work)
        floor = value[0] / numbers.promise if aim.sign > 0.0 else min(value[0] - numbers.margin, -numbers.margin)
        used = collect(book, rules.basis, aim.belief, aim.point, aim.sign, most, floor, work)
        for _ in range(_MOST_STARTS):
            other = take_best(work, used)
            if other < 0:
                break
            total = 0.0
            for i in range(n_states):
                work.belief[1, i] = book.decoys[i, other]
                total += (work.belief[1, i] - aim.point[i]) ** 2
            if other == d or (aim.sign > 0.0 and numbers.promise * np.sqrt(total) <= value[0] + numbers.gain):
                continue
            known = _improve(arena, book.face[other], aim, rules, found, value, work) and known
        while take_best(work, used) >= 0:
            pass
    count = 0
    for leaf in range(work.likely.size):
        if work.likely[leaf] <= most:
            count += book.first[leaf + 1] - book.first[leaf]
    few = count < numbers.few * n_states
    if few or n_states > 3:
        known = _improve_around(arena, book, numbers, own, few, aim, rules, found, value, work) and known
    known = _improve_leaving(arena, book, own, aim, rules, found, value, work) and known
    return _improve_beyond(arena, book, numbers, stamp, aim, rules, found, value, work) and known


@part
def _privacy_at_rest(arena: Any, path: Any, t: int, rules: Any, work: Any) -> float:
    """−distance of the optimal decision's set from the point; NaN where it has no unique coordinates."""
    own, n_states = path.own[t], path.beliefs.shape[1]
    k, belief = arena.size[own], path.beliefs[t]
    w, factor, room = work.place[1, : k + 1], np.empty((k, k)), np.empty((2, n_states, k))
    curves = curves_of(arena, own, n_states)
    if not settle(curves, belief, rules.pivot, w, factor, room[0], room[1]):
        return np.nan
    aim = Aim(belief, path.points[t], path.sign, path.costs[t], np.inf, 0.0)
    value = _judge(arena, own, aim, rules, w, work.belief[1], work)
    return value if value > -np.inf else np.nan


@kernel
def search_singles(low: int, high: int, path: Any, book: Any, arena: Any, rules: Any, numbers: Any, out: Any) -> None:
    """Fill the outcome of beliefs low..high for all budgets."""
    n_states, n_leaves = book.centre.shape
    n_faces, slots, widest, biggest = book.tight.shape[0], 2 ** min(n_states - 1, 3), 1, 1
    for number in range(n_faces):
        widest = max(widest, arena.size[number] + 1)
    for leaf in range(n_leaves):
        biggest = max(biggest, book.first[leaf + 1] - book.first[leaf])
    most_rows = arena.n_rows.max() if n_faces else 0
    climbing, near = climb_sizes(n_states, widest - 1, most_rows), nearest_sizes(n_states, widest - 1, most_rows)
    memory = (
        np.empty(max(climbing[0], near[0])), np.empty(max(climbing[1], near[1]), np.int64),
        np.empty(max(climbing[2], near[2]), np.bool_),
    )  # fmt: skip
    work = Work(
        np.empty(n_leaves), np.empty(n_leaves), np.empty(n_leaves), np.empty(n_leaves), np.empty(biggest),
        np.empty(biggest), np.empty((n_faces, slots)), np.full((n_faces, slots), -1),
        np.empty(n_faces * slots, np.int64), np.zeros(n_faces, np.int64), np.empty((3, widest)), np.empty((4, n_states)),
        np.empty(book.tight.shape[1], np.int64), np.empty(widest + most_rows, np.bool_), memory,
    )  # fmt: skip
    found, value, stamp = np.empty(1, np.int64), np.empty(1), 0
    for t in range(low, high):
        bound_leaves(book, path.beliefs[t], path.points[t], work)
        if path.sign < 0.0 and path.own[t] >= 0:
            out.at_rest[t] = _privacy_at_rest(arena, path, t, rules, work)
        for b in range(path.limits.shape[1]):
            limit = path.limits[t, b] * rules.inside
            out.privacy[t, b], out.regret[t, b], out.face[t, b], out.price[t, b] = -np.inf, 0.0, -1, 0.0
            out.decoy[t, b] = path.beliefs[t]
            out.state[t, b] = OPTIMAL
            if not limit > 0.0:
                continue
            if path.own[t] < 0:
                out.state[t, b] = UNKNOWN
                continue
            stamp += 1
            aim = Aim(path.beliefs[t], path.points[t], path.sign, path.costs[t], limit, 0.0)
            known = _search(arena, book, numbers, path.own[t], stamp, aim, rules, found, value, work)
            out.state[t, b] = UNKNOWN if not known else (FOUND if found[0] >= 0 else OPTIMAL)
            if found[0] < 0:
                continue
            number = found[0]
            curves, rows = curves_of(arena, number, n_states), rows_of(arena, number, n_states)
            w = work.place[0, : arena.size[number] + 1]
            out.privacy[t, b], out.face[t, b] = value[0], number
            out.decoy[t, b] = work.belief[0]
            out.regret[t, b] = max(cost_at(curves, aim.belief, w) - aim.optimal_cost, 0.0)
            out.price[t, b] = budget_price(
                curves,
                rows,
                arena.n_set_rows[number],
                arena.scale[number],
                aim,
                rules,
                numbers.reach,
                work.belief[0],
                w,
            )
