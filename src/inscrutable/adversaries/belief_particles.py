"""The inverse filter by particles: a particle is a private belief of the agent with the law of the state given it.

A particle is a private belief π_n with a joint weight a_n(x) over states: the state is summed over, not drawn
(Rao-Blackwellised). For a sensor with symbols, every successor T(π_n,y) becomes a candidate with weight Σ_x B[x',y] P[x,x']
a_n(x). For any other sensor, observations are drawn from the observer's prediction given its public reading. Given the path of
beliefs, the memory is independent of the state, so each particle carries the exact law of the memory. The evidence then weighs
the candidates, and unbiased resampling without duplicates reduces them to the number of particles.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from inscrutable.adversaries.agent_steps import AgentModel, scaled_likelihoods
from inscrutable.adversaries.belief_points import BeliefPoints, PointMixture
from inscrutable.adversaries.decision_tables import UNSEEN, DecisionTables, KnownRule
from inscrutable.adversaries.sequence_evidence import Evidence, impossible_step
from inscrutable.adversaries.sequence_results import InferredBeliefs, SequenceStatus
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, Emission, HiddenMarkovModel
from inscrutable.worlds.public import UNREAD, PublicPart, conditional_draws, joint_symbols

_DRAWN_PER_PARTICLE = 4


class Cloud(NamedTuple):
    """The particles of one step."""

    beliefs: Array  # (N, X)
    joint: Array  # (N, X), sums to one
    likelihoods: Array  # (N, X): likelihood of this step's observation and evidence, up to a factor per particle
    parents: np.ndarray  # (N,) particles of the step before


class PublicReading(NamedTuple):
    """The public observation that the observer read at a step."""

    values: Any = None  # (Z,), or a symbol; None where only its number is known, or nothing was read
    likelihoods: Any = None  # (X,): p(z|x) in the observer's world, up to exp(offset)
    own: Any = None  # (X,): the same in the agent's, up to a factor
    offset: float = 0.0
    symbol: int = UNREAD  # where both sensors report symbols
    is_drawn: bool = False  # whether it was not read and has to be drawn


_NOTHING = PublicReading()


class Remembered(NamedTuple):
    """The law of the agent's memory, given each particle's path."""

    law: Array  # (N, A)
    memories: np.ndarray  # (A,)

    def of(self, particles: np.ndarray) -> Remembered:
        """Return the laws of the memory on the paths of some particles, or of their successors."""
        return Remembered(self.law[particles], self.memories)


@dataclass
class _Track:
    """The figures of every step, as the smoother needs them."""

    mean: Array
    spread: Array
    states: Array
    weights: Array
    size: Array
    errors: Array
    logs: Array
    statuses: list[SequenceStatus]


class BeliefParticles:
    """A run of particles over a sequence of evidence."""

    def __init__(
        self,
        world: HiddenMarkovModel,
        agent: AgentModel,
        rule: KnownRule,
        points: BeliefPoints,
        n_particles: int,
    ) -> None:
        self._world, self._agent, self._rule, self._points = world, agent, rule, points
        self._n_particles = n_particles
        self._symbols = joint_symbols(world.emission, world.public)

    def run(
        self,
        evidence: Evidence,
        rng: np.random.Generator,
        *,
        smooth: bool,
        tables: list[DecisionTables] | None = None,
    ) -> tuple[InferredBeliefs, list[DecisionTables]]:
        """Filter a sequence, and smooth it if asked; `tables` replaces the decision tables of this observer's law."""
        used: list[DecisionTables] = []
        track = _empty_track(len(evidence), self._world.n_states, len(self._points))
        clouds: list[Cloud] = []
        cloud, last = None, None
        initial = self._rule.initial if evidence.told is None else np.eye(len(self._rule.initial))[evidence.told[0]]
        held = Remembered(initial[None, initial > 0], np.flatnonzero(initial))
        for t in range(len(evidence)):
            read = self._read(evidence, t)
            cloud = self._candidates(cloud, evidence.states[t], read, rng)
            if not cloud.joint.sum() > 0:
                raise impossible_step(t)
            held = held.of(cloud.parents)
            mixture, before = self._points.mixed(cloud.beliefs), cloud.joint.sum(axis=1)
            track.errors[t] = float(before @ mixture.errors / before.sum())
            known = (
                tables[t]
                if tables is not None
                else self._rule.at(self._on_points(before, mixture), last, seen=evidence.is_seen(t))
            )
            used.append(known)
            if evidence.is_seen(t):  # ties go to the latest observation
                last = known.action(known.column(evidence.points[t], evidence.nearest)[0])
            cloud, held = self._weighed(cloud, held, mixture, evidence, t, known, track)
            track.logs[t] += read.offset
            cloud, alive = _thinned(cloud, self._n_particles, rng)
            held = held.of(alive)
            if smooth:
                clouds.append(cloud)
        if smooth:
            self._smooth(clouds, track)
        found = InferredBeliefs(
            self._points.points,
            track.weights,
            track.mean,
            track.spread,
            track.states,
            track.logs,
            tuple(track.statuses),
            track.size,
            track.errors,
            self._n_particles,
        )
        return found, used

    def _read(self, evidence: Evidence, t: int) -> PublicReading:
        """Return the public reading of a step, as likelihoods in the observer's world and in the agent's."""
        if evidence.public is None:
            return _NOTHING
        if evidence.public.ndim == 1:
            symbol = int(evidence.public[t])
            if self._symbols is not None:
                return PublicReading(symbol=symbol)
            values: Any = evidence.public[t : t + 1]
            if symbol == UNREAD:
                return PublicReading(is_drawn=True)
        else:
            values = evidence.public[t : t + 1]
            if np.isnan(values).any():
                return PublicReading(is_drawn=True)
        emission: Any = self._world.public_emission
        logs = np.asarray(emission.log_likelihoods(values), dtype=np.float64)[0]
        offset = float(logs.max())
        if np.isneginf(offset):
            raise impossible_step(t)
        other: Any = self._agent.world.public_emission
        own = scaled_likelihoods(other, values)[0]
        return PublicReading(values[0], np.exp(logs - offset), own, offset)

    def _candidates(self, cloud: Cloud | None, seen: Array, read: PublicReading, rng: np.random.Generator) -> Cloud:
        predicted = self._world.initial[None] if cloud is None else cloud.joint @ self._world.transition
        predicted = predicted * seen
        if isinstance(self._world.emission, CategoricalEmission) and not read.is_drawn:
            return self._every_symbol(cloud, predicted, seen, read)
        return self._drawn(cloud, predicted, seen, read, rng)

    def _every_symbol(self, cloud: Cloud | None, predicted: Array, seen: Array, read: PublicReading) -> Cloud:
        """Return a candidate for every symbol that agrees with the public reading."""
        agent = self._agent
        if self._symbols is not None:
            agreeing = read.symbol == UNREAD or self._symbols.public == read.symbol
            some = np.flatnonzero(np.broadcast_to(agreeing, self._symbols.public.shape))
            reports, own = self._symbols.probabilities.T[some], agent.symbols()[some]  # (Y, X)
        else:
            reports = self._world.emission.probabilities.T * read.likelihoods  # type: ignore[attr-defined]
            own = agent.world.emission.probabilities.T * read.own  # type: ignore[attr-defined]
        count, n_states = predicted.shape
        beliefs = agent.first(own) if cloud is None else agent.next(cloud.beliefs, own)
        joint = (predicted[:, None] * reports).reshape(-1, n_states)
        possible = np.flatnonzero(joint.sum(axis=1) > 0)
        return Cloud(
            beliefs.reshape(-1, n_states)[possible],
            joint[possible],
            np.tile(reports * seen, (count, 1))[possible],
            np.repeat(np.arange(count), len(reports))[possible],
        )

    def _drawn(
        self, cloud: Cloud | None, predicted: Array, seen: Array, read: PublicReading, rng: np.random.Generator
    ) -> Cloud:
        """Draw observations from Σ_x p(y|x) predicted(x); the draws of a particle share its weight equally.

        Given a public part z the law is Σ_x p(y|x,z) p(z|x) predicted(x).
        """
        world, is_part = self._world, isinstance(self._world.public, PublicPart)
        predicted = predicted if read.likelihoods is None else predicted * read.likelihoods
        whole = predicted.sum(axis=1)
        possible = np.flatnonzero(whole > 0)
        if not possible.size:
            return Cloud(predicted[:0], predicted[:0], predicted[:0], possible)
        each = -(-_DRAWN_PER_PARTICLE * self._n_particles // possible.size)
        parents = np.repeat(possible, each)
        sums = np.cumsum(predicted[parents], axis=1)
        states = (rng.random(len(parents))[:, None] * sums[:, -1:] >= sums).sum(axis=1)
        states = np.minimum(states, sums.shape[1] - 1)
        if is_part and read.values is not None:
            assert isinstance(world.public, PublicPart)
            observations: Any = conditional_draws(world.public, world.emission, states, read.values, rng=rng)
            # p(y|x) holds p(z|x) already; the density of z itself is the same for all draws of a particle.
            predicted = np.divide(predicted, read.likelihoods, out=np.zeros_like(predicted), where=predicted > 0)
        else:
            observations = world.emission.sample(states, rng=rng)
        likelihoods, reported = scaled_likelihoods(world.emission, observations), self._agent.likelihoods(observations)
        joint = predicted[parents] * likelihoods
        # The prediction contains the observer's p(z|x); the agent's filter needs the agent's p(z|x).
        if not is_part and read.likelihoods is not None:
            likelihoods, reported = likelihoods * read.likelihoods, reported * read.own
        elif not is_part and read.is_drawn:
            assert isinstance(world.public, Emission)
            values = world.public.sample(states, rng=rng)
            other: Any = self._agent.world.public_emission
            told, own = (scaled_likelihoods(each, values) for each in (world.public, other))
            likelihoods, reported, joint = likelihoods * told, reported * own, joint * told
        joint *= (whole[parents] / each / joint.sum(axis=1))[:, None]
        before = None if cloud is None else cloud.beliefs[parents]
        return Cloud(self._agent.next_paired(before, reported), joint, likelihoods * seen, parents)

    def _weighed(
        self,
        cloud: Cloud,
        held: Remembered,
        mixture: PointMixture,
        evidence: Evidence,
        t: int,
        known: DecisionTables,
        track: _Track,
    ) -> tuple[Cloud, Remembered]:
        column, moved = known.column(evidence.points[t], evidence.nearest)
        told = None if evidence.told is None else int(evidence.told[t + 1])
        before = cloud.joint.sum(axis=1)
        later = _played(known, column, told, mixture, held)
        total = float(before @ later.law.sum(axis=1))
        with np.errstate(divide="ignore"):
            track.logs[t] = np.log(total) + evidence.offsets[t]
        track.statuses.append(evidence.status(column, moved, total))
        if not total > 0:
            later = _played(known, UNSEEN, told, mixture, held)
            total = float(before @ later.law.sum(axis=1))
        if not total > 0:  # a public memory that the mechanism rules out is accepted nevertheless
            later = Remembered(np.ones((len(before), 1)), np.array([told]))
            total = float(before.sum())
        shares = later.law.sum(axis=1)
        joint = cloud.joint * (shares / total)[:, None]
        weights = joint.sum(axis=1)
        track.size[t] = 1.0 / (weights**2).sum()
        self._record(track, t, cloud.beliefs, weights, mixture)
        track.states[t] = joint.sum(axis=0)
        law = np.divide(later.law, shares[:, None], out=np.zeros_like(later.law), where=shares[:, None] > 0)
        return cloud._replace(joint=joint), Remembered(law, later.memories)

    def _on_points(self, weights: Array, mixture: PointMixture) -> Array:
        """Return the weights (N,) of particles as weights (B,) of the points that represent them."""
        spread_out = (weights[:, None] * mixture.shares).reshape(-1)
        return np.asarray(np.bincount(mixture.places.reshape(-1), spread_out, minlength=len(self._points)))

    def _record(self, track: _Track, t: int, beliefs: Array, weights: Array, mixture: PointMixture) -> None:
        track.mean[t] = weights @ beliefs
        track.spread[t] = np.sqrt(weights @ ((beliefs - track.mean[t]) ** 2).sum(axis=1))
        track.weights[t] = self._on_points(weights, mixture)

    def _smooth(self, clouds: list[Cloud], track: _Track) -> None:
        """Follow every final particle back to its ancestors, and smooth the state exactly along each path.

        Only the descendants of a belief can succeed it, so other pairs of particles add nothing.
        """
        weights = clouds[-1].joint.sum(axis=1)
        place = np.arange(len(weights))
        later = np.ones((len(weights), self._world.n_states))
        for t in range(len(clouds) - 1, -1, -1):
            cloud = clouds[t]
            law = cloud.joint[place] * later
            law /= law.sum(axis=1, keepdims=True)
            track.states[t] = weights @ law
            self._record(track, t, cloud.beliefs[place], weights, self._points.mixed(cloud.beliefs[place]))
            track.size[t] = 1.0 / (np.bincount(place, weights) ** 2).sum()
            later = (cloud.likelihoods[place] * later) @ self._world.transition.T
            later /= later.max(axis=1, keepdims=True)
            place = cloud.parents[place]


def _empty_track(n_steps: int, n_states: int, n_points: int) -> _Track:
    return _Track(
        np.empty((n_steps, n_states)),
        np.empty(n_steps),
        np.empty((n_steps, n_states)),
        np.empty((n_steps, n_points)),
        np.empty(n_steps),
        np.empty(n_steps),
        np.empty(n_steps),
        [],
    )


def _played(
    known: DecisionTables, column: int, told: int | None, mixture: PointMixture, held: Remembered
) -> Remembered:
    """Return Σ_n K(u,n'|π,n) p(n) for each particle: π as a mixture of points, p its law of the memory."""
    count, width = len(held.memories), mixture.places.shape[1]
    entries = known.entries(np.full(count, column), held.memories)
    after, place = np.unique(entries.after if told is None else np.array([told]), return_inverse=True)
    some = np.ones(len(entries.after), dtype=bool) if told is None else entries.after == told
    target = place.reshape(-1) if told is None else np.zeros(int(some.sum()), dtype=np.intp)
    n_points = len(known.mechanism.beliefs)
    table = sparse.csr_array(
        (entries.share[some], (entries.belief[some] * count + entries.column[some], target)),
        shape=(n_points * count, len(after)),
    )
    weights = (mixture.shares[:, :, None] * held.law[:, None]).reshape(-1)
    places = (mixture.places[:, :, None] * count + np.arange(count)).reshape(-1)
    rows = np.repeat(np.arange(len(held.law)), width * count)
    spread_out = sparse.csr_array((weights, (rows, places)), shape=(len(held.law), n_points * count))
    found = np.asarray((spread_out @ table).toarray())
    return Remembered(found, after)


def _thinned(cloud: Cloud, n_particles: int, rng: np.random.Generator) -> tuple[Cloud, np.ndarray]:
    """Return at most `n_particles` and their indices: heavy particles stay, the others are resampled systematically.

    A particle of weight w stays with probability min(1, c w) and then has weight max(w, 1/c), where Σ min(1, c w) is the
    number kept (Fearnhead and Clifford, On-line Inference for Hidden Markov Models via Particle Filters, 2003).
    """
    weights = cloud.joint.sum(axis=1)
    alive = np.flatnonzero(weights > 0)
    if alive.size > n_particles:
        chances = _inclusion(weights[alive], n_particles)
        sure = chances >= 1.0
        light = np.flatnonzero(~sure)
        places = np.searchsorted(np.cumsum(chances[light]), rng.random() + np.arange(n_particles - int(sure.sum())))
        kept = np.sort(np.concatenate([np.flatnonzero(sure), light[np.minimum(places, light.size - 1)]]))
        alive, chances = alive[kept], chances[kept]
        joint = cloud.joint[alive] / chances[:, None]
        joint /= joint.sum()
    else:
        joint = cloud.joint[alive]
    return Cloud(cloud.beliefs[alive], joint, cloud.likelihoods[alive], cloud.parents[alive]), alive


def _inclusion(weights: Array, n_kept: int) -> Array:
    """Return min(1, c w) with sum `n_kept`, for more than `n_kept` positive weights."""
    ordered = np.sort(weights)[::-1]
    tails = np.cumsum(ordered[::-1])[::-1]
    factors = (n_kept - np.arange(n_kept)) / tails[:n_kept]
    first = int(np.argmax(factors * ordered[:n_kept] < 1.0)) if (factors * ordered[:n_kept] < 1.0).any() else n_kept - 1
    return np.asarray(np.minimum(1.0, factors[first] * weights))
