"""Baum-Welch: what it must find, what it may never return, and whether other code agrees with its likelihood."""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from inscrutable import tolerances
from inscrutable.errors import InputError, ModelError
from inscrutable.filtering import filter_beliefs
from inscrutable.worlds import FittedWorld, GaussianEmission, HiddenMarkovModel, fit_gaussian_hmm
from inscrutable.worlds.baum_welch import Climb, standardised
from inscrutable.worlds.covariances import SampleCovariance
from sizes import instances

MEANS = np.array([[0.01, 0.02], [0.0, -0.01], [-0.05, 0.03]])
COVARIANCES = np.array([0.01**2 * np.eye(2), 0.04**2 * np.array([[1.0, 0.5], [0.5, 1.0]]), 0.15**2 * np.eye(2)])
TRANSITION = np.array([[0.95, 0.04, 0.01], [0.05, 0.90, 0.05], [0.02, 0.08, 0.90]])
WORLD = HiddenMarkovModel(TRANSITION, GaussianEmission(MEANS, COVARIANCES))
PATH = WORLD.sample(4000, rng=np.random.default_rng(42))


def fit(observations: object, n_states: int, seed: int = 0, n_restarts: int = 10) -> FittedWorld:
    """With full covariances, which alone maximise the likelihood."""
    rng = np.random.default_rng(seed)
    return fit_gaussian_hmm(observations, n_states, rng=rng, n_restarts=n_restarts, covariance="sample")


@pytest.fixture(scope="module")
def fitted() -> FittedWorld:
    return fit(PATH.observations, 3, n_restarts=3)


def gaussian(fitted: FittedWorld) -> GaussianEmission:
    assert isinstance(fitted.world.emission, GaussianEmission)
    return fitted.world.emission


def assert_a_world(fitted: FittedWorld) -> None:
    """Finite, ordered by volatility, and with likelihoods that never fell."""
    emission = gaussian(fitted)
    for array in (fitted.world.transition, fitted.world.initial, emission.means, emission.covariances):
        assert np.isfinite(array).all()
    volatility = np.trace(emission.covariances, axis1=1, axis2=2)
    assert (np.diff(volatility) >= -1e-12 * volatility[-1]).all()
    assert np.isfinite(fitted.log_likelihood)
    for row in fitted.restarts:
        assert len(row.trace) == row.n_iterations
        assert row.log_likelihood == row.trace[-1]
        assert (np.diff(row.trace) >= -1e-9 * (1 + np.abs(row.trace[-1]))).all()


class TestRefused:
    def test_missing_entry_is_named(self) -> None:
        frame = pd.DataFrame({"A": [0.1, 0.2, 0.3], "B": [0.1, np.nan, 0.3]}, index=["Jan", "Feb", "Mar"])
        with pytest.raises(InputError, match=r"nan in row 1 \(Feb\), column 1 \(B\)"):
            fit(frame, 2)

    def test_more_regimes_than_observations(self) -> None:
        with pytest.raises(InputError, match="n_states is 4, but there are only 3 different observations"):
            fit([1.0, 2.0, 3.0, 3.0, 3.0], 4)

    def test_nothing_varies(self) -> None:
        with pytest.raises(ModelError, match="all 9 observations are equal"):
            fit(np.full((9, 2), 0.1), 1)

    def test_arguments(self) -> None:
        rows = np.arange(9.0)
        for n_states, n_restarts, word in ((0, 1, "n_states"), (2.5, 1, "n_states"), (2, 0, "n_restarts")):
            with pytest.raises(InputError, match=word):
                fit(rows, n_states, n_restarts=n_restarts)  # type: ignore[arg-type]
        with pytest.raises(InputError, match="Generator"):
            fit_gaussian_hmm(rows, 2, rng=1)  # type: ignore[arg-type]
        with pytest.raises(InputError, match="got shape"):
            fit(np.zeros((2, 2, 2)), 1)


