"""The table of least information under linear rows, by an interior-point method for exponential cones if one is installed.

Cuts alone converge slowly: with 21 beliefs and 80 decisions under a pointwise cap, the gap after 100 programmes (23 s) is .005
bit. With cuts at this table a few programmes suffice. The table is only a start: `TableSearch` makes it feasible and bounds it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from inscrutable.decision_makers.aware.guaranteed_programme import SPARSE, PlayedGame, RowBlock
from inscrutable.validation import Array


def least_informing(game: PlayedGame, blocks: list[RowBlock]) -> Array | None:
    """Return a table K (B,M) of about the least Σ w K log(K/p(u)) that keeps the rows; None without a solver, or an answer.

    Variables are K, the rows' own variables, p(u), and t with K e^{−t/K} ≤ p(u).
    """
    try:
        import clarabel
    except ImportError:
        return None
    n_beliefs, n_columns = game.shape
    size = n_beliefs * n_columns
    extra = SPARSE.block_diag([block.extra for block in blocks]).tocsr()
    n_extra = extra.shape[1]
    count = 2 * size + n_extra + n_columns
    at_played, at_cone = size + n_extra, size + n_extra + n_columns

    def wide(table: Any, at: int) -> Any:
        before, after = (SPARSE.csr_array((table.shape[0], width)) for width in (at, count - at - table.shape[1]))
        return SPARSE.hstack([before, table, after])

    sums = wide(SPARSE.kron(SPARSE.identity(n_beliefs), np.ones((1, n_columns))), 0)
    law = wide(SPARSE.kron(game.weights[None], SPARSE.identity(n_columns)), 0)
    law = law - wide(SPARSE.identity(n_columns), at_played)
    rows = wide(SPARSE.hstack([SPARSE.vstack([block.table for block in blocks]), extra]), 0)
    positive = -wide(SPARSE.identity(n_extra), size)
    triple = np.arange(size) * 3

    def cone(place: int, value: float, column: np.ndarray) -> Any:
        entries = np.full(size, value), (triple + place, column)
        return SPARSE.csr_array(entries, shape=(3 * size, count))

    every = np.arange(size)
    cones = cone(0, 1.0, at_cone + every) + cone(1, -1.0, every) + cone(2, -1.0, at_played + every % n_columns)
    matrix = SPARSE.vstack([sums, law, rows, positive, positive * -1.0, cones]).tocsc()
    sides = [np.ones(n_beliefs), np.zeros(n_columns), *(block.sides for block in blocks), np.zeros(n_extra)]
    kinds = [clarabel.ZeroConeT(n_beliefs + n_columns), clarabel.NonnegativeConeT(rows.shape[0] + 2 * n_extra)]
    objective = np.zeros(count)
    objective[at_cone:] = np.repeat(game.weights, n_columns)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solver = clarabel.DefaultSolver(
        SPARSE.csc_matrix((count, count)),
        objective,
        SPARSE.csc_matrix(matrix),
        np.concatenate([*sides, np.ones(n_extra), np.zeros(3 * size)]),
        kinds + [clarabel.ExponentialConeT()] * size,
        settings,
    )
    found = np.asarray(solver.solve().x)[:size].reshape(n_beliefs, n_columns)
    if not np.isfinite(found).all():
        return None
    table = np.maximum(found, 0.0)
    return np.asarray(table / table.sum(axis=1, keepdims=True)) if (table.sum(axis=1) > 0.5).all() else None
