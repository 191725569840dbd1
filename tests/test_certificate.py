"""Proven bounds against what is known otherwise: SCIP, enumeration, closed forms, finer grids."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pytest

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionProblem,
    DecisionStatus,
    DesiredObfuscation,
    GlobalSearch,
    InputError,
    MarkowitzProblem,
    MaximalObfuscation,
    NonExistence,
    Polyhedron,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    consistent_beliefs,
    decoy_grid,
    max_weights,
    min_weights,
    simplex,
    simplex_grid,
)
from inscrutable.decision_makers.proofs.cell_programmes import bounds_by, cell_weights
from inscrutable.decision_makers.proofs.certificate import Prover, Question
from inscrutable.decision_makers.proofs.oracle_points import OraclePoints
from inscrutable.geometry.simplicial import cones_from, directions_to, halved
from inscrutable.privacy.measures import Reference
from oracles import enumeration, markets, optimum
from oracles.horse_race import farthest_stake
from sizes import audited, instances, some
from strategies import OwnShares

PROVEN = (DecisionStatus.PROVED, DecisionStatus.GAP_REACHED)


def drawn(seed, n_states=None):
    """A random market, belief and budget: corners and faces of the simplex, tiny and huge budgets among them."""
    rng = np.random.default_rng([20270301, seed])
    states = int(rng.choice([2, 3, 3])) if n_states is None else n_states
    market = markets.random_market(
        rng, states, int(rng.choice([2, 3, 4, 5])), positive_value=bool(seed % 2), scale_spread=float(seed % 3 == 0)
    )
    belief = np.eye(states)[0] if seed % 7 == 0 else rng.dirichlet(np.full(states, 0.4 if seed % 3 == 0 else 2.0))
    share = float(rng.choice([0.003, 0.03, 0.1, 0.3, 1.0]))
    return market, belief, share * abs(enumeration.value(market, belief)[0])


def proved(problem, budget, belief, measure=None, certify=0.01, calls=1500):
    method = GlobalSearch(certify=certify, max_oracle_calls=calls)
    return CounterAdversarialDecisionMaker(problem, measure, Budget.regret(budget), method=method).decide(belief)


def best_on_a_grid(problem, belief, budget, resolution=60):
    """The largest distance of an affordable decision's set among decoys of a grid."""
    actions = problem.solve(simplex_grid(belief.size, resolution))
    affordable = actions[problem.regret(belief, actions) <= budget]
    return max((consistent_beliefs(problem, action).distance(belief) for action in affordable), default=0.0)


class Horses(DecisionProblem):
    """Stakes on X horses, −log of the stake on the winner: u*(π) = π and the regret is the divergence."""

    def __init__(self, n_states):
        self._n_states = n_states
        self.constraints = simplex(n_states)

    @property
    def n_states(self):
        return self._n_states

    @cached_property
    def costs_are_unique(self):
        return True

    def solve(self, beliefs):
        return np.asarray(beliefs, dtype=float)

    def state_costs(self, actions):
        return -np.log(np.maximum(actions, 1e-300))

    def cost_gradients(self, action):
        raise NotImplementedError


@pytest.mark.parametrize("seed", range(12) if audited() else (0, 2))
def test_the_bound_is_above_what_scip_finds(seed):
    pytest.importorskip("pyscipopt", reason="SCIP comes with the [global] extra")
    market, belief, budget = drawn(seed)
    decision = proved(MarkowitzProblem(*market), budget, belief)
    # Nearly every decision is admissible: the supremum itself, not the best that is worth trading.
    best, _, _ = optimum.global_cdm(market, belief, budget, 1e-7)
    assert decision.privacy_bound >= best - 1e-9
    assert decision.privacy_bound >= decision.privacy
    if decision.status is DecisionStatus.GAP_REACHED:
        assert decision.privacy_bound <= decision.privacy + 0.0101 * max(decision.privacy, 0.01)


@pytest.mark.audit
def test_the_bound_is_above_what_scip_finds_on_many_markets(capsys):
    pytest.importorskip("pyscipopt", reason="SCIP comes with the [global] extra")
    gaps, violations = [], []
    for seed in range(1000, 1520):
        market, belief, budget = drawn(seed)
        decision = proved(MarkowitzProblem(*market), budget, belief)
        best, _, _ = optimum.global_cdm(market, belief, budget, 1e-7)
        gaps.append(decision.privacy_bound / max(decision.privacy, 1e-2) - 1.0)
        if decision.privacy_bound < best - 1e-9:
            violations.append((seed, best, decision.privacy_bound))
    with capsys.disabled():
        print(f"\n{len(gaps)} bounds against SCIP: median gap {np.median(gaps):.4f}, violations {violations}")
    assert not violations


