"""Sets of beliefs {π ∈ Δ : P π = 0, Q π ≥ 0}, many at a time: their affine hulls, ends and members.

With B an orthonormal basis of the directions that keep Σπ and P B = W diag(σ) V' the singular value decomposition,

    π = 1/X + B V t,   t_j = −W_j·(P 1/X) / σ_j where σ_j determines a coordinate.

Directions with a singular value below the rank tolerance stay free, within the band in which the residual stays below the
tolerance: none is a point, one a segment to cut with the inequalities. No two beliefs are farther apart than
`SIMPLEX_DIAMETER`: a direction with σ times that below the tolerance has no band.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import nnls

from inscrutable.tolerances import (
    LEAST_MEMBER_DEPTH,
    MEMBER_DEPTH,
    ON_FACE,
    RANK,
    SAME_BELIEF,
    SIMPLEX_DIAMETER,
    SURE_CONFLICT,
)
from inscrutable.validation import Array

LARGER = 2
"""Least dimension of the sets of which `described_sets` finds no ends."""


class Hulls(NamedTuple):
    """The affine hulls of n sets of beliefs."""

    dimension: np.ndarray  # (n,) −1 where no belief satisfies the equalities
    origin: Array  # (n, X)
    directions: Array  # (n, X-1, X), orthonormal, the free ones first
    sigma: Array  # (n, X-1) the singular value of each
    aligned: Array  # (n, X-1) σ times the coordinate along each at which the residual is least
    noise: Array  # (n,) distance of a belief that costs the tolerance in residual

    def bands(self, tolerance: float) -> Array:
        """Return the coordinates along each direction between which the residual stays below a tolerance, (n, X−1, 2)."""
        is_banded = SIMPLEX_DIAMETER * self.sigma > tolerance
        ends = self.aligned[:, :, None] + tolerance * np.array([-1.0, 1.0])
        narrow = ends / np.where(is_banded, self.sigma, 1.0)[:, :, None]
        return np.where(is_banded[:, :, None], narrow, np.array([-np.inf, np.inf]))


@lru_cache(maxsize=64)
def sum_zero_basis(n_states: int) -> Array:
    """Return an orthonormal basis, shape (X, X−1), read-only, of the vectors whose entries sum to zero."""
    basis = np.asarray(null_space(np.ones((1, n_states))))
    basis.setflags(write=False)
    return basis


def affine_hulls(equalities: Array, tolerance: float) -> Hulls:
    """Return the hulls of stacked equalities P π = 0 (n, k, X), each row scaled to the gradient's size."""
    n, k, n_states = equalities.shape
    basis, size = sum_zero_basis(n_states), min(k, n_states - 1)
    left, lengths, right = np.linalg.svd(equalities @ basis, full_matrices=k < n_states - 1)
    directions = right @ basis.T
    sigma, aligned = np.zeros((n, n_states - 1)), np.zeros((n, n_states - 1))
    sigma[:, :size] = lengths
    target = -equalities.mean(axis=2)
    aligned[:, :size] = (target[:, None, :] @ left[:, :, :size])[:, 0]
    is_free = sigma <= RANK
    steps = np.where(is_free, 0.0, aligned) / np.where(is_free, 1.0, sigma)
    origin = 1.0 / n_states + (steps[:, None, :] @ directions)[:, 0]
    # The least residual: a step along a free direction lowers it by at most σ times the simplex's size.
    removable = np.where(is_free, np.clip(aligned, -SIMPLEX_DIAMETER * sigma, SIMPLEX_DIAMETER * sigma), 0.0)
    left_over = equalities @ origin[:, :, None] + left[:, :, :size] @ removable[:, :size, None]
    residual = np.abs(left_over).max(axis=(1, 2), initial=0.0)
    least = np.where(is_free, np.inf, sigma).min(axis=1, initial=np.inf)
    return Hulls(
        np.where(residual <= tolerance, is_free.sum(axis=1), -1),
        origin, directions[:, ::-1], sigma[:, ::-1], aligned[:, ::-1], np.maximum(ON_FACE, tolerance / least),
    )  # fmt: skip


def onto_simplex(points: Array) -> Array:
    """Return points (…,X), on the simplex up to rounding, projected to it."""
    clipped = np.maximum(points, 0.0)
    total = clipped.sum(axis=-1, keepdims=True)
    return np.asarray(clipped / np.where(total > 0, total, 1.0))


def described_sets(equalities: Array, inequalities: Array, tolerance: float) -> tuple[np.ndarray, Array]:
    """Return dimension (n,) and both ends (n,2,X) of the sets of stacked rows P (n,k,X) and Q (n,m,X).

    Sets of dimension two or more have the dimension of their hull and no ends; empty sets have dimension −1.
    """
    hulls = affine_hulls(equalities, tolerance)
    dimension, ends = hulls.dimension.copy(), np.zeros((len(equalities), 2, equalities.shape[2]))
    points, lines = np.flatnonzero(dimension == 0), np.flatnonzero(dimension == 1)
    if points.size:
        slack = _slacks(inequalities[points], hulls.origin[points])
        dimension[points] = np.where((slack >= -hulls.noise[points, None]).all(axis=1), 0, -1)
        ends[points] = onto_simplex(hulls.origin[points])[:, None]
    if lines.size:
        some = Hulls(*(part[lines] for part in hulls))
        dimension[lines], ends[lines] = _segments(some, inequalities[lines], tolerance)
    ends[dimension < 0] = 0.0
    return dimension, ends


