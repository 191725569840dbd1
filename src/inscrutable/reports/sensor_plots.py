"""The profile of a sensor's likelihood: the parameters that decisions leave plausible."""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable import validation
from inscrutable.adversaries import CalibratedSensor
from inscrutable.errors import InputError
from inscrutable.reports.style import Look

_DEEPEST = 8.0
"""How far below the maximum a profile is drawn; what lies deeper is as good as ruled out."""

_PLAUSIBLE = -1.92
"""Half the 95 % quantile of χ² with one degree of freedom."""


def plot_profile(axes: Any, calibrated: CalibratedSensor, look: Look, *, parameter: int = 0, label: str = "") -> None:
    """Draw by how much the log-likelihood falls as one parameter leaves its best value, with the 95 % interval.

    Args:
        axes: A Matplotlib axis.
        calibrated: From `calibrate_sensor`.
        look: Colour, mark and line, such as one of `style.looks_of`.
        parameter: Which one, counted from 0.
        label: Of the line in a legend.

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
