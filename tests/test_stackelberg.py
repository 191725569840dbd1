"""The largest Bayes error inside per-belief budgets: cutting planes by HiGHS, closed forms, random rivals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import linprog

from inscrutable import (
    Budget,
    DecisionStatus,
    FiniteProblem,
    MarkowitzProblem,
    OriginalDecisionMaker,
    Prior,
    StackelbergDecisionMaker,
    decoy_grid,
    mechanism,
    uniform_prior,
)
from inscrutable.decision_makers.aware import stackelberg_solver
from inscrutable.decision_makers.aware.stackelberg_game import Game
from inscrutable.experiments.random_markets import random_market
from inscrutable.privacy.leaks import silence_regret
from oracles import markets
from sizes import audited, instances
from strategies import SEEDS
from test_rate_distortion import CORNERS, TWO, market, regrets_of, silence

Array = NDArray[np.float64]

CLOSE = 1e-6
"""Share of the bound by which value and bound may differ in small cases."""


def square_error(prior: Prior, shares: Array) -> float:
    """Mean square error of posterior means, decision by decision."""
    total = 0.0
    for column in shares.T:
        joint = prior.weights * column
        if joint.sum() > 0:
            mean = joint @ prior.beliefs / joint.sum()
            total += float(joint @ ((prior.beliefs - mean) ** 2).sum(axis=1))
    return total


def prior_error(prior: Prior) -> float:
    """Mean square distance from the prior's mean."""
    return float(prior.weights @ ((prior.beliefs - prior.mean) ** 2).sum(axis=1))


def by_cutting_planes(prior: Prior, regrets: Array, limits: Array) -> tuple[float, float]:
    """Lower and upper bound of the largest error: max Σ p|π|² − Σ t_m with t_m ≥ 2μ·a_m − |μ|² w_m at every μ met."""
    (n_beliefs, n_columns), weights = regrets.shape, prior.weights
    size = n_beliefs * n_columns
    total = float(weights @ (prior.beliefs**2).sum(axis=1))
    sums, budgets = np.zeros((n_beliefs, size + n_columns)), np.zeros((n_beliefs, size + n_columns))
    for b in range(n_beliefs):
        sums[b, b * n_columns : (b + 1) * n_columns] = 1.0
        budgets[b, b * n_columns : (b + 1) * n_columns] = regrets[b]
    cuts: list[Array] = []

    def cut(means: Array) -> None:
        for m, mean in enumerate(means):
            row = np.zeros(size + n_columns)
            row[m:size:n_columns] = weights * (2.0 * prior.beliefs @ mean - mean @ mean)
            row[size + m] = -1.0
            cuts.append(row)

    cut(np.tile(prior.mean, (n_columns, 1)))
    for belief in prior.beliefs:
        cut(np.tile(belief, (n_columns, 1)))
    low, high = 0.0, total
    objective = np.concatenate([np.zeros(size), np.ones(n_columns)])
    for _ in range(60):
        rows = np.vstack([budgets, np.array(cuts)])
        sides = np.concatenate([limits, np.zeros(len(cuts))])
        found = linprog(objective, rows, sides, sums, np.ones(n_beliefs), bounds=(0, None), method="highs")
        high = min(high, total - found.fun)
        shares = np.maximum(found.x[:size].reshape(n_beliefs, n_columns), 0.0)
        low = max(low, square_error(prior, shares))
        if high - low <= 1e-7:
            break
        played = weights @ shares
        sums_of = (shares * weights[:, None]).T @ prior.beliefs
        cut(np.where(played[:, None] > 1e-9, sums_of / np.maximum(played, 1e-9)[:, None], prior.mean))
    return low, high


@pytest.mark.parametrize("limit", [0.0, 0.1, 0.25, 0.5, 0.8])
def test_a_fair_coin_is_hidden_as_far_as_its_budget_goes(limit: float) -> None:
    """Playing the wrong choice with probability r leaves Σ p |π|² − E|μ|² = 1 − (r² + (1−r)²)."""
    found = StackelbergDecisionMaker(TWO, Budget.regret(limit), prior=CORNERS)
    wrong = min(limit, 0.5)
    assert found.value == pytest.approx(1.0 - wrong**2 - (1 - wrong) ** 2, abs=1e-5)
    assert found.value <= found.bound <= found.value * (1 + CLOSE) + 1e-12


