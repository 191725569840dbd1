"""The picture of a comparison: what is paid on one axis, what each observer still does not know on the other."""

from __future__ import annotations

from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np

from inscrutable.experiments.comparison import Comparison
from inscrutable.reports.style import BLACK, Look, drawing, looks_of, save_figure
from inscrutable.validation import Array

_PAGE_WIDTH = 7.0
_PANEL_HEIGHT = 2.3
_COLUMNS = 2
_HEADER_WIDTH = 150
_PERCENT = 100.0
_SIDE = 1.96
"""Standard errors to either side of a 95 % interval."""


def draw_comparison(comparison: Comparison, folder: Path) -> list[Path]:
    """Draw the errors of the naive observer and of the aware one after each number of decisions; return the paths."""
    n_panels = 1 + len(comparison.repeats)
    n_rows = -(-n_panels // _COLUMNS)
    with drawing(_PAGE_WIDTH, n_rows * _PANEL_HEIGHT + 0.6, nrows=n_rows, ncols=_COLUMNS, squeeze=False) as (
        figure,
        axes,
    ):
        panels = axes.reshape(-1)
        plot_errors(panels[0], comparison, None)
        for place in range(len(comparison.repeats)):
            plot_errors(panels[1 + place], comparison, place)
        for unused in panels[n_panels:]:
            unused.set_visible(False)
        highest = max(axis.get_ylim()[1] for axis in panels[:n_panels])
        for axis in panels[:n_panels]:
            axis.set_ylim(0.0, highest)
        lines, names = panels[0].get_legend_handles_labels()
        figure.legend(
            lines,
            names,
            loc="outside upper left",
            ncols=4,
            columnspacing=1.2,
            handlelength=2.4,
            title="\n".join(wrap(comparison.header(), _HEADER_WIDTH)),
            title_fontsize=7,
            alignment="left",
        )
        figure.supxlabel(_scale(comparison)[1], fontsize=8)
        figure.supylabel("error of the observer's estimate (root mean square)", fontsize=8)
        return save_figure(figure, folder, "comparison")


def plot_errors(axes: Any, comparison: Comparison, place: int | None) -> None:
    """Draw one observer's error against the expected regret, one curve per decision maker, the prior as ceiling.

    Args:
        axes: A Matplotlib axis.
        comparison: From `compare`.
        place: Which of `comparison.repeats` the aware observer sees; None draws the naive one, after one decision.
    """
    scale, _ = _scale(comparison)
    looks = looks_of(comparison.makers)
    for maker in comparison.makers:
        rows, look = comparison.of(maker), looks[maker]
        along = scale * np.array([row.expected_regret for row in rows])
        if place is None:
            _curve(axes, along, np.array([row.naive_error for row in rows]), np.zeros(len(rows)), maker, look)
            continue
        errors = np.array([row.repeated_errors[place] for row in rows])
        _curve(axes, along, errors, _SIDE * np.array([row.repeated_error_se[place] for row in rows]), maker, look)
    axes.axhline(comparison.prior_error, color=BLACK, linestyle="--", linewidth=0.8, zorder=1, label="prior alone")
    axes.set_title(_title(comparison, place), loc="left")
    axes.set_xlim(left=0.0)


def _title(comparison: Comparison, place: int | None) -> str:
    if place is None:
        return "takes the decision at face value"
    n = comparison.repeats[place]
    return "knows the mechanism: 1 decision" if n == 1 else f"knows the mechanism: {n} decisions on one belief"


def _scale(comparison: Comparison) -> tuple[float, str]:
    if comparison.silence_regret > 0:
        return _PERCENT / comparison.silence_regret, "expected regret, % of the silence regret"
    return 1.0, "expected regret, in the cost's unit"


def _curve(axes: Any, along: Array, heights: Array, sides: Array, name: str, look: Look) -> None:
    hollow = {} if look.marker in "x+" else {"markerfacecolor": "white"}
    axes.plot(
        along, heights, look.line, color=look.colour, marker=look.marker, label=name, zorder=3, clip_on=False, **hollow
    )
    if sides.any():
        axes.vlines(along, heights - sides, heights + sides, color=look.colour, linewidth=0.8, alpha=0.7, zorder=2)
