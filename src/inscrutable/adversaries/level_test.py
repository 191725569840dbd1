"""Whether the plausibility gaps of successive decisions reach a margin: cutting planes, reused from one decision to the next.

ρ(π,u) ≥ π·(s(u) − s(v)) for every decision v. Where no belief satisfies π·(s(u) − s(v_j)) ≤ level for all v_j found so far,
the plausibility gap is at least the level; otherwise the nearest belief that satisfies them is solved for and gives the next
plane.
"""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.plausibility import gap_compared, lowest_of_planes
from inscrutable.geometry.hulls import onto_simplex, sum_zero_basis
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_MOST_ROUNDS = 60  # a limit: 2,280 tests of decisions for 40 problems over two to eight states take at most 35
_ABOVE, _WITHIN = 0.2, 0.1
"""Shares of a gap's accuracy: how far the level lies above the margin, and how near to it a gap may stay undecided. With a
third or three times of either no answer of these 40 problems moves by 1e-6; with 0 for the second they take five times as
long."""


class LevelTest:
    """Decides for successive decisions whether the plausibility gap reaches a margin above zero.

    The answer is proved up to `tolerances.GAP_STEP` of the costs; an undecided case returns False.
    """

    def __init__(self, problem: DecisionProblem, margin: float) -> None:
        self._problem, self._margin = problem, margin
        n_states = problem.n_states
        self._centre = np.full(n_states, 1.0 / n_states)
        self._basis = np.ascontiguousarray(sum_zero_basis(n_states))
        self._solved = problem.state_costs(problem.solve(np.vstack([self._centre, np.eye(n_states)])))
        self._belief = self._centre

    def reaches(self, action: Array, *, proved: bool = True) -> bool:
        """Return whether r(u) = min_π ρ(π,u) is at least the margin for a decision (U,).

        Without `proved`, a projection that finds no belief below the level counts as proof that there is none.
        """
        own = np.asarray(self._problem.state_costs(action))
        for _ in range(_MOST_ROUNDS):
            planes = own - self._solved
            step = tolerances.GAP_STEP * float(np.abs(planes).max())
            level = self._margin + _ABOVE * step
            found = self._below(planes, level)
            if found is None:
                return not proved or self._proves(planes)
            self._belief = found
            solved = np.asarray(self._problem.state_costs(self._problem.solve(found)))
            if float(found @ (own - solved)) <= level + _WITHIN * step:
                return False
            self._learn(solved)
        return gap_compared(self._problem, action, self._margin) >= self._margin

    def _proves(self, planes: Array) -> bool:
        scale = max(float(np.abs(planes).max()), np.finfo(float).tiny)
        return lowest_of_planes(planes / scale)[0] * scale >= self._margin

    def _learn(self, solved: Array) -> None:
        self._solved = np.vstack([self._solved, solved])

    def _below(self, planes: Array, level: float) -> Array | None:
        """Return the belief nearest to the last one at which every plane is at most `level`."""
        from inscrutable.kernels.projection import project

        slopes = planes @ self._basis
        middle = planes @ self._centre
        lengths = np.sqrt((slopes**2).sum(axis=1))
        flat = lengths <= np.finfo(float).eps * np.abs(planes).max()
        if (middle[flat] > level).any():
            return None
        steep = ~flat
        sizes = np.sqrt((self._basis**2).sum(axis=1))
        if not self._basis.shape[1]:
            return self._centre
        rows = np.vstack([self._basis / sizes[:, None], -slopes[steep] / lengths[steep, None]])
        sides = np.concatenate([-self._centre / sizes, (middle[steep] - level) / lengths[steep]])
        place = self._basis.T @ (self._belief - self._centre)
        if not project(rows, sides, len(rows), 0, tolerances.STATIONARITY, place, np.empty(len(rows))):
            return None
        return np.asarray(onto_simplex((self._centre + self._basis @ place)[None])[0])
