"""The dynamics of the agent's mean for the observer, m_{t+1} = A m_t + ω, and the public observations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from inscrutable import tolerances
from inscrutable.alphas.error_law import root_of, sizes_of
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class Moves:
    """m_{t+1} = A m_t + ω with ω ~ N(0, W), and the public z_{t+1} = H m_t + ζ with cov(ω, ζ) = N, cov(ζ) = R.

    Args:
        transition: A, shape (n,n).
        innovation: W, shape (n,n); may be singular.
        public_sensor: H, shape (p,n); p may be 0.
        cross: N, shape (n,p).
        public_covariance: R, shape (p,p).
        units: Sizes of the coordinates of m, shape (n,): a variance is small or large relative to their squares. None: all are
            one.
    """

    transition: Array
    innovation: Array
    public_sensor: Array
    cross: Array
    public_covariance: Array
    units: Array | None = None

    @classmethod
    def private(cls, transition: Array, innovation: Array, units: Array | None = None) -> Moves:
        """Return dynamics without public observations."""
        n = len(transition)
        return cls(transition, innovation, np.zeros((0, n)), np.zeros((n, 0)), np.zeros((0, 0)), units)

    @property
    def radius(self) -> float:
        """The largest modulus of an eigenvalue of A."""
        return float(np.abs(np.linalg.eigvals(self.transition)).max(initial=0.0))

    def gain(self, error: Array) -> Array:
        """Return the gain (n,p) of the public observation, for the observer's error covariance E."""
        if not len(self.public_sensor):
            return np.zeros(self.cross.shape)
        read = self.public_covariance + self.public_sensor @ error @ self.public_sensor.T
        dual = root_of(read, sizes_of(read))[1]  # columns may depend on each other
        return np.asarray((self.cross + self.transition @ error @ self.public_sensor.T) @ dual.T @ dual)

    def predicted(self, error: Array) -> tuple[Array, Array]:
        """Return P = AEA' + W after public observations, and the matrix A_L with dP = A_L dE A_L', both (n,n)."""
        gain = self.gain(error)
        moved = self.transition - gain @ self.public_sensor
        crossed = gain @ self.cross.T
        found = moved @ error @ moved.T + self.innovation - crossed - crossed.T + gain @ self.public_covariance @ gain.T
        return 0.5 * (found + found.T), moved

    def silence(self) -> Array | None:
        """Return the error covariance (n,n) of an observer who sees no decision; None where it grows without bound."""
        if self.units is not None:
            scaled = self.scaled().silence()
            return None if scaled is None else scaled * np.outer(self.units, self.units)
        if not self.transition.any():
            return self.predicted(np.zeros_like(self.innovation))[0]
        if self.radius < 1.0 - tolerances.STABLE and not len(self.public_sensor):
            return np.asarray(solve_discrete_lyapunov(self.transition, self.innovation))
        if not len(self.public_sensor):
            return None
        try:
            found = solve_discrete_are(
                self.transition.T, self.public_sensor.T, self.innovation, self.public_covariance, s=self.cross
            )
        except (np.linalg.LinAlgError, ValueError):
            return None
        return np.asarray(found)

    def scaled(self) -> Moves:
        """Return the dynamics in coordinates whose sizes are one, with public columns that are independent."""
        if self.units is None:
            return self
        found = Moves(
            self.transition * self.units / self.units[:, None],
            self.innovation / np.outer(self.units, self.units),
            self.public_sensor * self.units,
            self.cross / self.units[:, None],
            self.public_covariance,
        )
        read = found.public_covariance + found.public_sensor @ found.public_sensor.T
        dual = root_of(read, sizes_of(read))[1] if len(read) else read
        if len(dual) == len(read):
            return found
        return replace(
            found,
            public_sensor=dual @ found.public_sensor,
            cross=found.cross @ dual.T,
            public_covariance=dual @ found.public_covariance @ dual.T,
        )

    def within(self, basis: Array) -> Moves:
        """Return the dynamics in coordinates of an invariant subspace with the orthonormal basis (n,q)."""
        return Moves(
            basis.T @ self.transition @ basis,
            basis.T @ self.innovation @ basis,
            self.public_sensor @ basis,
            basis.T @ self.cross,
            self.public_covariance,
        )

    def reached(self) -> Array:
        """Return an orthonormal basis (n,q) of the subspace reachable from a public start."""
        basis = _range(self.innovation)
        while True:
            wider = _range(np.hstack([basis, self.transition @ basis]))
            if wider.shape[1] == basis.shape[1]:
                return basis
            basis = wider


def _range(matrix: Array) -> Array:
    left, values, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(
        left[:, values > np.sqrt(tolerances.NO_VARIANCE) * max(values.max(initial=0.0), np.finfo(float).tiny)]
    )
