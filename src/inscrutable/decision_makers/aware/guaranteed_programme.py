"""The cheapest table K(u|π) that gives some guarantees: a linear programme, with cutting planes for guarantees that are not
linear.

This module uses arrays alone. A guarantee is linear in K, or equivalent to infinitely many rows, which are added as cuts.
A mixture K'(·|π) = (1 − θ) K(·|π) + θ a, with a law a that does not depend on the belief, moves every posterior toward the
prior; so a table that violates its guarantees by the solver's tolerance is made feasible at almost no regret. The bound needs
no exact solution: with any prices y ≥ 0 of the rows A z ≤ b,

    least regret ≥ Σ_b min_m (c + A'y)_bm + Σ_j min(0, (A'y)_j) − b'y,

where z_j are the rows' own variables, each between 0 and 1.

Large programmes use column generation. First, decisions enter that are cheaper than a present decision for the beliefs that
play it. Then decisions of negative reduced cost enter. A reduced cost is a minimum over Σ_b w_b K_b = 1 under the decision's
own rows, at the prices α_b = min_m (c + A'y)_bm of the beliefs and the prices of the rows that all decisions share. If v is the
least reduced cost, the bound is too high by at most −min(0, v). Guarantees that need cuts, or compare with the optimal rule,
use no column generation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from inscrutable import tolerances
from inscrutable.linear_programmes import Rows, minimum
from inscrutable.validation import Array

SPARSE: Any = sparse
"""SciPy's sparse arrays as `Any`: their stubs overload a type checker."""

NO_COLUMN, SHARED = -1, -2
"""In the place of a row's column: the row has no column; the row is shared by all decisions."""

MOST_ROUNDS = 100
_NEAR = 4
"""Columns for which a cut is made, itself included. With one, of 29 rules for 6 to 20 beliefs three are no longer proved and
one value is 2.4 % worse, in 1.3 times the time; with twelve they take 1.2 times."""
_WHOLE = 15_000
"""Pairs of belief and decision up to which all decisions are there from the first: the bound is then exact. Nine rules for 84
to 136 beliefs take 2.3 times as long if all are always there, and .57 of the time if they never are, but then single ones
3.9 times, with gaps up to 4e-5 instead of 0."""
_FIRST, _PREFERRED, _TEMPTING = 24, 6, 12
"""Decisions at first, and how many enter at a time. With 8 at first these nine take as long; with 72, 1.65 times; with 2 or 18
preferred 1.1 and 1.0 times, with 4 or 36 tempting 1.06 and 1.0."""
_FRESH = 3
"""Rounds that a decision of probability 0 stays, unless it entered for its reduced cost. If it stays for ever, floors of the
naming error for 120 and 231 beliefs take 1.3 times as long, other rules as long; with one round single rules take 1.8
times."""


@dataclass(frozen=True, eq=False)
class PlayedGame:
    """Beliefs with weight (B,X), their weights (B,), the law of the optimal rule's decisions (M,), and the neighbours of each
    column (M,k), itself included: a cut is made for all of them, or probability would only move to the next one."""

    beliefs: Array
    weights: Array
    honest: Array
    near: np.ndarray

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of beliefs and of decisions."""
        return len(self.weights), len(self.honest)

    def played(self, table: Array) -> Array:
        """Return p(u) of a table K, shape (M,)."""
        return np.asarray(self.weights @ table)

    def means(self, table: Array) -> Array:
        """Return E[π|u], shape (M,X); the prior's mean where u is not played."""
        sums, played = (table * self.weights[:, None]).T @ self.beliefs, self.played(table)
        means = sums / np.where(played > 0, played, 1.0)[:, None]
        return np.asarray(np.where((played > 0)[:, None], means, self.weights @ self.beliefs))

    def square_errors(self, table: Array) -> Array:
        """Return E[‖π − E[π|u]‖² | u], shape (M,); the prior's where u is not played."""
        means, played = self.means(table), self.played(table)
        laws = np.where(
            played > 0, table * self.weights[:, None] / np.where(played > 0, played, 1.0), self.weights[:, None]
        )
        return np.asarray(np.einsum("bm,bm->m", laws, self.squares(means)))

    def squares(self, means: Array) -> Array:
        """Return ‖π_b − μ_m‖², shape (B,M)."""
        return np.asarray(((self.beliefs[:, None, :] - means[None]) ** 2).sum(axis=2))


