"""A bettor and her stakes
=======================

The stakes of a bettor reveal her belief: the best stakes are the belief itself, and other stakes cost the divergence of the
belief from them.

Writes kelly_bettor.png into the current folder.
"""

from __future__ import annotations

import numpy as np

from inscrutable import CounterAdversarialDecisionMaker, KellyProblem, ProbabilisticDecisionMaker, decoy_grid
from inscrutable.budgets import Budget
from inscrutable.reports.simplex_plots import plot_beliefs
from inscrutable.reports.style import drawing

horses = ("Ajax", "Bijou", "Comet")
odds = np.array([2.6, 3.2, 4.0])  # wealth after the race per unit staked on the winner
# The state is the winner, and there is one outcome in each state.
problem = KellyProblem(gross_returns=np.diag(odds)[:, None, :], probabilities=np.ones((3, 1)))

belief = np.array([0.55, 0.30, 0.15])
stakes = problem.solve(belief)
print("optimal stakes:", dict(zip(horses, stakes.round(3).tolist(), strict=True)))

candidates = decoy_grid(problem, 40)
bluffs = {}
for growth in (0.01, 0.05, 0.2):  # expected logarithmic growth she gives up, in nats per race
    bluff = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(growth), candidates=candidates).decide(belief)
    divergence = float(np.sum(belief * np.log(belief / bluff.action)))
    print(f"regret {bluff.regret:.3f} (Kullback-Leibler {divergence:.3f}): stakes {bluff.action.round(3)}, "
          f"her belief looks {bluff.privacy:.3f} away")  # fmt: skip
    bluffs[f"regret {growth:g}"] = bluff.belief_set

lottery = ProbabilisticDecisionMaker(problem, budget=Budget.regret(0.05), candidates=candidates).decide(belief)
print(f"a lottery for 0.05 on average: {lottery.expected_privacy:.3f} away, on average")

with drawing(subplot_kw={"projection": "ternary"}) as (figure, axes):
    plot_beliefs(axes, belief, bluffs, horses)
    figure.savefig("kelly_bettor.png")
