"""Affine hulls of belief sets: the solutions π of M π = 0, 1'π = 1, decided by singular values from Jacobi rotations.

With B an orthonormal basis of the directions that keep Σπ, π = 1/X + B w and M B w = −M 1/X. Singular values above the rank
tolerance determine coordinates of w; the other directions are free, within the band in which the residual stays below the
tolerance. All functions work on a stack of systems of one shape.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.validation import Array


class Hulls(NamedTuple):
    """Affine hulls of n systems in X coordinates; `directions[i, dimension[i]:]` are the determined ones."""

    dimension: np.ndarray  # (n,), -1 where no point satisfies the equalities
    origin: Array  # (n, X)
    directions: Array  # (n, X-1, X), free directions first
    bands: Array  # (n, X-1, 2): lowest and highest coordinate along each free direction
    residual: Array  # (n,): the residual that no belief removes
    noise: Array  # (n,): displacement of a belief that costs the tolerance in residual


def _rotated(matrix: Array) -> tuple[Array, Array, Array]:
    """W (k,f), falling σ (f,) and V' (f,f) of M = W diag(σ) V': columns are rotated in pairs until all are orthogonal.

    One-sided Jacobi; columns of W whose σ is zero are zero.
    """
    columns, turn = matrix.copy(), np.eye(matrix.shape[1])
    for _ in range(60):
        largest = 0.0
        for p in range(len(turn)):
            for q in range(p + 1, len(turn)):
                first, second, inner = (columns[:, [p, p, q]] * columns[:, [p, q, q]]).sum(axis=0)[[0, 2, 1]]
                if abs(inner) <= 1e-16 * max(first, second, 1e-280):
                    continue
                largest = max(largest, abs(inner))
                angle = 0.5 * np.arctan2(2.0 * inner, first - second)
                rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
                columns[:, [p, q]], turn[:, [p, q]] = columns[:, [p, q]] @ rotation, turn[:, [p, q]] @ rotation
        if largest == 0.0:
            break
    lengths = np.linalg.norm(columns, axis=0)
    order = np.argsort(-lengths)
    return (columns / np.where(lengths > 0.0, lengths, 1.0))[:, order], lengths[order], turn[:, order].T


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
    left, singular, right = (np.array(parts) for parts in zip(*map(_rotated, equalities @ basis), strict=True))
    target = -(equalities @ centre)
    along = np.einsum("nik,ni->nk", left, target)
    padded, aligned = singular, along
    determined = padded > tolerances.RANK
    safe = np.where(determined, padded, 1.0)
    coordinates = np.where(determined, aligned / safe, 0.0)
    origin = centre + np.einsum("ni,nix->nx", coordinates, right @ basis.T)
    # A step along a free direction reduces the residual by at most its singular value times the simplex's diameter.
    removable = np.where(
        determined, 0.0, np.clip(aligned, -tolerances.SIMPLEX_DIAMETER * padded, tolerances.SIMPLEX_DIAMETER * padded)
    )
    fitted = np.einsum("nkx,nx->nk", equalities, origin)
    fitted = fitted + np.einsum("nki,ni->nk", left, removable)
    residual = np.abs(fitted).max(axis=1)
    dimension = np.where(residual <= tolerance, (~determined).sum(axis=1), -1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        low = np.where(padded * tolerances.SIMPLEX_DIAMETER > tolerance, (aligned - tolerance) / padded, -np.inf)
        high = np.where(padded * tolerances.SIMPLEX_DIAMETER > tolerance, (aligned + tolerance) / padded, np.inf)
    smallest = np.where(determined, padded, np.inf).min(axis=1)
    noise = np.maximum(tolerances.ON_FACE, tolerance / np.where(np.isfinite(smallest), smallest, 1.0))
    # Singular values fall, so the free directions are the last ones: reverse to put them first.
    return Hulls(dimension, origin, (right @ basis.T)[:, ::-1], np.stack([low, high], axis=2)[:, ::-1], residual, noise)
