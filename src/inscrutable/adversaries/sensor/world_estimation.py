"""Estimate a world (transition and sensor) from the beliefs of a filter alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries.sensor.fits import SensorFit, fitted, nothing_known, regrouped, spanned
from inscrutable.adversaries.sensor.groups import Groups, without_outlying
from inscrutable.adversaries.sensor.joint_fit import jointly
from inscrutable.adversaries.sensor.results import EstimatedWorld, SensorStatus
from inscrutable.adversaries.sensor.steps import FilterSteps, filter_steps, seen_beliefs
from inscrutable.adversaries.sensor.transitions import of_symbols, proposed, steps_needed
from inscrutable.axes import Axis
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel
from inscrutable.worlds.observations import symbols as checked_symbols

_SEED = 0
"""Seed of the random small sets of steps: equal beliefs give equal results."""

_ROUNDS = 5
"""Rounds of grouping steps and fitting transition and sensor to them."""


def estimate_world(
    beliefs: ArrayLike,
    *,
    n_symbols: int,
    symbols: ArrayLike | None = None,
    n_bootstrap: int = 0,
    rng: np.random.Generator | None = None,
) -> EstimatedWorld:
    """Return the transition and sensor of a filter, estimated from its successive beliefs.

    Formula: M_y = diag(b_y) P' solves (π_{k−1}' ⊗ (π_k 1' − I)) vec(M_y) = 0 over the steps k whose symbol is y; P follows from
    one M_y: P' = diag(a) Q, where Q is M_y with rows scaled to one, and Q'a = 1. The sensor follows as in `estimate_sensor`.

    Args:
        beliefs: π_0, π_1, …, shape (T,X), T at least 2.
        n_symbols: Y, at least 1.
        symbols: The agent's observation at each step, 0 to Y−1, where known: T−1 of them, or T, of which the first is not used.
            None: the steps are clustered by symbol.
        n_bootstrap: Number of bootstrap resamples of the steps for the intervals; 0: transition intervals have zero width.
        rng: Source of the resamples, required if `n_bootstrap` is positive.

    Returns:
        An `EstimatedWorld`. Its initial law is the stationary one, or uniform where that is not unique. With Y > X the data
        identify the transition, and the sensor up to the scales of its columns.

    Raises:
        InputError: Beliefs or symbols are malformed, or their lengths disagree.

    Cost: one singular value decomposition of X² columns per symbol. Unknown symbols add some hundred small decompositions and
    one hierarchical clustering of at most 1,000 steps.

    Source: Mattila, Rojas, Krishnamurthy, Wahlberg, arXiv 2001.11809, for the equations. The transition from one symbol and the
    clustering are new here.

    Example:
        >>> from inscrutable import CategoricalEmission, filter_beliefs
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], CategoricalEmission([[0.8, 0.2], [0.3, 0.7]]))
        >>> beliefs = filter_beliefs(world, [0, 1, 1, 0, 0, 1, 0, 0, 1, 1, 1, 0]).beliefs
        >>> print(estimate_world(beliefs, n_symbols=2).world.transition.round(6))
        [[0.9 0.1]
         [0.2 0.8]]
    """
    states = Axis("state", learns=True)
    held = seen_beliefs(beliefs, states)
    if n_symbols is None:
        raise InputError("n_symbols must be a number: without a transition, the number of symbols is not found")
    count = validation.count(n_symbols, "n_symbols")
    told = None if symbols is None else _told(symbols, count, len(held) - 1)
    draws = validation.count(n_bootstrap, "n_bootstrap", least=0)
    source = validation.generator(rng) if draws else None
    names = None if states.names is None else tuple(str(each) for each in states.names)
    guess = _guess(held[:-1], held[1:], count, told)
    if guess is None:
        return _unknown(held, count, told, names)
    transition, fit, numbers = guess
    found = np.full(len(held) - 1, -1)
    found[numbers] = fit.groups.symbols
    sensor, limits = fit.probabilities, fit.intervals
    chain_limits = np.stack([transition, transition], axis=2)
    if source is not None:
        chain_limits, limits = _bootstrapped(held, found, transition, fit, draws=draws, rng=source)
    if told is not None:
        order = _named(told, numbers, count)
        sensor, limits = sensor[:, order], limits[:, order]
        found[numbers] = np.where(fit.groups.symbols >= 0, told[numbers], -1)
    few = _are_few(len(held) - 1, held.shape[1], count, told)
    status = SensorStatus.TOO_FEW_STEPS if few else fit.status
    return EstimatedWorld(_world(transition, sensor, names), found, fit.residual, status, chain_limits, limits)


def _told(symbols: ArrayLike, count: int, n_steps: int) -> np.ndarray:
    """Known symbols of the steps (T−1,)."""
    found = checked_symbols(symbols, count, "symbols")
    if len(found) not in (n_steps, n_steps + 1):
        raise InputError(
            f"symbols has {len(found)} entries for {n_steps + 1} beliefs; expected {n_steps}, one a step, or {n_steps + 1}"
        )
    return np.asarray(found[-n_steps:], dtype=np.int64)


def _guess(
    before: Array, held: Array, count: int, told: np.ndarray | None
) -> tuple[Array, SensorFit, np.ndarray] | None:
    """Return the best transition and its fit; None where the steps are too few or do not determine one."""
    if told is not None:
        chain, _ = of_symbols(before, held, told)
        candidates = [] if chain is None else [np.maximum(chain, 0.0)]
    elif len(before) < steps_needed(before.shape[1]) + 2:
        candidates = []
    else:
        candidates = proposed(before, held, count, np.random.default_rng(_SEED))
    best: tuple[Array, SensorFit, np.ndarray] | None = None
    for candidate in candidates:
        found = _refined(before, held, candidate, count, told)
        if found is not None and (best is None or found[1].groups.misses.mean() < best[1].groups.misses.mean()):
            best = found
        if best is not None and best[1].noise <= tolerances.EXACT_BELIEFS:
            break
    if best is not None and told is None and best[1].noise <= tolerances.EXACT_BELIEFS:
        symbols = np.full(len(before), -1)
        symbols[best[2]] = best[1].groups.symbols
        if of_symbols(before, held, symbols)[0] is None:
            return None
    return best


def _refined(
    before: Array, held: Array, chain: Array, count: int, told: np.ndarray | None
) -> tuple[Array, SensorFit, np.ndarray] | None:
    """Refine a candidate: alternately cluster the steps and fit transition and sensor."""
    chain = chain / chain.sum(axis=1, keepdims=True)
    last: np.ndarray | None = None
    for _ in range(_ROUNDS):
        steps = filter_steps(before, held, np.maximum(chain, tolerances.TINY))
        fit = fitted(steps, count, None if told is None else _by_name(steps, told))
        symbols = np.full(len(before), -1)
        symbols[steps.numbers] = fit.groups.symbols
        if last is not None and (symbols == last).all():
            break
        last = symbols
        # All steps of a symbol carry more information than the initial set.
        if told is None and fit.noise <= tolerances.EXACT_BELIEFS:
            whole, _ = of_symbols(before, held, symbols)
            chain = chain if whole is None else np.maximum(whole, 0.0)
        chain, _ = jointly(before, held, symbols, chain, fit.groups.columns)
    return chain, fit, steps.numbers


def _by_name(steps: FilterSteps, told: np.ndarray) -> Groups:
    """Group steps by their known symbols; those that occur are numbered in their order."""
    symbols, directions = told[steps.numbers], steps.directions()
    starts = np.ones((int(told.max()) + 1, directions.shape[1]))
    for y in np.unique(symbols):
        starts[y] = directions[symbols == y].mean(axis=0)
    return without_outlying(steps, regrouped(steps, symbols, starts))


def _named(told: np.ndarray, numbers: np.ndarray, count: int) -> np.ndarray:
    """Return the column index of every symbol's name: those that occur first, in their order, then the others."""
    present = np.unique(told[numbers])
    return np.argsort(np.concatenate([present, np.setdiff1d(np.arange(count), present)]))


