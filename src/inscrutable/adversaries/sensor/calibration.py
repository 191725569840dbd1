"""A sensor's parameters from decisions under known states, by maximum likelihood."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize, minimize_scalar

from inscrutable import tolerances, validation
from inscrutable.adversaries.sensor.calibration_results import CalibratedSensor, LikelihoodStatus
from inscrutable.adversaries.sensor.families import SensorFamily
from inscrutable.adversaries.sensor.fits import QUANTILE
from inscrutable.adversaries.sensor.inverse_kalman import LinearView, inverse_kalman_filter
from inscrutable.adversaries.sensor.known_states import KnownStates, is_simple, plays_in
from inscrutable.adversaries.sequential import SequentialAdversary
from inscrutable.axes import Axis, depth, ordered
from inscrutable.errors import InputError, ModelError
from inscrutable.mechanisms import Mechanism
from inscrutable.mechanisms.memory import MechanismRule, MemoryMechanism
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel
from inscrutable.worlds.hidden_markov import default_names
from inscrutable.worlds.linear_gaussian import LinearGaussianWorld
from inscrutable.worlds.observations import symbols

_POINTS = 17
"""Number of values of each parameter at which the profile is computed."""

_DROP = 0.5 * QUANTILE**2
"""Decrease of the log-likelihood at the ends of a 95 % interval of one parameter."""

_STARTS = 8
"""Number of starts with unequal parameters: where the parameters of all states are equal, the likelihood has no slope."""

_GAIN = 0.01
"""Gain from which profiles are computed again where one comes upon a better sensor; intervals end at a fall of 1.92."""

_ROUNDS = 4
"""Most times that profiles are computed."""

_HALVINGS = 4
"""Halvings of a cell of the profile in search of an interval's end, which is then too far out by at most a sixteenth."""

_MISLED = 2.0
"""Times the curvature's interval, on one side, from which the profile contradicts the curvature. In 100
fits of 60 or 200 decisions that are smooth in the sensor the largest is 1.6."""

_LEAST = -1e12
"""Replaces the logarithm of zero in the maximisation."""

KnownMechanism = Mechanism | MemoryMechanism | MechanismRule | LinearView | Callable[[HiddenMarkovModel], Any]


def calibrate_sensor(
    actions: ArrayLike,
    states: ArrayLike,
    mechanism: KnownMechanism,
    family: SensorFamily | Callable[..., Any],
    *,
    world: HiddenMarkovModel | LinearGaussianWorld,
    n_particles: int = 0,
    rng: np.random.Generator | None = None,
) -> CalibratedSensor:
    """Return the parameters of an agent's sensor from its decisions, where the states are known.

    Formula: θ̂ = argmax_θ Σ_t log Pr_θ(u_t | u_0..u_{t−1}, x_0..x_t), the normalisers of the inverse filter
    `SequentialAdversary`.

    Args:
        actions: u_0..u_{T−1}, as `SequentialAdversary.filter` takes them.
        states: x_0..x_{T−1}, whole numbers from 0. Labelled rows are aligned with those of the decisions.
        mechanism: The agent's mechanism on a grid of beliefs, interpolated between them. Or a function that takes a world and
            returns a mechanism; on `reachable_beliefs` of that world the likelihood is exact for every sensor.
        family: The candidate sensors; a plain function of K probabilities is a family with K parameters between 0 and 1.
        world: The agent's world; each sensor of the family replaces its sensor. A family of linear Gaussian worlds replaces all
            of it.
        n_particles: Number of particles, for sensors that report real numbers; all sensors use the same draws.
        rng: The source of the particles' draws.

    Returns:
        A `CalibratedSensor`; its status says whether the likelihood has one maximum, an open interval, no slope, several
        maxima, or is zero. A family in which the symbols of a sensor may change places has several, all as likely. So may
        decisions that change with the sensor, whose likelihood jumps.

    Raises:
        InputError: States are out of range, their number differs from that of the decisions, the family is malformed or has
            other state labels than the world, or the world has a public sensor.
        ModelError: The world rules the states out.

    Cost: one run of the inverse filter for each sensor tried: about 60 for one parameter, 1,000 to 4,000 for two, some 20,000
    for four.

    Source: Krishnamurthy, Rangaswamy, arXiv 1905.07230; Mattila, Lourenço, Krishnamurthy, Rojas, Wahlberg, arXiv 1910.07332.

    Example:
        >>> from inscrutable import CategoricalEmission, Mechanism
        >>> world = HiddenMarkovModel([[0.5, 0.5], [0.5, 0.5]], CategoricalEmission([[0.8, 0.2], [0.2, 0.8]]))
        >>> grid = np.c_[np.linspace(0, 1, 11), np.linspace(1, 0, 11)]
        >>> open_book = Mechanism(grid, np.arange(2), grid, 0.0 * grid)  # plays 0 as often as it believes in state 0
        >>> found = calibrate_sensor([0, 0, 1, 0] * 50, [0] * 200, open_book, SensorFamily.accuracy(2), world=world)
        >>> found.parameters.round(3), found.is_identified
        (array([0.854]), True)
    """
    sensors = SensorFamily.of(family)
    if isinstance(mechanism, LinearView):
        return _calibrated(_linear_likelihood(actions, states, mechanism, sensors), sensors)
    if not isinstance(world, HiddenMarkovModel):
        raise InputError(f"world must be a HiddenMarkovModel, or the mechanism a LinearView, got {world!r}")
    if world.public is not None:
        raise InputError(f"calibrate_sensor needs a world without a public sensor, got {world!r}")
    steps = Axis("step", learns=True)
    ordered(actions, "actions", (steps, None)[: depth(actions)])
    path = symbols(states, world.n_states, "states", steps)
    count = validation.count(n_particles, "n_particles", least=0)
    seed = int(validation.generator(rng).integers(2**31)) if count else 0

    def log_likelihood(parameters: Array) -> float:
        known = with_sensor(world, sensors(*parameters))
        plays = mechanism_in(mechanism, known)
        if not count and is_simple(plays, known):
            if plays is not numbered.get("mechanism"):
                numbered.update(mechanism=plays, columns=plays_in(plays, actions, len(path)))
            quick = KnownStates(known, plays).log_likelihoods(numbered["columns"], path)[0]
            if np.isfinite(quick):
                return float(quick)
        draws = np.random.default_rng(seed) if count else None
        found = SequentialAdversary(known, plays, n_particles=count, rng=draws).filter(actions, states=path)
        return float(found.log_likelihood.sum()) - told

    numbered: dict[str, Any] = {}
    told = log_probability(path, world)
    return _calibrated(log_likelihood, sensors)


