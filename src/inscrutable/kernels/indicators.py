"""The cheapest decision that meets a goal, for many beliefs: one scan each, without an array of beliefs × decisions.

A decision's consistent set is empty, a point, a segment from `start` to `start + along`, or larger. By rule it meets the goal

    BY_EMPTINESS   where it is empty (a),
    BY_CORNERS     where max(‖start − π‖∞, ‖end − π‖∞) > least (b),
    BY_DISTANCE    where min_s ‖π − start − s·along‖ ≥ least, or it is empty (c);

of a larger set only `start`, a member, is known: the caller judges it, as soon as such a decision is the cheapest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import internal, kernel

EMPTY, LARGER, NEVER = -1, 2, 3
BY_EMPTINESS, BY_CORNERS, BY_DISTANCE = 0, 1, 2


@internal
def _meets(start: Any, along: Any, kind: int, belief: Any, rule: int, least: float) -> bool:
    if kind == EMPTY or rule == BY_EMPTINESS:
        return kind == EMPTY and rule != BY_CORNERS
    if rule == BY_CORNERS:
        apart = 0.0
        for i in range(belief.size):
            first = start[i] - belief[i]
            apart = max(apart, abs(first), abs(first + along[i]))
        return bool(kind == LARGER or apart > least)
    inner, square = 0.0, 0.0
    for i in range(belief.size):
        inner += (belief[i] - start[i]) * along[i]
        square += along[i] * along[i]
    share = min(max(inner / square, 0.0), 1.0) if square > 0.0 else 0.0
    total = 0.0
    for i in range(belief.size):
        total += (belief[i] - start[i] - share * along[i]) ** 2
    return bool(np.sqrt(total) >= least)


@kernel
def cheapest_that_meet(table: Any, kind: Any, goal: tuple[int, float], asked: Any, answer: Any) -> None:
    """Fill, for beliefs (T,X), the decision (−1: none) of least regret up to the limit, the first of equals.

    table: (costs (D,X), start, along); goal: (rule, least); asked: (beliefs (T,X), optimal costs, limits, floors (T,));
    answer: (decisions, regrets (T,)). Only those count that come after the answer given at the regret `floors` in the order of
    (regret, number).
    """
    (costs, start, along), (rule, least), (beliefs, optimal_costs, limits, floors) = table, goal, asked
    found, regrets = answer
    for t in range(beliefs.shape[0]):
        best, which = np.inf, -1
        for d in range(costs.shape[0]):
            cost = 0.0
            for i in range(costs.shape[1]):
                cost += beliefs[t, i] * costs[d, i]
            regret = max(cost - optimal_costs[t], 0.0)
            if regret > limits[t] or regret >= best or kind[d] == NEVER:
                continue
            if regret < floors[t] or (regret == floors[t] and d <= found[t]):
                continue
            if _meets(start[d], along[d], kind[d], beliefs[t], rule, least):
                best, which = regret, d
        found[t], regrets[t] = which, best
