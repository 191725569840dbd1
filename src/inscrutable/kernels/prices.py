"""The price of privacy at a single decision: how much more of it the next unit of budget buys."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.face_ascent import cost_model, set_distance_model
from inscrutable.kernels.faces import regret_slope, row_slope, row_value, settle
from inscrutable.kernels.options import kernel, part, whole
from inscrutable.kernels.projection import NO_EQUALITIES, project
from inscrutable.kernels.set_distance import cost_at, nearest_belief

_NONE = whole(0)


@part
def _add_line(slope: Any, basis: Any, sign: float, units: Any, count: int) -> float:
    """Row `count` = sign·slope in reduced coordinates at unit length; returns the length, 0 where it is void."""
    length = 0.0
    for c in range(units.shape[1]):
        total = 0.0
        for i in range(slope.size):
            total += basis[i, c] * slope[i]
        units[count, c] = sign * total
        length += total * total
    length = np.sqrt(length)
    if length <= 1e-14:
        return 0.0
    for c in range(units.shape[1]):
        units[count, c] /= length
    return float(length)


def budget_price(
    curves: Any, rows: Any, n_set_rows: int, scale: float, aim: Any, rules: Any, reach: float, y: Any, w: Any
) -> float:
    """∂Ψ/∂budget at the best decision w of a face, explained by y: the budget's multiplier η in

        ∇Ψ = η ∇ρ − Σ λ_r ∇f_r,  η, λ ≥ 0,  over the rows f_r that hold,

    by projection of ∇Ψ on the cone of the directions that budget and rows leave; 0 where the budget is not spent.
    Larger sets are followed in the decision's coordinates, single beliefs in the decoy's.
    """
    k = w.size - 1
    distance = float(np.linalg.norm(y - aim.point))
    spare = aim.limit - cost_at(curves, aim.belief, w) + aim.optimal_cost
    if spare > reach * aim.limit or not distance > 0.0:
        return 0.0
    if k >= rules.basis.shape[1] or not aim.sign > 0.0:
        return _price_by_decoys(curves, rows, aim, rules, reach, distance, y, w)
    return _price_by_sets(curves, rows, n_set_rows, scale, aim, rules, reach, distance, w) if k > 0 else 0.0


@kernel
def _price_by_decoys(
    curves: Any, rows: Any, aim: Any, rules: Any, reach: float, distance: float, y: Any, w: Any
) -> float:
    n_states, k, m = y.size, w.size - 1, rows.shape[0]
    factor, gradients, slopes = np.empty((k, k)), np.empty((n_states, k)), np.empty((n_states, k))
    trial, slope = np.empty(k + 1), np.empty(n_states)
    if not settle(curves, y, rules.pivot, trial, factor, gradients, slopes):
        return np.nan
    n = rules.basis.shape[1]
    units, pull, count = np.empty((m + 1, n)), np.zeros(n), _NONE
    regret_slope(aim.belief, gradients, slopes, slope)
    length = _add_line(slope, rules.basis, -1.0, units, count)
    count += 1
    for r in range(m):
        if row_value(rows[r], y, trial) <= reach:
            row_slope(rows[r], y, trial, slopes, slope)
            count += _add_line(slope, rules.basis, 1.0, units, count) > 0.0
    for c in range(n):
        for i in range(n_states):
            pull[c] += rules.basis[i, c] * aim.sign * (y[i] - aim.point[i]) / distance
    return _weight_of_first(units, count, pull, length)


@kernel
def _price_by_sets(
    curves: Any, rows: Any, n_set_rows: int, scale: float, aim: Any, rules: Any, reach: float, distance: float, w: Any
) -> float:
    n_states, k, m = aim.point.size, w.size - 1, rows.shape[0]
    held = np.empty((k + n_set_rows, n_states, k + 1))
    for r in range(k + n_set_rows):
        for i in range(n_states):
            for c in range(k + 1):
                held[r, i, c] = curves[i, r, c] / scale if r < k else rows[r - k, i, c]
    active, member = np.empty(k + n_set_rows, dtype=np.bool_), np.empty(n_states)
    nearest_belief(curves, rows[:n_set_rows], scale, w, aim.point, rules, member, active)
    slope, hessian, cost_slope, bend = np.zeros(k), np.empty((k, k)), np.empty(k), np.empty((k, k))
    set_distance_model(held, aim.point, rules.basis, w, member, active, slope, hessian)
    cost_model(curves, aim.belief, w, cost_slope, bend)
    units, count, same = np.empty((m + 1, k)), _NONE, np.zeros((k, k))
    for a in range(k):
        same[a, a] = 1.0
    length = _add_line(cost_slope, same, -1.0, units, count)
    count += 1
    for r in range(n_set_rows, m):
        if row_value(rows[r], member, w) <= reach:
            count += _add_line(rows[r, 0, :k], same, 1.0, units, count) > 0.0
    for a in range(k):
        slope[a] /= distance
    return _weight_of_first(units, count, slope, length)


@part
def _weight_of_first(units: Any, count: int, pull: Any, length: float) -> float:
    """Multiplier of the first row when `pull` is projected on the cone units·x ≥ 0."""
    if not length > 0.0:
        return np.nan
    multipliers = np.zeros(count)
    if not project(units[:count], np.zeros(count), count, NO_EQUALITIES, 1e-12, pull, multipliers):
        return np.nan
    return float(multipliers[0] / length)
