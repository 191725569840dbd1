"""The observer's loss in the form that a step uses: points of the beliefs, and an estimate after every decision.

With points x_b and an estimate μ the observer loses g_b(μ) = |x_b|² − 2 x_b·μ + h(μ), with h(μ) = |μ|² for the square error. A
rival with answers 0 … A of expected costs π·s(a) has the same form with h = 0: μ are the probabilities of all answers but the
last, x_ba = (π_b·s(A) − π_b·s(a))/2, and g_b(0) is the last answer's cost above the best one; g_b is linear in μ. A rival with
infinitely many answers starts with the best ones at a few means, and others are added as steps need them.

A decision u_t that is shown at step t + d, the next one n steps later, is the latest that the observer knows of in steps
t + d … t + d + n − 1. Its mean loss in these, as a function of the law p of π_t after the decision, is

    L(p) = (1/n) Σ_j L_0(T'^j p),   j = d … d + n − 1:

again a loss of the same kind. With a public symbol at every step it is Σ_z L_0 of the law after each sequence z of j symbols,
p T_z1 … T_zj, times its probability. A rival has an answer for each of them. With more than `_MOST_READINGS` sequences, and
for the square error, the loss of an observer without the symbols replaces it, which is no smaller. In 24 random steps (six
beliefs, two symbols, one or two steps late) the step for the square error then fell short of the best by .1 % of the loss
without decisions in the median, by 1.8 % at most.

For the square error the points are y_b = (E[x_{t+j} | b])_j / √n, and the uncertainty that is left when b is known is added; a
rival has an answer for each j, with points (E[x_{t+j} | b])_j / n.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from scipy import sparse

from inscrutable import tolerances
from inscrutable.decision_makers.sequential.rival_answers import RivalAnswers
from inscrutable.errors import InputError
from inscrutable.mechanisms.calendars import Schedule
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.privacy import Loss, SquaredError
from inscrutable.privacy.losses import DecisionLoss
from inscrutable.problems import FiniteProblem
from inscrutable.validation import Array

_MOST_READINGS = 30
"""The most answers of a rival to sequences of symbols: the time of a step is proportional to their number."""


@dataclass(frozen=True, eq=False)
class Stakes:
    """Points of the beliefs and the loss on them."""

    points: Array  # x (B,d)
    base: Array  # g_b(0), (B,)
    spare: Array  # (B,): the loss that no present decision can reduce
    width: int  # number of a rival's answers minus one; 0 for the square error
    directions: Array  # (k,X): the coordinates of points, up to a shift, where decisions are disclosed at once
    rival: RivalAnswers | None = None  # a rival with infinitely many answers
    ignores_public: bool = False  # whether the loss is that of an observer without the public symbols

    def lost(self, joint: Array) -> Array:
        """Return L of the laws (n columns of B) after decisions, each times the probability of its decision: shape (n,)."""
        if self.rival is not None:
            return self.rival.lost(joint)
        sums = joint.T @ self.points
        if self.width:
            saved = np.maximum(2.0 * self._blocks(sums).max(axis=-1), 0.0).sum(axis=-1)
        else:
            played = joint.sum(axis=0)
            saved = (sums**2).sum(axis=1) / np.where(played > 0, played, 1.0)
        return np.asarray(joint.T @ (self.base + self.spare) - saved)

    def own(self, estimates: Array) -> Array:
        """Return h of estimates (n,d), shape (n,)."""
        return np.zeros(len(estimates)) if self.width else np.asarray((estimates**2).sum(axis=1))

    def gains(self, estimates: Array) -> Array:
        """Return g_b(μ) of estimates (n,d): shape (B,n)."""
        return np.asarray(self.base[:, None] - 2.0 * self.points @ estimates.T + self.own(estimates))

    def best(self, means: Array) -> Array:
        """Return the best estimates (n,d) for means (n,d) of the points."""
        if not self.width:
            return means
        blocks = self._blocks(means)
        chosen = (blocks == blocks.max(axis=-1, keepdims=True)) & (blocks > 0.0)
        first = chosen & (chosen.cumsum(axis=-1) == 1)
        return np.asarray(first.reshape(means.shape), dtype=np.float64)

    def barriers(self, estimates: Array, height: float) -> Array:
        """Return −height Σ log of the shares in estimates (n,d), shape (n,); 0 where there are none."""
        if not self.width or not estimates.shape[1]:
            return np.zeros(len(estimates))
        shares = self._blocks(estimates)
        shares = np.maximum(
            np.concatenate([shares, 1.0 - shares.sum(axis=-1, keepdims=True)], axis=-1), tolerances.TINY
        )
        return np.asarray(-height * np.log(shares).sum(axis=(-2, -1)))

    def loss_of(self, law: Array) -> float:
        """Return L(p) of a law (B,)."""
        return float(self.lost(law[:, None])[0])

    def floor(self, law: Array) -> float:
        """Return the loss under any decisions, from which a rival's loss is counted; 0 for the square error."""
        return float(law @ self.spare) if self.width else 0.0

    @property
    def pure(self) -> Array:
        """The pure strategies of a rival, each the same answer at every step: shape (A+1,d)."""
        single = np.vstack([np.zeros(self.width), np.eye(self.width)])
        return np.tile(single, (1, self.points.shape[1] // self.width))

    def begun(self, law: Array, least: float) -> Self:
        """Return the same with a rival's best answers to a law (B,), where these save more than `least` of its loss."""
        found = None if self.rival is None else self.rival.joined(law[:, None], least)
        return self if found is None else self._with(found.begun())

    def answering(self, beliefs: Array) -> tuple[Self, Array]:
        """Return the same with a rival's answers to beliefs (n,J,X) after n decisions, and these as estimates (n,d)."""
        assert self.rival is not None
        found, own = self.rival.answering(beliefs)
        return self._with(found), own.reshape(len(beliefs), -1)

    def mixed(self, estimates: Array, first: Stakes) -> Stakes:
        """Return the `first` stakes, with those of this rival's answers that have a probability in estimates (n,d)."""
        if self.rival is None or first.rival is None:
            return first
        return first._with(self.rival.mixed(self._blocks(estimates), first.rival))

    def joined(self, joint: Array, least: float) -> Self | None:
        """Return the same with a rival's best answers to decisions, where these save more than `least` of its loss; None where
        no answer is missing."""
        found = None if self.rival is None else self.rival.joined(joint, least)
        return None if found is None else self._with(found)

    def widened(self, estimates: Array, width: int) -> Array:
        """Return mixed answers (n,d) of stakes with the first `width` of these answers, in these coordinates."""
        blocks = estimates.reshape(len(estimates), -1, width)
        return np.pad(blocks, ((0, 0), (0, 0), (0, self.width - width))).reshape(len(estimates), -1)

    def _with(self, rival: RivalAnswers) -> Self:
        width = rival.costs.shape[1] - 1
        return replace(self, points=rival.points, width=width, directions=rival.directions, rival=rival)

    def _blocks(self, values: Array) -> Array:
        return values.reshape(*values.shape[:-1], -1, self.width)


def stakes_of(loss: Loss, chain: BeliefChain, schedule: Schedule) -> Stakes:
    """Return the points and loss of a chain's beliefs where decisions are disclosed by a schedule.

    Raises:
        InputError: The loss is that of a rival whose best answer is always the same.
    """
    prior, is_late = chain.prior, chain.public is not None and not schedule.is_immediate
    if isinstance(loss, SquaredError):
        basis = np.linalg.svd(np.ones((1, prior.beliefs.shape[1])))[2][1:]  # orthonormal, in which beliefs differ
        points = (prior.beliefs - prior.mean) @ basis.T
        expected = _expected(np.hstack([points, (points**2).sum(axis=1)[:, None]]), chain, schedule)
        found = np.hstack([each[:, :-1] for each in expected]) / np.sqrt(len(expected))
        base = (found**2).sum(axis=1)
        spare = np.mean([each[:, -1] for each in expected], axis=0) - base
        if schedule.is_immediate:
            spare = np.zeros(len(points))
        return Stakes(found, base, np.maximum(spare, 0.0), 0, basis, ignores_public=is_late)
    assert isinstance(loss, DecisionLoss)
    rival = loss.rival(prior.beliefs.shape[1])
    made = (
        _finite_stakes(loss, rival, chain, schedule)
        if isinstance(rival, FiniteProblem)
        else _convex(loss, chain, schedule)
    )
    if made.width == 0 or not made.loss_of(prior.weights) - made.floor(prior.weights) > _rounding(made):
        raise InputError("the rival's best answer is the same under every belief: a hidden belief costs it nothing")
    return replace(made, ignores_public=is_late and _read(prior.beliefs[:, :1], chain, schedule) is None)


def _finite_stakes(loss: Loss, rival: FiniteProblem, chain: BeliefChain, schedule: Schedule) -> Stakes:
    """The stakes of a rival with all its answers."""
    if rival.n_choices < 2:
        raise InputError(f"{loss!r} has one best answer under every belief: a hidden belief costs it nothing")
    costs, prior = rival.costs, chain.prior
    directions = 0.5 * (costs[:, -1:] - costs[:, :-1]).T
    expected = _all_expected(prior.beliefs @ np.vstack([directions, costs[:, -1]]).T, chain, schedule)
    found = np.hstack([each[:, :-1] for each in expected])
    base = np.maximum(2.0 * found.reshape(len(found), -1, len(directions)).max(axis=-1), 0.0).sum(axis=-1)
    spare = np.sum([each[:, -1] for each in expected], axis=0) - base
    return Stakes(found, base, spare, len(directions), directions)


def _convex(loss: DecisionLoss, chain: BeliefChain, schedule: Schedule) -> Stakes:
    """The stakes of a rival with the first of its answers."""
    prior = chain.prior
    first = RivalAnswers.of(loss, np.array(_all_expected(prior.beliefs, chain, schedule)), prior.weights)
    base = (first.expected @ first.costs[:, -1]).sum(axis=0) + first.common - first.spare
    width = first.costs.shape[1] - 1
    return Stakes(first.points, np.maximum(base, 0.0), first.spare, width, first.directions, first)


def _rounding(stakes: Stakes) -> float:
    return 0.0 if stakes.rival is None else tolerances.NO_ERROR * float(np.abs(stakes.rival.costs).max())


def _all_expected(values: Array, chain: BeliefChain, schedule: Schedule) -> list[Array]:
    """Expected functions (B,k) of the belief at each step in which a rival answers and after each sequence of symbols until
    then, times the step's share and the sequence's probability."""
    read = _read(values, chain, schedule)
    expected = _expected(values, chain, schedule) if read is None else read
    return [each / schedule.period for each in expected]


def _expected(values: Array, chain: BeliefChain, schedule: Schedule) -> list[Array]:
    """Return the expected functions (B,k) of the belief at each step whose latest known decision is the present one."""
    found, step = [], values
    forward = sparse.csr_array(chain.transition)
    for number in range(schedule.lag + schedule.period):
        if number:
            step = forward @ step
        if number >= schedule.lag:
            found.append(step)
    return found


def _read(values: Array, chain: BeliefChain, schedule: Schedule) -> list[Array] | None:
    """Return the same for every sequence of public symbols, times its probability; None without symbols or with too many."""
    if chain.public is None or schedule.is_immediate:
        return None
    tables: list[Any] = [sparse.csr_array(each) for each in chain.public]
    found: list[Array] = []
    step = [values]
    for number in range(schedule.lag + schedule.period):
        if number:
            if len(found) + len(step) * len(tables) > _MOST_READINGS:
                return None
            step = [table @ each for table in tables for each in step]
        if number >= schedule.lag:
            found += step
    return found
