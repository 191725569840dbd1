"""Forward solves against enumeration and the KKT conditions written out; costs, gradients and regrets by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import nnls

from inscrutable import MarkowitzProblem, Polyhedron, QuadraticProblem, box, simplex
from inscrutable.problems.quadratic_programme import _repair, _Working, layout_of
from oracles import enumeration, markets
from sizes import instances
from strategies import SEEDS, belief_problem, cost_scale, drawn_problems, line_problem, long_only

KKT = 1e-12  # relative to the largest coefficient of the programme


def kkt_residual(problem, belief, action):
    """Distance of −∇ from the cone of the rows that are tight to rounding, over the programme's largest coefficient."""
    region = problem.constraints
    hessian, linear = np.tensordot(belief, problem.hessians, 1), belief @ problem.linear
    scale = max(np.abs(hessian).max(), np.abs(linear).max())
    tight = region.slacks(action) <= 1e-12
    generators = np.vstack([region.A_ub[tight], region.A_eq, -region.A_eq]).T
    gradient = (hessian @ action + linear) / scale
    return nnls(generators, -gradient)[1] if generators.size else np.linalg.norm(gradient)


# --- forward solves ---------------------------------------------------------------------------------------------------


@settings(max_examples=instances(300), deadline=None)
@given(drawn_problems())
def test_forward_solutions_satisfy_the_kkt_conditions(drawn):
    n_states = drawn.belief.size
    few = np.vstack([drawn.belief, np.eye(n_states), drawn.rng.dirichlet(np.ones(n_states), 2)])
    path = np.linspace(drawn.belief, drawn.rng.dirichlet(np.ones(n_states)), 20)
    many = np.vstack([few, path, drawn.rng.dirichlet(np.full(n_states, 0.3), 5) * (1 - 1e-9) + 1e-9 / n_states])
    solved = [drawn.problem.solve(few), drawn.problem.solve(many), drawn.problem.solve(drawn.belief)[None]]
    for belief, action in zip(np.vstack([few, many, drawn.belief]), np.vstack(solved), strict=True):
        assert kkt_residual(drawn.problem, belief, action) <= KKT * np.sqrt(action.size)
        assert abs(action.sum() - 1) <= KKT
        assert action.min() >= 0
        assert not np.any((action > 0) & (action < 1e-13)), "a weight at its bound must be exactly zero"
        assert not np.signbit(action).any()


@settings(max_examples=instances(150), deadline=None)
@given(drawn_problems(states=(1, 4), assets=(1, 6), spread=1.0))
def test_forward_solutions_equal_enumeration(drawn):
    action = drawn.problem.solve(drawn.belief)
    value, winner = enumeration.value(drawn.market, drawn.belief)
    scale = cost_scale(drawn.problem, action)
    assert float(drawn.problem.optimal_cost(drawn.belief)) == pytest.approx(value, abs=1e-9 * scale)
    curvature = np.linalg.eigvalsh(np.tensordot(drawn.belief, drawn.market.covariances, 1))
    if curvature[0] > 1e-3 * curvature[-1]:
        np.testing.assert_allclose(action, winner, atol=1e-9)
        np.testing.assert_array_equal(action == 0, winner < 1e-12)


