"""Costs of optimal decisions for three states: a neighbour's face is tried first, and rows prove that it holds.

On a face the decision of y is w(y) = (v, 1) with H(y) v = −h(y); it is optimal where every row f_r(y) ≥ 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import bare_kernel, woven
from inscrutable.kernels.three_states import CURVE_AT, N_ROWS, ROW_AT, SIZE, Ground, decide_three

_MOST_FACES = 64


@woven
def _is_optimal(ground: Ground, face: int, pivot: float, y0: float, y1: float, y2: float, on: Any) -> bool:
    """Whether the decision of y lies on a face; w is left in the first row of `on`."""
    k, m = ground.faces[face, SIZE], ground.faces[face, N_ROWS]
    if not decide_three(ground.curves, ground.faces[face, CURVE_AT], k, pivot, y0, y1, y2, on):
        return False
    w, rows, width = on[0], ground.rows, k + 1
    for r in range(m):
        j = ground.faces[face, ROW_AT] + 3 * r * width
        value = 0.0
        for a in range(width):
            value += w[a] * (y0 * rows[j + a] + y1 * rows[j + width + a] + y2 * rows[j + 2 * width + a])
        if not value >= 0.0:
            return False
    return True


@bare_kernel
def best_costs_three(
    low: int, high: int, order: Any, decoys: Any, beliefs: Any, ground: Ground, pivot: float, out: Any, on: Any
) -> None:
    """Fill the costs π·s(u*(y)) of decoys y and beliefs π order[low..high]; NaN where no face of the ground has u*(y)."""
    curves, face = ground.curves, 0
    n_faces = min(len(ground.faces), _MOST_FACES)
    for i in range(low, high):
        t = order[i]
        y0, y1, y2 = decoys[t, 0], decoys[t, 1], decoys[t, 2]
        found = _is_optimal(ground, face, pivot, y0, y1, y2, on)
        other = 0
        while not found and other < n_faces:
            found = other != face and _is_optimal(ground, other, pivot, y0, y1, y2, on)
            if found:
                face = other
            other += 1
        if not found:
            out[t] = np.nan
            continue
        w, width, cost = on[0], ground.faces[face, SIZE] + 1, 0.0
        first, size = ground.faces[face, CURVE_AT], width * width
        for a in range(width):
            for c in range(width):
                j = first + a * width + c
                bend = (
                    beliefs[t, 0] * curves[j] + beliefs[t, 1] * curves[j + size] + beliefs[t, 2] * curves[j + 2 * size]
                )
                cost += 0.5 * w[a] * bend * w[c]
        out[t] = cost
