"""The mechanism of largest Bayes error among any number of columns, by column generation.

This module uses arrays alone. The estimate of an absent column is free: the one of the largest least reduced cost is the centre
of a ball in X − 1 dimensions. A column *tempts* a belief where its reduced cost is negative.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.aware.stackelberg_game import Game
from inscrutable.decision_makers.aware.stackelberg_newton import MOST_STEPS, Saddle, saddle
from inscrutable.validation import Array

_LARGE = 2e10
"""Multiplications of one Newton step above which columns are generated. For 1,000 beliefs and 5,051 decisions, twice as many,
that takes 37 s and .8 GB instead of 96 s and 1.5 GB; 21 by 5,048 it would take three times as long."""
_FIRST_COLUMNS, _ADDED = 300, 200
"""In five games of up to 500 by 2,000 that generate columns, 100 at first take 1.7 times as long, 70 in a round 1.4 times."""
_MOST_ROUNDS = 25
"""Never reached: at most four rounds at 1,000 by 5,000, and six in these five games."""
_NEWTON_STEPS, _SHORTER = 20, 0.3
"""Most steps at a smoothing: 60 change nothing in 16 games over two to four states that begin with 30 columns. Factor from one
length of a step to the next."""
_SMOOTHER, _SETTLED = 0.3, 0.01
"""Factor from one smoothing to the next, and the rise at which a column is settled. With .1 or .6, or ten times the rise or a
tenth, these 16 games take 1.0 to 1.2 times as long and 53 or 54 rounds."""
_DEAR = 10.0
"""With 3 these 16 games take 51 rounds, without it 59, instead of 54."""
_FORBIDDEN = 1e6
"""With 1e3 or 1e9 the 26 values and bounds are the same."""
_PRICED = 0.05
"""Share of the gap to which a price is found. With a third or three times as much these 16 games take 1.1 and 1.2 times as
long."""
_TINY = np.finfo(float).tiny

Told = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Confounded:
    """Rows K (B,M), estimates μ (M,d), the mean square error and its bound."""

    rows: Array
    estimates: Array
    error: float
    bound: float


def largest_error(game: Game, goal: float, progress: Told | None = None) -> Confounded:
    """Return the rows of largest mean square error, with a bound at most `goal` of it above, or as near as it comes."""
    usable = np.flatnonzero(game.allowed.any(axis=0))
    few = game.some(usable)
    found = _constant(few)
    if found is None:
        found = _by_columns(few, goal, progress) if _work(few) > _LARGE else _whole(few, goal, progress)
    rows = np.zeros_like(game.costs)
    rows[:, usable] = found.rows
    estimates = np.zeros((rows.shape[1], game.points.shape[1]))
    estimates[usable] = found.estimates
    return replace(found, rows=rows, estimates=estimates)


def _work(game: Game) -> float:
    """Multiplications that couple rows and columns in one Newton step."""
    sides = 2.0 * len(game.points), float(game.costs.shape[1] * game.points.shape[1])
    return min(sides) ** 2 * max(sides)


def _bounded(game: Game, estimates: Array) -> float:
    return min(float(game.weights @ game.bound(estimates).values), game.spread)


def _whole(game: Game, goal: float, progress: Told | None) -> Confounded:
    found = saddle(game, goal, None if progress is None else lambda done: progress(done, MOST_STEPS))
    return Confounded(found.rows, found.estimates, found.error, _bounded(game, found.estimates))


def _by_columns(game: Game, goal: float, progress: Told | None) -> Confounded:
    columns = first_columns(game.costs, game.allowed, _FIRST_COLUMNS)
    best: Confounded | None = None
    for done in range(1, _MOST_ROUNDS + 1):
        found = saddle(game.some(columns), 0.5 * goal)
        estimates, tempted = _priced(game, found, columns, goal)
        bound = _bounded(game, estimates)
        if best is not None and best.bound < bound:
            estimates, bound = best.estimates, best.bound
        rows = np.zeros_like(game.costs)
        rows[:, columns] = found.rows
        best = Confounded(rows, estimates, found.error, bound)
        if progress is not None:
            progress(done, _MOST_ROUNDS)
        near = best.bound - best.error <= goal * best.bound + tolerances.NO_ERROR * game.spread
        wanted = np.argsort(-tempted)[:_ADDED]
        wanted = wanted[tempted[wanted] > 0]
        if near or not wanted.size:
            break
        columns = np.union1d(columns[_needed(game, found, columns)], wanted)
    assert best is not None
    return best


def _constant(game: Game) -> Confounded | None:
    """A constant decision, where every row can afford it: the posterior is the prior."""
    free = np.flatnonzero((game.allowed & (game.costs <= 1.0)).all(axis=0))
    if not free.size:
        return None
    rows = np.zeros_like(game.costs)
    rows[:, free[game.costs[:, free].sum(axis=0).argmin()]] = 1.0
    return Confounded(rows, np.zeros((rows.shape[1], game.points.shape[1])), game.spread, game.spread)


def first_columns(given: Array, allowed: np.ndarray, most: int) -> np.ndarray:
    """Columns whose costs differ most over the rows, and for every row one that costs at most half of its budget."""
    n_columns = given.shape[1]
    if n_columns <= most:
        return np.arange(n_columns)
    costs = np.where(allowed, given, np.inf)
    features = np.minimum(costs, _DEAR).T  # costs above this are treated as equal
    chosen = [int(features.sum(axis=1).argmin())]
    squares = (features**2).sum(axis=1)
    distance = np.full(n_columns, np.inf)
    for _ in range(most - 1):
        last = chosen[-1]
        distance = np.minimum(distance, squares - 2.0 * features @ features[last] + squares[last])
        chosen.append(int(distance.argmax()))
    columns = np.unique(chosen)
    poor = np.flatnonzero(costs[:, columns].min(axis=1) > 0.5)
    while poor.size:  # greedily: the column that serves most of them
        helped = (costs[poor] <= np.maximum(0.5, costs[poor].min(axis=1))[:, None]).sum(axis=0)
        columns = np.union1d(columns, helped.argmax())
        low = np.maximum(0.5, costs.min(axis=1))
        poor = np.flatnonzero(costs[:, columns].min(axis=1) > low)
    return columns


def _needed(game: Game, found: Saddle, columns: np.ndarray) -> np.ndarray:
    """Which columns to keep: those that are played, and each row's cheapest."""
    played = game.weights @ found.rows
    kept = played >= tolerances.SELDOM / len(columns)
    kept[np.where(game.allowed[:, columns], game.costs[:, columns], np.inf).argmin(axis=1)] = True
    return np.flatnonzero(kept)


