"""Regret and privacy of every candidate under one belief, with the expensive part done only where it can matter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.envelope import concave_envelope
from inscrutable.errors import InputError
from inscrutable.privacy import PrivacyMeasure
from inscrutable.validation import Array


@dataclass(eq=False)
class Scores:
    """Candidates under one belief; `privacies` are upper bounds until `refine` makes them exact."""

    belief: Array
    candidates: Candidates
    measure: PrivacyMeasure
    regrets: Array
    privacies: Array
    exact: np.ndarray
    on_empty: str = "exclude"

    def refine(self, index: int) -> None:
        """Judge one candidate, and all that are the same decision, by the set itself."""
        sets = self.candidates.sets
        same = np.flatnonzero(sets.distinct == sets.distinct[index])
        self.privacies[same] = np.where(
            np.isneginf(self.privacies[same]), -np.inf, self.measure(self.belief, sets[index])
        )
        self.exact[same] = True

    def best(self, limit: float) -> int | None:
        """Return the most private candidate with a regret of at most `limit`, the cheapest among equals."""
        affordable = np.flatnonzero((self.regrets <= limit) & ~np.isneginf(self.privacies))
        while affordable.size:
            top = self.privacies[affordable].max()
            if np.isneginf(top):
                return None
            equal = affordable[self.privacies[affordable] == top]
            index = int(equal[self.regrets[equal].argmin()])
            if self.exact[index]:
                return index
            self.refine(index)
        return None

    def exact_envelope(self) -> np.ndarray:
        """Return the corners of the concave envelope, by rising regret, each judged exactly."""
        while True:
            chosen = concave_envelope(self.regrets, self.privacies)
            open_ones = chosen[~self.exact[chosen]]
            if not open_ones.size:
                return chosen
            for index in open_ones:
                if not self.exact[index]:
                    self.refine(int(index))


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
    return Scores(belief, candidates, measure, regrets, privacies, exact | ~candidates.usable, on_empty)
