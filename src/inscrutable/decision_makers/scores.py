"""Regret and privacy of every candidate under one belief; distances to larger sets are computed only where they can matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable.decision_makers.candidates import Candidates, make_candidates
from inscrutable.decision_makers.envelope import RatedPoints
from inscrutable.decision_makers.results import Decision
from inscrutable.errors import InputError
from inscrutable.privacy import PrivacyMeasure
from inscrutable.validation import Array


@dataclass(eq=False)
class Scores(RatedPoints):
    """Candidates under one belief; `privacies` are upper bounds until `refine` makes them exact."""

    belief: Array
    candidates: Candidates
    measure: PrivacyMeasure
    regrets: Array
    privacies: Array
    exact: np.ndarray

    def refine(self, place: int) -> None:
        """Judge one candidate, and all that are the same decision, by the set itself."""
        sets = self.candidates.sets
        same = np.flatnonzero(sets.distinct == sets.distinct[place])
        self.privacies[same] = np.where(
            np.isneginf(self.privacies[same]), -np.inf, self.measure(self.belief, sets[place])
        )
        self.exact[same] = True


def score(belief: Array, optimal_cost: float, candidates: Candidates, measure: PrivacyMeasure, on_empty: str) -> Scores:
    """Return the scores of candidates under a belief (X,) whose optimal cost is known."""
    costs = candidates.state_costs @ belief
    regrets = np.maximum(costs - optimal_cost, 0.0)
    values = measure.values(belief, candidates.sets)
    privacies = values.privacies
    unclear = np.flatnonzero(np.isnan(privacies) & candidates.usable & (candidates.sets.dimension >= 0))
    if unclear.size:
        raise InputError(f"{measure!r} is NaN for candidate {unclear[0]}; a measure must give a number, −inf or inf")
    privacies = np.where(np.isnan(privacies), -np.inf, privacies)
    empty = candidates.sets.dimension < 0
    exact = values.exact.copy()
    if not measure.judges_empty:
        exact |= empty
        if on_empty == "exclude":
            privacies = np.where(empty, -np.inf, privacies)
    privacies = np.where(candidates.usable, privacies, -np.inf)
    return Scores(belief, candidates, measure, regrets, privacies, exact | ~candidates.usable)


def with_extra(scores: Scores, extra: list[Decision]) -> Scores:
    """Return the scores of the candidates followed by further decisions of known regret and privacy."""
    problem = scores.candidates.problem
    added = make_candidates(problem, np.vstack([problem.as_points(d.action) for d in extra]))
    candidates = scores.candidates.joined(added)
    return Scores(
        scores.belief,
        candidates,
        scores.measure,
        np.concatenate([scores.regrets, [d.regret for d in extra]]),
        np.concatenate([scores.privacies, [d.privacy for d in extra]]),
        np.concatenate([scores.exact, np.ones(len(extra), dtype=bool)]),
    )
