"""A sensor as a table of finitely many signals: its symbols, cells of a sufficient statistic, or draws."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, Emission, GaussianEmission

_STEPS = np.linspace(-8.5, 8.5, 86)
"""Cells of a Gaussian sensor, in standard deviations of each state's law; the probability beyond the last is 1e-17."""

_DRAWS = 500
"""Number of signals drawn from each state, for sensors without symbols or cells."""


class Signals(NamedTuple):
    """An agent's signals: p(y|x), whether they are the sensor's own symbols, and how many were drawn from each state."""

    probabilities: Array  # (X,Y)
    is_exact: bool
    n_drawn: int


def signals_of(emission: Emission, problem: DecisionProblem, rng: Any) -> Signals:
    """Return the signals of a sensor over the problem's states; raise `InputError` where its states differ.

    For a Gaussian sensor whose states differ along one line, a signal is a cell of the sufficient statistic, with exact cell
    probabilities. Any other sensor reports one of the signals drawn equally from all states, weighted by their densities.
    """
    if not isinstance(emission, Emission):
        raise InputError(
            f"emission must be a sensor such as CategoricalEmission([[0.7, 0.3], [0.3, 0.7]]), got {emission!r}"
        )
    if emission.n_states != problem.n_states:
        raise InputError(f"the emission has {emission.n_states} states, the problem {problem.n_states}")
    if isinstance(emission, CategoricalEmission):
        return Signals(_aligned(emission, problem, np.asarray(emission.probabilities)), True, 0)
    if rng is None:
        raise InputError(
            f"{type(emission).__name__} has no finite list of symbols, so that paths are simulated: "
            "rng must be a numpy.random.Generator such as numpy.random.default_rng(0), got None"
        )
    line = _line(emission) if isinstance(emission, GaussianEmission) else None
    table = _drawn(emission, validation.generator(rng)) if line is None else _cells(*line)
    return Signals(_aligned(emission, problem, table), False, _DRAWS if line is None else 0)


def _aligned(emission: Any, problem: DecisionProblem, table: Array) -> Array:
    """The rows in the order of the problem's states."""
    found, names = getattr(emission, "state_names", None), problem.state_names
    if found is None or names is None:
        return table
    order = Axis("state", names).order(tuple(found), "emission")
    return table if order is None else table[order]


def _line(emission: GaussianEmission) -> tuple[Array, Array] | None:
    """Return mean and standard deviation per state of the scalar sufficient statistic, each (X,); None without one."""
    means, covariances = np.asarray(emission.means), np.asarray(emission.covariances)
    if emission.n_dims == 1:
        return means[:, 0], np.sqrt(covariances[:, 0, 0])
    if not (np.abs(covariances - covariances[0]) <= tolerances.SYMMETRY * np.abs(covariances[0]).max()).all():
        return None
    factor = np.linalg.cholesky(covariances[0])
    white = np.linalg.solve(factor, (means - means[0]).T).T
    _, sizes, directions = np.linalg.svd(white, full_matrices=False)
    if sizes[1:].max(initial=0.0) > tolerances.RANK * sizes[0]:
        return None
    return white @ directions[0], np.ones(len(means))


def _cells(means: Array, spreads: Array) -> Array:
    """Return the probabilities (X,Y) of the cells between the steps of all states."""
    edges = np.unique(means[:, None] + spreads[:, None] * _STEPS)
    edges = edges[np.diff(edges, prepend=-np.inf) > tolerances.SIGNAL_CELL * spreads.min()]
    ends = (np.concatenate([[-np.inf], edges, [np.inf]]) - means[:, None]) / spreads[:, None]
    low, high = ends[:, :-1], ends[:, 1:]
    # Differences of the smaller tail keep their digits.
    above = low > 0
    chances = ndtr(np.where(above, -low, high)) - ndtr(np.where(above, -high, low))
    kept = chances.max(axis=0) > 0
    return np.asarray(chances[:, kept] / chances[:, kept].sum(axis=1, keepdims=True))


def _drawn(emission: Emission, rng: np.random.Generator) -> Array:
    """Return the weights (X,Y) of signals drawn from every state, as an importance sample of each state's law."""
    drawn = emission.sample(np.repeat(np.arange(emission.n_states), _DRAWS), rng=rng)
    logs = np.asarray(emission.log_likelihoods(drawn))
    weights = np.exp(logs - logs.max(axis=1, keepdims=True))
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray((weights / weights.sum(axis=0)).T)
