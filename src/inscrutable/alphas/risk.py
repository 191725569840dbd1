"""Covariances of assets: a matrix, or a factor model that is never multiplied out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpstrf

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, Names, few
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array

_COVARIANCE = "a covariance has no negative eigenvalue"


class Risk(ABC):
    """The interface of a covariance V (n,n) of assets; operations apply to the columns of (n,m) arrays."""

    names: Names | None
    """Labels of the assets, where known."""

    @property
    @abstractmethod
    def diagonal(self) -> Array:
        """Variances of the assets, shape (n,)."""

    @abstractmethod
    def times(self, values: Array) -> Array:
        """Return V x for x (n,) or (n,m)."""

    @abstractmethod
    def solve(self, values: Array) -> Array:
        """Return V⁻¹ x for x (n,) or (n,m); raise `ModelError` where V is singular."""

    @abstractmethod
    def quadratic(self, values: Array) -> Array:
        """Return x'V x for x (n,), or for each column of (n,m)."""

    @abstractmethod
    def part(self, assets: np.ndarray) -> Risk:
        """Return the covariance of some of the assets, given by their numbers."""

    @abstractmethod
    def with_more(self, columns: Array, variances: float | Array = 0.0) -> Risk:
        """Return V + G G' + diag(d) for columns G (n,m) and d ≥ 0, a number or (n,)."""

    @property
    def is_definite(self) -> bool:
        """Whether no combination of assets is without risk."""
        return True

    @abstractmethod
    def dense(self) -> Array:
        """Return V as a matrix (n,n)."""

    @property
    def n_assets(self) -> int:
        """Number of assets n."""
        return int(self.diagonal.size)


def singular_risk(smallest: float) -> ModelError:
    """Return the error of a risk whose smallest eigenvalue is zero to rounding."""
    return ModelError(
        f"the risk is singular: its smallest eigenvalue is {smallest:.3g}, and something costs no risk at all; add "
        "specific variances, or leave out assets that others make up"
    )


class DenseRisk(Risk):
    """A covariance that is given as a matrix.

    Args:
        covariance: V, shape (n,n), squared return per period.
        names: Labels of the assets.
    """

    def __init__(self, covariance: Array, names: Names | None = None) -> None:
        self._matrix, self.names = covariance, names

    @property
    def diagonal(self) -> Array:
        """Variances of the assets, shape (n,)."""
        return np.diag(self._matrix)

    @cached_property
    def _factor(self) -> tuple[Array, np.ndarray, Any]:
        """The standard deviations, an order of the assets, and the Cholesky factor of the correlations in this order.

        The largest pivot comes first, so that the last one shows whether V is singular. Without an order rounding of early
        pivots adds up: one of a hundred singular covariances passed.
        """
        unit = np.sqrt(np.where(self.diagonal > 0.0, self.diagonal, 1.0))
        factor, order, rank, _ = dpstrf(self._matrix / np.outer(unit, unit), lower=1, tol=tolerances.NO_VARIANCE)
        if rank < len(unit):
            raise singular_risk(float(np.linalg.eigvalsh(self._matrix)[0]))
        return unit, order - 1, (factor, True)

    @cached_property
    def is_definite(self) -> bool:
        """Whether no combination of assets is without risk."""
        eigenvalues = np.linalg.eigvalsh(self._matrix)
        return bool(eigenvalues[0] > tolerances.CURVATURE * eigenvalues[-1])

    def times(self, values: Array) -> Array:
        """Return V x."""
        return np.asarray(self._matrix @ values)

    def solve(self, values: Array) -> Array:
        """Return V⁻¹ x, refined once."""
        found = self._solve(values)
        return np.asarray(found + self._solve(values - self._matrix @ found))

    def _solve(self, values: Array) -> Array:
        unit, order, factor = self._factor
        found = np.empty(values.T.shape).T
        found[order] = cho_solve(factor, (values.T / unit).T[order])
        return np.asarray((found.T / unit).T)

    def quadratic(self, values: Array) -> Array:
        """Return x'V x."""
        return np.asarray((values * (self._matrix @ values)).sum(axis=0))

    def part(self, assets: np.ndarray) -> Risk:
        """Return the covariance of some of the assets."""
        return DenseRisk(self._matrix[np.ix_(assets, assets)])

    def with_more(self, columns: Array, variances: float | Array = 0.0) -> Risk:
        """Return V + G G' + diag(d)."""
        more = self._matrix + columns @ columns.T
        more[np.diag_indices(len(more))] += variances
        return DenseRisk(more)

    def dense(self) -> Array:
        """Return V."""
        return self._matrix

    def __repr__(self) -> str:
        return f"DenseRisk({self.n_assets} assets)"


