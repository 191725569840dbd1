"""The mechanism of largest Bayes error: a primal–dual interior-point method that is feasible on both sides.

This module uses arrays alone. The dual of the largest error is min Σ_b p_b (ℓ_b + λ_b) over levels ℓ, prices λ ≥ 0 and
estimates μ with |π_b − μ_m|² ≤ ℓ_b + λ_b c_bm for every allowed column: no column offers a row more than its level and its
price. The rows K are its multipliers. Estimates are variables, so that those of columns with little probability are accurate as
well: the spare S_bm = ℓ_b + λ_b c_bm − |π_b − μ_m|² stays positive, and every step ends with a mechanism and a bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lu_solve
from scipy.linalg.lapack import dgetrf

from inscrutable import tolerances
from inscrutable.decision_makers.aware.stackelberg_game import Game, centred_start
from inscrutable.validation import Array

MOST_STEPS = 100
"""Never reached: at most 27 in 116 games of two to five states, up to 500 by 2,000, at gaps of 1e-6 and .01, and 41 in 111 of
them at 1e-9."""
_TO_BOUNDARY = 0.9
"""Share of the way to the boundary that a step goes at most. With .7 these 111 games take 1.3 times as many steps; with .95
they take as many, and the five largest games 1.1 times as many."""
_START = 5.0
"""Levels and prices at the start, in units of the prior's error over √M. With 2 or 12 the games need as many steps, within 4 %;
the same share of the error for all M takes 1.1 times as long in the five largest games."""
_TINY = np.finfo(float).tiny

Pair = tuple[Array, Array]
"""A value of every row and column (B,M), and one of every row's budget (B,)."""


@dataclass(frozen=True, eq=False)
class Saddle:
    """Rows K (B,M), estimates (M,d), levels and prices (B,), the rows' error, and the bound Σ p (level + price)."""

    rows: Array
    estimates: Array
    levels: Array
    prices: Array
    error: float
    bound: float


@dataclass(frozen=True, eq=False)
class _Point:
    """The iterate, or a step from it, which is added field by field."""

    rows: Array  # (B,M)
    unspent: Array  # (B,)
    levels: Array  # (B,)
    prices: Array  # (B,)
    estimates: Array  # (M,d)
    spare: Array  # (B,M); of a move: to first order


