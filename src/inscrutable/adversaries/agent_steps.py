"""The agent's belief update after each observation, for many beliefs and observations at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.validation import Array
from inscrutable.worlds import Emission, HiddenMarkovModel
from inscrutable.worlds.public import joint_symbols


class AgentModel:
    """The agent's own filter π' = T(π,y), as its observer simulates it.

    An observation that the agent's model rules out leaves it with its prediction.
    """

    def __init__(self, world: HiddenMarkovModel) -> None:
        self.world = world

    def symbols(self) -> Array:
        """Return p(y | x) of every symbol, or of every pair (private, public) where a sensor is public, shape (Y,X)."""
        pairs = joint_symbols(self.world.emission, self.world.public)
        assert pairs is not None
        return np.asarray(pairs.probabilities.T)

    def likelihoods(self, observations: Any) -> Array:
        """Return p(y_n | x) of the private sensor, shape (N,X); the largest entry of each row is scaled to one."""
        return scaled_likelihoods(self.world.emission, observations)

    def first(self, likelihoods: Array) -> Array:
        """Return the belief after the first observation, for likelihoods (Y,X): shape (1,Y,X)."""
        return _updated(self.world.initial[None, None], likelihoods[None])

    def next(self, beliefs: Array, likelihoods: Array) -> Array:
        """Return T(π_n,y) for every pair of beliefs (N,X) and likelihoods (Y,X): shape (N,Y,X)."""
        return _updated((beliefs @ self.world.transition)[:, None], likelihoods[None])

    def next_paired(self, beliefs: Array | None, likelihoods: Array) -> Array:
        """Return T(π_n,y_n) for beliefs (N,X), or from the initial law, and likelihoods (N,X): shape (N,X)."""
        predicted = self.world.initial[None] if beliefs is None else beliefs @ self.world.transition
        return _updated(predicted, likelihoods)


def scaled_likelihoods(sensor: Emission, observations: Any) -> Array:
    """Return p(y_n | x), shape (N,X); the largest entry of each row is scaled to one."""
    logs = np.asarray(sensor.log_likelihoods(observations), dtype=np.float64)
    largest = logs.max(axis=1, keepdims=True)
    return np.exp(logs - np.where(np.isfinite(largest), largest, 0.0))


def _updated(predicted: Array, likelihoods: Array) -> Array:
    joint = predicted * likelihoods
    total = joint.sum(axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(total > 0, joint / total, np.broadcast_to(predicted, joint.shape)))
