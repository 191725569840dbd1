"""Goals that are met or missed (a, b, c): the streamed search against enumeration and against the search set by set."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from inscrutable import (
    Budget,
    ConvexProblem,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    FiniteProblem,
    Infeasibility,
    KellyProblem,
    LinearProblem,
    MarkowitzProblem,
    NonExistence,
    NonUniqueness,
    PiecewiseLinearProblem,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    action_grid,
    box,
    cheapest_privacy,
    consistent_beliefs,
    decoy_grid,
    plausibility_gap,
    random_candidates,
    simplex,
)
from inscrutable.adversaries.plausibility import nearest_explanation
from inscrutable.decision_makers import indicator_search
from inscrutable.decision_makers.candidate_sources import near_decoys
from inscrutable.decision_makers.indicators import Indicator, cheapest_candidates
from inscrutable.geometry import BeliefSet
from oracles import markets
from sizes import some
from strategies import long_only


class SetBySetUniqueness(NonUniqueness):
    """The same goal, but a user's own class, which is judged by its definition."""


class SetBySetExistence(NonExistence):
    """The same for the distance."""


class SetBySetFeasibility(Infeasibility):
    """The same for the gap."""


def problem_of(kind: str) -> QuadraticProblem:
    rng = np.random.default_rng(7)
    n_states = {"one asset": 3, "one state": 1, "two states": 2, "four states": 4}.get(kind, 3)
    n_assets = {"one asset": 1, "four states": 5, "few assets": 2}.get(kind, 4)
    market = markets.random_market(rng, n_states, n_assets, duplicate=kind == "duplicated asset")
    means, covariances = market.means, market.covariances
    if kind == "states alike":
        means, covariances = means[[0, 1, 1]], covariances[[0, 1, 1]]
    if kind == "box":
        return QuadraticProblem(covariances, -means, constraints=box(-np.ones(n_assets), np.ones(n_assets)))
    slack = 0.0 if kind == "no least slack" else 1e-4
    return MarkowitzProblem(means, covariances, market.risk_aversion, constraints=long_only(n_assets, slack))


KINDS = [
    "plain", "one asset", "one state", "two states", "four states", "few assets", "duplicated asset", "states alike",
    "no least slack", "box",
]  # fmt: skip


def beliefs_of(n_states: int, count: int = 5) -> np.ndarray:
    """Interior ones, one with regimes of probability zero, and the centre."""
    inside = np.random.default_rng(8).dirichlet(np.ones(n_states), count)
    edge = np.zeros((1, n_states))
    edge[0, : min(2, n_states)] = 1.0 / min(2, n_states)
    return np.vstack([inside, edge, np.eye(n_states)[:1], np.full((1, n_states), 1.0 / n_states)])


BUDGETS = [0.1, Budget.regret(1e-5), Budget.regret(0.0)]
GOALS = [
    (NonUniqueness(), SetBySetUniqueness()),
    (NonExistence(), SetBySetExistence()),
    (NonExistence(0.0), SetBySetExistence(0.0)),
    (NonExistence(0.2), SetBySetExistence(0.2)),
    (Infeasibility(0.0), SetBySetFeasibility(0.0)),
]


@pytest.mark.parametrize(("kind", "budget", "goal"), some(list(product(KINDS, BUDGETS, GOALS)), 52), ids=str)
def test_the_stream_decides_as_the_search_set_by_set(kind, budget, goal):
    streamed, defined = goal
    problem = problem_of(kind)
    beliefs = beliefs_of(problem.n_states)
    if isinstance(streamed, Infeasibility):
        candidates = random_candidates(problem, 60, rng=np.random.default_rng(3))
    else:
        candidates = decoy_grid(problem, 12)
    for maker in (CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker):
        new = maker(problem, streamed, budget, candidates=candidates).decide_many(beliefs)
        old = maker(problem, defined, budget, candidates=candidates).decide_many(beliefs)
        assert new.status == old.status
        names = (
            ("privacy",) if maker is CounterAdversarialDecisionMaker else ("expected_privacy", "probabilities", "price")
        )
        for name in (*names, "privacy_bound"):
            np.testing.assert_array_equal(getattr(new, name), getattr(old, name), err_msg=name)
        np.testing.assert_allclose(new.optimal_cost, old.optimal_cost, atol=1e-12)
        paid, before = new.cost if names == ("privacy",) else new.expected_cost, None
        before = old.cost if names == ("privacy",) else old.expected_cost
        # The way is cut at the nearest point that meets the goal: never dearer than where halving from the far end stops.
        assert (paid <= before + 1e-10 * max(1.0, np.abs(before).max())).all()
        same = np.abs(paid - before) <= 1e-12
        assert same.mean() >= 0.6