def _linear_likelihood(
    actions: ArrayLike, states: ArrayLike, view: LinearView, family: SensorFamily
) -> Callable[[Array], float]:
    """The likelihood of linear decisions, by the inverse Kalman filter."""

    def log_likelihood(parameters: Array) -> float:
        return inverse_kalman_filter(family(*parameters), actions, view, states=states).log_likelihood

    return log_likelihood


def with_sensor(world: HiddenMarkovModel, sensor: Any) -> HiddenMarkovModel:
    """Return a world with another sensor, whose labels name the states where the world's are numbers."""
    names = None if world.names == default_names(world.n_states) else world.names
    return HiddenMarkovModel(world.transition, sensor, world.initial, names=names, public=world.public)


def mechanism_in(given: KnownMechanism, world: HiddenMarkovModel) -> Any:
    """Return a mechanism, or the value of a function at a world."""
    if isinstance(given, (Mechanism, MemoryMechanism)) or hasattr(given, "mechanism_for"):
        return given
    if not callable(given):
        raise InputError(f"mechanism must be a Mechanism, or a function of a world that returns one, got {given!r}")
    return given(world)


def log_probability(path: np.ndarray, world: HiddenMarkovModel, name: str = "states") -> float:
    """Return log Pr(x_0..x_{T−1}), which does not depend on the sensor; raise `ModelError` where it is impossible."""
    shares = np.concatenate([world.initial[path[:1]], world.transition[path[:-1], path[1:]]])
    impossible = np.flatnonzero(shares <= 0.0)
    if impossible.size:
        step = impossible[0]
        raise ModelError(f"{name} cannot occur in the world: state {path[step]} at step {step}")
    return float(np.log(shares).sum())


class _Bounded:
    """A likelihood as a function within a family's bounds, which keeps its values."""

    def __init__(self, log_likelihood: Callable[[Array], float], bounds: Array) -> None:
        self._log_likelihood, self._bounds = log_likelihood, bounds
        self.known: dict[bytes, float] = {}

    def __call__(self, parameters: Array) -> float:
        inside = np.clip(parameters, self._bounds[:, 0], self._bounds[:, 1])
        key = inside.tobytes()
        if key not in self.known:
            self.known[key] = max(self._log_likelihood(inside), _LEAST)
        return self.known[key]

    def bettered(self, point: Array) -> Array:
        """Return the likeliest point so far, the given one where none is likelier."""
        found = np.frombuffer(max(self.known, key=lambda each: self.known[each])).copy()
        return found if self(found) > self(point) else point


