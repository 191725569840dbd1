"""The search against a plain one: random decoys brought to the budget along their rays, each judged by its own set."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    FiniteProblem,
    LinearProblem,
    MarkowitzProblem,
    PowerNetwork,
    ProbabilisticDecisionMaker,
    box,
    consistent_beliefs,
    decoy_grid,
    dispatch_problem,
    simplex,
)
from oracles.large_markets import large_market
from oracles.markets import random_market
from sizes import instances, some
from test_audit import drawn_case

DECOYS = instances(4000)
HALVINGS = 30
JUDGED = 60


def best_at_random(problem, belief, share_of_cost, rng):
    """The most private of admissible decisions on random rays, each as far out as the budget allows; 0 for the optimal one."""
    decoys = rng.dirichlet(np.full(problem.n_states, rng.choice([0.3, 1.0])), DECOYS)
    optimal = float(problem.optimal_cost(belief))
    budget = share_of_cost * abs(optimal)
    low, high = np.zeros(DECOYS), np.ones(DECOYS)
    for step in range(HALVINGS):
        share = high if step == 0 else 0.5 * (low + high)
        actions = problem.as_points(problem.solve(belief + share[:, None] * (decoys - belief)))
        fits = problem.state_costs(actions) @ belief - optimal <= budget
        low, high = np.where(fits, share, low), np.where(fits, high, share)
    actions = problem.as_points(problem.solve(belief + low[:, None] * (decoys - belief)))
    costs = problem.state_costs(actions) @ belief - optimal
    kept = problem.constraints.is_admissible(actions) & (costs <= budget)
    # A decoy is in its set, so no set is farther than its decoy: the farthest first, until none can be farther.
    order = np.flatnonzero(kept)[np.argsort(-low[kept] * np.linalg.norm(decoys[kept] - belief, axis=1))][:JUDGED]
    sets = (consistent_beliefs(problem, problem.as_actions(actions[i])) for i in order)
    return max((each.distance(belief) for each in sets if not each.is_empty), default=0.0)


def doubled(rng):
    """A market of three states and one more that costs what the first does."""
    means, covariances, risk = random_market(rng, 3, 5)
    return MarkowitzProblem(np.vstack([means, means[:1]]), np.concatenate([covariances, covariances[:1]]), risk)


def capped(rng):
    region = simplex(9) & box(np.zeros(9), np.full(9, 0.45))
    return MarkowitzProblem(*large_market(4, 9, int(rng.integers(2**31)), 1.0), region)


def few_assets(rng):
    """More states than free coordinates of a decision."""
    return MarkowitzProblem(*random_market(rng, 5, 3))


def dispatch(rng):
    """Four regimes of two wind farms: more regimes than there are farms and one more, so that beliefs share schedules."""
    lines = ([[0, 1], [1, 2], [0, 2]], [[0.1, 80.0], [0.1, 80.0], [0.1, 80.0]])
    quadratic, linear = rng.uniform(0.01, 0.1, 3), rng.uniform(2.0, 9.0, 3)
    network = PowerNetwork([60.0, 40.0, 80.0], [0, 1, 2], [90.0, 80.0, 90.0], quadratic, linear, *lines)
    return dispatch_problem(network, [0, 2], rng.uniform(5.0, 60.0, (4, 2)), rng.uniform(1.0, 8.0, (4, 2)))


PROBLEMS = {
    "dispatch": dispatch,
    "ordinary": lambda rng: MarkowitzProblem(*random_market(rng, 3, 9)),
    "concentrated": lambda rng: MarkowitzProblem(*large_market(4, 9, int(rng.integers(2**31)), 1.0)),
    "two states alike": doubled,
    "capped": capped,
    "more states than assets": few_assets,
    "finite": lambda rng: FiniteProblem(rng.uniform(0.5, 1.0, (4, 6))),
    "linear": lambda rng: LinearProblem(rng.uniform(0.5, 1.0, (4, 5)), simplex(5)),
}


def assert_not_below_random(problem, belief, share, rng):
    least = best_at_random(problem, belief, share, rng)
    found = CounterAdversarialDecisionMaker(problem, budget=share).decide(belief)
    assert found.privacy >= 0.99 * least - 1e-6, (belief, found.privacy, least)


@pytest.mark.parametrize("name", [name for name in PROBLEMS if name not in ("dispatch", "capped")])
def test_the_search_finds_what_random_decoys_find(name, fresh_rng):
    problem = PROBLEMS[name](fresh_rng)
    assert_not_below_random(problem, fresh_rng.dirichlet(np.ones(problem.n_states)), 0.1, fresh_rng)


@pytest.mark.parametrize(
    ("name", "seed", "share"),
    [
        ("dispatch", 1, 0.1),
        ("dispatch", 4, 0.01),
        ("dispatch", 9, 0.1),
        ("capped", 6, 0.01),
        ("two states alike", 5, 0.01),
    ],
)
def test_the_search_finds_what_random_decoys_find_where_beliefs_share_decisions(name, seed, share):
    rng = np.random.default_rng(seed)
    problem = PROBLEMS[name](rng)
    assert_not_below_random(problem, rng.dirichlet(np.ones(problem.n_states)), share, rng)


STEPS = (-1e-2, -1e-3, -1e-4, 1e-4, 1e-3, 1e-2)


def gain_along_edges(problem, belief, mixed, share_of_cost):
    """How much a lottery gains where an atom that a belief in two states explains moves along their edge."""
    optimal, gain = float(problem.optimal_cost(belief)), 0.0
    limit = share_of_cost * abs(optimal)
    for moved, fixed in ((0, -1), (-1, 0)):
        decoy, kept = mixed.decoys[moved], (float(mixed.regrets[fixed]), float(mixed.privacies[fixed]))
        held = np.flatnonzero(decoy > 1e-5)
        if len(held) != 2:
            continue
        for step in STEPS:
            tried = np.zeros(problem.n_states)
            tried[held] = np.clip(decoy[held] + [step, -step], 0.0, 1.0)
            action = problem.solve(tried / tried.sum())
            regret = float(problem.state_costs(action) @ belief) - optimal
            privacy = consistent_beliefs(problem, action).distance(belief)
            low, high = sorted([kept, (regret, privacy)])
            if low[0] <= limit < high[0]:
                chord = low[1] + (limit - low[0]) / (high[0] - low[0]) * (high[1] - low[1])
                gain = max(gain, chord - float(mixed.expected_privacy))
    return gain


@pytest.mark.parametrize("shape", [(4, 3), (5, 3), (6, 3)])
def test_no_step_along_an_edge_improves_a_lottery(shape, fresh_rng):
    problem, share = MarkowitzProblem(*random_market(fresh_rng, *shape)), 0.1
    maker = ProbabilisticDecisionMaker(problem, budget=share)
    for belief in fresh_rng.dirichlet(np.ones(shape[0]), instances(30)):
        mixed = maker.decide(belief)
        assert gain_along_edges(problem, belief, mixed, share) <= 1e-3 * float(mixed.expected_privacy)


def test_a_lottery_goes_on_to_where_two_edges_cross():
    """Beyond the crossing nearer beliefs explain the decision; steps that are cut there gain .4417 of .4436 in eight rounds."""
    rng = np.random.default_rng(63)
    problem = MarkowitzProblem(*random_market(rng, 6, 3))
    belief = rng.dirichlet(np.ones(6), 40)[29]
    assert ProbabilisticDecisionMaker(problem, budget=0.1).decide(belief).expected_privacy > 0.4436


def test_a_climb_along_an_edge_spends_the_whole_budget():
    """The end of the climb may exceed the budget by rounding; refused for that, one of these loses 1e-5 of its privacy."""
    rng = np.random.default_rng(5)
    problem = dispatch(rng)
    maker, beliefs = CounterAdversarialDecisionMaker(problem, budget=0.1), rng.dirichlet(np.ones(4), 3)
    many = maker.decide_many(beliefs)
    np.testing.assert_allclose(many.privacy, [maker.decide(belief).privacy for belief in beliefs], rtol=1e-7)
    spent = many.regret / np.abs(many.optimal_cost)
    assert 0.1 * (1 - 1e-6) <= spent[1] <= 0.1


@pytest.mark.parametrize("drawn", some([95, *range(400, 404)], 2))
def test_no_decision_is_below_the_best_of_its_candidates(drawn: int) -> None:
    market, belief, budget = drawn_case(drawn)
    problem = MarkowitzProblem(*market)
    candidates = decoy_grid(problem, 30)
    costs = candidates.state_costs @ belief - float(problem.optimal_cost(belief))
    fits = candidates.usable & (costs <= budget)
    sets = [consistent_beliefs(problem, each) for each in np.unique(candidates.actions[fits], axis=0)]
    best = max((each.distance(belief) for each in sets if not each.is_empty), default=0.0)
    maker = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(budget), candidates=candidates)
    assert maker.decide(belief).privacy >= best * (1.0 - 1e-6)


@pytest.mark.parametrize(
    ("size", "seed", "conc", "which", "decoy"),
    [
        ((6, 5), 6051, 0.5, 2, [0.6018, 0.0525, 0.0, 0.3457, 0.0, 0.0]),
        ((8, 4), 8052, 1.0, 4, [0.1302, 0.8622, 0.0, 0.0, 0.0, 0.0, 0.0076, 0.0]),
    ],
)
def test_narrow_faces_are_found_where_assets_are_as_few_as_states(size, seed, conc, which, decoy):
    """Beside this decision others of half its privacy or less are far more numerous: no start may be skipped."""
    rng, (n_states, n_assets) = np.random.default_rng(seed), size
    means = rng.normal(0.0, 0.02, size)
    roots = [rng.normal(size=(n_assets, n_assets)) * 0.05 for _ in range(n_states)]
    covariances = [root @ root.T + 0.0005 * np.eye(n_assets) for root in roots]
    problem = MarkowitzProblem(means, covariances, 1.0 if seed % 2 else 5.0)
    belief = rng.dirichlet(np.full(n_states, conc), 5)[which]
    known = problem.solve(np.array(decoy) / np.sum(decoy))
    assert problem.regret(belief, known) <= 0.1 * abs(problem.optimal_cost(belief))
    least = consistent_beliefs(problem, known).distance(belief)
    assert CounterAdversarialDecisionMaker(problem, budget=0.1).decide(belief).privacy >= least * (1.0 - 5e-4)
