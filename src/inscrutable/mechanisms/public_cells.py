"""Public real numbers discretised to cells, and the error that the cells add."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial import cKDTree

from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.filtering import filter_beliefs
from inscrutable.validation import Array
from inscrutable.worlds import Emission, HiddenMarkovModel
from inscrutable.worlds.observations import in_rows, real_rows

N_CELLS = 24
"""Cells where no cuts are given. The error of an observer who sees no decision is then 0.1 to 0.6 % above that of an
observer who reads the numbers (one or two of them, two or three states); with 12 cells 0.3 to 4 %, with 4 cells 2 to 16 %."""
_MOST_SEEN = 20_000


@dataclass(frozen=True, eq=False, repr=False)
class PublicCells:
    """Cells of public real numbers z with similar p(x|z); or between cut points of one number.

    Args:
        emission: The law of z given the state.
        weights: The long-run law of the states, shape (X,).
        centres: Posteriors in the middle of the cells, shape (Z,X); of cuts None.
        cuts: Rising cut points of a single number; None where there are centres.
        numbers_error: √E‖π − E[π|z_0..z_t]‖², the error of an observer who has the numbers and sees no decision, on a path
            that was not used to make the cells.
        symbols_error: The same for an observer who has cells, by the chain on its grid: the errors of cells, grid and counted
            tables together.
        error_se: Standard error of the difference of these two.

    Source: Lloyd, Least squares quantization in PCM (IEEE Trans. IT 28, 1982).

    Example:
        >>> from inscrutable import GaussianEmission
        >>> cells = PublicCells(GaussianEmission([[0.0], [1.0]], np.ones((2, 1, 1))), np.full(2, 0.5), None, np.array([0.5]))
        >>> print(cells.symbols([[0.2], [0.7]]), cells)
        [0 1] 2 cells; errors not measured
    """

    emission: Emission
    weights: Array
    centres: Array | None
    cuts: Array | None = None
    numbers_error: float = float("nan")
    symbols_error: float = float("nan")
    error_se: float = float("nan")

    def __len__(self) -> int:
        if self.cuts is not None:
            return len(self.cuts) + 1
        assert self.centres is not None
        return len(self.centres)

    def symbols(self, values: Any) -> np.ndarray:
        """Return the cells of rows of numbers (T,D)."""
        names = getattr(self.emission, "asset_names", None)
        rows = real_rows(in_rows(values, Axis("row", learns=True), "public"), Axis("public column", names))
        if self.cuts is not None:
            if rows.shape[1] != 1:
                raise InputError(f"public must be one number a step where cuts are given, got {rows.shape[1]}")
            return np.searchsorted(self.cuts, rows[:, 0])
        assert self.centres is not None
        return np.asarray(cKDTree(self.centres).query(posteriors(self.emission, self.weights, rows))[1])

    def __repr__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Return one line for a person to read."""
        if np.isnan(self.numbers_error):
            return f"{len(self)} cells; errors not measured"
        return (
            f"{len(self)} cells: error without decisions {self.symbols_error:.4f}, with the numbers themselves "
            f"{self.numbers_error:.4f} (difference ± {1.96 * self.error_se:.4f})"
        )


def posteriors(emission: Emission, weights: Array, values: Any) -> Array:
    """Return p(x|z) ∝ p(z|x) w_x of rows of numbers, shape (T,X)."""
    logs = np.asarray(emission.log_likelihoods(values), dtype=np.float64)
    shares = np.exp(logs - logs.max(axis=1, keepdims=True)) * weights
    return np.asarray(shares / shares.sum(axis=1, keepdims=True))


def cells_of(world: HiddenMarkovModel, values: Any, n_cells: int, *, rng: np.random.Generator) -> PublicCells:
    """Return cells of a world's public numbers, from a long path of them (T,D)."""
    emission = world.public_emission
    assert emission is not None
    weights = long_run(world.transition, world.initial)
    features = posteriors(emission, weights, values[:: -(-len(values) // _MOST_SEEN)])
    with warnings.catch_warnings():  # an empty cell is left out below
        warnings.simplefilter("ignore")
        centres, place = kmeans2(features, min(n_cells, len(features)), seed=rng, minit="++")
    return PublicCells(emission, weights, centres[np.unique(place)])


def long_run(transition: Array, initial: Array) -> Array:
    """Return the mean of the law of the state over many steps (X,)."""
    lazy = 0.5 * (transition + np.eye(len(transition)))  # also of a chain with a period
    return np.asarray(initial @ np.linalg.matrix_power(lazy, 2**20))


def errors_of(world: HiddenMarkovModel, path: Any, means: Array, *, ahead: bool) -> tuple[float, float, float]:
    """Return the error of an observer who reads the numbers, of estimates (T,X) of the belief, and the difference's standard
    error.

    E[π_t|z_0..z_t] = E[x_t|z_0..z_t], as z is among what the agent filters: a filter of the public sensor alone.
    """
    emission = world.public_emission
    assert emission is not None
    held = filter_beliefs(world, path.observations, public=path.public).beliefs
    read = filter_beliefs(HiddenMarkovModel(world.transition, emission, world.initial), path.public).beliefs
    if ahead:
        held, read = held @ world.transition, read @ world.transition
    squares = [((held - each) ** 2).sum(axis=1) for each in (read, means)]
    one, other = (float(np.sqrt(each.mean())) for each in squares)
    batches = np.array([each.mean() for each in np.array_split(squares[1] - squares[0], 50)])
    spread = float(batches.std(ddof=1) / np.sqrt(len(batches)))
    return one, other, spread / max(one + other, np.finfo(float).tiny)
