"""The decisions to choose from, with state costs and consistent sets, computed once per problem: the paper's {ū^(l)}."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries import ConsistentSets, consistent_sets
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.geometry.equal_rows import first_equal
from inscrutable.geometry.hulls import LARGER
from inscrutable.geometry.low_discrepancy import covering_radius
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_MOST_KEPT = 4096
_BLOCK = 8192
_MEGABYTE = 1_000_000

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Candidates:
    """Decisions with their state costs and what an observer infers from them; neither depends on the agent's belief.

    Args:
        actions: Decisions, shape (M,U).
        state_costs: c(i, u_l), shape (M,X), in the cost's unit.
        decoys: The beliefs that the decisions are optimal for, shape (M,X), or None where they are not known.
        problem: The decision problem, from which `sets` are found when first asked for.
        usable: Which decisions are feasible and admissible, shape (M,).
        n_outside: How many decisions lie outside the feasible set; they are never chosen.
        decided: The latest searches from these candidates, which decision makers share.

    Many decoys may have the same optimal decision, above all where few assets are held. `distinct` are the first candidates
    of every decision; `same_as` gives for every candidate the one of these with its decision.

    Source: the paper, Assumption 1.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem, decoy_grid
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2) / 100, np.eye(2) / 100], 1.0)
        >>> candidates = decoy_grid(problem, 10)
        >>> print(candidates.actions[candidates.distinct, 0], candidates.same_as)
        [0.  0.5 1. ] [0 0 0 0 0 5 6 6 6 6 6]
    """

    actions: Array
    state_costs: Array
    decoys: Array | None
    problem: DecisionProblem
    usable: np.ndarray
    n_outside: int = 0
    decided: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        n_decisions, n_actions = self.actions.shape
        return (
            f"{n_decisions} candidate decisions of {n_actions} coordinates, {len(self.distinct)} distinct, {self.n_outside} "
            "outside the feasible set"
        )

    def __post_init__(self) -> None:
        validation.read_only(self, "actions", "state_costs", "decoys", "usable")

    def __len__(self) -> int:
        return int(self.actions.shape[0])

    @cached_property
    def sets(self) -> ConsistentSets:
        """The consistent beliefs of every decision, described when first asked for: a search needs them, solves do not."""
        return consistent_sets(self.problem, self.actions, self.decoys)

    @cached_property
    def same_as(self) -> np.ndarray:
        """Index of the first candidate with the same decision, shape (M,): its own for the first of a kind.

        Decisions are the same where every coordinate rounds to the same multiple of `tolerances.SAME_ACTION`.
        """
        return first_equal(self.actions)

    @cached_property
    def distinct(self) -> np.ndarray:
        """Indices of the distinct decisions among the candidates, the first of each, rising, shape (D,)."""
        return np.flatnonzero(self.same_as == np.arange(len(self)))

    @cached_property
    def covering_radius(self) -> float:
        """About the largest distance from a belief to the nearest decoy, from 512 beliefs; infinite without decoys."""
        return np.inf if self.decoys is None else covering_radius(self.decoys)

    @property
    def memory(self) -> int:
        """Bytes held by the candidates' arrays and consistent sets, each counted once, without what searches keep."""
        held = [getattr(part, each.name) for part in (self, self.sets) for each in fields(part)]
        return sum({id(array): array.nbytes for array in held if isinstance(array, np.ndarray)}.values())

    def once(self, key: Hashable, search: Callable[[], T]) -> T:
        """Return the stored result of `search` for this key, or search and store it; results unused longest are dropped."""
        found: T | None = self.decided.pop(key, None)
        if found is None:
            found = search()
            if len(self.decided) >= _MOST_KEPT:
                self.decided.pop(next(iter(list(self.decided))), None)  # a copy: another thread may add one
        self.decided[key] = found  # last: the least recently used comes first
        return found

    def joined(self, other: Candidates) -> Candidates:
        """Return these candidates followed by others of the same problem; decoys are kept where both have them."""
        both = self.decoys is not None and other.decoys is not None
        joined = Candidates(
            np.vstack([self.actions, other.actions]),
            np.vstack([self.state_costs, other.state_costs]),
            np.vstack([self.decoys, other.decoys]) if both else None,  # type: ignore[list-item]
            self.problem,
            np.concatenate([self.usable, other.usable]),
            self.n_outside + other.n_outside,
        )
        # Sets that are known are reused, also those found with decoys that the joined candidates do not keep.
        vars(joined)["sets"] = self.sets.joined(other.sets)
        return joined

    def summary(self) -> str:
        """Return one line: how many decisions, distinct, usable, explained, outside; their memory; how near a decoy is."""
        explained = int(np.count_nonzero(self.sets.dimension[self.usable] >= 0))
        near = "" if self.decoys is None else f"; every belief within about {self.covering_radius:.2g} of a decoy"
        return (
            f"{len(self)} candidates ({len(self.distinct)} distinct, {self.memory / _MEGABYTE:.1f} MB): "
            f"{int(self.usable.sum())} admissible, {explained} of them explained by a belief, "
            f"{self.n_outside} outside the feasible set{near}"
        )


