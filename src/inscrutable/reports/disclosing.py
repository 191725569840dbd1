"""Files of a table of disclosures: figures as CSV, a summary as JSON, and one picture."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from inscrutable import __version__
from inscrutable.datasets import output_folder, write_json, write_table
from inscrutable.experiments.disclosing import DisclosureRow, DisclosureTable
from inscrutable.labels import listed
from inscrutable.mechanisms import Disclosure
from inscrutable.privacy.repeated import SIDE
from inscrutable.reports.style import BLACK, BLUE, drawing, looks_of, save_figure

_WIDTH, _HEIGHT = 7.4, 3.2
_MOST_CURVES = 6
_LINE = 60


def write_disclosures(table: DisclosureTable, folder: str | os.PathLike[str], *, title: str) -> list[Path]:
    """Write disclosures.csv, summary.json and the picture into a folder, and return their paths.

    Raises:
        InputError: A file cannot be written.
    """
    target = output_folder(folder)
    figures, summary = target / "disclosures.csv", target / "summary.json"
    write_table(table.frame().set_index("disclosure"), figures)
    pictures = draw_disclosures(table, target)
    write_json(summary_data(table, title), summary)
    return [figures, *pictures, summary]


def summary_data(table: DisclosureTable, title: str) -> dict[str, Any]:
    """Return what `summary.json` holds: plain data, no clock, no path of this machine."""
    kept = ("prior_error", "n_steps", "n_beliefs")
    return {
        "version": __version__,
        "title": title,
        "sentence": table.summary(),
        **{name: getattr(table, name) for name in kept},
        "rows": table.frame().to_dict(orient="records"),
        "disclosures": [Disclosure.of(row.disclosure).summary() for row in table.rows],
    }


def draw_disclosures(table: DisclosureTable, folder: Path) -> list[Path]:
    """Draw the error at every step for up to six schedules, late ones first, its mean and the bits per step for all.

    The left panel names the schedules that are not drawn in it.
    """
    looks = looks_of([row.disclosure for row in table.rows])
    steps, places = np.arange(table.n_steps), np.arange(len(table.rows))
    with drawing(_WIDTH, _HEIGHT, ncols=2, width_ratios=[5, 4]) as (figure, (left, right)):
        late_first = sorted(table.rows, key=lambda row: Disclosure.of(row.disclosure).schedule.is_immediate)
        for row in late_first[:_MOST_CURVES]:
            look = looks[row.disclosure]
            left.plot(steps, row.errors, look.line, color=look.colour, label=row.disclosure)
        dashed = {"color": BLACK, "linestyle": "--", "linewidth": 0.8}
        left.axhline(table.prior_error, label="without decisions", **dashed)
        right.axvline(table.prior_error, **dashed)
        left.xaxis.get_major_locator().set_params(integer=True)
        left.set(
            xlabel=f"step{_left_out(late_first)}",
            ylabel="error about the present belief",
            ylim=(0, 1.45 * table.prior_error or 1),
        )
        left.legend(ncols=2, loc="upper left")
        right.barh(
            places,
            [row.error for row in table.rows],
            xerr=[SIDE * row.error_se for row in table.rows],
            color=BLUE,
            alpha=0.7,
        )
        for place, row in zip(places, table.rows, strict=True):
            right.text(
                0.99,
                place,
                f"{row.bits:.2f}",
                va="center",
                ha="right",
                fontsize=6,
                transform=right.get_yaxis_transform(),
            )
        right.text(0.99, 1.01, "bits a step", ha="right", va="bottom", fontsize=6, transform=right.transAxes)
        right.set_yticks(places, [row.disclosure for row in table.rows])
        right.invert_yaxis()
        right.set(
            xlabel="error over the second half; dashed: without decisions", xlim=(0, 1.4 * table.prior_error or 1)
        )
        return save_figure(figure, folder, "disclosures")


def _left_out(late_first: Sequence[DisclosureRow]) -> str:
    """Return a line on the schedules without a curve; empty where all have one."""
    names = listed([row.disclosure for row in late_first[_MOST_CURVES:]])
    return "\n" + fill(f"not drawn: {names}", _LINE) if names else ""
