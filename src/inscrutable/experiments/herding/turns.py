"""Social learning: agents decide in turn, given a signal of their own and the decisions before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from inscrutable import validation
from inscrutable.axes import check_same_order
from inscrutable.decision_makers import OriginalDecisionMaker
from inscrutable.errors import InputError
from inscrutable.experiments.herding.decisions import Deciding, TurnOutcomes
from inscrutable.experiments.herding.reached import reached
from inscrutable.experiments.herding.results import HerdStatus, Simulation, SocialLearning, found_of
from inscrutable.experiments.herding.signals import signals_of
from inscrutable.mechanisms.drawing import RowDraws
from inscrutable.mechanisms.played import PlaysMany, checked_memoryless
from inscrutable.mechanisms.same_actions import equal_beliefs
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array
from inscrutable.worlds import Emission

_MOST_REACHED = 4096
"""Most reachable public beliefs for exact figures; eleven decisions between two choices reach them if none are equal."""

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
    """Return the results of agents who decide in turn, each given its own signal and all decisions before.

    Formula: those of `SocialLearning`. The state x is drawn once; all agents know the prior, the sensor and each rule K. A
    cascade begins at a public belief at which K(·|π) is the same after every signal; learning then ends. Example with two
    states, two choices, two symbols of accuracy p and a coin at ties: after two agents a right cascade has begun with
    probability p(p+1)/2, a wrong one with probability (1−p)(2−p)/2; the limit of the former is p(p+1)/2 / (1−p+p²).

    Args:
        problem: Every agent's decision problem, with X states.
        emission: Every agent's sensor over the X states; signals are independent given the state.
        decision_maker: Every agent's rule, or a sequence of one rule per agent; it depends on the private belief alone and
            may follow a problem of its own. None is `OriginalDecisionMaker(problem)`; in a `FiniteProblem` it tosses a fair
            coin among tied choices. `CoinDecisionMaker.response` is ε-randomised response.
        n_agents: N, at least 1.
        prior: Public belief before the first decision, shape (X,); None is the uniform one.
        rng: Source of simulated paths; without it only exact results are possible.
        n_paths: Simulated paths, at least 1. None: exact for sensors with symbols and at most 4,096 reachable public beliefs,
            else 1,000 paths. A number always simulates.

    Returns:
        A `SocialLearning`, whose status says whether it is exact. Gaussian signals with a scalar sufficient statistic are
        rounded to a fifth of a standard deviation or less; other sensors report one of 500 signals drawn from each state, whose
        own error no standard error includes.

    Raises:
        InputError: An argument is malformed, states differ in number or labels, a decision maker has a memory or decides on
            other states or decisions, by number or labels, or there is no `rng` where paths must be simulated.

    Cost: exact: one decision per public belief and signal, and one sparse product per agent. Simulated: one decision per agent,
    distinct public belief and signal.

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
    return simulated(agents, start, Simulation(0.0, paths or _PATHS, status, signals.n_drawn), source)


def _rules(problem: DecisionProblem, given: Any, count: int) -> list[PlaysMany]:
    """Return one decision maker per agent; raise `InputError` for one that cannot decide on the problem's beliefs."""
    if given is None:
        given = OriginalDecisionMaker(problem)
    rules = list(given) if isinstance(given, (list, tuple)) else [given] * count
    if len(rules) != count:
        raise InputError(f"{len(rules)} decision makers for {count} agents: give one for all, or one for each")
    for rule in {id(each): each for each in rules}.values():
        own = checked_memoryless(rule).problem
        if (own.n_states, own.n_actions, own.is_discrete) != (problem.n_states, problem.n_actions, problem.is_discrete):
            raise InputError(f"{type(rule).__name__} decides on {own!r}, the agents on {problem!r}")
        name = f"the problem of {type(rule).__name__}"
        check_same_order("state", (name, own.state_names), ("the agents' problem", problem.state_names))
        check_same_order("asset", (name, own.asset_names), ("the agents' problem", problem.asset_names))
    return rules


def simulated(agents: Sequence[Deciding], prior: Array, how: Simulation, rng: np.random.Generator) -> SocialLearning:
    """Return the simulated figures of agents who decide in turn, with true states drawn from the prior."""
    n_paths, n_states, path = how.n_paths, len(prior), np.arange(how.n_paths)
    states = rng.choice(n_states, size=n_paths, p=prior / prior.sum())
    beliefs = np.tile(prior, (n_paths, 1))
    lead, totals = np.zeros(n_paths), np.zeros(n_paths)
    herds, truths, turns = [], [], []
    for turn, agent in enumerate([*agents, agents[-1]]):
        kept, node = np.unique(equal_beliefs(beliefs), return_inverse=True)
        node = node.reshape(-1)
        found = agent.at(beliefs[kept])
        truths.append(float(beliefs[path, states].mean()))
        herds.append(_majority(lead) if how.status is HerdStatus.MAJORITIES else _cascade(found, node, states))
        if turn == len(agents):
            break
        spent = found.regrets[node, states]
        totals += spent
        turns.append([float(each.mean()) for each in (spent, found.prices[node], found.bits[node])])
        drawn = _outcomes(found, node, states, rng)
        lead += np.where(found.is_right[drawn, states], 1.0, -1.0)
        beliefs = found.beliefs[drawn]
    joint = np.zeros((n_paths, n_states))
    joint[path, states] = 1.0 / n_paths
    how = how._replace(welfare_error=float(totals.std() / np.sqrt(n_paths)))
    return found_of(beliefs, joint, np.array(herds), np.array(turns), np.array(truths), how)


def _outcomes(found: TurnOutcomes, node: np.ndarray, states: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Draw an outcome for each path (P,), from the law of the decision in its true state."""
    n_nodes, n_states = found.regrets.shape
    place, state = np.nonzero(found.chances > 0)
    rows = state * n_nodes + found.origin[place]
    table = sparse.csr_array(
        (found.chances[place, state], (rows, place)), shape=(n_nodes * n_states, len(found.origin))
    )
    return RowDraws(table)(states * n_nodes + node, rng)


def _cascade(found: TurnOutcomes, node: np.ndarray, states: np.ndarray) -> Array:
    inside = found.cascade[node]
    right = float((inside * found.settled[node, states]).mean())
    return np.array([right, float(inside.mean()) - right, 1.0 - float(inside.mean())])


def _majority(lead: Array) -> Array:
    return np.array([float((lead > 0).mean()), float((lead < 0).mean()), float((lead == 0).mean())])
