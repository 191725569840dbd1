"""Budgets and caps of decision makers that hide from an aware observer, where optimal decisions hold next to nothing of
something, beliefs have no weight, and budgets are tiny."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import (
    Budget,
    MarkowitzProblem,
    Prior,
    RateDistortionDecisionMaker,
    StackelbergDecisionMaker,
    decoy_grid,
    rate_distortion_curve,
)

MAKERS = [RateDistortionDecisionMaker, StackelbergDecisionMaker]
ROUNDING = 1e-13  # of costs of about one tenth
MET = 1e-9
N_MARKETS = 8


def market(rng):
    """A market, at times with an asset written twice."""
    n_states, n_assets = int(rng.choice([2, 3, 4, 5])), int(rng.choice([2, 3, 5, 8]))
    factors = 0.2 * rng.normal(size=(n_states, n_assets, n_assets))
    means = 0.05 * rng.normal(size=(n_states, n_assets))
    covariances = factors @ factors.transpose(0, 2, 1) / n_assets + 1e-4 * np.eye(n_assets)
    if rng.random() < 0.3:
        means[:, 1] = means[:, 0]
        covariances[:, 1], covariances[:, :, 1] = covariances[:, 0], covariances[:, :, 0]
    return MarkowitzProblem(means, covariances, float(rng.choice([0.5, 2.0, 10.0])))


def with_a_small_weight(problem, rng):
    """A belief whose optimal decision holds less of an asset than min_slack, or any belief where none is met."""
    first, last = rng.dirichlet(np.ones(problem.n_states), size=2)
    way = first + np.linspace(0.0, 1.0, 4000)[:, None] * (last - first)
    small = ~problem.constraints.is_admissible(problem.solve(way))
    return way[int(small.argmax())]


def law(problem, rng, n_beliefs):
    beliefs = rng.dirichlet(np.ones(problem.n_states), size=n_beliefs)
    weights = rng.dirichlet(np.ones(n_beliefs))
    beliefs[0] = with_a_small_weight(problem, rng)
    if rng.random() < 0.5:
        weights[-1] = 0.0
    return Prior(beliefs, weights / weights.sum())


def regrets_of(problem, beliefs, actions):
    optimal = (problem.state_costs(problem.solve(beliefs)) * beliefs).sum(axis=1)
    return beliefs @ problem.state_costs(actions).T - optimal[:, None]


def assert_within(maker, problem, prior, limit, spent):
    spent = spent if isinstance(maker, StackelbergDecisionMaker) else np.array([prior.weights @ spent])
    assert (spent <= limit * (1.0 + MET) + ROUNDING).all()


@pytest.mark.parametrize("kind", MAKERS)
def test_what_is_played_keeps_the_budget_and_the_cap_at_every_belief(kind, fresh_rng):
    for _ in range(N_MARKETS):
        problem = market(fresh_rng)
        prior = law(problem, fresh_rng, int(fresh_rng.choice([2, 5, 12])))
        limit = float(10.0 ** fresh_rng.uniform(-9, -2))
        cap = float(fresh_rng.choice([1.0, 3.0, np.inf])) * limit
        maker = kind(
            problem,
            Budget.regret(limit),
            prior=prior,
            candidates=decoy_grid(problem, 6),
            worst_regret=Budget.regret(cap) if np.isfinite(cap) else None,
        )
        played = maker.mechanism
        regrets = regrets_of(problem, prior.beliefs, played.actions)
        np.testing.assert_allclose(played.probabilities.sum(axis=1), 1.0, atol=1e-9)
        assert_within(maker, problem, prior, limit, (played.probabilities * regrets).sum(axis=1))
        assert regrets[played.probabilities > 0].max() <= cap * (1.0 + MET) + ROUNDING
        again = maker.decide_many(prior.beliefs)
        assert_within(maker, problem, prior, limit, (again.probabilities * again.regrets).sum(axis=1))
        elsewhere = maker.decide_many(fresh_rng.dirichlet(np.ones(problem.n_states), size=5))
        for asked in (again, elsewhere):
            assert asked.regrets[asked.probabilities > 0].max() <= cap * (1.0 + MET) + ROUNDING


@pytest.mark.parametrize("kind", MAKERS)
def test_an_optimal_decision_that_holds_next_to_nothing_of_an_asset_is_a_candidate(kind):
    """The second asset's weight is 5e-5 at the first belief: nothing else keeps a budget of 1e-12."""
    problem = MarkowitzProblem([[0.5, 0.0], [0.0, 0.5]], [0.1 * np.eye(2)] * 2, 1.0)
    # Where weights w are held of the second asset, 0.2 (2 w − 1) = μ_2 − μ_1 = 0.5 (1 − 2 π_1).
    first = 0.5 * (1.0 - 0.4 * (2.0 * 5e-5 - 1.0))
    prior = Prior([[first, 1.0 - first], [1.0 - first, first]], [0.5, 0.5])
    assert problem.solve(prior.beliefs)[0, 1] == pytest.approx(5e-5)
    maker = kind(problem, Budget.regret(1e-12), prior=prior, candidates=decoy_grid(problem, 4))
    played = maker.mechanism
    spent = (played.probabilities * regrets_of(problem, prior.beliefs, played.actions)).sum(axis=1)
    assert spent.max() <= 1e-12 + ROUNDING


def test_curves_keep_what_single_budgets_keep(fresh_rng):
    problem = market(fresh_rng)
    prior = law(problem, fresh_rng, 5)
    limits = [1e-9, 1e-6, 1e-3]
    candidates = decoy_grid(problem, 6)
    curve = rate_distortion_curve(problem, prior, [Budget.regret(each) for each in limits], candidates=candidates)
    for limit, rate in zip(limits, curve.rates, strict=True):
        alone = RateDistortionDecisionMaker(problem, Budget.regret(limit), prior=prior, candidates=candidates)
        assert_within(alone, problem, prior, limit, alone.mechanism.expected_regrets)
        # For the least budget optimal decisions joined the candidates, which are then those of the whole curve.
        assert rate <= alone.rate + 2e-3
