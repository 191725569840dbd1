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
from inscrutable.decision_makers.oracle_points import OraclePoints
from inscrutable.geometry import BeliefSet
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array

_INWARD = (0.002, 0.01, 0.05, 0.2, 0.5)  # of the way from the nearest member to the centre


class _Face(NamedTuple):
    """Rows held as equalities: their multipliers are −pseudo (H u + g), free directions the columns of `free`."""

    pseudo: Array  # (R, U), of inequality rows only
    free: Array  # (U, F)


class SharedFaces:
    """Upper bounds of the distance to the consistent sets of all decisions that are optimal somewhere on a cell."""

    def __init__(self, problem: QuadraticProblem, points: OraclePoints) -> None:
        self.problem = problem
        self.points = points
        region = problem.constraints
        equal = region.A_eq
        self._inside = _complement(equal, problem.n_actions)
        self._actions: dict[int, Array] = {}
        self._faces: dict[bytes, _Face | None] = {}

    def bounds(self, corners: np.ndarray) -> Array:
        """Return an upper bound of the distance for each cell (C,X), infinite where there is no proof."""
        self._solve(np.unique(corners))
        region = self.problem.constraints
        found = np.full(len(corners), np.inf)
        for row, cell in enumerate(corners):
            actions = np.array([self._actions[int(index)] for index in cell])
            tight = (region.slacks(actions) <= tolerances.FEASIBILITY).sum(axis=1)
            # Without a corner on a small enough face there is hardly a shared one.
            if self._inside.shape[1] - tight.max(initial=0) < self.problem.n_states - 1:
                found[row] = self._bound(cell, actions.mean(axis=0))
        return found

    def _solve(self, indices: np.ndarray) -> None:
        fresh = [index for index in indices.tolist() if index not in self._actions]
        if fresh:
            self._actions.update(zip(fresh, self.problem.solve(self.points.beliefs[fresh]), strict=True))

    def _face(self, rows: np.ndarray) -> _Face | None:
        """The face of some inequality rows; None where rows depend on each other."""
        key = rows.tobytes()
        if key not in self._faces:
            region = self.problem.constraints
            normals = np.vstack([region.A_ub[rows], region.A_eq])
            free = _complement(normals, self.problem.n_actions)
            independent = free.shape[1] == self.problem.n_actions - len(normals)
            pseudo = np.linalg.pinv(normals.T)[: int(rows.sum())] if len(normals) else normals
            self._faces[key] = _Face(pseudo, free) if independent else None
        return self._faces[key]

    def _bound(self, cell: np.ndarray, action: Array) -> float:
        found = self._reach(cell, action)
        if found is None:
            return np.inf
        face, reach = found
        gradients = self.problem.cost_gradients(action)
        scale = max(float(np.abs(gradients).max()), tolerances.TINY)
        # What an observer sees of the decision in the middle; only a proposal.
        seen = BeliefSet((gradients @ face.free).T / scale, -(gradients @ face.pseudo.T).T / scale)
        if seen.is_empty:
            return np.inf
        near, centre = seen.nearest(self.points.belief), seen.center()
        for share in _INWARD:
            distance = self._distance(face, action, reach, near + share * (centre - near))
            if distance is not None:
                return distance
        return np.inf

    def _reach(self, cell: np.ndarray, action: Array) -> tuple[_Face, float] | None:
        """A face on which all decisions lie that are optimal on the cell, and how far from `action`; None if unproven.

        How far, first by the curvature inside C: ½ m ‖u − ū‖² ≤ y·s(ū) − V(y), linear at the corners. Only rows within
        that reach can be tight; those of them whose multipliers are positive throughout are tight throughout. Then by the
        slope on their face: m ‖u − ū‖ ≤ ‖slope of the cost at ū‖.
        """
        problem, region, beliefs = self.problem, self.problem.constraints, self.points.beliefs[cell]
        hessians = np.tensordot(beliefs, problem.hessians, axes=1)
        least = _least_curvature(hessians, self._inside)
        if least <= tolerances.CURVATURE * float(np.abs(problem.hessians).max()):
            return None
        excess = float((beliefs @ problem.state_costs(action) - self.points.values[cell]).max()) + self.points.allowance
        reach = float(np.sqrt(2.0 * max(excess, 0.0) / least))
        slopes = hessians @ action + beliefs @ problem.linear
        slacks = region.slacks(action)
        lengths = np.linalg.norm(region.A_ub @ self._inside, axis=1) / np.maximum(region.row_scale, tolerances.TINY)
        face = None
        for _ in range(2):
            met = slacks <= reach * lengths + tolerances.FEASIBILITY
            possible = self._face(met)
            if possible is None:
                break
            multipliers = -slopes @ possible.pseudo.T - reach * np.linalg.norm(possible.pseudo @ hessians, axis=2)
            sure = met.copy()
            sure[met] = (multipliers > 0.0).all(axis=0)
            face = self._face(sure)
            if face is None or not face.free.shape[1]:
                reach = 0.0
                break
            bent = _least_curvature(hessians, face.free)
            reach = min(reach, float(np.linalg.norm(slopes @ face.free, axis=1).max()) / bent)
        if face is None or face.free.shape[1] >= problem.n_states - 1:
            return None
        return face, reach

    def _distance(self, face: _Face, action: Array, reach: float, proposed: Array) -> float | None:
        """The distance to a belief near which Π of every decision within reach on the face has a member, and how near."""
        problem = self.problem
        gradients = problem.cost_gradients(action)
        turned = face.free.T @ problem.hessians @ face.free
        sizes = _sizes(turned)
        scale = 1.0 / max(float(np.linalg.norm(gradients @ face.free)), tolerances.TINY)
        system = np.vstack([scale * (gradients @ face.free).T, np.ones(problem.n_states)])
        right = np.append(np.zeros(face.free.shape[1]), 1.0)
        belief = proposed - np.linalg.pinv(system) @ (system @ proposed - right)
        left = float(np.linalg.norm(system @ belief - right))
        shift = scale * reach * float(np.sqrt((sizes**2).sum()))
        regular = float(np.linalg.svd(system, compute_uv=False)[-1]) - shift
        if regular <= 0.0:
            return None
        moved = scale * reach * float(_sizes(np.tensordot(belief, turned, axes=1)[None])[0])
        near = (left + moved) / regular
        if belief.min() < near:
            return None
        hessian = np.tensordot(belief, problem.hessians, axes=1)
        bending = np.linalg.norm(face.pseudo @ problem.hessians @ face.free, axis=2)
        multipliers = -(belief @ gradients) @ face.pseudo.T
        lost = (
            near * np.linalg.norm(face.pseudo @ gradients.T, axis=1)
            + reach * np.linalg.norm(face.pseudo @ hessian @ face.free, axis=1)
            + near * reach * np.sqrt((bending**2).sum(axis=0))
        )
        if (multipliers - lost).min(initial=np.inf) < 0.0:
            return None
        return float(np.linalg.norm(belief - self.points.belief)) + near


def _least_curvature(hessians: Array, basis: Array) -> float:
    return float(np.linalg.eigvalsh(basis.T @ hessians @ basis)[:, 0].min()) if basis.shape[1] else np.inf


def _sizes(matrices: Array) -> Array:
    """Spectral norms (K,) of matrices (K,F,F)."""
    return np.linalg.norm(matrices, 2, axis=(1, 2)) if matrices.shape[1] else np.zeros(len(matrices))


def _complement(rows: Array, size: int) -> Array:
    """An orthonormal basis (U,F) of the directions that rows (R,U) do not see."""
    if not len(rows):
        return np.eye(size)
    _, sizes, directions = np.linalg.svd(rows, full_matrices=True)
    rank = int((sizes > tolerances.CURVATURE * sizes.max(initial=0.0)).sum())
    return np.asarray(directions[rank:].T)
