"""Files of a backtest: one table, and a folder of files; equal seeds give equal files."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from inscrutable import __version__, tolerances
from inscrutable.budgets import remarks_of
from inscrutable.datasets import output_folder, write_json, write_table
from inscrutable.experiments.backtest_results import SEQUENTIAL, Backtest
from inscrutable.experiments.backtest_sequential import SHARE_OF_SILENCE
from inscrutable.experiments.holding import estimate_quality
from inscrutable.experiments.performance import LEVEL, REPLICATES
from inscrutable.labels import listed
from inscrutable.mechanisms.disclosures import EXACT
from inscrutable.privacy import RivalProblem
from inscrutable.privacy.leaks import silence_regret
from inscrutable.problems import MarkowitzProblem
from inscrutable.reports.backtest_plots import draw_backtest
from inscrutable.reports.backtest_verdict import cautions, limits, verdict
from inscrutable.worlds import GaussianEmission


class _Row(NamedTuple):
    """A row of the table: a figure of the summary, its label with the unit, its factor, and its format."""

    key: str
    label: str
    factor: float = 1.0
    style: str = ".2f"


_PERCENT, _BASIS_POINTS = 100.0, 10_000.0
_UNLIMITED = "regret against the best without a limit on turnover, mean, bp"


def table_of(result: Backtest) -> pd.DataFrame:
    """Return the table of a backtest: one row per figure with its unit in the label, one column per decision maker.

    The index's name states the timing: when the decision is made, on which belief, and which return it earns.

    Args:
        result: A backtest.

    Returns:
        Floats in the units that the labels name.

    Cost: negligible. Example: see `run_backtest` in `inscrutable.experiments.backtest`.
    """
    rows = _rows(result)
    table = pd.DataFrame(
        {name: [figures[row.key] * row.factor for row in rows] for name, figures in result.figures.items()},
        index=pd.Index([row.label for row in rows], name=timing_of(result)),
    )
    return table


def timing_of(result: Backtest) -> str:
    """Return the sentence on the timing of decisions and returns."""
    word = result.market.frequency.word
    return (
        f"decision at the end of {word} t, on the belief about {word} t+1 given data up to {word} t, "
        f"earns the return of {word} t+1"
    )


def text_of(result: Backtest) -> str:
    """Return what a terminal shows: the table with its header, the verdict with its cautions, the basis of both, and notes."""
    width = max(len(row.label) for row in _rows(result))
    lines = [timing_of(result), "", " " * width + "".join(f"{name:>10}" for name in result.names)]
    for label, *cells in written_table(result):
        lines.append(f"{label:<{width}}" + "".join(f"{cell:>10}" for cell in cells))
    told = [*verdict(result), *warnings_of(result), *cautions(result)]
    return "\n".join([*lines, "", *told, "", *limits(result), "", *notes_of(result)])


def warnings_of(result: Backtest) -> list[str]:
    """Return warnings beside the verdict: an odd budget, a rule left out, doubts about the figures, and suspicious returns."""
    odd = [*remarks_of(result.settings.budget), *_left_out(result)]
    doubts = [*odd, *(f"Doubtful: {each}." for each in result.doubts)]
    return [*doubts, *(f"Suspicious returns: {each}." for each in result.market.suspicious)]


def _left_out(result: Backtest) -> list[str]:
    """Return a warning where the sequential rule was asked for and is not played."""
    if not result.settings.sequential or result.sequential is not None:
        return []
    is_fixed = result.aware is not None or result.settings.turnover is not None
    why = "its budget is 0" if is_fixed else "the target changes from step to step"
    return [f"Caution: the sequential rule is left out, as {why}."]


def written_table(result: Backtest) -> list[list[str]]:
    """Return the table as text, row by row: the label, then one cell per decision maker."""
    rows, table = _rows(result), table_of(result)
    return [
        [row.label, *(_written(float(value), row.style) for value in values)]
        for row, values in zip(rows, table.to_numpy(), strict=True)
    ]


def _written(value: float, style: str) -> str:
    return "-" if np.isnan(value) else format(value + 0.0, style)


def _rows(result: Backtest) -> list[_Row]:
    frequency = result.market.frequency
    word, level = frequency.word, f"{LEVEL:.0%}"
    cost = f"{result.settings.cost_bps:g} bp a unit traded"
    excess = "excess of the riskless rate" if result.market.has_riskless else "of the return, riskless rate 0"
    return [
        _Row("n_decisions", f"decisions ({word}s)", style=".0f"),
        _Row("annual_return", "return, compound, % per year", _PERCENT),
        _Row("annual_volatility", f"volatility, % per year (√{frequency.per_year:g} × per {word})", _PERCENT),
        _Row("annual_sharpe", f"Sharpe ratio per year (√{frequency.per_year:g}), {excess}"),
        _Row("annual_sharpe_minus_odm", "  less the ODM's"),
        _Row("annual_sharpe_minus_odm_low", f"  {level} interval, low"),
        _Row("annual_sharpe_minus_odm_high", f"  {level} interval, high"),
        _Row("annual_turnover", "turnover, bought plus sold, % of wealth per year", _PERCENT, ".0f"),
        _Row("annual_return_net", f"return net of {cost}, % per year", _PERCENT),
        _Row("annual_sharpe_net", f"Sharpe ratio per year net of {cost}"),
        _Row("annual_sharpe_net_minus_odm", "  less the ODM's, net"),
        _Row("annual_sharpe_net_minus_odm_low", f"  {level} interval, low, net"),
        _Row("annual_sharpe_net_minus_odm_high", f"  {level} interval, high, net"),
        _Row("assets_held", "assets held, mean"),
        _Row("mean_regret", f"regret, mean, bp of risk-adjusted return per {word}", _BASIS_POINTS),
        _Row("mean_regret_share", f"regret, % of the optimal cost, summed over all {word}s", _PERCENT),
        _Row("mean_expected_regret_share", "  in expectation over the draws", _PERCENT),
        _Row("largest_regret", f"regret, largest in a {word}, bp of risk-adjusted return", _BASIS_POINTS),
        *([] if result.settings.turnover is None else [_Row("mean_regret_unlimited", _UNLIMITED, _BASIS_POINTS)]),
        _Row("mean_regret_of_silence", "regret, mean, % of silence in hindsight", _PERCENT, ".0f"),
        _Row("mean_privacy", f"privacy, mean ({_goal(result)})", style=".3f"),
        _Row("n_privacy_not_finite", f"  {word}s left out: goal missed, or set empty", style=".0f"),
        _Row(
            "share_regime_named", f"{word}s in which the naive observer names the likeliest regime, %", _PERCENT, ".1f"
        ),
        _Row("base_rate", "  by always naming the commonest one, %", _PERCENT, ".1f"),
        _Row("n_empty_sets", f"  {word}s left out: no belief explains the weights", style=".0f"),
        _Row("error_face_value", "error of the naive observer's estimate, r.m.s.", style=".3f"),
        _Row("share_regime_named_aware", f"{word}s in which the aware observer names it, %", _PERCENT, ".1f"),
        _Row("error_aware", "  error of its estimate, r.m.s.", style=".3f"),
        _Row("error_without", "  error without any weights, r.m.s.", style=".3f"),
        _Row("bits_aware", "  leakage of one decision, bits"),
        _Row(
            "share_regime_named_followed",
            f"{word}s in which the aware observer names it from all so far, %",
            _PERCENT,
            ".1f",
        ),
        _Row("error_followed", "  error of its estimate from all so far, r.m.s.", style=".3f"),
        _Row("mean_regret_long_run", "  regret in the long run of the model's regimes, mean, bp", _BASIS_POINTS),
        _Row("error_ceiling", "  ceiling: largest such error there of any rule of that regret", style=".3f"),
        _Row("bits_followed", "  leakage of one more decision, bits"),
        *_disclosed_rows(result),
        *_worth_rows(result),
        *_public_rows(result),
        _Row("n_nothing_affordable", f"{word}s in which no privacy was affordable", style=".0f"),
    ]


def _goal(result: Backtest) -> str:
    """Return the name of the privacy measure in words, such as "maximal obfuscation"."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(result.settings.measure).__name__).lower()


