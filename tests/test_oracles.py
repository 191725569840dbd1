"""The oracles against each other, against closed forms and against cases worked by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles import consistent, enumeration, markets, optimum
from sizes import instances

SEEDS = st.integers(0, 2**32 - 1)
DEGENERATE = [{}, {"duplicate": True}, {"singular": True}, {"scale_spread": 2.0}, {"positive_value": True}]


def line_market(slope):
    """Two assets with identity covariance, γ = 1, means (m_i, 0): u_1 = ½ + π·m/4, Π(u) = {π·m = k}."""
    slope = np.asarray(slope, dtype=float)
    return markets.Market(
        np.column_stack([slope, np.zeros(slope.size)]), np.broadcast_to(np.eye(2), (slope.size, 2, 2)), 1.0
    )


def belief_market():
    """Three assets with identity covariance, γ = 1, state i pays asset i: u = 1/6 + π/2, ρ(π,u*(y)) = ‖π−y‖²/4."""
    return markets.Market(np.eye(3), np.broadcast_to(np.eye(3), (3, 3, 3)), 1.0)


def optimal_system(rng, **kind):
    n_states, n_assets = int(rng.integers(2, 5)), int(rng.integers(2, 7))
    market = markets.random_market(rng, n_states, n_assets, **kind)
    belief = markets.random_belief(rng, n_states)
    action = enumeration.value(market, belief)[1]
    return belief, consistent.simplex_system(markets.gradients(market, action), action > 1e-12)


# --- markets --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", DEGENERATE, ids=str)
def test_markets_are_what_they_say(kind):
    rng = np.random.default_rng(7)
    for _ in range(20):
        market = markets.random_market(rng, 3, 5, **kind)
        values = np.linalg.eigvalsh(market.covariances)
        assert values.min() >= -1e-12 * values.max()
        if not kind or "positive_value" in kind:
            assert values.min() > 1e-4 * values.max()
        if "duplicate" in kind:
            np.testing.assert_array_equal(market.means[:, 0], market.means[:, -1])
            np.testing.assert_array_equal(market.covariances[:, 0, 0], market.covariances[:, 0, -1])
        if "positive_value" in kind:
            assert min(enumeration.value(market, vertex)[0] for vertex in np.eye(3)) > 0
        if "scale_spread" in kind:
            sizes = np.abs(market.covariances).max(axis=(1, 2))
            assert sizes.max() > 20 * sizes.min()


def test_gradients_are_the_derivatives_of_the_costs():
    rng = np.random.default_rng(3)
    market = markets.random_market(rng, 3, 4)
    action, direction = rng.dirichlet(np.ones(4)), rng.normal(size=4)
    moved = [markets.costs(market, action + step * direction) for step in (1e-3, -1e-3)]
    np.testing.assert_allclose((moved[0] - moved[1]) / 2e-3, markets.gradients(market, action).T @ direction, rtol=1e-9)


# --- enumeration ----------------------------------------------------------------------------------------------------


def test_value_of_the_belief_market_is_the_closed_form():
    belief = np.array([0.5, 0.3, 0.2])
    value, action = enumeration.value(belief_market(), belief)
    np.testing.assert_allclose(action, 1 / 6 + belief / 2, atol=1e-14)
    assert value == pytest.approx(action @ action - belief @ action, abs=1e-14)


def test_value_at_a_corner_of_the_simplex():
    value, action = enumeration.value(line_market([9.0, 9.0]), np.array([0.5, 0.5]))
    np.testing.assert_allclose(action, [1.0, 0.0], atol=1e-14)
    assert value == pytest.approx(1.0 - 9.0, abs=1e-14)


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_value_over_supports_is_value_over_active_rows(seed):
    rng = np.random.default_rng(seed)
    market, belief = markets.random_market(rng, 3, 4), markets.random_belief(rng, 3)
    value, action = enumeration.value(market, belief)
    hessian = 2 * market.risk_aversion * np.tensordot(belief, market.covariances, 1)
    rows = (-np.eye(4), np.zeros(4), np.ones((1, 4)), np.ones(1))
    other, same = enumeration.quadratic_value(hessian, -belief @ market.means, *rows)
    assert value == pytest.approx(other, abs=1e-12)
    np.testing.assert_allclose(action, same, atol=1e-9)
    assert value == pytest.approx(belief @ markets.costs(market, action), abs=1e-13)
    rivals = rng.dirichlet(np.ones(4), 50)
    assert min(belief @ markets.costs(market, rival) for rival in rivals) >= value - 1e-12


def test_envelope_by_hand():
    regrets, privacies = np.array([0.0, 1.0, 2.0, 0.5]), np.array([0.0, 1.0, 1.5, -np.inf])
    for budget, expected in [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0), (1.5, 1.25), (5.0, 1.5), (-0.1, -np.inf)]:
        assert enumeration.upper_concave_envelope(regrets, privacies, budget) == pytest.approx(expected)
        assert enumeration.pdm_lp(regrets, privacies, budget)[0] == pytest.approx(expected)


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.integers(1, 25), st.floats(0, 1.2))
def test_envelope_is_the_linear_programme(seed, n_points, budget):
    rng = np.random.default_rng(seed)
    regrets, privacies = rng.uniform(0, 1, n_points), rng.uniform(0, 1, n_points)
    regrets[0] = 0.0
    value, probabilities = enumeration.pdm_lp(regrets, privacies, budget)
    assert value == pytest.approx(enumeration.upper_concave_envelope(regrets, privacies, budget), abs=1e-9)
    assert probabilities @ regrets <= budget + 1e-9
    assert probabilities.sum() == pytest.approx(1.0)


# --- consistent beliefs ---------------------------------------------------------------------------------------------


def test_segment_by_hand():
    market = line_market([0.0, 0.5, 1.0])
    system = consistent.simplex_system(markets.gradients(market, np.array([0.625, 0.375])), np.array([True, True]))
    corners = consistent.vertices(system)
    np.testing.assert_allclose(corners[np.argsort(corners[:, 1])], [[0.5, 0.0, 0.5], [0.0, 1.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(consistent.bounds(system), [[0, 0.5], [0, 1], [0, 0.5]], atol=1e-9)
    corner = np.array([0.0, 0.0, 1.0])
    assert consistent.distance(system, corner) == pytest.approx(np.sqrt(0.5), abs=1e-9)
    assert consistent.hull_distance(corner, corners) == pytest.approx(np.sqrt(0.5), abs=1e-12)


def test_region_and_empty_set_at_a_corner_by_hand():
    market = line_market([0.0, 2.0, 4.0])
    action, held = np.array([1.0, 0.0]), np.array([True, False])
    system = consistent.simplex_system(markets.gradients(market, action), held)
    corners = consistent.vertices(system)
    np.testing.assert_allclose(corners[np.lexsort(corners.T)], [[0, 1, 0], [0.5, 0, 0.5], [0, 0, 1]], atol=1e-12)
    assert consistent.distance(system, np.array([1.0, 0.0, 0.0])) == pytest.approx(np.sqrt(0.5), abs=1e-9)
    weak = consistent.simplex_system(markets.gradients(line_market([0.0, 0.5, 1.0]), action), held)
    assert consistent.is_empty(weak)
    assert consistent.vertices(weak).shape == (0, 3)
    assert np.isnan(consistent.bounds(weak)).all()
    assert consistent.distance(weak, np.ones(3) / 3) == np.inf
    # scaled gradients are (2 − π·m, 0)/2: the best belief is e_3, and ν halves what is left
    assert consistent.smallest_residual(weak) == pytest.approx(0.25, abs=1e-9)


def test_zero_gradients_explain_everything():
    system = consistent.simplex_system(np.zeros((2, 3)), np.array([True, True]))
    assert len(consistent.vertices(system)) == 3
    assert consistent.distance(system, np.array([0.2, 0.3, 0.5])) == pytest.approx(0.0, abs=1e-9)


def test_redundant_rows_change_nothing():
    market = line_market([0.0, 2.0, 4.0])
    gradients = markets.gradients(market, np.array([1.0, 0.0]))
    once = consistent.kkt_system(gradients, np.array([[0.0, -1.0]]), np.ones((1, 2)))
    often = consistent.kkt_system(
        gradients, np.array([[0.0, -1.0], [0.0, -3.0], [1.0, 0.0]]), np.array([[1.0, 1.0], [2.0, 2.0]])
    )
    np.testing.assert_allclose(
        *(corners[np.lexsort(corners.round(9).T)] for corners in map(consistent.vertices, (once, often))), atol=1e-12
    )
    np.testing.assert_allclose(consistent.bounds(once), consistent.bounds(often), atol=1e-9)


def test_tight_rows_follow_the_smallest_slack():
    rows, right = -np.eye(4), np.zeros(4)
    action = np.array([0.0, 5e-5, 1e-4, 1 - 1.5e-4])
    assert consistent.tight_rows(rows, right, action).tolist() == [True, False, False, False]
    assert consistent.tight_rows(rows, right, action, 1e-4).tolist() == [True, True, False, False]


@pytest.mark.parametrize("kind", DEGENERATE, ids=str)
def test_lifted_queries_agree_with_the_vertices(kind):
    rng = np.random.default_rng(11)
    for _ in range(instances(40)):
        belief, system = optimal_system(rng, **kind)
        corners = consistent.vertices(system)
        assert consistent.smallest_residual(system) < 1e-12
        assert consistent.hull_distance(belief, corners) < 1e-10
        limits = np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1)
        np.testing.assert_allclose(consistent.bounds(system), limits, atol=1e-9)
        point, direction = rng.dirichlet(np.ones(belief.size)), rng.normal(size=belief.size)
        assert consistent.distance(system, point) == pytest.approx(consistent.hull_distance(point, corners), abs=1e-9)
        top = consistent.support(system, direction) @ direction
        assert top == pytest.approx((corners @ direction).max(), abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(SEEDS)
def test_both_ways_agree_on_what_is_empty(seed):
    rng = np.random.default_rng(seed)
    market = markets.random_market(rng, int(rng.integers(2, 5)), int(rng.integers(2, 5)))
    action = rng.dirichlet(np.ones(market.means.shape[1]))
    system = consistent.simplex_system(markets.gradients(market, action), action > 0)
    assert consistent.is_empty(system) == (len(consistent.vertices(system)) == 0)


# --- the global optimum ---------------------------------------------------------------------------------------------


def test_optimum_of_two_states_is_the_closed_form():
    pytest.importorskip("pyscipopt")
    market = markets.Market(np.eye(2), np.broadcast_to(np.eye(2), (2, 2, 2)), 1.0)
    privacy, action, bound = optimum.global_cdm(market, np.array([0.5, 0.5]), 0.01, 1e-4)
    assert privacy == pytest.approx(2 * np.sqrt(0.01), abs=1e-6)
    assert bound == pytest.approx(privacy, abs=1e-6)
    assert action.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("budget", [1e-4, 1e-3])
def test_optimum_of_one_belief_per_action_is_the_closed_form(budget):
    # Σ = I, γ = 1, state i pays d_i on asset i: ρ(π,u*(y)) = ‖P D (y−π)‖²/4 with P the projection on 1'v = 0,
    # an ellipse whose long axis lies inside the simplex of beliefs
    pytest.importorskip("pyscipopt")
    scales, belief = np.diag([1.0, 0.8, 0.5]), np.array([0.4, 0.3, 0.3])
    market = markets.Market(scales, np.broadcast_to(np.eye(3), (3, 3, 3)), 1.0)
    tangent = np.linalg.qr(np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]).T)[0]
    least = np.linalg.eigvalsh(tangent.T @ scales @ tangent @ tangent.T @ scales @ tangent)[0]
    privacy, _, bound = optimum.global_cdm(market, belief, budget, 1e-4)
    assert privacy == pytest.approx(2 * np.sqrt(budget / least), rel=1e-6)
    assert privacy <= bound + 1e-9 <= privacy * (1 + 1e-4)


def test_optimum_of_two_states_with_a_loose_budget_is_the_farther_vertex():
    pytest.importorskip("pyscipopt")
    market = markets.Market(np.eye(2), np.broadcast_to(np.eye(2), (2, 2, 2)), 1.0)
    privacy, _, bound = optimum.global_cdm(market, np.array([0.4, 0.6]), 9.0, 1e-4)
    assert privacy == pytest.approx(0.6 * np.sqrt(2), abs=1e-8)
    assert bound == pytest.approx(privacy, abs=1e-5)


def test_optimum_with_a_loose_budget_is_the_farthest_vertex():
    pytest.importorskip("pyscipopt")
    belief = np.array([0.5, 0.3, 0.2])
    privacy, action, _ = optimum.global_cdm(belief_market(), belief, 10.0, 1e-4)
    assert privacy == pytest.approx(np.linalg.norm(belief - [0, 0, 1]), abs=1e-8)
    np.testing.assert_allclose(action, [1 / 6, 1 / 6, 2 / 3], atol=1e-8)


def test_optimum_of_segments_is_the_distance_to_the_segment_not_to_its_far_end():
    privacy, action, _ = optimum.global_cdm(line_market([0.0, 0.5, 1.0]), np.ones(3) / 3, 0.001, 1e-4)
    assert privacy == pytest.approx(4 * np.sqrt(0.001), abs=1e-9)
    assert abs(action[0] - 0.625) == pytest.approx(np.sqrt(0.001 / 2), abs=1e-9)


def test_closed_form_of_a_segment_is_the_distance_of_its_set():
    rng = np.random.default_rng(5)
    for _ in range(10):
        market, belief = markets.random_market(rng, 3, 4), markets.random_belief(rng, 3)
        problem = optimum.Problem(market, belief, np.inf, 1e-4)
        shares = rng.uniform(size=30)
        for held in ([0, 1], [1, 3]):
            fast = optimum._segment_distances(problem, held, shares)
            slow = [problem.privacy(action) for action in optimum._two_held(problem, held, shares)]
            np.testing.assert_allclose(fast, slow, atol=1e-9)


@pytest.mark.parametrize(("index", "held"), [(4, [1, 2]), (23, [2, 5])])
def test_refined_scan_is_above_a_hundred_times_finer_scan(index, held):
    case = list(optimum.cases())[index]
    allowed = enumeration.value(case.market, case.belief)[0] + case.budget
    problem = optimum.Problem(case.market, case.belief, allowed, case.min_slack)
    shares = np.linspace(*optimum._affordable_shares(problem, held), 200_001)
    finest = optimum._segment_distances(problem, held, shares).max()
    assert finest <= optimum._scan(problem, held).privacy <= finest + 1e-4


def test_an_asset_that_explains_every_belief_hides_nothing():
    market = line_market([9.0, 9.0, 9.0])
    privacy, action, _ = optimum.global_cdm(market, np.ones(3) / 3, 0.5, 1e-4)
    assert privacy == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_array_equal(action, [1.0, 0.0])


def test_no_admissible_action_is_minus_infinity():
    # the optimum is (¾, ¼), no cheaper than the budget elsewhere, and each weight must be at least 0.3
    privacy, action, bound = optimum.global_cdm(line_market([1.0, 1.0, 1.0]), np.ones(3) / 3, 1e-6, 0.3)
    assert privacy == bound == -np.inf
    assert action is None


def test_copied_assets_are_refused():
    market = markets.random_market(np.random.default_rng(0), 3, 4, duplicate=True)
    with pytest.raises(ValueError, match="one minimiser"):
        optimum.global_cdm(market, np.ones(3) / 3, 0.1, 1e-4)


@pytest.mark.parametrize(
    "index",
    [
        4,
        pytest.param(9, marks=pytest.mark.audit),
        pytest.param(13, marks=pytest.mark.audit),
        pytest.param(23, marks=pytest.mark.audit),
    ],
)
def test_no_decoy_of_a_grid_beats_the_optimum(index):
    pytest.importorskip("pyscipopt")
    case = list(optimum.cases())[index]
    privacy, action, bound = optimum.global_cdm(*case[1:])
    assert privacy <= bound + 1e-9 <= privacy * (1 + 1e-5) + 1e-5
    spent = case.belief @ markets.costs(case.market, action) - enumeration.value(case.market, case.belief)[0]
    assert spent <= case.budget + 1e-10
    assert (action[action != 0] >= case.min_slack - 1e-10).all()
    held = consistent.simplex_system(markets.gradients(case.market, action), action != 0)
    assert consistent.distance(held, case.belief) == pytest.approx(privacy, abs=1e-7)

    best = -np.inf
    optimal = enumeration.value(case.market, case.belief)[0]
    decoys = np.random.default_rng(index).dirichlet(np.ones(3), 400)
    for action in enumeration.values(case.market, decoys)[1]:
        admissible = (action[action > 1e-12] >= case.min_slack).all()
        if admissible and case.belief @ markets.costs(case.market, action) - optimal <= case.budget:
            held = consistent.simplex_system(markets.gradients(case.market, action), action > 1e-12)
            best = max(best, consistent.hull_distance(case.belief, consistent.vertices(held)))
    assert 0.8 * privacy < best <= bound + 1e-9


def test_cases_are_reproducible_and_as_described():
    first, second = list(optimum.cases()), list(optimum.cases())
    assert [case.name for case in first] == [case.name for case in second]
    assert len(first) == 24
    for case, again in zip(first, second, strict=True):
        np.testing.assert_array_equal(case.market.means, again.market.means)
        np.testing.assert_array_equal(case.belief, again.belief)
        assert case.belief.min() > 0.01
        assert case.budget > 0
    for case in first[::2]:
        assert min(enumeration.value(case.market, vertex)[0] for vertex in np.eye(3)) > 0
