"""The best decisions of critical regions by local search from their starts, each climb independent.

Where the consistent sets of a region are single beliefs, the search varies the decoy. Where they are larger, the search over
decoys finds a decision that some belief explains; from there the search follows the gradient of the distance to the set, for
the privacy is the least distance of all beliefs of the set. Toward a point the search over decoys is enough: the least
distance to a set is the least to any of its members.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.borders import climb_border, is_on_border
from inscrutable.kernels.climb import MET, Aim, climb
from inscrutable.kernels.copies import put
from inscrutable.kernels.face_ascent import ascend
from inscrutable.kernels.face_sets import is_allowed, look_around, move_to_cheapest
from inscrutable.kernels.faces import cost_at
from inscrutable.kernels.options import inlined, internal, uncounted
from inscrutable.kernels.regions import face_of, locate
from inscrutable.kernels.set_distance import NO_ROW, distance_room, nearest_belief
from inscrutable.tolerances import BUDGET_SAFETY, ROW_IN_REACH

_STARTS = 2
"""Ends of lines from which a set's slopes are followed, besides the best decision so far. With one, 2 of 600 decisions over two
to seven states lose up to 10 %; with four one gains 30 %."""


class Aims(NamedTuple):
    """The objectives of T beliefs: sign·distance from a point, under a budget or at a price."""

    beliefs: Any  # (T,X)
    optimal: Any  # (T,U) decisions of least cost
    points: Any  # (T,X)
    sign: float
    optimal_costs: Any  # (T,)
    limits: Any  # (T,) infinite where a price is set
    prices: Any  # (T,) 0 where a budget is set
    rounding: Any  # (T,) of expected costs


class Optima(NamedTuple):
    """n local optima: the best decision found, and the belief found farthest from the aim's point with its decision."""

    value: Any  # (n,) Ψ − μρ of the best decision at the price μ, Ψ under a budget; −∞ where none was found
    privacy: Any  # (n,) Ψ, sign × distance
    regret: Any  # (n,) ρ
    price: Any  # (n,) μ: dΨ/dρ at the end of the budget, 0 where budget is left over
    nearest: Any  # (n,X) the consistent belief nearest to the aim's point
    place: Any  # (n,M) w = (v, 1) in the first k+1 entries
    potential: Any  # (n,) the value if `far` alone explained its decision; −∞ where none was found
    far: Any  # (n,X)
    far_place: Any  # (n,M)


class ClimbRoom(NamedTuple):
    """Where a climb begins, and memory for it."""

    begin: Any  # (X,)
    other: Any  # (X,) where it begins again if that leads to no decision, where it differs
    action: Any  # (U,)
    place: Any  # (M,)
    decoy: Any  # (X,)
    member: Any  # (X,)
    distance: Any


@internal
def climb_room(n_states: int, n_actions: int, n_rows: int) -> ClimbRoom:
    """Return memory for climbs in a problem."""
    return ClimbRoom(
        np.empty(n_states), np.empty(n_states), np.empty(n_actions), np.empty(n_actions + 1), np.empty(n_states),
        np.empty(n_states), distance_room(n_states, n_actions, n_states + n_rows),
    )  # fmt: skip


@inlined
def aim_of(aims: Any, t: int) -> Aim:
    """The objective of belief t; a little of its budget is left, so that rounding cannot exceed it."""
    limit, rounding = aims.limits[t], aims.rounding[t]
    unit = max(limit, rounding / MET)
    if limit < np.inf:
        limit -= max(BUDGET_SAFETY * limit, 2.0 * rounding)
    return Aim(aims.beliefs[t], aims.points[t], aims.sign, aims.optimal_costs[t], limit, aims.prices[t], unit)


@uncounted
def _keep(face: Any, aim: Any, basis: Any, trial: Any, weight: float, optima: Any, room: Any) -> None:
    """Take over a trial that a belief explains, if it is admissible, affordable and better.

    `weight` is the budget's multiplier for ½Ψ², Ψ times the price; it is zero where budget is left over.
    """
    if not is_allowed(face, aim, trial):
        return
    distance = nearest_belief(face, trial, aim.point, basis, NO_ROW, room.member, room.distance)
    if not distance < np.inf:
        return
    regret = cost_at(face.curves, aim.belief, trial) - aim.optimal_cost
    value = aim.sign * distance
    if aim.price > 0.0:
        value -= aim.price * regret
    if value > optima.value[0]:
        put(trial, optima.place[0])
        put(room.member, optima.nearest[0])
        optima.value[0], optima.privacy[0], optima.regret[0] = value, aim.sign * distance + 0.0, max(regret, 0.0)
        optima.price[0] = aim.price
        if aim.limit < np.inf:
            is_spent = aim.limit - regret <= ROW_IN_REACH * aim.limit and distance > 0.0
            optima.price[0] = max(weight, 0.0) / distance if is_spent else 0.0


