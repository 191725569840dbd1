"""A prior's weights on a mechanism's beliefs, in the mechanism's order."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from inscrutable import tolerances
from inscrutable.errors import InputError
from inscrutable.mechanisms.played import Mechanism
from inscrutable.mechanisms.priors import Prior, checked_prior
from inscrutable.mechanisms.same_actions import first_same
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array


def checked_mechanism(mechanism: Any) -> Mechanism:
    """Return a mechanism, or raise `InputError`."""
    if not isinstance(mechanism, Mechanism):
        raise InputError(f"expected a Mechanism, as mechanism(decision_maker, beliefs) makes it, got {mechanism!r}")
    return mechanism


def points_in(problem: DecisionProblem, mechanism: Mechanism) -> Array:
    """Return the decisions (M,U) of a mechanism, or raise `InputError` where they are none of the problem's."""
    n_states = mechanism.beliefs.shape[1]
    if checked_problem(problem).n_states != n_states:
        raise InputError(f"the problem has {problem.n_states} states, the mechanism {n_states}")
    points = problem.check_actions(mechanism.actions)
    if points.ndim != 2:  # choices by number, as many as a decision of the problem has coordinates
        raise InputError(
            f"the mechanism's decisions are choices, those of {problem!r} have {problem.n_actions} coordinates"
        )
    return points


def weights_on(mechanism: Mechanism, prior: Prior) -> Array:
    """Return the prior's weights of the mechanism's beliefs, shape (B,).

    The prior may list them in another order or leave some out, which then weigh nothing; points closer than
    `tolerances.SAME_BELIEF` in every entry are one, and where both list it several times its weights stay apart, in turn. A
    belief with weight that the mechanism does not know raises `InputError`, and so does one with two different rows, which only
    the same order tells apart.
    """
    held = checked_mechanism(mechanism).beliefs
    if checked_prior(prior).beliefs.shape[1] != held.shape[1]:
        raise InputError(f"the prior has {prior.beliefs.shape[1]} states, the mechanism {held.shape[1]}")
    if prior.beliefs.shape == held.shape and np.abs(prior.beliefs - held).max() <= tolerances.SAME_BELIEF:
        return prior.weights
    some = np.flatnonzero(prior.weights > 0)
    distance, near = cKDTree(held).query(prior.beliefs[some], p=np.inf)
    place = np.array(near)
    missing = some[distance > tolerances.SAME_BELIEF]
    if missing.size:
        raise InputError(
            f"{missing.size} of the prior's {len(prior)} beliefs are none of the mechanism's {len(held)}, the first at "
            f"index {missing[0]}: {prior.beliefs[missing[0]]}; make the mechanism on prior.beliefs"
        )
    first = first_same(held, tolerances.SAME_BELIEF)
    twice = np.flatnonzero((first < np.arange(len(held))) & np.isin(first, first[place]))
    table: Any = mechanism.observed
    if twice.size and abs(table[twice] - table[first[twice]]).max() > tolerances.PROBABILITY:
        raise InputError(
            f"the mechanism has the belief {held[twice[0]]} twice, with different rows, and the prior lists its beliefs in "
            "another order: make the mechanism on prior.beliefs"
        )
    for copied in np.unique(first[twice]):
        listed, known = np.flatnonzero(first[place] == copied), np.flatnonzero(first == copied)
        place[listed] = known[np.minimum(np.arange(len(listed)), len(known) - 1)]
    return np.asarray(np.bincount(place, weights=prior.weights[some], minlength=len(held)), dtype=np.float64)
