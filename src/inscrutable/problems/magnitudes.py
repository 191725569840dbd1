"""Feasible sets with limits on sums of magnitudes, Σ_j w_j |u_j − b_j| ≤ L, of any number of coordinates.

In the variables of `Segments` such a limit is one row; quadratic and linear costs, their decisions and consistent beliefs use
these variables, by the problem's forms. In the decision's coordinates it takes one row for every choice of signs: they are
written only for other costs.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import orth

from inscrutable import tolerances
from inscrutable.axes import Axis
from inscrutable.errors import ModelError
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise, minimum
from inscrutable.problems.conflicts import RowConflict, row_conflict
from inscrutable.problems.constraints import Polyhedron
from inscrutable.problems.segments import MagnitudeLimit, Segments
from inscrutable.validation import Array

MOST_SIGNED = 10
"""Most coordinates of either sign whose limit is written as rows in the decision: 1,024 rows, hundreds of them tight."""

_HALVINGS = 50


class MagnitudeRegion(Polyhedron):
    """A feasible set of affine rows and limits on sums of magnitudes; made by `long_short` and `turnover`.

    Formula: {u ∈ C : Σ_j w_kj |u_j − b_kj| ≤ L_k for all k}.

    Quadratic and linear problems use its rows in the variables of `segments`; other problems those of `in_decision`;
    `A_ub` raises `ModelError`.

    Args:
        rows: C, the affine rows.
        limits: The limits.

    Raises:
        ModelError: Rows in the decision itself are asked for, and more than ten coordinates of a limit can have either sign.

    Cost: none; in the decision up to 1,024 rows a limit. Source: Boyd and Vandenberghe, Convex Optimization (2004), section
    6.1: norms by auxiliary variables.

    Example:
        >>> from inscrutable import simplex, turnover
        >>> region = simplex(50) & turnover(np.full(50, 0.02), 0.1)
        >>> region.names[-1], region.segments.feasible().n_actions
        ('turnover <= 0.1', 101)
    """

    needs_lift = True

    def __init__(self, rows: Polyhedron, limits: Sequence[MagnitudeLimit]) -> None:
        self.rows, self.limits = rows, tuple(limits)
        self.A_eq, self.b_eq = rows.A_eq, rows.b_eq
        self.asset_names, self.min_slack = rows.asset_names, rows.min_slack
        self.names = (*rows.names, *(limit.name for limit in self.limits))
        self._is_feasible = False

    @cached_property
    def segments(self) -> Segments:
        """The variables in which the limits are rows."""
        return Segments(self.rows, limits=self.limits)

    @property
    def n_actions(self) -> int:
        """Number of coordinates U of a decision."""
        return self.rows.n_actions

    @cached_property
    def coordinate_bounds(self) -> tuple[Array, Array]:
        """Least and greatest value (U,) that rows with one coefficient leave to each coordinate."""
        return self.rows.coordinate_bounds

    @cached_property
    def in_decision(self) -> Polyhedron:
        """The same set by rows in the decision."""
        region = self.rows
        for limit in self.limits:
            region = _signed(region, limit) & region
        return region

    def _no_rows(self) -> Any:
        raise ModelError(
            "limits on sums of magnitudes are no rows of this set: those in the decision are of `in_decision`"
        )

    A_ub = b_ub = row_scale = property(_no_rows)

    def slacks(self, actions: ArrayLike) -> Array:
        """Return the slacks (…,n) of `rows_in_full`."""
        return self.rows_in_full.slacks(self.segments.variables(self._points(actions)))

    def excess(self, actions: ArrayLike) -> Array:
        """Return by how much decisions (…,U) exceed each limit, per unit of its largest weight: shape (…,K)."""
        points = self._points(actions)
        over = [(limit.used(points) - limit.most) / limit.weights.max() for limit in self.limits]
        return np.stack(over, axis=-1)

    def violation(self, actions: ArrayLike) -> Array:
        """Return the largest violation of a row or limit, as that of `Polyhedron`."""
        points = self._points(actions)
        over = np.maximum(self.excess(points).max(axis=-1), 0.0)
        return np.asarray(np.maximum(self.rows.violation(points), over / np.maximum(np.abs(points).max(axis=-1), 1.0)))

    def is_admissible(self, actions: ArrayLike) -> np.ndarray:
        """Return whether decisions are feasible with every segment and limit tight or slack by at least `min_slack`; at either
        end of a segment of less than a hundredth of it."""
        points = self._points(actions)
        inside = self.violation(points) <= tolerances.FEASIBILITY
        return np.asarray(self.rows_in_full.is_admissible(self.segments.variables(points)) & inside)

    @cached_property
    def rows_in_full(self) -> Polyhedron:
        """The set as rows in the variables of `segments`."""
        return self.segments.feasible()

    def worst_row(self, action: Array) -> str:
        """Return which row or limit a decision (U,) violates most, and by how much."""
        over = self.excess(action)
        if over.max() > self.rows.violation(action):
            return f"{self.limits[int(over.argmax())].name} is exceeded by {over.max():.3g}"
        return self.rows.worst_row(action)

    def conflict(self) -> RowConflict | None:
        """Return rows that no decision satisfies together, or limits that no decision within the rows keeps; None where some
        decision satisfies all."""
        if self._is_feasible:
            return None
        found = self.rows.conflict() or self._short_limits()
        self._is_feasible = self.rows_in_full._is_feasible = found is None
        return found

    def _short_limits(self) -> RowConflict | None:
        """The limits that decisions within the rows exceed, with the least sum of excesses."""
        region, count = self.rows_in_full, len(self.limits)
        more = np.vstack([np.zeros((len(region.b_eq) - count, count)), -np.eye(count)])
        answer = minimum(
            np.append(np.zeros(region.n_actions), np.ones(count)),
            Rows(np.hstack([region.A_ub, np.zeros((len(region.b_ub), count))]), region.b_ub),
            Rows(np.hstack([region.A_eq, more]), region.b_eq),
            [(None, None)] * region.n_actions + [(0, None)] * count,
        )
        over = answer.x[region.n_actions :]
        short = [k for k, limit in enumerate(self.limits) if over[k] > tolerances.FEASIBILITY * limit.weights.max()]
        if not short:
            return None
        names, amounts = tuple(self.limits[k].name for k in short), tuple(float(over[k]) for k in short)
        found = row_conflict(Rows(region.A_ub, region.b_ub), Rows(region.A_eq, region.b_eq), region.names)
        parts = {} if found is None else dict(zip(found.names, found.amounts, strict=True))
        own = {name: by for name, by in parts.items() if name not in self.segments.inner_names}
        own = own or dict(zip(names, amounts, strict=True))
        return RowConflict(tuple(own), tuple(own.values()), names, amounts)

    @cached_property
    def bounding_box(self) -> Array:
        """Least and greatest value of each coordinate over the set, shape (U, 2)."""
        region = self.rows_in_full
        below, equal = Rows(region.A_ub, region.b_ub), Rows(region.A_eq, region.b_eq)
        found = np.empty((self.n_actions, 2))
        for j, base in enumerate(self.segments.base):
            for side, sign in enumerate((1.0, -1.0)):
                answer = minimise(self._along(sign * np.eye(self.n_actions)[j]), below, equal)
                found[j, side] = base + sign * answer.value if answer.status == OPTIMAL else -sign * np.inf
        return found

    def extreme(self, direction: Array) -> Array:
        """Return a decision (U,) that is least along a direction (U,)."""
        return self.segments.decisions(self.rows_in_full.extreme(self._along(direction)))

    def _along(self, direction: Array) -> Array:
        return np.append(direction @ self.segments.columns, np.zeros(len(self.limits)))

    def affine_hull(self, ends: Array) -> Array:
        """Return directions (U,k) that span the set, of which `ends` (n,U) are extreme in every coordinate."""
        return np.asarray(orth((ends - ends.mean(axis=0)).T, rcond=tolerances.ON_FACE))

    def reach(self, points: Array, directions: Array, ends: Array) -> tuple[Array, Array]:
        """Return how far points can move along directions, as that of `Polyhedron`; the limits by bisection."""
        low, high = self.rows.reach(points, directions, ends)
        for limit in self.limits:
            for sign in (1.0, -1.0):
                speed = np.abs(directions) @ limit.weights.sum(axis=0) + sign * (directions * limit.linear).sum(axis=1)
                start = (np.abs(points[:, None] - limit.centers) * limit.weights).sum(axis=(1, 2))
                room = limit.most + start - (points * limit.linear).sum(axis=1)
                with np.errstate(divide="ignore", invalid="ignore"):
                    most = np.where(speed > tolerances.TINY, room / speed, np.inf)  # no farther, whatever the signs
                low, high = (low, np.minimum(high, most)) if sign > 0 else (np.maximum(low, -most), high)
        return -self._within(points, -directions, -low), self._within(points, directions, high)

    def _within(self, points: Array, directions: Array, steps: Array) -> Array:
        """The longest steps (n,) up to given ones that keep the limits."""
        long = np.maximum(steps, 0.0)
        kept = self._keeps(points + long[:, None] * directions)
        short = np.where(kept, long, 0.0)
        for _ in range(0 if kept.all() else _HALVINGS):
            middle = 0.5 * (short + long)
            inside = self._keeps(points + middle[:, None] * directions)
            short, long = np.where(inside, middle, short), np.where(inside, long, middle)
        return short

    def _keeps(self, points: Array) -> np.ndarray:
        """Whether decisions (n,U) keep the limits."""
        return np.asarray(self.excess(points).max(axis=1) <= tolerances.FEASIBILITY)

    def __and__(self, other: Polyhedron) -> Polyhedron:
        """Return the intersection with other rows or limits, coordinates aligned by their names."""
        if not isinstance(other, Polyhedron):
            return NotImplemented
        if not isinstance(other, MagnitudeRegion):
            rows = self.rows & other
            return MagnitudeRegion(rows, self.in_order(Axis("asset", rows.asset_names)).limits)
        rows = self.rows & other.rows
        assets = Axis("asset", rows.asset_names)
        return MagnitudeRegion(rows, (*self.in_order(assets).limits, *other.in_order(assets).limits))

    def __rand__(self, other: Polyhedron) -> Polyhedron:
        """Return the intersection of other rows with these."""
        if not isinstance(other, Polyhedron):
            return NotImplemented
        rows = other & self.rows
        return MagnitudeRegion(rows, self.in_order(Axis("asset", rows.asset_names)).limits)

    def in_order(self, assets: Axis, name: str = "constraints") -> MagnitudeRegion:
        """Return this set with its coordinates in the order of `assets`, as that of `Polyhedron`."""
        order = None if self.asset_names is None else assets.order(self.asset_names, name)
        rows = self.rows.in_order(assets, name)
        if rows is self.rows:
            return self
        columns = np.arange(self.n_actions) if order is None else np.array(order)
        return MagnitudeRegion(rows, [each.ordered(columns) for each in self.limits])

    def __repr__(self) -> str:
        return f"MagnitudeRegion({self.rows!r}, {len(self.limits)} limits on sums of magnitudes)"


def limited(rows: Polyhedron, limit: MagnitudeLimit) -> Polyhedron:
    """Return rows with a limit on a sum of magnitudes: one more row where no term can have either sign."""
    if isinstance(rows, MagnitudeRegion):
        return limited(rows.rows, limit) & rows
    return MagnitudeRegion(rows, (limit,)) if (_signs(rows, limit) == 0).any() else _signed(rows, limit) & rows


def _signs(rows: Polyhedron, limit: MagnitudeLimit) -> Array:
    """The sign of each term of a limit: 1 or −1, and 0 where it can have either."""
    term, place = np.nonzero(limit.weights)
    centers, (lower, upper) = limit.centers[term, place], rows.coordinate_bounds
    return np.where(lower[place] >= centers, 1.0, np.where(upper[place] <= centers, -1.0, 0.0))


def _signed(rows: Polyhedron, limit: MagnitudeLimit) -> Polyhedron:
    """A limit as one row for every choice of signs; row names list the coordinates that count as below their centers."""
    known = _signs(rows, limit)
    term, place = np.nonzero(limit.weights)
    if (known == 0).sum() > MOST_SIGNED:
        raise ModelError(
            f"{limit.name!r} is a limit on a sum of {place.size} magnitudes, which has no rows in the "
            "decision: only quadratic and linear costs accept it; limit each coordinate instead (max_weights, min_weights), "
            "or fewer of them"
        )
    signs = np.array(list(product(*((sign,) if sign else (1.0, -1.0) for sign in known)))).reshape(-1, place.size)
    weighted = signs * limit.weights[term, place]
    summed = np.broadcast_to(limit.linear, (len(signs), rows.n_actions)).copy()
    np.add.at(summed.T, place, weighted.T)
    names = rows.asset_names
    labels = np.array([f"u[{j}]" for j in range(rows.n_actions)] if names is None else names, dtype=str)[place]
    told = [f"{limit.name} (below: {', '.join(labels[row < 0]) or 'none'})" for row in signs]
    sides = weighted @ limit.centers[term, place] + limit.most
    return Polyhedron(summed, sides, names=told, min_slack=rows.min_slack, asset_names=names)