def _disclosed_rows(result: Backtest) -> list[_Row]:
    shown, word = result.settings.disclosure, result.market.frequency.word
    if shown == EXACT:
        return []
    return [
        _Row("share_regime_named_disclosed", f"{word}s in which it names it from {shown}, %", _PERCENT, ".1f"),
        _Row("error_disclosed", f"  error of its estimate from {shown}, r.m.s.", style=".3f"),
    ]


def _worth_rows(result: Backtest) -> list[_Row]:
    """Return the rows of worth to the rival; one with the investor's own problem can hold the weights."""
    rival, own, word = result.rivals_loss, result.rival_is_own, result.market.frequency.word
    invests = isinstance(rival, RivalProblem) and isinstance(rival.problem, MarkowitzProblem)
    unit = f"bp per {word}" if invests else rival.unit
    form: tuple[float, str] = (_BASIS_POINTS, ".2f") if invests else (1.0, ".3g")
    copied = [_Row("worth_copied", "  of holding the weights, in expectation over the draws", *form)] if own else []
    return [
        _Row(
            "worth_secret",
            f"worth of the beliefs to {'a rival who invests alike' if own else 'the rival'}, {unit}",
            *form,
        ),
        _Row("worth_followed", "  of reading all weights so far", *form),
        *copied,
    ]


