"""Linear Gaussian worlds: the filter against conditioning of one joint Gaussian law, and against statsmodels."""

from __future__ import annotations

from decimal import Decimal, localcontext
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import null_space

from inscrutable import (
    GaussianEmission,
    HiddenMarkovModel,
    InputError,
    LinearGaussianWorld,
    ModelError,
    PublicPart,
    filter_beliefs,
    fit_gaussian_hmm,
    kalman_filter,
    steady_filter,
)

Array = Any
LOCAL_LEVEL = LinearGaussianWorld([[1.0]], [[0.2]], [[1.0]], [[0.5]], initial=([0.0], [[2.0]]))


def covariance(rng: np.random.Generator, n: int) -> Array:
    factor = rng.normal(size=(n, n))
    return factor @ factor.T / n


def world_of(rng: np.random.Generator, n: int = 3, p: int = 2, *, public: Any = None) -> LinearGaussianWorld:
    move = rng.normal(size=(n, n))
    move *= 0.9 / np.abs(np.linalg.eigvals(move)).max()
    return LinearGaussianWorld(
        move, covariance(rng, n), rng.normal(size=(p, n)), covariance(rng, p) + 0.1 * np.eye(p), public=public
    )


def joint_law(moves: list[Array], processes: list[Array], start: Array) -> Array:
    """The covariance of all states of a path, one below the other."""
    n, steps = len(start), len(moves) + 1
    # x = Φ (x_0, w_0, w_1, …) with Φ filled step by step.
    shocks = np.zeros((steps * n, steps * n))
    noise = np.zeros((steps * n, steps * n))
    noise[:n, :n] = start
    shocks[:n, :n] = np.eye(n)
    for t, (move, process) in enumerate(zip(moves, processes, strict=True), start=1):
        here, before = slice(t * n, (t + 1) * n), slice((t - 1) * n, t * n)
        shocks[here] = move @ shocks[before]
        shocks[here, here] += np.eye(n)
        noise[here, here] = process
    return shocks @ noise @ shocks.T


def conditioned(states: Array, sensors: list[Array], noises: list[Array], rows: Array, mean: Array) -> list[Any]:
    """Means and covariances of each state given all rows up to its own, NaN left out; and the log-density of all."""
    n, p = sensors[0].shape[1], len(sensors[0])
    steps = len(rows)
    read, spread = np.zeros((steps * p, steps * n)), np.zeros((steps * p, steps * p))
    for t in range(steps):
        read[t * p : (t + 1) * p, t * n : (t + 1) * n] = sensors[t]
        spread[t * p : (t + 1) * p, t * p : (t + 1) * p] = noises[t]
    found: list[Any] = []
    for t in range(steps):
        there = np.flatnonzero(~np.isnan(rows[: t + 1].ravel()))
        here = slice(t * n, (t + 1) * n)
        seen = (read @ states @ read.T + spread)[np.ix_(there, there)]
        across = (states @ read.T)[here][:, there]
        apart = rows[: t + 1].ravel()[there] - (read @ mean)[there]
        gain = np.linalg.solve(seen, across.T).T if there.size else np.zeros((n, 0))
        found.append((mean[here] + gain @ apart, states[here, here] - gain @ across.T))
    size = np.linalg.slogdet(2.0 * np.pi * seen)[1]
    return [found, -0.5 * (size + apart @ np.linalg.solve(seen, apart))]


def test_the_filter_is_joint_gaussian_conditioning(fresh_rng: np.random.Generator) -> None:
    rng = fresh_rng
    for _ in range(5):
        sensor, noise = rng.normal(size=(1, 3)), np.array([[0.3]])
        world = world_of(rng, public=(sensor, noise))
        path = world.sample(6, rng=rng)
        rows = path.observations.copy()
        rows[1], rows[3, 0], rows[4, 1] = np.nan, np.nan, np.nan
        means, spreads, total = kalman_filter(world, rows, public=path.public)
        stacked, both = np.vstack([world.sensor, sensor]), np.zeros((3, 3))
        both[:2, :2], both[2:, 2:] = world.noise, noise
        states = joint_law([world.transition] * 5, [world.process] * 5, world.stationary_covariance)
        seen = np.column_stack([rows, path.public])
        found, density = conditioned(states, [stacked] * 6, [both] * 6, seen, np.zeros(18))
        for t, (mean, spread) in enumerate(found):
            np.testing.assert_allclose(means[t], mean, rtol=0, atol=1e-10)
            np.testing.assert_allclose(spreads[t], spread, rtol=0, atol=1e-10)
        assert total == pytest.approx(density, abs=1e-9)


