"""Infer a fund's weights from its returns and the returns of its possible assets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False, repr=False)
class InferredWeights(Summarised, Saved):
    """The weights behind a fund's returns.

    Args:
        weights: The least-squares estimate, shape (U,); of least norm where it is not unique.
        covariance: Covariance of the estimate, shape (U,U); zero along unidentified directions: see `rank`.
        rank: Number of identified directions, at most U − 1, because the sum is known.
        noise: Standard deviation of the error of a fund's return, given or estimated; NaN where no residual degree of freedom
            is left.

    Source: Sharpe, Asset allocation: management style and performance measurement (1992), without its inequalities.

    Example:
        >>> infer_weights([0.02, 0.0225], [[0.02, 0.04, 0.0], [0.03, 0.0, 0.03]], noise=0.0)
        weights [0.5000 0.2500 0.2500], identified; standard errors [0 0 0]
    """

    weights: Array
    covariance: Array
    rank: int
    noise: float

    @property
    def is_identified(self) -> bool:
        """Whether the least-squares estimate is unique."""
        return self.rank == len(self.weights) - 1

    @property
    def standard_errors(self) -> Array:
        """Standard error of each weight, shape (U,); infinite where the weights are not identified."""
        if not self.is_identified:
            return np.full(len(self.weights), np.inf)
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0)))

    def summary(self) -> str:
        """Return one line for a person to read."""
        weights, errors = (
            "[" + " ".join(form.format(x) for x in each) + "]"
            for form, each in (("{:.4f}", self.weights), ("{:.2g}", self.standard_errors))
        )
        known = "identified" if self.is_identified else f"{self.rank} of {len(self.weights) - 1} directions identified"
        return f"weights {weights}, {known}; standard errors {errors}"


def infer_weights(
    portfolio_returns: ArrayLike, returns: ArrayLike, *, noise: float | None = None, total: float = 1.0
) -> InferredWeights:
    """Return the weights behind a fund's returns, for a fund that is rebalanced to the same weights every period.

    Formula: argmin Σ_t (v_t − w'r_t)² subject to 1'w = total; covariance σ² N (N'R'RN)⁻¹ N', with N a basis of the weights
    that sum to zero. Without noise, U − 1 returns of full rank determine the weights exactly.

    Args:
        portfolio_returns: v, shape (T,), fractions; of published values V they are V[1:] / V[:-1] − 1.
        returns: R, of every asset in the same periods, shape (T,U).
        noise: σ, standard deviation of the error of a fund's return; None: estimated from the residuals.
        total: The sum of the weights.

    Raises:
        InputError: Shapes disagree, there is no period or asset, a number is not finite, or noise is negative.

    Cost: one singular value decomposition of (T,U−1).

    Source: least squares with a linear constraint.

    Example:
        >>> found = infer_weights([0.012, 0.021], [[0.01, 0.02], [0.03, 0.0]])
        >>> print(found.weights.round(3), found.is_identified)
        [0.71 0.29] True
    """
    periods = Axis("period", learns=True)
    table = validation.finite_array(returns, "returns", ndim=2, axes=(periods, Axis("asset", learns=True)))
    values = validation.finite_array(portfolio_returns, "portfolio_returns", ndim=1, axes=(periods,))
    if len(values) != len(table) or not table.size:
        raise InputError(f"{len(values)} returns of the fund need a table of as many rows, got shape {table.shape}")
    known = None if noise is None else validation.non_negative(noise, "noise")
    count = table.shape[1]
    start = np.full(count, validation.number_of(total, "total") / count)
    basis = np.linalg.svd(np.ones((1, count)))[2][1:].T  # (U, U-1), orthonormal
    left, sizes, right = np.linalg.svd(table @ basis, full_matrices=False)
    some = sizes > tolerances.RANK * float(np.linalg.norm(table))
    rank, gap = int(some.sum()), values - table @ start
    inner = right[some].T / sizes[some]
    found = start + basis @ (inner @ (left[:, some].T @ gap))
    spare = len(values) - rank
    if known is None:
        known = float(np.sqrt(((values - table @ found) ** 2).sum() / spare)) if spare > 0 else float("nan")
    wide = basis @ inner
    return InferredWeights(found, known**2 * wide @ wide.T, rank, known)
