"""The minimum over the simplex of a maximum of linear functions, by a linear programme that grows by cutting planes.

min_π max_j π·a_j over Δ_X is the value of a matrix game: max v with Σ_j w_j a_ji − z_i = v for every state i, Σ_j w_j = 1,
w ≥ 0, z ≥ 0. A basis has X + 1 columns. A new plane leaves the old basis feasible, so a few pivots of the simplex method solve
the larger programme; π and the value are the dual variables.
"""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.geometry.hulls import onto_simplex
from inscrutable.linear_programmes import LinearAnswer, Rows, minimum
from inscrutable.validation import Array

_MOST_EXCHANGES = 60
"""Pivots after which HiGHS takes over: the basis cycles or is nearly singular. 6,000 games of up to 20 states take at most 19,
and the 1,198 of 60 plausibility gaps at most 11."""


class PlaneGame:
    """Planes (n,X), scaled to entries of about one, and the minimum of their maximum, at least zero."""

    def __init__(self, planes: Array) -> None:
        self.planes = planes
        lowest = int(planes[0].argmin())
        n_states = planes.shape[1]
        # The first plane alone: its value is its least entry, all other states have slack.
        self._plane = [0]
        self._slack = [i for i in range(n_states) if i != lowest]

    def add(self, plane: Array) -> None:
        """Add a plane (X,), or several (n,X)."""
        self.planes = np.vstack([self.planes, plane])

    def lowest(self) -> tuple[float, Array]:
        """Return the value, or zero where it is negative, and a belief (X,) where it is reached."""
        for _ in range(_MOST_EXCHANGES):
            try:
                level, belief, inverse = self._multipliers()
            except np.linalg.LinAlgError:
                break
            gains = self.planes @ belief - level
            plane, state = int(gains.argmax()), int(belief.argmin())
            if max(gains[plane], -belief[state]) <= tolerances.PLANE_GAME:
                kept = np.maximum(belief, 0.0)
                return max(level, 0.0), kept / kept.sum()
            if not self._exchange(inverse, plane if gains[plane] >= -belief[state] else None, state):
                break
        answer = lowest_by_highs(self.planes)
        return answer.value, onto_simplex(answer.x[None, : self.planes.shape[1]])[0]

    def _multipliers(self) -> tuple[float, Array, Array]:
        n_states = self.planes.shape[1]
        basis = np.zeros((n_states + 1, n_states + 1))
        basis[:-1, 0] = -1.0
        used = len(self._plane)
        basis[:-1, 1 : used + 1] = self.planes[self._plane].T
        basis[-1, 1 : used + 1] = 1.0
        basis[self._slack, range(used + 1, n_states + 1)] = -1.0
        inverse = np.linalg.inv(basis)
        return float(inverse[0, -1]), -inverse[0, :-1], inverse

    def _exchange(self, inverse: Array, plane: int | None, state: int) -> bool:
        """Pivot: a plane or a state's slack enters for the column that reaches zero first; False where none does."""
        column = np.append(self.planes[plane], 1.0) if plane is not None else -np.eye(len(inverse))[state]
        change = (inverse @ column)[1:]
        held = np.maximum(inverse[1:, -1], 0.0)
        falls = change > tolerances.PLANE_GAME
        if not falls.any():
            return False
        ratios = np.full(len(change), np.inf)
        ratios[falls] = held[falls] / change[falls]
        leaves = int(ratios.argmin())
        names = [*self._plane, *self._slack]
        used = len(self._plane)
        del names[leaves]
        planes, slacks = names[: used - (leaves < used)], names[used - (leaves < used) :]
        if plane is not None:
            planes.append(plane)
        else:
            slacks.append(state)
        self._plane, self._slack = planes, slacks
        return bool(planes)


def lowest_by_highs(planes: Array) -> LinearAnswer:
    """Return the answer of min t with π·a_j ≤ t over beliefs and t ≥ 0; the variables are (π, t)."""
    n_states = planes.shape[1]
    return minimum(
        np.concatenate([np.zeros(n_states), [1.0]]),
        Rows(np.column_stack([planes, -np.ones(planes.shape[0])]), np.zeros(planes.shape[0])),
        Rows(np.concatenate([np.ones(n_states), [0.0]])[None], np.ones(1)),
        (0, None),
    )
