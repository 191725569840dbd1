"""The verb `inscrutable attack`: the beliefs behind published weights."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from inscrutable.cli_console import Speech, replaced, show_table
from inscrutable.cli_limits import WeightOptions, one_row, weights_of
from inscrutable.cli_values import AT_LEAST_0, DATA, Out, RuleName, UsageError, Whole, budget_of, writable_folder

if TYPE_CHECKING:
    from inscrutable.experiments.attack import Attack
    from inscrutable.experiments.attack_over_time import AttackOverTime

_LONGEST_TABLE = 40


def attack(
    *,
    model: Annotated[Path, Parameter(group=DATA)],
    weights: Annotated[Path, Parameter(group=DATA)],
    beliefs: Annotated[Path | None, Parameter(group=DATA)] = None,
    digits: Annotated[Whole | None, Parameter(group=DATA), AT_LEAST_0] = None,
    mechanism: Annotated[RuleName | None, Parameter(group=DATA)] = None,
    budget: Annotated[str | None, Parameter(group=DATA)] = None,
    state: Annotated[Path | None, Parameter(group=DATA)] = None,
    normalise: Annotated[bool, Parameter(group=DATA, negative=(), show_default=False)] = False,
    map_: Annotated[Path | None, Parameter(name="--map", group=DATA)] = None,
    previous: Annotated[Path | None, Parameter(group=DATA)] = None,
    regret: Annotated[str | None, Parameter(group=DATA)] = None,
    limits: WeightOptions = WeightOptions(),  # noqa: B008  # frozen
    out: Out | None = None,
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> None:
    """Find the beliefs that explain published weights.

    The command counts the digits in the file and takes the weights as rounded to them. With `--mechanism` it also shows what
    the aware observer, who knows the rule, concludes from all rows so far. Rows are one step of the model apart.

    Args:
        model: The model.json of a backtest, or a model.toml of your own with regimes.
        weights: CSV with one column per asset and one row per portfolio; a first column may hold dates or labels.
        beliefs: CSV of the beliefs behind dated weights, by the same dates, one column per regime. The output then says whether
            they were hidden.
        digits: Decimals that the weights were rounded to. Default: as written.
        mechanism: The rule of the weights, known to the observer: optimal, cdm, pdm, or sequential.
        budget: With `--mechanism`: the rule's budget, as in protect; with `--state` as in its file. Default: the model's.
        state: With `--mechanism sequential`: the state file of `protect`, which has the rule's prices.
        normalise: Accept holdings in dollars, shares and prices, or percentages, with blanks, cash and tickers in any case.
        map_: With `--normalise`: CSV with the columns name (as in the file of holdings) and asset (blank for holdings to leave
            out).
        previous: Where turnover is limited: CSV of the weights published before the first row, one row.
        regret: Find the beliefs under which the weights cost at most this much more than the best ones, such as 5bp.
        limits: Limits on the weights.
        out: Folder for attack.csv, summary.json and the figures; without it the results are only printed.
    """
    import pandas as pd

    from inscrutable.datasets import read_beliefs
    from inscrutable.datasets.tables import FULL_PRECISION_DIGITS
    from inscrutable.experiments.attack import attack_weights
    from inscrutable.experiments.attack_judged import judge_attack
    from inscrutable.experiments.attack_over_time import attack_over_time
    from inscrutable.experiments.own_model import investor_of
    from inscrutable.experiments.silence import budget_in
    from inscrutable.reports.attack import attack_summary

    if mechanism is None and (budget is not None or state is not None):
        raise UsageError("--budget and --state need --mechanism")
    if (mechanism == "sequential") != (state is not None):
        raise UsageError("--mechanism sequential and --state FILE go together")
    limit = None if budget is None else budget_of(budget, speech)
    _check_together(normalise, map_, digits, None if beliefs is None else regret)
    most = 0.0 if regret is None else _regret_of(regret)
    investor = investor_of(model, limits.part())
    if limit is not None:
        limit = budget_in(investor.world, investor.problem, limit)
    table = weights_of(weights, investor, normalise, map_)
    if digits is not None:
        table = replace(table, decimals=digits if digits < FULL_PRECISION_DIGITS else None)
    if beliefs is not None and not isinstance(table.frame.index, pd.DatetimeIndex):
        raise UsageError("--beliefs compares by dates: give weights with a first column of dates")
    before = None if previous is None else one_row(weights_of(previous, investor, normalise, map_), previous)
    held = None if beliefs is None else read_beliefs(beliefs, names=investor.regimes)
    folder = None if out is None else writable_folder(out, "attack")
    speech.log(table.summary())
    with speech.progress("Rows read") as move:
        found = attack_weights(investor, table, regret=most, previous=before, progress=move)
    over_time = None if mechanism is None else attack_over_time(found, mechanism, limit, state=state)
    judged = None if held is None else judge_attack(found, held, over_time)
    doubts = [*table.cautions(), *found.cautions()]
    cautions = [*doubts, *([] if over_time is None else over_time.cautions())]
    more = ({} if judged is None else {"judged": judged.figures()}) | {"cautions": cautions}
    write = partial(_write, found, over_time, more)
    files = [] if folder is None else replaced(folder, "attack", write, speech)
    if speech.json:
        followed = {} if over_time is None else {"over_time": over_time.table().to_dict("records")}
        speech.summary(attack_summary(found) | followed | more)
        return
    _show_attack(found, speech, whole=folder is None)
    if over_time is not None:
        lines = over_time.lines()
        shown = lines if folder is None else lines.iloc[:_LONGEST_TABLE]
        title = f"What the aware observer, who knows the rule ({mechanism}), concludes from all rows so far"
        show_table(shown, title if len(shown) == len(lines) else f"{title}; the first {len(shown)} rows")
    speech.sentence(found.summary())
    if over_time is not None:
        for line in over_time.summary().splitlines():
            speech.sentence(line)
    for line in [*doubts, *([] if judged is None else judged.summary().splitlines())]:
        speech.sentence(line)
    speech.files(files)


def _write(found: Attack, over_time: AttackOverTime | None, more: dict[str, Any], into: Path) -> list[Path]:
    """Write the files of an attack into a folder and return their paths."""
    from inscrutable.datasets import write_table
    from inscrutable.reports.attack import write_attack

    paths = write_attack(found, into, more=more)
    if over_time is not None:
        paths.append(into / "attack_over_time.csv")
        write_table(over_time.table(), paths[-1])
    return paths


def _check_together(normalise: bool, map_: Path | None, digits: int | None, regret: str | None) -> None:
    """Refuse flags that do not go together; `regret` is that of a record judged by its beliefs."""
    if map_ is not None and not normalise:
        raise UsageError("--map needs --normalise: it names the holdings of such a file")
    if digits is not None and normalise:
        raise UsageError("--digits is for weights as published; of holdings the digits in the file count")
    if regret is not None:
        raise UsageError(
            "--beliefs judges what an observer reads who takes the weights for the best ones: leave out --regret, with which "
            "it allows for others and errs more"
        )


def _regret_of(text: str) -> float:
    """Return the regret of "5bp" or "regret:0.0005"; a plain number would be a share of the optimal cost."""
    from inscrutable.budgets import Budget, written_budget
    from inscrutable.errors import InputError

    try:
        found = written_budget(text)
    except InputError as error:
        raise UsageError(f"--regret: {error}") from None
    if not isinstance(found, Budget) or found.is_relative:
        raise UsageError(f"--regret {text}: expected a regret such as 5bp or regret:0.0005, in the cost's unit")
    return found.amount


def _show_attack(found: Attack, speech: Speech, *, whole: bool) -> None:
    from inscrutable.reports.attack import attack_lines, reading_notes

    table = attack_lines(found)
    title = "What the weights reveal: an observer's estimate of each regime [least, most]"
    if whole or len(table) <= _LONGEST_TABLE:
        show_table(table, title)
    else:
        show_table(table.iloc[:_LONGEST_TABLE], f"{title}; the first {_LONGEST_TABLE} of {len(table)} rows")
    for line in reading_notes(found):
        speech.sentence(line)
