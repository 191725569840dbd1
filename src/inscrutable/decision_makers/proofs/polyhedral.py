"""Proofs where the optimal cost is piecewise linear: exact suprema from its cells, and admissible decisions near them."""

from __future__ import annotations

from typing import NamedTuple

from inscrutable import tolerances
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.proofs.atoms import Atoms
from inscrutable.decision_makers.proofs.face_programmes import FaceProgrammes
from inscrutable.decision_makers.proofs.subdivision import Subdivider, Subdivision
from inscrutable.decision_makers.proofs.tied_faces import near_vertices
from inscrutable.decision_makers.proofs.tied_values import TiedValues
from inscrutable.decision_makers.results import Decision, DecisionStatus, MixedDecision
from inscrutable.privacy import PrivacyMeasure
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem, LinearProblem, QuadraticProblem
from inscrutable.validation import Array

_MOST_TRIALS = 64
_MOST_ATOMS = 16
_TRIED_SHARE = 0.1  # of the oracle calls, where costs may bend


class PolyhedralProof(NamedTuple):
    """The exact values for one belief."""

    problem: DecisionProblem
    belief: Array
    measure: PrivacyMeasure
    values: TiedValues

    def single(self, found: Decision, limit: float) -> tuple[Decision, float]:
        """Return the best decision met and the supremum."""
        bound = self.values.single(limit)
        for place in bound.places[:_MOST_TRIALS]:
            if self.values.privacies[place] <= found.privacy + tolerances.NO_PRIVACY:
                break
            for action in self._decisions(place):
                met = decision_for(self.problem, self.belief, action, self.measure, DecisionStatus.BEST_CANDIDATE)
                better = met.privacy > found.privacy + tolerances.NO_PRIVACY and not met.belief_set.is_empty
                if better and met.regret <= limit and self.problem.constraints.is_admissible(action):
                    found = met
        return found, max(bound.value, found.privacy)

    def lottery(self, found: MixedDecision, limit: float) -> tuple[MixedDecision, float]:
        """Return the best lottery met and the supremum."""
        bound = self.values.lottery(limit)
        atoms = Atoms(self.problem, self.belief, self.measure, found)
        for place in bound.places[:_MOST_ATOMS]:
            for action in self._decisions(place):
                if self.problem.constraints.is_admissible(action):
                    atoms.take(action)
        improved = atoms.lottery(found, limit)
        return improved, max(bound.value, improved.expected_privacy)

    def _decisions(self, place: int) -> list[Array]:
        """Decisions that may be worth what a place is worth."""
        cells, values = self.values.cells, self.values
        if values.reference.sign < 0:
            return [cells.actions[place]]
        if values.faces is None:
            return list(near_vertices(self.problem, cells.actions[cells.tied[place]]))
        tight = values.tight(place)
        action = None if tight is None else values.faces.cheapest(self.belief, tight)
        return [] if action is None else [action]


def cells_of(problem: DecisionProblem, most_calls: int) -> tuple[Subdivision | None, int]:
    """Return the cells of a problem whose optimal cost is piecewise linear, and the calls of the oracle; None where it is
    not, or where they would be too many."""
    linear = linear_form(problem)
    bends = isinstance(problem, QuadraticProblem) and linear is None
    if bends or problem.costs_are_unique:
        return None, 0
    most = int(most_calls if linear is not None else _TRIED_SHARE * most_calls)
    subdivider = Subdivider(problem, most, linear is not None)
    return subdivider.found(), subdivider.calls


def linear_form(problem: DecisionProblem) -> LinearProblem | None:
    """Return the linear problem with the same decisions, optimal for the same beliefs, where there is one."""
    if isinstance(problem, LinearProblem):
        return problem
    if isinstance(problem, QuadraticProblem) and not problem.hessians.any():
        return LinearProblem(problem.linear, problem.constraints)
    return None


def proof_for(
    problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, cells: Subdivision, reference: Reference
) -> PolyhedralProof:
    """Return the proof for one belief."""
    linear = linear_form(problem)
    faces = None if linear is None else FaceProgrammes(linear)
    return PolyhedralProof(problem, belief, measure, TiedValues(cells, faces, belief, reference))
