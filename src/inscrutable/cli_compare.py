"""The verb `inscrutable compare`: every rule against every observer."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from inscrutable.cli_console import Speech, replaced, show_table, write_report
from inscrutable.cli_limits import WeightOptions
from inscrutable.cli_study import AGAIN, STUDY, resumable, was_told
from inscrutable.cli_values import (
    DATA,
    PRIVACY,
    Out,
    Seed,
    Whole,
    budgets_of,
    disclosure_of,
    saying,
    whole_numbers_of,
    writable_folder,
)


def compare(
    *,
    market: Annotated[str, Parameter(("--market", "--model"), group=DATA)] = "paper",
    resolution: Annotated[Whole, Parameter(group=DATA)] = 30,
    rival: Annotated[Path | None, Parameter(group=DATA)] = None,
    budgets: Annotated[str, Parameter(group=PRIVACY)] = "silence:0.25,0.5,0.75,1",
    makers: Annotated[str | None, Parameter(group=PRIVACY)] = None,
    pairs: Annotated[str | None, Parameter(group=PRIVACY)] = None,
    disclosure: Annotated[str, Parameter(group=PRIVACY)] = "exact",
    limits: WeightOptions = WeightOptions(),  # noqa: B008  # frozen
    jobs: Whole = -1,
    seed: Seed = 0,
    out: Out = Path("comparison"),
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> None:
    """Compare decision rules against the naive observer and the aware one, who knows the rule.

    The table also has an observer who follows all decisions over time, and one who first learns the risk aversion.

    Every rule spends the same expected regret. Example: inscrutable compare --model demo/model.json --budgets 0.05,0.1

    Args:
        market: paper (a random market with equally likely beliefs that last as long as regimes), returns (the 12 embedded US
            industries with the law of their investor's belief), the model.json of a backtest, or a model.toml of your own with
            regimes.
        resolution: Beliefs are multiples of 1/resolution, predicted one step ahead; 30 gives up to 496 for three regimes.
        rival: TOML file whose [problem] is a rival's decision problem; adds the worth of the belief and of decisions to that
            rival.
        budgets: Expected regrets, ascending: 0.05,0.1 are shares of |c*|, the size of the optimal cost; silence:0.25,0.5,1 are
            shares of the silence regret, which is that of the best constant decision; regret:0.001,0.002 are in the cost's
            unit.
        makers: The decision makers to compare, by the table's names, such as CDM,PDM,rate-distortion. Default: all.
        pairs: Adds an observer who has seen only this many pairs of belief and decision, such as 100,1000.
        disclosure: What observers see of decisions, how often and how late, such as "every(3)|delayed(2)" or form_13f();
            `inscrutable disclose` compares such schedules. The sequential rule takes it into account. Delayed and partial
            trading are then left out.
        limits: Limits on the weights.
        jobs: Processes; -1 is one per core. Changes nothing but the time.
        seed: The same seed gives the same numbers.
        out: Folder for the table (CSV, Markdown), the figure and summary.json; with the extra `inscrutable[report]` also
            report.html, one interactive page that works offline. Its folder "study" holds the study behind them: the same
            command continues a run that was stopped.
    """
    unit, shares = budgets_of(budgets)

    from inscrutable.experiments.comparison import ComparisonSettings, makers_named
    from inscrutable.experiments.comparison_study import compared, comparison_study
    from inscrutable.experiments.rivals import read_rival
    from inscrutable.reports.comparison import terminal_table, write_comparison

    seen = () if pairs is None else whole_numbers_of(pairs, "--pairs")
    wanted = None if rival is None else read_rival(rival)
    with saying("--makers"):
        named = None if makers is None else makers_named(makers)
    shown: dict[str, Any] = {"disclosure": disclosure_of(disclosure), "pairs": seen, "rival": wanted}
    settings = ComparisonSettings(budgets=shares, unit=unit, **shown)
    folder = writable_folder(out, "compare")
    speech.detail(f"Settings: {settings}")
    market_of: dict[str, Any] = {"market": market, "resolution": resolution, "seed": seed, "limits": limits.part()}
    asked = comparison_study(settings, named, **market_of)
    with resumable(folder / STUDY, AGAIN):
        with speech.progress("Decision makers at budgets") as move:
            more: dict[str, Any] = {"again": was_told(folder), "say": speech.log, "progress": move}
            result, note = compared(asked, folder / STUDY, jobs=jobs, **more)
        speech.log("Drawing the figure")
        page = partial(write_report, result, manifest={"market": note, "seed": seed})
        figures = partial(write_comparison, result, title=note)
        files = replaced(folder, "compare", lambda into: [*figures(into), *page(into)], speech)
    if speech.json:
        speech.summary_file(folder / "summary.json")
        return
    middle = result.middle_budget
    show_table(terminal_table(result, middle), f"Expected regret of {middle:.3g} ({result.header()})")
    speech.sentence(f"What the columns mean, and all other budgets: {folder / 'comparison.md'}")
    speech.files(files)
    speech.sentence(f"\n{result.summary()}")
