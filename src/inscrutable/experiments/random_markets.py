"""The paper's "randomly generated three-regime portfolio allocation scenario", with everything it leaves open stated."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from inscrutable import validation
from inscrutable.errors import InputError, ModelError
from inscrutable.filtering import filter_beliefs
from inscrutable.problems import MarkowitzProblem, Polyhedron, simplex
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, GaussianEmission, HiddenMarkovModel

WARM_UP = 10
"""Steps filtered before the first belief is used, so that it does not hang on the prior."""

_MOST_DRAWS = 1000
SENSORS = ("categorical", "gaussian")


@dataclass(frozen=True)
class SensorLaw:
    """What the agent observes of the regime.

    Args:
        kind: "categorical" reports one of X symbols, one named after each regime; "gaussian" reports the assets'
            returns of the period, drawn from N(μ_i, Σ_i).
        accuracy: Probability that the categorical sensor reports the true regime's symbol, in (0, 1]; what is left
            goes to the other symbols by a flat Dirichlet draw.

    Raises:
        InputError: The kind is unknown, or the accuracy is not a probability above 0.

    Example:
        >>> SensorLaw()
        SensorLaw(kind='categorical', accuracy=0.7)
    """

    kind: str = "categorical"
    accuracy: float = 0.7

    def __post_init__(self) -> None:
        if self.kind not in SENSORS:
            raise InputError(f"the sensor's kind must be one of {SENSORS}, got {self.kind!r}")
        _probability(self.accuracy, "accuracy")


@dataclass(frozen=True)
class MarketLaw:
    """How a random market is drawn; the paper names none of these, so each is a default that a study can change.

    Formulas: μ_ij ~ Uniform(means); Σ_i = D_i R_i D_i with standard deviations on D_i's diagonal ~ Uniform(volatilities)
    and R_i the correlations of U + 3 standard normal vectors; P_ii = persistence, the rest of the row by a flat
    Dirichlet draw. The regimes are independent. A regime whose own optimal cost V(e_i) is not above 0 is drawn again:
    V is concave, so V > 0 on all of Δ exactly when it is at every corner, and then the paper's budget c*(1 + c_b) is
    never below c*.

    Args:
        n_regimes: X, at least 2.
        n_assets: U, at least 2.
        means: Lowest and highest mean return μ_ij, per period (say a month) as a fraction.
        volatilities: Lowest and highest standard deviation of a return, per period as a fraction, above 0.
        risk_aversion: γ of γ u'Σu − μ'u, above 0.
        persistence: P_ii, in (0, 1].
        sensor: What the agent observes.

    Raises:
        InputError: A number is out of its range.

    Source: the paper, eq. (7) and Section V-A. Example: see `random_market`.
    """

    n_regimes: int = 3
    n_assets: int = 3
    means: tuple[float, float] = (-0.01, 0.02)
    volatilities: tuple[float, float] = (0.04, 0.12)
    risk_aversion: float = 5.0
    persistence: float = 0.8
    sensor: SensorLaw = field(default_factory=SensorLaw)

    def __post_init__(self) -> None:
        validation.count(self.n_regimes, "n_regimes", least=2)
        validation.count(self.n_assets, "n_assets", least=2)
        _ordered(self.means, "means")
        validation.positive(_ordered(self.volatilities, "volatilities")[0], "the lowest volatility")
        validation.positive(self.risk_aversion, "risk_aversion")
        _probability(self.persistence, "persistence")


@dataclass(frozen=True, eq=False)
class Market:
    """A world and the investor's problem in it: the same regimes drive both."""

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
        law: How to draw; None is `MarketLaw()`.
        rng: The only source of randomness.

    Returns:
        A `Market` whose optimal cost is above 0 for every belief.

    Raises:
        InputError: `rng` is not a generator.
        ModelError: A thousand draws of one regime all had V(e_i) <= 0: the means are too high for the risk.

    Cost: a forward solve per regime drawn. Source: the paper, Section V-A.

    Example:
        >>> market = random_market(rng=np.random.default_rng(0))
        >>> bool(market.problem.optimal_cost(np.eye(3)).min() > 0)
        True
        >>> market.beliefs(2, rng=np.random.default_rng(1)).shape
        (2, 3)
    """
    chosen = MarketLaw() if law is None else law
    validation.generator(rng)
    weights = simplex(chosen.n_assets)
    regimes = [_regime(chosen, weights, i, rng) for i in range(chosen.n_regimes)]
    means = np.array([mean for mean, _ in regimes])
    covariances = np.array([covariance for _, covariance in regimes])
    problem = MarkowitzProblem(means, covariances, chosen.risk_aversion, weights)
    transition = _diagonal_and_rest(chosen.persistence, chosen.n_regimes, rng)
    if chosen.sensor.kind == "gaussian":
        return Market(HiddenMarkovModel(transition, GaussianEmission(means, covariances)), problem)
    symbols = _diagonal_and_rest(chosen.sensor.accuracy, chosen.n_regimes, rng)
    return Market(HiddenMarkovModel(transition, CategoricalEmission(symbols)), problem)


def _regime(law: MarketLaw, weights: Polyhedron, number: int, rng: np.random.Generator) -> tuple[Array, Array]:
    for _ in range(_MOST_DRAWS):
        mean = rng.uniform(*law.means, size=law.n_assets)
        deviations = rng.uniform(*law.volatilities, size=law.n_assets)
        factors = rng.standard_normal((law.n_assets, law.n_assets + 3))
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


def _probability(value: float, name: str) -> None:
    if not 0 < validation.number_of(value, name) <= 1:
        raise InputError(f"{name} must be above 0 and at most 1, got {value:g}")


def _ordered(pair: tuple[float, float], name: str) -> Array:
    limits = validation.finite_array(pair, name, ndim=1)
    if limits.size != 2 or limits[0] > limits[1]:
        raise InputError(f"{name} must be a lowest and a highest value, got {pair!r}")
    return limits
