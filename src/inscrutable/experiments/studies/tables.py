"""The rows of a study as a table, and as files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from inscrutable.datasets import write_table
from inscrutable.errors import InputError
from inscrutable.experiments.studies.grid import StudyGrid, Variant
from inscrutable.experiments.studies.tasks import Row, TaskGrid
from inscrutable.files import whole_file

_SHORT = {"decision_maker": "name", "adversary": "name", "budget": "amount"}
"""The parts with a column of their own, and the entry that the column shows."""

_SHOWN: Mapping[str, tuple[str, str | None]] = {
    **{part: (part, key) for part, key in _SHORT.items()},
    "repeat": ("repeat", None),
}
"""The columns of parameters in every grid's table."""


def fixed_columns() -> frozenset[str]:
    """Return the columns of every grid's table besides its figures."""
    no_grid: Any = None
    return frozenset(plain_table(no_grid, (), True, _SHOWN, ()).reset_index().columns)


def table_of(grid: StudyGrid, rows: Iterable[Row], durations: bool) -> pd.DataFrame:
    """Return rows in the order of the grid: identity, varying keys, status, figures, and the reason of a failure."""
    shown = {**_SHOWN, **{f"{part}.{key}": (part, key) for part, key in _varying(grid)}}
    return plain_table(grid, rows, durations, shown, grid.study.measures)


def plain_table(
    grid: TaskGrid,
    rows: Iterable[Row],
    durations: bool,
    shown: Mapping[str, tuple[str, str | None]] | None = None,
    measures: Sequence[str] | None = None,
) -> pd.DataFrame:
    """Return rows of any kind in order: identity, parameters, seed, status, figures, and the reason of a failure.

    Args:
        grid: The tasks.
        rows: The rows.
        durations: Whether to add the seconds that each task took.
        shown: The columns of parameters, each a part and an entry of it, if it has any; None shows every part.
        measures: The figures; None means all that some row has.
    """
    held = list(rows)
    index = pd.Index([row.number for row in held], name="number", dtype="int64")
    told: Any = [json.loads(row.parameters) for row in held]
    if shown is not None:
        told = {name: [_entry(each[part], key) for each in told] for name, (part, key) in shown.items()}
    figures = [{name: _figure(each) for name, each in json.loads(row.figures).items()} for row in held]
    columns = None if measures is None else list(measures)
    parts: list[pd.DataFrame] = [
        pd.DataFrame({"task": [row.task for row in held]}, index=index),
        pd.DataFrame(told, index=index),
        pd.DataFrame({"seed": [row.seed for row in held], "status": [row.status for row in held]}, index=index),
        pd.DataFrame(figures, index=index, columns=columns, dtype="float64"),
        *([pd.DataFrame({"duration": [row.duration for row in held]}, index=index)] if durations else []),
        pd.DataFrame({"failure": [row.error for row in held]}, index=index),
    ]
    return pd.concat(parts, axis=1)


def _entry(part: Any, key: str | None) -> Any:
    return part if key is None else (part or {}).get(key)


def _figure(value: float | str | None) -> float:
    return float("nan") if value is None else float(value)


def _varying(grid: StudyGrid) -> list[tuple[str, str]]:
    """Return every entry that differs between choices that have it, without those that have a column of their own."""
    makers = [maker for maker, _ in grid.plays]
    parts: dict[str, Sequence[Variant]] = {
        "world": grid.worlds,
        "problem": grid.problems,
        "beliefs": grid.beliefs,
        "candidates": grid.candidates,
        "decision_maker": makers,
        "adversary": grid.adversaries,
    }
    found = []
    for part, choices in parts.items():
        data = [each.data or {} for each in choices]
        keys = dict.fromkeys(key for each in data for key in each)
        found += [
            (part, key)
            for key in keys
            if _SHORT.get(part) != key and len({json.dumps(each[key]) for each in data if key in each}) > 1
        ]
    return found


def write_rows(frame: pd.DataFrame, path: Path) -> None:
    """Write a table of rows as CSV, or as Parquet if the name ends with it; the file is written whole or not at all.

    Raises:
        InputError: The file cannot be written, or Parquet is asked for without pyarrow.
    """
    if path.suffix != ".parquet":
        return write_table(frame, path)
    try:
        import pyarrow  # noqa: F401
    except ImportError:
        raise InputError("Parquet files need pyarrow: pip install pyarrow; or export to CSV") from None
    with whole_file(path) as temporary:
        frame.to_parquet(temporary)
