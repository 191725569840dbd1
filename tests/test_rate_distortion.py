"""Least mutual information at an expected regret: closed forms, random rivals, and a bound of one's own."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from inscrutable import (
    Budget,
    Candidates,
    FiniteProblem,
    InputError,
    KellyProblem,
    MarkowitzProblem,
    OriginalDecisionMaker,
    Prior,
    RateDistortionDecisionMaker,
    action_grid,
    decoy_grid,
    leakage,
    mechanism,
    rate_distortion_curve,
    uniform_prior,
)
from inscrutable.decision_makers.aware.rate_distortion_newton import newton_law
from inscrutable.decision_makers.aware.rate_distortion_steps import Source
from inscrutable.experiments.random_markets import random_market
from strategies import SEEDS

Array = NDArray[np.float64]

TWO = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
CORNERS = Prior(np.eye(2), [0.5, 0.5])
GAP = 1e-3


def bits(weights: Array, shares: Array) -> float:
    """I(π;u) of rows (B,M), in bits, as a sum over all pairs."""
    played = weights @ shares
    total = 0.0
    for weight, row in zip(weights, shares, strict=True):
        for share, marginal in zip(row, played, strict=True):
            if weight * share > 0:
                total += weight * share * np.log2(share / marginal)
    return float(total)


def entropy(law: Array) -> float:
    """−Σ p log2 p."""
    held = np.asarray(law)[np.asarray(law) > 0]
    return float(-(held * np.log2(held)).sum())


@cache
def market(seed: int, resolution: int = 8) -> tuple[MarkowitzProblem, Prior, Candidates]:
    """A problem, a lopsided prior on a grid with some weights zero, and decoys."""
    rng = np.random.default_rng(seed)
    problem = random_market(rng=rng).problem
    grid = uniform_prior(3, resolution).beliefs
    weights = rng.dirichlet(np.full(len(grid), 0.5)) * (rng.random(len(grid)) < 0.8)
    return problem, Prior(grid, weights / weights.sum()), decoy_grid(problem, resolution)


def regrets_of(problem: MarkowitzProblem, beliefs: Array, actions: Array) -> Array:
    """ρ of every belief and action, from the problem's own costs."""
    return np.maximum(beliefs @ problem.state_costs(actions).T - problem.optimal_cost(beliefs)[:, None], 0.0)


def silence(problem: MarkowitzProblem, prior: Prior, candidates: Candidates) -> float:
    """The least expected regret of a constant action."""
    return float((prior.weights @ regrets_of(problem, prior.beliefs, candidates.actions)).min())


@pytest.mark.parametrize("wrong", [0.0, 0.01, 0.11, 0.3, 0.499, 0.5, 0.9])
def test_a_fair_coin_takes_one_bit_less_the_entropy_of_the_errors(wrong: float) -> None:
    found = RateDistortionDecisionMaker(TWO, Budget.regret(wrong), prior=CORNERS, gap=1e-6)
    assert found.rate == pytest.approx(1.0 - entropy(np.array([min(wrong, 0.5), 1 - min(wrong, 0.5)])), abs=2e-6)
    assert found.rate_bound <= found.rate <= found.rate_bound + 1e-6


@pytest.mark.parametrize("law", [[0.5, 0.3, 0.2], [0.2, 0.3, 0.1, 0.4], [0.05, 0.95]])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_bettor_who_knows_the_winner_saves_a_bit_of_rate_per_bit_of_log_loss(law: list[float], share: float) -> None:
    n = len(law)
    race = KellyProblem(np.eye(n)[:, None, :], np.ones((n, 1)))
    prior = Prior(np.eye(n), law)
    # Stakes that beat the channel: a share on one horse, the rest as the law is; and the law itself.
    stakes = np.array([(1 - w) * np.eye(n)[i] + w * np.array(law) for i in range(n) for w in np.linspace(0, 1, 41)])
    loss = share * entropy(np.array(law))
    budget = Budget.regret(loss * np.log(2.0))
    found = RateDistortionDecisionMaker(race, budget, prior=prior, candidates=stakes, plausible_only=False)
    assert found.rate == pytest.approx(entropy(np.array(law)) - loss, abs=5e-3)
    assert found.rate >= entropy(np.array(law)) - loss - 1e-6, "nothing beats the function itself"


def test_the_bettor_with_decoys_of_the_library() -> None:
    race = KellyProblem(np.eye(3)[:, None, :], np.ones((3, 1)))
    law = np.array([0.5, 0.3, 0.2])
    loss = 0.4 * entropy(law)
    found = RateDistortionDecisionMaker(race, Budget.regret(loss * np.log(2.0)), prior=Prior(np.eye(3), law))
    assert found.rate == pytest.approx(entropy(law) - loss, abs=2e-3)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 5), share=st.floats(0.01, 1.1), draw=SEEDS)
