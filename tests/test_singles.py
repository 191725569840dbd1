"""Single decisions for many beliefs at once: the walk in the plane against the search face by face, and prices."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DesiredObfuscation,
    MarkowitzProblem,
    MaximalObfuscation,
    consistent_beliefs,
    decoy_grid,
)
from inscrutable.decision_makers.results import DecisionStatus
from inscrutable.decision_makers.search.atlas import atlas_of
from inscrutable.decision_makers.search.face_search import most_private
from inscrutable.decision_makers.search.singles import stream_singles
from inscrutable.decision_makers.search.streaming import OWN, Aims
from inscrutable.kernels import threads
from inscrutable.kernels.climb import Aim
from oracles.markets import random_market

BUDGETS = (0.003, 0.03, 0.3)
TARGET = {2: [0.7, 0.3], 3: [0.6, 0.3, 0.1]}


def spread(n_states: int, n_assets: int, resolution: int, twin: bool = False):
    means, covariances, aversion = random_market(np.random.default_rng([5, n_states, n_assets]), n_states, n_assets)
    if twin:
        means[:, 1] = means[:, 0]
        covariances[:, 1], covariances[:, :, 1] = covariances[:, 0], covariances[:, :, 0]
        covariances[:, 1, 1] = covariances[:, 0, 0]
    problem = MarkowitzProblem(means, covariances, aversion)
    return problem, decoy_grid(problem, resolution)


def beliefs_of(n_states: int, count: int):
    rng = np.random.default_rng([6, n_states])
    drawn = np.concatenate([rng.dirichlet(np.ones(n_states), count), rng.dirichlet(np.full(n_states, 20.0), count)])
    drawn[0] = np.eye(n_states)[0]
    drawn[1] = np.eye(n_states)[-1] * 0.4 + np.eye(n_states)[0] * 0.6  # a regime of probability zero, for X > 2
    return drawn


@pytest.mark.parametrize("toward", [False, True], ids=["away", "toward"])
@pytest.mark.parametrize(
    ("n_states", "n_assets", "resolution", "twin"),
    [
        (3, 3, 100, False),
        (3, 6, 100, False),
        (3, 12, 100, False),
        (2, 4, 200, False),
        (3, 4, 24, True),
        (3, 1, 12, False),
    ],
)
def test_many_are_as_private_as_each_alone(n_states, n_assets, resolution, twin, toward):
    problem, candidates = spread(n_states, n_assets, resolution, twin)
    beliefs = beliefs_of(n_states, 16)
    measure = DesiredObfuscation(TARGET[n_states]) if toward else MaximalObfuscation()
    exact, compared = 0, 0
    for budget in BUDGETS:
        chooser = CounterAdversarialDecisionMaker(problem, measure, budget, candidates=candidates)
        many = chooser.decide_many(beliefs)
        for step in range(0, len(beliefs), 3):
            alone = chooser.decide(beliefs[step])
            assert many.privacy[step] >= alone.privacy - 1e-6
            exact += abs(many.privacy[step] - alone.privacy) <= 1e-9
            compared += 1
            one = many[step]
            assert one.regret <= budget * abs(one.optimal_cost) * (1 + 1e-9) + 1e-15
            assert problem.constraints.is_admissible(one.action)
            assert float(problem.regret(beliefs[step], one.action)) == pytest.approx(one.regret, abs=1e-10)
            recomputed = measure(beliefs[step], consistent_beliefs(problem, one.action))
            assert recomputed == pytest.approx(one.privacy, abs=1e-6)
            np.testing.assert_allclose(many.action[step], one.action, atol=1e-15)
    assert exact >= 0.9 * compared


@pytest.mark.parametrize("toward", [False, True], ids=["away", "toward"])
@pytest.mark.parametrize("n_assets", [3, 6])
def test_the_price_is_the_slope_of_the_best_privacy(n_assets, toward):
    problem, candidates = spread(3, n_assets, 100)
    beliefs = beliefs_of(3, 20)
    measure = DesiredObfuscation(TARGET[3]) if toward else MaximalObfuscation()
    regret = 0.02 * float(np.abs(problem.optimal_cost(beliefs)).mean())
    step = 1e-4 * regret

    def decided(amount):
        return CounterAdversarialDecisionMaker(
            problem, measure, Budget.regret(amount), candidates=candidates
        ).decide_many(beliefs)

    low, middle, high = decided(regret - step), decided(regret), decided(regret + step)
    slope = (high.privacy - low.privacy) / (2 * step)
    assert middle.price.min() >= 0
    assert middle.price.max() > 0
    near = np.abs(middle.price - slope) <= 1e-3 * np.abs(slope) + 1e-6
    assert near.mean() >= 0.9  # elsewhere the best privacy has a kink within the step
    alone = CounterAdversarialDecisionMaker(problem, measure, Budget.regret(regret), candidates=candidates)
    for t in range(0, len(beliefs), 9):
        assert alone.decide(beliefs[t]).price == pytest.approx(middle.price[t], rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("toward", [False, True], ids=["away", "toward"])
@pytest.mark.parametrize(("n_assets", "budget"), [(3, 0.02), (3, 0.2), (6, 0.1)])
def test_the_walk_reaches_what_the_search_by_faces_does(n_assets, budget, toward):
    problem, candidates = spread(3, n_assets, 100)
    beliefs = beliefs_of(3, 60)
    points = np.tile(TARGET[3], (len(beliefs), 1)) if toward else beliefs
    aims = Aims(points, -1.0 if toward else 1.0, (Budget(budget),))
    atlas = atlas_of(problem, candidates)
    walked = stream_singles(atlas, beliefs, aims)
    short = []
    for t, belief in enumerate(beliefs):
        cost = float(problem.optimal_cost(belief))
        aim = Aim(belief, points[t], aims.sign, cost, budget * abs(cost), 0.0)
        found = most_private(atlas, aim, problem.solve(belief))
        short.append(0.0 if found is None else found.privacy - walked.privacy[t, 0])
    # Either search may end at the lower of two peaks, now and then.
    assert np.mean(np.array(short) <= 1e-6) >= 0.97
    assert max(short) <= 0.01


def test_budgets_are_served_together_as_alone():
    problem, candidates = spread(3, 6, 100)
    atlas, beliefs = atlas_of(problem, candidates), beliefs_of(3, 20)
    budgets = (Budget(0.0), Budget(0.01), Budget(0.1))
    together = stream_singles(atlas, beliefs, Aims(beliefs, 1.0, budgets))
    assert (together.index[:, 0] == OWN).all()
    assert (np.diff(together.privacy, axis=1) >= -1e-9).all()
    for b in range(3):
        alone = stream_singles(atlas, beliefs, Aims(beliefs, 1.0, budgets[b : b + 1]))
        np.testing.assert_array_equal(together.privacy[:, b], alone.privacy[:, 0])
        np.testing.assert_array_equal(together.actions(b, slice(None)), alone.actions(0, slice(None)))


def test_candidates_far_apart_are_left_to_the_search_by_faces():
    problem, candidates = spread(3, 3, 10)
    beliefs = beliefs_of(3, 3)
    aims = Aims(beliefs, 1.0, (Budget(0.1),))
    assert stream_singles(atlas_of(problem, candidates), beliefs, aims) is None
    chooser = CounterAdversarialDecisionMaker(problem, budget=0.1, candidates=candidates)
    np.testing.assert_array_equal(chooser.decide_many(beliefs).privacy, [chooser.decide(b).privacy for b in beliefs])


def test_the_number_of_threads_changes_no_byte(monkeypatch):
    problem, candidates = spread(3, 6, 100)
    chooser = CounterAdversarialDecisionMaker(problem, budget=0.05, candidates=candidates)
    beliefs, seen = beliefs_of(3, 150), []
    for count in (1, 2, 4):
        monkeypatch.setattr(threads, "thread_count", lambda count=count: count)
        many = chooser.decide_many(beliefs)
        seen.append((many.privacy.tobytes(), many.regret.tobytes(), many.action.tobytes(), many.price.tobytes()))
    assert seen[0] == seen[1] == seen[2]


def test_progress_ends_at_the_last_belief_and_an_interrupt_is_raised():
    problem, candidates = spread(3, 3, 100)
    chooser = CounterAdversarialDecisionMaker(problem, budget=0.05, candidates=candidates)
    beliefs, seen = beliefs_of(3, 150), []
    chooser.decide_many(beliefs, progress=lambda done, count: seen.append((done, count)))
    assert seen[-1] == (300, 300)
    assert seen == sorted(seen)

    def interrupt(done, count):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        chooser.decide_many(beliefs, progress=interrupt)


def test_without_budget_the_optimal_decisions_are_played():
    problem, candidates = spread(3, 3, 40)
    beliefs = beliefs_of(3, 20)
    many = CounterAdversarialDecisionMaker(problem, budget=0.0, candidates=candidates).decide_many(beliefs)
    assert set(many.status) == {DecisionStatus.NO_AFFORDABLE_PRIVACY}
    np.testing.assert_allclose(many.action, problem.solve(beliefs), atol=1e-12)
    assert not many.privacy.any()
    assert not many.price.any()