def test_matrices_that_change_with_time(fresh_rng: np.random.Generator) -> None:
    rng, steps = fresh_rng, 5
    moves, reads = rng.normal(size=(steps, 2, 2)), rng.normal(size=(steps, 1, 2))
    shocks, noises = (
        np.stack([covariance(rng, 2) for _ in range(steps)]),
        np.stack([np.eye(1) * (t + 1) for t in range(steps)]),
    )
    start = np.array([1.0, -1.0]), np.eye(2)
    world = LinearGaussianWorld(moves, shocks, reads, noises, initial=start)
    rows = world.sample(steps, rng=rng).observations
    rows[2] = np.nan
    means, spreads, _ = kalman_filter(world, rows)
    centre = [start[0]]
    for t in range(steps - 1):
        centre.append(moves[t] @ centre[-1])
    states = joint_law(list(moves[:-1]), list(shocks[:-1]), start[1])
    found, _ = conditioned(states, list(reads), list(noises), rows, np.concatenate(centre))
    for t, (mean, spread) in enumerate(found):
        np.testing.assert_allclose(means[t], mean, rtol=0, atol=1e-10)
        np.testing.assert_allclose(spreads[t], spread, rtol=0, atol=1e-10)
    with pytest.raises(ModelError, match="change with time"):
        steady_filter(world)
    with pytest.raises(InputError, match="6 rows, but the world's matrices say 5 steps"):
        kalman_filter(world, np.zeros((6, 1)))


def test_the_filter_is_that_of_statsmodels(fresh_rng: np.random.Generator) -> None:
    from statsmodels.tsa.statespace.kalman_filter import KalmanFilter

    rng = fresh_rng
    world = world_of(rng, 3, 2)
    rows = world.sample(40, rng=rng).observations
    rows[5], rows[7, 1] = np.nan, np.nan
    other = KalmanFilter(
        k_endog=2,
        k_states=3,
        design=world.sensor,
        obs_cov=world.noise,
        transition=world.transition,
        selection=np.eye(3),
        state_cov=world.process,
        loglikelihood_burn=0,
    )
    other.bind(np.asfortranarray(rows.T))
    other.initialize_known(np.zeros(3), world.stationary_covariance)
    theirs = other.filter()
    means, spreads, total = kalman_filter(world, rows)
    np.testing.assert_allclose(means, theirs.filtered_state.T, rtol=0, atol=1e-9)
    np.testing.assert_allclose(spreads, theirs.filtered_state_cov.transpose(2, 0, 1), rtol=0, atol=1e-9)
    assert total == pytest.approx(theirs.llf, abs=1e-7)


def test_more_rows_change_no_earlier_one(fresh_rng: np.random.Generator) -> None:
    world = world_of(fresh_rng)
    rows = world.sample(30, rng=fresh_rng).observations
    early, whole = kalman_filter(world, rows[:12]), kalman_filter(world, rows)
    assert np.array_equal(early.means, whole.means[:12])
    assert np.array_equal(early.covariances, whole.covariances[:12])


def test_a_filter_whose_sensors_reveal_the_state_predicts_with_the_process_noise(
    fresh_rng: np.random.Generator,
) -> None:
    """Twice as many sensors as states and noises: half of their combinations have none. Noises are up to 300 times larger."""
    seen = 0
    while seen < 60:
        n = int(fresh_rng.integers(1, 3))
        move, sensor = fresh_rng.normal(size=(n, n)), fresh_rng.normal(size=(2 * n, n))
        noise = fresh_rng.normal(size=(2 * n, n)) * 10.0 ** fresh_rng.uniform(0.0, 2.5)
        if np.linalg.svd(null_space(noise.T).T @ sensor, compute_uv=False)[-1] < 0.1:
            continue
        process = np.eye(n) + 0.3 * fresh_rng.normal(size=(n, n))
        world = LinearGaussianWorld(move, process @ process.T, sensor, noise @ noise.T)
        found = steady_filter(world).predicted_covariance
        np.testing.assert_allclose(found, world.process, rtol=0, atol=1e-7 * np.abs(found).max())
        seen += 1


