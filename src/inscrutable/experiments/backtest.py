"""A backtest: a regime-switching investor decides month by month on real returns; observers read its published weights.

Every step is causal. The regimes are fitted once, on the training sample. From then on, at the end of row t the investor
holds the belief about row t+1 given the returns up to row t, publishes a portfolio, and earns the return of row t+1.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from inscrutable import validation
from inscrutable.axes import Axis
from inscrutable.decision_makers import (
    CounterAdversarialDecisionMaker,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
)
from inscrutable.decision_makers.candidate_sources import candidates_for
from inscrutable.decision_makers.results import Progress
from inscrutable.errors import InputError
from inscrutable.experiments.backtest_aware import AwareReading, Beside, read_knowingly
from inscrutable.experiments.backtest_inputs import BacktestSettings, ReturnsSample, beliefs_by_date, checked_market
from inscrutable.experiments.backtest_public import (
    BesideReturns,
    PublicWorld,
    all_public,
    held_beliefs,
    investors_world,
    public_world,
    read_public,
)
from inscrutable.experiments.backtest_results import SEQUENTIAL, Backtest, SharpeComparison, resting_beliefs
from inscrutable.experiments.backtest_sequential import play_sequentially
from inscrutable.experiments.backtest_turnover import Maker, limited_episode
from inscrutable.experiments.disclosing import check_step
from inscrutable.experiments.episodes import Episode, run_episode
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.experiments.performance import Performance, SharpeDifference, sharpe_difference, track_portfolios
from inscrutable.experiments.rivals import loss_of
from inscrutable.experiments.silence import budget_in
from inscrutable.filtering import filter_beliefs
from inscrutable.mechanisms import Disclosure
from inscrutable.problems import MarkowitzProblem, Polyhedron
from inscrutable.worlds import FittedWorld, GaussianEmission, HiddenMarkovModel, fit_gaussian_hmm
from inscrutable.worlds.gaussian_fit import Restart
from inscrutable.worlds.hidden_markov import default_names

__all__ = ["RESTARTS", "Backtest", "BacktestSettings", "run_backtest"]

RESTARTS = 30
"""Most starts of the fit. On the embedded returns ten starts end in another optimum, up to 4 nats lower, for 4 of 14 seeds
tried; thirty starts came to the same regimes for all of 6 seeds. An optimum 0.7 nats higher, with regimes much alike, exists,
but one start in some hundreds finds it."""

_LEAST_RESTARTS = 5
_WORK_OF_FIT = 25_000_000
"""Restarts are cut so that one Baum-Welch step of all of them stays at about this many multiplications. Samples so
large have one optimum: on 4,160 days of 20 stocks all of 20 starts came to it."""

_LOGGER = logging.getLogger(__name__)
_NAMES = {2: ("calm", "turbulent"), 3: ("calm", "normal", "turbulent")}
_BASIS_POINTS = 10_000.0
_SEEDS = 6
"""Number of child seeds; the fifth is that of the page's lotteries."""


