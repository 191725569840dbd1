"""Lotteries for many beliefs: one streaming pass over the candidates, block by block, in memory that does not grow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.budgets import Budget
from inscrutable.decision_makers.results import Decisions, Progress
from inscrutable.decision_makers.search.atlas import Atlas
from inscrutable.decision_makers.search.face_search import rules_for
from inscrutable.decision_makers.search.in_plane import lotteries_in_plane
from inscrutable.decision_makers.search.plane import plane_of
from inscrutable.kernels.lotteries import FIRST_SEED, search_lotteries
from inscrutable.kernels.lottery_polish import POLISHED, polish_lotteries
from inscrutable.kernels.threads import in_chunks
from inscrutable.kernels.three_leaves import Scene
from inscrutable.problems import DecisionProblem, QuadraticProblem
from inscrutable.validation import Array

_CHUNK = 256
_ROUNDS = np.array([12, 16])  # of a climb, and of the golden sections on a line
_BLOCK = 1 << 16
_FIELDS = ("index", "face", "decoys", "regrets", "privacies", "probabilities", "prices")
OWN, TARGET, KNOWN = FIRST_SEED, FIRST_SEED - 1, FIRST_SEED - 2
"""Names of points that are no candidates: the optimal decision, the target's, and the best single one."""


@dataclass(frozen=True, eq=False)
class Lotteries:
    """Two atoms for each of T beliefs; `index` says which decision of the atlas an atom is, or that it was polished."""

    atlas: Atlas
    beliefs: Array  # (T,X)
    optimal_costs: Array  # (T,)
    limits: Array  # (T,)
    index: np.ndarray  # (T,2)
    face: np.ndarray  # (T,2)
    decoys: Array  # (T,2,X)
    regrets: Array  # (T,2)
    privacies: Array  # (T,2)
    probabilities: Array  # (T,2)
    prices: Array  # (T,)
    singles: Decisions | None = None  # the best single decisions, atoms named KNOWN

    @property
    def problem(self) -> DecisionProblem:
        """The decision problem."""
        return self.atlas.asked

    def actions(self, step: Any) -> Array:
        """Return the atoms of one step, shape (2,U), or of many, shape (n,2,U)."""
        index, face, decoys = self.index[step], self.face[step], self.decoys[step]
        flat = (index.reshape(-1), face.reshape(-1), decoys.reshape(-1, decoys.shape[-1]))
        found = self.atlas.decisions(decisions_at(self.atlas, *flat)).reshape(*index.shape, self.problem.n_actions)
        known = index == KNOWN
        if known.any():
            assert self.singles is not None
            found[known] = np.broadcast_to(self.singles.table.points_at(step), found.shape)[known]
        return found

    def take(self, steps: np.ndarray, other: Lotteries) -> None:
        """Put another search's lotteries of some steps in the place of these."""
        for name in _FIELDS:
            getattr(self, name)[steps] = getattr(other, name)[steps]


def decisions_at(atlas: Atlas, index: np.ndarray, face: np.ndarray, decoys: Array) -> Array:
    """Return decisions (n,U) from what is kept of them: the atlas's own, optimal ones of decoys, or of faces at decoys."""
    actions = np.zeros((len(index), atlas.problem.n_actions))
    polished = index == POLISHED
    if not polished.all():
        known = index >= 0
        actions[known] = atlas.actions[index[known]]
        own = (index == OWN) | (index == TARGET)
        if own.any():
            actions[own] = atlas.problem.solve(decoys[own])
    for i in polished.nonzero()[0]:
        atlas.faces(atlas.patterns[face[i]]).fill_decision(decoys[i], actions[i])
    return actions


class Aims(NamedTuple):
    """What the lotteries of a path seek: distance from points (T,X) (sign +) or nearness to them (−), within budgets."""

    points: Array
    sign: float
    budgets: tuple[Budget, ...]


def stream_lotteries(
    atlas: Atlas, beliefs: Array, aims: Aims, *, singles: Decisions | None = None, progress: Progress | None = None
) -> Lotteries:
    """Return the lotteries of beliefs (T,X), each searched by itself.

    The optimal decision takes part with the least privacy it can have; `singles`, the best single decisions of the same
    beliefs, with their own: no lottery is then worse.
    """
    count, n_states = beliefs.shape
    pairs = (count, 2)
    result = Lotteries(
        atlas,
        beliefs,
        np.empty(count),
        np.empty(count),
        np.empty(pairs, dtype=np.int64),
        np.empty(pairs, dtype=np.int64),
        np.empty((*pairs, n_states)),
        np.empty(pairs),
        np.empty(pairs),
        np.empty(pairs),
        np.empty(count),
        singles,
    )
    for first in range(0, count, _BLOCK):
        part = slice(first, min(first + _BLOCK, count))
        seen = None if progress is None else partial(_report, progress, first, count)
        _fill(result, part, aims._replace(points=aims.points[part]), seen)
    places = {OWN: beliefs, TARGET: aims.points} | ({} if singles is None else {KNOWN: singles.decoy})
    for name, decoys in places.items():
        chosen = result.index == name
        if chosen.any():
            result.decoys[chosen] = np.broadcast_to(decoys[:, None], result.decoys.shape)[chosen]
    alone = result.probabilities[:, 1] <= 0.0
    for values in (result.index, result.face, result.decoys, result.regrets, result.privacies):
        values[alone, 1] = values[alone, 0]
    return result