class RowBlock(NamedTuple):
    """Rows Σ table·K + extra·z ≤ sides, with z ∈ [0,1] the block's own."""

    table: Any  # sparse (n, B·M)
    extra: Any  # sparse (n, k)
    sides: Array  # (n,)
    slopes: Array  # (n,): derivative of the row's side in the guarantee's limit, over p(u) of its column
    columns: np.ndarray  # (n,): the row's column; NO_COLUMN or SHARED where it has none
    costs: Any = None  # (k,): cost of each z in the objective; None for 0


class RowsAndCuts(ABC):
    """The programme's interface to a guarantee, a budget or an objective: rows, and cuts at a table."""

    is_by_decision = False
    """Whether absent decisions can be priced: there are no cuts, and no comparison with another law."""

    def largest_ratio(self, game: PlayedGame) -> float | None:
        """The largest K_bm/p(u_m) allowed, if the rows limit only that and the largest K_bm; else None."""
        return None

    @abstractmethod
    def rows(self, game: PlayedGame) -> RowBlock:
        """Rows of the programme that are there from the start."""

    def cuts(self, game: PlayedGame, table: Array) -> RowBlock | None:
        """Rows that a table violates; None where it violates none."""
        return None

    def toward_prior(self, game: PlayedGame, table: Array) -> Array:
        """Least share (M,) by which each column must be mixed with one that does not depend on the belief."""
        return np.zeros(game.shape[1])

    def toward_honest(self, game: PlayedGame, table: Array) -> float:
        """Least share of the optimal rule's law, drawn independently of the belief, that must be mixed in."""
        return 0.0


class Solved(NamedTuple):
    """A table that gives the guarantees, its regret, a bound of the least one, and the price of each guarantee."""

    table: Array
    regret: float
    bound: float
    prices: tuple[float, ...]


def cheapest_table(game: PlayedGame, regrets: Array, rules: tuple[RowsAndCuts, ...], goal: float) -> Solved:
    """Return the cheapest table that gives all the guarantees, with a gap between regret and bound of `goal` if reached."""
    return TableSearch(game, regrets, rules, goal).run()


