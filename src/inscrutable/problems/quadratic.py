"""Quadratic costs: one convex quadratic per state."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.geometry.morton import morton_order
from inscrutable.problems.base import DecisionProblem
from inscrutable.problems.constraints import Polyhedron, checked_region
from inscrutable.problems.copied_coordinates import Merged, merged_copies
from inscrutable.problems.forms import Lift, LinearForm, QuadraticForm, SmoothForm
from inscrutable.problems.magnitudes import MagnitudeRegion
from inscrutable.problems.quadratic_programme import Layout, layout_of, solve_programmes
from inscrutable.problems.segments import Segments
from inscrutable.problems.vertices import VertexTable
from inscrutable.validation import Array

_CHUNK = 256
"""Beliefs solved in one warm-started run; a constant, so that results do not depend on the number of threads."""
_UNSORTED = 8  # up to this number, beliefs are not sorted but solved side by side
_FEW = 16  # decisions whose costs are found in one product
_MOST_EQUALITIES = 8
_BLOCK_ENTRIES = 4_000_000


class QuadraticProblem(DecisionProblem):
    """A decision with one convex quadratic cost per state.

    Formula: c(i,u) = ½ u'H_i u + g_i'u + r_i over u ∈ C.

    Args:
        hessians: H_i, shape (X,U,U), symmetric positive semidefinite, cost per squared decision.
        linear: g_i, shape (X,U), cost per decision.
        constants: r_i, shape (X,), cost; None is zero.
        constraints: The feasible set C.

    Raises:
        InputError: Shapes disagree, an entry is not finite, a Hessian is not symmetric.
        ModelError: A Hessian is indefinite (its smallest eigenvalue is named) or C is empty (its rows are named).

    Cost: one active-set quadratic programme per belief. Source: the paper, eq. (3).

    Example:
        >>> from inscrutable.problems import simplex
        >>> problem = QuadraticProblem([np.eye(2), 3 * np.eye(2)], [[0.0, 0.0], [-1.0, 0.0]], constraints=simplex(2))
        >>> print(problem.solve([0.5, 0.5]).round(3))
        [0.625 0.375]
    """

    def __init__(
        self, hessians: ArrayLike, linear: ArrayLike, constants: ArrayLike | None = None, *, constraints: Polyhedron
    ) -> None:
        states, assets = Axis("state", learns=True), Axis("asset", learns=True)
        self.hessians = _checked_hessians(hessians, "hessians", (states, assets, assets))
        self.linear = validation.finite_array(linear, "linear", ndim=2, axes=(states, assets))
        n_states, n_actions = self.hessians.shape[:2]
        if self.linear.shape != (n_states, n_actions):
            raise InputError(f"linear has shape {self.linear.shape}, expected {(n_states, n_actions)} as the hessians")
        given = np.zeros(n_states) if constants is None else constants
        self.constants = validation.finite_array(given, "constants", ndim=1, axes=(states,))
        if self.constants.shape != (n_states,):
            raise InputError(f"constants has {self.constants.size} entries, expected one per state: {n_states}")
        self.constraints = checked_region(constraints, n_actions, assets, lifts=True)
        self.state_names = states.names

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return int(self.hessians.shape[0])

    cost_accuracy = tolerances.EXACT_COST

    @cached_property
    def costs_are_unique(self) -> bool:
        """Whether every state's cost is strictly convex on C, except in directions along which no state's cost changes."""
        scale = float(np.abs(self.hessians).max())
        weight = (scale or 1.0) / max(float(np.abs(self.linear).max()), tolerances.TINY)
        changing = np.vstack([*self.hessians, weight * self.linear])
        return are_strictly_convex(self.hessians, changing, self.constraints.A_eq)

    @cached_property
    def is_strictly_convex(self) -> bool:
        """Whether every state's cost is strictly convex on the equality null space: no decisions are tied."""
        return are_strictly_convex(self.hessians, np.eye(self.n_actions), self.constraints.A_eq)

    def quadratic_form(self) -> QuadraticForm | None:
        """Return H_i, g_i, r_i and C; None for a derived class with its own costs or gradients."""
        if not self.has_these_costs:
            return None
        if self.lifted is not None:
            return self.lifted.quadratic_form()
        return QuadraticForm(self.hessians, self.linear, self.constants, self.constraints)

    def linear_form(self) -> LinearForm | None:
        """Return g_i and C where every cost is linear."""
        flat = self.has_these_costs and not self.hessians.any()
        if self.lifted is not None:
            return (
                LinearForm(self.lifted.problem.linear, self.lifted.problem.constraints, self.lifted.lift)
                if flat
                else None
            )
        return LinearForm(self.linear, self.constraints) if flat else None

    def smooth_form(self) -> SmoothForm:
        """Return the costs' gradients, and the size of g_i as that of their terms."""
        size = float(np.abs(self.linear).max(initial=0.0)) if self.has_these_costs else 0.0
        if self.lifted is not None:
            return self.lifted.smooth_form()
        return SmoothForm(self.constraints, self.cost_gradients, size=size)

    @property
    def has_these_costs(self) -> bool:
        """Whether no derived class overrides the costs."""
        stated = ("state_costs", "cost_gradients")
        return all(getattr(type(self), name) is getattr(QuadraticProblem, name) for name in stated)

    @cached_property
    def _layout(self) -> Layout:
        return layout_of(self.constraints)

    def solve(self, beliefs: ArrayLike) -> Array:
        """Return u*(π) for one belief (X,) or many (T,X), shape (U,) or (T,U), exact to a few roundings."""
        held = self.check_beliefs(beliefs)
        solved = self.solve_rows(np.ascontiguousarray(np.atleast_2d(held)))
        return np.asarray(solved[0]) if held.ndim == 1 else solved

    def solve_rows(self, held: Array) -> Array:
        """Return u*(π), shape (T,U), for the rows of a contiguous array (T,X) that are known to be beliefs."""
        if self.lifted is not None:
            return self.lifted.lift.decisions(self.lifted.problem.solve_rows(held))
        if self._vertices is not None:
            return self._vertices.solve(held)
        if self._merged is not None:
            return self.with_copies(self.without_copies.solve_rows(held))
        return self._along_path(held) if self.solves_in_bulk else self._one_by_one(held)

    @cached_property
    def lifted(self) -> LiftedCosts | None:
        """The problem in the variables in which all limits are rows; None where they are rows in the decision itself."""
        return lifted_costs(self, self.constraints.segments) if isinstance(self.constraints, MagnitudeRegion) else None

    @cached_property
    def _merged(self) -> Merged | None:
        """The feasible set with only the first of each group of copies; None where there are no copies.

        Of tied decisions the one with a single copy is used: its face has no ties, so that local searches work there.
        """
        if self.constraints.needs_lift:
            return None
        return merged_copies(np.vstack([*self.hessians, self.linear]), self.constraints)

    @cached_property
    def without_copies(self) -> QuadraticProblem:
        """The problem with only the first of each group of copies; itself where there are no copies."""
        if self._merged is None:
            return self
        kept = self._merged.kept
        hessians, linear = self.hessians[:, kept[:, None], kept], self.linear[:, kept]
        return QuadraticProblem(hessians, linear, self.constants, constraints=self._merged.constraints)

    @cached_property
    def without_common_costs(self) -> QuadraticProblem:
        """The problem without constants; itself where there are none."""
        if not self.constants.any():
            return self
        return QuadraticProblem(self.hessians, self.linear, constraints=self.constraints)

    def with_copies(self, actions: Array) -> Array:
        """Return decisions (…,F) of the problem without copies as decisions (…,U) of this one."""
        return actions if self._merged is None else self._merged.decisions(actions)

    @cached_property
    def idle_rows(self) -> np.ndarray:
        """Which inequality rows of C (R,) only keep copies of other coordinates at zero: they have no multiplier."""
        idle = np.zeros(len(self.constraints.A_ub), dtype=np.bool_)
        if self._merged is not None:
            idle[self._merged.idle] = True
        return idle

    @cached_property
    def _vertices(self) -> VertexTable | None:
        """The vertices among which linear costs choose, always the same one of ties; None where some cost is not linear."""
        if self.hessians.any():
            return None
        region = self.constraints
        bounded = all(np.isfinite(side).all() for side in region.coordinate_bounds)  # two programmes a coordinate else
        if not bounded and not np.isfinite(region.bounding_box).all():
            return None
        return VertexTable(self.linear, self.constraints)

    @cached_property
    def solves_in_bulk(self) -> bool:
        """Whether the feasible set is bounds and a few equalities, for which many beliefs are solved in one run."""
        return not len(self._layout.sides) and len(self._layout.equality_sides) <= _MOST_EQUALITIES

    @cached_property
    def _path_arguments(self) -> tuple[Any, ...]:
        """The bulk kernel's arguments besides the beliefs, in its own memory order."""
        layout = self._layout
        rows = np.ascontiguousarray(layout.equalities, dtype=np.float64)
        region = (layout.lower, layout.upper, rows, layout.equality_sides, rows.ravel(), rows.T.ravel())
        start = self._one_by_one(np.full((1, self.n_states), 1.0 / self.n_states))[0]
        return self._kernel_costs, region, (tolerances.PIVOT, 0.1 * tolerances.STATIONARITY), start

    @cached_property
    def _kernel_costs(self) -> tuple[Array, Array]:
        """H_jki at (j·U + k)·X + i and g_ji at j·X + i."""
        return np.array(self.hessians.transpose(1, 2, 0), order="C").ravel(), np.array(self.linear.T, order="C").ravel()

    def _along_path(self, held: Array) -> Array:
        from inscrutable.kernels.active_set import solve_path

        actions = np.empty((len(held), self.linear.shape[1]))
        solved = np.zeros(len(held), dtype=np.bool_)
        order = morton_order(held) if len(held) > _UNSORTED else np.arange(len(held))
        kernel: Any = solve_path
        arguments = self._path_arguments

        def work(first: int, last: int) -> None:
            kernel(held, order[first:last], *arguments, actions, solved)

        if len(held) <= _CHUNK:
            work(0, len(held))
        else:
            from inscrutable.kernels.calls import in_chunks

            in_chunks(work, len(held), _CHUNK)
        if not solved.all():
            actions[~solved] = self._one_by_one(held[~solved])
        return actions

    def _one_by_one(self, held: Array) -> Array:
        actions = np.empty((len(held), self.n_actions))
        step = max(1, _BLOCK_ENTRIES // self.n_actions**2)
        for first in range(0, len(held), step):
            block = held[first : first + step]
            # Not a product of matrices: its last digits would depend on the number of beliefs.
            hessians, linear = np.zeros((len(block), *self.hessians.shape[1:])), np.zeros((len(block), self.n_actions))
            for i in range(self.n_states):
                hessians += block[:, i, None, None] * self.hessians[i]
                linear += block[:, i, None] * self.linear[i]
            actions[first : first + step] = solve_programmes(hessians, linear, self._layout)
        return actions

    def state_costs(self, actions: ArrayLike) -> Array:
        """Return c(i,u) for decisions (…,U): shape (…,X)."""
        return self.costs_of(self.as_points(actions))

    def costs_of(self, points: Array) -> Array:
        """Return the state costs of an array (…,U) that is known to hold decisions."""
        if points.ndim == 1:
            return np.asarray((0.5 * (self.hessians @ points) + self.linear) @ points + self.constants)
        if points.ndim == 2 and len(points) <= _FEW:
            curved = np.einsum("xmu,mu->mx", points @ self.hessians, points)
            return np.asarray(0.5 * curved + points @ self.linear.T + self.constants)
        # Coordinates that are zero in all decisions take no part; a portfolio of many assets holds few.
        held = np.flatnonzero(points.reshape(-1, points.shape[-1]).any(axis=0))
        some, hessians = points[..., held], self.hessians[:, held[:, None], held]
        curved = np.stack([np.einsum("...u,...u->...", some @ hessian, some) for hessian in hessians], axis=-1)
        return np.asarray(0.5 * curved + points @ self.linear.T + self.constants)

    def costs_of_each(self, points: Array) -> Array:
        """Return the state costs (T,X) of decisions (T,U), each found by itself.

        The last digits of a product of matrices depend on the number of its rows, and where a search ends may depend on them:
        two of 1,475 decisions differed between `decide` and `decide_many`, by up to 29 %.
        """
        from inscrutable.kernels.active_set import quadratic_costs

        found = np.empty((len(points), self.n_states))
        quadratic_costs(np.array(points, dtype=np.float64, order="C"), *self._kernel_costs, found)
        return np.asarray(found + self.constants)

    def cost_gradients(self, action: ArrayLike) -> Array:
        """Return H_i u + g_i for decisions (…,U): shape (…,X,U)."""
        points = self.as_points(action)
        return np.asarray(np.einsum("xuv,...v->...xu", self.hessians, points) + self.linear)


class LiftedCosts(NamedTuple):
    """Quadratic costs in the variables of segments, and the maps to them and back."""

    problem: QuadraticProblem
    lift: Lift
    is_searched: bool

    def quadratic_form(self) -> QuadraticForm | None:
        """Return the quadratic costs; None where a kink lies within a hundredth of the least slack of a bound or another kink,
        too near to tell the distance from rounding."""
        stated = self.problem
        form = QuadraticForm(stated.hessians, stated.linear, stated.constants, stated.constraints, self.lift)
        return form if self.is_searched else None

    def smooth_form(self) -> SmoothForm:
        """Return the same with its gradients; an observer counts a tight row as a kink."""
        form = self.problem.smooth_form()
        return SmoothForm(form.constraints, form.gradients, self.lift, form.size)


def lifted_costs(
    problem: QuadraticProblem, segments: Segments, rates: Array | None = None, kinks: Array | None = None
) -> LiftedCosts:
    """Return quadratic costs and Σ_j κ_j |u_j − b_j|, of rates κ (U,) and kinks b (U,), in the variables of segments."""
    rates, kinks = (np.zeros(problem.n_actions) if each is None else each for each in (rates, kinks))
    slopes = problem.cost_gradients(segments.base)
    linear = segments.linear(slopes, problem.hessians)
    linear += np.append(segments.slopes(rates, kinks), np.zeros(len(segments.limits)))
    stated = QuadraticProblem(
        segments.hessians(problem.hessians),
        linear,
        problem.state_costs(segments.base) + float(np.abs(segments.base - kinks) @ rates),
        constraints=segments.feasible(),
    )
    lift = Lift(segments.variables, segments.decisions, problem.hessians, rates, kinks)
    return LiftedCosts(stated, lift, segments.is_searched)


def quadratic_problem(problem: DecisionProblem) -> QuadraticProblem | None:
    """Return the quadratic problem in the variables of a problem's quadratic form, made once and kept with the problem;
    itself where it is one, None where there is no form."""
    known = vars(problem)
    if "_quadratic" not in known:
        known["_quadratic"] = _stated(problem)
    found: QuadraticProblem | None = known["_quadratic"]
    return found


def _stated(problem: DecisionProblem) -> QuadraticProblem | None:
    form = problem.quadratic_form()
    if form is None:
        return None
    if type(problem).quadratic_form is QuadraticProblem.quadratic_form:
        own = cast(QuadraticProblem, problem)
        return own if own.lifted is None else own.lifted.problem
    return QuadraticProblem(form.hessians, form.linear, form.constants, constraints=form.constraints)


def are_strictly_convex(hessians: Array, changing: Array, equalities: Array) -> bool:
    """Whether each of the hessians (X,U,U) is positive definite on the null space of the equalities (e,U), except in directions
    in the null space of `changing` (n,U)."""
    inside = _null_space(equalities) if len(equalities) else np.eye(hessians.shape[1])
    idle = _null_space(changing @ inside, float(np.linalg.norm(changing)))
    free = inside @ _null_space(idle.T) if idle.shape[1] else inside
    least = [np.linalg.eigvalsh(free.T @ hessian @ free).min(initial=np.inf) for hessian in hessians]
    return bool(min(least) > tolerances.CURVATURE * float(np.abs(hessians).max()))


def _null_space(matrix: Array, scale: float = 0.0) -> Array:
    """An orthonormal basis (U,N) of the null space of a matrix (R,U), relative to its largest singular value and a scale."""
    _, sizes, rows = np.linalg.svd(matrix, full_matrices=True)
    rank = int((sizes > tolerances.CURVATURE * max(sizes.max(initial=0.0), scale)).sum())
    return np.asarray(rows[rank:].T)


def _checked_hessians(value: ArrayLike, name: str, axes: tuple[Axis, ...]) -> Array:
    matrices = validation.finite_array(value, name, ndim=3, axes=axes)
    n_states, rows, columns = matrices.shape
    if rows != columns or n_states < 1 or rows < 1:
        raise InputError(f"{name} has shape {matrices.shape}, expected (X, U, U)")
    for i, matrix in enumerate(matrices):
        validation.check_positive_semidefinite(matrix, f"{name}[{i}]", "a cost must be convex")
    return np.asarray(0.5 * (matrices + matrices.transpose(0, 2, 1)))
