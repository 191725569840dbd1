"""The page of a comparison, with sliders for the budget and the number of observed decisions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from inscrutable.experiments.comparison import Comparison
from inscrutable.labels import capital
from inscrutable.reports.comparison import main_columns, notes_of, short_table, worth
from inscrutable.reports.comparison_plots import main_makers
from inscrutable.reports.names import spelled
from inscrutable.reports.page.content import PageContent, PageFigure, PageSlider, PageTable
from inscrutable.reports.page.manifest import versions_told
from inscrutable.reports.style import PERCENT, looks_of
from inscrutable.validation import Array

_DIGITS = 4
_SPENT_LESS = 0.98

_GIVEN_AS = {"silence": "shares of the silence regret", "cost": "shares of E|c*|", "regret": "regrets"}


def comparison_content(comparison: Comparison, title: str | None, manifest: Mapping[str, str]) -> PageContent:
    """Return the content of a comparison's page; `manifest` has further lines for the page's manifest."""
    seen = [_decisions(n) for n in comparison.repeats] + ["all so far, on a belief that moves"] * comparison.is_moving
    budgets = [worth(comparison, budget) for budget in comparison.budgets]
    return PageContent(
        title=title or "Decision rules at equal expected regret",
        header=f"{capital(comparison.header())}.",
        verdict=comparison.summary().splitlines(),
        tables=[_table(comparison, b, text, main_columns(comparison)) for b, text in enumerate(budgets)],
        details=[_table(comparison, b, text, None) for b, text in enumerate(budgets)],
        sliders=[
            PageSlider("budget", "Expected regret", _short(comparison), _middle(comparison)),
            PageSlider("seen", "Decisions seen", seen, 0),
        ],
        figures=[
            PageFigure(
                "both",
                "Both observers at this expected regret",
                "Hollow marks are the error of the aware observer, who knows the rule; filled ones that of the naive observer, "
                "who takes decisions at face value. The dotted line bounds the aware observer's error from all decisions so "
                "far, under any rule of the same expected regret.",
                True,
            ),
            PageFigure(
                "naive",
                "Naive observer: takes one decision at face value",
                "The curves are the error of the estimate (root mean square) against the expected regret. The dashed line is "
                "the error without decisions, the vertical one the expected regret of the table.",
            ),
            PageFigure(
                "aware",
                "Aware observer: knows the rule and the prior",
                "The curves are the same for the aware observer; bars are 95 % intervals where figures are sampled."
                + (
                    " The dotted line bounds the error from all decisions so far, under any rule of the same expected regret."
                    * bool(comparison.ceilings)
                ),
            ),
        ],
        failures=_failures(comparison),
        notes=notes_of(comparison),
        manifest={
            **versions_told(),
            "expected regrets": ", ".join(f"{budget:.6g}" for budget in comparison.budgets),
            "given as": _GIVEN_AS[comparison.unit],
            "decisions under one belief": ", ".join(str(n) for n in comparison.repeats),
            "sequences sampled": str(comparison.n_draws),
            "beliefs of the prior": str(comparison.n_beliefs),
            "candidate decisions": str(comparison.n_candidates),
            **manifest,
        },
        script="comparison.js",
        data=page_data(comparison),
    )


def _short(comparison: Comparison) -> list[str]:
    """Return budgets as text that fits beside a slider on a phone."""
    silent = comparison.silence_regret
    return [
        f"{each / silent:.0%} of the silence regret" if silent > 0 else f"{each:.3g}" for each in comparison.budgets
    ]


def _middle(comparison: Comparison) -> int:
    """Return the index of the verdict's budget."""
    return comparison.budgets.index(comparison.middle_budget)


def _decisions(n: int) -> str:
    return "1 decision" if n == 1 else f"{n} decisions on one belief"


def _table(comparison: Comparison, place: int, text: str, columns: list[str] | None) -> PageTable:
    """Return the table of figures at one budget: some columns, or all."""
    frame = short_table(comparison, comparison.budgets[place])
    heading = f"Expected regret of {text}" if columns else f"All figures at an expected regret of {text}"
    frame = frame[columns] if columns else frame
    rows = [[spelled(str(name)), *map(str, row)] for name, row in zip(frame.index, frame.to_numpy(), strict=True)]
    return PageTable(heading, ["Decision maker", *frame.columns], rows, ("budget", place))


def page_data(comparison: Comparison) -> dict[str, Any]:
    """Return the script's data, rounded."""
    looks = looks_of(comparison.makers)
    silent = comparison.silence_regret > 0
    scale = PERCENT / comparison.silence_regret if silent else 1.0
    return {
        "makers": comparison.makers,
        "main": main_makers(comparison),
        "spelled": {name: spelled(name) for name in comparison.makers},
        "looks": {name: look._asdict() for name, look in looks.items()},
        "budgets": [float(f"{scale * budget:.6g}") for budget in comparison.budgets],
        "unit": "% of the silence regret" if silent else "the cost's unit",
        "prior": round(comparison.prior_error, _DIGITS),
        "ceilings": [
            [float(f"{scale * budget:.6g}"), round(most, _DIGITS)] for budget, most in comparison.ceilings.items()
        ],
        "rows": {
            maker: [
                {
                    "budget": comparison.budgets.index(row.budget) if row.budget in comparison.budgets else None,
                    "regret": float(f"{scale * row.expected_regret:.6g}"),
                    "naive": round(row.naive_error, _DIGITS),
                    "aware": _seen(row.repeated_errors, row.path_error, comparison),
                    "se": _seen(row.repeated_error_se, row.path_error_se, comparison),
                }
                for row in comparison.of(maker)
            ]
            for maker in comparison.makers
        },
    }


def _seen(repeated: Array, over_time: float, comparison: Comparison) -> Array:
    """Return the figures after each number of decisions on one belief, and over time where known."""
    return np.asarray(np.round(np.append(repeated, [over_time] * comparison.is_moving), _DIGITS))


def _failures(comparison: Comparison) -> list[str]:
    found = [f"{name} is left out: it does not suit the problem." for name in comparison.left_out]
    for maker in comparison.makers:
        rows = comparison.of(maker)
        spent = [row for row in rows if row.budget > 0 and row.expected_regret < _SPENT_LESS * row.budget]
        if spent:
            shares = ", ".join(
                f"{row.expected_regret / row.budget:.0%} of a regret of {row.budget:.3g}" for row in spent
            )
            found.append(
                f"{capital(spelled(maker))} spends less than the budget, because no decision gains by more or its parameter "
                f"moves in steps: {shares}."
            )
        odd = [row for row in rows if row.implausible_share > 0]
        if odd:
            shares = ", ".join(f"{row.implausible_share:.1%} at a regret of {row.budget:.3g}" for row in odd)
            found.append(f"No belief explains some decisions of {spelled(maker)}: {shares}.")
    return found
