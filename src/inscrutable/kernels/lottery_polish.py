"""From the two grid atoms of a lottery to the best two points near them, and the chord between them at the budget.

Each atom climbs its face at the price of the chord; where both lie near each other on one face the envelope touches the
frontier there, and one decision that spends the budget is climbed instead.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.climb import Aim, climb
from inscrutable.kernels.face_sets import walk_line
from inscrutable.kernels.faces import settle
from inscrutable.kernels.lotteries import NONE, curves_of, rows_of
from inscrutable.kernels.options import kernel, part
from inscrutable.kernels.set_distance import nearest_belief

POLISHED = -1


@part
def _polish(
    aim: Any, rules: Any, arena: Any, number: int, y: Any, rounds: int, line_rounds: int
) -> tuple[float, float]:
    """Climb from y on a face: regret and privacy reached; a privacy of −∞ where nothing better was found.

    The decision is kept as the face's at y, which is therefore one that determines it.
    """
    n_states, n = rules.basis.shape
    k = arena.size[number]
    curves, rows = curves_of(arena, number, n_states), rows_of(arena, number, n_states)
    m = arena.n_set_rows[number]
    w, nearest = np.empty(k + 1), np.empty(n_states)
    active = np.empty(k + m, dtype=np.bool_)
    if k >= n:
        if not climb(curves, rows, aim, rules, y, w, rounds) < np.inf:
            return 0.0, -np.inf
        distance = nearest_belief(curves, rows[:m], arena.scale[number], w, aim.point, rules, nearest, active)
    else:
        factor, room = np.empty((k, k)), np.empty((2, n_states, k))
        # Larger faces keep their candidate: their search is for single decisions.
        if k != 1 or not settle(curves, y, rules.pivot, w, factor, room[0], room[1]):
            return 0.0, -np.inf
        walk_line(curves, rows, m, arena.scale[number], aim, rules, w, -np.inf, line_rounds)
        distance = nearest_belief(curves, rows[:m], arena.scale[number], w, aim.point, rules, y, active)
        walked = w[0]
        if not settle(curves, y, rules.pivot, w, factor, room[0], room[1]) or abs(w[0] - walked) > rules.on_face:
            return 0.0, -np.inf
    if not distance < np.inf:
        return 0.0, -np.inf
    cost = 0.0
    for i in range(n_states):
        for a in range(k + 1):
            inner = 0.0
            for c in range(k + 1):
                inner += curves[i, a, c] * w[c]
            cost += 0.5 * aim.belief[i] * w[a] * inner
    return max(cost - aim.optimal_cost, 0.0), aim.sign * distance


@kernel
def best_chord(regrets: Any, privacies: Any, count: int, limit: float, gap: float) -> tuple[int, int, float]:
    """The point or chord of largest privacy at a regret of `limit`: left and right point (−1: none), and the value.

    A chord is taken where it gains more than `gap` over every single point.
    """
    left, right, best = -1, -1, -np.inf
    for a in range(count):
        if regrets[a] <= limit and privacies[a] > best:
            left, right, best = a, -1, privacies[a]
    if left >= 0:
        best += gap
    for a in range(count):
        if regrets[a] > limit or not privacies[a] > -np.inf:
            continue
        for b in range(count):
            if regrets[b] > limit and privacies[b] > privacies[a]:
                share = (limit - regrets[a]) / (regrets[b] - regrets[a])
                value = privacies[a] + share * (privacies[b] - privacies[a])
                if value > best:
                    left, right, best = a, b, value
    return left, right, best


@kernel
def polish_lotteries(
    low: int,
    high: int,
    beliefs: Any,
    points: Any,
    sign: float,
    optimal_costs: Any,
    limits: Any,
    decoys: Any,
    face: Any,
    arena: Any,
    rules: Any,
    near: float,
    gap: float,
    rounds: Any,
    found: Any,
    out: Any,
) -> None:
    """Fill the lotteries of beliefs low..high from the atoms that `search_lotteries` found.

    found: atoms (T,3), regrets, privacies. out: index (T,2) of a candidate, POLISHED, or a seed's name, face (T,2), decoys
    (T,2,X), NaN for seeds, regrets (T,2), privacies (T,2), probabilities (T,2), price (T,).
    """
    atoms, atom_regrets, atom_privacies = found
    index, faces, places, regrets, privacies, probabilities, prices = out
    n_states = beliefs.shape[1]
    spots, spot_regret, spot_privacy = np.empty((6, n_states)), np.empty(6), np.empty(6)
    spot_face, spot_index = np.empty(6, dtype=np.int64), np.empty(6, dtype=np.int64)
    for t in range(low, high):
        limit = limits[t]
        for s in range(3):
            d = atoms[t, s]
            spot_regret[s], spot_privacy[s], spot_index[s] = atom_regrets[t, s], atom_privacies[t, s], d
            spot_face[s] = face[d] if d >= 0 else -1
            for i in range(n_states):
                spots[s, i] = decoys[d, i] if d >= 0 else np.nan
        price, merged = 0.0, True
        if atoms[t, 1] == NONE:
            spot_privacy[1] = -np.inf
        else:
            price = (spot_privacy[1] - spot_privacy[0]) / (spot_regret[1] - spot_regret[0])
            merged = spot_face[0] == spot_face[1] and _square(spots[0], spots[1]) < near * near
        count = 3
        # A and B at the price of their chord unless they are one point of a concave frontier; S within the budget.
        for s in range(2 if merged else 0, 3):
            if spot_index[s] < 0 or limit <= 0.0:
                continue
            spots[count] = spots[s]
            aim = Aim(beliefs[t], points[t], sign, optimal_costs[t], np.inf, price)
            if s == 2:
                aim = Aim(beliefs[t], points[t], sign, optimal_costs[t], limit * rules.inside, 0.0)
            spot_regret[count], spot_privacy[count] = _polish(
                aim, rules, arena, spot_face[s], spots[count], rounds[0], rounds[1]
            )
            spot_face[count], spot_index[count] = spot_face[s], POLISHED
            count += 1
        left, right, _ = best_chord(spot_regret, spot_privacy, count, limit, gap)
        share = 0.0
        if right >= 0:
            run = spot_regret[right] - spot_regret[left]
            # Rounding must not carry the expected regret over the budget.
            share = max(limit * rules.inside - spot_regret[left], 0.0) / run
            price = (spot_privacy[right] - spot_privacy[left]) / run
        prices[t] = price
        probabilities[t, 0], probabilities[t, 1] = 1.0 - share, share
        for c in range(2):
            s = left if c == 0 or right < 0 else right
            index[t, c], faces[t, c], places[t, c] = spot_index[s], spot_face[s], spots[s]
            regrets[t, c], privacies[t, c] = spot_regret[s], spot_privacy[s]


@part
def _square(a: Any, b: Any) -> float:
    total = 0.0
    for i in range(a.size):
        total += (a[i] - b[i]) ** 2
    return total
