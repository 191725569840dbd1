"""One look for every picture: the paper's markers, colours that colour-blind readers can tell apart, saved whole."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from inscrutable.errors import InputError


class Look(NamedTuple):
    """How one decision maker is drawn."""

    colour: str
    marker: str
    line: str


# Okabe and Ito's palette, "Color universal design" (2008); ODM green triangle, CDM blue cross, PDM orange dot as in
# the paper. A second CDM or PDM keeps its family's colour with another marker and line.
GREEN, BLUE, ORANGE, PURPLE, BLACK, GREY = "#009E73", "#0072B2", "#D55E00", "#CC79A7", "#000000", "#767676"
LOOKS = {
    "ODM": Look(GREEN, "^", "-"),
    "CDM": Look(BLUE, "x", "-"),
    "PDM": Look(ORANGE, "o", "-"),
}
REGIME_COLOURS = ("#56B4E9", "#E69F00", "#882255", "#117733", "#332288", "#999933", "#AA4499", "#44AA99")

COLUMN_WIDTH = 3.5
"""Inches of one column of a two-column page."""


def look_of(name: str) -> Look:
    """Return how a decision maker is drawn; a variant such as "CDM local" takes its family's colour."""
    for family, look in LOOKS.items():
        if name == family:
            return look
        if name.startswith(family):
            return Look(look.colour, {"^": "v", "x": "+", "o": "s"}[look.marker], "--")
    return Look(GREY, "D", ":")


@contextmanager
def drawing(width: float = COLUMN_WIDTH, height: float | None = None, **subplots: Any) -> Iterator[tuple[Any, Any]]:
    """Yield (figure, axes) in the house style; the figure is closed afterwards."""
    import matplotlib

    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt
    import mpltern  # noqa: F401  (registers the ternary projection)

    with plt.rc_context(
        {
            "font.size": 8,
            "axes.labelsize": 8,
            "axes.titlesize": 8,
            "legend.fontsize": 7,
            "xtick.labelsize": 7,
            "ytick.labelsize": 7,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "lines.linewidth": 1.1,
            "lines.markersize": 4,
            "legend.frameon": False,
            "figure.constrained_layout.use": True,
            "savefig.bbox": "tight",
            "savefig.dpi": 200,
            "svg.hashsalt": "inscrutable",
        }
    ):
        figure, axes = plt.subplots(figsize=(width, height or 0.72 * width), **subplots)
        try:
            yield figure, axes
        finally:
            plt.close(figure)


def save_figure(figure: Any, folder: Path, name: str) -> list[Path]:
    """Write `name`.png and `name`.svg into a folder, whole or not at all, and return their paths."""
    written = []
    for ending, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
        path = folder / f"{name}.{ending}"
        partial = folder / f".{name}.{ending}.partial"
        try:
            figure.savefig(partial, format=ending, metadata=metadata)
            os.replace(partial, path)
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror or error}") from None
        written.append(path)
    return written


def ternary_labels(axes: Any, names: tuple[str, ...]) -> None:
    """Label the corners of a ternary axis with the names of the three states, and thin its ticks."""
    axes.set_tlabel(names[0])
    axes.set_llabel(names[1])
    axes.set_rlabel(names[2])
    for axis in (axes.taxis, axes.laxis, axes.raxis):
        axis.set_label_position("corner")
        axis.set_ticks(np.linspace(0.2, 0.8, 4))
    axes.grid(True, linewidth=0.3, color="#cccccc")
