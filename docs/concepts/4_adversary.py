"""
Adversary
=========

An *adversary*, or *observer*, sees the decision and knows the costs. The *naive observer* takes the decision for optimal and
solves the inverse optimisation problem. The solutions, the *consistent beliefs*, are a polytope, given by the KKT conditions:

.. code-block:: text

   Π(u) = {π ∈ Δ : Σ_i π_i ∇c(i,u) + A_act'λ + A_eq'ν = 0 for some λ ≥ 0 and ν}
"""

import numpy as np

from inscrutable import (
    MarkowitzProblem,
    consistent_beliefs,
    explain_action,
    near_optimal_beliefs,
)
from inscrutable.reports.simplex_plots import plot_beliefs
from inscrutable.reports.style import drawing

regimes = ("calm", "normal", "crisis")
problem = MarkowitzProblem(
    means=[[0.014, 0.005, 0.002], [0.004, 0.008, 0.002], [-0.030, -0.004, 0.003]],
    covariances=[
        np.diag([0.0016, 0.0009, 0.0001]),
        np.diag([0.0025, 0.0006, 0.0001]),
        np.diag([0.0090, 0.0020, 0.0001]),
    ],
    risk_aversion=3.0,
)
belief = np.array([0.6, 0.3, 0.1])
weights = problem.solve(belief)
seen = consistent_beliefs(problem, weights)
print("holds", weights.round(3), "and gives away", seen.center().round(3))

# %%
# An asset that is not held gives an inequality instead of an equation. So the consistent beliefs of portfolios that hold three,
# two and one asset are a point, a segment and an area.

for acted in ([0.6, 0.3, 0.1], [0.85, 0.1, 0.05], [0.2, 0.2, 0.6]):
    action = problem.solve(acted)
    found = consistent_beliefs(problem, action)
    print(
        f"{np.count_nonzero(action > 0)} held, dimension {found.dimension}, bounds",
        found.bounds().round(2).tolist(),
    )

# %%
# For a rounded portfolio the observer takes the *near-optimal* beliefs: those under which its regret is at most some ε. For a
# portfolio that no belief explains, ``explain_action`` gives the belief under which its regret is least, and this regret, the
# *plausibility gap*.

rounded = weights.round(2)
rounded[1] += 1 - rounded.sum()
near = near_optimal_beliefs(
    problem, rounded, float(problem.regret(belief, rounded))
)
print("rounded to", rounded, "and read as", near.bounds().round(3).tolist())
print(explain_action(problem, [0.5, 0.0, 0.5]).summary())

# %%
sets = {
    "three held": seen,
    "two held": consistent_beliefs(problem, problem.solve([0.85, 0.1, 0.05])),
    "one held": consistent_beliefs(problem, problem.solve([0.2, 0.2, 0.6])),
}
with drawing(4.2, 3.8, subplot_kw={"projection": "ternary"}) as (figure, axes):
    plot_beliefs(axes, belief, sets, regimes)
    figure.savefig("adversary.png")

# %%
# The star is the true belief of the first portfolio; dashes lead from it to the consistent beliefs of the other portfolios.
# :doc:`/threat-model` lists observers who also know the budget, the rule or the world.
