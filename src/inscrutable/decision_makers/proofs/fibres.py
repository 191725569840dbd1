"""Cells of beliefs in which no belief is the nearest that explains its decision, for costs that give their curvature.

The privacy of a decision is the distance of its nearest consistent belief. Where a decision has fewer free coordinates than a
belief, its consistent beliefs form a polytope, the *fibre* over the decision, which runs through many cells; only cells that
may hold its nearest point matter. A cell cannot hold one if, for every decision optimal in it and every belief there, some
direction along the fibre leads nearer to the true belief. One direction is proposed for a cell; the distance of each decision's
own direction from it is at most the residual in the decision's equations over their least singular value.
"""

from __future__ import annotations

from itertools import chain, combinations
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.proofs.smooth_cells import Nearness, SmoothCells, complement
from inscrutable.geometry.simplicial import directions_to
from inscrutable.validation import Array

_MOST_UNSURE = 3
"""Most rows whose state, tight or slack, is open. With none, three more of 24 proofs over two to four states stay open, and one
takes 36 times the calls; with one and with nine none differs by more than four calls."""


class _Cells(NamedTuple):
    """Cells with the same rows that are tight for sure, and that may be."""

    corners: np.ndarray  # (C,X)
    drift: Array  # (C,) how far all states' gradients can be from the interpolated ones


