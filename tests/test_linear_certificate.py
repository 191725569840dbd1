"""Proven bounds of linear costs against all faces of the feasible set: what is tied, and what explains it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from inscrutable import (
    Budget,
    ConvexProblem,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    DesiredObfuscation,
    FiniteProblem,
    GlobalSearch,
    LinearProblem,
    MarkowitzProblem,
    Polyhedron,
    ProbabilisticDecisionMaker,
    box,
    cheapest_privacy,
    consistent_beliefs,
    decoy_grid,
    privacy_frontier,
    simplex,
    simplex_grid,
)
from inscrutable.problems import LinearForm
from inscrutable.problems.piecewise_linear import PiecewiseLinearProblem
from inscrutable.testing import check_decision_problem
from oracles import tied
from sizes import audited, instances
from strategies import OwnShares


def region_of(rng, size, kind):
    """The simplex, with caps, with a sector; a box, with a limit; one with a row that is never or always needed."""
    ends = rng.uniform(0.2, 1.0, size)
    regions = (
        simplex(size),
        simplex(size) & box([0.0] * size, [0.5 + 0.5 / size] * size),
        simplex(size) & Polyhedron([(np.arange(size) % 2).astype(float)], [0.6]),
        box(-ends, ends),
        box([0.0] * size, [1.0] * size) & Polyhedron([np.ones(size)], [1.5]),
        # Four rows meet in one vertex of three coordinates, and one row is written twice.
        box([0.0] * size, [1.0] * size) & Polyhedron([np.ones(size), 2.0 * np.ones(size)], [1.0, 2.0]),
    )
    return regions[kind % len(regions)]


def drawn(seed):
    """A random problem, belief and regret: whole and broken costs, beliefs on the simplex's border among them."""
    rng = np.random.default_rng([20270505, seed])
    n_states = 3 if seed % 5 else 2 + 2 * (seed % 2)
    size = int(rng.integers(2, 5))
    costs = rng.normal(size=(n_states, size)) if seed % 2 else rng.integers(-2, 3, (n_states, size)).astype(float)
    problem = LinearProblem(costs, region_of(rng, size, seed))
    belief = rng.dirichlet(np.ones(n_states))
    if seed % 7 == 0:
        belief = np.eye(n_states)[0]
    if seed % 7 == 1:
        belief = np.full(n_states, 1.0 / n_states)
    vertices = tied.vertices_of(problem.constraints) @ costs.T @ belief
    spread = float(vertices.max() - vertices.min())
    limit = float(rng.choice([0.0, 0.02, 0.1, 0.4, 1.0])) * spread
    return problem, belief, limit, rng


def proved(problem, belief, limit, measure=None):
    single = CounterAdversarialDecisionMaker(
        problem, measure, Budget.regret(limit), method=GlobalSearch(certify=0.01)
    ).decide(belief)
    mixed = ProbabilisticDecisionMaker(problem, measure, Budget.regret(limit), certify=0.01).decide(belief)
    return single, mixed


def check(problem, belief, limit, target=None):
    """Bounds are the suprema; decisions are what they say, and near the suprema where anything can be mixed in."""
    measure = None if target is None else DesiredObfuscation(target)
    single, mixed = proved(problem, belief, limit, measure)
    best, lottery = tied.suprema(problem, belief, limit, target)
    assert single.privacy_bound == pytest.approx(best, abs=1e-7)
    assert mixed.privacy_bound == pytest.approx(lottery, abs=1e-7)
    assert single.regret <= limit * (1 + 1e-9) + 1e-12
    assert mixed.expected_regret <= limit * (1 + 1e-9) + 1e-12
    assert problem.constraints.is_admissible(single.action)
    away = consistent_beliefs(problem, single.action).distance(belief if target is None else target)
    assert single.privacy == pytest.approx(away if target is None else -away, abs=1e-9)
    closed = (DecisionStatus.PROVED, DecisionStatus.GAP_REACHED, DecisionStatus.OPTIMAL)
    for value, found in ((single.privacy, single), (mixed.expected_privacy, mixed)):
        gap = found.privacy_bound - value
        assert gap >= 0.0
        if found.status in closed or found.status is DecisionStatus.NO_AFFORDABLE_PRIVACY:
            assert gap <= 0.0101 * max(abs(value), 0.01)
        else:
            assert found.status is DecisionStatus.BOUNDED
    return single, mixed


@pytest.mark.parametrize("block", range(instances(2, least=1)))
def test_bounds_are_the_suprema_over_all_faces(block):
    open_ones = 0
    for seed in range(20 * block, 20 * block + instances(20)):
        problem, belief, limit, _ = drawn(seed)
        single, mixed = check(problem, belief, limit)
        open_ones += (single.status is DecisionStatus.BOUNDED) + (mixed.status is DecisionStatus.BOUNDED)
    assert open_ones <= 4


