"""From the best candidate to the best decision: climbs on the faces the candidates lie on, and on their neighbours.

A face fixes the tight rows. Where its consistent sets are single beliefs, the decision is searched through its decoy;
where they are larger, along lines of decisions, the set's distance being judged at every trial. Of two states the whole
line of beliefs is known, and nothing is left to search where every belief has one decision.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.search.atlas import Atlas
from inscrutable.decision_makers.search.face_starts import WELL_COVERED, FaceStart, Starts, entry, flipped, set_distance
from inscrutable.decision_makers.search.faces import FaceProgramme
from inscrutable.decision_makers.search.line import Line, Place, best_places, line_of
from inscrutable.decision_makers.search.set_faces import SetFaceSearch
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.kernels.climb import Aim, Rules, climb
from inscrutable.kernels.faces import settle
from inscrutable.kernels.set_distance import cost_at, nearest_belief
from inscrutable.validation import Array

_ROUNDS = 30
_LINE_ROUNDS = 30
_PATIENCE = 3
"""Faces whose neighbours are searched in vain before the search ends, where there are more than three states."""
_MOST_FREED = 3
"""Tight rows that are freed, one at a time, where a set is larger than a point."""


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


@cache
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
        # A copy for every number of states: kernels would be compiled anew for one that is read-only.
        np.array(sum_zero_basis(n_states), order="C"),
    )


def within(aim: Aim) -> Aim:
    """Return the aim with a budget that the climbs' rounding cannot break."""
    return aim._replace(limit=aim.limit * (1.0 - tolerances.BUDGET_SAFETY))


def most_private(atlas: Atlas, aim: Aim, optimal: Array) -> Found | None:
    """Return the best decision reached from the most promising faces and their neighbours; `optimal` is u*(π)."""
    if not aim.limit > 0.0:
        return None
    search = _Search(atlas, within(aim))
    line = line_of(atlas)
    if line is not None and search.look_along(line) and line.is_complete:
        return search.best
    for start in Starts(atlas, search.aim, search.rules, optimal)():
        search.improve(start)
    search.improve_neighbours()
    return search.best


