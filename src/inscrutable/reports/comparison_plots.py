"""The picture of a comparison: expected regret on one axis, the error of each observer on the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from textwrap import wrap
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.experiments.comparison import Comparison
from inscrutable.experiments.comparison_measures import ComparisonRow
from inscrutable.privacy.repeated import SIDE
from inscrutable.reports.names import spelled
from inscrutable.reports.style import BLACK, PAGE_WIDTH, PERCENT, Look, curve_of, drawing, looks_of, save_figure
from inscrutable.validation import Array

_PANEL_HEIGHT = 2.3
_RIVAL_HEIGHT = 3.8
_COLUMNS = 2
_HEADER_WIDTH = 150


_MOST_CURVES = 6
_MAIN_MAKERS = ("CDM", "PDM", "rate-distortion", "Stackelberg", "sequential", "coin")


def main_makers(comparison: Comparison) -> list[str]:
    """Return the decision makers to draw: all, or six kinds if there are many."""
    if len(comparison.makers) <= _MOST_CURVES:
        return list(comparison.makers)
    return [name for name in _MAIN_MAKERS if name in comparison.makers] or list(comparison.makers[:_MOST_CURVES])


class _Panel(NamedTuple):
    """The panel of one observer: heading, error of a row, its standard error, and the ceiling's budgets."""

    title: str
    error: Callable[[ComparisonRow], float]
    spread: Callable[[ComparisonRow], float]
    ceilings: Mapping[float, float] = MappingProxyType({})


def _panels(comparison: Comparison) -> list[_Panel]:
    found = [_Panel("naive observer, one decision", lambda row: row.naive_error, lambda row: 0.0)]
    found += [_after(n, place) for place, n in enumerate(comparison.repeats)]
    if comparison.is_moving:
        title = "aware observer, over time"
        found.append(_Panel(title, lambda row: row.path_error, lambda row: row.path_error_se, comparison.ceilings))
    return found


def _after(n: int, place: int) -> _Panel:
    if n == 1:
        return _Panel("aware observer, one decision", lambda row: row.bayes_error, lambda row: 0.0)
    return _Panel(
        f"aware observer, {n} decisions on one belief",
        lambda row: float(row.repeated_errors[place]),
        lambda row: float(row.repeated_error_se[place]),
    )


def draw_comparison(comparison: Comparison, folder: Path) -> list[Path]:
    """Draw the errors of the naive and the aware observer, also after repeated decisions and over time; return the paths."""
    panels = _panels(comparison)
    n_rows = -(-len(panels) // _COLUMNS)
    with drawing(PAGE_WIDTH, n_rows * _PANEL_HEIGHT + 0.6, nrows=n_rows, ncols=_COLUMNS, squeeze=False) as (
        figure,
        axes,
    ):
        places = axes.reshape(-1)
        for axis, panel in zip(places, panels, strict=False):
            _plot_errors(axis, comparison, panel)
        for unused in places[len(panels) :]:
            unused.set_visible(False)
        highest = max(axis.get_ylim()[1] for axis in places[: len(panels)])
        for axis in places[: len(panels)]:
            axis.set_ylim(0.0, highest)
        lines, names = places[len(panels) - 1].get_legend_handles_labels()  # the ceiling is in the last
        figure.legend(
            lines,
            names,
            loc="outside upper left",
            ncols=4,
            columnspacing=1.2,
            handlelength=2.4,
            title="\n".join(wrap(_header(comparison), _HEADER_WIDTH)),
            title_fontsize=7,
            alignment="left",
        )
        figure.supxlabel(_scale(comparison)[1], fontsize=8)
        figure.supylabel("error of the observer's estimate (root mean square)", fontsize=8)
        return save_figure(figure, folder, "comparison")


def _header(comparison: Comparison) -> str:
    drawn, every = len(main_makers(comparison)), len(comparison.makers)
    rest = "" if drawn == every else f"; {drawn} of {every} decision makers, the others in comparison.csv"
    return comparison.header() + rest


def draw_rival(comparison: Comparison, folder: Path) -> list[Path]:
    """Draw the worth of one decision to the rival against the expected regret, if there is a rival; return the paths.

    If the rival's problem is the agent's own, a line shows the lower bound from copying.
    """
    if not (comparison.rival and comparison.secret_worth > 0):
        return []
    scale, along_name = _scale(comparison)
    looks, high = looks_of(comparison.makers), PERCENT / comparison.secret_worth
    with drawing(PAGE_WIDTH, _RIVAL_HEIGHT) as (figure, axes):
        for maker in main_makers(comparison):
            rows = comparison.of(maker)
            along = scale * np.array([row.expected_regret for row in rows])
            heights = high * np.array([row.rival_worth for row in rows])
            _curve(axes, along, heights, np.zeros(len(rows)), maker, looks[maker])
        copies = comparison.rival_is_own and comparison.silence_regret > 0
        if copies:
            ends = np.array([0.0, PERCENT])
            axes.plot(
                ends,
                ends[::-1],
                color=BLACK,
                linestyle=":",
                linewidth=1.2,
                label="copying: lower bound, up to sampling",
                zorder=2,
            )
        axes.set_xlim(0.0, None if copies else _right_end(comparison))
        axes.set_ylim(0.0, PERCENT)
        axes.set_xlabel(along_name)
        axes.set_ylabel("worth of reading, % of the secret's")
        figure.legend(loc="outside upper left", ncols=4, columnspacing=1.2, handlelength=2.4)
        return save_figure(figure, folder, "comparison_rival")


def _plot_errors(axes: Any, comparison: Comparison, panel: _Panel) -> None:
    """Draw one observer's error against the expected regret, one curve per decision maker, the prior as ceiling."""
    scale, _ = _scale(comparison)
    looks = looks_of(comparison.makers)
    for maker in main_makers(comparison):
        rows = comparison.of(maker)
        along = scale * np.array([row.expected_regret for row in rows])
        errors, spreads = (np.array([each(row) for row in rows]) for each in (panel.error, panel.spread))
        _curve(axes, along, errors, SIDE * spreads, maker, looks[maker])
    axes.axhline(
        comparison.prior_error, color=BLACK, linestyle="--", linewidth=0.8, zorder=1, label="without decisions"
    )
    if panel.ceilings:
        along = scale * np.array(list(panel.ceilings))
        heights = list(panel.ceilings.values())
        axes.plot(
            along,
            heights,
            color=BLACK,
            linestyle=":",
            linewidth=1.2,
            zorder=2,
            label="upper bound of any rule on the candidates, over time",
        )
    axes.set_title(panel.title, loc="left")
    axes.set_xlim(0.0, _right_end(comparison))


def _right_end(comparison: Comparison) -> float | None:
    """Return the end of the axis of regrets where nothing is spent, as rounding would determine it; otherwise None."""
    rounding = tolerances.NO_REGRET * max(comparison.silence_regret, comparison.mean_cost)
    return 1.0 if max(row.expected_regret for row in comparison.rows) <= rounding else None


def _scale(comparison: Comparison) -> tuple[float, str]:
    if comparison.silence_regret > 0:
        return PERCENT / comparison.silence_regret, "expected regret, % of the silence regret"
    return 1.0, "expected regret, in the cost's unit"


def _curve(axes: Any, along: Array, heights: Array, sides: Array, name: str, look: Look) -> None:
    axes.plot(along, heights, label=spelled(name), clip_on=False, **curve_of(look, "white"))
    if sides.any():
        axes.vlines(along, heights - sides, heights + sides, color=look.colour, linewidth=0.8, alpha=0.7, zorder=2)
