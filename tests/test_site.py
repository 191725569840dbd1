"""The documents are built as `make docs` does, without a warning and with no dead link inside; test_documents.py runs them."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import get_args
from urllib.parse import unquote, urlsplit

import pytest

import inscrutable
from inscrutable.experiments.studies import layout

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ("docs", "examples", "benchmarks", "audit")
SPHINX = "import gc, sys; from sphinx.cmd.build import main; gc.disable(); sys.exit(main(sys.argv[1:]))"
"""As `python -m sphinx`; two fifths of its time go into looking for garbage among what it keeps."""
MARKETS = 4  # of the claims table; `make docs` judges over a hundred


class Page(HTMLParser):
    """Links and anchors of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.pictures: list[str] = []
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.anchors |= {value for name in ("id", "name") if (value := found.get(name))}
        self.links += [value for name in ("href", "src") if (value := found.get(name))]
        self.pictures += [value for value in [found.get("src")] if tag == "img" and value]


def dead_links(site: Path, pages: dict[Path, Page]) -> Iterator[str]:
    """Links that lead to no file or to no anchor of a page."""
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchor = unquote(parts.fragment)
            if not target.exists() or (anchor and target in pages and anchor not in pages[target].anchors):
                yield f"{path.relative_to(site)}: {link}"


def build(folder: Path, *settings_of_sphinx: str) -> tuple[Path, dict[Path, Page]]:
    """The built pages, from a copy of the sources."""
    for name in SOURCES:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("made", "__pycache__"))
    site = folder / "site"
    recipe = re.search(r"-m sphinx (.*) docs build/docs$", (ROOT / "Makefile").read_text("utf-8"), re.M)
    assert recipe
    options = [*recipe[1].split(), *settings_of_sphinx]
    assert {"-W", "-n"} <= set(options), "a warning is an error, and every reference must lead somewhere"
    command = [sys.executable, "-c", SPHINX, *options, "docs", str(site)]
    settings = os.environ | {"MPLBACKEND": "Agg"}
    run = subprocess.run(command, cwd=folder, env=settings, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-5000:]
    return site.resolve(), {path.resolve(): Page(path) for path in site.rglob("*.html")}


def assert_all_is_described(site: Path, shown: dict[str, Page]) -> None:
    """Every public name has its entry, and every key of a study file its line."""
    anchors = {anchor for name, page in shown.items() if name.startswith("made/api/") for anchor in page.anchors}
    missing = {f"inscrutable.{name}" for name in inscrutable.__all__} - anchors
    assert not missing, "every public name has its entry"
    told = re.sub(r"<[^>]+>", "", site.joinpath("studies.html").read_text("utf-8"))
    schema = layout.StudyFile.model_json_schema()
    keys = {key for each in (schema, *schema["$defs"].values()) for key in each.get("properties", ())}
    assert not [each for each in (*keys, *get_args(layout.Measure)) if each not in told], "every key has its line"


@pytest.mark.audit
def test_documents_are_built_without_a_warning_and_without_a_dead_link(tmp_path: Path) -> None:
    site, pages = build(tmp_path, "-D", f"claims_markets={MARKETS}")
    assert list(dead_links(site, pages)) == []
    shown = {path.relative_to(site).as_posix(): page for path, page in pages.items()}
    assert_all_is_described(site, shown)
    drawn = [*sorted((ROOT / "docs" / "concepts").glob("*.py")), *sorted((ROOT / "examples").glob("*.py"))]
    for script in drawn:
        kind = "concepts" if script.parent.name == "concepts" else "examples"
        assert any("_images/sphx_glr" in each for each in shown[f"made/{kind}/{script.stem}.html"].pictures), (
            script.name
        )
    assert f"Over {MARKETS} random markets" in (site / "reproducing.html").read_text("utf-8")
    for name, least in (("start-here.html", 2), ("reproducing.html", 11), ("benchmarks.html", 5)):
        assert len([each for each in shown[name].pictures if "_images/" in each]) >= least, name


def test_a_dead_link_is_seen(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text('<p id="x"></p><a href="#x"></a><a href="#y"></a><a href="b.html"></a>', "utf-8")
    pages = {path.resolve(): Page(path) for path in tmp_path.glob("*.html")}
    assert list(dead_links(tmp_path.resolve(), pages)) == ["a.html: #y", "a.html: b.html"]
