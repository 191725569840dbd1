"""The law of the investor's belief, the silence regret under it, and budgets as shares of that."""

from __future__ import annotations

import numpy as np

from inscrutable.budgets import Budget, SilenceShare
from inscrutable.experiments.backtest_aware import beliefs_resolution
from inscrutable.mechanisms.chains import BeliefChain, predicted_chain
from inscrutable.privacy.leaks import silence_regret
from inscrutable.problems import DecisionProblem
from inscrutable.worlds import HiddenMarkovModel

_SEED = 0
"""Seed of the simulated path for the law of the belief: the same at every call, and public."""


def chain_of(world: HiddenMarkovModel) -> BeliefChain:
    """Return the chain of the belief about the next row, on a grid; the same at every call. Cost: 1 s for a simulated path."""
    return predicted_chain(world, beliefs_resolution(world.n_states), rng=np.random.default_rng(_SEED))


def silence_in(world: HiddenMarkovModel, problem: DecisionProblem) -> float:
    """Return the silence regret: the long-run mean regret of the best constant decision, in the cost's unit."""
    prior = chain_of(world).prior
    return silence_regret(problem, prior.beliefs, prior.weights)


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
    return budget.of(silence_in(world, problem))
