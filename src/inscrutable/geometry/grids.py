"""Regular grids on the probability simplex."""

from __future__ import annotations

from itertools import chain, combinations
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
    size = grid_size(n, resolution)
    bars = np.fromiter(
        chain.from_iterable(combinations(range(resolution + n - 1), n - 1)), dtype=np.int64, count=size * (n - 1)
    ).reshape(size, n - 1)
    points = np.empty((size, n))
    points[:, 0] = bars[:, 0]
    points[:, 1:-1] = np.diff(bars, axis=1) - 1
    points[:, -1] = resolution + n - 2 - bars[:, -1]
    points /= resolution
    return points


def grid_size(n: int, resolution: int) -> int:
    """Return how many points `simplex_grid` has, C(r+n−1, n−1), without making them."""
    return comb(resolution + n - 1, n - 1)


def resolution_for(n: int, points: int) -> int:
    """Return the largest resolution whose grid on the `n`-simplex has at most about `points` points, at least 1."""
    if n == 1:
        return 1
    resolution = 1
    while grid_size(n, resolution + 1) <= points * 1.02:
        resolution += 1
    return resolution
