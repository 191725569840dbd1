"""Quadratic programmes with a matrix known through its solves: an interior-point method, finished on the active set.

min γ u'V u − a'u over bounds, general rows and equalities. Each step solves with V plus a diagonal, which keeps the factor
structure; on the active set the conditions of optimality are then solved directly, to rounding accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.alphas.risk import Risk
from inscrutable.errors import SolverError
from inscrutable.problems.quadratic_programme import Layout
from inscrutable.validation import Array

_MOST_STEPS = 100
_MOST_SETS = 30
_MOST_UNITS = 4
_FROM_UNIT = 1e3
"""Factor between the largest weight and the unit, which is at first that of the limits, above which the weight gives the unit:
weights of a hundred-thousandth of it were wrong."""
_LOST = 1e12
"""Relative residual above which the iteration has diverged."""
_TO_BORDER = 0.995
"""Largest step, as a share of the distance to the boundary."""


class _Point(NamedTuple):
    """Unknowns of the programme: decision, slacks and multipliers of inequalities [lower, upper, general], of equalities."""

    u: Array
    slacks: Array
    duals: Array
    levels: Array


@dataclass(frozen=True, eq=False)
class RiskProgramme:
    """min ½ u'(2γV)u − a'u over a layout; the same rows for many a."""

    risk: Risk
    risk_aversion: float
    layout: Layout

    def solve(self, alphas: Array) -> Array:
        """Return the minimiser (n,) for expected returns a (n,).

        Raises:
            SolverError: The conditions of optimality were not met to their tolerance.
        """
        layout = self.layout
        fixed = layout.lower == layout.upper
        if fixed.any():
            return self._without(fixed).solved_with(alphas, fixed, layout.lower, self)
        unit = _unit_of(layout)
        for _ in range(_MOST_UNITS):
            u = unit * self._in_unit(unit)._minimiser(alphas / unit)
            size = float(np.abs(u).max())
            if size == 0.0 or unit <= _FROM_UNIT * size <= _FROM_UNIT**2 * unit:
                break
            unit = _power_of_two(size)
        return u

    def _in_unit(self, unit: float) -> RiskProgramme:
        """Return the programme for decisions measured in a unit: its tolerances are absolute."""
        rows = self.layout
        limits = {name: getattr(rows, name) / unit for name in ("lower", "upper", "sides", "equality_sides")}
        return replace(self, layout=replace(rows, **limits))

    def _minimiser(self, alphas: Array) -> Array:
        asked = np.abs(alphas).max(initial=0.0), 2.0 * self.risk_aversion * np.abs(self.risk.times(self._middle)).max()
        scale = float(max(*asked, tolerances.TINY))
        return self._on_active_set(alphas, self._interior(alphas, scale), scale)

    @property
    def _middle(self) -> Array:
        """Return a decision strictly between the bounds, and nonzero where there are none."""
        lower, upper = self.layout.lower, self.layout.upper
        with np.errstate(invalid="ignore"):
            middle = 0.5 * (lower + upper)
        return np.where(np.isfinite(middle), middle, np.clip(1.0 / lower.size, lower, upper))

    def _without(self, fixed: np.ndarray) -> RiskProgramme:
        """Return the programme in the free coordinates."""
        free, held = np.flatnonzero(~fixed), self.layout.lower[fixed]
        rows = self.layout
        return RiskProgramme(
            self.risk.part(free),
            self.risk_aversion,
            Layout(
                rows.lower[free],
                rows.upper[free],
                rows.general[:, free],
                rows.sides - rows.general[:, fixed] @ held,
                rows.equalities[:, free],
                rows.equality_sides - rows.equalities[:, fixed] @ held,
            ),
        )

    def solved_with(self, alphas: Array, fixed: np.ndarray, values: Array, whole: RiskProgramme) -> Array:
        """Return the minimiser of the full programme with some coordinates fixed at values."""
        u = np.where(fixed, values, 0.0)
        if not fixed.all():
            pulled = alphas - 2.0 * whole.risk_aversion * whole.risk.times(u)
            u[~fixed] = self.solve(pulled[~fixed])
        return u

    def _interior(self, alphas: Array, scale: float) -> _Point:
        point, bounds = self._start(scale), _bounds(self.layout)
        for _ in range(_MOST_STEPS):
            residuals = self._residuals(point, alphas, bounds)
            gap = float(point.slacks @ point.duals) / max(len(point.slacks), 1)
            worst = max(
                float(np.abs(residuals[0]).max()) / scale, *(float(np.abs(r).max(initial=0.0)) for r in residuals[1:])
            )
            if not np.isfinite(worst) or worst > _LOST:  # no interior
                raise SolverError("an interior-point method found no interior of the feasible set")
            if worst <= tolerances.INTERIOR and gap <= tolerances.INTERIOR * scale:
                break
            curved = self._curved(point, bounds)
            products = point.slacks * point.duals
            ahead = self._step(point, residuals, products, curved, bounds)
            reach = _reach(point, ahead, 1.0)
            far = (point.slacks + reach * ahead.slacks) @ (point.duals + reach * ahead.duals) / max(len(products), 1)
            centre = gap * (far / gap) ** 3 if gap > 0 else 0.0
            step = self._step(point, residuals, products + ahead.slacks * ahead.duals - centre, curved, bounds)
            reach = _reach(point, step, _TO_BORDER)
            point = _Point(*(now + reach * move for now, move in zip(point, step, strict=True)))
        return point

    def _start(self, scale: float) -> _Point:
        layout = self.layout
        lower, upper, u = layout.lower, layout.upper, self._middle
        finite = np.concatenate([(u - lower)[np.isfinite(lower)], (upper - u)[np.isfinite(upper)]])
        width = max(float(np.median(finite)) if finite.size else 0.0, 1.0 / u.size)
        slacks = np.maximum(np.concatenate([finite, layout.sides - layout.general @ u]), 0.1 * width)
        return _Point(u, slacks, scale * width / slacks, np.zeros(len(layout.equality_sides)))

    def _residuals(self, point: _Point, alphas: Array, bounds: _Bounds) -> tuple[Array, Array, Array]:
        layout = self.layout
        slope = 2.0 * self.risk_aversion * self.risk.times(point.u) - alphas + layout.equalities.T @ point.levels
        return (
            slope + bounds.pushed(point.duals, layout),
            bounds.room(point.u, layout) - point.slacks,
            layout.equalities @ point.u - layout.equality_sides,
        )

    def _curved(self, point: _Point, bounds: _Bounds) -> tuple[Risk, Array, Array]:
        """V with the bounds' barriers, the rows of equalities and general inequalities, and V⁻¹ times them."""
        weights = bounds.onto(point.duals / point.slacks, len(point.u)) / (2.0 * self.risk_aversion)
        risk = self.risk.with_more(np.zeros((len(point.u), 0)), weights)
        rows = np.vstack([self.layout.equalities, self.layout.general])
        return risk, rows, risk.solve(rows.T) if len(rows) else rows.T

    def _step(
        self,
        point: _Point,
        residuals: tuple[Array, ...],
        products: Array,
        curved: tuple[Risk, Array, Array],
        bounds: _Bounds,
    ) -> _Point:
        """Return Newton's step for given residuals and complementarity products."""
        (slope, room, off), (risk, rows, solved) = residuals, curved
        n_equal, n_bounds = len(off), bounds.n_bounds
        asked = (products + point.duals * room) / point.slacks
        pull = -slope - bounds.signed(asked, len(point.u))
        double = 2.0 * self.risk_aversion
        first = risk.solve(pull) / double
        lengths = point.slacks[n_bounds:] / point.duals[n_bounds:]
        sides = np.concatenate([-off, asked[n_bounds:] * lengths])
        inner = rows @ solved / double
        inner[np.diag_indices(len(inner))] += np.concatenate([np.zeros(n_equal), lengths])
        found = np.linalg.lstsq(inner, rows @ first - sides, rcond=tolerances.STATIONARITY)[0]
        u = first - solved @ found / double
        slacks = room + bounds.moved(u, self.layout)
        return _Point(u, slacks, -(products + point.duals * slacks) / point.slacks, found[:n_equal])

    def _on_active_set(self, alphas: Array, point: _Point, scale: float) -> Array:
        """Return the minimiser on the active set suggested by the point, corrected until the KKT conditions hold."""
        layout, bounds = self.layout, _bounds(self.layout)
        tight = point.duals / scale > point.slacks
        for _ in range(_MOST_SETS):
            found = self._with_tight(alphas, tight, bounds)
            if found is None:
                break
            u, duals = found
            slacks = bounds.room(u, layout)
            wrong = np.where(tight, duals < -tolerances.STATIONARITY * scale, slacks < -tolerances.STATIONARITY)
            if not wrong.any():
                return np.clip(u, layout.lower, layout.upper)
            tight = tight ^ wrong
        residuals = self._residuals(point, alphas, bounds)
        worst = max(float(np.abs(residuals[0]).max()) / scale, float(np.abs(residuals[2]).max(initial=0.0)))
        if worst > tolerances.DEGENERATE:
            raise SolverError(f"a quadratic programme kept a KKT residual of {worst:.1e} relative to its scale")
        return np.clip(point.u, layout.lower, layout.upper)

    def _with_tight(self, alphas: Array, tight: np.ndarray, bounds: _Bounds) -> tuple[Array, Array] | None:
        """Return the decision and the multipliers, with active inequalities as equalities."""
        layout, double = self.layout, 2.0 * self.risk_aversion
        held, values = bounds.held(tight, layout)
        if (held > 1).any():
            return None
        free, u = np.flatnonzero(held == 0), values
        general = tight[bounds.n_bounds :]
        rows = np.vstack([layout.equalities, layout.general[general]])
        sides = np.concatenate([layout.equality_sides, layout.sides[general]]) - rows @ u
        found: Array = np.zeros(len(rows))
        if free.size:
            part, pull = self.risk.part(free), (alphas - double * self.risk.times(u))[free]
            solved = part.solve(np.column_stack([pull, rows[:, free].T])) / double
            inner = rows[:, free] @ solved[:, 1:]
            missing = rows[:, free] @ solved[:, 0] - sides
            found = np.asarray(np.linalg.lstsq(inner, missing, rcond=tolerances.STATIONARITY)[0], dtype=np.float64)
            u[free] = solved[:, 0] - solved[:, 1:] @ found
        slope = double * self.risk.times(u) - alphas + rows.T @ found
        n_equal = len(layout.equality_sides)
        duals = bounds.read(slope, len(general))
        duals[bounds.n_bounds :][general] = found[n_equal:]
        missed = rows @ u - np.concatenate([layout.equality_sides, layout.sides[general]])
        if np.abs(missed).max(initial=0.0) > tolerances.FEASIBILITY:
            return None
        return u, duals