def run_backtest(
    returns: pd.DataFrame,
    settings: BacktestSettings | None = None,
    *,
    beliefs: pd.DataFrame | None = None,
    riskless: pd.Series | None = None,
    beside: BesideReturns | None = None,
    restarts: int | None = None,
    progress: Progress | None = None,
) -> Backtest:
    """Fit the regimes on the training sample, walk forward through the rest, and let observers read every portfolio.

    Timing: at the end of row t the investor holds p(x_{t+1} | returns up to t) under the training sample's world,
    decides as ODM, CDM, PDM and SDM (the sequential rule), and earns the return of row t+1. The first decision is made at
    the end of the training sample. The naive observer is the paper's: it knows means, covariances and γ, and takes what is
    published (for a lottery, the draw) at face value. The two aware observers also know the rules and the prior: one reads
    every decision alone, the other remembers all before it and knows how the belief moves.

    Args:
        returns: (N,U) simple returns as fractions, U >= 2, with increasing dates and one labelled column per asset;
            a row's return is earned up to its date. Labels become text.
        settings: The investor; None is the default one.
        beliefs: Beliefs of the investor's own instead of the filter's, by date of decision: row t is about row t+1.
            One column per regime, which bears its name (`regime_names`), or its number by rising volatility. Means and
            covariances of the regimes still come from the fit. Rows on other dates are ignored.
        riskless: Riskless returns by date, for Sharpe ratios of excess returns; None is zero.
        beside: What the rival follows itself, and a signal that the investor alone has; None: a rival who follows the mean
            return of the assets, and no signal.
        restarts: Starts of the fit, at least 1; None is thirty, and fewer, down to five, for large samples.
        progress: Called with (decisions made, decisions in all).

    Returns:
        A `Backtest`; the same arguments give the same numbers.

    Raises:
        InputError: Missing or misplaced dates, labels or numbers, a training sample that is too short or does not end
            inside the data, beliefs off the simplex or missing on some dates (they are listed).
        ModelError: Training returns without variance, or none of the restarts gave a usable world.

    Cost: the fit, then some tens of milliseconds per decision of CDM and PDM; up to a minute for the SDM's prices.

    Source: Lourenço et al. (2020), Section V, on data instead of a simulation.

    Example:
        >>> draw = np.random.default_rng(0)
        >>> spread = np.repeat([0.01, 0.05, 0.02], 20)[:, None]
        >>> months = pd.date_range("2001-01", periods=60, freq="ME")
        >>> returns = pd.DataFrame(0.01 + spread * draw.normal(size=(60, 2)), index=months, columns=["A", "B"])
        >>> settings = BacktestSettings(regimes=2, train_until="2005-06", sequential=False)
        >>> found = run_backtest(returns, settings, restarts=2)
        >>> found.weights("ODM").shape, found.regimes
        ((6, 2), ('calm', 'turbulent'))
    """
    chosen = BacktestSettings() if settings is None else settings
    market = checked_market(returns, chosen, riskless)
    check_step(chosen.disclosure, market.frequency.step)
    seeds = np.random.SeedSequence(chosen.seed).spawn(_SEEDS)
    fit_rng, draw_rng, bootstrap_rng, aware_rng, _, sequential_rng = map(np.random.default_rng, seeds)
    fit, world, problem = fitted_investor(market, chosen, restarts, rng=fit_rng)
    rival = None if chosen.rival is None else loss_of(chosen.rival, problem)
    spent = None if chosen.budget is None else budget_in(world, problem, chosen.budget)
    chosen = replace(chosen, budget=spent)
    read = BesideReturns() if beside is None else beside
    world, public, followed = _with_public(read, world, market, is_read=beliefs is None)
    held = _held_beliefs(world, market, public, read.private, beliefs)
    symbols = public.symbols(market.decided)
    measure, budget = chosen.measure, chosen.budget_of_each
    candidates = candidates_for(problem, measure, None)
    aware: AwareReading | None = None
    names = tuple(market.returns.columns), tuple(held.columns)
    investor, rows = InvestorModel(fit.world, problem, *names, turnover=chosen.turnover), held.to_numpy()
    play = partial(play_sequentially, world, investor, rows, spent, rng=sequential_rng, public=symbols)
    if chosen.turnover is None:
        decision_makers: dict[str, Maker] = {
            "ODM": OriginalDecisionMaker(problem),
            "CDM": CounterAdversarialDecisionMaker(problem, measure, budget, candidates=candidates),
            "PDM": ProbabilisticDecisionMaker(problem, measure, budget, candidates=candidates),
        }
        episode = run_episode(problem, rows, decision_makers, rng=draw_rng, progress=progress)
        shown, earned_at = Disclosure.of(chosen.disclosure), market.held.to_numpy()
        seen = Beside(shown, earned_at, symbols)
        aware = read_knowingly(episode, world, decision_makers, measure, rng=aware_rng, beside=seen)
        part = play() if chosen.sequential and aware is not None else None
    else:
        part = play() if chosen.sequential else None  # before the others: the limit may cost more than its budget
        episode = _near_the_last(investor, chosen, held, draw_rng, progress)
    if part is not None:
        aware = None if aware is None else part.joined(aware, SEQUENTIAL)
        made = part.record(investor, episode.beliefs, measure)
        episode = replace(episode, records={**episode.records, SEQUENTIAL: made})
    performance = _performance(episode, market, chosen)
    comparisons = {name: _comparison(earned, performance["ODM"], bootstrap_rng) for name, earned in performance.items()}
    for doubt in resting_beliefs(held):  # the fit says its own
        _LOGGER.warning("%s", doubt)
    told = read_public(public, episode, all_public(followed, held, read.public), aware, market.decided)
    return Backtest(
        chosen,
        market,
        fit,
        world,
        problem,
        candidates,
        held,
        episode,
        performance,
        comparisons,
        aware,
        part,
        told,
        rival,
    )


def _near_the_last(
    investor: InvestorModel,
    settings: BacktestSettings,
    held: pd.DataFrame,
    rng: np.random.Generator,
    progress: Progress | None,
) -> Episode:
    """Return the decisions where turnover against those published before is limited."""
    budget = settings.budget_of_each
    rows = held.to_numpy()

    def chooser(rule: type[CounterAdversarialDecisionMaker | ProbabilisticDecisionMaker]) -> Any:
        steps = iter(range(len(rows)))
        return lambda near: rule(near, settings.measure.at_step(next(steps)), budget)

    makers: dict[str, Any] = {
        "ODM": OriginalDecisionMaker,
        "CDM": chooser(CounterAdversarialDecisionMaker),
        "PDM": chooser(ProbabilisticDecisionMaker),
    }
    return limited_episode(investor, rows, makers, rng=rng, progress=progress)


class FittedInvestor(NamedTuple):
    """The regimes fitted to the training sample, and the portfolio problem in them."""

    fit: FittedWorld
    world: HiddenMarkovModel
    problem: MarkowitzProblem


