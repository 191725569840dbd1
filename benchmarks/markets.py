"""The seeded random markets and beliefs that every benchmark uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inscrutable import MarkowitzProblem
from oracles.markets import Market
from oracles.markets import random_market as broad_market

__all__ = ["Market", "beliefs", "broad_market", "market", "problem_of"]

Array = NDArray[np.float64]

SEED = 2004
RISK_AVERSION = 5.0
MEANS, VOLATILITIES = (-0.01, 0.02), (0.04, 0.12)
LEAST_COST = 0.005  # per period: optimal costs stay away from zero, where a share of |c*| would buy nothing


def market(n_states: int, n_assets: int) -> Market:
    """The market of the reproduction's law, at any size: sample correlations of U + 3 normal vectors.

    μ_ij and the standard deviations are uniform on `MEANS` and `VOLATILITIES`, per month. On the simplex one constant
    taken off all means raises every cost by it and changes no decision; it is chosen so that V ≥ `LEAST_COST`.
    """
    rng = np.random.default_rng([SEED, n_states, n_assets])
    means = rng.uniform(*MEANS, size=(n_states, n_assets))
    deviations = rng.uniform(*VOLATILITIES, size=(n_states, n_assets))
    factors = rng.standard_normal((n_states, n_assets, n_assets + 3))
    products = factors @ factors.transpose(0, 2, 1)
    scales = deviations / np.sqrt(np.einsum("ijj->ij", products))
    covariances = products * scales[:, :, None] * scales[:, None, :]
    least = float(MarkowitzProblem(means, covariances, RISK_AVERSION).optimal_cost(np.eye(n_states)).min())
    return Market(means - max(0.0, LEAST_COST - least), covariances, RISK_AVERSION)


def problem_of(drawn: Market) -> MarkowitzProblem:
    """The library's problem of a market."""
    return MarkowitzProblem(*drawn)


def beliefs(n: int, n_states: int, stream: int = 0) -> Array:
    """Beliefs (n,X) from a flat Dirichlet law; every stream has its own, so that nothing can be remembered."""
    return np.random.default_rng([SEED, 7, stream]).dirichlet(np.ones(n_states), n)
