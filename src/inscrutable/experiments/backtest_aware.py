"""A rival who knows how the published weights are made: the mechanism, and how often the investor holds which belief."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from inscrutable.adversaries import BayesianAdversary
from inscrutable.experiments.episodes import Episode
from inscrutable.geometry.grids import grid_size
from inscrutable.mechanisms import Prior, mechanism, predicted_prior
from inscrutable.mechanisms.played import PlaysMany
from inscrutable.privacy import DesiredObfuscation, Leakage, PrivacyMeasure, leakage
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel

_MOST_BELIEFS = 500
"""Beliefs of the rival's grid for up to three regimes, where many beliefs are decided in one walk."""
_FEWER_BELIEFS = 150
"""For more regimes, where each takes some hundredths of a second."""
_FINEST = 100
_WALKED_STATES = 3


@dataclass(frozen=True, eq=False)
class AwareReading:
    """What a rival reads who knows the mechanism and the prior, decision by decision.

    Args:
        prior: The long-run law of the belief in the fitted world, on a grid: what the rival holds likely.
        estimates: Posterior means, shape (T,X), by decision maker. A decision that the mechanism plays under no belief of
            the grid is read as the nearest one that it plays.
        leakages: What one decision tells under the prior, by decision maker.

    Source: Kerckhoffs' principle with Bayes' rule.
    """

    prior: Prior
    estimates: Mapping[str, Array]
    leakages: Mapping[str, Leakage]


def resolution_for(n_states: int) -> int:
    """Return the finest resolution whose grid of beliefs is small enough to be decided on."""
    most = _MOST_BELIEFS if n_states <= _WALKED_STATES else _FEWER_BELIEFS
    fits = (r for r in range(_FINEST, 1, -1) if grid_size(n_states, r) <= most)
    return next(fits, 1)


def read_knowingly(
    episode: Episode,
    world: HiddenMarkovModel,
    decision_makers: Mapping[str, PlaysMany],
    measure: PrivacyMeasure,
    *,
    rng: np.random.Generator,
) -> AwareReading | None:
    """Return what a rival reads who knows the decision makers; None where they follow a target per step."""
    if isinstance(measure, DesiredObfuscation) and follows_steps(measure):
        return None
    prior = predicted_prior(world, resolution_for(world.n_states), rng=rng)
    estimates, leakages = {}, {}
    for name, decision_maker in decision_makers.items():
        played = mechanism(decision_maker, prior.beliefs)
        actions = episode.records[name].decisions.action
        estimates[name] = BayesianAdversary(played, prior).estimates(actions, nearest=True)
        leakages[name] = leakage(played, prior, episode.problem)
    return AwareReading(prior, estimates, leakages)


def follows_steps(measure: DesiredObfuscation) -> bool:
    """Whether the target is another one at every step, so that no mechanism K(u|π) describes the decisions."""
    return not callable(measure.target) and np.ndim(measure.target) > 1
