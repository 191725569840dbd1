"""Whether decisions are optimal under some belief and some cost between two members of a family: linear programmes.

For a parameter θ between θ_0 and θ_1, with gradients affine in θ and s = (θ − θ_0)/(θ_1 − θ_0), the condition of optimality
is Σ_i π_i ((1−s) G_i(θ_0) + s G_i(θ_1)) + A_act'λ + A_eq'ν = 0. With a separate s_i for each state the condition is linear in w
= (π_i (1−s_i), π_i s_i) ≥ 0: a relaxation whose error vanishes as θ_1 − θ_0 → 0. A decision known to ±δ in each coordinate
leaves the gradient uncertain by ε_i, which is also linear in w.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from inscrutable import tolerances
from inscrutable.adversaries.inverse import smooth_form_of
from inscrutable.linear_programmes import OPTIMAL, LinearAnswer, Rows, minimise, minimum
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_MORE = 10.0
"""A Farkas ray excludes solutions whose unknowns sum to at most this multiple of one plus the sum found. With 1 to 1,000, none
of 30 learned costs changes; nor does the time up to 30."""


class Conditions(NamedTuple):
    """The conditions of optimality of one decision under one cost, in the coordinates of its smooth form."""

    gradients: Array  # (U, X)
    errors: Array  # (U, X), at least 0
    normals: Array  # (U, n) of the tight rows
    equalities: Array  # (U, e)


def conditions_of(problem: DecisionProblem, actions: Array, rounding: float) -> list[Conditions]:
    """Return the conditions of decisions (T,U) known to ±`rounding` in each coordinate."""
    form = smooth_form_of(problem)
    region, points = form.constraints, form.variables(actions)
    gradients = form.gradients(points)
    errors = np.zeros_like(gradients)
    if rounding:
        for step in rounding * np.eye(points.shape[1]):
            ahead, back = form.gradients(points + step) - gradients, gradients - form.gradients(points - step)
            errors += np.maximum(np.abs(ahead), np.abs(back))
    reach = rounding * np.abs(region.A_ub).sum(axis=1) / region.row_scale
    tight = region.tight_rows(points) | (region.slacks(points) <= reach + tolerances.FEASIBILITY)
    return [
        Conditions(slopes.T, error.T, region.A_ub[rows].T, region.A_eq.T)
        for slopes, error, rows in zip(gradients, errors, tight, strict=True)
    ]


class Programme:
    """Conditions of one decision between two costs, as rows over (w, λ, ν, t): each coordinate's residual is at most t."""

    def __init__(self, low: Conditions, high: Conditions) -> None:
        gradients = np.hstack([low.gradients, high.gradients])
        errors = np.hstack([low.errors, high.errors])
        scale = float(np.abs(gradients).max()) or 1.0
        self.n_states = low.gradients.shape[1]
        self._gradients, self._errors = gradients / scale, errors / scale
        self._normals = np.hstack([low.normals, low.equalities])
        self._n_signed = low.normals.shape[1]

    def residual(self) -> float:
        """Return the least residual over all w: at most zero where the conditions have a solution."""
        columns, size = np.eye(2 * self.n_states), 2 * self.n_states
        return self._least(columns, np.zeros(size), Rows(np.ones((1, size)), np.ones(1)), (0.0, None)).value

    def explains(self, tolerance: float) -> bool:
        """Return whether the least residual is at most `tolerance`: by least squares if possible, else by linear programme."""
        found = None if self._errors.any() else self._by_squares(tolerance)
        return self.residual() <= tolerance if found is None else found

    def _by_squares(self, tolerance: float) -> bool | None:
        """Decide by non-negative least squares for G w + A'λ + E'ν = 0, Σ w = 1; None where they do not decide.

        A solution proves feasibility. The residual y proves infeasibility by Farkas' lemma if y'a ≤ 0 for every column a,
        because y'b > 0.
        """
        n_free = self._normals.shape[1] - self._n_signed
        columns = np.hstack([self._gradients, self._normals, -self._normals[:, self._normals.shape[1] - n_free :]])
        size = self._gradients.shape[1]
        matrix = np.vstack([columns, (np.arange(columns.shape[1]) < size).astype(np.float64)])
        target = (np.arange(len(matrix)) == len(matrix) - 1).astype(np.float64)
        try:
            found, length = nnls(matrix, target)
        except RuntimeError:
            return None
        whole = found[:size].sum()
        if whole > 0 and np.abs(columns @ found).max() <= tolerance * whole:
            return True
        ray = target - matrix @ found
        slack = length**2 - np.abs(ray).sum() * tolerance
        return False if max(float((ray @ matrix).max()), 0.0) * _MORE * (1.0 + found.sum()) < 0.5 * slack else None

    def residual_of(self, belief: Array) -> float:
        """Return the least residual of one belief (X,), with one parameter for all states."""
        nothing = np.zeros(self.n_states)
        columns = np.concatenate([-belief, belief])[:, None]
        # Coefficients below 1e-9, as of a narrow interval, would be dropped by the solver.
        change = float(np.abs(self._gradients @ columns).max()) or 1.0
        return self._least(columns / change, np.concatenate([belief, nothing]), None, (0.0, change)).value

    def extreme(self, direction: Array, most: float) -> float:
        """Return min direction·π over the beliefs with a residual of at most `most`; infinite where there are none."""
        size = 2 * self.n_states
        below, width = self._rows(np.eye(size), np.zeros(size))
        bounds = [*[(0.0, None)] * size, *self._multipliers(), (None, most)]
        objective = np.zeros(width)
        objective[:size] = np.tile(direction, 2)
        whole = Rows((np.arange(width) < size)[None].astype(np.float64), np.ones(1))
        answer = minimise(objective, below, whole, bounds)
        return answer.value if answer.status == OPTIMAL else np.inf

    def _least(
        self, columns: Array, fixed: Array, whole: Rows | None, bound: tuple[float | None, float | None]
    ) -> LinearAnswer:
        below, width = self._rows(columns, fixed)
        count = columns.shape[1]
        objective = np.zeros(width)
        objective[-1] = 1.0
        equal = None
        if whole is not None:
            equal = Rows(np.hstack([whole.matrix, np.zeros((1, width - count))]), whole.sides)
        return minimum(objective, below, equal, [*[bound] * count, *self._multipliers(), (None, None)])

    def _rows(self, columns: Array, fixed: Array) -> tuple[Rows, int]:
        """±(G w + A'λ + E'ν) − ε w ≤ t with w = fixed + columns y."""
        ones = np.ones((len(self._gradients), 1))
        plus, minus = self._gradients - self._errors, -self._gradients - self._errors
        matrix = np.vstack(
            [
                np.hstack([plus @ columns, self._normals, -ones]),
                np.hstack([minus @ columns, -self._normals, -ones]),
            ]
        )
        return Rows(matrix, -np.concatenate([plus @ fixed, minus @ fixed])), matrix.shape[1]

    def _multipliers(self) -> list[tuple[float | None, float | None]]:
        n_free = self._normals.shape[1] - self._n_signed
        return [*[(0.0, None)] * self._n_signed, *[(None, None)] * n_free]
