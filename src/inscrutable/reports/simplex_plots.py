"""Triangles: decisions over three assets and beliefs over three regimes, each decision maker with its own marker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.decision_makers import MixedDecision
from inscrutable.errors import InputError
from inscrutable.geometry import BeliefSet
from inscrutable.reports.names import spelled
from inscrutable.reports.style import BLACK, LOOKS, Look, around, looks_of, ternary_labels

_CORNERS = 3
_BAR_HEIGHT = 0.35  # height of a bar of probability one; the triangle has height 1
_LEAST_BAR = 0.005  # a smaller probability is written 0.00
_DASH = 4.0  # points
_LEGEND = {
    "loc": "upper center",
    "bbox_to_anchor": (0.5, -0.2),
    "ncols": 2,
    "handletextpad": 0.4,
    "columnspacing": 1.0,
    "borderaxespad": 0.0,
}
"""Below the triangle: the names are long."""


def plot_actions(
    axes: Any,
    actions: Mapping[str, ArrayLike],
    names: Sequence[str],
    *,
    candidates: ArrayLike | None = None,
    lottery: MixedDecision | None = None,
) -> None:
    """Draw one decision per decision maker on the triangle of three assets.

    Args:
        axes: A ternary axis, as from `drawing(subplot_kw={"projection": "ternary"})`.
        actions: Decisions (3,) by decision maker, in the order of the legend.
        names: The three assets, from the top corner anticlockwise.
        candidates: The set {ū^(l)}, shape (M,3), drawn as small circles.
        lottery: A lottery of the PDM: one bar per decision, with its probability as height.

    Raises:
        InputError: A decision does not have three coordinates.
    """
    ternary_labels(axes, (names[0], names[1], names[2]))
    orange = LOOKS["PDM"].colour
    if candidates is not None:
        points = _triples(candidates, "candidates")
        size = 3.0 if len(points) < 1500 else 1.0
        label = f"candidates ({len(points)})"
        axes.scatter(*points.T, s=size, facecolors="none", edgecolors=orange, linewidths=0.3, alpha=0.6, label=label)
    if lottery is not None:
        _bars(axes, lottery, orange)
    for (name, action), look in zip(actions.items(), looks_of(actions).values(), strict=True):
        _mark(axes, _triples(action, f"action of {name}"), name, look)
    axes.legend(**_LEGEND)


def plot_beliefs(axes: Any, belief: ArrayLike, seen: Mapping[str, BeliefSet], names: Sequence[str]) -> None:
    """Draw the private belief, the naive observer's set for each decision, and the distances as dashed lines.

    Args:
        axes: A ternary axis.
        belief: π, shape (3,).
        seen: Π(u) by decision maker, in the order of the legend: a point, a segment, an area, or empty.
        names: The three regimes, from the top corner anticlockwise.

    Raises:
        InputError: The belief is not over three regimes.
    """
    ternary_labels(axes, (names[0], names[1], names[2]))
    held = _triples(validation.beliefs(belief, _CORNERS), "belief")
    looks = looks_of(seen)
    for number, (name, found) in enumerate(seen.items()):
        look = looks[name]
        if found.is_empty:
            axes.plot(
                [], [], [], linestyle="none", marker=look.marker, color=look.colour, label=f"{spelled(name)}: no belief"
            )
            continue
        nearest = np.atleast_2d(found.nearest(held[0]))
        if found.distance(held[0]) > 0:
            # Shifted dashes: two lines to the same point stay visible.
            dashes = (_DASH * number, (_DASH, _DASH))
            axes.plot(*np.vstack([held, nearest]).T, color=look.colour, linestyle=dashes, linewidth=1.0)
        if found.dimension > 0:
            _extent(axes, found, look.colour)
        _mark(axes, nearest, name, look)
    axes.plot(*held.T, linestyle="none", marker="*", markersize=5, color=BLACK, label="private belief", zorder=6)
    axes.legend(**_LEGEND)


def _mark(axes: Any, point: np.ndarray, name: str, look: Look) -> None:
    hollow = {"markerfacecolor": "none"} if look.marker in "^ov" else {}
    axes.plot(
        *point.T,
        linestyle="none",
        marker=look.marker,
        color=look.colour,
        markersize=8,
        markeredgewidth=1.4,
        label=spelled(name),
        zorder=5,
        clip_on=False,
        **hollow,
    )


def _bars(axes: Any, lottery: MixedDecision, colour: str) -> None:
    upward = np.array([1.0, -0.5, -0.5])
    shown = [atom for atom, share in enumerate(lottery.probabilities) if share >= _LEAST_BAR]
    across = {atom: lottery.actions[atom, 2] - lottery.actions[atom, 1] for atom in shown}
    shown.sort(key=across.__getitem__)
    # The numbers are in the legend, from left to right: beside the bars they would overlap.
    label = f"p = {', '.join(f'{lottery.probabilities[atom]:.2f}' for atom in shown)}"
    for atom in shown:
        ends = lottery.actions[atom] + np.outer([0.0, _BAR_HEIGHT * lottery.probabilities[atom]], upward)
        bar = {"color": colour, "linewidth": 3.0, "alpha": 0.45, "solid_capstyle": "butt"}
        axes.plot(*ends.T, clip_on=False, zorder=4, label=label if atom == shown[0] else None, **bar)


def _extent(axes: Any, found: BeliefSet, colour: str) -> None:
    corners = found.vertices()
    if found.dimension == 1:
        axes.plot(*corners.T, color=colour, linewidth=2.2, alpha=0.5, solid_capstyle="round")
        return
    axes.fill(*around(corners).T, facecolor=colour, edgecolor=colour, alpha=0.2, linewidth=1.0)


def _triples(values: ArrayLike, name: str) -> np.ndarray:
    points = np.atleast_2d(validation.finite_array(values, name, ndim=(1, 2)))
    if points.shape[1] != _CORNERS:
        raise InputError(f"{name} has {points.shape[1]} coordinates; a triangle needs {_CORNERS}")
    return points
