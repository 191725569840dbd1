"""Studies as they are run: the same rows however they are run, nothing lost by a kill, clear words where a disk fails."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from inscrutable import (
    Budget,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    StackelbergDecisionMaker,
    Study,
    action_grid,
    cli,
    consistent_beliefs,
    decoy_grid,
    leakage,
    mechanism,
    resume_study,
    run_study,
    uniform_prior,
)
from inscrutable.decision_makers import LinearProgramme
from inscrutable.errors import InputError, SolverError
from inscrutable.experiments.backtest import RESTARTS
from inscrutable.experiments.measures import MEASURES
from inscrutable.experiments.random_markets import random_market
from inscrutable.experiments.studies import StudyProgress, executors, runner
from inscrutable.experiments.studies.executors import Chunks
from inscrutable.experiments.studies.grid_tasks import GridRunner
from inscrutable.experiments.studies.store import LOCK, STORE, VERSION, Store, locked, speaking
from inscrutable.experiments.studies.tasks import DONE, FAILED, Row, Work, chunk_of_rows
from inscrutable.reports.page import write_page
from sizes import instances, some
from study_runs import SMALL, deadly, environment, killed, table

TALKATIVE = (
    "import sys; from inscrutable import cli, cli_console; cli_console._SECONDS_BETWEEN_LINES = 0; sys.exit(cli.main())"
)

ROOT = Path(__file__).resolve().parent.parent
PLAN = json.dumps(SMALL)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """The small study, run without disturbance."""
    return run_study(Study.of(SMALL), tmp_path_factory.mktemp("whole"))


@pytest.fixture
def copy(whole: Study, tmp_path: Path) -> Path:
    """A copy of its folder."""
    assert whole.folder is not None
    return Path(shutil.copytree(whole.folder, tmp_path / "copy"))


def small(**changes: object) -> Study:
    return Study.of(SMALL | changes)


def test_every_task_has_one_row(whole: Study) -> None:
    frame = whole.frame(durations=True)
    assert list(frame.index) == list(range(whole.n_tasks))
    assert frame["task"].is_unique
    assert frame["seed"].is_unique
    assert (frame["status"] == DONE).all()
    assert frame["duration"].gt(0).all()
    assert np.isfinite(frame[list(SMALL["measures"])]).all(axis=None)
    assert whole.status().left == 0
    assert "small: 56 of 56 tasks done, 0 failed" in whole.summary()


def test_figures_are_those_of_the_library(tmp_path: Path) -> None:
    """The same mechanism built by hand, on the market that the task's stream draws."""
    plan = SMALL | {
        "repeats": 2,
        "beliefs": {"kind": "grid", "resolution": [3, 4]},
        "candidates": {"kind": "actions", "resolution": 6},
        "decision_makers": ["ODM", "PDM"],
        "adversaries": ["bayesian"],
    }
    study = run_study(Study.of(plan), tmp_path)
    frame = study.frame()
    for repeat, resolution in ((0, 3), (1, 4)):
        prior, some_rows = uniform_prior(3, resolution), frame[frame["beliefs.resolution"] == resolution]
        rng = study.grid.stream("world", (0, 0, 0, 0, repeat, 0, 0), ("world", "repeat"))
        problem = random_market(rng=rng).problem
        candidates = action_grid(problem, 6)
        makers = {
            ("ODM", None): OriginalDecisionMaker(problem),
            ("PDM", 0.1): ProbabilisticDecisionMaker(problem, None, Budget.relative(0.1), candidates=candidates),
            ("PDM", 0.3): ProbabilisticDecisionMaker(problem, None, Budget.relative(0.3), candidates=candidates),
        }
        for (name, budget), maker in makers.items():
            told = leakage(mechanism(maker, prior.beliefs), prior, problem)
            rows = some_rows[(some_rows["decision_maker"] == name) & (some_rows["repeat"] == repeat)]
            row = rows.iloc[0] if budget is None else rows[rows["budget"] == budget].iloc[0]
            found = row[["error", "expected_regret", "mutual_information"]].astype(float)
            assert_allclose(
                found, [told.bayes_error, told.expected_regret, told.mutual_information], rtol=1e-12, atol=1e-15
            )


