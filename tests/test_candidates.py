"""Sets of decisions to choose from: grids, samples, decoys, and those that lie outside."""

from __future__ import annotations

import tracemalloc
from itertools import product
from math import comb

import numpy as np
import pytest

from effort import at_most_calls
from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    Envelope,
    FiniteProblem,
    InputError,
    LinearProgramme,
    MarkowitzProblem,
    ModelError,
    NaiveAdversary,
    Polyhedron,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    action_grid,
    box,
    consistent_beliefs,
    decoy_grid,
    privacy_frontier,
    random_candidates,
    simplex,
    simplex_grid,
)
from inscrutable.decision_makers.candidates import make_candidates
from oracles import markets
from strategies import belief_problem, line_problem


@pytest.fixture(scope="module")
def problem():
    return MarkowitzProblem(*markets.random_market(np.random.default_rng(5), 3, 4))


def test_decoys_are_explained_by_their_own_beliefs(problem):
    candidates = decoy_grid(problem, 8)
    assert len(candidates) == comb(10, 2)
    np.testing.assert_array_equal(candidates.decoys, simplex_grid(3, 8))
    np.testing.assert_allclose(candidates.actions, problem.solve(candidates.decoys), atol=1e-13)
    np.testing.assert_allclose(candidates.state_costs, problem.state_costs(candidates.actions), rtol=1e-12)
    assert (candidates.sets.dimension >= 0).all()
    assert candidates.n_outside == 0
    for index, decoy in enumerate(candidates.decoys):
        assert candidates.sets[index].distance(decoy) <= 1e-9


def test_the_papers_grid_has_861_actions():
    candidates = action_grid(belief_problem(3), 40)
    assert len(candidates) == 861
    assert candidates.decoys is None
    np.testing.assert_allclose(candidates.actions.sum(axis=1), 1)
    assert len(np.unique(candidates.actions.round(9), axis=0)) == 861


def test_a_grid_over_a_box_with_a_budget_row_is_brute_force():
    region = box([0.0, 0.0, -0.5], [1.0, 0.5, 0.5]) & Polyhedron(A_eq=[[1.0, 1.0, 1.0]], b_eq=[1.0])
    problem = QuadraticProblem([np.eye(3)] * 2, np.zeros((2, 3)), constraints=region)
    found = action_grid(problem, 4).actions
    # Coordinates follow from the others; the library leaves out one of them.
    assert (region.violation(found) <= 1e-9).all()
    np.testing.assert_allclose(found.sum(axis=1), 1, atol=1e-12)
    ticks = [np.linspace(low, high, 5) for low, high in region.bounding_box]
    counts = []
    for left_out in range(3):
        kept = [j for j in range(3) if j != left_out]
        points = np.zeros((25, 3))
        points[:, kept] = list(product(ticks[kept[0]], ticks[kept[1]]))
        points[:, left_out] = 1 - points.sum(axis=1)
        counts.append({tuple(row) for row in points[region.violation(points) <= 1e-9].round(9).tolist()})
    assert {tuple(row) for row in found.round(9).tolist()} in counts


