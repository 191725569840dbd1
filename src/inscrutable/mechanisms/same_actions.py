"""Which decisions are indistinguishable to an observer, and which beliefs are one."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from inscrutable import tolerances
from inscrutable.geometry.equal_rows import first_equal
from inscrutable.validation import Array


def first_same(actions: Array, tolerance: float = tolerances.SAME_ACTION) -> np.ndarray:
    """Return, for every decision of (M,U), the index of the first one that it cannot be distinguished from, shape (M,).

    Decisions within the tolerance of each other in every coordinate are the same, and so are chains of them; pairs on two
    sides of a rounding boundary are found by a tree.
    """
    first = first_equal(actions, tolerance)
    apart = np.unique(first)
    pairs = cKDTree(actions[apart]).query_pairs(tolerance, p=np.inf, output_type="ndarray")
    if not len(pairs):
        return first
    ones = np.ones(len(pairs), dtype=bool)
    links = sparse.coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(apart), len(apart)))
    _, group = connected_components(links, directed=False)
    earliest = np.full(group.max() + 1, len(actions))
    np.minimum.at(earliest, group, apart)
    return np.asarray(earliest[group[np.searchsorted(apart, first)]])


def equal_beliefs(beliefs: Array) -> np.ndarray:
    """Return for each belief the first equal one; small probabilities are compared in relative terms."""
    return first_same(np.log(np.maximum(beliefs, tolerances.TINY)), tolerances.REACHED_BELIEF)
