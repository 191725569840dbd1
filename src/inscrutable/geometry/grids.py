"""Regular grids on the probability simplex."""

from __future__ import annotations

from math import comb

import numpy as np

from inscrutable.errors import InputError
from inscrutable.validation import Array, count

_MOST_NUMBERS = 2**26
"""Most numbers in a grid, half a gigabyte; a larger grid is an error."""
_ABOUT = 1.02
"""Points of a grid of about a number of points, as a share of that: 5,151 over three states for 5,000."""


def simplex_grid(n: int, resolution: int) -> Array:
    """Return every point of the `n`-simplex whose coordinates are multiples of 1/`resolution`.

    Formula: {k / r : k ∈ N^n, Σ k = r}, vertices included, in lexicographic order.

    Args:
        n: Number of coordinates, at least 1.
        resolution: r, at least 1.

    Returns:
        Points, shape (C(r+n−1, n−1), n).

    Raises:
        InputError: `n` or `resolution` is not a whole number of at least 1, or the grid is too large for the memory.

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
    size = grid_size(n, resolution)
    if size * n > _MOST_NUMBERS:
        raise InputError(
            f"a grid of resolution {resolution} over {n} coordinates has {size:,} points, more than fit: take a resolution of "
            f"at most {_finest(n)}"
        )
    left = np.array([resolution])
    counts: list[np.ndarray] = []
    for _ in range(n - 1):
        # Every row continues with 0, 1, …, up to its remainder.
        rows = np.repeat(np.arange(len(left)), left + 1)
        ends = np.cumsum(left + 1)
        count_here = np.arange(len(rows)) - (ends - left - 1)[rows]
        counts = [column[rows] for column in counts] + [count_here]
        left = left[rows] - count_here
    return np.stack([*counts, left], axis=1) / resolution


def grid_size(n: int, resolution: int) -> int:
    """Return the number of points of `simplex_grid`, C(r+n−1, n−1)."""
    return comb(resolution + n - 1, n - 1)


def _finest(n: int) -> int:
    """Return the largest resolution that is allowed; at least 1, a grid of n points."""
    finer = 2
    while grid_size(n, finer) * n <= _MOST_NUMBERS:
        finer += max(1, finer // 64)
    while finer > 1 and grid_size(n, finer) * n > _MOST_NUMBERS:
        finer -= 1
    return finer


def resolution_for(n: int, points: int) -> int:
    """Return the largest resolution whose grid on the `n`-simplex has at most about `points` points, at least 1."""
    return largest_resolution(n, int(_ABOUT * points))


def largest_resolution(n: int, most: int) -> int:
    """Return the largest resolution whose grid on the `n`-simplex has at most `most` points, at least 1."""
    resolution = 1
    while n > 1 and grid_size(n, resolution + 1) <= most:
        resolution += 1
    return resolution
