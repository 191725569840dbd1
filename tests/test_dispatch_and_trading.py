"""Economic dispatch against bus angles in CVXPY, transaction costs against norms in CVXPY, and both downstream."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    GlobalSearch,
    InputError,
    LocalSearch,
    MarkowitzProblem,
    ModelError,
    OriginalDecisionMaker,
    PowerNetwork,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    TradingProblem,
    check_decision_problem,
    consistent_beliefs,
    decoy_grid,
    dispatch_problem,
    load_ieee_30_bus,
    max_weights,
    simplex,
    turnover,
    with_transaction_costs,
)
from sizes import some

cp = pytest.importorskip("cvxpy")

WIND_BUSES = [7, 29]
MEANS, DEVIATIONS = np.array([[5.0, 2.0], [25.0, 8.0], [10.0, 18.0]]), np.full((3, 2), 2.0)


CAPACITIES = [22.0, 30.0]


def by_angles(network, belief, limits=1.0, penalty=1.0, most=(np.inf, np.inf)):
    """Least expected cost of a dispatch whose flows are differences of bus angles, and the schedule."""
    n_buses, size = len(network.loads), len(network.capacities)
    p, q, angle = cp.Variable(size, nonneg=True), cp.Variable(2, nonneg=True), cp.Variable(n_buses)
    first, second = network.line_ends.T
    flow = cp.multiply(angle[first] - angle[second], 1 / network.line_data[:, 0])
    injected = np.zeros((n_buses, size + 2))
    injected[np.concatenate([network.generator_buses, WIND_BUSES]), np.arange(size + 2)] = 1
    leaving = np.zeros((n_buses, len(first)))
    leaving[first, np.arange(len(first))], leaving[second, np.arange(len(first))] = 1, -1
    cost = network.quadratic_costs @ cp.square(p) + network.linear_costs @ p
    cost += penalty * sum(
        belief[i] * (cp.sum_squares(q - MEANS[i]) + (DEVIATIONS[i] ** 2).sum()) for i in range(len(belief))
    )
    rows = [
        injected @ cp.hstack([p, q]) - network.loads == leaving @ flow,
        p <= network.capacities,
        *(q[f] <= each for f, each in enumerate(most) if np.isfinite(each)),
        cp.abs(flow) <= limits * network.line_data[:, 1],
    ]
    programme = cp.Problem(cp.Minimize(cost), rows)
    programme.solve(solver=cp.CLARABEL)
    return programme.value, np.concatenate([p.value, q.value])


def narrowed(network, share):
    """The same network with smaller line limits, so that some are reached."""
    data = network.line_data * np.array([1.0, share])
    return PowerNetwork(
        network.loads, network.generator_buses, network.capacities, network.quadratic_costs, network.linear_costs,
        network.line_ends, data,
    )  # fmt: skip


@pytest.mark.parametrize("share", [1.0, 0.75])
def test_the_dispatch_equals_the_one_by_bus_angles(share):
    network = load_ieee_30_bus()
    problem = dispatch_problem(narrowed(network, share), WIND_BUSES, MEANS, DEVIATIONS, wind_capacities=CAPACITIES)
    reached = set()
    for belief in np.vstack([np.eye(3), np.random.default_rng(0).dirichlet(np.ones(3), 4)]):
        value, schedule = by_angles(network, belief, share, most=CAPACITIES)
        action = problem.solve(belief)
        assert float(problem.optimal_cost(belief)) == pytest.approx(value, rel=1e-7)
        np.testing.assert_allclose(action, schedule, atol=2e-3)
        assert consistent_beliefs(problem, action).contains(belief)
        tight = np.flatnonzero(problem.constraints.slacks(action) < 1e-9)
        reached |= {problem.constraints.names[row] for row in tight}
    assert any(name.startswith("line") for name in reached) == (share < 1), reached
    assert "wind at bus 7 <= 22 MW" in reached


def test_line_rows_are_flows_from_the_networks_equations():
    network = load_ieee_30_bus()
    region = dispatch_problem(network, WIND_BUSES, MEANS).constraints
    schedule = network.loads.sum() * np.random.default_rng(0).dirichlet(np.ones(8))
    injected = -network.loads.copy()
    np.add.at(injected, np.concatenate([network.generator_buses, WIND_BUSES]), schedule)
    ends = np.eye(30)[network.line_ends[:, 0]] - np.eye(30)[network.line_ends[:, 1]]
    weights = np.diag(1 / network.line_data[:, 0])
    flows = weights @ ends @ np.linalg.lstsq(ends.T @ weights @ ends, injected, rcond=None)[0]
    spare = region.b_ub - region.A_ub @ schedule
    for (first, second), flow, limit in zip(network.line_ends, flows, network.line_data[:, 1], strict=True):
        for sign, name in (
            (1, f"line {first}-{second} <= {limit:g} MW"),
            (-1, f"line {first}-{second} >= -{limit:g} MW"),
        ):
            if name in region.names:
                assert spare[region.names.index(name)] == pytest.approx(limit - sign * flow, abs=1e-9)


def test_a_dispatch_hides_its_wind_forecast():
    problem = dispatch_problem(load_ieee_30_bus(), WIND_BUSES, MEANS, DEVIATIONS)
    belief = np.array([0.6, 0.2, 0.2])
    candidates = decoy_grid(problem, 25)
    open_book = OriginalDecisionMaker(problem).decide(belief)
    np.testing.assert_allclose(open_book.decoy, belief, atol=1e-6)
    hidden = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(10.0), candidates=candidates).decide(belief)
    mixed = ProbabilisticDecisionMaker(problem, budget=Budget.regret(10.0), candidates=candidates).decide(belief)
    assert 0.05 < hidden.privacy <= mixed.expected_privacy + 1e-9
    check_decision_problem(problem)


def test_a_dispatch_that_cannot_be_names_the_rows():
    with pytest.raises(ModelError, match=r"no decision satisfies all constraints.*cannot hold together: line"):
        dispatch_problem(narrowed(load_ieee_30_bus(), 0.3), WIND_BUSES, MEANS)
    network = load_ieee_30_bus()
    with pytest.raises(InputError, match="wind_buses has bus 30, expected 0 to 29"):
        dispatch_problem(network, [30], [[1.0], [2.0]])
    with pytest.raises(InputError, match="do not connect all buses"):
        PowerNetwork([0, 1, 2], [0], [5], [1], [1], [[0, 1]], [[0.1, 5]])


def with_load(load):
    """Two buses; the load is at the second, the generators of 80 and 40 MW are at either."""
    return PowerNetwork([0.0, load], [0, 1], [80.0, 40.0], [0.02, 0.01], [1.0, 2.0], [[0, 1]], [[0.1, 1000.0]])


def test_a_load_above_all_units_is_refused_with_both_numbers():
    with pytest.raises(ModelError, match=r"load is 550 MW.* 0 to 150 MW: 2 generators 120, 1 wind farms 30"):
        dispatch_problem(with_load(550.0), [1], [[5.0], [25.0]], wind_capacities=[30.0])
    with pytest.raises(ModelError, match=r"load is 550 MW.* 0 to 145 MW: 2 generators 120, 1 wind farms 25"):
        dispatch_problem(with_load(550.0), [1], [[5.0], [25.0]])
    with pytest.raises(ModelError, match=r"load is -1 MW"):
        dispatch_problem(with_load(-1.0), [1], [[5.0], [25.0]])
    just = dispatch_problem(with_load(150.0), [1], [[5.0], [25.0]], wind_capacities=[30.0])
    np.testing.assert_allclose(just.solve([0.5, 0.5]), [80.0, 40.0, 30.0], atol=1e-9)


def test_no_more_wind_is_scheduled_than_can_blow(fresh_rng):
    """Up to 145 MW the farm gives its capacity at most, by default what blows in the windiest regime."""
    for load in fresh_rng.uniform(0.0, 145.0, 5):
        problem = dispatch_problem(with_load(load), [1], [[5.0], [25.0]])
        actions = problem.solve(fresh_rng.dirichlet(np.ones(2), 10))
        assert (actions[:, 2] <= 25.0 + 1e-9).all()
        assert (actions >= 0.0).all()
        np.testing.assert_allclose(actions.sum(axis=1), load, atol=1e-9)
    windy = dispatch_problem(with_load(140.0), [1], [[5.0], [25.0]], [[1.0], [4.0]])
    assert windy.constraints.bounding_box[2] == pytest.approx([20.0, 37.0])


def test_farms_and_generators_that_stand_still():
    network = with_load(50.0)
    still = PowerNetwork([0.0, 50.0], [0, 1], [80.0, 0.0], [0.02, 0.01], [1.0, 2.0], [[0, 1]], [[0.1, 1000.0]])
    belief = np.array([0.5, 0.5])
    becalmed = dispatch_problem(network, [0, 1], [[9.0, 5.0], [9.0, 25.0]], wind_capacities=[0.0, 30.0])
    action = CounterAdversarialDecisionMaker(becalmed, candidates=decoy_grid(becalmed, 20)).decide(belief).action
    assert action[2] == 0.0 < action[3]
    assert dispatch_problem(still, [1], [[5.0], [25.0]]).solve(belief)[1] == 0.0
    calm = dispatch_problem(network, [], [[], []])
    # Equal marginal costs: 1 + 0.04 p = 2 + 0.02 (50 − p), p = 100/3.
    np.testing.assert_allclose(calm.solve(belief), [100 / 3, 50 / 3], atol=1e-9)
    assert OriginalDecisionMaker(calm).decide(belief).belief_set.bounds() == pytest.approx(np.array([[0, 1], [0, 1]]))
    with pytest.raises(InputError, match="wind_capacities is"):
        dispatch_problem(network, [1], [[5.0], [25.0]], wind_capacities=[-1.0])
    with pytest.raises(InputError, match="nothing can be scheduled"):
        dispatch_problem(PowerNetwork([0.0], [], [], [], [], np.zeros((0, 2), int), np.zeros((0, 2))), [], [[], []])


def test_a_line_that_carries_one_buss_load_alone_keeps_its_limit():
    """Nobody's schedule changes the flow to the last bus: a row without coefficients, which 40 MW over 30 MW break."""
    network = PowerNetwork([0.0, 40.0], [0], [80.0], [0.02], [1.0], [[0, 1]], [[0.1, 30.0]])
    with pytest.raises(ModelError, match=r"no decision satisfies line 0-1"):
        dispatch_problem(network, [0], [[5.0], [25.0]])