@pytest.mark.parametrize("seed", range(instances(3, least=1)))
@pytest.mark.parametrize("share", [0.05, 0.5])
def test_cutting_planes_agree(seed: int, share: float) -> None:
    problem, _, _ = market(seed)
    beliefs = uniform_prior(3, 2).beliefs
    weights = np.random.default_rng(seed).dirichlet(np.ones(len(beliefs)))
    prior, candidates = Prior(beliefs, weights), decoy_grid(problem, 2)
    limit = share * silence(problem, prior, candidates)
    found = StackelbergDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates)
    actions = candidates.actions[candidates.distinct]
    regrets = regrets_of(problem, prior.beliefs, actions)
    low, high = by_cutting_planes(prior, regrets, np.full(len(beliefs), limit))
    assert high - low < 1e-4
    assert low <= found.bound + 1e-9
    assert found.value <= high + 1e-9
    assert found.value >= low * (1 - CLOSE)
    assert found.gap <= CLOSE


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("share", [0.003, 0.1, 0.5, 1.0])
def test_value_and_bound_meet_within_the_budgets(seed: int, share: float) -> None:
    problem, prior, candidates = market(seed)
    limit = share * silence(problem, prior, candidates)
    found = StackelbergDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates)
    played = found.mechanism
    regrets = regrets_of(problem, prior.beliefs, played.actions)
    assert (played.probabilities * regrets).sum(axis=1).max() <= limit * (1 + 1e-9)
    assert square_error(prior, played.probabilities) == pytest.approx(found.value, rel=1e-9)
    assert found.gap <= CLOSE
    assert found.status is DecisionStatus.GAP_REACHED
    assert found.bound <= prior_error(prior) + 1e-12
    again = mechanism(found, prior.beliefs)
    assert square_error(prior, again.probabilities) == pytest.approx(found.value, rel=1e-6)


@pytest.mark.parametrize("width", [8, 16, 32])
@pytest.mark.parametrize("seed", [16, 22, 28])
def test_beliefs_of_hardly_any_weight_hold_nothing_up(seed: int, width: int) -> None:
    problem, flat, candidates = market(seed, 6)
    weights = np.exp(-width * np.random.default_rng(seed).random(len(flat.beliefs)))
    prior = Prior(flat.beliefs, weights / weights.sum())
    limit = 0.1 * silence(problem, prior, candidates)
    found = StackelbergDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates)
    assert found.gap <= CLOSE
    assert found.status is DecisionStatus.GAP_REACHED
    assert found.mechanism.expected_regrets.max() <= limit * (1 + 1e-9)