class _Newton:
    """Newton's system at one point, made once for the predictor and the corrector.

    It is block diagonal per row and per column; the Schur complement is formed in the smaller of the two, the 2 B levels and
    prices or the M d estimates.
    """

    def __init__(self, game: Game, costs: Array, now: _Point) -> None:
        self.game, self.now, self.costs = game, now, costs
        self.ratio = now.rows / now.spare
        scale = game.weights[:, None] * self.ratio
        self.by_level = scale.sum(axis=1)
        # Costs centred in each row's own metric: levels and prices are then orthogonal, without cancellation.
        self.mean_costs = (scale * costs).sum(axis=1) / self.by_level
        self.about = costs - self.mean_costs[:, None]
        self.to_level, self.to_price = scale, scale * self.about
        self.by_price = (self.to_price * self.about).sum(axis=1) + game.weights * now.unspent / now.prices
        self.away = 2.0 * (game.points[:, None, :] - now.estimates[None])
        self.own = self._own_blocks(scale)
        self.on_rows = 2 * len(costs) < self.own.shape[0] * self.own.shape[1]
        system = self._of_rows() if self.on_rows else self._of_columns()
        # Every unknown in its own unit: those of columns with little probability are tiny.
        self.units = 1.0 / np.sqrt(np.maximum(np.diag(system), _TINY))
        self.factors = _factored(system * self.units[:, None] * self.units)

    def _own_blocks(self, scale: Array) -> Array:
        size = self.game.points.shape[1]
        blocks = np.empty((scale.shape[1], size, size))
        for i in range(size):
            scaled = scale * self.away[:, :, i]
            for j in range(i + 1):
                blocks[:, i, j] = blocks[:, j, i] = (scaled * self.away[:, :, j]).sum(axis=0)
        blocks[:, np.arange(size), np.arange(size)] += 2.0 * (self.game.weights @ self.now.rows)[:, None]
        return blocks

    def _of_columns(self) -> Array:
        """The Schur complement in the estimates, with levels and prices eliminated."""
        n_columns, size = self.own.shape[:2]
        first = (self.to_level / np.sqrt(self.by_level)[:, None])[:, :, None] * self.away
        second = (self.to_price / np.sqrt(self.by_price)[:, None])[:, :, None] * self.away
        joint = np.concatenate([first, second]).reshape(-1, n_columns * size)
        system = -(joint.T @ joint)
        each = np.arange(n_columns) * size
        for i in range(size):
            for j in range(size):
                system[each + i, each + j] += self.own[:, i, j]
        return np.asarray(system)

    def _of_rows(self) -> Array:
        """The Schur complement in levels and prices, with the estimates eliminated."""
        inverse = np.linalg.inv(np.linalg.cholesky(self.own))
        turned = np.empty_like(self.away)
        for i in range(turned.shape[2]):
            turned[:, :, i] = sum(self.away[:, :, j] * inverse[:, i, j] for j in range(i + 1))
        joint = np.concatenate([self.to_level[:, :, None] * turned, self.to_price[:, :, None] * turned])
        joint = joint.reshape(2 * len(self.costs), -1)
        self.root = 1.0 / np.sqrt(np.concatenate([self.by_level, self.by_price]))
        joint *= self.root[:, None]
        system = -(joint @ joint.T)
        system[np.diag_indices(len(system))] += 1.0
        return np.asarray(system)

    def _solved(self, sides: Array) -> Array:
        return np.asarray(self.units * lu_solve(self.factors, self.units * sides, check_finite=False))

    def _onto_columns(self, levels: Array, prices: Array) -> Array:
        each = self.to_level * levels[:, None] + self.to_price * prices[:, None]
        return np.asarray(np.einsum("bm,bmi->mi", each, self.away, optimize=True))

    def _onto_rows(self, estimates: Array) -> tuple[Array, Array, Array]:
        turn = np.einsum("bmi,mi->bm", self.away, estimates, optimize=True)
        return turn, (self.to_level * turn).sum(axis=1), (self.to_price * turn).sum(axis=1)

    def towards(self, aim: Array, unspent_aim: Array) -> _Point:
        """Return the move after which rows · spare and prices · unspent have changed by these, to first order."""
        now, weights = self.now, self.game.weights
        direct = aim / now.spare
        lacking = 1.0 - now.rows.sum(axis=1)
        level = weights * (direct.sum(axis=1) - lacking)
        missing = 1.0 - (now.rows * self.costs).sum(axis=1) - now.unspent
        price = weights * ((direct * self.costs).sum(axis=1) + unspent_aim / now.prices - missing)
        price = price - self.mean_costs * level
        sums = np.einsum("bm,bmi->mi", weights[:, None] * (direct + now.rows), self.away, optimize=True)
        if self.on_rows:
            alone = np.linalg.solve(self.own, sums[:, :, None])[:, :, 0]
            _, first, second = self._onto_rows(alone)
            both = self.root * self._solved(self.root * np.concatenate([level - first, price - second]))
            levels, prices = both[: len(level)], both[len(level) :]
            left = sums - self._onto_columns(levels, prices)
            estimates = np.linalg.solve(self.own, left[:, :, None])[:, :, 0]
            turn = self._onto_rows(estimates)[0]
        else:
            left = sums - self._onto_columns(level / self.by_level, price / self.by_price)
            estimates = self._solved(left.reshape(-1)).reshape(left.shape)
            turn, first, second = self._onto_rows(estimates)
            levels, prices = (level - first) / self.by_level, (price - second) / self.by_price
        spare = levels[:, None] + prices[:, None] * self.about + turn
        rows = direct - self.ratio * spare
        unspent = (unspent_aim - now.unspent * prices) / now.prices
        return _Point(rows, unspent, levels - self.mean_costs * prices, prices, estimates, spare)


def _factored(system: Array) -> tuple[Array, np.ndarray]:
    """The triangular factors of Newton's system: rounding may leave it short of positive definite, so not Cholesky's."""
    if not np.isfinite(system).all():
        raise np.linalg.LinAlgError("Newton's system is not finite")
    factors, swaps, zero = dgetrf(system, overwrite_a=True)
    if zero:
        raise np.linalg.LinAlgError(f"Newton's system is singular: pivot {zero} is zero")
    return factors, swaps


def saddle(game: Game, goal: float, progress: Callable[[int], None] | None = None) -> Saddle:
    """Return rows and estimates with a relative gap of about `goal`, or the smallest gap reached."""
    costs = np.where(game.allowed, game.costs, 0.0)
    rows, levels, prices = centred_start(game, _START * game.spread / np.sqrt(costs.shape[1]) * _centres(game))
    estimates = np.zeros((costs.shape[1], game.points.shape[1]))
    unspent = 1.0 - (rows * costs).sum(axis=1)
    now = _Point(rows, unspent, levels, prices, estimates, _spare(game, costs, (levels, prices, estimates)))
    best = _judged(game, now)
    for done in range(1, MOST_STEPS + 1):
        try:
            moved = _stepped(game, costs, now)
        except np.linalg.LinAlgError:
            break
        if moved is None:
            break
        now = moved
        best = _better(best, _judged(game, now))
        if progress is not None:
            progress(done)
        if best.bound - best.error <= goal * best.bound + 0.5 * tolerances.NO_ERROR * game.spread:
            break
    return best


