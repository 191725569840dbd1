"""Worlds: what they refuse, their stationary law, how they are sampled, saved and restored."""

from __future__ import annotations

import json

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chisquare, multivariate_normal

from inscrutable.errors import InputError, ModelError
from inscrutable.worlds import CategoricalEmission, GaussianEmission, HiddenMarkovModel


def sensor(n_states: int) -> CategoricalEmission:
    return CategoricalEmission(np.full((n_states, 2), 0.5))


def gaussian_world(seed: int, n_states: int = 3, n_dims: int = 2) -> HiddenMarkovModel:
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(n_states, n_dims, n_dims))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(n_dims)
    emission = GaussianEmission(rng.normal(size=(n_states, n_dims)), covariances)
    return HiddenMarkovModel(rng.dirichlet(np.ones(n_states), n_states), emission)


class TestRefused:
    def test_row_that_does_not_sum_to_one_is_named_with_its_sum(self) -> None:
        with pytest.raises(InputError, match=r"transition row 1 sums to 0\.9"):
            HiddenMarkovModel([[0.5, 0.5], [0.3, 0.6]], sensor(2))
        with pytest.raises(InputError, match=r"probabilities row 0 sums to 1\.1"):
            CategoricalEmission([[0.6, 0.5]])

    @pytest.mark.parametrize(
        ("transition", "initial", "names", "message"),
        [
            ([[0.5, 0.5]], None, None, "square"),
            ([[1.5, -0.5], [0.5, 0.5]], None, None, r"-0\.5 at index \[0, 1\]"),
            ([[np.nan, 1.0], [0.5, 0.5]], None, None, r"nan at index \[0, 0\]"),
            ([[0.5, 0.5], [0.5, 0.5]], [1.0], None, "one per state: 2"),
            ([[0.5, 0.5], [0.5, 0.5]], [0.7, 0.7], None, r"initial sums to 1\.4"),
            ([[0.5, 0.5], [0.5, 0.5]], None, ["up", "up"], "2 different labels"),
            ([[0.5, 0.5], [0.5, 0.5]], None, "ab", "sequence of strings"),
            (np.full((3, 3), 1 / 3), None, None, "emission has 2 states, transition has 3"),
        ],
    )
    def test_malformed_worlds(self, transition: object, initial: object, names: object, message: str) -> None:
        with pytest.raises(InputError, match=message):
            HiddenMarkovModel(transition, sensor(2), initial, names=names)  # type: ignore[arg-type]

    def test_a_sensor_must_be_one(self) -> None:
        with pytest.raises(InputError, match="must be an Emission"):
            HiddenMarkovModel([[1.0]], "Gaussian")  # type: ignore[arg-type]

    @pytest.mark.parametrize(
        ("covariance", "words"),
        [
            ([[1.0, 2.0], [2.0, 1.0]], r"indefinite: smallest eigenvalue -1, condition number 3"),
            ([[1.0, 1.0], [1.0, 1.0]], "singular: smallest eigenvalue .* condition number"),
            ([[1.0, 0.0], [0.0, 0.0]], "singular: smallest eigenvalue 0, condition number inf"),
        ],
    )
    def test_covariance_without_a_density(self, covariance: list[list[float]], words: str) -> None:
        with pytest.raises(ModelError, match=rf"covariances\[1\] is {words}"):
            GaussianEmission(np.zeros((2, 2)), [np.eye(2), covariance])

    def test_units_do_not_decide_what_is_singular(self) -> None:
        emission = GaussianEmission([[0.0, 0.0]], [np.diag([1e-14, 1e10])])
        assert np.isfinite(emission.log_likelihoods([[0.0, 0.0]])).all()

    def test_asymmetric_covariance_and_wrong_shapes(self) -> None:
        with pytest.raises(InputError, match=r"not symmetric: 0\.5 at \[0, 1\], 0\.4 at \[1, 0\]"):
            GaussianEmission([[0.0, 0.0]], [[[1.0, 0.5], [0.4, 1.0]]])
        with pytest.raises(InputError, match=r"expected \(X,D,D\) = \(1, 2, 2\)"):
            GaussianEmission([[0.0, 0.0]], np.ones((2, 2, 2)) + np.eye(2))
        with pytest.raises(InputError, match="square"):
            GaussianEmission([[0.0, 0.0]], np.ones((1, 2, 3)))

    def test_observations_that_are_no_symbols(self) -> None:
        for bad, shown in ((2, "2"), (-1, "-1"), (0.5, "0.5"), (np.nan, "nan")):
            with pytest.raises(InputError, match=rf"have {shown} in row 1; symbols are whole numbers from 0 to 1"):
                sensor(2).log_likelihoods([0, bad])
        with pytest.raises(InputError, match="T >= 1"):
            sensor(2).log_likelihoods([])

    def test_observations_that_are_no_vectors(self) -> None:
        emission = GaussianEmission(np.zeros((1, 2)), [np.eye(2)], asset_names=["A", "B"])
        with pytest.raises(InputError, match=r"nan in row 1, column 0; .* \(1 are not\)"):
            emission.log_likelihoods([[0.0, 0.0], [np.nan, 0.0]])
        frame = pd.DataFrame({"A": [0.0, 1.0], "B": [0.0, np.inf]}, index=["Jan", "Feb"])
        with pytest.raises(InputError, match=r"inf in row 1 \(Feb\), column 1 \(B\)"):
            emission.log_likelihoods(frame)
        with pytest.raises(InputError, match="have 3 columns, expected one per dimension: 2"):
            emission.log_likelihoods(np.zeros((4, 3)))
        with pytest.raises(InputError, match="must be numbers"):
            emission.log_likelihoods([["a", "b"]])

    def test_sampling_needs_a_generator_and_a_length(self) -> None:
        world = gaussian_world(0)
        with pytest.raises(InputError, match="n_steps"):
            world.sample(0, rng=np.random.default_rng(0))
        with pytest.raises(InputError, match=r"numpy\.random\.Generator"):
            world.sample(3, rng=0)  # type: ignore[arg-type]

    def test_a_sensor_takes_its_generator_by_name(self) -> None:
        for emission in (sensor(2), gaussian_world(0).emission):
            with pytest.raises(TypeError, match="positional"):
                emission.sample([0, 1], np.random.default_rng(0))  # type: ignore[misc]
            assert len(emission.sample([0, 1], rng=np.random.default_rng(0))) == 2


