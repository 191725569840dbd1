"""Simplicial cells of the belief simplex: cones around a belief, halved along edges. Cells are rows of corner indices."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.validation import Array

_NEAREST_STEPS = 40


class Cells(NamedTuple):
    """Corners as rows of indices; row by row a simplex of X corners."""

    points: Array  # (N, X)
    corners: np.ndarray  # (C, X)


def cones_from(belief: Array) -> Cells:
    """Return the simplex cut into cones with their apex at a belief (X,): point 0 is the apex, 1 + i is corner i."""
    n_states = belief.size
    points = np.vstack([belief, np.eye(n_states)])
    # A cone over a face that contains the belief is flat.
    rows = [[0, *(1 + i for i in range(n_states) if i != left_out)] for left_out in np.flatnonzero(belief > 0)]
    return Cells(points, np.array(rows, dtype=np.intp))


def edges(n_corners: int) -> np.ndarray:
    """Return all pairs of a cell's corners, shape (E, 2)."""
    return np.array(list(combinations(range(n_corners), 2)), dtype=np.intp).reshape(-1, 2)


def halved(corners: np.ndarray, edge: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """Return both halves (2C, X) of cells (C, X) cut at a point on one edge (C, 2) each."""
    rows = np.arange(len(corners))
    first, second = corners.copy(), corners.copy()
    first[rows, edge[:, 0]] = middles
    second[rows, edge[:, 1]] = middles
    return np.concatenate([first, second])


def directions_to(target: Array, simplices: Array) -> Array:
    """Return unit directions (C,X) from a point (X,) to simplices (C,J,X), about to their nearest points; zero inside.

    A few steps of the Mitchell–Demyanov–Malozemov method, which moves weight from the farthest corner in use to the nearest.
    Any direction gives a valid separating plane; a better one gives a larger distance.
    """
    offsets = simplices - target
    count, n_corners = offsets.shape[:2]
    weights = np.full((count, n_corners), 1.0 / n_corners)
    nearest = offsets.mean(axis=1)
    rows = np.arange(count)
    for _ in range(_NEAREST_STEPS):
        heights = np.einsum("cjx,cx->cj", offsets, nearest)
        lowest = heights.argmin(axis=1)
        highest = np.where(weights > 0.0, heights, -np.inf).argmax(axis=1)
        way = offsets[rows, highest] - offsets[rows, lowest]
        length = np.maximum((way * way).sum(axis=1), tolerances.TINY)
        step = np.clip((heights[rows, highest] - heights[rows, lowest]) / length, 0.0, weights[rows, highest])
        weights[rows, highest] -= step
        weights[rows, lowest] += step
        nearest = nearest - step[:, None] * way
    size = np.linalg.norm(nearest, axis=1)
    return np.where(size[:, None] > tolerances.KINK, nearest / np.maximum(size, tolerances.TINY)[:, None], 0.0)
