"""The verb views: what it prints and writes, and which errors have which exit code."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from inscrutable import AlphaProblem, FactorRisk, cli_console, implied_views
from inscrutable.cli import main

ASSETS = ["Food", "Oil", "Gas"]
SPREAD = pd.DataFrame([[0.04, 0.01, 0.0], [0.01, 0.02, 0.005], [0.0, 0.005, 0.09]], ASSETS, ASSETS)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    SPREAD.to_csv(tmp_path / "covariance.csv")
    SPREAD.loc[ASSETS[::-1], ASSETS[::-1]].to_csv(tmp_path / "turned.csv")
    pd.DataFrame([[0.5, 0.3, 0.2], [0.6, 0.4, 0.0]], ["May", "June"], ASSETS).to_csv(tmp_path / "weights.csv")
    rng = np.random.default_rng(0)
    dates = pd.date_range("2001-01-31", periods=40, freq="ME")
    pd.DataFrame(rng.normal(0.0, 0.05, size=(40, 3)), dates, ASSETS).to_csv(tmp_path / "returns.csv")
    return tmp_path


def asked(folder: Path, *more: str, weights: str = "weights.csv", risk: str = "covariance") -> list[str]:
    return ["views", "--weights", str(folder / weights), f"--{risk}", str(folder / f"{risk}.csv"), *more]


def test_the_table_and_the_files_say_what_the_library_says(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder / "said"
    assert main(asked(folder, "--risk-aversion", "2", "--out", str(out))) == 0
    printed = capsys.readouterr().out
    assert "one view explains the weights" in printed
    table = pd.read_csv(out / "views.csv")
    told = 4.0 * SPREAD.to_numpy() @ [0.5, 0.3, 0.2]
    np.testing.assert_allclose(table[table["portfolio"] == "May"]["least"], told, rtol=1e-12)
    assert {path.name for path in out.iterdir()} == {
        "views.csv",
        "views.png",
        "views.svg",
        "summary.json",
        "files.json",
    }


def test_a_sum_of_one_that_is_not_asked_for_is_a_caution(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    half = pd.read_csv(folder / "weights.csv", index_col=0) * 0.5
    half.to_csv(folder / "half.csv")
    for weights, held in (("weights.csv", "anything"), ("weights.csv", "long-only"), ("half.csv", "anything")):
        assert main(asked(folder, "--risk-aversion", "2", "--held", held, weights=weights)) == 0
        printed = " ".join(capsys.readouterr().out.split())
        said.append("Caution: these weights sum to one" in printed)
        assert ("sum to one determine no expected return by itself" in printed) == (held == "long-only")
    assert said == [True, False, False]
    (folder / "four.csv").write_text("month,Food,Oil,Gas\nMay,0.3333,0.3333,0.3333\n")
    assert main(asked(folder, "--risk-aversion", "2", "--held", "long-only", weights="four.csv")) == 3
    assert "rounded weights need --digits, here --digits 4" in capsys.readouterr().err
    (folder / "short.csv").write_text("month,Food,Oil,Gas\nMay,0.7,0.5,-0.2\n")
    assert main(asked(folder, "--risk-aversion", "2", "--held", "long-only", weights="short.csv")) == 3
    assert "--digits" not in capsys.readouterr().err


def test_files_that_cannot_be_meant_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Percentages whose digits would hide that nothing explains them; a covariance that is not symmetric."""
    (pd.read_csv(folder / "weights.csv", index_col=0) * 100.0).to_csv(folder / "percent.csv")
    more = ("--risk-aversion", "2", "--held", "long-only", "--reference", "portfolio")
    assert main(asked(folder, *more, "--digits", "2", weights="percent.csv")) == 3
    assert "row May: weights is outside" in (said := capsys.readouterr().err)
    assert "these are percentages: divide them by 100" in said
    (pd.read_csv(folder / "weights.csv", index_col=0) + 0.004).to_csv(folder / "rounded.csv")
    assert main(asked(folder, *more, "--digits", "2", weights="rounded.csv")) == 0
    skew = SPREAD.copy()
    skew.loc["Food", "Oil"] = 0.02
    skew.to_csv(folder / "covariance.csv")
    assert main(asked(folder, *more)) == 3
    assert "covariance.csv is not symmetric: Food, Oil is 0.02, but Oil, Food is 0.01" in capsys.readouterr().err


