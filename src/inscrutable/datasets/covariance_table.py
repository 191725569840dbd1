"""A covariance in a CSV file: a square table with a name for every row and column."""

from __future__ import annotations

import pandas as pd

from inscrutable.datasets._cells import numbers, read_text_table
from inscrutable.errors import InputError
from inscrutable.files import PathLike


def read_covariance(path: PathLike) -> pd.DataFrame:
    """Read a square labelled table of numbers from a CSV file.

    Args:
        path: The file. Its first column has the names of the rows, its header those of the columns: the same, in any order.

    Returns:
        (n,n) numbers, rows in the order of the columns.

    Raises:
        InputError: With file and line: a cell is no number, a name is missing, unknown or twice.

    Cost: O(n²).

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable.datasets import read_covariance
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "V.csv")
        ...     _ = file.write_text("asset,Oil,Food\\nFood,0,1\\nOil,4,0\\n")
        ...     print(read_covariance(file).to_numpy().tolist())
        [[4.0, 0.0], [0.0, 1.0]]
    """
    table = read_text_table(path)
    names, rows = list(table.header[1:]), [cells[0] for cells in table.rows]
    if not names:
        raise InputError(f"{table.path}, line 1: one column, expected names of rows and one column for each of them")
    for row, name in enumerate(rows):
        if name not in names or name in rows[:row]:
            said = "stands twice" if name in rows[:row] else "is no column"
            raise InputError(
                f"{table.path}, line {table.lines[row]}: the row {name!r} {said}; expected one row per column"
            )
    missing = [name for name in names if name not in rows]
    if missing:
        raise InputError(f"{table.path}: no row for the column {missing[0]!r}; expected one row per column")
    values = numbers(table, range(1, len(table.header)))
    return pd.DataFrame(values, index=pd.Index(rows), columns=table.labels_from(1)).loc[names]
