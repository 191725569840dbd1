"""What a rival wants: worth of reading and of the secret, copying cannot be stopped, Stackelberg against plain programmes."""

from __future__ import annotations

import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog

from inscrutable import (
    Budget,
    CoinDecisionMaker,
    CounterAdversarialDecisionMaker,
    ExponentialDecisionMaker,
    FiniteProblem,
    InputError,
    MarkowitzProblem,
    Mechanism,
    NamingError,
    OriginalDecisionMaker,
    Prior,
    ProbabilisticDecisionMaker,
    RateDistortionDecisionMaker,
    RivalProblem,
    RoundingDecisionMaker,
    SequentialDecisionMaker,
    SquaredError,
    StackelbergDecisionMaker,
    UniformDecisionMaker,
    decoy_grid,
    leakage,
    mechanism,
    path_leakage,
    uniform_prior,
)
from inscrutable.mechanisms.chains import resting_chain
from oracles import markets
from sizes import instances, paired
from strategies import SEEDS
from test_leakage import drawn
from test_rate_distortion import market, silence

Array = NDArray[np.float64]
FRESH = int(os.environ.get("FRESH_SEED", "7"))
PRECISE = 1e-7


def least_cost(costs: Array, law: list[float], beliefs: list[list[float]]) -> float:
    """The Bayes risk of a law, answer by answer."""
    risks = []
    for answer in range(costs.shape[1]):
        risk = 0.0
        for weight, belief in zip(law, beliefs, strict=True):
            risk += weight * sum(p * costs[i, answer] for i, p in enumerate(belief))
        risks.append(risk)
    return min(risks)


def by_loops(costs: Array, prior: Prior, table: Array) -> dict[str, float]:
    """All figures of a rival with finitely many answers, by their definitions."""
    weights, beliefs = prior.weights.tolist(), prior.beliefs.tolist()
    before = least_cost(costs, weights, beliefs)
    known = sum(least_cost(costs, [w], [b]) for w, b in zip(weights, beliefs, strict=True))
    after = sum(least_cost(costs, (prior.weights * column).tolist(), beliefs) for column in table.T)
    return {"prior_loss": before, "bayes_loss": after, "worth": before - after, "secret_worth": before - known}


# --- leakage ------------------------------------------------------------------------------------------------------------


@settings(max_examples=instances(60))
@given(drawn(), st.integers(1, 5), st.sampled_from([0.0, 1e6]))
def test_worths_are_their_definitions(case, n_answers, common):
    n_states = case.prior.beliefs.shape[1]
    costs = case.rng.normal(size=(n_states, n_answers)).round(1) + common * case.rng.random((n_states, 1))
    for loss, table in ((RivalProblem(FiniteProblem(costs)), costs), (NamingError(), 1.0 - np.eye(n_states))):
        found = leakage(case.mechanism, case.prior, loss=loss)
        expected = by_loops(table, case.prior, case.mechanism.probabilities)
        for name, value in expected.items():
            assert getattr(found, name) == pytest.approx(value, abs=1e-9 * (1.0 + common)), name
        assert 0.0 <= found.worth <= found.secret_worth


@settings(max_examples=40)
@given(drawn())
def test_the_square_error_is_what_it_was(case):
    plain, asked = leakage(case.mechanism, case.prior), leakage(case.mechanism, case.prior, loss=SquaredError())
    for name in plain.__dataclass_fields__:
        if name != "loss":
            assert getattr(plain, name) == pytest.approx(getattr(asked, name), abs=0, nan_ok=True), name
    assert asked.bayes_loss == pytest.approx(plain.bayes_error**2, abs=1e-14)
    assert asked.prior_loss == pytest.approx(asked.secret_worth, abs=0)


