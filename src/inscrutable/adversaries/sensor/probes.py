"""Sequences of states (probes) ranked by the Fisher information of the decisions about the agent's sensor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries.decision_tables import DecisionTables
from inscrutable.adversaries.sensor.calibration import KnownMechanism, log_probability, mechanism_in, with_sensor
from inscrutable.adversaries.sensor.calibration_results import ProbeRanking
from inscrutable.adversaries.sensor.families import SensorFamily
from inscrutable.adversaries.sensor.known_states import KnownStates, is_simple
from inscrutable.errors import InputError
from inscrutable.mechanisms import Mechanism
from inscrutable.mechanisms.memory import with_memory
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel
from inscrutable.worlds.observations import symbols

_MOST_SUMMED = 4_096
"""Most sequences of decisions that are enumerated; beyond, they are sampled."""

_MOST_LOST = 0.01
"""Most probability of sequences that are impossible at an end of a difference; in a smooth family it is of the step's size."""


def best_probe(
    probes: Sequence[ArrayLike],
    mechanism: KnownMechanism,
    family: SensorFamily | Callable[..., Any],
    *,
    world: HiddenMarkovModel,
    parameters: ArrayLike,
    n_draws: int = 500,
    rng: np.random.Generator | None = None,
) -> ProbeRanking:
    """Return the Fisher information about a sensor's parameters under each sequence of states, and the best sequence.

    Formula: I(θ) = E_u[∇ log Pr_θ(u|x) ∇ log Pr_θ(u|x)'] under the states x of the probe; Cramér–Rao: sd(θ̂_k) ≥ √(I⁻¹)_kk.

    Args:
        probes: Sequences of states, each (T,), whole numbers from 0; lengths may differ.
        mechanism: As in `calibrate_sensor`; it must depend on the present belief alone. A function of a world may list
            decisions in any order: they are matched by what they are.
        family: As in `calibrate_sensor`, of sensors that report symbols.
        world: The agent's world.
        parameters: θ at which the probes are compared, shape (K,), inside the family's bounds.
        n_draws: Sequences of decisions drawn for each probe where there are more than 4,096 possible ones.
        rng: The source of the draws, needed in that case.

    Returns:
        A `ProbeRanking`; the best probe has the least sum of variance bounds, each relative to its parameter's range.

    Raises:
        InputError: A probe has states out of range, the mechanism has a memory, the family has other state labels than the
            world, `parameters` are not inside the bounds, or what is played changes with them, so that decisions at them are
            impossible beside them.
        ModelError: The world rules a probe's states out.

    Cost: 2K+1 runs of the inverse filter with known states per probe, for all sequences of decisions at once.

    Source: Krishnamurthy, Rangaswamy, arXiv 1905.07230, Section IV.

    Example:
        >>> from inscrutable import CategoricalEmission, Mechanism
        >>> world = HiddenMarkovModel([[0.5, 0.5], [0.5, 0.5]], CategoricalEmission([[0.8, 0.2], [0.2, 0.8]]))
        >>> grid = np.c_[np.linspace(0, 1, 11), np.linspace(1, 0, 11)]
        >>> open_book = Mechanism(grid, np.arange(2), grid, 0.0 * grid)
        >>> probes = [[0, 0], [0, 0, 0, 0]]
        >>> best_probe(probes, open_book, SensorFamily.accuracy(2), world=world, parameters=[0.8]).best
        1
    """
    sensors = SensorFamily.of(family)
    point = validation.finite_array(parameters, "parameters", ndim=1)
    low, high = sensors.bounds.T
    if point.shape != low.shape or (point <= low).any() or (point >= high).any():
        raise InputError(
            f"parameters must be {len(low)} numbers inside {sensors.bounds.tolist()}, got {point.tolist()}"
        )
    if not len(probes):
        raise InputError("probes is empty; expected at least one sequence of states")
    paths = [symbols(each, world.n_states, f"probes[{i}]") for i, each in enumerate(probes)]
    for i, path in enumerate(paths):
        log_probability(path, world, f"probes[{i}]")
    steps = np.minimum(tolerances.SCORE_STEP * (high - low), 0.5 * np.minimum(point - low, high - point))
    places = [point, *(point + sign * steps * unit for unit in np.eye(len(point)) for sign in (-1.0, 1.0))]
    known = [_known(mechanism, with_sensor(world, sensors(*each))) for each in places]
    numbers = [_numbers(known[0].mechanism, each.mechanism) for each in known]
    found, exact = [], True
    for path in paths:
        columns, is_all = _decisions(known[0], path, n_draws, rng)
        logs = np.array([each.log_likelihoods(own[columns], path) for each, own in zip(known, numbers, strict=True)])
        chances = np.exp(logs[0]) if is_all else np.full(columns.shape[1], 1.0 / columns.shape[1])
        found.append(_information(logs, chances, steps))
        exact = exact and is_all
    information = np.array(found)
    bounds = np.array([_bounds(each) for each in information])
    sizes = ((bounds / (high - low)) ** 2).sum(axis=1)
    return ProbeRanking(information, bounds, int(sizes.argmin()), exact, sensors.names)


def _known(mechanism: KnownMechanism, world: HiddenMarkovModel) -> KnownStates:
    plays = mechanism_in(mechanism, world)
    if not is_simple(plays, world):
        raise InputError(
            "best_probe needs a Mechanism without memory, and a world with a CategoricalEmission and no public sensor; got "
            f"{plays!r} in {world!r}"
        )
    return KnownStates(world, plays)


def _numbers(mechanism: Mechanism, other: Mechanism) -> np.ndarray:
    """Return the numbers (M,) that a mechanism's decisions have in another one, by what they are."""
    if other is mechanism:
        return np.arange(len(mechanism.actions))
    points = np.asarray(mechanism.actions, dtype=np.float64).reshape(len(mechanism.actions), -1)
    tables = DecisionTables(with_memory(other))
    return np.array([tables.column(point, nearest=False)[0] for point in points], dtype=np.intp)


def _decisions(
    known: KnownStates, path: np.ndarray, n_draws: int, rng: np.random.Generator | None
) -> tuple[np.ndarray, bool]:
    """Return sequences of decisions by number (T,D), and whether they are all possible ones."""
    played = np.unique(known.mechanism.sparse.nonzero()[1])
    if len(played) ** len(path) <= _MOST_SUMMED:
        return np.array(list(product(played, repeat=len(path))), dtype=np.intp).T, True
    return known.drawn(path, validation.count(n_draws, "n_draws"), validation.generator(rng)), False


def _information(logs: Array, chances: Array, steps: Array) -> Array:
    """Return the mean outer product of the scores, from log-likelihoods (1+2K,D); impossible sequences have weight 0."""
    some = np.isfinite(logs).all(axis=0) & (chances > 0)
    lost = chances[~some].sum()
    if lost > _MOST_LOST:
        raise InputError(
            f"the decisions change with the parameters: {lost:.0%} of those at `parameters` are impossible at parameters "
            "beside them, so that there is no Fisher information"
        )
    slopes = (logs[2::2, some] - logs[1::2, some]) / (2.0 * steps[:, None])
    return np.asarray((slopes * chances[some]) @ slopes.T)


def _bounds(information: Array) -> Array:
    """Return the Cramér–Rao bounds; infinite where decisions do not identify a parameter."""
    values = np.linalg.eigvalsh(information)
    if not values[0] > tolerances.CURVATURE * max(values[-1], tolerances.TINY):
        return np.full(len(information), np.inf)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))
