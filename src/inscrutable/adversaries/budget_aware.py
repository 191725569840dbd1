"""The set of the budget-aware observer: the beliefs under which a decision is affordable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.adversaries.near_optimal import NearOptimalBeliefs, near_optimal_beliefs, regret_accuracy
from inscrutable.adversaries.plausibility import planes_below
from inscrutable.axes import Names
from inscrutable.budgets import Budget, as_budget
from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class ScaledBeliefs(NearOptimalBeliefs):
    """The set {π ∈ Δ : π·s(u) ≤ k V(π)} with k ≥ 0, which is convex because V is concave. `regret` is 0."""

    share: float = 1.0
    room: float = 0.0

    @property
    def _room(self) -> float:
        return self.room

    def _planes_at(self, beliefs: Array) -> Array:
        return np.asarray(self._own_costs - self.share * self.problem.state_costs(self.problem.solve(beliefs)))

    @cached_property
    def _explanation(self) -> tuple[Array, float]:
        """Return a member, or the belief that exceeds the limit least."""
        own = self._own_costs
        if self.share == 0:
            return np.eye(self.n_states)[int(own.argmin())], max(float(own.min()), 0.0)
        scaled = np.where(own < self.problem.ruin_cost, own / self.share, own)
        found = planes_below(self.problem, scaled, self._level / self.share)
        return found.belief, self.share * found.gap


@dataclass(frozen=True, eq=False)
class AffordableBeliefs:
    """The beliefs under which a decision is within the budget: one convex set, or two where V changes its sign.

    Formula: {π ∈ Δ : ρ(π,u) ≤ r}, or {π : π·s(u) ≤ (1+c)V(π)} ∪ {π : π·s(u) ≤ (1−c)V(π)} for a share c of |V|: where V ≥ 0 the
    first set is the condition and the second is nearly empty; where V < 0 the roles are reversed.

    Args:
        pieces: The convex sets, computed like `NearOptimalBeliefs`, to the same accuracy.

    Source: a decision maker within its budget always leaves its own belief in the set.

    Example:
        >>> import numpy as np
        >>> from inscrutable import BudgetAwareAdversary, MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> BudgetAwareAdversary(problem, 0.01).infer([0.5, 0.5]).bounds().round(2)
        array([[0.06, 0.94],
               [0.06, 0.94]])
    """

    pieces: tuple[NearOptimalBeliefs, ...]

    def __repr__(self) -> str:
        return f"beliefs over {self.n_states} states under which the decision is affordable, {len(self.pieces)} convex set(s)"

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return self.pieces[0].n_states

    @property
    def state_names(self) -> Names | None:
        """Labels of the states, where the problem has them."""
        return self.pieces[0].state_names

    @cached_property
    def _held(self) -> tuple[NearOptimalBeliefs, ...]:
        return tuple(piece for piece in self.pieces if not piece.is_empty)

    @property
    def is_empty(self) -> bool:
        """Whether the decision is beyond the budget under every belief; a status, not an error."""
        return not self._held

    @property
    def dimension(self) -> int:
        """Largest dimension of a piece; −1 for the empty set."""
        return max((piece.dimension for piece in self._held), default=-1)

    def contains(self, belief: ArrayLike) -> bool:
        """Return whether the decision is affordable under the belief."""
        return any(piece.contains(belief) for piece in self.pieces)

    def nearest(self, belief: ArrayLike) -> Array:
        """Return the member nearest to `belief` (X,); NaN where the set is empty."""
        point = validation.one_belief(belief, self.n_states, names=self.state_names)
        members = [piece.nearest(point) for piece in self._held]
        return min(members, key=lambda member: np.linalg.norm(member - point), default=np.full(self.n_states, np.nan))

    def distance(self, belief: ArrayLike) -> float:
        """Return the Euclidean distance from `belief` (X,) to the set; infinite where it is empty."""
        return min((piece.distance(belief) for piece in self._held), default=float("inf"))

    def vertices(self) -> Array:
        """Return the corners of the pieces, shape (V,X)."""
        return np.vstack([np.zeros((0, self.n_states)), *(piece.vertices() for piece in self._held)])

    def bounds(self) -> Array:
        """Return the least and greatest probability of each state, shape (X,2); NaN where the set is empty."""
        if self.is_empty:
            return np.full((self.n_states, 2), np.nan)
        each = np.array([piece.bounds() for piece in self._held])
        return np.column_stack([each[:, :, 0].min(axis=0), each[:, :, 1].max(axis=0)])

    def center(self) -> Array:
        """Return the mean of the corners, shape (X,); NaN where the set is empty. With two pieces it may lie in neither."""
        return np.full(self.n_states, np.nan) if self.is_empty else np.asarray(self.vertices().mean(axis=0))


def affordable_beliefs(problem: DecisionProblem, action: ArrayLike, budget: Budget | float) -> AffordableBeliefs:
    """Return the beliefs under which `action` is within a budget; a number is a share of |c*|.

    Raises `InputError` for a share above 1 where V is negative somewhere: the set is then not a union of convex sets.
    """
    limit = as_budget(budget)
    if not limit.is_relative:
        return AffordableBeliefs((near_optimal_beliefs(problem, action, limit.amount),))
    u, share = checked_problem(problem).check_action(action), limit.amount
    corners = np.asarray(problem.optimal_cost(np.eye(problem.n_states)))
    if share > 1 and corners.min() < 0:
        raise InputError(
            f"a budget of {share:g} |c*| with a negative optimal cost ({corners.min():.3g} in state {corners.argmin()}) "
            "has no convex set of beliefs: give Budget.regret(amount), or a share of at most 1"
        )
    room = share * max(
        abs(float(problem.optimal_cost(np.full(problem.n_states, 1.0 / problem.n_states)))), corners.mean()
    )
    # V is concave: it is negative somewhere only if it is at a corner.
    shares = (1.0 + share,) if corners.min() >= 0 or share == 0 else (1.0 + share, 1.0 - share)
    accuracy = regret_accuracy(problem, u, room)
    return AffordableBeliefs(tuple(ScaledBeliefs(problem, u, 0.0, accuracy, share=each, room=room) for each in shares))
