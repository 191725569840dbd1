"""Single decisions for many beliefs and budgets: the streaming search, and the search by belief where it meets a face
that has no candidate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.decision_makers.atlas import Atlas
from inscrutable.decision_makers.books import numbers_of
from inscrutable.decision_makers.face_search import Found, most_private, rules_for, within
from inscrutable.decision_makers.results import Decisions, DecisionStatus, Progress
from inscrutable.kernels.climb import Aim
from inscrutable.kernels.faces import settle
from inscrutable.kernels.prices import budget_price
from inscrutable.kernels.singles import UNKNOWN, Numbers, Outcome, Path, search_singles
from inscrutable.kernels.threads import in_chunks
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_CHUNK = 64
_BLOCK = 1 << 15
_PROMISE = 1.15
_FEW = 100.0
"""As in the search by belief: a climb's usual gain, and how many affordable candidates a state are few."""


class SoughtSingles(NamedTuple):
    """What is to be hidden, from or toward which point, and the optimal decisions."""

    beliefs: Array  # (T,X)
    points: Array  # (T,X)
    sign: float
    optimal_costs: Array  # (T,)
    own: np.ndarray  # (T,) face of the optimal decision, −1: not in the atlas


@dataclass(frozen=True, eq=False)
class Singles:
    """The best decisions of T beliefs under B budgets; where nothing is better than the optimal one, `face` is −1."""

    atlas: Atlas
    sought: SoughtSingles
    privacy: Array  # (T,B)
    regret: Array  # (T,B)
    face: np.ndarray  # (T,B)
    decoy: Array  # (T,B,X)
    price: Array  # (T,B) derivative of the privacy in the budget
    kept: dict[tuple[int, int], Array]  # decisions on faces that the atlas does not have

    @property
    def is_optimal(self) -> np.ndarray:
        """Where the optimal decision is played, (T,B)."""
        return np.asarray(self.face == _OWN)

    def actions(self, step: int | slice, budget: int) -> Array:
        """Return the decision of one step, (U,), or of many, (T,U), under one of the budgets."""
        steps = np.arange(len(self.face))[step]
        found = self._made(np.atleast_1d(steps), budget)
        return found if steps.ndim else found[0]

    def _made(self, steps: np.ndarray, budget: int) -> Array:
        problem, face = self.atlas.problem, self.face[steps, budget]
        made = np.empty((len(steps), problem.n_actions))
        own = face == _OWN
        if own.any():
            made[own] = problem.solve(self.sought.beliefs[steps[own]])
        for i in np.flatnonzero(face == _KEPT):
            made[i] = self.kept[int(steps[i]), budget]
        for number in np.unique(face[face >= 0]):
            self._settle(int(number), face, self.decoy[steps, budget], made)
        return made

    def _settle(self, number: int, face: np.ndarray, decoys: Array, made: Array) -> None:
        programme = self.atlas.faces(self.atlas.patterns[number])
        k = programme.span.shape[1]
        w, factor, room = np.empty(k + 1), np.empty((k, k)), np.empty((2, decoys.shape[1], k))
        for i in np.flatnonzero(face == number):
            settle(programme.curves, decoys[i], tolerances.PIVOT, w, factor, room[0], room[1])
            made[i] = programme.action(w[:-1])


_OWN, _KEPT = -1, -2


@dataclass(frozen=True, eq=False)
class UnderBudget:
    """The decisions of one of the budgets, as results keep them."""

    singles: Singles
    budget: int = 0

    @property
    def problem(self) -> DecisionProblem:
        """The decision problem."""
        return self.singles.atlas.problem

    def actions(self, step: int | slice) -> Array:
        """Return the decisions of a step or of many."""
        return self.singles.actions(step, self.budget)


def seek(atlas: Atlas, beliefs: Array, points: Array, sign: float) -> SoughtSingles:
    """Return what `stream_singles` starts from, with the optimal decisions of beliefs (T,X), block by block."""
    problem, count = atlas.problem, len(beliefs)
    costs, own = np.empty(count), np.empty(count, dtype=np.int64)
    for first in range(0, count, _BLOCK):
        part = slice(first, first + _BLOCK)
        actions = problem.solve(beliefs[part])
        costs[part] = (problem.state_costs(actions) * beliefs[part]).sum(axis=1)
        own[part] = numbers_of(problem.constraints.tight_rows(actions), atlas.patterns)
    return SoughtSingles(beliefs, points, sign, costs, own)


