"""Affine hulls of belief sets: the solutions π of M π = 0, 1'π = 1, decided by singular values.

With B an orthonormal basis of the directions that keep Σπ, π = 1/X + B w and M B w = −M 1/X. Singular values above the rank
tolerance determine coordinates of w; the other directions are free, within the band in which the residual stays below the
tolerance. All functions work on a stack of systems of one shape.

`affine_hulls` is the reference for the kernel behind `described_sets`.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import null_space

from inscrutable import tolerances
from inscrutable.validation import Array

if TYPE_CHECKING:
    from inscrutable.kernels.belief_sets import Limits

_CHUNK = 256  # number of sets that a thread processes at a time
_FARTHEST = 2.0
"""Bound of the distance of two beliefs: at most √2; twice the distance from the centre, rounded up."""


class Hulls(NamedTuple):
    """Affine hulls of n systems in X coordinates; `directions[i, dimension[i]:]` are the determined ones."""

    dimension: np.ndarray  # (n,), -1 where no point satisfies the equalities
    origin: Array  # (n, X)
    directions: Array  # (n, X-1, X), free directions first
    bands: Array  # (n, X-1, 2): lowest and highest coordinate along each free direction
    residual: Array  # (n,): the residual that no belief removes
    noise: Array  # (n,): displacement of a belief that costs the tolerance in residual


@lru_cache(maxsize=64)
def sum_zero_basis(n_states: int) -> Array:
    """Return an orthonormal basis, shape (X, X−1), read-only, of the vectors whose entries sum to zero."""
    basis = np.asarray(null_space(np.ones((1, n_states))))
    basis.setflags(write=False)
    return basis


def affine_hulls(equalities: Array, tolerance: float) -> Hulls:
    """Return the hulls of stacked equalities, shape (n, k, X), each row scaled to the gradient's size."""
    n, k, n_states = equalities.shape
    basis = sum_zero_basis(n_states)
    free = n_states - 1
    centre = np.full(n_states, 1.0 / n_states)
    if k == 0 or free == 0:
        residual = np.abs(equalities @ centre).max(axis=1, initial=0.0)
        dimension = np.where(residual <= tolerance, free, -1)
        directions = np.broadcast_to(basis.T, (n, free, n_states))
        bands = np.broadcast_to(np.array([-np.inf, np.inf]), (n, free, 2))
        return Hulls(dimension, np.tile(centre, (n, 1)), directions, bands, residual, np.full(n, tolerances.ON_FACE))
    left, singular, right = np.linalg.svd(equalities @ basis, full_matrices=True)
    target = -(equalities @ centre)
    along = np.einsum("nik,ni->nk", left, target)
    padded = np.zeros((n, free))
    padded[:, : singular.shape[1]] = singular
    determined = padded > tolerances.RANK
    aligned = np.zeros((n, free))
    aligned[:, : min(k, free)] = along[:, : min(k, free)]
    safe = np.where(determined, padded, 1.0)
    coordinates = np.where(determined, aligned / safe, 0.0)
    origin = centre + np.einsum("ni,nix->nx", coordinates, right @ basis.T)
    # A step along a free direction reduces the residual by at most its singular value times the simplex's diameter.
    removable = np.where(determined, 0.0, np.clip(aligned, -_FARTHEST * padded, _FARTHEST * padded))
    fitted = np.einsum("nkx,nx->nk", equalities, origin)
    fitted = fitted + np.einsum("nki,ni->nk", left[:, :, : min(k, free)], removable[:, : min(k, free)])
    residual = np.abs(fitted).max(axis=1)
    dimension = np.where(residual <= tolerance, (~determined).sum(axis=1), -1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        low = np.where(padded * _FARTHEST > tolerance, (aligned - tolerance) / padded, -np.inf)
        high = np.where(padded * _FARTHEST > tolerance, (aligned + tolerance) / padded, np.inf)
    smallest = np.where(determined, padded, np.inf).min(axis=1)
    noise = np.maximum(tolerances.ON_FACE, tolerance / np.where(np.isfinite(smallest), smallest, 1.0))
    # Singular values fall, so the free directions are the last ones: reverse to put them first.
    return Hulls(dimension, origin, (right @ basis.T)[:, ::-1], np.stack([low, high], axis=2)[:, ::-1], residual, noise)


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
    basis, limits = sum_zero_basis(n_states), kernel_limits(tolerance)

    def work(low: int, high: int) -> None:
        describe_sets(low, high, *rows, basis, limits, dimension, ends)

    in_chunks(work, count, _CHUNK)
    return dimension, ends


def members_of_sets(equalities: Array, inequalities: Array, tolerance: float) -> tuple[np.ndarray, Array]:
    """Return verdicts (n,) on the sets of stacked rows, and a member (n,X) of each nonempty one.

    Verdict 1: nonempty; −1: empty; 0: undecided without a linear programme, or a hull of dimension below two.
    """
    from inscrutable.kernels.belief_members import Depths, find_members

    count, _, n_states = equalities.shape
    verdict, members = np.empty(count, dtype=np.int64), np.zeros((count, n_states))
    rows = (np.ascontiguousarray(equalities), np.ascontiguousarray(inequalities))
    depths = Depths(
        tolerances.MEMBER_DEPTH, tolerances.LEAST_MEMBER_DEPTH, tolerances.SURE_CONFLICT, tolerances.STATIONARITY
    )
    find_members(*rows, sum_zero_basis(n_states), kernel_limits(tolerance), depths, verdict, members)
    return verdict, onto_simplex(members)


@lru_cache(maxsize=64)
def kernel_limits(tolerance: float) -> Limits:
    """Return the tolerances of the kernels that describe belief sets."""
    from inscrutable.kernels.belief_sets import Limits

    return Limits(
        float(tolerance),
        tolerances.RANK,
        tolerances.ON_FACE,
        tolerances.SAME_BELIEF,
        float(np.finfo(float).eps),
    )
