"""A rival with infinitely many answers, of which a step of the sequential rule uses a few.

Its costs are linear in the belief, so that after a decision it loses V(y) = min_a y·s(a), y the mean belief when it answers,
times the decision's probability. The loss is always that of its best answers, by `solve`, whichever are in use.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.aware.stackelberg_answers import first_means
from inscrutable.privacy.losses import DecisionLoss, on_simplex
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class RivalAnswers:
    """A rival and the state costs of the answers in use."""

    rival: DecisionProblem  # without costs that all its answers share
    expected: Array  # (J,B,X): the expected belief at each step in which it answers, times the symbols' probability
    costs: Array  # (X,A): of answers; further ones are inserted before the last
    common: Array  # (B,): the costs that all answers share
    spare: Array  # (B,): the loss where the present belief is known
    n_first: int = 0  # permanent answers, beside the last

    @classmethod
    def of(cls, loss: DecisionLoss, expected: Array, weights: Array) -> Self:
        """Return a rival with its best answers at some means, from the prior's weights (B,)."""
        n_states = expected.shape[2]
        whole, precise = loss.rival(n_states), loss.precise(n_states)
        means = expected.reshape(-1, n_states)
        held, shares = on_simplex(means), means.sum(axis=1)
        known, own = (
            (shares * each.optimal_cost(held)).reshape(expected.shape[:2]).sum(axis=0) for each in (whole, precise)
        )
        made = cls(precise, expected, np.empty((n_states, 0)), known - own, known)
        mean = on_simplex((weights @ expected).sum(axis=0))
        costs = np.asarray(precise.state_costs(precise.solve(first_means(mean))))
        return replace(made, costs=_different(made.costs, costs)).begun()

    def begun(self) -> Self:
        """Return the same, with all answers permanent."""
        return replace(self, n_first=self.costs.shape[1] - 1)

    @property
    def directions(self) -> Array:
        """Half the difference between the last answer's cost and each other's, shape (A−1,X)."""
        return np.asarray(0.5 * (self.costs[:, -1:] - self.costs[:, :-1]).T)

    @property
    def points(self) -> Array:
        """Points of the beliefs, shape (B,J (A−1))."""
        return np.hstack(list(self.expected @ self.directions.T))

    def lost(self, joint: Array) -> Array:
        """Return the loss after each of n decisions, times its probability, from their joint law (B,n) with beliefs."""
        sums, costs = self._best(joint)
        return np.asarray(joint.T @ self.common + (sums * costs).sum(axis=(0, 2)))

    def joined(self, joint: Array, least: float) -> Self | None:
        """Return the same with the best answers to decisions, where these save more than `least`; None where none does."""
        sums, costs = self._best(joint)
        held = sums.sum(axis=2)
        saved = (sums @ self.costs).min(axis=2) - (sums * costs).sum(axis=2)
        missing = (held > 0) & (saved > least * held)
        if not missing.any():
            return None
        return replace(self, costs=_different(self.costs, costs[missing]))

    def answering(self, beliefs: Array) -> tuple[Self, Array]:
        """Return the permanent answers with the best ones to beliefs (…,X), and these best ones as pure strategies (…,A−1)."""
        flat, kept = beliefs.reshape(-1, beliefs.shape[-1]), np.append(np.arange(self.n_first), -1)
        costs = np.asarray(self.rival.state_costs(self.rival.solve(flat))).T
        first = self.costs[:, kept]
        shares = np.eye(self.n_first + len(flat))[self.n_first :].reshape(*beliefs.shape[:-1], -1)
        return replace(self, costs=np.hstack([first[:, :-1], costs, first[:, -1:]])), shares

    def mixed(self, shares: Array, first: Self) -> Self:
        """Return the permanent answers of `first`, and these added answers that have a probability in `shares` (…,A−1)."""
        place = np.arange(self.costs.shape[1] - 1)
        some = (place >= first.n_first) & (shares.max(axis=tuple(range(shares.ndim - 1))) > tolerances.HARDLY_MIXED)
        kept = np.append(np.arange(first.n_first), -1)
        return replace(first, costs=_different(first.costs[:, kept], self.costs[:, :-1].T[some]))

    def _best(self, joint: Array) -> tuple[Array, Array]:
        """Beliefs after each decision, times its probability, and the best answers' costs: both (J,n,X)."""
        sums = joint.T @ self.expected
        held = sums.sum(axis=2) > 0
        costs = np.zeros_like(sums)
        if held.any():
            costs[held] = self.rival.state_costs(self.rival.solve(on_simplex(sums[held])))
        return sums, costs


def _different(known: Array, costs: Array) -> Array:
    """Insert, before the last of the known answers (X,A), those of (n,X) that differ in cost from all of them."""
    found = list(known.T)
    least = tolerances.NO_ERROR * float(np.abs(costs).max(initial=0.0))
    for each in costs:
        if not any(np.abs(each - other).max() <= least for other in found):
            found.insert(max(len(found) - 1, 0), each)
    return np.array(found).T
