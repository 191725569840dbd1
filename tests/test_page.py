"""The page of a result: one file, nothing from outside, nothing unescaped, and the numbers of the result at every position."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import linprog

import browser
from inscrutable import (
    BayesianAdversary,
    Budget,
    InputError,
    MarkowitzProblem,
    NonExistence,
    OriginalDecisionMaker,
    cli,
    cli_console,
    consistent_beliefs,
    mechanism,
    uniform_prior,
)
from inscrutable.experiments.backtest import Backtest, BacktestSettings, run_backtest
from inscrutable.experiments.comparison import COMPARED, Comparison, ComparisonSettings, compare, makers_of
from inscrutable.reports import page as page_folder
from inscrutable.reports import style
from inscrutable.reports.page import (
    PageContent,
    PageFigure,
    PageSlider,
    PageTable,
    backtest_page,
    can_write_pages,
    write_content,
    write_page,
)
from inscrutable.reports.page.budget_sweep import BudgetSweep
from inscrutable.reports.page.writing import embedded
from sizes import audited, some
from small_runs import coarse_rivals, learned_from_few

EVIL = "<script>alert(1)</script>"
MEGABYTE = 1_000_000
VOID = {"meta", "link", "input", "br", "img"}


def backtest(regimes: int, budget: Budget | float = 0.05, *, beliefs: int = 60, **settings: Any) -> Backtest:
    rng = np.random.default_rng(0)
    rows = 120
    regime = (np.arange(rows) // 8) % 3
    mean = 0.01 + 0.012 * np.stack([[-1, 0, 0.4, 1], [1, 0, -0.4, -1], [-0.9, 1, 0.3, -0.9]])[regime]
    returns = mean + np.array([0.02, 0.04, 0.08])[regime][:, None] * rng.normal(size=(rows, 4))
    frame = pd.DataFrame(
        returns, index=pd.date_range("2001-01", periods=rows, freq="ME"), columns=[EVIL, "B", "C", "D"]
    )
    asked = {"sequential": False, **settings}
    chosen = BacktestSettings(regimes=regimes, train_until="2008-12", budget=budget, **asked)  # type: ignore[arg-type]
    with coarse_rivals(beliefs):
        return run_backtest(frame, chosen, restarts=2)


@pytest.fixture(scope="module")
def found() -> Backtest:
    return backtest(3, beliefs=60 if audited() else 30)


@pytest.fixture(scope="module")
def missed() -> Backtest:
    """A goal that is met or missed, at no budget."""
    return backtest(3, 0.0, beliefs=20, measure=NonExistence())


@pytest.fixture(scope="module")
def by_regret() -> Backtest:
    """Two regimes and a budget of regret."""
    return backtest(2, Budget.regret(0.002), beliefs=20)


@pytest.fixture(scope="module")
def compared() -> Comparison:
    problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
    settings = ComparisonSettings(budgets=(0.25, 0.5), repeats=(1, 5), draws=20)
    with learned_from_few():
        makers = makers_of(some(list(COMPARED), 2))
        return compare(problem, uniform_prior(2, 6), settings, makers=makers, rng=np.random.default_rng(0))


@pytest.fixture(scope="module")
def page(found: Backtest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_page(found, tmp_path_factory.mktemp("page") / "report.html")


@pytest.fixture(scope="module")
def compared_page(compared: Comparison, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "report.html"
    return write_page(compared, path, title=f"Ways {EVIL}", manifest={"market": EVIL, "seed": 0})


class Reader(HTMLParser):
    """Reads a page and fails where an element is not closed, or closed by another."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.inside: dict[str, list[str]] = {}
        self.feed(path.read_text("utf-8"))
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert len({name for name, _ in attrs}) == len(attrs), tag
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
            self.inside.setdefault(tag, []).append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        for tag in set(self.open):
            self.inside[tag][-1] += data

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def data_of(path: Path) -> Any:
    scripts = Reader(path).inside["script"]
    return json.loads(scripts[0])


both = pytest.mark.parametrize("which", ["page", "compared_page"])


