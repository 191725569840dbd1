"""The observer's error covariance under a rule, E = T diag(e) T' after P = T T' before, and the message that attains it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from inscrutable import tolerances
from inscrutable.validation import Array

_LARGE = 500  # assets


@dataclass(frozen=True, eq=False)
class ErrorLaw:
    """Covariances before and after a decision in one basis: P = T T' before, E = T diag(e) T' after.

    In coordinates z = T⁺(m − m̂⁻), independent with variance 1 for the observer, the rule reveals ẑ = (1 − e) z + √(e (1 − e))
    g with g standard normal. Then m̂ = m̂⁻ + T ẑ is the observer's mean after the decision, and the covariance of m − m̂ is E.
    A share e = 0 reveals z exactly, e = 1 nothing. This is the rule m̂ = m̂⁻ + (I − E P⁻¹)(m − m̂⁻) + N(0, E − E P⁻¹ E).

    Args:
        basis: T, shape (n,q).
        dual: T⁺, shape (q,n).
        shares: e, shape (q,), from 0 to 1.
        frame: Orthonormal columns R⁻¹T, shape (n,q), with R the symmetric root of P, for large P its Cholesky factor; both are
            unique. None: computed at the first draw.
    """

    basis: Array
    dual: Array
    shares: Array
    frame: Array | None = None

    @property
    def bits(self) -> float:
        """−½ Σ log2 e; infinite where some e is 0."""
        return bits_of(self.shares)

    @property
    def before(self) -> Array:
        """P, shape (n,n)."""
        return np.asarray(self.basis @ self.basis.T)

    @property
    def covariance(self) -> Array:
        """E, shape (n,n)."""
        return np.asarray((self.basis * self.shares) @ self.basis.T)

    def weighed(self, weights: Array) -> float:
        """Return tr(weights E)."""
        diagonal = np.diag(weights)
        if np.count_nonzero(weights) == np.count_nonzero(diagonal):
            return float(diagonal @ (self.basis**2 @ self.shares))
        return float(((weights @ self.basis) * self.basis).sum(axis=0) @ self.shares)

    def message(self, difference: Array, rng: np.random.Generator) -> Array:
        """Return m̂ − m̂⁻ as drawn for m − m̂⁻, both of shape (…,n)."""
        return self.told(difference, rng.standard_normal(difference.shape))

    def told(self, difference: Array, noise: Array) -> Array:
        """Return m̂ − m̂⁻ for m − m̂⁻ and standard normal noise, all of shape (…,n).

        The result does not depend on the signs of eigenvectors or the basis within equal shares, which differ between
        libraries.
        """
        spread = np.sqrt(self.shares * (1.0 - self.shares))
        shown = (1.0 - self.shares) * (difference @ self.dual.T) + spread * (noise @ self._frame)
        return np.asarray(shown @ self.basis.T)

    @cached_property
    def _frame(self) -> Array:
        if self.frame is not None:
            return self.frame
        if len(self.basis) > _LARGE and self.basis.shape[0] == self.basis.shape[1]:
            factor = _well_conditioned(self.before)
            if factor is not None:
                return np.asarray(solve_triangular(factor, self.basis, lower=True))
        left, _, right = np.linalg.svd(self.basis, full_matrices=False)
        return np.asarray(left @ right)

    def sensor(self) -> tuple[Array, Array]:
        """Return the equivalent sensor: rows (s,n) of what it reads, and their noise variances (s,), 0 where exact."""
        told = self.shares < 1.0
        return self.dual[told], self.shares[told] / (1.0 - self.shares[told])


def bits_of(shares: Array, counts: Array | None = None) -> float:
    """Return −½ Σ counts log2 e."""
    if not (shares > 0.0).all():
        return float("inf")
    logs = np.log2(shares)
    return 0.0 - 0.5 * float(logs.sum() if counts is None else counts @ logs)


def turned(root: tuple[Array, Array], turn: Array, shares: Array) -> ErrorLaw:
    """Return the law whose T is one of `root_of` times the orthonormal columns `turn`, (q,q)."""
    basis, dual = root
    # A Cholesky factor is the one root itself.
    is_factor = len(basis) > _LARGE and not np.triu(basis, 1).any()
    return ErrorLaw(basis @ turn, turn.T @ dual, shares, turn if is_factor else None)


def sizes_of(covariance: Array) -> Array:
    """Return the standard deviations (n,) of a covariance, 1 where there is none."""
    variances = np.diag(covariance)
    return np.asarray(np.sqrt(np.where(variances > 0.0, variances, 1.0)))


def root_of(covariance: Array, units: Array | None = None) -> tuple[Array, Array]:
    """Return T and T⁺ with T T' the covariance and T⁺T = I, shapes (n,q) and (q,n); q is its rank.

    Variances count as none relative to the squares of `units`, (n,), the sizes of the coordinates; None: all are one.
    """
    if units is not None:
        basis, dual = root_of(covariance / np.outer(units, units))
        return units[:, None] * basis, dual / units
    held = 0.5 * (covariance + covariance.T)
    factor = _well_conditioned(held) if len(held) > _LARGE else None
    if factor is not None:  # a tenth of the time of an eigendecomposition
        return factor, np.asarray(solve_triangular(factor, np.eye(len(held)), lower=True))
    values, vectors = np.linalg.eigh(held)
    kept = values > tolerances.NO_VARIANCE * max(float(values.max(initial=0.0)), np.finfo(float).tiny)
    size = np.sqrt(values[kept])
    return np.asarray(vectors[:, kept] * size), np.asarray((vectors[:, kept] / size).T)


def _well_conditioned(covariance: Array) -> Array | None:
    """Return the Cholesky factor; None where it is too inaccurate."""
    try:
        factor = np.asarray(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        return None
    sizes = np.diag(factor)
    return factor if sizes.min() > tolerances.WELL_CONDITIONED * sizes.max() else None


def law_between(before: tuple[Array, Array], error: Array) -> ErrorLaw:
    """Return the law with covariance T T' before, given as by `root_of`, and the error covariance after."""
    dual = before[1]
    inside = dual @ error @ dual.T
    shares, turn = np.linalg.eigh(0.5 * (inside + inside.T))
    # A share of rounding size would add noise of its square root, about 1e-8, where the rule reveals all.
    shares = np.where(shares > 1.0 - tolerances.ALL_LEFT, 1.0, np.where(shares < tolerances.NO_VARIANCE, 0.0, shares))
    return turned(before, turn, shares)


def after_sensor(before: tuple[Array, Array], rows: Array, noise: Array) -> ErrorLaw:
    """Return the law after a sensor with these rows and noise variances; T T' before, given as by `root_of`."""
    basis, _ = before
    seen = rows @ basis
    read = seen @ seen.T + np.diag(noise)
    kept = seen.T @ np.linalg.lstsq(read, seen, rcond=None)[0]
    return law_between(before, basis @ (np.eye(basis.shape[1]) - kept) @ basis.T)
