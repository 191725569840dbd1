"""Results of a backtest: decisions, observers' estimates, returns, and the figures of its table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd

from inscrutable import tolerances
from inscrutable.budgets import Budget
from inscrutable.decision_makers import Candidates, DecisionStatus
from inscrutable.errors import InputError
from inscrutable.experiments.backtest_aware import AwareReading
from inscrutable.experiments.backtest_inputs import BacktestSettings, ReturnsSample
from inscrutable.experiments.backtest_public import BesideWeights
from inscrutable.experiments.backtest_sequential import SequentialPart
from inscrutable.experiments.episodes import Episode, Record, relative_increase
from inscrutable.experiments.holding import base_rate, estimate_quality
from inscrutable.experiments.investor_model import InvestorModel, step_of
from inscrutable.experiments.performance import Performance, SharpeDifference
from inscrutable.experiments.rivals import is_own
from inscrutable.experiments.weight_limits import LimitsPart
from inscrutable.mechanisms.disclosures import EXACT
from inscrutable.privacy import Loss, RivalProblem
from inscrutable.problems import MarkowitzProblem
from inscrutable.validation import Array
from inscrutable.worlds import FittedWorld, HiddenMarkovModel

SEQUENTIAL = "SDM"
"""Name of the sequential rule in a backtest."""


class SharpeComparison(NamedTuple):
    """Sharpe ratio minus the ODM's, per year, before and after the cost of trading."""

    gross: SharpeDifference
    net: SharpeDifference