@pytest.mark.audit
def test_bounds_are_the_suprema_over_all_faces_of_many_problems(capsys):
    open_ones, checked = 0, range(5000, 5520)
    for seed in checked:
        problem, belief, limit, rng = drawn(seed)
        single, mixed = check(problem, belief, limit, rng.dirichlet(np.ones(len(belief))) if seed % 6 == 0 else None)
        open_ones += (single.status is DecisionStatus.BOUNDED) + (mixed.status is DecisionStatus.BOUNDED)
    with capsys.disabled():
        print(f"\n{len(checked)} linear problems: bounds equal to enumeration, {open_ones} gaps above 1 %")
    assert open_ones <= 0.02 * len(checked)


@pytest.mark.parametrize("block", range(instances(2, least=1)))
def test_bounds_of_a_target_are_the_suprema_over_all_faces(block):
    for seed in range(1000 + 6 * block, 1000 + 6 * block + instances(6, least=3)):
        problem, belief, limit, rng = drawn(seed)
        check(problem, belief, limit, rng.dirichlet(np.ones(len(belief))))


@pytest.mark.parametrize("seed", range(instances(6, least=2)))
def test_choices_that_may_be_mixed_have_the_suprema_of_shares(seed):
    rng = np.random.default_rng([20270506, seed])
    costs = rng.integers(0, 6, (3, 5)) if seed % 2 else rng.uniform(0, 5, (3, 5))
    problem, belief = FiniteProblem(costs), rng.dirichlet(np.ones(3))
    limit = 0.3
    best, lottery = tied.suprema(LinearProblem(problem.costs, simplex(5)), belief, limit)
    faces = decoy_grid(problem, 5, faces=True)
    single = CounterAdversarialDecisionMaker(
        problem, budget=Budget.regret(limit), candidates=faces, method=GlobalSearch(certify=0.01)
    ).decide(belief)
    mixed = ProbabilisticDecisionMaker(problem, budget=Budget.regret(limit), candidates=faces, certify=0.01).decide(
        belief
    )
    assert single.privacy_bound == pytest.approx(best, abs=1e-7)
    assert single.privacy == pytest.approx(best, abs=1e-7)
    assert mixed.privacy_bound == pytest.approx(lottery, abs=1e-7)
    assert mixed.status is not DecisionStatus.BOUNDED
    choices, whole = proved(problem, belief, limit)
    assert isinstance(choices.action, int)
    assert choices.privacy_bound == pytest.approx(choices.privacy)
    assert choices.privacy_bound <= best + 1e-9
    assert whole.privacy_bound <= lottery + 1e-9


def test_what_cannot_be_mixed_in_noticeably_leaves_the_bound_open():
    """With next to no budget, a share of the least slack costs too much, though a smaller one would hide."""
    problem = LinearProblem([[0.0, 1.0], [1.0, 0.0]], simplex(2))
    belief = np.array([0.9, 0.1])
    middle = 0.4 * np.sqrt(2)
    single, mixed = proved(problem, belief, 1e-6)
    assert single.privacy == 0.0
    assert single.privacy_bound == pytest.approx(middle)
    assert single.status is mixed.status is DecisionStatus.BOUNDED
    assert "min_slack" in single.status.value
    single, mixed = proved(problem, belief, 1e-3)
    assert single.privacy == pytest.approx(middle)
    assert single.status is DecisionStatus.PROVED
    single, mixed = proved(problem, belief, 0.0)
    assert single.privacy_bound == pytest.approx(0.0, abs=1e-12)
    assert single.status is mixed.status is DecisionStatus.NO_AFFORDABLE_PRIVACY
    # What costs exactly the budget may be played, what lies between it and something dearer may not.
    single, _ = proved(problem, belief, 0.8)
    assert single.privacy_bound >= single.privacy == pytest.approx(middle)
    assert single.privacy_bound == pytest.approx(single.privacy, abs=1e-14)


def test_what_may_be_bought_without_end_at_no_cost_tells_a_corner():
    """In the first state more of the second good is free: who buys a little too much must be sure of that state."""
    region = Polyhedron([[-1.0, 0.0], [0.0, -1.0], [-1.0, -1.0]], [0.0, 0.0, -1.0])
    problem, belief = LinearProblem(np.eye(2), region), np.array([0.6, 0.4])
    single, mixed = proved(problem, belief, 0.1)
    assert single.privacy_bound == pytest.approx(0.4 * np.sqrt(2))
    # The other corner for half of the time costs as much.
    assert mixed.privacy_bound == pytest.approx(0.5 * np.sqrt(2))
    assert single.status is DecisionStatus.PROVED
    assert mixed.status is DecisionStatus.GAP_REACHED
    assert single.action == pytest.approx([0.0, 1.0001], abs=1e-6)


