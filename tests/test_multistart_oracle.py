"""The multistart oracle against proven optima, a scan of actions, and the definition of an admissible decision."""

from __future__ import annotations

import numpy as np
import pytest

from oracles import consistent, enumeration, large_markets, markets, multistart, optimum
from sizes import audited, some

CASES = {case.name: case for case in optimum.cases()}
SECONDS = 0.3
CLOSE = 2e-6  # the oracle leaves 1e-7 of the limit unspent
SHARE = 0.3


def best_of(market, belief, limit, seed=0, seconds=SECONDS):
    rng = np.random.default_rng(seed)
    return multistart.best_by_multistart(*market, belief, limit, seconds=seconds, rng=rng)


def distance_by_vertices(market, belief, action):
    system = consistent.simplex_system(markets.gradients(market, action), action > 0)
    corners = consistent.vertices(system)
    return consistent.hull_distance(belief, corners) if len(corners) else -np.inf


@pytest.mark.parametrize("name", some(["U3-00", "U3-01", "U3-04", "U3-09"], 4))
def test_it_reaches_the_proven_optimum(name):
    case = CASES[name]
    proven, _, bound = optimum.global_cdm(case.market, case.belief, case.budget, case.min_slack)
    seconds = 1.0 if audited() else 0.6  # on a loaded machine 0.3 may end before a climb
    best = best_of(case.market, case.belief, case.budget, seconds=seconds)
    assert best.privacy == pytest.approx(proven, abs=CLOSE)
    assert best.privacy <= bound + CLOSE


@pytest.mark.parametrize("seed", some([0, 2, 4], 2))
def test_no_action_of_a_scan_is_better_where_sets_are_larger_than_points(seed):
    rng = np.random.default_rng(seed)
    market, belief = markets.random_market(rng, 4, 2), markets.random_belief(rng, 4)
    optimal_cost = enumeration.value(market, belief)[0]
    limit = SHARE * abs(optimal_cost)
    shares = np.linspace(0, 1, 101)
    actions = np.column_stack([shares, 1 - shares])
    affordable = [u for u in actions if belief @ markets.costs(market, u) - optimal_cost <= limit]
    scanned = max(distance_by_vertices(market, belief, action) for action in affordable)
    best = best_of(market, belief, limit)
    assert best.privacy >= scanned - CLOSE
    assert best.privacy == pytest.approx(distance_by_vertices(market, belief, best.action), abs=CLOSE)


def test_a_verdict_is_read_from_the_action_alone():
    case = CASES["U3-00"]
    optimal_cost, optimal = enumeration.value(case.market, case.belief)
    optimal = np.where(optimal > 1e-9, optimal, 0.0)
    own = multistart.judged(case.market, case.belief, optimal_cost, optimal)
    assert own.admissible
    assert own.privacy == pytest.approx(0.0, abs=1e-8)
    assert own.regret == pytest.approx(0.0, abs=1e-12)
    thin = np.array([5e-5, 0.5, 0.49995])
    assert not multistart.judged(case.market, case.belief, optimal_cost, thin).admissible


@pytest.mark.parametrize("seed", range(6))
def test_a_verdict_agrees_with_the_corners_of_the_set(seed):
    rng = np.random.default_rng(seed)
    market, belief = markets.random_market(rng, 4, 3), markets.random_belief(rng, 4)
    optimal_cost = enumeration.value(market, belief)[0]
    for decoy in rng.dirichlet(np.full(4, 0.5), 4):
        action = enumeration.value(market, decoy)[1]
        action = np.where(action >= multistart.MIN_SLACK, action, 0.0)
        verdict = multistart.judged(market, belief, optimal_cost, action / action.sum())
        corners = distance_by_vertices(market, belief, action / action.sum())
        assert verdict.privacy == pytest.approx(corners, abs=CLOSE)


def test_an_unexplained_action_has_no_privacy():
    market = markets.Market(np.array([[0.1, 0.0, 0.0]] * 2), np.stack([np.eye(3), 2 * np.eye(3)]), 1.0)
    verdict = multistart.judged(market, np.array([0.5, 0.5]), 0.0, np.array([0.1, 0.6, 0.3]))
    assert verdict.privacy == -np.inf
    assert np.isnan(verdict.nearest).all()


def test_large_instances_can_be_repeated_and_are_not_trivial():
    instances = list(large_markets.large_instances())
    again = list(large_markets.large_instances())
    assert [instance.name for instance in instances] == [instance.name for instance in again]
    assert {instance.market.means.shape for instance in instances} == {(5, 50), (8, 100)}
    for one, two in zip(instances, again, strict=True):
        np.testing.assert_array_equal(one.market.covariances, two.market.covariances)
        assert one.limit == two.limit > 0


@pytest.mark.parametrize("number", [0, 7])
def test_a_large_decision_is_admissible_affordable_and_private(number):
    instance = list(large_markets.large_instances())[number]
    market, belief = instance.market, instance.belief
    best = best_of(market, belief, instance.limit)
    farthest = np.linalg.norm(np.eye(len(belief)) - belief, axis=1).max()
    assert 0.05 < best.privacy < 0.9 * farthest
    held = best.action > 0
    assert best.action[held].min() >= multistart.MIN_SLACK
    assert best.action.sum() == pytest.approx(1.0, abs=1e-12)
    system = consistent.simplex_system(markets.gradients(market, best.action), held)
    assert consistent.distance(system, belief) == pytest.approx(best.privacy, abs=1e-6)
    assert np.linalg.norm(best.nearest - belief) == pytest.approx(best.privacy, abs=1e-8)
    seconds, values = np.array(best.history).T
    assert (np.diff(seconds) >= 0).all()
    assert (np.diff(values) > 0).all()
    assert values[-1] == pytest.approx(best.privacy, abs=1e-8)
