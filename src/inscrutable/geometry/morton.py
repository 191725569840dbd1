"""An order of points in which successive points are close together."""

from __future__ import annotations

import numpy as np

from inscrutable.validation import Array

_MOST_BITS = 10
_CODE_BITS = 63


def morton_order(points: Array) -> np.ndarray:
    """Return the indices (T,) that sort points (T,X) of the simplex along Morton's curve.

    A point's position on the curve interleaves the bits of its first X − 1 coordinates, most significant first (the last
    coordinate follows from the others). Points of equal position keep their order.

    Source: G. M. Morton, A computer oriented geodetic data base and a new technique in file sequencing, IBM (1966).
    """
    n_points, n = len(points), min(points.shape[1] - 1, _CODE_BITS)
    if n == 0:
        return np.arange(n_points)
    bits = min(_MOST_BITS, _CODE_BITS // n)
    cells = np.minimum((points[:, :n] * 2**bits).astype(np.int64), 2**bits - 1)
    numbers = np.arange(2**bits)
    spread = np.zeros(2**bits, dtype=np.int64)
    for bit in range(bits):
        spread |= ((numbers >> bit) & 1) << (bit * n)
    places = np.zeros(n_points, dtype=np.int64)
    for i in range(n):
        places |= spread[cells[:, i]] << i
    return np.argsort(places, kind="stable")
