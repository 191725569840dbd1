"""The decisions a decision maker chooses from: the paper's set {ū^(l)}, solved once per problem."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from math import comb
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from inscrutable import tolerances, validation
from inscrutable.adversaries import ConsistentSets, consistent_sets
from inscrutable.errors import InputError, ModelError
from inscrutable.geometry import simplex_grid
from inscrutable.geometry.grids import resolution_for
from inscrutable.linear_programmes import Rows, minimum
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array

DEFAULT_SIZE = 5000
_MOST_GRID_POINTS = 2_000_000
_MOST_KEPT = 4096
_HIT_AND_RUN_STEPS = 50

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Candidates:
    """Decisions with what does not depend on the agent's belief: their state costs and what an observer infers.

    Args:
        actions: Decisions, shape (M,U).
        state_costs: c(i, u_l), shape (M,X), in the cost's unit.
        decoys: The beliefs that the decisions are optimal for, shape (M,X), or None where they are not known.
        sets: The consistent beliefs of every decision.
        usable: Which decisions are feasible and admissible, shape (M,).
        n_outside: How many decisions lie outside the feasible set; they are never chosen.
        decided: The latest searches from these candidates, which decision makers share.

    Source: the paper, Assumption 1.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> decoy_grid(problem, 10).summary()
        '11 candidates: 11 admissible, 11 of them explained by a belief, 0 outside the feasible set'
    """

    actions: Array
    state_costs: Array
    decoys: Array | None
    sets: ConsistentSets
    usable: np.ndarray
    n_outside: int = 0
    decided: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return int(self.actions.shape[0])

    def once(self, key: Hashable, search: Callable[[], T]) -> T:
        """Return what `search` returned for this key before, or search and keep it; the oldest are forgotten."""
        found: T | None = self.decided.get(key)
        if found is None:
            found = search()
            if len(self.decided) >= _MOST_KEPT:
                self.decided.pop(next(iter(self.decided)), None)
            self.decided[key] = found
        return found

    def joined(self, other: Candidates) -> Candidates:
        """Return these candidates followed by others of the same problem; decoys are kept where both have them."""
        both = self.decoys is not None and other.decoys is not None
        return Candidates(
            np.vstack([self.actions, other.actions]),
            np.vstack([self.state_costs, other.state_costs]),
            np.vstack([self.decoys, other.decoys]) if both else None,  # type: ignore[list-item]
            self.sets.joined(other.sets),
            np.concatenate([self.usable, other.usable]),
            self.n_outside + other.n_outside,
        )

    def summary(self) -> str:
        """Return one line: how many decisions, how many usable, explained, outside."""
        explained = int(np.count_nonzero(self.sets.dimension[self.usable] >= 0))
        return (
            f"{len(self)} candidates: {int(self.usable.sum())} admissible, {explained} of them explained by a belief, "
            f"{self.n_outside} outside the feasible set"
        )


def make_candidates(problem: DecisionProblem, actions: ArrayLike, decoys: Array | None = None) -> Candidates:
    """Return candidates for decisions (M,U); those outside the feasible set are kept, counted and never chosen."""
    points = validation.finite_array(actions, "candidate actions", ndim=2)
    if points.shape[1] != problem.n_actions or not len(points):
        raise InputError(f"candidate actions have shape {points.shape}, expected (M, {problem.n_actions}) with M >= 1")
    region = problem.constraints
    outside = region.violation(points) > tolerances.FEASIBILITY
    usable = region.is_admissible(points)
    sets = consistent_sets(problem, points, decoys)
    return Candidates(points, problem.state_costs(points), decoys, sets, usable, int(outside.sum()))


def as_candidates(problem: DecisionProblem, candidates: Candidates | ArrayLike | None) -> Candidates:
    """Return candidates: given ones, decisions (M,U) of a user's own, or about 5,000 decoys for None."""
    if candidates is None:
        return decoy_grid(problem, resolution_for(problem.n_states, DEFAULT_SIZE))
    if isinstance(candidates, Candidates):
        if candidates.actions.shape[1] != problem.n_actions or candidates.state_costs.shape[1] != problem.n_states:
            raise InputError("the candidates belong to a problem with other numbers of states or actions")
        if candidates.sets.problem is not problem:
            raise InputError("the candidates belong to another problem: their costs would be wrong for this one")
        return candidates
    return make_candidates(problem, candidates)


