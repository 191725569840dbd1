"""A sensor's parameters from decisions under known states: against all paths written out, and against the true parameters."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import product

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    CategoricalEmission,
    HiddenMarkovModel,
    InputError,
    LikelihoodStatus,
    Mechanism,
    ModelError,
    SensorFamily,
    SequentialAdversary,
    best_probe,
    calibrate_sensor,
    reachable_beliefs,
)
from inscrutable.adversaries.sensor import calibration
from inscrutable.adversaries.sensor.calibration import _curvature
from sizes import audited, instances

TRANSITION = np.array([[0.8, 0.2], [0.3, 0.7]])
WORLD = HiddenMarkovModel(TRANSITION, CategoricalEmission([[0.8, 0.2], [0.2, 0.8]]))
GRID = np.column_stack([np.linspace(0, 1, 101), np.linspace(1, 0, 101)])
ACCURACY = SensorFamily.accuracy(2)


@pytest.fixture
def few_values(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches from few starts, and profiles of few values; in `make audit` those of the library."""
    if not audited():
        monkeypatch.setattr(calibration, "_POINTS", 7)
        monkeypatch.setattr(calibration, "_STARTS", 3)


def shares(belief: np.ndarray) -> np.ndarray:
    """How often an undecided agent plays 0 and 1."""
    first = 1.0 / (1.0 + np.exp(-6.0 * (belief[..., 0] - 0.5)))
    return np.stack([first, 1.0 - first], axis=-1)


def five(belief: np.ndarray) -> np.ndarray:
    """How often an agent plays five decisions, each near a belief of its own."""
    found = np.exp(-40.0 * (belief[..., :1] - np.linspace(0, 1, 5)) ** 2)
    return found / found.sum(axis=-1, keepdims=True)


def on(beliefs: np.ndarray, rule: Callable[[np.ndarray], np.ndarray] = shares) -> Mechanism:
    played = rule(beliefs)
    return Mechanism(beliefs, np.arange(played.shape[1]), played, 0.0 * played)


def sampled(
    accuracy: float, states: np.ndarray, rng: np.random.Generator, rule: Callable[[np.ndarray], np.ndarray] = shares
) -> np.ndarray:
    """Decisions by Bayes' rule, written out."""
    sensor = np.array([[accuracy, 1 - accuracy], [1 - accuracy, accuracy]])
    predicted, played = WORLD.initial, []
    for state in states:
        symbol = int(rng.random() < sensor[state, 1])
        belief = predicted * sensor[:, symbol]
        belief = belief / belief.sum()
        played.append(int((rng.random() >= rule(belief)[:-1].cumsum()).sum()))
        predicted = TRANSITION.T @ belief
    return np.array(played)


def enumerated(sensor: np.ndarray, actions: np.ndarray, states: np.ndarray) -> float:
    """log Pr(decisions | states) as a sum over all sequences of symbols."""
    total = 0.0
    for symbols in product(range(sensor.shape[1]), repeat=len(states)):
        predicted, chance = WORLD.initial, 1.0
        for action, state, symbol in zip(actions, states, symbols, strict=True):
            belief = predicted * sensor[:, symbol]
            belief = belief / belief.sum()
            chance *= sensor[state, symbol] * shares(belief)[action]
            predicted = TRANSITION.T @ belief
        total += chance
    return float(np.log(total))


@pytest.mark.parametrize("n_symbols", [2, 3])
def test_the_likelihood_is_the_sum_over_all_paths(n_symbols: int, fresh_rng: np.random.Generator) -> None:
    states, actions = fresh_rng.integers(2, size=5), fresh_rng.integers(2, size=5)
    other = fresh_rng.dirichlet(np.ones(n_symbols))

    def sensor(share: float) -> CategoricalEmission:
        return CategoricalEmission(np.array([share * np.eye(n_symbols)[0] + (1 - share) * other, other]))

    found = calibrate_sensor(actions, states, lambda world: on(reachable_beliefs(world, 5)), sensor, world=WORLD)
    for value, told in zip(found.grid[0], found.log_likelihoods[0], strict=True):
        assert told == pytest.approx(enumerated(sensor(value).probabilities, actions, states), abs=1e-12, rel=1e-12)
    assert found.log_likelihood == found.log_likelihoods.max()


