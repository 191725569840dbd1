"""
Report
======

Every picture of the library is drawn by a function of ``inscrutable.reports`` on axes that you pass. Every result prints a
summary, and can be saved and loaded. Colour-blind readers can distinguish the colours, and each decision maker has one marker.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from inscrutable import (
    CategoricalEmission,
    CounterAdversarialDecisionMaker,
    Decision,
    HiddenMarkovModel,
    MarkowitzProblem,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    decoy_grid,
    filter_beliefs,
)
from inscrutable.experiments.episodes import run_episode
from inscrutable.reports.style import drawing
from inscrutable.reports.time_plots import plot_costs, plot_privacy

world = HiddenMarkovModel(
    transition=[[0.90, 0.09, 0.01], [0.06, 0.90, 0.04], [0.02, 0.18, 0.80]],
    emission=CategoricalEmission(
        [[0.70, 0.25, 0.05], [0.25, 0.50, 0.25], [0.05, 0.25, 0.70]]
    ),
)
problem = MarkowitzProblem(
    means=[[0.014, 0.005, 0.002], [0.004, 0.008, 0.002], [-0.030, -0.004, 0.003]],
    covariances=[
        np.diag([0.0016, 0.0009, 0.0001]),
        np.diag([0.0025, 0.0006, 0.0001]),
        np.diag([0.0090, 0.0020, 0.0001]),
    ],
    risk_aversion=3.0,
)
beliefs = filter_beliefs(
    world, world.sample(24, rng=np.random.default_rng(3)).observations
).predicted
candidates = decoy_grid(problem, 30)
makers = {
    "ODM": OriginalDecisionMaker(problem),
    "CDM": CounterAdversarialDecisionMaker(
        problem, budget=0.1, candidates=candidates
    ),
    "PDM": ProbabilisticDecisionMaker(problem, budget=0.1, candidates=candidates),
}
episode = run_episode(problem, beliefs, makers, rng=np.random.default_rng(1))
with drawing(7.0, 3.3, ncols=2) as (figure, (left, right)):
    plot_privacy(
        left,
        {
            name: record.decisions.privacy
            for name, record in episode.records.items()
        },
    )
    plot_costs(
        right,
        {
            name: record.relative_increase
            for name, record in episode.records.items()
        },
        budget=0.1,
    )
    figure.savefig("report.png")

# %%
# A result states its status and bounds. They are saved and loaded with it.

decision = makers["CDM"].decide(beliefs[-1])
with TemporaryDirectory() as folder:
    decision.save(Path(folder, "decision.npz"))
    print(Decision.load(Path(folder, "decision.npz")).summary())

# %%
# ``inscrutable backtest`` and ``inscrutable compare`` write their figures as PNG and SVG and their tables as CSV. With the
# extra ``inscrutable[report]`` they also write the page ``report.html``, which works offline and has a slider over time and one
# over the budget.
