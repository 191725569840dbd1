"""A Kalman filter on another's Kalman filter: against Gaussian conditioning written out, and a recursion for one state."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.stats import multivariate_normal, norm

from inscrutable import InputError, LinearView, ModelError, SensorFamily, calibrate_sensor, inverse_kalman_filter
from inscrutable.worlds.kalman import kalman_filter
from inscrutable.worlds.linear_gaussian import LinearGaussianWorld

MOVE, PROCESS = np.array([[0.8, 0.1], [-0.2, 0.7]]), np.array([[0.3, 0.1], [0.1, 0.2]])
READ, NOISE = np.array([[1.0, 0.5], [0.0, 1.0]]), np.diag([0.5, 0.4])
MEAN, SPREAD = np.array([0.3, -0.2]), np.array([[1.0, 0.3], [0.3, 0.8]])
WORLD = LinearGaussianWorld(MOVE, PROCESS, READ, NOISE, (MEAN, SPREAD))
VIEW = LinearView([[1.0, 2.0]], [[0.1]])
SEEN = np.array([[0.4], [-0.7]])


def estimates() -> tuple[np.ndarray, np.ndarray]:
    """m_0, m_1 as a constant (4,) and a matrix (4,4) times y_0, y_1, by conditioning, not by recursion."""
    law = np.block([[SPREAD, SPREAD @ MOVE.T], [MOVE @ SPREAD, MOVE @ SPREAD @ MOVE.T + PROCESS]])
    middle, read = np.concatenate([MEAN, MOVE @ MEAN]), np.kron(np.eye(2), READ)
    constant, matrix = np.zeros(4), np.zeros((4, 4))
    for t in range(2):
        now, past = slice(2 * t, 2 * t + 2), slice(0, 2 * t + 2)
        seen = read[past] @ law @ read[past].T + np.kron(np.eye(t + 1), NOISE)
        matrix[now, past] = law[now] @ read[past].T @ np.linalg.inv(seen)
        constant[now] = middle[now] - matrix[now, past] @ read[past] @ middle
    return constant, matrix


def conditioned(mean: np.ndarray, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Law of m given what is seen of m_0 and m_1, and the log density of that."""
    look, blur = np.kron(np.eye(2), VIEW.matrix), np.kron(np.eye(2), VIEW.noise)
    seen = look @ spread @ look.T + blur
    gain = spread @ look.T @ np.linalg.inv(seen)
    off = SEEN.ravel() - look @ mean
    return mean + gain @ off, spread - gain @ look @ spread, float(multivariate_normal(cov=seen).logpdf(off))


def test_two_steps_with_known_states_are_gaussian_conditioning() -> None:
    constant, matrix = estimates()
    states = np.array([[0.5, -1.0], [0.2, 0.3]])
    mean, spread, log_density = conditioned(
        constant + matrix @ (states @ READ.T).ravel(), matrix @ np.kron(np.eye(2), NOISE) @ matrix.T
    )
    found = inverse_kalman_filter(WORLD, SEEN, VIEW, states=states)
    np.testing.assert_allclose(found.means[-1], mean[2:], atol=1e-10)
    np.testing.assert_allclose(found.covariances[-1], spread[2:, 2:], atol=1e-10)
    assert found.log_likelihood == pytest.approx(log_density, abs=1e-10)


def test_tables_are_read_by_their_labels() -> None:
    names, dates = ["a", "b"], pd.date_range("2020-01", periods=2, freq="ME")

    def table(values: np.ndarray, rows: list[str], columns: list[str]) -> pd.DataFrame:
        return pd.DataFrame(values, rows, columns)

    world = LinearGaussianWorld(
        table(MOVE, names, names), table(PROCESS, names, names), table(READ, ["y", "z"], names), NOISE, (MEAN, SPREAD)
    )
    view = LinearView(table(VIEW.matrix[:, ::-1], ["u"], names[::-1]), VIEW.noise)
    states, seen = np.array([[0.5, -1.0], [0.2, 0.3]]), pd.DataFrame(SEEN, dates, ["u"])
    known = pd.DataFrame(states[::-1, ::-1], dates[::-1], names[::-1])
    found, wanted = (
        inverse_kalman_filter(world, seen, view, states=known),
        inverse_kalman_filter(WORLD, SEEN, VIEW, states=states),
    )
    np.testing.assert_array_equal(found.means, wanted.means)
    assert found.log_likelihood == wanted.log_likelihood
    own = kalman_filter(world, pd.DataFrame([[0.4, -0.7], [0.1, 0.2]], dates, ["y", "z"])).means
    plain = np.asarray(own)
    assert inverse_kalman_filter(world, own).log_likelihood == inverse_kalman_filter(WORLD, plain).log_likelihood
    with pytest.raises(InputError, match="other observation labels"):
        inverse_kalman_filter(world, seen.set_axis(["v"], axis=1), view, states=known)


def test_two_steps_with_unknown_states_are_gaussian_conditioning() -> None:
    constant, matrix = estimates()
    law = np.block([[SPREAD, SPREAD @ MOVE.T], [MOVE @ SPREAD, MOVE @ SPREAD @ MOVE.T + PROCESS]])
    read = np.kron(np.eye(2), READ)
    told = read @ law @ read.T + np.kron(np.eye(2), NOISE)
    mean, spread, log_density = conditioned(
        constant + matrix @ read @ np.concatenate([MEAN, MOVE @ MEAN]), matrix @ told @ matrix.T
    )
    found = inverse_kalman_filter(WORLD, SEEN, VIEW)
    np.testing.assert_allclose(found.means[-1][2:], mean[2:], atol=1e-10)
    np.testing.assert_allclose(found.covariances[-1][2:, 2:], spread[2:, 2:], atol=1e-10)
    assert found.log_likelihood == pytest.approx(log_density, abs=1e-10)