def stream_singles(atlas: Atlas, sought: SoughtSingles, limits: Array, *, progress: Progress | None = None) -> Singles:
    """Return the most private decisions of beliefs (T,X) under budgets `limits` (T,B), largest regrets.

    Cost: one look at the leaves of candidates a belief, and a few climbs a budget; memory besides the result is that of
    a block. Numbers do not hang on how many threads there are.
    """
    count, n_budgets = limits.shape
    shape, n_states = (count, n_budgets), sought.beliefs.shape[1]
    result = Singles(
        atlas, sought, np.empty(shape), np.empty(shape), np.empty(shape, dtype=np.int64), np.empty((*shape, n_states)),
        np.empty(shape), {},
    )  # fmt: skip
    for first in range(0, count, _BLOCK):
        part = slice(first, min(first + _BLOCK, count))
        _fill(result, part, limits[part], None if progress is None else partial(_report, progress, first, count))
    return result


def _report(progress: Progress, before: int, count: int, done: int, _: int) -> None:
    progress(before + done, count)


def _fill(result: Singles, part: slice, limits: Array, progress: Progress | None) -> None:
    atlas, sought = result.atlas, result.sought
    count, n_states = len(limits), sought.beliefs.shape[1]
    book, arena, rules = atlas.book, atlas.arena, rules_for(n_states)
    path = Path(
        np.ascontiguousarray(sought.beliefs[part]), np.ascontiguousarray(sought.points[part]), sought.sign,
        sought.optimal_costs[part], sought.own[part], np.ascontiguousarray(limits),
    )  # fmt: skip
    out = Outcome(
        result.privacy[part], result.regret[part], result.face[part], result.decoy[part], result.price[part],
        np.empty(limits.shape, dtype=np.int64), np.full(count, 0.0 if sought.sign > 0 else np.nan),
    )  # fmt: skip
    margin = float(np.median(book.radius)) if len(book.radius) else 0.0
    numbers = Numbers(_PROMISE, margin, tolerances.ROW_IN_REACH, _FEW, tolerances.POLISH)

    def work(low: int, high: int) -> None:
        search_singles(low, high, path, book, arena, rules, numbers, out)

    in_chunks(work, count, _CHUNK, progress)
    for t, b in np.argwhere(out.state == UNKNOWN):
        _search_alone(result, part.start + int(t), int(b), float(limits[t, b]))
    _compare_with_optimal(result, part, out)


def _search_alone(result: Singles, t: int, b: int, limit: float) -> None:
    """The search by belief, on any face; what it finds replaces what the streaming search has."""
    atlas, sought = result.atlas, result.sought
    belief = sought.beliefs[t]
    aim = Aim(belief, sought.points[t], sought.sign, float(sought.optimal_costs[t]), limit, 0.0)
    found: Found | None = most_private(atlas, aim, atlas.problem.solve(belief))
    if found is None or found.privacy <= result.privacy[t, b]:
        return
    cost = float(atlas.problem.state_costs(found.action) @ belief)
    result.privacy[t, b], result.regret[t, b] = found.privacy, max(cost - aim.optimal_cost, 0.0)
    result.face[t, b], result.decoy[t, b] = _KEPT, found.nearest
    result.price[t, b] = price_of(found, aim)
    result.kept[t, b] = found.action


def _compare_with_optimal(result: Singles, part: slice, out: Outcome) -> None:
    """Play the optimal decision where nothing found is better."""
    at_rest = out.at_rest.copy()
    sought, atlas = result.sought, result.atlas
    for t in np.flatnonzero(np.isnan(at_rest)):
        optimal = atlas.problem.solve(sought.beliefs[part.start + t])
        at_rest[t] = -belief_set_of(atlas.problem, optimal).distance(sought.points[part.start + t])
    least = at_rest + (tolerances.NO_PRIVACY if sought.sign > 0 else 0.0)
    own = ~(out.privacy > least[:, None])
    out.privacy[own] = np.broadcast_to(at_rest[:, None], own.shape)[own]
    out.regret[own], out.price[own], out.face[own] = 0.0, 0.0, _OWN
    out.decoy[own] = np.broadcast_to(sought.beliefs[part][:, None], out.decoy.shape)[own]


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
    sought, privacy, regret = found.sought, found.privacy[:, budget], found.regret[:, budget]
    bounds, points = np.zeros(len(privacy)), sought.points
    if sought.sign > 0:
        # The farthest corner of the simplex: ‖π − e_i‖² = ‖π‖² − 2 π_i + 1.
        bounds = np.sqrt(np.einsum("ti,ti->t", points, points) - 2.0 * points.min(axis=1) + 1.0)
    codes = np.where(found.is_optimal[:, budget], 1 if sought.sign > 0 else 2, 0)
    return Decisions(
        sought.optimal_costs + regret,
        sought.optimal_costs,
        regret,
        privacy,
        np.maximum(bounds, privacy),
        found.decoy[:, budget],
        tuple(_KINDS[codes]),
        UnderBudget(found, budget),
        found.price[:, budget],
    )
