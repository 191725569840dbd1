"""The verb `inscrutable views`: expected returns implied by weights."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from inscrutable.cli_console import Speech, replaced, show_table
from inscrutable.cli_limits import Held, region_of
from inscrutable.cli_values import (
    AT_LEAST_0,
    DATA,
    INVESTOR,
    PRIVACY,
    Out,
    UsageError,
    Whole,
    amount_of,
    check_labels,
    covariance_of,
    history_of,
    writable_folder,
)
from inscrutable.labels import label_text

if TYPE_CHECKING:
    import pandas as pd

    from inscrutable.alphas import AlphaProblem, ImpliedViews

_LONGEST_TABLE = 40


def views(
    *,
    weights: Annotated[Path, Parameter(group=DATA)],
    covariance: Annotated[Path | None, Parameter(group=DATA)] = None,
    returns: Annotated[Path | None, Parameter(group=DATA)] = None,
    prices: Annotated[Path | None, Parameter(group=DATA)] = None,
    factors: Annotated[Whole | None, Parameter(group=DATA), AT_LEAST_0] = None,
    risk_aversion: Annotated[float, Parameter(group=INVESTOR)],
    held: Annotated[Held, Parameter(group=INVESTOR)] = "anything",
    cap: Annotated[str | None, Parameter(group=INVESTOR)] = None,
    regret: Annotated[str | None, Parameter(group=PRIVACY)] = None,
    digits: Annotated[Whole | None, Parameter(group=PRIVACY), AT_LEAST_0] = None,
    reference: Annotated[str | None, Parameter(group=PRIVACY)] = None,
    out: Out | None = None,
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> None:
    """Find the expected returns that make weights the optimal mean-variance portfolio.

    Example: inscrutable views --weights weights.csv --returns returns.csv --factors 3 --risk-aversion 5 --held long-only
    --reference portfolio

    Args:
        weights: CSV of weights: dates or labels in the first column, one column per asset, one row per portfolio.
        covariance: CSV of the covariance per period: the assets' names in the first row and column.
        returns: CSV of returns, as for `backtest`, from which the covariance is estimated instead.
        prices: CSV of prices, as for `backtest`: the same for the returns between their rows.
        factors: With `--returns` or `--prices`: number of principal factors of that covariance, besides specific variances.
            Default: the sample covariance.
        risk_aversion: γ in the investor's cost γ u'Vu − m'u, per unit of return, without a half.
        held: What may be held: anything; invested: weights that sum to one; long-only: these, none below zero.
        cap: Largest weight, such as 0.25 or 25%.
        regret: Largest regret of the weights, such as 5bp or 0.0005 per period.
        digits: Decimals that the weights were rounded to.
        reference: State expected returns minus that of this asset, of the "portfolio" with its weights as given, or of the
            "mean" asset. Needed where weights must sum to one, because a constant added to all expected returns then changes
            nothing.
        out: Folder for views.csv, summary.json and the figure; without it the results are only printed.
    """
    if sum(option is not None for option in (covariance, returns, prices)) != 1:
        raise UsageError("give one of --covariance FILE, --returns FILE and --prices FILE")
    if factors is not None and covariance is not None:
        raise UsageError("--factors belongs to --returns or --prices")
    if regret is not None and digits is not None:
        raise UsageError("give --regret or --digits, not both: the regret of rounded weights is not known")
    allowed = None if regret is None else amount_of(regret, "--regret")

    from inscrutable import tolerances
    from inscrutable.alphas import AlphaProblem
    from inscrutable.datasets import read_records
    from inscrutable.errors import ModelError
    from inscrutable.reports.views import views_frame, views_remarks, views_summary, write_views

    table = read_records(weights, all_numbers=True)
    risk = _risk((weights, table), covariance, returns or prices, factors, prices is not None)
    problem = AlphaProblem(risk, risk_aversion, region_of(list(table.columns), held, cap))
    folder = None if out is None else writable_folder(out, "views")
    portfolios = "1 portfolio" if len(table) == 1 else f"{len(table)} portfolios"
    speech.log(f"{portfolios} of {problem.n_assets} assets, {_risk_text(covariance or returns or prices, factors)}")
    read = {
        label: _read(problem, (weights, label, row), regret=allowed, digits=digits, reference=reference)
        for label, row in table.iterrows()
    }
    if all(views.dimension < 0 for views in read.values()):
        raise ModelError(
            f"{weights}: no expected returns explain any of these portfolios: no weights that may be held are rounded to them, "
            f"to {digits} decimals"
        )
    files = [] if folder is None else replaced(folder, "views", partial(write_views, read), speech)
    if speech.json:
        speech.summary(views_summary(read))
        return
    last, found = list(read.items())[-1]
    whom = "the rounded portfolio" if digits is not None and reference == "portfolio" else reference
    said = "" if reference is None else f", less that of {whom}"
    frame = views_frame({last: found}).set_index("asset").iloc[:_LONGEST_TABLE]
    show_table(frame.map(lambda value: f"{value:.5g}"), f"Expected return a period that {label_text(last)} says{said}")
    speech.sentence(f"{label_text(last)}: {found.status.value}.")
    for remark in views_remarks(read):
        speech.sentence(remark)
    if held == "anything" and (table.sum(axis=1) - 1.0).abs().max() < tolerances.MIN_SLACK * problem.n_assets:
        speech.sentence(
            "Caution: these weights sum to one. If they must, a constant added to all expected returns changes nothing: read "
            "them with --held long-only (or invested) --reference portfolio."
        )
    if reference is None and held != "anything":
        speech.sentence(
            "Caution: weights that must sum to one determine no expected return by itself, as a constant added to all changes "
            "nothing: read them with --reference portfolio, mean, or an asset."
        )
    if problem.n_assets > _LONGEST_TABLE or len(read) > 1:
        speech.sentence("All portfolios and assets: --out FOLDER" if folder is None else f"All: {folder / 'views.csv'}")
    speech.files(files)


def _read(problem: AlphaProblem, of: tuple[Path, Any, pd.Series], **how: Any) -> ImpliedViews:
    """The views of one row of a file."""
    from inscrutable.alphas import implied_views
    from inscrutable.errors import InputError

    path, label, row = of
    try:
        _check(problem, row, how["digits"])
    except InputError as error:
        where = f"{path}, row {label_text(label)}"
        raise InputError(f"{where}: {error}{_advice(problem, row)}") from None
    return implied_views(problem, row, **how)


def _check(problem: AlphaProblem, row: pd.Series, digits: int | None) -> None:
    """Raise `InputError` where weights may not be held, or with `digits` are no rounding of any that may be.

    A sum of rounded weights errs by at most half a unit of the last digit for each. A single one lies between its limits as
    they are rounded, so that a short position is none of zero.
    """
    import numpy as np

    from inscrutable import tolerances
    from inscrutable.errors import InputError

    if digits is None or problem.layout is None:
        problem.check_weights(row)
        return
    unit, near = max(0.1**digits, tolerances.FEASIBILITY), tolerances.FEASIBILITY
    held = problem.check_weights(row, beyond=0.5 * unit * problem.n_assets + near)
    low, high = (
        np.ceil((problem.layout.lower - near) / unit - 0.5) * unit,
        np.floor((problem.layout.upper + near) / unit + 0.5) * unit,
    )
    off = np.maximum(low - held, held - high)
    if off.max() > near:
        worst = int(off.argmax())
        raise InputError(
            f"the weight of {row.index[worst]} is {held[worst]:g}, and a weight from {problem.layout.lower[worst]:g} to "
            f"{problem.layout.upper[worst]:g} is rounded to {digits} decimals to one from {low[worst]:g} to {high[worst]:g}"
        )


def _advice(problem: AlphaProblem, row: pd.Series) -> str:
    """A clause for weights that may not be held as they are, but rounded, or as percentages."""
    from inscrutable.errors import InputError
    from inscrutable.reports.views import LARGEST_BOOK, decimals_of

    digits = decimals_of(row.to_numpy())
    cases = [(row, digits, f"; rounded weights need --digits, here --digits {digits}")]
    if row.abs().sum() > LARGEST_BOOK:
        cases.append((row / 100.0, digits + 2, "; these are percentages: divide them by 100"))
    for weights, rounded, said in cases:
        try:
            _check(problem, weights, rounded)
        except InputError:
            continue
        return said
    return ""


def _risk_text(path: Path | None, factors: int | None) -> str:
    return f"with the covariance of {path}" + ("" if factors is None else f" by {factors} principal factors")


def _risk(
    held: tuple[Path, pd.DataFrame],
    covariance: Path | None,
    history: Path | None,
    factors: int | None,
    are_prices: bool,
) -> Any:
    """The covariance of the weights' columns, in their order: as given, or of a history of returns or prices."""
    from inscrutable.alphas import FactorRisk
    from inscrutable.errors import InputError

    path, table = held
    assets = list(table.columns)
    if covariance is not None:
        given = covariance_of(covariance)
        if table.index.name in given.columns:
            raise InputError(
                f"{path}: the first column of the weights is the asset {table.index.name}, expected dates or labels of "
                "portfolios before it"
            )
        check_labels(path, assets, covariance, list(given.columns))
        return given.loc[assets, assets]
    assert history is not None
    returns = history_of(history, prices=are_prices)
    check_labels(path, assets, history, list(returns.columns))
    return returns[assets].cov() if factors is None else FactorRisk.from_returns(returns[assets], factors)
