"""The ways of deciding that a comparison sets side by side, each made to spend a given expected regret."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from inscrutable.budgets import Budget
from inscrutable.decision_makers import (
    Candidates,
    CounterAdversarialDecisionMaker,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    RateDistortionDecisionMaker,
    StackelbergDecisionMaker,
)
from inscrutable.decision_makers.action_candidates import is_simplex
from inscrutable.decision_makers.baselines import (
    CoinDecisionMaker,
    DirichletDecisionMaker,
    ExponentialDecisionMaker,
    RoundingDecisionMaker,
    UniformDecisionMaker,
)
from inscrutable.decision_makers.envelope import concave_envelope, mixture_on_envelope
from inscrutable.decision_makers.scores import Scores, score
from inscrutable.errors import InputError
from inscrutable.mechanisms import Mechanism, Prior, mechanism
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.played import PlaysMany
from inscrutable.privacy import MaximalObfuscation
from inscrutable.privacy.leaks import silence_regret
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

SAME_SPENDING = 0.005
"""Expected regrets count as equal within this share of them: finer budgets would move no figure of the comparison."""

_MOST_TRIALS = 12
_CLEAR_OF_ZERO = 0.01
"""Least |c*| as a share of its mean from which a share of |c*| is a budget at every belief."""


@dataclass(frozen=True, eq=False)
class Setting:
    """What every decision maker of a comparison starts from."""

    problem: DecisionProblem
    prior: Prior
    candidates: Candidates
    chain: BeliefChain | None = None
    kept: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return what `make` gives, made once for a key."""
        if key not in self.kept:
            self.kept[key] = make()
        return self.kept[key]

    @property
    def optimal_costs(self) -> Array:
        """c* of every belief of the prior, shape (B,)."""
        return np.atleast_1d(np.asarray(self.problem.optimal_cost(self.prior.beliefs), dtype=np.float64))

    @property
    def mean_cost(self) -> float:
        """E|c*| under the prior, in the cost's unit."""
        return float(self.prior.weights @ np.abs(self.optimal_costs))

    @property
    def is_relative(self) -> bool:
        """Whether budgets per belief are shares of |c*|: c* stays clear of zero wherever the prior has weight."""
        least = float(np.abs(self.optimal_costs[self.prior.weights > 0]).min())
        return least >= _CLEAR_OF_ZERO * self.mean_cost > 0

    def budget(self, amount: float) -> Budget:
        """Return the budget per belief whose limits are `amount` on average over the prior, in the cost's unit."""
        return Budget.relative(amount / self.mean_cost) if self.is_relative else Budget.regret(amount)


class Memory(Protocol):
    """How one who knows a rule with a memory reads its decisions, and what it publishes along a path."""

    @property
    def decided(self) -> tuple[Mechanism, int]:
        """The mechanism that decisions come from once they are read, and of how many steps ago the belief behind them is."""

    def __call__(self, n: int) -> Mechanism:
        """Return what n decisions on one belief amount to, as a mechanism."""

    def published(self, path: np.ndarray) -> Array:
        """Return the decisions (T,U) along a path of beliefs, given as places (T,) in the prior."""


class Play(NamedTuple):
    """A mechanism that spends what was asked for, and what it promises of every single decision."""

    mechanism: Mechanism
    promise: Budget | None = None
    """The largest regret of any decision it makes; None where only an expectation is promised."""
    seen: Memory | None = None
    """How one who knows the rule reads it, where it has a memory; None: each decision is a draw of `mechanism`."""
    strength: float = float("nan")
    """What was set so that the regret is spent: steps of a delay, the fraction traded; NaN for others."""


Maker = Callable[[Setting, float], Play | None]
"""Makes a decision maker that spends an expected regret under the prior, as nearly as it can, and lets it decide; None
where it does not suit the problem."""


def as_play(setting: Setting, decision_maker: PlaysMany, promise: Budget | None = None) -> Play:
    """Return what a decision maker plays on the prior's beliefs; one that solved for the prior has its mechanism ready."""
    known = getattr(decision_maker, "mechanism", None)
    played = known if isinstance(known, Mechanism) else mechanism(decision_maker, setting.prior.beliefs)
    return Play(played, promise)


def spent(setting: Setting, play: Play) -> float:
    """Return the expected regret of a mechanism on the prior's beliefs, in the cost's unit."""
    return float(setting.prior.weights @ play.mechanism.expected_regrets)


