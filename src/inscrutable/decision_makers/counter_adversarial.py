"""The deterministic decision maker that hides its belief within a budget."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.budgets import Budget
from inscrutable.decision_makers.arguments import checked_choice
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.hiding import DISTANCES, Case, HidingDecisionMaker
from inscrutable.decision_makers.indicator_search import cheapest_by_search
from inscrutable.decision_makers.indicators import is_streamed
from inscrutable.decision_makers.local_search import LocalSearch, search_locally
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.proofs.certified import MOST_CALLS, Proofs, checked_gap
from inscrutable.decision_makers.results import (
    Decision,
    Decisions,
    DecisionStatus,
    Progress,
    ResultTable,
    counted,
    stack,
)
from inscrutable.decision_makers.scores import Scores, score
from inscrutable.decision_makers.search.goal import Goal
from inscrutable.decision_makers.search.region_search import best_in_regions, farthest_corners
from inscrutable.decision_makers.search.smooth import Trial, polish
from inscrutable.errors import InputError
from inscrutable.privacy import PrivacyMeasure
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem, quadratic_problem
from inscrutable.problems.magnitudes import MagnitudeRegion
from inscrutable.validation import Array


@dataclass(frozen=True)
class GlobalSearch:
    """Search all candidates, then polish the best ones to a local optimum among admissible decisions.

    Args:
        certify: The relative gap of a proof by branch and bound, such as 0.01: `privacy_bound` then holds for every affordable
            decision, admissible or not. For linear costs the proof is exact and covers mixtures of tied vertices; for a
            finite problem it covers the choices alone, unless candidates mix them. None asks for no proof.
        max_oracle_calls: Largest number of beliefs solved for one proof; the bound reached by then is returned.

    Raises:
        InputError: The gap is not between 0 and 1, or the number of calls is not positive.

    Cost: the candidates and a few local searches, more above three states; a proof at one per cent takes some hundred
    forward solves for three states, some thousand for four; for linear costs one for every vertex of the critical
    regions, once for all beliefs. Source: every plausible decision is optimal for some decoy,
    and a decoy's regret never falls along a ray from the true belief.

    Example:
        >>> GlobalSearch(certify=0.01).certify
        0.01
    """

    certify: float | None = None
    max_oracle_calls: int = MOST_CALLS

    def __post_init__(self) -> None:
        object.__setattr__(self, "certify", checked_gap(self.certify))
        object.__setattr__(self, "max_oracle_calls", validation.count(self.max_oracle_calls, "max_oracle_calls"))


class CounterAdversarialDecisionMaker(HidingDecisionMaker[Decision, Decisions]):
    """The counter-adversarial decision maker (CDM): the decision of largest privacy within the budget.

    Formula: max_ū Ψ(ū) over ū ∈ C with ρ(π,ū) ≤ budget; by default measures (b), (d) and (e) exclude decisions that no belief
    explains.

    Args:
        problem: The decision problem, known to the observer.
        measure: The privacy measure Ψ.
        budget: A share of |c*|, or a `Budget`.
        candidates: Starts of the global search; None is about 5,000 decoys. Decisions (M,U) are accepted.
        method: `GlobalSearch()` or the paper's `LocalSearch(n_starts, rng)`.
        on_empty: "exclude" or "infinite": what an empty consistent set is worth to measures (b), (d) and (e).

    Raises:
        InputError: An argument is malformed.

    Cost: see `decide`. Source: the paper, Approach 1 and eq. (8).

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> decision = CounterAdversarialDecisionMaker(problem, budget=0.001).decide([0.5, 0.5])
        >>> decision.regret <= 0.001 * abs(decision.optimal_cost)
        True
    """

    _prove, _stack = Proofs.single, staticmethod(stack)

    def __init__(
        self,
        problem: DecisionProblem,
        measure: PrivacyMeasure | None = None,
        budget: Budget | float = 0.1,
        *,
        candidates: Candidates | ArrayLike | None = None,
        method: GlobalSearch | LocalSearch | None = None,
        on_empty: str = "exclude",
    ) -> None:
        super().__init__(problem, measure, budget, candidates, on_empty)
        self.method = checked_choice(method, "method", (GlobalSearch, LocalSearch))
        if isinstance(self.method, LocalSearch) and self.problem.is_discrete:
            raise InputError("a local search needs decisions between choices: use GlobalSearch() for a finite problem")
        if isinstance(self.method, LocalSearch) and on_empty == "infinite":
            raise InputError(
                'a local search has no direction where no belief explains the decision: on_empty="exclude"'
            )
        if isinstance(self.method, GlobalSearch):
            self._prove_within(self.method.certify, self.method.max_oracle_calls)

    def _found(self, beliefs: Array, progress: Progress | None) -> Decisions:
        if isinstance(self.method, GlobalSearch):
            return best_decisions(self.case, beliefs, progress)
        locally = [
            self._decide_locally(belief, self.measure.at_step(step), self.method)
            for step, belief in counted(beliefs, progress)
        ]
        return stack(locally, self.problem)

    def _decide_locally(self, belief: Array, measure: PrivacyMeasure, method: LocalSearch) -> Decision:
        limit = self.budget.limit(float(self.problem.optimal_cost(belief)))
        action = search_locally(self.problem, belief, measure, limit, method)
        if action is None:
            status = DecisionStatus.NO_PLAUSIBLE_START
            return decision_for(self.problem, belief, self.problem.solve(belief), measure, status)
        return decision_for(self.problem, belief, action, measure, DecisionStatus.LOCAL_OPTIMUM)


def best_decisions(case: Case, beliefs: Array, progress: Progress | None = None) -> Decisions:
    """Return the best single decisions of beliefs (T,X), none worse than the optimal one; each belief independently."""
    if case.is_quadratic_distance and case.space.problem.is_strictly_convex:
        return _searched(case, beliefs, progress)
    if is_streamed(case.measure):
        return cheapest_by_search(case, beliefs, best_decisions, progress).decisions()
    # Copies: a caller must not change the decisions kept for other decision makers.
    return stack([_best_at(case, step, belief) for step, belief in counted(beliefs, progress)], case.problem)


def _searched(case: Case, beliefs: Array, progress: Progress | None = None) -> Decisions:
    """The search over critical regions, for all beliefs at once."""
    space = case.space
    aims, optimal_costs = space.aims(case.measure, case.budget, beliefs)
    found = best_in_regions(space, aims, progress)
    bound = farthest_corners(aims.points) if aims.sign > 0 else np.zeros(len(beliefs))
    status = tuple(_KINDS[np.where(found.is_polished, 0, 1 if aims.sign > 0 else 2)])
    atoms = space.decisions(found.actions), found.regrets, found.privacies, found.decoys
    return Decisions(ResultTable.of_single(case.problem, *atoms, optimal_costs, bound, status, found.prices))


_KINDS = np.array([DecisionStatus.POLISHED, DecisionStatus.NO_AFFORDABLE_PRIVACY, DecisionStatus.OPTIMAL], dtype=object)


def _best_at(case: Case, step: int, belief: Array) -> Decision:
    """The best decision of one belief; the latest are kept with the candidates, for other decision makers."""
    at_step = replace(case, measure=case.measure.at_step(step))
    reference = at_step.measure.reference(belief)
    is_known = type(case.measure) in DISTANCES
    goal = at_step.measure if reference is None or not is_known else (reference.point.tobytes(), reference.sign)
    key = (belief.tobytes(), case.budget, goal, case.on_empty)
    return case.candidates.once(key, lambda: _search(at_step, belief, reference))


def _search(case: Case, belief: Array, reference: Reference | None) -> Decision:
    problem = case.problem
    optimal = problem.solve_points(belief)
    optimal_cost = float(problem.state_costs(optimal) @ belief)
    limit = case.budget.limit(optimal_cost)
    quadratic = quadratic_problem(problem)
    if case.measure.is_indicator:
        return cheapest_by_search(case, belief[None], best_decisions).decisions()[0]
    found, least = None, -np.inf
    if reference is not None and case.on_empty == "exclude" and quadratic is not None:
        found = _searched(case, belief[None])[0]
        if type(case.measure) not in DISTANCES:
            # The measure may be a function of a distance without being equal to it.
            privacy = float(case.measure(belief, found.belief_set))
            found = replace(found, privacy=privacy, privacy_bound=max(case.measure.upper_bound(belief), privacy))
        if quadratic.is_strictly_convex:
            return found
        least = found.privacy + tolerances.NO_PRIVACY
    scores = score(belief, optimal_cost, case.candidates, case.measure, case.on_empty)
    index = scores.best(limit)
    # A candidate may be better than the search's decision where decisions of a region are tied.
    if found is not None and (index is None or not scores.privacies[index] > least):
        return found
    other = _search_candidates(Goal(problem, belief, limit, optimal_cost, case.measure), optimal, scores, index)
    return other if found is None or other.privacy > least else found


def _search_candidates(goal: Goal, optimal: Array, scores: Scores, index: int | None) -> Decision:
    """The search by candidates, the best of which is at `index`, and their judged sets, for every measure and problem."""
    problem, belief, measure, status = goal.problem, goal.belief, goal.measure, DecisionStatus.BEST_CANDIDATE
    if index is not None and np.isposinf(scores.privacies[index]):
        return decision_for(problem, belief, scores.candidates.actions[index], measure, DecisionStatus.UNBOUNDED)
    reference = measure.reference(belief)
    if reference is None:
        action = None if index is None else scores.candidates.actions[index]
    else:
        action, status = _most_private(goal, scores, index)
    own = decision_for(problem, belief, optimal, measure, DecisionStatus.OPTIMAL)
    if action is not None:
        chosen = decision_for(problem, belief, action, measure, status)
        # A regret of the size of rounding allows a distance of its square root, which does not count.
        if chosen.privacy > own.privacy + (0.0 if reference is None else tolerances.NO_PRIVACY):
            return chosen
    own = replace(own, privacy_bound=measure.upper_bound(belief))
    if shows_nothing(measure, belief, own.privacy):
        return replace(own, status=DecisionStatus.NO_AFFORDABLE_PRIVACY)
    return own


def shows_nothing(measure: PrivacyMeasure, belief: Array, privacy: float) -> bool:
    """Whether a privacy means that the goal is missed altogether: −∞, or no distance where distance is sought."""
    reference = measure.reference(belief)
    return bool(np.isneginf(privacy)) or (
        reference is not None and reference.sign > 0 and privacy <= tolerances.NO_PRIVACY
    )


def _most_private(goal: Goal, scores: Scores, index: int | None) -> tuple[Array | None, DecisionStatus]:
    start = None if index is None else Trial(scores.candidates.actions[index], float(scores.privacies[index]))
    # Linear costs need no local search: on a face the consistent set is constant, and its cheapest vertex is a candidate.
    # Limits on magnitudes have no faces of rows to search on.
    has_faces = goal.problem.linear_form() is None and not isinstance(goal.problem.constraints, MagnitudeRegion)
    found = polish(goal, scores) if has_faces else None
    if found is not None and (start is None or found.privacy > start.privacy):
        return found.action, DecisionStatus.POLISHED
    return (None if start is None else start.action), DecisionStatus.BEST_CANDIDATE
