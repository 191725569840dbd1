"""The best decisions on the border of those that some belief explains, where the consistent sets of a region are larger.

On the border a single belief y explains the decision, and the distance to the set has no useful gradient: the search varies y
and holds its zero probabilities. With g_i the gradients of the states' costs at the decision, and S the states of y, no other
belief explains it where a direction λ has λ·g_i = 0 in S and λ·g_j > 0 outside: a change z of the belief with Σ z_i g_i = 0 and
z_j ≥ 0 outside S is zero there. As the decision moves, λ turns so that λ·g_i stays zero in S. With g_j = Σ μ_i g_i + a part
across these,

    ∂(λ·g_j)/∂w = λ'(C_j − Σ μ_i C_i).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.climb import NO_GAIN, PROJECTED, climb, decide_on_face
from inscrutable.kernels.copies import put
from inscrutable.kernels.face_sets import decision_value, is_allowed
from inscrutable.kernels.faces import cholesky, solve_factored
from inscrutable.kernels.options import internal, uncounted
from inscrutable.kernels.projection import at_unit_length, project_in, room_for
from inscrutable.kernels.rounding import FLAT
from inscrutable.kernels.set_distance import Face

_HALVINGS = 12
"""Halvings of a step that crosses a boundary. With 20, no privacy is larger by 1e-5 of itself; with six, 16 of 960 decisions
lose up to .4 %, and 37 lotteries up to 1.3 %."""
_IMPOSSIBLE = 1e-5
"""A probability that counts as zero on a boundary: climbs leave more of it than rounding. With 1e-6 two of 960 lotteries lose,
up to 18 %; with 1e-4 one of them and two decisions gain, up to .3 %."""
_APART = 1e-5  # least λ·g_j, in units of the gradients: closer to zero, rounding lets other beliefs explain a decision as well
_TURNS = 12
"""Climbs along a boundary of the border, each with the rows of the last. Without them 33 of 480 decisions over five states and
four assets lose up to 4.3 %, and of 3,000 decisions and lotteries over four to six states 24 lose, up to 1.8 %, in the same
time. With six, one of 14 such decisions loses .05 %."""


@uncounted
def is_on_border(y: Any, k: int) -> bool:
    """Whether a belief in at most k of the states explains a decision with k free coordinates.

    The decisions of such beliefs have fewer dimensions than the region: they bound the decisions that some belief explains.
    """
    n_likely = 0
    for i in range(y.size):
        n_likely += y[i] > _IMPOSSIBLE
    return bool(2 <= n_likely <= min(k, y.size - 1))


@internal
def _directions_between(y: Any) -> Any:
    """Orthonormal directions (X, S−1) in which the S probabilities above zero change and their sum does not: Helmert's."""
    n_likely = 0
    for i in range(y.size):
        n_likely += y[i] > 0.0
    basis, before = np.zeros((y.size, n_likely - 1)), 0
    for i in range(y.size):
        if y[i] > 0.0:
            for j in range(i):
                if before > 0 and y[j] > 0.0:
                    basis[j, before - 1] = 1.0 / np.sqrt(before * (before + 1.0))
            if before > 0:
                basis[i, before - 1] = -before / np.sqrt(before * (before + 1.0))
            before += 1
    return basis


@uncounted
def _in_order(y: Any, order: Any) -> int:
    """Fill `order` (X−1,) with the states of y but the likeliest, then with the others; returns how many the first are.

    The gradients of y's states depend on one another, Σ y_i g_i = 0; without the likeliest they do not.
    """
    top, last = 0, 0
    for i in range(y.size):
        if y[i] > y[top]:
            top = i
    for is_likely in (True, False):
        for i in range(y.size):
            if i != top and (y[i] > 0.0) == is_likely:
                order[last] = i
                last += 1
        if is_likely:
            n_likely = last
    return n_likely


@uncounted
def _shares(gradients: Any, order: Any, factor: Any, vector: Any, mu: Any) -> None:
    """Fill μ of the vector's part Σ μ_i g_i, with the factor of the products g_i·g_j."""
    for e in range(mu.size):
        mu[e] = 0.0
        for a in range(vector.size):
            mu[e] += gradients[order[e], a] * vector[a]
    solve_factored(factor, mu.size, mu)


