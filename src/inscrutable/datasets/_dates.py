"""The first column of a user's CSV: dates in any unambiguous notation, or labels."""

from __future__ import annotations

import calendar
import logging
import re
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, time
from itertools import pairwise
from typing import Any

import pandas as pd

from inscrutable.datasets._cells import TextTable, is_missing, shown
from inscrutable.datasets.suspicious import missing_steps
from inscrutable.errors import InputError

_EXPECTED = "expected a date such as 2020-01-31 (or 2020-01, 20200131, 31.01.2020, 31-Jan-2020)"
_DASHED = re.compile(r"(\d{4})([-/])(\d{1,2})(?:\2(\d{1,2}))?", re.ASCII)
_COMPACT = re.compile(r"(\d{4})(\d{2})(\d{2})?", re.ASCII)
_WITH_TIME = re.compile(r"\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2}(?::\d{2}(?:\.\d+)?)?(?:Z|[+-]\d{2}:?\d{2})?", re.ASCII)
_CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}))?", re.ASCII)
_MONTH_YEAR = re.compile(r"(\d{1,2})/(\d{4})", re.ASCII)
_NAMED = re.compile(r"(?:(\d{1,2})[-/. ])?([A-Za-z]{3,9})[-/. ](\d{4})", re.ASCII)
_YEAR_LAST = re.compile(r"(\d{1,2})([-./])(\d{1,2})\2(\d{4})(?: (.*))?", re.ASCII)
_LOGGER = logging.getLogger(__name__.rpartition(".")[0])
_TOTALS = {"total", "totals", "grand total", "subtotal", "sum", "mean", "average", "avg"}
_MONTHS = (
    "january", "february", "march", "april", "may", "june", "july", "august", "september", "october", "november", "december",
)  # fmt: skip
_YEARS = range(1700, 2200)  # inside the years that pandas holds to the nanosecond


def date_index(table: TextTable) -> pd.DatetimeIndex:
    """Parse the first column as strictly increasing dates; the column's header is the index name."""
    days = _reading(table, increasing=True)
    if days is None:
        raise _unreadable(table)
    for row in range(1, len(days)):
        if days[row] <= days[row - 1]:
            problem = "is duplicated" if days[row] == days[row - 1] else "goes back in time"
            before = f"line {table.lines[row - 1]} has {shown(table.rows[row - 1][0])}"
            raise InputError(
                f"{table.place(row, 0)}: date {shown(table.rows[row][0])} {problem} ({before}), expected increasing "
                f"dates{_clock_note(days)}"
            )
    _warn_of_gaps(table, days)
    return pd.DatetimeIndex(days, name=table.header[0] or None)


def _clock_note(days: Sequence[datetime]) -> str:
    """What to do about the hour that a change of the clocks repeats."""
    if days[0].tzinfo is not None or not _has_times(days):
        return ""
    return "; an hour that a change of the clocks repeats needs UTC offsets in all rows, such as 2024-10-27T02:00+01:00"


def _has_times(days: Sequence[datetime]) -> bool:
    return any(day.time() != time() for day in days)


def _warn_of_gaps(table: TextTable, days: Sequence[datetime]) -> None:
    """Log a warning of rows missing between the usual steps."""
    missing = missing_steps(days)
    if missing:
        _LOGGER.warning("%s has %s", table.path, missing)


def label_index(table: TextTable) -> pd.Index:
    """Return the first column as dates if all cells are dates, as text if few are; labels must be nonblank and distinct."""
    labels: Sequence[Any] = row_labels(table)
    seen: dict[Any, int] = {}
    for row, label in enumerate(labels):
        if label in seen:
            raise InputError(
                f"{table.place(row, 0)}: label {shown(table.rows[row][0])} is duplicated (also on line {seen[label]}), "
                "expected each once"
            )
        seen[label] = table.lines[row]
    name = table.header[0] or None
    return pd.Index(labels, name=name) if isinstance(labels[0], str) else pd.DatetimeIndex(list(labels), name=name)


def is_total(label: str) -> bool:
    """Return whether a label is that of a sum or a mean of others."""
    return label.casefold().rstrip(":") in _TOTALS


def row_labels(table: TextTable) -> Sequence[datetime] | Sequence[str]:
    """Return the cells of the first column as dates if all are dates, as text if at most half are; else the odd one is refused.

    Labels of totals are refused too.
    """
    cells = [row[0] for row in table.rows]
    for row, label in enumerate(cells):
        if not label:
            raise InputError(f"{table.place(row, 0)}: missing (empty cell), expected a date or a label of the row")
        if is_total(label):
            raise InputError(f"{table.place(row, 0)}: {shown(label)} is no row of its own: delete the line")
    days = _reading(table, increasing=False)
    # A number such as 202001 may be a label.
    if days is None and 2 * sum(is_date(cell) and not cell.isdigit() for cell in cells) > len(cells):
        raise _unreadable(table)
    return days or cells


def is_date(text: str) -> bool:
    """Whether a single cell reads as a date."""
    return any(notation(text) is not None for notation in _NOTATIONS)


