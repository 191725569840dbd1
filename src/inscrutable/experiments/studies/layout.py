"""The layout of a study file: its sections, their keys, and what each may hold.

A number or a name may be a list where the key says so: then the study is run for every entry, and for every combination
with the lists of other keys.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from inscrutable.budgets import Budget, SilenceShare, remarks_of
from inscrutable.datasets.matpower import Convention
from inscrutable.errors import InputError
from inscrutable.experiments import makers, observers
from inscrutable.experiments.measures import MEASURES, WITHOUT
from inscrutable.experiments.measures import Measure as MeasureKind
from inscrutable.experiments.rivals import Rival, markowitz_unless_told
from inscrutable.experiments.sections import (
    AtLeastTwo,
    Count,
    Grid,
    Likely,
    Matrix,
    NonNegative,
    Pair,
    PlanFile,
    Positive,
    PositivePair,
    Probability,
    Section,
    Several,
)
from inscrutable.worlds.covariances import named_rule


def named(value: Any) -> Any:
    """Return a bare name as a section with nothing but that name."""
    return {"name": value} if isinstance(value, str) else value


def _covariance(name: str) -> str:
    try:
        return named_rule(name).name
    except InputError:
        raise ValueError('should be "sample", "ledoit-wolf" or "factor:K" such as "factor:3"') from None


class GivenWorld(Section):
    """Regimes with given means and covariances of the assets' returns, or of the wind farms' output."""

    kind: Literal["given"]
    means: Matrix
    covariances: list[Matrix]
    transition: Matrix | None = None


class RandomWorld(Section):
    """Markets drawn as in the paper, from the law `experiments.random_markets.MarketLaw`."""

    kind: Literal["random"]
    regimes: Grid[AtLeastTwo] = (3,)
    assets: Grid[AtLeastTwo] = (3,)
    means: Pair = (-0.01, 0.02)
    volatilities: PositivePair = (0.04, 0.12)
    persistence: Grid[Likely] = (0.8,)
    sensor: Grid[Literal["categorical", "gaussian"]] = ("categorical",)
    accuracy: Grid[Likely] = (0.7,)


class FittedWorldSection(Section):
    """Regimes fitted to returns: the embedded ones, or a CSV beside the study file.

    The covariances are "sample", "ledoit-wolf" (shrunk) or "factor:K". Without the key they are those of the sample if there
    are ten rows per regime and asset, and shrunk otherwise.
    """

    kind: Literal["fitted"]
    data: str = "industries"
    prices: bool = False
    regimes: Grid[AtLeastTwo] = (3,)
    train_until: str | None = None
    covariance: Grid[Annotated[str, AfterValidator(_covariance)]] | None = None
    restarts: Count | None = None


class MarkowitzSection(Section):
    """A portfolio, with a risk aversion and limits on weights."""

    kind: Literal["markowitz"]
    risk_aversion: Grid[Positive] = (5.0,)
    max_weight: Grid[Likely] | None = None
    min_weight: Grid[Probability] | None = None


class DispatchSection(Section):
    """Generators and wind farms on a network, for a world that is given: the IEEE 30-bus network, whose buses are numbered
    from 0, or a MATPOWER case beside the study file, whose buses have its own numbers."""

    kind: Literal["dispatch"]
    network: str | None = None
    convention: Convention = "powermodels"
    wind_buses: Several[Annotated[int, Field(ge=0)]]
    wind_capacities: Several[NonNegative] | None = None
    penalty: Grid[Positive] = (1.0,)


class GridBeliefs(Section):
    """Every belief of a regular grid, equally likely."""

    kind: Literal["grid"]
    resolution: Grid[Count] = (30,)


class StationaryBeliefs(Section):
    """The long-run law of the filtered belief, on a grid."""

    kind: Literal["stationary"]
    resolution: Grid[Count] = (30,)


class PathBeliefs(Section):
    """The filtered beliefs of one sampled path, equally likely."""

    kind: Literal["path"]
    steps: Grid[Count] = (30,)


class CandidateSection(Section):
    """The candidates from which decision makers choose; without a resolution they are about 5,000 decoys."""

    kind: Grid[Literal["decoys", "actions"]] = ("decoys",)
    resolution: Grid[Count] | None = None


World = Annotated[GivenWorld | RandomWorld | FittedWorldSection, Field(discriminator="kind")]
Problem = Annotated[
    Annotated[MarkowitzSection | DispatchSection, Field(discriminator="kind")], BeforeValidator(markowitz_unless_told)
]
Beliefs = Annotated[GridBeliefs | StationaryBeliefs | PathBeliefs, Field(discriminator="kind")]
MakerSection = (
    makers.Original
    | makers.CounterAdversarial
    | makers.Probabilistic
    | makers.Uniform
    | makers.Exponential
    | makers.Dirichlet
    | makers.Coin
    | makers.Rounding
    | makers.RateDistortion
    | makers.Stackelberg
    | makers.Delay
    | makers.PartialTrades
    | makers.Sequential
)

Maker = Annotated[Annotated[MakerSection, Field(discriminator="name")], BeforeValidator(named)]
ObserverSection = (
    observers.Naive
    | observers.NearOptimal
    | observers.BudgetAware
    | observers.Bayesian
    | observers.Data
    | observers.SequentialObserver
)
Observer = Annotated[Annotated[ObserverSection, Field(discriminator="name")], BeforeValidator(named)]
Measure: Any = Literal[tuple(MEASURES)]
PAID = "expected_regret"
"""The measure of every grid, requested or not: without it the costs of two decision makers cannot be compared."""
JUDGED = ("error", "top_state")
"""Measures that together decide whether a belief is hidden; their references `WITHOUT` are measured as well."""


class BudgetSection(Section):
    """The budget of privacy.

    The unit "relative" is the paper's, a share of |c*|; "regret" is the cost's own unit; "silence" is a share of the silence
    regret r₀; "cost" is a share of E|c*|. With `hold` "each" the budget holds at every belief for CDM, PDM, uniform,
    Stackelberg and rules of your own, and in expectation over the beliefs for all others; with "mean" every decision maker
    spends it in expectation, or less where it cannot.
    """

    values: Grid[NonNegative] = (0.1,)
    unit: Literal["relative", "regret", "silence", "cost"] = "relative"
    hold: Literal["each", "mean"] = "each"

    def remarks(self) -> list[str]:
        """Return cautions about unusual shares; amounts in the cost's unit are not judged, since that is any."""
        if self.unit == "regret":
            return []
        budgets = [SilenceShare(value) if self.unit == "silence" else Budget.relative(value) for value in self.values]
        return [
            each for value, budget in zip(self.values, budgets, strict=True) if value for each in remarks_of(budget)
        ]


