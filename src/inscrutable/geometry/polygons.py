"""Polygons {z ∈ R² : rows z ≤ offsets} by clipping, without a solver."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.validation import Array

_AROUND = 4.0
"""Half the side of the square that is clipped: belief sets lie within √2 of their origin."""


def clip_polygon(rows: Array, offsets: Array) -> Array | None:
    """Return the corners (V,2) in order, or None where the polygon is empty or too thin to have an inside."""
    corners = _left_of_square(rows, offsets)
    if corners is None:
        return None
    corners = _without_repeats(corners)
    return corners if len(corners) >= 3 and _width(corners) > tolerances.POLYGON_WIDTH else None


def is_surely_empty(rows: Array, offsets: Array) -> bool:
    """Return whether unit rows are in conflict by twice the tolerance, so that nothing is left even within it."""
    return _left_of_square(rows, offsets + 2.0 * tolerances.ON_FACE) is None


def _left_of_square(rows: Array, offsets: Array) -> Array | None:
    corners = _AROUND * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for row, offset in zip(rows, offsets, strict=True):
        height = corners @ row - offset
        if height.max() <= 0.0:
            continue
        if height.min() >= 0.0:
            return None
        corners = _clipped(corners, height)
    return corners


def _clipped(corners: Array, height: Array) -> Array:
    kept: list[Array] = []
    for i in range(len(corners)):
        j = (i + 1) % len(corners)
        if height[i] <= 0.0:
            kept.append(corners[i])
        if (height[i] < 0.0) != (height[j] < 0.0) and height[i] != 0.0 and height[j] != 0.0:
            kept.append(corners[i] + height[i] / (height[i] - height[j]) * (corners[j] - corners[i]))
    return np.array(kept)


def _without_repeats(corners: Array) -> Array:
    apart = np.abs(corners - np.roll(corners, 1, axis=0)).max(axis=1) > tolerances.SAME_BELIEF
    return np.asarray(corners[apart])


def _width(corners: Array) -> float:
    """Least over the edges of the greatest distance of a corner from the edge's line."""
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([-edges[:, 1], edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    return float(np.abs((corners[None] - corners[:, None]) @ normals[:, :, None])[..., 0].max(axis=1).min())