def test_equal_spending_is_equal(tmp_path: Path) -> None:
    study = small(
        repeats=1,
        beliefs={"kind": "grid", "resolution": 4},
        decision_makers=["PDM", "uniform", "exponential", "coin", "rate-distortion", "Stackelberg", "rounding"],
        budgets={"unit": "silence", "hold": "mean", "values": [0.4]},
        measures=["silence_share"],
        adversaries=["naive", "near-optimal", "budget-aware", "bayesian"],
    )
    frame = run_study(study, tmp_path).frame()
    spent = frame.groupby("decision_maker")["silence_share"].first()
    equal = ["PDM", "exponential", "coin", "rate-distortion", "Stackelberg"]
    assert_allclose(spent[equal], 0.4, rtol=1.5e-6)
    assert_allclose(spent["uniform"], 0.4, rtol=0.01)  # a choice more at one belief leaps
    assert np.all(spent <= 0.4 * (1.0 + 1e-12))


def test_no_budget_in_expectation_is_exceeded(tmp_path: Path) -> None:
    """The cheapest candidates cost 2 % of the silence regret: no noise on them is as cheap as the first two budgets."""
    market = {"means": [[0.01, 0.02], [0.03, -0.02]], "covariances": [[[0.01, 0.0], [0.0, 0.02]]] * 2}
    study = small(
        repeats=1,
        world={"kind": "given"} | market,
        beliefs={"kind": "grid", "resolution": 4},
        candidates={"resolution": 6},
        decision_makers=["exponential", "Dirichlet noise", "rounding", "uniform", "coin"],
        budgets={"unit": "silence", "hold": "mean", "values": [1e-6, 0.01, 0.5]},
        measures=["silence_share"],
        adversaries=["naive"],
    )
    frame = run_study(study, tmp_path).frame()
    assert np.all(frame["silence_share"] <= frame["budget"] * (1.0 + 1e-12))
    most = frame[frame["budget"] == 0.5].set_index("decision_maker")["silence_share"]
    assert_allclose(most[["exponential", "coin"]], 0.5, rtol=1.5e-6)


def test_a_budget_that_no_noise_spends_is_met_from_below(tmp_path: Path) -> None:
    """Market 14 of 15 cannot spend it: steps that grow until the amount of noise overflowed failed there."""
    plan = SMALL | {"repeats": 15, "decision_makers": [SMALL["decision_makers"][-1]], "adversaries": ["naive"]}
    study = Study.of(plan | {"budgets": {"values": [0.3]}})
    frame = run_study(study, tmp_path).frame()
    assert (frame["status"] == "done").all(), frame["failure"].unique()
    assert (frame["expected_regret"] > 0.0).all()


def test_aware_mechanisms_and_searches_among_candidates_alone(tmp_path: Path) -> None:
    """Each budget per belief, built by hand: by enumeration, the paper's programme, and the library's own Stackelberg."""
    plan = SMALL | {
        "repeats": 1,
        "beliefs": {"kind": "grid", "resolution": 3},
        "candidates": {"resolution": 5},
        "decision_makers": [
            {"name": "CDM", "method": "candidates"},
            {"name": "PDM", "method": ["global", "candidates"]},
            {"name": "Stackelberg", "gap": 0.001},
        ],
        "budgets": {"values": 0.3},
        "adversaries": "bayesian",
        "measures": ["error", "naive_privacy", "expected_regret"],
    }
    study = run_study(Study.of(plan), tmp_path)
    cdm, pdm, mixed, hidden = (row for _, row in study.frame().iterrows())
    rng = study.grid.stream("world", (0, 0, 0, 0, 0, 0, 0), ("world", "repeat"))
    problem, prior = random_market(rng=rng).problem, uniform_prior(3, 3)
    candidates, budget = decoy_grid(problem, 5), Budget.relative(0.3)

    best = []
    for belief in prior.beliefs:
        limit = 0.3 * abs(float(problem.optimal_cost(belief)))
        affordable = [u for u in candidates.actions if float(problem.regret(belief, u)) <= limit]
        best.append(max([0.0, *(consistent_beliefs(problem, u).distance(belief) for u in affordable)]))
    assert cdm["naive_privacy"] == pytest.approx(np.mean(best), abs=1e-7)

    programme = ProbabilisticDecisionMaker(problem, None, budget, candidates=candidates, method=LinearProgramme())
    expected = np.asarray(programme.decide_many(prior.beliefs).expected_privacy)
    assert mixed["naive_privacy"] == pytest.approx(expected.mean(), abs=1e-6)
    assert pdm["naive_privacy"] >= mixed["naive_privacy"] - 1e-9

    maker = StackelbergDecisionMaker(problem, budget, prior=prior, candidates=candidates, gap=0.001)
    assert hidden["error"] == pytest.approx(np.sqrt(maker.value), rel=1e-6)
    assert hidden["error"] >= max(cdm["error"], pdm["error"], mixed["error"]) - 1e-3


