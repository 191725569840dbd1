"""Privacies of decisions that are optimal for the same beliefs: the exact frontier of a piecewise linear optimal cost.

The consistent set of a decision is a face of the cells of V. Of the decisions optimal at a corner w, a mixture of all has the
smallest consistent set: the face at w on which the same decisions are tied. Its regret may be arbitrarily close to the least
one of them. So for the largest distance from a belief, one point (regret, distance) per corner gives all suprema. A corner
whose least regret is exactly the budget can be left out: on the segment from the belief to the nearest consistent belief,
cheaper decisions are tied. For the least distance to a target the decisions of whole cells are best.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.envelope import RatedPoints, concave_envelope
from inscrutable.decision_makers.proofs.face_programmes import FaceProgrammes
from inscrutable.decision_makers.proofs.subdivision import Subdivision
from inscrutable.geometry.polytopes import nearest_in_hull
from inscrutable.privacy.measures import Reference
from inscrutable.validation import Array


class Supremum(NamedTuple):
    """An upper bound of every decision's privacy, and the places whose decisions come near it, the best first."""

    value: float
    places: list[int]


class TiedValues(RatedPoints):
    """Regrets and privacies of the decisions that are tied at every corner, or optimal on every cell, under one belief."""

    def __init__(self, cells: Subdivision, faces: FaceProgrammes | None, belief: Array, reference: Reference) -> None:
        self.cells = cells
        self.faces = faces
        self.reference = reference
        costs = cells.costs @ belief
        self._rounding = tolerances.SHARED_DECISION * cells.scale
        self._noise = cells.rounding
        self._alone = np.maximum(costs - costs.min(), 0.0)
        self._border = cells.on_border
        self._tight: dict[int, np.ndarray | None] = {}
        if reference.sign > 0:
            self.regrets = np.where(cells.tied, self._alone, np.inf).min(axis=1)
            self.privacies = np.linalg.norm(cells.corners - reference.point, axis=1)
        else:
            self.regrets = self._alone
            self.privacies = np.zeros(len(costs))
        self.exact = np.zeros(len(self.regrets), dtype=np.bool_)

    def refine(self, place: int) -> None:
        """Make the privacy of a place exact; until then it is an upper bound."""
        if not self.exact[place]:
            self.privacies[place] = min(self.privacies[place], self._privacy(place))
            self.exact[place] = True

    def affordable(self, limit: float) -> Iterator[int]:
        """Yield the places of a regret below `limit`, their privacies exact and falling."""
        rounding = -self._rounding if self.reference.sign > 0 else self._rounding
        if limit > 0:  # with a budget of 0 only regrets of 0 are affordable, up to rounding
            rounding += self._noise
        return self.falling(float(np.nextafter(limit + rounding, -np.inf)))

    def single(self, limit: float) -> float:
        """Return the supremum over single decisions of a regret of at most `limit`."""
        first = next(self.affordable(limit), None)
        # With a budget of 0 only decisions that are optimal for the true belief too.
        return 0.0 if first is None else float(self.privacies[first])

    def lottery(self, limit: float) -> Supremum:
        """Return the supremum over lotteries of an expected regret of at most `limit`."""
        if limit <= self._rounding:
            return Supremum(self.single(limit), [])
        hull = self.settled(concave_envelope)
        mixture = self.mixture(limit)
        assert mixture is not None  # the optimal decision costs nothing
        used = mixture.indices.tolist()
        others = [place for place in hull.tolist() if place not in used]
        return Supremum(float(mixture.probabilities @ self.privacies[mixture.indices]), used + others)

    def tight(self, place: int) -> np.ndarray | None:
        """Return the rows that are tight at all decisions that are optimal at a corner; None where they cannot be
        determined."""
        assert self.faces is not None
        if place not in self._tight:
            known = self.cells.actions[self.cells.tied[place]]
            at_border = self._border[place]
            corner = self.cells.corners[place]
            self._tight[place] = self.faces.optimal_at(corner, known) if at_border else self.faces.tight_on(known)
        return self._tight[place]

    def _privacy(self, place: int) -> float:
        cells, point = self.cells, self.reference.point
        if self.reference.sign < 0:
            # A lower bound: the corners may be more than the members.
            return -nearest(cells.corners[cells.tied[:, place]], point)[1]
        tied = cells.tied[place]
        away = float(np.linalg.norm(cells.corners[place] - point))
        if self._border[place]:
            tight = None if self.faces is None else self.tight(place)
            if self.faces is None or tight is None:
                return away
            if not np.array_equal(tight, self.faces.tight_on(cells.actions[tied])):
                explained = self.faces.explained(tight)
                return away if explained.is_empty else min(away, explained.distance(point))
        together = np.array(cells.members[:, tied].all(axis=1))
        together[place] = True
        return nearest(cells.corners[together], point)[0]


def nearest(corners: Array, point: Array) -> tuple[float, float]:
    """Return bounds of the distance from a point (X,) to the hull of corners (n,X), from above and from below."""
    offsets = corners - point
    if len(offsets) == 1:
        away = float(np.linalg.norm(offsets[0]))
        return away, away
    found = nearest_in_hull(corners, point) - point
    above = float(np.linalg.norm(found))
    if above <= tolerances.SAME_BELIEF:
        return above, 0.0
    return above, max(float((offsets @ found).min()) / above, 0.0)