@pytest.mark.parametrize("kind", some(["two states", "plain", "duplicated asset", "four states"], 2))
def test_a_gap_is_compared_as_the_cutting_planes_do(kind):
    problem = problem_of(kind)
    beliefs = beliefs_of(problem.n_states, 2)[:3]
    candidates = near_decoys(problem, 300)
    new = CounterAdversarialDecisionMaker(problem, Infeasibility(1e-4), candidates=candidates).decide_many(beliefs)
    old = CounterAdversarialDecisionMaker(problem, SetBySetFeasibility(1e-4), candidates=candidates).decide_many(
        beliefs
    )
    assert new.status == old.status
    # Both stop where the gap is the margin up to 1e-9 of the costs.
    np.testing.assert_allclose(new.regret, old.regret, rtol=1e-3, atol=1e-9)
    for step in range(len(beliefs)):
        if new.privacy[step] == 0.0:
            assert consistent_beliefs(problem, new.action[step]).is_empty
            assert 1e-4 <= plausibility_gap(problem, new.action[step]) <= 1.1e-4


@pytest.mark.parametrize("margin", [1e-6, 1e-3, 5e-3])
def test_a_gap_is_compared_with_a_margin_as_it_is_computed(margin):
    problem = problem_of("four states")
    rng = np.random.default_rng(5)
    goal = Indicator(problem, Infeasibility(margin))
    answers = []
    for _ in range(8):
        optimal, other = problem.solve(rng.dirichlet(np.ones(4))), rng.dirichlet(np.ones(problem.n_actions))
        for share in (0.0, 1e-3, 0.03, 0.5):
            action = optimal + share * (other - optimal)
            gap = nearest_explanation(problem, action)[1]
            if abs(gap - margin) > 1e-7:
                answers.append(gap >= margin)
                assert goal.gap_reaches(action) == answers[-1]
    assert {True, False} == set(answers)


@pytest.mark.parametrize("measure", [NonUniqueness(), NonExistence(), NonExistence(0.3), Infeasibility(1e-3)], ids=repr)
def test_the_search_begins_at_the_cheapest_candidate_by_enumeration(measure):
    problem = problem_of("plain")
    rng = np.random.default_rng(11)
    candidates = decoy_grid(problem, 6).joined(random_candidates(problem, 30, rng=rng))
    goal = Indicator(problem, measure)
    beliefs = beliefs_of(3)
    optimal = problem.optimal_cost(beliefs)
    sets = [consistent_beliefs(problem, action) for action in candidates.actions]
    met = [[bool(usable) and measure(belief, found) == 0.0 for usable, found in zip(candidates.usable, sets, strict=True)]
           for belief in beliefs]  # fmt: skip
    for limit in (np.inf, 0.3, 0.003):
        numbers, reached = cheapest_candidates(goal, candidates, beliefs, optimal, np.full(len(beliefs), limit))
        for step, belief in enumerate(beliefs):
            regrets = candidates.state_costs @ belief - optimal[step]
            allowed = regrets[np.array(met[step]) & (regrets <= limit)]
            if not allowed.size:
                assert numbers[step] == -1
                continue
            assert reached[step] == pytest.approx(max(allowed.min(), 0.0), abs=1e-14)
            assert met[step][numbers[step]]


