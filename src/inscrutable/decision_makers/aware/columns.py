"""The candidates of a decision maker against an aware observer: distinct decisions, and their regrets."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from inscrutable import tolerances
from inscrutable.budgets import Budget
from inscrutable.decision_makers.candidates import Candidates, Distinct, distinct_of, make_candidates
from inscrutable.decision_makers.results import DecisionStatus, MixedDecisions, ResultTable
from inscrutable.mechanisms.same_actions import first_same
from inscrutable.privacy import MaximalObfuscation
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class Columns:
    """Distinct admissible decisions of some candidates."""

    problem: DecisionProblem
    candidates: Candidates
    found: Distinct

    def __len__(self) -> int:
        return len(self.found.number)

    @property
    def points(self) -> Array:
        """The decisions as points, shape (M,U)."""
        return np.asarray(self.candidates.actions[self.found.number])

    def regrets(self, beliefs: Array, optimal_costs: Array) -> Array:
        """Return ρ(π_b, u_m), shape (B,M)."""
        return np.asarray(np.maximum(beliefs @ self.found.costs.T - optimal_costs[:, None], 0.0))

    def clear_regrets(self, beliefs: Array, optimal_costs: Array) -> Array:
        """Return the same, 0 where it is rounding of an expected cost, whose terms may cancel."""
        regrets = self.regrets(beliefs, optimal_costs)
        return np.where(regrets > tolerances.NO_REGRET * (beliefs @ np.abs(self.found.costs).T), regrets, 0.0)

    def pick(self, which: np.ndarray) -> Columns:
        """Return some of them."""
        return Columns(self.problem, self.candidates, self.found.pick(which))

    def joined(self, beliefs: Array) -> Columns:
        """Return them followed by the optimal decisions of some beliefs (n,X) that are not among them.

        Optimal decisions are added even where a slack is below the feasible set's `min_slack`: no other decision may meet a
        budget.
        """
        own = self.problem.solve_points(beliefs)
        first = first_same(np.vstack([self.points, own]))[len(self) :]
        new = np.flatnonzero(first == len(self) + np.arange(len(own)))
        if not new.size:
            return self
        added = make_candidates(self.problem, own[new], beliefs[new])
        added = replace(added, usable=np.ones(len(new), dtype=np.bool_))
        last = distinct_of(added)
        last = last._replace(number=last.number + len(self.candidates))
        found = Distinct(*(np.concatenate(pair) for pair in zip(self.found, last, strict=True)))
        return Columns(self.problem, self.candidates.joined(added), found)

    def privacies(self, beliefs: Array, places: np.ndarray) -> Array:
        """Return dist(π_t, Π(u)) of the decisions at `places` (T,k), shape (T,k)."""
        start, along = self.found.start[places], self.found.along[places]
        toward = beliefs[:, None, :] - start
        length = (along**2).sum(axis=2)
        share = np.clip((toward * along).sum(axis=2) / np.where(length > 0, length, 1.0), 0.0, 1.0)
        found = np.linalg.norm(toward - share[:, :, None] * along, axis=2)
        kind = self.found.kind[places]
        found[kind < 0] = np.inf
        measure = MaximalObfuscation()
        for step, atom in zip(*np.nonzero(kind >= 2), strict=True):
            belief_set = self.candidates.sets[int(self.found.number[places[step, atom]])]
            found[step, atom] = measure(beliefs[step], belief_set)
        return np.asarray(found)


def columns_of(problem: DecisionProblem, candidates: Candidates, plausible_only: bool) -> Columns:
    """Return the distinct admissible candidates, without those that no belief explains where asked."""
    found = distinct_of(candidates)
    if plausible_only:
        found = found.pick(np.flatnonzero(found.kind >= 0))
    return Columns(problem, candidates, found)


def allowed_places(regrets: Array, cap: Budget | None, optimal_costs: Array) -> np.ndarray | None:
    """Return where a decision's regret is within the cap, shape (B,M); None where there is no cap."""
    if cap is None:
        return None
    limits = cap.limits(optimal_costs)[:, None]
    return np.asarray(regrets <= limits * (1.0 + tolerances.REGRET_MET) + rounding_of(optimal_costs)[:, None])


def places_of(known: Array, beliefs: Array) -> np.ndarray:
    """Return which of the known beliefs each one is, shape (T,); −1 for none."""
    distance, place = cKDTree(known).query(beliefs)
    return np.where(distance <= tolerances.SAME_BELIEF, place, -1)


def rounding_of(optimal_costs: Array) -> Array:
    """Rounding error of the regrets, per belief (B,)."""
    return np.asarray(tolerances.NO_REGRET * np.maximum(np.abs(optimal_costs), tolerances.TINY))


def without_small(rows: Array, regrets: Array, least: float = tolerances.RARELY_PLAYED) -> Array:
    """Return rows of probabilities (T,m) without tiny atoms.

    Their probability goes to the row's cheapest atom, so that no row's expected regret rises.
    """
    played = rows > 0
    cheapest = np.where(played, regrets, np.inf).argmin(axis=1)
    kept = np.where(rows >= least, rows, 0.0)
    kept[np.arange(len(rows)), cheapest] += 1.0 - kept.sum(axis=1)
    return np.maximum(kept, 0.0)


def lotteries(
    columns: Columns, beliefs: Array, optimal_costs: Array, rows: Array, status: DecisionStatus
) -> MixedDecisions:
    """Return rows of probabilities (T,M) over columns as lotteries, likelier atoms first."""
    most = max(1, int((rows > 0).sum(axis=1).max()))
    places = np.argsort(-rows, axis=1, kind="stable")[:, :most]
    probabilities = np.take_along_axis(rows, places, axis=1)
    places = np.where(probabilities > 0, places, places[:, :1])
    costs = np.einsum("tx,tax->ta", beliefs, columns.found.costs[places])
    regrets = np.maximum(costs - optimal_costs[:, None], 0.0)
    privacies = columns.privacies(beliefs, places)
    corners = np.sqrt(((beliefs[:, None, :] - np.eye(beliefs.shape[1])) ** 2).sum(axis=2)).max(axis=1)
    decoys = columns.found.start[places] + 0.5 * columns.found.along[places]
    statuses = (status,) * len(rows)
    return MixedDecisions(
        ResultTable(
            columns.problem,
            columns.points,
            probabilities,
            regrets,
            privacies,
            decoys,
            optimal_costs,
            corners,
            statuses,
            places=places,
        )
    )