@pytest.mark.parametrize("seed", range(instances(12, least=3)))
def test_the_bound_of_a_target_is_above_a_grid(seed):
    market, belief, budget = drawn(seed, 3)
    problem = MarkowitzProblem(*market)
    target = np.random.default_rng(seed).dirichlet(np.ones(3))
    decision = proved(problem, budget, belief, DesiredObfuscation(target))
    decoys = simplex_grid(3, 150)
    actions = problem.solve(decoys)
    affordable = problem.state_costs(actions) @ belief - problem.optimal_cost(belief) <= budget
    nearest = np.linalg.norm(decoys[affordable] - target, axis=1).min(initial=np.inf)
    assert decision.privacy_bound >= -nearest - 1e-12
    assert decision.privacy <= decision.privacy_bound <= 0.0


@pytest.mark.parametrize("n_states", some([2, 3, 4], 2))
def test_a_horse_race_is_a_closed_form(n_states):
    """Among two horses the most private affordable stake solves a scalar equation; for more, rays are searched."""
    rng = np.random.default_rng(n_states)
    belief = rng.dirichlet(np.full(n_states, 3.0))
    budget = 0.05
    prover = Prover(Horses(n_states), belief, 20_000)
    best = farthest_stake(belief, budget, rng)
    # In three dimensions the best of many directions is a little below the best of all.
    floor = (1.03 if n_states > 3 else 1.01) * best
    answer = prover.answer(Question(Reference(belief, 1.0), budget, None, floor))
    assert best * (1 - 1e-9) <= answer.bound <= floor + 1e-12
    assert answer.complete


@pytest.mark.parametrize("seed", range(instances(8, least=3)))
def test_finite_choices_and_their_mixtures_are_below_the_bound(seed):
    rng = np.random.default_rng(seed)
    n_states = 2 + seed % 2
    costs = rng.uniform(0.0, 1.0, (n_states, 6))
    belief = rng.dirichlet(np.ones(n_states))
    problem = OwnShares(costs)
    own = float(problem.optimal_cost(belief))
    for share in (0.05, 0.5):
        prover = Prover(problem, belief, 3000)
        answer = prover.answer(Question(Reference(belief, 1.0), share * own, None, 0.0))
        decoys = simplex_grid(n_states, 120)
        expected = decoys @ costs
        # Distance to the beliefs that play a choice, over a grid: a little above the true one.
        for choice in np.unique(expected.argmin(axis=1)):
            if belief @ costs[:, choice] - own <= share * own:
                members = expected[:, choice] <= expected.min(axis=1) + 1e-12
                away = np.linalg.norm(decoys[members] - belief, axis=1).min()
                assert answer.bound >= away - 0.02


def test_behind_a_closed_cell_there_is_more():
    """One asset is best for a range of beliefs; what lies behind that range is affordable and farther."""
    means = [[0.10, 0.02], [-0.20, 0.05]]
    problem = MarkowitzProblem(means, [np.eye(2) * 0.01, np.eye(2) * 0.02], 1.0)
    for belief in ([0.9, 0.1], [0.3, 0.7], [0.05, 0.95]):
        for budget in (0.002, 0.02, 0.05, 0.2):
            decision = proved(problem, budget, np.array(belief))
            assert decision.privacy_bound >= best_on_a_grid(problem, np.array(belief), budget, 150) - 1e-9
            assert decision.status in (*PROVEN, DecisionStatus.NO_AFFORDABLE_PRIVACY)


@pytest.mark.parametrize("n_states", [2, 3, 4, 5])
def test_where_everything_is_affordable_the_farthest_corner_bounds(n_states):
    rng = np.random.default_rng(n_states)
    market = markets.random_market(rng, n_states, 6)
    belief = rng.dirichlet(np.ones(n_states))
    decision = proved(MarkowitzProblem(*market), 1e6, belief)
    farthest = np.linalg.norm(np.eye(n_states) - belief, axis=1).max()
    assert decision.privacy <= decision.privacy_bound <= farthest + 1e-9
    answer = Prover(Horses(n_states), belief, 1000).answer(Question(Reference(belief, 1.0), 1e4, None, 0.0))
    assert answer.bound == pytest.approx(farthest)


