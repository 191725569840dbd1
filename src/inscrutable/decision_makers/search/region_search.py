"""The best decisions of many beliefs, each searched independently, from critical region to critical region.

A search starts at the best candidates of every region and orthant, and in every orthant where the budget about ends on the ray
to a candidate beyond it.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.fft import dct

from inscrutable import tolerances
from inscrutable.adversaries import consistent_sets
from inscrutable.budgets import Budget
from inscrutable.decision_makers.candidate_sources import decided_by
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.results import Progress
from inscrutable.decision_makers.search.partition import Partition, face_programme
from inscrutable.geometry.equal_rows import distinct_patterns
from inscrutable.geometry.hulls import LARGER, sum_zero_basis
from inscrutable.geometry.low_discrepancy import simplex_cover
from inscrutable.kernels.calls import in_chunks
from inscrutable.kernels.region_climb import Aims, Optima
from inscrutable.kernels.region_search import (
    AT_STARTS,
    ENDED,
    BestStarts,
    Explored,
    Limits,
    Starts,
    Table,
    best_starts,
    read_actions,
    search_regions,
)
from inscrutable.kernels.regions import UNKNOWN, Regions
from inscrutable.kernels.set_distance import is_explained_once
from inscrutable.privacy import DesiredObfuscation, MaximalObfuscation, PrivacyMeasure
from inscrutable.problems import DecisionProblem, QuadraticProblem, quadratic_problem
from inscrutable.validation import Array

_ON_EDGE = 50
"""Beliefs on an edge of the simplex; with 12, 2 of 40 lotteries over six states and three assets lose 28 %."""
_ENOUGH, _ENOUGH_SPARSE = 1000, 5000
"""Candidates to start from, and for each state from five on: with only the 66 of a grid of tenths, 1 of 60 decisions over
three states loses 70 %. Without the second number, two of 600 over five states lose up to 5 %; with it a first decision over
six takes .1 s longer."""
_BLOCK = 1024  # beliefs whose searches are kept in memory at once
_CHUNK = 4  # beliefs that a thread takes at a time; with 1 or 16 on two cores no difference shows in the noise
_STARTS, _SIGNS = 60, 8  # candidates that a search starts from; directions whose signs make an orthant
"""With 12 starts, one of 72 beliefs over six states loses 44 %; with three directions, 9 of 144 beliefs over five and six
states with as many assets or fewer lose up to 37 %. With orthonormal directions alone, a default grid's 5,000 candidates and
starts that were first moved onto the budget, 12 of 1,340 decisions and lotteries over five to eight states in concentrated
markets lose up to 21 %, and four gain up to 2 %. With eight over three and four states none of 6,400 differs, in 1.1 to 1.2
times the time."""
_MOST_REACHED, _MOST_TRIED = 64, 1024
"""Regions that a search keeps, and that it may climb. With 16, one of 240 decisions in concentrated markets loses 22 %; with
128 two lose up to 1.6 %, none faster; others do not change."""
FIRST, NEVER_SKIPPED = np.inf, tolerances.SIMPLEX_DIAMETER
"""Bonuses of a start: it comes before all others; it promises more than any distance that is found."""
_FAR_OFF = 16.0
"""An end of the budget whose regret is this many times the budget is moved to where that regret says. Else one of 60 decisions
over two states, at a small budget and a corner of the simplex, is not found at all; with 2 none of 90 changes."""
_FEW = 1000
"""Where fewer candidates are affordable they tell little about the value at the end of a climb, and no start is skipped:
else 40 of 4,800 decisions over three states lose up to 9 % at a budget of a hundredth, and 190 up to 23 % at a thousandth. With
100, 2 of 4,400 decisions and lotteries lose, up to 61 %; with 300 one of 8 kept ones loses 1.4 %, in .9 to .95 of the time."""
_PAIRS = 4
"""Beliefs in two states only. With two, one decision and four lotteries of 240 where states outnumber assets lose, up to .02 %;
without, seven and 20, up to 65 %."""
_SPARSE = 4
"""Number of states from which no start is skipped: candidates lie too far apart to predict where a climb ends. With skips, 12
of 5,800 decisions over four states lose up to 74 %, and 36 lotteries up to 12 %; of 900 decisions over five to eight states and
as many assets or fewer 42 lose up to 50 %. They take a third to two thirds of the time, and over three states, where of 6,800
decisions none and of as many lotteries seven lose, up to .7 %, a quarter to two thirds. Under trading costs none is
skipped either: of 1,920 decisions and as many lotteries over two and three states 26 gain, up to 23 %, and one loses .2 %, in
1.1 times the time."""
_PATIENCE, _LEAST_PATIENCE = 16, 8
"""Regions, for each state above two, whose neighbours are searched in vain before a search ends. Over four to six states and in
concentrated markets, 10 of 1,752 decisions lose up to 33 % with 4, and 67 lotteries up to 23 %; with 10 no decision does, and 8
lotteries up to 2 %. Over seven and eight, 6 of 330 decisions and 12 lotteries lose up to 10 % with 4. Decisions take 1.3 times,
lotteries 1.6 times as long as with 4; over three states no longer. With a least number of four, one of 41 decisions under
trading costs loses 21 %; eight take as long."""
_FREED, _FREED_LIFTED = 1, 2
"""Tight rows of a region that are freed, for each state; a magnitude has two, where rows of signs would have one. With three in
all 1 of 22 decisions over eight states loses 2 %, and lotteries over six states up to 6 %. With two a state 720 decisions and
lotteries over three to seven states without magnitudes gain nothing, in 1.4 times the time. Under limits on magnitudes one a
state loses at most a thousandth in 1,200 of them, but a quarter at a seed that the tests keep."""


class Decided(NamedTuple):
    """E beliefs and their decisions."""

    decoys: Array  # (E,X)
    actions: Array  # (E,U)


class SearchSpace:
    """The data of a search: candidates by critical region, distinct, plausible and admissible."""

    def __init__(self, problem: DecisionProblem, candidates: Candidates) -> None:
        form, quadratic = problem.quadratic_form(), quadratic_problem(problem)
        assert form is not None, "a search space is of quadratic costs"
        assert quadratic is not None
        self.form = form
        self.stated, self.problem = quadratic, quadratic.without_common_costs
        """The quadratic problem in the form's variables, called decisions here; without constants."""
        sets = candidates.sets
        first = sets.distinct == np.arange(len(candidates))
        variables = self.form.variables(candidates.actions)
        chosen = np.flatnonzero(first & candidates.usable & (sets.dimension >= 0))
        decoys = sets.start if candidates.decoys is None else candidates.decoys
        self.actions = variables[chosen]
        self.patterns, region = distinct_patterns(quadratic.constraints.tight_rows(self.actions))
        seen = _seen_directions(quadratic)
        self.n_seen, self.axes = seen.shape[1], _in_more_directions(seen)
        self.partition = Partition(self.problem)
        self.partition.numbers(self.patterns)
        self.table = Table(
            np.ascontiguousarray(self.problem.costs_of(self.actions)),
            np.ascontiguousarray(decoys[chosen]),
            region.reshape(-1).astype(np.int64),
            np.ascontiguousarray(decoys[chosen] @ self.axes),
        )
        in_sets = np.isin(self.table.region, self.table.region[sets.dimension[chosen] > 0])
        self.exact = np.flatnonzero(in_sets & (sets.dimension[chosen] < LARGER))
        """Candidates with a point or a segment as their set, in regions with sets larger than points."""
        self.exact_ends = sets.start[chosen[self.exact]], sets.end[chosen[self.exact]]

    @cached_property
    def pairs(self) -> Decided:
        """Beliefs in two states only whose decisions no other belief explains, a few for each pair of states.

        Where other sets are larger than points, such decisions are the border of those that some belief explains.
        """
        n_states = self.problem.n_states
        first, second = np.triu_indices(n_states, 1)
        share = (np.arange(_ON_EDGE) + 0.5) / _ON_EDGE
        corners = np.eye(n_states)
        decoys = share[:, None] * corners[first][:, None] + (1.0 - share)[:, None] * corners[second][:, None]
        decoys = decoys.reshape(-1, n_states)
        actions = self.problem.solve_rows(decoys)
        alone = self._explained_once(actions)
        return Decided(decoys[alone], actions[alone])

    def _explained_once(self, actions: Array) -> np.ndarray:
        """Whether one belief alone explains each decision (n,U): the consistent beliefs nearest to all corners are the same."""
        patterns, which = distinct_patterns(self.problem.constraints.tight_rows(actions))
        faces = [face_programme(self.problem, tight) for tight in patterns]
        basis, alone = writable_basis(self.problem.n_states), np.ones(len(actions), dtype=np.bool_)
        for j, face in enumerate(faces[number] for number in which):
            alone[j] = is_explained_once(face.arrays, face.w(actions[j]), basis, face.n_set_rows)
        return alone

    @cached_property
    def corners(self) -> Decided:
        """The beliefs that are certain of a state."""
        corners = np.eye(self.problem.n_states)
        return Decided(corners, self.problem.solve_rows(corners))

    def aims(self, measure: PrivacyMeasure, budget: Budget, beliefs: Array) -> tuple[Aims, Array]:
        """Return the objectives of a measure that follows ± a distance under beliefs (T,X), and optimal costs.

        The aims' costs are those of the space's problem: a constant that all decisions cost in a state is left out, so that no
        digits are lost to it.
        """
        # Copies, all of one layout: kernels would be compiled anew for one that is read-only.
        held = np.array(beliefs, dtype=np.float64, order="C")
        optimal = self.problem.solve_rows(held)
        state_costs = self.problem.costs_of_each(optimal)
        costs = (state_costs * held).sum(axis=1)
        optimal_costs = (
            costs if self.stated is self.problem else (self.stated.costs_of_each(optimal) * held).sum(axis=1)
        )
        points, sign = held, 1.0
        if isinstance(measure, DesiredObfuscation):
            points, sign = np.array(measure.targets_for(held), order="C"), -1.0
        elif not isinstance(measure, MaximalObfuscation):
            # A measure of the user's own, which may follow another distance under each belief.
            (reference,) = (measure.reference(belief) for belief in held)
            assert reference is not None, "only measures that follow a distance are searched"
            points, sign = np.array(reference.point[None], order="C"), float(reference.sign)
        limits = np.array(budget.limits(optimal_costs), dtype=np.float64)
        rounding = tolerances.COST_ROUNDING * (np.abs(state_costs) * held).sum(axis=1)
        return Aims(held, optimal, points, sign, costs, limits, np.zeros(len(held)), rounding), optimal_costs

    def decisions(self, variables: Array) -> Array:
        """Return the decisions (…,U) of the problem that was asked for from those (…,V) of its form."""
        return variables if self.form.lift is None else self.form.decisions(variables)


