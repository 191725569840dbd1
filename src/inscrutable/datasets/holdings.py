"""Convert holdings (dollars, shares and prices, percentages, with blanks, cash and other tickers) to weights of a model."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from inscrutable import tolerances
from inscrutable.datasets._cells import TextTable, read_text_table, shown
from inscrutable.datasets._dates import is_total, label_index, row_labels
from inscrutable.datasets.tables import FULL_PRECISION_DIGITS, WeightsTable
from inscrutable.errors import InputError
from inscrutable.labels import label_text

_CASH = {"cash", "usd", "eur", "money market", "cash and equivalents", "cash & equivalents", "cash_usd"}
_TICKERS, _VALUES = ("ticker", "symbol", "asset"), ("value", "market value", "dollars", "weight", "percent")
_SHARES, _PRICES = ("shares", "quantity", "units"), ("price", "close")
_WEIGHTS, _MONEY = ("weight", "percent"), ("market value", "dollars")
_UNIT = re.compile(r"\s*\([^)]*\)$")  # as in "weight (%)" and "market value ($)"
_LONG = {*_TICKERS, *_VALUES, *_SHARES, *_PRICES, "date"}
_AMOUNT = re.compile(
    r"(?P<minus>-?)\$?(?P<number>[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?|\d+\.?\d*|\.\d+)(?P<percent>\s*%?)", re.ASCII
)
_NOTHING = ("", "-")
_MOST_DIGITS = 100  # of a number: sums and products stay finite
_NEAR = 0.6
_MOST_LEFT_OUT = 0.5
"""Share of the value outside the model from which the weights represent the portfolio badly."""

_AS_PERCENTAGES = 10.0  # between sums near 1 and sums near 100
_NEAR_WHOLE = 0.1  # amounts in dollars add up to 1 or 100 by chance alone
_MOST_GROSS = 100.0
_ACCURATE = 9  # digits of a logarithm: that of a power of ten has a rounding


class _Cell(NamedTuple):
    """A number with half a unit of its last digit."""

    value: float
    half_unit: float
    is_percent: bool

    def with_half(self, half_unit: float) -> _Cell:
        """Return the number with the half unit of others; 0 stays exact."""
        return self._replace(half_unit=half_unit if self.half_unit else 0.0)


class _Amounts:
    """Amounts of T portfolios with half units of their last digits: of a model's assets (T,U), and of what is left out (T,)."""

    def __init__(self, size: tuple[int, int]) -> None:
        self.values, self.halves = np.zeros(size), np.zeros(size)
        self.left, self.left_net, self.left_halves = np.zeros((3, size[0]))
        self.owed: list[str] = []
        self.are_percent = self.are_weights = self.are_money = False

    def add(self, row: int, place: int | None, label: str, cell: _Cell) -> None:
        """Add an amount of an asset, or one that is left out; of those below 0 the labels are kept."""
        if place is not None:
            self.values[row, place] += cell.value
            self.halves[row, place] += cell.half_unit
            return
        self.left[row] += abs(cell.value)
        self.left_net[row] += cell.value
        self.left_halves[row] += cell.half_unit
        if cell.value < 0.0:
            self.owed.append(label)

    def whole(self) -> float | None:
        """Return 1 or 100 where all rows sum to that but for the rounding of published weights; money is none."""
        if self.are_money:
            return None
        rounding = self.halves.sum(axis=1) + self.left_halves
        for whole in (100.0,) if self.are_percent else (1.0, 100.0):
            allowed = np.maximum(np.minimum(rounding, whole * tolerances.COARSEST_SUM), tolerances.FEASIBILITY)
            if (np.abs(self._sums() - whole) <= allowed).all():
                return whole
        return None

    def odd_sums(self) -> tuple[float, float] | None:
        """Return the least and greatest sum of a row, as a share, where weights, or what may be, do not sum to the whole."""
        sums = self._sums()
        shares = sums / (100.0 if self.are_percent or sums.max() >= _AS_PERCENTAGES else 1.0)
        # Amounts in dollars may be near 1 or 100 in a row, not also far above.
        near = np.abs(shares - 1.0) <= _NEAR_WHOLE
        is_near = self.are_weights or (near.any() and shares.max() <= 1.0 + _NEAR_WHOLE)
        is_odd = is_near and not self.are_money and self.whole() is None
        return (float(shares.min()), float(shares.max())) if is_odd else None

    def _sums(self) -> NDArray[np.float64]:
        return np.asarray(self.values.sum(axis=1) + self.left_net)