def _calibrated(log_likelihood: Callable[[Array], float], family: SensorFamily) -> CalibratedSensor:
    """Return the maximum of a likelihood within a family's bounds, with its profile and curvature."""
    bounded = _Bounded(log_likelihood, family.bounds)
    grids = np.linspace(family.bounds[:, 0], family.bounds[:, 1], _POINTS).T
    maxima = _maxima(bounded, family, grids)
    if max(map(bounded, maxima)) <= _LEAST:
        middle = family.bounds.mean(axis=1)
        return _nothing(family, grids, middle, LikelihoodStatus.IMPOSSIBLE)
    best, profile = _searched(bounded, family, grids, maxima)
    top = bounded(best)
    places = [int(np.searchsorted(values, value)) for values, value in zip(grids, best, strict=True)]
    grid, profile = _inserted(grids, places, best), _inserted(profile, places, np.full(len(best), top))
    information = _curvature(bounded, best, top, family.bounds)
    curved = _intervals(information, best, family.bounds)
    intervals = _widened(bounded, family.bounds, best, curved, grid, profile)
    misled = (np.abs(intervals - best[:, None]) > _MISLED * np.abs(curved - best[:, None])).any(axis=1)
    information[misled], information[:, misled] = np.nan, np.nan
    profile[profile <= _LEAST] = -np.inf
    plausible = [each for each in maxima if bounded(each) >= top - _DROP]
    is_apart = any(((each < curved[:, 0]) | (each > curved[:, 1])).any() for each in plausible)
    status = _status(profile, top, min(bounded.known.values()), is_apart or bool(misled.any()))
    return CalibratedSensor(best, intervals, profile, status, grid, family.names, information)


def _searched(bounded: _Bounded, family: SensorFamily, grids: Array, maxima: list[Array]) -> tuple[Array, Array]:
    """Return the likeliest parameters (K,) and the profile (K,G); maxima that profiles come upon are added to the list."""
    best = max(maxima, key=bounded)
    for _ in range(_ROUNDS):
        profile = _profiles(bounded, family, grids, best, maxima)
        found = bounded.bettered(best)
        if bounded(found) <= bounded(best) + _GAIN:
            break
        best = _climbed(bounded, found, family.bounds)
        maxima.append(best)
    return bounded.bettered(best), profile


def _nothing(family: SensorFamily, grids: Array, middle: Array, status: LikelihoodStatus) -> CalibratedSensor:
    none = np.full(grids.shape, -np.inf)
    return CalibratedSensor(
        middle, family.bounds, none, status, grids, family.names, np.zeros((len(family), len(family)))
    )


def _inserted(table: Array, places: list[int], values: Array) -> Array:
    """Return a table (K,G) with one more value in every row, before a place of its own."""
    return np.array([np.insert(*each) for each in zip(table, places, values, strict=True)])


def _maxima(bounded: Callable[[Array], float], family: SensorFamily, grids: Array) -> list[Array]:
    """Return local maxima (K,) of the likelihood: of one parameter the largest, by a scan and Brent's method."""
    low, high = family.bounds.T
    if len(family) == 1:
        values = np.array([bounded(np.array([each])) for each in grids[0]])
        k = int(values.argmax())
        ends = grids[0][max(k - 1, 0)], grids[0][min(k + 1, _POINTS - 1)]
        found = minimize_scalar(
            lambda each: -bounded(np.array([each])),
            bounds=ends,
            method="bounded",
            options={"xatol": tolerances.PARAMETER_PLACE * (high - low)[0]},
        )
        return [np.array([float(found.x)]) if -found.fun >= values[k] else grids[:, k]]
    from scipy.stats import qmc  # slow to import

    uneven = qmc.Halton(len(family), scramble=False).fast_forward(1).random(_STARTS)  # its first point is a corner
    shares = np.vstack([np.outer([0.5, 0.3, 0.7], np.ones(len(family))), uneven])
    return [_climbed(bounded, start, family.bounds) for start in low + shares * (high - low)]


def _climbed(bounded: Callable[[Array], float], start: Array, bounds: Array, held: int | None = None) -> Array:
    """Return a local maximum from a start; one parameter may be held fixed."""
    free = np.array([k for k in range(len(start)) if k != held])
    width = (bounds[:, 1] - bounds[:, 0])[free]

    def loss(shares: Array) -> float:
        point = start.copy()
        point[free] = bounds[free, 0] + shares * width
        return -bounded(point)

    first = (start[free] - bounds[free, 0]) / width
    found = minimize(
        loss,
        first,
        method="L-BFGS-B",
        bounds=[(0.0, 1.0)] * len(free),
        options={"eps": tolerances.PARAMETER_SLOPE, "maxiter": 60},
    )
    point = start.copy()
    point[free] = bounds[free, 0] + found.x * width
    return point