def _seen_directions(problem: QuadraticProblem) -> Array:
    """Orthonormal directions (X,D) of beliefs that decisions identify: where states cost alike some are not identified."""
    curves = face_programme(problem, np.zeros(len(problem.constraints.b_ub), dtype=bool)).curves[:, :-1]
    basis = sum_zero_basis(problem.n_states)
    directions, sizes, _ = np.linalg.svd(basis.T @ curves.reshape(len(curves), -1), full_matrices=False)
    seen = sizes > tolerances.RANK * max(float(sizes.max(initial=0.0)), float(np.abs(problem.linear).max()))
    return np.asarray(basis if seen.sum() == basis.shape[1] else basis @ directions[:, seen])


def _in_more_directions(seen: Array) -> Array:
    """Directions (X,A) in which distances are those in orthonormal ones (X,D): twice as many, as far as these make an orthant.

    They are combinations of these by rows of an orthogonal matrix, that of the discrete cosine transform.
    """
    count = seen.shape[1]
    more = max(1, count, min(2 * count, _SIGNS))
    return np.array(seen @ dct(np.eye(more), axis=0, norm="ortho")[:count], order="C")


def space_of(problem: DecisionProblem, candidates: Candidates) -> SearchSpace:
    """Return the space of candidates, made at first use and kept with them; where these are few, decoys of a grid are added."""

    def made() -> SearchSpace:
        enough = max(_ENOUGH, _ENOUGH_SPARSE * (problem.n_states - 3))
        if len(candidates) >= enough:
            return SearchSpace(problem, candidates)
        return SearchSpace(problem, candidates.joined(decided_by(problem, simplex_cover(problem.n_states, enough))))

    return candidates.once("space", made)


