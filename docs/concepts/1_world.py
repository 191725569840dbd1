"""
World
=====

A hidden *state* x moves from step to step; a *sensor* reports an *observation* y that depends on it. Together they are a hidden
Markov model: P is the transition matrix of the state, p(y | x) the *observation model*.

Here the state is the regime of a market, and the sensor a monthly signal of volatility that is low, middle or high.
"""

import numpy as np

from inscrutable import CategoricalEmission, HiddenMarkovModel
from inscrutable.reports.style import REGIME_COLOURS, drawing

regimes = ("calm", "normal", "crisis")
world = HiddenMarkovModel(
    transition=[[0.90, 0.09, 0.01], [0.06, 0.90, 0.04], [0.02, 0.18, 0.80]],
    emission=CategoricalEmission(
        [[0.70, 0.25, 0.05], [0.25, 0.50, 0.25], [0.05, 0.25, 0.70]]
    ),
)

# %%
# Without an ``initial`` law the first state has the stationary law of P: the long-run frequency of each regime.

for name, share in zip(regimes, world.initial, strict=True):
    print(f"{name:7} {share:.2f}")

# %%
# The figure shows ten years of observations. A simulation needs a random generator from the caller.

path = world.sample(120, rng=np.random.default_rng(3))
months = np.arange(120)
with drawing(6.0, 2.4) as (figure, axes):
    axes.step(
        months, path.states, where="mid", color="#000000", label="regime, unseen"
    )
    for signal, (colour, name) in enumerate(
        zip(REGIME_COLOURS, ("low", "middle", "high"), strict=False)
    ):
        seen = months[path.observations == signal]
        axes.plot(
            seen,
            np.full(len(seen), -0.45),
            "|",
            color=colour,
            markersize=9,
            label=f"signal: {name}",
        )
    axes.set_yticks(range(3), regimes)
    axes.set_xlabel("month")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4)
    figure.savefig("world.png")

# %%
# A sensor of real numbers is a :class:`~inscrutable.GaussianEmission`; :func:`~inscrutable.fit_gaussian_hmm` finds regimes in
# returns, and names them in the order of their volatility. To add a sensor, write one class (:doc:`/extending`).
