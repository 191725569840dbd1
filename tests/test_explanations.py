"""Explanations: rows in conflict, decisions that no belief explains, privacy that the budget does not reach."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    FiniteProblem,
    Infeasibility,
    InputError,
    LocalSearch,
    MarkowitzProblem,
    MaximalObfuscation,
    ModelError,
    NonExistence,
    Polyhedron,
    box,
    cheapest_privacy,
    consistent_beliefs,
    decoy_grid,
    explain_action,
    near_optimal_beliefs,
    plausibility_gap,
    random_candidates,
    simplex,
)
from oracles.markets import random_market
from polyhedra import KINDS, random_problem
from sizes import instances
from strategies import line_problem


def feasible(region, rows):
    """Whether some decision satisfies the named rows, by one linear programme."""
    kept = [i for i, name in enumerate(region.names) if name in rows]
    n = len(region.b_ub)
    below, equal = [i for i in kept if i < n], [i - n for i in kept if i >= n]
    return (
        linprog(
            np.zeros(region.n_actions),
            region.A_ub[below] if below else None,
            region.b_ub[below] if below else None,
            region.A_eq[equal] if equal else None,
            region.b_eq[equal] if equal else None,
            bounds=(None, None),
        ).status
        == 0
    )


# --- nothing feasible -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(instances(25, least=6)))
def test_a_conflict_is_irreducible_and_its_amounts_resolve_it(seed):
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 6))
    units = 10.0 ** rng.integers(-2, 3, size=2 * size)
    rows = rng.normal(size=(2 * size, size)) * units[:, None]
    region = simplex(size) & Polyhedron(rows, rows @ rng.dirichlet(np.ones(size)) - 0.3 * units)
    found = region.conflict()
    if found is None:
        region.check_feasible()
        assert feasible(region, region.names)
        return
    assert not feasible(region, found.names)
    for name in found.names:
        assert feasible(region, [other for other in found.names if other != name])
    n = len(region.b_ub)
    for name, amount in zip(found.names, found.amounts, strict=True):
        index = region.names.index(name)
        if index >= n:
            continue
        for share, answer in ((1.001, True), (0.999, False)):
            b_ub = region.b_ub.copy()
            b_ub[index] += share * amount
            moved = Polyhedron(region.A_ub, b_ub, region.A_eq, region.b_eq, names=region.names)
            assert feasible(moved, found.names) == answer
    with pytest.raises(ModelError, match="cannot hold together"):
        region.check_feasible()


def test_a_cost_without_an_end_is_a_model_error():
    region = Polyhedron([[-1.0, 0.0]], [0.0])
    problem = MarkowitzProblem([[0.1, 0.1]], [np.diag([1.0, 0.0])], 1.0, region)
    with pytest.raises(
        ModelError, match=r"no minimum over the feasible set: it is unbounded below along u\[1\] \+1; bound"
    ):
        problem.solve([1.0])


# --- no belief --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_what_nothing_explains_has_a_proof(kind):
    for seed in range(instances(4, least=1)):
        rng = np.random.default_rng([KINDS.index(kind), seed])
        n_states, size = int(rng.integers(2, 6)), int(rng.integers(2, 6))
        problem = random_problem(rng, kind, n_states, size)
        ends = problem.solve(np.eye(n_states))
        action = rng.dirichlet(np.ones(n_states)) @ ends
        found = explain_action(problem, action)
        if found.is_explained:
            assert consistent_beliefs(problem, action).contains(found.belief)
            assert found.gap == 0
            continue
        scale = np.abs(problem.state_costs(np.vstack([ends, action]))).max()
        assert found.gap == pytest.approx(plausibility_gap(problem, action), abs=1e-8 * scale)
        assert float(problem.regret(found.belief, action)) == pytest.approx(found.gap, abs=1e-8 * scale)
        # The other decision is feasible and saves the gap in every state: no belief leaves less.
        assert problem.constraints.violation(found.better) <= 1e-9
        savings = problem.state_costs(action) - problem.state_costs(found.better)
        assert savings.min() >= found.gap - 1e-7 * scale
        # The direction is allowed by the tight rows and lowers every state's cost.
        region = problem.constraints
        gradients = problem.cost_gradients(action)
        tight = region.tight_rows(action)
        assert (region.A_ub[tight] @ found.direction <= 1e-8 * region.row_scale[tight]).all()
        assert np.abs(region.A_eq @ found.direction).max(initial=0.0) <= 1e-8
        if found.rate > 0:
            assert (gradients @ found.direction <= -found.rate + 1e-8 * np.abs(gradients).max()).all()
        above = near_optimal_beliefs(problem, action, found.gap * 1.01 + 1e-6 * scale)
        assert above.contains(found.belief)


def test_the_explanation_speaks_with_names():
    problem = line_problem([1.0, 0.0])
    told = explain_action(problem, [1.0, 0.0], names=["Oil", "Gas"]).summary()
    for part in ("regret of at least 0.125", "[1.0000 0.0000]", "Oil -", "Gas +", "in every state", "u[1] >= 0"):
        assert part in told or part == "u[1] >= 0"
    fine = explain_action(problem, problem.solve([0.3, 0.7]))
    assert fine.is_explained
    assert "explained" in repr(fine)
    with pytest.raises(InputError, match="names has 1 entries, expected one per coordinate of the action: 2"):
        explain_action(problem, [1.0, 0.0], names=["Oil"])
    with pytest.raises(InputError, match="outside the feasible set"):
        explain_action(problem, [1.0, 1.0])


# --- no affordable privacy --------------------------------------------------------------------------------------------


def corner_problem():
    """Two assets of which one is best in every state: the paper's corner, where all beliefs publish the same."""
    return MarkowitzProblem([[3.0, 0.0], [3.0, 0.0], [1.0, 0.0]], [np.eye(2) / 2] * 3, 1.0)


