"""A backtest of private means on returns: the signal, its public law from a training sample, and the months after it."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from pydantic import ValidationError

from inscrutable import tolerances, validation
from inscrutable.alphas import AlphaDecisionMaker, AlphaProblem
from inscrutable.alphas.decision_maker import Objective
from inscrutable.axes import Axis
from inscrutable.budgets import Budget
from inscrutable.errors import InputError
from inscrutable.experiments.alpha_backtest import AlphaBacktest, alpha_backtest, momentum_alphas
from inscrutable.experiments.backtest_inputs import (
    ReturnsSample,
    aligned_riskless,
    check_dates,
    refuse_missing,
    sample_until,
)
from inscrutable.experiments.sections import Label, Matrix, Section, shortened
from inscrutable.files import PathLike, path_of, read_json
from inscrutable.validation import Array
from inscrutable.worlds import LinearGaussianWorld
from inscrutable.worlds.covariances import covariance_rule

_LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class AlphaSettings:
    """Settings of an investor with private means, and its budget for privacy.

    Args:
        risk_aversion: γ of γu'Vu − m'u.
        budget: The mean regret, a share of the silence regret or a regret.
        objective: "information" or "error".
        covariance: Estimator of V from the training sample: "sample", "ledoit-wolf" or "factor:k"; None chooses by the
            amount of data.
        train_until: Last date of the training sample, or the month or year at whose end it ends.
        seed: Seed of the draws.

    Example:
        >>> AlphaSettings().budget
        Budget(amount=0.5, is_relative=True)
    """

    risk_aversion: float = 5.0
    budget: Budget = field(default_factory=lambda: Budget(0.5))
    objective: Objective = "information"
    covariance: str | None = None
    train_until: str = "1989-12"
    seed: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "train_until", str(self.train_until))
        object.__setattr__(self, "seed", validation.count(self.seed, "seed", least=0))


def run_alpha_backtest(
    returns: pd.DataFrame,
    alphas: pd.DataFrame | None = None,
    settings: AlphaSettings | None = None,
    *,
    riskless: pd.Series | None = None,
    prior_covariance: pd.DataFrame | None = None,
    world: LinearGaussianWorld | None = None,
) -> AlphaBacktest:
    """Backtest an investor with private expected returns on real returns, against the aware observer.

    Formula: the public law of the alphas is `prior_covariance` or `world`. Without these it is estimated from the T rows
    before the first decision: m_{t+1} = ρ m_t + w, with S = (1/T) Σ m_t m_t', ρ = Σ m_t'm_{t+1} / √(Σ|m_t|² Σ|m_{t+1}|²), and
    (1 − ρ²) S the covariance of w. The investor trades without costs or limits; wealth outside the assets earns the riskless
    return.

    Args:
        returns: Simple returns as fractions, dates in the index, (T,n).
        alphas: Expected excess returns about the row after each date, columns as in `returns`; None: `momentum_alphas`.
        settings: The investor's settings; None: the defaults.
        riskless: Riskless return of every row; None: zero.
        prior_covariance: S, for independent rows.
        world: The dynamics of the alphas.

    Returns:
        An `AlphaBacktest` with the regret and the copier's gain at every date from the end of the training sample on.

    Raises:
        InputError: Dates or labels disagree, or there are too few rows of alphas before the first decision.

    Cost: O(n²) per month, plus that of the rule.

    Example:
        >>> from inscrutable.datasets import load_industry_returns
        >>> found = run_alpha_backtest(load_industry_returns().returns)
        >>> len(found.worth), bool(np.allclose(found.given_up + found.taken, found.worth))
        (327, True)
    """
    chosen = AlphaSettings() if settings is None else settings
    sample = sample_until(returns, chosen.train_until, None)
    if riskless is not None:
        rates = aligned_riskless(riskless, pd.DatetimeIndex(sample.returns.index))
        sample = replace(sample, returns=sample.returns.sub(rates, axis=0))
    means = _by_decision(sample, alphas)
    problem = AlphaProblem(_risk(sample, chosen.covariance), chosen.risk_aversion)
    if world is None and prior_covariance is None:
        world = _law(_before(sample, means))
    maker = AlphaDecisionMaker(
        problem, chosen.budget, prior_covariance=prior_covariance, world=world, objective=chosen.objective
    )
    decided = means.loc[sample.decided]
    earned = sample.held.set_axis(decided.index, axis=0)
    found = alpha_backtest(maker, decided, earned, rng=np.random.default_rng(chosen.seed))
    return replace(found, period=sample.frequency.word)


def _by_decision(sample: ReturnsSample, alphas: pd.DataFrame | None) -> pd.DataFrame:
    """Return the alphas by date of decision, columns in the order of the returns."""
    dates, names = pd.DatetimeIndex(sample.returns.index), sample.returns.columns
    if alphas is None:
        about = momentum_alphas(sample.returns)  # by the row that they forecast
        means = about.set_axis(dates[dates.get_indexer(about.index) - 1], axis=0)
    else:
        check_dates(alphas.index, "alphas")
        Axis("asset", tuple(names)).order(tuple(alphas.columns), "alphas")
        means = alphas.loc[(alphas.index >= dates[0]) & (alphas.index <= dates[-1]), list(names)]
        refuse_missing(pd.DatetimeIndex(means.index), dates, "returns", "the alphas")
    refuse_missing(sample.decided, means.index, "alphas", "the decisions")
    return means


def _before(sample: ReturnsSample, means: pd.DataFrame) -> pd.DataFrame:
    """Return the alphas before the first decision, one per row of the returns from the first alpha on."""
    past, dates = means.loc[means.index < sample.decided[0]], pd.DatetimeIndex(sample.training.index[:-1])
    refuse_missing(
        dates[dates >= past.index[0]] if len(past) else dates[:0], past.index, "alphas", "the training sample"
    )
    return past


def _risk(sample: ReturnsSample, given: str | None) -> pd.DataFrame:
    """V of the training sample, by the assets' names."""
    table = sample.training
    rule = covariance_rule(given, *table.shape, 1)
    least = rule.least_observations(table.shape[1])
    if len(table) < least:
        raise InputError(
            f"the training sample has {len(table)} rows; a {rule.name} covariance of {table.shape[1]} assets needs at least "
            f"{least}: move train_until (--train-until)"
        )
    spread = (table - table.mean()).to_numpy()
    scale = spread.std(axis=0) if rule.shrinks else np.ones(len(spread.T))
    if not (scale > 0).all():
        still = table.columns[int((scale <= 0).argmax())]
        raise InputError(f"the return of {still!r} does not move in the training sample: it has no risk to estimate")
    found = rule.estimate(spread / scale, np.full(len(spread), 1.0 / len(spread))).covariance * np.outer(scale, scale)
    # Divided by T − 1, as a covariance is in `protect --alphas` and `views`.
    return pd.DataFrame(found * len(spread) / (len(spread) - 1), table.columns, table.columns)


