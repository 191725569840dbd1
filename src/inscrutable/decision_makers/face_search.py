"""From the best candidate to the best decision: climbs on the faces the candidates lie on, and on their neighbours.

A face fixes the tight rows. Where its consistent sets are single beliefs, the decision is searched through its decoy;
where they are larger, along lines of decisions, the set's distance being judged at every trial.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.atlas import Atlas
from inscrutable.decision_makers.faces import FaceProgramme
from inscrutable.decision_makers.rays import farthest_decoys
from inscrutable.decision_makers.set_faces import SetFaceSearch
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.kernels.climb import Aim, Rules, climb
from inscrutable.kernels.faces import settle
from inscrutable.kernels.search import best_by_face
from inscrutable.kernels.set_distance import nearest_belief
from inscrutable.validation import Array

_TINY = float(np.finfo(float).tiny)
_ORTHANTS = 8
_MOST_STARTS = 12
_ROUNDS = 30
_LINE_ROUNDS = 30
_FEW_AFFORDABLE = 100
"""With fewer affordable candidates than this a state, the grid is too coarse for the budget: rays find the starts."""
_WELL_COVERED = 3
"""States up to which a grid that affords many decisions needs no further starts on the own face."""
_PROMISE = 1.15
"""How much farther than its start a climb may come to rest; starts that promise less than is found are skipped."""


class Found(NamedTuple):
    """A decision on a face, the consistent belief nearest to the aim's point, and the privacy."""

    face: FaceProgramme
    place: Array  # (k,) coordinates on the face
    nearest: Array  # (X,)
    privacy: float

    @property
    def action(self) -> Array:
        """The decision (U,); weights within rounding of a bound are put on it."""
        return self.face.action(self.place)


class _Start(NamedTuple):
    tight: np.ndarray
    decoy: Array
    action: Array | None
    promise: float


def rules_for(n_states: int) -> Rules:
    """Return the numbers that the kernels decide by."""
    return Rules(
        tolerances.PIVOT,
        tolerances.EXPLAINED,
        tolerances.POLISH**1.5,
        tolerances.RANK,
        tolerances.EXPLAINED,
        tolerances.ON_FACE,
        1.0 - tolerances.BUDGET_SAFETY,
        np.ascontiguousarray(sum_zero_basis(n_states)),
    )


def within(aim: Aim) -> Aim:
    """Return the aim with a budget that the climbs' rounding cannot break."""
    return aim._replace(limit=aim.limit * (1.0 - tolerances.BUDGET_SAFETY))


def most_private(atlas: Atlas, aim: Aim, optimal: Array) -> Found | None:
    """Return the best decision reached from the most promising faces and their neighbours; `optimal` is u*(π)."""
    if not aim.limit > 0.0:
        return None
    search = _Search(atlas, within(aim), optimal)
    for start in search.starts():
        search.improve(start)
    search.improve_neighbours()
    return search.best


