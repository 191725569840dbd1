"""A user's own convex costs: written in CVXPY, or given as functions with their gradients."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import nnls

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError, ModelError, SolverError
from inscrutable.linear_programmes import Rows, minimum
from inscrutable.problems.base import DecisionProblem
from inscrutable.problems.constraints import Polyhedron, checked_region
from inscrutable.problems.forms import LinearForm, QuadraticForm, SmoothForm
from inscrutable.problems.kinked_costs import has_kinks
from inscrutable.problems.linear import LinearProblem
from inscrutable.problems.modelled import Modelled
from inscrutable.problems.newton import Model, minimise_smooth
from inscrutable.problems.piecewise_linear import PiecewiseLinearProblem
from inscrutable.problems.quadratic import QuadraticProblem
from inscrutable.problems.quadratic_programme import Layout, layout_of, solve_programmes
from inscrutable.validation import Array

Function = Callable[[Array], ArrayLike]

_MOST_CUTS = 200
_SOLVER_SHARE = 0.1
"""Share of `KINKED` that the interior-point solver leaves, in the scale in which it solves: of 500 drawn problems it left up to
4e-8, but for one where it failed in that scale."""


class ConvexProblem(DecisionProblem):
    """A decision with one convex cost per state, written with `cvxpy`.

    Formula: c(i,u) = costs[i] over u ∈ C.

    Costs that are quadratic or affine in the variable are recognised and solved as such, and so are sums of maxima of affine
    functions (`max`, `maximum`, `pos`, `abs`, norms 1 and inf, one inside another) of up to 64 each. For others Clarabel solves
    for equal probabilities, and Newton's method finds the decision of every other belief from there; Clarabel is used again
    where the multipliers do not prove an optimum. `from_functions` takes functions instead and needs no extra.

    Args:
        variable: A `cvxpy.Variable` of shape (U,); its signs and `bounds` are constraints too.
        costs: X convex `cvxpy` expressions in this variable alone, one per state, in the cost's unit. Affine ends of their
            domains are constraints too, but for those of logarithms, which costs keep decisions from.
        constraints: A `Polyhedron`, one `cvxpy` constraint or a list of them: affine, or with norms 1 and inf, `abs`, `max`,
            `pos` and further variables that reduce to rows and to sums of magnitudes of single coordinates. Sums of more than
            ten magnitudes need quadratic or affine costs.
        differentiable: Whether the costs have gradients everywhere on C; None tests it: absolute values, maxima and norms that
            can be zero on C count as kinks. With kinks, but for sums of maxima of affine functions, Π(u) is found by cutting
            planes, as the beliefs under which the decision's regret is at most 1e-6 of the cost's scale, constants left out.
        strictly_convex: Whether every state's cost is strictly convex on C, by the user's knowledge: optimal decisions are then
            unique, and proofs are faster. For quadratic and affine costs it is computed instead.

    Raises:
        InputError: `cvxpy` is missing, a cost is not convex, scalar or depends on another variable, a constraint is not
            affine.
        ModelError: The feasible set is empty (its rows are named) or a cost has no minimum over it.

    Cost: that of a quadratic, linear or piecewise linear problem where costs are; else about a millisecond per belief of many,
    and some for one alone, so ask for few decoys, such as `decoy_grid(problem, 20)`. With kinks a set Π(u) takes some ten
    solves, and a decision that hides some hundred sets: 10 s, a lottery a minute. Source: the paper, eq. (3); Agrawal et al.,
    A Rewriting System for Convex Optimization Problems (2018).

    Example:
        >>> import cvxpy as cp
        >>> u = cp.Variable(2)
        >>> costs = [cp.sum_squares(u - [1, 0]), cp.sum_squares(u - [0, 1])]
        >>> problem = ConvexProblem(u, costs, [cp.sum(u) == 1, u >= 0])
        >>> print(problem.solve([0.3, 0.7]).round(6))
        [0.3 0.7]
    """

    _stated: DecisionProblem | None
    """The quadratic or linear problem of the expressions, where they have that form."""

    def __init__(
        self,
        variable: Any,
        costs: Sequence[Any],
        constraints: Polyhedron | Sequence[Any],
        *,
        differentiable: bool | None = None,
        strictly_convex: bool = False,
    ) -> None:
        model = Modelled(variable, costs, constraints)
        self._model: Modelled | None = model
        region = checked_region(model.region, model.n_actions, lifts=model.is_quadratic)
        self._set_up(model.values, model.gradients, region, len(costs))
        unknown = differentiable is None and not model.is_quadratic
        smooth = not has_kinks(costs, variable, self.constraints) if unknown else differentiable is not False
        self.differentiable = bool(smooth)
        self.strictly_convex = bool(strictly_convex)
        self._stated: DecisionProblem | None = _recognised(model, self.constraints, has_kinks=not smooth)

    def _set_up(self, values: Function, gradients: Function, region: Polyhedron, n_states: int) -> None:
        self._values, self._gradients = values, gradients
        self.constraints, self._n_states = region, n_states
        self.differentiable = True
        self.strictly_convex = False
        self._stated = None
        self._start = np.zeros(region.n_actions)

    @property
    def costs_are_unique(self) -> bool:
        """Whether all optimal decisions of a belief have the same state costs: computed, or as declared."""
        return self.strictly_convex if self._stated is None else self._stated.costs_are_unique

    def quadratic_form(self) -> QuadraticForm | None:
        """Return the expressions as quadratic costs, where they have that form."""
        return None if self._stated is None else self._stated.quadratic_form()

    def linear_form(self) -> LinearForm | None:
        """Return the expressions as linear costs, where they have that form."""
        return None if self._stated is None else self._stated.linear_form()

    def smooth_form(self) -> SmoothForm | None:
        """Return the costs with their gradients, None where they have kinks."""
        if self._stated is not None and (self.constraints.needs_lift or not self.differentiable):
            return self._stated.smooth_form()
        return (
            SmoothForm(self.constraints, self.cost_gradients, size=self._gradient_size) if self.differentiable else None
        )

    @cached_property
    def _gradient_size(self) -> float:
        """Size of the gradients at the start of the search; 0 where they are infinite there."""
        with np.errstate(all="ignore"):
            size = float(np.abs(self._gradients(self._start[None])).max(initial=0.0))
        return size if np.isfinite(size) else 0.0

    @property
    def cost_accuracy(self) -> float:  # type: ignore[override]
        """Largest excess of the cost of `solve(π)` over V(π): the error of the method that solves these costs."""
        if self._stated is not None:
            return self._stated.cost_accuracy
        return tolerances.COST_ACCURACY if self.differentiable else tolerances.KINKED

    @classmethod
    def from_functions(
        cls,
        values: Function,
        gradients: Function,
        constraints: Polyhedron,
        *,
        start: ArrayLike | None = None,
        strictly_convex: bool = False,
    ) -> ConvexProblem:
        """Return the problem of smooth costs given by functions of one decision (U,).

        Args:
            values: Returns the costs of all states, shape (X,); infinite or NaN outside the costs' domain.
            gradients: Returns their gradients, shape (X,U).
            constraints: The feasible set C.
            start: A feasible decision inside the costs' domain, (U,); None is one as far from the rows as possible.
            strictly_convex: As in the constructor.

        Raises:
            InputError: A function returns another shape, or `start` is no vector of finite numbers.
            ModelError: C is empty, or the costs are not finite at the start.
        """
        region = checked_region(constraints, constraints.n_actions)
        middle = (
            _middle(region)
            if start is None
            else validation.finite_array(start, "start", ndim=1, axes=(Axis("asset", region.asset_names),))
        )
        costs, slopes = np.asarray(values(middle), dtype=np.float64), np.asarray(gradients(middle), dtype=np.float64)
        if costs.ndim != 1 or slopes.shape != (costs.size, region.n_actions):
            raise InputError(
                f"values returns shape {costs.shape} and gradients {slopes.shape}; expected (X,) and (X, U) with U = "
                f"{region.n_actions}"
            )
        if not np.isfinite(costs).all():
            raise ModelError(f"the costs at {middle} are {costs}: give a start inside their domain")
        problem = cls.__new__(cls)
        problem._model = None
        problem._set_up(
            lambda points: _at_each(values, points, costs.shape),
            lambda points: _at_each(gradients, points, slopes.shape),
            region,
            costs.size,
        )
        problem._start = middle
        problem.strictly_convex = bool(strictly_convex)
        return problem

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return self._n_states

    @cached_property
    def _layout(self) -> Layout:
        return layout_of(self.constraints)

    def solve(self, beliefs: ArrayLike) -> Array:
        """Return u*(π) for one belief (X,) or many (T,X), shape (U,) or (T,U)."""
        if self._stated is not None:
            return self._stated.solve(beliefs)
        held = self.check_beliefs(beliefs)
        rows = np.atleast_2d(held)
        if self._model is None:
            solved = minimise_smooth(_Expected(self), rows, np.tile(self._start, (len(rows), 1)), self._layout)
        else:
            solved = self._solved(self._model, rows)
        return np.asarray(solved[0]) if held.ndim == 1 else solved

    def _solved(self, model: Modelled, beliefs: Array) -> Array:
        """Solve by Newton's method from the decision for equal probabilities; where the multipliers do not prove an optimum, by
        the interior-point solver. The start is always the same, so that ties are broken the same way."""
        found = np.empty((len(beliefs), self.n_actions))
        left = np.ones(len(beliefs), dtype=np.bool_)
        if self.differentiable and self._central is not None:
            found = self._newton(beliefs, self._central.repeat(len(beliefs), axis=0))
            left = ~self._shown_optimal(beliefs, found)
        if left.any():
            found[left] = self._polished(beliefs[left], np.array([model.solve(belief) for belief in beliefs[left]]))
            if self.differentiable:
                self._check_minima(model, beliefs[left], found[left])
        return found

    def _check_minima(self, model: Modelled, beliefs: Array, points: Array) -> None:
        """Raise `ModelError` where the cost at points (n,U) is not shown to be least, and is lower as far from them as they are
        large: Clarabel may call a point solved from which the cost falls for ever."""
        left = np.flatnonzero(~self._shown_optimal(beliefs, points))
        if not left.size:
            return
        held, here, costs = beliefs[left], points[left], _Expected(self)
        with np.errstate(all="ignore"):
            slopes = np.nan_to_num(
                np.einsum("nx,nxu->nu", held, np.asarray(self._gradients(here))), posinf=0.0, neginf=0.0
            )
        lengths = np.maximum(np.abs(here).max(axis=1), 1.0) / np.maximum(np.abs(slopes).max(axis=1), tolerances.TINY)
        far = self._nearest(here - lengths[:, None] * slopes)
        fall = costs.values(held, here) - costs.values(held, far)
        sizes = np.maximum((held * np.abs(self.state_costs(here))).sum(axis=1), model.scale)
        for row in np.flatnonzero(fall > tolerances.CONE_COST * sizes):
            if model.in_domain(far[row]):
                raise ModelError(
                    f"the cost under belief {held[row]} has no minimum that Clarabel finds over the feasible set: add bounds"
                )

    @cached_property
    def _central(self) -> Array | None:
        """The decision (1,U) for equal probabilities, where all costs are finite; None where there is none."""
        assert self._model is not None
        middle = np.full((1, self.n_states), 1.0 / self.n_states)
        try:
            found = self._polished(middle, self._model.solve(middle[0])[None])
        except (ModelError, SolverError):
            return None
        return found if np.isfinite(_Expected(self).values(middle, found)).all() else None

    def _shown_optimal(self, beliefs: Array, points: Array) -> np.ndarray:
        """Whether multipliers prove points (n,U) optimal."""
        region = self.constraints
        with np.errstate(all="ignore"):
            gradients = np.einsum("nx,nxu->nu", beliefs, np.asarray(self._gradients(points)))
        shown = (region.violation(points) <= tolerances.FEASIBILITY) & np.isfinite(gradients).all(axis=1)
        scale = np.abs(gradients).max(axis=1) + tolerances.TINY
        tight = region.slacks(points) <= tolerances.FEASIBILITY
        for pattern in np.unique(tight[shown], axis=0):
            at = np.flatnonzero(shown & (tight == pattern).all(axis=1))
            rows = np.vstack([region.A_ub[pattern], region.A_eq])
            multipliers = -gradients[at] @ np.linalg.pinv(rows)
            left = np.abs(gradients[at] + multipliers @ rows).max(axis=1)
            wrong = -(multipliers[:, : int(pattern.sum())] * np.abs(region.A_ub[pattern]).max(axis=1)).min(
                axis=1, initial=0.0
            )
            shown[at] = np.maximum(left, wrong) <= tolerances.SHOWN_OPTIMAL * scale[at]
            # Where tight rows depend on one another, others of their multipliers may have the right signs.
            for point in at[~shown[at]] if np.linalg.matrix_rank(rows) < len(rows) else ():
                columns = np.vstack([rows, -region.A_eq]).T
                shown[point] = nnls(columns, -gradients[point])[1] <= tolerances.SHOWN_OPTIMAL * scale[point]
        return np.asarray(shown)

    def _polished(self, beliefs: Array, rough: Array) -> Array:
        """The interior-point solver's points, polished where costs have gradients, and made feasible elsewhere."""
        found, left = np.array(rough), np.arange(len(rough))
        if self.differentiable:
            # Newton's steps keep no start outside C, whose cost may be below the optimum.
            outside = self.constraints.violation(rough) > 0.0
            found[outside] = self._nearest(rough[outside])
            found = self._newton(beliefs, found)
            left = np.flatnonzero(~(self.constraints.violation(found) <= tolerances.FEASIBILITY))
        found[left] = self._nearest(rough[left])
        return found

    def _nearest(self, points: Array) -> Array:
        """The nearest feasible decisions."""
        if not len(points):
            return points
        units = np.broadcast_to(np.eye(self.n_actions), (len(points), self.n_actions, self.n_actions))
        return solve_programmes(units, -points, self._layout)

    def _newton(self, beliefs: Array, starts: Array) -> Array:
        """Apply Newton's method to all beliefs together; if it fails, to each alone, and keep the start where it fails."""
        try:
            return minimise_smooth(_Expected(self), beliefs, starts, self._layout)
        except (SolverError, ModelError):
            if len(beliefs) == 1:
                return np.array(starts)  # an undetected kink: keep the interior-point solution
        return np.vstack([self._newton(*pair) for pair in zip(beliefs[:, None], starts[:, None], strict=True)])

    def state_costs(self, actions: ArrayLike) -> Array:
        """Return c(i,u) for decisions (…,U): shape (…,X)."""
        points = self.as_points(actions)
        if self._stated is not None:
            return self._stated.state_costs(points)
        rows = points.reshape(-1, self.n_actions)
        return np.asarray(self._values(rows)).reshape(*points.shape[:-1], self.n_states)

    def cost_gradients(self, action: ArrayLike) -> Array:
        """Return ∇_u c(i,u), or one of the slopes at a kink, for decisions (…,U): shape (…,X,U).

        Raises:
            ModelError: A cost has no finite slope at a decision, as a square root has none at 0; its atom is named.
        """
        points = self.as_points(action)
        if self._stated is not None:
            return self._stated.cost_gradients(points)
        rows = points.reshape(-1, self.n_actions)
        with np.errstate(all="ignore"):
            slopes = np.asarray(self._gradients(rows))
        off = np.argwhere(~np.isfinite(slopes).all(axis=2))
        if off.size:
            row, state = (int(each) for each in off[0])
            where = "gradients" if self._model is None else str(self._model.without_slope(state, rows[row]))
            raise ModelError(
                f"the cost of state {state} has no finite slope at the decision {rows[row]}: {where} has none there; keep "
                "decisions away by constraints, such as a lower bound of 1e-6 instead of 0"
            )
        return slopes.reshape(*points.shape[:-1], self.n_states, self.n_actions)

    def explaining_rows(self, action: Array) -> Array | None:
        """Return rows Q (m,X) with Π(u) = {π : Q π ≥ 0} up to the accuracy of the costs, or None where they have a smooth form.

        Each row is s(v) − s(u) for an optimal decision v; rows are added at the corners of the set until the regret at every
        corner is within the tolerance.
        """
        if self.differentiable or self._stated is not None:
            return None
        from inscrutable.geometry import BeliefSet

        own = self.state_costs(action)
        rows = np.zeros((0, self.n_states))
        fresh = np.eye(self.n_states)
        # Costs may all be zero at a decision that every state takes; the solver's errors are not.
        left = _SOLVER_SHARE * self._model.scale if self._model else 0.0
        varying = own - self._model.constants if self._model else own
        rounding = tolerances.EXACT_COST / tolerances.KINKED * float(np.abs(own).max())
        scale = max(float(np.abs(varying).max()), left, rounding, np.finfo(float).tiny)
        for _ in range(_MOST_CUTS):
            planes = self.state_costs(self.solve(fresh)) - own
            losses = -(fresh * planes).sum(axis=1) if len(rows) else np.full(len(fresh), np.inf)
            if losses.max() <= 2.0 * tolerances.KINKED * scale:
                break
            rows = np.vstack([rows, planes / scale + tolerances.KINKED])
            found = BeliefSet(np.zeros((0, self.n_states)), rows)
            if found.is_empty:
                break
            fresh = np.vstack([found.vertices(), found.center()])
            fresh /= fresh.sum(axis=1, keepdims=True)
        return rows

    def __repr__(self) -> str:
        return f"ConvexProblem({self.n_states} states, {self.n_actions} coordinates)"


