"""Files of a comparison: a table as CSV and Markdown, a summary as JSON, and one figure."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from inscrutable import __version__
from inscrutable.datasets import output_folder, write_json, write_table
from inscrutable.experiments.comparison import COMPARED, Comparison
from inscrutable.experiments.comparison_measures import ComparisonRow
from inscrutable.experiments.comparison_sensor import ACCURACY, SENSOR_STEPS, STAYS
from inscrutable.experiments.comparison_watchers import GAMMA_RANGE, N_PATHS, PATH_STEPS
from inscrutable.experiments.makers import MAKERS
from inscrutable.files import whole_file
from inscrutable.labels import capital
from inscrutable.reports.comparison_plots import draw_comparison, draw_rival
from inscrutable.reports.style import PERCENT

_TITLE_WIDTH = 10
_OVER_TIME = "error, aware, over time"
_TOLD = ", rule knows it stays"


class _Column(NamedTuple):
    """A column of the short table: its title with the unit, its value, and its number format."""

    title: str
    value: Callable[[ComparisonRow], float | str]
    style: str = ".3f"
    is_main: bool = False


def _columns(comparison: Comparison) -> list[_Column]:
    last = max(comparison.repeats)
    after = [
        _Column(
            f"error, aware, {n} decisions" if n > 1 else "error, aware",
            _entry("repeated_errors", s) if n > 1 else lambda row: row.bayes_error,
            is_main=n in (1, last),
        )
        for s, n in enumerate(comparison.repeats)
    ]
    told = [
        _Column(f"error, aware, {n} decisions{_TOLD}", _entry("told_errors", s))
        for s, n in enumerate(comparison.repeats)
        if n > 1 and comparison.ceilings
    ]
    over_time = [
        _Column(_OVER_TIME, lambda row: row.path_error, is_main=True),
        _Column("bits a decision, over time", lambda row: row.path_bits, ".2f"),
    ]
    astray = [
        _Column("over time, stays half as long", lambda row: row.path_error_half),
        _Column("over time, stays twice as long", lambda row: row.path_error_double),
    ]
    learned = [
        _Column("error, cost learned", lambda row: row.learned_error),
        _Column("risk aversion learned", _learned),
    ]
    from_data = [
        _Column(f"error, data alone, {n} pairs", _entry("data_errors", s)) for s, n in enumerate(comparison.pairs)
    ]
    return [
        _Column("regret, % of silence", lambda row: PERCENT * row.silence_share, ".1f", True),
        _Column("% of |c*|", lambda row: PERCENT * row.cost_share, ".2f"),
        _Column(
            "worst, % of silence",
            lambda row: PERCENT * row.worst_regret / (comparison.silence_regret or np.nan),
            ".0f",
        ),
        _Column("privacy, naive", lambda row: row.naive_privacy),
        _Column("error, naive", lambda row: row.naive_error, is_main=True),
        _Column("error, near-optimal", lambda row: row.near_optimal_error),
        _Column("error, budget-aware", lambda row: row.budget_aware_error),
        *from_data,
        *after,
        *told,
        *(over_time if comparison.is_moving else []),
        *(astray if comparison.ceilings else []),
        *(learned if comparison.is_learned else []),
        *([_Column("error, sensor", lambda row: row.sensor_error, ".2f")] if _reads_sensor(comparison) else []),
        *([_worth_column(comparison)] if comparison.rival else []),
        _Column("bits", lambda row: row.mutual_information, ".2f", True),
        _Column("top state, naive, %", lambda row: PERCENT * row.naive_top_state, ".0f"),
        _Column("top state, aware, %", lambda row: PERCENT * row.top_state_accuracy, ".0f"),
        _Column("detectability, AUC", lambda row: row.read_auc, ".2f"),
    ]


def main_columns(comparison: Comparison) -> list[str]:
    """Return the titles of the main columns, few enough for a terminal and a phone."""
    return [each.title for each in _columns(comparison) if each.is_main]


def _reads_sensor(comparison: Comparison) -> bool:
    return any(np.isfinite(row.sensor_error) for row in comparison.rows)


def _worth_column(comparison: Comparison) -> _Column:
    secret = comparison.secret_worth or np.nan
    return _Column("worth to the rival, % of the secret's", lambda row: PERCENT * row.rival_worth / secret, ".1f", True)


_STRENGTHS = {"delay": "steps: {:.0f}", "partial trades": "fraction {:.2g}"}
"""Format of a decision maker's parameter beside its name."""


