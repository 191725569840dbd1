"""Where the climbs on faces begin: the best candidates, ends of the budget's edge, and edges of the optimal decision."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.search.atlas import Atlas
from inscrutable.decision_makers.search.edge_climbs import edge_decoys
from inscrutable.decision_makers.search.faces import FaceProgramme
from inscrutable.decision_makers.search.rays import farthest_decoys
from inscrutable.kernels.climb import Aim, Rules
from inscrutable.kernels.faces import settle
from inscrutable.kernels.search import LARGER, best_by_face
from inscrutable.kernels.set_distance import nearest_belief
from inscrutable.validation import Array

WELL_COVERED = 3
"""States up to which candidates on a grid, and rays where they are too few, find the starts; beyond, climbs along the
budget's edge do."""

_TINY = float(np.finfo(float).tiny)
_ORTHANTS = 8
_MOST_STARTS = 12
_MOST_JUDGED = 100
_FEW_AFFORDABLE = 100
"""With fewer affordable candidates than this a state, the grid is too coarse for the budget: rays find the starts."""
_PROMISE = 1.15
"""How much farther than its start a climb may come to rest; starts that promise less than is found are skipped."""
_SET_PROMISE = 1.5
"""The same where more than the decoy explains the decision: the search leaves the decoy."""
_ENTERING = 0.1
"""Largest multiplier, relative to the gradient, of a row that is freed where a climb along the edge ends."""


class FaceStart(NamedTuple):
    """A face and a place on it: a decoy, and the decision where it is not the decoy's own."""

    tight: np.ndarray
    decoy: Array
    action: Array | None
    promise: float


