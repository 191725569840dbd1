"""The mechanism of largest Bayes error on few columns: a primal–dual interior-point method with little linear algebra.

On arrays alone. The error is F(K) = Σ p|π|² − Σ_m |a_m|²/w_m with a_m = Σ_b p_b K_bm π_b and w_m = Σ_b p_b K_bm: concave,
and it couples the rows through the moments a_m alone. A Newton step is a diagonal solve per row and one system in the
M·(X−1) moments.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.row_envelopes import Envelopes, row_envelopes
from inscrutable.validation import Array

_MOST_STEPS = 100
_TO_BOUNDARY = 0.98
_MOST_CENTRED = 0.8
_REFINED = 2
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
        """The prior's mean square error: what nothing can exceed."""
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

    def bound(self, estimates: Array) -> Envelopes:
        """Return the rows' best answers to fixed estimates: Σ p values bounds every error."""
        return row_envelopes(self.costs, self.gains(estimates), np.ones(len(self.weights)), self.allowed)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Rows (B,M) and their error, posterior means (M,d), and per row the price of its budget and its level: no column
    offers a row more than level + price · cost, as far as the method has come.
    """

    rows: Array
    error: float
    estimates: Array
    prices: Array
    levels: Array


def interior_start(game: Game) -> Array:
    """Return rows that play every allowed column and spend about half of the budget."""
    even = game.allowed / game.allowed.sum(axis=1, keepdims=True)
    costs = np.where(game.allowed, game.costs, 0.0)
    cheapest = np.zeros_like(even)
    cheapest[np.arange(len(even)), np.where(game.allowed, game.costs, np.inf).argmin(axis=1)] = 1.0
    dear, cheap = (even * costs).sum(axis=1), (cheapest * costs).sum(axis=1)
    share = np.minimum(0.9, 0.5 * (1.0 - cheap) / np.maximum(dear - cheap, _TINY))[:, None]
    return np.asarray(share * even + (1.0 - share) * cheapest)


class _State:
    """Rows, budget slacks and their multipliers."""

    def __init__(self, game: Game, rows: Array, centre: float) -> None:
        self.game = game
        self.costs = np.where(game.allowed, game.costs, 0.0)
        self.rows = rows
        self.slack = 1.0 - (rows * self.costs).sum(axis=1)
        self.duals = np.where(game.allowed, centre / np.where(game.allowed, rows, 1.0), 0.0)
        self.prices = centre / self.slack
        self.pairs = game.weights @ (game.allowed.sum(axis=1) + 1.0)

    @property
    def safe_rows(self) -> Array:
        return np.where(self.game.allowed, self.rows, 1.0)

    def distance(self) -> float:
        """Return the mean complementarity."""
        each = (self.duals * self.rows).sum(axis=1) + self.prices * self.slack
        return float(self.game.weights @ each / self.pairs)


class _Moves:
    """Newton's system at one state, made once for the predictor and the corrector."""

    def __init__(self, state: _State, played: Array, means: Array) -> None:
        self.state = state
        game, costs = state.game, state.costs
        n_rows, n_columns = costs.shape
        self.inverse = np.where(game.allowed, state.rows / np.where(game.allowed, state.duals, 1.0), 0.0)
        self.ones = self.inverse.sum(axis=1)
        # Costs about their mean in each row's own metric: the two linear forms are then orthogonal, and nothing cancels.
        self.costs = costs - ((self.inverse * costs).sum(axis=1) / self.ones)[:, None]
        self.loose = state.slack / state.prices
        self.spread = (self.inverse * self.costs**2).sum(axis=1) + self.loose
        self.away = game.points[:, None, :] - means[None]
        size = game.points.shape[1]
        scaled = self.away * self.inverse[:, :, None]
        by_one = scaled.reshape(n_rows, -1) * np.sqrt(game.weights / self.ones)[:, None]
        by_cost = (scaled * self.costs[:, :, None]).reshape(n_rows, -1) * np.sqrt(game.weights / self.spread)[:, None]
        joint = np.vstack([by_one, by_cost])
        system = -(joint.T @ joint)
        for i in range(size):
            for j in range(size):
                own = game.weights @ (self.away[:, :, i] * scaled[:, :, j])
                system[np.arange(n_columns) * size + i, np.arange(n_columns) * size + j] += own
        system[np.diag_indices(len(system))] += np.repeat(played / 2.0, size)
        # Moments of hardly played columns are tiny: every one is measured in its own unit.
        self.units = 1.0 / np.sqrt(np.maximum(np.diag(system), _TINY))
        self.system = system * self.units[:, None] * self.units

    def _projected(self, aim: Array) -> Array:
        level = (self.inverse * aim).sum(axis=1) / self.ones
        price = (self.inverse * aim * self.costs).sum(axis=1) / self.spread
        move = self.inverse * (aim - level[:, None] - price[:, None] * self.costs)
        for _ in range(_REFINED):  # a row with few atoms left has hardly a way to go: its two conditions say which
            ones = move.sum(axis=1) / self.ones
            excess = ((move * self.costs).sum(axis=1) - price * self.loose) / self.spread
            price = price + excess
            move -= self.inverse * (ones[:, None] + excess[:, None] * self.costs)
        return np.asarray(move)

    def towards(self, gains: Array, centre: Array, slack_centre: Array) -> tuple[Array, Array, Array, Array]:
        """Return the changes of rows, slacks, duals and prices that aim at these complementarities."""
        state = self.state
        game, safe = state.game, state.safe_rows
        aim = gains + centre / safe - (slack_centre / state.slack)[:, None] * state.costs
        first = self._projected(aim)
        sums = np.einsum("bmx,bm->mx", self.away, game.weights[:, None] * first).reshape(-1)
        turn = (self.units * np.linalg.solve(self.system, self.units * sums)).reshape(self.away.shape[1:])
        move = self._projected(aim - np.einsum("bmx,mx->bm", self.away, turn))
        spare = -(state.costs * move).sum(axis=1)
        duals = np.where(game.allowed, centre / safe - state.duals - state.duals / safe * move, 0.0)
        prices = slack_centre / state.slack - state.prices - state.prices / state.slack * spare
        return move, spare, duals, prices


