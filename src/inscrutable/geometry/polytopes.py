"""Polytopes {z : rows z ≤ offsets} of dimension two or more, reduced until they have an interior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import daqp
import numpy as np
from scipy.linalg import null_space, solve_triangular
from scipy.optimize import nnls
from scipy.spatial import Delaunay, HalfspaceIntersection, QhullError, cKDTree

from inscrutable import tolerances
from inscrutable.errors import SolverError
from inscrutable.linear_programmes import Rows, minimum
from inscrutable.validation import Array

MOST_LISTED = 9  # dimensions up to which a polytope's corners are listed in milliseconds; in eleven it takes a second
_MOST_SIMPLICES = 1e5
"""V^(d/2), about the number of simplices of V corners in d dimensions, up to which a polytope is divided into these to sample
it, in .02 s at most; 296 corners in eight dimensions take three minutes."""
_STEPS = 5
"""Steps of hit-and-run, by squared dimension: on simplices of 7 to 19 dimensions the mean of the largest coordinate is right to
.3 %; with two it is .1 to .5 % off, with one 2 to 4 %."""
_PILOTS, _PILOT_POINTS, _STEADY = 8, 20, 1.8
"""Most pilot walks, their points for each dimension, and the ratio of widths within which one changes little. Without them the
mean of a probability is .015 instead of .091 where 200 rows are copies of one."""
_CENTRED = 0.1  # length of a Newton step, in its own units, within which a point counts as the analytic centre


@dataclass(frozen=True, eq=False)
class Reduced:
    """A polytope with interior in its own affine hull: x = origin + directions' z, rows z ≤ offsets.

    Its corners are given, or computed on demand from an interior point; projections do not need them. In 24 dimensions there
    are tens of thousands.
    """

    origin: Array  # (X,)
    directions: Array  # (d, X)
    rows: Array  # (n, d)
    offsets: Array  # (n,)
    corners: Array | None = None  # (V, X)
    inside: Array | None = None  # (d,)

    @cached_property
    def vertices(self) -> Array:
        """The corners, shape (V, X)."""
        if self.corners is not None:
            return self.corners
        return np.asarray(self.origin + _corners(self.rows, self.offsets, self._deep) @ self.directions)

    @property
    def interior_point(self) -> Array:
        """A point (X,) with slack in every row: the mean of known corners, else the centre of an inscribed ball."""
        if self.corners is not None:
            return np.asarray(self.corners.mean(axis=0))
        return np.asarray(self.origin + self._deep @ self.directions)

    def bounds(self) -> Array:
        """Return the least and the greatest value of each coordinate, shape (X, 2), by linear programmes."""
        rows = Rows(self.rows, self.offsets)
        found = [sign * minimum(sign * unit, rows).value for unit in self.directions.T for sign in (1.0, -1.0)]
        return np.asarray(self.origin[:, None] + np.reshape(found, (-1, 2)))

    @cached_property
    def _deep(self) -> Array:
        return _deepest_point(self.rows, self.offsets)[0] if self.inside is None else self.inside


def reduce_polytope(
    origin: Array, directions: Array, rows: Array, offsets: Array, *, solid: bool = False
) -> Reduced | None:
    """Return the polytope {origin + directions' z : rows z ≤ offsets}, or None where it is empty.

    A `solid` one is known to have an interior. For the others, linear programmes find the rows that hold with equality
    everywhere; each reduces the dimension by one.
    """
    varying = _without_constant_rows(rows, offsets)
    if varying is None:
        return None
    rows, offsets = varying
    dimension = directions.shape[0]
    if dimension == 0:
        return Reduced(origin, directions, np.zeros((0, 0)), np.zeros(0), origin[None])
    if dimension == 1:
        return _segment(origin, directions, rows, offsets)
    if solid:
        return Reduced(origin, directions, rows, offsets)
    centre, radius = _deepest_point(rows, offsets)
    if radius < -tolerances.ON_FACE:
        return None
    if radius > tolerances.ON_FACE:
        return Reduced(origin, directions, rows, offsets, inside=centre)
    # Rows that conflict by less than the tolerance count as touching: relax them for the linear programmes.
    tight = _always_tight(rows, offsets + max(0.0, -radius) + tolerances.ON_FACE)
    free = null_space(rows[tight], rcond=tolerances.ON_FACE)
    if free.shape[1] == dimension:
        raise SolverError("a belief set has no interior, yet no row of it is tight everywhere")
    return reduce_polytope(
        origin + centre @ directions, free.T @ directions, rows[~tight] @ free, offsets[~tight] - rows[~tight] @ centre
    )


def _without_constant_rows(rows: Array, offsets: Array) -> tuple[Array, Array] | None:
    norms = np.linalg.norm(rows, axis=1)
    constant = norms <= tolerances.ON_FACE
    if np.any(offsets[constant] < -tolerances.ON_FACE):
        return None
    scale = norms[~constant]
    return rows[~constant] / scale[:, None], offsets[~constant] / scale


def _segment(origin: Array, directions: Array, rows: Array, offsets: Array) -> Reduced | None:
    slope = rows[:, 0]
    high = (offsets[slope > 0] / slope[slope > 0]).min(initial=np.inf)
    low = (offsets[slope < 0] / slope[slope < 0]).max(initial=-np.inf)
    if low - high > 2 * tolerances.ON_FACE:
        return None
    if high - low <= tolerances.ON_FACE:
        point = origin + 0.5 * (low + high) * directions[0]
        return Reduced(point, directions[:0], np.zeros((0, 0)), np.zeros(0), point[None])
    ends = origin + np.array([[low], [high]]) * directions[0]
    return Reduced(origin, directions, np.array([[1.0], [-1.0]]), np.array([high, -low]), ends)


def _deepest_point(rows: Array, offsets: Array) -> tuple[Array, float]:
    """Centre and radius of the largest inscribed ball; a negative radius is the amount by which rows conflict."""
    objective = np.zeros(rows.shape[1] + 1)
    objective[-1] = -1.0
    answer = minimum(objective, Rows(np.column_stack([rows, np.ones(rows.shape[0])]), offsets)).x
    return np.asarray(answer[:-1]), float(answer[-1])


def _always_tight(rows: Array, offsets: Array) -> np.ndarray:
    """Return which rows vary by less than the tolerance on the set, and are therefore equalities of it."""
    least = 10 * tolerances.ON_FACE
    tight = np.ones(len(rows), dtype=bool)
    while tight.any():
        # This point has slack in many rows at once; other rows may still have slack elsewhere.
        slack = offsets - rows @ minimum(rows[tight].sum(axis=0), Rows(rows, offsets)).x
        if (slack[tight] > least).any():
            tight &= slack <= least
            continue
        if slack[tight].sum() > least:
            for j in np.flatnonzero(tight):
                tight[j] = offsets[j] - rows[j] @ minimum(rows[j], Rows(rows, offsets)).x <= least
        break
    return tight


def _corners(rows: Array, offsets: Array, centre: Array) -> Array:
    try:
        found = HalfspaceIntersection(np.column_stack([rows, -offsets]), centre).intersections
    except QhullError:
        found = HalfspaceIntersection(np.column_stack([rows, -offsets]), centre, qhull_options="QJ").intersections
    found = found[np.all(np.isfinite(found), axis=1)]
    return _apart(found)


def _apart(points: Array) -> Array:
    """Return the distinct points of (n,d), in order."""
    _, first = np.unique(np.round(points / tolerances.SAME_BELIEF), axis=0, return_index=True)
    left = points[np.sort(first)]
    near = cKDTree(left).query_pairs(tolerances.SAME_BELIEF, p=np.inf, output_type="ndarray")
    kept = np.ones(len(left), dtype=bool)
    for earlier, later in near[np.lexsort(near.T[::-1])]:
        kept[later] &= not kept[earlier]
    return np.asarray(left[kept])


def nearest_point(polytope: Reduced, target: Array) -> Array:
    """Return the point of the polytope nearest to `target` in the Euclidean norm."""
    if not len(polytope.directions):
        return polytope.origin
    wanted = polytope.directions @ (target - polytope.origin)
    z = project_on_rows(polytope.rows, polytope.offsets, wanted)
    return np.asarray(polytope.origin + z @ polytope.directions)


def nearest_in_hull(corners: Array, target: Array) -> Array:
    """Return the point of the hull of corners (n,X) nearest to `target` (X,).

    The λ that minimises |Y'λ|² + (1 − Σλ)² over λ ≥ 0, scaled to Σλ = 1, gives the point; the rows of Y lead from the target to
    the corners.
    """
    system = np.vstack([(corners - target).T, np.ones(len(corners))])
    weights = nnls(system, np.append(np.zeros(target.size), 1.0))[0]
    return np.asarray(weights @ corners / max(float(weights.sum()), tolerances.TINY))


def project_on_rows(rows: Array, offsets: Array, wanted: Array) -> Array:
    """Return the point of {z : rows z ≤ offsets} nearest to `wanted`."""
    if np.all(rows @ wanted <= offsets):
        return wanted
    sizes = np.linalg.norm(rows, axis=1)
    sizes[sizes == 0.0] = 1.0
    z, _, flag, _ = daqp.solve(
        np.eye(wanted.size),
        -wanted,
        np.ascontiguousarray(rows / sizes[:, None]),  # a row below the solver's zero would count as zero
        offsets / sizes,
        np.full(offsets.shape, -np.inf),
        np.zeros(offsets.shape, dtype=np.int32),
        primal_tol=tolerances.LINEAR_PROGRAMME,
    )
    if flag < 1:
        raise SolverError(f"projection on a belief set failed with DAQP exit flag {flag}")
    return np.asarray(z)


def sample_polytope(polytope: Reduced, n: int, rng: np.random.Generator) -> Array:
    """Return `n` points drawn uniformly from the polytope, shape (n, X)."""
    dimension = polytope.directions.shape[0]
    if dimension == 0:
        return np.tile(polytope.origin, (n, 1))
    is_listed = dimension <= MOST_LISTED or len(polytope.rows) == dimension + 1
    n_corners = len(polytope.vertices) if is_listed else np.inf
    if n_corners > dimension + 1 and n_corners ** (0.5 * dimension) > _MOST_SIMPLICES:
        return np.asarray(polytope.origin + _walked(polytope, n, rng) @ polytope.directions)
    corners = (polytope.vertices - polytope.origin) @ polytope.directions.T
    if len(corners) == dimension + 1:
        simplices = np.arange(dimension + 1)[None]
        weights = np.ones(1)
    else:
        # Of equal width in all directions: thin polytopes cannot be divided, and shares of volume stay as they are.
        even = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[0]
        simplices = Delaunay(even, qhull_options="QJ").simplices
        edges = even[simplices[:, 1:]] - even[simplices[:, :1]]
        weights = np.abs(np.linalg.det(edges))
    chosen = rng.choice(len(simplices), size=n, p=weights / weights.sum())
    mix = rng.dirichlet(np.ones(dimension + 1), size=n)
    return np.asarray(polytope.origin + np.einsum("nk,nkd->nd", mix, corners[simplices[chosen]]) @ polytope.directions)


def _walked(polytope: Reduced, n: int, rng: np.random.Generator) -> Array:
    """Coordinates (n,d) of points from hit-and-run, each from the analytic centre.

    There A = diag(1/slacks) rows = QR makes the polytope {centre + R⁻¹y : Qy ≤ 1} about as wide in all directions of y. Where
    many rows are alike the centre lies far off: pilot walks then give the mean and the widths to start from.
    """
    centre = polytope._deep
    while True:  # Newton's method, damped: some ten steps
        even, upper = np.linalg.qr(polytope.rows / (polytope.offsets - polytope.rows @ centre)[:, None])
        pull = even.sum(axis=0)
        length = float(np.linalg.norm(pull))
        if not np.isfinite(length):
            raise SolverError("a belief set is too thin to be sampled: its interior is lost in rounding")
        if length <= _CENTRED:
            break
        centre = centre - solve_triangular(upper, pull) / (1.0 + length)
    centre, widths = np.asarray(centre), np.linalg.inv(upper)
    for _ in range(_PILOTS):
        tried = _hit_and_run(polytope, centre, widths, (_PILOT_POINTS * centre.size, 1), rng)
        change = np.linalg.cholesky(np.cov(np.linalg.solve(widths, (tried - centre).T)))
        centre, widths = tried.mean(axis=0), widths @ change
        spread = np.linalg.svd(change, compute_uv=False)
        if spread[0] <= _STEADY * spread[-1]:
            break
    return _hit_and_run(polytope, centre, widths, (n, _STEPS), rng)


def _hit_and_run(
    polytope: Reduced, centre: Array, widths: Array, effort: tuple[int, int], rng: np.random.Generator
) -> Array:
    """Coordinates of some points, each by that many times d² steps from the centre; lines have the law of `widths` (d,d) times
    normal numbers."""
    count, steps = effort
    rows, slacks = polytope.rows @ widths, polytope.offsets - polytope.rows @ centre
    places = np.zeros((count, centre.size))
    for _ in range(steps * centre.size**2):
        away = rng.normal(size=places.shape)
        low, high = line_ends(slacks - places @ rows.T, away @ rows.T)
        places += rng.uniform(low, high)[:, None] * away
    return np.asarray(centre + places @ widths.T)


def line_ends(slacks: Array, speeds: Array) -> tuple[Array, Array]:
    """Return how far points (n) can move back and forth on lines: the least and the greatest factor (n,), from the slacks (n,m)
    of rows and the speeds (n,m) at which these shrink."""
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = slacks / speeds
    low = np.where(speeds < 0, steps, -np.inf).max(axis=1, initial=-np.inf)
    return low, np.where(speeds > 0, steps, np.inf).min(axis=1, initial=np.inf)
