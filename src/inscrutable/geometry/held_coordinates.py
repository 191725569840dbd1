"""Active constraints as coordinates fixed by bounds and a few general rows on the free ones, without a decomposition.

Let F be the free coordinates, A the general and equality rows, and A_F' = Q [R; 0] with Q = I − V T V' a product of
one reflection per row. The last columns of Q span the directions in which every row stays active; with M = A_F⁺ the
least-squares multipliers of a gradient g are

    ν = −g_F M  of the rows A,      λ_j = −σ_j (g_j + A_j'ν)  of a bound σ_j u_j ≤ b_j.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgeqrf, dtrtri, dtrtrs

from inscrutable import tolerances
from inscrutable.validation import Array


class _Reflections(NamedTuple):
    """Q = I − V T V' and A_F⁺ for independent rows A_F (r,s)."""

    vectors: Array  # V (s,r)
    weights: Array  # T (r,r), upper triangular
    inverse: Array  # (s,r)

    def after(self, stack: Array) -> Array:
        """Overwrite a stack (…,s) by stack Q and return it."""
        stack -= (stack @ self.vectors @ self.weights) @ self.vectors.T
        return stack

    def before(self, stack: Array) -> Array:
        """Overwrite a stack (…,s,n) by Q'stack and return it."""
        stack -= (self.vectors @ self.weights.T) @ (self.vectors.T @ stack)
        return stack


class HeldCoordinates(NamedTuple):
    """The face of active bounds and few general rows; multipliers are in the order of `stationarity_rows`."""

    free: np.ndarray  # (s,) coordinates that no tight bound holds
    held: np.ndarray  # (h,) coordinates held from one side
    signs: Array  # (h,) +1 at an upper bound, −1 at a lower one
    fixed: np.ndarray  # coordinates held from both sides; their multiplier has either sign
    general: Array  # (r,U) active general rows, then equality rows, largest coefficient 1
    scale: Array  # (r,) their divisors
    active: np.ndarray  # which active rows the first of them are
    order: np.ndarray  # how the multipliers of bounds and general rows interleave
    reflections: _Reflections

    def multipliers(self, gradients: Array) -> Array:
        """Return the multipliers (…,m) of gradients (…,U): bounds held from one side and active general rows."""
        rows = gradients[..., self.free] @ self.reflections.inverse
        bounds = (rows @ self.general[:, self.held] - gradients[..., self.held]) * self.signs
        if not len(self.active):
            return np.asarray(bounds)
        return np.asarray(np.concatenate([bounds, -rows[..., : len(self.active)]], axis=-1)[..., self.order])

    def residual_rows(self) -> Array:
        """Return the rows (n,U) of I − A_F⁺A_F on the free coordinates that are not zero."""
        size, r = self.reflections.vectors.shape
        span = np.eye(size, r) - self.reflections.vectors @ (self.reflections.weights @ self.reflections.vectors[:r].T)
        projector = np.eye(size) - span @ span.T
        kept = np.abs(projector).max(axis=1, initial=0.0) > tolerances.ON_FACE
        rows = np.zeros((int(kept.sum()), self.general.shape[1]))
        rows[:, self.free] = projector[kept]
        return rows

    def along(self, matrices: Array) -> Array:
        """Return Z'M (…,k,n) for matrices M (…,U,n), Z the orthonormal directions (U,k) of the face."""
        return self.reflections.before(matrices[..., self.free, :])[..., len(self.general) :, :]

    def project(self, stack: Array) -> Array:
        """Return stack Z (…,k) for a stack (…,U)."""
        return self.reflections.after(stack[..., self.free])[..., len(self.general) :]

    def span(self) -> Array:
        """Return Z, shape (U,k)."""
        size, r = self.reflections.vectors.shape
        span = np.zeros((self.general.shape[1], size - r))
        span[self.free] = np.eye(size, size - r, -r) - self.reflections.vectors @ (
            self.reflections.weights @ self.reflections.vectors[r:].T
        )
        return span

    def nearest_point(self, point: Array, sides: Array) -> Array:
        """Return the held coordinates of `point` (U,) with the free ones of least norm at which rows have `sides` (r,)."""
        found = point.copy()
        found[self.free] = 0.0
        found[self.free] = self.reflections.inverse @ (sides / self.scale - self.general @ found)
        return found


def held_coordinates(active: Array, equalities: Array) -> HeldCoordinates | None:
    """Return the face of active rows (n,U) and equality rows (e,U); None where its general rows are not independent
    on the free coordinates beyond doubt."""
    n_actions = active.shape[1]
    entries = active != 0
    single = np.count_nonzero(entries, axis=1) == 1
    bounds, others = np.flatnonzero(single), np.flatnonzero(~single)
    columns = entries[bounds].argmax(axis=1)
    sides = 2 * columns + (active[bounds, columns] > 0)
    first = np.full(2 * n_actions, -1)
    first[sides[::-1]] = np.arange(len(sides))[::-1]
    one_sided = (first[sides] == np.arange(len(sides))) & (first[sides ^ 1] < 0)
    both = (first[0::2] >= 0) & (first[1::2] >= 0)
    loose = np.ones(n_actions, dtype=bool)
    loose[columns] = False
    free = np.flatnonzero(loose)
    general = np.vstack([active[others], equalities])
    if len(general) > len(free):
        return None
    scale = np.abs(general).max(axis=1, initial=np.finfo(float).tiny)
    general = general / scale[:, None]
    reflections = _reflections(general[:, free].T)
    if reflections is None:
        return None
    held = columns[one_sided]
    order = np.argsort(np.concatenate([bounds[one_sided], others])) if len(others) else np.arange(len(held))
    signs = np.where(sides[one_sided] & 1, 1.0, -1.0)
    return HeldCoordinates(free, held, signs, np.flatnonzero(both), general, scale, others, order, reflections)


def _reflections(columns: Array) -> _Reflections | None:
    """Triangularise columns (s,r) by reflections; None where they are close to dependent.

    The test compares squares, so it refers doubtful cases to a pseudo-inverse.
    """
    size, r = columns.shape
    if not r:
        return _Reflections(columns, np.zeros((0, 0)), columns)
    packed, scales, *_ = dgeqrf(columns)
    triangle = np.triu(packed[:r])
    singular = np.linalg.svd(triangle, compute_uv=False)
    if singular[-1] ** 2 <= tolerances.ON_FACE * max(1.0, singular[0]) ** 2:
        return None
    vectors, diagonal = np.tril(packed, -1), np.arange(r)
    vectors[diagonal, diagonal] = scales > 0.0  # a column that is zero below the diagonal needs no reflection
    # T⁻¹ is upper triangular, with the products of the vectors above its diagonal (Schreiber and Van Loan 1989).
    crossed = vectors.T @ vectors
    crossed[diagonal, diagonal] = 1.0 / np.maximum(scales, scales <= 0.0)
    weights = np.triu(dtrtri(crossed)[0])
    span = np.eye(size, r) - vectors @ (weights @ vectors[:r].T)
    return _Reflections(vectors, weights, dtrtrs(triangle, span.T)[0].T)
