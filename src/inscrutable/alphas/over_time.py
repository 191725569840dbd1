"""The least leakage over time, or the largest error, at a mean regret per step.

With E the observer's error covariance after a decision and P(E) before the next one (`Moves.predicted`), the problems

    min ½ log det P(E) − ½ log det E    and    max tr(QE)    over 0 ⪯ E ⪯ P(E), tr(ΘE) ≤ r

are convex. At a price μ of regret the optimal E is a reverse water-filling of P whose weights look ahead,

    Y = C + μΘ + A_L' D A_L,    P^{1/2} Y P^{1/2} = U diag(λ) U',    E = P^{1/2} U diag(min(1, 1/2λ)) U' P^{1/2},
    D = P^{−1/2} U diag(min(λ, ½)) U' P^{−1/2}    (what one unit of P costs later on),

with C = 0 for bits alone and C = −Q/ε for errors plus bits at the price ε. The fixed point satisfies the conditions of
optimality; Z = ½E⁻¹ − Y is the multiplier of E ⪯ P(E), so that every iterate gives a dual bound (`over_time_bound`). Source of
the
programme: Tanaka, Kim, Parrilo, Mitter, Semidefinite programming approach to Gaussian sequential rate-distortion trade-offs
(IEEE Trans. AC 62, 2017), equations (13) and (18), here with W that may be singular and with public observations.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.alphas.barrier import Inside, least_bits_by_barrier, most_error_by_barrier
from inscrutable.alphas.error_law import ErrorLaw, after_sensor, law_between, root_of
from inscrutable.alphas.interior import MOST_SIGNALS, most_error_inside
from inscrutable.alphas.observed import Moves
from inscrutable.alphas.over_time_bound import least_bits_bound, most_error_bound
from inscrutable.errors import SolverError
from inscrutable.validation import Array

_MOST_STEPS = 20_000
_PATIENCE = 100  # steps within which a residual must halve
_LEAST_STEP = 0.01
_MOST_TRIALS = 60


@dataclass(frozen=True, eq=False)
class LongRun:
    """The figures of a stationary rule, and the bound for every causal rule.

    Args:
        law: The covariances before and after a decision.
        regret: tr(ΘE), per step.
        value: Bits per step, or tr(QE).
        bound: Lower bound of the bits, or upper bound of tr(QE), of every causal rule at this regret.
    """

    law: ErrorLaw
    regret: float
    value: float
    bound: float

    @property
    def gap(self) -> float:
        """Difference of value and bound, as a share of the larger."""
        if self.value == self.bound:
            return 0.0
        return float(abs(self.value - self.bound) / max(abs(self.bound), abs(self.value)))


@dataclass(eq=False)
class _Steps:
    """Number of steps left, for all multipliers together."""

    left: int


@dataclass(frozen=True, eq=False)
class _Goal:
    moves: Moves
    theta: Array
    limit: float
    steps: _Steps
    weights: Array | None = None  # Q; None for bits
    unit: float = 1.0  # ε, the price of a nat in units of tr(QE)

    def cost(self, price: float) -> Array:
        """C + μΘ, in nats."""
        found = price * self.theta
        return found if self.weights is None else (found - self.weights) / self.unit


class _State(NamedTuple):
    """A fixed point at a multiplier of regret."""

    price: float
    regret: float
    error: Array
    before: Array  # P
    ahead: Array  # D
    levels: Array  # λ
    dual: Array  # U'P^{-1/2}

    def turned(self, values: Array) -> Array:
        """P^{-1/2} U diag(values) U' P^{-1/2}."""
        return np.asarray((self.dual.T * values) @ self.dual)

    def shown(self) -> _State:
        """The same multiplier for a rule that shows the belief exactly: E = 0, which every rule may be mixed with."""
        return self._replace(regret=0.0, error=np.zeros_like(self.error))


def least_bits(moves: Moves, theta: Array, limit: float) -> LongRun:
    """Return the stationary rule of fewest bits per step at tr(ΘE) ≤ limit, limit > 0.

    The iteration ends after 20,000 steps with the best rule so far and its bound. Where their gap is too large, up to 120
    signals a barrier method takes over.

    Raises: SolverError: No step converged, the silence regret is infinite, and there are more than 120 signals.

    Cost: some thousand eigendecompositions of n×n matrices: some seconds for 100 signals. Where the barrier method takes over,
    O(n⁶): 3 s for 40 signals.
    """
    return _best_of(
        lambda: _least_bits_by_prices(moves, theta, limit),
        lambda: _least_bits_of(least_bits_by_barrier(moves, theta, limit), moves, theta),
        has_barrier=len(theta) <= MOST_SIGNALS,
    )


