"""The command line as a person and a shell meet it: exit codes, streams, files, interruption."""

from __future__ import annotations

import ctypes
import json
import os
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import inscrutable
from inscrutable import cli
from inscrutable.budgets import Budget
from inscrutable.cli_interrupts import interrupts_kept
from inscrutable.cli_values import UsageError, budget_of, measure_of
from inscrutable.errors import InputError, SolverError
from inscrutable.privacy import DesiredObfuscation, NonUniqueness
from small_runs import short_searches
from test_attack import market, published

Said = tuple[int, str, str]
COMMAND = [sys.executable, "-m", "inscrutable"]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]):  # type: ignore[no-untyped-def]
    """Run the command line in this process: exit code, stdout, stderr."""

    def call(*arguments: object) -> Said:
        code = cli.main([str(each) for each in arguments])
        said = capsys.readouterr()
        return code, said.out, said.err

    return call


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, weights, beliefs and returns."""
    place = tmp_path_factory.mktemp("files")
    model = market(30, 4)
    model.save(place / "model.json")
    beliefs = np.random.default_rng(30).dirichlet(np.ones(3), size=2)
    published(model, beliefs, 3).to_csv(place / "weights.csv", index_label="row")
    dates = pd.date_range("2001-01", periods=2, freq="ME", name="date")
    pd.DataFrame(beliefs, index=dates, columns=list(model.regimes)).to_csv(place / "beliefs.csv")
    rng = np.random.default_rng(31)
    spread = np.repeat([0.01, 0.05, 0.02], 20)[:, None]
    months = pd.date_range("2001-01", periods=60, freq="ME", name="date")
    returns = pd.DataFrame(0.01 + spread * rng.normal(size=(60, 2)), index=months, columns=["A", "B"])
    returns.to_csv(place / "returns.csv")
    (100 * (1 + returns).cumprod()).to_csv(place / "prices.csv")
    return place


def protecting(folder: Path, *more: object) -> tuple[object, ...]:
    return ("protect", "--model", folder / "model.json", "--belief", "0.2,0.3,0.5", "--seed", 1, *more)


def attacking(folder: Path, *more: object) -> tuple[object, ...]:
    return ("attack", "--model", folder / "model.json", "--weights", folder / "weights.csv", *more)


def is_one_clear_message(err: str) -> bool:
    """One message on stderr: a single line, beside a hint, and no traceback."""
    lines = [line for line in err.splitlines() if line.startswith("inscrutable: ")]
    return len(lines) == 1 and "Traceback" not in err


# ---- help, version, usage ------------------------------------------------------------------------


@pytest.mark.parametrize("verb", ["reproduce", "backtest", "protect"])
@pytest.mark.parametrize("seed", ["-1", "x"])
def test_a_seed_that_is_none_is_wrong_usage_everywhere(run, folder: Path, verb: str, seed: str) -> None:  # type: ignore[no-untyped-def]
    more = ("--model", folder / "model.json", "--belief", "0.2,0.3,0.5") if verb == "protect" else ()
    code, out, err = run(verb, *more, "--seed", seed)
    assert (code, out) == (cli.USAGE, "")
    assert is_one_clear_message(err)
    assert "--seed" in err


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"]])
def test_help_lists_the_verbs(run, arguments: list[str]) -> None:  # type: ignore[no-untyped-def]
    code, out, err = run(*arguments)
    assert (code, err) == (0, "")
    for verb in ("reproduce", "backtest", "attack", "protect"):
        assert verb in out
    assert "Exit codes" in out


@pytest.mark.parametrize("verb", ["reproduce", "backtest", "attack", "protect"])
def test_each_verb_explains_itself(run, verb: str) -> None:  # type: ignore[no-untyped-def]
    code, out, _ = run(verb, "--help")
    assert code == 0
    for option in ("--out", "--json", "--quiet", "-q", "--verbose"):
        assert option in out
    # Paragraphs have the width of the terminal: a line ends where the next word has no room.
    about = [line.rstrip() for line in out.partition("╭")[0].splitlines()]
    width = max(map(len, out.splitlines()))
    assert all(len(line) + len(after.split()[0]) >= width for line, after in pairwise(about) if line and after)


def test_version(run) -> None:  # type: ignore[no-untyped-def]
    assert run("--version") == (0, f"{inscrutable.__version__}\n", "")


def test_help_loads_nothing_heavy() -> None:
    code = "import sys; from inscrutable.cli import main; main(['--help']); print([m for m in {} if m in sys.modules])"
    heavy = ("numpy", "pandas", "numba", "scipy", "matplotlib", "pydantic")
    done = subprocess.run([sys.executable, "-c", code.format(heavy)], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nonsense"], "nonsense"),
        (["attack"], "--model"),
        (["protect", "--budget", "-5%"], "A value that begins with a minus is written --budget=-5%"),
        (["attack", "--modle", "x"], "--modle"),
        (["backtest", "--regimes", "three"], "three"),
        (["backtest", "--regimes", "2.5"], '"2.5" into a whole number'),
        (["backtest", "--measure", "other"], "other"),
        (["backtest", "--measure", "desired"], "needs --target"),
        (["backtest", "--target", "reverse"], "belongs to --measure desired"),
        (["backtest", "--budget", "cheap"], "'cheap': expected a share of |c*|"),
        (["backtest", "--budget", "euro:3"], "regret:0.002"),
        (["backtest", "--returns", "a.csv", "--daily"], "exclude one another"),
        (["protect", "--model", "m.json"], "give one of"),
        (["protect", "--model", "m.json", "--belief", "0.5,x", "--weights", "w"], "give one of"),
        (["protect", "--model", "m.json", "--belief", "0.5,x"], "'x' is not a number"),
        (["protect", "--model", "m", "--belief", "1,0", "--certify", "2"], "relative gap"),
        (["protect", "--model", "m", "--belief", "1,0", "--certify", ".1", "--measure", "infeasibility"], "proves"),
    ],
)
def test_wrong_usage_is_two(run, arguments: list[str], message: str) -> None:  # type: ignore[no-untyped-def]
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert message in err
    verb = "" if arguments == ["nonsense"] else f"{arguments[0]} "
    assert f"Try: inscrutable {verb}--help" in err
    assert is_one_clear_message(err)


@pytest.mark.parametrize("verb", ["compare", "disclose"])
@pytest.mark.parametrize("flag", ["--market", "--model"])
def test_the_file_of_a_backtest_has_one_name_in_all_commands(run, verb: str, flag: str) -> None:  # type: ignore[no-untyped-def]
    code, out, err = run(verb, flag, "nothing.json")
    assert (code, out) == (3, "")
    assert "nothing.json cannot be read" in err


@pytest.mark.parametrize("verb", ["compare", "disclose"])
def test_help_names_both_kinds_of_models(run, verb: str) -> None:  # type: ignore[no-untyped-def]
    _, out, _ = run(verb, "--help")
    assert "a model.toml of your own with regimes" in " ".join(out.replace("│", " ").split())


def test_values_of_the_command_line() -> None:
    assert budget_of("0.1") == Budget.relative(0.1)
    assert budget_of("regret:0.002") == Budget.regret(0.002)
    assert isinstance(measure_of("non-uniqueness", None), NonUniqueness)
    turned = measure_of("desired", "reverse")
    assert isinstance(turned, DesiredObfuscation)
    assert turned.target_for(np.array([0.2, 0.3, 0.5])).tolist() == [0.5, 0.3, 0.2]
    with pytest.raises(UsageError):
        measure_of("maximal", "reverse")
    with pytest.raises(InputError, match="at least 0"):
        budget_of("-1")


# ---- attack and protect --------------------------------------------------------------------------


@pytest.mark.usefixtures("undrawn")
def test_attack_prints_results_and_writes_files(run, folder: Path, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    code, out, err = run(*attacking(folder, "--out", tmp_path / "new" / "a"))
    assert code == 0
    assert "near-optimal" in out
    assert "2 of 2 rows are explained" in out
    assert "Rows read: 2 of 2" in err
    listed = re.findall(r"^  (.+)$", out[out.index("Written:") :], re.M)
    assert sorted(Path(each).name for each in listed) == sorted(
        each.name for each in (tmp_path / "new" / "a").iterdir()
    )


@pytest.mark.usefixtures("undrawn")
def test_protect_says_what_to_publish(run, folder: Path, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    code, out, _ = run(*protecting(folder, "--budget", "regret:0.0004", "--out", tmp_path))
    assert code == 0
    for word in ("publish this", "atom 1", "draw", "observer: regime 1", "knows your budget", "publish.csv"):
        assert word in out
    once = json.loads((tmp_path / "summary.json").read_text())
    assert once["rows"][0]["regret"] <= 0.0004 * (1 + 1e-9)
    assert once["budget"] == "regret of 0.0004"


@pytest.mark.parametrize("source", ["--beliefs", "--weights"])
def test_protect_reads_beliefs_and_weights(run, folder: Path, source: str) -> None:  # type: ignore[no-untyped-def]
    path = folder / f"{source[2:]}.csv"
    code, out, _ = run(
        "protect", "--model", folder / "model.json", source, path, "--measure", "desired", "--target", "reverse"
    )
    assert code == 0
    assert "on average over 2 rows" in out.lower()


def test_json_is_alone_on_stdout_and_the_same_again(run, folder: Path) -> None:  # type: ignore[no-untyped-def]
    for arguments in (attacking(folder), protecting(folder)):
        code, out, err = run(*arguments, "--json")
        assert code == 0
        assert json.loads(out)["regimes"] == ["regime 1", "regime 2", "regime 3"]
        assert err
        assert run(*arguments, "--json", "-q") == (0, out, "")


def test_quiet_is_quiet_but_not_about_errors(run, folder: Path) -> None:  # type: ignore[no-untyped-def]
    code, out, err = run(*attacking(folder, "--quiet"))
    assert (code, err) == (0, "")
    assert out
    code, out, err = run("attack", "--model", folder / "none.json", "--weights", folder / "weights.csv", "-q")
    assert (code, out) == (3, "")
    assert "none.json" in err


# ---- bad data, no solution, folders ---------------------------------------------------------------


BAD_WEIGHTS = {
    "empty": ("", "is empty"),
    "text": ("A0,A1,A2,A3\n0.25,x,0.25,0.25\n", "line 2, column 'A1': found 'x'"),
    "column missing": ("A0,A1,A2\n0.5,0.25,0.25\n", "missing asset: 'A3'"),
    "column twice": ("A0,A1,A1,A3\n0.5,0.25,0.25,0\n", "'A1' is duplicated"),
    "sum": ("A0,A1,A2,A3\n0.500,0.250,0.250,0.100\n", "weights sum to 1.1"),
    "short": ("row,A0,A1,A2,A3\nx,1.200,-0.200,0,0\n", "weight of A1 >= 0"),
}


@pytest.mark.parametrize("case", BAD_WEIGHTS)
def test_bad_weights_are_three(run, folder: Path, tmp_path: Path, case: str) -> None:  # type: ignore[no-untyped-def]
    content, message = BAD_WEIGHTS[case]
    path = tmp_path / "w.csv"
    path.write_text(content)
    out_folder = tmp_path / "out"
    code, out, err = run("attack", "--model", folder / "model.json", "--weights", path, "--out", out_folder, "-q")
    assert (code, out) == (3, "")
    assert message in err
    assert is_one_clear_message(err)
    assert not out_folder.exists() or not list(out_folder.iterdir())


BAD_RETURNS = {
    "text": ("date,A,B\n2001-01,0.01,x\n", "column 'B': found 'x'"),
    "missing date": ("date,A,B\n2001-01,0.01,0.02\n,0.01,0.02\n", "line 3"),
    "column twice": ("date,A,A\n2001-01,0.01,0.02\n", "'A' is duplicated"),
    "empty": ("", "is empty"),
    "short": (
        "date,A,B\n" + "".join(f"2001-{month:02d},0.01,0.0{month}\n" for month in range(1, 7)),
        "regimes of 2 assets need",
    ),
    "shorter": ("date,A,B\n2001-01,0.01,0.02\n2001-02,0.01,0.02\n2001-03,0.01,0.02\n", "need at least 2"),
}


@pytest.mark.parametrize("case", BAD_RETURNS)
def test_bad_returns_are_three(run, tmp_path: Path, case: str) -> None:  # type: ignore[no-untyped-def]
    content, message = BAD_RETURNS[case]
    path = tmp_path / "r.csv"
    path.write_text(content)
    code, out, err = run("backtest", "--returns", path, "--out", tmp_path / "out", "-q")
    assert (code, out) == (3, "")
    assert message in err
    assert is_one_clear_message(err)
    assert not (tmp_path / "out").exists() or not list((tmp_path / "out").iterdir())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--belief", "0.2,0.3,0.6"], "--belief sums to 1.1"),
        (["--belief", "0.5,0.5"], "--belief has 2 entries"),
        (["--belief", ",".join(["0.01"] * 100)], "--belief has 100 entries"),  # longer than a file's name may be
        (["--belief", "0.2,0.3,0.5", "--budget", "-1"], "--budget must be at least 0"),
        (["--belief", "0.2,0.3,0.5", "--measure", "desired", "--target", "0.5,0.6"], "--target sums to 1.1"),
        (["--beliefs", "nowhere.csv"], "nowhere.csv does not exist"),
    ],
)
def test_bad_beliefs_are_three(run, folder: Path, arguments: list[str], message: str) -> None:  # type: ignore[no-untyped-def]
    code, out, err = run("protect", "--model", folder / "model.json", *arguments)
    assert (code, out) == (3, "")
    assert message in err
    assert is_one_clear_message(err)


def test_no_solution_is_four(run, folder: Path, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    data = json.loads((folder / "model.json").read_text())
    data["problem"]["constraints"]["b_eq"] = [-1.0]
    path = tmp_path / "impossible.json"
    path.write_text(json.dumps(data))
    code, out, err = run("protect", "--model", path, "--belief", "0.2,0.3,0.5")
    assert (code, out) == (4, "")
    assert "no decision satisfies all constraints" in err
    assert str(path) in err
    assert is_one_clear_message(err)


@pytest.mark.parametrize("verb", ["attack", "protect", "backtest", "reproduce"])
def test_an_unwritable_folder_is_found_before_the_work(  # type: ignore[no-untyped-def]
    run, folder: Path, tmp_path: Path, verb: str
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    arguments = {
        "attack": attacking(folder),
        "protect": protecting(folder),
        "backtest": ("backtest",),
        "reproduce": ("reproduce",),
    }[verb]
    start = time.monotonic()
    code, out, err = run(*arguments, "--out", blocked / "out", "-q")
    assert (code, out) == (3, "")
    assert "cannot be written" in err
    assert time.monotonic() - start < 10.0
    assert blocked.read_text() == "in the way"


def test_failures_are_one_line_unless_more_is_asked_for(  # type: ignore[no-untyped-def]
    run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(error: Exception):  # type: ignore[no-untyped-def]
        def fail(*_: object, **__: object) -> None:
            raise error

        return fail

    name = "inscrutable.experiments.attack.attack_weights"
    monkeypatch.setattr(name, broken(SolverError("did not converge")))
    code, _, err = run(*attacking(folder, "-q"))
    assert code == 1
    assert "did not converge" in err
    monkeypatch.setattr(name, broken(RuntimeError("a slip")))
    code, _, err = run(*attacking(folder, "-q"))
    assert code == 1
    assert "unexpected RuntimeError: a slip" in err
    assert is_one_clear_message(err)
    with pytest.raises(RuntimeError, match="a slip"):
        cli.main([str(each) for each in attacking(folder, "-v")])


# ---- backtest and reproduce -----------------------------------------------------------------------


@pytest.mark.usefixtures("undrawn", "coarse", "unpaged")
def test_backtest_then_attack_then_protect(run, folder: Path, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    out_folder = tmp_path / "b"
    common = ("--regimes", 2, "--budget", "0.2", "--no-sequential", "--out", out_folder)
    code, out, err = run("backtest", "--prices", folder / "prices.csv", *common, "--train-until", "2005-06")
    assert code == 0
    assert "earns the return of month t+1" in out
    assert "Without protection: from the optimal weights, an observer names" in out
    assert "model.json" in out
    assert "Decisions:" in err
    model = out_folder / "model.json"
    code, out, _ = run("attack", "--model", model, "--weights", out_folder / "weights_CDM.csv", "--json", "-q")
    assert code == 0
    assert json.loads(out)["readings"]["implausible"] == 0
    code, out, _ = run("protect", "--model", model, "--belief", "0.4,0.6", "--json", "-q")
    assert json.loads(out)["budget"] == "0.2 of |c*|"
    beliefs = out_folder / "beliefs.csv"
    code, out, err = run("backtest", "--returns", folder / "returns.csv", "--beliefs", beliefs, *common, "--json", "-q")
    assert code == 3, "those beliefs do not cover a training sample that ends in the middle"
    assert "beliefs lack" in err
    named = folder / "named.csv"
    named.write_text(beliefs.read_text().replace("turbulent", "bear").replace("calm", "bull"))
    given = ("backtest", "--prices", folder / "prices.csv", "--beliefs", named, *common, "--train-until", "2005-06")
    code, _, err = run(*given)
    assert code == 3
    assert "bull" in err
    assert "turbulent" in err
    code, _, err = run(*given, "--regime-names", "bull,bear")
    assert code == 0
    assert "bull is calm, bear is turbulent" in err


@pytest.mark.audit  # test_whole_studies.py reads what the same command writes
@pytest.mark.usefixtures("undrawn", "unpaged")
def test_reproduce_judges_the_claims(run, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    sizes = ("--markets", 2, "--simulations", 2, "--steps", 2, "--resolution", 5, "--jobs", 1)
    with short_searches():
        code, out, _ = run("reproduce", *sizes, "--out", tmp_path, "-q")
    assert code == 0
    assert "claims over 2 random markets" in out
    assert "Caution: 2 markets are few" in out
    assert len(json.loads((tmp_path / "summary.json").read_text())["cautions"]) == 1
    assert (tmp_path / "claims.csv").is_file()
    assert json.loads((tmp_path / "summary.json").read_text())


# ---- a real process -------------------------------------------------------------------------------


def test_a_process_reports_its_exit_code() -> None:
    """One that is known before anything heavy is imported; the others are what `main` returns, above."""
    done = subprocess.run([*COMMAND, "attack", "--modle", "x"], capture_output=True, text=True)
    assert done.returncode == cli.USAGE
    assert done.stdout == ""
    assert is_one_clear_message(done.stderr)


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_an_interrupted_run_says_so_and_leaves_nothing_half_written(tmp_path: Path) -> None:
    out_folder = tmp_path / "out"
    process = subprocess.Popen(
        [*COMMAND, "backtest", "--out", out_folder], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    first = process.stderr.readline()
    assert "fitting 3 regimes" in first
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert "interrupted" in err
    assert "Traceback" not in err
    assert not out_folder.exists()


@pytest.mark.parametrize("fails", [False, True])
def test_an_interrupt_that_c_code_swallows_still_ends_the_command(
    fails: bool, run, monkeypatch: pytest.MonkeyPatch
) -> None:  # type: ignore[no-untyped-def]
    @ctypes.CFUNCTYPE(None)
    def called_from_c() -> None:
        raise KeyboardInterrupt

    def command(*_: object, **__: object) -> None:
        called_from_c()
        if fails:
            raise RuntimeError("half a compilation")
        time.sleep(30)

    monkeypatch.setattr(cli, "app", command)
    monkeypatch.setattr(command, "resolved_commands", dict, raising=False)
    code, out, err = run("reproduce")
    assert (code, out) == (130, "")
    assert "interrupted" in err
    assert "Traceback" not in err


def test_what_else_python_cannot_raise_is_still_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda lost: shown.append(lost.exc_value))

    @ctypes.CFUNCTYPE(None)
    def called_from_c() -> None:
        raise ValueError("lost")

    with interrupts_kept() as interrupts:
        called_from_c()
    assert [str(each) for each in shown] == ["lost"]
    assert not interrupts.lost
    assert not interrupts.caused(ValueError())


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_a_reader_that_stops_early_is_no_crash(folder: Path) -> None:
    command = [str(each) for each in (*COMMAND, *attacking(folder, "-q"))]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    err = process.stderr.read()
    process.wait(timeout=60)
    assert "Traceback" not in err
    process.stderr.close()


def test_a_run_that_fails_leaves_no_empty_folder(tmp_path):
    out = tmp_path / "results"
    assert cli.main(["backtest", "--train-until", "2099-01", "--out", str(out), "-q"]) == 3
    assert not out.exists()


def test_an_empty_value_is_refused(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    """An unset variable of a shell: an empty path would be the current folder."""
    monkeypatch.chdir(tmp_path)
    code, out, err = run("backtest", "--out", "")
    assert (code, out) == (cli.USAGE, "")
    assert "--out has an empty value" in err
    assert not list(tmp_path.iterdir())