@internal
def climb_decoy(number: int, aim: Any, regions: Any, basis: Any, optima: Any, room: Any) -> None:
    """Fill the optimum of a climb from its decoy in a region; the value is −∞ where no decoy is admissible."""
    y = room.decoy
    face, w = face_of(regions, number, basis.shape[0]), room.place[: regions.size[number] + 1]
    optima.value[0], optima.potential[0] = -np.inf, -np.inf
    put(room.begin, y)
    put(room.begin, optima.far[0])
    loss, weight = climb(face, aim, basis, y, w)
    if not loss < np.inf and np.any(room.other != room.begin):
        put(room.other, y)
        loss, weight = climb(face, aim, basis, y, w)
    if loss < np.inf:
        _keep(face, aim, basis, w, weight, optima, room)
        put(y, optima.far[0])
        put(w, optima.far_place[0])
        # Where states cost alike, other beliefs than the decoy explain the decision: the distance to the set counts.
        optima.potential[0] = optima.value[0]
        if not regions.is_point[number]:
            optima.potential[0] = -loss
            if aim.limit < np.inf:  # the loss is −sign ½‖y − p‖²
                optima.potential[0] = aim.sign * np.sqrt(max(-2.0 * aim.sign * loss, 0.0))


@internal
def search_set(number: int, turn: Any, aim: Any, floor: float, has_lines: bool, regions: Any, basis: Any) -> None:
    """Improve the optimum of the last climb of a turn, in a region with sets larger than points.

    `floor` is the best value known. The ascent starts at the best ends of lines through the cheapest decision, if there are to
    be lines, at the decision that the climb was given, and at the best so far. Lines through the best so far instead: of 1,344
    decisions and as many lotteries over three to six states 18 lose up to 33 %, and 31 gain up to 19 %.
    """
    optima, room = turn.optima, turn.climb
    k = regions.size[number]
    face, best, given = face_of(regions, number, basis.shape[0]), np.empty(k + 1), np.empty(k + 1)
    locate(regions, number, room.action, given)
    _keep(face, aim, basis, given, 0.0, optima, room)
    if k == 0:
        return
    put(given, best)
    member = room.begin.copy()
    if optima.value[0] > -np.inf:
        put(optima.place[0, : k + 1], best)
        put(optima.nearest[0], member)
    is_given, centre = bool(np.any(given != best)), best.copy()
    found, n_found = np.empty((_STARTS, k + 1)), 0
    if has_lines:
        move_to_cheapest(face, aim, centre)
        n_found = look_around(face, aim, basis, centre, optima.value[0], found, room.distance)
    rows = _with_equalities(face)
    for e in range(n_found + 1 + is_given):
        trial, y = best.copy(), member.copy()
        if e < n_found:
            put(found[e], trial)
        elif e > n_found:
            put(given, trial)
        # Where no belief explains the start, the climb moves it and the known member together.
        nearest_belief(face, trial, aim.point, basis, NO_ROW, y, room.distance)
        # From the boundary inward, and from inside to a boundary and along it.
        for _ in range(2):
            was_on_border = is_on_border(y, k)
            if was_on_border:
                weight = climb_border(face, aim, basis, y, trial, room)
                _keep(face, aim, basis, trial, weight, optima, room)
            known = max(floor, optima.value[0])
            value, weight = ascend(face, rows, aim, basis, trial, y, known, room.distance)
            if value > -np.inf:
                _keep(face, aim, basis, trial, weight, optima, room)
            if was_on_border or not is_on_border(y, k):
                break


@internal
def _with_equalities(face: Any) -> Any:
    """The rows of a region behind the k equalities of stationarity, at the size of the gradients."""
    curves, rows, _, scale = face
    n_states, k, m = curves.shape[0], curves.shape[1] - 1, rows.shape[0]
    held = np.empty((k + m, n_states, k + 1))
    for i in range(n_states):
        for c in range(k + 1):
            for a in range(k):
                held[a, i, c] = curves[i, a, c] / scale
            for r in range(m):
                held[k + r, i, c] = rows[r, i, c]
    return held