def _judged(game: Game, now: _Point) -> Saddle:
    bound = float(game.weights @ (now.levels + now.prices))
    return Saddle(now.rows, now.estimates, now.levels, now.prices, game.error(now.rows), bound)


def _centres(game: Game) -> Array:
    """Relative size of the products of each row (B,): rows of small weight have smaller ones."""
    return np.asarray(1.0 / np.sqrt(len(game.weights) * game.weights))


def _better(old: Saddle, new: Saddle) -> Saddle:
    """Return the rows of larger error and the estimates of smaller bound."""
    rows = new if new.error >= old.error else old
    dual = new if new.bound <= old.bound else old
    return Saddle(rows.rows, dual.estimates, dual.levels, dual.prices, rows.error, dual.bound)


def _spare(game: Game, costs: Array, dual: tuple[Array, Array, Array]) -> Array:
    levels, prices, estimates = dual
    return np.where(game.allowed, levels[:, None] + prices[:, None] * costs - game.gains(estimates), 1.0)


def _longest(values: Array, move: Array) -> float:
    worst = float((-move / values).max(initial=0.0))
    return np.inf if worst <= 0 else 1.0 / worst


def _lengths(now: _Point, move: _Point, allowed: np.ndarray) -> tuple[float, float]:
    """The largest primal step (rows, unspent budgets) and dual step at which nothing is negative."""
    rows = min(_longest(np.where(allowed, now.rows, 1.0), move.rows), _longest(now.unspent, move.unspent))
    # A slack is quadratic: S + t S' − t² |μ'|². Where it never falls the denominator below is zero.
    curvature = (move.estimates**2).sum(axis=1)
    fall = np.sqrt(move.spare**2 + 4.0 * curvature * now.spare) - move.spare
    worst = float(np.where(allowed, fall / now.spare, 0.0).max(initial=0.0))
    return rows, min(np.inf if worst <= 0 else 2.0 / worst, _longest(now.prices, move.prices))


def _stepped(game: Game, costs: Array, now: _Point) -> _Point | None:
    """Take one step of predictor and corrector; None where it is too short."""
    newton = _Newton(game, costs, now)
    products = _products(game, now, None, (0.0, 0.0))
    move = newton.towards(*(-each for each in products))
    lengths = tuple(min(1.0, each) for each in _lengths(now, move, game.allowed))
    each, share = _centre(game, products, _products(game, now, move, (lengths[0], lengths[1])))
    curvature = now.rows * (move.estimates**2).sum(axis=1)
    second = move.rows * move.spare - curvature, move.prices * move.unspent
    aim = share * each[:, None] - products[0] - second[0], share * each - products[1] - second[1]
    move = newton.towards(np.where(game.allowed, aim[0], 0.0), aim[1])
    primal, dual = (min(1.0, _TO_BOUNDARY * length) for length in _lengths(now, move, game.allowed))
    if not np.isfinite(primal * dual) or max(primal, dual) < tolerances.NEWTON_STEP:
        return None
    levels, prices = now.levels + dual * move.levels, now.prices + dual * move.prices
    # Updated, not recomputed from levels and prices: a tiny spare would be lost to rounding.
    reached = np.where(game.allowed, _spare_after(now, move, dual), 1.0)
    rows = now.rows + primal * move.rows
    if not (np.isfinite(rows).all() and reached.min() > 0):
        return None
    return _Point(
        rows, now.unspent + primal * move.unspent, levels, prices, now.estimates + dual * move.estimates, reached
    )


def _spare_after(now: _Point, move: _Point, length: float) -> Array:
    return np.asarray(now.spare + length * move.spare - length**2 * (move.estimates**2).sum(axis=1))


def _products(game: Game, now: _Point, move: _Point | None, lengths: tuple[float, float]) -> Pair:
    """Rows times spare (B,M), and prices times unspent (B,), after a move of some length on either side."""
    if move is None:
        return np.where(game.allowed, now.rows * now.spare, 0.0), now.prices * now.unspent
    primal, dual = lengths
    rows = (now.rows + primal * move.rows) * _spare_after(now, move, dual)
    return np.where(game.allowed, rows, 0.0), (now.prices + dual * move.prices) * (now.unspent + primal * move.unspent)


def _centre(game: Game, products: Pair, ahead: Pair) -> tuple[Array, float]:
    """The value of every product of a row on the central path (B,), and the share of it that the step aims at."""
    total = float(game.weights @ (products[0].sum(axis=1) + products[1]))
    share = (max(float(game.weights @ (ahead[0].sum(axis=1) + ahead[1])), 0.0) / total) ** 3
    each = _centres(game)
    each = total / float(game.weights @ (each * (game.allowed.sum(axis=1) + 1.0))) * each
    return each, max(share, tolerances.LEAST_CENTRED)