def _report(progress: Progress, before: int, count: int, done: int, _: int) -> None:
    progress(before + done, count)


def _fill(result: Lotteries, part: slice, aims: Aims, progress: Progress | None) -> None:
    atlas, singles = result.atlas, result.singles
    costs = None if singles is None else singles.optimal_cost[part]
    scene = scene_of(atlas.problem, np.ascontiguousarray(result.beliefs[part]), aims, costs)
    if singles is not None:
        regrets = np.minimum(singles.regret[part], scene.limits[:, 0])
        scene = scene._replace(first=KNOWN, first_regrets=regrets, first_privacies=singles.privacy[part])
    result.optimal_costs[part], result.limits[part] = scene.optimal_costs, scene.limits[:, 0]
    search(atlas, scene, tuple(getattr(result, name)[part, None] for name in _FIELDS), progress)


def search(atlas: Atlas, scene: Scene, out: tuple[Array, ...], progress: Progress | None = None) -> None:
    """Fill the lotteries of all beliefs and budgets: three states in their plane; the general search for what that leaves.

    out: the fields of `Lotteries`, each for every budget, (T,B,…).
    """
    plane = plane_of(atlas)
    left = np.ones(scene.limits.shape, np.bool_)
    if plane is not None:
        left = lotteries_in_plane(plane, scene, out, progress)
    for budget in range(left.shape[1]):
        steps = left[:, budget].nonzero()[0]
        if len(steps):
            some = Scene._make(field[steps] if isinstance(field, np.ndarray) else field for field in scene)
            found = tuple(np.empty_like(field[steps, budget]) for field in out)
            _search_generally(atlas, some._replace(limits=some.limits[:, budget]), found, None if plane else progress)
            for field, values in zip(out, found, strict=True):
                field[steps, budget] = values


def farthest_corners(points: Array) -> Array:
    """Return the distances of points (T,X) from the corners of the simplex that are farthest: ‖p‖² − 2 min p_i + 1."""
    least = points[:, 0]
    for column in points.T[1:]:
        least = np.minimum(least, column)
    return np.asarray(np.sqrt(np.einsum("ti,ti->t", points, points) - 2.0 * least + 1.0))


def scene_of(problem: QuadraticProblem, beliefs: Array, aims: Aims, optimal_costs: Array | None = None) -> Scene:
    """Return what the searches of beliefs (T,X) start from; optimal costs are found where they are not given."""
    beliefs, points = np.ascontiguousarray(beliefs), np.ascontiguousarray(aims.points)
    count = len(beliefs)
    costs = _costs_of(problem, beliefs, beliefs)[0] if optimal_costs is None else optimal_costs
    limits = np.empty((count, len(aims.budgets)))
    for column, budget in enumerate(aims.budgets):
        limits[:, column] = budget.limits(costs)
    privacies, target_regrets = np.zeros(count), np.full(count, np.inf)
    if aims.sign < 0:
        privacies = -np.linalg.norm(points - beliefs, axis=1)
        # Nothing is nearer to a target than the decision that the target itself makes optimal.
        costs_there, allowed = _costs_of(problem, points, beliefs)
        target_regrets[allowed] = np.maximum(costs_there - costs, 0.0)[allowed]
    return Scene(beliefs, points, aims.sign, costs, limits, OWN, np.zeros(count), privacies, target_regrets)


def _costs_of(problem: QuadraticProblem, decoys: Array, beliefs: Array) -> tuple[Array, np.ndarray]:
    """Costs (T,) under beliefs (T,X) of the optimal decisions of decoys (T,X), and which of them are admissible."""
    actions = problem.solve_rows(decoys)
    return (problem.state_costs(actions) * beliefs).sum(axis=1), problem.constraints.is_admissible(actions)


def _search_generally(atlas: Atlas, scene: Scene, out: tuple[Array, ...], progress: Progress | None) -> None:
    count = len(scene.beliefs)
    seeds = np.zeros((count, 3, 2))
    seeds[:, :, 1] = -np.inf
    seeds[:, 0, 1] = -np.linalg.norm(scene.points - scene.beliefs, axis=1) if scene.sign < 0 else 0.0
    reached = np.isfinite(scene.target_regrets)
    seeds[reached, 1, 0], seeds[reached, 1, 1] = scene.target_regrets[reached], 0.0
    if scene.first == KNOWN:
        seeds[:, 2, 0], seeds[:, 2, 1] = scene.first_regrets, scene.first_privacies
    scans, arena, rules = atlas.scans, atlas.arena, rules_for(scene.beliefs.shape[1])
    found = (np.empty((count, 3), dtype=np.int64), np.empty((count, 3)), np.empty((count, 3)))
    decoys, face = atlas.table.decoys, atlas.table.face
    given = (scene.beliefs, scene.points, scene.sign, scene.optimal_costs, scene.limits)

    def work(low: int, high: int) -> None:
        search_lotteries(low, high, *given, seeds, scans.table, face, scans.leaves, scans.models, arena, rules,
                         tolerances.CHORD, *found)  # fmt: skip
        polish_lotteries(low, high, *given, decoys, face, arena, rules, tolerances.NEAR_ATOMS, tolerances.CHORD, _ROUNDS, found,
                         out)  # fmt: skip

    in_chunks(work, count, _CHUNK, progress)
