"""
The sensor behind the beliefs
=============================

Beliefs depend on the sensor (the observation model B), so beliefs reveal it. From π₀, π₁, … and the transition P an observer
computes, at every step, the column b of B for the symbol that the agent saw, up to a factor:

.. code-block:: text

   π_k = diag(b) P'π_{k−1} / 1'diag(b) P'π_{k−1}     so     b ∝ π_k / P'π_{k−1}, entry by entry

With at most as many symbols as states, the factors follow, because the rows of B sum to one. With more symbols they do not, and
the observer estimates them from the frequencies of the symbols. The status of the result names the case; its intervals give the
accuracy of the entries.
"""

import numpy as np

from inscrutable import (
    CategoricalEmission,
    HiddenMarkovModel,
    Mechanism,
    SensorFamily,
    best_probe,
    calibrate_sensor,
    estimate_sensor,
    estimate_world,
    filter_beliefs,
)
from inscrutable.reports.sensor_plots import plot_profile
from inscrutable.reports.style import drawing, looks_of

transition = [[0.8, 0.1, 0.1], [0.15, 0.7, 0.15], [0.1, 0.2, 0.7]]
world = HiddenMarkovModel(
    transition,
    CategoricalEmission([[0.7, 0.2, 0.1], [0.15, 0.7, 0.15], [0.1, 0.25, 0.65]]),
)
rng = np.random.default_rng(1)
beliefs = filter_beliefs(world, world.sample(200, rng=rng).observations).beliefs
print(estimate_sensor(beliefs, transition))

# %%
# The observer need not know the transition. All steps of one symbol satisfy linear equations in M = diag(b)P'; P follows from
# the steps of a single symbol. The steps are clustered by symbol:

print(estimate_world(beliefs, n_symbols=3))

# %%
# Beliefs observed with noise still reveal the sensor. The steps are then clustered by the symbol that explains them best.

for noise in (1e-4, 1e-3, 1e-2):
    noisy = np.abs(beliefs + noise * rng.normal(size=beliefs.shape))
    found = estimate_sensor(
        noisy / noisy.sum(axis=1, keepdims=True), transition, n_symbols=3
    )
    low, high = found.intervals[..., 0], found.intervals[..., 1]
    print(
        f"noise {noise:.0e}: entries are known to {(high - low).max() / 2:.4f}, {found.status.name}"
    )

# %%
# Decisions contain less information than beliefs. Below, an agent with two states randomises between two actions; the less
# certain it is, the nearer are their probabilities to ½. An aware observer who sets the states itself compares sensors by the
# likelihood of the decisions, the product of the normalisers of its inverse filter. `best_probe` ranks sequences of states by
# Fisher information, before any decision is seen.

two = HiddenMarkovModel(
    [[0.8, 0.2], [0.3, 0.7]], CategoricalEmission([[0.8, 0.2], [0.2, 0.8]])
)
grid = np.column_stack([np.linspace(0, 1, 51), np.linspace(1, 0, 51)])
probes = {"always state 0": [0] * 100, "five and five": ([0] * 5 + [1] * 5) * 10}


def choosing(sharpness: float) -> Mechanism:
    """Return an agent that plays 0 with probability 1/(1 + exp(−sharpness (π_0 − ½)))."""
    first = 1 / (1 + np.exp(-sharpness * (grid[:, 0] - 0.5)))
    return Mechanism(
        grid, np.arange(2), np.column_stack([first, 1 - first]), np.zeros((51, 2))
    )


accuracy = SensorFamily.accuracy(2)
ranking = best_probe(
    list(probes.values()),
    choosing(6.0),
    accuracy,
    world=two,
    parameters=[0.8],
    rng=np.random.default_rng(2),
)
print(ranking)

# %%
# Randomisation hides the sensor, too: the less the decision depends on the belief, the flatter is the likelihood of the sensor.
# Where it is flat the sensor is not *identified*: the status says so, and the interval reaches the bound of the parameter.


def decisions(
    agent: Mechanism, states: list[int], rng: np.random.Generator
) -> np.ndarray:
    """Return what the agent plays where the states are set."""
    observed = two.emission.sample(states, rng=rng)
    held = filter_beliefs(two, observed).beliefs
    shares = np.interp(held[:, 0], grid[:, 0], agent.probabilities[:, 0])
    return (rng.random(len(states)) > shares).astype(int)


agents = {
    "sharp choices": choosing(20.0),
    "mixed": choosing(6.0),
    "nearly a coin": choosing(1.0),
}
with drawing(6.4, 3.4) as (figure, axes):
    for name, look in looks_of(agents).items():
        states = probes["five and five"]
        seen = decisions(agents[name], states, np.random.default_rng(4))
        found = calibrate_sensor(seen, states, agents[name], accuracy, world=two)
        plot_profile(axes, found, look, label=name)
        print(f"{name:14s}accuracy {found.parameters[0]:.2f}, {found.status.name}")
    axes.axvline(0.8, color="0.6", linewidth=0.8)
    axes.set_xlabel(
        "accuracy of the sensor; the true one is 0.8; bars: 95 % intervals"
    )
    axes.legend(frameon=False)
    figure.savefig("sensor.png")

# %%
# In a linear Gaussian world the observer runs a Kalman filter on the agent's Kalman filter: `inverse_kalman_filter`. The column
# *error, sensor* of `inscrutable compare` is the error of the sensor estimated from a hundred decisions of each rule, taken at
# face value.
#
# Sources: Mattila, Rojas, Krishnamurthy and Wahlberg (NeurIPS 2017, and arXiv 2001.11809); Krishnamurthy and Rangaswamy (arXiv
# 1905.07230).
