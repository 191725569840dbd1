"""The saddle point of one step of a sequential rule, on a few decisions.

With the law p of the belief, points x_b, values v_bm = |x_b|² − s ρ_bm and the price λ of information, rows of least regret,
least information and largest error at these prices are K_bm = q_m e^{a_bm} / z_b, a_bm = (v_bm − 2 x_b·μ_m + |μ_m|²) / λ,
z_b = Σ_m q_m e^{a_bm}, at the saddle point of

    Φ(μ) = max_{q ≥ 0} Σ_b p_b log z_b − Σ_m q_m,        min over the observer's estimates μ_m,

which is convex in μ. c_m = Σ_b p_b e^{a_bm} / z_b is 1 where q_m > 0 and at most 1 elsewhere, for the estimate that makes it
least. Without coordinates (d = 0, v = −s ρ, λ = 1) the step is the one of least information. A value of −inf forbids a place.

Where a rival has a few answers of its own, μ holds the probabilities with which it mixes them, without the last one; x_b are
half the differences between the last answer's cost and each other's under b. The barrier h(μ) = −τ Σ log of all probabilities,
τ > 0 small, replaces |μ|²: μ stays inside the simplex, and the minimiser is unique. It loses at most τ per answer.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.kernels.copies import put, put_at_least, put_rows
from inscrutable.kernels.faces import solve_factored
from inscrutable.kernels.options import fused, integer, internal, kernel, summed
from inscrutable.kernels.rounding import LEAST_SUM
from inscrutable.kernels.sequential_estimates import StepData, longest, own_cost, own_curve, own_slope
from inscrutable.tolerances import TINY

_SOLVED, _RESIDUAL = tolerances.SOLVED_STEP, tolerances.LAW_RESIDUAL
_ROUNDING, _BACK = tolerances.SADDLE_ROUNDING, tolerances.RETURNING_LAW
_LAW_STEPS, _NEWTON_STEPS = 200, 200  # five and ten are usual
_LOGIT = 3.0  # largest mean change of log K in one step, beyond which its linear model says nothing
_LARGE_GAIN = 2.0  # c above which the law is multiplied by c: Newton's steps for a logarithm only double
_FULL_STEPS = 2  # taken at the end, where rounding hides the gain
_REFRESHED = integer(3)  # Newton steps of the estimate after a decision of probability 0
_ARMIJO, _CUT, _SHORTEST = 1e-4, 0.3, 1e-9
_FLAT = 0.1  # share of the slope left where a step that was too long is cut; .01 and .9 take a quarter more evaluations
_RIDGE, _STEEPER, _TRIES = 1e-14, 100.0, 12  # share of a diagonal added to it, and how much more each time
_FINER = 1e-3  # share of a residual that counts as rounding, and of a gain that counts as none
_NONE = integer(0)
_STEEPEST = 700.0  # e^-700 has full precision, and thousands of e^700 add up to a number
_TURN, _HIGH, _LOW = (
    1.4426950408889634,
    0.693147180369123816490,
    1.90821492927058770002e-10,
)  # 1 / log 2, log 2 in two parts
_SHIFT = 6755399441055744.0  # 3 · 2^51: what is added to it is rounded to a whole number, in its last digits
_BIAS, _EXPONENT = np.int64(1023), np.int64(52)  # of a float's bits


class Point(NamedTuple):
    """A law and estimates of n decisions, and what follows from them."""

    law: Any  # q (n,)
    estimates: Any  # μ (n,d)
    ratios: Any  # e^{a} / z (n,B)
    powers: Any  # e^{a − top} (n,B)
    held: Any  # z e^{−top} (B,)
    top: Any  # (B,)


@internal
def room_for_point(n: int, d: int, count: int) -> Point:
    """An empty point of n decisions."""
    return Point(
        np.zeros(n), np.zeros((n, d)), np.empty((n, count)), np.empty((n, count)), np.empty(count), np.empty(count)
    )


@internal
def factored(matrix: Any, factor: Any, n: int) -> None:
    """factor = Cholesky factor of the first n rows, with enough added to the diagonal to make them positive definite."""
    largest = TINY
    for i in range(n):
        largest = max(largest, matrix[i, i])
    ridge = _RIDGE * largest
    for _ in range(_TRIES):
        sound = True
        for j in range(n):
            for i in range(j, n):
                total = matrix[i, j] + (ridge if i == j else 0.0)
                for k in range(j):
                    total -= factor[i, k] * factor[j, k]
                if i > j:
                    factor[i, j] = total / factor[j, j]
                elif total > 0.0:
                    factor[j, j] = np.sqrt(total)
                else:
                    sound = False
                    break
            if not sound:
                break
        if sound:
            return
        ridge *= _STEEPER
    for i in range(n):  # NaN: no factor exists
        for j in range(i + 1):
            factor[i, j] = 1.0 if i == j else 0.0


@internal
def _non_negative(hessian: Any, right: Any, free: Any, found: Any) -> None:
    """max right·y − ½ y'Hy over y ≥ 0 by principal pivoting (Júdice and Pires, 1994), `free` being the first guess."""
    n = right.size
    small, factor, part_found, where = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(n, np.int64)
    offends = np.empty(n, np.bool_)
    fewest, patience = n + 1, 3
    for _ in range(20 * n + 20):
        k = _NONE
        for i in range(n):
            if free[i]:
                where[k] = i
                k += 1
        for a in range(k):
            part_found[a] = right[where[a]]
            for b in range(a + 1):
                small[a, b] = hessian[where[a], where[b]]
        factored(small, factor, k)
        solve_factored(factor, k, part_found)
        found[:] = 0.0
        for a in range(k):
            found[where[a]] = part_found[a]
        bad, last = 0, -1
        for i in range(n):
            if free[i]:
                offends[i] = found[i] < 0.0
            else:
                slope = right[i]
                for a in range(k):
                    slope -= hessian[i, where[a]] * part_found[a]
                offends[i] = slope > _RESIDUAL
            if offends[i]:
                bad, last = bad + 1, i
        if bad == 0:
            return
        if bad < fewest:
            fewest, patience = bad, 3
        else:
            patience -= 1
        for i in range(n):
            if offends[i] and (patience >= 0 or i == last):
                free[i] = not free[i]
    for i in range(n):
        found[i] = max(found[i], 0.0)


