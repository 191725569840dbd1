"""Delayed and partial trading: rules with a memory, evaluated on a chain of beliefs.

Such a rule is not a mechanism K(u|π). But on a stationary path of a `BeliefChain` the present belief and decision have a joint
law, which defines a mechanism for observers who do not know the rule. The aware observer decodes the rule. With a delay of d
steps the decision is the optimal one of the belief d steps ago, and only the steps since then are uncertain: R^d K. With
partial trading of a fraction f, v_t = (u_t − (1 − f) u_{t−1})/f is exactly the optimal decision, so nothing is hidden from an
observer who also saw the previous decision.

If a belief stays for n decisions, the last decision is its optimal decision for a delay of d < n steps; otherwise it is d + 1 −
n steps late. Earlier decisions could reveal slightly more where several beliefs share an optimal decision; this is neglected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from inscrutable.decision_makers.baselines.path import DelayedDecisionMaker, PartialDecisionMaker, partial_trades
from inscrutable.decision_makers.baselines.rule import PathRule
from inscrutable.experiments.setting import Behaviour, Setting, scaled_to, spent
from inscrutable.mechanisms import Mechanism, mechanism
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

LONGEST_DELAY = 60
"""Longest delay in steps: five years of months, after which beliefs are nearly independent."""

PAST = 100
"""Steps of trading before the evaluated decision."""

_LEAST_FRACTION = 1.0 / PAST
"""Least fraction of a trade: with a smaller one the initial holding would still have a weight above one third."""

_LEAST_DRAWS = 500
"""Least number of sampled pasts, the same for every belief."""
_PATH_SEED = 0


@dataclass(eq=False)
class _Drawn:
    """Sampled decisions of every belief, in the form of a decision maker for `mechanism`."""

    problem: DecisionProblem
    actions: Array  # (B, n, U)

    @property
    def probabilities(self) -> Array:
        """Each sample weighs the same, shape (B,n)."""
        return np.full(self.actions.shape[:2], 1.0 / self.actions.shape[1])

    def decide_many(self, beliefs: ArrayLike) -> _Drawn:
        """Return itself: the samples are those of the chain's beliefs."""
        return self


def delayed(setting: Setting, regret: float) -> Behaviour | None:
    """Return the longest affordable delay; None without a chain."""
    chain = setting.chain
    if chain is None:
        return None
    optimal = setting.optimal
    n_steps, found = 0, Behaviour(optimal)
    while n_steps < LONGEST_DELAY and regret > 0:
        ahead = Behaviour(chain.lagged(found.mechanism, 1))
        if spent(setting, ahead) > regret:
            break
        n_steps, found = n_steps + 1, ahead
    return Behaviour(found.mechanism, strength=float(n_steps), memory=_Late(setting.problem, chain, optimal, n_steps))


@dataclass(frozen=True, eq=False)
class _Late:
    """The delayed decisions as decoded by the aware observer, who knows the delay."""

    problem: DecisionProblem
    chain: BeliefChain
    optimal: Mechanism
    n_steps: int

    @property
    def decided(self) -> tuple[Mechanism, int]:
        """The mechanism of optimal decisions, and the delay of the belief behind them."""
        return self.optimal, self.n_steps

    def __call__(self, n: int) -> Mechanism:
        """Return the mechanism of the last of n decisions on one belief."""
        return self.chain.lagged(self.optimal, max(self.n_steps + 1 - n, 0))

    def published(self, path: np.ndarray) -> Array:
        """Return the delayed decisions (T,U) along a path of beliefs, given as indices (T,)."""
        return _rule_points(DelayedDecisionMaker(self.problem, self.n_steps), self.chain.prior.beliefs[path])


def partly(setting: Setting, regret: float) -> Behaviour | None:
    """Return the partial trading that spends the regret; None without a chain, or where decisions cannot be mixed."""
    chain, problem = setting.chain, setting.problem
    if chain is None or problem.is_discrete:
        return None
    if regret <= 0.0 or not setting.prior.error > 0:
        return Behaviour(setting.optimal, strength=1.0)
    targets = setting.once("targets of partial trading", lambda: _targets(chain, problem))
    unit = setting.once("unit of partial trading", lambda: spent(setting, _traded(setting, targets, 0.0)))

    def tried(amount: float) -> Behaviour:
        return _traded(setting, targets, max(unit / (unit + amount), _LEAST_FRACTION) if unit > 0 else 1.0)

    return scaled_to(setting, tried, regret)


def _targets(chain: BeliefChain, problem: DecisionProblem) -> Array:
    """Optimal decisions along sampled pasts of every belief, shape (PAST+1,B,n,U)."""
    rng = np.random.default_rng(_PATH_SEED)  # the same pasts in every trial: the regret depends on the fraction alone
    pasts = chain.histories(PAST, -(-_LEAST_DRAWS // len(chain.prior)), rng=rng)
    return np.asarray(np.atleast_2d(problem.solve_points(chain.prior.beliefs))[pasts])


def _traded(setting: Setting, targets: Array, fraction: float) -> Behaviour:
    """Return the decisions of partial trading from the first target on; at fraction 0 the first target throughout."""
    problem, beliefs = setting.problem, setting.prior.beliefs
    published = partial_trades(targets, targets[0], fraction)
    played = mechanism(_Drawn(problem, published[-1]), beliefs)
    if fraction <= 0.0:
        return Behaviour(played)
    return Behaviour(played, strength=fraction, memory=_Decoded(setting.optimal, problem, published[-2:], fraction))


@dataclass(frozen=True, eq=False)
class _Decoded:
    """The decisions as decoded by the aware observer, who knows the fraction and the previous decision.

    The decoded decision is the optimal one nearest to the target.
    """

    optimal: Mechanism
    problem: DecisionProblem
    last_two: Array  # the last two decisions, (2, B, n, U)
    fraction: float

    def __call__(self, n: int) -> Mechanism:
        """Return the mechanism of the decoded decisions, the same for any number of decisions."""
        before, last = self.last_two
        targets = (last - (1.0 - self.fraction) * before) / self.fraction
        known = self.problem.as_points(self.optimal.actions)
        _, place = cKDTree(known).query(targets)
        return mechanism(_Drawn(self.problem, known[place]), self.optimal.beliefs)

    @property
    def decided(self) -> tuple[Mechanism, int]:
        """The mechanism of optimal decisions, and a delay of 0."""
        return self.optimal, 0

    def published(self, path: np.ndarray) -> Array:
        """Return the decisions (T,U) along a path of beliefs, given as indices (T,)."""
        return _rule_points(PartialDecisionMaker(self.problem, self.fraction), self.optimal.beliefs[path])


def _rule_points(rule: PathRule, beliefs: Array) -> Array:
    return rule.problem.as_points(rule.decide_many(beliefs).action)
