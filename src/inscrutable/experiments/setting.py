"""The setting of decision makers in an experiment, and a decision maker's behaviour: mechanism, regret and guarantee."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from inscrutable.budgets import Budget
from inscrutable.decision_makers import Candidates, OriginalDecisionMaker, decoy_grid
from inscrutable.decision_makers.baselines.calibration import spending
from inscrutable.decision_makers.candidate_sources import decided_by
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
"""Least |c*|, as a share of its mean, at which shares of |c*| are used as budgets per belief."""

Seed = Callable[[], np.random.Generator]
"""Function that returns the same random stream at every call."""


@dataclass(frozen=True, eq=False)
class Setting:
    """A problem, the law of the private belief, candidate decisions, and the chain of the belief where known.

    `loss` is the rival's loss; None is the squared error. `disclosure` is how decisions become public, for rules that use it.
    `read` returns the same chain with tables of the observations of "market", or of an asset by its number.
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
        """Return the setting of a prior or a chain; the default candidates are a grid of about as many decoys as beliefs
        and the best constant decision."""
        chain = given if isinstance(given, BeliefChain) else None
        n_states = checked_problem(problem).n_states
        prior = checked_prior(given if chain is None else chain.prior, problem)
        if candidates is None:
            resolution = 1
            while n_states > 1 and grid_size(n_states, resolution) < len(prior):
                resolution += 1
            candidates = _with_silence(decoy_grid(problem, resolution), prior)
        elif not isinstance(candidates, Candidates) or candidates.problem is not problem:
            raise InputError("candidates must be Candidates of this problem, such as decoy_grid(problem, 30)")
        return cls(problem, prior, candidates, chain)

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return the value of `make`, computed once per key."""
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
        """Whether budgets per belief are shares of |c*|: c* is far from zero wherever the prior has weight."""
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
        """Return the budget per belief of a study's amount and unit."""
        return Budget(self.unit(chosen["unit"]) * chosen["amount"], chosen["unit"] == "relative")

    def unit(self, name: str) -> float:
        """Return the unit of amounts, in the cost's unit; 1 for amounts relative to |c*|."""
        return {"silence": self.silence_regret, "cost": self.mean_cost}.get(name, 1.0)

    def mean_limit(self, budget: Budget) -> float:
        """Return the average limit of a budget per belief, in the cost's unit."""
        return float(self.prior.weights @ budget.limits(self.optimal_costs))


def _with_silence(grid: Candidates, prior: Prior) -> Candidates:
    """Return candidates with the best constant decision, which rules mix with others and which bounds must know."""
    both = grid.joined(decided_by(grid.problem, prior.mean[None]))
    return both if both.same_as[-1] == len(grid) else grid


def path_prior(beliefs: Array) -> Prior:
    """Return the law of beliefs (T,X) with equal weight for every step."""
    points, met = np.unique(beliefs, axis=0, return_counts=True)
    return Prior(points, met / met.sum())


class Memory(Protocol):
    """The aware observer's decoding of a rule with a memory, and the rule's decisions along a path."""

    @property
    def decided(self) -> tuple[Mechanism, int]:
        """The mechanism of decoded decisions, and the delay in steps of the belief behind them."""

    def __call__(self, n: int) -> Mechanism:
        """Return the mechanism of n decisions on one belief."""

    def published(self, path: np.ndarray) -> Array:
        """Return the decisions (T,U) along a path of beliefs, given as places (T,) in the prior."""


class Watched(NamedTuple):
    """The error of the aware observer over time; NaN where it is not known."""

    error: float = float("nan")  # root mean square
    error_se: float = float("nan")
    top_state: float = float("nan")  # probability that it names a most likely state
    bits: float = float("nan")  # information of one more decision
    bits_se: float = float("nan")
    ceiling: float = float("nan")  # upper bound for every rule of the same regret on the candidates
    error_half: float = float("nan")  # where beliefs stay half as long as the rule assumes
    error_double: float = float("nan")  # where they stay twice as long


class Repeated(NamedTuple):
    """Figures after each number of decisions on one belief, each (S,)."""

    errors: Array
    error_se: Array
    information: Array
    top_state: Array
    regret: float = float("nan")  # expected, over all of them; NaN where it is that of the mechanism


class Play(Protocol):
    """The simulated behaviour of a rule whose mechanism depends on the observer's law."""

    @property
    def regret(self) -> float:
        """The expected regret in the long run, in the cost's unit, from more steps than `mechanism`."""

    @property
    def watched(self) -> Watched:
        """The error of the aware observer over time."""

    def repeated(self, steps: tuple[int, ...], *, told: bool) -> Repeated:
        """Return the leakage of decisions on one belief; `told`: the rule, like the observer, knows that it is constant."""

    def published(self, path: np.ndarray) -> Array:
        """Return the decisions (T,U) along a path of beliefs, given as places (T,) in the prior."""


class Behaviour(NamedTuple):
    """A mechanism calibrated to a regret, and its guarantee for every single decision."""

    mechanism: Mechanism
    promise: Budget | None = None
    """The largest regret of any decision; None where only an expectation is guaranteed."""
    memory: Memory | None = None
    """The aware observer's decoding of a rule with a memory; None: each decision is a draw of `mechanism`."""
    strength: float = float("nan")
    """The calibrated parameter: steps of a delay, or the fraction traded; NaN for others."""
    asked: float | None = None
    """The requested expected regret, in the cost's unit; None if none was requested."""
    play: Play | None = None
    """Simulation of a rule whose mechanism changes; `mechanism` is then the long-run one, for single decisions."""


def behaviour_of(setting: Setting, decision_maker: PlaysMany, promise: Budget | None = None) -> Behaviour:
    """Return a decision maker's behaviour on the prior's beliefs; its own mechanism is used if it solved for the prior."""
    known = getattr(decision_maker, "mechanism", None)
    return Behaviour(
        known if isinstance(known, Mechanism) else mechanism(decision_maker, setting.prior.beliefs), promise
    )


def scaled_to(setting: Setting, tried: Callable[[float], Behaviour], regret: float) -> Behaviour:
    """Return the trial whose expected regret is `regret` or the nearest below, the optimal decisions where all are dearer.

    Regrets must grow with the amount.
    """
    found = spending(tried, lambda behaviour: spent(setting, behaviour), regret)
    return found if spent(setting, found) <= regret else Behaviour(setting.optimal)


def spent(setting: Setting, behaviour: Behaviour) -> float:
    """Return the expected regret of a mechanism on the prior's beliefs, in the cost's unit."""
    return float(setting.prior.weights @ behaviour.mechanism.expected_regrets)