@dataclass(frozen=True, eq=False)
class Backtest:
    """The results of a backtest; row t of every (T,…) array is one decision, made at `dates[t]`.

    Args:
        settings: What was asked for.
        market: The returns, the riskless rate and their frequency.
        fit: The fitted world with the table of restarts.
        world: The same world with the regimes' names.
        problem: The portfolio problem, which the rival knows.
        candidates: The decoys that CDM and PDM share.
        beliefs: (T,X) beliefs about the row after each date, given the data up to the date.
        episode: The decisions of each decision maker, and the naive observer's inference.
        performance: Returns of each decision maker.
        comparisons: Sharpe ratios against the ODM's.
        aware: Estimates of the aware observers; None where a target is given per step, and where turnover is limited.
        sequential: The sequential rule, which published as `SEQUENTIAL`; None where it did not.
        public: Estimates of observers who follow a public number.
        rival: The loss of the rival to whom beliefs and weights are worth something; None: by the investor's own problem.

    Source: the paper's Section V-A on data instead of a simulation. Example: see `run_backtest`.
    """

    settings: BacktestSettings
    market: ReturnsSample
    fit: FittedWorld
    world: HiddenMarkovModel
    problem: MarkowitzProblem
    candidates: Candidates
    beliefs: pd.DataFrame
    episode: Episode
    performance: Mapping[str, Performance]
    comparisons: Mapping[str, SharpeComparison]
    aware: AwareReading | None
    sequential: SequentialPart | None
    public: BesideWeights
    rival: Loss | None

    @property
    def assets(self) -> tuple[str, ...]:
        """Labels of the assets, in the order of the weights."""
        return tuple(self.market.returns.columns)

    @property
    def regimes(self) -> tuple[str, ...]:
        """Names of the regimes, by rising volatility, in the order of a belief's entries."""
        return self.world.names

    @property
    def budget(self) -> Budget:
        """The budget of CDM and PDM for every decision."""
        return self.settings.budget_of_each

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the decision makers."""
        return tuple(self.episode.records)

    @property
    def dates(self) -> pd.DatetimeIndex:
        """(T,) dates at whose end the portfolios are decided and published."""
        return pd.DatetimeIndex(self.beliefs.index)

    @property
    def earned(self) -> pd.DatetimeIndex:
        """(T,) dates at whose end the portfolios' returns are known: the row after each decision."""
        index = pd.DatetimeIndex(self.market.returns.index)
        return index[-len(self.beliefs) :]

    def problem_at(self, name: str, step: int) -> MarkowitzProblem:
        """Return a decision maker's problem at a step: with a limit on turnover, the one near its last published weights."""
        if self.settings.turnover is None or not step:
            return self.problem
        return self.investor.problem_after(self._of(name).decisions.action[step - 1])

    @cached_property
    def investor(self) -> InvestorModel:
        """The investor's model that an observer may know, as `model.json` stores it."""
        kept = self.world  # a public sensor of other numbers is no part of the file
        world = HiddenMarkovModel(kept.transition, kept.emission, kept.initial, names=kept.names)
        own, limit = self.settings.own, self.settings.turnover
        note = f"regimes fitted to {len(self.assets)} assets up to {self.settings.train_until}"
        if own is not None and own.world is not None:
            note = own.file.note or "regimes as given by the model file"
        note = "; ".join([note, *self.doubts])
        made = InvestorModel(world, self.problem, self.assets, self.regimes, self.budget, note, limit)
        limits = LimitsPart() if own is None else own.limits(self.assets)
        return replace(made, step=step_of(self.beliefs.index), reads=self._reads_more, limits=limits)

    @property
    def _reads_more(self) -> str:
        """What the beliefs rest on besides the returns; empty for nothing."""
        if self.public.number:
            return self.public.number
        is_known = self.figures[self.names[0]]["error_all_returns"] <= tolerances.SAME_BELIEF
        return "" if is_known else "a private signal, or beliefs of its own"

    def weights(self, name: str) -> pd.DataFrame:
        """Return the portfolios that a decision maker published, (T,U) by date of decision; for a lottery, its draws."""
        return self._frame(self._of(name).decisions.action, self.assets)

    def aware_estimates(self, name: str) -> pd.DataFrame:
        """Return the aware observer's estimates from each decision alone, (T,X) by date of decision.

        NaN without such a rival, and for the sequential rule, whose weights say nothing without those before them.
        """
        return self._read_as(name, {} if self.aware is None else self.aware.estimates)

    def followed_estimates(self, name: str) -> pd.DataFrame:
        """Return the aware observer's estimates from all weights so far, (T,X); NaN without one.

        Where turnover is limited there are estimates for the sequential rule alone.
        """
        if self.aware is not None:
            return self._read_as(name, self.aware.followed)
        alone = {} if self.sequential is None else {SEQUENTIAL: self.sequential.path.observer_means}
        return self._read_as(name, alone)

    def disclosed_estimates(self, name: str) -> pd.DataFrame:
        """Return the same under the settings' disclosure, (T,X); NaN where it shows everything.

        NaN for the sequential rule too, which assumes an observer who sees every decision.
        """
        return self._read_as(name, {} if self.aware is None else self.aware.disclosed)

    def _read_as(self, name: str, estimates: Mapping[str, Array]) -> pd.DataFrame:
        self._of(name)
        return self._frame(estimates.get(name, np.full(self.beliefs.shape, np.nan)), self.regimes)

    def estimates(self, name: str) -> pd.DataFrame:
        """Return the centres of the rival's consistent beliefs, (T,X) by date of decision; NaN for an empty set."""
        return self._frame(self._of(name).estimates, self.regimes)

    def privacy(self, name: str) -> Array:
        """Return Ψ of the published portfolios under the settings' measure, shape (T,), also for the ODM."""
        sets = self._of(name).decisions.belief_set
        rows = self.beliefs.to_numpy()
        measure = self.settings.measure
        return np.array([measure.at_step(t)(rows[t], found) for t, found in enumerate(sets)])

    def path(self, name: str) -> pd.DataFrame:
        """Return one row per decision: its regret, privacy and return; regret in the cost's unit, return per row."""
        record, earned = self._of(name), self.performance[name]
        decisions = record.decisions
        return pd.DataFrame(
            {
                "earned_in": self.earned,
                "gross_return": earned.gross,
                "net_return": earned.net,
                "traded": earned.traded,
                "optimal_cost": decisions.optimal_cost,
                "regret": decisions.regret,
                "expected_regret": record.expected_regret,
                "privacy": self.privacy(name),
                "set_dimension": [found.dimension for found in decisions.belief_set],
                "status": [status.name.lower() for status in decisions.status],
            },
            index=self.beliefs.index,
        )

    @cached_property
    def figures(self) -> Mapping[str, Mapping[str, float]]:
        """The figures of the table per decision maker: fractions, costs in the cost's unit, annual where named so."""
        return {name: _figures(self, name) for name in self.names}

    @property
    def summary(self) -> pd.DataFrame:
        """The figures as a frame, one row per decision maker."""
        return pd.DataFrame(self.figures).T.rename_axis("decision_maker")

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Reasons to doubt the figures: a fit that collapsed, or beliefs that hardly move; empty if there are none."""
        fitted = replace(self.fit, world=self.world).doubt
        return tuple(filter(None, [fitted, *resting_beliefs(self.beliefs)]))

    @property
    def rivals_loss(self) -> Loss:
        """The loss of the rival to whom beliefs and weights are worth something."""
        return RivalProblem(self.problem) if self.rival is None else self.rival

    @property
    def rival_is_own(self) -> bool:
        """Whether that rival has the investor's own problem, so that it can hold the published weights."""
        return is_own(self.rivals_loss, self.problem)

    @cached_property
    def silence_regret(self) -> float:
        """Mean regret of the one constant portfolio that suits these beliefs best: r₀ = V(mean π) − mean V(π).

        It is in the cost's unit. An investor who always published that portfolio would pay this, and reveal nothing but the
        mean belief. It never trades, so a limit on turnover does not change it.
        """
        constant = float(self.problem.optimal_cost(self.beliefs.to_numpy().mean(axis=0)))
        return max(constant - float(self.unlimited_costs.mean()), 0.0)

    @cached_property
    def unlimited_costs(self) -> Array:
        """Optimal costs V of the beliefs without a limit on turnover, shape (T,)."""
        return np.asarray(self.problem.optimal_cost(self.beliefs.to_numpy()))

    @cached_property
    def known_silence_regret(self) -> float:
        """Mean regret of the constant portfolio for the long-run mean of the belief, which is known beforehand.

        It is in the cost's unit, by the investor's beliefs; NaN without an aware observer, whose prior has that mean.
        """
        if self.aware is None:
            return float("nan")
        return float(RivalProblem(self.problem).excess(self.beliefs.to_numpy(), self.aware.prior.mean[None]).mean())

    def _of(self, name: str) -> Record:
        if name not in self.episode.records:
            raise InputError(f"no decision maker {name!r}; there are {list(self.names)}")
        return self.episode.records[name]

    def _frame(self, values: Array, columns: tuple[str, ...]) -> pd.DataFrame:
        return pd.DataFrame(values, index=self.beliefs.index, columns=list(columns))


