"""Coordinates that are copies of one another: the same costs and rows, so that only their sum matters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable.problems.constraints import Polyhedron
from inscrutable.validation import Array


class Merged(NamedTuple):
    """A feasible set in which only the first of each group of copies is left."""

    kept: np.ndarray  # (F,) coordinates
    constraints: Polyhedron
    idle: np.ndarray  # rows of C that hold the others at zero

    def decisions(self, actions: Array) -> Array:
        """Return decisions (…,F) as decisions (…,U) that hold no copies."""
        found = np.zeros((*actions.shape[:-1], len(self.kept) + len(self.idle)))
        found[..., self.kept] = actions
        return found


def merged_copies(rows: Array, constraints: Polyhedron) -> Merged | None:
    """Return the feasible set without copies, None where there are none.

    Formula: j and k are copies where A e_j = A e_k, and the rows of C are equal in both except u_j ≥ 0 and u_k ≥ 0. Then
    (…, u_j + u_k, …, 0, …) is feasible when u is, and costs the same in every state.

    Args:
        rows: A, shape (n,U): costs are functions of A u.
        constraints: C.

    Cost: one comparison of the columns.
    """
    own = _bound_of(constraints)
    shared = np.delete(constraints.A_ub, own[own >= 0], axis=0)
    alike = np.vstack([rows, shared, constraints.A_eq])
    alike[:, own < 0] = np.nan  # a coordinate that may be negative has no copy
    _, first = np.unique(alike.T, axis=0, return_index=True, equal_nan=False)
    kept = np.sort(first)
    if len(kept) == len(own):
        return None
    gone = np.setdiff1d(np.arange(len(own)), kept)
    left = np.delete(np.arange(len(constraints.A_ub)), own[gone])
    region = Polyhedron(
        constraints.A_ub[left][:, kept],
        constraints.b_ub[left],
        constraints.A_eq[:, kept],
        constraints.b_eq,
        min_slack=constraints.min_slack,
    )
    return Merged(kept, region, own[gone])


def _bound_of(constraints: Polyhedron) -> np.ndarray:
    """The row (U,) that is u_j ≥ 0, −1 where there is none."""
    single = (np.count_nonzero(constraints.A_ub, axis=1) == 1) & (constraints.b_ub == 0.0)
    row, column = np.nonzero((constraints.A_ub < 0.0) & single[:, None])
    own = np.full(constraints.n_actions, -1)
    own[column] = row
    return own