# --- transaction costs ------------------------------------------------------------------------------------------------


def market(rng, size=4):
    """A market of three regimes and the problem of it."""
    factors = rng.normal(size=(3, size, size + 2)) / 4
    return MarkowitzProblem(rng.normal(size=(3, size)) / 10, factors @ factors.transpose(0, 2, 1), 1.0)


@pytest.mark.parametrize("seed", range(6))
def test_trading_equals_norms_in_a_modelling_language(seed):
    rng = np.random.default_rng(seed)
    plain = market(rng)
    former, rates, bends = rng.dirichlet(np.ones(4)), rng.choice([0.0, 0.01, 0.05], 4), rng.uniform(0, 0.2, 4)
    problem = with_transaction_costs(plain, former, linear=rates, quadratic=bends)
    assert isinstance(problem, TradingProblem if rates.any() else QuadraticProblem)
    for belief in rng.dirichlet(np.ones(3), 5):
        u = cp.Variable(4, nonneg=True)
        covariance, mean = np.tensordot(belief, plain.covariances, 1), belief @ plain.means
        cost = cp.quad_form(u, cp.psd_wrap(covariance)) - mean @ u
        cost += rates @ cp.abs(u - former) + bends @ cp.square(u - former)
        programme = cp.Problem(cp.Minimize(cost), [cp.sum(u) == 1])
        programme.solve(solver=cp.CLARABEL)
        action = problem.solve(belief)
        assert float(problem.optimal_cost(belief)) == pytest.approx(programme.value, abs=1e-8)
        np.testing.assert_allclose(action, u.value, atol=1e-4)


