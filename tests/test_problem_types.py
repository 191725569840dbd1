"""Linear, finite and growth problems against enumeration, closed forms and HiGHS; and all of them downstream."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import linprog, minimize_scalar

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    DesiredObfuscation,
    FiniteProblem,
    GlobalSearch,
    Infeasibility,
    InputError,
    KellyProblem,
    LinearProblem,
    LocalSearch,
    MarkowitzProblem,
    MaximalObfuscation,
    ModelError,
    NonExistence,
    NonUniqueness,
    OriginalDecisionMaker,
    Polyhedron,
    ProbabilisticDecisionMaker,
    box,
    consistent_beliefs,
    decoy_grid,
    explain_action,
    near_optimal_beliefs,
    plausibility_gap,
    privacy_frontier,
    random_candidates,
    simplex,
    simplex_grid,
)
from oracles import enumeration
from sizes import audited, instances, some
from strategies import SEEDS

TABLE = np.array([[0.0, 4.0, 6.0, 9.0], [8.0, 3.0, 2.0, 9.0], [9.0, 6.0, 1.0, 9.0]])


def cell_distance(costs, choice, point):
    """Distance of a belief from {π : π·(s(a) − s(b)) ≤ 0 for all b}, by CVXPY; infinite where the cell is empty."""
    import cvxpy as cp

    x = cp.Variable(len(point), nonneg=True)
    rows = (costs[:, [choice]] - costs).T
    programme = cp.Problem(cp.Minimize(cp.sum_squares(x - point)), [cp.sum(x) == 1, rows @ x <= 0])
    programme.solve(solver=cp.CLARABEL)
    return float(np.linalg.norm(x.value - point)) if programme.status in ("optimal", "optimal_inaccurate") else np.inf


def best_mixture(regrets, privacies, limit):
    """Largest expected privacy at an expected regret, by HiGHS."""
    answer = linprog(-privacies, regrets[None], [limit], np.ones((1, len(regrets))), [1.0])
    return -answer.fun


def vertices_of(region):
    """All vertices of a small polyhedron, by trying every set of rows."""
    n_equal = len(region.b_eq)
    found = []
    for rows in combinations(range(len(region.b_ub)), region.n_actions - n_equal):
        matrix = np.vstack([region.A_eq, region.A_ub[list(rows)]])
        if np.linalg.matrix_rank(matrix) == region.n_actions:
            point = np.linalg.solve(matrix, np.concatenate([region.b_eq, region.b_ub[list(rows)]]))
            if (region.A_ub @ point <= region.b_ub + 1e-9).all():
                found.append(point)
    return np.array(found)


def random_region(rng, size):
    """The simplex with caps and a sector, a box with a net limit, or a box alone."""
    kind = rng.integers(3)
    if kind == 0:
        return simplex(size) & box([0.0] * size, [0.6] * size) & Polyhedron([np.arange(size) % 2], [0.7])
    ends = rng.uniform(0.2, 1, size)
    return box(-ends, ends) & Polyhedron([rng.uniform(0.5, 1, size)], [0.3]) if kind == 1 else box(-ends, ends)


def horse_race(n_states):
    """The state is the winner, at different odds: u* = π."""
    odds = np.zeros((n_states, 1, n_states))
    odds[np.arange(n_states), 0, np.arange(n_states)] = np.arange(2, n_states + 2)
    return KellyProblem(odds, np.ones((n_states, 1)))


def divergence(belief, bets):
    """The Kullback–Leibler divergence of bets (…,X) from a belief."""
    return (belief * np.log(belief / bets)).sum(axis=-1)


# --- finite -----------------------------------------------------------------------------------------------------------


@settings(max_examples=instances(25), deadline=None)
@given(SEEDS)
def test_finite_problems_equal_enumeration(seed):
    rng = np.random.default_rng(seed)
    costs = rng.normal(size=(int(rng.integers(2, 5)), int(rng.integers(1, 7))))
    problem = FiniteProblem(costs)
    belief, limit = rng.dirichlet(np.ones(len(costs))), float(rng.uniform(0, 1.5))
    assert problem.solve(belief) == (belief @ costs).argmin()
    regrets = belief @ costs - (belief @ costs).min()
    distances = np.array([cell_distance(costs, choice, belief) for choice in range(costs.shape[1])])
    sets = [consistent_beliefs(problem, choice) for choice in range(costs.shape[1])]
    np.testing.assert_allclose([each.distance(belief) for each in sets], distances, atol=2e-5)
    open_to_all = np.isfinite(distances)
    single = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(limit)).decide(belief)
    best = distances[open_to_all & (regrets <= limit)].max()
    assert single.privacy == pytest.approx(best, abs=2e-5)
    assert isinstance(single.action, int)
    assert regrets[single.action] <= limit
    mixed = ProbabilisticDecisionMaker(problem, budget=Budget.regret(limit)).decide(belief)
    wanted = best_mixture(regrets[open_to_all], distances[open_to_all], limit)
    assert mixed.expected_privacy == pytest.approx(wanted, abs=2e-5)
    assert mixed.actions.dtype.kind == "i"


def test_a_choice_is_explained_where_no_other_is_cheaper():
    problem = FiniteProblem(TABLE)
    beliefs = np.random.default_rng(0).dirichlet(np.ones(3), 200)
    for choice in range(4):
        cheapest = (beliefs @ TABLE).argmin(axis=1) == choice
        found = consistent_beliefs(problem, choice)
        assert [found.contains(belief) for belief in beliefs] == cheapest.tolist()
    assert consistent_beliefs(problem, 3).is_empty
    assert plausibility_gap(problem, 3) == pytest.approx(9 - max_of_cheapest(TABLE), abs=1e-6)


def max_of_cheapest(costs):
    """max over beliefs of the least expected cost, by HiGHS."""
    n_states, n_choices = costs.shape
    rows = np.column_stack([-costs.T, np.ones(n_choices)])
    whole = np.append(np.ones(n_states), 0.0)[None]
    answer = linprog(np.append(np.zeros(n_states), -1.0), rows, np.zeros(n_choices), whole, [1.0],
                     bounds=[(0, 1)] * n_states + [(None, None)])  # fmt: skip
    return -answer.fun


def test_finite_decisions_are_whole_numbers_everywhere():
    problem = FiniteProblem(TABLE)
    beliefs = np.array([[0.8, 0.1, 0.1], [0.2, 0.3, 0.5]])
    assert problem.solve(beliefs[0]) == 0
    np.testing.assert_array_equal(problem.solve(beliefs), [0, 2])
    np.testing.assert_allclose(problem.state_costs([1, 2]), TABLE.T[[1, 2]])
    np.testing.assert_allclose(problem.regret(beliefs, [0, 2]), 0.0)
    np.testing.assert_array_equal(OriginalDecisionMaker(problem).decide_many(beliefs).action, [0, 2])
    for maker in (CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker):
        for measure in (
            MaximalObfuscation(),
            DesiredObfuscation([0, 0, 1]),
            NonExistence(),
            NonUniqueness(),
            Infeasibility(),
        ):
            decided = maker(problem, measure, Budget.regret(20.0)).decide_many(beliefs)
            chosen = decided.action if maker is CounterAdversarialDecisionMaker else decided.actions
            assert chosen.dtype.kind == "i", measure
            again = maker(problem, measure, Budget.regret(20.0)).decide(beliefs[0])
            assert np.shape(again.action if maker is CounterAdversarialDecisionMaker else again.actions[0]) == ()
    hidden = CounterAdversarialDecisionMaker(problem, Infeasibility(), Budget.regret(20.0)).decide(beliefs[0])
    assert hidden.action == 3
    assert "choice 3" in hidden.summary()


def test_a_choice_that_no_decoy_of_the_grid_leads_to_is_a_candidate():
    costs = np.array([[0.0, 1.0, 0.496], [1.0, 0.0, 0.499]])  # the third is best in a cell of width 0.01
    problem = FiniteProblem(costs)
    assert problem.solve([0.5, 0.5]) == 2
    candidates = decoy_grid(problem, 3)
    assert candidates.actions.any(axis=0).all()


def test_finite_problems_refuse_what_does_not_exist():
    problem = FiniteProblem(TABLE)
    with pytest.raises(InputError, match="choice 4 does not exist: expected 0 to 3"):
        consistent_beliefs(problem, 4)
    with pytest.raises(InputError, match="local search needs decisions between choices"):
        CounterAdversarialDecisionMaker(problem, method=LocalSearch())
    with pytest.raises(InputError, match="at least one state and one choice"):
        FiniteProblem(np.zeros((2, 0)))


# --- tied faces -------------------------------------------------------------------------------------------------------


def test_mixtures_of_tied_choices_tell_the_border_and_cost_next_to_nothing():
    problem = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
    belief = np.array([0.9, 0.1])
    plain = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(0.01)).decide(belief)
    assert plain.privacy == 0.0
    faces = decoy_grid(problem, 4, faces=True)
    mixed = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(0.01), candidates=faces).decide(belief)
    assert mixed.privacy == pytest.approx(0.4 * np.sqrt(2), abs=1e-9)
    assert mixed.regret <= 2e-4
    assert mixed.action.shape == (2,)
    with pytest.raises(InputError, match="faces=True is for linear and finite problems"):
        decoy_grid(MarkowitzProblem(np.eye(2), [np.eye(2)] * 2, 1.0), 4, faces=True)


def test_every_tied_pair_and_triple_has_a_mixture_near_each_of_its_members():
    problem = FiniteProblem(TABLE[:, :3])
    faces = decoy_grid(problem, 6, faces=True)
    borders = faces.actions[(faces.actions > 0).sum(axis=1) == 2]
    for action in borders:
        first, second = np.flatnonzero(action)
        found = consistent_beliefs(problem, action)
        assert found.dimension == 1
        values = found.vertices() @ TABLE[:, :3]
        np.testing.assert_allclose(values[:, first], values[:, second], atol=1e-9)
        np.testing.assert_allclose(values.min(axis=1), values[:, first], atol=1e-9)
    assert len(borders) == 2 * len({tuple(np.flatnonzero(action)) for action in borders})


def test_choices_tie_where_their_expected_costs_cancel(fresh_rng):
    even = np.ones(3) / 3
    assert FiniteProblem([[0.1, 0.0], [0.2, 0.0], [-0.3, 0.0]]).tied(even).tolist() == [True, True]
    for costs in fresh_rng.integers(-9, 10, (20, 3, 2)) * 0.1:
        problem = FiniteProblem(np.vstack([costs, -costs.sum(axis=0)]))
        assert problem.tied(np.ones(4) / 4).all(), costs.tolist()
        assert problem.solve(np.ones(4) / 4) == 0


# --- linear -----------------------------------------------------------------------------------------------------------


@settings(max_examples=instances(40), deadline=None)
@given(SEEDS)
def test_linear_decisions_are_the_cheapest_of_all_vertices(seed):
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 5))
    region = random_region(rng, size)
    costs = rng.normal(size=(3, size))
    problem = LinearProblem(costs, region)
    corners = vertices_of(region)
    beliefs = rng.dirichlet(np.ones(3), 20)
    solved = problem.solve(beliefs)
    np.testing.assert_allclose(problem.optimal_cost(beliefs), (beliefs @ costs @ corners.T).min(axis=1), atol=1e-12)
    gaps = np.abs(solved[:, None] - corners[None]).max(axis=2).min(axis=1)
    assert gaps.max() <= 1e-12, "a decision is a vertex"
    for belief, action in zip(beliefs[:5], solved[:5], strict=True):
        np.testing.assert_array_equal(problem.solve(belief), action)
        found = consistent_beliefs(problem, action)
        members = rng.dirichlet(np.ones(3), 40)
        optimal = (members @ costs @ action) <= (members @ costs @ corners.T).min(axis=1) + 1e-10
        assert [found.contains(member) for member in members] == optimal.tolist()
        assert found.contains(belief)


def test_ties_fall_alike_in_any_company():
    problem = LinearProblem([[1.0, 1.0, 2.0], [1.0, 1.0, 0.0]], simplex(3))
    tied = np.array([[0.9, 0.1], [0.5, 0.5], [1.0, 0.0], [0.2, 0.8], [0.5, 0.5]])
    alone = np.array([LinearProblem(problem.costs, simplex(3)).solve(belief) for belief in tied])
    np.testing.assert_array_equal(problem.solve(tied), alone)
    np.testing.assert_array_equal(problem.solve(tied[::-1])[::-1], alone)
    for first in ([0.9, 0.1], [0.1, 0.9]):  # whichever of the tied vertices is known already
        border = LinearProblem([[0.0, 1.0], [1.0, 0.0]], simplex(2))
        border.solve(first)
        np.testing.assert_array_equal(border.solve([0.5, 0.5]), [0.0, 1.0])
    nothing = LinearProblem(np.zeros((2, 3)), simplex(3))
    assert np.unique(nothing.solve(tied), axis=0).shape == (1, 3)


@pytest.mark.parametrize("seed", range(20))
def test_ties_of_costs_that_cancel_fall_alike_in_any_company(seed):
    rng = np.random.default_rng([7, seed])
    costs = rng.integers(-9, 10, (3, 3)) * 0.1
    costs = np.vstack([costs, -costs.sum(axis=0)])  # expected costs of zero under the uniform belief
    even = np.ones(4) / 4
    known = LinearProblem(costs, box(np.zeros(3), np.ones(3)))
    known.solve(rng.dirichlet(np.ones(4), 20))
    alone = LinearProblem(costs, known.constraints).solve(even)
    np.testing.assert_array_equal(known.solve(even), alone)
    np.testing.assert_array_equal(alone, np.zeros(3))


def test_linear_problems_downstream():
    rng = np.random.default_rng(3)
    problem = LinearProblem(rng.normal(size=(3, 5)), simplex(5) & box([0] * 5, [0.5] * 5))
    belief = np.array([0.3, 0.3, 0.4])
    corners = np.unique(vertices_of(problem.constraints), axis=0)
    regrets = corners @ problem.costs.T @ belief - float(problem.optimal_cost(belief))
    # All beliefs that explain a mixture of vertices explain each of them; near one of these it has their regret.
    tied = [list(some) for size in (1, 2, 3) for some in combinations(range(len(corners)), size)]
    values = np.array([consistent_beliefs(problem, corners[some].mean(axis=0)).distance(belief) for some in tied])
    least = np.array([regrets[some].min() for some in tied])
    known, share = np.isfinite(values), 2e-4 * np.ptp(regrets)
    assert any(len(tied[n]) > 1 for n in np.flatnonzero(known))
    for limit in (0.05, 0.3, 1.0):
        single = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(limit)).decide(belief)
        assert single.privacy == pytest.approx(values[known & (least <= limit - share)].max(), abs=1e-9)
        mixed = ProbabilisticDecisionMaker(problem, budget=Budget.regret(limit)).decide(belief)
        dearer, at_most = (best_mixture(least[known] + more, values[known], limit) for more in (share, 0.0))
        assert dearer - 1e-9 <= mixed.expected_privacy <= at_most + 1e-9
        assert privacy_frontier(problem, belief).deterministic(limit) == pytest.approx(single.privacy, abs=1e-9)
    local = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(0.3), method=LocalSearch()).decide(belief)
    assert local.regret <= 0.3


def test_linear_problems_name_what_is_wrong():
    with pytest.raises(ModelError, match="cost of state 1 has no minimum"):
        LinearProblem([[0.0, 0.0], [-1.0, 0.0]], box([0, 0], [np.inf, 1]))
    with pytest.raises(InputError, match="constraints have 3 coordinates, the costs 2"):
        LinearProblem(np.eye(2), simplex(3))


# --- growth -----------------------------------------------------------------------------------------------------------


def test_a_horse_race_is_bet_as_it_is_believed():
    problem = horse_race(4)
    beliefs = np.vstack([simplex_grid(4, 8), np.random.default_rng(0).dirichlet([0.3] * 4, 40)])
    np.testing.assert_allclose(problem.solve(beliefs), beliefs, atol=1e-9)
    inside = np.random.default_rng(1).dirichlet(np.ones(4), 30)
    bets = np.random.default_rng(2).dirichlet(np.ones(4), 30)
    wanted = [divergence(belief, bet) for belief, bet in zip(inside, bets, strict=True)]
    np.testing.assert_allclose(problem.regret(inside, bets), wanted, atol=1e-12)


@pytest.mark.parametrize("case", some([((0.2, 0.3, 0.5), 0.02), ((0.3, 0.3, 0.4), 0.1), ((0.05, 0.15, 0.8), 0.05)], 3))
def test_a_horse_race_is_hidden_as_the_closed_form_says(case):
    belief, limit = np.array(case[0]), case[1]
    problem = horse_race(3)
    candidates = decoy_grid(problem, 40 if audited() else 20)
    maker = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(limit), candidates=candidates)
    angles = np.linspace(0, 2 * np.pi, 20_001)
    plane = np.array([[1, -1, 0], [1, 1, -2]]) / np.sqrt([[2], [6]])
    ways = np.column_stack([np.cos(angles), np.sin(angles)]) @ plane
    low, high = np.zeros(len(ways)), (belief / np.maximum(-ways, 1e-12)).min(axis=1)
    for _ in range(60):
        middle = (low + high) / 2
        fits = divergence(belief, np.maximum(belief + middle[:, None] * ways, 1e-300)) <= limit
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    single = maker.decide(belief)
    assert single.privacy == pytest.approx(low.max(), abs=1e-6)
    assert single.regret <= limit
    lotteries = ProbabilisticDecisionMaker(problem, budget=Budget.regret(limit), candidates=candidates)
    mixed = lotteries.decide(belief)
    bets = np.vstack([candidates.actions, single.action, belief])
    known = (bets >= 1e-4).all(axis=1)
    wanted = best_mixture(divergence(belief, bets[known]), np.linalg.norm(bets[known] - belief, axis=1), limit)
    assert mixed.expected_privacy >= wanted - 1e-7
    assert mixed.expected_regret <= limit * (1 + 1e-9)


@settings(max_examples=instances(15), deadline=None)
@given(SEEDS)
def test_growth_equals_a_conic_solver(seed):
    import cvxpy as cp

    rng = np.random.default_rng(seed)
    n_states, outcomes, assets = 2, int(rng.integers(2, 6)), int(rng.integers(2, 6))
    problem = KellyProblem(
        rng.lognormal(0, 0.3, (n_states, outcomes, assets)), rng.dirichlet(np.ones(outcomes), n_states)
    )
    belief = rng.dirichlet(np.ones(n_states))
    u = cp.Variable(assets, nonneg=True)
    growth = sum(belief[i] * problem.probabilities[i] @ cp.log(problem.gross_returns[i] @ u) for i in range(n_states))
    programme = cp.Problem(cp.Maximize(growth), [cp.sum(u) == 1])
    programme.solve(solver=cp.CLARABEL)
    assert float(problem.optimal_cost(belief)) <= -programme.value + 1e-9
    assert float(problem.optimal_cost(belief)) == pytest.approx(-programme.value, abs=1e-6)
    assert consistent_beliefs(problem, problem.solve(belief)).contains(belief)


@given(SEEDS)
@settings(max_examples=instances(40))
def test_the_unit_of_an_outcomes_returns_changes_no_belief(seed):
    """Log wealth moves by a constant in each outcome, here by up to 10^±9."""
    rng = np.random.default_rng(seed)
    returns = rng.uniform(0.5, 1.6, size=(3, 4, 3))
    chances = rng.dirichlet(np.ones(4), size=3)
    units = 10.0 ** rng.uniform(-9, 9, size=(3, 4, 1))
    for given_returns, given_units in ((returns, units), (3.0 * np.eye(3)[:, None], units[:, :1])):
        shares = chances if given_returns is returns else np.ones((3, 1))
        one, other = (KellyProblem(each, shares) for each in (given_returns, given_units * given_returns))
        belief = rng.dirichlet(np.ones(3))
        decision = one.solve(belief)
        np.testing.assert_allclose(other.solve(belief), decision, atol=1e-6)
        np.testing.assert_allclose(other.cost_gradients(decision), one.cost_gradients(decision), rtol=1e-9)
        told = [consistent_beliefs(each, decision) for each in (one, other)]
        np.testing.assert_allclose(told[1].bounds(), told[0].bounds(), atol=1e-6)
        assert told[1].distance(belief) <= 1e-4
        assert one.costs_are_unique == other.costs_are_unique


def leveraged(returns, chances, limit):
    """Two assets with a budget of one, each held between −limit and limit."""
    held = box([-limit] * 2, [limit] * 2) & Polyhedron(A_eq=[[1.0, 1.0]], b_eq=[1.0])
    return KellyProblem(returns, chances, held)


@pytest.mark.parametrize("limit", [10.0, 20.0, 100.0])
def test_wide_leverage_is_solved_though_the_feasible_set_holds_ruin(limit):
    """Up 30 % or down 20 % with chances p and q: the stake is p/.2 − q/.3, whatever the limit beyond it."""
    problem = leveraged([[[1.3, 1.0], [0.8, 1.0]]] * 2, [[0.9, 0.1], [0.5, 0.5]], limit)
    beliefs = np.array([[1.0, 0.0], [0.7, 0.3], [0.5, 0.5], [0.0, 1.0]])
    up = beliefs @ [0.9, 0.5]
    wanted = up / 0.2 - (1 - up) / 0.3
    actions = problem.solve(beliefs)
    np.testing.assert_allclose(actions, np.column_stack([wanted, 1 - wanted]), rtol=0.0, atol=1e-9)
    for belief, action in zip(beliefs, actions, strict=True):
        assert consistent_beliefs(problem, action).contains(belief)
    assert not problem.costs_are_unique


@pytest.mark.parametrize("chance", [1e-6, 1e-5, 0.1])
def test_ruin_by_leverage_is_within_no_budget_however_rare(chance):
    """Its cost times its probability was less than what leverage gains: ruin counted as free, and as proved."""
    up, down, crash = [1.3, 1.0], [0.8, 1.0], [0.0, 1.0]
    problem = leveraged([[up, down, crash]] * 2, [[0.9 - chance, 0.1, chance], [0.9, 0.1, 0.0]], 10.0)
    assert problem.regret([0.5, 0.5], problem.solve([0.0, 1.0])) > 1000.0
    candidates, budget = decoy_grid(problem, 20), Budget.regret(1e-3)
    for method in (None, GlobalSearch(certify=0.01)):
        maker = CounterAdversarialDecisionMaker(problem, budget=budget, candidates=candidates, method=method)
        assert problem.wealth(maker.decide([0.5, 0.5]).action)[0].min() > 0.0


@pytest.mark.parametrize("chance", [1e-4, 1e-7, 1e-8, 1e-9])
def test_a_rare_crash_leaves_a_leveraged_decision_explained(chance):
    """The wealth that an optimal decision keeps in the crash is of the size of the crash's probability."""
    returns = [[[up, 1.0], [down, 1.0], [0.5, 1.0]] for up, down in ((1.10, 1.02), (1.06, 0.99))]
    problem = leveraged(returns, [[0.5, 0.5 - chance, chance]] * 2, 5.0)
    belief = np.array([0.3, 0.7])
    action = problem.solve(belief)
    assert 0.0 < problem.wealth(action)[0, 2] < 20 * chance
    # The decision's rounding, 1e-16, beside the wealth in the crash.
    assert consistent_beliefs(problem, action).distance(belief) <= 1e-9 + 1e-16 / chance
    explained = explain_action(problem, action)
    assert explained.is_explained
    assert explained.gap == 0.0


