"""The layout of a study file: its sections, their keys, and what each may hold.

A number or a name may be a list where the key says so: then the study is run for every entry, and for every combination
with the lists of other keys.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

_Entry = TypeVar("_Entry")
_Hiding = TypeVar("_Hiding", bound="CounterAdversarial | Probabilistic")


def _listed(value: Any) -> Any:
    """A list as a tuple, and anything else as a tuple of one."""
    return tuple(value) if isinstance(value, list) else value if isinstance(value, tuple) else (value,)


def _distinct(values: tuple[Any, ...]) -> tuple[Any, ...]:
    for place, value in enumerate(values):
        if value in values[:place]:
            raise ValueError(f"{value!r} stands twice")
    return values


def _ascending(pair: list[float]) -> list[float]:
    if pair[0] > pair[1]:
        raise ValueError("should be a lowest and a highest value")
    return pair


def _named(value: Any) -> Any:
    """A bare name as a section with nothing but that name."""
    return {"name": value} if isinstance(value, str) else value


def _markowitz_unless_told(value: Any) -> Any:
    return {"kind": "markowitz", **value} if isinstance(value, dict) else value


Grid = Annotated[
    tuple[_Entry, ...], BeforeValidator(_listed), Field(min_length=1, strict=False), AfterValidator(_distinct)
]
"""One value, or a list of different ones to run the study for."""

Several = Annotated[tuple[_Entry, ...], BeforeValidator(_listed), Field(min_length=1, strict=False)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Probability = Annotated[float, Field(ge=0, le=1)]
Likely = Annotated[float, Field(gt=0, le=1)]
Count = Annotated[int, Field(ge=1)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2), AfterValidator(_ascending)]
PositivePair = Annotated[list[Positive], Field(min_length=2, max_length=2), AfterValidator(_ascending)]
Matrix = list[list[float]]
Goal = Literal["maximal", "reversed", "non-existence", "non-uniqueness", "infeasibility"]


class Section(BaseModel):
    """Part of a study file: no key but the known ones, and no text where a number belongs."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class GivenWorld(Section):
    """Regimes with their means and covariances: of assets' returns, or of wind farms' output."""

    kind: Literal["given"]
    means: Matrix
    covariances: list[Matrix]
    transition: Matrix | None = None


class RandomWorld(Section):
    """Markets drawn as in the paper, from the law `experiments.random_markets.MarketLaw`."""

    kind: Literal["random"]
    regimes: Grid[Annotated[int, Field(ge=2)]] = (3,)
    assets: Grid[Annotated[int, Field(ge=2)]] = (3,)
    means: Pair = Field(default_factory=lambda: [-0.01, 0.02])
    volatilities: PositivePair = Field(default_factory=lambda: [0.04, 0.12])
    persistence: Grid[Likely] = (0.8,)
    sensor: Grid[Literal["categorical", "gaussian"]] = ("categorical",)
    accuracy: Grid[Likely] = (0.7,)


class FittedWorldSection(Section):
    """Regimes fitted to returns: the embedded ones, or a CSV beside the study file."""

    kind: Literal["fitted"]
    data: str = "industries"
    prices: bool = False
    regimes: Grid[Annotated[int, Field(ge=2)]] = (3,)
    train_until: str | None = None
    restarts: Count | None = None


class MarkowitzSection(Section):
    """A portfolio: risk aversion and limits on weights."""

    kind: Literal["markowitz"]
    risk_aversion: Grid[Positive] = (5.0,)
    max_weight: Grid[Likely] | None = None
    min_weight: Grid[Probability] | None = None


class DispatchSection(Section):
    """Generators and wind farms on the IEEE 30-bus network, for a world that is given; buses are numbered from 0."""

    kind: Literal["dispatch"]
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
    """The filtered beliefs of one sampled path, each step the same weight."""

    kind: Literal["path"]
    steps: Grid[Count] = (30,)


class CandidateSection(Section):
    """What decision makers choose from; without a resolution about 5,000 decoys."""

    kind: Grid[Literal["decoys", "actions"]] = ("decoys",)
    resolution: Grid[Count] | None = None


class Original(Section):
    """The original decision maker."""

    name: Literal["ODM"]


def _candidates_seek_distance(section: _Hiding) -> _Hiding:
    if "candidates" in section.method and section.goal != ("maximal",):
        raise ValueError('the method "candidates" knows the goal "maximal" alone')
    return section


class CounterAdversarial(Section):
    """The most private decision that is affordable: searched globally, among candidates alone, or by the paper's solver."""

    name: Literal["CDM"]
    goal: Grid[Goal] = ("maximal",)
    method: Grid[Literal["global", "candidates", "local"]] = ("global",)
    starts: Grid[Count] = (1,)
    _knows = model_validator(mode="after")(_candidates_seek_distance)


