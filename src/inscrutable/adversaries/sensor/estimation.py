"""Estimate a sensor from the beliefs of a filter whose transition is known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.adversaries.sensor.fits import bootstrapped, fitted, nothing_known, square
from inscrutable.adversaries.sensor.results import EstimatedSensor, SensorStatus
from inscrutable.adversaries.sensor.set_beliefs import sensor_of_sets, sets_in_order
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
    """Return an agent's sensor, estimated from successive beliefs of its filter; the transition is known.

    Formula: b ∝ π_k / P'π_{k−1} for the column b of the symbol seen at k, the null vector of π_k (P'π_{k−1})' −
    diag(P'π_{k−1}); steps are grouped by symbol, and scales s maximise Σ_y n_y log s_y under Σ_y s_y b_y = 1. With noise,
    weighted least squares gives the column of each group.

    Args:
        beliefs: π_0, π_1, …, shape (T,X), T at least 2, with noise or without. Or T sets that contain them, such as
            `consistent_beliefs` of decisions: sets of one point count as exact beliefs, larger sets restrict the filter's
            steps.
        transition: P of the agent's filter, shape (X,X); each row sums to one.
        n_symbols: Y, at least 1; None: the number of distinct columns found. A symbol that was never observed is then not
            detected where rows can be scaled to sum to one without it, as often with as many columns as states; one observed
            only once is there taken for a belief in error, with the status `INCONSISTENT`.
        n_bootstrap: Number of bootstrap resamples of the steps for the intervals; 0, or where fewer than `n_symbols` symbols
            are told apart: intervals from the curvature of the fit.
        rng: Source of the resamples, required if `n_bootstrap` is positive.

    Returns:
        An `EstimatedSensor`. Where its status is not `IDENTIFIED`, it is one of several sensors that explain the beliefs, and
        frequencies of symbols give the intervals.

    Raises:
        InputError: Beliefs or transition are malformed, or there are fewer than two beliefs. Labelled sets are over other
            states than the transition, or in several orders where it has no labels.
        ModelError: A belief gives weight to a state that the transition rules out.

    Cost: one hierarchical clustering of at most 1,000 steps, then some rounds of O(T·X·Y); 0.1 s for 1,000 beliefs.

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
        return sensor_of_sets(sets_in_order(beliefs, states), chain, wanted)  # type: ignore[arg-type]
    held = seen_beliefs(beliefs, states, len(chain))  # type: ignore[arg-type]
    draws = validation.count(n_bootstrap, "n_bootstrap", least=0)
    source = validation.generator(rng) if draws else None
    steps = filter_steps(held[:-1], held[1:], chain)
    symbols = np.full(len(held) - 1, -1)
    if not len(steps.numbers):
        return nothing_known(len(chain), wanted or 1, symbols, SensorStatus.ZEROS)
    fit = fitted(steps, wanted)
    symbols[steps.numbers] = np.maximum(fit.groups.symbols, -1)
    is_short = wanted is not None and fit.n_unseen > 0
    intervals = fit.intervals if source is None or is_short else bootstrapped(steps, fit, draws, source)
    return EstimatedSensor(fit.probabilities, symbols, fit.residual, fit.status, intervals, fit.noise)
