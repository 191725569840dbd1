"""What decision makers start from in an experiment, and the result of one: a mechanism, with its regret and its guarantee."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from inscrutable.budgets import Budget
from inscrutable.decision_makers import Candidates, OriginalDecisionMaker, decoy_grid
from inscrutable.decision_makers.baselines.calibration import spending
from inscrutable.errors import InputError
from inscrutable.geometry.grids import grid_size
from inscrutable.mechanisms import Disclosure, Mechanism, Prior, mechanism
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.played import PlaysMany
from inscrutable.mechanisms.priors import checked_prior
from inscrutable.privacy import Loss
from inscrutable.privacy.leaks import silence_regret
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array

_CLEAR_OF_ZERO = 0.01
"""Least |c*| as a share of its mean from which a share of |c*| is a budget at every belief."""

Seed = Callable[[], np.random.Generator]
"""Gives the same random stream at every call."""


@dataclass(frozen=True, eq=False)
class Setting:
    """A problem, the law of the private belief, decisions to choose from, and how the belief moves where that is known.

    `loss` is the rival's loss; None is the square error. `disclosure` is how decisions become public, for
    rules that go by it. `read` gives the same chain with tables of what one reads who follows "market", or an asset by its
    number.
    """

    problem: DecisionProblem
    prior: Prior
    candidates: Candidates
    chain: BeliefChain | None = None
    loss: Loss | None = None
    disclosure: Disclosure = Disclosure()  # noqa: RUF009  # frozen
    read: Callable[[str | int], BeliefChain] | None = None
    kept: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, problem: DecisionProblem, given: Prior | BeliefChain, candidates: Candidates | None = None) -> Setting:
        """Return the setting of a prior or a chain; without candidates a grid of about as many decoys as beliefs."""
        chain = given if isinstance(given, BeliefChain) else None
        n_states = checked_problem(problem).n_states
        prior = checked_prior(given if chain is None else chain.prior, n_states)
        if candidates is None:
            resolution = 1
            while n_states > 1 and grid_size(n_states, resolution) < len(prior):
                resolution += 1
            candidates = decoy_grid(problem, resolution)
        elif not isinstance(candidates, Candidates) or candidates.problem is not problem:
            raise InputError("candidates must be Candidates of this problem, such as decoy_grid(problem, 30)")
        return cls(problem, prior, candidates, chain)

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return what `make` gives, made once for a key."""
        if key not in self.kept:
            self.kept[key] = make()
        return self.kept[key]

    @cached_property
    def optimal_costs(self) -> Array:
        """c* of every belief of the prior, shape (B,)."""
        return np.atleast_1d(np.asarray(self.problem.optimal_cost(self.prior.beliefs), dtype=np.float64))

    @cached_property
    def mean_cost(self) -> float:
        """E|c*| under the prior, in the cost's unit."""
        return float(self.prior.weights @ np.abs(self.optimal_costs))

    @cached_property
    def silence_regret(self) -> float:
        """The silence regret r₀, in the cost's unit."""
        return silence_regret(self.problem, self.prior.beliefs, self.prior.weights)

    @cached_property
    def is_relative(self) -> bool:
        """Whether budgets per belief are shares of |c*|: c* stays clear of zero wherever the prior has weight."""
        least = float(np.abs(self.optimal_costs[self.prior.weights > 0]).min())
        return least >= _CLEAR_OF_ZERO * self.mean_cost > 0

    @cached_property
    def optimal(self) -> Mechanism:
        """The optimal decisions."""
        return mechanism(OriginalDecisionMaker(self.problem), self.prior.beliefs)

    def budget(self, amount: float) -> Budget:
        """Return the budget per belief whose limits are `amount` on average over the prior, in the cost's unit."""
        return Budget.relative(amount / self.mean_cost) if self.is_relative else Budget.regret(amount)

    def budget_of(self, chosen: Mapping[str, Any]) -> Budget:
        """Return the budget per belief that a study's section means by an amount and a unit."""
        return Budget(self.unit(chosen["unit"]) * chosen["amount"], chosen["unit"] == "relative")

    def unit(self, name: str) -> float:
        """Return what amounts are counted in, in the cost's unit; of one that is relative to |c*|, 1."""
        return {"silence": self.silence_regret, "cost": self.mean_cost}.get(name, 1.0)

    def mean_limit(self, budget: Budget) -> float:
        """Return what a budget per belief allows on average, in the cost's unit."""
        return float(self.prior.weights @ budget.limits(self.optimal_costs))