def test_no_random_mechanism_leaks_less_at_the_same_expected_regret(seed: int, share: float, draw: int) -> None:
    problem, prior, candidates = market(seed)
    rng = np.random.default_rng(draw)
    regrets = regrets_of(problem, prior.beliefs, candidates.actions)
    shares = np.exp(-rng.exponential(10.0 ** rng.uniform(1, 5)) * regrets) * rng.dirichlet(
        np.full(len(candidates), 0.3)
    )
    shares = shares + 1e-12 * np.eye(len(regrets), len(candidates))
    shares = shares / shares.sum(axis=1, keepdims=True)
    own = np.eye(len(candidates))[regrets.argmin(axis=1)]
    mixed = share * shares + (1 - share) * own if share <= 1 else shares
    budget = float(prior.weights @ (mixed * regrets).sum(axis=1))
    found = RateDistortionDecisionMaker(problem, Budget.regret(budget), prior=prior, candidates=candidates)
    assert found.rate <= bits(prior.weights, mixed) + GAP
    assert found.rate_bound <= bits(prior.weights, mixed) + 1e-9


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("share", [0.02, 0.2, 0.7, 1.0])
def test_what_is_played_keeps_the_budget_and_leaks_what_is_said(seed: int, share: float) -> None:
    problem, prior, candidates = market(seed)
    limit = share * silence(problem, prior, candidates)
    found = RateDistortionDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates)
    played = found.mechanism
    regrets = regrets_of(problem, prior.beliefs, played.actions)
    spent = float(prior.weights @ (played.probabilities * regrets).sum(axis=1))
    assert spent <= limit * (1 + 1e-9)
    assert bits(prior.weights, played.probabilities) == pytest.approx(found.rate, abs=1e-9)
    assert 0.0 <= found.gap <= GAP
    again = mechanism(found, prior.beliefs)
    assert bits(prior.weights, again.probabilities) == pytest.approx(found.rate, abs=1e-6)
    assert share < 1.0 or found.rate == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_at_the_silence_regret_the_candidates_of_the_library_leak_nothing(seed: int) -> None:
    problem, prior, _ = market(seed)
    apart = float(prior.weights @ problem.optimal_cost(prior.beliefs))
    silent = float(problem.optimal_cost(prior.weights @ prior.beliefs)) - apart
    found = RateDistortionDecisionMaker(problem, Budget.regret(silent), prior=prior)
    assert found.rate == 0.0
    assert len(found.mechanism.actions) == 1


def test_a_bound_from_the_definition_alone_agrees() -> None:
    """Any λ with Σ_b p_b λ_b e^{−s ρ} ≤ 1 for every action bounds the rate: here one scaled from the played rows."""
    problem, prior, candidates = market(1)
    limit = 0.3 * silence(problem, prior, candidates)
    found = RateDistortionDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates)
    price = found.price * np.log(2.0)
    kernel = np.exp(-price * regrets_of(problem, prior.beliefs, candidates.actions))
    played = found.mechanism
    law = prior.weights @ played.probabilities
    some = np.exp(-price * played.regrets) @ law
    multipliers = 1.0 / some / ((prior.weights / some) @ kernel).max()
    bound = (prior.weights @ np.log(multipliers) - price * limit) / np.log(2.0)
    assert found.rate - GAP <= bound <= found.rate + 1e-9


@pytest.mark.parametrize("share", [0.2, 0.7])
def test_newton_steps_end_at_a_law_that_meets_their_goal(share: float) -> None:
    problem, prior, candidates = market(1)
    regrets = regrets_of(problem, prior.beliefs, candidates.actions)
    source = Source(prior.weights, regrets - regrets.min(axis=1, keepdims=True))
    limit, n = share * silence(problem, prior, candidates), regrets.shape[1]
    law, slope, _ = newton_law(source, limit, np.full(n, 1.0 / n), 1.0 / limit, 1e-4)
    kernel = np.exp(-slope * source.excess)
    assert law.sum() == pytest.approx(1.0)
    assert np.log(((prior.weights / (kernel @ law)) @ kernel).max()) <= 1e-4 + 1e-9


@pytest.mark.parametrize("seed", range(2))
def test_the_curve_falls_and_is_convex(seed: int) -> None:
    problem, prior, candidates = market(seed)
    limits = np.linspace(0.0, 1.1, 12) * silence(problem, prior, candidates)
    curve = rate_distortion_curve(problem, prior, [Budget.regret(each) for each in limits], candidates=candidates)
    assert np.all(np.diff(curve.rates) <= GAP)
    assert np.all(np.diff(curve.rates, 2) >= -4 * GAP)
    assert np.all(curve.rates - curve.bounds <= GAP)
    assert curve.rates[-1] == 0.0
    for i in (1, 4, 8):  # from the start, not from a neighbour
        alone = RateDistortionDecisionMaker(problem, Budget.regret(limits[i]), prior=prior, candidates=candidates)
        assert alone.rate == pytest.approx(curve.rates[i], abs=GAP)
    assert len(curve.summary().splitlines()) == 13


