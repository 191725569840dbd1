"""The joint law of belief and decision, entry by entry where it is not zero."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from inscrutable import tolerances
from inscrutable.mechanisms.matching import weights_on
from inscrutable.mechanisms.played import Mechanism
from inscrutable.mechanisms.priors import Prior
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class Joint:
    """p(π_b, u_m) = w_b K(u_m|π_b) as a list of its positive entries."""

    beliefs: Array  # (B, X)
    weights: Array  # (B,)
    n_actions: int
    row: np.ndarray  # (n,), b
    column: np.ndarray  # (n,), m
    conditional: Array  # (n,), K(u_m|π_b)
    mass: Array  # (n,), w_b K(u_m|π_b)

    @cached_property
    def played(self) -> Array:
        """p(u_m), shape (M,)."""
        return np.asarray(np.bincount(self.column, weights=self.mass, minlength=self.n_actions), dtype=np.float64)

    @cached_property
    def table(self) -> Any:
        """The joint law as a sparse array of rows, shape (B,M)."""
        return sparse.csr_array((self.mass, (self.row, self.column)), shape=(len(self.weights), self.n_actions))

    @cached_property
    def means(self) -> Array:
        """E[π|u_m], shape (M,X); NaN for decisions that are never played."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.table.T @ self.beliefs) / self.played[:, None])

    @cached_property
    def squared_errors(self) -> Array:
        """‖π_b − E[π|u_m]‖² of every entry, shape (n,)."""
        found = np.zeros(len(self.mass))
        for belief, mean in zip(self.beliefs.T, self.means.T, strict=True):
            found += (belief[self.row] - mean[self.column]) ** 2
        return found

    @cached_property
    def top_states(self) -> Array:
        """1 where a state is one of the most likely ones of a belief, shape (B,X)."""
        return top_states(self.beliefs)

    def largest_by_action(self, values: Array) -> Array:
        """Return the largest of some entries' values for every decision, shape (M,); 0 where it has none."""
        largest = np.zeros(self.n_actions)
        np.maximum.at(largest, self.column, values)
        return largest

    def by_belief(self, values: Array) -> Array:
        """Return Σ_u K(u|π_b) times a value of every entry, shape (B,)."""
        return np.asarray(np.bincount(self.row, weights=self.conditional * values, minlength=len(self.weights)))


def joint_law(mechanism: Mechanism, prior: Prior) -> Joint:
    """Return the joint law of belief and decision under a prior; raise `InputError` where the beliefs differ."""
    weights = weights_on(mechanism, prior)
    held: Any = mechanism.observed
    if isinstance(held, np.ndarray):
        row, column = np.nonzero(held)
        conditional = held[row, column]
    else:
        entries = held.tocoo()
        row, column, conditional = entries.row, entries.col, entries.data
    mass = weights[row] * conditional
    some = mass > 0
    return Joint(
        mechanism.beliefs, weights, len(mechanism.actions), row[some], column[some], conditional[some], mass[some]
    )


def top_states(beliefs: Array) -> Array:
    """Return 1 where a state is one of the most likely ones of a belief, else 0, shape (B,X)."""
    return np.asarray(beliefs >= beliefs.max(axis=1, keepdims=True) - tolerances.SAME_BELIEF, dtype=np.float64)
