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
    delayed,
    filter_beliefs,
    path_leakage,
    reachable_beliefs,
    simplex_grid,
)
from inscrutable.privacy import over_time
from sizes import some

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

    def __init__(self, world: HiddenMarkovModel, plays: Mechanism, n_steps: int, lag: int = 0) -> None:
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
            read = tuple(reports[s][0] for s in said)
            for columns in product(range(len(plays.actions)), repeat=n_steps):
                shares = plays.probabilities[places, columns]
                paths.append((read, columns, held, shares, chance * float(shares.prod())))
        self.added, self.error, self.prior, self.belief = (np.zeros(n_steps) for _ in range(4))
        for t in range(n_steps):
            groups: dict[str, dict[object, list[tuple[np.ndarray, float]]]] = {"all": {}, "before": {}, "read": {}}
            seen = max(t - lag, -1)  # the latest decision that is seen by now
            for read, columns, beliefs, _, weight in paths:
                for name, key in (
                    ("all", (read[: t + 1], columns[: seen + 1])),
                    ("before", (read[: t + 1], columns[: max(seen, 0)])),
                    ("read", read[: t + 1]),
                ):
                    groups[name].setdefault(key, []).append((beliefs[t], weight))
            mass = {name: {key: sum(w for _, w in rows) for key, rows in held.items()} for name, held in groups.items()}
            self.error[t], self.prior[t] = self.spread(groups["all"]), self.spread(groups["read"])
            laws = {name: {key: self.law(rows) for key, rows in held.items()} for name, held in groups.items()}
            for read, columns, beliefs, shares, weight in paths:
                now, before = (read[: t + 1], columns[: seen + 1]), (read[: t + 1], columns[: max(seen, 0)])
                if seen >= 0:
                    self.added[t] += weight * np.log2(shares[seen] * mass["before"][before] / mass["all"][now])
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


@pytest.mark.parametrize(
    ("kind", "n_symbols", "lag"),
    some([(*each, lag) for each in (("sensor", 2), ("part", 3)) for lag in (0, 1, 2, 4)], 6),
)
def test_what_paths_tell_is_that_of_enumeration(
    monkeypatch: pytest.MonkeyPatch, kind: str, n_symbols: int, lag: int
) -> None:
    rng = np.random.default_rng([SEED, 21, n_symbols])
    world = random_world(rng, kind, 2, n_symbols)
    plays = random_mechanism(rng, reachable_beliefs(world, 3), 2)
    truth = Told(world, plays, 3, lag)
    exact = path_leakage(world, plays, 3, rng=rng, n_draws=2000, disclosure=delayed(lag))
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
    drawn = path_leakage(world, plays, 3, rng=rng, n_draws=2000, disclosure=delayed(lag))
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
    assert "nothing can be hidden" in found[3].summary()


MIXED = np.array([[0.9, 0.1], [0.2, 0.8]])


def mixing(resolution: int = 10) -> Mechanism:
    """Decisions whose chances are linear in the belief, so that nothing is lost between the points of a grid."""
    points = simplex_grid(2, resolution)
    return Mechanism(points, [0, 1], points @ MIXED, np.zeros((len(points), 2)))


def real_world(kind: str) -> HiddenMarkovModel:
    """Two states; the public number depends on the private one, or does not."""
    law, start = [[0.8, 0.2], [0.3, 0.7]], [0.6, 0.4]
    if kind == "part":
        spread = [[[1.0, 0.4], [0.4, 0.8]], [[0.5, -0.2], [-0.2, 1.5]]]
        sensor = GaussianEmission([[0.0, 0.3], [1.0, -0.5]], spread)
        return HiddenMarkovModel(law, sensor, start, public=PublicPart([[0.5, 0.5]]))
    private, public = (
        GaussianEmission([[0.0], [1.0]], [[[1.0]], [[0.5]]]),
        GaussianEmission([[0.3], [-0.5]], [[[0.8]], [[1.5]]]),
    )
    return HiddenMarkovModel(law, private, start, public=public)