def _at_each(function: Function, points: Array, shape: tuple[int, ...]) -> Array:
    """The values (n,…) of a function of one decision at points (n,U), of which there may be none."""
    return np.array([function(point) for point in points], dtype=np.float64).reshape(len(points), *shape)


class _Expected:
    """Expected costs under beliefs; curvature by differences of the gradients."""

    def __init__(self, problem: ConvexProblem) -> None:
        self._costs, self._problem = problem.state_costs, problem

    def _slopes(self, points: Array) -> Array:
        """Gradients (…,X,U) at points (…,U), not finite outside the domain."""
        rows = np.asarray(self._problem._gradients(points.reshape(-1, points.shape[-1])))
        return rows.reshape(*points.shape[:-1], *rows.shape[1:])

    def values(self, held: Array, points: Array) -> Array:
        """Return π·s(u), infinite where it is not a number."""
        with np.errstate(all="ignore"):
            found = (held * self._costs(points)).sum(axis=1)
        return np.where(np.isnan(found), np.inf, found)

    def model(self, held: Array, points: Array) -> Model:
        """Return value, gradient and Hessian."""
        size = points.shape[1]
        step, moves = tolerances.DIFFERENCE, tolerances.DIFFERENCE * np.eye(size)
        with np.errstate(all="ignore"):
            # In one pass: the atoms of few points cost as much as those of one.
            found = self._moved(held, points, np.vstack([np.zeros(size), moves]))
            # One-sided: an error of the step's size in the curvature changes a Newton step by that share only.
            slopes, sides = found[:, 0], found[:, 1:] - found[:, :1]
            off = np.flatnonzero(~np.isfinite(sides).all(axis=(1, 2)))
            if off.size:
                back = slopes[off, None] - self._moved(held[off], points[off], -moves)
                sides[off] = np.where(np.isfinite(sides[off]).all(axis=2, keepdims=True), sides[off], back)
        hessians = np.where(np.isfinite(sides), sides, 0.0) / step
        values, vectors = np.linalg.eigh(0.5 * (hessians + hessians.transpose(0, 2, 1)))
        hessians = np.einsum("nij,nj,nkj->nik", vectors, np.maximum(values, 0.0), vectors)
        return Model(self.values(held, points), slopes, hessians)

    def _moved(self, held: Array, points: Array, moves: Array) -> Array:
        """Slopes (n,m,U) at points (n,U) after each of moves (m,U)."""
        return np.asarray(np.einsum("nx,nmxu->nmu", held, self._slopes(points[:, None] + moves)))

    def longest_steps(self, held: Array, points: Array, steps: Array) -> Array:
        """Return whole steps: outside the domain the value is infinite."""
        return np.ones(len(points))


