"""Starting points for Baum-Welch: three ways in which regimes can differ, taken in turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inscrutable.validation import Array

Assignment = NDArray[np.int64]

START_SHARE = 0.9
"""Weight of the guessed state in a starting point; the rest is spread evenly, so no state starts without data."""


def starting_responsibilities(rows: Array, n_states: int, kind: int, rng: np.random.Generator) -> Array:
    """Guess the state of each row of standardised data; `kind` counts restarts, the guesses (T,X) cycle through three.

    Regimes of markets differ mostly in volatility, those of other sensors in level, and both last for a while.
    """
    guess = (_by_volatility, _by_level, _by_period)[kind % 3]
    labels = guess(rows, n_states, rng)
    return START_SHARE * np.eye(n_states)[labels] + (1.0 - START_SHARE) / n_states


def _by_volatility(rows: Array, n_states: int, rng: np.random.Generator) -> Assignment:
    """Cut a moving mean of the squared norm at random quantiles."""
    n_steps = len(rows)
    window = int(rng.integers(1, max(2, n_steps // (10 * n_states)) + 1))
    power = np.convolve((rows**2).sum(axis=1), np.ones(window) / window, mode="same")
    shares = np.cumsum(rng.dirichlet(np.full(n_states, 5.0)))[:-1]
    return np.asarray(np.searchsorted(np.quantile(power, shares), power), dtype=np.int64)


def _by_level(rows: Array, n_states: int, rng: np.random.Generator) -> Assignment:
    """Assign each row to the nearest of centres drawn far apart (k-means++), moved by a few steps of k-means."""
    centres = rows[[int(rng.integers(len(rows)))]]
    while len(centres) < n_states:
        nearest = _square_distances(rows, centres).min(axis=1)
        centres = np.vstack([centres, rows[int(rng.choice(len(rows), p=nearest / nearest.sum()))]])
    for _ in range(3):
        labels = _square_distances(rows, centres).argmin(axis=1)
        for state in np.unique(labels):
            centres[state] = rows[labels == state].mean(axis=0)
    return np.asarray(_square_distances(rows, centres).argmin(axis=1), dtype=np.int64)


def _by_period(rows: Array, n_states: int, rng: np.random.Generator) -> Assignment:
    """Cut time into periods, a few for each state, and deal the states out to them."""
    n_periods = min(len(rows), n_states * int(rng.integers(1, 5)))
    dealt = rng.permutation(np.arange(n_periods) % n_states)
    cuts = np.sort(rng.choice(np.arange(1, len(rows)), size=n_periods - 1, replace=False))
    return np.asarray(dealt[np.searchsorted(cuts, np.arange(len(rows)), side="right")], dtype=np.int64)


def _square_distances(rows: Array, centres: Array) -> Array:
    return np.asarray(((rows[:, None, :] - centres[None, :, :]) ** 2).sum(axis=-1))
