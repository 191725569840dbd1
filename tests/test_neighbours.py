"""Objects of other packages: what is read from them gives the numbers that they give."""

from __future__ import annotations

import json
from collections import OrderedDict
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import inscrutable as ins
from inscrutable import InputError

ASSETS = ["A", "B", "C"]
NOT_PASSED = {
    "check_fit_score_takes_y": "fit_predict of skfolio's estimators takes no y",
    "check_estimators_nan_inf": "predict of skfolio's estimators makes a portfolio of the returns as they are",
    "check_methods_sample_order_invariance": "predict gives one portfolio over time, not one value a row",
    "check_fit2d_predict1d": "predict of skfolio's estimators says it in other words than scikit-learn's",
}
"""scikit-learn's checks that the estimator does not pass, each for a reason that lies in skfolio's own base class."""
PASSED = (
    "check_estimator_cloneable", "check_estimator_tags_renamed", "check_valid_tag_types", "check_estimator_repr",
    "check_no_attributes_set_in_init", "check_estimators_overwrite_params", "check_dont_overwrite_parameters",
    "check_estimators_fit_returns_self", "check_readonly_memmap_input", "check_estimators_unfitted",
    "check_do_not_raise_errors_in_init_or_set_params", "check_n_features_in_after_fitting", "check_mixin_order",
    "check_positive_only_tag_during_fit", "check_estimators_dtypes", "check_complex_data", "check_dtype_object",
    "check_estimators_empty_data_messages", "check_pipeline_consistency", "check_estimator_sparse_tag",
    "check_estimator_sparse_array", "check_estimator_sparse_matrix", "check_estimators_pickle",
    "check_f_contiguous_array_estimator", "check_parameters_default_constructible", "check_methods_subset_invariance",
    "check_fit2d_1sample", "check_fit2d_1feature", "check_get_params_invariance", "check_set_params",
    "check_dict_unchanged", "check_fit_idempotent", "check_fit_check_is_fitted", "check_n_features_in", "check_fit1d",
)  # fmt: skip


@pytest.mark.parametrize("kind", ["full", "diag", "tied", "spherical"])
def test_hmmlearn_gives_the_same_likelihood(kind, fresh_rng):
    hmm = pytest.importorskip("hmmlearn.hmm")
    model = hmm.GaussianHMM(3, covariance_type=kind)
    model.n_features = 2
    model.startprob_, model.transmat_ = fresh_rng.dirichlet(np.ones(3)), fresh_rng.dirichlet(np.ones(3), 3)
    model.means_ = fresh_rng.normal(size=(3, 2))
    roots = fresh_rng.normal(size=(3, 2, 4))
    spread = roots @ roots.transpose(0, 2, 1)
    model.covars_ = {
        "full": spread, "tied": spread[0], "diag": np.abs(roots[:, :, 0]) + 0.1, "spherical": np.array([0.5, 1.0, 2.0])
    }[kind]  # fmt: skip
    rows = fresh_rng.normal(size=(30, 2))
    world = ins.from_hmmlearn(model)
    assert ins.filter_beliefs(world, rows).log_likelihood == pytest.approx(model.score(rows), rel=1e-9)
    discrete = hmm.CategoricalHMM(2)
    discrete.startprob_, discrete.transmat_ = [0.6, 0.4], [[0.9, 0.1], [0.3, 0.7]]
    discrete.emissionprob_ = np.array([[0.8, 0.1, 0.1], [0.1, 0.2, 0.7]])
    symbols = fresh_rng.integers(3, size=20)
    found = ins.filter_beliefs(ins.from_hmmlearn(discrete), symbols).log_likelihood
    assert found == pytest.approx(discrete.score(symbols[:, None]), rel=1e-9)


def test_hmmlearn_with_counts_of_several_trials_is_refused():
    """It was read as a sensor that draws one symbol a step."""
    model = pytest.importorskip("hmmlearn.hmm").MultinomialHMM(2, n_trials=5)
    model.startprob_, model.transmat_ = [0.6, 0.4], [[0.9, 0.1], [0.3, 0.7]]
    model.emissionprob_ = np.array([[0.8, 0.1, 0.1], [0.1, 0.2, 0.7]])
    with pytest.raises(InputError, match="MultinomialHMM observes counts of trials"):
        ins.from_hmmlearn(model)


