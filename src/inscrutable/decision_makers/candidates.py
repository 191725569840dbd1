"""The decisions a decision maker chooses from, wherever they come from."""

from __future__ import annotations

from numpy.typing import ArrayLike

from inscrutable.decision_makers.action_candidates import action_grid, random_actions, random_candidates
from inscrutable.decision_makers.candidate_set import Candidates, make_candidates
from inscrutable.decision_makers.decoys import decoy_grid, default_decoys, near_decoys
from inscrutable.errors import InputError
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem

__all__ = [
    "Candidates",
    "action_grid",
    "as_candidates",
    "candidates_for",
    "decoy_grid",
    "make_candidates",
    "near_decoys",
    "random_actions",
    "random_candidates",
]


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
    problem: DecisionProblem, measure: PrivacyMeasure, given: Candidates | ArrayLike | None
) -> Candidates:
    """Return given candidates, or the default: decoys, and decisions beside them where unexplained ones can be best."""
    if given is None and measure.searches_actions:
        return near_decoys(problem)
    return as_candidates(problem, given)
