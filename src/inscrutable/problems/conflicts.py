"""Which rows of an empty feasible set contradict one another, and by how much."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.linalg import qr

from inscrutable import tolerances
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise, minimum
from inscrutable.saved import Summarised
from inscrutable.validation import Array

_MOST_LISTED = 12


@dataclass(frozen=True, repr=False)
class RowConflict(Summarised):
    """An irreducible set of rows that no decision satisfies together; without any one of them some decision would.

    Formula: rows A_ub u ≤ b_ub and A_eq u = b_eq contradict one another where y ≥ 0 and w exist with
    A_ub'y + A_eq'w = 0 and b_ub'y + b_eq'w = −1; the rows in the support of a vertex of these (y, w) are irreducible.

    Args:
        names: The rows in conflict.
        amounts: The relaxation of each of them that alone removes the conflict, in the unit of its right-hand side.
        relaxed: The rows that change in the relaxation of least sum; they may belong to other conflicts too.
        relaxations: The change of each of them, in the unit of its right-hand side.

    Source: Farkas' lemma; Gleeson and Ryan (ORSA Journal on Computing 2, 1990).

    Example:
        >>> from inscrutable import Polyhedron
        >>> region = Polyhedron([[-1.0], [1.0], [1.0]], [-0.5, 0.25, 9.0], names=["floor", "cap", "far"])
        >>> found = region.conflict()
        >>> found.names, found.amounts
        (('floor', 'cap'), (0.25, 0.25))
    """

    names: tuple[str, ...]
    amounts: tuple[float, ...]
    relaxed: tuple[str, ...]
    relaxations: tuple[float, ...]

    def summary(self) -> str:
        """Return one sentence for a person to read."""
        least = _listed([f"{name} by {by:g}" for name, by in zip(self.relaxed, self.relaxations, strict=True)])
        if not self.names:
            return f"no decision satisfies all constraints; the least relaxation is: {least}"
        alone = _listed([f"{name} by {by:g}" for name, by in zip(self.names, self.amounts, strict=True)])
        return (
            f"no decision satisfies all constraints; cannot hold together: {_listed(list(self.names))}; one of these must "
            f"give way, alone: {alone}; the least relaxation is: {least}"
        )


def _listed(parts: list[str]) -> str:
    more = len(parts) - _MOST_LISTED
    return ", ".join(parts) if more <= 0 else f"{', '.join(parts[:_MOST_LISTED])} and {more} more"


def row_conflict(below: Rows, equal: Rows, names: tuple[str, ...]) -> RowConflict | None:
    """Return the conflict among rows A_ub u ≤ b_ub and A_eq u = b_eq with names in that order, or None."""
    anywhere = minimise(np.zeros(below.matrix.shape[1]), below, equal)  # many times faster than the least relaxation
    if anywhere.status == OPTIMAL:
        return None
    relaxations = _least_relaxation(below, equal)
    moved = np.flatnonzero(relaxations)
    if not moved.size:
        return None
    rows, amounts = _irreducible(below, equal)
    return RowConflict(
        tuple(names[i] for i in rows),
        tuple(float(amount) for amount in amounts),
        tuple(names[i] for i in moved),
        tuple(float(by) for by in relaxations[moved]),
    )


def _least_relaxation(below: Rows, equal: Rows) -> Array:
    """Least sum of violations (n+e,), row by row; zero below the tolerance of feasibility."""
    n, e, u = len(below.sides), len(equal.sides), below.matrix.shape[1]
    elastic = np.concatenate([np.zeros(u), np.ones(n + 2 * e)])
    answer = minimum(
        elastic,
        Rows(sparse.hstack([below.matrix, -sparse.eye_array(n), sparse.csr_array((n, 2 * e))]), below.sides),
        Rows(
            sparse.hstack([equal.matrix, sparse.csr_array((e, n)), sparse.eye_array(e), -sparse.eye_array(e)]),
            equal.sides,
        ),
        [(None, None)] * u + [(0, None)] * (n + 2 * e),
    )
    broken = answer.x[u : u + n]
    off = answer.x[u + n : u + n + e] + answer.x[u + n + e :]
    amounts = np.concatenate([broken, off])
    return np.where(amounts > tolerances.FEASIBILITY * _scale(below, equal), amounts, 0.0)


def _scale(below: Rows, equal: Rows) -> Array:
    """Largest number of each row."""
    coefficients = np.abs(np.vstack([below.matrix, equal.matrix])).max(axis=1, initial=0.0)
    return np.asarray(np.maximum(coefficients, np.abs(np.concatenate([below.sides, equal.sides]))))


def _irreducible(below: Rows, equal: Rows) -> tuple[np.ndarray, Array]:
    """Rows of one irreducible conflict and the relaxation of each alone: a corner of Farkas' multipliers."""
    n, e = len(below.sides), len(equal.sides)
    scale = _scale(below, equal)
    matrix = np.vstack([below.matrix, equal.matrix]) / scale[:, None]
    sides = np.concatenate([below.sides, equal.sides]) / scale
    both = np.vstack([matrix, -matrix[n:]])  # an equality is two inequalities
    values = np.concatenate([sides, -sides[n:]])
    answer = minimise(
        np.ones(n + 2 * e),
        equal=Rows(np.vstack([both.T, values]), np.append(np.zeros(both.shape[1]), -1.0)),
        bounds=(0, None),
    )
    if answer.status != OPTIMAL:  # in conflict by hardly more than the tolerance
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    multipliers = answer.x[: n + e].copy()
    multipliers[n:] += answer.x[n + e :]
    rows = np.flatnonzero(multipliers > tolerances.ON_FACE * multipliers.max())
    return rows, np.asarray(scale[rows] / multipliers[rows])


def implied_equalities(rows: Array, sides: Array) -> np.ndarray:
    """Return which equalities a'u = b follow from those before them; not those that contradict them."""
    implied, units, right = np.zeros(len(sides), dtype=bool), np.zeros((0, rows.shape[1])), np.zeros(0)
    sizes = np.maximum(np.linalg.norm(rows, axis=1), tolerances.TINY)
    scaled = rows / sizes[:, None]
    if len(scaled) <= scaled.shape[1]:
        diagonal = np.diag(qr(scaled.T, mode="r", pivoting=True)[0])
        if np.abs(diagonal).min(initial=1.0) > tolerances.STATIONARITY:
            return implied
    for e, left in enumerate(scaled):
        side = sides[e] / sizes[e]
        for _ in range(2):  # once more, against rounding
            shares = units @ left
            left, side = left - shares @ units, side - shares @ right
        length = float(np.linalg.norm(left))
        if length > tolerances.STATIONARITY:
            units, right = np.vstack([units, left / length]), np.append(right, side / length)
        else:
            implied[e] = abs(side) <= tolerances.FEASIBILITY
    return implied
