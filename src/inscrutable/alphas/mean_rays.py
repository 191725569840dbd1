"""The farthest affordable decisions along rays from a mean, for the search of a decoy under constraints."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from inscrutable import tolerances
from inscrutable.alphas.problem import AlphaProblem, least_costs
from inscrutable.alphas.view_sets import slacks_of
from inscrutable.alphas.views import implied_views
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems.constraints import Polyhedron
from inscrutable.problems.quadratic_programme import Layout
from inscrutable.validation import Array

_MOST_DOUBLINGS = 20


class MeanRays:
    """Decisions for the means m + t d, as far along d as their regret is affordable.

    Args:
        problem: The decision problem, with inequalities.
        mean: m, shape (k,), the true mean.
        limit: r ≥ 0, the affordable regret.
    """

    def __init__(self, problem: AlphaProblem, mean: Array, limit: float) -> None:
        assert problem.layout is not None
        assert problem.constraints is not None
        self.problem, self.mean, self.limit = problem, mean, limit
        self.layout: Layout = problem.layout
        self.best = problem.optimum(mean)
        self._region: Polyhedron = problem.constraints
        self._slope = 2.0 * problem.risk_aversion * problem.risk.times(self.best) - problem.alphas(mean)

    def climbed(self, layout: Layout, way: Array) -> tuple[float, Array]:
        """Return the largest distance of views, and its decision, that the power method reaches from a direction.

        While the tight rows stay, the distance is convex in the decision, and its slope is largest at the end of the ray along
        Θ⁺(m̂ − m), with m̂ the nearest view: that decision is as far or farther.
        """
        distance, found = 0.0, self.best
        while True:
            weights = self._end(layout, way)
            views = implied_views(self.problem, weights)
            apart = views.nearest(self.mean) - self.mean
            reached = 0.0 if views.is_empty else float(np.linalg.norm(apart))
            if reached <= distance:
                return distance, found
            gain, distance, found = reached - distance, reached, weights
            if gain <= tolerances.LEAST_RAY_GAIN * reached:
                return distance, found
            way = self._steepest(apart)

    def _steepest(self, apart: Array) -> Array:
        """Return Θ⁺x, for x orthogonal to the equalities' rows; without loadings in proportion to it."""
        if self.problem.loadings is None:
            return self.problem.risk.times(apart)
        return np.asarray(self._inverse @ apart)

    @cached_property
    def _inverse(self) -> Array:
        return inverse_of(self.problem.theta)[0]

    def _end(self, layout: Layout, way: Array) -> Array:
        """Return the decision at the end of a ray; u*(m) where the ray's start is not affordable."""
        size = float(np.sqrt(max(float(way @ self.problem.theta_times(way)), 0.0)))
        if size == 0.0:  # moves no decision
            return self.best

        def at(length: float) -> Array:
            return self._decision(layout, self.mean + length * way / size)

        def beyond(length: float) -> float:
            return float(np.sqrt(self._regret(at(length))) - np.sqrt(self.limit))

        # Without inequalities this length spends the budget; with them at most the budget.
        low, high = 0.0, float(np.sqrt(self.limit))
        if beyond(low) >= 0:
            return self.best
        for _ in range(_MOST_DOUBLINGS):
            if beyond(high) >= 0:
                return at(_last_below(beyond, low, high))
            low, high = high, 2.0 * high
        return at(low)

    def _decision(self, layout: Layout, mean: Array) -> Array:
        problem = self.problem
        return np.asarray(least_costs(problem.risk, problem.risk_aversion, layout, problem.alphas(mean)[None])[0])

    def _regret(self, weights: Array) -> float:
        apart = weights - self.best
        return max(0.0, float(self.problem.risk_aversion * self.problem.risk.quadratic(apart) + self._slope @ apart))

    def loosened(self) -> Layout:
        """Return the set in which rows keep the least slack that an observer sees, as many as the budget allows.

        A tight row lets the observer explain the decision by every view on one side of it, the nearest of them included; a
        loose row by one view. The rows with the least multipliers at u*(m) are the cheapest.
        """
        scales = np.abs(self.layout.general).max(axis=1, initial=0.0)
        gaps = self._region.played_slack * np.concatenate([np.ones(2 * self.best.size), scales])
        tight = np.concatenate(slacks_of(self.problem, self.best)) == 0.0
        costs = np.where(tight, self._multipliers(*np.split(tight, _ends(self.best.size))) * gaps, 0.0)
        order = np.argsort(costs)

        def among(n_rows: int) -> Layout:
            kept = np.zeros(gaps.size)
            kept[order[:n_rows]] = gaps[order[:n_rows]]
            return _within(self.layout, kept)

        # Regret grows with the rows that keep a slack.
        too_many = bisect_left(range(1, gaps.size + 1), True, key=lambda n_rows: not self._is_affordable(among(n_rows)))
        return among(too_many)

    def _is_affordable(self, layout: Layout) -> bool:
        return not _is_empty(layout) and self._regret(self._decision(layout, self.mean)) < self.limit

    def _multipliers(self, lower: np.ndarray, upper: np.ndarray, general: np.ndarray) -> Array:
        """Return the sizes of the multipliers of bounds and general rows at u*(m), given which are tight."""
        free, n_equalities = ~(lower | upper), len(self.layout.equalities)
        rows = np.vstack([self.layout.equalities, self.layout.general[general]])
        lifts = np.linalg.lstsq(rows[:, free].T, -self._slope[free], rcond=None)[0]
        bounds = np.abs(self._slope + rows.T @ lifts)
        others = np.zeros(general.size)
        others[general] = np.abs(lifts[n_equalities:])
        return np.concatenate([bounds, bounds, others])


