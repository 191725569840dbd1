"""Sets of beliefs {π ∈ Δ : P π = 0, Q π ≥ 0}: their affine hulls, ends and members, by the kernels of belief sets."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space

from inscrutable.validation import Array

_CHUNK = 256  # number of sets that a thread processes at a time


class Hull(NamedTuple):
    """The affine hull of a set of beliefs, of dimension d."""

    origin: Array  # (X,)
    directions: Array  # (d, X), orthonormal
    bands: Array  # (d, 2) least and greatest coordinate along each direction at which the residual stays below the tolerance


@lru_cache(maxsize=64)
def sum_zero_basis(n_states: int) -> Array:
    """Return an orthonormal basis, shape (X, X−1), read-only, of the vectors whose entries sum to zero."""
    basis = np.asarray(null_space(np.ones((1, n_states))))
    basis.setflags(write=False)
    return basis


def affine_hull(equalities: Array, tolerance: float) -> Hull:
    """Return the hull of equalities P π = 0 (k, X), each row scaled to the gradient's size, that some belief satisfies."""
    from inscrutable.kernels.belief_sets import affine_hull as fill_hull

    n_states = equalities.shape[1]
    origin, directions, bands = np.empty(n_states), np.empty((n_states - 1, n_states)), np.empty((n_states - 1, 2))
    basis = sum_zero_basis(n_states)
    d = fill_hull(np.ascontiguousarray(equalities), basis, float(tolerance), origin, directions, bands)
    return Hull(origin, directions[:d], bands[:d])


def onto_simplex(points: Array) -> Array:
    """Return points (n,X), on the simplex up to rounding, projected to it."""
    clipped = np.maximum(points, 0.0)
    total = clipped.sum(axis=1, keepdims=True)
    return np.asarray(clipped / np.where(total > 0, total, 1.0))


def described_sets(equalities: Array, inequalities: Array, tolerance: float) -> tuple[np.ndarray, Array]:
    """Return dimension (n,) and both ends (n,2,X) of the sets of stacked rows P (n,k,X) and Q (n,m,X).

    Sets of dimension two or more have the dimension of their hull and no ends; empty sets have dimension −1.
    """
    from inscrutable.kernels.belief_sets import describe_sets
    from inscrutable.kernels.threads import in_chunks

    count, _, n_states = equalities.shape
    dimension, ends = np.empty(count, dtype=np.int64), np.zeros((count, 2, n_states))
    rows = (np.ascontiguousarray(equalities), np.ascontiguousarray(inequalities))
    basis = sum_zero_basis(n_states)

    def work(low: int, high: int) -> None:
        describe_sets(low, high, *rows, basis, float(tolerance), dimension, ends)

    in_chunks(work, count, _CHUNK)
    return dimension, ends


def members_of_sets(equalities: Array, inequalities: Array, tolerance: float) -> tuple[np.ndarray, Array]:
    """Return verdicts (n,) on the sets of stacked rows, and a member (n,X) of each nonempty one.

    Verdict 1: nonempty; −1: empty; 0: undecided without a linear programme, or a hull of dimension below two.
    """
    from inscrutable.kernels.belief_members import find_members

    count, _, n_states = equalities.shape
    verdict, members = np.empty(count, dtype=np.int64), np.zeros((count, n_states))
    rows = (np.ascontiguousarray(equalities), np.ascontiguousarray(inequalities))
    find_members(*rows, sum_zero_basis(n_states), float(tolerance), verdict, members)
    return verdict, onto_simplex(members)
