"""Bounds of decisions between the corners of a cell of beliefs, where costs are convex and give their curvature.

Let u_j be the optimal decisions at a cell's corners y_j and ũ their interpolation at y. Where the residual of the optimality
conditions at ũ is bounded from above and the costs' curvature from below, the optimal decision u*(y) is near ũ, and so are all
states' gradients and regrets. Each kind of costs has its own bounds; proofs use them in the same way.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.proofs.oracle_points import OraclePoints
from inscrutable.geometry.equal_rows import first_equal
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class Whitened(NamedTuple):
    """A problem in coordinates v of its decisions, u = B v + const, in which the mean of the states' curvatures is one.

    Directions that two opposite rows fix take no part. Inequality rows R v ≤ const have unit length; of equal ones the
    tightest is kept, and constant rows are dropped.
    """

    basis: Array  # B (U,F)
    rows: Array  # R (r,F)
    kept: np.ndarray  # (r,) which rows of A_ub they are
    lengths: Array  # (r,) of A_ub B there
    hessians: Array  # B'H_i B (X,F,F)


class Corners(NamedTuple):
    """Data at points; every array has a row for each."""

    places: Array  # (N,F) v
    gradients: Array  # (N,X,F) of every state's cost
    slopes: Array  # (N,F) of the regret under the true belief
    multipliers: Array  # (N,R)
    slacks: Array  # (N,R)
    residuals: Array  # (N,) residual of the optimality conditions
    regrets: Array  # (N,)
    traits: Array  # (N,·) further data of a kind of costs


class Nearness(NamedTuple):
    """Largest distances from the interpolation of a cell's corners over its beliefs; infinite where not known."""

    near: Array  # (C,) the decision
    sum: Array  # (C,) the belief's mean of the gradients
    gradients: Array  # (C,) all states' gradients together
    regrets: Array  # (C,J) largest shortfall of a regret below the interpolated decision's, linear on the cell

    def pick(self, which: np.ndarray) -> Nearness:
        """Return that of some cells."""
        return Nearness(self.near[which], self.sum[which], self.gradients[which], self.regrets[which])

    def where(self, sure: np.ndarray) -> Nearness:
        """Return the same, infinite except where a cell (C,) is sure."""
        near, total, gradients = (np.where(sure, part, np.inf) for part in self[:3])
        return Nearness(near, total, gradients, np.where(sure[:, None], self.regrets, np.inf))


def whitened_by(problem: DecisionProblem, hessians: Array) -> Whitened | None:
    """Return the coordinates for the states' curvatures (X,U,U), None where their mean is not strictly convex
    inside C."""
    region = problem.constraints
    slacks = region.slacks(problem.solve(middle_of(problem))) * region.row_scale
    inside = complement(region.A_eq, problem.n_actions)
    inside = inside @ complement(_fixed_rows(region.A_ub @ inside, slacks), inside.shape[1])
    sizes = np.linalg.norm(hessians, axis=(1, 2))
    mean = np.tensordot(1.0 / np.maximum(sizes, tolerances.TINY), hessians, axes=1)
    mean *= float(np.median(sizes)) / problem.n_states
    values, vectors = np.linalg.eigh(inside.T @ mean @ inside)
    if not values.size or values[0] <= tolerances.CURVATURE * values[-1]:
        return None
    basis = inside @ (vectors / np.sqrt(values))
    kept, rows, lengths = _distinct_rows(region.A_ub @ basis, slacks)
    return Whitened(basis, rows, kept, lengths, basis.T @ hessians @ basis)


def middle_of(problem: DecisionProblem) -> Array:
    """Return the belief (X,) in the middle of the simplex."""
    return np.full(problem.n_states, 1.0 / problem.n_states)


def _fixed_rows(rows: Array, slacks: Array) -> Array:
    """The rows (R,F) as unit rows that are tight in every decision: they and their opposites are so in one."""
    lengths = np.linalg.norm(rows, axis=1)
    tight = (lengths > tolerances.CURVATURE * lengths.max(initial=0.0)) & (slacks <= tolerances.SAME_ACTION * lengths)
    unit = rows[tight] / lengths[tight, None]
    return np.asarray(unit[first_equal(np.vstack([unit, -unit]))[len(unit) :] < len(unit)])


