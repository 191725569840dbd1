"""One step of a sequential rule by column generation: which decisions have positive probability, and their law.

The saddle point of `sequential_saddle` on the active decisions; any other enters where log c_m > 0 at the estimate that
minimises it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable import tolerances
from inscrutable.kernels.copies import put, put_at_least, put_rows
from inscrutable.kernels.faces import solve_factored
from inscrutable.kernels.options import inlined, integer, internal, kernel, uncounted
from inscrutable.kernels.sequential_estimates import StepData, longest, own_curve
from inscrutable.kernels.sequential_saddle import (
    Point,
    factored,
    gain_at,
    least_gain,
    moments,
    remaining_logs,
    room_for_point,
    saddle_value,
    settled,
)

_KEPT, _SOLVED, _RARELY = tolerances.KEPT_DECISION, tolerances.SOLVED_STEP, tolerances.RETURNING_LAW
_RESIDUAL, _BACK = tolerances.LAW_RESIDUAL, tolerances.RETURNING_LAW
_NEW = tolerances.NEW_DECISION
_ROUNDS, _PRICING_STEPS = 1000, integer(30)  # three to six, and three, are usual; for information alone up to hundreds
_NO_DECISION = integer(-1)
_MOST_ADDED = 3  # decisions that enter at once; a fourth one costs more in Newton's steps than it saves in rounds
_APART = 0.01  # share of the law's variance by which the estimates of decisions that enter at once must differ
_RATIO = 0.25  # factor from one price of information to the next in the continuation to a small one
_LOWER = 0.1  # factor from one barrier of mixed answers to the next
_WAYS = 4  # continuations from ever larger prices of information, where Newton's steps stall: one step in a thousand small ones


@internal
def _guesses(weights: Any, data: StepData, price: float, columns: Any, point: Point, estimates: Any) -> None:
    """Estimates after every decision, to first order from the active one of the nearest slopes.

    The least log c_m is Λ(θ) + h(μ)/λ, with Λ the cumulants of p/z and θ = (2 μ + slope)/λ, so that ∇h(μ) = −2 ∇Λ(θ).
    """
    n, count = point.ratios.shape
    d = data.points.shape[0]
    factors, mean, spread, right = np.empty((n, d, d)), np.empty(d), np.empty((d, d)), np.empty(d)
    curves, turn, step = np.empty((n, d, d)), np.empty(d), np.empty(d)
    farthest = 0.0
    for b in range(count):
        square = 0.0
        for i in range(d):
            square += data.points[i, b] ** 2
        farthest = max(farthest, square)
    for k in range(n):
        moments(weights * point.ratios[k] / (weights @ point.ratios[k]), data.points, mean, spread)
        own_curve(data, point.estimates[k], curves[k])
        for i in range(d):
            for j in range(i + 1):
                spread[i, j] += 0.25 * price * curves[k, i, j]
        factored(spread, factors[k], d)
    for m in range(len(estimates)):
        nearest, least = 0, np.inf
        for k in range(n):
            apart = 0.0
            for i in range(d):
                apart += (data.slopes[m, i] - data.slopes[columns[k], i]) ** 2
            if apart < least:
                nearest, least = k, apart
        for i in range(d):
            turn[i] = right[i] = 0.5 * (data.slopes[m, i] - data.slopes[columns[nearest], i])
        solve_factored(factors[nearest], d, right)
        square = 0.0
        for i in range(d):
            step[i] = -turn[i]
            for j in range(d):
                step[i] += 0.25 * price * curves[nearest, i, j] * right[j]
            square += (point.estimates[nearest, i] + step[i]) ** 2
        length = longest(data, point.estimates[nearest], step)
        if square > farthest and data.width == 0:  # estimates are means of the points
            length = 0.0
        for i in range(d):
            estimates[m, i] = point.estimates[nearest, i] + length * step[i]


@internal
def _joining(logs: Any, data: StepData, price: float, gains: Any, estimates: Any, apart: float) -> Any:
    """Decisions that could enter, the largest gain first, with different estimates; updates `gains`."""
    added, near = np.empty(_MOST_ADDED, np.int64), np.zeros(gains.size, np.bool_)
    count = 0
    while count < _MOST_ADDED:
        best = _NO_DECISION
        for m in range(gains.size):
            if gains[m] > _SOLVED and not near[m] and (best < 0 or gains[m] > gains[best]):
                best = m
        if best < 0:
            break
        gains[best] = least_gain(logs, data, price, best, estimates[best], _PRICING_STEPS, 0.3 * _SOLVED)
        if not gains[best] > _SOLVED:
            continue
        added[count] = best
        count += 1
        for m in range(gains.size):
            square = 0.0
            for i in range(estimates.shape[1]):
                square += (estimates[m, i] - estimates[best, i]) ** 2
            near[m] = near[m] or m == best or (square < apart and estimates.shape[1] > 0)
    return added[:count]


@internal
def _priced(weights: Any, data: StepData, price: float, columns: Any, point: Point, gains: Any, estimates: Any) -> Any:
    """log c of all decisions, or an upper bound of at most 0, and those that enter.

    Decisions with a gain in the last pricing come first; all are priced only where none of them is left.
    """
    d, count = data.points.shape
    logs, powers, mean, apart = np.empty(count), np.empty(count), np.zeros(d), 0.0
    remaining_logs(weights, point, logs)
    for b in range(count):
        for i in range(d):
            mean[i] += weights[b] * data.points[i, b]
            apart += weights[b] * data.points[i, b] ** 2
    for i in range(d):
        apart -= mean[i] ** 2
    if data.width > 0:  # of shares, which add up to one
        apart = 1.0
    known = estimates.copy()
    _guesses(weights, data, price, columns, point, estimates)
    for whole in range(2):
        for m in range(gains.size):
            if whole == 1 or gains[m] > _SOLVED:
                gains[m] = gain_at(logs, data, price, m, estimates[m], powers)
                # Near a wrong answer Newton's steps stall at a small barrier: the last estimate may be the better start.
                before = gain_at(logs, data, price, m, known[m], powers) if data.width > 0 else np.inf
                if before < gains[m]:
                    gains[m] = before
                    put(known[m], estimates[m])
        for k in range(columns.size):
            gains[columns[k]] = 0.0
        added = _joining(logs, data, price, gains, estimates, _APART * apart)
        if added.size:
            break
    return added


@internal
def _covering(weights: Any, data: StepData) -> Any:
    """The decision of least mean regret; where caps forbid it to some beliefs, more decisions until each belief has one."""
    n_columns, count = data.values.shape
    open_rows, chosen, found = weights > 0.0, np.empty(n_columns, np.int64), 0
    while True:
        best, reach, most = -1, 0.0, -np.inf
        for m in range(n_columns):
            total, value = 0.0, 0.0
            for b in range(count):
                if open_rows[b] and data.values[m, b] > -np.inf:
                    total += weights[b]
                    value += weights[b] * data.values[m, b]
            if total > reach * (1.0 + _BACK) or (total >= reach * (1.0 - _BACK) and value > most):
                best, reach, most = m, total, value
        if best < 0 or not reach > 0.0:
            return chosen[:found]
        chosen[found] = best
        found += 1
        left = False
        for b in range(count):
            open_rows[b] = open_rows[b] and data.values[best, b] == -np.inf
            left = left or open_rows[b]
        if not left:
            return chosen[:found]


@internal
def _joined(columns: Any, point: Point, added: Any, gains: Any, estimates: Any) -> Any:
    """The active decisions with those that enter, and room for their law and estimates."""
    kept = np.flatnonzero(point.law > _RARELY)
    n = kept.size + added.size
    longer, both = room_for_point(n, point.estimates.shape[1], point.held.size), np.empty(n, np.int64)
    for k in range(kept.size):
        both[k], longer.law[k] = columns[kept[k]], point.law[kept[k]]
        put(point.estimates[kept[k]], longer.estimates[k])
    for k in range(added.size):
        m, place = added[k], kept.size + k
        both[place], longer.law[place] = m, max(_NEW * np.exp(-max(gains[m], 0.0)), _BACK)
        put(estimates[m], longer.estimates[place])
    return both, longer


@internal
def _at_price(
    weights: Any, data: StepData, price: float, columns: Any, point: Point, gains: Any, estimates: Any, work: Any
) -> Any:
    """The optimal step at a price of information, from some decisions: which are active, their law, and the largest log c.

    `gains` and `estimates` of all decisions tell which are priced first.
    """
    worst = np.inf
    for _ in range(_ROUNDS):
        added = _priced(weights, data, price, columns, point, gains, estimates)
        worst = max(gains.max(), 0.0)
        work[0] -= gains.size * data.points.shape[0] ** 2 * (weights.size + data.points.shape[0])
        if not added.size or work[0] < 0.0:
            break
        columns, point = _joined(columns, point, added, gains, estimates)
        point = settled(weights, data, price, columns, point, work)
        nothing = np.empty(0, np.int64)
        columns, smaller = _joined(columns, point, nothing, gains, estimates)
        saddle_value(weights, data, price, columns, smaller)
        point = smaller
    return columns, point, worst


@uncounted
def _is_tied(weights: Any, data: StepData, kept: int, best: int) -> bool:
    """Whether two decisions cost the same on average, to rounding; not where a cap forbids the first to some belief."""
    apart, size = 0.0, 0.0
    for b in range(weights.size):
        if weights[b] > 0.0:
            if data.values[kept, b] == -np.inf:
                return False
            apart += weights[b] * (data.values[kept, b] - data.values[best, b])
            size += weights[b] * (abs(data.values[kept, b]) + abs(data.values[best, b]))
    return apart >= -_RESIDUAL * size


@internal
def _copied(point: Point) -> Point:
    return Point(
        point.law.copy(),
        point.estimates.copy(),
        point.ratios.copy(),
        point.powers.copy(),
        point.held.copy(),
        point.top.copy(),
    )


@inlined
def _eased(data: StepData, barrier: float) -> StepData:
    """The data with another barrier."""
    return StepData(data.points, data.values, data.slopes, data.price, data.first_price, data.width, barrier)


@internal
def _begun(weights: Any, data: StepData, columns: Any, work: Any) -> Point:
    """Some decisions, equally likely, with the prior's estimate after each; for a rival with answers, its best mixture."""
    d, count = data.points.shape
    point = room_for_point(columns.size, d, count)
    point.law[:] = 1.0 / columns.size
    if data.width > 0:
        point.estimates[:] = 1.0 / (data.width + 1.0)
        if columns.size == 1:
            barrier = max(data.price, data.barrier)
            while True:
                point = settled(weights, _eased(data, barrier), data.price, columns, point, work)
                if barrier <= data.barrier or work[0] < 0.0:
                    return point
                barrier = max(_LOWER * barrier, data.barrier)
        return point
    for m in range(columns.size):
        for b in range(count):
            for i in range(d):
                point.estimates[m, i] += weights[b] * data.points[i, b]
    return point


