"""Growth of time and memory in the steps T, the candidates M, the assets U and the states X: a process for each point."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.point import Measured, Point, measured_apart
from benchmarks.table import Quality, Row, Target, bytes_text, seconds_text, times_text

TITLE = "Growth: time, and memory above the start without the result"
LINEAR = 1.5  # times as long per step at the largest T as at the smallest
MEGABYTES = 300.0
SPENT = 1e-9  # by which rounding may carry a regret above the budget, relative


@dataclass(frozen=True)
class Sizes:
    """The points: T at M = 5,151; resolutions of the decoys, U and X at a few hundred steps.

    A point that takes more than `patience` seconds is given up with those behind it, which misses the target.
    """

    steps: tuple[int, ...] = (1_000, 10_000, 100_000)
    resolutions: tuple[int, ...] = (30, 100, 300, 1000)
    assets: tuple[int, ...] = (3, 10, 30, 100)
    states: tuple[int, ...] = (2, 3, 4, 5, 6, 8)
    few_steps: int = 500
    patience: float = 300.0


FULL = Sizes()
QUICK = Sizes(steps=(4, 8), resolutions=(4,), assets=(), states=(), few_steps=10)

CURVES = {
    "steps": "T, steps",
    "candidates": "M, candidates",
    "assets": "U, assets",
    "states": "X, states",
}
"""What each curve grows in, and how its axis is called."""


def rows(sizes: Sizes) -> Iterator[Row]:
    """One row for each point; the last of each curve in T says whether time is linear and memory flat."""
    coarse = sizes.resolutions[min(1, len(sizes.resolutions) - 1)]
    for maker in ("PDM", "CDM"):
        points = [Point(steps, coarse, maker=maker) for steps in sizes.steps]
        yield from _in_steps(points, sizes.patience)
    curves: dict[str, list[Point]] = {
        "candidates": [Point(sizes.few_steps, resolution) for resolution in sizes.resolutions],
        "assets": [Point(sizes.few_steps, coarse, assets=assets) for assets in sizes.assets],
        "states": [Point(sizes.few_steps, 0, assets=10, states=states) for states in sizes.states],
    }
    for curve, points in curves.items():
        for point in points:
            found = measured_apart(point, sizes.patience)
            if found is None:
                yield _given_up(curve, point, sizes.patience)
                break
            value = found.candidates if curve == "candidates" else getattr(point, curve)
            yield _row(curve, value, point, found)


def _in_steps(points: Sequence[Point], patience: float) -> Iterator[Row]:
    text = f"≤ {LINEAR:g}× the time per step of T={points[0].steps:,}; ≤ {MEGABYTES:g} MB"
    first: Measured | None = None
    for point in points:
        found = measured_apart(point, patience)
        if found is None:
            yield _given_up("steps", point, patience, Target(text, False))
            return
        first = first or found
        growth = (found.decided_seconds / point.steps) / (first.decided_seconds / points[0].steps)
        used = found.working_bytes / 2**20
        is_last = point is points[-1]
        target = Target(text, growth <= LINEAR and used <= MEGABYTES) if is_last else Target()
        yield _row("steps", point.steps, point, found, target, times_text(growth))


def _given_up(curve: str, point: Point, patience: float, target: Target | None = None) -> Row:
    size = f"T={point.steps:,}, U={point.assets}, X={point.states}"
    return Row(_what(curve, point), size, f"given up after {patience:g} s", target=target or Target())


def _row(curve: str, value: int, point: Point, found: Measured, target: Target | None = None, ratio: str = "") -> Row:
    size = f"T={point.steps:,}, M={found.candidates:,}, U={point.assets}, X={point.states}"
    each = seconds_text(found.decided_seconds / point.steps)
    prepared = "" if curve == "steps" else f"; candidates {seconds_text(found.prepared_seconds)}"
    text = (
        f"working memory {bytes_text(found.working_bytes)}, result {bytes_text(found.result_bytes)}; "
        f"budget exceeded by {max(found.overspent, 0.0):.0e}"
    )
    return Row(
        _what(curve, point),
        size,
        f"{seconds_text(found.decided_seconds)} ({each} a step){prepared}",
        ratio=ratio,
        quality=Quality(text, found.overspent <= SPENT),
        target=target or Target(),
        numbers={
            "is_lottery": float(point.maker == "PDM"),
            curve: float(value),
            "seconds": found.decided_seconds,
            "prepared_seconds": found.prepared_seconds,
            "working_bytes": found.working_bytes,
            "result_bytes": found.result_bytes,
        },
    )


def _what(curve: str, point: Point) -> str:
    return f"{point.maker} decide_many, growth in {CURVES[curve].split(',')[0]}"


def slope(xs: Sequence[float], ys: Sequence[float]) -> float:
    """The exponent p of the power law y ∝ x^p through positive points, by least squares in the logarithms."""
    return float(np.polyfit(np.log(xs), np.log(ys), 1)[0])
