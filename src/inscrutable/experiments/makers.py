"""The decision makers of experiments, one section each: its keys, its construction and its kind of budget.

Reports and documents show the first line of a section's docstring.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from typing import Annotated, Any, ClassVar, Literal, TypeVar

from pydantic import Field, model_validator

from inscrutable.budgets import Budget
from inscrutable.decision_makers import (
    CounterAdversarialDecisionMaker,
    LinearProgramme,
    LocalSearch,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    RateDistortionDecisionMaker,
    StackelbergDecisionMaker,
)
from inscrutable.decision_makers.baselines import (
    CoinDecisionMaker,
    DirichletDecisionMaker,
    ExponentialDecisionMaker,
    RoundingDecisionMaker,
    UniformDecisionMaker,
)
from inscrutable.decision_makers.candidate_sources import is_simplex
from inscrutable.errors import InputError
from inscrutable.experiments.candidates_only import CandidateDecisionMaker
from inscrutable.experiments.memory_rules import delayed, partly
from inscrutable.experiments.sections import Count, Grid, NonNegative, Positive, Probability, Section
from inscrutable.experiments.sequential_play import sequential
from inscrutable.experiments.setting import Behaviour, Seed, Setting, behaviour_of, scaled_to, spent
from inscrutable.privacy import (
    DesiredObfuscation,
    Infeasibility,
    Loss,
    MaximalObfuscation,
    NonExistence,
    NonUniqueness,
    PrivacyMeasure,
)

_ROUNDINGS = (*range(1, 21), 25, 33, 50, 100)
"""Values of n for weights in multiples of 1/n."""

Goal = Literal["maximal", "reversed", "non-existence", "non-uniqueness", "infeasibility"]
Chosen = Mapping[str, Any]
"""A section's keys with one value each."""
_Hiding = TypeVar("_Hiding", bound="CounterAdversarial | Probabilistic")


class Takes(Enum):
    """The kind of budget that a decision maker takes."""

    NOTHING = "none: it always plays the same"
    EACH = "one per belief"
    MEAN = "an expected regret"


class MakerSection(Section):
    """A decision maker.

    Class attributes:
        takes: The kind of its budget.
        promises: Whether a budget per belief bounds every decision, not only the expectation.
        parameter: The key that replaces a budget if it is given.
    """

    takes: ClassVar[Takes] = Takes.MEAN
    promises: ClassVar[bool] = False
    parameter: ClassVar[str] = ""

    @classmethod
    def takes_budget(cls, chosen: Chosen) -> bool:
        """Whether it takes a budget with these keys."""
        return cls.takes is not Takes.NOTHING and cls.parameter not in chosen

    @classmethod
    def suits(cls, setting: Setting) -> bool:
        """Whether it can decide in a setting."""
        return True

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return the decision maker of a budget per belief, an expected regret, or its parameter."""
        raise NotImplementedError

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return its behaviour at an expected regret above 0; None if it does not suit the setting."""
        return behaviour_of(setting, cls.make(setting, chosen, regret, seed))


