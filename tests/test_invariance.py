"""What must not matter: the order of states and assets, the unit of costs, a constant added to them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    DesiredObfuscation,
    MarkowitzProblem,
    MaximalObfuscation,
    NonExistence,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    consistent_beliefs,
    decoy_grid,
    near_optimal_beliefs,
    plausibility_gap,
)
from oracles import markets
from sizes import instances
from strategies import SEEDS, cost_scale, long_only

SAME_PRIVACY = 1e-6  # two searches of one optimum
FOUND = (DecisionStatus.POLISHED, DecisionStatus.BEST_CANDIDATE)
MEASURES = st.sampled_from(["maximal", "desired", "non-existence"])


def measure_of(kind, target, order=None):
    if kind == "desired":
        return DesiredObfuscation(target if order is None else target[order])
    return MaximalObfuscation() if kind == "maximal" else NonExistence(0.05)


def decisions(problem, belief, measure, limit, candidates=None):
    budget = Budget.regret(limit)
    chosen = decoy_grid(problem, 14) if candidates is None else candidates
    single = CounterAdversarialDecisionMaker(problem, measure, budget, candidates=chosen).decide(belief)
    mixed = ProbabilisticDecisionMaker(problem, measure, budget, candidates=chosen).decide(belief)
    return single, mixed


def setting(seed, kind):
    rng = np.random.default_rng(seed)
    n_states, n_assets = int(rng.integers(2, 4)), int(rng.integers(2, 6))
    market = markets.random_market(rng, n_states, n_assets)
    belief, target = markets.random_belief(rng, n_states), rng.dirichlet(np.ones(n_states))
    problem = MarkowitzProblem(*market)
    limit = float(rng.choice([0.02, 0.1, 0.4])) * abs(float(problem.optimal_cost(belief)))
    return rng, market, problem, belief, target, limit, measure_of(kind, target)


def assert_same(first, second, *, unit=1.0):
    """Privacy is the same; regrets differ by the unit of the costs."""
    (single, mixed), (other_single, other_mixed) = first, second
    # Whether the best candidate or its polish is a rounding ahead is not an invariant; whether anything is found is.
    assert (other_single.status in FOUND) == (single.status in FOUND)
    assert other_single.privacy == pytest.approx(single.privacy, abs=SAME_PRIVACY)
    assert other_mixed.expected_privacy == pytest.approx(mixed.expected_privacy, abs=SAME_PRIVACY)
    # Where several decisions are equally private their regrets may differ; for unique optima they do not.
    # A lottery of one decision stands at a corner of the envelope, where every slope between its sides' is a price.
    if len(mixed.probabilities) > 1:
        assert other_mixed.price * unit == pytest.approx(mixed.price, rel=1e-2, abs=1e-6)


@settings(max_examples=instances(15), deadline=None)
@given(SEEDS, MEASURES)
def test_the_order_of_states_does_not_matter(seed, kind):
    rng, market, problem, belief, target, limit, measure = setting(seed, kind)
    order = rng.permutation(belief.size)
    other = MarkowitzProblem(market.means[order], market.covariances[order], market.risk_aversion)
    action = problem.solve(belief)
    np.testing.assert_allclose(other.solve(belief[order]), action, atol=1e-11)
    found, relabelled = consistent_beliefs(problem, action), consistent_beliefs(other, action)
    np.testing.assert_allclose(relabelled.bounds(), found.bounds()[order], atol=1e-8)
    assert relabelled.distance(target[order]) == pytest.approx(found.distance(target), abs=1e-9)
    first = decisions(problem, belief, measure, limit)
    assert_same(first, decisions(other, belief[order], measure_of(kind, target, order), limit))


@settings(max_examples=instances(15), deadline=None)
@given(SEEDS, MEASURES)
def test_the_order_of_assets_does_not_matter(seed, kind):
    rng, market, problem, belief, target, limit, measure = setting(seed, kind)
    order = rng.permutation(market.means.shape[1])
    shuffled = market.covariances[:, order][:, :, order]
    other = MarkowitzProblem(market.means[:, order], shuffled, market.risk_aversion)
    action = problem.solve(belief)
    np.testing.assert_allclose(other.solve(belief), action[order], atol=1e-11)
    found, relabelled = consistent_beliefs(problem, action), consistent_beliefs(other, action[order])
    np.testing.assert_allclose(relabelled.bounds(), found.bounds(), atol=1e-8)
    assert relabelled.distance(target) == pytest.approx(found.distance(target), abs=1e-9)
    assert_same(decisions(problem, belief, measure, limit), decisions(other, belief, measure, limit))


@settings(max_examples=instances(15), deadline=None)
@given(SEEDS, MEASURES, st.sampled_from([-3.0, 0.5, 40.0]), st.booleans())
def test_a_constant_added_to_the_costs_does_not_matter(seed, kind, constant, per_state):
    """In units of regret; c* itself, and with it a budget that is a share of it, does change."""
    rng, market, problem, belief, _, limit, measure = setting(seed, kind)
    constants = constant * (rng.uniform(0.5, 1, belief.size) if per_state else np.ones(belief.size))
    hessians, linear = 2 * market.risk_aversion * market.covariances, -market.means
    plain = QuadraticProblem(hessians, linear, constraints=problem.constraints)
    shifted = QuadraticProblem(hessians, linear, constants, constraints=problem.constraints)
    np.testing.assert_array_equal(shifted.solve(belief), plain.solve(belief))
    assert float(shifted.optimal_cost(belief)) == pytest.approx(float(plain.optimal_cost(belief)) + belief @ constants)
    action = rng.dirichlet(np.ones(market.means.shape[1]))
    assert float(shifted.regret(belief, action)) == pytest.approx(float(plain.regret(belief, action)), abs=1e-12)
    assert plausibility_gap(shifted, action) == pytest.approx(plausibility_gap(plain, action), abs=1e-7)
    first, second = decisions(plain, belief, measure, limit), decisions(shifted, belief, measure, limit)
    assert_same(first, second)
    if kind != "non-existence":
        # The last digits of the budget's rounding grow with the constant, the decision does not move beyond them.
        np.testing.assert_allclose(second[0].regret, first[0].regret, atol=1e-9)


@settings(max_examples=instances(15), deadline=None)
@given(SEEDS, MEASURES, st.sampled_from([1e-4, 0.01, 7.0, 1e5]))
def test_the_unit_of_the_costs_does_not_matter(seed, kind, unit):
    _, market, problem, belief, target, limit, measure = setting(seed, kind)
    hessians, linear = 2 * market.risk_aversion * market.covariances, -market.means
    scaled = QuadraticProblem(unit * hessians, unit * linear, constraints=problem.constraints)
    action = problem.solve(belief)
    np.testing.assert_allclose(scaled.solve(belief), action, atol=1e-11)
    found, other = consistent_beliefs(problem, action), consistent_beliefs(scaled, action)
    np.testing.assert_allclose(other.bounds(), found.bounds(), atol=1e-8)
    assert other.distance(target) == pytest.approx(found.distance(target), abs=1e-9)
    first, second = decisions(problem, belief, measure, limit), decisions(scaled, belief, measure, unit * limit)
    assert_same(first, second, unit=unit)
    near = near_optimal_beliefs(problem, action, limit).bounds()
    np.testing.assert_allclose(near_optimal_beliefs(scaled, action, unit * limit).bounds(), near, atol=1e-4)
    # A budget that is a share of |c*| scales along.
    shares = [
        CounterAdversarialDecisionMaker(held, measure, 0.1, candidates=decoy_grid(held, 14)).decide(belief).privacy
        for held in (problem, scaled)
    ]
    assert shares[0] == pytest.approx(shares[1], abs=SAME_PRIVACY)


def test_a_share_of_the_cost_is_not_a_regret():
    """With constants added the relative budget grows: the reason for `Budget.regret`."""
    market = markets.random_market(np.random.default_rng(3), 3, 4)
    hessians, linear = 2 * market.risk_aversion * market.covariances, -market.means
    region = MarkowitzProblem(*market).constraints
    belief = np.array([0.3, 0.3, 0.4])
    regrets = []
    for constant in (0.0, 100.0):
        problem = QuadraticProblem(hessians, linear, np.full(3, constant), constraints=region)
        decision = CounterAdversarialDecisionMaker(problem, budget=0.01, candidates=decoy_grid(problem, 14)).decide(
            belief
        )
        regrets.append(decision.regret)
    assert regrets[1] > 1.5 * regrets[0]


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_a_decision_does_not_depend_on_what_was_decided_before(seed):
    rng, _, problem, belief, _, limit, measure = setting(seed, "maximal")
    chooser = ProbabilisticDecisionMaker(problem, measure, Budget.regret(limit), candidates=decoy_grid(problem, 14))
    before = chooser.decide(belief)
    chooser.decide_many(rng.dirichlet(np.ones(belief.size), 3))
    after = chooser.decide(belief)
    np.testing.assert_array_equal(after.actions, before.actions)
    np.testing.assert_array_equal(after.probabilities, before.probabilities)
    assert after.expected_privacy == before.expected_privacy


def test_the_markowitz_and_the_quadratic_words_say_the_same():
    market = markets.random_market(np.random.default_rng(6), 3, 5)
    region = long_only(5, 1e-4)
    first = MarkowitzProblem(*market, constraints=region)
    second = QuadraticProblem(2 * market.risk_aversion * market.covariances, -market.means, constraints=region)
    belief = np.array([0.2, 0.3, 0.5])
    np.testing.assert_array_equal(first.solve(belief), second.solve(belief))
    assert cost_scale(first, first.solve(belief)) == cost_scale(second, second.solve(belief))