@both
def test_html_is_well_formed_and_made_for_all_readers(which: str, request: pytest.FixtureRequest) -> None:
    path = request.getfixturevalue(which)
    assert path.read_text("utf-8").startswith("<!DOCTYPE html>\n")
    read = Reader(path)
    assert read.all("html")[0]["lang"] == "en"
    assert any(each.get("name") == "viewport" for each in read.all("meta"))
    ids = [attributes["id"] for _, attributes in read.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    sliders = read.all("input")
    assert len(sliders) == 2
    for slider in sliders:
        assert slider["type"] == "range"
        assert slider["aria-valuetext"]
        assert slider["id"] in {label["for"] for label in read.all("label")}
    for drawing in read.all("svg"):
        assert drawing["role"] == "img"
        assert drawing["aria-label"]
    assert {each["scope"] for each in read.all("th")} == {"col", "row"}
    assert "@media print" in read.inside["style"][0]
    headings = " ".join(read.inside["h2"])
    assert all(word in headings for word in ("Verdict", "Table", "What the words mean", "Manifest"))


@both
def test_nothing_is_loaded_from_anywhere(which: str, request: pytest.FixtureRequest) -> None:
    path = request.getfixturevalue(which)
    text, read = path.read_text("utf-8"), Reader(path)
    assert not re.search(r"https?:|//[\w.]+\.\w|@import|url\(|\bfetch\b|XMLHttpRequest|\bimport\(", text)
    for _, attributes in read.elements:
        assert (attributes.get("src") or "data:").startswith("data:")
        assert attributes.get("href", "data:,") == "data:,"
        assert not [name for name in attributes if name.startswith("on") or name == "style"]


@both
def test_policy_admits_only_the_pages_own_script_and_style(which: str, request: pytest.FixtureRequest) -> None:
    read = Reader(request.getfixturevalue(which))
    policy = next(each["content"] for each in read.all("meta") if each.get("http-equiv"))
    assert policy is not None
    for kind, text in (("style", read.inside["style"][0]), ("script", read.inside["script"][-1])):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy


@both
def test_labels_are_escaped(which: str, request: pytest.FixtureRequest) -> None:
    path = request.getfixturevalue(which)
    text = path.read_text("utf-8")
    assert EVIL not in text
    assert "&lt;script&gt;alert(1)" in text
    assert len(Reader(path).all("script")) == 3
    for script in Reader(path).inside["script"][:2]:
        assert not set("<>&") & set(script)


def test_embedded_data_have_no_sign_of_html_and_no_odd_number() -> None:
    text = embedded(
        {"</script>": ["<!--", "&amp;", np.float64("nan"), np.inf], "a": np.array([1.0, 0.25]), "b": np.int64(3)}
    )
    assert not set("<>&") & set(text)
    assert json.loads(text) == {"</script>": ["<!--", "&amp;", None, None], "a": [1, 0.25], "b": 3}


def test_page_is_small_and_stays_so(page: Path) -> None:
    data = data_of(page)
    per_step = len(json.dumps(data["played"])) + len(json.dumps(data["frontiers"])) + len(json.dumps(data["sets"]))
    assert page.stat().st_size + 330 / len(data["dates"]) * per_step < 6 * MEGABYTE


def test_no_published_single_decision_lies_above_its_curve(page: Path) -> None:
    data = data_of(page)
    published = data["played"]["CDM"][data["own"]]
    for curves, (atoms, *_) in zip(data["frontiers"], published, strict=True):
        _, _, regret, privacy = atoms[0]
        steps = np.array(curves["single"])
        assert (np.diff(steps[:, 0]) >= 0.0).all()
        assert (np.diff(steps[:, 1]) >= 0.0).all()
        assert privacy is None or privacy <= steps[steps[:, 0] <= regret, 1].max() + 1e-9


def test_no_published_lottery_lies_above_its_curve(page: Path) -> None:
    data = data_of(page)
    for curves, (atoms, *_) in zip(data["frontiers"], data["played"]["PDM"][data["own"]], strict=True):
        _, share, regret, privacy = np.array(atoms, dtype=float).T
        corners = np.array(curves["mixed"])
        most = np.interp(share @ regret, *corners.T)
        assert share @ privacy <= most + 2e-4  # figures are rounded


def test_same_result_gives_the_same_bytes(found: Backtest, page: Path, tmp_path: Path) -> None:
    assert write_page(found, tmp_path / "again.html").read_bytes() == page.read_bytes()


def test_verdict_table_failures_and_manifest_are_the_results(found: Backtest, page: Path) -> None:
    from inscrutable.reports.backtest_verdict import verdict

    read = Reader(page)
    assert set(verdict(found)) <= {each.strip() for each in read.inside["p"]}
    cells = " ".join(read.inside["td"])
    assert f"{found.figures['CDM']['error_face_value']:.3f}" in cells
    manifest = dict(zip(read.inside["dt"], read.inside["dd"], strict=True))
    assert manifest["seed"] == "0"
    assert re.fullmatch(r"[0-9a-f]{64}", manifest["data, SHA-256 as CSV"])
    assert manifest["version of numpy"] == np.__version__


@pytest.mark.parametrize("step", [0, 5, 20])
@pytest.mark.parametrize("budget", [0, 2, 8])
def test_every_budget_holds_the_best_of_the_candidates(found: Backtest, page: Path, step: int, budget: int) -> None:
    """Against all candidates, one by one, and the paper's linear programme."""
    data = data_of(page)
    belief, candidates = found.beliefs.to_numpy()[step], found.candidates
    optimal = float(found.problem.optimal_cost(belief))
    regrets = np.append(np.maximum(candidates.state_costs @ belief - optimal, 0.0), 0.0)
    own = consistent_beliefs(found.problem, found.problem.solve(belief)).distance(belief)
    distances = np.append(candidates.sets.distances(belief), own)
    usable = np.append(candidates.usable, True) & np.isfinite(distances)
    regrets, distances = regrets[usable], distances[usable]
    limit = data["amounts"][budget] * abs(optimal)

    (atom,) = data["played"]["CDM"][budget][step][0]
    affordable = regrets <= limit * (1 + 1e-5)
    assert atom[3] == pytest.approx(distances[affordable].max(), abs=2e-3)
    assert atom[2] * abs(optimal) <= limit * (1 + 1e-3) + 1e-12

    atoms = data["played"]["PDM"][budget][step][0]
    answer = linprog(
        -distances, regrets[None] / abs(optimal), [limit / abs(optimal)], np.ones((1, len(regrets))), [1.0]
    )
    assert sum(p * privacy for _, p, _, privacy in atoms) == pytest.approx(-answer.fun, abs=2e-3)
    assert sum(p for _, p, _, _ in atoms) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.usefixtures("undrawn")
def test_the_largest_weights_are_listed_and_the_others_added_up(
    found: Backtest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(backtest_page, "_MOST_ASSETS", 2)
    told = data_of(write_page(found, tmp_path / "report.html"))["weights"]
    assert (told["assets"], told["makers"]) == (list(found.assets), list(found.names))
    assert len(told["steps"]) == len(found.beliefs)
    counts = set()
    for step, (assets, others, rows) in enumerate(told["steps"]):
        weights = np.array([found.weights(name).iloc[step] for name in found.names])
        counts.add(others)
        assert others == max((weights.max(axis=0) > 1e-9).sum() - 2, 0)
        assert set(assets) >= {int(weights.max(axis=0).argmax())}
        assert [len(row) for row in rows] == [len(assets) + (others > 0)] * len(weights)
        assert np.array(rows)[:, : len(assets)] == pytest.approx(1000 * weights[:, assets], abs=0.501)
        assert np.sum(rows, axis=1) == pytest.approx(1000, abs=1.501)
    assert max(counts) > 0


def test_own_budget_shows_what_was_published(found: Backtest, page: Path) -> None:
    data = data_of(page)
    assert data["amounts"][data["own"]] == found.budget.amount
    assert found.aware is not None
    for name in found.names:
        for step in (0, 7, len(found.beliefs) - 1):
            atoms, drawn, aware = data["played"][name][0 if name == "ODM" else data["own"]][step]
            corners = np.array(data["sets"][atoms[drawn][0]])
            published = consistent_beliefs(found.problem, found.weights(name).to_numpy()[step])
            assert sorted(corners.tolist()) == pytest.approx(
                np.array(sorted(published.vertices().round(4).tolist())), abs=1e-3
            )
            assert aware == pytest.approx(found.aware.estimates[name][step], abs=1e-4)
            assert atoms[drawn][3] == pytest.approx(found.privacy(name)[step], abs=1e-4)
        assert data["sweep"][name]["naive"][data["own"]] == pytest.approx(
            found.figures[name]["error_face_value"], abs=1e-4
        )
        assert data["sweep"][name]["aware"][data["own"]] == pytest.approx(found.figures[name]["error_aware"], abs=1e-4)


def test_observer_who_knows_the_method_knows_the_budget_as_well(by_regret: Backtest) -> None:
    """Bayes' rule by enumeration: who else would play the decision that was drawn?"""
    found = by_regret
    sweep, budget = BudgetSweep(found), 4
    assert found.aware is not None
    prior, candidates = found.aware.prior, found.candidates
    optimal = found.problem.optimal_cost(prior.beliefs)
    chosen = []
    for belief, least in zip(prior.beliefs, optimal, strict=True):
        regrets = candidates.state_costs @ belief - least
        distances = np.where(
            candidates.usable & (regrets <= sweep.amounts[budget]), candidates.sets.distances(belief), -1.0
        )
        best = np.flatnonzero(distances >= distances.max() - 1e-9)
        chosen.append(candidates.actions[best[regrets[best].argmin()]])
    played = sweep.played("CDM", budget)
    compared = 0
    for each in played:
        index = each.atoms[0].candidate
        if index == len(candidates):
            continue
        same = np.abs(np.array(chosen) - candidates.actions[index]).max(axis=1) < 1e-7
        if same.any():
            weights = prior.weights[same] / prior.weights[same].sum()
            assert each.aware == pytest.approx(weights @ prior.beliefs[same], abs=1e-6)
            compared += 1
    assert compared > 3


def test_without_a_budget_all_observers_read_the_optimal_decision(found: Backtest, page: Path) -> None:
    data, aware = data_of(page), found.aware
    assert aware is not None
    assert data["amounts"][0] == 0
    optimal = mechanism(OriginalDecisionMaker(found.problem), aware.prior.beliefs)
    actions = found.episode.records["ODM"].decisions.action
    expected = BayesianAdversary(optimal, aware.prior).estimates(actions, nearest=8)
    for name in ("CDM", "PDM"):
        played = [data["played"][name][0][step] for step in range(len(found.beliefs))]
        assert [atom[2] for (atom,), _, _ in played] == pytest.approx([0.0] * len(played), abs=1e-9)
        read = [(step, estimate) for step, ((atom,), _, estimate) in enumerate(played) if atom[3] < 1e-6]
        steps, estimates = zip(*read, strict=True)
        np.testing.assert_allclose(estimates, expected[list(steps)], atol=1e-4)


def test_long_backtests_are_thinned(found: Backtest) -> None:
    sweep = BudgetSweep(found, most_steps=10)
    assert len(sweep.steps) <= 10
    assert (np.diff(sweep.steps) == sweep.steps[1]).all()
    assert sweep.beliefs == pytest.approx(found.beliefs.to_numpy()[sweep.steps])


@pytest.mark.usefixtures("undrawn")
def test_goals_and_misses_have_a_page_too(missed: Backtest, tmp_path: Path) -> None:
    data = data_of(write_page(missed, tmp_path / "report.html"))
    assert data["own"] == 0
    assert {atom[3] for at in data["played"]["CDM"] for entry in at for atom in entry[0]} <= {0, None}


def test_comparison_page_starts_at_the_budget_of_its_verdict(compared: Comparison, compared_page: Path) -> None:
    slider = next(each for each in Reader(compared_page).all("input") if each.get("id") == "budget")
    assert compared.budgets[int(slider["value"] or 0)] == compared.middle_budget


def test_comparison_page_holds_its_rows(compared: Comparison, compared_page: Path) -> None:
    data = data_of(compared_page)
    for maker in compared.makers:
        for shown, row in zip(data["rows"][maker], compared.of(maker), strict=True):
            assert shown["naive"] == pytest.approx(row.naive_error, abs=1e-4)
            assert shown["aware"] == pytest.approx(row.repeated_errors, abs=1e-4)
            assert shown["regret"] == pytest.approx(100 * row.silence_share, rel=1e-4, abs=1e-6)
    text = compared_page.read_text("utf-8")
    assert compared.header()[1:] in Reader(compared_page).inside["p"][0] or compared.header()[1:] in text


def test_missing_extra_is_named(found: Backtest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "jinja2", None)
    assert not can_write_pages()
    with pytest.raises(InputError, match=r"pip install 'inscrutable\[report\]'"):
        write_page(found, tmp_path / "report.html")
    assert not list(tmp_path.iterdir())


def test_extra_is_loaded_only_for_a_page() -> None:
    code = "import sys, inscrutable.reports.page; print('jinja2' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"


def test_other_results_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no page for a dict"):
        write_page({}, tmp_path / "report.html")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="cannot be written"):
        write_content(PageContent("t", "h", ["v"]), tmp_path / "none" / "report.html")


def test_content_without_figures_is_a_page(tmp_path: Path) -> None:
    path = write_content(PageContent(EVIL, "h", ["v"], manifest={"seed": "1"}), tmp_path / "report.html")
    read = Reader(path)
    assert EVIL not in path.read_text("utf-8")
    assert not read.all("script")
    assert not read.all("figure")


def test_a_slider_with_one_position_and_an_empty_list_of_failures_are_left_out(tmp_path: Path) -> None:
    sliders = [PageSlider("one", "One", ["all"]), PageSlider("two", "Two", ["a", "b"])]
    figures = [PageFigure("both", "Both", "c")]
    content = PageContent("t", "h", ["v"], sliders=sliders, figures=figures, script="comparison.js")
    read = Reader(write_content(content, tmp_path / "report.html"))
    assert [each["id"] for each in read.all("input")] == ["two"]
    assert not any("failed" in heading for heading in read.inside["h2"])
    failed = Reader(write_content(replace(content, failures=["A failed."]), tmp_path / "failed.html"))
    assert "What failed or was left out" in failed.inside["h2"]


# ---- in a real browser --------------------------------------------------------------------------------

needs_browser = pytest.mark.skipif(browser.found() is None, reason="no Chromium on this machine")


@pytest.fixture(scope="module")
def tab() -> Iterator[browser.Browser]:
    with browser.Browser() as opened:
        yield opened


def drawings(tab: browser.Browser) -> dict[str, str]:
    code = "Object.fromEntries([...document.querySelectorAll('.drawing')].map(each => [each.id, each.innerHTML]))"
    return dict(tab.run(code))


def changed(before: dict[str, str], after: dict[str, str]) -> set[str]:
    return {name for name in before if before[name] != after[name]}


@needs_browser
@pytest.mark.parametrize("width", [1200, 390])
@both
def test_page_opens_without_complaint_or_request(
    which: str, width: int, tab: browser.Browser, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    path: Path = request.getfixturevalue(which)
    tab.size(width, 800)
    tab.requests.clear()
    tab.complaints.clear()
    tab.open(path)
    assert tab.run("document.documentElement.dataset.drawn")
    assert tab.run("document.documentElement.scrollWidth") <= width, "no sideways scrolling of the page"
    assert all("<" in each for each in drawings(tab).values())
    assert not re.search(r"NaN|undefined|Infinity", "".join(drawings(tab).values()))
    tab.screenshot(tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 20_000
    assert tab.complaints == []
    assert [each for each in tab.requests if not each.startswith("data:")] == [path.as_uri()]


@needs_browser
def test_a_table_of_prose_is_read_on_a_phone_without_moving_it(tab: browser.Browser, tmp_path: Path) -> None:
    columns = ["Claim", "Paper's solvers", "Global solvers", "Verdict"]
    rows = [
        [
            "The CDM never violates the cost budget",
            *["0.005 ± 0.007, 100% of markets"] * 2,
            "holds <only> with & without",
        ]
    ]
    table = PageTable("The claims", columns, rows, is_prose=True)
    path = write_content(PageContent("Claims", "", ["All hold."], tables=[table]), tmp_path / "report.html")
    tab.size(390, 800)
    tab.open(path)
    assert tab.run("document.querySelector('.scroll').scrollWidth <= document.querySelector('.scroll').clientWidth")
    named = "[...document.querySelectorAll('td')].map(each => getComputedStyle(each, '::before').content)"
    assert tab.run(f"{named}[0]").startswith("attr(data-column)") or columns[1] in tab.run(f"{named}[0]")
    assert [tab.run(f"document.querySelectorAll('td')[{k}].dataset.column") for k in range(3)] == columns[1:]
    tab.size(1200, 800)
    assert tab.run(f"{named}[0]") == "none"


@needs_browser
def test_keys_move_both_sliders_and_what_they_should(found: Backtest, page: Path, tab: browser.Browser) -> None:
    data = data_of(page)
    tab.size(1200, 800)
    tab.open(page, "#step=3&budget=6")
    start = drawings(tab)
    assert json.loads(tab.run("document.documentElement.dataset.drawn")) == {"step": 3, "budget": 6}

    tab.run("document.getElementById('step').focus()")
    tab.press("ArrowRight")
    later = drawings(tab)
    assert tab.run("document.getElementById('step').value") == "4"
    assert tab.run("document.getElementById('step').getAttribute('aria-valuetext')") == data["dates"][4]
    of_step = {"simplex", "frontier", "now", "privacy", "cost", "beliefs"}
    assert changed(start, later) == of_step | {"weights", "followed", "bits", "errors"}

    tab.press("Tab")
    assert tab.run("document.activeElement.id") == "budget"
    tab.press("End")
    richer = drawings(tab)
    assert changed(later, richer) == of_step | {"sweep"}
    assert tab.run("location.hash") == f"#step=4&budget={len(data['amounts']) - 1}"
    rows = "[...document.querySelectorAll('#now tbody tr')].map(row => [...row.cells].map(cell => cell.textContent))"
    cdm = next(row for row in tab.run(rows) if row[0] == "counter-adversarial (CDM)")
    held = {row[0]: row[1:] for row in tab.run(rows.replace("#now", "#weights"))}
    for k, name in enumerate(found.names):
        for asset, weight in found.weights(name).iloc[4].items():
            assert float(held.get(asset, ["0.0"] * 3)[k]) == pytest.approx(100 * weight, abs=0.051)
    (atom,) = data["played"]["CDM"][-1][4][0]
    assert float(cdm[1]) == pytest.approx(100 * atom[2], rel=5e-3)
    assert float(cdm[2]) == pytest.approx(atom[3], rel=5e-3)
    centre = np.mean(data["sets"][atom[0]], axis=0)
    assert [float(each) for each in cdm[3].split()] == pytest.approx(centre, abs=0.0051)
    assert tab.complaints == []


@needs_browser
def test_beliefs_are_as_high_as_the_likeliest_regime(page: Path, tab: browser.Browser) -> None:
    tab.open(page, "#step=3&budget=0")
    own = np.array(data_of(page)["beliefs"])
    paths = tab.run(
        "[...document.querySelectorAll('#beliefs path')].slice(0, 3).map(each => each.getAttribute('d') || '')"
    )
    for regime, path in enumerate(paths):
        ends = [(float(low), float(high)) for low, high in re.findall(r"M\S+ ([\d.]+)V([\d.]+)H", path)]
        # A strip is 56 units high.
        assert [(low - high) / 56 for low, high in ends] == pytest.approx(
            own.max(axis=1)[own.argmax(axis=1) == regime], abs=0.002
        )


@needs_browser
def test_comparisons_sliders_choose_table_and_observer(compared_page: Path, tab: browser.Browser) -> None:
    tab.size(1200, 800)
    tab.open(compared_page, "#budget=0&memory=0")
    shown = "[...document.querySelectorAll('section > .scroll[data-slider]')].map(each => !each.hidden)"
    assert tab.run(shown) == [True, False]
    start = drawings(tab)
    tab.run("document.getElementById('budget').focus()")
    tab.press("ArrowRight")
    assert tab.run(shown) == [False, True]
    middle = drawings(tab)
    assert changed(start, middle) == {"naive", "aware", "both"}
    tab.press("Tab")
    tab.press("ArrowRight")
    assert changed(middle, drawings(tab)) == {"aware", "both"}
    assert tab.complaints == []


@needs_browser
def test_odd_results_are_drawn_too(missed: Backtest, by_regret: Backtest, tab: browser.Browser, tmp_path: Path) -> None:
    """Two regimes and a budget of regret; a goal that is met or missed, at no budget."""
    for number, result in enumerate((by_regret, missed)):
        tab.open(write_page(result, tmp_path / f"{number}.html"), "#step=999&budget=2")
        assert tab.run("document.getElementById('step').value") == str(len(result.beliefs) - 1)
        assert not re.search(r"NaN|undefined|Infinity", "".join(drawings(tab).values()))
    assert tab.complaints == []


@needs_browser
def test_paper_shows_all_tables_in_few_pages(compared_page: Path, tab: browser.Browser, tmp_path: Path) -> None:
    tab.open(compared_page)
    tab.printed(tmp_path / "page.pdf")
    pages = len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "page.pdf").read_bytes()))
    assert 1 <= pages <= 8
    assert tab.run("document.querySelectorAll('section > .scroll[data-slider]:not([hidden])').length") == 1, (
        "as before on the screen"
    )


