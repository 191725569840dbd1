"""Herding on simulated paths: states and decisions are drawn, the public belief of each path is followed exactly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from inscrutable.experiments.herding.decisions import Deciding, TurnOutcomes
from inscrutable.experiments.herding.reached import equal_beliefs
from inscrutable.experiments.herding.results import HerdStatus, Simulation, SocialLearning, found_of
from inscrutable.mechanisms.drawing import RowDraws
from inscrutable.validation import Array


def simulated(
    agents: Sequence[Deciding], prior: Array, n_paths: int, status: HerdStatus, rng: np.random.Generator
) -> SocialLearning:
    """Return the figures of agents who decide in turn, over paths with a true state drawn from the prior."""
    n_states, path = len(prior), np.arange(n_paths)
    states = rng.choice(n_states, size=n_paths, p=prior / prior.sum())
    beliefs = np.tile(prior, (n_paths, 1))
    lead, totals = np.zeros(n_paths), np.zeros(n_paths)
    herds, truths, turns = [], [], []
    for turn, agent in enumerate([*agents, agents[-1]]):
        kept, node = np.unique(equal_beliefs(beliefs), return_inverse=True)
        node = node.reshape(-1)
        found = agent.at(beliefs[kept])
        truths.append(float(beliefs[path, states].mean()))
        herds.append(_majority(lead) if status is HerdStatus.MAJORITIES else _cascade(found, node, states))
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
    error = float(totals.std() / np.sqrt(n_paths))
    simulation = Simulation(error, n_paths, status)
    return found_of(beliefs, joint, np.array(herds), np.array(turns), np.array(truths), simulation)


def _outcomes(found: TurnOutcomes, node: np.ndarray, states: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """An outcome for each path (P,), drawn from the law of the decision in its true state."""
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
