"""Every step on general polyhedra: redundant, repeated, scaled and degenerate rows, implied equalities, open ends."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DesiredObfuscation,
    Infeasibility,
    MaximalObfuscation,
    ModelError,
    NonExistence,
    NonUniqueness,
    ProbabilisticDecisionMaker,
    action_grid,
    consistent_beliefs,
    decoy_grid,
    near_optimal_beliefs,
    privacy_frontier,
    random_candidates,
)
from oracles import consistent
from polyhedra import KINDS, random_problem
from sizes import instances, some
from strategies import cost_scale

AGREEMENT = 1e-6
SAME, MORE = range(5), range(5, 20)  # problems of each kind: 240 in all, 180 of them in `make audit`


def lifted(problem, action):
    """The oracle's system: rows are tight per unit of their largest coefficient, multipliers kept."""
    region = problem.constraints
    size = np.abs(region.A_ub).max(axis=1)
    tight = (region.b_ub - region.A_ub @ action) / size < region.min_slack
    gradients = np.stack([h @ action + g for h, g in zip(problem.hessians, problem.linear, strict=True)], axis=1)
    return consistent.kkt_system(gradients, region.A_ub[tight], region.A_eq)


def same_points(first, second):
    apart = np.abs(first[:, None] - second[None]).max(axis=2)
    return max(apart.min(axis=0).max(), apart.min(axis=1).max()) <= AGREEMENT


