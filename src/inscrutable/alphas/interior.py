"""The largest error over time as a semidefinite programme, by a structured primal-dual interior-point method.

With M = [A; H] and K = [I; 0], and J the joint covariance of innovation and public noise,

    max tr(QE)  over  E ⪰ 0,  S = J + M E M' − K E K' ⪰ 0,  s = r − tr(ΘE) ≥ 0;
    min μr + tr(ZJ)  over  Y = K'ZK − M'ZM + μΘ − Q ⪰ 0,  Z ⪰ 0,  μ ≥ 0.

Nesterov–Todd scaling makes E and Y one diagonal matrix, and S and Z another. The remaining equation for the step X of E is X +
T*T X + (μ/s) Θ tr(ΘX), T X = M X M' − K X K', with n(n+1)/2 unknowns: one Cholesky factor, used twice. Source: Todd, Toh,
Tütüncü, On the Nesterov–Todd direction in semidefinite programming (SIAM J. Optimization 8, 1998).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_discrete_lyapunov

from inscrutable import tolerances
from inscrutable.alphas.observed import Moves
from inscrutable.errors import SolverError
from inscrutable.validation import Array

MOST_SIGNALS = 120
"""Most signals; beyond, a step's factor takes more than 0.5 GB and 3 s (at 100 signals: 0.2 GB and 1 s)."""
_MOST_STEPS = 40
_TO_BORDER = 0.98
"""Largest step, as a share of the distance to the boundary of the cone."""


class _Point(NamedTuple):
    """E, Y, Z and μ."""

    error: Array
    shown: Array
    later: Array
    price: float


class _Step(NamedTuple):
    """Steps of E, S, Y and Z in their scaled coordinates, of s and of μ."""

    error: Array
    room: Array
    shown: Array
    later: Array
    spare: float
    price: float


class _Scaled(NamedTuple):
    """Scaling G with slack G diag(d) G' and multiplier G^{-T} diag(d) G^{-1} for the same d."""

    basis: Array
    dual: Array
    sizes: Array

    def reach(self, step: Array) -> float:
        """Return the largest step of diag(d) that stays positive semidefinite."""
        root = 1.0 / np.sqrt(self.sizes)
        least = float(np.linalg.eigvalsh(step * root * root[:, None])[0])
        return np.inf if least >= 0.0 else -1.0 / least

    def asked(self, target: float, corrected: Array) -> Array:
        """Return the sum of both steps for a linearised product `target`, with the second-order term `corrected`."""
        missing = np.diag(target - self.sizes**2) - _even(corrected)
        return np.asarray(2.0 * missing / (self.sizes[:, None] + self.sizes))


def _scaled(slack: Array, multiplier: Array) -> _Scaled:
    low, high = np.linalg.cholesky(slack), np.linalg.cholesky(multiplier)
    left, sizes, right = np.linalg.svd(high.T @ low)
    root = np.sqrt(sizes)
    return _Scaled(low @ (right.T / root), (left / root).T @ high.T, sizes)


def _even(matrix: Array) -> Array:
    return np.asarray(0.5 * (matrix + matrix.T))