def test_returns_by_quadrature_leave_a_leveraged_decision_explained():
    nodes, weights = np.polynomial.hermite_e.hermegauss(15)
    returns = [[[np.exp(m + s * z), np.exp(0.001)] for z in nodes] for m, s in ((0.01, 0.05), (0.005, 0.04))]
    problem = leveraged(returns, np.tile(weights / weights.sum(), (2, 1)), 10.0)
    for belief in ([0.3, 0.7], [0.8, 0.2]):
        assert consistent_beliefs(problem, problem.solve(belief)).contains(belief)


def test_growth_downstream():
    rng = np.random.default_rng(5)
    problem = KellyProblem(rng.lognormal(0, 0.2, (3, 6, 4)), rng.dirichlet(np.ones(6), 3))
    belief = np.array([0.2, 0.3, 0.5])
    candidates = decoy_grid(problem, 10)
    for measure in some((MaximalObfuscation(), DesiredObfuscation([1, 0, 0]), NonExistence(), NonUniqueness()), 2):
        for maker in (CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker):
            made = maker(problem, measure, Budget.regret(0.01), candidates=candidates)
            decided = made.decide_many([belief, belief])
            assert (
                np.atleast_2d(decided.regret.T if maker is CounterAdversarialDecisionMaker else 0.0) <= 0.01 + 1e-12
            ).all()
    assert len(random_candidates(problem, 5, rng=rng)) == 5
    assert near_optimal_beliefs(problem, problem.solve(belief), 0.01).contains(belief)
    assert plausibility_gap(problem, problem.solve(belief)) == 0.0


