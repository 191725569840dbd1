"""Herding by dynamic programming on all reachable public beliefs; equal ones are merged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from inscrutable.experiments.herding.decisions import Deciding, sums_at
from inscrutable.experiments.herding.results import SocialLearning, found_of
from inscrutable.mechanisms.same_actions import equal_beliefs
from inscrutable.validation import Array


class _Graph:
    """One agent's decisions at the public beliefs found so far: next public beliefs, probabilities and figures."""

    def __init__(self, agent: Deciding, n_states: int) -> None:
        self.agent = agent
        self.origin, self.target = (np.empty(0, dtype=np.intp) for _ in range(2))
        self.chances, self.regrets, self.settled = (np.empty((0, n_states)) for _ in range(3))
        self.bits, self.prices, self.cascade = np.empty(0), np.empty(0), np.empty(0, dtype=bool)

    def grown(self, found: Array) -> Array:
        """Decide at the new beliefs, and return all beliefs with their successors."""
        known = len(self.bits)
        if known == len(found):
            return found
        new = self.agent.at(found[known:])
        everything = np.vstack([found, new.beliefs])
        first = equal_beliefs(everything)
        kept = np.concatenate([np.arange(len(found)), np.unique(first[first >= len(found)])])
        more = {"origin": new.origin + known, "target": np.searchsorted(kept, first[len(found) :])}
        more |= {name: getattr(new, name) for name in ("chances", "regrets", "settled", "bits", "prices", "cascade")}
        for name, part in more.items():
            setattr(self, name, np.concatenate([getattr(self, name), part]))
        return np.asarray(everything[kept])

    def moved(self, joint: Array, size: int) -> Array:
        """The joint law of public belief and state after the decision, shape (size,X)."""
        return sums_at(self.target, joint[self.origin] * self.chances, size)

    def herd(self, joint: Array) -> Array:
        """Return the probabilities of a right cascade, a wrong one and none."""
        inside = joint[self.cascade]
        right = float((inside * self.settled[self.cascade]).sum())
        return np.array([right, float(inside.sum()) - right, float(joint[~self.cascade].sum())])


def reached(agents: Sequence[Deciding], prior: Array, most: int) -> SocialLearning | None:
    """Return the exact figures of agents who decide in turn; None for more than `most` reachable public beliefs."""
    graphs = {id(agent): _Graph(agent, len(prior)) for agent in agents}
    turns = [graphs[id(agent)] for agent in agents]
    found, joint = prior[None], prior[None]
    herds, truths, turn = [], [], []
    for graph in [*turns, turns[-1]]:  # the last agent once more, for the cascade after its decision
        larger = graph.grown(found)
        if len(larger) > most:
            return None
        herds.append(graph.herd(joint))
        truths.append(float((joint * found).sum()))
        if len(herds) <= len(turns):
            weights = joint.sum(axis=1)
            turn.append(
                [float((joint * graph.regrets).sum()), float(weights @ graph.prices), float(weights @ graph.bits)]
            )
            joint = graph.moved(joint, len(larger))
            found = larger
    held = joint.sum(axis=1) > 0
    return found_of(found[held], joint[held], np.array(herds), np.array(turn), np.array(truths))
