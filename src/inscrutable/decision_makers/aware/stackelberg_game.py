"""Estimation of beliefs from decisions as a zero-sum game: the gain of the rows, and bounds for both sides.

This module uses arrays alone. The error is F(K) = Σ p|π|² − Σ_m |a_m|²/w_m with a_m = Σ_b p_b K_bm π_b and w_m = Σ_b p_b K_bm.
It is concave in K. Estimates μ_m of all columns bound it by Σ_b p_b max_K Σ_m K_bm |π_b − μ_m|².
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable.decision_makers.envelope import Mixtures, best_mixtures
from inscrutable.validation import Array

_MOST_SPENT = 0.99
"""Share of what a row may spend beyond its least cost that a start spends at most: all of it would leave no interior. From .5
to .999 the 111 games of `stackelberg_newton` need between 1,973 and 2,034 steps."""
_TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Game:
    """Points of the beliefs (B,d), their weights (B,), costs (B,M) of which each row may spend 1, allowed places (B,M)."""

    points: Array
    weights: Array
    costs: Array
    allowed: np.ndarray

    @property
    def spread(self) -> float:
        """The prior's mean square error: an upper bound of every error."""
        return float(self.weights @ (self.points**2).sum(axis=1))

    def some(self, columns: np.ndarray) -> Game:
        """Return the same with some of the columns."""
        return Game(self.points, self.weights, self.costs[:, columns], self.allowed[:, columns])

    def gains(self, estimates: Array) -> Array:
        """Return |π_b − μ_m|², shape (B,M)."""
        squares = (self.points**2).sum(axis=1)[:, None] - 2.0 * self.points @ estimates.T + (estimates**2).sum(axis=1)
        return np.asarray(np.maximum(squares, 0.0))

    def moments(self, rows: Array) -> tuple[Array, Array]:
        """Return w (M,) and the posterior means μ (M,d) of rows; the prior mean, zero, where w = 0."""
        played = self.weights @ rows
        sums = (rows * self.weights[:, None]).T @ self.points
        return played, sums / np.maximum(played, _TINY)[:, None]

    def error(self, rows: Array) -> float:
        """Return F(K)."""
        played, means = self.moments(rows)
        return self.spread - float(played @ (means**2).sum(axis=1))

    def bound(self, estimates: Array) -> Mixtures:
        """Return the rows' best replies to fixed estimates: Σ p values bounds every error."""
        return best_mixtures(self.costs, self.gains(estimates), np.ones(len(self.weights)), self.allowed)


def centred_start(game: Game, centre: Array) -> tuple[Array, Array, Array]:
    """Return rows K that spend less than 1, levels ℓ and prices λ with ℓ_b + λ_b c_bm > |π_b|² wherever allowed.

    Every estimate is the prior mean, zero. With ℓ − |π|² = λ, both the row's centre (B,), rows K_bm ∝ 1/(1 + c_bm) make the
    products K_bm (ℓ_b + λ_b c_bm − |π_b|²) of a row equal. Rows that spend too much are mixed with their cheapest column.
    """
    costs = np.where(game.allowed, game.costs, 0.0)
    rows = game.allowed / (1.0 + costs)
    rows = rows / rows.sum(axis=1, keepdims=True)
    spent = (rows * costs).sum(axis=1)
    cheapest = np.zeros_like(rows)
    cheapest[np.arange(len(rows)), np.where(game.allowed, game.costs, np.inf).argmin(axis=1)] = 1.0
    least = (cheapest * costs).sum(axis=1)
    room = _MOST_SPENT * (1.0 - least)
    share = np.minimum(1.0, room / np.maximum(spent - least, _TINY))[:, None]
    return share * rows + (1.0 - share) * cheapest, centre + (game.points**2).sum(axis=1), centre
