"""The markets of a comparison: a decision problem with a law of the private belief, of three kinds."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from inscrutable import validation
from inscrutable.datasets import load_industry_returns
from inscrutable.errors import InputError
from inscrutable.experiments.backtest import fitted_investor
from inscrutable.experiments.backtest_inputs import BacktestSettings, checked_market
from inscrutable.experiments.own_model import OwnModel, investor_of
from inscrutable.experiments.random_markets import MarketLaw, random_market
from inscrutable.experiments.weight_limits import LimitsPart
from inscrutable.geometry.grids import grid_size, largest_resolution
from inscrutable.mechanisms import Prior, uniform_prior
from inscrutable.mechanisms.chains import BeliefChain, predicted_chain, resting_chain
from inscrutable.problems import MarkowitzProblem

PAPER, RETURNS = "paper", "returns"

_RESTS = MarketLaw().persistence
"""Probability that the belief of the paper's market stays the same."""


_MOST_BELIEFS = 6_000
"""Most beliefs of a comparison: every decision maker needs tables of beliefs by beliefs."""


@dataclass(frozen=True, eq=False)
class ComparedMarket:
    """A problem, the chain of its belief, one line on their source, and the time of a step; empty where not known."""

    problem: MarkowitzProblem
    chain: BeliefChain
    note: str
    step: str = ""

    @property
    def prior(self) -> Prior:
        """The law of the belief."""
        return self.chain.prior


def _few(count: int, resolution: int, n_states: int) -> None:
    """Raise `InputError` for more beliefs than can be compared."""
    if count > _MOST_BELIEFS:
        raise InputError(
            f"resolution {resolution:,} gives {count:,} beliefs over {n_states} regimes, more than the {_MOST_BELIEFS:,} that "
            f"can be compared; {_fitting(n_states):,} always fits"
        )


def _fitting(n_states: int) -> int:
    """The largest resolution whose whole grid of beliefs can be compared."""
    return largest_resolution(n_states, _MOST_BELIEFS)


def _paper_market(resolution: int, seed: int, limits: LimitsPart) -> ComparedMarket:
    """A random market as the paper draws them, with every belief of a grid equally likely.

    No world makes every belief equally likely, so the chain is not the market's: the belief stays the same as often as a regime
    lasts, and is otherwise drawn from the uniform law.
    """
    problem = random_market(rng=np.random.default_rng(seed)).problem
    if not limits.is_empty:
        means = pd.DataFrame(problem.means, columns=[f"asset{k}" for k in range(problem.means.shape[1])])
        region = limits.region(tuple(means.columns))
        problem = MarkowitzProblem(means, problem.covariances, problem.risk_aversion, region)
    _few(grid_size(problem.n_states, resolution), resolution, problem.n_states)
    chain = resting_chain(uniform_prior(problem.n_states, resolution), _RESTS)
    return ComparedMarket(
        problem, chain, f"random market of three regimes and three assets, seed {seed}; uniform prior"
    )


def _returns_market(resolution: int, seed: int, limits: LimitsPart) -> ComparedMarket:
    """The investor of the backtest on the embedded returns, with the long-run law of its predicted belief."""
    settings = BacktestSettings(seed=seed, own=None if limits.is_empty else OwnModel.of_limits(limits))
    fit_rng, prior_rng = (np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(4)[::3])
    sample = checked_market(load_industry_returns().returns, settings, None)
    investor = fitted_investor(sample, settings, None, rng=fit_rng)
    note = f"12 US industries, regimes fitted up to {settings.train_until}; stationary prior of the predicted belief"
    chain = predicted_chain(investor.world, resolution, rng=prior_rng)
    return ComparedMarket(investor.problem, chain, note, sample.frequency.step)


def _model_market(path: Path, resolution: int, seed: int, limits: LimitsPart) -> ComparedMarket:
    """The investor of a model.json or model.toml, with the long-run law of its predicted belief."""
    model = investor_of(path, limits)
    _refuse_turnover(model.turnover, f"{path}: ")
    chain = predicted_chain(model.world, resolution, rng=np.random.default_rng(seed))
    return ComparedMarket(model.problem, chain, f"{path.name}; stationary prior of the predicted belief", model.step)


def _refuse_turnover(turnover: float | None, where: str = "") -> None:
    if turnover is not None:
        raise InputError(
            f"{where}turnover that is limited changes the problem at every decision, and a comparison is made on one: leave "
            "turnover out"
        )


def market_of(
    name: str,
    resolution: int,
    seed: int,
    limits: LimitsPart = LimitsPart(),  # noqa: B008  # frozen
) -> ComparedMarket:
    """Return the market "paper", "returns", or that of a model file.

    Args:
        name: One of the two, or the path of a model.json of a backtest, or of a model.toml with regimes.
        resolution: Resolution of the grid of beliefs: multiples of 1/resolution.
        seed: Seed of the market, the fit and the simulated path.
        limits: Limits on weights that replace the model's; turnover cannot be limited.

    Raises:
        InputError: The file is not a model, a number is out of range, or a limit does not suit the market.
        ModelError: No weights satisfy all limits.

    Example:
        >>> len(market_of("paper", 30, 0).prior)
        496
    """
    if validation.count(resolution, "resolution") >= _MOST_BELIEFS:
        raise InputError(
            f"resolution {resolution:,} gives more than the {_MOST_BELIEFS:,} beliefs that can be compared, even over two "
            f"regimes; over three {_fitting(3):,} always fits"
        )
    _refuse_turnover(limits.turnover)
    if name == PAPER:
        return _paper_market(resolution, seed, limits)
    if name == RETURNS:
        found = _returns_market(resolution, seed, limits)
    else:
        found = _model_market(Path(name), resolution, seed, limits)
    _few(len(found.prior), resolution, found.problem.n_states)
    return found
