"""Learning forward in time: every block is predicted by learners fitted to the rows before it, minus an embargo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from inscrutable.adversaries.learners import Learner
from inscrutable.validation import Array

N_BLOCKS = 10
FIRST_JUDGED = 4
"""Block 0 is for learning only, blocks 1 to 3 choose a learner; the other 60 % of the rows are the test rows of the claim."""


@dataclass(frozen=True, eq=False)
class Forward:
    """The predictions of every learner for every block, for the true targets and for shifted ones.

    `squares` and `guesses` are sums over a block's rows; `predictions` are for the true targets.
    """

    bounds: tuple[tuple[int, int], ...]  # first row of each predicted block, and the row after the last
    names: tuple[str, ...]
    squares: Array  # (L, S, B)
    guess_squares: Array  # (S, B), of the mean of the training rows
    predictions: Array  # (L, n, C)
    guesses: Array  # (n, C)

    @property
    def judged_from(self) -> int:
        """The first block that counts for a claim."""
        return FIRST_JUDGED - 1

    @property
    def first(self) -> int:
        """The first predicted row."""
        return self.bounds[0][0]

    @property
    def n_before(self) -> int:
        """The number of predicted rows before the first judged block."""
        return self.bounds[self.judged_from][0] - self.first

    def block_of(self) -> np.ndarray:
        """The block of each predicted row."""
        return np.repeat(np.arange(len(self.bounds)), [stop - start for start, stop in self.bounds])

    def chosen(self) -> np.ndarray:
        """The learner of least squared error on the blocks before, for every shift and block, shape (S,B)."""
        return best_before(self.squares)

    def taken(self) -> Array:
        """The squared errors of the chosen learners, for every shift and block, shape (S,B)."""
        return np.asarray(np.take_along_axis(self.squares, self.chosen()[None], axis=0)[0])

    def explained(self) -> Array:
        """1 − squared error / squared error of the guess, over the judged blocks so far, by the chosen learners, (S,B')."""
        taken, guess = (each[:, self.judged_from :].cumsum(axis=1) for each in (self.taken(), self.guess_squares))
        return share_explained(taken, guess)


def share_explained(taken: Array, guess: Array) -> Array:
    """Return 1 − squared error / squared error of the guess; 0 where the guess makes no error."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(guess > 0, 1.0 - taken / guess, 0.0)


def best_before(losses: Array) -> np.ndarray:
    """Return the learner of least total loss before each block, from losses (L,S,B); the first one for block 0."""
    before = np.concatenate([np.zeros_like(losses[:, :, :1]), losses.cumsum(axis=2)[:, :, :-1]], axis=2)
    return np.asarray(before.argmin(axis=0))


def blocks(n_rows: int) -> tuple[tuple[int, int], ...]:
    """Return the predicted blocks: all but the first of ten blocks of equal length, up to one row."""
    ends = [round(k * n_rows / N_BLOCKS) for k in range(N_BLOCKS + 1)]
    return tuple(pairwise(ends[1:]))


def learn_forward(
    features: Array, targets: Array, shifts: np.ndarray, embargo: int, makers: Mapping[str, Learner]
) -> Forward:
    """Return the forward predictions for rows (T,P) with targets (T,C), circularly shifted by each of `shifts`, 0 first."""
    n_rows = len(features)
    bounds = blocks(n_rows)
    shifted = np.stack([np.roll(targets, int(s), axis=0) for s in shifts], axis=1)
    squares = np.empty((len(makers), len(shifts), len(bounds)))
    guess_squares = np.empty((len(shifts), len(bounds)))
    first = bounds[0][0]
    predictions = np.empty((len(makers), n_rows - first, targets.shape[1]))
    guesses = np.empty((n_rows - first, targets.shape[1]))
    for b, (start, stop) in enumerate(bounds):
        known, read = features[: start - embargo], features[start:stop]
        learned, truth = shifted[: start - embargo], shifted[start:stop]
        mean = learned.mean(axis=0)
        guess_squares[:, b] = ((truth - mean) ** 2).sum(axis=(0, 2))
        guesses[start - first : stop - first] = mean[0]
        for k, make in enumerate(makers.values()):
            predicted = make(known, read)(learned)
            squares[k, :, b] = ((truth - predicted) ** 2).sum(axis=(0, 2))
            predictions[k, start - first : stop - first] = predicted[:, 0]
    return Forward(bounds, tuple(makers), squares, guess_squares, predictions, guesses)