# ---- from the command line ----------------------------------------------------------------------------


@pytest.mark.usefixtures("undrawn", "coarse")
def test_command_line_writes_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(31)
    spread = np.repeat([0.01, 0.05, 0.02], 20)[:, None]
    months = pd.date_range("2001-01", periods=60, freq="ME", name="date")
    returns = pd.DataFrame(0.01 + spread * rng.normal(size=(60, 2)), index=months, columns=["A", EVIL])
    returns.to_csv(tmp_path / "returns.csv")
    asked = {
        "backtest": [
            "--returns",
            str(tmp_path / "returns.csv"),
            "--regimes",
            "2",
            "--train-until",
            "2005-06",
            "--no-sequential",
        ],
        "compare": ["--resolution", "2", "--budgets", "silence:0.5", "--makers", "CDM,coin"],
    }
    for verb, arguments in some(list(asked.items()), 2):
        assert cli.main([verb, *arguments, "--out", str(tmp_path / verb), "--seed", "0", "-q"]) == 0
        assert "report.html" in capsys.readouterr().out
        read = Reader(tmp_path / verb / "report.html")
        assert dict(zip(read.inside["dt"], read.inside["dd"], strict=True))["seed"] == "0"


def test_command_line_does_without_the_extra(
    compared: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert cli_console.write_report(compared, tmp_path) == [tmp_path / "report.html"]
    (tmp_path / "report.html").unlink()
    monkeypatch.setitem(sys.modules, "jinja2", None)
    assert cli_console.write_report(compared, tmp_path) == []
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("verb", ["backtest", "compare"])
def test_help_names_the_extra(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    cli.main([verb, "--help"])
    assert "inscrutable[report]" in " ".join(capsys.readouterr().out.split()).replace("│ │ ", "")


def test_looks_are_all_different_and_variants_keep_their_colour() -> None:
    names = ["PDM", "PDM, atom 1", "PDM, atom 2", "PDM, atom 3", "CDM", "CDM local", "CDM far", *map(str, range(30))]
    looks = style.looks_of(names)
    assert list(looks) == names
    assert len({(look.colour, look.marker) for look in looks.values()}) == len(names)
    assert {looks[name].colour for name in names[:4]} == {style.LOOKS["PDM"].colour}
    assert looks["PDM"] == style.LOOKS["PDM"]


def test_every_mark_of_the_pictures_is_known_to_the_page() -> None:
    script = (Path(page_folder.__file__).parent / "assets" / "charts.js").read_text("utf-8")
    looks = [*style.LOOKS.values(), *style.looks_of(f"stranger {k}" for k in range(9)).values()]
    looks += [style.look_of(f"{name} local") for name in style.LOOKS]
    for look in looks:
        assert look.marker == "o" or f'case "{look.marker}":' in script, look
        assert f'"{look.line}":' in script, look