@pytest.mark.parametrize("rare", [0.1, 1e-6, 1e-9])
def test_beliefs_that_are_nearly_certain_are_told_apart(rare: float) -> None:
    """Against Bayes' rule in fractions along all sequences of symbols."""
    sensor = np.array([[1.0 - 3.0 * rare, rare, 2.0 * rare], [0.125, 0.625, 0.25]])
    sensor /= sensor.sum(axis=1, keepdims=True)
    world = HiddenMarkovModel(TRANSITION, CategoricalEmission(sensor), [0.5, 0.5])
    found = np.log(reachable_beliefs(world, 4))
    exact, moves = np.vectorize(Fraction)(world.emission.probabilities), np.vectorize(Fraction)(world.transition)  # type: ignore[attr-defined]
    for symbols in product(range(3), repeat=4):
        predicted = np.array([Fraction(1, 2)] * 2)
        for symbol in symbols:
            belief = predicted * exact[:, symbol] / (predicted @ exact[:, symbol])
            predicted = belief @ moves
        assert np.abs(found - np.log(belief.astype(float))).max(axis=1).min() <= 1e-10


def test_it_is_the_likelihood_of_the_inverse_filter() -> None:
    rng = np.random.default_rng(0)
    states = rng.integers(2, size=60)
    actions = sampled(0.8, states, rng)
    found = calibrate_sensor(actions, states, on(GRID), ACCURACY, world=WORLD)
    path = np.log(WORLD.initial[states[0]]) + np.log(TRANSITION[states[:-1], states[1:]]).sum()
    for k in (0, 8, 17):
        known = HiddenMarkovModel(TRANSITION, ACCURACY(found.grid[0, k]), WORLD.initial)
        logs = SequentialAdversary(known, on(GRID)).filter(actions, states=states).log_likelihood
        assert found.log_likelihoods[0, k] == pytest.approx(logs.sum() - path, abs=1e-9)


def coverage(seeds: range, n_steps: int) -> tuple[float, float]:
    """How often the interval holds the true accuracy, and the width of intervals over the spread of estimates."""
    states = np.random.default_rng(99).integers(2, size=n_steps)
    held, estimates, widths = [], [], []
    for seed in seeds:
        actions = sampled(0.8, states, np.random.default_rng(seed))
        found = calibrate_sensor(actions, states, on(GRID), ACCURACY, world=WORLD)
        low, high = found.intervals[0]
        held.append(low <= 0.8 <= high)
        estimates.append(found.parameters[0])
        widths.append(high - low)
    return float(np.mean(held)), float(np.mean(widths) / (2 * 1.96 * np.std(estimates)))


def test_the_curvature_of_several_parameters_is_that_of_a_paraboloid(fresh_rng: np.random.Generator) -> None:
    """Intervals come from its inverse, so products of different parameters count."""
    bounds = np.tile([0.0, 1.0], (3, 1))
    for best in (np.full(3, 0.5), np.array([0.5, 0.001, 0.4])):
        root = 30.0 * fresh_rng.normal(size=(3, 3))
        wanted = root @ root.T + 100.0 * np.eye(3)
        found = _curvature(lambda at, a=wanted, b=best: -0.5 * float((at - b) @ a @ (at - b)), best, 0.0, bounds)
        np.testing.assert_allclose(found, wanted, atol=1e-6 * np.abs(wanted).max())


@pytest.mark.usefixtures("few_values")
def test_intervals_are_as_wide_as_estimates_scatter() -> None:
    held, ratio = coverage(range(instances(16, least=9)), 100 if audited() else 60)
    assert held >= 0.8
    assert 0.6 <= ratio <= 1.6


@pytest.mark.audit
def test_intervals_hold_the_true_accuracy_as_often_as_they_say() -> None:
    held, _ = coverage(range(200), 300)
    assert 0.90 <= held <= 0.98