def moves_little(beliefs: pd.DataFrame) -> bool:
    """Return whether beliefs (T,X) hardly vary."""
    return _spread(beliefs.to_numpy()) < tolerances.BELIEF_MOVES


def _spread(rows: Array) -> float:
    """Return the root mean square distance of beliefs (T,X) from their mean."""
    return float(np.sqrt(((rows - rows.mean(axis=0)) ** 2).sum(axis=1).mean()))


def resting_beliefs(beliefs: pd.DataFrame) -> list[str]:
    """Return a warning if beliefs (T,X) hardly vary, or the probabilities of some regimes do not; otherwise none."""
    rows = beliefs.to_numpy()
    spread = _spread(rows)
    if moves_little(beliefs):
        middle = ", ".join(
            f"{name} {value:.3f}" for name, value in zip(beliefs.columns, rows.mean(axis=0), strict=True)
        )
        return [
            f"the belief hardly moves over the {len(rows)} decisions: its distance from its mean ({middle}) is {spread:.3f} "
            "(r.m.s.), so there is next to nothing to hide or to read"
        ]
    low, high = rows.min(axis=0), rows.max(axis=0)
    return [
        f"no decision is made in the regime {beliefs.columns[int(i)]}: its probability stays between {low[i]:.3f} and "
        f"{high[i]:.3f}"
        for i in np.flatnonzero(high - low < tolerances.BELIEF_MOVES)
    ]


def _figures(result: Backtest, name: str) -> dict[str, float]:
    earned, versus = result.performance[name], result.comparisons[name]
    record = result.episode.records[name]
    return {
        "n_decisions": float(len(result.beliefs)),
        "annual_return": earned.annual_return(),
        "annual_volatility": earned.volatility(),
        "annual_sharpe": earned.sharpe_ratio(),
        **_interval("annual_sharpe_minus_odm", versus.gross),
        "annual_turnover": earned.turnover,
        "annual_return_net": earned.annual_return(net=True),
        "annual_sharpe_net": earned.sharpe_ratio(net=True),
        **_interval("annual_sharpe_net_minus_odm", versus.net),
        "assets_held": float(
            (np.abs(record.decisions.action) >= result.problem.constraints.min_slack).sum(axis=1).mean()
        ),
        **_cost_figures(result, record),
        **_privacy_figures(result, name),
        **_aware_figures(result, name),
        **_disclosed_figures(result, name),
        **result.public.figures(name, result.beliefs.to_numpy()),
    }