def test_what_is_not_traded_says_little():
    """Two assets, unit variances: u_1 = ½ + π·m/4 without costs, and nothing is traded while |π·m − 0| ≤ 2κ around ½."""
    plain = MarkowitzProblem([[0.2, 0.0], [-0.2, 0.0]], [np.eye(2)] * 2, 1.0)
    problem = with_transaction_costs(plain, [0.5, 0.5], linear=0.02)
    np.testing.assert_array_equal(problem.solve([0.5, 0.5]), [0.5, 0.5])
    # Selling one asset and buying the other costs 2κ: kept where |0.2 (2 π_1 − 1)| ≤ 2κ.
    found = consistent_beliefs(problem, [0.5, 0.5])
    np.testing.assert_allclose(found.bounds(), [[0.4, 0.6], [0.4, 0.6]], atol=1e-9)
    moved = consistent_beliefs(problem, problem.solve([0.9, 0.1]))
    np.testing.assert_allclose(moved.bounds(), [[0.9, 0.9], [0.1, 0.1]], atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_the_subdifferential_explains_exactly_the_beliefs_that_lose_nothing(seed):
    rng = np.random.default_rng(seed)
    plain = market(rng, 3)
    plain = MarkowitzProblem(plain.means, plain.covariances, 1.0, simplex(3))
    problem = with_transaction_costs(plain, [0.3, 0.3, 0.4], linear=[0.05, 0.03, 0.04])
    beliefs = rng.dirichlet(np.ones(3), 150)
    for action in np.vstack([[0.3, 0.3, 0.4], problem.solve(beliefs[:3])]):
        regrets = problem.regret(beliefs, action)
        found = consistent_beliefs(problem, action)
        clear = (regrets < 1e-13) | (regrets > 1e-9)
        assert [found.contains(belief) for belief in beliefs[clear]] == (regrets[clear] < 1e-13).tolist()


def test_trading_downstream():
    problem = with_transaction_costs(market(np.random.default_rng(1)), [0.25] * 4, linear=0.01, quadratic=0.1)
    check_decision_problem(problem)
    belief = np.array([0.5, 0.2, 0.3])
    candidates = decoy_grid(problem, 20)
    single = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(0.001), candidates=candidates).decide(belief)
    mixed = ProbabilisticDecisionMaker(problem, budget=Budget.regret(0.001), candidates=candidates).decide(belief)
    assert single.regret <= 0.001
    assert 0 < single.privacy <= mixed.expected_privacy + 1e-9
    assert consistent_beliefs(problem, single.action).distance(belief) == pytest.approx(single.privacy, abs=1e-9)


