"""Errors of observers' estimates, over all decisions of a mechanism."""

from __future__ import annotations

import numpy as np

from inscrutable.adversaries import Adversary
from inscrutable.adversaries.consistent_sets import consistent_sets
from inscrutable.mechanisms.joint import Joint, top_states
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


def guesses_of(observer: Adversary, actions: Array, joint: Joint, excuses: Array | None = None) -> Array:
    """Return the estimates (M,X) for the played decisions; zeros elsewhere.

    `excuses` (M,X) are known beliefs of least regret, for decisions that the observer cannot explain.
    """
    shown = np.flatnonzero(joint.played > 0)
    found = np.zeros((joint.n_actions, joint.beliefs.shape[1]))
    found[shown] = observer.estimates(actions[shown], nearest=excuses is None)
    if excuses is None:
        return found
    found = np.where(np.isnan(found), excuses, found)
    # Nearly equal decisions count as one, and may have only the other's belief of least regret.
    lost = shown[np.isnan(found[shown, 0])]
    if len(lost):
        found[lost] = observer.estimates(actions[lost], nearest=True)
    return np.asarray(found)


def guess_error(joint: Joint, guesses: Array) -> float:
    """Return √Σ p(b,u) ‖π_b − guess(u)‖² for estimates `guesses` (M,X)."""
    apart = ((joint.beliefs[joint.row] - guesses[joint.column]) ** 2).sum(axis=1)
    return float(np.sqrt(joint.mass @ apart))


def top_state_share(joint: Joint, guesses: Array) -> float:
    """Return the probability that estimates `guesses` (M,X) name a most likely state of the belief.

    Of several states as likely by an estimate one is named at random.
    """
    named = top_states(guesses)
    named /= named.sum(axis=1, keepdims=True)
    return min(float(joint.mass @ (joint.top_states[joint.row] * named[joint.column]).sum(axis=1)), 1.0)


def naive_privacy(problem: DecisionProblem, actions: Array, joint: Joint) -> float:
    """Return the mean distance of the belief from Π(u) over decisions that some belief explains; NaN without any."""
    shown = np.flatnonzero(joint.played > 0)
    sets = consistent_sets(problem, problem.check_actions(np.asarray(actions)[shown]))
    place = np.zeros(joint.n_actions, dtype=np.intp)
    place[shown] = np.arange(len(shown))
    total = explained = 0.0
    for b in np.unique(joint.row):
        entries = joint.row == b
        distances, mass = sets.distances(joint.beliefs[b])[place[joint.column[entries]]], joint.mass[entries]
        known = np.isfinite(distances)
        total += float(mass[known] @ distances[known])
        explained += float(mass[known].sum())
    return total / explained if explained > 0 else float("nan")