@pytest.mark.parametrize("actions", [[1, 1, 0, 0, 0, 0, 1], [0, 0, 1, 1, 0, 1, 1]])
def test_intervals_of_a_likelihood_that_jumps_hold_all_plausible_values(actions: list[int]) -> None:
    """Who plays the likelier state changes its decisions with the sensor: the curvature gave intervals of width 0 to .01."""

    def likelier(world: HiddenMarkovModel) -> Mechanism:
        return on(reachable_beliefs(world, 7), lambda beliefs: np.eye(2)[(beliefs[:, 0] < 0.5).astype(int)])

    states = [1, 1, 1, 0, 0, 0, 0] if actions[0] else [0, 0, 0, 0, 0, 1, 1]
    found = calibrate_sensor(actions, states, likelier, ACCURACY, world=WORLD)
    plausible = found.grid[0][found.log_likelihoods[0] >= found.log_likelihood - 1.92]
    low, high = found.intervals[0]
    assert low <= plausible.min() < plausible.max() <= high
    assert high - low < 0.4
    assert found.status is LikelihoodStatus.SEVERAL
    assert np.isnan(found.information).all()


@pytest.mark.usefixtures("few_values")
def test_two_parameters_have_a_profile_each() -> None:
    rng = np.random.default_rng(3)
    states = rng.integers(2, size=60 if audited() else 40)
    found = calibrate_sensor(
        sampled(0.85, states, rng),
        states,
        on(GRID[::4]),
        lambda a, b: CategoricalEmission([[a, 1 - a], [1 - b, b]]),
        world=WORLD,
    )
    assert found.names == ("a", "b")
    assert found.parameters.shape == (2,)
    assert (found.intervals[:, 0] < found.parameters).all()
    assert found.log_likelihoods.max(axis=1) == pytest.approx(found.log_likelihood, abs=1e-6)
    assert "95 % from" in str(found)


def rows(a: float, b: float) -> CategoricalEmission:
    """A sensor of two symbols; its likelihood stays the same where they change places: a, b to 1 - a, 1 - b."""
    return CategoricalEmission([[a, 1 - a], [b, 1 - b]])


def agreement(a: float, b: float) -> float:
    """How often an agent that plays its belief names the state, where states are coins."""
    return a**2 / (a + b) + (1 - a) ** 2 / (2 - a - b)


@pytest.mark.usefixtures("few_values")
def test_two_parameters_of_a_coin_are_as_likely_as_any_by_the_closed_form() -> None:
    """At equal rows the likelihood has no slope, so that a search from there said that decisions tell nothing."""
    coin = HiddenMarkovModel([[0.5, 0.5], [0.5, 0.5]], WORLD.emission)
    open_book = Mechanism(GRID[::25], np.arange(2), GRID[::25], 0.0 * GRID[::25])
    rounds = 10 if audited() else 2
    states = np.tile([0, 1], 2 * rounds)
    actions = np.where(np.arange(4 * rounds) % 4 < 3, states, 1 - states)  # three of four are the state
    found = calibrate_sensor(actions, states, open_book, SensorFamily.confusion(2, 2), world=coin)
    share = agreement(*found.parameters)
    assert found.log_likelihood == pytest.approx(rounds * (3 * np.log(share) + np.log(1 - share)), abs=1e-9)
    assert share == pytest.approx(0.75, abs=1e-3)
    assert found.status is LikelihoodStatus.WEAK  # a curve of sensors has this share


@pytest.mark.usefixtures("few_values")
def test_two_parameters_are_as_likely_as_any_by_the_sum_over_all_paths(fresh_rng: np.random.Generator) -> None:
    values, length = np.linspace(0.01, 0.99, 15 if audited() else 7), 5 if audited() else 3
    for _ in range(instances(6, least=1)):
        states, actions = fresh_rng.integers(2, size=(2, length))
        found = calibrate_sensor(actions, states, lambda world: on(reachable_beliefs(world, length)), rows, world=WORLD)
        reached = enumerated(rows(*found.parameters).probabilities, actions, states)
        assert found.log_likelihood == pytest.approx(reached, abs=1e-9)
        best = max(enumerated(rows(a, b).probabilities, actions, states) for a, b in product(values, values))
        assert reached >= best - 1e-9


