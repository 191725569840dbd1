"""Costs that do not bend, or bend in some directions only: solved as linear programmes are, or refused by name."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import linprog

from inscrutable import (
    Budget,
    ConvexProblem,
    CounterAdversarialDecisionMaker,
    DesiredObfuscation,
    KellyProblem,
    LinearProblem,
    MarkowitzProblem,
    MaximalObfuscation,
    ModelError,
    NonExistence,
    OriginalDecisionMaker,
    Polyhedron,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    box,
    cheapest_privacy,
    check_decision_problem,
    consistent_beliefs,
    decoy_grid,
    privacy_frontier,
    simplex,
    simplex_grid,
)
from sizes import instances, some
from strategies import SEEDS


def near_ties(rng, n_states):
    """Beliefs where decisions tie, and others within a hair of them."""
    exact = np.vstack([simplex_grid(n_states, 3), rng.dirichlet(np.ones(n_states), 4)])
    return np.vstack([exact, (1 - 1e-7) * exact + 1e-7 * rng.dirichlet(np.ones(n_states))])


def least(belief, linear, region):
    """The least expected linear cost, by HiGHS."""
    equal = {"A_eq": region.A_eq, "b_eq": region.b_eq} if len(region.b_eq) else {}
    tight = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    return linprog(belief @ linear, region.A_ub, region.b_ub, **equal, bounds=(None, None), options=tight).fun


@settings(max_examples=instances(25), deadline=None)
@given(SEEDS)
def test_riskless_portfolios_are_linear_programmes(seed):
    rng = np.random.default_rng(seed)
    n_states, size = int(rng.integers(2, 5)), int(rng.integers(2, 7))
    means = rng.normal(size=(n_states, size)) if seed % 2 else rng.integers(-2, 3, (n_states, size)).astype(float)
    region = simplex(size) & Polyhedron(rng.uniform(0.1, 1, (1, size)), [0.9]) if seed % 3 else simplex(size)
    flat = MarkowitzProblem(means, np.zeros((n_states, size, size)), 1.0, region)
    same = LinearProblem(-means, region)
    beliefs = near_ties(rng, n_states)
    np.testing.assert_array_equal(flat.solve(beliefs), same.solve(beliefs))
    np.testing.assert_allclose(
        flat.optimal_cost(beliefs), [least(belief, -means, region) for belief in beliefs], atol=1e-9
    )


@settings(max_examples=instances(40), deadline=None)
@given(SEEDS)
def test_costs_that_bend_in_some_directions_are_solved_to_the_last_digits(seed):
    """Optimality by first principles: no vertex of C lies in a direction in which the expected cost falls."""
    rng = np.random.default_rng(seed)
    n_states, size = int(rng.integers(2, 4)), int(rng.integers(2, 6))
    factors = rng.normal(size=(n_states, size, 1)) * (rng.uniform(size=(n_states, 1, 1)) < 0.6)
    hessians = factors @ factors.transpose(0, 2, 1)
    linear = rng.normal(size=(n_states, size)) if seed % 2 else rng.integers(-2, 3, (n_states, size)).astype(float)
    regions = (
        simplex(size),
        simplex(size) & box([0.0] * size, [max(0.5, 1.5 / size)] * size),
        box([-1.0] * size, [1.0] * size) & Polyhedron([np.ones(size)], [0.3]),
    )
    region = regions[seed % 3]
    problem = QuadraticProblem(hessians, linear, constraints=region)
    beliefs = near_ties(rng, n_states)
    for belief, action in zip(beliefs, problem.solve(beliefs), strict=True):
        gradient = np.tensordot(belief, hessians, 1) @ action + belief @ linear
        assert gradient @ action <= least(belief, np.outer(np.ones(n_states), gradient), region) + 1e-9
        assert region.violation(action) <= 1e-12


@pytest.mark.parametrize("seed", range(6))
def test_ties_of_singular_costs_fall_alike_in_any_company(seed):
    """Two coordinates with the same costs, so that only their sum is determined, under limits on several coordinates."""
    rng = np.random.default_rng([seed, 3])
    factors, linear = rng.normal(size=(3, 4, 4)), rng.normal(size=(3, 4))
    factors[:, 1], linear[:, 1] = factors[:, 0], linear[:, 0]
    region = box(np.zeros(4), np.full(4, 2.0)) & Polyhedron([[1.0, 1.0, -1.0, -1.0]], [1.0])
    problem = QuadraticProblem(factors @ factors.transpose(0, 2, 1), linear, constraints=region)
    beliefs = np.vstack([rng.dirichlet(0.5 * np.ones(3), 40), np.eye(3), np.full((1, 3), 1 / 3)])
    alone = np.array([problem.solve(belief) for belief in beliefs])
    np.testing.assert_allclose(problem.solve(beliefs), alone, rtol=0, atol=1e-9)


def test_riskless_portfolios_downstream():
    means = np.random.default_rng(1).normal(size=(2, 3)) / 10
    flat = MarkowitzProblem(means, np.zeros((2, 3, 3)), 1.0)
    plain = LinearProblem(-means, simplex(3))
    belief, budget = np.array([0.4, 0.6]), Budget.regret(0.05)
    check_decision_problem(flat)
    for measure in (MaximalObfuscation(), DesiredObfuscation([1, 0]), NonExistence()):
        found = [CounterAdversarialDecisionMaker(each, measure, budget).decide(belief) for each in (flat, plain)]
        assert found[0].regret <= 0.05
        assert found[0].privacy >= found[1].privacy - 1e-9  # a tied mixture is a decision like any other
        mixed = [ProbabilisticDecisionMaker(each, measure, budget).decide(belief) for each in (flat, plain)]
        assert mixed[0].expected_privacy >= mixed[1].expected_privacy - 1e-9
    assert len(decoy_grid(flat, 10)) > 0
    assert len(privacy_frontier(flat, belief).points) > 0
    beliefs = np.vstack([simplex_grid(2, 20), np.random.default_rng(0).dirichlet([1, 1], 30)])
    decided = OriginalDecisionMaker(flat).decide_many(beliefs)
    assert all(
        consistent_beliefs(flat, action).contains(held) for held, action in zip(beliefs, decided.action, strict=True)
    )
    assert len(CounterAdversarialDecisionMaker(flat, budget=budget).decide_many(beliefs)) == len(beliefs)


def test_riskless_portfolios_that_are_all_alike_are_held_somehow():
    problem = MarkowitzProblem(np.full((3, 4), 0.1), np.zeros((3, 4, 4)), 1.0)
    decided = CounterAdversarialDecisionMaker(problem).decide([0.2, 0.3, 0.5])
    assert decided.privacy == 0.0
    assert consistent_beliefs(problem, decided.action).dimension == 2


@pytest.mark.parametrize("bent", [0, 1])
def test_a_cost_without_end_is_named_with_its_direction(bent):
    hessians = np.zeros((2, 3, 3))
    hessians[0, 0, 0] = bent
    problem = QuadraticProblem(
        hessians, [[0, 1, 0], [0, 0, 1]], constraints=Polyhedron(A_eq=[[1.0, 1.0, 1.0]], b_eq=[1.0])
    )
    asks = (
        lambda: problem.solve([0.6, 0.4]),
        lambda: problem.solve([[0.9, 0.1], [0.2, 0.8]]),
        lambda: decoy_grid(problem, 5),
        lambda: CounterAdversarialDecisionMaker(problem).decide([0.6, 0.4]),
        lambda: ProbabilisticDecisionMaker(problem).decide([0.6, 0.4]),
    )
    for ask in asks:
        with pytest.raises(ModelError, match=r"unbounded below along u\[\d\].*bound these"):
            ask()


def test_an_end_that_only_the_repair_meets_is_named_too():
    """A flat direction whose slope is next to nothing passes the first solver and is met by the second."""
    from inscrutable.problems.quadratic_programme import _repair, _Working, layout_of

    layout = layout_of(Polyhedron(A_eq=[[1.0, 1.0]], b_eq=[1.0]))
    working = _Working(np.zeros(2, dtype=np.int8), np.zeros(0, dtype=bool))
    with pytest.raises(ModelError, match="unbounded below along"):
        _repair(np.zeros((2, 2)), np.array([1.0, 0.0]), layout, working, np.array([0.5, 0.5]))


def indifferent(kind):
    """A problem over two states, in the second of which all decisions cost the same."""
    if kind == "growth":
        gains = [[[1.5, 1.5], [1.0, 0.5]], [[1.5, 1.5], [0.5, 0.5]]]
        return KellyProblem(gains, [[0.6, 0.4], [0.1, 0.9]])
    if kind == "modelled":
        shares = cp.Variable(2)
        costs = [cp.sum_squares(shares - [0.2, 0.8]) + 1e-3 * cp.exp(shares[0]), 0 * shares[0] + 1]
        return ConvexProblem(shares, costs, [shares >= 0, cp.sum(shares) == 1])
    bend = 0.0 if kind == "flat" else 1.0
    return QuadraticProblem([bend * np.eye(2), np.zeros((2, 2))], [[1.0, 0.0], [1.0, 1.0]], constraints=simplex(2))


@pytest.mark.parametrize("kind", some(["growth", "modelled", "flat", "bent"], 2))
def test_a_state_in_which_all_decisions_cost_the_same_explains_what_no_other_does(kind):
    """Beside the decision of the other state: the lottery, the frontier and the least cost find it as the decision does."""
    problem, belief = indifferent(kind), [0.3, 0.7]
    far = pytest.approx(0.3 * np.sqrt(2.0), abs=1e-5)
    assert CounterAdversarialDecisionMaker(problem, budget=0.1).decide(belief).privacy == far
    assert ProbabilisticDecisionMaker(problem, budget=0.1).decide(belief).expected_privacy == far
    assert privacy_frontier(problem, belief).points[:, 1].max() == far
    assert cheapest_privacy(problem, belief, privacy=0.2).privacy >= 0.2