def test_what_the_cheapest_change_costs():
    # u_1 = min(½ + π·m/2, 1): at one while π·m >= 1; so the corner says nothing but π·m >= 1: all beliefs.
    problem = corner_problem()
    found = cheapest_privacy(problem, [0.4, 0.3, 0.3])
    assert found.regret == np.inf
    assert "no decision found" in repr(found)
    # With m_3 = ½ the belief must move to π·m < 1 by what makes a weight of 1e-4 in the second asset.
    problem = MarkowitzProblem([[3.0, 0.0], [3.0, 0.0], [0.5, 0.0]], [np.eye(2) / 2] * 3, 1.0)
    belief = np.array([0.2, 0.2, 0.6])  # π·m = 1.5
    found = cheapest_privacy(problem, belief)
    # ρ at u = (1 − e, e), e = 1e-4: (½ − 1.5)(…)… = e(1.5 − 1) + e².
    assert found.regret == pytest.approx(0.5e-4 + 1e-8, rel=1e-2)
    assert found.privacy > 0.1
    assert "costs a regret" in found.summary()
    measure = MaximalObfuscation()
    for share, status in ((0.9, DecisionStatus.NO_AFFORDABLE_PRIVACY), (1.05, DecisionStatus.POLISHED)):
        chooser = CounterAdversarialDecisionMaker(problem, measure, Budget.regret(share * found.regret))
        assert chooser.decide(belief).status is status
    assert measure(belief, consistent_beliefs(problem, found.action)) == pytest.approx(found.privacy, abs=1e-9)
    assert "cheapest_privacy" in DecisionStatus.NO_AFFORDABLE_PRIVACY.value


def test_a_privacy_can_be_asked_for_and_its_price_falls_to_what_the_search_needs():
    problem = MarkowitzProblem(np.eye(3), [np.eye(3)] * 3, 1.0)  # ρ = ‖π − y‖²/4
    belief = np.array([0.4, 0.3, 0.3])
    found = cheapest_privacy(problem, belief, privacy=0.2)
    assert found.privacy == pytest.approx(0.2, abs=1e-6)
    assert found.regret == pytest.approx(0.01, rel=1e-5)
    assert found.share == pytest.approx(found.regret / abs(float(problem.optimal_cost(belief))))
    goal = cheapest_privacy(problem, belief, NonExistence(margin=0.2), candidates=decoy_grid(problem, 12))
    assert goal.regret == pytest.approx(0.01, rel=1e-4)
    assert cheapest_privacy(problem, belief, privacy=0.0).regret == 0
    apart = random_candidates(problem, 30, rng=np.random.default_rng(0))
    assert cheapest_privacy(problem, belief, Infeasibility(margin=100.0), candidates=apart).regret == np.inf
    with pytest.raises(InputError, match="privacy must be"):
        cheapest_privacy(problem, belief, privacy="much")


def test_a_privacy_out_of_reach_is_named_with_the_most_found():
    problem = MarkowitzProblem(0.2 * np.eye(2), [np.eye(2)] * 2, 1.0)
    far = cheapest_privacy(problem, [0.5, 0.5], privacy=0.9)
    assert far.regret == np.inf
    assert (far.asked, far.privacy, far.most) == (0.9, 0.0, pytest.approx(np.sqrt(0.5)))
    assert "reaches a privacy of 0.9 (the optimal one has 0; the most found is 0.7071)" in far.summary()
    met = cheapest_privacy(problem, [0.5, 0.5], NonExistence(), privacy=0.1)
    assert "reaches a privacy of 0.1 (the optimal one has -inf; the most found is 0)" in met.summary()
    nothing = cheapest_privacy(corner_problem(), [0.4, 0.3, 0.3])
    assert nothing.most == nothing.privacy
    assert "gives more privacy than 0, at any cost" in nothing.summary()


