"""The command `python -m benchmarks [GROUP ...] [--quick] [--out FOLDER]`.

Tables go to stdout, progress to stderr. Exit codes: 0 done, 1 an answer is wrong, 2 wrong usage, 130 interrupted.
A target that is missed is said in the table and does not fail the run: times depend on the machine.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from rich.console import Console

from benchmarks import ROOT
from benchmarks.machine import described
from benchmarks.table import Group, Row, Target, between, markdown, missed_rows, seconds_text, show, summary, wrong_rows
from inscrutable.kernels.calls import compiled_at_once

GROUPS = ("forward", "decision", "proof", "many", "growth", "start", "large")
SLOW = ("large",)
RESULTS = ROOT / "benchmarks" / "results"
PAGE = ROOT / "docs" / "benchmarks.md"
WRONG, INTERRUPTED = 1, 130
PRINTED_WIDTH = 240  # characters of a table that goes to a file
_QUICK = "Tiny sizes: only that everything runs; no target applies."


def measure(name: str, *, quick: bool = False) -> Group:
    """Run one benchmark, telling each row on stderr as it comes."""
    module = import_module(f"benchmarks.{name}")
    started = time.perf_counter()
    _tell(f"{name}: {module.TITLE}")
    rows: list[Row] = []
    with compiled_at_once():
        for row in module.rows(module.QUICK if quick else module.FULL):
            rows.append(replace(row, target=Target()) if quick else row)
            spent = seconds_text(time.perf_counter() - started)
            _tell(f"{name} {spent}: {' | '.join(cell for cell in rows[-1].cells() if cell)}")
    return Group(name, module.TITLE, _QUICK if quick else described(), tuple(rows))


def write(folder: Path, fresh: Sequence[Group]) -> None:
    """Keep fresh groups, and write table and pictures of all groups that are kept; the documents quote the kept results."""
    folder.mkdir(parents=True, exist_ok=True)
    for group in fresh:
        group.save(folder)
    groups = kept(folder)
    pictures: list[str] = []
    for group in groups:
        if group.name == "growth":
            from benchmarks.plots import draw_growth

            pictures = draw_growth(group.rows, folder)
    (folder / "table.md").write_text(markdown(groups, pictures), encoding="utf-8")
    if folder == RESULTS:
        PAGE.write_text(between(PAGE.read_text("utf-8"), summary(groups)), encoding="utf-8")


def kept(folder: Path) -> list[Group]:
    """The groups that a folder holds, in their order."""
    return [Group.load(folder / f"{name}.json") for name in GROUPS if (folder / f"{name}.json").exists()]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is asked for, print and keep each group as it ends."""
    parser = _parser()
    asked = parser.parse_args(arguments)
    unknown = [name for name in asked.groups if name not in GROUPS]
    if unknown:
        parser.error(f"no such group: {', '.join(unknown)}; choose from {', '.join(GROUPS)}")
    names = [name for name in GROUPS if (name in asked.groups if asked.groups else name not in SLOW)]
    folder = asked.out or (None if asked.quick else RESULTS)
    console = Console(width=None if sys.stdout.isatty() else PRINTED_WIDTH)
    done: list[Group] = []
    try:
        for name in names:
            done.append(measure(name, quick=asked.quick))
            show(done[-1], console)
            if folder is not None:
                write(folder, done[-1:])
                _tell(f"written: {name} to {folder.name}/table.md")
    except KeyboardInterrupt:
        _tell("interrupted: the groups that were finished are kept")
        return INTERRUPTED
    return _judged(done)


def _judged(groups: Sequence[Group]) -> int:
    """Say which targets are missed and which answers are wrong; the exit code."""
    for row in missed_rows(groups):
        _tell(f"target missed: {row.what}, {row.size}: {row.ratio or row.ours} ({row.target.text})")
    wrong = wrong_rows(groups)
    for row in wrong:
        _tell(f"WRONG: {row.what}, {row.size}: {row.quality.text}")
    return WRONG if wrong else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure the library against its peers.")
    parser.add_argument("groups", nargs="*", metavar="GROUP", help=f"{', '.join(GROUPS)}; default: all but the last")
    parser.add_argument("--quick", action="store_true", help="tiny sizes, nothing written unless --out is given")
    parser.add_argument(
        "--out", type=Path, help="folder of the results; default benchmarks/results, which the documents quote"
    )
    return parser


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
