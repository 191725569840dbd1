"""Cells whose decisions lie on one face of C and are each explained by more beliefs than one, for quadratic costs.

Where fewer coordinates of a decision are free than a belief has, Π(u) reaches from the cell to beliefs that may be much
nearer to the true one, while every cell holds many decisions. For quadratic costs that can be proven: all decisions that
are optimal on the cell are near one (stationarity on the face bounds how near), and Π of each has a member near one
common belief (what is left of its equations there, over their least singular value). Every estimate is an upper bound.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import consistent_beliefs
from inscrutable.decision_makers.oracle_points import OraclePoints
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array

_INWARD = (0.002, 0.01, 0.05, 0.2, 0.5)  # of the way from the nearest member to the centre


class _Face(NamedTuple):
    """Rows that are tight: their multipliers are −pseudo (H u + g), free directions the columns of `free`."""

    normals: Array  # (R, U)
    pseudo: Array  # (R, U) of inequality rows only
    free: Array  # (U, F)
    loose: np.ndarray  # inequality rows that are not tight


class SharedFaces:
    """Upper bounds of the distance to the consistent sets of all decisions that are optimal somewhere on a cell."""

    def __init__(self, problem: QuadraticProblem, points: OraclePoints) -> None:
        self.problem = problem
        self.points = points
        region = problem.constraints
        equal = region.A_eq
        self._inside = _complement(equal, problem.n_actions)
        self._actions: dict[int, Array] = {}
        self._spans: dict[int, tuple[Array, Array]] = {}
        self._faces: dict[bytes, _Face | None] = {}

    def bounds(self, corners: np.ndarray) -> Array:
        """Return an upper bound of the distance for each cell (C,X), infinite where there is no proof."""
        self._solve(np.unique(corners))
        return np.array([self._bound(cell) for cell in corners])

    def _solve(self, indices: np.ndarray) -> None:
        fresh = [index for index in indices.tolist() if index not in self._actions]
        if fresh:
            self._actions.update(zip(fresh, self.problem.solve(self.points.beliefs[fresh]), strict=True))

    def _face(self, tight: np.ndarray) -> _Face | None:
        key = tight.tobytes()
        if key not in self._faces:
            self._faces[key] = self._made(tight)
        return self._faces[key]

    def _made(self, tight: np.ndarray) -> _Face | None:
        region = self.problem.constraints
        normals = np.vstack([region.A_ub[tight], region.A_eq])
        free = _complement(normals, self.problem.n_actions)
        independent = free.shape[1] == self.problem.n_actions - len(normals)
        if not independent or not 0 < free.shape[1] < self.problem.n_states - 1:
            return None
        pseudo = np.linalg.pinv(normals.T)[: int(tight.sum())]
        return _Face(normals, pseudo, free, ~tight)

    def _bound(self, cell: np.ndarray) -> float:
        region = self.problem.constraints
        actions = np.array([self._actions[int(index)] for index in cell])
        slacks = region.slacks(actions) / region.row_scale
        tight = slacks <= tolerances.FEASIBILITY
        if (tight != tight[0]).any():
            return np.inf
        face = self._face(tight[0])
        if face is None:
            return np.inf
        action = actions.mean(axis=0)
        reach = self._reach(cell, face, action)
        if reach is None:
            return np.inf
        spans = [self._span(int(index)) for index in cell]
        near, centre = (np.mean([span[part] for span in spans], axis=0) for part in (0, 1))
        for share in _INWARD:
            distance = self._distance(face, action, reach, near + share * (centre - near))
            if distance is not None:
                return distance
        return np.inf

    def _span(self, index: int) -> tuple[Array, Array]:
        """Nearest member and centre of Π at a point's decision; only proposals."""
        if index not in self._spans:
            found = consistent_beliefs(self.problem, self._actions[index])
            own = self.points.beliefs[index]
            span = (own, own) if found.is_empty else (found.nearest(self.points.belief), found.center())
            self._spans[index] = span
        return self._spans[index]

    def _reach(self, cell: np.ndarray, face: _Face, action: Array) -> float | None:
        """How far from `action` any decision may lie that is optimal on the cell, all of them on the face; None if unproven.

        First by the curvature inside C: ½ m ‖u − ū‖² ≤ y·s(ū) − V(y), linear at the corners. Then all multipliers of the
        tight rows stay positive and no other row is met, so by stationarity on the face.
        """
        problem, beliefs = self.problem, self.points.beliefs[cell]
        hessians = np.tensordot(beliefs, problem.hessians, axes=1)
        curved = self._inside.T @ hessians @ self._inside
        least = float(np.linalg.eigvalsh(curved)[:, 0].min())
        if least <= tolerances.CURVATURE * float(np.abs(problem.hessians).max()):
            return None
        excess = float((beliefs @ problem.state_costs(action) - self.points.values[cell]).max()) + self.points.allowance
        wide = float(np.sqrt(2.0 * max(excess, 0.0) / least))
        slopes = hessians @ action + beliefs @ problem.linear
        multipliers = (-slopes @ face.pseudo.T) - wide * np.linalg.norm(face.pseudo @ hessians, axis=2)
        region = problem.constraints
        spare = region.slacks(action)[face.loose] - wide * np.linalg.norm(region.A_ub[face.loose] @ self._inside, axis=1)
        if multipliers.min(initial=np.inf) <= 0.0 or spare.min(initial=np.inf) <= 0.0:
            return None
        bent = float(np.linalg.eigvalsh(face.free.T @ hessians @ face.free)[:, 0].min())
        return min(wide, float(np.linalg.norm(slopes @ face.free, axis=1).max()) / bent)

    def _distance(self, face: _Face, action: Array, reach: float, proposed: Array) -> float | None:
        """The distance to a belief near which Π of every decision within reach on the face has a member, and how near."""
        problem = self.problem
        gradients = problem.cost_gradients(action)
        turned = face.free.T @ problem.hessians @ face.free
        scale = 1.0 / max(float(np.linalg.norm(gradients @ face.free)), tolerances.TINY)
        system = np.vstack([scale * (gradients @ face.free).T, np.ones(problem.n_states)])
        right = np.append(np.zeros(face.free.shape[1]), 1.0)
        belief = proposed - np.linalg.pinv(system) @ (system @ proposed - right)
        left = float(np.linalg.norm(system @ belief - right))
        shift = scale * reach * float(np.sqrt((np.linalg.norm(turned, 2, axis=(1, 2)) ** 2).sum()))
        regular = float(np.linalg.svd(system, compute_uv=False)[-1]) - shift
        if regular <= 0.0:
            return None
        moved = scale * reach * float(np.linalg.norm(np.tensordot(belief, turned, axes=1), 2))
        near = (left + moved) / regular
        if belief.min() < near:
            return None
        hessian = np.tensordot(belief, problem.hessians, axes=1)
        bending = np.linalg.norm(face.pseudo @ problem.hessians @ face.free, 2, axis=(1, 2)) if len(face.pseudo) else np.zeros(0)
        multipliers = -(belief @ gradients) @ face.pseudo.T
        lost = (
            near * np.linalg.norm(face.pseudo @ gradients.T, axis=1)
            + reach * np.linalg.norm(face.pseudo @ hessian @ face.free, axis=1)
            + near * reach * float(np.sqrt((bending**2).sum()))
        )
        if (multipliers - lost).min(initial=np.inf) < 0.0:
            return None
        return float(np.linalg.norm(belief - self.points.belief)) + near


def _complement(rows: Array, size: int) -> Array:
    """An orthonormal basis (U,F) of the directions that rows (R,U) do not see."""
    if not len(rows):
        return np.eye(size)
    _, sizes, directions = np.linalg.svd(rows, full_matrices=True)
    rank = int((sizes > tolerances.CURVATURE * sizes.max(initial=0.0)).sum())
    return np.asarray(directions[rank:].T)
