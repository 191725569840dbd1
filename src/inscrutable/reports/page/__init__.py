"""One self-contained interactive HTML file per result, which works offline; needs the extra `inscrutable[report]`."""

from inscrutable.reports.page.content import PageContent, PageFigure, PagePicture, PageSlider, PageTable
from inscrutable.reports.page.writing import can_write_pages, write_content, write_page

__all__ = [
    "PageContent",
    "PageFigure",
    "PagePicture",
    "PageSlider",
    "PageTable",
    "can_write_pages",
    "write_content",
    "write_page",
]
