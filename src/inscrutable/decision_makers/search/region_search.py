"""The best decisions of many beliefs, each searched by itself, from critical region to critical region.

A search starts at the best candidates of every region and orthant, and where the budget ends on the rays to those that are too
dear; with more than four states also where climbs along the budget's edge end.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.results import Progress
from inscrutable.decision_makers.search.atlas import Atlas
from inscrutable.decision_makers.search.edge_climbs import edge_decoys
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.kernels.climb import Aim, Rules
from inscrutable.kernels.region_climb import Scene
from inscrutable.kernels.region_search import (
    ENDED,
    NOT_BEGUN,
    Explored,
    Starts,
    Tolerances,
    best_starts,
    read_actions,
    search_regions,
    turn_room,
)
from inscrutable.kernels.regions import Regions
from inscrutable.kernels.threads import in_chunks
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array

_BLOCK = 1024  # beliefs whose searches are kept in memory at once
_CHUNK, _FEW_BELIEFS = 32, 4  # beliefs that a thread takes at a time, to choose starts and to search
_STARTS, _SIGNS = 24, 5  # candidates that a search starts from; directions whose signs make an orthant
"""With 12 starts one of 72 beliefs over six states loses 44 %; with three directions 9 of 144 beliefs over five and six states
with as many assets or fewer lose up to 37 %."""
_MOST_REACHED, _MOST_TRIED = 64, 1024  # regions that a search keeps, and that it may climb
_FEW, _FARTHEST = 100, 1.5
"""Candidates, and more than any two beliefs are apart: where fewer are affordable all starts are climbed. Otherwise 5 of 60
decisions over four states lose up to 44 % at a budget of a hundredth."""
_PAIRS = 4  # beliefs in two states only
_EDGE_STATES = 5
"""Climbs along the edge (20 ms a belief) from so many states on: of 72 beliefs on concentrated markets none is lost without
them at X = 3 and 4, two of X = 5 (up to 6 %) and seven of X = 6 (up to 3 %). Where decisions have fewer free coordinates than
beliefs, pairs do as much: of 1,080 decisions and lotteries there 6 change, by −0.2 % to 7 %, in half the time."""
_RAY_STEPS, _SPARED, _FARTHER = 8, 0.02, 4.0
"""Steps on a ray, the share of the budget that is not spent there, and the longest step. Without them two of 60 beliefs
over two states with budgets of 1e-5 are lost."""
_PATIENCE, _PATIENCE_IN_PLANE = 10, 4
"""Regions whose neighbours are searched in vain before a search ends: with 3, X = 5 loses twice as much; with 4 at a price, 11
of 200 lotteries over four to seven states lose up to 15 %."""


class Best(NamedTuple):
    """The best decision found for each of T beliefs; where there is none its privacy is −∞."""

    actions: Array  # (T,U) in the variables of the problem's quadratic form
    decoys: Array  # (T,X) the consistent belief nearest to the aim's point
    privacies: Array  # (T,)
    regrets: Array  # (T,)
    prices: Array  # (T,) derivative of the privacy in the budget
    regions: np.ndarray  # (T,) where it lies; nothing is said where there is none


@cache
def rules_for(n_states: int) -> Rules:
    """Return the numbers that the kernels decide by."""
    return Rules(
        tolerances.PIVOT,
        tolerances.EXPLAINED,
        tolerances.POLISH**1.5,
        tolerances.RANK,
        tolerances.EXPLAINED,
        tolerances.ON_FACE,
        1.0 - tolerances.BUDGET_SAFETY,
        tolerances.ROW_IN_REACH,
        # A copy for every number of states: kernels would be compiled anew for one that is read-only.
        np.array(sum_zero_basis(n_states), order="C"),
    )


_LIMITS = Tolerances(tolerances.POLISH, tolerances.ROW_IN_REACH, tolerances.STATIONARITY, _PATIENCE)


def best_in_regions(atlas: Atlas, scene: Scene, progress: Progress | None = None) -> Best:
    """Return the best decisions of a scene.

    Cost: one look at all candidates a belief and some dozen climbs; memory besides the result is that of a block.
    """
    count = len(scene.beliefs)
    parts = []
    for first in range(0, count, _BLOCK):
        some = cut(scene, slice(first, min(first + _BLOCK, count)))
        seen = None if progress is None else partial(_report, progress, first, count)
        with atlas.partition.searched(atlas.patterns):
            reached = search(atlas, some, starts_of(atlas, some, _STARTS), seen)
            parts.append(read(atlas, some, reached, np.arange(len(some.beliefs)), values_of(reached).argmax(axis=1)))
    return _on_simplex(Best(*(np.concatenate(columns) for columns in zip(*parts, strict=True))), scene)


def _on_simplex(found: Best, scene: Scene) -> Best:
    """The same with beliefs that left the simplex by a billionth put back: an observer finds them there."""
    for i in np.flatnonzero((found.decoys < -tolerances.EXPLAINED).any(axis=1)):
        found.decoys[i] = np.maximum(found.decoys[i], 0.0) / np.maximum(found.decoys[i], 0.0).sum()
        found.privacies[i] = scene.sign * np.linalg.norm(found.decoys[i] - scene.points[i])
    return found


def values_of(reached: Explored) -> Array:
    """Return the values (T,C) of what was reached; −∞ where there is nothing."""
    return np.where(np.arange(reached.region.shape[1]) < reached.count[:, None], reached.numbers[:, :, 0], -np.inf)


def read(atlas: Atlas, scene: Scene, reached: Explored, steps: np.ndarray, entries: np.ndarray) -> Best:
    """Return some entries (n,) of what beliefs `steps` (n,) reached."""
    privacies = values_of(reached)[steps, entries]
    actions = np.zeros((len(steps), atlas.problem.n_actions))
    found = np.flatnonzero(privacies > -np.inf)
    at, placed = (steps[found], entries[found]), actions[found]
    read_actions(*at, atlas.partition.arrays, _LIMITS, reached, placed)
    actions[found] = placed
    decoys, numbers = np.full((len(steps), scene.beliefs.shape[1]), np.nan), np.zeros((3, len(steps)))
    decoys[found], numbers[:, found] = reached.nearest[at], reached.numbers[at][:, [1, 2, 4]].T
    privacies[found] = numbers[0, found]
    return Best(actions, decoys, privacies, numbers[1], numbers[2], reached.region[steps, entries])


def _report(progress: Progress, before: int, count: int, done: int, _: int) -> None:
    progress(before + done, count)


def cut(scene: Scene, rows: slice | np.ndarray) -> Scene:
    """Return some beliefs of a scene."""
    return Scene._make(field[rows] if isinstance(field, np.ndarray) else field for field in scene)


def search(
    atlas: Atlas, scene: Scene, starts: Starts, progress: Progress | None = None, goes_on: bool = True
) -> Explored:
    """Return what the searches of a block reach from their starts; where it does not go on, in the starts' regions alone."""
    count, n_states = scene.beliefs.shape
    rules, partition = rules_for(n_states), atlas.partition
    patience = _PATIENCE if n_states > 3 else _PATIENCE_IN_PLANE
    limits = _LIMITS._replace(patience=patience if goes_on else 0)
    partition.make(starts.region)
    # Climbs of a turn: all starts; every row from the best and from the farthest decision, freed ones, and those of a corner.
    around = 2 * (len(atlas.problem.constraints.b_ub) + n_states)
    most = max(int(np.diff(starts.first).max(initial=0)), around)
    reached, left = _explored(atlas, count, around), np.arange(count)

    def ended(*_: int) -> None:
        if progress is not None:
            progress(int((reached.stage == ENDED).sum()), count)

    while left.size:
        regions, steps = partition.arrays, left

        def work(low: int, high: int, regions: Regions = regions, steps: np.ndarray = steps) -> None:
            room = turn_room(*atlas.size, most)
            search_regions(steps[low:high], scene, regions, starts, rules, limits, (reached, room))

        in_chunks(work, left.size, _FEW_BELIEFS, ended)
        left = np.flatnonzero(reached.stage != ENDED)
        if left.size:
            partition.reach(reached.missing[np.arange(around) < reached.n_missing[:, None]])
    return reached


