"""The beliefs cut into cells on which one decision is optimal, where the optimal cost is piecewise linear.

V is the minimum of s_v·π over finitely many decisions v. The minimum over the known ones is an upper bound of V, linear on
each of its cells; V is concave, so where both agree at all corners of a cell they agree on it. The oracle is asked at the
corners and cheaper decisions are added, until there are none: then the cells are those of V.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import HalfspaceIntersection, QhullError

from inscrutable import tolerances
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_FLOOR = -3.0  # below the normalised costs, which lie between 0 and 1
_TRIED_SHARE = 0.1
"""Share of the oracle calls that is tried where costs may be curved. It suffices for 28 of 30 tables of up to 80 choices over
two to five states, .03 for 27, and .3 for all; curved costs over two to six states take 176 to 827 of 10,000 in vain."""
_MOST_ENTRIES, _MOST_CORNERS = 20_000_000, 1e9
"""Limits of memory: corners times decisions, and a bound of a polytope's corners by its facets. 60 linear problems over two to
six states need at most a ninetieth and a seventieth of them."""


@dataclass(frozen=True, eq=False)
class Subdivision:
    """Cells of beliefs with their corners."""

    costs: Array  # (K,X) state costs of decisions that are optimal on a cell, above those of one decision
    actions: Array  # (K,U)
    corners: Array  # (W,X) of all cells
    tied: np.ndarray  # (W,K) whether a decision may be optimal at a corner
    members: np.ndarray  # (W,K) whether it surely is
    scale: float  # of costs
    rounding: float  # of costs, relative to their size before those of one decision are subtracted

    @property
    def on_border(self) -> np.ndarray:
        """Which corners (W,) give some state probability 0: decisions may be tied there that are optimal nowhere else."""
        return np.asarray((self.corners <= 0.0).any(axis=1))


class Subdivider:
    """Finds the cells of a problem with a limited number of calls of its oracle."""

    def __init__(self, problem: DecisionProblem, most_calls: int) -> None:
        self.problem = problem.without_common_costs
        self.most_calls = most_calls
        self.calls = 0
        n_states = problem.n_states
        self._asked: set[bytes] = set()
        self._common = self.problem.state_costs(self.problem.solve_points(np.full(n_states, 1.0 / n_states)))
        self._rounding = 0.0
        self._costs = np.zeros((0, n_states))
        self._actions = np.zeros((0, problem.n_actions))

    def found(self) -> Subdivision | None:
        """Return the cells, None where there are too many or V is not piecewise linear."""
        n_states = self.problem.n_states
        self._ask(np.vstack([np.eye(n_states), np.full(n_states, 1.0 / n_states)]))
        while True:
            if (len(self._costs) + n_states + 1) ** (n_states // 2) > _MOST_CORNERS:
                return None
            corners = _corners(self._costs, self._scale)
            if corners is None:
                return None
            fresh = [i for i, corner in enumerate(corners) if _key(corner) not in self._asked]
            if self.calls + len(fresh) > self.most_calls:
                return None
            if not fresh or not self._ask(corners[fresh]):
                return self._described(corners)

    @property
    def _scale(self) -> float:
        return float(np.abs(self._costs).max())

    def _ask(self, beliefs: Array) -> bool:
        """Add the decisions that are cheaper than all known at some of the beliefs (T,X); return whether there are any."""
        self.calls += len(beliefs)
        self._asked.update(_key(belief) for belief in beliefs)
        actions = self.problem.solve_points(beliefs)
        costs = np.atleast_2d(self.problem.state_costs(actions))
        self._rounding = max(self._rounding, tolerances.COST_ROUNDING * float(np.abs(costs).max()))
        costs = costs - self._common
        values = (beliefs * costs).sum(axis=1)
        scale = max(self._scale if len(self._costs) else 0.0, float(np.abs(costs).max()), tolerances.TINY)
        same = tolerances.SHARED_DECISION * scale + self._rounding
        below = np.flatnonzero(values < self._least(beliefs) - same)
        before = len(self._costs)
        for index in below:
            apart = np.abs(self._costs - costs[index]).max(axis=1, initial=np.inf if not len(self._costs) else 0.0)
            if not len(self._costs) or apart.min() > same:
                self._costs = np.vstack([self._costs, costs[index]])
                self._actions = np.vstack([self._actions, actions[index]])
        return len(self._costs) > before

    def _least(self, beliefs: Array) -> Array:
        return np.asarray((beliefs @ self._costs.T).min(axis=1, initial=np.inf))

    def _described(self, corners: Array) -> Subdivision | None:
        if len(corners) * len(self._costs) > _MOST_ENTRIES:
            return None
        values = corners @ self._costs.T
        above = values - values.min(axis=1, keepdims=True)
        size = max(self._scale, tolerances.TINY)
        tied, members = above <= tolerances.TIED * size + self._rounding, above <= tolerances.EXPLAINED * size
        return Subdivision(self._costs, self._actions, corners, tied, members, size, self._rounding)


def cells_of(problem: DecisionProblem, most_calls: int) -> tuple[Subdivision | None, int]:
    """Return the cells of a problem whose optimal cost is piecewise linear, and the calls of the oracle; None where it is
    not, or where they would be too many."""
    linear = problem.linear_form()
    # With less accurate costs a small cell could not be distinguished from an error.
    hopeless = problem.quadratic_form() is not None or problem.cost_accuracy > tolerances.COST_ACCURACY
    if linear is None and (hopeless or problem.costs_are_unique):
        return None, 0
    most = int(most_calls if linear is not None else _TRIED_SHARE * most_calls)
    subdivider = Subdivider(problem, most)
    return subdivider.found(), subdivider.calls


def _key(belief: Array) -> bytes:
    return np.asarray(np.round(belief / tolerances.SAME_BELIEF) + 0.0).tobytes()


def _corners(costs: Array, scale: float) -> Array | None:
    """Corners (W,X) of the cells of the least of known state costs (K,X)."""
    n_states = costs.shape[1]
    if n_states == 1:
        return np.ones((1, 1))
    least = costs.min(axis=0)
    # A cost that all decisions share moves no boundary.
    known = (costs - least) / max(float((costs - least).max()), tolerances.SHARED_DECISION * scale, tolerances.TINY)
    unit = np.eye(n_states - 1)
    rows = np.vstack(
        [
            np.column_stack([known[:, -1:] - known[:, :-1], np.ones(len(known)), -known[:, -1]]),
            np.column_stack([-unit, np.zeros((n_states - 1, 2))]),
            np.concatenate([np.ones(n_states - 1), [0.0, -1.0]])[None],
            np.concatenate([np.zeros(n_states - 1), [-1.0, _FLOOR]])[None],
        ]
    )
    middle = np.full(n_states, 1.0 / n_states)
    inside = np.append(middle[:-1], float((known @ middle).min()) - 1.0)
    try:
        points = HalfspaceIntersection(rows, inside).intersections
    except QhullError:
        return None
    points = points[np.isfinite(points).all(axis=1) & (points[:, -1] > 0.5 * (_FLOOR - 1.0))]
    beliefs = np.column_stack([points[:, :-1], 1.0 - points[:, :-1].sum(axis=1)])
    beliefs = np.where(beliefs <= tolerances.REACHED_BELIEF, 0.0, beliefs)
    beliefs /= beliefs.sum(axis=1, keepdims=True)
    _, first = np.unique(np.round(beliefs / tolerances.SAME_BELIEF), axis=0, return_index=True)
    return np.asarray(beliefs[np.sort(first)])
