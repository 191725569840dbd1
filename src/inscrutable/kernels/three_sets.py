"""Decisions that several beliefs explain, for three states: segments along an edge's decisions, and polygons.

On a face with one free coordinate v the gradients a_i = C_i00 v + C_i01 are affine, so the beliefs of a decision are a
segment of the line {y : a·y = 0, 1·y = 1}: its point nearest to p, and how that distance changes with v, are closed forms.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import bare, woven
from inscrutable.kernels.three_states import (
    CURVE_AT,
    N_ROWS,
    N_SET_ROWS,
    ROW_AT,
    Ground,
    Here,
    in_space,
)
from inscrutable.tolerances import EXPLAINED, LENGTH, POLISH, TINY

_SECTIONS = 40
_FIRST, _SHARE = 1e-6, 1.0 / 64.0  # of the edge: a step that tells whether to move at all, and the first that does
_LEAST_SHARE = 0.05  # of a bracket that false position must cut off
_FAR = 2.0  # beyond the diameter of the simplex
_OUTSIDE = 1e6  # beyond every edge
_NOTHING = (False, 0.0, 0.0, 0.0, 0.0, 0.0)
_NARROW = 1e-9  # share of the edge below which a bracket is closed


@woven
def _turning_end(
    rows: Any,
    j: int,
    v: float,
    a: tuple[float, float, float],
    e: tuple[float, float, float],
    x: tuple[float, float, float],
) -> float:
    """x·dy/dv for the end of a segment, y = a × g over the sum of its entries, with g the coefficients of the row at j."""
    a0, a1, a2 = a
    e0, e1, e2 = e
    h0, h1, h2 = rows[j], rows[j + 2], rows[j + 4]
    g0, g1, g2 = h0 * v + rows[j + 1], h1 * v + rows[j + 3], h2 * v + rows[j + 5]
    q0, q1, q2 = a1 * g2 - a2 * g1, a2 * g0 - a0 * g2, a0 * g1 - a1 * g0
    w0 = e1 * g2 - e2 * g1 + a1 * h2 - a2 * h1
    w1 = e2 * g0 - e0 * g2 + a2 * h0 - a0 * h2
    w2 = e0 * g1 - e1 * g0 + a0 * h1 - a1 * h0
    total = q0 + q1 + q2
    share = (w0 + w1 + w2) / total
    return float((x[0] * (w0 - q0 * share) + x[1] * (w1 - q1 * share) + x[2] * (w2 - q2 * share)) / total)


@woven
def _ends(
    rows: Any, first: int, m: int, v: float, f: tuple[float, float, float], d: tuple[float, float, float]
) -> tuple[float, float, int, int]:
    """The steps s along f + s d that rows ≥ 0 allow, low > high where there are none, and the rows that end them."""
    low, high, end_low, end_high = -_FAR, _FAR, -1, -1
    for r in range(m):
        j = first + 6 * r
        g0, g1, g2 = rows[j] * v + rows[j + 1], rows[j + 2] * v + rows[j + 3], rows[j + 4] * v + rows[j + 5]
        value, speed = f[0] * g0 + f[1] * g1 + f[2] * g2, d[0] * g0 + d[1] * g1 + d[2] * g2
        if abs(speed) <= LENGTH:
            if value < -EXPLAINED:
                high = -np.inf
        elif speed > 0.0:
            if -value / speed > low:
                low, end_low = -value / speed, j
        elif -value / speed < high:
            high, end_high = -value / speed, j
    return low, high, end_low, end_high


@bare
def segment_of_line(
    ground: Ground, face: int, v: float, p0: float, p1: float, p2: float
) -> tuple[bool, float, float, float, float, float]:
    """Whether a belief explains the decision v; the distance of p from those that do, its derivative, and the nearest."""
    curves, at = ground.curves, ground.faces[face, CURVE_AT]
    e0, e1, e2 = curves[at], curves[at + 4], curves[at + 8]
    a0, a1, a2 = e0 * v + curves[at + 1], e1 * v + curves[at + 5], e2 * v + curves[at + 9]
    mean = (a0 + a1 + a2) / 3.0
    c0, c1, c2 = a0 - mean, a1 - mean, a2 - mean
    square = c0 * c0 + c1 * c1 + c2 * c2
    if not square > LENGTH * LENGTH * (a0 * a0 + a1 * a1 + a2 * a2):
        return _NOTHING
    off = a0 * p0 + a1 * p1 + a2 * p2
    f0, f1, f2 = p0 - off / square * c0, p1 - off / square * c1, p2 - off / square * c2
    length = np.sqrt(3.0 * square)
    d0, d1, d2 = (a1 - a2) / length, (a2 - a0) / length, (a0 - a1) / length
    low, high, end_low, end_high = _ends(
        ground.rows, ground.faces[face, ROW_AT], ground.faces[face, N_SET_ROWS], v, (f0, f1, f2), (d0, d1, d2)
    )
    if low > high + EXPLAINED:
        return _NOTHING
    if low <= 0.0 <= high:
        lean = e0 * p0 + e1 * p1 + e2 * p2
        turn = e0 * c0 + e1 * c1 + e2 * c2
        root = np.sqrt(square)
        slope = lean / root - off * turn / (square * root)
        return True, abs(off) / root, slope if off > 0.0 else -slope, f0, f1, f2
    s, end = (low, end_low) if low > 0.0 else (high, end_high)
    x0, x1, x2 = f0 + s * d0 - p0, f1 + s * d1 - p1, f2 + s * d2 - p2
    distance = np.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
    slope = _turning_end(ground.rows, end, v, (a0, a1, a2), (e0, e1, e2), (x0, x1, x2)) / max(distance, TINY)
    return True, distance, slope, x0 + p0, x1 + p1, x2 + p2


@woven
def _reach(ground: Ground, face: int, bend: float, lean: float, over: float) -> tuple[float, float, float, float]:
    """What the slacks of an edge allow, and what a budget leaves of it: ½ bend v² + lean v + over ≤ 0."""
    rows = ground.rows
    least, most = -_OUTSIDE, _OUTSIDE
    for r in range(ground.faces[face, N_SET_ROWS], ground.faces[face, N_ROWS]):
        j = ground.faces[face, ROW_AT] + 6 * r
        if rows[j] > LENGTH:
            least = max(least, -rows[j + 1] / rows[j])
        elif rows[j] < -LENGTH:
            most = min(most, -rows[j + 1] / rows[j])
    left, right = least, most
    if over > -np.inf and bend > 0.0:
        square = lean * lean - 2.0 * bend * over
        if square < 0.0:
            return least, most, np.inf, -np.inf
        root = np.sqrt(square)
        left, right = max(left, (-lean - root) / bend), min(right, (-lean + root) / bend)
    return least, most, left, right


@woven
def _uphill(
    ground: Ground,
    face: int,
    y: tuple[float, float, float],
    terms: tuple[float, float, float, float],
    ends: tuple[float, float],
    v: float,
    wide: float,
) -> tuple[bool, float, float, float]:
    """From v to where sign·distance − price·regret grows no more: whether any belief explains v, where, distance, way.

    terms: sign, price, bend and lean of the regret. Steps grow until the way falls or ends; then false position.
    """
    sign, price, bend, lean = terms
    found, held, slope, _, _, _ = segment_of_line(ground, face, v, y[0], y[1], y[2])
    best = v
    uphill = sign * slope - price * (bend * v + lean)
    way = 1.0 if uphill > 0.0 else -1.0
    step, far, near_slope, far_slope, bracketed = wide * _FIRST, v, abs(uphill), 0.0, False
    for _ in range(_SECTIONS if found else 0):
        if bracketed:
            if abs(far - best) <= _NARROW * wide or near_slope * abs(far - best) <= POLISH:
                break
            share = 0.5
            if far_slope < 0.0:
                share = min(max(near_slope / (near_slope - far_slope), _LEAST_SHARE), 1.0 - _LEAST_SHARE)
            trial = best + share * (far - best)
        else:
            trial = min(max(v + way * step, ends[0]), ends[1])
            if trial == best:
                break
            step = wide * _SHARE if step < wide * _SHARE else 2.0 * step
        explained, distance, slope, _, _, _ = segment_of_line(ground, face, trial, y[0], y[1], y[2])
        climbs = way * (sign * slope - price * (bend * trial + lean))
        if explained and climbs > 0.0:
            # Where the far end stays, its weight is halved.
            far_slope *= 0.5
            best, held, near_slope = trial, distance, climbs
        else:
            if bracketed:
                near_slope *= 0.5
            far, far_slope, bracketed = trial, climbs if explained else 0.0, True
            if explained and -climbs * abs(trial - best) <= POLISH:
                break
    return found, best, held, way


@bare
def climb_line(
    ground: Ground, face: int, rules: Any, here: Here, aim: Any, v: float
) -> tuple[bool, float, float, float, float]:
    """The best decision of an edge uphill from v: whether one is allowed, where, its regret, privacy and price.

    aim: limit, price; one of them is in force.
    """
    limit, price = aim
    sign = here.sign
    curves, at = ground.curves, ground.faces[face, CURVE_AT]
    y0, y1, y2 = in_space(rules.basis, here.p0, here.p1)
    b0, b1, b2 = here.b0, here.b1, here.b2
    bend = b0 * curves[at] + b1 * curves[at + 4] + b2 * curves[at + 8]
    lean = b0 * curves[at + 1] + b1 * curves[at + 5] + b2 * curves[at + 9]
    base = 0.5 * (b0 * curves[at + 3] + b1 * curves[at + 7] + b2 * curves[at + 11]) - here.optimal
    least, most, left, right = _reach(ground, face, bend, lean, base - limit)
    if left > right:
        return False, v, 0.0, 0.0, 0.0
    v = min(max(v, left), right)
    terms = (sign, price if limit == np.inf else 0.0, bend, lean)
    found, best, held, way = _uphill(ground, face, (y0, y1, y2), terms, (left, right), v, most - least)
    if not found:
        return False, v, 0.0, 0.0, 0.0
    if limit < np.inf:
        price = 0.0
        steep = way * (bend * best + lean)
        if best in (left, right) and best not in (least, most) and steep > 0.0:
            _, _, slope, _, _, _ = segment_of_line(ground, face, best, y0, y1, y2)
            price = max(sign * way * slope / steep, 0.0)
    return True, best, max(base + best * (lean + 0.5 * bend * best), 0.0), sign * held, price


@bare
def climb_edge(
    ground: Ground, face: int, rules: Any, here: Here, aim: Any, z0: float, z1: float
) -> tuple[bool, float, float, float, float, float]:
    """Climb from the decision of z on an edge: whether all went well, a belief's z, regret, privacy and price.

    aim: limit (infinite at a price), price.
    """
    curves, at, basis = ground.curves, ground.faces[face, CURVE_AT], rules.basis
    y0, y1, y2 = in_space(basis, z0, z1)
    bend = y0 * curves[at] + y1 * curves[at + 4] + y2 * curves[at + 8]
    if not bend > 0.0:
        return False, z0, z1, 0.0, 0.0, 0.0
    v = -(y0 * curves[at + 1] + y1 * curves[at + 5] + y2 * curves[at + 9]) / bend
    ok, v, regret, privacy, price = climb_line(ground, face, rules, here, aim, v)
    if ok:
        q0, q1, q2 = in_space(basis, here.p0, here.p1)
        _, _, _, y0, y1, y2 = segment_of_line(ground, face, v, q0, q1, q2)
        z0 = basis[0, 0] * y0 + basis[1, 0] * y1 + basis[2, 0] * y2
        z1 = basis[0, 1] * y0 + basis[1, 1] * y1 + basis[2, 1] * y2
    return ok, z0, z1, regret, privacy, price


@bare
def polygon_distance(ground: Ground, face: int, rules: Any, p0: float, p1: float) -> float:
    """Distance of a point of the plane from the beliefs that explain a face's one decision; infinite where there are none."""
    rows, basis = ground.rows, rules.basis
    first, m = ground.faces[face, ROW_AT], ground.faces[face, N_SET_ROWS]
    inside, best = True, np.inf
    for r in range(m):
        j = first + 3 * r
        n0 = basis[0, 0] * rows[j] + basis[1, 0] * rows[j + 1] + basis[2, 0] * rows[j + 2]
        n1 = basis[0, 1] * rows[j] + basis[1, 1] * rows[j + 1] + basis[2, 1] * rows[j + 2]
        value = (rows[j] + rows[j + 1] + rows[j + 2]) / 3.0 + n0 * p0 + n1 * p1
        if value >= 0.0:
            continue
        inside = False
        length = np.sqrt(n0 * n0 + n1 * n1)
        if not length > LENGTH:
            return np.inf
        b0, b1 = p0 - value * n0 / length**2, p1 - value * n1 / length**2
        t0, t1 = -n1 / length, n0 / length
        low, high = -_FAR, _FAR
        for q in range(m):
            if q == r:
                continue
            j = first + 3 * q
            n0 = basis[0, 0] * rows[j] + basis[1, 0] * rows[j + 1] + basis[2, 0] * rows[j + 2]
            n1 = basis[0, 1] * rows[j] + basis[1, 1] * rows[j + 1] + basis[2, 1] * rows[j + 2]
            value = (rows[j] + rows[j + 1] + rows[j + 2]) / 3.0 + n0 * b0 + n1 * b1
            speed = n0 * t0 + n1 * t1
            if abs(speed) <= LENGTH:
                if value < -EXPLAINED:
                    high = -np.inf
            elif speed > 0.0:
                low = max(low, -value / speed)
            else:
                high = min(high, -value / speed)
        if low <= high + EXPLAINED:
            step = min(max(0.0, low), high)
            x0, x1 = b0 + step * t0 - p0, b1 + step * t1 - p1
            best = min(best, np.sqrt(x0 * x0 + x1 * x1))
    return 0.0 if inside else best