def read_holdings(
    path: str | os.PathLike[str], *, assets: Sequence[str], names: Mapping[str, str] | None = None
) -> WeightsTable:
    """Read holdings in any unit as weights of a model's assets that sum to one.

    Formula: w_j = v_j / Σ v over the model's assets; without cash and labels mapped to "".

    Args:
        path: A CSV file, wide or long. Wide: one column per asset, one row per portfolio, the first column a date or label if
            its name is none of the assets. Long: the columns ticker (symbol, asset) and value (market value, dollars, weight,
            percent), or shares (quantity, units) and price (close); a column date makes several portfolios, and several rows
            of one asset are added. Amounts may have a dollar sign, thousands separators or a per cent sign; a blank or - is 0.
            Of values, shares and prices together the values count; other columns and rows of totals are refused.
        assets: (U,) labels of the model's assets. Assets missing in the file have weight 0.
        names: Labels in the file → labels of the model; "" leaves one out. Other labels match whatever their case.

    Returns:
        A `WeightsTable`. Fractions and percentages whose rows sum to the whole but for their rounding are kept as published.
        `decimals` is such that rounding in the file changes a weight by at most half a unit of the last digit; all amounts
        of the model's assets have the digits of the longest, as spreadsheets drop zeros at the end; prices have their own.
        `left_out` is the largest share of a row's value outside the model, `others` its labels. `sums` are given where amounts
        with per cent signs, or a column weight, percent or with % in its name, do not add up to the whole together with what is
        left out; of other amounts where a row is within a tenth of it.

    Raises:
        InputError: With file, line and column: a cell is not an amount, or says that it is missing (such as n/a), only some
            cells have per cent signs, or shares or prices have them, a label is unknown, the values of a row do not have a
            positive sum, or half of the value or more is outside the model.

    Cost: O(cells).

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "broker.csv")
        ...     _ = file.write_text('symbol,shares,price\\noil,100,$30\\nGAS,50,$20.00\\nCash,,\\noil,100,$30\\n')
        ...     table = read_holdings(file, assets=["OIL", "GAS", "FOOD"])
        >>> table.frame.round(3).to_dict("list")
        {'OIL': [0.857], 'GAS': [0.143], 'FOOD': [0.0]}
    """
    table = read_text_table(path)
    header = [_UNIT.sub("", name.lower()) for name in table.header]
    known = _Names(table, list(map(str, assets)), dict(names or {}))
    is_long = any(name in _TICKERS for name in header) and any(name in (*_VALUES, *_SHARES) for name in header)
    amounts, index = _long(table, header, known) if is_long else _wide(table, known)
    has_dollars = any("$" in text for texts in (table.header, *table.rows) for text in texts)
    amounts.are_money |= has_dollars and not amounts.are_weights
    found = _as_weights(table, known, amounts, index)
    return replace(found, missing=() if is_long else known.absent, owed=tuple(dict.fromkeys(amounts.owed)))


