"""The decision makers of a study by name, each made to spend a budget."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from inscrutable.budgets import Budget
from inscrutable.decision_makers import (
    Candidates,
    CounterAdversarialDecisionMaker,
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
    calibrate,
)
from inscrutable.experiments.comparison_makers import CandidateDecisionMaker
from inscrutable.mechanisms import Mechanism, Prior, mechanism
from inscrutable.privacy import (
    DesiredObfuscation,
    Infeasibility,
    MaximalObfuscation,
    NonExistence,
    NonUniqueness,
    PrivacyMeasure,
)
from inscrutable.privacy.leaks import silence_regret
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_MOST_SCALED = 50.0
"""Largest factor by which a budget per belief is raised so that its expected regret is the one asked for."""
_EPSILONS = (0.001, 10_000.0)
"""Range of ε times the regret to spend: from all but uniform to all but optimal."""
_CONCENTRATIONS = (0.1, 1_000_000.0)
_MOST_STEPS = 1000
"""The finest rounding tried is to a thousandth."""


@dataclass(frozen=True, eq=False)
class StudySetting:
    """What every decision maker of a market starts from."""

    problem: DecisionProblem
    prior: Prior
    candidates: Candidates

    @cached_property
    def optimal_costs(self) -> Array:
        """c* of every belief, shape (B,)."""
        return np.atleast_1d(np.asarray(self.problem.optimal_cost(self.prior.beliefs), dtype=np.float64))

    @cached_property
    def mean_cost(self) -> float:
        """E|c*|, in the cost's unit."""
        return float(self.prior.weights @ np.abs(self.optimal_costs))

    @cached_property
    def silence(self) -> float:
        """The silence regret r₀, in the cost's unit."""
        return silence_regret(self.problem, self.prior.beliefs, self.prior.weights)

    def budget(self, data: Mapping[str, Any]) -> Budget:
        """Return the budget per belief that a study means."""
        unit = {"relative": 1.0, "regret": 1.0, "silence": self.silence, "cost": self.mean_cost}[data["unit"]]
        return Budget(unit * data["amount"], data["unit"] == "relative")

    def mean_limit(self, budget: Budget) -> float:
        """Return what a budget per belief allows on average, in the cost's unit."""
        return float(self.prior.weights @ budget.limits(self.optimal_costs))


class StudyPlay(NamedTuple):
    """A mechanism and what is known of its regret."""

    mechanism: Mechanism
    asked: float | None
    """The expected regret asked for, in the cost's unit; None where none was."""
    promise: Budget | None = None
    """The largest regret of any decision; None where only an expectation is promised."""


Maker = Callable[[float], Any]


class _Family(NamedTuple):
    """Decision makers that differ in one number, and the range in which the right one is looked for."""

    make: Maker
    low: float
    high: float


def play(setting: StudySetting, maker: Mapping[str, Any], budget: Mapping[str, Any] | None, *, seed: Seed) -> StudyPlay:
    """Return what a decision maker plays on the beliefs of a setting when it spends a budget."""
    name = maker["name"]
    if budget is None:
        return _played(setting, _WITHOUT_BUDGET[name](setting, maker, seed), None)
    limit = setting.budget(budget)
    asked = setting.mean_limit(limit)
    if name in _PER_BELIEF and (budget["hold"] == "each" or asked <= 0):
        promise = None if name in _PROMISES_NOTHING else limit
        return _played(setting, _PER_BELIEF[name](setting, maker, limit, seed), asked, promise)
    if asked <= 0:
        return _played(setting, OriginalDecisionMaker(setting.problem), asked)
    if name in _IN_EXPECTATION:
        make = _IN_EXPECTATION[name]
        found = make(setting.problem, Budget.regret(asked), prior=setting.prior, candidates=setting.candidates)
        return _played(setting, found, asked)
    family = _FAMILIES[name](setting, maker, asked, seed) if name in _FAMILIES else _scaled(setting, maker, limit, seed)
    spent = calibrate(family.make, asked, setting.prior, family.low, family.high)
    return _played(setting, spent.decision_maker, asked)


def _played(
    setting: StudySetting, decision_maker: Any, asked: float | None, promise: Budget | None = None
) -> StudyPlay:
    return StudyPlay(mechanism(decision_maker, setting.prior.beliefs), asked, promise)


Seed = Callable[[], np.random.Generator]
"""Gives the same random stream at every call."""


def _scaled(setting: StudySetting, maker: Mapping[str, Any], limit: Budget, seed: Seed) -> _Family:
    make = _PER_BELIEF[maker["name"]]
    return _Family(
        lambda factor: make(setting, maker, Budget(factor * limit.amount, limit.is_relative), seed), 0.0, _MOST_SCALED
    )


def _counter_adversarial(setting: StudySetting, maker: Mapping[str, Any], budget: Budget, seed: Seed) -> Any:
    if maker["method"] == "candidates":
        return CandidateDecisionMaker(setting.problem, budget, setting.candidates)
    method = LocalSearch(maker["starts"], seed()) if maker["method"] == "local" else None
    candidates = None if maker["method"] == "local" else setting.candidates
    goal = goal_of(maker["goal"])
    return CounterAdversarialDecisionMaker(setting.problem, goal, budget, candidates=candidates, method=method)


