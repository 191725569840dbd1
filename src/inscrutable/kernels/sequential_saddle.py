"""The saddle point of one step of a rule that keeps account of what the observer holds, on a few decisions.

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
from inscrutable.kernels.options import part, woven

_SOLVED, _RESIDUAL = tolerances.SOLVED_STEP, tolerances.LAW_RESIDUAL
_ROUNDING, _BACK = tolerances.SADDLE_ROUNDING, tolerances.RETURNING_LAW
_LAW_STEPS, _NEWTON_STEPS = 200, 200  # five and ten are usual
_LOGIT = 3.0  # largest mean change of log K in one step, beyond which its linear model says nothing
_LARGE_GAIN = 2.0  # c above which the law is multiplied by c: Newton's steps for a logarithm only double
_FULL_STEPS = 2  # taken at the end, where rounding hides the gain
_REFRESHED = 3  # Newton steps of an estimate after a decision that is not played
_ARMIJO, _CUT, _SHORTEST = 1e-4, 0.3, 1e-9
_RIDGE, _STEEPER, _TRIES = 1e-14, 100.0, 12  # share of a diagonal added to it, and how much more each time
_TINY = 1e-300
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
def room_for_point(n: int, d: int, count: int) -> Point:
    """An empty point of n decisions."""
    return Point(
        np.zeros(n), np.zeros((n, d)), np.empty((n, count)), np.empty((n, count)), np.empty(count), np.empty(count)
    )


@part
def factored(matrix: Any, factor: Any, n: int) -> None:
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
def solve_factored(factor: Any, n: int, right: Any) -> None:
    """right = (L L')⁻¹ right for a Cholesky factor L of n rows."""
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
            if (law < _BACK).any():  # a law of 0 stays 0 whatever it is multiplied by
                law[:] = np.maximum(law, _BACK)
                _law_value(weights, point.powers, law, point.held)
                _gains(weights, point, gains)
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
        if slope < _RESIDUAL:  # the whole step is right to its square
            law[:] = found
            value = _law_value(weights, point.powers, law, point.held)
            _gains(weights, point, gains)
            break
        length, ahead = 1.0, -np.inf
        while length > _SHORTEST:
            for m in range(n):
                trial[m] = found[m] if length == 1.0 else law[m] + length * (found[m] - law[m])
            ahead = _law_value(weights, point.powers, trial, point.held)
            if ahead >= value + _ARMIJO * length * slope - _RESIDUAL * 1e-3 * abs(value):
                break
            length *= _CUT
        if length <= _SHORTEST:
            value = _law_value(weights, point.powers, law, point.held)
            _gains(weights, point, gains)
            break
        law[:] = trial
        value = ahead
    return value


@part
def saddle_value(weights: Any, data: StepData, price: float, columns: Any, point: Point) -> float:
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
def least_gain(logs: Any, data: StepData, price: float, m: int, estimate: Any, most: int, floor: float) -> float:
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
        factored(hessian, factor, d)
        solve_factored(factor, d, step)
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
def quick_gain(logs: Any, data: StepData, price: float, m: int, estimate: Any, powers: Any) -> float:
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


@part
def _model(weights: Any, data: StepData, price: float, point: Point) -> SaddleModel:
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
    return SaddleModel(played, gradient, hessian, mixed, law, gains)


@part
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


@part
def _first_length(weights: Any, data: StepData, price: float, point: Point, played: Any, step: Any) -> float:
    """How far log K may move, on average over the decisions of rows that count, for the model to be believed."""
    d, most, turns = data.points.shape[0], 0.0, np.empty(played.size)
    for b in np.flatnonzero(weights > 0.0):
        mean, moved = 0.0, 0.0
        for a in range(played.size):
            m, turns[a] = played[a], 0.0
            for i in range(d):
                turns[a] += 2.0 / price * (point.estimates[m, i] - data.points[i, b]) * step[a * d + i]
            mean += point.law[m] * point.ratios[m, b] * turns[a]
        for a in range(played.size):
            moved += point.law[played[a]] * point.ratios[played[a], b] * abs(turns[a] - mean)
        most = max(most, moved)
    return min(1.0, _LOGIT / max(most, _TINY))


@part
def settled(weights: Any, data: StepData, price: float, columns: Any, point: Point) -> Point:
    """The saddle point on some decisions, from the law and the estimates given."""
    n, d = point.estimates.shape
    value = saddle_value(weights, data, price, columns, point)
    if d == 0:
        return point
    ahead, logs, found = room_for_point(n, d, weights.size), np.empty(weights.size), np.empty(n)
    full = 0
    for _ in range(_NEWTON_STEPS):
        remaining_logs(weights, point, logs)
        for m in range(n):
            if not point.law[m] > 0.0:  # changes no value, and says whether it could be played at all
                least_gain(logs, data, price, columns[m], point.estimates[m], _REFRESHED, -np.inf)
        value = saddle_value(weights, data, price, columns, point)
        model = _model(weights, data, price, point)
        step = _saddle_step(model, point.law, found)
        slope = float((model.gradient * step).sum())
        last = slope > -_ROUNDING * max(1.0, abs(value))
        full += 1 if last else 0
        length = 1.0 if last else _first_length(weights, data, price, point, model.played, step)
        reached = np.inf
        while length > _SHORTEST:
            ahead.estimates[:] = point.estimates
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
