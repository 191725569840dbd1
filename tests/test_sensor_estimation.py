"""The sensor, or the whole world, behind the beliefs of a filter: against the worlds that made them."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    CategoricalEmission,
    EstimatedSensor,
    EstimatedWorld,
    HiddenMarkovModel,
    InputError,
    MarkowitzProblem,
    ModelError,
    OriginalDecisionMaker,
    SensorStatus,
    consistent_beliefs,
    estimate_sensor,
    estimate_world,
    filter_beliefs,
)
from sizes import audited, instances, some

TRANSITION = np.array([[0.8, 0.1, 0.1], [0.15, 0.7, 0.15], [0.1, 0.2, 0.7]])
SENSOR = np.array([[0.7, 0.2, 0.1], [0.15, 0.7, 0.15], [0.1, 0.25, 0.65]])
UNDER_NOISE = {
    2: (np.array([[0.7, 0.3], [0.2, 0.8]]), np.array([[0.8, 0.2], [0.3, 0.7]])),
    3: (TRANSITION, SENSOR),
    4: (0.6 * np.eye(4) + 0.1, 0.6 * np.eye(4) + 0.1),
}
LIMITS = {1e-9: 3e-4, 1e-6: 2.5e-2, 1e-4: 2.5e-2, 1e-2: 1.0}
"""Frobenius errors that were published for another pair of matrices, by standard deviation of the noise."""


def path(
    transition: np.ndarray, sensor: np.ndarray, n_steps: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Beliefs and symbols by Bayes' rule, written out; no code of the package."""
    n_states, n_symbols = sensor.shape
    state, belief = 0, np.full(n_states, 1.0 / n_states)
    moves, reports = np.cumsum(transition, axis=1), np.cumsum(sensor, axis=1)
    beliefs, symbols = [], []
    for one, other in rng.random((n_steps, 2)):
        state = min(int(np.searchsorted(moves[state], one)), n_states - 1)
        symbol = min(int(np.searchsorted(reports[state], other)), n_symbols - 1)
        belief = sensor[:, symbol] * (transition.T @ belief)
        belief = belief / belief.sum()
        beliefs.append(belief)
        symbols.append(symbol)
    return np.array(beliefs), np.array(symbols)


def error(found: np.ndarray, true: np.ndarray) -> float:
    """Frobenius distance under the best names of the symbols."""
    return min(float(np.linalg.norm(found[:, list(order)] - true)) for order in permutations(range(true.shape[1])))


def blurred(beliefs: np.ndarray, spread: float, rng: np.random.Generator) -> np.ndarray:
    noisy = np.abs(beliefs + spread * rng.normal(size=beliefs.shape))
    return noisy / noisy.sum(axis=1, keepdims=True)


def random_world(rng: np.random.Generator, n_states: int, n_symbols: int) -> tuple[np.ndarray, np.ndarray]:
    return rng.dirichlet(np.ones(n_states), n_states), rng.dirichlet(np.ones(n_symbols), n_states)


def test_sensors_of_random_models_follow_from_exact_beliefs(fresh_rng: np.random.Generator) -> None:
    for model in range(instances(200)):
        n_states = 2 + model % 3
        transition, sensor = random_world(fresh_rng, n_states, n_states)
        beliefs, symbols = path(transition, sensor, 120, fresh_rng)
        if len(np.unique(symbols[1:])) < n_states:
            continue
        found = estimate_sensor(beliefs, transition, n_symbols=n_states if model % 2 else None)
        assert found.status in (SensorStatus.IDENTIFIED, SensorStatus.SCALES_BY_FREQUENCY)
        if found.is_identified:
            assert error(found.probabilities, sensor) <= 1e-8
            assert found.residual <= 1e-12
            named = dict(zip(symbols[1:].tolist(), found.symbols.tolist(), strict=True))
            assert [named[each] for each in symbols[1:].tolist()] == found.symbols.tolist()


def test_beliefs_in_single_precision_are_read() -> None:
    transition, sensor = np.array([[0.9, 0.1], [0.3, 0.7]]), np.array([[0.8, 0.2], [0.3, 0.7]])
    exact, _ = path(transition, sensor, 120, np.random.default_rng(20261130))
    for beliefs in (exact.astype(np.float32), pd.DataFrame(exact.astype(np.float32))):
        found = estimate_sensor(beliefs, transition, n_symbols=2)
        assert found.is_identified
        assert error(found.probabilities, sensor) <= 1e-4


