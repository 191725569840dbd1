"""Form 13F information tables, from the SEC's data sets or edgartools frames, as weights of a model's assets.

The SEC's FORM13F_readme says of the column VALUE: "Starting on January 3, 2023, market value is reported rounded to the nearest
dollar. Previously, market value was reported in thousands." The date is that of the filing. Values of one filing have one unit,
so weights need none; several filings of a quarter are added in dollars.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from datetime import date, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inscrutable.datasets._dates import unambiguous
from inscrutable.datasets.holdings import decimals_within, errors_of_shares
from inscrutable.datasets.tables import WeightsTable
from inscrutable.errors import InputError

IN_DOLLARS = date(2023, 1, 3)
"""First filing day with values in dollars; earlier filings are in thousands of dollars."""

_NAMES = {
    "cusip": ("CUSIP", "Cusip", "cusip"),
    "value": ("VALUE", "Value", "value"),
    "shares": ("SSHPRNAMT", "SharesPrnAmount", "Shares", "shares"),
    "kind": ("SSHPRNAMTTYPE", "Type", "type"),
    "option": ("PUTCALL", "PutCall", "putCall"),
    "ticker": ("Ticker", "TICKER", "ticker"),
    "issuer": ("NAMEOFISSUER", "Issuer", "nameOfIssuer"),
    "accession": ("ACCESSION_NUMBER", "accession_number"),
}
_SHARES = {"sh", "shares"}
_CUSIP = "[0-9A-Z*@#]{1,9}"
_TABLES = {
    "SUBMISSION": ("ACCESSION_NUMBER", "FILING_DATE", "SUBMISSIONTYPE", "CIK", "PERIODOFREPORT"),
    "COVERPAGE": ("ACCESSION_NUMBER",),
    "INFOTABLE": ("ACCESSION_NUMBER",),
}
_ROW = "INFOTABLE_SK"
"""The number of a row of INFOTABLE.tsv."""
_PRICES = (0.5, 50_000.0)
"""Bounds of the median share price, in dollars: below, values were in thousands; above, in dollars."""


def dollars_13f(table: pd.DataFrame, *, filed: date | str) -> pd.DataFrame:
    """Return the holdings of one Form 13F filing: one row per CUSIP with value in dollars, shares, issuer, and ticker if given.

    Formula: rows of one CUSIP (several managers) are added; values filed before 3 January 2023 are multiplied by 1000.

    Args:
        table: An information table, columns named as in INFOTABLE.tsv or by edgartools (`thirteenf.infotable`): CUSIP, VALUE,
            SSHPRNAMT, SSHPRNAMTTYPE, PUTCALL. Options (put or call) and principal amounts are not holdings of shares: remove
            them first, with `only_shares`.
        filed: The day of filing.

    Raises:
        InputError: A column is missing, rows belong to several filings, to options or principal amounts, a CUSIP or a number is
            invalid, the day can be read day first or month first, or the implied share prices are a thousand times too small or
            large for it.

    Cost: O(rows). Source: the SEC's FORM13F_readme of its Form 13F Data Sets, column VALUE.

    Example:
        >>> rows = pd.DataFrame({"Cusip": ["037833100", "037833100"], "Value": [130, 70], "SharesPrnAmount": [1000, 540],
        ...                      "Type": ["SH", "SH"], "PutCall": ["", ""]})
        >>> dollars_13f(rows, filed="2022-11-14")["value"].tolist()
        [200000.0]
    """
    if not isinstance(table, pd.DataFrame):
        raise InputError(f"the information table must be a DataFrame, got {type(table).__name__}")
    day = _day(filed)
    columns = {key: next((name for name in names if name in table.columns), None) for key, names in _NAMES.items()}
    missing = [_NAMES[key][0] for key in ("cusip", "value", "shares", "kind", "option") if columns[key] is None]
    if missing:
        raise InputError(
            f"the information table has no column {', '.join(missing)}; expected those of INFOTABLE.tsv or of edgartools"
        )
    if not len(table):
        raise InputError("the information table has no rows; a notice (13F-NT) has no holdings")
    if columns["accession"] is not None and table[columns["accession"]].nunique() > 1:
        some = ", ".join(map(str, table[columns["accession"]].unique()[:3]))
        raise InputError(
            f"the information table has rows of several filings ({some}); give those of one, or a folder and a CIK"
        )
    options = _text(table[columns["option"]]).str.lower().isin(["put", "call"])
    amounts = ~_text(table[columns["kind"]]).str.lower().isin(_SHARES)
    for rows, what in (
        (options, "options (PUTCALL), bets on a share and no holdings"),
        (amounts, "principal amounts of bonds (PRN)"),
    ):
        if rows.any():
            where = columns["issuer"] or columns["cusip"]
            raise InputError(
                f"{int(rows.sum())} rows are {what}, the first of {table[where][rows].iloc[0]}; leave them out (only_shares)"
            )
    numbers = table[[columns["value"], columns["shares"]]].apply(pd.to_numeric, errors="coerce")
    numbers.columns = ["value", "shares"]
    wrong = np.flatnonzero(~(numbers.ge(0).all(axis=1) & np.isfinite(numbers).all(axis=1)))
    if wrong.size:
        value, shares = (table[str(columns[key])].iloc[int(wrong[0])] for key in ("value", "shares"))
        raise InputError(
            f"row {wrong[0]} of the information table has value {value} and shares {shares}, expected numbers of at least 0"
        )
    numbers["value"] *= 1.0 if day >= IN_DOLLARS else 1000.0
    numbers["cusip"] = _cusips(table[columns["cusip"]])
    for key in ("ticker", "issuer"):
        numbers[key] = "" if columns[key] is None else _text(table[columns[key]])
    _check_prices(numbers, day)
    grouped = numbers.groupby("cusip", sort=True)
    found: pd.DataFrame = grouped.agg(
        value=("value", "sum"), shares=("shares", "sum"), ticker=("ticker", "first"), issuer=("issuer", "first")
    )
    return found


def only_shares(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of an information table that are holdings of shares, without options and principal amounts.

    Args:
        table: As for `dollars_13f`.

    Example:
        >>> rows = pd.DataFrame({"Cusip": ["1", "1"], "PutCall": ["", "Put"], "Type": ["SH", "SH"]})
        >>> len(only_shares(rows))
        1
    """
    kept = pd.Series(True, index=table.index)
    for name in _NAMES["option"]:
        if name in table.columns:
            kept &= ~_text(table[name]).str.lower().isin(["put", "call"])
    for name in _NAMES["kind"]:
        if name in table.columns:
            kept &= _text(table[name]).str.lower().isin(_SHARES)
    return pd.DataFrame(table[kept.to_numpy()])