@dataclass(frozen=True, init=False, eq=False, repr=False)
class FactorRisk(Risk):
    """The covariance of n assets by k factors and specific variances, whose n×n matrix is never formed.

    Formula: V = F Ω F' + D; V⁻¹ = D⁻¹ − D⁻¹L (I + L'D⁻¹L)⁻¹ L'D⁻¹ with L = F Ω^{1/2}.

    Args:
        exposures: F, shape (n,k), of assets to factors.
        factor_covariance: Ω, shape (k,k), squared return per period; may be singular.
        specific: Diagonal of D, shape (n,), squared return per period, above zero.

    Labelled tables are aligned with each other: assets by the rows of `exposures`, factors by its columns.

    Raises:
        InputError: Shapes or labels disagree, an entry is not finite, Ω is not symmetric.
        ModelError: Ω is indefinite (its smallest eigenvalue is named), or a specific variance is not above zero.

    Cost: O(n k²) time once, O(n k) memory; each product or solve O(n k). Source: Woodbury's identity.

    Example:
        >>> risk = FactorRisk([[1.0], [0.5]], [[0.04]], [0.01, 0.02])
        >>> risk.dense().round(3).tolist(), risk.solve(risk.times(np.array([1.0, -1.0]))).round(12).tolist()
        ([[0.05, 0.02], [0.02, 0.03]], [1.0, -1.0])
    """

    exposures: Array
    factor_covariance: Array
    specific: Array
    names: Names | None

    def __init__(self, exposures: ArrayLike, factor_covariance: ArrayLike, specific: ArrayLike) -> None:
        assets, factors = Axis("asset", learns=True), Axis("factor", learns=True)
        loads = validation.finite_array(exposures, "exposures", ndim=2, axes=(assets, factors))
        n, k = loads.shape
        if not n:
            raise InputError(f"exposures has shape {loads.shape}, expected at least one asset")
        between = validation.finite_array(factor_covariance, "factor_covariance", ndim=2, axes=(factors, factors))
        if between.shape != (k, k):
            raise InputError(f"factor_covariance has shape {between.shape}, expected {(k, k)} for {k} factors")
        if k:
            validation.check_positive_semidefinite(between, "factor_covariance", _COVARIANCE)
        own = validation.finite_array(specific, "specific", ndim=1, axes=(assets,))
        if own.shape != (n,):
            raise InputError(f"specific has {own.size} entries, expected one per asset: {n}")
        if own.min() <= 0:
            j = int(own.argmin())
            name = "" if assets.names is None else f" ({assets.names[j]})"
            raise ModelError(
                f"specific is {own[j]:.3g} at asset {j}{name}; every asset needs a variance of its own above 0"
            )
        object.__setattr__(self, "exposures", loads)
        object.__setattr__(self, "factor_covariance", 0.5 * (between + between.T))
        object.__setattr__(self, "specific", own)
        object.__setattr__(self, "names", assets.names)
        validation.read_only(self, "exposures", "factor_covariance", "specific")

    @classmethod
    def from_returns(cls, returns: ArrayLike, n_factors: int) -> FactorRisk:
        """Return the covariance of the first principal components of returns, plus the remaining variance of each asset.

        Args:
            returns: Shape (T,n), return per period; columns of a table name the assets.
            n_factors: k, from 0 to the smaller of T − 1 and n.

        Raises:
            InputError: An entry is not finite, a column is constant, there are fewer than two rows, or `n_factors` is out of
                range.

        Cost: O(T n min(T, n)); the sample covariance is not formed. Source: the principal-factor method.

        Example:
            >>> FactorRisk.from_returns([[0.01, 0.02], [-0.01, 0.0], [0.03, -0.02]], 1)
            FactorRisk(2 assets, 1 factors)
        """
        assets = Axis("asset", learns=True)
        rows = validation.finite_array(returns, "returns", ndim=2, axes=(None, assets))
        if len(rows) < 2 or not rows.shape[1]:
            raise InputError(f"returns has shape {rows.shape}, expected at least two rows and one asset")
        k = validation.count(n_factors, "n_factors", least=0)
        if k > min(len(rows) - 1, rows.shape[1]):
            raise InputError(
                f"n_factors is {k}, expected at most {min(len(rows) - 1, rows.shape[1])} of {rows.shape} returns"
            )
        moved = (rows - rows.mean(axis=0)) / np.sqrt(len(rows) - 1)
        variances = (moved**2).sum(axis=0)
        constant = np.flatnonzero(validation.constant_columns(rows))
        if constant.size:
            j = int(constant[0])
            raise InputError(
                f"returns of asset {assets.names[j] if assets.names else j} are constant: a factor model divides by the "
                "variance of each asset; leave it out"
            )
        _, sizes, axes = np.linalg.svd(moved, full_matrices=False)
        loads = axes[:k].T * sizes[:k]
        least = tolerances.COVARIANCE_FLOOR * variances
        found = cls(loads, np.eye(k), np.maximum(variances - (loads**2).sum(axis=1), least))
        object.__setattr__(found, "names", assets.names)
        return found

    @cached_property
    def root(self) -> Array:
        """L = F Ω^{1/2}, shape (n,k): V = L L' + D."""
        values, vectors = np.linalg.eigh(self.factor_covariance)
        return np.asarray(self.exposures @ (vectors * np.sqrt(np.maximum(values, 0.0))))

    @cached_property
    def _inner(self) -> tuple[Array, Any]:
        scaled = self.root / self.specific[:, None]
        inner = self.root.T @ scaled
        inner[np.diag_indices(len(inner))] += 1.0
        return scaled, cho_factor(inner, lower=True) if len(inner) else None

    @property
    def diagonal(self) -> Array:
        """Variances of the assets, shape (n,)."""
        return np.asarray((self.root**2).sum(axis=1) + self.specific)

    def times(self, values: Array) -> Array:
        """Return V x."""
        return np.asarray(self.root @ (self.root.T @ values) + (self.specific * values.T).T)

    def solve(self, values: Array) -> Array:
        """Return V⁻¹ x, refined once."""
        found = self._solve(values)
        return np.asarray(found + self._solve(values - self.times(found)))

    def _solve(self, values: Array) -> Array:
        scaled, factor = self._inner
        first = (values.T / self.specific).T
        return first if factor is None else np.asarray(first - scaled @ cho_solve(factor, scaled.T @ values))

    def quadratic(self, values: Array) -> Array:
        """Return x'V x."""
        common = self.root.T @ values
        return np.asarray((common**2).sum(axis=0) + self.specific @ values**2)

    def part(self, assets: np.ndarray) -> Risk:
        """Return the covariance of some of the assets."""
        return _of(self.root[assets], self.specific[assets])

    def with_more(self, columns: Array, variances: float | Array = 0.0) -> Risk:
        """Return V + G G' + diag(d)."""
        return _of(np.hstack([self.root, columns]), self.specific + variances)

    def dense(self) -> Array:
        """Return V as a matrix (n,n), formed on demand only."""
        return np.asarray(self.root @ self.root.T + np.diag(self.specific))

    def __repr__(self) -> str:
        return f"FactorRisk({self.n_assets} assets, {self.exposures.shape[1]} factors)"


