"""What a page is made of, as plain data: sentences, sliders, figures that a script draws, tables, and the script's data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class PageTable:
    """A table of text; the first column holds the rows' headers.

    Args:
        heading: What it shows; shown as its caption.
        columns: Headers, one per column.
        rows: Cells, one per column.
        choice: A slider's name and the position at which the table is shown; None is always. Print shows all.
        is_prose: Whether cells are read one by one, not down a column: a phone then shows each row as a block.
    """

    heading: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    choice: tuple[str, int] | None = None
    is_prose: bool = False


@dataclass(frozen=True)
class PageSlider:
    """A slider: one position per text; with a single one it is left out.

    Args:
        name: Its name in the address, as in `#budget=3`, and in the script; letters only.
        label: What it moves.
        texts: What each position means.
        start: The position at first.
    """

    name: str
    label: str
    texts: Sequence[str]
    start: int = 0

    @property
    def is_movable(self) -> bool:
        """Whether there is more than one position."""
        return len(self.texts) > 1


@dataclass(frozen=True)
class PageFigure:
    """A place where the script draws.

    Args:
        name: The figure's name in the script; letters only.
        heading: Its title.
        caption: What it shows, for those who see it and those who do not.
        is_wide: Whether it takes the whole width of a wide screen.
    """

    name: str
    heading: str
    caption: str
    is_wide: bool = False


@dataclass(frozen=True)
class PagePicture:
    """A picture that was drawn beforehand.

    Args:
        heading: Its title.
        caption: What it shows, for those who see it and those who do not.
        svg: The picture as the text of an SVG file.
    """

    heading: str
    caption: str
    svg: str


@dataclass(frozen=True)
class PageContent:
    """All that a page holds.

    Args:
        title: The heading.
        header: One line below it.
        verdict: Sentences: what was found, a few short ones, the answer first; two stand before the leading picture.
        lead: The picture that shows the verdict; None for a page without.
        limits: Sentences: what the verdict's words mean, and what it rests on.
        cautions: Sentences: what the verdict leaves out.
        tables: The main tables.
        sliders: What a reader can move.
        figures: What the script draws, in order.
        pictures: What was drawn beforehand, in order.
        details: Tables that are folded at first.
        failures: What went wrong or was left out, one sentence each.
        notes: Definitions.
        manifest: Versions, seed, settings, data: what it takes to make the page again.
        script: Name of the asset that draws the figures; None for a page without.
        data: What the script reads: numbers, text, lists, mappings; NaN and infinities become null.
    """

    title: str
    header: str
    verdict: Sequence[str]
    lead: PagePicture | None = None
    limits: Sequence[str] = ()
    cautions: Sequence[str] = ()
    tables: Sequence[PageTable] = ()
    sliders: Sequence[PageSlider] = ()
    figures: Sequence[PageFigure] = ()
    pictures: Sequence[PagePicture] = ()
    details: Sequence[PageTable] = ()
    failures: Sequence[str] = ()
    notes: Sequence[str] = ()
    manifest: Mapping[str, str] = field(default_factory=dict)
    script: str | None = None
    data: Mapping[str, Any] = field(default_factory=dict)