def _priced(game: Game, found: Saddle, columns: np.ndarray, goal: float) -> tuple[Array, Array]:
    """Estimates of all columns, for absent ones those that tempt least, and how much each still tempts (M,).

    A reduced cost below a small share of the gap does not count.
    """
    near = _PRICED * (goal * found.error + tolerances.NO_ERROR * game.spread)
    estimates = np.zeros((game.costs.shape[1], game.points.shape[1]))
    estimates[columns] = found.estimates
    tempted = np.full(len(estimates), -np.inf)
    others = np.setdiff1d(np.arange(len(estimates)), columns)
    if others.size:
        allowed = game.allowed[:, others]
        paid = found.levels[:, None] + found.prices[:, None] * np.where(allowed, game.costs[:, others], 0.0)
        offers = (game.points**2).sum(axis=1)[:, None] - paid
        offers = np.where(allowed, offers, -_FORBIDDEN * game.spread)
        found_ones = least_tempting(game.points, offers, near)
        estimates[others] = found_ones
        tempted[others] = (offers - 2.0 * game.points @ found_ones.T).max(axis=0) + (found_ones**2).sum(axis=1) - near
    return estimates, tempted


def least_tempting(points: Array, offers: Array, near: float) -> Array:
    """Return argmin_μ max_b (offer_bm − 2 π_b·μ + |μ|²) for every column m, shape (M,d), to about `near`.

    The maximum is smoothed, ε log Σ exp(·/ε), and each μ found by Newton's steps with a line search while ε falls to
    `near` / log B.
    """
    n_beliefs, size = points.shape
    smooth = max(float(np.ptp(points, axis=0).max(initial=0.0)) ** 2, near)
    last = near / max(np.log(n_beliefs), 1.0)
    centres = np.zeros((offers.shape[1], size))
    while True:
        smooth = max(smooth * _SMOOTHER, last)
        left = np.arange(len(centres))
        for _ in range(_NEWTON_STEPS):
            weights, values = _smooth_maximum(points, offers[:, left], centres[left], smooth)
            means = weights.T @ points
            moved = means - centres[left]
            hessians = np.einsum("bm,bi,bj->mij", weights, points, points, optimize=True)
            hessians -= means[:, :, None] * means[:, None, :]
            hessians = 2.0 / smooth * hessians + np.eye(size)
            newton = np.linalg.solve(hessians, moved[:, :, None])[:, :, 0]
            rise = (moved * newton).sum(axis=1)
            going = rise > _SETTLED * smooth
            left, newton, values, rise = left[going], newton[going], values[going], rise[going]
            if not left.size:
                break
            # A full step may go far beyond the beliefs whose weights it was made of. At a share t it should gain 2 t `rise`.
            shares, long = np.ones(len(left)), np.arange(len(left))
            while long.size:
                tried = centres[left[long]] + shares[long, None] * newton[long]
                reached = _smooth_maximum(points, offers[:, left[long]], tried, smooth)[1]
                long = long[reached > values[long] - 0.5 * shares[long] * rise[long]]
                shares[long] *= _SHORTER
            centres[left] += shares[:, None] * newton
        if smooth <= last:
            return centres


def _smooth_maximum(points: Array, offers: Array, centres: Array, smooth: float) -> tuple[Array, Array]:
    """Weights (B,M) of the beliefs in the smooth maximum of every column, and its values (M,)."""
    values = (offers - 2.0 * points @ centres.T) / smooth
    top = values.max(axis=0)
    weights = np.exp(values - top)
    total = weights.sum(axis=0)
    return weights / total, smooth * (top + np.log(total)) + (centres**2).sum(axis=1)