class TestStationaryLaw:
    @given(st.integers(1, 7), st.integers(0, 10_000), st.floats(0.0, 0.7))
    @settings(max_examples=60, deadline=None)
    def test_it_stays_as_it_is_and_where_the_chain_settles(self, n_states: int, seed: int, sparsity: float) -> None:
        rng = np.random.default_rng(seed)
        transition = rng.dirichlet(np.ones(n_states), n_states) * (rng.random((n_states, n_states)) > sparsity)
        transition[:, 0] += 0.05  # one closed class: state 0 can be reached from everywhere
        transition /= transition.sum(axis=1, keepdims=True)
        law = HiddenMarkovModel(transition, sensor(n_states)).initial
        assert law.sum() == pytest.approx(1.0, abs=1e-14)
        assert np.abs(law @ transition - law).max() < 1e-14
        assert np.abs(np.linalg.matrix_power(transition, 4096) - law).max() < 1e-9

    def test_rare_switches_keep_every_digit(self) -> None:
        away, back = 1e-13, 3e-13
        law = HiddenMarkovModel([[1 - away, away], [back, 1 - back]], sensor(2)).initial
        assert law == pytest.approx([0.75, 0.25], rel=1e-12)

    def test_periodic_and_transient_chains_have_one(self) -> None:
        assert HiddenMarkovModel([[0.0, 1.0], [1.0, 0.0]], sensor(2)).initial.tolist() == [0.5, 0.5]
        assert HiddenMarkovModel([[0.5, 0.5], [0.0, 1.0]], sensor(2)).initial.tolist() == [0.0, 1.0]

    def test_two_closed_classes_have_none(self) -> None:
        transition = [[1.0, 0.0, 0.0, 0.0], [0.2, 0.3, 0.5, 0.0], [0.0, 0.0, 0.5, 0.5], [0.0, 0.0, 1.0, 0.0]]
        with pytest.raises(ModelError, match=r"not unique.* \[0\] and \[2, 3\]; give `initial`"):
            HiddenMarkovModel(transition, sensor(4))
        assert HiddenMarkovModel(transition, sensor(4), [0, 1, 0, 0]).initial.tolist() == [0, 1, 0, 0]


