"""Costs and constraints read from CVXPY: values, gradients, rows, and one problem compiled for all beliefs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from threading import RLock
from typing import Any

import numpy as np

from inscrutable import tolerances
from inscrutable.errors import InputError, ModelError, SolverError
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems.cone_programmes import ConeProgramme, cone_programme
from inscrutable.problems.constraints import Polyhedron, box
from inscrutable.problems.expressions import Node, tree_of
from inscrutable.problems.lifted_constraints import constrained
from inscrutable.problems.sums_of_maxima import SumsOfMaxima, sums_of_maxima
from inscrutable.validation import Array

_LONGEST_NAME = 60
_MOST_KEPT = 10_000  # stored decisions
_LEAST_SCALE = 2.0**-30  # costs that are flat up to rounding at these points have no scale
_SAME = tolerances.EXACT_COST
_BOUNDS = {"nonneg", "pos", "nonpos", "neg", "bounds"}
"""Attributes of variables that become rows; under others the feasible set may be no convex set of real vectors."""
_COMPILED = ("_compiled", "_cones", "_parsed", "_trees")
_one_at_a_time = RLock()
"""Held where values are set and read: CVXPY keeps them in variables and parameters, which problems and threads may share."""


class Modelled:
    """X convex expressions of one variable, and the polyhedron of affine constraints on it."""

    def __init__(self, variable: Any, costs: Sequence[Any], constraints: Any) -> None:
        if not isinstance(variable, self._cvxpy.Variable) or variable.ndim != 1:
            raise InputError(f"variable must be a cvxpy.Variable of shape (U,), got {variable!r}")
        self._solved: dict[bytes, Array] = {}
        if not isinstance(costs, Collection) or isinstance(costs, Mapping):
            raise InputError(f"costs must be a list with one expression of CVXPY per state, got {costs!r}")
        self._variable, self._costs = variable, [_checked_cost(i, cost, variable) for i, cost in enumerate(costs)]
        if not self._costs:
            raise InputError("costs is empty, expected one expression per state")
        self.n_actions = int(variable.size)
        with _one_at_a_time:
            self.region = self._within_domains(self._region(constraints))

    def __getstate__(self) -> dict[str, object]:
        """What is compiled from CVXPY's expressions cannot be pickled: a copy compiles its own."""
        return {name: value for name, value in vars(self).items() if name not in _COMPILED}

    @property
    def _cvxpy(self) -> Any:
        return _imported()

    @property
    def is_quadratic(self) -> bool:
        """Whether every cost is a quadratic function without pieces; CVXPY counts Huber's function as quadratic."""
        return all(
            cost.is_quadratic() and (cost.is_affine() or not cost.is_pwl()) and self._cvxpy.huber not in cost.atoms()
            for cost in self._costs
        )

    def values(self, points: Array) -> Array:
        """Return the costs (n,X) of decisions (n,U)."""
        trees = self._trees
        if trees is None:
            return self._slow_values(points)
        return np.column_stack([tree.values(points)[:, 0] for tree in trees])

    def _slow_values(self, points: Array) -> Array:
        found = np.empty((len(points), len(self._costs)))
        for row, point in enumerate(points):
            with _one_at_a_time:
                self._variable.save_value(point)
                found[row] = [float(np.asarray(cost.value).reshape(())) for cost in self._costs]
        return found

    def gradients(self, points: Array) -> Array:
        """Return their gradients (n,X,U); NaN outside a cost's domain."""
        trees = self._trees
        if trees is None:
            return self._slow_gradients(points)
        return np.stack([tree.gradients(points)[:, :, 0] for tree in trees], axis=1)

    def _slow_gradients(self, points: Array) -> Array:
        found = np.zeros((len(points), len(self._costs), self.n_actions))
        for row, point in enumerate(points):
            with _one_at_a_time:
                self._variable.save_value(point)
                for i, cost in enumerate(self._costs):
                    found[row, i] = self._slope(i, cost)
        return found

    def _slope(self, state: int, cost: Any) -> Any:
        try:
            slope = cost.grad.get(self._variable, 0.0)
        except NotImplementedError:
            raise ModelError(
                f"CVXPY knows no slope of the cost of state {state}, {cost}: write it with other atoms, such as "
                "max(abs(x)) for norm_inf(x)"
            ) from None
        except TypeError:  # CVXPY adds the slopes of terms, and None is that of a term without one at this point
            return np.nan
        dense = slope.toarray() if hasattr(slope, "toarray") else slope
        return np.nan if dense is None else np.ravel(dense)

    def in_domain(self, point: Array) -> bool:
        """Whether a decision (U,) is where all costs are defined; CVXPY gives `inv_pos` and others values elsewhere too."""
        with _one_at_a_time:
            self._variable.save_value(point)
            return all(each.value() for cost in self._costs for each in cost.domain)

    def sums_of_maxima(self) -> SumsOfMaxima | None:
        """Return the costs as sums of maxima of affine functions, where all have that form, with CVXPY's values."""
        found, points = None if self._parsed is None else sums_of_maxima(self._parsed, self.n_actions), self._probes
        if found is None or not np.allclose(found.values(points), self._slow_values(points), rtol=_SAME, atol=_SAME):
            return None
        return found

    def without_slope(self, state: int, point: Array) -> Any:
        """Return the expression in a state's cost without a slope at a point (U,); the whole cost where none is found."""
        with np.errstate(all="ignore"):
            return self._costs[state] if self._trees is None else self._trees[state].without_slope(point)

    @property
    def _probes(self) -> Array:
        """Two points (2,U) inside the domain of most costs; the second is no point of symmetry."""
        size = self.n_actions
        return np.array([np.full(size, 1.0 / size), np.linspace(0.3, 1.1, size)])

    @cached_property
    def _unit(self) -> float:
        """Size of decisions, by the bounds of their coordinates: a power of 1,024, so that ordinary ones are solved as they
        stand. Holdings of a million dollars cost 2 % more than the best with the solver's tolerances for numbers near one."""
        sides = np.abs(self.region.bounding_box)
        largest = float(sides[np.isfinite(sides)].max(initial=0.0))
        return 2.0 ** (10.0 * np.round(np.log2(largest) / 10.0)) if largest > 0.0 else 1.0

    @cached_property
    def scale(self) -> float:
        """Size of the gradients at the probes and at the best decision for equal probabilities, per unit of decisions: a power
        of two, at most one.

        Smaller costs are scaled to size one, because the solver's tolerances are absolute: without this, the beliefs that
        explain an optimal decision missed the agent's own in half of 60 cases at a size of 1e-4. Larger costs are not scaled,
        because their size may be that at a point far from all good decisions.
        """
        return float(np.clip(self._largest_slope, _LEAST_SCALE, 1.0))

    @cached_property
    def _largest_slope(self) -> float:
        """The same without limits, where Clarabel cannot decide for equal probabilities at the probes alone."""
        count, points = len(self._costs), [self._probes]
        with suppress(ModelError, SolverError):
            points.append(self._solve_at(np.full(count, 1.0 / count))[None])
        with np.errstate(all="ignore"):
            slopes = np.abs(self.gradients(np.vstack(points)))
        largest = self._unit * float(slopes[np.isfinite(slopes)].max(initial=0.0))
        return float(2.0 ** np.round(np.log2(largest))) if largest > 0.0 else 1.0

    @property
    def constants(self) -> Array:
        """Constants (X,) in the costs that the solver does not see, and that its errors do not depend on; zero if unknown."""
        return np.zeros(len(self._costs)) if self._cones is None else self._cones.constants

    @cached_property
    def _parsed(self) -> list[Node] | None:
        """The costs as trees; None where an atom is without the usual inner methods."""
        try:
            with _one_at_a_time:
                return [tree_of(cost, self._variable) for cost in self._costs]
        except Exception:
            return None

    @cached_property
    def _trees(self) -> list[Node] | None:
        """The costs as trees, if their values and gradients agree with CVXPY's at two points; else None. CVXPY has no gradient
        of a power at arguments ≤ 0, where the tree has the right derivative at 0."""
        points, trees = self._probes, self._parsed
        if trees is None:
            return None
        with np.errstate(all="ignore"):
            try:
                values = np.column_stack([tree.values(points)[:, 0] for tree in trees])
                slopes = np.stack([tree.gradients(points)[:, :, 0] for tree in trees], axis=1)
                same = np.allclose(values, self._slow_values(points), rtol=_SAME, atol=_SAME, equal_nan=True)
                known = self._slow_gradients(points)
                same &= np.allclose(
                    np.where(np.isnan(known), np.nan, slopes), known, rtol=_SAME, atol=_SAME, equal_nan=True
                )
            except Exception:  # an atom without the usual inner methods
                return None
        return trees if same else None

    @cached_property
    def _compiled(self) -> tuple[Any, Any]:
        """The problem for any belief, and the parameter that holds the belief."""
        cp, region = self._cvxpy, self.region.in_decision
        belief = cp.Parameter(len(self._costs), nonneg=True)
        expected = sum(belief[i] * cost for i, cost in enumerate(self._costs))
        rows = []
        if len(region.b_ub):
            rows.append(region.A_ub @ self._variable <= region.b_ub)
        if len(region.b_eq):
            rows.append(region.A_eq @ self._variable == region.b_eq)
        return cp.Problem(cp.Minimize(expected), rows), belief

    def solve(self, belief: Array) -> Array:
        """Return the minimiser (U,) as the interior-point solver leaves it, the same each time."""
        key = belief.tobytes()
        found = self._solved.get(key)
        if found is None:
            found = self._solve(belief)
            if len(self._solved) >= _MOST_KEPT:
                self._solved.clear()
            self._solved[key] = found
        return found

    def _solve(self, belief: Array) -> Array:
        """In the scale of the costs; where that fails, as they stand, and in that of large ones, which Clarabel may take for
        costs without a minimum. The problem as it stands is reported."""
        failed: dict[float, ModelError | SolverError] = {}
        for scale in dict.fromkeys((self.scale, 1.0, self._largest_slope)):
            try:
                return self._solve_at(belief / scale)
            except (ModelError, SolverError) as error:
                failed[scale] = error
        raise failed[1.0]

    @cached_property
    def _cones(self) -> ConeProgramme | None:
        compiled = self._compiled
        try:
            with _one_at_a_time:
                return cone_programme(self._cvxpy, *compiled, self._variable, self._unit)
        except (self._cvxpy.error.SolverError, self._cvxpy.error.DCPError):
            return None
        except (ImportError, AttributeError, KeyError):  # from CVXPY's internals, which differ between versions
            return None

    def _solve_at(self, belief: Array) -> Array:
        found = None if self._cones is None else self._cones.solve(belief)
        if found is not None:
            return found
        compiled = self._compiled
        with _one_at_a_time:
            return self._solve_by_cvxpy(*compiled, belief)

    def _solve_by_cvxpy(self, problem: Any, parameter: Any, belief: Array) -> Array:
        """The same by CVXPY, whose status says why there is no solution."""
        parameter.value = belief
        # CVXPY 1.9.3 compiles `sum_largest` (and `cvar`) by the variable's value, and fails where their number is no integer.
        self._variable.save_value(None)
        try:
            problem.solve(solver=self._cvxpy.CLARABEL, warm_start=False)
        except self._cvxpy.error.SolverError as error:
            raise SolverError(f"Clarabel failed for belief {belief}: {error}") from None
        if problem.status in ("unbounded", "unbounded_inaccurate"):
            raise ModelError(f"the cost under belief {belief} has no minimum over the feasible set: add bounds")
        if self._variable.value is None:
            raise SolverError(f"Clarabel ended with status {problem.status!r} for belief {belief}")
        return np.array(self._variable.value, dtype=np.float64)

    def _region(self, constraints: Any) -> Polyhedron:
        bounds = self._attributed()
        if isinstance(constraints, Polyhedron):
            region = constraints
            if region.n_actions != self.n_actions:
                raise InputError(f"constraints have {region.n_actions} coordinates, the variable {self.n_actions}")
        else:
            region = self._rows_of(list(constraints) if isinstance(constraints, Iterable) else [constraints])
        return region if bounds is None else region & bounds

    def _within_domains(self, region: Polyhedron) -> Polyhedron:
        """The region up to the affine ends of the costs' domains. Beyond them costs are infinite, though CVXPY has values of
        `inv_pos` and others there."""
        limits = [each for cost in self._costs for each in _domain(cost) if self._is_plain(each) and each.variables()]
        if not limits:
            return region
        domain = self._rows_of(limits)
        beyond = np.flatnonzero([not _implied(region, *row) for row in zip(domain.A_ub, domain.b_ub, strict=True)])
        names = [domain.names[i] for i in beyond]
        return region & Polyhedron(domain.A_ub[beyond], domain.b_ub[beyond], names=names) if beyond.size else region

    def _rows_of(self, given: list[Any]) -> Polyhedron:
        below, equal, names = [], [], {"below": [], "equal": []}  # type: ignore[var-annotated]
        lifted = [each for each in given if not self._is_plain(each)]
        for each in (each for each in given if self._is_plain(each)):
            rows, is_equality = self._affine_rows(each)
            name = str(each)[:_LONGEST_NAME]
            (equal if is_equality else below).append(rows)
            names["equal" if is_equality else "below"] += [
                name if len(rows) == 1 else f"{name}[{i}]" for i in range(len(rows))
            ]
        lower = np.vstack(below) if below else np.zeros((0, self.n_actions + 1))
        exact = np.vstack(equal) if equal else np.zeros((0, self.n_actions + 1))
        region = Polyhedron(
            lower[:, :-1], lower[:, -1], exact[:, :-1], exact[:, -1], names=names["below"] + names["equal"]
        )
        return constrained(self._cvxpy, self._variable, lifted, region) if lifted else region

    def _is_plain(self, constraint: Any) -> bool:
        """Whether a constraint is affine in the problem's variable alone."""
        kinds = self._cvxpy.constraints
        if not isinstance(constraint, kinds.Constraint):
            raise InputError(f"constraints has {constraint!r}, expected constraints of CVXPY")
        known = (kinds.Equality, kinds.Zero, kinds.Inequality, kinds.NonPos, kinds.NonNeg)
        is_affine = isinstance(constraint, known) and constraint.expr.is_affine()
        return is_affine and all(each.id == self._variable.id for each in constraint.variables())

    def _attributed(self) -> Polyhedron | None:
        """The bounds that the variable's own attributes state."""
        attributes = self._variable.attributes
        given = {name for name, value in attributes.items() if value is not None and value is not False}
        foreign = sorted(given - _BOUNDS)
        if foreign:
            raise InputError(
                f"variable has the attribute {foreign[0]}: decisions must be real vectors without gaps, with their limits in "
                "`constraints` or `bounds`"
            )
        sides = attributes.get("bounds") or (-np.inf, np.inf)
        sides = [getattr(side, "value", side) for side in sides]  # constants of CVXPY have one
        lower, upper = (np.array(np.broadcast_to(side, self.n_actions), dtype=np.float64) for side in sides)
        lower = np.maximum(lower, 0.0) if given & {"nonneg", "pos"} else lower
        upper = np.minimum(upper, 0.0) if given & {"nonpos", "neg"} else upper
        return box(lower, upper) if np.isfinite(np.append(lower, upper)).any() else None

    def _affine_rows(self, constraint: Any) -> tuple[Array, bool]:
        """Rows [a, b] of a'u ≤ b or a'u = b: CVXPY's slope and the value at 0. Differences of values lose digits beside large
        constants."""
        kinds = self._cvxpy.constraints
        if constraint.expr.parameters():
            raise InputError(f"constraint {constraint} must be without parameters")
        sign = -1.0 if isinstance(constraint, kinds.NonNeg) else 1.0
        self._variable.save_value(np.zeros(self.n_actions))
        offset = sign * np.ravel(constraint.expr.value, order="F")
        slope = constraint.expr.grad.get(self._variable, np.zeros((self.n_actions, offset.size)))
        dense = slope.toarray() if hasattr(slope, "toarray") else np.reshape(slope, (self.n_actions, offset.size))
        rows = np.column_stack([sign * dense.T, -offset])
        return rows, isinstance(constraint, (kinds.Equality, kinds.Zero))


