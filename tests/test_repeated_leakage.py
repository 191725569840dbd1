"""Repeated decisions of one belief: against enumeration of all sequences, closed forms, and the limit."""

from __future__ import annotations

from itertools import product
from math import comb, prod

import numpy as np
import pytest
from hypothesis import given, settings

from inscrutable import (
    InputError,
    Mechanism,
    OriginalDecisionMaker,
    Prior,
    RepeatedLeakage,
    leakage,
    mechanism,
    repeated_leakage,
    uniform_prior,
)
from oracles import leakages as oracle
from strategies import belief_problem
from test_leakage import drawn

FIGURES = ("mutual_information", "bayes_error", "top_state_accuracy")
ERRORS = ("information_se", "error_se", "accuracy_se")


def all_sequences(table, n):
    """The mechanism of n independent draws: one column for every sequence."""
    return [[prod(row[m] for m in seen) for seen in product(range(len(row)), repeat=n)] for row in table]


def coin(share=0.7):
    """Two vertex beliefs, each with its own coin."""
    prior = Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5])
    return Mechanism(prior.beliefs, [[0.0], [1.0]], [[share, 1 - share], [1 - share, share]], np.eye(2)), prior


@settings(max_examples=25)
@given(drawn())
def test_sampled_figures_agree_with_all_sequences(case):
    weights, beliefs = case.prior.weights.tolist(), case.mechanism.beliefs.tolist()
    found = repeated_leakage(case.mechanism, case.prior, (1, 2, 3), rng=case.rng, n_draws=400)
    for s, n in enumerate((1, 2, 3)):
        table = all_sequences(case.mechanism.probabilities.tolist(), n)
        expected = (
            oracle.mutual_information(weights, table),
            oracle.bayes_error(weights, table, beliefs),
            oracle.top_state_accuracy(weights, table, beliefs),
        )
        for name, error, value in zip(FIGURES, ERRORS, expected, strict=True):
            deviation = getattr(found, error)[s]
            # Five standard errors; where all samples agree by luck, what a few unlike them would change.
            allowed = 1e-7 if n == 1 else 5 * deviation + 0.02
            assert getattr(found, name)[s] == pytest.approx(value, abs=allowed), (name, n)
            assert deviation >= 0
            assert n > 1 or deviation == 0


def test_standard_errors_are_those_of_the_samples():
    played, prior = coin()
    exact = oracle.mutual_information(
        [0.5, 0.5], [[comb(4, k) * p**k * (1 - p) ** (4 - k) for k in range(5)] for p in (0.3, 0.7)]
    )
    many = [repeated_leakage(played, prior, 4, rng=np.random.default_rng(seed), n_draws=50) for seed in range(200)]
    values = np.array([each.mutual_information[0] for each in many])
    stated = np.mean([each.information_se[0] for each in many])
    assert values.mean() == pytest.approx(exact, abs=4 * stated / np.sqrt(200))
    assert values.std() == pytest.approx(stated, rel=0.25)


def test_standard_errors_hold_for_an_uneven_prior():
    rng = np.random.default_rng(0)
    beliefs, weights = rng.dirichlet(np.ones(3), 6), rng.dirichlet(np.ones(6))
    played = Mechanism(beliefs, np.arange(3.0)[:, None], rng.dirichlet(np.ones(3), 6), np.zeros((6, 3)))
    table = all_sequences(played.probabilities.tolist(), 4)
    exact = (
        oracle.mutual_information(weights.tolist(), table),
        oracle.bayes_error(weights.tolist(), table, beliefs.tolist()),
        oracle.top_state_accuracy(weights.tolist(), table, beliefs.tolist()),
    )
    many = [
        repeated_leakage(played, Prior(beliefs, weights), 4, rng=np.random.default_rng(seed), n_draws=60)
        for seed in range(200)
    ]
    for name, error, value in zip(FIGURES, ERRORS, exact, strict=True):
        values = np.array([getattr(each, name)[0] for each in many])
        stated = np.mean([getattr(each, error)[0] for each in many])
        assert values.mean() == pytest.approx(value, abs=0.2 * stated), name
        assert values.std() == pytest.approx(stated, rel=0.25), name


