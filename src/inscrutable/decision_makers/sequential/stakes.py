"""The observer's loss in the form that a step uses: points of the beliefs, and an estimate after every decision.

With points x_b and an estimate μ the observer loses g_b(μ) = |x_b|² − 2 x_b·μ + h(μ), h(μ) = |μ|², where it is the square error
that counts. A rival with answers 0 … A that each cost π·s(a) loses the same with h = 0, where μ are the shares of all answers
but the last, x_ba = (π_b·s(A) − π_b·s(a))/2, and g_b(0) what the last costs beyond its best one: g_b is linear in the shares.
Where a rival's answers are not finitely many, those are there that are best at a few means, and others join as steps need them.

A decision u_t that is shown at step t + d, the next one n steps later, is the latest that the observer knows of in steps
t + d … t + d + n − 1. Its mean loss in these, as a function of the law p of π_t after the decision, is

    L(p) = (1/n) Σ_j L_0(T'^j p),   j = d … d + n − 1:

again a loss of the same kind. Where everybody reads a symbol at every step, it is Σ_z L_0 of the law after each sequence z of j
symbols, p T_z1 … T_zj, times its probability. A rival has an answer for each of them; where there are more than
`_MOST_READINGS`, and of a square error, the loss of one who does not read them stands for it. That is no smaller; in 24 random
steps (six beliefs, two symbols, one or two steps late) it made the square error's step fall short of the best by .1 % of the
loss without decisions in the median, by 1.8 % at most.

Of a square error the points are y_b = (E[x_{t+j} | b])_j / √n, and there is besides what is uncertain whatever is known of b; a
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
"""Answers of a rival to what it may have read: a step takes as many times as long as with one."""


@dataclass(frozen=True, eq=False)
class Stakes:
    """Points of the beliefs and what goes with them."""

    points: Array  # x (B,d)
    base: Array  # g_b(0), (B,)
    spare: Array  # (B,): the loss that no present decision can reduce
    width: int  # shares of a rival's answers less one; 0 for the square error
    directions: Array  # (k,X): points are (π − centre)·directions where decisions are seen at once
    centre: Array  # (X,)
    rival: RivalAnswers | None = None  # whose answers are not finitely many

    def lost(self, joint: Array) -> Array:
        """Return L of the laws (n columns of B) that decisions leave, each times how often its decision comes: shape (n,)."""
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
        """Return what is lost under any decisions, from which a rival's loss is counted; 0 of a square error."""
        return float(law @ self.spare) if self.width else 0.0

    @property
    def pure(self) -> Array:
        """Each of a rival's answers, given whenever it is to answer: shape (A+1,d)."""
        single = np.vstack([np.zeros(self.width), np.eye(self.width)])
        return np.tile(single, (1, self.points.shape[1] // self.width))

    def begun(self, law: Array, least: float) -> Self:
        """Return the same with a rival's best answers to a law (B,), where one saves at least so much of its loss."""
        found = None if self.rival is None else self.rival.joined(law[:, None], least)
        return self if found is None else self._with(found.begun())

    def mixed(self, estimates: Array, first: Stakes) -> Stakes:
        """Return the first stakes, and with them a rival's answers that are mixed in estimates (n,d) of these."""
        if self.rival is None or first.rival is None:
            return first
        return first._with(self.rival.mixed(self._blocks(estimates), first.rival))

    def joined(self, joint: Array, least: float, estimates: Array | None) -> Self | None:
        """Return the same with a rival's best answers after decisions, of which one saves at least so much of its loss.

        Answers that joined before and are hardly mixed in the estimates (n,d) leave. None where no answer is missing.
        """
        found = (
            None
            if self.rival is None
            else self.rival.joined(joint, least, None if estimates is None else self._blocks(estimates))
        )
        return None if found is None else self._with(found)

    def _with(self, rival: RivalAnswers) -> Self:
        width = rival.costs.shape[1] - 1
        return replace(self, points=rival.points, width=width, directions=rival.directions, rival=rival)

    def _blocks(self, values: Array) -> Array:
        return values.reshape(*values.shape[:-1], -1, self.width)


def stakes_of(loss: Loss, chain: BeliefChain, schedule: Schedule) -> Stakes:
    """Return what the observer's loss makes of a chain's beliefs where decisions are seen by a schedule.

    Raises:
        InputError: The loss is that of a rival whose best answer is always the same.
    """
    prior = chain.prior
    if isinstance(loss, SquaredError):
        basis = np.linalg.svd(np.ones((1, prior.beliefs.shape[1])))[2][1:]  # orthonormal, in which beliefs differ
        points = (prior.beliefs - prior.mean) @ basis.T
        expected = _expected(np.hstack([points, (points**2).sum(axis=1)[:, None]]), chain, schedule)
        found = np.hstack([each[:, :-1] for each in expected]) / np.sqrt(len(expected))
        base = (found**2).sum(axis=1)
        spare = np.mean([each[:, -1] for each in expected], axis=0) - base
        if schedule.is_immediate:
            spare = np.zeros(len(points))
        return Stakes(found, base, np.maximum(spare, 0.0), 0, basis, prior.mean)
    assert isinstance(loss, DecisionLoss)
    rival = loss.rival(prior.beliefs.shape[1])
    made = (
        _finite_stakes(loss, rival, chain, schedule)
        if isinstance(rival, FiniteProblem)
        else _convex(loss, chain, schedule)
    )
    if not made.loss_of(prior.weights) - made.floor(prior.weights) > _rounding(made):
        raise InputError(
            "the rival's best answer is the same whatever it knows of the belief: nothing is hidden from it"
        )
    return made


def _finite_stakes(loss: Loss, rival: FiniteProblem, chain: BeliefChain, schedule: Schedule) -> Stakes:
    """The stakes of a rival with all its answers."""
    if rival.n_choices < 2:
        raise InputError(f"{loss!r} has one answer whatever it knows of the belief: nothing is hidden from it")
    costs, prior = rival.costs, chain.prior
    directions = 0.5 * (costs[:, -1:] - costs[:, :-1]).T
    expected = _all_expected(prior.beliefs @ np.vstack([directions, costs[:, -1]]).T, chain, schedule)
    found = np.hstack([each[:, :-1] for each in expected])
    base = np.maximum(2.0 * found.reshape(len(found), -1, len(directions)).max(axis=-1), 0.0).sum(axis=-1)
    spare = np.sum([each[:, -1] for each in expected], axis=0) - base
    return Stakes(found, base, spare, len(directions), directions, np.zeros(len(costs)))


def _convex(loss: DecisionLoss, chain: BeliefChain, schedule: Schedule) -> Stakes:
    """The stakes of a rival with the first of its answers."""
    prior = chain.prior
    first = RivalAnswers.of(loss, np.array(_all_expected(prior.beliefs, chain, schedule)), prior.weights)
    base = (first.expected @ first.costs[:, -1]).sum(axis=0) + first.common - first.spare
    width = first.costs.shape[1] - 1
    centre = np.zeros(prior.beliefs.shape[1])
    return Stakes(first.points, np.maximum(base, 0.0), first.spare, width, first.directions, centre, first)


def _rounding(stakes: Stakes) -> float:
    return 0.0 if stakes.rival is None else tolerances.NO_ERROR * float(np.abs(stakes.rival.costs).max())


def _all_expected(values: Array, chain: BeliefChain, schedule: Schedule) -> list[Array]:
    """What functions (B,k) of the belief are expected to be at each step in which a rival answers, and by all that it may have
    read by then: times its share of these steps, and the probability of what is read."""
    read = _read(values, chain, schedule)
    expected = _expected(values, chain, schedule) if read is None else read
    return [each / schedule.period for each in expected]


def _expected(values: Array, chain: BeliefChain, schedule: Schedule) -> list[Array]:
    """Return what functions (B,k) of the belief are expected to be at each step whose latest known decision is that of now."""
    found, step = [], values
    forward = sparse.csr_array(chain.transition)
    for number in range(schedule.lag + schedule.period):
        if number:
            step = forward @ step
        if number >= schedule.lag:
            found.append(step)
    return found


def _read(values: Array, chain: BeliefChain, schedule: Schedule) -> list[Array] | None:
    """Return the same for every sequence of public symbols, times its probability; None where nothing is read or too much."""
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
