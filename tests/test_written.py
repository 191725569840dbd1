"""Files of an earlier run do not stay among new ones, and files of others do."""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import cli
from inscrutable.datasets import replace_files
from inscrutable.experiments.backtest import BacktestSettings, run_backtest
from inscrutable.reports.backtest import warnings_of
from sizes import audited
from small_runs import coarse_rivals


def files(folder: Path, *names: str, text: str = "1") -> list[Path]:
    for name in names:
        (folder / name).write_text(text)
    return [folder / name for name in names]


def test_only_own_files_that_nobody_changed_are_deleted(tmp_path: Path) -> None:
    replace_files(tmp_path, "backtest", files(tmp_path, "a.csv", "b.csv", "c.csv", "d.csv"))
    replace_files(tmp_path, "attack", files(tmp_path, "attack.csv"))
    files(tmp_path, "b.csv", text="edited")
    files(tmp_path, "mine.txt")
    (tmp_path / "d.csv").unlink()
    removed = replace_files(tmp_path, "backtest", files(tmp_path, "a.csv"))
    assert removed == [tmp_path / "c.csv"]
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"a.csv", "b.csv", "mine.txt", "attack.csv", "files.json"}


@pytest.mark.usefixtures("undrawn")
def test_no_command_replaces_the_summary_of_another(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "w.csv").write_text("month,A,B\n2020-01,0.5,0.5\n")
    (tmp_path / "S.csv").write_text("asset,A,B\nA,0.04,0.01\nB,0.01,0.02\n")
    replace_files(tmp_path, "backtest", files(tmp_path, "summary.json", "table.csv"))
    command = [
        "views",
        "--weights",
        "w.csv",
        "--covariance",
        "S.csv",
        "--risk-aversion",
        "5",
        "--digits",
        "4",
        "--quiet",
    ]
    command = [str(tmp_path / each) if each.endswith(".csv") else each for each in command]
    assert cli.main([*command, "--out", str(tmp_path)]) == 3
    assert "has the results of backtest, whose summary.json views would replace" in capsys.readouterr().err
    assert (tmp_path / "summary.json").read_text() == "1"
    for _ in range(2):  # its own it replaces
        assert cli.main([*command, "--out", str(tmp_path / "views")]) == 0
    (tmp_path / "summary.json").unlink()
    for _ in range(2):  # and one that is gone, or changed since, is nobody's
        assert cli.main([*command, "--out", str(tmp_path)]) == 0


@pytest.mark.parametrize(
    "text", ["", "[1]", "{", '{"backtest": 3}', '{"backtest": {"../outside.txt": "x", "sub/x": 1}}']
)
def test_a_list_that_is_none_of_ours_deletes_nothing(text: str, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    files(tmp_path, "outside.txt")
    (folder / "files.json").write_text(text)
    assert replace_files(folder, "backtest", files(folder, "a.csv")) == []
    assert (tmp_path / "outside.txt").exists()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.usefixtures("coarse", "undrawn")
def test_a_run_with_other_settings_leaves_none_of_its_files_and_strict_doubts_beliefs_that_rest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("inscrutable.reports.page.can_write_pages", lambda: False)
    rng = np.random.default_rng(0)
    months = pd.date_range("2001-01", periods=64, freq="ME", name="month")
    moves = 0.01 + np.repeat([0.01, 0.05, 0.02, 0.06], 16)[:, None] * rng.normal(size=(64, 2))
    pd.DataFrame(moves, index=months, columns=["A", "B"]).to_csv(tmp_path / "returns.csv")
    pd.DataFrame({"calm": 0.9, "turbulent": 0.1}, index=months).to_csv(tmp_path / "beliefs.csv")
    out = tmp_path / "out"
    command = [
        "backtest",
        "--returns",
        str(tmp_path / "returns.csv"),
        "--train-until",
        "2005-12",
        "--out",
        str(out),
        "--no-sequential",
        "-q",
    ]
    assert cli.main([*command, "--regimes", "3"]) == 0
    files(out, "mine.txt")
    assert (out / "month.png").exists()
    resting = ["--regimes", "2", "--beliefs", str(tmp_path / "beliefs.csv")]
    assert cli.main([*command, *resting, "--strict"]) == 4
    said = capsys.readouterr()
    assert "Doubtful: the belief hardly moves over the 4 decisions" in said.out
    assert "inscrutable: doubtful: the belief hardly moves" in said.err
    left = {path.name for path in out.iterdir()}
    assert not left & {"month.png", "month.svg"}
    assert {"mine.txt", "table.csv", "model.json", "summary.json", "files.json"} <= left
    assert "hardly moves" in json.loads((out / "summary.json").read_text("utf-8"))["doubts"][0]


@pytest.mark.usefixtures("coarse")
def test_a_backtest_of_a_fit_that_is_no_result_says_so() -> None:
    rng = np.random.default_rng(1)
    months = pd.date_range("2001-01", periods=78, freq="ME")
    returns = pd.DataFrame(rng.normal(0.01, 0.05, size=(78, 24)), index=months, columns=[f"A{j}" for j in range(24)])
    settings = BacktestSettings(regimes=3, train_until="2007-03", covariance="sample", sequential=False)
    with nullcontext() if audited() else coarse_rivals(10):
        found = run_backtest(returns, settings, restarts=1)
        other = run_backtest(returns, replace(settings, covariance=None), restarts=1)
    assert found.doubts
    assert found.doubts[0].startswith(("the fit collapsed in the one of 1 starts", "the fit follows its sample"))
    assert "1,800 numbers" in found.doubts[0]
    assert warnings_of(found)[0] == f"Doubtful: {found.doubts[0]}."
    assert other.fit.covariance == "ledoit-wolf"
