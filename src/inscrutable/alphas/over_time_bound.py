"""Dual bounds of the programmes over time: bounds for every causal rule, from any multiplier Z ⪰ 0 of E ⪯ P(E).

P(E) is concave, so that E ⪯ P(E) implies E ⪯ A_L E A_L' + W_L with A_L and W_L taken at any E₀; a convex cost is at least
its tangent at E₀. The rest is linear in E: with μ ≥ 0 and R = ∇ + μΘ + Z − A_L' Z A_L ⪰ 0 its least value is −μr − tr(Z W_L)
plus a constant. Where R is indefinite by rounding, a larger Z (a Stein equation) or a larger μ compensates for R₋, whichever
costs less.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh, solve_discrete_lyapunov

from inscrutable import tolerances
from inscrutable.alphas.observed import Moves
from inscrutable.validation import Array


def least_bits_bound(moves: Moves, theta: Array, limit: float, error: Array, price: float, multiplier: Array) -> float:
    """Return a lower bound of the bits per step of every causal rule with tr(ΘE) ≤ limit.

    Args:
        moves: The dynamics of the belief.
        theta: Θ, shape (n,n).
        limit: r.
        error: E₀ ≻ 0, shape (n,n), near the optimum.
        price: μ, in nats per unit of regret.
        multiplier: Z ⪰ 0, shape (n,n).
    """
    before, moved = moves.predicted(error)
    rest = before - moved @ error @ moved.T
    inverse, inverse_error = np.linalg.pinv(before, hermitian=True), np.linalg.inv(error)
    slope = 0.5 * (moved.T @ inverse @ moved - inverse_error)
    missing = slope + price * theta + multiplier - moved.T @ multiplier @ moved
    nats = 0.5 * (_log_size(before) - _log_size(error))
    found = nats + float(np.sum((0.5 * inverse - multiplier) * rest)) - price * limit
    return float((found - _made_up(missing, moved, rest, theta, limit)) / np.log(2.0))


def most_error_bound(
    moves: Moves, theta: Array, weights: Array, limit: float, error: Array, price: float, multiplier: Array
) -> float:
    """Return an upper bound of tr(QE) of every causal rule with tr(ΘE) ≤ limit; `price` is in units of tr(QE)."""
    before, moved = moves.predicted(error)
    rest = before - moved @ error @ moved.T
    missing = price * theta - weights + multiplier - moved.T @ multiplier @ moved
    return float(price * limit + np.sum(multiplier * rest) + _made_up(missing, moved, rest, theta, limit))


def _log_size(matrix: Array) -> float:
    values = np.linalg.eigvalsh(matrix)
    return float(np.log(values[values > tolerances.NO_VARIANCE * values[-1]]).sum())


def _made_up(missing: Array, moved: Array, rest: Array, theta: Array, limit: float) -> float:
    """Return the loss of the bound by making R positive semidefinite; infinite where neither way exists."""
    values, vectors = np.linalg.eigh(0.5 * (missing + missing.T))
    lost = (vectors * np.maximum(-values, 0.0)) @ vectors.T
    if not lost.any():
        return 0.0
    found = float("inf")
    if np.abs(np.linalg.eigvals(moved)).max() < 1.0 - tolerances.STABLE:
        found = float(np.sum(solve_discrete_lyapunov(moved.T, lost) * rest))
    weights = np.linalg.eigvalsh(theta)
    if weights[0] > tolerances.NO_VARIANCE * weights[-1]:
        found = min(found, limit * float(eigh(lost, theta, eigvals_only=True)[-1]))
    return max(found, 0.0)
