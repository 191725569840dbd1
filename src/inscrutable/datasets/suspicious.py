"""Tests for errors in returns: implausible sizes, repeated values, splits and gaps, with row and column.

They only warn and change nothing. Real returns have heavy tails, so the null law is Student's t with three degrees of freedom,
heavier-tailed than nearly all markets.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from itertools import pairwise

import numpy as np
import pandas as pd

from inscrutable import tolerances
from inscrutable.labels import label_text
from inscrutable.validation import Array

_LISTED = 8
_RATIOS = (2.0, 3.0, 4.0, 5.0, 10.0)
"""Ratios of share splits and mergers."""

_MISSING_CODE = -0.99
"""A return of at most this is a total loss, or a code for a missing number, such as -99.99 or -999, divided by 100 or 1,000."""

_AROUND = 24
"""Number of rows for the local scale around a row."""

MOST_RISKLESS = 0.05
"""Riskless returns of a row above this are percentages, not fractions; so are those of a column that never falls."""

_MAD = 1.4826  # makes the median absolute deviation a standard deviation for normal data
_MEDIAN_OF_T = 0.7649  # the median of |T|


def suspicious_entries(returns: pd.DataFrame) -> tuple[str, ...]:
    """Return a warning for every entry of a table of returns that is almost surely an error.

    Args:
        returns: (T,U) finite simple returns as fractions, dates or labels as index, one column per asset.

    Returns:
        One sentence each, in the order: returns too large for any market, steps that look like a split, columns that repeat
        another one, columns that are a combination of others, values repeated row after row and columns that only rise, gaps
        between dates. Empty where no entry is suspicious. On 300 rows of 12 columns of Student's t with three degrees of
        freedom and 6 % a row, fewer than one table in a hundred gives a warning.

    Cost: O(T U log T + T U² + U³).

    Example:
        >>> months = pd.date_range("2020-01", periods=60, freq="ME")
        >>> moves = np.random.default_rng(0).normal(0.01, 0.04, size=(60, 2))
        >>> moves[10, 0] = 12.0
        >>> suspicious_entries(pd.DataFrame(moves, index=months, columns=["A", "B"]))
        ('A on 2020-11-30: a return of +1200%, where a usual move is 4.1%',)
    """
    values = returns.to_numpy(dtype=np.float64)
    if not values.size:
        return ()
    centred = values - np.median(values, axis=0)
    scale = np.array([_scale(column) for column in centred.T])
    beyond = _beyond_belief(values, centred, scale)
    found = [_size_text(returns, row, column, scale) for row, column in np.argwhere(beyond)]
    found += [_split_text(returns, row, column) for row, column in _splits(values) if not beyond[row, column]]
    copies = _copies(values)
    found += [_copy_text(returns, *pair) for pair in copies]
    found += _combined_columns(returns, np.delete(np.arange(values.shape[1]), [column for column, _ in copies]))
    for column in range(values.shape[1]):
        found += _repeats(returns, column)
        usual = float(np.median(values[:, column]))
        if len(values) >= _AROUND and values[:, column].min() >= 0.0 and usual > MOST_RISKLESS:
            found.append(
                f"{label_text(returns.columns[column])}: it never falls and rises by {usual:.0%} a row, as percentages do"
            )
    gaps = missing_steps(list(returns.index)) if isinstance(returns.index, pd.DatetimeIndex) else ""
    told = found[:_LISTED] + ([f"{len(found) - _LISTED} more entries like these"] if len(found) > _LISTED else [])
    return (*told, *([gaps] if gaps else []))


def missing_steps(days: Sequence[datetime]) -> str:
    """Return which rows are missing between increasing dates, or are too many, as text; empty if none.

    For steps of whole months the text names the months; for denser rows it names gaps longer than any run of holidays.
    """
    months, usual = _months(days)
    if usual:
        missing = [
            _month_text(month)
            for before, after in pairwise(months)
            if after - before > usual
            for month in range(before + usual, after, usual)
        ]
        twice = crowded_months(days)
        more = f"more than one row for {_few(twice)}: each is taken for a step of its own" if twice else ""
        return "; ".join(filter(None, [_gap_text("no row for", missing), more]))
    if len(days) <= _AROUND:
        return ""  # too few rows to determine the usual step
    lengths = [(after - before).total_seconds() / 86400.0 for before, after in pairwise(days)]
    longest = max(tolerances.LONGEST_HOLIDAYS, 1.9 * float(np.median(lengths)))
    spans = [
        f"{before:%Y-%m-%d} and {after:%Y-%m-%d}"
        for (before, after), length in zip(pairwise(days), lengths, strict=True)
        if length > longest
    ]
    return _gap_text("no row between", spans)


def crowded_months(days: Sequence[datetime]) -> list[str]:
    """Return the months with more than one row, where rows are usually one or more months apart."""
    months, usual = _months(days)
    return [_month_text(month) for month, count in Counter(months).items() if count > 1] if usual else []


def _months(days: Sequence[datetime]) -> tuple[list[int], int]:
    """Months of dates, counted from year 0, and the usual step between them; 0 where rows are denser or no step is usual."""
    months = [12 * day.year + day.month - 1 for day in days]
    steps = Counter(after - before for before, after in pairwise(months))
    usual, times = steps.most_common(1)[0] if steps else (0, 0)
    # Rows twice a month are no rows too many: where some share a month, nearly all others must be apart.
    least = 0.5 if 0 not in steps else 0.9
    if times > least * (len(days) - 1):
        return months, usual
    # January, February, June: no step is usual, and the smallest fits into each.
    shortest = min(steps, default=0)
    return months, shortest if shortest and all(step % shortest == 0 for step in steps) else 0


def _month_text(month: int) -> str:
    return f"{month // 12}-{month % 12 + 1:02d}"


def _gap_text(what: str, named: list[str]) -> str:
    return f"{what} {_few(named)}: the row after a gap is taken for the next step, like any other" if named else ""


def _few(named: list[str]) -> str:
    return ", ".join(named[:_LISTED]) + (f" and {len(named) - _LISTED} more" if len(named) > _LISTED else "")


def _scale(centred: Array) -> float:
    """Return a robust standard deviation; of the nonzero moves where more than half of a column is zero."""
    spread = float(np.median(np.abs(centred)))
    if spread == 0.0 and centred.any():
        spread = float(np.median(np.abs(centred[centred != 0.0])))
    return _MAD * spread


def _beyond_belief(values: Array, centred: Array, scale: Array) -> Array:
    """Return which returns (T,U) are too large for any market, or total losses."""
    far = np.abs(centred) > tolerances.SURELY_WRONG_MOVE * np.where(scale > 0, scale, np.inf)
    return np.asarray(far | (values > tolerances.SURELY_WRONG_RETURN) | (values <= _MISSING_CODE))


def _size_text(returns: pd.DataFrame, row: int, column: int, scale: Array) -> str:
    value = float(returns.iloc[:, column].to_numpy()[row])
    code = " (-99.99 and -999 often stand for missing numbers)" if value <= _MISSING_CODE else ""
    return f"{_place(returns, row, column)}: a return of {value:+.0%}{code}, where a usual move is {scale[column]:.1%}"


def _splits(values: Array) -> list[tuple[int, int]]:
    """Return cells (row, column) whose price ratio is nearly that of a split, far from all other moves.

    Moves are relative to the row's median if there are several columns, in units z of the column's scale and of its local
    scale. With F(z) = P(T > z) and λ = 2 n F(m), the chance that one of n rows falls into a split's window z ± w and no other
    row is beyond m is about n (F(z − w) − F(z + w)) e^−λ, and that in each other column at most one row is beyond m, e^−λ (1 +
    λ). Others are those of the column, or those of the table, second largest of each column.
    """
    n_rows, n_columns = values.shape
    if n_rows < _AROUND:
        return []
    moves = values - np.median(values, axis=1, keepdims=True) if n_columns > 2 else values
    moves = moves - np.median(moves, axis=0)
    whole = np.array([_scale(column) for column in moves.T])
    columns = np.flatnonzero(whole > 0)
    if not columns.size:
        return []
    least = np.ones(n_columns)
    rows = np.abs(moves).argmax(axis=0)
    for scale in (np.tile(whole, (n_rows, 1)), _local_scale(moves, whole)):
        sizes = np.abs(moves[:, columns]) / scale[:, columns]
        second = np.sort(sizes, axis=0)[-2]
        expected = 2.0 * n_rows * _tail(float(second.max()))
        elsewhere = (len(columns) - 1) * (math.log1p(expected) - expected) - expected
        for column, next_largest in zip(columns, second, strict=True):
            row = int(rows[column])
            window = _split_window(1.0 + float(values[row, column]), float(scale[row, column]))
            alone = max(-2.0 * n_rows * _tail(float(next_largest)), -700.0)
            chance = n_columns * n_rows * window * math.exp(min(alone, max(elsewhere, -700.0)))
            least[column] = min(least[column], chance)
    return [(int(rows[column]), int(column)) for column in columns if least[column] < tolerances.SPLIT_CHANCE]


def _split_window(ratio: float, unit: float) -> float:
    """Return the tail probability of moves within the window of the nearest split; infinite where no split is near."""
    split = _nearest_ratio(ratio)
    apart, room = abs(1.0 - split) / unit, tolerances.SPLIT_ROOM * split
    if abs(ratio - split) > room * unit or apart <= 2.0 * room:
        return math.inf
    return _tail(apart - room) - _tail(apart + room)


def _nearest_ratio(ratio: float) -> float:
    """Return the split ratio, up or down, nearest to a price ratio."""
    return min((*_RATIOS, *(1.0 / each for each in _RATIOS)), key=lambda each: abs(ratio / each - 1.0))


def _local_scale(moves: Array, whole: Array) -> Array:
    """Return robust local standard deviations (T,U), at least half of the column's."""
    sizes = np.pad(np.abs(moves), ((_AROUND // 2, _AROUND // 2), (0, 0)), mode="reflect")
    near = np.lib.stride_tricks.sliding_window_view(sizes, 2 * (_AROUND // 2) + 1, axis=0)
    return np.asarray(np.maximum(_MAD * np.median(near, axis=-1), 0.5 * whole))


def _tail(z: float) -> float:
    """P(T > z) of Student's t with three degrees of freedom, z in its own robust standard deviations."""
    x = z * _MAD * _MEDIAN_OF_T / math.sqrt(3.0)
    return 0.5 - (x / (1.0 + x * x) + math.atan(x)) / math.pi


def _split_text(returns: pd.DataFrame, row: int, column: int) -> str:
    ratio = 1.0 + float(returns.iloc[:, column].to_numpy()[row])
    nearest = _nearest_ratio(ratio)
    kind = f"1 to {1.0 / nearest:.0f}" if nearest < 1 else f"{nearest:.0f} to 1"
    return (
        f"{_place(returns, row, column)}: a return of {ratio - 1.0:+.1%}, alone in its column: it looks like a split of "
        f"{kind} in unadjusted prices"
    )


def _copies(values: Array) -> list[tuple[int, int]]:
    """Return columns whose returns are those of an earlier one in every row, and that; rounded ones are by chance in few."""
    first: dict[bytes, int] = {}
    found = []
    for column in range(values.shape[1] if len(values) >= tolerances.LEAST_REPEATS else 0):
        earlier = first.setdefault(np.ascontiguousarray(values[:, column] + 0.0).tobytes(), column)
        if earlier != column and np.unique(values[:, column]).size > 1:
            found.append((column, earlier))
    return found


def _copy_text(returns: pd.DataFrame, column: int, earlier: int) -> str:
    names = label_text(returns.columns[column]), label_text(returns.columns[earlier])
    return (
        f"{names[0]}: the same returns as {names[1]} in every row; how weight is divided between the two is arbitrary"
    )


def _combined_columns(returns: pd.DataFrame, columns: np.ndarray) -> list[str]:
    """Return columns that are a constant plus a combination of others, which enough rows to tell show.

    With the correlations' least eigenvalue λ and its vector v, the others leave λ/v_j² of column j unexplained, or less.
    """
    values = returns.to_numpy(dtype=np.float64)[:, columns]
    columns, values = columns[np.ptp(values, axis=0) > 0], values[:, np.ptp(values, axis=0) > 0]
    found: list[str] = []
    while 1 < len(columns) < len(values) / 2 and len(found) < _LISTED:
        eigenvalues, vectors = np.linalg.eigh(np.corrcoef(values.T))
        vector = np.abs(vectors[:, 0])
        last = int(vector.argmax())
        if eigenvalues[0] > tolerances.COMBINED_COLUMNS * vector[last] ** 2:
            break
        named = [label_text(returns.columns[column]) for column in columns]
        others = [named[j] for j in np.flatnonzero(vector > tolerances.COMBINATION_PART) if j != last]
        found.append(f"{named[last]}: a combination of {_few(others)} in every row; their weights are not unique")
        columns, values = np.delete(columns, last), np.delete(values, last, axis=1)
    return found


def _repeats(returns: pd.DataFrame, column: int) -> list[str]:
    """Return runs of a repeated value that are longer than chance explains."""
    own = returns.iloc[:, column].to_numpy(dtype=np.float64)
    starts = np.flatnonzero(np.concatenate([[True], own[1:] != own[:-1]]))
    lengths = np.diff(np.append(starts, len(own)))
    longest = int(lengths.max())
    # Rounded values repeat by chance: as often as outside the longest run, or as the value itself outside its run.
    often = (len(own) - len(starts) - (longest - 1)) / max(len(own) - longest, 1)
    found = []
    for start, length in zip(starts, lengths, strict=True):
        if length < tolerances.LEAST_REPEATS:
            continue
        others = (np.count_nonzero(own == own[start]) - length) / max(len(own) - length, 1)
        if max(often, others) ** (length - 1.0) * len(own) > tolerances.SPLIT_CHANCE:
            continue
        found.append(
            f"{label_text(returns.columns[column])} from {_row(returns, int(start))} to "
            f"{_row(returns, int(start + length - 1))}: the same return, {own[start]:.4g}, in {length} rows running; prices "
            "that stand still or cells that were filled in"
        )
    return found


def _place(returns: pd.DataFrame, row: int, column: int) -> str:
    return f"{label_text(returns.columns[column])} on {_row(returns, row)}"


def _row(returns: pd.DataFrame, row: int) -> str:
    return label_text(returns.index[row])
