"""Budgets as a share of the silence regret, where the law of the investor's belief is known."""

from __future__ import annotations

import numpy as np

from inscrutable.budgets import Budget, SilenceShare
from inscrutable.experiments.backtest_aware import resolution_for
from inscrutable.mechanisms.chains import predicted_chain
from inscrutable.privacy.leaks import silence_regret
from inscrutable.problems import DecisionProblem
from inscrutable.worlds import HiddenMarkovModel

_SEED = 0
"""Of the simulated path that says how often which belief is held."""


def budget_in(world: HiddenMarkovModel, problem: DecisionProblem, budget: Budget | SilenceShare) -> Budget:
    """Return a budget in the cost's unit or relative to it; a share of silence by the long-run law of the predicted belief.

    Args:
        world: How regimes and returns move.
        problem: What decisions cost.
        budget: What is asked for.

    Cost: a simulated path, a second, for a share of silence; else none.
    """
    if isinstance(budget, Budget):
        return budget
    prior = predicted_chain(world, resolution_for(world.n_states), rng=np.random.default_rng(_SEED)).prior
    return budget.of(silence_regret(problem, prior.beliefs, prior.weights))