def test_two_processes_give_the_same_bytes(whole: Study, tmp_path: Path) -> None:
    seen: list[StudyProgress] = []
    other = run_study(Study.of(SMALL), tmp_path / "two", jobs=2, progress=seen.append)
    for study in (whole, other):
        assert (
            cli.main(["study", "export", str(study.folder), "--out", str(tmp_path / f"{study is other}.csv"), "-q"])
            == 0
        )
    assert (tmp_path / "True.csv").read_bytes() == (tmp_path / "False.csv").read_bytes()
    assert seen[0].fresh == 0
    assert (seen[-1].done, seen[-1].total, seen[-1].failed, seen[-1].seconds_left) == (56, 56, 0, 0.0)
    assert [each.done for each in seen] == sorted(each.done for each in seen)


@pytest.mark.audit  # three sets of worker processes are started
def test_a_killed_worker_loses_no_row_but_of_a_task_that_no_worker_survives(
    whole: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "chunk_of_rows", partial(deadly, tmp_path))
    monkeypatch.setattr(executors, "_LOSSES", 2)
    other = run_study(Study.of(SMALL), tmp_path / "out", jobs=2).frame()
    assert (tmp_path / "once").exists()
    assert other.status[3] == FAILED
    assert "were lost each time" in other.failure[3]
    assert other.drop(index=3).equals(whole.frame().drop(index=3))
    monkeypatch.undo()
    assert table(resume_study(tmp_path / "out", retry=True)) == table(whole)


