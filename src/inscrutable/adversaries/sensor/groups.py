"""Clusters of a filter's steps by symbol, from the directions of the sensor's columns.

Spherical k-means on the null vectors would weigh all steps equally. The distance used here is that between the observed belief
and the one to which a column leads, in standard deviations: errors of beliefs have equal variance, errors of null vectors do
not. Gauss-Newton steps in a column's logarithm update it; they keep it nonnegative and keep its zeros.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from inscrutable import tolerances
from inscrutable.adversaries.sensor.steps import FilterSteps
from inscrutable.validation import Array

_MOST_JOINED = 1_000
"""Most steps in the initial hierarchical clustering, the most exact ones; time and memory grow with the square."""

_SPARE_GROUPS = 4
"""Groups beyond the number of symbols in a start: outlying steps form groups of their own, which are dropped."""

_ROUNDS, _MOVES = 60, 12
"""Rounds of assigning steps and moving columns at most, and Gauss-Newton steps of a column in each."""

_OUTLYING = 30.0
"""A step this many times further off than the median is an outlier: no Gaussian error is so large."""

UNCLEAR = -2
"""Symbol of a step that several columns explain equally well."""


class Groups(NamedTuple):
    """Steps by symbol.

    Args:
        columns: The sensor's columns up to a factor, largest entry one, shape (Y,X).
        symbols: The symbol of each step, shape (K,); −1 where none explains it, `UNCLEAR` where several do equally well.
        misses: Distance of each step from its column, shape (K,), in standard deviations of one belief's error.
    """

    columns: Array
    symbols: np.ndarray
    misses: Array

    @property
    def outlying(self) -> np.ndarray:
        """The steps that no column explains."""
        return np.flatnonzero(self.symbols == -1)


def grouped(steps: FilterSteps, n_symbols: int | None) -> Groups:
    """Return the steps by symbol; the number of symbols is estimated where it is not given."""
    distinct = _tree(steps)
    if n_symbols is not None:
        return _grouped(steps, *distinct, n_symbols)
    most = min(2 * steps.held.shape[1] + 2, len(steps.numbers) - 1)
    found, sizes = [], []
    for count in range(1, max(most, 1) + 1):
        found.append(_grouped(steps, *distinct, count))
        sizes.append(max(float(found[-1].misses.mean()), tolerances.REACHED_BELIEF))
        if sizes[-1] <= tolerances.REACHED_BELIEF:
            break
    falls = np.array(sizes[:-1]) / np.array(sizes[1:])
    return found[int(falls.argmax()) + 1 if falls.size and falls.max() > 2.0 else 0]


def assigned(steps: FilterSteps, columns: Array) -> Groups:
    """Assign the steps to the nearest of given columns, refit these, and mark the outlying steps."""
    symbols = np.full(len(steps.numbers), -1)
    for _ in range(_ROUNDS):
        misses = steps.misses(columns)
        nearest = misses.argmin(axis=1)
        if (nearest == symbols).all():
            break
        symbols = nearest
        columns = np.array([moved(steps.of(symbols == y), column) for y, column in enumerate(columns)])
    return without_outlying(steps, Groups(columns, symbols, steps.misses(columns)[np.arange(len(symbols)), symbols]))


def without_outlying(steps: FilterSteps, groups: Groups) -> Groups:
    """Return groups without the steps that no column explains, so that these do not affect the fit."""
    far = _far(groups.misses)
    if not far.any():
        return groups
    symbols = groups.symbols
    kept = steps.of(~far)
    columns = np.array([moved(kept.of(symbols[~far] == y), each) for y, each in enumerate(groups.columns)])
    misses = steps.misses(columns)[np.arange(len(symbols)), symbols]
    return Groups(columns, np.where(_far(misses), -1, symbols), misses)


def _far(misses: Array) -> np.ndarray:
    """Which steps are outlying."""
    return np.asarray(misses > _OUTLYING * float(np.median(misses)) + tolerances.EXACT_BELIEFS)


def moved(steps: FilterSteps, column: Array) -> Array:
    """Return the column (X,) fitted to the steps, from a first one; the first one where there are no steps."""
    if not len(steps.numbers):
        return column
    for _ in range(_MOVES):
        shown = steps.shown(column[None])[:, 0]
        misses = (np.sqrt(steps.weights)[:, None] * (steps.held - shown)).reshape(-1)
        slopes = _slopes(steps, shown).reshape(-1, shown.shape[1])
        step = np.linalg.lstsq(slopes, misses, rcond=tolerances.CURVATURE)[0]
        step -= step.mean()
        size = float(np.abs(step).max())
        column = column * np.exp(step * min(1.0, 1.0 / max(size, tolerances.TINY)))
        column = column / column.max()
        if size <= tolerances.STATIONARITY:
            break
    return column


def column_errors(steps: FilterSteps, groups: Groups) -> Array:
    """Return the standard deviation of each entry of the columns, shape (Y,X), per unit of that of a belief's coordinate."""
    n_states = groups.columns.shape[1]
    found = np.zeros(groups.columns.shape)
    for y, column in enumerate(groups.columns):
        some = steps.of(groups.symbols == y)
        slopes = _slopes(some, some.shown(column[None])[:, 0]).reshape(-1, n_states)
        inverse = np.linalg.pinv(slopes, rcond=tolerances.CURVATURE)
        found[y] = column * np.sqrt((inverse**2).sum(axis=1))
    return found


def _slopes(steps: FilterSteps, shown: Array) -> Array:
    """Return the weighted derivatives of the fitted beliefs (K,X) by the logarithm of the column, shape (K,X,X)."""
    slopes = shown[:, :, None] * (np.eye(shown.shape[1]) - 1.0) * shown[:, None, :]
    # As sums of the others: 1 − π_i has no digits left where π_i is nearly one, and the rows must sum to zero.
    slopes[:, range(shown.shape[1]), range(shown.shape[1])] = -slopes.sum(axis=2)
    return np.asarray(np.sqrt(steps.weights)[:, None, None] * slopes)


def _tree(steps: FilterSteps) -> tuple[Array, np.ndarray]:
    """Return the most exact directions and their hierarchical clustering."""
    directions = steps.directions()
    errors = directions * np.hypot(1.0 / steps.predicted, 1.0 / np.maximum(steps.held, tolerances.SAME_BELIEF))
    spread = np.hypot.reduce(errors, axis=1)  # their squares may overflow
    some = np.sort(np.argsort(spread, kind="stable")[:_MOST_JOINED])
    kept = directions[some]
    return kept, linkage(kept, "average") if len(kept) > 1 else np.empty((0, 4))


def _grouped(steps: FilterSteps, directions: Array, tree: np.ndarray, count: int) -> Groups:
    """Return the best of several starts: the clustering is cut into `count` groups or some more, and the largest are kept."""
    best: Groups | None = None
    for spare in range(_SPARE_GROUPS):
        labels = fcluster(tree, count + spare, "maxclust") if len(tree) else np.ones(len(directions), dtype=int)
        sizes = np.bincount(labels)
        largest = np.argsort(-sizes, kind="stable")[:count]
        starts = np.array([_middle(directions[labels == each]) for each in largest if sizes[each]])
        found = assigned(steps, starts)
        if best is None or np.abs(found.misses).sum() < np.abs(best.misses).sum():
            best = found
    assert best is not None
    return best


def _middle(directions: Array) -> Array:
    middle = directions.mean(axis=0)
    return np.asarray(middle / middle.max())