def _explored(atlas: Atlas, count: int, most_missing: int) -> Explored:
    n_states, size = atlas.problem.n_states, atlas.problem.n_actions + 1
    return Explored(
        np.full(count, NOT_BEGUN), np.zeros(count, dtype=np.int64), np.empty((count, most_missing, 2), dtype=np.int64),
        np.zeros(count, dtype=np.int64), np.full((count, 2), -np.inf), np.zeros(count, dtype=np.int64),
        np.empty((count, _MOST_REACHED), dtype=np.int64), np.empty((count, _MOST_REACHED), dtype=np.int64),
        np.empty((count, _MOST_REACHED, 5)),
        np.empty((count, _MOST_REACHED, n_states)), np.empty((count, _MOST_REACHED, size)),
        np.empty((count, _MOST_REACHED, n_states)), np.empty((count, _MOST_REACHED, size)),
        np.empty((count, _MOST_REACHED), dtype=np.bool_), np.empty((count, _MOST_REACHED), dtype=np.bool_),
        np.zeros(count, dtype=np.int64), np.empty((count, _MOST_TRIED), dtype=np.int64),
    )  # fmt: skip


def starts_of(atlas: Atlas, scene: Scene, n_starts: int, others: list[SomeStarts] | None = None) -> Starts:
    """Return where the searches of a block begin: `n_starts` candidates each, and the rest."""
    count, n_states = scene.beliefs.shape
    n_worth = np.empty(count, dtype=np.int64)
    chosen = (np.empty((count, n_starts), dtype=np.int64), np.empty((count, n_starts)), n_worth)
    ends = np.empty((count, 2 ** min(_SIGNS, atlas.axes.shape[1]), n_states))

    def look(low: int, high: int) -> None:
        best_starts(low, high, scene, atlas.table, atlas.axes, len(atlas.patterns), chosen, ends)

    in_chunks(look, count, _CHUNK)
    steps, places = np.nonzero(chosen[0] >= 0)
    index = chosen[0][steps, places]
    parts = [starts_in(steps, atlas.table.region[index], atlas.table.decoys[index], atlas.actions[index])]
    parts += _end_starts(atlas, scene, ends)
    if scene.sign > 0.0 and atlas.axes.shape[1] > atlas.problem.n_actions - len(atlas.problem.constraints.b_eq):
        parts.append(_pair_starts(atlas, scene))
    elif n_states >= _EDGE_STATES:
        parts += _edge_starts(atlas, scene)
    starts = together(scene, [*parts, *(others or ())])
    # Few candidates say little of how far climbs from them come: then no start is skipped.
    starts.promise[np.repeat(n_worth < _FEW, np.diff(starts.first))] += _FARTHEST
    return starts


