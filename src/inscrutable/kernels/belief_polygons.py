"""Distances to sets of beliefs whose hull is a plane: polygons, clipped as `geometry.polygons` does, which defines them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.belief_sets import along, band
from inscrutable.kernels.options import part

_AROUND = 4.0  # as in geometry.polygons
_SQUARE = np.array([[-_AROUND, -_AROUND], [_AROUND, -_AROUND], [_AROUND, _AROUND], [-_AROUND, _AROUND]])


class Polygon(NamedTuple):
    """Half-planes `rows[:, :2]` z ≤ `rows[:, 2]`, the corners that they leave, and a second place to clip into."""

    rows: Any
    corners: Any
    other: Any


@part
def polygon_for(n_rows: int) -> Any:
    """Return space for polygons of at most `n_rows` half-planes."""
    return Polygon(np.empty((n_rows, 3)), np.empty((n_rows + 4, 2)), np.empty((n_rows + 4, 2)))


@part
def _half_planes(rows: Any, n_rows: int, limits: Any, room: Any, polygon: Any) -> int:
    """Write Q π ≥ 0, π ≥ 0 and the bands as unit rows in the first two directions; −1 where one is never met."""
    planes = polygon.rows
    found = 0
    for r in range(n_rows + room.origin.size):
        first = -along(rows, n_rows, r, room.directions[0])
        second = -along(rows, n_rows, r, room.directions[1])
        offset = along(rows, n_rows, r, room.origin)
        length = np.sqrt(first * first + second * second)
        if length <= limits.on_face:
            if offset < -limits.on_face:
                return -1
        else:
            planes[found, 0], planes[found, 1], planes[found, 2] = first / length, second / length, offset / length
            found += 1
    for axis in range(2):
        low, high = band(room, axis, limits.explained)
        if np.isfinite(low):
            for side in range(2):
                planes[found, axis] = 1.0 - 2.0 * side
                planes[found, 1 - axis] = 0.0
                planes[found, 2] = high if side == 0 else -low
                found += 1
    return found


@part
def _height(corners: Any, i: int, plane: Any, shift: float) -> float:
    return float(corners[i, 0] * plane[0] + corners[i, 1] * plane[1] - (plane[2] + shift))


@part
def _clip(polygon: Any, n_rows: int, shift: float, same: float) -> int:
    """Clip a square by the half-planes, each moved outward by `shift`; return the number of distinct corners, −1 where
    nothing is left."""
    corners, other = polygon.corners, polygon.other
    count = 4
    for i in range(count):
        corners[i, 0], corners[i, 1] = _SQUARE[i, 0], _SQUARE[i, 1]
    for r in range(n_rows):
        plane = polygon.rows[r]
        least, most = np.inf, -np.inf
        for i in range(count):
            height = _height(corners, i, plane, shift)
            least, most = min(least, height), max(most, height)
        if most <= 0.0:
            continue
        if least >= 0.0:
            return -1
        kept = 0
        for i in range(count):
            j = (i + 1) % count
            here, there = _height(corners, i, plane, shift), _height(corners, j, plane, shift)
            if here <= 0.0:
                other[kept, 0], other[kept, 1] = corners[i, 0], corners[i, 1]
                kept += 1
            if (here < 0.0) != (there < 0.0) and here != 0.0 and there != 0.0:
                share = here / (here - there)
                for c in range(2):
                    other[kept, c] = corners[i, c] + share * (corners[j, c] - corners[i, c])
                kept += 1
        corners, other = other, corners
        count = kept
    return _keep_distinct(corners, count, polygon.corners, same)


@part
def _keep_distinct(corners: Any, count: int, out: Any, same: float) -> int:
    """Write the corners that differ from the one before them; `out` may be `corners`."""
    first, second = corners[count - 1, 0], corners[count - 1, 1]
    kept = 0
    for i in range(count):
        x, y = corners[i, 0], corners[i, 1]
        if max(abs(x - first), abs(y - second)) > same:
            out[kept, 0], out[kept, 1] = x, y
            kept += 1
        first, second = x, y
    return kept


@part
def _width(corners: Any, count: int) -> float:
    """Least over the edges of the greatest distance of a corner from the edge's line."""
    least = np.inf
    for i in range(count):
        j = (i + 1) % count
        across, along_ = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
        length = np.sqrt(across * across + along_ * along_)
        most = 0.0
        for c in range(count):
            off = (corners[c, 1] - corners[i, 1]) * across - (corners[c, 0] - corners[i, 0]) * along_
            most = max(most, abs(off) / length)
        least = min(least, most)
    return least


@part
def _distance_in_plane(corners: Any, count: int, x: float, y: float) -> float:
    """Distance from a point of the plane to a convex polygon, its corners anticlockwise."""
    nearest, inside = np.inf, True
    for i in range(count):
        j = (i + 1) % count
        edge_x, edge_y = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
        to_x, to_y = x - corners[i, 0], y - corners[i, 1]
        if edge_x * to_y - edge_y * to_x < 0.0:
            inside = False
        share = (to_x * edge_x + to_y * edge_y) / (edge_x * edge_x + edge_y * edge_y)
        share = min(max(share, 0.0), 1.0)
        off_x, off_y = to_x - share * edge_x, to_y - share * edge_y
        nearest = min(nearest, np.sqrt(off_x * off_x + off_y * off_y))
    return 0.0 if inside else nearest


@part
def _is_member(equalities: Any, k: int, rows: Any, m: int, point: Any, explained: float) -> bool:
    for r in range(m + point.size):
        if along(rows, m, r, point) < -explained:
            return False
    for r in range(k):
        total = 0.0
        for x in range(point.size):
            total += equalities[r, x] * point[x]
        if abs(total) > explained:
            return False
    return True


@part
def polygon_distance(
    equalities: Any, k: int, rows: Any, m: int, limits: Any, room: Any, polygon: Any, point: Any
) -> float:
    """Distance from a belief to the set with k rows P and m rows Q whose hull in `room` is a plane: infinite where the
    set is empty, NaN where it is so thin, or so nearly empty, that the linear programmes must decide."""
    if _is_member(equalities, k, rows, m, point, limits.explained):
        return 0.0
    planes = _half_planes(rows, m, limits, room, polygon)
    if planes < 0:
        return np.inf
    count = _clip(polygon, planes, 0.0, limits.same_belief)
    if count < 3 or not _width(polygon.corners, count) > limits.polygon_width:
        # Rows in conflict by twice the tolerance leave nothing even within it.
        return np.inf if _clip(polygon, planes, 2.0 * limits.on_face, limits.same_belief) < 0 else np.nan
    x, y = 0.0, 0.0
    for s in range(point.size):
        off = point[s] - room.origin[s]
        x += room.directions[0, s] * off
        y += room.directions[1, s] * off
    squared = _distance_in_plane(polygon.corners, count, x, y) ** 2
    for s in range(point.size):
        beside = point[s] - room.origin[s] - x * room.directions[0, s] - y * room.directions[1, s]
        squared += beside * beside
    return float(np.sqrt(squared))
