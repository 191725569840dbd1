"""An atlas as the streaming search for single decisions reads it."""

from __future__ import annotations

import numpy as np

from inscrutable.kernels.leaf_reading import Book
from inscrutable.kernels.search import Leaves, Table
from inscrutable.validation import Array


def book_of(table: Table, leaves: Leaves, patterns: np.ndarray) -> Book:
    """Return candidates by coordinate, and which faces (K,R), given by their tight rows, are neighbours."""
    return Book(
        _by_coordinate(table.costs),
        _by_coordinate(table.decoys),
        _by_coordinate(table.start),
        _by_coordinate(table.along),
        table.square,
        table.kind,
        table.face,
        leaves.first,
        leaves.radius,
        leaves.reach,
        _by_coordinate(leaves.centre),
        _by_coordinate(leaves.costs),
        _by_coordinate(leaves.excess),
        np.ascontiguousarray(leaves.slope.transpose(1, 2, 0)),
        np.ascontiguousarray(patterns),
        _neighbours(patterns),
    )


def _by_coordinate(rows: Array) -> Array:
    return np.ascontiguousarray(rows.T)


def _neighbours(patterns: np.ndarray) -> np.ndarray:
    """The number of the face that differs from each in one row, shape (K,R); −1 where there is none."""
    beyond = np.empty(patterns.shape, dtype=np.int64)
    other = patterns.copy()
    for row in range(patterns.shape[1]):
        other[:, row] ^= True
        beyond[:, row] = numbers_of(other, patterns)
        other[:, row] ^= True
    return beyond


def numbers_of(tight: np.ndarray, patterns: np.ndarray) -> np.ndarray:
    """Return which of the patterns (K,R) each row of `tight` (n,R) is, −1 where it is none."""
    if not len(patterns) or not tight.shape[1]:
        return np.full(len(tight), len(patterns) - 1)
    known, asked = _keys(patterns), _keys(tight)
    order = np.argsort(known)
    place = np.minimum(np.searchsorted(known, asked, sorter=order), len(known) - 1)
    found = order[place]
    return np.where(known[found] == asked, found, -1)


def _keys(rows: np.ndarray) -> np.ndarray:
    packed = np.ascontiguousarray(np.packbits(rows, axis=1))
    return packed.view(f"S{packed.shape[1]}").reshape(-1)