@pytest.mark.parametrize("seeds", [some(SAME, 3), pytest.param(MORE, marks=pytest.mark.audit)], ids=["few", "many"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_consistent_beliefs_are_those_of_the_lifted_programmes(kind, seeds):
    for seed in seeds:
        rng = np.random.default_rng([KINDS.index(kind), seed])
        n_states, size = int(rng.integers(2, 6)), int(rng.integers(2, 6))
        problem = random_problem(rng, kind, n_states, size)
        belief, target = rng.dirichlet(np.ones(n_states), 2)
        action = problem.solve(belief)
        assert problem.constraints.violation(action) <= 1e-11
        system = lifted(problem, action)
        found = consistent_beliefs(problem, action)
        assert found.contains(belief), seed
        np.testing.assert_allclose(found.bounds(), consistent.bounds(system), atol=AGREEMENT, err_msg=str(seed))
        assert found.distance(target) == pytest.approx(consistent.distance(system, target), abs=AGREEMENT)
        corners = found.vertices()
        if n_states <= 3:
            assert same_points(corners, consistent.vertices(system)), seed
        else:
            for direction in rng.normal(size=(3, n_states)):
                reached = consistent.support(system, direction) @ direction
                assert (corners @ direction).max() == pytest.approx(reached, abs=AGREEMENT)


@pytest.mark.parametrize("kind", KINDS)
def test_what_no_belief_explains_is_empty_for_the_lifted_programme_too(kind):
    for seed in range(instances(6, least=2)):
        rng = np.random.default_rng([KINDS.index(kind), seed, 1])
        n_states, size = int(rng.integers(2, 6)), int(rng.integers(2, 6))
        problem = random_problem(rng, kind, n_states, size)
        first, second = problem.solve(np.eye(n_states)[:2])
        action = 0.5 * first + 0.5 * second
        slacks = problem.constraints.slacks(action)
        if ((slacks > 1e-12) & (slacks < 1e-3)).any():
            continue
        found = consistent_beliefs(problem, action)
        residual = consistent.smallest_residual(lifted(problem, action))
        if residual > AGREEMENT:
            assert found.is_empty
            assert found.plausibility_gap > 0
        elif residual < 1e-11:
            assert not found.is_empty


@cache
def drawn(kind):
    """One problem of a kind with a belief, a target and decoys."""
    rng = np.random.default_rng([KINDS.index(kind), 7])
    problem = random_problem(rng, kind, 3, 4)
    belief, target = rng.dirichlet(np.ones(3), 2)
    return problem, belief, target, decoy_grid(problem, 8)


@pytest.mark.parametrize(("kind", "which"), some(list(product(KINDS, range(5))), 6))
def test_all_measures_and_decision_makers_work_on_them(kind, which):
    problem, belief, target, candidates = drawn(kind)
    measure = [MaximalObfuscation(), DesiredObfuscation(target), NonExistence(), NonUniqueness(), Infeasibility()][
        which
    ]
    limit = 0.02 * cost_scale(problem, problem.solve(belief))
    budget = Budget.regret(limit)
    chooser = CounterAdversarialDecisionMaker(problem, measure, budget, candidates=candidates)
    decision = chooser.decide(belief)
    assert decision.regret <= limit * (1 + 1e-9)
    assert problem.constraints.is_admissible(decision.action)
    again = measure(belief, consistent_beliefs(problem, decision.action))
    assert decision.privacy == pytest.approx(again, abs=1e-6)
    frontier = privacy_frontier(problem, belief, measure, candidates=candidates)
    assert frontier.deterministic(limit) <= decision.privacy + 1e-6
    lottery = ProbabilisticDecisionMaker(problem, measure, budget, candidates=candidates).decide(belief)
    assert lottery.expected_regret <= limit * (1 + 1e-9)
    assert lottery.expected_privacy >= decision.privacy - 1e-6
    beliefs = np.vstack([belief, target])
    many = chooser.decide_many(beliefs)
    assert many.privacy[0] == pytest.approx(decision.privacy, abs=1e-6)
    assert (many.regret <= limit * (1 + 1e-9)).all()
    assert len(ProbabilisticDecisionMaker(problem, measure, budget, candidates=candidates).decide_many(beliefs)) == 2


@pytest.mark.parametrize("kind", KINDS)
def test_candidates_of_all_sources_are_feasible_or_the_open_end_is_named(kind):
    problem, *_ = drawn(kind)
    rng = np.random.default_rng(0)
    assert (problem.constraints.violation(decoy_grid(problem, 4).actions) <= 1e-9).all()
    if kind == "open":
        with pytest.raises(ModelError, match=r"unbounded in coordinate \d"):
            random_candidates(problem, 10, rng=rng)
        with pytest.raises(ModelError, match=r"unbounded in coordinate \d"):
            action_grid(problem, 3)
        return
    assert (problem.constraints.violation(random_candidates(problem, 10, rng=rng).actions) <= 1e-9).all()
    assert (problem.constraints.violation(action_grid(problem, 4).actions) <= 1e-9).all()


@pytest.mark.parametrize("kind", KINDS)
def test_near_optimal_beliefs_on_them_hold_what_they_should(kind):
    problem, belief, target, _ = drawn(kind)
    action = problem.solve(belief)
    regret = 0.3 * float(problem.regret(target, action)) + 1e-6
    found = near_optimal_beliefs(problem, action, regret)
    assert found.contains(belief)
    assert not found.is_empty
    bounds = found.bounds()
    grid = np.vstack([np.random.default_rng(1).dirichlet(np.ones(3), 300), np.eye(3)])
    members = grid[problem.regret(grid, action) <= regret]
    assert (members >= bounds[:, 0] - 1e-5).all()
    assert (members <= bounds[:, 1] + 1e-5).all()
    nearest = found.nearest(target)
    assert float(problem.regret(nearest, action)) <= regret + 2 * found.accuracy
    assert found.distance(target) <= np.linalg.norm(members - target, axis=1).min(initial=2.0) + 1e-6
    assert found.distance(target) <= consistent_beliefs(problem, action).distance(target) + 1e-9
    sample = found.sample(30, rng=np.random.default_rng(2))
    assert problem.regret(sample, action).max() <= 1.02 * regret + 2 * found.accuracy


def test_a_slope_of_rounding_size_does_not_overflow():
    """A corner that all beliefs share: the regret does not rise along the way, and the way back has no length."""
    rng = np.random.default_rng(19)
    problem = random_problem(rng, "degenerate vertex", 4, 3)
    belief = rng.dirichlet(np.ones(4))
    decision = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(0.05), candidates=decoy_grid(problem, 6))
    assert decision.decide(belief).regret <= 0.05
