"""What everybody reads: the law of an observer who follows it, against enumeration of all paths of states and reports."""

from __future__ import annotations

import json
import os
from itertools import product

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    BeliefFilter,
    CategoricalEmission,
    GaussianEmission,
    HiddenMarkovModel,
    InputError,
    Mechanism,
    ModelError,
    PublicPart,
    SequentialAdversary,
    filter_beliefs,
    path_leakage,
    reachable_beliefs,
    simplex_grid,
)

EXACT = 1e-12
SEED = int(os.environ.get("FRESH_SEED", "0"))


def merging(rng: np.random.Generator, n_symbols: int, n_public: int) -> PublicPart:
    labels = np.concatenate([np.arange(n_public), rng.integers(n_public, size=n_symbols - n_public)])
    return PublicPart(np.eye(n_public)[rng.permutation(labels)].T)


def random_world(rng: np.random.Generator, kind: str, n_states: int = 2, n_symbols: int = 2) -> HiddenMarkovModel:
    """A world with a public sensor of two symbols, or with a part of its own symbols public."""
    reports = rng.dirichlet(np.ones(n_symbols), n_states)
    reports[0, 0] += 0.0
    public = (
        CategoricalEmission(rng.dirichlet(np.ones(2), n_states)) if kind == "sensor" else merging(rng, n_symbols, 2)
    )
    law, start = rng.dirichlet(np.ones(n_states), n_states), rng.dirichlet(np.ones(n_states))
    return HiddenMarkovModel(law, CategoricalEmission(reports), start, public=public)


def all_reports(world: HiddenMarkovModel) -> list[tuple[int, np.ndarray]]:
    """Each public symbol with p(report | x) of everything that may be reported with it."""
    own = world.emission.probabilities
    if isinstance(world.public, PublicPart):
        return [(int(world.public.matrix[:, y].argmax()), own[:, y]) for y in range(own.shape[1])]
    read = world.public.probabilities
    return [(z, own[:, y] * read[:, z]) for y in range(own.shape[1]) for z in range(read.shape[1])]


def random_mechanism(rng: np.random.Generator, beliefs: np.ndarray, n_actions: int = 3) -> Mechanism:
    shares = rng.dirichlet(np.ones(n_actions), len(beliefs))
    return Mechanism(beliefs, np.arange(n_actions), shares, np.zeros_like(shares))


class Enumerated:
    """Every path of states and reports, by Bayes' rule as written."""

    def __init__(
        self,
        world: HiddenMarkovModel,
        plays: Mechanism | None,
        columns: list[int],
        read: np.ndarray,
        agent: HiddenMarkovModel | None = None,
    ) -> None:
        own = all_reports(world if agent is None else agent)
        reports, n_steps = all_reports(world), len(columns)
        agent = world if agent is None else agent
        self.paths: list[tuple[tuple[int, ...], tuple[int, ...], np.ndarray, np.ndarray]] = []
        for said in product(range(len(reports)), repeat=n_steps):
            if any(z >= 0 and reports[s][0] != z for s, z in zip(said, read, strict=True)):
                continue
            beliefs, law = [], agent.initial
            for s in said:
                held = law * own[s][1]
                beliefs.append(held / held.sum())
                law = beliefs[-1] @ agent.transition
            played = np.ones(n_steps)
            if plays is not None:
                gaps = np.linalg.norm(plays.beliefs[None] - np.array(beliefs)[:, None], axis=2)
                assert gaps.min(axis=1).max() < 1e-9
                played = plays.probabilities[gaps.argmin(axis=1), columns]
            for path in product(range(world.n_states), repeat=n_steps):
                weight = np.empty(n_steps)
                for t, (x, s) in enumerate(zip(path, said, strict=True)):
                    weight[t] = world.initial[x] if t == 0 else world.transition[path[t - 1], x]
                    weight[t] *= reports[s][1][x] * played[t]
                self.paths.append((path, said, np.array(beliefs), weight))

    def law(self, step: int, last: int) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Mean belief, law of the state and mean square of the belief at a step given all up to `last`, and the chance."""
        seen = {(path[: last + 1], said[: last + 1]): (b, w) for path, said, b, w in self.paths}
        total, mean, square = 0.0, 0.0, 0.0
        state = np.zeros(self.paths[0][2].shape[1])
        for (path, _), (beliefs, weights) in seen.items():
            weight = weights[: last + 1].prod()
            total += weight
            mean = mean + weight * beliefs[step]
            square += weight * float(beliefs[step] @ beliefs[step])
            state[path[step]] += weight
        return mean / total, state / total, square / total, total


def check_against(found: object, truth: Enumerated, *, smoothed: bool) -> None:
    before, n_steps = 1.0, len(found)
    for t in range(n_steps):
        mean, state, square, _ = truth.law(t, n_steps - 1 if smoothed else t)
        assert np.abs(found.mean[t] - mean).max() < EXACT
        assert np.abs(found.states[t] - state).max() < EXACT
        assert found.spread[t] ** 2 == pytest.approx(square - mean @ mean, abs=EXACT)
        total = truth.law(t, t)[3]
        assert np.exp(found.log_likelihood[t]) == pytest.approx(total / before, rel=1e-11)
        before = total


def path_of(
    world: HiddenMarkovModel, plays: Mechanism, n_steps: int, rng: np.random.Generator
) -> tuple[list[int], np.ndarray]:
    path = world.sample(n_steps, rng=rng)
    beliefs = filter_beliefs(world, path.observations, public=path.public).beliefs
    places = np.linalg.norm(plays.beliefs[None] - beliefs[:, None], axis=2).argmin(axis=1)
    return [int(rng.choice(len(plays.actions), p=plays.probabilities[b])) for b in places], np.asarray(path.public)


@pytest.mark.parametrize("n_particles", [0, 300])
@pytest.mark.parametrize(
    ("kind", "n_states", "n_symbols", "n_steps"), [("sensor", 2, 2, 3), ("part", 2, 3, 3), ("part", 3, 3, 3)]
)
@pytest.mark.parametrize("seed", range(2))
def test_the_law_is_that_of_enumeration(
    seed: int, kind: str, n_states: int, n_symbols: int, n_steps: int, n_particles: int
) -> None:
    rng = np.random.default_rng([SEED, seed, n_states, n_symbols])
    world = random_world(rng, kind, n_states, n_symbols)
    plays = random_mechanism(rng, reachable_beliefs(world, n_steps))
    columns, read = path_of(world, plays, n_steps, rng)
    adversary = SequentialAdversary(world, plays, n_particles=n_particles, rng=rng if n_particles else None)
    partly = np.where(np.arange(n_steps) == 1, np.nan, read)
    for told in (read, partly):
        truth = Enumerated(world, plays, columns, np.nan_to_num(told, nan=-1).astype(int))
        for smoothed in (False, True):
            found = (adversary.smooth if smoothed else adversary.filter)(columns, public=told)
            check_against(found, truth, smoothed=smoothed)
            assert n_particles or found.is_exact
