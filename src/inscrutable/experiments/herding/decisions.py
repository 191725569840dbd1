"""One agent's decision at many public beliefs at once: the public belief after it, and its regret in each state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from inscrutable import tolerances
from inscrutable.decision_makers import OriginalDecisionMaker
from inscrutable.mechanisms.played import atoms_of, regrets_of
from inscrutable.mechanisms.same_actions import first_same
from inscrutable.problems import DecisionProblem, FiniteProblem
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class TurnOutcomes:
    """The outcomes of a decision at S public beliefs: C pairs of a public belief and a decision."""

    origin: np.ndarray  # (C,), the public belief, in ascending order
    chances: Array  # (C,X), of the decision in each state
    beliefs: Array  # (C,X), public after it
    is_right: np.ndarray  # (C,X), whether the decision is right in a state
    regrets: Array  # (S,X), expected under each state
    prices: Array  # (S,), expected regret under the private belief: what hiding costs the agent itself
    bits: Array  # (S,), of the private belief in the decision
    cascade: np.ndarray  # (S,), whether no signal changes the law of the decision
    settled: Array  # (S,X), share of the likeliest decisions that are right


class Deciding:
    """An agent with a problem, a sensor's table p(y|x) and a decision maker."""

    def __init__(self, problem: DecisionProblem, signals: Array, maker: Any) -> None:
        self.problem, self.signals, self.maker = problem, signals, maker

    def at(self, public: Array) -> TurnOutcomes:
        """Return the agent's decision at public beliefs (S,X)."""
        place, symbol, weight, private = self._private(public)
        points, row, number, share = self._law(private)
        outcome, origin, decision = _outcomes(place[row], number, len(points), len(public))
        mass = weight[row] * share
        chances = np.stack([sums_at(outcome, share * each[symbol[row]], len(origin)) for each in self.signals], axis=1)
        after = public[origin] * chances
        played = after.sum(axis=1)
        told = sums_at(place[row], mass * np.log2(share / played[outcome]), len(public))
        costs, forgone = self._costs(private, points)
        # A choice is right in the states where its regret is zero; a mixture is right in the state of its least regret.
        least = 0.0 if self.problem.is_discrete else costs.min(axis=1, keepdims=True)
        rounding = tolerances.COST_ROUNDING * np.abs(self.problem.state_costs(points)).max(axis=0)
        is_right = costs <= least + tolerances.NO_COST * costs.max(axis=0) + rounding
        own = np.maximum((private[row] * costs[number]).sum(axis=1) - forgone[row], 0.0)
        cascade, top = _cascades(origin, outcome, share, np.bincount(place, minlength=len(public)))
        return TurnOutcomes(
            origin,
            chances,
            np.where(cascade[origin][:, None], public[origin], after / played[:, None]),
            is_right[decision],
            sums_at(origin, chances * costs[decision], len(public)),
            sums_at(place[row], mass * own, len(public)),
            np.where(cascade, 0.0, np.maximum(told, 0.0)),
            cascade,
            sums_at(origin, top[:, None] * is_right[decision], len(public))
            / sums_at(origin, top, len(public))[:, None],
        )

    def _private(self, public: Array) -> tuple[np.ndarray, np.ndarray, Array, Array]:
        """Return each public belief with each possible signal: both indices, the signal's probability, the private belief."""
        joint = public[:, None, :] * self.signals.T
        total = joint.sum(axis=2)
        place, symbol = np.nonzero(total > 0)
        weight = total[place, symbol]
        private = joint[place, symbol] / weight[:, None]
        return place, symbol, weight, private / private.sum(axis=1, keepdims=True)

    def _costs(self, private: Array, points: Array) -> tuple[Array, Array]:
        """Return the regrets (M,X) of decisions in each state, and the least expected regret under each private belief."""
        states = np.eye(len(self.signals))
        least = self.problem.optimal_cost(private) - private @ self.problem.optimal_cost(states)
        return regrets_of(self.problem, states, points).T, np.asarray(least)

    def _law(self, private: Array) -> tuple[Array, np.ndarray, np.ndarray, Array]:
        """Return K(u|π) at private beliefs: the distinct decisions, and the nonzero entries as (row, decision, probability)."""
        if isinstance(self.maker, OriginalDecisionMaker) and isinstance(self.maker.problem, FiniteProblem):
            tied = self.maker.problem.tied(private)  # a fair coin among tied choices
            row, number = np.nonzero(tied)
            return np.eye(tied.shape[1]), row, number, 1.0 / tied.sum(axis=1)[row]
        points, row, atom, share = atoms_of(self.maker, private)
        kept, same = np.unique(first_same(points), return_inverse=True)
        table = sparse.csr_array((share, (row, same.reshape(-1)[atom])), shape=(len(private), len(kept)))
        table.sum_duplicates()
        entries = table.tocoo()
        return points[kept], entries.row, entries.col, entries.data


def sums_at(where: np.ndarray, values: Any, count: int) -> Array:
    """Return the sums of values (n,) or (n,X) that belong to the same of `count` places, shape (count,) or (count,X)."""
    columns = np.asarray(values, dtype=np.float64).reshape(len(where), -1)
    sums = np.stack([np.bincount(where, each, count) for each in columns.T], axis=-1)
    return np.asarray(sums[:, 0] if np.ndim(values) == 1 else sums, dtype=np.float64)


def _outcomes(
    place: np.ndarray, number: np.ndarray, n_points: int, n_public: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the outcome of each entry, and the public belief and decision of each outcome."""
    key = place.astype(np.int64) * n_points + number
    if n_points * n_public <= 4 * len(key):  # by counting, without a sort
        found = np.flatnonzero(np.bincount(key, minlength=n_points * n_public))
        where = np.empty(n_points * n_public, dtype=np.intp)
        where[found] = np.arange(len(found))
        outcome = where[key]
    else:
        found, outcome = np.unique(key, return_inverse=True)
    return outcome.reshape(-1), *np.divmod(found, n_points)


def _cascades(
    origin: np.ndarray, outcome: np.ndarray, share: Array, n_signals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return which public beliefs (S,) have one law for all signals, and which outcomes (C,) are their likeliest decisions."""
    largest, least = np.zeros(len(origin)), np.full(len(origin), np.inf)
    np.maximum.at(largest, outcome, share)
    np.minimum.at(least, outcome, share)
    least[np.bincount(outcome, minlength=len(origin)) < n_signals[origin]] = 0.0
    differ = np.bincount(origin, largest - least > tolerances.SAME_LAW, len(n_signals))
    most = np.zeros(len(n_signals))
    np.maximum.at(most, origin, largest)
    return differ == 0, largest >= most[origin] - tolerances.SAME_LAW
