"""What everybody reads: the law of an observer who follows it, against enumeration of all paths of states and reports."""

from __future__ import annotations

import os
from itertools import product

import numpy as np
import pytest

from inscrutable import (
    CategoricalEmission,
    HiddenMarkovModel,
    Mechanism,
    PublicPart,
    SequentialAdversary,
    filter_beliefs,
    path_leakage,
    reachable_beliefs,
)
from inscrutable.privacy import over_time

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


class Told:
    """Figures of `path_leakage` by every path of reports and decisions."""

    def __init__(self, world: HiddenMarkovModel, plays: Mechanism, n_steps: int, *, told: bool = True) -> None:
        reports = all_reports(world)
        paths: list[tuple[tuple[int, ...], tuple[int, ...], np.ndarray, np.ndarray, float]] = []
        for said in product(range(len(reports)), repeat=n_steps):
            law, beliefs, chance = world.initial, [], 1.0
            for s in said:
                held = law * reports[s][1]
                chance *= held.sum()
                beliefs.append(held / held.sum())
                law = beliefs[-1] @ world.transition
            held = np.array(beliefs)
            places = np.linalg.norm(plays.beliefs[None] - held[:, None], axis=2).argmin(axis=1)
            read = tuple(reports[s][0] if told else 0 for s in said)
            for columns in product(range(len(plays.actions)), repeat=n_steps):
                shares = plays.probabilities[places, columns]
                paths.append((read, columns, held, shares, chance * float(shares.prod())))
        self.added, self.error, self.prior, self.belief = (np.zeros(n_steps) for _ in range(4))
        for t in range(n_steps):
            groups: dict[str, dict[object, list[tuple[np.ndarray, float]]]] = {"all": {}, "before": {}, "read": {}}
            for read, columns, beliefs, _, weight in paths:
                for name, key in (
                    ("all", (read[: t + 1], columns[: t + 1])),
                    ("before", (read[: t + 1], columns[:t])),
                    ("read", read[: t + 1]),
                ):
                    groups[name].setdefault(key, []).append((beliefs[t], weight))
            mass = {name: {key: sum(w for _, w in rows) for key, rows in held.items()} for name, held in groups.items()}
            self.error[t], self.prior[t] = self.spread(groups["all"]), self.spread(groups["read"])
            laws = {name: {key: self.law(rows) for key, rows in held.items()} for name, held in groups.items()}
            for read, columns, beliefs, shares, weight in paths:
                now, before = (read[: t + 1], columns[: t + 1]), (read[: t + 1], columns[:t])
                self.added[t] += weight * np.log2(shares[t] * mass["before"][before] / mass["all"][now])
                here = tuple(beliefs[t].round(10))
                self.belief[t] += weight * np.log2(laws["all"][now][here] / laws["read"][read[: t + 1]][here])

    @staticmethod
    def law(rows: list[tuple[np.ndarray, float]]) -> dict[tuple[float, ...], float]:
        found: dict[tuple[float, ...], float] = {}
        for belief, weight in rows:
            key = tuple(belief.round(10))
            found[key] = found.get(key, 0.0) + weight / sum(w for _, w in rows)
        return found

    @staticmethod
    def spread(groups: dict[object, list[tuple[np.ndarray, float]]]) -> float:
        total = 0.0
        for rows in groups.values():
            points, weights = np.array([b for b, _ in rows]), np.array([w for _, w in rows])
            mean = weights @ points / weights.sum()
            total += float(weights @ ((points - mean) ** 2).sum(axis=1))
        return float(np.sqrt(total))


@pytest.mark.parametrize(("kind", "n_symbols"), [("sensor", 2), ("part", 3)])
def test_what_paths_tell_is_that_of_enumeration(monkeypatch: pytest.MonkeyPatch, kind: str, n_symbols: int) -> None:
    rng = np.random.default_rng([SEED, 21, n_symbols])
    world = random_world(rng, kind, 2, n_symbols)
    plays = random_mechanism(rng, reachable_beliefs(world, 3), 2)
    truth = Told(world, plays, 3)
    exact = path_leakage(world, plays, 3, rng=rng, n_draws=2000)
    assert exact.n_draws == 0
    for found, wanted in (
        (exact.added, truth.added),
        (exact.bayes_error, truth.error),
        (exact.prior_error, truth.prior),
        (exact.belief_information, truth.belief),
    ):
        assert np.abs(found - wanted).max() < EXACT**0.5
        assert np.abs(found**2 - wanted**2).max() < EXACT
    monkeypatch.setattr(over_time, "enumerated", lambda *_: None)
    drawn = path_leakage(world, plays, 3, rng=rng, n_draws=2000)
    assert drawn.n_draws == 2000
    assert np.abs(drawn.prior_error - truth.prior).max() < 0.03
    for found, error, wanted in (
        (drawn.added, drawn.added_se, truth.added),
        (drawn.belief_information, drawn.belief_information_se, truth.belief),
        (drawn.bayes_error, drawn.error_se, truth.error),
    ):
        assert (np.abs(found - wanted) < 6.0 * error + EXACT).all()


@pytest.mark.parametrize("seed", range(4))
def test_more_public_information_never_lowers_accuracy(seed: int) -> None:
    """A sensor that nobody else reads, the same merged, and the whole: each tells what the one before tells."""
    rng = np.random.default_rng([SEED, 33, seed])
    n_states, n_symbols = (2, 4) if seed % 2 else (3, 3)
    reports = rng.dirichlet(np.ones(n_symbols), n_states)
    law, start = rng.dirichlet(np.ones(n_states), n_states), rng.dirichlet(np.ones(n_states))
    merged = merging(rng, n_symbols, 2)
    levels = (None, PublicPart(np.ones((1, n_symbols))), merged, PublicPart(np.eye(n_symbols)))
    worlds = [HiddenMarkovModel(law, CategoricalEmission(reports), start, public=level) for level in levels]
    plays = random_mechanism(rng, reachable_beliefs(worlds[0], 3), 2)
    found = [path_leakage(world, plays, 3, rng=rng, n_draws=5000) for world in worlds]
    assert all(each.n_draws == 0 for each in found)
    errors, ceilings = (np.array([getattr(each, name) for each in found]) for name in ("bayes_error", "prior_error"))
    assert (np.diff(errors, axis=0) <= 1e-7).all()
    assert (np.diff(ceilings, axis=0) <= 1e-7).all()
    assert np.abs(errors[0] - errors[1]).max() < 1e-9  # one symbol for all says nothing
    assert errors[2].mean() < errors[1].mean() - 1e-6
    assert errors[3].max() < 1e-6
    assert found[3].is_all_public
    assert not found[2].is_all_public
    assert "nothing is left to hide" in found[3].summary()