def _imported() -> Any:
    try:
        import cvxpy
    except ImportError:
        raise InputError(
            "costs in CVXPY need an extra: pip install 'inscrutable[cvx]'; or give functions to "
            "ConvexProblem.from_functions"
        ) from None
    return cvxpy


def _domain(expression: Any) -> list[Any]:
    """The constraints of an expression's domain, but not those of logarithms: decisions stay within these by their costs. With
    them, three states of 250 logarithms take 3 s to read, not .02 s."""
    inner = [each for part in expression.args for each in _domain(part)]
    return [*expression._domain(), *inner] if expression.args and type(expression).__name__ != "log" else inner


def _implied(region: Polyhedron, row: Array, side: float) -> bool:
    """Whether all decisions of a region satisfy a row (U,): by its box, else by a linear programme."""
    used = np.flatnonzero(row)
    lower, upper = region.bounding_box[used].T
    if (row[used] * np.where(row[used] > 0.0, upper, lower)).sum() <= side:
        return True
    inner = region.in_decision
    answer = minimise(-row, Rows(inner.A_ub, inner.b_ub), Rows(inner.A_eq, inner.b_eq))
    return answer.status == OPTIMAL and -answer.value <= side + tolerances.FEASIBILITY


def _checked_cost(state: int, cost: Any, variable: Any) -> Any:
    if not isinstance(cost, _imported().Expression):
        raise InputError(f"the cost of state {state} must be an expression of CVXPY, got {cost!r}")
    for promise, kept in (
        ("scalar", lambda: cost.is_scalar()),
        ("convex by CVXPY's rules", lambda: cost.is_convex()),
        ("without parameters", lambda: not cost.parameters()),
        ("in the problem's variable alone", lambda: all(each.id == variable.id for each in cost.variables())),
    ):
        if not kept():
            raise InputError(f"the cost of state {state} must be an expression that is {promise}, got {cost}")
    return cost