def _longest(values: Array, move: Array) -> float:
    worst = float((-move / values).max(initial=0.0))
    return 1.0 if worst <= 0 else 1.0 / worst


def equilibrium(game: Game, goal: float) -> Equilibrium:
    """Return rows whose error is about `goal` of it below the largest, or as near as they come."""
    state = _State(game, interior_start(game), 0.5 * game.spread)
    best = state.rows, state.prices
    for _ in range(_MOST_STEPS):
        played, means = game.moments(state.rows)
        left = state.distance() * state.pairs
        if left <= 0.2 * (goal * game.error(state.rows) + tolerances.NO_ERROR * game.spread):
            break
        try:
            if not _stepped(state, _Moves(state, played, means), game.gains(means)):
                break
        except np.linalg.LinAlgError:
            break
        if state.distance() * state.pairs <= left:
            best = state.rows, state.prices
    rows, prices = best
    _, means = game.moments(rows)
    levels = (rows * (game.gains(means) - prices[:, None] * state.costs)).sum(axis=1)
    return Equilibrium(rows, game.error(rows), means, prices, levels)


def _stepped(state: _State, moves: _Moves, gains: Array) -> bool:
    """Take one predictor–corrector step; False where it leads nowhere."""
    allowed = state.game.allowed
    zero, none = np.zeros_like(state.rows), np.zeros_like(state.slack)
    row, spare, dual, price = moves.towards(gains, zero, none)
    safe, safe_duals = state.safe_rows, np.where(allowed, state.duals, 1.0)
    length = min(1.0, _longest(safe, row), _longest(state.slack, spare))
    dual_length = min(1.0, _longest(safe_duals, dual), _longest(state.prices, price))
    now = state.distance()
    ahead_rows = (state.duals + dual_length * dual) * (state.rows + length * row)
    ahead = ahead_rows.sum(axis=1) + (state.prices + dual_length * price) * (state.slack + length * spare)
    after = float(state.game.weights @ ahead / state.pairs)
    centre = now * float(np.clip((after / now) ** 3, tolerances.LEAST_CENTRED, _MOST_CENTRED))
    row, spare, dual, price = moves.towards(gains, centre - dual * row, centre - price * spare)
    length = min(1.0, _TO_BOUNDARY * _longest(safe, row), _TO_BOUNDARY * _longest(state.slack, spare))
    dual_length = min(1.0, _TO_BOUNDARY * _longest(safe_duals, dual), _TO_BOUNDARY * _longest(state.prices, price))
    length = dual_length = min(length, dual_length)
    if not np.isfinite(length * dual_length) or max(length, dual_length) < tolerances.NEWTON_STEP:
        return False
    state.rows = np.where(allowed, state.rows + length * row, 0.0)
    state.slack = state.slack + length * spare
    state.duals = state.duals + dual_length * dual
    state.prices = state.prices + dual_length * price
    return bool(np.isfinite(state.rows).all() and np.isfinite(state.duals).all())