def _law(past: pd.DataFrame) -> LinearGaussianWorld:
    """Return the world of the alphas before the first decision: one rate of decay, and their second moments."""
    names = past.columns
    means: Array = validation.finite_array(past.to_numpy(), "alphas", ndim=2)
    if len(means) <= len(names):
        raise InputError(
            f"alphas have {len(means)} rows before the first decision, expected more than there are assets, {len(names)}, to "
            "estimate their public law: move train_until, or give the law (--prior-covariance or --world)"
        )
    before, after = means[:-1], means[1:]
    size = float(np.sqrt((before**2).sum() * (after**2).sum()))
    rate = float((before * after).sum()) / size if size > 0 else 0.0
    if abs(rate) >= 1.0 - tolerances.STABLE:
        raise InputError("alphas do not move before the first decision: they are public, and nothing can be hidden")
    covariance = means.T @ means / len(means)
    n = len(names)
    return LinearGaussianWorld(
        pd.DataFrame(rate * np.eye(n), names, names), (1.0 - rate**2) * covariance, np.eye(n), np.zeros((n, n))
    )


class LinearWorldFile(Section):
    """A linear Gaussian world as JSON: names of the states, and matrices row by row in their order."""

    states: list[Label] | None = None
    transition: Matrix
    process: Matrix
    sensor: Matrix
    noise: Matrix
    public_sensor: Matrix | None = None
    public_noise: Matrix | None = None


def read_linear_world(path: PathLike) -> LinearGaussianWorld:
    """Read a world from a JSON file with the keys of `LinearGaussianWorld`'s arguments, and `states`: their names in its order.

    The keys `public_sensor` and `public_noise` give the public sensor, both or neither. A file without `states` is logged as a
    warning: nothing aligns it with the alphas.

    Raises:
        InputError: With the file and the place in it: a key is missing or unknown, or a value has the wrong type.
        ModelError: A covariance is indefinite.
    """
    source = path_of(path, "a world")
    data = read_json(source, "the JSON of a linear Gaussian world")
    try:
        found = LinearWorldFile.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        raise InputError(f"{source}, {place}: {first['msg']}; got {shortened(first['input'])}") from None
    if (found.public_sensor is None) != (found.public_noise is None):
        raise InputError(f"{source}: public_sensor and public_noise go together, and one is missing")
    transition: Any = found.transition
    if found.states is None:
        _LOGGER.warning(
            "%s names no states: they are taken in the order of the loadings' columns, or else of the assets", source
        )
    else:
        names = pd.Index(found.states)
        try:
            transition = pd.DataFrame(found.transition, index=names, columns=names)
        except ValueError as error:
            raise InputError(f"{source}, states: {error}") from None
    public: Any = None if found.public_sensor is None else (found.public_sensor, found.public_noise)
    return LinearGaussianWorld(transition, found.process, found.sensor, found.noise, public=public)
