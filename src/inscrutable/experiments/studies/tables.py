"""The rows of a study as a table, and as files."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from inscrutable.datasets import write_table
from inscrutable.errors import InputError
from inscrutable.experiments.studies.grid import StudyGrid, Variant
from inscrutable.experiments.studies.tasks import Row
from inscrutable.files import whole_file

_SHORT = {"decision_maker": "name", "adversary": "name", "budget": "amount"}
"""Parts that have a column of their own: the entry that it shows."""


def table_of(grid: StudyGrid, rows: Iterable[Row], *, durations: bool) -> pd.DataFrame:
    """Return rows in the order of the grid: identity, what varies, status, figures, and why it failed."""
    varying = _varying(grid)
    names = ["task", *_SHORT, "repeat", *(f"{part}.{key}" for part, key in varying), "seed", "status"]
    measures = list(grid.study.measures)
    names += [*measures, *(["duration"] if durations else []), "failure"]
    cells: list[list[Any]] = []
    numbers: list[int] = []
    for row in rows:
        parameters, figures = json.loads(row.parameters), json.loads(row.figures)
        numbers.append(row.number)
        cells.append(
            [
                row.task,
                *(_entry(parameters, part, key) for part, key in _SHORT.items()),
                parameters["repeat"],
                *(_entry(parameters, part, key) for part, key in varying),
                row.seed,
                row.status,
                *(_figure(figures.get(name)) for name in measures),
                *([row.duration] if durations else []),
                row.error,
            ]
        )
    return pd.DataFrame(cells, index=pd.Index(numbers, name="number", dtype="int64"), columns=names)


def _entry(parameters: dict[str, Any], part: str, key: str) -> Any:
    return (parameters[part] or {}).get(key)


def _figure(value: float | str | None) -> float:
    return float("nan") if value is None else float(value)


def _varying(grid: StudyGrid) -> list[tuple[str, str]]:
    """Every entry that is not the same wherever there is one, beside those that have a column of their own."""
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


def plain_table(rows: Iterable[Row], *, durations: bool) -> pd.DataFrame:
    """Return rows of any kind in order: identity, parameters, seed, status, every figure that a row has, why it failed."""
    held = list(rows)
    parameters = [json.loads(row.parameters) for row in held]
    figures = [json.loads(row.figures) for row in held]
    index = pd.Index([row.number for row in held], name="number", dtype="int64")
    parts = [
        pd.DataFrame({"task": [row.task for row in held]}, index=index),
        pd.DataFrame(parameters, index=index),
        pd.DataFrame({"seed": [row.seed for row in held], "status": [row.status for row in held]}, index=index),
        pd.DataFrame([{name: _figure(each) for name, each in found.items()} for found in figures], index=index),
        *([pd.DataFrame({"duration": [row.duration for row in held]}, index=index)] if durations else []),
        pd.DataFrame({"failure": [row.error for row in held]}, index=index),
    ]
    return pd.concat(parts, axis=1)


def write_rows(frame: pd.DataFrame, path: Path) -> None:
    """Write a table of rows as CSV or, where the name ends so, as Parquet; whole or not at all.

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
