"""Fitting a Gaussian hidden Markov model to observations by Baum-Welch, with restarts that can be compared.

The likelihood has many local optima and is unbounded where a regime shrinks onto one point. Hence several starts of
three kinds, each reported; a floor under every covariance; and regimes in the order of their volatility, so that
"regime 1" is the same in every run.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inscrutable import validation
from inscrutable.errors import InputError
from inscrutable.saved import Summarised
from inscrutable.validation import Array
from inscrutable.worlds.baum_welch import Climb, Standardised, standardised
from inscrutable.worlds.covariances import CovarianceRule, covariance_rule
from inscrutable.worlds.emissions import GaussianEmission
from inscrutable.worlds.hidden_markov import HiddenMarkovModel
from inscrutable.worlds.observations import Labels, column_labels, is_labelled, real_rows

TRIALS = 12
"""Starting points of one restart. Most lead to poor optima, which ten steps show: on monthly returns of a dozen industries one
restart of twelve starts reaches the likelihood of ten single starts."""

HEATS = ((10, 4), (25, 1))
"""Number of steps, and of the starting points kept after them; the last one is run to convergence."""

MOST_PARAMETERS = 0.25
"""Effective parameters per number of the sample above which a fit is doubted. In simulated markets of 12 to 60 assets, fits
above it gave beliefs farther from the true ones than the prior's mean is, and ended in the partition they started from."""

LEAST_OBSERVATIONS = 0.75
"""Expected observations of a regime per parameter of its mean and full covariance below which a fit is doubted. In 236
simulated markets of 3 to 8 assets, fitted on 60 to 300 rows, the median error of the beliefs is .75 of that of the prior's mean
below it, .67 up to one observation per parameter, and .50 above that."""

_LOGGER = logging.getLogger(__name__)

MAX_ITERATIONS = 500
"""Baum-Welch steps of one restart; on monthly returns it converges in some tens to three hundred."""


@dataclass(frozen=True)
class Restart:
    """The result of one restart of Baum-Welch.

    Args:
        log_likelihood: Natural logarithm of the likelihood reached, in the observations' unit.
        n_iterations: Number of evaluations of the likelihood.
        converged: Whether the gain per observation fell below `tolerances.EM_CHANGE` within the allowed steps.
        collapsed: Regimes, counted from 0 in the result's order, at the covariance floor or with fewer observations than a
            covariance needs.
        note: The same in words, with the number of observations; empty if none collapsed.
        trace: The log-likelihood before each step; with full covariances it never decreases.
        n_parameters: Effective number of parameters of the world; shrunk covariances count in part.
        weights: Expected number of observations of each regime, in the result's order.
    """

    log_likelihood: float
    n_iterations: int
    converged: bool
    collapsed: tuple[int, ...]
    note: str
    trace: tuple[float, ...]
    n_parameters: float = float("nan")
    weights: tuple[float, ...] = ()


@dataclass(frozen=True, repr=False)
class FittedWorld(Summarised):
    """The best world found by several restarts of the fit.

    Args:
        world: Regimes ordered by volatility (trace of the covariance), calmest first. Its `initial` is the smoothed belief
            about the first observation of the sample, the maximum-likelihood estimate; for other data build
            `HiddenMarkovModel(world.transition, world.emission)`, which starts from the stationary law.
        log_likelihood: Natural logarithm of the sample's likelihood under `world`, as `filter_beliefs` gives it.
        restarts: One row for each restart, in the order in which they were run.
        covariance: How covariances were estimated: "sample", "ledoit-wolf" or "factor:k".
        n_rows: T of the sample.
        n_columns: D of the sample.

    Example:
        >>> import numpy as np
        >>> from inscrutable.worlds import fit_gaussian_hmm
        >>> returns = np.random.default_rng(0).normal(size=40)
        >>> fitted = fit_gaussian_hmm(returns, 1, rng=np.random.default_rng(1), n_restarts=1)
        >>> print(fitted.summary())
        log-likelihood  iterations  converged  note
              -47.1827           2        yes
    """

    world: HiddenMarkovModel
    log_likelihood: float
    restarts: tuple[Restart, ...]
    covariance: str = "sample"
    n_rows: int = 0
    n_columns: int = 0

    @property
    def best(self) -> Restart:
        """The restart whose world was kept."""
        return max(self.restarts, key=_rank)

    @property
    def alike(self) -> int:
        """Number of restarts that came within one nat of the best one; collapsed ones do not count where it is none."""
        best = self.best
        return sum(
            best.log_likelihood - each.log_likelihood < 1.0 and bool(each.collapsed) == bool(best.collapsed)
            for each in self.restarts
        )

    @property
    def size(self) -> str:
        """Numbers of parameters and of data, in words."""
        return (
            f"{self.best.n_parameters:,.0f} effective parameters ({self.covariance} covariances) on "
            f"{self.n_rows * self.n_columns:,} numbers, {self.n_rows} rows of {self.n_columns} columns"
        )

    @property
    def doubt(self) -> str:
        """Why the fit is not usable: it collapsed, or has too many parameters for its data; else empty."""
        found = self.best
        shrunk = self.covariance == "sample" and self.n_columns > 1
        fewer = " or ".join(
            name for name, n in (("regimes", self.world.n_states), ("columns", self.n_columns)) if n > 1
        )
        ways = ["shrunk covariances (ledoit-wolf or factor:K)"] * shrunk + [f"fewer {fewer}"] * bool(fewer)
        advice = f"{self.size}. Use {', '.join([*ways, 'or more rows'] if ways else ['more rows'])}"
        if found.collapsed:
            rule = covariance_rule(self.covariance, self.n_rows, self.n_columns, self.world.n_states)
            where = ", ".join(f"{self.world.names[i]} on {found.weights[i]:.1f} observations" for i in found.collapsed)
            starts = "each" if len(self.restarts) > 1 else "the one"
            return (
                f"the fit collapsed in {starts} of {len(self.restarts)} starts: {where}, where {self.covariance} "
                f"covariances need {rule.least_observations(self.n_columns)} and more; {advice}"
            )
        if found.n_parameters > MOST_PARAMETERS * self.n_rows * self.n_columns:
            return f"the fit follows its sample rather than regimes: {advice}"
        own = self.n_columns * (self.n_columns + 3) // 2
        few = [
            f"{name} rests on {weight:.1f} observations, for {own} parameters of its mean and covariance"
            for name, weight in zip(self.world.names, found.weights, strict=True)
            if self.covariance == "sample" and weight < LEAST_OBSERVATIONS * own
        ]
        return f"{'; '.join(few)}; {advice}" if few else ""

    @property
    def asset_names(self) -> Labels | None:
        """Labels of the columns the world was fitted on, None if they had none."""
        emission = self.world.emission
        return emission.asset_names if isinstance(emission, GaussianEmission) else None

    def summary(self) -> str:
        """Return a table of the restarts as text, the best one first."""
        lines = ["log-likelihood  iterations  converged  note"]
        for row in sorted(self.restarts, key=_rank, reverse=True):
            converged = "yes" if row.converged else "no"
            lines.append(f"{row.log_likelihood:14.4f}  {row.n_iterations:10d}  {converged:>9}  {row.note}".rstrip())
        return "\n".join(lines)


