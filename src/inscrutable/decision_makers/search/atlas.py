"""Candidates arranged for the search: distinct, plausible, admissible, by face and in leaves of neighbouring decoys."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.search.faces import FaceProgramme, face_programme
from inscrutable.geometry.equal_rows import distinct_patterns
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.kernels.lotteries import Arena
from inscrutable.kernels.search import LARGER, POINT, SEGMENT, Leaves, Table
from inscrutable.problems import DecisionProblem, QuadraticProblem, quadratic_problem
from inscrutable.validation import Array

_LEAF = 24
_AXES = 3
_MOST_FACES = 4096


class Faces:
    """The face programmes of a problem, made at first use and kept."""

    def __init__(self, problem: QuadraticProblem) -> None:
        self.problem = problem
        self._known: dict[bytes, FaceProgramme] = {}

    def __call__(self, tight: np.ndarray) -> FaceProgramme:
        """Return the programme of the face on which the inequality rows `tight` hold with equality."""
        key = tight.tobytes()
        found = self._known.get(key)
        if found is None:
            found = face_programme(self.problem, tight)
            if len(self._known) >= _MOST_FACES:
                self._known.pop(next(iter(self._known)))
            self._known[key] = found
        return found


class Scans(NamedTuple):
    """Arrays of an atlas in the order in which the lottery's search takes them."""

    table: tuple[Array, ...]
    leaves: tuple[Any, ...]
    models: tuple[Array, ...]


class Atlas:
    """The decisions among which a search chooses; `index` says which candidate each one is."""

    def __init__(self, problem: DecisionProblem, candidates: Candidates) -> None:
        form, quadratic = problem.quadratic_form(), quadratic_problem(problem)
        assert form is not None, "an atlas is of quadratic costs"
        assert quadratic is not None
        self.asked, self.form = problem, form
        self.problem = quadratic
        """The quadratic problem in the form's variables; these are what is called decisions here."""
        sets = candidates.sets
        first = sets.distinct == np.arange(len(candidates))
        variables = self.form.variables(candidates.actions)
        usable = candidates.usable
        if self.form.lift is not None:
            usable = usable & quadratic.constraints.is_admissible(variables)
        chosen = np.flatnonzero(first & usable & (sets.dimension >= 0))
        decoys = sets.start if candidates.decoys is None else candidates.decoys
        order, self._starts = _leaves(decoys[chosen])
        self.index = chosen[order]
        self.candidates = candidates
        self.faces = Faces(quadratic)
        self.actions = variables[self.index]
        tight = quadratic.constraints.tight_rows(self.actions)
        self.patterns, face = distinct_patterns(tight)
        start, end = sets.start[self.index], sets.end[self.index]
        dimension = sets.dimension[self.index]
        along = end - start
        self.table = Table(
            np.ascontiguousarray(candidates.state_costs[self.index]),
            np.ascontiguousarray(decoys[self.index]),
            np.ascontiguousarray(start),
            along,
            (along**2).sum(axis=1),
            np.select([dimension == 0, dimension == 1], [POINT, SEGMENT], LARGER).astype(np.int64),
            face.reshape(-1).astype(np.int64),
            np.ascontiguousarray(decoys[self.index] @ sum_zero_basis(problem.n_states)[:, :_AXES]),
        )

    def __len__(self) -> int:
        return len(self.index)

    def decisions(self, variables: Array) -> Array:
        """Return the decisions (…,U) of the problem that was asked for from those (…,V) of its form."""
        return self.form.decisions(variables)

    @cached_property
    def arena(self) -> Arena:
        """All face programmes, end to end."""
        return arena_of(self)

    @cached_property
    def scans(self) -> Scans:
        """The table and the leaves as the lottery's search reads them: decisions and leaves along the last axis."""
        table, leaves = self.table, self.leaves
        models = (leaves.centre.T, leaves.costs.T, leaves.excess.T, leaves.slope.transpose(1, 2, 0))
        return Scans(
            (table.costs, table.decoys, table.start, table.along, table.square, table.kind, *self._places()),
            (leaves.first, leaves.radius, leaves.reach),
            tuple(np.ascontiguousarray(model) for model in models),
        )

    def _places(self) -> tuple[np.ndarray, Array]:
        """Where the coordinates (v, 1) on their faces of the decisions with larger sets begin, and these end to end."""
        larger = np.flatnonzero(self.table.kind == LARGER)
        faces = [self.faces(tight) for tight in self.patterns[self.table.face[larger]]]
        sizes = np.array([face.span.shape[1] + 1 for face in faces], dtype=np.int64)
        begins = np.full(len(self), -1, dtype=np.int64)
        begins[larger] = np.cumsum(sizes) - sizes
        places = [face.w(self.actions[d]) for face, d in zip(faces, larger, strict=True)]
        return begins, np.concatenate([np.zeros(0), *places])

    @cached_property
    def leaves(self) -> Leaves:
        """The leaves and their bounds."""
        y, costs, starts = self.table.decoys, self.table.costs, self._starts
        n_leaves, n_states = len(starts) - 1, costs.shape[1]
        ends = (self.table.start, self.table.start + self.table.along)
        spread = np.maximum(*(np.linalg.norm(end - y, axis=1) for end in ends))
        spread = np.where(self.table.kind == LARGER, np.sqrt(2.0), spread)
        centre, middle, excess = (np.empty((n_leaves, n_states)) for _ in range(3))
        radius, reach = np.empty(n_leaves), np.empty(n_leaves)
        slope = np.empty((n_leaves, n_states, n_states))
        for leaf in range(n_leaves):
            part = slice(starts[leaf], starts[leaf + 1])
            centre[leaf], middle[leaf] = y[part].mean(axis=0), costs[part].mean(axis=0)
            away = y[part] - centre[leaf]
            radius[leaf] = np.linalg.norm(away, axis=1).max()
            reach[leaf] = spread[part].max()
            slope[leaf] = np.linalg.lstsq(away, costs[part] - middle[leaf], rcond=tolerances.LEAF_SLOPE)[0]
            excess[leaf] = np.maximum(middle[leaf] + away @ slope[leaf] - costs[part], 0.0).max(axis=0)
        return Leaves(starts, centre, radius, reach, middle, slope, excess)


