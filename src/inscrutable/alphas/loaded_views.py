"""Implied views of signals that move assets through loadings B: a polyhedron, an ellipsoid, or another convex set."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from inscrutable import tolerances
from inscrutable.alphas.problem import AlphaProblem, least_costs
from inscrutable.alphas.view_sets import ViewSet, nearest_within, slacks_of
from inscrutable.errors import SolverError
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems.quadratic_programme import Layout, solve_programmes
from inscrutable.validation import Array

_WIDTH = 1e4
"""Search range for the length t, as a factor above and below the likely best one."""


class LoadedViews(ViewSet):
    """Views m of k signals that explain weights exactly: B m = 2γVu + H'ν + G'λ over tight rows.

    Multipliers of active bounds are eliminated: an asset off its bounds gives an equation in (m, ν, λ), an asset on a bound an
    inequality. A singular value decomposition solves the equations; coordinates y of their null space are the variables of
    linear programmes with the inequalities as rows.
    """

    def __init__(self, problem: AlphaProblem, weights: Array) -> None:
        assert problem.loadings is not None
        self.problem, self.weights, self._loads = problem, weights, problem.loadings
        center = 2.0 * problem.risk_aversion * problem.risk.times(weights)
        slacks = slacks_of(problem, weights)
        tight = np.zeros((0, problem.n_assets))
        if problem.layout is not None:
            tight = problem.layout.general[slacks.general == 0]
        columns = np.hstack([self._loads, -problem.equalities[0].T, -tight.T])
        low, high = slacks.lower == 0, slacks.upper == 0
        free, size = ~(low | high), np.abs(columns).max(axis=0)
        size[size == 0] = 1.0
        self._equations, self._sides = columns[free] / size, center[free]
        self._size, self._scale = size[: problem.n_signals], max(float(np.abs(center).max()), tolerances.TINY)
        left, values, axes = np.linalg.svd(self._equations, full_matrices=True)
        rank = int((values > tolerances.RANK * values.max(initial=0.0)).sum())
        self._inverse = (axes[:rank].T / values[:rank]) @ left[:, :rank].T
        self._start, self._ways = self._inverse @ self._sides, axes[rank:].T
        below, above = low & ~high, high & ~low
        signs = -np.eye(columns.shape[1])[len(columns[0]) - len(tight) :]
        rows = np.vstack([columns[below] / size, -columns[above] / size, signs])
        sides = np.concatenate([center[below], -center[above], np.zeros(len(tight))])
        self._rows = Rows(rows @ self._ways, sides - rows @ self._start)
        self.has_sides = bool(len(sides))

    @cached_property
    def _misfit(self) -> float:
        """Least residual of the conditions of optimality, relative to 2γVu."""
        missed = float(np.abs(self._equations @ self._start - self._sides).max(initial=0.0)) / self._scale
        if missed > tolerances.EXPLAINED or not len(self._rows.sides):
            return missed
        n = self._ways.shape[1]
        short = np.column_stack([self._rows.matrix, -np.ones(len(self._rows.sides))])
        objective = np.append(np.zeros(n), 1.0)
        answer = minimise(
            objective, Rows(short, self._rows.sides / self._scale), bounds=[(None, None)] * n + [(0.0, None)]
        )
        return float(answer.value) if answer.status == OPTIMAL else np.inf

    @property
    def gap(self) -> float:
        """Least regret of the weights under any view: γ times their variance above the least at the same exposures B'u."""
        return 0.0 if self._misfit <= tolerances.EXPLAINED else least_regret(self.problem, self.weights)

    @cached_property
    def _within(self) -> Rows:
        """The inequalities, relaxed by the tolerance, so that a set without interior is not empty."""
        return Rows(self._rows.matrix, self._rows.sides + tolerances.EXPLAINED * self._scale)

    @cached_property
    def dimension(self) -> int:
        """Dimension in m; −1 where no view explains the weights."""
        if self._misfit > tolerances.EXPLAINED:
            return -1
        ways, rows, n = self._ways, self._rows, self._ways.shape[1]
        if len(rows.sides) and n:
            # With enough scaling, some member has slack 1 in every row that can have slack.
            slack = np.column_stack([rows.matrix, -(rows.sides / self._scale), np.eye(len(rows.sides))])
            free: list[tuple[float | None, float | None]] = [(None, None)] * n
            bounds = [*free, (1.0, None), *([(0.0, 1.0)] * len(rows.sides))]
            objective = np.concatenate([np.zeros(n + 1), -np.ones(len(rows.sides))])
            answer = minimise(objective, Rows(slack, np.zeros(len(rows.sides))), bounds=bounds)
            if answer.status == OPTIMAL:
                held = rows.matrix[answer.x[n + 1 :] < 0.5]
                _, values, axes = np.linalg.svd(held, full_matrices=True)
                ways = ways @ axes[int((values > tolerances.RANK).sum()) :].T
        return int(np.linalg.matrix_rank(ways[: len(self._size)], tol=tolerances.RANK)) if ways.shape[1] else 0

    def _bounds(self, directions: Array) -> Array:
        found = np.full((len(directions), 2), np.nan)
        if self._misfit > tolerances.EXPLAINED:
            return found
        for i, direction in enumerate(directions / self._size):
            start, slope = float(direction @ self._start[: len(direction)]), direction @ self._ways[: len(direction)]
            if np.abs(slope).max(initial=0.0) <= tolerances.RANK * np.abs(direction).max(initial=0.0):
                found[i] = start
                continue
            for side, sign in enumerate((1.0, -1.0)):
                answer = minimise(sign * slope, self._within)
                found[i, side] = start + sign * answer.value if answer.status == OPTIMAL else -sign * np.inf
        return found

    def signal_bounds(self, reference: Array | None, wanted: np.ndarray) -> Array:
        """Return least and greatest m_j by two linear programmes each."""
        return self._bounds(np.eye(self.problem.n_signals)[wanted])

    def asset_bounds(self, reference: Array | None, wanted: np.ndarray) -> Array:
        """Return least and greatest (Bm)_i − ρ'Bm by two linear programmes each."""
        return self._bounds(_apart(self._loads, reference, wanted))

    def nearest(self, mean: Array) -> Array:
        """Return the member nearest to a mean; if the set is empty, the nearest least-squares solution."""
        k, target = len(mean), mean * self._size
        if self._misfit > tolerances.EXPLAINED:
            own, *_ = np.linalg.lstsq(
                self._equations, self._sides - self._equations[:, :k] @ target, rcond=tolerances.RANK
            )
            return np.asarray(mean + own[:k] / self._size)
        ways = self._ways[:k] / self._size[:, None]
        first = self._start[:k] / self._size
        if not ways.shape[1]:
            return np.asarray(first)
        n, unit = ways.shape[1], max(float(np.abs(ways).max()), tolerances.TINY)
        endless = np.full(n, np.inf)
        none = np.zeros((0, n))
        layout = Layout(-endless, endless, np.asarray(self._within.matrix), self._within.sides, none, np.zeros(0))
        shrunk = ways / unit
        found = solve_programmes((shrunk.T @ shrunk)[None], (shrunk.T @ ((first - mean) / unit))[None], layout)[0]
        return np.asarray(first + ways @ found)

    def contains(self, mean: Array) -> bool:
        """Return whether the conditions of optimality hold for a mean up to rounding."""
        if self._misfit > tolerances.EXPLAINED:
            return False
        apart = self._loads @ (mean - self.nearest(mean))
        scale = max(self._scale, float((np.abs(self._loads) @ np.abs(mean)).max()))
        return bool(np.abs(apart).max() <= 2.0 * tolerances.EXPLAINED * scale)


