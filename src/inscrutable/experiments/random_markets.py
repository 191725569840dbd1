"""The paper's "randomly generated three-regime portfolio allocation scenario", with all unspecified choices documented."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from inscrutable import validation
from inscrutable.errors import ModelError
from inscrutable.experiments.sections import AtLeastTwo, Likely, Pair, Positive, PositivePair, Section
from inscrutable.filtering import filter_beliefs
from inscrutable.problems import MarkowitzProblem, Polyhedron, simplex
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, GaussianEmission, HiddenMarkovModel

WARM_UP = 10
"""Burn-in steps before the first belief, so that it does not depend on the prior."""

_MOST_DRAWS = 1000


class MarketLaw(Section):
    """The law of random markets; the paper states none of these numbers, so each is a default that a study can change.

    Formulas: μ_ij ~ Uniform(means); Σ_i = D_i R_i D_i with standard deviations on D_i's diagonal ~ Uniform(volatilities)
    and R_i the correlations of U + 3 standard normal vectors; P_ii = persistence, the rest of the row by a flat
    Dirichlet draw. The regimes are independent. A regime whose own optimal cost V(e_i) is not above 0 is drawn again:
    V is concave, so V > 0 on all of Δ exactly when it is at every corner, and then the paper's budget c*(1 + c_b) is
    never below c*.

    Args:
        regimes: X, at least 2.
        assets: U, at least 2.
        means: Lowest and highest mean return μ_ij, per period (such as a month), as a fraction.
        volatilities: Lowest and highest standard deviation of a return, per period as a fraction, above 0.
        risk_aversion: γ of γ u'Σu − μ'u, above 0.
        persistence: P_ii, in (0, 1].
        sensor: The agent's sensor: "categorical" reports one of X symbols, one per regime; "gaussian" reports the assets'
            returns of the period, drawn from N(μ_i, Σ_i).
        accuracy: Probability that the categorical sensor reports the true regime's symbol, in (0, 1]; a flat Dirichlet draw
            divides the rest among the other symbols.

    Raises:
        InputError: A number is out of its range, or the sensor unknown.

    Source: the paper, eq. (7) and Section V-A. Example: see `random_market`.
    """

    regimes: AtLeastTwo = 3
    assets: AtLeastTwo = 3
    means: Pair = (-0.01, 0.02)
    volatilities: PositivePair = (0.04, 0.12)
    risk_aversion: Positive = 5.0
    persistence: Likely = 0.8
    sensor: Literal["categorical", "gaussian"] = "categorical"
    accuracy: Likely = 0.7


@dataclass(frozen=True, eq=False)
class Market:
    """A world and the investor's problem, with the same regimes."""

    world: HiddenMarkovModel
    problem: MarkowitzProblem

    def beliefs(self, n_steps: int, *, rng: np.random.Generator) -> Array:
        """Return filtered private beliefs (n_steps, X) along one sampled path, after the warm-up."""
        n_steps = validation.count(n_steps, "n_steps")
        path = self.world.sample(WARM_UP + n_steps, rng=rng)
        return np.asarray(filter_beliefs(self.world, path.observations).beliefs)[WARM_UP:]


def random_market(law: MarketLaw | None = None, *, rng: np.random.Generator) -> Market:
    """Return one market drawn from a law.

    Args:
        law: The law; None is `MarketLaw()`.
        rng: Source of the draws.

    Returns:
        A `Market` whose optimal cost is above 0 for every belief.

    Raises:
        InputError: `rng` is not a generator.
        ModelError: A thousand draws of one regime all had V(e_i) <= 0: the means are too high for the risk.

    Cost: one forward solve per drawn regime. Source: the paper, Section V-A.

    Example:
        >>> market = random_market(rng=np.random.default_rng(0))
        >>> bool(market.problem.optimal_cost(np.eye(3)).min() > 0)
        True
        >>> market.beliefs(2, rng=np.random.default_rng(1)).shape
        (2, 3)
    """
    chosen = MarketLaw() if law is None else law
    validation.generator(rng)
    weights = simplex(chosen.assets)
    regimes = [_regime(chosen, weights, i, rng) for i in range(chosen.regimes)]
    means = np.array([mean for mean, _ in regimes])
    covariances = np.array([covariance for _, covariance in regimes])
    problem = MarkowitzProblem(means, covariances, chosen.risk_aversion, weights)
    transition = _diagonal_and_rest(chosen.persistence, chosen.regimes, rng)
    if chosen.sensor == "gaussian":
        return Market(HiddenMarkovModel(transition, GaussianEmission(means, covariances)), problem)
    symbols = _diagonal_and_rest(chosen.accuracy, chosen.regimes, rng)
    return Market(HiddenMarkovModel(transition, CategoricalEmission(symbols)), problem)


def _regime(law: MarketLaw, weights: Polyhedron, number: int, rng: np.random.Generator) -> tuple[Array, Array]:
    for _ in range(_MOST_DRAWS):
        mean = rng.uniform(*law.means, size=law.assets)
        deviations = rng.uniform(*law.volatilities, size=law.assets)
        factors = rng.standard_normal((law.assets, law.assets + 3))
        product = factors @ factors.T
        lengths = np.sqrt(np.diag(product))
        covariance = product * np.outer(deviations / lengths, deviations / lengths)
        alone = MarkowitzProblem(mean[None], covariance[None], law.risk_aversion, weights)
        if float(alone.optimal_cost([1.0])) > 0:
            return mean, covariance
    raise ModelError(
        f"regime {number + 1}: {_MOST_DRAWS} draws had no optimal cost above 0; lower the means {law.means} "
        f"or raise the volatilities {law.volatilities} or the risk aversion {law.risk_aversion:g}"
    )


def _diagonal_and_rest(diagonal: float, n: int, rng: np.random.Generator) -> Array:
    rows = np.diag(np.full(n, diagonal))
    for i in range(n):
        rows[i, np.arange(n) != i] = (1.0 - diagonal) * rng.dirichlet(np.ones(n - 1))
    return rows
