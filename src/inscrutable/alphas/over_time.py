"""The least leakage over time, or the largest error, at a mean regret per step.

With E the observer's error covariance after a decision and P(E) before the next one (`Moves.predicted`), the problems

    min ½ log det P(E) − ½ log det E    and    max tr(QE)    over 0 ⪯ E ⪯ P(E), tr(ΘE) ≤ r

are convex. At a price μ of regret the optimal E is a reverse water-filling of P whose weights look ahead,

    Y = C + μΘ + A_L' D A_L,    P^{1/2} Y P^{1/2} = U diag(λ) U',    E = P^{1/2} U diag(min(1, 1/2λ)) U' P^{1/2},
    D = P^{−1/2} U diag(min(λ, ½)) U' P^{−1/2}    (what one unit of P costs later on),

with C = 0 for bits alone and C = −Q/ε for errors plus bits at the price ε. The fixed point satisfies the conditions of
optimality; Z = ½E⁻¹ − Y is the multiplier of E ⪯ P(E), so that every iterate gives a dual bound (`over_time_bound`). The steps
to it are extrapolated. Source of the programme: Tanaka, Kim, Parrilo, Mitter, Semidefinite programming approach to Gaussian
sequential rate-distortion trade-offs (IEEE Trans. AC 62, 2017), equations (13) and (18), here with W that may be singular and
with public observations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.alphas.barrier import MOST_SIGNALS, least_bits_by_barrier, most_error_by_barrier
from inscrutable.alphas.error_law import ErrorLaw, after_sensor, law_between, root_of
from inscrutable.alphas.extrapolation import Extrapolation
from inscrutable.alphas.observed import Moves
from inscrutable.alphas.over_time_bound import least_bits_bound, most_error_bound
from inscrutable.errors import SolverError
from inscrutable.validation import Array

_MOST_STEPS = 20_000
_MOST_STEPS_AT_ONE = 1000
"""At one multiplier. Of 150 problems of errors 5,000 leave 15 open instead of nine, in 1.3 times the time: below some price
an unstable belief has no fixed point. 250 leave one of 150 problems of bits open, 1,000 none."""
_MOST_TRIALS = 60
_FEW_SIGNALS = 60
"""Up to so many take the barrier method first for the largest error: it is faster (0.3 for 0.8 s at 22 signals, 2 for 3 s at
40, 11 for 13 s at 60, 138 for 39 s at 100), and leaves no gap above 1e-4 where prices leave nine in 150."""


def share_between(value: float, bound: float) -> float:
    """Return the difference of two numbers as a share of the larger; 1 where one alone is infinite."""
    if value == bound:
        return 0.0
    if not np.isfinite([value, bound]).all():
        return 1.0
    return float(abs(value - bound) / max(abs(value), abs(bound)))


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
        return share_between(self.value, self.bound)


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
    signals a barrier method follows.

    Raises:
        SolverError: No method converged, and the silence regret is infinite.

    Cost: some hundred to some thousand eigendecompositions of n×n matrices: some seconds for 100 signals. The barrier method
    takes O(n⁶): 2 s for 40 signals.
    """
    by_prices, by_barrier = (
        partial(method, moves, theta, limit) for method in (_least_bits_by_prices, _least_bits_inside)
    )
    return _best_of([by_prices, by_barrier] if len(theta) <= MOST_SIGNALS else [by_prices], limit)


def _best_of(methods: Sequence[Callable[[], LongRun]], limit: float) -> LongRun:
    """Return the rule of the first method that leaves no gap, or where none does, the one of smallest gap.

    A rule whose regret is above the limit counts as none: where a prediction has no variance in some direction, the barrier
    method's errors may grow without bound.

    Raises:
        SolverError: No method found a rule.
    """
    best: LongRun | None = None
    failure: SolverError | None = None
    for method in methods:
        try:
            found = method()
        except SolverError as error:
            failure = error
            continue
        if found.regret > limit * (1.0 + tolerances.OVER_TIME_GAP):
            failure = SolverError(f"a rule over time spends a regret of {found.regret:g} of {limit:g}")
            continue
        best = found if best is None or found.gap < best.gap else best
        if best.gap <= tolerances.OVER_TIME_GAP:
            break
    if best is None:
        assert failure is not None
        raise failure
    return best


