"""
Decision problem
================

A decision u costs c(i, u) in state i. The agent does not know the state, so it takes the decision of least expected cost:

.. code-block:: text

   u*(π) = argmin Σ_i π_i c(i,u) over u ∈ C,    V(π) = min Σ_i π_i c(i,u) over u ∈ C

The *state costs* s(u) = (c(1,u), …, c(X,u)) do not depend on the belief. The *regret* of a decision is its expected cost above
the optimum, ρ(π, u) = π·s(u) − V(π) ≥ 0.
"""

import numpy as np

from inscrutable import MarkowitzProblem, max_weights, simplex
from inscrutable.reports.style import REGIME_COLOURS, drawing

problem = MarkowitzProblem(
    means=[[0.014, 0.005, 0.002], [0.004, 0.008, 0.002], [-0.030, -0.004, 0.003]],
    covariances=[
        np.diag([0.0016, 0.0009, 0.0001]),
        np.diag([0.0025, 0.0006, 0.0001]),
        np.diag([0.0090, 0.0020, 0.0001]),
    ],
    risk_aversion=3.0,
)
belief = [0.6, 0.3, 0.1]
weights = problem.solve(belief)
print("weights     ", weights.round(3))
print("state costs ", problem.state_costs(weights).round(5))
print("V(belief)   ", problem.optimal_cost(belief).round(5))
print("regret of equal weights", problem.regret(belief, np.full(3, 1 / 3)).round(6))

# %%
# The left panel shows the optimal weights for every probability of a crisis. Below 0.36 each portfolio reveals the probability;
# above, all portfolios are bills alone. The right panel shows the regret of the decisions that are optimal under other beliefs
# than the true one. It does not decrease along a ray from the true belief.

crisis = np.linspace(0.0, 1.0, 201)
beliefs = np.column_stack([1 - crisis, np.zeros(201), crisis])
held = np.array([0.8, 0.0, 0.2])
with drawing(6.4, 2.6, ncols=2) as (figure, (left, right)):
    left.stackplot(
        crisis,
        problem.solve(beliefs).T,
        colors=REGIME_COLOURS,
        labels=("stocks", "credit", "bills"),
    )
    left.set(
        xlabel="probability of a crisis",
        ylabel="optimal weight",
        xlim=(0, 1),
        ylim=(0, 1),
    )
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3)
    right.plot(crisis, 1e4 * problem.regret(held, problem.solve(beliefs)))
    right.axvline(0.2, color="#000000", linestyle=":", linewidth=0.9)
    right.set(
        xlabel="probability of a crisis acted upon", ylabel="regret, basis points"
    )
    right.set_title("true probability 0.2", loc="left")
    figure.savefig("problem.png")

# %%
# Feasible sets are combined with ``&``. Every constraint has a name, which errors and reports use.

capped = MarkowitzProblem(
    problem.means,
    problem.covariances,
    risk_aversion=3.0,
    constraints=simplex(3) & max_weights(3, 0.5),
)
print("at most a half in each:", capped.solve(belief).round(3))

# %%
# There are other costs: :class:`~inscrutable.QuadraticProblem`, :class:`~inscrutable.LinearProblem`,
# :class:`~inscrutable.FiniteProblem` for finitely many choices, :class:`~inscrutable.KellyProblem` for growth,
# :class:`~inscrutable.ConvexProblem` for costs written in CVXPY or as functions, :func:`~inscrutable.dispatch_problem` for
# power plants. You can add a class of your own (:doc:`/extending`).
