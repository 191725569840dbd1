"""Decisions and lotteries with a proof of how much more privacy there could be."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.budgets import Budget
from inscrutable.decision_makers.certificate import Prover, Question
from inscrutable.decision_makers.envelope import concave_envelope, mixture_on_envelope
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.results import Decision, DecisionStatus, MixedDecision
from inscrutable.errors import InputError
from inscrutable.privacy import DesiredObfuscation, MaximalObfuscation, PrivacyMeasure
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

MOST_CALLS = 20_000
"""Oracle calls of a proof unless said otherwise."""

_MOST_ROUNDS = 8
_JUDGED = 24  # beliefs found by a proof whose decisions are judged
_REPLACED = (DecisionStatus.OPTIMAL, DecisionStatus.POLISHED, DecisionStatus.BEST_CANDIDATE)


def checked_gap(value: Any) -> float | None:
    """Return the gap asked of a proof, None for no proof, or raise `InputError`."""
    if value is None:
        return None
    gap = validation.non_negative(value, "certify")
    if not 0 < gap < 1:
        raise InputError(f"certify must be a relative gap between 0 and 1 such as 0.01, or None for no proof, got {value!r}")
    return gap


def check_provable(measure: PrivacyMeasure, on_empty: str) -> None:
    """Raise `InputError` where there is nothing that a proof could bound."""
    if type(measure) not in (MaximalObfuscation, DesiredObfuscation):
        raise InputError(f"certify proves MaximalObfuscation() and DesiredObfuscation(...), not {measure!r}: give certify=None")
    if on_empty != "exclude":
        raise InputError('certify needs on_empty="exclude": unexplained decisions of infinite privacy have no bound')


class Proofs:
    """What a proof asks for: the goal, the budget, the relative gap, and how often the oracle may be called."""

    def __init__(self, problem: DecisionProblem, budget: Budget, gap: float, most_calls: int = MOST_CALLS) -> None:
        self.problem = problem
        self.budget = budget
        self.gap = gap
        self.most_calls = most_calls

    def single(self, belief: Array, measure: PrivacyMeasure, found: Decision) -> Decision:
        """Return a decision with a proven bound, and a better one where the proof came across it."""
        reference = _reference(measure, belief)
        prover = Prover(self.problem, belief, self.most_calls)
        limit = self.budget.limit(found.optimal_cost)
        answer = prover.answer(Question(reference, _spent(limit), None, found.privacy + self._allowed(found.privacy)))
        bound = max(min(answer.bound, found.privacy_bound), found.privacy)
        for belief_met in _promising(prover, reference, limit, found.privacy):
            if belief_met[1] <= found.privacy:
                break
            action = self.problem.solve(prover.points.beliefs[belief_met[0]])
            met = decision_for(self.problem, belief, action, measure, DecisionStatus.BEST_CANDIDATE)
            admissible = bool(self.problem.constraints.is_admissible(action))
            if admissible and met.regret <= limit and met.privacy > found.privacy + tolerances.NO_PRIVACY:
                found = met
        bound = max(bound, found.privacy)
        status = self._status(found.privacy, bound, found.status)
        return replace(found, privacy_bound=bound, status=status, oracle_calls=prover.points.calls)

    def _allowed(self, privacy: float) -> float:
        return self.gap * max(abs(privacy), tolerances.PROOF_FLOOR)

    def _status(self, privacy: float, bound: float, kept: DecisionStatus) -> DecisionStatus:
        if kept not in _REPLACED:
            return kept
        if bound <= privacy + tolerances.PROVED:
            return DecisionStatus.PROVED
        # Rounding of the sum that made the floor.
        within = bound <= privacy + self._allowed(privacy) * (1.0 + tolerances.BUDGET_SAFETY)
        return DecisionStatus.GAP_REACHED if within else DecisionStatus.BOUNDED


def _spent(limit: float) -> float:
    """The budget with the rounding that searches allow themselves."""
    return limit * (1.0 + tolerances.BUDGET_SAFETY)


def _reference(measure: PrivacyMeasure, belief: Array) -> Reference:
    found = measure.reference(belief)
    assert found is not None
    return found


def _worth(prover: Prover, reference: Reference) -> tuple[Array, Array]:
    """Regrets of the decisions at all beliefs met, and what the distance from or to the belief itself makes of them."""
    points = prover.points
    regrets = points.costs @ points.belief - points.optimal_cost
    return regrets, reference.sign * np.linalg.norm(points.beliefs - reference.point, axis=1)


def _promising(prover: Prover, reference: Reference, limit: float, privacy: float) -> list[tuple[int, float]]:
    """Affordable beliefs met in a proof that could be more private, best first."""
    regrets, worth = _worth(prover, reference)
    better = np.flatnonzero((regrets <= limit) & (worth > privacy))
    best = better[np.argsort(-worth[better], kind="stable")][:_JUDGED]
    return [(int(index), float(worth[index])) for index in best]