def atlas_of(problem: DecisionProblem, candidates: Candidates) -> Atlas:
    """Return the atlas of candidates, made at first use and kept with them."""
    return candidates.once("atlas", lambda: Atlas(problem, candidates))


def arena_of(atlas: Atlas) -> Arena:
    """Return all face programmes of an atlas, end to end."""
    faces = [atlas.faces(tight) for tight in atlas.patterns]
    curve_sizes = np.array([face.curves.size for face in faces], dtype=np.int64)
    row_sizes = np.array([face.rows.size for face in faces], dtype=np.int64)
    return Arena(
        np.array([face.span.shape[1] for face in faces], dtype=np.int64),
        np.array([len(face.rows) for face in faces], dtype=np.int64),
        np.array([face.n_set_rows for face in faces], dtype=np.int64),
        np.array([face.scale for face in faces], dtype=np.float64),
        np.cumsum(curve_sizes) - curve_sizes,
        np.cumsum(row_sizes) - row_sizes,
        np.concatenate([np.zeros(0), *(face.curves.ravel() for face in faces)]),
        np.concatenate([np.zeros(0), *(face.rows.ravel() for face in faces)]),
    )


def _leaves(points: Array) -> tuple[np.ndarray, np.ndarray]:
    """Order the points so that leaves of near ones are contiguous: halves along the widest coordinate, again and again."""
    order = np.arange(len(points))
    starts = [0]
    pending = [(0, len(points))] if len(points) else []
    while pending:
        low, high = pending.pop()
        if high - low <= _LEAF:
            starts.append(high)
            continue
        part = points[order[low:high]]
        axis = int(np.ptp(part, axis=0).argmax())
        middle = (high - low) // 2
        order[low:high] = order[low:high][np.argsort(part[:, axis], kind="stable")]
        pending += [(low + middle, high), (low, low + middle)]
    return order, np.array(starts)
