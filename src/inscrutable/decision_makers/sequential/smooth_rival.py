"""A step of a sequential rule against a rival whose best answer is one decision and moves smoothly with its belief.

After decision m the rival answers as if it held beliefs y_m, at the costs s(y) = ∇V(y) of its best answers. With its costs
A_bm = e_b·s(y_m) under belief b the step is the saddle point of

    Φ(y) = max_{q ≥ 0} Σ_b p_b log Σ_m q_m e^{(A_bm − s ρ_bm)/λ} − Σ_m q_m,        min over y_m,

where y_m is the mean of e under the law of b after m. Φ is convex in s(y), so that Newton's steps in y, with the curvature
C = −∇²V by differences of s, need few answers of the rival: with w_m its weight and Y_m = Σ_b p_b K_bm e_b,

    (w I + λ H C) dy = Y − w y,        H = ∂²Φ/∂s².

A rival whose best answer jumps is left to `RivalAnswers`: there the steps end without the optimum, and the gap says so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from inscrutable import tolerances
from inscrutable.kernels.rounding import LEAST_SUM
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_STEPS, _ROUNDS = 30, 40  # four and three are usual
_PRICING_STEPS = 40
"""Most steps for the rival's answer to one decision; with 15 or 120, 24 portfolio rivals take as long."""
_CUT = 0.3
"""A step that does not help is cut to this share; 24 portfolio rivals take 1.5 times as long with .1, as long with .5."""
_ADDED, _TRIED = 8, 120
"""Decisions that enter at once, and that are priced at once. Of 13 portfolio rivals at a small price of information, 2 are
left unsolved; with 5 and 60, four, in twice the time; with 2 or 30, steps take 1.3 to 2.5 times as long."""
_SURE, _CERTAIN = 0.1, 0.9
"""Shares of a decision's gain at which its pricing ends: the change by a further step, and the loss to a better answer; with a
tenth or five times of the first, or .1 for the second, 30 portfolio rivals take as long."""
_STEEPEST = 690.0  # the exponent of the largest term of a sum
_LAST = 0.01  # slope of the last step, in units of the gain to which decisions are priced; with .001 and .1 as long
_BISECTIONS = 26  # with 13 and 40 as long
_WAYS, _RATIO = 3, 0.25
"""Continuations from ever larger prices of information, where steps stall, and the ratio of a price to the one before. With
one continuation, one of nine steps at a hundredth of the prior loss stays unsolved; with nine, or ratios of .08 and .5, all of
33 are solved; at three hundredths in the same time."""


class ActedOn(NamedTuple):
    """Decisions that are played (n,), their law, the beliefs (n,J,X) a rival then acts on, and the largest log c of others."""

    numbers: np.ndarray
    law: Array
    beliefs: Array
    excess: float = np.inf

    def joined(self, others: ActedOn) -> ActedOn:
        """Return these and other decisions."""
        both = zip(self[:3], others[:3], strict=True)
        numbers, law, beliefs = (np.concatenate(each) for each in both)
        return ActedOn(numbers, law, beliefs, self.excess)


class _Point(NamedTuple):
    """Decisions, the rival's answers to them, and the best law."""

    numbers: np.ndarray
    beliefs: Array  # y (n,J,X)
    costs: Array  # s(y)
    curves: Array  # C (n,J,X,X)
    value: float  # Φ
    law: Array  # (n,)
    ratios: Array  # e^a / z (n,B)
    logs: Array  # log p − log z (B,)

    @property
    def found(self) -> ActedOn:
        return ActedOn(self.numbers, self.law, self.beliefs)


class _Answers(NamedTuple):
    """Beliefs (K,J,X) and the costs of the best answers to them."""

    beliefs: Array
    costs: Array

    def joined(self, beliefs: Array, costs: Array) -> _Answers:
        return _Answers(np.concatenate([self.beliefs, beliefs]), np.concatenate([self.costs, costs]))


