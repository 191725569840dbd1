"""The reproduction and the comparison as studies: gone on with where they were stopped, the same numbers as in one go."""

from __future__ import annotations

import base64
import json
import os
import shutil
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import browser
from inscrutable import InputError, MarkowitzProblem, ModelError, Study, cli, resume_study, run_study
from inscrutable.datasets import write_json
from inscrutable.experiments.comparison import COMPARED, ComparisonSettings, compare, makers_of
from inscrutable.experiments.comparison_markets import market_of
from inscrutable.experiments.comparison_study import compared, comparison_of, comparison_study
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.experiments.market_runs import MarketRun, run_market
from inscrutable.experiments.random_markets import MarketLaw
from inscrutable.experiments.reproduction import (
    Reproduction,
    ReproductionSettings,
    reproduce,
    reproduction_of,
)
from inscrutable.experiments.studies.flat import flat, unflat
from inscrutable.experiments.studies.reproduction_tasks import MarketRunner
from inscrutable.experiments.studies.store import STORE
from inscrutable.experiments.studies.tasks import Done, TaskRunner
from inscrutable.experiments.studies.whole import BEFORE, all_rows, shipped
from inscrutable.experiments.weight_limits import LimitsPart
from inscrutable.reports.reproduction import summary_of
from inscrutable.worlds import GaussianEmission, HiddenMarkovModel
from sizes import some
from small_runs import learned_from_few, nothing_painted, repeated_markets, short_searches, short_simulations
from study_runs import SMALL
from test_page import EVIL, Reader


@pytest.fixture(scope="module", autouse=True)
def soon() -> Iterator[None]:
    with short_searches(), repeated_markets(), learned_from_few():
        yield


EFFORT: dict[str, Any] = {
    "resolution": 5,
    "simulations": 2,
    "market_steps": 2,
    "budgets": (0.1, 1.0),
    "starts": (1, 2),
    "sample_resolutions": (2,),
}
SETTINGS = ReproductionSettings(steps=2, markets=4, **EFFORT)
SHIPPED = (resources.files("inscrutable.experiments.studies") / "shipped" / "reproduction.toml").read_text("utf-8")
REPRODUCE = ["reproduce", "--markets", "4", "--simulations", "2", "--steps", "2", "--resolution", "5", "--jobs", "1"]
COMPARE_ANY = ["compare", "--resolution", "2", "--budgets", "silence:0.5", "--jobs", "1"]
COMPARE = [*COMPARE_ANY, "--makers", "ODM,CDM,uniform,exponential,coin,rounding,rate-distortion"]


def interrupted_at(
    number: int, monkeypatch: pytest.MonkeyPatch, error: type[BaseException] = KeyboardInterrupt
) -> None:
    """Have a task stop the run."""
    do = TaskRunner.done

    def done(self: TaskRunner, place: int) -> Done:
        if place == number:
            raise error
        return do(self, place)

    monkeypatch.setattr(TaskRunner, "done", done)


# ---- the studies -----------------------------------------------------------------------------------


def test_what_is_shipped_are_the_defaults_of_both_verbs() -> None:
    assert Study.of(ReproductionSettings()).plan == Study.of(shipped("reproduction")).plan
    chosen = comparison_study(ComparisonSettings(), market="paper", resolution=30, seed=0)
    assert chosen.plan == Study.of(shipped("comparison")).plan
    assert Study.of(shipped("comparison")).n_tasks == 4 * (len(COMPARED) - 1) + 1
    assert Study.of(SETTINGS).n_tasks == 4


def test_a_markets_record_survives_its_row() -> None:
    (row, *_), _ = all_rows(Study.of(SETTINGS))
    found = reproduce(SETTINGS, jobs=1).runs[0]
    direct = run_market(SETTINGS, np.random.SeedSequence(0).spawn(5)[1], True)
    for one in (found, direct):
        assert dict(flat(parts(one))) == json.loads(row.figures)
    assert found.odm.dimension.dtype.kind == "i"


def parts(run: MarketRun) -> dict[str, object]:
    return {"odm": run.odm, **run.variants, "starts": run.starts, "samples": run.samples}


