"""A set of beliefs: a polytope on the simplex that is usually a point or a segment, and may be empty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, Names
from inscrutable.errors import InputError, SolverError
from inscrutable.geometry.hulls import affine_hulls, described_sets, members_of_sets, sum_zero_basis
from inscrutable.geometry.polytopes import (
    MOST_LISTED,
    Reduced,
    nearest_in_hull,
    nearest_point,
    reduce_polytope,
    sample_polytope,
)
from inscrutable.linear_programmes import Rows, minimum
from inscrutable.saved import Saved
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class BeliefSet(Saved):
    r"""The beliefs π on the simplex with P π = 0 and Q π ≥ 0, where each row is scaled to the gradient's size.

    Formula: {π ≥ 0 : Σπ = 1, |P π| ≤ tolerance, Q π ≥ −tolerance}.

    Args:
        equalities: P, shape (k, X), dimensionless.
        inequalities: Q, shape (m, X), dimensionless.
        tolerance: Largest residual of a belief that counts as a member. Up to 1e-9 the equalities hold exactly in every
            direction that they determine; above it the set has width in all directions.
        gap: Function of a margin that returns the plausibility gap; a gap above the margin need not be exact.
        state_names: Labels of the states, with which labelled beliefs are aligned; None where there are none.

    Every query costs one small factorisation at first use, and its result is stored. Source: Theorem 1 of the paper.

    Example:
        >>> half = BeliefSet(np.array([[1.0, -1.0, 0.0]]), np.zeros((0, 3)))
        >>> half.dimension
        1
        >>> print(np.sort(half.vertices(), axis=0))
        [[0.  0.  0. ]
         [0.5 0.5 1. ]]
    """

    _derived: ClassVar[tuple[str, ...]] = ("plausibility_gap",)  # the function of it is not saved

    equalities: Array
    inequalities: Array
    tolerance: float = tolerances.EXPLAINED
    gap: Callable[[float], float] | None = field(default=None, repr=False, metadata={"saved": False})
    state_names: Names | None = None

    def __str__(self) -> str:
        if self.is_empty:
            return f"no belief over {self.n_states} states"
        kind = {0: "one belief", 1: "a segment of beliefs"}.get(
            self.dimension, f"beliefs of dimension {self.dimension}"
        )
        names = self.state_names or [f"state {i}" for i in range(self.n_states)]
        ends = [(f"{low:.3f}", f"{high:.3f}") for low, high in self.bounds()]
        shares = ", ".join(
            f"{name} {low}" if low == high else f"{name} {low} to {high}"
            for name, (low, high) in zip(names, ends, strict=True)
        )
        return f"{kind}: {shares}"

    def __post_init__(self) -> None:
        for name in ("equalities", "inequalities"):
            object.__setattr__(self, name, validation.finite_array(getattr(self, name), name, ndim=2))
        if self.equalities.shape[1] != self.inequalities.shape[1]:
            raise InputError(
                f"equalities have {self.equalities.shape[1]} columns, inequalities {self.inequalities.shape[1]}: "
                "expected one per state in both"
            )

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return int(self.equalities.shape[1])

    @property
    def _is_loose(self) -> bool:
        """Whether members may miss the rows by more than counts as zero, so that no equality determines a coordinate."""
        return self.tolerance > tolerances.ON_FACE

    @cached_property
    def _shape(self) -> Reduced | None:
        if self._is_loose:
            return self._within_tolerance()
        dimensions, ends = described_sets(self.equalities[None], self.inequalities[None], self.tolerance)
        dimension = int(dimensions[0])
        if dimension < 0:
            return None
        if dimension <= 1:
            return _between(ends[0, 0], ends[0, 1])
        verdict, _ = members_of_sets(self.equalities[None], self.inequalities[None], self.tolerance)
        if verdict[0] < 0:
            return None
        hulls = affine_hulls(self.equalities[None], self.tolerance)
        origin, directions = hulls.origin[0], hulls.directions[0, :dimension]
        bands = hulls.bands(self.tolerance)[0, :dimension]
        bounded = np.vstack([self.inequalities, np.eye(self.n_states)])
        rows = -bounded @ directions.T
        offsets = bounded @ origin
        for axis in np.flatnonzero(np.isfinite(bands[:, 0])):
            unit = np.eye(dimension)[axis]
            rows = np.vstack([rows, unit, -unit])
            offsets = np.concatenate([offsets, [bands[axis, 1], -bands[axis, 0]]])
        return reduce_polytope(origin, directions, rows, offsets, solid=bool(verdict[0] > 0))

    def _within_tolerance(self) -> Reduced | None:
        """Return {π ∈ Δ : |P π| ≤ tolerance, Q π ≥ −tolerance} from its rows."""
        origin, directions = np.full(self.n_states, 1.0 / self.n_states), sum_zero_basis(self.n_states).T
        limited = np.vstack([self.equalities, -self.equalities, -self.inequalities])
        rows = np.vstack([limited, -np.eye(self.n_states)])
        most = np.concatenate([np.full(len(limited), self.tolerance), np.zeros(self.n_states)])
        return reduce_polytope(origin, directions, rows @ directions.T, most - rows @ origin)

    @cached_property
    def _even_corners(self) -> Array:
        """Return the corners (V,X) computed in separate units per state where costs differ by decades; otherwise none.

        P π = 0 and Q π ≥ 0 are (P/d)(d π) = 0 and (Q/d)(d π) ≥ 0: the rounding of large costs then does not hide a state of
        small costs.
        """
        sizes = np.abs(np.vstack([self.equalities, self.inequalities])).max(axis=0, initial=0.0)
        units = np.where(sizes > tolerances.ON_FACE, sizes, sizes.max(initial=0.0))
        if (
            self._is_loose
            or self.n_states - 1 > MOST_LISTED
            or (units >= tolerances.UNEVEN * units.max(initial=0.0)).all()
        ):
            return np.zeros((0, self.n_states))
        corners = BeliefSet(self.equalities / units, self.inequalities / units, self.tolerance).vertices() / units
        return np.asarray(corners / corners.sum(axis=1, keepdims=True))

    @property
    def is_empty(self) -> bool:
        """Whether no belief explains the decision; a status, not an error."""
        return self._shape is None

    @property
    def dimension(self) -> int:
        """Dimension of the set: 0 a point, 1 a segment, …, and −1 for the empty set."""
        return -1 if self._shape is None else int(self._shape.directions.shape[0])

    @cached_property
    def residual(self) -> float:
        """Smallest KKT residual over all beliefs: largest coordinate, relative to the gradient's scale."""
        if self._shape is not None and not self._is_loose:
            return float(self.violation(self._shape.interior_point))
        return smallest_violation(self.equalities, self.inequalities)

    @cached_property
    def plausibility_gap(self) -> float:
        """Smallest regret r(u) = min_π ρ(π, u) over all beliefs, in the cost's unit; zero where the set is not empty."""
        if self._shape is not None or self.gap is None:
            return 0.0 if self._shape is not None else float("nan")
        return self.gap(np.inf)

    def gap_reaches(self, margin: float) -> bool:
        """Return whether the plausibility gap is at least `margin`, in the cost's unit; stops as soon as that is known."""
        if self._shape is not None or self.gap is None:
            return self.plausibility_gap >= margin
        return self.gap(margin) >= margin

    def violation(self, belief: ArrayLike) -> Array:
        """Return the KKT residual of one belief (X,) or many (T,X).

        It is the largest coordinate of the gradient's least-squares residual over the multipliers, or of a multiplier of wrong
        sign, relative to the scale.
        """
        points = validation.points(belief, self.n_states, Axis("state", self.state_names), "belief")
        parts = [np.abs(points @ self.equalities.T), -(points @ self.inequalities.T), -points]
        return np.asarray(np.concatenate(parts, axis=-1).max(axis=-1, initial=0.0))

    def point(self, belief: ArrayLike, name: str = "belief") -> Array:
        """Return one belief (X,) in the order of the states' labels, or raise `InputError`."""
        return validation.one_belief(belief, self.n_states, name, names=self.state_names)

    def holds_another(self, belief: ArrayLike) -> bool:
        """Return whether a belief other than this one explains the decision."""
        point = self.point(belief)
        if self.dimension > 1:
            return True
        corners = self.vertices()
        return bool(len(corners) and np.abs(corners - point).max() > tolerances.SAME_BELIEF)

    def contains(self, belief: ArrayLike) -> bool:
        """Return whether the belief explains the decision up to the tolerance."""
        point = self.point(belief)
        return bool(self.violation(point) <= self.tolerance)

    def nearest(self, belief: ArrayLike) -> Array:
        """Return the member nearest to `belief` (X,); NaN where the set is empty."""
        point = self.point(belief)
        if self._shape is None:
            return np.full(self.n_states, np.nan)
        if self.violation(point) <= self.tolerance:
            return point
        if not len(self._even_corners):
            return nearest_point(self._shape, point)
        found = nearest_in_hull(self._even_corners, point)
        try:
            other = nearest_point(self._shape, point)
        except SolverError:
            return found
        # Rounding may cut off a part of the set in either unit, but not the same part.
        return other if np.linalg.norm(other - point) < np.linalg.norm(found - point) else found

    def distance(self, belief: ArrayLike) -> float:
        """Return min over members of the Euclidean distance to `belief` (X,); infinite where the set is empty."""
        point = self.point(belief)
        if self._shape is None:
            return float("inf")
        return float(np.linalg.norm(point - self.nearest(point)))

    def vertices(self) -> Array:
        """Return the corners, shape (V, X); V = 0 where the set is empty."""
        return np.zeros((0, self.n_states)) if self._shape is None else np.maximum(self._shape.vertices, 0.0)

    def bounds(self) -> Array:
        """Return the least and greatest probability of each state over the set, shape (X, 2); NaN where it is empty."""
        if self._shape is None:
            return np.full((self.n_states, 2), np.nan)
        if self.dimension > MOST_LISTED:
            return np.maximum(self._shape.bounds(), 0.0)
        corners = self.vertices()
        return np.column_stack([corners.min(axis=0), corners.max(axis=0)])

    def center(self) -> Array:
        """Return the mean of the corners, shape (X,); NaN where the set is empty.

        For a set of more than nine dimensions, which has too many corners to list, it is the `interior_point`.
        """
        if self._shape is None or self.dimension > MOST_LISTED:
            return self.interior_point()
        return np.asarray(self.vertices().mean(axis=0))

    def interior_point(self) -> Array:
        """Return a member (X,) in the relative interior, by at most one linear programme; NaN where the set is empty.

        It needs no corners, which are numerous for many states.
        """
        if self._shape is None:
            return np.full(self.n_states, np.nan)
        return np.maximum(self._shape.interior_point, 0.0)

    def sample(self, n: int, *, rng: np.random.Generator) -> Array:
        """Return `n` members drawn uniformly, shape (n, X); raises `InputError` where the set is empty."""
        if self._shape is None:
            raise InputError("cannot sample an empty belief set: no belief explains the decision (see is_empty)")
        drawn = sample_polytope(self._shape, validation.count(n, "n"), validation.generator(rng))
        return np.maximum(drawn, 0.0)


def _between(start: Array, end: Array) -> Reduced:
    length = float(np.linalg.norm(end - start))
    if length <= tolerances.SAME_BELIEF:
        return Reduced(start, np.zeros((0, start.size)), np.zeros((0, 0)), np.zeros(0), start[None])
    direction = ((end - start) / length)[None]
    return Reduced(start, direction, np.array([[1.0], [-1.0]]), np.array([length, 0.0]), np.vstack([start, end]))


def smallest_violation(equalities: Array, inequalities: Array) -> float:
    """Return the least max-norm residual of the rows over the simplex, by linear programming."""
    n_states = equalities.shape[1]
    rows = np.vstack([equalities, -equalities, -inequalities])
    answer = minimum(
        np.concatenate([np.zeros(n_states), [1.0]]),
        Rows(np.column_stack([rows, -np.ones(rows.shape[0])]), np.zeros(rows.shape[0])),
        Rows(np.concatenate([np.ones(n_states), [0.0]])[None], np.ones(1)),
        (0, None),
    )
    return answer.value