def _reading(table: TextTable, *, increasing: bool) -> list[datetime] | None:
    """Return the dates in the one notation that parses the whole column; None without one.

    The order of 01/02/2020 is the one that fits every row: months up to 12 and, if required, increasing dates. Where the
    other one has the newest row first, neither is more likely.
    """
    cells = [row[0] for row in table.rows]
    readings: list[list[datetime]] = []
    for notation in _NOTATIONS:
        days = _read_all(notation, cells)
        days = days and _in_one_zone(table, days)
        if days is not None and days not in readings:
            readings.append(days)
    if increasing and not any(all(a > b for a, b in pairwise(days)) for days in readings):
        readings = [days for days in readings if all(a < b for a, b in pairwise(days))] or readings
    if len(readings) > 1:
        raise InputError(
            f"{table.place(0, 0)}: {shown(cells[0])} and the dates below it can be read day first or month first, "
            "expected YYYY-MM-DD"
        )
    return readings[0] if readings else None


def _in_one_zone(table: TextTable, days: list[datetime]) -> list[datetime]:
    offsets = [day.tzinfo is not None for day in days]
    if any(offsets) and not all(offsets):
        row = offsets.index(not offsets[0])
        raise InputError(
            f"{table.place(row, 0)}: {shown(table.rows[row][0])} {'has a' if offsets[row] else 'has no'} UTC offset and "
            f"{shown(table.rows[0][0])} {'has none' if offsets[row] else 'has one'}, expected one in all rows or in none"
        )
    if not _has_times(days):
        return [day.replace(tzinfo=None) for day in days]
    return [day.astimezone(UTC) for day in days] if offsets[0] else days


def unambiguous(text: str, name: str) -> str:
    """Return a day written with its year last as YYYY-MM-DD, other text as it is.

    Raises:
        InputError: It can be read day first or month first.
    """
    days = {day for day in (_day_first(text), _month_first(text)) if day is not None}
    if len(days) > 1:
        raise InputError(f"{name} is {text}, which can be read day first or month first, expected YYYY-MM-DD")
    return text if not days else f"{days.pop():%Y-%m-%d}"


def _unreadable(table: TextTable) -> InputError:
    """Return the error for the first cell that the notation of most cells cannot parse."""
    cells = [row[0] for row in table.rows]
    best = max(_NOTATIONS, key=lambda notation: sum(notation(text) is not None for text in cells))
    row = next(row for row, text in enumerate(cells) if best(text) is None)
    if is_missing(cells[row]):
        return InputError(f"{table.place(row, 0)}: date missing, {_EXPECTED}")
    if is_date(cells[row]):
        return InputError(
            f"{table.place(row, 0)}: {shown(cells[row])} is written otherwise than most dates, expected one notation, such as "
            "YYYY-MM-DD, in all rows"
        )
    return InputError(f"{table.place(row, 0)}: found {shown(cells[row])}, {_EXPECTED}")


def _read_all(notation: Callable[[str], datetime | None], cells: Sequence[str]) -> list[datetime] | None:
    days: list[datetime] = []
    for text in cells:
        day = notation(text)
        if day is None:
            return None
        days.append(day)
    return days


def _year_first(text: str) -> datetime | None:
    dashed = _DASHED.fullmatch(text)
    if dashed:
        return _day(dashed[1], dashed[3], dashed[4])
    compact = _COMPACT.fullmatch(text)
    if compact:
        return _day(compact[1], compact[2], compact[3])
    if _WITH_TIME.fullmatch(text):
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            return None
        return moment if moment.year in _YEARS else None
    return None


def _year_last(text: str) -> datetime | None:
    """A month and a year, or a month by its English name."""
    short = _MONTH_YEAR.fullmatch(text)
    if short:
        return _day(short[2], short[1], None)
    named = _NAMED.fullmatch(text)
    if not named:
        return None
    month = next((k for k, name in enumerate(_MONTHS, 1) if name.startswith(named[2].lower())), 0)
    return _day(named[3], str(month), named[1])


def _day_first(text: str) -> datetime | None:
    found = _YEAR_LAST.fullmatch(text)
    return _moment(_day(found[4], found[3], found[1]), found[5]) if found else None


def _month_first(text: str) -> datetime | None:
    found = _YEAR_LAST.fullmatch(text)
    return _moment(_day(found[4], found[1], found[3]), found[5]) if found and found[2] != "." else None


def _moment(day: datetime | None, clock: str | None) -> datetime | None:
    """Return a day at a time such as 14:30; None where the time is none."""
    if day is None or clock is None:
        return day
    found = _CLOCK.fullmatch(clock)
    if not found or int(found[1]) > 23 or int(found[2]) > 59 or int(found[3] or 0) > 59:
        return None
    return day.replace(hour=int(found[1]), minute=int(found[2]), second=int(found[3] or 0))


def _day(year: str, month: str, day: str | None) -> datetime | None:
    """Return the date, at the month's end if no day is written; None for a day that does not exist."""
    if int(year) not in _YEARS or not 1 <= int(month) <= 12:
        return None
    last = calendar.monthrange(int(year), int(month))[1]
    number = last if day is None else int(day)
    return datetime(int(year), int(month), number) if 1 <= number <= last else None


_NOTATIONS: tuple[Callable[[str], datetime | None], ...] = (_year_first, _year_last, _day_first, _month_first)
