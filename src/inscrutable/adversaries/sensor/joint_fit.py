"""Joint least-squares fit of transition and sensor columns to beliefs, by Gauss-Newton steps."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.sensor.steps import filter_weights
from inscrutable.validation import Array

_STEPS = 60


def jointly(before: Array, held: Array, symbols: np.ndarray, transition: Array, columns: Array) -> tuple[Array, Array]:
    """Return the transition (X,X) and columns (Y,X) of least weighted squared error in the steps between beliefs.

    Formula: min Σ_k w_k ‖π_k − diag(b_y)P'π_{k−1} / 1'diag(b_y)P'π_{k−1}‖² over log P and log b, from a first guess.
    """
    used = symbols >= 0
    before, held, symbols = before[used], held[used], symbols[used]
    transition = np.maximum(transition, tolerances.REACHED_BELIEF)
    transition = transition / transition.sum(axis=1, keepdims=True)
    damping, loss = tolerances.DAMPING, np.inf
    best = transition, columns
    for _ in range(_STEPS):
        misses, slopes = _linearised(before, held, symbols, transition, columns)
        size = float(misses @ misses)
        if size < loss:
            gain, loss, best, damping = loss - size, size, (transition, columns), damping / 10.0
            if gain <= tolerances.PARAMETER * loss:
                break
        else:
            if damping > 1.0:
                break
            damping *= 100.0
            transition, columns = best
            misses, slopes = _linearised(before, held, symbols, transition, columns)
        scale = np.sqrt(damping) * np.linalg.norm(slopes, axis=0).max()
        rows = np.vstack([slopes, scale * np.eye(slopes.shape[1])])
        step = np.linalg.lstsq(rows, np.concatenate([misses, np.zeros(slopes.shape[1])]), rcond=None)[0]
        step *= min(1.0, 1.0 / max(float(np.abs(step).max()), tolerances.TINY))
        split = transition.size
        transition = best[0] * np.exp(step[:split].reshape(transition.shape))
        transition = transition / transition.sum(axis=1, keepdims=True)
        columns = best[1] * np.exp(step[split:].reshape(columns.shape))
        columns = columns / columns.max(axis=1, keepdims=True)
    return best


def _linearised(
    before: Array, held: Array, symbols: np.ndarray, transition: Array, columns: Array
) -> tuple[Array, Array]:
    """Return weighted residuals (K·X,) and their derivatives by log P and log b, (K·X, X² + Y·X)."""
    count, n_states = before.shape
    predicted = before @ transition
    joint = predicted * columns[symbols]
    shown = joint / joint.sum(axis=1, keepdims=True)
    roots = np.sqrt(filter_weights(predicted, held, transition))
    slopes = roots[:, None, None] * shown[:, :, None] * (np.eye(n_states) - shown[:, None, :])
    # The prediction is linear in P; the derivative of row P_i by log P_ij is P_ij (e_j − P_i).
    moves = before[:, :, None] * transition  # (K,i,j)
    of_rows = slopes / np.maximum(predicted, tolerances.TINY)[:, None, :]  # (K,x,j)
    through = of_rows[:, :, None, :] * moves[:, None]  # (K,x,i,j)
    through = through - through.sum(axis=3, keepdims=True) * transition
    of_columns = np.zeros((count, n_states, len(columns), n_states))
    of_columns[np.arange(count), :, symbols] = slopes
    found = np.concatenate([through.reshape(count * n_states, -1), of_columns.reshape(count * n_states, -1)], axis=1)
    return (roots[:, None] * (held - shown)).reshape(-1), found