class _Names:
    """The map from labels of the file to the model's assets."""

    def __init__(self, table: TextTable, assets: list[str], given: dict[str, str]) -> None:
        self._table, self.assets, self._given = table, assets, given
        wrong = [name for name in given.values() if name and name not in assets]
        if wrong:
            raise InputError(f"the map names {wrong[0]!r}, expected one of the model's assets: {', '.join(assets[:8])}")
        self._folded: dict[str, list[str]] = {}
        for asset in assets:
            self._folded.setdefault(asset.casefold(), []).append(asset)
        self.left_out: list[str] = []
        self.seen: set[str] = set()

    @property
    def absent(self) -> tuple[str, ...]:
        """The model's assets that the file does not name."""
        return tuple(each for each in self.assets if each not in self.seen)

    def place(self, label: str, where: str) -> int | None:
        """Return the index of an asset; None for cash and labels left out."""
        if label in self._given:
            asset = self._given[label]
        elif label in self.assets:
            asset = label
        elif label.casefold() in _CASH and label.casefold() not in self._folded:
            asset = ""
        else:
            same = self._folded.get(label.casefold(), [])
            if not same and is_total(label):
                raise InputError(f"{where}: {shown(label)} is no holding: delete its line or column")
            if len(same) != 1:
                near = get_close_matches(label.casefold(), self._folded, n=1, cutoff=_NEAR)
                hint = f"; did you mean {self._folded[near[0]][0]!r}?" if near else "."
                raise InputError(
                    f"{where}: {shown(label)} is none of the model's assets{hint} Give its asset in a map (columns name and "
                    "asset), or a blank there to leave it out"
                )
            asset = same[0]
        if not asset:
            self.left_out.append(label)
            return None
        self.seen.add(asset)
        return self.assets.index(asset)


def _wide(table: TextTable, known: _Names) -> tuple[_Amounts, pd.Index]:
    labels = table.header
    first = 1 if not _is_known(known, labels[0]) else 0
    places = [known.place(label, f"{table.path}, line 1") for label in labels[first:]]
    twice = [labels[first + k] for k, place in enumerate(places) if place is not None and place in places[:k]]
    if twice:
        raise InputError(f"{table.path}, line 1: {twice[0]!r} is a second column of one asset; expected one each")
    amounts = _Amounts((len(table.rows), len(known.assets)))
    kinds: set[bool] = set()
    rows = [[_cell(table, row, first + k) for k in range(len(places))] for row in range(len(table.rows))]
    half = _half_unit(cell for cells in rows for place, cell in zip(places, cells, strict=True) if place is not None)
    for row, cells in enumerate(rows):
        _same_unit(table, row, cells, kinds)
        for label, place, cell in zip(labels[first:], places, cells, strict=True):
            amounts.add(row, place, label, cell if place is None else cell.with_half(half))
    amounts.are_percent = amounts.are_weights = True in kinds
    return amounts, label_index(table) if first else pd.RangeIndex(len(table.rows), name="row")


def _is_known(known: _Names, label: str) -> bool:
    before = list(known.left_out)
    try:
        known.place(label, "")
    except InputError:
        return False
    finally:
        known.left_out[:] = before
    return True


