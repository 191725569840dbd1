"""What many decisions cost, and which of them are admissible, each read once.

Quadratic costs of a decision that holds few coordinates, F = {j : u_j ≠ 0}, read only those:

    c(i,u) = Σ_{j∈F} u_j (½ Σ_{k∈F} H_i,jk u_k + g_ij) + r_i.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.kernels.options import kernel

SIDE_BY_SIDE = 4  # states whose costs are summed together; arrays of costs have room for this many more


@kernel
def quadratic_costs(actions: Any, costs: Any, constants: Any, found: Any) -> None:
    """Fill found (T,X) for actions (T,U); `costs` is (H_jki at (j·U + k)·X + i, g_ji at j·X + i), H symmetric."""
    hessians, linear = costs
    size, n_states = actions.shape[1], constants.size
    held, values, total = np.empty(size, dtype=np.int64), np.empty(size), np.empty(SIDE_BY_SIDE)
    for t in range(actions.shape[0]):
        n = 0
        for j in range(size):
            if actions[t, j] != 0.0:
                held[n], values[n] = j, actions[t, j]
                n += 1
        for first in range(0, n_states, SIDE_BY_SIDE):
            total[:] = 0.0
            for a in range(n):
                value, row = values[a], held[a] * size * n_states + first
                side, corner = held[a] * n_states + first, row + held[a] * n_states
                p = linear[side] + 0.5 * value * hessians[corner]
                q = linear[side + 1] + 0.5 * value * hessians[corner + 1]
                r = linear[side + 2] + 0.5 * value * hessians[corner + 2]
                s = linear[side + 3] + 0.5 * value * hessians[corner + 3]
                for c in range(a):
                    weight, place = values[c], row + held[c] * n_states
                    p += weight * hessians[place]
                    q += weight * hessians[place + 1]
                    r += weight * hessians[place + 2]
                    s += weight * hessians[place + 3]
                total[0] += value * p
                total[1] += value * q
                total[2] += value * r
                total[3] += value * s
            for i in range(first, min(first + SIDE_BY_SIDE, n_states)):
                found[t, i] = constants[i] + total[i - first]


@kernel
def admissible(actions: Any, bounds: Any, equalities: Any, limits: Any, found: Any) -> None:
    """Fill found (T,) for actions (T,U): feasible, and each bound tight or slack by the least slack.

    `bounds` is (coordinate, coefficient, side) of every inequality row, `equalities` (A, b, largest coefficient of each
    row), `limits` (how far a row may be broken, least slack).
    """
    column, factor, sides = bounds
    rows, equal_sides, scale = equalities
    tolerance, least = limits
    for t in range(actions.shape[0]):
        largest = 1.0
        for j in range(actions.shape[1]):
            largest = max(largest, abs(actions[t, j]))
        allowed = tolerance * largest
        fine = True
        for r in range(column.size):
            slack = (sides[r] - actions[t, column[r]] * factor[r]) / abs(factor[r])
            fine &= abs(slack) <= allowed or slack >= least
        for e in range(equal_sides.size):
            total = -equal_sides[e]
            for j in range(actions.shape[1]):
                total += actions[t, j] * rows[e, j]
            fine &= abs(total) <= allowed * scale[e]
        found[t] = fine