def test_silence_is_worth_nothing_and_the_belief_itself_all():
    prior = uniform_prior(3, 4)
    rival = RivalProblem(MarkowitzProblem(np.eye(3), [np.eye(3)] * 3, 1.0))
    silent = Mechanism(prior.beliefs, [[0.0]], np.ones((len(prior), 1)), np.zeros((len(prior), 1)))
    open_book = Mechanism(
        prior.beliefs, np.arange(len(prior))[:, None] * 1.0, np.eye(len(prior)), np.ones((len(prior),) * 2)
    )
    for loss in (SquaredError(), NamingError(), rival):
        assert leakage(silent, prior, loss=loss).worth == pytest.approx(0.0, abs=1e-15)
        told = leakage(open_book, prior, loss=loss)
        assert told.worth == pytest.approx(told.secret_worth, rel=1e-12)
        assert told.secret_worth > 0


@pytest.mark.parametrize(
    ("loss", "said"),
    [
        ("naming", "loss must be SquaredError"),
        (NamingError, "loss must be SquaredError"),
        (RivalProblem(FiniteProblem(np.eye(2))), "the rival's problem has 2 states, the beliefs 3"),
    ],
)
def test_what_is_no_loss_on_these_states_is_refused(loss, said):
    prior = uniform_prior(3, 2)
    played = mechanism(OriginalDecisionMaker(FiniteProblem(np.eye(3))), prior.beliefs)
    with pytest.raises(InputError, match=said):
        leakage(played, prior, loss=loss)
    with pytest.raises(InputError, match=said):
        StackelbergDecisionMaker(FiniteProblem(np.eye(3)), 0.1, prior=prior, loss=loss)
    with pytest.raises(InputError, match=said):
        path_leakage(resting_chain(prior, 0.5), played, 2, rng=np.random.default_rng(0), loss=loss)


def test_a_rival_that_names_its_states_otherwise_is_refused():
    import pandas as pd

    own = FiniteProblem(pd.DataFrame(np.eye(2), ["calm", "crisis"], ["a", "b"]))
    other = RivalProblem(FiniteProblem(pd.DataFrame(np.eye(2), ["crisis", "calm"], ["a", "b"])))
    prior = uniform_prior(2, 2)
    with pytest.raises(InputError, match="in the same order"):
        leakage(mechanism(OriginalDecisionMaker(own), prior.beliefs), prior, own, loss=other)


# --- nobody can be stopped from copying ---------------------------------------------------------------------------------


def makers_on(problem, prior, candidates, limit):
    """Every decision maker of single beliefs, each with some of its budget; those on weights where there are weights."""
    known = {"prior": prior, "candidates": candidates}
    own, own_loss = Budget.regret(limit), RivalProblem(problem)
    yield OriginalDecisionMaker(problem)
    yield CounterAdversarialDecisionMaker(problem, budget=own, candidates=candidates)
    yield ProbabilisticDecisionMaker(problem, budget=own, candidates=candidates)
    yield CoinDecisionMaker(problem, 0.4, decoy=prior.mean)
    yield ExponentialDecisionMaker(problem, 3.0 / limit, candidates=candidates)
    yield UniformDecisionMaker(problem, own, candidates=candidates)
    yield RateDistortionDecisionMaker(problem, own, **known)
    yield StackelbergDecisionMaker(problem, own, **known, gap=0.01)
    yield StackelbergDecisionMaker(problem, own, **known, gap=0.01, loss=own_loss)
    yield StackelbergDecisionMaker(problem, own, **known, gap=0.01, loss=NamingError())
    if isinstance(problem, MarkowitzProblem):
        yield RoundingDecisionMaker(problem, 0.2)


@pytest.mark.parametrize(("kind", "share"), paired(["market", "choices"], [0.2, 0.7]))
def test_nobody_can_be_stopped_from_copying(kind, share):
    """W ≥ r₀ − Eρ for a rival with the agent's own problem, and W ≤ r₀."""
    rng = np.random.default_rng([FRESH, kind == "market"])
    beliefs, limit = uniform_prior(3, 4).beliefs, 0.0
    while limit < 1e-12:  # one choice may be the best under every belief
        problem = market(FRESH % 50)[0] if kind == "market" else FiniteProblem(rng.normal(size=(3, 5)))
        prior, candidates = Prior(beliefs, rng.dirichlet(np.ones(len(beliefs)))), decoy_grid(problem, 6)
        limit = share * leakage(mechanism(OriginalDecisionMaker(problem), beliefs), prior, problem).silence_regret
    loss = RivalProblem(problem)
    for maker in makers_on(problem, prior, candidates, limit):
        found = leakage(mechanism(maker, beliefs), prior, problem, loss=loss)
        small = 1e-9 * found.silence_regret
        assert found.secret_worth == pytest.approx(found.silence_regret, rel=1e-9)
        assert found.worth >= found.silence_regret - found.expected_regret - small, maker
        assert found.worth <= found.secret_worth + small, maker


