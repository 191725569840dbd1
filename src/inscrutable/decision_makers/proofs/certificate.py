"""Proofs that no affordable decision is more private: branch and bound over beliefs by the optimal cost alone.

Every plausible decision is optimal for some belief y, and its privacy is then at most ‖π − y‖ (at most −‖t − y‖ when the
goal is a target t and y the member nearest to it). The simplex is cut into simplicial cells; on each, the regret of
*every* decision that is optimal for one of its beliefs is bounded from below by optimal costs at the corners and on the rays
to them, for quadratic costs and growth by optimal decisions. A tiny linear programme then bounds the privacy there. Cells
with a bound above the best known are halved, or cut where a row of C becomes inactive if that alone makes the bound too high.
A cell whose corners share one decision is part of its consistent set, and its bound is the distance of that set. For quadratic
costs and growth a cell is dropped where no belief is the nearest one that explains its decision.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import consistent_beliefs, consistent_sets
from inscrutable.decision_makers.proofs.bounded_cells import BoundedCells, DescribedCells
from inscrutable.decision_makers.proofs.fibres import Fibres
from inscrutable.decision_makers.proofs.growth_cells import GrowthCells, whitened_growth
from inscrutable.decision_makers.proofs.kinks import cuts_at_kinks
from inscrutable.decision_makers.proofs.oracle_points import LEVELS_TRIED, N_LEVELS, OraclePoints
from inscrutable.decision_makers.proofs.quadratic_cells import QuadraticCells, whitened
from inscrutable.decision_makers.proofs.smooth_cells import SmoothCells
from inscrutable.errors import InscrutableError
from inscrutable.geometry.simplicial import cones_from, directions_to, edges, halved
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem, KellyProblem, quadratic_problem
from inscrutable.validation import Array

_MOST_CELLS = 256
"""Most cells halved in a round. With 85, 24 proofs take 3 % fewer calls; with 768, 2 % more; 16 of up to 700 calls do not
differ."""
_NEARLY, _MOST_KINKS = 0.15, 4
"""Share of a cell's gap left without its loss at kinks, below which a cut at a kink is worth while; and such cuts in a row, or
cells become ever thinner. 16 proofs over two to four states take up to 2 % fewer or more calls, and the same time, from 0 to
.6 and from one to eight."""
_EDGE_SHARE = 1.2
"""A cell's edge over 1 − τ, the rest of the ray to it: both errors are then of equal size. With half of it, the one of
these 16 proofs that stays open ends 5 % higher; with twice as much, none differs."""
_ATTEMPTS = 3  # a limit against endless repetition: none of 124 proofs takes a second one
_JUDGED_SLOWLY = 2
"""Points whose decisions are judged in one round where consistent beliefs take cutting planes: with six, four proofs take 1.8
times as long, with 64, 6.9 times. Elsewhere all points are judged: with 64, one of 62 lotteries is 11 % less private, with 21
two more are, by up to 74 %, in .9 of the time."""


class Question(NamedTuple):
    """Largest Ψ under a budget, or largest Ψ − multiplier · regret, if above `floor`."""

    reference: Reference
    budget: float
    multiplier: float | None
    floor: float
    judged: frozenset[int] = frozenset()
    """Points whose decisions are known; with a multiplier, any other point above the floor ends the search."""


@dataclass(frozen=True, eq=False)
class Answer:
    """No decision has a larger value than `bound`; `complete` where no cell is above the floor."""

    bound: float
    complete: bool


class Prover:
    """Branch and bound for one problem, belief and reference; cells and the oracle's values are kept for the next question."""

    def __init__(self, problem: DecisionProblem, belief: Array, most_calls: int) -> None:
        self._asked = problem
        self._stated = problem if isinstance(problem, KellyProblem) else quadratic_problem(problem)
        if self._stated is not None:
            # Copies of a coordinate change no privacy and no cost, but leave decisions tied.
            problem = self._stated.without_copies
        problem = self.problem = problem.without_common_costs
        self.belief = belief
        self.most_calls = most_calls
        cones = cones_from(belief)
        self.points = OraclePoints(problem, belief, cones.points[1:])
        self._cones = cones.corners
        self._shared = np.zeros((0, belief.size + 1))  # state costs of shared decisions, and their privacies
        self._privacies = np.zeros(0)
        self._exact = np.zeros(0, dtype=np.bool_)
        self._leaves: BoundedCells | None = None
        self._allowance = 0.0
        self._smooth = _smooth_cells(problem, self.points)
        self._most_judged = _JUDGED_SLOWLY if problem.smooth_form() is None else None
        self._fibres = None if self._smooth is None else Fibres(self._smooth)

    def action(self, index: int) -> Array:
        """Return the decision (U,) at a point."""
        found, form = self.points.actions[index], self._asked.quadratic_form()
        if self._stated is not None:
            found = self._stated.with_copies(found)
        return found if form is None else form.decisions(found)

    def answer(self, question: Question) -> Answer:
        """Return a bound for one question; repeated where the solver's error proved larger than assumed."""
        for _ in range(_ATTEMPTS):
            if self._leaves is None or self.points.allowance > 2.0 * self._allowance:
                self._allowance = self.points.allowance
                self._leaves = self._described(self._cones, np.zeros(len(self._cones), dtype=np.intp), question)
            found = self._search(question)
            if self.points.allowance <= 2.0 * self._allowance:
                return found
        return Answer(float("inf"), False)

    def _search(self, question: Question) -> Answer:
        leaves = self._leaves
        assert leaves is not None
        leaves.ask(question.budget, question.multiplier)
        while True:
            worst = leaves.worst_open(question.floor, _MOST_CELLS)
            over = not worst.size or self.points.calls >= self.most_calls
            if over or (question.multiplier is not None and self.better(question).size):
                bound = leaves.largest()
                return Answer(bound, bound <= question.floor)
            gap = leaves.bounds[worst] - question.floor
            nearly = leaves.without_loss(worst) - question.floor <= _NEARLY * gap
            fresh = self._described(*self._halved(leaves.cells.pick(worst), nearly), question)
            # The bound of a cell holds for its parts.
            kept = np.ones(len(leaves.bounds), dtype=np.bool_)
            kept[worst] = False
            leaves.keep(np.flatnonzero(kept))
            leaves.take(fresh)

    def better(self, question: Question) -> np.ndarray:
        """Return the points above the floor with admissible decisions, the best first, without those known already."""
        self._look(question.reference)
        spent = self.points.costs @ self.belief - self.points.optimal_cost
        spent = (
            np.where(spent <= question.budget, 0.0, np.inf)
            if question.multiplier is None
            else question.multiplier * spent
        )
        above = self._privacies - spent - question.floor
        above[list(question.judged)] = -np.inf
        ask = np.flatnonzero((above > tolerances.CHORD) & ~self._exact)
        ask = ask[np.argsort(-above[ask], kind="stable")[: self._most_judged]]
        if ask.size:
            self._privacies[ask], self._exact[ask] = self._judged(ask, question.reference), True
            above[ask] = self._privacies[ask] - spent[ask] - question.floor
        found = np.flatnonzero((above > tolerances.CHORD) & self._exact)
        return np.asarray(found[np.argsort(-above[found], kind="stable")])

    def _look(self, reference: Reference) -> None:
        """Give new points an upper bound of the privacy, exact where it is cheap to compute."""
        fresh = np.arange(len(self._privacies), len(self.points.values))
        if reference.sign > 0 and self._fibres is not None:
            seen = self._fibres.distances(fresh)
        else:
            seen = reference.sign * np.linalg.norm(self.points.beliefs[fresh] - reference.point, axis=1)
        self._privacies = np.concatenate([self._privacies, seen])
        self._exact = np.concatenate([self._exact, np.zeros(len(fresh), dtype=np.bool_)])

    def _judged(self, index: np.ndarray, reference: Reference) -> Array:
        """The privacies of points' decisions, −∞ for those that are not admissible."""
        actions, beliefs = self.points.actions[index], self.points.beliefs[index]
        distances = consistent_sets(self.problem, actions, beliefs).distances(reference.point)
        usable = self.problem.is_admissible(actions) & np.isfinite(distances)
        return np.where(usable, reference.sign * np.where(usable, distances, 0.0), -np.inf)

    def _halved(self, cells: DescribedCells, nearly: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cut cells along a long edge on which V is curved, or at a kink if a cell is `nearly` done without its loss there."""
        corners, kinks = cells.corners, cells.kinks
        pairs = edges(corners.shape[1])
        points, costs = self.points.beliefs[corners], self.points.costs[corners]
        ways = points[:, pairs[:, 1]] - points[:, pairs[:, 0]]
        curvatures = np.maximum(((costs[:, pairs[:, 0]] - costs[:, pairs[:, 1]]) * ways).sum(axis=2), 0.0)
        lengths = (ways * ways).sum(axis=2)
        shares = [part / np.maximum(part.sum(axis=1, keepdims=True), tolerances.TINY) for part in (curvatures, lengths)]
        edge, share = (np.sqrt(shares[0]) + np.sqrt(shares[1])).argmax(axis=1), np.full(len(corners), 0.5)
        if self._smooth is not None:
            cuts = cuts_at_kinks(self._smooth, corners, pairs)
            at_kink = cuts.at_kink & nearly & (kinks < _MOST_KINKS)
            edge, share, kinks = (
                np.where(at_kink, *either) for either in ((cuts.edge, edge), (cuts.share, share), (kinks + 1, 0))
            )
        chosen = pairs[edge]
        made = self.points.between(corners[np.arange(len(corners))[:, None], chosen], share)
        return halved(corners, chosen, made), np.tile(kinks, 2)

    def _described(self, corners: np.ndarray, kinks: np.ndarray, question: Question) -> BoundedCells:
        """Bounds of gains and regrets on cells, without cells that can be dropped."""
        outside = question.reference.sign > 0
        points = self.points.beliefs[corners]
        near, lost = None, np.zeros(len(corners))
        if self._smooth is None:
            regrets = self._by_values(corners)
        else:
            near = self._smooth.nearness(corners)
            regrets = self._smooth.regret_bounds(corners, near)
            lost = np.where(np.isfinite(near.near), near.regrets.max(axis=1), 0.0)
            if not self._smooth.is_strictly_convex:
                blind = np.flatnonzero(self._smooth.is_blind(regrets, near))
                values = np.zeros((*corners.shape, LEVELS_TRIED * corners.shape[1]))
                values[blind] = self._by_values(corners[blind])
                regrets = np.concatenate([regrets, values], axis=2)
        single = np.full(len(corners), self.problem.costs_are_unique)
        if near is not None:
            single |= np.isfinite(near.near)
        gains = _gains(points, question.reference)
        cells = BoundedCells(DescribedCells(corners, gains, regrets, self._tiny(points), lost, kinks))
        cells.ask(question.budget, question.multiplier)
        alive = cells.above(question.floor)
        if outside and self._fibres is not None and near is not None and alive.size:
            empty = self._fibres.passes(corners[alive], near.pick(alive))
            kept = np.ones(len(corners), dtype=np.bool_)
            kept[alive[empty]] = False
            cells.keep(np.flatnonzero(kept))
            single = single[kept]
        if outside:
            self._close_shared(cells, single)
        return cells

    def _tiny(self, points: Array) -> np.ndarray:
        """Which cells (C,X,X) are too small to cut."""
        return np.asarray((points.max(axis=1) - points.min(axis=1)).max(axis=1) <= tolerances.FINEST_CELL)

    def _by_values(self, corners: np.ndarray) -> Array:
        """Bounds of the regret by optimal costs alone."""
        points, pairs = self.points.beliefs[corners], edges(corners.shape[1])
        longest = np.linalg.norm(points[:, pairs[:, 0]] - points[:, pairs[:, 1]], axis=2).max(axis=1)
        farthest = np.linalg.norm(points - self.belief, axis=2).max(axis=1)
        levels = np.clip(np.rint(-np.log2(_EDGE_SHARE * longest / farthest)), 1, N_LEVELS - 1).astype(np.intp)
        self.points.look_on_the_way(corners, levels)
        return self.points.regret_bounds(corners, levels, self.points.upper_costs(corners))

    def _close_shared(self, bounded: BoundedCells, single: np.ndarray) -> None:
        """Close cells whose corners share one decision with its privacy, where beliefs have a `single` decision (C,)."""
        if not single.any():
            return
        corners = bounded.cells.corners
        upper = self.points.upper_costs(corners)
        slack = tolerances.SHARED_DECISION * self.points.scale
        if self.points.rounding > slack:  # costs do not distinguish decisions
            for cell in np.flatnonzero(single & self._is_one_decision):
                bounded.close(int(cell), 0.0, 0.0)
            return
        optimal = (upper <= self.points.values[corners][:, :, None] + slack).all(axis=1)
        width = np.abs(self.points.beliefs[corners] - self.points.beliefs[corners[:, :1]]).max(axis=(1, 2))
        for cell in np.flatnonzero(single & optimal.any(axis=1) & (width >= tolerances.SHARED_WIDTH)):
            costs = self.points.costs[corners[cell, optimal[cell].argmax()]]
            regret = float(costs @ self.belief) - self.points.optimal_cost - self.points.allowance
            bounded.close(int(cell), self._distance(costs, corners[cell]), max(regret, 0.0))

    @property
    def _is_one_decision(self) -> bool:
        """Whether the corners of the simplex share one decision, which every belief then explains."""
        actions = self.points.actions[np.unique(self._cones)]
        return bool((np.abs(actions - actions[0]) <= tolerances.SAME_ACTION).all())

    def _distance(self, costs: Array, corners: np.ndarray) -> float:
        """An upper bound of the distance to the beliefs for which a decision of these state costs is optimal."""
        apart = np.abs(self._shared[:, :-1] - costs).max(axis=1)
        known = np.flatnonzero(apart <= tolerances.SHARED_DECISION * self.points.scale)
        if known.size:
            return float(self._shared[known[0], -1])
        start = self.points.beliefs[corners]
        start = start[np.linalg.norm(start - self.belief, axis=1).argmin()]
        nearest = self._nearest(start)
        values, _ = self.points.ask(nearest[None])
        is_member = values[0] >= nearest @ costs - tolerances.SHARED_DECISION * self.points.scale
        distance = float(np.linalg.norm((nearest if is_member else start) - self.belief))
        self._shared = np.vstack([self._shared, np.append(costs, distance)])
        return distance

    def _nearest(self, member: Array) -> Array:
        """About the nearest belief of the consistent set of the decision at `member`; the oracle checks it."""
        try:
            found = consistent_beliefs(self.problem, self.problem.solve(member)).nearest(self.belief)
        except InscrutableError:
            return member
        return np.asarray(found) if np.isfinite(found).all() else member


def _smooth_cells(problem: DecisionProblem, points: OraclePoints) -> SmoothCells | None:
    """Bounds between corners, where costs give their curvature."""
    quadratic = quadratic_problem(problem)
    if quadratic is not None:
        form = whitened(quadratic)
        return None if form is None else QuadraticCells(quadratic, points, form)
    if isinstance(problem, KellyProblem):
        form = whitened_growth(problem)
        return None if form is None else GrowthCells(problem, points, form)
    return None


def _gains(points: Array, reference: Reference) -> Array:
    """Privacy at the corners (C,X) of a function above the privacy and linear on each cell."""
    if reference.sign > 0:
        # The distance is convex: below the interpolation of its corners.
        return np.asarray(np.linalg.norm(points - reference.point, axis=2))
    directions = directions_to(reference.point, points)
    return np.asarray(-np.einsum("cjx,cx->cj", points - reference.point, directions))
