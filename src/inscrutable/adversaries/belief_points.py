"""Beliefs written as mixtures of the finitely many beliefs for which a mechanism is known."""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import Delaunay, QhullError, cKDTree

from inscrutable import tolerances
from inscrutable.validation import Array

_MOST_TRIANGULATED = 4
"""Most states for which a triangulation is built; its size grows too fast beyond."""


class PointMixture(NamedTuple):
    """Beliefs as mixtures of points: π ≈ Σ_k shares_k points[places_k]."""

    places: np.ndarray  # (N, k)
    shares: Array  # (N, k)
    errors: Array  # (N,): Σ_k shares_k ‖π − points[places_k]‖


class BeliefPoints:
    """Points of the simplex (B,X) that represent any belief: a mixture of the corners of its cell, or the nearest point."""

    def __init__(self, points: Array, *, linear: bool = True) -> None:
        self.points = points
        self.linear = linear
        self._tree = cKDTree(points)

    def __len__(self) -> int:
        return len(self.points)

    def mixed(self, beliefs: Array) -> PointMixture:
        """Return beliefs (N,X) as mixtures: a point represents itself, the nearest point a belief outside every cell."""
        gaps, nearest = self._tree.query(beliefs)
        width = beliefs.shape[1]
        places = np.repeat(np.asarray(nearest, dtype=np.int64)[:, None], width, axis=1)
        shares = np.zeros((len(beliefs), width))
        shares[:, 0] = 1.0
        errors = np.where(gaps <= tolerances.SAME_BELIEF, 0.0, gaps)
        between = np.flatnonzero(errors > 0)
        if self.linear and between.size and self._cells is not None:
            self._mix(beliefs, between, places, shares)
            apart = np.linalg.norm(self.points[places[between]] - beliefs[between, None], axis=2)
            errors[between] = (apart * shares[between]).sum(axis=1)
        return PointMixture(places, shares, errors)

    @cached_property
    def _cells(self) -> Any:
        """Return a triangulation of the points (on a line, the sorted points); None where they span no volume."""
        n_states = self.points.shape[1]
        if n_states == 2 and len(self) > 1:
            return np.argsort(self.points[:, 0])
        if not 2 < n_states <= _MOST_TRIANGULATED or len(self) < n_states:
            return None
        try:
            return Delaunay(self.points[:, :-1])
        except QhullError:
            return None

    def _mix(self, beliefs: Array, rows: np.ndarray, places: np.ndarray, shares: Array) -> None:
        if isinstance(self._cells, np.ndarray):
            order, held = self._cells, beliefs[rows, 0]
            line = self.points[order, 0]
            right = np.searchsorted(line, held)
            inside = (right > 0) & (right < len(line))
            rows, right, held = rows[inside], right[inside], held[inside]
            upper = (held - line[right - 1]) / (line[right] - line[right - 1])
            places[rows] = np.column_stack([order[right - 1], order[right]])
            shares[rows] = np.column_stack([1.0 - upper, upper])
            return
        flat = beliefs[rows, :-1]
        cell = self._cells.find_simplex(flat)
        # Flat cells of a degenerate triangulation have no inverse.
        usable = (cell >= 0) & np.isfinite(self._cells.transform[cell]).all(axis=(1, 2))
        rows, flat, cell = rows[usable], flat[usable], cell[usable]
        affine = self._cells.transform[cell]
        first = np.einsum("nij,nj->ni", affine[:, :-1], flat - affine[:, -1])
        mixed = np.maximum(np.column_stack([first, 1.0 - first.sum(axis=1)]), 0.0)
        places[rows] = self._cells.simplices[cell]
        shares[rows] = mixed / mixed.sum(axis=1, keepdims=True)