def test_growth_without_end_is_refused_and_a_market_without_arbitrage_is_not():
    returns, chances = np.array([[[1.1, 0.9], [1.0, 1.2]]] * 2), [[0.5, 0.5], [0.3, 0.7]]
    stakes = Polyhedron(A_ub=-np.eye(2), b_ub=np.zeros(2))
    with pytest.raises(ModelError, match="wealth in state 0 grows without end over the feasible set: add bounds"):
        KellyProblem(returns, chances, stakes)
    short = Polyhedron(A_ub=np.zeros((0, 2)), b_ub=np.zeros(0), A_eq=np.ones((1, 2)), b_eq=np.ones(1))
    problem = KellyProblem(returns, chances, short)
    wealth = lambda u: 0.4 * np.log(returns[0, 0] @ [u, 1 - u]) + 0.6 * np.log(returns[0, 1] @ [u, 1 - u])  # noqa: E731
    best = minimize_scalar(lambda u: -wealth(u), bounds=(-3.0, 3.0), method="bounded", options={"xatol": 1e-10}).x
    assert problem.solve([0.5, 0.5])[0] == pytest.approx(best, abs=1e-6)


def test_growth_names_what_is_wrong():
    with pytest.raises(InputError, match=r"gross_returns has -0\.1"):
        KellyProblem([[[1.0, -0.1]]], [[1.0]])
    with pytest.raises(ModelError, match="every asset is worthless in outcome 1 of state 0"):
        KellyProblem([[[1.0, 1.0], [0.0, 0.0]]], [[0.5, 0.5]])
    with pytest.raises(ModelError, match="every decision loses everything in some outcome"):
        KellyProblem([[[2.0, 0.0], [0.0, 2.0]]], [[0.5, 0.5]], simplex(2) & Polyhedron(A_eq=[[1, 0]], b_eq=[0]))
    with pytest.raises(InputError, match="expected"):
        KellyProblem(np.ones((2, 3, 2)), np.ones((2, 2)) / 2)


