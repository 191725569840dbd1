"""A user's CSV as text cells with line and column, and the numbers in them."""

from __future__ import annotations

import csv
import math
import os
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from inscrutable.errors import InputError
from inscrutable.files import path_of, reason

_NUMBER = re.compile(
    r"[+-]?(?:\d+(?:\.(?P<fraction>\d*))?|\.(?P<bare>\d+))(?:[eE](?P<exponent>[+-]?\d{1,6}))?", re.ASCII
)
_MISSING = {"", "-", "na", "nan", "n/a", "#n/a", "null", "none", "<na>", "nat"}
_INFINITE = re.compile(r"[+-]?inf(?:inity)?", re.IGNORECASE)
_SHOWN = 60
_BEFORE, _BEHIND = r"[(+$\u2212-]*", r"\s*[)%]*"  # of an amount
_COMMA = re.compile(rf"{_BEFORE}\d*,\d+(?:[eE][+-]?\d{{1,6}})?{_BEHIND}", re.ASCII)
_POINT = re.compile(rf"{_BEFORE}(?:\d*\.\d+|\d+\.)(?:[eE][+-]?\d{{1,6}})?{_BEHIND}", re.ASCII)
_THOUSANDS = re.compile(rf"{_BEFORE}[1-9]\d{{0,2}}[,.]\d{{3}}{_BEHIND}", re.ASCII)
_BELOW_THOUSAND = re.compile(rf"{_BEFORE}[1-9]\d{{0,2}}{_BEHIND}", re.ASCII)
_QUOTED, _STATED = re.compile(r'"[^"]*"'), re.compile(r"sep=(.)", re.IGNORECASE)


FORMULA = re.compile("'*[=+@-]")
"""Prefixes that a spreadsheet reads as a formula, also after apostrophes, so that an added one is recognised and removed."""


@dataclass(frozen=True)
class TextTable:
    """The header and the rows of a CSV file, blanks around cells removed; `lines` are line numbers in the file."""

    path: Path
    header: tuple[str, ...]
    lines: tuple[int, ...]
    rows: tuple[tuple[str, ...], ...]

    def place(self, row: int, column: int) -> str:
        """Return file, line and column of one cell, the start of every message."""
        name = f"{self.header[column]!r}" if self.header[column] else f"{column + 1} (unnamed)"
        return f"{self.path}, line {self.lines[row]}, column {name}"

    def labels_from(self, column: int) -> pd.Index:
        """Column labels from `column` on."""
        return pd.Index(self.header[column:])


def read_text_table(path: str | os.PathLike[str]) -> TextTable:
    """Read a file with one header line and at least one row, every row as long as the header.

    Cells are separated by commas; where the header has none, by semicolons, tabs or bars, and numbers may then have decimal
    commas, all of them or none. A first line such as sep=; states the separator.
    """
    source = path_of(path, "a CSV file")
    text = _text_of(source)
    stated, separator = _separator(text)
    reader = csv.reader(StringIO(text, newline=""), strict=True, delimiter=separator)
    records: list[tuple[int, tuple[str, ...]]] = []
    start = 1
    try:
        for record in reader:
            if record:
                records.append((start, tuple(map(_unescaped, record))))
            start = reader.line_num + 1
    except csv.Error as error:
        raise InputError(f"{source}, line {start}: not readable as CSV ({error}); check the quotes") from None
    records = records[stated:]
    if not records:
        raise InputError(f"{source} is empty; expected a header line and rows of numbers")
    (_, header), body = records[0], records[1:]
    _check_header(source, header)
    if not body:
        raise InputError(f"{source} has only a header; expected rows of numbers below it")
    for line, cells in body:
        if len(cells) != len(header):
            raise InputError(
                f"{source}, line {line}: {len(cells)} cells, expected {len(header)} as in the header; titles above the table "
                "and notes below it must be deleted"
            )
    table = TextTable(source, header, tuple(line for line, _ in body), tuple(cells for _, cells in body))
    return table if separator == "," else _with_points(table)


def _separator(text: str) -> tuple[bool, str]:
    """Return whether the first line states the separator of cells, and the separator: the one stated, a comma, or the one in a
    header without commas outside quotes."""
    header = next(line for line in text.splitlines() if line.strip())
    stated = _STATED.fullmatch(header.strip(" "))
    if stated:
        return True, stated[1]
    bare = _QUOTED.sub("", header)
    return False, "," if "," in bare else next((each for each in ";\t|" if each in bare), ",")


def _with_points(table: TextTable) -> TextTable:
    """Return a table with decimal points instead of decimal commas, which must be in all numbers or in none.

    Numbers that may be grouped in thousands, by commas or by points, are refused.
    """
    places = [(row, column) for row, cells in enumerate(table.rows) for column in range(len(cells))]
    commas = [(row, column) for row, column in places if _COMMA.fullmatch(table.rows[row][column])]
    points = [(row, column) for row, column in places if _POINT.fullmatch(table.rows[row][column])]
    if not commas:
        _check_grouped(table, points)
        return table
    if points:
        (row, column), (line, other) = commas[0], points[0]
        raise InputError(
            f"{table.place(row, column)}: found {shown(table.rows[row][column])}, and {shown(table.rows[line][other])} in line "
            f"{table.lines[line]}; expected decimal commas or points, not both"
        )
    if all(_THOUSANDS.fullmatch(table.rows[row][column]) for row, column in commas):
        row, column = commas[0]
        raise InputError(
            f"{table.place(row, column)}: {shown(table.rows[row][column])} may have a decimal comma or one of thousands; write "
            "numbers with a decimal point"
        )
    rows = [list(cells) for cells in table.rows]
    for row, column in commas:
        rows[row][column] = rows[row][column].replace(",", ".")
    return TextTable(table.path, table.header, table.lines, tuple(map(tuple, rows)))


