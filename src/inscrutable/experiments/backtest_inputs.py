"""Inputs of a backtest: the investor's settings and a sample of returns, checked and aligned by label."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from inscrutable import validation
from inscrutable.budgets import Budget, SilenceShare, written_budget
from inscrutable.datasets import suspicious_entries
from inscrutable.datasets._dates import unambiguous
from inscrutable.errors import InputError
from inscrutable.experiments.performance import Frequency, frequency_of
from inscrutable.labels import label_text
from inscrutable.mechanisms import Disclosure
from inscrutable.privacy import MaximalObfuscation, PrivacyMeasure
from inscrutable.validation import Array
from inscrutable.worlds.covariances import covariance_rule
from inscrutable.worlds.observations import real_rows

if TYPE_CHECKING:
    from inscrutable.experiments.own_model import OwnModel
    from inscrutable.experiments.rivals import Rival

_LISTED = 5
_MOST_RISKLESS_A_YEAR = 0.2
"""Mean riskless return a year above which rows may hold rates per year. Of the packaged bills, 1949 to 2017, the largest mean
over two months is .16 a year (1981), over two years .13, over ten .09. Were each month's return the rate per year, this would
point out 92 % of their samples of ten years and all of twenty; .3 would 78 and 96 %."""
_MOST_USUAL_A_YEAR = 1.0
"""Median size of a return, times the root of the rows a year, above which returns may be percentages: .10 for the packaged
industries, .15 for the packaged daily returns, a hundred times that for the same in per cent."""
_PAPERS_BUDGET = Budget(0.1)
_LOGGER = logging.getLogger(__name__)


@dataclass(frozen=True)
class BacktestSettings:
    """An investor's settings and its budget for privacy; the defaults suit monthly returns of stock portfolios.

    Args:
        regimes: X, at least 2, fitted to the training sample and ordered by volatility.
        risk_aversion: γ of γu'Σu − μ'u (no ½), per unit of return. At 5 the investor in the embedded industries holds
            four of them, and |c*| stays clear of zero, so a share of it means something in every month; from 7 on c*
            changes its sign in between.
        budget: Budget of all decision makers: a share of |c*|, a `Budget` or a `SilenceShare`. None: a tenth of |c*| at every
            decision of CDM and PDM, as in the paper; for the SDM, in the long run, half the silence regret of the fitted world.
        measure: Privacy measure Ψ; the default is the paper's `MaximalObfuscation()`.
        cost_bps: Cost per unit traded, in basis points of it, at least 0; 10 is the usual order for large stocks.
        train_until: Last date of the training sample, or the month or year that it is the end of ("1989-12").
        seed: The seed of the fit's starts, of the lotteries' draws and of the bootstrap, which are independent of one another.
        covariance: The estimator of the regimes' covariances: "sample", "ledoit-wolf" or "factor:k" as for
            `fit_gaussian_hmm`; None chooses by the amount of data.
        sequential: Whether the sequential rule (SDM) is played as well, whose prices take up to a minute to find.
        own: A model of one's own: limits on weights, and regimes that are then not fitted; its risk aversion, budget and
            costs are for the caller to take over.
        disclosure: The part of the weights that one more rival is shown, how often and how late, such as
            "every(3)|delayed(2)", in rows of the returns. With `portfolio_return()` it also knows all returns. Steps count
            from the first decision.
        rival: A rival's decision problem, as `read_rival` gives it, for the worth of beliefs and weights; None: the investor's
            own. The SDM does not use it: it minimises information.

    Raises:
        InputError: A number is out of its range, `measure` is no privacy measure, there is no such disclosure, or a limit on
            turnover is combined with a disclosure or a rival.

    Example:
        >>> BacktestSettings(budget=0.05).budget
        Budget(amount=0.05, is_relative=True)
    """

    regimes: int = 3
    risk_aversion: float = 5.0
    budget: Budget | SilenceShare | None = None
    measure: PrivacyMeasure = field(default_factory=MaximalObfuscation)
    cost_bps: float = 10.0
    train_until: str = "1989-12"
    seed: int = 0
    covariance: str | None = None
    sequential: bool = True
    disclosure: str = "exact"
    own: OwnModel | None = None
    rival: Rival | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "regimes", validation.count(self.regimes, "regimes", least=2))
        object.__setattr__(self, "risk_aversion", validation.positive(self.risk_aversion, "risk_aversion"))
        object.__setattr__(self, "budget", _written(self.budget))
        object.__setattr__(self, "cost_bps", validation.non_negative(self.cost_bps, "cost_bps"))
        object.__setattr__(self, "train_until", str(self.train_until))
        object.__setattr__(self, "seed", validation.count(self.seed, "seed", least=0))
        if not isinstance(self.sequential, bool):
            raise InputError(f"sequential must be True or False, got {self.sequential!r}")
        object.__setattr__(self, "disclosure", str(Disclosure.of(self.disclosure)))
        if not isinstance(self.measure, PrivacyMeasure):
            raise InputError(f"measure must be a privacy measure such as MaximalObfuscation(), got {self.measure!r}")
        if self.own is not None and self.own.world is not None:
            object.__setattr__(self, "regimes", self.own.world.n_states)
        if self.turnover is not None and self.disclosure != str(Disclosure()):
            raise InputError(
                "with a limit on turnover every decision is made near the weights published last, and a disclosure is read by "
                "observers of rules that do not change from one decision to the next: leave out the disclosure, or the limit"
            )
        if self.turnover is not None and self.rival is not None:
            raise InputError(
                "with a limit on turnover no aware observer is modelled, whose estimates say what the weights are worth to a "
                "rival: leave out the rival (--rival), or the limit"
            )

    @property
    def turnover(self) -> float | None:
        """Largest sum of purchases and sales relative to the last published weights; None for no limit."""
        return None if self.own is None else self.own.file.constraints.turnover

    @property
    def budget_of_each(self) -> Budget:
        """The budget of CDM and PDM for every decision."""
        if isinstance(self.budget, SilenceShare):
            raise InputError(
                "a share of the silence regret is a budget once the regimes are known: run_backtest finds it"
            )
        return _PAPERS_BUDGET if self.budget is None else self.budget


def _written(budget: Any) -> Budget | SilenceShare | None:
    return budget if budget is None or isinstance(budget, (Budget, SilenceShare)) else written_budget(budget)


@dataclass(frozen=True, eq=False)
class ReturnsSample:
    """Returns with dates and labels, and where the training sample ends.

    Args:
        returns: (N,U) simple returns as fractions; a row's return is earned up to its date.
        riskless: (T,) riskless returns over the rows after the training sample; zeros where none were given.
        has_riskless: Whether they were given, so that Sharpe ratios are of excess returns.
        n_training: Number of rows of the training sample.
        frequency: Rows a year.
        suspicious: The entries of the returns that can hardly be right, with row and column, as from `suspicious_entries`.
    """

    returns: pd.DataFrame
    riskless: Array
    has_riskless: bool
    n_training: int
    frequency: Frequency
    suspicious: tuple[str, ...] = ()

    @property
    def training(self) -> pd.DataFrame:
        """The rows that the regimes are fitted on."""
        return self.returns.iloc[: self.n_training]

    @property
    def decided(self) -> pd.DatetimeIndex:
        """(T,) dates at whose end a portfolio is decided: from the end of the training sample to the last but one."""
        return pd.DatetimeIndex(self.returns.index[self.n_training - 1 : -1])

    @property
    def held(self) -> pd.DataFrame:
        """(T,U) returns of the row after each decision."""
        return self.returns.iloc[self.n_training :]


def sample_until(returns: pd.DataFrame, train_until: str, riskless: pd.Series | None) -> ReturnsSample:
    """Return the sample cut at a date; raise `InputError` for whatever does not fit, with its date and label."""
    table = _labelled(returns)
    dates = pd.DatetimeIndex(table.index)
    n_training = _training_rows(dates, train_until)
    n_held = len(dates) - n_training
    if n_held < 2:
        raise InputError(f"{n_held} rows follow the training sample that ends {train_until}; need at least 2")
    base = np.zeros(n_held) if riskless is None else aligned_riskless(riskless, dates[n_training:])
    rows = frequency_of(dates)
    suspicious = (*suspicious_returns(table), *_annual_rates(base, rows))
    for each in suspicious:
        _LOGGER.warning("suspicious returns: %s", each)
    return ReturnsSample(table, base, riskless is not None, n_training, rows, suspicious)


def suspicious_returns(returns: pd.DataFrame) -> tuple[str, ...]:
    """Return warnings about dated returns (T,U), T ≥ 2: those of `suspicious_entries`, and before them one where half of the
    returns are larger than nearly all that assets have, as mild percentages are."""
    rows, usual = frequency_of(pd.DatetimeIndex(returns.index)), float(np.median(np.abs(returns.to_numpy())))
    entries = suspicious_entries(returns)
    if not usual * np.sqrt(rows.per_year) > _MOST_USUAL_A_YEAR:
        return entries
    told = f"half of the returns exceed {usual:.0%} a {rows.word} in size; if they are percentages, divide them by 100"
    return told, *entries


def _annual_rates(riskless: Array, rows: Frequency) -> list[str]:
    """Return a warning where riskless returns are too large for a row, as a rate per year is."""
    mean = float(riskless.mean())
    if not mean * rows.per_year > _MOST_RISKLESS_A_YEAR:
        return []
    return [
        f"a riskless return of {mean:.2%} a {rows.word} on average is {mean * rows.per_year:.0%} a year: a rate per year is "
        f"divided by {rows.per_year:.0f}"
    ]


def checked_market(returns: pd.DataFrame, settings: BacktestSettings, riskless: pd.Series | None) -> ReturnsSample:
    """Return the sample; raise `InputError` if it is too short for the regimes, and as `sample_until`."""
    if not isinstance(settings, BacktestSettings):
        raise InputError(f"settings must be BacktestSettings(...), got {settings!r}")
    sample = sample_until(returns, settings.train_until, riskless)
    n_training, n_assets = sample.training.shape
    is_fitted = settings.own is None or settings.own.world is None
    rule = covariance_rule(settings.covariance, n_training, n_assets, settings.regimes)
    least = settings.regimes * rule.least_observations(n_assets)
    if is_fitted and n_training < least:
        raise InputError(
            f"the training sample has {n_training} rows ({_span(pd.DatetimeIndex(sample.training.index))}); {settings.regimes} "
            f"regimes of {n_assets} assets need at least {least} for {rule.name} covariances: move "
            "train_until (--train-until), or use fewer regimes or assets"
        )
    return sample


def beliefs_by_date(beliefs: pd.DataFrame, dates: pd.DatetimeIndex, regimes: tuple[str, ...]) -> pd.DataFrame:
    """Return a user's beliefs on the dates of the decisions, columns in the order of `regimes`."""
    if not isinstance(beliefs, pd.DataFrame):
        raise InputError(
            f"beliefs must be a DataFrame with dates and one column per regime, got {type(beliefs).__name__}"
        )
    if beliefs.shape[1] != len(regimes):
        raise InputError(
            f"beliefs have {beliefs.shape[1]} columns {list(beliefs.columns)}, "
            f"expected one per regime, by rising volatility: {list(regimes)}; or ask for {beliefs.shape[1]} regimes"
        )
    if set(beliefs.columns) not in (set(regimes), set(range(len(regimes)))):
        raise InputError(
            f"beliefs have the columns {list(beliefs.columns)}, the regimes are {list(regimes)}, by rising volatility: which "
            "is which is for you to say; rename the columns, or give their names in the order of the regimes (--regime-names)"
        )
    check_dates(beliefs.index, "beliefs")
    known = dates.isin(beliefs.index)
    begin = int(known.argmax())
    late = label_text(dates[begin]) if begin > 0 and known[begin:].all() else ""
    cure = (
        f"; they begin on {late}: let the training sample end then, train_until {late} (--train-until)" if late else ""
    )
    refuse_missing(dates, beliefs.index, "beliefs", "the decisions", cure)
    by_name = set(beliefs.columns) == set(regimes)
    rows = beliefs[list(regimes) if by_name else list(range(len(regimes)))].loc[dates]
    checked = [
        validation.beliefs(row, len(regimes), f"belief of {date:%Y-%m-%d}")
        for date, row in zip(dates, rows.to_numpy(), strict=True)
    ]
    return pd.DataFrame(np.array(checked), index=dates, columns=list(regimes))


