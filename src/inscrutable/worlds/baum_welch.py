"""Baum-Welch for Gaussian observations: one run from one starting point.

With smoothed probabilities γ_t(i) and expected transition counts N_ij, a step sets π_0 = γ_0, P_ij = N_ij / Σ_j N_ij,
μ_i = Σ_t γ_t(i) y_t / Σ_t γ_t(i), and Σ_i to the weighted covariance with its eigenvalues raised to the floor: the
maximiser of the expected log-likelihood under that floor, so the likelihood never decreases. A covariance that is shrunk
or made of factors is no maximiser: the run then ends where the likelihood no longer changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from inscrutable import tolerances, validation
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array
from inscrutable.worlds.covariances import CovarianceRule, LedoitWolfCovariance
from inscrutable.worlds.observations import Labels

START_PERSISTENCE = 0.9
"""Probability of staying in a state at every starting point: regimes are persistent."""


@dataclass(frozen=True)
class Standardised:
    """Observations as rows = (raw − centre) / scale, so that one floor fits every unit; or these times `mix`⁻¹.

    With `mix` (D,D) the shrunk covariance of the whole sample is the identity: a regime shrunk towards a multiple of the
    identity is then shrunk towards a multiple of the sample's covariance. None leaves the rows as they are.

    `log_volume` is the change of one observation's log density by the scaling.
    """

    rows: Array
    centre: Array
    scale: Array
    log_volume: float
    mix: Array | None = None

    @cached_property
    def varied(self) -> Array:
        """Orthonormal directions (D,k) in which the whole sample varies by more than the floor, as along no constant column."""
        sizes, directions = np.linalg.eigh(np.atleast_2d(np.cov(self.rows.T, bias=True)))
        return np.asarray(directions[:, sizes > tolerances.COVARIANCE_FLOOR])

    def mixed(self) -> Standardised:
        """Return the same observations with the shrunk covariance of the whole sample as the unit."""
        shares = np.full(len(self.rows), 1.0 / len(self.rows))
        whole = LedoitWolfCovariance().estimate(self.rows, shares).covariance
        factor = np.linalg.cholesky(_raised(whole[None])[0]).T
        rows = np.linalg.solve(factor.T, self.rows.T).T
        volume = self.log_volume + float(np.log(np.diag(factor)).sum())
        return replace(self, rows=np.ascontiguousarray(rows), log_volume=volume, mix=factor)

    def in_units(self, means: Array, covariances: Array) -> tuple[Array, Array]:
        """Return means (X,D) and covariances (X,D,D) of the rows in the data's own unit."""
        if self.mix is not None:
            means = means @ self.mix
            covariances = self.mix.T @ covariances @ self.mix
            covariances = (covariances + covariances.transpose(0, 2, 1)) / 2.0
        return self.centre + self.scale * means, covariances * np.outer(self.scale, self.scale)


@dataclass(frozen=True)
class Parameters:
    """A world over standardised data: initial (X,), transition (X,X), means (X,D), covariances (X,D,D).

    `n_free` (X,) is the effective number of parameters of each covariance.
    """

    initial: Array
    transition: Array
    means: Array
    covariances: Array
    n_free: Array

    def reordered(self, order: NDArray[np.int64]) -> Parameters:
        """Return the same world with its states in another order."""
        transition = self.transition[np.ix_(order, order)]
        own = (each[order] for each in (self.means, self.covariances, self.n_free))
        return Parameters(self.initial[order], transition, *own)

    @property
    def n_parameters(self) -> float:
        """Effective number of parameters of the whole world."""
        n_states = len(self.initial)
        return float(self.means.size + self.n_free.sum() + (n_states - 1) * (n_states + 1))


def standardised(raw: Array, names: Labels | None = None) -> Standardised:
    """Scale every column of observations (T,D) to zero mean and unit variance; a constant one gets the smallest scale."""
    constant = validation.constant_columns(raw)
    if constant.all():
        raise ModelError(f"all {len(raw)} observations are equal: there is no variance to fit")
    with np.errstate(over="ignore", invalid="ignore"):
        centre, scale = np.where(constant, raw[0], raw.mean(axis=0)), raw.std(axis=0)
        variances = np.where(constant, 1.0, scale**2)
    bad = np.flatnonzero(~(np.isfinite(centre) & (variances >= np.finfo(np.float64).tiny) & np.isfinite(variances)))
    if bad.size:
        d = int(bad[0])
        column = f"{d}" if names is None else f"{d} ({names[d]})"
        raise InputError(
            f"observations in column {column} are of size {np.abs(raw[:, d]).max():g}, whose variance has no floating-point "
            "number: take out markers of missing values, or use another unit"
        )
    scale[constant] = scale[~constant].min()
    rows = (raw - centre) / scale
    return Standardised(rows, centre, scale, float(np.log(scale).sum()))