def test_copying_is_all_that_can_be_done_where_every_decision_suits_its_own_posterior():
    problem = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
    prior = Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5])
    for wrong in (0.0, 0.1, 0.3, 0.5):
        played = Mechanism(prior.beliefs, [0, 1], [[1 - wrong, wrong], [wrong, 1 - wrong]], [[0.0, 1.0], [1.0, 0.0]])
        found = leakage(played, prior, problem, loss=RivalProblem(problem))
        assert found.worth == pytest.approx(found.silence_regret - found.expected_regret, abs=1e-12)


# --- Stackelberg --------------------------------------------------------------------------------------------------------


def by_programme(prior: Prior, regrets: Array, limit: float, costs: Array) -> float:
    """The largest loss of a rival with the answers `costs` (X,A): a dense programme with a row for each decision and answer."""
    (n_beliefs, n_columns), n_answers = regrets.shape, costs.shape[1]
    pairs = n_beliefs * n_columns
    lost = prior.weights[:, None] * (prior.beliefs @ costs)
    rows, sides = [], []
    for m in range(n_columns):
        for a in range(n_answers):
            row = np.zeros(pairs + n_columns)
            row[m:pairs:n_columns], row[pairs + m] = -lost[:, a], 1.0
            rows.append(row)
            sides.append(0.0)
    sums = np.zeros((n_beliefs, pairs + n_columns))
    for b in range(n_beliefs):
        row = np.zeros(pairs + n_columns)
        row[b * n_columns : (b + 1) * n_columns] = regrets[b]
        rows.append(row)
        sides.append(limit)
        sums[b, b * n_columns : (b + 1) * n_columns] = 1.0
    objective = np.concatenate([np.zeros(pairs), -np.ones(n_columns)])
    bounds = [(0, None)] * pairs + [(None, None)] * n_columns
    return -float(linprog(objective, np.array(rows), sides, sums, np.ones(n_beliefs), bounds=bounds).fun)


@settings(max_examples=instances(40))
@given(SEEDS, st.integers(2, 3), st.integers(1, 16), st.sampled_from([0.0, 0.05, 0.3, 2.0]), st.booleans())
def test_a_programme_over_all_answers_agrees(seed, n_states, n_answers, share, ties):
    rng = np.random.default_rng(seed)
    choices = rng.normal(size=(n_states, rng.integers(1, 6)))
    answers = rng.normal(size=(n_states, n_answers))
    if ties:
        choices, answers = np.hstack([choices, choices[:, :1]]).round(1), answers.round(0)
    beliefs = np.vstack([rng.dirichlet(np.ones(n_states), rng.integers(1, 7)), np.eye(n_states)])
    weights = rng.dirichlet(np.ones(len(beliefs)))
    weights[-1] = 0.0
    prior, problem = Prior(beliefs, weights / weights.sum()), FiniteProblem(choices)
    regrets = beliefs @ choices - (beliefs @ choices).min(axis=1, keepdims=True)
    limit = share * float(regrets.max())
    for loss, costs in ((RivalProblem(FiniteProblem(answers)), answers), (NamingError(), 1.0 - np.eye(n_states))):
        found = StackelbergDecisionMaker(
            problem,
            Budget.regret(limit),
            prior=prior,
            loss=loss,
            plausible_only=False,
            candidates=np.eye(choices.shape[1]),
        )
        expected = by_programme(prior, regrets, limit, costs)
        assert found.value == pytest.approx(expected, abs=PRECISE)
        assert found.bound >= expected - PRECISE
        assert found.bound <= expected + 2e-6 * max(1.0, float(np.abs(costs).max()))
        told = leakage(found.mechanism, prior, loss=loss)
        assert told.bayes_loss == pytest.approx(found.value, abs=1e-9)
        assert found.mechanism.expected_regrets.max() <= limit + 1e-8