class _Bounds(NamedTuple):
    """Which coordinates have a finite lower and upper bound; inequalities are [lower, upper, general rows]."""

    lower: np.ndarray
    upper: np.ndarray

    @property
    def n_bounds(self) -> int:
        return len(self.lower) + len(self.upper)

    def room(self, u: Array, layout: Layout) -> Array:
        low, high = u[self.lower] - layout.lower[self.lower], layout.upper[self.upper] - u[self.upper]
        return np.concatenate([low, high, layout.sides - layout.general @ u])

    def moved(self, step: Array, layout: Layout) -> Array:
        return np.concatenate([step[self.lower], -step[self.upper], -(layout.general @ step)])

    def onto(self, values: Array, n: int) -> Array:
        """Return the sums per coordinate of values at its bounds."""
        total = np.zeros(n)
        total[self.lower] += values[: len(self.lower)]
        total[self.upper] += values[len(self.lower) : self.n_bounds]
        return total

    def signed(self, values: Array, n: int) -> Array:
        """The same, with a minus for upper bounds."""
        total = np.zeros(n)
        total[self.lower] += values[: len(self.lower)]
        total[self.upper] -= values[len(self.lower) : self.n_bounds]
        return total

    def pushed(self, duals: Array, layout: Layout) -> Array:
        return np.asarray(layout.general.T @ duals[self.n_bounds :] - self.signed(duals, len(layout.lower)))

    def held(self, tight: np.ndarray, layout: Layout) -> tuple[np.ndarray, Array]:
        """Return the number of active bounds of each coordinate, and its value there."""
        count = np.asarray(self.onto(tight.astype(np.float64), len(layout.lower)))
        low, high = self.lower[tight[: len(self.lower)]], self.upper[tight[len(self.lower) : self.n_bounds]]
        values = np.zeros(len(layout.lower))
        values[low], values[high] = layout.lower[low], layout.upper[high]
        return count, values

    def read(self, slope: Array, n_general: int) -> Array:
        """Return the multipliers of bounds for a gradient (n,) of the cost; zero for general rows."""
        return np.concatenate([slope[self.lower], -slope[self.upper], np.zeros(n_general)])