class Starts:
    """The starts for one aim; `optimal` is u*(π)."""

    def __init__(self, atlas: Atlas, aim: Aim, rules: Rules, optimal: Array) -> None:
        self.atlas, self.aim, self.rules, self.optimal = atlas, aim, rules, optimal
        self.region = atlas.problem.constraints
        self.n_states = aim.belief.size

    def __call__(self) -> list[FaceStart]:
        """Return all starts in the order in which they are to be searched."""
        affordable, candidates = self._candidates()
        tight = self.region.tight_rows(self.optimal)
        leaving = self._leaving(tight)
        if self.n_states > WELL_COVERED:
            return self._edge() + candidates + self._own_axes(tight) + leaving
        if affordable < _FEW_AFFORDABLE * self.n_states:
            return candidates + self._own_axes(tight) + self._rays() + leaving
        return candidates + leaving

    def _candidates(self) -> tuple[int, list[FaceStart]]:
        """How many candidates are affordable; and the best of every face and orthant."""
        aim, atlas = self.aim, self.atlas
        shape = (len(atlas.patterns), _ORTHANTS)
        best, which = np.empty(shape), np.empty(shape, dtype=np.int64)
        affordable = best_by_face(
            atlas.table, aim.belief, aim.point, aim.sign, aim.optimal_cost + aim.limit, self.rules.basis, best, which
        )
        faces, orthants = np.nonzero(which >= 0)
        values, chosen = best[faces, orthants], which[faces, orthants]
        order = np.argsort(-values, kind="stable")
        if self.n_states > WELL_COVERED:
            order = order[:_MOST_JUDGED]
            larger = order[atlas.table.kind[chosen[order]] == LARGER]
            values[larger] = [self._judged(int(d)) for d in chosen[larger]]
            order = order[np.argsort(-values[order], kind="stable")]
        starts = [self._from_candidate(int(faces[i]), int(chosen[i])) for i in order[:_MOST_STARTS]]
        return int(affordable), starts

    def _judged(self, d: int) -> float:
        """What a candidate is worth by its whole set."""
        face = self.atlas.faces(self.atlas.patterns[self.atlas.table.face[d]])
        rows, w = face.rows[: face.n_set_rows], face.w(self.atlas.actions[d])
        return self.aim.sign * set_distance(face, rows, w, self.aim, self.rules)

    def _from_candidate(self, face: int, d: int) -> FaceStart:
        decoy = self.atlas.table.decoys[d]
        return FaceStart(self.atlas.patterns[face], decoy, self.atlas.actions[d], self._promise(decoy, _PROMISE))

    def _promise(self, decoy: Array, factor: float) -> float:
        # Near a ray little is farther than its end; toward a target nothing is better than the target itself.
        return factor * float(np.linalg.norm(decoy - self.aim.point)) if self.aim.sign > 0 else 0.0

    def _own_axes(self, tight: np.ndarray) -> list[FaceStart]:
        """On the optimal decision's own face the affordable decoys form an ellipsoid, to second order: its axes' ends."""
        face, belief, basis = self.atlas.faces(tight), self.aim.belief, self.rules.basis
        k, n = len(face.place), basis.shape[1]
        if k < n or n == 0:
            return []
        w, factor = np.empty(k + 1), np.empty((k, k))
        gradients, slopes = np.empty((self.n_states, k)), np.empty((self.n_states, k))
        if not settle(face.curves, belief, self.rules.pivot, w, factor, gradients, slopes):
            return []
        bend, axes = np.linalg.eigh(basis.T @ slopes @ gradients.T @ basis)
        with np.errstate(over="ignore"):  # an axis along which no regret grows has no end
            length = np.sqrt(2.0 * self.aim.limit / np.maximum(bend, tolerances.DEFINITE * max(bend[-1], _TINY)))
        ends = []
        for c in range(n):
            for side in (1.0, -1.0):
                step = side * basis @ axes[:, c]
                with np.errstate(divide="ignore"):
                    room = np.where(step < 0, belief / np.maximum(-step, _TINY), np.inf).min()
                decoy = belief + min(length[c], 0.999 * room) * step
                ends.append(FaceStart(tight, decoy, None, np.inf if c == 0 else self._promise(decoy, _PROMISE)))
        return ends

    def _edge(self) -> list[FaceStart]:
        """Where climbs along the budget's edge end, and the faces that meet there."""
        table, problem = self.atlas.table, self.atlas.problem
        decoys = edge_decoys(problem, self.aim, table.decoys, table.costs)
        starts = self._from_ends(decoys, problem.solve(decoys))
        return [each for start in starts for each in (start, *self._entering(start))]

    def _entering(self, start: FaceStart) -> list[FaceStart]:
        """Where many beliefs share an edge's decision, the decoy is at a corner of their set: the rows whose multipliers
        end there are freed one after another, and the set shrinks toward the decoy at hardly any cost."""
        face = self.atlas.faces(start.tight)
        free = self.n_states - 1 - len(face.place)
        if start.action is None or self.aim.sign < 0 or free <= 0 or not face.has_row_multipliers:
            return []
        multipliers = face.multipliers(face.w(start.action), start.decoy)
        tight, found = start.tight, []
        for r in np.argsort(multipliers, kind="stable")[:free]:
            if multipliers[r] > _ENTERING:
                break
            tight = flipped(tight, face.told[r])
            found.append(start._replace(tight=tight))
        return found

    def _rays(self) -> list[FaceStart]:
        """The ends of what the budget affords on rays, the best first."""
        decoys, actions = farthest_decoys(self.atlas.problem, self.aim.belief, self.aim.limit)
        order = np.argsort(-self.aim.sign * np.linalg.norm(decoys - self.aim.point, axis=1), kind="stable")
        return self._from_ends(decoys[order], actions[order])

    def _from_ends(self, decoys: Array, actions: Array) -> list[FaceStart]:
        """One start for each face that the ends lie on and each orthant, in order."""
        slack = self.region.slacks(actions)
        # The face an observer sees; and, where rows are slack by less than the least, the one with those rows loose.
        seen = slack < self.region.observed_slack
        exact = slack <= tolerances.FEASIBILITY
        orthant = (decoys - self.aim.point) @ self.rules.basis > 0
        starts: list[FaceStart] = []
        known: set[tuple[bytes, bytes]] = set()
        for i in range(len(decoys)):
            for tight in (seen[i], exact[i]) if (seen[i] != exact[i]).any() else (seen[i],):
                key = (tight.tobytes(), orthant[i].tobytes())
                if key not in known and len(known) < _MOST_STARTS:
                    known.add(key)
                    many = self.n_states > WELL_COVERED and len(self.atlas.faces(tight).place) < self.n_states - 1
                    promise = self._promise(decoys[i], _SET_PROMISE if many else _PROMISE)
                    starts.append(FaceStart(tight, decoys[i], actions[i], promise))
        return starts

    def _leaving(self, tight: np.ndarray) -> list[FaceStart]:
        """Where many beliefs share the optimal decision, the edges on which another one begins: each tight row freed."""
        face = self.atlas.faces(tight)
        if len(face.place) >= self.n_states - 1:
            return []
        w = face.w(self.optimal)
        return [
            FaceStart(
                flipped(tight, row), entry(face, r, w, self.aim, self.rules, self.aim.belief), self.optimal, np.inf
            )
            for r, row in enumerate(face.told)
        ]


def set_distance(face: FaceProgramme, rows: Array, w: Array, aim: Aim, rules: Rules) -> float:
    """Return the distance from the aim's point to the beliefs that explain w (k+1,) under the rows; infinite if none."""
    nearest, active = np.empty(aim.point.size), np.empty(len(w) - 1 + len(rows), dtype=np.bool_)
    return float(nearest_belief(face.curves, rows, face.scale, w, aim.point, rules, nearest, active))


def entry(face: FaceProgramme, r: int, w: Array, aim: Aim, rules: Rules, otherwise: Array) -> Array:
    """Return the decoy from which the face with tight row number `r` freed is entered: the nearest belief to the aim's
    point that explains w (k+1,) with no multiplier on that row, and `otherwise` where there is none.

    Beyond that border of the set the decisions leave w; from a belief inside it a climb on the freed face would first have
    to find the border.
    """
    if not face.has_row_multipliers:
        return otherwise
    m, n_states = face.n_set_rows, aim.point.size
    rows = np.concatenate([face.rows[:m], -face.rows[None, n_states + r]])
    nearest, active = np.empty(n_states), np.empty(len(w) - 1 + len(rows), dtype=np.bool_)
    distance = nearest_belief(face.curves, rows, face.scale, w, aim.point, rules, nearest, active)
    return nearest if distance < np.inf else otherwise


def flipped(tight: np.ndarray, *rows: Any) -> np.ndarray:
    """Return the pattern with some rows tight that were loose, or loose that were tight."""
    other = tight.copy()
    for row in rows:
        other[row] = not tight[row]
    return other