def test_one_state_hides_nothing():
    for found in proved(LinearProblem([[1.0, 2.0]], simplex(2)), np.ones(1), 0.5):
        assert found.privacy_bound == 0.0
        assert found.status is DecisionStatus.NO_AFFORDABLE_PRIVACY


def test_four_states_within_the_limit_of_calls():
    rng = np.random.default_rng(8)
    size = 10 if audited() else 7
    problem = LinearProblem(rng.normal(size=(4, size)), simplex(size) & box([0.0] * size, [0.4] * size))
    for belief in rng.dirichlet(np.ones(4), instances(3, least=1)):
        single, mixed = proved(problem, belief, 0.05)
        assert single.status in (DecisionStatus.PROVED, DecisionStatus.GAP_REACHED)
        assert mixed.privacy_bound <= 1.0101 * mixed.expected_privacy
        assert 0 < single.oracle_calls == mixed.oracle_calls < 2000


def test_riskless_portfolios_have_the_bounds_of_their_linear_costs():
    means = np.random.default_rng(1).normal(size=(3, 4)) / 10
    flat, plain = MarkowitzProblem(means, np.zeros((3, 4, 4)), 1.0), LinearProblem(-means, simplex(4))
    belief = np.array([0.2, 0.5, 0.3])
    for first, second in zip(proved(flat, belief, 0.02), proved(plain, belief, 0.02), strict=True):
        assert first.privacy_bound == pytest.approx(second.privacy_bound, abs=1e-9)
        assert first.status in (DecisionStatus.PROVED, DecisionStatus.GAP_REACHED)


@pytest.mark.parametrize("seed", range(instances(5, least=2)))
def test_mixtures_among_the_candidates_reach_the_suprema_without_a_proof(seed):
    """However coarse the grid of decoys is: vertices that none of them leads to are found."""
    rng = np.random.default_rng([20270507, seed])
    problem = LinearProblem(rng.normal(size=(3, 4)), region_of(rng, 4, seed))
    belief = rng.dirichlet(np.ones(3))
    faces = decoy_grid(problem, 1, faces=True)
    best, lottery = tied.suprema(problem, belief, 0.3)
    budget = Budget.regret(0.3)
    assert CounterAdversarialDecisionMaker(problem, budget=budget, candidates=faces).decide(
        belief
    ).privacy == pytest.approx(best, abs=1e-7)
    mixed = ProbabilisticDecisionMaker(problem, budget=budget, candidates=faces).decide(belief)
    assert mixed.expected_privacy == pytest.approx(lottery, rel=0.01)


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_a_state_in_which_all_decisions_cost_the_same_explains_any(order):
    """Whichever asset comes first: no other belief explains the one that is dearer, or as cheap, in both states."""
    costs, budget = np.array([[0.0, 1.0], [1.0, 1.0]])[:, order], Budget.regret(0.1)
    problem = LinearProblem(costs, simplex(2))
    far = pytest.approx(np.sqrt(0.5))
    assert CounterAdversarialDecisionMaker(problem, budget=budget).decide([0.5, 0.5]).privacy == far
    assert ProbabilisticDecisionMaker(problem, budget=budget).decide([0.5, 0.5]).expected_privacy == far
    assert cheapest_privacy(problem, [0.5, 0.5]).privacy == far


@pytest.mark.parametrize("number", range(instances(24)))
def test_decisions_that_are_optimal_at_the_border_alone_are_candidates(number, fresh_rng):
    """A state may be indifferent, and whole costs tie: the suprema by enumeration are reached without a proof."""
    n_states, size = int(fresh_rng.integers(2, 4)), int(fresh_rng.integers(2, 5))
    costs = fresh_rng.integers(-2, 3, (n_states, size)).astype(float)
    if number % 2:
        costs[fresh_rng.integers(n_states)] = fresh_rng.normal()
    problem, belief = LinearProblem(costs, region_of(fresh_rng, size, number)), fresh_rng.dirichlet(np.ones(n_states))
    limit = float(fresh_rng.uniform(0.05, 0.8))
    best, _ = tied.suprema(problem, belief, limit)
    found = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(limit)).decide(belief)
    assert found.privacy == pytest.approx(best, abs=1e-4)


class ToldShares(OwnShares):
    """The same with its linear form said."""

    def linear_form(self):
        return LinearForm(self.costs, self.constraints)


