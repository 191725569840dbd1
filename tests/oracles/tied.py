"""Linear costs by enumeration: all vertices, all faces, the beliefs that explain each, and how far these are."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

CLOSE = 1e-9


class Face(NamedTuple):
    """A face by its vertices, with the state costs of these."""

    vertices: np.ndarray  # (k,U)
    costs: np.ndarray  # (k,X)
    distance: float  # of the beliefs that explain its inside; infinite where there are none


def vertices_of(region):
    """All vertices of a small polyhedron, by trying every set of rows."""
    found = []
    for rows in combinations(range(len(region.b_ub)), region.n_actions - np.linalg.matrix_rank(region.A_eq)):
        matrix = np.vstack([region.A_eq, region.A_ub[list(rows)]])
        if np.linalg.matrix_rank(matrix) < region.n_actions:
            continue
        point = np.linalg.lstsq(matrix, np.concatenate([region.b_eq, region.b_ub[list(rows)]]), rcond=None)[0]
        known = any(np.abs(point - other).max() < CLOSE for other in found)
        if (region.A_ub @ point <= region.b_ub + CLOSE).all() and not known:
            found.append(point)
    return np.array(found)


def faces_of(region, vertices):
    """All faces as sets of vertex numbers: the whole, and what inequality rows that are tight have in common."""
    tight = np.abs(region.A_ub @ vertices.T - region.b_ub[:, None]) <= CLOSE
    sides = [frozenset(np.flatnonzero(row).tolist()) for row in tight]
    found = {frozenset(range(len(vertices)))}
    fresh = set(found)
    while fresh:
        fresh = {face & side for face in fresh for side in sides} - found - {frozenset()}
        found |= fresh
    return [sorted(face) for face in found]


def distance_to(equal, below, point):
    """Distance of a belief from {π in the simplex : equal π = 0, below π ≤ 0}, by projecting on every face of it."""
    size = len(point)
    rows = np.vstack([below, -np.eye(size)])
    fixed = np.vstack([equal, np.ones((1, size))])
    sides = np.append(np.zeros(len(equal)), 1.0)
    best = np.inf
    for count in range(size):
        chosen = np.array(list(combinations(range(len(rows)), count)), dtype=int)
        matrices = np.concatenate([np.broadcast_to(fixed, (len(chosen), *fixed.shape)), rows[chosen]], axis=1)
        right = np.concatenate([sides, np.zeros(count)])
        away = (right - matrices @ point)[..., None]
        moved = point + (np.linalg.pinv(matrices, rcond=1e-10) @ away)[..., 0]
        off = np.abs((matrices @ moved[..., None])[..., 0] - right).max(axis=1)
        inside = (off <= CLOSE) & (moved @ rows.T <= CLOSE).all(axis=1)
        best = min(best, float(np.linalg.norm(moved[inside] - point, axis=1).min(initial=np.inf)))
    return best


def explained_faces(problem, point):
    """All faces of the feasible set of a linear problem, with distances from a point."""
    vertices = vertices_of(problem.constraints)
    costs = vertices @ problem.costs.T
    found = []
    for face in faces_of(problem.constraints, vertices):
        first = costs[face[0]]
        others = np.array([each for each in range(len(vertices)) if each not in face], dtype=int)
        away = distance_to(costs[face] - first, first - costs[others], point)
        found.append(Face(vertices[face], costs[face], away))
    return found


def suprema(problem, belief, limit, target=None):
    """The best single decision and the best lottery that a regret allows, as suprema over the whole feasible set."""
    faces = [each for each in explained_faces(problem, belief if target is None else target) if each.distance < np.inf]
    least = min((each.costs @ belief).min() for each in faces)
    lowest = np.array([(each.costs @ belief).min() - least for each in faces])
    highest = np.array([(each.costs @ belief).max() - least for each in faces])
    worth = np.array([each.distance if target is None else -each.distance for each in faces])
    allowed = (lowest < limit - CLOSE) | (highest <= limit + CLOSE)
    single = float(worth[allowed].max())
    if limit == 0.0:
        return single, single
    total = np.ones((1, len(faces)))
    answer = linprog(-worth, lowest[None] / limit, [1.0], total, [1.0])
    return single, max(single, -float(answer.fun))