class ViewsWithinRegret(ViewSet):
    """Views m of k signals under which weights cost at most a regret r more than the best.

    Without inequalities an ellipsoid, (m − m̂)'Θ(m − m̂) ≤ r − gap. With them the bound along a direction d is inf_{t>0} [r +
    γ(φ(t) − u'Vu)]/t, φ(t) the least risk v'Vv of v ∈ C with B'v = B'u + t d: every t gives a valid bound, and one line search
    finds the best.
    """

    def __init__(self, problem: AlphaProblem, weights: Array, regret: float) -> None:
        assert problem.loadings is not None
        self.problem, self.weights, self.regret, self._loads = problem, weights, regret, problem.loadings

    @cached_property
    def gap(self) -> float:
        """Least regret of the weights under any view."""
        return LoadedViews(self.problem, self.weights).gap

    @property
    def dimension(self) -> int:
        """k, or −1 where the regret exceeds r under every view."""
        return self.problem.n_signals if self.gap < self.regret else -1

    def signal_bounds(self, reference: Array | None, wanted: np.ndarray) -> Array:
        """Return least and greatest m_j."""
        return self._bounds(np.eye(self.problem.n_signals)[wanted])

    def asset_bounds(self, reference: Array | None, wanted: np.ndarray) -> Array:
        """Return least and greatest (Bm)_i − ρ'Bm."""
        return self._bounds(_apart(self._loads, reference, wanted))

    def _bounds(self, directions: Array) -> Array:
        if self.dimension < 0:
            return np.full((len(directions), 2), np.nan)
        if self.problem.has_inequalities:
            ends = [[-self._end(-direction), self._end(direction)] for direction in directions]
            return np.array(ends).reshape(-1, 2)
        unit = _units(self._loads)
        directions = directions / unit
        values, axes = np.linalg.eigh(self.problem.theta / np.outer(unit, unit))
        curved = values > tolerances.CURVATURE * values.max()
        apart = (self._loads / unit).T @ (self.weights - self.problem.least_risk)
        along = directions @ axes
        middle = 0.5 * (along[:, curved] / values[curved]) @ (axes[:, curved].T @ apart)
        width = np.sqrt((self.regret - self.gap) * (along[:, curved] ** 2 / values[curved]).sum(axis=1))
        is_flat = np.abs(along[:, ~curved]).max(axis=1, initial=0.0) > tolerances.RANK * np.abs(directions).max(
            axis=1, initial=0.0
        )
        width[is_flat] = np.inf
        return np.column_stack([middle - width, middle + width])

    def _end(self, direction: Array) -> float:
        """Return an upper bound of the greatest d'm."""
        frame, sizes, axes = _frame(self._loads)
        direction = direction / _units(self._loads)
        inside = axes @ direction
        if np.abs(direction - axes.T @ inside).max() > tolerances.RANK * np.abs(direction).max(initial=0.0):
            return np.inf  # no held asset has an exposure to it
        if not direction.any():
            return 0.0
        moved = inside / sizes
        if not _can_move(self.problem, self.weights, moved):
            return np.inf
        layout = _exposed(self.problem, self.weights)
        longest = _longest(layout, moved)
        if longest <= 0.0:  # by rounding
            return np.inf
        gamma, risk = self.problem.risk_aversion, self.problem.risk
        now, nothing = float(risk.quadratic(self.weights)), np.zeros((1, self.problem.n_assets))
        step = np.concatenate([np.zeros(len(layout.equality_sides) - len(moved)), moved])

        def bound(log_length: float) -> float:
            length = float(np.exp(log_length))
            shifted = replace(layout, equality_sides=layout.equality_sides + length * step)
            try:
                best = least_costs(risk, gamma, shifted, nothing)[0]
            except SolverError:  # every length gives a bound: skip one whose programme is too degenerate
                return np.inf
            return (self.regret + gamma * (float(risk.quadratic(best)) - now)) / length

        # Without inequalities and a gap this length is the best.
        along = frame @ moved
        likely = float(np.sqrt(self.regret / (gamma * risk.quadratic(along))))
        high = float(np.log(min(longest * (1.0 - tolerances.WAY_END), likely * _WIDTH)))
        found = minimize_scalar(
            bound, bounds=(high - 2.0 * np.log(_WIDTH), high), method="bounded", options={"xatol": tolerances.CURVATURE}
        )
        return float(min(found.fun, bound(high)))

    def nearest(self, mean: Array) -> Array:
        """Return the member nearest to a mean; NaN where there is none."""
        if self.dimension < 0:
            return np.full(len(mean), np.nan)
        return nearest_within(self.problem, self.weights, self.regret, mean)

    def contains(self, mean: Array) -> bool:
        """Return whether the regret under a mean is at most r."""
        return bool(self.problem.regret(mean, self.weights) <= self.regret * (1.0 + tolerances.ON_FACE))


