"""Regret and privacy of many decisions under one belief, and which of them no cheaper one can match.

A privacy is ± the distance from a point to the consistent set: exact for points and segments. For larger sets it is at most the
distance to a member (sign +), or 0 (sign −).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import kernel

EMPTY, LARGER = -1, 2


@kernel
def rate(
    first: int, last: int, table: Any, belief: Any, optimal_cost: float, point: Any, sign: float, out: Any
) -> None:
    """Fill the regrets and privacies of decisions first … last − 1; −∞ where no belief explains one."""
    (costs, start, along, kind), (regrets, privacies) = table, out
    for d in range(first, last):
        cost, inner, square, total = 0.0, 0.0, 0.0, 0.0
        for i in range(belief.size):
            cost += belief[i] * costs[d, i]
            inner += (point[i] - start[d, i]) * along[d, i]
            square += along[d, i] * along[d, i]
        share = min(max(inner / square, 0.0), 1.0) if square > 0.0 else 0.0
        for i in range(belief.size):
            total += (point[i] - start[d, i] - share * along[d, i]) ** 2
        regrets[d] = max(cost - optimal_cost, 0.0)
        privacies[d] = sign * np.sqrt(total)
        if kind[d] == EMPTY:
            privacies[d] = -np.inf
        elif kind[d] == LARGER and sign < 0.0:
            privacies[d] = 0.0


@kernel
def contenders(regrets: Any, privacies: Any, kind: Any, least: float, best: Any, out: Any) -> int:
    """Fill `out` with the decisions whose privacy is above `least` and above that of all decisions of known privacy in
    cheaper bins; returns how many. `best` (B,) is room for the bins, whose width grows with the root of the regret.
    """
    bins = best.size
    most = 0.0
    for d in range(regrets.size):
        most = max(most, regrets[d])
    scale = (bins - 1) / np.sqrt(most) if most > 0.0 else 0.0
    best[:] = -np.inf
    for d in range(regrets.size):
        if kind[d] < LARGER:
            place = int(np.sqrt(regrets[d]) * scale)
            best[place] = max(best[place], privacies[d])
    before = least
    for place in range(bins):
        here = best[place]
        best[place] = before
        before = max(before, here)
    count = 0
    for d in range(regrets.size):
        value = privacies[d]
        if value > -np.inf and (regrets[d] == 0.0 or value > best[int(np.sqrt(regrets[d]) * scale)]):
            out[count] = d
            count += 1
    return count
