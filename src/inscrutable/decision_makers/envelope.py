"""The best mixture of decisions at an expected regret: the upper concave envelope of (regret, privacy) points.

A linear programme has an optimum with no more atoms than rows: two, with one budget row beside Σp = 1. So the value of
the paper's eq. (12) is that of a concave envelope, and its slope is the price of privacy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.linear_programmes import Rows, minimum
from inscrutable.validation import Array


class Mixture(NamedTuple):
    """Indices of the mixed points, their probabilities, and the slope of the value in the budget."""

    indices: np.ndarray
    probabilities: Array
    price: float


def undominated(regrets: Array, privacies: Array) -> np.ndarray:
    """Return the points that no cheaper point matches in privacy, by rising regret; −∞ privacy never counts."""
    finite = np.flatnonzero(np.isfinite(privacies) | np.isposinf(privacies))
    order = finite[np.lexsort((-privacies[finite], regrets[finite]))]
    if not order.size:
        return order
    best_before = np.maximum.accumulate(privacies[order])
    fresh = np.concatenate([[True], privacies[order][1:] > best_before[:-1]])
    return np.asarray(order[fresh])


def concave_envelope(regrets: Array, privacies: Array) -> np.ndarray:
    """Return the corners of the least concave, non-decreasing majorant, by rising regret."""
    chosen = undominated(regrets, privacies)
    points = list(zip(regrets[chosen].tolist(), privacies[chosen].tolist(), strict=True))
    hull: list[int] = []
    for i, point in enumerate(points):
        while len(hull) >= 2 and _not_above(points[hull[-2]], points[hull[-1]], point):
            hull.pop()
        hull.append(i)
    return np.asarray(chosen[hull])


def _not_above(first: tuple[float, float], middle: tuple[float, float], last: tuple[float, float]) -> bool:
    run, rise = last[0] - first[0], last[1] - first[1]
    return (middle[1] - first[1]) * run <= rise * (middle[0] - first[0])


def mixture_on_envelope(regrets: Array, privacies: Array, hull: np.ndarray, limit: float) -> Mixture | None:
    """Return the at most two corners that mix to the envelope's value at an expected regret of `limit`."""
    if not hull.size or regrets[hull[0]] > limit:
        return None
    right = int(np.searchsorted(regrets[hull], limit, side="right"))
    if right == hull.size:
        return Mixture(hull[-1:], np.ones(1), 0.0)
    low, high = hull[right - 1], hull[right]
    run = regrets[high] - regrets[low]
    share = float((limit - regrets[low]) / run)
    price = float((privacies[high] - privacies[low]) / run)
    if share <= tolerances.PROBABILITY:
        return Mixture(np.array([low]), np.ones(1), price)
    return Mixture(np.array([low, high]), np.array([1.0 - share, share]), price)


def mixture_by_linear_programme(regrets: Array, privacies: Array, limit: float) -> Mixture | None:
    """Return the optimal probabilities of the paper's eq. (12) by HiGHS; the price is the budget row's dual."""
    usable = np.flatnonzero(np.isfinite(privacies))
    if not usable.size or regrets[usable].min() > limit:
        return None
    scale = max(float(regrets[usable].max()), limit, np.finfo(float).tiny)
    answer = minimum(
        -privacies[usable],
        Rows(regrets[usable][None] / scale, np.array([limit / scale])),
        Rows(np.ones((1, usable.size)), np.ones(1)),
        (0, None),
    )
    kept = answer.x > tolerances.PROBABILITY
    probabilities = answer.x[kept] / answer.x[kept].sum()
    return Mixture(usable[kept], probabilities, float(-answer.duals[0] / scale))