def fitted_investor(
    market: ReturnsSample, settings: BacktestSettings, restarts: int | None, *, rng: np.random.Generator
) -> FittedInvestor:
    """Return the regimes fitted to the training sample, with their names, and the portfolio problem in them."""
    own = settings.own
    # A limit on an asset that is none of the returns' is found before the fit.
    region = None if own is None else own.region(tuple(market.training.columns))
    if own is not None and own.world is not None:
        return _given_investor(market, settings, own.world, region)
    n_restarts = _enough_restarts(market, settings) if restarts is None else validation.count(restarts, "restarts")
    fit = fit_gaussian_hmm(
        market.training, settings.regimes, rng=rng, n_restarts=n_restarts, covariance=settings.covariance
    )
    emission, names = fit.world.emission, regime_names(fit.world.n_states)
    assert isinstance(emission, GaussianEmission)
    world = HiddenMarkovModel(fit.world.transition, emission, fit.world.initial, names=names)
    means = pd.DataFrame(emission.means, index=list(world.names), columns=list(market.training.columns))
    return FittedInvestor(fit, world, MarkowitzProblem(means, emission.covariances, settings.risk_aversion, region))


def _given_investor(
    market: ReturnsSample, settings: BacktestSettings, world: HiddenMarkovModel, region: Polyhedron | None
) -> FittedInvestor:
    """Return regimes that the user gives, to which nothing is fitted, in the order of the returns' columns."""
    emission, assets = world.emission, list(market.training.columns)
    assert isinstance(emission, GaussianEmission)
    known = [str(each) for each in emission.asset_names or ()]
    order = Axis("asset", tuple(assets)).order(tuple(known), "the model's regimes") or list(range(len(assets)))
    ordered = GaussianEmission(
        emission.means[:, order], emission.covariances[:, order][:, :, order], asset_names=assets
    )
    mine = HiddenMarkovModel(world.transition, ordered, world.initial, names=world.names)
    likelihood = filter_beliefs(mine, market.training).log_likelihood
    start = Restart(likelihood, 0, True, (), "given, not fitted", (likelihood,), 0.0, (float("nan"),) * world.n_states)
    fit = FittedWorld(mine, likelihood, (start,), "given", *market.training.shape)
    means = pd.DataFrame(ordered.means, index=list(mine.names), columns=assets)
    return FittedInvestor(fit, mine, MarkowitzProblem(means, ordered.covariances, settings.risk_aversion, region))


def _enough_restarts(market: ReturnsSample, settings: BacktestSettings) -> int:
    rows, assets = market.training.shape
    affordable = _WORK_OF_FIT // (rows * settings.regimes * assets**2)
    return max(_LEAST_RESTARTS, min(RESTARTS, affordable))


def regime_names(count: int) -> tuple[str, ...]:
    """Return the names of fitted regimes in a backtest, by rising volatility."""
    return _NAMES.get(count, default_names(count))


def _with_public(
    read: BesideReturns, world: HiddenMarkovModel, market: ReturnsSample, *, is_read: bool
) -> tuple[HiddenMarkovModel, PublicWorld, list[pd.DataFrame]]:
    """Return the investor's world, what is public of it, and the beliefs from all returns, alone and with a separate number."""
    alone = filter_beliefs(world, market.returns)
    public = public_world(read, world, market, alone.beliefs)
    seen = investors_world(public, world)
    predicted = [alone.predicted, *([] if seen is world else [held_beliefs(seen, market, public, None)])]
    if is_read and seen is not world:
        public = replace(public, said=f"{public.said}, which the investor reads, too")
    return seen, public, [each.loc[market.decided] for each in predicted]


def _held_beliefs(
    world: HiddenMarkovModel,
    market: ReturnsSample,
    public: PublicWorld,
    private: pd.DataFrame | None,
    beliefs: pd.DataFrame | None,
) -> pd.DataFrame:
    """Return the beliefs on the dates of the decisions, each about the row after its date."""
    if beliefs is not None:
        if private is not None:
            raise InputError(
                "beliefs of your own hold every signal of yours already: give beliefs or private, not both"
            )
        return beliefs_by_date(beliefs, market.decided, world.names)
    return held_beliefs(world, market, public, private).loc[market.decided]


def _performance(episode: Episode, market: ReturnsSample, settings: BacktestSettings) -> dict[str, Performance]:
    return {
        name: track_portfolios(
            record.decisions.action,
            market.held.to_numpy(),
            market.frequency,
            cost=settings.cost_bps / _BASIS_POINTS,
            riskless=market.riskless,
        )
        for name, record in episode.records.items()
    }


def _comparison(one: Performance, other: Performance, rng: np.random.Generator) -> SharpeComparison:
    scale = float(np.sqrt(one.frequency.per_year))

    def yearly(net: bool) -> SharpeDifference:
        found = sharpe_difference(one.excess(net=net), other.excess(net=net), rng=rng)
        return SharpeDifference(*(scale * value for value in found))

    return SharpeComparison(yearly(False), yearly(True))
