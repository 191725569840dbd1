"""Edges between the steps: a measure of one's own, decisions in units of money, what is refused and what status says."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import (
    BeliefSet,
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    InputError,
    LocalSearch,
    MarkowitzProblem,
    MaximalObfuscation,
    ModelError,
    Polyhedron,
    PrivacyMeasure,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    action_grid,
    box,
    consistent_beliefs,
    decoy_grid,
    privacy_frontier,
    random_candidates,
    simplex,
)
from inscrutable.decision_makers.search.goal import Goal

BELIEF = np.array([0.5, 0.3, 0.2])


def market(n_assets: int = 4) -> MarkowitzProblem:
    rng = np.random.default_rng(5)
    factors = rng.normal(size=(3, n_assets, n_assets + 2))
    return MarkowitzProblem(0.05 * rng.normal(size=(3, n_assets)), 0.02 * factors @ factors.transpose(0, 2, 1), 2.0)


class Entropy(PrivacyMeasure):
    """Entropy of the observer's estimate: no distance, no indicator."""

    def __call__(self, belief, belief_set):
        centre = np.maximum(belief_set.center(), np.finfo(float).tiny)
        return float(-(centre * np.log(centre)).sum())


class HalfDistance(MaximalObfuscation):
    def __call__(self, belief, belief_set):
        return 0.5 * belief_set.distance(belief)


def test_a_measure_of_ones_own_goes_through_and_is_given_no_false_bound():
    problem = market()
    grid = decoy_grid(problem, 20)
    cdm = CounterAdversarialDecisionMaker(problem, Entropy(), 0.1, candidates=grid).decide(BELIEF)
    pdm = ProbabilisticDecisionMaker(problem, Entropy(), 0.1, candidates=grid).decide(BELIEF)
    own = Entropy()(BELIEF, consistent_beliefs(problem, problem.solve(BELIEF)))
    assert own <= cdm.privacy <= np.log(3)
    assert cdm.privacy_bound == np.inf
    assert pdm.expected_privacy >= cdm.privacy - 1e-12
    free = CounterAdversarialDecisionMaker(problem, Entropy(), 0.0, candidates=grid).decide(BELIEF)
    assert free.privacy == pytest.approx(own)
    assert free.privacy <= free.privacy_bound
    local = CounterAdversarialDecisionMaker(
        problem, Entropy(), 0.1, method=LocalSearch(5, rng=np.random.default_rng(0))
    )
    assert local.decide(BELIEF).regret <= 0.1 * abs(cdm.optimal_cost) + 1e-12


def test_measures_that_share_a_reference_do_not_share_decisions():
    problem = market()
    grid = decoy_grid(problem, 20)
    whole = CounterAdversarialDecisionMaker(problem, candidates=grid).decide(BELIEF)
    half = CounterAdversarialDecisionMaker(problem, HalfDistance(), candidates=grid).decide(BELIEF)
    assert half.privacy == pytest.approx(0.5 * half.belief_set.distance(BELIEF))
    assert whole.privacy == pytest.approx(whole.belief_set.distance(BELIEF))


def test_a_measure_that_is_not_a_number_is_named():
    class Nothing(PrivacyMeasure):
        def __call__(self, belief, belief_set):
            return float("nan")

    with pytest.raises(InputError, match="Nothing"):
        CounterAdversarialDecisionMaker(market(), Nothing(), candidates=decoy_grid(market(), 5).actions).decide(BELIEF)


def test_decisions_in_units_of_money_are_inside():
    rng = np.random.default_rng(2)
    n = 20
    factors = rng.normal(size=(3, n, n + 2))
    wealth = 1e7
    region = Polyhedron(-np.eye(n), np.zeros(n), np.ones((1, n)), [wealth], min_slack=1e-4 * wealth)
    problem = QuadraticProblem(
        factors @ factors.transpose(0, 2, 1) / wealth, rng.normal(size=(3, n)), constraints=region
    )
    candidates = decoy_grid(problem, 20)
    assert candidates.n_outside == 0
    assert np.mean(candidates.usable) > 0.9