def _check_grouped(table: TextTable, points: Sequence[tuple[int, int]]) -> None:
    """Raise `InputError` where each number with a point may be one of thousands, and one below a thousand stands beside it."""
    if not all(_THOUSANDS.fullmatch(table.rows[row][column]) for row, column in points):
        return
    in_rows, in_columns = (
        [any(map(_BELOW_THOUSAND.fullmatch, cells)) for cells in lines]
        for lines in (table.rows, zip(*table.rows, strict=True))
    )
    for row, column in points:
        if in_rows[row] or in_columns[column]:
            raise InputError(
                f"{table.place(row, column)}: {shown(table.rows[row][column])} may have a decimal point or one of thousands; "
                "write numbers without points of thousands, or all with the same decimals"
            )


def _unescaped(cell: str) -> str:
    """Return a cell without surrounding blanks and without the apostrophe that protects it in spreadsheets."""
    text = cell.strip()
    return text[1:] if text.startswith("'") and FORMULA.match(text) else text


def numbers(table: TextTable, columns: Sequence[int]) -> NDArray[np.float64]:
    """The finite numbers in `columns`, one row per row of the file."""
    return np.array(
        [[_number(table, row, column) for column in columns] for row in range(len(table.rows))], dtype=np.float64
    ).reshape(len(table.rows), len(columns))


def decimal_digits(table: TextTable, columns: Sequence[int]) -> int:
    """The largest number of decimal digits written in `columns`, which hold numbers: 0.2500 has four, 1e-5 five."""
    most = 0
    for cells in table.rows:
        for column in columns:
            found = _NUMBER.fullmatch(cells[column])
            if found:
                fraction = found["fraction"] or found["bare"] or ""
                most = max(most, len(fraction) - int(found["exponent"] or 0))
    return most


def is_number(text: str) -> bool:
    """Whether a cell is written as a number."""
    return _NUMBER.fullmatch(text) is not None


def is_missing(text: str) -> bool:
    """Whether a cell is empty or one of the usual words for a missing value."""
    return text.lower() in _MISSING


def shown(text: str) -> str:
    """Return a cell's text as quoted in messages, truncated if long."""
    return repr(text if len(text) <= _SHOWN else text[: _SHOWN - 1] + "…")


def _number(table: TextTable, row: int, column: int) -> float:
    text = table.rows[row][column]
    if _NUMBER.fullmatch(text):
        value = float(text)
        if math.isfinite(value):
            return value
    place = table.place(row, column)
    if is_missing(text):
        what = f"missing ({shown(text)})" if text else "missing (empty cell)"
        raise InputError(f"{place}: {what}, expected a number; drop the row or the column, nothing is filled in")
    if _INFINITE.fullmatch(text) or _NUMBER.fullmatch(text):
        raise InputError(f"{place}: infinite ({shown(text)}), expected a finite number")
    raise InputError(f"{place}: found {shown(text)}, expected a number{_hint(text)}")


def _hint(text: str) -> str:
    if text.endswith("%") and is_number(text[:-1].strip()):
        return "; write a percentage as a fraction, 2.5% as 0.025"
    if is_number(text.replace(",", "")):
        return " with a decimal point and without commas"
    return ""


def _text_of(source: Path) -> str:
    try:
        content = source.read_bytes()
    except IsADirectoryError:
        raise InputError(f"{source} is a folder, expected a CSV file") from None
    except FileNotFoundError:
        raise InputError(f"{source} does not exist, expected a CSV file") from None
    except OSError as error:
        raise InputError(f"{source} cannot be read: {reason(error)}") from error
    except ValueError as error:
        raise InputError(f"{str(source)!r} is no path: {error}") from None
    if content.startswith(b"PK\x03\x04"):
        raise InputError(f"{source} is a zip archive or an Excel workbook, expected text: save it as CSV (UTF-8)")
    if b"\0" in content:
        raise InputError(f"{source} is binary or UTF-16, expected text: save it as CSV (UTF-8)")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = content[error.start]
        raise InputError(
            f"{source}, line {line}: byte 0x{byte:02x} is not UTF-8 text: save it as CSV (UTF-8)"
        ) from None
    if not text.strip():
        raise InputError(f"{source} is empty; expected a header line and rows of numbers")
    # An accent may be one character with its letter or one of its own: labels must be equal in both spellings.
    return unicodedata.normalize("NFC", text)


def _check_header(source: Path, header: tuple[str, ...]) -> None:
    first: dict[str, int] = {}
    for index, name in enumerate(header, start=1):
        if not name and index > 1:
            raise InputError(f"{source}, line 1: column {index} has a blank name, expected a label in every column")
        if name in first:
            raise InputError(
                f"{source}, line 1: column {name!r} is duplicated (columns {first[name]} and {index}), "
                "expected one header line with each name once"
            )
        first[name] = index