def test_costs_of_trading_name_what_is_wrong():
    plain = market(np.random.default_rng(0))
    with pytest.raises(InputError, match="former has 3 coordinates, expected 4"):
        with_transaction_costs(plain, [0.3, 0.3, 0.4])
    with pytest.raises(InputError, match="a cost of trading must be at least 0"):
        with_transaction_costs(plain, [0.25] * 4, linear=-0.1)
    with pytest.raises(InputError, match="need a QuadraticProblem"):
        with_transaction_costs(3, [0.25] * 4)
    assert with_transaction_costs(plain, [0.25] * 4) is plain


@pytest.mark.parametrize("seed", some([25, 26, 27, 29], 3))
def test_a_local_search_leaves_no_trade_that_an_observer_takes_for_none(seed):
    rng = np.random.default_rng(seed)
    means, factors, former = rng.normal(size=(4, 4)), rng.normal(size=(4, 4, 4)), rng.dirichlet(np.ones(4))
    untraded = MarkowitzProblem(means, factors @ factors.swapaxes(1, 2) / 4, 1.0)
    problem = with_transaction_costs(untraded, former, linear=0.1)
    search = LocalSearch(n_starts=3, rng=np.random.default_rng(0))
    found = CounterAdversarialDecisionMaker(problem, budget=0.2, method=search).decide(rng.dirichlet(np.ones(4)))
    trades = np.abs(found.action - former)
    assert ((trades <= 1e-9) | (trades >= problem.constraints.min_slack)).all()
    assert problem.regret(found.decoy, found.action) <= 1e-9


