"""The beliefs an action is optimal for: against lifted linear and quadratic programmes, enumeration and hand-worked cases."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from inscrutable import (
    MarkowitzProblem,
    Polyhedron,
    QuadraticProblem,
    box,
    consistent_beliefs,
    long_short,
    simplex,
    turnover,
    with_transaction_costs,
)
from inscrutable.adversaries import consistent_sets
from inscrutable.geometry import BeliefSet
from oracles import consistent
from sizes import instances
from strategies import (
    SEEDS,
    belief_problem,
    cost_scale,
    drawn_problems,
    is_well_posed,
    line_problem,
    long_only,
    system_of,
)

VERTEX_REGRET = 1e-9  # relative to the cost's scale
AGREEMENT = 1e-6  # with the oracle, in belief, on well-posed sets

# --- properties over random problems --------------------------------------------------------------------------------


@settings(max_examples=instances(300), deadline=None)
@given(drawn_problems())
def test_the_belief_explains_its_own_decision_and_every_corner_does(drawn):
    action = drawn.problem.solve(drawn.belief)
    found = consistent_beliefs(drawn.problem, action)
    assert not found.is_empty
    assert found.contains(drawn.belief)
    assert found.distance(drawn.belief) == 0
    assert found.residual <= 1e-10
    assert found.plausibility_gap == 0

    corners = found.vertices()
    np.testing.assert_allclose(corners.sum(axis=1), 1, atol=1e-12)
    assert corners.min() >= 0
    regrets = drawn.problem.regret(corners, action)
    assert regrets.max() <= VERTEX_REGRET * cost_scale(drawn.problem, action)


@settings(max_examples=instances(150), deadline=None)
@given(drawn_problems(min_slack=1e-4))
def test_a_smallest_weight_only_widens_the_set(drawn):
    action = drawn.problem.solve(drawn.belief)
    widened = consistent_beliefs(drawn.problem, action)
    assert widened.contains(drawn.belief)
    letter = MarkowitzProblem(*drawn.market, constraints=long_only(action.size, 0.0))
    for corner in consistent_beliefs(letter, action).vertices():
        assert widened.distance(corner) <= AGREEMENT


@settings(max_examples=instances(300), deadline=None)
@given(drawn_problems(states=(2, 6), assets=(2, 20), spread=1.0), st.booleans())
def test_bounds_and_distance_are_the_oracles(drawn, optimal):
    """Well posed: every singular value of the projected stationarity system is clearly zero or clearly not."""
    action = drawn.problem.solve(drawn.belief)
    if not optimal:  # an action a few assets hold, explained or not
        held = drawn.rng.choice(action.size, min(2, action.size), replace=False)
        action = np.zeros(action.size)
        action[held] = drawn.rng.dirichlet(np.ones(held.size))
    system = system_of(drawn.problem, action)
    assume(is_well_posed(system))
    residual = consistent.smallest_residual(system)
    assume(residual < 1e-11 or residual > 1e-8)
    found = consistent_beliefs(drawn.problem, action)
    assert found.is_empty == (residual > 1e-9)
    if found.is_empty:
        assert found.residual > 1e-10
        return
    np.testing.assert_allclose(found.bounds(), consistent.bounds(system), atol=AGREEMENT)
    for target in (drawn.belief, drawn.rng.dirichlet(np.ones(drawn.belief.size)), np.eye(drawn.belief.size)[0]):
        nearest = found.nearest(target)
        assert found.distance(target) == pytest.approx(consistent.distance(system, target), abs=AGREEMENT)
        np.testing.assert_allclose(nearest, consistent.nearest(system, target), atol=10 * AGREEMENT)
        assert found.violation(nearest) <= AGREEMENT


@settings(max_examples=instances(150), deadline=None)
@given(drawn_problems(states=(2, 4), assets=(2, 8), spread=1.0))
def test_vertices_are_the_oracles(drawn):
    action = drawn.problem.solve(drawn.belief)
    system = system_of(drawn.problem, action)
    assume(is_well_posed(system))
    found, expected = consistent_beliefs(drawn.problem, action).vertices(), consistent.vertices(system)
    assert same_points(found, expected), f"found {found}, expected {expected}"


def same_points(found, expected, atol=AGREEMENT):
    if not len(found) or not len(expected):
        return len(found) == len(expected)
    apart = np.abs(found[:, None] - expected[None]).max(axis=2)
    return len(found) == len(expected) and apart.min(axis=0).max() <= atol and apart.min(axis=1).max() <= atol


@settings(max_examples=instances(100), deadline=None)
@given(drawn_problems(states=(2, 4), assets=(5, 30), kinds=[{}], spread=0.0))
def test_an_interior_action_with_more_assets_than_states_is_unexplained(drawn):
    action = drawn.rng.dirichlet(np.ones(drawn.problem.n_actions)) * 0.9 + 0.1 / drawn.problem.n_actions
    found = consistent_beliefs(drawn.problem, action)
    assert found.is_empty
    assert found.dimension == -1
    assert found.residual > 1e-8
    # The library's residual is that of equations in an orthonormal basis: the largest entry differs by at most √U.
    expected, factor = consistent.smallest_residual(system_of(drawn.problem, action)), np.sqrt(action.size)
    assert expected / factor <= found.residual * (1 + 1e-6) <= expected * factor * (1 + 2e-6)
    assert found.plausibility_gap > 0
    assert found.distance(drawn.belief) == np.inf
    assert found.vertices().shape == (0, drawn.belief.size)
    assert np.isnan(found.bounds()).all()
    assert np.isnan(found.center()).all()
    assert np.isnan(found.interior_point()).all()
    assert np.isnan(found.nearest(drawn.belief)).all()


@settings(max_examples=instances(100), deadline=None)
@given(drawn_problems(states=(2, 6), assets=(2, 12), spread=1.0))
def test_fact_f3_the_distance_to_the_set_is_at_most_the_distance_to_the_decoy(drawn):
    decoy = drawn.rng.dirichlet(np.ones(drawn.belief.size))
    found = consistent_beliefs(drawn.problem, drawn.problem.solve(decoy))
    apart = np.linalg.norm(drawn.belief - decoy)
    assert found.distance(drawn.belief) <= apart + 1e-12
    if found.dimension == 0:
        assert found.distance(drawn.belief) == pytest.approx(apart, abs=AGREEMENT)


@settings(max_examples=instances(100), deadline=None)
@given(drawn_problems(states=(2, 5), assets=(2, 8), spread=1.0))
def test_samples_centre_and_bounds_belong_together(drawn):
    found = consistent_beliefs(drawn.problem, drawn.problem.solve(drawn.belief))
    sample = found.sample(20, rng=drawn.rng)
    assert sample.shape == (20, drawn.belief.size)
    for point in [*sample, found.center()]:
        assert found.distance(point) <= AGREEMENT
        assert (point >= found.bounds()[:, 0] - AGREEMENT).all()
        assert (point <= found.bounds()[:, 1] + AGREEMENT).all()
    np.testing.assert_allclose(found.center(), found.vertices().mean(axis=0), atol=1e-15)


@settings(max_examples=instances(60), deadline=None)
@given(drawn_problems(states=(2, 6), assets=(2, 5), spread=1.0))
def test_the_interior_point_is_on_no_border_it_could_be_off(drawn):
    """Wherever a linear programme finds a member with slack in a row, the point has slack in it too."""
    found = consistent_beliefs(drawn.problem, drawn.problem.solve(drawn.belief))
    point = found.interior_point()
    assert found.contains(point)
    assert point.sum() == pytest.approx(1.0, abs=1e-9)
    size = found.n_states
    for row in np.vstack([np.eye(size), found.inequalities]):
        most = linprog(
            -row,
            np.vstack([-found.inequalities, found.equalities, -found.equalities]),
            np.full(len(found.inequalities) + 2 * len(found.equalities), 1e-10),
            np.ones((1, size)),
            [1.0],
        )
        if -most.fun > 1e-4:
            assert row @ point > -1e-3 * most.fun


@settings(max_examples=instances(60), deadline=None)
@given(drawn_problems(states=(2, 5), assets=(2, 6), spread=1.0))
def test_many_sets_at_once_are_the_single_ones(drawn):
    decoys = np.vstack([drawn.belief, drawn.rng.dirichlet(np.ones(drawn.belief.size), 4), np.eye(drawn.belief.size)])
    actions = np.vstack([drawn.problem.solve(decoys), drawn.rng.dirichlet(np.ones(drawn.problem.n_actions), 3)])
    sets = consistent_sets(drawn.problem, actions)
    distances = sets.distances(drawn.belief)
    for index, action in enumerate(actions):
        single = consistent_beliefs(drawn.problem, action)
        assert min(single.dimension, 2) == sets.dimension[index]
        if single.is_empty:
            assert distances[index] == np.inf
        else:
            assert distances[index] == pytest.approx(single.distance(drawn.belief), abs=1e-9)
    assert (sets.bounds(drawn.belief) >= distances - 1e-12).all()


# --- general feasible sets ------------------------------------------------------------------------------------------


def random_polyhedron(rng, kind, size):
    """Sets with redundant, duplicated and degenerate rows, none of them a plain simplex."""
    base = simplex(size)
    if kind == "box":
        return base & box(np.zeros(size), np.full(size, rng.uniform(1.5, 2.5) / size))
    if kind == "sector":
        first = (np.arange(size) < size // 2).astype(float)
        return base & Polyhedron([first, -first], [0.4, -0.1])
    if kind == "redundant":
        return base & Polyhedron(np.vstack([-np.ones(size), np.eye(size)[0]]), [0.0, 5.0]) & box([0] * size, [1] * size)
    if kind == "duplicated":
        return base & base
    if kind == "degenerate vertex":  # more tight rows at the corner e_0 than coordinates
        return base & Polyhedron([np.eye(size)[0] + 0.5 * np.eye(size)[1], np.eye(size)[0]], [1.0, 1.0])
    if kind == "equalities only":
        return Polyhedron(A_eq=[np.ones(size), np.arange(size)], b_eq=[1.0, 1.0])
    return box(np.full(size, -0.2), np.full(size, 0.5)) & Polyhedron(A_eq=np.ones((1, size)), b_eq=[1.0])


POLYHEDRA = ["box", "sector", "redundant", "duplicated", "degenerate vertex", "equalities only", "long and short"]


@pytest.mark.parametrize("kind", POLYHEDRA)
@settings(max_examples=instances(30), deadline=None)
@given(SEEDS)
def test_general_feasible_sets_agree_with_the_lifted_oracle(kind, seed):
    rng = np.random.default_rng(seed)
    n_states, size = int(rng.integers(2, 5)), int(rng.integers(3, 6))
    region = random_polyhedron(rng, kind, size)
    linear = rng.normal(size=(n_states, size))
    if kind == "degenerate vertex":
        linear[:, 0] -= 3.0  # so that the corner with too many tight rows is often the decision
    factors = rng.normal(size=(n_states, size, size))
    problem = QuadraticProblem(factors @ factors.transpose(0, 2, 1) / size, linear, constraints=region)
    belief = rng.dirichlet(np.ones(n_states))
    action = problem.solve(belief)
    assert problem.constraints.violation(action) <= 1e-12
    slacks = region.slacks(action)
    assume(((slacks < 1e-12) | (slacks > 2e-4)).all())  # no row whose tightness is a matter of `min_slack`
    system = system_of(problem, action)
    found = consistent_beliefs(problem, action)
    assert found.contains(belief)
    assert problem.regret(found.vertices(), action).max() <= VERTEX_REGRET * cost_scale(problem, action)
    assume(is_well_posed(system))
    np.testing.assert_allclose(found.bounds(), consistent.bounds(system), atol=AGREEMENT)
    target = rng.dirichlet(np.ones(n_states))
    assert found.distance(target) == pytest.approx(consistent.distance(system, target), abs=AGREEMENT)
    assert same_points(found.vertices(), consistent.vertices(system))


# --- faces, ties and small cases by hand -----------------------------------------------------------------------------


def test_a_decision_that_tells_everything_is_a_point():
    problem = belief_problem()
    belief = np.array([0.5, 0.3, 0.2])
    found = consistent_beliefs(problem, problem.solve(belief))
    assert found.dimension == 0
    np.testing.assert_allclose(found.vertices(), [belief], atol=1e-12)
    np.testing.assert_allclose(found.bounds(), np.column_stack([belief, belief]), atol=1e-12)
    assert found.distance([0.2, 0.3, 0.5]) == pytest.approx(np.sqrt(0.18), abs=1e-12)


@pytest.mark.parametrize("state", range(3))
def test_a_corner_of_the_belief_simplex(state):
    belief = np.eye(3)[state]
    problem = belief_problem()
    found = consistent_beliefs(problem, problem.solve(belief))
    assert found.contains(belief)
    np.testing.assert_allclose(found.vertices(), [belief], atol=1e-9)
    assert np.sort(found.vertices()[0])[:2].max() <= 1e-15


def test_an_edge_of_the_belief_simplex_and_a_segment_by_hand():
    problem = line_problem([1.0, 0.0, -1.0])  # u_1 = 1/2 + (π_1 − π_3)/4
    action = problem.solve([0.5, 0.5, 0.0])
    np.testing.assert_allclose(action, [0.625, 0.375], atol=1e-14)
    found = consistent_beliefs(problem, action)
    assert found.dimension == 1
    assert same_points(found.vertices(), np.array([[0.5, 0.5, 0.0], [0.75, 0.0, 0.25]]), 1e-12)
    # From (0, 0, 1) the nearest member is the end (.75, 0, .25): the segment runs away from it.
    assert found.distance([0.0, 0.0, 1.0]) == pytest.approx(np.sqrt(2 * 0.75**2), abs=1e-12)


def test_an_action_at_a_vertex_has_a_halfspace_of_beliefs():
    problem = line_problem([4.0, 0.0, -4.0])  # u_1 = 1/2 + π_1 − π_3, so everything in asset 1 once π_1 − π_3 >= 1/2
    found = consistent_beliefs(problem, [1.0, 0.0])
    assert found.dimension == 2
    assert same_points(found.vertices(), np.array([[1.0, 0, 0], [0.5, 0.5, 0], [0.75, 0, 0.25]]), 1e-9)
    np.testing.assert_allclose(found.bounds(), [[0.5, 1], [0, 0.5], [0, 0.25]], atol=1e-9)
    # (0, 0, 1) lies off the line π_1 − π_3 = 1/2 by 3/2 over √2 (the normal (1, 0, −1) lies in the plane); the foot
    # (3/4, 0, 1/4) is on the edge of the simplex.
    assert found.distance([0, 0, 1.0]) == pytest.approx(1.5 / np.sqrt(2), abs=1e-9)


def test_an_action_that_every_belief_explains_is_the_whole_simplex():
    problem = MarkowitzProblem(np.tile([5.0, 0.0], (3, 1)), [np.eye(2)] * 3, 1.0)
    found = consistent_beliefs(problem, [1.0, 0.0])
    assert found.dimension == 2
    assert same_points(found.vertices(), np.eye(3), 1e-9)
    np.testing.assert_allclose(found.center(), np.full(3, 1 / 3), atol=1e-9)


def test_identical_states_say_nothing_even_in_the_interior():
    problem = MarkowitzProblem(np.tile([0.1, 0.2, 0.0], (4, 1)), [np.eye(3)] * 4, 1.0)
    found = consistent_beliefs(problem, problem.solve([0.1, 0.2, 0.3, 0.4]))
    assert found.dimension == 3
    assert same_points(found.vertices(), np.eye(4), 1e-9)
    assert found.distance([1.0, 0, 0, 0]) == pytest.approx(0, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(SEEDS, st.integers(1, 4), st.sampled_from(["simplex", "box"]))
def test_states_that_want_the_same_decision_say_nothing_about_themselves(seed, n_states, kind):
    """Gradients are rounding there, and every belief explains the decision."""
    rng = np.random.default_rng(seed)
    factors = rng.normal(size=(n_states, 3, 5))
    hessians = factors @ factors.transpose(0, 2, 1)
    wanted = rng.dirichlet(np.ones(3)) if kind == "simplex" else rng.uniform(-0.3, 0.8, 3)
    region = simplex(3) if kind == "simplex" else box(np.full(3, -0.5), np.ones(3))
    problem = QuadraticProblem(hessians, -(hessians @ wanted), constraints=region)
    belief = rng.dirichlet(np.ones(n_states))
    action = problem.solve(belief)
    found = consistent_beliefs(problem, action)
    assert found.dimension == n_states - 1
    assert found.contains(belief)
    assert consistent_sets(problem, action[None]).dimension[0] == min(n_states - 1, 2)


def test_one_state_one_asset_and_both():
    one_state = MarkowitzProblem([[0.1, 0.2]], [np.eye(2)], 1.0)
    found = consistent_beliefs(one_state, one_state.solve([1.0]))
    assert found.dimension == 0
    assert found.distance([1.0]) == 0
    np.testing.assert_array_equal(found.vertices(), [[1.0]])
    assert consistent_beliefs(one_state, [0.9, 0.1]).is_empty

    one_asset = MarkowitzProblem([[0.1], [0.2]], np.ones((2, 1, 1)), 1.0)
    found = consistent_beliefs(one_asset, one_asset.solve([0.3, 0.7]))
    assert found.dimension == 1
    np.testing.assert_allclose(found.bounds(), [[0, 1], [0, 1]], atol=1e-9)

    both = MarkowitzProblem([[0.1]], np.ones((1, 1, 1)), 1.0)
    assert consistent_beliefs(both, [1.0]).distance([1.0]) == 0


def test_two_states_are_a_point_an_interval_or_nothing():
    problem = line_problem([4.0, 0.0])  # u_1 = 1/2 + π_1
    found = consistent_beliefs(problem, [0.7, 0.3])
    np.testing.assert_allclose(found.vertices(), [[0.2, 0.8]], atol=1e-12)
    found = consistent_beliefs(problem, [1.0, 0.0])
    np.testing.assert_allclose(found.bounds(), [[0.5, 1.0], [0.0, 0.5]], atol=1e-12)
    assert consistent_beliefs(problem, [0.4, 0.6]).is_empty


def test_a_state_the_agent_excludes_may_still_be_what_the_observer_sees():
    problem = line_problem([1.0, 0.0, -1.0])
    found = consistent_beliefs(problem, problem.solve([0.0, 1.0, 0.0]))
    assert same_points(found.vertices(), np.array([[0.0, 1.0, 0.0], [0.5, 0.0, 0.5]]), 1e-12)


def test_duplicated_assets_share_a_position_in_any_way():
    market_means = np.array([[0.2, 0.0, 0.2], [0.0, 0.1, 0.0]])
    copy = np.eye(3)
    copy[0, 2] = copy[2, 0] = 1.0
    problem = MarkowitzProblem(market_means, [copy, 2 * copy], 1.0)
    belief = np.array([0.4, 0.6])
    action = problem.solve(belief)
    total = action[0] + action[2]
    for first in (0.0, 0.3 * total, total):
        other = np.array([first, action[1], total - first])
        found = consistent_beliefs(problem, other)
        assert found.contains(belief)
        np.testing.assert_allclose(found.center(), belief, atol=1e-9)


def test_a_weight_below_the_smallest_counts_as_none():
    """u_1 = 1 − 5e-5: at the letter a point of beliefs, with a smallest weight of 1e-4 the halfspace of all-in-asset-1."""
    action = np.array([1 - 5e-5, 5e-5])
    assert consistent_beliefs(line_problem([4.0, 0.0]), action).dimension == 0
    widened = consistent_beliefs(line_problem([4.0, 0.0], min_slack=1e-4), action)
    np.testing.assert_allclose(widened.bounds(), [[0.5, 1], [0, 0.5]], atol=1e-4)
    assert widened.contains([0.49995, 0.50005])


def test_rounded_weights_are_unexplained_and_say_by_how_much():
    problem = belief_problem(3)
    exact = problem.solve([0.31234567, 0.4, 0.28765433])
    assert not consistent_beliefs(problem, exact).is_empty
    four = MarkowitzProblem(np.eye(3)[:2], [np.eye(3)] * 2, 1.0)
    rounded = np.round(four.solve([0.31234567, 0.68765433]), 4)
    found = consistent_beliefs(four, rounded / rounded.sum() if rounded.sum() != 1 else rounded)
    assert found.is_empty
    assert 0 < found.plausibility_gap < 1e-7
    assert 1e-10 < found.residual < 1e-3


def test_a_looser_tolerance_explains_more():
    four = MarkowitzProblem(np.eye(3)[:2], [np.eye(3)] * 2, 1.0, long_only(3, 0.0))
    nearly = four.solve([0.3, 0.7]) + np.array([1e-6, 1e-6, -2e-6])
    assert consistent_beliefs(four, nearly).is_empty
    loose = consistent_beliefs(four, nearly, tolerance=1e-4)
    assert not loose.is_empty
    assert loose.distance([0.3, 0.7]) < 1e-3


@pytest.mark.parametrize("tolerance", [1e-7, 1e-5, 1e-3, 1e-1])
@pytest.mark.parametrize("n_states", [2, 3, 4, 5])
def test_a_set_with_a_tolerance_is_that_of_its_rows(n_states, tolerance):
    rng = np.random.default_rng([n_states, round(1 / tolerance)])
    sizes, kinds = np.eye(n_states), set()
    for _ in range(instances(40, least=20)):
        width = int(rng.integers(2, 6))
        spreads = rng.normal(size=(n_states, width, 2 * width))
        problem = MarkowitzProblem(rng.normal(size=(n_states, width)), spreads @ spreads.transpose(0, 2, 1), 1.0)
        belief = rng.dirichlet(np.ones(n_states))
        shares = np.maximum(problem.solve(belief) + rng.choice([0.0, 0.1, 1.0]) * tolerance * rng.normal(size=width), 0)
        found = consistent_beliefs(problem, shares / shares.sum(), tolerance=tolerance)
        rows = np.vstack([found.equalities, -found.equalities, -found.inequalities]) / tolerance

        def least(direction, rows=rows):
            return linprog(direction, rows, np.ones(len(rows)), np.ones((1, n_states)), [1.0], bounds=(0, None))

        kinds.add(found.is_empty)
        assert found.is_empty == (found.residual > tolerance)
        if least(sizes[0]).status != 0:
            assert found.is_empty
            continue
        ends = np.array([[least(size).fun, -least(-size).fun] for size in sizes])
        np.testing.assert_allclose(found.bounds(), ends, atol=AGREEMENT)
        assert found.dimension == n_states - 1  # a tolerance leaves every direction open
        assert found.holds_another(belief)
        drawn = found.sample(20, rng=rng)
        assert found.violation(drawn).max() <= tolerance + 1e-9
        assert found.distance(drawn[0]) == pytest.approx(0, abs=1e-8)
        assert found.residual <= found.violation(drawn).min() + 1e-9
    assert False in kinds


@pytest.mark.parametrize("tolerance", [1e-8, 1e-7, 1e-3])
def test_samples_of_a_thin_set_are_uniform(tolerance):
    """The set is {π : |π_i − 1/5| ≤ tolerance for three i}, in which these three are independent and uniform."""
    found = BeliefSet(np.eye(5)[:3] - 0.2, np.zeros((0, 5)), tolerance)
    drawn = found.sample(4000, rng=np.random.default_rng(0))
    assert found.violation(drawn).max() <= tolerance + 1e-9
    apart = (drawn[:, :3] - 0.2) / tolerance
    np.testing.assert_allclose(apart.mean(axis=0), 0.0, atol=0.05 + 1e-9 / tolerance)
    np.testing.assert_allclose((apart**2).mean(axis=0), 1 / 3, atol=0.03 + 1e-9 / tolerance)


@pytest.mark.parametrize("digits", [1, 2, 3])
def test_rounded_portfolios_under_a_cap_are_read(digits, fresh_rng):
    """Rounded decisions that keep the cap, and need not reach it, are explained by the belief that made them."""
    for size in (2, 4, 7):
        cap = 1.0 + fresh_rng.uniform(-0.1, 0.1, size)
        within = Polyhedron(A_ub=[cap], b_ub=[np.median(cap)])
        for region in (simplex(size) & within, box(np.zeros(size), np.ones(size)) & within):
            problem = MarkowitzProblem(fresh_rng.normal(0, 0.3, (2, size)), [np.eye(size)] * 2, 1.0, region)
            for belief in fresh_rng.dirichlet(np.ones(2), 4):
                published = problem.solve(belief).round(digits)
                assert consistent_beliefs(problem, published, digits=digits).contains(belief)


def test_a_rounded_row_inside_a_cap_is_read():
    """Rounding moves the sum of betas by at most .0015 where weights sum to one, and 1.02 − 1.01 is more."""
    beta = np.array([0.9, 0.95, 1.05, 1.1])
    published = np.array([0.19, 0.27, 0.23, 0.31])
    region = simplex(4) & Polyhedron(A_ub=[beta], b_ub=[1.02])
    means = 2.0 * np.array([[0.191, 0.268, 0.232, 0.309], [0.5, 0.3, 0.1, 0.1]])
    problem = MarkowitzProblem(means, [np.eye(4)] * 2, 1.0, region)
    found = consistent_beliefs(problem, published, digits=2)
    np.testing.assert_allclose(problem.solve([1.0, 0.0]).round(2), published, atol=1e-12)
    assert found.contains([1.0, 0.0])
    # With the identity as covariance the regret of a change δ is |δ|², which is at most 4 h².
    assert found.regret <= 4 * 0.005**2 * (1 + 1e-9)


def random_market(size, rng):
    """Means and covariances (2 states) whose optimal portfolios have shorts, zeros and limits in turn."""
    factors = rng.normal(size=(2, size, 2 * size))
    covariances = factors @ factors.transpose(0, 2, 1) / size * rng.uniform(0.2, 3.0, (2, 1, 1))
    return rng.normal(0, rng.choice([0.1, 0.5, 2.0]), (2, size)), covariances


def kinked_problems(size, rng):
    """Problems with limits on sums of magnitudes, active and not, and with costs of trades from a former portfolio."""
    means, covariances = random_market(size, rng)
    former = rng.dirichlet(np.ones(size))
    former[0] *= rng.choice([0.01, 1.0])  # a former weight that is printed as zero
    former /= former.sum()
    shorts, near = long_short(size, gross=rng.choice([1.0, 1.05, 1.3, 50.0])), turnover(former, rng.uniform(0.05, 0.6))
    for region in (shorts, simplex(size) & near, long_short(size, gross=1.3) & near, simplex(size)):
        plain = MarkowitzProblem(means, covariances, 1.0, region)
        yield plain
        yield with_transaction_costs(plain, former, linear=rng.choice([1e-6, 1e-3, 0.05, 0.5]))


@pytest.mark.parametrize("size", [2, 3, 5, 8])
def test_every_belief_whose_portfolio_prints_the_same_is_read(size, fresh_rng):
    """By enumeration, under limits on sums of magnitudes and trading costs, with weights near zero and the former ones."""
    for problem in kinked_problems(size, fresh_rng):
        digits, first = int(fresh_rng.integers(1, 5)), float(fresh_rng.uniform())
        published = problem.solve([first, 1 - first]).round(digits)
        near = first + 10.0 ** -fresh_rng.uniform(0, digits + 2, 60) * fresh_rng.choice([-1, 1], 60)
        beliefs = np.column_stack([near, 1 - near])[(near >= 0) & (near <= 1)]
        found = consistent_beliefs(problem, published, digits=digits)
        prints = (problem.solve(beliefs).round(digits) == published).all(axis=1)
        assert found.contains([first, 1 - first])
        assert all(found.contains(belief) for belief in beliefs[prints])


def test_a_short_that_is_printed_as_zero_may_reach_the_gross_limit():
    """The limit is .008 away from the printed weights, more than the other weights can make up."""
    problem = MarkowitzProblem([[0.0, 0.0, -9.0], [9.0, 0.0, 0.0]], [np.eye(3)] * 2, 1.0, long_short(3, gross=1.008))
    decision = problem.solve([1.0, 0.0])
    np.testing.assert_allclose(decision, [0.502, 0.502, -0.004], atol=1e-9)
    assert consistent_beliefs(problem, [0.5, 0.5, 0.0], digits=2).contains([1.0, 0.0])


def test_a_former_weight_that_is_printed_as_zero_may_be_kept():
    """Rounding shows a sale of .004 and purchases of .002. Opposite trades nearly pay, so that these lose twice their cost."""
    plain = MarkowitzProblem([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0]], [np.eye(3)] * 2, 1.0)
    problem = with_transaction_costs(plain, [0.004, 0.498, 0.498], linear=0.5)
    np.testing.assert_array_equal(problem.solve([1.0, 0.0]), [0.004, 0.498, 0.498])
    found = consistent_beliefs(problem, [0.0, 0.5, 0.5], digits=2)
    assert found.contains([1.0, 0.0])
    assert found.regret == pytest.approx(2 * 0.5 * (0.004 + 0.002 + 0.002), rel=0.02)


@pytest.mark.parametrize("digits", [2, 3, 4])
def test_a_limit_that_rounding_cannot_reach_leaves_the_set_as_it_is(digits, fresh_rng):
    """With shorts and weights printed as zero, too."""
    for size in (2, 4, 7):
        means, covariances = random_market(size, fresh_rng)
        free = box(-fresh_rng.choice([0.0, 9.0], size), np.full(size, 9.0)) & Polyhedron(
            A_eq=np.ones((1, size)), b_eq=[1.0]
        )
        regions = free, free & long_short(size, gross=50.0)
        without, within = (MarkowitzProblem(means, covariances, 1.0, region) for region in regions)
        for belief in fresh_rng.dirichlet(np.ones(2), 3):
            published = without.solve(belief).round(digits)
            plain, found = (consistent_beliefs(each, published, digits=digits) for each in (without, within))
            assert found.regret == pytest.approx(plain.regret, rel=1e-9)
            np.testing.assert_allclose(found.action, plain.action, atol=1e-12)
            np.testing.assert_allclose(found.bounds(), plain.bounds(), atol=1e-6)


@pytest.mark.parametrize(("belief", "digits", "gross"), [(0.9, 2, 1.3), (0.9, 3, 1.3), (0.7, 3, 1.1022), (0.5, 3, 1.0)])
def test_rounded_shorts_are_read_closely_at_a_limit_and_within_it(belief, digits, gross):
    means = [[0.03, 0.005, -0.02], [-0.03, 0.002, 0.02]]
    covariances = [np.diag([0.002, 0.001, 0.003]), np.diag([0.008, 0.003, 0.01])]
    problem = MarkowitzProblem(means, covariances, 5.0, long_short(3, gross=1.3))
    decision = problem.solve([belief, 1 - belief])
    assert np.abs(decision).sum() == pytest.approx(gross, abs=1e-4)
    found = consistent_beliefs(problem, decision.round(digits), digits=digits)
    assert found.contains([belief, 1 - belief])
    # By enumeration, beliefs that print these weights span .35 to .9 units of the last digit.
    assert np.ptp(found.bounds()[0]) < 2.0 * 10.0**-digits


@pytest.mark.parametrize("rate", [1e-6, 1e-3])
def test_trading_costs_leave_rounded_decisions_as_telling(rate):
    """Costs of trades are linear near a decision that trades: ε has the curvature alone, and h_j is from h to 2h."""
    means = [[0.008, 0.007, 0.012], [-0.02, 0.002, -0.03]]
    calm = [[0.002, 0.0004, 0.0006], [0.0004, 0.001, 0.0004], [0.0006, 0.0004, 0.003]]
    crisis = [[0.008, 0.002, 0.004], [0.002, 0.003, 0.002], [0.004, 0.002, 0.010]]
    plain = MarkowitzProblem(means, [calm, crisis], 5.0)
    trading = with_transaction_costs(plain, [0.2, 0.6, 0.2], linear=rate)
    found, costly = (consistent_beliefs(each, each.solve([0.7, 0.3]).round(3), digits=3) for each in (plain, trading))
    assert costly.regret <= 4 * found.regret
    assert costly.contains([0.7, 0.3])
    assert np.ptp(costly.bounds()[0]) < 0.005


def test_former_weights_that_sum_to_one_within_rounding_are_read() -> None:
    """The former decision and the sum of weights missed each other by less than a set accepts: no programme had a solution."""
    rng = np.random.default_rng(0)
    for _ in range(12):
        size = int(rng.choice([3, 6, 12]))
        root = rng.normal(size=(2, size, 2 * size))
        covariances = 0.003 * root @ root.swapaxes(1, 2) / (2 * size)
        former = rng.dirichlet(np.full(size, 3.0)).round(10)
        market = MarkowitzProblem(rng.normal(0.0, 0.01, (2, size)), covariances, 5.0, long_short(size, gross=1.5))
        problem = with_transaction_costs(market, former, linear=0.05)  # dear: nothing is traded
        found = consistent_beliefs(problem, problem.solve([0.5, 0.5]).round(4), digits=4)
        assert found.contains([0.5, 0.5])


@pytest.mark.parametrize("dust", [2e-9, 5e-7, 2e-6])
def test_a_former_weight_near_zero_widens_no_interval_of_rounded_weights(dust: float) -> None:
    """Between two kinks closer than a search can tell apart the first-order bound stayed, 22 times as wide."""
    means = [[0.008, 0.007, 0.012, 0.001], [-0.02, 0.002, -0.03, 0.001]]
    market = MarkowitzProblem(means, [np.diag([0.002, 0.001, 0.003, 0.002]), np.diag([0.008, 0.003, 0.01, 0.004])], 5.0)
    widths = []
    for last in (0.0, dust):
        problem = with_transaction_costs(market, [0.2, 0.6 - last, 0.2, last], linear=1e-4)
        low, high = consistent_beliefs(problem, problem.solve([0.7, 0.3]).round(3), digits=3).bounds()[0]
        assert low <= 0.7 <= high
        widths.append(high - low)
    assert widths[1] == pytest.approx(widths[0], rel=0.01)
