"""The limit of many samples
=========================

The paper samples M actions and lets M grow. Which privacy does this approach, and how fast, for samples of actions and of
decoys?

Writes limit_of_candidates.png into the current folder.
"""

from __future__ import annotations

import numpy as np

from inscrutable import (
    MarkowitzProblem,
    ProbabilisticDecisionMaker,
    action_grid,
    decoy_grid,
    random_candidates,
)
from inscrutable.decision_makers.probabilistic import LinearProgramme
from inscrutable.reports.style import drawing

means = [[0.012, 0.006, 0.002], [0.007, 0.005, 0.002], [-0.030, -0.004, 0.003]]
spreads = np.array([[0.030, 0.017, 0.010], [0.045, 0.024, 0.010], [0.095, 0.045, 0.014]])
problem = MarkowitzProblem(means, [np.diag(s**2) for s in spreads], risk_aversion=3.0)
belief, budget = np.array([0.5, 0.3, 0.2]), 0.1

limit = ProbabilisticDecisionMaker(problem, budget=budget, certify=0.001).decide(belief)
print(f"all lotteries: {limit.expected_privacy:.4f}, proven to be at most {limit.privacy_bound:.4f}")

rng = np.random.default_rng(1)
sizes = {"grid of actions": [], "random actions": [], "decoys": []}
values = {name: [] for name in sizes}
for resolution in (5, 10, 20, 40, 80):
    count = (resolution + 1) * (resolution + 2) // 2
    drawn = {
        "grid of actions": action_grid(problem, resolution),
        "random actions": random_candidates(problem, count, rng=rng),
        "decoys": decoy_grid(problem, resolution),
    }
    for name, candidates in drawn.items():
        maker = ProbabilisticDecisionMaker(problem, budget=budget, candidates=candidates, method=LinearProgramme())
        sizes[name].append(len(candidates))
        values[name].append(maker.decide(belief).expected_privacy)
for name, reached in values.items():
    print(f"{name:16}", " ".join(f"M={m}: {v:.4f}" for m, v in zip(sizes[name], reached, strict=True)))

with drawing() as (figure, axes):
    for name, marker in zip(values, "s^o", strict=True):
        axes.semilogx(sizes[name], values[name], marker=marker, label=name)
    axes.axhline(limit.privacy_bound, color="black", linewidth=0.8, linestyle="--", label="proven bound")
    axes.set(xlabel="candidates M", ylabel="expected privacy")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    figure.savefig("limit_of_candidates.png")