def quadrature(world: HiddenMarkovModel, read: np.ndarray, columns: list[int]) -> np.ndarray:
    """E[π_1 | z_0, z_1, u_0, u_1] by sums over the private numbers of both steps."""
    line = np.linspace(-9.0, 9.0, 361)
    logs = []
    for z in read:
        if isinstance(world.public, PublicPart):
            rows = np.column_stack([line, 2.0 * z - line])
            logs.append(world.emission.log_likelihoods(rows))
        else:
            logs.append(world.emission.log_likelihoods(line) + world.public.log_likelihoods([z]))
    first, second = (np.exp(each) for each in logs)
    joint = world.initial * first  # (n, X)
    weight, belief = joint.sum(axis=1), joint / joint.sum(axis=1, keepdims=True)
    weight = weight * (belief @ MIXED)[:, columns[0]]
    later = (belief @ world.transition)[:, None] * second
    chance = later.sum(axis=2)
    held = later / chance[:, :, None]
    total = weight[:, None] * chance * (held @ MIXED)[:, :, columns[1]]
    return np.asarray((total[:, :, None] * held).sum(axis=(0, 1)) / total.sum())


@pytest.mark.parametrize("kind", some(["sensor", "part"], 2))
def test_particles_of_real_sensors_are_within_their_sampling_error(kind: str) -> None:
    rng = np.random.default_rng([SEED, 3])
    world, n_particles = real_world(kind), 3000
    adversary = SequentialAdversary(world, mixing(), n_particles=n_particles, rng=rng)
    for columns, read in (([0, 1], np.array([0.2, 1.4])), ([1, 1], np.array([-1.0, -0.3]))):
        found = np.array([adversary.filter(columns, public=read).mean[1] for _ in range(8)])
        truth = quadrature(world, read, columns)
        spread = found.std(axis=0, ddof=1)
        assert (spread < 0.02).all()
        assert (np.abs(found.mean(axis=0) - truth) < 6.0 * spread / np.sqrt(8.0) + 1e-4).all()
    # Who does not read it is less sure.
    unread = np.full(2, np.nan)
    assert adversary.filter([0, 1], public=unread).spread[1] > adversary.filter([0, 1], public=[0.2, 1.4]).spread[1]


def test_without_decisions_the_law_is_that_of_the_public_sensor_alone() -> None:
    """E[π_t | z_0..t] is the state's law given z_0..t: an ordinary filter of the public sensor."""
    rng = np.random.default_rng([SEED, 4])
    for kind in ("part", "sensor"):
        world = real_world(kind)
        path = world.sample(15, rng=rng)
        alone = HiddenMarkovModel(world.transition, world.public_emission, world.initial)
        expected = filter_beliefs(alone, path.public)
        found = SequentialAdversary(world, mixing(), n_particles=4000, rng=rng).unseen(15, public=path.public)
        assert np.abs(found.mean - expected.beliefs).max() < 0.03
        assert found.log_likelihood.sum() == pytest.approx(expected.log_likelihood, abs=0.2)


@pytest.mark.parametrize("smoothed", [False, True])
def test_symbols_beside_a_real_public_sensor_are_followed_exactly(smoothed: bool) -> None:
    rng = np.random.default_rng([SEED, 5])
    private = CategoricalEmission(rng.dirichlet(np.ones(2), 2))
    law, read = rng.dirichlet(np.ones(2), 2), np.array([0.4, 1.1, -0.2])
    public = GaussianEmission([[0.0], [1.0]], [[[1.0]], [[2.0]]])
    world = HiddenMarkovModel(law, private, [0.5, 0.5], public=public)
    adversary = SequentialAdversary(world, mixing(), n_particles=64, rng=rng)
    found = (adversary.smooth if smoothed else adversary.filter)([0, 1, 1], public=read)
    # The same with the density of each number read as the likelihood of a symbol of its own.
    density = np.exp(public.log_likelihoods(read))  # (T, X)
    for step in range(3):
        total, mean, state = 0.0, np.zeros(2), np.zeros(2)
        last = 3 if smoothed else step + 1
        for said in product(range(2), repeat=last):
            forward, beliefs = world.initial, []
            for t, y in enumerate(said):
                held = forward * private.probabilities[:, y] * density[t]
                beliefs.append(held / held.sum())
                forward = beliefs[-1] @ law
            for path in product(range(2), repeat=last):
                weight = 1.0
                for t, (x, y) in enumerate(zip(path, said, strict=True)):
                    weight *= world.initial[x] if t == 0 else law[path[t - 1], x]
                    weight *= private.probabilities[x, y] * density[t, x] * (beliefs[t] @ MIXED)[[0, 1, 1][t]]
                total, mean = total + weight, mean + weight * beliefs[step]
                state[path[step]] += weight
        assert np.abs(found.mean[step] - mean / total).max() < EXACT
        assert np.abs(found.states[step] - state / total).max() < EXACT


