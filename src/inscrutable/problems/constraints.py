"""Feasible sets C = {u : A_ub u ≤ b_ub, A_eq u = b_eq}, combined with `&`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import null_space, orth

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, Names, axis_labels
from inscrutable.errors import InputError, ModelError, SolverError
from inscrutable.geometry.cones import StationarityRows, stationarity_rows
from inscrutable.geometry.polytopes import line_ends
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise, minimum
from inscrutable.problems.conflicts import RowConflict, implied_equalities, row_conflict
from inscrutable.validation import Array

_MOST_PATTERNS = 4096
_MOST_ENTRIES = 8_000_000
"""The most patterns of tight rows that a set stores; one takes about U by U entries, so 64 MB in all."""


class Polyhedron:
    """A feasible set of decisions given by affine rows.

    Formula: C = {u ∈ R^U : A_ub u ≤ b_ub, A_eq u = b_eq}.

    Rows that every u satisfies are dropped, with their names: 0'u ≤ 1, a'u ≤ ∞, 0'u = 0; so are equalities that follow from
    those before them.

    Args:
        A_ub: Inequality rows, shape (n, U), or None.
        b_ub: Their right-hand sides, shape (n,), in the decision's unit times the row's; inf for no limit.
        A_eq: Equality rows, shape (e, U), or None.
        b_eq: Their right-hand sides, shape (e,).
        names: One name per row, inequalities first, for messages.
        min_slack: Least slack of an inequality row that is not tight in an admissible decision, in units of the
            row's largest coefficient; the paper has 0. Give decisions in a unit in which ranges are far larger: in a box no
            wider than twice this, every row counts as tight, and every belief explains every decision.
        asset_names: One label per coordinate; None takes those of labelled rows. Labelled decisions are aligned with them,
            and so are sets combined with this one and the costs of a problem over it.

    Raises:
        InputError: Shapes or labels disagree, an entry is not finite, `min_slack` is negative.
        ModelError: No u satisfies a row by itself, such as 0'u ≤ −1; the row is named.

    Cost: none; feasibility is checked when a decision problem is built. Source: the paper, eq. (3).

    Example:
        >>> long_only = Polyhedron(A_ub=[[-1, 0], [0, -1]], b_ub=[0, 0], A_eq=[[1, 1]], b_eq=[1])
        >>> long_only.n_actions
        2
    """

    needs_lift: bool = False
    """Whether the set needs more variables than the decision's, as a `MagnitudeRegion` does."""

    short_ranges: np.ndarray = np.zeros((0, 2), dtype=np.intp)
    """Pairs of rows, the ends of ranges too short for `min_slack`: admissible decisions are at one of the two."""

    def __init__(
        self,
        A_ub: ArrayLike | None = None,
        b_ub: ArrayLike | None = None,
        A_eq: ArrayLike | None = None,
        b_eq: ArrayLike | None = None,
        *,
        names: Sequence[str] | None = None,
        min_slack: float = tolerances.MIN_SLACK,
        asset_names: Names | None = None,
    ) -> None:
        assets = Axis("asset", None if asset_names is None else tuple(asset_names), learns=True)
        self.A_ub, self.b_ub = _rows(A_ub, b_ub, "ub", A_eq, assets)
        self.A_eq, self.b_eq = _rows(A_eq, b_eq, "eq", A_ub, assets)
        if self.A_ub.shape[1] != self.A_eq.shape[1]:
            raise InputError(f"A_ub has {self.A_ub.shape[1]} columns but A_eq has {self.A_eq.shape[1]}")
        if assets.names is not None and len(set(assets.names)) != self.A_ub.shape[1]:
            raise InputError(
                f"asset_names has {len(set(assets.names))} labels, expected one per coordinate: {self.n_actions}"
            )
        self.asset_names = assets.names
        n_rows = self.A_ub.shape[0] + self.A_eq.shape[0]
        if names is None:
            given = [*_row_names(A_ub, "A_ub", len(self.b_ub)), *_row_names(A_eq, "A_eq", len(self.b_eq))]
        else:
            given = _labelled(names, assets.names)
        if len(given) != n_rows:
            raise InputError(f"names has {len(given)} entries, expected one per row: {n_rows}")
        self._keep_rows(given)
        self.min_slack = validation.non_negative(min_slack, "min_slack")
        self._stationarity: dict[bytes, StationarityRows | str] = {}  # or why there are none
        self._is_feasible = False  # until found to be

    def _keep_rows(self, names: list[str]) -> None:
        """Drop rows that every decision satisfies, and implied equalities; raise `ModelError` for one that none satisfies."""
        n = len(self.b_ub)
        empty = np.asarray(~np.vstack([self.A_ub, self.A_eq]).any(axis=1))
        missed: Array = np.concatenate([-self.b_ub, np.abs(self.b_eq)])  # by how much 0 violates the row
        broken = np.asarray((empty & (missed > tolerances.FEASIBILITY)) | np.isposinf(missed))
        if broken.any():
            row = int(broken.argmax())
            sign, side = ("<=", self.b_ub[row]) if row < n else ("=", self.b_eq[row - n])
            what = "0" if empty[row] else "a finite number"
            raise ModelError(f"no decision satisfies {names[row]}: it asks that {what} {sign} {side:g}")
        kept = np.asarray(~empty & ~np.isneginf(missed))
        kept[n:] &= ~implied_equalities(self.A_eq, self.b_eq)
        self.A_ub, self.b_ub = self.A_ub[kept[:n]], self.b_ub[kept[:n]]
        self.A_eq, self.b_eq = self.A_eq[kept[n:]], self.b_eq[kept[n:]]
        self.names = tuple(name for name, stays in zip(names, kept, strict=True) if stays)

    @property
    def n_actions(self) -> int:
        """Number of coordinates U of a decision."""
        return int(self.A_ub.shape[1])

    @cached_property
    def row_scale(self) -> Array:
        """Largest coefficient of each inequality row, shape (n,)."""
        return np.asarray(np.abs(self.A_ub).max(axis=1, initial=0.0))

    @cached_property
    def coordinate_bounds(self) -> tuple[Array, Array]:
        """Least and greatest value (U,) that rows with one coefficient leave to each coordinate; infinite where none."""
        single = np.flatnonzero((self.A_ub != 0).sum(axis=1) == 1)
        column = (self.A_ub[single] != 0).argmax(axis=1)
        return _limits(self.n_actions, column, self.A_ub[single, column], self.b_ub[single])

    @property
    def general_rows(self) -> Rows:
        """The inequality rows with more than one coefficient: all that is not among `coordinate_bounds`."""
        several = (self.A_ub != 0).sum(axis=1) != 1
        return Rows(self.A_ub[several], self.b_ub[several])

    def slacks(self, actions: ArrayLike) -> Array:
        """Return (b_ub − A_ub u) per unit of the row's largest coefficient, shape (…, n)."""
        points = self._points(actions)
        column, factor = self._bounds
        sides = points @ self.A_ub.T if column is None else points[..., column] * factor
        return np.asarray((self.b_ub - sides) / self.row_scale)

    @cached_property
    def _bounds(self) -> tuple[np.ndarray | slice | None, Array]:
        """Coordinate and factor of each inequality, where every one has one coordinate: a product would take U² operations."""
        if not len(self.A_ub) or np.any(np.count_nonzero(self.A_ub, axis=1) != 1):
            return None, np.empty(0)
        column = np.abs(self.A_ub).argmax(axis=1)
        factor = self.A_ub[np.arange(len(column)), column]
        return (slice(None) if np.array_equal(column, np.arange(self.n_actions)) else column), factor

    def tight_rows(self, actions: ArrayLike) -> np.ndarray:
        """Return which inequality rows an observer counts as tight: slack below `min_slack`, shape (…, n)."""
        return np.asarray(self.slacks(actions) < self.observed_slack)

    @cached_property
    def observed_slack(self) -> float:
        """Slack below which an observer counts a row as tight: `min_slack`, at least the rounding of a zero slack."""
        return max(self.min_slack, tolerances.FEASIBILITY)

    @cached_property
    def played_slack(self) -> float:
        """Least slack that searches leave to a loose row: above `observed_slack` by more than their own violations."""
        return self.observed_slack + max(tolerances.SLACK_SAFETY * self.min_slack, tolerances.FEASIBILITY)

    def stationarity(self, tight: np.ndarray) -> StationarityRows:
        """Return the conditions, without multipliers, for a gradient to be stationary with the rows `tight` active."""
        key = tight.tobytes()
        known = self._stationarity.get(key)
        if known is None:
            try:
                known = stationarity_rows(self.A_ub[tight], self.A_eq)
            except SolverError as error:
                known = str(error)
            if len(self._stationarity) >= min(_MOST_PATTERNS, max(1, _MOST_ENTRIES // self.n_actions**2)):
                self._stationarity.clear()
            self._stationarity[key] = known
        if isinstance(known, str):
            raise SolverError(known)
        return known

    @cached_property
    def equality_span(self) -> Array:
        """Orthonormal basis of the rows of A_eq, shape (U, rank)."""
        return np.asarray(orth(self.A_eq.T))

    def violation(self, actions: ArrayLike) -> Array:
        """Return the largest violation of any row, per unit of its largest coefficient and of the decision's size where
        that is above one, shape (…)."""
        points = self._points(actions)
        return self._beyond(points, self.slacks(points))

    def _points(self, actions: ArrayLike) -> Array:
        return validation.points(actions, self.n_actions, Axis("asset", self.asset_names))

    def _beyond(self, points: Array, slacks: Array) -> Array:
        beyond = -slacks.min(axis=-1, initial=np.inf)
        off = (np.abs(points @ self.A_eq.T - self.b_eq) / self._equality_scale).max(axis=-1, initial=0.0)
        return np.asarray(np.maximum(np.maximum(beyond, off), 0.0) / _size(points))

    @cached_property
    def _equality_scale(self) -> Array:
        return np.asarray(np.abs(self.A_eq).max(axis=1, initial=0.0))

    def check_inside(self, points: Array, name: str, *, beyond: float = tolerances.FEASIBILITY) -> None:
        """Raise `InputError` with the worst row of the first of decisions (U,) or (T,U) that violates one by too much."""
        bad = np.flatnonzero(np.atleast_1d(self.violation(points)) > beyond)
        if not bad.size:
            return
        where = "" if points.ndim == 1 else f" row {bad[0]}"
        raise InputError(f"{name}{where} is outside the feasible set: {self.worst_row(np.atleast_2d(points)[bad[0]])}")

    def worst_row(self, action: Array) -> str:
        """Return which row a decision (U,) violates most, and by how much."""
        slack, off = self.slacks(action), self.A_eq @ action - self.b_eq
        if slack.size and -slack.min() >= np.abs(off).max(initial=0.0):
            return f"{self.names[int(slack.argmin())]} is violated by {-slack.min():.3g}"
        worst = int(np.abs(off).argmax())
        return f"{self.names[len(self.b_ub) + worst]} is off by {off[worst]:.3g}"

    def is_admissible(self, actions: ArrayLike) -> np.ndarray:
        """Return whether each decision is feasible with every inequality row tight or slack by `min_slack`, shape (…)."""
        points = self._points(actions)
        slack = self.slacks(points)
        tight = np.abs(slack) <= tolerances.FEASIBILITY * _size(points)[..., None]
        clear = tight | (slack >= self.min_slack)
        clear[..., self.short_ranges] = tight[..., self.short_ranges].any(axis=-1, keepdims=True)
        return np.asarray(clear.all(axis=-1) & (self._beyond(points, slack) <= tolerances.FEASIBILITY))

    def __and__(self, other: Polyhedron) -> Polyhedron:
        """Return the intersection; names are kept, coordinates aligned by them, the larger `min_slack` is used.

        Of inequalities with the same direction the tighter one is kept, of equal ones the first.
        """
        if not isinstance(other, Polyhedron) or other.needs_lift:  # which has its own intersection
            return NotImplemented
        if other.n_actions != self.n_actions:
            raise InputError(f"cannot intersect sets in {self.n_actions} and {other.n_actions} coordinates")
        other = other.in_order(Axis("asset", self.asset_names, learns=True), "the second set")
        n, m = len(self.b_ub), len(other.b_ub)
        rows, sides = np.vstack([self.A_ub, other.A_ub]), np.concatenate([self.b_ub, other.b_ub])
        kept, names = _tightest(rows, sides), self.names[:n] + other.names[:m]
        return Polyhedron(
            rows[kept],
            sides[kept],
            np.vstack([self.A_eq, other.A_eq]),
            np.concatenate([self.b_eq, other.b_eq]),
            names=[*(names[row] for row in kept), *self.names[n:], *other.names[m:]],
            min_slack=max(self.min_slack, other.min_slack),
            asset_names=other.asset_names,
        )

    def in_order(self, assets: Axis, name: str = "constraints") -> Polyhedron:
        """Return this set with its coordinates in the order of `assets`, whose labels it takes; itself where it has them.

        Raises:
            InputError: Both have labels, and they are not the same; missing and unexpected labels are named.
        """
        order = None if self.asset_names is None else assets.order(self.asset_names, name)
        if order is None and assets.names in (None, self.asset_names):
            return self
        columns = np.arange(self.n_actions) if order is None else np.array(order)
        return Polyhedron(
            self.A_ub[:, columns],
            self.b_ub,
            self.A_eq[:, columns],
            self.b_eq,
            names=self.names,
            min_slack=self.min_slack,
            asset_names=assets.names,
        )

    @property
    def rows_in_full(self) -> Polyhedron:
        """The set as rows, with auxiliary variables where it needs them."""
        return self

    @property
    def in_decision(self) -> Polyhedron:
        """The set as rows in the decision itself."""
        return self

    def __repr__(self) -> str:
        return f"Polyhedron({self.n_actions} coordinates, {len(self.b_ub)} inequalities, {len(self.b_eq)} equalities)"

    def check_feasible(self) -> None:
        """Raise `ModelError` naming the rows in conflict, and by how much, where no decision satisfies all rows."""
        found = self.conflict()
        if found is not None:
            raise ModelError(found.summary())

    def conflict(self) -> RowConflict | None:
        """Return rows that no decision satisfies together, and by how much, or None where some decision satisfies all."""
        if self._is_feasible:
            return None
        found = row_conflict(Rows(self.A_ub, self.b_ub), Rows(self.A_eq, self.b_eq), self.names)
        self._is_feasible = found is None
        return found

    def extreme(self, direction: Array) -> Array:
        """Return a decision (U,) that minimises a linear function (U,) with a minimum over the set."""
        return minimum(direction, Rows(self.A_ub, self.b_ub), Rows(self.A_eq, self.b_eq)).x

    def directions(self, tight: np.ndarray | None = None) -> Array:
        """Return an orthonormal basis (U,k) of the directions that keep all equalities, and inequality rows `tight` tight."""
        normals = self.A_eq if tight is None else np.vstack([self.A_ub[tight], self.A_eq])
        return null_space(normals, rcond=tolerances.ON_FACE) if len(normals) else np.eye(self.n_actions)

    def affine_hull(self, ends: Array) -> Array:
        """Return directions (U,k) that span the set, of which `ends` (n,U) are extreme in every coordinate."""
        hull = np.vstack([self.A_eq, self.A_ub[self._flat_rows(ends)]])
        return null_space(hull, rcond=tolerances.ON_FACE) if len(hull) else np.eye(self.n_actions)

    def _flat_rows(self, ends: Array) -> np.ndarray:
        """Which rows are tight at every decision: the mean of `ends` is slack in all others."""
        return np.asarray(self.slacks(ends.mean(axis=0)) <= tolerances.FEASIBILITY)

    def reach(self, points: Array, directions: Array, ends: Array) -> tuple[Array, Array]:
        """Return how far feasible points (n,U) can move along directions (n,U) of the affine hull: the least and the greatest
        factor (n,)."""
        loose = ~self._flat_rows(ends)
        rows, sides = self.A_ub[loose], self.b_ub[loose]
        return line_ends(np.maximum(sides - points @ rows.T, 0.0), directions @ rows.T)

    @cached_property
    def bounding_box(self) -> Array:
        """Least and greatest value of each coordinate over the set, shape (U, 2); infinite where it is unbounded."""
        limits = np.empty((self.n_actions, 2))
        for j in range(self.n_actions):
            for side, sign in enumerate((1.0, -1.0)):
                answer = minimise(
                    sign * np.eye(self.n_actions)[j], Rows(self.A_ub, self.b_ub), Rows(self.A_eq, self.b_eq)
                )
                limits[j, side] = sign * answer.value if answer.status == OPTIMAL else -sign * np.inf
        return limits


class Bounds(Polyhedron):
    """A feasible set whose inequalities bound one coordinate each; `A_ub` is made only on demand.

    Formula: f_r u_{j(r)} ≤ s_r for each r, and A_eq u = b_eq: memory is linear in the coordinates. `box`, `simplex`,
    `min_weights` and `max_weights` return it, and their intersections are of this class.

    Args:
        n: Number of coordinates.
        inequalities: j, f and s, shape (r,) each; a row with infinite s is dropped.
        names: One name per inequality and equality.
        equalities: A_eq and b_eq, or None.
        min_slack: As for `Polyhedron`.
        asset_names: As for `Polyhedron`.
    """

    def __init__(
        self,
        n: int,
        inequalities: tuple[np.ndarray, Array, Array],
        names: Sequence[str],
        equalities: tuple[Array, Array] | None = None,
        *,
        min_slack: float = tolerances.MIN_SLACK,
        asset_names: Names | None = None,
    ) -> None:
        columns, factors, sides = inequalities
        rows = (np.zeros((0, n)), np.zeros(0)) if equalities is None else equalities
        super().__init__(None, None, *rows, names=names[len(sides) :], min_slack=min_slack, asset_names=asset_names)
        never = np.flatnonzero(np.isneginf(sides)).tolist()
        if never:
            raise ModelError(f"no decision satisfies {names[never[0]]}: it asks that a finite number <= -inf")
        kept, names = np.flatnonzero(~np.isposinf(sides)).tolist(), _labelled(names, self.asset_names)
        self.b_ub, self._held = sides[kept], (columns[kept], factors[kept])
        self.names = (*(names[row] for row in kept), *self.names)
        del self.A_ub  # made on demand

    def __getattr__(self, name: str) -> Any:
        if name != "A_ub" or "_held" not in vars(self):
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}", name=name, obj=self)
        columns, factors = self._held
        rows = np.zeros((len(columns), self.n_actions))
        rows[np.arange(len(columns)), columns] = factors
        self.A_ub = rows  # once it is whole: another thread may read it
        return rows

    @property
    def n_actions(self) -> int:
        """Number of coordinates U of a decision."""
        return int(self.A_eq.shape[1])

    @cached_property
    def row_scale(self) -> Array:
        """Coefficient of each inequality, without its sign."""
        return np.asarray(np.abs(self._held[1]))

    @cached_property
    def coordinate_bounds(self) -> tuple[Array, Array]:
        """Least and greatest value (U,) of each coordinate; infinite where there is no bound."""
        return _limits(self.n_actions, *self._held, self.b_ub)

    @property
    def general_rows(self) -> Rows:
        """No rows: every inequality bounds one coordinate."""
        return Rows(np.zeros((0, self.n_actions)), np.zeros(0))

    @cached_property
    def _bounds(self) -> tuple[np.ndarray | slice | None, Array]:
        columns, factors = self._held
        return (slice(None) if np.array_equal(columns, np.arange(self.n_actions)) else columns), factors

    def __and__(self, other: Polyhedron) -> Polyhedron:
        """Return the intersection, bounds as well where both are."""
        if not isinstance(other, Bounds) or other.n_actions != self.n_actions:
            return super().__and__(other)
        other = other.in_order(Axis("asset", self.asset_names, learns=True), "the second set")
        n, m = len(self.b_ub), len(other.b_ub)
        columns, factors = (np.concatenate(pair) for pair in zip(self._held, other._held, strict=True))
        sides, names = np.concatenate([self.b_ub, other.b_ub]), self.names[:n] + other.names[:m]
        kept = _first_of_least(sides / np.abs(factors), 2 * columns + (factors > 0), axis=None)
        return Bounds(
            self.n_actions,
            (columns[kept], factors[kept], sides[kept]),
            [*(names[row] for row in kept), *self.names[n:], *other.names[m:]],
            (np.vstack([self.A_eq, other.A_eq]), np.concatenate([self.b_eq, other.b_eq])),
            min_slack=max(self.min_slack, other.min_slack),
            asset_names=other.asset_names,
        )

    def in_order(self, assets: Axis, name: str = "constraints") -> Bounds:
        """Return this set with its coordinates in the order of `assets`, as `Polyhedron.in_order`."""
        order = None if self.asset_names is None else assets.order(self.asset_names, name)
        if order is None and assets.names in (None, self.asset_names):
            return self
        columns = np.arange(self.n_actions) if order is None else np.array(order)
        places, (held, factors) = np.argsort(columns), self._held
        return Bounds(
            self.n_actions,
            (places[held], factors, self.b_ub),
            self.names,
            (self.A_eq[:, columns], self.b_eq),
            min_slack=self.min_slack,
            asset_names=assets.names,
        )

    def conflict(self) -> RowConflict | None:
        """Return rows that no decision satisfies together, as `Polyhedron.conflict`; at once for one equality at most."""
        if not self._is_feasible and len(self.b_eq) <= 1:
            lower, upper = self.coordinate_bounds
            row = self.A_eq[0] if len(self.b_eq) else np.zeros(self.n_actions)
            side = float(self.b_eq.sum())
            with np.errstate(invalid="ignore"):
                ends = np.where(row == 0.0, 0.0, row * lower), np.where(row == 0.0, 0.0, row * upper)
            least, most = np.minimum(*ends).sum(), np.maximum(*ends).sum()
            self._is_feasible = bool((lower <= upper).all() and least <= side <= most)
        return super().conflict()

    def __repr__(self) -> str:
        return f"Polyhedron({self.n_actions} coordinates, {len(self.b_ub)} inequalities, {len(self.b_eq)} equalities)"


def checked_region(
    constraints: Polyhedron, n_actions: int, assets: Axis | None = None, *, lifts: bool = False
) -> Polyhedron:
    """Return a feasible set in `n_actions` coordinates that is not empty, or raise `InputError` or `ModelError`.

    Its coordinates are put in the order of `assets`, which takes the set's where it has none. `lifts` says that the problem
    uses the rows with auxiliary variables; other problems get the rows in the decision alone.
    """
    if not isinstance(constraints, Polyhedron):
        raise InputError(f"constraints must be a Polyhedron, got {type(constraints).__name__}")
    if constraints.n_actions != n_actions:
        raise InputError(f"constraints have {constraints.n_actions} coordinates, the costs {n_actions}")
    if not lifts:
        constraints = constraints.in_decision
    constraints.check_feasible()
    return constraints if assets is None else constraints.in_order(assets)


def _size(points: Array) -> Array:
    """Largest coordinate of each decision, at least one: what its rounding is relative to."""
    return np.asarray(np.maximum(np.abs(points).max(axis=-1, initial=0.0), 1.0))


def _rows(
    A: ArrayLike | None, b: ArrayLike | None, kind: str, other: ArrayLike | None, assets: Axis
) -> tuple[Array, Array]:
    if A is None and b is None:
        width = 0 if other is None else np.asarray(other).shape[-1]
        if width == 0:
            raise InputError("a feasible set needs A_ub with b_ub, or A_eq with b_eq, to know its dimension")
        return np.zeros((0, width)), np.zeros(0)
    if A is None or b is None:
        raise InputError(f"A_{kind} and b_{kind} must be given together")
    order = Axis("row", learns=True)
    rows = validation.finite_array(A, f"A_{kind}", ndim=2, axes=(order, assets))
    sides = validation.finite_array(b, f"b_{kind}", ndim=1, limits=kind == "ub", axes=(order,))
    if rows.shape[0] != sides.shape[0]:
        raise InputError(f"A_{kind} has {rows.shape[0]} rows but b_{kind} has {sides.shape[0]} entries")
    return rows, sides


def _limits(n: int, column: np.ndarray, coefficient: Array, sides: Array) -> tuple[Array, Array]:
    """Least and greatest value (n,) that rows with one coefficient each leave."""
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    value = sides / coefficient + 0.0  # -0.0 would be published as a weight
    np.maximum.at(lower, column[coefficient < 0], value[coefficient < 0])
    np.minimum.at(upper, column[coefficient > 0], value[coefficient > 0])
    return lower, upper


def _tightest(rows: Array, sides: Array) -> np.ndarray:
    """The indices, in order, of the tightest of the rows (m,U) of each direction, the first of equal ones."""
    scale = np.abs(rows).max(axis=1, initial=0.0)
    return _first_of_least(sides / scale, rows / scale[:, None] + 0.0, axis=0)


def _first_of_least(values: Array, kinds: np.ndarray, axis: int | None) -> np.ndarray:
    """The indices, in order, of the least value of each kind, the first of equal ones."""
    order = np.lexsort((np.arange(len(values)), values))
    _, first = np.unique(kinds[order], axis=axis, return_index=True)
    return np.sort(order[first])


def _row_names(A: ArrayLike | None, name: str, count: int) -> list[str]:
    labels = None if A is None else axis_labels(A, 0)
    return [f"{name}[{i}]" for i in range(count)] if labels is None else [str(label) for label in labels]


def _labelled(names: Sequence[str], labels: Names | None) -> list[str]:
    """Names of rows in which coordinates u[j] have their labels, as those of `box`."""
    known = {f"u[{j}]": str(label) for j, label in enumerate(labels or ())}
    return [re.sub(r"\bu\[\d+\]", lambda found: known.get(found[0], found[0]), str(name)) for name in names]


def simplex(n: int, *, min_slack: float = tolerances.MIN_SLACK) -> Polyhedron:
    """Return {u ≥ 0 : Σu = 1}, the long-only fully invested portfolios of `n` assets.

    Formula: −u ≤ 0, 1'u = 1.

    Args:
        n: Number of coordinates, at least 1.
        min_slack: Least weight that is not zero in an admissible decision; the paper has 0.

    Raises:
        InputError: `n` is not a whole number of at least 1.

    Cost: none; `n` bounds. Source: the paper, eq. (7).

    Example:
        >>> simplex(3).names[-1]
        'sum(u) = 1'
    """
    validation.count(n, "n")
    names = [f"u[{j}] >= 0" for j in range(n)] + ["sum(u) = 1"]
    signs = np.arange(n), -np.ones(n), np.zeros(n)
    return Bounds(n, signs, names, (np.ones((1, n)), np.ones(1)), min_slack=min_slack)


def box(lower: ArrayLike, upper: ArrayLike, *, min_slack: float = tolerances.MIN_SLACK) -> Polyhedron:
    """Return {u : lower ≤ u ≤ upper}; an infinite bound gives no row.

    Args:
        lower: Least value of each coordinate, shape (U,), −inf allowed.
        upper: Greatest value of each coordinate, shape (U,), +inf allowed.
        min_slack: Least distance from a bound of a coordinate that is not on it in an admissible decision.

    Raises:
        InputError: Shapes differ, a bound is NaN, or no bound is finite.
        ModelError: A lower bound is above its upper bound, or inf; an upper bound is −inf.

    Cost: none; one bound per finite entry. Source: the paper, eq. (3).

    Example:
        >>> (simplex(3) & box([0, 0, 0], [0.5, 0.5, 0.5])).n_actions
        3
    """
    assets = Axis("asset", learns=True)
    low, high = (
        np.atleast_1d(validation.finite_array(side, name, ndim=(0, 1), limits=True, axes=(assets,)))
        for side, name in ((lower, "lower"), (upper, "upper"))
    )
    if low.shape != high.shape:
        raise InputError(f"lower has shape {low.shape} and upper {high.shape}; expected two vectors of one length")
    crossed = np.flatnonzero((low > high) & np.isfinite(low) & np.isfinite(high))
    if crossed.size:
        j = crossed[0]
        raise ModelError(f"lower bound {low[j]:g} is above upper bound {high[j]:g} at coordinate {j}")
    if np.isneginf(low).all() and np.isposinf(high).all():
        raise InputError("a box needs at least one finite bound")
    own = [f"u[{j}]" for j in range(low.size)] if assets.names is None else assets.names
    names = [f"{name} >= {least:g}" for name, least in zip(own, low, strict=True)]
    names += [f"{name} <= {most:g}" for name, most in zip(own, high, strict=True)]
    signs = np.repeat([-1.0, 1.0], low.size)
    rows = np.tile(np.arange(low.size), 2), signs, np.concatenate([-low, high])
    return Bounds(low.size, rows, names, min_slack=min_slack, asset_names=assets.names)
