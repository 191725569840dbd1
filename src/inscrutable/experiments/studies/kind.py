"""A kind of study: the layout of its file, its tasks, and their runner."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from inscrutable.experiments.sections import PlanFile
from inscrutable.experiments.studies.tables import plain_table
from inscrutable.experiments.studies.tasks import Row, TaskGrid, TaskRunner


@dataclass(frozen=True)
class Kind:
    """One kind of study.

    Args:
        layout: Its file.
        grid: Returns the tasks, from the file and the hash of its data.
        runner: Does them.
        data_hash: Returns the hash of the data that a file names, from the file and its folder; None without any.
        prepared: Returns data that are computed once for all processes, as plain data, from the file and its folder.
        table: Returns rows as a table, from the tasks and the rows, with the seconds that each took or without.
        check: Raises an error if the data that a file names are invalid, from the file and its folder.
        has_page: Whether `inscrutable study report` writes a page of it.
    """

    layout: type[PlanFile]
    grid: Callable[[Any, str | None], TaskGrid]
    runner: type[TaskRunner]
    data_hash: Callable[[Any, Path], str | None] = lambda plan, base: None
    prepared: Callable[[Any, Path, Any], list[dict[str, Any]]] = lambda plan, base, grid: []
    table: Callable[[Any, Iterable[Row], bool], pd.DataFrame] = plain_table
    check: Callable[[Any, Path], None] = lambda plan, base: None
    has_page: bool = True
