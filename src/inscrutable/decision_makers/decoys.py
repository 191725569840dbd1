"""Candidates that are optimal for some belief: decoys, spread over the simplex of beliefs."""

from __future__ import annotations

import numpy as np

from inscrutable import validation
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.decision_makers.action_candidates import bounding_box_of, coordinate_ends
from inscrutable.decision_makers.candidate_set import Candidates, known_candidates, make_candidates
from inscrutable.decision_makers.proofs.tied_faces import tied_mixtures
from inscrutable.errors import InputError
from inscrutable.geometry import simplex_grid
from inscrutable.geometry.grids import grid_size
from inscrutable.geometry.low_discrepancy import simplex_cover
from inscrutable.problems import DecisionProblem, checked_problem, quadratic_problem
from inscrutable.validation import Array

DEFAULT_SIZE = 5000
MOST_DECOYS = 600_000
"""Three states at a resolution of 1,000 stay below it."""


def decoy_grid(problem: DecisionProblem, resolution: int, *, faces: bool = False) -> Candidates:
    """Return the optimal decisions of decoys, beliefs spread over the simplex that the agent may play in place of its own.

    Formula: {u*(y) : y ∈ Δ_X, r·y whole}; nothing plausible is lost, since Π(u) ≠ ∅ exactly when u = u*(y) for some y.
    Where these would be more than 600,000, the finest regular grid of that size is taken, and above six states it is
    filled up with low-discrepancy points in the interior (`geometry.low_discrepancy.simplex_cover`). Either way all
    vertices are there and all faces of the simplex are covered; `summary()` states how near every belief has a decoy.

    Args:
        problem: The decision problem.
        resolution: r, at least 1; multiples of 1/r, corners included: every belief is then within √(X/4)/r of a decoy.
        faces: For linear and finite problems, whether to add the vertices that no decoy leads to, and mixtures of
            decisions that are optimal for the same beliefs (`tied_faces.tied_mixtures`).

    Returns:
        C(r+X−1, X−1) candidates, or about 600,000, at most 750,000, where that is more; of a finite problem also every
        other choice that some belief explains.

    Raises:
        InputError: The resolution is not a whole number of at least 1, or `faces` is asked for where decisions are unique.

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
    if not faces:
        return found
    form = problem.linear_form()
    if form is None or form.lift is not None:
        raise InputError("faces=True is for linear and finite problems, whose optimal decisions can be tied")
    return found.joined(tied_mixtures(problem, found))


def default_decoys(problem: DecisionProblem) -> Candidates:
    """Return the candidates that are used where none are given: about 5,000 decoys, whatever the number of states:
    a regular grid, filled up to at most 6,250 above six states."""
    if checked_problem(problem).is_discrete:
        every = _explained(problem, np.eye(problem.n_actions))
        assert every is not None, "some choice is the cheapest for every belief"
        return every
    return decided_by(problem, simplex_cover(problem.n_states, DEFAULT_SIZE))


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
    """Return decisions a little beside optimal ones: steps from a coarse grid of decoys toward each state's decision
    and toward each end of the feasible set's coordinates. Used where unexplained decisions are wanted."""
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
    beside = make_candidates(problem, mixed.reshape(-1, problem.n_actions))
    return make_candidates(problem, base, decoys).joined(beside)