def _disclosed_figures(result: Backtest, name: str) -> dict[str, float]:
    """Return the figures of an observer who is shown a part of the decisions; none where that part is everything."""
    if result.settings.disclosure == EXACT:
        return {}
    read = estimate_quality(result.disclosed_estimates(name).to_numpy(), result.beliefs.to_numpy())
    return {"share_regime_named_disclosed": read.named, "error_disclosed": read.error}


def _interval(name: str, found: SharpeDifference) -> dict[str, float]:
    return {name: found.difference, f"{name}_low": found.low, f"{name}_high": found.high}


def _cost_figures(result: Backtest, record: Record) -> dict[str, float]:
    own = np.abs(record.decisions.optimal_cost)
    regret, expected = record.decisions.regret, record.expected_regret
    silence = result.silence_regret
    unlimited = regret if result.settings.turnover is None else record.decisions.cost - result.unlimited_costs
    is_free = silence <= tolerances.NO_REGRET * own.mean()  # where the beliefs are one belief, up to rounding
    return {
        "mean_regret": float(regret.mean()),
        "mean_regret_share": float(relative_increase(regret.sum(), own.sum())),
        "mean_expected_regret": float(expected.mean()),
        "mean_expected_regret_share": float(relative_increase(expected.sum(), own.sum())),
        "largest_regret": float(regret.max()),
        "mean_regret_unlimited": float(unlimited.mean()),
        "mean_regret_of_silence": float("nan") if is_free else float(unlimited.mean()) / silence,
    }


def _privacy_figures(result: Backtest, name: str) -> dict[str, float]:
    record = result.episode.records[name]
    privacy = result.privacy(name)
    reached = np.isfinite(privacy)
    beliefs = result.beliefs.to_numpy()
    read = estimate_quality(record.estimates, beliefs)
    nothing = [status is DecisionStatus.NO_AFFORDABLE_PRIVACY for status in record.decisions.status]
    return {
        "mean_privacy": float(privacy[reached].mean()) if reached.any() else float("nan"),
        "n_privacy_not_finite": float((~reached).sum()),
        "share_regime_named": read.named,
        "base_rate": base_rate(beliefs),
        "n_empty_sets": float(np.isnan(record.estimates).any(axis=1).sum()),
        "error_face_value": read.error,
        "n_nothing_affordable": float(sum(nothing)),
    }


def _aware_figures(result: Backtest, name: str) -> dict[str, float]:
    """Return the figures of the aware observers, and those of an observer who sees no weights."""
    aware, beliefs, unknown = result.aware, result.beliefs.to_numpy(), float("nan")
    read = estimate_quality(result.aware_estimates(name).to_numpy(), beliefs)
    followed = estimate_quality(result.followed_estimates(name).to_numpy(), beliefs)
    found = {
        "share_regime_named_aware": read.named,
        "error_aware": read.error,
        "share_regime_named_followed": followed.named,
        "error_followed": followed.error,
    }
    worths = ("worth_secret", "worth_followed", "worth_copied")
    keys = (
        "error_without",
        "bits_aware",
        "bits_prior",
        "bits_followed",
        "mean_regret_long_run",
        "error_ceiling",
        *worths,
    )
    if aware is None:
        return found | dict.fromkeys(keys, unknown)
    told = aware.leakages.get(name)
    return found | {
        "error_without": estimate_quality(np.tile(aware.prior.mean, (len(beliefs), 1)), beliefs).error,
        "bits_aware": unknown if told is None else told.mutual_information,
        "bits_prior": aware.prior.entropy,
        "bits_followed": float(aware.bits[name].mean()),
        "mean_regret_long_run": aware.regrets[name],
        "error_ceiling": aware.ceilings.get(name, unknown),
        **_worths(result, name, aware.prior.mean),
    }


def _worths(result: Backtest, name: str, mean: Array) -> dict[str, float]:
    """Return the worth of beliefs and weights to the rival, judged by the investor's beliefs.

    The rival plays what suits the long-run mean of the belief, or its estimate given all weights; one with the investor's own
    problem may play the weights themselves.
    """
    beliefs, loss = result.beliefs.to_numpy(), result.rivals_loss
    secret = float(loss.excess(beliefs, mean[None]).mean())
    followed = float(loss.excess(beliefs, result.followed_estimates(name).to_numpy()).mean())
    copied = float(result.episode.records[name].expected_regret.mean()) if result.rival_is_own else float("nan")
    return {"worth_secret": secret, "worth_followed": secret - followed, "worth_copied": secret - copied}