def test_the_comparison_is_the_librarys_own(tmp_path: Path) -> None:
    """A few decision makers; in `make audit` all of them."""
    settings, makers = ComparisonSettings(budgets=(0.6,), repeats=(1, 5), draws=20), tuple(some(list(COMPARED), 4))
    market = market_of("paper", 2, 7)
    study = comparison_study(settings, makers, market="paper", resolution=2, seed=7)
    told: list[str] = []
    with short_simulations():
        direct = compare(market.problem, market.chain, settings, makers=makers_of(makers), rng=np.random.default_rng(7))
        found, note = compared(study, tmp_path, jobs=1, say=told.append, progress=lambda done, total: None)
    assert found.frame().equals(direct.frame())
    assert found.summary() == direct.summary()
    assert (found.header(), found.left_out, found.prior_top_state) == (
        direct.header(),
        direct.left_out,
        direct.prior_top_state,
    )
    assert note == market.note
    assert told == [f"{market.note}; 6 beliefs"]


@pytest.mark.usefixtures("undrawn")
def test_compare_takes_the_makers_that_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = [*COMPARE_ANY, "--out", str(tmp_path / "out")]
    names = ["rounding", "CDM, candidates only", "ODM", "rate-distortion"]
    assert cli.main([*asked, "--makers", ",".join(names)]) == 0
    table = pd.read_csv(tmp_path / "out" / "comparison.csv")
    assert list(table["maker"]) == names
    capsys.readouterr()
    for wrong, told in (
        ("CDM,rate distortion", "there is no decision maker 'rate distortion'; did you mean rate-distortion?"),
        ("cdm", "did you mean CDM?"),
        ("CDM,,PDM", "there is no decision maker ''; expected some of ODM, CDM"),
        ("CDM, candidates only,CDM, candidates only", "CDM, candidates only is named more than once"),
    ):
        assert cli.main([*asked, "--makers", wrong]) == 3
        assert told in " ".join(capsys.readouterr().err.split())


def test_a_models_file_is_a_market(tmp_path: Path) -> None:
    means, spreads = np.array([[0.02, 0.0], [-0.03, 0.0]]), [0.01 * np.eye(2), 0.09 * np.eye(2)]
    world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], GaussianEmission(means, spreads))
    InvestorModel(world, MarkowitzProblem(means, spreads, 2.0), ("A", "B"), world.names).save(tmp_path / "model.json")
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1,), draws=10)
    makers = ("ODM", "CDM", "coin", "rounding")
    study = comparison_study(settings, makers, market=str(tmp_path / "model.json"), resolution=4, seed=0)
    half = run_study(study, tmp_path / "out", limit=2)
    (tmp_path / "model.json").unlink()
    whole = resume_study(half.folder or "")
    assert whole.status().failed == 0
    assert whole.frame()["sha256"].eq(study.data_hash).all()
    with pytest.raises(InputError, match=r"model\.json cannot be read"):
        comparison_study(settings, market=str(tmp_path / "model.json"), resolution=4, seed=0)