def test_a_sensor_as_accurate_as_wrong_is_one_of_two() -> None:
    """An accuracy of p and one of 1 − p report the same of states, by other names."""
    rng = np.random.default_rng(0)
    states = rng.integers(2, size=60)
    actions = sampled(0.75, states, rng, five)
    both = SensorFamily(lambda p: rows(p, 1.0 - p), [[0.01, 0.99]], ["p"])
    twice = calibrate_sensor(actions, states, on(GRID[::10], five), both, world=WORLD)
    assert twice.status is LikelihoodStatus.SEVERAL
    once = calibrate_sensor(actions, states, on(GRID[::10], five), ACCURACY, world=WORLD)
    assert twice.log_likelihood == pytest.approx(once.log_likelihood, abs=1e-6)
    assert max(twice.parameters[0], 1.0 - twice.parameters[0]) == pytest.approx(once.parameters[0], abs=1e-3)


@pytest.mark.audit
def test_sensors_that_name_the_symbols_in_another_order_are_several() -> None:
    rng = np.random.default_rng(0)
    states = rng.integers(2, size=60)
    actions = sampled(0.75, states, rng, five)
    twice = calibrate_sensor(actions, states, on(GRID[::10], five), rows, world=WORLD)
    assert twice.status is LikelihoodStatus.SEVERAL
    ordered = SensorFamily(rows, [[0.5, 0.999], [0.001, 0.5]], ["a", "b"])
    once = calibrate_sensor(actions, states, on(GRID[::10], five), ordered, world=WORLD)
    assert once.status is LikelihoodStatus.IDENTIFIED
    assert twice.log_likelihood == pytest.approx(once.log_likelihood, abs=1e-5)


@pytest.mark.usefixtures("few_values")
def test_what_decisions_do_not_tell_is_said() -> None:
    states = np.array([0, 1] * 10)
    silent = Mechanism(GRID, np.arange(2), np.full((101, 2), 0.5), np.zeros((101, 2)))
    flat = calibrate_sensor([0] * 20, states, silent, ACCURACY, world=WORLD)
    assert flat.status is LikelihoodStatus.FLAT
    np.testing.assert_array_equal(flat.intervals, ACCURACY.bounds)
    weak = calibrate_sensor([0, 1], [0, 1], on(GRID), ACCURACY, world=WORLD)
    assert weak.status is LikelihoodStatus.WEAK
    never = Mechanism(GRID, np.arange(2), np.tile([1.0, 0.0], (101, 1)), np.zeros((101, 2)))
    none = calibrate_sensor([1] * 20, states, never, ACCURACY, world=WORLD)
    assert none.status is LikelihoodStatus.IMPOSSIBLE
    assert np.isfinite(none.parameters).all()


def test_malformed_input_is_named() -> None:
    seen = HiddenMarkovModel(TRANSITION, WORLD.emission, public=WORLD.emission)
    for call, kind, said in [
        (lambda: calibrate_sensor([0, 1], [0, 2], on(GRID), ACCURACY, world=WORLD), InputError, "states"),
        (lambda: calibrate_sensor([0, 1], [0], on(GRID), ACCURACY, world=WORLD), InputError, "states"),
        (lambda: calibrate_sensor([0], [0], on(GRID), 3, world=WORLD), InputError, "family"),
        (lambda: calibrate_sensor([0], [0], on(GRID), lambda: None, world=WORLD), InputError, "without arguments"),
        (lambda: calibrate_sensor([0], [0], on(GRID), lambda p: p, world=WORLD), InputError, "Emission"),
        (lambda: calibrate_sensor([0], [0], "ODM", ACCURACY, world=WORLD), InputError, "mechanism"),
        (lambda: calibrate_sensor([0], [0], on(GRID), ACCURACY, world=None), InputError, "world"),
        (lambda: calibrate_sensor([0], [0], on(GRID), ACCURACY, world=seen), InputError, "without a public sensor"),
        (lambda: SensorFamily(lambda p: p, [[1.0, 0.0]], ["p"]), InputError, "bounds"),
        (lambda: best_probe([], on(GRID), ACCURACY, world=WORLD, parameters=[0.8]), InputError, "probes"),
        (lambda: best_probe([[0]], on(GRID), ACCURACY, world=WORLD, parameters=[0.2]), InputError, "parameters"),
    ]:
        with pytest.raises(kind, match=said):
            call()
    still = HiddenMarkovModel(np.eye(2), WORLD.emission, [0.5, 0.5])
    with pytest.raises(ModelError, match="state 1 at step 1"):
        calibrate_sensor([0, 1], [0, 1], on(GRID), ACCURACY, world=still)


