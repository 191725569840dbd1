"""Observations beside the published weights: a public one, such as a market's return, and a private signal of the investor.

The estimate of an observer with the public number alone is E[π_t|z_0..t] = p(x|z_0..t), an ordinary filter of it. One who
also sees the weights uses the law of the belief on the grid of the other observers, with the number discretised to quantiles:
with particles, real returns have probability 0 far more often.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from inscrutable import tolerances, validation
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.errors import InputError
from inscrutable.experiments.backtest_aware import AwareReading, PublicSymbols
from inscrutable.experiments.backtest_inputs import ReturnsSample
from inscrutable.experiments.episodes import Episode
from inscrutable.experiments.holding import estimate_quality
from inscrutable.filtering import filter_beliefs
from inscrutable.labels import label_text
from inscrutable.validation import Array
from inscrutable.worlds import GaussianEmission, HiddenMarkovModel, PublicPart

NOTHING, MARKET, ALL = "none", "market", "all"
PUBLIC_SYMBOLS = 8
"""Quantiles that a public number is cut into: simulated steps are too few for many more."""


@dataclass(frozen=True, eq=False)
class BesideReturns:
    """Observations besides weights and returns.

    Args:
        public: What the rival follows itself: "none"; "market", the return of `market`, or without one the mean of the assets;
            "all" returns; the label of one asset; or a Series of numbers by date, which the investor then reads, too.
        market: (N,) the market's returns by date. The rival follows the portfolio of the assets that is nearest to them in the
            training sample, so that the market is a part of the investor's observations.
        private: The investor's own private signal: likelihoods of the regimes by date, one column per regime,
            which bears its name, or its number by rising volatility; a date without a row has no signal.

    Example:
        >>> BesideReturns(public="all").public
        'all'
    """

    public: str | pd.Series = MARKET
    market: pd.Series | None = None
    private: pd.DataFrame | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.public, (str, pd.Series)):
            raise InputError(f"public must be none, market, all, an asset's label or a Series, got {self.public!r}")
        for name, kind in (("market", pd.Series), ("private", pd.DataFrame)):
            given = getattr(self, name)
            if given is not None and not (isinstance(given, kind) and isinstance(given.index, pd.DatetimeIndex)):
                raise InputError(f"{name} must be a {kind.__name__} with dates, got {given!r}")


@dataclass(frozen=True, eq=False)
class PublicWorld:
    """The public observation of a backtest.

    Args:
        said: What is followed, in words.
        world: The investor's world with it; None where nothing is, or all returns are.
        read: (N,) the number on every date.
        cuts: The cut points that discretise the number.
        is_all: Whether all returns are public.
    """

    said: str
    world: HiddenMarkovModel | None = None
    read: pd.Series | None = None
    cuts: Array | None = None
    is_all: bool = False

    def symbols(self, dates: pd.DatetimeIndex) -> PublicSymbols | None:
        """Return it as symbols on the dates of the decisions."""
        if self.world is None or self.read is None or self.cuts is None:
            return None
        return PublicSymbols(self.world, self.cuts, np.searchsorted(self.cuts, self.read.loc[dates].to_numpy()))


@dataclass(frozen=True, eq=False)
class BesideWeights:
    """Estimates (T,X) of the investor's belief by observers who follow a public number.

    Args:
        said: What is followed, in words.
        everything: Of an observer who follows all returns with this model and sees no weights.
        without: Of an observer who follows the public number and sees no weights; None without one.
        face: The beliefs nearest to `without` among those that explain the weights, by decision maker.
        followed: Given the weights and the rule as well, by decision maker; empty where that was not computed.
        number: Name of the public number, no return, that `everything` follows as well; empty where it follows none.
    """

    said: str
    everything: Array
    without: Array | None
    face: Mapping[str, Array]
    followed: Mapping[str, Array]
    number: str = ""

    @property
    def these(self) -> str:
        """What `everything` follows, in words."""
        return f"these returns and {self.number}" if self.number else "these returns"

    def figures(self, name: str, beliefs: Array) -> dict[str, float]:
        """Return the errors of these estimates; NaN where there is none."""
        unknown = np.full(beliefs.shape, np.nan)
        held = {
            "error_public_without": unknown if self.without is None else self.without,
            "error_public_face_value": self.face.get(name, unknown),
            "error_public_followed": self.followed.get(name, unknown),
            "error_all_returns": self.everything,
        }
        return {key: estimate_quality(each, beliefs).error for key, each in held.items()}


def public_world(beside: BesideReturns, world: HiddenMarkovModel, market: ReturnsSample, held: Any) -> PublicWorld:
    """Return the public observation; a number that is no return is fitted to the filtered beliefs `held` (N,X)."""
    assets, training = list(market.returns.columns), market.training
    if isinstance(beside.public, pd.Series):
        read = _on_dates(beside.public, pd.DatetimeIndex(market.returns.index), "public")
        _check_own(read.iloc[: market.n_training].to_numpy(), training)
        sensor = _fitted(read.iloc[: market.n_training].to_numpy(), np.asarray(held)[: market.n_training])
        return _cut(_name_of(beside.public), world, sensor, read, market)
    if beside.public in (NOTHING, ALL):
        return PublicWorld("nothing" if beside.public == NOTHING else "all returns", is_all=beside.public == ALL)
    if beside.public == MARKET and beside.public not in assets:
        if beside.market is None:
            weights, said = np.full(len(assets), 1.0 / len(assets)), "the mean return of the assets"
        else:
            target = _on_dates(beside.market, pd.DatetimeIndex(training.index), "market").to_numpy()
            weights = np.linalg.lstsq(training.to_numpy(), target, rcond=None)[0]
            rest = target - training.to_numpy() @ weights
            said = f"the market's return, as the portfolio of the assets nearest to it (R² {1 - rest.var() / target.var():.4f})"
    elif beside.public in assets:
        weights, said = np.eye(len(assets))[assets.index(beside.public)], f"the return of {beside.public}"
    else:
        raise InputError(f"public must be none, market, all or one of the assets {assets}, got {beside.public!r}")
    part = PublicPart(pd.DataFrame([weights], columns=assets))
    parts = np.sort(market.returns.to_numpy() * weights, axis=1)  # their sum is the same in any order of the assets
    return _cut(said, world, part, pd.Series(parts.sum(axis=1), market.returns.index), market)


def investors_world(public: PublicWorld, world: HiddenMarkovModel) -> HiddenMarkovModel:
    """Return the world as the investor filters it: with the separate public sensor where there is one."""
    return public.world if public.world is not None and not isinstance(public.world.public, PublicPart) else world


def held_beliefs(
    world: HiddenMarkovModel, market: ReturnsSample, public: PublicWorld, private: pd.DataFrame | None
) -> pd.DataFrame:
    """Return the predicted beliefs on all dates, from the returns, a separate public sensor, and a private signal."""
    index = pd.DatetimeIndex(market.returns.index)
    read = None if isinstance(world.public, PublicPart) or world.public is None else public.read
    if private is None:
        return filter_beliefs(world, market.returns, public=read).predicted
    signal = _signal(private, index, world.names)
    if read is not None:
        assert world.public_emission is not None
        signal = signal + np.asarray(world.public_emission.log_likelihoods(read.to_numpy()))
    told = HiddenMarkovModel(
        world.transition, world.emission, world.initial, names=world.names, public=_Signal(world.n_states)
    )
    return filter_beliefs(told, market.returns, public=signal).predicted


def _name_of(public: str | pd.Series) -> str:
    return str(public.name or "its numbers") if isinstance(public, pd.Series) else public


class AllPublic(NamedTuple):
    """The estimates (T,X) of an observer who follows all returns."""

    beliefs: Array
    number: str  # the public number, no return, that it follows as well; empty for none


def all_public(followed: Sequence[pd.DataFrame], held: pd.DataFrame, public: str | pd.Series) -> AllPublic:
    """Return the estimates that are nearest to the investor's beliefs, from all returns alone or with a public number.

    An investor with beliefs of its own need not have read the number.
    """
    errors = [estimate_quality(each.to_numpy(), held.to_numpy()).error for each in followed]
    best = int(np.argmin(errors))
    return AllPublic(followed[best].to_numpy(), _name_of(public) if best else "")


def read_public(
    public: PublicWorld, episode: Episode, of_all: AllPublic, aware: AwareReading | None, dates: pd.DatetimeIndex
) -> BesideWeights:
    """Return the estimates of observers who follow a public number."""
    everything = of_all.beliefs
    without = everything if public.is_all else None
    if public.world is not None and public.read is not None:
        sensor, world = public.world.public_emission, public.world
        assert sensor is not None
        alone = HiddenMarkovModel(world.transition, sensor, world.initial)
        found = filter_beliefs(alone, public.read.to_numpy()).predicted
        without = found[pd.DatetimeIndex(public.read.index).get_indexer(dates)]
    if without is None:
        return BesideWeights(public.said, everything, None, {}, {}, of_all.number)
    face = {name: _nearest(episode, record.decisions.action, without) for name, record in episode.records.items()}
    followed = dict.fromkeys(episode.records, everything) if public.is_all else {}
    if not public.is_all and aware is not None:
        followed = dict(aware.beside_public)
    return BesideWeights(public.said, everything, without, face, followed, of_all.number)


class _Signal:
    """A sensor that reports its own log-likelihoods, (T,X)."""

    def __init__(self, n_states: int) -> None:
        self.n_states = n_states

    def log_likelihoods(self, observations: Any) -> Array:
        """Return what was reported."""
        return np.asarray(observations, dtype=np.float64)

    def sample(self, states: Any, *, rng: np.random.Generator) -> Any:
        """Raise an error, because the law of the signal in a state is not known."""
        raise InputError("a private signal is known by its likelihoods alone and cannot be drawn")

    def to_dict(self) -> dict[str, Any]:
        """Return its type."""
        return {"type": "signal"}


def _cut(
    said: str, world: HiddenMarkovModel, public: PublicPart | GaussianEmission, read: pd.Series, market: ReturnsSample
) -> PublicWorld:
    with_it = HiddenMarkovModel(world.transition, world.emission, world.initial, names=world.names, public=public)
    known = read.iloc[: market.n_training].to_numpy()
    cuts = np.unique(np.quantile(known, np.arange(1, PUBLIC_SYMBOLS) / PUBLIC_SYMBOLS))
    return PublicWorld(said, with_it, read, cuts)


def _check_own(values: Array, returns: pd.DataFrame) -> None:
    """Raise `InputError` for a number that does not vary, or follows from the returns, which would count twice."""
    if validation.constant_columns(values):
        raise InputError(f"public numbers do not vary in the training sample: all are {values[0]:g}")
    moved, rows = values - values.mean(), (returns - returns.mean()).to_numpy()
    if len(rows) <= 2 * rows.shape[1]:
        return  # too few to tell
    groups = [*([column] for column in range(rows.shape[1])), list(range(rows.shape[1]))]
    for columns in groups:
        rest = moved - rows[:, columns] @ np.linalg.lstsq(rows[:, columns], moved, rcond=None)[0]
        if rest @ rest <= tolerances.COMBINED_COLUMNS * (moved @ moved):
            one = label_text(returns.columns[columns[0]])
            what = f"are the returns of {one}" if len(columns) == 1 else "are a combination of the returns"
            instead = f"the column {one}" if len(columns) == 1 else "market, all or a column"
            raise InputError(
                f"public numbers {what}, which the investor reads already and would count twice; of the returns {instead} can "
                "be public, by name"
            )


def _fitted(values: Array, held: Array) -> GaussianEmission:
    """Return a number's mean and variance in each regime, its rows weighted by the training sample's filtered beliefs."""
    shares = held / held.sum(axis=0)
    means = shares.T @ values
    variances = (shares * (values[:, None] - means) ** 2).sum(axis=0)
    if not (variances > 0).all():
        raise InputError("public numbers do not vary in a regime of the training sample")
    return GaussianEmission(means[:, None], variances[:, None, None])


def _nearest(episode: Episode, actions: Array, without: Array) -> Array:
    """Return the belief that explains the decision and is nearest to the estimate without it; that estimate if none does."""
    found = [belief_set_of(episode.problem, each).nearest(own) for each, own in zip(actions, without, strict=True)]
    return np.where(np.isnan(found), without, found)


def _on_dates(given: pd.Series, dates: pd.DatetimeIndex, what: str) -> pd.Series:
    missing = dates[~dates.isin(given.index)]
    if len(missing):
        raise InputError(
            f"{what} lacks {len(missing)} of {len(dates)} dates of the returns, the first {missing[0]:%Y-%m-%d}"
        )
    if given.index.has_duplicates:
        raise InputError(f"{what} has a date twice")
    return pd.Series(validation.finite_array(given.loc[dates].to_numpy(), what, ndim=1), dates)


def _signal(private: pd.DataFrame, dates: pd.DatetimeIndex, regimes: tuple[str, ...]) -> Array:
    """Return log-likelihoods (N,X) on all dates; 0 where there is no signal."""
    columns = set(private.columns)
    if columns not in (set(regimes), set(range(len(regimes)))) or private.shape[1] != len(regimes):
        raise InputError(
            f"private has the columns {list(private.columns)}, expected one per regime, by rising volatility: {list(regimes)}"
        )
    rows = private[list(regimes) if columns == set(regimes) else list(range(len(regimes)))]
    inside = rows.loc[(rows.index >= dates[0]) & (rows.index <= dates[-1])]
    stray = inside.index[~inside.index.isin(dates)]
    rows = inside.drop(stray)
    if not len(rows) or rows.index.has_duplicates:
        raise InputError(
            "private has none of the dates of the returns" if not len(rows) else "private has a date twice"
        )
    if len(stray):
        raise InputError(
            f"private has {len(stray)} of {len(inside)} rows on dates that the returns do not have, the first "
            f"{stray[0]:%Y-%m-%d}: give signals on the returns' own dates"
        )
    values = validation.finite_array(rows.to_numpy(), "private", ndim=2)
    bad = np.flatnonzero((values < 0).any(axis=1) | ~(values.max(axis=1) > 0))
    if bad.size:
        raise InputError(
            f"private has {values[bad[0]].tolist()} on {rows.index[bad[0]]:%Y-%m-%d}: likelihoods are at least 0, one above"
        )
    found = np.zeros((len(dates), len(regimes)))
    with np.errstate(divide="ignore"):
        found[dates.get_indexer(rows.index)] = np.log(values)
    return found