def _slacks(inequalities: Array, points: Array) -> Array:
    """Return Q π, then π, of stacked rows Q (n,m,X) and one point each (n,X)."""
    return np.concatenate([(inequalities @ points[:, :, None])[:, :, 0], points], axis=1)


def _segments(hulls: Hulls, inequalities: Array, tolerance: float) -> tuple[np.ndarray, Array]:
    """Return dimension (n,), at most one, and both ends (n,2,X) of sets whose hulls are lines o + t d."""
    noise, direction, bands = hulls.noise[:, None], hulls.directions[:, 0], hulls.bands(tolerance)
    value, slope = _slacks(inequalities, hulls.origin), _slacks(inequalities, direction)
    flat = np.abs(slope) <= noise  # such a row holds for all t, or for none

    def ends_of(least: Array | float) -> tuple[Array, Array]:
        crossing = (least - value) / np.where(flat, 1.0, slope)
        low = np.where(~flat & (slope > 0.0), crossing, -np.inf).max(axis=1)
        high = np.where(~flat & (slope < 0.0), crossing, np.inf).min(axis=1)
        return np.maximum(bands[:, 0, 0], low), np.minimum(bands[:, 0, 1], high)

    low, high = ends_of(0.0)
    least, most = ends_of(-noise)  # each row by itself: one that is almost flat says nothing of the others
    is_empty = (flat & (value < -noise)).any(axis=1) | (least > most)
    between = np.clip(0.5 * (low + high), least, np.maximum(least, most))
    steps = np.where(is_empty, 0.0, np.where(low > high, between, [low, high]))
    ends = onto_simplex(hulls.origin[:, None] + steps.T[:, :, None] * direction[:, None])
    is_long = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > SAME_BELIEF
    return np.where(is_empty, -1, np.where(is_long, 1, 0)), ends


def members_of_sets(equalities: Array, inequalities: Array, tolerance: float) -> tuple[np.ndarray, Array]:
    """Return verdicts (n,) on the sets of stacked rows, and a member (n,X) of each nonempty one.

    Verdict 1: nonempty; −1: empty; 0: undecided without a linear programme, or a hull of dimension below two.
    """
    hulls = affine_hulls(equalities, tolerance)
    bands = hulls.bands(tolerance)
    verdict, members = np.zeros(len(equalities), dtype=np.int64), np.zeros_like(hulls.origin)
    for i in np.flatnonzero(hulls.dimension >= LARGER):
        size = hulls.dimension[i]
        if np.isfinite(bands[i, :size]).any():
            continue
        everything = np.vstack([inequalities[i], np.eye(equalities.shape[2])])
        directions = hulls.directions[i, :size]
        verdict[i], place = _member(everything @ directions.T, everything @ hulls.origin[i])
        members[i] = hulls.origin[i] + place @ directions
    return verdict, onto_simplex(members)


def _member(rows: Array, value: Array) -> tuple[int, Array]:
    """Say whether N t + value ≥ 0 has solutions well inside: verdict as of `members_of_sets`, and the one nearest to 0, or 0.

    With unit rows N and b their sides, the nonnegative weights y that minimise ‖N'y‖² + (b'y − 1)² leave the residual
    r = (N'y, b'y − 1): t = −N'y / (b'y − 1) is the point of N t ≥ b nearest to 0, and r = 0 contradicts the rows (Farkas).
    Source: Lawson and Hanson, Solving Least Squares Problems (1974), chapter 23.
    """
    nothing, lengths = np.zeros(rows.shape[1]), np.linalg.norm(rows, axis=1)
    varies = lengths > ON_FACE
    if (value[~varies] < -ON_FACE).any():
        return -1, nothing
    units, sides = rows[varies] / lengths[varies, None], -value[varies] / lengths[varies]
    for depth in (MEMBER_DEPTH, LEAST_MEMBER_DEPTH):
        try:
            weights = nnls(np.vstack([units.T, sides + depth]), np.append(nothing, 1.0))[0]
        except RuntimeError:  # too many steps
            return 0, nothing
        # Rows relaxed by `SURE_CONFLICT` still conflict: y'b − max |y'N t| > SURE_CONFLICT Σy over the t of beliefs.
        pull, total = weights @ units, weights @ (sides + depth) - 1.0
        if weights @ sides - SIMPLEX_DIAMETER * np.linalg.norm(pull) > SURE_CONFLICT * weights.sum():
            return -1, nothing
        if total < -ON_FACE:
            place = -pull / total
            if (units @ place - sides).min() > 0.5 * depth:
                return 1, place
            return 0, nothing
    return 0, nothing