def _entry(field: str, place: int) -> Callable[[ComparisonRow], float]:
    """Return a function that gives an entry of a row's array."""
    return lambda row: float(getattr(row, field)[place])


def _learned(row: ComparisonRow) -> str:
    """Return the risk aversions that explain every decision of a path, as text."""
    if np.isnan(row.learned_holds):
        return "-"
    if np.isnan(row.learned_low):
        return "none explains all"
    low, high = f"{row.learned_low:.3g}", f"{row.learned_high:.3g}"
    told = low if low == high else f"{low} to {high}"
    return told if row.learned_holds else f"{told}, wrong"


def short_table(comparison: Comparison, budget: float | None = None) -> pd.DataFrame:
    """Return the main figures as text, one row per decision maker and budget.

    Args:
        comparison: From `compare`.
        budget: One of `comparison.budgets`, with the decision makers that spend nothing; None: all budgets.
    """
    kept = [row for row in comparison.rows if budget is None or row.budget in (0.0, budget)]
    columns = _columns(comparison)
    lines = [{each.title: _written(each.value(row), each.style) for each in columns if each.title} for row in kept]
    names = [_name(row) for row in kept]
    for known, ceiling in comparison.ceilings.items():
        if budget is None or known == budget:
            lines.append(
                {each.title: _written(ceiling, ".3f") if each.title == _OVER_TIME else "-" for each in columns}
            )
            names.append("ceiling" if budget is not None else f"ceiling at {known:.3g}")
    return pd.DataFrame(lines, index=pd.Index(names, name="decision maker"))


def _name(row: ComparisonRow) -> str:
    if row.maker not in _STRENGTHS or np.isnan(row.strength):
        return row.maker
    return f"{row.maker} ({_STRENGTHS[row.maker].format(row.strength)})"


def terminal_table(comparison: Comparison, budget: float) -> pd.DataFrame:
    """Return the main columns of one budget with titles broken into lines, for a terminal."""
    table = short_table(comparison, budget)[main_columns(comparison)]
    table.index.name = None
    return table.rename(columns=lambda title: "\n".join(wrap(title, _TITLE_WIDTH, break_long_words=False)))


def _written(value: float | str, style: str) -> str:
    if isinstance(value, str):
        return value
    return "-" if np.isnan(value) else format(value + 0.0, style)


def notes_of(comparison: Comparison) -> list[str]:
    """Return the definitions of the table."""
    per_belief = "shares of |c*|" if comparison.per_belief_unit == "|c*|" else "the same regret at every belief"
    return [
        "All decision makers of one budget spend the same expected regret under the prior, to a millionth from below; budgets "
        f"per belief are {per_belief}, scaled to that regret. A rule whose parameter is discrete, such as rounding or a delay, "
        "spends less; the first column says how much.",
        *_who_is_who(comparison),
        "An error is the root mean square of the Euclidean distance between the belief and the observer's estimate. The naive "
        "observer takes decisions for optimal. The near-optimal one allows for the expected regret, the budget-aware one for "
        "the largest regret of any decision; both know the prior. The aware one also has the rule. Where no "
        "belief explains a decision to an observer, its estimate is the belief that leaves it the least regret.",
        *_columns_told(comparison),
        *_on_paths(comparison),
        "Repeated decisions are independent draws under the same belief and mechanism; their figures are sampled "
        f"({comparison.n_draws} sequences) where a mechanism is randomised.",
        "Observers see decisions in full precision, and the prior has finitely many beliefs: an optimal decision of only one "
        "of them identifies it.",
        *_watchers(comparison),
        *_rival(comparison),
        "detectability, AUC: the area under the ROC curve of the test of one decision against an optimal one, by the naive "
        "observer's estimate; 0.5 is chance, 1 certainty.",
        "comparison.csv has all figures in full precision; its columns are the fields of "
        "ComparisonRow in inscrutable.experiments.comparison_measures, whose documentation defines each.",
        *(
            [f"Left out, because they do not suit the problem: {', '.join(comparison.left_out)}."]
            if comparison.left_out
            else []
        ),
    ]