def test_an_agent_with_another_model_of_the_public_sensor() -> None:
    rng = np.random.default_rng([SEED, 6])
    world, agent = random_world(rng, "sensor"), random_world(rng, "sensor")
    plays = random_mechanism(rng, reachable_beliefs(agent, 3))
    columns, read = [0, 2, 1], np.array([1, 0, 1])
    truth = Enumerated(world, plays, columns, read, agent)
    for n_particles in (0, 100):
        adversary = SequentialAdversary(
            world, plays, agent_world=agent, n_particles=n_particles, rng=rng if n_particles else None
        )
        check_against(adversary.filter(columns, public=read), truth, smoothed=False)
        check_against(adversary.smooth(columns, public=read), truth, smoothed=True)


@pytest.mark.parametrize("kind", ["part", "sensor"])
def test_a_world_goes_to_disk_and_back(kind: str) -> None:
    for world in (real_world(kind), random_world(np.random.default_rng(1), kind, 2, 3)):
        again = HiddenMarkovModel.from_dict(json.loads(json.dumps(world.to_dict())))
        assert again.to_dict() == world.to_dict()
        one, other = (each.sample(20, rng=np.random.default_rng(3)) for each in (world, again))
        assert np.array_equal(one.public, other.public)
    plain = HiddenMarkovModel(world.transition, world.emission, world.initial)
    assert "public" not in plain.to_dict()
    assert plain.sample(5, rng=np.random.default_rng(3)).public is None
    assert np.array_equal(plain.sample(20, rng=np.random.default_rng(3)).observations, one.observations)


def test_a_public_part_goes_by_the_labels_of_its_assets() -> None:
    assets = ["Food", "Oil"]
    means = pd.DataFrame([[0.0, 0.3], [1.0, -0.5]], columns=assets)
    sensor = GaussianEmission(means.to_numpy(), [np.eye(2), 2.0 * np.eye(2)], asset_names=assets)
    row = pd.DataFrame([[0.25, 0.75]], ["market"], assets)
    worlds = [HiddenMarkovModel(MIXED, sensor, public=PublicPart(each)) for each in (row, row[assets[::-1]])]
    returns = pd.DataFrame([[1.0, 2.0], [3.0, 5.0]], columns=assets)
    for world in worlds:
        assert np.allclose(world.public_of(returns[assets[::-1]]), [[1.75], [4.5]])
        assert world.public_emission.asset_names == ("market",)
        assert np.allclose(world.public_emission.means, [[0.225], [-0.125]])
    with pytest.raises(InputError, match="Gas"):
        HiddenMarkovModel(MIXED, sensor, public=PublicPart(row.rename(columns={"Oil": "Gas"})))


def test_the_agent_filters_the_public_sensor_and_its_own() -> None:
    rng = np.random.default_rng([SEED, 8])
    world = random_world(rng, "sensor", 3, 3)
    path = world.sample(30, rng=rng)
    both = HiddenMarkovModel(
        world.transition,
        CategoricalEmission(
            np.einsum("xy,xz->xyz", world.emission.probabilities, world.public.probabilities).reshape(3, -1)
        ),
        world.initial,
    )
    found = filter_beliefs(world, path.observations, public=path.public)
    wanted = filter_beliefs(both, path.observations * 2 + path.public)
    assert np.abs(found.beliefs - wanted.beliefs).max() < EXACT
    assert found.log_likelihood == pytest.approx(wanted.log_likelihood, rel=1e-12)
    live = BeliefFilter(world)
    held = [live.update(y, public=z) for y, z in zip(path.observations, path.public, strict=True)]
    assert np.array_equal(held, found.beliefs)
    # Of labelled rows the public ones are put in the order of the observations.
    dates = pd.period_range("2001-01", periods=30, freq="M")
    observed, read = pd.Series(path.observations, dates), pd.Series(path.public, dates)
    shuffled = read.sample(frac=1.0, random_state=1)
    assert np.array_equal(filter_beliefs(world, observed, public=shuffled).beliefs, found.beliefs)


