"""Contract checker for decision makers: mechanisms, leakage and comparisons rely on these promises."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem
from inscrutable.testing.promises import check_shape, promise, source_of, tried_beliefs
from inscrutable.validation import Array

_CERTAIN = 6
"""Number of nearly certain beliefs to try."""


class _Law(NamedTuple):
    """The decisions played under each belief."""

    points: Array  # (T,k,U)
    shares: Array  # (T,k)


def check_decision_maker(
    decision_maker: Any, *, rng: np.random.Generator | None = None, tolerance: float = tolerances.SAME_EXPECTED_COST
) -> None:
    """Check on random beliefs that a decision maker keeps its promises; silent where it does.

    The promises are:

    - it has a `problem` and `decide_many`;
    - a result has one decision per row (`action`), or `actions` with `probabilities` that sum to one;
    - decisions are feasible;
    - equal beliefs get equal laws when repeated, alone or among others, and from `decide` if it exists (unless `is_memoryless`
      is false), and so do stated privacies;
    - a stated `regret` is that of the problem.

    The beliefs are interior, nearly certain and certain ones.

    Args:
        decision_maker: Any object with `problem` and `decide_many`, from this library or written by a user.
        rng: Source of the beliefs; None: a fixed seed, the same at every call.
        tolerance: Largest difference of expected costs of equal laws, relative to the scale of costs, above 0; privacies may
            differ by a millionth.

    Raises:
        AssertionError: A promise is broken; the message names it, with the belief and the number.
        InputError: `decision_maker` has no decision problem or no `decide_many`, or `tolerance` is not above 0.

    Cost: some dozens of decisions. Source: Kerckhoffs' principle: an observer may know the law K(u|π).

    Example:
        >>> from inscrutable import FiniteProblem, OriginalDecisionMaker
        >>> check_decision_maker(OriginalDecisionMaker(FiniteProblem([[0.0, 4.0], [10.0, 4.0]])))
    """
    problem = getattr(decision_maker, "problem", None)
    if not isinstance(problem, DecisionProblem) or not callable(getattr(decision_maker, "decide_many", None)):
        raise InputError(f"a decision maker with `problem` and `decide_many` is needed, got {decision_maker!r}")
    allowed = validation.positive(tolerance, "tolerance")
    beliefs = _beliefs(problem.n_states, source_of(rng))
    given = beliefs.copy()
    answer = decision_maker.decide_many(given)
    promise(bool((given == beliefs).all()), "decide_many leaves the beliefs as they were", "they were changed")
    law = _law_of(problem, answer, len(beliefs))
    _check_feasible(problem, beliefs, law)
    _check_regret(problem, beliefs, law, answer)
    _check_same(problem, beliefs, (law, decision_maker.decide_many(beliefs)), "asked again plays the same", allowed)
    if getattr(decision_maker, "is_memoryless", True):
        _check_alone(decision_maker, beliefs, law, _privacies(answer), allowed)


def _beliefs(n_states: int, source: np.random.Generator) -> Array:
    """Return beliefs to try, including nearly certain ones."""
    tried = tried_beliefs(n_states, source)
    certain = tolerances.NEARLY_CERTAIN * np.eye(n_states)[source.integers(n_states, size=_CERTAIN)]
    return np.vstack(
        [tried, certain + (1.0 - tolerances.NEARLY_CERTAIN) * source.dirichlet(np.ones(n_states), _CERTAIN)]
    )


def _privacies(answer: Any) -> Array | None:
    """Return the stated privacy of a result, in expectation for a lottery; None where it states none."""
    stated = getattr(answer, "expected_privacy", getattr(answer, "privacy", None))
    return None if stated is None else np.atleast_1d(np.asarray(stated, dtype=np.float64))


def _law_of(problem: DecisionProblem, answer: Any, count: int) -> _Law:
    mixed = hasattr(answer, "probabilities")
    promise(
        mixed or hasattr(answer, "action"),
        "an answer has `action`, or `actions` and `probabilities`",
        f"got {answer!r}",
    )
    own = () if problem.is_discrete else (problem.n_actions,)
    if not mixed:
        check_shape("action", np.shape(answer.action), (count, *own))
        return _Law(np.asarray(problem.as_points(answer.action))[:, None, :], np.ones((count, 1)))
    shares = np.asarray(answer.probabilities, dtype=np.float64)
    check_shape("probabilities", shares.shape[:1], (count,))
    check_shape("actions", np.shape(answer.actions), (*shares.shape, *own))
    sums = shares.sum(axis=1)
    worst = int(np.abs(sums - 1.0).argmax())
    proper = bool((shares >= 0.0).all()) and abs(sums[worst] - 1.0) <= tolerances.BELIEF_SUM
    promise(proper, "probabilities are at least 0 and sum to one", f"row {worst} is {shares[worst]}")
    return _Law(np.asarray(problem.as_points(answer.actions)), shares)


def _check_feasible(problem: DecisionProblem, beliefs: Array, law: _Law) -> None:
    row, atom = np.nonzero(law.shares > 0.0)
    beyond = problem.constraints.violation(law.points[row, atom])
    worst = int(beyond.argmax())
    belief, played = beliefs[row[worst]], law.points[row[worst], atom[worst]]
    promise(
        float(beyond[worst]) <= tolerances.FEASIBILITY,
        "what is played is feasible",
        f"for belief {belief} decision {played} violates a row by {beyond[worst]:.3g}",
    )


def _check_regret(problem: DecisionProblem, beliefs: Array, law: _Law, answer: Any) -> None:
    stated = getattr(answer, "regret", None)
    if stated is None:
        return
    check_shape("regret", np.shape(stated), (len(beliefs),))
    costs = np.einsum("tkx,tk,tx->t", problem.state_costs(law.points), law.shares, beliefs)
    off = np.abs(np.asarray(stated) - (costs - problem.optimal_cost(beliefs)))
    worst = int(off.argmax())
    promise(
        float(off[worst]) <= tolerances.CONTRACT * _scale(problem, law),
        "a stated regret is the problem's",
        f"for belief {beliefs[worst]} {stated[worst]:.6g} is stated, off by {off[worst]:.3g}",
    )


def _check_alone(decision_maker: Any, beliefs: Array, law: _Law, privacies: Array | None, allowed: float) -> None:
    problem = decision_maker.problem
    decides = getattr(decision_maker, "decide", None)
    for number, belief in enumerate(beliefs):
        row = _Law(law.points[[number]], law.shares[[number]])
        alone = decision_maker.decide_many(belief[None])
        _check_same(problem, belief[None], (row, alone), "decides for one belief alone as among many", allowed)
        _check_privacy(belief, privacies, number, alone, "hides one belief alone as well as among many")
        if decides is not None:
            one = decides(belief)
            _check_same(problem, belief[None], (row, _stacked(one)), "decides for one as decide_many", allowed)
            _check_privacy(belief, privacies, number, one, "hides one belief as well as decide_many")


def _check_privacy(belief: Array, privacies: Array | None, number: int, answer: Any, what: str) -> None:
    """Promise that a stated privacy is the same for a single belief and among others."""
    other = _privacies(answer)
    if privacies is None or other is None:
        return
    among, alone = float(privacies[number]), float(other[0])
    same = np.isclose(among, alone, rtol=tolerances.SAME_PRIVACY, atol=tolerances.SAME_PRIVACY**2, equal_nan=True)
    promise(bool(same), f"a decision maker {what}", f"for belief {belief} {among:.9g} and {alone:.9g} are stated")


def _stacked(one: Any) -> Any:
    """Return one result as the result for a row of one belief."""
    told = [name for name in ("action", "actions", "probabilities") if hasattr(one, name)]
    return SimpleNamespace(**{name: np.asarray(getattr(one, name))[None] for name in told})


def _check_same(problem: DecisionProblem, beliefs: Array, pair: tuple[_Law, Any], what: str, allowed: float) -> None:
    """Promise that a law and a result have the same mean costs in every state."""
    law, other = pair[0], _law_of(problem, pair[1], len(beliefs))
    means = [np.einsum("tkx,tk->tx", problem.state_costs(each.points), each.shares) for each in (law, other)]
    off = np.abs(means[0] - means[1]).max(axis=1)
    worst = int(off.argmax())
    promise(
        float(off[worst]) <= allowed * _scale(problem, law),
        f"a decision maker {what}",
        f"for belief {beliefs[worst]} expected costs differ by {off[worst]:.3g}",
    )


def _scale(problem: DecisionProblem, law: _Law) -> float:
    return max(float(np.abs(problem.state_costs(law.points)).max()), np.finfo(float).tiny)
