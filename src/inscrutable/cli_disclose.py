"""The verb `inscrutable disclose`: schedules of publication, compared."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from inscrutable.cli_console import Speech, replaced, show_table
from inscrutable.cli_values import DATA, PRIVACY, Out, Seed, Whole, disclosure_of, writable_folder

if TYPE_CHECKING:
    from inscrutable.decision_makers import SequentialDecisionMaker
    from inscrutable.experiments.setting import Setting
    from inscrutable.mechanisms import Disclosure

_Makers = Literal["ODM", "CDM", "PDM", "rate-distortion", "Stackelberg", "sequential"]


def disclose(
    *,
    market: Annotated[str, Parameter(("--market", "--model"), group=DATA)] = "returns",
    resolution: Annotated[Whole, Parameter(group=DATA)] = 20,
    disclosures: Annotated[str | None, Parameter(group=PRIVACY)] = None,
    rule: Annotated[_Makers, Parameter(group=PRIVACY)] = "ODM",
    steps: Annotated[Whole, Parameter(group=PRIVACY)] = 24,
    draws: Annotated[Whole, Parameter(group=PRIVACY)] = 100,
    seed: Seed = 0,
    out: Out = Path("disclosures"),
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> None:
    """Compare schedules of publication: how often, how late, and which parts of each decision.

    One row per schedule: the bits that a step and all steps reveal, and the error about the present belief of the aware
    observer, who knows the rule, the model and the schedule. Example: inscrutable disclose --disclosures "every(3);
    every(3)|delayed(2); top(5)"

    Args:
        market: returns (the 12 US industries that come with the package, one step a month), paper (a random market), the
            model.json of a backtest, or a model.toml of your own with regimes.
        resolution: Beliefs are multiples of 1/resolution, predicted one step ahead.
        disclosures: Schedules separated by semicolons. Each is a chain, joined by |, of every(n), delayed(steps),
            rounded(digits), long_only(), at_least(weight), top(n), grouped([labels]), form_13f() and n_port(); the last two
            count in months. Default: nine usual ones, without form_13f() where a step of the model is no month.
        rule: The decision rule. ODM takes the optimal decisions; all others spend at most half the silence regret. The
            sequential rule is computed for each schedule, which takes a minute or two each: name few.
        steps: Length of the paths. Only their second half counts for the bits a step and the error.
        draws: Sampled paths.
        seed: The same seed gives the same numbers.
        out: Folder for the table, the figure and summary.json.
    """
    import numpy as np

    from inscrutable.experiments.comparison import SPENDS_NOTHING, makers_of
    from inscrutable.experiments.comparison_markets import market_of
    from inscrutable.experiments.disclosing import check_step, under_disclosures, usual_in, whole_ones
    from inscrutable.experiments.setting import Setting
    from inscrutable.reports.disclosing import summary_data, write_disclosures

    written = () if disclosures is None else disclosures.split(";")
    asked = tuple(disclosure_of(part.strip(), "--disclosures") for part in written)
    folder = writable_folder(out, "disclose")
    found = market_of(market, resolution, seed)
    asked = asked or usual_in(found.step)
    for each in asked:
        check_step(each, found.step)
    setting = Setting.of(found.problem, found.chain)
    speech.log(f"{found.note}; {len(found.prior)} beliefs")
    spent = 0.0 if rule in SPENDS_NOTHING else 0.5 * setting.silence_regret
    played: Any = partial(_sequential, setting, spent, seed)
    if rule != "sequential":
        behaviour = makers_of([rule])[rule](setting, spent)
        assert behaviour is not None  # these rules suit every portfolio
        played = behaviour.mechanism
    with speech.progress("Schedules") as move:
        table = under_disclosures(
            found.chain,
            played,
            asked,
            steps,
            rng=np.random.default_rng(seed),
            n_draws=draws,
            progress=move,
        )
    title = f"{rule} on {found.note}"
    points = setting.candidates.actions if isinstance(played, partial) else played.actions
    cautions = whole_ones(asked, np.asarray(points))
    files = replaced(folder, "disclose", partial(write_disclosures, table, title=title), speech)
    if speech.json:
        speech.summary(summary_data(table, title) | {"cautions": cautions})
        return
    show_table(table.lines(), f"Error of the aware observer about the present belief ({title})")
    speech.files(files)
    speech.sentence("\n".join(["", table.summary(), *cautions]))


def _sequential(setting: Setting, regret: float, seed: int, disclosure: Disclosure) -> SequentialDecisionMaker:
    """The sequential rule for a disclosure."""
    import numpy as np

    from inscrutable.budgets import Budget
    from inscrutable.decision_makers import SequentialDecisionMaker

    return SequentialDecisionMaker(
        setting.problem,
        Budget.regret(regret),
        chain=setting.chain,
        candidates=setting.candidates,
        information_price=float("inf"),  # one rule per schedule: the best price of information would take minutes each
        disclosure=disclosure,
        rng=np.random.default_rng(seed),
    )
