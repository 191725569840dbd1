"""The observers of experiments, one section each, and their results on a mechanism."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field

from inscrutable.adversaries import (
    Adversary,
    BudgetAwareAdversary,
    DataAdversary,
    NaiveAdversary,
    NearOptimalAdversary,
)
from inscrutable.adversaries.data_adversary import LEAST_PAIRS, MOST_PAIRS
from inscrutable.budgets import Budget
from inscrutable.errors import InputError, ModelError
from inscrutable.experiments.comparison_watchers import unwatched, watched
from inscrutable.experiments.guesses import guess_error, guesses_of, naive_privacy, top_state_share
from inscrutable.experiments.sections import Grid, NonNegative, Section
from inscrutable.experiments.setting import Behaviour, Setting
from inscrutable.mechanisms.disclosed import disclosed, single_decisions
from inscrutable.mechanisms.disclosures import Disclosure
from inscrutable.mechanisms.joint import Joint, joint_law
from inscrutable.privacy import Detectability, Leakage, detectability, leakage
from inscrutable.validation import Array

Chosen = Mapping[str, Any]

_DATA_SEED = 20_260_101
"""Seed of the pairs that the observer of data has seen: the same for every decision maker."""

_FOLLOWED_SEED = 20_260_102
"""Seed of the decisions along paths for the aware observer over time."""

NOTHING, MARKET, ALL = "none", "market", "all"
"""An observer's own observations besides decisions; the number of an asset means its return."""


class ObserverReading(NamedTuple):
    """An observer's error and naming given decisions, and without decisions where it knows more than the law of beliefs."""

    error: float  # root mean square, Euclidean, in units of belief
    top_state: float  # probability of naming a most likely state
    prior_error: float | None = None
    prior_top_state: float | None = None


def _written(given: Any) -> str:
    """Return a disclosure, given as text or as a table, as text."""
    try:
        found = Disclosure.of(given)
    except InputError as error:
        raise ValueError(str(error)) from None
    if found.needs_returns:
        raise ValueError(f"{found} shows decisions through returns, which are not known here")
    return str(found)


def _single(text: str) -> str:
    shown = Disclosure.of(text)
    if not shown.schedule.is_immediate:
        raise ValueError(f'{shown} leaves decisions out or delays them, which the observer "sequential" alone reads')
    return str(single_decisions(shown, "an observer of single decisions"))


Pairs = Annotated[int, Field(ge=LEAST_PAIRS, le=MOST_PAIRS)]
"""A number of pairs of belief and decision that an observer has seen."""

DisclosureText = Annotated[str, BeforeValidator(_written)]
"""A disclosure as text, given as such or as a table of operations."""

Shown = Annotated[DisclosureText, AfterValidator(_single)]
"""The disclosure of a single decision, as text: "exact", "at_least(0.05)", or a table of operations."""