def test_the_noise_is_told_from_one_step_more_than_symbols() -> None:
    """The mean square of the estimates is the variance: every column but the factor is fitted, one step is spare."""
    rng = np.random.default_rng(20261127)
    transition, sensor = UNDER_NOISE[3]
    found = []
    for _ in range(150 if audited() else 75):
        beliefs = [rng.dirichlet(np.full(3, 5.0))]
        for symbol in (0, 1, 2, 0):
            moved = (beliefs[-1] @ transition) * sensor[:, symbol]
            beliefs.append(moved / moved.sum())
        errors = rng.normal(size=(5, 3))
        noisy = np.array(beliefs) + 1e-5 * (errors - errors.mean(axis=1, keepdims=True))
        found.append(estimate_sensor(noisy, transition, n_symbols=3).noise)
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(1e-5, rel=0.2)


@pytest.mark.parametrize("spread", LIMITS)
@pytest.mark.parametrize("n_states", UNDER_NOISE)
def test_noise_leaves_less_error_than_three_times_what_was_published(n_states: int, spread: float) -> None:
    transition, sensor = UNDER_NOISE[n_states]
    rng = np.random.default_rng([n_states, 5])
    beliefs, _ = path(transition, sensor, 400, rng)
    noisy = blurred(beliefs, spread, rng)
    found = estimate_sensor(noisy, transition, n_symbols=n_states)
    reached = error(found.probabilities, sensor)
    assert reached <= 3.0 * LIMITS[spread]
    assert reached <= 5.0 * spread, "twenty times below what was published, too"
    assert found.noise == pytest.approx(spread, rel=0.5)
    assert len(np.unique(found.symbols)) == n_states


@pytest.mark.parametrize("with_names", [True, False])
def test_transitions_of_random_models_follow_from_beliefs_alone(
    with_names: bool, fresh_rng: np.random.Generator
) -> None:
    for model in range(instances(45)):
        n_states = 2 + model % 3
        n_symbols = int(fresh_rng.integers(2, n_states + 3))
        transition = 0.2 * np.eye(n_states) + 0.8 * fresh_rng.dirichlet(np.ones(n_states), n_states)
        sensor = fresh_rng.dirichlet(np.ones(n_symbols), n_states)
        beliefs, symbols = path(transition, sensor, 250, fresh_rng)
        if len(np.unique(symbols[1:])) < n_symbols or np.linalg.cond(transition) > 100.0:
            continue
        found = estimate_world(beliefs, n_symbols=n_symbols, symbols=symbols if with_names else None)
        assert np.abs(found.world.transition - transition).max() <= (1e-8 if with_names else 1e-6)
        read = found.world.emission.probabilities  # type: ignore[attr-defined]
        if n_symbols > n_states:
            assert found.status is SensorStatus.SCALES_BY_FREQUENCY
            assert (np.diff(found.sensor_intervals, axis=2) > 0).any()
        elif found.is_identified and with_names:
            assert np.abs(read - sensor).max() <= 1e-6
            np.testing.assert_array_equal(found.symbols, symbols[1:])
        elif found.is_identified:
            assert error(read, sensor) <= 1e-5


@pytest.mark.parametrize(("seed", "n_states"), [(2, 3), (12, 3), (15, 4), (19, 4), (20, 4)])
def test_a_single_symbol_is_known(seed: int, n_states: int) -> None:
    """Without symbols these exact beliefs were called inconsistent."""
    transition = np.random.default_rng(seed).dirichlet(np.full(n_states, 2.0), n_states)
    beliefs = [np.random.default_rng(seed).dirichlet(np.ones(n_states))]
    for _ in range(20):
        beliefs.append(beliefs[-1] @ transition)
    found = estimate_world(beliefs, n_symbols=1)
    assert found.is_identified
    assert np.abs(found.world.transition - transition).max() <= 1e-6


@pytest.mark.parametrize("seed", [5, 24, 36, 39])
def test_noisy_beliefs_with_known_symbols_are_explained_by_the_world_behind_them(seed: int) -> None:
    """Worlds whose transition by equations has zeros, which stay zeros; they were called inconsistent."""
    rng = np.random.default_rng(seed)
    transition, sensor = random_world(rng, 3, 3)
    beliefs, symbols = path(transition, sensor, 300 if seed % 2 else 100, rng)
    found = estimate_world(blurred(beliefs, 1e-3, rng), n_symbols=3, symbols=symbols)
    assert found.is_identified
    assert np.abs(found.world.transition - transition).max() <= 0.15
    low, high = found.transition_intervals[..., 0], found.transition_intervals[..., 1]
    assert ((low <= transition) & (transition <= high)).mean() >= 0.8


