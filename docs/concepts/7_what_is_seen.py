"""
What is seen, and when
======================

So far every observer saw each decision exactly and at once. Real observers read a quarterly filing 45 days late, weights in
whole per cent, or a fund's value. A *disclosure* defines which part of a decision is shown, and when. Disclosures are data,
composed with ``|`` from left to right:

.. code-block:: text

   every(n, offset=0)   one decision in n          at_least(weight)     positions of that size, others as zero
   delayed(steps)       so many steps late         top(n)               the n largest positions
   rounded(digits)      rounded to decimals        grouped(labels)      sums over groups, such as sectors
   long_only()          no short positions         portfolio_return()   what the decision earns
   only(places)         some coordinates           bus_prices(problem)  prices at a network's buses

A disclosure of single decisions is a garbling: it merges columns of K(u | π). A schedule skips updates: the observer's law
moves by prediction alone until the next decision is shown.
"""

import numpy as np

from inscrutable import (
    MarkowitzProblem,
    OriginalDecisionMaker,
    delayed,
    every,
    form_13f,
    leakage,
    mechanism,
    rounded,
    uniform_prior,
)
from inscrutable.experiments.disclosing import under_disclosures
from inscrutable.mechanisms.chains import resting_chain
from inscrutable.reports.style import drawing, looks_of

means = [[0.02, 0.01, 0.005], [-0.03, 0.00, 0.004]]
covariances = [np.diag([0.002, 0.001, 0.0002]), np.diag([0.010, 0.003, 0.0003])]
problem = MarkowitzProblem(means, covariances, risk_aversion=5.0)
chain = resting_chain(uniform_prior(2, 12), 0.9)
played = mechanism(OriginalDecisionMaker(problem), chain.prior.beliefs)

shown = every(3) | delayed(2)
print(shown.summary())
print(shown(played.actions[:6]).round(2))

# %%
# Rounding makes decisions look alike, so that a single one leaks less:

for disclosure in (None, rounded(1), rounded(0)):
    found = leakage(played, chain.prior, disclosure=disclosure)
    print(
        f"{disclosure or 'exact'!s:12} {found.mutual_information:.2f} bits, error {found.bayes_error:.3f}"
    )

# %%
# How often and how late should decisions be shown? The error about the *present* belief falls when a decision is shown, by less
# if that decision is older, and then grows until the next one. `inscrutable disclose` draws this for your own market.

asked = ["exact", "delayed(2)", "every(3)", form_13f()]
table = under_disclosures(chain, played, asked, 19, rng=np.random.default_rng(0))
looks = looks_of([row.disclosure for row in table.rows])
with drawing(7.0, 3.0) as (figure, axes):
    for row, look in zip(table.rows, looks.values(), strict=True):
        axes.plot(
            row.errors,
            look.line,
            color=look.colour,
            marker=look.marker,
            label=row.disclosure,
        )
    dashed = {"color": "#000000", "linestyle": "--", "linewidth": 0.9}
    axes.axhline(table.prior_error, label="without decisions", **dashed)
    axes.set(xlabel="step (month)", ylabel="error about the present belief")
    axes.set_xticks(range(0, 19, 3))
    figure.legend(loc="outside upper center", ncols=5)
    figure.savefig("what_is_seen.png")
print(table.lines())

# %%
# **Less shown never leaks more**, for a fixed mechanism: an observer whose data are a function of another observer's data
# cannot err less about the present belief. So the leakage of exact is at least that of at_least(0.01), which is at least that
# of at_least(0.05). The same holds for every(2) and every(4), and for delayed(d) and delayed(d + 1). There is no order between
# rounded(1) and rounded(2), nor between every(3) and every(2).
#
# If the belief flips between two states with probability p, a guess from a decision d steps old is wrong with probability (1 −
# (1 − 2p)^d)/2.
#
# How long does a masked basket stay masked?
# -------------------------------------------
#
# Some funds publish every day a basket that differs from their holdings by random noise, a *mask*. If the mask is drawn afresh
# each day, an observer averages it: the standard error of a weight is σ/√n after n days, with σ that of one day. A mask that is
# kept does not average out. A fund's value also reveals its weights: with U assets of known returns, U − 1 days determine the
# weights of a fund that is rebalanced to the same weights every day (`infer_weights`), up to the error of the published values.
# The study `studies/masked_basket.toml` measures masks drawn daily, masks that are kept, and the fund's value.

from tempfile import TemporaryDirectory

from inscrutable import Study, run_study

study = Study.of(
    {"kind": "masked basket", "name": "masked", "repeats": 2, "funds": 50}
)
with TemporaryDirectory() as folder:
    frame = run_study(study, folder).frame()
days = [
    int(name.rpartition("_")[2])
    for name in frame
    if name.startswith("error_after_")
]
with drawing(7.0, 3.0) as (figure, axes):
    for (name, rows), look in zip(
        frame.groupby("shown"),
        looks_of(frame["shown"].unique()).values(),
        strict=True,
    ):
        errors = np.sqrt((rows[[f"error_after_{day}" for day in days]] ** 2).mean())
        axes.loglog(
            days,
            errors,
            look.line,
            color=look.colour,
            marker=look.marker,
            label=name,
        )
        print(f"{name:11} slope {rows['slope'].mean():+.2f}")
    axes.loglog(days, 0.02 / np.sqrt(days), ":", color="#000000", label="σ/√n")
    axes.set(xlabel="days watched", ylabel="error of a weight")
    figure.legend(loc="outside upper center", ncols=4)
    figure.savefig("masked_basket.png")

# %%
# What is prescribed
# ------------------
#
# `form_13f()` and `n_port()` are the calendars of two US forms, in steps of months, with their source and the date of
# retrieval. Alter decisions, never a disclosure that the law prescribes.

print(form_13f().summary())
