"""Inverse optimisation of many decisions at once: points and segments in bulk, larger sets on demand."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import reduce

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.inverse import belief_set_of, scaled_gradients, smooth_form_of
from inscrutable.errors import SolverError
from inscrutable.geometry import BeliefSet
from inscrutable.geometry.equal_rows import distinct_patterns, first_equal
from inscrutable.geometry.hulls import LARGER, described_sets, members_of_sets
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class ConsistentSets:
    """The consistent beliefs of M decisions.

    Dimension −1 is the empty set, 0 a point, 1 the segment from `start` to `end`, 2 a set of two or more dimensions with the
    member `start`.
    """

    problem: DecisionProblem
    actions: Array  # (M, U)
    dimension: np.ndarray  # (M,)
    start: Array  # (M, X)
    end: Array  # (M, X)
    distinct: np.ndarray  # (M,): the first decision equal to this one
    _larger: dict[int, BeliefSet] = field(default_factory=dict, repr=False)
    _parts: tuple[ConsistentSets, ...] = field(default=(), repr=False)

    def __len__(self) -> int:
        return int(self.actions.shape[0])

    def __getitem__(self, index: int) -> BeliefSet:
        """Return the belief set of one decision; equal decisions share it."""
        first = int(self.distinct[index])
        if self._parts:  # the parts store computed sets, so that other joins can use them
            before, behind = self._parts
            return before[first] if first < len(before) else behind[first - len(before)]
        if first not in self._larger:
            self._larger[first] = belief_set_of(self.problem, self.actions[first])
        return self._larger[first]

    def joined(self, other: ConsistentSets) -> ConsistentSets:
        """Return these sets followed by others of the same problem; equal decisions of the two are not merged."""
        shift = len(self)
        return ConsistentSets(
            self.problem,
            np.vstack([self.actions, other.actions]),
            np.concatenate([self.dimension, other.dimension]),
            np.vstack([self.start, other.start]),
            np.vstack([self.end, other.end]),
            np.concatenate([self.distinct, other.distinct + shift]),
            _parts=(self, other),
        )

    def distances(self, belief: Array) -> Array:
        """Return the distance from `belief` (X,) to every set, shape (M,); infinite for empty ones."""
        distances = self.bounds(belief)
        larger = np.flatnonzero(self.dimension >= 2)
        for first in np.unique(self.distinct[larger]):
            distances[larger[self.distinct[larger] == first]] = self[int(first)].distance(belief)
        return distances

    def apart(self, beliefs: Array) -> Array:
        """Return the largest |z_i − π_i| of the ends z of every set from one belief (X,), or from one each (M,X)."""
        columns = (np.abs(end[:, i] - beliefs[..., i]) for end in (self.start, self.end) for i in range(end.shape[1]))
        return np.asarray(reduce(np.maximum, columns))

    def bounds(self, belief: Array) -> Array:
        """Return upper bounds of the distances: exact for points and segments, the distance to one member for larger sets."""
        along = self.end - self.start
        length = (along**2).sum(axis=1)
        toward = belief - self.start
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(length > 0, np.clip((toward * along).sum(axis=1) / length, 0.0, 1.0), 0.0)
        distances = np.linalg.norm(toward - share[:, None] * along, axis=1)
        return np.where(self.dimension < 0, np.inf, distances)


def describable(problem: DecisionProblem, actions: Array) -> np.ndarray:
    """Return which decisions (M,U) have a consistent set that can be described, shape (M,): where very many rows meet, the
    cone of their multipliers has too many facets."""
    if not len(actions) or problem.explaining_rows(actions[0]) is not None:
        return np.ones(len(actions), dtype=bool)
    form = smooth_form_of(problem)
    patterns, which = distinct_patterns(form.constraints.tight_rows(form.variables(actions)))
    can = np.ones(len(patterns), dtype=bool)
    for number, pattern in enumerate(patterns):
        try:
            form.constraints.stationarity(pattern)
        except SolverError:
            can[number] = False
    return np.asarray(can[which])


def consistent_sets(problem: DecisionProblem, actions: Array, members: Array | None = None) -> ConsistentSets:
    """Return the consistent sets of decisions (M,U); decisions with the same active constraints are solved together.

    `members` (M,X) are beliefs known to explain the decisions, such as their decoys. They serve as the members of sets of
    dimension two or more; without them a projection finds a member, or a proof that there is none. These larger sets are
    computed on demand. Cost: one small singular value decomposition per decision, in bulk, and one projection per larger set
    without a known member.
    """
    if not len(actions):
        nothing = np.zeros((0, problem.n_states))
        return ConsistentSets(problem, actions, np.zeros(0, dtype=int), nothing, nothing, np.zeros(0, dtype=int))
    if type(problem).explaining_rows is not DecisionProblem.explaining_rows:
        by_rows = _by_rows(problem, actions, members)
        if by_rows is not None:
            return by_rows
    form = smooth_form_of(problem)
    region, points = form.constraints, form.variables(actions)
    count, n_states = actions.shape[0], problem.n_states
    dimension = np.full(count, -1)
    ends = np.zeros((count, 2, n_states))
    tight = region.tight_rows(points)
    patterns, pattern_of = distinct_patterns(tight)
    distinct = first_equal(actions)
    pending: dict[int, BeliefSet] = {}
    shaped: dict[tuple[int, ...], list[tuple[np.ndarray, Array, Array]]] = {}
    for number, pattern in enumerate(patterns):
        index = np.flatnonzero(pattern_of == number)
        rows = region.stationarity(pattern)
        scaled = scaled_gradients(form.gradients(points[index]), region.equality_span, form.size).transpose(0, 2, 1)
        systems = index, rows.equalities @ scaled, rows.inequalities @ scaled
        shaped.setdefault((len(rows.equalities), len(rows.inequalities)), []).append(systems)
    for parts in shaped.values():  # the systems of one size, whatever the pattern
        index, equalities, inequalities = (np.concatenate(part) for part in zip(*parts, strict=True))
        dimension[index], ends[index] = described_sets(equalities, inequalities, tolerances.EXPLAINED)
        larger = np.flatnonzero(dimension[index] >= LARGER)
        if not larger.size:
            continue
        unclear = larger[:0]
        if members is not None:
            dimension[index[larger]], ends[index[larger]] = LARGER, members[index[larger], None]
        else:
            verdict, found = members_of_sets(equalities[larger], inequalities[larger], tolerances.EXPLAINED)
            dimension[index[larger]] = np.where(verdict > 0, LARGER, -1)
            ends[index[larger]] = found[:, None]
            unclear = larger[verdict == 0]
        for i in index[unclear]:
            first = int(distinct[i])
            if first not in pending:
                pending[first] = belief_set_of(problem, actions[first])
            dimension[i], ends[i] = _described(pending[first])
    return ConsistentSets(problem, actions, dimension, ends[:, 0].copy(), ends[:, 1].copy(), distinct, pending)


def _by_rows(problem: DecisionProblem, actions: Array, members: Array | None) -> ConsistentSets | None:
    """Return the sets of decisions that are explained row by row, one at a time; on demand where members are known."""
    if problem.explaining_rows(actions[0]) is None:
        return None
    distinct, count = first_equal(actions), len(actions)
    if members is not None:
        return ConsistentSets(problem, actions, np.full(count, LARGER), members.copy(), members.copy(), distinct)
    found = {int(first): belief_set_of(problem, actions[first]) for first in np.unique(distinct)}
    known = {first: _known(each) for first, each in found.items()}
    dimension = np.array([known[int(first)][0] for first in distinct])
    ends = np.array([known[int(first)][1] for first in distinct])
    return ConsistentSets(problem, actions, dimension, ends[:, 0].copy(), ends[:, 1].copy(), distinct, dict(found))


def _known(found: BeliefSet) -> tuple[int, Array]:
    """Return the dimension (at most 2) and both ends (2,X), or a member twice; the full set is computed only where needed."""
    verdict, member = members_of_sets(found.equalities[None], found.inequalities[None], found.tolerance)
    if verdict[0]:
        return (LARGER if verdict[0] > 0 else -1), np.tile(member, (2, 1))
    return _described(found)


def _described(found: BeliefSet) -> tuple[int, Array]:
    """Return the same from the computed polytope."""
    dimension = min(found.dimension, LARGER)
    if dimension < 0:
        return dimension, np.zeros((2, found.n_states))
    return dimension, np.tile(found.interior_point(), (2, 1)) if dimension >= LARGER else found.vertices()[[0, -1]]
