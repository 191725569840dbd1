"""Implied views: the expected returns under which weights are optimal."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.alphas.loaded_views import LoadedViews, ViewsWithinRegret
from inscrutable.alphas.problem import AlphaProblem, checked_alpha_problem
from inscrutable.alphas.rounded_views import RoundedViews
from inscrutable.alphas.view_sets import FreeViews, ViewSet
from inscrutable.axes import Names, few
from inscrutable.errors import InputError
from inscrutable.saved import saved_choice
from inscrutable.validation import Array

_MOST_SHOWN = 8


@saved_choice
class ViewStatus(Enum):
    """Whether the set of implied views is a point, a polyhedron, or empty.

    Example:
        >>> ViewStatus.POINT.value
        'one view explains the weights'
    """

    POINT = "one view explains the weights"
    SUBSPACE = (
        "the views that explain the weights are an affine subspace: the weights reveal nothing about some combinations"
    )
    POLYHEDRON = (
        "the views that explain the weights are a polyhedron: weights at a limit bound a view from one side alone"
    )
    WITHIN_REGRET = "the views under which the weights are within the regret are a convex set"
    OUTER = "the weights are rounded: the intervals hold every view that explains them, and some that do not"
    EMPTY = "no view explains the weights"


@dataclass(frozen=True, eq=False)
class ImpliedViews:
    """The set Π(u) of means m for which weights u are optimal, or optimal up to a regret or to rounding.

    Args:
        problem: The decision problem.
        weights: u, shape (n,), in the order of the problem's assets.
        regret: The allowed regret, or None.
        digits: Digits after the point of the rounded weights, or None.
        reference: The reference asset or portfolio of the assets' bounds, or None.
        status: The kind of the set.
        dimension: Its dimension: 0 a point, −1 empty.

    Example:
        >>> problem = AlphaProblem([[0.04, 0.0], [0.0, 0.01]], risk_aversion=2.5)
        >>> views = implied_views(problem, [0.1, 0.2])
        >>> views.nearest([0.0, 0.0]).round(6).tolist(), views.contains([0.02, 0.01]), views.dimension
        ([0.02, 0.01], True, 0)
    """

    problem: AlphaProblem
    weights: Array
    regret: float | None
    digits: int | None
    reference: str | None
    status: ViewStatus
    dimension: int
    _set: ViewSet = field(repr=False)
    _shares: Array | None = field(repr=False)  # ρ (n,): bounds are of (Bm)_i − ρ'(Bm)

    @cached_property
    def bounds(self) -> Array:
        """Least and greatest m_j, shape (k,2), infinite where the weights give no bound; NaN where the set is empty.

        Without loadings they are those of the assets, relative to the reference.
        """
        return self._set.signal_bounds(self._shares, np.arange(self.problem.n_signals))

    @cached_property
    def asset_bounds(self) -> Array:
        """Least and greatest expected return (Bm)_i of each asset, shape (n,2), minus the reference's if there is one."""
        if self.problem.loadings is None:
            return self.bounds
        return self._set.asset_bounds(self._shares, np.arange(self.problem.n_assets))

    def interval(self, asset: Any) -> tuple[float, float]:
        """Return least and greatest expected return of one asset, by name or number, relative to the reference."""
        place = _place(asset, self.problem.asset_names, self.problem.n_assets)
        low, high = self._set.asset_bounds(self._shares, np.array([place]))[0]
        return float(low), float(high)

    def nearest(self, mean: ArrayLike) -> Array:
        """Return the member nearest to a mean (k,).

        Where no view explains the weights, it is the nearest least-squares solution of B m = 2γVu + H'ν + G'λ over the assets
        off their limits.

        Raises:
            InputError: The mean has another length or other labels; or the weights are rounded, so the set is not convex.
        """
        return self._set.nearest(self.point(mean))

    def distance(self, mean: ArrayLike) -> float:
        """Return the Euclidean distance from a mean (k,) to the set; infinite where it is empty."""
        point = self.point(mean)
        return np.inf if self.is_empty else float(np.linalg.norm(point - self._set.nearest(point)))

    def contains(self, mean: ArrayLike) -> bool:
        """Return whether a mean (k,) is a member; for rounded weights by a forward solve."""
        return self._set.contains(self.point(mean))

    @property
    def is_empty(self) -> bool:
        """Whether no view explains the weights; a status, not an error."""
        return self.dimension < 0

    @property
    def plausibility_gap(self) -> float:
        """Least regret of the weights under any view, in the unit of returns; zero where one explains them."""
        return self._set.gap

    def gap_reaches(self, margin: float) -> bool:
        """Return whether the plausibility gap is at least a margin."""
        return self._set.gap >= margin

    def point(self, mean: ArrayLike, name: str = "mean") -> Array:
        """Return one mean (k,) as floats in the order of the signals' labels, or raise `InputError`."""
        held = self.problem.check_mean(mean, name)
        if held.ndim != 1:
            raise InputError(f"{name} must be one mean of shape ({self.problem.n_signals},), got shape {held.shape}")
        return held

    def holds_another(self, mean: ArrayLike) -> bool:
        """Return whether a view other than this mean explains the weights."""
        return self.dimension > 0 or (self.dimension == 0 and self.distance(mean) > tolerances.SAME_BELIEF)

    def frame(self) -> Any:
        """Return the assets' weights and bounds as a DataFrame, one row per asset."""
        import pandas as pd

        names = _names(self.problem.asset_names, self.problem.n_assets)
        columns = {"weight": self.weights, "least": self.asset_bounds[:, 0], "greatest": self.asset_bounds[:, 1]}
        return pd.DataFrame(columns, index=pd.Index(names, name="asset"))

    def summary(self) -> str:
        """Return the kind of the set and the bounds of the first assets, as text."""
        lines = [f"{self.status.value} (dimension {self.dimension} of {self.problem.n_signals})"]
        if not self.is_empty:
            names = _names(self.problem.asset_names, self.problem.n_assets)
            what = "" if self.reference is None else f", less that of {self.reference}"
            lines.append(f"expected return of an asset{what}:")
            for name, (low, high) in list(zip(names, self.asset_bounds, strict=True))[:_MOST_SHOWN]:
                lines.append(f"  {name}: {low:.6g}" if low == high else f"  {name}: {low:.6g} to {high:.6g}")
            if len(names) > _MOST_SHOWN:
                lines.append(f"  … {len(names)} assets in all")
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.summary()