@pytest.mark.parametrize("seed", range(instances(4, least=1)))
def test_linear_costs_of_a_users_own(seed):
    """Told of, they are proved as exactly; not told of, the bound stands above: at the border more might be tied."""
    rng = np.random.default_rng([20270508, seed])
    costs, belief = rng.uniform(0.0, 1.0, (3, 5)), rng.dirichlet(np.ones(3))
    best, lottery = tied.suprema(LinearProblem(costs, simplex(5)), belief, 0.05)
    for found, value in zip(proved(ToldShares(costs), belief, 0.05), (best, lottery), strict=True):
        assert found.privacy_bound == pytest.approx(value, abs=1e-7)
    for found, value in zip(proved(OwnShares(costs), belief, 0.05), (best, lottery), strict=True):
        assert found.privacy_bound >= value - 1e-9
        assert found.privacy_bound <= np.linalg.norm(np.eye(3) - belief, axis=1).max() + 1e-9


@pytest.mark.parametrize("seed", range(instances(3, least=1)))
def test_bounds_of_costs_with_kinks_are_above_all_decisions_of_a_grid(seed):
    rng = np.random.default_rng([20270509, seed])
    slopes, offsets = rng.normal(size=(3, 4, 3)), rng.normal(size=(3, 4))
    problem, belief = PiecewiseLinearProblem(slopes, offsets, simplex(3)), rng.dirichlet(np.ones(3))
    limit = 0.2
    single, mixed = proved(problem, belief, limit)
    fine, coarse = (20, 12) if audited() else (10, 6)
    actions = np.vstack([simplex_grid(3, fine), problem.solve(simplex_grid(3, coarse))])
    regrets = problem.state_costs(actions) @ belief - float(problem.optimal_cost(belief))
    sets = [consistent_beliefs(problem, action) for action in actions]
    away = [found.distance(belief) for found, regret in zip(sets, regrets, strict=True)
            if not found.is_empty and regret <= limit]  # fmt: skip
    assert single.privacy_bound >= max(away) - 1e-9
    assert mixed.privacy_bound >= single.privacy_bound - 1e-9
    assert single.privacy >= max(away) - 0.05


def test_costs_that_are_said_to_be_linear_and_are_not_are_found_out():
    class Bent(ToldShares):
        def state_costs(self, actions):
            return super().state_costs(actions) + (np.asarray(actions) ** 2).sum(axis=-1, keepdims=True)

        def cost_gradients(self, action):
            return super().cost_gradients(action) + 2.0 * np.asarray(action)[..., None, :]

    costs = np.random.default_rng(1).uniform(size=(3, 4))
    check_decision_problem(ToldShares(costs))
    with pytest.raises(AssertionError, match="linear_form has the slopes"):
        check_decision_problem(Bent(costs))


def test_linear_costs_written_in_cvxpy_are_proved_as_such():
    cp = pytest.importorskip("cvxpy")
    costs, belief = np.random.default_rng(2).normal(size=(3, 4)), np.array([0.2, 0.3, 0.5])
    u = cp.Variable(4)
    problem = ConvexProblem(u, [row @ u for row in costs], [cp.sum(u) == 1, u >= 0])
    best, lottery = tied.suprema(LinearProblem(costs, simplex(4)), belief, 0.1)
    single, mixed = proved(problem, belief, 0.1)
    assert single.privacy_bound == pytest.approx(best, abs=1e-7)
    assert mixed.privacy_bound == pytest.approx(lottery, abs=1e-7)


def test_cells_that_are_too_many_are_left_to_branch_and_bound():
    problem, belief = LinearProblem(np.random.default_rng(6).normal(size=(3, 7)), box([-1.0] * 7, [1.0] * 7)), np.eye(3)
    middle = belief.mean(axis=0)
    exact, _ = proved(problem, middle, 0.3)
    method = GlobalSearch(certify=0.01, max_oracle_calls=20)
    few = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(0.3), method=method).decide(middle)
    assert few.privacy_bound >= exact.privacy_bound - 1e-9
    assert few.status is DecisionStatus.BOUNDED
    choices = FiniteProblem(np.random.default_rng(7).uniform(size=(3, 9)))
    faces = decoy_grid(choices, 2, faces=True)
    left = CounterAdversarialDecisionMaker(choices, budget=Budget.regret(0.1), candidates=faces, method=method)
    best, _ = tied.suprema(LinearProblem(choices.costs, simplex(9)), middle, 0.1)
    assert left.decide(middle).privacy_bound >= best - 1e-9


