"""The cone of multipliers, written without the multipliers.

A gradient g is stationary when −g lies in K = {A_act'λ + A_eq'ν : λ ≥ 0}. Here K is turned into rows:
g ∈ −K  ⇔  P g = 0 and Q g ≥ 0.
"""

from __future__ import annotations

from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space, orth
from scipy.spatial import ConvexHull, QhullError

from inscrutable import tolerances
from inscrutable.errors import SolverError
from inscrutable.geometry.held_coordinates import held_coordinates
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.validation import Array

_MOST_FACETS = 500_000
"""Most facets that a cone may have: a larger hull could take minutes and gigabytes."""
_MOST_TRIED = 20_000
_HALF = 0.5
_MANY_CHOICES = 1_000
"""Most sets of rows that are enumerated for the facets of a pointed cone; beyond, a convex hull finds them."""
_LEAST_CUT = 0.001
"""Least height of a cone's rays over a plane through its apex; flatter cones count as not pointed."""


class StationarityRows(NamedTuple):
    """Rows P and Q with: −g is a combination of the active constraints ⇔ P g = 0 and Q g ≥ 0."""

    equalities: Array
    inequalities: Array


def stationarity_rows(active: Array, equalities: Array) -> StationarityRows:
    """Return P (k,U) and Q (m,U) for active rows (n,U) and equality rows (e,U).

    P g is the residual of g after least squares over λ and ν, in the decision's coordinates. Where the rows are independent, Q
    holds the rows of the negative pseudo-inverse that give λ, without those of bounds that fix a coordinate from both sides.
    Cost: a triangular solve on the free coordinates for bounds and few other rows; otherwise a singular value decomposition.
    """
    face = held_coordinates(active, equalities)
    if face is None:
        return decomposed_rows(active, equalities)
    return StationarityRows(face.residual_rows(), np.ascontiguousarray(face.multipliers(np.eye(active.shape[1])).T))


def decomposed_rows(active: Array, equalities: Array) -> StationarityRows:
    """Return P and Q by singular value decompositions, for any rows.

    Where the rows are dependent, Q holds the facets of the cone, enumerated in the span of the active rows modulo the
    equalities.
    """
    # Rows that repeat another, up to a positive factor, add nothing to the cone.
    active = _without_repeats(active)
    normals = np.vstack([active, equalities])
    n_actions = normals.shape[1]
    if normals.shape[0] == 0:
        return StationarityRows(np.eye(n_actions), np.zeros((0, n_actions)))
    scale = np.maximum(np.abs(normals).max(axis=1, keepdims=True), np.finfo(float).tiny)
    normals = normals / scale
    singular = np.linalg.svd(normals, compute_uv=False)
    independent = normals.shape[0] <= n_actions and singular[-1] > tolerances.ON_FACE * singular[0]
    complement = _projector(normals)
    if independent:
        return StationarityRows(complement, -np.linalg.pinv(normals).T[: active.shape[0]])
    return StationarityRows(complement, _facets(normals[: active.shape[0]], normals[active.shape[0] :]))


def _without_repeats(rows: Array) -> Array:
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    _, first = np.unique(np.round(rows / length / tolerances.ON_FACE), axis=0, return_index=True)
    return np.asarray(rows[np.sort(first)])


def _projector(normals: Array) -> Array:
    """Rows of the projector on the complement of the normals' span: the residual, coordinate by coordinate."""
    span = orth(normals.T, rcond=tolerances.ON_FACE)
    projector = np.eye(normals.shape[1]) - span @ span.T
    return np.asarray(projector[np.abs(projector).max(axis=1, initial=0.0) > tolerances.ON_FACE])


def _facets(active: Array, equalities: Array) -> Array:
    """Facets of cone(active) in span(active, equalities) modulo span(equalities), as rows Q with Q g ≥ 0 for −g in it."""
    n_actions = active.shape[1]
    free = null_space(equalities, rcond=tolerances.ON_FACE) if equalities.shape[0] else np.eye(n_actions)
    generators = active @ free
    generators = generators[np.linalg.norm(generators, axis=1) > tolerances.ON_FACE]
    if generators.shape[0] == 0:
        return np.zeros((0, n_actions))
    span = orth(generators.T, rcond=tolerances.ON_FACE)
    points = generators @ span
    points = points / np.linalg.norm(points, axis=1, keepdims=True)
    rank = span.shape[1]
    return np.asarray(_cone_facets(points, rank) @ span.T @ free.T)


def _cone_facets(points: Array, rank: int) -> Array:
    """Facets (f,d), outward, of the cone of unit vectors (n,d) that span their space."""
    count = len(points)
    if count == rank + 1:
        return _facets_of_one_more(points)
    if count > rank and comb(count, rank - 1) <= _MANY_CHOICES:
        return _tried_facets(points, rank)
    lines = _lineality(points)
    if lines.any():
        across = null_space(points[lines], rcond=tolerances.ON_FACE)
        rest = points[~lines] @ across
        length = np.linalg.norm(rest, axis=1)
        rest = rest[length > tolerances.ON_FACE] / length[length > tolerances.ON_FACE, None]
        # Modulo its lineality space the cone is pointed.
        return _cone_facets(_without_repeats(rest), across.shape[1]) @ across.T if len(rest) else points[:0]
    points = points[_extreme(points)]
    count = len(points)
    if count == rank:
        sides = -np.linalg.inv(points.T)
        return np.asarray(sides / np.linalg.norm(sides, axis=1, keepdims=True))
    if _most_facets(count, rank - 1) <= _MOST_FACETS:
        found = _hull_facets(points) if rank > 2 else None
        if found is not None:
            return found
        if comb(count, rank - 1) <= _MOST_TRIED:
            return _tried_facets(points, rank)
    raise SolverError(
        f"{count} active rows that none of the others imply span only {rank} directions: their cone of multipliers may "
        f"have {_most_facets(count, rank - 1):.2g} facets; remove constraints that meet in this decision, or move their "
        "limits apart"
    )


