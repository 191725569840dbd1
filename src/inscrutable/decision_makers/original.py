"""The decision maker that hides nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.decision_makers.arguments import Described
from inscrutable.decision_makers.results import Decision, Decisions, DecisionStatus, Progress, counted, stack
from inscrutable.privacy import MaximalObfuscation, PrivacyMeasure
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array


class OriginalDecisionMaker(Described):
    """The decision maker of least expected cost, without regard to observers (ODM).

    Formula: u*(π) = argmin_{u ∈ C} π·s(u).

    Args:
        problem: The decision problem.

    Cost: one forward solve per belief. Source: the paper, eq. (3).

    Example:
        >>> import numpy as np
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> OriginalDecisionMaker(problem).decide([0.5, 0.5]).privacy
        0.0
    """

    def __init__(self, problem: DecisionProblem) -> None:
        self.problem = checked_problem(problem)

    def decide(self, belief: ArrayLike) -> Decision:
        """Return the optimal decision for one belief (X,); privacy is the paper's measure (e)."""
        held = validation.one_belief(belief, self.problem.n_states, names=self.problem.state_names)
        return decision_for(self.problem, held, self.problem.solve(held), MaximalObfuscation(), DecisionStatus.OPTIMAL)

    def decide_many(self, beliefs: ArrayLike, *, progress: Progress | None = None) -> Decisions:
        """Return the optimal decisions for beliefs (T,X)."""
        held = validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)
        actions = self.problem.solve(held)
        measure = MaximalObfuscation()
        return stack(
            [
                decision_for(self.problem, belief, actions[step], measure, DecisionStatus.OPTIMAL)
                for step, belief in counted(held, progress)
            ],
            self.problem,
        )

    def table(self, beliefs: ArrayLike) -> tuple[Array, np.ndarray, Array]:
        """Return the optimal decisions for beliefs (T,X) as points (T,U), the number of each belief's own and its share 1.

        The same as `decide_many`, without the consistent beliefs of each decision.
        """
        held = validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)
        return certain(np.atleast_2d(self.problem.solve_points(held)))


def certain(points: Array) -> tuple[Array, np.ndarray, Array]:
    """Return points (T,U) as the table of decisions without draws: the number of each, (T,1), and its share 1, (T,1)."""
    return points, np.arange(len(points))[:, None], np.ones((len(points), 1))


def decision_for(
    problem: DecisionProblem, belief: Array, action: Array, measure: PrivacyMeasure, status: DecisionStatus
) -> Decision:
    """Return an action with its cost, regret and privacy, computed from the action alone."""
    action = problem.as_points(action)
    found = belief_set_of(problem, action)
    best, relative = problem.solve_points(belief), problem.without_common_costs
    optimal, cost = (float(problem.expected_cost(belief, each)) for each in (best, action))
    regret = float(relative.expected_cost(belief, action) - relative.expected_cost(belief, best))
    privacy = float(measure(belief, found))
    decision = Decision(
        action,
        cost,
        optimal,
        max(regret, 0.0),
        privacy,
        0.0 if status is DecisionStatus.OPTIMAL else max(measure.upper_bound(belief), privacy),
        found.interior_point(),
        status,
        problem,
    )
    vars(decision)["belief_set"] = found
    return decision
