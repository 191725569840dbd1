"""Observers without a mechanism, and what all adversaries share: against grids, the single-decision queries and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from inscrutable import (
    Adversary,
    BayesianAdversary,
    Budget,
    BudgetAwareAdversary,
    CounterAdversarialDecisionMaker,
    FiniteProblem,
    InputError,
    LinearProblem,
    MarkowitzProblem,
    NaiveAdversary,
    NearOptimalAdversary,
    OriginalDecisionMaker,
    Prior,
    box,
    consistent_beliefs,
    decoy_grid,
    mechanism,
    near_optimal_beliefs,
    simplex_grid,
    uniform_prior,
)
from oracles import enumeration, markets
from sizes import instances
from strategies import KINDS, SEEDS, belief_problem, drawn_problems, line_problem

GRID = simplex_grid(3, 40)


def market_with_values(rng, sign):
    """A small market whose optimal costs are positive, negative, or of both signs by state."""
    market = markets.random_market(rng, 3, 3)
    values = [enumeration.value(market, corner)[0] for corner in np.eye(3)]
    spread = max(values) - min(values) + max(abs(v) for v in values)
    # A constant return of all assets moves every cost.
    target = {"positive": spread, "negative": -spread, "both": 0.0}[sign]
    shift = (np.mean(values) if sign == "both" else (min if sign == "positive" else max)(values)) - target
    moved = markets.Market(market.means + shift, market.covariances, market.risk_aversion)
    return moved, MarkowitzProblem(*moved)


# --- the naive one --------------------------------------------------------------------------------------------------------


@settings(max_examples=instances(40))
@given(drawn_problems(states=(1, 4), assets=(1, 5), min_slack=1e-4))
def test_naive_estimates_are_the_centres_of_consistent_sets(drawn):
    problem, rng = drawn.problem, drawn.rng
    beliefs = rng.dirichlet(np.ones(problem.n_states), 4)
    off = rng.dirichlet(np.ones(problem.n_actions), 3)
    actions = np.vstack([problem.solve(beliefs), off, np.eye(problem.n_actions), off[:1]])
    observer = NaiveAdversary(problem)
    found = observer.estimates(actions)
    for action, estimate in zip(actions, found, strict=True):
        expected = consistent_beliefs(problem, action).center()
        assert estimate == pytest.approx(expected, abs=1e-6, nan_ok=True)
        assert observer.estimate(action) == pytest.approx(expected, abs=1e-6, nan_ok=True)
        assert observer.infer(action).center() == pytest.approx(expected, abs=1e-12, nan_ok=True)
    assert np.isfinite(found[:4]).all()


@settings(max_examples=instances(200))
@given(SEEDS, st.integers(1, 3), st.integers(2, 5), st.sampled_from(KINDS), st.sampled_from([(0, 0), (-4, 0), (1, 2)]))
def test_every_belief_explains_a_decision_where_states_have_the_same_costs(seed, n_states, n_assets, kind, units):
    rng = np.random.default_rng(seed)
    market = markets.random_market(rng, 1, n_assets, **kind)
    means = np.repeat(market.means * 10.0 ** units[0], n_states, axis=0)
    covariances = np.repeat(market.covariances * 10.0 ** units[1], n_states, axis=0)
    problem = MarkowitzProblem(means, covariances, market.risk_aversion)
    action = problem.solve(rng.dirichlet(np.ones(n_states)))
    found = consistent_beliefs(problem, action)
    assert found.dimension == n_states - 1
    assert found.contains(rng.dirichlet(np.ones(n_states)))
    assert NaiveAdversary(problem).estimate(action) == pytest.approx(np.full(n_states, 1 / n_states), abs=1e-9)


def test_the_nearest_explanation_on_request():
    # u_1 = ½ + π·m/4 <= ¾, so everything in asset 1 is best explained by the first state.
    problem = line_problem([1.0, 0.0])
    observer = NaiveAdversary(problem)
    actions = [[1.0, 0.0], [0.625, 0.375], [1.0, 0.0]]
    assert np.isnan(observer.estimates(actions)[:, 0]).tolist() == [True, False, True]
    assert observer.estimates(actions, nearest=True) == pytest.approx(np.array([[1, 0], [0.5, 0.5], [1, 0]]), abs=1e-6)
    assert observer.estimate([1.0, 0.0], nearest=True) == pytest.approx([1, 0], abs=1e-6)
    assert observer.infer([1.0, 0.0]).is_empty


# --- those who allow for a regret -------------------------------------------------------------------------------------------


def some_actions(problem, rng):
    """Optimal decisions, moved ones, and corners."""
    optimal = problem.solve(rng.dirichlet(np.ones(problem.n_states), 2))
    moved = 0.8 * optimal + 0.2 * rng.dirichlet(np.ones(problem.n_actions), 2)
    return np.vstack([optimal, moved, np.eye(problem.n_actions)[:1]])


@settings(max_examples=instances(12))
@given(SEEDS, st.sampled_from(["positive", "negative", "both"]), st.sampled_from([0.05, 0.3, 1.0]))
def test_affordable_beliefs_are_those_of_a_grid(seed, sign, share):
    rng = np.random.default_rng(seed)
    market, problem = market_with_values(rng, sign)
    values = enumeration.values(market, GRID)[0]
    observer = BudgetAwareAdversary(problem, share)
    for action in some_actions(problem, rng):
        excess = GRID @ problem.state_costs(action) - values - share * np.abs(values)
        scale = np.abs(problem.state_costs(action)).max()
        found = observer.infer(action)
        inside = excess <= 0
        judged = np.abs(excess) > 1e-5 * scale
        contained = np.array([found.contains(belief) for belief in GRID[judged][::7]])
        assert np.array_equal(contained, inside[judged][::7])
        assert len(found.pieces) == (1 if values[[0, -1]].min() >= 0 and sign == "positive" else 2)
        if inside.any():
            assert not found.is_empty
            assert sum(found.center()) == pytest.approx(1.0)
            assert found.center() == pytest.approx([np.mean(column) for column in found.vertices().T])
            bounds = found.bounds()
            assert (bounds[:, 0] <= GRID[inside].min(axis=0) + 1e-6).all()
            assert (bounds[:, 1] >= GRID[inside].max(axis=0) - 1e-6).all()
            outside = GRID[~inside & judged][:3]
            for belief in outside:
                distance = np.linalg.norm(GRID[inside] - belief, axis=1).min()
                assert found.distance(belief) <= distance + 1e-6
                member = found.nearest(belief)
                own = member @ problem.state_costs(action) - enumeration.value(market, member)[0]
                assert own <= share * abs(enumeration.value(market, member)[0]) + 1e-5 * scale
        if found.is_empty:
            assert not inside.any()
            assert np.isnan(found.bounds()).all()
            assert np.isnan(found.center()).all()
            assert np.isnan(found.nearest(GRID[0])).all()
            assert found.distance(GRID[0]) == np.inf
            assert found.vertices().shape == (0, 3)
            assert found.dimension == -1


def test_two_pieces_where_the_optimal_cost_changes_its_sign():
    # V(π) = min over two choices: choice 0 costs (−1, 1), choice 1 costs (0, 1). At a share of one half, choice 0 …
    problem = FiniteProblem([[-1.0, 0.0], [1.0, 1.0]])
    found = BudgetAwareAdversary(problem, 0.5).infer(1)
    # … is best, V = 1 − 2p; choice 1 costs 1 − p, regret p: within ½|1 − 2p| for p <= ¼, never where V < 0.
    assert found.bounds()[0] == pytest.approx([0, 0.25], abs=1e-6)
    wide = BudgetAwareAdversary(problem, 1.0).infer(1)
    # p <= |1 − 2p|: p <= ⅓ or p >= 1.
    assert wide.bounds()[0] == pytest.approx([0, 1], abs=1e-6)
    assert [wide.contains([p, 1 - p]) for p in (0.3, 0.35, 0.9, 1.0)] == [True, False, False, True]
    assert wide.distance([0.9, 0.1]) == pytest.approx(0.1 * np.sqrt(2), abs=1e-6)
    assert wide.nearest([0.6, 0.4]) == pytest.approx([1 / 3, 2 / 3], abs=1e-6)
    assert len(wide.pieces) == 2


def test_a_budget_of_regret_is_the_near_optimal_set():
    rng = np.random.default_rng(1)
    problem = MarkowitzProblem(*markets.random_market(rng, 3, 4))
    observer = BudgetAwareAdversary(problem, Budget.regret(0.01))
    for action in some_actions(problem, rng):
        expected = near_optimal_beliefs(problem, action, 0.01)
        assert observer.infer(action).bounds() == pytest.approx(expected.bounds(), abs=1e-9, nan_ok=True)
        assert NearOptimalAdversary(problem, 0.01).infer(action).bounds() == pytest.approx(
            expected.bounds(), abs=1e-9, nan_ok=True
        )


@settings(max_examples=15)
@given(SEEDS, st.sampled_from(["positive", "negative", "both"]))
def test_the_true_belief_is_always_affordable(seed, sign):
    rng = np.random.default_rng(seed)
    _, problem = market_with_values(rng, sign)
    belief = rng.dirichlet(np.ones(3))
    assume(abs(problem.optimal_cost(belief)) > 1e-6)
    for budget in (0.2, Budget.regret(0.01)):
        chooser = CounterAdversarialDecisionMaker(problem, budget=budget, candidates=decoy_grid(problem, 12))
        played = chooser.decide(belief)
        found = BudgetAwareAdversary(problem, budget).infer(played.action)
        assert found.contains(belief)
        assert found.distance(belief) == 0


@pytest.mark.parametrize("seed", [55, 66, 119, 123])
def test_budgets_near_the_accuracy_of_costs_have_a_set_that_contains_the_belief(seed):
    rng = np.random.default_rng(seed)
    n_states, n_actions = rng.integers(2, 5), rng.integers(2, 5)
    factors = rng.normal(size=(n_states, n_actions, n_actions))
    covariances = 0.01 * (factors @ factors.swapaxes(1, 2) + np.eye(n_actions))
    problem = MarkowitzProblem(0.02 * rng.normal(size=(n_states, n_actions)), covariances, 5.0)
    for budget in (1e-7, 1e-6, 1e-5):
        belief = rng.dirichlet(np.ones(n_states) * rng.choice([0.3, 1.0]))
        found = BudgetAwareAdversary(problem, budget).infer(problem.solve(belief))
        assert found.contains(belief)
        low, high = found.bounds().T
        assert (low <= belief + 1e-5).all()
        assert (belief <= high + 1e-5).all()


@pytest.mark.parametrize("budget", [0.3, Budget.regret(0.02)])
def test_estimates_without_a_prior_are_members(budget):
    rng = np.random.default_rng(4)
    problem = MarkowitzProblem(*markets.random_market(rng, 3, 3, positive_value=True))
    observer = BudgetAwareAdversary(problem, budget)
    actions = some_actions(problem, rng)
    for action, estimate in zip(actions, observer.estimates(actions), strict=True):
        found = observer.infer(action)
        if found.is_empty:
            assert np.isnan(estimate).all()
            assert np.isfinite(observer.estimate(action, nearest=True)).all()
            continue
        assert found.contains(estimate)
        middle = found.bounds().mean(axis=1)
        assert estimate == pytest.approx(found.nearest(middle / middle.sum()), abs=1e-9)
        assert observer.estimate(action) == pytest.approx(estimate, abs=1e-9)


@pytest.mark.parametrize("sign", ["positive", "negative", "both"])
def test_estimates_under_a_prior_are_means_over_the_set(sign):
    rng = np.random.default_rng(6)
    _, problem = market_with_values(rng, sign)
    prior = Prior(simplex_grid(3, 12), rng.dirichlet(np.ones(91)))
    actions = some_actions(problem, rng)
    observers = (BudgetAwareAdversary(problem, 0.2, prior=prior), NearOptimalAdversary(problem, 0.05, prior=prior))
    for observer in observers:
        found = observer.estimates(actions)
        for action, estimate in zip(actions, found, strict=True):
            held = observer.infer(action)
            inside = np.array([held.contains(belief) for belief in prior.beliefs])
            if inside.any():
                weights = prior.weights * inside
                assert estimate == pytest.approx(weights @ prior.beliefs / weights.sum(), abs=1e-9)
            else:
                assert np.isnan(estimate).all()
                near = observer.estimate(action, nearest=True)
                assert any(np.array_equal(near, belief) for belief in prior.beliefs)


def test_few_beliefs_leave_a_set_empty_on_a_prior():
    problem = belief_problem(3)
    observer = NearOptimalAdversary(problem, 1e-6, prior=uniform_prior(3, 1))
    action = problem.solve([0.4, 0.35, 0.25])
    assert np.isnan(observer.estimate(action)).all()
    assert observer.estimate(action, nearest=True).tolist() == [1, 0, 0]


# --- what all share ---------------------------------------------------------------------------------------------------------


def everyone(problem):
    """One of each kind."""
    prior = uniform_prior(problem.n_states, 3)
    played = mechanism(OriginalDecisionMaker(problem), prior.beliefs)
    return [
        NaiveAdversary(problem),
        NearOptimalAdversary(problem, 0.1),
        BudgetAwareAdversary(problem, Budget.regret(0.1)),
        NearOptimalAdversary(problem, 0.1, prior=prior),
        BudgetAwareAdversary(problem, 0.1, prior=prior),
        BayesianAdversary(played, prior),
    ]


@pytest.mark.parametrize(
    "problem",
    [
        belief_problem(3),
        belief_problem(2),
        belief_problem(1),
        FiniteProblem([[0.0, 1.0, 0.4], [1.0, 0.0, 0.4]]),
        LinearProblem([[1.0, -1.0], [-1.0, 1.0]], box(np.zeros(2), np.ones(2))),
        MarkowitzProblem([[0.1], [0.2]], [[[1.0]], [[2.0]]], 1.0),
    ],
    ids=["three", "two", "one state", "choices", "linear", "one asset"],
)
def test_all_adversaries_speak_the_same_language(problem):
    beliefs = (
        np.random.default_rng(0).dirichlet(np.ones(problem.n_states), 4) if problem.n_states > 1 else np.ones((4, 1))
    )
    actions = problem.solve(beliefs)
    for observer in everyone(problem):
        assert isinstance(observer, Adversary)
        assert type(observer).__name__ in repr(observer)
        found = observer.estimates(actions, nearest=True)
        assert found.shape == (4, problem.n_states)
        assert np.isfinite(found).all()
        assert found.sum(axis=1) == pytest.approx(1)
        assert found.min() >= -1e-12
        assert observer.estimates(actions[:0]).shape == (0, problem.n_states)
        for action, estimate in zip(actions, found, strict=True):
            assert observer.estimate(action, nearest=True) == pytest.approx(estimate, abs=1e-6)
            observer.infer(action)


def test_input_is_checked():
    problem = belief_problem(2)
    for observer in (NaiveAdversary(problem), NearOptimalAdversary(problem, 0.1), BudgetAwareAdversary(problem, 0.1)):
        with pytest.raises(InputError, match="outside the feasible set"):
            observer.estimates([[0.5, 0.6]])
        with pytest.raises(InputError, match="many decisions"):
            observer.estimates([0.5, 0.5])
        with pytest.raises(InputError, match="one decision"):
            observer.estimate([[0.5, 0.5]])
        with pytest.raises(InputError, match="expected 2"):
            observer.infer([1.0])
    with pytest.raises(InputError, match="problem must be a decision problem"):
        NaiveAdversary("problem")
    with pytest.raises(InputError, match="regret must be at least 0"):
        NearOptimalAdversary(problem, -1)
    with pytest.raises(InputError, match="budget must be at least 0"):
        BudgetAwareAdversary(problem, -0.1)
    with pytest.raises(InputError, match="the prior has 3 states, the problem 2"):
        BudgetAwareAdversary(problem, 0.1, prior=uniform_prior(3, 2))
    with pytest.raises(InputError, match="prior must be a Prior"):
        NearOptimalAdversary(problem, 0.1, prior=[0.5, 0.5])
    with pytest.raises(InputError, match=r"give Budget\.regret"):
        BudgetAwareAdversary(line_problem([4.0, 0.0]), 1.5).infer([0.5, 0.5])


def test_equal_decisions_are_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
    observer, asked = NearOptimalAdversary(problem, 0.001), []
    infer = observer.infer
    monkeypatch.setattr(observer, "infer", lambda action: asked.append(action) or infer(action))
    actions = np.array([[0.5, 0.5], [0.52, 0.48], [0.5, 0.5], [0.5 + 1e-13, 0.5 - 1e-13]])
    found = observer.estimates(actions)
    assert len(asked) == 2
    np.testing.assert_array_equal(found[[0, 0]], found[[2, 3]])
    assert found.shape == (4, 2)