def decoy_grid(problem: DecisionProblem, resolution: int) -> Candidates:
    """Return the optimal decisions of a regular grid of decoys: beliefs the agent may act as if it held.

    Formula: {u*(y) : y ∈ Δ_X, r·y whole}; nothing plausible is lost, since Π(u) ≠ ∅ exactly when u = u*(y) for some y.

    Args:
        problem: The decision problem.
        resolution: r, at least 1; multiples of 1/r, corners included.

    Returns:
        C(r+X−1, X−1) candidates.

    Raises:
        InputError: The resolution is not a whole number of at least 1.

    Cost: one forward solve per decoy. Source: the paper's set {ū^(l)}, for its measures (b), (d) and (e).

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem(0.1 * np.eye(3), [np.eye(3)] * 3, 1.0)
        >>> len(decoy_grid(problem, 4))
        15
    """
    validation.count(resolution, "resolution")
    n = checked_problem(problem).n_states
    if comb(resolution + n - 1, n - 1) > _MOST_GRID_POINTS:
        raise InputError(f"a grid of resolution {resolution} over {n} states exceeds {_MOST_GRID_POINTS} points")
    decoys = simplex_grid(n, resolution)
    return make_candidates(problem, problem.solve(decoys), decoys)


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
    if _is_simplex(problem):
        if comb(resolution + n - 1, n - 1) > _MOST_GRID_POINTS:
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


def _is_simplex(problem: DecisionProblem) -> bool:
    region = problem.constraints
    n = region.n_actions
    return bool(
        region.A_ub.shape == (n, n)
        and np.array_equal(region.A_ub, -np.eye(n))
        and not region.b_ub.any()
        and np.array_equal(region.A_eq, np.ones((1, n)))
        and np.array_equal(region.b_eq, np.ones(1))
    )


def _bounding_box(problem: DecisionProblem) -> Array:
    limits = problem.constraints.bounding_box
    open_ended = np.flatnonzero(~np.isfinite(limits).all(axis=1))
    if open_ended.size:
        raise ModelError(
            f"the feasible set is unbounded in coordinate {open_ended[0]}: sample decoys instead of actions"
        )
    return limits


def _grid_in_box(problem: DecisionProblem, resolution: int) -> Array:
    region = problem.constraints
    limits = _bounding_box(problem)
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
    if _is_simplex(problem):
        return rng.dirichlet(np.ones(problem.n_actions), size=n)
    return _hit_and_run(problem, n, rng)


def _hit_and_run(problem: DecisionProblem, n: int, rng: np.random.Generator) -> Array:
    region = problem.constraints
    _bounding_box(problem)
    middle = _coordinate_ends(problem).mean(axis=0)
    # The mean of points that are extreme in every coordinate is slack in every row that can be.
    flat = region.slacks(middle) <= tolerances.FEASIBILITY
    hull = np.vstack([region.A_eq, region.A_ub[flat]])
    free = null_space(hull, rcond=tolerances.ON_FACE) if len(hull) else np.eye(region.n_actions)
    points = np.tile(middle, (n, 1))
    if free.shape[1] == 0:
        return points
    rows, sides = region.A_ub[~flat], region.b_ub[~flat]
    for _ in range(_HIT_AND_RUN_STEPS):
        direction = rng.normal(size=(n, free.shape[1])) @ free.T
        speed = direction @ rows.T
        slack = np.maximum(sides - points @ rows.T, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = slack / speed
        high = np.where(speed > 0, reach, np.inf).min(axis=1)
        low = np.where(speed < 0, reach, -np.inf).max(axis=1)
        points = points + rng.uniform(low, high)[:, None] * direction
    return np.asarray(points)


def _coordinate_ends(problem: DecisionProblem) -> Array:
    """Decisions that are least or greatest in some coordinate, shape (2U, U)."""
    return np.array([_extreme(problem, j, sign) for j in range(problem.n_actions) for sign in (1.0, -1.0)])


def near_decoys(problem: DecisionProblem, points: int = DEFAULT_SIZE) -> Candidates:
    """Return decisions a little beside optimal ones: steps from a coarse grid of decoys toward each state's decision
    and toward each end of the feasible set's coordinates. Used where unexplained decisions are wanted."""
    _bounding_box(problem)
    shares = np.array([0.01, 0.03, 0.1, 0.3])
    n_ends = 2 * problem.n_actions
    coarse = max(problem.n_states, points // (n_ends * len(shares)))
    base = problem.solve(simplex_grid(problem.n_states, resolution_for(problem.n_states, coarse)))
    ends = np.unique(_coordinate_ends(problem), axis=0)
    mixed = base[:, None, None] + shares[:, None] * (ends[:, None, :] - base[:, None, None, :])
    return make_candidates(problem, np.vstack([base, mixed.reshape(-1, problem.n_actions)]))


def _extreme(problem: DecisionProblem, coordinate: int, sign: float) -> Array:
    region = problem.constraints
    unit = sign * np.eye(problem.n_actions)[coordinate]
    return minimum(unit, Rows(region.A_ub, region.b_ub), Rows(region.A_eq, region.b_eq)).x
