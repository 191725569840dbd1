"""Rules over time by a barrier method: the largest error, and the fewest bits where an iteration in prices leaves a gap.

With M = [A; H], K = [I; 0] and J the joint covariance of innovation and public noise, both costs are convex in E:

    nats        f(E) = ½ log det(J + MEM') − ½ log det(R + HEH') − ½ log det E,
    less error  f(E) = −tr(QE).

At a level τ Newton's method minimises f(E) − τ (log det S + log s), for the error also − τ log det E, where S = J + MEM' − KEK'
and s = r − tr(ΘE). Then τS⁻¹ and τ/s are nearly the multipliers of S ⪰ 0 and s ≥ 0, and the cost exceeds the least one by at
most τ times the order of S plus one, for the error plus that of E. Source: Boyd and Vandenberghe, Convex Optimization (2004),
section 11.3.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from inscrutable import tolerances
from inscrutable.alphas.observed import Moves
from inscrutable.alphas.over_time_bound import least_bits_bound, most_error_bound
from inscrutable.errors import SolverError
from inscrutable.validation import Array

MOST_SIGNALS = 120
"""Most signals: a step's factor for 100 signals takes 0.2 GB and 2 s."""
_LEVELS = 0.05 ** np.arange(10.0)
"""τ in units of the cost: a gap of 1e-10 at the last. With tenths 40 problems of both costs take 1.3 times as many steps, with
fiftieths .9 times, and their largest gap is twice as large."""
_MOST_STEPS = 40
_ENOUGH, _MOST_HALVINGS = 0.1, 40
"""Share of the promised decrease that a step makes at least, or it is halved. Below this share of τ a promised decrease is lost
in rounding, and whole steps converge by themselves."""

Products = tuple[tuple[float, Array], ...]


class Inside(NamedTuple):
    """E, its bits or its tr(QE), and a bound of those of every rule."""

    error: Array
    value: float
    bound: float


class _Barrier:
    """The constraints, and how much a rule leaks."""

    unit = 1.0
    """Size of the cost."""

    def __init__(self, moves: Moves, theta: Array, limit: float) -> None:
        self.moves, self.theta, self.limit = moves, theta, limit
        joint = np.block([[moves.innovation, moves.cross], [moves.cross.T, moves.public_covariance]])
        self.rows = np.vstack([moves.transition, moves.public_sensor]), np.eye(len(joint))[:, : len(theta)], joint
        self.start = _inside(moves, theta, limit)

    def room(self, error: Array) -> Array:
        """Return the matrix S of the constraint S ⪰ 0."""
        both, kept, joint = self.rows
        found = joint + both @ error @ both.T - kept @ error @ kept.T
        return np.asarray(0.5 * (found + found.T))

    def spare(self, error: Array) -> float:
        """Return the unspent regret s = limit − tr(ΘE)."""
        return self.limit - float(np.sum(self.theta * error))

    def cost(self, error: Array, level: float) -> float:
        """Nats, whatever the level."""
        (both, _, joint), sensor, noise = self.rows, self.moves.public_sensor, self.moves.public_covariance
        before = _log_det(joint + both @ error @ both.T) - _log_det(noise + sensor @ error @ sensor.T)
        return 0.5 * (before - _log_det(error))

    def slope(self, basis: Array, level: float) -> tuple[Array, Products]:
        """The slope of the cost in X of E + basis X basis' at E = basis basis', and the products of its curvature."""
        (both, _, joint), sensor, one = self.rows, self.moves.public_sensor @ basis, np.eye(len(basis))
        both = both @ basis
        moved = both.T @ np.linalg.solve(joint + both @ both.T, both)
        heard = sensor.T @ np.linalg.solve(self.moves.public_covariance + sensor @ sensor.T, sensor)
        return 0.5 * (moved - heard - one), ((0.5, one), (-0.5, moved), (0.5, heard))

    def value(self, error: Array, level: float) -> float:
        """The objective; infinite outside the domain."""
        spare = self.spare(error)
        if spare <= 0.0:
            return np.inf
        try:
            inside = _log_det(self.room(error)) + np.log(spare)
            return float(self.cost(error, level) - level * inside)
        except np.linalg.LinAlgError:
            return np.inf

    def step(self, error: Array, level: float) -> tuple[Array, float]:
        """Return Newton's step, and the decrease that its slope promises.

        Raises:
            LinAlgError: Rounding leaves the equations indefinite.
        """
        basis = np.asarray(np.linalg.cholesky(error))
        both, kept, _ = self.rows
        both, kept, theta = both @ basis, kept @ basis, basis.T @ self.theta @ basis
        room, spare = np.linalg.inv(self.room(error)), self.spare(error)
        later, now, mixed = both.T @ room @ both, kept.T @ room @ kept, both.T @ room @ kept
        slope, products = self.slope(basis, level)
        slope = slope - level * (later - now) + level / spare * theta
        products = (*products, (level, later), (level, now), (-level, mixed), (-level, mixed.T))
        factor = cho_factor(_upper_matrix(products, theta, level / spare**2).T, lower=True, overwrite_a=True)
        places = np.triu_indices(len(error))
        twice = np.where(places[0] == places[1], 1.0, np.sqrt(2.0))
        found = np.zeros_like(slope)
        found[places] = cho_solve(factor, -slope[places] * twice) / twice
        found += np.triu(found, 1).T
        return basis @ found @ basis.T, -float(np.sum(slope * found))

    def centred(self, error: Array, level: float) -> Array:
        """Return the minimum at a level, from a point inside; where rounding ends the steps, the last point."""
        last = np.inf
        for _ in range(_MOST_STEPS):
            try:
                step, promised = self.step(error, level)
            except np.linalg.LinAlgError:
                return error
            settles = promised <= _ENOUGH * level
            if settles and promised >= _ENOUGH * last:
                return error
            before, share = self.value(error, level), 1.0
            for _ in range(_MOST_HALVINGS):
                after = self.value(error + share * step, level)
                if np.isfinite(after) if settles else after <= before - _ENOUGH * share * promised:
                    break
                share *= 0.5
            else:
                return error
            error = error + share * step
            error, last = 0.5 * (error + error.T), promised if settles else np.inf
        return error

    def bound(self, error: Array, price: float, later: Array) -> float:
        """A lower bound of the nats of every rule."""
        return float(np.log(2.0)) * least_bits_bound(self.moves, self.theta, self.limit, error, price, later)

    def solved(self) -> Inside:
        """Return E with the least cost found, that cost, and the largest bound."""
        error, n = self.start, len(self.start)
        best = Inside(error, np.inf, -np.inf)
        for level in self.unit * _LEVELS:
            error = self.centred(error, level)
            try:
                later = level * np.linalg.inv(self.room(error))[:n, :n]
                bound = self.bound(error, level / self.spare(error), later)
                found = Inside(error, self.cost(error, 0.0), -np.inf)
            except np.linalg.LinAlgError:
                break
            best = min(found, best, key=lambda each: each.value)._replace(bound=max(bound, best.bound))
            if best.value - best.bound <= tolerances.MIXTURE_LOSS * abs(best.value):
                break
        return best


