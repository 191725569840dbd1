"""Candidates drawn from the feasible set itself: the paper's grid of decisions and its Monte Carlo samples."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.decision_makers.candidate_set import Candidates, make_candidates
from inscrutable.errors import InputError, ModelError
from inscrutable.geometry import simplex_grid
from inscrutable.geometry.grids import grid_size
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array

_MOST_GRID_POINTS = 2_000_000
_HIT_AND_RUN_STEPS = 50


def action_grid(problem: DecisionProblem, resolution: int) -> Candidates:
    """Return the regular grid of decisions in a bounded feasible set: the paper's choice.

    Formula: multiples of 1/r of each free coordinate's range, the others following from the equalities.

    Args:
        problem: The decision problem.
        resolution: r, at least 1.

    Returns:
        Candidates without decoys.

    Raises:
        InputError: The resolution is not a whole number of at least 1, or the grid would exceed two million points.
        ModelError: The feasible set is unbounded.

    Cost: one small factorisation per decision. Source: the paper, Section V-A.

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem(0.1 * np.eye(3), [np.eye(3)] * 3, 1.0)
        >>> len(action_grid(problem, 40))
        861
    """
    validation.count(resolution, "resolution")
    n = checked_problem(problem).n_actions
    if is_simplex(problem):
        if grid_size(n, resolution) > _MOST_GRID_POINTS:
            raise InputError(
                f"a grid of resolution {resolution} over {n} coordinates exceeds {_MOST_GRID_POINTS} points"
            )
        return make_candidates(problem, simplex_grid(n, resolution))
    candidates = make_candidates(problem, _grid_in_box(problem, resolution))
    if not candidates.usable.any():
        raise InputError(
            f"no admissible decision on a grid of resolution {resolution}: the feasible set is thin; use a finer grid, "
            "random_candidates or decoy_grid"
        )
    return candidates


def is_simplex(problem: DecisionProblem) -> bool:
    """Return whether the feasible set is written as the simplex, {u ≥ 0 : Σu = 1}."""
    region = problem.constraints
    n = region.n_actions
    return bool(
        not region.needs_lift
        and region.A_ub.shape == (n, n)
        and np.array_equal(region.A_ub, -np.eye(n))
        and not region.b_ub.any()
        and np.array_equal(region.A_eq, np.ones((1, n)))
        and np.array_equal(region.b_eq, np.ones(1))
    )


def bounding_box_of(problem: DecisionProblem) -> Array:
    """Return the ends of every coordinate over a bounded feasible set, shape (U,2)."""
    limits = problem.constraints.bounding_box
    open_ended = np.flatnonzero(~np.isfinite(limits).all(axis=1))
    if open_ended.size:
        raise ModelError(
            f"the feasible set is unbounded in coordinate {open_ended[0]}: sample decoys instead of actions"
        )
    return limits


def _grid_in_box(problem: DecisionProblem, resolution: int) -> Array:
    region = problem.constraints
    limits = bounding_box_of(problem)
    free = _free_coordinates(region.A_eq)
    if (resolution + 1) ** len(free) > _MOST_GRID_POINTS:
        raise InputError(
            f"a grid of resolution {resolution} over {len(free)} free coordinates exceeds {_MOST_GRID_POINTS} points"
        )
    ticks = [np.linspace(limits[j, 0], limits[j, 1], resolution + 1) for j in free]
    chosen = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, len(free))
    points = np.zeros((len(chosen), region.n_actions))
    points[:, free] = chosen
    rest = [j for j in range(region.n_actions) if j not in free]
    if rest:
        right = region.b_eq - chosen @ region.A_eq[:, free].T
        points[:, rest] = np.linalg.lstsq(region.A_eq[:, rest], right.T, rcond=None)[0].T
    inside = points[region.violation(points) <= tolerances.FEASIBILITY]
    return np.asarray(inside) if len(inside) else np.atleast_2d(problem.solve(np.eye(problem.n_states)))


def _free_coordinates(equalities: Array) -> list[int]:
    """Coordinates that determine the others through the equalities: all but a basis of their columns."""
    basis: list[int] = []
    for j in reversed(range(equalities.shape[1])):
        if np.linalg.matrix_rank(equalities[:, [*basis, j]]) > len(basis):
            basis.append(j)
    return [j for j in range(equalities.shape[1]) if j not in basis]


def random_candidates(problem: DecisionProblem, n: int, *, rng: np.random.Generator) -> Candidates:
    """Return decisions drawn uniformly from a bounded feasible set: the paper's Monte Carlo samples.

    Formula: ū^(l) ~ Uniform(C); on the simplex a flat Dirichlet law, elsewhere hit-and-run with 50 steps a draw.

    Args:
        problem: The decision problem.
        n: Number of decisions, at least 1.
        rng: Source of randomness.

    Raises:
        InputError: `n` is not a whole number of at least 1, or `rng` is not a generator.
        ModelError: The feasible set is unbounded.

    Cost: one small factorisation per decision. Source: the paper, Assumption 1.

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem(0.1 * np.eye(3), [np.eye(3)] * 3, 1.0)
        >>> len(random_candidates(problem, 10, rng=np.random.default_rng(0)))
        10
    """
    return make_candidates(checked_problem(problem), random_actions(problem, n, rng=rng))


def random_actions(problem: DecisionProblem, n: int, *, rng: np.random.Generator) -> Array:
    """Return decisions (n,U) drawn uniformly from a bounded feasible set."""
    validation.count(n, "n")
    validation.generator(rng)
    if is_simplex(problem):
        return rng.dirichlet(np.ones(problem.n_actions), size=n)
    return _hit_and_run(problem, n, rng)


def _hit_and_run(problem: DecisionProblem, n: int, rng: np.random.Generator) -> Array:
    region = problem.constraints
    bounding_box_of(problem)
    ends = coordinate_ends(problem)
    points, free = np.tile(ends.mean(axis=0), (n, 1)), region.affine_hull(ends)
    if free.shape[1] == 0:
        return points
    for _ in range(_HIT_AND_RUN_STEPS):
        direction = rng.normal(size=(n, free.shape[1])) @ free.T
        low, high = region.reach(points, direction, ends)
        points = points + rng.uniform(low, high)[:, None] * direction
    return np.asarray(points)


def coordinate_ends(problem: DecisionProblem) -> Array:
    """Return decisions that are least or greatest in some coordinate, shape (2U, U)."""
    units = np.eye(problem.n_actions)
    return np.array([problem.constraints.extreme(sign * unit) for unit in units for sign in (1.0, -1.0)])
