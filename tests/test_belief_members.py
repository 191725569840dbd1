"""Whether sets of many dimensions hold anything: the verdicts against HiGHS, and what many states ask of decision makers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize

from inscrutable import tolerances
from inscrutable.adversaries import consistent_beliefs, consistent_sets
from inscrutable.budgets import Budget
from inscrutable.decision_makers import CounterAdversarialDecisionMaker
from inscrutable.decision_makers.candidate_sources import near_decoys
from inscrutable.geometry import BeliefSet
from inscrutable.geometry.equal_rows import distinct_patterns
from inscrutable.geometry.hulls import members_of_sets
from inscrutable.geometry.polytopes import _always_tight, _apart
from inscrutable.privacy import Infeasibility, MaximalObfuscation, NonUniqueness
from inscrutable.problems import FiniteProblem, MarkowitzProblem
from sizes import instances

SEEDS = st.integers(0, 2**32 - 1)
HELD, EMPTY = 1, -1


def conflict(equalities, inequalities):
    """Least residual of the rows over the simplex, from HiGHS."""
    n_states = equalities.shape[1]
    rows = np.vstack([equalities, -equalities, -inequalities])
    answer = linprog(
        np.append(np.zeros(n_states), 1.0),
        np.column_stack([rows, -np.ones(len(rows))]),
        np.zeros(len(rows)),
        np.append(np.ones(n_states), 0.0)[None],
        [1.0],
        bounds=(0, None),
    )
    return answer.fun


def explained(problem, action):
    """Whether a belief and multipliers meet the optimality conditions of a decision, from HiGHS."""
    region = problem.constraints
    tight = region.slacks(action) <= max(region.min_slack, tolerances.FEASIBILITY)
    gradients = problem.cost_gradients(action).T
    scale = np.abs(gradients).max()
    n_states, n_rows, n_equal = problem.n_states, int(tight.sum()), len(region.A_eq)
    conditions = np.hstack([gradients / scale, region.A_ub[tight].T, region.A_eq.T])
    total = np.concatenate([np.ones(n_states), np.zeros(n_rows + n_equal)])
    bounds = [(0, None)] * (n_states + n_rows) + [(None, None)] * n_equal
    answer = linprog(
        np.zeros(len(total)),
        A_eq=np.vstack([conditions, total]),
        b_eq=np.append(np.zeros(len(conditions)), 1.0),
        bounds=bounds,
        options={"primal_feasibility_tolerance": 1e-10},
    )
    return answer.status == 0


def market(seed, n_states=10, n_assets=4):
    rng = np.random.default_rng(seed)
    loads = rng.normal(size=(n_states, n_assets, n_assets))
    covariances = loads @ loads.transpose(0, 2, 1) / 20 + 0.02 * np.eye(n_assets)
    return MarkowitzProblem(rng.normal(size=(n_states, n_assets)) * 0.1, covariances, 2.0), rng.dirichlet(
        np.ones(n_states)
    )


@given(SEEDS, st.integers(3, 10), st.integers(0, 6), st.integers(0, 20))
@settings(max_examples=instances(150), deadline=None)
def test_verdicts_are_those_of_linear_programmes(seed, n_states, n_equal, n_rows):
    rng = np.random.default_rng(seed)
    equalities = rng.normal(size=(4, min(n_equal, n_states - 3), n_states))
    inequalities = rng.normal(size=(4, n_rows, n_states)) + rng.uniform(0.0, 1.0)
    verdict, members = members_of_sets(equalities, inequalities, tolerances.EXPLAINED)
    for i in range(4):
        least = conflict(equalities[i], inequalities[i])
        if verdict[i] == HELD:
            assert least <= 1e-9
            assert members[i].min() >= 0.0
            assert members[i].sum() == pytest.approx(1.0, abs=1e-12)
            assert np.abs(equalities[i] @ members[i]).max(initial=0.0) <= 1e-9
            assert (inequalities[i] @ members[i]).min(initial=0.0) >= -1e-9
            assert not BeliefSet(equalities[i], inequalities[i]).is_empty
        elif verdict[i] == EMPTY:
            assert least > 1e-10
            assert BeliefSet(equalities[i], inequalities[i]).is_empty
        else:  # all that is left are sets about as thin as what rows may conflict by
            assert least <= 1e-5


def test_a_set_that_only_touches_is_left_to_linear_programmes():
    rows = np.vstack([np.eye(5)[0] - 1e-12 - np.ones(5) * (1.0 - 1e-12), np.eye(5)[1:]])
    verdict, _ = members_of_sets(np.zeros((1, 0, 5)), rows[None], tolerances.EXPLAINED)
    assert verdict[0] == 0
    found = BeliefSet(np.zeros((0, 5)), rows)
    assert found.dimension == 0
    np.testing.assert_allclose(found.vertices(), [np.eye(5)[0]], atol=1e-9)


@pytest.mark.parametrize("width", [1.0, 1e-4])
def test_sets_with_an_interior_need_no_linear_programme(width):
    rows = np.array([[[width - 1.0, width, width, width]]])  # π_1 of at most `width`
    verdict, members = members_of_sets(np.zeros((1, 0, 4)), rows, tolerances.EXPLAINED)
    assert verdict[0] == HELD
    assert 0.0 < members[0, 0] < width


def test_sets_of_two_dimensions_less_are_not_judged():
    verdict, _ = members_of_sets(np.eye(3)[None, :2] - 1.0 / 3.0, np.zeros((1, 0, 3)), tolerances.EXPLAINED)
    assert verdict[0] == 0


def test_rows_that_nothing_can_meet_are_seen_at_once():
    verdict, _ = members_of_sets(np.zeros((1, 0, 6)), -np.ones((1, 1, 6)), tolerances.EXPLAINED)
    assert verdict[0] == EMPTY


@pytest.mark.parametrize("seed", range(instances(3, least=1)))
def test_decisions_of_ten_states_are_explained_where_linear_programmes_say_so(seed):
    problem, _ = market(seed)
    candidates = near_decoys(problem)
    sets = consistent_sets(problem, candidates.actions[candidates.usable])
    chosen = np.random.default_rng(seed).choice(len(sets), 60, replace=False)
    found = [explained(problem, sets.actions[i]) for i in chosen]
    np.testing.assert_array_equal(sets.dimension[chosen] >= 0, found)
    assert np.sum(found) > 0
    for i in chosen[np.array(found)][:10]:
        assert consistent_beliefs(problem, sets.actions[i]).violation(sets.start[i]) <= 1e-9


@pytest.mark.parametrize("seed", range(instances(2, least=1)))
def test_no_cheaper_candidate_of_ten_states_is_infeasible(seed):
    problem, belief = market(seed, n_assets=5)
    decider = CounterAdversarialDecisionMaker(problem, Infeasibility(margin=0.0), Budget.regret(0.05))
    decision = decider.decide(belief)
    assert decision.privacy == 0.0
    assert not explained(problem, decision.action)
    regrets = problem.state_costs(decider.candidates.actions) @ belief - problem.optimal_cost(belief)
    cheaper = np.flatnonzero(decider.candidates.usable & (regrets < decision.regret - 1e-9))
    assert all(explained(problem, decider.candidates.actions[i]) for i in cheaper[:80])


def test_the_best_of_many_choices_in_ten_states_is_that_of_enumeration():
    rng = np.random.default_rng(3)
    problem, belief = FiniteProblem(rng.normal(size=(10, 9))), rng.dirichlet(np.ones(10))
    regrets = belief @ problem.costs - (belief @ problem.costs).min()
    limit = float(np.sort(regrets)[5]) + 1e-9
    away = []
    for k in np.flatnonzero(regrets <= limit):
        rows = (problem.costs - problem.costs[:, [k]]).T
        start = linprog(np.zeros(10), -rows, np.zeros(9), np.ones((1, 10)), [1.0])
        if start.status != 0:
            continue
        nearest = minimize(
            lambda z: ((z - belief) ** 2).sum(), start.x, jac=lambda z: 2 * (z - belief), method="SLSQP",
            bounds=[(0, 1)] * 10, options={"ftol": 1e-14, "maxiter": 500},
            constraints=[{"type": "ineq", "fun": lambda z, rows=rows: rows @ z, "jac": lambda _, rows=rows: rows},
                         {"type": "eq", "fun": lambda z: z.sum() - 1.0, "jac": lambda _: np.ones(10)}],
        )  # fmt: skip
        away.append(np.sqrt(nearest.fun))
    decision = CounterAdversarialDecisionMaker(problem, MaximalObfuscation(), Budget.regret(limit)).decide(belief)
    assert decision.privacy == pytest.approx(max(away), abs=1e-5)


def test_a_set_with_an_interior_holds_another_belief_than_its_middle():
    whole = BeliefSet(np.zeros((0, 9)), np.zeros((0, 9)))
    assert NonUniqueness()(np.full(9, 1 / 9), whole) == 0.0
    assert "vertices" not in vars(whole._shape)


def test_corners_found_when_asked_for_are_those_of_the_simplex():
    whole = BeliefSet(np.zeros((0, 6)), np.zeros((0, 6)))
    assert whole.distance(np.eye(6)[0]) == 0.0
    found = whole.vertices()
    np.testing.assert_allclose(found[np.lexsort(found.T)], np.eye(6)[np.lexsort(np.eye(6).T)], atol=1e-12)


@given(SEEDS, st.integers(2, 5), st.integers(0, 2))
@settings(max_examples=instances(60), deadline=None)
def test_rows_that_are_tight_everywhere_are_those_that_no_point_leaves(seed, size, n_flat):
    rng = np.random.default_rng(seed)
    rows = np.vstack([np.eye(size), -np.eye(size), rng.normal(size=(3, size))])
    inside = rng.uniform(-0.5, 0.5, size=size)
    offsets = np.concatenate([np.ones(2 * size), rows[2 * size :] @ inside + rng.uniform(0.05, 0.5, size=3)])
    for _ in range(n_flat):
        normal = rng.normal(size=size)
        rows = np.vstack([rows, normal, -normal])
        offsets = np.concatenate([offsets, [normal @ inside, -(normal @ inside)]])
    moves = [b - linprog(a, rows, offsets, bounds=(None, None)).fun for a, b in zip(rows, offsets, strict=True)]
    np.testing.assert_array_equal(_always_tight(rows, offsets), np.array(moves) <= 1e-6)


@given(SEEDS, st.integers(1, 40))
@settings(max_examples=60, deadline=None)
def test_points_are_kept_where_no_earlier_one_is_the_same(seed, count):
    rng = np.random.default_rng(seed)
    points = rng.integers(0, 3, size=(count, 2)) + rng.uniform(-2e-11, 2e-11, size=(count, 2))
    kept = []
    for point in points:
        if all(np.abs(point - other).max() > tolerances.SAME_BELIEF for other in kept):
            kept.append(point)
    np.testing.assert_array_equal(_apart(points), kept)


@given(SEEDS, st.integers(1, 60), st.integers(0, 19))
@settings(max_examples=60, deadline=None)
def test_distinct_patterns_are_those_of_a_sort_in_any_memory_order(seed, count, width):
    patterns = np.random.default_rng(seed).random((count, width)) < 0.3
    for held in (patterns, np.asfortranarray(patterns)):
        found, which = distinct_patterns(held)
        np.testing.assert_array_equal(found[which], patterns)
        np.testing.assert_array_equal(found, np.unique(patterns, axis=0) if width else patterns[:1])