def test_a_world_is_read_through_noise_with_intervals_by_bootstrap() -> None:
    rng = np.random.default_rng(4)
    beliefs, _ = path(TRANSITION, SENSOR, 300, rng)
    found = estimate_world(blurred(beliefs, 1e-3, rng), n_symbols=3, n_bootstrap=10, rng=rng)
    assert np.abs(found.world.transition - TRANSITION).max() <= 0.01
    low, high = found.transition_intervals[..., 0], found.transition_intervals[..., 1]
    assert (high - low).max() == pytest.approx(0.01, rel=0.9)
    assert ((low - 0.01 <= TRANSITION) & (high + 0.01 >= TRANSITION)).all()


def test_an_estimated_world_comes_back_from_its_file(tmp_path: Path) -> None:
    beliefs, _ = path(TRANSITION, SENSOR, 60, np.random.default_rng(4))
    found = estimate_world(beliefs, n_symbols=3)
    found.save(tmp_path / "world.npz")
    loaded = EstimatedWorld.load(tmp_path / "world.npz")
    assert loaded.is_loaded
    assert str(loaded) == str(found)
    assert loaded.world.to_dict() == found.world.to_dict()
    np.testing.assert_array_equal(loaded.sensor_intervals, found.sensor_intervals)


def test_intervals_cover_the_entries_where_frequencies_give_the_scales() -> None:
    rng = np.random.default_rng(8)
    held = []
    for _ in range(40 if audited() else 25):
        transition, sensor = rng.dirichlet(np.full(2, 3.0), 2), rng.dirichlet(np.full(4, 3.0), 2)
        beliefs, symbols = path(transition, sensor, 300, rng)
        found = estimate_sensor(beliefs, transition, n_symbols=4)
        assert found.status is SensorStatus.SCALES_BY_FREQUENCY
        order = [int(symbols[1:][found.symbols == y][0]) for y in range(4)]
        low, high = found.intervals[..., 0], found.intervals[..., 1]
        held.append((low <= sensor[:, order]) & (sensor[:, order] <= high))
    assert 0.88 <= np.mean(held) <= 1.0
    assert not np.all(held)


def test_bootstrap_intervals_are_as_wide_as_the_errors() -> None:
    errors, widths = [], []
    for seed in range(instances(6, least=4)):
        rng = np.random.default_rng(seed)
        beliefs, _ = path(TRANSITION, SENSOR, 300, rng)
        found = estimate_sensor(
            blurred(beliefs, 1e-3, rng), TRANSITION, n_symbols=3, n_bootstrap=20, rng=np.random.default_rng(1)
        )
        order = min(permutations(range(3)), key=lambda o: np.linalg.norm(found.probabilities[:, list(o)] - SENSOR))
        errors.append(found.probabilities[:, list(order)] - SENSOR)
        widths.append(np.diff(found.intervals, axis=2)[..., 0])
    assert 0.5 <= np.mean(widths) / (2 * 1.96 * np.std(errors)) <= 2.0


def test_a_belief_that_jumps_is_named_and_moves_nothing() -> None:
    beliefs, _ = path(TRANSITION, SENSOR, 200, np.random.default_rng(0))
    beliefs[100] = [0.98, 0.01, 0.01]
    found = estimate_sensor(beliefs, TRANSITION, n_symbols=3)
    assert found.status is SensorStatus.INCONSISTENT
    assert np.flatnonzero(found.symbols < 0).tolist() == [99, 100]
    assert found.residual > 0.1
    assert error(found.probabilities, SENSOR) <= 1e-8
    assert estimate_world(beliefs, n_symbols=3).status is SensorStatus.INCONSISTENT
    counted = estimate_sensor(beliefs, TRANSITION)
    assert counted.status is SensorStatus.INCONSISTENT
    assert counted.probabilities.shape == (3, 3)


