"""The finitely many private beliefs that an agent with a sensor of symbols can reach in a few steps."""

from __future__ import annotations

import numpy as np

from inscrutable import validation
from inscrutable.errors import InputError, ModelError
from inscrutable.mechanisms.same_actions import equal_beliefs
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel
from inscrutable.worlds.public import joint_symbols


def reachable_beliefs(world: HiddenMarkovModel, n_steps: int, *, limit: int = 20_000) -> Array:
    """Return every belief that a world's filter can reach within its first observations.

    Formula: {π_t : t < n_steps, y_0..t of positive probability}; beliefs are one whose probabilities agree to
    `tolerances.REACHED_BELIEF`, as a share of each. A mechanism on these beliefs makes `SequentialAdversary` exact.

    Args:
        world: A world whose sensor, and the public one where there is one, is a `CategoricalEmission`; Y symbols or pairs.
        n_steps: Number of observations, at least 1.
        limit: Largest number of beliefs; up to Y + Y² + … + Y^n_steps may differ.

    Returns:
        Shape (B,X), in the order in which they are first reached.

    Raises:
        InputError: The sensor has no symbols, or a number is not whole or below 1.
        ModelError: There are more than `limit`; the step is named.

    Cost: proportional to the number of beliefs times Y.

    Source: the filter's recursion, the paper's eq. (1).

    Example:
        >>> from inscrutable import CategoricalEmission, HiddenMarkovModel
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], CategoricalEmission([[0.8, 0.2], [0.3, 0.7]]))
        >>> len(reachable_beliefs(world, 3))
        14
    """
    pairs = joint_symbols(world.emission, world.public) if isinstance(world, HiddenMarkovModel) else None
    if pairs is None:
        raise InputError(f"a world with a CategoricalEmission is needed, got {world!r}")
    reports = pairs.probabilities.T
    most = validation.count(limit, "limit")
    found, fresh = np.empty((0, world.n_states)), world.initial[None]
    for step in range(validation.count(n_steps, "n_steps")):
        predicted = fresh if step == 0 else fresh @ world.transition
        joint = (predicted[:, None] * reports).reshape(-1, world.n_states)
        total = joint.sum(axis=1, keepdims=True)
        reached = joint[total[:, 0] > 0] / total[total[:, 0] > 0]
        everything = np.vstack([found, reached])
        kept = np.unique(equal_beliefs(everything))
        fresh = everything[kept[kept >= len(found)]]
        found = everything[kept]
        if len(found) > most:
            raise ModelError(f"more than {most} beliefs can be reached within {step + 1} steps: take fewer, or a grid")
        if not len(fresh):
            break
    return np.asarray(found)
