"""The decisions that a proven lottery may mix."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.envelope import Mixture, best_mixture
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.proofs.certificate import Prover
from inscrutable.decision_makers.results import DecisionStatus, MixedDecision
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class Atoms:
    """Decisions that a lottery may mix: those of the lottery found first, the optimal one, and others found by the proof."""

    def __init__(self, problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, found: MixedDecision) -> None:
        self.problem = problem
        self.belief = belief
        self.measure = measure
        own = decision_for(problem, belief, problem.solve(belief), measure, DecisionStatus.OPTIMAL)
        self.actions = [*problem.as_points(found.actions), problem.as_points(own.action)]
        self.regrets = np.append(found.regrets, 0.0)
        self.privacies = np.append(found.privacies, own.privacy)
        self.decoys = [*found.decoys, own.decoy]
        self.met: set[int] = set()

    def _mixture(self, limit: float) -> Mixture:
        mixture = best_mixture(self.regrets, self.privacies, limit)
        assert mixture is not None  # the optimal decision costs nothing
        return mixture

    def value(self, limit: float) -> tuple[float, float]:
        """Return the best expected privacy and its slope in the budget."""
        mixture = self._mixture(limit)
        return float(mixture.probabilities @ self.privacies[mixture.indices]), max(mixture.price, 0.0)

    def extend(self, prover: Prover, fresh: np.ndarray, price: float, line: float) -> bool:
        """Add the decisions of points that lie above the line Ψ = line + price · regret; return whether one does."""
        self.met.update(fresh.tolist())
        before = len(self.actions)
        for index in fresh:
            self.take(prover.action(index), price, line)
        return len(self.actions) > before

    def take(self, action: Array, price: float = 0.0, line: float = -np.inf) -> None:
        """Add a decision if it lies above the line."""
        met = decision_for(self.problem, self.belief, action, self.measure, DecisionStatus.BEST_CANDIDATE)
        if met.privacy - price * met.regret > line and not met.belief_set.is_empty:
            self.actions.append(action)
            self.decoys.append(met.decoy)
            self.regrets = np.append(self.regrets, met.regret)
            self.privacies = np.append(self.privacies, met.privacy)

    def lottery(self, found: MixedDecision, limit: float) -> MixedDecision:
        """Return the best lottery; the first one where none is better."""
        mixture = self._mixture(limit)
        privacies, regrets = self.privacies[mixture.indices], self.regrets[mixture.indices]
        expected = float(mixture.probabilities @ privacies)
        if expected <= found.expected_privacy + tolerances.CHORD:
            return found
        return replace(
            found,
            actions=np.array([self.actions[index] for index in mixture.indices]),
            probabilities=mixture.probabilities,
            regrets=regrets,
            privacies=privacies,
            expected_cost=found.optimal_cost + float(mixture.probabilities @ regrets),
            expected_privacy=expected,
            price=mixture.price,
            decoys=np.array([self.decoys[index] for index in mixture.indices]),
            status=DecisionStatus.BEST_CANDIDATE,
        )
