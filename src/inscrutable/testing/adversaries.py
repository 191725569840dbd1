"""Contract checker for observers: comparisons rely on these promises."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import Adversary
from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.testing.promises import check_shape, promise, same, source_of, tried_actions, tried_beliefs
from inscrutable.validation import Array


def check_adversary(adversary: Adversary, problem: DecisionProblem, *, rng: np.random.Generator | None = None) -> None:
    """Check on a problem's decisions that an adversary keeps its promises; silent where it does.

    The promises are:

    - `infer` accepts every feasible decision;
    - an estimate is a belief, or NaN throughout where the observer cannot explain the decision;
    - with `nearest` there always is an estimate, and it equals the one without `nearest` where that exists;
    - estimates for many decisions equal those for each alone, in any order and when repeated;
    - the arguments are not changed.

    Args:
        adversary: An observer of single decisions, from this library or written by a user.
        problem: The problem whose decisions it observes.
        rng: Source of the decisions; None: a fixed seed, the same at every call.

    Raises:
        AssertionError: A promise is broken; the message names it, with the decision and the guess.
        InputError: `adversary` lacks one of its three methods, or `problem` is no decision problem.

    Cost: some hundred calls of `infer`. Source: the paper, Section III-B.

    Example:
        >>> from inscrutable import FiniteProblem, NaiveAdversary
        >>> problem = FiniteProblem([[0.0, 4.0], [10.0, 4.0]])
        >>> check_adversary(NaiveAdversary(problem), problem)
    """
    if not isinstance(adversary, Adversary):
        raise InputError(f"an adversary with `infer`, `estimate` and `estimates` is needed, got {adversary!r}")
    source = source_of(rng)
    solved = checked_problem(problem).solve_points(tried_beliefs(problem.n_states, source))
    actions = np.asarray(problem.as_actions(np.vstack([solved, tried_actions(problem, solved, source)])))
    guesses = {nearest: _guesses(adversary, problem, actions, nearest) for nearest in (False, True)}
    told = ~np.isnan(guesses[False]).all(axis=1)
    _check_agree(actions[told], guesses[True][told], guesses[False][told], "nearest changes no guess there was")
    order = source.permutation(len(actions))
    shuffled = np.asarray(adversary.estimates(actions[order]))
    _check_agree(actions[order], shuffled, guesses[False][order], "decisions are read the same again, in any order")
    for action in actions:
        adversary.infer(action)


def _guesses(adversary: Adversary, problem: DecisionProblem, actions: Array, nearest: bool) -> Array:
    given, called = actions.copy(), f"estimates(actions, nearest={nearest})"
    found = np.asarray(adversary.estimates(given, nearest=nearest), dtype=np.float64)
    promise(bool((given == actions).all()), f"{called} leaves the decisions as they were", "they were changed")
    check_shape(called, found.shape, (len(actions), problem.n_states))
    senseless = np.isnan(found).all(axis=1)
    off = np.maximum(np.abs(found.sum(axis=1) - 1.0), -found.min(axis=1))
    good = (off <= tolerances.TRANSITION_SUM) | (senseless & (not nearest))
    worst = int(good.argmin())
    expected = "beliefs, also where no belief explains the decision" if nearest else "beliefs, or NaN throughout"
    promise(bool(good.all()), f"{called} are {expected}", f"decision {actions[worst]} gives {found[worst]}")
    alone = [np.asarray(adversary.estimate(action, nearest=nearest), dtype=np.float64) for action in actions]
    for guess in alone:
        check_shape(f"estimate(action, nearest={nearest})", guess.shape, (problem.n_states,))
    _check_agree(actions, np.array(alone), found, "one decision is read as among many")
    return found


def _check_agree(actions: Array, first: Array, second: Array, what: str) -> None:
    agree = same(first, second).all(axis=1)
    if not agree.all():
        worst = int(agree.argmin())
        promise(False, what, f"decision {actions[worst]} gives {first[worst]} and {second[worst]}")