class Fibres:
    """Finds cells that cannot hold the nearest consistent belief of any decision."""

    def __init__(self, cells: SmoothCells) -> None:
        self.cells = cells
        self._free: dict[bytes, Array | None] = {}

    def passes(self, corners: np.ndarray, near: Nearness) -> np.ndarray:
        """Return for cells (C,X) whether no fibre has its nearest point there; False where that is not proved."""
        found = np.zeros(len(corners), dtype=np.bool_)
        known = self.cells.known
        n_states, n_free = self.cells.problem.n_states, self.cells.form.basis.shape[1]
        met = known.slacks[corners].min(axis=1) <= near.near[:, None] + tolerances.FEASIBILITY
        # With too few active rows one belief alone explains a decision.
        known_well = np.isfinite(near.near + near.sum + near.gradients)
        hopeful = np.flatnonzero((met.sum(axis=1) > n_free - n_states + 1) & known_well)
        sure = np.zeros_like(met)
        for pattern, at in _groups(met[hopeful], hopeful):
            if self._basis(pattern) is not None:
                sure[np.ix_(at, pattern)] = self._positive(pattern, corners[at], near.sum[at])
        hopeful = hopeful[sure[hopeful].sum(axis=1) > n_free - n_states + 1]
        for pattern, at in _groups(np.concatenate([met, sure], axis=1)[hopeful], hopeful):
            possible, held = np.split(pattern, 2)
            unsure = np.flatnonzero(possible & ~held)
            if len(unsure) > _MOST_UNSURE:
                continue
            left = at
            for extra in chain.from_iterable(combinations(unsure, size) for size in range(len(unsure) + 1)):
                tight = held.copy()
                tight[list(extra)] = True
                left = left[
                    self._leads_nearer(
                        tight, np.array(extra, dtype=np.intp), _Cells(corners[left], near.gradients[left])
                    )
                ]
                if not left.size:
                    break
            found[left] = True
        return found

    def distances(self, index: np.ndarray) -> Array:
        """Upper bounds (N,) of the distance to the consistent beliefs of points' decisions: one step along each fibre."""
        known, points = self.cells.known, self.cells.points
        beliefs = points.beliefs[index]
        found = np.linalg.norm(beliefs - points.belief, axis=1)
        for tight, at in _groups(known.slacks[index] <= tolerances.FEASIBILITY, np.arange(len(index))):
            free = self._basis(tight)
            if free is None or free.shape[1] >= points.belief.size - 1:
                continue
            held, gradients = beliefs[at], known.gradients[index[at]]
            system, _ = _systems((gradients @ free)[:, None])
            along = np.linalg.svd(system[:, 0], full_matrices=True)[2][:, free.shape[1] + 1 :]
            way = np.einsum("nkx,nk->nx", along, np.einsum("nkx,nx->nk", along, points.belief - held))
            rows = -np.einsum("rf,nxf->nrx", self.cells.pseudo(tight), gradients)
            have = np.concatenate([held, np.einsum("nrx,nx->nr", rows, held)], axis=1)
            falls = -np.concatenate([way, np.einsum("nrx,nx->nr", rows, way)], axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                room = np.where(falls > 0.0, np.maximum(have, 0.0) / falls, 1.0)
            found[at] = np.linalg.norm(
                held + np.clip(room.min(axis=1), 0.0, 1.0)[:, None] * way - points.belief, axis=1
            )
        return np.asarray(found)

    def _basis(self, tight: np.ndarray) -> Array | None:
        """Directions (F,f) that keep the rows `tight`; None where these depend on each other."""
        key = tight.tobytes()
        if key not in self._free:
            free = complement(self.cells.form.rows[tight], self.cells.form.basis.shape[1])
            independent = free.shape[1] == self.cells.form.basis.shape[1] - int(tight.sum())
            self._free[key] = free if independent else None
        return self._free[key]

    def _positive(self, pattern: np.ndarray, corners: np.ndarray, moved: Array) -> np.ndarray:
        """Which of the rows that may be tight have positive multipliers all over cells: (C,r)."""
        known, pseudo = self.cells.known, self.cells.pseudo(pattern)
        slopes = np.einsum("cjx,cjxf->cjf", self.cells.points.beliefs[corners], known.gradients[corners])
        least = (-slopes @ pseudo.T).min(axis=1)
        return np.asarray(least > moved[:, None] * np.linalg.norm(pseudo, axis=1) + tolerances.FEASIBILITY)

    def _leads_nearer(self, tight: np.ndarray, unsure: np.ndarray, cells: _Cells) -> np.ndarray:
        """For which cells a direction leads nearer wherever exactly the rows `tight` are tight."""
        known, points = self.cells.known, self.cells.points
        n_states, free = points.belief.size, self._basis(tight)
        if free is None or free.shape[1] >= n_states - 1:
            return np.zeros(len(cells.drift), dtype=np.bool_)
        beliefs, gradients = points.beliefs[cells.corners], known.gradients[cells.corners]
        system, scale = _systems(gradients @ free)
        middle = system.mean(axis=1)
        _, sizes, right = np.linalg.svd(middle, full_matrices=True)
        along = right[:, free.shape[1] + 1 :]  # (C, X-1-f, X)
        pseudo = self.cells.pseudo(tight)[np.searchsorted(np.flatnonzero(tight), unsure)]
        bounds = -np.einsum("rf,cjxf->cjrx", pseudo, gradients)  # rows whose product with a belief is a multiplier
        direction = _proposed(points.belief, beliefs, along, bounds)
        drift = scale * cells.drift
        off = np.linalg.norm(np.einsum("cjkx,cx->cjk", system, direction), axis=2).max(axis=1) + drift
        spread = np.linalg.norm(system - middle[:, None], axis=(2, 3)).max(axis=1)
        regular = sizes[:, -1] - spread - drift
        good = (regular > 0.0) & (np.linalg.norm(direction, axis=1) > 0.5)
        turned = off / np.where(good, regular, 1.0) + tolerances.FEASIBILITY
        away = beliefs - points.belief
        rises = np.einsum("cjx,cx->cj", away, direction) + np.linalg.norm(away, axis=2) * turned[:, None]
        good &= (rises < 0.0).all(axis=1)
        at_border = beliefs.min(axis=1) <= tolerances.FEASIBILITY
        good &= (~at_border | (direction >= turned[:, None])).all(axis=1)
        if unsure.size:
            wide = np.linalg.norm(pseudo, axis=1) * cells.drift[:, None]
            steep = np.linalg.norm(bounds, axis=3).max(axis=1) + wide
            falls = np.einsum("cjrx,cx->cjr", bounds, direction).min(axis=1)
            good &= (falls >= steep * turned[:, None] + wide).all(axis=1)
        return np.asarray(good)


def _groups(patterns: np.ndarray, index: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Equal rows (C,R) together, each with its members of `index` (C,)."""
    if not len(patterns):
        return []
    distinct, which = np.unique(patterns, axis=0, return_inverse=True)
    return [(pattern, index[which.ravel() == number]) for number, pattern in enumerate(distinct)]


def _systems(gradients: Array) -> tuple[Array, Array]:
    """Equations (C,J,f+1,X) of the consistent beliefs of the corners' decisions, and the scale (C,) of the first f."""
    equations = gradients.transpose(0, 1, 3, 2)
    sizes = np.linalg.norm(equations, axis=(2, 3)).mean(axis=1)
    scale = np.where(sizes > 0.0, 1.0 / np.where(sizes > 0.0, sizes, 1.0), 0.0)
    ones = np.ones((*equations.shape[:2], 1, equations.shape[3]))
    return np.concatenate([scale[:, None, None, None] * equations, ones], axis=2), scale


def _proposed(belief: Array, beliefs: Array, along: Array, bounds: Array) -> Array:
    """Unit directions (C,X) in the spans of `along` that lead to the belief, off the simplex's border and the bounds."""
    n_states = belief.size
    toward = belief - beliefs.mean(axis=1)
    border = np.broadcast_to(np.eye(n_states), (len(beliefs), n_states, n_states))
    at_border = beliefs.min(axis=1) <= tolerances.FEASIBILITY
    wishes = np.concatenate([toward[:, None], bounds.mean(axis=1), border], axis=1) @ along.transpose(0, 2, 1)
    wishes /= np.maximum(np.linalg.norm(wishes, axis=2, keepdims=True), tolerances.TINY)
    # Unused entries repeat the first one.
    wishes[:, -n_states:] = np.where(at_border[:, :, None], wishes[:, -n_states:], wishes[:, :1])
    return np.asarray(np.einsum("ck,ckx->cx", directions_to(np.zeros(along.shape[1]), wishes), along))