def _best_of(fast: Callable[[], LongRun], sure: Callable[[], LongRun], *, has_barrier: bool) -> LongRun:
    """Return the rule of a fast method, or where its gap is too large, the one of smaller gap of both methods.

    Of 1,000 problems of two to six signals near or above a spectral radius of one the iteration for bits leaves seven open,
    with gaps up to 1, and the interior-point method for the error three, with gaps up to .4; of 100 with public observations
    it leaves six, up to .005. Here the barrier method leaves none, but takes two to six times as long.
    """
    found: LongRun | None = None
    try:
        found = fast()
    except SolverError:
        if not has_barrier:
            raise
    if found is None:
        return sure()
    if found.gap <= tolerances.OVER_TIME_GAP or not has_barrier:
        return found
    with suppress(SolverError):
        return min(found, sure(), key=lambda each: each.gap)
    return found


def _least_bits_of(found: Inside, moves: Moves, theta: Array) -> LongRun:
    law = law_between(root_of(moves.predicted(found.error)[0]), found.error)
    return LongRun(law, law.weighed(theta), law.bits, max(min(found.bound, law.bits), 0.0))


def _least_bits_by_prices(moves: Moves, theta: Array, limit: float) -> LongRun:
    goal = _Goal(moves, theta, limit, _Steps(_MOST_STEPS))
    before = _start(moves)
    ahead = np.asarray(0.5 * np.linalg.inv(before))
    try:
        low, high = _ends(goal, _first(goal, 0.5 * len(theta) / limit, before, ahead), 4.0)
    except SolverError:
        law = _part_of_silence(goal)
        return LongRun(law, law.weighed(theta), law.bits, 0.0)
    law = _mixed(goal, low, high)
    bound = max(
        least_bits_bound(moves, theta, limit, each.error, each.price, each.turned(np.maximum(0.5 - each.levels, 0.0)))
        for each in (low, high)
        if each.regret > 0.0
    )
    return LongRun(law, law.weighed(theta), law.bits, max(min(bound, law.bits), 0.0))


def most_error_over_time(moves: Moves, theta: Array, weights: Array, limit: float) -> LongRun:
    """Return the stationary rule that leaves the largest tr(QE) at tr(ΘE) ≤ limit, limit > 0.

    Up to 120 signals an interior-point method finds it. For more signals, or without an interior point to start from, the rule
    maximises the error minus a price ε of bits, such that all bits together cost a millionth of the error; all multipliers
    together take at most 20,000 steps. Where Q is a multiple of Θ, all rules that spend the limit leave the same error, and the
    one of fewest bits is returned. For ties in some directions only, the interior-point method returns some optimal rule, the
    price of bits one near the fewest bits.

    Raises:
        SolverError: Neither method converged, and the silence regret is infinite.

    Cost: 100 signals take about 12 factorisations of matrices of 5,050 rows, 30 s; more than 120 signals take about ten
    thousand eigendecompositions of n×n matrices, at most 40,000.
    """
    rate = float(np.sum(weights * theta) / np.sum(theta * theta))
    if np.abs(weights - rate * theta).max() <= tolerances.COMMUTING * np.abs(weights).max():
        told = least_bits(moves, theta, limit)
        return LongRun(told.law, told.regret, rate * told.regret, rate * limit)
    if len(theta) > MOST_SIGNALS:
        return _by_prices(moves, theta, weights, limit)
    with suppress(SolverError):
        return _best_of(
            lambda: _most_error_inside(moves, theta, weights, limit),
            lambda: _most_error_of(most_error_by_barrier(moves, theta, weights, limit), moves, theta, weights, limit),
            has_barrier=True,
        )
    return _by_prices(moves, theta, weights, limit)


def _most_error_inside(moves: Moves, theta: Array, weights: Array, limit: float) -> LongRun:
    error, price, multiplier = most_error_inside(moves, theta, weights, limit)
    bound = most_error_bound(moves, theta, weights, limit, error, price, multiplier)
    return _most_error_of(Inside(error, np.nan, bound), moves, theta, weights, limit)


def _most_error_of(found: Inside, moves: Moves, theta: Array, weights: Array, limit: float) -> LongRun:
    error, bound = found.error, found.bound
    silence, regret = moves.silence(), float(np.sum(theta * error))
    if silence is not None:  # the part of the limit that the method leaves unspent
        error = error + (silence - error) * max(limit - regret, 0.0) / (float(np.sum(theta * silence)) - regret)
    law = law_between(root_of(moves.predicted(error)[0]), error)
    value = law.weighed(weights)
    return LongRun(law, law.weighed(theta), value, max(bound, value))


