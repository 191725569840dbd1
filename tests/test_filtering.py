"""The filter against enumeration of every path of states, and what a causal filter may never do."""

from __future__ import annotations

from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inscrutable.errors import InputError, ModelError
from inscrutable.filtering import BeliefFilter, filter_beliefs
from inscrutable.worlds import CategoricalEmission, GaussianEmission, HiddenMarkovModel
from sizes import instances


def sparse_rows(rng: np.random.Generator, n_rows: int, n_columns: int) -> np.ndarray:
    """Rows of probabilities, about a third of them zero."""
    rows = rng.dirichlet(np.ones(n_columns), n_rows) * (rng.random((n_rows, n_columns)) > 0.35)
    rows[rows.sum(axis=1) == 0, 0] = 1.0
    return rows / rows.sum(axis=1, keepdims=True)


def random_world(seed: int, n_states: int, gaussian: bool) -> HiddenMarkovModel:
    rng = np.random.default_rng(seed)
    if gaussian:
        roots = rng.normal(size=(n_states, 2, 2)) * rng.uniform(0.3, 3.0)
        covariances = roots @ roots.transpose(0, 2, 1) + 0.2 * np.eye(2)
        emission: Any = GaussianEmission(rng.normal(size=(n_states, 2)), covariances)
    else:
        emission = CategoricalEmission(sparse_rows(rng, n_states, 3))
    return HiddenMarkovModel(sparse_rows(rng, n_states, n_states), emission, sparse_rows(rng, 1, n_states)[0])


def densities(world: HiddenMarkovModel, observations: np.ndarray) -> np.ndarray:
    """p(y_t | x_t = i) by the textbook formula."""
    emission = world.emission
    if isinstance(emission, CategoricalEmission):
        return emission.probabilities.T[observations]
    assert isinstance(emission, GaussianEmission)
    columns = []
    for mean, covariance in zip(emission.means, emission.covariances, strict=True):
        gaps = observations - mean
        squares = np.einsum("td,de,te->t", gaps, np.linalg.inv(covariance), gaps)
        columns.append(np.exp(-0.5 * squares) / np.sqrt(np.linalg.det(2 * np.pi * covariance)))
    return np.stack(columns, axis=1)


