"""Run a study: do the tasks that have no row yet, and keep their rows."""

from __future__ import annotations

import json
import logging
import platform
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

from inscrutable import validation
from inscrutable.datasets import output_folder, write_json
from inscrutable.errors import InputError
from inscrutable.experiments.studies.checking import fact_of
from inscrutable.experiments.studies.executors import Executor, in_processes, on_cluster, serial
from inscrutable.experiments.studies.extensions import as_text, checked_again
from inscrutable.experiments.studies.kinds import kind_of
from inscrutable.experiments.studies.store import MANIFEST, STORE, Store, created, locked, opened
from inscrutable.experiments.studies.study import PathLike, Study
from inscrutable.experiments.studies.tasks import FAILED, Row, Work
from inscrutable.files import path_of

_LOGGER = logging.getLogger(__name__)
_PACKAGES = ("inscrutable", "numpy", "scipy", "numba", "daqp", "pandas", "pydantic", "joblib")


@dataclass(frozen=True)
class StudyProgress:
    """The progress of a run.

    Args:
        done: Tasks that have a row, failed ones included.
        failed: Those that failed.
        total: Tasks in all.
        fresh: Tasks done since this run began.
        seconds: Time since the run began.
        asked: Tasks that this run is to do.
    """

    done: int
    failed: int
    total: int
    fresh: int
    seconds: float
    asked: int

    @property
    def rate(self) -> float:
        """Tasks per second since this run began."""
        return self.fresh / self.seconds if self.seconds > 0 else 0.0

    @property
    def seconds_left(self) -> float | None:
        """Time left at the present rate; None before the first task is done."""
        return (self.asked - self.fresh) / self.rate if self.rate > 0 else None


Watch = Callable[[StudyProgress], None]


def run_study(
    study: Study | PathLike,
    out: PathLike,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    limit: int | None = None,
    progress: Watch | None = None,
    extensions: Iterable[str] = (),
) -> Study:
    """Run every task of a study and store the rows in a folder.

    Args:
        study: A study, or the path of its TOML file.
        out: Folder for study.sqlite and manifest.json, without a study yet.
        jobs: Processes on this machine; −1 is one per core. The number affects the time only.
        cluster: Address of a Dask scheduler, such as tcp://10.0.0.1:8786, whose workers then do the tasks.
        limit: Largest number of tasks to run now, spread evenly over the grid; `resume_study` runs the others. None runs
            all.
        progress: Called with a `StudyProgress` after every batch of rows.
        extensions: Parts of your own that its file names: measures, decision makers, observers, problems, emissions, each
            "module:name", importable where tasks are done.

    Returns:
        The study with its rows. The same study gives the same rows, however it was run; a task that fails has a row too.

    Raises:
        InputError: The study is malformed, the folder cannot be written to, holds a study already, or is in use; the disk is
            full. Rows that were stored before are kept, and `resume_study` goes on.

    Cost: the tasks', plus some hundredths of a second per second of them.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> study = Study.of({
        ...     "name": "small", "world": {"kind": "random"}, "beliefs": {"kind": "grid", "resolution": 4},
        ...     "candidates": {"resolution": 4}, "decision_makers": ["ODM", "uniform"], "measures": ["error"],
        ... })
        >>> with TemporaryDirectory() as folder:
        ...     run_study(study, folder).frame()[["decision_maker", "status"]]
               decision_maker status
        number
        0                 ODM   done
        1             uniform   done
    """
    if isinstance(study, Mapping):
        raise InputError(
            "study must be a Study or the path of its file, got a mapping; Study.of(mapping) makes one of it"
        )
    own = list(extensions) if not isinstance(extensions, str) else extensions
    chosen = study if isinstance(study, Study) else Study.read(study, extensions=own)
    if isinstance(study, Study):
        checked_again(study.extensions, own or [each.spec for each in study.extensions], study.plan.model_dump_json())
    execute = executor(jobs, cluster)
    folder = output_folder(out)
    with locked(folder):
        if (folder / STORE).exists():
            raise InputError(_taken(folder, chosen))
        if (folder / MANIFEST).exists():
            raise InputError(f"{folder} has a {MANIFEST}, but no {STORE}: it was lost; run into another folder")
        with closing(created(folder, facts_of(chosen))) as store:
            return continued(store, execute, progress, limit=limit, retry=False)


