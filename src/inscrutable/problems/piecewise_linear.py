"""Convex piecewise linear costs, as utilities recovered from choices are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.axes import Axis, depth
from inscrutable.errors import InputError
from inscrutable.problems.base import DecisionProblem
from inscrutable.problems.constraints import Polyhedron, checked_region
from inscrutable.problems.forms import Lift, LinearForm, SmoothForm
from inscrutable.problems.linear import LinearProblem
from inscrutable.problems.sums_of_maxima import SumsOfMaxima
from inscrutable.validation import Array


class PiecewiseLinearProblem(DecisionProblem):
    """A decision whose cost in each state is the largest of several affine functions.

    Formula: c(i,u) = max_k (a_ik + b_ik'u) over u ∈ C; with levels z_i ≥ a_ik + b_ik'u it is the linear problem of cost z_i,
    whose tight rows are the pieces that are active. A piece within the feasible set's `min_slack` counts as active.

    Args:
        slopes: b_i, one array (K_i,U) per state.
        offsets: a_i, one array (K_i,) per state.
        constraints: The feasible set C.

    Raises:
        InputError: Shapes disagree, or an entry is not finite.
        ModelError: C is empty, or a cost has no minimum over it.

    Cost: that of a `LinearProblem` with Σ K_i more rows and X more coordinates. Source: the epigraph form of linear
    programming; the paper, eq. (3).

    Example:
        >>> from inscrutable.problems import simplex
        >>> problem = PiecewiseLinearProblem([[[1.0, 0.0], [0.0, 1.0]], [[2.0, 0.0]]], [[0.0, 0.0], [0.0]], simplex(2))
        >>> print(problem.solve([[1.0, 0.0], [0.0, 1.0]]), problem.state_costs([0.25, 0.75]))
        [[0.5 0.5]
         [0.  1. ]] [0.75 0.5 ]
    """

    def __init__(self, slopes: Sequence[ArrayLike], offsets: Sequence[ArrayLike], constraints: Polyhedron) -> None:
        states, assets = Axis("state", learns=True), Axis("asset", learns=True)
        tables, sides = _by_state(slopes, "slopes", states), _by_state(offsets, "offsets", states)
        pieces = [Axis("piece", learns=True) for _ in range(max(len(tables), len(sides)))]
        self.slopes = [
            validation.finite_array(each, f"slopes[{i}]", ndim=2, axes=(pieces[i], assets))
            for i, each in enumerate(tables)
        ]
        self.offsets = [
            validation.finite_array(each, f"offsets[{i}]", ndim=1, axes=(pieces[i],)) for i, each in enumerate(sides)
        ]
        if not self.slopes or len(self.slopes) != len(self.offsets):
            raise InputError(
                f"slopes has {len(self.slopes)} states and offsets {len(self.offsets)}; expected as many, >= 1"
            )
        size = self.slopes[0].shape[1]
        for i, (slope, offset) in enumerate(zip(self.slopes, self.offsets, strict=True)):
            if slope.shape != (offset.size, size) or not offset.size:
                raise InputError(
                    f"state {i} has slopes {slope.shape} and {offset.size} offsets; expected (K,{size}) and K"
                )
        self.constraints = checked_region(constraints, size, assets)
        self.state_names = states.names
        maxima = [np.column_stack(pair) for pair in zip(self.slopes, self.offsets, strict=True)]
        self._lift(SumsOfMaxima.of_pieces(maxima))

    @classmethod
    def of_sums(cls, costs: SumsOfMaxima, constraints: Polyhedron) -> PiecewiseLinearProblem:
        """Return the problem of costs that are sums of maxima, one level for each maximum."""
        problem = cls.__new__(cls)
        problem.constraints = constraints
        problem._lift(costs)
        return problem

    def _lift(self, costs: SumsOfMaxima) -> None:
        """Keep the costs and their linear problem, in which a level z_j takes the place of each maximum."""
        self._costs = costs
        self._lifted = LinearProblem(np.hstack([costs.linear, costs.weights]), self._region(costs.maxima))

    def _region(self, maxima: list[Array]) -> Polyhedron:
        region, n_levels = self.constraints, len(maxima)
        rows = np.vstack([np.zeros((0, region.n_actions + 1)), *maxima])
        level = np.repeat(np.arange(n_levels), [len(each) for each in maxima])
        pieces = np.hstack([rows[:, :-1], -np.eye(n_levels)[level]])
        names = [f"piece {k} of maximum {j}" for j, each in enumerate(maxima) for k in range(len(each))]
        n = len(region.b_ub)
        return Polyhedron(
            np.vstack([np.hstack([region.A_ub, np.zeros((n, n_levels))]), pieces]),
            np.concatenate([region.b_ub, -rows[:, -1]]),
            np.hstack([region.A_eq, np.zeros((len(region.b_eq), n_levels))]),
            region.b_eq,
            names=[*region.names[:n], *names, *region.names[n:]],
            min_slack=region.min_slack,
        )

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return len(self._costs.weights)

    def solve(self, beliefs: ArrayLike) -> Array:
        """Return an optimal decision for one belief (X,) or many (T,X): shape (U,) or (T,U); the same one of ties."""
        return self._without_levels(self._lifted.solve(self.check_beliefs(beliefs)))

    def state_costs(self, actions: ArrayLike) -> Array:
        """Return c(i,u) for decisions (…,U): shape (…,X)."""
        return self._costs.values(self.as_points(actions))

    def cost_gradients(self, action: ArrayLike) -> Array:
        """Return the slope of an active piece for decisions (…,U): shape (…,X,U)."""
        return self._costs.slopes(self.as_points(action))

    def linear_form(self) -> LinearForm:
        """Return the linear problem of the decision and its levels."""
        region = self._lifted.constraints
        return LinearForm(self._lifted.costs, region, Lift(self._with_levels, self._without_levels))

    def smooth_form(self) -> SmoothForm:
        """Return the linear problem of the levels, in which an observer counts active pieces as tight rows."""
        form = self.linear_form()
        return SmoothForm(form.constraints, self._lifted.cost_gradients, form.lift)

    def _with_levels(self, actions: Array) -> Array:
        points = self.as_points(actions)
        return np.concatenate([points, self._costs.levels(points)], axis=-1)

    def _without_levels(self, variables: Array) -> Array:
        return np.asarray(variables[..., : self.n_actions])

    def __repr__(self) -> str:
        return f"PiecewiseLinearProblem({self.n_states} states, {self.n_actions} coordinates)"


def _by_state(given: Any, name: str, states: Axis) -> list[Any]:
    """The entries of a list or a mapping, in the states' order."""
    if not depth(given):
        raise InputError(f"{name} must be a list with one entry per state, got {given!r}")
    if not isinstance(given, Mapping):
        return list(given)
    held, order = list(given.values()), states.order(tuple(given), name)
    return held if order is None else [held[k] for k in order]
