"""
Decision maker
==============

The *original* decision maker (ODM) takes the decision of least expected cost. The *counter-adversarial* one (CDM) takes the
decision of the largest privacy whose regret is within a budget. The *probabilistic* one (PDM) draws from a *lottery* (a
randomised decision) whose expected regret is within the budget.

.. code-block:: text

   CDM: max Ψ(u) over u ∈ C with ρ(π,u) ≤ r
   PDM: max Σ_l p_l Ψ(u_l) over lotteries p with Σ_l p_l ρ(π,u_l) ≤ r

A plain number c_b as a budget means ``r = c_b |c*|``, the paper's share of the optimal cost; ``Budget.regret`` gives r itself.
"""

import numpy as np

from inscrutable import (
    CounterAdversarialDecisionMaker,
    MarkowitzProblem,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    privacy_frontier,
)
from inscrutable.reports.simplex_plots import plot_actions, plot_beliefs
from inscrutable.reports.style import LOOKS, drawing

regimes, assets = ("calm", "normal", "crisis"), ("stocks", "credit", "bills")
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
odm = OriginalDecisionMaker(problem).decide(belief)
cdm = CounterAdversarialDecisionMaker(problem, budget=0.1).decide(belief)
pdm = ProbabilisticDecisionMaker(problem, budget=0.1).decide(belief)
print(cdm.summary(), pdm.summary(), sep="\n\n")

# %%
# The left panel shows the portfolios, the right one the beliefs that explain them. The bars are the decisions of the lottery;
# their heights are the probabilities. To publish a draw, pass no generator: it then uses the operating system's entropy,
# because a known seed reveals the draw.

drawn = pdm.sample(rng=np.random.default_rng(0))
with drawing(7.4, 3.4, ncols=2, subplot_kw={"projection": "ternary"}) as (
    figure,
    (left, right),
):
    plot_actions(
        left,
        {"ODM": odm.action, "CDM": cdm.action, "PDM": drawn.action},
        assets,
        lottery=pdm,
    )
    plot_beliefs(
        right,
        belief,
        {"ODM": odm.belief_set, "CDM": cdm.belief_set, "PDM": drawn.belief_set},
        regimes,
    )
    figure.savefig("decisions.png")

# %%
# The *frontier* is the privacy-utility trade-off: the largest privacy at every budget. The frontier of lotteries is the concave
# envelope of the frontier of single decisions. Its slope (``Frontier.price``), the dual variable of the budget, is the privacy
# that one more unit of regret buys; the inverse, the regret of one more unit of privacy, is the *price of privacy*.

frontier = privacy_frontier(problem, belief)
regrets = np.linspace(0.0, 0.5 * abs(cdm.optimal_cost), 301)
with drawing(4.4, 2.8) as (figure, axes):
    axes.plot(
        1e4 * regrets,
        frontier.deterministic(regrets),
        color=LOOKS["CDM"].colour,
        label="CDM: one decision",
    )
    axes.plot(
        1e4 * regrets,
        frontier.randomized(regrets),
        "--",
        color=LOOKS["PDM"].colour,
        label="PDM: a lottery, on average",
    )
    axes.axvline(
        1e3 * abs(cdm.optimal_cost),
        color="#000000",
        linestyle=":",
        linewidth=0.9,
        label="a tenth of |c*|",
    )
    axes.set(
        xlabel="regret allowed, basis points", ylabel="privacy", ylim=(0, None)
    )
    axes.legend()
    figure.savefig("frontier.png")

# %%
# These two decision makers are designed against the naive observer. :class:`~inscrutable.RateDistortionDecisionMaker` and
# :class:`~inscrutable.StackelbergDecisionMaker` are designed against the aware observer; :doc:`/how-to-choose` says which to
# use.
