"""Checks of arguments: each returns a clean array or raises one `InputError` that names the fault."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import date
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inscrutable import tolerances
from inscrutable.axes import Axis, Names, as_array, few, ordered
from inscrutable.errors import InputError, ModelError
from inscrutable.labels import label_text

Array = NDArray[np.float64]


Axes = Sequence[Axis | None]

_LARGE = 1e43  # numbers from which a size is no longer stated

MOST_NUMBERS = 2**27
"""Numbers in one table, a gigabyte: several such tables stand side by side during a computation."""

MOST_PROCESSES = 1024
"""More than the cores of one machine; every process also takes some hundred megabytes."""


def real_array(value: Any, name: str, axes: Axes | None = None) -> Array:
    """Return `value` as a float array of its own, labelled axes in the order that `axes` say (see `axes.ordered`).

    Masked entries become NaN.
    """
    plain = value if type(value) is np.ndarray else as_array(ordered(value, name, axes), name)
    if plain.dtype.kind == "c":
        raise InputError(f"{name} must be real numbers, got complex ones")
    if plain.dtype.kind in "mM":
        raise InputError(f"{name} must be numbers, got dates or spans of time ({plain.dtype})")
    if isinstance(plain, np.ma.MaskedArray):
        plain = np.ma.filled(plain.astype(np.float64), np.nan)
    try:
        return np.array(plain, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{name} must be numbers: {error}") from None


def finite_array(
    value: Any, name: str, *, ndim: int | tuple[int, ...], limits: bool = False, axes: Axes | None = None
) -> Array:
    """Return `value` as `real_array` does, of the given rank, without NaN, and without infinity unless `limits`."""
    array = real_array(value, name, axes)
    ranks = (ndim,) if isinstance(ndim, int) else ndim
    if array.ndim not in ranks:
        expected = " or ".join(f"{rank}-dimensional" for rank in ranks)
        raise InputError(f"{name} must be {expected}, got shape {array.shape}")
    finite = ~np.isnan(array) if limits else np.isfinite(array)
    if array.ndim == 0 and not finite:
        raise InputError(f"{name} must be finite, got {float(array)}")
    if not np.logical_and.reduce(finite, axis=None):
        bad = np.argwhere(~finite)[0]
        expected = "-inf or inf stands for no limit" if limits else "every entry must be finite"
        raise InputError(f"{name} has {array[tuple(bad)]} at index [{_place(bad)}]; {expected}")
    return array


def read_only(holder: object, *names: str) -> None:
    """Make the arrays of a frozen object read-only; other values stay as they are."""
    for name in names:
        value = getattr(holder, name)
        if isinstance(value, np.ndarray):
            seen = value.view()
            seen.flags.writeable = False
            object.__setattr__(holder, name, seen)


def _place(index: NDArray[np.intp]) -> str:
    return ", ".join(str(int(i)) for i in index)


def stochastic_rows(value: ArrayLike, name: str, *, ndim: int | tuple[int, ...] = 2, axes: Axes | None = None) -> Array:
    """Return `value` with non-negative rows that sum to one, renormalised within the tolerance."""
    plain = value if type(value) is np.ndarray else ordered(value, name, axes)
    rows = finite_array(plain, name, ndim=ndim)
    return _on_simplex(rows, name, max(tolerances.TRANSITION_SUM, _sum_rounding(plain, rows.shape[-1])))


def _sum_rounding(value: ArrayLike, size: int) -> float:
    """The rounding of a sum of `size` probabilities in the precision in which they are given, such as single precision."""
    dtype = getattr(value, "dtype", None)
    return size * float(np.finfo(dtype).eps) if isinstance(dtype, np.dtype) and dtype.kind == "f" else 0.0


def beliefs(
    value: ArrayLike, n_states: int, name: str = "belief", *, names: Names | None = None, rows: Axis | None = None
) -> Array:
    """Return one belief (X,) or many (T,X) as points of the simplex, aligned with the states' names.

    Raises `InputError` with the row, the entry and the amount for a wrong length, a negative entry
    or a sum that is not one.
    """
    plain = value if type(value) is np.ndarray else ordered(value, name, (rows, Axis("state", names)))
    array = finite_array(plain, name, ndim=(1, 2))
    if array.shape[-1] != n_states:
        which = f" ({few(names)})" if names else ""
        raise InputError(f"{name} has {array.shape[-1]} entries, expected one per state: {n_states}{which}")
    return _on_simplex(array, name, max(tolerances.BELIEF_SUM, _sum_rounding(plain, n_states)))


def one_belief(value: ArrayLike, n_states: int, name: str = "belief", *, names: Names | None = None) -> Array:
    """Return one belief as (X,); many are refused."""
    held = beliefs(value, n_states, name, names=names)
    if held.ndim != 1:
        raise InputError(f"{name} must be one belief of shape ({n_states},), got shape {held.shape}")
    return held


def many_beliefs(value: ArrayLike, n_states: int, *, names: Names | None = None) -> Array:
    """Return beliefs as (T,X) with T at least 1; a single belief becomes one row."""
    held = np.atleast_2d(beliefs(value, n_states, names=names))
    if not len(held):
        raise InputError("beliefs has no rows; expected at least one belief")
    return held


def _on_simplex(array: Array, name: str, tolerance: float) -> Array:
    lowest = np.minimum.reduce(array, axis=None, initial=0.0)
    if lowest < -tolerance:
        bad = np.argwhere(array < -tolerance)[0]
        raise InputError(f"{name} has {array[tuple(bad)]:g} at index [{_place(bad)}]; probabilities must be >= 0")
    sums = np.add.reduce(array, axis=-1)
    errors = abs(sums - 1.0)
    error = errors if array.ndim == 1 else np.maximum.reduce(errors, axis=None, initial=0.0)
    if error > tolerance:
        wrong = np.argwhere(np.atleast_1d(errors) > tolerance)[0]
        row = "" if array.ndim == 1 else f" row {_place(wrong)}"
        raise InputError(f"{name}{row} sums to {np.atleast_1d(sums)[tuple(wrong)]:.10g}, expected 1")
    clipped = np.maximum(array, 0.0)
    if lowest == 0.0 and error <= tolerances.SUM_ROUNDING:
        return clipped
    total = clipped.sum(axis=-1, keepdims=True)
    return np.asarray(np.where(np.abs(total - 1.0) <= tolerances.SUM_ROUNDING, clipped, clipped / total))


def check_positive_semidefinite(matrix: Array, name: str, why: str) -> None:
    """Raise `InputError` for an asymmetric and `ModelError` for an indefinite matrix, with its smallest eigenvalue."""
    largest = np.abs(matrix).max(initial=0.0)
    skew = np.abs(matrix - matrix.T)
    if skew.max(initial=0.0) > tolerances.SYMMETRY * largest:
        row, column = np.unravel_index(int(skew.argmax()), skew.shape)
        raise InputError(f"{name} is not symmetric: entries [{row}, {column}] differ by {skew.max():.3g}")
    eigenvalues = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
    if eigenvalues[0] < -tolerances.CURVATURE * max(eigenvalues[-1], 0.0) or eigenvalues[-1] < 0:
        condition = abs(eigenvalues[-1] / eigenvalues[0])
        raise ModelError(
            f"{name} is indefinite: smallest eigenvalue {eigenvalues[0]:.3g}, largest {eigenvalues[-1]:.3g} "
            f"(ratio {condition:.3g}); {why}"
        )


def constant_columns(table: Array) -> NDArray[np.bool_]:
    """Return which columns of a table (T,D) vary by rounding alone; the standard deviation of equal numbers is not always 0."""
    with np.errstate(over="ignore"):
        return np.asarray(np.ptp(table, axis=0) <= tolerances.CONSTANT_COLUMN * np.abs(table).max(axis=0))


def points(value: ArrayLike, size: int, axis: Axis, name: str = "action") -> Array:
    """Return decisions or beliefs (…,size) as floats, in the order of the axis' labels; an array of floats is not copied."""
    is_plain = type(value) is np.ndarray and value.dtype == np.float64
    found = np.asarray(value) if is_plain else real_array(value, name, (axis,))
    if found.ndim == 0 or found.shape[-1] != size:
        raise InputError(f"{name} has shape {found.shape}, expected {size} coordinates in the last axis")
    return found