def test_a_symbol_seen_once_is_told_from_an_error_by_the_number_of_symbols() -> None:
    transition, sensor = np.array([[0.8, 0.2], [0.3, 0.7]]), np.array([[0.5, 0.4, 0.1], [0.2, 0.6, 0.2]])
    world = HiddenMarkovModel(transition, CategoricalEmission(sensor))
    beliefs = filter_beliefs(world, [0, 1, 1, 0, 1, 2, 0, 0, 1, 1, 0, 1]).beliefs
    found = estimate_sensor(beliefs, transition)
    assert np.flatnonzero(found.symbols < 0).tolist() == [4]
    assert "a symbol seen only once may be taken for an error" in found.status.value
    told = estimate_sensor(beliefs, transition, n_symbols=3)
    assert told.status is SensorStatus.SCALES_BY_FREQUENCY
    assert told.residual < 1e-9


def test_beliefs_that_follow_no_filter_identify_nothing() -> None:
    beliefs = np.random.default_rng(0).dirichlet(np.ones(3), 100 if audited() else 40)
    for n_symbols in (None, 2, 3):
        found = estimate_sensor(beliefs, TRANSITION, n_symbols=n_symbols)
        assert found.status in (SensorStatus.OVERLAPPING, SensorStatus.INCONSISTENT)
    assert estimate_world(beliefs, n_symbols=3).status in (SensorStatus.OVERLAPPING, SensorStatus.INCONSISTENT)


def arbitrary(found: np.ndarray, true: np.ndarray) -> int:
    """Number of steps with another symbol than most steps of their group."""
    groups = [true[found == y] for y in np.unique(found[found >= 0])]
    return sum(len(group) - int(np.bincount(group).max()) for group in groups)


@pytest.mark.parametrize("transition", [np.eye(2), np.array([[0.95, 0.05], [0.0, 1.0]])], ids=["fixed", "absorbing"])
@pytest.mark.parametrize("sensor", [[[0.7, 0.3], [0.4, 0.6]], [[0.6, 0.3, 0.1], [0.2, 0.3, 0.5]]], ids=["two", "three"])
def test_steps_near_a_sure_state_have_no_symbol(transition: np.ndarray, sensor: list[list[float]]) -> None:
    """All symbols explain them within rounding; they had arbitrary ones, whose frequencies gave a wrong sensor for certain."""
    table, held = np.array(sensor), []
    for seed in range(20):
        world = HiddenMarkovModel(transition, CategoricalEmission(table), [0.5, 0.5])
        symbols = np.asarray(world.sample(200, rng=np.random.default_rng(seed)).observations)
        found = estimate_world(filter_beliefs(world, symbols).beliefs, n_symbols=table.shape[1])
        assert arbitrary(found.symbols, symbols[1:]) == 0
        assert found.status is not SensorStatus.INCONSISTENT
        if found.status is SensorStatus.DEGENERATE:
            continue
        order = [int(symbols[1:][found.symbols == y][0]) for y in range(table.shape[1])]
        low, high = found.sensor_intervals[..., 0] - 1e-6, found.sensor_intervals[..., 1] + 1e-6
        held.append((low <= table[:, order]) & (table[:, order] <= high))
    assert len(held) >= 19
    assert np.mean(held) >= 0.75, "the frequencies of some fifty steps"


@pytest.mark.parametrize("seed", [51, 54])
def test_named_symbols_near_a_sure_state_do_not_contradict_a_world(seed: int) -> None:
    """1 − π had no digits left there: the length of a column, which changes nothing, looked uncertain."""
    rng = np.random.default_rng(seed)
    _, count = int(rng.integers(2, 4)), int(rng.integers(2, 4))
    table = rng.dirichlet(np.full(count, 1.5), 2)
    world = HiddenMarkovModel(np.eye(2), CategoricalEmission(table), [0.5, 0.5])
    symbols = np.asarray(world.sample(int(rng.choice([30, 60])), rng=rng).observations)
    found = estimate_world(filter_beliefs(world, symbols).beliefs, n_symbols=count, symbols=symbols)
    assert found.status is not SensorStatus.INCONSISTENT
    assert found.residual <= 1e-9


@pytest.mark.parametrize("seed", range(8))
def test_rounding_gives_no_step_a_symbol(seed: int) -> None:
    """Where beliefs are nearly certain, or two states have nearly one sensor, the least of distances of 1e-16 chose it."""
    rng = np.random.default_rng([seed, 7])
    world = HiddenMarkovModel(np.eye(3), CategoricalEmission(rng.dirichlet(np.full(3, 2.0), 3)), np.full(3, 1 / 3))
    symbols = np.asarray(world.sample(200, rng=np.random.default_rng(seed)).observations)
    found = estimate_sensor(filter_beliefs(world, symbols).beliefs, np.eye(3), n_symbols=3)
    assert found.is_identified
    assert arbitrary(found.symbols, symbols[1:]) == 0
    assert error(found.probabilities, world.emission.probabilities) <= 1e-6  # type: ignore[attr-defined]