def implied_views(
    problem: AlphaProblem,
    weights: ArrayLike,
    *,
    regret: float | None = None,
    digits: int | None = None,
    reference: Any = None,
) -> ImpliedViews:
    """Return the means m that explain weights: reverse optimisation under constraints, with rounding or a regret.

    Formula: Π(u) = {m : B m ∈ 2γV u + N_C(u)}; within a regret {m : ρ(m,u) ≤ r}; rounded {m : |u*(m) − u| ≤ ½10^−digits}.

    Args:
        problem: The decision problem.
        weights: u, shape (n,), a member of C; with `digits`, a rounded member.
        regret: r ≥ 0, the allowed regret of the weights, in the unit of returns; None and 0: none.
        digits: Digits after the point that the weights were rounded to, at least 0; None: they are exact. Bounds are then an
            outer interval; `contains` stays exact.
        reference: What is subtracted from the assets' expected returns in bounds: an asset's name or number, "portfolio" (the
            weights as given, scaled to sum to one) or "mean" (all assets equally). None: nothing; with a budget row the bounds
            are then infinite, because a common shift of all expected returns changes no decision.

    Returns:
        `ImpliedViews`. A constraint is active where the weights meet it exactly.

    Raises:
        InputError: Weights of other names or outside C, both `regret` and `digits`, an unknown reference.

    Cost: without loadings O(n k) for k factors, with any constraints, and O(n² log n) in blocks for rounded weights; else a
    singular value decomposition of B and two linear programmes for each signal and asset, made when bounds are asked for.

    Source: Sharpe, Journal of Financial and Quantitative Analysis 9 (1974); Black and Litterman, Financial Analysts Journal 48
    (1992), of which the unconstrained point is the prior; inverse optimisation as in Theorem 1 of the paper.

    Example:
        >>> from inscrutable import simplex
        >>> problem = AlphaProblem([[0.04, 0.0], [0.0, 0.01]], risk_aversion=2.5, constraints=simplex(2))
        >>> views = implied_views(problem, [0.5, 0.5], reference="mean")
        >>> views.bounds.round(6).tolist(), views.dimension
        ([[0.0375, 0.0375], [-0.0375, -0.0375]], 1)
    """
    checked_alpha_problem(problem)
    if regret is not None and digits is not None:
        raise InputError(
            "give regret or digits, not both: a rounded decision is not the best one, and its regret is not known"
        )
    within = 0.0 if regret is None else validation.non_negative(regret, "regret")
    places = None if digits is None else validation.count(digits, "digits", least=0)
    beyond = tolerances.FEASIBILITY if places is None else np.inf
    held = problem.check_weights(weights, beyond=beyond)
    if held.ndim != 1:
        raise InputError(f"weights must be one decision of shape ({problem.n_assets},), got shape {held.shape}")
    held.flags.writeable = False
    shares = _shares(reference, held, problem)
    if places is not None:
        found: ViewSet = RoundedViews(problem, held, places)
    elif problem.loadings is None:
        found = FreeViews(problem, held, within)
    elif within > 0:
        found = ViewsWithinRegret(problem, held, within)
    else:
        found = LoadedViews(problem, held)
    said = None if reference is None else str(reference)
    status = _status(found, within, places)
    return ImpliedViews(problem, held, regret, places, said, status, found.dimension, found, shares)


