"""The one form of every result: a row of a table, what makes it wrong, and how tables are written."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from rich.console import Console
from rich.table import Table

HEADS = ("what", "size", "inscrutable", "peer", "peer takes", "ratio", "quality", "target", "met")
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
"""What stands between these marks in docs/benchmarks.md is written with the table."""

_UNITS = ((1.0, "s", 1.0), (1e-3, "ms", 1e3), (1e-6, "µs", 1e6), (0.0, "ns", 1e9))


@dataclass(frozen=True)
class Quality:
    """What an answer is worth, in words, and whether it is right: a wrong one fails the run."""

    text: str = ""
    right: bool = True


@dataclass(frozen=True)
class Target:
    """What the row must reach, in words, and whether it does; None where nothing is asked."""

    text: str = ""
    met: bool | None = None


@dataclass(frozen=True)
class Row:
    """One measurement.

    `ours`, `peer_takes` and `ratio` are ready to print; `numbers` holds what plots and other programs read.
    """

    what: str
    size: str
    ours: str
    peer: str = ""
    peer_takes: str = ""
    ratio: str = ""
    quality: Quality = field(default_factory=Quality)
    target: Target = field(default_factory=Target)
    numbers: dict[str, float] = field(default_factory=dict)

    def cells(self) -> tuple[str, ...]:
        """The row as it is printed."""
        judged = {True: "yes", False: "no", None: ""}[self.target.met]
        quality = self.quality.text if self.quality.right else f"WRONG: {self.quality.text}"
        return (
            self.what,
            self.size,
            self.ours,
            self.peer,
            self.peer_takes,
            self.ratio,
            quality,
            self.target.text,
            judged,
        )


@dataclass(frozen=True)
class Group:
    """The rows of one run of one benchmark, with the machine they were measured on."""

    name: str
    title: str
    measured: str
    rows: tuple[Row, ...]

    def save(self, folder: Path) -> None:
        """Keep the group as JSON, for the table and for other programs."""
        folder.mkdir(parents=True, exist_ok=True)
        text = json.dumps(asdict(self), indent=1, ensure_ascii=False)
        (folder / f"{self.name}.json").write_text(text + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: Path) -> Group:
        """Read a kept group."""
        kept = json.loads(path.read_text("utf-8"))
        rows = [
            Row(**{**row, "quality": Quality(**row["quality"]), "target": Target(**row["target"])})
            for row in kept.pop("rows")
        ]
        return cls(**kept, rows=tuple(rows))


def seconds_text(seconds: float, how: str = "") -> str:
    """A duration with three digits in its own unit, and how it was taken."""
    unit, factor = next((name, times) for least, name, times in _UNITS if seconds >= least)
    value = seconds * factor
    digits = 2 if value < 10 else 1 if value < 100 else 0
    return f"{value:,.{digits}f} {unit}" + (f" ({how})" if how else "")


def times_text(ratio: float) -> str:
    """A ratio with two or three digits: 0.047×, 3.2×, 41×, 1,200×."""
    return f"{ratio:.2g}×" if ratio < 10 else f"{ratio:,.0f}×"


def bytes_text(size: float) -> str:
    """Megabytes of 2^20 bytes."""
    return f"{size / 2**20:.1f} MB"


def at_least(ratio: float, least: float, star: float | None = None) -> Target:
    """The target of a speed-up; a star marks the harder one, told beside it."""
    return _with_star(f"≥ {least:,g}×", ratio >= least, star, f"≥ {star:,g}×" if star else "", ratio >= (star or 0))


def at_most(value: float, most: float, unit: str = "×", star: float | None = None) -> Target:
    """The target of a cost; a star marks the harder one, told beside it."""
    hard = f"≤ {star:g}{unit}" if star else ""
    return _with_star(f"≤ {most:g}{unit}", value <= most, star, hard, value <= (star or 0))


def _with_star(text: str, met: bool, star: float | None, hard: str, hard_met: bool) -> Target:
    if star is None:
        return Target(text, met)
    return Target(f"{text}; ★ {hard}: {'yes' if hard_met else 'no'}", met)


def wrong_rows(groups: Iterable[Group]) -> list[Row]:
    """The rows whose answer is wrong."""
    return [row for group in groups for row in group.rows if not row.quality.right]


def missed_rows(groups: Iterable[Group]) -> list[Row]:
    """The rows that stay behind their target."""
    return [row for group in groups for row in group.rows if row.target.met is False]


def markdown(groups: Sequence[Group], pictures: Sequence[str] = ()) -> str:
    """The whole table in Markdown, a title and the machine above each group's rows."""
    lines = [
        "# Benchmarks",
        "",
        "Written by `make bench` (the last group by `make audit`). Times depend on the machine, ratios hardly. "
        "A ratio is the peer's time over ours; of many decisions and of the start it is our time over the peer's, of growth "
        "the time per step over that of the first row. A wrong answer fails the run.",
    ]
    for group in groups:
        lines += ["", f"## {group.title}", "", group.measured, "", _line(HEADS), _line(["---"] * len(HEADS))]
        lines += [_line(cell.replace("|", "\\|") for cell in row.cells()) for row in group.rows]
    for picture in pictures:
        lines += ["", f"![{Path(picture).stem}]({picture})"]
    return "\n".join(lines) + "\n"


SHORT_HEADS = ("what", "size", "takes", "against", "ratio", "asked", "reached")


def summary(groups: Iterable[Group]) -> str:
    """The rows of which something is asked, without quality: what a front page shows; empty if there are none."""
    asked = [row for group in groups for row in group.rows if row.target.met is not None]
    if not asked:
        return ""
    lines = [_line(SHORT_HEADS), _line(["---"] * len(SHORT_HEADS))]
    for row in asked:
        against = ", ".join(text for text in (row.peer, row.peer_takes) if text)
        judged = "yes" if row.target.met else "no"
        lines.append(_line([row.what, row.size, row.ours, against, row.ratio, row.target.text, judged]))
    return "\n".join(lines) + "\n"


def between(page: str, block: str) -> str:
    """A page with the block between its two marks replaced."""
    before, rest = page.split(BEGIN, 1)
    return before + BEGIN + "\n\n" + (block + "\n" if block else "") + END + rest.split(END, 1)[1]


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def show(group: Group, console: Console) -> None:
    """Print a group's rows; columns that are empty throughout are left out."""
    grid = Table(title=f"{group.title}\n{group.measured}", title_justify="left", show_lines=False)
    rows = [row.cells() for row in group.rows]
    kept = [i for i in range(len(HEADS)) if any(cells[i] for cells in rows)]
    for i in kept:
        grid.add_column(HEADS[i])
    for cells in rows:
        grid.add_row(*(cells[i] for i in kept))
    console.print(grid)
