"""The dynamics of the agent's mean in the first steps: the law of the first mean, and a filter that is not yet steady."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from inscrutable import tolerances
from inscrutable.alphas.error_law import sizes_of
from inscrutable.alphas.observed import Moves
from inscrutable.validation import Array
from inscrutable.worlds import LinearGaussianWorld, SteadyFilter, steady_filter
from inscrutable.worlds.kalman import filter_at
from inscrutable.worlds.linear_gaussian import units_of


class FirstSteps:
    """The dynamics into every step, for an observer who knows the mean of x_0 and nothing else before step 0.

    With a given law of x_0 the agent begins to observe at step 0, and its filter converges to the steady one. Without one the
    filter is steady from the start.

    Args:
        world: The world, constant over time.
    """

    def __init__(self, world: LinearGaussianWorld) -> None:
        self._world, self._steady = world, steady_filter(world)
        self._units = units_of(world.transition, world.process)
        self.lasting = self._moves(self._steady, world.transition)
        self._last: SteadyFilter | None = None
        self._found: list[Moves] = []

    def _moves(self, found: SteadyFilter, transition: Array) -> Moves:
        return Moves(
            np.asarray(transition),
            found.innovation_covariance,
            found.public_sensor,
            found.cross_covariance,
            found.public_covariance,
            self._units,
        )

    @cached_property
    def stationary(self) -> Array | None:
        """The long-run covariance (n,n) of the mean for an observer who sees nothing; None where there is none."""
        return Moves.private(self.lasting.transition, self.lasting.innovation, self._units).silence()

    def into(self, step: int) -> Moves | None:
        """Return the dynamics into a step; into step 0 from the known mean, or None where no law of the first mean exists.

        Without a stationary law, an observer of public observations has the covariance that they leave in the long run.
        """
        if not self._world.is_begun:
            return self.lasting if step else self._from_nothing()
        if not self._found:
            one = np.eye(self._world.n_states)
            self._last = filter_at(self._world, self._world.initial.covariance, one)
            self._found.append(self._moves(self._last, one))
        while self._last is not None and len(self._found) <= step:
            self._last = self._after(self._last)
            self._found.append(self.lasting if self._last is None else self._moves(self._last, self._world.transition))
        return self._found[min(step, len(self._found) - 1)]

    def _after(self, last: SteadyFilter) -> SteadyFilter | None:
        """Return the filter of the next step; None where it is steady."""
        move, lasting = self._world.transition, self._steady.predicted_covariance
        predicted = move @ last.covariance @ move.T + self._world.process
        size = sizes_of(lasting)
        if (np.abs(predicted - lasting) <= tolerances.SETTLED * np.outer(size, size)).all():
            return None
        return filter_at(self._world, predicted, move)

    def _from_nothing(self) -> Moves | None:
        moves, first, one = self.lasting, self.stationary, np.eye(self._world.n_states)
        sensor = filter_at(self._world, self._steady.predicted_covariance, one).public_sensor
        if first is not None:
            cross = moves.cross + moves.transition @ first @ moves.public_sensor.T
            read = moves.public_covariance + moves.public_sensor @ first @ moves.public_sensor.T
            return Moves(one, first, sensor, cross, read, self._units)
        silence = moves.silence()
        if silence is None:
            return None
        # The given mean and this covariance contain the first public observation.
        return Moves(one, silence, sensor, np.zeros(moves.cross.shape), np.eye(len(sensor)), self._units)
