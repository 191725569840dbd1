"""What belief sets of dimension at most one are, in NumPy: hulls cut with inequalities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable.geometry.hulls import onto_simplex
from inscrutable.validation import Array
from oracles.hulls import Hulls


class Segments(NamedTuple):
    """Ends of n sets of dimension at most one; `present` is False where the inequalities leave nothing."""

    present: np.ndarray
    start: Array
    end: Array


def clip_to_segments(hulls: Hulls, inequalities: Array, which: np.ndarray) -> Segments:
    """Cut the hulls `which` (all of one dimension, 0 or 1) with stacked rows Q π ≥ 0 and π ≥ 0."""
    origin = hulls.origin[which]
    rows = inequalities[which]
    n, _, n_states = rows.shape
    noise = hulls.noise[which][:, None]
    everything = np.concatenate([rows, np.broadcast_to(np.eye(n_states), (n, n_states, n_states))], axis=1)
    value = np.einsum("nmx,nx->nm", everything, origin)
    if hulls.dimension[which[0]] == 0:
        present = np.all(value >= -noise, axis=1)
        point = onto_simplex(origin)
        return Segments(present, point, point)
    direction = hulls.directions[which, 0]
    slope = np.einsum("nmx,nx->nm", everything, direction)
    flat = np.abs(slope) <= noise
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -value / slope
    low = np.where(~flat & (slope > 0), crossing, -np.inf).max(axis=1)
    high = np.where(~flat & (slope < 0), crossing, np.inf).min(axis=1)
    low = np.maximum(low, hulls.bands[which, 0, 0])
    high = np.minimum(high, hulls.bands[which, 0, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        looser = (-noise - value) / slope
    least = np.maximum(np.where(~flat & (slope > 0), looser, -np.inf).max(axis=1), hulls.bands[which, 0, 0])
    most = np.minimum(np.where(~flat & (slope < 0), looser, np.inf).min(axis=1), hulls.bands[which, 0, 1])
    crossed = low > high
    touching = crossed & (least <= most)
    middle = np.minimum(np.maximum(0.5 * (low + high), least), most)
    low = np.where(touching, middle, low)
    high = np.where(touching, middle, high)
    present = ~(crossed & ~touching) & np.all(~flat | (value >= -noise), axis=1) & np.isfinite(low) & np.isfinite(high)
    low = np.where(present, low, 0.0)
    high = np.where(present, high, 0.0)
    return Segments(
        present, onto_simplex(origin + low[:, None] * direction), onto_simplex(origin + high[:, None] * direction)
    )
