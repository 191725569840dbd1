"""Output of the command line: results to stdout, progress and log to stderr."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import wrap
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from inscrutable.labels import label_text

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

SEED_KNOWN = "Caution: whoever knows the seed knows the draw; without --seed the operating system draws."
_PLAIN_WIDTH = 150
_INDEX_WIDTH = 28
_BETWEEN_COLUMNS = 3  # characters
_SECONDS_BETWEEN_LINES = 10.0


@Parameter(name="*", group="Output")
@dataclass(frozen=True)
class Speech:
    """Options of the output.

    Args:
        json: Print a machine-readable summary instead of tables.
        quiet: No progress and no log on stderr; errors are still printed.
        verbose: Print more on stderr, with the traceback of an unexpected error.
    """

    json: Annotated[bool, Parameter(name="--json", negative=(), show_default=False)] = False
    quiet: Annotated[bool, Parameter(name=("--quiet", "-q"), negative=(), show_default=False)] = False
    verbose: Annotated[bool, Parameter(name=("--verbose", "-v"), negative=(), show_default=False)] = False

    def log(self, text: str) -> None:
        """Print one line on stderr."""
        if not self.quiet:
            print(text, file=sys.stderr, flush=True)

    def detail(self, text: str) -> None:
        """Print one line on stderr if `verbose`."""
        if self.verbose and not self.quiet:
            print(text, file=sys.stderr, flush=True)

    def files(self, paths: Iterable[Path]) -> None:
        """List the files that were written, after the results."""
        listed = [str(path) for path in paths]
        if listed and not self.json:
            print("Written:\n  " + "\n  ".join(listed))

    def summary(self, data: dict[str, Any]) -> None:
        """Print plain data as JSON on stdout, identical to a summary file."""
        from inscrutable.datasets import write_json

        with TemporaryDirectory() as folder:
            path = Path(folder, "summary.json")
            write_json(data, path)
            self.summary_file(path)

    def summary_file(self, path: Path) -> None:
        """Print a summary file that was just written."""
        sys.stdout.write(path.read_text("utf-8"))

    def sentence(self, text: str) -> None:
        """Print a line of the results on stdout."""
        print(text)

    @contextmanager
    def progress(self, what: str) -> Iterator[Callable[[int, int], None]]:
        """Give a function (done, in all) that moves a bar on a terminal and writes occasional lines elsewhere."""
        with self.steps(timed=True) as tell:
            yield lambda done, total: tell(done, total, f"{what}: {done} of {total}")

    @contextmanager
    def steps(self, *, timed: bool = False) -> Iterator[Callable[[int, int, str], None]]:
        """Give the same with a line to show; `timed`: a bar shows the time left."""
        if self.quiet:
            yield lambda done, total, line: None
        elif sys.stderr.isatty():
            with _bar(timed) as move:
                yield move
        else:
            yield _Lines()


@contextmanager
def library_log(*, quiet: bool) -> Iterator[None]:
    """Send the library's log to stderr, with `quiet` its errors alone."""
    logger = logging.getLogger(__name__.partition(".")[0])
    before = logger.level
    logger.setLevel(logging.ERROR if quiet else before)
    try:
        yield
    finally:
        logger.setLevel(before)


@contextmanager
def _bar(timed: bool) -> Iterator[Callable[[int, int, str], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns: tuple[Any, ...] = (BarColumn(), TextColumn("{task.description}"), *([TimeRemainingColumn()] * timed))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total, line: bar.update(task, completed=done, total=total, description=line)


class _Lines:
    """Progress without a terminal: the first step, then one line per ten seconds, and the end."""

    def __init__(self) -> None:
        self._next = 0.0

    def __call__(self, done: int, total: int, line: str) -> None:
        if done < total and monotonic() < self._next:
            return
        self._next = monotonic() + _SECONDS_BETWEEN_LINES
        print(line, file=sys.stderr, flush=True)


def results() -> Console:
    """Return the console for results: as wide as the terminal, or wide enough for a table in a file."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else _PLAIN_WIDTH, highlight=False, markup=False, emoji=False)


def show_table(frame: pd.DataFrame, title: str, *, prose: bool = False) -> None:
    """Print a frame, its index first, under a title that explains the rows; `prose` wraps words, not numbers.

    Columns that a terminal has no room for follow below, beside the same index.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    console = results()
    for number, columns in enumerate([list(range(frame.shape[1]))] if prose else _blocks(frame, console.width)):
        head = None if number else Text(title)
        table = Table(title=head, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False)
        table.add_column(Text("\n".join(_index_name(frame))), no_wrap=not prose)
        for column in columns:
            name = Text(str(frame.columns[column]))
            table.add_column(name, justify="left" if prose else "right", no_wrap=not prose)
        for label, row in zip(frame.index, frame.itertuples(index=False), strict=True):
            table.add_row(Text(label_text(label)), *(Text(str(row[column])) for column in columns))
        console.print(table)


def _index_name(frame: pd.DataFrame) -> list[str]:
    return wrap(str(frame.index.name or ""), _INDEX_WIDTH)


def _blocks(frame: pd.DataFrame, width: int) -> list[list[int]]:
    """Numbers of the columns that fit side by side, block by block, each with at least one."""
    from rich.cells import cell_len

    def wide(texts: Iterable[str]) -> int:
        return max(map(cell_len, texts), default=0) + _BETWEEN_COLUMNS

    first = wide([*_index_name(frame), *map(label_text, frame.index)])
    blocks: list[list[int]] = []
    left = 0
    for column, name in enumerate(frame.columns):
        needed = wide([*str(name).split("\n"), *map(str, frame.iloc[:, column])])
        if not blocks or needed > left:
            blocks.append([])
            left = width - first
        blocks[-1].append(column)
        left -= needed
    return blocks or [[]]


def replaced(folder: Path, verb: str, write: Callable[[Path], Iterable[Path]], speech: Speech) -> list[Path]:
    """Write files in place of those of an earlier run of the verb; return them and their list.

    `write` writes into a folder and returns the paths. That is one of its own until all are there: what fails or is
    interrupted leaves the results of the earlier run as they are.
    """
    from inscrutable.datasets import output_folder, replace_files
    from inscrutable.datasets.written import LIST

    with TemporaryDirectory(dir=output_folder(folder), prefix=".unfinished-") as apart:
        files = [path.replace(folder / path.name) for path in list(write(Path(apart)))]
    removed = replace_files(folder, verb, files)
    if removed:
        speech.log(f"Removed from an earlier run: {', '.join(path.name for path in removed)}")
    return [*files, folder / LIST]


def write_report(result: Any, folder: Path, **more: Any) -> list[Path]:
    """Write the page of a result, if the extra that it needs is installed."""
    from inscrutable.reports.page import can_write_pages, write_page

    return [write_page(result, folder / "report.html", **more)] if can_write_pages() else []
