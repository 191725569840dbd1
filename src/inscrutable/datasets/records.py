"""A reader for rows of numbers or words under dates or labels, some of them missing."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from inscrutable.datasets._cells import TextTable, is_missing, is_number, numbers, read_text_table, shown
from inscrutable.datasets._dates import date_index, is_date, label_index
from inscrutable.errors import InputError
from inscrutable.files import PathLike


def read_records(path: PathLike, *, all_numbers: bool = False) -> pd.DataFrame:
    """Read rows of numbers or words from a CSV file, as `audit_pairs` takes them; missing cells stay missing.

    Args:
        path: The file. First column: strictly increasing dates as for `read_returns`, or labels of rows, each once. Every
            other column: numbers, or words (classes, choices), not both.
        all_numbers: Whether words and missing cells are refused.

    Returns:
        A frame labelled as the file: columns of numbers with NaN, or of text with None, where a cell is empty or says that it
        is missing (such as NA).

    Raises:
        InputError: With file, line and column: missing, empty or unreadable file, only a header, one column, duplicated or
            blank names, rows of another length, dates duplicated or not in order, text among numbers, infinite numbers.

    Cost: O(cells), about a microsecond a cell.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "signals.csv")
        ...     _ = file.write_text("date,regime,score\\n2020-01-31,calm,0.5\\n2020-02-29,wild,\\n")
        ...     print(read_records(file))
                   regime  score
        date
        2020-01-31   calm    0.5
        2020-02-29   wild    NaN
    """
    table = read_text_table(path)
    if len(table.header) < 2:
        raise InputError(
            f"{table.path}, line 1: one column, expected dates or labels and at least one column beside them"
        )
    dated = all(is_date(row[0]) for row in table.rows)
    index = date_index(table) if dated else label_index(table)
    if all_numbers:
        return pd.DataFrame(numbers(table, range(1, len(table.header))), index, table.labels_from(1))
    columns = {name: _column(table, k).set_axis(index) for k, name in enumerate(table.header) if k > 0}
    return pd.DataFrame(columns)


def _column(table: TextTable, column: int) -> pd.Series:
    cells = [row[column] for row in table.rows]
    present = [k for k, text in enumerate(cells) if not is_missing(text)]
    written = [k for k in present if is_number(cells[k])]
    if not written and present:
        return pd.Series([None if is_missing(text) else text for text in cells], dtype=object)
    if len(written) == len(cells):
        return pd.Series(numbers(table, [column])[:, 0])
    for k in present:
        if not is_number(cells[k]):
            raise InputError(
                f"{table.place(k, column)}: found {shown(cells[k])} where line {table.lines[written[0]]} has the number "
                f"{shown(cells[written[0]])}, expected numbers or words in a column, not both"
            )
    values = np.array([float(text) if is_number(text) else math.nan for text in cells])
    if np.isinf(values).any():
        raise InputError(f"{table.place(int(np.isinf(values).argmax()), column)}: infinite, expected a finite number")
    return pd.Series(values)
