"""Studies that are useful only when complete; a folder that has some of their rows is resumed."""

from __future__ import annotations

import logging
import tomllib
from collections.abc import Callable
from contextlib import closing
from importlib import resources
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from inscrutable.datasets import output_folder
from inscrutable.errors import InputError, ModelError, SolverError
from inscrutable.experiments.sections import PlanFile
from inscrutable.experiments.studies.checking import fact_of
from inscrutable.experiments.studies.runner import (
    StudyProgress,
    continued,
    executor,
    facts_of,
    versions,
)
from inscrutable.experiments.studies.store import MANIFEST, STORE, created, locked, opened
from inscrutable.experiments.studies.study import Study
from inscrutable.experiments.studies.tasks import FAILED, Row
from inscrutable.files import PathLike

BEFORE = "before.sqlite"
"""File to which the rows of an unfinished run are moved when another run begins in its folder; the next is before-2.sqlite."""
_LOGGER = logging.getLogger(__name__)

_Plan = TypeVar("_Plan", bound=PlanFile)
Counted = Callable[[int, int], None]
"""Takes (tasks done, tasks in all)."""


def shipped(name: str) -> dict[str, Any]:
    """Return a study that comes with the package as plain data.

    Args:
        name: "reproduction" or "comparison".

    Example:
        >>> shipped("reproduction")["markets"]
        100
    """
    text = resources.files("inscrutable.experiments.studies").joinpath("shipped", f"{name}.toml").read_text("utf-8")
    return tomllib.loads(text)


def all_rows(
    study: Study,
    folder: PathLike | None = None,
    *,
    jobs: int = 1,
    again: bool = True,
    prepared: Callable[[list[dict[str, Any]]], None] = lambda worlds: None,
    progress: Counted | None = None,
) -> tuple[list[Row], list[dict[str, Any]]]:
    """Do every task of a study, and return its rows in order with what was prepared for them.

    Args:
        study: A study.
        folder: Where its rows are kept while it runs. An unfinished run of the same study by the same versions is
            continued. Any other study of its kind is begun anew, and an unfinished one is set aside. None keeps nothing.
        jobs: As for `run_study`.
        again: Whether a finished run of the same study is repeated; otherwise its rows are returned.
        prepared: Called with what was prepared before the first task.
        progress: Called with (tasks done, tasks in all) for every task.

    Raises:
        InputError: As `run_study`; or the folder holds another study.
        InscrutableError: The first task that failed, with its error.
    """
    execute = executor(jobs, None)
    if folder is None:
        with TemporaryDirectory() as kept:
            return all_rows(study, kept, jobs=jobs, prepared=prepared, progress=progress)
    place = output_folder(folder)
    with locked(place):
        if not _can_go_on(study, place, again=again):
            _set_aside(place)
            created(place, facts_of(study)).close()
        with closing(opened(place, writable=True)) as store:
            told = 0

            def watch(how: StudyProgress) -> None:
                nonlocal told
                while told < how.done:  # once for every task, also where tasks come in batches
                    told += 1
                    if progress is not None:
                        progress(told, study.n_tasks)
                if how.failed:
                    check_done(list(store.rows()))

            worlds = fact_of(store, "worlds", list)
            prepared(worlds)
            continued(store, execute, watch, limit=None, retry=True)
            rows = list(study.checked(store))
            check_done(rows)
            return rows, worlds


def rows_of_whole(study: Study, layout: type[_Plan], what: str) -> tuple[_Plan, list[Row], list[dict[str, Any]]]:
    """Return the file of a finished study of one kind, its rows in order, and what was prepared for them.

    Raises:
        InputError: The study is of another kind than `what` says, was not run, or some of its tasks have no figures.
    """
    if not isinstance(study.plan, layout):
        raise InputError(f"{study.plan.name} is no {what}")
    status = study.status()
    if status.done < status.total:
        missing = " and ".join(
            f"{number} of {status.total} tasks {what}"
            for number, what in ((status.left, "have no row"), (status.failed, "failed"))
            if number
        )
        retry = " --retry" if status.failed else ""
        raise InputError(
            f"{study.folder} is not finished: {missing}, and its page needs all of them; "
            f"go on with `inscrutable study resume {study.folder}{retry}`"
        )
    assert study.folder is not None
    with closing(opened(study.folder)) as store:
        return study.plan, list(study.checked(store)), fact_of(store, "worlds", list)


def check_done(rows: list[Row]) -> None:
    """Raise the error of the first row that failed."""
    for row in rows:
        if row.status == FAILED:
            name, _, text = row.error.partition(": ")
            known = {each.__name__: each for each in (InputError, ModelError, SolverError)}
            raise known[name](text) if name in known else SolverError(row.error)


def _can_go_on(study: Study, place: Path, *, again: bool) -> bool:
    """Whether the folder has rows of the same study that can be continued; with `again` a finished study cannot."""
    if not (place / STORE).exists():
        return False
    found = Study.load(place)
    if type(found.plan) is not type(study.plan):
        raise InputError(f"{place} holds another study, {found.plan.name!r}; choose another folder")
    same = found.plan == study.plan and found.data_hash == study.data_hash
    same = same and found.manifest().get("versions") == versions()
    return same and (not again or found.status().done < found.n_tasks)


def _set_aside(place: Path) -> None:
    """Make room for a store; the rows of an unfinished run are kept beside it, in case the user mistyped a setting."""
    (place / MANIFEST).unlink(missing_ok=True)
    if not (place / STORE).exists():
        return
    found = Study.load(place)
    if 0 < found.status().done < found.n_tasks:
        kept = place / BEFORE
        for number in count(2):
            if not kept.exists():
                break
            kept = place / f"{Path(BEFORE).stem}-{number}.sqlite"
        (place / STORE).replace(kept)
        _LOGGER.warning(
            "inscrutable: %s held an unfinished run of other settings or versions; its rows are now in %s",
            place,
            kept.name,
        )
    (place / STORE).unlink(missing_ok=True)