def test_without_a_budget_nothing_is_affordable():
    rng = np.random.default_rng(4)
    market, belief = markets.random_market(rng, 3, 6), markets.random_belief(rng, 3)
    decision = proved(MarkowitzProblem(*market), 0.0, belief)
    assert decision.status is DecisionStatus.NO_AFFORDABLE_PRIVACY
    assert 0.0 <= decision.privacy_bound <= 2e-4
    mixed = ProbabilisticDecisionMaker(MarkowitzProblem(*market), None, Budget.regret(0.0), certify=0.01).decide(belief)
    assert 0.0 <= mixed.privacy_bound <= 2e-4


def test_a_single_asset_shows_nothing():
    problem = MarkowitzProblem([[0.1], [0.2]], [[[0.1]], [[0.2]]], 1.0)
    decision = proved(problem, 1.0, np.array([0.3, 0.7]))
    assert decision.privacy == decision.privacy_bound == 0.0


def test_copied_assets_have_the_costs_of_one():
    rng = np.random.default_rng(5)
    market = markets.random_market(rng, 3, 4, duplicate=True)
    problem = MarkowitzProblem(*market)
    assert problem.costs_are_unique
    belief = markets.random_belief(rng, 3)
    budget = 0.1 * abs(float(problem.optimal_cost(belief)))
    single = markets.Market(market.means[:, :3], market.covariances[:, :3, :3], market.risk_aversion)
    bounds = [proved(MarkowitzProblem(*each), budget, belief).privacy_bound for each in (market, single)]
    best = best_on_a_grid(MarkowitzProblem(*single), belief, budget, 40)
    assert min(bounds) >= best - 1e-9
    assert bounds[0] == pytest.approx(bounds[1], rel=0.03)


def test_flat_costs_are_not_taken_for_unique():
    flat = MarkowitzProblem([[0.1, 0.2], [0.2, 0.1]], np.zeros((2, 2, 2)), 1.0)
    assert not flat.costs_are_unique
    # Riskless in one state only: ties may be broken at that corner, by costs that differ in the other state.
    half = MarkowitzProblem([[0.1, 0.1], [0.2, 0.1]], [np.zeros((2, 2)), np.eye(2)], 1.0)
    assert not half.costs_are_unique
    assert MarkowitzProblem([[0.1, 0.1], [0.2, 0.1]], [0.1 * np.eye(2), np.eye(2)], 1.0).costs_are_unique


@pytest.mark.parametrize("seed", range(instances(4, least=1)))
@pytest.mark.parametrize("targeted", [False, True])
def test_lotteries_stay_below_their_bound_on_a_finer_grid(seed, targeted):
    market, belief, budget = drawn(seed + 50, 3)
    problem = MarkowitzProblem(*market)
    measure = DesiredObfuscation([0.2, 0.3, 0.5]) if targeted else MaximalObfuscation()
    mixed = ProbabilisticDecisionMaker(problem, measure, Budget.regret(budget), certify=0.01).decide(belief)
    finer = decoy_grid(problem, 200)
    other = ProbabilisticDecisionMaker(problem, measure, Budget.regret(budget), candidates=finer).decide(belief)
    assert mixed.privacy_bound >= max(mixed.expected_privacy, other.expected_privacy) - 1e-9
    assert mixed.expected_regret <= budget * (1 + 1e-9)
    assert mixed.expected_privacy == pytest.approx(float(mixed.probabilities @ mixed.privacies))
    single = proved(problem, budget, belief, measure)
    assert mixed.privacy_bound >= single.privacy


def test_gaps_are_small_where_several_assets_are_held():
    gaps = {3: [], 4: []}
    for n_states, found in gaps.items():
        for seed in range(instances(7, least=3)):
            rng = np.random.default_rng([7, n_states, seed])
            market = markets.random_market(rng, n_states, 6)
            belief = markets.random_belief(rng, n_states)
            problem = MarkowitzProblem(*market)
            decision = proved(problem, 0.1 * abs(float(problem.optimal_cost(belief))), belief, calls=3000)
            found.append(decision.privacy_bound / max(decision.privacy, 0.01) - 1.0)
    assert np.median(gaps[3]) <= 0.0101
    assert np.median(gaps[4]) <= 0.0201


def test_five_states_within_the_limit():
    rng = np.random.default_rng(2)
    market = markets.random_market(rng, 5, 7)
    belief = markets.random_belief(rng, 5)
    problem = MarkowitzProblem(*market)
    budget = 0.1 * abs(float(problem.optimal_cost(belief)))
    decision = proved(problem, budget, belief, calls=800)
    assert decision.privacy <= decision.privacy_bound < np.linalg.norm(np.eye(5) - belief, axis=1).max() + 1e-12
    assert decision.oracle_calls > 0


