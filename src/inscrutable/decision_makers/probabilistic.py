"""The decision maker that hides its belief on average: a lottery over decisions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances
from inscrutable.budgets import Budget
from inscrutable.decision_makers.arguments import checked_choice
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.counter_adversarial import best_decisions, shows_nothing
from inscrutable.decision_makers.envelope import Mixture, mixture_by_linear_programme
from inscrutable.decision_makers.hiding import Case, HidingDecisionMaker
from inscrutable.decision_makers.indicator_search import cheapest_by_search
from inscrutable.decision_makers.indicators import is_streamed
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.proofs.certified import Proofs, checked_gap
from inscrutable.decision_makers.results import (
    Decision,
    Decisions,
    DecisionStatus,
    MixedDecision,
    MixedDecisions,
    Progress,
    ResultTable,
    counted,
    stack_mixed,
)
from inscrutable.decision_makers.scores import Scores, score, with_extra
from inscrutable.decision_makers.search.lottery_search import best_lotteries
from inscrutable.decision_makers.search.region_search import Best, SearchSpace, best_in_regions, farthest_corners
from inscrutable.kernels.regions import UNKNOWN
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


@dataclass(frozen=True)
class Envelope:
    """Lotteries on the concave envelope of all candidates, the optimal decision and the CDM's decision; exact at any
    budget.

    Source: the paper's eq. (12); one budget row beside Σp = 1 leaves an optimum of at most two atoms.

    Example:
        >>> Envelope()
        Envelope()
    """


@dataclass(frozen=True)
class LinearProgramme:
    """Solve the paper's eq. (12) with HiGHS over the candidates and the optimal decision, without polish.

    Source: the paper, eq. (12).

    Example:
        >>> LinearProgramme()
        LinearProgramme()
    """


class ProbabilisticDecisionMaker(HidingDecisionMaker[MixedDecision, MixedDecisions]):
    """The probabilistic decision maker (PDM): the most private lottery whose expected regret is within the budget.

    Formula: max_p Σ p_l Ψ(ū_l) with Σ p_l ρ(π,ū_l) ≤ budget, Σ p_l = 1, p ≥ 0.

    Args:
        problem: The decision problem, known to the observer.
        measure: The privacy measure Ψ.
        budget: A share of |c*|, or a `Budget`; it holds in expectation.
        candidates: The set {ū_l}; None is about 5,000 decoys. Decisions (M,U) are accepted.
        method: `Envelope()` or the paper's `LinearProgramme()`.
        certify: The relative gap of a proof over all distributions on C, such as 0.01; None asks for no proof.
        on_empty: "exclude" or "infinite": what an empty consistent set is worth to measures (b), (d) and (e).

    Raises:
        InputError: An argument is malformed.

    Cost: one pass over the candidates per belief. Source: the paper, Approach 2 and eq. (12).

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> mixed = ProbabilisticDecisionMaker(problem, budget=0.001).decide([0.5, 0.5])
        >>> len(mixed.probabilities) <= 2
        True
    """

    _prove, _stack = Proofs.lottery, staticmethod(stack_mixed)

    def __init__(
        self,
        problem: DecisionProblem,
        measure: PrivacyMeasure | None = None,
        budget: Budget | float = 0.1,
        *,
        candidates: Candidates | ArrayLike | None = None,
        method: Envelope | LinearProgramme | None = None,
        certify: float | None = None,
        on_empty: str = "exclude",
    ) -> None:
        super().__init__(problem, measure, budget, candidates, on_empty)
        self.method = checked_choice(method, "method", (Envelope, LinearProgramme))
        self._prove_within(checked_gap(certify))

    def _found(self, beliefs: Array, progress: Progress | None) -> MixedDecisions:
        case, envelope = self.case, isinstance(self.method, Envelope)
        if envelope and case.is_quadratic_distance:
            return _searched(case, beliefs, progress)
        if envelope and is_streamed(self.measure):
            return cheapest_by_search(case, beliefs, best_decisions, progress).lotteries()
        # Every lottery has the best single decision among its atoms.
        singles = best_decisions(case, beliefs, progress) if envelope else None
        mixed = [
            self._mix(belief, self.measure.at_step(step), None if singles is None else singles[step])
            for step, belief in counted(beliefs, None if envelope else progress)
        ]
        return stack_mixed(mixed, self.problem)

    def _mix(self, belief: Array, measure: PrivacyMeasure, single: Decision | None) -> MixedDecision:
        problem = self.problem
        optimal_cost = float(problem.optimal_cost(belief))
        limit = self.budget.limit(optimal_cost)
        scores = score(belief, optimal_cost, self.candidates, measure, self.on_empty)
        unbounded = np.flatnonzero(np.isposinf(scores.privacies))
        if unbounded.size and limit > 0:
            cheapest = unbounded[scores.regrets[unbounded].argmin()]
            return self._unbounded(scores, int(cheapest), limit, optimal_cost)
        scores.privacies[unbounded] = -np.inf
        extra = [decision_for(problem, belief, problem.solve(belief), measure, DecisionStatus.OPTIMAL)]
        if single is not None:
            # The decision is affordable: its regret, computed again, may differ by rounding.
            extra.append(replace(single, regret=min(single.regret, limit)))
        return self._mixed(scores, extra, limit, optimal_cost)

    def _mixed(self, scores: Scores, extra: list[Decision], limit: float, optimal_cost: float) -> MixedDecision:
        m = len(self.candidates)
        both = with_extra(scores, extra)
        if isinstance(self.method, LinearProgramme):
            for index in np.flatnonzero(~both.exact):
                both.refine(int(index))
            mixture = mixture_by_linear_programme(both.regrets, both.privacies, limit)
        else:
            mixture = both.mixture(limit)
        if mixture is None:
            return self._lottery(both, Mixture(np.array([m]), np.ones(1), 0.0), optimal_cost, _NOTHING)
        if shows_nothing(scores.measure, scores.belief, float(both.privacies[mixture.indices].max())):
            return self._lottery(both, mixture, optimal_cost, _NOTHING)
        polished = np.any(mixture.indices > m)
        status = DecisionStatus.POLISHED if polished else DecisionStatus.BEST_CANDIDATE
        return self._lottery(both, mixture, optimal_cost, status)

    def _unbounded(self, scores: Scores, index: int, limit: float, optimal_cost: float) -> MixedDecision:
        """Mix the cheapest infinitely private candidate with the optimal decision as far as the budget goes."""
        own = decision_for(
            self.problem, scores.belief, self.problem.solve(scores.belief), scores.measure, DecisionStatus.OPTIMAL
        )
        both = with_extra(scores, [own])
        share = min(1.0, limit / max(float(scores.regrets[index]), np.finfo(float).tiny))
        indices = np.array([len(self.candidates), index])
        mixture = Mixture(indices, np.array([1.0 - share, share]), float("inf"))
        return self._lottery(both, mixture, optimal_cost, DecisionStatus.UNBOUNDED)

    def _lottery(self, scores: Scores, mixture: Mixture, optimal_cost: float, status: DecisionStatus) -> MixedDecision:
        indices = mixture.indices[mixture.probabilities > 0]
        probabilities = mixture.probabilities[mixture.probabilities > 0]
        regrets = scores.regrets[indices]
        sets = scores.candidates.sets
        privacies = np.array([scores.measure(scores.belief, sets[int(i)]) for i in indices])
        expected = float(probabilities @ privacies)
        return MixedDecision(
            scores.candidates.actions[indices],
            probabilities,
            regrets,
            privacies,
            optimal_cost + float(probabilities @ regrets),
            expected,
            optimal_cost,
            max(scores.measure.upper_bound(scores.belief), expected),
            mixture.price,
            np.array([sets[int(i)].interior_point() for i in indices]),
            status,
            self.problem,
        )


_NOTHING = DecisionStatus.NO_AFFORDABLE_PRIVACY
_KINDS = np.array([_NOTHING, DecisionStatus.POLISHED, DecisionStatus.BEST_CANDIDATE], dtype=object)


def _searched(case: Case, beliefs: Array, progress: Progress | None = None) -> MixedDecisions:
    """Return the lotteries of beliefs (T,X), each searched independently, the best single decision among its atoms."""
    space = case.space
    aims, optimal_costs = space.aims(case.measure, case.budget, beliefs)
    singles = (
        best_in_regions(space, aims)
        if space.problem.is_strictly_convex
        else _as_best(space, best_decisions(case, beliefs))
    )
    found = best_lotteries(space, aims, singles, progress)
    alone = found.probabilities[:, 1] <= 0.0
    best = np.where(alone, found.privacies[:, 0], found.privacies.max(axis=1))
    nothing = best <= tolerances.NO_PRIVACY if aims.sign > 0 else np.isneginf(best)
    bound = farthest_corners(aims.points) if aims.sign > 0 else np.zeros(len(beliefs))
    status = tuple(_KINDS[np.where(nothing, 0, np.where(found.polished, 1, 2))])
    atoms = space.decisions(found.actions), found.probabilities, found.regrets, found.privacies, found.decoys
    return MixedDecisions(ResultTable(case.problem, *atoms, optimal_costs, bound, status, found.prices))


def _as_best(space: SearchSpace, singles: Decisions) -> Best:
    """Single decisions as the search over regions gives them."""
    table = singles.table
    actions = space.form.variables(table.actions[:, 0])
    polished = np.array([status is DecisionStatus.POLISHED for status in singles.status])
    nowhere = np.full(len(polished), UNKNOWN)
    return Best(actions, singles.decoy, singles.privacy, singles.regret, table.price, polished, nowhere)
