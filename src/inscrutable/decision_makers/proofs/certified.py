"""Decisions and lotteries with a proven upper bound of the privacy."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.budgets import Budget
from inscrutable.decision_makers.envelope import best_mixture
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.proofs.atoms import Atoms
from inscrutable.decision_makers.proofs.certificate import Prover, Question
from inscrutable.decision_makers.proofs.polyhedral import proof_for
from inscrutable.decision_makers.proofs.subdivision import Subdivision, cells_of
from inscrutable.decision_makers.results import Decision, DecisionStatus, MixedDecision
from inscrutable.errors import InputError
from inscrutable.privacy import DesiredObfuscation, MaximalObfuscation, PrivacyMeasure
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

MOST_CALLS = 10_000
"""Default limit of oracle calls of a proof."""

_MOST_ROUNDS = 30
"""Most rounds of a lottery's proof: 58 of 62 take at most 12, and the others gain nothing after these. With 12, one loses .7 %;
with 100 and 300 none differs, in 1.1 times the time."""
_JUDGED = 8
"""Beliefs found by a proof whose decisions are judged. With one, five of 62 lotteries end up to .3 % further from their
bounds, with 24 none ends nearer."""
_REPLACED = (DecisionStatus.OPTIMAL, DecisionStatus.POLISHED, DecisionStatus.BEST_CANDIDATE)


def checked_gap(value: Any) -> float | None:
    """Return the gap asked of a proof, None for no proof, or raise `InputError`."""
    if value is None:
        return None
    gap = validation.non_negative(value, "certify")
    if not 0 < gap < 1:
        raise InputError(
            f"certify must be a relative gap between 0 and 1 such as 0.01, or None for no proof, got {value!r}"
        )
    return gap


def check_provable(measure: PrivacyMeasure, on_empty: str) -> None:
    """Raise `InputError` where a proof has nothing to bound."""
    if type(measure) not in (MaximalObfuscation, DesiredObfuscation):
        raise InputError(
            f"certify proves MaximalObfuscation() and DesiredObfuscation(...), not {measure!r}: give certify=None"
        )
    if on_empty != "exclude":
        raise InputError('certify needs on_empty="exclude": unexplained decisions of infinite privacy have no bound')


class Proofs:
    """Settings of proofs: the problem, the budget, the relative gap, and the limit of oracle calls."""

    def __init__(self, problem: DecisionProblem, budget: Budget, gap: float, most_calls: int = MOST_CALLS) -> None:
        self.problem = problem
        self.budget = budget
        self.gap = gap
        self.most_calls = most_calls

    @cached_property
    def _cells(self) -> tuple[Subdivision | None, int]:
        """Cells of a piecewise linear optimal cost, the same for all beliefs, and their oracle calls."""
        return cells_of(self.problem, self.most_calls)

    def single(self, belief: Array, measure: PrivacyMeasure, found: Decision, between_choices: bool) -> Decision:
        """Return a decision with a proven bound, replaced by a better one where the proof finds it.

        `between_choices` says whether mixtures of the choices of a finite problem are decisions too.
        """
        if self.problem.is_discrete and not between_choices:
            return self._best_choice(belief, measure, found)
        if self.problem.n_states == 1:  # every decision reveals the one belief
            return replace(
                found, privacy_bound=found.privacy, status=self._status(found.privacy, found.privacy, found.status)
            )
        reference = _reference(measure, belief)
        limit = self.budget.limit(found.optimal_cost)
        cells, calls = self._cells
        if cells is not None:
            found, bound = proof_for(self.problem, belief, measure, cells, reference).single(found, limit)
            status = self._status(found.privacy, bound, found.status)
            return replace(found, privacy_bound=bound, status=status, oracle_calls=calls)
        prover = Prover(self.problem, belief, self.most_calls - calls)
        answer = prover.answer(Question(reference, _spent(limit), None, found.privacy + self._allowed(found.privacy)))
        bound = max(min(answer.bound, found.privacy_bound), found.privacy)
        for index in prover.better(Question(reference, limit, None, found.privacy))[:_JUDGED]:
            action = prover.action(index)
            met = decision_for(self.problem, belief, action, measure, DecisionStatus.BEST_CANDIDATE)
            if met.regret <= limit and met.privacy > found.privacy + tolerances.NO_PRIVACY:
                found = met
                break
        bound = max(bound, found.privacy)
        status = self._status(found.privacy, bound, found.status)
        return replace(found, privacy_bound=bound, status=status, oracle_calls=calls + prover.points.calls)

    def lottery(
        self, belief: Array, measure: PrivacyMeasure, found: MixedDecision, between_choices: bool
    ) -> MixedDecision:
        """Return a lottery with a proven bound over all distributions, replaced by a better one where the proof finds it.

        Formula: for every μ ≥ 0 the value is at most max_u {Ψ(u) − μ ρ(π,u)} + μ · budget.
        """
        if self.problem.is_discrete and not between_choices:
            return self._best_lottery(belief, measure, found)
        if self.problem.n_states == 1:
            value = found.expected_privacy
            return replace(found, privacy_bound=value, status=self._status(value, value, found.status))
        reference = _reference(measure, belief)
        limit = self.budget.limit(found.optimal_cost)
        cells, calls = self._cells
        if cells is not None:
            improved, bound = proof_for(self.problem, belief, measure, cells, reference).lottery(found, limit)
            status = self._status(improved.expected_privacy, bound, improved.status)
            return replace(improved, privacy_bound=bound, status=status, oracle_calls=calls)
        prover = Prover(self.problem, belief, self.most_calls - calls)
        atoms = Atoms(self.problem, belief, measure, found)
        bound = found.privacy_bound
        for _ in range(_MOST_ROUNDS):
            value, price = atoms.value(limit)
            offset = price * _spent(limit)
            multiplier = price if limit > 0 else None
            floor = value + self._allowed(value) - (0.0 if multiplier is None else offset)
            judged = frozenset(atoms.met)
            answer = prover.answer(Question(reference, _spent(limit), multiplier, floor, judged))
            bound = min(bound, answer.bound + (0.0 if multiplier is None else offset))
            if bound <= value + self._allowed(value) or prover.points.calls >= prover.most_calls:
                break
            line = value - offset if multiplier is not None else value
            fresh = prover.better(Question(reference, _spent(limit), multiplier, line, judged))
            if not atoms.extend(prover, fresh[:_JUDGED], price, line) and answer.complete:
                break
        improved = atoms.lottery(found, limit)
        bound = max(bound, improved.expected_privacy)
        status = self._status(improved.expected_privacy, bound, improved.status)
        return replace(improved, privacy_bound=bound, status=status, oracle_calls=calls + prover.points.calls)

    def _choices(self, belief: Array, measure: PrivacyMeasure) -> list[Decision]:
        """Every choice of a finite problem that a belief explains, judged: there are no other decisions."""
        points = np.eye(self.problem.n_actions)
        status = DecisionStatus.BEST_CANDIDATE
        judged = [decision_for(self.problem, belief, row, measure, status) for row in points]
        return [each for each in judged if not each.belief_set.is_empty]

    def _best_choice(self, belief: Array, measure: PrivacyMeasure, found: Decision) -> Decision:
        limit = self.budget.limit(found.optimal_cost)
        affordable = [each for each in self._choices(belief, measure) if each.regret <= limit]
        best = max(affordable, key=lambda each: each.privacy, default=found)
        if best.privacy > found.privacy + tolerances.NO_PRIVACY:
            found = best
        return replace(
            found, privacy_bound=found.privacy, status=self._status(found.privacy, found.privacy, found.status)
        )

    def _best_lottery(self, belief: Array, measure: PrivacyMeasure, found: MixedDecision) -> MixedDecision:
        limit, choices = self.budget.limit(found.optimal_cost), self._choices(belief, measure)
        regrets = np.array([each.regret for each in choices])
        privacies = np.array([each.privacy for each in choices])
        mixture = best_mixture(regrets, privacies, limit)
        value = found.expected_privacy
        if mixture is not None:
            value = float(mixture.probabilities @ privacies[mixture.indices])
        if mixture is not None and value > found.expected_privacy + tolerances.CHORD:
            found = replace(
                found,
                actions=np.array([choices[index].action for index in mixture.indices]),
                probabilities=mixture.probabilities,
                regrets=regrets[mixture.indices],
                privacies=privacies[mixture.indices],
                expected_cost=found.optimal_cost + float(mixture.probabilities @ regrets[mixture.indices]),
                expected_privacy=value,
                price=mixture.price,
                decoys=np.array([choices[index].decoy for index in mixture.indices]),
            )
        bound = max(value, found.expected_privacy)
        return replace(found, privacy_bound=bound, status=self._status(bound, bound, found.status))

    def _allowed(self, privacy: float) -> float:
        return self.gap * max(abs(privacy), tolerances.PROOF_FLOOR)

    def _status(self, privacy: float, bound: float, kept: DecisionStatus) -> DecisionStatus:
        # With the rounding of the floor's sum.
        within = bound <= privacy + self._allowed(privacy) * (1.0 + tolerances.BUDGET_SAFETY)
        if kept not in _REPLACED and not (kept is DecisionStatus.NO_AFFORDABLE_PRIVACY and not within):
            return kept
        if bound <= privacy + tolerances.PROVED:
            return DecisionStatus.PROVED
        return DecisionStatus.GAP_REACHED if within else DecisionStatus.BOUNDED


def _spent(limit: float) -> float:
    """The budget with the rounding that searches allow."""
    return limit * (1.0 + tolerances.BUDGET_SAFETY)


def _reference(measure: PrivacyMeasure, belief: Array) -> Reference:
    found = measure.reference(belief)
    assert found is not None
    return found