def least_regret(problem: AlphaProblem, weights: Array) -> float:
    """Return min over views of the regret of weights: γ(u'Vu − min v'Vv over v ∈ C with B'v = B'u)."""
    nothing = np.zeros((1, problem.n_assets))
    best = least_costs(problem.risk, problem.risk_aversion, _exposed(problem, weights), nothing)[0]
    apart = weights - best
    slope = 2.0 * problem.risk_aversion * problem.risk.times(best)
    return max(problem.risk_aversion * float(problem.risk.quadratic(apart)) + float(slope @ apart), 0.0)


def _units(loads: Array) -> Array:
    """The largest loading (k,) of each signal, 1 where there is none: the rank of B does not depend on the signals' units."""
    size = np.abs(loads).max(axis=0)
    return np.asarray(np.where(size > 0.0, size, 1.0))


def _frame(loads: Array) -> tuple[Array, Array, Array]:
    """B = U S W' diag(units), (n,r), (r,), (r,k) of full rank r."""
    left, values, axes = np.linalg.svd(loads / _units(loads), full_matrices=False)
    rank = int((values > tolerances.RANK * values.max(initial=0.0)).sum())
    return left[:, :rank], values[:rank], axes[:rank]


def _exposed(problem: AlphaProblem, weights: Array) -> Layout:
    """Return C with the exposures fixed to those of the weights, as the last equalities."""
    assert problem.loadings is not None
    rows, sides = problem.equalities
    n, frame = problem.n_assets, _frame(problem.loadings)[0]
    held = problem.layout or Layout(
        np.full(n, -np.inf), np.full(n, np.inf), np.zeros((0, n)), np.zeros(0), np.zeros((0, n)), np.zeros(0)
    )
    return replace(
        held, equalities=np.vstack([rows, frame.T]), equality_sides=np.concatenate([sides, frame.T @ weights])
    )


