"""From a decoy to a local optimum for any smooth problem: turn the ray from the true belief, go as far as the budget reaches.

Where a face's consistent sets are single beliefs, privacy is the distance of the decoy itself, and regret never falls along a
ray. So one length a direction says all, found by interpolating √ρ, which is nearly linear; the direction is searched by
patterns of trials that shrink around the best.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.search.goal import Goal
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.validation import Array

_POINTS = 7
_ROUNDS = 10
_FIRST_SPREAD = 0.5
_SHRINK = 0.4
_HOPE = 1.0
_MOST_STEPS = 60
_ROUGH = 0.01


class Rays(NamedTuple):
    """Decoys at the most private affordable points of rays, their decisions, and sign × distance to the reference."""

    decoys: Array  # (n, X)
    actions: Array  # (n, U)
    values: Array  # (n,)


class Hint(NamedTuple):
    """How far the budget reaches on rays nearby, and the share by which that may be off."""

    length: float
    width: float


def climb_on_rays(goal: Goal, tight: np.ndarray, decoy: Array, known: float) -> Array | None:
    """Return the decision on the face `tight` whose decoy is best, from a decoy's direction.

    None where the face is left, or where a privacy that is `known` already is out of reach.
    """
    basis = sum_zero_basis(goal.belief.size)
    direction = basis.T @ (decoy - goal.belief)
    length = np.linalg.norm(direction)
    if length <= tolerances.SAME_BELIEF:
        return None
    direction /= length
    best: tuple[float, Array] | None = None
    reached = 0.0
    rng = np.random.default_rng(0)  # the pattern of trial points, the same at every call
    spread, hint = _FIRST_SPREAD, None
    for _ in range(_ROUNDS if direction.size > 1 else 1):
        turned = direction + spread * _pattern(direction, rng)
        # What turning still gains is of the order of the spread's square: lengths need to be no better known.
        accuracy = max(_ROUGH * spread**2, tolerances.BUDGET_SAFETY)
        trial = best_on_rays(goal, turned @ basis.T, accuracy, hint)
        values = np.where(_on_face(goal, tight, trial.actions), trial.values, -np.inf)
        index = int(values.argmax())
        if np.isfinite(values[index]) and (best is None or values[index] > best[0]):
            best = float(values[index]), trial.actions[index]
            direction = turned[index] / np.linalg.norm(turned[index])
            reached = float(np.linalg.norm(trial.decoys[index] - goal.belief))
        if best is not None and best[0] + _HOPE * spread * length < known:
            return None
        spread *= _SHRINK if direction.size == 2 else np.sqrt(_SHRINK)
        # Lengths change by about their own size when a direction turns by about its own.
        hint = None if best is None else Hint(reached, min(spread, 0.5))
    if best is None:
        return None
    last = best_on_rays(goal, direction[None] @ basis.T, hint=hint)
    kept = _on_face(goal, tight, last.actions)[0] and last.values[0] >= best[0]
    return last.actions[0] if kept else best[1]


def _on_face(goal: Goal, tight: np.ndarray, actions: Array) -> np.ndarray:
    region = goal.problem.constraints
    return np.asarray((region.tight_rows(actions) == tight).all(axis=1) & region.is_admissible(actions))


def _pattern(direction: Array, rng: np.random.Generator) -> Array:
    """Steps across a direction (k,), the first of them none; shape (n,k)."""
    size = direction.size
    if size == 1:
        return np.zeros((1, 1))
    if size == 2:
        return np.asarray(np.linspace(-1.0, 1.0, _POINTS)[:, None] * np.array([-direction[1], direction[0]]))
    steps = rng.normal(size=(_POINTS * (size - 1), size))
    steps -= (steps @ direction)[:, None] * direction
    steps *= (rng.uniform(size=len(steps)) / np.linalg.norm(steps, axis=1))[:, None]
    return np.vstack([np.zeros(size), steps])


def best_on_rays(
    goal: Goal, directions: Array, accuracy: float = tolerances.BUDGET_SAFETY, hint: Hint | None = None
) -> Rays:
    """Return the best affordable point of each ray π + t d, for directions (n,X) that keep the sum.

    `accuracy` is the share of the root of the budget that may stay unspent; a `hint` only saves steps.
    """
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(directions < 0, goal.belief / -directions, np.inf).min(axis=1)
    if goal.reference.sign < 0:
        nearest = directions @ (goal.reference.point - goal.belief)
        reach = np.clip(nearest, 0.0, reach)
    ends = goal.belief + reach[:, None] * directions
    first = (
        np.ones(len(ends))
        if hint is None
        else np.clip(hint.length / np.maximum(reach, tolerances.TINY), tolerances.POLISH, 1.0)
    )
    shares, actions = _affordable(goal, ends, accuracy, first, 0.0 if hint is None else hint.width)
    decoys = goal.belief + shares[:, None] * (ends - goal.belief)
    return Rays(decoys, actions, goal.reference.sign * np.linalg.norm(decoys - goal.reference.point, axis=1))


def _affordable(goal: Goal, ends: Array, accuracy: float, first: Array, width: float) -> tuple[Array, Array]:
    """The longest affordable shares (n,) of the ways to beliefs (n,X), and the decisions."""
    problem, belief = goal.problem, goal.belief
    root = np.sqrt(goal.limit * (1.0 - tolerances.BUDGET_SAFETY))
    spare = accuracy * root  # what may stay unspent; half of it is aimed at

    def excess(which: np.ndarray, shares: Array) -> tuple[Array, Array]:
        mixed = np.maximum(belief + shares[:, None] * (ends[which] - belief), 0.0)
        actions = problem.solve_points(mixed / mixed.sum(axis=1, keepdims=True))
        costs = problem.state_costs(actions) @ belief - goal.optimal_cost
        return actions, np.sqrt(np.maximum(costs, 0.0)) - root

    low, below = np.zeros(len(ends)), np.full(len(ends), -root)
    shares, last = np.zeros(len(ends)), np.zeros(len(ends))
    decisions = np.tile(problem.solve_points(belief), (len(ends), 1))
    high, above = np.minimum(first * (1.0 + width), 1.0), np.zeros(len(ends))
    left = np.arange(len(ends))
    while left.size:
        found, above[left] = excess(left, high[left])
        fits = above[left] <= 0
        good = left[fits]
        low[good], below[good], shares[good], decisions[good] = high[good], above[good], high[good], found[fits]
        left = good[high[good] < 1.0]
        high[left] = 1.0
    # At the simplex's border regret may be endless, and says nothing about its slope.
    above = np.minimum(above, 2.0 * root)
    left = np.flatnonzero(shares < high)
    hinted = first * (1.0 - width)
    for _ in range(_MOST_STEPS):
        if not left.size:
            break
        inside = np.clip(
            (below[left] + 0.5 * spare) / (below[left] - above[left]), tolerances.POLISH, 1.0 - tolerances.POLISH
        )
        between = low[left] + inside * (high[left] - low[left])
        # Once, from below, where rays nearby say that the end is close.
        near = (hinted[left] > low[left]) & (high[left] < 1.0)
        tried = np.where(near, hinted[left], between)
        hinted[left] = 0.0
        found, values = excess(left, tried)
        fits = values <= 0
        good, bad = left[fits], left[~fits]
        low[good], below[good], shares[good], decisions[good] = tried[fits], values[fits], tried[fits], found[fits]
        high[bad], above[bad] = tried[~fits], values[~fits]
        # The end that stays is believed less each time (Illinois), so that both close in.
        above[good[last[good] < 0]] *= 0.5
        below[bad[last[bad] > 0]] *= 0.5
        last[good], last[bad] = -1.0, 1.0
        unspent = np.where(fits, -values, root) > spare
        left = left[unspent & (high[left] - low[left] > tolerances.POLISH * high[left])]
    return shares, decisions