class Best(NamedTuple):
    """The best decision known for each of T beliefs."""

    actions: Array  # (T,U) in the variables of the problem's quadratic form
    decoys: Array  # (T,X) the consistent belief nearest to the aim's point
    privacies: Array  # (T,)
    regrets: Array  # (T,)
    prices: Array  # (T,) derivative of the privacy in the budget
    is_polished: np.ndarray  # (T,) whether the search found it; else it is the optimal decision
    regions: np.ndarray  # (T,) where it was found


@cache
def writable_basis(n_states: int) -> Array:
    """Return `sum_zero_basis` as a copy: kernels that make bases of their own would be compiled anew for a read-only one."""
    return np.array(sum_zero_basis(n_states), order="C")


def best_in_regions(space: SearchSpace, aims: Aims, progress: Progress | None = None) -> Best:
    """Return the best decisions: the optimal ones where nothing better was found.

    Cost: one look at all candidates a belief and some dozen climbs; memory besides the result is that of a block.
    """
    count, parts = len(aims.beliefs), []
    for first in range(0, count, _BLOCK):
        some = cut(aims, slice(first, min(first + _BLOCK, count)))
        seen = None if progress is None else partial(_report, progress, first, count)
        with space.partition.searched(space.patterns):
            reached = search(space, some, starts_of(space, some, _STARTS, _farthest_sets(space, some)), seen)
            parts.append(read(space, some, reached, np.arange(len(some.beliefs)), values_of(reached).argmax(axis=1)))
    found = Best(*map(np.concatenate, zip(*parts, strict=True)))
    own = _optimal(space.problem, aims)
    better = found.privacies > own.privacies + (tolerances.NO_PRIVACY if aims.sign > 0 else 0.0)
    return Best(*(np.where(better[:, None] if a.ndim > 1 else better, a, b) for a, b in zip(found, own, strict=True)))


