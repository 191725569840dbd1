"""One step of a rule that keeps account of what the observer holds.

With the law p of the belief, points x_b, values v_bm = |x_b|² − s ρ_bm and the price λ of information, rows of least regret,
least information and largest error at these prices are K_bm = q_m e^{a_bm} / z_b, a_bm = (v_bm − 2 x_b·μ_m + |μ_m|²) / λ,
z_b = Σ_m q_m e^{a_bm}, at the saddle point of

    Φ(μ) = max_{q ≥ 0} Σ_b p_b log z_b − Σ_m q_m,        min over the observer's estimates μ_m,

which is convex in μ. c_m = Σ_b p_b e^{a_bm} / z_b is 1 where q_m > 0 and at most 1 elsewhere, for the estimate that makes it
least. Without coordinates (d = 0, v = −s ρ, λ = 1) the step is the one of least information. A value of −inf forbids a place.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.kernels.options import kernel, part, woven

_KEPT, _SOLVED, _RARELY = tolerances.KEPT_DECISION, tolerances.SOLVED_STEP, tolerances.RARELY_PLAYED
_RESIDUAL, _ROUNDING, _BACK = tolerances.LAW_RESIDUAL, tolerances.SADDLE_ROUNDING, tolerances.RETURNING_LAW
_ROUNDS, _LAW_STEPS, _NEWTON_STEPS, _PRICING_STEPS = 60, 200, 200, 30  # three to six, five, ten and three are usual
_MOST_ADDED = 3  # decisions that join at once; a fourth one costs more in Newton's steps than it spares in rounds
_APART = 0.01  # share of the law's variance by which estimates of decisions that join at once must differ
_LOGIT = 3.0  # largest mean change of log K in one step, beyond which its linear model says nothing
_RATIO = 0.25  # from one price of information to the next on the way to a small one
_LARGE_GAIN = (
    2.0  # c above which the law is multiplied by c (Blahut–Arimoto): Newton's steps for a logarithm only double
)
_WAYS = 4  # begun from ever larger prices of information, where Newton's steps stall: one step in a thousand small ones
_FULL_STEPS = 2  # taken at the end, where rounding hides the gain
_REFRESHED = 3  # Newton steps of an estimate after a decision that is not played
_ARMIJO, _CUT, _SHORTEST = 1e-4, 0.3, 1e-9
_RIDGE, _STEEPER, _TRIES = (
    1e-14,
    100.0,
    12,
)  # added to a diagonal relative to its largest entry, how much more each time
_TINY = 1e-300
_NEGLIGIBLE = (
    1e-250  # a belief of less weight counts for nothing: nearer to the smallest numbers, ratios lose their digits
)
_SQUARINGS, _SQUARED, _STEEPEST = 12, 4096.0, 700.0


class StepData(NamedTuple):
    """What stays the same from step to step."""

    points: Any  # (d,B)
    values: Any  # (M,B)
    slopes: Any  # (M,d): gradient of s ρ_m in the points' coordinates
    price: float  # λ
    first_price: float  # where the way to a small λ begins; at most λ: nowhere


class Point(NamedTuple):
    """A law and estimates of n decisions, and what follows from them."""

    law: Any  # q (n,)
    estimates: Any  # μ (n,d)
    ratios: Any  # e^{a} / z (n,B)
    powers: Any  # e^{a − top} (n,B)
    held: Any  # z e^{−top} (B,)
    top: Any  # (B,)


@part
def _room(n: int, d: int, count: int) -> Point:
    return Point(
        np.zeros(n), np.zeros((n, d)), np.empty((n, count)), np.empty((n, count)), np.empty(count), np.empty(count)
    )


@part
def _factored(matrix: Any, factor: Any, n: int) -> None:
    """factor = Cholesky factor of the first n rows, with as much added to the diagonal as it takes."""
    largest = _TINY
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
    for i in range(n):  # not numbers: nothing can be said
        for j in range(i + 1):
            factor[i, j] = 1.0 if i == j else 0.0


@part
def _solved(factor: Any, n: int, right: Any) -> None:
    for i in range(n):
        for k in range(i):
            right[i] -= factor[i, k] * right[k]
        right[i] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            right[i] -= factor[k, i] * right[k]
        right[i] /= factor[i, i]


@part
def _non_negative(hessian: Any, right: Any, free: Any, found: Any) -> None:
    """max right·y − ½ y'Hy over y ≥ 0 by principal pivoting (Júdice and Pires, 1994), `free` being the first guess."""
    n = right.size
    small, factor, part_found, where = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(n, np.int64)
    offends = np.empty(n, np.bool_)
    fewest, patience = n + 1, 3
    for _ in range(20 * n + 20):
        k = 0
        for i in range(n):
            if free[i]:
                where[k] = i
                k += 1
        for a in range(k):
            part_found[a] = right[where[a]]
            for b in range(a + 1):
                small[a, b] = hessian[where[a], where[b]]
        _factored(small, factor, k)
        _solved(factor, k, part_found)
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