class Climb:
    """Baum-Welch from one starting point, in steps that can be interrupted.

    `trace` holds the log-likelihood of the standardised data before each step; its last entry and `weights` (expected
    number of observations of each state) belong to the current `parameters`.
    """

    def __init__(self, data: Standardised, responsibilities: Array, rule: CovarianceRule) -> None:
        n_states, n_dims = responsibilities.shape[1], data.rows.shape[1]
        sticky = START_PERSISTENCE * np.eye(n_states) + (1.0 - START_PERSISTENCE) / n_states
        unit = np.tile(np.eye(n_dims), (n_states, 1, 1))
        blank = Parameters(sticky[0], sticky, np.zeros((n_states, n_dims)), unit, np.zeros(n_states))
        self._data = data
        self._rule = rule
        self._responsibilities = responsibilities
        self._counts: Array = sticky
        self.parameters = _maximise(data.rows, responsibilities, sticky, blank, rule)
        self.trace: list[float] = []
        self.converged = False

    @property
    def weights(self) -> Array:
        """Expected number of observations of each state, (X,)."""
        return np.asarray(self._responsibilities.sum(axis=0))

    @property
    def least_weight(self) -> int:
        """Fewest observations that a state's covariance needs."""
        return self._rule.least_observations(self._data.rows.shape[1])

    def run(self, limit: int) -> None:
        """Continue until the gain is too small or the likelihood has been evaluated `limit` times."""
        rows = self._data.rows
        while not self.converged and len(self.trace) < limit:
            if self.trace:
                self.parameters = _maximise(rows, self._responsibilities, self._counts, self.parameters, self._rule)
            self._expect()
            gain = self.trace[-1] - self.trace[-2] if len(self.trace) > 1 else np.inf
            moved = gain if self._rule.maximises else abs(gain)
            self.converged = bool(moved < tolerances.EM_CHANGE * len(rows))

    def _expect(self) -> None:
        from inscrutable.kernels.hidden_markov import expectation_pass, filter_pass, gaussian_log_densities

        now = self.parameters
        densities = gaussian_log_densities(self._data.rows, now.means, np.linalg.cholesky(now.covariances))
        with np.errstate(divide="ignore"):
            log_initial, log_transition = np.log(now.initial), np.log(now.transition)
        log_beliefs, log_predicted, _, _, increments = filter_pass(log_initial, log_transition, densities)
        self._responsibilities, self._counts = expectation_pass(log_beliefs, log_predicted, log_transition)
        self.trace.append(float(increments.sum()))

    def collapsed(self) -> tuple[int, ...]:
        """States with fewer observations than a covariance needs, or at the floor where the whole sample varies."""
        varied = self._data.varied
        spreads = np.linalg.eigvalsh(varied.T @ self.parameters.covariances @ varied)
        at_floor = (spreads < 2.0 * tolerances.COVARIANCE_FLOOR).any(axis=1)
        return tuple(int(i) for i in np.flatnonzero((self.weights < self.least_weight) | at_floor))

    def order_by_volatility(self) -> None:
        """Put the states in the order of the trace of their covariance in the data's own unit, smallest first."""
        _, covariances = self._data.in_units(self.parameters.means, self.parameters.covariances)
        volatility = np.trace(covariances, axis1=1, axis2=2)
        order = np.asarray(np.argsort(volatility, kind="stable"), dtype=np.int64)
        self.parameters = self.parameters.reordered(order)
        self._responsibilities = self._responsibilities[:, order]
        self._counts = self._counts[np.ix_(order, order)]


def _maximise(
    rows: Array, responsibilities: Array, counts: Array, previous: Parameters, rule: CovarianceRule
) -> Parameters:
    """Maximise the expected log-likelihood; a state that nothing is assigned to keeps its previous parameters."""
    tiny = np.finfo(np.float64).tiny
    transition = previous.transition.copy()
    left = counts.sum(axis=1)
    transition[left > tiny] = counts[left > tiny] / left[left > tiny, None]
    means, covariances, n_free = previous.means.copy(), previous.covariances.copy(), previous.n_free.copy()
    weights = responsibilities.sum(axis=0)
    for state in np.flatnonzero(weights > tiny):
        share = responsibilities[:, state] / weights[state]
        means[state] = share @ rows
        covariances[state], n_free[state] = rule.estimate(rows - means[state], share)
    covariances = _raised(covariances)
    return Parameters(responsibilities[0] / responsibilities[0].sum(), transition, means, covariances, n_free)


def _raised(covariances: Array) -> Array:
    """Return covariances (X,D,D) with their eigenvalues raised to the floor."""
    found = covariances.copy()
    values, vectors = np.linalg.eigh((covariances + covariances.transpose(0, 2, 1)) / 2.0)
    for state in np.flatnonzero(values[:, 0] < tolerances.COVARIANCE_FLOOR):
        raised = np.maximum(values[state], tolerances.COVARIANCE_FLOOR)
        found[state] = (vectors[state] * raised) @ vectors[state].T
    return found