def test_rows_can_be_exported_like_any_studys(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_study(Study.of(SETTINGS), tmp_path)
    assert cli.main(["study", "export", str(tmp_path), "--durations"]) == 0
    lines = (tmp_path / "rows.csv").read_text("utf-8").splitlines()
    assert len(lines) == 5
    assert {"market", "odm.privacy.0", "global.cdm.privacy.1", "samples.decoy grid.0", "duration"} <= set(
        lines[0].split(",")
    )
    with pytest.raises(InputError, match="is no grid of settings"):
        Study.load(tmp_path).means()


# ---- their pages -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of both verbs' results."""
    place = tmp_path_factory.mktemp("told")
    with nothing_painted():
        for verb in (REPRODUCE, COMPARE):
            assert cli.main([*verb, "--out", str(place / verb[0]), "-q"]) == 0
    return {verb[0]: place / verb[0] for verb in (REPRODUCE, COMPARE)}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("verb", ["reproduce", "compare"])
def test_a_study_has_the_page_of_its_results(verb: str, told: dict[str, Path], tmp_path: Path) -> None:
    """The same but for the manifest, which says what the rows were made by."""
    assert cli.main(["study", "report", str(told[verb] / "study"), "--out", str(tmp_path / "report.html")]) == 0
    own, found = (each.read_text("utf-8") for each in (told[verb] / "report.html", tmp_path / "report.html"))
    cut = '<h2 id="manifest">'
    assert found.split(cut)[0] == own.split(cut)[0]
    assert found.split("</main>")[1] == own.split("</main>")[1]
    read = Reader(tmp_path / "report.html")
    manifest = dict(zip(read.inside["dt"], read.inside["dd"], strict=True))
    stored = Study.load(told[verb] / "study").manifest()
    assert manifest["version of joblib"] == stored["versions"]["joblib"]
    assert manifest["kind"] == stored["study"]["kind"]
    assert len(found) < 6e6


def test_the_page_of_a_reproduction_holds_its_claims_and_pictures(told: dict[str, Path]) -> None:
    folder = told["reproduce"]
    read = Reader(folder / "report.html")
    claims = pd.read_csv(folder / "claims.csv")
    assert set(claims["claim"]) <= set(read.inside["th"])
    verdicts = claims["verdict"].value_counts()
    assert f"{verdicts['holds']} hold" in read.inside["p"][1]
    assert any("4 markets are few" in each for each in read.inside["p"])
    pictures = [
        base64.b64decode((each["src"] or "").removeprefix("data:image/svg+xml;base64,")) for each in read.all("img")
    ]
    assert pictures == [
        (folder / f"{name}.svg").read_bytes()
        for name in (
            *(
                f"{variant}_{what}"
                for what in ("actions", "beliefs", "privacy", "costs", "tradeoff")
                for variant in ("paper", "global")
            ),
            "convergence",
        )
    ]
    assert all(len(each["alt"] or "") > 40 for each in read.all("img"))
    assert not read.all("script")


def test_a_page_that_is_there_is_named(
    told: dict[str, Path], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(told["compare"], tmp_path / "copy"))
    page = folder / "report.html"
    page.write_text("mine", "utf-8")
    assert cli.main(["study", "report", str(folder)]) == 0
    assert f"Its page is {page}" in capsys.readouterr().out
    assert page.read_text("utf-8") == "mine"
    page.unlink()
    assert cli.main(["study", "report", str(folder), "--title", EVIL]) == 0
    assert Reader(page).inside["h1"] == [EVIL]
    assert cli.main(["study", "status", str(folder)]) == 3
    assert f"such as {folder / 'study'}" in capsys.readouterr().err


@pytest.mark.usefixtures("undrawn")
def test_a_page_of_the_whole_needs_the_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_study(Study.of(SETTINGS), tmp_path, limit=3)
    assert cli.main(["study", "report", str(tmp_path)]) == 3
    told = capsys.readouterr().err
    assert "1 of 4 tasks have no row" in told
    assert f"go on with `inscrutable study resume {tmp_path}`" in told
    assert not (tmp_path / "report.html").exists()
    resume_study(tmp_path)
    assert cli.main(["study", "report", str(tmp_path), "-q"]) == 0


def test_a_reproduction_comes_back_from_its_rows(tmp_path: Path) -> None:
    made = reproduce(SETTINGS, jobs=1, folder=tmp_path)
    found = reproduction_of(Study.load(tmp_path))
    assert found.settings == SETTINGS
    write_json(summary_of(made), tmp_path / "made.json")
    write_json(summary_of(found), tmp_path / "found.json")
    assert (tmp_path / "made.json").read_bytes() == (tmp_path / "found.json").read_bytes()
    with pytest.raises(InputError, match="no comparison"):
        comparison_of(Study.load(tmp_path))
    with pytest.raises(InputError, match="no study of the paper"):
        reproduction_of(comparison_study(ComparisonSettings(), market="paper", resolution=4, seed=0))


def test_the_steps_that_are_drawn_are_no_part_of_a_task() -> None:
    """Stores written before a file could name them are read, and have the same rows."""
    data = {key: value for key, value in shipped("reproduction").items() if key != "steps"}
    older, newer = Study.of(data), Study.of(data | {"steps": 5})
    assert older.plan.model_dump()["steps"] == 30
    assert older.grid.task(3) == newer.grid.task(3)


@pytest.mark.skipif(browser.found() is None, reason="no Chromium on this machine")
@pytest.mark.parametrize("width", [1200, 390])
def test_the_page_of_a_reproduction_opens(width: int, told: dict[str, Path]) -> None:
    page = told["reproduce"] / "report.html"
    with browser.Browser() as tab:
        tab.size(width, 800)
        tab.open(page)
        assert tab.run("document.documentElement.scrollWidth") <= width
        shown = "[...document.images].every(each => each.complete && each.naturalWidth > 0 && each.width <= window.innerWidth)"
        assert tab.run(shown)
        assert tab.run("document.images.length") == 11
        assert tab.complaints == []
        assert [each for each in tab.requests if not each.startswith("data:")] == [page.as_uri()]


# ---- stopped and gone on with ----------------------------------------------------------------------


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("verb", "stop"), [(REPRODUCE, 2), (COMPARE, 5)])
def test_ctrl_c_loses_nothing(
    verb: list[str],
    stop: int,
    told: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    interrupted_at(stop, monkeypatch)
    out = tmp_path / "out"
    assert cli.main([*verb, "--out", str(out), "-q"]) == 130
    assert "give the same command again" in capsys.readouterr().err
    assert not (out / "summary.json").exists()
    assert Study.load(out / "study").status().done == stop
    assert {path.name for path in (out / "study").iterdir()} >= {STORE, "manifest.json"}

    monkeypatch.undo()
    for number in range(stop):  # what was done is not done again
        interrupted_at(number, monkeypatch, AssertionError)
    assert cli.main([*verb, "--out", str(out), "-q"]) == 0
    for name in ("summary.json", "claims.csv" if verb is REPRODUCE else "comparison.csv"):
        assert (out / name).read_bytes() == (told[verb[0]] / name).read_bytes()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("verb", "drawing", "late"),
    some([(REPRODUCE, "write_reproduction", False), (COMPARE, "write_comparison", True)], 2),
)
def test_ctrl_c_while_drawing_loses_no_task(
    verb: list[str],
    drawing: str,
    late: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    module = "page" if late else "reproduction" if verb is REPRODUCE else "comparison"
    monkeypatch.setattr(f"inscrutable.reports.{module}.{'write_page' if late else drawing}", stopped)
    assert cli.main([*verb, "--out", str(tmp_path), "-q"]) == 130
    assert "All tasks are stored. To go on: give the same command again" in capsys.readouterr().err
    assert Study.load(tmp_path / "study").status().left == 0
    monkeypatch.undo()
    for number in range(4):
        interrupted_at(number, monkeypatch, AssertionError)
    assert cli.main([*verb, "--out", str(tmp_path), "-q"]) == 0, "no task is done again"
    assert (tmp_path / "report.html").exists()
    with pytest.raises(AssertionError):  # once all is written, the same command begins anew
        cli.main([*verb, "--out", str(tmp_path), "-q", "-v"])


def test_what_is_whole_or_of_another_plan_is_begun_anew(tmp_path: Path) -> None:
    seen: list[int] = []

    def done(settings: ReproductionSettings) -> Reproduction:
        seen.clear()
        return reproduce(settings, jobs=1, folder=tmp_path, progress=lambda done, total: seen.append(done))

    assert len(done(SETTINGS).runs) == 4
    first = (tmp_path / STORE).read_bytes()
    assert len(done(SETTINGS).runs) == 4
    assert seen == [1, 2, 3, 4]
    assert (tmp_path / STORE).read_bytes() != first, "durations differ"
    more = ReproductionSettings(steps=2, markets=5, **EFFORT)
    assert len(done(more).runs) == 5
    assert json.loads((tmp_path / "manifest.json").read_text("utf-8"))["study"]["markets"] == 5


def test_an_unfinished_run_of_other_settings_is_set_aside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    interrupted_at(2, monkeypatch)
    with pytest.raises(KeyboardInterrupt):
        reproduce(SETTINGS, jobs=1, folder=tmp_path)
    monkeypatch.undo()
    stopped = (tmp_path / STORE).read_bytes()
    assert len(reproduce(SETTINGS.model_copy(update={"markets": 5}), folder=tmp_path).runs) == 5
    assert (tmp_path / BEFORE).read_bytes() == stopped
    assert "held an unfinished run of other settings" in caplog.text
    caplog.clear()
    reproduce(SETTINGS, jobs=1, folder=tmp_path)
    assert (tmp_path / BEFORE).read_bytes() == stopped, "a finished one makes room"
    assert caplog.text == ""
    for place, settings in ((1, SETTINGS), (0, SETTINGS.model_copy(update={"markets": 5}))):
        later = (tmp_path / STORE).read_bytes()
        interrupted_at(place, monkeypatch)
        with pytest.raises(KeyboardInterrupt):
            reproduce(settings, jobs=1, folder=tmp_path)
        monkeypatch.undo()
    assert (tmp_path / BEFORE).read_bytes() == stopped, "the rows of the first run stay"
    assert (tmp_path / "before-2.sqlite").read_bytes() == later
    assert "its rows are now in before-2.sqlite" in caplog.text


def test_another_study_in_the_folder_is_left_alone(tmp_path: Path) -> None:
    run_study(Study.of(SMALL), tmp_path, limit=1)
    before = (tmp_path / STORE).read_bytes()
    with pytest.raises(InputError, match="holds another study, 'small'"):
        reproduce(SETTINGS, jobs=1, folder=tmp_path)
    assert (tmp_path / STORE).read_bytes() == before
    os.truncate(tmp_path / STORE, 5000)
    with pytest.raises(InputError, match="damaged"):
        reproduce(SETTINGS, jobs=1, folder=tmp_path)


@pytest.mark.parametrize("folder", [None, "study"])
def test_a_task_that_fails_is_an_error(folder: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hopeless = MarketLaw(means=(0.5, 0.6))
    rows = Study.of(ReproductionSettings(law=hopeless, markets=2, **EFFORT))
    place = None if folder is None else tmp_path / folder
    monkeypatch.setattr("inscrutable.experiments.random_markets._MOST_DRAWS", 50)
    with pytest.raises(ModelError, match="50 draws had no optimal cost above 0"):
        all_rows(rows, place)

    def broken(self: MarketRunner, task: object) -> dict[str, float]:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr(MarketRunner, "figures", broken)
    with pytest.raises(Exception, match="unexpected ZeroDivisionError: oh"):
        all_rows(Study.of(SETTINGS), place)


# ---- files ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('name = "a"\nkind = "reproducton"\n', "line 2, key kind: unknown 'reproducton'; did you mean reproduction?"),
        ('kind = "comparison"\nname = "a"\nbudgets = [0.5]\nmarkt = "paper"\n', "line 4, .*did you mean market?"),
        ('kind = "comparison"\nname = "a"\nbudgets = [0.5, 0.2]\n', "key budgets: should be numbers that rise, got "),
        ('kind = "comparison"\nname = "a"\nbudgets = 0.5\ndecision_makers = ["XDM"]\n', "no decision maker 'XDM'"),
        (SHIPPED.replace("assets = 3", "assets = 1"), "key law.assets: .*greater than or equal to 2"),
        (SHIPPED.replace("assets = 3", "asets = 3"), "key law.asets: there is no such key; did you mean assets?"),
    ],
)
def test_mistakes_in_a_file_are_named(text: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError, match=told):
        Study.read(path)


