"""From a decoy to a local optimum for any smooth problem: turn the ray from the true belief, go as far as the budget reaches.

Where a face's consistent sets are single beliefs, privacy is the distance of the decoy itself, and regret never falls along a
ray. So one length a direction says all; the direction is searched by patterns of trials that shrink around the best.
"""

from __future__ import annotations

from dataclasses import replace
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
_ROUGH = 0.01


class Rays(NamedTuple):
    """Decoys at the most private affordable points of rays, their decisions, and sign × distance to the reference."""

    decoys: Array  # (n, X)
    actions: Array  # (n, U)
    values: Array  # (n,)


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
    rng = np.random.default_rng(0)  # the pattern of trial points, the same at every call
    spread = _FIRST_SPREAD
    for _ in range(_ROUNDS if direction.size > 1 else 1):
        turned = direction + spread * _pattern(direction, rng)
        # What turning still gains is of the order of the spread's square: lengths need to be no better known.
        accuracy = max(_ROUGH * spread**2, tolerances.BUDGET_SAFETY)
        trial = best_on_rays(goal, turned @ basis.T, accuracy)
        values = np.where(_on_face(goal, tight, trial.actions), trial.values, -np.inf)
        index = int(values.argmax())
        if np.isfinite(values[index]) and (best is None or values[index] > best[0]):
            best = float(values[index]), trial.actions[index]
            direction = turned[index] / np.linalg.norm(turned[index])
        if best is not None and best[0] + _HOPE * spread * length < known:
            return None
        spread *= _SHRINK if direction.size == 2 else np.sqrt(_SHRINK)
    if best is None:
        return None
    last = best_on_rays(goal, direction[None] @ basis.T)
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


def best_on_rays(goal: Goal, directions: Array, accuracy: float = tolerances.BUDGET_SAFETY) -> Rays:
    """Return the best affordable point of each ray π + t d, for directions (n,X) that keep the sum.

    `accuracy` is the share of the root of the budget that may stay unspent.
    """
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(directions < 0, goal.belief / -directions, np.inf).min(axis=1)
    if goal.reference.sign < 0:
        nearest = directions @ (goal.reference.point - goal.belief)
        reach = np.clip(nearest, 0.0, reach)
    ends = goal.belief + reach[:, None] * directions
    allowed = replace(goal, limit=goal.limit * (1.0 - tolerances.BUDGET_SAFETY))
    shares, actions = allowed.along_rays(goal.problem.solve_points(goal.belief), ends, accuracy)
    decoys = goal.belief + shares[:, None] * (ends - goal.belief)
    return Rays(decoys, actions, goal.reference.sign * np.linalg.norm(decoys - goal.reference.point, axis=1))
