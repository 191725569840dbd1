"""Cuts where a row becomes inactive: optimal decisions have a kink there, and bounds on cells that end there are tighter.

Without them proofs to 1 % of 60 lotteries over four states take 1.5 to 2.1 times the time, and one is left open; those of
single decisions take 1.1 to 1.2 times. Over three states nothing changes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.proofs.smooth_cells import SmoothCells, complement
from inscrutable.validation import Array

_LEAST_SHARE = 0.03
"""Least share of the edge on either side of a cut; nearer to a corner a cut leaves a sliver. With 0, 24 proofs take as many
calls in all; with .1, one takes .6 of them; no gap differs by more than .004."""


class Cuts(NamedTuple):
    """Where cells are best cut for a kink."""

    at_kink: np.ndarray  # (C,) whether they lose most to a kink
    edge: np.ndarray  # (C,) which pair of corners
    share: Array  # (C,) of the way from the first of the pair to the second


def cuts_at_kinks(cells: SmoothCells, corners: np.ndarray, pairs: np.ndarray) -> Cuts:
    """Return the cuts of cells (C,J): where the row that costs most of the sum of `spare` is estimated to become inactive."""
    known, every = cells.known, np.arange(len(corners))
    if not known.slacks.size:
        return Cuts(every < 0, 0 * every, np.full(len(corners), 0.5))
    ends = corners[:, pairs.T]  # (C,2,E)
    products = known.multipliers[ends] * known.slacks[ends[:, ::-1]]
    largest = products.reshape(len(corners), -1).argmax(axis=1)
    end, edge, row = np.unravel_index(largest, products.shape[1:])
    tight, loose = ends[every, end, edge], ends[every, 1 - end, edge]
    at_kink = products[every, end, edge, row] > cells.unrest(corners) ** 2
    share = np.full(len(corners), 0.5)
    for cell in np.flatnonzero(at_kink):
        force, slack = known.multipliers[tight[cell], row[cell]], known.slacks[loose[cell], row[cell]]
        held = (known.multipliers[tight[cell]] > 0.0) & (known.slacks[loose[cell]] <= tolerances.FEASIBILITY)
        held[row[cell]] = False
        middle = 0.5 * (cells.points.beliefs[tight[cell]] + cells.points.beliefs[loose[cell]])
        inside = _give(cells, middle, held, int(row[cell])) * force
        share[cell] = inside / max(inside + slack, tolerances.TINY)
    at_kink &= (share > _LEAST_SHARE) & (share < 1.0 - _LEAST_SHARE)
    return Cuts(at_kink, edge, np.where(end == 0, share, 1.0 - share))


def _give(cells: SmoothCells, belief: Array, held: np.ndarray, row: int) -> float:
    """The compliance of a row: how far it moves per unit of its multiplier, the rows `held` being tight."""
    free = complement(cells.form.rows[held], cells.form.basis.shape[1])
    along = free.T @ cells.form.rows[row]
    hessian = free.T @ np.tensordot(belief, cells.form.hessians, axes=1) @ free
    return float(along @ np.linalg.lstsq(hessian, along, rcond=None)[0]) if along.size else 0.0
