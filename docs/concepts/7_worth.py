"""
What is it worth to the rival?
==============================

Few rivals want the belief itself. They want to win something by it: a trade, a wager, a name for the state. What a rival loses
by what it does not know is a *loss* L(p) of its law p of the belief, the Bayes risk of a decision of its own:

.. code-block:: text

   L(p) = min_a Σ p(π) ℓ(π,a)
   worth of the secret     L(prior) − E L(the belief is known)
   worth of reading   W =  L(prior) − E L(p_u),   p_u the law after the decision u

`SquaredError()` is the variance of its estimate, what all other figures are in; `NamingError()` the chance that it names the
wrong state; `RivalProblem(problem)` the cost of its own decision problem on the same states, in its own unit. Reading is worth
nothing where decisions tell nothing, and never more than the secret.
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
# An agent that knows what the rival wants can hide that. `StackelbergDecisionMaker(..., loss=)` leaves the rival the largest loss
# at an expected regret; below, for each rival, what reading is still worth.

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
# **Nobody can be stopped from copying.** The rival with the agent's own problem sees the decision in time and can play it: it then
# pays what the agent pays. So, with r₀ the silence regret, which is what the belief is worth to both,
#
# .. code-block:: text
#
#    W ≥ r₀ − E ρ:    share given up + share taken ≥ 1,
#
# with equality where every decision is the best one for the law that it leaves. No rule lies below the dotted line for that rival,
# however clever it is. The rule above, whose budget holds at every belief, lies on it at first and above it later. For a rival with
# another problem there is no such line: at first the wager and the name are hidden for less. To hide a view protects it from one
# with other assets or limits, one who wagers on the regime, one who comes later and one who wants the next decision, and never
# from one who trades the same at the same moment.
#
# `inscrutable compare --rival FILE` prints the worth of every rule's decisions and draws this picture for all of them;
# `inscrutable backtest` says in basis points what the weights were worth to a rival who invests alike.
