"""Making a decision maker spend a given expected regret, by the amount that it is made from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from inscrutable.experiments.setting import Behaviour, Setting, spent

SAME_SPENDING = 0.005
"""Expected regrets count as equal within this share of them: finer budgets would move no figure of a comparison."""

_MOST_TRIALS = 12


def scaled_to(setting: Setting, tried: Callable[[float], Behaviour], regret: float) -> Behaviour:
    """Return the trial whose expected regret is nearest to the one asked for, and not above it; it grows with the amount.

    Where single decisions leap over what is asked for, the trial before the leap stands.
    """
    low, high, amount = (0.0, 0.0), None, regret
    best, best_gap = None, (True, np.inf)
    for _ in range(_MOST_TRIALS):
        behaviour = tried(amount)
        found = spent(setting, behaviour)
        gap = (found > regret * (1.0 + SAME_SPENDING), abs(found - regret))
        if gap < best_gap:
            best, best_gap = behaviour, gap
        if abs(found - regret) <= SAME_SPENDING * regret:
            break
        if found < regret:
            if amount > regret and found <= low[1] * (1.0 + SAME_SPENDING):
                break  # a larger budget is not spent
            low = (amount, found)
        else:
            high = (amount, found)
        amount = _between(low, high, regret)
    assert best is not None
    return best


def _between(low: tuple[float, float], high: tuple[float, float] | None, regret: float) -> float:
    """The next amount: on the line through both ends, or as much larger as too little was spent."""
    if high is None:
        return low[0] * min(regret / low[1], 4.0) * (1.0 + 0.1 * SAME_SPENDING) if low[1] > 0 else 2.0 * low[0]
    share = (regret - low[1]) / (high[1] - low[1])
    return float(low[0] + np.clip(share, 0.05, 0.95) * (high[0] - low[0]))