def per_belief(make: Callable[[Setting, Budget], PlaysMany], *, promises: bool) -> Maker:
    """Return the maker of a decision maker with a budget per belief, scaled until the expected regret is the one asked for.

    `promises` says whether the budget holds for every decision, not only in expectation. Where no budget spends that
    much, because nothing more private is to be had, the most that is spent stands.
    """

    def made(setting: Setting, regret: float) -> Play:
        def tried(amount: float) -> Play:
            budget = setting.budget(amount)
            return as_play(setting, make(setting, budget), budget if promises else None)

        return scaled_to(setting, tried, regret)

    return made


def scaled_to(setting: Setting, tried: Callable[[float], Play], regret: float) -> Play:
    """Return the trial whose expected regret is nearest to the one asked for, and not above it; it grows with the amount.

    Where single decisions leap over what is asked for, the trial before the leap stands.
    """
    low, high, amount = (0.0, 0.0), None, regret
    best, best_gap = None, (True, np.inf)
    for _ in range(_MOST_TRIALS):
        play = tried(amount)
        found = spent(setting, play)
        gap = (found > regret * (1.0 + SAME_SPENDING), abs(found - regret))
        if gap < best_gap:
            best, best_gap = play, gap
        if abs(found - regret) <= SAME_SPENDING * regret:
            break
        if found < regret:
            if amount > regret and found <= low[1] * (1.0 + SAME_SPENDING):
                break  # a larger budget is not spent
            low = (amount, found)
        else:
            high = (amount, found)
        amount = _between(low, high, regret)
    assert best is not None
    return best


def _between(low: tuple[float, float], high: tuple[float, float] | None, regret: float) -> float:
    """The next amount: on the line through both ends, or as much larger as too little was spent."""
    if high is None:
        return low[0] * min(regret / low[1], 4.0) * (1.0 + 0.1 * SAME_SPENDING) if low[1] > 0 else 2.0 * low[0]
    share = (regret - low[1]) / (high[1] - low[1])
    return float(low[0] + np.clip(share, 0.05, 0.95) * (high[0] - low[0]))


class _Lotteries(NamedTuple):
    """Lotteries as a mechanism reads them."""

    actions: Array  # (T, 2, U)
    probabilities: Array  # (T, 2)


class CandidateDecisionMaker:
    """The CDM, or the PDM with `mixes`, that chooses among candidates and the optimal decision alone, without polish."""

    def __init__(
        self, problem: DecisionProblem, budget: Budget, candidates: Candidates, *, mixes: bool = False
    ) -> None:
        self.problem, self.budget, self.candidates, self.mixes = problem, budget, candidates, mixes

    def decide_many(self, beliefs: ArrayLike) -> Any:
        """Return the most private affordable candidate of every belief, or lottery of two; else the optimal decision."""
        held = np.asarray(beliefs, dtype=np.float64)
        costs = np.atleast_1d(self.problem.optimal_cost(held))
        limits = self.budget.limits(costs)
        actions = np.repeat(self.problem.solve_points(held)[:, None], 2, axis=1)
        shares = np.tile([1.0, 0.0], (len(held), 1))
        for step, belief in enumerate(held):
            scores = score(belief, float(costs[step]), self.candidates, MaximalObfuscation(), "exclude")
            if self.mixes:
                self._mix(scores, float(limits[step]), actions[step], shares[step])
                continue
            index = scores.best(float(limits[step]))
            if index is not None:
                actions[step] = self.candidates.actions[index]
        return _Lotteries(self.problem.as_actions(actions), shares)

    def _mix(self, scores: Scores, limit: float, actions: Array, shares: Array) -> None:
        """Write the best lottery over; the optimal decision stands where the row of actions has it already."""
        corners = scores.exact_envelope()
        regrets = np.concatenate([[0.0], scores.regrets[corners]])
        privacies = np.concatenate([[0.0], scores.privacies[corners]])
        mixed = mixture_on_envelope(regrets, privacies, concave_envelope(regrets, privacies), limit)
        if mixed is None:
            return
        for place, (index, share) in enumerate(zip(mixed.indices, mixed.probabilities, strict=True)):
            shares[place] = share
            if index > 0:
                actions[place] = self.candidates.actions[corners[index - 1]]


def by_noise(make: Callable[[Setting, float], PlaysMany]) -> Maker:
    """Return the maker of a decision maker whose expected regret grows about as its amount of noise, scaled likewise."""

    def made(setting: Setting, regret: float) -> Play:
        if regret <= 0.0:
            return as_play(setting, OriginalDecisionMaker(setting.problem))
        return scaled_to(setting, lambda amount: as_play(setting, make(setting, amount)), regret)

    return made


def on_simplex(maker: Maker) -> Maker:
    """Return a maker for portfolio weights on the simplex alone; elsewhere it is left out."""

    def made(setting: Setting, regret: float) -> Play | None:
        problem = setting.problem
        return None if problem.is_discrete or not is_simplex(problem) else maker(setting, regret)

    return made