def _optimal(problem: QuadraticProblem, aims: Aims) -> Best:
    """The decisions of least cost."""
    nothing = np.zeros(len(aims.beliefs))
    privacies = nothing
    if aims.sign < 0:  # else the true belief, which explains the optimal decision, is the point itself
        sets = consistent_sets(problem, aims.optimal, aims.beliefs)
        privacies = -sets.bounds(aims.points)
        for t in np.flatnonzero(sets.dimension > 1):
            privacies[t] = -sets[int(t)].distance(aims.points[t])
    return Best(aims.optimal, aims.beliefs, privacies, nothing, nothing, nothing > 0.0, np.full(len(nothing), UNKNOWN))


def values_of(reached: Explored) -> Array:
    """Return the values (T,C) of what was reached; −∞ where there is nothing."""
    return np.where(np.arange(reached.region.shape[1]) < reached.count[:, None], reached.optima.value, -np.inf)


def read(space: SearchSpace, aims: Aims, reached: Explored, steps: np.ndarray, entries: np.ndarray) -> Best:
    """Return some entries (n,) of beliefs `steps` (n,); the privacy is −∞ where nothing was found.

    A decoy slightly outside the simplex, by rounding, is moved onto it.
    """
    privacies = values_of(reached)[steps, entries]
    actions = np.zeros((len(steps), space.actions.shape[1]))
    decoys = np.full((len(steps), aims.beliefs.shape[1]), np.nan)
    regrets, prices = np.zeros(len(steps)), np.zeros(len(steps))
    found = np.flatnonzero(privacies > -np.inf)
    at, placed, optima = (steps[found], entries[found]), actions[found], reached.optima
    read_actions(*at, space.partition.arrays, reached, placed)
    actions[found], decoys[found], privacies[found] = placed, optima.nearest[at], optima.privacy[at]
    regrets[found], prices[found] = optima.regret[at], optima.price[at]
    off = np.flatnonzero((decoys < -tolerances.EXPLAINED).any(axis=1))
    decoys[off] = np.maximum(decoys[off], 0.0) / np.maximum(decoys[off], 0.0).sum(axis=1, keepdims=True)
    privacies[off] = aims.sign * np.linalg.norm(decoys[off] - aims.points[steps[off]], axis=1)
    return Best(actions, decoys, privacies, regrets, prices, privacies > -np.inf, reached.region[steps, entries])


def _report(progress: Progress, before: int, count: int, done: int, _: int) -> None:
    progress(before + done, count)


def cut(aims: Aims, rows: slice | np.ndarray) -> Aims:
    """Return the objectives of some of the beliefs."""
    return Aims._make(field[rows] if isinstance(field, np.ndarray) else field for field in aims)