def test_states_are_aligned_with_decisions_by_date() -> None:
    days = pd.date_range("2020-01-01", periods=60)
    actions = pd.Series(np.random.default_rng(0).integers(0, 2, 60), days)
    states = pd.Series([0, 0, 0, 1, 1, 1] * 10, days)
    grid = np.column_stack([np.linspace(0, 1, 11), np.linspace(1, 0, 11)])
    plays = Mechanism(grid, np.arange(2), grid, 0.0 * grid)
    found = calibrate_sensor(actions, states, plays, ACCURACY, world=WORLD).parameters
    for told in (states.iloc[::-1], states.to_numpy(), states.reset_index(drop=True)):
        assert calibrate_sensor(actions, told, plays, ACCURACY, world=WORLD).parameters == found
    assert calibrate_sensor(actions.to_numpy(), states, plays, ACCURACY, world=WORLD).parameters == found
    with pytest.raises(InputError, match="other step labels"):
        calibrate_sensor(actions, states.shift(1, freq="D"), plays, ACCURACY, world=WORLD)


def test_a_family_with_the_states_in_another_order_is_refused() -> None:
    names, other = ["calm", "crisis"], ["crisis", "calm"]
    grid = np.column_stack([np.linspace(0, 1, 11), np.linspace(1, 0, 11)])
    plays = Mechanism(grid, np.arange(2), grid, 0.0 * grid)

    def family(order: list[str]) -> SensorFamily:
        def make(p: float) -> CategoricalEmission:
            return CategoricalEmission(pd.DataFrame([[p, 1.0 - p], [0.4, 0.6]], names).loc[order])

        return SensorFamily(make, [[0.05, 0.95]], ["p"])

    moves = [[0.8, 0.2], [0.3, 0.7]]
    world, bare = (HiddenMarkovModel(moves, SensorFamily.accuracy(2)(0.7), names=each) for each in (names, None))
    actions, states = [0, 1, 0, 0, 1], [0, 1, 1, 0, 1]
    found = [calibrate_sensor(actions, states, plays, family(names), world=each).parameters for each in (world, bare)]
    assert found[0] == found[1]
    best_probe([[0, 1]], plays, family(names), world=world, parameters=[0.8])
    with pytest.raises(InputError, match="expected the same order"):
        calibrate_sensor(actions, states, plays, family(other), world=world)
    with pytest.raises(InputError, match="expected the same order"):
        best_probe([[0, 1]], plays, family(other), world=world, parameters=[0.8])


@pytest.mark.parametrize(
    ("world", "said"),
    [
        (
            HiddenMarkovModel(WORLD.transition, WORLD.emission, [1.0, 0.0]),
            r"probes\[1\] cannot occur .* state 1 at step 0",
        ),
        (HiddenMarkovModel(np.eye(2), WORLD.emission, [0.5, 0.5]), r"probes\[1\] cannot occur .* state 0 at step 2"),
    ],
)
def test_a_probe_that_cannot_occur_is_named(world: HiddenMarkovModel, said: str) -> None:
    with pytest.raises(ModelError, match=said):
        best_probe([[0, 0], [1, 1, 0]], on(GRID), ACCURACY, world=world, parameters=[0.8])


