"""The observers of every experiment, one section each, and what they make of a mechanism."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Literal, NamedTuple

from inscrutable.adversaries import Adversary, BudgetAwareAdversary, NaiveAdversary, NearOptimalAdversary
from inscrutable.budgets import Budget
from inscrutable.experiments.guesses import guess_error, guesses_of, naive_privacy, top_state_share
from inscrutable.experiments.sections import Grid, NonNegative, Section
from inscrutable.experiments.setting import Behaviour, Setting
from inscrutable.mechanisms.joint import Joint, joint_law
from inscrutable.privacy import Detectability, Leakage, detectability, leakage

Chosen = Mapping[str, Any]


class ObserverReading(NamedTuple):
    """What an observer makes of single decisions."""

    error: float  # root mean square, Euclidean, in units of belief
    top_state: float  # how often a most likely state is named


class Observed:
    """What a decision maker does in a setting, measured once however many observers and measures ask.

    Args:
        setting: The setting.
        behaviour: What it does.
        detects: Whether it is asked anyway by which belief each decision is excused; the naive observer then knows.
    """

    def __init__(self, setting: Setting, behaviour: Behaviour, *, detects: bool = False) -> None:
        self.setting, self.behaviour, self.detects = setting, behaviour, detects

    @cached_property
    def joint(self) -> Joint:
        """The joint law of belief and decision."""
        return joint_law(self.behaviour.mechanism, self.setting.prior)

    @cached_property
    def played(self) -> Leakage:
        """What single decisions cost, and tell one who takes them for draws of a mechanism."""
        return leakage(self.behaviour.mechanism, self.setting.prior, self.setting.problem, loss=self.setting.loss)

    @cached_property
    def leakage(self) -> Leakage:
        """What single decisions tell one who knows the rule."""
        memory = self.behaviour.memory
        return self.played if memory is None else leakage(memory(1), self.setting.prior, loss=self.setting.loss)

    @cached_property
    def detectability(self) -> Detectability:
        """Whether it is seen that something is hidden."""
        return detectability(self.behaviour.mechanism, self.setting.prior, self.setting.problem)

    @cached_property
    def naive_privacy(self) -> float:
        """Mean distance of the belief from Π(u) over decisions that some belief explains; NaN without any."""
        return naive_privacy(self.setting.problem, self.behaviour.mechanism.actions, self.joint)

    @property
    def asked(self) -> float:
        """The expected regret asked for; the one spent, where none was."""
        asked = self.behaviour.asked
        return self.played.expected_regret if asked is None else asked

    @property
    def promise(self) -> Budget:
        """The largest regret of any decision, as far as it is known."""
        promise = self.behaviour.promise
        return Budget.regret(self.played.worst_regret) if promise is None else promise

    def read_by(self, chosen: Chosen) -> ObserverReading:
        """Return what an observer, by name and keys, makes of single decisions."""
        return OBSERVERS[chosen["name"]].read(self, chosen)


class ObserverSection(Section):
    """An observer."""

    @staticmethod
    def adversary(observed: Observed, chosen: Chosen) -> Adversary:
        """Return it, with what it knows of the decision maker."""
        raise NotImplementedError

    @classmethod
    def read(cls, observed: Observed, chosen: Chosen) -> ObserverReading:
        """Return what it makes of single decisions."""
        actions, joint = observed.behaviour.mechanism.actions, observed.joint
        guesses = guesses_of(cls.adversary(observed, chosen), actions, joint)
        return ObserverReading(guess_error(joint, guesses), top_state_share(joint, guesses))


class Naive(ObserverSection):
    """Takes every decision for optimal."""

    name: Literal["naive"]

    @classmethod
    def read(cls, observed: Observed, chosen: Chosen) -> ObserverReading:
        """Return what it makes of single decisions."""
        excuses = observed.detectability.excuses if observed.detects else None
        actions, joint = observed.behaviour.mechanism.actions, observed.joint
        guesses = guesses_of(NaiveAdversary(observed.setting.problem), actions, joint, excuses)
        return ObserverReading(guess_error(joint, guesses), top_state_share(joint, guesses))


class NearOptimal(ObserverSection):
    """Allows for a regret, which else is the one the decision maker spends; knows the law of beliefs."""

    name: Literal["near-optimal"]
    regret: Grid[NonNegative] | None = None

    @staticmethod
    def adversary(observed: Observed, chosen: Chosen) -> Adversary:
        """Return it."""
        allowed = chosen.get("regret", observed.asked)
        return NearOptimalAdversary(observed.setting.problem, allowed, prior=observed.setting.prior)


class BudgetAware(ObserverSection):
    """Knows the largest regret that any decision has; knows the law of beliefs."""

    name: Literal["budget-aware"]

    @staticmethod
    def adversary(observed: Observed, chosen: Chosen) -> Adversary:
        """Return it."""
        return BudgetAwareAdversary(observed.setting.problem, observed.promise, prior=observed.setting.prior)


class Bayesian(ObserverSection):
    """Knows the mechanism and the law of beliefs."""

    name: Literal["bayesian"]

    @classmethod
    def read(cls, observed: Observed, chosen: Chosen) -> ObserverReading:
        """Return what it makes of single decisions."""
        return ObserverReading(observed.leakage.bayes_error, observed.leakage.top_state_accuracy)


OBSERVERS: Mapping[str, type[ObserverSection]] = {
    "naive": Naive,
    "near-optimal": NearOptimal,
    "budget-aware": BudgetAware,
    "bayesian": Bayesian,
}
"""Every observer of single decisions by the name that files give it."""