def _public_rows(result: Backtest) -> list[_Row]:
    followed = result.public.these if result.public.number else "all these returns"
    everything = _Row("error_all_returns", f"all: error by following {followed}, no weights", style=".3f")
    if result.public.without is None:
        return [everything]
    return [
        _Row("error_public_without", "error by following what is public, without weights", style=".3f"),
        _Row("error_public_face_value", "  with the weights at face value", style=".3f"),
        _Row("error_public_followed", "  with the weights and the rule", style=".3f"),
        everything,
    ]


def _public_notes(result: Backtest) -> list[str]:
    public, said = result.public, list[str]()
    if public.without is not None:
        said.append(
            f"Public: the observer follows {public.said}, with the investor's model of it. At face value it takes the belief "
            f"nearest to its own among those that explain the weights.{_misled(result)}"
        )
    return [*said, _all_public(result)]


def _all_public(result: Backtest) -> str:
    """Return the row of the error of an observer who follows all that is public, without weights."""
    public, error = result.public, result.figures[result.names[0]]["error_all_returns"]
    if error <= tolerances.SAME_BELIEF:
        return (
            f"All: {public.these} are public, and the belief comes from them alone: an observer who follows them with this "
            "model needs no weights, and nothing can be hidden from it."
        )
    return (
        f"All: {public.these} are public; an observer who follows them with this model and sees no weights errs by "
        f"{error:.3f}, because the investor has information of its own."
    )


def _misled(result: Backtest) -> str:
    """A sentence for the case that public information raises the error, because the model's regimes are not the truth."""
    figures = result.figures[result.names[0]]
    following, blind = figures["error_public_without"], figures["error_without"]
    if not following > blind:
        return ""
    return (
        f" Here that misleads it: it errs by {following:.3f} without weights, and by {blind:.3f} where it looks at nothing. In "
        "the model's regimes, were they the truth, more public information would never do harm."
    )


def notes_of(result: Backtest) -> list[str]:
    """Return the definitions of the table."""
    settings = result.settings
    return [
        f"{_source_of_regimes(result)}; "
        f"risk aversion γ = {settings.risk_aversion:g} in γu'Σu − μ'u, no ½; budget {result.budget}.",
        *_sequential_notes(result),
        *_limit_notes(result),
        *_fit_notes(result),
        "Naive observer: knows means, covariances and γ, takes the published weights (of a lottery, the draw) for optimal, and "
        "guesses the centre of the beliefs that explain them.",
        *_aware_notes(result),
        *_public_notes(result),
        "Turnover counts from the last published weights after they drifted with returns; the first purchase is left out.",
        f"Intervals: studentised circular block bootstrap, {REPLICATES} samples (Ledoit and Wolf 2008).",
        *_silence_notes(result),
    ]


def _fit_notes(result: Backtest) -> list[str]:
    fit = result.fit
    notes = [] if fit.covariance in ("sample", "given") else [f"Covariances are not full ones: {fit.size}."]
    if len(fit.restarts) > 1 and fit.alike == 1:
        notes.append(
            f"Only one of {len(fit.restarts)} starts of the fit came within one nat of its likelihood: another --seed may find "
            "other regimes."
        )
    return notes