@pytest.mark.parametrize("belief", [[0.5, 0.5], [0.3, 0.7], [0.8, 0.2]])
def test_a_proven_lottery_over_costs_with_kinks_is_no_less_private_than_the_decision(belief):
    """The decision that the proof comes across is one of the lottery's atoms too."""
    problem = PiecewiseLinearProblem([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 0]]], [[0, 0.1], [0, 0.2]], simplex(3))
    budget = Budget.regret(0.05)
    alone = CounterAdversarialDecisionMaker(problem, budget=budget, method=GlobalSearch(certify=0.01)).decide(belief)
    mixed = ProbabilisticDecisionMaker(problem, budget=budget, certify=0.01).decide(belief)
    assert alone.privacy > 0.1
    assert mixed.expected_privacy >= alone.privacy - 1e-9
    assert mixed.expected_privacy <= mixed.privacy_bound + 1e-9
    assert mixed.probabilities @ mixed.regrets <= 0.05 * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_choices_that_no_candidate_plays_are_found_and_count(seed):
    """Candidates are the choices of single states: against the distances of all that is explained, and a linear programme."""
    rng = np.random.default_rng([20261126, seed])
    costs, belief, found = rng.uniform(size=(3, 12)), rng.dirichlet(np.full(3, 3.0)), {}
    regrets = belief @ costs - (belief @ costs).min()
    limit = 0.3 * float(regrets.max())
    for choice in range(12):
        away = tied.distance_to(np.zeros((0, 3)), (costs[:, [choice]] - costs).T, belief)
        if np.isfinite(away):
            found[choice] = away
    known = list(found)
    answer = linprog(
        -np.array(list(found.values())), A_ub=[regrets[known]], b_ub=[limit], A_eq=np.ones((1, len(known))), b_eq=[1.0]
    )
    problem, few = FiniteProblem(costs), np.eye(12)[np.unique(costs.argmin(axis=1))]
    single = CounterAdversarialDecisionMaker(
        problem, budget=Budget.regret(limit), candidates=few, method=GlobalSearch(certify=0.01)
    ).decide(belief)
    mixed = ProbabilisticDecisionMaker(problem, budget=Budget.regret(limit), candidates=few, certify=0.01).decide(
        belief
    )
    best = max(away for choice, away in found.items() if regrets[choice] <= limit)
    assert single.privacy == pytest.approx(best, abs=1e-7)
    assert single.privacy_bound == pytest.approx(best, abs=1e-7)
    assert mixed.expected_privacy == pytest.approx(-answer.fun, abs=1e-7)
    assert mixed.privacy_bound == pytest.approx(-answer.fun, abs=1e-7)
    assert len(known) > len(few)


def test_a_proven_lottery_tries_the_places_that_the_best_mixture_leaves_out():
    """The decisions of those it mixes are not admissible; a neighbour on the frontier gives .36 of privacy, they .33."""
    rng = np.random.default_rng([424242, 5])
    size, pieces = int(rng.integers(2, 5)), int(rng.integers(2, 5))
    slopes, offsets = rng.normal(size=(4, pieces, size)), rng.normal(size=(4, pieces))
    problem, budget = (
        PiecewiseLinearProblem(slopes, offsets, simplex(size)),
        Budget.regret(float(rng.choice([0.02, 0.1, 0.4]))),
    )
    belief, coarse = rng.dirichlet(np.ones(4)), decoy_grid(problem, 2)
    mixed = ProbabilisticDecisionMaker(problem, budget=budget, candidates=coarse, certify=0.01).decide(belief)
    assert mixed.expected_privacy > 0.36
    assert mixed.expected_regret <= budget.amount * (1 + 1e-9)
    costs = [problem.expected_cost(belief, action) for action in mixed.actions]
    assert mixed.expected_cost == pytest.approx(float(mixed.probabilities @ costs), abs=1e-9)


def test_a_state_of_equal_costs_is_hidden_at_the_least_regret():
    """The first state alone explains a mixture of all assets; the cheapest has each other asset at the least weight."""
    problem = LinearProblem([[-1.0, -1.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 1.0, 2.0]], simplex(3))
    belief, least = np.array([0.2, 0.7, 0.1]), 1e-4 * (1.0 + 1e-4)
    mixed = np.array([least, 1.0 - 2.0 * least, least])
    far = consistent_beliefs(problem, mixed).distance(belief)
    regret = 1.001 * float(problem.regret(belief, mixed))
    assert far == pytest.approx(np.linalg.norm(belief - [1.0, 0.0, 0.0]))
    found = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(regret)).decide(belief)
    assert found.privacy == pytest.approx(far)
    assert privacy_frontier(problem, belief).deterministic(regret) == pytest.approx(far)