@pytest.mark.parametrize("dust", some([2e-9, 1e-8, 1e-7, 9e-7], 3))
@pytest.mark.parametrize("kind", ["costs", "limit"])
def test_a_former_weight_that_is_nearly_zero_hides_as_one_of_zero_does(kind, dust):
    """A solver leaves such weights. An observer takes a sale of them for none."""
    rng = np.random.default_rng(1)
    means, factors = rng.normal(0.0, 0.08, (3, 3)), rng.normal(0.0, 0.2, (3, 3, 4))
    covariances, belief = factors @ factors.swapaxes(1, 2) + 0.005 * np.eye(3), rng.dirichlet(np.ones(3))
    found = []
    for former in ([0.0, 0.4, 0.6], [dust, 0.4, 0.6 - dust]):
        region = simplex(3) & turnover(former, 0.3) if kind == "limit" else simplex(3)
        problem = MarkowitzProblem(means, covariances, 2.0, constraints=region)
        if kind == "costs":
            problem = with_transaction_costs(problem, former, linear=0.02)
        makers = CounterAdversarialDecisionMaker(problem, budget=0.1), ProbabilisticDecisionMaker(problem, budget=0.1)
        single, mixed = (maker.decide(belief) for maker in makers)
        assert problem.is_admissible(single.action)
        assert consistent_beliefs(problem, single.action).contains(single.decoy)
        found.append([single.privacy, mixed.expected_privacy, problem.optimal_cost(belief)])
    assert min(found[0][:2]) > 0.1
    np.testing.assert_allclose(found[1], found[0], rtol=0.02)
    np.testing.assert_allclose(found[1][2], found[0][2], atol=dust)


def test_former_weights_of_a_hundredth_of_the_least_slack_have_a_quadratic_form(fresh_rng):
    plain = MarkowitzProblem(np.eye(2), [np.eye(2)] * 2, 1.0)
    for weight in 10 ** fresh_rng.uniform(np.log10(1.1e-6), -4.0, 100):
        assert with_transaction_costs(plain, [weight, 1.0 - weight], linear=0.02).quadratic_form() is not None


@pytest.mark.parametrize(("linear", "quadratic"), [(0.001, 0.0), (0.001, 0.2), (0.0, 0.2)])
def test_costs_on_a_problem_whose_limit_has_a_former_weight_of_nearly_zero(linear, quadratic):
    former = np.array([0.6, 0.4 - 5e-7, 5e-7])
    means = np.array([[0.1, 0.2, 0.3], [0.3, 0.1, 0.1]])
    plain = MarkowitzProblem(means, [np.eye(3)] * 2, 1.0, simplex(3) & turnover(former, 0.2))
    problem = with_transaction_costs(plain, former, linear=linear, quadratic=quadratic)
    belief, u = np.array([0.6, 0.4]), cp.Variable(3, nonneg=True)
    cost = cp.sum_squares(u) - (belief @ means) @ u + quadratic * cp.sum_squares(u - former)
    cost += linear * cp.norm1(u - former)
    least = cp.Problem(cp.Minimize(cost), [cp.sum(u) == 1, cp.norm1(u - former) <= 0.2]).solve(solver=cp.CLARABEL)
    assert problem.optimal_cost(belief) == pytest.approx(least, abs=1e-8)
    assert consistent_beliefs(problem, problem.solve(belief)).contains(belief)


def test_costs_on_a_derived_class_with_costs_of_its_own_are_refused():
    class Own(MarkowitzProblem):
        def state_costs(self, actions):
            return 2.0 * super().state_costs(actions)

    with pytest.raises(InputError, match="need a QuadraticProblem"):
        with_transaction_costs(Own(np.eye(2), [np.eye(2)] * 2, 1.0), [0.5, 0.5], linear=0.02)


