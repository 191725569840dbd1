"""Decisions of linear costs that no belief explains, against programmes over all vertices and over all beliefs."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import linprog

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    FiniteProblem,
    Infeasibility,
    LinearProblem,
    Polyhedron,
    ProbabilisticDecisionMaker,
    box,
    consistent_beliefs,
    plausibility_gap,
    simplex,
)
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from sizes import instances
from strategies import SEEDS

EXACT = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}


def drawn(seed):
    """A linear problem over a capped simplex or a box with a net limit, a belief and all vertices."""
    rng = np.random.default_rng([seed, 40])
    n_states, size = int(rng.integers(2, 4)), int(rng.integers(3, 5))
    region = (
        simplex(size),
        simplex(size) & box([0.0] * size, [0.6] * size),
        box([-1.0] * size, [1.0] * size) & Polyhedron([np.ones(size)], [0.5]),
    )[int(rng.integers(3))]
    return LinearProblem(rng.normal(size=(n_states, size)), region), rng.dirichlet(np.ones(n_states)), rng


def vertices_of(region):
    """All vertices, by trying every set of rows."""
    found = []
    for rows in combinations(range(len(region.b_ub)), region.n_actions - len(region.b_eq)):
        matrix = np.vstack([region.A_eq, region.A_ub[list(rows)]])
        if np.linalg.matrix_rank(matrix) == region.n_actions:
            point = np.linalg.solve(matrix, np.concatenate([region.b_eq, region.b_ub[list(rows)]]))
            if (region.A_ub @ point <= region.b_ub + 1e-9).all():
                found.append(point)
    return np.array(found)


def least_regret(costs, corners, action):
    """min over beliefs of max over vertices of π·(s(u) − s(v)), by HiGHS."""
    n_states = len(costs)
    planes = (action - corners) @ costs.T
    answer = linprog(
        np.append(np.zeros(n_states), 1.0),
        np.column_stack([planes, -np.ones(len(planes))]),
        np.zeros(len(planes)),
        np.append(np.ones(n_states), 0.0)[None],
        [1.0],
        bounds=[(0, None)] * n_states + [(None, None)],
        options=EXACT,
    )
    return answer.fun


def some_belief_explains(costs, corners, action):
    """Whether a belief exists for which no vertex is cheaper than the action, by HiGHS."""
    planes = (action - corners) @ costs.T
    n_states = len(costs)
    whole = np.ones((1, n_states))
    answer = linprog(np.zeros(n_states), planes, np.full(len(planes), 1e-9), whole, [1.0], options=EXACT)
    return answer.status == 0


def cheapest(problem, belief, margin):
    """The least cost of u where some mixture w of vertices costs less by the margin in every state, by HiGHS."""
    corners, costs = vertices_of(problem.constraints), problem.costs
    count = len(corners)
    # u is a mixture of vertices too.
    state_costs = corners @ costs.T
    rows = np.column_stack([-state_costs.T, state_costs.T])
    whole = np.kron(np.eye(2), np.ones(count))
    answer = linprog(
        np.append(state_costs @ belief, np.zeros(count)),
        rows,
        np.full(len(costs), -margin),
        whole,
        [1.0, 1.0],
        options=EXACT,
    )
    return answer.fun if answer.status == 0 else np.inf


def some_actions(corners, rng):
    """Vertices, points of edges and faces, and the inside."""
    pairs = rng.integers(len(corners), size=(6, 2))
    mixed = rng.dirichlet(np.ones(len(corners)), 4) @ corners
    return np.vstack([corners[:5], corners[pairs].mean(axis=1), mixed])


@settings(max_examples=instances(20), deadline=None)
@given(SEEDS)
def test_the_least_regret_is_that_over_all_vertices(seed):
    problem, belief, rng = drawn(seed)
    corners = vertices_of(problem.constraints)
    for action in some_actions(corners, rng):
        wanted = least_regret(problem.costs, corners, action)
        assert plausibility_gap(problem, action) == pytest.approx(max(wanted, 0.0), abs=1e-7)
        found = consistent_beliefs(problem, action)
        if wanted > 1e-6 or wanted < 1e-11:
            assert found.is_empty != some_belief_explains(problem.costs, corners, action)
        for margin in (0.0, 0.01, 0.2):
            if abs(wanted - margin) > 1e-6:
                reached = wanted >= margin if margin else found.is_empty
                assert Infeasibility(margin)(belief, found) == (0.0 if reached else -np.inf)


@settings(max_examples=instances(15), deadline=None)
@given(SEEDS)
def test_unexplained_decisions_are_as_cheap_as_can_be(seed):
    problem, belief, _ = drawn(seed)
    corners, margin = vertices_of(problem.constraints), 0.02
    value = (corners @ problem.costs.T @ belief).min()
    best = cheapest(problem, belief, margin) - value
    for maker in (CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker):
        decided = maker(problem, Infeasibility(margin), Budget.regret(1.1 * best if best < np.inf else 1.0)).decide(
            belief
        )
        if best == np.inf:
            assert decided.status is DecisionStatus.NO_AFFORDABLE_PRIVACY
            continue
        single = maker is CounterAdversarialDecisionMaker
        action, regret = (decided.action, decided.regret) if single else (decided.actions[0], decided.regrets[0])
        assert (decided.privacy if single else decided.expected_privacy) == 0.0
        # Decisions with a slack below what a person would trade are not played: they may cost a little more.
        assert best - 1e-9 <= regret <= best + 1e-3
        assert least_regret(problem.costs, corners, action) >= margin - 1e-9
    if 1e-6 < best < np.inf:
        poor = CounterAdversarialDecisionMaker(problem, Infeasibility(margin), Budget.regret(0.99 * best))
        assert poor.decide(belief).status is DecisionStatus.NO_AFFORDABLE_PRIVACY


@settings(max_examples=15, deadline=None)
@given(SEEDS)
def test_unexplained_choices_are_enumerated(seed):
    rng = np.random.default_rng(seed)
    costs = rng.normal(size=(3, 6))
    problem, belief, margin = FiniteProblem(costs), rng.dirichlet(np.ones(3)), 0.05
    gaps = np.array([least_regret(costs, np.eye(6), choice) for choice in np.eye(6)])
    regrets = belief @ costs - (belief @ costs).min()
    regrets[gaps < margin] = np.inf
    decided = CounterAdversarialDecisionMaker(problem, Infeasibility(margin), Budget.regret(100.0)).decide(belief)
    if np.isinf(regrets.min()):
        assert decided.status is DecisionStatus.NO_AFFORDABLE_PRIVACY
    else:
        assert decided.action == regrets.argmin()
        assert decided.regret == pytest.approx(regrets.min(), abs=1e-12)


def test_a_feasible_programme_is_not_excluded_by_presolving() -> None:
    """Bounds a hair beside round numbers: HiGHS's presolving calls this infeasible at the tolerances used here."""
    middles = np.array([0.2, 0.5, -0.1, 0.5])
    bounds = [(each - 0.05 - 5e-11, each + 0.05 + 5e-11) for each in middles.tolist()]
    answer = minimise(np.zeros(4), None, Rows(np.ones((1, 4)), np.ones(1)), bounds)
    assert answer.status == OPTIMAL
    assert answer.x.sum() == pytest.approx(1.0, abs=1e-9)
    assert minimise(np.zeros(4), None, Rows(np.ones((1, 4)), np.full(1, 1.4)), bounds).status != OPTIMAL