def search(space: SearchSpace, aims: Aims, starts: Starts, progress: Progress | None = None) -> Explored:
    """Return what the searches of a block find from their starts."""
    count, n_states = aims.beliefs.shape
    basis, partition = writable_basis(n_states), space.partition
    patience = max(_LEAST_PATIENCE, _PATIENCE * (n_states - 2))
    partition.make(starts.region)
    freed = n_states * (_FREED if space.form.lift is None else _FREED_LIFTED)
    # Climbs of a turn: all starts; every row from the best and from the farthest decision, and freed ones.
    around = 2 * (len(space.problem.constraints.b_ub) + freed)
    limits = Limits(patience, max(int(np.diff(starts.first).max(initial=0)), around), freed)
    # Without a start there may be no region at all.
    reached, left = _explored(space, count, around), np.arange(count if len(starts.region) else 0)

    def ended(*_: int) -> None:
        if progress is not None:
            progress(int((reached.stage == ENDED).sum()), count)

    while left.size:
        regions, steps = partition.arrays, left

        def work(low: int, high: int, regions: Regions = regions, steps: np.ndarray = steps) -> None:
            search_regions(steps[low:high], aims, regions, starts, basis, limits, reached)

        in_chunks(work, left.size, _CHUNK, ended)
        left = np.flatnonzero(reached.stage != ENDED)
        if left.size:
            partition.reach(reached.missing[np.arange(around) < reached.n_missing[:, None]])
    return reached


def _explored(space: SearchSpace, count: int, most_missing: int) -> Explored:
    n_states, size = space.problem.n_states, space.actions.shape[1] + 1
    entries, none, number = (count, _MOST_REACHED), np.zeros(count, dtype=np.int64), np.int64
    optima = Optima(
        np.empty(entries), np.empty(entries), np.empty(entries), np.empty(entries), np.empty((*entries, n_states)),
        np.empty((*entries, size)), np.empty(entries), np.empty((*entries, n_states)), np.empty((*entries, size)),
    )  # fmt: skip
    return Explored(
        np.full(count, AT_STARTS), none.copy(), none.copy(), np.empty((count, most_missing, 2), dtype=number),
        none.copy(), np.full(count, -np.inf), np.full(count, -np.inf), none.copy(),
        np.empty(entries, dtype=number), np.empty(entries, dtype=number), optima, np.empty(entries, dtype=np.bool_),
        none.copy(), np.empty((count, _MOST_TRIED, 2), dtype=number),
    )  # fmt: skip


def starts_of(space: SearchSpace, aims: Aims, n_starts: int, others: list[SomeStarts] | None = None) -> Starts:
    """Return where the searches of a block begin: `n_starts` candidates each, and the rest."""
    count, n_states = aims.beliefs.shape
    found = BestStarts(
        np.empty((count, n_starts), dtype=np.int64),
        np.empty(count, dtype=np.int64),
        np.empty((count, 2 ** min(_SIGNS, space.axes.shape[1]), n_states)),
    )

    def look(low: int, high: int) -> None:
        best_starts(low, high, aims, space.table, space.axes, len(space.patterns), found)

    in_chunks(look, count, _CHUNK)
    steps, places = np.nonzero(found.candidate >= 0)
    index = found.candidate[steps, places]
    parts = [starts_in(steps, space.table.region[index], space.table.decoys[index], space.actions[index])]
    parts += _end_starts(space, aims, found.ends)
    few = found.n_worth < _FEW
    if aims.sign > 0.0 and space.n_seen > space.actions.shape[1] - len(space.problem.constraints.b_eq):
        parts.append(_pair_starts(space, aims))
    few |= n_states >= _SPARSE or space.form.lift is not None
    starts = _together(aims, [*parts, *(others or ())])
    starts.bonus[np.repeat(few, np.diff(starts.first))] += NEVER_SKIPPED
    return starts


def _together(aims: Aims, parts: list[SomeStarts]) -> Starts:
    """Return the starts of each belief that has anything to spend."""
    belief, region, decoys, actions, bonus = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    searched = np.flatnonzero(aims.limits[belief] > 0.0)
    order = searched[np.argsort(belief[searched], kind="stable")]
    first = np.searchsorted(belief[order], np.arange(len(aims.beliefs) + 1))
    unknown, unsorted = np.empty(len(order)), np.empty(len(order), dtype=np.int64)
    return Starts(first, region[order], decoys[order], actions[order], bonus[order], unknown, unsorted)


class SomeStarts(NamedTuple):
    """Starts of beliefs in any order."""

    belief: np.ndarray  # (n,)
    region: np.ndarray  # (n,)
    decoys: Array  # (n,X)
    actions: Array  # (n,U)
    bonus: Array  # (n,) FIRST, NEVER_SKIPPED or 0