@part
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


@part
def _gains(weights: Any, point: Point, gains: Any) -> None:
    """Ratios e^{a}/z and c_m = Σ_b p_b e^{a_bm}/z_b."""
    for m in range(gains.size):
        total = 0.0
        for b in range(weights.size):
            point.ratios[m, b] = point.powers[m, b] / point.held[b]
            total += weights[b] * point.ratios[m, b]
        gains[m] = total


@part
def _best_law(weights: Any, point: Point) -> float:
    """The law of the decisions for given estimates, by Newton's steps on those that are played; returns its value."""
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
            law *= gains
            value = _law_value(weights, point.powers, law, point.held)
            continue
        slope = 0.0
        for m in range(n):
            for k in range(m + 1):
                total = 0.0
                for b in range(weights.size):
                    total += weights[b] * point.ratios[m, b] * point.ratios[k, b]
                hessian[m, k] = hessian[k, m] = total
        for m in range(n):
            right[m] = gains[m] - 1.0
            for k in range(n):
                right[m] += hessian[m, k] * law[k]
            free[m] = law[m] > 0.0 or gains[m] > 1.0
        _non_negative(hessian, right, free, found)
        for m in range(n):
            slope += (gains[m] - 1.0) * (found[m] - law[m])
        length, ahead = 1.0, -np.inf
        while length > _SHORTEST:
            for m in range(n):
                trial[m] = found[m] if length == 1.0 else law[m] + length * (found[m] - law[m])
            ahead = _law_value(weights, point.powers, trial, point.held)
            if ahead >= value + _ARMIJO * length * slope - _RESIDUAL * 1e-3 * abs(value):
                break
            length *= _CUT
        if length <= _SHORTEST or slope < _RESIDUAL * 1e-4:
            value = _law_value(weights, point.powers, law, point.held)
            _gains(weights, point, gains)
            break
        law[:] = trial
        value = ahead
    return value


@part
def _saddle_value(weights: Any, data: StepData, price: float, columns: Any, point: Point) -> float:
    """Φ at the point's estimates, with the law that attains it."""
    top, powers = point.top, point.powers
    top[:] = -np.inf
    for m in range(columns.size):
        square = 0.0
        for i in range(data.points.shape[0]):
            square += point.estimates[m, i] ** 2
        for b in range(weights.size):
            total = data.values[columns[m], b] + square
            for i in range(data.points.shape[0]):
                total -= 2.0 * data.points[i, b] * point.estimates[m, i]
            powers[m, b] = total / price
            top[b] = max(top[b], powers[m, b])
    for b in range(weights.size):
        if top[b] == -np.inf:
            top[b] = 0.0
    for m in range(columns.size):
        for b in range(weights.size):
            powers[m, b] = np.exp(powers[m, b] - top[b])
    value = _best_law(weights, point)
    for b in range(weights.size):
        value += weights[b] * top[b]
    return value


@part
def _gain(logs: Any, data: StepData, price: float, m: int, estimate: Any, powers: Any) -> float:
    """log c_m = log Σ_b e^{logs_b + a_bm} at an estimate; leaves the sum's shares in `powers`."""
    d, count = data.points.shape
    square, top, whole = 0.0, -np.inf, 0.0
    for i in range(d):
        square += estimate[i] ** 2
    for b in range(count):
        total = data.values[m, b] + square
        for i in range(d):
            total -= 2.0 * data.points[i, b] * estimate[i]
        powers[b] = logs[b] + total / price
        top = max(top, powers[b])
    if top == -np.inf:
        return top
    for b in range(count):
        powers[b] = np.exp(powers[b] - top)
        whole += powers[b]
    for b in range(count):
        powers[b] /= whole
    return float(top + np.log(whole))