def _silence_notes(result: Backtest) -> list[str]:
    """Return a line on what a constant portfolio costs: in hindsight, known beforehand, and in the long run of the model."""
    word, part = result.market.frequency.word, result.sequential
    costs = [
        f"{_BASIS_POINTS * result.silence_regret:.2f} bp per {word} in hindsight (the one that is best for these beliefs)"
    ]
    if np.isfinite(result.known_silence_regret):
        known = _BASIS_POINTS * result.known_silence_regret
        costs.append(f"{known:.2f} if known beforehand (the one for the long-run mean of the belief)")
    if part is not None:
        prior = part.maker.chain.prior
        most = _BASIS_POINTS * silence_regret(result.problem, prior.beliefs, prior.weights)
        costs.append(
            f"{most:.2f} in the long run of the model's regimes (the silence regret on the {SEQUENTIAL}'s grid of {len(prior)} "
            "beliefs, of which its default budget is a share)"
        )
    return [f"Silence, a constant portfolio, costs {listed(costs)}."]


def _source_of_regimes(result: Backtest) -> str:
    market = result.market
    if result.fit.covariance == "given":
        return "Regimes as the model gives them, nothing is fitted"
    rows = f"{market.n_training} {market.frequency.word}s"
    return f"Regimes fitted on {rows} to {market.training.index[-1]:%Y-%m-%d} and never again"


def _limit_notes(result: Backtest) -> list[str]:
    """The limits on weights, where there are more than non-negativity and a sum of 1."""
    own = result.settings.own
    given = {} if own is None else own.file.constraints.model_dump(exclude_none=True)
    if not given:
        return []
    told = "; ".join(
        f"{key} {value if not isinstance(value, dict) else ', '.join(map(str, value))}" for key, value in given.items()
    )
    return [f"Limits on weights, which observers know: {told}."]


def _aware_notes(result: Backtest) -> list[str]:
    if result.settings.turnover is not None:
        word = result.market.frequency.word
        return [
            f"Turnover is at most {result.settings.turnover:.3g} a {word}, against the weights published last, which the naive "
            "observer knows. Every rule depends on them, so no aware observer is modelled"
            f"{'' if result.sequential is None else ', except that of the SDM, whose rule it follows exactly'}; the naive "
            "observer's errors tell nothing about it. A regret is against the best that turnover allows after the rule's "
            "own last weights; shares of silence, and the SDM's own budget, also count what the limit costs."
        ]
    if result.aware is None:
        return ["The target changes from step to step, so no aware observer is modelled."]
    prior, word = result.aware.prior, result.market.frequency.word
    return [
        "Aware observer: knows each decision maker, budget included, and the long-run law of the belief in the model's "
        f"regimes (a grid of {len(prior)} beliefs, {prior.entropy:.2f} bits); it knows the decisions of beliefs "
        "in every cell of the grid, finds those nearest to the one it sees, and takes the posterior mean over their cells: "
        "optimal weights tell it a cell, not the belief. Over time it remembers every decision and knows the Markov chain of "
        f"the belief in the model's regimes, with a probability of 1% a {word} of any other belief.",
        _worth_note(result),
    ]


def _worth_note(result: Backtest) -> str:
    if result.rival_is_own:
        return (
            "Worth: the gain of a rival, an observer with the investor's own problem, over the best portfolio for the long-run "
            "mean of the belief, by the investor's beliefs. The rival knows the beliefs, or infers them, or copies the "
            "published weights. Copying cannot be prevented: in expectation over draws, its gain and the investor's regret add "
            "up to the worth of the beliefs."
        )
    said = (
        "Worth: the gain of the rival, an observer with a problem of its own, over its best decision for the long-run mean "
        "of the belief, by the investor's beliefs. The rival knows the beliefs, or infers them from all weights so far."
    )
    if result.sequential is None:
        return said
    return (
        f"{said} {SEQUENTIAL} reveals least information, whatever the rival's problem: prices for a rival's loss take ten "
        "times as long to find."
    )