@pytest.mark.parametrize("measure", some([Infeasibility(), NonUniqueness(), NonExistence()], 3), ids=repr)
def test_what_is_chosen_meets_the_goal_within_the_budget(measure):
    problem = problem_of("plain")
    beliefs = beliefs_of(3, 2)
    chooser = CounterAdversarialDecisionMaker(problem, measure, Budget.regret(1e-3))
    found = chooser.decide_many(beliefs)
    mixed = ProbabilisticDecisionMaker(problem, measure, Budget.regret(1e-3)).decide_many(beliefs)
    assert (found.privacy == 0.0).any()
    for step, belief in enumerate(beliefs):
        assert measure(belief, consistent_beliefs(problem, found.action[step])) == found.privacy[step]
        assert found.regret[step] <= 1e-3
        assert found.regret[step] == pytest.approx(float(problem.regret(belief, found.action[step])), abs=1e-14)
        assert problem.constraints.is_admissible(found.action[step])
        alone = chooser.decide(belief)
        assert alone.status is found.status[step]
        assert alone.regret == pytest.approx(found.regret[step], rel=1e-3, abs=1e-12)
        # Equal privacies: the best lottery is the cheapest decision.
        assert mixed[step].probabilities.tolist() == [1.0]
        assert mixed[step].regrets[0] <= found.regret[step] + 1e-15
        assert mixed.expected_privacy[step] == found.privacy[step]


def test_margins_are_not_mixed_up():
    problem = problem_of("plain")
    candidates = decoy_grid(problem, 12)
    belief = beliefs_of(3)[0]
    paid = [
        CounterAdversarialDecisionMaker(problem, NonExistence(margin), 1.0, candidates=candidates).decide(belief).regret
        for margin in (0.01, 0.010000001, 0.1)
    ]
    assert paid[0] < paid[1] < paid[2]


@pytest.mark.parametrize("measure", some([NonExistence(), NonUniqueness(), Infeasibility()], 3), ids=repr)
def test_the_same_bytes_for_any_number_of_threads(monkeypatch, measure):
    problem = problem_of("plain")
    beliefs = np.random.default_rng(1).dirichlet(np.ones(3), 12)
    monkeypatch.setattr(indicator_search, "_CHUNK", 3)
    answers = set()
    for threads in ("1", "4"):
        monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
        candidates = near_decoys(problem, 60) if isinstance(measure, Infeasibility) else decoy_grid(problem, 12)
        found = CounterAdversarialDecisionMaker(problem, measure, candidates=candidates).decide_many(beliefs)
        answers.add(found.action.tobytes() + found.regret.tobytes() + found.decoy.tobytes())
    assert len(answers) == 1


@pytest.mark.parametrize("measure", [NonExistence(), Infeasibility()], ids=repr)
def test_progress_ends_at_the_end_and_an_interrupt_is_passed_on(measure, monkeypatch):
    monkeypatch.setattr(indicator_search, "_CHUNK", 3)
    problem = problem_of("plain")
    beliefs = np.random.default_rng(1).dirichlet(np.ones(3), 8)
    chooser = CounterAdversarialDecisionMaker(problem, measure, candidates=random_candidates(
        problem, 20, rng=np.random.default_rng(2)))  # fmt: skip
    seen = []
    chooser.decide_many(beliefs, progress=lambda done, of: seen.append((done, of)))
    assert seen[-1] == (8, 8)
    assert seen == sorted(seen)

    def interrupt(done, of):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        chooser.decide_many(beliefs, progress=interrupt)
    assert len(chooser.decide_many(beliefs[:3])) == 3


def test_nothing_affordable_is_said():
    problem = problem_of("plain")
    belief = beliefs_of(3)[0]
    for maker in (CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker):
        found = maker(problem, NonExistence(), Budget.regret(0.0), candidates=decoy_grid(problem, 7)).decide(belief)
        assert found.status is DecisionStatus.NO_AFFORDABLE_PRIVACY
        actions = np.atleast_2d(found.action if hasattr(found, "action") else found.actions)
        np.testing.assert_allclose(actions[0], problem.solve(belief), atol=1e-12)