class TestSeparatedWorld:
    path = PATH

    def test_it_is_recovered(self, fitted: FittedWorld) -> None:
        assert_a_world(fitted)
        pairs = np.zeros((3, 3))
        np.add.at(pairs, (self.path.states[:-1], self.path.states[1:]), 1)
        assert np.abs(fitted.world.transition - pairs / pairs.sum(axis=1, keepdims=True)).max() < 0.015
        for state in range(3):
            count = (self.path.states == state).sum()
            deviation = np.sqrt(np.trace(COVARIANCES[state]))
            assert np.abs(gaussian(fitted).means[state] - MEANS[state]).max() < 5 * deviation / np.sqrt(count)
            error = gaussian(fitted).covariances[state] - COVARIANCES[state]
            assert np.abs(error).max() < 8 * deviation**2 / np.sqrt(count)
        named = filter_beliefs(fitted.world, self.path.observations).beliefs.argmax(axis=1)
        assert (named == self.path.states).mean() > 0.93

    def test_it_is_more_likely_than_the_truth(self, fitted: FittedWorld) -> None:
        assert fitted.log_likelihood > filter_beliefs(WORLD, self.path.observations).log_likelihood

    def test_its_likelihood_is_the_filters(self, fitted: FittedWorld) -> None:
        assert fitted.log_likelihood == filter_beliefs(fitted.world, self.path.observations).log_likelihood
        assert fitted.log_likelihood == pytest.approx(max(row.log_likelihood for row in fitted.restarts), rel=1e-12)

    def test_every_seed_finds_it(self, fitted: FittedWorld) -> None:
        short = self.path.observations[:800]
        found = [fit(short, 3, seed, n_restarts=3) for seed in range(instances(5, least=2))]
        assert np.ptp([each.log_likelihood for each in found]) < 1e-3
        for each in found[1:]:
            assert gaussian(each).means == pytest.approx(gaussian(found[0]).means, abs=1e-4)
            assert each.world.transition == pytest.approx(found[0].world.transition, abs=1e-3)

    def test_it_is_stationary_under_another_implementation(self, fitted: FittedWorld) -> None:
        """No small change of the means or transition is more likely: a maximum by finite differences."""
        rows, emission = self.path.observations, gaussian(fitted)
        for state in range(3):
            for step in (-1e-3, 1e-3):
                means = emission.means.copy()
                means[state] += step * np.sqrt(np.diag(emission.covariances[state]))
                moved = GaussianEmission(means, emission.covariances)
                world = HiddenMarkovModel(fitted.world.transition, moved, fitted.world.initial)
                assert filter_beliefs(world, rows).log_likelihood < fitted.log_likelihood + 1e-3
                turned = fitted.world.transition.copy()
                turned[state] = turned[state] * (1 + step) / (turned[state] * (1 + step)).sum()
                turned[state, state] += step
                turned[state, (state + 1) % 3] -= step
                world = HiddenMarkovModel(turned, emission, fitted.world.initial)
                assert filter_beliefs(world, rows).log_likelihood < fitted.log_likelihood + 1e-3

    def test_same_seed_same_bits(self) -> None:
        one, two = (fit(self.path.observations[:300], 3, seed=5, n_restarts=2) for _ in range(2))
        assert one.world.to_dict() == two.world.to_dict()
        assert one.restarts == two.restarts


def test_one_regime_is_the_sample_mean_and_covariance() -> None:
    rows = np.random.default_rng(0).normal(size=(50, 3)) @ np.diag([1.0, 1e-2, 1e2]) + 7
    fitted = fit(rows, 1, n_restarts=1)
    covariance = np.cov(rows.T, bias=True)
    assert gaussian(fitted).means[0] == pytest.approx(rows.mean(axis=0), rel=1e-12)
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    assert gaussian(fitted).covariances[0] / scale == pytest.approx(covariance / scale, abs=1e-12)
    assert fitted.log_likelihood == pytest.approx(
        multivariate_normal(rows.mean(axis=0), covariance).logpdf(rows).sum(), rel=1e-10
    )
    assert fitted.restarts[0].note == ""


def test_units_change_nothing_but_units() -> None:
    rows = WORLD.sample(250, rng=np.random.default_rng(1)).observations
    units = np.array([1024.0, 2.0**-12])  # powers of two: the same bits after scaling
    plain, scaled = fit(rows, 2, n_restarts=2), fit(rows * units, 2, n_restarts=2)
    assert scaled.world.transition == pytest.approx(plain.world.transition, abs=1e-9)
    assert gaussian(scaled).means / units == pytest.approx(gaussian(plain).means, abs=1e-9)
    shift = len(rows) * np.log(units).sum()
    assert scaled.log_likelihood == pytest.approx(plain.log_likelihood - shift, rel=1e-9)