@part
def _least_gain(logs: Any, data: StepData, price: float, m: int, estimate: Any, most: int, floor: float) -> float:
    """log c_m, least over the estimate by Newton's steps, or until it is at most `floor`."""
    d, count = data.points.shape
    powers, mean, slope, step, trial = np.empty(count), np.empty(d), np.empty(d), np.empty(d), np.empty(d)
    hessian, factor = np.empty((d, d)), np.empty((d, d))
    gain = _gain(logs, data, price, m, estimate, powers)
    for _ in range(most):
        if gain <= floor or d == 0:
            return gain
        mean[:] = 0.0
        hessian[:] = 0.0
        for b in range(count):
            for i in range(d):
                mean[i] += powers[b] * data.points[i, b]
                for j in range(i + 1):
                    hessian[i, j] += powers[b] * data.points[i, b] * data.points[j, b]
        fall = 0.0
        for i in range(d):
            for j in range(i + 1):
                hessian[i, j] = 4.0 / price**2 * (hessian[i, j] - mean[i] * mean[j])
            hessian[i, i] += 2.0 / price
            slope[i] = step[i] = 2.0 / price * (estimate[i] - mean[i])
        _factored(hessian, factor, d)
        _solved(factor, d, step)
        for i in range(d):
            fall += slope[i] * step[i]
        if fall <= _SOLVED * max(min(gain, 1.0), 1e-3 * _SOLVED):
            return gain
        length, reached = 1.0, np.inf
        while length > _SHORTEST:
            for i in range(d):
                trial[i] = estimate[i] - length * step[i]
            reached = _gain(logs, data, price, m, trial, powers)
            if reached <= gain - _ARMIJO * length * fall:
                break
            length *= _CUT
        if not reached < gain:
            return gain
        gain = reached
        for i in range(d):
            estimate[i] = trial[i]
    return gain


@woven
def _power(x: float) -> float:
    """e^x to some 1e-11 for |x| up to 700, by twelve squarings, because a loop over it is then taken by the lane: a look at
    all decisions, most of a step's time, takes a fifth of what it takes with the library's function."""
    y = min(max(x, -_STEEPEST), _STEEPEST) / _SQUARED
    y = 1.0 + y * (
        1.0 + y / 2 * (1.0 + y / 3 * (1.0 + y / 4 * (1.0 + y / 5 * (1.0 + y / 6 * (1.0 + y / 7 * (1.0 + y / 8))))))
    )
    for _ in range(_SQUARINGS):
        y *= y
    return y


@part
def _quick_gain(logs: Any, data: StepData, price: float, m: int, estimate: Any, powers: Any) -> float:
    """log c_m at an estimate."""
    d, count = data.points.shape
    square, whole, scale = 0.0, 0.0, 1.0 / price
    for i in range(d):
        square += estimate[i] * estimate[i]
    values = data.values[m]
    for b in range(count):
        powers[b] = logs[b] + (values[b] + square) * scale
    for i in range(d):
        turn, line = 2.0 * scale * estimate[i], data.points[i]
        for b in range(count):
            powers[b] -= turn * line[b]
    for b in range(count):
        powers[b] = _power(powers[b])
    for b in range(count):
        whole += powers[b]
    return float(np.log(whole))


@part
def _logs(weights: Any, point: Point, logs: Any) -> None:
    """log p_b − log z_b."""
    for b in range(weights.size):
        logs[b] = np.log(weights[b]) - point.top[b] - np.log(point.held[b]) if weights[b] > _NEGLIGIBLE else -np.inf


class Model(NamedTuple):
    """The saddle function to second order at a point: of the estimates of played decisions and of the law."""

    played: Any  # (k,) which of the n decisions
    gradient: Any  # (k d,)
    hessian: Any  # (k d,k d), of the estimates
    mixed: Any  # (n,k d)
    law: Any  # (n,n): minus the second derivative in the law
    gains: Any  # (n,)