@pytest.mark.parametrize("seed", range(12))
def test_the_distance_of_a_set(seed):
    """By Clarabel, for sets of several dimensions, among them cones cut by the border of the simplex and empty ones."""
    cp = pytest.importorskip("cvxpy")
    rng = np.random.default_rng([seed, 3])
    n_states = int(rng.integers(3, 8))
    equalities = rng.normal(size=(int(rng.integers(0, 2)), n_states))
    inequalities = rng.normal(size=(int(rng.integers(0, 4)), n_states))
    found = BeliefSet(equalities, inequalities)
    belief = rng.dirichlet(np.ones(n_states))
    x = cp.Variable(n_states, nonneg=True)
    rows = [cp.sum(x) == 1, inequalities @ x >= 0, equalities @ x == 0]
    rows = [row for row, many in zip(rows, (1, len(inequalities), len(equalities)), strict=True) if many]
    programme = cp.Problem(cp.Minimize(cp.norm(x - belief)), rows)
    programme.solve(solver=cp.CLARABEL)
    if programme.status == "infeasible":
        assert found.is_empty
    else:
        assert found.distance(belief) == pytest.approx(programme.value, abs=1e-6)


@pytest.mark.parametrize("n_states", some([3, 5, 4], 2))
def test_no_random_decoy_keeps_the_distance_for_less(fresh_rng, n_states):
    assert_no_random_decoy_costs_less(fresh_rng, n_states)


@pytest.mark.parametrize(("seed", "n_states"), [(1, 4), (6, 3), (7, 4), (9, 3)])
def test_no_random_decoy_keeps_the_distance_for_less_where_one_did(seed, n_states):
    """Without a search for the least distance, or without directions around the belief, one did."""
    assert_no_random_decoy_costs_less(np.random.default_rng([seed, n_states]), n_states)


def assert_no_random_decoy_costs_less(rng, n_states):
    """Decoys in random directions at the margin and beyond it; ten times the least regret was paid at four states."""
    for n_assets in (5, 9):
        market = markets.random_market(rng, n_states, n_assets)
        problem = MarkowitzProblem(market.means, market.covariances, market.risk_aversion)
        belief = rng.dirichlet(np.ones(n_states))
        found = CounterAdversarialDecisionMaker(
            problem, NonExistence(), 0.5, candidates=decoy_grid(problem, {3: 30, 4: 12, 5: 8}[n_states])
        ).decide(belief)
        away = rng.normal(size=(3000, n_states))
        away -= away.mean(axis=1, keepdims=True)
        lengths = 0.01 * np.exp(rng.exponential(size=(3000, 1)) * (rng.uniform(size=(3000, 1)) < 0.7))
        decoys = belief + lengths * away / np.linalg.norm(away, axis=1, keepdims=True)
        decoys = decoys[(decoys >= 0.0).all(axis=1)]
        actions = problem.solve(decoys)
        regrets = problem.regret(belief, actions)
        cheaper = problem.constraints.is_admissible(actions) & (regrets < 0.98 * found.regret)
        for action in actions[cheaper]:
            assert consistent_beliefs(problem, action).distance(belief) < 0.01
        if found.privacy == 0.0:
            assert consistent_beliefs(problem, found.action).distance(belief) >= 0.01


def test_rounding_of_an_optimal_decision_hides_nothing():
    """Two equal assets: many decisions are optimal, and no belief explains some that differ from them by rounding."""
    hessians = np.array([
        [[0.28, 0.2, -0.04], [0.2, 0.31, 0.07], [-0.04, 0.07, 0.25]],
        [[0.08, 0.05, -0.03], [0.05, 0.25, -0.02], [-0.03, -0.02, 0.15]],
        [[0.33, -0.21, 0.35], [-0.21, 0.29, -0.21], [0.35, -0.21, 0.61]],
    ])  # fmt: skip
    linear = np.array([[-0.16, 0.18, -0.06], [-0.2, 0.17, 0.16], [0.28, -0.15, -0.19]])
    same, belief, regrets = [0, 1, 2, 0], np.array([0.17, 0.53, 0.3]), []
    hessians, linear = hessians[:, same][:, :, same], linear[:, same]
    for unit in (1.0, 1e4):
        problem = QuadraticProblem(unit * hessians, unit * linear, constraints=box(-np.ones(4), np.ones(4)))
        grid = decoy_grid(problem, 12)
        found = CounterAdversarialDecisionMaker(
            problem, NonExistence(0.3), Budget.regret(0.11 * unit), candidates=grid
        ).decide(belief)
        assert 0.3 <= found.belief_set.distance(belief) < np.inf
        regrets.append(found.regret / unit)
    assert regrets[0] > 1e-3
    assert regrets[0] == pytest.approx(regrets[1], rel=1e-4)