def by_enumeration(world: HiddenMarkovModel, observations: np.ndarray, t: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Belief, prediction and likelihood after y_0..t: sums over all X^(t+1) paths."""
    likelihood = densities(world, observations)
    last, after = np.zeros(world.n_states), np.zeros(world.n_states)
    for path in product(range(world.n_states), repeat=t + 1):
        weight = world.initial[path[0]] * likelihood[0, path[0]]
        for k in range(1, t + 1):
            weight *= world.transition[path[k - 1], path[k]] * likelihood[k, path[k]]
        last[path[-1]] += weight
        after += weight * world.transition[path[-1]]
    total = float(last.sum())
    return last / total, after / total, total


@given(st.integers(1, 4), st.integers(1, 6), st.booleans(), st.integers(0, 100_000))
@settings(max_examples=instances(120), deadline=None)
def test_equals_enumeration_of_all_paths(n_states: int, n_steps: int, gaussian: bool, seed: int) -> None:
    world = random_world(seed, n_states, gaussian)
    observations = world.sample(n_steps, rng=np.random.default_rng(seed)).observations
    result = filter_beliefs(world, observations)
    for t in range(n_steps):
        belief, predicted, total = by_enumeration(world, observations, t)
        assert np.abs(result.beliefs[t] - belief).max() <= 1e-12
        assert np.abs(result.predicted[t] - predicted).max() <= 1e-12
    assert abs(result.log_likelihood - np.log(total)) <= 1e-12 * max(1.0, abs(np.log(total)))


@given(st.integers(1, 4), st.integers(2, 30), st.booleans(), st.integers(0, 100_000))
@settings(max_examples=60, deadline=None)
def test_appended_data_never_change_the_past_and_updates_give_the_same_bits(
    n_states: int, n_steps: int, gaussian: bool, seed: int
) -> None:
    world = random_world(seed, n_states, gaussian)
    observations = world.sample(n_steps, rng=np.random.default_rng(seed)).observations
    whole = filter_beliefs(world, observations)
    agent = BeliefFilter(world)
    assert np.array_equal(agent.predicted, world.initial)
    for t in range(n_steps):
        part = filter_beliefs(world, observations[: t + 1])
        assert np.array_equal(part.beliefs, whole.beliefs[: t + 1])
        assert np.array_equal(part.predicted, whole.predicted[: t + 1])
        assert np.array_equal(agent.update(observations[t]), whole.beliefs[t])
        assert np.array_equal(agent.predicted, whole.predicted[t])
        assert agent.log_likelihood == part.log_likelihood


class Table:
    """A sensor that reports log-likelihoods themselves."""

    n_states = 2

    def log_likelihoods(self, observations: Any) -> np.ndarray:
        return np.asarray(observations, dtype=float)

    def sample(self, states: Any, *, rng: np.random.Generator) -> np.ndarray:
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        raise NotImplementedError


class Doubled(Table):
    """A sensor that returns two rows for one observation."""

    def log_likelihoods(self, observations: Any) -> np.ndarray:
        return np.zeros((2, 2))


def test_surprises_of_ten_thousand_orders_cancel_exactly() -> None:
    """Exact with fractions: weights 2^k, so log-likelihoods are k log 2 and the gap is k log 2 >= 1e4."""
    stay, power = Fraction(9, 10), 14_500
    world = HiddenMarkovModel([[0.9, 0.1], [0.1, 0.9]], Table(), [0.5, 0.5])
    steps = [(power, 0), (0, power), (power, 0), (0, 0), (0, power)]
    result = filter_beliefs(world, np.array(steps, dtype=float) * np.log(2.0))
    weights = [Fraction(1, 2), Fraction(1, 2)]
    for t, (first, second) in enumerate(steps):
        if t:
            weights = [stay * weights[0] + (1 - stay) * weights[1], (1 - stay) * weights[0] + stay * weights[1]]
        weights = [weights[0] * 2**first, weights[1] * 2**second]
        total = sum(weights)
        assert result.beliefs[t] == pytest.approx([float(w / total) for w in weights], abs=1e-11)
        assert result.beliefs[t].sum() == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("gap", [1e3, 1e4, 1e6])
def test_the_prior_stands_inside_the_maximum(gap: float) -> None:
    """The state with by far the largest likelihood cannot be reached: its weight is zero, the other's is one."""
    world = HiddenMarkovModel([[1.0, 0.0], [0.5, 0.5]], Table(), [1.0, 0.0])
    result = filter_beliefs(world, [[-gap, 0.0], [-gap, 0.0]])
    assert result.beliefs.tolist() == [[1.0, 0.0], [1.0, 0.0]]
    assert result.log_likelihood == -2 * gap


def test_a_gap_is_not_forgotten_when_the_belief_has_rounded_to_zero() -> None:
    world = HiddenMarkovModel(np.eye(2), Table(), [0.5, 0.5])
    result = filter_beliefs(world, [[0.0, -1e4], [-1e4, 0.0], [0.0, -np.log(3.0)]])
    assert result.beliefs[0].tolist() == [1.0, 0.0]
    assert result.beliefs[1] == pytest.approx([0.5, 0.5], abs=1e-12)
    assert result.beliefs[2] == pytest.approx([0.75, 0.25], abs=1e-11)


def test_a_surprising_return_gives_a_belief_not_zeros() -> None:
    emission = GaussianEmission([[0.0], [1.0]], [[[1e-4]], [[1e-4]]])
    world = HiddenMarkovModel([[0.9, 0.1], [0.1, 0.9]], emission)
    result = filter_beliefs(world, [0.0, 60.0, -60.0])
    assert result.beliefs.round(12).tolist() == [[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]]
    assert np.isfinite(result.log_likelihood)


def test_long_records_keep_their_sum() -> None:
    world = random_world(5, 3, True)
    result = filter_beliefs(world, world.sample(20_000, rng=np.random.default_rng(0)).observations)
    assert np.abs(result.beliefs.sum(axis=1) - 1).max() < 1e-14
    assert np.abs(result.predicted.sum(axis=1) - 1).max() < 1e-13


class TestImpossible:
    world = HiddenMarkovModel([[1.0, 0.0], [0.0, 1.0]], CategoricalEmission(np.eye(2)), [1.0, 0.0])

    def test_the_step_is_named(self) -> None:
        with pytest.raises(ModelError, match="step 2 has likelihood zero in every state that can be reached"):
            filter_beliefs(self.world, [0, 0, 1, 0])
        with pytest.raises(ModelError, match=r"step 1 \(Feb\)"):
            filter_beliefs(self.world, pd.Series([0, 1], index=["Jan", "Feb"]))

    def test_rows_of_unequal_lengths_are_refused(self) -> None:
        for ragged in ([0, [1]], [[0], [1, 0]]):
            with pytest.raises(InputError, match="observations must be numbers"):
                filter_beliefs(self.world, ragged)

    def test_the_filter_stays_as_it_was(self) -> None:
        agent = BeliefFilter(self.world)
        agent.update(0)
        with pytest.raises(ModelError, match="step 1"):
            agent.update(1)
        with pytest.raises(InputError, match="symbols"):
            agent.update(7)
        assert agent.update(0).tolist() == [1.0, 0.0]
        assert agent.log_likelihood == 0.0


class TestLabels:
    emission = GaussianEmission([[0.0, 0.0], [1.0, 2.0]], [np.eye(2), 2 * np.eye(2)], asset_names=["A", "B"])
    world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], emission, names=["calm", "wild"])
    frame = pd.DataFrame({"B": [2.0, 0.1], "A": [0.9, 0.0]}, index=pd.period_range("2020-01", periods=2, freq="M"))

    def test_dates_that_go_back_are_refused(self) -> None:
        with pytest.raises(InputError, match="observations must be in the order of time: after 2020-02 comes 2020-01"):
            filter_beliefs(self.world, self.frame[::-1])
        numbered = self.frame[::-1].reset_index(drop=True)
        assert filter_beliefs(self.world, numbered[::-1]).beliefs.shape == (2, 2)

    def test_pandas_in_pandas_out(self) -> None:
        result = filter_beliefs(self.world, self.frame)
        plain = filter_beliefs(self.world, self.frame[["A", "B"]].to_numpy())
        assert isinstance(plain.beliefs, np.ndarray)
        for table, array in ((result.beliefs, plain.beliefs), (result.predicted, plain.predicted)):
            assert list(table.columns) == ["calm", "wild"]
            assert table.index.equals(self.frame.index)
            assert np.array_equal(table.to_numpy(), array)
        assert result.log_likelihood == plain.log_likelihood

    def test_labels_that_are_numbers_are_labels_where_assets_are_known_by_such(self) -> None:
        rows = self.frame.to_numpy()[:, [1, 0, 0]]
        emission = GaussianEmission([[0.0, 0.0, 0.0], [1.0, 2.0, 2.5]], [np.eye(3), np.eye(3)], asset_names=[2, 0, 1])
        world = HiddenMarkovModel(self.world.transition, emission)
        given = filter_beliefs(world, rows).beliefs
        frame = pd.DataFrame(rows, columns=[2, 0, 1])
        assert np.array_equal(filter_beliefs(world, frame[[0, 1, 2]]).beliefs, given)
        five = GaussianEmission(emission.means, emission.covariances, asset_names=[2, 0, 5])
        with pytest.raises(InputError, match="missing: 5; not expected: 1"):
            filter_beliefs(HiddenMarkovModel(self.world.transition, five), frame[[0, 1, 2]])

    def test_a_labelled_row_is_aligned(self) -> None:
        agent = BeliefFilter(self.world)
        expected = filter_beliefs(self.world, self.frame).beliefs
        for label, row in self.frame.iterrows():
            assert np.array_equal(agent.update(row), expected.loc[label])

    def test_a_frame_of_one_row_is_an_observation_and_one_of_more_is_not(self) -> None:
        agent = BeliefFilter(self.world)
        expected = filter_beliefs(self.world, self.frame).beliefs
        with pytest.raises(InputError, match="one observation, got 2"):
            agent.update(self.frame)
        with pytest.raises(InputError, match="T >= 1"):
            agent.update(self.frame.iloc[:0])
        for t in range(2):
            assert np.array_equal(agent.update(self.frame.iloc[[t]]), expected.iloc[t])


