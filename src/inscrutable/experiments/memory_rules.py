"""Late and partial trading: rules that decide by what came before, judged on a moving belief.

Such a rule is no mechanism K(u|π), but in the middle of a long path of a `BeliefChain` today's belief and today's decision
have a joint law, and with it a mechanism: the one that observers without knowledge of the rule face. The aware observer
reads it backwards. After a delay of d steps the decision is the optimal one of the belief d steps ago, and what is left to
guess is how the belief has moved since: R^d K. A fraction f of the trade gives the target away: v_t = (u_t − (1 − f) u_{t−1})/f
is the optimal decision, to the last digit, so nothing is hidden from an observer who also saw the decision before.

A belief that is held for n decisions is met with the optimal decision itself after a delay of d < n steps, and d + 1 − n steps
late before. Decisions seen before the last (and for the fraction the last but one) could reveal a little more, where several
beliefs share one optimal decision; that is left out.
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
"""Steps: five years of months, after which few beliefs remember where they were."""

PAST = 100
"""Steps of trading before the decision that is judged."""

_LEAST_FRACTION = 1.0 / PAST
"""Of a trade: with a smaller one, what was held at the start of the past would still weigh more than a third."""

_LEAST_DRAWS = 500
"""Pasts sampled at least, the same number for every belief."""
_PATH_SEED = 0


@dataclass(eq=False)
class _Drawn:
    """Decisions sampled for every belief, as a decision maker that a mechanism can be made of."""

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
    """Return the longest affordable delay, as rounding cannot be scaled either; None where no chain is known."""
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
    """The decisions as the aware observer, who knows the delay, reads them."""

    problem: DecisionProblem
    chain: BeliefChain
    optimal: Mechanism
    n_steps: int

    @property
    def decided(self) -> tuple[Mechanism, int]:
        """Optimal decisions, of the belief that many steps ago."""
        return self.optimal, self.n_steps

    def __call__(self, n: int) -> Mechanism:
        """Return the mechanism that the last of n decisions on one belief comes from."""
        return self.chain.lagged(self.optimal, max(self.n_steps + 1 - n, 0))

    def published(self, path: np.ndarray) -> Array:
        """Return the late decisions (T,U) along a path of beliefs, given as places (T,)."""
        return _rule_points(DelayedDecisionMaker(self.problem, self.n_steps), self.chain.prior.beliefs[path])


def partly(setting: Setting, regret: float) -> Behaviour | None:
    """Return the trade of a fraction that spends the regret; None where no chain is known, or nothing lies in between."""
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
    rng = np.random.default_rng(_PATH_SEED)  # the same pasts in every trial: the regret moves with the fraction alone
    pasts = chain.histories(PAST, -(-_LEAST_DRAWS // len(chain.prior)), rng=rng)
    return np.asarray(np.atleast_2d(problem.solve_points(chain.prior.beliefs))[pasts])


def _traded(setting: Setting, targets: Array, fraction: float) -> Behaviour:
    """The trade of a fraction, begun at the first target; of no fraction at all, what was held from the first on."""
    problem, beliefs = setting.problem, setting.prior.beliefs
    published = partial_trades(targets, targets[0], fraction)
    played = mechanism(_Drawn(problem, published[-1]), beliefs)
    if fraction <= 0.0:
        return Behaviour(played)
    return Behaviour(played, strength=fraction, memory=_Decoded(setting.optimal, problem, published[-2:], fraction))


@dataclass(frozen=True, eq=False)
class _Decoded:
    """The decisions as the aware observer, who knows the fraction and saw the decision before, reads them: the optimal
    decision nearest to the target."""

    optimal: Mechanism
    problem: DecisionProblem
    last_two: Array  # the last two decisions, (2, B, n, U)
    fraction: float

    def __call__(self, n: int) -> Mechanism:
        """Return the mechanism that the decoded decisions come from, however many were seen."""
        before, last = self.last_two
        targets = (last - (1.0 - self.fraction) * before) / self.fraction
        known = self.problem.as_points(self.optimal.actions)
        _, place = cKDTree(known).query(targets)
        return mechanism(_Drawn(self.problem, known[place]), self.optimal.beliefs)

    @property
    def decided(self) -> tuple[Mechanism, int]:
        """Optimal decisions, of today's belief."""
        return self.optimal, 0

    def published(self, path: np.ndarray) -> Array:
        """Return the decisions (T,U) along a path of beliefs, given as places (T,)."""
        return _rule_points(PartialDecisionMaker(self.problem, self.fraction), self.optimal.beliefs[path])


def _rule_points(rule: PathRule, beliefs: Array) -> Array:
    return rule.problem.as_points(rule.decide_many(beliefs).action)