def solved_exactly(matrix: np.ndarray, sides: np.ndarray) -> np.ndarray:
    """One solution for a positive semidefinite matrix of decimals, by elimination; a pivot that is rounding is none."""
    table, least = np.hstack([matrix, sides]), np.diag(matrix) * Decimal(10) ** -60
    for i in range(len(matrix)):
        if table[i, i] <= least[i]:
            table[i] *= 0
            continue
        table[i] = table[i] / table[i, i]
        for k in set(range(len(matrix))) - {i}:
            table[k] = table[k] - table[k, i] * table[i]
    return table[:, len(matrix) :]


def predicted_exactly(
    move: np.ndarray, shocks: np.ndarray, sensor: np.ndarray, noises: np.ndarray
) -> np.ndarray | None:
    """The prediction's covariance after 100 steps in 120 digits; None where it still moves. Noises are given by factors."""
    with localcontext(prec=120):
        move, shocks, sensor, noises = (
            np.vectorize(Decimal, otypes=[object])(m) for m in (move, shocks, sensor, noises)
        )
        process, noise = shocks @ shocks.T, noises @ noises.T
        spread = process + np.eye(len(process), dtype=int) * process.max()
        for _ in range(100):
            seen, last = sensor @ spread, spread
            told = seen.T @ solved_exactly(seen @ sensor.T + noise, seen)
            spread = move @ (spread - told) @ move.T + process
            spread = (spread + spread.T) / 2
            if np.abs(spread - last).max() <= spread.max() * Decimal(10) ** -20:
                return spread.astype(float)
    return None


@pytest.mark.parametrize("seed", [None, 122, 394, 896, 1014])  # all but the first were refused
def test_worlds_of_scales_far_apart_with_singular_noises_have_their_filter(
    seed: int | None, fresh_rng: np.random.Generator
) -> None:
    rng = fresh_rng if seed is None else np.random.default_rng(seed)
    n = int(rng.integers(3, 6))
    p = int(rng.integers(2, 2 * n))
    states, sensors = 10.0 ** rng.uniform(-2.5, 2.5, (n, 1)), 10.0 ** rng.uniform(-2.5, 2.5, (p, 1))
    move = rng.normal(size=(n, n)) * states / states.T
    sensor = rng.normal(size=(p, n)) * sensors / states.T
    shocks = rng.normal(size=(n, int(rng.integers(1, n)))) * states
    noises = rng.normal(size=(p, int(rng.integers(1, p)))) * sensors
    found = steady_filter(LinearGaussianWorld(move, shocks @ shocks.T, sensor, noises @ noises.T)).predicted_covariance
    wanted = predicted_exactly(move, shocks, sensor, noises)
    if wanted is not None:
        scaled = wanted / states / states.T
        np.testing.assert_allclose(found / states / states.T, scaled, rtol=0, atol=1e-7 * np.abs(scaled).max())
    assert seed is None or wanted is not None


def test_the_steady_filter_is_where_the_filter_goes(fresh_rng: np.random.Generator) -> None:
    sensor = fresh_rng.normal(size=(1, 3))
    world = world_of(fresh_rng, public=(sensor, np.array([[0.3]])))
    steady = steady_filter(world)
    path = world.sample(300, rng=fresh_rng)
    _, spreads, _ = kalman_filter(world, path.observations, public=path.public)
    np.testing.assert_allclose(steady.covariance, spreads[-1], rtol=0, atol=1e-9)
    move, before = world.transition, steady.predicted_covariance
    np.testing.assert_allclose(move @ spreads[-1] @ move.T + world.process, before, rtol=0, atol=1e-9)
    np.testing.assert_allclose(steady.innovation_covariance, before - steady.covariance, rtol=0, atol=1e-9)
    np.testing.assert_allclose(steady.cross_covariance, before @ sensor.T, rtol=0, atol=1e-9)
    np.testing.assert_allclose(steady.public_covariance, sensor @ before @ sensor.T + 0.3, rtol=0, atol=1e-9)
    np.testing.assert_allclose(steady.public_sensor, sensor @ move, rtol=0, atol=1e-12)