@pytest.mark.parametrize("size", [1e155, 1.7e308, 1e-155, 1e-170])
def test_observations_whose_variance_is_no_number_are_refused_by_column(size: float) -> None:
    """They ended in errors of the linear algebra, such as "Probabilities contain NaN"."""
    rows = np.random.default_rng(0).normal(size=(60, 2))
    rows[:, 1] *= min(size, 1.0)
    rows[-1, 1] = size
    with pytest.raises(InputError, match=r"column 1 \(Oil\) .* missing values, or use another unit"):
        fit(pd.DataFrame(rows, columns=["Gas", "Oil"]), 2, n_restarts=1)
    with pytest.raises(InputError, match="column 0 "):
        fit(rows[:, 1], 2, n_restarts=1)
    assert_a_world(fit(np.column_stack([rows[:, 0], np.full(60, 1e200)]), 1, n_restarts=1))  # a constant needs none


def test_a_doubted_fit_advises_what_can_help() -> None:
    advised = [fit(rows, n, n_restarts=1).doubt for rows, n in (([1.0, 2.0], 1), (np.eye(4), 1), (np.arange(9.0), 2))]
    assert advised[0].endswith("columns. Use more rows")
    assert advised[1].endswith("Use shrunk covariances (ledoit-wolf or factor:K), fewer columns, or more rows")
    assert advised[2].endswith("Use fewer regimes, or more rows")


def test_labels_are_kept() -> None:
    rows = WORLD.sample(60, rng=np.random.default_rng(1)).observations
    frame = pd.DataFrame(rows, columns=["Food", "Steel"], index=pd.period_range("2000-01", periods=60, freq="M"))
    fitted = fit(frame, 2, n_restarts=2)
    assert fitted.asset_names == ("Food", "Steel")
    assert filter_beliefs(fitted.world, frame[["Steel", "Food"]]).log_likelihood == fitted.log_likelihood
    assert fit(rows, 2, n_restarts=2).asset_names is None
    assert fit(frame["Food"], 2, n_restarts=2).asset_names == ("Food",)


