"""The inverse Kalman filter: the law of an agent's estimate given linear observations of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.axes import Axis, Names, depth
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array
from inscrutable.worlds.kalman import KalmanResult, kalman_filter
from inscrutable.worlds.linear_gaussian import LinearGaussianWorld, at

_BLIND = "the agent's sensor is zero (it is blind), so that its estimates follow from the world alone"
_NOISELESS = "the agent observes without noise, so that its estimates follow from the states, which are given"


@dataclass(frozen=True, eq=False)
class LinearView:
    """An observation H m_t + e_t of an estimate m_t, with e_t ~ N(0,E), such as a decision that is linear in it.

    Args:
        matrix: H, shape (q,n).
        noise: E, shape (q,q), positive semidefinite; None: no noise.

    Labels of tables are kept as `names` of the observations and `state_names`.

    Raises:
        InputError: Shapes or labels disagree, or a number is not finite.

    Example:
        >>> LinearView([[2.0, 0.0]]).noise.tolist()
        [[0.0]]
    """

    matrix: Array
    noise: Array
    names: Names | None
    state_names: Names | None

    def __init__(self, matrix: ArrayLike, noise: ArrayLike | None = None) -> None:
        told, states = Axis("observation", learns=True), Axis("state", learns=True)
        rows = validation.finite_array(matrix, "matrix", ndim=2, axes=(told, states))
        blur = np.zeros((len(rows), len(rows)))
        if noise is not None:
            blur = validation.finite_array(noise, "noise", ndim=2, axes=(told, told))
        if blur.shape != (len(rows), len(rows)):
            raise InputError(f"noise has shape {blur.shape}, expected {(len(rows), len(rows))}, as matrix has rows")
        object.__setattr__(self, "matrix", rows)
        object.__setattr__(self, "noise", blur)
        object.__setattr__(self, "names", told.names)
        object.__setattr__(self, "state_names", states.names)

    def of(self, world: LinearGaussianWorld) -> LinearView:
        """Return the view with its columns in the order of a world's states."""
        if self.matrix.shape[1] != world.n_states:
            raise InputError(
                f"the view's matrix has {self.matrix.shape[1]} columns, expected one per state: {world.n_states}"
            )
        known = self.state_names is not None and world.names is not None
        order = Axis("state", world.names).order(self.state_names or (), "the view's matrix") if known else None
        return self if order is None else LinearView(self.matrix[:, order], self.noise)


def inverse_kalman_filter(
    world: LinearGaussianWorld, seen: ArrayLike, view: LinearView | None = None, *, states: ArrayLike | None = None
) -> KalmanResult:
    """Return the law of an agent's estimates m_t, given an observer's observations of them up to each step.

    Formula: m_{t+1} = (I − K C) A m_t + K C x_{t+1} + K v_{t+1}, the agent's Kalman filter with its known gain K_{t+1}.

    Where the observer knows the states, they are an input and m is a linear Gaussian state; otherwise (x, m) is the state.

    Args:
        world: The agent's world, without a public sensor.
        seen: H m_t + e_t, shape (T,q), or (T,) where q is 1; NaN is missing.
        view: H and the law of e; None: the estimates themselves.
        states: x_0..x_{T−1}, shape (T,n), or (T,) where n is 1, where the observer knows them.

    Returns:
        A `KalmanResult` of m_t; of (x_t, m_t), 2n entries, where states are not known.
        Its log-likelihood is the density of the observations, given the states where known: the likelihood of a sensor.

    Raises:
        InputError: Shapes or labels disagree, or the world has a public sensor.
        ModelError: What is seen of the estimates has no density, as where a blind agent's are seen without noise; or what the
            agent observes has none.

    Cost: O(T n³).

    Source: Krishnamurthy, Rangaswamy, arXiv 1905.07230, Section III.

    Example:
        >>> world = LinearGaussianWorld([[0.9]], [[0.19]], [[1.0]], [[1.0]])
        >>> found = inverse_kalman_filter(world, [0.5, 0.7], states=[1.0, 1.0])
        >>> found.means.ravel().tolist(), round(found.log_likelihood, 4)
        ([0.5, 0.7], -0.1659)
    """
    if not isinstance(world, LinearGaussianWorld) or world.public is not None:
        raise InputError(f"world must be a LinearGaussianWorld with nothing public, got {world!r}")
    n = world.n_states
    seeing = LinearView(np.eye(n)) if view is None else view.of(world)
    steps, columns = Axis("row", learns=True), Axis("state", world.names)
    told = columns if view is None else Axis("observation", view.names)
    rows = _rows(seen, len(seeing.matrix), "seen", (steps, told))
    gains = _gains(world, len(rows))
    if states is None:
        return _seen(_joint_world(world, gains, seeing), rows, "" if gains.any() else _BLIND)
    path = _rows(states, n, "states", (steps, columns))
    if len(path) != len(rows):
        raise InputError(f"states must be {len(rows)} finite rows, one per row seen, got {len(path)}")
    if not np.isfinite(path).all():
        t, column = (int(k) for k in np.argwhere(~np.isfinite(path))[0])
        raise InputError(f"states has {path[t, column]} at index [{t}, {column}]; every entry must be finite")
    drift = _drift(world, gains, path)
    certain = "" if _blurs(world, gains).any() else _NOISELESS if gains.any() else _BLIND
    found = _seen(_estimate_world(world, gains, seeing), rows - drift @ seeing.matrix.T, certain)
    return KalmanResult(found.means + drift, found.covariances, found.log_likelihood)