@part
def _model(weights: Any, data: StepData, price: float, point: Point) -> Model:
    n, count = point.ratios.shape
    d = data.points.shape[0]
    played = np.flatnonzero(point.law > 0.0)
    size = played.size * d
    moves = np.empty((size, count))  # K ∂a/∂μ
    for a in range(played.size):
        m = played[a]
        for i in range(d):
            for b in range(count):
                turn = 2.0 / price * (point.estimates[m, i] - data.points[i, b])
                moves[a * d + i, b] = point.law[m] * point.ratios[m, b] * turn
    gradient, hessian, mixed = np.zeros(size), np.zeros((size, size)), np.zeros((n, size))
    law, gains = np.zeros((n, n)), np.zeros(n)
    for m in range(n):
        for b in range(count):
            gains[m] += weights[b] * point.ratios[m, b]
        for k in range(m + 1):
            for b in range(count):
                law[m, k] += weights[b] * point.ratios[m, b] * point.ratios[k, b]
            law[k, m] = law[m, k]
        for r in range(size):
            for b in range(count):
                mixed[m, r] -= weights[b] * point.ratios[m, b] * moves[r, b]
    for r in range(size):
        for s in range(r + 1):
            for b in range(count):
                hessian[r, s] -= weights[b] * moves[r, b] * moves[s, b]
    for a in range(played.size):
        m = played[a]
        for i in range(d):
            r = a * d + i
            for b in range(count):
                gradient[r] += weights[b] * moves[r, b]
                for j in range(i + 1):
                    turn = 2.0 / price * (point.estimates[m, j] - data.points[j, b])
                    hessian[r, a * d + j] += weights[b] * moves[r, b] * turn
            mixed[m, r] += gradient[r] / point.law[m]
            hessian[r, r] += 2.0 / price * point.law[m] * gains[m]
    return Model(played, gradient, hessian, mixed, law, gains)


@part
def _saddle_step(model: Model, law: Any, found: Any) -> Any:
    """The step of the estimates, and the law `found` that goes with it, at the saddle point of the model over q ≥ 0."""
    n, size = model.mixed.shape
    factor, step, crossed = np.empty((size, size)), -model.gradient, model.mixed.copy()
    _factored(model.hessian, factor, size)
    _solved(factor, size, step)
    for m in range(n):
        _solved(factor, size, crossed[m])
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


@part
def _first_length(data: StepData, price: float, point: Point, played: Any, step: Any) -> float:
    """How far log K may move, on average over the rows' decisions, for the model to be believed."""
    d, most = data.points.shape[0], 0.0
    for b in range(point.held.size):
        moved = 0.0
        for a in range(played.size):
            m, turn = played[a], 0.0
            for i in range(d):
                turn += (point.estimates[m, i] - data.points[i, b]) * step[a * d + i]
            moved += point.law[m] * point.ratios[m, b] * abs(2.0 / price * turn)
        most = max(most, moved)
    return min(1.0, _LOGIT / max(most, _TINY))


@part
def _settled(weights: Any, data: StepData, price: float, columns: Any, point: Point) -> Point:
    """The saddle point on some decisions, from the law and the estimates given."""
    n, d = point.estimates.shape
    value = _saddle_value(weights, data, price, columns, point)
    if d == 0:
        return point
    ahead, logs, found = _room(n, d, weights.size), np.empty(weights.size), np.empty(n)
    full = 0
    for _ in range(_NEWTON_STEPS):
        _logs(weights, point, logs)
        for m in range(n):
            if not point.law[m] > 0.0:  # changes no value, and says whether it could be played at all
                _least_gain(logs, data, price, columns[m], point.estimates[m], _REFRESHED, -np.inf)
        value = _saddle_value(weights, data, price, columns, point)
        model = _model(weights, data, price, point)
        step = _saddle_step(model, point.law, found)
        slope = float((model.gradient * step).sum())
        last = slope > -_ROUNDING * max(1.0, abs(value))
        full += 1 if last else 0
        length = 1.0 if last else _first_length(data, price, point, model.played, step)
        reached = np.inf
        while length > _SHORTEST:
            ahead.estimates[:] = point.estimates
            for a in range(model.played.size):
                for i in range(d):
                    ahead.estimates[model.played[a], i] += length * step[a * d + i]
            for m in range(n):
                ahead.law[m] = max(point.law[m] + length * (found[m] - point.law[m]), _BACK)
            reached = _saddle_value(weights, data, price, columns, ahead)
            if last or reached <= value + _ARMIJO * length * slope:
                break
            length *= _CUT
        if length <= _SHORTEST:
            break
        point, ahead, value = ahead, point, reached
        if full >= _FULL_STEPS:
            break
    return point