def _of(root: Array, specific: Array) -> FactorRisk:
    """Return the covariance L L' + D, from valid arrays."""
    found = object.__new__(FactorRisk)
    kept = {"exposures": root, "factor_covariance": np.eye(root.shape[1]), "specific": specific, "root": root}
    vars(found).update(kept, names=None)
    return found


def as_risk(given: Any) -> Risk:
    """Return a covariance of assets from a matrix or a `FactorRisk`.

    Raises:
        InputError: `given` is not a symmetric matrix of finite numbers.
        ModelError: `given` is indefinite; the message states its smallest eigenvalue.
    """
    if isinstance(given, Risk):
        return given
    assets = Axis("asset", learns=True)
    matrix = validation.finite_array(given, "risk", ndim=2, axes=(assets, assets))
    if matrix.shape[0] != matrix.shape[1] or not matrix.size:
        said = "" if assets.names is None else f" ({few(assets.names)})"
        raise InputError(f"risk has shape {matrix.shape}, expected a covariance (n,n) of assets{said}")
    validation.check_positive_semidefinite(matrix, "risk", _COVARIANCE)
    if not np.diag(matrix).any():
        raise ModelError("risk is zero: nothing limits a decision")
    symmetric = 0.5 * (matrix + matrix.T)
    symmetric.flags.writeable = False
    return DenseRisk(symmetric, assets.names)
