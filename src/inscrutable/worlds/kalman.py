"""The private belief of a linear Gaussian world: mean and covariance given the observations so far."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve, solve_discrete_are

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, depth, ordered
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array
from inscrutable.worlds.linear_gaussian import LinearGaussianWorld, at
from inscrutable.worlds.observations import Labels, in_rows, is_labelled, row_name
from inscrutable.worlds.public import PublicPart

_MOST_STEPS = 10_000
_OPERATIONS = 16.0
"""Roundings of the largest term that a prediction may add up to. Of 1,500 drawn worlds with scales up to 1e5 apart and singular
noises none is refused, 4 without a rounding; 22 of the hardest, solved to 120 digits, differ by 3e-11 at most."""


@dataclass(frozen=True, eq=False)
class KalmanResult:
    """Beliefs N(m_t, P_t) over time, each from the observations up to its own row.

    Unpacks as (means, covariances, log_likelihood).

    Args:
        means: (T,n), m_t = E[x_t | y_0..t, z_0..t]; a DataFrame where the observations have labels.
        covariances: (T,n,n), P_t. They depend on the matrices and on which observations are missing, not on their values.
        log_likelihood: Natural logarithm of the density of all observations.

    Example:
        >>> world = LinearGaussianWorld([[0.9]], [[0.19]], [[1.0]], [[1.0]])
        >>> means, covariances, log_likelihood = kalman_filter(world, [1.0, np.nan])
        >>> means.ravel().tolist()
        [0.5, 0.45]
    """

    means: Any
    covariances: Array
    log_likelihood: float

    def __iter__(self) -> Iterator[Any]:
        return iter((self.means, self.covariances, self.log_likelihood))

    def __str__(self) -> str:
        steps, n = np.shape(self.means)
        return f"Kalman filter: {steps} steps, {n} states, log-likelihood {self.log_likelihood:.6g}"


def _check_world(world: Any) -> None:
    if not isinstance(world, LinearGaussianWorld):
        raise InputError(f"world must be a LinearGaussianWorld, got {world!r}")


def kalman_filter(
    world: LinearGaussianWorld, observations: Any, *, public: Any = None, gaps: ArrayLike | None = None
) -> KalmanResult:
    """Return the beliefs N(m_t, P_t) of an agent given `observations`, and `public` ones, row by row.

    Formula: P⁻ = A P A' + Q, S = C P⁻ C' + R, K = P⁻ C' S⁻¹, m = A m + K (y − C A m), P = (I − K C) P⁻ (I − K C)' + K R K',
    with the rows of C that were observed. More rows never change an earlier belief.

    Args:
        world: The world; the law of x_0 holds before the first row.
        observations: (T,p), or (T,) where p is 1; NaN is missing. Labelled columns are aligned with the sensor's.
        public: (T,q), the reports of the world's public sensor; NaN is missing. None where it has none, or a `PublicPart`.
        gaps: Which observations are publicly known to be missing, (T,) rows or (T,p) entries, True where missing. Another
            missing observation is refused, because P_t would then be private as well. Labels are aligned with the
            observations'. None: it is public which are missing.

    Returns:
        A `KalmanResult`.

    Raises:
        InputError: Shapes or labels disagree, an entry is infinite, a gap is not among the known ones (its row is named).
        ModelError: The observations have no density (S is singular; the step is named), or there is no law of x_0.

    Cost: O(T (n³ + p³)). Source: Kalman, Journal of Basic Engineering 82 (1960).

    Example:
        >>> world = LinearGaussianWorld([[0.9]], [[0.19]], [[1.0]], [[1.0]])
        >>> kalman_filter(world, [1.0, np.nan]).covariances.ravel().round(4).tolist()
        [0.5, 0.595]
    """
    _check_world(world)
    if is_labelled(observations):
        validation.time_order(observations.index, "observations")
    values = _rows(observations, world.sensor.shape[-2], world.observation_names, "observations")
    _check_gaps(values, gaps, observations, world.observation_names)
    if world.n_steps is not None and len(values) > world.n_steps:
        raise InputError(f"observations have {len(values)} rows, but the world's matrices say {world.n_steps} steps")
    read = np.column_stack([values, _public_rows(world, observations, len(values), public)])
    means, covariances = np.empty((len(read), world.n_states)), np.empty((len(read), *(2 * (world.n_states,))))
    (mean, spread), total = world.initial, 0.0
    for t, row in enumerate(read):
        if t:
            move = at(world.transition, t - 1)
            mean, spread = move @ mean, _symmetric(move @ spread @ move.T + at(world.process, t - 1))
        there = ~np.isnan(row)
        if there.any():
            sensor, noise = world.agents_sensor(t)
            told = sensor[there], noise[np.ix_(there, there)]
            try:
                mean, spread, gained = _updated(mean, spread, row[there], *told)
            except np.linalg.LinAlgError:
                raise ModelError(
                    f"the observation in row {row_name(observations, t)} has no density: C P C' + R is singular, so that a "
                    "column is known without noise from the others: leave it out, or add noise"
                ) from None
            total += gained
        means[t], covariances[t] = mean, spread
    if is_labelled(observations):
        import pandas as pd

        columns = None if world.names is None else list(world.names)
        return KalmanResult(pd.DataFrame(means, index=observations.index, columns=columns), covariances, float(total))
    return KalmanResult(means, covariances, float(total))


@dataclass(frozen=True, eq=False)
class SteadyFilter:
    """The steady state of the agent's filter in a world that does not change: m_{t+1} = A m_t + K ν_t with ν ~ N(0, S).

    Args:
        predicted_covariance: P⁻, error covariance of the prediction of x_t, shape (n,n).
        covariance: P⁺, error covariance of m_t, shape (n,n).
        gain: K, shape (n,p), or (n,p+q) where a public sensor stands beside the private one.
        innovation_covariance: W = K S K' = P⁻ − P⁺, the covariance of m_{t+1} − A m_t, shape (n,n).
        public_sensor: H = C_z A, with E[z_{t+1} | m_t] = H m_t, shape (q,n); q is 0 where nothing is public.
        cross_covariance: N = cov(K ν, ν_z), shape (n,q), ν_z = z_{t+1} − H m_t.
        public_covariance: R = cov(ν_z), shape (q,q).

    Example:
        >>> steady = steady_filter(LinearGaussianWorld([[1.0]], [[1.0]], [[1.0]], [[1.0]]))
        >>> round(float(steady.covariance[0, 0]), 6)
        0.618034
    """

    predicted_covariance: Array
    covariance: Array
    gain: Array
    innovation_covariance: Array
    public_sensor: Array
    cross_covariance: Array
    public_covariance: Array

    def __str__(self) -> str:
        n, q = self.cross_covariance.shape
        return f"Steady filter: {n} states, {q} public columns, variance {np.trace(self.covariance):.6g} left in all"


def steady_filter(world: LinearGaussianWorld) -> SteadyFilter:
    """Return the steady Kalman filter of an agent in a world that does not change with time.

    Formula: P⁻ = A (P⁻ − P⁻C'S⁻¹CP⁻) A' + Q, P⁺ = P⁻ − P⁻C'S⁻¹CP⁻, W = P⁻ − P⁺, S = C P⁻ C' + R.

    Args:
        world: The world; it need not be stable where the sensor observes all unstable modes.

    Raises:
        InputError: `world` is no linear Gaussian world.
        ModelError: Matrices change with time, or no filter converges: a mode that the sensor does not observe grows, or sensors
            without noise leave more rounding than `tolerances.ROUNDED_RICCATI`.

    Cost: O(n³), or up to 10,000 predictions where noises are singular.

    Source: Anderson and Moore, Optimal Filtering (1979), chapter 4.

    Example:
        >>> steady_filter(LinearGaussianWorld([[0.9]], [[0.19]], [[1.0]], [[1e9]])).predicted_covariance.round(6).tolist()
        [[1.0]]
    """
    _check_world(world)
    world.check_constant("a steady filter")
    (sensor, noise), move = world.agents_sensor(0), world.transition
    return filter_at(world, _riccati(move, world.process, sensor, noise), move)


def filter_at(world: LinearGaussianWorld, predicted: Array, move: Array) -> SteadyFilter:
    """Return the filter of one step, for a prediction with the error covariance `predicted` that was moved by `move`."""
    sensor, noise = world.agents_sensor(0)
    read = _symmetric(sensor @ predicted @ sensor.T + noise)
    gain = _gain(predicted, sensor, noise)
    covariance = _joseph(predicted, gain, sensor, noise)
    if world.public is None:
        seen = np.zeros((0, len(sensor)))
    elif isinstance(world.public, PublicPart):
        seen = world.public.matrix
    else:
        seen = np.eye(len(sensor))[-len(world.public[0]) :]
    return SteadyFilter(
        predicted,
        covariance,
        gain,
        _symmetric(gain @ read @ gain.T),
        seen @ sensor @ move,
        gain @ read @ seen.T,
        _symmetric(seen @ read @ seen.T),
    )


def _riccati(move: Array, process: Array, sensor: Array, noise: Array) -> Array:
    """The P⁻ to which predictions converge."""
    try:
        found = _symmetric(np.asarray(solve_discrete_are(move.T, sensor.T, process, noise)))
        residual = np.abs(_predicted(found, move, process, sensor, noise) - found).max()
        if residual <= tolerances.RICCATI * np.abs(found).max() and np.isfinite(residual):
            return found
    except (np.linalg.LinAlgError, ValueError):
        pass  # singular noise, or eigenvalues on the unit circle that no noise excites: the iteration below converges
    found, last = process + np.eye(len(process)) * np.abs(process).max(), np.inf
    for _ in range(_MOST_STEPS):
        after = _predicted(found, move, process, sensor, noise)
        change, size = float(np.abs(after - found).max()), float(np.abs(after).max())
        if not np.isfinite(size) or size > 1.0 / tolerances.RICCATI * max(np.abs(process).max(), np.abs(noise).max()):
            raise ModelError(
                "no filter converges in this world: a mode that the sensor does not observe grows without bound"
            )
        is_near = change >= last and change <= tolerances.ROUNDED_RICCATI * size
        if is_near and change <= max(tolerances.RICCATI * size, _rounding(found, move, sensor, noise)):
            return after  # down to rounding
        found, last = after, change if change else -1.0
    raise ModelError(
        f"no filter converges in this world: after {_MOST_STEPS} steps its covariance still changes by {last:.1e}"
    )


def _predicted(before: Array, move: Array, process: Array, sensor: Array, noise: Array) -> Array:
    return _symmetric(move @ _joseph(before, _gain(before, sensor, noise), sensor, noise) @ move.T + process)


def _rounding(before: Array, move: Array, sensor: Array, noise: Array) -> float:
    """Rounding of one prediction: without noise in a sensor, gains times noises are far larger than the covariance."""
    gain = np.abs(_gain(before, sensor, noise))
    left = np.eye(len(before)) + gain @ np.abs(sensor)
    largest = np.abs(move) @ (left @ np.abs(before) @ left.T + gain @ np.abs(noise) @ gain.T) @ np.abs(move).T
    return float(_OPERATIONS * np.finfo(np.float64).eps * largest.max())


def _gain(before: Array, sensor: Array, noise: Array) -> Array:
    """P⁻ C' S⁺, also for a singular S.

    S is scaled to a unit diagonal, as its rounding is relative to its own rows: where these lie decades apart, the rank of S
    otherwise changes from step to step.
    """
    read = sensor @ before @ sensor.T + noise
    unit = np.sqrt(np.diag(read))
    unit[unit == 0.0] = 1.0
    scaled = np.linalg.lstsq(read / np.outer(unit, unit), sensor @ before / unit[:, None], rcond=None)[0]
    return np.asarray(scaled.T / unit, dtype=np.float64)


def _joseph(before: Array, gain: Array, sensor: Array, noise: Array) -> Array:
    """The covariance after an observation in Joseph's form, without a difference of large numbers."""
    left = np.eye(len(before)) - gain @ sensor
    return _symmetric(left @ before @ left.T + gain @ noise @ gain.T)


def _updated(mean: Array, spread: Array, row: Array, sensor: Array, noise: Array) -> tuple[Array, Array, float]:
    read = _symmetric(sensor @ spread @ sensor.T + noise)
    factor = cho_factor(read, lower=True)
    if (np.diag(factor[0]) ** 2 <= tolerances.DEFINITE * np.diag(read)).any():
        raise np.linalg.LinAlgError("a pivot is rounding")
    gain = cho_solve(factor, sensor @ spread).T
    missed = row - sensor @ mean
    log_size = 2.0 * float(np.log(np.diag(factor[0])).sum()) + len(row) * float(np.log(2.0 * np.pi))
    gained = -0.5 * (log_size + float(missed @ cho_solve(factor, missed)))
    return mean + gain @ missed, _joseph(spread, gain, sensor, noise), gained


def _symmetric(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + matrix.T))