@part
def _guesses(weights: Any, data: StepData, price: float, columns: Any, point: Point, estimates: Any) -> None:
    """Estimates after every decision, to first order from the played one of the nearest slopes.

    The least log c_m is Λ(θ) + λ|μ|², with Λ the cumulants of p/z and θ = (2 μ + slope)/λ, so that μ = −∇Λ(θ).
    """
    n, count = point.ratios.shape
    d = data.points.shape[0]
    factors, mean, spread, right = np.empty((n, d, d)), np.empty(d), np.empty((d, d)), np.empty(d)
    farthest = 0.0
    for b in range(count):
        square = 0.0
        for i in range(d):
            square += data.points[i, b] ** 2
        farthest = max(farthest, square)
    for k in range(n):
        mean[:] = 0.0
        spread[:] = 0.0
        whole = 0.0
        for b in range(count):
            share = weights[b] * point.ratios[k, b]
            whole += share
            for i in range(d):
                mean[i] += share * data.points[i, b]
                for j in range(i + 1):
                    spread[i, j] += share * data.points[i, b] * data.points[j, b]
        for i in range(d):
            for j in range(i + 1):
                spread[i, j] = spread[i, j] / whole - mean[i] * mean[j] / whole**2
            spread[i, i] += 0.5 * price
        _factored(spread, factors[k], d)
    for m in range(len(estimates)):
        nearest, least = 0, np.inf
        for k in range(n):
            apart = 0.0
            for i in range(d):
                apart += (data.slopes[m, i] - data.slopes[columns[k], i]) ** 2
            if apart < least:
                nearest, least = k, apart
        for i in range(d):
            right[i] = 0.5 * (data.slopes[m, i] - data.slopes[columns[nearest], i])
        _solved(factors[nearest], d, right)
        length, square = 1.0, 0.0
        for i in range(d):
            right[i] = 0.5 * (price * right[i] - data.slopes[m, i] + data.slopes[columns[nearest], i])
            square += (point.estimates[nearest, i] + right[i]) ** 2
        if square > farthest:  # estimates are means of the points
            length = 0.0
        for i in range(d):
            estimates[m, i] = point.estimates[nearest, i] + length * right[i]


@part
def _joining(logs: Any, data: StepData, price: float, gains: Any, estimates: Any, apart: float) -> Any:
    """Decisions that could be played, the most tempting first, of different estimates; `gains` is mended on the way."""
    added, near = np.empty(_MOST_ADDED, np.int64), np.zeros(gains.size, np.bool_)
    count = 0
    while count < _MOST_ADDED:
        best = -1
        for m in range(gains.size):
            if gains[m] > _SOLVED and not near[m] and (best < 0 or gains[m] > gains[best]):
                best = m
        if best < 0:
            break
        gains[best] = _least_gain(logs, data, price, best, estimates[best], _PRICING_STEPS, 0.3 * _SOLVED)
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


@part
def _priced(weights: Any, data: StepData, price: float, columns: Any, point: Point, gains: Any, estimates: Any) -> Any:
    """log c of all decisions, to where it is known to be at most nothing, and those that join.

    What the last look left tempting is looked at first; all are only where none of it is left.
    """
    d, count = data.points.shape
    logs, powers, mean, apart = np.empty(count), np.empty(count), np.zeros(d), 0.0
    _logs(weights, point, logs)
    for b in range(count):
        for i in range(d):
            mean[i] += weights[b] * data.points[i, b]
            apart += weights[b] * data.points[i, b] ** 2
    for i in range(d):
        apart -= mean[i] ** 2
    _guesses(weights, data, price, columns, point, estimates)
    for whole in range(2):
        for m in range(gains.size):
            if whole == 1 or gains[m] > _SOLVED:
                gains[m] = _quick_gain(logs, data, price, m, estimates[m], powers)
        for k in range(columns.size):
            gains[columns[k]] = 0.0
        added = _joining(logs, data, price, gains, estimates, _APART * apart)
        if added.size:
            break
    return added