class TestCollapse:
    def test_a_regime_on_one_outlier_is_reported(self) -> None:
        fitted = fit(np.append(np.random.default_rng(2).normal(size=200), 1e3), 2)
        assert_a_world(fitted)
        assert {(row.collapsed, row.note) for row in fitted.restarts} == {
            ((0,), "regime 1 collapsed on 1.0 observations")
        }
        assert fitted.summary().count("regime 1 collapsed on 1.0 observations") == 10

    @pytest.mark.parametrize("column", [None, "constant", "copied"])
    def test_a_regime_on_equal_rows_is_reported_beside_columns_that_say_nothing(self, column: str | None) -> None:
        rows = np.random.default_rng(0).normal(size=(200, 2))
        rows[50:65] = 0.0
        more = {"constant": [np.ones(200)], "copied": [rows[:, 0]], None: []}[column]
        found = fit(np.column_stack([rows, *more]), 2, seed=1, n_restarts=4)
        assert "the fit collapsed in each of 4 starts" in found.doubt

    def test_a_sound_world_wins_though_a_collapsed_one_is_more_likely(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Two periods and, between them, six equal returns: a regime on those six is as likely as its floor allows."""
        rng = np.random.default_rng(3)
        rows = np.concatenate([rng.normal(size=60), 1 + 2 * rng.normal(size=60)])
        rows[60:66] = 0.5
        data = standardised(rows[:, None])
        knot = Climb(data, np.eye(2)[(rows == 0.5).astype(int)], SampleCovariance())
        sound = Climb(data, np.eye(2)[(np.arange(120) >= 60).astype(int)], SampleCovariance())
        for climb in (knot, sound):
            climb.run(500)
            climb.order_by_volatility()
        assert knot.collapsed() == (0,)
        assert 6 <= round(knot.weights[0]) <= 7
        assert sound.collapsed() == ()
        assert knot.trace[-1] > sound.trace[-1] + 1
        in_turn = iter([knot, sound, knot])
        monkeypatch.setattr("inscrutable.worlds.gaussian_fit._restart", lambda *_: next(in_turn))
        fitted = fit(rows, 2, n_restarts=3)
        assert [row.collapsed for row in fitted.restarts] == [(0,), (), (0,)]
        assert fitted.log_likelihood == pytest.approx(fitted.restarts[1].log_likelihood, rel=1e-12)
        assert fitted.summary().splitlines()[1].split()[0] == f"{fitted.log_likelihood:.4f}"

    def test_a_state_without_data_keeps_its_parameters(self) -> None:
        rows = np.random.default_rng(0).normal(size=(20, 2))
        empty = Climb(standardised(rows), np.tile([1.0, 0.0], (20, 1)), SampleCovariance())
        empty.run(20)
        assert np.isfinite(empty.trace).all()
        assert np.isfinite(empty.parameters.means).all()
        assert empty.weights.sum() == pytest.approx(20)

    def test_the_floor_holds_in_every_direction(self) -> None:
        rows = np.random.default_rng(4).normal(size=(12, 6))
        fitted = fit(rows, 4, n_restarts=3)
        assert_a_world(fitted)
        assert all(row.collapsed for row in fitted.restarts)
        scaled = gaussian(fitted).covariances / np.outer(rows.std(axis=0), rows.std(axis=0))
        assert np.linalg.eigvalsh(scaled).min() > 0.99 * tolerances.COVARIANCE_FLOOR

    def test_stopping_early_is_said(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("inscrutable.worlds.gaussian_fit.MAX_ITERATIONS", 30)
        rows = np.random.default_rng(4).normal(size=(300, 2))
        row = fit(rows, 3, n_restarts=1).restarts[0]
        assert (row.converged, row.n_iterations, row.note) == (False, 30, "still improving after 30 iterations")


def few_rows() -> np.ndarray:
    return np.asarray(WORLD.sample(200, rng=np.random.default_rng(6)).observations)


@cache
def fitted_alone() -> FittedWorld:
    """Of the few rows as they are, which is held beside those of several with a column more."""
    return fit(few_rows(), 3, n_restarts=3)


class TestDegenerate:
    @pytest.mark.parametrize("column", ["constant", "duplicated", "nearly constant", "sum of the others"])
    def test_columns(self, column: str) -> None:
        rows = few_rows()
        extra = {
            "constant": np.full(200, 0.1),
            "duplicated": rows[:, 0],
            "nearly constant": np.where(np.arange(200) == 7, 1.0 + 1e-7, 1.0),
            "sum of the others": rows.sum(axis=1),
        }[column]
        fitted = fit(np.column_stack([rows, extra]), 3, n_restarts=3)
        assert_a_world(fitted)
        if column != "nearly constant":
            assert fitted.world.transition == pytest.approx(fitted_alone().world.transition, abs=1e-2)

    def test_two_observations(self) -> None:
        assert_a_world(fit([0.0, 1.0], 2, n_restarts=2))

    def test_repeated_values(self) -> None:
        rows = np.repeat([0.0, 1.0, 0.0, 5.0], 20)
        fitted = fit(rows, 3, n_restarts=4)
        assert_a_world(fitted)
        assert sorted(gaussian(fitted).means[:, 0]) == pytest.approx([0.0, 1.0, 5.0], abs=1e-6)

    @given(st.integers(0, 10_000), st.integers(1, 4), st.integers(1, 4), st.floats(-6, 6))
    @settings(max_examples=instances(25), deadline=None)
    def test_never_nan(self, seed: int, n_states: int, n_dims: int, magnitude: float) -> None:
        rng = np.random.default_rng(seed)
        rows = rng.standard_t(2, size=(int(rng.integers(5, 60)), n_dims)) * 10.0**magnitude
        rows[rng.random(rows.shape) < 0.2] = 0.0  # stale prices
        if len(np.unique(rows, axis=0)) >= max(n_states, 2):
            assert_a_world(fit(rows, n_states, seed, n_restarts=2))


class TestOtherImplementation:
    def test_likelihood_and_optimum_agree_with_hmmlearn(self) -> None:
        hmm = pytest.importorskip("hmmlearn.hmm")
        rows = WORLD.sample(500, rng=np.random.default_rng(8)).observations
        fitted = fit(rows, 3)
        emission = gaussian(fitted)
        other = hmm.GaussianHMM(3, covariance_type="full", init_params="", n_iter=20, tol=1e-9)
        other.startprob_, other.transmat_ = fitted.world.initial, fitted.world.transition
        other.means_, other.covars_ = emission.means, emission.covariances
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            assert other.score(rows) == pytest.approx(fitted.log_likelihood, rel=1e-10)
            other.covars_prior, other.min_covar = 0.0, 0.0
            other.fit(rows)
            assert other.score(rows) - fitted.log_likelihood < 0.05