@fused
def _powers(values: Any) -> None:
    """e^x to some 1e-15 in the place of every x, 0 below −700 and no more than e^700.

    2^k by the bits of k, and a polynomial in the rest: vectorised, it takes a ninth of the time of the library's function.
    It relies on this order of the sums.
    """
    for b in range(values.size):
        x = values[b]
        y = min(max(x, -_STEEPEST), _STEEPEST)
        shifted = y * _TURN + _SHIFT
        k = shifted - _SHIFT
        r = (y - k * _HIGH) - k * _LOW
        r2 = r * r
        r4 = r2 * r2
        low = (1.0 + r) + r2 * (1.0 / 2.0 + r * (1.0 / 6.0))
        middle = (1.0 / 24.0 + r * (1.0 / 120.0)) + r2 * (1.0 / 720.0 + r * (1.0 / 5040.0))
        high = (1.0 / 40320.0 + r * (1.0 / 362880.0)) + r2 * (1.0 / 3628800.0 + r * (1.0 / 39916800.0))
        last = r4 * (1.0 / 479001600.0 + r * (1.0 / 6227020800.0))
        scale = np.int64((np.float64(shifted).view(np.int64) + _BIAS) << _EXPONENT).view(np.float64)
        values[b] = (low + r4 * (middle + r4 * (high + last))) * scale if x > -_STEEPEST else 0.0


@summed
def _offers(data: StepData, m: int, scale: float, estimate: Any, found: Any) -> None:
    """(v_bm − 2 x_b·μ + h(μ)) · scale."""
    d, count = data.points.shape
    own, values = own_cost(data, estimate), data.values[m]
    for b in range(count):
        found[b] = (values[b] + own) * scale
    for i in range(d):
        turn, line = 2.0 * scale * estimate[i], data.points[i]
        for b in range(count):
            found[b] -= turn * line[b]