@pytest.mark.parametrize("seed", range(6))
def test_proofs_for_choices_are_enumerations(seed: int) -> None:
    rng = np.random.default_rng([seed, 91])
    problem, belief = FiniteProblem(rng.uniform(0, 5, (3, 9))), rng.dirichlet(np.ones(3))
    limit = 1.0
    sets = [consistent_beliefs(problem, choice) for choice in range(9)]
    regrets = np.array([float(problem.regret(belief, choice)) for choice in range(9)])
    privacies = np.array([-np.inf if each.is_empty else each.distance(belief) for each in sets])
    few = np.eye(9)[[int(problem.solve(belief))]]
    single = CounterAdversarialDecisionMaker(
        problem, budget=Budget.regret(limit), candidates=few, method=GlobalSearch(certify=0.01)
    ).decide(belief)
    best = max(privacies[regrets <= limit].max(), 0.0)
    assert single.privacy == pytest.approx(best, abs=1e-9)
    assert single.privacy_bound == pytest.approx(best, abs=1e-9)
    mixed = ProbabilisticDecisionMaker(problem, budget=Budget.regret(limit), candidates=few, certify=0.01).decide(
        belief
    )
    known = np.isfinite(privacies)
    expected = enumeration.upper_concave_envelope(regrets[known], privacies[known], limit)
    assert mixed.expected_privacy == pytest.approx(expected, abs=1e-7)
    assert mixed.privacy_bound >= expected - 1e-9
    assert mixed.probabilities @ mixed.regrets <= limit * (1 + 1e-9)


