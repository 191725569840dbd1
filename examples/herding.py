"""
The price of privacy for the others
===================================

People decide in turn whether to buy. Each has a signal of its own, which is right with probability 0.7, and sees what
those before decided. A decision reveals the signal behind it, unless it is hidden. What does hiding cost the one who hides,
and what does it cost the others?

All rules cost the first agent the same expected regret, 0.1. Writes herding.png into the current folder.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from inscrutable import (
    Budget,
    CategoricalEmission,
    CoinDecisionMaker,
    FiniteProblem,
    HerdingTable,
    OriginalDecisionMaker,
    Prior,
    ProbabilisticDecisionMaker,
    RateDistortionDecisionMaker,
    herding_table,
    social_learning,
)
from inscrutable.reports.herding import draw_herding

problem = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])  # state: poor or good; choice: leave it or buy
sensor = CategoricalEmission([[0.7, 0.3], [0.3, 0.7]])
first = Prior([[0.7, 0.3], [0.3, 0.7]], [0.5, 0.5])  # the first agent's private belief
n_agents, budget = 40, Budget.regret(0.1)

rules = {
    "ODM": OriginalDecisionMaker(problem),
    "randomised response": CoinDecisionMaker.response(problem, np.log(3.0)),
    "rate-distortion": RateDistortionDecisionMaker(problem, budget, prior=first),
}
table = herding_table(problem, sensor, rules, n_agents=n_agents, rng=np.random.default_rng(0))

# The PDM takes some milliseconds for each lottery: this run has fewer paths.
lotteries = ProbabilisticDecisionMaker(problem, budget=budget)
found = social_learning(problem, sensor, lotteries, n_agents=n_agents, rng=np.random.default_rng(0), n_paths=60)
table = HerdingTable((*table.names, "PDM"), (*table.found, found))
print(table)

# Only the first agent hides. Without that, a second agent with the opposite signal tosses a coin. Now it follows its own
# signal, which informs the later agents better.
alone = social_learning(
    problem, sensor, [rules["randomised response"], *[rules["ODM"]] * (n_agents - 1)], n_agents=n_agents
)
print(
    f"only the first hides: the others' regret {alone.regrets[1:].sum():.2f}, else {table['ODM'].regrets[1:].sum():.2f}"
)

draw_herding(table, Path())
