"""Coordinates split at the breakpoints of a cost or a limit: a part above the last, below the first, and between two.

A coordinate with breakpoints b_1 < … < b_K is u_j = b_1 − m + s_1 + … + s_{K−1} + p: m, p ≥ 0, and 0 ≤ s_k ≤ b_{k+1} − b_k. A
convex function Σ w_k |u_j − b_k| is linear in these variables where they are filled in order, and nowhere smaller. A quadratic
cost keeps its value there and its curvature in all the new directions: η x_k x_l, with its least curvature η,
costs nothing in order and something out of order.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.problems.constraints import Polyhedron
from inscrutable.validation import Array

_MOST_STRETCHED = 100.0
"""Largest factor by which a variable is scaled up: its curvature falls by the square, and must not count as zero."""

_UP, _DOWN, _BETWEEN, _PLAIN = range(4)


class MagnitudeLimit(NamedTuple):
    """A limit on a sum of magnitudes, Σ_kj w_kj |u_j − b_kj| + a'u ≤ L.

    Args:
        weights: w ≥ 0, shape (K,U): each coordinate has up to K breakpoints.
        centers: b, shape (K,U), in the decision's unit.
        most: L, in the decision's unit times that of the weights.
        name: Its name in messages.
        linear: a, shape (U,), or 0.
    """

    weights: Array
    centers: Array
    most: float
    name: str
    linear: Array | float = 0.0

    def used(self, points: Array) -> Array:
        """Return the left side of decisions (…,U), shape (…)."""
        pairs = zip(self.weights, self.centers, strict=True)
        total = sum((np.abs(points - center) @ weight for weight, center in pairs), start=np.zeros(points.shape[:-1]))
        return np.asarray(total + (points * self.linear).sum(axis=-1))

    def ordered(self, columns: np.ndarray) -> MagnitudeLimit:
        """Return the same of coordinates in another order."""
        linear = np.broadcast_to(self.linear, columns.size)[columns]
        return self._replace(weights=self.weights[:, columns], centers=self.centers[:, columns], linear=linear)


class Segments:
    """The variables of a feasible set whose coordinates have breakpoints.

    Args:
        region: The rows of the feasible set in the decision itself.
        breakpoints: Places (U,), NaN for none, where coordinates have one; several arrays where coordinates have several.
        limits: Limits on sums of magnitudes, whose breakpoints are added; the slack of each is one more variable.
    """

    def __init__(
        self, region: Polyhedron, breakpoints: Sequence[Array] = (), limits: Sequence[MagnitudeLimit] = ()
    ) -> None:
        self.region, self.limits = region, tuple(limits)
        self._lower, self._upper = region.coordinate_bounds
        self._least, self._most = _reach(region)
        rows = [row for each in self.limits for row in np.where(each.weights > 0, each.centers, np.nan)]
        # Of breakpoints that are nearly one a limit's is kept, and of limits' the nearest to zero: where gross and net exposure
        # are both 1, no decision would satisfy a limit on gross exposure whose breakpoint is moved by rounding.
        own = np.take_along_axis(np.array(rows), np.argsort(np.abs(rows), axis=0), axis=0) if rows else ()
        kinks = [self._inside(j, np.array(each)) for j, each in enumerate(zip(*own, *breakpoints, strict=True))]
        self._set_up(kinks, region.n_actions)
        least = region.min_slack * (1.0 + tolerances.SLACK_SAFETY)
        gaps = np.where(self._kind == _PLAIN, np.inf, self._ends)
        with np.errstate(divide="ignore"):
            wanted = least / gaps
        # A gap below the least slack is scaled up to it: filling it is then admissible.
        self.stretch = np.clip(wanted, 1.0, _MOST_STRETCHED)
        self._is_short = np.append(wanted > _MOST_STRETCHED, np.zeros(len(self.limits), dtype=bool))
        self.is_searched = not self._is_short.any()
        """Whether the least slack separates each segment's two ends; an observer counts both as tight where it does not."""
        self.columns = np.zeros((region.n_actions, self._place.size))
        self.columns[self._place, np.arange(self._place.size)] = self._sign / self.stretch

    def _inside(self, j: int, places: Array) -> Array:
        """The different breakpoints of a coordinate that lie between its least and greatest value, sorted; of those that are
        nearly one the first is kept."""
        near = tolerances.FEASIBILITY
        known: list[float] = []
        for place in places[(places > self._least[j] + near) & (places < self._most[j] - near)]:
            if all(abs(place - each) > near for each in known):
                known.append(float(place))
        return np.sort(known)

    def _set_up(self, kinks: list[Array], size: int) -> None:
        """Columns: above the last breakpoint, below the first, between two, and coordinates without breakpoints."""
        kinked = [j for j in range(size) if kinks[j].size]
        plain = [j for j in range(size) if not kinks[j].size]
        between = [(j, k) for j in kinked for k in range(kinks[j].size - 1)]
        bounds = self._lower, self._upper
        rest = np.where(np.isfinite(bounds[0]), bounds[0], np.where(np.isfinite(bounds[1]), bounds[1], 0.0))
        rest = np.clip(rest, self._least, self._most)
        self.base = np.array([kinks[j][0] if kinks[j].size else rest[j] for j in range(size)])
        """The decision at which the variables are zero."""
        self._place = np.array([*kinked, *kinked, *(j for j, _ in between), *plain], dtype=np.int64)
        counts = (len(kinked), len(kinked), len(between), len(plain))
        self._kind = np.repeat([_UP, _DOWN, _BETWEEN, _PLAIN], counts)
        self._sign = np.where(self._kind == _DOWN, -1.0, 1.0)
        starts = [kinks[j][-1] for j in kinked], self.base[kinked], [kinks[j][k] for j, k in between], self.base[plain]
        self._start = np.concatenate([np.asarray(each, dtype=np.float64) for each in starts])
        lengths = [kinks[j][k + 1] - kinks[j][k] for j, k in between]
        ends = self._upper[kinked] - self._start[: len(kinked)], self.base[kinked] - self._lower[kinked], lengths
        self._ends = np.concatenate([*(np.asarray(each) for each in ends), self._upper[plain] - self.base[plain]])

    def slopes(self, weights: Array, centers: Array) -> Array:
        """Return the slopes of Σ_j w_j |u_j − b_j| in the variables, shape (V,); a b_j of positive weight is a breakpoint."""
        is_first = (self._kind == _DOWN) | (self._kind == _PLAIN)
        lowest = np.where(is_first, self._least[self._place], self._start)
        above = lowest >= centers[self._place] - tolerances.FEASIBILITY
        return np.asarray(self._sign * np.where(above, 1.0, -1.0) * weights[self._place] / self.stretch)

    def _used(self, limit: MagnitudeLimit) -> Array:
        """The slopes of a limit in the variables, shape (V,)."""
        kinked = [self.slopes(*pair) for pair in zip(limit.weights, limit.centers, strict=True)]
        return np.asarray(sum(kinked) + np.broadcast_to(limit.linear, self.base.size) @ self.columns)

    def hessians(self, hessians: Array) -> Array:
        """Return the curvatures (X,V,V) of costs with curvatures (X,U,U); strictly convex where these are."""
        lifted = self.columns.T @ hessians @ self.columns
        first, second = self._pairs
        product = self._sign[first] * self._sign[second] / (self.stretch[first] * self.stretch[second])
        lifted[:, first, second] -= _least_curvature(hessians)[:, None] * product
        lifted[:, second, first] = lifted[:, first, second]
        return self._with_rooms(self._with_rooms(lifted).transpose(0, 2, 1))

    def linear(self, slopes: Array, hessians: Array) -> Array:
        """Return the linear costs (X,V) of costs with slopes (X,U) at the base and curvatures (X,U,U)."""
        lifted = slopes @ self.columns
        first, second = self._pairs
        later = self._kind[first] == _BETWEEN  # of two additions the second starts when the first is full
        extra = np.zeros(self._place.size)
        np.add.at(extra, second[later], self._ends[first[later]] / self.stretch[second[later]])
        return self._with_rooms(lifted + _least_curvature(hessians)[:, None] * extra)

    @property
    def _pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """Variables of one coordinate, each pair once: (taken away, any other), (filled, filled later), (filled, added)."""
        rank = np.array([2, 0, 1, 3])[self._kind]
        order = np.lexsort((np.arange(rank.size), rank, self._place))
        pairs: list[tuple[int, int]] = []
        for at, k in enumerate(order):
            after = at + 1
            while after < order.size and self._place[order[after]] == self._place[k]:
                pairs.append((int(k), int(order[after])))
                after += 1
        found = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        return found[:, 0], found[:, 1]

    def _with_rooms(self, values: Array) -> Array:
        """Values (…,V) with a zero for the slack of each limit."""
        return np.concatenate([values, np.zeros((*values.shape[:-1], len(self.limits)))], axis=-1)

    def feasible(self) -> Polyhedron:
        """Return the feasible variables: bounds on each, the rows that combine coordinates, and the limits."""
        region, names = self.region, self._names()
        wide = np.count_nonzero(region.A_ub, axis=1) > 1
        n = len(region.b_ub)
        lower = np.where(self._kind == _PLAIN, self._lower[self._place] - self.base[self._place], 0.0)
        lower = np.concatenate([lower, np.zeros(len(self.limits))])
        upper = np.concatenate([self._ends * self.stretch, np.full(len(self.limits), np.inf)])
        unit = np.eye(lower.size)
        low, high = np.isfinite(lower), np.isfinite(upper)
        used = np.array([self._used(limit) for limit in self.limits])
        rooms = [limit.most - limit.used(self.base) for limit in self.limits]
        sums = np.hstack([used.reshape(len(self.limits), self._place.size), np.eye(len(self.limits))])
        found = Polyhedron(
            np.vstack([self._with_rooms(region.A_ub[wide] @ self.columns), -unit[low], unit[high]]),
            np.concatenate([region.b_ub[wide] - region.A_ub[wide] @ self.base, -lower[low], upper[high]]),
            np.vstack([self._with_rooms(region.A_eq @ self.columns), sums]),
            np.concatenate([region.b_eq - region.A_eq @ self.base, rooms]),
            names=[
                *np.array(region.names[:n], dtype=object)[wide],
                *(names[0][k] for k in np.flatnonzero(low)),
                *(names[1][k] for k in np.flatnonzero(high)),
                *region.names[n:],
                *(f"{limit.name}, in full" for limit in self.limits),
            ],
            min_slack=region.min_slack,
        )
        short = np.flatnonzero(self._is_short)
        ends = np.cumsum(low)[short], low.sum() + np.cumsum(high)[short]
        found.short_ranges = np.column_stack(ends) + np.count_nonzero(wide) - 1
        return found

    @property
    def inner_names(self) -> frozenset[str]:
        """The names of rows of `feasible` that are no rows of the decision: breakpoints, and the definition of each limit."""
        low, high = self._names()
        inner = [low[k] for k in np.flatnonzero(self._kind != _PLAIN)]
        inner += [high[k] for k in np.flatnonzero(self._kind == _BETWEEN)]
        return frozenset([*inner, *(f"{limit.name}, in full" for limit in self.limits)])

    def _names(self) -> tuple[list[str], list[str]]:
        """The meaning of a variable at its lower and at its upper bound, for the decision."""
        labels = [f"u[{j}]" for j in range(self.region.n_actions)]
        if self.region.asset_names is not None:
            labels = [str(name) for name in self.region.asset_names]
        low, high = [], []
        for kind, j, start, end in zip(self._kind, self._place, self._start, self._ends, strict=True):
            stop = start + end if kind != _DOWN else start - end
            signs = (">=", "<=") if kind == _PLAIN else ("not below", "not above")
            signs = signs[::-1] if kind in (_UP, _BETWEEN) else signs
            value = self._lower[j] if kind == _PLAIN else start
            low.append(f"{labels[j]} {signs[0]} {value:g}")
            high.append(f"{labels[j]} {'>=' if kind == _DOWN else '<='} {stop:g}")
        return [*low, *(limit.name for limit in self.limits)], [*high, *("" for _ in self.limits)]

    def variables(self, points: Array) -> Array:
        """Return the variables (…,V) of decisions (…,U), segments filled in order."""
        moved = self._sign * (points[..., self._place] - self._start)
        filled = np.where(self._kind == _PLAIN, moved, np.maximum(moved, 0.0))
        filled = np.where(self._kind == _BETWEEN, np.minimum(filled, self._ends), filled) * self.stretch
        rooms = [limit.most - limit.used(points) for limit in self.limits]
        return np.concatenate([filled, *(room[..., None] for room in rooms)], axis=-1)

    def decisions(self, variables: Array) -> Array:
        """Return the decisions (…,U) of variables (…,V), exactly on a bound where they differ from it by rounding."""
        actions = self.base + variables[..., : self._place.size] @ self.columns.T
        for limit in (self._lower, self._upper):
            actions = np.where(np.abs(actions - limit) <= tolerances.SAME_ACTION, limit, actions)
        return np.asarray(actions)


def _reach(region: Polyhedron) -> tuple[Array, Array]:
    """Least and greatest value (U,) of each coordinate by its bounds, and by each equality with the others' bounds."""
    lower, upper = region.coordinate_bounds
    least, most = lower.copy(), upper.copy()
    for row, side in zip(region.A_eq, region.b_eq, strict=True):
        used = np.flatnonzero(row)
        terms = np.sort(row[used] * np.array([lower[used], upper[used]]), axis=0)
        others = np.where(np.eye(used.size, dtype=bool), 0.0, terms[::-1, None]).sum(axis=2)
        ends = np.sort((side - others) / row[used], axis=0)
        least[used], most[used] = np.maximum(least[used], ends[0]), np.minimum(most[used], ends[1])
    return least, most


def _least_curvature(hessians: Array) -> Array:
    return np.asarray(np.maximum(np.linalg.eigvalsh(hessians)[:, 0], 0.0))