class _ErrorBarrier(_Barrier):
    """The constraints, and how little error a rule leaves."""

    def __init__(self, moves: Moves, theta: Array, limit: float, weights: Array) -> None:
        super().__init__(moves, theta, limit)
        self.weights, self.unit = weights, float(np.sum(weights * self.start)) / len(theta)

    def cost(self, error: Array, level: float) -> float:
        """−tr(QE), and the barrier of E ⪰ 0."""
        return -float(np.sum(self.weights * error)) - (level * _log_det(error) if level else 0.0)

    def slope(self, basis: Array, level: float) -> tuple[Array, Products]:
        """As for nats."""
        one = np.eye(len(basis))
        return -basis.T @ self.weights @ basis - level * one, ((level, one),)

    def bound(self, error: Array, price: float, later: Array) -> float:
        """A lower bound of −tr(QE) of every rule."""
        return -most_error_bound(self.moves, self.theta, self.weights, self.limit, error, price, later)


def least_bits_by_barrier(moves: Moves, theta: Array, limit: float) -> Inside:
    """Return E of the fewest bits over 0 ≺ E ⪯ P(E), tr(ΘE) ≤ limit, with its bits and a lower bound of those of every rule.

    Raises:
        SolverError: There is no interior point to start from.

    Cost: some 50 steps of O(n⁶) time and O(n⁴) memory: 80 ms for 6 signals, 2 s for 40.
    """
    error, value, bound = _Barrier(moves, theta, limit).solved()
    return Inside(error, value / np.log(2.0), bound / np.log(2.0))


def most_error_by_barrier(moves: Moves, theta: Array, weights: Array, limit: float) -> Inside:
    """Return E of the largest tr(QE) over 0 ⪯ E ⪯ P(E), tr(ΘE) ≤ limit, with its tr(QE) and an upper bound of every rule's.

    Raises:
        SolverError: There is no interior point to start from.

    Cost: as for the fewest bits.
    """
    error, value, bound = _ErrorBarrier(moves, theta, limit, weights).solved()
    return Inside(error, -value, -bound)


def _log_det(matrix: Array) -> float:
    return 2.0 * float(np.log(np.diag(np.linalg.cholesky(matrix))).sum())


def _inside(moves: Moves, theta: Array, limit: float) -> Array:
    """Return an interior point: E of an observer without decisions under a damped transition, scaled to half the limit.

    Raises:
        SolverError: That error is unbounded even under a damped transition.
    """
    fading = np.sqrt(min(0.9, 0.8 / moves.radius**2)) if moves.radius else 1.0
    faded = replace(moves, transition=fading * moves.transition, public_sensor=fading * moves.public_sensor).silence()
    if faded is None:
        raise SolverError("the barrier method for the rule over time found no point to start from")
    return np.asarray(0.5 * min(1.0, limit / float(np.sum(theta * faded))) * faded)


def _upper_matrix(products: Products, theta: Array, rate: float) -> Array:
    """Return the upper triangle of the matrix of X ↦ Σ s F X F' + rate · Θ tr(ΘX), for pairs s, F with as many F' as F.

    Its unknowns are the entries of X on and above the diagonal; those above count √2 times, so that the matrix is symmetric.
    """
    first, second = places = np.triu_indices(len(theta))
    twice = np.where(first == second, 1.0, np.sqrt(2.0))
    weighed = theta[places] * twice
    found = np.zeros((len(first), len(first)))
    columns = [(sign, each[:, first], each[:, second]) for sign, each in products]
    start = 0
    for i in range(len(theta)):  # rows (i, j) with j ≥ i; columns from (i, i) on
        end = start + len(theta) - i
        rows, scale = found[start:end, start:], twice[start:end, None] * twice[start:] / 2.0
        for sign, low, high in columns:
            rows += sign * low[i, start:] * high[i:, start:]
            rows += sign * high[i, start:] * low[i:, start:]
        rows *= scale
        rows += rate * weighed[start:end, None] * weighed[start:]
        start = end
    return found