@part
def _covering(weights: Any, data: StepData) -> Any:
    """The decision of least mean regret; where caps forbid it to some beliefs, those of largest reach until each has one."""
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


@part
def _joined(columns: Any, point: Point, added: Any, gains: Any, estimates: Any) -> Any:
    """The played decisions with those that join, and room for their law and estimates."""
    kept = np.flatnonzero(point.law > _RARELY)
    n = kept.size + added.size
    longer, both = _room(n, point.estimates.shape[1], point.held.size), np.empty(n, np.int64)
    for k in range(kept.size):
        both[k], longer.law[k] = columns[kept[k]], point.law[kept[k]]
        longer.estimates[k] = point.estimates[kept[k]]
    for k in range(added.size):
        m, place = added[k], kept.size + k
        both[place], longer.law[place] = m, max(1e-3 * np.exp(-max(gains[m], 0.0)), _BACK)
        longer.estimates[place] = estimates[m]
    return both, longer


@part
def _at_price(weights: Any, data: StepData, price: float, columns: Any, point: Point) -> Any:
    """The optimal step at a price of information, from some decisions: which are played, how, and the largest log c."""
    n_columns, d = data.values.shape[0], data.points.shape[0]
    gains, estimates = np.full(n_columns, -np.inf), np.empty((n_columns, d))
    worst = np.inf
    for _ in range(_ROUNDS):
        added = _priced(weights, data, price, columns, point, gains, estimates)
        worst = max(gains.max(), 0.0)
        if not added.size:
            break
        columns, point = _joined(columns, point, added, gains, estimates)
        point = _settled(weights, data, price, columns, point)
        nothing = np.empty(0, np.int64)
        columns, smaller = _joined(columns, point, nothing, gains, estimates)
        _saddle_value(weights, data, price, columns, smaller)
        point = smaller
    return columns, point, worst


@part
def _is_tied(weights: Any, data: StepData, kept: int, best: int) -> bool:
    """Whether two decisions cost the same on average, to rounding."""
    apart, size = 0.0, 0.0
    for b in range(weights.size):
        if weights[b] > 0.0:
            apart += weights[b] * (data.values[kept, b] - data.values[best, b])
            size += weights[b] * (abs(data.values[kept, b]) + abs(data.values[best, b]))
    return apart >= -_RESIDUAL * size


@part
def _copied(point: Point) -> Point:
    return Point(
        point.law.copy(),
        point.estimates.copy(),
        point.ratios.copy(),
        point.powers.copy(),
        point.held.copy(),
        point.top.copy(),
    )


@kernel
def solved_step(weights: Any, data: StepData, kept: int) -> Any:
    """Return the decisions (n,) that are played, their law, the estimates after them, and the largest log c.

    First whether one decision for certain is optimal: `kept`, where its mean regret is the least, or the least one.
    """
    d, count = data.points.shape
    columns = _covering(weights, data)
    point = _room(columns.size, d, count)
    point.law[:] = 1.0 / columns.size
    for m in range(columns.size):
        for b in range(count):
            for i in range(d):
                point.estimates[m, i] += weights[b] * data.points[i, b]
    if columns.size == 1:
        if kept >= 0 and _is_tied(weights, data, kept, columns[0]):
            columns[0] = kept
        _saddle_value(weights, data, data.price, columns, point)
        gains, estimates = np.full(len(data.values), -np.inf), np.empty((len(data.values), d))
        _priced(weights, data, data.price, columns, point, gains, estimates)
        if gains.max() <= _KEPT:
            return columns, point.law, point.estimates, max(gains.max(), 0.0)
    above = max(data.first_price / data.price, 1.0)
    for _ in range(_WAYS):
        price = above * data.price
        start, begun = columns, _copied(point)
        while True:
            begun = _settled(weights, data, price, start, begun)
            start, begun, worst = _at_price(weights, data, price, start, begun)
            if price <= data.price:
                break
            price = max(_RATIO * price, data.price)
        if worst <= _KEPT or d == 0:
            break
        above /= _RATIO**2  # a step that was lost on the way: from farther above
    return start, begun.law / begun.law.sum(), begun.estimates, worst
