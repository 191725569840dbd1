"""A backtest's page on the aware observer over time, with the sequential rule and its ceiling."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import browser
from inscrutable.experiments import backtest_sequential
from inscrutable.experiments.backtest import Backtest
from inscrutable.reports.page import write_page
from sizes import audited
from small_runs import short_simulations
from test_page import Reader, backtest, data_of, needs_browser, tab  # noqa: F401  # the last is a fixture

GRID = 8


@pytest.fixture(scope="module")
def found() -> Backtest:
    with pytest.MonkeyPatch.context() as patch, short_simulations(*((20, 100) if audited() else (8, 50))):
        patch.setattr(backtest_sequential, "_MOST_BELIEFS", GRID)
        return backtest(2, None, beliefs=20, sequential=True)


@pytest.fixture(scope="module")
def without(found: Backtest) -> Backtest:
    """The same without an aware observer, as where the target is another one at every step."""
    return replace(found, aware=None, sequential=None)


@pytest.fixture(scope="module")
def page(found: Backtest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_page(found, tmp_path_factory.mktemp("page") / "report.html")


def test_what_one_holds_stands_beside_the_investors_belief(found: Backtest, page: Path) -> None:
    followed = data_of(page)["followed"]
    assert list(followed["beliefs"]) == ["SDM", "PDM", "CDM"]
    for name, rows in followed["beliefs"].items():
        assert np.array(rows) == pytest.approx(found.followed_estimates(name).to_numpy(), abs=1e-4)


def test_bits_and_errors_are_those_so_far(found: Backtest, page: Path) -> None:
    followed, aware = data_of(page)["followed"], found.aware
    assert aware is not None
    assert list(followed["bits"]) == list(followed["errors"]) == list(found.names)
    own = found.beliefs.to_numpy()
    for name in found.names:
        bits, squares = 0.0, []
        for t, row in enumerate(found.followed_estimates(name).to_numpy()):
            bits += aware.bits[name][t]
            squares.append(((row - own[t]) ** 2).sum())
            assert followed["bits"][name][t] == pytest.approx(bits, abs=1e-3)
            assert followed["errors"][name][t] == pytest.approx(np.sqrt(np.mean(squares)), abs=1e-4)
        assert followed["errors"][name][-1] == pytest.approx(found.figures[name]["error_followed"], abs=1e-4)


def test_ceilings_and_what_is_asked_are_those_of_table_and_verdict(found: Backtest, page: Path) -> None:
    followed = data_of(page)["followed"]
    assert set(followed["ceilings"]) == {"CDM", "PDM", "SDM"}
    for name, most in followed["ceilings"].items():
        assert most == pytest.approx(found.figures[name]["error_ceiling"], abs=1e-4)
    assert followed["without"] == pytest.approx(found.figures["SDM"]["error_without"], abs=1e-4)
    assert followed["asked"] == pytest.approx(2.0 / 3.0 * followed["without"], abs=1e-4)


@pytest.mark.usefixtures("undrawn")
def test_nothing_is_shown_of_what_is_not_known(found: Backtest, without: Backtest, page: Path, tmp_path: Path) -> None:
    assert found.aware is not None
    uncapped = replace(found, aware=replace(found.aware, ceilings={}), sequential=None)
    pages = [page, write_page(uncapped, tmp_path / "uncapped.html"), write_page(without, tmp_path / "without.html")]
    assert data_of(pages[1])["followed"]["ceilings"] == {}
    assert data_of(pages[2])["followed"] is None
    captions = [" ".join(Reader(each).inside["figcaption"]) for each in pages]
    assert ["are the ceilings: the most" in text for text in captions] == [True, False, False]
    assert ["remembers all" in text for text in captions] == [True, True, False]


@needs_browser
@pytest.mark.parametrize("width", [1200, 400])
def test_figures_are_read_on_a_phone_too(
    width: int,
    found: Backtest,
    page: Path,
    tab: browser.Browser,  # noqa: F811
) -> None:
    tab.size(width, 800)
    tab.complaints.clear()
    tab.open(page, "#step=999")
    figures, shown = found.figures, "[...document.querySelectorAll('#errors-legend span')]"
    legend = tab.run(f"{shown}.map(each => each.textContent)")
    told = f"sequential (SDM) {figures['SDM']['error_followed']:.3g}, ceiling {figures['SDM']['error_ceiling']:.3g}"
    assert told in legend
    assert (
        tab.run(f"new Set({shown}.map(each => each.firstChild.innerHTML)).size") == len(legend) == len(found.names) + 2
    )
    for name in ("followed", "bits", "errors"):
        drawing = f"document.querySelector('#{name} svg')"
        place = f"{drawing}.getBoundingClientRect()"
        texts = f"[...{drawing}.querySelectorAll('text')].map(each => each.getBoundingClientRect())"
        assert tab.run(f"{texts}.every(each => each.left >= {place}.left - 1 && each.right <= {place}.right + 1)"), name
        assert tab.run(f"Math.min(...{texts}.map(each => each.height))") > 10
        assert "SDM" in tab.run(f"{drawing}.getAttribute('aria-label')")
    assert tab.complaints == []


@needs_browser
def test_a_page_without_that_one_is_drawn(without: Backtest, tab: browser.Browser, tmp_path: Path) -> None:  # noqa: F811
    tab.complaints.clear()
    tab.open(write_page(without, tmp_path / "report.html"))
    assert tab.run("document.documentElement.dataset.drawn")
    assert tab.complaints == []