def make_candidates(problem: DecisionProblem, actions: ArrayLike, decoys: Array | None = None) -> Candidates:
    """Return candidates for decisions (M,U); those outside the feasible set are kept, counted and never chosen."""
    given = problem.as_points(actions) if problem.is_discrete else actions
    axes = (None, Axis("asset", problem.asset_names))
    points = validation.finite_array(given, "candidate actions", ndim=2, axes=axes)
    if points.shape[1] != problem.n_actions or not len(points):
        raise InputError(f"candidate actions have shape {points.shape}, expected (M, {problem.n_actions}) with M >= 1")
    return known_candidates(problem, points, decoys)


def known_candidates(problem: DecisionProblem, points: Array, decoys: Array | None) -> Candidates:
    """Return candidates for decisions (M,U) that are numbers of the right shape."""
    region = problem.constraints
    usable = np.empty(len(points), dtype=np.bool_)
    costs = np.empty((len(points), problem.n_states))
    n_outside = 0
    for first in range(0, len(points), _BLOCK):
        block = slice(first, first + _BLOCK)
        usable[block] = problem.is_admissible(points[block])
        costs[block] = problem.state_costs(points[block])
        doubtful = points[block][~usable[block]]
        n_outside += int(np.count_nonzero(region.violation(doubtful) > tolerances.FEASIBILITY))
    return Candidates(points, costs, decoys, problem, usable, n_outside)


class Distinct(NamedTuple):
    """Admissible decisions, one of each kind, by rising number among the candidates."""

    number: np.ndarray  # (D,) which candidate each one is
    costs: Array  # (D,X) state costs
    start: Array  # (D,X) of the consistent set: a point, a segment's end, or a member
    along: Array  # (D,X) end − start
    kind: np.ndarray  # (D,) −1 nothing explains it, 0 a point, 1 a segment, 2 a larger set

    def pick(self, which: np.ndarray) -> Distinct:
        """Return some of them."""
        return Distinct(*(part[which] for part in self))


def distinct_of(candidates: Candidates) -> Distinct:
    """Return the distinct admissible candidates, found at first use and kept with them."""
    return candidates.once("distinct", lambda: _found(candidates))


def _found(candidates: Candidates) -> Distinct:
    sets = candidates.sets
    usable = np.flatnonzero(candidates.usable)
    first = np.full(len(candidates), -1)
    first[sets.distinct[usable][::-1]] = usable[::-1]  # of equal decisions the first one is written last
    number = np.sort(first[first >= 0])
    costs, start, end = (np.ascontiguousarray(each[number]) for each in (candidates.state_costs, sets.start, sets.end))
    kind = np.minimum(sets.dimension[number], LARGER).astype(np.int64)
    return Distinct(number, costs, start, end - start, kind)
