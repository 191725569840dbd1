"""Optimal decisions' state costs for three states: a neighbour's face is tried first, and rows prove that it holds.

On a face the decision of y is w(y) = (v, 1) with H(y) v = −h(y); it is optimal where every row f_r(y) ≥ 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import bare_kernel, woven
from inscrutable.kernels.three_states import CURVE_AT, N_ROWS, ROW_AT, SIZE, Ground, decide_three

MOST_FACES = 64


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
def state_costs_three(
    low: int, high: int, order: Any, beliefs: Any, ground: Ground, pivot: float, out: Any, on: Any
) -> None:
    """Fill the state costs (T,3) of the optimal decisions of the beliefs order[low..high]; NaN: on no face of the ground."""
    curves, face = ground.curves, 0
    n_faces = min(len(ground.faces), MOST_FACES)
    for i in range(low, high):
        t = order[i]
        y0, y1, y2 = beliefs[t, 0], beliefs[t, 1], beliefs[t, 2]
        found = _is_optimal(ground, face, pivot, y0, y1, y2, on)
        other = 0
        while not found and other < n_faces:
            found = other != face and _is_optimal(ground, other, pivot, y0, y1, y2, on)
            if found:
                face = other
            other += 1
        if not found:
            out[t, 0] = out[t, 1] = out[t, 2] = np.nan
            continue
        w, width = on[0], ground.faces[face, SIZE] + 1
        for state in range(3):
            first, cost = ground.faces[face, CURVE_AT] + state * width * width, 0.0
            for a in range(width):
                for c in range(width):
                    cost += w[a] * curves[first + a * width + c] * w[c]
            out[t, state] = 0.5 * cost
