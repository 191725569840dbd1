"""Decision problems with a private mean: expected returns, signals, set points."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.alphas.programmes import RiskProgramme
from inscrutable.alphas.risk import FactorRisk, Risk, as_risk, singular_risk
from inscrutable.axes import Axis, Names
from inscrutable.errors import InputError, SolverError
from inscrutable.problems.constraints import Polyhedron, checked_region
from inscrutable.problems.quadratic_programme import Layout, layout_of, solve_programmes
from inscrutable.validation import Array

_MOST_AT_ONCE = 60  # assets
_MOST_DENSE = 1_000
"""Most assets for which a method may form the dense risk matrix."""


class AlphaProblem:
    """A decision problem with a private mean m and all else public: how much of each of n assets to hold.

    Formula: min_u γ u'V u − (B m)'u over u ∈ C.

    Args:
        risk: V, a covariance (n,n), squared return per period, or a `FactorRisk`.
        risk_aversion: γ > 0, per unit of return.
        constraints: C; None: no constraints.
        loadings: B, shape (n,k), of assets to signals, return per unit of a signal; None is the identity, m expected returns.
        trading_cost: κ ≥ 0: trading u − u₋ costs κ (u − u₋)'V (u − u₋). Only rules over time use it, from the
            decision of least risk on; None: no cost.

    Labelled tables are aligned with each other and with the arguments of methods: assets by their names, signals by the columns
    of `loadings`.

    Raises:
        InputError: Shapes or labels disagree, an entry is not finite, γ is not above zero.
        ModelError: The risk is indefinite (its smallest eigenvalue is named) or C is empty (its rows are named).

    Cost: O(n k²) for factors, O(n³) for a matrix, once. Source: Markowitz, Journal of Finance 7 (1952).

    Example:
        >>> problem = AlphaProblem([[0.04, 0.0], [0.0, 0.01]], risk_aversion=2.5)
        >>> problem.optimum([0.02, 0.01]).round(6).tolist(), problem.theta.round(6).tolist()
        ([0.1, 0.2], [[2.5, 0.0], [0.0, 10.0]])
    """

    def __init__(
        self,
        risk: ArrayLike | Risk,
        risk_aversion: float,
        constraints: Polyhedron | None = None,
        loadings: ArrayLike | None = None,
        trading_cost: float | None = None,
    ) -> None:
        self.risk = as_risk(risk)
        self.risk_aversion = validation.positive(risk_aversion, "risk_aversion")
        self.trading_cost = None if trading_cost is None else validation.non_negative(trading_cost, "trading_cost")
        n, assets = self.risk.n_assets, Axis("asset", self.risk.names, learns=True)
        self.constraints = None if constraints is None else checked_region(constraints, n, assets)
        signals = Axis("signal", learns=True)
        if loadings is None:
            self.loadings = None
        else:
            self.loadings = validation.finite_array(loadings, "loadings", ndim=2, axes=(assets, signals))
            if self.loadings.shape[0] != n or not self.loadings.shape[1]:
                raise InputError(f"loadings has shape {self.loadings.shape}, expected one row per asset: {n}")
        self.asset_names: Names | None = assets.names
        self.signal_names: Names | None = assets.names if loadings is None else signals.names

    @property
    def n_assets(self) -> int:
        """Number of assets n."""
        return self.risk.n_assets

    @property
    def n_signals(self) -> int:
        """Number of entries k of the private mean."""
        return self.n_assets if self.loadings is None else int(self.loadings.shape[1])

    @cached_property
    def layout(self) -> Layout | None:
        """Bounds, general rows and equalities of C; None where there are no constraints."""
        return None if self.constraints is None else layout_of(self.constraints)

    @property
    def equalities(self) -> tuple[Array, Array]:
        """H and b of the equalities H u = b, shapes (e,n) and (e,)."""
        if self.constraints is None:
            return np.zeros((0, self.n_assets)), np.zeros(0)
        return self.constraints.A_eq, self.constraints.b_eq

    @cached_property
    def has_inequalities(self) -> bool:
        """Whether C has inequalities besides its equalities."""
        rows = self.layout
        return rows is not None and bool(
            len(rows.sides) or np.isfinite(rows.lower).any() or np.isfinite(rows.upper).any()
        )

    def check_mean(self, mean: ArrayLike, name: str = "mean") -> Array:
        """Return a private mean (k,) or many (T,k) as floats in the order of the signals' labels, or raise `InputError`."""
        found = validation.finite_array(mean, name, ndim=(1, 2), axes=(None, Axis("signal", self.signal_names)))
        if found.shape[-1] != self.n_signals:
            raise InputError(f"{name} has {found.shape[-1]} entries, expected one per signal: {self.n_signals}")
        return found

    def check_weights(self, weights: ArrayLike, *, beyond: float = tolerances.FEASIBILITY) -> Array:
        """Return a decision (n,) or many (T,n) as floats in the order of the assets' labels.

        Raises:
            InputError: Another length, other labels, or a row of C violated by more than `beyond`; it is named.
        """
        found = validation.finite_array(weights, "weights", ndim=(1, 2), axes=(None, Axis("asset", self.asset_names)))
        if found.shape[-1] != self.n_assets:
            raise InputError(f"weights has {found.shape[-1]} entries, expected one per asset: {self.n_assets}")
        if self.constraints is not None:
            self.constraints.check_inside(found, "weights", beyond=beyond)
        return found

    def alphas(self, mean: Array) -> Array:
        """Return B m, the assets' expected returns, for means (…,k): shape (…,n)."""
        return mean if self.loadings is None else np.asarray(mean @ self.loadings.T)

    def optimum(self, mean: ArrayLike) -> Array:
        """Return u*(m) for one mean (k,) or many (T,k): shape (n,) or (T,n).

        Raises:
            InputError: `mean` has another length, or an entry is not finite.
            ModelError: The cost is unbounded below: C is unbounded in a direction without risk.
        """
        held = self.check_mean(mean)
        solved = self.optimum_for(np.atleast_2d(self.alphas(held)))
        return np.asarray(solved[0] if held.ndim == 1 else solved)

    def optimum_for(self, alphas: Array) -> Array:
        """Return the best decisions (T,n) for expected returns (T,n) of the assets, whatever the loadings."""
        if self.layout is not None and self.has_inequalities:
            return least_costs(self.risk, self.risk_aversion, self.layout, alphas)
        return np.asarray(self.least_risk + self.response(alphas.T).T / (2.0 * self.risk_aversion))

    def regret(self, mean: ArrayLike, weights: ArrayLike) -> Any:
        """Return the regret of decisions for means; rows of both are paired, a single row is used for all.

        Formula: γ d'V d + (2γ V u* − B m)'d with d = u − u*: this avoids the difference of two nearly equal costs.
        """
        held, given = self.check_mean(mean), self.check_weights(weights)
        rows = {len(each) for each in (held, given) if each.ndim == 2} - {1}
        if len(rows) > 1:
            raise InputError(
                f"mean has {len(held)} rows and weights {len(given)}; expected as many, or a single row of one"
            )
        best = self.optimum(held)
        apart = np.asarray(given - best)
        lost = self.risk_aversion * self.risk.quadratic(apart.T)
        if self.has_inequalities:
            slope = 2.0 * self.risk_aversion * self.risk.times(best.T).T - self.alphas(held)
            lost = lost + (slope * apart).sum(axis=-1)
        return np.maximum(lost, 0.0)[()]

    def response(self, values: Array) -> Array:
        """Return M x for x (n,) or (n,m): 2γ times the derivative of optimal weights by expected returns, on H u = b.

        Formula: M = V⁻¹ − V⁻¹H'(H V⁻¹H')⁻¹H V⁻¹, or Z (Z'VZ)⁻¹Z' with Z a basis of the null space of H.
        """
        if isinstance(self.risk, FactorRisk):
            rows, solved, inner = self._equality_solves
            first = self.risk.solve(values)
            if not len(rows):
                return first
            return _without_rounding(first - solved @ (inner @ (rows @ first)), np.abs(first))
        if not len(self.equalities[0]):
            return self.risk.solve(values)
        basis, inside, free = self._inside
        size = np.abs(values).max(axis=0, initial=0.0)
        if _without_rounding(free.T @ values, size).any():
            raise singular_risk(0.0)
        if not basis.shape[1]:  # the equalities fix the decision
            return np.zeros(np.shape(values))
        return np.asarray(basis @ inside.solve(_without_rounding(basis.T @ values, size)))

    @cached_property
    def _equality_solves(self) -> tuple[Array, Array, Array]:
        rows = self.equalities[0]
        solved = self.risk.solve(rows.T)
        inner = np.linalg.pinv(rows @ solved, rcond=tolerances.CURVATURE, hermitian=True)
        return rows, solved, np.asarray(inner, dtype=np.float64)

    @cached_property
    def _inside(self) -> tuple[Array, Risk, Array]:
        """An orthonormal basis of the null space of H, the risk in it, and directions in it that have no risk."""
        rows = self.equalities[0]
        _, sizes, axes = np.linalg.svd(rows, full_matrices=True)
        basis = axes[int((sizes > tolerances.CURVATURE * sizes.max(initial=0.0)).sum()) :].T
        if not basis.shape[1]:
            return basis, self.risk, basis[:, :0]
        whole = self.risk.dense()
        variances, axes = np.linalg.eigh(basis.T @ whole @ basis)
        costs = variances > len(whole) * np.finfo(np.float64).eps * np.abs(whole).max()  # Z'VZ of rounding is no risk
        if costs.all():
            return basis, as_risk(basis.T @ whole @ basis), basis[:, :0]
        inside = as_risk(np.diag(variances[costs])) if costs.any() else self.risk
        return basis @ axes[:, costs], inside, basis @ axes[:, ~costs]

    @cached_property
    def least_risk(self) -> Array:
        """The decision (n,) of least risk on H u = b."""
        rows, sides = self.equalities
        if not len(rows):
            return np.zeros(self.n_assets)
        if isinstance(self.risk, FactorRisk):
            _, solved, inner = self._equality_solves
            return np.asarray(solved @ (inner @ sides))
        some = np.asarray(np.linalg.lstsq(rows, sides, rcond=None)[0], dtype=np.float64)
        return np.asarray(some - self.response(self.risk.times(some)))

    @cached_property
    def theta(self) -> Array:
        """Θ = B'M B/(4γ), shape (k,k).

        The regret of deciding for m̂ is (m̂−m)'Θ(m̂−m); with inequalities that is an upper bound.
        """
        loads = self.loadings
        found = self.response(np.eye(self.n_assets)) if loads is None else loads.T @ self.response(loads)
        found /= 4.0 * self.risk_aversion
        return np.asarray(0.5 * (found + found.T))

    def theta_times(self, values: Array) -> Array:
        """Return Θ x for x (k,) or (k,m) without forming Θ."""
        loaded = values if self.loadings is None else self.loadings @ values
        moved = self.response(loaded) / (4.0 * self.risk_aversion)
        return np.asarray(moved if self.loadings is None else self.loadings.T @ moved)

    def __repr__(self) -> str:
        what = "" if self.loadings is None else f", {self.n_signals} signals"
        return f"AlphaProblem({self.risk!r}{what}, risk aversion {self.risk_aversion:g}, {self.constraints!r})"