@pytest.mark.parametrize(("seed", "gap"), some([(4, 3e-6), (3, 2e-5), (15, 2e-5), (15, 8e-5)], 2))
def test_a_limit_from_weights_rounded_hides_as_one_from_those_of_the_trading_costs(seed, gap):
    rng = np.random.default_rng(seed)
    means, factors = rng.normal(0.0, 0.08, (3, 4)), rng.normal(0.0, 0.2, (3, 4, 5))
    covariances, former = factors @ factors.swapaxes(1, 2) + 0.005 * np.eye(4), rng.dirichlet(np.ones(4))
    found = []
    for published in (former, former + gap * np.array([1, -1, 1, -1])):
        plain = MarkowitzProblem(means, covariances, 2.0, constraints=simplex(4) & turnover(published, 0.5))
        problem = with_transaction_costs(plain, former, linear=0.03)
        proved = CounterAdversarialDecisionMaker(problem, budget=0.2, method=GlobalSearch(certify=0.02))
        decision = proved.decide([0.5, 0.3, 0.2])
        assert problem.is_admissible(decision.action)
        single = CounterAdversarialDecisionMaker(problem, budget=0.2).decide([0.5, 0.3, 0.2])
        assert problem.is_admissible(single.action)
        found.append([decision.privacy, single.privacy])
    np.testing.assert_allclose(found[1], found[0], rtol=0.01)


def test_a_limit_on_turnover_from_a_single_asset_is_proved_as_the_bounds_it_means():
    """The sum of the weights implies that none is above one."""
    rng = np.random.default_rng(1)
    means, factors = np.array([0.0, 0.1]) + rng.normal(0.0, 0.08, (3, 2)), rng.normal(0.0, 0.2, (3, 2, 3))
    covariances, belief = factors @ factors.swapaxes(1, 2) + 0.005 * np.eye(2), rng.dirichlet(np.ones(3))
    found = []
    for region in (turnover([0.0, 1.0], 0.3), max_weights(2, [0.15, 1.0])):
        problem = MarkowitzProblem(means, covariances, 2.0, constraints=simplex(2) & region)
        method = GlobalSearch(certify=0.01, max_oracle_calls=500)
        decision = CounterAdversarialDecisionMaker(problem, budget=0.2, method=method).decide(belief)
        found.append([decision.privacy, decision.privacy_bound])
    np.testing.assert_allclose(found[0], found[1], rtol=0.01)  # the bounds' gap


@pytest.mark.parametrize("seed", range(3))
def test_former_weights_at_limits_that_the_sum_implies(seed, fresh_rng):
    """Caps of .3 on two of three leave at least .4 to the third: it can only be bought, so that its cost has no kink."""
    rng = fresh_rng if seed == 0 else np.random.default_rng(seed)
    means, factors, belief = rng.normal(0.0, 0.08, (2, 3)), rng.normal(0.0, 0.2, (2, 3, 4)), rng.dirichlet(np.ones(2))
    covariances = factors @ factors.swapaxes(1, 2) + 0.005 * np.eye(3)
    former, caps = np.array([0.3, 0.3, 0.4]), np.array([0.3, 0.3, 1.0])
    region = simplex(3) & max_weights(3, caps) & turnover(former, 0.2)
    problem = with_transaction_costs(MarkowitzProblem(means, covariances, 2.0, constraints=region), former, linear=0.02)
    u = cp.Variable(3, nonneg=True)
    cost = 2 * cp.quad_form(u, cp.psd_wrap(np.tensordot(belief, covariances, 1))) - (belief @ means) @ u
    rows = [cp.sum(u) == 1, u <= caps, cp.norm1(u - former) <= 0.2]
    least = cp.Problem(cp.Minimize(cost + 0.02 * cp.norm1(u - former)), rows).solve(solver=cp.CLARABEL)
    assert problem.optimal_cost(belief) == pytest.approx(least, abs=1e-7)
    assert consistent_beliefs(problem, problem.solve(belief)).contains(belief)
    check_decision_problem(problem)
