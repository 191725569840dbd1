"""Rows and facts of a store, checked against the study: a file that was edited is refused wherever it is read."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

from inscrutable.errors import InputError
from inscrutable.experiments.sections import PlanFile
from inscrutable.experiments.studies.grid import StudyGrid
from inscrutable.experiments.studies.store import MANIFEST, STORE, Store, damaged, speaking
from inscrutable.experiments.studies.tasks import DONE, FAILED, Row, TaskGrid, seed_of
from inscrutable.files import read_json

_BESIDE_NUMBERS = (None, "Infinity", "-Infinity")


def checked_rows(store: Store, grid: TaskGrid) -> Iterator[Row]:
    """Yield all rows in the order of the grid.

    Raises:
        InputError: A row is none of the study's tasks, has other parameters or another seed than its task, or figures that are
            no numbers.
    """
    total = len(grid)
    for row in store.rows():
        if not 0 <= row.number < total:
            raise damaged(store.folder, f"it has a row {row.number}, the study {total} tasks")
        wrong = _wrong(row, grid)
        if wrong:
            raise damaged(store.folder, f"row {row.number} {wrong}")
        yield row


def _wrong(row: Row, grid: TaskGrid) -> str:
    """What is wrong with a row, in words; empty where nothing is."""
    task = grid.task(row.number)
    if (row.task, row.parameters) != (task.key, task.text):
        return "is not that of its task in this study"
    seed = seed_of(grid, task)
    if row.seed != seed:
        return f"has the seed {row.seed}, its task {seed}"
    if row.status not in (DONE, FAILED):
        return f"has the status {row.status!r}, expected {DONE} or {FAILED}"
    try:
        float(row.duration)
    except ValueError:
        return f"has the duration {row.duration!r}, expected seconds"
    try:
        figures = json.loads(row.figures)
    except ValueError as error:
        return f"has figures that cannot be read: {error}"
    if not isinstance(figures, dict):
        return f"has the figures {row.figures!r:.60}, expected names and numbers"
    for name, value in figures.items():
        if not (value in _BESIDE_NUMBERS or (isinstance(value, (int, float)) and not isinstance(value, bool))):
            return f"has the figure {name} {value!r:.60}, expected a number"
    measures = grid.study.measures if isinstance(grid, StudyGrid) and row.status == DONE else ()
    lacking = [name for name in measures if name not in figures]
    return f"lacks the figure {lacking[0]}" if lacking else ""


def fact_of(store: Store, name: str, kind: type) -> Any:
    """Return a fact that is JSON of one type; raise `InputError` for any other. A fact that is missing is empty."""
    text = store.fact(name)
    with speaking(store.folder):
        found = kind() if text is None else json.loads(text)
    if not isinstance(found, kind):
        raise damaged(store.folder, f"its fact {name} is {text!r:.60}, expected a JSON {kind.__name__}")
    return found


def checked_manifest(store: Store, plan: PlanFile, n_tasks: int, data_hash: str | None) -> dict[str, Any]:
    """Return the manifest in a store.

    Raises:
        InputError: It is of another study, or manifest.json beside it is another one.
    """
    found: dict[str, Any] = fact_of(store, "manifest", dict)
    expected = {"seed": plan.seed, "tasks": n_tasks, "data_sha256": data_hash}
    other = [name for name, value in expected.items() if found.get(name) != value]
    if other:
        name = other[0]
        raise damaged(store.folder, f"its manifest has {name} {found.get(name)!r}, its study {expected[name]!r}")
    beside = store.folder / MANIFEST
    written = read_json(beside, "the manifest of a study") if beside.exists() else found
    if not isinstance(written, dict) or _settled(written) != _settled(found):
        raise InputError(
            f"{beside} is not the manifest in {STORE}: it was edited. Delete it; `inscrutable study resume {store.folder}` "
            "writes it anew"
        )
    return found


def _settled(manifest: dict[str, Any]) -> dict[str, Any]:
    """The entries of a manifest that never change; versions are added while a study goes on."""
    return {name: value for name, value in manifest.items() if name not in ("versions", "continued_with")}