class Observed:
    """The measures of a behaviour in a setting, each computed once for all observers.

    Args:
        setting: The setting.
        behaviour: The decision maker's behaviour.
        detects: Whether detectability is measured; its beliefs of least regret then serve the naive observer.
    """

    def __init__(self, setting: Setting, behaviour: Behaviour, *, detects: bool = False) -> None:
        self.setting, self.behaviour, self.detects = setting, behaviour, detects

    @cached_property
    def joint(self) -> Joint:
        """The joint law of belief and decision."""
        return joint_law(self.behaviour.mechanism, self.setting.prior)

    @cached_property
    def played(self) -> Leakage:
        """Cost and leakage of single decisions as draws of a mechanism."""
        return leakage(self.behaviour.mechanism, self.setting.prior, self.setting.problem, loss=self.setting.loss)

    @cached_property
    def leakage(self) -> Leakage:
        """Leakage of single decisions to the aware observer."""
        memory = self.behaviour.memory
        return self.played if memory is None else leakage(memory(1), self.setting.prior, loss=self.setting.loss)

    @cached_property
    def detectability(self) -> Detectability:
        """The detectability of hiding."""
        return detectability(self.behaviour.mechanism, self.setting.prior, self.setting.problem)

    @cached_property
    def naive_privacy(self) -> float:
        """Mean distance of the belief from Π(u) over decisions that some belief explains; NaN without any."""
        return naive_privacy(self.setting.problem, self.behaviour.mechanism.actions, self.joint)

    @property
    def paid(self) -> float:
        """Ratio of the long-run regret to the mechanism's regret: 1, unless a longer simulation is known."""
        play, regret = self.behaviour.play, self.played.expected_regret
        return 1.0 if play is None or not regret > 0 else play.regret / regret

    @property
    def asked(self) -> float:
        """The requested expected regret; the one spent if none was requested."""
        asked = self.behaviour.asked
        return self.played.expected_regret if asked is None else asked

    @property
    def promise(self) -> Budget:
        """The largest regret of any decision, where known."""
        promise = self.behaviour.promise
        return Budget.regret(self.played.worst_regret) if promise is None else promise

    def leakage_shown(self, disclosure: Disclosure) -> Leakage:
        """Return the leakage of parts of single decisions to the aware observer."""
        if disclosure.is_exact:
            return self.leakage
        memory = self.behaviour.memory
        played = self.behaviour.mechanism if memory is None else memory(1)
        return leakage(played, self.setting.prior, disclosure=disclosure, loss=self.setting.loss)

    def knowledge(self, disclosure: Disclosure) -> dict[str, Any]:
        """Return the decisions that a set observer considers under a partial disclosure: played ones and candidates."""
        if disclosure.is_exact:
            return {}
        problem, mechanism = self.setting.problem, self.behaviour.mechanism
        points = np.vstack([problem.as_points(mechanism.actions), self.setting.candidates.actions])
        return {"disclosure": disclosure, "candidates": problem.as_actions(points)}

    def guesses(self, observer: Adversary, disclosure: Disclosure, excuses: Array | None = None) -> Array:
        """Return an observer's estimates (M,X) at every played decision, as disclosed."""
        actions = self.behaviour.mechanism.actions
        return guesses_of(observer, actions if disclosure.is_exact else disclosure.shown(actions), self.joint, excuses)

    def shown(self, chosen: Chosen) -> Disclosure:
        """Return the disclosure of the setting's decisions to an observer, given by its keys.

        Raises:
            ModelError: A partial disclosure of a rule whose decisions are decoded from earlier ones.
        """
        found = Disclosure.of(chosen.get("disclosure")).of_problem(self.setting.problem)
        if self.behaviour.memory is not None and not found.is_exact:
            raise ModelError(f"late and partial trades are read from all decisions as they are, not from {found}")
        return found

    def read_by(self, chosen: Chosen, kinds: Mapping[str, Any] | None = None) -> ObserverReading:
        """Return an observer's results on single decisions; `chosen` has its name and keys, `kinds` all observers by name."""
        found: ObserverReading = (OBSERVERS if kinds is None else kinds)[chosen["name"]].read(self, chosen)
        return found


class ObserverSection(Section):
    """An observer; `disclosure` is the part of a decision that it sees."""

    disclosure: Grid[Shown] | None = None

    @staticmethod
    def adversary(observed: Observed, chosen: Chosen) -> Adversary:
        """Return the observer with its knowledge of the decision maker."""
        raise NotImplementedError

    @classmethod
    def read(cls, observed: Observed, chosen: Chosen) -> ObserverReading:
        """Return its results on single decisions."""
        guesses = observed.guesses(cls.adversary(observed, chosen), observed.shown(chosen))
        return ObserverReading(guess_error(observed.joint, guesses), top_state_share(observed.joint, guesses))


class Naive(ObserverSection):
    """Takes every decision for optimal."""

    name: Literal["naive"]

    @classmethod
    def read(cls, observed: Observed, chosen: Chosen) -> ObserverReading:
        """Return its results on single decisions."""
        shown = observed.shown(chosen)
        excuses = observed.detectability.excuses if observed.detects and shown.is_exact else None
        reader = NaiveAdversary(observed.setting.problem, **observed.knowledge(shown))
        guesses = observed.guesses(reader, shown, excuses)
        return ObserverReading(guess_error(observed.joint, guesses), top_state_share(observed.joint, guesses))