def test_the_limit_of_calls_is_said():
    market, belief, budget = drawn(1, 3)
    decision = proved(MarkowitzProblem(*market), 0.01 * budget, belief, certify=0.001, calls=20)
    assert decision.status is DecisionStatus.BOUNDED
    assert decision.privacy_bound >= decision.privacy


def test_many_beliefs_are_proved_one_by_one():
    market, _, budget = drawn(2, 3)
    problem = MarkowitzProblem(*market)
    beliefs = np.array([[0.2, 0.3, 0.5], [0.6, 0.3, 0.1]])
    method = GlobalSearch(certify=0.01)
    maker = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(budget), method=method)
    lotteries = ProbabilisticDecisionMaker(problem, None, Budget.regret(budget), certify=0.01)
    for many, one in ((maker.decide_many(beliefs), maker.decide), (lotteries.decide_many(beliefs), lotteries.decide)):
        singles = [one(belief) for belief in beliefs]
        assert many.privacy_bound == pytest.approx([each.privacy_bound for each in singles])
        assert list(many.status) == [each.status for each in singles]
        assert many.oracle_calls.tolist() == [each.oracle_calls for each in singles]
        assert [many[step].oracle_calls for step in range(2)] == [each.oracle_calls for each in singles]
        assert min(many.oracle_calls) > 0


def test_a_solver_that_is_not_exact_loosens_the_bound():
    """The oracle answers with decisions for slightly wrong beliefs: its costs are too high, differently everywhere."""

    class Careless(Horses):
        def state_costs(self, actions):
            return -np.log(np.maximum(actions, 1e-3))

        def solve(self, beliefs):
            held = np.atleast_2d(beliefs)
            wrong = held + 0.1 * np.abs(np.sin(1000 * held))
            return (wrong / wrong.sum(axis=1, keepdims=True)).reshape(np.shape(beliefs))

    belief = np.array([0.2, 0.3, 0.5])
    points = OraclePoints(Careless(3), belief, np.eye(3))
    points.add(simplex_grid(3, 12))
    points.upper_costs(np.arange(4, 94)[None])
    assert points.allowance > Careless.cost_accuracy * points.scale


def test_what_cannot_be_proved_is_refused():
    market, _, _ = drawn(1, 3)
    problem = MarkowitzProblem(*market)
    for gap in (-0.1, 0.0, 1.0, float("nan"), "x"):
        with pytest.raises(InputError):
            GlobalSearch(certify=gap)
        with pytest.raises(InputError):
            ProbabilisticDecisionMaker(problem, certify=gap)
    with pytest.raises(InputError, match="max_oracle_calls"):
        GlobalSearch(certify=0.01, max_oracle_calls=0)
    with pytest.raises(InputError, match="certify proves"):
        CounterAdversarialDecisionMaker(problem, NonExistence(), method=GlobalSearch(certify=0.01))
    with pytest.raises(InputError, match="exclude"):
        ProbabilisticDecisionMaker(problem, on_empty="infinite", certify=0.01)


@pytest.mark.parametrize("seed", range(20))
def test_tiny_programmes_equal_highs(seed):
    from scipy.optimize import linprog

    rng = np.random.default_rng(seed)
    n_corners, n_columns = int(rng.integers(2, 6)), int(rng.integers(1, 12))
    gains = rng.uniform(0, 1, (6, n_corners))
    regrets = rng.normal(0.0, 1.0, (6, n_corners, n_columns))
    budget, multiplier = float(rng.uniform(-0.2, 0.8)), float(rng.uniform(0.0, 2.0))
    under = bounds_by(cell_weights(gains, regrets, budget, None), gains, regrets, budget)
    priced = bounds_by(cell_weights(gains, regrets, budget, multiplier), gains, regrets, 0.0)
    for cell in range(6):
        rows, total = regrets[cell].T, [np.ones(n_corners)]
        answer = linprog(-gains[cell], A_ub=rows, b_ub=np.full(n_columns, budget), A_eq=total, b_eq=[1.0])
        if answer.status == 2:
            assert under[cell] < 0.0
        else:
            assert under[cell] == pytest.approx(-answer.fun, abs=1e-7)
        wide = np.column_stack([rows, -np.ones(n_columns)])
        answer = linprog(
            np.append(-gains[cell], multiplier),
            A_ub=wide,
            b_ub=np.zeros(n_columns),
            A_eq=[[*np.ones(n_corners), 0.0]],
            b_eq=[1.0],
            bounds=(0, None),
        )
        assert priced[cell] == pytest.approx(-answer.fun, abs=1e-7)


