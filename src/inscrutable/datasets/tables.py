"""Readers for a user's CSV files: labels kept, dates parsed, every error with its line and column.

All files have one header line and UTF-8 text (a byte order mark and Windows line ends are fine). Commas separate cells; if the
header has none, semicolons, tabs or bars do, and numbers may then have decimal commas. Line numbers in messages are those of
the file; the header is line 1. Blank lines are skipped, and blanks around a cell dropped; otherwise labels are kept as written.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from inscrutable import tolerances, validation
from inscrutable.datasets._cells import TextTable, decimal_digits, is_number, numbers, read_text_table
from inscrutable.datasets._dates import date_index, is_date, label_index
from inscrutable.errors import InputError

PathLike = str | os.PathLike[str]

FULL_PRECISION_DIGITS = 8
"""From this many decimals on, weights count as exact, with this accuracy: published weights are not rounded to eight digits."""

_LISTED = 8


def decimal_places(count: int) -> str:
    """Return how many decimals in words."""
    return f"{count} decimal{'' if count == 1 else 's'}"


@dataclass(frozen=True)
class WeightsTable:
    """Weights as written in a file, and their number of decimals.

    Args:
        frame: (T,U) raw weights, columns in the model's order of assets; the index holds dates, labels or row numbers.
        decimals: Largest number of decimal digits in the file, None from eight on; a weight may be off by half a unit of that
            digit.
        left_out: Largest share of a row's value outside the model's assets, such as cash.
        others: The labels left out.
        missing: Assets of the model without a column in a wide file of holdings, whose weights are therefore 0.
        owed: The labels left out with an amount below 0, such as borrowed cash.
        sums: Least and greatest sum of fractions or percentages in a row, as a share, where these do not add up to the whole.
    """

    frame: pd.DataFrame
    decimals: int | None
    left_out: float = 0.0
    others: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    owed: tuple[str, ...] = ()
    sums: tuple[float, float] | None = None

    def cautions(self) -> list[str]:
        """Return what was left out of the weights as they are read and what may be wrong with them, a sentence each."""
        told = []
        if self.missing:
            told.append(
                f"Caution: the file has no column for {', '.join(self.missing)}; the weight there counts as 0, and the others "
                "are scaled to the sum 1."
            )
        if self.sums:
            low, high = (f"{100.0 * each:.5g}%" for each in self.sums)
            told.append(
                f"Caution: the weights add up to {low if low == high else f'{low} to {high}'}, not to 100%, and are scaled to "
                "the sum 1; a holding may be missing, or stand twice."
            )
        if self.left_out > 0:
            named = f" ({', '.join(self.others)})" if self.others else ""
            told.append(
                f"Note: up to {self.left_out:.1%} of a row's value is left out{named}; the weights are those of the rest, "
                "scaled to the sum 1."
            )
        if self.owed:
            told.append(
                f"Caution: {', '.join(self.owed)} is below 0, a debt: the weights are read without it, as if the same assets "
                "were held with no leverage."
            )
        if self.decimals == 0 and bool((self.frame == self.frame.round()).all(axis=None)):
            told.append(
                "Caution: whole numbers are read as weights rounded to whole numbers, which say little; exact ones are written "
                "with eight decimals, such as 1.00000000."
            )
        return told

    def summary(self) -> str:
        """Return the numbers of rows and assets and the rounding, as one line."""
        precision = "full precision" if self.decimals is None else f"rounded to {decimal_places(self.decimals)}"
        return f"{len(self.frame)} rows of weights of {self.frame.shape[1]} assets, {precision}"


def simple_returns(prices: pd.DataFrame) -> pd.DataFrame:
    """Return simple returns of prices, r_t = p_t / p_{t-1} - 1.

    Args:
        prices: (T,U) prices, positive and finite, in order of time.

    Returns:
        (T-1,U) returns as fractions, labels kept; each stands at the later of its two dates.

    Raises:
        InputError: There are fewer than two rows, or a price is missing, infinite or not above 0; the message names
            the cell.

    Cost: O(T U).

    Example:
        >>> from inscrutable.datasets import simple_returns
        >>> simple_returns(pd.DataFrame({"A": [100.0, 110.0, 99.0]})).round(10)["A"].tolist()
        [0.1, -0.1]
    """
    if not isinstance(prices, pd.DataFrame):
        raise InputError(f"prices must be a DataFrame with a column per asset, got {type(prices).__name__}")
    if len(prices) < 2:
        raise InputError(f"prices have {len(prices)} row, expected at least 2 to form a return")
    values = validation.real_array(prices.to_numpy(), "prices")
    bad = np.argwhere(~(np.isfinite(values) & (values > 0)))
    if bad.size:
        row, column = (int(i) for i in bad[0])
        raise InputError(
            f"price of {prices.columns[column]!r} at {prices.index[row]} is {values[row, column]:g}, "
            "expected a finite number above 0"
        )
    return pd.DataFrame(values[1:] / values[:-1] - 1.0, index=prices.index[1:], columns=prices.columns)


def read_returns(path: PathLike, *, prices: bool = False) -> pd.DataFrame:
    """Read simple returns, or prices to be turned into them, from a CSV file with dates in its first column.

    Args:
        path: The file. First column: strictly increasing dates as 2020-01-31, 2020-01 (the end of that month),
            20200131, 31.01.2020, 31-Jan-2020, 01/2020, or with slashes where only one order of day and month fits; a time
            of day is kept; times with offsets from UTC become UTC, midnights alone stay days. Every other column: one asset,
            numbers in every row.
        prices: False: the numbers are simple returns as fractions, 0.01 for one per cent, not below -1. True: they are
            prices above 0, and r_t = p_t / p_{t-1} - 1 is returned; the first date drops out.

    Returns:
        (T,U) simple returns as fractions, a DatetimeIndex, columns labelled as in the file. A row's return is the one
        earned up to its date.

    Raises:
        InputError: With file, line and column: missing, empty or unreadable file, only a header, no asset column, decimal
            commas beside points, duplicated or blank column names, rows of another length, text or missing or infinite
            cells, dates that are missing, unreadable, ambiguous, duplicated or not in order, prices not above 0,
            returns below -1, and returns that look like percentages or prices (most of them above 1 in size).

    Cost: O(T U), about a microsecond a cell. No value is filled in, sorted or rescaled.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable.datasets import read_returns
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "prices.csv")
        ...     _ = file.write_text("date,A,B\\n2020-01,100,50\\n2020-02,110,49\\n")
        ...     print(read_returns(file, prices=True).round(4))
                      A     B
        date
        2020-02-29  0.1 -0.02
    """
    table = _dated_table(path, "asset")
    index = date_index(table)
    columns = range(1, len(table.header))
    values = numbers(table, columns)
    frame = pd.DataFrame(values, index=index, columns=table.labels_from(1))
    if not prices:
        _check_fractions(table, values)
        return frame
    if len(frame) < 2:
        raise InputError(f"{table.path} has 1 row of prices, expected at least 2 to form a return")
    for row, column in np.argwhere(values <= 0):
        place = table.place(int(row), int(column) + 1)
        raise InputError(f"{place}: price {values[row, column]:g}, expected above 0")
    with np.errstate(over="ignore", under="ignore"):
        returns = simple_returns(frame)
    for row, column in np.argwhere(~np.isfinite(returns.to_numpy())):
        place = table.place(int(row) + 1, int(column) + 1)
        raise InputError(f"{place}: price {values[row + 1, column]:g} after {values[row, column]:g}, too far apart")
    return returns


def read_beliefs(path: PathLike, *, names: Sequence[str] | None = None) -> pd.DataFrame:
    """Read dated beliefs over the regimes, one row on the simplex per date, from a CSV file.

    Args:
        path: The file. First column: strictly increasing dates, as for `read_returns`. Every other column: the
            probability of one regime, at least 0. A row may miss the sum 1 by 5e-3, or by what rounding to the file's decimals
            explains, X/2 units of the last, at most 0.05; it is then divided by its sum.
        names: (X,) names of the regimes. Columns are matched to them by label, in any order, and returned in the order
            of `names`. None: as in the file.

    Returns:
        (T,X) beliefs whose rows sum to one, a DatetimeIndex, columns labelled by regime.

    Raises:
        InputError: With file, line and column: everything `read_returns` raises about files, cells and dates, a
            probability below 0, a row whose sum is not 1, and regimes that are missing or unknown.

    Cost: O(T X).

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable.datasets import read_beliefs
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "beliefs.csv")
        ...     _ = file.write_text("date,calm,crisis\\n2020-01,0.9,0.1\\n2020-02,0.25,0.75\\n")
        ...     print(read_beliefs(file, names=["crisis", "calm"]))
                    crisis  calm
        date
        2020-01-31    0.10  0.90
        2020-02-29    0.75  0.25
    """
    table = _dated_table(path, "regime")
    wanted = list(table.header[1:]) if names is None else _unique(names, "names")
    columns = _aligned(table, wanted, first=1, noun="regime")
    index = date_index(table)
    values = numbers(table, columns)
    for row, column in np.argwhere(values < -tolerances.BELIEF_SUM):
        place = table.place(int(row), columns[column])
        raise InputError(f"{place}: probability {values[row, column]:g}, expected at least 0")
    rounding = _sum_rounding(len(columns), decimal_digits(table, columns))
    allowed = max(tolerances.BELIEF_TABLE_SUM, min(rounding, tolerances.COARSEST_BELIEF_SUM))
    _check_sums(table, values, allowed, "probabilities")
    clipped = np.maximum(values, 0.0)
    return pd.DataFrame(clipped / clipped.sum(axis=1, keepdims=True), index=index, columns=pd.Index(wanted))


def read_signals(path: PathLike) -> pd.DataFrame:
    """Read dated numbers of any kind from a CSV file, one signal per column.

    Args:
        path: The file. First column: strictly increasing dates, as for `read_returns`. Every other column: numbers.

    Returns:
        (T,K) numbers, a DatetimeIndex, columns labelled as in the file.

    Raises:
        InputError: With file, line and column: everything `read_returns` raises about files, cells and dates.

    Cost: O(T K).

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable.datasets import read_signals
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "signal.csv")
        ...     _ = file.write_text("date,spread\\n2020-01,1.5\\n2020-02,2.5\\n")
        ...     print(read_signals(file).to_numpy().tolist())
        [[1.5], [2.5]]
    """
    table = _dated_table(path, "signal")
    values = numbers(table, range(1, len(table.header)))
    return pd.DataFrame(values, index=date_index(table), columns=table.labels_from(1))


def read_weights(path: PathLike, *, assets: Sequence[str], net: float | None = 1.0) -> WeightsTable:
    """Read published portfolio weights, one row per portfolio, aligned to a model's assets by label.

    Args:
        path: The file. One column per asset, in any order, 0 for what is not held. The first column is the rows' label
            if its name is not one of `assets` (dates are parsed if the whole column reads as dates, it is kept as text if at
            most half does, and otherwise refused); if it is an asset, rows are numbered from 0.
        assets: (U,) labels of the model's assets.
        net: What the weights of a row sum to; None: anything.

    Returns:
        `frame` (T,U) with the weights as written, in the order of `assets`: rows are not rescaled, because the inference uses
        the published rounding. `decimals` counts the digits after the point in the text (0.2500 has four), None from eight on.

    Raises:
        InputError: With file, line and column: everything `read_returns` raises about files and cells, labels that are
            blank, duplicated or no date where most are, assets that are missing or unknown (all listed), and rows that miss the
            sum `net` by more than `tolerances.PUBLISHED_SUM` and than rounding explains: U half units of the last digit, at
            most `tolerances.COARSEST_SUM`.

    Cost: O(T U).

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable.datasets import read_weights
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "weights.csv")
        ...     _ = file.write_text("B,A\\n0.3,0.70\\n")
        ...     table = read_weights(file, assets=["A", "B"])
        >>> table.frame.to_dict("list"), table.decimals
        ({'A': [0.7], 'B': [0.3]}, 2)
    """
    wanted = _unique(assets, "assets")
    table = read_text_table(path)
    numbered = table.header[0] in wanted
    columns = _aligned(table, wanted, first=0 if numbered else 1, noun="asset")
    index = pd.RangeIndex(len(table.rows), name="row") if numbered else label_index(table)
    values = numbers(table, columns)
    digits = decimal_digits(table, columns)
    if net is not None:
        allowed = max(tolerances.PUBLISHED_SUM, min(_sum_rounding(len(wanted), digits), tolerances.COARSEST_SUM))
        _check_sums(table, values, allowed, "weights", net)
    return WeightsTable(
        frame=pd.DataFrame(values, index=index, columns=pd.Index(wanted)),
        decimals=digits if digits < FULL_PRECISION_DIGITS else None,
    )


def read_labelled_matrix(
    path: PathLike,
    *,
    rows: Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
    is_square: bool = False,
) -> pd.DataFrame:
    """Read a matrix from a CSV file: row labels in the first column, column labels in the header.

    Args:
        path: The file.
        rows: Expected row labels, in the order of the result; None: as in the file.
        columns: Expected column labels, in the same way.
        is_square: Whether rows and columns have the same labels, as in a covariance; rows are then sorted like the columns.

    Returns:
        Numbers with the labels.

    Raises:
        InputError: With file, line and column: what `read_returns` raises about files and cells; labels that are missing,
            unknown or duplicated.

    Cost: O(cells).

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "means.csv")
        ...     _ = file.write_text("regime;Oil;Gas\\ncrisis;-0,02;0,0\\ncalm;0,01;0,015\\n")
        ...     print(read_labelled_matrix(file, rows=["calm", "crisis"]))
                 Oil    Gas
        calm    0.01  0.015
        crisis -0.02  0.000
    """
    table = read_text_table(path)
    if len(table.header) < 2:
        raise InputError(f"{table.path}, line 1: one column, expected row labels and at least one column of numbers")
    labels = [cells[0] for cells in table.rows]
    if is_square and rows is None:
        rows = table.header[1:] if columns is None else columns
    wanted = labels if rows is None else _unique(rows, "rows")
    twice = [label for place, label in enumerate(labels) if label in labels[:place]]
    missing = [label for label in wanted if label not in labels]
    unknown = [label for label in labels if label not in wanted]
    if twice or missing or unknown:
        told = (("twice", twice), ("missing", missing), ("unknown", unknown))
        said = "; ".join(f"{word}: {_listing(these)}" for word, these in told if these)
        raise InputError(f"{table.path}: row labels {said}. Expected one row each for {_listing(wanted)}")
    names = list(table.header[1:]) if columns is None else _unique(columns, "columns")
    places = _aligned(table, names, first=1, noun="column")
    return pd.DataFrame(numbers(table, places), index=labels, columns=names).loc[wanted]


def read_sectors(path: PathLike, *, assets: Sequence[str]) -> dict[str, list[str]]:
    """Read the sectors of assets from a CSV file with the columns asset and sector.

    Args:
        path: The file; an asset may be in several sectors, one row each.
        assets: (U,) labels of the model's assets; every asset needs a sector.

    Raises:
        InputError: The columns have other names, an asset is unknown or has no sector, or a pair is duplicated.

    Cost: O(rows).

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "sectors.csv")
        ...     _ = file.write_text("asset,sector\\nOil,energy\\nFood,other\\nGas,energy\\n")
        ...     print(read_sectors(file, assets=["Oil", "Gas", "Food"]))
        {'energy': ['Oil', 'Gas'], 'other': ['Food']}
    """
    table = read_text_table(path)
    header = [name.lower() for name in table.header]
    if sorted(header) != ["asset", "sector"]:
        raise InputError(f"{table.path}, line 1: columns {_listing(table.header)}, expected 'asset' and 'sector'")
    asset, sector = header.index("asset"), header.index("sector")
    found: dict[str, list[str]] = {}
    for row, cells in enumerate(table.rows):
        if cells[asset] not in assets:
            raise InputError(f"{table.place(row, asset)}: unknown {cells[asset]!r}, expected one of {_listing(assets)}")
        members = found.setdefault(cells[sector], [])
        if not cells[sector] or cells[asset] in members:
            what = "stands twice in its sector" if cells[sector] else "has no sector"
            raise InputError(f"{table.place(row, asset)}: {cells[asset]!r} {what}")
        members.append(cells[asset])
    without = [each for each in assets if not any(each in members for members in found.values())]
    if without:
        raise InputError(f"{table.path}: no sector for {_listing(without)}; expected a row for every asset")
    return found


def _dated_table(path: PathLike, noun: str) -> TextTable:
    table = read_text_table(path)
    if len(table.header) < 2:
        raise InputError(f"{table.path}, line 1: one column, expected dates and at least one {noun} column")
    first = table.header[0]
    if (is_date(first) or is_number(first)) and all(is_number(name) for name in table.header[1:]):
        raise InputError(f"{table.path}, line 1: starts with data, expected a header with a name for every column")
    return table


def _unique(labels: Sequence[str], what: str) -> list[str]:
    if isinstance(labels, str):
        raise InputError(f"{what} must be a sequence of labels, got the text {labels!r}")
    listed = [str(label).strip() for label in labels]
    repeated = [label for index, label in enumerate(listed) if label in listed[:index]]
    if not listed or repeated:
        raise InputError(f"{what} must be at least one label, each once" + (f"; twice: {repeated}" if repeated else ""))
    return listed


def _aligned(table: TextTable, wanted: Sequence[str], *, first: int, noun: str) -> list[int]:
    """Return the position in the file of each expected label."""
    found = list(table.header[first:])
    missing = [label for label in wanted if label not in found]
    unknown = [label for label in found if label not in wanted]
    if missing or unknown:
        problems = [
            f"{word} {noun}{'s' if len(labels) > 1 else ''}: {_listing(labels)}"
            for word, labels in (("missing", missing), ("unknown", unknown))
            if labels
        ]
        raise InputError(
            f"{table.path}, line 1: {'; '.join(problems)}. Expected one column each for {_listing(wanted)}"
        )
    return [first + found.index(label) for label in wanted]


def _listing(labels: Sequence[str]) -> str:
    more = len(labels) - _LISTED
    return ", ".join(repr(label) for label in labels[:_LISTED]) + (f" and {more} more" if more > 0 else "")


def _check_fractions(table: TextTable, values: NDArray[np.float64]) -> None:
    large = int(np.count_nonzero(np.abs(values) > 1.0))
    if 2 * large > values.size:
        raise InputError(
            f"{table.path}: {large} of {values.size} returns exceed 1 in size, such as "
            f"{_first(table, np.abs(values) > 1.0, values)}. These look like percentages or prices; expected fractions, "
            "0.01 for one per cent: divide percentages by 100; prices are read by `backtest --prices` and "
            "read_returns(…, prices=True)"
        )
    counts = np.count_nonzero(np.abs(values) > 1.0, axis=0)
    if len(values) > 1 and 2 * counts.max() > len(values):
        column = int(counts.argmax())
        raise InputError(
            f"{table.path}: {counts[column]} of {len(values)} returns of {table.header[column + 1]!r} exceed 1 in size; "
            "expected fractions, 0.01 for one per cent. A column of years or numbers is no asset: leave it out"
        )
    if np.any(values < -1.0):
        raise InputError(
            f"{_first(table, values < -1.0, values)}: a loss of more than everything, expected simple returns as "
            "fractions, 0.01 for one per cent; divide percentages by 100"
        )


def _first(table: TextTable, where: NDArray[np.bool_], values: NDArray[np.float64]) -> str:
    row, column = (int(i) for i in np.argwhere(where)[0])
    return f"{table.place(row, column + 1)}: {values[row, column]:g}"


def _sum_rounding(count: int, digits: int) -> float:
    """How far rounding may move a sum: each number by at most half a unit of its last decimal; 0 for whole numbers."""
    return count * 0.5 * 10.0**-digits if digits > 0 else 0.0


def _check_sums(table: TextTable, values: NDArray[np.float64], tolerance: float, noun: str, whole: float = 1.0) -> None:
    # a sum exactly at the tolerance, 1.005, must not fail for its last bit
    sums = values.sum(axis=1)
    for row in np.flatnonzero(np.abs(sums - whole) > tolerance + tolerances.BELIEF_SUM):
        hint = ""
        if whole and abs(sums[row] / 100.0 - whole) <= tolerance:
            hint = "; these look like percentages, divide them by 100"
        raise InputError(
            f"{table.path}, line {table.lines[row]}: {noun} sum to {sums[row]:.10g}, "
            f"expected {whole:g} within {tolerance:g}{hint}"
        )