@summed
def _law_value(weights: Any, powers: Any, law: Any, held: Any) -> float:
    """Σ_b p_b log Σ_m q_m E_mb − Σ q."""
    held[:] = 0.0
    value = 0.0
    for m in range(law.size):
        if law[m] > 0.0:
            value -= law[m]
            for b in range(held.size):
                held[b] += law[m] * powers[m, b]
    for b in range(held.size):
        if weights[b] > 0.0:
            if not held[b] > 0.0:
                return -np.inf
            value += weights[b] * np.log(held[b])
        elif not held[b] > 0.0:
            held[b] = 1.0
    return value


@summed
def _gains(weights: Any, point: Point, gains: Any) -> None:
    """Ratios e^{a}/z and c_m = Σ_b p_b e^{a_bm}/z_b."""
    for m in range(gains.size):
        total, ratios, powers = 0.0, point.ratios[m], point.powers[m]
        for b in range(weights.size):
            ratios[b] = powers[b] / point.held[b]
            total += weights[b] * ratios[b]
        gains[m] = total


@summed
def _products(weights: Any, point: Point, found: Any) -> None:
    """Σ_b p_b e^{a_bm} e^{a_bk} / z_b²: minus the second derivative in the law."""
    for m in range(point.law.size):
        for k in range(m + 1):
            total, one, other = 0.0, point.ratios[m], point.ratios[k]
            for b in range(weights.size):
                total += weights[b] * one[b] * other[b]
            found[m, k] = found[k, m] = total


@internal
def _best_law(weights: Any, point: Point) -> float:
    """The law of the decisions for given estimates, by Newton's steps on those of positive probability; returns its value."""
    n, law = point.law.size, point.law
    gains, right, found, trial = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    hessian, free = np.empty((n, n)), np.empty(n, np.bool_)
    value = _law_value(weights, point.powers, law, point.held)
    for _ in range(_LAW_STEPS):
        _gains(weights, point, gains)
        broken = 0.0
        for m in range(n):
            broken = max(broken, abs(law[m] * (1.0 - gains[m])), gains[m] - 1.0)
        if broken < _RESIDUAL:
            break
        if gains.max() > _LARGE_GAIN:
            if (law < _BACK).any():  # a law of 0 stays 0 whatever it is multiplied by
                put_at_least(_BACK, law, law)
                _law_value(weights, point.powers, law, point.held)
                _gains(weights, point, gains)
            for m in range(n):
                law[m] *= gains[m]
            value = _law_value(weights, point.powers, law, point.held)
            continue
        slope = 0.0
        _products(weights, point, hessian)
        for m in range(n):
            right[m] = gains[m] - 1.0
            for k in range(n):
                right[m] += hessian[m, k] * law[k]
            free[m] = law[m] > 0.0 or gains[m] > 1.0
        _non_negative(hessian, right, free, found)
        for m in range(n):
            slope += (gains[m] - 1.0) * (found[m] - law[m])
        if slope < _RESIDUAL:  # the whole step is right to its square
            put(found, law)
            value = _law_value(weights, point.powers, law, point.held)
            _gains(weights, point, gains)
            break
        length, ahead = 1.0, -np.inf
        while length > _SHORTEST:
            for m in range(n):
                trial[m] = found[m] if length == 1.0 else law[m] + length * (found[m] - law[m])
            ahead = _law_value(weights, point.powers, trial, point.held)
            if ahead >= value + _ARMIJO * length * slope - _FINER * _RESIDUAL * abs(value):
                break
            length *= _CUT
        if length <= _SHORTEST:
            value = _law_value(weights, point.powers, law, point.held)
            _gains(weights, point, gains)
            break
        put(trial, law)
        value = ahead
    return value