def test_a_distance_is_kept_at_the_least_divergence_near_a_corner():
    """Bets on three outcomes, whose probabilities are linear in the belief: a regret is a Kullback-Leibler divergence."""
    laws = np.array([[0.9357, 0.0637, 0.0006], [0.3497, 0.2773, 0.373], [0.6478, 0.0218, 0.3304]])
    belief, margin = np.array([0.979, 0.019, 0.002]), 0.01
    angles = np.linspace(0.0, 2.0 * np.pi, 4001)[:, None]
    first, second = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0), np.array([1.0, 1.0, -2.0]) / np.sqrt(6.0)
    decoys = belief + margin * (np.cos(angles) * first + np.sin(angles) * second)
    own, played = belief @ laws, decoys[(decoys >= 0.0).all(axis=1)] @ laws
    least = (own * np.log(own / played)).sum(axis=1).min()
    problem = KellyProblem(np.tile(np.eye(3), (3, 1, 1)), laws)
    found = CounterAdversarialDecisionMaker(problem, NonExistence(margin), Budget.regret(0.1)).decide(belief)
    assert 0.999 * least <= found.regret <= 1.02 * least


@pytest.mark.parametrize("measure", [NonExistence(0.1), Infeasibility()], ids=repr)
def test_choices_that_no_belief_explains_meet_the_goal(measure):
    """By enumeration: a choice is best in each state, and the last one costs more than their least, whatever the belief."""
    rng = np.random.default_rng(3)
    for _ in range(10):
        problem = FiniteProblem(np.column_stack([2.0 * (1.0 - np.eye(3)), rng.uniform(1.4, 1.6, size=3)]))
        belief = rng.dirichlet(np.ones(3))
        sets = [consistent_beliefs(problem, choice) for choice in range(4)]
        costs = belief @ problem.costs
        least = min(costs[k] for k in range(4) if measure(belief, sets[k]) == 0.0) - costs.min()
        single = CounterAdversarialDecisionMaker(problem, measure, Budget.regret(2.0)).decide(belief)
        drawn = ProbabilisticDecisionMaker(problem, measure, Budget.regret(2.0)).decide(belief)
        assert single.regret == pytest.approx(least)
        assert drawn.expected_regret == pytest.approx(least)
        assert cheapest_privacy(problem, belief, measure).regret == pytest.approx(least)


def test_choices_that_no_belief_explains_are_infinitely_private_where_asked():
    problem = FiniteProblem([[0.0, 2.0, 1.1], [2.0, 0.0, 1.1]])
    maker = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(1.0), on_empty="infinite")
    assert maker.decide([0.9, 0.1]).action == 2


def squares() -> QuadraticProblem:
    """|u − a_i|² over the unit square."""
    aims = np.array([[0.7, 0.2], [0.2, 0.6]])
    return QuadraticProblem(
        np.tile(2.0 * np.eye(2), (2, 1, 1)),
        -2.0 * aims,
        (aims**2).sum(axis=1),
        constraints=box(np.zeros(2), np.ones(2)),
    )


def market() -> MarkowitzProblem:
    covariances = [np.diag([0.002, 0.001, 0.0002]), np.diag([0.01, 0.003, 0.0003])]
    return MarkowitzProblem([[0.02, 0.01, 0.005], [-0.03, 0.0, 0.004]], covariances, risk_aversion=5.0)


