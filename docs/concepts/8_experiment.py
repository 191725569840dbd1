"""
Experiment
==========

A *study* is a grid: worlds × problems × budgets × decision makers × observers × repeats. It is described by plain data; a list
stands for each of its elements in turn.
"""

from tempfile import TemporaryDirectory

from inscrutable import Study, run_study
from inscrutable.reports.style import drawing, looks_of

study = Study.of(
    {
        "name": "five budgets, three rules, two observers",
        "world": {"kind": "random"},
        "beliefs": {"kind": "grid", "resolution": 8},
        "candidates": {"resolution": 12},
        "decision_makers": ["CDM", "PDM", "rate-distortion"],
        "budgets": {"unit": "silence", "values": [0.1, 0.25, 0.5, 0.75, 1.0]},
        "adversaries": ["naive", "bayesian"],
        "measures": ["error", "prior_error", "expected_regret"],
    }
)
with TemporaryDirectory() as folder:
    rows = run_study(study, folder).frame()
columns = ["decision_maker", "budget", "adversary", "error", "prior_error"]
print(rows[columns].round(3).to_string(index=False))

# %%
# The unit of the budget is the *silence regret*, the expected regret of the best constant decision (the value of information).
# The figure shows the error of the observer's estimate. Above the dotted line the observer errs more than without any decision.

with drawing(6.8, 2.7, ncols=2, sharey=True) as (figure, panels):
    for axes, (observer, part) in zip(
        panels, rows.groupby("adversary", sort=False), strict=True
    ):
        looks = looks_of(part.decision_maker.unique())
        for name, each in part.groupby("decision_maker", sort=False):
            look = looks[name]
            axes.plot(
                each.budget,
                each.error,
                look.line,
                color=look.colour,
                marker=look.marker,
                zorder=3 if look.marker == "x" else 2,  # a cross on a dot
                label=name,
            )
        dotted = {"color": "#000000", "linestyle": ":", "linewidth": 0.9}
        alone = part.prior_error.iloc[0]
        axes.axhline(alone, label="without decisions", **dotted)
        axes.set(xlabel="budget, share of the silence regret", ylim=(-0.03, None))
        known = {"bayesian": "aware"}.get(observer, observer)
        axes.set_title(f"{known} observer", loc="left")
    panels[0].set_ylabel("error of its estimate")
    panels[0].legend()
    figure.savefig("experiment.png")

# %%
# ``inscrutable study run FILE --out DIR --jobs -1`` does the same from a TOML file, on all cores or a Dask cluster. Rows go to
# one SQLite file; ``inscrutable study resume DIR`` continues a study that was stopped or killed.
#
# ``inscrutable backtest`` is an experiment with one investor on real returns, ``inscrutable compare`` one with all rules and
# observers, and ``inscrutable reproduce`` the paper's numerical section.
