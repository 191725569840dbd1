"""What a mechanism gives away: against loops by definition, closed forms, and the inequalities every leakage obeys."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from inscrutable import (
    FiniteProblem,
    InputError,
    Leakage,
    MarkowitzProblem,
    Mechanism,
    OriginalDecisionMaker,
    Prior,
    ProbabilisticDecisionMaker,
    leakage,
    mechanism,
    repeated_leakage,
    uniform_prior,
)
from oracles import leakages as oracle
from sizes import instances
from strategies import SEEDS, belief_problem

MEASURES = ("mutual_information", "min_entropy_leakage", "maximal_leakage")


class Drawn(NamedTuple):
    """A mechanism, a prior on its beliefs, and a source for whatever else a test draws."""

    mechanism: Mechanism
    prior: Prior
    rng: np.random.Generator


@st.composite
def drawn(draw: st.DrawFn) -> Drawn:
    """Few beliefs and decisions; zero weights, zero probabilities, deterministic rows and equal rows among them."""
    rng = np.random.default_rng(draw(SEEDS))
    n_beliefs, n_actions, n_states = draw(st.integers(1, 7)), draw(st.integers(1, 6)), draw(st.integers(1, 4))
    beliefs = rng.dirichlet(np.full(n_states, 0.7) if n_states > 1 else np.ones(1), n_beliefs)
    if draw(st.booleans()):
        beliefs = np.round(2 * beliefs) / np.round(2 * beliefs).sum(axis=1, keepdims=True)  # ties of top states
    table = rng.dirichlet(np.full(n_actions, draw(st.sampled_from([0.1, 1.0]))), n_beliefs)
    kind = draw(st.sampled_from(["full", "holes", "deterministic", "equal"]))
    if kind == "holes":
        table = np.where(rng.random(table.shape) < 0.5, 0.0, table) + 1e-300
        table[np.arange(n_beliefs), rng.integers(n_actions, size=n_beliefs)] += 0.5
        table = np.where(table < 1e-200, 0.0, table)
        table /= table.sum(axis=1, keepdims=True)
    if kind == "deterministic":
        table = np.eye(n_actions)[rng.integers(n_actions, size=n_beliefs)]
    if kind == "equal":
        table = np.tile(table[:1], (n_beliefs, 1))
    weights = rng.dirichlet(np.ones(n_beliefs))
    if draw(st.booleans()):
        weights[rng.integers(n_beliefs)] = 0.0
        weights = weights / weights.sum() if weights.sum() > 0 else np.eye(n_beliefs)[0]
    actions = rng.normal(size=(n_actions, 2))
    regrets = rng.random((n_beliefs, n_actions))
    return Drawn(Mechanism(beliefs, actions, table, regrets), Prior(beliefs, weights), rng)


def plain(prior: Prior, played: Mechanism):
    """Weights, table and beliefs as lists."""
    return prior.weights.tolist(), played.probabilities.tolist(), played.beliefs.tolist()


# --- against the definitions --------------------------------------------------------------------------------------------


@settings(max_examples=instances(150))
@given(drawn())
def test_every_figure_is_its_definition(case):
    found = leakage(case.mechanism, case.prior)
    weights, table, beliefs = plain(case.prior, case.mechanism)
    errors = oracle.conditional_errors(weights, table, beliefs)
    regrets = case.mechanism.regrets.tolist()
    played = [(b, m) for b, w in enumerate(weights) for m, k in enumerate(table[b]) if w > 0 and k > 0]
    expected = {
        "mutual_information": oracle.mutual_information(weights, table),
        "bayes_error": oracle.bayes_error(weights, table, beliefs),
        "prior_error": oracle.prior_error(weights, beliefs),
        "top_state_accuracy": oracle.top_state_accuracy(weights, table, beliefs),
        "min_entropy_leakage": oracle.min_entropy_leakage(weights, table),
        "maximal_leakage": oracle.maximal_leakage(weights, table),
        "expected_regret": sum(weights[b] * table[b][m] * regrets[b][m] for b, m in played),
        "worst_regret": max(regrets[b][m] for b, m in played),
        "prior_entropy": oracle.entropy(weights),
        "prior_top_state_accuracy": oracle.guess_right(weights, beliefs),
        "n_beliefs": sum(w > 0 for w in weights),
        "n_actions": len({m for _, m in played}),
        "least_error": min(errors),
        "largest_error": max(errors),
        "worst_expected_regret": max(
            sum(k * r for k, r in zip(table[b], regrets[b], strict=True)) for b, w in enumerate(weights) if w > 0
        ),
    }
    for name, value in expected.items():
        assert getattr(found, name) == pytest.approx(value, abs=1e-7), name  # roots of 1e-15
    assert np.isnan(found.silence_regret)
    assert np.isnan(found.silence_share)


@settings(max_examples=60)
@given(drawn())
def test_a_sparse_table_leaks_what_a_plain_one_does(case):
    played = case.mechanism
    thin = Mechanism(played.beliefs, played.actions, sparse.csr_array(played.probabilities), played.regrets)
    assert sparse.issparse(thin.probabilities)
    one, other = leakage(played, case.prior), leakage(thin, case.prior)
    for name in Leakage.__dataclass_fields__:
        assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-14, nan_ok=True), name


# --- what every leakage obeys -------------------------------------------------------------------------------------------


@settings(max_examples=instances(150))
@given(drawn())
def test_bounds(case):
    found = leakage(case.mechanism, case.prior)
    most = np.log2(min(found.n_beliefs, found.n_actions))
    assert 0 <= found.mutual_information <= min(most, found.prior_entropy) + 1e-12
    assert found.mutual_information <= found.maximal_leakage + 1e-12
    assert 0 <= found.min_entropy_leakage <= found.maximal_leakage + 1e-12
    assert found.maximal_leakage <= most + 1e-12
    assert 0 <= found.bayes_error <= found.prior_error + 1e-12
    assert found.prior_top_state_accuracy - 1e-12 <= found.top_state_accuracy <= 1
    assert found.least_error <= found.bayes_error + 1e-12
    assert found.bayes_error <= found.largest_error + 1e-12
    assert found.expected_regret <= found.worst_expected_regret + 1e-12
    assert found.worst_expected_regret <= found.worst_regret + 1e-12


@settings(max_examples=instances(100))
@given(drawn())
def test_merging_decisions_never_leaks_more(case):
    played = case.mechanism
    into = case.rng.integers(len(played.actions), size=len(played.actions))
    merged = np.zeros_like(played.probabilities)
    for m, target in enumerate(into):
        merged[:, target] += played.probabilities[:, m]
    less = leakage(Mechanism(played.beliefs, played.actions, merged, played.regrets), case.prior)
    more = leakage(played, case.prior)
    for name in (*MEASURES, "top_state_accuracy"):
        assert getattr(less, name) <= getattr(more, name) + 1e-12, name
    assert less.bayes_error >= more.bayes_error - 1e-9


@settings(max_examples=instances(100))
@given(drawn())
def test_maximal_leakage_is_the_largest_min_entropy_leakage_of_any_prior(case):
    played = case.mechanism
    everyone = np.full(len(played.beliefs), 1.0 / len(played.beliefs))
    most = leakage(played, Prior(played.beliefs, everyone))
    for concentration in (0.1, 1.0, 10.0):
        law = case.rng.dirichlet(np.full(len(everyone), concentration))
        assert leakage(played, Prior(played.beliefs, law)).min_entropy_leakage <= most.maximal_leakage + 1e-12
    assert most.min_entropy_leakage == pytest.approx(most.maximal_leakage, abs=1e-12)  # reached by equal weights


@settings(max_examples=60)
@given(drawn())
def test_the_order_of_beliefs_and_decisions_does_not_matter(case):
    played, beliefs = case.mechanism, case.mechanism.beliefs
    some, other = case.rng.permutation(len(beliefs)), case.rng.permutation(len(played.actions))
    moved = Mechanism(
        beliefs[some], played.actions[other], played.probabilities[some][:, other], played.regrets[some][:, other]
    )
    found = leakage(played, case.prior)
    if len(np.unique(np.round(beliefs, 6), axis=0)) < len(beliefs):
        return  # equal beliefs with different rows cannot be distinguished
    for prior in (Prior(beliefs[some], case.prior.weights[some]), case.prior):
        again = leakage(moved, prior)
        for name in Leakage.__dataclass_fields__:
            assert getattr(again, name) == pytest.approx(getattr(found, name), abs=1e-12, nan_ok=True), name


@settings(max_examples=60)
@given(drawn())
def test_a_prior_on_some_of_the_beliefs_is_one_with_zero_weights(case):
    held = case.prior.weights > 0
    if len(np.unique(np.round(case.prior.beliefs, 6), axis=0)) < len(held):
        return
    some = Prior(case.prior.beliefs[held], case.prior.weights[held])
    one, other = leakage(case.mechanism, case.prior), leakage(case.mechanism, some)
    assert other.mutual_information == pytest.approx(one.mutual_information, abs=1e-12)
    assert other.bayes_error == pytest.approx(one.bayes_error, abs=1e-12)


@settings(max_examples=60)
@given(drawn())
def test_a_deterministic_mechanism_leaks_the_entropy_of_its_decisions(case):
    played = case.mechanism
    table = np.eye(len(played.actions))[case.rng.integers(len(played.actions), size=len(played.beliefs))]
    found = leakage(Mechanism(played.beliefs, played.actions, table, played.regrets), case.prior)
    assert found.mutual_information == pytest.approx(oracle.entropy(case.prior.weights @ table), abs=1e-12)
    assert found.maximal_leakage == pytest.approx(np.log2(found.n_actions), abs=1e-12)


@settings(max_examples=60)
@given(drawn())
def test_one_lottery_for_all_leaks_nothing(case):
    played = case.mechanism
    table = np.tile(played.probabilities[:1], (len(played.beliefs), 1))
    found = leakage(Mechanism(played.beliefs, played.actions, table, played.regrets), case.prior)
    assert [getattr(found, name) for name in MEASURES] == pytest.approx([0, 0, 0], abs=1e-12)
    assert found.bayes_error == pytest.approx(found.prior_error, abs=1e-12)
    assert found.top_state_accuracy == pytest.approx(found.prior_top_state_accuracy, abs=1e-12)


def test_decisions_that_nobody_can_tell_apart_are_one():
    prior = uniform_prior(2, 1)
    telling = Mechanism(prior.beliefs, [[0.3], [0.3 + 1e-13]], np.eye(2), np.zeros((2, 2)))
    found = leakage(telling, prior)
    assert (found.mutual_information, found.maximal_leakage, found.n_actions) == (0, 0, 1)
    apart = Mechanism(prior.beliefs, [[0.3], [0.3 + 1e-9]], np.eye(2), np.zeros((2, 2)))
    assert leakage(apart, prior).mutual_information == 1


# --- the silence regret ---------------------------------------------------------------------------------------------------


def test_silence_regret_is_the_least_expected_regret_of_a_constant_choice():
    rng = np.random.default_rng(3)
    problem = FiniteProblem(rng.random((3, 5)))
    prior = Prior(rng.dirichlet(np.ones(3), 20), rng.dirichlet(np.ones(20)))
    by_choice = [
        sum(w * problem.regret(b, a) for w, b in zip(prior.weights, prior.beliefs, strict=True)) for a in range(5)
    ]
    found = leakage(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, problem)
    assert found.silence_regret == pytest.approx(min(by_choice), abs=1e-14)
    assert found.silence_share == pytest.approx(0, abs=1e-12)


def test_silence_regret_by_hand():
    # ρ(π, u*(y)) = ‖π − y‖²/4 where a decision tells its belief: silence at the mean costs a quarter of the variance.
    problem, prior = belief_problem(3), uniform_prior(3, 6)
    played = mechanism(ProbabilisticDecisionMaker(problem, budget=0.1), prior.beliefs)
    found = leakage(played, prior, problem)
    assert found.silence_regret == pytest.approx(found.prior_error**2 / 4, abs=1e-12)
    assert found.silence_share == found.expected_regret / found.silence_regret
    assert found.error_share == found.bayes_error / found.prior_error


def test_silence_costs_nothing_where_all_beliefs_have_one_decision():
    """The differences of costs are roundings of 1e-18 there."""
    means = [[0.05, 0.01, 0.0], [0.06, 0.013, 0.0], [0.055, 0.007, 0.001]]
    problem = MarkowitzProblem(means, [np.diag([first, 0.002, 0.001]) for first in (0.001, 0.001, 0.0013)], 1.0)
    prior = uniform_prior(3, 7)
    found = leakage(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, problem)
    assert found.silence_regret == found.expected_regret == found.worst_regret == 0.0
    assert np.isnan(found.silence_share)


def test_a_tiny_share_is_not_lost():
    # A nearly silent mechanism leaks 2ε²/ln 2: a difference of entropies would lose it.
    share, prior = 1e-6, uniform_prior(2, 1)
    table = [[0.5 + share, 0.5 - share], [0.5 - share, 0.5 + share]]
    found = leakage(Mechanism(prior.beliefs, [[0.0], [1.0]], table, np.zeros((2, 2))), prior)
    assert found.mutual_information == pytest.approx(2 * share**2 / np.log(2), rel=1e-3)


# --- input, output --------------------------------------------------------------------------------------------------------


def test_foreign_beliefs_are_refused():
    prior = uniform_prior(2, 4)
    played = mechanism(OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])), prior.beliefs)
    with pytest.raises(
        InputError, match="2 of the prior's 4 beliefs are none of the mechanism's 5, the first at index 1"
    ):
        leakage(played, uniform_prior(2, 3))
    with pytest.raises(InputError, match="the prior has 3 states, the mechanism 2"):
        leakage(played, uniform_prior(3, 3))
    with pytest.raises(InputError, match="prior must be a Prior"):
        leakage(played, [0.5, 0.5])
    for disclosure in (None, "rounded(2)"):
        with pytest.raises(InputError, match="expected a Mechanism"):
            leakage("mechanism", prior, disclosure=disclosure)
    with pytest.raises(InputError, match="the problem has 3 states, the beliefs 2"):
        leakage(played, prior, belief_problem(3))
    with pytest.raises(InputError, match="problem must be a decision problem"):
        leakage(played, prior, "problem")


def test_a_foreign_belief_without_weight_does_no_harm():
    played = mechanism(OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])), [[1.0, 0.0], [0.0, 1.0]])
    prior = Prior([[1.0, 0.0], [0.5, 0.5], [0.0, 1.0]], [0.5, 0.0, 0.5])
    assert leakage(played, prior).mutual_information == 1


def test_it_can_be_saved_and_read(tmp_path):
    problem, prior = belief_problem(2), uniform_prior(2, 4)
    found = leakage(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, problem)
    found.save(tmp_path / "found.npz")
    assert Leakage.load(tmp_path / "found.npz").summary() == found.summary() == repr(found)
    assert "5 beliefs, 5 played decisions" in found.summary()
    assert "2.3219 of 2.3219 bits" in found.summary()


def test_regrets_count_as_they_are_stated_where_a_decision_is_listed_twice() -> None:
    twice = Mechanism(np.eye(2), [[0.5, 0.5], [0.5, 0.5]], np.full((2, 2), 0.5), [[0.0, 1.0], [0.0, 3.0]])
    found = leakage(twice, Prior(np.eye(2), [0.5, 0.5]))
    assert (found.expected_regret, found.worst_regret, found.worst_expected_regret) == (1.0, 3.0, 1.5)


def test_figures_of_a_belief_listed_twice_do_not_depend_on_the_order() -> None:
    beliefs, weights = np.array([[0.2, 0.8], [0.2, 0.8], [0.9, 0.1]]), np.array([0.3, 0.2, 0.5])
    made = mechanism(OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])), beliefs)
    for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
        found = leakage(made, Prior(beliefs[order], weights[order]))
        repeated = repeated_leakage(made, Prior(beliefs[order], weights[order]), (1, 2), rng=np.random.default_rng(0))
        assert found.n_beliefs == 3
        assert found.prior_entropy == repeated.prior_entropy == pytest.approx(oracle.entropy(weights.tolist()))
        assert found.min_entropy_leakage == pytest.approx(np.log2((0.3 + 0.5) / 0.5))
        assert found.mutual_information == pytest.approx(1.0)


def test_a_belief_listed_twice_is_matched_by_place_or_refused() -> None:
    """In the mechanism's order rows are matched by place; in another one figures agree where both rows do."""
    beliefs, weights = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([0.25, 0.25, 0.5])
    moved = [2, 0, 1]
    for second, is_same in (([0.5, 0.5], True), ([0.0, 1.0], False)):
        table = np.array([[0.5, 0.5], second, [0.0, 1.0]])
        played = Mechanism(beliefs, [0, 1], table, np.zeros((3, 2)))
        bits = oracle.mutual_information(weights.tolist(), table.tolist())
        assert leakage(played, Prior(beliefs, weights)).mutual_information == pytest.approx(bits, abs=1e-12)
        other = Prior(beliefs[moved], weights[moved])
        if is_same:
            assert leakage(played, other).mutual_information == pytest.approx(bits, abs=1e-12)
        else:
            with pytest.raises(InputError, match="twice, with different rows"):
                leakage(played, other)
