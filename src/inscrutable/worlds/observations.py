"""Checks of observations: real vectors, with or without column labels, and symbols."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inscrutable import validation
from inscrutable.axes import Axis, depth
from inscrutable.errors import InputError
from inscrutable.validation import Array

Labels = tuple[Hashable, ...]


def is_labelled(observations: Any) -> bool:
    """Whether `observations` is a pandas object, recognised by its index so that pandas need not be imported."""
    return hasattr(observations, "index") and hasattr(observations, "to_numpy")


def row_name(observations: Any, row: int) -> str:
    """Name a row by its number and, if it has one, its label."""
    return f"{row} ({observations.index[row]})" if is_labelled(observations) else str(row)


def column_labels(observations: Any) -> Labels | None:
    """Return the column labels of a pandas object, the name of a series, or None; refuse a label that occurs twice."""
    if not is_labelled(observations):
        return None
    if not hasattr(observations, "columns"):
        return None if observations.name is None else (observations.name,)
    labels = tuple(observations.columns)
    twice = [label for label in dict.fromkeys(labels) if labels.count(label) > 1]
    if twice:
        raise InputError(
            f"observations have the column {twice[0]!r} {labels.count(twice[0])} times; columns must differ"
        )
    return labels


def labels_of(saved: Any) -> Labels | None:
    """Return labels from plain data, where a label of several levels is a list."""
    return None if saved is None else tuple(tuple(each) if isinstance(each, list) else each for each in saved)


def real_rows(observations: Any, assets: Axis | None = None) -> Array:
    """Return observations as a finite (T,D) array; columns are put in the order of `assets`, None for their own."""
    found = column_labels(observations)
    known = None if assets is None else assets.names
    if found is not None and known is not None and len(found) > len(known) and set(known) <= set(found):
        observations, found = observations[list(known)], known  # a wider table is no error
    axes = (None, assets)[: max(depth(observations), 1)]
    rows = np.ascontiguousarray(validation.real_array(observations, "observations", axes))
    if hasattr(observations, "columns"):
        found = known or found
    if rows.ndim == 1:
        rows = rows[:, None]
    if rows.ndim != 2 or rows.size == 0:
        raise InputError(f"observations must be (T,D) or, for one dimension, (T,) with T >= 1, got shape {rows.shape}")
    bad = np.argwhere(~np.isfinite(rows))
    if bad.size:
        t, d = (int(i) for i in bad[0])
        column = f"{d}" if found is None else f"{d} ({found[d]})"
        raise InputError(
            f"observations have {rows[t, d]} in row {row_name(observations, t)}, column {column}; "
            f"every entry must be finite ({len(bad)} are not)"
        )
    return rows


def in_rows(observations: Any, rows: Axis, name: str = "observations") -> Any:
    """Return observations, called `name` in messages, with their labelled rows in the order of `rows`."""
    order = rows.order(tuple(observations.index), name) if is_labelled(observations) else None
    return observations if order is None else observations.iloc[order]


def symbols(
    observations: Any, n_symbols: int, name: str = "observations", rows: Axis | None = None
) -> NDArray[np.int64]:
    """Return observations, called `name` in messages, as whole numbers (T,) in 0..n_symbols-1."""
    values = validation.real_array(observations, name, (rows, None)[: depth(observations)])
    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    if values.ndim != 1 or values.size == 0:
        raise InputError(f"{name} must be a sequence (T,) of symbols with T >= 1, got shape {values.shape}")
    bad = np.flatnonzero(~((values >= 0) & (values < n_symbols) & (values == np.floor(values))))
    if bad.size:
        row = int(bad[0])
        raise InputError(
            f"{name} have {values[row]:g} in row {row_name(observations, row)}; "
            f"symbols are whole numbers from 0 to {n_symbols - 1}"
        )
    return np.asarray(values.astype(np.int64))
