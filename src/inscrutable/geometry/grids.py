"""Regular grids on the probability simplex."""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np

from inscrutable.validation import Array, count


def simplex_grid(n: int, resolution: int) -> Array:
    """Return every point of the `n`-simplex whose coordinates are multiples of 1/`resolution`.

    Formula: {k / r : k ∈ N^n, Σ k = r}, vertices included, in lexicographic order.

    Args:
        n: Number of coordinates, at least 1.
        resolution: r, at least 1.

    Returns:
        Points, shape (C(r+n−1, n−1), n).

    Raises:
        InputError: `n` or `resolution` is not a whole number of at least 1.

    Cost: proportional to the number of points returned.

    Source: the paper's "regular grid over the simplex", Section V-A.

    Example:
        >>> simplex_grid(2, 2)
        array([[0. , 1. ],
               [0.5, 0.5],
               [1. , 0. ]])
    """
    count(n, "n")
    count(resolution, "resolution")
    if n == 1:
        return np.ones((1, 1))
    size = comb(resolution + n - 1, n - 1)
    bars = np.fromiter(
        (bar for chosen in combinations(range(resolution + n - 1), n - 1) for bar in chosen), dtype=np.int64
    ).reshape(size, n - 1)
    edges = np.column_stack([np.full(size, -1), bars, np.full(size, resolution + n - 1)])
    return np.asarray((np.diff(edges, axis=1) - 1) / resolution)


def resolution_for(n: int, points: int) -> int:
    """Return the largest resolution whose grid on the `n`-simplex has at most about `points` points."""
    if n == 1:
        return 1
    resolution = 1
    while comb(resolution + n, n - 1) <= points * 1.02:
        resolution += 1
    return resolution