def test_what_the_steady_filter_says_of_means_and_public_readings_is_so_in_simulation() -> None:
    rng = np.random.default_rng(11)
    part = PublicPart([[1.0, -1.0]])
    world = LinearGaussianWorld([[0.9, 0.2], [0.0, 0.7]], np.eye(2), np.eye(2), 0.5 * np.eye(2), public=part)
    steady = steady_filter(world)
    path = world.sample(4_000, rng=rng)
    means = kalman_filter(world, path.observations).means[100:]
    news = means[1:] - means[:-1] @ world.transition.T
    told = path.public[101:] - means[:-1] @ steady.public_sensor.T
    both = np.hstack([news, told])
    joint = np.block(
        [
            [steady.innovation_covariance, steady.cross_covariance],
            [steady.cross_covariance.T, steady.public_covariance],
        ]
    )
    spread = np.sqrt((np.outer(np.diag(joint), np.diag(joint)) + joint**2) / len(both))
    assert (np.abs(both.T @ both / len(both) - joint) < 4.5 * spread).all()


def test_samples_have_the_stationary_law() -> None:
    rng = np.random.default_rng(5)
    world = world_of(rng)
    states = world.sample(40_000, rng=rng).states
    spread = np.cov(states.T, bias=True)
    assert np.abs(spread - world.stationary_covariance).max() < 0.2 * np.abs(spread).max()


def test_labels_are_aligned() -> None:
    states, read = ["value", "growth"], ["price", "volume"]
    move = pd.DataFrame([[0.9, 0.1], [0.0, 0.5]], states, states)
    shock = pd.DataFrame([[1.0, 0.3], [0.3, 2.0]], states, states)
    sensor = pd.DataFrame([[1.0, 0.0], [1.0, 2.0]], read, states)
    noise = pd.DataFrame([[0.5, 0.1], [0.1, 0.4]], read, read)
    plain = LinearGaussianWorld(move, shock, sensor, noise)
    other = LinearGaussianWorld(
        move, shock.loc[states[::-1], states[::-1]], sensor[states[::-1]], noise.loc[read[::-1], read[::-1]]
    )
    assert np.array_equal(plain.process, other.process)
    assert np.array_equal(plain.sensor, other.sensor)
    rows = pd.DataFrame([[1.0, 2.0], [np.nan, 1.0]], ["May", "June"], read)
    found = kalman_filter(plain, rows[read[::-1]]).means
    assert list(found.columns) == states
    assert list(found.index) == ["May", "June"]
    np.testing.assert_array_equal(found.to_numpy(), kalman_filter(plain, rows.to_numpy()).means)
    with pytest.raises(InputError, match="other column labels"):
        kalman_filter(plain, rows.rename(columns={"price": "yield"}))


def test_bad_worlds_are_refused() -> None:
    one = [[1.0]]
    with pytest.raises(ModelError, match="process is indefinite: smallest eigenvalue -1"):
        LinearGaussianWorld(one, [[-1.0]], one, one)
    with pytest.raises(InputError, match="noise is not symmetric"):
        LinearGaussianWorld(one, one, [[1.0], [2.0]], [[1.0, 0.5], [0.0, 1.0]])
    with pytest.raises(InputError, match=r"sensor has shape \(1, 2\), expected one column per state: 1"):
        LinearGaussianWorld(one, one, [[1.0, 2.0]], one)
    walk = LinearGaussianWorld(one, one, one, one)
    with pytest.raises(ModelError, match=r"no stationary law: .* modulus 1"):
        _ = walk.stationary_covariance
    with pytest.raises(ModelError, match="pass `initial`"):
        walk.sample(3, rng=np.random.default_rng(0))
    assert steady_filter(walk).covariance[0, 0] == pytest.approx((np.sqrt(5.0) - 1.0) / 2.0, abs=1e-12)
    with pytest.raises(ModelError, match="no filter converges"):
        steady_filter(LinearGaussianWorld(np.diag([1.1, 0.5]), np.eye(2), [[0.0, 1.0]], one))
    with pytest.raises(ModelError, match="row 0 has no density"):
        kalman_filter(LinearGaussianWorld([[0.0]], [[0.0]], one, [[0.0]]), [1.0])