@dataclass(frozen=True, eq=False)
class SmoothRival:
    """A rival, the beliefs e (J,B,X) that it holds under each belief of the agent, and the offers −s ρ / λ (M,B)."""

    rival: DecisionProblem
    expected: Array
    offers: Array
    price: float

    def solved(self, weights: Array, constant: np.ndarray, near: ActedOn | None, first_price: float) -> ActedOn:
        """Return the step under a law (B,) of the belief, from decisions that all beliefs can play, or from a similar one.

        A small price of information is reached from `first_price`, unless the similar step leads there.
        """
        some = weights > 0
        if not some.all():
            few = replace(self, expected=self.expected[:, some], offers=self.offers[:, some])
            return few.solved(weights[some], constant, near, first_price)
        mean = _normal(np.einsum("b,jbx->jx", weights, self.expected))
        n = len(constant)
        begun = ActedOn(constant, np.full(n, 1.0 / n), np.tile(mean, (n, 1, 1)))
        if n == 1:
            only = self._at(weights, begun)
            excess, _, _ = self._entering(weights, only, _Answers(only.beliefs, only.costs))
            if excess <= tolerances.KEPT_DECISION:
                return begun._replace(excess=excess)
        if near is not None:
            found = self._at_price(weights, near)
            if found.excess <= tolerances.KEPT_DECISION:
                return found
        highest = max(first_price / self.price, 1.0)
        for _ in range(_WAYS):
            times, found = highest, begun
            while times > 1.0:
                found = replace(self, offers=self.offers / times, price=self.price * times)._at_price(weights, found)
                times *= _RATIO
            found = self._at_price(weights, found)
            if found.excess <= tolerances.KEPT_DECISION:
                break
            highest /= _RATIO**2  # Newton's steps stalled: start at a larger price
        return found

    def similar(self, weights: Array, numbers: np.ndarray, rows: Array) -> ActedOn:
        """Return where to start from rows (B,n) of a step under another law."""
        joint = weights[:, None] * rows
        played = joint.sum(axis=0)
        kept = np.flatnonzero(played > tolerances.RARELY_PLAYED)
        return ActedOn(numbers[kept], played[kept], _normal(np.einsum("bn,jbx->njx", joint[:, kept], self.expected)))

    def _at_price(self, weights: Array, start: ActedOn) -> ActedOn:
        """The step at this price of information: decisions enter until none gains, or the same ones enter again in vain."""
        found, nothing, rounds = start, np.empty((0, *start.beliefs.shape[1:])), set[tuple[frozenset[int], ...]]()
        known = _Answers(nothing, nothing)
        for _ in range(_ROUNDS):
            point, is_settled = self._settled(weights, found)
            excess, joining, known = self._entering(weights, point, known.joined(point.beliefs, point.costs))
            found = point.found._replace(excess=excess if is_settled else np.inf)
            if joining is None:
                break
            now = frozenset(point.numbers.tolist()), frozenset(joining.numbers.tolist())
            if is_settled and now in rounds:
                break
            rounds.add(now)
            found = found.joined(joining)
        return found

    def _at(self, weights: Array, start: ActedOn) -> _Point:
        """The best law of some decisions, given the rival's answers to beliefs."""
        from inscrutable.kernels.sequential_estimates import StepData
        from inscrutable.kernels.sequential_saddle import Point, law_of

        n, count = len(start.numbers), weights.size
        costs, curves = self._curved(start.beliefs)
        values = np.ascontiguousarray(self.offers[start.numbers] + self._paid(costs))
        data = StepData(np.empty((0, count)), values, np.empty((n, 0)), 1.0, 1.0, 0, 0.0)
        room = np.empty((n, count)), np.empty((n, count)), np.empty(count), np.empty(count)
        law = np.maximum(start.law, tolerances.RETURNING_LAW)
        point = Point(law, np.empty((n, 0)), *room)
        value = float(law_of(np.array(weights), data, point))  # the kernel is compiled for arrays that may be written
        logs = np.log(weights) - point.top - np.log(point.held)
        return _Point(start.numbers, start.beliefs, costs, curves, value, point.law, point.ratios, logs)

    def _curved(self, beliefs: Array) -> tuple[Array, Array]:
        """s(y) and C = −∇²V(y) of beliefs (…,X)."""
        n_states, step = beliefs.shape[-1], tolerances.CURVATURE_STEP
        ahead = (1.0 - step) * beliefs[..., None, :] + step * np.eye(n_states)
        near = np.concatenate([beliefs[..., None, :], ahead], axis=-2)
        flat = near.reshape(-1, n_states)
        costs = np.asarray(self.rival.state_costs(self.rival.solve(flat))).reshape(near.shape)
        slopes = (costs[..., :1, :] - costs[..., 1:, :]) / step
        return costs[..., 0, :], 0.5 * (slopes + slopes.swapaxes(-1, -2))

    def _paid(self, costs: Array) -> Array:
        """A / λ of answers (n,J,X), shape (n,B)."""
        return np.asarray(self._flat @ costs.reshape(len(costs), self._flat.shape[1]).T).T / self.price

    @cached_property
    def _flat(self) -> Array:
        """e (B,J X)."""
        return np.hstack(list(self.expected))

    def _settled(self, weights: Array, start: ActedOn) -> tuple[_Point, bool]:
        """The saddle point on some decisions, by Newton's steps, and whether they ended there."""
        point, is_last = self._at(weights, start), False
        for _ in range(_STEPS):
            unused = np.flatnonzero(point.law <= tolerances.RARELY_PLAYED)
            if unused.size:  # changes no value, and tells whether the decision could be played
                beliefs = point.beliefs.copy()
                _, beliefs[unused], _ = self._least_gains(point.logs, point.numbers[unused], beliefs[unused])
                point = self._at(weights, ActedOn(point.numbers, point.law, beliefs))
            step, slope = self._newton(weights, point)
            is_flat = slope > -_LAST * tolerances.SOLVED_STEP
            ahead = self._ahead(weights, point, step, slope)
            if ahead is None:  # C is another one as soon as the answer changes
                ahead = self._ahead(weights, point, *self._to_means(weights, point))
            point = point if ahead is None else ahead
            if is_flat:
                ahead, is_last = self._beyond(weights, point)
                if ahead is not None:
                    point = ahead
            if ahead is None or is_last:
                break
        kept = point.law > tolerances.RARELY_PLAYED
        if not kept.all():
            point = self._at(weights, ActedOn(point.numbers[kept], point.law[kept], point.beliefs[kept]))
        return point, is_last

    def _to_means(self, weights: Array, point: _Point) -> tuple[Array, float]:
        """The step from y to the mean beliefs after the decisions, and the slope of Φ along it: Φ falls whatever C is."""
        sums = np.einsum("nb,jbx->njx", weights * point.law[:, None] * point.ratios, self.expected)
        held = np.maximum(sums.sum(axis=-1, keepdims=True), tolerances.TINY)
        step = np.where(point.law[:, None, None] > tolerances.RARELY_PLAYED, sums / held - point.beliefs, 0.0)
        return step, -float((sums * np.einsum("njxy,njy->njx", point.curves, step)).sum()) / self.price

    def _beyond(self, weights: Array, point: _Point) -> tuple[_Point | None, bool]:
        """Another point where Φ has no slope, and whether this is the optimum.

        Where the rival's answer is the same near y it has none, although the best answer to the mean after the decision is
        another: y then moves towards that mean until the answer changes, by bisection.
        """
        sums = np.einsum("nb,jbx->njx", weights * point.law[:, None] * point.ratios, self.expected)
        played = np.flatnonzero(point.law > tolerances.RARELY_PLAYED)
        means, beliefs, costs = _normal(sums[played]), point.beliefs[played], point.costs[played]
        gaps = (sums[played] * (costs - self._curved(means)[0])).sum(axis=-1) / self.price
        if gaps.sum() <= tolerances.KEPT_DECISION:
            return None, True
        whole = point.beliefs.copy()
        whole[played] = np.where((gaps > _SURE * gaps.max())[..., None], self._changing(beliefs, means, costs), beliefs)
        found = self._at(weights, ActedOn(point.numbers, point.law, whole))
        return (found if found.value < point.value + tolerances.SOLVED_STEP else None), False

    def _changing(self, beliefs: Array, means: Array, costs: Array) -> Array:
        """Where, from beliefs (n,J,X) to others, the best answers begin to differ from the first ones."""
        size = tolerances.NO_ERROR * float(np.abs(costs).max(initial=0.0))
        low, high = np.zeros(beliefs.shape[:-1]), np.ones(beliefs.shape[:-1])
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            tried = beliefs + middle[..., None] * (means - beliefs)
            moved = np.abs(self._curved(tried)[0] - costs).max(axis=-1) > size
            low, high = np.where(moved, low, middle), np.where(moved, middle, high)
        return np.asarray(beliefs + high[..., None] * (means - beliefs))

    def _ahead(self, weights: Array, point: _Point, step: Array, slope: float) -> _Point | None:
        """The point after a step that is cut until Φ falls; None where none does."""
        length = 1.0
        while length > tolerances.SHORTEST_STEP:
            beliefs = _normal(np.maximum(point.beliefs + length * step, 0.0))
            found = self._at(weights, ActedOn(point.numbers, point.law, beliefs))
            if found.value <= point.value + tolerances.LEAST_FALL * length * slope + tolerances.SADDLE_ROUNDING * abs(
                point.value
            ):
                return found
            length *= _CUT
        return None

    def _newton(self, weights: Array, point: _Point) -> tuple[Array, float]:
        """The step dy (n,J,X), and the slope of Φ along it.

        It is the saddle point of Φ to second order over t = −B^{-1} ds and q ≥ 0, with B = (C/w)^½.
        """
        flat, ratios = self._flat, weights * point.ratios
        n, size = len(point.law), flat.shape[1]
        rows = np.maximum(point.law, tolerances.SEEN_DECISION)[:, None] * point.ratios
        moves = (rows.T[:, :, None] * flat[:, None, :]).reshape(weights.size, n * size)
        hessian, mixed = -(moves.T * weights) @ moves, -ratios @ moves
        for m in range(n):
            own = slice(m * size, (m + 1) * size)
            hessian[own, own] += (flat.T * (weights * rows[m])) @ flat
            mixed[m, own] += ratios[m] @ flat
        beliefs, curves = (each.reshape(-1, *each.shape[2:]) for each in (point.beliefs, point.curves))
        sums = ((weights * rows) @ flat).reshape(beliefs.shape)
        held = np.maximum(sums.sum(axis=-1, keepdims=True), tolerances.TINY)
        apart = (sums - held * beliefs).reshape(-1)
        roots = _roots(curves, held)
        hessian /= self.price
        system = roots @ hessian @ roots + np.eye(len(apart))
        turned, gradient = mixed @ roots, roots @ apart
        solved = np.linalg.solve(system, np.column_stack([gradient, turned.T]))
        curved = ratios @ point.ratios.T + turned @ solved[:, 1:] / self.price
        right = ratios.sum(axis=1) - 1.0 - turned @ solved[:, 0] / self.price + curved @ point.law
        change = _positive(curved, right) - point.law
        found = solved[:, 0] + solved[:, 1:] @ change
        ahead = (apart + mixed.T @ change - hessian @ (roots @ found)).reshape(beliefs.shape) / held
        step = (ahead - ahead.sum(axis=-1, keepdims=True) * beliefs).reshape(point.beliefs.shape)  # C y = 0
        step[ratios.sum(axis=1) <= tolerances.RARELY_PLAYED] = (
            0.0  # rounding: next to nothing of it is played after the step
        )
        shares = np.repeat(
            point.law / np.maximum(point.law, tolerances.SEEN_DECISION), size
        )  # Φ depends on answers to played decisions alone
        return step, -float((roots @ (shares * apart)) @ found) / self.price

    def _entering(self, weights: Array, point: _Point, known: _Answers) -> tuple[float, ActedOn | None, _Answers]:
        """The largest log c of a decision that is not played, those that enter, and all answers that are known then.

        At any answer log c is at most too large, so that the least over known ones tells which decisions to price.
        """
        gains = np.full(len(self.offers), np.inf)
        while True:
            gains, best = self._bounded(gains, self._paid(known.costs) + point.logs)
            gains[point.numbers] = -np.inf
            tried = np.argsort(-gains)[:_TRIED]
            tried = tried[gains[tried] > tolerances.SOLVED_STEP]
            if not tried.size:
                return max(float(gains.max()), 0.0), None, known
            gains[tried], beliefs, costs = self._least_gains(point.logs, tried, known.beliefs[best[tried]])
            known = known.joined(beliefs, costs)
            chosen = np.argsort(-gains[tried])[:_ADDED]
            chosen = chosen[gains[tried[chosen]] > tolerances.SOLVED_STEP]
            if chosen.size:
                law = np.full(len(chosen), tolerances.NEW_DECISION)
                return float(gains.max()), ActedOn(tried[chosen], law, beliefs[chosen]), known

    def _bounded(self, gains: Array, paid: Array) -> tuple[Array, np.ndarray]:
        """The least of bounds (M,) and of log c at some answers, from log p + A / λ − log z (K,B), and which answer is best."""
        tops = paid.max(axis=0)
        heights = self.offers + tops
        # The largest factor of each sum is one, so that no sum overflows.
        peaks = np.maximum(heights.max(axis=1), -_STEEPEST)
        sums = np.exp(heights - peaks[:, None]) @ np.exp(paid - tops).T
        best = sums.argmin(axis=1)
        least = np.maximum(sums[np.arange(len(sums)), best], LEAST_SUM)
        return np.minimum(gains, peaks + np.log(least)), best

    def _least_gains(self, logs: Array, numbers: np.ndarray, beliefs: Array) -> tuple[Array, Array, Array]:
        """Least log c (n,) of decisions over the rival's answers, from those to beliefs (n,J,X): with its beliefs and costs.

        Where it is surely positive it is left at some tenths above.
        """
        offers, shape, n = self.offers[numbers] + logs, beliefs.shape, len(numbers)
        beliefs, steps, costs = beliefs.copy(), np.zeros(shape), np.empty(shape)
        gains, slopes, lengths, some = np.full(n, np.inf), np.zeros(n), np.ones(n), np.arange(n)
        done = np.zeros(n, dtype=bool)
        for _ in range(_PRICING_STEPS):
            trial = _normal(np.maximum(beliefs[some] + lengths[some, None, None] * steps[some], 0.0))
            fresh, curves = self._curved(trial)
            reached, shares = _shares(offers[some] + self._paid(fresh))
            falls = (
                reached
                <= gains[some] + tolerances.LEAST_FALL * lengths[some] * slopes[some] + _LAST * tolerances.SOLVED_STEP
            )
            lengths[some] *= _CUT
            k, shares, curves = some[falls], shares[falls], curves[falls]
            beliefs[k], costs[k], gains[k], means = trial[falls], fresh[falls], reached[falls], shares @ self._flat
            squares = (shares @ self._squares).reshape(len(k), means.shape[1], means.shape[1])
            hessians = (squares - means[:, :, None] * means[:, None, :]) / self.price
            steps[k], slopes[k] = _stepped(hessians, means.reshape(beliefs[k].shape), beliefs[k], curves, self.price)
            lengths[k] = 1.0
            least = tolerances.SOLVED_STEP
            ends = (slopes[k] > -np.maximum(_LAST * least, _SURE * gains[k])) & (gains[k] > least)
            done[k] = ends
            if ends.any():  # Newton's model is of the answers near y alone: the gap counts all of them
                k, sums = k[ends], means[ends].reshape(beliefs[k[ends]].shape)
                gaps = (sums * (costs[k] - self._curved(_normal(sums))[0])).sum(axis=(1, 2)) / self.price
                done[k] = gaps <= np.maximum(least, _CERTAIN * gains[k])
                flat = ~done[k] & (slopes[k] > -_LAST * least)
                k, sums = k[flat], sums[flat]
                if k.size:
                    beliefs[k], steps[k] = self._changing(beliefs[k], _normal(sums), costs[k]), 0.0
            done |= (gains <= least) | (lengths < tolerances.SHORTEST_STEP)
            some = np.flatnonzero(~done)
            if not some.size:
                break
        return gains, beliefs, costs

    @cached_property
    def _squares(self) -> Array:
        """e e' (B,J X J X), flat."""
        return np.asarray((self._flat[:, :, None] * self._flat[:, None, :]).reshape(len(self._flat), -1))


