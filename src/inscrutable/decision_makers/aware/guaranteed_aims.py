"""The objectives of a decision maker with guarantees: leakage, as rows of the same programme.

Each objective is a sum over decisions of a convex, homogeneous function of K(u|·), hence the supremum of linear functions,
which are added at the tables found (Kelley's cuts). With any law r of the belief, or any answer a, after a decision

    I(π;u) = Σ_m s_m,             s_m ≥ Σ_b w_b K_bm log(r_b/w_b),
    reduction of the observer's loss = Σ_m s_m,  s_m ≥ Σ_b w_b K_bm (ℓ_b(a₀) − ℓ_b(a)),

with equality for the posterior law and the best answer after the decision; a₀ is the best answer before it.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.aware.guaranteed_programme import (
    NO_COLUMN,
    SPARSE,
    PlayedGame,
    RowBlock,
    RowsAndCuts,
)
from inscrutable.decision_makers.aware.guarantees import of_columns
from inscrutable.privacy import Loss
from inscrutable.privacy.losses import DecisionLoss, on_simplex
from inscrutable.validation import Array


class ToldAim(RowsAndCuts):
    """An objective to be minimised, in a unit in which it lies between 0 and 1."""

    def __init__(self, unit: float, spread: float) -> None:
        self.unit, self.spread = unit, spread  # the spread is the largest possible leakage

    @abstractmethod
    def value(self, game: PlayedGame, table: Array) -> float:
        """Return the objective of a table K, in its own unit."""

    @abstractmethod
    def gains(self, game: PlayedGame, table: Array, which: np.ndarray) -> Array:
        """Return the gradients (B,n) in K of the linear functions that are exact at a table's decisions `which`."""

    @abstractmethod
    def first(self, game: PlayedGame) -> tuple[Array, np.ndarray]:
        """Return the first gradients (B,n), and the decision of each."""

    def rows(self, game: PlayedGame) -> RowBlock:
        """Rows that are there from the start."""
        return self._block(game, *self.first(game))

    def cuts(self, game: PlayedGame, table: Array) -> RowBlock | None:
        """Rows that are exact at a table's decisions, for these and their neighbours."""
        which = np.flatnonzero(game.played(table) > 0)
        near = game.near[which]
        return self._block(game, np.repeat(self.gains(game, table, which), near.shape[1], axis=1), near.ravel())

    def _block(self, game: PlayedGame, slopes: Array, which: np.ndarray) -> RowBlock:
        count, n_columns = len(which), game.shape[1]
        own = SPARSE.csr_array((np.ones(count), (np.arange(count), which)), shape=(count, n_columns))
        table = of_columns(slopes / self.unit, which, n_columns)
        nothing = np.zeros(count)
        return RowBlock(table, -own, nothing, nothing, np.full(count, NO_COLUMN), np.ones(n_columns))


class LeastInformation(ToldAim):
    """I(π;u), in nats; `start` is a table (B,M) of posterior laws to begin with."""

    def __init__(self, weights: Array, start: Array) -> None:
        entropy = float(-weights @ np.log(weights))
        super().__init__(max(entropy, 1.0), entropy)
        self._start = start

    def value(self, game: PlayedGame, table: Array) -> float:
        """Return Σ w K log(K/p(u))."""
        played = game.played(table)
        ratios = np.log(np.divide(table, played, out=np.ones_like(table), where=table > 0))
        return max(float(game.weights @ (table * ratios).sum(axis=1)), 0.0)

    def gains(self, game: PlayedGame, table: Array, which: np.ndarray) -> Array:
        """Return w_b log(r_b/w_b) with the posterior laws r; the prior's where u is not played."""
        chosen, played = table[:, which], game.played(table)[which]
        ratios = np.divide(chosen, played, out=np.ones_like(chosen), where=played > 0)
        return np.asarray(game.weights[:, None] * np.log((1.0 - tolerances.LEAST_LAW) * ratios + tolerances.LEAST_LAW))

    def at(self, game: PlayedGame, table: Array) -> RowBlock:
        """Return the rows that are exact at a table, of all decisions."""
        every = np.arange(game.shape[1])
        return self._block(game, self.gains(game, np.maximum(table, np.finfo(float).tiny), every), every)

    def first(self, game: PlayedGame) -> tuple[Array, np.ndarray]:
        """Return those of the first laws, and of the prior, the law where nothing leaks."""
        every = np.arange(game.shape[1])
        slopes = self.gains(game, self._start, every)
        return np.hstack([slopes, np.zeros_like(slopes)]), np.tile(every, 2)


