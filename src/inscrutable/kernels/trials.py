"""Trial decisions of a local search under quadratic costs, judged a handful at a time.

For a trial u: s_i(u) = ½u'H_i u + g_i'u + r_i, G = (H_i u + g_i)_i, the slack of every row, and the distance from a
reference belief to the consistent set {π : P Gπ = 0, Q Gπ ≥ 0}, where P and Q belong to the rows that are tight. The
formulas are those of `QuadraticProblem`, `Polyhedron` and `consistent_sets`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.belief_members import distance_in_hull
from inscrutable.kernels.belief_sets import LARGER, cut_hull, hull_of, room_for
from inscrutable.kernels.options import internal, kernel


class Costs(NamedTuple):
    """H (X,U,U), g (X,U), r (X,), and the least size of gradients that are not rounding."""

    hessians: Any
    linear: Any
    constants: Any
    least: float


class Region(NamedTuple):
    """Rows A u ≤ b with their largest coefficients, rows A u = b with theirs."""

    below: Any
    sides: Any
    scales: Any
    equal: Any
    equal_sides: Any
    equal_scales: Any


class Patterns(NamedTuple):
    """The tight patterns met so far: which rows (p, n), and P (p,k,U) and Q (p,m,U) with their numbers of rows (p, 2)."""

    tight: Any
    residual_rows: Any
    multiplier_rows: Any
    counts: Any


class Slack(NamedTuple):
    """Below which slack a row is tight to an observer, how far it may be violated, and the least slack to be played."""

    observed: float
    feasible: float
    least: float


class Sought(NamedTuple):
    """True belief π (X,), and privacy as `sign` times the distance from `point` (X,); −∞ beyond a violation of `far`."""

    belief: Any
    point: Any
    sign: float
    far: float


class Judged(NamedTuple):
    """What is said about n trials: cost π·s(u), its gradient (n,U), privacy (−∞ where no belief explains the trial, NaN
    where the caller must look), whether it may be played; and which rows (n,) the last one has tight."""

    costs: Any
    slopes: Any
    privacies: Any
    admissible: Any
    tight: Any


ALL, SOME = -1, -2
"""What `judge_trials` returns when it judged all trials, or all but those with a privacy of NaN."""


@internal
def _costs_of(u: Any, costs: Any, belief: Any, table: Any, mean: Any) -> float:
    """Write G (U,X) and Gπ; return π·s(u)."""
    n_states, size = costs.linear.shape
    cost = 0.0
    for j in range(size):
        mean[j] = 0.0
    for i in range(n_states):
        total = costs.constants[i]
        for j in range(size):
            slope = 0.0
            for k in range(size):
                slope += costs.hessians[i, j, k] * u[k]
            total += (0.5 * slope + costs.linear[i, j]) * u[j]
            slope += costs.linear[i, j]
            table[j, i] = slope
            mean[j] += belief[i] * slope
        cost += belief[i] * total
    return cost


@internal
def _rows_of(u: Any, region: Any, slack: Any, tight: Any) -> tuple[float, bool]:
    """Write which rows an observer counts as tight; return the largest violation and whether u may be played."""
    size = 1.0
    for value in u:
        size = max(size, abs(value))
    beyond, playable = 0.0, True
    for r in range(region.sides.size):
        total = 0.0
        for j in range(u.size):
            total += region.below[r, j] * u[j]
        left = (region.sides[r] - total) / region.scales[r]
        tight[r] = left < slack.observed
        beyond = max(beyond, -left)
        if left < slack.least and abs(left) > slack.feasible * size:
            playable = False
    for e in range(region.equal_sides.size):
        total = 0.0
        for j in range(u.size):
            total += region.equal[e, j] * u[j]
        beyond = max(beyond, abs(total - region.equal_sides[e]) / region.equal_scales[e])
    return beyond / size, playable and beyond / size <= slack.feasible


@internal
def _pattern_of(tight: Any, patterns: Any) -> int:
    for p in range(patterns.tight.shape[0]):
        same = True
        for r in range(tight.size):
            if patterns.tight[p, r] != tight[r]:
                same = False
                break
        if same:
            return p
    return -1


@internal
def _times(rows: Any, n_rows: int, table: Any, out: Any) -> None:
    """out = rows @ table."""
    for r in range(n_rows):
        for i in range(table.shape[1]):
            total = 0.0
            for j in range(table.shape[0]):
                total += rows[r, j] * table[j, i]
            out[r, i] = total


@internal
def _distance_to_ends(point: Any, ends: Any) -> float:
    length, inner = 0.0, 0.0
    for x in range(point.size):
        along = ends[1, x] - ends[0, x]
        length += along * along
        inner += (point[x] - ends[0, x]) * along
    share = min(max(inner / length, 0.0), 1.0) if length > 0.0 else 0.0
    squared = 0.0
    for x in range(point.size):
        off = point[x] - ends[0, x] - share * (ends[1, x] - ends[0, x])
        squared += off * off
    return float(np.sqrt(squared))


@internal
def _is_finite(u: Any) -> bool:
    total = 0.0
    for value in u:
        total += abs(value)
    return bool(np.isfinite(total))


@internal
def _scaled(table: Any, scale: float) -> None:
    """Divide by the largest entry, or by this scale where that is larger."""
    for j in range(table.shape[0]):
        for i in range(table.shape[1]):
            scale = max(scale, abs(table[j, i]))
    if scale > 0.0:
        for j in range(table.shape[0]):
            for i in range(table.shape[1]):
                table[j, i] /= scale


@kernel
def judge_trials(trials: Any, problem: Any, patterns: Any, goal: Any, basis: Any, limits: Any, judged: Any) -> int:
    """Judge trials (n,U). Returns the number of the first one whose tight pattern is not known and stops there, or `ALL`,
    or `SOME`. problem: (`Costs`, `Region`, `Slack`)."""
    costs, region, slack = problem
    n_states = basis.shape[0]
    k, m = patterns.residual_rows.shape[1], patterns.multiplier_rows.shape[1]
    table = np.empty((trials.shape[1], n_states))
    residuals, multipliers, ends = np.empty((k, n_states)), np.empty((m, n_states)), np.empty((2, n_states))
    hull = room_for(k, n_states)
    answer = ALL
    for t in range(trials.shape[0]):
        judged.privacies[t] = -np.inf
        if not _is_finite(trials[t]):
            judged.costs[t], judged.slopes[t], judged.admissible[t] = np.inf, 0.0, False
            continue
        violation, judged.admissible[t] = _rows_of(trials[t], region, slack, judged.tight)
        judged.costs[t] = _costs_of(trials[t], costs, goal.belief, table, judged.slopes[t])
        if violation > goal.far:
            continue
        known = _pattern_of(judged.tight, patterns)
        if known < 0:
            return t
        _scaled(table, costs.least)
        k, m = patterns.counts[known, 0], patterns.counts[known, 1]
        _times(patterns.residual_rows[known], k, table, residuals)
        _times(patterns.multiplier_rows[known], m, table, multipliers)
        distance = np.inf
        dimension, _, noise = hull_of(residuals, k, basis, limits, hull)
        if dimension >= LARGER:
            distance = distance_in_hull(residuals, multipliers, (k, m), dimension, limits, hull, goal.point)
        elif dimension >= 0 and cut_hull(multipliers, m, dimension, noise, limits, hull, ends) >= 0:
            distance = _distance_to_ends(goal.point, ends)
        if distance < np.inf:
            judged.privacies[t] = goal.sign * distance
        elif np.isnan(distance):
            judged.privacies[t] = np.nan
            answer = SOME
    return answer