def _by_prices(moves: Moves, theta: Array, weights: Array, limit: float) -> LongRun:
    before, steps = _start(moves), _Steps(_MOST_STEPS)
    ahead = np.zeros_like(before)
    error = float(np.trace(weights @ before))
    price, factor = error / max(float(np.trace(theta @ before)), np.finfo(float).tiny), 4.0
    best: LongRun | None = None
    for share in tolerances.ERROR_PRICES:
        goal = _Goal(moves, theta, limit, steps, weights, share * error / len(theta))
        near = tolerances.REGRET_SPENT if share <= tolerances.ERROR_PRICES[-2] else tolerances.REGRET_NEARLY_SPENT
        try:
            low, high = _ends(goal, _first(goal, price, before, ahead), factor, near)
        except SolverError:
            return _silent_part_with_error(goal) if best is None else best
        error = float(np.trace(weights @ high.error))
        price, before, ahead, factor = high.price, high.before, 0.1 * high.ahead, 1.05
        found = _with_error(goal, low, high)
        best = found if best is None or found.gap < best.gap else best
        if best.gap <= tolerances.ERROR_OVER_TIME_GAP or steps.left <= 0:
            break
    assert best is not None
    return best


def _part_of_silence(goal: _Goal) -> ErrorLaw:
    """Return the silent covariance scaled down until it spends the limit; a scaled-down feasible E is feasible."""
    silence = goal.moves.silence()
    if silence is None:
        raise _unsettled(goal)
    error = silence * min(1.0, goal.limit / float(np.sum(goal.theta * silence)))
    return law_between(root_of(goal.moves.predicted(error)[0]), error)


def _silent_part_with_error(goal: _Goal) -> LongRun:
    law, silence = _part_of_silence(goal), goal.moves.silence()
    assert goal.weights is not None
    assert silence is not None
    return LongRun(law, law.weighed(goal.theta), law.weighed(goal.weights), float(np.sum(goal.weights * silence)))


def _with_error(goal: _Goal, low: _State, high: _State) -> LongRun:
    """Return the mixture of two fixed points, and the better of their bounds."""
    assert goal.weights is not None
    law = _mixed(goal, low, high)
    value, limit = law.weighed(goal.weights), goal.limit
    bound = min(
        most_error_bound(
            goal.moves,
            goal.theta,
            goal.weights,
            limit,
            each.error,
            each.price,
            each.turned(goal.unit * np.maximum(-each.levels, 0.0)),
        )
        for each in (low, high)
    )
    return LongRun(law, law.weighed(goal.theta), value, max(bound, value))


def told_exactly(moves: Moves, theta: Array, weights: Array | None = None) -> LongRun:
    """Return the stationary rule of zero regret: it reveals the range of Θ and nothing else of the belief."""
    rows = root_of(theta)[0].T
    before, law = moves.innovation, None
    for _ in range(_MOST_STEPS):
        law = after_sensor(root_of(before), rows, np.zeros(len(rows)))
        after, _ = moves.predicted(law.covariance)
        if np.abs(after - before).max() <= tolerances.SETTLED * np.abs(after).max():
            value = law.bits if weights is None else law.weighed(weights)
            return LongRun(law, 0.0, value, value)
        before = after
    raise SolverError(
        f"the error of an observer who is shown the decisions' part did not converge in {_MOST_STEPS} steps"
    )


def _start(moves: Moves) -> Array:
    size = np.trace(moves.innovation) / len(moves.innovation)
    return np.asarray(moves.innovation + 0.1 * size * np.eye(len(moves.innovation)))


def _unsettled(goal: _Goal) -> SolverError:
    return SolverError(
        f"the rule over time did not converge in {_MOST_STEPS} steps, for {len(goal.theta)} signals at a regret of "
        f"{goal.limit:g}"
    )