class StudyFile(PlanFile):
    """The whole file of a grid, the common kind of study."""

    maker_kinds: ClassVar[Mapping[str, type[makers.MakerSection]]] = makers.MAKERS
    observer_kinds: ClassVar[Mapping[str, type[observers.ObserverSection]]] = observers.OBSERVERS
    measure_kinds: ClassVar[Mapping[str, MeasureKind]] = MEASURES
    extensions: ClassVar[tuple[Any, ...]] = ()

    repeats: Count = 1
    world: World
    problem: Problem = MarkowitzSection(kind="markowitz")
    beliefs: Beliefs = GridBeliefs(kind="grid")
    candidates: CandidateSection = CandidateSection()
    decision_makers: Several[Maker]
    budgets: BudgetSection = BudgetSection()
    rival: Rival | None = None
    adversaries: Several[Observer] = (observers.Naive(name="naive"),)
    measures: Grid[Measure] = (*JUDGED, "naive_privacy", PAID, "mutual_information", *WITHOUT)

    @model_validator(mode="before")
    @classmethod
    def _pays(cls, data: Any) -> Any:
        """Return the measures with the regret added, and with the errors without decisions where hiding is judged."""
        asked = data.get("measures") if isinstance(data, dict) else None
        if isinstance(asked, str):
            asked = [asked]
        if not isinstance(asked, (list, tuple)) or not asked:
            return data
        beside = (PAID, *(WITHOUT if all(name in asked for name in JUDGED) else ()))
        return data | {"measures": [*asked, *(name for name in beside if name not in asked)]}


def follows(study: StudyFile) -> bool:
    """Whether some observer or rule needs the transition of the belief."""
    followers: tuple[object, ...] = (*study.adversaries, *study.decision_makers)
    return any(isinstance(each, observers.SequentialObserver | makers.WithMemory) for each in followers)
