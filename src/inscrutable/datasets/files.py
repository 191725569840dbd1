"""Write results: atomically, and equal data give equal bytes."""

from __future__ import annotations

import json
import math
import os
import secrets
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from datetime import date
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inscrutable.datasets._cells import FORMULA
from inscrutable.errors import InputError
from inscrutable.files import PathLike, path_of, remove, unwritten, whole_file


def write_table(frame: pd.DataFrame, path: PathLike) -> None:
    """Write a frame as CSV with every float in full, so that reading it gives identical numbers.

    Args:
        frame: Any frame; its index becomes the first column, NaN an empty cell. UTF-8, commas, lines end in ``\\n``. Text that
            a spreadsheet would read as a formula, because it begins with = + - or @, gets an apostrophe, which this package's
            readers drop.
        path: The file to create or replace, whole or not at all.

    Raises:
        InputError: The file cannot be written.

    Cost: O(cells).

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable.datasets import write_table
        >>> with TemporaryDirectory() as folder:
        ...     write_table(pd.DataFrame({"A": [0.1 + 0.2]}, index=["x"]), folder + "/t.csv")
        ...     (Path(folder) / "t.csv").read_text()
        ',A\\nx,0.30000000000000004\\n'
    """
    plain = frame.rename(index=escaped, columns=escaped).rename_axis(index=escaped, columns=escaped)
    texts = [k for k, kind in enumerate(frame.dtypes) if not pd.api.types.is_numeric_dtype(kind)]
    for k in texts:
        plain.isetitem(k, frame.iloc[:, k].map(escaped).to_numpy())
    _write_text(plain.to_csv(lineterminator="\n"), path)


def escaped(label: Any) -> Any:
    """Return text that no spreadsheet reads as a formula; other values unchanged."""
    return f"'{label}" if isinstance(label, str) and FORMULA.match(label) else label


def write_json(data: Any, path: PathLike) -> None:
    """Write plain data as JSON that is the same bytes for the same data: sorted keys, two spaces, one final newline.

    Args:
        data: Mappings, sequences, dataclasses, strings, numbers, booleans, None, dates, enums, paths, NumPy scalars and
            arrays. NaN (and pandas' missing values) become null; infinities become the strings "Infinity" and
            "-Infinity", which ``float`` reads back.
        path: The file to create or replace, whole or not at all.

    Raises:
        InputError: A value has no JSON form (the message names its place), two keys become the same text, or the file cannot be
            written.

    Cost: O(size of the data).

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable.datasets import write_json
        >>> with TemporaryDirectory() as folder:
        ...     write_json({"b": np.float64("nan"), "a": 1}, folder + "/s.json")
        ...     print((Path(folder) / "s.json").read_text())
        {
          "a": 1,
          "b": null
        }
    """
    text = json.dumps(_plain(data, "data"), indent=2, sort_keys=True, allow_nan=False, ensure_ascii=False)
    _write_text(text + "\n", path)


def output_folder(path: PathLike) -> Path:
    """Return `path` as a folder that exists and can be written to, created with its parents where needed.

    Args:
        path: The folder for results. Files in it stay.

    Returns:
        The folder. A test file was created and removed, so a long run starts only in a writable folder.

    Raises:
        InputError: No path, or a folder that cannot be created or written to (a file in its place, read-only, disk full),
            with the reason.

    Cost: two file operations.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable.datasets import output_folder
        >>> with TemporaryDirectory() as folder:
        ...     output_folder(folder + "/results/run").is_dir()
        True
    """
    folder = path_of(path, "an output folder")
    probe = folder / f".probe.{secrets.token_hex(6)}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"\n")
        probe.unlink()
    except OSError as error:
        remove(probe, unless=folder)
        raise unwritten(f"output folder {folder}", error) from error
    return folder


def _write_text(text: str, path: PathLike) -> None:
    try:
        encoded = text.encode("utf-8")
    except UnicodeEncodeError as error:
        raise InputError(f"{path} cannot be written: {text[error.start]!r} is not a character of UTF-8") from None
    with whole_file(path) as temporary:
        temporary.write_bytes(encoded)


def _plain(value: Any, place: str) -> Any:
    """Return the JSON form of `value`; `place` is its name in errors, in Python notation."""
    if isinstance(value, Enum):
        return _plain(value.value, place)
    if value is None or value is pd.NaT or value is pd.NA:
        return None
    if isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return _plain_float(float(value))
    if isinstance(value, np.generic | np.ndarray) and value.dtype.kind in "biufUO":
        return _plain(value.tolist(), place)
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name), f"{place}.{field.name}") for field in fields(value)}
    if isinstance(value, Mapping):
        return _plain_mapping(value, place)
    if isinstance(value, (list, tuple)):
        return [_plain(each, f"{place}[{index}]") for index, each in enumerate(value)]
    raise InputError(f"{place} is a {type(value).__name__}, which has no JSON form")


def _plain_float(value: float) -> float | str | None:
    if math.isnan(value):
        return None
    if math.isinf(value):
        return "Infinity" if value > 0 else "-Infinity"
    return value


def _plain_mapping(value: Mapping[Any, Any], place: str) -> dict[str, Any]:
    result: dict[str, Any] = {}
    for key, each in value.items():
        plain_key = _plain(key, f"a key of {place}")
        if isinstance(plain_key, (list, dict)):
            raise InputError(f"{place} has the key {key!r}, expected text, a number or a date")
        name = plain_key if isinstance(plain_key, str) else json.dumps(plain_key)
        if name in result:
            raise InputError(f"{place} has two keys that both become {name!r} in JSON")
        result[name] = _plain(each, f"{place}[{key!r}]")
    return result