def _sequential_notes(result: Backtest) -> list[str]:
    part = result.sequential
    if part is None:
        return []
    word, beliefs = result.market.frequency.word, len(part.maker.beliefs)
    most = part.maker.limit * _BASIS_POINTS
    share = "" if result.settings.budget is not None else f", {SHARE_OF_SILENCE:.0%} of the silence regret"
    ceiling = [
        "Ceiling: no rule of the same mean regret in the long run of the model's regimes leaves an observer who follows it a "
        f"larger error, in expectation there, on that grid and {len(part.maker.table.columns)} candidate portfolios."
    ]
    return [
        "SDM, the sequential rule, depends on the aware observer's law of the belief, and so on all decisions before: rows on "
        f"single decisions do not apply to it. It may spend {most:.2f} bp per {word} on average in the long run of the model's "
        f"regimes{share}, and spends {part.path.own_regrets.mean() * _BASIS_POINTS:.2f} here, in expectation over each draw. "
        f"It was made by simulation on a grid of {beliefs} beliefs; {part.path.n_off_grid} of {len(result.beliefs)} beliefs "
        "here are off that grid.",
        *([] if np.isnan(result.figures[SEQUENTIAL]["error_ceiling"]) else ceiling),
    ]


def write_backtest(result: Backtest, folder: str | os.PathLike[str], *, month: str | None = None) -> list[Path]:
    """Write all files of a backtest into a folder: tables, paths, pictures, and a summary as JSON.

    `table.csv`; `beliefs.csv` (fit to be read again as a user's beliefs); per decision maker `weights_*.csv`,
    `estimates_*.csv` (estimates of the naive observer), `aware_*.csv` (of the aware one), `followed_*.csv` (of the aware one
    who remembers all weights before) and `path_*.csv` (regret, privacy, return per decision); up to six figures
    as PNG and SVG; `summary.json`. Each file appears whole or not at all; the same backtest gives the same bytes.

    Args:
        result: A backtest.
        folder: Where to write; made if it is not there.
        month: Date of the decision that the frontier and the ternary figure show, as "2008-09" or "2008-09-30"; None
            is the decision at which the lottery gains most over the CDM.

    Returns:
        The files written.

    Raises:
        InputError: The folder cannot be written to, or no decision was made in `month`.

    Cost: a few seconds, nearly all for the pictures.
    """
    target = output_folder(folder)
    written: list[Path] = []

    def table(frame: pd.DataFrame, name: str, header: str) -> None:
        write_table(frame.rename_axis(header), target / name)
        written.append(target / name)

    word = result.market.frequency.word
    table(table_of(result), "table.csv", timing_of(result))
    table(result.beliefs, "beliefs.csv", f"decided at the end of (belief about the next {word})")
    for name in result.names:
        table(result.weights(name), f"weights_{name}.csv", f"published at the end of (held over the next {word})")
        table(result.estimates(name), f"estimates_{name}.csv", f"read from the weights of (about the next {word})")
        if result.aware is not None:
            header = f"read by the aware observer from the weights of (about the next {word})"
            if name in result.aware.estimates:
                table(result.aware_estimates(name), f"aware_{name}.csv", header)
            header = f"read by the aware observer from all weights up to (about the next {word})"
            table(result.followed_estimates(name), f"followed_{name}.csv", header)
        table(result.path(name), f"path_{name}.csv", f"decided at the end of (earns the next {word})")
    written += draw_backtest(result, target, month=month)
    write_json(summary_data(result), target / "summary.json")
    return [*written, target / "summary.json"]


_HELD = {
    "weights": "published weights",
    "estimates": "what the naive observer reads from them",
    "aware": "what the aware observer reads from each decision alone",
    "followed": "what the aware observer reads from all decisions so far",
    "path": "regret, privacy and return of each decision",
    "table": "the table above",
    "beliefs": "the investor's beliefs",
    "figures": "figures, as PNG and SVG",
    "summary": "figures, verdict and notes as data",
    "report": "all of this as one page",
    "model": "the model, for other commands",
    "files": "the list of these files",
}
"""What the files hold, by the first word of their names."""


def files_told(paths: Iterable[Path]) -> list[str]:
    """Return a line for each family of files, such as all that hold published weights, with what it holds."""
    families: dict[str, list[Path]] = {}
    for path in paths:
        family = "figures" if path.suffix in (".png", ".svg") else path.stem.partition("_")[0]
        families.setdefault(family, []).append(path)
    shown = {family: _family(family, found) for family, found in families.items()}
    width = max(map(len, shown.values()), default=0)
    return [f"{text:<{width}}  {_HELD.get(family, '')}".rstrip() for family, text in shown.items()]