def test_columns_left_out_and_priced_give_what_all_columns_give(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, prior, candidates = market(2, 10)
    budget = Budget.regret(0.3 * silence(problem, prior, candidates))
    whole = StackelbergDecisionMaker(problem, budget, prior=prior, candidates=candidates, gap=1e-5)
    assert whole.status is DecisionStatus.GAP_REACHED
    for name, few in (("_LARGE", 0.0), ("_FIRST_COLUMNS", 8), ("_ADDED", 10)):
        monkeypatch.setattr(stackelberg_solver, name, few)
    priced = StackelbergDecisionMaker(problem, budget, prior=prior, candidates=candidates, gap=1e-3)
    assert priced.gap <= 1e-3
    assert priced.value <= whole.bound * (1 + 1e-9)
    assert whole.value <= priced.bound * (1 + 1e-9)


def test_estimates_of_their_own_bound_every_error_and_every_row_keeps_its_budget() -> None:
    """The solver's estimates, priced row by row with HiGHS, prove its bound."""
    rng = np.random.default_rng(4)
    points, weights = rng.normal(size=(12, 2)), rng.dirichlet(np.ones(12))
    costs = rng.exponential(3.0, size=(12, 30))
    costs[np.arange(12), np.arange(12)] = 0.0
    allowed = (rng.random(costs.shape) < 0.8) | (costs == 0.0)
    game = Game(points - weights @ points, weights, costs, allowed)
    found = stackelberg_solver.largest_error(game, 1e-7)
    assert np.all(found.rows[~allowed] == 0.0)
    np.testing.assert_allclose(found.rows.sum(axis=1), 1.0, atol=1e-9)
    assert np.all((found.rows * costs).sum(axis=1) <= 1 + 1e-9)
    total = 0.0
    for b in range(12):
        gains = ((game.points[b] - found.estimates) ** 2).sum(axis=1)[allowed[b]]
        ones = np.ones((1, len(gains)))
        total -= weights[b] * linprog(-gains, costs[b][None, allowed[b]], [1.0], ones, [1.0], bounds=(0, None)).fun
    assert total == pytest.approx(found.bound, rel=1e-7)
    assert found.error <= found.bound <= found.error * (1 + 2e-7)


def test_the_bound_follows_from_the_estimates_of_the_definition() -> None:
    """A dual point of one's own: no rows beat posterior means by more than HiGHS finds row by row."""
    problem, prior, candidates = market(1, 4)
    limit = 0.3 * silence(problem, prior, candidates)
    found = StackelbergDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates)
    gains = ((prior.beliefs[:, None] - found.estimates[None]) ** 2).sum(axis=2)
    total = 0.0
    for b in np.flatnonzero(prior.weights):
        ones = np.ones((1, gains.shape[1]))
        best = linprog(-gains[b], found.mechanism.regrets[[b]], [limit], ones, [1.0], bounds=(0, None))
        total -= prior.weights[b] * best.fun
    assert total >= found.value - 1e-9


@settings(max_examples=instances(15), deadline=None)
@given(seed=st.integers(0, 5), limit_share=st.floats(0.01, 1.0), draw=SEEDS)
def test_no_random_mechanism_within_the_budgets_hides_more(seed: int, limit_share: float, draw: int) -> None:
    problem, prior, candidates = market(seed, 5)
    rng = np.random.default_rng(draw)
    limit = limit_share * silence(problem, prior, candidates)
    regrets = regrets_of(problem, prior.beliefs, candidates.actions)
    own = np.eye(len(candidates))[regrets.argmin(axis=1)]
    target = rng.dirichlet(np.full(len(candidates), 0.1), size=len(regrets) if rng.random() < 0.5 else 1)
    target = np.broadcast_to(target, regrets.shape)
    least, spent = (own * regrets).sum(axis=1), (target * regrets).sum(axis=1)
    share = np.clip((limit - least) / np.maximum(spent - least, 1e-300), 0.0, 1.0)[:, None]
    rival = share * target + (1 - share) * own
    found = StackelbergDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates)
    assert square_error(prior, rival) <= found.bound + 1e-9
    assert square_error(prior, rival) <= found.value * (1 + CLOSE) + 1e-9


def test_where_everybody_can_afford_silence_the_prior_is_all_there_is() -> None:
    problem, prior, candidates = market(0)
    enough = regrets_of(problem, prior.beliefs, candidates.actions).max(axis=0).min()
    found = StackelbergDecisionMaker(problem, Budget.regret(enough), prior=prior, candidates=candidates)
    assert found.value == pytest.approx(prior_error(prior), rel=1e-12)
    assert found.gap == 0.0


def test_without_a_budget_the_optimal_decisions_are_played() -> None:
    problem, prior, candidates = market(0)
    found = StackelbergDecisionMaker(problem, 0.0, prior=prior, candidates=candidates)
    plain = OriginalDecisionMaker(problem).decide_many(prior.beliefs).action
    np.testing.assert_allclose(found.decide_many(prior.beliefs).actions[:, 0], plain, atol=1e-7)
    assert found.decide([0.123, 0.456, 0.421]).expected_regret <= 1e-12