@summed
def _set_powers(data: StepData, price: float, columns: Any, point: Point) -> None:
    """Powers e^{a − top} and the tops, of the point's estimates."""
    top, powers = point.top, point.powers
    top[:] = -np.inf
    for m in range(columns.size):
        row = powers[m]
        _offers(data, columns[m], 1.0 / price, point.estimates[m], row)
        for b in range(top.size):
            top[b] = max(top[b], row[b])
    for b in range(top.size):
        if top[b] == -np.inf:
            top[b] = 0.0
    for m in range(columns.size):
        row = powers[m]
        for b in range(top.size):
            row[b] -= top[b]
        _powers(row)


@internal
def saddle_value(weights: Any, data: StepData, price: float, columns: Any, point: Point) -> float:
    """Φ at the point's estimates, with the law that attains it."""
    _set_powers(data, price, columns, point)
    value = _best_law(weights, point)
    for b in range(weights.size):
        value += weights[b] * point.top[b]
    return value


@kernel
def law_of(weights: Any, data: StepData, point: Point) -> float:
    """Φ of decisions whose values v / λ (n,B) count all that the observer loses (d = 0), with the law that attains it."""
    return float(saddle_value(weights, data, 1.0, np.arange(len(data.values)), point))


@summed
def _shares(powers: Any) -> float:
    """Σ e^x, and shares of it in the place of every x."""
    whole = 0.0
    _powers(powers)
    for b in range(powers.size):
        whole += powers[b]
    part_of = 1.0 / max(whole, LEAST_SUM)
    for b in range(powers.size):
        powers[b] *= part_of
    return whole


@summed
def gain_at(logs: Any, data: StepData, price: float, m: int, estimate: Any, powers: Any) -> float:
    """log c_m = log Σ_b e^{logs_b + a_bm} at an estimate; leaves the sum's shares in `powers`."""
    _offers(data, m, 1.0 / price, estimate, powers)
    for b in range(logs.size):
        powers[b] += logs[b]
    top, whole = 0.0, float(_shares(powers))
    if not LEAST_SUM < whole < 1.0 / LEAST_SUM:  # seldom: the largest then counts for one
        _offers(data, m, 1.0 / price, estimate, powers)
        for b in range(logs.size):
            powers[b] += logs[b]
        top = powers.max()
        if top == -np.inf:
            return -np.inf
        for b in range(logs.size):
            powers[b] -= top
        whole = _shares(powers)
    return float(top + np.log(whole))


@summed
def moments(shares: Any, points: Any, mean: Any, spread: Any) -> None:
    """Mean (d,) and lower half of the covariance (d,d) of points (d,B) with shares that add up to one."""
    for i in range(len(points)):
        one, total = points[i], 0.0
        for b in range(shares.size):
            total += shares[b] * one[b]
        mean[i] = total
        for j in range(i + 1):
            other, total = points[j], 0.0
            for b in range(shares.size):
                total += shares[b] * one[b] * other[b]
            spread[i, j] = total - mean[i] * mean[j]


@internal
def least_gain(logs: Any, data: StepData, price: float, m: int, estimate: Any, most: int, floor: float) -> float:
    """log c_m, least over the estimate by Newton's steps, or until it is at most `floor`.

    At a small λ it is almost the largest of some quadratics. A step that is too long is cut to where the gain is least along
    it: two of them are equal there, and the Hessian counts both. Of 800 drawn functions (λ from 1e-6 to 1e-2) none takes more
    than 21 steps; cut only until the gain falls, 78 take more than 30, up to 107, and 1.5 times the evaluations.
    """
    d, count = data.points.shape
    powers, mean, slope, step, trial = np.empty(count), np.empty(d), np.empty(d), np.empty(d), np.empty(d)
    hessian, factor, curve = np.empty((d, d)), np.empty((d, d)), np.empty((d, d))
    gain = gain_at(logs, data, price, m, estimate, powers)
    for _ in range(most):
        if gain <= floor or d == 0:
            return gain
        moments(powers, data.points, mean, hessian)
        own_slope(data, estimate, slope)
        own_curve(data, estimate, curve)
        fall = 0.0
        for i in range(d):
            for j in range(i + 1):
                hessian[i, j] = 4.0 / price**2 * hessian[i, j] + curve[i, j] / price
            slope[i] = step[i] = (slope[i] - 2.0 * mean[i]) / price
        factored(hessian, factor, d)
        solve_factored(factor, d, step)
        for i in range(d):
            fall += slope[i] * step[i]
        if fall <= _SOLVED * max(min(gain, 1.0), _FINER * _SOLVED):
            return gain
        step *= -1.0
        length, near, far, reached = longest(data, estimate, step), 0.0, np.inf, np.inf
        while length - near > _SHORTEST:
            for i in range(d):
                trial[i] = estimate[i] + length * step[i]
            reached = gain_at(logs, data, price, m, trial, powers)
            is_less = reached <= gain - _ARMIJO * length * fall
            if is_less and far == np.inf:
                break
            moments(powers, data.points, mean, hessian)
            own_slope(data, trial, slope)
            turn = 0.0
            for i in range(d):
                turn += step[i] * (slope[i] - 2.0 * mean[i]) / price
            if is_less and abs(turn) <= _FLAT * fall:
                break
            if is_less and turn < 0.0:
                near = length
            else:
                far = length
            length = 0.5 * (near + far)
        if not reached < gain:
            return gain
        gain = reached
        for i in range(d):
            estimate[i] = trial[i]
    return gain


