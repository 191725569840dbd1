"""Weights of a simulated path under which the mean of its beliefs is exact.

The long-run mean of a filter's beliefs is a stationary law of the states: E[π_t − P'π_t] = 0. The mean of a path has the
error of the time spent in each state, which is large where states last long. The closed path is cut into cycles that begin at
its commonest place. With a weight for each cycle every place is still entered as often as it is left. Weights exp(λ·g_c) with
Σ_c g_c exp(λ·g_c) = 0, g_c the sum of π_t − P'π_t over a cycle, are the nearest to equal ones, in Kullback-Leibler divergence,
that make the mean exact (exponential tilting).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import root

from inscrutable import tolerances
from inscrutable.validation import Array


def balanced_weights(places: np.ndarray, beliefs: Array, transition: Array) -> Array:
    """Return a weight per step, (T,), with mean one, for a path of beliefs (T,X) at places (T,), counted from 0.

    All are one where no weights make the mean exact, as where the path never visits a state that the chain does.
    """
    starts = places == np.bincount(places).argmax()
    cycles = (np.cumsum(starts) - 1) % int(starts.sum())  # the steps before the first start belong to the last cycle
    drifts = np.array([np.bincount(cycles, weights=each) for each in (beliefs - beliefs @ transition).T]).T
    weights = _tilted(drifts)[cycles]
    return np.asarray(weights / weights.mean())


def _tilted(drifts: Any) -> Array:
    """Weights exp(λ·g) of the rows g (C,X) with Σ g exp(λ·g) = 0; ones where there are none."""
    equal = np.ones(len(drifts))
    left, sizes, _ = np.linalg.svd(drifts, full_matrices=False)
    rows = left[:, sizes > tolerances.NO_DRIFT] * np.sqrt(len(drifts))  # of size one in every direction
    if not rows.shape[1]:
        return equal

    def shares(prices: Array) -> Array:
        powers = rows @ prices
        raised = np.exp(powers - powers.max())
        return np.asarray(raised / raised.sum())

    def slopes(prices: Array) -> Array:
        weighted = rows * shares(prices)[:, None]
        return np.asarray(weighted.T @ rows - np.outer(weighted.sum(axis=0), weighted.sum(axis=0)))

    solve: Any = root
    found = solve(lambda prices: shares(prices) @ rows, np.zeros(rows.shape[1]), jac=slopes, method="lm").x
    return shares(found) if np.abs(shares(found) @ rows).max() <= tolerances.BALANCED else equal