def _settled(goal: _Goal, price: float, before: Array, ahead: Array, most: int) -> _State | None:
    """Return the fixed point at a multiplier, starting from P and D."""
    cost, step, best = goal.cost(price), 1.0, np.inf
    moved, most_size = goal.moves.predicted(before)[1], np.trace(before) / tolerances.NO_VARIANCE
    for count in range(min(most, goal.steps.left)):
        goal.steps.left -= 1
        values, vectors = np.linalg.eigh(before)
        root = np.sqrt(np.maximum(values, tolerances.NO_VARIANCE * values[-1]))
        half, inverse = (vectors * root) @ vectors.T, (vectors / root) @ vectors.T
        levels, turn = np.linalg.eigh(half @ (cost + moved.T @ ahead @ moved) @ half)
        basis, dual = half @ turn, turn.T @ inverse
        shares = np.where(levels > 0.5, 0.5 / np.maximum(levels, 0.5), 1.0)
        error = (basis * shares) @ basis.T
        after, moved = goal.moves.predicted(error)
        if not np.trace(after) < most_size:  # the multiplier is too low for a belief without a stationary law
            return None
        onwards = (dual.T * np.minimum(levels, 0.5)) @ dual
        apart = np.abs(inverse @ (after - before) @ inverse).max() + np.abs(
            half @ (onwards - ahead) @ half
        ).max() / max(1.0, -levels[0])
        if apart <= tolerances.SETTLED:
            regret = float(np.sum(goal.theta * error))
            return _State(price, regret, error, after, onwards, levels, dual)
        if (count + 1) % _PATIENCE == 0:
            # Damping against oscillation: the dual D then moves more slowly than the covariance P.
            step, best = (max(0.4 * step, _LEAST_STEP) if apart > 0.5 * best else step), min(best, apart)
        before, ahead = after, ahead + step * (onwards - ahead)
    return None  # the iteration oscillates: the optimum is nearly discontinuous at this multiplier


def _first(goal: _Goal, price: float, before: Array, ahead: Array) -> _State:
    """Return a fixed point at a multiplier or above: below some multiplier a belief without a stationary law has none."""
    for _ in range(_MOST_TRIALS if goal.steps.left else 0):
        found = _settled(goal, price, before, ahead, 50 * _PATIENCE)
        if found is not None:
            return found
        price *= 2.0
    raise _unsettled(goal)


def _ends(goal: _Goal, first: _State, factor: float, near: float = tolerances.REGRET_SPENT) -> tuple[_State, _State]:
    """Return the nearest fixed points with regrets above and below the limit, or one that meets it."""
    low, high = (first, None) if first.regret > goal.limit else (None, first)
    price, state, least = first.price, first, 0.0
    for _ in range(_MOST_TRIALS):
        if low is not None and high is not None:
            break
        if least > state.price * (1.0 - np.sqrt(tolerances.SAME_PRICE)):
            break
        price = price * factor if high is None else max(price / factor, np.sqrt(least * price))
        found = _settled(goal, price, state.before, state.ahead, 50 * _PATIENCE)
        if found is not None:
            state = found
            low, high = (state, high) if state.regret > goal.limit else (low, state)
        elif goal.moves.radius >= 1.0 - tolerances.STABLE and high is not None:
            least, price = price, state.price
        factor = min(factor**1.5, 16.0)
    if high is None:
        assert low is not None
        return low, low.shown()
    if low is None:
        return high, high
    for count in range(_MOST_TRIALS):
        met = [each for each in (high, low) if abs(each.regret - goal.limit) <= near * goal.limit]
        if met:
            return met[0], met[0]
        lost = (1.0 - low.price / high.price) * (low.regret - high.regret)  # a bound of the loss of their mixture
        if lost <= tolerances.MIXTURE_LOSS * goal.limit:
            break
        inner = _between(goal, low, high, count)
        if inner is None:
            break
        low, high = (inner, high) if inner.regret > goal.limit else (low, inner)
    return low, high


def _between(goal: _Goal, low: _State, high: _State, count: int) -> _State | None:
    """Return a fixed point at a multiplier between two; None where none was found."""
    width = np.log(high.price / low.price)
    apart = np.log(low.regret / goal.limit) / np.log(low.regret / max(high.regret, np.finfo(float).tiny))
    first = 0.5 if count % 3 == 2 else float(np.clip(apart, 0.02, 0.98))
    for share in (first, 0.1, 0.9):
        start = high if share > 0.5 else low
        found = _settled(goal, low.price * float(np.exp(share * width)), start.before, start.ahead, 50 * _PATIENCE)
        if found is not None:
            return found
    return None


def _mixed(goal: _Goal, low: _State, high: _State) -> ErrorLaw:
    """Return the law of the mixture of two errors that spends the limit, or of a part of one that exceeds it."""
    if low is high:
        error = low.error * min(1.0, goal.limit / max(low.regret, np.finfo(float).tiny))
    else:
        share = float(np.clip((goal.limit - high.regret) / (low.regret - high.regret), 0.0, 1.0))
        error = share * low.error + (1.0 - share) * high.error
    return law_between(root_of(goal.moves.predicted(error)[0]), error)