def test_a_belief_in_a_state_that_the_chain_cannot_reach_is_refused() -> None:
    with pytest.raises(
        ModelError, match=r"belief 1 gives state 1 the probability .* unless .* belief 0 was rounded to 0"
    ):
        estimate_sensor([[1.0, 0.0], [0.5, 0.5]], np.eye(2))


@pytest.mark.parametrize("n_steps", [2, 3, 4])
def test_too_few_steps_have_a_status_and_no_nan(n_steps: int) -> None:
    beliefs, _ = path(TRANSITION, SENSOR, n_steps, np.random.default_rng(3))
    one, two = estimate_sensor(beliefs, TRANSITION, n_symbols=3), estimate_world(beliefs, n_symbols=3)
    assert one.status in (SensorStatus.TOO_FEW_STEPS, SensorStatus.TOO_FEW_SYMBOLS)
    assert two.status is SensorStatus.TOO_FEW_STEPS
    for table in (one.probabilities, two.world.transition, two.world.emission.probabilities):  # type: ignore[attr-defined]
        assert np.isfinite(table).all()
        np.testing.assert_allclose(table.sum(axis=1), 1.0, rtol=1e-12)


def test_symbols_that_never_came_up_are_said_to_be_missing() -> None:
    beliefs, _ = path(TRANSITION, SENSOR, 200, np.random.default_rng(1))
    found = estimate_sensor(beliefs, TRANSITION, n_symbols=4)
    assert found.status is SensorStatus.TOO_FEW_SYMBOLS
    assert found.probabilities.shape == (3, 4)
    assert found.probabilities[:, 3].max() < 0.02
    assert (found.intervals[:, 3, 1] > 0.1).all()


@pytest.mark.parametrize("n_bootstrap", [0, 20])
def test_symbols_with_the_same_effect_may_share_a_column_in_any_way(n_bootstrap: int) -> None:
    """Two of three columns are proportional, so that no belief tells them apart; they were counted as one, for certain."""
    transition, sensor = np.array([[0.8, 0.2], [0.3, 0.7]]), np.array([[0.4, 0.4, 0.2], [0.1, 0.1, 0.8]])
    beliefs, symbols = path(transition, sensor, 300, np.random.default_rng(2))
    draws = {"n_bootstrap": n_bootstrap, "rng": np.random.default_rng(0)}
    alone = estimate_sensor(beliefs, transition, n_symbols=3, **draws)
    world = estimate_world(beliefs, n_symbols=3, **draws)
    for found, table, limits in (
        (alone, alone.probabilities, alone.intervals),
        (world, world.world.emission.probabilities, world.sensor_intervals),  # type: ignore[attr-defined]
    ):
        split = int(table[0].argmax())  # the column of both symbols; either is half of it
        order = [2, 2, 2]
        order[split], order[2] = 0, 1
        true = sensor[:, order]
        assert (limits[..., 0] <= true + 1e-9).all()
        assert (true <= limits[..., 1] + 1e-9).all()
        assert found.status is SensorStatus.TOO_FEW_SYMBOLS
        assert "several symbols have the same effect" in found.status.value
    told = estimate_world(beliefs, n_symbols=3, symbols=symbols)
    assert (told.sensor_intervals[..., 0] > 0.05).all()


def test_zeros_of_the_sensor_are_found_and_beliefs_that_stand_still_say_nothing() -> None:
    transition = np.array([[0.8, 0.2, 0.0], [0.0, 0.7, 0.3], [0.3, 0.0, 0.7]])
    sensor = np.array([[0.7, 0.3, 0.0], [0.0, 0.7, 0.3], [0.1, 0.25, 0.65]])
    beliefs, _ = path(transition, sensor, 200, np.random.default_rng(5))
    found = estimate_sensor(beliefs, transition)
    assert found.is_identified
    assert error(found.probabilities, sensor) <= 1e-12
    certain = np.tile([1.0, 0.0, 0.0], (10, 1))
    nothing = estimate_sensor(certain, np.eye(3))
    assert nothing.status is SensorStatus.ZEROS
    assert (nothing.intervals == [0.0, 1.0]).all()
    assert estimate_world(np.tile([0.5, 0.3, 0.2], (100, 1)), n_symbols=2).status is SensorStatus.DEGENERATE


