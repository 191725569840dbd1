"""Two states: the beliefs are a line, which is cut once into the stretches whose decisions are admissible.

On a ray from the true belief neither the regret nor, from decision to decision, the distance of what is consistent ever
falls. So the farthest decision under a budget is the last affordable one on either side, and the nearest to a
target is one of the two beside it. A stretch can be missed only where all rows are alike at both ends of a cell of 1/2,000.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from inscrutable import tolerances
from inscrutable.decision_makers.search.atlas import Atlas
from inscrutable.kernels.budget_end import budget_end
from inscrutable.kernels.climb import Aim
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array

_CUTS = 2000
"""Cells of the line in which changes of face are sought."""
_PROBES = 16
"""Places at which what is left between two changes is searched for more."""
_PROBINGS = 6
_TIGHT, _BETWEEN, _LOOSE = 0, 1, 2
_HALVINGS = 42  # of a cell: to the last digit of a share
_MOST_PLACES = 2


class Line(NamedTuple):
    """Stretches of beliefs (t, 1 − t), in order; each has admissible decisions and tight rows of its own."""

    low: Array  # (n,) where they begin
    high: Array  # (n,)
    low_costs: Array  # (n,2) state costs of the decisions there
    high_costs: Array  # (n,2)
    tight: np.ndarray  # (n,R)
    is_complete: bool  # whether every belief has one decision, so that no other is plausible


class Place(NamedTuple):
    """A decoy whose decision lies where these rows are tight; `inside` is a decoy of the same stretch."""

    tight: np.ndarray
    decoy: Array
    inside: Array


def line_of(atlas: Atlas) -> Line | None:
    """Return the line of an atlas, made at first use and kept with its candidates; None unless there are two states."""
    if atlas.problem.n_states != 2:
        return None
    return atlas.candidates.once("line", lambda: make_line(atlas.problem))


def make_line(problem: QuadraticProblem) -> Line:
    """Return the stretches of a problem with two states.

    Cost: some 2,000 forward solves, and about 100 for every change of a row.
    """
    shares, bands = _cut(problem)
    tight, allowed = bands == _TIGHT, (bands != _BETWEEN).all(axis=1)
    same = (tight[1:] == tight[:-1]).all(axis=1) & allowed[1:] & allowed[:-1]
    first = np.flatnonzero(allowed & ~np.append(False, same))
    last = np.flatnonzero(allowed & ~np.append(same, False))
    low, high = shares[first], shares[last]
    costs = [problem.state_costs(problem.solve(_beliefs(ends))) for ends in (low, high)]
    return Line(low, high, costs[0], costs[1], tight[first], _has_unique_decisions(problem))


def _cut(problem: QuadraticProblem) -> tuple[Array, np.ndarray]:
    """Shares in order, among them both ends of every change of a row's band, each the last of its own side, and probes
    between them; with the bands of their rows."""
    shares = np.linspace(0.0, 1.0, _CUTS + 1)
    bands = _bands(problem, shares)
    firsts, lasts = np.empty(0), np.empty(0)
    for _ in range(_PROBINGS):
        # Closer than beliefs are told apart, rounding alone decides.
        change = np.flatnonzero((bands[1:] != bands[:-1]).any(axis=1) & (np.diff(shares) > tolerances.SAME_BELIEF))
        left, right = shares[change], shares[change + 1]
        up, down = ~np.isin(left, lasts), ~np.isin(right, firsts)
        if not (up | down).any():
            break
        end = _last_of_side(problem, left[up], right[up], bands[change[up]])
        begin = _last_of_side(problem, right[down], left[down], bands[change[down] + 1])
        left[up] = end
        begin = np.maximum(begin, left[down] + tolerances.STATIONARITY)  # rounding lets the two ends pass each other
        right[down] = begin
        firsts, lasts = np.concatenate([firsts, begin]), np.concatenate([lasts, end])
        wide = right - left > tolerances.SAME_BELIEF
        probed = left[wide] + np.linspace(0.0, 1.0, _PROBES + 2)[1:-1, None] * (right - left)[wide]
        new = np.setdiff1d(np.concatenate([begin, end, probed.ravel()]), shares)
        shares, bands = np.concatenate([shares, new]), np.concatenate([bands, _bands(problem, new)])
        order = np.argsort(shares)
        shares, bands = shares[order], bands[order]
    return shares, bands


def _last_of_side(problem: QuadraticProblem, near: Array, far: Array, side: np.ndarray) -> Array:
    """Move places (n,) toward others, as far as their own bands (n,R) reach."""
    if not len(near):
        return near
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        same = (_bands(problem, middle) == side).all(axis=1)
        near, far = np.where(same, middle, near), np.where(same, far, middle)
    return near


def _bands(problem: QuadraticProblem, shares: Array) -> np.ndarray:
    """Whether each row is tight at the decision of each place, loose with room for rounding, or neither, as it may not be."""
    actions, region = problem.solve(_beliefs(shares)), problem.constraints
    slacks = region.slacks(actions)
    size = np.maximum(np.abs(actions).max(axis=1), 1.0)[:, None]
    return np.where(
        slacks <= tolerances.STATIONARITY * size, _TIGHT, np.where(slacks < region.played_slack, _BETWEEN, _LOOSE)
    )


def _beliefs(shares: Array) -> Array:
    return np.column_stack([shares, 1.0 - shares])


def _has_unique_decisions(problem: QuadraticProblem) -> bool:
    """Whether the cost of every state, and so of every belief, is strictly convex on the decisions."""
    rows = problem.constraints.A_eq
    span = null_space(rows) if len(rows) else np.eye(problem.n_actions)
    if not span.shape[1]:
        return True
    bends = np.linalg.eigvalsh(span.T @ problem.hessians @ span)
    return bool((bends[:, 0] > tolerances.PIVOT * bends[:, -1]).all())


def best_places(line: Line, atlas: Atlas, aim: Aim, pivot: float) -> list[Place]:
    """Return the affordable places among which the best decision for the aim is."""
    own = float(aim.belief[0])
    stretches = np.arange(len(line.low))
    low, high = np.maximum(line.low, 0.0), line.high.copy()
    most = aim.optimal_cost + aim.limit
    dear_low, dear_high = line.low_costs @ aim.belief > most, line.high_costs @ aim.belief > most
    kept = ~(((low > own) & dear_low) | ((high < own) & dear_high))
    for i in stretches[kept & (high > own) & dear_high]:
        high[i] = _end(line, atlas, aim, pivot, i, max(float(low[i]), own), float(high[i]))
    for i in stretches[kept & (low < own) & dear_low]:
        low[i] = _end(line, atlas, aim, pivot, i, min(float(line.high[i]), own), float(low[i]))
    stretches = stretches[kept]
    if not len(stretches):
        return []
    if aim.sign > 0.0:
        ends = [(stretches[0], low[stretches[0]]), (stretches[-1], high[stretches[-1]])]
    else:
        # Only what is along the line tells decoys apart.
        target = 0.5 * (1.0 + float(aim.point[0] - aim.point[1]))
        nearest = np.clip(target, low[stretches], high[stretches])
        order = np.argsort(np.abs(nearest - target), kind="stable")[:_MOST_PLACES]
        ends = [(stretches[i], nearest[i]) for i in order]
    return [_place(line, int(i), float(share)) for i, share in ends]


def _end(line: Line, atlas: Atlas, aim: Aim, pivot: float, i: int, near: float, far: float) -> float:
    """The last affordable share of a stretch from `near` to `far`."""
    curves = atlas.faces(line.tight[i]).curves
    share = budget_end(curves, aim, pivot, np.array([near, 1.0 - near]), np.array([far, 1.0 - far]))
    if np.isnan(share):
        return _end_by_solving(atlas.problem, aim, near, far)
    return near + share * (far - near)


def _end_by_solving(problem: QuadraticProblem, aim: Aim, near: float, far: float) -> float:
    """The same where copies of an asset leave a choice: by the decisions that the forward solver takes."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        cost = problem.state_costs(problem.solve(np.array([middle, 1.0 - middle]))) @ aim.belief
        near, far = (near, middle) if cost > aim.optimal_cost + aim.limit else (middle, far)
    return near


def _place(line: Line, i: int, share: float) -> Place:
    middle = 0.5 * float(line.low[i] + line.high[i])
    return Place(line.tight[i], np.array([share, 1.0 - share]), np.array([middle, 1.0 - middle]))
