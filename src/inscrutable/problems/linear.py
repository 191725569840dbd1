"""Linear costs: one vector of prices per state, and a vertex of the feasible set as the decision."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError, ModelError
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems.base import DecisionProblem
from inscrutable.problems.constraints import Polyhedron, checked_region
from inscrutable.problems.forms import Lift, LinearForm, SmoothForm
from inscrutable.problems.magnitudes import MagnitudeRegion
from inscrutable.problems.segments import Segments
from inscrutable.problems.vertices import VertexTable
from inscrutable.validation import Array


class LinearProblem(DecisionProblem):
    """A decision with one linear cost per state.

    Formula: c(i,u) = c_i'u over u ∈ C.

    Some vertex of C is optimal for every belief, and Π(u) is a cell of the simplex: the beliefs whose expected cost vector
    lies in the negative normal cone of C at u. On the boundary between cells several vertices are optimal, and so are their
    mixtures. `solve` then returns the one that is least in a fixed direction, the same at every call.

    Decision makers choose among vertices and mixtures of tied vertices, which fewer beliefs explain, so that they can be far
    more private at almost the same cost; `decoy_grid(problem, r)` has vertices alone, with `faces=True` mixtures too. With
    `certify` a proof covers every decision in C. A mixture of all vertices tied at
    a belief has the smallest consistent set, and its cost can be arbitrarily near that of the cheapest of them: the suprema
    are exact, and not attained only where a mixture needs less than `min_slack` of something.

    Args:
        costs: c_i, shape (X,U), cost per decision.
        constraints: The feasible set C.

    Raises:
        InputError: Shapes disagree or an entry is not finite.
        ModelError: C is empty (its rows are named), or a state's cost is unbounded below on it.

    Cost: one linear programme per distinct vertex, then products. Source: the paper, eq. (3), for a linear cost.

    Example:
        >>> from inscrutable.problems import simplex
        >>> problem = LinearProblem([[0.0, 2.0], [1.0, 0.0]], simplex(2))
        >>> print(problem.solve([[0.5, 0.5], [0.2, 0.8]]))
        [[1. 0.]
         [0. 1.]]
    """

    def __init__(self, costs: ArrayLike, constraints: Polyhedron) -> None:
        states, assets = Axis("state", learns=True), Axis("asset", learns=True)
        self.costs = validation.finite_array(costs, "costs", ndim=2, axes=(states, assets))
        if not self.costs.size:
            raise InputError(f"costs has shape {self.costs.shape}, expected at least one state and one coordinate")
        self.constraints = checked_region(constraints, self.costs.shape[1], assets, lifts=True)
        self.state_names = states.names
        if self._lifted is None:
            self._check_bounded()

    @cached_property
    def _lifted(self) -> tuple[LinearProblem, Segments] | None:
        """The problem, up to constants, in the variables in which all limits are rows; None where they are rows already."""
        if not isinstance(self.constraints, MagnitudeRegion):
            return None
        segments = self.constraints.segments
        costs = segments.linear(self.costs, np.zeros((*self.costs.shape, self.costs.shape[1])))
        return LinearProblem(costs, segments.feasible()), segments

    def _check_bounded(self) -> None:
        region = self.constraints
        for i, cost in enumerate(self.costs):
            scale = np.abs(cost).max()
            answer = minimise(
                cost / (scale if scale > 0 else 1.0), Rows(region.A_ub, region.b_ub), Rows(region.A_eq, region.b_eq)
            )
            if answer.status != OPTIMAL:
                raise ModelError(
                    f"the cost of state {i} has no minimum over the feasible set, which is unbounded where the cost falls: "
                    f"add bounds ({answer.message})"
                )

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return int(self.costs.shape[0])

    def linear_form(self) -> LinearForm:
        """Return c_i and C, in the variables in which all limits are rows."""
        if self._lifted is None:
            return LinearForm(self.costs, self.constraints)
        stated, segments = self._lifted
        return LinearForm(stated.costs, stated.constraints, Lift(segments.variables, segments.decisions))

    def smooth_form(self) -> SmoothForm | None:
        """Return the same with its gradients."""
        if self._lifted is None:
            return super().smooth_form()
        form = self.linear_form()
        return SmoothForm(form.constraints, self._lifted[0].cost_gradients, form.lift)

    @cached_property
    def without_common_costs(self) -> LinearProblem:
        """The problem without costs that the equalities of C make equal for all decisions; itself where these are small."""
        less = without_common(self.costs, self.constraints.A_eq)
        return self if less is self.costs else self._with_costs(less)

    def _with_costs(self, costs: Array) -> LinearProblem:
        return LinearProblem(costs, self.constraints)

    @cached_property
    def _table(self) -> VertexTable:
        return VertexTable(self.without_common_costs.costs, self.constraints)

    def solve(self, beliefs: ArrayLike) -> Array:
        """Return an optimal vertex for one belief (X,) or many (T,X): shape (U,) or (T,U); the same one of ties."""
        held = self.check_beliefs(beliefs)
        if self._lifted is not None:
            return self._lifted[1].decisions(self._lifted[0].solve(held))
        solved = self._table.solve(np.atleast_2d(held))
        return np.asarray(solved[0]) if held.ndim == 1 else solved

    def state_costs(self, actions: ArrayLike) -> Array:
        """Return c(i,u) for decisions (…,U): shape (…,X)."""
        return np.asarray(self.as_points(actions) @ self.costs.T)

    def cost_gradients(self, action: ArrayLike) -> Array:
        """Return c_i for decisions (…,U): shape (…,X,U), the same for all."""
        points = self.as_points(action)
        return np.array(np.broadcast_to(self.costs, (*points.shape[:-1], *self.costs.shape)))

    def __repr__(self) -> str:
        return f"LinearProblem({self.n_states} states, {self.n_actions} coordinates)"


def without_common(costs: Array, equalities: Array) -> Array:
    """Return costs (X,U) without their components along the equalities (e,U), which are constant on C; the costs themselves
    where these components are not far larger than the rest."""
    if not len(equalities):
        return costs
    _, sizes, rows = np.linalg.svd(equalities, full_matrices=False)
    common = rows[sizes > tolerances.CURVATURE * sizes.max(initial=0.0)]
    less = costs - costs @ common.T @ common
    less -= less @ common.T @ common  # once more, for the rounding
    less[np.abs(less) <= tolerances.COST_ROUNDING * np.abs(costs).max(axis=1, keepdims=True)] = 0.0
    large = np.abs(costs).max() > tolerances.COMMON_COST * np.abs(less).max()
    return less if large else costs