def test_one_decision_is_exact_whatever_the_seed():
    problem, prior = belief_problem(3), uniform_prior(3, 4)
    rng = np.random.default_rng(0)
    table = rng.dirichlet(np.ones(6), len(prior))
    actions = problem.solve(rng.dirichlet(np.ones(3), 6))
    played = Mechanism(prior.beliefs, actions, table, np.zeros(table.shape))
    once = leakage(played, prior)
    found = repeated_leakage(played, prior, 1, rng=rng, n_draws=10)
    for name in FIGURES:
        assert getattr(found, name).tolist() == [getattr(once, name)]
    assert found.per_step.tolist() == [once.mutual_information]


def test_what_is_mixed_is_unmixed_and_no_more():
    # Beliefs 0 and 1 play one lottery, belief 2 another: for ever that is all there is to know.
    prior = Prior([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]], [0.25, 0.25, 0.5])
    played = Mechanism(prior.beliefs, [[0.0], [1.0]], [[0.8, 0.2], [0.8, 0.2], [0.2, 0.8]], np.zeros((3, 2)))
    found = repeated_leakage(played, prior, (1, 5, 200), rng=np.random.default_rng(0), n_draws=500)
    assert found.limit_information == 1
    assert found.limit_error == pytest.approx(np.sqrt(0.5 * 0.125))
    assert found.mutual_information[-1] == pytest.approx(1, abs=1e-9)
    assert found.bayes_error[-1] == pytest.approx(found.limit_error, abs=1e-6)  # luck in the classes is known
    assert (np.diff(found.mutual_information) > 0).all()
    assert (np.diff(found.bayes_error) < 0).all()
    assert found.per_step.sum() < 1
    assert found.per_step @ np.diff([0, 1, 5, 200]) == pytest.approx(found.mutual_information[-1])


def test_repetition_adds_nothing_to_a_deterministic_or_a_silent_mechanism():
    problem, prior = belief_problem(3), uniform_prior(3, 3)
    telling = mechanism(OriginalDecisionMaker(problem), prior.beliefs)
    found = repeated_leakage(telling, prior, (1, 7), rng=np.random.default_rng(0), n_draws=20)
    assert found.mutual_information == pytest.approx(prior.entropy, abs=1e-12)
    assert found.bayes_error == pytest.approx(0, abs=1e-12)
    assert found.limit_information == pytest.approx(prior.entropy)
    silent = Mechanism(prior.beliefs, [[0.0], [1.0]], np.full((10, 2), 0.5), np.zeros((10, 2)))
    found = repeated_leakage(silent, prior, (1, 50), rng=np.random.default_rng(0), n_draws=20)
    assert found.mutual_information == pytest.approx(0, abs=1e-12)
    assert found.bayes_error == pytest.approx(prior.error, abs=1e-12)
    assert found.limit_information == pytest.approx(0, abs=1e-12)
    assert found.limit_error == pytest.approx(prior.error)
    assert found.information_se == pytest.approx(0, abs=1e-12)
    assert found.error_se == pytest.approx(0, abs=1e-12)


def test_blocks_do_not_change_what_is_found(monkeypatch):
    prior = uniform_prior(3, 5)
    table = np.random.default_rng(0).dirichlet(np.full(4, 0.3), len(prior))
    played = Mechanism(prior.beliefs, np.arange(4.0)[:, None], table, np.zeros(table.shape))
    whole = repeated_leakage(played, prior, (2, 20), rng=np.random.default_rng(1), n_draws=300)
    monkeypatch.setattr("inscrutable.privacy.repeated._BLOCK", 500)
    parts = repeated_leakage(played, prior, (2, 20), rng=np.random.default_rng(1), n_draws=300)
    monkeypatch.setattr("inscrutable.privacy.repeated._MANY", 2.0)
    thin = repeated_leakage(played, prior, (2, 20), rng=np.random.default_rng(1), n_draws=300)
    assert thin.mutual_information == pytest.approx(parts.mutual_information, abs=1e-12)
    assert thin.bayes_error == pytest.approx(parts.bayes_error, abs=1e-12)
    assert parts.mutual_information == pytest.approx(whole.mutual_information, abs=5 * whole.information_se.max())