def test_without_a_budget_the_cheapest_candidates_are_played() -> None:
    problem, prior, candidates = market(2)
    found = RateDistortionDecisionMaker(problem, Budget.regret(0.0), prior=prior, candidates=candidates)
    plain = OriginalDecisionMaker(problem).decide_many(prior.beliefs).action
    np.testing.assert_allclose(found.decide_many(prior.beliefs).actions[:, 0], plain, atol=1e-7)
    off = found.decide([0.123, 0.456, 0.421])
    assert off.expected_regret <= 1e-12


def test_a_belief_outside_the_prior_plays_by_the_same_price() -> None:
    problem, prior, candidates = market(0)
    limit = 0.5 * silence(problem, prior, candidates)
    found = RateDistortionDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates, gap=1e-6)
    belief = np.array([0.111, 0.222, 0.667])
    mixed = found.decide(belief)
    law = prior.weights @ found.mechanism.probabilities
    wanted = law * np.exp(-found.price * np.log(2.0) * regrets_of(problem, belief[None], found.mechanism.actions)[0])
    wanted /= wanted.sum()
    order = [int(np.abs(found.mechanism.actions - each).max(axis=1).argmin()) for each in mixed.actions]
    np.testing.assert_allclose(mixed.probabilities, wanted[order], atol=5e-3)
    assert mixed.privacies == pytest.approx([each.distance(belief) for each in mixed.belief_sets], abs=1e-9)


def test_a_cap_holds_for_every_decision_and_belief() -> None:
    problem, prior, candidates = market(0)
    limit = 0.5 * silence(problem, prior, candidates)
    free = RateDistortionDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates)
    capped = RateDistortionDecisionMaker(
        problem, Budget.regret(limit), prior=prior, candidates=candidates, worst_regret=Budget.regret(2 * limit)
    )
    assert free.mechanism.regrets[free.mechanism.probabilities > 1e-6].max() > 2 * limit, "the cap binds"
    assert capped.mechanism.regrets[capped.mechanism.probabilities > 0].max() <= 2 * limit * (1 + 1e-9)
    assert capped.rate >= free.rate_bound
    assert capped.gap <= GAP
    beliefs = np.random.default_rng(0).dirichlet(np.ones(3), 50)
    many = capped.decide_many(beliefs)
    assert many.regrets[many.probabilities > 0].max() <= 2 * limit * (1 + 1e-9)


def test_unexplained_candidates_are_left_out_unless_asked_for() -> None:
    problem, prior, _ = market(0)
    grid = action_grid(problem, 6)
    unexplained = grid.actions[grid.sets.dimension < 0]
    assert len(unexplained)
    some = RateDistortionDecisionMaker(problem, 1.0, prior=prior, candidates=grid)
    more = RateDistortionDecisionMaker(problem, 1.0, prior=prior, candidates=grid, plausible_only=False)
    assert len(some.columns) < len(more.columns)
    assert more.rate_bound <= some.rate


def test_candidates_that_cannot_meet_the_budget_are_joined_by_optimal_decisions() -> None:
    problem, prior, _ = market(0)
    found = RateDistortionDecisionMaker(problem, Budget.regret(0.0), prior=prior, candidates=decoy_grid(problem, 1))
    assert prior.weights @ found.mechanism.expected_regrets <= 1e-12


@pytest.mark.parametrize("seed", range(5))
def test_costs_that_cancel_keep_budget_and_cap(seed: int) -> None:
    rng = np.random.default_rng(seed)
    beliefs, common = rng.dirichlet(np.ones(3), size=4), 1e4 * rng.normal(size=3)
    common -= common @ beliefs[0]
    problem = FiniteProblem(1e-3 * rng.normal(size=(3, 4)) + common[:, None])
    none, prior = Budget.regret(0.0), Prior(beliefs, np.full(4, 0.25))
    found = RateDistortionDecisionMaker(problem, none, prior=prior, worst_regret=none, candidates=np.eye(4))
    assert found.mechanism.expected_regrets.max() == 0.0


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_one_belief_leaks_nothing(share: float) -> None:
    problem, _, candidates = market(0)
    prior = Prior([[0.2, 0.3, 0.5]], [1.0])
    assert RateDistortionDecisionMaker(problem, share, prior=prior, candidates=candidates).rate == 0.0


