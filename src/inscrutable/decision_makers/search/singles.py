"""Single decisions for many beliefs over three states, under one budget or several, in the plane of beliefs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.consistent_sets import consistent_sets
from inscrutable.decision_makers.result_table import ResultTable
from inscrutable.decision_makers.results import Decisions, DecisionStatus, Progress
from inscrutable.decision_makers.search.atlas import Atlas
from inscrutable.decision_makers.search.face_search import Found, most_private, rules_for, within
from inscrutable.decision_makers.search.in_plane import singles_in_plane
from inscrutable.decision_makers.search.plane import plane_of
from inscrutable.decision_makers.search.streaming import (
    OWN,
    TARGET,
    Aims,
    decisions_at,
    farthest_corners,
    scene_of,
)
from inscrutable.kernels.climb import Aim
from inscrutable.kernels.prices import budget_price
from inscrutable.kernels.three_leaves import Plane, Scene
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_BLOCK = 1 << 16
_KEPT = -5
_NEAR = 4.0  # spacings of candidates that a decision is from the belief: then it is searched by faces as well
_WELL_COVERED = 0.03
"""Distance between neighbouring candidates up to which the faces without one do not matter."""


@dataclass(frozen=True, eq=False)
class Singles:
    """The best decisions of T beliefs under B budgets; `index` says which decision of the atlas, or that it was polished."""

    atlas: Atlas
    aims: Aims
    optimal_costs: Array  # (T,)
    index: np.ndarray  # (T,B)
    face: np.ndarray  # (T,B)
    decoy: Array  # (T,B,X)
    regret: Array  # (T,B)
    privacy: Array  # (T,B)
    price: Array  # (T,B) derivative of the privacy in the budget
    kept: dict[tuple[int, int], Array]  # decisions on faces that the atlas may not have

    @property
    def problem(self) -> DecisionProblem:
        """The decision problem."""
        return self.atlas.asked

    def actions(self, budget: int, rows: Any) -> Array:
        """Return the decision of a row, (1,U), or of some, (n,1,U), under one of the budgets."""
        index, face = self.index[rows, budget], self.face[rows, budget].reshape(-1)
        decoys = self.decoy[rows, budget].reshape(-1, self.decoy.shape[-1])
        found = decisions_at(self.atlas, index.reshape(-1), face, decoys)
        if self.kept:
            steps = np.arange(len(self.index))[rows].reshape(-1)
            for i in np.flatnonzero(index.reshape(-1) == _KEPT):
                found[i] = self.kept[int(steps[i]), budget]
        return self.atlas.decisions(found).reshape(*index.shape, 1, self.problem.n_actions)


def stream_singles(atlas: Atlas, beliefs: Array, aims: Aims, *, progress: Progress | None = None) -> Singles | None:
    """Return the most private decisions of beliefs (T,X) under each of the budgets.

    None where there is no plane, or where candidates are so far apart that a face may have none: then each belief is
    searched by itself, from face to face.

    Cost: one look at the leaves of candidates a belief, and a few climbs a budget; memory besides the result is that of
    a block.
    """
    plane = plane_of(atlas)
    if plane is None or not plane.spacing[0] <= _WELL_COVERED:
        return None
    count, n_states = beliefs.shape
    shape = (count, len(aims.budgets))
    result = Singles(
        atlas, aims, np.empty(count), np.empty(shape, dtype=np.int64), np.empty(shape, dtype=np.int64),
        np.empty((*shape, n_states)), np.empty(shape), np.empty(shape), np.empty(shape), {},
    )  # fmt: skip
    for first in range(0, count, _BLOCK):
        part = slice(first, min(first + _BLOCK, count))
        seen = None if progress is None else partial(_report, progress, first, count)
        _fill(result, plane, beliefs, part, seen)
    return result


def _report(progress: Progress, before: int, count: int, done: int, _: int) -> None:
    progress(before + done, count)


def _fill(result: Singles, plane: Plane, beliefs: Array, part: slice, progress: Progress | None) -> None:
    problem = result.atlas.problem
    held = np.ascontiguousarray(beliefs[part])
    aims = result.aims._replace(points=result.aims.points[part])
    scene = scene_of(problem, held, aims)
    if aims.sign < 0:
        scene = scene._replace(first_privacies=-_distances_at_rest(problem, held, scene.points))
    out = tuple(getattr(result, name)[part] for name in ("index", "face", "decoy", "regret", "privacy", "price"))
    singles_in_plane(plane, scene, out, progress)
    result.optimal_costs[part] = scene.optimal_costs
    index, face, decoy, regret, privacy, price = out
    met = index == TARGET
    if met.any():
        decoy[met] = np.broadcast_to(scene.points[:, None], decoy.shape)[met]
    _search_the_near(result, plane, part, scene)
    at_rest = index == OWN
    if aims.sign > 0:
        at_rest |= privacy <= tolerances.NO_PRIVACY
    if at_rest.any():
        decoy[at_rest] = np.broadcast_to(held[:, None], decoy.shape)[at_rest]
        index[at_rest], face[at_rest], regret[at_rest], price[at_rest] = OWN, -1, 0.0, 0.0
        privacy[at_rest] = np.broadcast_to(scene.first_privacies[:, None], privacy.shape)[at_rest]


def _search_the_near(result: Singles, plane: Plane, part: slice, scene: Scene) -> None:
    """Search by faces where a budget buys so little that hardly a candidate is affordable."""
    atlas, problem = result.atlas, result.atlas.problem
    apart = result.decoy[part] - scene.beliefs[:, None]
    close = np.einsum("tbx,tbx->tb", apart, apart) < (_NEAR * plane.spacing[0]) ** 2
    # So is one whose climb did not end: a candidate that stayed as it was.
    stuck = (result.index[part] >= 0) & (atlas.arena.size[result.face[part]] > 0)
    close = (close | stuck | (result.index[part] == OWN)) & (scene.limits > 0.0)
    for t, b in np.argwhere(close) if close.any() else ():
        step, belief = part.start + int(t), scene.beliefs[t]
        aim = Aim(belief, scene.points[t], scene.sign, float(scene.optimal_costs[t]), float(scene.limits[t, b]), 0.0)
        found = most_private(atlas, aim, problem.solve(belief))
        if found is None or found.privacy <= result.privacy[step, b]:
            continue
        regret = float(problem.state_costs(found.action) @ belief) - aim.optimal_cost
        result.privacy[step, b], result.regret[step, b] = found.privacy, max(regret, 0.0)
        result.index[step, b], result.face[step, b], result.decoy[step, b] = _KEPT, -1, found.nearest
        result.price[step, b], result.kept[step, int(b)] = price_of(found, aim), found.action


def _distances_at_rest(problem: DecisionProblem, beliefs: Array, points: Array) -> Array:
    """Distances of points (T,X) from the beliefs that explain the optimal decisions of beliefs (T,X)."""
    sets = consistent_sets(problem, problem.solve(beliefs), beliefs)
    start, along = sets.start, sets.end - sets.start
    square = (along**2).sum(axis=1)
    share = np.clip(((points - start) * along).sum(axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    found = np.linalg.norm(points - start - share[:, None] * along, axis=1)
    for step in np.flatnonzero(sets.dimension > 1):
        found[step] = sets[int(step)].distance(points[step])
    return np.asarray(found)


def price_of(found: Found, aim: Aim) -> float:
    """Return the derivative of the best privacy in the budget at a decision found by belief."""
    face, place = found.face, np.append(found.place, 1.0)
    return float(
        budget_price(
            face.curves, face.rows, face.n_set_rows, face.scale, within(aim), rules_for(aim.belief.size),
            tolerances.ROW_IN_REACH, found.nearest, place,
        )
    )  # fmt: skip


_KINDS = np.array([DecisionStatus.POLISHED, DecisionStatus.NO_AFFORDABLE_PRIVACY, DecisionStatus.OPTIMAL], dtype=object)


def decisions_of(found: Singles, budget: int = 0) -> Decisions:
    """Return what was found under one of the budgets as a result."""
    points, sign = found.aims.points, found.aims.sign
    codes = np.where(found.index[:, budget] == OWN, 1 if sign > 0 else 2, 0)
    return Decisions(
        ResultTable(
            found.problem,
            partial(found.actions, budget),
            np.ones((len(codes), 1)),
            found.regret[:, budget, None],
            found.privacy[:, budget, None],
            found.decoy[:, budget, None].copy(),  # decisions are made from those that are kept
            found.optimal_costs,
            farthest_corners(points) if sign > 0 else np.zeros(len(codes)),
            tuple(_KINDS[codes]),
            found.price[:, budget],
        )
    )
