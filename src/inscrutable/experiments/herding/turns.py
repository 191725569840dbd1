"""Social learning: agents decide in turn on a signal of their own and on the decisions before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.decision_makers import OriginalDecisionMaker
from inscrutable.errors import InputError
from inscrutable.experiments.herding.decisions import Deciding
from inscrutable.experiments.herding.reached import reached
from inscrutable.experiments.herding.results import HerdStatus, SocialLearning
from inscrutable.experiments.herding.signals import signals_of
from inscrutable.experiments.herding.simulated import simulated
from inscrutable.mechanisms.played import PlaysMany, checked_memoryless
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.worlds import Emission

_MOST_REACHED = 4096
"""Public beliefs up to which they are all followed; where none are equal, eleven decisions between two choices lead to them."""

_PATHS = 1000


def social_learning(
    problem: DecisionProblem,
    emission: Emission,
    decision_maker: PlaysMany | Sequence[PlaysMany] | None = None,
    *,
    n_agents: int,
    prior: ArrayLike | None = None,
    rng: np.random.Generator | None = None,
    n_paths: int | None = None,
) -> SocialLearning:
    """Return what agents come to who decide in turn, each on a signal of its own and on all decisions before.

    Formula: those of `SocialLearning`. The state x is drawn once; everybody knows the prior, the sensor and each rule K.
    A cascade begins at a public belief at which K(·|π) is the same after every signal; nothing is then learned any more. Two
    states, two choices, two symbols of accuracy p and a coin at ties: after two agents a right cascade has begun with the
    chance p(p+1)/2, a wrong one with (1−p)(2−p)/2; in the end a right one with p(p+1)/2 / (1−p+p²).

    Args:
        problem: What every agent decides, with X states.
        emission: Every agent's sensor over the X states; signals are independent given the state.
        decision_maker: Every agent's rule, or a sequence with one for each; it decides by the private belief alone. None is
            `OriginalDecisionMaker(problem)`; in a `FiniteProblem` it tosses a fair coin among tied choices.
            `CoinDecisionMaker.response` is ε-randomised response.
        n_agents: N, at least 1.
        prior: Public belief before the first decision, shape (X,); None is the uniform one.
        rng: Source of simulated paths; without it only what is exact is returned.
        n_paths: Simulated paths, at least 1. None is exact where at most 4,096 public beliefs can be reached and the sensor has
            symbols, else 1,000 paths; a number always simulates.

    Returns:
        A `SocialLearning`, whose status says whether it is exact. Gaussian signals are rounded to a fifth of a standard
        deviation or less where one number holds their evidence; other sensors report one of 500 signals drawn from each state.

    Raises:
        InputError: An argument is malformed, states differ in number or labels, a decision maker has a memory or another
            problem, or there is no `rng` where paths must be simulated.

    Cost: exact, one decision for each public belief and signal, and a sparse product an agent; simulated, a decision for each
    agent, distinct public belief and signal.

    Source: Bikhchandani, Hirshleifer and Welch, A theory of fads, fashion, custom, and cultural change (1992); Smith and
    Sørensen, Pathological outcomes of observational learning (2000); Liu and Rahimian (arXiv
    2502.19525), for randomised response.

    Example:
        >>> from inscrutable import CategoricalEmission, FiniteProblem
        >>> guess, sensor = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), CategoricalEmission([[0.7, 0.3], [0.3, 0.7]])
        >>> two = social_learning(guess, sensor, n_agents=2)
        >>> round(two.right, 6), round(two.wrong, 6), round(two.none, 6)
        (0.595, 0.195, 0.21)
    """
    checked, count = checked_problem(problem), validation.count(n_agents, "n_agents")
    n_states = checked.n_states
    uniform = np.full(n_states, 1.0 / n_states)
    start = uniform if prior is None else validation.one_belief(prior, n_states, "prior", names=checked.state_names)
    paths = None if n_paths is None else validation.count(n_paths, "n_paths")
    source = None if rng is None else validation.generator(rng)
    rules = _rules(checked, decision_maker, count)
    signals = signals_of(emission, checked, source)
    distinct = {id(rule): Deciding(checked, signals.probabilities, rule) for rule in rules}
    agents = [distinct[id(rule)] for rule in rules]
    if signals.is_exact and paths is None:
        found = reached(agents, start, _MOST_REACHED)
        if found is not None:
            return found
    if source is None:
        why = f"more than {_MOST_REACHED} public beliefs can be reached" if paths is None else f"n_paths is {paths}"
        raise InputError(
            f"{why}, so that paths are simulated: rng must be a numpy.random.Generator such as numpy.random.default_rng(0), "
            "got None"
        )
    status = HerdStatus.SIMULATED if signals.is_exact else HerdStatus.MAJORITIES
    return simulated(agents, start, paths or _PATHS, status, source)


def _rules(problem: DecisionProblem, given: Any, count: int) -> list[PlaysMany]:
    """One decision maker for each agent; raise `InputError` for one that cannot decide on the problem's beliefs."""
    if given is None:
        given = OriginalDecisionMaker(problem)
    rules = list(given) if isinstance(given, (list, tuple)) else [given] * count
    if len(rules) != count:
        raise InputError(f"{len(rules)} decision makers for {count} agents: give one for all, or one for each")
    for rule in {id(each): each for each in rules}.values():
        own = checked_memoryless(rule).problem
        if (own.n_states, own.n_actions, own.is_discrete) != (problem.n_states, problem.n_actions, problem.is_discrete):
            raise InputError(f"{type(rule).__name__} decides on {own!r}, the agents on {problem!r}")
    return rules
