"""Lotteries for three states: local optima of a face in the plane of beliefs, by Newton steps with exact derivatives.

Beliefs are points z of a plane, y = 1/3 + B z. On a face with k ≥ 2 free coordinates every decision has one belief, and

    L(z) = ±‖y − p‖ − μ ρ(y)   under rows f_r(y) ≥ 0

is climbed by quadratic programmes in two variables, solved by looking at every row: the best point of the plane, of each
row's line, and of the way uphill. Functions and derivatives are those of `faces`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.options import bare, inlined, woven
from inscrutable.tolerances import BUDGET, CLIMB, EXPLAINED, KINK, LENGTH, PARALLEL, TINY

_ROUNDS = 24
_TRUST = 0.05  # longest step in the plane
_ROW_WEIGHT, _BUDGET_WEIGHT = 5.0, 1.5  # of a violation, in the worth of a step
_SHORTER, _SHORTEST = 0.25, 1e-6


SIZE, N_ROWS, N_SET_ROWS, CURVE_AT, ROW_AT = range(5)  # columns of `Ground.faces`

# Where the memory of one thread's climbs keeps what: one array, because every array that a call hands on costs time.
# LOCAL: 0 regret, 1–3 its slope, 4–9 its curvature (00 11 22 01 02 12).
_W, LOCAL, _MEAN = 0, 1, 2  # w (k+1,); (10,); (k,)
_GRADIENTS, _SLOPES, _OTHER = 3, 6, 9  # G, T and D, (3,k) each
_ROWS = 12  # (3,R+1) value, and two slopes of every row in reach at unit length; the budget's last
_FACTOR = 15  # (k,k)
_LOCALS = 10


class Ground(NamedTuple):
    """The face programmes of an atlas, end to end."""

    faces: Any  # (K,5) free coordinates, rows, rows of the set, where curves and rows begin
    curves: Any  # flat
    rows: Any  # flat


class Here(NamedTuple):
    """A belief, the point of the plane that counts for it, far from which (sign +) or near to which (−), and V."""

    b0: float
    b1: float
    b2: float
    p0: float
    p1: float
    sign: float
    optimal: float


def bench(ground: Ground) -> Any:
    """Return the memory of one thread."""
    k, rows = max(int(ground.faces[:, SIZE].max()), 1), int(ground.faces[:, N_ROWS].max())
    return np.empty((_FACTOR + k, max(k + 1, rows + 1, _LOCALS)))


@woven
def in_space(basis: Any, z0: float, z1: float) -> tuple[float, float, float]:
    """The belief at a point of the plane."""
    return (
        1 / 3 + basis[0, 0] * z0 + basis[0, 1] * z1,
        1 / 3 + basis[1, 0] * z0 + basis[1, 1] * z1,
        1 / 3 + basis[2, 0] * z0 + basis[2, 1] * z1,
    )


@inlined
def decide_three(curves: Any, at: int, k: int, pivot: float, y0: float, y1: float, y2: float, on: Any) -> bool:
    """Fill w and the factor of H(y) of the face whose curves begin at `at`; False where no decision is unique."""
    w, factor = on[_W], on[_FACTOR:]
    width = k + 1
    second, third = at + width * width, at + 2 * width * width
    for a in range(k):
        for c in range(a + 1):
            j = a * width + c
            factor[a, c] = y0 * curves[at + j] + y1 * curves[second + j] + y2 * curves[third + j]
        j = a * width + k
        w[a] = -(y0 * curves[at + j] + y1 * curves[second + j] + y2 * curves[third + j])
    w[k] = 1.0
    for j in range(k):
        diagonal = factor[j, j]
        original = diagonal
        for c in range(j):
            diagonal -= factor[j, c] * factor[j, c]
        if not diagonal > pivot * original:
            return False
        root = 1.0 / np.sqrt(diagonal)
        factor[j, j] = root  # its inverse: divisions are slow
        for a in range(j + 1, k):
            total = factor[a, j]
            for c in range(j):
                total -= factor[a, c] * factor[j, c]
            factor[a, j] = total * root
    for a in range(k):
        total = w[a]
        for c in range(a):
            total -= factor[a, c] * w[c]
        w[a] = total * factor[a, a]
    for a in range(k - 1, -1, -1):
        total = w[a]
        for c in range(a + 1, k):
            total -= factor[c, a] * w[c]
        w[a] = total * factor[a, a]
    return True


@woven
def settle_three(curves: Any, at: int, k: int, pivot: float, y0: float, y1: float, y2: float, on: Any) -> bool:
    """Fill w, the factor of H(y), G and T of the face whose curves begin at `at`; False where no decision is unique."""
    if not decide_three(curves, at, k, pivot, y0, y1, y2, on):
        return False
    w, factor, gradients, slopes = on[_W], on[_FACTOR:], on[_GRADIENTS:_SLOPES], on[_SLOPES:_OTHER]
    width = k + 1
    for i in range(3):
        first = at + i * width * width
        for a in range(k):
            total = curves[first + a * width + k]
            for c in range(k):
                total += curves[first + a * width + c] * w[c]
            gradients[i, a] = total
            for c in range(a):
                total -= factor[a, c] * slopes[i, c]
            slopes[i, a] = total * factor[a, a]
        for a in range(k - 1, -1, -1):
            total = slopes[i, a]
            for c in range(a + 1, k):
                total -= factor[c, a] * slopes[i, c]
            slopes[i, a] = total * factor[a, a]
    return True


@woven
def judge_three(curves: Any, at: int, k: int, here: Here, y0: float, y1: float, y2: float, on: Any) -> None:
    """Fill `local` with the regret at a settled y, its slope and its curvature."""
    w, local, mean, other = on[_W], on[LOCAL], on[_MEAN], on[_OTHER:_ROWS]
    gradients, slopes = on[_GRADIENTS:_SLOPES], on[_SLOPES:_OTHER]
    p0, p1, p2 = here.b0, here.b1, here.b2
    width = k + 1
    size = width * width
    e0, e1, e2 = 0.5 * (p0 - y0), 0.5 * (p1 - y1), 0.5 * (p2 - y2)
    last = at + size - 1
    cost = p0 * curves[last] + p1 * curves[last + size] + p2 * curves[last + 2 * size]
    s0, s1, s2 = 0.0, 0.0, 0.0
    for a in range(k):
        j = at + a * width + k
        lean = p0 * gradients[0, a] + p1 * gradients[1, a] + p2 * gradients[2, a]
        cost += w[a] * (lean + p0 * curves[j] + p1 * curves[j + size] + p2 * curves[j + 2 * size])
        s0 -= lean * slopes[0, a]
        s1 -= lean * slopes[1, a]
        s2 -= lean * slopes[2, a]
        mean[a] = p0 * slopes[0, a] + p1 * slopes[1, a] + p2 * slopes[2, a]
    for a in range(k):
        d0, d1, d2 = 0.5 * gradients[0, a], 0.5 * gradients[1, a], 0.5 * gradients[2, a]
        for c in range(k):
            j = at + a * width + c
            c0, c1, c2 = curves[j], curves[j + size], curves[j + 2 * size]
            twisted = e0 * c0 + e1 * c1 + e2 * c2
            d0 += c0 * mean[c] + twisted * slopes[0, c]
            d1 += c1 * mean[c] + twisted * slopes[1, c]
            d2 += c2 * mean[c] + twisted * slopes[2, c]
        other[0, a], other[1, a], other[2, a] = d0, d1, d2
    h00, h11, h22, h01, h02, h12 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for a in range(k):
        t0, t1, t2 = slopes[0, a], slopes[1, a], slopes[2, a]
        d0, d1, d2 = other[0, a], other[1, a], other[2, a]
        h00 += 2.0 * t0 * d0
        h11 += 2.0 * t1 * d1
        h22 += 2.0 * t2 * d2
        h01 += t0 * d1 + t1 * d0
        h02 += t0 * d2 + t2 * d0
        h12 += t1 * d2 + t2 * d1
    local[0] = 0.5 * cost - here.optimal
    local[1], local[2], local[3] = s0, s1, s2
    local[4], local[5], local[6], local[7], local[8], local[9] = h00, h11, h22, h01, h02, h12


@woven
def rows_three(
    rows: Any, at: int, m: int, k: int, basis: Any, y0: float, y1: float, y2: float, reach: float, on: Any
) -> tuple[float, int]:
    """Fill value and slope, at unit length, of the rows nearer than `reach` to a settled y: the least value, and how many."""
    w, slopes, lines = on[_W], on[_SLOPES:_OTHER], on[_ROWS:_FACTOR]
    width = k + 1
    least, n = np.inf, 0
    for r in range(m):
        j = at + 3 * r * width
        g0, g1, g2 = rows[j + k], rows[j + width + k], rows[j + 2 * width + k]
        for a in range(k):
            r0, r1, r2 = rows[j + a], rows[j + width + a], rows[j + 2 * width + a]
            g0 += r0 * w[a]
            g1 += r1 * w[a]
            g2 += r2 * w[a]
        value = y0 * g0 + y1 * g1 + y2 * g2
        for a in range(k):
            b = y0 * rows[j + a] + y1 * rows[j + width + a] + y2 * rows[j + 2 * width + a]
            g0 -= b * slopes[0, a]
            g1 -= b * slopes[1, a]
            g2 -= b * slopes[2, a]
        least = min(least, value)
        n0 = basis[0, 0] * g0 + basis[1, 0] * g1 + basis[2, 0] * g2
        n1 = basis[0, 1] * g0 + basis[1, 1] * g1 + basis[2, 1] * g2
        square = n0 * n0 + n1 * n1
        if square > LENGTH * LENGTH and (value <= 0.0 or value * value < reach * reach * square):
            inverse = 1.0 / np.sqrt(square)
            lines[0, n], lines[1, n], lines[2, n] = value * inverse, n0 * inverse, n1 * inverse
            n += 1
    return least, n


@inlined
def look_three(
    ground: Ground,
    at: int,
    row_at: int,
    m: int,
    k: int,
    rules: Any,
    here: Here,
    y0: float,
    y1: float,
    y2: float,
    reach: float,
    on: Any,
) -> tuple[float, int]:
    """Settle y, and fill the regret and the rows within reach with their derivatives: the least row, and how many are.

    The least row is −∞ where there is no decision.
    """
    if not settle_three(ground.curves, at, k, rules.pivot, y0, y1, y2, on):
        return -np.inf, 0
    judge_three(ground.curves, at, k, here, y0, y1, y2, on)
    return rows_three(ground.rows, row_at, m, k, rules.basis, y0, y1, y2, reach, on)


@bare
def move_in_plane(
    g0: float, g1: float, h00: float, h01: float, h11: float, trust: float, count: int, on: Any
) -> tuple[float, float, float, int, int]:
    """The step that maximises g·s + ½ s'Hs under the rows, its gain, and the rows (−1: none) on which it ends.

    A gain of −∞: no step satisfies the rows.
    """
    lines = on[_ROWS:_FACTOR]
    worst = np.inf
    for r in range(count):
        worst = min(worst, lines[0, r])
    determinant = h00 * h11 - h01 * h01
    concave = h00 < 0.0 and determinant > 0.0
    if concave:
        s0, s1 = (h01 * g1 - h11 * g0) / determinant, (h01 * g0 - h00 * g1) / determinant
        inside = s0 * s0 + s1 * s1 <= trust * trust
        for r in range(count):
            if lines[0, r] + lines[1, r] * s0 + lines[2, r] * s1 < 0.0:
                inside = False
        if inside:
            return s0, s1, 0.5 * (g0 * s0 + g1 * s1), -1, -1
    best, m0, m1, first, second = -np.inf, 0.0, 0.0, -1, -1
    for r in range(-1, count):
        if r < 0:
            # The way uphill.
            length = np.sqrt(g0 * g0 + g1 * g1)
            if worst < -EXPLAINED or not length > 0.0:
                continue
            b0, b1, t0, t1 = 0.0, 0.0, g0 / length, g1 / length
        else:
            b0, b1 = -lines[0, r] * lines[1, r], -lines[0, r] * lines[2, r]
            t0, t1 = -lines[2, r], lines[1, r]
        room = trust * trust - b0 * b0 - b1 * b1
        if room <= 0.0:
            continue
        high = np.sqrt(room)
        low = -high
        ends_low, ends_high = -1, -1
        for q in range(count):
            if q == r:
                continue
            value = lines[0, q] + lines[1, q] * b0 + lines[2, q] * b1
            speed = lines[1, q] * t0 + lines[2, q] * t1
            if abs(speed) <= PARALLEL:
                if value < -EXPLAINED:
                    high = -np.inf
            elif speed > 0.0:
                if -value / speed > low:
                    low, ends_low = -value / speed, q
            elif -value / speed < high:
                high, ends_high = -value / speed, q
        if low > high:
            continue
        lean = g0 * t0 + g1 * t1 + t0 * (h00 * b0 + h01 * b1) + t1 * (h01 * b0 + h11 * b1)
        bend = t0 * (h00 * t0 + h01 * t1) + t1 * (h01 * t0 + h11 * t1)
        step, end = low, ends_low
        if lean * high + 0.5 * bend * high * high > lean * low + 0.5 * bend * low * low:
            step, end = high, ends_high
        if bend < 0.0 and low < -lean / bend < high:
            step, end = -lean / bend, -1
        s0, s1 = b0 + step * t0, b1 + step * t1
        gain = g0 * s0 + g1 * s1 + 0.5 * (h00 * s0 * s0 + h11 * s1 * s1) + h01 * s0 * s1
        if gain >= best:
            best, m0, m1, first, second = gain, s0, s1, r, end
    return m0, m1, best, first, second


@woven
def _in_plane(basis: Any, local: Any) -> tuple[float, float, float, float, float]:
    """Slope and curvature of the regret in the plane: B'∇ρ, and B'∇²ρB as 00, 01, 11."""
    b00, b10, b20 = basis[0, 0], basis[1, 0], basis[2, 0]
    b01, b11, b21 = basis[0, 1], basis[1, 1], basis[2, 1]
    h00, h11, h22, h01, h02, h12 = local[4], local[5], local[6], local[7], local[8], local[9]
    c00 = b00 * b00 * h00 + b10 * b10 * h11 + b20 * b20 * h22
    c00 += 2.0 * (b00 * b10 * h01 + b00 * b20 * h02 + b10 * b20 * h12)
    c11 = b01 * b01 * h00 + b11 * b11 * h11 + b21 * b21 * h22
    c11 += 2.0 * (b01 * b11 * h01 + b01 * b21 * h02 + b11 * b21 * h12)
    c01 = b00 * b01 * h00 + b10 * b11 * h11 + b20 * b21 * h22
    c01 += (b00 * b11 + b10 * b01) * h01 + (b00 * b21 + b20 * b01) * h02 + (b10 * b21 + b20 * b11) * h12
    r0 = b00 * local[1] + b10 * local[2] + b20 * local[3]
    r1 = b01 * local[1] + b11 * local[2] + b21 * local[3]
    return r0, r1, c00, c01, c11


@woven
def _multiplier(lines: Any, budget: int, other: int, e0: float, e1: float) -> float:
    """λ of the budget's row in e = λ n_b + λ' n_other; other −1: there is none."""
    n0, n1 = lines[1, budget], lines[2, budget]
    if other < 0:
        return float(e0 * n0 + e1 * n1)
    cross = n0 * lines[2, other] - n1 * lines[1, other]
    return float((e0 * lines[2, other] - e1 * lines[1, other]) / cross)


@woven
def _step(
    aim: Any, basis: Any, sign: float, x0: float, x1: float, distance: float, m: int, trust: float, on: Any
) -> tuple[float, float, float, float]:
    """The step from a place that was looked at, its gain, and the price that goes with it."""
    limit, price = aim
    local, lines = on[LOCAL], on[_ROWS:_FACTOR]
    r0, r1, c00, c01, c11 = _in_plane(basis, local)
    d0, d1, bent = x0 / distance, x1 / distance, sign / distance
    g0, g1 = sign * d0, sign * d1
    h00 = bent * (1.0 - d0 * d0) - price * c00
    h01 = -bent * d0 * d1 - price * c01
    h11 = bent * (1.0 - d1 * d1) - price * c11
    if not limit < np.inf:
        s0, s1, gain, _, _ = move_in_plane(g0 - price * r0, g1 - price * r1, h00, h01, h11, trust, m, on)
        return s0, s1, gain, price
    steep = max(np.sqrt(r0 * r0 + r1 * r1), TINY)
    lines[0, m], lines[1, m], lines[2, m] = (limit - local[0]) / steep, -r0 / steep, -r1 / steep
    s0, s1, gain, first, second = move_in_plane(g0, g1, h00, h01, h11, trust, m + 1, on)
    if first == m or second == m:
        # −(g + H s) = λ n_b (+ λ' n_r)
        e0, e1 = -g0 - h00 * s0 - h01 * s1, -g1 - h01 * s0 - h11 * s1
        price = max(_multiplier(lines, m, second if first == m else first, e0, e1) / steep, 0.0)
    elif lines[0, m] > _SHORTEST:
        price = 0.0
    return s0, s1, gain, price


@woven
def _first_price(basis: Any, local: Any, sign: float, x0: float, x1: float) -> float:
    """The budget's multiplier if the regret grew along y − p only."""
    r0 = basis[0, 0] * local[1] + basis[1, 0] * local[2] + basis[2, 0] * local[3]
    r1 = basis[0, 1] * local[1] + basis[1, 1] * local[2] + basis[2, 1] * local[3]
    lean = sign * (x0 * r0 + x1 * r1)
    return float(np.sqrt(x0 * x0 + x1 * x1) / lean) if lean > TINY else 0.0


