"""Fitting a Gaussian hidden Markov model to observations by Baum-Welch, with restarts that can be compared.

The likelihood has many local optima and is unbounded where a regime shrinks onto one point. So: several starts of
three kinds, each reported; a floor under every covariance; and regimes in a fixed order, calmest first, so that
"regime 1" means the same in every run.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inscrutable import tolerances, validation
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array
from inscrutable.worlds.emissions import GaussianEmission
from inscrutable.worlds.hidden_markov import HiddenMarkovModel
from inscrutable.worlds.observations import Labels, column_labels, real_rows
from inscrutable.worlds.starts import starting_responsibilities

MAX_ITERATIONS = 500
"""Baum-Welch steps of one restart; on monthly returns it converges in some tens to three hundred."""

START_PERSISTENCE = 0.9
"""Probability of staying in a state in every starting point: regimes last."""


@dataclass(frozen=True)
class Restart:
    """What one start of Baum-Welch came to.

    Attributes:
        log_likelihood: natural logarithm of the likelihood reached, in the observations' unit.
        n_iterations: number of evaluations of the likelihood.
        converged: whether the gain per observation fell below `tolerances.EM_CHANGE` within the allowed steps.
        collapsed: regimes, counted from 0 in the result's order, held up by the covariance floor or by fewer
            observations than a covariance needs.
        note: the same in words, with the number of observations; empty if there is nothing to say.
        trace: the log-likelihood before each step; it never decreases.
    """

    log_likelihood: float
    n_iterations: int
    converged: bool
    collapsed: tuple[int, ...]
    note: str
    trace: tuple[float, ...]


@dataclass(frozen=True)
class FittedWorld:
    """The best world of several restarts.

    Attributes:
        world: regimes ordered by volatility (trace of the covariance), calmest first. Its `initial` is the smoothed
            belief about the first observation of the sample, as maximum likelihood has it; for data that begin
            elsewhere build `HiddenMarkovModel(world.transition, world.emission)`, which starts from the stationary law.
        log_likelihood: natural logarithm of the sample's likelihood under `world`, as `filter_beliefs` gives it.
        restarts: one row for each restart, in the order they were run.
    """

    world: HiddenMarkovModel
    log_likelihood: float
    restarts: tuple[Restart, ...]

    @property
    def asset_names(self) -> Labels | None:
        """Labels of the columns the world was fitted on, None if they had none."""
        emission = self.world.emission
        return emission.asset_names if isinstance(emission, GaussianEmission) else None

    def summary(self) -> str:
        """Return a table of the restarts as text, the best one first."""
        lines = ["log-likelihood  iterations  converged  note"]
        for row in sorted(self.restarts, key=lambda restart: -restart.log_likelihood):
            converged = "yes" if row.converged else "no"
            lines.append(f"{row.log_likelihood:14.4f}  {row.n_iterations:10d}  {converged:>9}  {row.note}".rstrip())
        return "\n".join(lines)


def fit_gaussian_hmm(
    observations: Any, n_states: int, *, rng: np.random.Generator, n_restarts: int = 10
) -> FittedWorld:
    """Fit a hidden Markov model with Gaussian observations by maximum likelihood (Baum-Welch).

    max over (π_0, P, μ, Σ) of log p(y_0..T-1), subject to every Σ_i ≥ COVARIANCE_FLOOR · I after the columns are
    scaled to unit variance. The expectations are computed in log space; a covariance below the floor has its
    eigenvalues raised to it, which is the exact maximiser under that constraint, so the likelihood never decreases.
    The best restart without a collapsed regime is returned, or the best of all if each has one (its `note` tells).

    Args:
        observations: (T,D) real vectors, or (T,) for D = 1. The columns of a DataFrame become `asset_names`.
        n_states: number of regimes X, at least 1 and at most the number of different observations.
        rng: randomness of the starting points; each restart has a child of its own.
        n_restarts: number of starting points, at least 1.

    Returns:
        The world, its log-likelihood and the table of restarts.

    Raises:
        InputError: missing entries (row and column named), or fewer different observations than regimes.
        ModelError: observations that are all equal.

    Cost: O(n_restarts · iterations · T (X D² + X²)).

    Source: Rabiner, Proceedings of the IEEE 77 (1989), §III.C; for the Markowitz regimes Lourenço et al. (2020), §II.

    Example:
        >>> import numpy as np
        >>> from inscrutable.worlds import fit_gaussian_hmm
        >>> calm, wild = np.random.default_rng(0).normal(size=(2, 60))
        >>> fitted = fit_gaussian_hmm(np.concatenate([calm, 9 + 3 * wild]), 2, rng=np.random.default_rng(1))
        >>> fitted.world.emission.means.round().tolist()
        [[0.0], [9.0]]
    """
    validation.generator(rng)
    n_states = validation.count(n_states, "n_states")
    n_restarts = validation.count(n_restarts, "n_restarts")
    rows = real_rows(observations)
    distinct = len(np.unique(rows, axis=0))
    if distinct < n_states:
        raise InputError(f"n_states is {n_states}, but there are only {distinct} different observations")
    data = _standardise(rows)
    fits = [
        _fit_once(data, starting_responsibilities(data.rows, n_states, kind, child), n_states)
        for kind, child in enumerate(rng.spawn(n_restarts))
    ]
    best = max(range(n_restarts), key=lambda k: (not fits[k][1].collapsed, fits[k][1].log_likelihood))
    parameters = fits[best][0]
    emission = GaussianEmission(
        data.centre + data.scale * parameters.means,
        parameters.covariances * np.outer(data.scale, data.scale),
        asset_names=column_labels(observations),
    )
    world = HiddenMarkovModel(parameters.transition, emission, parameters.initial)
    return FittedWorld(world, _log_likelihood(world, rows), tuple(restart for _, restart in fits))


@dataclass(frozen=True)
class _Data:
    """Observations as rows = (raw − centre) / scale, so that one floor fits every unit.

    `log_volume` is Σ log scale, what one observation loses in log density when it is scaled back. `floored` says that
    the whole sample already lies below the floor in some direction, as with a constant or a duplicated column.
    """

    rows: Array
    centre: Array
    scale: Array
    log_volume: float
    floored: bool


@dataclass(frozen=True)
class _Parameters:
    initial: Array
    transition: Array
    means: Array
    covariances: Array

    def reordered(self, order: NDArray[np.int64]) -> _Parameters:
        transition = self.transition[np.ix_(order, order)]
        return _Parameters(self.initial[order], transition, self.means[order], self.covariances[order])


def _standardise(raw: Array) -> _Data:
    centre = raw.mean(axis=0)
    scale = raw.std(axis=0)
    constant = np.ptp(raw, axis=0) <= tolerances.CONSTANT_COLUMN * np.abs(raw).max(axis=0)
    if constant.all():
        raise ModelError(f"all {len(raw)} observations are equal: there is no variance to fit")
    scale[constant] = scale[~constant].min()
    rows = (raw - centre) / scale
    smallest = np.linalg.eigvalsh(np.atleast_2d(np.cov(rows.T, bias=True)))[0]
    return _Data(rows, centre, scale, float(np.log(scale).sum()), bool(smallest <= tolerances.COVARIANCE_FLOOR))


def _fit_once(data: _Data, responsibilities: Array, n_states: int) -> tuple[_Parameters, Restart]:
    """Run Baum-Welch from one start; the parameters returned are those of the last entry of the trace."""
    from inscrutable.kernels.hidden_markov import expectation_pass, filter_pass, gaussian_log_densities

    n_steps, n_dims = data.rows.shape
    sticky = START_PERSISTENCE * np.eye(n_states) + (1.0 - START_PERSISTENCE) / n_states
    blank = _Parameters(sticky[0], sticky, np.zeros((n_states, n_dims)), np.tile(np.eye(n_dims), (n_states, 1, 1)))
    parameters = _maximise(data.rows, responsibilities, sticky, blank)
    trace: list[float] = []
    converged = False
    while True:
        densities = gaussian_log_densities(data.rows, parameters.means, np.linalg.cholesky(parameters.covariances))
        with np.errstate(divide="ignore"):
            log_initial, log_transition = np.log(parameters.initial), np.log(parameters.transition)
        log_beliefs, log_predicted, _, _, increments = filter_pass(log_initial, log_transition, densities)
        responsibilities, counts = expectation_pass(log_beliefs, log_predicted, log_transition)
        trace.append(float(increments.sum()) - n_steps * data.log_volume)
        converged = len(trace) > 1 and trace[-1] - trace[-2] < tolerances.EM_CHANGE * n_steps
        if converged or len(trace) == MAX_ITERATIONS:
            break
        parameters = _maximise(data.rows, responsibilities, counts, parameters)
    volatility = np.einsum("idd,d->i", parameters.covariances, data.scale**2)
    order = np.asarray(np.argsort(volatility, kind="stable"), dtype=np.int64)
    parameters = parameters.reordered(order)
    collapsed, note = _collapse(data, parameters, responsibilities.sum(axis=0)[order])
    if not converged:
        note = "; ".join(filter(None, [note, f"still improving after {len(trace)} iterations"]))
    return parameters, Restart(trace[-1], len(trace), converged, collapsed, note, tuple(trace))


def _maximise(rows: Array, responsibilities: Array, counts: Array, previous: _Parameters) -> _Parameters:
    """Maximise the expected log-likelihood; a state that nothing is assigned to keeps its previous parameters."""
    tiny = np.finfo(np.float64).tiny
    transition = previous.transition.copy()
    left = counts.sum(axis=1)
    transition[left > tiny] = counts[left > tiny] / left[left > tiny, None]
    means, covariances = previous.means.copy(), previous.covariances.copy()
    weights = responsibilities.sum(axis=0)
    for state in np.flatnonzero(weights > tiny):
        share = responsibilities[:, state] / weights[state]
        means[state] = share @ rows
        deviations = rows - means[state]
        covariances[state] = (deviations * share[:, None]).T @ deviations
    values, vectors = np.linalg.eigh((covariances + covariances.transpose(0, 2, 1)) / 2.0)
    for state in np.flatnonzero(values[:, 0] < tolerances.COVARIANCE_FLOOR):
        raised = np.maximum(values[state], tolerances.COVARIANCE_FLOOR)
        covariances[state] = (vectors[state] * raised) @ vectors[state].T
    return _Parameters(responsibilities[0] / responsibilities[0].sum(), transition, means, covariances)


def _collapse(data: _Data, parameters: _Parameters, weights: Array) -> tuple[tuple[int, ...], str]:
    """Find regimes without enough observations for a covariance, or at the floor where the whole sample is not."""
    least = data.rows.shape[1] + 1
    at_floor = np.linalg.eigvalsh(parameters.covariances)[:, 0] < 2.0 * tolerances.COVARIANCE_FLOOR
    collapsed = (weights < least) | (at_floor & (not data.floored))
    notes = [f"regime {i + 1} collapsed on {weights[i]:.1f} observations" for i in np.flatnonzero(collapsed)]
    return tuple(int(i) for i in np.flatnonzero(collapsed)), "; ".join(notes)


def _log_likelihood(world: HiddenMarkovModel, rows: Array) -> float:
    from inscrutable.kernels.hidden_markov import filter_pass

    with np.errstate(divide="ignore"):
        log_initial, log_transition = np.log(world.initial), np.log(world.transition)
    increments: Array = filter_pass(log_initial, log_transition, world.emission.log_likelihoods(rows))[-1]
    return float(np.cumsum(increments)[-1])
