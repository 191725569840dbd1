"""
Privacy
=======

*Privacy* Ψ measures how much the naive observer is misled: how Π(u), the beliefs that it takes for possible, differs from the
true belief π. The paper has five such measures. The one used most, *maximal obfuscation*, is the distance of the belief from
Π(u):

.. code-block:: text

   Ψ(u) = dist(π, Π(u))
"""

import numpy as np

from inscrutable import (
    DesiredObfuscation,
    MarkowitzProblem,
    MaximalObfuscation,
    NonExistence,
    NonUniqueness,
    OriginalDecisionMaker,
    consistent_beliefs,
    decoy_grid,
    leakage,
    mechanism,
    uniform_prior,
)
from inscrutable.reports.style import drawing, ternary_labels

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
instead = consistent_beliefs(problem, problem.solve([0.2, 0.6, 0.2]))
for measure in (
    MaximalObfuscation(),
    DesiredObfuscation([0.0, 0.0, 1.0]),
    NonExistence(),
    NonUniqueness(),
):
    print(f"{type(measure).__name__:20} {measure(belief, instead):6.3f}")

# %%
# An agent that hides its belief plays the decision that is optimal under another belief, a *decoy* (a *misreport* of the type).
# Every decoy has a privacy and a regret. The decoys with a regret of at most a tenth of ``|c*|``, the size of the optimal cost,
# form a region around the belief. The counter-adversarial decision maker plays the decision of the decoy with the largest
# privacy in this region.

candidates = decoy_grid(problem, 60)
regrets = candidates.state_costs @ belief - problem.optimal_cost(belief)
privacy = np.array(
    [
        consistent_beliefs(problem, action).distance(belief)
        for action in candidates.actions
    ]
)
afforded = regrets <= 0.1 * abs(problem.optimal_cost(belief))
with drawing(4.6, 3.8, subplot_kw={"projection": "ternary"}) as (figure, axes):
    ternary_labels(axes, regimes)
    axes.scatter(
        *candidates.decoys[~afforded].T,
        s=5,
        color="#dddddd",
        label="above the budget",
    )
    shown = axes.scatter(
        *candidates.decoys[afforded].T,
        s=11,
        c=privacy[afforded],
        cmap="viridis",
        label="within the budget",
    )
    axes.plot(
        *belief[:, None], "*", color="#000000", markersize=8, label="private belief"
    )
    figure.colorbar(
        shown, ax=axes, shrink=0.6, pad=0.12, label="privacy of the decoy"
    )
    axes.legend(loc="upper left", bbox_to_anchor=(-0.2, 1.08))
    figure.savefig("privacy.png")

# %%
# The *aware observer* knows the rule and a prior over beliefs. Against it the measures are the *leakage* I(π; u) in bits and
# the error of its best estimate. These are the figures of the optimal decisions:

prior = uniform_prior(3, 20)
print(
    leakage(
        mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, problem
    ).summary()
)
