"""The verbs of `inscrutable study`: run, status, resume, export, report, keys."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import App, Parameter, validators

from inscrutable.cli_console import Speech, show_table
from inscrutable.cli_values import OUTPUT, WORK, Out, UsageError, Whole
from inscrutable.errors import DiskError, InscrutableError

if TYPE_CHECKING:
    from inscrutable.experiments.studies import Study, StudyProgress

FAILED_TASKS = 1
STUDY, AGAIN = "study", "give the same command again"
"""The folder of the study behind other verbs' results, and the commands that continue a stopped one."""
_PAGE = "report.html"
_REPORT = "inscrutable study report {}"
_ERRORS_SHOWN = 3

study = App(
    name="study",
    help="Run a study: a grid of markets, decision makers, budgets and adversaries, with rows that survive a kill.",
    help_epilogue="Exit code 1: a task failed; its row says why, and the others are done.",
    help_format="markdown",
)

Jobs = Annotated[Whole, Parameter(group=WORK)]
Cluster = Annotated[str | None, Parameter(group=WORK)]
Extensions = Annotated[list[str], Parameter(name="--extension", group=WORK, negative=(), show_default=False)]
Limit = Annotated[Whole | None, Parameter(group=WORK, validator=validators.Number(gte=1))]


@study.command
def run(
    file: Path,
    /,
    *,
    out: Out,
    jobs: Jobs = 1,
    cluster: Cluster = None,
    limit: Limit = None,
    extension: Extensions = [],  # noqa: B006  # read alone
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> int:
    """Run a study from the start, into a folder of its own.

    Args:
        file: The study file (TOML).
        out: Folder for the rows (study.sqlite) and manifest.json.
        jobs: Processes; -1 is one per core. Changes nothing but the time.
        cluster: Address of a Dask scheduler, such as tcp://10.0.0.1:8786 (needs the extra `inscrutable[dask]`).
        limit: Do at most this many tasks now, spread over the grid; `study resume` does the rest.
        extension: A part of your own that the file names, as module:name, importable here. May be given several times.
    """
    from inscrutable.experiments.studies import Study, run_study
    from inscrutable.experiments.studies.study import tasks_text

    plan = Study.read(file, extensions=extension)
    speech.log(f"{plan.plan.name}: {tasks_text(plan.n_tasks)}")
    with resumable(out, then=_REPORT):
        with _watched(speech) as watch:
            done = run_study(plan, out, jobs=jobs, cluster=cluster, limit=limit, progress=watch)
        return _told(done, speech)


@study.command
def resume(
    folder: Path,
    /,
    *,
    jobs: Jobs = 1,
    cluster: Cluster = None,
    limit: Limit = None,
    retry: Annotated[bool, Parameter(group=WORK, negative=(), show_default=False)] = False,
    extension: Extensions = [],  # noqa: B006  # read alone
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> int:
    """Continue a study that was stopped, killed or limited: only tasks without a row are done.

    Args:
        folder: The study's folder.
        jobs: Processes; -1 is one per core.
        cluster: Address of a Dask scheduler.
        limit: Do at most this many tasks now.
        retry: Also do the tasks that failed.
        extension: The extensions that the study was started with.
    """
    from inscrutable.experiments.studies import resume_study

    with resumable(folder, then=_REPORT):
        with _watched(speech) as watch:
            done = resume_study(
                folder, jobs=jobs, cluster=cluster, retry=retry, limit=limit, progress=watch, extensions=extension
            )
        return _told(done, speech)


@study.command
def status(
    folder: Path,
    /,
    *,
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> None:
    """Show how far a study is, also while it runs.

    Args:
        folder: The study's folder.
    """
    from inscrutable.experiments.studies import Study

    found = Study.load(folder)
    _say_status(found, speech)
    if not speech.json:
        _say_errors(found, speech)


@study.command
def export(
    folder: Path,
    /,
    *,
    to: Annotated[Literal["csv", "parquet"], Parameter(group=OUTPUT)] = "csv",
    out: Out | None = None,
    durations: Annotated[bool, Parameter(group=OUTPUT, negative=(), show_default=False)] = False,
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> None:
    """Write the rows of a study as a table, in the order of its grid.

    Args:
        folder: The study's folder.
        to: The kind of file; Parquet needs pyarrow.
        out: The file. Default: rows.csv or rows.parquet in the study's folder.
        durations: Add the seconds that each task took. Without them the same study gives the same bytes.
    """
    from inscrutable.experiments.studies import Study
    from inscrutable.experiments.studies.tables import write_rows

    path = folder / f"rows.{to}" if out is None else out
    if out is not None and (out.suffix == ".parquet") != (to == "parquet"):
        raise UsageError(f"--out {out} does not go with --to {to}: name the file *.{to}")
    frame = Study.load(folder).frame(durations=durations)
    write_rows(frame, path)
    if speech.json:
        speech.summary({"rows": len(frame), "file": path})
        return
    speech.sentence(f"{len(frame)} rows")
    speech.files([path])


@study.command
def report(
    folder: Path,
    /,
    *,
    out: Out | None = None,
    title: Annotated[str | None, Parameter(group=OUTPUT)] = None,
    speech: Speech = Speech(),  # noqa: B008  # frozen
) -> None:
    """Write the study, finished or not, as one HTML page that works offline (needs the extra `inscrutable[report]`).

    Args:
        folder: The study's folder; or that of a reproduction or a comparison, which must be finished.
        out: The file. Default: report.html in that folder.
        title: The heading. Default: the study's name.
    """
    from inscrutable.experiments.studies import Study
    from inscrutable.reports.page import write_page
    from inscrutable.reports.page.study_page import study_verdict

    within = _study_within(folder)
    found = Study.load(within or folder)
    path = folder / _PAGE if out is None else out
    known = within is not None and out is None and title is None and path.exists()
    if not known:
        write_page(found, path, title=title)
    if speech.json:
        speech.summary({"name": found.plan.name, "file": path})
        return
    speech.sentence(found.summary())
    for line in study_verdict(found):
        speech.sentence(line)
    if known:
        speech.sentence(f"Its page is {path}, written with the results; --out names a file for another")
    else:
        speech.files([path])


@study.command
def keys(section: str | None = None, /, *, speech: Speech = Speech()) -> None:  # noqa: B008  # frozen
    """Show what a study file may hold: its keys, with their defaults, and the measures.

    Args:
        section: A section alone, such as world, decision_makers or measures.
    """
    import pandas as pd

    from inscrutable.axes import few
    from inscrutable.experiments.studies.keys import key_tables

    every = key_tables()
    tables = [each for each in every if section in (None, each.section)]
    if not tables:
        known = dict.fromkeys(each.section for each in every)
        raise UsageError(f"no section {section!r}; there are {few(known, len(known))}")
    if speech.json:
        speech.summary({each.title: [dict(zip(each.head, row, strict=True)) for row in each.rows] for each in tables})
        return
    for each in tables:
        speech.sentence(f"{each.title}. {each.text}".strip())
        if each.rows:
            frame = pd.DataFrame(each.rows, columns=list(each.head)).set_index(each.head[0])
            show_table(frame, "", prose=True)


def _study_within(folder: Path) -> Path | None:
    """Return the folder of the study behind another verb's results, if there is one."""
    from inscrutable.experiments.studies.store import STORE

    return folder / STUDY if (folder / STUDY / STORE).is_file() and not (folder / STORE).exists() else None


def _told(done: Study, speech: Speech) -> int:
    from inscrutable.experiments.studies.kinds import kind_of

    _say_status(done, speech)
    how = done.status()
    if how.failed:
        _say_errors(done, speech)
    if how.left:
        speech.log(f"To do the others: inscrutable study resume {done.folder}")
    elif not speech.json:
        then = (
            f"figures and page: {_REPORT}"
            if kind_of(done.plan).has_page
            else "rows as a table: inscrutable study export {}"
        )
        speech.log(f"Its {then.format(done.folder)}")
    return FAILED_TASKS if how.failed else 0


def _say_status(found: Study, speech: Speech) -> None:
    how = found.status()
    if speech.json:
        data = {"done": how.done, "failed": how.failed, "left": how.left, "total": how.total, "seconds": how.seconds}
        speech.summary({"name": found.plan.name, "folder": found.folder, **data})
        return
    speech.sentence(found.summary())


def _say_errors(found: Study, speech: Speech) -> None:
    """Log the first reasons on stderr; the table has all of them."""
    for shown, error in enumerate(found.errors()):
        if shown == _ERRORS_SHOWN:
            speech.log("  and others; `inscrutable study export` lists all")
            return
        speech.log(f"  {error}")


@contextmanager
def resumable(folder: Path, how: str = "inscrutable study resume {}", then: str = AGAIN) -> Iterator[None]:
    """Print how to continue a stopped run; `then` is the command if all tasks are done and only files are missing."""
    from inscrutable.experiments.studies.store import STORE

    before = _stamp(folder / STORE)
    try:
        yield
    except BaseException as error:
        began = before != _stamp(folder / STORE) or not isinstance(error, InscrutableError)
        if began and (folder / STORE).exists():
            done, left = _counted(folder)
            is_refused = isinstance(error, InscrutableError) and not isinstance(error, DiskError)
            if done or not is_refused:  # what is refused at once would be refused again
                kept, on = ("Rows so far are kept.", how) if left else ("All tasks are stored.", then)
                print(f"{kept} To go on: {on.format(folder)}", file=sys.stderr, flush=True)
        raise


def _counted(folder: Path) -> tuple[int, int]:
    """Return how many tasks have figures, and how many have no row; (0, 1) where the study cannot be read."""
    from inscrutable.experiments.studies import Study

    try:
        status = Study.load(folder).status()
    except InscrutableError:
        return 0, 1
    return status.done, status.left


def was_told(folder: Path) -> bool:
    """Whether all results of the study within a folder were written after its last row."""
    from inscrutable.experiments.studies.store import STORE
    from inscrutable.reports.page import can_write_pages

    last = _stamp(folder / STUDY / STORE)
    written = [_stamp(folder / name) for name in ("summary.json", *([_PAGE] if can_write_pages() else []))]
    return last is not None and all(each is not None and each[0] >= last[0] for each in written)


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


@contextmanager
def _watched(speech: Speech) -> Iterator[Callable[[StudyProgress], None]]:
    with speech.steps() as tell:
        yield lambda progress: tell(progress.fresh, progress.asked, progress_text(progress))


def progress_text(progress: StudyProgress) -> str:
    """Return one line: tasks done, failed, rate and time left."""
    left = progress.seconds_left
    rest = "" if left is None else f", {progress.rate:.3g} tasks/s, {clock(left)} left"
    return f"Tasks: {progress.done} of {progress.total} done, {progress.failed} failed{rest}"


def clock(seconds: float) -> str:
    """Return a time as 1:02:03, or 2:03 below an hour.

    Example:
        >>> clock(3723.4), clock(59.6)
        ('1:02:03', '1:00')
    """
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