def test_symbols_that_noise_mixes_up_are_said_to_overlap() -> None:
    sensor = np.array([[0.34, 0.33, 0.33], [0.33, 0.34, 0.33], [0.33, 0.33, 0.34]])
    rng = np.random.default_rng(2)
    beliefs, _ = path(TRANSITION, sensor, 200, rng)
    assert estimate_sensor(blurred(beliefs, 0.02, rng), TRANSITION, n_symbols=3).status is SensorStatus.OVERLAPPING


def test_labels_are_aligned_and_results_are_kept(tmp_path: object) -> None:
    names = ["calm", "normal", "crisis"]
    beliefs, _ = path(TRANSITION, SENSOR, 100, np.random.default_rng(1))
    table = pd.DataFrame(TRANSITION, index=names, columns=names)
    shuffled = pd.DataFrame(beliefs, columns=names)[["crisis", "calm", "normal"]]
    found = estimate_sensor(shuffled, table)
    assert error(found.probabilities, SENSOR) <= 1e-10
    assert "identified" in str(found)
    found.save(tmp_path / "sensor.npz")  # type: ignore[operator]
    again = EstimatedSensor.load(tmp_path / "sensor.npz")  # type: ignore[operator]
    assert again.status is found.status
    with pytest.raises(InputError, match="state labels"):
        estimate_sensor(shuffled.rename(columns={"calm": "quiet"}), table)


def test_symbols_are_aligned_with_beliefs_by_date() -> None:
    beliefs, symbols = path(TRANSITION, SENSOR, 60, np.random.default_rng(1))
    days = pd.date_range("2020-01-01", periods=60)
    dated, reports = pd.DataFrame(beliefs, days), pd.Series(symbols, days)
    bare = reports.reset_index(drop=True)
    for held in (dated, beliefs):
        for given in (reports, reports.iloc[1:], symbols, symbols[1:], bare, bare.iloc[1:].reset_index(drop=True)):
            assert error(estimate_world(held, n_symbols=3, symbols=given).world.transition, TRANSITION) <= 1e-8
    for given in (reports.iloc[::-1], reports.iloc[:0:-1], dict(reports.iloc[::-1])):
        assert error(estimate_world(dated, n_symbols=3, symbols=given).world.transition, TRANSITION) <= 1e-8
    for given in (reports.iloc[:-1], reports.shift(1, freq="D")):
        with pytest.raises(InputError, match="other step labels"):
            estimate_world(dated, n_symbols=3, symbols=given)


def test_malformed_input_is_named() -> None:
    beliefs, symbols = path(TRANSITION, SENSOR, 50, np.random.default_rng(1))
    for call, said in [
        (lambda: estimate_sensor(beliefs[:1], TRANSITION), "two at least"),
        (lambda: estimate_sensor(beliefs, TRANSITION[:2]), "square"),
        (lambda: estimate_sensor(beliefs[:, :2], TRANSITION), "expected one per state"),
        (lambda: estimate_sensor(beliefs, TRANSITION, n_symbols=0), "n_symbols"),
        (lambda: estimate_sensor(beliefs, TRANSITION, n_bootstrap=5), "rng"),
        (lambda: estimate_sensor(np.where(beliefs > 0.5, np.nan, beliefs), TRANSITION), "finite"),
        (lambda: estimate_world(beliefs, n_symbols=3, symbols=symbols[:10]), "10 entries for 50 beliefs"),
        (lambda: estimate_world(beliefs, n_symbols=2, symbols=symbols), "symbols"),
        (lambda: estimate_world(beliefs, n_symbols=None), "n_symbols"),  # type: ignore[arg-type]
    ]:
        with pytest.raises(InputError, match=said):
            call()