def _labelled(returns: pd.DataFrame) -> pd.DataFrame:
    if not isinstance(returns, pd.DataFrame):
        raise InputError(
            f"returns must be a DataFrame with dates and one column per asset, got {type(returns).__name__}"
        )
    if not len(returns):
        raise InputError("returns have no rows; expected dates with one return per asset")
    if returns.shape[1] < 2:
        raise InputError(f"returns have {returns.shape[1]} column, expected at least 2 assets to choose from")
    check_dates(returns.index, "returns")
    labels = [str(label) for label in returns.columns]
    twice = sorted({label for label in labels if labels.count(label) > 1})
    if twice:
        raise InputError(f"returns have the column {twice[0]!r} {labels.count(twice[0])} times; columns must differ")
    rows = real_rows(returns)
    below = np.argwhere(rows < -1.0)
    if below.size:
        row, column = (int(i) for i in below[0])
        raise InputError(
            f"the return of {labels[column]!r} on {returns.index[row]:%Y-%m-%d} is {rows[row, column]:g}, a loss of more "
            "than everything; expected simple returns as fractions, 0.01 for one per cent"
        )
    return pd.DataFrame(rows, index=returns.index, columns=labels)


def check_dates(index: pd.Index, what: str) -> None:
    """Raise `InputError` unless an index is of increasing dates."""
    if not isinstance(index, pd.DatetimeIndex):
        raise InputError(f"{what} must have a DatetimeIndex, got {type(index).__name__}; see pandas.to_datetime")
    if index.hasnans:
        raise InputError(f"{what} have no date in row {int(np.flatnonzero(index.isna())[0])}")
    back = np.flatnonzero(np.diff(index.asi8) <= 0)
    if back.size:
        before, after = index[int(back[0])], index[int(back[0]) + 1]
        raise InputError(f"{what} have {after:%Y-%m-%d} after {before:%Y-%m-%d}; dates must increase, each once")