def read_13f(
    path: str | os.PathLike[str], *, cik: int, assets: Sequence[str], names: Mapping[str, str]
) -> WeightsTable:
    """Read one manager's quarters from a folder of the SEC's Form 13F data sets as weights of a model's assets.

    Args:
        path: The folder with INFOTABLE.tsv, SUBMISSION.tsv and COVERPAGE.tsv.
        cik: The manager's number.
        assets: (U,) labels of the model's assets.
        names: CUSIP → asset; "" and unlisted CUSIPs are left out, and the result states their share. Zeros at the beginning,
            which spreadsheets drop, may be missing.

    Returns:
        One row per quarter, by PERIODOFREPORT; options and principal amounts are left out. A restating amendment replaces all
        earlier filings of the report; an amendment with new holdings is added. Rows that data sets in one folder share count
        once, those of INFOTABLE.tsv by INFOTABLE_SK.

    Raises:
        InputError: A file, a column or a filing's cover page is missing, the manager filed no holdings, an amendment states
            neither type or adds to a filing that is in another data set, rows of one number differ, or `dollars_13f` raises an
            error for a filing.

    Cost: O(rows of the files). Source: the SEC's FORM13F_readme, tables SUBMISSION, COVERPAGE, INFOTABLE.
    """
    folder = Path(path)
    submissions, covers, holdings = (_tsv(folder / f"{name}.tsv", columns) for name, columns in _TABLES.items())
    mine = submissions[pd.to_numeric(submissions["CIK"], errors="coerce") == int(cik)]
    mine = _once(mine[mine["SUBMISSIONTYPE"].str.startswith("13F-HR")], folder / "SUBMISSION.tsv")
    if not len(mine):
        raise InputError(f"{folder}: CIK {cik} filed no holdings (13F-HR) in this data set")
    covers, holdings = (each[each["ACCESSION_NUMBER"].isin(mine["ACCESSION_NUMBER"])] for each in (covers, holdings))
    covers = _once(covers, folder / "COVERPAGE.tsv")
    if _ROW in holdings:
        holdings = _once(holdings, folder / "INFOTABLE.tsv", _ROW)
    uncovered = mine["ACCESSION_NUMBER"][~mine["ACCESSION_NUMBER"].isin(covers["ACCESSION_NUMBER"])]
    if len(uncovered):
        raise InputError(f"{folder}: the filing {uncovered.iloc[0]} has no row in COVERPAGE.tsv")
    mine = mine.merge(covers, on="ACCESSION_NUMBER", suffixes=("", "_cover"))
    mine = mine.assign(
        day=[_day(text) for text in mine["FILING_DATE"]], period=[_day(text) for text in mine["PERIODOFREPORT"]]
    )
    unknown = [name for name in names.values() if name and name not in assets]
    if unknown:
        raise InputError(f"names has {unknown[0]!r}, expected one of the model's assets")
    assets_of = dict(zip(_cusips(pd.Series(list(names))), names.values(), strict=True))
    if len(assets_of) < len(names):
        raise InputError("names has a CUSIP twice, once without its zeros or in small letters")
    rows, index, out, errors = [], [], [], []
    mine["amendment"] = pd.to_numeric(mine.get("AMENDMENTNO", pd.Series(dtype=float)), errors="coerce").fillna(0.0)
    # Of filings of one day, "13F-HR" comes before its amendments "13F-HR/A", these by their numbers.
    in_order = mine.sort_values(["day", "SUBMISSIONTYPE", "amendment", "ACCESSION_NUMBER"])
    for period, filings in in_order.groupby("period"):
        held, halves = _reported(filings, holdings, folder)
        found, half_units = (
            np.array([each[[c for c in each.index if assets_of.get(c) == asset]].sum() for asset in assets])
            for each in (held, halves)
        )
        if not found.sum() > 0:
            raise InputError(f"{folder}: none of the {len(held)} holdings of {period} is one of the model's assets")
        rows.append(found / found.sum())
        errors.append(errors_of_shares(found[None], half_units[None]))
        index.append(pd.Timestamp(filings["period"].iloc[0]))
        out.append(1.0 - found.sum() / held.sum())
    frame = pd.DataFrame(rows, index=pd.DatetimeIndex(index, name="period"), columns=list(assets))
    left = tuple(sorted({name for name, asset in names.items() if not asset}))
    return WeightsTable(frame, decimals_within(np.vstack(errors)), float(max(out)), left)


