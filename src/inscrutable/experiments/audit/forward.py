"""Learning forward in time: every block is read by what was learned from the rows before it, less an embargo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from inscrutable.adversaries.learners import Learner
from inscrutable.validation import Array

N_BLOCKS = 10
FIRST_JUDGED = 4
"""Block 0 is only learned from, blocks 1 to 3 only to choose a learner; what is claimed is judged on the other six tenths."""


@dataclass(frozen=True, eq=False)
class Forward:
    """The predictions of every learner for every block read, for the targets as they are and for shifted ones.

    Squares and guesses are sums over a block's rows; predictions those for the targets as they are.
    """

    bounds: tuple[tuple[int, int], ...]  # of the blocks read, first row and the one after the last
    names: tuple[str, ...]
    squares: Array  # (L, S, B)
    guess_squares: Array  # (S, B), of the mean of what was learned from
    predictions: Array  # (L, n, C)
    guesses: Array  # (n, C)

    @property
    def judged_from(self) -> int:
        """The first block read that counts for a claim."""
        return FIRST_JUDGED - 1

    def chosen(self) -> np.ndarray:
        """For every shift and block the learner that had the least square error on the blocks before, shape (S,B)."""
        return best_before(self.squares)

    def explained(self) -> Array:
        """1 − square error / that of the guess, over all judged blocks up to each, shape (S,B'), by the chosen learners."""
        judged = slice(self.judged_from, None)
        taken = np.take_along_axis(self.squares, self.chosen()[None], axis=0)[0]
        guess = self.guess_squares[:, judged].cumsum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 1.0 - taken[:, judged].cumsum(axis=1) / guess
        return np.where(guess > 0, share, 0.0)


def best_before(losses: Array) -> np.ndarray:
    """The learner of least summed loss over the blocks before each, of losses (L,S,B); the first one where there are none."""
    before = np.concatenate([np.zeros_like(losses[:, :, :1]), losses.cumsum(axis=2)[:, :, :-1]], axis=2)
    return np.asarray(before.argmin(axis=0))


def blocks(n_rows: int) -> tuple[tuple[int, int], ...]:
    """The blocks that are read: all but the first of ten of equal length, to a row."""
    ends = [round(k * n_rows / N_BLOCKS) for k in range(N_BLOCKS + 1)]
    return tuple(pairwise(ends[1:]))


def learn_forward(
    features: Array, targets: Array, shifts: np.ndarray, embargo: int, makers: Mapping[str, Learner]
) -> Forward:
    """Return what learners make of rows (T,P) with targets (T,C), shifted around the circle by each of `shifts`, 0 first."""
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
