"""Decisions on the border of those that some belief explains: no belief in the same states leads to a better one."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import CounterAdversarialDecisionMaker, MarkowitzProblem, NaiveAdversary, simplex_grid

BUDGET, RISK_AVERSION = 0.1, 5.0
CELLS = {3: 150, 4: 40}  # of a grid on beliefs in some states


def market(seed: int) -> tuple[MarkowitzProblem, np.ndarray]:
    """Five states and four assets, so that a decision's set has a dimension, and eight beliefs."""
    rng = np.random.default_rng(seed)
    factors = rng.normal(size=(5, 4, 4))
    means, covariances = 0.02 * rng.normal(size=(5, 4)), 0.01 * (factors @ factors.swapaxes(1, 2) / 4 + 0.1 * np.eye(4))
    return MarkowitzProblem(means, covariances, RISK_AVERSION), rng.dirichlet(np.ones(5), 8)


def shown(problem: MarkowitzProblem, action: np.ndarray, belief: np.ndarray) -> float:
    """The distance from a belief of what the observer infers."""
    return float(NaiveAdversary(problem).infer(action).distance(belief))


# Where the climb stopped at the first boundary that it met, each lost between .8 and 4.3 %.
@pytest.mark.parametrize(("seed", "number"), [(51, 5), (18, 4), (22, 0), (52, 4)])
def test_no_belief_in_the_same_states_leads_to_a_more_private_decision(seed: int, number: int) -> None:
    problem, beliefs = market(seed)
    belief = beliefs[number]
    found = CounterAdversarialDecisionMaker(problem, budget=BUDGET).decide(belief)
    assert found.privacy == pytest.approx(shown(problem, found.action, belief), rel=1e-6)
    likely = np.flatnonzero(found.decoy > 1e-4)
    grid = simplex_grid(len(likely), CELLS[len(likely)])
    decoys = np.zeros((len(grid), 5))
    decoys[:, likely] = grid
    actions = problem.solve(decoys)
    costs, optimal_cost = problem.state_costs(actions) @ belief, float(problem.optimal_cost(belief))
    affordable = costs - optimal_cost <= BUDGET * abs(optimal_cost)
    farther = np.linalg.norm(decoys - belief, axis=1) > found.privacy * 1.0005
    assert (affordable & farther).any()  # else nothing is compared
    others = [shown(problem, action, belief) for action in actions[affordable & farther]]
    assert max(others) <= found.privacy * 1.0005