def _can_move(problem: AlphaProblem, weights: Array, moved: Array) -> bool:
    """Whether a feasible direction changes the exposures by `moved`; otherwise views are unbounded along a ray of equal regret.

    By Farkas: either δ has B'δ = d, H δ = 0 and G δ ≤ 0 over tight rows, or a view m = Bm − H'ν − G'λ = 0, λ ≥ 0, has d'm > 0.
    The test compares no lengths, so units and right-hand sides do not matter.
    """
    assert problem.loadings is not None
    slacks, (rows, _), frame = slacks_of(problem, weights), problem.equalities, _frame(problem.loadings)[0]
    tight = np.zeros((0, problem.n_assets)) if problem.layout is None else problem.layout.general[slacks.general == 0]
    sides = np.concatenate([np.zeros(len(rows)), moved / np.abs(moved).max()])
    bounds = [(0.0 if low == 0 else None, 0.0 if high == 0 else None) for low, high in zip(*slacks[:2], strict=True)]
    answer = minimise(
        np.zeros(problem.n_assets),
        Rows(tight, np.zeros(len(tight))),
        Rows(np.vstack([rows, frame.T]), sides),
        bounds,
    )
    return answer.status == OPTIMAL


def _longest(layout: Layout, moved: Array) -> float:
    """Return the largest t by which the last right-hand sides can change along `moved`; infinite where unbounded."""
    n, e = len(layout.lower), len(layout.equality_sides)
    steps = np.concatenate([np.zeros(e - len(moved)), moved])
    answer = minimise(
        np.append(np.zeros(n), -1.0),
        Rows(np.column_stack([layout.general, np.zeros(len(layout.sides))]), layout.sides),
        Rows(np.column_stack([layout.equalities, -steps]), layout.equality_sides),
        [*_finite(layout), (0.0, None)],
    )
    return float(answer.x[-1]) if answer.status == OPTIMAL else np.inf


def _finite(layout: Layout) -> list[tuple[float | None, float | None]]:
    pairs = zip(layout.lower, layout.upper, strict=True)
    return [(None if np.isinf(low) else low, None if np.isinf(high) else high) for low, high in pairs]


def _apart(loads: Array, reference: Array | None, wanted: np.ndarray) -> Array:
    return np.asarray(loads[wanted] if reference is None else loads[wanted] - reference @ loads)
