"""
Gaussian beliefs
================

Most trading desks have no belief over regimes but a vector of expected returns, *alphas*; most controllers have an estimate
with a covariance. The structure is the same. A hidden state moves linearly with Gaussian noise, a private sensor observes it,
and a Kalman filter gives the belief N(m, P). Everybody who knows the model knows the covariance P. The mean m is private, and
determines the decision

.. math:: \\min_{u \\in C} \\; \\gamma u'Vu - (Bm)'u ,

where V is the covariance of the assets and B are the loadings of assets on signals (with B = I, m holds the expected returns
themselves).
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from inscrutable import (
    AlphaProblem,
    Budget,
    FactorRisk,
    LinearGaussianWorld,
    MaximalObfuscation,
    Study,
    box,
    implied_views,
    kalman_filter,
    obfuscated_decision,
    run_study,
    simplex,
    steady_filter,
)
from inscrutable.reports.style import drawing
from inscrutable.reports.views import draw_views

# %%
# From observations to a mean
# ---------------------------
#
# The signal below decays by a tenth a month and is observed with noise of its own variance. An observation may be missing; the
# filter then only predicts. After some months its covariance has converged.

world = LinearGaussianWorld([[0.9]], [[0.19]], [[1.0]], [[1.0]])
readings = world.sample(60, rng=np.random.default_rng(0)).observations
readings[10] = np.nan
means, covariances, _ = kalman_filter(world, readings)
print(f"variance left after a month {covariances[0, 0, 0]:.3f}, ", end="")
print(f"after five years {covariances[-1, 0, 0]:.3f}, ", end="")
print(f"in the long run {steady_filter(world).covariance[0, 0]:.3f}")

# %%
# What weights say
# ----------------
#
# An observer who knows V, γ and C solves the inverse problem: u is optimal for every m with
#
# .. math:: Bm \in 2\gamma Vu + N_C(u),
#
# where N_C(u) is the normal cone of the active constraints. Without constraints that is one point, which is Sharpe's reverse
# optimisation and the prior of Black and Litterman. Where weights must sum to one, a constant added to all expected returns
# changes nothing, so that only differences are identified. A weight at a limit gives one inequality. Take differences from an
# asset that is not at a limit: of an asset at its cap the weights give only a lower bound. Factor covariances are never
# multiplied out, so that thousands of assets take milliseconds.

rng = np.random.default_rng(3)
names = ["Food", "Oil", "Chips", "Banks", "Drugs", "Cars", "Power", "Shops"]
exposures = pd.DataFrame(rng.normal([1.0, 0.0], [0.2, 0.5], size=(8, 2)), names)
risk = FactorRisk(exposures, np.diag([0.0016, 0.0004]), np.full(8, 0.002))
problem = AlphaProblem(risk, 4.0, simplex(8) & box(np.zeros(8), np.full(8, 0.25)))
mean = rng.normal(0.005, 0.002, size=8)
weights = problem.optimum(mean)
views = implied_views(problem, weights, reference="Chips")
print(views)

# %%
# Now the observer assumes only that the weights cost at most two basis points a month more than the best ones. For assets that
# are not held there is only an upper bound: the arrows mean that the interval is unbounded below.

near = implied_views(problem, weights, regret=0.0002, reference="Chips")
with drawing(7.0, 2.8, ncols=2, sharey=True) as (figure, axes):
    draw_views(near, axes)
    figure.savefig("implied_views.png")

# %%
# How far from the truth
# ----------------------
#
# The paper's measures apply to implied views as to sets of beliefs. Within a regret r, and without constraints, the farthest
# view lies along the riskiest direction, at √(4γ r λ), with λ the largest eigenvalue of V: there an error in expected returns
# moves weights least. Under limits the search follows rays from m until the budget is spent. It keeps weights off their limits
# by the least slack: all views on one side explain a weight at a limit, and the true one may be among them.

free = AlphaProblem(risk, 4.0)
for shown, what in ((free, "no limits"), (problem, "long-only, capped")):
    hidden = obfuscated_decision(shown, mean, Budget.regret(0.0002))
    read = implied_views(shown, hidden.weights)
    print(f"{what}: {hidden.summary()}")
    print(f"  the true view is {MaximalObfuscation()(mean, read):.5f} away")

# %%
# This was one decision against the naive observer. The aware observer infers more.
#
# What the aware observer learns
# ------------------------------
#
# `AlphaDecisionMaker` has a given expected regret, a share of the silence regret, which is the regret of the decision for the
# public law alone. Its objective is the fewest bits or the largest error of the observer. It reaches the optimum of either
# among all rules of this regret (over time and above 120 signals a status says where a gap remains). The study `studies/alphas.toml` computes this in random markets, and lets an observer learn
# from simulated decisions; here is a part of it. The rule of the largest error leaks many bits: it reveals some directions
# nearly exactly, and others not at all.

file = {
    "kind": "alphas",
    "name": "alphas",
    "assets": 6,
    "persistence": [0.9],
    "steps": 200,
    "repeats": 2,
}
with TemporaryDirectory() as folder:
    rows = run_study(Study.of(file), Path(folder) / "study").frame()
means = rows.groupby(["objective", "budget"]).mean(numeric_only=True)
print(means[["bits", "error_share", "simulated_error_share"]].round(2).to_string())
with drawing(7.0, 2.8, ncols=2) as (figure, axes):
    for axis, figures, said in zip(
        axes,
        (("bits", "least_bits"), ("error_share", "most_error_share")),
        ("bits a decision", "share of error left"),
        strict=True,
    ):
        for marker, (objective, part) in zip(
            "os", means.groupby("objective"), strict=True
        ):
            axis.plot(
                part.loc[objective].index,
                part[figures[0]],
                marker + "-",
                label=f"rule of {objective}",
            )
        best = means.loc["information"]
        axis.plot(best.index, best[figures[1]], "k--", label="best of any rule")
        axis.set_xlabel("share of the silence regret")
        axis.set_ylabel(said)
    axes[0].set_yscale("log")
    axes[1].legend()
    figure.savefig("alpha_study.png")
