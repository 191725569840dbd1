"""Files of implied views: a table, a summary and a picture of weights beside the views."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inscrutable.alphas import ImpliedViews
from inscrutable.axes import few
from inscrutable.datasets import output_folder, write_json, write_table
from inscrutable.datasets.tables import FULL_PRECISION_DIGITS, decimal_places
from inscrutable.labels import label_text
from inscrutable.reports.style import BLUE, GREY, ORANGE, PAGE_WIDTH, as_written, drawing, save_figure
from inscrutable.validation import Array

_MOST_ASSETS = 30
_HEIGHT_OF_ASSET = 0.22
LARGEST_BOOK = 20.0
"""Largest sum of absolute weights; larger sums are probably percentages or money."""


def views_frame(read: Mapping[Any, ImpliedViews]) -> pd.DataFrame:
    """Return weights and least and greatest expected returns, one row per portfolio and asset."""
    tables = [views.frame().reset_index().assign(portfolio=label_text(label)) for label, views in read.items()]
    joined: pd.DataFrame = pd.concat(tables)
    return joined.set_index("portfolio")


def views_summary(read: Mapping[Any, ImpliedViews]) -> dict[str, Any]:
    """Return the views of each portfolio as plain data."""
    kept = ("status", "dimension", "regret", "digits", "reference")
    portfolios = {
        label_text(label): {
            **{name: getattr(views, name) for name in kept},
            "plausibility_gap": views.plausibility_gap,
            "assets": {
                str(name): {"least": low, "greatest": high} for name, _, low, high in views.frame().itertuples()
            },
        }
        for label, views in read.items()
    }
    return {"portfolios": portfolios, "remarks": views_remarks(read)}


def views_remarks(read: Mapping[Any, ImpliedViews]) -> list[str]:
    """Return remarks on the views: portfolios that no view explains, and weights that look rounded, or like percentages or
    money."""
    empty = [label_text(label) for label, views in read.items() if views.dimension < 0]
    remarks = [f"No view explains the weights of {few(empty)}."] if empty else []
    written = max(
        (decimals_of(each.weights) for each in read.values() if each.digits is None and not each.regret), default=0
    )
    if 0 < written < FULL_PRECISION_DIGITS:
        remarks.append(
            f"Caution: the weights are written with {decimal_places(written)} and read as exact. If they are rounded, other "
            f"views explain them too: --digits {written}."
        )
    sizes = {label_text(label): float(np.abs(views.weights).sum()) for label, views in read.items()}
    if not sizes or max(sizes.values()) <= LARGEST_BOOK:
        return remarks
    label = max(sizes, key=lambda each: sizes[each])
    return [
        *remarks,
        f"The weights of {label} add up to {sizes[label]:,.6g} in size. They are read as shares of wealth, and the views grow "
        "with them: divide percentages by 100, and money by the wealth.",
    ]


def decimals_of(weights: Array) -> int:
    """Return the digits after the point of weights, at most 15."""
    return next((digits for digits in range(15) if np.array_equal(np.round(weights, digits), weights)), 15)


_SPOKEN = {"portfolio": "the portfolio", "mean": "the mean"}
"""References that are no asset, within a sentence."""


def write_views(read: Mapping[Any, ImpliedViews], folder: Path) -> list[Path]:
    """Write views.csv, summary.json and the picture of the last portfolio into a folder and return their paths.

    Example:
        >>> import tempfile
        >>> from inscrutable import AlphaProblem, implied_views
        >>> views = implied_views(AlphaProblem([[0.04, 0.0], [0.0, 0.01]], 2.5), [0.1, 0.2], regret=0.0001)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     sorted(path.name for path in write_views({"May": views}, Path(folder)))
        ['summary.json', 'views.csv', 'views.png', 'views.svg']
    """
    target = output_folder(folder)
    paths = [target / "views.csv", target / "summary.json"]
    write_table(views_frame(read), paths[0])
    write_json(views_summary(read), paths[1])
    last = list(read.values())[-1]
    shown = min(_MOST_ASSETS, last.problem.n_assets)
    with drawing(PAGE_WIDTH, 0.8 + _HEIGHT_OF_ASSET * shown, ncols=2, sharey=True) as (figure, axes):
        draw_views(last, axes)
        return paths + save_figure(figure, target, "views")


def draw_views(views: ImpliedViews, axes: Any) -> None:
    """Draw weights on the first of two panels and the intervals of expected returns on the second, largest weights first."""
    frame = views.frame()
    frame = frame.iloc[np.argsort(-np.abs(frame["weight"].to_numpy()), kind="stable")[:_MOST_ASSETS]]
    places = np.arange(len(frame))[::-1]
    axes[0].barh(places, frame["weight"], color=GREY, height=0.6)
    axes[0].set_yticks(places, [as_written(str(name)) for name in frame.index])
    axes[0].set_xlabel("weight")
    ends = frame[["least", "greatest"]].to_numpy() * 100.0
    known = ends[np.isfinite(ends)]
    low, high = (known.min(), known.max()) if known.size else (-1.0, 1.0)
    room = 0.15 * (high - low) or 1.0
    for place, (least, greatest) in zip(places, ends, strict=True):
        if np.isnan(least):
            continue
        first, last = max(least, low - room), min(greatest, high + room)
        axes[1].plot([first, last], [place, place], color=BLUE, linewidth=2.5, solid_capstyle="butt")
        for end, at, mark in ((least, first, "<"), (greatest, last, ">")):
            axes[1].plot(at, place, mark if np.isinf(end) else "|", color=ORANGE if np.isinf(end) else BLUE)
    told = (
        "implied expected return"
        if views.reference is None
        else f"implied expected return less that of {_SPOKEN.get(str(views.reference), views.reference)}"
    )
    axes[1].set_xlabel(f"{told}, %")
    axes[1].axvline(0.0, color=GREY, linewidth=0.5)