class TableSearch:
    """The present decisions and rows, which grow, and the best table so far."""

    def __init__(self, game: PlayedGame, regrets: Array, rules: tuple[RowsAndCuts, ...], goal: float) -> None:
        self.game, self.regrets, self.rules, self.goal = game, regrets, rules, goal
        self.unit = max(float(regrets.max()), tolerances.TINY)
        self.objective = game.weights[:, None] * regrets / self.unit
        self.blocks = [[rule.rows(game)] for rule in rules]
        silent = np.zeros(game.shape)
        silent[:, int((game.weights @ regrets).argmin())] = 1.0
        self.best = repaired(game, silent, rules)
        self.value, self.bound = self._worth(self.best), 0.0
        self.prices: tuple[float, ...] = (0.0,) * len(rules)
        self.age = np.full(game.shape[1], _FRESH)  # rounds since a decision had a probability above 0
        self.age[self._first()] = 0
        self.centre: Array | None = (
            None  # the prices of the best bound: of beliefs, of the largest entries, and the latter paid
        )

    def _first(self) -> np.ndarray:
        if self.regrets.size <= _WHOLE or not self.rules or not all(rule.is_by_decision for rule in self.rules):
            return np.arange(self.game.shape[1])
        chosen = [int((self.game.weights @ self.regrets).argmin())]
        least = self.regrets[:, chosen[0]]
        while len(chosen) < _FIRST:
            spared = self.game.weights @ np.maximum(least[:, None] - self.regrets, 0.0)
            chosen.append(int(spared.argmax()))
            least = np.minimum(least, self.regrets[:, chosen[-1]])
        return np.array(chosen)

    def run(self) -> Solved:
        """Solve, and add rows and decisions, until regret and bound meet or nothing is left to add."""
        for _ in range(MOST_ROUNDS):
            columns = np.flatnonzero(self.age < _FRESH)
            found = solved_programme(self.game, self.objective, self.blocks, columns)
            self._keep(found.table)
            self.age += 1
            is_played = self.game.played(found.table) > 0
            self.age[is_played] = np.minimum(self.age[is_played], 0)
            has_cuts, is_whole = self._cut(found.table), len(columns) == len(self.age)
            added = np.empty(0, np.int64) if is_whole else self._preferred(found.table, columns)
            if is_whole:
                self.age[:] = 0
                self._bounded(found, 0.0)
            elif not has_cuts and not added.size:
                added, least = self._tempting(found, columns)
                self.age[columns] = self.age[added] = -MOST_ROUNDS
                self._bounded(found, min(least, 0.0))
            if self.value - self.bound <= self.goal or not (has_cuts or added.size):
                break
            self.age[added] = np.minimum(self.age[added], 0)
        return Solved(self.best, self.value, min(self.bound, self.value), self.prices)

    def _keep(self, table: Array) -> None:
        """Keep a table if its repaired one is the best so far."""
        found = repaired(self.game, table, self.rules)
        regret = self._worth(found)
        if regret < self.value:
            self.best, self.value = found, regret

    def _worth(self, table: Array) -> float:
        """The objective."""
        return float(self.game.weights @ (table * self.regrets).sum(axis=1))

    def _bounded(self, found: _Found, least: float) -> None:
        if self.unit * (found.low + least) >= self.bound:
            self.bound = self.unit * (found.low + least)
            self.prices = tuple(self.unit * price for price in found.prices)

    def _cut(self, table: Array) -> bool:
        """Add the rows that a table violates; return whether there are any."""
        added = [rule.cuts(self.game, table) for rule in self.rules]
        for block, cut in zip(self.blocks, added, strict=True):
            if cut is not None:
                block.append(cut)
        return any(cut is not None for cut in added)

    def _preferred(self, table: Array, columns: np.ndarray) -> np.ndarray:
        """Absent decisions cheaper on average than a present one for the beliefs that play it, the largest saving first."""
        played = self.game.played(table)
        joint = self.game.weights[:, None] * table[:, played > 0]
        saved = (joint * self.regrets[:, played > 0]).sum(axis=0)[:, None] - joint.T @ self.regrets
        most = saved.max(axis=0)
        most[columns] = 0.0
        order = np.argsort(-most)[:_PREFERRED]
        return np.asarray(order[most[order] > 0.1 * self.goal])

    def _tempting(self, found: _Found, columns: np.ndarray) -> tuple[np.ndarray, float]:
        """Absent decisions of negative reduced cost at these prices, and the least reduced cost; −∞ where not all were
        tried."""
        others = np.setdiff1d(np.arange(self.game.shape[1]), columns)
        ratios = [rule.largest_ratio(self.game) for rule in self.rules]
        if None not in ratios:
            return self._tempting_ratios(found, others, min(each for each in ratios if each is not None))
        wide = [stacked(group) for group in self.blocks]
        likely = self._likely(found, others)
        tempting, values = [], []
        for m in others[np.argsort(likely)]:
            values.append(_least_of(self.game, self.objective[:, m] - found.levels, (wide, found.duals), int(m)))
            if self.unit * values[-1] < -0.5 * self.goal:
                tempting.append(int(m))
                if len(tempting) == _TEMPTING:
                    return np.array(tempting), -np.inf
        return np.array(tempting, dtype=np.int64), min(values, default=0.0)

    def _tempting_ratios(self, found: _Found, others: np.ndarray, ratio: float) -> tuple[np.ndarray, float]:
        """The same by closed forms, at these prices and between them and the best so far.

        Optimal prices are often not unique and jump between rounds; averages of them give a better bound
        (Wentges, Weighted Dantzig–Wolfe decomposition, 1997).
        """
        duals = [dual[_shared(group)] for group, dual in zip(self.blocks, found.duals, strict=True)]
        sides = [np.concatenate([block.sides for block in group])[_shared(group)] for group in self.blocks]
        price = sum(float(each.sum()) for each in duals)
        now = np.concatenate([found.levels, [price, sum(float(a @ b) for a, b in zip(duals, sides, strict=True))]])
        best, tempting = -np.inf, []
        for share in (0.0, 0.3, 0.6, 0.9, 1.0) if self.centre is not None else (0.0,):
            prices = now if self.centre is None else share * self.centre + (1.0 - share) * now
            costs = self.objective - prices[:-2, None]
            least = least_of_ratios(self.game.weights, costs, ratio, float(prices[-2]))
            bound = float(prices[:-2].sum() - prices[-1] + least.min(initial=0.0))
            if share == 0.0:  # the programme bounds the present decisions more tightly
                bound = max(bound, found.low + float(least[others].min(initial=0.0)))
            if share < 1.0:
                order = others[np.argsort(least[others])[: _TEMPTING // 2]]
                tempting.append(order[self.unit * least[order] < -0.5 * self.goal])
            if bound > best:
                best, centre = bound, prices
        self.centre = centre
        return np.unique(np.concatenate(tempting[:1] + tempting[-1:])), best - found.low

    def _likely(self, found: _Found, others: np.ndarray) -> Array:
        """A lower bound of the extra cost of each absent decision to the beliefs that play a present one."""
        played = self.game.played(found.table)
        laws = self.game.weights[:, None] * found.table[:, played > 0] / played[played > 0]
        own = (laws * self.regrets[:, played > 0]).sum(axis=0)[:, None]
        return np.asarray((laws.T @ self.regrets[:, others] - own).min(axis=0))


def nearest_columns(regrets: Array) -> np.ndarray:
    """Return for every column (B,M) the few that cost about the same under every belief, itself first, shape (M,k)."""
    few = min(_NEAR, regrets.shape[1])
    place = cKDTree(regrets.T).query(regrets.T, k=few)[1].reshape(-1, few)
    place[:, 0] = np.arange(len(place))
    return np.asarray(place)


class _Found(NamedTuple):
    """A table that solves a programme on some decisions, a lower bound of its value on these, and prices."""

    table: Array  # (B,M)
    low: float
    prices: list[float]  # of the guarantees
    levels: Array  # α (B,)
    duals: list[Array]  # of every guarantee's rows


def solved_programme(game: PlayedGame, objective: Array, blocks: list[list[RowBlock]], columns: np.ndarray) -> _Found:
    """Return the solution of the programme of these rows on some of the decisions."""
    n_beliefs, n_columns = len(game.weights), len(columns)
    size = n_beliefs * n_columns
    wide = [stacked(group) for group in blocks]
    parts, kept = zip(*(_on_columns(block, game.shape, columns) for block in wide), strict=True) if wide else ((), ())
    table = SPARSE.vstack([part.table for part in parts]).tocsr() if wide else SPARSE.csr_array((0, size))
    extra = SPARSE.block_diag([part.extra for part in parts]).tocsr() if wide else SPARSE.csr_array((0, 0))
    rows = Rows(SPARSE.hstack([table, extra]).tocsr(), np.concatenate([np.zeros(0), *(part.sides for part in parts)]))
    sums = SPARSE.kron(SPARSE.identity(n_beliefs), np.ones((1, n_columns)))
    costs = objective[:, columns].ravel()
    aimed = [np.zeros(part.extra.shape[1]) if part.costs is None else part.costs for part in parts]
    costs = np.concatenate([costs, *aimed])
    found = minimum(
        costs,
        rows,
        Rows(SPARSE.hstack([sums, SPARSE.csr_array((n_beliefs, extra.shape[1]))]).tocsr(), np.ones(n_beliefs)),
        (0.0, 1.0),
        interior=n_columns < game.shape[1],
    )
    shares = np.zeros(game.shape)
    shares[:, columns] = np.maximum(found.x[:size].reshape(n_beliefs, n_columns), 0.0)
    rare = game.played(shares) < tolerances.RARELY_PLAYED
    rare[shares.argmax(axis=1)] = False  # what a belief of tiny weight plays most is as rare as the belief
    shares[:, rare] = 0.0
    shares /= shares.sum(axis=1, keepdims=True)
    duals = np.maximum(-found.duals, 0.0)
    paid = (costs[:size] + rows.matrix[:, :size].T @ duals).reshape(n_beliefs, n_columns)
    low = lower_bound((n_beliefs, n_columns), costs, rows, duals)
    played, prices, every, start = game.played(shares), [], [], 0
    for block, part, some in zip(wide, parts, kept, strict=True):
        here = duals[start : start + len(part.sides)]
        factors = np.where(part.columns >= 0, played[np.maximum(part.columns, 0)], 1.0)
        prices.append(float(here @ (part.slopes * factors)))
        every.append(np.zeros(len(block.sides)))
        every[-1][some] = here
        start += len(part.sides)
    return _Found(shares, low, prices, paid.min(axis=1), every)


def _on_columns(block: RowBlock, shape: tuple[int, int], columns: np.ndarray) -> tuple[RowBlock, np.ndarray]:
    """The rows on some of the decisions, without rows that do not involve them, and which rows are left."""
    if len(columns) == shape[1]:
        return block, np.arange(len(block.sides))
    places = (np.arange(shape[0])[:, None] * shape[1] + columns).ravel()
    table = block.table.tocsc()[:, places].tocsr()
    extra = block.extra.tocsc()[:, columns].tocsr() if block.extra.shape[1] else block.extra
    some = np.flatnonzero((np.diff(table.indptr) > 0) | (np.diff(extra.tocsr().indptr) > 0))
    sides, slopes, places_of_rows = (part[some] for part in (block.sides, block.slopes, block.columns))
    costs = block.costs[columns] if block.costs is not None else None
    return RowBlock(table[some], extra.tocsr()[some], sides, slopes, places_of_rows, costs), some


def _least_of(game: PlayedGame, costs: Array, known: tuple[list[RowBlock], list[Array]], column: int) -> float:
    """The least Σ_b K_b costs_b of one decision that keeps its own rows, Σ_b w_b K_b = 1, with the shared rows at their prices.

    Rows without a price that only allow more are left out, and own variables have no upper bound: this can only lower it.
    """
    tables, extras, added = [], [], []
    for block, duals in zip(*known, strict=True):
        part, some = _on_columns(block, game.shape, np.array([column]))
        shared = part.columns == SHARED
        own = ~shared & (part.sides <= 0.0)
        tables.append(part.table[own])
        extras.append(part.extra[own])
        added.append(np.asarray(part.extra[shared].T @ duals[some][shared]).reshape(-1))
    table, extra = SPARSE.vstack(tables), SPARSE.block_diag(extras)
    rows = SPARSE.hstack([table, extra]).tocsr()
    whole = np.append(game.weights, np.zeros(extra.shape[1]))[None]
    below = Rows(rows, np.zeros(rows.shape[0]))
    return minimum(np.concatenate([costs, *added]), below, Rows(whole, np.ones(1)), (0.0, None)).value


def _shared(group: list[RowBlock]) -> np.ndarray:
    return np.asarray(np.concatenate([block.columns for block in group]) == SHARED)


def least_of_ratios(weights: Array, costs: Array, ratio: float, price: float) -> Array:
    """Return min Σ_b K_b costs_b + price · max_b K_b of every column (B,M), Σ_b w_b K_b = 1, 0 ≤ K_b ≤ ratio: shape (M,).

    With K_b ≤ t, those of least cost per weight have K_b = t, and the next one the remainder. The value is piecewise linear in
    t with breaks where the remainder is 0, so that the least is at a break or at t = ratio.
    """
    order = np.argsort(costs / weights[:, None], axis=0, kind="stable")
    share = np.cumsum(weights[order], axis=0)
    paid = np.cumsum(np.take_along_axis(costs, order, axis=0), axis=0)
    least = np.where(share * ratio >= 1.0, (paid + price) / share, np.inf).min(axis=0)
    if not np.isfinite(ratio):
        return np.asarray(least)
    full = (share * ratio <= 1.0).sum(axis=0)  # number of beliefs with K_b = ratio
    last, which = np.minimum(full, len(weights) - 1), np.arange(costs.shape[1])
    before = np.where(full > 0, np.take_along_axis(paid, np.maximum(full - 1, 0)[None], axis=0)[0], 0.0)
    held = np.where(full > 0, np.take_along_axis(share, np.maximum(full - 1, 0)[None], axis=0)[0], 0.0)
    next_one = costs[order[last, which], which] / weights[order[last, which]]
    return np.asarray(
        np.minimum(least, ratio * before + np.maximum(1.0 - ratio * held, 0.0) * next_one + price * ratio)
    )


def lower_bound(shape: tuple[int, int], objective: Array, rows: Rows, prices: Array) -> float:
    """Return a lower bound of the cost of every table that keeps the rows, from any prices ≥ 0 of the rows.

    Each row of the table is a law, so that its least entry bounds it; the rows' own variables lie between 0 and 1.
    """
    paid, size = np.asarray(rows.matrix.T @ prices), shape[0] * shape[1]
    paid[: objective.size] += objective
    return float(
        paid[:size].reshape(shape).min(axis=1).sum() + np.minimum(paid[size:], 0.0).sum() - rows.sides @ prices
    )


def stacked(group: list[RowBlock]) -> RowBlock:
    """Return blocks of rows as one."""
    table, extra = (SPARSE.vstack([each[part] for each in group]).tocsr() for part in (0, 1))
    sides, slopes, columns = (np.concatenate([each[part] for each in group]) for part in (2, 3, 4))
    return RowBlock(table, extra, sides, slopes, columns, group[0].costs)


def repaired(game: PlayedGame, table: Array, rules: tuple[RowsAndCuts, ...]) -> Array:
    """Return the table with the least mixture that gives every guarantee.

    Either each decision is mixed by its own share, which changes how often it is played, or all by the largest share.
    """
    share = np.max([np.zeros(game.shape[1]), *(rule.toward_prior(game, table) for rule in rules)], axis=0)
    most, played = float(share.max()), game.played(table)
    ways = [(1.0 - most, (1.0 - most) * table + most * played)]  # what is left of the table, and the mixture
    if most < 1.0:
        mixed = share / (1.0 - share) * played
        left = 1.0 / (1.0 + mixed.sum())
        ways.insert(0, (left, left * (table + mixed)))
    parts = [max([0.0, *(rule.toward_honest(game, each) for rule in rules)]) for _, each in ways]
    part, (_, least) = max(zip(parts, ways, strict=True), key=lambda way: (1.0 - way[0]) * way[1][0])
    return (1.0 - part) * least + part * game.honest
