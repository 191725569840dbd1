"""Kinds of study: what a file of each may hold, which tasks it has, and who does them.

A file names its kind; it can name none but these, so that a study file stays plain data.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from inscrutable.experiments.studies.grid import StudyGrid, TaskGrid
from inscrutable.experiments.studies.layout import FittedWorldSection, PlanFile, StudyFile
from inscrutable.experiments.studies.markets import fitted_world, hash_of_data, training_of
from inscrutable.experiments.studies.tables import plain_table, table_of
from inscrutable.experiments.studies.workshop import Row, Shop, Work, Workshop

OTHER_KINDS = ("reproduction", "comparison")
"""Names that the key `kind` of a file may hold; a file without it is a grid."""


@dataclass(frozen=True)
class Kind:
    """One kind of study.

    Args:
        layout: Its file.
        grid: Returns the tasks, from the file and the hash of its data.
        shop: Does them.
        data_hash: Returns the hash of the data that a file names, from the file and its folder; None without any.
        prepared: Returns what is computed once for all processes, as plain data, from the file and its folder.
        table: Returns rows as a table.
        check: Raises what is wrong with the data that a file names, from the file and its folder.
    """

    layout: type[PlanFile]
    grid: Callable[[Any, str | None], TaskGrid]
    shop: Callable[[Work], Shop]
    data_hash: Callable[[Any, Path], str | None] = lambda plan, base: None
    prepared: Callable[[Any, Path, TaskGrid], list[dict[str, Any]]] = lambda plan, base, grid: []
    table: Callable[[TaskGrid, Iterable[Row], bool], pd.DataFrame] = lambda grid, rows, durations: plain_table(
        rows, durations=durations
    )
    check: Callable[[Any, Path], None] = lambda plan, base: None


def kind_named(name: str | None) -> Kind:
    """Return a kind by the name in a file; None, where a file has none, is a grid."""
    if name == "reproduction":
        from inscrutable.experiments.reproduction_study import REPRODUCTION

        return REPRODUCTION
    if name == "comparison":
        from inscrutable.experiments.comparison_study import COMPARISON

        return COMPARISON
    return GRID


def kind_of(plan: PlanFile) -> Kind:
    """Return the kind of a study's file."""
    return kind_named(getattr(plan, "kind", None))


def _hash(plan: StudyFile, base: Path) -> str | None:
    return hash_of_data(plan.world, base) if isinstance(plan.world, FittedWorldSection) else None


def _check(plan: StudyFile, base: Path) -> None:
    if isinstance(plan.world, FittedWorldSection):
        training_of(plan.world, max(plan.world.regimes), base)


def _fitted(plan: StudyFile, base: Path, grid: TaskGrid) -> list[dict[str, Any]]:
    """The worlds that are fitted to data, once and here, so that all machines work with the same digits."""
    if not isinstance(plan.world, FittedWorldSection):
        return []
    assert isinstance(grid, StudyGrid)
    found = []
    for place, choice in enumerate(grid.worlds):
        assert choice.data is not None
        rng = grid.stream("fit", (place, 0, 0, 0, 0, 0, 0), ("world",))
        found.append(fitted_world(plan.world, choice.data["regimes"], base, rng=rng))
    return found


def _table(grid: TaskGrid, rows: Iterable[Row], durations: bool) -> pd.DataFrame:
    assert isinstance(grid, StudyGrid)
    return table_of(grid, rows, durations=durations)


GRID = Kind(StudyFile, StudyGrid, Workshop, _hash, _fitted, _table, _check)
"""Every combination of what a file's lists hold."""
