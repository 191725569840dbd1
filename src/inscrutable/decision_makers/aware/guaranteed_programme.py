"""The cheapest table K(u|π) that gives some guarantees: a linear programme, with cutting planes for what is no row.

On arrays alone. A guarantee is linear in K, or holds where all of infinitely many rows do, which are found as they are needed.
Playing what another belief would have played, K'(·|π) = (1 − θ) K(·|π) + θ a with a law a that looks at no belief, moves
every posterior toward the prior; so a table that misses its guarantees by the tolerance of a solver is repaired at the cost
of next to nothing. The bound needs no exact solution: with any prices y ≥ 0 of the rows A z ≤ b,

    least regret ≥ Σ_b min_m (c + A'y)_bm + Σ_j min(0, (A'y)_j) − b'y,

where z_j are what rows need beside K, each between 0 and 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from inscrutable import tolerances
from inscrutable.linear_programmes import Rows, minimum
from inscrutable.validation import Array

SPARSE: Any = sparse
"""Its stubs are too many for a type checker."""

_MOST_ROUNDS = 100
_NEAR = 4


@dataclass(frozen=True, eq=False)
class PlayedGame:
    """Beliefs with weight (B,X), their weights (B,), the law of what the optimal rule publishes (M,), and columns that are
    near each one (M,k), itself among them: a cut is made for all of them, for mass would only move from one to the next."""

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
    slopes: Array  # (n,): how fast a row gives way where its guarantee does, times p(u) of its column
    columns: np.ndarray  # (n,): the row's column; −1 where it has none


class RowsAndCuts(Protocol):
    """A guarantee as the programme reads it."""

    def rows(self, game: PlayedGame) -> RowBlock:
        """Rows that are there from the start."""

    def cuts(self, game: PlayedGame, table: Array) -> RowBlock | None:
        """Rows that a table breaks; None where it breaks none."""

    def toward_prior(self, game: PlayedGame, table: Array) -> Array:
        """Least share θ (M,) by which each column must be mixed with one that looks at no belief."""

    def toward_honest(self, game: PlayedGame, table: Array) -> float:
        """Least share of the optimal rule's law, drawn without a look at the belief, that must be mixed in."""


class Solved(NamedTuple):
    """A table that gives the guarantees, its regret, a bound of the least one, and the price of each guarantee."""

    table: Array
    regret: float
    bound: float
    prices: tuple[float, ...]


def cheapest_table(game: PlayedGame, regrets: Array, rules: tuple[RowsAndCuts, ...], goal: float) -> Solved:
    """Return the cheapest table that gives all the guarantees; its regret and bound differ by at most `goal` if it can be."""
    unit = max(float(regrets.max()), tolerances.TINY)
    objective = (game.weights[:, None] * regrets / unit).ravel()
    blocks = [[rule.rows(game)] for rule in rules]
    silent = np.zeros(game.shape)
    silent[:, int((game.weights @ regrets).argmin())] = 1.0
    best = _repaired(game, silent, rules)
    value, bound = _regret(game, regrets, best), 0.0
    prices: tuple[float, ...] = (0.0,) * len(rules)
    for _ in range(_MOST_ROUNDS):
        table, low, prices_now = _solve(game, objective, blocks)
        if low * unit >= bound:
            bound, prices = low * unit, tuple(unit * price for price in prices_now)
        repaired = _repaired(game, table, rules)
        regret = _regret(game, regrets, repaired)
        if regret < value:
            best, value = repaired, regret
        if value - bound <= goal:
            break
        added = [rule.cuts(game, table) for rule in rules]
        if all(cut is None for cut in added):
            break
        for block, cut in zip(blocks, added, strict=True):
            if cut is not None:
                block.append(cut)
    return Solved(best, value, min(bound, value), prices)