@internal
def remaining_logs(weights: Any, point: Point, logs: Any) -> None:
    """log p_b − log z_b."""
    for b in range(weights.size):
        logs[b] = np.log(weights[b]) - point.top[b] - np.log(point.held[b]) if weights[b] > 0.0 else -np.inf


class SaddleModel(NamedTuple):
    """The saddle function to second order at a point: of the estimates of played decisions and of the law."""

    played: Any  # (k,) which of the n decisions
    gradient: Any  # (k d,)
    hessian: Any  # (k d,k d), of the estimates
    mixed: Any  # (n,k d)
    law: Any  # (n,n): minus the second derivative in the law
    gains: Any  # (n,)


@summed
def _sum_of(weights: Any, one: Any, other: Any) -> float:
    total = 0.0
    for b in range(weights.size):
        total += weights[b] * one[b] * other[b]
    return total


@internal
def _model(weights: Any, data: StepData, price: float, point: Point) -> SaddleModel:
    n, count = point.ratios.shape
    d = data.points.shape[0]
    played = np.flatnonzero(point.law > 0.0)
    size, ones = played.size * d, np.ones(count)
    turns, moves = np.empty((size, count)), np.empty((size, count))  # ∂a/∂μ, and K of it
    slope, curve = np.empty(d), np.empty((d, d))
    for a in range(played.size):
        m = played[a]
        own_slope(data, point.estimates[m], slope)
        for i in range(d):
            for b in range(count):
                turns[a * d + i, b] = (slope[i] - 2.0 * data.points[i, b]) / price
                moves[a * d + i, b] = point.law[m] * point.ratios[m, b] * turns[a * d + i, b]
    gradient, hessian, mixed = np.zeros(size), np.zeros((size, size)), np.zeros((n, size))
    law, gains = np.zeros((n, n)), np.zeros(n)
    _products(weights, point, law)
    for m in range(n):
        gains[m] = _sum_of(weights, point.ratios[m], ones)
        for r in range(size):
            mixed[m, r] = -_sum_of(weights, point.ratios[m], moves[r])
    for r in range(size):
        for s in range(r + 1):
            hessian[r, s] = -_sum_of(weights, moves[r], moves[s])
    for a in range(played.size):
        m = played[a]
        own_curve(data, point.estimates[m], curve)
        for i in range(d):
            r = a * d + i
            gradient[r] = _sum_of(weights, moves[r], ones)
            for j in range(i + 1):
                hessian[r, a * d + j] += _sum_of(weights, moves[r], turns[a * d + j])
                hessian[r, a * d + j] += curve[i, j] / price * point.law[m] * gains[m]
            mixed[m, r] += gradient[r] / point.law[m]
    return SaddleModel(played, gradient, hessian, mixed, law, gains)