def test_statsmodels_gives_the_same_likelihood():
    switching = pytest.importorskip("statsmodels.tsa.regime_switching.markov_regression")
    draws = np.random.default_rng(2).normal(size=80) * np.repeat([0.5, 2.0, 0.5, 1.5], 20) + 0.1
    for options in ({}, {"switching_variance": True}):
        model = switching.MarkovRegression(draws, k_regimes=2, **options)
        results = model.smooth(model.start_params)
        world = ins.from_statsmodels(results)
        assert ins.filter_beliefs(world, draws).log_likelihood == pytest.approx(results.llf, rel=1e-7)
    other = switching.MarkovRegression(draws[1:], k_regimes=2, exog=draws[:-1])
    with pytest.raises(InputError, match=r"the regression has .*; expected an intercept and variances alone"):
        ins.from_statsmodels(other.smooth(other.start_params))


def test_parameters_with_the_layout_of_dynamax():
    """Stand-ins: dynamax itself needs JAX."""
    params = SimpleNamespace(
        initial=SimpleNamespace(probs=[0.5, 0.5]), transitions=SimpleNamespace(transition_matrix=[[0.9, 0.1], [0.2, 0.8]]),
        emissions=SimpleNamespace(probs=[[[0.7, 0.3]], [[0.2, 0.8]]]),
    )  # fmt: skip
    world = ins.from_dynamax(params)
    np.testing.assert_array_equal(world.emission.probabilities, [[0.7, 0.3], [0.2, 0.8]])
    params.emissions = SimpleNamespace(means=[[0.0], [1.0]], covs=[[[1.0]], [[2.0]]])
    assert ins.from_dynamax(params).emission.covariances.shape == (2, 1, 1)
    params.emissions = SimpleNamespace(probs=np.full((2, 3, 2), 0.5))
    for wrong in (params, None, SimpleNamespace(initial=params.initial), {"initial": 1}):
        with pytest.raises(InputError):
            ins.from_dynamax(wrong)
    for wrong in (None, SimpleNamespace(transmat_=1), SimpleNamespace(transmat_=1, startprob_=1, weights_=1)):
        with pytest.raises(InputError):
            ins.from_hmmlearn(wrong)


@pytest.mark.parametrize("kind", ["spherical", "diag", "tied", "full"])
def test_every_kind_of_covariance_of_hmmlearn_is_read(kind):
    hmm = pytest.importorskip("hmmlearn.hmm")
    rows = np.random.default_rng(0).normal(size=(200, 2)) * [1.0, 3.0]
    model = hmm.GaussianHMM(2, kind, random_state=0).fit(rows)
    assert ins.filter_beliefs(ins.from_hmmlearn(model), rows).log_likelihood == pytest.approx(
        model.score(rows), rel=1e-9
    )


def test_labels_of_several_levels_survive_plain_data():
    columns = pd.MultiIndex.from_tuples([("x", 1), ("x", 2)])
    means = pd.DataFrame([[0.0, 0.0], [3.0, 1.0]], columns=columns)
    world = ins.HiddenMarkovModel([[0.9, 0.1], [0.1, 0.9]], ins.GaussianEmission(means, [np.eye(2)] * 2))
    again = ins.HiddenMarkovModel.from_dict(json.loads(json.dumps(world.to_dict())))
    rows = pd.DataFrame([[0.1, 0.2], [2.0, 1.0]], columns=columns)
    found = [ins.filter_beliefs(each, rows[rows.columns[::-1]]).beliefs for each in (world, again)]
    np.testing.assert_array_equal(*found)


