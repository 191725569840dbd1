"""Expected returns implied by rounded weights: outer intervals, and membership by a forward solve.

The views that explain some weights w within half a digit are a union of polyhedra, one per active set. The intervals bound a
larger convex set: every w of the rounding cell with every multiplier of a row that is active at some w of the cell.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array, hstack, vstack

from inscrutable import tolerances
from inscrutable.alphas.problem import AlphaProblem
from inscrutable.alphas.risk import FactorRisk
from inscrutable.alphas.view_sets import ViewSet
from inscrutable.errors import InputError
from inscrutable.linear_programmes import OPTIMAL, Bound, Rows, minimise
from inscrutable.validation import Array

_BLOCK = 500_000


class RoundedViews(ViewSet):
    """Views m whose optimal decision rounds to the published weights.

    Args:
        problem: The decision problem.
        weights: u, shape (n,), as published.
        digits: Digits after the point; the decision is within half a unit of the last one.
    """

    def __init__(self, problem: AlphaProblem, weights: Array, digits: int) -> None:
        self.problem, self.weights = problem, weights
        self.half = 0.5 * 10.0**-digits * (1.0 + tolerances.FEASIBILITY)
        layout, n = problem.layout, problem.n_assets
        lower, upper = (np.full(n, -np.inf), np.full(n, np.inf)) if layout is None else (layout.lower, layout.upper)
        self.low, self.high = np.maximum(weights - self.half, lower), np.minimum(weights + self.half, upper)
        self._at_low, self._at_high = self.low <= lower, self.high >= upper  # may be active
        general = np.zeros((0, n)) if layout is None else layout.general
        most = np.maximum(general * self.low, general * self.high).sum(axis=1)
        self._tight = general[most >= layout.sides] if layout is not None else general

    @cached_property
    def _is_possible(self) -> bool:
        layout = self.problem.layout
        if (self.low > self.high).any():
            return False
        if layout is None:
            return True
        below, exact = Rows(layout.general, layout.sides), Rows(layout.equalities, layout.equality_sides)
        return minimise(np.zeros(len(self.low)), below, exact, self._cell).status == OPTIMAL

    @property
    def _cell(self) -> list[Bound]:
        return list(zip(self.low.tolist(), self.high.tolist(), strict=True))

    @property
    def dimension(self) -> int:
        """The number of signals; −1 where no decision of C rounds to the weights."""
        return self.problem.n_signals if self._is_possible else -1

    @property
    def gap(self) -> float:
        """0 where a decision of C rounds to the weights, else infinite."""
        return 0.0 if self._is_possible else np.inf

    def signal_bounds(self, reference: Array | None, wanted: np.ndarray) -> Array:
        """Return an interval around every m_j: by two linear programmes where there are loadings."""
        if self.problem.loadings is None:
            return self.asset_bounds(reference, wanted)
        return self._lifted(np.eye(self.problem.n_signals)[wanted])

    def asset_bounds(self, reference: Array | None, wanted: np.ndarray) -> Array:
        """Return an interval around every (Bm)_i − ρ'Bm: greedy for bounds and one budget row, else two linear programmes."""
        loads, n = self.problem.loadings, self.problem.n_assets
        if loads is not None:
            return self._lifted(loads[wanted] - (0.0 if reference is None else reference @ loads))
        found = np.full((len(wanted), 2), np.nan)
        if not self._is_possible:
            return found
        step = max(1, _BLOCK // n)
        for first in range(0, len(wanted), step):
            some = wanted[first : first + step]
            directions = np.zeros((n, len(some)))
            directions[some, np.arange(len(some))] = 1.0
            if reference is not None:
                directions -= reference[:, None]
            found[first : first + step] = self._bounds(directions)
        return found

    def _bounds(self, directions: Array) -> Array:
        slopes = (2.0 * self.problem.risk_aversion * self.problem.risk.times(directions)).T
        found = np.empty((len(slopes), 2))
        for side, sign in enumerate((-1.0, 1.0)):
            endless = self._endless(sign * directions)
            found[endless, side] = sign * np.inf
            found[~endless, side] = sign * self._greatest(sign * slopes[~endless])
        return found

    def _endless(self, directions: Array) -> np.ndarray:
        """Return which directions (n,q) are unbounded through some multiplier."""
        small = tolerances.ON_FACE
        rows = self.problem.equalities[0]
        ends = ((directions < -small) & self._at_low[:, None]).any(axis=0)
        ends |= ((directions > small) & self._at_high[:, None]).any(axis=0)
        ends |= (self._tight @ directions > small).any(axis=0)
        return np.asarray(
            ends | (np.abs(rows @ directions) > small * np.abs(rows).max(axis=1, initial=0.0)[:, None]).any(axis=0)
        )

    def _greatest(self, slopes: Array) -> Array:
        """Return the greatest g'w over the cell, for rows g (q,n)."""
        layout = self.problem.layout
        rows, sides = self.problem.equalities
        if layout is None or (not len(layout.sides) and not len(rows)):
            return np.asarray(np.maximum(slopes * self.low, slopes * self.high).sum(axis=1))
        if not len(layout.sides) and len(rows) == 1 and np.ptp(rows[0]) == 0.0:
            return self._filled(slopes, float(sides[0] / rows[0, 0]))
        below, exact = Rows(layout.general, layout.sides), Rows(rows, sides)
        return np.array([-minimise(-slope, below, exact, self._cell).value for slope in slopes])

    def _filled(self, slopes: Array, total: float) -> Array:
        """Return the same where the weights sum to a total: the excess goes to the greatest slopes first."""
        order = np.argsort(-slopes, axis=1)
        room = (self.high - self.low)[order]
        taken = np.clip(total - self.low.sum() - (np.cumsum(room, axis=1) - room), 0.0, room)
        return np.asarray(slopes @ self.low + (np.take_along_axis(slopes, order, axis=1) * taken).sum(axis=1))

    def _lifted(self, directions: Array) -> Array:
        """Return bounds by linear programmes over views, weights, factor weights and multipliers, without forming V."""
        found = np.full((len(directions), 2), np.nan)
        if not self._is_possible:
            return found
        equal, below, bounds, scale = self._programme
        for i, direction in enumerate(directions):
            objective = np.append(direction, np.zeros(len(bounds) - len(direction)))
            for side, sign in enumerate((1.0, -1.0)):
                answer = minimise(sign * objective, below, equal, bounds)
                found[i, side] = sign * answer.value * scale if answer.status == OPTIMAL else -sign * np.inf
        return found

    @cached_property
    def _programme(self) -> tuple[Rows, Rows | None, list[Bound], float]:
        problem, n = self.problem, self.problem.n_assets
        assert problem.loadings is not None
        double, risk = 2.0 * problem.risk_aversion, problem.risk
        if isinstance(risk, FactorRisk):
            root, own = risk.root, csr_array(diags_array(risk.specific))
        else:
            root, own = np.zeros((n, 0)), csr_array(risk.dense())
        scale = max(float(np.abs(double * risk.times(self.weights)).max()), tolerances.TINY)
        rows, sides = problem.equalities
        unit, factors = eye_array(n, format="csc"), root.shape[1]
        columns = [problem.loadings, -double / scale * own, -double / scale * root, -rows.T, -self._tight.T]
        parts = [csr_array(part) for part in (*columns, unit[:, self._at_low], -unit[:, self._at_high])]
        width = [part.shape[1] for part in parts]
        # B m − 2γ(D w + L f) − H'ν − G'λ = 0, L'w − f = 0, H w = b, in views measured by `scale`.
        k, rest = width[0], csr_array((factors + len(rows), sum(width[3:])))
        held = vstack([csr_array(root.T), csr_array(rows)])
        minus = vstack([-eye_array(factors), csr_array((len(rows), factors))])
        below_top = hstack([csr_array((factors + len(rows), k)), held, minus, rest])
        matrix = csr_array(vstack([hstack(parts), below_top]))
        free: list[Bound] = [(None, None)]
        bounds = free * k + self._cell + free * (width[2] + width[3]) + [(0.0, None)] * sum(width[4:])
        equal = Rows(matrix, np.concatenate([np.zeros(n + factors), sides]))
        layout, below = problem.layout, None
        if layout is not None and len(layout.sides):
            limits = np.zeros((len(layout.sides), sum(width)))
            limits[:, k : k + n] = layout.general
            below = Rows(limits, layout.sides)
        return equal, below, bounds, scale

    def nearest(self, mean: Array) -> Array:
        """Raise `InputError`: the views are a union of polyhedra."""
        raise InputError(
            "the views behind rounded weights are a union of polyhedra, whose nearest member is not computed: ask `contains` "
            "or `bounds`, or read the weights within a regret"
        )

    def contains(self, mean: Array) -> bool:
        """Return whether the optimal decision for a mean rounds to the weights, by a forward solve."""
        return bool(np.abs(self.problem.optimum(mean) - self.weights).max() <= self.half)