def _family(family: str, paths: Sequence[Path]) -> str:
    if family == "figures":
        return ", ".join(dict.fromkeys(path.stem for path in paths))
    names = [path.stem.partition("_")[2] for path in paths]
    return paths[0].name if len(paths) == 1 else f"{family}_*{paths[0].suffix} ({', '.join(names)})"


def summary_data(result: Backtest) -> dict[str, Any]:
    """Return what `summary.json` holds: plain data, no clock, no path of this machine."""
    settings, market = result.settings, result.market
    chosen = {**vars(settings), "measure": repr(settings.measure), "budget": asdict(result.budget)}
    own, rival = chosen.pop("own"), chosen.pop("rival")
    if rival is not None:
        chosen["rival"] = rival.model_dump(exclude_none=True)
    if own is not None:
        chosen["own"] = own.file.model_dump(exclude_none=True)
    return {
        "version": __version__,
        "verdict": verdict(result),
        "limits": limits(result),
        "doubts": result.doubts,
        "suspicious_returns": market.suspicious,
        "cautions": cautions(result),
        "timing": timing_of(result),
        "notes": notes_of(result),
        "settings": chosen,
        "data": {
            "assets": result.assets,
            "first": f"{market.returns.index[0]:%Y-%m-%d}",
            "last": f"{market.returns.index[-1]:%Y-%m-%d}",
            "training_rows": market.n_training,
            "first_decision": f"{result.dates[0]:%Y-%m-%d}",
            "last_decision": f"{result.dates[-1]:%Y-%m-%d}",
            "rows_per_year": market.frequency.per_year,
            "row": market.frequency.word,
            "riskless_given": market.has_riskless,
        },
        "fit": {
            "log_likelihood": result.fit.log_likelihood,
            "restarts": len(result.fit.restarts),
            "restarts_within_one_nat": result.fit.alike,
            "collapsed": sum(bool(one.collapsed) for one in result.fit.restarts),
            "covariance": result.fit.covariance,
            "effective_parameters": result.fit.best.n_parameters,
            "numbers": result.fit.n_rows * result.fit.n_columns,
            "observations_of_regimes": result.fit.best.weights,
        },
        "regimes": _regimes(result),
        "silence_regret": result.silence_regret,
        "sequential": _sequential_data(result),
        "public": result.public.said,
        "decision_makers": {name: dict(figures) for name, figures in result.figures.items()},
    }


def _sequential_data(result: Backtest) -> dict[str, Any] | None:
    part = result.sequential
    if part is None:
        return None
    prices = part.maker.calibration
    return {
        "mean_regret_allowed": part.maker.limit,
        "silence_regret_long_run": part.silence_regret,
        "error_without_long_run": part.maker.chain.prior.error,
        "error_long_run": float(np.sqrt(prices.loss)),
        "ceiling": result.figures[SEQUENTIAL]["error_ceiling"],
        "bits_long_run": prices.bits,
        "prices": prices.status.name.lower(),
        "grid_beliefs": len(part.maker.beliefs),
        "candidates": len(part.maker.table.columns),
        "beliefs_off_grid": part.path.n_off_grid,
        "other_draws": [estimate_quality(each, result.beliefs.to_numpy())._asdict() for each in part.others],
    }


def _regimes(result: Backtest) -> list[dict[str, Any]]:
    emission, frequency = result.world.emission, result.market.frequency
    assert isinstance(emission, GaussianEmission)  # run_backtest fits nothing else
    even = np.full(len(result.assets), 1.0 / len(result.assets))
    return [
        {
            "name": name,
            "stays": result.world.transition[i, i],
            "mean_per_year_of_equal_weights": float(emission.means[i] @ even) * frequency.per_year,
            "volatility_per_year_of_equal_weights": float(
                np.sqrt(even @ emission.covariances[i] @ even * frequency.per_year)
            ),
            "mean_belief": float(result.beliefs.iloc[:, i].mean()),
        }
        for i, name in enumerate(result.regimes)
    ]
