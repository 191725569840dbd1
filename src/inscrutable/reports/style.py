"""The style of every picture: the paper's markers, a colour-blind-safe palette, and atomic saving."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from inscrutable.files import whole_file
from inscrutable.validation import Array


class Look(NamedTuple):
    """The look of one decision maker."""

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
    "SDM": Look(PURPLE, "P", "-"),
    "sequential": Look(PURPLE, "P", "-"),
    "rate-distortion": Look("#332288", "s", "-"),
    "Stackelberg": Look(BLACK, "D", "-"),
}
MARKERS = ("o", "s", "D", "v", "^", "p", "d", "*", "x", "+")
_VARIANTS = {"^": "v", "x": "+", "o": "s", "s": "p", "D": "d", "P": "X"}
REGIME_COLOURS = ("#56B4E9", "#E69F00", "#882255", "#117733", "#332288", "#999933", "#AA4499", "#44AA99")

_OTHERS = (
    Look(GREY, "D", ":"),
    Look(PURPLE, "s", "-."),
    Look("#56B4E9", "v", "--"),
    Look("#E69F00", "P", ":"),
    Look("#882255", "X", "-."),
    Look("#117733", "<", "--"),
    Look("#44AA99", "*", ":"),
)
"""Looks for other names, in order of appearance."""

CROSSES = "x+"
_NAME_WIDTH = 24
COLUMN_WIDTH = 3.5
"""Inches of one column of a two-column page."""
PAGE_WIDTH = 7.0
"""Inches of a page\'s text."""
PERCENT = 100.0


def curve_of(look: Look, inside: str) -> dict[str, Any]:
    """Return keywords of a curve whose marks are filled with a colour; a cross has no filling, and lies above other marks."""
    is_cross = look.marker in CROSSES
    filled = {} if is_cross else {"markerfacecolor": inside}
    return {
        "linestyle": look.line,
        "color": look.colour,
        "marker": look.marker,
        "zorder": 4 if is_cross else 3,
        **filled,
    }


def look_of(name: str) -> Look:
    """Return the look of a decision maker; a variant such as "CDM local" has its family's colour."""
    for family, look in LOOKS.items():
        if name == family:
            return look
        if name.startswith(family):
            return Look(look.colour, _VARIANTS[look.marker], "--")
    return _OTHERS[0]


def looks_of(names: Iterable[str]) -> dict[str, Look]:
    """Return a look for every name, all different; variants keep the colour of their decision maker."""
    looks, strangers, taken = dict[str, Look](), 0, set[tuple[str, str]]()
    for name in names:
        look = look_of(name)
        if look is _OTHERS[0]:
            look = _OTHERS[strangers % len(_OTHERS)]
            strangers += 1
        free = (marker for marker in (look.marker, *MARKERS) if (look.colour, marker) not in taken)
        looks[name] = look._replace(marker=next(free, look.marker))
        taken.add((look.colour, looks[name].marker))
    return looks


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
    import matplotlib

    # Layout and bounding box are computed once, at the resolution of the PNG, for both files.
    if matplotlib.rcParams["savefig.dpi"] != "figure":
        figure.set_dpi(matplotlib.rcParams["savefig.dpi"])
    figure.draw_without_rendering()
    outline = figure.get_tightbbox().padded(matplotlib.rcParams["savefig.pad_inches"])
    written = []
    # Without a layout engine, not even the placeholder that the name "none" leaves, nothing is drawn twice.
    with matplotlib.rc_context({"figure.constrained_layout.use": False}):
        figure.set_layout_engine(None)
        for ending, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
            path = folder / f"{name}.{ending}"
            with whole_file(path) as temporary:
                figure.savefig(temporary, format=ending, metadata=metadata, bbox_inches=outline)
            written.append(path)
    return written


def around(corners: Array) -> Array:
    """Return the corners (V,X) of a convex polygon on the belief simplex in their order around its centre."""
    # A plane polygon keeps its order in any two coordinates that separate its corners.
    across, along = np.linalg.svd(corners - corners.mean(axis=0))[2][:2] @ (corners - corners.mean(axis=0)).T
    return corners[np.argsort(np.arctan2(along, across))]


def as_written(name: str) -> str:
    """Return a user's name for a picture: escaped as plain text, shown in legends, wrapped if long.

    Example:
        >>> as_written("US$ and C$")
        'US\\\\$ and C\\\\$'
    """
    lines = "\n".join(wrap(name, _NAME_WIDTH)) or name
    # Matplotlib leaves labels that begin with an underscore out of legends; one of no width before it helps.
    return ("\u200b" if lines.startswith("_") else "") + lines.replace("$", r"\$")


def ternary_labels(axes: Any, names: tuple[str, ...]) -> None:
    """Label the corners of a ternary axis with the names of the three states, and thin its ticks."""
    axes.set_tlabel(as_written(names[0]))
    axes.set_llabel(as_written(names[1]))
    axes.set_rlabel(as_written(names[2]))
    for axis in (axes.taxis, axes.laxis, axes.raxis):
        axis.set_label_position("corner")
        axis.labelpad = 8.0  # clear of marks on the corners
        axis.set_ticks(np.linspace(0.2, 0.8, 4))
    axes.grid(True, linewidth=0.3, color="#cccccc")