def _unit_of(layout: Layout) -> float:
    """Return the size of the largest limit on a weight; 1 where all are zero or infinite."""
    rows, sides = np.vstack([layout.general, layout.equalities]), np.concatenate([layout.sides, layout.equality_sides])
    sizes = np.abs(rows).max(axis=1, initial=0.0)
    limits = np.abs(np.concatenate([layout.lower, layout.upper, sides[sizes > 0.0] / sizes[sizes > 0.0]]))
    size = float(limits[np.isfinite(limits)].max(initial=0.0))
    return _power_of_two(size) if size else 1.0


def _power_of_two(size: float) -> float:
    """Return the largest power of two up to a size: in such units limits do not round."""
    return float(2.0 ** np.floor(np.log2(size)))


def _bounds(layout: Layout) -> _Bounds:
    return _Bounds(np.flatnonzero(np.isfinite(layout.lower)), np.flatnonzero(np.isfinite(layout.upper)))


def _reach(point: _Point, step: _Point, most: float) -> float:
    """Return the longest step, at most one, that keeps slacks and multipliers positive."""
    longest = 1.0
    for now, move in ((point.slacks, step.slacks), (point.duals, step.duals)):
        falling = move < 0
        if falling.any():
            with np.errstate(over="ignore"):  # a negligible component does not limit the step
                reached = -now[falling] / move[falling]
            longest = min(longest, most * float(reached.min()))
    return longest
