"""Joint least-squares fit of transition and sensor columns to beliefs, by Gauss-Newton steps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.sensor.steps import filter_weights
from inscrutable.validation import Array

_STEPS = 60


class JointFit(NamedTuple):
    """A transition (X,X), columns (Y,X), the weighted squared error, and derivatives of its residuals by log P and log b."""

    transition: Array
    columns: Array
    loss: float
    slopes: Array


def jointly(
    before: Array, held: Array, symbols: np.ndarray, transition: Array, columns: Array, *, is_sensor: bool = False
) -> JointFit:
    """Return the transition and columns of least weighted squared error in the steps between beliefs.

    Formula: min Σ_k w_k ‖π_k − diag(b_y)P'π_{k−1} / 1'diag(b_y)P'π_{k−1}‖² over log P and log b, from a first guess. With
    `is_sensor` the columns add up to one in every state; otherwise each has its own scale.
    """
    used = symbols >= 0
    before, held, symbols = before[used], held[used], symbols[used]
    transition = np.maximum(transition, tolerances.REACHED_BELIEF)
    transition = transition / transition.sum(axis=1, keepdims=True)
    if is_sensor:
        columns = _in_scale(np.maximum(columns, tolerances.REACHED_BELIEF), is_sensor=True)
    damping, best = tolerances.DAMPING, JointFit(transition, columns, np.inf, np.empty((0, 0)))
    for _ in range(_STEPS):
        misses, slopes = _linearised(before, held, symbols, transition, columns)
        if is_sensor:
            slopes = _of_shares(slopes, columns)
        size = float(misses @ misses)
        if size < best.loss:
            gain, best, damping = best.loss - size, JointFit(transition, columns, size, slopes), damping / 10.0
            downhill = misses
            if gain <= tolerances.PARAMETER * best.loss:
                break
        else:
            if damping > 1.0:
                break
            damping *= 100.0
        scale = np.sqrt(damping) * np.linalg.norm(best.slopes, axis=0).max()
        rows = np.vstack([best.slopes, scale * np.eye(best.slopes.shape[1])])
        step = np.linalg.lstsq(rows, np.concatenate([downhill, np.zeros(best.slopes.shape[1])]), rcond=None)[0]
        step *= min(1.0, 1.0 / max(float(np.abs(step).max()), tolerances.TINY))
        split = transition.size
        transition = best.transition * np.exp(step[:split].reshape(transition.shape))
        transition = transition / transition.sum(axis=1, keepdims=True)
        columns = _in_scale(best.columns * np.exp(step[split:].reshape(columns.shape)), is_sensor=is_sensor)
    return best


def _in_scale(columns: Array, *, is_sensor: bool) -> Array:
    """Return columns (Y,X) that add up to one in every state, or of largest entry one."""
    return np.asarray(columns / (columns.sum(axis=0) if is_sensor else columns.max(axis=1, keepdims=True)))


def _of_shares(slopes: Array, columns: Array) -> Array:
    """Return the derivatives where the columns add up to one: by log b_xy, those less b_xy Σ_z of those by log b_xz."""
    count, n_states = columns.shape
    split = slopes.shape[1] - columns.size
    own = slopes[:, split:].reshape(len(slopes), count, n_states)
    own = own - own.sum(axis=1, keepdims=True) * columns
    return np.hstack([slopes[:, :split], own.reshape(len(slopes), -1)])


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


def spreads(found: JointFit) -> tuple[Array, Array]:
    """Return standard deviations of transition (X,X) and columns (Y,X) that add up to one, by the curvature of the fit.

    The residuals' variance is the error over the degrees of freedom; directions of log P and log b that change
    nothing have none.
    """
    n_states, (count, _) = len(found.transition), found.columns.shape
    n_free = n_states * (n_states - 1) + n_states * (count - 1)
    n_used = len(found.slopes) // n_states * (n_states - 1)
    variance = found.loss / max(n_used - n_free, 1)
    _, sizes, axes = np.linalg.svd(found.slopes, full_matrices=False)
    axes, sizes = axes[:n_free], sizes[:n_free]
    roots = axes.T / np.maximum(sizes, tolerances.TINY) * np.sqrt(variance)
    rows = roots[: n_states**2].reshape(n_states, n_states, -1)
    own = roots[n_states**2 :].reshape(count, n_states, -1)
    rows = rows - (found.transition[:, :, None] * rows).sum(axis=1, keepdims=True)
    own = own - (found.columns[:, :, None] * own).sum(axis=0, keepdims=True)
    return found.transition * np.linalg.norm(rows, axis=2), found.columns * np.linalg.norm(own, axis=2)