numbers = st.floats(allow_nan=False) | st.integers(-(2**40), 2**40)
names = st.text("abc d", min_size=1)


@given(st.dictionaries(names, numbers | st.lists(st.floats(allow_nan=False), min_size=1, max_size=3), min_size=1))
def test_flat_tables_give_back_what_they_were_made_of(data: dict[str, object]) -> None:
    found = unflat(dict(flat({key: np.array(each) if isinstance(each, list) else each for key, each in data.items()})))
    assert {key: each.tolist() if isinstance(each, np.ndarray) else each for key, each in found.items()} == data


MODEL = """
[constraints]
sectors = "sectors.csv"
sector_cap = 0.8
[regimes]
names = ["calm", "wild"]
assets = ["A", "B"]
transition = [[0.9, 0.1], [0.2, 0.8]]
means_file = "means.csv"
covariances = [[[0.01, 0.0], [0.0, 0.01]], [[0.04, 0.0], [0.0, 0.02]]]
"""


@pytest.mark.parametrize("edited", ["sectors.csv", "means.csv", "model.toml", "of limits.csv"])
def test_a_comparison_knows_whether_a_file_that_it_names_was_edited(tmp_path: Path, edited: str) -> None:
    sectors = "asset,sector\nA,one\nB,two\n"
    files = {
        "sectors.csv": sectors,
        "of limits.csv": sectors,
        "means.csv": "regime,A,B\ncalm,0.02,0.01\nwild,-0.03,0.0\n",
        "model.toml": MODEL,
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    limits = LimitsPart(sectors=str(tmp_path / "of limits.csv"), sector_cap=0.7)

    def identity() -> str | None:
        study = comparison_study(
            ComparisonSettings(budgets=(0.5,), repeats=(1,)),
            ["ODM"],
            market=str(tmp_path / "model.toml"),
            resolution=6,
            seed=0,
            limits=limits,
        )
        return study.data_hash

    before = identity()
    assert before == identity()
    (tmp_path / edited).write_text(files[edited].replace("0.02", "0.021").replace("two", "one"))
    assert before != identity()


def test_a_file_of_sectors_lies_beside_the_study_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another one of this name in the current folder is not read."""
    text = 'kind = "comparison"\nname = "c"\nbudgets = [0.5]\nresolution = 3\ndecision_makers = ["ODM"]\n'
    found = []
    for folder, sectors in (("own", "aab"), ("current", "baa")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "sectors.csv").write_text(
            "asset,sector\n" + "".join(f"asset{k},{name}\n" for k, name in enumerate(sectors))
        )
    (tmp_path / "own" / "c.toml").write_text(text + '[limits]\nsectors = "sectors.csv"\nsector_cap = 0.6\n')
    for folder in ("own", "current"):
        monkeypatch.chdir(tmp_path / folder)
        study = run_study(Study.read(tmp_path / "own" / "c.toml"), tmp_path / f"run in {folder}")
        found.append((study.data_hash, study.frame().to_csv()))
    assert found[0] == found[1]
