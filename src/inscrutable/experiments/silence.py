"""Budgets as shares of the silence regret, given the law of the investor's belief."""

from __future__ import annotations

import numpy as np

from inscrutable.budgets import Budget, SilenceShare
from inscrutable.experiments.backtest_aware import resolution_for
from inscrutable.mechanisms.chains import predicted_chain
from inscrutable.privacy.leaks import silence_regret
from inscrutable.problems import DecisionProblem
from inscrutable.worlds import HiddenMarkovModel

_SEED = 0
"""Seed of the simulated path for the law of the belief."""


def budget_in(world: HiddenMarkovModel, problem: DecisionProblem, budget: Budget | SilenceShare) -> Budget:
    """Return a budget; a share of the silence regret is converted by the stationary law of the predicted belief.

    Args:
        world: The world of regimes and returns.
        problem: The decision problem.
        budget: The requested budget.

    Cost: 1 s for a simulated path, if the budget is a share of silence; otherwise none.
    """
    if isinstance(budget, Budget):
        return budget
    prior = predicted_chain(world, resolution_for(world.n_states), rng=np.random.default_rng(_SEED)).prior
    return budget.of(silence_regret(problem, prior.beliefs, prior.weights))
