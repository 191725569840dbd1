"""How far the budget reaches in every direction of belief.

On a ray y_t = π + t(y − π) the regret of u*(y_t) never decreases, for every cost and feasible set: ρ is the
Bregman divergence of −V. What is affordable is therefore star-shaped around the true belief, and one number a direction
describes it, however small it is.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.search.goal import Allowance
from inscrutable.geometry import simplex_grid
from inscrutable.geometry.grids import resolution_for
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_DIRECTIONS = 60


@lru_cache(maxsize=32)
def _fixed_directions(n_states: int) -> Array:
    """Unit vectors whose entries sum to zero: even angles for three states, a fixed random set for more."""
    if n_states <= 2:
        spread = np.array([[1.0], [-1.0]])[:, : n_states - 1]
    elif n_states == 3:
        angles = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)
        spread = np.column_stack([np.cos(angles), np.sin(angles)])
    else:
        spread = np.random.default_rng(0).normal(size=(_DIRECTIONS, n_states - 1))
        spread /= np.linalg.norm(spread, axis=1, keepdims=True)
    return np.asarray(spread @ sum_zero_basis(n_states).T)


@lru_cache(maxsize=32)
def _fixed_targets(n_states: int) -> Array:
    return simplex_grid(n_states, resolution_for(n_states, _DIRECTIONS))


def farthest_decoys(problem: DecisionProblem, belief: Array, limit: float) -> tuple[Array, Array]:
    """Return decoys (D,X) at the end of what `limit` affords on rays from the belief, and their decisions (D,U)."""
    ends, optimal = ray_ends(belief), problem.solve_points(belief)
    allowed = Allowance(problem, belief, limit, float(problem.state_costs(optimal) @ belief))
    shares, decisions = allowed.along_rays(optimal, ends, tolerances.RAY_END)
    return belief + shares[:, None] * (ends - belief), decisions


def ray_ends(belief: Array) -> Array:
    """Points of the simplex's boundary in all directions: along fixed directions, and toward a grid of beliefs."""
    if belief.size == 1:
        return belief[None]
    toward = _fixed_targets(belief.size) - belief
    length = np.linalg.norm(toward, axis=1)
    toward = toward[length > tolerances.SAME_BELIEF] / length[length > tolerances.SAME_BELIEF, None]
    directions = np.vstack([_fixed_directions(belief.size), toward])
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(directions < 0, belief / -directions, np.inf).min(axis=1)
    kept = reach > tolerances.SAME_BELIEF
    ends = np.maximum(belief + reach[kept, None] * directions[kept], 0.0)
    return np.asarray(ends / ends.sum(axis=1, keepdims=True))
