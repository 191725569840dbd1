"""The least regret at which a given privacy is reached."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.budgets import Budget
from inscrutable.decision_makers.arguments import checked_measure
from inscrutable.decision_makers.candidate_sources import candidates_for
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.counter_adversarial import best_decisions
from inscrutable.decision_makers.frontier import Frontier, privacy_frontier
from inscrutable.decision_makers.hiding import Case
from inscrutable.decision_makers.indicator_search import central_members, cheapest_keeping_distance
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.results import DecisionStatus
from inscrutable.decision_makers.search.goal import Goal
from inscrutable.geometry.crossings import Bracket, narrowed, side
from inscrutable.privacy import MaximalObfuscation, PrivacyMeasure
from inscrutable.problems import DecisionProblem, checked_problem, quadratic_problem
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False, repr=False)
class CheapestPrivacy(Summarised, Saved):
    """The decision of least regret, of those found, that reaches a given privacy.

    Args:
        regret: Its cost above the optimal cost, in the cost's unit; infinite where no decision found reaches the privacy.
        share: The same as a share of |c*|.
        privacy: Ψ of the decision; of the optimal one where none was found.
        action: The decision, shape (U,) or a whole number; the optimal one where none was found.
        asked: The least Ψ asked for.
        most: The most Ψ found, at any cost, where none found is enough; else `privacy`.

    Source: the paper, eq. (8), with objective and constraint exchanged.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> found = cheapest_privacy(problem, [0.5, 0.5], privacy=0.1)
        >>> found.privacy >= 0.1, found.regret < 0.001
        (True, True)
    """

    regret: float
    share: float
    privacy: float
    action: Array
    asked: float
    most: float

    def summary(self) -> str:
        """Return a sentence for a person to read."""
        if np.isinf(self.regret) and self.most > self.privacy + tolerances.NO_PRIVACY:
            return (
                f"no decision found reaches a privacy of {self.asked:.4g} (the optimal one has {self.privacy:z.4g}; the most "
                f"found is {self.most:z.4g}): change the goal or the limits"
            )
        if np.isinf(self.regret):
            return f"no decision found gives more privacy than {self.privacy:z.4g}, at any cost: change the goal or the limits"
        return f"a privacy of {self.privacy:.4g} costs a regret of {self.regret:.4g}, {self.share:.3%} of |c*|"


def cheapest_privacy(
    problem: DecisionProblem,
    belief: ArrayLike,
    measure: PrivacyMeasure | None = None,
    *,
    privacy: float | None = None,
    candidates: Candidates | ArrayLike | None = None,
) -> CheapestPrivacy:
    """Return the decision of least regret, of those found, with at least a given privacy.

    Formula: min ρ(π,ū) over admissible ū with Ψ(ū) ≥ privacy, searched over the candidates and on the rays to them; for a
    distance from the true belief and quadratic costs also by decisions of largest distance at falling budgets.

    Args:
        problem: The decision problem.
        belief: π, shape (X,).
        measure: The privacy measure; None is `MaximalObfuscation()`.
        privacy: Least Ψ asked for; None is anything above what the optimal decision has.
        candidates: Decisions to start from; None is about 5,000 decoys.

    Returns:
        A `CheapestPrivacy`; its regret is an upper bound of the least one. A decision maker with coarser candidates may
        find its action only if that is among the candidates.

    Raises:
        InputError: The belief is not one point of the simplex, or `privacy` is not a number.
        ModelError: The measure favours decisions that no belief explains, and the feasible set is unbounded.

    Cost: a frontier, and forward solves along a ray to each candidate that reaches the privacy: up to some 150,000, half a
    minute, where `privacy` is None.

    Source: the paper, eq. (8).

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> print(cheapest_privacy(problem, [0.5, 0.5], privacy=0.9).summary().partition(":")[0])
        no decision found reaches a privacy of 0.9 (the optimal one has 0; the most found is 0.7071)
    """
    held = validation.one_belief(belief, checked_problem(problem).n_states, names=problem.state_names)
    chosen = checked_measure(measure)
    given = candidates_for(problem, chosen, candidates)
    optimal = decision_for(problem, held, problem.solve(held), chosen, DecisionStatus.OPTIMAL)
    goal = Goal(problem, held, np.inf, optimal.optimal_cost, chosen)
    own = optimal.privacy
    if privacy is not None:
        least = validation.number_of(privacy, "privacy")
    else:
        least = own + tolerances.NO_PRIVACY if np.isfinite(own) else -np.finfo(float).max
    if own >= least:
        return CheapestPrivacy(0.0, 0.0, own, optimal.action, least, own)
    search = _Search(goal, given, least)
    best = search.best()
    if best is None:
        most = float(search.frontier.points[:, 1].max(initial=own))
        return CheapestPrivacy(float("inf"), float("inf"), own, optimal.action, least, most)
    regret, action = best
    size = abs(goal.optimal_cost)
    reached = float(goal.judged(action[None]).privacies[0])
    share = regret / size if size else float("inf")
    return CheapestPrivacy(regret, share, reached, problem.as_actions(action), least, reached)


@dataclass(frozen=True)
class _Search:
    goal: Goal
    candidates: Candidates
    least: float

    @cached_property
    def frontier(self) -> Frontier:
        """The undominated candidates."""
        return privacy_frontier(self.goal.problem, self.goal.belief, self.goal.measure, candidates=self.candidates)

    def _reach(self, actions: Array) -> np.ndarray:
        """Return which decisions (n,U) are admissible and reach the privacy."""
        found = self.goal.judged(actions)
        return np.asarray(found.admissible & (found.privacies >= self.least))

    def best(self) -> tuple[float, Array] | None:
        """Return the cheapest decision that reaches the privacy, among the candidates, on the rays to those on the frontier,
        and by a search for least regret.

        Rays to the first eight alone cost up to 34 % more in 3 of 40 goals over two to five states.
        """
        problem, belief, frontier = self.goal.problem, self.goal.belief, self.frontier
        known = (frontier.points[:, 1] >= self.least) & (frontier.indices < len(self.candidates.actions))
        if not known.any() and not self.goal.measure.is_indicator:
            return None
        ends = self.candidates.actions[frontier.indices[known]]
        limit = float(frontier.points[known, 0].min(initial=np.finfo(float).max))
        found = [ends, self._on_rays(ends), *self._of_decision_maker(limit)]
        actions = np.vstack(found)
        regrets = problem.regret(belief, actions)
        for n in np.argsort(regrets, kind="stable"):
            if self._reach(actions[n : n + 1])[0]:
                return float(regrets[n]), actions[n]
        return None

    def _of_decision_maker(self, limit: float) -> list[Array]:
        """Return the decision of least regret that meets an indicator, or reaches a distance; empty for other measures."""
        problem, belief, measure = self.goal.problem, self.goal.belief, self.goal.measure
        case = Case(problem, self.candidates, measure, Budget.regret(limit), "exclude")
        if measure.is_indicator:
            return [problem.as_points(best_decisions(case, belief[None])[0].action)]
        if not isinstance(measure, MaximalObfuscation) or quadratic_problem(problem) is None:
            return []
        found = cheapest_keeping_distance(case, belief, best_decisions, limit, self.least)
        return [] if found is None else [problem.as_points(found.action)]

    def _on_rays(self, ends: Array) -> Array:
        """The first decisions that reach the privacy on the rays to beliefs that explain `ends` (n,U), all together; what no
        belief explains has no ray."""
        problem, belief = self.goal.problem, self.goal.belief
        targets = central_members(problem, ends)
        targets = targets[np.isfinite(targets).all(axis=1)]

        def decisions(which: np.ndarray, shares: Array) -> Array:
            return problem.solve_points(belief + shares[:, None] * (targets[which] - belief))

        ones = np.ones(len(targets))
        shares = narrowed(
            lambda which, shares: side(self._reach(decisions(which, shares))),
            Bracket(ones, 0.0 * ones),
            Bracket(side(ones > 0.0), side(ones < 0.0)),
        ).inside
        return decisions(np.arange(len(targets)), shares)