def _stepped(hessian: Array, sums: Array, beliefs: Array, curves: Array, price: float) -> tuple[Array, Array]:
    """Newton's steps dy of beliefs (n,J,X) for one decision each, with λ H (n,J X,J X), Y and C, and the slopes (n,)."""
    held = sums.sum(axis=-1, keepdims=True)
    apart, whole = sums - held * beliefs, _roots(curves, held)
    curved = hessian @ whole
    right = whole @ apart.reshape(*hessian.shape[:-1], 1)
    found = np.linalg.solve(whole @ curved + np.eye(hessian.shape[-1]), right)
    step = (apart - (curved @ found).reshape(sums.shape)) / held
    return step - step.sum(axis=-1, keepdims=True) * beliefs, -(right * found).sum(axis=(-1, -2)) / price


def _roots(curves: Array, held: Array) -> Array:
    """(C/w)^½ of blocks C (…,K,X,X) as one matrix (…,K X,K X)."""
    count, n_states = curves.shape[-3:-1]
    sizes, axes = np.linalg.eigh(curves)
    blocks = (axes * np.sqrt(np.maximum(sizes, 0.0) / held)[..., None, :]) @ axes.swapaxes(-1, -2)
    whole = np.zeros((*curves.shape[:-3], count * n_states, count * n_states))
    for k in range(count):
        own = slice(k * n_states, (k + 1) * n_states)
        whole[..., own, own] = blocks[..., k, :, :]
    return whole


def _positive(curved: Array, right: Array) -> Array:
    """max right·q − ½ q'Aq over q ≥ 0."""
    sizes, axes = np.linalg.eigh(curved)
    kept = sizes > tolerances.LAW_RESIDUAL * sizes.max()  # some decisions may be alike
    roots = np.sqrt(sizes[kept])
    return np.asarray(nnls(roots[:, None] * axes[:, kept].T, (axes[:, kept].T @ right) / roots)[0])


def _shares(logs: Array) -> tuple[Array, Array]:
    """log Σ e^x of every row (n,B), and the shares of the sum."""
    top = logs.max(axis=1, keepdims=True)
    powers = np.exp(logs - top)
    whole = powers.sum(axis=1, keepdims=True)
    return np.asarray((top + np.log(whole))[:, 0]), powers / whole


def _normal(sums: Array) -> Array:
    """Beliefs from sums (…,X) of positive entries."""
    return np.asarray(sums / sums.sum(axis=-1, keepdims=True))