def _facets_of_one_more(points: Array) -> Array:
    """Facets (f,d) of the cone of d + 1 unit vectors g_k that span their space.

    There is one dependency Σ a_k g_k = 0. A facet omits one vector with a_k = 0, or two vectors whose a_k have opposite signs.
    With the rows D_k of the inverse of all but g_m, of largest |a_m|, these are D_i, and D_i/|a_i| + D_j/|a_j|.
    """
    weights = np.linalg.svd(points.T)[2][-1]
    weights[np.abs(weights) <= tolerances.ON_FACE] = 0.0
    left_out = int(np.abs(weights).argmax())
    duals = np.zeros_like(points)
    kept = np.arange(len(points)) != left_out
    duals[kept] = np.linalg.inv(points[kept].T)
    scaled = duals / np.where(weights != 0.0, np.abs(weights), 1.0)[:, None]
    up, down = np.flatnonzero(weights > 0.0), np.flatnonzero(weights < 0.0)
    pairs = (scaled[up][:, None] + scaled[down][None]).reshape(-1, points.shape[1])
    sides = -np.vstack([duals[weights == 0.0], pairs])
    return np.asarray(sides / np.linalg.norm(sides, axis=1, keepdims=True))


def _most_facets(count: int, dimension: int) -> int:
    """Return the most facets of a polytope with `count` vertices (McMullen's upper bound theorem)."""
    half, rest = dimension // 2, dimension - dimension // 2
    return comb(count - rest, half) + comb(count - half - 1, rest - 1)


def _lineality(points: Array) -> np.ndarray:
    """Return which unit vectors (n,d) span the lineality space: their negatives are in the cone."""
    n, d = points.shape
    answer = minimise(
        np.concatenate([np.zeros(n), -np.ones(n)]),
        Rows(np.hstack([-np.eye(n), np.eye(n)]), np.zeros(n)),
        Rows(np.hstack([points.T, np.zeros((d, n))]), np.zeros(d)),
        [(0.0, None)] * n + [(0.0, 1.0)] * n,
    )
    if answer.status != OPTIMAL:
        raise SolverError(f"the lines in a cone of multipliers were not found: {answer.message}")
    return np.asarray(answer.x[n:] > _HALF)


def _extreme(points: Array) -> np.ndarray:
    """Return which unit vectors (n,d) are extreme rays of their pointed cone."""
    kept = np.ones(len(points), dtype=bool)
    for j, point in enumerate(points):
        kept[j] = False
        others = points[kept]
        kept[j] = not len(others) or (
            minimise(np.zeros(len(others)), None, Rows(others.T, point), (0.0, None)).status != OPTIMAL
        )
    return kept


def _tried_facets(points: Array, rank: int) -> Array:
    """Return the facets (f,d) of a cone by enumerating the sets of vectors (n,d) that span a hyperplane."""
    facets: list[Array] = []
    for chosen in combinations(range(len(points)), rank - 1):
        normal = null_space(points[list(chosen)], rcond=tolerances.ON_FACE) if rank > 1 else np.eye(1)
        if normal.shape[1] != 1:
            continue
        for side in (normal[:, 0], -normal[:, 0]):
            below = np.all(points @ side <= tolerances.ON_FACE)
            if below and not any(np.allclose(side, known, atol=tolerances.ON_FACE, rtol=0) for known in facets):
                facets.append(side)
    return np.array(facets) if facets else np.zeros((0, points.shape[1]))


def _hull_facets(points: Array) -> Array | None:
    """Facets (f,d) of the cone of unit vectors (n,d) that span their space, from the hull of its section with a plane;
    None where no plane intersects all of its rays."""
    n, d = points.shape
    objective = np.append(np.zeros(d), -1.0)
    cut = minimise(objective, Rows(np.column_stack([-points, np.ones(n)]), np.zeros(n)), bounds=(-1.0, 1.0))
    if cut.status != OPTIMAL or -cut.value <= _LEAST_CUT:
        return None
    height = cut.x[:d]
    section = points / (points @ height)[:, None]
    plane = null_space(height[None])
    try:
        hull = ConvexHull((section - section.mean(axis=0)) @ plane)
    except QhullError:
        return None
    level = hull.equations[:, -1] - hull.equations[:, :-1] @ (section.mean(axis=0) @ plane)
    sides = hull.equations[:, :-1] @ plane.T + level[:, None] * height
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    _, first = np.unique(np.round(sides / tolerances.SAME_BELIEF), axis=0, return_index=True)
    return np.asarray(sides[np.sort(first)])