def test_json_and_other_orders_of_assets(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    more = ("--risk-aversion", "2", "--held", "long-only", "--reference", "Oil", "--regret", "5bp", "--json")
    assert main(asked(folder, *more)) == 0
    first = capsys.readouterr().out
    (folder / "turned.csv").replace(folder / "covariance.csv")
    assert main(asked(folder, *more)) == 0
    assert capsys.readouterr().out == first
    june = json.loads(first)["portfolios"]["June"]
    assert june["status"] == "the views under which the weights are within the regret are a convex set"
    assert june["regret"] == pytest.approx(0.0005)
    assert june["assets"]["Oil"] == {"least": 0.0, "greatest": 0.0}
    assert june["assets"]["Gas"]["least"] == "-Infinity"


def test_factors_of_returns(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    more = ("--factors", "1", "--risk-aversion", "3", "--json")
    assert main(asked(folder, *more, risk="returns")) == 0
    told = json.loads(capsys.readouterr().out)["portfolios"]["May"]["assets"]
    returns = pd.read_csv(folder / "returns.csv", index_col=0)
    risk = FactorRisk.from_returns(returns, 1)
    np.testing.assert_allclose(np.diag(risk.dense()), returns.var(), rtol=1e-12)
    values, vectors = np.linalg.eigh(returns.cov())
    common = values[-1] * np.outer(vectors[:, -1], vectors[:, -1])
    off = ~np.eye(3, dtype=bool)
    np.testing.assert_allclose(risk.dense()[off], common[off], rtol=1e-9)
    views = implied_views(AlphaProblem(risk, 3.0), [0.5, 0.3, 0.2])
    assert [told[name]["least"] for name in ASSETS] == pytest.approx(views.bounds[:, 0].tolist())


def test_prices_are_the_returns_between_their_rows(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    returns = pd.read_csv(folder / "returns.csv", index_col=0)
    prices = 80.0 * (1.0 + returns).cumprod()
    prices.to_csv(folder / "prices.csv")
    prices.pct_change().iloc[1:].to_csv(folder / "returns.csv")
    told = []
    for risk in ("prices", "returns"):
        assert main(asked(folder, "--factors", "1", "--risk-aversion", "3", "--json", risk=risk)) == 0
        assets = json.loads(capsys.readouterr().out)["portfolios"]["May"]["assets"]
        told.append([assets[name]["least"] for name in ASSETS])
    assert told[0] == pytest.approx(told[1], rel=1e-9)
    both = asked(folder, "--risk-aversion", "3", "--returns", str(folder / "returns.csv"), risk="prices")
    assert main(both) == 2
    assert "--prices FILE" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "code", "said"),
    [
        (("--risk-aversion", "0"), 3, "--risk-aversion must be above 0"),
        (("--risk-aversion", "1", "--reference", "Tin"), 3, "--reference: no asset is called 'Tin'"),
        (("--risk-aversion", "1", "--regret", "5bp", "--digits", "2"), 2, "not both"),
        (("--risk-aversion", "1", "--factors", "2"), 2, "--factors belongs to --returns"),
        (("--risk-aversion", "1", "--regret", "few"), 2, "is not a number"),
        (("--risk-aversion", "1", "--held", "long-only", "--cap", "0.3"), 4, "no decision satisfies all constraints"),
        (("--risk-aversion", "1", "--held", "long-only", "--cap", "0.5"), 3, "outside the feasible set"),
    ],
)
def test_bad_input_has_its_exit_code(
    folder: Path, capsys: pytest.CaptureFixture[str], more: tuple[str, ...], code: int, said: str
) -> None:
    assert main(asked(folder, *more)) == code
    assert said in capsys.readouterr().err


def test_bad_files_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = SPREAD.rename(index={"Gas": "Tin"}, columns={"Gas": "Tin"})
    other.to_csv(folder / "covariance.csv")
    assert main(asked(folder, "--risk-aversion", "1")) == 3
    weights, covariance = folder / "weights.csv", folder / "covariance.csv"
    expected = f"{weights} and {covariance} have other labels: only in {weights}: Gas; only in {covariance}: Tin"
    assert expected in capsys.readouterr().err
    bent = SPREAD.copy()
    bent.loc["Food", "Oil"] = bent.loc["Oil", "Food"] = 0.5
    bent.to_csv(folder / "covariance.csv")
    assert main(asked(folder, "--risk-aversion", "1")) == 3
    said = capsys.readouterr().err
    assert "bad data" in said
    assert "smallest eigenvalue -0.4" in said
    (folder / "weights.csv").write_text("month,Food,Oil,Gas\nMay,0.5,,0.2\n")
    assert main(asked(folder, "--risk-aversion", "1")) == 3
    assert "weights.csv, line 2, column 'Oil': missing (empty cell)" in " ".join(capsys.readouterr().err.split())
    (folder / "weights.csv").write_text("month,Food,Oil,Gas\nMay,0.5,0.3,0.2\nJune,50%,30%,20%\n")
    assert main(asked(folder, "--risk-aversion", "1")) == 3
    said = " ".join(capsys.readouterr().err.split())
    assert "line 3, column 'Food': found '50%', expected a number; write a percentage as a fraction" in said


def test_weights_that_look_rounded_are_remarked_on(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def remarks(*more: str) -> list[str]:
        assert main(asked(folder, "--risk-aversion", "2", "--held", "long-only", *more, "--json")) == 0
        return json.loads(capsys.readouterr().out)["remarks"]

    for weights in ([[0.51, 0.29, 0.2], [0.6, 0.4, 0.0]], [[0.51, 0.29, 0.2]]):
        pd.DataFrame(weights, ["May", "June"][: len(weights)], ASSETS).to_csv(folder / "weights.csv")
        (said,) = remarks()
        assert "written with 2 decimals and read as exact" in said
        assert "--digits 2" in said
        assert remarks("--digits", "2") == remarks("--regret", "1bp") == []
    for weights in ([0.51, 0.29 - 1e-8, 0.2 + 1e-8], [0.0, 1.0, 0.0]):
        pd.DataFrame([weights], ["May"], ASSETS).to_csv(folder / "weights.csv")
        assert remarks() == []


def test_fractions_over_a_cap_are_no_percentages(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where nothing fixes the sum, hundredths of any weights are within a cap."""
    for size, said in ((1.0, False), (100.0, True)):
        (pd.read_csv(folder / "weights.csv", index_col=0) * size).to_csv(folder / "sized.csv")
        assert main(asked(folder, "--risk-aversion", "2", "--cap", "0.6", weights="sized.csv")) == (3 if said else 0)
        assert ("these are percentages" in capsys.readouterr().err) == said
        assert main(asked(folder, "--risk-aversion", "2", "--cap", "0.4", weights="sized.csv")) == 3
        err = capsys.readouterr().err
        assert "<= 0.4" in err
        assert "these are percentages" not in err


def test_percentages_are_remarked_on(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pd.DataFrame([[50, 30, 20.0], [0.6, 0.4, 0.0]], ["May", "June"], ASSETS).to_csv(folder / "weights.csv")
    assert main(asked(folder, "--risk-aversion", "2")) == 0
    assert "The weights of May add up to 100 in size" in " ".join(capsys.readouterr().out.split())


def test_returns_in_per_cent_are_remarked_on(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    returns = pd.read_csv(folder / "returns.csv", index_col=0)
    assert main(asked(folder, "--risk-aversion", "3", risk="returns")) == 0
    assert not caplog.text
    (0.4 * np.sign(returns)).to_csv(folder / "returns.csv")  # percentages of what moves little
    assert main(asked(folder, "--risk-aversion", "3", risk="returns")) == 0
    assert "if they are percentages, divide them by 100" in caplog.text


def test_weights_without_a_column_of_labels_are_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pd.DataFrame([[0.5, 0.3, 0.2]], columns=ASSETS).to_csv(folder / "bare.csv", index=False)
    assert main(asked(folder, "--risk-aversion", "2", weights="bare.csv")) == 3
    said = " ".join(capsys.readouterr().err.split())
    assert f"the first column of the weights is the asset {ASSETS[0]}, expected dates or labels" in said


@pytest.mark.parametrize("risk", ["covariance", "returns"])
def test_weights_that_lack_an_asset_are_named_first(
    folder: Path, capsys: pytest.CaptureFixture[str], risk: str
) -> None:
    (folder / "two.csv").write_text("month,Food,Oil\nMay,0.6,0.4\n")
    assert main(asked(folder, "--risk-aversion", "2", weights="two.csv", risk=risk)) == 3
    said = capsys.readouterr().err
    assert f"{folder / 'two.csv'} and {folder / f'{risk}.csv'} have other labels: only in" in said
    assert "Gas" in said


@pytest.mark.parametrize(
    ("weights", "digits"), [("0.7,0.31,-0.01", "2"), ("0.7,0.33,-0.03", "1"), ("0.51,0.5,-0.01", "2")]
)
def test_a_short_position_is_no_rounding(
    folder: Path, capsys: pytest.CaptureFixture[str], weights: str, digits: str
) -> None:
    (folder / "short.csv").write_text(f"month,Food,Oil,Gas\nMay,{weights}\n")
    more = ("--risk-aversion", "2", "--held", "long-only", "--reference", "portfolio")
    assert main(asked(folder, *more, weights="short.csv")) == 3
    assert "--digits" not in capsys.readouterr().err
    assert main(asked(folder, *more, "--digits", digits, weights="short.csv")) == 3
    short = weights.split(",")[2]
    assert f"row May: the weight of Gas is {short}, and a weight from 0 to" in capsys.readouterr().err


def test_a_weight_at_its_rounded_cap_is_read(folder: Path) -> None:
    (folder / "capped.csv").write_text("month,Food,Oil,Gas\nMay,0.34,0.33,0.33\n")
    more = ("--risk-aversion", "2", "--held", "long-only", "--reference", "portfolio", "--digits", "2")
    assert main(asked(folder, *more, "--cap", "0.335", weights="capped.csv")) == 0
    assert main(asked(folder, *more, "--cap", "0.334", weights="capped.csv")) == 3


def test_weights_that_nothing_explains_are_no_solution(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Zeros may be up to .005 and none below zero, so that a sum of 1.01 is no rounding of 1."""
    (folder / "none.csv").write_text("month,Food,Oil,Gas\nMay,1.01,0.0,0.0\n")
    (folder / "some.csv").write_text("month,Food,Oil,Gas\nMay,1.01,0.0,0.0\nJune,0.5,0.5,0.0\n")
    more = ("--risk-aversion", "2", "--held", "long-only", "--reference", "portfolio", "--digits", "2")
    out = folder / "out"
    assert main(asked(folder, *more, "--out", str(out), weights="none.csv")) == 4
    assert f"{folder / 'none.csv'}: no expected returns explain any" in capsys.readouterr().err
    assert not out.exists()
    assert main(asked(folder, *more, weights="some.csv")) == 0
    assert "No view explains the weights of May." in capsys.readouterr().out


def test_a_table_that_a_terminal_has_no_room_for_goes_on_below(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli_console, "results", lambda: Console(width=40, highlight=False))
    numbers = [f"{value:.3f} [0.123, 0.987]" for value in (0.25, 0.5)]
    frame = pd.DataFrame(dict.fromkeys(("calm", "normal", "wild"), numbers), index=["first row", "second row"])
    cli_console.show_table(frame, "Estimates")
    shown = capsys.readouterr().out
    assert "…" not in shown
    assert max(map(len, shown.splitlines())) <= 40
    assert [shown.count(text) for text in (numbers[0], "second row", "Estimates", "wild")] == [3, 3, 1, 1]