def test_a_belief_outside_the_prior_answers_the_estimates_within_its_budget() -> None:
    problem, prior, candidates = market(2)
    budget = Budget.regret(0.3 * silence(problem, prior, candidates))
    found = StackelbergDecisionMaker(problem, budget, prior=prior, candidates=candidates)
    for belief in np.random.default_rng(3).dirichlet(np.ones(3), 10):
        mixed = found.decide(belief)
        assert mixed.expected_regret <= budget.amount * (1 + 1e-9)
        gains = ((belief - found.estimates) ** 2).sum(axis=1)
        regrets = regrets_of(problem, belief[None], found.mechanism.actions)
        ones = np.ones((1, len(gains)))
        best = linprog(-gains, regrets, [budget.amount], ones, [1.0], bounds=(0, None))
        if best.status == 0:
            order = [int(np.abs(found.mechanism.actions - each).max(axis=1).argmin()) for each in mixed.actions]
            assert mixed.probabilities @ gains[order] == pytest.approx(-best.fun, abs=1e-8)


def test_a_cap_holds_for_every_decision() -> None:
    problem, prior, candidates = market(1)
    limit = 0.3 * silence(problem, prior, candidates)
    cap = Budget.regret(1.5 * limit)
    free = StackelbergDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates)
    capped = StackelbergDecisionMaker(
        problem, Budget.regret(limit), prior=prior, candidates=candidates, worst_regret=cap
    )
    played = capped.mechanism
    assert played.regrets[played.probabilities > 0].max() <= 1.5 * limit * (1 + 1e-9)
    assert capped.value <= free.bound
    assert capped.gap <= CLOSE
    beliefs = np.random.default_rng(0).dirichlet(np.ones(3), 20)
    many = capped.decide_many(beliefs)
    assert many.regrets[many.probabilities > 0].max() <= 1.5 * limit * (1 + 1e-9)


def test_one_belief_has_nothing_to_hide() -> None:
    problem, _, candidates = market(0)
    found = StackelbergDecisionMaker(problem, 0.1, prior=Prior([[0.2, 0.3, 0.5]], [1.0]), candidates=candidates)
    assert found.value == pytest.approx(0.0, abs=1e-15)
    assert found.gap == 0.0
    rounded = Prior([[0.777, 0.223]], [1.0 - 2.0**-53])  # the value is 0, the bound the square of a rounding
    assert StackelbergDecisionMaker(FiniteProblem(np.eye(2)), 0.1, prior=rounded).gap == 0.0


def test_the_optimal_decision_is_allowed_where_its_costs_cancel() -> None:
    """The first choice wins or loses: at the first belief its cost is 0, but computed from its parts 1e-17."""
    problem = FiniteProblem([[-0.2, 0.3], [-0.1, 0.3], [0.1, 0.3]])
    beliefs = np.array([[0.2, 0.2, 0.6], [0.6, 0.2, 0.2], [0.1, 0.1, 0.8]])
    within = StackelbergDecisionMaker(problem, 0.1, prior=Prior(beliefs, [0.4, 0.3, 0.3]), worst_regret=0.1)
    assert within.mechanism.expected_regrets.max() == 0.0
    beyond = StackelbergDecisionMaker(problem, 0.1, prior=Prior(beliefs[1:], [0.5, 0.5]), worst_regret=0.1)
    assert beyond.decide_many(beliefs[:1]).regrets.max() == 0.0


def test_a_decision_written_twice_changes_nothing() -> None:
    problem, prior, candidates = market(1, 5)
    limit = Budget.regret(0.3 * silence(problem, prior, candidates))
    once = StackelbergDecisionMaker(problem, limit, prior=prior, candidates=candidates.actions)
    twice = np.vstack([candidates.actions, candidates.actions[::-1]])
    both = StackelbergDecisionMaker(problem, limit, prior=prior, candidates=twice)
    assert both.value == pytest.approx(once.value, rel=CLOSE)


def test_two_states_and_shares_of_the_optimal_cost() -> None:
    problem = MarkowitzProblem([[0.02, -0.01], [-0.02, 0.015]], [np.eye(2) / 100, np.eye(2) / 50], 5.0)
    prior = uniform_prior(2, 20)
    found = StackelbergDecisionMaker(problem, 0.1, prior=prior, candidates=decoy_grid(problem, 20))
    limits = 0.1 * np.abs(problem.optimal_cost(prior.beliefs))
    assert np.all(found.mechanism.expected_regrets <= limits * (1 + 1e-9))
    assert found.gap <= CLOSE