@pytest.mark.parametrize("share", [0.1, 0.6])
def test_a_rival_with_a_curved_cost_is_bounded_and_answers_are_generated(share):
    """Against a programme over the answers of a fine grid: the grid's rival has fewer answers, so loses at least as much."""
    problem, prior, candidates = market(3, 5)
    rival, coarse = market(11)[0], decoy_grid(problem, 3)
    actions = np.vstack([coarse.actions[coarse.distinct], problem.solve(prior.mean)[None]])
    regrets = prior.beliefs @ problem.state_costs(actions).T - problem.optimal_cost(prior.beliefs)[:, None]
    regrets = np.maximum(regrets, 0.0)
    limit = max(share * silence(problem, prior, candidates), 1.01 * float(regrets.min(axis=1).max()))
    known = {"prior": prior, "loss": RivalProblem(rival), "plausible_only": False}
    found = StackelbergDecisionMaker(problem, Budget.regret(limit), candidates=actions, gap=1e-4, **known)
    assert found.gap <= 1e-4
    answers = rival.state_costs(rival.solve(uniform_prior(3, 12).beliefs)).T
    above = by_programme(prior, regrets, limit, answers)
    least = float(prior.weights @ rival.optimal_cost(prior.beliefs))
    assert found.value <= above + PRECISE
    assert found.bound - least >= 0.97 * (above - least)


def test_the_square_error_takes_todays_way():
    problem, prior, candidates = market(1)
    limit = Budget.regret(0.2 * silence(problem, prior, candidates))
    one = StackelbergDecisionMaker(problem, limit, prior=prior, candidates=candidates)
    other = StackelbergDecisionMaker(problem, limit, prior=prior, candidates=candidates, loss=SquaredError())
    assert (one.value, one.bound, one.gap) == (other.value, other.bound, other.gap)
    assert np.array_equal(one.mechanism.probabilities, other.mechanism.probabilities)


def test_large_games_are_proved_by_parts():
    """Decisions and pairs that are left out at first: value and bound meet, the rival loses more than of another rule."""
    problem, prior, candidates = market(5, 12)
    limit = Budget.regret(0.3 * silence(problem, prior, candidates))
    found = StackelbergDecisionMaker(problem, limit, prior=prior, candidates=candidates, gap=1e-3, loss=NamingError())
    assert len(prior) * len(candidates.distinct) > 4_000
    assert found.gap <= 1e-3
    assert found.mechanism.expected_regrets.max() <= limit.limits(np.ones(1))[0] * (1 + 1e-9)
    square = StackelbergDecisionMaker(problem, limit, prior=prior, candidates=candidates)
    assert leakage(square.mechanism, prior, loss=NamingError()).bayes_loss <= found.bound + 1e-12


def test_many_decisions_for_few_beliefs_are_proved():
    """Once the bound stood still where none of the decisions tried first could enter, or pairs left and came back."""
    problem = MarkowitzProblem(*markets.random_market(np.random.default_rng([13, 3]), 3, 4))
    prior, candidates = uniform_prior(3, 5), decoy_grid(problem, 20)
    limit = Budget.regret(0.2 * silence(problem, prior, candidates))
    rounds: list[int] = []
    known = {"prior": prior, "candidates": candidates, "loss": NamingError()}
    found = StackelbergDecisionMaker(problem, limit, gap=0.002, **known)
    found.solve(progress=lambda done, most: rounds.append(done))
    assert found.gap <= 0.002
    assert len(rounds) <= 15


def test_beliefs_off_the_prior_answer_within_their_budget():
    problem, prior, candidates = market(2, 5)
    limit = 0.3 * silence(problem, prior, candidates)
    maker = StackelbergDecisionMaker(
        problem, Budget.regret(limit), prior=prior, candidates=candidates, loss=NamingError()
    )
    others = np.random.default_rng(FRESH).dirichlet(np.ones(3), 5)
    assert mechanism(maker, others).expected_regrets.max() <= limit * (1 + 1e-9)
    again = leakage(mechanism(maker, prior.beliefs), prior, loss=NamingError())
    assert again.bayes_loss == pytest.approx(maker.value, rel=1e-6)
    assert "share of states named wrongly" in maker.summary()


