"""An investor over three regimes
==============================

An investor holds a belief over three market regimes. What does its portfolio reveal, and what should it publish instead?

Writes three_regimes.png into the current folder.
"""

from __future__ import annotations

import numpy as np

from inscrutable import (
    CategoricalEmission,
    CounterAdversarialDecisionMaker,
    HiddenMarkovModel,
    MarkowitzProblem,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    filter_beliefs,
)
from inscrutable.reports.simplex_plots import plot_beliefs
from inscrutable.reports.style import drawing

regimes = ("calm", "normal", "crisis")
world = HiddenMarkovModel(
    transition=[[0.90, 0.09, 0.01], [0.06, 0.90, 0.04], [0.02, 0.18, 0.80]],
    emission=CategoricalEmission([[0.70, 0.25, 0.05], [0.25, 0.50, 0.25], [0.05, 0.25, 0.70]]),
)
problem = MarkowitzProblem(
    means=[[0.012, 0.006, 0.002], [0.007, 0.005, 0.002], [-0.030, -0.004, 0.003]],
    covariances=[
        np.diag([0.0009, 0.0003, 0.0001]),
        np.diag([0.0020, 0.0006, 0.0001]),
        np.diag([0.0090, 0.002, 0.0002]),
    ],
    risk_aversion=3.0,
)

# The private belief after a year of signals that only the investor sees.
signals = world.sample(12, rng=np.random.default_rng(7)).observations
belief = filter_beliefs(world, signals).predicted[-1]
print("belief about the next month:", ", ".join(f"{p:.2f} {name}" for p, name in zip(belief, regimes, strict=True)))

odm = OriginalDecisionMaker(problem).decide(belief)
cdm = CounterAdversarialDecisionMaker(problem, budget=0.1).decide(belief)
pdm = ProbabilisticDecisionMaker(problem, budget=0.1).decide(belief)
print(odm.summary(), cdm.summary(), pdm.summary(), sep="\n\n")

drawn = pdm.sample(rng=np.random.default_rng(0))
with drawing(subplot_kw={"projection": "ternary"}) as (figure, axes):
    plot_beliefs(axes, belief, {"ODM": odm.belief_set, "CDM": cdm.belief_set, "PDM": drawn.belief_set}, regimes)
    figure.savefig("three_regimes.png")