def nearest_columns(regrets: Array) -> np.ndarray:
    """Return for every column (B,M) the few that cost about the same under every belief, itself first, shape (M,k)."""
    few = min(_NEAR, regrets.shape[1])
    place = cKDTree(regrets.T).query(regrets.T, k=few)[1].reshape(-1, few)
    place[:, 0] = np.arange(len(place))
    return np.asarray(place)


def _regret(game: PlayedGame, regrets: Array, table: Array) -> float:
    return float(game.weights @ (table * regrets).sum(axis=1))


def _solve(game: PlayedGame, objective: Array, blocks: list[list[RowBlock]]) -> tuple[Array, float, list[float]]:
    """A table that solves the programme of these rows, a lower bound of its value, and the guarantees' prices."""
    n_beliefs, n_columns = game.shape
    size = n_beliefs * n_columns
    wide = [_stacked(group) for group in blocks]
    table = SPARSE.vstack([block.table for block in wide]).tocsr() if wide else SPARSE.csr_array((0, size))
    extra = SPARSE.block_diag([block.extra for block in wide]).tocsr() if wide else SPARSE.csr_array((0, 0))
    sides = np.concatenate([np.zeros(0), *(block.sides for block in wide)])
    sums = SPARSE.kron(SPARSE.identity(n_beliefs), np.ones((1, n_columns)))
    found = minimum(
        np.concatenate([objective, np.zeros(extra.shape[1])]),
        Rows(SPARSE.hstack([table, extra]).tocsr(), sides),
        Rows(SPARSE.hstack([sums, SPARSE.csr_array((n_beliefs, extra.shape[1]))]).tocsr(), np.ones(n_beliefs)),
        (0.0, 1.0),
    )
    shares = np.maximum(found.x[:size].reshape(n_beliefs, n_columns), 0.0)
    shares[:, game.played(shares) < tolerances.RARELY_PLAYED] = 0.0
    shares /= shares.sum(axis=1, keepdims=True)
    duals = np.maximum(-found.duals, 0.0)
    low = lower_bound(game.shape, objective, Rows(SPARSE.hstack([table, extra]).tocsr(), sides), duals)
    played, prices, start = game.played(shares), [], 0
    for block in wide:
        here = duals[start : start + len(block.sides)]
        factors = np.where(block.columns >= 0, played[block.columns], 1.0)
        prices.append(float(here @ (block.slopes * factors)))
        start += len(block.sides)
    return shares, low, prices


def lower_bound(shape: tuple[int, int], objective: Array, rows: Rows, prices: Array) -> float:
    """Return what no table that keeps the rows is cheaper than, by any prices ≥ 0 of the rows.

    Each row of the table is a law, so that its least entry bounds it; whatever else the rows need lies between 0 and 1.
    """
    paid = np.asarray(rows.matrix.T @ prices)
    reduced = (objective + paid[: objective.size]).reshape(shape)
    return float(reduced.min(axis=1).sum() + np.minimum(paid[objective.size :], 0.0).sum() - rows.sides @ prices)


def _stacked(group: list[RowBlock]) -> RowBlock:
    return RowBlock(
        *(SPARSE.vstack([each[part] for each in group]).tocsr() for part in (0, 1)),
        *(np.concatenate([each[part] for each in group]) for part in (2, 3, 4)),
    )


def _repaired(game: PlayedGame, table: Array, rules: tuple[RowsAndCuts, ...]) -> Array:
    """The table with as little mixed in as it takes to give every guarantee."""
    share = np.max([np.zeros(game.shape[1]), *(rule.toward_prior(game, table) for rule in rules)], axis=0)
    if (share >= 1.0).any():  # the prior gives no more than what is asked for
        table = np.tile(game.played(table), (len(table), 1))
    else:
        mixed = share / (1.0 - share) * game.played(table)
        table = (table + mixed) / (1.0 + mixed.sum())
    part = max([0.0, *(rule.toward_honest(game, table) for rule in rules)])
    return (1.0 - part) * table + part * game.honest