def _within(layout: Layout, gaps: Array) -> Layout:
    """Return a set whose lower bounds, upper bounds and general rows keep slacks; coordinates held at one value stay."""
    lower, upper, general = np.split(gaps, _ends(layout.lower.size))
    wide = layout.upper > layout.lower
    return replace(
        layout,
        lower=layout.lower + np.where(wide, lower, 0.0),
        upper=layout.upper - np.where(wide, upper, 0.0),
        sides=layout.sides - general,
    )


def _is_empty(layout: Layout) -> bool:
    if (layout.lower > layout.upper).any():
        return True
    bounds = list(zip(layout.lower, layout.upper, strict=True))
    equal = Rows(layout.equalities, layout.equality_sides)
    return minimise(np.zeros(len(bounds)), Rows(layout.general, layout.sides), equal, bounds).status != OPTIMAL


def _ends(n_assets: int) -> list[int]:
    """Where lower bounds and upper bounds end in an array of all inequalities."""
    return [n_assets, 2 * n_assets]


def _last_below(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the zero of an increasing function, approached from below."""
    share = tolerances.CURVATURE
    found = float(brentq(function, low, high, xtol=share * high, rtol=share))
    while function(found) > 0:
        found -= 0.5 * share * high
    return max(found, low)


def inverse_of(theta: Array) -> tuple[Array, int]:
    """Return Θ⁺ and the rank of Θ, whatever the units of its coordinates.

    Formula: Θ⁺ = P G P, with P the projector on the range of Θ and G = D⁻¹ (D⁻¹ΘD⁻¹)⁺ D⁻¹ for D² the diagonal of Θ: an
    eigenvalue of D⁻¹ΘD⁻¹ below `CURVATURE` of the largest is none.
    """
    unit = np.sqrt(np.where(np.diag(theta) > 0.0, np.diag(theta), 1.0))
    values, axes = np.linalg.eigh(theta / np.outer(unit, unit))
    curved = values > max(tolerances.CURVATURE * float(values[-1]), 0.0)
    found = (axes[:, curved] / values[curved]) @ axes[:, curved].T / np.outer(unit, unit)
    if not curved.all():
        flat = np.linalg.qr(axes[:, ~curved] / unit[:, None])[0]
        inside = np.eye(len(unit)) - flat @ flat.T
        found = inside @ found @ inside
    return np.asarray(0.5 * (found + found.T)), int(curved.sum())
