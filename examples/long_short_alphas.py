"""Alphas of 500 names
===================

Take a long and short book of 500 names with 20 factors. What do its weights reveal, and what does hiding half of it cost?

A desk's private view is no belief over regimes but a vector of expected returns, its alphas. Without constraints the weights
are V⁻¹m/(2γ): whoever knows V and γ computes every alpha from them.

Writes long_short_alphas.png into the current folder.
"""

from __future__ import annotations

import numpy as np

from inscrutable import AlphaDecisionMaker, AlphaProblem, FactorRisk, LinearGaussianWorld, Polyhedron
from inscrutable.reports.style import drawing

rng = np.random.default_rng(0)
n, k = 500, 20
exposures = rng.standard_normal((n, k)) * np.linspace(1.0, 0.2, k)
specific = rng.uniform(0.05, 0.12, n) ** 2  # a month
risk = FactorRisk(exposures, 0.02**2 * np.eye(k), specific)
dollar_neutral = Polyhedron(A_eq=np.ones((1, n)), b_eq=[0.0])
problem = AlphaProblem(risk, risk_aversion=20.0, constraints=dollar_neutral)

# The public law of the alphas: they are small, and have a small component along the factors.
law = FactorRisk(exposures, 0.002**2 * np.eye(k), 0.03**2 * specific)
alphas = law.root @ rng.standard_normal(k) + np.sqrt(law.specific) * rng.standard_normal(n)

# %%
# What the weights reveal
# -----------------------
# The dollar-neutral constraint leaves a common shift of all alphas undetermined; the weights reveal the rest exactly.
book = problem.optimum(alphas)
read = 2.0 * problem.risk_aversion * risk.times(book)
print(
    f"gross {np.abs(book).sum():.2f}; alphas read off the weights, up to a shift, miss by "
    f"{np.abs((read - read.mean()) - (alphas - alphas.mean())).max():.1e}"
)

# %%
# What hiding costs
# -----------------
# The rule is reverse water-filling. It hides completely the directions that cost less to hide than a common level. Of each
# other direction it reveals just enough to lower its cost to that level. Here the factors pay most for their risk: they are
# revealed first.
points = 1e4
for share in (0.1, 0.25, 0.5, 0.75):
    maker = AlphaDecisionMaker(problem, share, prior_covariance=law)
    left = maker.error / law.diagonal.sum()
    print(
        f"{share:4.0%} of silence: {points * maker.regret:5.2f} of {points * maker.silence_regret:.2f} basis points a month, "
        f"{maker.bits:6.1f} bits, {left:.0%} of the variance of the alphas is left"
    )

# %%
# What a copier gains
# -------------------
# A rival with the same problem who copies the published book at the same moment gains the part of the alphas' worth that the
# desk does not give up.
maker = AlphaDecisionMaker(problem, 0.5, prior_covariance=law)
drawn = maker.decide(alphas, rng=rng)
constant = problem.optimum(np.zeros(n))
worth = problem.regret(alphas, constant)
print(
    f"these alphas are worth {points * worth:.2f} basis points: {points * drawn.regret:.2f} given up, "
    f"{points * (worth - drawn.regret):.2f} taken by one who copies"
)

# %%
# Persistent alphas
# -----------------
# Twenty factor views are drawn afresh every month, or decay by a tenth a month. An observer of the decaying ones who remembers
# all books knows most of a view before the next book, which therefore adds less information. (The desk estimates them from a
# noisy signal. Its estimates vary less than the views, so that silence costs less.)
views = AlphaProblem(risk, 20.0, loadings=exposures)
fading = LinearGaussianWorld(0.9 * np.eye(k), 0.19 * 0.002**2 * np.eye(k), np.eye(k), 0.001**2 * np.eye(k))
for given in ({"prior_covariance": 0.002**2 * np.eye(k)}, {"world": fading}):
    lasting = AlphaDecisionMaker(views, 0.5, **given)
    print(
        f"{next(iter(given)):17s} {lasting.bits:5.2f} bits a month, gap {lasting.gap:.0e}, "
        f"{points * lasting.regret:.3f} basis points"
    )

with drawing(width=5.0) as (figure, axes):
    axes.scatter(100 * alphas, 100 * drawn.estimate, s=4)
    axes.axline((0.0, 0.0), slope=1.0, color="black", linewidth=0.5)
    axes.set(xlabel="alpha, % a month", ylabel="what the observer believes of it, %")
    figure.savefig("long_short_alphas.png")
