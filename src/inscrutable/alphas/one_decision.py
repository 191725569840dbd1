"""One decision against the aware observer: the least mutual information, or the largest error, at an expected regret.

Θ weighs errors by their cost: deciding for m̂ instead of m costs (m̂ − m)'Θ(m̂ − m) more. With m ~ N(m̄, S), S = T T',
every rule leaves some E = T X T', 0 ⪯ X ⪯ I, at an expected regret of at least tr(T'ΘT X), and the Gaussian one attains it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from inscrutable import tolerances
from inscrutable.alphas.error_law import ErrorLaw, root_of, turned
from inscrutable.validation import Array

_LARGE = 500
"""Number of directions above which the dual search starts in single precision, which halves its time."""
_MOST_COARSE = 8
_MOST_PRICES, _GUESSES = 200, 12
"""Multipliers, and how many of them are guessed by a slope before the bracket is halved. Where many signals stay hidden guesses
alone crept: 19 of 400 largest errors at nine tenths of the silence regret were short, by up to 7e-5."""
_PART = 600
"""Number of coordinates that give the first multiplier; one or two full decompositions are then enough, else three to seven."""
_WINDOW = 30
"""Eigenvalues on each side of zero that estimate how many change sign with the multiplier."""


def filled(costs: Array, limit: float, counts: Array | None = None) -> Array:
    """Return the remaining shares of variance of least leakage, shape (q,): e_i = min(1, ν/λ_i) with Σ λ_i e_i = limit.

    Formula: reverse water-filling: every partly revealed direction costs the level ν.

    Args:
        costs: λ, the regret of hiding each direction completely, shape (q,), at least 0.
        limit: The regret to spend, at least 0; above the sum of the costs everything is hidden.
        counts: Multiplicity of each cost, shape (q,); None: one each.

    Source: Cover and Thomas, Elements of Information Theory (2006), theorem 10.3.3.

    Example:
        >>> filled(np.array([4.0, 2.0, 1.0, 0.5, 0.25]), 3.875).round(4).tolist()
        [0.2656, 0.5312, 1.0, 1.0, 1.0]
    """
    many = np.ones(len(costs)) if counts is None else counts
    if limit >= float(many @ costs):
        return np.ones(len(costs))
    order = np.argsort(costs)
    sorted_costs, sorted_counts = costs[order], many[order]
    whole = np.concatenate(
        [[0.0], np.cumsum(sorted_counts * sorted_costs)[:-1]]
    )  # total cost of all cheaper directions
    above = np.cumsum(sorted_counts[::-1])[::-1]
    levels = (limit - whole) / above  # ν if this and all more costly directions are partly revealed
    told = levels < sorted_costs
    if not told.any():  # the limit misses the sum by rounding alone
        return np.ones(len(costs))
    place = int(np.argmax(told))
    level = max(float(levels[place]), 0.0)
    return np.asarray(np.where(costs > level, level / np.where(costs > level, costs, 1.0), 1.0))


def least_information(theta: Array, prior_covariance: Array, limit: float, units: Array | None = None) -> ErrorLaw:
    """Return the law of fewest bits ½ log det S − ½ log det E at tr(ΘE) ≤ limit; `units` as of `root_of`."""
    root = root_of(prior_covariance, units)
    costs, turn = directions(root[0], theta)
    return turned(root, turn, filled(costs, limit))


def most_error(
    theta: Array, prior_covariance: Array, weights: Array, limit: float, units: Array | None = None
) -> ErrorLaw:
    """Return the law of largest tr(QE) at tr(ΘE) ≤ limit, and of the fewest bits among these.

    Formula: X = 1{T'(Q − μΘ)T ≻ 0}, plus a part of the null space that spends the rest of the limit. Where T'QT and T'ΘT
    commute, the directions do not depend on μ, and one decomposition is enough.

    Args:
        theta: Θ, shape (n,n).
        prior_covariance: S, shape (n,n).
        weights: Q, shape (n,n), positive semidefinite.
        limit: The regret to spend.
        units: Sizes of the signals, as of `root_of`.
    """
    root = root_of(prior_covariance, units)
    costs, gains = _inside(root[0], theta), _inside(root[0], weights)
    common = _common(costs, gains)
    if common is None:
        turn, shares = _searched(costs, gains, limit)
    else:
        turn, shares = common[0], _chosen(common[1], common[2], limit)
    return turned(root, turn, shares)


def directions(basis: Array, theta: Array) -> tuple[Array, Array]:
    """Return the regrets (q,) of hiding each direction completely, and the directions (q,q), which diagonalise T'ΘT."""
    costs, turn = np.linalg.eigh(_inside(basis, theta))
    return _without_rounding(costs), turn


def _inside(basis: Array, weights: Array) -> Array:
    diagonal = np.diag(weights)
    if np.count_nonzero(weights) == np.count_nonzero(diagonal) and (diagonal >= 0.0).all():
        rows = np.sqrt(diagonal)[:, None] * basis
        return np.asarray(rows.T @ rows)
    found = basis.T @ weights @ basis
    return np.asarray(0.5 * (found + found.T))


def _without_rounding(values: Array) -> Array:
    return np.where(values > tolerances.NO_VARIANCE * values.max(initial=0.0), values, 0.0)


def _common(costs: Array, gains: Array) -> tuple[Array, Array, Array] | None:
    """Return directions that diagonalise both matrices, and both diagonals; None where they do not commute."""
    sizes = [max(float(np.abs(each).max(initial=0.0)), np.finfo(float).tiny) for each in (costs, gains)]
    # Test commutation on one vector, which needs no product of matrices.
    some = np.cos(np.arange(len(costs)) ** 2.0)
    apart = costs @ (gains @ some) - gains @ (costs @ some)
    if np.abs(apart).max(initial=0.0) > tolerances.COMMUTING * sizes[0] * sizes[1] * max(len(costs), 1):
        return None
    # Eigenvectors of a generic weighted sum of the two.
    turn = np.linalg.eigh(costs / sizes[0] + np.sqrt(2.0) * gains / sizes[1])[1]
    found = []
    for matrix, size in zip((costs, gains), sizes, strict=True):
        turned = turn.T @ matrix @ turn
        values = np.diag(turned).copy()
        turned[np.diag_indices(len(turned))] = 0.0
        if np.abs(turned).max(initial=0.0) > tolerances.COMMUTING**0.5 * size:
            return None
        found.append(_without_rounding(values))
    return np.asarray(turn), found[0], found[1]


def _chosen(costs: Array, gains: Array, limit: float) -> Array:
    """Return the shares of known directions: those of largest gain per cost stay hidden; equal ones share the rest."""
    shares = np.zeros(len(costs))
    free = costs == 0.0
    shares[free] = 1.0
    rates = np.divide(gains, costs, out=np.zeros(len(costs)), where=~free)
    # Eigenvalues are exact to the rounding of the largest, so rates of cheap directions have fewer digits.
    rounding = len(costs) * np.finfo(float).eps * (gains.max(initial=0.0) + rates * costs.max(initial=0.0))
    spread = tolerances.TIED_RATE * rates + np.divide(rounding, costs, out=np.zeros(len(costs)), where=~free)
    left, open_ = limit, ~free
    while open_.any():
        best = rates[open_].max()
        tied = open_ & (rates + spread >= (rates - spread)[open_].max())
        spent = float(costs[tied].sum())
        if spent > left or best == 0.0:
            shares[tied] = filled(costs[tied], left)
            break
        shares[tied], left, open_ = 1.0, left - spent, open_ & ~tied
    return shares


def _searched(costs: Array, gains: Array, limit: float) -> tuple[Array, Array]:
    """Return directions and shares at the multiplier of regret that meets the limit.

    Any multiplier gives shares that spend the limit, and a bound of their loss; the search ends where the loss is negligible.
    For large matrices the search is in single precision; its multiplier is accurate enough for one decomposition in double
    precision.
    """
    if limit >= float(np.trace(costs)):
        return np.eye(len(costs)), np.ones(len(costs))
    if limit == 0.0:  # no price is high enough: what costs nothing stays hidden
        values, turn = np.linalg.eigh(costs)
        return turn, (_without_rounding(values) == 0.0).astype(float)
    price, bracket, slope = float(np.trace(gains)) / float(np.trace(costs)), (0.0, np.inf), -1.0
    if len(costs) > _LARGE:
        few = costs.astype(np.float32), gains.astype(np.float32)
        price = _price_of_part(costs, gains, limit)
        for _ in range(_MOST_COARSE):
            spent, slope = _spent(*few, price)
            price, bracket = _next_price(price, spent, slope, limit, bracket)
            if abs(spent - limit) <= tolerances.COARSELY_SPENT * limit:
                break
        bracket = (0.0, np.inf)
    for number in range(_MOST_PRICES):
        values, turn = np.linalg.eigh(gains - price * costs)
        spending = ((costs @ turn) * turn).sum(axis=0)
        worth = float(values[values > 0.0].sum()) + price * limit
        kept, tied, lost = _filled_directions(values, spending, limit, tolerances.LOST_ERROR * worth)
        value = float(values[kept].sum()) + price * limit
        if lost <= tolerances.LOST_ERROR * value or bracket[1] - bracket[0] <= tolerances.SAME_PRICE * price:
            break
        spent = float(spending[values > 0.0].sum())
        price, bracket = _next_price(price, spent, slope if number < _GUESSES else 0.0, limit, bracket)
    shares = kept.astype(float)
    if tied.any():
        within, inner = np.linalg.eigh(_inside(turn[:, tied], costs))
        turn[:, tied] = turn[:, tied] @ inner
        shares[tied] = filled(np.maximum(within, 0.0), max(limit - float(spending[kept].sum()), 0.0))
    return turn, shares


def _filled_directions(
    values: Array, spending: Array, limit: float, most: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the fully and the partly hidden directions that spend the limit, and a bound of the loss.

    Directions of least |value| change first. The last one is partly hidden, and if its value is at most `most`, with it all
    of such values.
    """
    near = min(most, np.sqrt(tolerances.SAME_PRICE) * float(np.abs(values).max())) + np.finfo(float).tiny
    kept, tied = values > 0.0, np.abs(values) <= near
    missing = limit - float(spending[kept].sum())
    order = np.argsort(np.abs(values))
    side = order[kept[order] == (missing < 0.0)]
    if not side.size:
        return kept & ~tied, tied, 0.0
    spent = np.cumsum(spending[side])
    last = min(int(np.searchsorted(spent, abs(missing))), len(side) - 1)
    whole = max(float(spending[side[last]]), float(np.finfo(float).tiny))
    part = min(1.0, 1.0 - (float(spent[last]) - abs(missing)) / whole)
    lost = float(np.abs(values[side[:last]]).sum()) + part * float(np.abs(values[side[last]]))
    kept[side[:last]] = missing > 0.0
    # Shared with directions of value zero, a larger part of a larger value would be lost.
    tied &= abs(float(values[side[last]])) <= near
    tied[side[last]] = True
    return kept & ~tied, tied, lost


def _next_price(
    price: float, spent: float, slope: float, limit: float, bracket: tuple[float, float]
) -> tuple[float, tuple[float, float]]:
    """Return the next multiplier, by the slope of log regret in log multiplier, and the bracket."""
    low, high = bracket = (price, bracket[1]) if spent > limit else (bracket[0], price)
    if spent > 0.0 and slope < 0.0:
        guess = price * float(np.exp(np.clip(np.log(max(limit / spent, tolerances.TINY)) / slope, -3.0, 3.0)))
        if low < guess < high and not abs(guess - price) > 0.5 * (high - low):
            return guess, bracket
    if np.isinf(high):
        return 4.0 * low, bracket
    return 0.5 * (low + high), bracket


def _price_of_part(costs: Array, gains: Array, limit: float) -> float:
    """Return the multiplier for a subset of the coordinates, as a cheap first guess."""
    some = np.arange(0, len(costs), -(-len(costs) // _PART))
    paid, won = (each[np.ix_(some, some)].astype(np.float32) for each in (costs, gains))
    share = limit * float(np.trace(paid)) / float(np.trace(costs))
    price, bracket = float(np.trace(won)) / float(np.trace(paid)), (0.0, np.inf)
    for _ in range(_MOST_COARSE):
        spent, slope = _spent(paid, won, price)
        price, bracket = _next_price(price, spent, slope, share, bracket)
        if abs(spent - share) <= tolerances.COARSELY_SPENT * share:
            break
    return price


def _spent(costs: NDArray[np.float32], gains: NDArray[np.float32], price: float) -> tuple[float, float]:
    """Return the regret of the directions of positive value, and the slope of its logarithm in that of the multiplier."""
    values, turn = eigh(gains - price * costs, overwrite_a=True, check_finite=False, driver="evd")
    place = int(np.searchsorted(values, 0.0))
    kept, rest = turn[:, place:], turn[:, :place]
    costing = costs @ kept
    spent = float((costing * kept).sum(axis=0, dtype=float).sum())
    least = float(np.finfo(np.float32).tiny)
    apart = values[place:, None] - values[None, :place]
    rotated = 2.0 * float(np.sum((costing.T @ rest) ** 2 / np.maximum(apart, least)))
    close = slice(max(place - _WINDOW, 0), min(place + _WINDOW, len(values)))
    near = turn[:, close]
    crossed = float((((costs @ near) * near).sum(axis=0) ** 2).sum()) / max(float(np.ptp(values[close])), least)
    return spent, -(rotated + crossed) * price / max(spent, least)
