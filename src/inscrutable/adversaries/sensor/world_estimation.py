"""Estimate a world (transition and sensor) from the beliefs of a filter alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries.sensor.fits import (
    QUANTILE,
    SensorFit,
    fitted,
    is_overlapping,
    nothing_known,
    regrouped,
    spanned,
)
from inscrutable.adversaries.sensor.groups import Groups, without_outlying
from inscrutable.adversaries.sensor.joint_fit import JointFit, jointly, spreads
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

_EVEN = 0.5
"""Share of a uniform transition in the second start of the joint fit, whose sensor has the symbols' frequencies in every state.
Of 48 drawn worlds with errors of 1e-9 to 1e-3 the joint fit is as good as from the true world in 28 from the separate fits
alone, in 44 from this start, and in 30 where its transition is the fitted one. With known symbols and errors of 1e-3 a world
of three states was called inconsistent in 5 of 40 draws from its own transition, where zeros stay zeros, and in 1 from both."""

_AS_GOOD = 1.2
"""Squared error of the joint fit, over that without sums, up to which a filter explains the beliefs. Of 27 drawn worlds with
errors none has more than 1.008; six sets of beliefs that no filter makes have .97 to 1.28, and their noise is named."""

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
            Labelled rows are aligned with those of the beliefs.
            None: the steps are clustered by symbol.
        n_bootstrap: Number of bootstrap resamples of the steps for the intervals; 0: by the curvature of the fit, and of zero
            width for the transition of exact beliefs, or where no joint fit is as good. The sensor's are always by curvature
            where fewer than Y symbols are told apart.
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
    steps, states = Axis("step", learns=True), Axis("state", learns=True)
    held = seen_beliefs(beliefs, states, steps=steps)
    if n_symbols is None:
        raise InputError("n_symbols must be a number: without a transition, the number of symbols is not found")
    count = validation.count(n_symbols, "n_symbols")
    told = _told(symbols, count, len(held) - 1, steps)
    draws = validation.count(n_bootstrap, "n_bootstrap", least=0)
    source = validation.generator(rng) if draws else None
    names = None if states.names is None else tuple(str(each) for each in states.names)
    guess = _guess(held[:-1], held[1:], count, told)
    if guess is None:
        return _unknown(held, count, told, names)
    transition, fit, numbers = guess
    found = np.full(len(held) - 1, -1)
    found[numbers] = np.maximum(fit.groups.symbols, -1)
    sensor, limits, status = fit.probabilities, fit.intervals, fit.status
    chain_limits = np.stack([transition, transition], axis=2)
    whole = _whole(held, found, transition, fit, count)
    if whole is not None:
        transition, sensor = whole.transition, whole.columns.T
        chain_limits, limits = _curved(whole)
        status = _judged(held, whole, fit)
    residual = _residual(held, found, transition, sensor)
    if (found < 0).any():
        residual = max(residual, fit.residual)
    if source is not None:
        chain_limits, limits = _bootstrapped(held, found, transition, fit, whole, draws=draws, rng=source)
    if told is not None:
        order = _named(told, numbers, count)
        sensor, limits = sensor[:, order], limits[:, order]
        found[numbers] = np.where(fit.groups.symbols >= 0, told[numbers], -1)
    few = _are_few(len(held) - 1, held.shape[1], count, told)
    status = SensorStatus.TOO_FEW_STEPS if few else status
    return EstimatedWorld(_world(transition, sensor, names), found, residual, status, chain_limits, limits)


def _whole(held: Array, symbols: np.ndarray, transition: Array, fit: SensorFit, count: int) -> JointFit | None:
    """Return the joint fit of transition and sensor to beliefs with errors; None where there is none as good as without sums.

    The separate fits take the columns' scales from the transition as if that were exact, and multiply its errors. With more
    symbols than states the scales are free.
    """
    usual = fit.noise <= tolerances.EXACT_BELIEFS and fit.status is not SensorStatus.INCONSISTENT
    if usual or fit.n_unseen or len(fit.groups.outlying) or not 1 < count <= held.shape[1]:
        return None
    steps = held[:-1], held[1:], symbols
    free = jointly(*steps, transition, fit.groups.columns)
    often = np.bincount(symbols[symbols >= 0], minlength=count) / np.count_nonzero(symbols >= 0)
    flat = _evened(transition), np.tile(often[:, None], len(transition))
    starts = (transition, fit.probabilities.T), flat
    best = min((jointly(*steps, *start, is_sensor=True) for start in starts), key=lambda each: each.loss)
    return best if best.loss <= _AS_GOOD * free.loss else None


def _evened(transition: Array) -> Array:
    """Return a transition's rows mixed with uniform ones."""
    shares = transition / transition.sum(axis=1, keepdims=True)
    return np.asarray(_EVEN / len(shares) + (1.0 - _EVEN) * shares)


