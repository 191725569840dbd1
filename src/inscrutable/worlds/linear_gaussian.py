"""A linear Gaussian state-space model: a hidden state of real numbers and a linear sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag, solve_discrete_lyapunov

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array
from inscrutable.worlds.hidden_markov import Trajectory
from inscrutable.worlds.observations import Labels
from inscrutable.worlds.public import PublicPart

_COVARIANCE = "a covariance has no negative eigenvalue"


class Law(NamedTuple):
    """A Gaussian law."""

    mean: Array  # (n,)
    covariance: Array  # (n, n)


@dataclass(frozen=True, init=False, eq=False, repr=False)
class LinearGaussianWorld:
    """A hidden state x_{t+1} = A x_t + w_t with observations y_t = C x_t + v_t and z_t = C_z x_t + v_z,t.

    Formula: w ~ N(0,Q), v ~ N(0,R), v_z ~ N(0,R_z), independent of each other and over time. The agent observes y and z,
    everybody else z alone. Each matrix may change with time: a leading axis of T matrices, A_t from step t to t + 1.

    Args:
        transition: A, shape (n,n) or (T,n,n).
        process: Q, shape (n,n) or (T,n,n), the state's unit squared; may be singular.
        sensor: C, shape (p,n) or (T,p,n).
        noise: R, shape (p,p) or (T,p,p), the observation's unit squared; may be singular.
        initial: The law of x_0 before any observation, a pair of its mean (n,) and covariance (n,n); None for the stationary
            law, which has mean zero.
        public: The public observations: a pair (C_z, R_z) of shapes (q,n) and (q,q), a sensor beside the private one; or a
            `PublicPart` M of the private observation, z_t = M y_t. None: there are none.

    Labelled tables are aligned with each other: states by the labels of `transition`, columns of observations by those of
    `sensor`.

    Raises:
        InputError: Shapes or labels disagree, an entry is not finite, a covariance is not symmetric.
        ModelError: A covariance is indefinite (its smallest eigenvalue is named), or the stationary law is needed and does
            not exist.

    Cost: O(n³) for the stationary law, at first use. Source: Kalman, Journal of Basic Engineering 82 (1960).

    Example:
        >>> world = LinearGaussianWorld([[0.9]], [[0.19]], [[1.0]], [[0.5]])
        >>> world.stationary_covariance.round(6).tolist()
        [[1.0]]
        >>> world.sample(3, rng=np.random.default_rng(0)).observations.shape
        (3, 1)
    """

    transition: Array
    process: Array
    sensor: Array
    noise: Array
    public: tuple[Array, Array] | PublicPart | None
    names: Labels | None
    observation_names: Labels | None
    public_names: Labels | None
    _given: Law | None

    def __init__(
        self,
        transition: ArrayLike,
        process: ArrayLike,
        sensor: ArrayLike,
        noise: ArrayLike,
        initial: tuple[ArrayLike, ArrayLike] | None = None,
        public: tuple[ArrayLike, ArrayLike] | PublicPart | None = None,
    ) -> None:
        states, read = Axis("state", learns=True), Axis("column", learns=True)
        moves = validation.finite_array(transition, "transition", ndim=(2, 3), axes=(states, states))
        n = moves.shape[-1]
        if moves.shape[-2] != n or n == 0:
            raise InputError(f"transition has shape {moves.shape}, expected (n,n) or (T,n,n)")
        seen = _sensor(sensor, "sensor", n, (read, states))
        found = {
            "transition": moves,
            "process": _covariance(process, "process", n, states),
            "sensor": seen,
            "noise": _covariance(noise, "noise", seen.shape[-2], read),
        }
        told, public_names = _public(public, n, states, read, seen.shape[-2])
        steps = {name: len(matrix) for name, matrix in found.items() if matrix.ndim == 3}
        if len(set(steps.values())) > 1:
            raise InputError(f"matrices that change with time have different numbers of steps: {steps}")
        for name, matrix in found.items():
            object.__setattr__(self, name, matrix)
        object.__setattr__(self, "public", told)
        object.__setattr__(self, "names", states.names)
        object.__setattr__(self, "observation_names", read.names)
        object.__setattr__(self, "public_names", public_names)
        object.__setattr__(self, "_given", None if initial is None else _law(initial, n, states))
        validation.read_only(self, *found)

    def __repr__(self) -> str:
        steps = "" if self.n_steps is None else f", {self.n_steps} steps"
        return f"LinearGaussianWorld({self.n_states} states, {self.sensor.shape[-2]} columns read{steps})"

    @property
    def n_states(self) -> int:
        """Number of coordinates n of the state."""
        return int(self.transition.shape[-1])

    @property
    def n_steps(self) -> int | None:
        """Number of steps T of the matrices, None where none of them changes with time."""
        varying = [m for m in (self.transition, self.process, self.sensor, self.noise) if m.ndim == 3]
        return len(varying[0]) if varying else None

    @property
    def initial(self) -> Law:
        """The law of x_0, given or stationary; raises `ModelError` where neither is there."""
        return Law(np.zeros(self.n_states), self.stationary_covariance) if self._given is None else self._given

    @cached_property
    def stationary_covariance(self) -> Array:
        """P with P = A P A' + Q, shape (n,n).

        Raises:
            ModelError: A has an eigenvalue of modulus one or more (it is named), or matrices change with time.
        """
        self.check_constant("a stationary law")
        radius = float(np.abs(np.linalg.eigvals(self.transition)).max())
        if radius >= 1.0 - tolerances.STABLE:
            raise ModelError(
                f"the world has no stationary law: the largest eigenvalue of transition has modulus {radius:.10g}, expected "
                "less than 1; pass `initial`"
            )
        units = units_of(self.transition, self.process)
        both = np.outer(units, units)
        scaled = solve_discrete_lyapunov(self.transition * units / units[:, None], self.process / both)
        return _symmetric(np.asarray(scaled) * both)

    @property
    def is_begun(self) -> bool:
        """Whether the law of x_0 is given."""
        return self._given is not None

    def check_constant(self, what: str) -> None:
        """Raise `ModelError` where matrices change with time, so that `what` does not exist."""
        if self.n_steps is not None:
            raise ModelError(f"a world whose matrices change with time ({self.n_steps} steps) does not have {what}")

    def in_order(self, order: Sequence[int]) -> LinearGaussianWorld:
        """Return the same world with its states in another order, by their places in this one."""
        both, columns = np.ix_(order, order), np.asarray(order)
        given = None if self._given is None else (self._given.mean[columns], self._given.covariance[both])
        public = self.public if not isinstance(self.public, tuple) else (self.public[0][:, columns], self.public[1])
        found = LinearGaussianWorld(
            self.transition[..., both[0], both[1]],
            self.process[..., both[0], both[1]],
            self.sensor[..., columns],
            self.noise,
            given,
            public,
        )
        object.__setattr__(found, "names", None if self.names is None else tuple(self.names[k] for k in order))
        object.__setattr__(found, "observation_names", self.observation_names)
        object.__setattr__(found, "public_names", self.public_names)
        return found

    def sample(self, n: int, *, rng: np.random.Generator) -> Trajectory:
        """Draw a path x_0..x_{n−1} with its observations, (n, states), (n,p) and (n,q), in O(n (states² + p²)).

        Raises:
            InputError: `n` is not a whole number from 1 to the number of steps that the matrices say.
            ModelError: There is no law of x_0.
        """
        count, rng = validation.count(n, "n"), validation.generator(rng)
        if self.n_steps is not None and count > self.n_steps:
            raise InputError(f"n is {count}, but the matrices say {self.n_steps} steps")
        states = np.empty((count, self.n_states))
        states[0] = self.initial.mean + draws(self.initial.covariance, 1, rng=rng)[0]
        moved = draws(self.process, count, rng=rng)
        for t in range(count - 1):
            states[t + 1] = at(self.transition, t) @ states[t] + moved[t]
        observations = self._read(self.sensor, self.noise, states, rng)
        if self.public is None:
            return Trajectory(states, observations)
        if isinstance(self.public, PublicPart):
            return Trajectory(states, observations, observations @ self.public.matrix.T)
        return Trajectory(states, observations, self._read(*self.public, states, rng))

    @staticmethod
    def _read(sensor: Array, noise: Array, states: Array, rng: np.random.Generator) -> Array:
        clean = np.einsum("...pn,...n->...p", sensor if sensor.ndim == 2 else sensor[: len(states)], states)
        return np.asarray(clean + draws(noise, len(states), rng=rng))

    def agents_sensor(self, t: int) -> tuple[Array, Array]:
        """Return the matrix and the noise of all that the agent observes at a step: y, and z below it where it is a sensor."""
        sensor, noise = at(self.sensor, t), at(self.noise, t)
        if self.public is None or isinstance(self.public, PublicPart):
            return sensor, noise
        return np.vstack([sensor, self.public[0]]), np.asarray(block_diag(noise, self.public[1]))


def at(matrix: Array, t: int) -> Array:
    """Return a matrix at a step."""
    return matrix if matrix.ndim == 2 else np.asarray(matrix[t])


def units_of(transition: Array, process: Array) -> Array:
    """Return standard deviations (n,) that noise adds to the states within n steps or more, whatever their units.

    Formula: the diagonal of Σ_i A^i Q A^i', with A divided by its largest modulus of an eigenvalue where that exceeds one. A
    state that no noise reaches has the largest of the others.
    """
    power = transition / max(1.0, float(np.abs(np.linalg.eigvals(transition)).max(initial=0.0)))
    found = process
    for _ in range(len(process).bit_length()):
        found, power = found + power @ found @ power.T, power @ power
    sizes = np.sqrt(np.diag(found))
    return np.asarray(np.where(sizes > 0.0, sizes, max(float(sizes.max()), 0.0) or 1.0))


def draws(covariance: Array, n: int, *, rng: np.random.Generator) -> Array:
    """Draw n vectors of mean zero, shape (n,k), for one covariance (k,k), singular or not, or the first n of many."""
    values, vectors = np.linalg.eigh(covariance)
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    drawn = rng.standard_normal((n, covariance.shape[-1]))
    return np.asarray(np.einsum("...ij,...j->...i", roots if roots.ndim == 2 else roots[:n], drawn))


def _symmetric(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + np.swapaxes(matrix, -1, -2)))


def _sensor(value: Any, name: str, n: int, axes: Sequence[Axis], *, ndim: tuple[int, ...] = (2, 3)) -> Array:
    found = validation.finite_array(value, name, ndim=ndim, axes=axes)
    if found.shape[-1] != n or found.shape[-2] == 0:
        raise InputError(f"{name} has shape {found.shape}, expected one column per state: {n}")
    return found


def _covariance(value: Any, name: str, n: int, axis: Axis, *, ndim: tuple[int, ...] = (2, 3)) -> Array:
    found = validation.finite_array(value, name, ndim=ndim, axes=(axis, axis))
    if found.shape[-2:] != (n, n):
        raise InputError(f"{name} has shape {found.shape}, expected matrices of shape ({n}, {n})")
    for t, matrix in enumerate(found.reshape(-1, n, n)):
        validation.check_positive_semidefinite(matrix, name if found.ndim == 2 else f"{name}[{t}]", _COVARIANCE)
    return _symmetric(found)


def _law(given: Any, n: int, states: Axis) -> Law:
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise InputError(f"initial must be a pair of a mean (n,) and a covariance (n,n), or None, got {given!r}")
    mean = validation.finite_array(given[0], "initial mean", ndim=1, axes=(states,))
    if mean.size != n:
        raise InputError(f"initial mean has {mean.size} entries, expected one per state: {n}")
    return Law(mean, _covariance(given[1], "initial covariance", n, states, ndim=(2,)))


def _public(given: Any, n: int, states: Axis, read: Axis, n_read: int) -> tuple[Any, Labels | None]:
    if given is None:
        return None, None
    if isinstance(given, PublicPart):
        if given.matrix.shape[1] != n_read:
            raise InputError(
                f"the public part's matrix has {given.matrix.shape[1]} columns, expected one per column read: {n_read}"
            )
        order = None if given.asset_names is None else read.order(given.asset_names, "the public part's matrix")
        return given if order is None else PublicPart(given.matrix[:, order]), given.names
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise InputError(f"public must be a pair (sensor, noise), a PublicPart or None, got {given!r}")
    told = Axis("public column", learns=True)
    sensor = _sensor(given[0], "public sensor", n, (told, states), ndim=(2,))
    return (sensor, _covariance(given[1], "public noise", len(sensor), told, ndim=(2,))), told.names
