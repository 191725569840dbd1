"""Regrets on cells of beliefs for quadratic costs: bounds whose error falls with the square of a cell's size.

Let u_j be the optimal decisions at a cell's corners y_j, λ_j their multipliers, and interpolate both along with the
belief. At y = Σ θ_j y_j the interpolated decision ũ is feasible, its conditions of optimality are broken by no more than

    R = Σ_{j<k} θ_j θ_k (H(y_j) − H(y_k))(u_j − u_k)   and   c = Σ_{jk} θ_j θ_k λ_j·slack(u_k),

so the optimal decision u*(y) is near: m‖u* − ũ‖² ≤ ‖R‖‖u* − ũ‖ + c with the least curvature m. A regret, convex in the
decision, is then at least its tangents at ũ less its slope times how near that is. Lengths are measured by the mean
curvature of the states, inside the equalities of C.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.proofs.oracle_points import OraclePoints
from inscrutable.geometry.equal_rows import first_equal
from inscrutable.geometry.simplicial import edges
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array


class Whitened(NamedTuple):
    """A problem in coordinates v of its decisions, u = B v + const, in which the mean of the states' curvatures is one.

    Inequality rows R v ≤ const have unit length; of equal ones the tightest is kept, and none that nothing moves.
    """

    basis: Array  # B (U,F)
    rows: Array  # R (r,F)
    kept: np.ndarray  # (r,) which rows of A_ub they are
    lengths: Array  # (r,) of A_ub B there
    hessians: Array  # B'H_i B (X,F,F)


class Corners(NamedTuple):
    """What is known at points; every array has a row for each."""

    places: Array  # (N,F) v
    gradients: Array  # (N,X,F) of every state's cost
    slopes: Array  # (N,F) of the regret under the true belief
    multipliers: Array  # (N,R)
    slacks: Array  # (N,R)
    residuals: Array  # (N,) what is left of the conditions of optimality
    curvatures: Array  # (N,2) least and greatest
    regrets: Array  # (N,)


def whitened(problem: QuadraticProblem) -> Whitened | None:
    """Return the coordinates, None where the mean of the costs does not bend in all directions inside C."""
    region = problem.constraints
    inside = complement(region.A_eq, problem.n_actions)
    sizes = np.linalg.norm(problem.hessians, axis=(1, 2))
    mean = np.tensordot(1.0 / np.maximum(sizes, tolerances.TINY), problem.hessians, axes=1)
    mean *= float(np.median(sizes)) / problem.n_states
    values, vectors = np.linalg.eigh(inside.T @ mean @ inside)
    if not values.size or values[0] <= tolerances.CURVATURE * values[-1]:
        return None
    basis = inside @ (vectors / np.sqrt(values))
    kept, rows, lengths = _distinct_rows(
        region.A_ub @ basis, region.slacks(problem.solve(_middle(problem))) * region.row_scale
    )
    return Whitened(basis, rows, kept, lengths, basis.T @ problem.hessians @ basis)


def _middle(problem: QuadraticProblem) -> Array:
    return np.full(problem.n_states, 1.0 / problem.n_states)


def _distinct_rows(rows: Array, slacks: Array) -> tuple[np.ndarray, Array, Array]:
    """The rows (R,F) that are not parallel to one with less slack, by number, unit rows and lengths."""
    lengths = np.linalg.norm(rows, axis=1)
    moved = np.flatnonzero(lengths > tolerances.CURVATURE * lengths.max(initial=0.0))
    order = moved[np.argsort(slacks[moved] / lengths[moved], kind="stable")]
    first = first_equal(rows[order] / lengths[order][:, None]) == np.arange(len(order))
    kept = np.sort(order[first])
    return kept, rows[kept] / lengths[kept][:, None], lengths[kept]


class QuadraticCells:
    """Bounds of the regret on cells, from the optimal decisions at their corners."""

    def __init__(self, problem: QuadraticProblem, points: OraclePoints, form: Whitened) -> None:
        self.problem = problem
        self.points = points
        self.form = form
        self._pseudo: dict[bytes, Array] = {}
        self._known = self._describe(np.arange(len(points.values)))

    @property
    def bends(self) -> bool:
        """Whether every belief's cost bends in all directions inside C."""
        least = np.linalg.eigvalsh(self.form.hessians)
        return bool((least[:, 0] > tolerances.CURVATURE * least[:, -1]).all())

    @property
    def known(self) -> Corners:
        """What is known at all points there are by now."""
        have, count = len(self._known.regrets), len(self.points.values)
        if have < count:
            fresh = self._describe(np.arange(have, count))
            self._known = Corners(*(np.concatenate(pair) for pair in zip(self._known, fresh, strict=True)))
        return self._known

    def _describe(self, index: np.ndarray) -> Corners:
        problem, region, form = self.problem, self.problem.constraints, self.form
        actions, beliefs = self.points.actions[index], self.points.beliefs[index]
        gradients = problem.cost_gradients(actions) @ form.basis
        slacks = np.maximum((region.b_ub - actions @ region.A_ub.T)[:, form.kept] / form.lengths, 0.0)
        sums = np.einsum("nx,nxf->nf", beliefs, gradients)
        tight = slacks <= tolerances.FEASIBILITY * region.row_scale[form.kept] / form.lengths
        multipliers = np.zeros_like(slacks)
        patterns, which = np.unique(tight, axis=0, return_inverse=True)
        for number, pattern in enumerate(patterns):
            at = np.flatnonzero(which.ravel() == number)
            multipliers[np.ix_(at, pattern)] = np.maximum(-sums[at] @ self.pseudo(pattern).T, 0.0)
        bends = np.linalg.eigvalsh(np.tensordot(beliefs, form.hessians, axes=1))
        return Corners(
            actions @ np.linalg.pinv(form.basis).T,
            gradients,
            self.points.belief @ gradients,
            multipliers,
            slacks,
            np.linalg.norm(sums + multipliers @ form.rows, axis=1),
            bends[:, [0, -1]],
            problem.state_costs(actions) @ self.points.belief - self.points.optimal_cost,
        )

    def pseudo(self, rows: np.ndarray) -> Array:
        """Return P (r,F) with multipliers −P·gradient on some inequality rows, the least-squares ones if they depend."""
        key = rows.tobytes()
        if key not in self._pseudo:
            self._pseudo[key] = np.linalg.pinv(self.form.rows[rows].T)
        return self._pseudo[key]

    def nearness(self, corners: np.ndarray) -> tuple[Array, Array]:
        """Return how far (C,) an optimal decision can be from the interpolated one on cells (C,J), and ‖R‖ (C,)."""
        known, beliefs = self.known, self.points.beliefs
        pairs = edges(corners.shape[1])
        first, second = corners[:, pairs[:, 0]], corners[:, pairs[:, 1]]
        change = known.gradients[first] - known.gradients[second]
        left = np.linalg.norm(np.einsum("cex,cexf->cef", beliefs[first] - beliefs[second], change), axis=2)
        spare = np.einsum("cjr,ckr->cjk", known.multipliers[corners], known.slacks[corners])
        own = np.einsum("cjj->cj", spare).max(axis=1)
        crossed = (spare + spare.transpose(0, 2, 1))[:, pairs[:, 0], pairs[:, 1]]
        share = _pair_share(corners.shape[1])
        broken = known.residuals[corners].max(axis=1) + share * left.max(axis=1)
        loose = own + share * crossed.max(axis=1)
        least = known.curvatures[corners, 0].min(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            near = (broken + np.sqrt(broken**2 + 4.0 * least * loose)) / (2.0 * least)
        bent = least > tolerances.CURVATURE * known.curvatures[corners, 1].max(axis=1)
        return np.where(bent, near, np.inf), broken

    def regret_bounds(self, corners: np.ndarray, near: Array) -> Array:
        """Return columns (C,J,K) of lower bounds of the regret of every optimal decision, linear on each cell (C,J)."""
        known = self.known
        places, slopes, regrets = known.places[corners], known.slopes[corners], known.regrets[corners]
        pairs = edges(corners.shape[1])
        # Tangents at the corners' decisions and at their mean; and the chord, less what a square falls below its own.
        away = places[:, :, None] - places[:, None]
        at_corners = regrets[:, None, :] + np.einsum("cjkf,ckf->cjk", away, slopes)
        apart = places[:, pairs[:, 0]] - places[:, pairs[:, 1]]
        bends = ((slopes[:, pairs[:, 0]] - slopes[:, pairs[:, 1]]) * apart).sum(axis=2)
        mean = regrets.mean(axis=1) - 0.5 * bends.sum(axis=1) / corners.shape[1] ** 2
        centred = places - places.mean(axis=1, keepdims=True)
        at_mean = mean[:, None] + np.einsum("cjf,cf->cj", centred, slopes.mean(axis=1))
        chord = regrets - 0.5 * _pair_share(corners.shape[1]) * bends.max(axis=1)[:, None]
        columns = np.concatenate([at_corners, at_mean[:, :, None], chord[:, :, None]], axis=2)
        sure = np.isfinite(near)
        lost = np.linalg.norm(slopes, axis=2) * np.where(sure, near, 0.0)[:, None] + self.points.allowance
        return np.where(sure[:, None, None], columns - lost[:, :, None], 0.0)


def _pair_share(n_corners: int) -> float:
    """The largest Σ_{j<k} θ_j θ_k of weights in the simplex."""
    return 0.5 * (1.0 - 1.0 / n_corners)


def complement(rows: Array, size: int) -> Array:
    """An orthonormal basis (U,F) of the directions that rows (R,U) do not see."""
    if not len(rows):
        return np.eye(size)
    _, sizes, directions = np.linalg.svd(rows, full_matrices=True)
    rank = int((sizes > tolerances.CURVATURE * sizes.max(initial=0.0)).sum())
    return np.asarray(directions[rank:].T)