def fit_gaussian_hmm(
    observations: Any,
    n_states: int,
    *,
    rng: np.random.Generator,
    n_restarts: int = 10,
    covariance: str | None = None,
) -> FittedWorld:
    """Fit a hidden Markov model with Gaussian observations by maximum likelihood (Baum-Welch).

    max over (π_0, P, μ, Σ) of log p(y_0..T-1), subject to every Σ_i ≥ COVARIANCE_FLOOR · I after the columns are
    scaled to unit variance. The expectations are computed in log space; a covariance below the floor has its
    eigenvalues raised to it, which is the exact maximiser under that constraint, so the likelihood never decreases.
    Each restart runs `TRIALS` random starting points for a few steps and keeps the likelier ones.
    The best restart without a collapsed regime is returned, or the best of all if each has one; `FittedWorld.doubt` and a
    warning in the log then say so. Shrunk and factor covariances do not maximise the likelihood; a restart then ends where its
    likelihood no longer changes.

    Args:
        observations: (T,D) real vectors, or (T,) for D = 1. The columns of a DataFrame become `asset_names`.
        n_states: Number of regimes X, at least 1 and at most the number of different observations.
        rng: Randomness of the starting points; each restart has its own child generator.
        n_restarts: Number of restarts, at least 1. Where their likelihoods differ, as on real returns, more restarts find a
            larger one.
        covariance: "sample" for full covariances; "ledoit-wolf" for covariances shrunk towards a multiple of the identity;
            "factor:k" for k factors and specific variances. None takes full ones from ten observations per regime and column
            on (T ≥ 10 X D), else shrunk ones.

    Returns:
        The world, its log-likelihood and the table of restarts.

    Raises:
        InputError: Missing entries (row and column named), a column whose variance is too large or too small for a
            floating-point number, fewer different observations than regimes, or an unknown `covariance`.
        ModelError: Observations that are all equal.

    Cost: O(n_restarts · iterations · T (X D² + X²)); about a second for ten restarts on 490 × 12 observations and three
    regimes.

    Source: Rabiner, Proceedings of the IEEE 77 (1989), §III.C; for the Markowitz regimes Lourenço et al. (2020), §II; for
    shrunk covariances Ledoit and Wolf, Journal of Multivariate Analysis 88 (2004).

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
    if is_labelled(observations):
        validation.time_order(observations.index, "observations")
    rows = real_rows(observations)
    distinct = len(np.unique(rows, axis=0))
    if distinct < n_states:
        raise InputError(f"n_states is {n_states}, but there are only {distinct} different observations")
    rule = covariance_rule(covariance, len(rows), rows.shape[1], n_states)
    data = standardised(rows, column_labels(observations))
    if rule.shrinks:
        data = data.mixed()
    climbs = [_restart(data, n_states, rule, child) for child in rng.spawn(n_restarts)]
    table = tuple(_judge(data, climb) for climb in climbs)
    best = max(range(n_restarts), key=lambda k: _rank(table[k]))
    parameters = climbs[best].parameters
    emission = GaussianEmission(
        *data.in_units(parameters.means, parameters.covariances),
        asset_names=column_labels(observations),
    )
    world = HiddenMarkovModel(parameters.transition, emission, parameters.initial)
    fitted = FittedWorld(world, _log_likelihood(world, rows), table, rule.name, len(rows), rows.shape[1])
    if fitted.doubt:
        _LOGGER.warning("%s", fitted.doubt)
    return fitted


def _rank(restart: Restart) -> tuple[bool, float]:
    return not restart.collapsed, restart.log_likelihood


def _restart(data: Standardised, n_states: int, rule: CovarianceRule, rng: np.random.Generator) -> Climb:
    """Run all starting points for some steps, drop the worst, collapsed ones first, and repeat; run the last one to
    convergence."""
    climbs = [Climb(data, starting_responsibilities(data.rows, n_states, kind, rng), rule) for kind in range(TRIALS)]
    for n_steps, n_kept in HEATS:
        for climb in climbs:
            climb.run(n_steps)
        climbs = sorted(climbs, key=lambda climb: (bool(climb.collapsed()), -climb.trace[-1]))[:n_kept]
    climbs[0].run(MAX_ITERATIONS)
    climbs[0].order_by_volatility()
    return climbs[0]


def _judge(data: Standardised, climb: Climb) -> Restart:
    collapsed = climb.collapsed()
    weights = climb.weights
    notes = [f"regime {i + 1} collapsed on {weights[i]:.1f} observations" for i in collapsed]
    if not climb.converged:
        notes.append(f"still improving after {len(climb.trace)} iterations")
    trace = tuple(value - len(data.rows) * data.log_volume for value in climb.trace)
    used = climb.parameters.n_parameters, tuple(float(weight) for weight in weights)
    return Restart(trace[-1], len(trace), climb.converged, collapsed, "; ".join(notes), trace, *used)


def _log_likelihood(world: HiddenMarkovModel, rows: Array) -> float:
    from inscrutable.kernels.hidden_markov import filter_pass

    with np.errstate(divide="ignore"):
        log_initial, log_transition = np.log(world.initial), np.log(world.transition)
    increments: Array = filter_pass(log_initial, log_transition, world.emission.log_likelihoods(rows))[-1]
    return float(np.cumsum(increments)[-1])


Assignment = NDArray[np.int64]

START_SHARE = 0.9
"""Weight of the guessed state in a starting point; the rest is spread evenly, so no state starts without data."""


def starting_responsibilities(rows: Array, n_states: int, kind: int, rng: np.random.Generator) -> Array:
    """Guess the state of each row of standardised data; `kind` counts restarts, the guesses (T,X) cycle through three.

    Regimes of markets differ mostly in volatility, those of other sensors in level, and both last for a while.
    """
    guess = (_by_volatility, _by_level, _by_period)[kind % 3]
    labels = guess(rows, n_states, rng)
    return START_SHARE * np.eye(n_states)[labels] + (1.0 - START_SHARE) / n_states


def _by_volatility(rows: Array, n_states: int, rng: np.random.Generator) -> Assignment:
    """Cut a moving mean of the squared norm at random quantiles."""
    n_steps = len(rows)
    window = int(rng.integers(1, max(2, n_steps // (10 * n_states)) + 1))
    power = np.convolve((rows**2).sum(axis=1), np.ones(window) / window, mode="same")
    shares = np.cumsum(rng.dirichlet(np.full(n_states, 5.0)))[:-1]
    return np.asarray(np.searchsorted(np.quantile(power, shares), power), dtype=np.int64)


def _by_level(rows: Array, n_states: int, rng: np.random.Generator) -> Assignment:
    """Assign each row to the nearest of centres drawn far apart (k-means++), moved by a few steps of k-means."""
    centres = rows[[int(rng.integers(len(rows)))]]
    while len(centres) < n_states:
        nearest = _square_distances(rows, centres).min(axis=1)
        centres = np.vstack([centres, rows[int(rng.choice(len(rows), p=nearest / nearest.sum()))]])
    for _ in range(3):
        labels = _square_distances(rows, centres).argmin(axis=1)
        for state in np.unique(labels):
            centres[state] = rows[labels == state].mean(axis=0)
    return np.asarray(_square_distances(rows, centres).argmin(axis=1), dtype=np.int64)


def _by_period(rows: Array, n_states: int, rng: np.random.Generator) -> Assignment:
    """Cut time into periods, a few for each state, and assign states to them at random."""
    n_periods = min(len(rows), n_states * int(rng.integers(1, 5)))
    dealt = rng.permutation(np.arange(n_periods) % n_states)
    cuts = np.sort(rng.choice(np.arange(1, len(rows)), size=n_periods - 1, replace=False))
    return np.asarray(dealt[np.searchsorted(cuts, np.arange(len(rows)), side="right")], dtype=np.int64)


def _square_distances(rows: Array, centres: Array) -> Array:
    return np.asarray(((rows[:, None, :] - centres[None, :, :]) ** 2).sum(axis=-1))