def starts_in(steps: np.ndarray, numbers: np.ndarray, decoys: Array, actions: Array, bonus: float = 0.0) -> SomeStarts:
    """Return starts of beliefs `steps` (n,) in regions `numbers` (n,), at decoys (n,X) and their decisions (n,U)."""
    return SomeStarts(steps, numbers, decoys, actions, np.full(len(steps), bonus))


def _farthest_sets(space: SearchSpace, aims: Aims) -> list[SomeStarts]:
    """The affordable candidate whose set is farthest, for each belief; else one with a farther decoy represents its region.

    Without it 1 of 400 decisions over two and three states is 2.8 % below the best candidate.
    """
    if aims.sign < 0.0 or not space.exact.size:
        return []
    (first, last), costs = space.exact_ends, space.table.costs[space.exact]
    along = last - first
    square = np.maximum((along**2).sum(axis=1), tolerances.TINY)
    best = np.empty(len(aims.beliefs), dtype=np.int64)
    for t, belief in enumerate(aims.beliefs):
        off = aims.points[t] - first
        share = np.clip((off * along).sum(axis=1) / square, 0.0, 1.0)
        distances = np.linalg.norm(off - share[:, None] * along, axis=1)
        best[t] = np.where(costs @ belief - aims.optimal_costs[t] <= aims.limits[t], distances, -1.0).argmax()
    steps, index = np.arange(len(best)), space.exact[best]
    part = starts_in(steps, space.table.region[index], space.table.decoys[index], space.actions[index], FIRST)
    fits = (space.table.costs[index] * aims.beliefs).sum(axis=1) - aims.optimal_costs <= aims.limits
    return [SomeStarts(*(column[fits] for column in part))]


def _pair_starts(space: SearchSpace, aims: Aims) -> SomeStarts:
    """The best beliefs in two states only whose decisions no other belief explains, at most a few."""
    pairs = space.pairs
    costs = space.problem.costs_of_each(pairs.actions)
    regrets = (aims.beliefs[:, None] * costs).sum(axis=2) - aims.optimal_costs[:, None]
    far = np.linalg.norm(pairs.decoys - aims.points[:, None], axis=2)
    values = np.where(regrets <= aims.limits[:, None], far - aims.prices[:, None] * regrets, -np.inf)
    chosen = np.argsort(-values, axis=1)[:, :_PAIRS]
    steps, places = np.nonzero(np.take_along_axis(values, chosen, axis=1) > -np.inf)
    index = chosen[steps, places]
    return starts_at(space, steps, pairs.decoys[index], pairs.actions[index])


def _end_starts(space: SearchSpace, aims: Aims, ends: Array) -> Iterator[SomeStarts]:
    """One start for every region on which ends of the budget (T,Q,X) lie."""
    steps, places = np.nonzero(~np.isnan(ends[:, :, 0]))
    if not steps.size:
        return
    decoys, beliefs = ends[steps, places], aims.beliefs[steps]
    actions = space.problem.solve_rows(decoys)
    regrets = (space.problem.costs_of_each(actions) * beliefs).sum(axis=1) - aims.optimal_costs[steps]
    limits = aims.limits[steps]
    yield starts_at(space, steps, decoys, actions)
    # √ρ may be far from linear on the ray.
    off = np.flatnonzero(regrets > _FAR_OFF * limits)
    if off.size:
        decoys = beliefs[off] + np.sqrt(limits[off] / regrets[off])[:, None] * (decoys[off] - beliefs[off])
        yield starts_at(space, steps[off], decoys, space.problem.solve_rows(decoys))


def starts_at(space: SearchSpace, steps: np.ndarray, decoys: Array, actions: Array) -> SomeStarts:
    """Return starts of beliefs `steps` (n,) at decoys (n,X) and their decisions (n,U), in the regions where these lie."""
    which, numbers = space.partition.holding_some(actions)
    return starts_in(steps[which], numbers, decoys[which], actions[which])


def farthest_corners(points: Array) -> Array:
    """Return the distances of points (T,X) from the corners of the simplex that are farthest: ‖p‖² − 2 min p_i + 1."""
    return np.asarray(np.sqrt((points**2).sum(axis=1) - 2.0 * points.min(axis=1) + 1.0))
