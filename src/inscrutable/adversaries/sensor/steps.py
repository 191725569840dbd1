"""Steps of a filter between observed beliefs: predicted belief, updated belief, and accuracy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, ordered_array
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array


class FilterSteps(NamedTuple):
    """Steps k = 1..T−1 of a filter under a known transition: the sensor's column is ∝ held / predicted.

    Args:
        predicted: P'π_{k−1}, shape (K,X).
        held: π_k, shape (K,X).
        weights: Inverse variance of the residual of `held` given the column, in units of that of one belief, shape (K,).
        numbers: k−1 of each step, shape (K,); unusable steps are left out.
    """

    predicted: Array
    held: Array
    weights: Array
    numbers: np.ndarray

    def of(self, some: np.ndarray) -> FilterSteps:
        """Return some of the steps."""
        return FilterSteps(*(each[some] for each in self))

    def directions(self) -> Array:
        """Return the unit vectors along the sensor's columns, shape (K,X): each spans the null space of its step's
        π_k (P'π_{k−1})' − diag(P'π_{k−1})."""
        ratios = self.held / self.predicted
        ratios = ratios / ratios.max(axis=1, keepdims=True)  # of a state that was hardly possible: its square overflows
        return np.asarray(ratios / np.linalg.norm(ratios, axis=1, keepdims=True))

    def shown(self, columns: Array) -> Array:
        """Return the updated beliefs (K,Y,X) under each symbol's column (Y,X)."""
        joint = self.predicted[:, None] * columns
        total = joint.sum(axis=2, keepdims=True)
        return np.asarray(np.divide(joint, total, out=np.zeros_like(joint), where=total > 0))

    def misses(self, columns: Array) -> Array:
        """Return the distance (K,Y) of each belief from those of `shown`, in standard deviations of one belief's error."""
        gaps = np.linalg.norm(self.held[:, None] - self.shown(columns), axis=2)
        return np.asarray(gaps * np.sqrt(self.weights)[:, None])


def filter_steps(before: Array, held: Array, transition: Array) -> FilterSteps:
    """Return the steps from beliefs (K,X) to the next (K,X) with information about every state.

    A step with a state of predicted probability zero contains no information about the sensor's row of that state, and is
    left out. NaN rows are beliefs that were not seen.

    Raises:
        ModelError: A belief gives weight to a state that the belief before it rules out.
    """
    seen = np.isfinite(np.column_stack([before, held])).all(axis=1)
    predicted = before @ transition
    ruled_out = np.logical_and(predicted <= 0.0, held > tolerances.BELIEF_SUM)
    impossible = np.argwhere(ruled_out & seen.reshape(-1, 1))
    if impossible.size:
        k, state = (int(each) for each in impossible[0])
        raise ModelError(
            f"belief {k + 1} gives state {state} the probability {held[k, state]:.3g}, but the transition never leads there "
            f"from belief {k}: no filter of this chain holds these beliefs one after the other, unless a probability of belief "
            f"{k} was rounded to 0; then give more digits"
        )
    some = np.flatnonzero(seen & (predicted > tolerances.TINY).all(axis=1))
    return FilterSteps(predicted[some], held[some], filter_weights(predicted[some], held[some], transition), some)


def filter_weights(predicted: Array, held: Array, transition: Array) -> Array:
    """Return the inverse variances of π_k − T(π_{k−1}) where both beliefs have errors of variance one.

    The derivative (diag π − ππ') diag(1/m) P' of the filter maps the error of π_{k−1}.
    """
    slope = held[:, :, None] * (np.eye(held.shape[1]) - held[:, None, :]) / predicted[:, None, :]
    gain = slope @ transition.T
    return np.asarray(held.shape[1] / (held.shape[1] + (gain**2).sum(axis=(1, 2))))


def seen_beliefs(beliefs: ArrayLike, states: Axis, n_states: int | None = None, *, steps: Axis | None = None) -> Array:
    """Return successive beliefs as (T,X) with T at least 2, aligned with the names of the states and steps.

    Raises:
        InputError: The rows are not beliefs, or fewer than two.
    """
    plain = ordered_array(beliefs, "beliefs", (steps or Axis("step", learns=True), states))
    if plain.ndim != 2 or len(plain) < 2:
        raise InputError(f"beliefs must be successive ones (T,X), two at least, got shape {plain.shape}")
    held = validation.beliefs(plain, plain.shape[1] if n_states is None else n_states, "beliefs")
    return held


def symbol_count(value: int | None) -> int | None:
    """Return a number of symbols, or None where it is to be estimated."""
    return None if value is None else validation.count(value, "n_symbols")