def _long(table: TextTable, header: list[str], known: _Names) -> tuple[_Amounts, pd.Index]:
    ticker, value, shares, price = (
        next((header.index(name) for name in names if name in header), None)
        for names in (_TICKERS, _VALUES, _SHARES, _PRICES)
    )
    assert ticker is not None
    if value is None and (shares is None or price is None):
        raise InputError(
            f"{table.path}, line 1: expected a column of values, or columns of shares and prices; shares alone say nothing"
        )
    others = [table.header[place] for place, name in enumerate(header) if name not in _LONG]
    if others:
        raise InputError(
            f"{table.path}, line 1: unknown columns {', '.join(map(repr, others))}; a list of holdings has date, ticker, "
            "and value or shares and price: leave the others out"
        )
    stated = [table.header[place] for place, name in enumerate(header) if name in _VALUES]
    if len(stated) > 1:
        raise InputError(
            f"{table.path}, line 1: {' and '.join(map(repr, stated))} all state what is held: leave one of them in"
        )
    if "date" in header[1:]:
        raise InputError(f"{table.path}, line 1: the column date must come first")
    index, where = _portfolios(table) if header[0] == "date" else (pd.RangeIndex(1, name="row"), [0] * len(table.rows))
    amounts = _Amounts((len(index), len(known.assets)))
    kinds: set[bool] = set()
    column, read = (price, _count) if value is None else (value, _cell)
    assert column is not None
    cells = [read(table, row, column) for row in range(len(table.rows))]
    places = [known.place(texts[ticker], table.place(row, ticker)) for row, texts in enumerate(table.rows)]
    half = _half_unit(cell for place, cell in zip(places, cells, strict=True) if place is not None)
    for row, (place, cell) in enumerate(zip(places, cells, strict=True)):
        if value is not None:
            _same_unit(table, row, [cell], kinds)
            if table.rows[row][value] in _NOTHING and shares is not None and _cell(table, row, shares).value:
                raise InputError(f"{table.place(row, value)}: no value for what is held")
            amount = cell if place is None else cell.with_half(half)
        else:
            assert shares is not None
            count = _count(table, row, shares).value
            if place is not None and count and not cell.value > 0:
                raise InputError(f"{table.place(row, column)}: no price above 0 for what is held")
            # prices of unlike sizes have unlike digits
            amount = _Cell(count * cell.value, abs(count) * cell.half_unit, False)
        amounts.add(where[row], place, table.rows[row][ticker], amount)
    amounts.are_percent = True in kinds
    amounts.are_weights = amounts.are_percent or (
        value is not None and (header[value] in _WEIGHTS or "%" in table.header[value])
    )
    amounts.are_money = value is None or (header[value] in _MONEY and not amounts.are_weights)
    return amounts, index


def _portfolios(table: TextTable) -> tuple[pd.Index, list[int]]:
    """Return the distinct dates of the first column, in order, and each row's index into them."""
    labels, first = row_labels(table), dict[object, int]()
    for row, label in enumerate(labels):
        first.setdefault(label, row)
    places = {label: place for place, label in enumerate(first)}
    lines, rows = tuple(table.lines[row] for row in first.values()), tuple(table.rows[row] for row in first.values())
    found = label_index(TextTable(table.path, table.header, lines, rows))
    return found, [places[label] for label in labels]


def _cell(table: TextTable, row: int, column: int) -> _Cell:
    text = table.rows[row][column]
    if text in _NOTHING:
        return _Cell(0.0, 0.0, False)
    plain = f"-{text[1:-1]}" if text.startswith("(") and text.endswith(")") else text.replace("\u2212", "-")
    found = _AMOUNT.fullmatch(plain)
    if found is None:
        raise InputError(
            f"{table.place(row, column)}: found {shown(text)}, expected an amount such as 1,234.50, $1000 or 12.5%, "
            "without other signs of currency, or a blank for 0"
        )
    if "," in found["number"] and found["percent"].strip():
        raise InputError(f"{table.place(row, column)}: {shown(text)} may have a decimal comma or one of thousands")
    number = found["number"].replace(",", "")
    if len(number) > _MOST_DIGITS:
        raise InputError(
            f"{table.place(row, column)}: {shown(text)} has {len(number)} digits, expected at most {_MOST_DIGITS}"
        )
    digits = len(number.partition(".")[2])
    value = float(number) * (-1.0 if found["minus"] else 1.0)
    return _Cell(value, 0.5 * 10.0**-digits if value else 0.0, bool(found["percent"].strip()))


def _count(table: TextTable, row: int, column: int) -> _Cell:
    """Return a number of shares or a price."""
    cell = _cell(table, row, column)
    if cell.is_percent:
        found = shown(table.rows[row][column])
        raise InputError(
            f"{table.place(row, column)}: found {found}, expected shares and prices without per cent signs"
        )
    return cell


def _half_unit(cells: Iterable[_Cell]) -> float:
    """Half a unit of the last digit of the longest number: spreadsheets drop the zeros at a number's end."""
    return min((cell.half_unit for cell in cells if cell.half_unit), default=0.0)


