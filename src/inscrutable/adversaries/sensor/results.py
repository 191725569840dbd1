"""Estimates of a sensor from beliefs or decisions."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from inscrutable.saved import Saved, Summarised, saved_choice
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel


@saved_choice
class SensorStatus(Enum):
    """Whether the data identify the sensor; the text says what to do.

    Example:
        >>> SensorStatus.IDENTIFIED.value
        'identified: the data determine the answer, up to the names of the symbols'
    """

    IDENTIFIED = "identified: the data determine the answer, up to the names of the symbols"
    SCALES_BY_FREQUENCY = (
        "columns known up to a factor each: with more symbols than states, or dependent columns, the factors come from how "
        "often symbols were seen; see the intervals"
    )
    TOO_FEW_SYMBOLS = (
        "fewer symbols were seen than the sensor has, or several symbols have the same effect, because more are expected or "
        "the rows sum to less than one: the rest is shared among the unseen symbols, and one column may be that of several; "
        "take more beliefs"
    )
    TOO_FEW_STEPS = "fewer steps than unknowns: the answer is one guess of many; take more beliefs"
    ZEROS = (
        "every step starts from a belief that rules out a state, so that the sensor's row of that state is unknown: take other "
        "beliefs"
    )
    OVERLAPPING = (
        "symbols overlap within the noise, or no filter produces these beliefs: entries may be off by as much as symbols "
        "differ; take more exact beliefs"
    )
    SETS = (
        "decisions leave sets of beliefs, and several sensors explain them: the intervals span those that were found; take "
        "more decisions"
    )
    DEGENERATE = (
        "the beliefs change too little to determine the transition: the answer is arbitrary; take beliefs that change more, or "
        "more of them"
    )
    INCONSISTENT = (
        "no filter with so many symbols produces these beliefs: see the steps with symbol -1 and the residual; doubt the "
        "beliefs, the transition or n_symbols; if n_symbols was not given, give it: a symbol seen only once may be taken for "
        "an error"
    )


class _Answer(Summarised, Saved):
    """An estimate and its status."""

    status: SensorStatus

    @property
    def is_identified(self) -> bool:
        """Whether the data determine the answer, up to the names of the symbols."""
        return self.status == SensorStatus.IDENTIFIED


@dataclass(frozen=True, eq=False, repr=False)
class EstimatedSensor(_Answer):
    """The sensor behind the beliefs of a filter.

    Formula: π_k = diag(b_y) P'π_{k−1} / 1'diag(b_y) P'π_{k−1} with b_y the column `probabilities[:, y]`.

    Args:
        probabilities: The sensor, shape (X,Y), rows that sum to one; symbols are numbered in order of appearance.
        symbols: The symbol of each step from a belief to the next, shape (T−1,); −1 where no symbol explains the step, where
            several do equally well, as near a sure state, or where the step was not used.
        residual: Largest Euclidean distance of a belief from the filter's update of the belief before it.
        status: Whether the data determine the sensor.
        intervals: 95 % intervals of each entry, shape (X,Y,2). In 300 fits of drawn worlds of two states and symbols, 200 steps
            with Gaussian errors of 1e-4, they hold .89 of the true entries: successive steps share a belief and its error.
        noise: Standard deviation of a belief's error in any direction of the simplex, √(X/(X−1)) times that of a coordinate,
            estimated from the residuals.

    Source: Mattila, Rojas, Krishnamurthy, Wahlberg, Inverse Filtering for Hidden Markov Models, NeurIPS 2017.

    Example:
        >>> one = EstimatedSensor(np.eye(2), np.array([0, 1]), 0.0, SensorStatus.IDENTIFIED, np.zeros((2, 2, 2)))
        >>> one.is_identified
        True
    """

    probabilities: Array
    symbols: np.ndarray
    residual: float
    status: SensorStatus
    intervals: Array
    noise: float = 0.0

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        rows = "\n".join("  ".join(f"{each:8.5f}" for each in row) for row in self.probabilities)
        parts = [f"sensor, a row a state\n{rows}", f"steps     {_counted(self.symbols)}"]
        return "\n".join([*parts, f"residual  {self.residual:.3g}", f"status    {self.status.value}"])


@dataclass(frozen=True, eq=False, repr=False)
class EstimatedWorld(_Answer):
    """The transition and sensor of a filter, estimated from its beliefs alone.

    Args:
        world: Transition and sensor; symbols have the given names, else they are numbered in order of appearance.
        symbols: The symbol of each step from a belief to the next, shape (T−1,); −1 where none explains the step, or several
            do equally well, as near a sure state.
        residual: Largest Euclidean distance of a belief from the filter's update of the belief before it.
        status: Whether the data determine the world; `SCALES_BY_FREQUENCY` concerns the sensor alone.
        transition_intervals: 95 % intervals, shape (X,X,2), by bootstrap, else by the curvature of the joint fit; of zero width
            where beliefs are exact. In 72 fits of drawn worlds with errors of 1e-9 to 1e-3 those by curvature hold .74 to .95
            of the true entries: successive steps share a belief and its error.
        sensor_intervals: The same of the sensor, (X,Y,2), .69 to .92; for exact beliefs those of the symbols' frequencies.

    Source: Mattila, Rojas, Krishnamurthy, Wahlberg, Inverse Filtering for Hidden Markov Models with Applications to
    Counter-Adversarial Autonomous Systems, IEEE Transactions on Signal Processing 68 (2020).

    Example:
        >>> from inscrutable import CategoricalEmission, HiddenMarkovModel
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], CategoricalEmission(np.eye(2)))
        >>> nothing = np.zeros((2, 2, 2))
        >>> EstimatedWorld(world, np.array([0, 1]), 0.0, SensorStatus.IDENTIFIED, nothing, nothing).is_identified
        True
    """

    world: HiddenMarkovModel
    symbols: np.ndarray
    residual: float
    status: SensorStatus
    transition_intervals: Array
    sensor_intervals: Array

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        sensor = self.world.emission.probabilities  # type: ignore[attr-defined]
        parts = [
            f"{name}, a row a state\n" + "\n".join("  ".join(f"{each:8.5f}" for each in row) for row in table)
            for name, table in (("transition", self.world.transition), ("sensor", sensor))
        ]
        return "\n".join(
            [
                *parts,
                f"steps     {_counted(self.symbols)}",
                f"residual  {self.residual:.3g}",
                f"status    {self.status.value}",
            ]
        )


def _counted(symbols: np.ndarray) -> str:
    """Return the number of steps with a symbol, as text."""
    used = int((symbols >= 0).sum())
    return f"{used} of {len(symbols)} have a symbol"
