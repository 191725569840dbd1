"""The largest error over time as a cone programme, for few signals where the iteration does not converge."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.alphas.observed import Moves
from inscrutable.errors import SolverError
from inscrutable.validation import Array

MOST_SIGNALS = 20


def most_error_by_cones(moves: Moves, theta: Array, weights: Array, limit: float) -> tuple[Array, float, Array]:
    """Return E, the price of regret and the multiplier of E ⪯ P(E) of max tr(QE), found by CVXPY and Clarabel.

    Raises:
        SolverError: CVXPY is not installed, or there is no solution to their accuracy.
    """
    try:
        import cvxpy
    except ImportError as missing:
        raise SolverError(
            "the rule over time did not converge; `pip install 'inscrutable[cvx]'` adds another method"
        ) from missing
    cp: Any = cvxpy
    n = len(theta)
    error = cp.Variable((n, n), symmetric=True)
    both = np.vstack([moves.transition, moves.public_sensor])
    joint = np.block([[moves.innovation, moves.cross], [moves.cross.T, moves.public_covariance]])
    kept = np.eye(len(both))[:, :n]
    later = both @ error @ both.T + joint - kept @ error @ kept.T >> 0
    spent = cp.trace(theta @ error) <= limit
    programme = cp.Problem(cp.Maximize(cp.trace(weights @ error)), [later, spent, error >> 0])
    try:
        programme.solve(solver="CLARABEL")
    except cp.error.SolverError as failure:
        raise SolverError(f"the cone programme of the rule over time was not solved: {failure}") from failure
    if error.value is None:
        raise SolverError(f"the cone programme of the rule over time was not solved: {programme.status}")
    values, vectors = np.linalg.eigh(0.5 * (error.value + error.value.T))
    multiplier = np.linalg.eigh(later.dual_value[:n, :n])
    return (
        (vectors * np.maximum(values, 0.0)) @ vectors.T,
        float(spent.dual_value),
        np.asarray((multiplier[1] * np.maximum(multiplier[0], 0.0)) @ multiplier[1].T),
    )
