"""A study: its plan and, after a run, its rows."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd
from pydantic import ValidationError

from inscrutable.errors import InputError
from inscrutable.experiments.sections import PlanFile
from inscrutable.experiments.studies.checking import checked_manifest, checked_rows, fact_of
from inscrutable.experiments.studies.extensions import Extension, extensions_of, from_text
from inscrutable.experiments.studies.grid import StudyGrid
from inscrutable.experiments.studies.kinds import kind_of, layout_of_kind
from inscrutable.experiments.studies.layout import StudyFile
from inscrutable.experiments.studies.means import means_of
from inscrutable.experiments.studies.ranking import protection
from inscrutable.experiments.studies.reading import StudySource, checked_study, read_study
from inscrutable.experiments.studies.store import Store, opened, speaking
from inscrutable.experiments.studies.tasks import DONE, FAILED, Row, TaskGrid
from inscrutable.files import path_of
from inscrutable.saved import Summarised

PathLike = str | os.PathLike[str]


@dataclass(frozen=True)
class StudyStatus:
    """The progress of a study.

    Args:
        done: Tasks with figures.
        failed: Tasks that ended with an error.
        total: Tasks in all.
        seconds: Time that all tasks took together.
    """

    done: int
    failed: int
    total: int
    seconds: float

    @property
    def left(self) -> int:
        """Tasks without a row."""
        return self.total - self.done - self.failed

    def summary(self) -> str:
        """Return one line for a person to read."""
        done = f"{self.done} of {tasks_text(self.total)} done, {self.failed} failed, {self.left} left"
        return f"{done}; {self.seconds:.3g} s of work"


def tasks_text(number: int) -> str:
    """Return a number of tasks in words: 1 task, 2 tasks."""
    return "1 task" if number == 1 else f"{number} tasks"


@dataclass(frozen=True, eq=False, repr=False)
class Study(Summarised):
    """A grid of markets, decision makers, budgets and adversaries, and its rows of results.

    Args:
        plan: The validated plan; `Study.read` and `Study.of` make it.
        folder: Folder of its rows; None before it was run.
        base: Folder in which the file of returns is searched for.
        data_hash: SHA-256 of the returns that worlds are fitted to; None where there are none.

    Cost: reading a study checks it; nothing is computed before `run_study`.

    Example:
        >>> study = Study.of({
        ...     "name": "two ways", "repeats": 2, "world": {"kind": "random"}, "beliefs": {"kind": "grid", "resolution": 4},
        ...     "decision_makers": ["ODM", "PDM"], "budgets": {"values": [0.1, 0.3]},
        ... })
        >>> study.n_tasks
        6
    """

    plan: PlanFile
    folder: Path | None = None
    base: Path = field(default_factory=Path)
    data_hash: str | None = None

    @classmethod
    def read(cls, path: PathLike, *, extensions: Iterable[str] = ()) -> Study:
        """Return the study of a TOML file.

        Args:
            path: The file.
            extensions: Parts of your own that it may name, each "module:name".

        Raises:
            InputError: The file cannot be read, or something in it is wrong: file, line, key, what was expected, and the
                nearest valid name.
        """
        source = path_of(path, "a study's file")
        plan, where = read_study(source, extensions_of(extensions))
        return cls._of(plan, source.parent, where)

    @classmethod
    def of(cls, data: Mapping[str, Any] | PlanFile, *, base: PathLike = ".", extensions: Iterable[str] = ()) -> Study:
        """Return the study of plain data laid out as a study file is, or of settings; file names are relative to `base`.

        Raises:
            InputError: As `read`, without lines.
        """
        source = StudySource("study")
        plan = data if isinstance(data, PlanFile) else checked_study(data, source, extensions_of(extensions))
        return cls._of(plan, Path(base), source)

    @classmethod
    def _of(cls, plan: PlanFile, base: Path, source: StudySource) -> Study:
        kind, is_grid = kind_of(plan), isinstance(plan, StudyFile)
        on_network = getattr(getattr(plan, "problem", None), "network", None) is not None
        key = ("problem", "network") if on_network else ("world", "data")
        with source.saying(key if is_grid else ()):
            data_hash = kind.data_hash(plan, base)
        with source.saying(key[:1] if is_grid else ()):
            kind.check(plan, base)
        return cls(plan, base=base, data_hash=data_hash)

    @classmethod
    def load(cls, folder: PathLike) -> Study:
        """Return the study that was run into a folder, finished or not.

        Raises:
            InputError: The folder holds no study, or its store is damaged or one of another version.
        """
        place = path_of(folder, "a study's folder")
        with closing(opened(place)) as store:
            plan, data_hash = store.fact("study"), store.fact("data_hash")
            name = fact_of(store, "study", dict).get("kind")
            fact_of(store, "extensions", list)
            own = store.fact("extensions") or "[]"
        try:
            found = layout_of_kind(name, from_text(own)).model_validate_json(plan or "")
        except ValidationError as error:
            raise InputError(
                f"{place} holds a study that this release cannot read: {error.errors()[0]['msg']}"
            ) from None
        return cls(found, place, data_hash=data_hash or None)

    @property
    def extensions(self) -> tuple[Extension, ...]:
        """The user-defined parts that the study may name."""
        return getattr(type(self.plan), "extensions", ())

    @cached_property
    def grid(self) -> TaskGrid:
        """The tasks of the study."""
        return kind_of(self.plan).grid(self.plan, self.data_hash)

    @property
    def n_tasks(self) -> int:
        """Number of tasks."""
        return len(self.grid)

    def status(self) -> StudyStatus:
        """Return how far it is.

        Raises:
            InputError: It was not run, or its store is damaged.
        """
        with closing(opened(self._place())) as store:
            counts, seconds = store.counts(), store.seconds()
        return StudyStatus(counts.get(DONE, 0), counts.get(FAILED, 0), self.n_tasks, seconds)

    def frame(self, *, durations: bool = False) -> pd.DataFrame:
        """Return the rows in the order of the grid, one for each task done: what varies, status, figures, failure.

        Args:
            durations: Whether to add the seconds that each task took, which no two runs share.

        Raises:
            InputError: It was not run, or its store is damaged.
        """
        with closing(opened(self._place())) as store, speaking(store.folder):
            return kind_of(self.plan).table(self.grid, self.checked(store), durations)

    def checked(self, store: Store) -> Iterator[Row]:
        """Yield the rows of its store in the order of the grid; raise `InputError` where store or manifest were edited."""
        checked_manifest(store, self.plan, self.n_tasks, self.data_hash)
        return checked_rows(store, self.grid)

    def means(self) -> pd.DataFrame:
        """Return every figure's mean over the repeats and half of its 95 % interval, one row per setting and decision maker.

        Raises:
            InputError: It was not run, its store is damaged, or it is no grid.
        """
        return means_of(*self.gridded()).frame()

    def protection(self) -> list[str]:
        """Return which decision makers hide the belief from each observer, at the middle budget of the first setting that has
        figures.

        A line for each observer and one that says what "hidden" means. Empty where nothing is to be hidden, `error` and
        `top_state` were not measured, or it is no grid.

        Raises:
            InputError: It was not run, or its store is damaged.
        """
        if not isinstance(self.grid, StudyGrid):
            return []
        found = means_of(self.grid, self.frame(), paired=True)
        return protection(found, found.first_setting(), found.middle_budget)

    def cautions(self) -> list[str]:
        """Return cautions on a verdict: unusual budgets; user-defined measures are maximised over candidates alone."""
        odd = self.plan.budgets.remarks() if isinstance(self.plan, StudyFile) else []
        makers = getattr(self.plan, "decision_makers", ())
        own = {goal for each in makers for goal in getattr(each, "goal", ()) if goal in getattr(each, "own", {})}
        if not own:
            return odd
        return [
            *odd,
            f"{', '.join(sorted(own))}: CDM and PDM choose among the candidates alone, because no search follows a measure of "
            "your own; a finer resolution of [candidates] may find more.",
        ]

    def gridded(self) -> tuple[StudyGrid, pd.DataFrame]:
        """Return its grid and its rows; raise `InputError` for a study of another kind."""
        if not isinstance(self.grid, StudyGrid):
            raise InputError(
                f"{self.plan.name} is no grid of settings, so it has no page and no means over repeats; "
                "`inscrutable study export` writes its rows"
            )
        return self.grid, self.frame()

    def errors(self) -> Iterator[str]:
        """Yield the reason of every task that failed, in the order of the grid."""
        with closing(opened(self._place())) as store:
            for row in self.checked(store):
                if row.status == FAILED:
                    yield f"task {row.number} ({row.task}): {row.error}"

    def manifest(self) -> dict[str, Any]:
        """Return versions, seed, resolved study and hash of the data, as they were when it was begun."""
        with closing(opened(self._place())) as store:
            return checked_manifest(store, self.plan, self.n_tasks, self.data_hash)

    def _place(self) -> Path:
        if self.folder is None:
            raise InputError(f"the study {self.plan.name!r} has no rows yet: run_study(study, folder) makes them")
        return self.folder

    def summary(self) -> str:
        """Return one line for a person to read."""
        size = f"{self.plan.name}: {tasks_text(self.n_tasks)}"
        return size if self.folder is None else f"{self.plan.name}: {self.status().summary()}"
