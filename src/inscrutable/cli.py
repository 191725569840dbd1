"""The command `inscrutable`: reproduce the paper, backtest, attack, protect, compare, disclose, audit, views, studies, compile.

Results go to stdout, progress and log to stderr. Exit codes: 0 done, 1 failure, 2 wrong usage, 3 bad data or a full disk,
4 no solution, or doubts with `--strict`, 130 interrupted.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, CycloptsError, Parameter

from inscrutable import __version__
from inscrutable.cli_alphas import AlphaOptions, SignalOptions, alphas_go_with, backtest_means, protect_means
from inscrutable.cli_attack import attack
from inscrutable.cli_audit import audit
from inscrutable.cli_compare import compare
from inscrutable.cli_console import Speech, library_log, replaced, results, show_table, write_report
from inscrutable.cli_disclose import disclose
from inscrutable.cli_interrupts import Interrupts, interrupts_kept
from inscrutable.cli_limits import WeightOptions, one_row, weights_of
from inscrutable.cli_sequence import IF_PUBLIC, belief_after, belief_now, protect_next
from inscrutable.cli_study import AGAIN, STUDY, resumable, study, was_told
from inscrutable.cli_values import (
    DATA,
    INVESTOR,
    OUTPUT,
    PRIVACY,
    MeasureName,
    Out,
    Seed,
    UsageError,
    Whole,
    belief_of,
    beside_of,
    blaming,
    budget_of,
    disclosure_of,
    measure_of,
    one_column,
    writable_folder,
)
from inscrutable.cli_views import views
from inscrutable.errors import DiskError, InputError, InscrutableError, ModelError
from inscrutable.files import DISK
from inscrutable.labels import capital, label_text

if TYPE_CHECKING:
    import pandas as pd

    from inscrutable.experiments.backtest import Backtest
    from inscrutable.experiments.own_model import OwnModel
    from inscrutable.experiments.protect import Protection

FAILURE, USAGE, INTERRUPTED = 1, 2, 130

app = App(
    name="inscrutable",
    help="What does my decision give away, how do I change that, and what does it cost?",
    help_epilogue=(
        "Exit codes: 0 done, 1 failure, 2 wrong usage, 3 bad data or a full disk, 4 no solution, or doubts with --strict, 130 "
        "interrupted. `inscrutable VERB --help` says what a verb takes. Decisions may be altered, never a disclosure that the "
        "law prescribes."
    ),
    help_format="markdown",
    version=__version__,
    version_format="plaintext",
    suppress_keyboard_interrupt=False,  # `main` answers it
)

app.command(study)
app.command(attack)
app.command(compare)
app.command(disclose)
app.command(audit)
app.command(views)


@app.command
def reproduce(
    *,
    markets: Whole = 100,
    simulations: Whole = 20,
    steps: Whole = 30,
    budget: float = 0.1,
    resolution: Whole = 40,
    jobs: Whole = -1,
    seed: Seed = 0,
    out: Out = Path("reproduction"),
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> None:
    """Reproduce every result of the paper's numerical section and judge each of its claims.

    Args:
        markets: Random markets over which the claims are judged, at least 2.
        simulations: Random markets for the mean trade-off and for the number-of-samples study, at least 2.
        steps: Steps of the market that is drawn in the figures, at least 2.
        budget: The paper's cost budget c_b, a share of |c*|.
        resolution: Resolution of the action grid and the decoy grid; 40 gives 861 samples.
        jobs: Processes; -1 is one per core. Changes nothing but the time.
        seed: The same seed gives the same numbers.
        out: Folder for figures, claims.csv and summary.json; with the extra `inscrutable[report]` also report.html, one page
            that works offline. Its folder "study" holds the study behind them: the same command continues a run that was
            stopped.
    """
    from inscrutable.experiments.reproduction import ReproductionSettings, reproduce
    from inscrutable.reports.reproduction import cautions, claims_table, verdict, write_reproduction

    sizes: dict[str, Any] = {"markets": markets, "simulations": simulations, "steps": steps, "resolution": resolution}
    settings = ReproductionSettings(seed=seed, budget=budget, **sizes)
    folder = writable_folder(out, "reproduce")
    speech.detail(f"Settings: {settings}")
    with resumable(folder / STUDY, AGAIN):
        with speech.progress("Random markets") as move:
            result = reproduce(settings, jobs=jobs, folder=folder / STUDY, again=was_told(folder), progress=move)
        speech.log("Drawing the figures")
        written = partial(write_reproduction, result, jobs=jobs)
        files = replaced(folder, "reproduce", lambda at: [*written(at), *write_report(result, at, drawn=at)], speech)
    if speech.json:
        speech.summary_file(folder / "summary.json")
        return
    title = f"The paper's claims over {markets} random markets (seed {seed})"
    show_table(claims_table(result).set_index("claim"), title, prose=True)
    speech.files(files)
    speech.sentence("\n".join(["", verdict(result), *cautions(result)]))


@app.command(validator=alphas_go_with)
def backtest(
    *,
    returns: Annotated[Path | None, Parameter(group=DATA)] = None,
    prices: Annotated[Path | None, Parameter(group=DATA)] = None,
    daily: Annotated[bool, Parameter(group=DATA, negative=(), show_default=False)] = False,
    beliefs: Annotated[Path | None, Parameter(group=DATA)] = None,
    regime_names: Annotated[str | None, Parameter(group=DATA)] = None,
    train_until: Annotated[str | None, Parameter(group=DATA)] = None,
    public: Annotated[str, Parameter(group=DATA)] = "market",
    private: Annotated[Path | None, Parameter(group=DATA)] = None,
    riskless: Annotated[Path | None, Parameter(group=DATA)] = None,
    rival: Annotated[Path | None, Parameter(group=DATA)] = None,
    model: Annotated[Path | None, Parameter(group=INVESTOR)] = None,
    regimes: Annotated[Whole | None, Parameter(group=INVESTOR)] = None,
    covariance: Annotated[str | None, Parameter(group=INVESTOR)] = None,
    risk_aversion: Annotated[float | None, Parameter(group=INVESTOR)] = None,
    cost_bps: Annotated[float | None, Parameter(group=INVESTOR)] = None,
    limits: WeightOptions = WeightOptions(),  # noqa: B008  # frozen
    budget: Annotated[str | None, Parameter(group=PRIVACY)] = None,
    measure: Annotated[MeasureName, Parameter(group=PRIVACY)] = "maximal",
    target: Annotated[str | None, Parameter(group=PRIVACY)] = None,
    sequential: Annotated[bool, Parameter(group=PRIVACY)] = True,
    disclosure: Annotated[str, Parameter(group=PRIVACY)] = "exact",
    seed: Seed = 0,
    out: Out = Path("backtest"),
    means: SignalOptions = SignalOptions(),  # noqa: B008  # frozen
    strict: Annotated[bool, Parameter(group=OUTPUT, negative=(), show_default=False)] = False,
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> int:
    """Backtest a regime-switching investor on real returns, and what observers read from its published weights.

    Without a data option: the 12 US industries that come with the package, monthly, 1949 to 2017. With `--alphas` the private
    belief is a vector of expected returns, hidden from the aware observer, who knows the rule.

    Args:
        returns: CSV of simple returns as fractions: dates in the first column, one column per asset.
        prices: CSV of prices, the same layout.
        daily: Daily returns of 20 US stocks, 1990 to 2022 (needs the extra `inscrutable[data]`).
        beliefs: CSV of your own beliefs, each about the row after its date, instead of the filter's: dates, then one column per
            regime, named calm and turbulent for two regimes, calm, normal and turbulent for three.
        regime_names: With `--beliefs`: the names of its columns if they are others, by rising volatility, such as bull,bear.
        train_until: Last date of the training sample, such as 1989-12. Default: 1989-12 for the 12 industries, the
            middle of other data.
        public: What the observer sees besides the weights: none, market, all, the name of a column of the returns, or a CSV of
            dates and one column of numbers, which the investor then uses as well. The market is that of the 12 industries; for
            other data it is the mean of the assets.
        private: CSV of your own private signal: dates, then its likelihood in each regime, columns named as for `--beliefs`. A
            date without a row has no signal.
        riskless: CSV of dates and one column: the riskless return of each row, as a fraction, for Sharpe ratios of excess
            returns.
        rival: TOML file whose [problem] is a rival's decision problem, for the worth of beliefs and weights to it. Default: the
            investor's own problem.
        model: A model.toml of your own: risk aversion, budget, limits on weights, and optionally regimes, which replace the
            fitted ones.
        regimes: Number of regimes fitted to the training sample. Default: 3.
        covariance: Estimator of their covariances: sample, ledoit-wolf (shrunk) or factor:K. Default: sample where there
            are ten rows per regime and asset, else ledoit-wolf.
        risk_aversion: γ in the cost γ u'Σu − μ'u, without a half. Default: 5.
        cost_bps: Cost per unit traded, in basis points. Default: 10.
        limits: Limits on the weights.
        budget: The regret allowed for privacy: a share of |c*| such as 0.1 or 10%; 5bp or regret:0.002 in the cost's unit; or
            silence:0.5, half the regret of the best constant decision (silence regret). Default: 0.1 for CDM and PDM,
            silence:0.5 for the sequential rule (SDM). With `--alphas` a share is one of the silence regret, 0.5 by default.
        measure: The privacy measure.
        target: For `--measure desired`: a belief such as 0.2,0.3,0.5, or reverse.
        sequential: Include the sequential rule. Computing its prices takes up to a minute.
        disclosure: Adds an observer to whom the weights are shown in part or late, in rows of the returns: such as
            "every(3)|delayed(2)", portfolio_return(), form_13f(0) on months of which the first ends a quarter, as by default.
        seed: The same seed gives the same numbers.
        out: Folder for the table, the figures, the weights and model.json; with the extra `inscrutable[report]` also
            report.html, one interactive page that works offline.
        strict: Exit with code 4 where figures or verdict are doubtful: returns are suspicious, the fit collapsed or is
            overfitted, the belief hardly moves, there is nothing to hide, or hiding is weak. All files are still written.
    """
    from inscrutable.experiments.backtest import BacktestSettings, run_backtest
    from inscrutable.experiments.rivals import read_rival
    from inscrutable.reports.backtest_verdict import cautions

    if sum(option is not None for option in (returns, prices)) + daily > 1:
        raise UsageError("--returns, --prices and --daily exclude one another: give one of them")
    table, rate = _returns(returns, prices, daily)
    is_embedded = rate is not None
    rate = rate if riskless is None else _riskless(riskless)
    if train_until is None:
        train_until = "1989-12" if is_embedded else f"{table.index[(len(table) - 1) // 2]:%Y-%m-%d}"
        speech.detail(f"Training sample: up to {train_until}")
    if means.alphas is not None:
        if rival is not None:
            raise UsageError("--alphas takes no --rival: the rival there is one who copies the weights")
        asked = {"risk_aversion": risk_aversion, "covariance": covariance, "train_until": train_until, "seed": seed}
        backtest_means(means, table, rate, asked, budget, writable_folder(out, "backtest"), speech)
        return 0
    chosen_measure, chosen_budget = measure_of(measure, target), None if budget is None else budget_of(budget, speech)
    own = _own_model(model, limits)
    if own is not None and own.world is not None and (regimes is not None or covariance is not None):
        raise UsageError(
            "--regimes and --covariance are for fitted regimes, but the model gives its own: leave them out"
        )
    part, count = None if own is None else own.file.investor, 3 if regimes is None else regimes
    if part is not None:
        from inscrutable.experiments.own_model import budget_of as stated

        chosen_budget = stated(part) if chosen_budget is None else chosen_budget
    settings = BacktestSettings(
        count,
        _first(risk_aversion, None if part is None else part.risk_aversion, 5.0),
        chosen_budget,
        chosen_measure,
        _first(cost_bps, None if part is None else part.cost_bps, 10.0),
        train_until,
        seed,
        covariance,
        sequential,
        disclosure_of(disclosure),
        own,
        None if rival is None else read_rival(rival),
    )
    names = None if own is None or own.world is None else own.world.names
    if regime_names is not None and beliefs is None:
        raise UsageError("--regime-names names the columns of --beliefs: give both")
    held = None if beliefs is None else _own_beliefs(beliefs, regime_names, settings.regimes, speech, names)
    beside = beside_of(public, private, table, embedded=is_embedded)
    folder = writable_folder(out, "backtest")
    fitting = f"fitting {count} regimes" if names is None else f"{settings.regimes} regimes of {model}, training sample"
    speech.log(f"{table.shape[1]} assets, {len(table)} rows; {fitting} up to {train_until}")
    with speech.progress("Decisions") as move:
        result = run_backtest(table, settings, beliefs=held, riskless=rate, beside=beside, progress=move)
    _show_backtest(result, folder, _written(result, folder, speech), speech)
    doubts = [*result.doubts, *result.market.suspicious, *cautions(result)] if strict else []
    return _said("; ".join(each.rstrip(".") for each in doubts), ModelError.exit_code, kind="doubtful") if doubts else 0


def _written(result: Backtest, folder: Path, speech: Speech) -> list[Path]:
    """The files of a backtest."""
    from inscrutable.reports.backtest import write_backtest

    speech.log("Drawing the figures")
    paged = result.settings.turnover is None
    if not paged:
        speech.log("No report.html: the page shows other budgets, which are not computed under a limit on turnover")

    def written(into: Path) -> list[Path]:
        files = [*write_backtest(result, into), *(write_report(result, into) if paged else [])]
        return [*files, result.investor.save(into / "model.json")]

    return replaced(folder, "backtest", written, speech)


def _show_backtest(result: Backtest, folder: Path, files: list[Path], speech: Speech) -> None:
    from inscrutable.reports.backtest import files_told, text_of

    if speech.json:
        speech.summary_file(folder / "summary.json")
        return
    speech.sentence(text_of(result))
    speech.sentence("\n".join([f"\nWritten to {folder}:", *(f"  {line}" for line in files_told(files))]))


def _returns(returns: Path | None, prices: Path | None, daily: bool) -> tuple[pd.DataFrame, pd.Series | None]:
    """Return the chosen returns, and the riskless rate, which only the embedded returns have."""
    from inscrutable import datasets

    if returns is not None:
        return datasets.read_returns(returns), None
    if prices is not None:
        return datasets.read_returns(prices, prices=True), None
    if daily:
        return datasets.load_daily_returns(), None
    data = datasets.load_industry_returns()
    return data.returns, data.riskless


def _own_model(path: Path | None, limits: WeightOptions) -> OwnModel | None:
    """Return the model of a file with the limits of the options, or the limits alone; None where neither is given."""
    from inscrutable.experiments.own_model import OwnModel

    part = limits.part()
    if path is None:
        return None if part.is_empty else OwnModel.of_limits(part)
    return OwnModel.load(path).with_limits(part)


def _first(*values: float | None) -> float:
    """The first number that is given."""
    return next(each for each in values if each is not None)


def _riskless(path: Path) -> pd.Series:
    from inscrutable.datasets.suspicious import MOST_RISKLESS

    rates = one_column(path)
    if (rates.abs() > MOST_RISKLESS).any():
        raise InputError(
            f"{path}: a riskless return of {rates.abs().max():g} on {rates.abs().idxmax():%Y-%m-%d}; expected fractions per "
            "row, 0.003 for 0.3 per cent: divide percentages by 100"
        )
    return rates


def _own_beliefs(
    path: Path, given: str | None, count: int, speech: Speech, known: tuple[str, ...] | None
) -> pd.DataFrame:
    """Return the beliefs of a file with the fitted regimes' names; log the match of columns and names."""
    from inscrutable.datasets import read_beliefs
    from inscrutable.experiments.backtest import regime_names

    names = regime_names(count) if known is None else known
    if given is None:
        own = read_beliefs(path)
        if set(own.columns) == set(names):
            speech.log(f"Beliefs of {path}: the columns {', '.join(names)}, by name")
        return own
    columns = [name.strip() for name in given.split(",")]
    if len(columns) != count:
        raise UsageError(
            f"--regime-names has {len(columns)} names, expected one per regime, by rising volatility: {count}"
        )
    pairs = ", ".join(f"{column} is {name}" for column, name in zip(columns, names, strict=True))
    speech.log(f"Beliefs of {path}: {pairs}")
    return read_beliefs(path, names=columns).set_axis(list(names), axis=1)