@pytest.mark.parametrize("targeted", some([True, False], 2))  # without a target: also by the test below
def test_proofs_of_growth_are_above_a_scan_in_closed_form(targeted: bool) -> None:
    belief = np.array([0.5, 0.3, 0.2])
    problem = KellyProblem(np.diag([2.6, 3.2, 4.0])[:, None, :], np.ones((3, 1)))
    measure = DesiredObfuscation([0.1, 0.1, 0.8]) if targeted else MaximalObfuscation()
    decision = CounterAdversarialDecisionMaker(
        problem, measure, Budget.regret(0.05), candidates=decoy_grid(problem, 12), method=GlobalSearch(certify=0.05)
    ).decide(belief)
    scan = simplex_grid(3, 300)
    scan = scan[(scan > 0).all(axis=1)]
    divergence = (belief * np.log(belief / scan)).sum(axis=1)
    reached = scan[divergence <= 0.05]
    away = np.linalg.norm(reached - (np.array([0.1, 0.1, 0.8]) if targeted else belief), axis=1)
    assert decision.privacy_bound >= (-away.min() if targeted else away.max())
    assert decision.privacy_bound >= decision.privacy


def test_proofs_of_a_horse_race_close() -> None:
    """What a state that a bettor rules out would cost is of no account."""
    belief, limit = np.array([0.5, 0.3, 0.2]), 0.05
    problem = horse_race(3)
    few = decoy_grid(problem, 25)
    single = CounterAdversarialDecisionMaker(
        problem, budget=Budget.regret(limit), candidates=few, method=GlobalSearch(certify=0.01)
    ).decide(belief)
    mixed = ProbabilisticDecisionMaker(problem, budget=Budget.regret(limit), candidates=few, certify=0.05).decide(
        belief
    )
    bets = simplex_grid(3, 200 if audited() else 50)
    bets = bets[(bets > 0).all(axis=1)]
    regrets, away = divergence(belief, bets), np.linalg.norm(bets - belief, axis=1)
    assert single.status is mixed.status is DecisionStatus.GAP_REACHED
    assert away[regrets <= limit].max() - 1e-9 <= single.privacy_bound <= 1.0101 * single.privacy
    assert best_mixture(regrets, away, limit) - 1e-9 <= mixed.privacy_bound <= 1.0501 * mixed.expected_privacy


@pytest.mark.parametrize("choice", [0.5, True, np.float64(1.0)])
def test_a_choice_that_is_no_whole_number_is_named(choice):
    with pytest.raises(InputError, match=r"a choice must be a whole number from 0 to 1, got"):
        consistent_beliefs(FiniteProblem([[1.0, 2.0], [2.0, 1.0]]), choice)