def _world(transition: Array, sensor: Array, names: tuple[str, ...] | None) -> HiddenMarkovModel:
    """Return the world with its stationary law, or a uniform one where that is not unique."""
    emission = CategoricalEmission(sensor)
    try:
        return HiddenMarkovModel(transition, emission, names=names)
    except ModelError:
        return HiddenMarkovModel(transition, emission, np.full(len(transition), 1.0 / len(transition)), names=names)


def _unknown(held: Array, count: int, told: np.ndarray | None, names: tuple[str, ...] | None) -> EstimatedWorld:
    """Return the uninformative world, for beliefs that determine no transition."""
    n_states = held.shape[1]
    few = _are_few(len(held) - 1, n_states, count, told) or (
        told is not None and int(np.bincount(told).max()) < steps_needed(n_states)
    )
    status = SensorStatus.TOO_FEW_STEPS if few else SensorStatus.DEGENERATE
    symbols = np.full(len(held) - 1, -1) if told is None else told
    sensor = nothing_known(n_states, count, symbols, status)
    even = np.full((n_states, n_states), 1.0 / n_states)
    open_rows = np.tile([0.0, 1.0], (n_states, n_states, 1))
    return EstimatedWorld(_world(even, sensor.probabilities, names), symbols, 0.0, status, open_rows, sensor.intervals)


def _are_few(n_steps: int, n_states: int, count: int, told: np.ndarray | None) -> bool:
    """Whether there are fewer steps than unknowns, or too few to cluster them by symbol."""
    return n_steps <= n_states + count if told is not None else n_steps < count * steps_needed(n_states)


def _bootstrapped(
    held: Array, symbols: np.ndarray, transition: Array, fit: SensorFit, *, draws: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """95 % intervals of transition and sensor from resampled steps, which keep their symbols."""
    used = np.flatnonzero(symbols >= 0)
    chains, sensors = [transition], [fit.probabilities]
    for _ in range(draws):
        some = rng.choice(used, len(used))
        chain, columns = jointly(held[some], held[some + 1], symbols[some], transition, fit.groups.columns)
        steps = filter_steps(held[some], held[some + 1], chain)
        drawn = symbols[some][steps.numbers]
        again = fitted(steps, None, regrouped(steps, drawn, columns))
        chains.append(chain)
        if again.probabilities.shape == fit.probabilities.shape:
            sensors.append(again.probabilities)
    return spanned(chains), spanned(sensors)
