"""Families of sensors with a few parameters each."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.errors import InputError
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, Emission, GaussianEmission
from inscrutable.worlds.linear_gaussian import LinearGaussianWorld


@dataclass(frozen=True, eq=False)
class SensorFamily:
    """Sensors with K parameters, each in an interval.

    Args:
        make: Function of K numbers θ_1, …, θ_K that returns an `Emission`, or a `LinearGaussianWorld` with that sensor.
        bounds: Least and greatest value of each parameter, shape (K,2), finite.
        names: Names of the parameters, for messages and plots.

    Raises:
        InputError: Bounds are not ascending intervals, or their number differs from that of the names.

    Example:
        >>> SensorFamily.accuracy(2)(0.75).probabilities.tolist()
        [[0.75, 0.25], [0.25, 0.75]]
    """

    make: Callable[..., Emission | LinearGaussianWorld]
    bounds: Array
    names: tuple[str, ...]

    def __init__(
        self, make: Callable[..., Emission | LinearGaussianWorld], bounds: ArrayLike, names: Sequence[str]
    ) -> None:
        limits = np.atleast_2d(validation.finite_array(bounds, "bounds", ndim=(1, 2)))
        if limits.shape != (len(names), 2) or (limits[:, 0] >= limits[:, 1]).any():
            raise InputError(
                f"bounds must be {len(names)} intervals of rising ends, one for each of {list(names)}, got {limits.tolist()}"
            )
        object.__setattr__(self, "make", make)
        object.__setattr__(self, "bounds", limits)
        object.__setattr__(self, "names", tuple(names))

    def __call__(self, *parameters: float) -> Any:
        """Return the sensor of K parameters."""
        found = self.make(*(float(each) for each in parameters))
        if not isinstance(found, (Emission, LinearGaussianWorld)):
            raise InputError(
                f"a family must return an Emission such as CategoricalEmission(rows), or a LinearGaussianWorld, got {found!r}"
            )
        return found

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def of(cls, given: Any) -> SensorFamily:
        """Return a family as it is, or make one from a function whose arguments are probabilities between 0 and 1.

        Raises:
            InputError: `given` is not a function, or takes no arguments.
        """
        if isinstance(given, cls):
            return given
        if not callable(given):
            raise InputError(f"family must be a SensorFamily or a function of its parameters, got {given!r}")
        kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        names = [each.name for each in inspect.signature(given).parameters.values() if each.kind in kinds]
        if not names:
            raise InputError("family is a function without arguments; expected one argument a parameter")
        return cls(
            given, np.tile([tolerances.UNCERTAIN_SENSOR, 1.0 - tolerances.UNCERTAIN_SENSOR], (len(names), 1)), names
        )

    @classmethod
    def accuracy(cls, n_states: int) -> SensorFamily:
        """Return the sensors that report the true state with probability p and every other state equally often otherwise."""
        count = validation.count(n_states, "n_states", least=2)

        def make(p: float) -> CategoricalEmission:
            return CategoricalEmission((1.0 - p) / (count - 1) + (p - (1.0 - p) / (count - 1)) * np.eye(count))

        return cls(make, [[1.0 / count, 1.0 - tolerances.UNCERTAIN_SENSOR]], ["accuracy"])

    @classmethod
    def confusion(cls, n_states: int, n_symbols: int) -> SensorFamily:
        """Return all sensors of Y symbols, with X·(Y−1) parameters: an entry as a share of its row's remaining probability."""
        rows, columns = validation.count(n_states, "n_states"), validation.count(n_symbols, "n_symbols", least=2)

        def make(*shares: float) -> CategoricalEmission:
            parts = np.array(shares).reshape(rows, columns - 1)
            left = np.cumprod(np.column_stack([np.ones(rows), 1.0 - parts]), axis=1)
            return CategoricalEmission(left * np.column_stack([parts, np.ones(rows)]))

        names = [f"share of symbol {y} in state {x}" for x in range(rows) for y in range(columns - 1)]
        return cls(
            make, np.tile([tolerances.UNCERTAIN_SENSOR, 1.0 - tolerances.UNCERTAIN_SENSOR], (len(names), 1)), names
        )

    @classmethod
    def gaussian_spread(cls, means: ArrayLike, bounds: ArrayLike) -> SensorFamily:
        """Return Gaussian sensors with known means (X,D) and one standard deviation in all states and directions."""
        centres = validation.finite_array(means, "means", ndim=(1, 2))
        centres = centres.reshape(len(centres), -1)
        n_states, n_dims = centres.shape

        def make(spread: float) -> GaussianEmission:
            return GaussianEmission(centres, np.tile(spread**2 * np.eye(n_dims), (n_states, 1, 1)))

        return cls(make, bounds, ["spread"])