def _least_bits_inside(moves: Moves, theta: Array, limit: float) -> LongRun:
    found = least_bits_by_barrier(moves, theta, limit)
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

    A barrier method finds it up to 60 signals. For more, the rule maximises the error minus a price ε of bits, such that all
    bits together cost a millionth of the error; all multipliers together take at most 20,000 steps. Where one method leaves a
    gap, up to 120 signals the other follows. Where Q is a multiple of Θ, all rules that spend the limit leave the same error,
    and the one of fewest bits is returned. For ties in some directions only, the barrier method returns some optimal rule, the
    price of bits one near the fewest bits.

    Raises:
        SolverError: Neither method converged, and the silence regret is infinite.

    Cost: the barrier method takes O(n⁶): 2 s for 40 signals, 11 s for 60. 100 signals take some thousand eigendecompositions
    of n×n matrices by prices, 40 s; more take at most 40,000.
    """
    rate = float(np.sum(weights * theta) / np.sum(theta * theta))
    if np.abs(weights - rate * theta).max() <= tolerances.COMMUTING * np.abs(weights).max():
        told = least_bits(moves, theta, limit)
        return LongRun(told.law, told.regret, rate * told.regret, rate * limit)
    by_prices, by_barrier = (
        partial(method, moves, theta, weights, limit) for method in (_by_prices, _most_error_inside)
    )
    if len(theta) > MOST_SIGNALS:
        return by_prices()
    methods = [by_barrier, by_prices] if len(theta) <= _FEW_SIGNALS else [by_prices, by_barrier]
    return _best_of(methods, limit)


def _most_error_inside(moves: Moves, theta: Array, weights: Array, limit: float) -> LongRun:
    found = most_error_by_barrier(moves, theta, weights, limit)
    error, bound = found.error, found.bound
    silence, regret = moves.silence(), float(np.sum(theta * error))
    if silence is not None:  # the part of the limit that the method leaves unspent
        error = error + (silence - error) * max(limit - regret, 0.0) / (float(np.sum(theta * silence)) - regret)
    law = law_between(root_of(moves.predicted(error)[0]), error)
    lost = _lost_in_accuracy(law, theta / limit, weights / found.value)
    if lost.any():
        error = replace(law, shares=np.where(lost, 0.0, law.shares)).covariance
        law = law_between(root_of(moves.predicted(error)[0]), error)
    value = law.weighed(weights)
    return LongRun(law, law.weighed(theta), value, max(bound, value))


def _lost_in_accuracy(law: ErrorLaw, *weights: Array) -> np.ndarray:
    """Return which shares are as good as zero: of their variance, and in tr(weights E), where the whole is about one.

    The barrier method ends at a small positive share where the optimum reveals a direction exactly.
    """
    sizes = [((each @ law.basis) * law.basis).sum(axis=0) for each in weights]
    return np.asarray(law.shares * np.max([np.ones(len(law.shares)), *sizes], axis=0) <= tolerances.SAME_RULE)


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
        error = float(np.trace(weights @ high.error)) or error  # an end that shows the belief leaves none
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


class _Image(NamedTuple):
    """What P, D and A_L become in one step."""

    error: Array
    before: Array
    ahead: Array
    moved: Array
    apart: float  # how much P and D change, relative to their size
    levels: Array
    dual: Array


def _image(goal: _Goal, cost: Array, point: tuple[Array, ...], spectrum: tuple[Array, Array]) -> _Image:
    """One step of the iteration, given the eigenvalues and eigenvectors of P."""
    (before, ahead, moved), (values, vectors) = point, spectrum
    root = np.sqrt(np.maximum(values, tolerances.NO_VARIANCE * values[-1]))
    half, inverse = (vectors * root) @ vectors.T, (vectors / root) @ vectors.T
    levels, turn = np.linalg.eigh(half @ (cost + moved.T @ ahead @ moved) @ half)
    basis, dual = half @ turn, turn.T @ inverse
    shares = np.where(levels > 0.5, 0.5 / np.maximum(levels, 0.5), 1.0)
    error = (basis * shares) @ basis.T
    after, moves = goal.moves.predicted(error)
    onwards = (dual.T * np.minimum(levels, 0.5)) @ dual
    apart = np.abs(inverse @ (after - before) @ inverse).max()
    apart += np.abs(half @ (onwards - ahead) @ half).max() / max(1.0, -levels[0])
    return _Image(error, after, onwards, moves, float(apart), levels, dual)


def _settled(goal: _Goal, price: float, before: Array, ahead: Array) -> _State | None:
    """Return the fixed point at a multiplier, starting from P and D; None where it is not reached."""
    cost, moved, size = goal.cost(price), goal.moves.predicted(before)[1], float(np.linalg.norm(before))
    scales = (size, max(float(np.linalg.norm(ahead)), 1.0 / size), 1.0)  # of P, D, A_L
    extrapolation = Extrapolation(2 * len(before), scales)
    point: tuple[Array, ...] = (before, ahead, moved)
    plain = point
    for _ in range(min(_MOST_STEPS_AT_ONE, goal.steps.left)):
        goal.steps.left -= 1
        values, vectors = np.linalg.eigh(point[0])
        # An extrapolation is taken where it leaves P ⪰ 0, and for bits alone D ⪰ 0.
        is_taken = point is plain or values[0] >= -tolerances.NO_VARIANCE * values[-1]
        image = _image(goal, cost, point, (values, vectors)) if is_taken else None
        if image is None or (point is not plain and goal.weights is None and image.levels[0] < 0.0):
            extrapolation.forget()
            point = plain
            continue
        # Where the multiplier is too low for a belief without a stationary law, P grows without end.
        if not np.trace(image.before) < np.trace(before) / tolerances.NO_VARIANCE:
            return None
        if image.apart <= tolerances.SETTLED:
            regret = float(np.sum(goal.theta * image.error))
            return _State(price, regret, image.error, image.before, image.ahead, image.levels, image.dual)
        plain = (image.before, image.ahead, image.moved)
        point = extrapolation.after(point, plain)
    return None  # the optimum is nearly discontinuous at this multiplier


def _first(goal: _Goal, price: float, before: Array, ahead: Array) -> _State:
    """Return a fixed point at a multiplier or above: below some multiplier a belief without a stationary law has none."""
    for _ in range(_MOST_TRIALS if goal.steps.left else 0):
        found = _settled(goal, price, before, ahead)
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
        found = _settled(goal, price, state.before, state.ahead)
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
        found = _settled(goal, low.price * float(np.exp(share * width)), start.before, start.ahead)
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