def _profiles(
    bounded: Callable[[Array], float], family: SensorFamily, grids: Array, best: Array, maxima: list[Array]
) -> Array:
    """Return the largest likelihood over the other parameters at values of each one, shape (K,G).

    The search begins at its end for the value before, or at the local maximum nearest to the value if that is likelier.
    """
    profile = np.empty(grids.shape)
    for k, values in enumerate(grids):
        near = {-1: best, 1: best}
        for place in np.argsort(np.abs(values - best[k]), kind="stable"):
            value = values[place]
            side = 1 if value >= best[k] else -1
            nearest = maxima[int(np.argmin([abs(each[k] - value) for each in maxima]))]
            starts = np.array([near[side], nearest])
            starts[:, k] = value
            found = max(starts, key=bounded)
            near[side] = found if len(best) == 1 else _climbed(bounded, found, family.bounds, held=k)
            profile[k, place] = bounded(near[side])
    return profile


def _curvature(bounded: Callable[[Array], float], best: Array, top: float, bounds: Array) -> Array:
    """Return −∂² log L at the maximum, by differences over steps at which the likelihood falls by about half."""
    count, width = len(best), bounds[:, 1] - bounds[:, 0]
    steps = np.empty(count)
    for k in range(count):
        step = 0.01 * width[k]
        for _ in range(4):
            fall = max(top - min(bounded(moved) for moved in _both(best, k, step)), 0.0)
            step = float(
                np.clip(
                    step * np.sqrt(0.5 / max(fall, tolerances.TINY)), tolerances.SCORE_STEP * width[k], 0.25 * width[k]
                )
            )
        room = min(best[k] - bounds[k, 0], bounds[k, 1] - best[k])
        steps[k] = step if room <= 0.1 * step else min(step, room)
    found = np.empty((count, count))
    for k in range(count):
        low, high = (bounded(moved) for moved in _both(best, k, steps[k]))
        found[k, k] = (2.0 * top - low - high) / steps[k] ** 2
        for j in range(k):
            corners = [
                sign_k
                * sign_j
                * bounded(best + sign_k * steps[k] * np.eye(count)[k] + sign_j * steps[j] * np.eye(count)[j])
                for sign_k in (-1.0, 1.0)
                for sign_j in (-1.0, 1.0)
            ]
            found[k, j] = found[j, k] = -sum(corners) / (4.0 * steps[k] * steps[j])
    return found


def _both(best: Array, k: int, step: float) -> tuple[Array, Array]:
    """Return a point moved down and up along one parameter."""
    along = step * np.eye(len(best))[k]
    return best - along, best + along


def _intervals(information: Array, best: Array, bounds: Array) -> Array:
    """Return 95 % intervals (K,2) within the bounds; the bounds where the likelihood is not concave."""
    width = bounds[:, 1] - bounds[:, 0]
    scaled = information * np.outer(width, width)
    values = np.linalg.eigvalsh(scaled)
    if not values[0] > tolerances.CURVATURE * max(values[-1], 1.0):
        return bounds.copy()
    half = QUANTILE * width * np.sqrt(np.diag(np.linalg.inv(scaled)))
    return np.clip(np.column_stack([best - half, best + half]), bounds[:, :1], bounds[:, 1:])


def _widened(bounded: _Bounded, bounds: Array, best: Array, intervals: Array, grid: Array, profile: Array) -> Array:
    """Return the intervals (K,2) widened to all values at which the profile is within `_DROP` of its maximum.

    Where the likelihood jumps, differences over small steps are no curvature.
    """
    least = bounded(best) - _DROP

    def is_plausible(k: int, sign: int, value: float) -> bool:
        point = best.copy()
        point[k] = sign * value
        return bounded(point if len(best) == 1 else _climbed(bounded, point, bounds, held=k)) >= least

    wide = intervals.copy()
    for k, values in enumerate(grid):
        inside = values[profile[k] >= least]
        for side, sign in enumerate((-1, 1)):
            reached = _end(partial(is_plausible, k, sign), sign * inside, sign * values, sign * intervals[k, side])
            wide[k, side] = sign * reached
    return wide


def _end(is_plausible: Callable[[float], bool], inside: Array, values: Array, end: float) -> float:
    """Return an upper end of an interval, moved beyond all plausible values; `inside` are those of the profile."""
    low = max(end, float(inside.max()))
    beyond = values[values > low]
    if not beyond.size or (low == end and not is_plausible(end)):
        return low
    high = float(beyond.min())
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_plausible(middle) else (low, middle)
    return high


def _status(profile: Array, top: float, least: float, is_apart: bool) -> LikelihoodStatus:
    """Return the status, from the profiles (K,G), the range of the likelihood, and whether another maximum is plausible."""
    if top - least <= tolerances.PARAMETER * max(abs(top), 1.0):
        return LikelihoodStatus.FLAT
    plausible = profile >= top - _DROP
    if (plausible[:, 0] | plausible[:, -1]).any():
        return LikelihoodStatus.WEAK
    pieces = (np.diff(plausible.astype(int), axis=1) == 1).sum(axis=1)
    return LikelihoodStatus.SEVERAL if is_apart or pieces.max() > 1 else LikelihoodStatus.IDENTIFIED
