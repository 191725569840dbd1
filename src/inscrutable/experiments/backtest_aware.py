"""The aware observers of a backtest: they know the rules, the prior, and how the belief moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.special import entr

from inscrutable.adversaries import BayesianAdversary, SequentialAdversary
from inscrutable.experiments.cell_mechanism import N_NEAREST, cell_beliefs, cell_mechanism
from inscrutable.experiments.episodes import Episode
from inscrutable.geometry.grids import largest_resolution
from inscrutable.mechanisms import Disclosure, Mechanism, Prior, mechanism
from inscrutable.mechanisms.chains import BeliefChain, predicted_chain
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
_DOUBT = 0.01
"""Probability that a rival gives to the belief being drawn anew; from 0.001 to 0.2 its errors are the same to 0.002."""


class Beside(NamedTuple):
    """The disclosure of decisions to observers, and their other observations."""

    disclosure: Disclosure = Disclosure()
    returns: Array | None = None  # (T,U): what portfolios earn, for a disclosure that shows nothing else of them
    public: PublicSymbols | None = None


@dataclass(frozen=True, eq=False)
class AwareReading:
    """Estimates of the aware observers: one uses each decision alone, one all decisions up to it.

    Args:
        prior: The long-run law of the belief in the fitted world, on a grid: what the rival holds likely.
        estimates: Posterior means, shape (T,X), by decision maker. A decision that the mechanism plays in no cell of the grid
            is read as one of the `N_NEAREST` nearest that it plays.
        leakages: Leakage of one decision under the prior, by decision maker.
        followed: Posterior means given all decisions so far, shape (T,X), by decision maker.
        bits: Leakage of each decision beyond those before, I(π_t; u_t | u_0..u_{t−1}) under the rival's law, shape (T,).
        beside_public: The same as `followed` with public observations; empty where there are none.
        regrets: Expected regret in the long run of the fitted world, by decision maker.
        ceilings: Root mean square error that no rule of such a regret leaves the aware observer over time, in the long run of
            the fitted world; without those for which it was not computed.
        disclosed: As `followed`, under the settings' disclosure; empty where it shows everything.

    Source: Kerckhoffs' principle with Bayes' rule.
    """

    prior: Prior
    estimates: Mapping[str, Array]
    leakages: Mapping[str, Leakage]
    followed: Mapping[str, Array]
    bits: Mapping[str, Array]
    regrets: Mapping[str, float]
    ceilings: Mapping[str, float]
    disclosed: Mapping[str, Array] = field(default_factory=dict)
    beside_public: Mapping[str, Array] = field(default_factory=dict)


def beliefs_resolution(n_states: int, most: int | None = None) -> int:
    """Return the finest resolution whose grid of beliefs is small enough to decide on, or for a given number."""
    if most is None:
        most = _MOST_BELIEFS if n_states <= _WALKED_STATES else _FEWER_BELIEFS
    return min(largest_resolution(n_states, most), _FINEST)


def doubted(chain: BeliefChain) -> BeliefChain:
    """Return the chain mixed with independent draws from the prior, so that no move has probability 0.

    Formula: (1 − ε) T + ε 1 w', whose stationary law is still the prior w. Without this mixture, every fifth row of real data
    has probability 0, and the observer's error exceeds that from single decisions.
    """
    weights = chain.prior.weights
    anew = np.tile(weights, (len(chain.prior), 1))
    tables = None
    if chain.public is not None:  # a symbol read in a redraw carries no information about the belief
        tables = [(1.0 - _DOUBT) * each.toarray() + _DOUBT * (weights @ each).sum() * anew for each in chain.public]
    return BeliefChain(chain.prior, (1.0 - _DOUBT) * chain.transition.toarray() + _DOUBT * anew, tables)


class PublicSymbols(NamedTuple):
    """The public observations as symbols, for rivals who follow beliefs on a grid."""

    world: HiddenMarkovModel  # the investor's, with one public number
    cuts: Array
    read: np.ndarray  # (T,)


def rivals_chain(
    world: HiddenMarkovModel, resolution: int, public: PublicSymbols | None, *, rng: np.random.Generator
) -> BeliefChain:
    """Return the chain of the investor's belief as a rival assumes it, with the tables of public symbols, if any."""
    if public is None:
        return doubted(predicted_chain(world, resolution, rng=rng))
    return doubted(predicted_chain(public.world, resolution, rng=rng, cuts=public.cuts))


def without_public(chain: BeliefChain) -> BeliefChain:
    """Return the chain without public observations."""
    return BeliefChain(chain.prior, chain.transition)


def read_knowingly(
    episode: Episode,
    world: HiddenMarkovModel,
    decision_makers: Mapping[str, PlaysMany],
    measure: PrivacyMeasure,
    *,
    rng: np.random.Generator,
    beside: Beside = Beside(),  # noqa: B008  # frozen
) -> AwareReading | None:
    """Return the estimates of the aware observers; None where the target changes per step."""
    if isinstance(measure, DesiredObfuscation) and follows_steps(measure):
        return None
    disclosure, returns, public = beside
    resolution = beliefs_resolution(world.n_states)
    reading = rivals_chain(world, resolution, public, rng=rng)
    chain, prior = without_public(reading), reading.prior
    in_cells = cell_beliefs(prior, world if public is None else public.world, resolution, rng=rng)
    estimates, leakages, followed, bits, disclosed, told = {}, {}, {}, {}, {}, {}
    for name, decision_maker in decision_makers.items():
        played = mechanism(decision_maker, prior.beliefs)
        leakages[name] = leakage(played, prior, episode.problem)
        actions = episode.records[name].decisions.action
        known = cell_mechanism(decision_maker, prior, in_cells)
        estimates[name] = BayesianAdversary(known, prior).estimates(actions, nearest=N_NEAREST)
        found = SequentialAdversary(chain, known).filter(actions, nearest=N_NEAREST)
        followed[name] = found.mean
        if not disclosure.is_exact:
            through = {"returns": returns} if disclosure.needs_returns else {}
            rival = SequentialAdversary(chain, known, disclosure=disclosure)
            disclosed[name] = rival.filter(disclosure(actions, **through), nearest=N_NEAREST, **through).mean
        bits[name] = _bits(np.vstack([prior.weights, found.weights[:-1] @ chain.transition]), played)
        if public is not None:
            rival = SequentialAdversary(reading, known)
            told[name] = rival.filter(actions, public=public.read, nearest=N_NEAREST).mean
    regrets = {name: each.expected_regret for name, each in leakages.items()}
    return AwareReading(prior, estimates, leakages, followed, bits, regrets, {}, disclosed, told)


def _bits(laws: Array, played: Mechanism) -> Array:
    """Return I(π;u) in bits for each of the laws (T,B) of the belief: Σ p K log K − Σ p_u log p_u."""
    table = sparse.csr_array(played.observed)
    logs = table.copy()
    logs.data = entr(logs.data)
    return np.asarray((entr(laws @ table).sum(axis=1) - laws @ np.asarray(logs.sum(axis=1)).reshape(-1)) / np.log(2.0))


def follows_steps(measure: DesiredObfuscation) -> bool:
    """Whether the target is another one at every step, so that no mechanism K(u|π) describes the decisions."""
    return not callable(measure.target) and np.ndim(measure.target) > 1