def _without_rounding(left: Array, size: Array) -> Array:
    """Return what is left of terms of this size that cancel, 0 where it is their rounding."""
    return np.asarray(np.where(np.abs(left) > tolerances.NO_VARIANCE * size, left, 0.0))


def least_costs(risk: Risk, risk_aversion: float, layout: Layout, alphas: Array) -> Array:
    """Return the minimisers (T,n) of γ u'V u − a'u over a layout for the rows a of `alphas`.

    The interior-point method needs an interior and strict convexity; otherwise an active-set method works on the matrix. The
    latter also takes few assets: a row of 4 to 30 in 0.5 ms, against 5 by interior point, with the same weights to 4e-16.
    """
    if risk.is_definite and risk.n_assets > _MOST_AT_ONCE:
        try:
            programme = RiskProgramme(risk, risk_aversion, layout)
            return np.array([programme.solve(row) for row in alphas])
        except SolverError:
            if risk.n_assets > _MOST_DENSE:
                raise
    hessian = 2.0 * risk_aversion * risk.dense()
    return solve_programmes(np.broadcast_to(hessian, (len(alphas), *hessian.shape)), -alphas, layout)


def checked_alpha_problem(problem: Any) -> AlphaProblem:
    """Return an `AlphaProblem`, or raise `InputError`."""
    if not isinstance(problem, AlphaProblem):
        raise InputError(f"problem must be an AlphaProblem, got {problem!r}")
    return problem