@dataclass(frozen=True, eq=False)
class ErrorProgramme:
    """The constraints, and the objective tr(QE)."""

    moves: Moves
    theta: Array
    weights: Array
    limit: float

    @cached_property
    def rows(self) -> tuple[Array, Array, Array]:
        """M, K and J."""
        moves, n = self.moves, len(self.theta)
        joint = np.block([[moves.innovation, moves.cross], [moves.cross.T, moves.public_covariance]])
        return np.vstack([moves.transition, moves.public_sensor]), np.eye(len(joint))[:, :n], joint

    def room(self, error: Array) -> Array:
        """S."""
        both, kept, joint = self.rows
        return _even(joint + both @ error @ both.T - kept @ error @ kept.T)

    def spare(self, error: Array) -> float:
        """s."""
        return self.limit - float(np.sum(self.theta * error))

    def shown(self, later: Array, price: float) -> Array:
        """Return Y at Z and μ."""
        both, kept, _ = self.rows
        return _even(kept.T @ later @ kept - both.T @ later @ both + price * self.theta - self.weights)

    def start(self) -> _Point:
        """Return an interior point: E under a damped transition, Z from a Lyapunov equation.

        Raises:
            SolverError: The error of an observer without decisions is unbounded even under a damped transition.
        """
        moves, radius = self.moves, self.moves.radius
        fading = np.sqrt(min(0.9, 0.8 / radius**2)) if radius else 1.0
        faded = replace(
            moves, transition=fading * moves.transition, public_sensor=fading * moves.public_sensor
        ).silence()
        if faded is None:
            raise SolverError("the interior-point method for the rule over time found no point to start from")
        error = 0.5 * min(1.0, self.limit / float(np.sum(self.theta * faded))) * faded
        size, sensor = float(np.linalg.eigvalsh(self.weights)[-1]), moves.public_sensor
        heard = size / (float(np.sum(sensor**2)) or 1.0)
        alone = 3.0 * size * np.eye(len(error))
        if radius < 1.0 - tolerances.STABLE:
            alone = np.asarray(solve_discrete_lyapunov(moves.transition.T, alone))
        later = heard * np.eye(len(error) + len(sensor))
        later[: len(error), : len(error)] = alone
        price = float(np.sum(alone * moves.innovation)) / self.limit
        shown = self.shown(later, price)
        least = float(np.linalg.eigvalsh(shown)[0])
        return _Point(error, shown + max(0.0, size - least) * np.eye(len(error)), later, price)


def upper_matrix(products: Sequence[tuple[float, Array]], theta: Array, rate: float) -> Array:
    """Return the upper triangle of the matrix of X ↦ Σ s F X F' + rate · Θ tr(ΘX), for pairs s, F with as many F' as F.

    Its unknowns are the entries of X on and above the diagonal; those above count √2 times, so that the matrix is symmetric.
    """
    first, second = places = np.triu_indices(len(theta))
    twice = np.where(first == second, 1.0, np.sqrt(2.0))
    weighed = theta[places] * twice
    found = np.zeros((len(first), len(first)))
    columns = [(sign, each, each[:, first], each[:, second]) for sign, each in products]
    start = 0
    for i in range(len(theta)):  # rows (i, j) with j ≥ i; columns from (i, i) on
        end = start + len(theta) - i
        rows, scale = found[start:end, start:], twice[start:end, None] * twice[start:] / 2.0
        for sign, _, low, high in columns:
            rows += sign * low[i, start:] * high[i:, start:]
            rows += sign * high[i, start:] * low[i:, start:]
        rows *= scale
        rows += rate * weighed[start:end, None] * weighed[start:]
        start = end
    return found


