"""Candidates of a problem with three states, arranged in the plane of beliefs for the lottery's search."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.atlas import Atlas
from inscrutable.decision_makers.decoys import decided_by
from inscrutable.decision_makers.seams import seam_decoys
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.kernels.faces import settle
from inscrutable.kernels.lotteries import Arena
from inscrutable.kernels.search import LARGER, SEGMENT, Table
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
    decoys_given = atlas.candidates.decoys
    table, basis = atlas.table, sum_zero_basis(3)
    larger = np.flatnonzero(table.kind == LARGER)
    ours = np.flatnonzero(table.kind != LARGER)
    size = atlas.arena.size[table.face]
    if len(larger) > _MOST_POLYGONS or not len(ours) or np.any(size[larger] > 0):
        return None
    if np.any(size[table.kind == SEGMENT] > 1):
        # Two states that cost the same: beliefs are not told apart where the walk takes them to be.
        return None
    if not _has_unique_decisions(atlas):
        return None
    parts = [(table, ours, table.face[ours], ours)]
    seam = None if decoys_given is None else _seams(atlas, decoys_given)
    if seam is not None:
        parts.append(seam)
    costs, decoys, start, along, kind = (
        np.concatenate([getattr(part, name)[rows] for part, rows, _, _ in parts])
        for name in ("costs", "decoys", "start", "along", "kind")
    )
    face, name = (np.concatenate([part[k] for part in parts]) for k in (2, 3))
    order = _order(decoys @ basis)
    # The last leaf is filled up with copies of a member.
    slots = np.concatenate([order, np.repeat(order[-1:], -len(order) % SLOTS)])
    segment = (kind == SEGMENT)[:, None]
    start, along = np.where(segment, start, decoys)[slots], np.where(segment, along, 0.0)[slots]
    costs, decoys = costs[slots], decoys[slots]
    square = (along**2).sum(axis=1)
    spread = np.maximum(*(np.linalg.norm(end - decoys, axis=1) for end in (start, start + along)))
    inverse = np.divide(1.0, square, out=np.zeros_like(square), where=square > 0.0)
    slots_of = np.column_stack([costs, start @ basis, along @ basis, inverse])
    return Plane(
        np.ascontiguousarray(slots_of.reshape(-1, SLOTS, 8).swapaxes(1, 2)),
        np.ascontiguousarray((decoys @ basis).T),
        face[slots],
        name[slots],
        _leaves(decoys @ basis, costs, spread),
        np.array([_spacing(decoys @ basis)]),
        larger,
        np.ascontiguousarray(table.costs[larger].T),
        table.face[larger],
        np.ascontiguousarray((table.decoys[larger] @ basis).T),
        ground_of(atlas.arena),
    )


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


def _seams(atlas: Atlas, decoys: Array) -> tuple[Table, np.ndarray, np.ndarray, np.ndarray] | None:
    """Table, rows, faces and names of the decisions on the seams, of faces that the atlas knows."""
    found = seam_decoys(atlas.problem, decoys)
    if not len(found):
        return None
    beside = Atlas(atlas.problem, decided_by(atlas.problem, found))
    numbers = {tight.tobytes(): face for face, tight in enumerate(atlas.patterns)}
    renumbered = np.array([numbers.get(tight.tobytes(), -1) for tight in beside.patterns], dtype=np.int64)
    face = renumbered[beside.table.face]
    rows = np.flatnonzero((face >= 0) & (beside.table.kind != LARGER))
    return beside.table, rows, face[rows], np.full(len(rows), POLISHED, dtype=np.int64)


def _leaves(z: Array, costs: Array, spread: Array) -> Array:
    """The models of the leaves as `Plane` has them; their number is filled up to a multiple of the processor's lanes."""
    z, costs = z.reshape(-1, SLOTS, 2), costs.reshape(-1, SLOTS, 3)
    centre, middle = z.mean(axis=1), costs.mean(axis=1)
    away = z - centre[:, None]
    slope = np.linalg.pinv(away, rcond=tolerances.LEAF_SLOPE) @ (costs - middle[:, None])
    excess = np.maximum(middle[:, None] + away @ slope - costs, 0.0).max(axis=1)
    radius = np.linalg.norm(away, axis=2).max(axis=1)
    reach = spread.reshape(-1, SLOTS).max(axis=1)
    models = np.column_stack([centre, radius, reach, middle - excess, slope[:, 0], slope[:, 1]])
    filled = np.concatenate([models, np.repeat(models[:1], -len(models) % _LANES, axis=0)])
    return np.ascontiguousarray(filled.T)


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
