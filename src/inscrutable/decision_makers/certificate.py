"""Proofs that no affordable decision is more private: branch and bound over beliefs with nothing but the optimal cost.

Every plausible decision is optimal for some belief y, and its privacy is then at most ‖π − y‖ (at most −‖t − y‖ when the
goal is a target t and y the member nearest to it). The simplex is cut into simplicial cells; on each, the regret of
*every* decision that is optimal for one of its beliefs is bounded from below through optimal costs at the corners and on
the way to them, which turns the largest privacy there into a tiny linear programme. Cells that could still hold
something better are halved. A cell whose corners share one decision is part of its consistent set and counts with the
distance of that set, itself and nothing beyond it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import consistent_beliefs
from inscrutable.decision_makers.cell_programmes import cell_bounds
from inscrutable.decision_makers.oracle_points import N_LEVELS, OraclePoints
from inscrutable.decision_makers.shared_faces import SharedFaces
from inscrutable.errors import InscrutableError
from inscrutable.geometry.simplicial import cones_from, directions_to, edges, halved
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem, QuadraticProblem
from inscrutable.validation import Array

_MOST_CELLS = 256  # halved in one round
_EDGE_SHARE = 1.2  # a cell's edge over what is left of the way to it, 1 − τ: where both errors are alike
_PULLS = np.array([0.0, 0.01, 0.1, 0.5])
_ATTEMPTS = 3


class Question(NamedTuple):
    """Largest Ψ under a budget, or largest Ψ − multiplier · regret; nothing below `floor` is of interest."""

    reference: Reference
    budget: float
    multiplier: float | None
    floor: float
    judged: frozenset[int] = frozenset()
    """Points whose decisions are known to be worth less than they seem; another one that seems worth more than the floor
    ends the search where there is a multiplier, because a better one then exists."""


@dataclass(frozen=True, eq=False)
class Answer:
    """No decision is worth more than `bound`; `complete` where every cell was judged down to the floor."""

    bound: float
    complete: bool


class Prover:
    """Branch and bound for one problem and belief; what the oracle said is kept for the next question."""

    def __init__(self, problem: DecisionProblem, belief: Array, most_calls: int) -> None:
        self.problem = problem
        self.belief = belief
        self.most_calls = most_calls
        cones = cones_from(belief)
        self.points = OraclePoints(problem, belief, cones.points[1:])
        self._cones = cones.corners
        self._shared: list[tuple[Array, float]] = []
        self._faces = SharedFaces(problem, self.points) if isinstance(problem, QuadraticProblem) else None

    def answer(self, question: Question) -> Answer:
        """Return a bound for one question; again where the solver turned out less exact than allowed for."""
        for _ in range(_ATTEMPTS):
            allowance = self.points.allowance
            found = self._search(question)
            if self.points.allowance <= 2.0 * allowance:
                return found
        return Answer(float("inf"), False)

    def _search(self, question: Question) -> Answer:
        corners = self._cones
        bounds = self._bounds(corners, question)
        closed = -np.inf
        while True:
            judged = bounds <= question.floor
            closed = max(closed, float(bounds[judged].max(initial=-np.inf)))
            corners, bounds = corners[~judged], bounds[~judged]
            if len(corners) and question.reference.sign > 0 and self.problem.costs_are_unique:
                worth = self._shared_worth(corners, question)
                closed = max(closed, float(worth[~np.isnan(worth)].max(initial=-np.inf)))
                corners, bounds = corners[np.isnan(worth)], bounds[np.isnan(worth)]
            if not len(corners):
                return Answer(closed, True)
            if self.points.calls >= self.most_calls or self._beaten(question):
                return Answer(max(closed, float(bounds.max())), False)
            worst = np.argsort(-bounds, kind="stable")
            halves = self._halved(corners[worst[:_MOST_CELLS]])
            corners = np.concatenate([halves, corners[worst[_MOST_CELLS:]]])
            # A part is bounded by the whole it comes from.
            whole = np.tile(bounds[worst[:_MOST_CELLS]], 2)
            fresh = np.minimum(self._bounds(halves, question), whole)
            bounds = np.concatenate([fresh, bounds[worst[_MOST_CELLS:]]])

    def seeming(self, reference: Reference) -> tuple[Array, Array]:
        """Return regrets of the decisions at all points, and what the distance from or to the point itself makes of them."""
        regrets = self.points.costs @ self.belief - self.points.optimal_cost
        return regrets, reference.sign * np.linalg.norm(self.points.beliefs - reference.point, axis=1)

    def _beaten(self, question: Question) -> bool:
        if question.multiplier is None:
            return False
        regrets, worth = self.seeming(question.reference)
        above = np.flatnonzero(worth - question.multiplier * regrets > question.floor + tolerances.CHORD)
        return not question.judged.issuperset(above.tolist())

    def _halved(self, corners: np.ndarray) -> np.ndarray:
        """Cut along the edge that is long and on which V bends."""
        pairs = edges(corners.shape[1])
        points, costs = self.points.beliefs[corners], self.points.costs[corners]
        ways = points[:, pairs[:, 1]] - points[:, pairs[:, 0]]
        bends = np.maximum(((costs[:, pairs[:, 0]] - costs[:, pairs[:, 1]]) * ways).sum(axis=2), 0.0)
        lengths = (ways * ways).sum(axis=2)
        shares = [part / np.maximum(part.sum(axis=1, keepdims=True), tolerances.TINY) for part in (bends, lengths)]
        chosen = pairs[(np.sqrt(shares[0]) + np.sqrt(shares[1])).argmax(axis=1)]
        rows = np.arange(len(corners))[:, None]
        return halved(corners, chosen, self.points.middles(corners[rows, chosen]))

    def _bounds(self, corners: np.ndarray, question: Question) -> Array:
        points = self.points.beliefs[corners]
        pairs = edges(corners.shape[1])
        longest = np.linalg.norm(points[:, pairs[:, 0]] - points[:, pairs[:, 1]], axis=2).max(axis=1)
        farthest = np.linalg.norm(points - self.belief, axis=2).max(axis=1)
        levels = np.clip(np.rint(-np.log2(_EDGE_SHARE * longest / farthest)), 1, N_LEVELS - 1).astype(np.intp)
        self.points.look_on_the_way(corners, levels)
        regrets = self.points.regret_bounds(corners, levels, self.points.upper_costs(corners))
        gains = _gains(points, question.reference)
        bounds = cell_bounds(gains, regrets, question.budget, question.multiplier)
        alive = np.flatnonzero(bounds > question.floor)
        if self._faces is None or question.reference.sign < 0 or not alive.size:
            return bounds
        nearer = self._faces.bounds(corners[alive])
        alive, nearer = alive[np.isfinite(nearer)], nearer[np.isfinite(nearer)]
        constant = np.broadcast_to(nearer[:, None], gains[alive].shape)
        shared = cell_bounds(constant, regrets[alive], question.budget, question.multiplier)
        bounds[alive] = np.minimum(bounds[alive], shared)
        return bounds

    def _shared_worth(self, corners: np.ndarray, question: Question) -> Array:
        """What cells are worth whose corners share one decision, −∞ where it is not affordable; NaN for other cells."""
        upper = self.points.upper_costs(corners)
        slack = tolerances.SHARED_DECISION * self.points.scale
        optimal = (upper <= self.points.values[corners][:, :, None] + slack).all(axis=1)
        width = np.abs(self.points.beliefs[corners] - self.points.beliefs[corners[:, :1]]).max(axis=(1, 2))
        shares = optimal.any(axis=1) & (width >= tolerances.SHARED_WIDTH)
        worth = np.full(len(corners), np.nan)
        for cell in np.flatnonzero(shares):
            costs = self.points.costs[corners[cell, optimal[cell].argmax()]]
            regret = float(costs @ self.belief) - self.points.optimal_cost - self.points.allowance
            if question.multiplier is not None:
                worth[cell] = self._distance(costs, corners[cell]) - question.multiplier * max(regret, 0.0)
            else:
                worth[cell] = self._distance(costs, corners[cell]) if regret <= question.budget else -np.inf
        return worth

    def _distance(self, costs: Array, corners: np.ndarray) -> float:
        """An upper bound of the distance to the beliefs for which a decision of these state costs is optimal."""
        for known, distance in self._shared:
            if np.abs(known - costs).max() <= tolerances.SHARED_DECISION * self.points.scale:
                return distance
        start = self.points.beliefs[corners]
        start = start[np.linalg.norm(start - self.belief, axis=1).argmin()]
        trials = np.vstack([self._nearest(start) + _PULLS[:, None] * (start - self._nearest(start))])
        values, _ = self.points.ask(trials)
        members = values >= trials @ costs - tolerances.SHARED_DECISION * self.points.scale
        reached = np.vstack([trials[members], start])
        distance = float(np.linalg.norm(reached - self.belief, axis=1).min())
        self._shared.append((costs, distance))
        return distance

    def _nearest(self, member: Array) -> Array:
        """Where the observer's set of the decision at `member` comes nearest; only a proposal, to be asked about."""
        try:
            found = consistent_beliefs(self.problem, self.problem.solve(member)).nearest(self.belief)
        except InscrutableError:
            return member
        return np.asarray(found) if np.isfinite(found).all() else member


def _gains(points: Array, reference: Reference) -> Array:
    """Privacy at the corners (C,X) of a function above the privacy and linear on each cell."""
    if reference.sign > 0:
        # The distance is convex: below the interpolation of its corners.
        return np.asarray(np.linalg.norm(points - reference.point, axis=2))
    directions = directions_to(reference.point, points)
    return np.asarray(-np.einsum("cjx,cx->cj", points - reference.point, directions))