def test_cones_cover_the_simplex_and_halves_their_whole():
    belief = np.array([0.2, 0.3, 0.5])
    cones = cones_from(belief)
    volumes = np.abs(np.linalg.det(cones.points[cones.corners]))
    assert volumes.sum() == pytest.approx(1.0)
    assert len(cones_from(np.eye(3)[1]).corners) == 1
    halves = halved(cones.corners, np.array([[0, 1], [1, 2], [0, 2]]), np.array([4, 5, 6]))
    assert len(halves) == 6
    assert halves[0].tolist() == [4, *cones.corners[0, 1:]]


def test_directions_separate():
    cell = np.eye(3)[None]
    assert directions_to(np.ones(3) / 3, cell) == pytest.approx(np.zeros((1, 3)), abs=1e-6)
    outside = np.array([0.5, 0.5, 0.0])
    part = np.array([[[0.0, 0.0, 1.0], [0.1, 0.0, 0.9], [0.0, 0.1, 0.9]]])
    direction = directions_to(outside, part)[0]
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    assert ((part[0] - outside) @ direction).min() == pytest.approx(np.linalg.norm([0.45, 0.45, 0.9]), abs=1e-6)


@pytest.mark.parametrize("measure", [MaximalObfuscation(), DesiredObfuscation([1.0])])
def test_one_state_of_a_portfolio_hides_nothing_and_proves_it(measure):
    problem = MarkowitzProblem([[0.1, 0.2]], [np.eye(2)], 1.0)
    alone = CounterAdversarialDecisionMaker(problem, measure, method=GlobalSearch(certify=0.01)).decide([1.0])
    mixed = ProbabilisticDecisionMaker(problem, measure, certify=0.01).decide([1.0])
    assert (alone.privacy, alone.privacy_bound, mixed.expected_privacy, mixed.privacy_bound) == (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("means", "cap"),
    [([[0.1, 0.05], [0.2, 0.15]], 1.0), ([[0.5, 0.1], [0.4, 0.05]], 1.0), ([[0.3, 0.2], [0.4, 0.25]], 0.5)],
)
def test_one_decision_for_all_beliefs_hides_nothing_and_proves_it(means, cap):
    """Its costs do not tell it from others: there are none. Means differ by a constant, or a corner or caps decide."""
    problem = MarkowitzProblem(means, [np.diag([0.04, 0.09])] * 2, 1.0, constraints=simplex(2) & max_weights(2, cap))
    for belief in ([0.5, 0.5], [1.0, 0.0]):
        alone = CounterAdversarialDecisionMaker(problem, method=GlobalSearch(certify=0.01)).decide(belief)
        mixed = ProbabilisticDecisionMaker(problem, certify=0.01).decide(belief)
        assert (alone.privacy, alone.privacy_bound, mixed.privacy_bound) == (0.0, 0.0, 0.0)
        assert alone.oracle_calls < 10


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("fixed", [0.0, 0.2])
def test_a_weight_fixed_by_its_bounds_is_proved_as_without_it(fixed, seed):
    rng = np.random.default_rng(seed)
    means, factors = rng.normal(0.0, 0.05, (3, 3)), rng.normal(0.0, 0.2, (3, 3, 4))
    hessians, belief = 2.0 * (factors @ factors.swapaxes(1, 2) + 0.01 * np.eye(3)), rng.dirichlet(np.ones(3))
    region = simplex(3) & min_weights(3, [fixed, 0, 0]) & max_weights(3, [fixed, 1, 1])
    others = Polyhedron(-np.eye(2), np.zeros(2), [[1, 1]], [1 - fixed])
    held, slopes = hessians[:, 0, 0] * fixed**2 / 2 - means[:, 0] * fixed, hessians[:, 1:, 0] * fixed - means[:, 1:]
    problems = [
        QuadraticProblem(hessians, -means, constraints=region),
        QuadraticProblem(hessians[:, 1:, 1:], slopes, held, constraints=others),
    ]
    whole, part = (proved(problem, 0.01, belief) for problem in problems)
    assert whole.status in PROVEN
    assert (whole.privacy, whole.privacy_bound) == pytest.approx((part.privacy, part.privacy_bound), abs=1e-3)
    assert whole.oracle_calls <= 1.2 * part.oracle_calls
