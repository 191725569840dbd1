"""Values of options that cannot be meant: one message that names the option, before any work; bad files are named."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import cli
from sizes import audited, some
from small_runs import few_starts, repeated_fits
from test_odd_files import MODEL

ASSETS = ["Oil", "Food", "Tech"]
STUDY = """name = "small"
measures = ["error"]
decision_makers = ["ODM", "uniform"]
world = {kind = "random"}
beliefs = {kind = "grid", resolution = 4}
candidates = {resolution = 4}
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model, weights, returns, alphas, secrets, and a study."""
    place = tmp_path_factory.mktemp("files")
    rng = np.random.default_rng(3)
    dates = pd.date_range("2001-01", periods=80, freq="ME", name="date")
    returns = pd.DataFrame(0.005 + 0.03 * rng.normal(size=(80, 3)), dates, ASSETS)
    returns.to_csv(place / "returns.csv")
    returns.cov().to_csv(place / "covariance.csv")
    returns.iloc[:1].to_csv(place / "alphas.csv")
    pd.DataFrame([[0.5, 0.3, 0.2]], dates[:1], ASSETS).to_csv(place / "weights.csv")
    pd.DataFrame(rng.normal(size=(80, 1)), dates, ["secret"]).to_csv(place / "secrets.csv")
    pd.DataFrame(rng.normal(size=(80, 1)), dates, ["decision"]).to_csv(place / "decisions.csv")
    (place / "model.toml").write_text(MODEL.format(more=""))
    (place / "study.toml").write_text(STUDY)
    return place


VERBS = {
    "reproduce": "reproduce --out OUT",
    "compile": "compile",
    "compare": "compare --model model.toml --resolution 4 --makers CDM --out OUT",
    "disclose": "disclose --model model.toml --resolution 4 --out OUT",
    "audit": "audit --secrets secrets.csv --published decisions.csv",
    "views": "views --weights weights.csv --covariance covariance.csv",
    "history": "views --weights weights.csv --returns returns.csv --risk-aversion 5",
    "attack": "attack --model model.toml --weights weights.csv",
    "protect": "protect --model model.toml --belief 0.4,0.6",
    "alphas": "protect --alphas alphas.csv --prior-covariance covariance.csv --covariance covariance.csv",
    "backtest": "backtest --returns returns.csv --regimes 2 --no-sequential --out OUT",
    "study": "study run study.toml --out OUT",
}

# verb, options, the option that is named, and what is said of it
WRONG = [
    ("compare", "--jobs 9999999", "--jobs must be a number of processes from 1 to 1,024, or -1 for one per core, got 9999999"),
    ("compile", "--jobs 0", "--jobs must"),
    ("reproduce", "--jobs 0", "--jobs must be a number of processes from 1 to 1,024"),
    ("study", "--jobs -2", "--jobs must"),
    ("study", "--extension word", "--extension 'word': an extension is written"),
    ("reproduce", "--markets 0", "--markets: should be greater than or equal to 2, got 0"),
    ("reproduce", "--simulations=-1", "--simulations: should be"),
    ("reproduce", "--simulations 1000000000", "--simulations should be at most 10,000,000"),
    ("reproduce", "--steps 1", "--steps: should be greater than or equal to 2, got 1"),
    ("reproduce", "--resolution 0", "--resolution: should be"),
    ("reproduce", "--resolution 1000000000", "--resolution 1,000,000,000 gives"),
    ("reproduce", "--budget nan", "--budget: should be a finite number"),
    ("disclose", "--steps 1", "--steps is 1, but exact needs at least 2"),
    ("disclose", "--steps 1000000000", "--steps 1,000,000,000 is too large"),
    ("disclose", "--steps 1000000000000", "--steps 1,000,000,000,000 is too large"),
    ("disclose", "--draws 5", "--draws must be a whole number of at least 10, got 5"),
    ("disclose", "--draws 100000000000", "--draws 100,000,000,000 is too large: figures of 24 steps"),
    ("disclose", "--disclosures evry(3)", "--disclosures evry(3): there is no disclosure 'evry'"),
    ("disclose", "--disclosures exact;top(0)", "--disclosures top(0): n of top(n) must be"),
    ("disclose", "--resolution 0", "--resolution must be"),
    ("disclose", "--resolution 1000000000", "over three 108 always fits"),
    ("audit", "--lags 1000000", "--lags of up to 1000000 rows: 0 rows have"),
    ("audit", "--lags 1,1", "--lags must be whole numbers of rows, each once"),
    ("audit", "--lags 0,12", "--lags reach over 12 rows, which leaves too little"),
    ("audit", "--embargo 1000", "--embargo of 1000 rows leaves too little"),
    ("views", "--risk-aversion -5", "--risk-aversion must be above 0, got -5"),
    ("views", "--risk-aversion inf", "--risk-aversion must be finite"),
    ("views", "--risk-aversion 5 --cap nan", "--cap"),
    ("views", "--risk-aversion 5 --cap=-1", "--cap"),
    ("views", "--risk-aversion 5 --cap 30", "--cap: 30 is 30 times the portfolio; write 30%"),
    ("views", "--risk-aversion 5 --regret=-1", "--regret must be at least 0"),
    ("views", "--risk-aversion 5 --reference Tin", "--reference: no asset is called 'Tin'; expected one of the assets"),
    ("history", "--factors 1000", "--factors is 1000, expected at most 3"),
    ("alphas", "--risk-aversion 0", "--risk-aversion must be above 0"),
    ("alphas", "--risk-aversion 5 --trading-cost=-1", "--trading-cost must be at least 0"),
    ("alphas", "--risk-aversion 5 --budget=-1", "--budget must be at least 0, got -1"),
    ("compare", "--pairs 0", "--pairs: should be greater than or equal to 10, got 0"),
    ("compare", "--pairs 1000000000000", "--pairs: should be less than or equal to 10000000, got 1000000000000"),
    ("compare", "--budgets 0.2,0.1", "--budgets: should be numbers that rise"),
    ("compare", "--turnover 10%", "--turnover that is limited changes the problem"),
    ("compare", "--makers CDN", "--makers: there is no decision maker 'CDN'; did you mean"),
    ("compare", "--disclosure evry(3)", "--disclosure evry(3): there is no disclosure"),
    ("compare", "--resolution 0", "--resolution: should be"),
    ("compare", "--sector-cap 0.5", "--sector-cap and sectors go together"),
    ("compare", "--long-short 160", "--long-short: 160 is 160 times the portfolio; write 160%"),
    ("attack", "--max-weight 1.5", "--max-weight: 1.5 is 1.5 times the portfolio; write 1.5%"),
    ("attack", "--min-weight=-0.1", "--min-weight is -0.1, and weights below 0 need long_short"),
    ("attack", "--regret=regret:-1", "--regret: budget must be at least 0, got regret:-1"),
    ("protect", "--budget=-10%", "--budget must be at least 0, got -10%"),
    ("protect", "--belief 0.4,0.7", "--belief sums to 1.1, expected 1"),
    ("protect", "--turnover 10%", "bad data: the weights published last are missing, from which a limited turnover counts"),
    ("backtest", "--regimes 0", "--regimes must be"),
    ("backtest", "--budget=-5bp", "--budget must be at least 0, got -5bp"),
    ("backtest", "--sector-cap 30%", "--sector-cap and sectors go together"),
    ("backtest", "--risk-aversion 0", "--risk-aversion must be above 0"),
    ("backtest", "--cost-bps=-1", "--cost-bps must be at least 0"),
    ("backtest", "--train-until 2099-01", "--train-until is 2099-01, the returns cover"),
    ("backtest", "--train-until 01/06/1989", "--train-until is 01/06/1989, which can be read day first or month first"),
    ("backtest", "--covariance word", "--covariance"),
    ("backtest", "--disclosure evry(3)", "--disclosure evry(3): there is no disclosure"),
]  # fmt: skip


AS_READ = ("--cap", "--max-weight", "--long-short", "--regret")
"""Options whose values are checked as they are read, which is wrong usage; the library refuses the others."""


def said(files: Path, out: Path, verb: str, options: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """The exit code, and the message on one line."""
    base, *pairs = f"{VERBS[verb]} ".replace("OUT", str(out)).split(" --")
    given = options.split("=")[0].split()[0].removeprefix("--")
    words = [*base.split(), *(word for each in pairs if each.split()[0] != given for word in f"--{each}".split())]
    words += options.split()
    code = cli.main([str(files / each) if (files / each).is_file() else each for each in words])
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("inscrutable: ")]
    assert len(lines) <= 1
    return code, lines[0] if lines else ""


@pytest.mark.parametrize(("verb", "options", "message"), some(WRONG, 4), ids=lambda value: value[:40])
def test_a_wrong_value_names_its_option(
    files: Path, tmp_path: Path, verb: str, options: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, line = said(files, tmp_path / "out", verb, options, capsys)
    expected = (cli.USAGE, "usage") if message.split(":")[0] in AS_READ else (3, "bad data")
    assert (code, line.partition(": ")[2].partition(": ")[0]) == expected
    assert message in line
    assert not (tmp_path / "out" / "summary.json").exists()


def test_a_disclosure_that_hides_nothing_is_a_caution(
    files: Path, tmp_path: Path, undrawn: None, capsys: pytest.CaptureFixture[str]
) -> None:
    ask = ["disclose", "--model", str(files / "model.toml"), "--resolution", "4", "--steps", "4", "-q", "--json"]
    shown = "exact;top(300);top(1);every(2)|top(300)"
    assert cli.main([*ask, "--disclosures", shown, "--out", str(tmp_path / "out")]) == 0
    (caution,) = json.loads(capsys.readouterr().out)["cautions"]
    assert caution.startswith("Caution: top(300) hides nothing of these decisions of 3 weights")


def test_decisions_before_their_secret_are_a_caution(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ask = ["audit", "--secrets", str(files / "secrets.csv"), "--published", str(files / "decisions.csv"), "-q"]
    told = []
    for lags in ("-1", "0"):
        assert cli.main([*ask, "--lags", lags]) == 0
        told.append("at lag -1 the decision stands before its secret" in " ".join(capsys.readouterr().out.split()))
    assert told == [True, False]


# the verb, its option, the file's text, the exit code, and what is said after the file's name
BAD_FILES = [
    ("backtest", "--public", "date,a,b\n2001-01-31,1,2\n", 3, " has 2 columns of numbers, expected one"),
    ("backtest", "--public", "date,a\n2001-01-31,1\n", 3, ": public lacks 79 of 80 dates of the returns"),
    ("backtest", "--public", "CONSTANT", 3, ": public numbers do not vary in the training sample: all are 0.3"),
    ("backtest", "--public", "REPEATS", 3, ": public numbers are the returns of Oil"),
    ("backtest", "--riskless", "date,a,b\n2001-01-31,0,0\n", 3, " has 2 columns of numbers, expected one"),
    ("backtest", "--riskless", "date,a\n2001-01-31,0.001\n", 3, ": riskless lack"),
    ("backtest", "--private", "date,calm,wild\n2001-01-31,1,2\n", 3, ": private has the columns ['calm', 'wild']"),
    ("backtest", "--private", "date,calm,turbulent\n1990-01-31,1,2\n", 3, ": private has none of the dates"),
    ("backtest", "--rival", '[problem]\nkind = "finite"\ncosts = [[0, 1], [1]]\n', 3, "rows of one length, not of 2, 1"),
    ("compare", "--rival", '[problem]\nkind = "finite"\ncosts = [[0, 1], [1]]\n', 3, "rows of one length, not of 2, 1"),
    ("compare", "--rival", '[problem]\nkind = "finite"\ncosts = [[0, 1], [1, 0], [1, 1]]\n', 3, ": rival: the rival's problem"),
    ("compare", "--rival", "[problem]\nmax_weight = 0.1\n", 4, ": rival: no decision satisfies all constraints"),
]  # fmt: skip


@pytest.fixture(scope="module")
def fitted_once() -> Iterator[None]:
    """Regimes of the same returns are fitted once for all files that are looked at afterwards."""
    with nullcontext() if audited() else few_starts(2), repeated_fits():
        yield


@pytest.mark.usefixtures("fitted_once")
@pytest.mark.parametrize(("verb", "option", "text", "code", "message"), BAD_FILES)
def test_bad_data_name_their_file(
    files: Path,
    tmp_path: Path,
    verb: str,
    option: str,
    text: str,
    code: int,
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bad = tmp_path / "bad.csv"
    returns = pd.read_csv(files / "returns.csv", index_col="date")
    known = {"CONSTANT": returns[["Oil"]] * 0.0 + 0.3, "REPEATS": returns[["Oil"]]}
    bad.write_text(known[text].to_csv() if text in known else text)
    found, line = said(files, tmp_path / "out", verb, f"{option} {bad}", capsys)
    assert found == code
    assert line.partition(": ")[2].partition(": ")[2].startswith(str(bad))
    assert message in line


def test_a_refused_comparison_is_not_to_be_gone_on_with(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its first task fails, and would fail again."""
    rival = tmp_path / "rival.toml"
    rival.write_text("[problem]\nmax_weight = 0.1\n")
    ask = ["compare", "--model", str(files / "model.toml"), "--resolution", "4", "--jobs", "1", "--rival", str(rival)]
    assert cli.main([*ask, "--out", str(tmp_path / "out")]) == 4
    assert "To go on" not in capsys.readouterr().err


def test_one_figure_is_no_range(
    files: Path, tmp_path: Path, undrawn: None, unpaged: None, capsys: pytest.CaptureFixture[str]
) -> None:
    rival = tmp_path / "rival.toml"
    rival.write_text('[problem]\nkind = "finite"\ncosts = [[0, 1], [1, 0]]\n')
    ask = ["compare", "--model", str(files / "model.toml"), "--resolution", "4", "--makers", "CDM", "--jobs", "1", "-q"]
    assert cli.main([*ask, "--budgets", "0.1", "--rival", str(rival), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "is worth 0." in printed
    assert " from 0." not in printed
    assert "with an error of " in printed
