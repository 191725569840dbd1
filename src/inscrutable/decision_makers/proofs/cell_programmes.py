"""Many tiny linear programmes at once: the largest gain on a simplicial cell under lower bounds of the regret.

On a cell with corners y_j let D_j bound the gain at the corners, the gain be convex in between, and let every column k
of M bound the regret from below by Σ_j λ_j M_jk at y = Σ_j λ_j y_j. Then no affordable belief of the cell gains more than

    max_λ {λ·D : M'λ ≤ b, λ in the simplex} = min_z {max_j (D − M z)_j + b Σz : z ≥ 0},

and with a multiplier μ on the regret in place of a budget no belief's gain less μ times its regret exceeds
min_z {max_j (D − M z)_j : z ≥ 0, Σz ≤ μ}. The right sides are solved by the simplex method, all cells together. Every z
gives a bound, so the value is computed from the final z: rounding can only loosen it.
"""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.validation import Array

_MOST_PIVOTS = 60  # a limit against cycles: 990 rounds of 80 proofs take at most nine
_FAR = 20.0  # gains differ by less


def cell_weights(gains: Array, regrets: Array, budget: float, multiplier: float | None) -> Array:
    """Return z (C,K) that give the least bounds for gains (C,J) and regrets (C,J,K)."""
    if multiplier == 0.0:
        return np.zeros((len(regrets), regrets.shape[2]))
    return allowed_weights(
        _simplex_method(gains, regrets, budget if multiplier is None else 0.0, multiplier), multiplier
    )


def bounds_by(weights: Array, gains: Array, regrets: Array, price: float) -> Array:
    """Return the bounds (C,) that z (C,K) give, where `price` is the budget and no more than the largest gain."""
    values = (gains - (regrets @ weights[:, :, None])[:, :, 0]).max(axis=1) + price * weights.sum(axis=1)
    return np.asarray(np.minimum(values, gains.max(axis=1)))


def allowed_weights(weights: Array, multiplier: float | None) -> Array:
    """Return z (C,K) scaled to a sum of at most the multiplier, as a question with one needs."""
    if multiplier is None:
        return weights
    return np.asarray(
        weights * (multiplier / np.maximum(weights.sum(axis=1), max(multiplier, tolerances.TINY)))[:, None]
    )


def _simplex_method(gains: Array, regrets: Array, price: float, multiplier: float | None) -> Array:
    """Return z (C,K): optimal, or far along a ray on which the objective is unbounded."""
    n_cells, _, n_columns = regrets.shape
    tableau, costs, basis = _start(gains, regrets, price, multiplier)
    rows = np.arange(n_cells)
    rays = np.zeros((n_cells, costs.shape[1] - 1))
    live = np.ones(n_cells, dtype=bool)
    for _ in range(_MOST_PIVOTS):
        entering = costs[:, :-1].argmin(axis=1)
        live &= costs[rows, entering] < -tolerances.REDUCED_COST
        if not live.any():
            break
        column = tableau[rows, :, entering]
        # The largest gain left, in the first column, is a free variable and never leaves the basis.
        leaves = (column > tolerances.REDUCED_COST) & (basis != 0)
        ratios = np.where(leaves, np.maximum(tableau[:, :, -1], 0.0) / np.where(leaves, column, 1.0), np.inf)
        leaving = ratios.argmin(axis=1)
        endless = np.flatnonzero(live & np.isinf(ratios[rows, leaving]))
        rays[endless, entering[endless]] = 1.0
        rays[endless[:, None], basis[endless]] = -column[endless]
        live[endless] = False
        at = np.flatnonzero(live)
        pivot = tableau[at, leaving[at]] / column[at, leaving[at]][:, None]
        tableau[at] -= column[at][:, :, None] * pivot[:, None, :]
        tableau[at, leaving[at]] = pivot
        costs[at] -= costs[at, entering[at]][:, None] * pivot
        basis[at, leaving[at]] = entering[at]
    solution = np.zeros((n_cells, costs.shape[1] - 1))
    solution[rows[:, None], basis] = tableau[:, :, -1]
    weights = np.maximum(solution[:, 1 : 1 + n_columns], 0.0)
    if multiplier is not None:
        return weights
    ray = np.maximum(rays[:, 1 : 1 + n_columns], 0.0)
    slope = np.einsum("cjk,ck->cj", -regrets, ray).max(axis=1) + price * ray.sum(axis=1)
    far = np.where(slope < 0, _FAR / np.maximum(-slope, tolerances.TINY), 0.0)
    return np.asarray(weights + far[:, None] * ray)


def _start(gains: Array, regrets: Array, price: float, multiplier: float | None) -> tuple[Array, Array, np.ndarray]:
    """Tableau, reduced costs and basis at z = 0: columns are the largest gain left, z, a surplus per corner, spare Σz."""
    n_cells, n_corners, n_columns = regrets.shape
    size = n_columns + n_corners + 2
    rows, corners = np.arange(n_cells), np.arange(n_corners)
    tableau = np.zeros((n_cells, n_corners + 1, size + 1))
    tableau[:, :n_corners, 0] = 1.0
    tableau[:, :n_corners, 1 : 1 + n_columns] = regrets
    tableau[:, corners, 1 + n_columns + corners] = -1.0
    tableau[:, :n_corners, -1] = gains
    tableau[:, n_corners, 1 : 1 + n_columns] = 0.0 if multiplier is None else 1.0 / multiplier
    tableau[:, n_corners, -2:] = 1.0
    costs = np.zeros((n_cells, size + 1))
    costs[:, 0] = 1.0
    costs[:, 1 : 1 + n_columns] = price
    basis = np.empty((n_cells, n_corners + 1), dtype=np.intp)
    basis[:, :n_corners] = 1 + n_columns + corners
    basis[:, n_corners] = size - 1
    largest = gains.argmax(axis=1)
    basis[rows, largest] = 0
    pivot = tableau[rows, largest].copy()
    others = np.ones((n_cells, n_corners + 1), dtype=bool)
    others[rows, largest] = False
    others[:, n_corners] = False
    return np.where(others[:, :, None], pivot[:, None, :] - tableau, tableau), costs - pivot, basis