def _taken(folder: Path, chosen: Study) -> str:
    """Return the message for a folder that holds a study."""
    held = Study.load(folder)
    if (held.plan, held.data_hash) == (chosen.plan, chosen.data_hash):
        return f"{folder} holds this study already: go on with `inscrutable study resume {folder}`, or run into another folder"
    return f"{folder} holds another study, {held.plan.name!r}, or this one with other settings; run into another folder"


def resume_study(
    folder: PathLike,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    retry: bool = False,
    limit: int | None = None,
    progress: Watch | None = None,
    extensions: Iterable[str] = (),
) -> Study:
    """Run the tasks of a study that have no row yet.

    Args:
        folder: The folder of the study.
        jobs: As for `run_study`.
        cluster: As for `run_study`.
        retry: Whether tasks that failed are run again.
        limit: As for `run_study`.
        progress: As for `run_study`.
        extensions: The extensions that it was begun with; one whose source has changed is refused.

    Returns:
        The study with its rows: the same as if it had never stopped.

    Raises:
        InputError: The folder holds no study, is in use or cannot be written to; the store is damaged, or one of another
            version.

    Cost: the tasks'.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable import run_study
        >>> study = Study.of({
        ...     "name": "small", "world": {"kind": "random"}, "beliefs": {"kind": "grid", "resolution": 4},
        ...     "candidates": {"resolution": 4}, "decision_makers": ["ODM", "uniform"], "measures": ["error"],
        ... })
        >>> with TemporaryDirectory() as folder:
        ...     half = run_study(study, folder, limit=1).status().left
        ...     half, resume_study(folder).status().left
        (1, 0)
    """
    execute = executor(jobs, cluster)
    place = path_of(folder, "a study's folder")
    begun = Study.load(place)
    checked_again(begun.extensions, extensions, begun.plan.model_dump_json())
    with closing(opened(place)):
        pass  # say what is wrong with it before anything is written
    with locked(place), closing(opened(place, writable=True)) as store:
        store.check()
        _say_what_changed(store)
        return continued(store, execute, progress, limit=limit, retry=retry)


def _say_what_changed(store: Store) -> None:
    """Warn if other versions continue a study: rows may then differ in more than their order."""
    before, now = fact_of(store, "manifest", dict).get("versions", {}), versions()
    changed = [f"{name} {before[name]} (now {now[name]})" for name in _changed(before, now)]
    if changed:
        _LOGGER.warning(
            "inscrutable: %s was begun with %s; new rows may differ from what those would give",
            store.folder,
            ", ".join(changed),
        )


