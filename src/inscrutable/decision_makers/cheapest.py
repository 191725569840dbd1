"""The least regret at which a given privacy is reached."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries import consistent_sets
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.budgets import Budget
from inscrutable.decision_makers.arguments import checked_measure
from inscrutable.decision_makers.candidate_sources import candidates_for
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.counter_adversarial import best_decisions
from inscrutable.decision_makers.frontier import privacy_frontier
from inscrutable.decision_makers.hiding import Case
from inscrutable.decision_makers.indicator_search import central_members, cheapest_keeping_distance
from inscrutable.geometry.crossings import Bracket, narrowed, side
from inscrutable.privacy import MaximalObfuscation, PrivacyMeasure
from inscrutable.problems import DecisionProblem, checked_problem, quadratic_problem
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False, repr=False)
class CheapestPrivacy(Summarised, Saved):
    """The decision of least regret found that reaches a privacy.

    Args:
        regret: Its cost above the optimal cost, in the cost's unit; infinite where no decision found reaches the privacy.
        share: The same as a share of |c*|.
        privacy: Ψ of the decision; of the optimal one where none was found.
        action: The decision, shape (U,); the optimal one where none was found.

    Source: the paper, eq. (8), read from the goal to the budget.

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

    def summary(self) -> str:
        """Return a sentence for a person to read."""
        if np.isinf(self.regret):
            return f"no decision found gives more privacy than {self.privacy:.4g}, at any cost: change the goal or the limits"
        return f"a privacy of {self.privacy:.4g} costs a regret of {self.regret:.4g}, {self.share:.3%} of |c*|"


def cheapest_privacy(
    problem: DecisionProblem,
    belief: ArrayLike,
    measure: PrivacyMeasure | None = None,
    *,
    privacy: float | None = None,
    candidates: Candidates | ArrayLike | None = None,
) -> CheapestPrivacy:
    """Return the decision of least regret found with at least a given privacy.

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

    Cost: a frontier and some hundred forward solves. Source: the paper, eq. (8).

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> print(cheapest_privacy(problem, [0.5, 0.5], privacy=0.9).summary())
        no decision found gives more privacy than 0, at any cost: change the goal or the limits
    """
    held = validation.one_belief(belief, checked_problem(problem).n_states, names=problem.state_names)
    chosen = checked_measure(measure)
    given = candidates_for(problem, chosen, candidates)
    search = _Search(problem, held, chosen, given)
    own = search.privacy(search.optimal)
    if privacy is None:
        search.least = own + tolerances.NO_PRIVACY if np.isfinite(own) else -np.finfo(float).max
    else:
        search.least = validation.number_of(privacy, "privacy")
    best = (0.0, search.optimal) if own >= search.least else search.best()
    if best is None:
        return CheapestPrivacy(float("inf"), float("inf"), own, search.optimal)
    regret, action = best
    size = abs(search.optimal_cost)
    return CheapestPrivacy(regret, regret / size if size else float("inf"), search.privacy(action), action)


class _Search:
    def __init__(
        self, problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, candidates: Candidates
    ) -> None:
        self.problem, self.belief, self.measure, self.candidates = problem, belief, measure, candidates
        self.optimal = problem.solve_points(belief)
        self.optimal_cost = float(problem.expected_cost(belief, self.optimal))
        self.least = 0.0

    def privacy(self, action: Array) -> float:
        beliefs = belief_set_of(self.problem, action)
        if beliefs.is_empty and not self.measure.judges_empty:
            return -np.inf
        return float(self.measure(self.belief, beliefs))

    def _reach(self, actions: Array) -> np.ndarray:
        """Which of decisions (n,U) are admissible and have the privacy."""
        sets = consistent_sets(self.problem, actions)
        values = self.measure.values(self.belief, sets)
        reach = self.problem.constraints.is_admissible(actions) & (values.privacies >= self.least)
        if not self.measure.judges_empty:
            reach &= sets.dimension >= 0
        for n in np.flatnonzero(reach & ~values.exact):
            reach[n] = self.measure(self.belief, sets[int(n)]) >= self.least
        return np.asarray(reach)

    def best(self) -> tuple[float, Array] | None:
        """The cheapest decision with the privacy among the candidates, on the rays to those on the frontier, and of a decision
        maker who seeks the least regret at a distance.

        Rays to the first eight alone cost up to 34 % more in 3 of 40 goals over two to five states.
        """
        frontier = privacy_frontier(self.problem, self.belief, self.measure, candidates=self.candidates)
        known = (frontier.points[:, 1] >= self.least) & (frontier.indices < len(self.candidates.actions))
        if not known.any():
            return None
        ends = self.candidates.actions[frontier.indices[known]]
        found = [ends, self._on_rays(ends), *self._of_decision_maker(float(frontier.points[known][0, 0]))]
        actions = np.vstack(found)
        regrets = self.problem.regret(self.belief, actions)
        for n in np.argsort(regrets, kind="stable"):
            if self.problem.constraints.is_admissible(actions[n]) and self.privacy(actions[n]) >= self.least:
                return float(regrets[n]), actions[n]
        return None

    def _of_decision_maker(self, limit: float) -> list[Array]:
        """What a decision maker plays that meets a goal at least regret, where the privacy is one or a distance."""
        case = Case(self.problem, self.candidates, self.measure, Budget.regret(limit), "exclude")
        if self.measure.is_indicator:
            return [self.problem.as_points(best_decisions(case, self.belief[None])[0].action)]
        if not isinstance(self.measure, MaximalObfuscation) or quadratic_problem(self.problem) is None:
            return []
        found = cheapest_keeping_distance(case, self.belief, best_decisions, limit, self.least)
        return [] if found is None else [self.problem.as_points(found.action)]

    def _on_rays(self, ends: Array) -> Array:
        """The first decisions that reach the privacy on the rays to beliefs that explain `ends` (n,U), all together; what no
        belief explains has no ray."""
        targets = central_members(self.problem, ends)
        targets = targets[np.isfinite(targets).all(axis=1)]

        def decisions(which: np.ndarray, shares: Array) -> Array:
            return self.problem.solve_points(self.belief + shares[:, None] * (targets[which] - self.belief))

        ones = np.ones(len(targets))
        shares = narrowed(
            lambda which, shares: side(self._reach(decisions(which, shares))),
            Bracket(ones, 0.0 * ones),
            Bracket(side(ones > 0.0), side(ones < 0.0)),
        ).inside
        return decisions(np.arange(len(targets)), shares)
