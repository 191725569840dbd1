"""Random Markowitz markets, ordinary and degenerate, with their costs and gradients written out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RIDGE = 1e-10  # of the mean variance: a covariance of low rank that a Cholesky factor still accepts
VALUE_FLOOR = 0.02  # of the mean variance: positive values stay well away from zero


class Market(NamedTuple):
    """Means (X,U), covariances (X,U,U) and the paper's risk aversion γ of c(i,u) = γ u'Σ_i u − μ_i'u."""

    means: Array
    covariances: Array
    risk_aversion: float


def random_market(
    rng: np.random.Generator,
    n_states: int,
    n_assets: int,
    *,
    positive_value: bool = False,
    scale_spread: float = 0.0,
    duplicate: bool = False,
    singular: bool = False,
) -> Market:
    """Draw a market whose states alternate between factor models and Wishart covariances.

    `positive_value`: V > 0 on the whole simplex of beliefs. V is concave, so its least value is at a
    vertex e_i, and V(e_i) >= γ/(1'Σ_i⁻¹1) − max_j μ_ij; lowering all means by one constant raises V by it.
    `scale_spread`: orders of magnitude between the smallest and the largest state's costs.
    `duplicate`: the last asset is a copy of the first, so covariances are singular and minimisers are not unique.
    `singular`: covariances of rank about U/3 plus a tiny ridge.
    """
    risk_aversion = float(rng.uniform(1.0, 4.0))
    draws = [_low_rank, _low_rank] if singular else [_factor_model, _wishart]
    covariances = np.stack([draws[state % 2](rng, n_assets) for state in range(n_states)])
    means = rng.normal(0.0, 0.3, (n_states, n_assets))
    if duplicate and n_assets > 1:
        means[:, -1] = means[:, 0]
        covariances[:, -1, :] = covariances[:, 0, :]
        covariances[:, :, -1] = covariances[:, :, 0]
    if positive_value:
        means = _lowered(means, covariances, risk_aversion)
    factors = 10.0 ** rng.permutation(np.linspace(-scale_spread / 2, scale_spread / 2, n_states))
    return Market(means * factors[:, None], covariances * factors[:, None, None], risk_aversion)


def _factor_model(rng: np.random.Generator, n_assets: int) -> Array:
    loadings = rng.normal(0.0, 0.3, (n_assets, max(1, n_assets // 3)))
    return np.asarray(loadings @ loadings.T + np.diag(rng.uniform(0.02, 0.2, n_assets)))


def _wishart(rng: np.random.Generator, n_assets: int) -> Array:
    sample = rng.normal(0.0, 0.4, (n_assets, n_assets + 3))
    return np.asarray(sample @ sample.T / (n_assets + 3))


def _low_rank(rng: np.random.Generator, n_assets: int) -> Array:
    loadings = rng.normal(0.0, 0.3, (n_assets, max(1, n_assets // 3)))
    product = loadings @ loadings.T
    return np.asarray(product + RIDGE * np.trace(product) / n_assets * np.eye(n_assets))


def _lowered(means: Array, covariances: Array, risk_aversion: float) -> Array:
    ones = np.ones(means.shape[1])
    safe = np.array([risk_aversion / (ones @ np.linalg.pinv(covariance) @ ones) for covariance in covariances])
    shortfall = float((means.max(axis=1) - safe).max())
    mean_variance = float(np.einsum("ijj->", covariances)) / means.size
    return np.asarray(means - shortfall - VALUE_FLOOR * risk_aversion * mean_variance)


def random_belief(rng: np.random.Generator, n_states: int) -> Array:
    """Draw a belief with no entry below 0.05/X: safely in the interior."""
    return np.asarray(0.95 * rng.dirichlet(np.ones(n_states)) + 0.05 / n_states)


def costs(market: Market, action: Array) -> Array:
    """Return s(u) = (c(1,u),…,c(X,u)), one state at a time."""
    means, covariances, risk_aversion = market
    return np.array([risk_aversion * action @ s @ action - m @ action for m, s in zip(means, covariances, strict=True)])


def gradients(market: Market, action: Array) -> Array:
    """Return G(u), (U,X): column i is 2γΣ_i u − μ_i."""
    means, covariances, risk_aversion = market
    columns = [2 * risk_aversion * s @ action - m for m, s in zip(means, covariances, strict=True)]
    return np.stack(columns, axis=1)
