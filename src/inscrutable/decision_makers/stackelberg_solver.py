"""The mechanism of largest Bayes error among many columns: few are played, and a price tells whether others could be.

On arrays alone. Estimates μ_m of all columns bound the error by Σ_b p_b max_K Σ_m K_bm |π_b − μ_m|². Where a column is
not played its estimate is free: the one that least tempts any belief is the centre of a ball in X − 1 dimensions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.stackelberg_newton import Equilibrium, Game, equilibrium
from inscrutable.validation import Array

_FIRST_COLUMNS = 100
_ADDED = 60
MOST_ROUNDS = 25
"""Times that columns are added."""
_REPRICED = 20
_NEWTON_STEPS = 20
_SMOOTHER = 0.3
_SETTLED = 0.01
_DEAR = 10.0
_FORBIDDEN = 1e6
_PRICED = 0.05  # share of the gap to which a price is found
_TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Confounded:
    """Rows K (B,M), estimates μ (M,d), the mean square error and its bound, and the rounds taken."""

    rows: Array
    estimates: Array
    error: float
    bound: float
    rounds: int


def largest_error(game: Game, goal: float, progress: Callable[[int, float], None] | None = None) -> Confounded:
    """Return the rows of largest mean square error, with a bound at most `goal` of it above, or as near as it comes."""
    usable = np.flatnonzero(game.allowed.any(axis=0))
    found = _largest(game.some(usable), goal, progress)
    rows = np.zeros_like(game.costs)
    rows[:, usable] = found.rows
    estimates = np.zeros((rows.shape[1], game.points.shape[1]))
    estimates[usable] = found.estimates
    return replace(found, rows=rows, estimates=estimates)


def _largest(game: Game, goal: float, progress: Callable[[int, float], None] | None) -> Confounded:
    constant = _constant(game)
    if constant is not None:
        return constant
    columns = _first_columns(game)
    n_columns = game.costs.shape[1]
    best: Confounded | None = None
    for done in range(1, MOST_ROUNDS + 1):
        few = game.some(columns)
        found = equilibrium(few, 0.5 * goal if len(columns) < n_columns else goal)
        estimates, tempted = _priced(game, found, columns, goal)
        answers = game.bound(estimates)
        bound = min(float(game.weights @ answers.values), game.spread)
        for _ in range(_REPRICED):  # what the rows answer gives levels and prices for better estimates yet
            if bound - found.error <= goal * bound or len(columns) < n_columns:
                break
            answered = replace(found, levels=answers.values - answers.prices, prices=answers.prices)
            again, _unused = _priced(game, answered, columns, goal)
            answers = game.bound(again)
            if float(game.weights @ answers.values) >= bound:
                break
            estimates, bound = again, float(game.weights @ answers.values)
        if best is None or found.error >= best.error:
            rows = np.zeros_like(game.costs)
            rows[:, columns] = found.rows
            best = Confounded(rows, estimates, found.error, min(bound, np.inf if best is None else best.bound), done)
        else:
            best = Confounded(best.rows, best.estimates, best.error, min(bound, best.bound), done)
        if progress is not None:
            progress(done, (best.bound - best.error) / max(best.bound, _TINY))
        near = best.bound - best.error <= goal * best.bound + tolerances.NO_ERROR * game.spread
        wanted = np.argsort(-tempted)[:_ADDED]
        wanted = wanted[tempted[wanted] > 0]
        if near or not wanted.size:
            break
        columns = np.union1d(columns, wanted)
    assert best is not None
    return best


def _constant(game: Game) -> Confounded | None:
    """One column for all, where every row can afford it: the observer is left with the prior."""
    free = np.flatnonzero((game.allowed & (game.costs <= 1.0)).all(axis=0))
    if not free.size:
        return None
    rows = np.zeros_like(game.costs)
    rows[:, free[game.costs[:, free].sum(axis=0).argmin()]] = 1.0
    return Confounded(rows, np.zeros((rows.shape[1], game.points.shape[1])), game.spread, game.spread, 0)


def _first_columns(game: Game) -> np.ndarray:
    """Columns far apart in what they cost whom, and for every row one that leaves it half of its budget."""
    n_columns = game.costs.shape[1]
    if n_columns <= _FIRST_COLUMNS:
        return np.arange(n_columns)
    costs = np.where(game.allowed, game.costs, np.inf)
    features = np.minimum(costs, _DEAR).T  # dearer is much the same
    chosen = [int(features.sum(axis=1).argmin())]
    squares = (features**2).sum(axis=1)
    distance = np.full(n_columns, np.inf)
    for _ in range(_FIRST_COLUMNS - 1):
        last = chosen[-1]
        distance = np.minimum(distance, squares - 2.0 * features @ features[last] + squares[last])
        chosen.append(int(distance.argmax()))
    columns = np.unique(chosen)
    poor = np.flatnonzero(costs[:, columns].min(axis=1) > 0.5)
    while poor.size:  # the column that helps most of them, in turn
        helped = (costs[poor] <= np.maximum(0.5, costs[poor].min(axis=1))[:, None]).sum(axis=0)
        columns = np.union1d(columns, helped.argmax())
        low = np.maximum(0.5, costs.min(axis=1))
        poor = np.flatnonzero(costs[:, columns].min(axis=1) > low)
    return columns


def _priced(game: Game, found: Equilibrium, columns: np.ndarray, goal: float) -> tuple[Array, Array]:
    """Estimates of all columns that tempt least, and by how much each unplayed one tempts still (M,).

    A column's posterior mean is kept where it tempts nobody: of a column that is hardly played it means nothing.
    """
    near = _PRICED * (goal * found.error + tolerances.NO_ERROR * game.spread)
    costs = np.where(game.allowed, game.costs, 0.0)
    offers = (game.points**2).sum(axis=1)[:, None] - (found.levels[:, None] + found.prices[:, None] * costs)
    offers = np.where(game.allowed, offers, -_FORBIDDEN * game.spread)
    estimates = np.zeros((offers.shape[1], game.points.shape[1]))
    estimates[columns] = found.estimates
    above = (offers[:, columns] - 2.0 * game.points @ found.estimates.T).max(axis=0) + (found.estimates**2).sum(axis=1)
    open_ones = np.ones(offers.shape[1], dtype=bool)
    open_ones[columns] = above > near
    others = np.flatnonzero(open_ones)
    tempted = np.full(offers.shape[1], -np.inf)
    if others.size:
        estimates[others], tempted[others] = least_tempting(game.points, offers[:, others], near)
    tempted[columns] = -np.inf
    return estimates, tempted


def least_tempting(points: Array, offers: Array, near: float) -> tuple[Array, Array]:
    """Return argmin_μ max_b (offer_bm − 2 π_b·μ + |μ|²) for every column m, shape (M,d), and a lower bound of the value.

    The maximum is smoothed, ε log Σ exp(·/ε), and each μ found by Newton's steps while ε falls to `near` / log B. The
    weights of the smooth maximum give the lower bound Σ w offer − |Σ w π|².
    """
    n_beliefs, size = points.shape
    smooth = max(float(np.ptp(points, axis=0).max(initial=0.0)) ** 2, near)
    last = near / max(np.log(n_beliefs), 1.0)
    centres = np.zeros((offers.shape[1], size))
    lower = np.full(offers.shape[1], -np.inf)
    while True:
        smooth = max(smooth * _SMOOTHER, last)
        left = np.arange(len(centres))
        for _ in range(_NEWTON_STEPS):
            weights = _smooth_maximum(points, offers[:, left], centres[left], smooth)
            means = weights.T @ points
            moved = means - centres[left]
            lower[left] = np.maximum(lower[left], (weights * offers[:, left]).sum(axis=0) - (means**2).sum(axis=1))
            hessians = np.einsum("bm,bi,bj->mij", weights, points, points, optimize=True)
            hessians -= means[:, :, None] * means[:, None, :]
            hessians = 2.0 / smooth * hessians + np.eye(size)
            newton = np.linalg.solve(hessians, moved[:, :, None])[:, :, 0]
            rise = (moved * newton).sum(axis=1)
            going = rise > _SETTLED * smooth
            left, newton = left[going], newton[going]
            if not left.size:
                break
            # Damped as for a self-concordant function: the smooth maximum turns within a few ε.
            length = np.sqrt(2.0 * rise[going] / smooth)
            centres[left] += newton * (1.0 / (1.0 + np.maximum(length - 1.0, 0.0)))[:, None]
        if smooth <= last:
            return centres, lower


def _smooth_maximum(points: Array, offers: Array, centres: Array, smooth: float) -> Array:
    """Weights of the beliefs in the smooth maximum of every column, shape (B,M)."""
    values = (offers - 2.0 * points @ centres.T) / smooth
    weights = np.exp(values - values.max(axis=0))
    return np.asarray(weights / weights.sum(axis=0))
