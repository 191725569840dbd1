"""Decision makers brought to the same expected regret, so that they can be compared."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.decision_makers.results import expected
from inscrutable.errors import InputError
from inscrutable.geometry.crossings import Bracket, narrowed
from inscrutable.mechanisms import Prior, mechanism
from inscrutable.saved import Summarised

_SCAN = 7
"""Values tried between the ends where both ends lie on the same side of the target."""
_LONGEST_STEP = float(np.log(4.0))
"""First step of the logarithm of an amount, where the first trial is far off."""
_MOST_IDLE = 3
"""Consecutive steps without a change of the regret after which a search ends: the amount has grown some hundredfold."""
_FARTHEST = float(np.log(1e12))
"""Largest change of the logarithm of an amount from the first trial, the regret asked for: more or less noise than that
changes nothing, and amounts overflow."""
Made = TypeVar("Made")


class CalibrationStatus(Enum):
    """How a calibration ended; the text says what to do about it.

    Example:
        >>> CalibrationStatus.REACHED.value
        'reached: the expected regret is the target'
    """

    REACHED = "reached: the expected regret is the target"
    JUMPED = "the family jumps over the target: the nearest expected regret found below it is used"
    ALL_CHEAPER = "all tried cost less than the target: the dearest is used; widen the range of the parameter"
    ALL_DEARER = "all tried cost more than the target: the cheapest is used; widen the range of the parameter"


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Summarised):
    """The decision maker of a family with the largest expected regret found that does not exceed a target.

    Iterating over it gives the decision maker and its expected regret.

    Args:
        decision_maker: The decision maker.
        parameter: The value of its parameter.
        regret: Its expected regret, in the cost's unit.
        target: The expected regret asked for.
        status: How the search ended.
        n_trials: Number of decision makers tried.

    Example:
        >>> from inscrutable import CoinDecisionMaker, FiniteProblem, uniform_prior
        >>> problem = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
        >>> maker, regret = calibrate(lambda p: CoinDecisionMaker(problem, p), 0.1, uniform_prior(2, 10), 0.0, 1.0)
        >>> round(regret, 4)
        0.1
    """

    decision_maker: Any
    parameter: float
    regret: float
    target: float
    status: CalibrationStatus
    n_trials: int

    def __iter__(self) -> Iterator[Any]:
        yield self.decision_maker
        yield self.regret

    def summary(self) -> str:
        """Return one line for a person to read."""
        name = type(self.decision_maker).__name__
        return (
            f"{name} at {self.parameter:.6g}: expected regret {self.regret:.6g}, target {self.target:.6g}; "
            f"{self.status.value}"
        )


def calibrate(
    make: Callable[[float], Any], regret: float, prior: Prior | ArrayLike, low: float, high: float
) -> Calibration:
    """Return the decision maker of a family whose expected regret comes nearest to a target from below.

    Formula: the parameter a ∈ [low, high] with the largest found R(a) ≤ regret, R(a) = Σ_b w_b Σ_u K_a(u|π_b) ρ(π_b,u) under
    a prior, and the mean of ρ(π_t,u_t) along a path.

    R may rise or fall in a. The ends are tried, and seven values between them where both lie on one side of the target; a
    bracket is then narrowed to a crossing, in the logarithm of the parameter where `low` is above 0. Where R is not
    monotone this is one crossing of several; a jump ends at its lower side.

    Args:
        make: A function from parameter to decision maker, such as `lambda p: CoinDecisionMaker(problem, p)`. Compute
            candidates once outside of it, else every trial computes its own. Round inside for parameters that are whole
            numbers.
        regret: The target, above 0, in the cost's unit.
        prior: A `Prior`, or a path of beliefs (T,X) in the order of time, each step of equal weight; decision makers with a
            memory, delayed or partial, need a path.
        low: Least value of the parameter.
        high: Largest value of the parameter, above `low`.

    Returns:
        A `Calibration`: the target is reached to a relative 1e-6 from below, or the status says why not.

    Raises:
        InputError: The target is not above 0, the range is empty, the beliefs are malformed, or a decision maker with a
            memory meets a prior.

    Cost: some ten to forty decision makers, each on all beliefs.

    Source: secants and halvings (Anderson and Björck, BIT 13, 1973).

    Example:
        >>> from inscrutable import CoinDecisionMaker, FiniteProblem, uniform_prior
        >>> problem = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
        >>> calibrate(lambda p: CoinDecisionMaker(problem, p), 10.0, uniform_prior(2, 10), 0.0, 1.0).status.name
        'ALL_CHEAPER'
    """
    target = validation.positive(regret, "regret")
    low, high = validation.number_of(low, "low"), validation.number_of(high, "high")
    if not low < high:
        raise InputError(f"low must be below high, got {low:g} and {high:g}")
    if not callable(make):
        raise InputError(f"make must give a decision maker for a number, got {make!r}")

    def made(parameter: float) -> tuple[Any, float]:
        maker = make(parameter)
        return maker, expected_regret(maker, prior)

    search = _Search(made, target, low, high)
    status, found = search.between_ends(), search.best
    return Calibration(found.made, found.parameter, found.regret, target, status, search.n_trials)


def spending(make: Callable[[float], Made], regret_of: Callable[[Made], float], regret: float) -> Made:
    """Return the object made from the amount whose expected regret is the nearest below `regret`, the first amount tried.

    The expected regret must grow with the amount. It is reached as by `calibrate`, or the nearest below is returned
    where it jumps over the target or no larger amount raises it; the nearest above where no amount is as cheap.
    """

    def made(amount: float) -> tuple[Made, float]:
        found = make(amount)
        return found, regret_of(found)

    if regret <= 0.0:
        return make(regret)
    guess = float(np.log(regret))
    least = max(float(np.exp(guess - _FARTHEST)), np.finfo(float).tiny)
    search = _Search(made, regret, least, float(np.exp(guess + _FARTHEST)))
    search.from_guess(guess)
    found: Made = search.best.made
    return found


def expected_regret(decision_maker: Any, prior: Prior | ArrayLike) -> float:
    """Return the expected regret of a decision maker under a prior, or its mean along a path of beliefs (T,X)."""
    if getattr(decision_maker, "is_memoryless", True):
        regrets = mechanism(decision_maker, prior).expected_regrets
        return float(prior.weights @ regrets if isinstance(prior, Prior) else regrets.mean())
    if isinstance(prior, Prior):
        raise InputError(
            f"{type(decision_maker).__name__} depends on earlier decisions: give a path of beliefs (T,X), not a prior"
        )
    decided = decision_maker.decide_many(prior)
    draws = hasattr(decided, "probabilities")
    return float(np.mean(expected(decided.probabilities, decided.regrets) if draws else decided.regret))


class _Trial(NamedTuple):
    made: Any
    parameter: float
    place: float  # the parameter, or its logarithm
    regret: float


class _Search:
    def __init__(self, make: Callable[[float], tuple[Any, float]], target: float, low: float, high: float) -> None:
        self.make, self.target = make, target
        self.is_log = low > 0
        self.ends = (low, high)
        self.n_trials = 0
        self.best: _Trial

    def between_ends(self) -> CalibrationStatus:
        """Search the whole range for the target; the best trial is kept in `best`."""
        places = np.log(self.ends) if self.is_log else self.ends
        trials = [self._at(float(place)) for place in places]
        first, last = trials
        if self._is_below(first) == self._is_below(last) and not self._is_reached():
            trials[1:1] = [self._at(float(place)) for place in np.linspace(places[0], places[1], _SCAN + 2)[1:-1]]
        for one, other in pairwise(trials):
            if self._is_below(one) != self._is_below(other):
                self._narrow(one, other)
                return CalibrationStatus.REACHED if self._is_reached() else CalibrationStatus.JUMPED
        if self._is_reached():
            return CalibrationStatus.REACHED
        return CalibrationStatus.ALL_CHEAPER if self._is_below(first) else CalibrationStatus.ALL_DEARER

    def from_guess(self, place: float) -> None:
        """Step from a place towards the target, each step twice as long as the last, until a bracket is found, and narrow it.
        After a step that did not change the regret the next is a long one; the ends of the range are the farthest trials."""
        trial, weight, idle = self._at(place), 1.0, 0
        aim = self.target * (1.0 - 0.5 * tolerances.CALIBRATED)  # the middle of the range that counts as reached
        while not self._is_reached() and idle < _MOST_IDLE:
            missing = abs(np.log(aim / trial.regret)) if trial.regret > 0 and not idle else np.inf
            step = weight * min(float(missing), _LONGEST_STEP)
            place = float(np.clip(trial.place + (step if self._is_below(trial) else -step), *np.log(self.ends)))
            if place == trial.place:
                return
            ahead = self._at(place)
            if self._is_below(ahead) != self._is_below(trial):
                self._narrow(trial, ahead)
                return
            weight *= 2.0
            idle = idle + 1 if abs(ahead.regret - trial.regret) <= tolerances.CALIBRATED * self.target else 0
            trial = ahead

    def _narrow(self, one: _Trial, other: _Trial) -> None:
        """Narrow a bracket until the target is reached or nothing lies between its ends."""
        ends = (one, other) if self._is_below(one) else (other, one)
        narrowed(
            lambda _, place: np.array([self._at(float(place[0])).regret - self.target]),
            Bracket(*(np.array([end.place]) for end in ends)),
            Bracket(*(np.array([end.regret - self.target]) for end in ends)),
            spare=tolerances.CALIBRATED * self.target,
            width=tolerances.CALIBRATED if self.is_log else 2.0 * float(np.spacing(max(np.abs(self.ends)))),
        )

    def _at(self, place: float) -> _Trial:
        parameter = float(np.clip(np.exp(place) if self.is_log else place, *self.ends))
        made, regret = self.make(parameter)
        trial = _Trial(made, parameter, place, regret)
        if self.n_trials == 0 or self._rank(trial) > self._rank(self.best):
            self.best = trial
        self.n_trials += 1
        return trial

    def _rank(self, trial: _Trial) -> tuple[bool, float]:
        """Below the target before above it; nearer before farther."""
        return self._is_below(trial), -abs(trial.regret - self.target)

    def _is_below(self, trial: _Trial) -> bool:
        return trial.regret <= self.target

    def _is_reached(self) -> bool:
        return self._is_below(self.best) and self.target - self.best.regret <= tolerances.CALIBRATED * self.target
