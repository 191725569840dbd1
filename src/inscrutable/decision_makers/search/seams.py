"""Decoys where the decision changes its face: between two neighbouring candidates on different faces, the last of each.

The most private decision is often the last one before an asset is dropped, where no grid has a decoy.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import Delaunay, QhullError

from inscrutable import tolerances
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_HALVINGS = 30
_MOST_EDGES = 20_000
_MOST_DECOYS = 100_000


def seam_decoys(problem: DecisionProblem, decoys: Array) -> Array:
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
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        found, allowed = _sides(problem, middle)
        same = ((found == side).all(axis=1) & allowed)[:, None]
        near, far = np.where(same, middle, near), np.where(same, far, middle)
    return np.unique(near, axis=0)


def _sides(problem: DecisionProblem, decoys: Array) -> tuple[np.ndarray, np.ndarray]:
    """Which rows are tight at the decision of each decoy, and whether it is admissible."""
    actions, region = problem.solve(decoys), problem.constraints
    slacks = region.slacks(actions)
    # What is tight by rounding only would be played as tight, and no belief of its side explains that.
    loose = max(region.min_slack * (1.0 - tolerances.FEASIBILITY), tolerances.FEASIBILITY)
    clear = ((slacks <= tolerances.STATIONARITY) | (slacks >= loose)).all(axis=1)
    return region.tight_rows(actions), region.is_admissible(actions) & clear
