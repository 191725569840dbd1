"""An inspector with five routines
===============================

An inspector has five routines and a private forecast of three kinds of fault. Which routine hides the forecast?

Writes inspection_game.png into the current folder.
"""

from __future__ import annotations

import numpy as np

from inscrutable import (
    CounterAdversarialDecisionMaker,
    FiniteProblem,
    ProbabilisticDecisionMaker,
    consistent_beliefs,
    privacy_frontier,
)
from inscrutable.reports.style import drawing

faults = ("none", "leak", "theft")
routines = ("skip", "meter", "walk", "audit", "full search")
# Cost of each routine (column) under each fault (row): work, and faults that are not found.
problem = FiniteProblem([[0.0, 1.0, 2.0, 3.0, 5.0], [8.0, 2.5, 3.0, 6.0, 5.0], [9.0, 8.0, 4.5, 3.2, 5.0]])

belief = np.array([0.2, 0.7, 0.1])
chosen = problem.solve(belief)
print(f"under {dict(zip(faults, belief.tolist(), strict=True))} the best routine is {routines[chosen]!r}")
for name, routine in zip(routines, range(problem.n_choices), strict=True):
    seen = consistent_beliefs(problem, routine)
    tells = "no belief explains it" if seen.is_empty else f"at least {seen.distance(belief):.2f} away"
    print(f"  {name:12} regret {float(problem.regret(belief, routine)):.2f}, consistent beliefs: {tells}")

one = CounterAdversarialDecisionMaker(problem, budget=0.6).decide(belief)
lottery = ProbabilisticDecisionMaker(problem, budget=0.3).decide(belief)
print("for 60 % more cost:", routines[int(one.action)], f"privacy {one.privacy:.2f}")
for action, probability in zip(lottery.actions, lottery.probabilities, strict=True):
    print(f"for 30 % on average: {routines[int(action)]} with probability {probability:.2f}")

frontier = privacy_frontier(problem, belief)
budgets = np.linspace(0.0, 3.0, 301)
with drawing() as (figure, axes):
    axes.plot(budgets, frontier.deterministic(budgets), drawstyle="steps-post", label="one routine")
    axes.plot(budgets, frontier.randomized(budgets), "--", label="lottery, in expectation")
    axes.set(xlabel="regret allowed", ylabel="distance of the belief it suggests")
    axes.legend()
    figure.savefig("inspection_game.png")