def test_weights_as_other_packages_give_them():
    expected = pd.DataFrame([[0.2, 0.3, 0.5]], columns=ASSETS)
    times = pd.date_range("2020-01-31", periods=2, freq="ME")
    held = pd.DataFrame([[0.2, 0.3, 0.5, 0.0]] * 2, times, [*ASSETS, "cash"])
    for given in (
        OrderedDict(zip(ASSETS, [0.2, 0.3, 0.5], strict=True)),  # PyPortfolioOpt
        pd.DataFrame({"weights": [0.2, 0.3, 0.5]}, ASSETS),  # Riskfolio
        pd.Series([0.2, 0.3, 0.5], ASSETS),
    ):
        pd.testing.assert_frame_equal(ins.weights_of(given), expected, check_column_type=False)
    frontier = pd.DataFrame([[0.2, 0.6], [0.3, 0.4], [0.5, 0.0]], ASSETS, [0, 1])  # a column per portfolio
    np.testing.assert_array_equal(ins.weights_of(frontier), [[0.2, 0.3, 0.5], [0.6, 0.4, 0.0]])
    named = frontier.set_axis(["HRP", "MV"], axis=1)  # Riskfolio, portfolios with names
    np.testing.assert_array_equal(ins.weights_of(named)[ASSETS], [[0.2, 0.3, 0.5], [0.6, 0.4, 0.0]])
    np.testing.assert_array_equal(ins.weights_of(named.T)[ASSETS], [[0.2, 0.3, 0.5], [0.6, 0.4, 0.0]])
    numbered = pd.DataFrame(
        [[0.5, 0.5], [0.4, 0.6]], ["2020-01-31", "2020-02-29"], [10107, 14593]
    )  # assets with numbers
    pd.testing.assert_frame_equal(ins.weights_of(numbered), numbered)
    for given in (held, SimpleNamespace(w=held)):  # cvxportfolio
        found = ins.weights_of(given)
        assert list(found.columns) == ASSETS
        assert found.index.equals(times)
    named_w = pd.DataFrame({"v": [0.4, 0.5], "w": [0.6, 0.5]})  # pandas gives the column as the attribute w
    pd.testing.assert_frame_equal(ins.weights_of(named_w), named_w)
    pd.testing.assert_frame_equal(ins.weights_of(named_w.loc[0]), named_w.loc[:0])
    for wrong, said in (
        ({}, "empty mapping"),
        ("A", "weights must be a mapping"),
        (pd.DataFrame(), "weights must be a mapping"),
        ({"A": "much"}, "must be numbers"),
        ({"A": np.nan}, "the weight of A in row 0 is nan"),
        (pd.DataFrame([[0.5, 0.5]], columns=["A", "A"]), "'A' more than once"),
        (held.assign(cash=0.3), r"hold up to 0.3 in 'cash'"),
    ):
        with pytest.raises(InputError, match=said):
            ins.weights_of(wrong)


def test_their_delta_is_twice_our_gamma():
    frontier = pytest.importorskip("pypfopt.efficient_frontier")
    means, spread = np.array([0.08, 0.05, 0.03]), np.diag([0.09, 0.04, 0.01])
    theirs = frontier.EfficientFrontier(pd.Series(means, ASSETS), pd.DataFrame(spread, ASSETS, ASSETS))
    theirs.max_quadratic_utility(risk_aversion=3.0)  # δ: μ'w − δ/2 w'Σw
    ours = ins.MarkowitzProblem([means], [spread], 1.5).solve([1.0])
    np.testing.assert_allclose(ins.weights_of(theirs.clean_weights(1e-9, 9))[ASSETS].iloc[0], ours, atol=1e-4)


@pytest.mark.filterwarnings("ignore")
def test_the_estimator_walks_forward_in_skfolio():
    selection = pytest.importorskip("skfolio.model_selection")
    draws = np.random.default_rng(0).normal(0.005, 0.03, (90, 3))
    returns = pd.DataFrame(draws, pd.date_range("2015-01-31", periods=90, freq="ME"), ASSETS)
    estimator = ins.PrivatePortfolio(restarts=1, budget=0.2)
    walked = selection.cross_val_predict(estimator, returns, cv=selection.WalkForward(train_size=60, test_size=15))
    for number, portfolio in enumerate(walked.portfolios):
        again = ins.PrivatePortfolio(restarts=1, budget=0.2).fit(returns.iloc[15 * number : 60 + 15 * number])
        np.testing.assert_array_equal(portfolio.weights, again.weights_)
        assert again.decision_.privacy > 0.01
    bare = ins.PrivatePortfolio(restarts=1, budget=0.0).fit(returns)
    assert bare.decision_.privacy == pytest.approx(0.0, abs=1e-6)
    for wrong in ({"regimes": 0}, {"budget": -1.0}, {"risk_aversion": 0.0}, {"restarts": 0}):
        with pytest.raises(InputError):
            ins.PrivatePortfolio(**({"restarts": 1} | wrong)).fit(returns)


@pytest.mark.audit
@pytest.mark.filterwarnings("ignore")
def test_the_checks_of_scikit_learn_by_name():
    pytest.importorskip("skfolio")
    checks = pytest.importorskip("sklearn.utils.estimator_checks")
    found = checks.check_estimator(ins.PrivatePortfolio(restarts=1), on_fail=None, on_skip=None)
    failed = {each["check_name"] for each in found if each["status"] == "failed"}
    assert failed == set(NOT_PASSED)
    assert {each["check_name"] for each in found if each["status"] == "passed"} == set(PASSED)
