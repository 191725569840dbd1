"""Estimate a sensor from sets of beliefs, such as those that explain decisions; some sets are points.

A set must not be replaced by its centre or its point of least norm: no step of the filter leads there. Where steps between
points determine the sensor, only these are used, and larger sets test whether a step of the filter leads into them. Otherwise a
multistart search finds members for which all steps are steps of one filter: entries on which the results agree are identified,
the others are not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linear_sum_assignment, minimize

from inscrutable import tolerances
from inscrutable.adversaries.sensor.fits import SensorFit, fitted, nothing_known
from inscrutable.adversaries.sensor.results import EstimatedSensor, SensorStatus
from inscrutable.adversaries.sensor.steps import filter_steps
from inscrutable.axes import Axis, few
from inscrutable.errors import InputError, ModelError
from inscrutable.geometry import BeliefSet
from inscrutable.validation import Array

_STARTS, _ROUNDS, _TRIED = 8, 6, 250
"""Random starts; rounds of fitting a sensor and projecting the filter's beliefs to the sets; sensors tried at the end."""

_SEED = 3
_AS_GOOD = 10.0
"""Results count if their residual is at most this many times the best."""


def sensor_of_sets(sets: Sequence[BeliefSet], transition: Array, n_symbols: int | None) -> EstimatedSensor:
    """Return the sensor estimated from sets that contain the beliefs of a filter, one set per step."""
    n_states = len(transition)
    corners = [_corners(k, each, n_states) for k, each in enumerate(sets)]
    is_point = np.array([np.ptp(each, axis=0).max() <= tolerances.EXACT_BELIEFS for each in corners])
    points = np.array(
        [
            each.mean(axis=0) if known else np.full(n_states, np.nan)
            for each, known in zip(corners, is_point, strict=True)
        ]
    )
    fit = _fit(points, transition, n_symbols)
    if fit is not None and fit.status is SensorStatus.IDENTIFIED:
        _, symbols, apart = _followed(points, sets, corners, fit.probabilities, transition)
        residual = max(float(apart.max()), fit.residual)
        status = (
            fit.status if residual <= tolerances.SETS_EXPLAINED + _AS_GOOD * fit.residual else SensorStatus.INCONSISTENT
        )
        return EstimatedSensor(fit.probabilities, symbols, residual, status, fit.intervals, fit.noise)
    return _searched(points, sets, corners, transition, n_symbols)


def sets_in_order(sets: Sequence[BeliefSet], states: Axis) -> list[BeliefSet]:
    """Return sets with their states in the order of a transition's; raise `InputError` where that is not known."""
    orders = dict.fromkeys(each.state_names for each in sets if each.state_names is not None)
    if states.names is None and len(orders) > 1:
        raise InputError(
            f"beliefs have their states in several orders, {few(map(list, orders))}, and transition has no labels: label it"
        )
    return [_in_order(f"beliefs[{k}]", each, states) for k, each in enumerate(sets)]


def _in_order(name: str, found: BeliefSet, states: Axis) -> BeliefSet:
    order = None if found.state_names is None else states.order(found.state_names, name)
    if order is None:
        return found
    return replace(
        found,
        equalities=found.equalities[:, order],
        inequalities=found.inequalities[:, order],
        state_names=states.names,
    )


def _corners(number: int, found: BeliefSet, n_states: int) -> Array:
    """Return the corners of a set, or raise `InputError` where it is empty."""
    if found.n_states != n_states:
        raise InputError(f"beliefs[{number}] is over {found.n_states} states, transition has {n_states}")
    if found.is_empty:
        raise InputError(
            f"beliefs[{number}] is empty: no belief explains the decision; leave out decisions that none explains"
        )
    return found.vertices()


def _fit(beliefs: Array, transition: Array, n_symbols: int | None) -> SensorFit | None:
    """Return the fit of all steps between known beliefs; None where there is no such step of a filter."""
    try:
        steps = filter_steps(beliefs[:-1], beliefs[1:], transition)
    except ModelError:
        return None
    return fitted(steps, n_symbols) if len(steps.numbers) else None