def _reported(filings: pd.DataFrame, holdings: pd.DataFrame, folder: Path) -> tuple[pd.Series, pd.Series]:
    """Return the dollars by CUSIP that the filings of a period, in order, report in the end, and by how much rounding changed
    them at most."""
    held, halves = pd.Series(dtype=float), pd.Series(dtype=float)
    for place, (_, filing) in enumerate(filings.iterrows()):
        number = filing["ACCESSION_NUMBER"]
        table = only_shares(holdings[holdings["ACCESSION_NUMBER"] == number])
        value = dollars_13f(table, filed=filing["day"])["value"] if len(table) else pd.Series(dtype=float)
        # Each row is rounded to a dollar, or to a thousand.
        half = _cusips(table["CUSIP"]).value_counts() * (0.5 if filing["day"] >= IN_DOLLARS else 500.0)
        kind = str(filing.get("AMENDMENTTYPE", "")).upper()
        is_added = kind == "NEW HOLDINGS"
        if filing["SUBMISSIONTYPE"] == "13F-HR/A" and not is_added and kind != "RESTATEMENT":
            raise InputError(f"{folder}: the amendment {number} says neither RESTATEMENT nor NEW HOLDINGS")
        if is_added and not place:
            raise InputError(
                f"{folder}: the amendment {number} adds holdings to a filing of {filing['period']} that is not in this data "
                "set: put the rows of both into one folder"
            )
        held = held.add(value, fill_value=0.0) if is_added else value
        halves = halves.add(half, fill_value=0.0) if is_added else half
    return held, halves


