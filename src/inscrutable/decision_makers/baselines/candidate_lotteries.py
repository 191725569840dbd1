"""Lotteries over a list of decisions: without tiny atoms, with the privacy against the naive observer, as results."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.consistent_sets import ConsistentSets
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.results import DecisionStatus, MixedDecisions, ResultTable
from inscrutable.geometry.hulls import LARGER
from inscrutable.privacy import MaximalObfuscation
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class CandidateLotteries:
    """For each of T beliefs a lottery of at most k candidates; padding has share 0 and repeats the first."""

    problem: DecisionProblem
    candidates: Candidates
    beliefs: Array  # (T,X)
    numbers: np.ndarray  # (T,k), which candidate
    shares: Array  # (T,k), summing to one
    regrets: Array  # (T,k)
    optimal_costs: Array  # (T,)
    statuses: tuple[DecisionStatus, ...]

    def results(self) -> MixedDecisions:
        """Return the lotteries as a result, with the naive observer's set of each atom."""
        sets, measure = self.candidates.sets, MaximalObfuscation()
        privacies = np.array([_distances(sets, *each) for each in zip(self.numbers, self.beliefs, strict=True)])
        return MixedDecisions(
            ResultTable(
                self.problem,
                self.candidates.actions,
                self.shares,
                self.regrets,
                privacies,
                _explanations(sets)[self.numbers],
                self.optimal_costs,
                np.array([measure.upper_bound(belief) for belief in self.beliefs]),
                self.statuses,
                places=self.numbers,
            )
        )


def cleaned(lotteries: CandidateLotteries) -> CandidateLotteries:
    """Return lotteries without atoms below `tolerances.PROBABILITY`, renormalised, and no wider than the widest."""
    kept = lotteries.shares >= tolerances.PROBABILITY
    order = np.argsort(~kept, axis=1, kind="stable")[:, : int(kept.sum(axis=1).max())]
    kept = np.take_along_axis(kept, order, axis=1)
    order = np.where(kept, order, order[:, :1])
    numbers, shares, regrets = (
        np.take_along_axis(each, order, axis=1) for each in (lotteries.numbers, lotteries.shares, lotteries.regrets)
    )
    shares = np.where(kept, shares, 0.0)
    return CandidateLotteries(
        lotteries.problem,
        lotteries.candidates,
        lotteries.beliefs,
        numbers,
        shares / shares.sum(axis=1, keepdims=True),
        regrets,
        lotteries.optimal_costs,
        lotteries.statuses,
    )


def _distances(sets: ConsistentSets, numbers: np.ndarray, belief: Array) -> Array:
    """Distance from a belief to the consistent sets of some candidates (k,)."""
    kinds = sets.dimension[numbers]
    same = sets.distinct[numbers]
    found = ConsistentSets(
        sets.problem, sets.actions[numbers], kinds, sets.start[numbers], sets.end[numbers], same
    ).bounds(belief)
    for first in np.unique(same[kinds >= LARGER]):
        found[same == first] = sets[int(first)].distance(belief)
    return found


def _explanations(sets: ConsistentSets) -> Array:
    """A belief that each candidate is optimal for (M,X), NaN where there is none."""
    middle = np.where(sets.dimension[:, None] >= LARGER, sets.start, 0.5 * (sets.start + sets.end))
    return np.where(sets.dimension[:, None] < 0, np.nan, middle)