def test_a_decision_written_twice_changes_nothing() -> None:
    problem, prior, candidates = market(1)
    limit = Budget.regret(0.3 * silence(problem, prior, candidates))
    twice = np.vstack([candidates.actions, candidates.actions[::-1]])
    once = RateDistortionDecisionMaker(problem, limit, prior=prior, candidates=candidates.actions)
    both = RateDistortionDecisionMaker(problem, limit, prior=prior, candidates=twice)
    assert both.rate == pytest.approx(once.rate, abs=GAP)
    assert len(np.unique(both.mechanism.actions, axis=0)) == len(both.mechanism.actions)


def test_finite_choices_stay_whole_numbers() -> None:
    found = RateDistortionDecisionMaker(TWO, Budget.regret(0.1), prior=CORNERS)
    assert found.mechanism.actions.dtype.kind == "i"
    assert found.decide([0.5, 0.5]).probabilities == pytest.approx([0.5, 0.5], abs=1e-6)


def test_arguments_are_checked() -> None:
    problem, prior, _ = market(0)
    with pytest.raises(InputError, match="prior must be a Prior"):
        RateDistortionDecisionMaker(problem, 0.1, prior=prior.beliefs)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="2 states"):
        RateDistortionDecisionMaker(problem, 0.1, prior=CORNERS)
    with pytest.raises(InputError, match="gap"):
        RateDistortionDecisionMaker(problem, 0.1, prior=prior, gap=0.0)
    with pytest.raises(InputError, match="plausible_only"):
        RateDistortionDecisionMaker(problem, 0.1, prior=prior, plausible_only=1)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="at least one"):
        rate_distortion_curve(problem, prior, [])
    for single in (0.1, Budget.regret(0.1), "0.1"):
        with pytest.raises(InputError, match="a sequence of budgets"):
            rate_distortion_curve(problem, prior, single)  # type: ignore[arg-type]


def test_progress_is_told() -> None:
    problem, prior, candidates = market(0)
    told: list[tuple[int, int]] = []
    maker = RateDistortionDecisionMaker(problem, 0.05, prior=prior, candidates=candidates)
    assert maker.solve(progress=lambda done, most: told.append((done, most))) is maker
    assert told
    assert all(done <= most for done, most in told)


def test_no_rule_under_a_cap_costs_more_than_the_budget(fresh_rng: np.random.Generator) -> None:
    """Where a decision's column fell to nothing, the other one alone met no budget, and counted as a solution."""
    prior, problem = Prior(np.eye(2), [0.5, 0.5]), FiniteProblem([[2.0, 3.0, 1.0], [1.0, 3.0, 3.0]])
    for budget in (0.45, 0.3, float(fresh_rng.uniform(0.05, 0.49))):
        maker = RateDistortionDecisionMaker(
            problem, Budget.regret(budget), prior=prior, worst_regret=Budget.regret(1.0)
        )
        # The second belief is allowed choice 0 alone; the first plays it too as often as the budget pays for.
        assert maker.mechanism.regrets[0].max() <= 1.0
        found = leakage(maker.mechanism, prior, problem)
        assert found.expected_regret == pytest.approx(budget, rel=1e-6)
        joint = 0.5 * np.array([[2.0 * budget, 1.0 - 2.0 * budget], [1.0, 0.0]])
        apart = joint / np.outer(joint.sum(axis=1), joint.sum(axis=0))
        bits = float((joint[joint > 0] * np.log2(apart[joint > 0])).sum())
        assert found.mutual_information == pytest.approx(bits, abs=1e-5)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_the_price_is_the_slope_of_the_least_rate(share: float) -> None:
    """Two choices, of which the second costs 1 where it is wrong and the first .03: the first belief plays the first choice but
    for e^{−s}, the second belief the second with probability k = 1 − r / .003, so the rate has a closed form."""

    def rate(regret: float) -> float:
        k = 1.0 - regret / 0.003
        q = 0.1 * k
        second = k * np.log2(k / q) + (1 - k) * np.log2((1 - k) / (1 - q))
        return float(0.9 * np.log2(1 / (1 - q)) + 0.1 * second)

    problem, prior, spent = FiniteProblem([[0.0, 1.0], [0.03, 0.0]]), Prior(np.eye(2), [0.9, 0.1]), 0.003 * share
    found = RateDistortionDecisionMaker(problem, Budget.regret(spent), prior=prior, candidates=np.eye(2))
    assert found.rate == pytest.approx(rate(spent), abs=1e-6)
    step = 1e-7
    assert found.price == pytest.approx((rate(spent - step) - rate(spent + step)) / (2 * step), rel=1e-2)
    # Off the prior the rule is K ∝ q e^{−sρ}, with the law q of what is played.
    played = 0.1 * (1.0 - share)
    odds = played / (1.0 - played) * np.exp(-found.price * np.log(2.0) * (0.01 - 0.99 * 0.03))
    lottery = found.decide([0.01, 0.99])
    wanted = odds / (1.0 + odds)
    assert lottery.probabilities[np.asarray(lottery.actions).ravel() == 1].sum() == pytest.approx(wanted, rel=2e-2)