@pytest.mark.parametrize("risk_aversion", [1.0, 0.12])
def test_decisions_give_the_sensor_away_also_where_some_leave_intervals_of_beliefs(risk_aversion: float) -> None:
    transition, sensor = UNDER_NOISE[2]
    problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [0.3 * np.eye(2), 0.3 * np.eye(2)], risk_aversion)
    beliefs, _ = path(transition, sensor, 60 if audited() else 24, np.random.default_rng(0))
    sets = [
        consistent_beliefs(problem, action) for action in OriginalDecisionMaker(problem).decide_many(beliefs).action
    ]
    are_points = all(each.dimension == 0 for each in sets)
    assert are_points == (risk_aversion == 1.0)
    found = estimate_sensor(sets, transition, n_symbols=2)
    middles = estimate_sensor(np.array([each.center() for each in sets]), transition, n_symbols=2)
    if are_points:
        assert found.is_identified
        assert error(found.probabilities, sensor) <= 1e-8
    else:
        assert found.status is SensorStatus.SETS
        assert error(found.probabilities, sensor) <= 0.01 < error(middles.probabilities, sensor)
        assert (np.diff(found.intervals, axis=2) > 0).all()


def test_labelled_sets_are_aligned_with_the_transition() -> None:
    names, other = ["calm", "crisis"], ["crisis", "calm"]
    transition, sensor = UNDER_NOISE[2]
    table, means = pd.DataFrame(transition, names, names), pd.DataFrame([[0.2, 0.0], [0.0, 0.2]], names)
    problem, turned = (
        MarkowitzProblem(means.loc[order], [0.3 * np.eye(2), 0.3 * np.eye(2)], 1.0) for order in (names, other)
    )
    actions = (
        OriginalDecisionMaker(problem).decide_many(path(transition, sensor, 24, np.random.default_rng(0))[0]).action
    )
    sets = [consistent_beliefs(problem, action) for action in actions]
    mixed = [sets[0], *(consistent_beliefs(turned, action) for action in actions[1:])]
    for given, order in ((sets, names), (sets, other), (mixed, names), (mixed, other)):
        found = estimate_sensor(given, table.loc[order, order], n_symbols=2)
        assert found.is_identified
        assert error(found.probabilities, sensor[:: 1 if order == names else -1]) <= 1e-8
    with pytest.raises(InputError, match="several orders"):
        estimate_sensor(mixed, transition, n_symbols=2)
    with pytest.raises(InputError, match="other state labels"):
        estimate_sensor(sets, table.set_axis(["calm", "dull"]).set_axis(["calm", "dull"], axis=1), n_symbols=2)


def test_a_set_of_beliefs_that_is_empty_is_refused() -> None:
    problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
    sets = [consistent_beliefs(problem, action) for action in ([0.5, 0.5], [0.9, 0.1])]
    assert sets[1].is_empty
    with pytest.raises(InputError, match="is empty"):
        estimate_sensor(sets, UNDER_NOISE[2][0])


@pytest.mark.parametrize("difference", [1e-1, 1e-2, 1e-3, 1e-5, 1e-6, 1e-7, 0.0])
@pytest.mark.parametrize("known", [True, False])
def test_states_that_move_nearly_alike_are_read_right_or_left_open(difference: float, known: bool) -> None:
    """Rows of the transition that hardly differ: beliefs of double precision do not tell them apart."""
    rng = np.random.default_rng(3)
    transition = np.array([[0.6, 0.4], [0.6 - difference, 0.4 + difference]])
    sensor = np.array([[0.7, 0.3], [0.2, 0.8]])
    beliefs, symbols = [np.array([0.3, 0.7])], rng.integers(2, size=150)
    for symbol in symbols:
        weighed = sensor[:, symbol] * (transition.T @ beliefs[-1])
        beliefs.append(weighed / weighed.sum())
    found = estimate_world(np.array(beliefs), n_symbols=2, symbols=symbols if known else None)
    if found.status is SensorStatus.IDENTIFIED:
        assert np.abs(found.world.transition - transition).max() <= 1e-6
    else:
        assert difference <= 1e-3


@pytest.mark.parametrize("with_names", [True, False])
def test_a_symbol_that_never_occurs_in_a_state_is_no_obstacle(with_names: bool, fresh_rng: np.random.Generator) -> None:
    for _ in range(instances(20, least=8)):
        n_states, n_symbols = (int(n) for n in fresh_rng.integers(2, 5, size=2))
        transition = fresh_rng.dirichlet(np.ones(n_states), n_states)
        sensor = fresh_rng.dirichlet(np.ones(n_symbols), n_states)
        sensor[fresh_rng.integers(n_states), fresh_rng.integers(n_symbols)] = 0.0
        sensor /= sensor.sum(axis=1, keepdims=True)
        beliefs, symbols = path(transition, sensor, 120, fresh_rng)
        found = estimate_world(beliefs, n_symbols=n_symbols, symbols=symbols if with_names else None)
        assert found.status not in (SensorStatus.INCONSISTENT, SensorStatus.OVERLAPPING)
        if found.status in (SensorStatus.IDENTIFIED, SensorStatus.SCALES_BY_FREQUENCY):
            np.testing.assert_allclose(found.world.transition, transition, atol=1e-3)


