"""Two tables as pairs of rows: aligned by their labels, decisions as numbers, secrets as classes or numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Number
from typing import Any, Literal

import numpy as np
import pandas as pd

from inscrutable import validation
from inscrutable.axes import few, ordered_array
from inscrutable.errors import InputError
from inscrutable.labels import label_text
from inscrutable.validation import Array

Kind = Literal["classes", "numbers"]
LEAST_ROWS = 60
_MOST_CLASSES = 10
"""Whole numbers with at most this many different values count as classes."""
_MOST_CHOICES = 50
_MARKS = "%$€£¥,'"
_WRITTEN = re.compile(r"[(+-]?\s*[$€£¥]?\s*[+-]?\d+([.,' ]\d+)*\s*[%$€£¥]?\)?", re.ASCII)
"""A number as text, with signs of per cent or currency, separators, or in parentheses."""


@dataclass(frozen=True, eq=False)
class Target:
    """A secret as a learning target: one indicator per class, or one number."""

    name: str
    kind: Kind
    classes: tuple[str, ...]
    values: Array  # (T, C)


@dataclass(frozen=True, eq=False)
class PairedRows:
    """Rows of secrets with their decisions, in order of time."""

    index: pd.Index
    targets: tuple[Target, ...]
    features: Array  # (T, P)
    columns: tuple[str, ...]  # of each feature
    lags: tuple[int, ...]  # of each feature
    notes: tuple[str, ...]


def paired(secrets: Any, published: Any, lags: tuple[int, ...], kind: Kind | None) -> PairedRows:
    """Return the complete rows; raise `InputError` where the tables disagree or too few rows are left."""
    hidden, shown = _table(secrets, "secrets"), _table(published, "published")
    notes: list[str] = []
    by_place = _joined_by_place((secrets, published), (hidden, shown))
    hidden, shown, both = _joined_in_order(hidden, shown) if by_place else _aligned(hidden, shown, lags, notes)
    decisions = _decisions(shown, notes)
    # Sort columns by name, so that their order has no effect.
    decisions = decisions[sorted(decisions.columns, key=str)]
    features = pd.concat([decisions.shift(-lag) for lag in lags], axis=1)
    known = hidden.reindex(shown.index).notna()
    whole = known.all(axis=1).to_numpy() & features.notna().all(axis=1).to_numpy()
    edge = max(0, *lags) + max(0, *(-lag for lag in lags))
    if both.all() or lags == (0,):
        _say_missing(int((both & ~whole).sum()), edge, notes)
    else:
        count, blank = int(known.any(axis=1).sum()), int((known.any(axis=1) & ~known.all(axis=1)).sum())
        notes.append(
            f"{count - int(whole.sum())} of {count} rows of secrets have no decision at every lag"
            + (f" or, {blank} of them, lack a secret," if blank else "")
            + " and are left out; lags count the rows of both tables together"
        )
    if whole.sum() < LEAST_ROWS:
        by_lags = f"lags of up to {edge} rows: " if len(both) - edge < LEAST_ROWS <= len(both) else ""
        raise InputError(
            f"{by_lags}{int(whole.sum())} rows have a secret, a published decision and nothing missing, expected at least "
            f"{LEAST_ROWS}" + "".join(f"; {note}" for note in notes)
        )
    rows = shown.index[whole]
    # Types follow from complete rows: with a missing one, whole numbers would lose digits.
    complete = hidden.reindex(rows).infer_objects()
    targets = tuple(_target(complete[name], kind, notes) for name in complete.columns)
    columns, of_lag = [*decisions.columns] * len(lags), np.repeat(lags, decisions.shape[1])
    values = features[whole].to_numpy(dtype=np.float64)
    varies = ~validation.constant_columns(values)
    still = sorted({str(name) for name, moves in zip(columns, varies, strict=True) if not moves})
    if not varies.any():
        raise InputError(f"published decisions never change: {few(still)}; nothing can be learned from them")
    if still:
        notes.append(f"left out, since constant: {few(still)}")
    kept = np.flatnonzero(varies)
    return PairedRows(
        rows,
        targets,
        values[:, kept],
        tuple(str(columns[k]) for k in kept),
        tuple(int(of_lag[k]) for k in kept),
        tuple(notes),
    )


def _table(value: Any, name: str) -> pd.DataFrame:
    if isinstance(value, pd.DataFrame):
        table = value
    elif isinstance(value, pd.Series):
        table = value.to_frame(name if value.name is None else value.name)
    else:
        given = ordered_array(value, name, None)
        if given.ndim not in (1, 2):
            raise InputError(f"{name} must be rows of shape (T,) or (T,U), got shape {given.shape}")
        alone = given.ndim == 1 or given.shape[1] == 1
        columns = [name] if alone else [f"{name} {k + 1}" for k in range(given.shape[1])]
        table = pd.DataFrame(given[:, None] if given.ndim == 1 else given, columns=columns)
    if not table.columns.is_unique or not table.shape[1]:
        twice = list(dict.fromkeys(table.columns[table.columns.duplicated()]))
        raise InputError(f"{name} must have at least one column, each name once; twice: {few(twice) or 'none'}")
    if not table.index.is_unique:
        first = table.index[table.index.duplicated()][0]
        raise InputError(f"{name} has the row label {label_text(first)} twice, expected each once")
    return table


def _joined_by_place(given: Sequence[Any], tables: Sequence[pd.DataFrame]) -> bool:
    """Return whether rows are joined by place: a table is an array, or both count rows from 0, or one does and the other has
    labels of another type; raise `InputError` where both only count rows, from different numbers."""
    if not all(isinstance(each, (pd.DataFrame, pd.Series)) for each in given):
        return True
    bare = [_counts_rows(table) for table in tables]
    if all(bare) or (any(bare) and len({table.index.inferred_type for table in tables}) > 1):
        return True
    hidden, shown = (table.index for table in tables)
    firsts = _first_number(hidden), _first_number(shown)
    # Numbers from 0 or 1 may count rows; others, such as years, are labels.
    if len(hidden) == len(shown) and np.isfinite(firsts).all() and firsts[0] != firsts[1] and min(firsts) <= 1.0:
        raise InputError(
            f"rows of secrets are numbered {hidden[0]} to {hidden[-1]}, those of published {shown[0]} to {shown[-1]}, so it is "
            "not known which belong together: use labels such as dates on both, or the same numbers"
        )
    return False


def _first_number(index: pd.Index) -> float:
    """Return the first of labels that are consecutive numbers, also as text; NaN for others, such as dates."""
    if index.inferred_type not in ("integer", "floating", "string"):
        return float("nan")
    numbers = pd.to_numeric(index.to_numpy(), errors="coerce")
    return float(numbers[0]) if len(numbers) and (np.diff(numbers) == 1).all() else float("nan")


def _counts_rows(table: pd.DataFrame) -> bool:
    return bool(table.index.equals(pd.RangeIndex(len(table))))


def _joined_in_order(hidden: pd.DataFrame, shown: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame, Any]:
    if len(hidden) != len(shown):
        raise InputError(
            f"secrets have {len(hidden)} rows, published {len(shown)}: expected as many, or labels such as dates on both"
        )
    index = hidden.index if _counts_rows(shown) else shown.index
    return hidden.set_axis(index), shown.set_axis(index), np.ones(len(index), dtype=bool)


def _aligned(
    hidden: pd.DataFrame, shown: pd.DataFrame, lags: Sequence[int], notes: list[str]
) -> tuple[pd.DataFrame, pd.DataFrame, Any]:
    """Return the secrets, the decisions on the rows of either table in order of time, and which of these are in both.

    Lags count these rows, so that a row without a partner does not move the others. Labels that have no order, such as names,
    leave the rows of `published`.
    """
    # The order of time is that of comparable labels; other labels must have the same order in both tables.
    ordered = all(type(label) is not str for label in shown.index)
    if ordered and not shown.index.is_monotonic_increasing:
        k = next(k for k in range(1, len(shown)) if not shown.index[k] > shown.index[k - 1])
        raise InputError(
            f"published has {label_text(shown.index[k])} after {label_text(shown.index[k - 1])}, expected rows in order of time"
        )
    common = shown.index[shown.index.isin(hidden.index)]
    if not len(common):
        kinds = [str(each.index.dtype) for each in (hidden, shown)]
        said = f"; the labels of secrets are of type {kinds[0]}, those of published of type {kinds[1]}"
        zones = [getattr(each.index, "tz", None) is not None for each in (hidden, shown)]
        if zones[0] != zones[1]:
            said = f"; the times of {'secrets' if zones[0] else 'published'} alone have UTC offsets: write them in both files"
        raise InputError(
            f"no row label of secrets is one of published: {few(map(label_text, hidden.index), 3)} against "
            f"{few(map(label_text, shown.index), 3)}{said if kinds[0] != kinds[1] else ''}"
        )
    if not ordered and not hidden.index[hidden.index.isin(shown.index)].equals(common):
        raise InputError(
            "row labels of secrets and published stand in different orders, so time is not known: use dates"
        )
    for table, name in ((hidden, "secrets"), (shown, "published")):
        lost = len(table) - len(common)
        if lost and lags == (0,):
            left = next(label for label in table.index if label not in common)
            notes.append(
                f"{lost} of {len(table)} rows of {name} have no partner, such as {label_text(left)}, and are left out"
            )
    index = shown.index.union(hidden.index) if ordered else shown.index
    return hidden, shown.reindex(index), index.isin(common)


def _decisions(shown: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    """Return decisions as numbers: one indicator per choice where choices are words."""
    parts: list[pd.DataFrame] = []
    for name in shown.columns:
        column = shown[name].infer_objects()
        if _is_numeric(column):
            parts.append(_finite(column, "published").to_frame())
            continue
        words = _words(column, "published")
        _refuse_written_numbers(words, "published")
        choices = sorted(words.dropna().unique())
        if len(choices) > _MOST_CHOICES:
            raise InputError(
                f"published column {name!r} has {len(choices)} different texts, such as {choices[0]!r}: expected numbers, or "
                f"at most {_MOST_CHOICES} choices"
            )
        notes.append(f"published column {str(name)!r} is read as {len(choices)} choices: {few(choices)}")
        table = pd.DataFrame({f"{name} = {choice}": (words == choice).astype(float) for choice in choices})
        parts.append(table.where(words.notna(), np.nan, axis=0) if len(choices) else table)
    joined = pd.concat(parts, axis=1)
    if not joined.columns.is_unique:
        raise InputError(f"published has two columns that read as {joined.columns[joined.columns.duplicated()][0]!r}")
    return joined


def _target(column: pd.Series, kind: Kind | None, notes: list[str]) -> Target:
    name = str(column.name)
    numeric = _is_numeric(column)
    if kind == "numbers" and not numeric:
        raise InputError(f"secrets column {name!r} holds no numbers, such as {column.iloc[0]!r}: its kind is classes")
    read = _finite(column, "secrets") if numeric else _words(column, "secrets")
    if not numeric and kind is None:
        _refuse_written_numbers(read, "secrets")
    values = read.to_numpy()
    distinct = np.unique(values)
    if len(distinct) < 2:
        raise InputError(f"secrets column {name!r} is {distinct[0]} in every row: there is nothing to learn")
    whole = numeric and len(distinct) <= _MOST_CLASSES and bool((distinct % 1 == 0).all())
    if kind is None and whole:
        notes.append(f"secrets column {name!r} has {len(distinct)} whole numbers, which are taken for names of classes")
    if (kind or ("classes" if whole or not numeric else "numbers")) == "numbers":
        return Target(name, "numbers", (), values.astype(np.float64)[:, None])
    if len(distinct) > _MOST_CHOICES:
        raise InputError(
            f"secrets column {name!r} has {len(distinct)} different classes, such as {distinct[0]}, expected at most "
            f"{_MOST_CHOICES}"
        )
    indicators = (values[:, None] == distinct).astype(np.float64)
    is_float = distinct.dtype.kind == "f"
    names = (np.format_float_positional(each, trim="-") if is_float else str(each) for each in distinct)
    return Target(name, "classes", tuple(names), indicators)


def _is_numeric(column: pd.Series) -> bool:
    return pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)


def _finite(column: pd.Series, table: str) -> pd.Series:
    """Return finite floats, or whole numbers as they are: those above 2⁵³ are no floats."""
    if pd.api.types.is_integer_dtype(column):
        return column
    numbers = column.astype(np.float64)
    if np.isinf(numbers).any():
        label = column.index[int(np.asarray(np.isinf(numbers)).argmax())]
        raise InputError(
            f"{table} column {str(column.name)!r} is infinite in row {label_text(label)}, expected finite numbers"
        )
    return numbers


def _words(column: pd.Series, table: str) -> pd.Series:
    """Return text, truth values or categories as text; raise `InputError` for a mixture with numbers."""
    held = column.dropna()
    counts = [isinstance(each, Number) and not isinstance(each, (bool, np.bool_)) for each in held]
    if any(counts) and not all(counts):
        label, other = held.index[counts.index(False)], held.iloc[counts.index(False)]
        raise InputError(
            f"{table} column {str(column.name)!r} has {other!r} in row {label_text(label)} among numbers, expected one or the "
            "other"
        )
    return column.map(lambda each: each if pd.isna(each) else str(each)).astype(object)


def _refuse_written_numbers(words: pd.Series, table: str) -> None:
    """Raise `InputError` for a column of numbers with signs that make them text, such as 5%: as words they lose their order."""
    texts = words.dropna()
    if len(texts) and texts.map(lambda text: bool(_WRITTEN.fullmatch(text.strip()))).all():
        marked = texts[texts.map(lambda text: any(mark in text for mark in _MARKS))]
        if len(marked):
            cure = ", or ask for --kind classes (kind='classes')" if table == "secrets" else ""
            raise InputError(
                f"{table} column {str(words.name)!r} has numbers with signs that make them text, such as {marked.iloc[0]!r} in "
                f"row {label_text(marked.index[0])}: write .05 for 5%, and no currencies or thousands separators{cure}"
            )


def _say_missing(missing: int, edge: int, notes: list[str]) -> None:
    if missing > edge:
        notes.append(f"{missing} rows in which a secret or a decision is missing are left out; nothing is filled in")
    elif missing:
        notes.append(f"{missing} rows at the ends have no decision at every lag and are left out")
