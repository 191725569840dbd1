"""Draws from the rows of a table of probabilities, many at once."""

from __future__ import annotations

from typing import Any

import numpy as np


class RowDraws:
    """Draws a column for each of many rows of a sparse table (B,M) whose rows sum to one."""

    def __init__(self, table: Any) -> None:
        self._columns, self._ends = table.indices, table.indptr
        self._levels = table.data.cumsum()
        self._before = np.concatenate([[0.0], self._levels])[table.indptr]

    def __call__(self, rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return a column for each entry of `rows`, in its shape."""
        height = self._before[rows] + rng.random(rows.shape) * (self._before[rows + 1] - self._before[rows])
        place = np.searchsorted(self._levels, height, side="right")
        # Rounding must not leave the row.
        return np.asarray(self._columns[np.clip(place, self._ends[rows], self._ends[rows + 1] - 1)])