def _middle(region: Polyhedron) -> Array:
    """A decision as far from every row as possible, up to one unit of the row's largest coefficient."""
    size, n = region.n_actions, len(region.b_ub)
    below = Rows(np.column_stack([region.A_ub, region.row_scale]), region.b_ub)
    equal = Rows(np.column_stack([region.A_eq, np.zeros(len(region.b_eq))]), region.b_eq)
    bounds: list[tuple[float | None, float | None]] = [(None, None)] * size
    return minimum(np.append(np.zeros(size), -1.0 if n else 0.0), below, equal, [*bounds, (None, 1.0)]).x[:size]


def _recognised(model: Modelled, region: Polyhedron, *, has_kinks: bool) -> DecisionProblem | None:
    """The expressions as a quadratic, linear or piecewise linear problem, or None."""
    size = model.n_actions
    if not model.is_quadratic:
        costs = model.sums_of_maxima() if has_kinks and not region.needs_lift else None
        return None if costs is None else PiecewiseLinearProblem.of_sums(costs, region)
    slopes = model.gradients(np.vstack([np.zeros(size), np.eye(size)]))
    constants = model.values(np.zeros((1, size)))[0]
    hessians = (slopes[1:] - slopes[0]).transpose(1, 0, 2)
    if not np.abs(hessians).max() > 0 and not constants.any():
        return LinearProblem(slopes[0], region)
    return QuadraticProblem(0.5 * (hessians + hessians.transpose(0, 2, 1)), slopes[0], constants, constraints=region)
