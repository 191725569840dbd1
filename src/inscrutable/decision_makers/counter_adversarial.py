"""The deterministic decision maker that hides its belief within a budget."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.budgets import Budget, as_budget, is_budget
from inscrutable.decision_makers.arguments import checked_choice, checked_measure, checked_on_empty
from inscrutable.decision_makers.candidates import Candidates, candidates_for
from inscrutable.decision_makers.cheapest_distance import cheapest_at_distance, shortened_on_its_face
from inscrutable.decision_makers.described import Described
from inscrutable.decision_makers.indicated import Case, IndicatorResult, met
from inscrutable.decision_makers.indicators import is_streamed
from inscrutable.decision_makers.local_search import LocalSearch, search_locally
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.proofs.certified import MOST_CALLS, Proofs, check_provable, checked_gap
from inscrutable.decision_makers.result_table import ResultTable, known
from inscrutable.decision_makers.results import Decision, Decisions, DecisionStatus, Progress, counted, stack
from inscrutable.decision_makers.scores import Scores, score
from inscrutable.decision_makers.search.goal import Goal
from inscrutable.decision_makers.search.polish import Trial, polish
from inscrutable.decision_makers.search.region_search import SearchSpace, best_in_regions, farthest_corners, space_of
from inscrutable.errors import InputError
from inscrutable.kernels.region_climb import Aims
from inscrutable.privacy import DesiredObfuscation, MaximalObfuscation, PrivacyMeasure
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem, checked_problem, quadratic_problem
from inscrutable.problems.magnitudes import MagnitudeRegion
from inscrutable.validation import Array


@dataclass(frozen=True)
class GlobalSearch:
    """Search all candidates, then polish the best ones to a local optimum among admissible decisions.

    Args:
        certify: The relative gap of a proof, such as 0.01: `privacy_bound` is then proven for every affordable decision,
            admissible or not, by branch and bound; exactly, and with mixtures of tied vertices, where all costs are linear
            (of a finite problem choices alone count, unless candidates mix them). None asks for no proof.
        max_oracle_calls: Beliefs solved for one proof, after which the bound stands as it is.

    Raises:
        InputError: The gap is not between 0 and 1, or the number of calls is not positive.

    Cost: the candidates and a few local searches, more above three states; a proof at one per cent takes some hundred
    forward solves for three states, some thousand for four; for linear costs one for every corner of the cells of beliefs
    that share a decision, once for all beliefs. Source: every plausible decision is optimal for some decoy,
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


DEFAULT_BUDGET = 0.1
"""A share of |c*|, as in the paper."""


class HidingDecisionMaker(Described):
    """The common part of the CDM and the PDM; arguments as there."""

    def __init__(
        self,
        problem: DecisionProblem,
        measure: Any,
        budget: Any,
        candidates: Candidates | ArrayLike | None,
        on_empty: str,
    ) -> None:
        self.problem = checked_problem(problem)
        # The two have types that cannot be mistaken, so that either may come first.
        if isinstance(measure, (Budget, float, int)) or (isinstance(measure, str) and is_budget(measure)):
            measure, budget = self._swapped(measure, budget)
        self.measure = checked_measure(measure)
        self.budget = as_budget(budget)
        self.on_empty = checked_on_empty(on_empty)
        self._given = candidates
        self._candidates: Candidates | None = None

    @staticmethod
    def _swapped(budget: Any, measure: Any) -> tuple[Any, Any]:
        """A measure, None where none was given, and a budget that came in its place."""
        if isinstance(measure, PrivacyMeasure):
            return measure, budget
        if measure == DEFAULT_BUDGET:
            return None, budget
        raise InputError(f"two budgets were given, {budget!r} and {measure!r}; expected (problem, measure, budget)")

    @property
    def candidates(self) -> Candidates:
        """The candidates, solved at first use and kept."""
        if self._candidates is None:
            self._candidates = candidates_for(self.problem, self.measure, self._given)
        return self._candidates

    @property
    def between_choices(self) -> bool:
        """Whether decisions between choices are allowed: unless they are whole numbers and so are all candidates."""
        return not self.problem.is_discrete or bool(((self.candidates.actions % 1.0) != 0.0).any())