def test_a_large_bound_elsewhere_does_not_hide_a_conflict():
    region = simplex(3) & box([0.3334] * 3, [1e6] * 3)
    with pytest.raises(ModelError, match="least relaxation"):
        QuadraticProblem([np.eye(3)] * 2, np.zeros((2, 3)), constraints=region)


def test_grids_name_what_was_asked():
    problem = market()
    with pytest.raises(InputError, match="resolution"):
        decoy_grid(problem, 0)
    thin = simplex(3) & Polyhedron([[1.0, 0, 0], [-1.0, 0, 0]], [0.33334, -0.33333])
    with pytest.raises(InputError, match="no admissible decision on a grid"):
        action_grid(QuadraticProblem([np.eye(3)] * 2, np.zeros((2, 3)), constraints=thin), 4)


@pytest.mark.parametrize(
    "call",
    [
        lambda: consistent_beliefs("problem", [0.5, 0.5]),
        lambda: decoy_grid("problem", 3),
        lambda: action_grid("problem", 3),
        lambda: random_candidates("problem", 3, rng=np.random.default_rng(0)),
        lambda: privacy_frontier("problem", [0.5, 0.5]),
        lambda: Budget(0.1, "regret"),
        lambda: BeliefSet([[1.0, np.nan]], np.zeros((0, 2))),
        lambda: BeliefSet([[1.0, 0.0]], np.zeros((0, 3))),
        lambda: privacy_frontier(market(), BELIEF, candidates=decoy_grid(market(), 3).actions).randomized(np.nan),
        lambda: CounterAdversarialDecisionMaker(market(), method=LocalSearch(), on_empty="infinite"),
    ],
)
def test_malformed_arguments_are_refused(call):
    with pytest.raises(InputError):
        call()


def test_without_a_budget_both_say_that_nothing_is_affordable():
    problem = market()
    grid = decoy_grid(problem, 10)
    cdm = CounterAdversarialDecisionMaker(problem, budget=0.0, candidates=grid).decide(BELIEF)
    pdm = ProbabilisticDecisionMaker(problem, budget=0.0, candidates=grid).decide(BELIEF)
    assert cdm.status is pdm.status is DecisionStatus.NO_AFFORDABLE_PRIVACY
    assert max(cdm.privacy, pdm.expected_privacy) <= 1e-12


def test_one_belief_and_decision_give_a_number_many_give_an_array():
    problem = market()
    action = problem.solve(BELIEF)
    for value in (problem.regret(BELIEF, action), problem.optimal_cost(BELIEF), problem.expected_cost(BELIEF, action)):
        assert isinstance(value, float)
    assert problem.optimal_cost([BELIEF, BELIEF]).shape == (2,)


def test_repeated_rows_of_a_capped_portfolio_are_merged():
    rng = np.random.default_rng(1)
    n = 16
    factors = rng.normal(size=(3, n, n + 2))
    means, covariances = 0.01 * rng.normal(size=(3, n)), 4e-4 * factors @ factors.transpose(0, 2, 1)
    twice = MarkowitzProblem(means, covariances, 5.0, simplex(n) & box(np.zeros(n), np.full(n, 0.2)))
    once = MarkowitzProblem(means, covariances, 5.0, simplex(n) & box(np.full(n, -np.inf), np.full(n, 0.2)))
    first, second = (consistent_beliefs(p, p.solve(BELIEF)) for p in (twice, once))
    np.testing.assert_allclose(first.bounds(), second.bounds(), atol=1e-9)


def test_results_print_their_summary():
    decision = CounterAdversarialDecisionMaker(market(), candidates=decoy_grid(market(), 5).actions).decide(BELIEF)
    assert repr(decision) == decision.summary()


def test_a_local_solver_never_plays_a_trial_that_is_not_finite():
    goal = Goal(market(), BELIEF, 1.0, 0.0, MaximalObfuscation())
    judged = goal.judged(np.array([[np.nan, 0.5, 0.5, 0.0], [np.inf, 0.0, 0.0, 0.0]]))
    assert not judged.admissible.any()
    assert np.isneginf(judged.privacies).all()
    assert np.isposinf(judged.regrets).all()