def test_nothing_is_known_of_a_state_that_no_belief_holds_possible() -> None:
    share = np.random.default_rng(0).uniform(0.5, 0.9, 30)
    beliefs = np.column_stack([share, 1.0 - share, 0.0 * share])
    transition = [[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]]
    found = estimate_sensor(beliefs, transition, n_symbols=3)
    np.testing.assert_allclose(found.probabilities[2], 1 / 3)
    np.testing.assert_allclose(found.intervals[2], np.tile([0.0, 1.0], (3, 1)))


@pytest.mark.parametrize("seed", some([1, 11, 16], 2))
def test_a_world_is_estimated_from_noisy_beliefs_where_a_trial_rules_a_state_out(seed: int) -> None:
    """The square of a ratio to its predicted probability overflowed, and an error of linear algebra ended the estimate."""
    rng, transition = np.random.default_rng(seed), [[0.5, 0.5], [0.3, 0.7]]
    world = HiddenMarkovModel(transition, CategoricalEmission([[0.3, 0.6, 0.1], [0.5, 0.3, 0.2]]), [0.5, 0.5])
    held = filter_beliefs(world, world.sample(60, rng=rng).observations).beliefs
    noisy = np.abs(held + 1e-3 * rng.normal(size=held.shape))
    found = estimate_world(noisy / noisy.sum(axis=1, keepdims=True), n_symbols=3)
    assert np.isfinite(found.world.transition).all()
    assert isinstance(found.world.emission, CategoricalEmission)


@pytest.mark.parametrize(
    ("n_states", "n_symbols", "deviation", "with_names"),
    some(
        [
            (2, 2, 1e-3, True),
            (2, 2, 1e-3, False),
            (3, 2, 1e-4, True),
            (3, 2, 1e-9, True),
            (3, 2, 1e-9, False),
            (3, 2, 1e-4, False),
            (3, 3, 1e-3, True),
        ],
        4,
    ),
)
def test_beliefs_with_errors_have_a_world_that_explains_them(
    n_states: int, n_symbols: int, deviation: float, with_names: bool
) -> None:
    """Nearly as well as the true one, in four of five worlds at least; the residual is that of the world that is returned."""
    explained = 0
    for seed in range(5):
        rng = np.random.default_rng([seed, n_states, n_symbols])
        chain, sensor = (rng.dirichlet(np.full(n, 2.0), n_states) + 0.05 for n in (n_states, n_symbols))
        chain, sensor = (each / each.sum(axis=1, keepdims=True) for each in (chain, sensor))
        world = HiddenMarkovModel(chain, CategoricalEmission(sensor), np.full(n_states, 1.0 / n_states))
        symbols = np.asarray(world.sample(300, rng=rng).observations)
        errors = deviation * rng.normal(size=(300, n_states))
        beliefs = np.abs(filter_beliefs(world, symbols).beliefs + errors - errors.mean(axis=1, keepdims=True))
        beliefs /= beliefs.sum(axis=1, keepdims=True)
        found = estimate_world(beliefs, n_symbols=n_symbols, symbols=symbols if with_names else None)

        def missed(
            transition: np.ndarray, told: np.ndarray, numbers: np.ndarray, beliefs: np.ndarray = beliefs
        ) -> float:
            shown = (beliefs[:-1] @ transition) * told[:, numbers].T
            return float(np.linalg.norm(beliefs[1:] - shown / shown.sum(axis=1, keepdims=True), axis=1).max())

        if found.status in (SensorStatus.IDENTIFIED, SensorStatus.OVERLAPPING) and (found.symbols >= 0).all():
            own = missed(found.world.transition, found.world.emission.probabilities, found.symbols)
            assert found.residual == pytest.approx(own, rel=1e-6, abs=1e-12)
            explained += own <= 2.0 * missed(chain, sensor, symbols[1:])
            np.testing.assert_array_less(found.transition_intervals[..., 0], found.world.transition + 1e-12)
            np.testing.assert_array_less(found.world.transition, found.transition_intervals[..., 1] + 1e-12)
    assert explained >= 4
