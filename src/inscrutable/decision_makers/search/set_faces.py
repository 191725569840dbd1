"""The best decision on a face whose consistent sets are larger than points.

Toward a point the best decision is found through its decoy, for the least distance to a set is the least distance to any
of its members. Away from a point the sets themselves are followed.
"""

from __future__ import annotations

import numpy as np

from inscrutable.decision_makers.search.faces import FaceProgramme
from inscrutable.kernels.climb import Aim, Rules, climb
from inscrutable.kernels.face_ascent import ascend
from inscrutable.kernels.face_sets import afford, look_around, walk_line
from inscrutable.kernels.set_distance import cost_at, nearest_belief
from inscrutable.validation import Array

_STEEP = 10.0
_STARTS = 2


class SetFaceSearch:
    """A search on one face: the best decision so far, the member of its set nearest to the aim's point, and its value."""

    def __init__(self, face: FaceProgramme, aim: Aim, rules: Rules) -> None:
        self.face, self.aim, self.rules = face, aim, rules
        self.set_rows = face.rows[: face.n_set_rows]
        self.place = np.zeros(face.span.shape[1] + 1)
        self.nearest = np.zeros(aim.point.size)
        self.value = -np.inf

    def improve(self, w: Array, decoy: Array, rounds: int) -> float:
        """Search from the decision w (k+1,), or a decoy where w is not explained; returns sign·distance less
        price·regret, −∞ where nothing allowed and explained is found."""
        face, aim, rules = self.face, self.aim, self.rules
        centre = self._start(w, decoy, rounds)
        k = len(w) - 1
        if not self.value > -np.inf or k == 0:
            return self.value
        if aim.sign < 0.0:
            trial, y = self.place.copy(), self.nearest.copy()
            if climb(face.curves, face.rows, aim, rules, y, trial, rounds) < np.inf:
                self._keep(trial)
        elif k == 1:
            trial = self.place.copy()
            walk_line(face.curves, face.rows, face.n_set_rows, face.scale, aim, rules, trial, self.value, rounds)
            self._keep(trial)
        else:
            self._ascend(centre, rounds)
        return self.value

    def _start(self, w: Array, decoy: Array, rounds: int) -> Array:
        """Move w to an admissible, affordable and explained decision, as near as can be; returns the cheapest one."""
        face, aim, rules = self.face, self.aim, self.rules
        trial, centre = w.copy(), w.copy()
        slacks = face.rows[face.n_set_rows :]
        if afford(face.curves, slacks, aim, rules.near, trial, centre) and self._keep(trial):
            return centre
        # No belief explains it: climb toward the true belief, where the budget ends at the latest.
        steep = aim.price if np.isinf(aim.limit) else max(_STEEP / aim.limit, aim.price)
        nearby = Aim(aim.belief, aim.belief, -1.0, aim.optimal_cost, np.inf, steep)
        y = decoy.copy()
        if climb(face.curves, face.rows, nearby, rules, y, trial, rounds) < np.inf:
            self._keep(trial)
        return centre

    def _ascend(self, centre: Array, rounds: int) -> None:
        face, aim, rules = self.face, self.aim, self.rules
        equations = face.curves[:, :-1].transpose(1, 0, 2) / face.scale
        held = np.concatenate([equations, face.rows])
        found = np.empty((_STARTS, len(centre)))
        n_found = look_around(
            face.curves, face.rows, face.n_set_rows, face.scale, aim, rules, centre, self.value, found
        )
        own, member = self.place.copy(), self.nearest.copy()
        for start in (*found[:n_found], own):
            trial, y = start.copy(), member.copy()
            # Where no belief explains the start, the climb moves it and the known member together.
            self._distance(trial, y)
            if ascend(face.curves, held, face.n_set_rows, face.scale, aim, rules, trial, y, rounds) > -np.inf:
                self._keep(trial)

    def _distance(self, w: Array, member: Array) -> float:
        face = self.face
        active = np.empty(len(w) - 1 + len(self.set_rows), dtype=np.bool_)
        return float(
            nearest_belief(face.curves, self.set_rows, face.scale, w, self.aim.point, self.rules, member, active)
        )

    def _keep(self, trial: Array) -> bool:
        """Take over an affordable trial that is better; returns whether a belief explains it."""
        member = np.empty(self.aim.point.size)
        distance = self._distance(trial, member)
        regret = float(cost_at(self.face.curves, self.aim.belief, trial)) - self.aim.optimal_cost
        # Where a line ends at the budget, rounding may end it a little beyond; the aim's budget leaves room for that.
        if not distance < np.inf or regret > self.aim.limit * (1.0 + self.rules.near):
            return False
        value = self.aim.sign * distance - (self.aim.price * regret if self.aim.price > 0.0 else 0.0)
        if value > self.value:
            self.place, self.nearest, self.value = trial.copy(), member, value
        return True