def test_what_does_not_fit_is_refused() -> None:
    rng = np.random.default_rng(0)
    world, part = random_world(rng, "sensor"), random_world(rng, "part", 2, 3)
    plain = HiddenMarkovModel(world.transition, world.emission)
    path, plays = world.sample(4, rng=rng), mixing()
    three = CategoricalEmission(np.ones((3, 1)))
    refused = [
        ("pass its reports as `public`", lambda: filter_beliefs(world, path.observations)),
        ("the world has none", lambda: filter_beliefs(plain, path.observations, public=path.public)),
        ("expected one per observation", lambda: filter_beliefs(world, path.observations, public=path.public[:2])),
        ("whole numbers from 0 to 1", lambda: filter_beliefs(world, path.observations, public=[0, 1, 2, 0])),
        ("that part of the agent's", lambda: filter_beliefs(part, [0, 1, 2], public=1 - part.public_of([0, 1, 2]))),
        ("is public: the world has public", lambda: world.public_of([0, 1])),
        ("something public", lambda: SequentialAdversary(world, plays).filter([0, 1])),
        ("the world has none", lambda: SequentialAdversary(plain, plays).filter([0, 1], public=[0, 1])),
        ("one per decision", lambda: SequentialAdversary(world, plays).filter([0, 1], public=[0])),
        ("same public symbols", lambda: SequentialAdversary(world, plays, agent_world=plain)),
        ("pass n_particles", lambda: SequentialAdversary(real_world("part"), plays)),
        ("an Emission, a PublicPart", lambda: HiddenMarkovModel(MIXED, world.emission, public=[[1.0, 0.0]])),
        ("the public sensor has 3 states", lambda: HiddenMarkovModel(MIXED, world.emission, public=three)),
        ("single 1", lambda: HiddenMarkovModel(MIXED, world.emission, public=PublicPart([[1.0, 1.0], [0.0, 1.0]]))),
        ("one per symbol", lambda: HiddenMarkovModel(MIXED, world.emission, public=PublicPart(np.eye(3)))),
        ("rank 1", lambda: HiddenMarkovModel(MIXED, real_world("part").emission, public=PublicPart(np.ones((2, 2))))),
        ("one per dimension", lambda: HiddenMarkovModel(MIXED, real_world("part").emission, public=PublicPart([[1.0]]))),
        ("finite", lambda: PublicPart([[np.nan, 1.0]])),
        ("is needed", lambda: path_leakage(real_world("sensor"), plays, 2, rng=rng)),
    ]  # fmt: skip
    for said, ask in refused:
        with pytest.raises(InputError, match=said):
            ask()
    still = HiddenMarkovModel(
        np.eye(2), CategoricalEmission(np.eye(2)), [0.5, 0.5], public=CategoricalEmission(np.eye(2))
    )
    with pytest.raises(ModelError, match="step 1"):
        SequentialAdversary(still, Mechanism(np.eye(2), [0, 1], np.eye(2), np.zeros((2, 2)))).unseen(2, public=[0, 1])


def test_degenerate_worlds() -> None:
    """One symbol for everybody, one state pair of copies, a state of probability zero: nothing is lost or gained."""
    rng = np.random.default_rng([SEED, 9])
    world = random_world(rng, "part", 2, 3)
    silent = HiddenMarkovModel(
        world.transition, world.emission, world.initial, public=CategoricalEmission(np.ones((2, 1)))
    )
    plain = HiddenMarkovModel(world.transition, world.emission, world.initial)
    plays = random_mechanism(rng, reachable_beliefs(plain, 3))
    columns = [0, 1, 2]
    one = SequentialAdversary(plain, plays).filter(columns)
    for other in (
        silent,
        HiddenMarkovModel(world.transition, world.emission, world.initial, public=PublicPart(np.ones((1, 3)))),
    ):
        found = SequentialAdversary(other, plays).filter(columns, public=np.zeros(3))
        assert np.abs(found.weights - one.weights).max() < EXACT
        assert np.abs(found.log_likelihood - one.log_likelihood).max() < EXACT
    sure = HiddenMarkovModel(
        np.eye(2), world.emission, [1.0, 0.0], public=CategoricalEmission([[0.5, 0.5], [0.1, 0.9]])
    )
    still = path_leakage(sure, random_mechanism(rng, reachable_beliefs(sure, 3)), 3, rng=rng)
    assert still.cumulative.max() == 0.0
    assert still.is_all_public