def test_one_dimension_takes_plain_numbers() -> None:
    world = HiddenMarkovModel([[0.5, 0.5], [0.5, 0.5]], GaussianEmission([[0.0], [1.0]], np.ones((2, 1, 1))))
    result = filter_beliefs(world, [0.3, 0.9])
    agent = BeliefFilter(world)
    assert np.array_equal([agent.update(0.3), agent.update([0.9])], result.beliefs)


def test_an_observation_too_far_from_every_state_is_named() -> None:
    world = HiddenMarkovModel([[0.5, 0.5], [0.5, 0.5]], GaussianEmission([[0.0], [1.0]], np.ones((2, 1, 1))))
    with pytest.raises(ModelError, match=r"observation at step 1 .* too far from all of them"):
        filter_beliefs(world, [0.3, 1e160])


def test_a_broken_sensor_is_caught() -> None:
    world = HiddenMarkovModel(np.eye(2), Table(), [0.5, 0.5])
    with pytest.raises(InputError, match=r"at step 1 is nan in state 0"):
        filter_beliefs(world, [[0.0, 0.0], [np.nan, 0.0]])
    with pytest.raises(InputError, match=r"shape \(1, 3\), expected \(T,2\)"):
        filter_beliefs(world, [[0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match="one observation, got 2"):
        BeliefFilter(HiddenMarkovModel(np.eye(2), Doubled(), [0.5, 0.5])).update([0.0, 0.0])


def test_what_is_no_world_is_refused() -> None:
    for call in (lambda: BeliefFilter(np.eye(2)), lambda: filter_beliefs(np.eye(2), [0])):
        with pytest.raises(InputError, match="world must be a HiddenMarkovModel"):
            call()