@kernel
def solved_step(
    weights: Any, data: StepData, kept: int, near: Any, near_law: Any, near_estimates: Any, work: Any
) -> Any:
    """Return the decisions (n,) of positive probability, their law, the estimates after them, and the largest log c.

    First it tests whether a constant decision is optimal: `kept`, where its mean regret is the least, or the least one. Then it
    starts from the decisions `near` of a similar case, with their law and estimates, where there are any. It ends where the
    `work` (1,) allowed, in products of numbers, is done, and takes what it did from it.
    """
    d, count = data.points.shape
    gains, estimates = np.full(len(data.values), -np.inf), np.full((len(data.values), d), 1.0 / (data.width + 1.0))
    columns = _covering(weights, data)
    if columns.size == 1 and kept >= 0 and _is_tied(weights, data, kept, columns[0]):
        columns[0] = kept
    point = _begun(weights, data, columns, work)
    if columns.size == 1:
        saddle_value(weights, data, data.price, columns, point)
        _priced(weights, data, data.price, columns, point, gains, estimates)
        if gains.max() <= _KEPT:
            return columns, point.law, point.estimates, max(gains.max(), 0.0)
        if near.size:
            begun = room_for_point(near.size, d, count)
            put_at_least(_BACK, near_law, begun.law)
            put_rows(near_estimates, begun.estimates)
            begun = settled(weights, data, data.price, near, begun, work)
            start, begun, worst = _at_price(weights, data, data.price, near, begun, gains, estimates, work)
            if worst <= _KEPT:
                return start, begun.law / begun.law.sum(), begun.estimates, worst
    above = max(data.first_price / data.price, 1.0)
    for _ in range(_WAYS):
        price, barrier = above * data.price, data.barrier
        start, begun = columns, _copied(point)
        if data.width > 0:
            barrier = max(barrier, _LOWER * price)
            begun.estimates[:] = 1.0 / (data.width + 1.0)
        while True:
            eased = _eased(data, barrier)
            begun = settled(weights, eased, price, start, begun, work)
            start, begun, worst = _at_price(weights, eased, price, start, begun, gains, estimates, work)
            if (price <= data.price and barrier <= data.barrier) or work[0] < 0.0:
                break
            price, barrier = max(_RATIO * price, data.price), max(_LOWER * barrier, data.barrier)
        if worst <= _KEPT or d == 0 or work[0] < 0.0:
            break
        above /= _RATIO**2  # the continuation failed: start at a larger price
    if work[0] < 0.0:  # perhaps at a larger price
        worst = np.inf
    return start, begun.law / begun.law.sum(), begun.estimates, worst
