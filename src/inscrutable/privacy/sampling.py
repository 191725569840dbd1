"""Averages of sampled figures, with control variates."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.validation import Array


def adjusted_means(values: Array, controls: Array) -> tuple[Array, Array]:
    """Return the means (k,) of sampled values (n,k) and their standard errors, with controls (n,c) whose mean is zero.

    Source: control variates; slopes of one half serve the other: fitted to the sample they adjust, they would bias its mean.
    """
    adjusted = np.array(values)
    for own, other in ((slice(0, None, 2), slice(1, None, 2)), (slice(1, None, 2), slice(0, None, 2))):
        centred = controls[other] - controls[other].mean(axis=0)
        slopes = np.linalg.pinv(centred, rcond=tolerances.RANK) @ (values[other] - values[other].mean(axis=0))
        adjusted[own] -= controls[own] @ slopes
    spread = adjusted.std(axis=0, ddof=1)
    return np.asarray(adjusted.mean(axis=0)), np.asarray(spread / np.sqrt(len(values)))
