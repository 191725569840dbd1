"""Where candidates come from: decoys spread over the simplex of beliefs, the feasible set itself, or a user."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries.consistent_sets import describable
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.decision_makers.candidates import Candidates, known_candidates, make_candidates
from inscrutable.decision_makers.proofs.tied_faces import tied_mixtures
from inscrutable.errors import InputError, ModelError
from inscrutable.geometry import simplex_grid
from inscrutable.geometry.grids import grid_size
from inscrutable.geometry.low_discrepancy import simplex_cover
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem, checked_problem, quadratic_problem
from inscrutable.validation import Array

_MOST_GRID_POINTS = 2_000_000
_HIT_AND_RUN_STEPS = 50
_LOGGER = logging.getLogger(__name__)


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


DEFAULT_SIZE = 5000
MOST_DECOYS = 600_000
"""Three states at a resolution of 1,000 stay below it."""


def decoy_grid(problem: DecisionProblem, resolution: int, *, faces: bool = False) -> Candidates:
    """Return the optimal decisions of decoys, beliefs spread over the simplex that the agent may play in place of its own.

    Formula: {u*(y) : y ∈ Δ_X, r·y whole}; where u*(y) is unique nothing plausible is lost, since
    Π(u) ≠ ∅ exactly when u is optimal for some y.
    Where these would be more than 600,000, the finest regular grid of that size is taken, and above six states it is filled
    up with low-discrepancy points in the interior (`geometry.low_discrepancy.simplex_cover`). Either way all vertices are
    there and all faces of the simplex are covered; `summary()` states the largest distance from a belief to the nearest
    decoy.

    Args:
        problem: The decision problem.
        resolution: r, at least 1; multiples of 1/r, corners included: every belief is then within √(X/4)/r of a decoy.
        faces: For linear, piecewise linear and finite problems, whether to add the vertices that no decoy leads to, and
            mixtures of decisions that are optimal for the same beliefs (`tied_faces.tied_mixtures`).

    Returns:
        C(r+X−1, X−1) candidates, or about 600,000, at most 750,000, where that is more; of a finite problem also every
        other choice that some belief explains. Under piecewise linear costs decisions are left out, with a warning, where so
        many kinks meet that the beliefs that explain them have no short description.

    Raises:
        InputError: The resolution is not a whole number of at least 1, or `faces` is asked for and costs are not linear.

    Cost: one forward solve per decoy; 8U + 32X + 17 bytes a candidate kept (`Candidates.memory`), blocks besides.
    Source: the paper's set {ū^(l)}, for its measures (b), (d) and (e).

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem(0.1 * np.eye(3), [np.eye(3)] * 3, 1.0)
        >>> len(decoy_grid(problem, 4))
        15
    """
    validation.count(resolution, "resolution")
    n = checked_problem(problem).n_states
    regular = grid_size(n, resolution) <= MOST_DECOYS
    found = decided_by(problem, simplex_grid(n, resolution) if regular else simplex_cover(n, MOST_DECOYS))
    if problem.is_discrete:
        missing = _explained(problem, np.eye(problem.n_actions)[~found.actions.any(axis=0)])
        found = found if missing is None else found.joined(missing)
    is_linear = problem.linear_form() is not None
    if faces and not is_linear:
        raise InputError("faces=True is for linear and finite problems, whose optimal decisions can be tied")
    found = _described(problem, found) if is_linear else found
    return found.joined(tied_mixtures(problem, found)) if faces else found


def default_decoys(problem: DecisionProblem) -> Candidates:
    """Return the candidates that are used where none are given: about 5,000 decoys on a regular grid, filled up to at most
    6,250 above six states. Linear and piecewise linear costs add mixtures of tied vertices; where a state is indifferent, other
    costs add decisions beside those of decoys. A finite problem has its explained choices alone."""
    if checked_problem(problem).is_discrete:
        every = _explained(problem, np.eye(problem.n_actions))
        assert every is not None, "some choice is the cheapest for every belief"
        return every
    found = decided_by(problem, simplex_cover(problem.n_states, DEFAULT_SIZE))
    if problem.linear_form() is not None:
        found = _described(problem, found)
        return found.joined(tied_mixtures(problem, found))
    return found.joined(near_decoys(problem)) if _has_indifferent_state(problem, found) else found


def _described(problem: DecisionProblem, found: Candidates) -> Candidates:
    """Candidates under linear costs whose consistent beliefs can be described; all of them where none can."""
    known = describable(problem, found.actions)
    if found.decoys is not None and known.any() and not known.all():
        _LOGGER.warning(
            "%d of %d decisions at which very many kinks and constraints meet are left out: the beliefs that explain them have "
            "no short description",
            len(known) - known.sum(),
            len(known),
        )
        return known_candidates(problem, found.actions[known], found.decoys[known])
    return found


def _has_indifferent_state(problem: DecisionProblem, candidates: Candidates) -> bool:
    """Whether all decisions cost the same in one state, not in all: that state alone explains what no other belief does."""
    if not _one_is_flat(candidates.state_costs) or not np.isfinite(problem.constraints.bounding_box).all():
        return False
    halfway = 0.5 * (candidates.actions[0] + coordinate_ends(problem))  # inside the domain of the costs
    costs = np.vstack([candidates.state_costs, problem.state_costs(halfway)])
    return _one_is_flat(costs) and bool(np.ptp(costs, axis=0).max() > 0.0)


def _one_is_flat(costs: Array) -> bool:
    spread = np.ptp(costs, axis=0)
    return bool(spread.min() <= tolerances.COST_ACCURACY * spread.max())


def _explained(problem: DecisionProblem, choices: Array) -> Candidates | None:
    """Those of the choices (n,K) that some belief explains, each with one that does."""
    sets = [belief_set_of(problem, choice) for choice in choices]
    known = np.array([not each.is_empty for each in sets], dtype=bool)
    if not known.any():
        return None
    decoys = np.array([each.interior_point() for each in sets])
    return make_candidates(problem, choices[known], decoys[known])


def decided_by(problem: DecisionProblem, decoys: Array) -> Candidates:
    """Return the decisions that are optimal for the beliefs `decoys` (M,X), with these."""
    form, quadratic = problem.quadratic_form(), quadratic_problem(problem)
    if form is not None and quadratic is not None:
        return known_candidates(problem, form.decisions(quadratic.solve(decoys)), decoys)
    return make_candidates(problem, problem.solve(decoys), decoys)


def near_decoys(problem: DecisionProblem, points: int = DEFAULT_SIZE) -> Candidates:
    """Return the decisions of a coarse grid of decoys, and steps from these toward decisions in which a coordinate is least
    or greatest; one goes all the way, or 99 % of it. Used where decisions that no belief explains are sought."""
    if problem.is_discrete:
        return make_candidates(problem, np.eye(problem.n_actions))
    bounding_box_of(problem)
    shares = np.array([0.01, 0.03, 0.1, 0.3])
    n_ends = 2 * problem.n_actions
    coarse = max(problem.n_states, points // (n_ends * len(shares)))
    decoys = simplex_cover(problem.n_states, coarse)
    base = problem.solve_points(decoys)
    ends = np.unique(coordinate_ends(problem), axis=0)
    mixed = base[:, None, None] + shares[:, None] * (ends[:, None, :] - base[:, None, None, :])
    # At the ends themselves other costs may have no finite slope.
    whole = 1.0 if problem.linear_form() is not None or problem.quadratic_form() is not None else 0.99
    outer = base.mean(axis=0) + whole * (ends - base.mean(axis=0))
    beside = make_candidates(problem, np.vstack([mixed.reshape(-1, problem.n_actions), outer]))
    return make_candidates(problem, base, decoys).joined(beside)


def as_candidates(problem: DecisionProblem, candidates: Candidates | ArrayLike | None) -> Candidates:
    """Return candidates: given ones, decisions (M,U) of a user's own, or about 5,000 decoys for None."""
    if candidates is None:
        return default_decoys(problem)
    if isinstance(candidates, Candidates):
        if candidates.actions.shape[1] != problem.n_actions or candidates.state_costs.shape[1] != problem.n_states:
            raise InputError("the candidates belong to a problem with other numbers of states or actions")
        if candidates.problem is not problem:
            raise InputError("the candidates belong to another problem: their costs would be wrong for this one")
        return candidates
    return make_candidates(problem, candidates)


def candidates_for(
    problem: DecisionProblem, measure: PrivacyMeasure, given: Candidates | ArrayLike | None, on_empty: str = "exclude"
) -> Candidates:
    """Return given candidates, or the default: decoys, and decisions beside them where unexplained ones can be best. Of a
    finite problem these are all choices, wherever an empty consistent set has a value."""
    counts_empty = measure.judges_empty or on_empty != "exclude"
    if given is None and (measure.searches_actions or (counts_empty and checked_problem(problem).is_discrete)):
        return near_decoys(problem)
    return as_candidates(problem, given)