def _training_rows(dates: pd.DatetimeIndex, given: str) -> int:
    """Return the number of rows up to `train_until`; a month or a year stands for its last instant."""
    day = unambiguous(given, "train_until")
    try:
        end = pd.Period(day).end_time
    except (ValueError, TypeError, AttributeError):
        raise InputError(f"train_until must be a date such as 1989-12 or 1989-12-31, got {given!r}") from None
    if len(dates) == 1:
        raise InputError(
            f"returns have one row, of {dates[0]:%Y-%m-%d}, expected some to fit regimes to and some to decide on"
        )
    if not len(dates) or not dates[0] <= end.tz_localize(dates.tz) < dates[-1]:
        middle = f", for example {dates[len(dates) // 2]:%Y-%m-%d}" if len(dates) > 2 else ""
        raise InputError(f"train_until is {given}, the returns cover {_span(dates)}: it must lie inside{middle}")
    return int((dates <= end.tz_localize(dates.tz)).sum())


def _span(dates: pd.DatetimeIndex) -> str:
    return f"{dates[0]:%Y-%m-%d} to {dates[-1]:%Y-%m-%d}" if len(dates) else "no dates"


def aligned_riskless(riskless: pd.Series, dates: pd.DatetimeIndex) -> Array:
    """Return the riskless returns of some dates, (T,)."""
    if not isinstance(riskless, pd.Series):
        raise InputError(f"riskless must be a Series with the dates of the returns, got {type(riskless).__name__}")
    check_dates(riskless.index, "riskless")
    refuse_missing(dates, riskless.index, "riskless", "the returns")
    return validation.finite_array(riskless.loc[dates].to_numpy(), "riskless", ndim=1)


def refuse_missing(wanted: pd.DatetimeIndex, found: pd.Index, what: str, of: str, cure: str = "") -> None:
    """Raise `InputError` where dates are missing, with the first of them and a cure."""
    missing = wanted[~wanted.isin(found)]
    if len(missing):
        some = ", ".join(f"{date:%Y-%m-%d}" for date in missing[:_LISTED])
        more = f" and {len(missing) - _LISTED} more" if len(missing) > _LISTED else ""
        raise InputError(f"{what} lack {len(missing)} of the {len(wanted)} dates of {of}: {some}{more}{cure}")