def _same_unit(table: TextTable, row: int, cells: Sequence[_Cell], kinds: set[bool]) -> None:
    """Raise `InputError` where a row has or lacks per cent signs, unlike itself or the rows before: `kinds` is of these."""
    kinds |= {cell.is_percent for cell in cells if cell.value}
    if len(kinds) > 1:
        raise InputError(f"{table.path}, line {table.lines[row]}: some amounts have a per cent sign and some have none")


def _as_weights(table: TextTable, known: _Names, amounts: _Amounts, index: pd.Index) -> WeightsTable:
    values, halves, left = amounts.values, amounts.halves, amounts.left
    sums, absent = values.sum(axis=1), f"; the file does not name {', '.join(known.absent)}" if known.absent else ""
    void = ~(sums > tolerances.TINY) | (np.abs(values).sum(axis=1) > _MOST_GROSS * np.abs(sums))
    for row in np.flatnonzero(void).tolist():
        raise InputError(
            f"{table.path}, portfolio {label_text(index[row])}: the model's assets add up to {sums[row]:g}, expected more "
            f"than 0{absent}"
        )
    out = left / (left + np.abs(values).sum(axis=1))
    if out.max(initial=0.0) >= _MOST_LEFT_OUT:
        row = int(out.argmax())
        raise InputError(
            f"{table.path}, portfolio {label_text(index[row])}: {out[row]:.0%} of the value is left out "
            f"({', '.join(sorted(set(known.left_out)))}); the rest would say little of the portfolio"
        )
    whole = None if left.any() else amounts.whole()
    if whole is None:
        weights, moved = values / sums[:, None], errors_of_shares(values, halves)
    else:
        moved, weights = halves / whole, values / whole
    return WeightsTable(
        pd.DataFrame(weights, index=index, columns=pd.Index(known.assets)),
        decimals_within(moved),
        float(out.max(initial=0.0)),
        tuple(sorted(set(known.left_out))),
        sums=amounts.odd_sums(),
    )


def errors_of_shares(values: NDArray[np.float64], halves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return by how much weights w = v/S (T,U) change at most where amounts v (T,U) change by h: (h_j + w_j Σh)/(S − Σh)."""
    sums, moved = values.sum(axis=1, keepdims=True), halves.sum(axis=1, keepdims=True)
    most = (halves + np.abs(values / sums) * moved) / np.maximum(sums - moved, tolerances.TINY)
    return np.asarray(np.minimum(most, 1.0))


def decimals_within(errors: NDArray[np.float64]) -> int | None:
    """Return the most decimals half a unit of which is no less than any error; None where they are full precision."""
    largest = float(errors.max())
    if largest <= 0.0:
        return None
    digits = max(math.floor(round(-math.log10(2.0 * largest), _ACCURATE)), 0)
    return digits if digits < FULL_PRECISION_DIGITS else None


def read_map(path: str | os.PathLike[str]) -> dict[str, str]:
    """Read the map from labels of a file of holdings to assets: a CSV with the columns name and asset.

    Args:
        path: The file; a blank asset leaves a name out.

    Raises:
        InputError: The columns have other names, or a name is blank or duplicated.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "map.csv")
        ...     _ = file.write_text("name,asset\\n037833100,AAPL\\nGLD,\\n")
        ...     print(read_map(file))
        {'037833100': 'AAPL', 'GLD': ''}
    """
    table = read_text_table(path)
    header = [name.lower() for name in table.header]
    if sorted(header) != ["asset", "name"]:
        raise InputError(f"{table.path}, line 1: columns {', '.join(table.header)}, expected 'name' and 'asset'")
    name, asset = header.index("name"), header.index("asset")
    found: dict[str, str] = {}
    for row, cells in enumerate(table.rows):
        if not cells[name] or cells[name] in found:
            raise InputError(
                f"{table.place(row, name)}: {shown(cells[name])} is blank or stands twice, expected each name once"
            )
        found[cells[name]] = cells[asset]
    return found
