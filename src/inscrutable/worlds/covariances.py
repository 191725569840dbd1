"""Estimators of covariances within a fit: sample, shrunk towards a multiple of the identity, or factor models.

A full covariance of D columns has D (D + 1)/2 entries, so a regime needs several times D observations. With fewer, its
small eigenvalues are far too small: it is overfitted. Shrinkage and factors need fewer.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from inscrutable import validation
from inscrutable.errors import InputError
from inscrutable.validation import Array

FEWEST = 5
"""Least number of observations of a regime, whatever the estimator: fewer are single events."""

ENOUGH = 10.0
"""Observations per regime and column from which full covariances are the default. On returns simulated from three regimes
with common factors, beliefs under fitted worlds with 8 of them and 12 columns were 1.5 times as far from the truth with
full covariances as with shrunk ones, with 8 and 30 columns 1.2 times, with 2 and 60 columns no better than the prior."""


class Estimate(NamedTuple):
    """A covariance (D,D) and its effective number of parameters."""

    covariance: Array
    n_parameters: float


class CovarianceRule(Protocol):
    """An estimator of a covariance from weighted observations."""

    @property
    def name(self) -> str:
        """Its name in arguments and messages."""
        ...

    @property
    def maximises(self) -> bool:
        """Whether it maximises the likelihood, which then never falls from step to step."""
        ...

    @property
    def shrinks(self) -> bool:
        """Whether it shrinks towards a multiple of the identity, so that the units of the data matter."""
        ...

    def least_observations(self, n_columns: int) -> int:
        """Least number of observations of a regime for a usable covariance."""
        ...

    def estimate(self, deviations: Array, shares: Array) -> Estimate:
        """Return the covariance of deviations (T,D) from the mean with weights (T,) that sum to one."""
        ...


@dataclass(frozen=True)
class SampleCovariance:
    """S = Σ_t w_t y_t y_t'."""

    name: str = "sample"
    maximises: bool = True
    shrinks: bool = False

    def least_observations(self, n_columns: int) -> int:
        """D + 1: from then on it is not singular."""
        return n_columns + 1

    def estimate(self, deviations: Array, shares: Array) -> Estimate:
        """Return S."""
        n_columns = deviations.shape[1]
        return Estimate((deviations * shares[:, None]).T @ deviations, 0.5 * n_columns * (n_columns + 1))


@dataclass(frozen=True)
class LedoitWolfCovariance:
    """(1 − δ) S + δ m I with m = tr S / D and the δ of least expected square error, estimated from the same data.

    With weights w_t that sum to one, δ = min(1, Σ_t w_t² ‖y_t y_t' − S‖² / ‖S − m I‖²); equal weights give the published
    formula. Columns are standardised before, so that the target does not depend on units.

    Source: Ledoit and Wolf, Journal of Multivariate Analysis 88 (2004).
    """

    name: str = "ledoit-wolf"
    maximises: bool = False
    shrinks: bool = True

    def least_observations(self, n_columns: int) -> int:
        """A few, whatever the number of columns."""
        return min(FEWEST, n_columns + 1)

    def estimate(self, deviations: Array, shares: Array) -> Estimate:
        """Return the shrunk covariance."""
        n_columns = deviations.shape[1]
        sample = (deviations * shares[:, None]).T @ deviations
        level = float(np.trace(sample)) / n_columns
        apart = float(((sample - level * np.eye(n_columns)) ** 2).sum())
        squares = shares**2
        lengths = (deviations**2).sum(axis=1)
        along = ((deviations @ sample) * deviations).sum(axis=1)
        noise = float(squares @ (lengths**2 - 2.0 * along) + squares.sum() * (sample**2).sum())
        share = min(1.0, max(noise, 0.0) / apart) if apart > 0 else 1.0
        shrunk = (1.0 - share) * sample
        shrunk[np.diag_indices(n_columns)] += share * level
        return Estimate(shrunk, 1.0 + (1.0 - share) * (0.5 * n_columns * (n_columns + 1) - 1.0))


@dataclass(frozen=True)
class FactorCovariance:
    """B B' + diag(S − B B'), B the first k principal components of S, each as long as its standard deviation.

    Args:
        n_factors: k, at least 1.

    Source: the principal-factor method; Chamberlain and Rothschild, Econometrica 51 (1983), for returns.
    """

    n_factors: int
    maximises: bool = False
    shrinks: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "n_factors", validation.count(self.n_factors, "number of factors"))

    @property
    def name(self) -> str:
        """Its name in arguments: factor:k."""
        return f"factor:{self.n_factors}"

    def least_observations(self, n_columns: int) -> int:
        """k + 2: with fewer observations the factors explain all variance."""
        return min(max(FEWEST, self.n_factors + 2), n_columns + 1)

    def estimate(self, deviations: Array, shares: Array) -> Estimate:
        """Return the factor covariance; with as many factors as columns it is S."""
        n_columns = deviations.shape[1]
        k = min(self.n_factors, n_columns)
        sample = (deviations * shares[:, None]).T @ deviations
        values, vectors = np.linalg.eigh(sample)
        common = (vectors[:, -k:] * values[-k:]) @ vectors[:, -k:].T
        common[np.diag_indices(n_columns)] = np.diag(sample)
        free = n_columns * k - 0.5 * k * (k - 1) + n_columns
        return Estimate(common, min(free, 0.5 * n_columns * (n_columns + 1)))


def covariance_rule(given: str | None, n_rows: int, n_columns: int, n_states: int) -> CovarianceRule:
    """Return the rule that a name stands for; None chooses by the amount of data.

    Args:
        given: "sample", "ledoit-wolf", "factor:k", or None: "sample" from `ENOUGH` observations per regime and column on,
            and for a single column, else "ledoit-wolf".
        n_rows: T.
        n_columns: D.
        n_states: X.

    Raises:
        InputError: Another name, or a number of factors that is not a whole number from 1 to D − 1.
    """
    if given is None:
        enough = n_columns == 1 or n_rows >= ENOUGH * n_states * n_columns
        return SampleCovariance() if enough else LedoitWolfCovariance()
    rule = named_rule(given)
    if isinstance(rule, FactorCovariance) and rule.n_factors >= n_columns:
        most = f'at most "factor:{n_columns - 1}"' if n_columns > 1 else '"sample"'
        raise InputError(
            f'covariance is "{given}", expected {most}: as many factors as columns ({n_columns}) make the sample covariance'
        )
    return rule


def named_rule(given: str) -> CovarianceRule:
    """Return the rule of a name, for any number of columns.

    Raises:
        InputError: Another name, or a number of factors that is not a whole number of at least 1.
    """
    if given == "sample":
        return SampleCovariance()
    if given == "ledoit-wolf":
        return LedoitWolfCovariance()
    factors = re.fullmatch(r"factor:([0-9]{1,6})", given) if isinstance(given, str) else None
    if factors is None or int(factors[1]) < 1:
        raise InputError(f'covariance must be "sample", "ledoit-wolf" or "factor:K" such as "factor:3", got {given!r}')
    return FactorCovariance(int(factors[1]))
