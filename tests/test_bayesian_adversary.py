"""Bayes' rule for the aware observer: against loops by definition, and where it says nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inscrutable import (
    BayesianAdversary,
    FiniteProblem,
    InputError,
    Mechanism,
    OriginalDecisionMaker,
    Posterior,
    PosteriorStatus,
    Prior,
    leakage,
    mechanism,
    uniform_prior,
)
from oracles import leakages as oracle
from strategies import belief_problem
from test_leakage import drawn


@settings(max_examples=100)
@given(drawn())
def test_posteriors_are_bayes_rule(case):
    played, weights = case.mechanism, case.prior.weights.tolist()
    table, beliefs = played.probabilities.tolist(), played.beliefs.tolist()
    observer = BayesianAdversary(played, case.prior)
    often = oracle.marginal(oracle.joint(weights, table))
    for m, (found, share) in enumerate(zip(observer.infer_many(played.actions), often, strict=True)):
        if share == 0:
            assert found.status is PosteriorStatus.NEVER_PLAYED
            continue
        law = oracle.posterior(weights, table, m)
        assert found.status is PosteriorStatus.PLAYED
        assert found.is_known
        assert found.distance == 0
        assert found.probability == pytest.approx(share, abs=1e-14)
        assert found.weights == pytest.approx(law, abs=1e-12)
        assert found.mean == pytest.approx(oracle.mean(law, beliefs), abs=1e-12)
        assert found.entropy == pytest.approx(oracle.entropy(law), abs=1e-12)
        by_state = [
            sum(p for p, b in zip(law, beliefs, strict=True) if b[i] >= max(b) - 1e-9) for i in range(len(beliefs[0]))
        ]
        assert by_state[found.top_state] == pytest.approx(max(by_state), abs=1e-12)


@settings(max_examples=60)
@given(drawn())
def test_posteriors_add_up_to_what_leaks(case):
    found = leakage(case.mechanism, case.prior)
    observer = BayesianAdversary(case.mechanism, case.prior)
    after = [each for each in observer.infer_many(case.mechanism.actions) if each.is_known]
    shares = np.array([each.probability for each in after])
    assert shares.sum() == pytest.approx(1, abs=1e-12)
    assert np.sqrt(sum(p * each.error**2 for p, each in zip(shares, after, strict=True))) == pytest.approx(
        found.bayes_error, abs=1e-7
    )
    entropy = sum(p * each.entropy for p, each in zip(shares, after, strict=True))
    assert found.prior_entropy - entropy == pytest.approx(found.mutual_information, abs=1e-12)
    assert sum(p * each.mean for p, each in zip(shares, after, strict=True)) == pytest.approx(
        case.prior.mean, abs=1e-12
    )


@settings(max_examples=60)
@given(drawn())
def test_a_credible_region_is_the_smallest(case):
    observer = BayesianAdversary(case.mechanism, case.prior)
    for found in observer.infer_many(case.mechanism.actions):
        if not found.is_known:
            continue
        for level in (0.3, 0.9, 1.0):
            chosen = found.credible_indices(level)
            heaviest = np.sort(found.weights)[::-1]
            fewest = next(n for n in range(1, len(heaviest) + 1) if heaviest[:n].sum() >= level - 1e-9)
            assert len(chosen) == fewest
            assert found.weights[chosen].sum() >= level - 1e-9
            assert (found.weights[chosen] > 0).all()
            assert np.array_equal(found.credible_region(level), found.beliefs[chosen])


def two_beliefs() -> tuple[Mechanism, Prior]:
    """Action 0 under either belief, action 1 under the second, action 2 never, action 3 under one without weight."""
    prior = Prior([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]], [0.5, 0.5, 0.0])
    table = [[1.0, 0.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    return Mechanism(prior.beliefs, [[0.0, 0.0], [1.0, 0.0], [0.9, 0.3], [0.0, 1.0]], table, np.zeros((3, 4))), prior


def test_a_decision_never_played_is_a_status():
    observer = BayesianAdversary(*two_beliefs())
    for action in ([0.9, 0.3], [0.0, 1.0], [5.0, 5.0], [1e-9, 0.0]):
        found = observer.infer(action)
        assert found.status is PosteriorStatus.NEVER_PLAYED
        assert not found.is_known
        assert np.isnan(found.weights).all()
        assert np.isnan(found.mean).all()
        assert np.isnan(found.entropy)
        assert np.isnan(found.error)
        assert found.top_state == -1
        assert found.credible_region().shape == (0, 2)
        assert found.probability == 0
        assert "nearest=True" in found.summary()
    assert observer.infer([0.9, 0.3]).distance == pytest.approx(np.hypot(0.1, 0.3))


def test_the_nearest_played_decision_on_request():
    observer = BayesianAdversary(*two_beliefs())
    found = observer.infer([0.9, 0.3], nearest=True)
    assert found.status is PosteriorStatus.NEAREST_PLAYED
    assert found.is_known
    assert found.distance == pytest.approx(np.hypot(0.1, 0.3))
    assert found.weights.tolist() == [0, 1, 0]
    assert "distance" in found.summary()
    exact = observer.infer([1e-13, 0.0])
    assert (exact.status, exact.distance) == (PosteriorStatus.PLAYED, 0)
    assert exact.mean == pytest.approx([2 / 3, 1 / 3])


@settings(max_examples=60)
@given(drawn(), st.integers(1, 6), st.randoms(use_true_random=False))
def test_several_near_decisions_add_up(case, count, luck):
    """By loops: the likelihoods of the nearest decisions of positive probability."""
    observer = BayesianAdversary(case.mechanism, case.prior)
    actions = np.asarray(case.mechanism.actions, dtype=float)
    stray = actions[0] + np.array([luck.uniform(0.1, 0.4) for _ in range(actions[0].size)]).reshape(actions[0].shape)
    found = observer.infer(stray, nearest=count)
    weights, table = case.prior.weights.tolist(), case.mechanism.observed
    table = table.tolist() if isinstance(table, np.ndarray) else table.toarray().tolist()
    often = oracle.marginal(oracle.joint(weights, table))
    apart = sorted((float(np.linalg.norm(actions[m] - stray)), m) for m in range(len(actions)) if often[m] > 0)
    if apart[0][0] < 1e-9 or (len(apart) > count and apart[count][0] - apart[count - 1][0] < 1e-9):
        return  # played, or two decisions are as near
    joint = [w * sum(row[m] for _, m in apart[:count]) for w, row in zip(weights, table, strict=True)]
    law = np.array(joint) / sum(joint)
    assert found.status is PosteriorStatus.NEAREST_PLAYED
    assert found.distance == pytest.approx(apart[0][0])
    assert found.probability == pytest.approx(sum(joint), abs=1e-14)
    assert found.weights == pytest.approx(law, abs=1e-12)
    assert found.mean == pytest.approx(law @ case.mechanism.beliefs, abs=1e-12)
    assert observer.estimate(stray, nearest=count) == pytest.approx(found.mean, abs=1e-12)
    with pytest.raises(InputError, match="nearest"):
        observer.estimate(stray, nearest=-1)


def test_estimates_are_the_means_of_posteriors():
    observer = BayesianAdversary(*two_beliefs())
    actions = np.array([[0.0, 0.0], [1.0, 0.0], [0.9, 0.3], [0.0, 1.0]])
    for nearest in (False, True):
        found = observer.estimates(actions, nearest=nearest)
        each = [posterior.mean for posterior in observer.infer_many(actions, nearest=nearest)]
        assert np.array_equal(found, each, equal_nan=True)
        alone = [observer.estimate(action, nearest=nearest) for action in actions]
        assert np.array_equal(found, alone, equal_nan=True)
    assert np.isnan(observer.estimates(actions)).any(axis=1).tolist() == [False, False, True, True]


def test_choices_and_portfolios_as_they_are_met():
    choice, prior = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), uniform_prior(2, 3)
    observer = BayesianAdversary(mechanism(OriginalDecisionMaker(choice), prior.beliefs), prior)
    assert observer.infer(1).mean == pytest.approx([1 / 6, 5 / 6])
    assert observer.infer(0).top_state == 0
    assert observer.infer(7).status is PosteriorStatus.NEVER_PLAYED
    problem = belief_problem(3)
    prior = uniform_prior(3, 5)
    observer = BayesianAdversary(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior)
    for belief in prior.beliefs:
        assert observer.infer(problem.solve(belief)).mean == pytest.approx(belief, abs=1e-12)
    assert repr(observer) == "BayesianAdversary(21 beliefs, 21 played decisions)"


def test_input_is_checked():
    observer = BayesianAdversary(*two_beliefs())
    with pytest.raises(InputError, match=r"one decision of rank 1, got shape \(2, 2\)"):
        observer.infer([[0.0, 0.0], [1.0, 0.0]])
    with pytest.raises(InputError, match="action has 3 coordinates, expected 2"):
        observer.infer([0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="every entry must be finite"):
        observer.infer([np.nan, 0.0])
    with pytest.raises(InputError, match="level must be at most 1"):
        observer.infer([0.0, 0.0]).credible_region(1.5)
    with pytest.raises(InputError, match="level must be above 0"):
        observer.infer([0.0, 0.0]).credible_region(0)
    with pytest.raises(InputError, match="none of the mechanism's"):
        BayesianAdversary(two_beliefs()[0], uniform_prior(2, 3))


def test_a_posterior_can_be_saved_and_read(tmp_path):
    observer = BayesianAdversary(*two_beliefs())
    for action in ([0.0, 0.0], [5.0, 5.0]):
        found = observer.infer(action)
        found.save(tmp_path / "found.npz")
        again = Posterior.load(tmp_path / "found.npz")
        assert again.status is found.status
        assert np.array_equal(again.weights, found.weights, equal_nan=True)
        assert again.summary() == found.summary() == repr(found)
