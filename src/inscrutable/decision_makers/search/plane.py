"""Candidates of a problem with three states, arranged in the plane of beliefs for the lottery's search."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.decoys import decided_by
from inscrutable.decision_makers.search.atlas import Atlas
from inscrutable.decision_makers.search.seams import seam_decoys
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.kernels.faces import settle
from inscrutable.kernels.lotteries import Arena
from inscrutable.kernels.options import whole
from inscrutable.kernels.search import LARGER, SEGMENT
from inscrutable.kernels.three_leaves import POLISHED, SLOTS, Plane
from inscrutable.kernels.three_states import Ground
from inscrutable.validation import Array

_LANES = 32
_MOST_POLYGONS = 8


def plane_of(atlas: Atlas) -> Plane | None:
    """Return the plane of an atlas, made at first use and kept with its candidates; None where `make_plane` makes none."""
    made: tuple[Plane | None] = atlas.candidates.once("plane", lambda: (make_plane(atlas),))
    return made[0]


def make_plane(atlas: Atlas) -> Plane | None:
    """Return the plane of an atlas for three states, with the decoys on its seams (named POLISHED: they are no candidates).

    None for other numbers of states, where many decisions have a polygon of beliefs, or large faces a segment, and where
    a belief has many decisions on a face: the plane knows decisions by their face and decoy.
    """
    if atlas.problem.n_states != 3:
        return None
    table, basis = atlas.table, sum_zero_basis(3)
    larger = np.flatnonzero(table.kind == LARGER)
    ours = np.flatnonzero(table.kind != LARGER)
    size = atlas.arena.size[table.face]
    if len(larger) > _MOST_POLYGONS or not len(ours) or np.any(size[larger] > 0):
        return None
    if np.any(size[table.kind == SEGMENT] > 1):
        # Two states that cost the same: beliefs are not told apart where the search takes them to be.
        return None
    if not _has_unique_decisions(atlas):
        return None
    found = _decisions(atlas, ours)
    z, ends = found.decoys @ basis, np.stack([found.start, found.start + found.along], axis=1) @ basis
    points, lines = _leaf_by_leaf(found, z)
    slots = np.concatenate([points, lines])
    square = (found.along**2).sum(axis=1)
    inverse = np.divide(1.0, square, out=np.zeros_like(square), where=square > 0.0)
    slots_of = np.column_stack([found.costs, ends[:, 0], ends[:, 1] - ends[:, 0], inverse])[slots]
    return Plane(
        np.ascontiguousarray(slots_of.reshape(-1, SLOTS, 8).swapaxes(1, 2)),
        np.ascontiguousarray(z[slots].T),
        found.face[slots],
        found.name[slots],
        _leaves(z[points], found.costs[points]),
        _bands(ends[lines], found.costs[lines]),
        whole(len(points) // SLOTS),
        np.array([_spacing(z[_filled(_order(z))])]),
        larger,
        np.ascontiguousarray(table.costs[larger].T),
        table.face[larger],
        np.ascontiguousarray((table.decoys[larger] @ basis).T),
        ground_of(atlas.arena),
    )


class _Decisions(NamedTuple):
    """The decisions of a plane that one belief, or a segment of them, explains; a point is its own start."""

    costs: Array
    decoys: Array
    start: Array
    along: Array
    is_segment: np.ndarray
    face: np.ndarray
    name: np.ndarray
    actions: Array


def _decisions(atlas: Atlas, rows: np.ndarray) -> _Decisions:
    """Rows of the atlas's table, and the decisions on the seams behind them."""
    parts = [_part(atlas, rows, atlas.table.face[rows], rows)]
    decoys = atlas.candidates.decoys
    seams = np.empty((0, 3)) if decoys is None else seam_decoys(atlas.problem, decoys)
    if len(seams):
        beside = Atlas(atlas.problem, decided_by(atlas.problem, seams))
        numbers = {tight.tobytes(): face for face, tight in enumerate(atlas.patterns)}
        renumbered = np.array([numbers.get(tight.tobytes(), -1) for tight in beside.patterns], dtype=np.int64)
        face = renumbered[beside.table.face]
        known = np.flatnonzero((face >= 0) & (beside.table.kind != LARGER))
        parts.append(_part(beside, known, face[known], np.full(len(known), POLISHED, dtype=np.int64)))
    return _Decisions(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _part(atlas: Atlas, rows: np.ndarray, face: np.ndarray, name: np.ndarray) -> _Decisions:
    table = atlas.table
    decoys, is_segment = table.decoys[rows], table.kind[rows] == SEGMENT
    start = np.where(is_segment[:, None], table.start[rows], decoys)
    along = np.where(is_segment[:, None], table.along[rows], 0.0)
    return _Decisions(table.costs[rows], decoys, start, along, is_segment, face, name, atlas.actions[rows])


def _leaf_by_leaf(found: _Decisions, z: Array) -> tuple[np.ndarray, np.ndarray]:
    """The decisions leaf by leaf: points that are near each other, and segments of one face, which lie side by side."""
    points, lines = np.flatnonzero(~found.is_segment), np.flatnonzero(found.is_segment)
    runs = [lines[found.face[lines] == face] for face in np.unique(found.face[lines])]
    beside = [_filled(run[_along(found.actions[run])]) for run in runs]
    return _filled(points[_order(z[points])]), np.concatenate([lines[:0], *beside])


def _has_unique_decisions(atlas: Atlas) -> bool:
    """Whether every belief has one decision on each face: the cost of every state is strictly convex there."""
    corners = np.eye(atlas.problem.n_states)
    for tight in atlas.patterns:
        curves = atlas.faces(tight).curves
        n_states, k = len(curves), curves.shape[1] - 1
        w, factor, room = np.empty(k + 1), np.empty((k, k)), np.empty((2, n_states, k))
        if not all(settle(curves, corner, tolerances.PIVOT, w, factor, room[0], room[1]) for corner in corners):
            return False
    return True


def ground_of(arena: Arena) -> Ground:
    """Return the face programmes as the kernels for three states read them."""
    columns = (arena.size, arena.n_rows, arena.n_set_rows, arena.curve_at, arena.row_at)
    return Ground(np.column_stack(columns), arena.curves, arena.rows)


def _filled(order: np.ndarray) -> np.ndarray:
    """Fill the last leaf up with copies of a member."""
    return np.concatenate([order, np.repeat(order[-1:], -len(order) % SLOTS)])


def _along(actions: Array) -> np.ndarray:
    """The order of decisions (n,U) along the line on which they lie."""
    away = actions - actions[0]
    return np.argsort(away @ away[(away**2).sum(axis=1).argmax()], kind="stable")


def _by_lanes(models: Array) -> Array:
    """Models along the last axis, copies filling up to a multiple of the processor's lanes."""
    return np.ascontiguousarray(np.concatenate([models, np.repeat(models[:1], -len(models) % _LANES, axis=0)]).T)


def _leaves(z: Array, costs: Array) -> Array:
    """The models of the leaves of points as `Plane` has them."""
    z, costs = z.reshape(-1, SLOTS, 2), costs.reshape(-1, SLOTS, 3)
    centre, middle = z.mean(axis=1), costs.mean(axis=1)
    away = z - centre[:, None]
    slope = np.linalg.pinv(away, rcond=tolerances.LEAF_SLOPE) @ (costs - middle[:, None])
    excess = np.maximum(middle[:, None] + away @ slope - costs, 0.0).max(axis=1)
    radius = np.linalg.norm(away, axis=2).max(axis=1)
    return _by_lanes(np.column_stack([centre, radius, middle - excess, slope[:, 0], slope[:, 1]]))


def _bands(ends: Array, costs: Array) -> Array:
    """The models of the leaves of segments as `Plane` has them: a segment in their middle, and how far they are from it."""
    ends, costs = ends.reshape(-1, SLOTS, 2, 2), costs.reshape(-1, SLOTS, 3)
    along = ends[:, :, 1] - ends[:, :, 0]
    turned = (along * along[:, :1]).sum(axis=2) < 0.0
    ends = np.where(turned[:, :, None, None], ends[:, :, ::-1], ends)
    middle = ends.mean(axis=1)
    # Segments are no farther from each other than their ends.
    away = np.linalg.norm(ends - middle[:, None], axis=3).max(axis=(1, 2))
    run = middle[:, 1] - middle[:, 0]
    square = (run**2).sum(axis=1)
    inverse = np.divide(1.0, square, out=np.zeros_like(square), where=square > 0.0)
    return _by_lanes(np.column_stack([middle[:, 0], run, inverse, away, costs.min(axis=1)]))


def _spacing(z: Array) -> float:
    """The typical distance between neighbouring decisions: of SLOTS that fill a leaf's circle."""
    leaves = z.reshape(-1, SLOTS, 2)
    radius = np.linalg.norm(leaves - leaves.mean(axis=1, keepdims=True), axis=2).max(axis=1)
    return float(np.median(radius) * np.sqrt(np.pi / SLOTS))


def _order(z: Array) -> np.ndarray:
    """Order points so that runs of SLOTS are near each other: cuts along the widest coordinate at multiples of SLOTS."""
    order = np.arange(len(z))
    pending = [(0, len(z))]
    while pending:
        low, high = pending.pop()
        if high - low <= SLOTS:
            continue
        axis = int(np.ptp(z[order[low:high]], axis=0).argmax())
        order[low:high] = order[low:high][np.argsort(z[order[low:high], axis], kind="stable")]
        middle = low + SLOTS * max(1, round((high - low) / (2 * SLOTS)))
        pending += [(low, middle), (middle, high)]
    return order