def test_the_cheapest_of_finite_choices_is_a_whole_number(fresh_rng: np.random.Generator) -> None:
    """By enumeration, also where the optimal choice has the privacy, and where its cost is zero."""
    assert cheapest_privacy(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), [1.0, 0.0], privacy=0.0).share == 0.0
    for _ in range(20):
        n_choices = int(fresh_rng.integers(2, 5))
        problem, belief = FiniteProblem(fresh_rng.normal(size=(2, n_choices))), fresh_rng.dirichlet(np.ones(2))
        distances = []
        for choice in range(n_choices):
            found = consistent_beliefs(problem, choice)
            distances.append(np.nan if found.is_empty else found.distance(belief))
        regrets = problem.regret(belief, np.arange(n_choices))
        for least in (0.0, 0.1, 0.4):
            enough = np.array(distances) >= least  # never where no belief explains the choice
            cheapest = cheapest_privacy(problem, belief, privacy=least)
            wanted = regrets[enough].min(initial=np.inf)
            assert cheapest.regret == pytest.approx(wanted, abs=1e-12)
            if np.isfinite(wanted):
                assert isinstance(cheapest.action, int | np.integer)
                assert regrets[cheapest.action] == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize("seed", range(instances(6, least=3)))
def test_no_decision_maker_reaches_the_distance_at_a_hundredth_less_regret(seed):
    rng = np.random.default_rng([11, seed])
    n_states = 3 + seed % 3
    problem = MarkowitzProblem(*random_market(rng, n_states, int(rng.integers(4, 9)), positive_value=True))
    belief, grid = rng.dirichlet(np.ones(n_states)), decoy_grid(problem, 10)
    found = cheapest_privacy(problem, belief, privacy=0.2, candidates=grid)
    assert found.privacy >= 0.2
    less = Budget.regret(0.99 * found.regret)
    assert CounterAdversarialDecisionMaker(problem, budget=less, candidates=grid).decide(belief).privacy < 0.2


def test_a_local_search_without_a_start_says_so():
    rng = np.random.default_rng(3)  # twelve assets held, two states: hardly any portfolio has an explanation
    covariances = [np.diag(rng.uniform(0.1, 0.2, 12)) for _ in range(2)]
    problem = MarkowitzProblem(0.01 * rng.normal(size=(2, 12)), covariances, 1.0)
    method = LocalSearch(n_starts=1, rng=np.random.default_rng(0))
    decision = CounterAdversarialDecisionMaker(problem, budget=0.1, method=method).decide([0.3, 0.7])
    assert decision.status is DecisionStatus.NO_PLAUSIBLE_START
    assert "global search" in decision.summary()


# --- as many as ten states --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n_states", [6, 10])
def test_near_optimal_sets_of_many_states_are_balls_where_the_costs_say_so(n_states):
    """ρ(π, u*(y)) = ‖π − y‖²/4: everything about the set at ε is known in closed form."""
    problem = MarkowitzProblem(np.eye(n_states), [np.eye(n_states)] * n_states, 1.0)
    decoy = np.full(n_states, 1.0 / n_states)
    radius = 0.05
    found = near_optimal_beliefs(problem, problem.solve(decoy), radius**2 / 4)
    reach = radius * np.sqrt(1 - 1 / n_states)
    np.testing.assert_allclose(found.bounds(), np.tile([decoy[0] - reach, decoy[0] + reach], (n_states, 1)), atol=1e-4)
    corner = np.eye(n_states)[0]
    assert found.distance(corner) == pytest.approx(np.linalg.norm(corner - decoy) - radius, abs=1e-4)
    assert found.dimension == n_states - 1
    assert found.vertices().shape == (2 * n_states, n_states)
    np.testing.assert_allclose(found.center(), decoy, atol=1e-3)
    sample = found.sample(200, rng=np.random.default_rng(0))
    away = np.linalg.norm(sample - decoy, axis=1)
    assert away.max() <= radius * 1.001
    # The distance of a uniform point of a ball in d dimensions is radius·U^(1/d), with mean radius·d/(d + 1).
    d = n_states - 1
    assert away.mean() == pytest.approx(radius * d / (d + 1), abs=5 * radius / ((d + 1) * np.sqrt(200)))
    np.testing.assert_allclose(sample.mean(axis=0), decoy, atol=5 * radius / np.sqrt(d * 200))


def test_boxes_are_named_with_their_conflict_alone():
    region = box([0.6, 0.6], [1.0, 1.0]) & simplex(2)
    found = region.conflict()
    assert set(found.names) == {"u[0] >= 0.6", "u[1] >= 0.6", "sum(u) = 1"}
    np.testing.assert_allclose(found.amounts, 0.2)
