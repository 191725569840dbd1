"""The lotteries of largest expected privacy: a Lagrangian search, with the price of the budget found by chords.

A lottery of two decisions A and B is optimal where no decision lies above their chord in the plane of regret and privacy. The
search begins at the price of the best single decision. The decision found gives a chord; its slope is the next price, until
no decision lies above the chord.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.envelope import best_mixtures
from inscrutable.decision_makers.results import Progress
from inscrutable.decision_makers.search.region_search import (
    FIRST,
    Best,
    SearchSpace,
    SomeStarts,
    cut,
    read,
    search,
    starts_at,
    starts_in,
    starts_of,
    values_of,
)
from inscrutable.kernels.region_climb import Aims
from inscrutable.validation import Array

_BLOCK = 1024  # beliefs whose searches are kept in memory at once
_STARTS = 12
"""Candidates that a search at a price starts from; with 4, 6 of 900 beliefs over three states lose up to 6 %."""
_NEW = 4  # decisions that a search at a price adds at most
_ROUNDS = 12
"""Prices. With 8, 2 of 1,200 lotteries over six states lose up to .8 %, as fast; with 16 none gains."""
_KNOWN = 3 + _NEW * _ROUNDS  # decisions kept of a belief: three known beforehand, and what is added
_NONE = -1
_OWN, _TARGET, _SINGLE = range(3)


class Lotteries(NamedTuple):
    """Two atoms for each of T beliefs; a single decision has probability 1 and is both."""

    actions: Array  # (T,2,U) in the variables of the problem's quadratic form
    probabilities: Array  # (T,2)
    regrets: Array  # (T,2)
    privacies: Array  # (T,2)
    decoys: Array  # (T,2,X)
    prices: Array  # (T,)
    polished: np.ndarray  # (T,) whether an atom was found by a search over regions


def best_lotteries(space: SearchSpace, aims: Aims, singles: Best, progress: Progress | None = None) -> Lotteries:
    """Return the best lotteries, the optimal and the best single decisions among their atoms.

    Cost: some three searches a belief, at a price each; memory besides the result is that of a block.
    """
    count, parts = len(aims.beliefs), []
    for first in range(0, count, _BLOCK):
        part = slice(first, min(first + _BLOCK, count))
        with space.partition.searched(space.patterns):
            block = _Block(space, cut(aims, part), Best(*(column[part] for column in singles)))
            block.close()
            parts.append(block.lotteries())
        if progress is not None:
            progress(part.stop, count)
    return Lotteries(*map(np.concatenate, zip(*parts, strict=True)))


class _Block:
    """The chords of some beliefs and the decisions known to them."""

    def __init__(self, space: SearchSpace, aims: Aims, singles: Best) -> None:
        self.space, self.aims = space, aims
        count, n_states = aims.beliefs.shape
        problem = space.problem
        self.regrets, self.privacies = np.zeros((count, _KNOWN)), np.full((count, _KNOWN), -np.inf)
        self.actions = np.zeros((count, _KNOWN, aims.optimal.shape[1]))
        self.decoys = np.full((count, _KNOWN, n_states), np.nan)
        self.regions = np.zeros((count, _KNOWN), dtype=np.int64)
        self.polished = np.zeros((count, _KNOWN), dtype=np.bool_)
        self.polished[:, _SINGLE] = singles.is_polished
        self.used = np.full(count, _SINGLE + 1)
        least = -np.linalg.norm(aims.points - aims.beliefs, axis=1) if aims.sign < 0 else np.zeros(count)
        self._keep(_OWN, aims.optimal, aims.beliefs, np.zeros(count), least)
        if aims.sign < 0:
            # The decision that is optimal under the target is the nearest to it. There the distance has a kink, at which
            # gradient ascent does not converge.
            target = problem.solve_rows(aims.points)
            regrets = (problem.costs_of_each(target) * aims.beliefs).sum(axis=1) - aims.optimal_costs
            allowed = problem.constraints.is_admissible(target)
            self._keep(_TARGET, target, aims.points, np.maximum(regrets, 0.0), np.where(allowed, 0.0, -np.inf))
        # The decision is affordable: its regret, computed again, may differ by rounding.
        regrets = np.minimum(singles.regrets, aims.limits)
        self._keep(_SINGLE, singles.actions, singles.decoys, regrets, singles.privacies)
        self.price = np.nan_to_num(singles.prices)
        self.corners = starts_at(space, np.arange(n_states), *space.corners)
        self.left, self.right = np.full(count, _OWN), np.full(count, _NONE)

    def _keep(self, place: int, actions: Array, decoys: Array, regrets: Array, privacies: Array) -> None:
        self.actions[:, place], self.decoys[:, place] = actions, decoys
        self.regrets[:, place], self.privacies[:, place] = regrets, privacies
        self.regions[:, place] = self.space.partition.holding(actions)

    def close(self) -> None:
        """Search at the slopes of the chords until nothing lies above them."""
        steps = np.flatnonzero(self.aims.limits > 0.0)
        self._draw(np.arange(len(self.aims.beliefs)))
        for turn in range(_ROUNDS):
            if not steps.size:
                break
            # The best single decision is best of all at no other price than its own.
            prices = self._next_prices(steps, self.price[steps] if turn == 0 else np.zeros(len(steps)))
            steps = steps[self._add(steps, prices)]
            if steps.size:
                self._draw(steps)

    def _draw(self, steps: np.ndarray) -> None:
        """Choose the best chord at the budget among the decisions known: A affordable, B not, or A alone."""
        known, limits = int(self.used.max()), self.aims.limits[steps]
        regrets, privacies = self.regrets[steps, :known], self.privacies[steps, :known]
        alone = np.where(regrets <= limits[:, None], privacies, -np.inf)
        found = best_mixtures(regrets, privacies, limits, np.isfinite(privacies))
        better = found.values > alone.max(axis=1) + tolerances.CHORD
        self.left[steps] = np.where(better, found.cheap, alone.argmax(axis=1))
        self.right[steps] = np.where(better, found.dear, _NONE)

    def _slopes(self, steps: np.ndarray) -> Array:
        """The slope of each chord; 0 for a decision alone."""
        left, right = self.left[steps], self.right[steps]
        run = self.regrets[steps, right] - self.regrets[steps, left]
        rise = self.privacies[steps, right] - self.privacies[steps, left]
        return np.asarray(np.where(right != _NONE, rise / np.where(right != _NONE, run, 1.0), 0.0))

    def _next_prices(self, steps: np.ndarray, own: Array) -> Array:
        """The slope of each chord; for a decision alone its price, 0 where it leaves budget over.

        A line through a decision with no known decision above it has a slope between the slopes to its two neighbours: the
        decision's own price where it is such a slope, else the middle.
        """
        left = (steps, self.left[steps])
        run = self.regrets[steps] - self.regrets[left][:, None]
        rise = self.privacies[steps] - self.privacies[left][:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = rise / run
        known = np.isfinite(slopes)
        low = np.where(known & (run > 0.0), slopes, 0.0).max(axis=1)
        high = np.where(known & (run < 0.0), slopes, np.inf).min(axis=1)
        middle = np.where(high < np.inf, 0.5 * (low + high), 2.0 * low)
        middle = np.where((own > low) & (own < high), own, middle)
        spends = self.regrets[left] >= self.aims.limits[steps] * (1.0 - tolerances.ROW_IN_REACH)
        return np.where(self.right[steps] != _NONE, self._slopes(steps), np.where(spends, middle, 0.0))

    def _add(self, steps: np.ndarray, prices: Array) -> np.ndarray:
        """Search at a price; keep what lies above the line of that slope through A, and return which beliefs gained."""
        left = steps, self.left[steps]
        levels = self.privacies[left] - prices * self.regrets[left]
        aims = cut(self.aims, steps)._replace(limits=np.full(len(steps), np.inf), prices=prices)
        reached = search(self.space, aims, starts_of(self.space, aims, _STARTS, self._ends(aims, steps)))
        values = values_of(reached)
        entries = np.argsort(-values, axis=1)[:, :_NEW]
        which, place = np.nonzero(np.take_along_axis(values, entries, axis=1) > levels[:, None] + tolerances.CHORD_GAIN)
        best, rows = read(self.space, aims, reached, which, entries[which, place]), steps[which]
        at = rows, self.used[rows] + np.arange(len(rows)) - np.searchsorted(rows, rows)  # rows are sorted
        self.actions[at], self.decoys[at], self.regions[at] = best.actions, best.decoys, best.regions
        self.regrets[at], self.privacies[at], self.polished[at] = best.regrets, best.privacies, True
        self.used[rows] = at[1] + 1
        gained = np.zeros(len(steps), dtype=np.bool_)
        gained[which] = True
        return gained

    def _ends(self, aims: Aims, steps: np.ndarray) -> list[SomeStarts]:
        """Starts at A and B; away from a point also at the decisions of the simplex's corners, the farthest beliefs."""
        parts = []
        if aims.sign > 0.0:
            rows, corner = (each.reshape(-1) for each in np.indices((len(steps), len(self.corners.belief))))
            _, regions, decoys, actions, _ = self.corners
            parts.append(starts_in(rows, regions[corner], decoys[corner], actions[corner]))
        for end in (self.left[steps], self.right[steps]):
            there = np.flatnonzero(end != _NONE)
            known = steps[there], end[there]
            parts.append(starts_in(there, self.regions[known], self.decoys[known], self.actions[known], FIRST))
        return parts

    def lotteries(self) -> Lotteries:
        """Return the lotteries."""
        steps = np.arange(len(self.left))
        double = self.right != _NONE
        ends = np.column_stack([self.left, np.where(double, self.right, self.left)])
        at, count = (np.repeat(steps, 2), ends.ravel()), len(steps)
        atoms = (column[at] for column in (self.actions, self.decoys, self.privacies, self.regrets))
        actions, decoys, privacies, regrets = (column.reshape(count, 2, *column.shape[1:]) for column in atoms)
        # Rounding must not carry the expected regret over the budget.
        spare = np.maximum(self.aims.limits * (1.0 - tolerances.BUDGET_SAFETY) - regrets[:, 0], 0.0)
        share = np.where(double, spare / np.where(double, regrets[:, 1] - regrets[:, 0], 1.0), 0.0)
        drawn = np.column_stack([share < 1.0, share > 0.0])
        prices = np.where(double, self._slopes(steps), self.price)
        polished = np.any(self.polished[at].reshape(count, 2) & drawn, axis=1)
        return Lotteries(actions, np.column_stack([1.0 - share, share]), regrets, privacies, decoys, prices, polished)