# --- paths --------------------------------------------------------------------------------------------------------------


def test_losses_along_a_path_are_those_of_every_sequence():
    """A chain of three beliefs and two decisions: laws by enumeration."""
    rng = np.random.default_rng(FRESH)
    prior = Prior(np.array([[0.9, 0.1], [0.5, 0.5], [0.2, 0.8]]), [0.3, 0.4, 0.3])
    chain, table = resting_chain(prior, 0.7), rng.dirichlet(np.ones(2), 3)
    played = Mechanism(prior.beliefs, [0, 1], table, np.zeros((3, 2)))
    costs = rng.normal(size=(2, 3))
    for loss, answers in ((RivalProblem(FiniteProblem(costs)), costs), (NamingError(), 1.0 - np.eye(2))):
        found = path_leakage(chain, played, 3, rng=rng, loss=loss)
        laws, step = [prior.weights], chain.transition.toarray()
        for t in range(3):
            laws = [law * column for law in laws for column in table.T]
            expected = sum(least_cost(answers, law.tolist(), prior.beliefs.tolist()) for law in laws)
            assert found.loss[t] == pytest.approx(expected, abs=1e-12)
            laws = [law @ step for law in laws]
        before = least_cost(answers, prior.weights.tolist(), prior.beliefs.tolist())
        assert found.prior_loss == pytest.approx(np.full(3, before), abs=1e-12)
        assert found.worth == pytest.approx(found.prior_loss - found.loss, abs=1e-12)
        assert "the rival's loss" in found.summary()
    plain = path_leakage(chain, played, 3, rng=rng)
    assert plain.loss is None
    square = path_leakage(chain, played, 3, rng=rng, loss=SquaredError())
    assert square.loss == pytest.approx(plain.bayes_error**2, abs=1e-12)


def test_losses_along_sampled_paths_are_within_their_errors():
    rng = np.random.default_rng(FRESH)
    prior = Prior(np.array([[0.9, 0.1], [0.5, 0.5], [0.2, 0.8]]), [0.3, 0.4, 0.3])
    chain = resting_chain(prior, 0.7)
    played = Mechanism(prior.beliefs, [0, 1], rng.dirichlet(np.ones(2), 3), np.zeros((3, 2)))
    exact = path_leakage(chain, played, 6, rng=rng, n_draws=10_000, loss=NamingError())
    drawn_ones = path_leakage(chain, played, 6, rng=rng, n_draws=60, loss=NamingError())
    assert exact.n_draws == 0
    assert drawn_ones.n_draws == 60
    assert np.all(np.abs(exact.loss - drawn_ones.loss) <= 5.0 * drawn_ones.loss_se + 1e-9)


class DoubledError(SquaredError):
    """Twice the square error."""

    def excess(self, beliefs: NDArray[np.float64], estimates: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(2.0 * super().excess(beliefs, estimates))


def test_no_rule_is_solved_for_a_loss_that_it_does_not_know() -> None:
    """The rule for the square error was returned, with its value and bound in the unit of the other loss."""
    problem, prior = FiniteProblem(1.0 - np.eye(3)), Prior(np.eye(3), [0.5, 0.3, 0.2])
    made = {"budget": Budget.regret(0.1), "loss": DoubledError()}
    with pytest.raises(InputError, match="no rule is made against the loss"):
        StackelbergDecisionMaker(problem, prior=prior, **made)
    with pytest.raises(InputError, match="no rule is made against the loss"):
        SequentialDecisionMaker(problem, chain=resting_chain(prior, 0.8), rng=np.random.default_rng(0), **made)
    played = StackelbergDecisionMaker(problem, Budget.regret(0.1), prior=prior).mechanism
    doubled, once = (leakage(played, prior, loss=loss).secret_worth for loss in (DoubledError(), SquaredError()))
    assert doubled == pytest.approx(2.0 * once)
