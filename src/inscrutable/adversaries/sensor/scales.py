"""Scales of a sensor's columns, whose directions are known, from row sums of one and the frequencies of symbols.

The directions d_y leave scales s_y with Σ_y s_y d_y = 1. Given the beliefs, the symbols' likelihood is Π_k s_{y_k}
d_{y_k}'m_k, so that the scales maximise Σ_y n_y log s_y under these equations: a concave programme with a unique solution for
any number of symbols.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.validation import Array

_NEWTON_STEPS = 200

_UNSEEN = 0.5
"""Pseudo-count of a symbol that was never observed, as in Jeffreys' prior."""

_KEPT = 0.9
"""Largest share of a scale by which one step may reduce it."""


class Scales(NamedTuple):
    """Factors s_y of the columns.

    Args:
        factors: Shape (Y,).
        spread: Their standard deviations, shape (Y,), from the symbols' frequencies and the directions' errors.
        rest: One minus the row sums, shape (X,): the probability of symbols that were never seen.
        is_determined: Whether the equations alone determine the factors.
        excess: Largest distance of a row's sum from one, in standard deviations of the directions' errors.
    """

    factors: Array
    spread: Array
    rest: Array
    is_determined: bool
    excess: float


def scaled(columns: Array, counts: np.ndarray, errors: Array, *, has_unseen: bool = False) -> Scales:
    """Return the scales of columns (Y,X) of symbols seen `counts` (Y,) times.

    Args:
        columns: Largest entry one.
        counts: n_y, above 0.
        errors: Standard deviation of each entry of `columns`, shape (Y,X).
        has_unseen: Whether unobserved symbols may have the probability that the rows lack.
    """
    n_symbols, n_states = columns.shape
    system, seen = columns.T, counts.astype(np.float64)
    if has_unseen:
        system = np.column_stack([system, np.eye(n_states)])
        seen = np.concatenate([seen, np.full(n_states, _UNSEEN / n_states)])
    first = np.minimum(counts / counts.sum() / columns.mean(axis=1), 1.0)
    row_errors = np.sqrt(first**2 @ errors**2)
    row_errors = np.maximum(row_errors, tolerances.REACHED_BELIEF)
    factors, covariance = _likeliest(system, seen, row_errors)
    row_errors = np.maximum(np.sqrt(factors[:n_symbols] ** 2 @ errors**2), tolerances.REACHED_BELIEF)
    factors, covariance = _likeliest(system, seen, row_errors)
    sums = system @ factors
    return Scales(
        factors[:n_symbols],
        np.sqrt(np.diag(covariance)[:n_symbols]),
        np.maximum(factors[n_symbols:], 0.0) if has_unseen else np.zeros(n_states),
        not has_unseen and n_symbols <= n_states and _is_independent(columns, float(row_errors.max())),
        float((np.abs(sums - 1.0) / (row_errors + tolerances.TRANSITION_SUM)).max()),
    )


def _is_independent(columns: Array, error: float) -> bool:
    """Whether the directions are independent beyond their errors."""
    units = columns / np.linalg.norm(columns, axis=1, keepdims=True)
    least = float(np.linalg.svd(units, compute_uv=False)[-1])
    return least > max(3.0 * error, tolerances.RANK)


def _likeliest(system: Array, counts: Array, errors: Array) -> tuple[Array, Array]:
    """Maximise Σ n log s − ½ Σ ((D s − 1)/e)² by Newton's method, and return s with the inverse Hessian.

    Each step is one least-squares problem, whose accuracy is that of D and not of D'D.
    """
    factors = counts / counts.sum() / system.mean(axis=0)
    factors /= float((system @ factors).mean())
    roots = np.sqrt(counts)
    rows = system / errors[:, None]
    stacked = rows
    for _ in range(_NEWTON_STEPS):
        stacked = np.vstack([rows, np.diag(roots / factors)])
        wanted = np.concatenate([(1.0 - system @ factors) / errors, roots])
        # Columns in units of the factors: rare and common symbols have the same relative accuracy.
        step = np.linalg.lstsq(stacked * factors, wanted, rcond=None)[0]
        fall = float(-step.min())
        share = 1.0 if fall < _KEPT else _KEPT / fall
        factors = factors * (1.0 + share * step)
        if float(np.abs(step).max()) <= tolerances.STATIONARITY:
            break
    inverse = np.linalg.pinv(stacked * factors, rcond=tolerances.TINY)
    return factors, factors[:, None] * (inverse @ inverse.T) * factors