@pytest.mark.parametrize("kind", ["box", "sector", "redundant", "duplicated", "net and limits", "equalities"])
@settings(max_examples=instances(40), deadline=None)
@given(SEEDS)
def test_forward_solutions_over_general_sets_equal_enumeration(kind, seed):
    rng = np.random.default_rng(seed)
    size, n_states = int(rng.integers(2, 5)), int(rng.integers(1, 4))
    regions = {
        "box": box(-rng.uniform(0, 1, size), rng.uniform(0.1, 1, size)),
        "sector": simplex(size) & Polyhedron([np.eye(size)[0] + np.eye(size)[1]], [0.3]) if size > 2 else simplex(size),
        "redundant": simplex(size) & box([-1] * size, [2] * size),
        "duplicated": simplex(size) & simplex(size),
        "net and limits": box([-0.5] * size, [0.8] * size) & Polyhedron(A_eq=np.ones((1, size)), b_eq=[0.5]),
        "equalities": Polyhedron(A_eq=np.ones((1, size)), b_eq=[1.0]),
    }
    region = regions[kind]
    factors = rng.normal(size=(n_states, size, size + 2))
    hessians, linear = factors @ factors.transpose(0, 2, 1), 3 * rng.normal(size=(n_states, size))
    problem = QuadraticProblem(hessians, linear, constraints=region)
    belief = rng.dirichlet(np.ones(n_states))
    action = problem.solve(belief)
    np.testing.assert_allclose(problem.solve(np.tile(belief, (20, 1)))[-1], action, atol=1e-12)
    value, winner = enumeration.quadratic_value(
        np.tensordot(belief, hessians, 1), belief @ linear, region.A_ub, region.b_ub, region.A_eq, region.b_eq
    )
    assert float(problem.optimal_cost(belief)) == pytest.approx(value, abs=1e-9)
    np.testing.assert_allclose(action, winner, atol=1e-8)
    assert kkt_residual(problem, belief, action) <= 10 * KKT
    assert region.violation(action) <= 1e-12


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_the_repair_of_a_degenerate_programme_goes_the_whole_way(seed):
    """From any feasible point, not only from one that is nearly right."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 5))
    region = simplex(size) & Polyhedron([rng.uniform(0, 1, size)], [1.0])
    factor = rng.normal(size=(size, size))
    hessian, linear = factor @ factor.T / size, rng.normal(size=size)
    unused = _Working(np.zeros(size, dtype=np.int8), np.zeros(1, dtype=bool))
    scale = max(np.abs(hessian).max(), np.abs(linear).max())
    start = np.eye(size)[rng.integers(size)] if rng.uniform() < 0.5 else rng.dirichlet(np.ones(size))
    action = _repair(hessian / scale, linear / scale, layout_of(region), unused, start)
    rows = (region.A_ub, region.b_ub, region.A_eq, region.b_eq)
    np.testing.assert_allclose(action, enumeration.quadratic_value(hessian, linear, *rows)[1], atol=1e-7)


def test_many_beliefs_are_solved_as_one_is():
    drawn = markets.random_market(np.random.default_rng(3), 4, 12)
    problem = MarkowitzProblem(*drawn)
    beliefs = np.random.default_rng(4).dirichlet(np.ones(4), 200)
    together = problem.solve(beliefs)
    assert together.shape == (200, 12)
    for belief, action in zip(beliefs, together, strict=True):
        alone = problem.solve(belief)
        np.testing.assert_array_equal(alone == 0, action == 0)
        np.testing.assert_allclose(alone, action, atol=1e-13)


def test_duplicated_and_singular_assets_still_have_a_decision():
    problem = MarkowitzProblem(np.zeros((2, 3)), np.zeros((2, 3, 3)), 1.0)  # no cost at all: anything is optimal
    action = problem.solve([0.5, 0.5])
    assert problem.constraints.violation(action) <= 1e-12
    linear_only = MarkowitzProblem([[0.1, 0.2, 0.0], [0.1, 0.2, 0.0]], np.zeros((2, 3, 3)), 1.0)
    np.testing.assert_allclose(linear_only.solve([0.5, 0.5]), [0, 1, 0], atol=1e-12)


def test_a_tie_between_two_corners_is_settled_the_same_way_every_time():
    tie = MarkowitzProblem([[1.0, 1.0], [1.0, 1.0]], np.zeros((2, 2, 2)), 1.0)
    first = tie.solve([0.3, 0.7])
    assert float(tie.regret([0.3, 0.7], first)) == 0
    np.testing.assert_array_equal(first, tie.solve([0.3, 0.7]))


# --- closed forms -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n_states", [2, 3, 5])
def test_the_belief_market_has_its_closed_form(n_states):
    problem = belief_problem(n_states)
    rng = np.random.default_rng(1)
    belief, decoy = rng.dirichlet(np.full(n_states, 5.0), 2)
    np.testing.assert_allclose(problem.solve(belief), 0.5 / n_states + belief / 2, atol=1e-14)
    assert float(problem.regret(belief, problem.solve(decoy))) == pytest.approx(np.sum((belief - decoy) ** 2) / 4)


def test_the_papers_cost_has_no_half():
    problem = MarkowitzProblem([[0.1, 0.2]], [[[0.04, 0.01], [0.01, 0.09]]], 3.0)
    action = np.array([0.25, 0.75])
    expected = 3.0 * (0.04 * 0.0625 + 2 * 0.01 * 0.1875 + 0.09 * 0.5625) - (0.1 * 0.25 + 0.2 * 0.75)
    np.testing.assert_allclose(problem.state_costs(action), [expected], atol=1e-15)
    gradient = 2 * 3.0 * np.array([[0.04, 0.01], [0.01, 0.09]]) @ action - [0.1, 0.2]
    np.testing.assert_allclose(problem.cost_gradients(action), [gradient], atol=1e-15)


def test_state_costs_and_gradients_of_many_actions_have_the_leading_shape():
    problem = MarkowitzProblem(*markets.random_market(np.random.default_rng(0), 3, 4))
    actions = np.random.default_rng(1).dirichlet(np.ones(4), (2, 5))
    assert problem.state_costs(actions).shape == (2, 5, 3)
    assert problem.cost_gradients(actions).shape == (2, 5, 3, 4)
    np.testing.assert_allclose(problem.state_costs(actions)[1, 2], problem.state_costs(actions[1, 2]), rtol=1e-14)
    market = markets.Market(problem.means, problem.covariances, problem.risk_aversion)
    np.testing.assert_allclose(problem.state_costs(actions[0, 0]), markets.costs(market, actions[0, 0]), rtol=1e-13)
    np.testing.assert_allclose(
        problem.cost_gradients(actions[0, 0]).T, markets.gradients(market, actions[0, 0]), rtol=1e-12
    )


def test_expected_costs_and_regrets_pair_and_broadcast():
    problem = line_problem([4.0, 0.0])
    beliefs = np.array([[0.2, 0.8], [0.6, 0.4], [0.1, 0.9]])
    actions = np.array([[0.5, 0.5], [1.0, 0.0], [0.0, 1.0]])
    paired = problem.expected_cost(beliefs, actions)
    assert paired.shape == (3,)
    for belief, action, cost in zip(beliefs, actions, paired, strict=True):
        assert float(problem.expected_cost(belief, action)) == pytest.approx(cost)
    assert problem.expected_cost(beliefs, actions[0]).shape == (3,)
    assert problem.expected_cost(beliefs[0], actions).shape == (3,)
    assert np.ndim(problem.expected_cost(beliefs[0], actions[0])) == 0
    np.testing.assert_allclose(problem.regret(beliefs, actions), paired - problem.optimal_cost(beliefs), atol=1e-15)
    # By hand: π = (.2, .8), u = (.5, .5): cost .5 − .4 = .1; u* = (.7, .3): .58 − .56 = .02.
    np.testing.assert_allclose(problem.regret(beliefs[0], actions[0]), 0.08, atol=1e-15)


def test_a_quadratic_problem_has_its_half_and_its_constants():
    problem = QuadraticProblem([[[2.0]], [[4.0]]], [[-1.0], [0.0]], [10.0, -5.0], constraints=box([-1.0], [1.0]))
    np.testing.assert_allclose(problem.state_costs([0.5]), [0.25 - 0.5 + 10, 0.5 - 5])
    np.testing.assert_allclose(problem.state_costs([[0.5], [0.0]]), [[0.25 - 0.5 + 10, 0.5 - 5], [10, -5]])
    assert problem.solve([1.0, 0.0]) == pytest.approx([0.5])
    assert float(problem.optimal_cost([1.0, 0.0])) == pytest.approx(9.75)


def test_an_unbounded_set_is_fine_where_the_cost_closes_it():
    problem = QuadraticProblem([np.eye(2)], [[-3.0, 1.0]], constraints=Polyhedron([[-1.0, 0.0]], [0.0]))
    np.testing.assert_allclose(problem.solve([1.0]), [3.0, -1.0], atol=1e-12)


# --- facts ------------------------------------------------------------------------------------------------------------


@settings(max_examples=instances(100), deadline=None)
@given(drawn_problems(states=(2, 6), assets=(2, 15)))
def test_fact_f1_regret_never_falls_along_a_ray(drawn):
    target = drawn.rng.dirichlet(np.ones(drawn.belief.size))
    rays = drawn.belief + np.linspace(0, 1, 21)[:, None] * (target - drawn.belief)
    regrets = drawn.problem.regret(drawn.belief, drawn.problem.solve(rays))
    scale = cost_scale(drawn.problem, drawn.problem.solve(drawn.belief))
    assert regrets[0] <= 1e-13 * scale
    assert np.diff(regrets).min() >= -1e-12 * max(scale, cost_scale(drawn.problem, drawn.problem.solve(target)))


@settings(max_examples=instances(60), deadline=None)
@given(drawn_problems(states=(2, 6), assets=(2, 15)))
def test_the_optimal_cost_is_concave_and_no_action_beats_it(drawn):
    first, second = drawn.rng.dirichlet(np.ones(drawn.belief.size), 2)
    share = drawn.rng.uniform()
    mixed = share * first + (1 - share) * second
    actions = drawn.problem.solve(np.vstack([first, second, mixed]))
    scale = max(cost_scale(drawn.problem, action) for action in actions)
    value = drawn.problem.optimal_cost(np.vstack([first, second, mixed]))
    assert value[2] >= share * value[0] + (1 - share) * value[1] - 1e-12 * scale
    rivals = drawn.rng.dirichlet(np.ones(actions.shape[1]), 30)
    costs = drawn.problem.expected_cost(first, rivals)
    assert costs.min() >= value[0] - 1e-12 * max(scale, max(cost_scale(drawn.problem, rival) for rival in rivals))


@settings(max_examples=instances(60), deadline=None)
@given(drawn_problems(states=(2, 5), assets=(2, 10)))
def test_fact_f5_state_costs_give_every_regret(drawn):
    """The cost of any action under any belief is one product with its state costs, which no belief enters."""
    actions = drawn.problem.solve(drawn.rng.dirichlet(np.ones(drawn.belief.size), 6))
    beliefs = drawn.rng.dirichlet(np.ones(drawn.belief.size), 4)
    table = beliefs @ drawn.problem.state_costs(actions).T
    for row, belief in zip(table, beliefs, strict=True):
        scale = max(cost_scale(drawn.problem, action) for action in actions)
        np.testing.assert_allclose(drawn.problem.expected_cost(belief, actions), row, atol=1e-13 * scale)
        np.testing.assert_allclose(
            drawn.problem.regret(belief, actions), row - drawn.problem.optimal_cost(belief), atol=1e-12 * scale
        )


@settings(max_examples=instances(60), deadline=None)
@given(drawn_problems(states=(2, 5), assets=(2, 10), spread=1.0))
def test_fact_f7_what_a_budget_aware_observer_knows_is_convex_and_holds_the_truth(drawn):
    decoy = drawn.rng.dirichlet(np.ones(drawn.belief.size))
    action = drawn.problem.solve(decoy)
    budget = float(drawn.problem.regret(drawn.belief, action))
    beliefs = np.vstack([drawn.belief, drawn.rng.dirichlet(np.ones(drawn.belief.size), 30)])
    regrets = drawn.problem.regret(beliefs, action)
    scale = cost_scale(drawn.problem, action)
    members = beliefs[regrets <= budget + 1e-12 * scale]
    assert len(members)
    middles = (members[:, None] + members[None]).reshape(-1, drawn.belief.size) / 2
    assert drawn.problem.regret(middles, action).max() <= budget + 1e-11 * scale


def test_the_helpers_are_what_they_say():
    assert long_only(3, 0.0).min_slack == 0
    np.testing.assert_allclose(line_problem([4.0, 0.0]).solve([0.2, 0.8]), [0.7, 0.3], atol=1e-14)