def _columns_told(comparison: Comparison) -> list[str]:
    """Return the definitions of the columns that are not errors."""
    return [
        "regret: the expected regret as a share of the silence regret, which is that of the best constant decision, and as a "
        "share of the mean optimal cost E|c*|. worst: the largest regret of any decision that is played.",
        "privacy, naive: mean Euclidean distance of the belief from the beliefs for which the decision is optimal, over "
        f"decisions that are optimal for some. bits: mutual information of belief and decision, of the "
        f"{comparison.prior_entropy:.2f} bits of the prior.",
        "top state: how often the observer names a most likely state of the belief; always naming the commonest is right in "
        f"{comparison.prior_top_state:.0%} of the cases.",
    ]


def _who_is_who(comparison: Comparison) -> list[str]:
    """Return a note on each decision maker."""
    told = [f"{name}: {_text_of(COMPARED[name])}." for name in comparison.makers if name in COMPARED]
    return told or ["The decision makers have the names that the caller gave them."]


def _text_of(chosen: Mapping[str, Any]) -> str:
    """Return the registry's description of a decision maker."""
    text = (MAKERS[chosen["name"]].__doc__ or "").partition("\n")[0].rstrip(".")
    named = text.startswith("Dirichlet")
    said = text if named else text[0].lower() + text[1:]
    return said + (", here among the candidates alone" if "method" in chosen else "")


def _on_paths(comparison: Comparison) -> list[str]:
    """Return notes on rules with a memory, if there are any."""
    found = []
    if "delay" in comparison.makers:
        found.append(
            "delay: the optimal decision of some steps ago, with the longest affordable delay; aware: knows the delay and the "
            "chain of beliefs. If a belief stays for longer than the delay, the decision is its own optimal one."
        )
    if "partial trades" in comparison.makers:
        found.append(
            "partial trades: a trade of a fixed fraction of the way to the optimal decision at every step; aware: knows the "
            "fraction and the previous decision, which determine the optimal one exactly. An observer who does not know the "
            "rule uses each decision alone."
        )
    if comparison.ceilings:
        found.append(
            "sequential: depends on the observer's law of the belief and on the chain of beliefs. For several decisions on one "
            "belief there are two errors: the rule assumes the chain although the belief stays; or the rule knows that it "
            'stays, at the same prices (columns "rule knows it stays"; comparison.csv has its regret). Long-run figures are '
            "simulated; the expected regret equals the requested one up to its standard error. Single decisions are judged by "
            "the rule's long-run law. stays half, twice as long: the error over time if beliefs stay half or twice as long as "
            "the rule assumes. ceiling: an upper bound of the aware observer's error over time for every rule of the same "
            "expected regret on the candidate decisions. All these figures hold for this chain alone."
        )
    return found


def _watchers(comparison: Comparison) -> list[str]:
    """Return notes on observers of a path of decisions, or why there are none."""
    found = []
    if comparison.is_moving:
        found.append(
            "aware, over time: knows the rule and the chain of beliefs, and filters the belief given every decision so far. "
            f"Its error is over the later half of {N_PATHS} paths of {PATH_STEPS} decisions (root mean square; standard "
            "errors in the CSV file). Without decisions its error is that of the prior at every step."
        )
    else:
        found.append("There is no observer over time, because no chain of beliefs is given.")
    if comparison.is_learned:
        found.append(
            f"cost learned: does not know the risk aversion. It takes {PATH_STEPS} decisions on one path of beliefs for "
            f"optimal and keeps the values between a {GAMMA_RANGE:.0f}th and {GAMMA_RANGE:.0f} times the true one that explain "
            "all of them (risk aversion learned; wrong: the true one is not among them). It then judges single decisions like "
            "the naive observer, with the middle of these values. If no value explains all decisions, it has no estimate."
        )
    else:
        found.append("There is no observer who learns the risk aversion, because the cost has none.")
    if _reads_sensor(comparison):
        found.append(
            f"error, sensor: of the sensor estimated from {SENSOR_STEPS} decisions on one path by a naive observer who knows "
            "the transition of the state (Frobenius norm, best names of the symbols), as a share of the error without "
            "decisions; 0 is exact, 1 or more is hidden. A sensor that names the state in "
            f"{ACCURACY:.0%} of the steps, in a chain that stays in {STAYS:.0%}, replaces the agent's; a belief between those "
            "of the prior is estimated with the error of the nearest one."
        )
    if comparison.pairs:
        found.append(
            "data alone: knows neither the costs nor the rule nor the prior, and has seen that many independent pairs of "
            "belief and decision; a learner fitted to them (ridge regression, nearest neighbours or a tree, the one of least "
            "error on the last pairs) estimates the belief from single decisions."
        )
    return found


