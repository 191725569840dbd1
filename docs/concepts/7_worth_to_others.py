"""
When others learn from my decision
==================================

So far the observer only inferred. In social learning each observer then decides. A state is drawn once; agent *n* has a signal
of its own and has seen the decisions of agents 1 … *n* − 1. Everybody knows the prior, the sensor and the rule K(u | π) of each
agent, so that a decision moves the *public belief* q by Bayes' rule::

    π_n ∝ q_{n−1}(x) p(y_n | x),    q_n ∝ q_{n−1}(x) Σ_y p(y | x) K(u_n | π(q_{n−1}, y)).

A *cascade* is a public belief at which every signal leads to the same law of the decision: from then on decisions reveal
nothing. It is right if the likeliest decision is the best in the true state, else wrong.
"""

import numpy as np

from inscrutable import (
    CategoricalEmission,
    CoinDecisionMaker,
    ExponentialDecisionMaker,
    FiniteProblem,
    GaussianEmission,
    social_learning,
)
from inscrutable.reports.style import BLACK, BLUE, GREEN, ORANGE, drawing

problem = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
p = 0.7
sensor = CategoricalEmission([[p, 1 - p], [1 - p, p]])

plain = social_learning(problem, sensor, n_agents=200)
print(plain)
print(f"closed form: {p * (p + 1) / 2 / (1 - p + p**2):.6f}")

# %%
# All agents are rational, and still one cascade in four is wrong, because two equal decisions outweigh one signal. The figures
# are exact where few public beliefs can be reached, here five; the status says so. The leakage of each agent is what its
# decision tells about its private belief to those who saw all earlier decisions: all of it at first, nothing in a cascade.

print(plain.frame().head(6).round(4))

# %%
# Hiding delays cascades and changes their probabilities. With ε-randomised response k = ⌊α/α_ε⌋ + 1 equal decisions start a
# cascade, where α is the log-odds of a signal and α_ε that of a decision. As ε grows, and privacy falls, k falls by one at some
# values; there the share of right cascades falls too. The exponential mechanism has no cascades, because its law changes with
# every change of the belief. Each decision reveals a little, and in the long run the public learns more than from decisions
# that hide nothing.

epsilons = np.linspace(0.4, 2.5, 211)
responses = [
    social_learning(
        problem,
        sensor,
        CoinDecisionMaker.response(problem, epsilon),
        n_agents=600,
    )
    for epsilon in epsilons
]
smooth = social_learning(
    problem,
    sensor,
    ExponentialDecisionMaker(problem, 4.0),
    n_agents=60,
    rng=np.random.default_rng(0),
)
one = CoinDecisionMaker.response(problem, 1.0)
noisy = social_learning(problem, sensor, one, n_agents=60)
with drawing(7.0, 3.0, ncols=2) as (figure, (left, right)):
    left.plot(epsilons, [each.right for each in responses], color=BLUE)
    left.axhline(plain.right, color=GREEN, linestyle="--", linewidth=0.9)
    left.text(1.9, plain.right - 0.006, "nothing hidden", fontsize=6)
    for jump in (1.158, 0.733, 0.540):
        left.axvline(jump, color=BLACK, linestyle=":", linewidth=0.7)
    left.set(xlabel="ε of randomised response", ylabel="share of right cascades")
    for name, found, colour in (
        ("nothing hidden", plain, GREEN),
        ("randomised response, ε = 1", noisy, BLUE),
        ("exponential mechanism, ε = 4", smooth, ORANGE),
    ):
        right.plot(found.truths[:61], color=colour, label=name)
    right.set(
        xlabel="decisions seen",
        ylabel="public probability of the truth",
        ylim=(0.5, None),
    )
    right.legend()
    figure.savefig("herding.png")

# %%
# Signals of unbounded strength end every herd: some agent's signal outweighs the public belief. No cascade begins, so that
# `right` and `wrong` count majorities of the decisions on simulated paths.

for n_agents in (10, 100):
    paths = social_learning(
        problem,
        GaussianEmission([[-0.5], [0.5]], [[[1.0]], [[1.0]]]),
        n_agents=n_agents,
        rng=np.random.default_rng(0),
    )
    print(f"{n_agents:4} agents: wrong majorities {paths.wrong:.1%}")
print(paths.status.value)

# %%
# `herding_table` states the cost of a rule to the agent itself and to the others. The example on the price of privacy for the
# others compares four rules.
