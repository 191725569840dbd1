"""A rival whose answers are not finitely many, as a step of the sequential rule meets it: with some of them.

Its costs are linear in the belief, so that after a decision it loses V(y) = min_a y·s(a), y the mean belief when it answers,
times how often the decision comes. What is lost is that of its best answers, by `solve`, whichever are there.
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
    """A rival and what the answers that are there cost it."""

    rival: DecisionProblem  # without costs that all its answers share
    expected: Array  # (J,B,X): the belief at each step in which it answers, times the probability of what it then reads
    costs: Array  # (X,A): of answers; others join before the last
    common: Array  # (B,): the costs that all answers share
    spare: Array  # (B,): what is lost where the belief of now is known
    n_first: int = 0  # answers that stay, beside the last

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
        """Return the same, where all answers that are there stay."""
        return replace(self, n_first=self.costs.shape[1] - 1)

    @property
    def directions(self) -> Array:
        """Half of what the last answer costs more than each other, shape (A−1,X)."""
        return np.asarray(0.5 * (self.costs[:, -1:] - self.costs[:, :-1]).T)

    @property
    def points(self) -> Array:
        """Points of the beliefs, shape (B,J (A−1))."""
        return np.hstack(list(self.expected @ self.directions.T))

    def lost(self, joint: Array) -> Array:
        """Return what is lost after each of n decisions, times how often it comes, from their joint law (B,n) with beliefs."""
        sums, costs = self._best(joint)
        return np.asarray(joint.T @ self.common + (sums * costs).sum(axis=(0, 2)))

    def joined(self, joint: Array, least: float, shares: Array | None = None) -> Self | None:
        """Return the same with the best answers after decisions where one saves at least so much; None where none does.

        Of those that had joined before, the ones that are hardly mixed with shares (…,A−1) leave.
        """
        sums, costs = self._best(joint)
        held = sums.sum(axis=2)
        saved = (sums @ self.costs).min(axis=2) - (sums * costs).sum(axis=2)
        missing = (held > 0) & (saved > least * held)
        if not missing.any():
            return None
        known = self if shares is None else self.mixed(shares, self)  # near ones make Newton's steps stall
        return replace(self, costs=_different(known.costs, costs[missing]))

    def mixed(self, shares: Array, first: Self) -> Self:
        """Return others' first answers, and these that joined and are mixed with shares (…,A−1)."""
        place = np.arange(self.costs.shape[1] - 1)
        some = (place >= first.n_first) & (shares.max(axis=tuple(range(shares.ndim - 1))) > tolerances.HARDLY_MIXED)
        kept = np.append(np.arange(first.n_first), -1)
        return replace(first, costs=_different(first.costs[:, kept], self.costs[:, :-1].T[some]))

    def _best(self, joint: Array) -> tuple[Array, Array]:
        """Laws of the belief after each decision, times how often it comes, and the best answers' costs: both (J,n,X)."""
        sums = joint.T @ self.expected
        held = sums.sum(axis=2) > 0
        costs = np.zeros_like(sums)
        if held.any():
            costs[held] = self.rival.state_costs(self.rival.solve(on_simplex(sums[held])))
        return sums, costs


def _different(known: Array, costs: Array) -> Array:
    """Known answers (X,A), and before the last of them those of some (n,X) that cost other than all before."""
    found = list(known.T)
    least = tolerances.NO_ERROR * float(np.abs(costs).max(initial=0.0))
    for each in costs:
        if not any(np.abs(each - other).max() <= least for other in found):
            found.insert(max(len(found) - 1, 0), each)
    return np.array(found).T