def test_candidates_that_cannot_meet_a_budget_are_joined() -> None:
    problem, prior, _ = market(0, 4)
    found = StackelbergDecisionMaker(problem, Budget.regret(1e-9), prior=prior, candidates=decoy_grid(problem, 1))
    assert found.mechanism.expected_regrets.max() <= 1e-9 + 1e-12


def test_many_columns_are_priced() -> None:
    problem = random_market(rng=np.random.default_rng(5)).problem
    prior, candidates = uniform_prior(3, 10), decoy_grid(problem, 30)
    limit = 0.5 * silence(problem, prior, candidates)
    told: list[tuple[int, int]] = []
    found = StackelbergDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates, gap=0.01)
    found.solve(progress=lambda done, most: told.append((done, most)))
    assert found.gap <= 0.01
    assert told
    whole = StackelbergDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=decoy_grid(problem, 10))
    assert whole.value <= found.bound * (1 + 1e-9), "a part of the candidates hides no more"


def test_finite_choices_stay_whole_numbers() -> None:
    problem = FiniteProblem([[0.0, 1.0, 0.4], [1.0, 0.0, 0.4]])
    found = StackelbergDecisionMaker(problem, Budget.regret(0.4), prior=CORNERS)
    assert found.mechanism.actions.dtype.kind == "i"
    assert found.value == pytest.approx(prior_error(CORNERS)), "the middle choice suits both"


def test_small_budgets_with_uneven_weights_need_no_more_steps() -> None:
    rng = np.random.default_rng(2)
    means, covariances = rng.uniform(-0.2, 0.3, (3, 8)), []
    for _ in range(3):
        factor = 0.3 * rng.normal(size=(8, 8))
        covariances.append(factor @ factor.T / 8 + np.diag(rng.uniform(0.1, 0.6, 8)))
    problem, beliefs = MarkowitzProblem(means, np.array(covariances), 2.0), uniform_prior(3, 18).beliefs
    prior = Prior(beliefs, np.random.default_rng(0).dirichlet(np.ones(len(beliefs))))
    candidates = np.asarray(problem.solve(uniform_prior(3, 40 if audited() else 20).beliefs))
    limit = 0.1 * silence_regret(problem, prior.beliefs, prior.weights)
    steps: list[int] = []
    found = StackelbergDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates, gap=0.01)
    found.solve(progress=lambda done, most: steps.append(done))
    assert found.gap <= 0.01
    assert len(steps) <= 30


def test_a_market_needs_few_of_newtons_steps() -> None:
    """Three times as many with a corrector of the wrong sign."""
    problem = MarkowitzProblem(*markets.random_market(np.random.default_rng([13, 3]), 3, 4))
    steps: list[int] = []
    maker = StackelbergDecisionMaker(problem, 0.1, prior=uniform_prior(3, 5))
    maker.solve(progress=lambda done, most: steps.append(done))
    assert 0 < len(steps) <= 16


def test_a_lottery_of_many_decisions_prints_the_heaviest_and_the_rest_together() -> None:
    problem, prior, candidates = market(0)
    lottery = StackelbergDecisionMaker(problem, 0.1, prior=prior, candidates=candidates).decide(prior.beliefs[0])
    many = replace(
        lottery,
        actions=np.repeat(lottery.actions[:1], 50, axis=0),
        probabilities=np.arange(1.0, 51.0) / 1275.0,
        regrets=np.linspace(0.0, 0.49, 50),
        privacies=np.zeros(50),
        decoys=np.repeat(lottery.decoys[:1], 50, axis=0),
    )
    said = many.summary().splitlines()
    assert len(said) == 2 + 12 + 1 + 1
    assert "3.92%" in said[2]  # 50 of 1275
    assert "regret 0.49" in said[2]
    assert f"{sum(range(1, 39)) / 1275:.2%}      one of 38 others  regret at most 0.37" in said[14]
    few = replace(many, **{name: getattr(many, name)[:12] for name in ("actions", "regrets", "privacies", "decoys")})
    few = replace(few, probabilities=np.full(12, 1 / 12))
    assert "others" not in few.summary()
    assert len(few.summary().splitlines()) == 2 + 12 + 1