def test_the_command_line_speaks_of_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With two processes, whose end says nothing more; then a file, and whatever else the system refuses."""
    plan, out = tmp_path / "study.toml", tmp_path / "out"
    plan.write_text(toml_of(SMALL), "utf-8")
    full = OSError(errno.ENOSPC, "No space left on device")

    def add(self: Store, rows: object) -> None:
        with speaking(self.folder):
            error = sqlite3.OperationalError("database or disk is full")
            error.sqlite_errorcode = sqlite3.SQLITE_FULL
            raise error

    with monkeypatch.context() as patch:
        patch.setattr(Store, "add", add)
        assert cli.main(["study", "run", str(plan), "--out", str(out), "--jobs", "2"]) == 3
    told = capsys.readouterr().err
    assert "inscrutable: disk: " in told
    assert "database or disk is full; the rows stored before are kept" in told
    assert f"To go on: inscrutable study resume {out}" in told

    def broken(*_: object) -> None:
        raise full

    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", broken)
        assert cli.main(["study", "export", str(out)]) == 3
    assert "disk: " in capsys.readouterr().err
    monkeypatch.setattr("inscrutable.experiments.studies.Study.load", broken)
    assert cli.main(["study", "status", str(out)]) == 3
    assert "inscrutable: disk: [Errno" in capsys.readouterr().err


def test_worker_processes_that_never_start_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def lost_at_once(jobs: int, work: Work, chunks: Chunks, keep: Callable[[list[Row]], None]) -> None:
        next(iter(chunks))

    monkeypatch.setattr(executors, "_through_joblib", lost_at_once)
    monkeypatch.setattr(executors, "_follow", os._exit)
    monkeypatch.setattr(executors, "_LOSSES", 2)
    with pytest.raises(SolverError, match="lost 2 times"):
        run_study(Study.of(SMALL), tmp_path, jobs=2)
    assert Study.load(tmp_path).status().failed == 0


@pytest.mark.audit
def test_four_processes_give_the_same_bytes(whole: Study, tmp_path: Path) -> None:
    other = run_study(Study.of(SMALL), tmp_path / "four", jobs=4)
    for study in (whole, other):
        out = tmp_path / f"{study is other}.csv"
        assert cli.main(["study", "export", str(study.folder), "--out", str(out), "-q"]) == 0
    assert (tmp_path / "True.csv").read_bytes() == (tmp_path / "False.csv").read_bytes()


def test_the_order_of_tasks_and_what_was_done_before_change_nothing(whole: Study, tmp_path: Path) -> None:
    grid = whole.grid
    work = Work(GridRunner, whole.plan.model_dump_json(), None, "[]")
    backwards = chunk_of_rows(work, reversed(range(0, len(grid), 7)))
    runners = [GridRunner(work) for _ in backwards]
    alone = [runner.row_of(runner.done(row.number)) for row, runner in zip(backwards, runners, strict=True)]
    stored = whole.frame()
    for row, other in zip(backwards, alone, strict=True):
        assert row._replace(duration=0) == other._replace(duration=0)
        assert json.loads(row.figures)["error"] == stored.loc[row.number, "error"]


def test_killed_at_any_moment_and_resumed_it_has_the_same_rows(whole: Study, tmp_path: Path) -> None:
    """Within a transaction, and in `make audit` at a random moment; every process is killed before it ends."""
    moment = float(np.random.default_rng(0).uniform(0.0, 0.3))
    for place in some((("transaction", 2.0), ("moment", moment)), 2):
        assert killed(*place, tmp_path, PLAN) == -signal.SIGKILL
    before = Study.load(tmp_path).status()
    assert 0 < before.done < before.total
    assert table(resume_study(tmp_path)) == table(whole)


def test_a_limited_run_is_spread_and_can_be_gone_on_with(whole: Study, tmp_path: Path) -> None:
    part = run_study(Study.of(SMALL), tmp_path, limit=10)
    assert part.frame()["repeat"].nunique() == 4
    assert part.status().left == 46
    assert table(resume_study(tmp_path, limit=1000)) == table(whole)


def test_what_is_left_is_said_with_how_to_do_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan, out = tmp_path / "study.toml", tmp_path / "out"
    plan.write_text(toml_of(SMALL | {"repeats": 1}), "utf-8")
    assert cli.main(["study", "run", str(plan), "--out", str(out), "--limit", "3"]) == 0
    assert f"To do the others: inscrutable study resume {out}" in capsys.readouterr().err
    assert cli.main(["study", "resume", str(out)]) == 0
    assert "To do the others" not in capsys.readouterr().err
    assert cli.main(["study", "resume", str(plan)]) == 3
    assert "study.toml is a file, expected a folder" in capsys.readouterr().err


def test_a_task_that_fails_is_a_row_and_the_others_are_done(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = tmp_path / "study.toml"
    plan.write_text(
        'name = "a"\nrepeats = 2\ndecision_makers = ["ODM", "uniform"]\n[world]\nkind = "random"\n'
        "[problem]\nmin_weight = [0.1, 0.5]\n[beliefs]\nkind = 'grid'\nresolution = 3\n[candidates]\nresolution = 3\n"
    )
    out = tmp_path / "out"
    assert cli.main(["study", "run", str(plan), "--out", str(out)]) == 1
    said = capsys.readouterr()
    assert "4 of 8 tasks done, 4 failed, 0 left" in said.out
    assert "4 failed" in said.err
    assert "ModelError: no decision satisfies all constraints" in said.err
    frame = Study.load(out).frame()
    assert (frame["status"] == np.where(frame["problem.min_weight"] == 0.5, FAILED, DONE)).all()
    assert frame.loc[frame["status"] == FAILED, "failure"].str.startswith("ModelError").all()
    assert cli.main(["study", "resume", str(out), "-q"]) == 1
    seen: list[StudyProgress] = []
    again = resume_study(out, retry=True, progress=seen.append)
    assert seen[-1].asked == 4
    assert table(again) == frame.to_csv(lineterminator="\n")


def test_an_unexpected_error_is_a_failed_row_too(whole: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    runner = GridRunner(Work(GridRunner, whole.plan.model_dump_json(), None, "[]"))

    def broken(places: tuple[int, ...]) -> None:
        raise ZeroDivisionError("oh")

    monkeypatch.setattr(runner, "observed", broken)
    row = runner.row_of(runner.done(0))
    assert (row.status, row.error, row.figures) == (FAILED, "unexpected ZeroDivisionError: oh", "{}")


@pytest.mark.parametrize("part", ["done", "row_of"])
def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(
    whole: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], part: str
) -> None:
    plan = tmp_path / "study.toml"
    plan.write_text(toml_of(SMALL), "utf-8")
    one = getattr(GridRunner, part)
    tasks = iter(range(41))

    def interrupted(self: GridRunner, which: Any) -> Any:
        if next(tasks) == 40:
            raise KeyboardInterrupt
        return one(self, which)

    monkeypatch.setattr(GridRunner, part, interrupted)
    out = tmp_path / "out"
    assert cli.main(["study", "run", str(plan), "--out", str(out)]) == 130
    assert f"inscrutable study resume {out}" in capsys.readouterr().err
    assert Study.load(out).status().done == 40
    monkeypatch.undo()
    assert table(resume_study(out)) == table(whole)


def toml_of(plan: dict[str, object]) -> str:
    """Plain data as TOML with inline tables."""

    def text(value: object) -> str:
        if isinstance(value, dict):
            return "{" + ", ".join(f"{key} = {text(each)}" for key, each in value.items()) + "}"
        if isinstance(value, list):
            return "[" + ", ".join(text(each) for each in value) + "]"
        return json.dumps(value)

    return "\n".join(f"{key} = {text(value)}" for key, value in plan.items())


def test_a_second_run_into_the_same_folder_is_refused(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (copy / STORE).read_bytes()
    with pytest.raises(InputError, match="holds this study already: go on with"):
        run_study(Study.of(SMALL), copy)
    with pytest.raises(InputError, match="holds another study, 'small', or this one with other settings"):
        run_study(Study.of(SMALL | {"repeats": 3}), copy)
    with locked(copy):
        with pytest.raises(InputError, match="another process runs this study"):
            resume_study(copy)
        assert Study.load(copy).status().left == 0  # reading is possible meanwhile
    assert (copy / STORE).read_bytes() == before
    assert cli.main(["study", "resume", str(copy), "-q"]) == 0


def test_the_lock_of_another_process_holds_until_it_ends(copy: Path) -> None:
    code = (
        "import sqlite3, sys; c = sqlite3.connect(sys.argv[1], isolation_level=None); c.execute('BEGIN EXCLUSIVE');"
        "print('held', flush=True); sys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(copy / LOCK)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(InputError, match="in use"):
            resume_study(copy)
        other.kill()
    assert resume_study(copy).status().left == 0


@pytest.mark.parametrize(("version", "age"), [(VERSION - 1, "an older"), (VERSION + 1, "a newer")])
def test_a_store_of_another_version_is_left_alone(copy: Path, version: int, age: str) -> None:
    with closing(sqlite3.connect(copy / STORE)) as connection:
        connection.execute(f"PRAGMA user_version = {version}")
    before = (copy / STORE).read_bytes()
    for use in (Study.load, resume_study):
        with pytest.raises(InputError, match=f"{age} release"):
            use(copy)
    assert (copy / STORE).read_bytes() == before
    assert cli.main(["study", "status", str(copy)]) == 3


@pytest.mark.parametrize("left", [0, 50, 1000, 4096, 9000])
def test_a_truncated_store_is_refused_and_left_as_it_is(copy: Path, left: int) -> None:
    os.truncate(copy / STORE, left)
    for use in (lambda: run_study(Study.of(SMALL), copy), lambda: resume_study(copy), lambda: Study.load(copy).frame()):
        with pytest.raises(InputError, match=r"damaged|already"):
            use()
        assert (copy / STORE).stat().st_size == left


def test_a_store_with_a_spoilt_page_is_refused(copy: Path) -> None:
    size = (copy / STORE).stat().st_size
    with (copy / STORE).open("r+b") as file:
        file.seek(size // 2 // 4096 * 4096)
        file.write(b"\x07" * 4096)
    with pytest.raises(InputError, match="damaged"):
        resume_study(copy)


@pytest.mark.parametrize(
    ("change", "uses"),
    [
        ("UPDATE rows SET figures = '{x' WHERE number = 3", [lambda folder: Study.load(folder).frame()]),
        ("UPDATE facts SET value = '{x' WHERE name = 'study'", [Study.load, resume_study]),
        (
            "UPDATE facts SET value = '{x' WHERE name = 'manifest'",
            [lambda folder: Study.load(folder).manifest(), resume_study],
        ),
        ("UPDATE rows SET number = 99999 WHERE number = 3", [resume_study]),
    ],
)
def test_a_store_whose_texts_are_spoilt_is_refused(
    change: str, uses: list[Callable[[Path], object]], copy: Path
) -> None:
    with closing(sqlite3.connect(copy / STORE)) as connection:
        connection.execute(change)
        connection.commit()
    for use in uses:
        with pytest.raises(InputError, match="is damaged"):
            use(copy)


def test_going_on_with_other_versions_is_said(copy: Path, whole: Study, caplog: pytest.LogCaptureFixture) -> None:
    resume_study(copy)
    assert not caplog.records
    manifest = json.loads(json.dumps(whole.manifest()))
    manifest["versions"]["numpy"] = "1.0"
    with closing(sqlite3.connect(copy / STORE)) as connection:
        connection.execute("UPDATE facts SET value = ? WHERE name = 'manifest'", (json.dumps(manifest),))
        connection.commit()
    assert resume_study(copy).frame().equals(whole.frame())
    assert [record.getMessage() for record in caplog.records] == [
        f"inscrutable: {copy} was begun with numpy 1.0 (now {np.__version__}); new rows may differ from what those would give"
    ]


def test_all_versions_that_made_rows_are_listed(tmp_path: Path) -> None:
    begun = run_study(Study.of(SMALL), tmp_path / "study", limit=5)
    manifest = begun.manifest()
    manifest["versions"]["numpy"] = "1.0"
    with closing(sqlite3.connect(tmp_path / "study" / STORE)) as connection:
        connection.execute("UPDATE facts SET value = ? WHERE name = 'manifest'", (json.dumps(manifest),))
        connection.commit()
    for limit in (5, 5, None):
        resumed = resume_study(tmp_path / "study", limit=limit)
    assert resumed.manifest()["continued_with"] == [{"numpy": np.__version__}]
    assert json.loads((tmp_path / "study" / "manifest.json").read_text()) == resumed.manifest()
    page = write_page(resumed, tmp_path / "report.html").read_text("utf-8")
    assert f"1.0, later {np.__version__}" in page


def test_other_files_in_its_place_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no study"):
        Study.load(tmp_path)
    with closing(sqlite3.connect(tmp_path / STORE)) as connection:
        connection.execute("CREATE TABLE t (x)")
    with pytest.raises(InputError, match="another program"):
        Study.load(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        run_study(Study.of(SMALL), tmp_path / "file")
    lost = tmp_path / "lost"
    lost.mkdir()
    (lost / "manifest.json").write_text("{}")
    with pytest.raises(InputError, match="was lost"):
        run_study(Study.of(SMALL), lost)


DISKS = """
import json, os, subprocess, sys
from pathlib import Path
from inscrutable.errors import InputError
from inscrutable.experiments.studies import Study, executors, resume_study, run_study
place, plan, mounted = Path(sys.argv[1]), json.loads(sys.argv[2]), sys.argv[3] == "mounted"
executors._SECONDS = 0.01
out = place / "out"
if mounted:
    ballast = place / "ballast"
    ballast.write_bytes(bytes(350_000))
    freed = ballast.unlink