def test_random_decisions_are_uniform_on_the_simplex(problem):
    candidates = random_candidates(problem, 4000, rng=np.random.default_rng(0))
    np.testing.assert_allclose(candidates.actions.mean(axis=0), 0.25, atol=0.02)
    assert (candidates.actions > 0.5).mean() == pytest.approx(0.5**3, abs=0.02)  # P(u_j > ½) = (1 − ½)³
    again = random_candidates(problem, 4000, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(candidates.actions, again.actions)


def test_random_decisions_stay_in_a_general_set_and_fill_it():
    region = simplex(3) & box([0, 0, 0], [0.5, 0.6, 1.0]) & Polyhedron([[1.0, 1.0, 0.0]], [0.8])
    problem = QuadraticProblem([np.eye(3)] * 2, np.zeros((2, 3)), constraints=region)
    points = random_candidates(problem, 3000, rng=np.random.default_rng(1)).actions
    assert region.violation(points).max() <= 1e-12
    uniform = np.random.default_rng(2).dirichlet(np.ones(3), 40_000)
    uniform = uniform[region.violation(uniform) <= 0]
    np.testing.assert_allclose(points.mean(axis=0), uniform.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(points.std(axis=0), uniform.std(axis=0), atol=0.02)
    pinned = QuadraticProblem([np.eye(2)], np.zeros((1, 2)), constraints=Polyhedron(A_eq=np.eye(2), b_eq=[0.3, 0.7]))
    np.testing.assert_allclose(random_candidates(pinned, 3, rng=np.random.default_rng(0)).actions, [[0.3, 0.7]] * 3)


def test_random_decisions_fill_a_flat_set_written_with_inequalities():
    """Σu <= 1 and −Σu <= −1 say what Σu = 1 says."""
    flat = Polyhedron(np.vstack([-np.eye(2), np.ones(2), -np.ones(2)]), [0.0, 0.0, 1.0, -1.0])
    problem = QuadraticProblem([np.eye(2)] * 2, np.zeros((2, 2)), constraints=flat)
    points = random_candidates(problem, 500, rng=np.random.default_rng(0)).actions
    np.testing.assert_allclose(points.sum(axis=1), 1, atol=1e-9)
    assert points[:, 0].std() == pytest.approx(1 / np.sqrt(12), abs=0.05)


def test_random_decisions_fill_a_set_whose_optimal_decisions_share_a_corner():
    size = 6
    region = simplex(size) & box([0.0] * size, [0.9] * size)
    problem = QuadraticProblem(np.zeros((2, size, size)), np.tile(-np.arange(size), (2, 1)), constraints=region)
    points = random_candidates(problem, 3000, rng=np.random.default_rng(1)).actions
    np.testing.assert_allclose(points.mean(axis=0), 1 / size, atol=0.03)
    assert len(np.unique(points.round(9), axis=0)) == 3000


def test_candidates_outside_are_counted_and_never_chosen(problem):
    own = problem.solve([0.3, 0.3, 0.4])
    actions = np.vstack([[2.0, -1.0, 0.0, 0.0], [0.5, 0.5, 0.5, 0.5], np.eye(4), own, [1 + 1e-6, -1e-6, 0, 0]])
    for maker in (ProbabilisticDecisionMaker, CounterAdversarialDecisionMaker):
        chooser = maker(problem, budget=Budget.regret(10.0), candidates=actions)
        assert chooser.candidates.n_outside == 3
        assert chooser.candidates.usable.tolist() == [False, False, True, True, True, True, True, False]
        assert "3 outside the feasible set" in chooser.candidates.summary()
        decided = chooser.decide([0.3, 0.3, 0.4])
        for action in np.atleast_2d(getattr(decided, "actions", getattr(decided, "action", None))):
            assert problem.constraints.violation(action) <= 1e-9


@pytest.mark.parametrize("method", [LinearProgramme(), Envelope()], ids=["programme", "envelope"])
def test_neither_outside_nor_inadmissible_decisions_are_chosen_however_private(method):
    """Each would be the most private by far: beliefs explain it, and the true one is far from them."""
    problem = line_problem([4.0, 0.0], min_slack=1e-2)  # u_1 = ½ + π_1, up to 1
    actions = np.array([[1.05, -0.05], [0.995, 0.005], [0.6, 0.4]])
    chooser = ProbabilisticDecisionMaker(problem, budget=Budget.regret(10.0), candidates=actions, method=method)
    assert chooser.candidates.usable.tolist() == [False, False, True]
    assert chooser.candidates.n_outside == 1
    apart = chooser.candidates.sets.distances(np.array([0.0, 1.0]))
    np.testing.assert_allclose(apart, np.sqrt(2) * np.array([0.55, 0.495, 0.1]), atol=1e-9)
    mixed = chooser.decide([0.0, 1.0])
    if isinstance(method, LinearProgramme):
        np.testing.assert_array_equal(mixed.actions, actions[2:])
    assert problem.constraints.is_admissible(mixed.actions).all()
    frontier = privacy_frontier(problem, [0.0, 1.0], candidates=actions)
    assert set(frontier.indices.tolist()) == {2, 3}


def test_joined_candidates_are_both(problem):
    first, second = decoy_grid(problem, 3), decoy_grid(problem, 4)
    both = first.joined(second)
    assert len(both) == len(first) + len(second)
    np.testing.assert_array_equal(both.actions, np.vstack([first.actions, second.actions]))
    belief = np.array([0.2, 0.5, 0.3])
    np.testing.assert_allclose(
        both.sets.distances(belief), np.concatenate([first.sets.distances(belief), second.sets.distances(belief)])
    )
    assert first.joined(action_grid(problem, 2)).decoys is None


def test_equal_decisions_share_their_set(problem):
    candidates = decoy_grid(problem, 10)
    for index, first in enumerate(candidates.sets.distinct):
        np.testing.assert_allclose(candidates.actions[index], candidates.actions[first], atol=1e-10)
        if candidates.sets.distinct[index] != index:
            assert candidates.sets[index] is candidates.sets[int(first)]


def cornered_problem():
    """Where little is at stake in risk, whole regions of beliefs hold one asset: many decoys share a corner decision."""
    return MarkowitzProblem(np.eye(3, 4), [0.2 * np.eye(4)] * 3, 1.0)


def brute_force_first_equal(actions):
    """For every row the first one that equals it, by comparing all pairs."""
    near = np.abs(actions[:, None] - actions[None]).max(axis=2) <= 1e-11
    return near.argmax(axis=1)


def test_decoys_that_share_a_decision_are_known():
    problem = cornered_problem()
    candidates = decoy_grid(problem, 12)
    same_as, distinct = candidates.same_as, candidates.distinct
    np.testing.assert_array_equal(same_as, brute_force_first_equal(candidates.actions))
    np.testing.assert_array_equal(distinct, np.unique(same_as))
    assert 3 < len(distinct) < len(candidates) - 20
    for corner in np.eye(4)[:3]:
        sharing = np.flatnonzero((candidates.actions == corner).all(axis=1))
        assert len(sharing) > 5
        assert (same_as[sharing] == sharing[0]).all()
        # Each of them is explained by the decoys of all: they are one set.
        for decoy in candidates.decoys[sharing]:
            assert candidates.sets[int(sharing[0])].distance(decoy) <= 1e-9
    np.testing.assert_allclose(candidates.actions[same_as], candidates.actions, rtol=0, atol=1e-11)
    assert f"{len(candidates)} candidates ({len(distinct)} distinct, " in candidates.summary()
    count = int(candidates.usable.sum())
    assert f"{count} admissible, {count} of them explained by a belief" in candidates.summary()


def test_shared_decisions_are_found_across_joined_candidates():
    problem = cornered_problem()
    both = decoy_grid(problem, 6).joined(decoy_grid(problem, 9))
    np.testing.assert_array_equal(both.same_as, brute_force_first_equal(both.actions))
    assert (both.same_as[28:] < 28).sum() > 10


def test_memory_counts_every_array_once(problem):
    candidates = decoy_grid(problem, 30)
    held = [candidates.actions, candidates.state_costs, candidates.decoys, candidates.usable]
    least = sum(each.nbytes for each in held) + candidates.sets.dimension.nbytes + candidates.sets.start.nbytes
    assert least < candidates.memory <= len(candidates) * (8 * 4 + 32 * 3 + 40) + 4096
    assert f"{candidates.memory / 1e6:.1f} MB" in candidates.summary()
    own = ProbabilisticDecisionMaker(problem, candidates=np.eye(4)).candidates
    assert own.memory < 4 * 300
    assert own.covering_radius == np.inf
    assert "of a decoy" not in own.summary()


def test_what_every_search_needs_outlives_the_searches_that_are_forgotten(problem):
    candidates = decoy_grid(problem, 5)
    needed = candidates.once("needed", object)
    first = candidates.once(0, object)
    for key in range(1, 10_000):
        assert candidates.once("needed", object) is needed
        candidates.once(key, object)
    assert candidates.once(0, object) is not first
    assert len(candidates.decided) < 5000


def test_candidates_are_made_in_blocks(monkeypatch):
    """Besides what is kept, nothing of the size of all decisions is made: not even one copy of their slacks."""
    problem = MarkowitzProblem(np.eye(6, 12), [np.eye(12)] * 6, 1.0)
    sets = decoy_grid(problem, 2).sets
    monkeypatch.setattr("inscrutable.decision_makers.candidates.consistent_sets", lambda *given: sets)
    actions = np.random.default_rng(0).dirichlet(np.ones(12), 100_000)
    tracemalloc.start()
    made = make_candidates(problem, actions)
    np.testing.assert_array_equal(made.same_as, np.arange(len(made)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    kept = made.actions.nbytes + made.state_costs.nbytes
    assert peak <= 1.8 * kept < kept + made.state_costs.nbytes * 12


def test_a_regular_grid_where_it_is_affordable_and_a_cover_where_not(monkeypatch):
    monkeypatch.setattr("inscrutable.decision_makers.candidate_sources.MOST_DECOYS", 3000)
    few = MarkowitzProblem(np.eye(3), [np.eye(3)] * 3, 1.0)
    np.testing.assert_array_equal(decoy_grid(few, 75).decoys, simplex_grid(3, 75))
    np.testing.assert_array_equal(decoy_grid(few, 1000).decoys, simplex_grid(3, 76))  # 3,003: within two per cent
    many = MarkowitzProblem(np.eye(8, 3), [np.eye(3)] * 8, 1.0)
    np.testing.assert_array_equal(decoy_grid(many, 6).decoys, simplex_grid(8, 6))
    capped = decoy_grid(many, 1000)
    assert 3000 <= len(capped) <= 3750
    assert (capped.decoys.min(axis=1) > 0).mean() > 0.2
    np.testing.assert_allclose(capped.decoys.sum(axis=1), 1, atol=1e-12)
    np.testing.assert_array_equal(capped.decoys, decoy_grid(many, 2000).decoys)
    assert f"every belief within about {capped.covering_radius:.2g} of a decoy" in capped.summary()


@pytest.mark.parametrize("n_states", [7, 8, 10, 12])
def test_default_decoys_of_many_states_reach_the_faces_and_the_interior(n_states):
    problem = MarkowitzProblem(np.eye(n_states, 2), [np.eye(2)] * n_states, 1.0)
    candidates = ProbabilisticDecisionMaker(problem).candidates
    assert 5000 <= len(candidates) <= 6300
    held = (candidates.decoys > 0).sum(axis=1)
    assert (held == 1).sum() == n_states
    assert (held == n_states).mean() > 0.15


def test_candidates_are_refused_where_malformed(problem):
    rng = np.random.default_rng(0)
    for make in (
        lambda: decoy_grid(problem, 0),
        lambda: decoy_grid(problem, 2.5),
        lambda: action_grid(problem, 0),
        lambda: action_grid(problem, 10_000),
        lambda: random_candidates(problem, 0, rng=rng),
        lambda: random_candidates(problem, 5, rng=0),
        lambda: random_candidates(problem, 5, rng=np.random.RandomState(0)),
        lambda: ProbabilisticDecisionMaker(problem, candidates=np.ones((3, 2))).candidates,
        lambda: ProbabilisticDecisionMaker(problem, candidates=np.ones(4)).candidates,
        lambda: ProbabilisticDecisionMaker(problem, candidates=np.full((2, 4), np.nan)).candidates,
        lambda: ProbabilisticDecisionMaker(problem, candidates=np.zeros((0, 4))).candidates,
        lambda: ProbabilisticDecisionMaker(problem, candidates=decoy_grid(belief_problem(3), 3)).candidates,
    ):
        with pytest.raises(InputError):
            make()


def test_candidates_of_another_problem_of_the_same_shape_are_refused():
    """State costs and sets belong to a problem: with another one's, regrets and privacies would be nonsense."""
    first = MarkowitzProblem(*markets.random_market(np.random.default_rng(1), 3, 3))
    second = MarkowitzProblem(*markets.random_market(np.random.default_rng(2), 3, 3))
    with pytest.raises(InputError, match="problem"):
        ProbabilisticDecisionMaker(second, candidates=decoy_grid(first, 3)).decide([0.3, 0.3, 0.4])


def test_an_unbounded_set_has_no_grid_and_no_uniform_law():
    problem = QuadraticProblem([np.eye(2)] * 2, np.eye(2), constraints=Polyhedron([[-1.0, 0.0]], [0.0]))
    with pytest.raises(ModelError, match="unbounded in coordinate"):
        action_grid(problem, 5)
    with pytest.raises(ModelError, match="unbounded in coordinate"):
        random_candidates(problem, 5, rng=np.random.default_rng(0))
    assert len(decoy_grid(problem, 5)) == 6


@pytest.mark.parametrize("n_states", [1, 2, 3, 4, 5, 6])
def test_default_candidates_are_about_five_thousand(n_states):
    problem = MarkowitzProblem(np.eye(n_states, 2), [np.eye(2)] * n_states, 1.0)
    size = len(ProbabilisticDecisionMaker(problem).candidates)
    assert size == 1 if n_states == 1 else 1500 <= size <= 5200


def test_choices_in_many_states_are_decided_at_once(fresh_rng):
    """What explains one of six choices in 25 states has tens of thousands of corners: neither decoys, decisions nor
    observers' estimates need them."""
    CounterAdversarialDecisionMaker(FiniteProblem(fresh_rng.uniform(size=(4, 3)))).decide(np.full(4, 0.25))  # compiled
    problem = FiniteProblem(fresh_rng.uniform(size=(25, 6)))
    belief = fresh_rng.dirichlet(np.ones(25))
    with at_most_calls(100_000):  # 19,000 when written
        decision = CounterAdversarialDecisionMaker(problem, budget=0.3).decide(belief)
        candidates = decoy_grid(problem, 1)
        estimates = NaiveAdversary(problem).estimates(candidates.actions)
    for action, estimate in zip(candidates.actions, estimates, strict=True):
        assert consistent_beliefs(problem, action).contains(estimate)
    assert consistent_beliefs(problem, decision.action).contains(decision.decoy)
    for action, decoy in zip(candidates.actions, candidates.decoys, strict=True):
        expected = decoy @ problem.costs
        assert expected[action.argmax()] <= expected.min() + 1e-9
