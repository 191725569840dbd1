"""Faces of a feasible set on which linear costs are optimal: the tied decisions, and the cheapest admissible one."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.geometry import BeliefSet
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems import LinearForm
from inscrutable.problems.linear import without_common
from inscrutable.validation import Array

_HALF = 0.5


class FaceProgrammes:
    """Faces of the feasible set of linear costs, identified by the rows that are tight all over them."""

    def __init__(self, form: LinearForm) -> None:
        region = self.region = form.constraints
        self.costs = without_common(form.costs, region.A_eq)
        self._scale = region.row_scale if len(region.b_ub) else np.ones(0)
        self._rows = region.A_ub / self._scale[:, None]
        self._sides = region.b_ub / self._scale

    def tight_on(self, actions: Array) -> np.ndarray:
        """Return the rows (r,) that are tight at all of some decisions (k,U)."""
        slacks = self.region.slacks(actions)
        size = np.maximum(np.abs(actions).max(axis=1, keepdims=True), 1.0)
        return np.asarray((slacks <= tolerances.FEASIBILITY * size).all(axis=0))

    def optimal_at(self, belief: Array, known: Array) -> np.ndarray | None:
        """Return the rows (r,) that are tight at all decisions that are optimal for a belief, of which some are known
        (k,U); None where they cannot be determined."""
        tight = self.tight_on(known)
        asked = np.flatnonzero(tight)
        if not asked.size:
            return tight
        # Directions of constant cost from one of them along which the most rows become slack.
        count, width = asked.size, self.region.n_actions
        beside = self.tight_on(known[:1]) & ~tight
        gradient = belief @ self.costs
        size = float(np.abs(gradient).max())
        if size <= tolerances.TIED * float(np.abs(self.costs).max()):
            gradient, size = np.zeros(width), 1.0
        below = np.vstack(
            [
                np.column_stack([self._rows[asked], np.eye(count)]),
                _padded(np.vstack([self._rows[beside], gradient[None] / size]), count),
            ]
        )
        equal = _padded(self.region.A_eq, count)
        answer = minimise(
            np.append(np.zeros(width), -np.ones(count)),
            Rows(below, np.zeros(len(below))),
            Rows(equal, np.zeros(len(equal))),
            [(None, None)] * width + [(0.0, 1.0)] * count,
        )
        if answer.status != OPTIMAL:
            return None
        tight[asked[answer.x[width:] > _HALF]] = False
        return tight

    def explained(self, tight: np.ndarray) -> BeliefSet:
        """Return the beliefs for which decisions with exactly the rows `tight` are optimal."""
        rows = self.region.stationarity(tight)
        size = float(np.abs(self.costs).max())
        scaled = self.costs.T / (size if size > 0 else 1.0)
        return BeliefSet(rows.equalities @ scaled, rows.inequalities @ scaled)

    def cheapest(self, belief: Array, tight: np.ndarray) -> Array | None:
        """Return the admissible decision (U,) of least cost with exactly the rows `tight`, None where there is none."""
        return self._lowest(belief @ self.costs, tight)

    def beside(self, vertices: Array, tight: np.ndarray) -> Array:
        """Return for each of a face's vertices (k,U) the admissible decision with exactly the rows `tight` that leaves the
        vertex's other rows the least slack in all; shape (k,U), or (0,U) where there is none."""
        rows = [self.tight_on(vertex[None]) & ~tight for vertex in vertices]
        found = [self._lowest(-self._rows[near].sum(axis=0), tight) for near in rows]
        return np.array([each for each in found if each is not None]).reshape(-1, vertices.shape[1])

    def _lowest(self, gradient: Array, tight: np.ndarray) -> Array | None:
        region, slack = self.region, ~tight
        least = (
            max(region.min_slack, tolerances.SLACK_SAFETY) * (1.0 + tolerances.SLACK_SAFETY) + tolerances.FEASIBILITY
        )
        size = float(np.abs(gradient).max())
        answer = minimise(
            gradient / (size if size > 0 else 1.0),
            Rows(self._rows[slack], self._sides[slack] - least),
            Rows(
                np.vstack([self._rows[tight], region.A_eq]),
                np.concatenate([self._sides[tight], region.b_eq]),
            ),
        )
        if answer.status != OPTIMAL:
            return None
        action = answer.x
        for limit in region.coordinate_bounds:
            near = np.abs(action - limit) <= tolerances.FEASIBILITY * np.maximum(1.0, np.abs(action))
            action = np.where(near, limit, action)
        return np.asarray(action) + 0.0


def _padded(matrix: Array, count: int) -> Array:
    """Rows of a programme with further variables of coefficient 0."""
    return np.column_stack([matrix, np.zeros((len(matrix), count))])