class TestSensors:
    def test_categorical_is_the_table(self) -> None:
        table = [[0.5, 0.25, 0.25], [0.0, 0.5, 0.5]]
        found = CategoricalEmission(table).log_likelihoods(pd.Series([0.0, 2.0, 1.0]))
        with np.errstate(divide="ignore"):
            assert np.array_equal(found, np.log(np.array(table).T[[0, 2, 1]]))

    @pytest.mark.parametrize("n_dims", [1, 2, 5])
    def test_gaussian_is_the_density(self, n_dims: int) -> None:
        emission = gaussian_world(n_dims, n_dims=n_dims).emission
        assert isinstance(emission, GaussianEmission)
        rows = np.random.default_rng(1).normal(size=(7, n_dims), scale=3.0)
        expected = np.stack(
            [multivariate_normal(m, c).logpdf(rows) for m, c in zip(emission.means, emission.covariances, strict=True)],
            -1,
        )
        assert emission.log_likelihoods(rows) == pytest.approx(expected, rel=1e-12)
        if n_dims == 1:
            assert np.array_equal(emission.log_likelihoods(rows[:, 0]), emission.log_likelihoods(rows))

    def test_an_observation_beyond_floating_point_is_impossible_not_nan(self) -> None:
        emission = gaussian_world(0, n_dims=3).emission
        assert np.isneginf(emission.log_likelihoods([[1e300, -1e300, 1e300]])).all()

    def test_columns_are_aligned_by_label(self) -> None:
        emission = GaussianEmission([[0.0, 5.0]], [np.diag([1.0, 2.0])], asset_names=["A", "B"])
        right = pd.DataFrame({"A": [0.1, 0.2], "B": [5.0, 4.0]})
        shuffled = right.assign(C=1.0)[["C", "B", "A"]]
        assert np.array_equal(emission.log_likelihoods(shuffled), emission.log_likelihoods(right.to_numpy()))
        with pytest.raises(InputError, match=r"expected, A, B; missing: B; not expected: C"):
            emission.log_likelihoods(right.rename(columns={"B": "C"}))
        with pytest.raises(InputError, match="column 'A' 2 times"):
            emission.log_likelihoods(right.set_axis(["A", "A"], axis=1))
        with pytest.raises(InputError, match="asset_names has 1 labels"):
            GaussianEmission([[0.0, 5.0]], [np.eye(2)], asset_names=["A"])


class TestSampling:
    def test_frequencies_are_those_of_the_model(self) -> None:
        table = np.array([[0.7, 0.2, 0.1], [0.1, 0.0, 0.9]])
        world = HiddenMarkovModel([[0.8, 0.2], [0.6, 0.4]], CategoricalEmission(table))
        path = world.sample(40_000, rng=np.random.default_rng(7))
        pairs = np.zeros((2, 2))
        np.add.at(pairs, (path.states[:-1], path.states[1:]), 1)
        for state in range(2):
            row = pairs[state]
            assert chisquare(row, row.sum() * world.transition[state]).pvalue > 1e-3
            seen = np.bincount(path.observations[path.states == state], minlength=3)
            possible = table[state] > 0
            assert seen[~possible].sum() == 0
            assert chisquare(seen[possible], seen.sum() * table[state][possible]).pvalue > 1e-3

    def test_the_first_state_has_the_initial_law(self) -> None:
        world = HiddenMarkovModel(np.full((3, 3), 1 / 3), sensor(3), [0.2, 0.0, 0.8])
        rng = np.random.default_rng(3)
        first = np.bincount([world.sample(1, rng=rng).states[0] for _ in range(4000)], minlength=3)
        assert first[1] == 0
        assert chisquare(first[[0, 2]], [800, 3200]).pvalue > 1e-3

    def test_gaussian_moments(self) -> None:
        world = gaussian_world(11)
        emission = world.emission
        assert isinstance(emission, GaussianEmission)
        path = world.sample(60_000, rng=np.random.default_rng(0))
        for state in range(3):
            rows = path.observations[path.states == state]
            error = 6 * np.sqrt(np.trace(emission.covariances[state]) / len(rows))
            assert np.abs(rows.mean(axis=0) - emission.means[state]).max() < error
            expected = emission.covariances[state]
            error = 6 * np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / len(rows))
            assert (np.abs(np.cov(rows.T) - expected) < error).all()

    def test_same_seed_same_path(self) -> None:
        one, two = (gaussian_world(2).sample(50, rng=np.random.default_rng(9)) for _ in range(2))
        assert np.array_equal(one.states, two.states)
        assert np.array_equal(one.observations, two.observations)
        assert one.observations.shape == (50, 2)

    @pytest.mark.parametrize("n_dims", [1, 2, 7])
    def test_the_order_of_columns_changes_no_draw(self, n_dims: int) -> None:
        emission = gaussian_world(5, n_dims=n_dims).emission
        assert isinstance(emission, GaussianEmission)
        order = np.arange(n_dims)[::-1]
        other = GaussianEmission(emission.means[:, order], emission.covariances[:, order][:, :, order])
        states = np.arange(60) % 3
        drawn, again = (each.sample(states, rng=np.random.default_rng(1)) for each in (emission, other))
        np.testing.assert_allclose(again, drawn[:, order], rtol=0, atol=1e-12)