class CounterAdversarialDecisionMaker(HidingDecisionMaker):
    """The most private decision that the budget allows (CDM).

    Formula: max_ū Ψ(ū) over ū ∈ C with ρ(π,ū) ≤ budget; decisions that no belief explains are excluded by default.

    Args:
        problem: The decision problem, known to the observer.
        measure: The privacy measure Ψ.
        budget: A share of |c*|, or a `Budget`.
        candidates: What the global search starts from; None is about 5,000 decoys. Decisions (M,U) are accepted.
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

    _shown = ("measure", "budget")

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
        self._proofs = None
        if isinstance(self.method, GlobalSearch) and self.method.certify is not None:
            check_provable(self.measure, on_empty)
            self._proofs = Proofs(problem, self.budget, self.method.certify, self.method.max_oracle_calls)

    def decide(self, belief: ArrayLike) -> Decision:
        """Return the decision for one belief (X,).

        Cost: about 0.15 ms for three states, up to 0.2 s for eight states and ninety actions; a local search some 0.1 s.
        """
        held = validation.one_belief(belief, self.problem.n_states, names=self.problem.state_names)
        self.measure.reference(held)  # refuses a target for every step
        return self._decided(held[None], None)[0]

    def decide_many(self, beliefs: ArrayLike, *, progress: Progress | None = None) -> Decisions:
        """Return the decisions for beliefs (T,X), each the one that `decide` returns; a target per step is used in turn."""
        held = validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)
        return self._decided(held, progress)

    def _decided(self, beliefs: Array, progress: Progress | None) -> Decisions:
        if self._proofs is None:
            return self._found(beliefs, progress)
        found, proved = self._found(beliefs, None), []
        for step, belief in counted(beliefs, progress):
            measure = self.measure.at_step(step)
            proved.append(self._proofs.single(belief, measure, found[step], self.between_choices))
        return stack(proved, self.problem)

    def _found(self, beliefs: Array, progress: Progress | None) -> Decisions:
        if isinstance(self.method, GlobalSearch):
            case = Case(self.problem, self.candidates, self.measure, self.budget, self.on_empty)
            return best_decisions(case, beliefs, progress)
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


def is_quadratic_distance(case: Case) -> bool:
    """Whether kernels know the problem and the measure: costs of a quadratic form, and ± the distance to a belief."""
    is_distance = type(case.measure) in (MaximalObfuscation, DesiredObfuscation) and case.on_empty == "exclude"
    return is_distance and quadratic_problem(case.problem) is not None


def searched(case: Case, beliefs: Array) -> tuple[SearchSpace, Aims, Array]:
    """Return where a measure that follows ± a distance is searched, what it seeks under beliefs (T,X), and optimal costs.

    The aims' costs are those of the space's problem: what all decisions cost alike in a state is left out, and no digit
    is lost to it.
    """
    space = space_of(case.problem, case.candidates)
    # Copies, all of one layout: kernels would be compiled anew for one that is read-only.
    held = np.array(beliefs, dtype=np.float64, order="C")
    optimal = space.problem.solve_rows(held)
    costs = (space.problem.state_costs(optimal) * held).sum(axis=1)
    optimal_costs = (case.problem.state_costs(space.decisions(optimal)) * held).sum(axis=1)
    points, sign = held, 1.0
    if isinstance(case.measure, DesiredObfuscation):
        points, sign = np.array(case.measure.targets_for(held), order="C"), -1.0
    elif not isinstance(case.measure, MaximalObfuscation):
        # A measure of the user's own, which may follow another distance under each belief.
        (reference,) = (case.measure.reference(belief) for belief in held)
        assert reference is not None, "only measures that follow a distance are searched"
        points, sign = np.array(reference.point[None], order="C"), float(reference.sign)
    limits = np.array(case.budget.limits(optimal_costs), dtype=np.float64)
    return space, Aims(held, optimal, points, sign, costs, limits, np.zeros(len(held))), optimal_costs


def best_decisions(case: Case, beliefs: Array, progress: Progress | None = None) -> Decisions:
    """Return the best single decisions of beliefs (T,X), none worse than the optimal one; each belief is searched by itself."""
    quadratic = quadratic_problem(case.problem)
    if is_quadratic_distance(case) and quadratic is not None and quadratic.bends:
        return _searched(case, beliefs, progress)
    if is_streamed(case.measure):
        return hidden(case, beliefs, progress).decisions()
    # A table of copies: what is kept for other decision makers is nobody's to change.
    return stack([_best_at(case, step, belief) for step, belief in counted(beliefs, progress)], case.problem)


def hidden(case: Case, beliefs: Array, progress: Progress | None = None) -> IndicatorResult:
    """Return how beliefs (T,X) meet a goal that is met or missed; a distance from the belief at the least regret found."""
    distance = case.measure.least_distance()
    if distance is None or quadratic_problem(case.problem) is None:
        return met(case, beliefs, progress)
    found = met(case, beliefs)
    for step, belief in counted(beliefs, progress):
        if not found.is_optimal[step]:
            most = found.regrets[step] if found.is_met[step] else case.budget.limit(found.optimal_costs[step])
            cheaper = _cheapest_at_distance(case, belief, float(most), distance)
            if cheaper is not None:
                found.improve(step, cheaper)
    return found


def _cheapest_at_distance(case: Case, belief: Array, most: float, distance: float) -> Decision | None:
    """The decision of least regret, up to `most`, that keeps a distance; None where none is found that costs less.

    Decisions that no belief explains are not among them.
    """
    problem, farthest = case.problem, case._replace(measure=MaximalObfuscation(), on_empty="exclude")

    def search(regret: float) -> Decision:
        return best_decisions(farthest._replace(budget=Budget.regret(regret)), belief[None])[0]

    def shortened(decision: Decision) -> Decision:
        action = shortened_on_its_face(problem, belief, decision.action)
        if action is None or not problem.constraints.is_admissible(action):
            return decision
        return decision_for(problem, belief, action, farthest.measure, DecisionStatus.POLISHED)

    wanted = max(distance * (1.0 + tolerances.SLACK_SAFETY), distance + tolerances.NO_PRIVACY)
    found = cheapest_at_distance(search, shortened, most, wanted)
    if found is None or not found.regret < most:
        return None
    return found if case.measure(belief, belief_set_of(problem, found.action)) == 0.0 else None


def _searched(case: Case, beliefs: Array, progress: Progress | None = None) -> Decisions:
    """The search over critical regions, for all beliefs at once."""
    space, aims, optimal_costs = searched(case, beliefs)
    found = best_in_regions(space, aims, progress)
    return Decisions(
        ResultTable(
            case.problem,
            known(space.decisions(found.actions)[:, None]),
            np.ones((len(beliefs), 1)),
            found.regrets[:, None],
            found.privacies[:, None],
            found.decoys[:, None],
            optimal_costs,
            farthest_corners(aims.points) if aims.sign > 0 else np.zeros(len(beliefs)),
            tuple(_KINDS[np.where(found.is_polished, 0, 1 if aims.sign > 0 else 2)]),
            found.prices,
        )
    )


_KINDS = np.array([DecisionStatus.POLISHED, DecisionStatus.NO_AFFORDABLE_PRIVACY, DecisionStatus.OPTIMAL], dtype=object)


def _best_at(case: Case, step: int, belief: Array) -> Decision:
    """The best decision of one belief; the latest are kept with the candidates, for other decision makers."""
    at_step = case._replace(measure=case.measure.at_step(step))
    reference = at_step.measure.reference(belief)
    goal = at_step.measure if reference is None else (type(case.measure), reference.point.tobytes(), reference.sign)
    key = (belief.tobytes(), case.budget, goal, case.on_empty)
    return case.candidates.once(key, lambda: _search(at_step, belief, reference))


def _search(case: Case, belief: Array, reference: Reference | None) -> Decision:
    problem = case.problem
    optimal = problem.solve_points(belief)
    optimal_cost = float(problem.state_costs(optimal) @ belief)
    limit = case.budget.limit(optimal_cost)
    quadratic = quadratic_problem(problem)
    if case.measure.is_indicator:
        return hidden(case, belief[None]).decisions()[0]
    if reference is not None and case.on_empty == "exclude" and quadratic is not None:
        found = _searched(case, belief[None])[0]
        if type(case.measure) not in (MaximalObfuscation, DesiredObfuscation):
            # It may follow a distance without being it.
            privacy = float(case.measure(belief, found.belief_set))
            found = replace(found, privacy=privacy, privacy_bound=max(case.measure.upper_bound(belief), privacy))
        if quadratic.bends or not _some_candidate_is_better(case, belief, found, limit):
            return found
        other = _search_candidates(case, belief, optimal, optimal_cost, limit)
        return other if other.privacy > found.privacy + tolerances.NO_PRIVACY else found
    return _search_candidates(case, belief, optimal, optimal_cost, limit)


def _some_candidate_is_better(case: Case, belief: Array, found: Decision, limit: float) -> bool:
    """Whether the search of critical regions stayed behind a candidate, as where decisions of a region are tied."""
    scores = score(belief, found.optimal_cost, case.candidates, case.measure, case.on_empty)
    index = scores.best(limit)
    return index is not None and bool(scores.privacies[index] > found.privacy + tolerances.NO_PRIVACY)


def _search_candidates(case: Case, belief: Array, optimal: Array, optimal_cost: float, limit: float) -> Decision:
    """The search by candidates and their judged sets, for every measure and problem."""
    problem, measure = case.problem, case.measure
    scores = score(belief, optimal_cost, case.candidates, measure, case.on_empty)
    status = DecisionStatus.BEST_CANDIDATE
    index = scores.best(limit)
    if index is not None and np.isposinf(scores.privacies[index]):
        return decision_for(problem, belief, scores.candidates.actions[index], measure, DecisionStatus.UNBOUNDED)
    reference = measure.reference(belief)
    if reference is None:
        action = None if index is None else scores.candidates.actions[index]
    else:
        action, status = _most_private(Goal(problem, belief, limit, optimal_cost, reference), scores, index)
    own = decision_for(problem, belief, optimal, measure, DecisionStatus.OPTIMAL)
    if action is not None:
        chosen = decision_for(problem, belief, action, measure, status)
        # A regret of rounding size allows a distance of its square root, which is no privacy.
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