class Original(MakerSection):
    """The original decision maker: the optimal decision, nothing hidden."""

    takes = Takes.NOTHING
    name: Literal["ODM"]

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it."""
        return OriginalDecisionMaker(setting.problem)


def _candidates_seek_distance(section: _Hiding) -> _Hiding:
    if "candidates" in section.method and section.goal != ("maximal",):
        raise ValueError('the method "candidates" knows the goal "maximal" alone')
    return section


class _Hides(MakerSection):
    """A decision maker that maximises a privacy measure Ψ; `own` holds user-defined measures by name."""

    takes = Takes.EACH
    own: ClassVar[Mapping[str, Callable[[], PrivacyMeasure]]] = {}

    @classmethod
    def goal_of(cls, chosen: Chosen) -> PrivacyMeasure:
        """Return the measure that it maximises."""
        name = chosen.get("goal", "maximal")
        return cls.own[name]() if name in cls.own else goal_of(name)


class CounterAdversarial(_Hides):
    """The most private decision that is affordable: searched globally, among candidates alone, or by the paper's solver."""

    promises = True
    name: Literal["CDM"]
    goal: Grid[Goal] = ("maximal",)
    method: Grid[Literal["global", "candidates", "local"]] = ("global",)
    starts: Grid[Count] = (1,)
    _knows = model_validator(mode="after")(_candidates_seek_distance)

    @classmethod
    def make(cls, setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with a budget per belief."""
        method = chosen.get("method", "global")
        if method == "candidates":
            return CandidateDecisionMaker(setting.problem, amount, setting.candidates)
        local = LocalSearch(chosen["starts"], seed()) if method == "local" else None
        candidates = None if local else setting.candidates
        goal = cls.goal_of(chosen)
        return CounterAdversarialDecisionMaker(setting.problem, goal, amount, candidates=candidates, method=local)


class Probabilistic(_Hides):
    """The most private lottery that is affordable in expectation.

    It is searched over all decisions, over candidates alone, or by the paper's linear programme over candidates.
    """

    name: Literal["PDM"]
    goal: Grid[Goal] = ("maximal",)
    method: Grid[Literal["global", "candidates", "programme"]] = ("global",)
    _knows = model_validator(mode="after")(_candidates_seek_distance)

    @classmethod
    def make(cls, setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with a budget per belief."""
        if chosen.get("method") == "candidates":
            return CandidateDecisionMaker(setting.problem, amount, setting.candidates, mixes=True)
        method = LinearProgramme() if chosen.get("method") == "programme" else None
        goal = cls.goal_of(chosen)
        return ProbabilisticDecisionMaker(setting.problem, goal, amount, candidates=setting.candidates, method=method)


class Uniform(MakerSection):
    """A candidate drawn uniformly from the affordable ones."""

    takes, promises = Takes.EACH, True
    name: Literal["uniform"]

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with a budget per belief."""
        return UniformDecisionMaker(setting.problem, amount, candidates=setting.candidates)


class Stackelberg(MakerSection):
    """The committed mechanism that maximises the aware observer's error, with a budget per belief.

    `gap` is the gap of the proof; `loss` is the objective: the square error, or the loss of the section [rival].
    """

    takes = Takes.EACH
    name: Literal["Stackelberg"]
    gap: Grid[Annotated[float, Field(gt=0, lt=1)]] | None = None
    loss: Grid[Literal["squared", "rival"]] | None = None

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with a budget per belief; with the loss of the setting's rival if `loss` asks for it."""
        prior, candidates = setting.prior, setting.candidates
        return StackelbergDecisionMaker(
            setting.problem,
            amount,
            prior=prior,
            candidates=candidates,
            gap=chosen.get("gap"),
            loss=_loss(setting, chosen),
        )


class RateDistortion(MakerSection):
    """The mechanism of least mutual information at an expected regret."""

    name: Literal["rate-distortion"]

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with an expected regret."""
        prior, candidates = setting.prior, setting.candidates
        return RateDistortionDecisionMaker(setting.problem, Budget.regret(amount), prior=prior, candidates=candidates)


class _Noise(MakerSection):
    """A decision maker whose expected regret grows roughly with its amount of noise."""

    @classmethod
    def of_noise(cls, setting: Setting, amount: float) -> float:
        """Return its parameter for an amount of noise, in the cost's unit."""
        raise NotImplementedError

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return its behaviour with the amount of noise that spends an expected regret."""

        def tried(amount: float) -> Behaviour:
            return behaviour_of(setting, cls.make(setting, chosen, cls.of_noise(setting, amount), seed))

        return scaled_to(setting, tried, regret)


class Exponential(_Noise):
    """The exponential mechanism: cheaper candidates are more probable; without a parameter it is calibrated to the budget."""

    parameter = "epsilon"
    name: Literal["exponential"]
    epsilon: Grid[NonNegative] | None = None

    @classmethod
    def of_noise(cls, setting: Setting, amount: float) -> float:
        """Return ε."""
        return 1.0 / amount

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with an ε."""
        return ExponentialDecisionMaker(setting.problem, amount, candidates=setting.candidates)


class Dirichlet(_Noise):
    """Dirichlet noise on the weights; without a concentration it is calibrated to the budget."""

    parameter = "concentration"
    name: Literal["Dirichlet noise"]
    concentration: Grid[Positive] | None = None
    draws: Count = 1000

    @classmethod
    def suits(cls, setting: Setting) -> bool:
        """Whether decisions are weights on the simplex."""
        return _has_weights(setting)

    @classmethod
    def of_noise(cls, setting: Setting, amount: float) -> float:
        """Return the concentration."""
        return (setting.mean_cost or 1.0) / amount

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with a concentration; every trial uses the same noise, so the regret depends on the concentration alone."""
        drawn = {"rng": seed(), "n_draws": chosen.get("draws", 1000)}
        return DirichletDecisionMaker(setting.problem, amount, candidates=setting.candidates, **drawn)


class Coin(MakerSection):
    """The best constant decision with some probability, else the optimal one; by default the budget sets the probability."""

    parameter = "probability"
    name: Literal["coin"]
    probability: Grid[Probability] | None = None

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with a probability."""
        return CoinDecisionMaker(setting.problem, amount, decoy=setting.prior.mean)

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return its behaviour with the probability that spends an expected regret: regret/r₀."""
        silent = setting.silence_regret
        share = min(regret / silent, 1.0) if silent > 0 else 0.0
        return behaviour_of(setting, cls.make(setting, chosen, share, seed))


class Rounding(MakerSection):
    """The optimal decision rounded to whole steps; by default the coarsest steps within the budget."""

    parameter = "step"
    name: Literal["rounding"]
    step: Grid[Positive] | None = None

    @classmethod
    def suits(cls, setting: Setting) -> bool:
        """Whether decisions are weights on the simplex."""
        return _has_weights(setting)

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with a step."""
        return RoundingDecisionMaker(setting.problem, amount)

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return its behaviour with the usual step whose expected regret is nearest below the given one; else no rounding."""

        def every() -> list[tuple[Behaviour, float]]:
            found = [behaviour_of(setting, cls.make(setting, chosen, 1.0 / steps, seed)) for steps in _ROUNDINGS]
            return [(each, spent(setting, each)) for each in (*found, Behaviour(setting.optimal))]

        tried: list[tuple[Behaviour, float]] = setting.once("rounding", every)
        return max(tried, key=lambda each: (each[1] <= regret, -abs(each[1] - regret)))[0]


class WithMemory(MakerSection):
    """A rule that depends on earlier beliefs or decisions, and needs the chain of the belief."""

    name: str

    @classmethod
    def suits(cls, setting: Setting) -> bool:
        """Whether the chain of the belief is known."""
        return setting.chain is not None


class Delay(WithMemory):
    """The optimal decision of some steps ago, with the longest affordable delay in whole steps."""

    name: Literal["delay"]

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return its behaviour with the longest affordable delay."""
        return delayed(setting, regret)


class PartialTrades(WithMemory):
    """A trade of a fixed fraction of the way to the optimal decision at every step."""

    name: Literal["partial trades"]

    @classmethod
    def suits(cls, setting: Setting) -> bool:
        """Whether the chain of the belief is known and decisions can be mixed."""
        return super().suits(setting) and not setting.problem.is_discrete

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return its behaviour with the fraction that spends an expected regret."""
        return partly(setting, regret)


class Sequential(WithMemory):
    """The sequential rule, which depends on the aware observer's law of the belief and hides the belief from it.

    `information_price` is in loss per nat; "infinite": information alone counts. `loss` is the objective: the square error, or
    the loss of the section [rival].
    """

    name: Literal["sequential"]
    information_price: Grid[NonNegative | Literal["infinite"]] | None = None
    loss: Grid[Literal["squared", "rival"]] | None = None

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return its behaviour with the prices that spend an expected regret in the long run."""
        price = chosen.get("information_price")
        price = float("inf") if price == "infinite" else price
        return sequential(setting, regret, seed, price, _loss(setting, chosen))


MAKERS: Mapping[str, type[MakerSection]] = {
    "ODM": Original,
    "CDM": CounterAdversarial,
    "PDM": Probabilistic,
    "uniform": Uniform,
    "exponential": Exponential,
    "Dirichlet noise": Dirichlet,
    "coin": Coin,
    "rounding": Rounding,
    "rate-distortion": RateDistortion,
    "Stackelberg": Stackelberg,
    "delay": Delay,
    "partial trades": PartialTrades,
    "sequential": Sequential,
}
"""All decision makers by their names in files."""


def behave(
    setting: Setting,
    chosen: Chosen,
    limit: Budget | None,
    *,
    regret: float | None = None,
    each: bool = False,
    seed: Seed,
    kinds: Mapping[str, type[MakerSection]] | None = None,
) -> Behaviour | None:
    """Return a decision maker's behaviour at a budget; None if it does not suit the setting.

    Args:
        setting: The setting.
        chosen: Its keys, including the name.
        limit: A budget per belief; None if it takes none.
        regret: Average regret that the budget allows, in the cost's unit, where known.
        each: Whether the budget must hold at every belief. Otherwise the decision maker spends the average in expectation, to
            `tolerances.CALIBRATED` from below, if necessary by scaling its budget per belief; it spends less where nothing more
            private is affordable.
        seed: Seed of the random numbers.
        kinds: All decision makers by name; None: those of the library.
    """
    kind = (MAKERS if kinds is None else kinds)[chosen["name"]]
    if limit is None:
        promise = Budget.regret(0.0) if kind.takes is Takes.NOTHING else None
        return behaviour_of(setting, kind.make(setting, chosen, chosen.get(kind.parameter), seed), promise)
    asked = setting.mean_limit(limit) if regret is None else regret

    def of_budget(budget: Budget) -> Behaviour:
        return behaviour_of(setting, kind.make(setting, chosen, budget, seed), budget if kind.promises else None)

    if kind.takes is Takes.EACH and (each or asked <= 0):
        found: Behaviour | None = of_budget(limit)
    elif kind.takes is Takes.EACH:
        unit = setting.mean_cost if limit.is_relative else 1.0
        found = scaled_to(setting, lambda amount: of_budget(Budget(amount / unit, limit.is_relative)), asked)
    elif asked <= 0 and not issubclass(kind, WithMemory):
        found = Behaviour(setting.optimal)
    else:
        found = kind.spending(setting, chosen, asked, seed)
    return None if found is None else found._replace(asked=asked)


Maker = Callable[[Setting, float], Behaviour | None]
"""Calibrates a decision maker to an expected regret under the prior; None if it does not suit the setting."""


def goal_of(name: str) -> PrivacyMeasure:
    """Return the privacy measure Ψ of a decision maker."""
    if name == "reversed":
        return DesiredObfuscation(reversed_belief)
    kinds: dict[str, type[PrivacyMeasure]] = {
        "maximal": MaximalObfuscation,
        "non-existence": NonExistence,
        "non-uniqueness": NonUniqueness,
        "infeasibility": Infeasibility,
    }
    return kinds[name]()


def reversed_belief(belief: Any) -> Any:
    """Return the belief with the regimes in the opposite order: calm for turbulent."""
    return belief[::-1]


def _loss(setting: Setting, chosen: Chosen) -> Loss | None:
    """Return the objective of a decision maker, by its keys: None for the square error."""
    if chosen.get("loss") != "rival":
        return None
    if setting.loss is None:
        raise InputError(f'a {chosen["name"]} maker with loss = "rival" needs the section [rival], which is missing')
    return setting.loss


def _has_weights(setting: Setting) -> bool:
    return not setting.problem.is_discrete and is_simplex(setting.problem)