def together(scene: Scene, parts: list[SomeStarts]) -> Starts:
    """Return the starts of each belief that has anything to spend."""
    belief, region, decoys, actions, promise = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    searched = np.flatnonzero(scene.limits[belief] > 0.0)
    order = searched[np.argsort(belief[searched], kind="stable")]
    first = np.searchsorted(belief[order], np.arange(len(scene.beliefs) + 1))
    return Starts(
        first, region[order], decoys[order], actions[order], promise[order], np.empty(len(order), dtype=np.int64)
    )


class SomeStarts(NamedTuple):
    """Starts of beliefs in any order."""

    belief: np.ndarray  # (n,)
    region: np.ndarray  # (n,)
    decoys: Array  # (n,X)
    actions: Array  # (n,U)
    promise: Array  # (n,) what is added to what a start promises


def starts_in(steps: np.ndarray, numbers: np.ndarray, decoys: Array, actions: Array, added: float = 0.0) -> SomeStarts:
    """Return starts of beliefs `steps` (n,) in regions `numbers` (n,), at decoys (n,X) and their decisions (n,U)."""
    return SomeStarts(steps, numbers, decoys, actions, np.full(len(steps), added))


def _pair_starts(atlas: Atlas, scene: Scene) -> SomeStarts:
    """The best beliefs in two states only whose decisions no other belief explains, at most a few."""
    pairs = atlas.pairs
    regrets = scene.beliefs @ atlas.problem.state_costs(pairs.actions).T - scene.optimal_costs[:, None]
    far = np.linalg.norm(pairs.decoys - scene.points[:, None], axis=2)
    values = np.where(regrets <= scene.limits[:, None], far - scene.prices[:, None] * regrets, -np.inf)
    chosen = np.argsort(-values, axis=1)[:, :_PAIRS]
    steps, places = np.nonzero(np.take_along_axis(values, chosen, axis=1) > -np.inf)
    index = chosen[steps, places]
    return starts_at(atlas, steps, pairs.decoys[index], pairs.actions[index])