class _Search:
    def __init__(self, atlas: Atlas, aim: Aim) -> None:
        self.atlas, self.aim = atlas, aim
        self.n_states = aim.belief.size
        self.rules = rules_for(self.n_states)
        self.best: Found | None = None
        self.reached: dict[bytes, Found] = {}

    def improve(self, start: FaceStart) -> None:
        """Search the start's face from there, unless it promises less than is found."""
        if self.best is not None and start.promise <= self.best.privacy + tolerances.POLISH:
            return
        found = self._search(self.atlas.faces(start.tight), start)
        if found is None:
            return
        if self.best is None or found.privacy > self.best.privacy:
            self.best = found
        key = start.tight.tobytes()
        if key not in self.reached or found.privacy > self.reached[key].privacy:
            self.reached[key] = found

    def look_along(self, line: Line) -> bool:
        """Take the best of the line's places; returns whether every one of them could be judged."""
        places = best_places(line, self.atlas, self.aim, self.rules.pivot)
        found = [self._at(place) for place in places]
        self.best = max((each for each in found if each is not None), key=lambda each: each.privacy, default=None)
        return bool(found) and None not in found

    def _at(self, place: Place) -> Found | None:
        """The decision at a place, or as little inside its stretch as rounding asks for."""
        face, aim = self.atlas.faces(place.tight), self.aim
        k = len(face.place)
        w, factor, room = np.empty(k + 1), np.empty((k, k)), np.empty((2, self.n_states, k))
        slacks = face.rows[face.n_set_rows :, 0]
        for inward in (0.0, tolerances.SAME_BELIEF):
            decoy = place.decoy + inward * (place.inside - place.decoy)
            if not settle(face.curves, decoy, self.rules.pivot, w, factor, room[0], room[1]):
                w = face.w(self.atlas.problem.solve(decoy))  # copies of an asset leave a choice
            regret = float(cost_at(face.curves, aim.belief, w)) - aim.optimal_cost
            if regret > aim.limit * (1.0 + self.rules.near) or (slacks @ w).min(initial=0.0) < -self.rules.near:
                continue
            found = self._judged(face, w)
            if found is not None:
                return found
        return None

    def _judged(self, face: FaceProgramme, w: Array) -> Found | None:
        """The decision at w (k+1,) with its nearest consistent belief; None where no belief explains it."""
        nearest, set_rows = np.empty(self.n_states), face.rows[: face.n_set_rows]
        active = np.empty(len(w) - 1 + len(set_rows), dtype=np.bool_)
        distance = nearest_belief(face.curves, set_rows, face.scale, w, self.aim.point, self.rules, nearest, active)
        return Found(face, w[:-1], nearest, self.aim.sign * float(distance) + 0.0) if distance < np.inf else None

    def _search(self, face: FaceProgramme, start: FaceStart) -> Found | None:
        k, n = len(face.place), self.n_states - 1
        w, y = np.empty(k + 1), start.decoy.copy()
        if k >= n:
            loss = climb(face.curves, face.rows, self.aim, self.rules, y, w, _ROUNDS)
            if not loss < np.inf:
                return None
            # Where the costs of states are alike, more than the decoy explains the decision.
            return self._judged(face, w)
        if not self._place(face, start, w):
            return None
        search = SetFaceSearch(face, self.aim, self.rules)
        best = search.improve(w, y, _LINE_ROUNDS)
        return Found(face, search.place[:-1], search.nearest, float(best) + 0.0) if best > -np.inf else None

    def _place(self, face: FaceProgramme, start: FaceStart, w: Array) -> bool:
        """Fill the wished decision in the face's coordinates: the nearest to the start's own, else its decoy's."""
        if start.action is not None:
            w[:] = face.w(start.action)
            return True
        k = len(w) - 1
        factor, room = np.empty((k, k)), np.empty((2, self.n_states, k))
        return bool(settle(face.curves, start.decoy, self.rules.pivot, w, factor, room[0], room[1]))

    def improve_neighbours(self) -> None:
        """Search the faces that differ in a few rows from the best ones reached, as long as that helps."""
        tried: set[bytes] = set()
        patience = _PATIENCE if self.n_states > WELL_COVERED else 1
        left = patience
        while left and self.reached:
            chosen = max(self.reached.values(), key=lambda found: found.privacy)
            del self.reached[chosen.face.tight.tobytes()]
            before = self.best
            tried.add(chosen.face.tight.tobytes())
            for row in self._neighbours(chosen):
                other = flipped(chosen.face.tight, row)
                if other.tobytes() not in tried:
                    tried.add(other.tobytes())
                    self.improve(FaceStart(other, self._entry(chosen, int(row)), chosen.action, np.inf))
            left = left - 1 if self.best is before else patience

    def _entry(self, found: Found, row: int) -> Array:
        """The decoy from which the face beyond a row is searched."""
        face = found.face
        if not face.tight[row] or len(face.place) >= self.n_states - 1:
            return found.nearest
        r = int(np.searchsorted(face.told, row))
        return entry(face, r, np.append(found.place, 1.0), self.aim, self.rules, found.nearest)

    def _neighbours(self, found: Found) -> np.ndarray:
        """Rows beyond which a face is searched: the tight ones without multiplier, the loose ones without slack."""
        face, tight = found.face, found.face.tight
        w = np.append(found.place, 1.0)
        slacks = face.rows[face.n_set_rows :, 0] @ w
        loose = np.flatnonzero(~tight)[slacks <= tolerances.ROW_IN_REACH]
        is_point = len(face.place) >= self.n_states - 1
        many = self.n_states > WELL_COVERED
        if not face.has_row_multipliers or not (is_point or many):
            return np.concatenate([face.told, loose])
        if is_point:
            multipliers = face.multipliers(w, found.nearest)
            rows = face.told[multipliers <= tolerances.ROW_IN_REACH]
        else:
            rows = self._worth_freeing(found)
        return np.concatenate([rows, loose])

    def _worth_freeing(self, found: Found) -> np.ndarray:
        """The tight rows that shrink the set to its farthest members when they are freed: those without multiplier."""
        face, m = found.face, found.face.n_set_rows
        rows = np.concatenate([face.rows[:m], face.rows[:1]])
        values, w = np.empty(m - self.n_states), np.append(found.place, 1.0)
        for r in range(len(values)):
            np.negative(rows[self.n_states + r], out=rows[m])
            distance = set_distance(face, rows, w, self.aim, self.rules)
            values[r] = self.aim.sign * distance if distance < np.inf else -np.inf
        order = np.argsort(-values, kind="stable")[:_MOST_FREED]
        return np.asarray(face.told[order[values[order] > -np.inf]])