def _followed(
    points: Array, sets: Sequence[BeliefSet], corners: list[Array], sensor: Array, transition: Array
) -> tuple[Array, np.ndarray, Array]:
    """Return the members (T,X) of the sets nearest to the filter's beliefs, the symbols, and the distances (T−1,)."""
    held, symbols, apart = points.copy(), np.full(len(points) - 1, -1), np.zeros(len(points) - 1)
    for k in range(1, len(points)):
        before = held[k - 1]
        if not np.isfinite(before).all():
            continue
        joint = (before @ transition) * sensor.T
        total = joint.sum(axis=1, keepdims=True)
        some = np.flatnonzero(total[:, 0] > 0)
        ends = joint[some] / total[some]
        members = np.array([_nearest(sets[k], corners[k], end) for end in ends])
        gaps = np.linalg.norm(members - ends, axis=1)
        best = int(gaps.argmin())
        symbols[k - 1], apart[k - 1], held[k] = some[best], gaps[best], members[best]
    return held, symbols, apart


def _nearest(found: BeliefSet, corners: Array, belief: Array) -> Array:
    """Return the member of a set nearest to a belief; directly for points and segments."""
    if len(corners) > 2:
        return found.nearest(belief)
    along = corners[-1] - corners[0]
    size = float(along @ along)
    share = min(max(float((belief - corners[0]) @ along) / size, 0.0), 1.0) if size > 0 else 0.0
    return np.asarray(corners[0] + share * along)


def _searched(
    points: Array, sets: Sequence[BeliefSet], corners: list[Array], transition: Array, n_symbols: int | None
) -> EstimatedSensor:
    """Return a sensor for which members of all sets form one filter run, and the range over the starts."""
    rng = np.random.default_rng(_SEED)
    known = np.isfinite(points).all(axis=1)
    answers: list[tuple[float, Array, np.ndarray]] = []
    for _ in range(_STARTS):
        held = np.array([rng.dirichlet(np.ones(len(each))) @ each for each in corners])
        held[known] = points[known]
        start = points.copy()
        start[0] = held[0]

        def follow(sensor: Array, start: Array = start) -> tuple[Array, float]:
            members, symbols, apart = _followed(start, sets, corners, sensor, transition)
            answers.append((float(apart.max()), sensor, symbols))
            return members, float((apart**2).sum())

        last: Array | None = None
        for _ in range(_ROUNDS):
            fit = _fit(held, transition, n_symbols)
            if fit is None:
                break
            last = fit.probabilities
            held, _loss = follow(last)
        if last is not None:
            _tried(follow, last)
    if not answers:
        symbols = np.full(len(points) - 1, -1)
        return nothing_known(len(transition), n_symbols or 1, symbols, SensorStatus.SETS)
    residual, sensor, symbols = min(answers, key=lambda each: each[0])
    limit = max(_AS_GOOD * residual, tolerances.SETS_EXPLAINED)
    kept = [_renamed(each, sensor) for off, each, _ in answers if off <= limit and each.shape == sensor.shape]
    intervals = np.stack([np.min(kept, axis=0), np.max(kept, axis=0)], axis=2)
    status = SensorStatus.SETS if residual <= tolerances.SETS_EXPLAINED else SensorStatus.INCONSISTENT
    return EstimatedSensor(sensor, symbols, residual, status, intervals)


def _tried(follow: Callable[[Array], tuple[Array, float]], first: Array) -> None:
    """Search from a first sensor by the Nelder–Mead method until one explains all sets."""

    def sensor_at(logits: Array) -> Array:
        weights = np.exp(logits.reshape(first.shape) - logits.reshape(first.shape).max(axis=1, keepdims=True))
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))

    start = np.log(np.maximum(first, tolerances.SAME_BELIEF))
    free = start - start[:, -1:]

    def loss(steps: Array) -> float:
        return follow(sensor_at(free + np.column_stack([steps.reshape(len(first), -1), np.zeros(len(first))])))[1]

    size = len(first) * (first.shape[1] - 1)
    if size:
        minimize(
            loss, np.zeros(size), method="Nelder-Mead", options={"maxfev": _TRIED, "initial_simplex": _around(size)}
        )


def _around(size: int) -> Array:
    """Return the corners of the initial Nelder–Mead simplex."""
    return np.vstack([np.zeros(size), 0.2 * np.eye(size)])


def _renamed(sensor: Array, like: Array) -> Array:
    """Permute a sensor's symbols to match another sensor best."""
    apart = ((sensor[:, :, None] - like[:, None, :]) ** 2).sum(axis=0)
    rows, columns = linear_sum_assignment(apart)
    return np.asarray(sensor[:, rows[np.argsort(columns)]])