@pytest.mark.parametrize(
    ("problem", "margin", "most"),
    [(squares(), 0.1, 0.11), (squares(), 0.3, 0.33), (market(), 0.001, 0.00105), (market(), 0.004, 0.0042)],
)
def test_a_large_margin_is_reached(problem, margin, most):
    """No decision whose gap is the margin costs less than it; some are found at little more."""
    belief = [0.6, 0.4] if most > 0.1 else [0.8, 0.2]
    found = cheapest_privacy(problem, belief, Infeasibility(margin), privacy=0.0)
    assert margin <= found.regret <= most
    assert plausibility_gap(problem, found.action) >= margin
    for maker in (CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker):
        decided = maker(problem, Infeasibility(margin), Budget.regret(20.0 * most)).decide(belief)
        assert decided.status is not DecisionStatus.NO_AFFORDABLE_PRIVACY


def test_a_margin_is_reached_where_costs_have_no_slope_at_the_ends():
    problem = ConvexProblem.from_functions(
        lambda u: np.array([-np.log(u).sum() + u[0], -np.log(u) @ [1.0, 0.5]]),
        lambda u: np.array([[1.0, 0.0] - 1.0 / u, [-1.0, -0.5] / u]),
        simplex(2),
    )
    found = cheapest_privacy(problem, [0.5, 0.5], Infeasibility(2.0), privacy=0.0, candidates=near_decoys(problem, 20))
    assert 2.0 <= found.regret < np.inf


def test_the_exact_programme_is_asked_where_no_candidate_meets_the_goal():
    problem, belief = LinearProblem([[1.0, 2.0, 3.0], [3.0, 1.0, 2.5]], simplex(3)), [0.6, 0.4]
    found = cheapest_privacy(problem, belief, Infeasibility(0.6), privacy=0.0, candidates=[[0.0, 1.0, 0.0]])
    decided = CounterAdversarialDecisionMaker(problem, Infeasibility(0.6), Budget.regret(10.0)).decide(belief)
    assert found.regret == pytest.approx(decided.regret, abs=1e-6)
    assert np.isinf(cheapest_privacy(problem, belief, Infeasibility(3.0), privacy=0.0).regret)


def exponentials() -> ConvexProblem:
    """Σ_j e^{t_ij u_j} + |u|²/10 over a square, by its functions."""
    tilts = np.array([[1.0, -0.5], [-0.7, 0.9]])
    return ConvexProblem.from_functions(
        lambda u: np.exp(tilts * u).sum(axis=1) + 0.1 * u @ u,
        lambda u: tilts * np.exp(tilts * u) + 0.2 * u,
        box(-np.ones(2), np.ones(2)),
        strictly_convex=True,
    )


def kinks() -> PiecewiseLinearProblem:
    slopes = [[[0.5, 0.0]], [[1.5, -0.5], [-1.5, 0.5]]]
    return PiecewiseLinearProblem(slopes, [[0.5], [-0.25, 0.0]], box(-np.ones(2), np.ones(2)))


@pytest.mark.parametrize(
    ("problem", "measure"),
    [
        (squares(), Infeasibility(0.02)),
        (squares(), Infeasibility(0.3)),
        (squares(), NonExistence(0.2)),
        (exponentials(), Infeasibility(0.02)),
        (exponentials(), NonExistence(0.2)),
        (kinks(), Infeasibility(0.1)),
        (kinks(), NonExistence(0.2)),
        (market(), Infeasibility(0.002)),
    ],
)
def test_what_the_cheapest_privacy_costs_is_affordable(problem, measure):
    given = action_grid(problem, 12) if measure.searches_actions else decoy_grid(problem, 12)
    for belief in ([0.6, 0.4], [0.0855, 0.9145]):
        least = cheapest_privacy(problem, belief, measure, privacy=0.0, candidates=given).regret
        if np.isinf(least):
            continue
        for maker in (CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker):
            decided = maker(problem, measure, Budget.regret(1.001 * least), candidates=given).decide(belief)
            assert decided.status is not DecisionStatus.NO_AFFORDABLE_PRIVACY
            regret = decided.expected_regret if hasattr(decided, "expected_regret") else decided.regret
            assert regret <= 1.001 * least