@pytest.mark.parametrize("share", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("n", [2, 10])
def test_what_was_never_drawn_is_in_the_stated_error(share: float, n: int) -> None:
    """A decision so rare that most samples have none; whether it was ever played is all that a sequence tells."""
    prior = Prior(np.eye(2), [0.5, 0.5])
    rare = Mechanism(prior.beliefs, [[0.0], [1.0]], [[1.0 - share, share], [1.0, 0.0]], np.zeros((2, 2)))
    never = (1.0 - share) ** n
    joint = np.array([[0.5 * never, 0.5 * (1.0 - never)], [0.5, 0.0]])
    seen = joint.sum(axis=0)
    bits = float(sum(p * np.log2(p / (0.5 * q)) for row in joint for p, q in zip(row, seen, strict=True) if p > 0))
    error = np.sqrt(2.0 * joint[0, 0] * joint[1, 0] / seen[0])
    for seed in range(20):
        found = repeated_leakage(rare, prior, (n,), rng=np.random.default_rng(seed))
        assert abs(found.mutual_information[0] - bits) < 6.0 * found.information_se[0]
        assert abs(found.bayes_error[0] - error) < 6.0 * found.error_se[0]


def test_very_unlikely_and_impossible_decisions():
    prior = Prior([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]], [0.5, 0.5, 0.0])
    table = [[1.0, 0.0, 0.0], [1.0 - 1e-300, 1e-300, 0.0], [0.0, 0.0, 1.0]]
    played = Mechanism(prior.beliefs, np.arange(3.0)[:, None], table, np.zeros((3, 3)))
    found = repeated_leakage(played, prior, (1, 1000), rng=np.random.default_rng(0), n_draws=50)
    assert found.mutual_information == pytest.approx(0, abs=1e-9)
    assert np.isfinite(found.bayes_error).all()