class TestKept:
    @pytest.mark.parametrize("seed", range(20))
    def test_json_restores_every_digit(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        categorical = HiddenMarkovModel(
            rng.dirichlet(np.ones(5), 5), CategoricalEmission(rng.dirichlet(np.ones(3), 5)), names=list("abcde")
        )
        for world in (categorical, gaussian_world(seed, n_states=5)):
            back = HiddenMarkovModel.from_dict(json.loads(json.dumps(world.to_dict(), allow_nan=False)))
            assert back.to_dict() == world.to_dict()
            assert np.array_equal(back.transition, world.transition)
            assert np.array_equal(back.initial, world.initial)
            path = world.sample(5, rng=np.random.default_rng(0))
            expected = world.emission.log_likelihoods(path.observations)
            assert np.array_equal(back.emission.log_likelihoods(path.observations), expected)

    def test_asset_names_are_kept(self) -> None:
        emission = GaussianEmission([[0.0, 5.0]], [np.eye(2)], asset_names=["A", "B"])
        data = json.loads(json.dumps(HiddenMarkovModel([[1.0]], emission).to_dict()))
        restored = HiddenMarkovModel.from_dict(data).emission
        assert isinstance(restored, GaussianEmission)
        assert restored.asset_names == ("A", "B")

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"transition": None}, "must be"),
            ({"emission": {"type": "poisson"}}, "'categorical' or 'gaussian', got 'poisson'"),
            ({"emission": {"type": "gaussian", "means": [[0.0]]}}, "needs the key 'covariances'"),
            ({"emission": 3}, "got None"),
        ],
    )
    def test_a_broken_file_is_refused(self, change: dict[str, object], message: str) -> None:
        with pytest.raises(InputError, match=message):
            HiddenMarkovModel.from_dict({**gaussian_world(0).to_dict(), **change})

    def test_missing_keys_are_listed(self) -> None:
        with pytest.raises(InputError, match=r"missing: \['emission', 'names'\]"):
            HiddenMarkovModel.from_dict({"transition": [[1.0]], "initial": [1.0]})

    def test_a_world_does_not_change(self) -> None:
        world = gaussian_world(0)
        with pytest.raises(ValueError, match="read-only"):
            world.transition[0, 0] = 1.0
        with pytest.raises(AttributeError):
            world.initial = np.ones(3)  # type: ignore[misc]
        given_rows = np.array([[0.5, 0.5], [0.5, 0.5]])
        HiddenMarkovModel(given_rows, sensor(2))
        given_rows[0] = [1.0, 0.0]  # the caller's array stays the caller's

    def test_names(self) -> None:
        assert gaussian_world(0).names == ("regime 1", "regime 2", "regime 3")
        assert repr(gaussian_world(0)) == "HiddenMarkovModel(3 states, GaussianEmission(3 states, 2 dimensions))"