def test_columns_that_contradict_without_noise_have_no_density(fresh_rng) -> None:
    """C P C' has rank one; what is left of its second pivot is rounding, positive or not."""
    for start in fresh_rng.uniform(0.0, 3.0, 50):
        world = LinearGaussianWorld([[0.5]], [[0.3]], [[1.0], [1.0]], np.zeros((2, 2)), ([0.0], [[start]]))
        for row in ([1.0, 2.0], [1.0, 1.0]):
            with pytest.raises(ModelError, match="row 0 has no density"):
                kalman_filter(world, [row])


def test_a_gap_that_nobody_else_knows_is_refused() -> None:
    rows = [1.0, np.nan, 0.5]
    known = kalman_filter(LOCAL_LEVEL, rows, gaps=[False, True, False])
    assert np.array_equal(known.means, kalman_filter(LOCAL_LEVEL, rows).means)
    with pytest.raises(InputError, match=r"row 1, column 0 is missing, which is not public: .* would be private"):
        kalman_filter(LOCAL_LEVEL, rows, gaps=[False, False, False])
    with pytest.raises(InputError, match="row 2, column 0 is there, but gaps say it is missing"):
        kalman_filter(LOCAL_LEVEL, rows, gaps=[False, True, True])


def test_gaps_are_aligned_with_observations_by_their_labels() -> None:
    read = ["price", "volume"]
    sensor, noise = pd.DataFrame([[1.0], [1.0]], read, ["level"]), pd.DataFrame(np.diag([0.5, 2.0]), read, read)
    world = LinearGaussianWorld([[0.9]], [[0.19]], sensor, noise)
    rows = pd.DataFrame([[1.0, 2.0], [np.nan, 1.0], [0.5, np.nan]], ["May", "June", "July"], read)
    expected = kalman_filter(world, rows).means.to_numpy()
    for given in (rows[read[::-1]], rows):
        for gaps in (given.isna(), rows.isna(), rows[read[::-1]].isna().iloc[::-1], rows.isna().to_numpy()):
            np.testing.assert_array_equal(kalman_filter(world, given, gaps=gaps).means.to_numpy(), expected)
    with pytest.raises(InputError, match="gaps has other column labels"):
        kalman_filter(world, rows, gaps=rows.isna().rename(columns={"price": "yield"}))
    with pytest.raises(InputError, match="gaps has other row labels"):
        kalman_filter(world, rows, gaps=rows.isna().rename(index={"May": "April"}))


@pytest.mark.parametrize("kept", ["times", "dates"])
def test_rows_that_go_back_in_time_are_refused(kept: str) -> None:
    days = pd.date_range("2020-01-31", periods=4, freq="ME")
    rows = pd.DataFrame([[1.0], [2.0], [0.0], [5.0]], days if kept == "times" else days.date)
    world = LinearGaussianWorld([[0.9]], [[0.19]], [[1.0]], [[1.0]])
    hidden = HiddenMarkovModel([[0.9, 0.1], [0.1, 0.9]], GaussianEmission([[0.0], [3.0]], [[[1.0]]] * 2))
    for use in (
        lambda given: kalman_filter(world, given),
        lambda given: filter_beliefs(hidden, given),
        lambda given: fit_gaussian_hmm(given, 1, rng=np.random.default_rng(0), n_restarts=1),
    ):
        use(rows)
        with pytest.raises(InputError, match="in the order of time: after 2020-04-30"):
            use(rows.iloc[::-1])


def test_a_sensor_without_noise_and_an_unstable_world() -> None:
    exact = steady_filter(LinearGaussianWorld([[0.9, 0.1], [0.0, 0.5]], np.eye(2), np.eye(2), np.zeros((2, 2))))
    np.testing.assert_allclose(exact.covariance, 0.0, atol=1e-12)
    growing = steady_filter(LinearGaussianWorld([[1.2]], [[1.0]], [[1.0]], [[1.0]]))
    before = growing.predicted_covariance[0, 0]
    assert before == pytest.approx(1.44 * before / (before + 1.0) + 1.0, abs=1e-10)
