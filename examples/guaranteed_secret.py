"""
A secret with guarantees
========================

Each of three equally likely secrets has one best answer; any other answer costs 1. What does it cost to promise that no
published answer makes a guess at the secret more than e^ε times as likely to be right?

Writes guaranteed_secret.png into the current folder.
"""

from __future__ import annotations

import numpy as np

from inscrutable import Budget, FiniteProblem, NamingErrorFloor, PointwiseLeakageCap, Prior, least_regret
from inscrutable.reports.style import drawing

n = 3
problem = FiniteProblem(1.0 - np.eye(n))
prior = Prior(np.eye(n), np.full(n, 1.0 / n))

limits = np.linspace(0.0, 1.5, 31)
regrets = [least_regret(problem, prior, [PointwiseLeakageCap(nats=limit)]).regret for limit in limits]
response = (n - 1) / (n - 1 + np.exp(limits))  # randomized response, the best rule under local differential privacy
for limit in (0.0, 0.3, 0.5, 1.0):
    found = least_regret(problem, prior, [PointwiseLeakageCap(nats=limit)])
    print(f"ε = {limit:.1f}: regret {found.regret:.3f}, {found.prices[0]:.3f} less per nat")

# Several guarantees at once: each has a price, which is 0 for a guarantee that does not bind.
both = [PointwiseLeakageCap(nats=0.5), NamingErrorFloor(0.5)]
print(least_regret(problem, prior, both))
print(least_regret(problem, prior, [*both, Budget.regret(0.2)]))

with drawing() as (figure, axes):
    axes.plot(limits, regrets, label="pointwise maximal leakage at most ε")
    axes.plot(limits, response, "--", label="local differential privacy at the same ε")
    axes.set(xlabel="ε, in nats", ylabel="least regret", ylim=(0, None))
    axes.legend()
    figure.savefig("guaranteed_secret.png")