class LeastWorth(ToldAim):
    """The reduction of the observer's loss by the decisions."""

    def __init__(self, loss: Loss, game: PlayedGame) -> None:
        self._loss = loss
        mean, n_states = game.weights @ game.beliefs, game.beliefs.shape[1]
        self._before = self._lost(game, mean[None])
        self._likely = np.vstack([mean[None], np.eye(n_states), 0.5 * np.eye(n_states) + 0.5 * mean])
        spread = float(game.weights @ self._before[:, 0])
        largest = float(np.abs(self._before - self._lost(game, self._likely)).max())
        if largest <= tolerances.NO_ERROR * float(
            np.abs(loss.least(game.beliefs)).max()
        ):  # one answer suits every belief
            spread = largest = 0.0
        super().__init__(max(spread, tolerances.LEAST_SPREAD * largest) or 1.0, spread)

    def _lost(self, game: PlayedGame, means: Array) -> Array:
        """The excess loss of the best answers to means (n,X) over the answer to the known belief, shape (B,n)."""
        if isinstance(self._loss, DecisionLoss):
            rival = self._loss.precise(game.beliefs.shape[1])
            costs = rival.state_costs(rival.solve(on_simplex(means)))
            return np.asarray(game.beliefs @ costs.T - np.atleast_1d(rival.optimal_cost(game.beliefs))[:, None])
        return game.squares(means)

    def value(self, game: PlayedGame, table: Array) -> float:
        """Return the reduction of the observer's loss by the decisions, at most the loss above that of the known belief."""
        which = np.flatnonzero(game.played(table) > 0)
        joint = game.weights[:, None] * table[:, which]
        return max(self.spread - float((joint * self._lost(game, game.means(table)[which])).sum()), 0.0)

    def gains(self, game: PlayedGame, table: Array, which: np.ndarray) -> Array:
        """Return w_b (ℓ_b(a₀) − ℓ_b(a)) with the best answers to the posterior means."""
        return np.asarray(game.weights[:, None] * (self._before - self._lost(game, game.means(table)[which])))

    def first(self, game: PlayedGame) -> tuple[Array, np.ndarray]:
        """Return those of the answers to each sure state, and of the answer before any decision."""
        slopes, n_columns = game.weights[:, None] * (self._before - self._lost(game, self._likely)), game.shape[1]
        return np.tile(slopes, (1, n_columns)), np.repeat(np.arange(n_columns), len(self._likely))


@dataclass(frozen=True, eq=False)
class Spending(RowsAndCuts):
    """Budgets: Σ_b share_kb Σ_m K_bm ρ_bm ≤ limits_k, for the rows k of shares (k,B)."""

    shares: Array
    limits: Array
    regrets: Array

    @property
    def unit(self) -> float:
        """The unit of excess: (spent − limit + largest limit)/unit lies between 0 and 1."""
        return float(self.limits.max() + self.regrets.max()) or 1.0

    def excess(self, table: Array) -> float:
        """Return the largest excess over a budget; negative where none is exceeded."""
        return float((self.spent(table) - self.limits).max())

    def spent(self, table: Array) -> Array:
        """Return Σ_b share_kb Σ_m K_bm ρ_bm, shape (k,)."""
        return np.asarray(self.shares @ (table * self.regrets).sum(axis=1))

    def _matrix(self) -> Array:
        n_beliefs, n_columns = self.regrets.shape
        return SPARSE.csr_array(self.shares) @ SPARSE.csr_array(  # type: ignore[no-any-return]
            (self.regrets.ravel(), (np.repeat(np.arange(n_beliefs), n_columns), np.arange(self.regrets.size)))
        )

    def rows(self, game: PlayedGame) -> RowBlock:
        """Every budget's row."""
        count = len(self.limits)
        nothing = SPARSE.csr_array((count, 0))
        unit = self.unit
        no_column = np.full(count, NO_COLUMN)
        return RowBlock(self._matrix() / unit, nothing, self.limits / unit, np.full(count, 1.0 / unit), no_column)


class LeastExcess(Spending):
    """The budgets as an objective: the least largest excess."""

    def value(self, game: PlayedGame, table: Array) -> float:
        """Return the largest excess plus the largest limit."""
        return self.excess(table) + float(self.limits.max())

    def rows(self, game: PlayedGame) -> RowBlock:
        """Every budget's row, and the largest excess."""
        count, unit = len(self.limits), self.unit
        sides = (self.limits - self.limits.max()) / unit
        ones = SPARSE.csr_array(np.ones((count, 1)))
        no_column, one = np.full(count, NO_COLUMN), np.ones(1)
        return RowBlock(self._matrix() / unit, -ones, sides, np.zeros(count), no_column, one)