else:
    import resource
    resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, resource.RLIM_INFINITY))
    freed = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
try:
    run_study(Study.of(plan), out)
    print("no error")
except InputError as error:
    print("full:", type(error).__name__, error)
kept = Study.load(out).status()
print("kept:", kept.done, kept.left)
freed()
half = resume_study(out, limit=10)
if mounted:
    subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
    for use in (lambda: resume_study(out), lambda: run_study(Study.of(plan), place / "new")):
        try:
            use()
            print("no error")
        except InputError as error:
            print("read-only:", type(error).__name__, error)
    print("read:", Study.load(out).status().done - kept.done)
    subprocess.run(["mount", "-o", "remount,rw", str(place)], check=True)
print("rows:", json.dumps(resume_study(out).frame().to_csv(lineterminator="\\n")))
"""


def can_mount() -> bool:
    """Whether a small disk can be made for a process."""
    command = ["unshare", "-rm", "mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", "/mnt"]
    try:
        return subprocess.run(command, capture_output=True).returncode == 0
    except OSError:
        return False


def test_a_full_disk_and_a_read_only_one_lose_nothing(whole: Study, tmp_path: Path) -> None:
    """On a small disk of its own, or, where none can be mounted, with a limit on the size of files."""
    kind = "mounted" if can_mount() else "limited"
    command = [sys.executable, "-c", DISKS, str(tmp_path), PLAN, kind]
    if kind == "mounted":
        mount = 'mount -t tmpfs -o size=400k tmpfs "$1" && shift && exec "$@"'
        command = ["unshare", "-rm", "sh", "-c", mount, "sh", str(tmp_path), *command]
    run = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    said = dict(line.split(": ", 1) for line in run.stdout.splitlines() if ": " in line)
    assert "no error" not in run.stdout
    assert re.search(r"full|disk I/O", said["full"]), said["full"]
    assert said["full"].startswith("DiskError")
    assert "are kept" in said["full"]
    done, left = map(int, said["kept"].split())
    assert 0 < done < 46
    assert done + left == 56
    if kind == "mounted":
        assert "DiskError" in said["read-only"]
        assert "read" in said["read-only"]
        assert int(said["read"]) == 10
    assert json.loads(said["rows"]) == table(whole)


@pytest.mark.skipif(os.geteuid() == 0, reason="permissions do not bind the superuser; a read-only disk is tried above")
def test_a_read_only_folder_is_refused_and_can_be_read(copy: Path) -> None:
    before = table(Study.load(copy))
    copy.chmod(0o500)
    try:
        for use in (lambda: resume_study(copy), lambda: run_study(Study.of(SMALL), copy / "new")):
            with pytest.raises(InputError, match=r"cannot be (written|created|used)"):
                use()
        assert table(Study.load(copy)) == before
    finally:
        copy.chmod(0o700)


def test_the_manifest_says_all_that_is_needed(whole: Study) -> None:
    assert whole.folder is not None
    manifest = json.loads((whole.folder / "manifest.json").read_text("utf-8"))
    assert manifest == whole.manifest()
    assert (manifest["seed"], manifest["tasks"], manifest["data_sha256"]) == (7, 56, None)
    assert {"python", "inscrutable", "numpy", "scipy"} <= set(manifest["versions"])
    assert Study.of(manifest["study"]).plan == whole.plan


def test_a_study_on_a_file_of_returns_needs_it_no_more_once_begun(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    spread = np.repeat([0.01, 0.05, 0.02], 20)[:, None]
    rows = 0.01 + spread * rng.normal(size=(60, 2))
    dates = np.arange("2001-01", "2006-01", dtype="datetime64[M]")
    lines = [f"{date},{a!r},{b!r}" for date, (a, b) in zip(dates, rows.tolist(), strict=True)]
    (tmp_path / "r.csv").write_text("date,A,B\n" + "\n".join(lines) + "\n")
    (tmp_path / "s.toml").write_text(
        toml_of(
            SMALL
            | {
                "repeats": 2,
                "world": {
                    "kind": "fitted",
                    "data": "r.csv",
                    "regimes": 2,
                    "restarts": 2,
                    "covariance": ["sample", "factor:1"],
                },
                "beliefs": {"kind": "stationary", "resolution": 5},
            }
        )
    )
    study = run_study(tmp_path / "s.toml", tmp_path / "out", limit=3)
    assert study.data_hash == json.loads((tmp_path / "out" / "manifest.json").read_text())["data_sha256"]
    (tmp_path / "r.csv").unlink()
    done = resume_study(tmp_path / "out")
    assert done.status().failed == 0
    worlds = done.frame().groupby("world.covariance")["error"].mean()
    assert set(worlds.index) == {"sample", "factor:1"}
    assert worlds["sample"] != worlds["factor:1"], "each is fitted by its own estimate"


def test_a_table_is_written_whole_or_refused(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["study", "export", str(copy), "--durations"]) == 0
    text = (copy / "rows.csv").read_text("utf-8")
    assert text.splitlines()[0].endswith("duration,failure")
    assert len(text.splitlines()) == 57
    assert cli.main(["study", "export", str(copy), "--out", str(copy / "a.csv"), "--to", "parquet"]) == 2
    assert cli.main(["study", "status", str(copy), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.split("rows.csv\n")[1])["done"] == 56


def test_parquet_has_the_same_rows(copy: Path) -> None:
    import pandas as pd

    assert cli.main(["study", "export", str(copy), "--to", "parquet", "-q"]) == 0
    pd.testing.assert_frame_equal(pd.read_parquet(copy / "rows.parquet"), Study.load(copy).frame())


def test_without_pyarrow_the_other_format_is_named(
    copy: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert cli.main(["study", "export", str(copy), "--to", "parquet"]) == 3
    assert "pip install pyarrow; or export to CSV" in capsys.readouterr().err
    assert not (copy / "rows.parquet").exists()


def test_chunks_take_about_a_second_and_those_that_are_out_are_known() -> None:
    chunks = Chunks(range(20_000))
    sizes: list[int] = []
    seen: list[int] = []
    for number, chunk in enumerate(chunks):
        sizes.append(len(chunk))
        if number == 6:
            assert chunks.taken_back() == [chunk]  # the worker is lost
            seen += chunk
            continue
        seen += chunk
        chunks.came_back([Row(each, "", "", "", DONE, "{}", 0.001, "") for each in chunk])
    assert Counter(seen) == Counter(range(20_000))
    assert sizes[7] == 1
    assert 990 <= max(sizes) <= 1000
    assert chunks.taken_back() == []


ORPHANS = """
import json, os, signal, sys
from inscrutable.experiments.studies import Study, run_study
def watch(progress):
    if progress.fresh:
        from joblib.externals.loky import reusable_executor
        print(*reusable_executor._executor._processes, flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
run_study(Study.of(json.loads(sys.argv[2])), sys.argv[1], jobs=2, progress=watch)
"""


EARLY_ORPHANS = """
import json, os, signal, sys, threading, time
from inscrutable.experiments.studies import Study, run_study
def watch():
    from joblib.externals.loky import reusable_executor
    while len(found := getattr(reusable_executor._executor, "_processes", None) or ()) < 2:
        time.sleep(0.001)
    print(*found, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
threading.Thread(target=watch, daemon=True).start()
run_study(Study.of(json.loads(sys.argv[2])), sys.argv[1], jobs=2)
"""


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="asks Linux which processes are left")
@pytest.mark.audit  # every process imports the package
@pytest.mark.parametrize("script", [ORPHANS, EARLY_ORPHANS], ids=["at work", "while they start"])
def test_worker_processes_do_not_outlive_a_killed_run(script: str, tmp_path: Path) -> None:
    command = [sys.executable, "-c", script, str(tmp_path), PLAN]
    run = subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert run.stdout is not None
    workers = [int(word) for word in run.stdout.readline().split()]
    run.stdout.close()
    assert run.wait(60) == -signal.SIGKILL
    assert len(workers) == 2
    end = time.monotonic() + 60
    while any(_alive(each) for each in workers):
        assert time.monotonic() < end, "a worker is left"
        time.sleep(0.05)


def _alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_worker_processes_leave_interrupts_to_the_first_one() -> None:
    from joblib import Parallel, delayed
    from joblib.externals.loky import get_reusable_executor

    get_reusable_executor().shutdown(wait=True)  # workers of other tests hear them
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    with executors._deaf_to_interrupts():
        masks = Parallel(n_jobs=2)(delayed(signal.pthread_sigmask)(signal.SIG_BLOCK, []) for _ in range(4))
    assert all(signal.SIGINT in mask for mask in masks)
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.audit  # that workers do not hear it, and what is said and kept, is tested above
def test_an_interrupt_to_all_processes_is_told_once_and_resumed(tmp_path: Path) -> None:
    """As a terminal's Ctrl-C does, once the first rows have come."""
    file, out = tmp_path / "study.toml", tmp_path / "out"
    file.write_text(
        'name = "a"\nrepeats = 5000\ndecision_makers = ["ODM", "uniform"]\nworld = {kind = "random"}\n'
        'beliefs = {kind = "grid", resolution = 6}\ncandidates = {resolution = 6}\n',
        "utf-8",
    )
    command = [sys.executable, "-c", TALKATIVE, "study", "run", file, "--out", out, "--jobs", "2"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, start_new_session=True) as process:
        assert process.stderr is not None
        said = [process.stderr.readline() for _ in range(3)]
        os.killpg(process.pid, signal.SIGINT)
        rest = process.communicate(timeout=60)[1]
    assert said[1].startswith("Tasks: 0 of 10000 done")
    assert process.returncode == 130
    assert "Traceback" not in rest
    assert f"To go on: inscrutable study resume {out}" in rest
    assert resume_study(out, limit=1).status().done > 0


def test_bad_arguments_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    out = tmp_path / "out"
    for jobs in (0, -2, 1.5, True, 1025):
        with pytest.raises(
            InputError, match=f"jobs must be a number of processes from 1 to 1,024, or -1 .*, got {jobs}"
        ):
            run_study(Study.of(SMALL), out, jobs=jobs)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="exclude one another"):
        run_study(Study.of(SMALL), out, jobs=2, cluster="tcp://127.0.0.1:1")
    assert not out.exists()
    with pytest.raises(InputError, match="no rows yet"):
        Study.of(SMALL).frame()
    assert runner.versions()["python"]


@pytest.mark.parametrize("path", sorted(ROOT.glob("studies/*.toml")), ids=lambda path: path.stem)
def test_a_shipped_study_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A few of its tasks, spread over the grid; where the file leaves it open, a world is fitted from few starts."""
    count = instances(4, least=1)
    monkeypatch.setattr("inscrutable.experiments.studies.worlds._RESTARTS", instances(RESTARTS, least=2))
    study = run_study(path, tmp_path, limit=count)
    assert study.status().failed == 0, list(study.errors())
    assert study.status().done == count


def test_the_command_line_shows_every_key_of_a_study(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["study", "keys", "--json"]) == 0
    tables = json.loads(capsys.readouterr().out)
    top = {row["key"]: row for row in tables["At the top of the file"]}
    assert top["name"]["left out"] == "needed"
    assert top["repeats"] == {"key": "repeats", "holds": "whole number ≥ 1", "left out": "1"}
    assert {row["name"] for row in tables["Measures"]} == set(MEASURES)
    assert {"kind", "resolution"} <= {row["key"] for row in tables["[candidates]"]}
    names = [row["name"] for row in tables["[[decision_makers]]"]]
    assert names[:3] == ["ODM", "CDM", "PDM"]

    assert cli.main(["study", "keys", "rival"]) == 0
    said = capsys.readouterr().out
    assert '[rival], kind = "naming". The name of the regime; a wrong name costs 1.' in said
    assert "[world]" not in said
    assert cli.main(["study", "keys", "wurld"]) == 2
    assert "no section 'wurld'; there are top, world, problem" in capsys.readouterr().err