def time_order(index: Any, name: str) -> None:
    """Raise `InputError` where an index of dates goes back in time; other labels have no order."""
    import pandas as pd

    if index.dtype == object and len(index) and all(isinstance(each, date) for each in index):
        index = pd.DatetimeIndex(index)
    if not isinstance(index, (pd.DatetimeIndex, pd.PeriodIndex)):
        return
    back = np.flatnonzero(np.diff(index.asi8) < 0)
    if back.size:
        at = int(back[0])
        raise InputError(
            f"{name} must be in the order of time: after {label_text(index[at])} comes {label_text(index[at + 1])}"
        )


def positive(value: Any, name: str) -> float:
    """Return `value` as a finite float above zero."""
    number = number_of(value, name)
    if number <= 0:
        raise InputError(f"{name} must be above 0, got {number:g}")
    return number


def non_negative(value: Any, name: str) -> float:
    """Return `value` as a finite float of at least zero."""
    number = number_of(value, name)
    if number < 0:
        raise InputError(f"{name} must be at least 0, got {number:g}")
    return number


def number_of(value: Any, name: str) -> float:
    """Return `value` as a finite float."""
    if isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} must be a number, got {value!r}")
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a number, got {value!r}") from None
    if not np.isfinite(number):
        raise InputError(f"{name} must be finite, got {number}")
    return number


