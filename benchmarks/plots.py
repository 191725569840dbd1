"""Pictures of growth: seconds against T, M, U and X, and memory against T, on logarithmic axes."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, floor, log10
from pathlib import Path
from typing import Any

from benchmarks.growth import CURVES, slope
from benchmarks.table import Row
from inscrutable.reports.names import spelled
from inscrutable.reports.style import drawing, look_of

MOST_TICKS = 6
LEAST_SECONDS, LEAST_MEGABYTES = 1e-6, 0.1  # what is smaller is drawn there: a logarithm needs something
WHOLE_MARK = 1.3  # room above and below a mark, as a factor
WIDTH, HEIGHT = 3.5, 2.6  # inches: one column of a page, at which the letters are eight points


def draw_growth(rows: Sequence[Row], folder: Path) -> list[str]:
    """Write one picture for each curve that has at least two points; returns their names."""
    names = []
    for curve in CURVES:
        points = [row.numbers for row in rows if curve in row.numbers]
        if len(points) < 2:
            continue
        names.append(f"growth_{curve}.png")
        with drawing(WIDTH, HEIGHT) as (figure, axes):
            _seconds(axes, points, curve)
            figure.savefig(folder / names[-1])
    steps = [row.numbers for row in rows if "steps" in row.numbers]
    if len(steps) >= 2:
        names.append("growth_memory.png")
        with drawing(WIDTH, HEIGHT) as (figure, axes):
            _memory(axes, steps)
            figure.savefig(folder / names[-1])
    return names


def _lines(points: Sequence[dict[str, float]], curve: str, key: str) -> list[tuple[str, list[float], list[float]]]:
    lines = []
    for maker in ("PDM", "CDM"):
        own = sorted((p[curve], p[key]) for p in points if bool(p["is_lottery"]) == (maker == "PDM"))
        if len(own) >= 2:
            lines.append((maker, [x for x, _ in own], [max(y, LEAST_SECONDS) for _, y in own]))
    return lines


def _seconds(axes: Any, points: Sequence[dict[str, float]], curve: str) -> None:
    for maker, xs, ys in _lines(points, curve, "seconds"):
        look = look_of(maker)
        label = f"{spelled(maker)}, slope {slope(xs, ys):.2f}"
        axes.loglog(xs, ys, marker=look.marker, color=look.colour, linestyle=look.line, label=label)
    if curve != "steps":
        for _, xs, ys in _lines(points, curve, "prepared_seconds"):
            look = look_of("candidates")
            axes.loglog(xs, ys, marker=look.marker, color=look.colour, linestyle=look.line, label="candidates, once")
    _finish(axes, curve, "seconds", sorted({point[curve] for point in points}))


def _memory(axes: Any, points: Sequence[dict[str, float]]) -> None:
    for maker, xs, ys in _lines(points, "steps", "working_bytes"):
        look = look_of(maker)
        megabytes = [max(y / 2**20, LEAST_MEGABYTES) for y in ys]
        axes.loglog(
            xs, megabytes, marker=look.marker, color=look.colour, linestyle="-", label=f"{spelled(maker)}, working"
        )
    for maker, xs, ys in _lines(points, "steps", "result_bytes"):
        look = look_of(maker)
        megabytes = [max(y / 2**20, LEAST_MEGABYTES) for y in ys]
        axes.loglog(
            xs, megabytes, marker=look.marker, color=look.colour, linestyle=":", label=f"{spelled(maker)}, result"
        )
    _finish(axes, "steps", "MB above the start", sorted({point["steps"] for point in points}))


def _finish(axes: Any, curve: str, vertical: str, ticks: Sequence[float]) -> None:
    axes.set_xlabel(CURVES[curve])
    axes.set_ylabel(vertical)
    if len(ticks) <= MOST_TICKS:
        axes.set_xticks(ticks, [f"{tick:,.0f}" for tick in ticks])
        axes.set_xticks([], minor=True)
    # Whole decades: a scale without a labelled tick cannot be read.
    low, high = axes.dataLim.intervaly
    lowest = floor(log10(low / WHOLE_MARK))
    axes.set_ylim(10.0**lowest, 10.0 ** max(ceil(log10(high * WHOLE_MARK)), lowest + 1))
    axes.grid(True, which="major", linewidth=0.3)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