def _edge_starts(atlas: Atlas, scene: Scene) -> Iterator[SomeStarts]:
    """Where climbs along the budget's edge end."""
    for t in np.flatnonzero((scene.limits > 0.0) & (scene.limits < np.inf)):
        aim = Aim(
            scene.beliefs[t], scene.points[t], scene.sign, float(scene.optimal_costs[t]), float(scene.limits[t]), 0.0
        )
        decoys = edge_decoys(atlas.problem, aim, atlas.table.decoys, atlas.table.costs)[:_STARTS]
        yield starts_at(atlas, np.full(len(decoys), t), decoys, atlas.problem.solve(decoys))


def _end_starts(atlas: Atlas, scene: Scene, ends: Array) -> Iterator[SomeStarts]:
    """One start for every region on which ends of the budget (T,Q,X) lie."""
    steps, places = np.nonzero(~np.isnan(ends[:, :, 0]))
    if not steps.size:
        return
    decoys = ends[steps, places]
    actions = _moved_to_the_budget(atlas.problem, scene, steps, decoys)
    yield starts_at(atlas, steps, decoys, actions)


def _moved_to_the_budget(problem: QuadraticProblem, scene: Scene, steps: np.ndarray, decoys: Array) -> Array:
    """Move decoys (n,X) on their rays to just before the budget ends, and return their decisions (n,U).

    The regret grows along a ray, and its root is linear within a region: each step takes it as linear from the belief on, and
    halves what is left where that leads out of the shares known to be affordable and not, or back too slowly.
    """
    beliefs, limits, best = scene.beliefs[steps], scene.limits[steps], scene.optimal_costs[steps]
    away, share = decoys - beliefs, np.ones(len(steps))
    with np.errstate(divide="ignore", invalid="ignore"):
        # Not out of the simplex: there a probability is zero.
        room = np.where(away < 0.0, beliefs / -away, np.inf).min(axis=1)
    low, high = np.zeros(len(steps)), np.maximum(room, 1.0)
    actions, left = problem.solve(beliefs), np.arange(len(steps))
    for turn in range(_RAY_STEPS):
        tried = problem.solve(np.maximum(beliefs[left] + share[left, None] * away[left], 0.0))
        regrets = (problem.state_costs(tried) * beliefs[left]).sum(axis=1) - best[left]
        fits = regrets <= limits[left]
        low[left[fits]], high[left[~fits]] = share[left[fits]], share[left[~fits]]
        actions[left[fits]] = tried[fits]
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = np.sqrt((1.0 - _SPARED) * limits[left] / np.maximum(regrets, 0.0))
        near = fits & ((ahead <= 1.0 + _SPARED) | (share[left] >= high[left]))
        least, most = low[left], high[left]
        ahead = share[left] * np.where(ahead < _FARTHER, ahead, _FARTHER)
        to_the_end = fits & (ahead >= most) & (most >= room[left])
        half = 0.5 * (least + most)
        ahead = np.where((ahead > least) & (ahead < most), ahead, half)
        share[left] = np.where(to_the_end, most, np.where(fits | (turn == 0), ahead, np.minimum(ahead, half)))
        left = left[~near]
        if not left.size:
            break
    decoys[:] = np.maximum(beliefs + low[:, None] * away, 0.0)
    return np.asarray(actions)


def starts_at(atlas: Atlas, steps: np.ndarray, decoys: Array, actions: Array) -> SomeStarts:
    """Return starts of beliefs `steps` (n,) at decoys (n,X) and their decisions (n,U), in the regions where these lie."""
    region = atlas.problem.constraints
    slack = region.slacks(actions)
    # The region an observer sees; and, where rows are slack by less than the least, the one with those rows loose.
    seen, exact = slack < region.observed_slack, slack <= tolerances.FEASIBILITY
    other = np.flatnonzero((seen != exact).any(axis=1))
    which = np.concatenate([np.arange(len(steps)), other])
    numbers = atlas.partition.numbers(np.concatenate([seen, exact[other]]))
    return starts_in(steps[which], numbers, decoys[which], actions[which])
