"""The content of a page as plain data: sentences, sliders, scripted figures, tables, and the script's data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class PageTable:
    """A table of text; the first column holds the rows' headers.

    Args:
        heading: Its caption.
        columns: Headers, one per column.
        rows: Cells, one per column.
        choice: A slider's name and the position at which the table is visible; None: always. Print shows all.
        is_prose: Whether cells are prose; a phone then shows each row as a block.
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
        label: Its label on the page.
        texts: What each position means.
        start: The initial position.
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
    """A figure that the script draws.

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
    """A static picture.

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
    """The content of a page.

    Args:
        title: The heading.
        header: One line below it.
        verdict: A few short sentences on the findings, the answer first; two come before the leading picture.
        lead: The picture that shows the verdict; None for a page without.
        limits: Sentences: the meaning of the verdict's words, and its basis.
        cautions: Sentences: cautions on the verdict.
        tables: The main tables.
        sliders: The sliders.
        figures: The scripted figures, in order.
        pictures: The static pictures, in order.
        details: Tables that are collapsed initially.
        failures: Errors and omissions, one sentence each.
        notes: Definitions.
        manifest: Versions, seed, settings and data needed to reproduce the page.
        script: Name of the asset that draws the figures; None for a page without.
        data: The script's data: numbers, text, lists, mappings; NaN and infinities become null.
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
