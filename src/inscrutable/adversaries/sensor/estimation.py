"""The sensor behind the beliefs of a filter whose transition is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.adversaries.sensor.fits import bootstrapped, fitted, nothing_known, square
from inscrutable.adversaries.sensor.results import EstimatedSensor, SensorStatus
from inscrutable.adversaries.sensor.set_beliefs import sensor_of_sets
from inscrutable.adversaries.sensor.steps import filter_steps, seen_beliefs, symbol_count
from inscrutable.axes import Axis
from inscrutable.geometry import BeliefSet


def estimate_sensor(
    beliefs: ArrayLike | Sequence[BeliefSet],
    transition: ArrayLike,
    *,
    n_symbols: int | None = None,
    n_bootstrap: int = 0,
    rng: np.random.Generator | None = None,
) -> EstimatedSensor:
    """Return the sensor behind successive beliefs of a filter whose transition is known.

    Formula: b ∝ π_k / P'π_{k−1} for the column b of the symbol seen at k, the null vector of π_k (P'π_{k−1})' −
    diag(P'π_{k−1}); steps are grouped by symbol, and scales s maximise Σ_y n_y log s_y under Σ_y s_y b_y = 1. With noise
    each group's column is the one that explains its beliefs best, by weighted least squares.

    Args:
        beliefs: π_0, π_1, …, shape (T,X), T at least 2, with noise or without. Or T sets that hold them, such as
            `consistent_beliefs` of decisions: points are used as they are, others by which steps of a filter lead into them.
        transition: P, shape (X,X), rows that sum to one: the agent's own.
        n_symbols: Y, at least 1; None: as many as there are distinct columns.
        n_bootstrap: How many resamples of the steps give the intervals; 0: they come from the curvature of the fit.
        rng: The source of the resamples, needed where there are any.

    Returns:
        An `EstimatedSensor`; where its status is not `IDENTIFIED`, one of several sensors that explain the beliefs, with
        intervals from the frequencies of symbols.

    Raises:
        InputError: Beliefs or transition are malformed, or there are fewer than two beliefs.
        ModelError: A belief gives weight to a state that the transition rules out.

    Cost: a tree of at most 1,000 steps, then some rounds of K·X·Y; a tenth of a second for 1,000 beliefs.

    Source: Mattila, Rojas, Krishnamurthy, Wahlberg, NeurIPS 2017, for the null space and the case Y <= X.

    Example:
        >>> from inscrutable import CategoricalEmission, HiddenMarkovModel, filter_beliefs
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], CategoricalEmission([[0.8, 0.2], [0.3, 0.7]]))
        >>> beliefs = filter_beliefs(world, [1, 0, 1, 1, 0, 0, 1]).beliefs
        >>> print(estimate_sensor(beliefs, world.transition).probabilities.round(6))
        [[0.8 0.2]
         [0.3 0.7]]
    """
    states = Axis("state", learns=True)
    chain = square(validation.stochastic_rows(transition, "transition", axes=(states, states)))
    wanted = symbol_count(n_symbols)
    if isinstance(beliefs, Sequence) and len(beliefs) > 1 and all(isinstance(each, BeliefSet) for each in beliefs):
        return sensor_of_sets(beliefs, chain, wanted)  # type: ignore[arg-type]
    held = seen_beliefs(beliefs, states, len(chain))  # type: ignore[arg-type]
    draws = validation.count(n_bootstrap, "n_bootstrap", least=0)
    source = validation.generator(rng) if draws else None
    steps = filter_steps(held[:-1], held[1:], chain)
    symbols = np.full(len(held) - 1, -1)
    if not len(steps.numbers):
        return nothing_known(len(chain), wanted or 1, symbols, SensorStatus.ZEROS)
    fit = fitted(steps, wanted)
    symbols[steps.numbers] = fit.groups.symbols
    intervals = fit.intervals if source is None else bootstrapped(steps, fit, draws, source)
    return EstimatedSensor(fit.probabilities, symbols, fit.residual, fit.status, intervals, fit.noise)