def test_one_state_seen_through_noise_is_a_recursion_of_scalars(fresh_rng: np.random.Generator) -> None:
    move, process, read, noise, blur = 0.9, 0.4, 1.3, 0.7, 0.2
    states, seen = fresh_rng.normal(size=12), fresh_rng.normal(size=12)
    world = LinearGaussianWorld([[move]], [[process]], [[read]], [[noise]], ([0.0], [[1.0]]))
    before, mean, spread, log_density = 1.0, 0.0, 0.0, 0.0
    for t, (state, value) in enumerate(zip(states, seen, strict=True)):
        gain = before * read / (read**2 * before + noise)
        kept = 1.0 - gain * read
        mean = kept * (move * mean if t else 0.0) + gain * read * state
        spread = (kept * move) ** 2 * spread * (t > 0) + gain**2 * noise
        log_density += norm.logpdf(value, mean, np.sqrt(spread + blur))
        mean, spread = mean + spread / (spread + blur) * (value - mean), spread * blur / (spread + blur)
        before = move**2 * kept * before + process
    found = inverse_kalman_filter(world, seen, LinearView([[1.0]], [[blur]]), states=states)
    assert found.means[-1, 0] == pytest.approx(mean, abs=1e-10)
    assert found.covariances[-1, 0, 0] == pytest.approx(spread, abs=1e-10)
    assert found.log_likelihood == pytest.approx(log_density, abs=1e-10)


def test_estimates_that_are_seen_are_known() -> None:
    path = WORLD.sample(20, rng=np.random.default_rng(0))
    held = kalman_filter(WORLD, path.observations).means
    found = inverse_kalman_filter(WORLD, held, states=path.states)
    np.testing.assert_allclose(found.means, held, atol=1e-12)
    np.testing.assert_allclose(found.covariances, 0.0, atol=1e-12)


def test_a_gap_is_a_prediction() -> None:
    seen = np.array([[0.4], [np.nan], [0.1]])
    found = inverse_kalman_filter(WORLD, seen, VIEW, states=np.zeros((3, 2)))
    assert np.isfinite(found.means).all()
    assert np.trace(found.covariances[1]) > np.trace(found.covariances[0])


def test_the_noise_of_a_sensor_is_calibrated_from_a_linear_decision() -> None:
    def world(spread: float) -> LinearGaussianWorld:
        return LinearGaussianWorld([[0.9]], [[0.3]], [[1.0]], [[spread**2]], ([0.0], [[1.0]]))

    rng = np.random.default_rng(5)
    path = world(0.8).sample(250, rng=rng)
    decisions = 2.0 * kalman_filter(world(0.8), path.observations).means + 0.1 * rng.normal(size=(250, 1))
    family = SensorFamily(world, [[0.2, 3.0]], ["spread"])
    found = calibrate_sensor(decisions, path.states, LinearView([[2.0]], [[0.01]]), family, world=world(1.0))
    assert found.is_identified
    low, high = found.intervals[0]
    assert low <= 0.8 <= high
    assert high - low < 0.3


def test_estimates_that_are_certain_are_named_as_such() -> None:
    start, seen = ([0.0], [[1.0]]), [0.5, 0.7]
    blind, clear = (LinearGaussianWorld([[0.9]], [[0.19]], [[c]], [[1.0 - c]], start) for c in (0.0, 1.0))
    nothing = LinearGaussianWorld([[0.9]], [[0.19]], [[0.0]], [[0.0]], start)
    for world, states, said in [
        (blind, None, "sensor is zero"),
        (blind, seen, "sensor is zero"),
        (clear, seen, "observes without noise"),
        (nothing, seen, "no filter of its own"),
    ]:
        with pytest.raises(ModelError, match=said):
            inverse_kalman_filter(world, seen, states=states)
    blur = LinearView(
        [[1.0]], [[0.1]]
    )  # seen through noise: known estimates, 0 of the blind and the states of the other
    for world, known in ((blind, [0.0, 0.0]), (clear, [1.0, 2.0])):
        found = inverse_kalman_filter(world, seen, blur, states=[1.0, 2.0])
        np.testing.assert_allclose(found.means.ravel(), known, atol=1e-12)
        wanted = norm.logpdf(seen, known, np.sqrt(0.1)).sum()
        assert found.log_likelihood == pytest.approx(wanted, abs=1e-12)


def test_malformed_input_is_named() -> None:
    for call, said in [
        (lambda: inverse_kalman_filter(None, SEEN), "world"),  # type: ignore[arg-type]
        (lambda: inverse_kalman_filter(WORLD, SEEN), "seen has shape"),
        (lambda: inverse_kalman_filter(WORLD, SEEN[:0], VIEW), "seen has shape"),
        (lambda: inverse_kalman_filter(WORLD, SEEN[:, :, None], VIEW), "seen has shape"),
        (lambda: inverse_kalman_filter(WORLD, SEEN, LinearView([[1.0]])), "columns"),
        (lambda: inverse_kalman_filter(WORLD, SEEN, VIEW, states=np.zeros((3, 2))), "2 finite rows"),
        (
            lambda: inverse_kalman_filter(WORLD, SEEN, VIEW, states=[[0.0, 1.0], [2.0, np.nan]]),
            r"states has nan at index \[1, 1\]; every entry must be finite",
        ),
        (lambda: LinearView([[1.0]], [[1.0, 0.0]]), "noise has shape"),
    ]:
        with pytest.raises(InputError, match=said):
            call()