def test_it_is_repeatable_saved_and_printed(tmp_path):
    played, prior = coin()
    one, other = (repeated_leakage(played, prior, (1, 10), rng=np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(one.mutual_information, other.mutual_information)
    one.save(tmp_path / "found.npz")
    assert RepeatedLeakage.load(tmp_path / "found.npz").summary() == one.summary() == repr(one)
    assert "for ever: 1.0000 bits, error 0.0000" in one.summary()
    assert "± 0.0000 bits" in one.summary().splitlines()[1]


@pytest.mark.parametrize("n_steps", [0, -1, 2.5, (), (10, 1), (1, 1), "many"])
def test_numbers_of_steps_are_checked(n_steps):
    played, prior = coin()
    with pytest.raises(InputError, match="n_steps"):
        repeated_leakage(played, prior, n_steps, rng=np.random.default_rng(0))


def test_input_is_checked():
    played, prior = coin()
    with pytest.raises(InputError, match="n_draws"):
        repeated_leakage(played, prior, 2, rng=np.random.default_rng(0), n_draws=9)
    with pytest.raises(InputError, match="rng must be"):
        repeated_leakage(played, prior, 2, rng=0)
    with pytest.raises(InputError, match="none of the mechanism's"):
        repeated_leakage(played, uniform_prior(2, 3), 2, rng=np.random.default_rng(0))


def test_decisions_never_mixed_tell_by_repetition_what_the_first_told() -> None:
    rng = np.random.default_rng(0)
    beliefs = rng.dirichlet(np.ones(3), size=12)
    table = np.eye(4)[np.arange(12) % 4]
    plain = Mechanism(beliefs, np.arange(4.0)[:, None], table, np.zeros((12, 4)))
    prior = Prior(beliefs, rng.dirichlet(np.ones(12)))
    found = repeated_leakage(plain, prior, (1, 10, 100), rng=rng, n_draws=10)
    law = np.array([prior.weights[np.arange(12) % 4 == group].sum() for group in range(4)])
    assert found.mutual_information == pytest.approx(np.full(3, -(law * np.log2(law)).sum()), abs=1e-12)
    assert found.bayes_error == pytest.approx(np.full(3, found.limit_error), abs=1e-12)
    assert not found.error_se.any()


@pytest.mark.parametrize("rare", [1e-6, 1e-3, 0.1])
def test_standard_errors_hold_for_a_prior_with_a_rare_belief(rare):
    """No sequence of it is drawn in most samples, and the controls are then the same for all others."""
    beliefs, weights = [[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]], [0.66 * (1 - rare), 0.34 * (1 - rare), rare]
    table = np.array([[0.73, 0.0, 0.0, 0.27], [0.83, 0.0, 0.17, 0.0], [0.19, 0.59, 0.22, 0.0]])
    played = Mechanism(np.array(beliefs), np.arange(4.0)[:, None], table, np.zeros((3, 4)))
    exact = oracle.bayes_error(weights, all_sequences(table.tolist(), 2), beliefs)
    for seed in range(20):
        found = repeated_leakage(played, Prior(beliefs, weights), 2, rng=np.random.default_rng(seed), n_draws=1000)
        assert found.bayes_error[0] == pytest.approx(exact, abs=5 * found.error_se[0])


@pytest.mark.parametrize("n_draws", [10, 100])
def test_intervals_of_few_draws_hold_the_figures(n_draws, fresh_rng):
    """Few distinct sequences are drawn, which the control variates fit exactly; the fit's errors were of rounding size."""
    weights, table = (
        [0.4434, 0.5116, 0.045],
        np.array([[0.0, 0.086, 0.914], [0.859, 0.133, 0.008], [0.853, 0.036, 0.111]]),
    )
    played, prior = Mechanism(np.eye(3), np.arange(3.0)[:, None], table, np.zeros((3, 3))), Prior(np.eye(3), weights)
    sequences = all_sequences(table.tolist(), 5)
    exact = np.array(
        [oracle.mutual_information(weights, sequences), oracle.bayes_error(weights, sequences, np.eye(3).tolist())]
    )
    held = np.zeros(2)
    for _ in range(100):
        found = repeated_leakage(played, prior, 5, rng=fresh_rng, n_draws=n_draws)
        figures = np.array([found.mutual_information[0], found.bayes_error[0]])
        held += np.abs(figures - exact) <= 1.96 * np.array([found.information_se[0], found.error_se[0]])
    assert held.min() >= 70


@pytest.mark.parametrize("rare", [0.002, 0.02])
def test_figures_of_a_rare_belief_are_possible(rare, fresh_rng):
    """Never more than infinitely many decisions reveal, and with a standard error."""
    beliefs, chances, shares = np.array([[0.9, 0.1], [0.1, 0.9]]), np.array([0.7, 0.3]), np.array([1 - rare, rare])
    played = Mechanism(beliefs, [0, 1], np.column_stack([chances, 1 - chances]), np.zeros((2, 2)))
    # The first two seeds gave an error of 0 ± 0 and 100.3 % of top states.
    for seed in (3, 5, *fresh_rng.integers(2**32, size=20)):
        found = repeated_leakage(played, Prior(beliefs, shares), 100, rng=np.random.default_rng(seed))
        assert found.mutual_information[0] <= found.limit_information <= found.prior_entropy + 1e-12
        assert found.bayes_error[0] >= found.limit_error
        assert found.top_state_accuracy[0] <= 1.0
        assert min(getattr(found, name)[0] for name in ERRORS) > 0


@pytest.mark.parametrize("rare", [0.002, 0.02, 0.5])
def test_figures_of_a_rare_belief_are_within_their_standard_errors(rare, fresh_rng):
    """Against all numbers of times that the first decision may be played; most samples of the prior lack the rare belief."""
    beliefs, chances, shares = np.array([[0.9, 0.1], [0.1, 0.9]]), np.array([0.7, 0.3]), np.array([1 - rare, rare])
    played = Mechanism(beliefs, [0, 1], np.column_stack([chances, 1 - chances]), np.zeros((2, 2)))
    counts = [[comb(10, k) * c**k * (1 - c) ** (10 - k) for k in range(11)] for c in chances]
    exact = np.array(
        [
            oracle.mutual_information(shares.tolist(), counts),
            oracle.bayes_error(shares.tolist(), counts, beliefs.tolist()),
            oracle.top_state_accuracy(shares.tolist(), counts, beliefs.tolist()),
        ]
    )
    off = np.empty((30, 3))
    for row in off:
        found = repeated_leakage(played, Prior(beliefs, shares), 10, rng=fresh_rng)
        row[:] = [
            (getattr(found, name)[0] - value) / getattr(found, error)[0]
            for name, error, value in zip(FIGURES, ERRORS, exact, strict=True)
        ]
    assert np.abs(off).max() <= 6.0
    assert np.sqrt((off**2).mean(axis=0)).max() <= 1.8


def test_lotteries_without_common_decisions_leave_no_error_and_no_standard_error(fresh_rng):
    """The first decision tells which lottery it is: further ones add nothing, however few are drawn."""
    table = np.zeros((3, 6))
    for b in range(3):
        table[b, 2 * b : 2 * b + 2] = fresh_rng.dirichlet(np.ones(2))
    played = Mechanism(np.eye(3), np.arange(6), table, np.zeros((3, 6)))
    found = repeated_leakage(
        played, Prior(np.eye(3), fresh_rng.dirichlet(np.ones(3))), (1, 5), rng=fresh_rng, n_draws=20
    )
    np.testing.assert_allclose(found.bayes_error, 0.0, atol=1e-12)
    np.testing.assert_allclose(found.error_se, 0.0, atol=1e-12)