@internal
def _turn(gradients: Any, order: Any, factor: Any, direction: Any) -> bool:
    """Replace λ by the direction with the largest least angle to the border; where there is none by its part across the
    gradients of y's states. False where none is left."""
    k, n_likely, last = direction.size, factor.shape[0], order.size
    units, sides, mu = np.empty((last, k)), np.zeros(last), np.empty(n_likely)
    found, weights = np.zeros(k), np.empty(last)
    for e in range(last):
        put(gradients[order[e]], units[e])
        at_unit_length(units[e], 0.0)
    sides[n_likely:] = 1.0
    if project_in(units, sides, last, n_likely, PROJECTED, found, weights, room_for(k, last)):
        put(found, direction)
    else:
        _shares(gradients, order, factor, direction, mu)
        for e in range(n_likely):
            for a in range(k):
                direction[a] -= mu[e] * gradients[order[e], a]
    length, _ = 0.0, at_unit_length(direction, 0.0)
    for a in range(k):
        length += direction[a] * direction[a]
    return bool(length > 0.5)


@internal
def _border_rows(face: Any, y: Any, w: Any, direction: Any, rows: Any) -> bool:
    """Fill the rows (X, X, k+1) of λ·g_j, and replace λ; the rows of y's states are void. False where there is no λ."""
    n_states, k = y.size, w.size - 1
    gradients, order = np.empty((n_states, k)), np.empty(n_states - 1, dtype=np.int64)
    for i in range(n_states):
        for a in range(k):
            gradients[i, a] = 0.0
            for c in range(k + 1):
                gradients[i, a] += face.curves[i, a, c] * w[c] / face.scale
    n_likely = _in_order(y, order)
    factor, mu = np.empty((n_likely, n_likely)), np.empty(n_likely)
    for e in range(n_likely):
        for f in range(n_likely):
            factor[e, f] = 0.0
            for a in range(k):
                factor[e, f] += gradients[order[e], a] * gradients[order[f], a]
    if not cholesky(factor, n_likely, FLAT) or not _turn(gradients, order, factor, direction):
        return False
    for j in order[n_likely:]:
        _shares(gradients, order, factor, gradients[j], mu)
        for c in range(k + 1):
            total = 0.0
            for a in range(k):
                curve = face.curves[j, a, c]
                for e in range(n_likely):
                    curve -= mu[e] * face.curves[order[e], a, c]
                total += direction[a] * curve / face.scale
            for i in range(n_states):
                rows[j, i, c] = total - _APART if c == k else total
    return True


@internal
def climb_border(face: Any, aim: Any, basis: Any, y: Any, w: Any, room: Any) -> float:
    """Improve y and its decision w with y's zero probabilities held; returns the budget's multiplier, 0 where it is not known.

    Beyond a boundary of the border nearer beliefs explain the decisions: the last decision before it is found by bisection.
    """
    for i in range(y.size):
        if y[i] <= _IMPOSSIBLE:
            y[i] = 0.0
    held = _directions_between(y)
    end, trial, there = y.copy(), y.copy(), w.copy()
    best, low, high, share = decision_value(face, aim, basis, w, room.member, room.distance), 0.0, 1.0, 1.0
    loss, weight = climb(face, aim, held, end, there)
    if not loss < np.inf:
        return 0.0
    for _ in range(_HALVINGS):
        value = decision_value(face, aim, basis, there, room.member, room.distance)
        if value > best and is_allowed(face, aim, there):
            best, low = value, share
            put(there, w)
            if share == 1.0:
                break
        else:
            high = share
        share = 0.5 * (low + high)
        for i in range(y.size):
            trial[i] = (1.0 - share) * y[i] + share * end[i]
        decide_on_face(face, trial, there)
    for i in range(y.size):
        y[i] = (1.0 - low) * y[i] + low * end[i]
    # Between two states the boundary is a point, and found.
    return float(weight) if low == 1.0 else _follow_boundary(face, aim, basis, held, (y, w, best), room)


@internal
def _follow_boundary(face: Any, aim: Any, basis: Any, held: Any, found: Any, room: Any) -> float:
    """Improve (y, w, value) along a boundary of the border; returns the budget's multiplier, 0 where it is not known.

    Each climb has the rows of the boundary where the last one ended.
    """
    y, w, best = found
    end, there, direction, multiplier, loss = y.copy(), w.copy(), np.zeros(w.size - 1), 0.0, 0.0
    m = face.rows.shape[0]
    rows = np.zeros((m + y.size, y.size, w.size))
    rows[:m] = face.rows
    rows[m:, :, w.size - 1] = 1.0
    bounded = Face(face.curves, rows, face.n_set_rows, face.scale)
    for _ in range(_TURNS if held.shape[1] > 1 else 0):
        if not _border_rows(face, end, there, direction, rows[m:]):
            break
        former = loss
        loss, weight = climb(bounded, aim, held, end, there)
        if not loss < np.inf or abs(loss - former) <= NO_GAIN:
            break
        value = decision_value(face, aim, basis, there, room.member, room.distance)
        if value > best and is_allowed(face, aim, there):
            best, multiplier = value, float(weight)
            put(there, w)
            put(end, y)
    return multiplier