class _Search:
    def __init__(self, atlas: Atlas, aim: Aim, optimal: Array) -> None:
        self.atlas, self.aim, self.optimal = atlas, aim, optimal
        self.region = atlas.problem.constraints
        self.n_states = aim.belief.size
        self.rules = rules_for(self.n_states)
        self.best: Found | None = None

    def starts(self) -> list[_Start]:
        """The best affordable candidates of every face and orthant, the ends of the own face's axes, and of rays."""
        aim, atlas = self.aim, self.atlas
        shape = (len(atlas.patterns), _ORTHANTS)
        best, which = np.empty(shape), np.empty(shape, dtype=np.int64)
        affordable = best_by_face(
            atlas.table, aim.belief, aim.point, aim.sign, aim.optimal_cost + aim.limit, self.rules.basis, best, which
        )
        faces, orthants = np.nonzero(which >= 0)
        order = np.argsort(-best[faces, orthants], kind="stable")[:_MOST_STARTS]
        found = [self._from_candidate(int(faces[i]), int(which[faces[i], orthants[i]])) for i in order]
        own = self.optimal
        tight = self.region.tight_rows(own)
        few = affordable < _FEW_AFFORDABLE * self.n_states
        if few or self.n_states > _WELL_COVERED:
            found += self._own_axes(tight)
        if few:
            found += self._rays()
        return found + self._leaving(own, tight)

    def _from_candidate(self, face: int, d: int) -> _Start:
        decoy = self.atlas.table.decoys[d]
        return _Start(self.atlas.patterns[face], decoy, self.atlas.actions[d], self._promise(decoy))

    def _promise(self, decoy: Array) -> float:
        # Near a ray little is farther than its end; toward a target nothing is better than the target itself.
        return _PROMISE * float(np.linalg.norm(decoy - self.aim.point)) if self.aim.sign > 0 else 0.0

    def _own_axes(self, tight: np.ndarray) -> list[_Start]:
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
        length = np.sqrt(2.0 * self.aim.limit / np.maximum(bend, tolerances.DEFINITE * max(bend[-1], _TINY)))
        ends = []
        for c in range(n):
            for side in (1.0, -1.0):
                step = side * basis @ axes[:, c]
                with np.errstate(divide="ignore"):
                    room = np.where(step < 0, belief / np.maximum(-step, _TINY), np.inf).min()
                decoy = belief + min(length[c], 0.999 * room) * step
                ends.append(_Start(tight, decoy, None, np.inf if c == 0 else self._promise(decoy)))
        return ends

    def _rays(self) -> list[_Start]:
        """The ends of what the budget affords, one start for each face that they lie on and each orthant."""
        decoys, actions = farthest_decoys(self.atlas.problem, self.aim.belief, self.aim.limit)
        length = self.aim.sign * np.linalg.norm(decoys - self.aim.point, axis=1)
        slack = self.region.slacks(actions)
        # The face an observer sees; and, where rows are slack by less than the least, the one with those rows loose.
        seen = slack < max(self.region.min_slack, tolerances.FEASIBILITY)
        exact = slack <= tolerances.FEASIBILITY
        orthant = (decoys - self.aim.point) @ self.rules.basis > 0
        starts: list[_Start] = []
        known: set[tuple[bytes, bytes]] = set()
        for i in np.argsort(-length, kind="stable"):
            for tight in (seen[i], exact[i]) if (seen[i] != exact[i]).any() else (seen[i],):
                key = (tight.tobytes(), orthant[i].tobytes())
                if key not in known and len(known) < _MOST_STARTS:
                    known.add(key)
                    starts.append(_Start(tight, decoys[i], actions[i], self._promise(decoys[i])))
        return starts

    def _leaving(self, own: Array, tight: np.ndarray) -> list[_Start]:
        """Where many beliefs share the optimal decision, the edges on which another one begins: each tight row freed."""
        if len(self.atlas.faces(tight).place) >= self.n_states - 1:
            return []
        return [_Start(_flipped(tight, row), self.aim.belief, own, np.inf) for row in np.flatnonzero(tight)]

    def improve(self, start: _Start) -> None:
        """Search the start's face from there, unless it promises less than is found."""
        if self.best is not None and start.promise <= self.best.privacy + tolerances.POLISH:
            return
        found = self._search(self.atlas.faces(start.tight), start)
        if found is not None and (self.best is None or found.privacy > self.best.privacy):
            self.best = found

    def _search(self, face: FaceProgramme, start: _Start) -> Found | None:
        k, n = len(face.place), self.n_states - 1
        w, y = np.empty(k + 1), start.decoy.copy()
        if k >= n:
            loss = climb(face.curves, face.rows, self.aim, self.rules, y, w, _ROUNDS)
            if not loss < np.inf:
                return None
            # Where the costs of states are alike, more than the decoy explains the decision.
            nearest, set_rows = np.empty(self.n_states), face.rows[: face.n_set_rows]
            active = np.empty(k + len(set_rows), dtype=np.bool_)
            distance = nearest_belief(face.curves, set_rows, face.scale, w, self.aim.point, self.rules, nearest, active)
            return Found(face, w[:-1], nearest, self.aim.sign * float(distance) + 0.0) if distance < np.inf else None
        if not self._place(face, start, w):
            return None
        search = SetFaceSearch(face, self.aim, self.rules)
        best = search.improve(w, y, _LINE_ROUNDS)
        return Found(face, search.place[:-1], search.nearest, float(best) + 0.0) if best > -np.inf else None

    def _place(self, face: FaceProgramme, start: _Start, w: Array) -> bool:
        """Fill the wished decision in the face's coordinates: the nearest to the start's own, else its decoy's."""
        if start.action is not None:
            w[:-1], w[-1] = face.span.T @ (start.action - face.origin), 1.0
            return True
        k = len(w) - 1
        factor, room = np.empty((k, k)), np.empty((2, self.n_states, k))
        return bool(settle(face.curves, start.decoy, self.rules.pivot, w, factor, room[0], room[1]))

    def improve_neighbours(self) -> None:
        """Search the faces that differ in one row from the best one's, as long as that helps."""
        tried: set[bytes] = set()
        while self.best is not None:
            before = self.best
            tried.add(before.face.tight.tobytes())
            for row in self._rows_in_reach(before):
                other = _flipped(before.face.tight, row)
                if other.tobytes() not in tried:
                    tried.add(other.tobytes())
                    self.improve(_Start(other, before.nearest, before.action, np.inf))
            if self.best is before:
                return

    def _rows_in_reach(self, found: Found) -> list[Any]:
        """Tight rows whose multiplier, and loose rows whose slack, has come down to nothing."""
        face, tight = found.face, found.face.tight
        w = np.append(found.place, 1.0)
        slacks = face.rows[face.n_set_rows :, 0] @ w
        loose = np.flatnonzero(~tight)[slacks <= tolerances.ROW_IN_REACH]
        if len(face.place) < self.n_states - 1 or face.n_set_rows - self.n_states != tight.sum():
            return [*np.flatnonzero(tight), *loose]
        multipliers = (face.rows[self.n_states : face.n_set_rows] @ w) @ found.nearest
        return [*np.flatnonzero(tight)[multipliers <= tolerances.ROW_IN_REACH], *loose]


def _flipped(tight: np.ndarray, row: Any) -> np.ndarray:
    other = tight.copy()
    other[row] = not tight[row]
    return other
