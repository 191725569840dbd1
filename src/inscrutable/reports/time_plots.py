"""Privacy and cost over time, one line per decision maker."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable.reports.names import spelled
from inscrutable.reports.style import BLACK, curve_of, looks_of


def plot_privacy(axes: Any, privacies: Mapping[str, ArrayLike], *, steps: ArrayLike | None = None) -> None:
    """Draw the privacy level of every decision maker over time.

    Args:
        axes: A Matplotlib axis.
        privacies: Ψ at every step, shape (T,), by decision maker.
        steps: What to write along the time axis, shape (T,); None counts from 0.
    """
    _lines(axes, privacies, steps)
    axes.set_ylabel(r"privacy level $\Psi(\bar{u}_k)$")
    _finish(axes)


def plot_costs(
    axes: Any, increases: Mapping[str, ArrayLike], *, budget: float | None = None, steps: ArrayLike | None = None
) -> None:
    """Draw the normalised cost increase of every decision maker over time.

    Args:
        axes: A Matplotlib axis.
        increases: (c̄ − c*)/|c*| at every step, shape (T,), by decision maker.
        budget: c_b, drawn as a horizontal line; None draws none.
        steps: What to write along the time axis, shape (T,); None counts from 0.
    """
    _lines(axes, increases, steps)
    if budget is not None:
        axes.axhline(budget, color=BLACK, linestyle=":", linewidth=0.9, label="cost budget $c_b$", zorder=1)
    axes.set_ylabel("normalised cost increase\n" r"$(\bar{c}_k - c^*_k)\,/\,|c^*_k|$")
    _finish(axes)


def _lines(axes: Any, series: Mapping[str, ArrayLike], steps: ArrayLike | None) -> None:
    from matplotlib.ticker import MaxNLocator

    looks = looks_of(series)
    for name, values in series.items():
        look = looks[name]
        heights = np.asarray(values, dtype=float)
        along = np.arange(len(heights)) if steps is None else np.asarray(steps)
        mean = f"{spelled(name)}, mean {np.mean(heights):.3f}"
        axes.plot(along, heights, linewidth=0.8, label=mean, **curve_of(look, "none"))
    locator = axes.xaxis.get_major_locator()
    if isinstance(locator, MaxNLocator) and (steps is None or np.asarray(steps).dtype.kind in "iu"):
        locator.set_params(integer=True)


def _finish(axes: Any) -> None:
    axes.set_xlabel("timestep k")
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(-0.05, 1.0),
        handletextpad=0.4,
        borderaxespad=0.2,
    )