def count(value: Any, name: str, *, least: int = 1) -> int:
    """Return `value` as an int of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < least:
        raise InputError(f"{name} must be a whole number of at least {least}, got {value!r}")
    return int(value)


def excess(value: int, table: str, size: Callable[[int], float], others: str = "other sizes") -> str:
    """Return why a value needs a table of more than `MOST_NUMBERS` numbers, and which value fits; empty where it fits."""
    taken = size(value)
    if taken <= MOST_NUMBERS:
        return ""
    room = f"{taken:.3g} numbers, {8.0 * taken / 2.0**30:.3g} GB" if taken < _LARGE else "more than any machine"
    low, high = 0, value
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if size(middle) <= MOST_NUMBERS else (low, middle)
    advice = f"expected at most {low:,}" if low else f"no value of it fits: {others} have to be smaller"
    return f"{value:,} is too large: {table} would take {room}, where {MOST_NUMBERS:,} fit; {advice}"


def check_room(value: int, name: str, table: str, size: Callable[[int], float]) -> None:
    """Raise `InputError` where a value needs a table that is larger than memory."""
    said = excess(value, table, size)
    if said:
        raise InputError(f"{name} {said}")


def processes(value: Any, name: str) -> int:
    """Return `value` as a number of processes: from 1 to `MOST_PROCESSES`, or -1 for one per core."""
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or (value != -1 and not 1 <= value <= MOST_PROCESSES):
        raise InputError(
            f"{name} must be a number of processes from 1 to {MOST_PROCESSES:,}, or -1 for one per core, got {value!r}"
        )
    return int(value)


def generator(rng: Any) -> np.random.Generator:
    """Return `rng` if it is a `numpy.random.Generator`; nothing else is accepted, so every draw can be repeated."""
    if not isinstance(rng, np.random.Generator):
        raise InputError(f"rng must be a numpy.random.Generator such as numpy.random.default_rng(0), got {rng!r}")
    return rng
