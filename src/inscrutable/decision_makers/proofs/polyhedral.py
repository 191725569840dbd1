"""Proofs where the optimal cost is piecewise linear: exact suprema from its cells, and admissible decisions near them."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from typing import NamedTuple

from inscrutable import tolerances
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.proofs.atoms import Atoms
from inscrutable.decision_makers.proofs.face_programmes import FaceProgrammes
from inscrutable.decision_makers.proofs.subdivision import Subdivision
from inscrutable.decision_makers.proofs.tied_faces import near_vertices
from inscrutable.decision_makers.proofs.tied_values import TiedValues
from inscrutable.decision_makers.results import Decision, DecisionStatus, MixedDecision
from inscrutable.privacy import PrivacyMeasure
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_MOST_TRIALS, _MOST_ATOMS = 64, 16
"""Places whose decisions are judged for one decision, and for a lottery. Of 48 decisions and 48 lotteries, most of them of
costs with kinks, 18 decisions lose up to .58 of privacy with one place and two lotteries .01 with two; none with eight and
four."""
_SHARES = (tolerances.SLACK_SAFETY, 0.001, 0.01, 0.1)
"""Least shares of each tied decision in a mixture; kinks may need more than rows. With any one of these alone, 9 to 17 of the
48 lotteries lose up to .03 to .77 of privacy, in half the time; with the first and third alone, seven lose up to .07."""


class PolyhedralProof(NamedTuple):
    """The exact values for one belief."""

    problem: DecisionProblem
    belief: Array
    measure: PrivacyMeasure
    values: TiedValues

    def single(self, found: Decision, limit: float) -> tuple[Decision, float]:
        """Return the best decision found and the supremum."""
        for place in islice(self.values.affordable(limit), _MOST_TRIALS):
            if self.values.privacies[place] <= found.privacy + tolerances.NO_PRIVACY:
                break
            for action in self._decisions(place):
                met = decision_for(self.problem, self.belief, action, self.measure, DecisionStatus.BEST_CANDIDATE)
                better = met.privacy > found.privacy + tolerances.NO_PRIVACY and not met.belief_set.is_empty
                if better and met.regret <= limit and self.problem.is_admissible(action):
                    found = met
        return found, max(self.values.single(limit), found.privacy)

    def lottery(self, found: MixedDecision, limit: float) -> tuple[MixedDecision, float]:
        """Return the best lottery found and the supremum."""
        bound = self.values.lottery(limit)
        atoms = Atoms(self.problem, self.belief, self.measure, found)
        for place in bound.places[:_MOST_ATOMS]:
            for action in self._decisions(place):
                if self.problem.is_admissible(action):
                    atoms.take(action)
        improved = atoms.lottery(found, limit)
        # One decision may beat all mixtures of those found so far.
        own = decision_for(
            self.problem, self.belief, self.problem.solve_points(self.belief), self.measure, DecisionStatus.OPTIMAL
        )
        alone, _ = self.single(replace(own, privacy=max(own.privacy, improved.expected_privacy)), limit)
        if alone.status is DecisionStatus.BEST_CANDIDATE:
            atoms.take(self.problem.as_points(alone.action))
            improved = atoms.lottery(found, limit)
        return improved, max(bound.value, improved.expected_privacy)

    def _decisions(self, place: int) -> list[Array]:
        """Decisions that may have the privacy of a place."""
        cells, values = self.values.cells, self.values
        if values.reference.sign < 0:
            return [cells.actions[place]]
        if values.faces is None:
            tied = cells.actions[cells.tied[place]]
            return [action for share in _SHARES for action in near_vertices(self.problem, tied, share)]
        tight = values.tight(place)
        action = None if tight is None else values.faces.cheapest(self.belief, tight)
        return [] if action is None else [action]


def proof_for(
    problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, cells: Subdivision, reference: Reference
) -> PolyhedralProof:
    """Return the proof for one belief."""
    linear = problem.linear_form()
    # A lift's epigraph variables are not determined where their state has probability 0: ties there are not decisions.
    faces = None if linear is None or linear.lift is not None else FaceProgrammes(linear)
    return PolyhedralProof(problem, belief, measure, TiedValues(cells, faces, belief, reference))