def _status(found: ViewSet, regret: float, digits: int | None) -> ViewStatus:
    if found.dimension < 0:
        return ViewStatus.EMPTY
    if digits is not None:
        return ViewStatus.OUTER
    if regret > 0:
        return ViewStatus.WITHIN_REGRET
    if found.dimension == 0:
        return ViewStatus.POINT
    return ViewStatus.POLYHEDRON if found.has_sides else ViewStatus.SUBSPACE


def _shares(reference: Any, weights: Array, problem: AlphaProblem) -> Array | None:
    if reference is None:
        return None
    names = problem.asset_names or ()
    if reference == "mean" and "mean" not in names:
        return np.full(weights.size, 1.0 / weights.size)
    if reference == "portfolio" and "portfolio" not in names:
        total = float(weights.sum())
        if abs(total) <= tolerances.FEASIBILITY * float(np.abs(weights).sum()):
            raise InputError(
                f"the weights sum to {total:.3g}, so that no portfolio of them has weight one; name an asset"
            )
        return np.asarray(weights / total)
    found = np.zeros(weights.size)
    found[_place(reference, problem.asset_names, weights.size, "reference: ")] = 1.0
    return found


def _place(asset: Any, names: Names | None, n: int, what: str = "") -> int:
    if names is not None and asset in names:
        return names.index(asset)
    if isinstance(asset, (int, np.integer)) and not isinstance(asset, bool) and 0 <= asset < n:
        return int(asset)
    known = f"one of the assets {few(names)}" if names is not None else f"a number from 0 to {n - 1}"
    raise InputError(f'{what}no asset is called {asset!r}; expected {known}, or as a reference "portfolio" or "mean"')


def _names(names: Names | None, n: int) -> list[str]:
    return [str(name) for name in names] if names is not None else [f"u[{j}]" for j in range(n)]