def _rows(given: Any, n_columns: int, names: Labels | None, name: str) -> Array:
    """Rows (T, n_columns), NaN where something is missing."""
    axes = (None, Axis("column", names)) if depth(given) > 1 else (None,)
    values = validation.real_array(given, name, axes)
    rows = values[:, None] if values.ndim == 1 else values
    if rows.ndim != 2 or not len(rows) or rows.shape[1] != n_columns:
        raise InputError(f"{name} have shape {values.shape}, expected (T,{n_columns}) with T >= 1")
    bad = np.argwhere(np.isinf(rows))
    if bad.size:
        t, column = (int(k) for k in bad[0])
        raise InputError(f"{name} have {rows[t, column]} in row {row_name(given, t)}, column {column}; NaN is missing")
    return rows


def _public_rows(world: LinearGaussianWorld, observations: Any, n_rows: int, public: Any) -> Array:
    if world.public is None or isinstance(world.public, PublicPart):
        if public is not None:
            raise InputError(
                "public observations were given, but the world has no public sensor beside the private one"
            )
        return np.zeros((n_rows, 0))
    if public is None:
        raise InputError("the world has a public sensor: pass its reports as `public`")
    rows = _rows(in_rows(public, _steps_of(observations), "public"), len(world.public[0]), world.public_names, "public")
    if len(rows) != n_rows:
        raise InputError(f"public has {len(rows)} rows, expected one per observation: {n_rows}")
    return rows


def _steps_of(observations: Any) -> Axis:
    steps = Axis("row", learns=True)
    if is_labelled(observations):
        steps.order(tuple(observations.index), "observations")
    return steps


def _check_gaps(values: Array, gaps: Any, observations: Any, names: Labels | None) -> None:
    if gaps is None:
        return
    axes = (_steps_of(observations), Axis("column", names))
    known = np.asarray(ordered(gaps, "gaps", axes[: depth(gaps)]))
    if known.dtype != np.bool_ or known.shape not in (values.shape, values.shape[:1]):
        raise InputError(f"gaps must be True or False of shape {values.shape[:1]} or {values.shape}, got {known.shape}")
    missing, told = np.isnan(values), known.reshape(len(values), -1) & np.ones(values.shape, dtype=np.bool_)
    wrong = np.argwhere(missing != told)
    if wrong.size:
        t, column = (int(k) for k in wrong[0])
        what = "is missing, which is not public" if missing[t, column] else "is there, but gaps say it is missing"
        raise InputError(
            f"the observation in row {row_name(observations, t)}, column {column} {what}: the covariance of the belief would "
            "be private; it must be public which observations are missing"
        )
