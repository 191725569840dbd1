"""The interface of every decision problem, and what follows from its costs alone."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, Names, ordered_array
from inscrutable.errors import InputError
from inscrutable.problems.constraints import Polyhedron
from inscrutable.problems.forms import LinearForm, QuadraticForm, SmoothForm
from inscrutable.validation import Array


class DecisionProblem(ABC):
    """A decision u ∈ C with cost c(i, u) in state i: convex in u, smooth, and known to the observer.

    A subclass gives `constraints`, `n_states`, `solve`, `state_costs` and `cost_gradients`; the rest follows. One whose costs
    are quadratic or linear says so by `quadratic_form` or `linear_form`, and is then searched and proved as such; costs with
    kinks override `smooth_form`. `inscrutable.testing.check_decision_problem` tests a subclass.

    Source: the paper, eq. (3).

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> isinstance(problem, DecisionProblem), problem.n_states, problem.n_actions
        (True, 2, 2)
    """

    constraints: Polyhedron

    state_names: Names | None = None
    """The states' labels where the problem was built from labelled tables: labelled beliefs are aligned with them."""

    is_discrete: bool = False
    """Whether decisions are single choices, without mixtures."""

    cost_accuracy: float = tolerances.COST_ACCURACY
    """Largest excess of the cost of `solve(π)` over V(π), relative to the largest expected size Σ π_i|c(i,u) − c(i,v)| of a
    difference of costs; proofs allow for it and for the rounding of costs."""

    ruin_cost: float = np.inf
    """State cost that stands for an infinite one; accuracies are not relative to it."""

    @property
    def costs_are_unique(self) -> bool:
        """Whether all optimal decisions of a belief have the same state costs, so that V is smooth; False is always safe."""
        return False

    @property
    def without_common_costs(self) -> DecisionProblem:
        """The problem without costs that all decisions share in a state: the same decisions, regrets and consistent beliefs,
        without the rounding of a large common cost. Returning the problem itself is always valid."""
        return self

    @property
    @abstractmethod
    def n_states(self) -> int:
        """Number of states X."""

    @property
    def n_actions(self) -> int:
        """Number of coordinates U of a decision."""
        return self.constraints.n_actions

    @property
    def asset_names(self) -> Names | None:
        """Labels of a decision's coordinates where known, those of the feasible set: labelled decisions are aligned."""
        return self.constraints.asset_names

    @abstractmethod
    def solve(self, beliefs: ArrayLike) -> Array:
        """Return u*(π) = argmin_{u ∈ C} π·s(u) for one belief (X,) or many (T,X): shape (U,) or (T,U)."""

    @abstractmethod
    def state_costs(self, actions: ArrayLike) -> Array:
        """Return s(u) = (c(1,u), …, c(X,u)) for decisions (…,U): shape (…,X)."""

    @abstractmethod
    def cost_gradients(self, action: ArrayLike) -> Array:
        """Return ∇_u c(i,u) for every state i: shape (X,U), or (…,X,U) for decisions (…,U)."""

    def quadratic_form(self) -> QuadraticForm | None:
        """Return the costs as quadratic ones, or None, which is always valid; with them searches are exact and fast."""
        return None

    def linear_form(self) -> LinearForm | None:
        """Return the costs as linear ones, or None, which is always valid; with them proofs are exact."""
        return None

    def smooth_form(self) -> SmoothForm | None:
        """Return the smooth problem that an observer inverts; None where `explaining_rows` gives the consistent beliefs.

        For costs with kinks it is one in which the kinks are rows of the feasible set; for others the problem itself.
        """
        return SmoothForm(self.constraints, self.cost_gradients)

    def is_admissible(self, actions: Array) -> np.ndarray:
        """Return whether decisions (…,U) may be played, shape (…). Each row of C, and each kink of the costs, must be tight or
        slack by at least `min_slack`: the observer then cannot mistake an inactive row for an active one. Bends of limits are
        judged together with kinks, which may be near them."""
        form = self.smooth_form()
        if form is None or form.lift is None:
            return self.constraints.is_admissible(actions)
        if self.constraints.needs_lift:
            usable = np.asarray(self.constraints.violation(actions) <= tolerances.FEASIBILITY)
        else:
            usable = self.constraints.is_admissible(actions)
        return np.asarray(usable & form.constraints.is_admissible(form.lift.variables(actions)))

    def explaining_rows(self, action: Array) -> Array | None:
        """Return rows Q (m,X) with Π(u) = {π : Q π ≥ 0} of one decision (U,) for costs without gradients, else None."""
        return None

    def as_points(self, actions: ArrayLike) -> Array:
        """Return decisions as points (…,U) of the feasible set's space: themselves, unless decisions are whole numbers."""
        return validation.points(actions, self.n_actions, Axis("asset", self.asset_names))

    def as_actions(self, points: Array) -> Any:
        """Return points (…,U) as decisions of the public interface: themselves, unless decisions are whole numbers."""
        return points

    def solve_points(self, beliefs: ArrayLike) -> Array:
        """Return u*(π) as points: shape (U,) or (T,U)."""
        return self.as_points(self.solve(beliefs))

    def expected_cost(self, beliefs: ArrayLike, actions: ArrayLike) -> Array:
        """Return π·s(u), paired: beliefs (T,X) with decisions (T,U) give (T,); a single one broadcasts."""
        held, points = self._paired(beliefs, actions)
        return _plain((held * self.state_costs(points)).sum(axis=-1))

    def _paired(self, beliefs: ArrayLike, actions: ArrayLike) -> tuple[Array, Array]:
        rows = Axis("row", learns=True)
        held, points = self.check_beliefs(beliefs, rows=rows), self._checked_actions(actions, rows)
        if held.ndim == points.ndim == 2 and len(held) != len(points) and 1 not in (len(held), len(points)):
            raise InputError(
                f"{len(held)} beliefs with {len(points)} actions: give as many of each, or one of either; "
                "for all pairs use beliefs @ problem.state_costs(actions).T"
            )
        return held, points

    def optimal_cost(self, beliefs: ArrayLike) -> Array:
        """Return V(π) = min_{u ∈ C} π·s(u) for one belief (X,) or many (T,X): shape () or (T,)."""
        held = self.check_beliefs(beliefs)
        return _plain((held * self.state_costs(self.solve(held))).sum(axis=-1))

    def regret(self, beliefs: ArrayLike, actions: ArrayLike) -> Array:
        """Return ρ(π,u) = π·s(u) − V(π) ≥ 0, paired as `expected_cost`."""
        held, points = self._paired(beliefs, actions)
        problem = self.without_common_costs
        # A difference of two nearly equal costs may round below zero.
        expected = (held * problem.state_costs(points)).sum(axis=-1)
        return _plain(np.maximum(expected - problem.optimal_cost(held), 0.0))

    def check_beliefs(self, beliefs: ArrayLike, *, rows: Axis | None = None) -> Array:
        """Return beliefs (X,) or (T,X) as floats in the order of the states' labels; raise `InputError` for others.

        `rows` is the axis of labels that the beliefs share with other arguments row by row.
        """
        return validation.beliefs(beliefs, self.n_states, names=self.state_names, rows=rows)

    def check_actions(self, actions: ArrayLike) -> Array:
        """Return decisions (U,) or (T,U) as floats in the order of the coordinates' labels; raise `InputError` for a
        wrong length, other labels or one outside C."""
        return self._checked_actions(actions, None)

    def _checked_actions(self, actions: ArrayLike, rows: Axis | None) -> Array:
        given: ArrayLike = actions
        if self.is_discrete:
            kind = ordered_array(actions, "action", (rows, None))
            given = self.as_points(kind) if kind.dtype.kind in "iu" or not kind.ndim else actions
        points = validation.finite_array(given, "action", ndim=(1, 2), axes=(rows, Axis("asset", self.asset_names)))
        if points.shape[-1] != self.n_actions:
            raise InputError(f"action has {points.shape[-1]} coordinates, expected {self.n_actions}")
        self.constraints.check_inside(points, "action")
        return points

    def check_action(self, action: ArrayLike) -> Array:
        """Return one decision (U,) as floats; raise `InputError` for many, a wrong length or one outside C."""
        point = self.check_actions(action)
        if point.ndim != 1:
            raise InputError(f"action must be one decision of shape ({self.n_actions},), got shape {point.shape}")
        return point


def _plain(values: Array) -> Array:
    """A NumPy number for one belief and one decision, an array for many."""
    return np.asarray(values)[()]


def checked_problem(problem: Any) -> DecisionProblem:
    """Return a decision problem, or raise `InputError`."""
    if not isinstance(problem, DecisionProblem):
        raise InputError(f"problem must be a decision problem such as MarkowitzProblem(...), got {problem!r}")
    return problem
