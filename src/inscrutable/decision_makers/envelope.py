"""The best mixture of decisions at an expected regret: the upper concave envelope of (regret, privacy) points.

A linear programme has an optimum with no more atoms than rows: two, with one budget row beside Σp = 1. So the value of
the paper's eq. (12) is that of a concave envelope, and its slope is the dual variable of the budget.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.errors import SolverError
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


@dataclass(frozen=True, eq=False)
class Mixtures:
    """Per row of points: the value, its slope in the budget, and two of the points with the share of the dearer one."""

    values: Array  # (B,)
    prices: Array  # (B,)
    cheap: np.ndarray  # (B,)
    dear: np.ndarray  # (B,)
    share: Array  # (B,), of the dear column

    def rows(self, n_columns: int) -> Array:
        """Return the mixtures as rows of probabilities (B,M)."""
        rows = np.zeros((len(self.share), n_columns))
        each = np.arange(len(rows))
        np.add.at(rows, (each, self.cheap), 1.0 - self.share)
        np.add.at(rows, (each, self.dear), self.share)
        return rows


def best_mixture(regrets: Array, privacies: Array, limit: float) -> Mixture | None:
    """Return the best mixture of points (n,) at an expected regret of `limit`; None where none is affordable."""
    allowed = ~np.isneginf(privacies)
    if not (regrets[allowed] <= limit).any():
        return None
    found = best_mixtures(regrets[None], privacies[None], np.array([limit]), allowed[None])
    cheap, dear, share, price = int(found.cheap[0]), int(found.dear[0]), float(found.share[0]), float(found.prices[0])
    if cheap == dear or share <= tolerances.PROBABILITY:
        return Mixture(np.array([cheap]), np.ones(1), price)
    return Mixture(np.array([cheap, dear]), np.array([1.0 - share, share]), price)


def best_mixtures(regrets: Array, gains: Array, limits: Array, allowed: np.ndarray | None = None) -> Mixtures:
    """Return max Σ k gains with Σ k regrets ≤ limit, Σ k = 1, for every row of (B,M); each row has an affordable point.

    Between a cheap and a dear point the price is their slope; the point that is best at that price replaces one of them,
    until none is better.
    """
    if allowed is not None:
        gains = np.where(allowed, gains, -np.inf)
        regrets = np.where(allowed, regrets, np.inf)
    rows = np.arange(len(limits))
    cheap = regrets.argmin(axis=1)
    if not np.isfinite(regrets[rows, cheap]).all():
        raise SolverError("no decision is allowed for one of the beliefs, not even its optimal one")
    # Of equal gains the cheapest.
    dear = np.where(gains >= _almost(gains.max(axis=1, keepdims=True)), regrets, np.inf).argmin(axis=1)
    # Regrets relative to the limit: between points of almost equal regret the price is huge, the value at the limit is not.
    beyond = np.where(np.isfinite(regrets), regrets, 0.0) - limits[:, None]
    within = regrets[rows, dear] <= limits
    cheap = np.where(within, dear, cheap)
    prices = np.zeros(len(limits))
    values = gains[rows, dear].copy()
    left = np.flatnonzero(~within)
    while left.size:
        low, high = cheap[left], dear[left]
        run = regrets[left, high] - regrets[left, low]
        price = np.maximum((gains[left, high] - gains[left, low]) / run, 0.0)
        reduced = gains[left] - price[:, None] * beyond[left]
        best = reduced.argmax(axis=1)
        reached = gains[left, low] - price * beyond[left, low]
        # Negated, so that no number that is none goes on for ever.
        met = ~(reduced[np.arange(left.size), best] > reached + tolerances.ENVELOPE * (1.0 + np.abs(reached)))
        prices[left], values[left] = price, reached
        over = regrets[left, best] > limits[left]
        dear[left[~met & over]] = best[~met & over]
        cheap[left[~met & ~over]] = best[~met & ~over]
        left = left[~met]
    run = regrets[rows, dear] - regrets[rows, cheap]
    room = np.where(run > 0, limits - regrets[rows, cheap], 0.0)
    share = np.clip(room / np.where(run > 0, run, 1.0), 0.0, 1.0)
    return Mixtures(values, prices, cheap, dear, share)


def _almost(top: Array) -> Array:
    """What counts as equal to a largest value: by symmetry many decisions are equally private but for rounding."""
    return np.asarray(top * (1.0 - np.copysign(tolerances.ENVELOPE, top)))


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


class RatedPoints(ABC):
    """Regrets and privacies of points; a privacy is an upper bound until `refine` makes it exact, where that can matter."""

    regrets: Array
    privacies: Array
    exact: np.ndarray

    @abstractmethod
    def refine(self, place: int) -> None:
        """Make the privacy of a point exact, and that of all that are the same."""

    def settled(self, choose: Callable[[Array, Array], np.ndarray]) -> np.ndarray:
        """Return the points that `choose` selects once the privacies of all selected points are exact."""
        while True:
            chosen = choose(self.regrets, self.privacies)
            unsure = chosen[~self.exact[chosen]]
            if not unsure.size:
                return chosen
            for place in unsure:
                if not self.exact[place]:
                    self.refine(int(place))

    def mixture(self, limit: float) -> Mixture | None:
        """Return the best mixture at an expected regret of `limit`."""

        def used(regrets: Array, privacies: Array) -> np.ndarray:
            found = best_mixture(regrets, privacies, limit)
            return np.empty(0, np.int64) if found is None else found.indices

        self.settled(used)
        return best_mixture(self.regrets, self.privacies, limit)

    def falling(self, limit: float) -> Iterator[int]:
        """Yield the points of a regret of at most `limit`, the most private first, the cheapest among almost equal ones."""
        left = np.flatnonzero((self.regrets <= limit) & ~np.isneginf(self.privacies))
        while left.size:
            top = self.privacies[left].max()
            if np.isneginf(top):
                return
            equal = left[self.privacies[left] >= _almost(top)]
            place = int(equal[self.regrets[equal].argmin()])
            if self.exact[place]:
                yield place
                left = left[left != place]
            else:
                self.refine(place)

    def best(self, limit: float) -> int | None:
        """Return the most private point with a regret of at most `limit`, the cheapest among equals."""
        return next(self.falling(limit), None)
