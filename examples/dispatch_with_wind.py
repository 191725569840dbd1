"""An operator with a wind forecast
================================

The public schedule of a system operator's power plants reveals its private wind forecast, here on the IEEE 30-bus network.

Writes dispatch_with_wind.png into the current folder.
"""

from __future__ import annotations

import numpy as np

from inscrutable import (
    CounterAdversarialDecisionMaker,
    GlobalSearch,
    OriginalDecisionMaker,
    decoy_grid,
    dispatch_problem,
    load_ieee_30_bus,
    privacy_frontier,
)
from inscrutable.reports.style import drawing

regimes = ("calm", "westerly", "storm")
farms = [7, 29]  # buses, numbered from 0
problem = dispatch_problem(
    load_ieee_30_bus(),
    farms,
    wind_means=[[5.0, 2.0], [25.0, 8.0], [10.0, 18.0]],  # MW in each regime
    wind_deviations=[[2.0, 1.0], [6.0, 3.0], [8.0, 6.0]],
    wind_capacities=[40.0, 35.0],
)

belief = np.array([0.6, 0.2, 0.2])
candidates = decoy_grid(problem, 40)
optimal = OriginalDecisionMaker(problem).decide(belief)
print("cost of an hour:", round(float(optimal.cost), 1), "; schedule (MW):", optimal.action.round(1))
print("belief read from it:", dict(zip(regimes, optimal.belief_set.center().round(3).tolist(), strict=True)))

hidden = CounterAdversarialDecisionMaker(
    problem, budget=0.03, candidates=candidates, method=GlobalSearch(certify=0.01)
).decide(belief)
print("three per cent dearer:", hidden.action.round(1))
print("belief read from that:", dict(zip(regimes, hidden.belief_set.center().round(3).tolist(), strict=True)))
print(f"{hidden.privacy:.3f} away; nothing affordable is farther than {hidden.privacy_bound:.3f}")

frontier = privacy_frontier(problem, belief, candidates=candidates)
shares = np.linspace(0.0, 0.15, 151)
regrets = shares * abs(optimal.cost)
with drawing() as (figure, axes):
    axes.plot(100 * shares, frontier.deterministic(regrets), label="one schedule")
    axes.plot(100 * shares, frontier.randomized(regrets), "--", label="lottery, in expectation")
    axes.set(xlabel="regret, % of the optimal cost", ylabel="distance of the forecast that it suggests")
    axes.legend()
    figure.savefig("dispatch_with_wind.png")