def test_fisher_information_of_probes_is_that_of_all_sequences_of_decisions() -> None:
    probes = [[0, 0, 0, 0], [0, 1, 0, 1], [0, 1]]
    found = best_probe(probes, lambda world: on(reachable_beliefs(world, 4)), ACCURACY, world=WORLD, parameters=[0.75])
    assert found.is_exact
    for number, probe in enumerate(probes):
        total = 0.0
        for actions in product(range(2), repeat=len(probe)):
            low, middle, high = (
                enumerated(ACCURACY(p).probabilities, np.array(actions), np.array(probe))
                for p in (0.7499, 0.75, 0.7501)
            )
            total += np.exp(middle) * ((high - low) / 2e-4) ** 2
        assert found.information[number, 0, 0] == pytest.approx(total, rel=1e-4)
    assert found.best == int(found.bounds[:, 0].argmin())


def test_fisher_information_matches_decisions_by_what_they_are() -> None:
    """A mechanism made for every world may list the same decisions in another order, and others that are never played."""

    def listed(world: HiddenMarkovModel) -> Mechanism:
        plain = on(reachable_beliefs(world, 3))
        count, order = len(plain.beliefs), [2, 1, 0] if world.emission.probabilities[0, 0] > 0.75 else [0, 1, 2]
        wide = np.column_stack([plain.probabilities, np.zeros(count)])[:, order]
        return Mechanism(plain.beliefs, np.arange(3)[order], wide, np.zeros((count, 3)))

    probe = np.array([0, 1, 0])
    found = best_probe([probe], listed, ACCURACY, world=WORLD, parameters=[0.75])
    total = 0.0
    for actions in product(range(2), repeat=len(probe)):
        low, middle, high = (
            enumerated(ACCURACY(p).probabilities, np.array(actions), probe) for p in (0.7499, 0.75, 0.7501)
        )
        total += np.exp(middle) * ((high - low) / 2e-4) ** 2
    assert found.information[0, 0, 0] == pytest.approx(total, rel=1e-4)


def test_decisions_that_move_with_the_sensor_have_no_fisher_information() -> None:
    def moving(world: HiddenMarkovModel) -> Mechanism:
        beliefs = reachable_beliefs(world, 2)
        return Mechanism(beliefs, beliefs, np.eye(len(beliefs)), np.zeros((len(beliefs), len(beliefs))))

    with pytest.raises(InputError, match="change with the parameters"):
        best_probe([[0, 1]], moving, ACCURACY, world=WORLD, parameters=[0.75])


@pytest.mark.usefixtures("few_values")
def test_the_best_probe_gives_the_estimates_that_scatter_least() -> None:
    rng = np.random.default_rng(1)
    probes = [np.zeros(80, dtype=int), np.tile([0, 1], 40)]
    ranking = best_probe(
        probes, on(GRID[::2]), ACCURACY, world=WORLD, parameters=[0.8], n_draws=instances(400), rng=rng
    )
    assert not ranking.is_exact
    assert "best" in str(ranking)
    spread = [
        np.std(
            [
                calibrate_sensor(sampled(0.8, probe, rng), probe, on(GRID[::2]), ACCURACY, world=WORLD).parameters[0]
                for _ in range(instances(8, least=4))
            ]
        )
        for probe in probes
    ]
    assert ranking.best == int(np.argmin(spread))


@pytest.mark.usefixtures("few_values")
def test_a_gaussian_sensor_is_read_by_particles() -> None:
    rng = np.random.default_rng(2)
    family = SensorFamily.gaussian_spread([[0.0], [1.0]], [[0.2, 2.0]])
    np.testing.assert_allclose(family(0.6).covariances, np.full((2, 1, 1), 0.36))
    world = HiddenMarkovModel(TRANSITION, family(0.6))
    states, actions = rng.integers(2, size=(2, 15 if audited() else 8))
    found, again = (
        calibrate_sensor(
            actions,
            states,
            on(GRID),
            family,
            world=world,
            n_particles=60 if audited() else 20,
            rng=np.random.default_rng(0),
        )
        for _ in range(2)
    )
    assert np.isfinite(found.log_likelihoods).all()
    np.testing.assert_array_equal(found.log_likelihoods, again.log_likelihoods)
