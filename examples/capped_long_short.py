"""A fund with a long and short book
=================================

A fund may be short within a gross limit, and has sector caps. What does its book reveal, and which book reveals less?

Writes capped_long_short.png into the current folder.
"""

from __future__ import annotations

import numpy as np

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    MarkowitzProblem,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    group_caps,
    long_short,
    max_weights,
)
from inscrutable.reports.style import drawing

assets = ("Banks", "Insurers", "Oil", "Gas", "Software", "Bonds")
region = (
    long_short(assets, gross=1.6, net=1.0, shortable=["Banks", "Oil", "Software"])
    & max_weights(assets, 0.6)
    & group_caps(assets, {"financials": ["Banks", "Insurers"], "energy": ["Oil", "Gas"]}, 0.5)
)
# Monthly means and volatilities in growth, inflation and recession; one correlation for all.
means = np.array(
    [[1.0, 0.8, 0.6, 0.5, 1.3, 0.1], [0.2, 0.3, 1.2, 1.1, -0.2, -0.1], [-1.5, -0.9, -1.0, -0.7, -0.8, 0.6]]
)
spreads = np.array([[4.0, 3.5, 5.0, 4.5, 5.0, 1.0], [5.0, 4.5, 6.0, 5.5, 6.5, 2.0], [9.0, 7.5, 9.0, 8.0, 8.5, 1.5]])
covariances = [np.outer(s, s) * (0.35 + 0.65 * np.eye(6)) / 1e4 for s in spreads]
problem = MarkowitzProblem(means / 100, covariances, 0.8, region)

belief = np.array([0.55, 0.35, 0.10])
budget = Budget.regret(0.0005)  # five basis points a month
odm = OriginalDecisionMaker(problem).decide(belief)
hider = CounterAdversarialDecisionMaker(problem, budget=budget)
cdm = hider.decide(belief)
pdm = ProbabilisticDecisionMaker(problem, budget=budget, candidates=hider.candidates).decide(belief)
tight = [name for name, on in zip(region.names, region.tight_rows(odm.action), strict=False) if on]
print("limits that are active in the optimal book:", "; ".join(tight))
print(odm.summary(), cdm.summary(), pdm.summary(), sep="\n\n")

books = {"optimal": odm.action, "hiding, at five basis points": cdm.action}
with drawing(width=5.0) as (figure, axes):
    for shift, (name, book) in zip((-0.2, 0.2), books.items(), strict=True):
        axes.bar(np.arange(6) + shift, book, 0.4, label=name)
    axes.set(xticks=range(6), xticklabels=assets, ylabel="weight")
    axes.axhline(0.0, color="black", linewidth=0.5)
    axes.legend()
    figure.savefig("capped_long_short.png")