def _changed(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """The names whose versions are others now."""
    return [name for name in now if before.get(name, now[name]) != now[name]]


def _keep_versions(store: Store) -> None:
    """Add to the manifest in a store the versions that differ from those it was begun with."""
    known, now = fact_of(store, "manifest", dict), versions()
    later = {name: now[name] for name in _changed(known.get("versions", {}), now)}
    if later and later not in known.get("continued_with", []):
        known["continued_with"] = [*known.get("continued_with", []), later]
        store.keep_fact("manifest", json.dumps(known))
        write_json(known, store.folder / MANIFEST)


def executor(jobs: int, cluster: str | None) -> Executor:
    """Return the executor that is asked for, or raise `InputError`."""
    validation.processes(jobs, "jobs")
    if cluster is not None and jobs != 1:
        raise InputError(f"jobs={jobs} and a cluster exclude one another: a cluster has workers of its own")
    if cluster is not None:
        return on_cluster(cluster)
    return serial if jobs == 1 else in_processes(jobs)


def facts_of(study: Study) -> dict[str, str]:
    """Return the facts that the store holds from the start, so that nothing outside it is needed to go on."""
    manifest = {
        "study": study.plan.model_dump(mode="json", exclude_none=True),
        "seed": study.plan.seed,
        "tasks": study.n_tasks,
        "versions": versions(),
        "data_sha256": study.data_hash,
        **({"extensions": json.loads(as_text(study.extensions))} if study.extensions else {}),
    }
    return {
        "study": study.plan.model_dump_json(),
        "data_hash": study.data_hash or "",
        "worlds": json.dumps(kind_of(study.plan).prepared(study.plan, study.base, study.grid)),
        "extensions": as_text(study.extensions),
        "manifest": json.dumps(manifest),
    }


def versions() -> dict[str, str]:
    """Return the versions on which figures may depend: Python, packages and the kind of machine."""
    machine = {"python": platform.python_version(), "machine": f"{platform.system()} {platform.machine()}"}
    return machine | {name: _version_of(name) for name in _PACKAGES}


@cache
def _version_of(package: str) -> str:
    """A package's version; its metadata are read once, which takes longer than a small study."""
    return version(package)


def work_of(study: Study, worlds: str) -> Work:
    """Return what processes need to know of a study, with what was prepared for them."""
    return Work(
        kind_of(study.plan).runner, study.plan.model_dump_json(), study.data_hash, worlds, as_text(study.extensions)
    )


def continued(store: Store, execute: Executor, progress: Watch | None, *, limit: int | None, retry: bool) -> Study:
    """Do the tasks that a store has no row of."""
    study = Study.load(store.folder)
    if not (store.folder / MANIFEST).exists():
        write_json(study.manifest(), store.folder / MANIFEST)
    for _ in study.checked(store):
        pass  # no row joins those of another study
    fact_of(store, "worlds", list)
    work = work_of(study, store.fact("worlds") or "[]")
    missing = _missing(store, study.n_tasks, without_failed=retry)
    if limit is not None and validation.count(limit, "limit") < len(missing):
        missing = missing[np.linspace(0, len(missing) - 1, limit).round().astype(np.intp)]
    if len(missing):
        _keep_versions(store)
    keep = _Keeper(store, study.n_tasks, len(missing), progress, _failed_left(store, retry=retry))
    keep.said()
    execute(work, (int(number) for number in missing), keep)
    return study


def _failed_left(store: Store, *, retry: bool) -> tuple[int, int]:
    """Return the number of rows that stay as they are, and how many of them failed."""
    counts = store.counts()
    failed = counts.get(FAILED, 0)
    return (sum(counts.values()) - failed, 0) if retry else (sum(counts.values()), failed)


def _missing(store: Store, total: int, *, without_failed: bool) -> np.ndarray:
    """The numbers of tasks without a row, in order."""
    free = np.ones(total, dtype=bool)
    for number in store.numbers(without_failed=without_failed):
        free[number] = False
    return np.flatnonzero(free)


class _Keeper:
    """Stores rows as they come and reports progress."""

    def __init__(self, store: Store, total: int, asked: int, progress: Watch | None, before: tuple[int, int]) -> None:
        self._store, self._total, self._asked, self._progress = store, total, asked, progress
        self._done, self._failed = before
        self._fresh = 0
        self._started = time.monotonic()

    def __call__(self, rows: list[Row]) -> None:
        self._store.add(rows)
        self._fresh += len(rows)
        self._failed += sum(row.status == FAILED for row in rows)
        self.said()

    def said(self) -> None:
        """Report the progress."""
        if self._progress is not None:
            seconds = time.monotonic() - self._started
            done = self._done + self._fresh
            self._progress(StudyProgress(done, self._failed, self._total, self._fresh, seconds, self._asked))