def _seen(world: LinearGaussianWorld, rows: Array, certain: str) -> KalmanResult:
    """Return the filter of what is seen of an agent's estimates, or raise an error that says why it has no density."""
    try:
        return kalman_filter(world, rows)
    except ModelError:
        raise ModelError(
            "what is seen of the agent's estimates has no density: "
            f"{certain or 'a part of it follows from the rest without noise'}; give the view noise, LinearView(matrix, noise)"
        ) from None


def _rows(given: Any, n_columns: int, name: str, axes: tuple[Axis, Axis]) -> Array:
    """Rows (T,n_columns), NaN where something is missing."""
    found = validation.real_array(given, name, axes[: depth(given)])
    found = found[:, None] if found.ndim == 1 else found
    if found.ndim != 2 or not len(found) or found.shape[1] != n_columns:
        raise InputError(f"{name} has shape {np.shape(given)}, expected (T,{n_columns}) with T at least 1")
    return found


def _gains(world: LinearGaussianWorld, n_steps: int) -> Array:
    """Return K_t of every step, shape (T,n,p); the gains do not depend on the observations."""
    nothing = np.zeros((n_steps, world.sensor.shape[-2]))
    try:
        later = kalman_filter(world, nothing).covariances
    except ModelError as error:
        raise ModelError(f"the agent has no filter of its own: {error}") from None
    found = []
    for t in range(n_steps):
        before = world.initial.covariance
        if t:
            move = at(world.transition, t - 1)
            before = move @ later[t - 1] @ move.T + at(world.process, t - 1)
        sensor = at(world.sensor, t)
        found.append(np.linalg.solve(sensor @ before @ sensor.T + at(world.noise, t), sensor @ before).T)
    return np.array(found)


def _moves(world: LinearGaussianWorld, gains: Array) -> Array:
    """(I − K_{t+1} C_{t+1}) A_t, shape (T,n,n); the last one is not used."""
    size = len(gains)
    kept = [np.eye(world.n_states) - gains[t] @ at(world.sensor, t) for t in range(1, size)]
    found = [each @ at(world.transition, t) for t, each in enumerate(kept)]
    return np.array([*found, np.eye(world.n_states)])


def _drift(world: LinearGaussianWorld, gains: Array, path: Array) -> Array:
    """Return the estimates under a noiseless sensor C x_t, shape (T,n)."""
    moves, mean = _moves(world, gains), world.initial.mean
    found = [mean + gains[0] @ at(world.sensor, 0) @ (path[0] - mean)]
    for t in range(1, len(path)):
        found.append(moves[t - 1] @ found[-1] + gains[t] @ at(world.sensor, t) @ path[t])
    return np.array(found)


def _blurs(world: LinearGaussianWorld, gains: Array) -> Array:
    """K_t R_t K_t' of every step, shape (T,n,n)."""
    return np.array([gain @ at(world.noise, t) @ gain.T for t, gain in enumerate(gains)])


def _estimate_world(world: LinearGaussianWorld, gains: Array, view: LinearView) -> LinearGaussianWorld:
    """The world of the estimate's deviation from its drift."""
    blurs = _blurs(world, gains)
    process = np.array([*blurs[1:], np.zeros_like(blurs[0])])
    return LinearGaussianWorld(
        _moves(world, gains), process, view.matrix, view.noise, (np.zeros(world.n_states), blurs[0])
    )


def _joint_world(world: LinearGaussianWorld, gains: Array, view: LinearView) -> LinearGaussianWorld:
    """The world of state and estimate together."""
    n, moves, blurs = world.n_states, _moves(world, gains), _blurs(world, gains)
    steps = len(gains)
    transition, process = np.zeros((steps, 2 * n, 2 * n)), np.zeros((steps, 2 * n, 2 * n))
    for t in range(steps - 1):
        move, through = at(world.transition, t), np.vstack([np.eye(n), gains[t + 1] @ at(world.sensor, t + 1)])
        transition[t, :n, :n], transition[t, n:, n:] = move, moves[t]
        transition[t, n:, :n] = through[n:] @ move
        process[t] = through @ at(world.process, t) @ through.T
        process[t, n:, n:] += blurs[t + 1]
    first, through = world.initial, np.vstack([np.eye(n), gains[0] @ at(world.sensor, 0)])
    spread = through @ first.covariance @ through.T
    spread[n:, n:] += blurs[0]
    matrix = np.column_stack([np.zeros_like(view.matrix), view.matrix])
    return LinearGaussianWorld(transition, process, matrix, view.noise, (np.tile(first.mean, 2), spread))