@app.command
def protect(
    *,
    model: Annotated[Path | None, Parameter(group=DATA)] = None,
    belief: Annotated[str | None, Parameter(group=DATA)] = None,
    beliefs: Annotated[Path | None, Parameter(group=DATA)] = None,
    weights: Annotated[Path | None, Parameter(group=DATA)] = None,
    budget: Annotated[str | None, Parameter(group=PRIVACY)] = None,
    measure: Annotated[MeasureName, Parameter(group=PRIVACY)] = "maximal",
    target: Annotated[str | None, Parameter(group=PRIVACY)] = None,
    certify: Annotated[float | None, Parameter(group=PRIVACY)] = None,
    state: Annotated[Path | None, Parameter(group=DATA)] = None,
    publish: Annotated[bool, Parameter(group=DATA, negative=(), show_default=False)] = False,
    normalise: Annotated[bool, Parameter(group=DATA, negative=(), show_default=False)] = False,
    map_: Annotated[Path | None, Parameter(name="--map", group=DATA)] = None,
    previous: Annotated[Path | None, Parameter(group=DATA)] = None,
    limits: WeightOptions = WeightOptions(),  # noqa: B008  # frozen
    seed: Seed | None = None,
    out: Out | None = None,
    means: AlphaOptions = AlphaOptions(),  # noqa: B008  # frozen
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> None:
    """Compute what to publish instead, its cost, and what an observer then concludes.

    Without `--state` one decision is protected against the naive observer, who takes it for optimal. With `--state` decisions
    are a sequence, protected against the aware observer, who knows the rule and remembers every decision. With `--alphas` the
    private belief is a vector of numbers, such as expected returns, and the observer is the aware one. Decisions that are no
    portfolios, such as a power plant's schedule or one of a few choices, are protected from Python.

    Args:
        model: The model.json of a backtest, or a model.toml of your own with regimes; for beliefs, not for `--alphas`.
        belief: Your belief over the model's regimes, such as 0.2,0.3,0.5. It has no date: use `--publish` once a period.
        beliefs: CSV of beliefs: dates, then one column per regime.
        weights: CSV of planned weights. The belief behind them is inferred as the naive observer infers it.
        budget: The regret allowed for privacy: a share of |c*| such as 0.1 or 10%; 5bp or regret:0.002 in the cost's unit; or
            silence:0.5, half the regret of the best constant decision (silence regret). Default: the model's; with `--state`
            that of its file (new: silence:0.5). With `--alphas` a share is one of the silence regret, 0.5 by default.
        measure: The privacy measure.
        target: For `--measure desired`: a belief such as 0.2,0.3,0.5, or reverse.
        certify: Prove an upper bound of the maximal or desired privacy, to this relative gap, such as 0.01.
        state: File of the decisions so far. If it is missing, it is created, which takes a minute or more. Needs `--belief` or
            `--returns`, or `--alphas` with one row. Not with `--out`: the file holds what was published.
        publish: With `--state`: draw this step's weights once and record them. Without it nothing is drawn.
        normalise: Accept planned weights in dollars or percentages, with blanks, cash and tickers in any case.
        map_: With `--normalise`: CSV with the columns name and asset.
        previous: Where turnover is limited: CSV of the weights published last, one row. Takes one belief at a time.
        limits: Limits on the weights.
        seed: Makes the draw repeatable. Whoever knows the seed knows the draw; without a seed the operating system draws.
        out: Folder for the tables, summary.json and the figures; without it, and with `--alphas`, the results are only printed.
    """
    means.check(model=model, belief=belief, beliefs=beliefs, weights=weights, target=target, certify=certify, out=out)
    if means.alphas is not None:
        if publish and state is None:
            raise UsageError("--publish records a decision: give the file with --state")
        protect_means(means, budget, state, publish, _rng_of(seed), speech)
        return
    if model is None:
        raise UsageError("protect needs --model, the model.json of a backtest, or --alphas")
    if state is not None:
        refused = {
            "--beliefs": beliefs, "--weights": weights, "--target": target, "--certify": certify, "--out": out,
            "--previous": previous, "--map": map_, "--measure": None if measure == "maximal" else measure,
        }  # fmt: skip
        now = belief_now(belief, means.returns, refused)
        protect_next(model, now, state, budget, publish, seed, (speech, limits.part()))
        return
    if publish:
        raise UsageError("--publish records a decision: give the file with --state")
    if sum(option is not None for option in (belief, beliefs, weights, means.returns)) != 1:
        raise UsageError("give one of --belief, --beliefs, --weights and --returns")
    if map_ is not None and not normalise:
        raise UsageError("--map needs --normalise: it names the holdings of such a file")
    _check_proof(certify, measure)
    chosen = measure_of(measure, target)
    asked = None if budget is None else budget_of(budget, speech)
    single = None if belief is None else belief_of(belief, "--belief")

    from inscrutable.budgets import remarks_of
    from inscrutable.datasets import read_beliefs
    from inscrutable.experiments import protect as experiment
    from inscrutable.experiments.attack import attack_weights
    from inscrutable.experiments.episodes import part_of
    from inscrutable.experiments.own_model import investor_of
    from inscrutable.experiments.silence import budget_in
    from inscrutable.reports.protect import protect_summary, write_protect

    investor = investor_of(model, limits.part())
    limit = None if asked is None else budget_in(investor.world, investor.problem, asked)
    planned = None if weights is None else weights_of(weights, investor, normalise, map_)
    before = None if previous is None else one_row(weights_of(previous, investor, normalise, map_), previous)
    investor = investor.after(before)
    held: Any = single if beliefs is None else read_beliefs(beliefs, names=investor.regimes)
    cautions = [*remarks_of(asked or investor.budget), *([] if planned is None else planned.cautions())]
    if means.returns is not None:
        held, _, few = belief_after(means.returns, investor, speech)
        cautions += few
    folder = None if out is None else writable_folder(out, "protect")
    with speech.progress("Steps") as move:
        if planned is not None:
            held = attack_weights(investor, planned, progress=part_of(move, 0, experiment.PARTS + 1))
            cautions += held.cautions()
        found = experiment.protect(investor, held, limit, chosen, certify=certify, rng=_rng_of(seed), progress=move)
    files = [] if folder is None else replaced(folder, "protect", partial(write_protect, found), speech)
    if speech.json:
        speech.summary(protect_summary(found) | {"cautions": cautions})
        return
    _show_protection(found, cautions if means.returns is None else [*cautions, IF_PUBLIC])
    if folder is None and len(found) > 1:
        results().print("The weights of all rows: --out FOLDER writes them.")
    speech.files(files)


def _check_proof(certify: float | None, measure: str) -> None:
    """Raise `UsageError` for a malformed gap, and for measures without proofs."""
    if certify is not None and not 0 < certify < 1:
        raise UsageError(f"--certify must be a relative gap between 0 and 1, such as 0.01, got {certify:g}")
    if certify is not None and measure not in ("maximal", "desired"):
        raise UsageError(f"--certify proves --measure maximal and desired, not {measure}")


def _rng_of(seed: int | None) -> Any:
    import numpy as np

    return None if seed is None else np.random.default_rng(seed)


def _show_protection(found: Protection, cautions: list[str]) -> None:
    from inscrutable.experiments.protect import implausible_rows
    from inscrutable.reports.protect import option_lines, row_lines

    bad = implausible_rows(found)
    if bad:
        rows = ", ".join(label_text(found.index[step]) for step in bad[:5])
        results().print(f"No belief explains the planned weights of row {rows}; its nearest explanation is protected.")
    if len(found) == 1:
        show_table(option_lines(found, 0), "What to publish, what it costs, and what an observer concludes from it")
    else:
        show_table(row_lines(found), "What to publish (CDM), what it costs, and what an observer concludes from it")
    results().print(f"{capital(found.summary())}.")
    for line in filter(None, [*cautions, found.verdict]):
        results().print(line)
    if len(found) == 1:
        low_high = ", ".join(
            f"{regime} {low:.2f} to {high:.2f}"
            for regime, (low, high) in zip(found.model.regimes, found.aware_bounds[0], strict=True)
        )
        results().print(f"An observer who also knows your budget infers: {low_high}.")
        if note := found.rounding_note():
            results().print(note)


@app.command(name="compile")
def compile_(*, jobs: int = -1, speech: Speech = Speech()) -> None:  # noqa: B008  # frozen
    """Compile all numerical kernels now, so that no later command on this machine waits for it.

    For container images or cluster nodes. Otherwise each kernel is compiled at first use, which takes a minute or two in all.

    Args:
        jobs: Processes; -1 is one per core.
    """
    from inscrutable.experiments.first_calls import compile_kernels

    with speech.progress("Kernels") as move:
        folder = compile_kernels(n_jobs=jobs, progress=move)
    if speech.json:
        speech.summary({"folder": str(folder)})
    else:
        speech.sentence(f"All numerical kernels are compiled, in {folder}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; errors are one line on stderr, never a traceback.

    Args:
        arguments: What follows the command's name; None takes it from the process.
    """
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    with interrupts_kept() as interrupts:
        return _exit_code(tokens, interrupts)


_INTERRUPTED = "interrupted; every file is whole, and a folder has the results of an earlier run or of this one"


def _check_values(tokens: Sequence[str]) -> None:
    """Refuse empty values, as of an unset variable of a shell: an empty path is the current folder."""
    if "" in tokens:
        option = ["", *tokens][tokens.index("")]
        raise UsageError(f"{option} has an empty value" if option.startswith("-") else "a value is empty")


def _exit_code(tokens: list[str], interrupts: Interrupts) -> int:
    try:
        _check_values(tokens)
        with blaming(tokens), library_log(quiet="-q" in tokens or "--quiet" in tokens):
            code = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except CycloptsError as error:
        # The same words for an option that was left out and for one without its value.
        said = f"{error}".replace("requires an argument", "is needed, with a value")
        pairs = [
            f"{name}={value}"
            for name, value in pairwise(tokens)
            if f"{name} is needed" in said and re.match(r"-[\d.]", value)
        ]
        return _said(
            said + (f" A value that begins with a minus is written {pairs[0]}." if pairs else ""), USAGE, tokens
        )
    except UsageError as error:
        return _said(f"{error}", USAGE, tokens)
    except DiskError as error:
        return _said(str(error), error.exit_code, kind="disk")
    except InscrutableError as error:
        return _said(str(error), error.exit_code)
    except KeyboardInterrupt:
        return _said(_INTERRUPTED, INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output has gone; what is still buffered must not raise again when Python shuts down.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILURE
    except Exception as error:
        if isinstance(error, OSError) and error.errno in DISK:
            return _said(str(error), DiskError.exit_code, kind="disk")
        # A compiled kernel reports an interrupt as an error of its own.
        if interrupts.caused(error):
            return _said(_INTERRUPTED, INTERRUPTED)
        if "-v" in tokens or "--verbose" in tokens:
            raise
        return _said(f"unexpected {type(error).__name__}: {error}; run again with -v for the traceback", FAILURE)
    return code if isinstance(code, int) else 0


def _said(message: str, code: int, tokens: Sequence[str] = (), kind: str = "") -> int:
    """Print one clear message on stderr and return the exit code; wrong usage of a verb points to that verb's help."""
    kind = kind or {USAGE: "usage", INTERRUPTED: "stopped", InputError.exit_code: "bad data", 4: "no solution"}.get(
        code, "error"
    )
    verb = next((token for token in tokens if not token.startswith("-")), "")
    help_of = f"{verb} --help" if verb in app.resolved_commands() else "--help"
    hint = f"\nTry: inscrutable {help_of}" if code == USAGE else ""
    print(f"inscrutable: {kind}: {message.strip()}{hint}", file=sys.stderr, flush=True)
    return code
