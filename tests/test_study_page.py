"""The page of a study: the means of its rows, finished or not, failures with their reasons, nothing unescaped."""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import browser
from inscrutable import InputError, Study, cli, run_study
from inscrutable.experiments.holding import Reached, Requirement
from inscrutable.experiments.makers import MAKERS, Takes
from inscrutable.experiments.studies.grid import StudyGrid, Variant
from inscrutable.experiments.studies.layout import BudgetSection
from inscrutable.experiments.studies.means import StudyMeans, labels, means_of, spoken_observer
from inscrutable.experiments.studies.ranking import ranking
from inscrutable.experiments.studies.store import STORE
from inscrutable.experiments.studies.sweeps import sweep_of
from inscrutable.reports.names import full_name
from inscrutable.reports.page import study_page, write_page
from sizes import instances
from study_runs import SMALL
from test_page import EVIL, Reader, changed, data_of, drawings

MEGABYTE = 1_000_000
PLAN: dict[str, Any] = SMALL | {
    "name": f"small {EVIL}",
    "note": EVIL,
    "repeats": 4,
    "problem": {"risk_aversion": [2.0, 5.0]},
    "beliefs": {"kind": "grid", "resolution": 3},
    "measures": ["error", "prior_error", "naive_privacy", "expected_regret"],
}
FAILING = PLAN | {"problem": {"min_weight": [0.1, 0.5]}, "repeats": 2}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return run_study(Study.of(PLAN), tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="module")
def page(whole: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_page(whole, tmp_path_factory.mktemp("page") / "report.html")


@pytest.fixture(scope="module")
def means(whole: Study) -> StudyMeans:
    return means_of(whole.grid, whole.frame())


def test_means_are_those_of_the_rows(whole: Study, means: StudyMeans) -> None:
    """Against pandas, group by group."""
    rows = whole.frame()
    assert means.settings == ("problem.risk_aversion = 2", "problem.risk_aversion = 5")
    assert len(means.makers) == 7
    told = whole.means()
    mine = (rows["problem.risk_aversion"] == 5.0) & (rows["decision_maker"] == "uniform") & (rows["budget"] == 0.3)
    for observer in ("naive", "bayesian"):
        some = rows[mine & (rows["adversary"] == observer)]
        for measure in PLAN["measures"]:
            kept = told[(told["setting"] == means.settings[1]) & (told["decision_maker"] == "uniform")]
            kept = kept[(kept["budget"] == 0.3) & (kept["measure"] == measure)]
            (row,) = kept[kept["adversary"] == (observer if measure == "error" else "")].to_dict("records")
            values = some[measure]
            assert row["repeats"] == len(values) == 4
            assert row["mean"] == pytest.approx(values.mean(), rel=1e-12)
            assert row["half_width"] == pytest.approx(values.sem() * stats.t(3).isf(0.025), rel=1e-6, abs=1e-15)
            place = means.place[f"{measure}, {observer}" if measure == "error" else measure]
            play = next(k for k, maker in enumerate(means.makers) if (maker, means.budgets[k]) == ("uniform", 0.3))
            quantiles = np.quantile(values, [0, 0.25, 0.5, 0.75, 1])
            assert means.quantiles[1, play, place] == pytest.approx(quantiles, rel=1e-12)


def test_what_varies_tells_choices_apart() -> None:
    choices: list[dict[str, Any]] = [
        {"name": "ODM"},
        {"name": "coin", "probability": 0.1},
        {"name": "coin", "probability": 0.4},
        {"name": "coin"},
        {"name": "CDM", "goal": "maximal", "method": "local", "starts": 1},
        {"name": "CDM", "goal": "maximal", "method": "global"},
    ]
    found = labels([Variant.of(each) for each in choices], name="name")
    assert found == ["ODM", "coin, probability 0.1", "coin, probability 0.4", "coin", "CDM, local", "CDM, global"]
    near = [Variant.of({"name": "coin", "probability": each}) for each in (0.5, 0.50000001, 1)]
    assert labels(near, name="name") == ["coin, probability 0.5", "coin, probability 0.50000001", "coin, probability 1"]
    assert labels(near, prefix="a.") == ["a.probability = 0.5", "a.probability = 0.50000001", "a.probability = 1"]


def test_entries_that_differ_after_six_digits_stay_apart(tmp_path: Path) -> None:
    """Each has its own figures in the means and its own line on the page."""
    coin = {"name": "coin", "probability": [0.5, 0.50000001, 0.9]}
    plan = PLAN | {"repeats": 1, "problem": {"risk_aversion": [5.0, 5.000001]}, "decision_makers": ["uniform", coin]}
    study = run_study(Study.of(plan | {"budgets": {"values": [0.1, 0.1000001]}}), tmp_path / "study")
    found = study.means()
    assert not found.duplicated(["setting", "decision_maker", "budget", "measure", "adversary"]).any()
    assert list(found.setting.unique()) == ["problem.risk_aversion = 5", "problem.risk_aversion = 5.000001"]
    inside = Reader(write_page(study, tmp_path / "report.html")).inside
    assert {"coin, probability 0.5", "coin, probability 0.50000001"} <= set(inside["th"])
    assert {"0.1", "0.1000001"} <= set(inside["td"])


def test_page_is_whole_safe_and_small(whole: Study, page: Path, tmp_path: Path) -> None:
    text, read = page.read_text("utf-8"), Reader(page)
    assert EVIL not in text
    assert not re.search(r"https?:|//[\w.]+\.\w|@import|url\(|\bfetch\b|XMLHttpRequest|\bimport\(", text)
    assert read.inside["h1"] == [f"small {EVIL}"]
    assert {each["id"] for each in read.all("input")} == {"figure", "budget", "setting"}
    ids = [attributes["id"] for _, attributes in read.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    assert page.stat().st_size < MEGABYTE
    assert write_page(whole, tmp_path / "again.html").read_bytes() == page.read_bytes()
    manifest = dict(zip(read.inside["dt"], read.inside["dd"], strict=True))
    assert manifest["seed"] == "7"
    assert manifest["version of numpy"] == np.__version__
    assert json.loads(manifest["problem"])["risk_aversion"] == [2.0, 5.0]


def test_table_and_drawings_hold_the_means(means: StudyMeans, page: Path) -> None:
    read, data = Reader(page), data_of(page)
    rows = len(means.makers) * len(means.settings)
    cells = np.reshape(read.inside["td"], (rows, -1))
    assert list(cells[1, :2]) == ["0.1", "4"]
    place = 2 + means.place["error, bayesian"]
    assert cells[1, place].startswith(f"{means.mean[0, 1, means.place['error, bayesian']]:.3g} ± ")
    for setting in range(2):
        for play in range(len(means.makers)):
            for figure in range(len(means.figures)):
                shown = data["cells"][setting][play][figure]
                assert shown[0] == pytest.approx(means.mean[setting, play, figure], rel=1e-5)
                assert shown[2:] == pytest.approx(means.quantiles[setting, play, figure], rel=1e-5)
    assert data["figures"][data["cost"]] == "expected regret"
    looks = {(look["colour"], look["marker"]) for look in data["looks"].values()}
    assert len(looks) == len(data["makers"])


def test_verdict_names_the_best_against_each_observer(means: StudyMeans, page: Path) -> None:
    said = " ".join(Reader(page).inside["p"])
    for observer in ("naive", "bayesian"):
        place = means.place[f"error, {observer}"]
        best = ranking(means, 0, 0.1, place).plays[0]
        assert (
            f"largest error of the {spoken_observer(observer)} observer is under {full_name(means.makers[best])} ("
            in said
        )
    assert "budget of 0.1 of |c*|" in said
    assert re.search(r"By the error of the aware \(bayesian\) observer, .+ is first in [12] of 2 settings", said)


def test_means_that_are_compared_rest_on_the_same_repeats(whole: Study) -> None:
    """One play has failed in two of four repeats of the first setting, and in all but one it has other figures."""
    rows = whole.frame()
    mine = (rows["problem.risk_aversion"] == 2.0) & (rows["decision_maker"] == "uniform") & (rows["budget"] == 0.3)
    rows.loc[mine & rows["repeat"].isin([1, 3]), "status"] = "failed"
    paired = means_of(whole.grid, rows, paired=True)
    assert set(np.unique(paired.count[0])) <= {0, 2}
    assert (paired.count[1][paired.count[1] > 0] == 4).all()
    place, others = (
        paired.place["expected_regret"],
        rows[(rows["decision_maker"] == "Dirichlet noise") & (rows["budget"] == 0.3)],
    )
    others = others[(others["problem.risk_aversion"] == 2.0) & others["repeat"].isin([0, 2])]
    play = next(k for k, maker in enumerate(paired.makers) if (maker, paired.budgets[k]) == ("Dirichlet noise", 0.3))
    assert paired.mean[0, play, place] == pytest.approx(others["expected_regret"].mean(), rel=1e-12)
    rows.loc[(rows["decision_maker"] == "Dirichlet noise") & rows["repeat"].isin([0, 2]), "status"] = "failed"
    apart = means_of(whole.grid, rows, paired=True)  # no repeat of the first setting has all
    assert {2, 4} <= set(np.unique(apart.count[0]))


def test_the_verdict_says_on_which_repeats_it_rests(tmp_path: Path) -> None:
    part = run_study(Study.of(PLAN), tmp_path, limit=instances(60, least=20))
    said = " ".join(study_page.study_verdict(part))
    assert re.search(
        r"This rests on the [123] of 4 repeats that have all figures|rest on \d to \d different repeats", said
    )


@pytest.mark.parametrize(
    ("budgets", "said"),
    [
        (
            {"values": [50.0]},
            "Caution: a budget of 50 of |c*| is more than the optimal cost itself (50 per cent are written 50%).",
        ),
        ({"values": [0.5, 1.5], "unit": "silence"}, "Caution: a budget of 150% of the silence regret is more than"),
        ({"values": [0.0, 0.3]}, ""),
    ],
)
def test_an_unusual_budget_is_pointed_out(budgets: dict[str, Any], said: str) -> None:
    found = Study.of(PLAN | {"budgets": budgets}).cautions()
    assert " ".join(found).startswith(said)
    assert bool(found) == bool(said)


def test_an_unfinished_study_says_so(tmp_path: Path) -> None:
    half = run_study(Study.of(PLAN), tmp_path, limit=9)
    read = Reader(write_page(half, tmp_path / "report.html"))
    said = " ".join(read.inside["p"])
    assert f"not finished: {half.n_tasks - 9} of {half.n_tasks} tasks have no row yet" in said
    assert "of 4" in " ".join(read.inside["td"])
    assert "–" in read.inside["td"]
    assert data_of(tmp_path / "report.html")["cells"][0][0]


def test_a_study_without_figures_is_a_page_too(tmp_path: Path) -> None:
    none = run_study(Study.of(PLAN | {"problem": {"min_weight": 0.5}, "repeats": 1}), tmp_path)
    assert none.status().done == 0
    read = Reader(write_page(none, tmp_path / "report.html"))
    assert not read.all("script")
    assert "No task of this study has figures yet." in " ".join(read.inside["p"])


def test_failures_are_told_once_with_their_tasks(tmp_path: Path) -> None:
    study = run_study(Study.of(FAILING), tmp_path)
    read = Reader(write_page(study, tmp_path / "report.html"))
    failed = study.frame().query("status == 'failed'")
    reasons = failed.groupby("failure").groups
    told = [each.strip() for each in read.inside["li"] if re.match(r"\s*\d+ tasks? \(", each)]
    assert sorted(told) == sorted(
        f"{len(tasks)} tasks ({', '.join(map(str, tasks[:5]))}, …): {reason}" for reason, tasks in reasons.items()
    )
    assert f"{len(failed)} of {study.n_tasks} tasks failed" in " ".join(read.inside["p"])


@pytest.mark.parametrize(
    ("makers", "hold", "said"),
    [
        (["ODM", "uniform"], "each", "shares of |c*|, at every belief."),
        (["ODM", "exponential"], "each", "shares of |c*|, in expectation over the beliefs."),
        (
            ["ODM", "exponential", "uniform", "CDM", "coin", {"name": "rounding", "step": 0.5}],
            "each",
            "shares of |c*|, at every belief for uniform and CDM, in expectation over the beliefs for exponential and coin.",
        ),
        (["ODM", "exponential", "uniform"], "mean", "shares of |c*|, in expectation over the beliefs."),
    ],
)
def test_the_page_says_where_budgets_hold(makers: list[Any], hold: str, said: str, tmp_path: Path) -> None:
    """Makers of noise take a budget in expectation alone."""
    study = Study.of(PLAN | {"repeats": 1, "decision_makers": makers, "budgets": {"values": [0.1], "hold": hold}})
    page = write_page(run_study(study, tmp_path / "study", limit=1), tmp_path / "report.html")
    assert f"budgets: {said}" in " ".join(Reader(page).inside["p"])


def test_the_document_names_who_takes_a_budget_at_every_belief() -> None:
    text = " ".join((BudgetSection.__doc__ or "").split())
    told = text.partition("holds at every belief for ")[2].partition(" and rules of your own")[0]
    assert told.split(", ") == [name for name, kind in MAKERS.items() if kind.takes is Takes.EACH]


def test_the_page_opens_at_the_setting_of_its_verdict_and_draws_no_rounding(tmp_path: Path) -> None:
    study = run_study(
        Study.of(PLAN | {"problem": {"max_weight": [0.2, 1.0]}, "decision_makers": ["ODM", "uniform"]}), tmp_path
    )
    path = write_page(study, tmp_path / "report.html")
    read = Reader(path)
    (setting,) = (each for each in read.all("input") if each["id"] == "setting")
    assert setting["value"] == "1"
    assert "in the setting problem.max_weight = 1" in " ".join(read.inside["p"])
    cells = data_of(path)["cells"]
    assert all(cell[0] is None for play in cells[0] for cell in play)
    numbers = [each for play in cells[1] for cell in play for each in cell if each is not None]
    assert 0 in numbers
    assert all(each == 0 or abs(each) >= 1e-12 for each in numbers)


def test_small_costs_are_shown_with_all_their_digits(tmp_path: Path) -> None:
    """In the drawings, the table and the verdict, with costs of 1e-11; roundings stay 0."""
    market = {"means": [[1e-9, 2e-9], [3e-9, -2e-9]], "covariances": [[[1e-9, 0.0], [0.0, 2e-9]]] * 2}
    makers = ["ODM", "rounding", {"name": "coin", "probability": 0.7}]
    study = costly_rule(tmp_path / "study", world={"kind": "given"} | market, decision_makers=makers)
    means = means_of(*study.gridded())
    place = means.place["expected_regret"]
    costs = means.mean[0, :, place]
    assert 1e-13 < costs[1] < costs[-1] < 1e-10
    path = write_page(study, tmp_path / "report.html")
    read = Reader(path)
    shown = [play[place][0] for play in data_of(path)["cells"][0]]
    assert shown == pytest.approx(costs, rel=1e-5, abs=0.0)
    assert shown[0] == 0
    assert {f"{each:.3g}" for each in costs} <= set(read.inside["td"])
    assert f"to {costs[-1]:.3g} (coin)" in " ".join(read.inside["p"])


def test_one_task_is_one_task(tmp_path: Path) -> None:
    study = Study.of(PLAN | {"decision_makers": "ODM", "adversaries": "naive", "problem": {}, "repeats": 1})
    assert study.summary().endswith(": 1 task")
    assert "1 of 1 task done" in run_study(study, tmp_path).summary()


def test_many_settings_are_thinned(whole: Study, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(study_page, "_MOST_CELLS", 10)
    path = write_page(whole, tmp_path / "report.html")
    assert len(data_of(path)["cells"]) == 1
    assert "shows 1 of 2 settings" in " ".join(Reader(path).inside["p"])


def test_studies_without_an_observers_error_have_a_verdict(tmp_path: Path) -> None:
    plan = PLAN | {"measures": ["mutual_information"], "problem": {}, "decision_makers": ["ODM", "uniform"]}
    study = run_study(Study.of(plan | {"budgets": {"values": 0.1}}), tmp_path)
    read = Reader(write_page(study, tmp_path / "report.html"))
    assert "the smallest leakage in bits is under uniform" in " ".join(read.inside["p"])
    assert [each["id"] for each in read.all("input")] == ["figure"], "what is paid is measured, too"
    bare = run_study(Study.of(plan | {"measures": ["n_actions"], "repeats": 1}), tmp_path / "bare")
    said = " ".join(Reader(write_page(bare, tmp_path / "bare.html")).inside["p"])
    assert "tasks have figures" in said
    assert "one repeat" in said


def test_a_study_that_was_not_run_has_no_page(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no rows yet"):
        write_page(Study.of(PLAN), tmp_path / "report.html")
    assert not list(tmp_path.iterdir())


def test_command_line_writes_the_report(whole: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert whole.folder is not None
    copy = Path(shutil.copytree(whole.folder, tmp_path / "copy"))
    assert cli.main(["study", "report", str(copy)]) == 0
    assert f"{copy / 'report.html'}" in capsys.readouterr().out.replace("\n", "")
    assert cli.main(["study", "report", str(copy), "--out", str(tmp_path / "a.html"), "--title", EVIL, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["file"] == str(tmp_path / "a.html")
    assert Reader(tmp_path / "a.html").inside["h1"] == [EVIL]
    (copy / STORE).unlink()
    assert cli.main(["study", "report", str(copy)]) == 3


# ---- in a real browser --------------------------------------------------------------------------------

needs_browser = pytest.mark.skipif(browser.found() is None, reason="no Chromium on this machine")


@pytest.fixture(scope="module")
def tab() -> Iterator[browser.Browser]:
    with browser.Browser() as opened:
        yield opened


@needs_browser
@pytest.mark.parametrize("width", [1200, 390])
def test_page_opens_and_keys_move_what_they_should(
    width: int, means: StudyMeans, page: Path, tab: browser.Browser, tmp_path: Path
) -> None:
    tab.size(width, 800)
    tab.requests.clear()
    tab.complaints.clear()
    tab.open(page, "#figure=0&budget=0&setting=0")
    assert tab.run("document.documentElement.scrollWidth") <= width
    start = drawings(tab)
    shown = "[...document.querySelectorAll('[data-slider]')].map(each => !each.hidden)"
    assert tab.run(shown) == [True, False]
    assert len(re.findall("<rect", start["spread"])) == sum(each in (None, 0.1) for each in means.budgets)

    tab.run("document.getElementById('figure').focus()")
    tab.press("ArrowRight")
    second = drawings(tab)
    assert changed(start, second) == {"tradeoff", "spread", "sweptA"}
    tab.press("Tab")
    tab.press("End")
    third = drawings(tab)
    assert changed(second, third) == {"tradeoff", "spread", "sweptA"}
    tab.press("Tab")
    tab.press("ArrowRight")
    assert changed(third, drawings(tab)) == {"tradeoff", "spread"}
    assert tab.run(shown) == [False, True]
    assert tab.run("location.hash") == "#figure=1&budget=1&setting=1"
    assert not re.search(r"NaN|undefined|Infinity", "".join(drawings(tab).values()))
    tab.screenshot(tmp_path / "page.png")
    assert (tmp_path / "page.png").stat().st_size > 20_000
    assert tab.complaints == []
    assert tab.requests[-1].startswith(page.as_uri())
    assert len(tab.requests) == 1


@needs_browser
def test_odd_studies_are_drawn_and_printed_too(tab: browser.Browser, tmp_path: Path) -> None:
    """One figure and one budget; half finished; budgets over powers of ten."""
    plans: list[tuple[dict[str, Any], int]] = [
        (PLAN | {"measures": ["mutual_information"], "problem": {}, "budgets": {"values": 0.1}}, 5),
        (PLAN, 3),
        (PLAN | {"problem": {"max_weight": [0.2, 1.0]}}, 1000),
        (PLAN | {"problem": {}, "repeats": 1, "budgets": {"values": [0.001, 0.1, 10.0]}}, 1000),
    ]
    for number, (plan, limit) in enumerate(plans):
        study = run_study(Study.of(plan), tmp_path / str(number), limit=limit)
        tab.open(write_page(study, tmp_path / f"{number}.html"))
        drawn = drawings(tab)
        assert set(drawn) == {"tradeoff", "spread", *(["sweptA"] if plan["problem"] else [])}
        assert not re.search(r"NaN|undefined|Infinity", "".join(drawn.values()))
        tab.printed(tmp_path / "page.pdf")
        assert 1 <= len(re.findall(rb"/Type\s*/Page\b", (tmp_path / "page.pdf").read_bytes())) <= 8
    assert tab.complaints == []


SWEPT: dict[str, Any] = {
    "name": "two keys",
    "world": {"kind": "random", "persistence": [0.5, 0.8, 0.9]},
    "problem": {"risk_aversion": [2.0, 5.0]},
    "beliefs": {"kind": "grid", "resolution": 3},
    "candidates": {"resolution": 3},
    "decision_makers": ["coin", "uniform"],
    "budgets": {"values": [0.1, 0.3]},
    "measures": ["error", "expected_regret"],
}


def test_two_swept_keys_are_an_axis_and_curves(tmp_path: Path) -> None:
    study = run_study(Study.of(SWEPT), tmp_path / "study")
    page = write_page(study, tmp_path / "page.html")
    told, cells, rows = data_of(page)["sweep"], data_of(page)["cells"], study.frame()
    assert (told["axis"], told["values"], told["ticks"]) == ("world.persistence", [0.5, 0.8, 0.9], None)
    assert [[curve[1] for curve in facet] for facet in told["facets"]] == [["coin"] * 2, ["uniform"] * 2]
    names = [f"problem.risk_aversion = {each}" for each in (2, 5)]
    for facet in told["facets"]:
        assert [curve[0] for curve in facet] == names
        for (_, maker, settings), aversion in zip(facet, (2.0, 5.0), strict=True):
            play = [each[0] for each in data_of(page)["plays"]].index(data_of(page)["makers"].index(maker))
            for persistence, setting in zip(told["values"], settings, strict=True):
                mine = (rows["world.persistence"] == persistence) & (rows["problem.risk_aversion"] == aversion)
                (wanted,) = rows[mine & (rows.decision_maker == maker) & (rows.budget == 0.1)]["error"]
                assert cells[setting][play][0][0] == pytest.approx(wanted, rel=1e-5)
    assert "curves are the values of problem.risk_aversion" in page.read_text("utf-8")


def test_more_keys_are_facets_and_what_is_not_drawn_is_said() -> None:
    plan = SWEPT | {"beliefs": {"kind": "grid", "resolution": [3, 4]}}
    plan["world"] = {"kind": "random", "assets": list(range(2, 12)), "persistence": [0.5, 0.8, 0.9]}
    plan["candidates"] = {"kind": ["decoys", "actions"], "resolution": 3}
    plan["problem"] = {"risk_aversion": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]}
    found = sweep_of(StudyGrid(Study.of(plan).plan), ["coin", "uniform"])
    assert found is not None
    assert (found.axis, found.curves_of) == ("world.assets", "problem.risk_aversion")
    assert [len(curves) for _, curves in found.facets] == [6] * 6
    assert found.facets[0][0] == "coin, world.persistence = 0.5, beliefs.resolution = 3, candidates.kind = decoys"
    assert found.left_out == "6 of 7 values of problem.risk_aversion are drawn; 6 of 24 figures are drawn"
    words = sweep_of(StudyGrid(Study.of(SWEPT | {"world": {"kind": "random"}, "problem": {}}).plan), ["coin"])
    assert words is None
    plan = SWEPT | {"world": {"kind": "random", "sensor": ["categorical", "gaussian"]}, "problem": {}}
    words = sweep_of(StudyGrid(Study.of(plan).plan), ["coin", "uniform"])
    assert words is not None
    assert (words.axis, words.is_numeric, words.curves_of) == ("world.sensor", False, "")
    assert [curve.name for curve in words.facets[0][1]] == ["coin", "uniform"]


@needs_browser
def test_swept_keys_are_drawn(tab: browser.Browser, tmp_path: Path) -> None:
    tab.complaints.clear()
    for number, changes in enumerate(({}, {"world": {"kind": "random", "sensor": ["categorical", "gaussian"]}})):
        study = run_study(Study.of(SWEPT | changes), tmp_path / str(number))
        tab.open(write_page(study, tmp_path / f"{number}.html"), "#figure=0&budget=1")
        drawn = drawings(tab)
        assert set(drawn) == {"tradeoff", "spread", "sweptA", "sweptB"}
        assert not re.search(r"NaN|undefined|Infinity", "".join(drawn.values()))
        assert drawn["sweptA"].count("<path") == 4  # two curves, a line and a row of marks each
        tab.screenshot(tmp_path / f"{number}.png")
    assert tab.complaints == []


def costly_rule(folder: Path, **changes: object) -> Study:
    """A study whose second rule takes no budget and spends several times as much as the first."""
    plan = {
        "name": "a rule that spends more",
        "world": {"kind": "random"},
        "beliefs": {"kind": "grid", "resolution": 4},
        "candidates": {"resolution": 6},
        "decision_makers": ["ODM", "PDM", {"name": "coin", "probability": 1.0}],
        "adversaries": ["bayesian", "naive"],
        "measures": ["error", "mutual_information"],
        "budgets": {"unit": "silence", "values": [0.1, 0.2, 0.3]},
    }
    return run_study(Study.of(plan | changes), folder)


def test_who_spends_more_is_no_better_for_that(tmp_path: Path) -> None:
    study = costly_rule(tmp_path)
    rows = study.frame().query("adversary == 'naive'").set_index(["decision_maker", "budget"])
    constant = rows.loc["coin"].iloc[0]
    lottery = rows.loc[("PDM", 0.2)]
    assert constant["expected_regret"] > 4 * lottery["expected_regret"], (
        "the costs are there though nobody asked for them"
    )
    verdict = " ".join(Reader(write_page(study, tmp_path / "report.html")).inside["p"])
    times = constant["expected_regret"] / lottery["expected_regret"]
    assert f"(coin), {times:.1f} times as much" in verdict
    assert f"compared at an equal expected regret of {lottery['expected_regret']:.3g}" in verdict
    # What the constant decision keeps secret is bought by a coin, whose square error grows in proportion to its costs.
    share = lottery["expected_regret"] / constant["expected_regret"]
    shared = np.sqrt((1.0 - share) * rows.loc["ODM"].iloc[0]["error"] ** 2 + share * constant["error"] ** 2)
    leader = "probabilistic" if lottery["error"] > shared else "coin"
    assert f"largest error of the naive observer is under {leader}" in verdict
    assert f"about {shared:.3g}" in verdict, verdict
    assert "cost, times the least at its budget" in Reader(tmp_path / "report.html").inside["th"]


def test_costs_that_are_the_same_rank_as_they_are(tmp_path: Path) -> None:
    budgets = {"unit": "silence", "hold": "mean", "values": [0.2]}
    study = costly_rule(tmp_path, decision_makers=["PDM", "coin", "exponential"], budgets=budgets)
    verdict = " ".join(Reader(write_page(study, tmp_path / "report.html")).inside["p"])
    assert "times as much" not in verdict
    assert "about" not in verdict.split("Decision makers rank")[0]


def test_a_protection_is_judged_as_by_the_other_verbs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """At equal costs, against means that pandas takes; who spends nothing, or is not measured whole, is not judged."""
    budgets = {"unit": "silence", "hold": "mean", "values": [0.2, 0.9]}
    makers = ["ODM", "PDM", "coin", "exponential"]
    study = costly_rule(tmp_path, decision_makers=makers, budgets=budgets, measures=["error", "top_state"], repeats=2)
    rows = study.frame()
    rows = (
        rows[(rows.budget == 0.2) | rows.budget.isna()].groupby(["adversary", "decision_maker"]).mean(numeric_only=True)
    )
    asked = Requirement(rows.prior_error.iloc[0], rows.prior_top_state.iloc[0])
    meaning = asked.meaning(without="decisions", state="state", cases="the cases")
    wanted, written = {meaning}, {meaning}  # with the names of the file, and written out
    for observer in ("naive", "bayesian"):
        own, start = rows.loc[observer], f"Hidden from the {spoken_observer(observer)} observer"
        for names, said in ((str, wanted), (full_name, written)):
            reached = [Reached(names(name), own.error[name], own.top_state[name]) for name in makers[1:]]
            said.add(f"{start}: {asked.judge(reached)}.")
    assert cli.main(["study", "report", str(tmp_path)]) == 0
    line = " ".join(capsys.readouterr().out.split())
    assert set(study.protection()) == wanted
    for part in written:
        assert part in line
        assert part in " ".join(Reader(tmp_path / "report.html").inside["p"])
    assert costly_rule(tmp_path / "bare", decision_makers=["ODM"], measures=["error", "top_state"]).protection() == []
    assert costly_rule(tmp_path / "half", decision_makers=["coin"], measures=["error"]).protection() == []


def test_nothing_is_judged_where_silence_costs_nothing(tmp_path: Path) -> None:
    """All beliefs have one best decision, whose regrets are roundings."""
    market = {"means": [[0.05, 0.01], [0.06, 0.013], [0.055, 0.007]], "covariances": [[[0.001, 0.0], [0.0, 0.002]]] * 3}
    budgets = {"unit": "silence", "hold": "mean", "values": [0.5]}
    makers, measures = ["ODM", "exponential", "coin", "CDM"], ["error", "top_state", "silence_share"]
    changes = {"world": {"kind": "given"} | market, "problem": {"risk_aversion": 1.0}, "budgets": budgets}
    changes |= {"beliefs": {"kind": "grid", "resolution": 7}, "decision_makers": makers, "measures": measures}
    study = costly_rule(tmp_path, **changes)
    assert study.protection() == []
    assert study.frame().silence_share.isna().all()


def test_the_budget_of_the_verdict_does_not_depend_on_their_order(tmp_path: Path) -> None:
    lines = []
    for place, values in enumerate(([0.75, 0.25, 0.5], [0.25, 0.5, 0.75])):
        study = costly_rule(tmp_path / str(place), budgets={"unit": "silence", "hold": "mean", "values": values})
        lines.append(study_page.study_verdict(study))
    assert lines[0] == lines[1]
    assert "at a budget of 0.5 of the silence regret" in lines[0][0]


@pytest.mark.parametrize("kind", ["given", "random"])
def test_repeats_of_the_same_figures_are_pointed_out(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also beside a measure of one's own that is infinite."""
    (tmp_path / "far_part.py").write_text("def far(mechanism): return float('inf')")
    monkeypatch.syspath_prepend(str(tmp_path))
    market = {"means": [[0.02, 0.01], [-0.03, 0.0]], "covariances": [[[0.002, 0.0], [0.0, 0.001]]] * 2}
    plan = PLAN | {"problem": {"risk_aversion": 5.0}, "decision_makers": ["ODM", "uniform"]}
    plan |= {"world": {"kind": kind} | (market if kind == "given" else {})}
    plan |= {"measures": [*PLAN["measures"], "far"]}
    study = run_study(Study.of(plan | {"repeats": 3}, extensions=["far_part:far"]), tmp_path / "all")
    said = "All 3 repeats gave the same figures"
    assert (said in " ".join(study_page.study_verdict(study))) is (kind == "given")
    alone = run_study(Study.of(plan | {"repeats": 1}, extensions=["far_part:far"]), tmp_path / "alone")
    assert "gave the same figures" not in " ".join(study_page.study_verdict(alone))
    sys.modules.pop("far_part")