class _Newton:
    """Scaled Newton equations at a point; one factor solves every right-hand side."""

    def __init__(self, programme: ErrorProgramme, point: _Point) -> None:
        both, kept, _ = programme.rows
        self.point, self.spare = point, programme.spare(point.error)
        self.error = _scaled(point.error, point.shown)
        self.room = _scaled(programme.room(point.error), point.later)
        basis, dual = self.error.basis, self.room.dual
        self._both, self._kept = dual @ both @ basis, dual @ kept @ basis
        self._theta = basis.T @ programme.theta @ basis
        self._missing = basis.T @ (programme.shown(point.later, point.price) - point.shown) @ basis
        self._rate = point.price / self.spare
        self.pairs = len(self.error.sizes) + len(self.room.sizes) + 1
        self._places = np.triu_indices(len(self._theta))
        self._twice = np.where(self._places[0] == self._places[1], 1.0, np.sqrt(2.0))
        self._factor: Any = cho_factor(self._matrix().T, lower=True, overwrite_a=True, check_finite=False)

    def _later(self, step: Array) -> Array:
        return np.asarray(self._both @ step @ self._both.T - self._kept @ step @ self._kept.T)

    def _earlier(self, step: Array) -> Array:
        return _even(self._both.T @ step @ self._both - self._kept.T @ step @ self._kept)

    def _matrix(self) -> Array:
        """Return the equations' matrix."""
        mixed = self._both.T @ self._kept
        products = (
            (1.0, self._both.T @ self._both), (1.0, self._kept.T @ self._kept), (-1.0, mixed), (-1.0, mixed.T),
        )  # fmt: skip
        found = upper_matrix(products, self._theta, self._rate)
        found[np.diag_indices(len(found))] += 1.0
        return found

    def _solved(self, right: Array) -> Array:
        found = np.zeros_like(right)
        found[self._places] = cho_solve(self._factor, right[self._places] * self._twice) / self._twice
        return np.asarray(found + np.triu(found, 1).T)

    def step(self, error: Array, room: Array, spare: float) -> _Step:
        """Return the step, given the sums of the scaled steps of E and Y, of S and Z, and of s and μ."""
        right = error - self._missing + self._earlier(room) - spare / self.spare * self._theta
        found = self._solved(right)
        again = found + self._earlier(self._later(found)) + self._rate * np.sum(self._theta * found) * self._theta
        found += self._solved(right - again)
        moved, spent = self._later(found), float(np.sum(self._theta * found))
        price = (spare + self.point.price * spent) / self.spare
        later = room - moved
        return _Step(found, moved, self._missing - self._earlier(later) + price * self._theta, later, -spent, price)

    def reach(self, step: _Step, share: float) -> tuple[float, float]:
        """Return the step lengths of slacks and of multipliers: at most one, and a share of the distance to the boundary."""
        spare = np.inf if step.spare >= 0.0 else -self.spare / step.spare
        price = np.inf if step.price >= 0.0 else -self.point.price / step.price
        slack = min(self.error.reach(step.error), self.room.reach(step.room), spare)
        return min(1.0, share * slack), min(
            1.0, share * min(self.error.reach(step.shown), self.room.reach(step.later), price)
        )

    @property
    def gap(self) -> float:
        """The duality gap: the sum of products of slacks and multipliers."""
        return float(np.sum(self.error.sizes**2) + np.sum(self.room.sizes**2)) + self.spare * self.point.price

    def gap_after(self, step: _Step, slack: float, multiplier: float) -> float:
        """Return the duality gap after a step."""
        sides = ((self.error.sizes, step.error, step.shown), (self.room.sizes, step.room, step.later))
        held = sum(
            float(np.sum((np.diag(size) + slack * one) * (np.diag(size) + multiplier * other)))
            for size, one, other in sides
        )
        return held + (self.spare + slack * step.spare) * (self.point.price + multiplier * step.price)

    def next(self) -> _Point:
        """Return the point after a Mehrotra predictor-corrector step."""
        point, level = self.point, self.gap / self.pairs
        ahead = self.step(-np.diag(self.error.sizes), -np.diag(self.room.sizes), -self.spare * point.price)
        target = level * min(1.0, self.gap_after(ahead, *self.reach(ahead, 1.0)) / self.gap) ** 3
        step = self.step(
            self.error.asked(target, ahead.error @ ahead.shown),
            self.room.asked(target, ahead.room @ ahead.later),
            target - self.spare * point.price - ahead.spare * ahead.price,
        )
        slack, multiplier = self.reach(step, _TO_BORDER)
        return _Point(
            _even(point.error + slack * self.error.basis @ step.error @ self.error.basis.T),
            _even(point.shown + multiplier * self.error.dual.T @ step.shown @ self.error.dual),
            _even(point.later + multiplier * self.room.dual.T @ step.later @ self.room.dual),
            point.price + multiplier * step.price,
        )


def most_error_inside(moves: Moves, theta: Array, weights: Array, limit: float) -> tuple[Array, float, Array]:
    """Return E, the price of regret and the multiplier of E ⪯ P(E) of max tr(QE) over 0 ⪯ E ⪯ P(E), tr(ΘE) ≤ limit.

    Raises:
        SolverError: There is no interior point to start from, or the primal and dual values did not meet.

    Cost: some 12 steps of O(n⁶) time and O(n⁴) memory: 2 s and 0.2 GB a step for 100 signals.
    """
    programme = ErrorProgramme(moves, theta, weights, limit)
    point, inside = programme.start(), None
    for _ in range(_MOST_STEPS):
        try:
            newton = _Newton(programme, point)
        except np.linalg.LinAlgError:  # rounding ends it
            break
        inside = point
        value = float(np.sum(weights * point.error))
        if newton.gap <= tolerances.INTERIOR_OVER_TIME * value:
            break
        point = newton.next()
    if inside is None:
        raise SolverError("an interior-point method for the rule over time found no interior")
    n = len(theta)
    return inside.error, inside.price, inside.later[:n, :n]
