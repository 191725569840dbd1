"""The decision makers of every experiment, one section each: its keys, how it is made, and what it takes for a budget.

The first line of a section's documentation is what reports and documents say of it.
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
"""Weights in multiples of 1/n, for these n."""

Goal = Literal["maximal", "reversed", "non-existence", "non-uniqueness", "infeasibility"]
Chosen = Mapping[str, Any]
"""A section's keys with one value each."""
_Hiding = TypeVar("_Hiding", bound="CounterAdversarial | Probabilistic")


class Takes(Enum):
    """What a decision maker takes for a budget."""

    NOTHING = "none: it always plays the same"
    EACH = "one per belief"
    MEAN = "an expected regret"


class MakerSection(Section):
    """A decision maker.

    Class attributes:
        takes: What it takes for a budget.
        promises: Whether a budget per belief holds for every decision, not only in expectation.
        parameter: The key that, where it is given, stands in place of a budget.
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
        """Return what it does when it spends an expected regret above 0; None where it does not suit the setting."""
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
    """A decision maker that seeks a privacy measure Ψ; `own` are those of a user's own, by name."""

    takes = Takes.EACH
    own: ClassVar[Mapping[str, Callable[[], PrivacyMeasure]]] = {}

    @classmethod
    def goal_of(cls, chosen: Chosen) -> PrivacyMeasure:
        """Return the measure that it seeks."""
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
    """The most private lottery that is affordable in expectation: over all decisions, over candidates alone, or by the
    paper's linear programme over candidates."""

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
    """One of the affordable candidates, all equally likely."""

    takes, promises = Takes.EACH, True
    name: Literal["uniform"]

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with a budget per belief."""
        return UniformDecisionMaker(setting.problem, amount, candidates=setting.candidates)


class Stackelberg(MakerSection):
    """The committed mechanism that maximises the aware observer's error, with a budget per belief; `gap` is the proof's,
    `loss` what is made large: the square error, or the loss of the section [rival]."""

    takes = Takes.EACH
    name: Literal["Stackelberg"]
    gap: Grid[Annotated[float, Field(gt=0, lt=1)]] | None = None
    loss: Grid[Literal["squared", "rival"]] | None = None

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with a budget per belief; against the loss of the setting's rival where that is asked for."""
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
    """A decision maker whose expected regret grows about as its amount of noise."""

    @classmethod
    def of_noise(cls, setting: Setting, amount: float) -> float:
        """Return its parameter for an amount of noise, in the cost's unit."""
        raise NotImplementedError

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return what it does with as much noise as spends an expected regret."""

        def tried(amount: float) -> Behaviour:
            return behaviour_of(setting, cls.make(setting, chosen, cls.of_noise(setting, amount), seed))

        return scaled_to(setting, tried, regret)


class Exponential(_Noise):
    """The exponential mechanism: candidates, the likelier the cheaper; without epsilon it is made to spend the budget."""

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
    """Dirichlet noise on the weights; without a concentration it is made to spend the budget."""

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
        """Return it with a concentration: the same noise in every trial, so that the regret moves with that alone."""
        drawn = {"rng": seed(), "n_draws": chosen.get("draws", 1000)}
        return DirichletDecisionMaker(setting.problem, amount, candidates=setting.candidates, **drawn)


class Coin(MakerSection):
    """The best constant decision with some probability, which else is what spends the budget; or the optimal one."""

    parameter = "probability"
    name: Literal["coin"]
    probability: Grid[Probability] | None = None

    @staticmethod
    def make(setting: Setting, chosen: Chosen, amount: Any, seed: Seed) -> Any:
        """Return it with a probability."""
        return CoinDecisionMaker(setting.problem, amount, decoy=setting.prior.mean)

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return what it does with the probability that spends an expected regret, which is r₀ times that."""
        silent = setting.silence_regret
        share = min(regret / silent, 1.0) if silent > 0 else 0.0
        return behaviour_of(setting, cls.make(setting, chosen, share, seed))


class Rounding(MakerSection):
    """The optimal decision in whole steps, which else are the coarsest that the budget affords."""

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
        """Return what it does with the steps in use whose expected regret is nearest below one; else no rounding."""

        def every() -> list[tuple[Behaviour, float]]:
            found = [behaviour_of(setting, cls.make(setting, chosen, 1.0 / steps, seed)) for steps in _ROUNDINGS]
            return [(each, spent(setting, each)) for each in (*found, Behaviour(setting.optimal))]

        tried: list[tuple[Behaviour, float]] = setting.once("rounding", every)
        return max(tried, key=lambda each: (each[1] <= regret, -abs(each[1] - regret)))[0]


class WithMemory(MakerSection):
    """A rule that decides by what came before, and needs to be known on a belief that moves."""

    name: str

    @classmethod
    def suits(cls, setting: Setting) -> bool:
        """Whether it is known how the belief moves."""
        return setting.chain is not None


class Delay(WithMemory):
    """The optimal decision of some steps ago, for the most whole steps that are affordable."""

    name: Literal["delay"]

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return what it does with the longest affordable delay."""
        return delayed(setting, regret)


class PartialTrades(WithMemory):
    """A fraction of the way to the optimal decision at every step."""

    name: Literal["partial trades"]

    @classmethod
    def suits(cls, setting: Setting) -> bool:
        """Whether it is known how the belief moves, and there is something between two decisions."""
        return super().suits(setting) and not setting.problem.is_discrete

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return what it does with the fraction that spends an expected regret."""
        return partly(setting, regret)


class Sequential(WithMemory):
    """The sequential rule, which decides by the law of the observer who follows it, for its error or its information.

    `information_price` is in loss per nat, "infinite" where information alone counts; `loss` is what is made large: the square
    error, or the loss of the section [rival]."""

    name: Literal["sequential"]
    information_price: Grid[NonNegative | Literal["infinite"]] | None = None
    loss: Grid[Literal["squared", "rival"]] | None = None

    @classmethod
    def spending(cls, setting: Setting, chosen: Chosen, regret: float, seed: Seed) -> Behaviour | None:
        """Return what it does with the prices that spend an expected regret in the long run."""
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
"""Every decision maker by the name that files give it."""


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
    """Return what a decision maker does when it spends a budget; None where it does not suit the setting.

    Args:
        setting: What it decides on.
        chosen: Its keys, the name among them.
        limit: A budget per belief; None for one that takes none.
        regret: What the budget allows on average, in the cost's unit, where that is known.
        each: Whether the budget is to hold at every belief. Else what it allows on average is spent in expectation, to
            `tolerances.CALIBRATED` from below, by one with a budget per belief by scaling that; one that finds nothing more
            private spends less.
        seed: The stream of random numbers.
        kinds: Every decision maker by its name; None is those of the library.
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
"""Makes a decision maker spend an expected regret under the prior, as nearly as it can; None where it does not suit."""


def goal_of(name: str) -> PrivacyMeasure:
    """Return the privacy measure Ψ that a decision maker seeks."""
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
    """What a maker makes large, by its keys: None for the square error."""
    if chosen.get("loss") != "rival":
        return None
    if setting.loss is None:
        raise InputError(f'a {chosen["name"]} maker with loss = "rival" needs the section [rival], which is missing')
    return setting.loss


def _has_weights(setting: Setting) -> bool:
    return not setting.problem.is_discrete and is_simplex(setting.problem)