def _original(setting: Setting, regret: float) -> Play:
    return as_play(setting, OriginalDecisionMaker(setting.problem), Budget.regret(0.0))


def _rate_distortion(setting: Setting, regret: float) -> Play:
    budget, prior = Budget.regret(regret), setting.prior
    return as_play(
        setting, RateDistortionDecisionMaker(setting.problem, budget, prior=prior, candidates=setting.candidates)
    )


def _coin(setting: Setting, regret: float) -> Play:
    """The optimal decision, or with some probability the one of the prior's mean: its regret is r₀ times that."""
    silent = silence_regret(setting.problem, setting.prior.beliefs, setting.prior.weights)
    share = min(regret / silent, 1.0) if silent > 0 else 0.0
    return as_play(setting, CoinDecisionMaker(setting.problem, share, decoy=setting.prior.mean))


def _exponential(setting: Setting, amount: float) -> PlaysMany:
    return ExponentialDecisionMaker(setting.problem, 1.0 / amount, candidates=setting.candidates)


def _noisy(setting: Setting, amount: float) -> PlaysMany:
    rng = np.random.default_rng(_NOISE_SEED)  # the same levels in every trial: the regret moves with the amount alone
    concentration = (setting.mean_cost or 1.0) / amount
    return DirichletDecisionMaker(
        setting.problem, concentration, rng=rng, candidates=setting.candidates, n_draws=_NOISE_DRAWS
    )


def _rounded(setting: Setting, regret: float) -> Play:
    """The coarsest rounding that is affordable: of those in use, since it cannot be scaled."""

    def every() -> list[tuple[Play, float]]:
        plays = [as_play(setting, RoundingDecisionMaker(setting.problem, 1.0 / steps)) for steps in _ROUNDINGS]
        # Where even the finest is too dear, nothing is rounded.
        plays.append(as_play(setting, OriginalDecisionMaker(setting.problem)))
        return [(play, spent(setting, play)) for play in plays]

    tried: list[tuple[Play, float]] = setting.once("rounding", every)
    return max(tried, key=lambda each: _rank(each[1], regret))[0]


def _rank(found: float, regret: float) -> tuple[bool, float]:
    """Affordable before dear; nearer before farther."""
    return found <= regret, -abs(found - regret)


_GAP = 0.02
"""Of the Stackelberg mechanism: one per cent of the error, which no figure shows."""
_NOISE_SEED = 0
_NOISE_DRAWS = 200
_ROUNDINGS = (*range(1, 21), 25, 33, 50, 100)
"""Weights in multiples of 1/n, for these n."""

MAKERS: Mapping[str, Maker] = {
    "ODM": _original,
    "CDM": per_belief(
        lambda s, budget: CounterAdversarialDecisionMaker(s.problem, None, budget, candidates=s.candidates),
        promises=True,
    ),
    "PDM": per_belief(
        lambda s, budget: ProbabilisticDecisionMaker(s.problem, None, budget, candidates=s.candidates),
        promises=False,
    ),
    "CDM, candidates only": per_belief(
        lambda s, budget: CandidateDecisionMaker(s.problem, budget, s.candidates), promises=True
    ),
    "PDM, candidates only": per_belief(
        lambda s, budget: CandidateDecisionMaker(s.problem, budget, s.candidates, mixes=True), promises=False
    ),
    "rate-distortion": _rate_distortion,
    "Stackelberg": per_belief(
        lambda s, budget: StackelbergDecisionMaker(s.problem, budget, prior=s.prior, candidates=s.candidates, gap=_GAP),
        promises=False,
    ),
    "uniform": per_belief(
        lambda s, budget: UniformDecisionMaker(s.problem, budget, candidates=s.candidates), promises=True
    ),
    "exponential": by_noise(_exponential),
    "coin": _coin,
    "Dirichlet noise": on_simplex(by_noise(_noisy)),
    "rounding": on_simplex(_rounded),
}
"""The decision makers of a comparison by name; another one is another line.

Delay and partial trading have a memory and need a law of how the belief moves: see `comparison_paths`.
"""

SPENDS_NOTHING = ("ODM",)
"""Those whose expected regret is zero whatever the budget: they are judged once."""


def checked_makers(makers: Mapping[str, Maker]) -> dict[str, Maker]:
    """Return the makers by name, or raise `InputError`."""
    chosen = dict(makers)
    if not chosen or not all(isinstance(name, str) and callable(make) for name, make in chosen.items()):
        raise InputError(
            "makers must be a mapping from names to functions (setting, regret) -> Play, with one at least"
        )
    return chosen