class NearOptimal(ObserverSection):
    """Allows a regret, by default the one that the decision maker spends; knows the law of beliefs."""

    name: Literal["near-optimal"]
    regret: Grid[NonNegative] | None = None

    @staticmethod
    def adversary(observed: Observed, chosen: Chosen) -> Adversary:
        """Return it."""
        allowed = chosen.get("regret", observed.asked)
        known = observed.knowledge(observed.shown(chosen))
        return NearOptimalAdversary(observed.setting.problem, allowed, prior=observed.setting.prior, **known)


class BudgetAware(ObserverSection):
    """Knows the largest regret of any decision and the law of beliefs."""

    name: Literal["budget-aware"]

    @staticmethod
    def adversary(observed: Observed, chosen: Chosen) -> Adversary:
        """Return it."""
        known = observed.knowledge(observed.shown(chosen))
        return BudgetAwareAdversary(observed.setting.problem, observed.promise, prior=observed.setting.prior, **known)


class Bayesian(ObserverSection):
    """Knows the mechanism and the law of beliefs."""

    name: Literal["bayesian"]

    @classmethod
    def read(cls, observed: Observed, chosen: Chosen) -> ObserverReading:
        """Return its results on single decisions."""
        found = observed.leakage_shown(observed.shown(chosen))
        return ObserverReading(found.bayes_error, found.top_state_accuracy)


class Data(ObserverSection):
    """Knows neither costs nor rule nor the law of beliefs, but has seen a number of pairs of belief and decision."""

    name: Literal["data"]
    pairs: Grid[Pairs] = (1000,)

    @staticmethod
    def adversary(observed: Observed, chosen: Chosen) -> Adversary:
        """Return it; the same pairs at every call."""
        rng = np.random.default_rng(_DATA_SEED)
        played = disclosed(observed.behaviour.mechanism, observed.shown(chosen))
        return DataAdversary.of(played, observed.setting.prior, chosen.get("pairs", 1000), rng=rng)


class SequentialObserver(ObserverSection):
    """Knows the mechanism and the chain of the belief, and filters the belief over all decisions of a path; needs [beliefs] of
    kind "stationary". `disclosure` may include a schedule, such as "every(3)|delayed(2)". `public` is its own observation at
    every step: "none", "market" (the mean of the assets' returns, or of the farms' outputs), "all" of them, or that of one
    asset or farm, by its number from 0."""

    name: Literal["sequential"]
    disclosure: Grid[DisclosureText] | None = None
    public: Grid[Literal["none", "market", "all"] | Annotated[int, Field(ge=0)]] | None = None

    @classmethod
    def read(cls, observed: Observed, chosen: Chosen) -> ObserverReading:
        """Return its results on all decisions so far."""
        setting, behaviour = observed.setting, observed.behaviour
        shown, public = observed.shown(chosen), chosen.get("public", NOTHING)
        if setting.chain is None:
            raise InputError("an observer that follows the belief needs beliefs that move: of kind stationary")
        if public == ALL:  # an observer with all of the agent's observations and its model knows its belief
            return ObserverReading(0.0, 1.0, 0.0, 1.0)
        beside = None
        if public != NOTHING:
            make = setting.read
            if make is None:
                raise InputError(f"public = {public!r} needs returns that the agent observes")
            beside = setting.once(("read", public), lambda: make(public))
        if behaviour.play is not None and (beside is not None or str(shown) != str(setting.disclosure)):
            raise ModelError(
                f"the sequential rule is made for an observer of {setting.disclosure} decisions who reads nothing beside: "
                "another's law of the belief is not followed"
            )
        single = observed.leakage_shown(Disclosure(shown.maps)).bayes_error
        found = watched(setting, behaviour, single, np.random.default_rng(_FOLLOWED_SEED), shown, beside)
        if beside is None:
            return ObserverReading(found.error, found.top_state)
        return ObserverReading(found.error, found.top_state, *unwatched(setting, beside, shown))


OBSERVERS: Mapping[str, type[ObserverSection]] = {
    "naive": Naive,
    "near-optimal": NearOptimal,
    "budget-aware": BudgetAware,
    "bayesian": Bayesian,
    "data": Data,
    "sequential": SequentialObserver,
}
"""All observers by their names in files."""