def _probabilistic(setting: StudySetting, maker: Mapping[str, Any], budget: Budget, seed: Seed) -> Any:
    if maker["method"] == "candidates":
        return CandidateDecisionMaker(setting.problem, budget, setting.candidates, mixes=True)
    goal = goal_of(maker["goal"])
    return ProbabilisticDecisionMaker(setting.problem, goal, budget, candidates=setting.candidates)


def _stackelberg(setting: StudySetting, maker: Mapping[str, Any], budget: Budget, seed: Seed) -> Any:
    prior, candidates, gap = setting.prior, setting.candidates, maker.get("gap")
    return StackelbergDecisionMaker(setting.problem, budget, prior=prior, candidates=candidates, gap=gap)


def _uniform(setting: StudySetting, maker: Mapping[str, Any], budget: Budget, seed: Seed) -> Any:
    return UniformDecisionMaker(setting.problem, budget, candidates=setting.candidates)


def _exponential(setting: StudySetting, maker: Mapping[str, Any], asked: float, seed: Seed) -> _Family:
    low, high = (bound / asked for bound in _EPSILONS)
    return _Family(
        lambda epsilon: ExponentialDecisionMaker(setting.problem, epsilon, candidates=setting.candidates), low, high
    )


def _dirichlet(setting: StudySetting, maker: Mapping[str, Any], asked: float, seed: Seed) -> _Family:
    def make(concentration: float) -> Any:
        return DirichletDecisionMaker(
            setting.problem,
            concentration,
            rng=seed(),
            candidates=setting.candidates,
            n_draws=maker["draws"],
        )

    return _Family(make, *_CONCENTRATIONS)


def _coin(setting: StudySetting, maker: Mapping[str, Any], asked: float, seed: Seed) -> _Family:
    decoy = setting.prior.mean
    return _Family(lambda share: CoinDecisionMaker(setting.problem, share, decoy), 0.0, 1.0)


def _rounding(setting: StudySetting, maker: Mapping[str, Any], asked: float, seed: Seed) -> _Family:
    return _Family(lambda steps: RoundingDecisionMaker(setting.problem, 1.0 / round(steps)), 1.0, float(_MOST_STEPS))


def _alone(parameter: str, family: Callable[..., _Family]) -> Callable[[StudySetting, Mapping[str, Any], Seed], Any]:
    """A decision maker whose parameter is given, so that it takes no budget."""
    return lambda setting, maker, seed: family(setting, maker, 1.0, seed).make(maker[parameter])


def _original(setting: StudySetting, maker: Mapping[str, Any], seed: Seed) -> Any:
    return OriginalDecisionMaker(setting.problem)


def _rounded(setting: StudySetting, maker: Mapping[str, Any], seed: Seed) -> Any:
    return RoundingDecisionMaker(setting.problem, maker["step"])


_PER_BELIEF: Mapping[str, Callable[[StudySetting, Mapping[str, Any], Budget, Seed], Any]] = {
    "CDM": _counter_adversarial,
    "PDM": _probabilistic,
    "uniform": _uniform,
    "Stackelberg": _stackelberg,
}
"""Those whose budget is one per belief."""

_PROMISES_NOTHING = ("PDM", "Stackelberg")
"""Those of them whose budget holds in expectation, not for every decision."""

_IN_EXPECTATION: Mapping[str, Callable[..., Any]] = {"rate-distortion": RateDistortionDecisionMaker}
"""Those whose budget holds in expectation over the law of beliefs, which they know."""

_FAMILIES: Mapping[str, Callable[[StudySetting, Mapping[str, Any], float, Seed], _Family]] = {
    "exponential": _exponential,
    "Dirichlet noise": _dirichlet,
    "coin": _coin,
    "rounding": _rounding,
}
"""Those with a parameter in place of a budget."""

_WITHOUT_BUDGET: Mapping[str, Callable[[StudySetting, Mapping[str, Any], Seed], Any]] = {
    "ODM": _original,
    "exponential": _alone("epsilon", _exponential),
    "Dirichlet noise": _alone("concentration", _dirichlet),
    "coin": _alone("probability", _coin),
    "rounding": _rounded,
}
"""Those that are told all they need."""


def goal_of(name: str) -> PrivacyMeasure:
    """Return the privacy measure Ψ that a decision maker seeks."""
    if name == "reversed":
        return DesiredObfuscation(_reversed)
    kinds: dict[str, type[PrivacyMeasure]] = {
        "maximal": MaximalObfuscation,
        "non-existence": NonExistence,
        "non-uniqueness": NonUniqueness,
        "infeasibility": Infeasibility,
    }
    return kinds[name]()


def _reversed(belief: Any) -> Any:
    """The belief with the regimes in the opposite order."""
    return belief[::-1]
