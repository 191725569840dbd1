"""Plots of the profile likelihood of a sensor's parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable import validation
from inscrutable.adversaries import CalibratedSensor
from inscrutable.errors import InputError
from inscrutable.reports.style import Look

_DEEPEST = 8.0
"""Depth below the maximum to which a profile is drawn; lower values are implausible."""

_PLAUSIBLE = -1.92
"""Half the 95 % quantile of χ² with one degree of freedom."""


def plot_profile(axes: Any, calibrated: CalibratedSensor, look: Look, *, parameter: int = 0, label: str = "") -> None:
    """Draw the profile log-likelihood of one parameter relative to its maximum, with the 95 % interval.

    Args:
        axes: A Matplotlib axis.
        calibrated: From `calibrate_sensor`.
        look: Colour, mark and line, such as one of `style.looks_of`.
        parameter: Index of the parameter, from 0.
        label: Label of the line in a legend.

    Raises:
        InputError: There is no such parameter.
    """
    number = validation.count(parameter, "parameter", least=0)
    if number >= len(calibrated.names):
        raise InputError(f"parameter must be below {len(calibrated.names)}, got {number}")
    falls = calibrated.log_likelihoods[number] - calibrated.log_likelihoods[number].max()
    some = np.isfinite(falls)
    axes.plot(calibrated.grid[number][some], falls[some], color=look.colour, linestyle=look.line, label=label or None)
    low, high = calibrated.intervals[number]
    axes.hlines(_PLAUSIBLE, low, high, color=look.colour, linewidth=2.5, alpha=0.6)
    axes.plot(calibrated.parameters[number], 0.0, look.marker, color=look.colour, markersize=5)
    axes.set_ylim(-_DEEPEST, 0.6)
    axes.set_xlabel(calibrated.names[number])
    axes.set_ylabel("log-likelihood, below its maximum")
