"""Decoys where the decision changes its face: between two neighbouring candidates on different faces, the last of each.

The most private decision is often the last one before an asset is dropped, where no grid has a decoy.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, QhullError

from inscrutable import tolerances
from inscrutable.decision_makers.search.faces import FaceProgramme, face_programme
from inscrutable.geometry.equal_rows import distinct_patterns
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array

_HALVINGS = 30
_MOST_EDGES = 20_000
_MOST_DECOYS = 100_000


def seam_decoys(problem: QuadraticProblem, decoys: Array) -> Array:
    """Return the decoys (n,3) on both sides of every change of face along the edges of a triangulation of `decoys` (M,3).

    Each is the last, from its own side, whose decision is admissible and has the tight rows of that side. Nothing is
    returned where the triangulation would take long, with so many decoys that seams are near in any case.
    """
    none = np.empty((0, 3))
    if not 3 <= len(decoys) <= _MOST_DECOYS:
        return none
    try:
        triangles = Delaunay(decoys @ sum_zero_basis(3)).simplices
    except QhullError:
        return none
    edges = np.unique(
        np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [0, 2]]]), axis=1), axis=0
    )
    tight, usable = _sides(problem, decoys)
    changes = edges[
        (tight[edges[:, 0]] != tight[edges[:, 1]]).any(axis=1) | (usable[edges[:, 0]] != usable[edges[:, 1]])
    ]
    changes = np.vstack([changes, changes[:, ::-1]])
    changes = changes[usable[changes[:, 0]]]
    if not 0 < len(changes) <= _MOST_EDGES:
        return none
    near, far, side = decoys[changes[:, 0]], decoys[changes[:, 1]], tight[changes[:, 0]]
    if problem.solves_in_bulk:
        return np.unique(_between(problem, near, far, side)[0], axis=0)
    found, beyond = _along_faces(problem, near, far, side)
    ok = _is_side(problem, found, side) & ~_is_side(problem, beyond, side)
    if not ok.all():
        found[~ok] = _between(problem, near[~ok], far[~ok], side[~ok])[0]
    return np.unique(found, axis=0)


def _between(problem: QuadraticProblem, near: Array, far: Array, side: np.ndarray) -> tuple[Array, Array]:
    """Halve the ways (n,3) from `near`, whose decision has the tight rows `side` (n,r), to `far`, whose decision has not."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        same = _is_side(problem, middle, side)[:, None]
        near, far = np.where(same, middle, near), np.where(same, far, middle)
    return near, far


def _along_faces(problem: QuadraticProblem, near: Array, far: Array, side: np.ndarray) -> tuple[Array, Array]:
    """The same by each face's own decisions: what is best on the face is best of all while its rows push and others give.

    Much faster where decisions are solved one by one; a face without a unique decision leaves its ways as they are.
    """
    found, beyond = near.copy(), far.copy()
    faces, which = distinct_patterns(side)
    for number, tight in enumerate(faces):
        of_it, face = np.flatnonzero(which == number), face_programme(problem, tight)
        ends = found[of_it], beyond[of_it]
        try:
            for _ in range(_HALVINGS):
                middle = 0.5 * (ends[0] + ends[1])
                same = _is_best_on(problem, face, middle)[:, None]
                ends = np.where(same, middle, ends[0]), np.where(same, ends[1], middle)
        except np.linalg.LinAlgError:
            continue
        found[of_it], beyond[of_it] = ends
    return found, beyond


def _is_best_on(problem: QuadraticProblem, face: FaceProgramme, decoys: Array) -> np.ndarray:
    """Whether the best decision on a face is admissible and best of all, for decoys (n,3)."""
    size = face.span.shape[1]
    curves = np.tensordot(decoys, face.curves, axes=1)
    places = np.linalg.solve(curves[:, :size, :size], -curves[:, :size, size:])[:, :, 0]
    w = np.column_stack([places, np.ones(len(places))])
    rows = np.tensordot(decoys, face.rows[len(face.curves) :], axes=(1, 1))
    values, n_multipliers = (rows @ w[:, :, None])[:, :, 0], face.n_set_rows - len(face.curves)
    beyond = problem.constraints.observed_slack - problem.constraints.played_slack
    multipliers, slacks = values[:, :n_multipliers], values[:, n_multipliers:]
    return np.asarray((multipliers >= -tolerances.STATIONARITY).all(axis=1) & (slacks >= beyond).all(axis=1))


def _is_side(problem: QuadraticProblem, decoys: Array, side: np.ndarray) -> np.ndarray:
    """Whether the decision of each decoy is admissible and has just the tight rows of its side (n,r)."""
    found, allowed = _sides(problem, decoys)
    return np.asarray((found == side).all(axis=1) & allowed)


def _sides(problem: QuadraticProblem, decoys: Array) -> tuple[np.ndarray, np.ndarray]:
    """Which rows are tight at the decision of each decoy, and whether it is admissible."""
    actions, region = problem.solve(decoys), problem.constraints
    slacks = region.slacks(actions)
    # What is tight by rounding only would be played as tight, and no belief of its side explains that.
    loose = max(region.min_slack * (1.0 - tolerances.FEASIBILITY), tolerances.FEASIBILITY)
    clear = ((slacks <= tolerances.STATIONARITY) | (slacks >= loose)).all(axis=1)
    return region.tight_rows(actions), region.is_admissible(actions) & clear
