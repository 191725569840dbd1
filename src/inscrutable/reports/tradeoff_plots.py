"""Privacy against the cost budget, and against the number of samples; means with their spread."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.errors import InputError
from inscrutable.reports.names import spelled
from inscrutable.reports.style import GREEN, ORANGE, PURPLE, Look, looks_of

_MIDDLE = (10.0, 90.0)  # percentiles: the middle 80 % of the simulations
_BESIDE = 1.07  # three spreads stand side by side on a logarithmic axis
_SHORT = 16  # letters of a name of which three stand side by side
_KIND_LOOKS = (Look(ORANGE, "o", "-"), Look(PURPLE, "D", "--"), Look(GREEN, "s", "-."))


def plot_tradeoff(axes: Any, budgets: ArrayLike, privacies: Mapping[str, ArrayLike]) -> None:
    """Draw the mean privacy level of every decision maker against its cost budget, with their spread.

    Args:
        axes: A Matplotlib axis.
        budgets: c_b, shares of |c*| above 0, shape (B,), rising.
        privacies: Ψ by simulation and budget, shape (n_simulations, B), by decision maker.

    Raises:
        InputError: Shapes disagree.
    """
    along = validation.finite_array(budgets, "budgets", ndim=1)
    looks = looks_of(privacies)
    for name, values in privacies.items():
        runs, look = _checked(along, values, name), looks[name]
        low, high = np.percentile(runs, _MIDDLE, axis=0)
        axes.fill_between(along, low, high, color=look.colour, alpha=0.13, linewidth=0)
        _line(axes, along, runs.mean(axis=0), name, look)
    axes.set_xlabel("cost budget $c_b$, share of $|c^*|$")
    axes.set_ylabel("privacy level, mean")
    _finish(axes, along, next(iter(privacies.values()), None))


def plot_convergence(axes: Any, sizes: ArrayLike, values: Mapping[str, ArrayLike]) -> None:
    """Draw the PDM's mean expected privacy against the number of samples M, for up to three kinds of candidates.

    Args:
        axes: A Matplotlib axis.
        sizes: M, shape (K,), rising.
        values: Expected privacy by simulation and M, shape (n_simulations, K), by kind of candidates.

    Raises:
        InputError: Shapes disagree.
    """
    along = validation.finite_array(sizes, "sizes", ndim=1)
    for place, ((name, each), look) in enumerate(zip(values.items(), _KIND_LOOKS, strict=False)):
        runs, beside = _checked(along, each, name), along * _BESIDE ** (place - 1)
        low, high = np.percentile(runs, _MIDDLE, axis=0)
        axes.vlines(beside, low, high, color=look.colour, linewidth=0.9, alpha=0.7)
        _line(axes, beside, runs.mean(axis=0), name, look)
    axes.set_xlabel("number of samples M")
    axes.set_ylabel("privacy of the probabilistic (PDM), mean")
    _finish(axes, along, next(iter(values.values()), None))


def _checked(along: np.ndarray, values: ArrayLike, name: str) -> np.ndarray:
    runs = validation.finite_array(values, f"values of {name}", ndim=2)
    if runs.shape[1] != along.size:
        raise InputError(f"values of {name} have {runs.shape[1]} columns, expected {along.size}")
    return runs


def _line(axes: Any, along: np.ndarray, heights: np.ndarray, name: str, look: Look) -> None:
    hollow = {} if look.marker == "x" else {"markerfacecolor": "white"}
    order = 4.0 if look.marker == "x" else 3.0  # a cross stays visible on a ring
    axes.plot(
        along, heights, look.line, color=look.colour, marker=look.marker, label=spelled(name), zorder=order, **hollow
    )


def _finish(axes: Any, along: np.ndarray, some: ArrayLike | None) -> None:
    axes.set_xscale("log")
    axes.set_xticks(along, [f"{value:g}" for value in along])
    axes.minorticks_off()
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    count = 0 if some is None else len(np.asarray(some))
    names = axes.get_legend_handles_labels()[1]
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(-0.02, 1.0),
        ncols=3 if max(map(len, names), default=0) <= _SHORT else 2,
        columnspacing=1.0,
        handletextpad=0.4,
        title=f"mean of {count} simulations, spread: middle 80 %",
        title_fontsize=7,
        alignment="left",
    )