def path_prior(beliefs: Array) -> Prior:
    """Return the law of beliefs (T,X) of which each step weighs the same."""
    points, met = np.unique(beliefs, axis=0, return_counts=True)
    return Prior(points, met / met.sum())


class Memory(Protocol):
    """How the aware observer reads the decisions of a rule with a memory, and what the rule publishes along a path."""

    @property
    def decided(self) -> tuple[Mechanism, int]:
        """The mechanism that decisions come from once they are read, and of how many steps ago the belief behind them is."""

    def __call__(self, n: int) -> Mechanism:
        """Return what n decisions on one belief amount to, as a mechanism."""

    def published(self, path: np.ndarray) -> Array:
        """Return the decisions (T,U) along a path of beliefs, given as places (T,) in the prior."""


class Watched(NamedTuple):
    """The error of the aware observer over time; NaN where that is not known."""

    error: float = float("nan")  # root mean square
    error_se: float = float("nan")
    top_state: float = float("nan")  # how often that one names a most likely state
    bits: float = float("nan")  # what a decision adds
    bits_se: float = float("nan")
    ceiling: float = float("nan")  # an error that no rule of the same regret exceeds
    error_half: float = float("nan")  # where beliefs stay half as long as the rule takes them to
    error_double: float = float("nan")  # where they stay twice as long


class Repeated(NamedTuple):
    """Figures after each number of decisions on one belief, each (S,)."""

    errors: Array
    error_se: Array
    information: Array
    top_state: Array
    regret: float = float("nan")  # expected, over all of them; NaN where it is that of the mechanism


class Play(Protocol):
    """What a rule does whose mechanism changes with what the observer holds, as far as it was simulated."""

    @property
    def regret(self) -> float:
        """The expected regret in the long run, in the cost's unit, of more steps than `mechanism` is averaged over."""

    @property
    def watched(self) -> Watched:
        """The error of the aware observer over time."""

    def repeated(self, steps: tuple[int, ...], *, told: bool) -> Repeated:
        """Return the leakage of decisions on one belief; `told`: the rule knows that it stays, as the observer does."""

    def published(self, path: np.ndarray) -> Array:
        """Return the decisions (T,U) along a path of beliefs, given as places (T,) in the prior."""


class Behaviour(NamedTuple):
    """A mechanism that spends what was asked for, as nearly as it can, and what it promises of every single decision."""

    mechanism: Mechanism
    promise: Budget | None = None
    """The largest regret of any decision it makes; None where only an expectation is promised."""
    memory: Memory | None = None
    """How the aware observer reads it, where it has a memory; None: each decision is a draw of `mechanism`."""
    strength: float = float("nan")
    """What was set so that the regret is spent: steps of a delay, the fraction traded; NaN for others."""
    asked: float | None = None
    """The expected regret asked for, in the cost's unit; None where none was."""
    play: Play | None = None
    """What the rule does where its mechanism changes; `mechanism` is then that of the long run, for single decisions."""


def behaviour_of(setting: Setting, decision_maker: PlaysMany, promise: Budget | None = None) -> Behaviour:
    """Return what a decision maker does on the prior's beliefs; one that solved for the prior has its mechanism ready."""
    known = getattr(decision_maker, "mechanism", None)
    return Behaviour(
        known if isinstance(known, Mechanism) else mechanism(decision_maker, setting.prior.beliefs), promise
    )


def scaled_to(setting: Setting, tried: Callable[[float], Behaviour], regret: float) -> Behaviour:
    """Return the trial whose expected regret is the one asked for, or the nearest below it; it grows with the amount."""
    return spending(tried, lambda behaviour: spent(setting, behaviour), regret)


def spent(setting: Setting, behaviour: Behaviour) -> float:
    """Return the expected regret of a mechanism on the prior's beliefs, in the cost's unit."""
    return float(setting.prior.weights @ behaviour.mechanism.expected_regrets)
