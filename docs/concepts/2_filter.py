"""
Filter
======

The agent's *private belief* π is its posterior: the probability of each state, given all observations so far. With B(y) the
diagonal matrix of p(y | x) and P the transition matrix, one step is

.. code-block:: text

   π[k+1] ∝ B(y[k+1]) P' π[k]

from π[0] ∝ B(y[0]) p(x[0]). The agent decides by this belief, and an observer of its decisions wants to know it.
"""

import numpy as np

from inscrutable import (
    BeliefFilter,
    CategoricalEmission,
    HiddenMarkovModel,
    filter_beliefs,
)
from inscrutable.reports.style import REGIME_COLOURS, drawing

regimes = ("calm", "normal", "crisis")
world = HiddenMarkovModel(
    transition=[[0.90, 0.09, 0.01], [0.06, 0.90, 0.04], [0.02, 0.18, 0.80]],
    emission=CategoricalEmission(
        [[0.70, 0.25, 0.05], [0.25, 0.50, 0.25], [0.05, 0.25, 0.70]]
    ),
)
path = world.sample(120, rng=np.random.default_rng(3))
found = filter_beliefs(world, path.observations)
print("belief in the last month      ", found.beliefs[-1].round(2))
print("belief about the month after  ", found.predicted[-1].round(2))

# %%
# ``beliefs`` has the posterior of each month's state given the observations up to that month; ``predicted`` has that of the
# next month's state given the same observations. A decision that pays off in the next month is based on ``predicted``.

with drawing(6.0, 2.4) as (figure, axes):
    axes.stackplot(
        np.arange(120), found.beliefs.T, colors=REGIME_COLOURS, labels=regimes
    )
    axes.plot(
        np.arange(120),
        1.06 + 0.05 * path.states,
        ".",
        color="#000000",
        markersize=2,
        label="true regime",
    )
    axes.set(
        xlabel="month",
        ylabel="belief",
        xlim=(0, 119),
        ylim=(0, 1.2),
        yticks=[0, 0.5, 1],
    )
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
    figure.savefig("filter.png")

# %%
# The filter is causal: a belief never changes when later observations arrive. Filtering one observation at a time gives the
# same beliefs.

online = BeliefFilter(world)
for signal in path.observations:
    belief = online.update(signal)
print(np.abs(belief - found.beliefs[-1]).max() < 1e-12)
