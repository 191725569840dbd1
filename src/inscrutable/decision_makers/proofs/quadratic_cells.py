"""Regrets on cells of beliefs for quadratic costs: bounds whose error falls with the square of a cell's size.

Let u_j be the optimal decisions at a cell's corners y_j, λ_j their multipliers, and interpolate both along with the
belief. At y = Σ θ_j y_j the interpolated decision ũ is feasible, its conditions of optimality are broken by no more than

    R = Σ_{j<k} θ_j θ_k (H(y_j) − H(y_k))(u_j − u_k)   and   c = Σ_{jk} θ_j θ_k λ_j·slack(u_k),

so the optimal decision u*(y) is near: m‖u* − ũ‖² ≤ ‖R‖‖u* − ũ‖ + c with the least curvature m. A regret, convex in the
decision, is at least its value at ũ minus its gradient's norm times that distance. Lengths are measured by the mean
curvature of the states, inside the equalities of C.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.proofs.smooth_cells import Nearness, SmoothCells, Whitened, pair_share, whitened_by
from inscrutable.geometry.simplicial import edges
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array


def whitened(problem: QuadraticProblem) -> Whitened | None:
    """Return the coordinates, None where the mean of the costs is not strictly convex inside C."""
    return whitened_by(problem, problem.hessians)


class QuadraticCells(SmoothCells):
    """Bounds of the regret on cells, from the optimal decisions at their corners."""

    @property
    def is_strictly_convex(self) -> bool:
        """Whether every belief's cost is strictly convex inside C."""
        least = np.linalg.eigvalsh(self.form.hessians)
        return bool((least[:, 0] > tolerances.CURVATURE * least[:, -1]).all())

    def is_blind(self, regrets: Array, near: Nearness) -> np.ndarray:
        """Return which cells (C,) need bounds by optimal costs: all where some belief's cost is not strictly convex."""
        return np.full(len(regrets), not self.is_strictly_convex)

    @cached_property
    def _bending(self) -> float:
        return float(np.sqrt((np.linalg.norm(self.form.hessians, 2, axis=(1, 2)) ** 2).sum()))

    def _traits(self, actions: Array, beliefs: Array) -> Array:
        """Least and greatest curvature."""
        curvatures = np.linalg.eigvalsh(np.tensordot(beliefs, self.form.hessians, axes=1))
        return np.asarray(curvatures[:, [0, -1]])

    def unrest(self, corners: np.ndarray) -> Array:
        """Return the most by which interpolations break the conditions of optimality on cells (C,J): ‖R‖."""
        known, beliefs, pairs = self.known, self.points.beliefs, edges(corners.shape[1])
        first, second = corners[:, pairs[:, 0]], corners[:, pairs[:, 1]]
        change = known.gradients[first] - known.gradients[second]
        left = np.linalg.norm(np.einsum("cex,cexf->cef", beliefs[first] - beliefs[second], change), axis=2)
        return np.asarray(known.residuals[corners].max(axis=1) + pair_share(corners.shape[1]) * left.max(axis=1))

    def nearness(self, corners: np.ndarray) -> Nearness:
        """Return how near interpolations are on cells (C,J)."""
        broken, loose = self.unrest(corners), self.spare(corners, edges(corners.shape[1]))
        curvatures = self.known.traits[corners]
        least, greatest = curvatures[..., 0].min(axis=1), curvatures[..., 1].max(axis=1)
        curved = least > tolerances.CURVATURE * greatest
        least = np.where(curved, least, 1.0)
        near = (broken + np.sqrt(broken**2 + 4.0 * least * loose)) / (2.0 * least)
        slopes = np.linalg.norm(self.known.slopes[corners], axis=2)
        found = Nearness(near, broken + greatest * near, self._bending * near, slopes * near[:, None])
        return found.where(curved)

    def regret_bounds(self, corners: np.ndarray, near: Nearness) -> Array:
        """Return columns (C,J,K) of lower bounds of the regret of every optimal decision, linear on each cell (C,J)."""
        known = self.known
        places, slopes, regrets = known.places[corners], known.slopes[corners], known.regrets[corners]
        pairs = edges(corners.shape[1])
        # Tangents at the corners' decisions and at their mean; and the chord minus the largest gap to the quadratic.
        away = places[:, :, None] - places[:, None]
        at_corners = regrets[:, None, :] + np.einsum("cjkf,ckf->cjk", away, slopes)
        apart = places[:, pairs[:, 0]] - places[:, pairs[:, 1]]
        curvatures = ((slopes[:, pairs[:, 0]] - slopes[:, pairs[:, 1]]) * apart).sum(axis=2)
        mean = regrets.mean(axis=1) - 0.5 * curvatures.sum(axis=1) / corners.shape[1] ** 2
        centred = places - places.mean(axis=1, keepdims=True)
        at_mean = mean[:, None] + np.einsum("cjf,cf->cj", centred, slopes.mean(axis=1))
        chord = regrets - 0.5 * pair_share(corners.shape[1]) * curvatures.max(axis=1)[:, None]
        columns = np.concatenate([at_corners, at_mean[:, :, None], chord[:, :, None]], axis=2)
        sure = np.isfinite(near.near)
        lost = np.where(sure[:, None], near.regrets, 0.0) + self.points.allowance
        return np.where(sure[:, None, None], columns - lost[:, :, None], 0.0)