def _once(table: pd.DataFrame, path: Path, *more: str) -> pd.DataFrame:
    """Return the rows without copies, which data sets that overlap have; raise `InputError` for two rows of one number."""
    kept, keys = table.drop_duplicates(), ["ACCESSION_NUMBER", *more]
    twice = kept[kept.duplicated(keys)]
    if len(twice):
        number = ", ".join(f"{key} {twice[key].iloc[0]}" for key in keys)
        raise InputError(f"{path} has two rows with {number} that differ, expected one each")
    return kept


def _check_prices(numbers: pd.DataFrame, day: date) -> None:
    some = numbers[(numbers["shares"] > 0) & (numbers["value"] > 0)]
    if not len(some):
        return
    price = float((some["value"] / some["shares"]).median())
    least, most = _PRICES
    if least <= price <= most:
        return
    unit = "dollars" if day >= IN_DOLLARS else "thousands of dollars"
    other = "thousands" if price < least else "dollars"
    raise InputError(
        f"a filing of {day} states values in {unit}, which makes the median price of a share {price:.3g} dollars: its values "
        f"look like {other}; correct them, or the day of filing"
    )


def _text(column: pd.Series) -> pd.Series:
    return column.astype(object).where(column.notna(), "").astype(str).str.strip()


def _cusips(column: pd.Series) -> pd.Series:
    """Return CUSIPs of nine characters; a spreadsheet drops zeros at the beginning and may write numbers with a point."""
    found = _text(column).str.upper()
    if pd.api.types.is_float_dtype(column):
        found = found.str.removesuffix(".0")
    wrong = np.flatnonzero(~found.str.fullmatch(_CUSIP))
    if wrong.size:
        raise InputError(f"the CUSIP {found.iloc[int(wrong[0])]!r} in row {wrong[0]} is none: expected nine characters")
    return found.str.zfill(9)


def _day(text: Any) -> date:
    if text is pd.NaT:
        raise InputError("the day of filing is missing (NaT); expected a day such as 2022-11-14")
    if isinstance(text, datetime):
        return text.date()
    if isinstance(text, date):
        return text
    text = unambiguous(str(text).strip(), "the day of filing")
    for form in ("%Y-%m-%d", "%d-%b-%Y", "%Y%m%d"):
        try:
            return datetime.strptime(text.title(), form).date()
        except ValueError:
            continue
    raise InputError(f"{text!r} is no day of filing such as 2022-11-14 or 14-NOV-2022")


def _tsv(path: Path, columns: tuple[str, ...]) -> pd.DataFrame:
    try:
        # Fields are separated by tabs alone: a quotation mark in a name is a character.
        table = pd.read_csv(path, sep="\t", dtype=str, keep_default_na=False, quoting=csv.QUOTE_NONE)
    except OSError as error:
        raise InputError(
            f"{path} cannot be read: {error.strerror or error}; expected the SEC's Form 13F data set"
        ) from None
    except (ValueError, pd.errors.ParserError) as error:
        raise InputError(f"{path} is no table of the SEC's Form 13F data set: {error}") from None
    missing = [name for name in columns if name not in table.columns]
    if missing:
        raise InputError(f"{path} has no column {', '.join(missing)}; expected the SEC's Form 13F data set")
    return table