@internal
def _saddle_step(model: SaddleModel, law: Any, found: Any) -> Any:
    """The step of the estimates, and the law `found` that goes with it, at the saddle point of the model over q ≥ 0."""
    n, size = model.mixed.shape
    factor, step, crossed = np.empty((size, size)), -model.gradient, model.mixed.copy()
    factored(model.hessian, factor, size)
    solve_factored(factor, size, step)
    for m in range(n):
        solve_factored(factor, size, crossed[m])
    hessian, right, free = model.law.copy(), model.gains - 1.0, law > 0.0
    for m in range(n):
        for k in range(n):
            for r in range(size):
                hessian[m, k] += crossed[m, r] * model.mixed[k, r]
    for m in range(n):
        for r in range(size):
            right[m] += model.mixed[m, r] * step[r]
        for k in range(n):
            right[m] += hessian[m, k] * law[k]
    _non_negative(hessian, right, free, found)
    for r in range(size):
        for m in range(n):
            step[r] -= crossed[m, r] * (found[m] - law[m])
    return step


@internal
def _first_length(weights: Any, data: StepData, price: float, point: Point, played: Any, step: Any) -> float:
    """The trust region: how far log K may move, on average over the decisions of the rows that count."""
    d, most, turns = data.points.shape[0], 0.0, np.empty(played.size)
    slopes = np.empty((played.size, d))
    for a in range(played.size):
        own_slope(data, point.estimates[played[a]], slopes[a])
    for b in np.flatnonzero(weights > 0.0):
        mean, moved = 0.0, 0.0
        for a in range(played.size):
            m, turns[a] = played[a], 0.0
            for i in range(d):
                turns[a] += (slopes[a, i] - 2.0 * data.points[i, b]) / price * step[a * d + i]
            mean += point.law[m] * point.ratios[m, b] * turns[a]
        for a in range(played.size):
            moved += point.law[played[a]] * point.ratios[played[a], b] * abs(turns[a] - mean)
        most = max(most, moved)
    return min(1.0, _LOGIT / max(most, TINY))


@internal
def settled(weights: Any, data: StepData, price: float, columns: Any, point: Point, work: Any) -> Point:
    """The saddle point on some decisions, from the law and the estimates given, or where the `work` (1,) allowed is done.

    Work is counted in products of numbers.
    """
    n, d = point.estimates.shape
    value = saddle_value(weights, data, price, columns, point)
    if d == 0:
        return point
    ahead, logs, found = room_for_point(n, d, weights.size), np.empty(weights.size), np.empty(n)
    full = 0
    for _ in range(_NEWTON_STEPS):
        work[0] -= (n * d) ** 2 * (weights.size + n * d)
        if work[0] < 0.0:
            break
        remaining_logs(weights, point, logs)
        for m in range(n):
            if not point.law[m] > 0.0:  # changes no value, and tells whether the decision could enter
                least_gain(logs, data, price, columns[m], point.estimates[m], _REFRESHED, -np.inf)
        value = saddle_value(weights, data, price, columns, point)
        model = _model(weights, data, price, point)
        step = _saddle_step(model, point.law, found)
        slope = float((model.gradient * step).sum())
        last = slope > -_ROUNDING * max(1.0, abs(value))
        full += 1 if last else 0
        length = 1.0 if last else _first_length(weights, data, price, point, model.played, step)
        for a in range(model.played.size):
            length = min(length, longest(data, point.estimates[model.played[a]], step[a * d : (a + 1) * d]))
        reached = np.inf
        while length > _SHORTEST:
            put_rows(point.estimates, ahead.estimates)
            for a in range(model.played.size):
                for i in range(d):
                    ahead.estimates[model.played[a], i] += length * step[a * d + i]
            for m in range(n):
                ahead.law[m] = max(point.law[m] + length * (found[m] - point.law[m]), _BACK)
            reached = saddle_value(weights, data, price, columns, ahead)
            if last or reached <= value + _ARMIJO * length * slope:
                break
            length *= _CUT
        if length <= _SHORTEST:
            break
        point, ahead, value = ahead, point, reached
        if full >= _FULL_STEPS:
            break
    return point
