"""The privacy that a decision states is the action's own, as an observer recomputes it, whatever the least slack."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import (
    CounterAdversarialDecisionMaker,
    DesiredObfuscation,
    MarkowitzProblem,
    MaximalObfuscation,
    ProbabilisticDecisionMaker,
    box,
    consistent_beliefs,
    decoy_grid,
    simplex,
)
from oracles.large_markets import large_market
from oracles.markets import random_market
from sizes import audited, instances, paired

SIZES = {
    2: (4, 60),
    3: (6, 45 if audited() else 20),
    4: (6, 12 if audited() else 8),
    5: (7, 8 if audited() else 5),
}  # assets, and resolution of the candidates, by states
BELIEFS = instances(6, least=1)


def markets(n_states, min_slack, rng):
    """An ordinary market, one in which few assets are held, and one whose weights are capped."""
    n_assets, _ = SIZES[n_states]
    region = simplex(n_assets, min_slack=min_slack)
    capped = region & box(np.zeros(n_assets), np.full(n_assets, 0.45), min_slack=min_slack)
    yield MarkowitzProblem(*random_market(rng, n_states, n_assets), region)
    yield MarkowitzProblem(*large_market(n_states, n_assets, int(rng.integers(2**31)), 1.0), region)
    yield MarkowitzProblem(*large_market(n_states, n_assets, int(rng.integers(2**31)), 1.0), capped)


@pytest.mark.parametrize(("n_states", "min_slack"), paired(list(SIZES), [0.0, 1e-4]))
def test_the_stated_privacy_is_recomputed_from_the_action(n_states, min_slack, fresh_rng):
    check_stated(n_states, min_slack, fresh_rng)


def test_a_decision_that_no_belief_explains_by_a_rounding():
    """One of five states: the belief that it was found with violated a row of its own set by 2.4e-10, and 1e-10 is allowed."""
    check_stated(5, 1e-4, np.random.default_rng(4006951687))


def check_stated(n_states, min_slack, fresh_rng):
    for problem in markets(n_states, min_slack, fresh_rng):
        candidates = decoy_grid(problem, SIZES[n_states][1])
        beliefs = fresh_rng.dirichlet(np.ones(n_states), BELIEFS)
        for measure in (MaximalObfuscation(), DesiredObfuscation(fresh_rng.dirichlet(np.ones(n_states)))):
            given = {"measure": measure, "budget": 0.1, "candidates": candidates}
            single = CounterAdversarialDecisionMaker(problem, **given).decide_many(beliefs)
            mixed = ProbabilisticDecisionMaker(problem, **given).decide_many(beliefs)
            for t, belief in enumerate(beliefs):
                lottery = mixed[t]
                actions = [single[t].action, *lottery.actions]
                for stated, action in zip([single[t].privacy, *lottery.privacies], actions, strict=True):
                    own = measure(belief, consistent_beliefs(problem, action))
                    assert stated == pytest.approx(own, abs=1e-6), (measure, belief, action)
                    assert problem.constraints.is_admissible(action)
                assert single[t].privacy_bound >= single[t].privacy
                assert lottery.privacy_bound >= lottery.expected_privacy
