"""How far a budget reaches along a line of decoys whose decisions lie on one face."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.faces import cost_under, settle
from inscrutable.kernels.options import bare, kernel

_MOST_STEPS = 100
_SAME_SHARE = 1e-14  # shares of the line closer than this are one
_SPENT = 1e-13  # share of the budget that may be left unspent


@bare
def _root_excess(curves: Any, aim: Any, pivot: float, y: Any, w: Any, room: Any) -> float:
    """√ρ − √limit, which is nearly linear along a ray; not a number where the face has no unique decision."""
    factor, gradients, slopes = room
    if not settle(curves, y, pivot, w, factor, gradients, slopes):
        return np.nan
    regret = cost_under(curves, aim.belief, w, gradients) - aim.optimal_cost
    return float(np.sqrt(max(regret, 0.0)) - np.sqrt(aim.limit))


@kernel
def budget_end(curves: Any, aim: Any, pivot: float, near: Any, far: Any) -> float:
    """The largest share t for which the decision of near + t (far − near), X beliefs each, is affordable, by the
    Illinois rule. The regret must not fall along the line, `near` must be affordable and `far` not. Not a number
    where the face has no unique decision on the way."""
    k = curves.shape[1] - 1
    room = (np.empty((k, k)), np.empty((near.size, k)), np.empty((near.size, k)))
    y, w = np.empty(near.size), np.empty(k + 1)
    low, high = 0.0, 1.0
    low_value = _root_excess(curves, aim, pivot, near, w, room)
    high_value = _root_excess(curves, aim, pivot, far, w, room)
    if np.isnan(low_value + high_value):
        return np.nan
    if low_value >= 0.0:
        return 0.0
    if high_value <= 0.0:
        return 1.0
    side = 0
    for step in range(_MOST_STEPS):
        middle = low - low_value * (high - low) / (high_value - low_value)
        # Halve now and then, so that the bracket closes on a bent curve too.
        if step % 4 == 3 or not low < middle < high:
            middle = 0.5 * (low + high)
        for i in range(y.size):
            y[i] = near[i] + middle * (far[i] - near[i])
        value = _root_excess(curves, aim, pivot, y, w, room)
        if np.isnan(value):
            return np.nan
        if value > 0.0:
            high, high_value = middle, value
            low_value *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            low, low_value = middle, value
            high_value *= 0.5 if side < 0 else 1.0
            side = -1
            if value >= -_SPENT * np.sqrt(aim.limit):
                break
        if high - low <= _SAME_SHARE:
            break
    return low