def _rival(comparison: Comparison) -> list[str]:
    """Return notes on a rival with a decision problem, if there is one."""
    if not comparison.rival:
        return []
    found = (
        "worth to the rival, who knows the rule and the prior: by how much one decision lowers its mean loss, "
        f"in its own unit ({comparison.rival}). It loses {comparison.prior_loss:.4g} without any decision, and "
        f"{comparison.secret_worth:.4g} less where it knows the belief: no decision is worth more."
    )
    if comparison.rival_is_own:
        found += (
            " Its problem is the agent's own, so it can copy: under any rule the worth of a decision and the expected regret "
            "sum to at least the silence regret, unless decisions are late or partly disclosed. Hiding protects the belief "
            "from a rival with another problem, or one that decides later."
        )
    return [found]


def markdown_of(comparison: Comparison, title: str) -> str:
    """Return the comparison as Markdown: header, verdict, a table for each budget, notes."""
    parts = [f"# {title}", f"{capital(comparison.header())}.", comparison.summary()]
    for budget in comparison.budgets:
        parts += [
            f"## Expected regret of {worth(comparison, budget)}",
            _markdown_table(short_table(comparison, budget)),
        ]
    parts += ["## Notes", "\n".join(f"- {note}" for note in notes_of(comparison))]
    return "\n\n".join(parts) + "\n"


def worth(comparison: Comparison, budget: float) -> str:
    """Return an expected regret as text, with its shares of the silence regret and of the mean optimal cost."""
    shares = [f"{budget:.3g}"]
    if comparison.silence_regret > 0:
        shares.append(f"{budget / comparison.silence_regret:.0%} of the silence regret")
    if comparison.mean_cost > 0:
        shares.append(f"{budget / comparison.mean_cost:.2%} of E|c*|")
    return shares[0] + (f" ({', '.join(shares[1:])})" if shares[1:] else "")


def _markdown_table(frame: pd.DataFrame) -> str:
    cells = [
        [str(frame.index.name), *frame.columns],
        *([str(name), *row] for name, row in zip(frame.index, frame.to_numpy(), strict=True)),
    ]
    lines = ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in cells]
    lines.insert(1, "|" + "---|" + "---:|" * len(frame.columns))
    return "\n".join(lines)


def write_comparison(
    comparison: Comparison, folder: str | os.PathLike[str], *, title: str = "Comparison"
) -> list[Path]:
    """Write all files of a comparison into a folder; equal comparisons give equal bytes, except comparison.npz.

    Args:
        comparison: From `compare`.
        folder: Where to write; made if it is not there.
        title: Description of the market, the heading of the Markdown file.

    Returns:
        comparison.csv (every figure in full), comparison.md, comparison.png and .svg, with a rival also comparison_rival.png
        and .svg, comparison.npz (for `Comparison.load`), summary.json.

    Raises:
        InputError: A file cannot be written.

    Cost: a few seconds, nearly all for the picture.
    """
    target = output_folder(folder)
    table, text, saved, summary = (target / f"{name}" for name in _FILES)
    write_table(comparison.frame().set_index("maker"), table)
    with whole_file(text) as temporary:
        temporary.write_text(markdown_of(comparison, title), encoding="utf-8")
    comparison.save(saved)
    pictures = [*draw_comparison(comparison, target), *draw_rival(comparison, target)]
    write_json(summary_data(comparison, title), summary)
    return [table, text, *pictures, saved, summary]


_FILES = ("comparison.csv", "comparison.md", "comparison.npz", "summary.json")


def summary_data(comparison: Comparison, title: str) -> dict[str, Any]:
    """Return what `summary.json` holds: plain data, no clock, no path of this machine."""
    kept = (
        "left_out budgets unit repeats n_draws n_beliefs n_candidates prior_entropy prior_error prior_top_state silence_regret "
        "mean_cost per_belief_unit"
    )
    kept += " rival rival_is_own secret_worth prior_loss" if comparison.rival else ""
    return {
        "version": __version__,
        "title": title,
        "header": comparison.header(),
        "sentence": comparison.summary(),
        "notes": notes_of(comparison),
        **{name: getattr(comparison, name) for name in kept.split()},
        "rows": comparison.frame().to_dict(orient="records"),
    }
