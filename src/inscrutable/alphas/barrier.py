"""The fewest bits over time by a barrier method, where the fixed point of `over_time` is not found.

With M = [A; H], K = [I; 0] and J the joint covariance of innovation and public noise,

    f(E) = ½ log det(J + MEM') − ½ log det(R + HEH') − ½ log det E

is convex. At a level τ Newton's method minimises f(E) − τ log det S − τ log s, S = J + MEM' − KEK', s = r − tr(ΘE). Then τS⁻¹
and τ/s are nearly the multipliers of S ⪰ 0 and s ≥ 0, and the bits exceed the least ones by at most τ (n + p + 1) nats.
Source: Boyd and Vandenberghe, Convex Optimization (2004), section 11.3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from inscrutable import tolerances
from inscrutable.alphas.interior import ErrorProgramme, upper_matrix
from inscrutable.alphas.observed import Moves
from inscrutable.alphas.over_time_bound import least_bits_bound
from inscrutable.validation import Array

_LEVELS = 0.05 ** np.arange(10.0)
"""τ: a gap of 1e-10 at the last. With tenths 40 problems take 1.2 times as many steps."""
_MOST_STEPS = 40
_ENOUGH, _MOST_HALVINGS = 0.1, 40
"""Share of the promised decrease that a step makes at least, or it is halved. Below this share of τ a promised decrease is lost
in rounding, and whole steps converge by themselves."""


class Inside(NamedTuple):
    """E, its bits, and a lower bound of the bits of every rule."""

    error: Array
    bits: float
    bound: float


class _Barrier:
    def __init__(self, moves: Moves, theta: Array, limit: float) -> None:
        self.programme = ErrorProgramme(moves, theta, np.eye(len(theta)), limit)
        self.rows = self.programme.rows
        self.sensor, self.noise = moves.public_sensor, moves.public_covariance

    def value(self, error: Array, level: float) -> float:
        """The objective in nats; infinite outside the domain."""
        both, _, joint = self.rows
        spare = self.programme.spare(error)
        if spare <= 0.0:
            return np.inf
        try:
            bits = _log_det(joint + both @ error @ both.T) - _log_det(self.noise + self.sensor @ error @ self.sensor.T)
            inside = _log_det(self.programme.room(error)) + np.log(spare) if level else 0.0
            return float(0.5 * (bits - _log_det(error)) - level * inside)
        except np.linalg.LinAlgError:
            return np.inf

    def step(self, error: Array, level: float) -> tuple[Array, float]:
        """Return Newton's step, and the decrease that its slope promises.

        Raises:
            LinAlgError: Rounding leaves the equations indefinite.
        """
        basis, (both, kept, joint) = np.linalg.cholesky(error), self.rows
        both, kept, sensor = both @ basis, kept @ basis, self.sensor @ basis
        moved = both.T @ np.linalg.solve(joint + both @ both.T, both)
        heard = sensor.T @ np.linalg.solve(self.noise + sensor @ sensor.T, sensor)
        room, spare = np.linalg.inv(self.programme.room(error)), self.programme.spare(error)
        later, now, mixed = both.T @ room @ both, kept.T @ room @ kept, both.T @ room @ kept
        theta, one = basis.T @ self.programme.theta @ basis, np.eye(len(error))
        slope = 0.5 * (moved - heard - one) - level * (later - now) + level / spare * theta
        products = (
            (0.5, one), (-0.5, moved), (0.5, heard), (level, later), (level, now), (-level, mixed), (-level, mixed.T),
        )  # fmt: skip
        factor = cho_factor(upper_matrix(products, theta, level / spare**2).T, lower=True, overwrite_a=True)
        places = np.triu_indices(len(error))
        twice = np.where(places[0] == places[1], 1.0, np.sqrt(2.0))
        found = np.zeros_like(one)
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


def least_bits_inside(moves: Moves, theta: Array, limit: float) -> Inside:
    """Return E of the fewest bits over 0 ≺ E ⪯ P(E), tr(ΘE) ≤ limit, with its bits and their bound.

    Raises:
        SolverError: There is no interior point to start from.

    Cost: some 50 steps of O(n⁶) time and O(n⁴) memory: 50 ms for 6 signals, 9 s for 60.
    """
    barrier, n = _Barrier(moves, theta, limit), len(theta)
    error, best = barrier.programme.start().error, Inside(theta, np.inf, -np.inf)
    for level in _LEVELS:
        error = barrier.centred(error, level)
        try:
            later = level * np.linalg.inv(barrier.programme.room(error))[:n, :n]
            bound = least_bits_bound(moves, theta, limit, error, level / barrier.programme.spare(error), later)
        except np.linalg.LinAlgError:
            break
        bits = barrier.value(error, 0.0) / np.log(2.0)
        best = min(Inside(error, bits, -np.inf), best, key=lambda found: found.bits)._replace(
            bound=max(bound, best.bound)
        )
        if best.bits - best.bound <= tolerances.MIXTURE_LOSS * best.bits:
            break
    return best


def _log_det(matrix: Array) -> float:
    return 2.0 * float(np.log(np.diag(np.linalg.cholesky(matrix))).sum())
