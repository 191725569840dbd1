"""Near-optimal beliefs and the plausibility gap: against fine grids, closed forms and independent minimisation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from scipy.optimize import brentq, linprog, minimize_scalar

from inscrutable import (
    Budget,
    BudgetAwareAdversary,
    FiniteProblem,
    InputError,
    KellyProblem,
    MarkowitzProblem,
    NearOptimalAdversary,
    Prior,
    QuadraticProblem,
    consistent_beliefs,
    near_optimal_beliefs,
    plausibility_gap,
    simplex_grid,
)
from oracles import enumeration
from sizes import instances
from strategies import belief_problem, cost_scale, drawn_problems, line_problem

FINE = 200  # grid steps: a distance of 1/200 per coordinate


def regrets_on(drawn, beliefs, action):
    """Regrets by enumeration of supports."""
    beliefs = np.asarray(beliefs)
    return beliefs @ drawn.problem.state_costs(action) - enumeration.values(drawn.market, beliefs)[0]


def some_action(drawn, epsilon_share):
    """A perturbed optimal action and a regret that admits some beliefs but not all."""
    action = drawn.problem.solve(drawn.belief)
    action = 0.97 * action + 0.03 * drawn.rng.dirichlet(np.ones(action.size))
    corners = drawn.problem.regret(np.eye(drawn.belief.size), action)
    low = plausibility_gap(drawn.problem, action)
    return action, low + epsilon_share * (corners.max() - low)


# --- the plausibility gap -----------------------------------------------------------------------------------------------


def test_the_gap_by_hand():
    # Everything in asset 1, costs u'u and 2u'u: v = (½, ½) saves ½ in state 1 and 1 in state 2.
    problem = MarkowitzProblem(np.zeros((2, 2)), [np.eye(2), 2 * np.eye(2)], 1.0)
    assert plausibility_gap(problem, [1.0, 0.0]) == pytest.approx(0.5, abs=1e-9)
    # Means (π·m, 0): u_1 would be ½ + π·m/4 <= ½ + ¼, so u_1 = 1 leaves 2(1 − ¾)² = 1/8 at the best state.
    assert plausibility_gap(line_problem([1.0, 0.0]), [1.0, 0.0]) == pytest.approx(0.125, abs=1e-9)
    assert plausibility_gap(line_problem([4.0, 0.0]), [1.0, 0.0]) == pytest.approx(0, abs=1e-9)


@settings(max_examples=instances(40), deadline=None)
@given(drawn_problems(states=(2, 2), assets=(2, 5), kinds=[{}], spread=1.0))
def test_the_gap_is_that_of_a_scalar_minimisation(drawn):
    action = drawn.rng.dirichlet(np.ones(drawn.problem.n_actions))

    def regret(share):
        return float(regrets_on(drawn, [np.array([share, 1 - share])], action)[0])

    shares = np.linspace(0, 1, 21)
    start = shares[np.argmin([regret(share) for share in shares])]
    found = minimize_scalar(
        regret, bounds=(max(0, start - 0.05), min(1, start + 0.05)), method="bounded", options={"xatol": 1e-10}
    )
    expected = min(found.fun, regret(0.0), regret(1.0))
    scale = cost_scale(drawn.problem, action)
    assert plausibility_gap(drawn.problem, action) == pytest.approx(max(expected, 0), abs=1e-8 * scale)


@settings(max_examples=instances(15), deadline=None)
@given(drawn_problems(states=(3, 3), assets=(2, 4), kinds=[{}], spread=1.0))
def test_the_gap_is_below_a_dense_grid_and_above_its_planes(drawn):
    """Between the least of a grid and the least of the planes that touch −V at the grid: two independent bounds."""
    action = drawn.rng.dirichlet(np.ones(drawn.problem.n_actions))
    grid = simplex_grid(3, 30)
    _, winners = enumeration.values(drawn.market, grid)
    planes = drawn.problem.state_costs(action) - drawn.problem.state_costs(winners)
    upper = min(belief @ plane for belief, plane in zip(grid, planes, strict=True))
    scale = np.abs(planes).max()
    answer = linprog(
        [0, 0, 0, 1], np.column_stack([planes / scale, -np.ones(len(grid))]), np.zeros(len(grid)), [[1, 1, 1, 0]], [1]
    )
    gap = plausibility_gap(drawn.problem, action)
    tolerance = 1e-8 * max(cost_scale(drawn.problem, action), scale)
    assert answer.fun * scale - tolerance <= gap <= upper + tolerance


@settings(max_examples=instances(60), deadline=None)
@given(drawn_problems(states=(2, 5), assets=(2, 8), spread=1.0))
def test_the_gap_is_zero_exactly_where_some_belief_explains(drawn):
    action = drawn.problem.solve(drawn.belief)
    scale = max(cost_scale(drawn.problem, at) for at in [action, *drawn.problem.solve(np.eye(drawn.belief.size))])
    assert plausibility_gap(drawn.problem, action) <= 1e-9 * scale
    other = 0.5 * action + 0.5 * drawn.rng.dirichlet(np.ones(action.size))
    found = consistent_beliefs(drawn.problem, other)
    gap = plausibility_gap(drawn.problem, other)
    assert gap >= 0
    if not found.is_empty:
        assert gap <= 1e-8 * scale
    elif found.residual > 1e-2:
        assert gap > 0
        assert found.plausibility_gap == gap
    assert gap <= drawn.problem.regret(np.eye(drawn.belief.size), other).min() + 1e-12 * scale


# --- the set ------------------------------------------------------------------------------------------------------------


def test_a_disc_in_closed_form():
    """ρ(π, u*(y)) = ‖π − y‖²/4: the set at ε is the disc of radius 2√ε around y."""
    problem = belief_problem(3)
    decoy = np.array([0.4, 0.3, 0.3])
    radius = 0.1
    found = near_optimal_beliefs(problem, problem.solve(decoy), radius**2 / 4)
    away = np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    assert found.contains(decoy + 0.999 * radius * away)
    assert not found.contains(decoy + 1.001 * radius * away)
    # The largest coordinate of a unit vector that sums to zero is √(2/3).
    reach = radius * np.sqrt(2 / 3)
    np.testing.assert_allclose(found.bounds(), np.column_stack([decoy - reach, decoy + reach]), atol=1e-4)
    target = decoy + 0.3 * away
    assert found.distance(target) == pytest.approx(0.2, abs=1e-4)
    np.testing.assert_allclose(found.nearest(target), decoy + radius * away, atol=1e-3)
    assert found.distance(decoy) == 0
    np.testing.assert_allclose(found.center(), decoy, atol=0.02)
    assert found.dimension == 2
    sample = found.sample(300, rng=np.random.default_rng(0))
    assert np.linalg.norm(sample - decoy, axis=1).max() <= radius * np.sqrt(1.02)
    assert np.linalg.norm(sample - decoy, axis=1).max() >= 0.9 * radius
    assert (problem.regret(found.vertices(), found.action) <= 1.011 * found.regret).all()


@settings(max_examples=instances(25), deadline=None)
@given(drawn_problems(states=(2, 2), assets=(2, 4), kinds=[{}], spread=1.0))
def test_two_states_bounds_are_those_of_a_fine_grid(drawn):
    action, epsilon = some_action(drawn, 0.3)
    shares = np.linspace(0, 1, FINE + 1)
    beliefs = np.column_stack([shares, 1 - shares])
    regrets = regrets_on(drawn, beliefs, action)
    inside = regrets <= epsilon
    found = near_optimal_beliefs(drawn.problem, action, epsilon)
    assert not found.is_empty
    (low, high), (other_low, other_high) = found.bounds()
    assert low + other_high == pytest.approx(1, abs=1e-6)
    assert high + other_low == pytest.approx(1, abs=1e-6)
    assume(inside.any())
    # Where the regret is flat, the accuracy of ε alone moves an end by more than a step of the grid.
    attained = regrets <= epsilon + found.accuracy
    assert low - 1e-4 <= shares[inside].min()
    assert shares[attained].min() <= low + 1.01 / FINE
    assert high + 1e-4 >= shares[inside].max()
    assert shares[attained].max() >= high - 1.01 / FINE
    for share, is_in in zip(shares[::20], inside[::20], strict=True):
        distance = max(low - share, share - high, 0.0) * np.sqrt(2)
        assert found.distance([share, 1 - share]) == pytest.approx(distance, abs=1e-4)
        if abs(share - low) > 1e-3 and abs(share - high) > 1e-3:
            assert found.contains([share, 1 - share]) == is_in


@settings(max_examples=instances(8), deadline=None)
@given(drawn_problems(states=(3, 3), assets=(2, 3), kinds=[{}], spread=1.0))
def test_three_states_bounds_and_distances_are_those_of_a_fine_grid(drawn):
    action, epsilon = some_action(drawn, 0.3)
    grid = simplex_grid(3, 60)
    members = grid[regrets_on(drawn, grid, action) <= epsilon]
    found = near_optimal_beliefs(drawn.problem, action, epsilon)
    assume(len(members) > 20)
    bounds = found.bounds()
    assert (members >= bounds[:, 0] - 1e-4).all()
    assert (members <= bounds[:, 1] + 1e-4).all()
    # Every belief reported is nearly optimal itself, so bounds are reached, not only valid.
    target = drawn.rng.dirichlet(np.ones(3))
    nearest = found.nearest(target)
    assert regrets_on(drawn, [nearest], action)[0] <= epsilon + 1e-5 * cost_scale(drawn.problem, action)
    on_grid = np.linalg.norm(members - target, axis=1).min()
    assert found.distance(target) <= on_grid + 1e-6
    assert found.distance(target) >= on_grid - 2 * np.sqrt(2) / 60
    assert np.linalg.norm(target - nearest) == pytest.approx(found.distance(target), abs=1e-12)


@settings(max_examples=instances(25), deadline=None)
@given(drawn_problems(states=(2, 4), assets=(2, 8), spread=1.0))
def test_contains_is_regret_and_sets_are_nested(drawn):
    action, large = some_action(drawn, 0.5)
    _, small = some_action(drawn, 0.1)
    small = min(small, large / 2)
    wide, narrow = (near_optimal_beliefs(drawn.problem, action, epsilon) for epsilon in (large, small))
    beliefs = drawn.rng.dirichlet(np.ones(drawn.belief.size), 20)
    regrets = drawn.problem.regret(beliefs, action)
    for belief, regret in zip(beliefs, regrets, strict=True):
        for found in (wide, narrow):
            if abs(regret - found.regret) > 2 * found.accuracy:
                assert found.contains(belief) == (regret <= found.regret)
        if narrow.contains(belief):
            assert wide.distance(belief) == 0
    assert wide.distance(drawn.belief) <= narrow.distance(drawn.belief) + 1e-6


def test_at_no_regret_the_set_is_theorem_ones():
    problem = line_problem([1.0, 0.0, -1.0])
    action = problem.solve([0.5, 0.5, 0.0])
    exact, near = consistent_beliefs(problem, action), near_optimal_beliefs(problem, action, 0.0)
    assert not near.is_empty
    np.testing.assert_allclose(near.bounds(), exact.bounds(), atol=5e-3)  # a regret of 1e-7 is a distance of 3e-4
    assert near.distance([0.0, 0.0, 1.0]) == pytest.approx(exact.distance([0.0, 0.0, 1.0]), abs=5e-3)


def test_below_the_gap_the_set_is_empty_and_says_by_how_much():
    problem = line_problem([1.0, 0.0])
    found = near_optimal_beliefs(problem, [1.0, 0.0], 0.1)  # the gap is 1/8
    assert found.is_empty
    assert found.dimension == -1
    assert found.plausibility_gap == pytest.approx(0.125, abs=1e-8)
    assert found.residual == pytest.approx(0.025, abs=1e-8)
    assert found.distance([0.5, 0.5]) == np.inf
    assert found.vertices().shape == (0, 2)
    assert np.isnan(found.bounds()).all()
    assert np.isnan(found.center()).all()
    assert np.isnan(found.nearest([0.5, 0.5])).all()
    with pytest.raises(InputError, match="empty"):
        found.sample(3, rng=np.random.default_rng(0))
    reached = near_optimal_beliefs(problem, [1.0, 0.0], 0.126)
    assert not reached.is_empty
    assert reached.bounds()[0, 1] == pytest.approx(1, abs=1e-6)


def test_rounded_weights_are_explained_at_the_regret_of_rounding():
    problem = belief_problem(3)
    belief = np.array([0.312, 0.41, 0.278])
    rounded = np.array([0.32, 0.37, 0.31])
    assert np.abs(rounded - problem.solve(belief)).max() <= 0.005
    found = near_optimal_beliefs(problem, rounded, 2 * 3 * 0.005**2)
    assert found.contains(belief)
    assert found.distance([1.0, 0, 0]) > 0.5


def test_everything_is_near_optimal_at_a_large_regret_and_one_state_is_no_riddle():
    whole = near_optimal_beliefs(belief_problem(3), [1 / 3, 1 / 3, 1 / 3], 100.0)
    np.testing.assert_allclose(whole.bounds(), np.tile([0, 1], (3, 1)), atol=1e-9)
    single = MarkowitzProblem([[0.1, 0.2]], [np.eye(2)], 1.0)
    assert plausibility_gap(single, single.solve([1.0])) == pytest.approx(0, abs=1e-12)
    found = near_optimal_beliefs(single, [0.5, 0.5], 1.0)
    assert found.distance([1.0]) == 0
    assert found.bounds().tolist() == [[1.0, 1.0]]


@pytest.mark.parametrize("constant", [1e2, 1e4, 1e6])
def test_a_constant_in_the_costs_changes_no_set(constant, fresh_rng):
    """Regrets are differences of costs: sets, and the members of a prior, are those without the constant."""
    plain = MarkowitzProblem(0.2 * np.eye(2), [np.eye(2), np.eye(2)], 1.0)
    added = QuadraticProblem(plain.hessians, plain.linear, [constant, 0.0], constraints=plain.constraints)
    table, choice = fresh_rng.uniform(size=(3, 4)), int(fresh_rng.integers(4))
    pairs = [
        (plain, added, np.array([0.5, 0.5]), 1e-4),
        (FiniteProblem(table), FiniteProblem(table + constant), choice, float(fresh_rng.uniform(0.1, 0.3))),
    ]
    for small, large, action, regret in pairs:
        expected = near_optimal_beliefs(small, action, regret).bounds()
        np.testing.assert_allclose(near_optimal_beliefs(large, action, regret).bounds(), expected, atol=1e-6)
        observed = BudgetAwareAdversary(large, Budget.regret(regret)).infer(action)
        np.testing.assert_allclose(observed.bounds(), expected, atol=1e-6)
        beliefs = fresh_rng.dirichlet(np.ones(small.n_states), 200)
        prior = Prior(beliefs, np.full(200, 1.0 / 200))
        estimates = [NearOptimalAdversary(each, regret, prior=prior).estimate(action) for each in (small, large)]
        np.testing.assert_allclose(*estimates, atol=1e-9)


@pytest.mark.parametrize("ruined", [False, True])
@pytest.mark.parametrize("limit", [1e-5, 1e-4, 1e-2])
def test_sets_of_growth_are_as_accurate_as_those_of_other_costs(limit, ruined):
    """Regrets in a race are relative entropies. The cost of ruin set the accuracy, 1e-3 for all sets."""
    n_states = 3 if ruined else 2
    problem = KellyProblem(2.0 * np.eye(n_states)[:, None, :], np.ones((n_states, 1)))
    action = np.array([0.45, 0.55, 0.0])[:n_states]

    def excess(x):
        return x * np.log(x / 0.45) + (1 - x) * np.log((1 - x) / 0.55) - limit

    expected = [brentq(excess, 1e-9, 0.45), brentq(excess, 0.45, 1 - 1e-9)]
    near, aware = NearOptimalAdversary(problem, limit), BudgetAwareAdversary(problem, Budget.regret(limit))
    for observer in (near, aware):
        found = observer.infer(action)
        np.testing.assert_allclose(found.bounds()[0], expected, atol=3e-5)
        np.testing.assert_allclose(found.vertices()[:, 2:], 0.0, atol=1e-9)
    inside, outside = (expected[1] + move * (expected[1] - 0.45) for move in (-0.1, 0.1))
    beliefs = np.zeros((3, n_states))
    beliefs[:, 0] = inside, outside, 0.3
    beliefs[:, n_states - 1] += [0.0, 0.0, 0.1]
    beliefs[:, 1] += 1.0 - beliefs.sum(axis=1)
    assert [near.infer(action).contains(each) for each in beliefs] == [True, False, False]
    prior = Prior(beliefs, np.full(3, 1.0 / 3.0))
    for reader in (
        NearOptimalAdversary(problem, limit, prior=prior),
        BudgetAwareAdversary(problem, Budget.regret(limit), prior=prior),
    ):
        np.testing.assert_allclose(reader.estimate(action), beliefs[0], atol=1e-12)


def test_the_gap_of_growth_is_as_accurate_as_that_of_other_costs():
    """The cost of ruin set its accuracy, 1e-5. At a race's best belief all horses pay the same share of what they would."""
    rng = np.random.default_rng(7)
    for n_states in (2, 3, 4):
        odds, shares = rng.uniform(n_states, n_states + 2, n_states), 0.95 * rng.dirichlet(np.full(n_states, 3.0))
        returns = np.column_stack([np.diag(odds), np.full(n_states, 0.5)])
        problem = KellyProblem(returns[:, None, :], np.ones((n_states, 1)))
        least = -np.log(0.95 + 0.05 * 0.5 * (1.0 / odds).sum())
        assert plausibility_gap(problem, [*shares, 0.05]) == pytest.approx(least, abs=1e-8)


@pytest.mark.parametrize("budget", [1e-4, 0.01])
def test_a_share_of_growth_explains_what_is_optimal_and_stakes_nothing_on_a_state(budget):
    odds = np.array([3.9, 3.57, 2.96, 2.46, 2.93])
    problem = KellyProblem(np.diag(odds)[:, None, :], np.ones((5, 1)))
    belief = np.array([0.365, 0.0925, 0.0, 0.112, 0.4305])
    found = BudgetAwareAdversary(problem, budget).infer(problem.solve(belief))
    assert not found.is_empty
    assert found.contains(belief)
    assert found.distance(belief) == 0.0


def test_a_rounded_stake_of_nothing_leaves_its_state_possible():
    """Rounding then allows for ruin itself."""
    problem = KellyProblem(2.0 * np.eye(2)[:, None, :], np.ones((2, 1)))
    found = consistent_beliefs(problem, [0.0, 1.0], digits=1)
    assert found.contains([0.03, 0.97])
    assert found.bounds()[0, 1] >= 0.05
    assert found.distance([0.03, 0.97]) == 0.0