class Probabilistic(Section):
    """The most private lottery that is affordable in expectation, over all decisions or over candidates alone."""

    name: Literal["PDM"]
    goal: Grid[Goal] = ("maximal",)
    method: Grid[Literal["global", "candidates"]] = ("global",)
    _knows = model_validator(mode="after")(_candidates_seek_distance)


class Uniform(Section):
    """One of the affordable candidates, all equally likely."""

    name: Literal["uniform"]


class Exponential(Section):
    """The exponential mechanism; without epsilon it is made to spend the budget."""

    name: Literal["exponential"]
    epsilon: Grid[NonNegative] | None = None


class Dirichlet(Section):
    """Dirichlet noise; without a concentration it is made to spend the budget."""

    name: Literal["Dirichlet noise"]
    concentration: Grid[Positive] | None = None
    draws: Count = 1000


class Coin(Section):
    """The best constant decision with some probability, which else is what spends the budget."""

    name: Literal["coin"]
    probability: Grid[Probability] | None = None


class Rounding(Section):
    """The optimal decision in steps, which else are those that spend the budget."""

    name: Literal["rounding"]
    step: Grid[Positive] | None = None


class RateDistortion(Section):
    """The mechanism of least mutual information at an expected regret."""

    name: Literal["rate-distortion"]


class Stackelberg(Section):
    """The mechanism that leaves one who knows it the largest error, with a budget per belief; `gap` is the proof's."""

    name: Literal["Stackelberg"]
    gap: Grid[Annotated[float, Field(gt=0, lt=1)]] | None = None


class Naive(Section):
    """Takes every decision for optimal."""

    name: Literal["naive"]


class NearOptimal(Section):
    """Allows for a regret, which else is the one the decision maker spends; knows the law of beliefs."""

    name: Literal["near-optimal"]
    regret: Grid[NonNegative] | None = None


class BudgetAware(Section):
    """Knows the largest regret that any decision has; knows the law of beliefs."""

    name: Literal["budget-aware"]


class Bayesian(Section):
    """Knows the mechanism and the law of beliefs."""

    name: Literal["bayesian"]


World = Annotated[GivenWorld | RandomWorld | FittedWorldSection, Field(discriminator="kind")]
Problem = Annotated[
    Annotated[MarkowitzSection | DispatchSection, Field(discriminator="kind")], BeforeValidator(_markowitz_unless_told)
]
Beliefs = Annotated[GridBeliefs | StationaryBeliefs | PathBeliefs, Field(discriminator="kind")]
MakerSection = (
    Original
    | CounterAdversarial
    | Probabilistic
    | Uniform
    | Exponential
    | Dirichlet
    | Coin
    | Rounding
    | RateDistortion
    | Stackelberg
)
Maker = Annotated[Annotated[MakerSection, Field(discriminator="name")], BeforeValidator(_named)]
AdversarySection = Naive | NearOptimal | BudgetAware | Bayesian
Observer = Annotated[Annotated[AdversarySection, Field(discriminator="name")], BeforeValidator(_named)]
Measure = Literal[
    "error",
    "top_state",
    "naive_privacy",
    "expected_regret",
    "worst_regret",
    "cost_share",
    "silence_share",
    "mutual_information",
    "min_entropy_leakage",
    "maximal_leakage",
    "prior_error",
    "prior_entropy",
    "prior_top_state",
    "n_actions",
    "implausible_share",
    "expected_gap",
    "read_auc",
]


class BudgetSection(Section):
    """What is spent on privacy.

    Units: "relative" is a share of |c*| at every belief, the paper's; "regret" the cost's own unit; "silence" a share of
    the silence regret r₀; "cost" a share of E|c*|. `hold` says where it holds: "each", for every belief, or "mean": every
    decision maker is made to spend the same expected regret.
    """

    values: Grid[NonNegative] = (0.1,)
    unit: Literal["relative", "regret", "silence", "cost"] = "relative"
    hold: Literal["each", "mean"] = "each"


class PlanFile(Section):
    """What every kind of study says of itself."""

    name: Annotated[str, Field(min_length=1)]
    note: str = ""
    seed: Annotated[int, Field(ge=0)] = 0


class StudyFile(PlanFile):
    """The whole file of a grid, the common kind of study."""

    repeats: Count = 1
    world: World
    problem: Problem = MarkowitzSection(kind="markowitz")
    beliefs: Beliefs = GridBeliefs(kind="grid")
    candidates: CandidateSection = CandidateSection()
    decision_makers: Several[Maker]
    budgets: BudgetSection = BudgetSection()
    adversaries: Several[Observer] = (Naive(name="naive"),)
    measures: Grid[Measure] = ("error", "top_state", "naive_privacy", "expected_regret", "mutual_information")
