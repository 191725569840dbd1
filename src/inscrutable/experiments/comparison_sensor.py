"""The error of the agent's sensor, estimated from decisions taken for optimal, in a comparison.

A comparison has a chain of beliefs and no sensor. A sensor with one symbol per state, in a persistent chain, replaces the
missing one: its filter gives the beliefs of a path, and the agent decides by the nearest belief of the prior. The naive
estimate's error at that belief is added to the filter's belief; an optimal decision with a single explanation therefore reveals
the filter's belief exactly.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from inscrutable.adversaries import NaiveAdversary, NearOptimalAdversary, estimate_sensor
from inscrutable.errors import ModelError
from inscrutable.experiments.setting import Behaviour, Setting
from inscrutable.filtering import filter_beliefs
from inscrutable.mechanisms import Prior
from inscrutable.mechanisms.drawing import RowDraws
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel

SENSOR_STEPS = 100
"""Length of the path of decisions for the estimate of the sensor; every decision maker has the same path."""

STAYS, ACCURACY = 0.8, 0.7
"""Probabilities that the substitute's state stays and that its sensor names the state; the rest is uniform."""

_SEED = 2


class SensorPath(NamedTuple):
    """The substitute filter's beliefs, and the nearest beliefs of the prior, by which the agent decides."""

    world: HiddenMarkovModel
    sensor: Array  # (X,X)
    beliefs: Array  # (T,X)
    places: np.ndarray  # (T,)


def sensor_error(setting: Setting, behaviour: Behaviour, rng: np.random.Generator) -> float:
    """Return the error of the sensor estimated from a path of decisions, as a share of the error without decisions.

    Formula: min over names of the symbols of ‖B̂ − B‖ / ‖1/X − B‖, Frobenius norm; above 1 where the estimate is worse than
    none. NaN for a single state.
    """
    if setting.problem.n_states < 2:
        return float("nan")
    path = setting.once("sensor path", lambda: _path(setting.prior))
    actions = published(setting, behaviour, path.places, rng)
    shown, place = np.unique(actions, axis=0, return_inverse=True)
    read = read_at_face_value(setting.problem, setting.prior, shown)[place.reshape(-1)]
    misread = path.beliefs + read - setting.prior.beliefs[path.places]
    seen = np.maximum(misread, 0.0)
    true = path.sensor
    n_symbols = true.shape[1]
    even = np.full(true.shape, 1.0 / n_symbols)
    try:
        found = estimate_sensor(
            seen / seen.sum(axis=1, keepdims=True), path.world.transition, n_symbols=n_symbols
        ).probabilities
    except ModelError:
        found = even
    apart = ((found[:, :, None] - true[:, None, :]) ** 2).sum(axis=0)
    return float(np.sqrt(apart[linear_sum_assignment(apart)].sum()) / np.linalg.norm(even - true))


def published(setting: Setting, behaviour: Behaviour, path: np.ndarray, rng: np.random.Generator) -> Array:
    """Return the decisions (T,U) published along a path of beliefs, given as indices (T,) into the prior."""
    teller = behaviour.play or behaviour.memory
    if teller is not None:
        return teller.published(path)
    drawn = RowDraws(behaviour.mechanism.sparse)(path, rng)
    return np.asarray(setting.problem.as_points(behaviour.mechanism.actions)[drawn])


def read_at_face_value(problem: DecisionProblem, prior: Prior, actions: Array) -> Array:
    """Return the naive observer's estimates (M,X) of decisions (M,U).

    Where no belief explains a decision, the estimate is the belief of the prior of least regret.
    """
    read = np.asarray(NaiveAdversary(problem).estimates(actions), dtype=np.float64)
    lost = np.isnan(read[:, 0])
    if lost.any():
        read[lost] = NearOptimalAdversary(problem, 0.0, prior=prior).estimates(actions[lost], nearest=True)
    return np.asarray(read)


def _path(prior: Prior) -> SensorPath:
    """Return a path of the substitute filter, with as many states as the prior."""
    n_states = prior.beliefs.shape[1]

    def mostly(share: float) -> Array:
        rest = (1.0 - share) / (n_states - 1)
        return np.asarray(rest + (share - rest) * np.eye(n_states))

    world = HiddenMarkovModel(mostly(STAYS), CategoricalEmission(mostly(ACCURACY)))
    rng = np.random.default_rng(_SEED)
    beliefs = filter_beliefs(world, world.sample(SENSOR_STEPS, rng=rng).observations).beliefs
    weighed = np.flatnonzero(prior.weights > 0)
    return SensorPath(world, mostly(ACCURACY), beliefs, weighed[cKDTree(prior.beliefs[weighed]).query(beliefs)[1]])
