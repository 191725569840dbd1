"""Contract checker for privacy measures: searches, frontiers and bounds rely on these promises."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import ConsistentSets, consistent_sets
from inscrutable.errors import InputError
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.testing.promises import check_shape, promise, same, source_of, tried_actions, tried_beliefs
from inscrutable.validation import Array


class _Judged(NamedTuple):
    """The values of a measure for sets under one belief."""

    measure: PrivacyMeasure
    belief: Array  # (X,)
    sets: ConsistentSets
    empty: np.ndarray  # (M,)
    privacies: Array  # (M,)


def check_privacy_measure(
    measure: PrivacyMeasure, problem: DecisionProblem, *, rng: np.random.Generator | None = None
) -> None:
    """Check on a problem's consistent sets that a measure keeps its promises; silent where it does.

    The promises are:

    - a privacy is one number and not NaN, equal when repeated and for a list or an array; the arguments are not changed;
    - no set that contains a belief has a privacy above `upper_bound`;
    - `values` equals the privacies of single sets, or lies above them where it is not exact;
    - an indicator is 0 or −∞;
    - a distance measure is ± the distance to the `reference`;
    - `at_step` returns a measure.

    Args:
        measure: The measure, from this library or written by a user.
        problem: A decision problem with as many states as the measure expects; the measure is evaluated on the consistent sets
            of its decisions.
        rng: Source of the beliefs and decisions; None: a fixed seed, the same at every call.

    Raises:
        AssertionError: A promise is broken; the message names it, with the belief, the decision and the number.
        InputError: `measure` is not a measure, or `problem` not a decision problem.

    Cost: some hundred evaluations on one set. Source: the paper, Section III-C.

    Example:
        >>> from inscrutable import FiniteProblem, MaximalObfuscation
        >>> check_privacy_measure(MaximalObfuscation(), FiniteProblem([[0.0, 4.0], [10.0, 4.0]]))
    """
    if not isinstance(measure, PrivacyMeasure):
        raise InputError(f"measure must be derived from PrivacyMeasure, got {measure!r}")
    source = source_of(rng)
    beliefs = tried_beliefs(checked_problem(problem).n_states, source)
    solved = problem.solve_points(beliefs)
    sets = consistent_sets(problem, np.vstack([solved, tried_actions(problem, solved, source)]))
    at_step = measure.at_step(0)
    promise(isinstance(at_step, PrivacyMeasure), "at_step gives a measure", f"found {at_step!r}")
    empty = np.array([sets[number].is_empty for number in range(len(sets))])
    for belief in beliefs:
        privacies = np.array([_privacy(at_step, belief, sets, number) for number in range(len(sets))])
        judged = _Judged(at_step, belief, sets, empty, privacies)
        _check_bound(judged)
        _check_many(judged)
        _check_kind(judged)


def _privacy(measure: PrivacyMeasure, belief: Array, sets: ConsistentSets, number: int) -> float:
    given, place = belief.copy(), f"for belief {belief} and what decision {sets.actions[number]} says"
    found = measure(given, sets[number])
    promise(np.ndim(found) == 0 and bool(np.isreal(found)), "a privacy is one number", f"found {found!r} {place}")
    promise(not np.isnan(found), "a privacy is not NaN; −∞ says that the goal is missed", f"found it {place}")
    promise(bool((given == belief).all()), "a measure leaves the belief as it was", f"it became {given} {place}")
    again = measure(belief.tolist(), sets[number])
    promise(bool(same(again, found)), "a measure asked again says the same", f"{found:.6g}, then {again:.6g} {place}")
    return float(found)


def _check_bound(judged: _Judged) -> None:
    limit = float(judged.measure.upper_bound(judged.belief))
    held = np.where(judged.empty, -np.inf, judged.privacies)
    best = int(held.argmax())
    promise(
        not held[best] > limit + tolerances.CONTRACT * max(1.0, abs(limit)),
        "no set that holds a belief is worth more than upper_bound",
        f"for belief {judged.belief} decision {judged.sets.actions[best]} is worth {held[best]:.6g}, the bound is {limit:.6g}",
    )


def _check_many(judged: _Judged) -> None:
    values = judged.measure.values(judged.belief, judged.sets)
    for name, part in (("privacies", values.privacies), ("exact", values.exact)):
        check_shape(f"values(...).{name}", np.shape(part), (len(judged.sets),))
    agree = same(values.privacies, judged.privacies)
    good = agree | (~np.asarray(values.exact) & (values.privacies > judged.privacies))
    worst = int(good.argmin())
    promise(
        bool(good.all()),
        "values are what single sets are worth, or above where they are not exact",
        f"for belief {judged.belief} decision {judged.sets.actions[worst]}: {values.privacies[worst]:.6g}, alone "
        f"{judged.privacies[worst]:.6g}",
    )


def _check_kind(judged: _Judged) -> None:
    if judged.measure.is_indicator:
        other = judged.privacies[~np.isin(judged.privacies, [0.0, -np.inf])]
        promise(not other.size, "an indicator is 0 or −∞", f"found {other} for belief {judged.belief}")
    reference = judged.measure.reference(judged.belief)
    if reference is None:
        return
    promise(abs(reference.sign) == 1.0, "the sign of a reference is 1 or −1", f"found {reference.sign!r}")
    for number in np.flatnonzero(~judged.empty):
        distance = reference.sign * judged.sets[int(number)].distance(reference.point)
        promise(
            bool(same(judged.privacies[number], distance)),
            "a measure with a reference is ± the distance to it",
            f"for belief {judged.belief} decision {judged.sets.actions[number]} is worth {judged.privacies[number]:.6g}, the "
            f"distance with its sign is {distance:.6g}",
        )