@bare
def climb_three(
    ground: Ground, face: int, rules: Any, here: Here, aim: Any, z0: float, z1: float, on: Any
) -> tuple[bool, float, float, float, float, float]:
    """Climb from z on a face: whether an optimum was reached, its z, regret, privacy and price.

    aim: limit (infinite at a price), price (a first guess under a limit).
    """
    limit, price = aim
    sign, basis, local, faces = here.sign, rules.basis, on[LOCAL], ground.faces
    k, m, at, row_at = faces[face, SIZE], faces[face, N_ROWS], faces[face, CURVE_AT], faces[face, ROW_AT]
    has_budget = limit < np.inf
    trust, best, spent_there, from0, from1 = _TRUST, -np.inf, 0.0, z0, z1
    for _ in range(_ROUNDS):
        y0, y1, y2 = in_space(basis, z0, z1)
        # Two free coordinates are the most common: with the constant the loops over them are unrolled.
        if k == 2:
            least, near = look_three(ground, at, row_at, m, 2, rules, here, y0, y1, y2, trust, on)
        else:
            least, near = look_three(ground, at, row_at, m, k, rules, here, y0, y1, y2, trust, on)
        x0, x1 = z0 - here.p0, z1 - here.p1
        distance = np.sqrt(x0 * x0 + x1 * x1)
        if least == -np.inf or distance < KINK:
            break
        if has_budget and not price > 0.0:
            price = _first_price(basis, local, sign, x0, x1)
        value, spent = sign * distance - _ROW_WEIGHT * max(-least, 0.0), local[0]
        if has_budget:
            spent = _BUDGET_WEIGHT * max(local[0] - limit, 0.0)
        if value - price * spent < best - price * spent_there - CLIMB:
            trust = _SHORTER * np.sqrt((z0 - from0) ** 2 + (z1 - from1) ** 2)
            if trust < _SHORTEST:
                break
            z0, z1, best = from0, from1, -np.inf
            continue
        best, spent_there, from0, from1 = value, spent, z0, z1
        s0, s1, gain, price = _step((limit, price), basis, sign, x0, x1, distance, near, trust, on)
        if gain == -np.inf:
            break
        if least >= -rules.near and local[0] <= limit * (1.0 + BUDGET) and gain <= CLIMB:
            return True, z0, z1, max(local[0], 0.0), sign * distance, price
        z0 += s0
        z1 += s1
    return False, z0, z1, 0.0, 0.0, 0.0