def _judged(held: Array, found: JointFit, fit: SensorFit) -> SensorStatus:
    """Return the status of a joint fit: where it explains the beliefs, they are not inconsistent."""
    if fit.status is not SensorStatus.INCONSISTENT:
        return fit.status
    steps = filter_steps(held[:-1], held[1:], np.maximum(found.transition, tolerances.TINY))
    overlap = is_overlapping(steps, found.columns, fit.noise)
    return SensorStatus.OVERLAPPING if overlap else SensorStatus.IDENTIFIED


def _curved(found: JointFit) -> tuple[Array, Array]:
    """Return 95 % intervals of transition and sensor by the curvature of their fit."""
    chain, sensor = spreads(found)
    pairs = (found.transition, chain), (found.columns.T, sensor.T)
    limits = [np.clip(np.stack([a - QUANTILE * b, a + QUANTILE * b], axis=2), 0.0, 1.0) for a, b in pairs]
    return limits[0], limits[1]


def _residual(held: Array, symbols: np.ndarray, transition: Array, sensor: Array) -> float:
    """Return the largest distance of a belief from the filter's update of the belief before it, over steps with a symbol."""
    used = symbols >= 0
    joint = (held[:-1][used] @ transition) * sensor[:, symbols[used]].T
    shown = joint / np.maximum(joint.sum(axis=1, keepdims=True), tolerances.TINY)
    return float(np.linalg.norm(held[1:][used] - shown, axis=1).max(initial=0.0))


def _told(symbols: ArrayLike | None, count: int, n_steps: int, steps: Axis) -> np.ndarray | None:
    """Known symbols of the steps (T−1,), as a single symbol always is; None where they are to be found."""
    if symbols is None:
        return np.zeros(n_steps, dtype=np.int64) if count == 1 else None
    found = checked_symbols(symbols, count, "symbols")
    if len(found) not in (n_steps, n_steps + 1):
        raise InputError(
            f"symbols has {len(found)} entries for {n_steps + 1} beliefs; expected {n_steps}, one a step, or {n_steps + 1}"
        )
    names = None if steps.names is None else steps.names[-len(found) :]
    found = checked_symbols(symbols, count, "symbols", Axis("step", names, learns=True))
    return np.asarray(found[-n_steps:], dtype=np.int64)


def _guess(
    before: Array, held: Array, count: int, told: np.ndarray | None
) -> tuple[Array, SensorFit, np.ndarray] | None:
    """Return the best transition and its fit; None where the steps are too few or do not determine one."""
    if told is not None:
        chain, _ = of_symbols(before, held, told)
        candidates = [] if chain is None else [np.maximum(chain, 0.0), _evened(np.maximum(chain, 0.0))]
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
        chain = jointly(before, held, symbols, chain, fit.groups.columns).transition
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
    held: Array,
    symbols: np.ndarray,
    transition: Array,
    fit: SensorFit,
    whole: JointFit | None,
    *,
    draws: int,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """95 % intervals of transition and sensor from resampled steps, which keep their symbols."""
    used = np.flatnonzero(symbols >= 0)
    chains, sensors = [transition], [fit.probabilities if whole is None else whole.columns.T]
    for _ in range(draws):
        some = rng.choice(used, len(used))
        if whole is not None:
            drawn = jointly(held[some], held[some + 1], symbols[some], transition, whole.columns, is_sensor=True)
            chains.append(drawn.transition)
            sensors.append(drawn.columns.T)
            continue
        chain, columns, *_ = jointly(held[some], held[some + 1], symbols[some], transition, fit.groups.columns)
        steps = filter_steps(held[some], held[some + 1], chain)
        again = fitted(steps, None, regrouped(steps, symbols[some][steps.numbers], columns))
        chains.append(chain)
        if again.probabilities.shape == fit.probabilities.shape:
            sensors.append(again.probabilities)
    return spanned(chains), fit.intervals if fit.n_unseen else spanned(sensors)
