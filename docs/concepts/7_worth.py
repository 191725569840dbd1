"""
What is it worth to the rival?
==============================

A *rival* is an observer who gains by knowing the belief: by a trade, by a wager, or by naming the state. Let p be its law of
the belief. Its *loss* L(p) is the Bayes risk of its own decision problem:

.. code-block:: text

   L(p) = min_a Σ p(π) ℓ(π,a)
   worth of the secret     L(prior) − E L(the belief is known)
   worth of reading   W =  L(prior) − E L(p_u),   p_u the law after the decision u

Three such losses are:

- `SquaredError()`, the default: the mean square error of its best estimate;
- `NamingError()`: the probability that it names the wrong state;
- `RivalProblem(problem)`: the cost of its own decision problem on the same states, in its own unit.

Reading is worth nothing where decisions reveal nothing, and at most as much as the secret.
"""

import numpy as np

from inscrutable import (
    Budget,
    FiniteProblem,
    MarkowitzProblem,
    NamingError,
    OriginalDecisionMaker,
    RivalProblem,
    StackelbergDecisionMaker,
    decoy_grid,
    leakage,
    mechanism,
    uniform_prior,
)
from inscrutable.reports.style import drawing

means = [[0.02, 0.01, 0.005], [-0.03, 0.00, 0.004]]
covariances = [np.diag([0.002, 0.001, 0.0002]), np.diag([0.010, 0.003, 0.0003])]
problem = MarkowitzProblem(means, covariances, risk_aversion=5.0)
prior, candidates = uniform_prior(2, 20), decoy_grid(problem, 40)

wager = FiniteProblem([[-1.0, 3.0, 0.0], [3.0, -1.0, 0.0]])  # three to one
rivals = {
    "its own portfolio": RivalProblem(problem),
    "a wager on the regime": RivalProblem(wager),
    "the regime's name": NamingError(),
}
optimal = mechanism(OriginalDecisionMaker(problem), prior.beliefs)
for name, loss in rivals.items():
    told = leakage(optimal, prior, problem, loss=loss)
    print(f"{name:22s}the secret is worth {told.secret_worth:.4f} ({loss.unit})")

# %%
# An agent that knows the rival's problem can hide what the rival gains from. `StackelbergDecisionMaker(..., loss=)` maximises
# the rival's loss at an expected regret. The figure shows the worth of reading that remains to each rival.

silence = leakage(optimal, prior, problem).silence_regret
shares = np.linspace(0.0, 1.0, 6)
with drawing(7.4, 3.2) as (figure, axes):
    for (name, loss), mark in zip(rivals.items(), "so^", strict=True):
        worth = []
        for share in shares:
            hidden = StackelbergDecisionMaker(
                problem,
                Budget.regret(share * silence),
                prior=prior,
                candidates=candidates,
                loss=loss,
                gap=0.01,
            )
            told = leakage(hidden.mechanism, prior, problem, loss=loss)
            worth.append((told.silence_share, told.worth_share))
        axes.plot(*np.array(worth).T, marker=mark, label=name)
    axes.plot([0, 1], [1, 0], ":", color="black", label="copying")
    axes.set_xlabel("expected regret, share of the silence regret")
    axes.set_ylabel("worth of reading, share of the secret's")
    axes.legend()
    figure.savefig("worth.png")

# %%
# **Copying cannot be prevented.** A rival with the agent's own problem who sees the decision in time can play it, at the
# agent's cost. Let r₀ be the silence regret, which is the value of information to both. Then
#
# .. code-block:: text
#
#    W ≥ r₀ − E ρ,    so    E ρ/r₀ + W/r₀ ≥ 1,
#
# with equality where every decision is optimal for the posterior mean after it. No rule lies below the dotted line for that
# rival. The rule above, whose budget holds at every belief, lies on it at small regrets and above it at larger ones. There is
# no such line for a rival with another problem: at small regrets, hiding from the rivals who wager or name costs less. Hiding
# protects against a rival with other assets or limits, one who wagers on the regime, one who trades later, and one who predicts
# the next decision. It does not protect against one who makes the same trade at the same moment.
#
# `inscrutable compare --rival FILE` prints the worth of every rule's decisions and draws this picture for all of them;
# `inscrutable backtest` states in basis points the worth of the weights to a rival with the investor's own problem.