def _distinct_rows(rows: Array, slacks: Array) -> tuple[np.ndarray, Array, Array]:
    """The rows (R,F) that are not parallel to one with less slack, by number, unit rows and lengths."""
    lengths = np.linalg.norm(rows, axis=1)
    moved = np.flatnonzero(lengths > tolerances.CURVATURE * lengths.max(initial=0.0))
    order = moved[np.argsort(slacks[moved] / lengths[moved], kind="stable")]
    first = first_equal(rows[order] / lengths[order][:, None]) == np.arange(len(order))
    kept = np.sort(order[first])
    return kept, rows[kept] / lengths[kept][:, None], lengths[kept]


class SmoothCells(ABC):
    """Bounds of the regret on cells, from the optimal decisions at their corners."""

    def __init__(self, problem: DecisionProblem, points: OraclePoints, form: Whitened) -> None:
        self.problem = problem
        self.points = points
        self.form = form
        self._pseudo: dict[bytes, Array] = {}
        self._known = self._describe(np.arange(len(points.values)))

    @property
    @abstractmethod
    def is_strictly_convex(self) -> bool:
        """Whether no cell needs any other bounds."""

    @abstractmethod
    def is_blind(self, regrets: Array, near: Nearness) -> np.ndarray:
        """Return which cells (C,) need bounds by optimal costs besides `regrets` (C,J,K)."""

    @abstractmethod
    def unrest(self, corners: np.ndarray) -> Array:
        """Return the most by which interpolations break the conditions of optimality on cells (C,J): ‖R‖."""

    @abstractmethod
    def nearness(self, corners: np.ndarray) -> Nearness:
        """Return how near interpolations are on cells (C,J)."""

    @abstractmethod
    def regret_bounds(self, corners: np.ndarray, near: Nearness) -> Array:
        """Return columns (C,J,K) of lower bounds of the regret of every optimal decision, linear on each cell (C,J)."""

    @abstractmethod
    def _traits(self, actions: Array, beliefs: Array) -> Array:
        """Further data of these costs at decisions (N,U) that are optimal at beliefs (N,X)."""

    @property
    def known(self) -> Corners:
        """Data at all points so far."""
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
        return Corners(
            actions @ np.linalg.pinv(form.basis).T,
            gradients,
            self.points.belief @ gradients,
            multipliers,
            slacks,
            np.linalg.norm(sums + multipliers @ form.rows, axis=1),
            self.points.costs[index] @ self.points.belief - self.points.optimal_cost,
            self._traits(actions, beliefs),
        )

    def pseudo(self, rows: np.ndarray) -> Array:
        """Return P (r,F) with multipliers −P·gradient on some inequality rows, the least-squares ones if they depend."""
        key = rows.tobytes()
        if key not in self._pseudo:
            self._pseudo[key] = np.linalg.pinv(self.form.rows[rows].T)
        return self._pseudo[key]

    def spare(self, corners: np.ndarray, pairs: np.ndarray) -> Array:
        """Return c (C,): the most that Σ θ_j θ_k λ_j·slack(u_k) can be on cells."""
        known = self.known
        spare = np.einsum("cjr,ckr->cjk", known.multipliers[corners], known.slacks[corners])
        own = np.einsum("cjj->cj", spare).max(axis=1)
        crossed = (spare + spare.transpose(0, 2, 1))[:, pairs[:, 0], pairs[:, 1]]
        return np.asarray(own + pair_share(corners.shape[1]) * crossed.max(axis=1))


def pair_share(n_corners: int) -> float:
    """The largest Σ_{j<k} θ_j θ_k of weights in the simplex."""
    return 0.5 * (1.0 - 1.0 / n_corners)


def complement(rows: Array, size: int) -> Array:
    """An orthonormal basis (U,F) of the null space of rows (R,U)."""
    if not len(rows):
        return np.eye(size)
    _, sizes, directions = np.linalg.svd(rows, full_matrices=True)
    rank = int((sizes > tolerances.CURVATURE * sizes.max(initial=0.0)).sum())
    return np.asarray(directions[rank:].T)
