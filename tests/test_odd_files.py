"""Odd files and wrong calls: each is refused in one clear line, or read as what it says; never a traceback, never a guess."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    FiniteProblem,
    InputError,
    InscrutableError,
    MarkowitzProblem,
    MaximalObfuscation,
    OriginalDecisionMaker,
    Polyhedron,
    ProbabilisticDecisionMaker,
    consistent_beliefs,
    long_short,
    max_weights,
    simplex,
    turnover,
)
from inscrutable.budgets import written_budget
from inscrutable.cli import main
from inscrutable.datasets import (
    read_beliefs,
    read_holdings,
    read_labelled_matrix,
    read_map,
    read_returns,
    read_sectors,
    read_weights,
)
from inscrutable.experiments.attack import Reading, attack_weights
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.experiments.own_model import OwnModel, RegimesPart, investor_of
from inscrutable.experiments.silence import budget_in
from inscrutable.experiments.weight_limits import LimitsPart
from inscrutable.problems.magnitudes import MagnitudeRegion
from sizes import some

ASSETS = ["Oil", "Food", "Tech"]
MODEL = """
[investor]
budget = "5bp"
{more}
[regimes]
names = ["calm", "crisis"]
assets = ["Oil", "Food", "Tech"]
transition = [[0.95, 0.05], [0.2, 0.8]]
means = [[0.008, 0.007, 0.012], [-0.02, 0.002, -0.03]]
covariances = [
  [[0.002, 0.0004, 0.0006], [0.0004, 0.001, 0.0004], [0.0006, 0.0004, 0.003]],
  [[0.008, 0.002, 0.004], [0.002, 0.003, 0.002], [0.004, 0.002, 0.010]],
]
"""


def test_two_columns_that_state_the_holdings_are_refused(tmp_path):
    path = tmp_path / "holdings.csv"
    path.write_text("symbol,weight,market value\nOil,10%,400\nFood,90%,100\n")
    with pytest.raises(InputError, match="line 1: 'weight' and 'market value' all state what is held"):
        read_holdings(path, assets=ASSETS)


def test_prices_in_dollars_leave_weights_what_they_are(tmp_path):
    path = tmp_path / "holdings.csv"
    path.write_text("ticker,weight,shares,price\nOil,0.40,4,$30\nFood,0.20,2,$20\nTech,0.20,2,$5\n")
    assert read_holdings(path, assets=ASSETS).sums == pytest.approx((0.8, 0.8))


def test_what_holdings_leave_out_is_said(tmp_path):
    path = tmp_path / "holdings.csv"
    path.write_text("date,Oil,Food,Tech,Cash\n2020-01-31,3,0,0,1\n2020-02-29,2,1,1,-2\n")
    said = read_holdings(path, assets=ASSETS).cautions()
    assert "up to 33.3% of a row's value is left out (Cash)" in said[0]
    assert "Cash is below 0, a debt" in said[1]
    path.write_text("symbol,value\nOil,3\nCash,-1\n")
    assert any("Cash is below 0, a debt" in each for each in read_holdings(path, assets=ASSETS).cautions())
    path.write_text("symbol,value\nOil,3\nCash,1\n")
    assert not any("debt" in each for each in read_holdings(path, assets=ASSETS).cautions())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Oil,Food,Tech\n40%,59.4%,0%\n", "add up to 99.4%,"),
        ("Oil,Food,Tech\n.4,.5,.08\n.4,.5,.05\n", "add up to 95% to 98%,"),
        ("ticker,weight\nOil,40\nFood,50\ncash,8\n", "add up to 98%,"),
        ("ticker,weight\nOil,40\nFood,50\ncash,10\n", None),
        ("Oil,Food,Tech\n.333,.333,.333\n", None),
        ("ticker,weight\nOil,50%\nFood,10%\n", "add up to 60%,"),
        ("ticker,weight\nOil,.5\nFood,.1\n", "add up to 60%,"),
        ("ticker,value (%)\nOil,100\nFood,50\n", "add up to 150%,"),
        ("ticker,weight\nOil,0.5%\nFood,0.5%\n", "add up to 1%,"),
        ("date,ticker,weight\n2020-01,Oil,98%\n2020-02,Oil,80%\n", "add up to 80% to 98%,"),
        ("Oil,Food,Tech\n.4,.5,.08\n.4,.3,.1\n", "add up to 80% to 98%,"),
        ("ticker,weight\nOil,52%\nFood,50%\ncash,-2%\n", None),
        ("ticker,weight\nOil,52%\nFood,50%\ncash,2%\n", "add up to 104%,"),
        ("ticker,weight\nOil,50%\nFood,20%\nUSD,15%\nEUR,14%\n", None),
        ("Oil,Food,Tech\n4000,5000,800\n", None),
        ("Oil,Food,Tech\n95,0,0\n150,0,0\n240,0,0\n", None),
    ],
)
def test_shares_that_do_not_add_up_to_the_whole_are_said(tmp_path: Path, text: str, said: str | None) -> None:
    path = tmp_path / "holdings.csv"
    path.write_text(text)
    found = [each for each in read_holdings(path, assets=ASSETS).cautions() if "add up to" in each]
    assert len(found) == (said is not None)
    assert said is None or said in found[0]


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(MODEL.replace("{more}", ""))
    return path


# What is read: reader, content, options, values of the first row (or the whole).
READ = {
    "returns between semicolons": (read_returns, "date;A\n2020-01-31;0,01\n2020-02-29;-0,5\n", {}, [[0.01], [-0.5]]),
    "returns between tabs": (read_returns, "date\tA\n2020-01-31\t0.01\n", {}, [[0.01]]),
    "returns between bars": (read_returns, "date|A\n2020-01-31|0.01\n", {}, [[0.01]]),
    "beliefs with decimal commas": (read_beliefs, "date;up;down\n2020-01;0,25;0,75\n", {}, [[0.25, 0.75]]),
    "dollars": (read_holdings, 'Oil,Food,Tech\n"$1,000.00",$500.00,$500.00\n', {"assets": ASSETS}, [[0.5, 0.25, 0.25]]),
    "percent": (read_holdings, "Oil,Food,Tech\n50%,25%,25 %\n", {"assets": ASSETS}, [[0.5, 0.25, 0.25]]),
    "percent of 100": (read_holdings, "Oil,Food,Tech\n50,25,25\n", {"assets": ASSETS}, [[0.5, 0.25, 0.25]]),
    "blanks and cash": (read_holdings, "date,oil,FOOD,Cash\n2020-01-31,3,,1\n", {"assets": ASSETS}, [[1, 0, 0]]),
    "an asset named as cash is": (read_holdings, "asset,value\nusd,3\nOil,1\n", {"assets": ["USD", "Oil"]}, [[0.75, 0.25]]),
    "shares and prices": (
        read_holdings, "symbol,shares,price\nOIL,10,$30\nfood,20,5\nOil,10,30\n", {"assets": ASSETS}, [[6 / 7, 1 / 7, 0]]),
    "long with dates": (
        read_holdings, "date,asset,value\n2020-01-31,Oil,1\n2020-02-29,Food,2\n2020-02-29,Oil,2\n", {"assets": ASSETS},
        [[1, 0, 0], [0.5, 0.5, 0]]),
    "short positions in brackets": (read_holdings, "Oil,Food,Tech\n(50),100,50\n", {"assets": ASSETS}, [[-0.5, 1, 0.5]]),
    "a map": (
        read_holdings, "asset,value\n0378,3\nTech,1\nGLD,1\n", {"assets": ASSETS, "names": {"0378": "Oil", "GLD": ""}},
        [[0.75, 0, 0.25]]),
    "dates with names of months": (read_returns, "date,A\n31-Jan-2020,0.01\n29 February 2020,0.02\n", {}, [[0.01], [0.02]]),
    "months and years": (read_returns, "date,A\n01/2020,0.01\nFeb 2020,0.02\n", {}, [[0.01], [0.02]]),
    "long-short weights": (
        read_weights, "date,Oil,Food,Tech\n2020-01,0.75,-0.25,0\n", {"assets": ASSETS, "net": 0.5}, [[0.75, -0.25, 0]]),
    "weights of any sum": (read_weights, "Oil,Food,Tech\n0.2,0.1,0\n", {"assets": ASSETS, "net": None}, [[0.2, 0.1, 0]]),
    "a stated separator": (read_returns, "sep=;\ndate;A\n2020-01-31;0,01\n", {}, [[0.01]]),
    "a comma in a quoted name": (read_returns, 'date;"A, Inc";B\n2020-01-31;0,01;0,02\n', {}, [[0.01, 0.02]]),
    "percent with decimal commas": (
        read_holdings, "asset;value\nOil;12,5%\nFood;87,5 %\n", {"assets": ASSETS}, [[0.125, 0.875, 0]]),
    "decimal points between semicolons": (
        read_holdings, "asset;value\nOil;1.125\nFood;2.25\nTech;1.125\n", {"assets": ASSETS}, [[0.25, 0.5, 0.25]]),
    "one month in two notations": (
        read_holdings, "date,asset,value\n2020-01,Oil,1\n2020-01-31,Food,3\n", {"assets": ASSETS}, [[0.25, 0.75, 0]]),
    "a matrix": (read_labelled_matrix, "r,A,B\ny,3,4\nx,1,2\n", {"rows": ["x", "y"], "columns": ["B", "A"]}, [[2, 1], [4, 3]]),
}  # fmt: skip


@pytest.mark.parametrize("case", READ)
def test_what_is_read(case, tmp_path):
    reader, content, options, expected = READ[case]
    path = tmp_path / "mine.csv"
    path.write_text(content)
    found = reader(path, **options)
    np.testing.assert_allclose(getattr(found, "frame", found).to_numpy(), expected, atol=1e-12)


# What is refused: reader, content, options, what the message has.
ODD = {
    "both decimal signs": (read_returns, "date;A\n2020-01-31;0,01\n2020-02-29;0.02\n", {}, "not both"),
    "thousands or decimals": (read_returns, "date;A\n2020-01-31;1,234\n", {}, "thousands"),
    "points of thousands below one another": (read_returns, "date;A;B\n2020-01;987;5\n2020-02;1.050;5\n", {"prices": True},
        "'1.050' may have a decimal point or one of thousands"),
    "points of thousands in a row": (
        read_holdings, "Oil;Food;Tech\n1.234;987;5\n", {"assets": ASSETS}, "may have a decimal point or one of thousands"),
    "points of thousands in a row of several": (
        read_holdings, "date;Oil;Food;Tech\n2020-01;1.234;987;2.500\n2020-02;1.250;998;2.600\n", {"assets": ASSETS},
        "'1.234' may have a decimal point or one of thousands"),
    "percent with a comma of either kind": (
        read_holdings, "asset;value\nOil;12,345%\nFood;87%\n", {"assets": ASSETS}, "'12,345%' may have a decimal comma"),
    "a quoted percentage with a comma": (
        read_holdings, 'asset,value\nOil,"12,345%"\nFood,87%\n', {"assets": ASSETS}, "may have a decimal comma"),
    "a decimal comma in quotes": (read_holdings, 'Oil,Food,Tech\n"0,500",0.5,0\n', {"assets": ASSETS}, "expected an amount"),
    "a row of totals": (
        read_holdings, "date,Oil,Food\n2020-01,1,2\n2020-02,2,1\nTotal,3,3\n", {"assets": ASSETS}, "delete the line"),
    "a row of means": (read_weights, "date,Oil,Food,Tech\n2020-01,1,0,0\nMean:,1,0,0\n", {"assets": ASSETS}, "delete the line"),
    "one day in two notations": (
        read_weights, "date,Oil,Food,Tech\n2020-01,1,0,0\n2020-01-31,0,1,0\n", {"assets": ASSETS}, "is duplicated"),
    "shares without the value that others have": (
        read_holdings, "ticker,shares,price,value\nOil,10,3,30\nFood,5,2,\n", {"assets": ASSETS}, "no value for what is held"),
    "currencies that cancel": (
        read_holdings, "asset,value\nOil,60\nFood,40\nUSD,100\nEUR,-100\n", {"assets": ASSETS}, "67% of the value is left out"),
    "a column beside a list of holdings": (
        read_holdings, "ticker,name,value\nOil,Big Oil,1\n", {"assets": ASSETS}, "unknown columns 'name'"),
    "percentages as returns": (read_returns, "date,A\n2020-01-31,2.5\n2020-02-29,-3\n", {}, "percentages"),
    "dates that go back": (read_returns, "date,A\n2020-02-29,0.1\n2020-01-31,0.1\n", {}, "2020-01-31"),
    "a text in the numbers": (read_returns, "date,A\n2020-01-31,n.m.\n", {}, "expected a number"),
    "a blank return": (read_returns, "date,A\n2020-01-31,\n", {}, "missing"),
    "beliefs off the simplex": (read_beliefs, "date;a;b\n2020-01;0,5;0,6\n", {}, "sum to 1.1"),
    "a month that does not exist": (read_returns, "date,A\n31-Foo-2020,0.01\n", {}, "expected a date"),
    "a year of two digits": (read_returns, "date,A\n04-Jan-16,0.01\n", {}, "expected a date such as 2020-01-31"),
    "weights of another sum": (
        read_weights, "Oil,Food,Tech\n0.5,0.5,0\n", {"assets": ASSETS, "net": 0.5}, "sum to 1, expected 0.5 within"),
    "weights in dollars": (read_weights, "Oil,Food,Tech\n100,50,50\n", {"assets": ASSETS}, "sum to 200"),
    "an unknown ticker": (read_holdings, "asset,value\nOli,1\n", {"assets": ASSETS}, "did you mean 'Oil'"),
    "an unknown column": (read_holdings, "date,Oil,Gold\n2020-01-31,1,1\n", {"assets": ASSETS}, "'Gold' is none of"),
    "two columns of one asset": (read_holdings, "Oil,oil,Food\n1,1,1\n", {"assets": ASSETS}, "second column of one asset"),
    "mixed units": (read_holdings, "Oil,Food,Tech\n50%,0.25,25%\n", {"assets": ASSETS}, "per cent sign and some"),
    "mixed units below one another": (read_holdings, "asset,value\nOil,50%\nFood,50\n", {"assets": ASSETS}, "per cent sign"),
    "no value at all": (read_holdings, "Oil,Food,Tech\n0,,-\n", {"assets": ASSETS}, "add up to 0"),
    "longs and shorts that cancel": (read_holdings, "Oil,Food\n100,-100\n", {"assets": ASSETS}, "add up to 0"),
    "mostly cash": (read_holdings, "Oil,Food,cash\n1,1,8\n", {"assets": ASSETS}, "80% of the value is left out"),
    "shares alone": (read_holdings, "ticker,shares\nOil,10\n", {"assets": ASSETS}, "shares alone say nothing"),
    "shares without a price": (read_holdings, "ticker,shares,price\nOil,10,\n", {"assets": ASSETS}, "no price above 0"),
    "a value that is missing": (
        read_holdings, "asset,value\nOil,1\nFood,#N/A\n", {"assets": ASSETS}, "line 3, column 'value': found '#N/A'"),
    "a weight that is missing": (read_holdings, "Oil,Food\n1,n/a\n", {"assets": ASSETS}, "line 2, column 'Food': found 'n/a'"),
    "a price in per cent": (
        read_holdings, "ticker,shares,price\nOil,1,5%\n", {"assets": ASSETS}, "'price': found '5%', expected shares and"),
    "shares in per cent": (
        read_holdings, "ticker,shares,price\nOil,1%,5\n", {"assets": ASSETS}, "'shares': found '1%', expected shares and"),
    "a number without end": (
        read_holdings, f"asset,value\nOil,{'9' * 320}\n", {"assets": ASSETS}, "has 320 digits, expected"),
    "one date that is none": (
        read_weights, "date,Oil,Food,Tech\n1997-06-30,1,0,0\n1997-05-31*,1,0,0\n1997-04-30,1,0,0\n", {"assets": ASSETS},
        "line 3, column 'date': found '1997-05-31*', expected a date"),
    "a date in another notation": (
        read_weights, "date,Oil,Food,Tech\n31.05.1997,1,0,0\n1997-06-30,1,0,0\n1997-07-31,1,0,0\n", {"assets": ASSETS},
        "line 2, column 'date': '31.05.1997' is written otherwise than most dates, expected one notation"),
    "an amount in words": (read_holdings, "asset,value\nOil,ten\n", {"assets": ASSETS}, "expected an amount"),
    "an amount in euros and cents": (read_holdings, 'asset,value\nOil,"1.234,50"\n', {"assets": ASSETS}, "expected an amount"),
    "a date that comes late": (read_holdings, "asset,date,value\nOil,2020-01-31,1\n", {"assets": ASSETS}, "must come first"),
    "a map to nowhere": (
        read_holdings, "asset,value\nOil,1\n", {"assets": ASSETS, "names": {"X": "Gold"}}, "the map names 'Gold'"),
    "an empty file": (read_holdings, "", {"assets": ASSETS}, "is empty"),
    "a header alone": (read_holdings, "asset,value\n", {"assets": ASSETS}, "only a header"),
    "rows of another length": (read_holdings, "asset,value\nOil,1,2\n", {"assets": ASSETS}, "3 cells, expected 2"),
    "a map of other columns": (read_map, "from,to\nA,B\n", {}, "expected 'name' and 'asset'"),
    "a map that says it twice": (read_map, "name,asset\nA,Oil\nA,Food\n", {}, "stands twice"),
    "sectors of other columns": (read_sectors, "a,b\nOil,x\n", {"assets": ASSETS}, "expected 'asset' and 'sector'"),
    "an asset without a sector": (read_sectors, "asset,sector\nOil,x\nFood,x\n", {"assets": ASSETS}, "no sector for 'Tech'"),
    "a sector of an unknown asset": (read_sectors, "asset,sector\nGold,x\n", {"assets": ASSETS}, "unknown 'Gold'"),
    "a sector twice": (read_sectors, "asset,sector\nOil,x\nOil,x\n", {"assets": ASSETS}, "stands twice in its sector"),
    "a matrix with a row twice": (read_labelled_matrix, "r,A\nx,1\nx,2\n", {}, "twice: 'x'"),
    "a matrix without a row": (read_labelled_matrix, "r,A\nx,1\n", {"rows": ["x", "y"]}, "missing: 'y'"),
    "a matrix without a column": (read_labelled_matrix, "r,A\nx,1\n", {"columns": ["B"]}, "missing column"),
}  # fmt: skip


@pytest.mark.parametrize("case", ODD)
def test_odd_files_are_named(case, tmp_path):
    reader, content, options, message = ODD[case]
    path = tmp_path / "mine.csv"
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        reader(path, **options)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


# Model files: what is put in place of {more}, or of another text, and what the message has.
MODELS = {
    "no TOML": ("{more}", "[[[", "is not TOML"),
    "a misspelt section": ("[investor]", "[investors]", "no such key; did you mean investor?"),
    "a misspelt key": ('budget = "5bp"', "risk_aversoin = 5", "did you mean risk_aversion?"),
    "a misspelt limit": ("{more}", "[constraints]\nmax_wieght = 0.5", "did you mean max_weight?"),
    "text for a number": ('budget = "5bp"', 'risk_aversion = "5"', "should be"),
    "no risk aversion": ('budget = "5bp"', "risk_aversion = 0", "greater than 0"),
    "a budget in words": ('"5bp"', '"a lot"', "expected a share of |c*|"),
    "a cap above one": ("{more}", "[constraints]\nmax_weight = 25", "less than or equal to 1"),
    "a cap of nobody": ("{more}", "[constraints]\nmax_weight = { Gold = 0.5 }", "'Gold', expected one of Oil"),
    "caps that leave nothing": ("{more}", "[constraints]\nmax_weight = 0.2", "no decision satisfies all constraints"),
    "a sector cap alone": ("{more}", "[constraints]\nsector_cap = 0.2", "go together"),
    "a sector of nobody": ("{more}", '[constraints]\nsector_cap = 0.5\nsectors = { a = ["Gold"] }', "'Gold'"),
    "a file of sectors that is not there": ("{more}", '[constraints]\nsector_cap = 0.5\nsectors = "no.csv"', "does not exist"),
    "a net without long_short": ("{more}", "[constraints]\nnet = 0.5", "goes with long_short"),
    "less gross than net": ("{more}", "[constraints]\nlong_short = 0.5", "below the net"),
    "negative turnover": ("{more}", "[constraints]\nturnover = -1", "greater than or equal to 0"),
    "no names": ('names = ["calm", "crisis"]\n', "", "the key names is missing"),
    "a row short": ("transition = [[0.95, 0.05], [0.2, 0.8]]", "transition = [[0.95, 0.05]]", "transition"),
    "rows that do not sum to one": ("[0.2, 0.8]]", "[0.2, 0.9]]", "1.1"),
    "no means": ("means = [[0.008, 0.007, 0.012], [-0.02, 0.002, -0.03]]\n", "", "give one of means and means_file"),
    "means in percent": ("[-0.02, 0.002, -0.03]", "[-2.0, 0.2, -3.0]", "a loss of more than everything"),
    "means of other assets": ("[-0.02, 0.002, -0.03]", "[-0.02, 0.002]", "different lengths"),
    "an indefinite covariance": ("[0.002, 0.0004, 0.0006]", "[-0.002, 0.0004, 0.0006]", "covariances"),
    "a means file that is not there": (
        "means = [[0.008, 0.007, 0.012], [-0.02, 0.002, -0.03]]", 'means_file = "no.csv"', "does not exist"),
    "a file for the means": (
        "means = [[0.008, 0.007, 0.012], [-0.02, 0.002, -0.03]]", 'means = "means.csv"',
        "key regimes.means: should be a list, got 'means.csv'; the key for a file is means_file"),
    "files for the covariances": (
        "covariances = [", 'covariances = ["calm.csv", "crisis.csv",',
        "key regimes.covariances[0]: should be a list, got 'calm.csv'; the key for a file is covariance_files (and 1 more"),
    "regimes that never change": (
        "[[0.95, 0.05], [0.2, 0.8]]", "[[1, 0], [0, 1]]", "key regimes: the stationary law is not unique: "
        "the chain never leaves any of the classes of states [0] and [1]; give `initial`"),
    "an asset twice": ('"Oil", "Food", "Tech"]', '"Oil", "Oil", "Tech"]', "Oil"),
}  # fmt: skip


@pytest.mark.parametrize("case", MODELS)
def test_odd_models_are_named(case, tmp_path):
    old, new, message = MODELS[case]
    path = tmp_path / "model.toml"
    path.write_text(MODEL.replace(old, new).replace("{more}", ""))
    with pytest.raises(InscrutableError) as caught:
        investor_of(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)


def test_the_first_probabilities_are_those_of_the_first_row(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(MODEL.replace("means =", "initial = [1.0, 0.0]\nmeans =").replace("{more}", ""))
    crash = pd.DataFrame([[-0.2, 0.0, -0.3]], columns=ASSETS)
    np.testing.assert_allclose(investor_of(path).belief_after(crash), [0.95, 0.05], atol=1e-12)
    told = RegimesPart.model_fields["initial"].description
    assert told is not None
    assert told.startswith("probability of each regime in the first row,")


# Wrong calls of the verbs: arguments (M is the model, W weights, B a broker's file), exit code, what is said.
VERBS = {
    "a cap in words": ("protect --model M --belief 0.5,0.5 --max-weight much", 2, "expected a number such as 0.25"),
    "turnover in percent": ("protect --model M --belief 0.5,0.5 --turnover 30 --previous W", 2, "--turnover: "),
    "a cap above one": ("protect --model M --belief 0.5,0.5 --max-weight 50", 2, "--max-weight: "),
    "a sector cap alone": ("protect --model M --belief 0.5,0.5 --sector-cap 0.4", 3, "go together"),
    "sectors that are not there": (
        "protect --model M --belief 0.5,0.5 --sector-cap 0.4 --sectors no.csv",
        3,
        "does not exist",
    ),
    "turnover against nothing": ("protect --model M --belief 0.5,0.5 --turnover 0.1", 3, "--previous"),
    "weights before without a limit": ("protect --model M --belief 0.5,0.5 --previous W", 3, "--turnover"),
    "weights before a sequence": (
        "protect --model M --belief 0.5,0.5 --state s.json --turnover 0.1 --previous W",
        2,
        "--previous does not go with --state",
    ),
    "a budget in words": ("protect --model M --belief 0.5,0.5 --budget lots", 2, "expected a share of |c*|"),
    "a budget below nothing": ("protect --model M --belief 0.5,0.5 --budget -0.1", 3, "must be at least 0"),
    "silence in basis points": ("protect --model M --belief 0.5,0.5 --budget silence:5bp", 2, "expected a share"),
    "a map without normalise": ("protect --model M --weights W --map W", 2, "--map needs --normalise"),
    "less gross than net": ("protect --model M --belief 0.5,0.5 --long-short 0.5", 4, "below the net"),
    "no model": ("protect --model no.toml --belief 0.5,0.5", 3, "cannot be read"),
    "a belief of three": ("protect --model M --belief 0.2,0.3,0.5", 3, "expected one per state: 2"),
    "a file of its option's name": ("attack --model M --weights weights.csv", 3, "weights.csv does not exist"),
    "holdings as weights": ("attack --model M --weights B", 3, "--normalise"),
    "a map that is not there": ("attack --model M --weights B --normalise --map no.csv", 3, "does not exist"),
    "a regret as a share": ("attack --model M --weights W --regret 10%", 2, "expected a regret such as 5bp"),
    "a regret in words": ("attack --model M --weights W --regret small", 2, "--regret"),
    "a limit on rounded weights": ("attack --model M --weights W --turnover 0.2", 3, "full precision"),
    "several portfolios before": (
        "attack --model M --weights W --turnover 0.2 --previous T",
        3,
        "expected the one portfolio",
    ),
    "weights above a cap": ("attack --model M --weights W --max-weight 0.4", 3, "misses"),
    "budgets in two units": ("compare --budgets 5%,5bp", 2, "expected one unit"),
    "budgets in words": ("compare --budgets lots", 2, "expected shares of |c*|"),
    "two units of budgets in one": ("compare --budgets silence:5bp", 2, "expected shares"),
    "regimes twice": ("backtest --model M --regimes 3", 2, "the model gives its own"),
    "a backtest with turnover": ("backtest --turnover 0.2 --disclosure every(3)", 3, "leave out the disclosure"),
    "other assets than the returns'": ("backtest --model M", 3, "asset labels"),
    "a riskless rate of several columns": ("backtest --riskless R", 3, "expected one"),
    "a riskless rate in percent": ("backtest --riskless P", 3, "divide percentages by 100"),
    "a backtest of an unknown asset": ("backtest --model N", 3, "'Gold'"),
    "a folder as the model": ("backtest --model .", 3, "folder"),
    "a rival beside turnover": (
        "backtest --rival V --turnover 0.2 --no-sequential",
        3,
        "no aware observer is modelled",
    ),
    "a rival beside alphas": ("backtest --rival V --alphas W", 2, "--alphas takes no --rival"),
    "a rival that is none": ("backtest --rival N", 3, "expected the section [problem] alone"),
}


@pytest.mark.parametrize("case", VERBS)
def test_wrong_calls_of_verbs(case, model, tmp_path, monkeypatch, capsys):
    text, code, message = VERBS[case]
    monkeypatch.chdir(tmp_path)
    dates = "".join(f"{year}-{month:02d},5\n" for year in range(1949, 2018) for month in range(1, 13))
    files = {
        "W": "Oil,Food,Tech\n0.50,0.30,0.20\n", "B": "symbol,shares,price\nOil,1,2\n",
        "T": "Oil,Food,Tech\n0.5,0.3,0.2\n0.4,0.4,0.2\n", "R": "date,a,b\n2020-01,0,0\n", "P": f"date,rate\n{dates}",
        "N": "[constraints]\nmax_weight = { Gold = 0.2 }\n", "V": '[problem]\nkind = "naming"\n',
    }  # fmt: skip
    names = {"M": model}
    for name, content in files.items():
        names[name] = tmp_path / (f"{name}.toml" if name in "NV" else f"{name}.csv")
        names[name].write_text(content)
    assert main([str(names.get(word, word)) for word in text.split()]) == code
    said = capsys.readouterr().err
    assert message in said
    assert "Traceback" not in said


PROBLEM = MarkowitzProblem([[0.1, 0.0], [0.0, 0.2]], [np.eye(2), 2 * np.eye(2)], 1.0)

# Wrong calls of the library.
CALLS = {
    "two budgets": (lambda: CounterAdversarialDecisionMaker(PROBLEM, 0.1, 0.2), "two budgets were given"),
    "two measures": (
        lambda: CounterAdversarialDecisionMaker(PROBLEM, MaximalObfuscation(), MaximalObfuscation()), "budget"),
    "a budget in words": (lambda: CounterAdversarialDecisionMaker(PROBLEM, budget="much"), "expected a share of"),
    "silence of a problem alone": (lambda: ProbabilisticDecisionMaker(PROBLEM, budget="silence:0.5"), "silence="),
    "a budget of nothing": (lambda: Budget.parse(""), "expected a share"),
    "a budget of NaN": (lambda: Budget.parse(float("nan")), "must be finite"),
    "digits below zero": (lambda: consistent_beliefs(PROBLEM, [0.5, 0.5], digits=-1), "digits must be"),
    "rounded choices": (
        lambda: consistent_beliefs(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), [1.0, 0.0], digits=2), "whole numbers"),
    "more than rounding": (lambda: consistent_beliefs(PROBLEM, [0.9, 0.3], digits=2), "more than rounding"),
    "a decision of three": (lambda: consistent_beliefs(PROBLEM, [0.2, 0.3, 0.5], digits=2), "expected 2"),
    "a limit below nothing": (lambda: turnover([0.5, 0.5], "x"), "must be"),
    "a gross limit of many": (lambda: long_short(20, gross=0.5), "below the net"),
    "caps of other names": (lambda: turnover({"A": 0.5, "B": 0.5}, 0.1) & max_weights(["A", "C"], 0.5), "other asset labels"),
    "limits of other sizes": (lambda: simplex(20) & turnover(np.full(21, 1 / 21), 0.1), "cannot intersect"),
    "a set and a number": (lambda: PROBLEM.constraints & 3, None),
    "a section with an unknown key": (lambda: LimitsPart(max_wieght=0.5), "max_wieght"),
    "a section with text": (lambda: LimitsPart(turnover="much"), "turnover"),
    "a negative regret": (lambda: attack_weights(own(), pd.DataFrame([[1.0, 0, 0]], columns=ASSETS), regret=-1), "regret"),
    "weights of other assets": (
        lambda: attack_weights(own(), pd.DataFrame([[1.0, 0, 0]], columns=["Oil", "Food", "Gold"])), "unknown"),
    "turnover that is none": (lambda: replace(own(), turnover=-1), "turnover must be at least 0"),
}  # fmt: skip


def own():
    import tempfile
    from pathlib import Path

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "model.toml")
        path.write_text(MODEL.replace("{more}", ""))
        return investor_of(path)


@pytest.mark.parametrize("case", CALLS)
def test_wrong_calls_of_the_library(case):
    call, message = CALLS[case]
    with pytest.raises((InscrutableError, TypeError) if message is None else InscrutableError) as caught:
        call()
    assert message is None or message in str(caught.value)


def test_budgets_as_they_are_written():
    assert Budget.parse("10%") == Budget.parse(0.1) == Budget.parse("relative:0.1") == Budget.relative(0.1)
    assert Budget.parse("5bp") == Budget.parse("regret:5 bps") == Budget.regret(0.0005)
    assert Budget.parse("silence:50%", silence=0.004) == Budget.regret(0.002)
    assert "10%" in Budget.parse("10").remark
    assert "basis points" in Budget.parse("regret:5").remark
    assert "budget of 0 allows only" in Budget.parse("0").remark
    assert not Budget.parse("5bp").remark
    assert "silence:50%" in written_budget("silence:50").remark
    assert "more than a constant decision costs" in written_budget("silence:150%").remark
    assert not written_budget("silence:1").remark
    first = CounterAdversarialDecisionMaker(PROBLEM, "10%", MaximalObfuscation())
    assert first.budget == CounterAdversarialDecisionMaker(PROBLEM, 0.1).budget == Budget.relative(0.1)


def test_silence_is_the_regret_at_which_one_portfolio_suffices():
    from inscrutable.budgets import SilenceShare

    investor = own()
    whole = budget_in(investor.world, investor.problem, SilenceShare(1.0))
    assert budget_in(investor.world, investor.problem, SilenceShare(0.5)).amount == pytest.approx(0.5 * whole.amount)
    assert budget_in(investor.world, investor.problem, Budget(0.1)) == Budget(0.1)
    assert 0 < whole.amount < 0.01


@pytest.mark.parametrize("digits", [2, 4])
def test_rounded_decisions_of_any_problem_are_read(digits, fresh_rng):
    """The belief that was held is always among those read: quadratic costs, growth, and limits on magnitudes."""
    from inscrutable import KellyProblem

    rng, size = fresh_rng, 12
    outcomes = np.exp(0.2 * rng.normal(size=(6, 4)))
    growth = KellyProblem([outcomes] * 3, rng.dirichlet(np.ones(6), 3))
    factors = rng.normal(size=(3, size, size)) / size
    covariances = factors @ factors.transpose(0, 2, 1) + 0.01 * np.eye(size)
    lifted = MarkowitzProblem(0.1 * rng.normal(size=(3, size)), covariances, 1.0, long_short(size, gross=1.5))
    plain = MarkowitzProblem(0.1 * rng.normal(size=(3, size)), covariances, 1.0)
    for problem in (growth, lifted, plain):
        for belief in rng.dirichlet(np.ones(3), 4):
            published = problem.solve(belief).round(digits)
            found = consistent_beliefs(problem, published, digits=digits)
            assert found.contains(belief)


def test_a_model_goes_to_disk_with_limits_on_magnitudes(tmp_path):
    size = 14
    names = tuple(f"S{k}" for k in range(size))
    small = own()
    region = long_short(names, gross=1.5)
    tilted = MagnitudeRegion(region.rows, [region.limits[0]._replace(most=2.0, linear=np.linspace(0, 1, size))])
    problem = MarkowitzProblem(np.zeros((2, size)), [np.eye(size)] * 2, 1.0, tilted)
    from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel

    world = HiddenMarkovModel(small.world.transition, CategoricalEmission(np.eye(2)))
    model = InvestorModel(world, problem, names, ("a", "b"), turnover=0.25)
    again = InvestorModel.load(model.save(tmp_path / "model.json"))
    assert again.turnover == 0.25
    np.testing.assert_array_equal(again.problem.constraints.limits[0].linear, tilted.limits[0].linear)
    previous = dict.fromkeys(names[::-1], 1 / size)
    near = again.problem_after(previous)
    np.testing.assert_allclose(near.solve([0.5, 0.5]), model.problem_after(previous).solve([0.5, 0.5]))
    assert len(near.constraints.limits) == 2


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("max_weight = { Oil = 0.6, Ore = 0.5 }", "max_weight: limits has 'Ore', expected one of "),
        ("min_weight = { Ore = 0.1 }", "min_weight: limits has 'Ore'"),
        ("min_weight = -0.1", "min_weight: min_weight is -0.1"),
        ("sectors = { goods = ['Oil', 'Ore'] }\nsector_cap = 0.8", "sectors: group 'goods' has 'Ore'"),
        ("sector_cap = { bads = 0.8 }\nsectors = { goods = ['Oil'] }", "sector_cap: caps names 'bads'"),
        ("sector_cap = 0.5", "sector_cap: sector_cap and sectors go together"),
        ("shortable = ['Ore']\nlong_short = 1.5", "shortable: shortable has 'Ore'"),
        ("long_short = 0.5", "long_short: gross limit 0.5 is below"),
        ('max_weight = "forty"', "max_weight: should be a number, got 'forty'"),
        ('max_weight = { Oil = "%" }', "max_weight.Oil: should be a number, got '%'"),
        ('max_weight = "140%"', "max_weight: should be less than or equal to 1, got 1.4"),
    ],
)
def test_a_limit_that_is_wrong_is_named_with_its_line(tmp_path, line, said):
    path = tmp_path / "model.toml"
    text = MODEL.replace("{more}", f"[constraints]\n{line}")
    path.write_text(text)
    at = text.splitlines().index(line.splitlines()[0]) + 1
    with pytest.raises(InscrutableError, match=rf"line {at}, key constraints\.{re.escape(said)}") as found:
        investor_of(path)
    assert "number below" not in str(found.value)
    assert "more mistake" not in str(found.value)


def test_limits_of_a_file_may_be_percentages(tmp_path: Path) -> None:
    path, found = tmp_path / "model.toml", []
    sectors = "sectors = { goods = ['Oil', 'Food'] }\nlong_short"
    for text in (
        f"max_weight = 0.6\nmin_weight = {{ Oil = 0.05 }}\nturnover = 0.3\nsector_cap = 0.8\n{sectors} = 1.4",
        f"max_weight = '60%'\nmin_weight = {{ Oil = '5 %' }}\nturnover = '30%'\nsector_cap = '80%'\n{sectors} = '140%'",
    ):
        path.write_text(MODEL.replace("{more}", f"[constraints]\n{text}"))
        found.append(investor_of(path))
    numbers, percentages = found
    assert percentages.turnover == numbers.turnover == 0.3
    assert percentages.limits == numbers.limits


def test_limits_of_a_file_are_the_problem_s(tmp_path):
    path = tmp_path / "model.toml"
    more = "[constraints]\nmax_weight = { Oil = 0.3 }\nlong_short = 1.6\nturnover = 0.2"
    path.write_text(MODEL.replace("{more}", more))
    investor = investor_of(path, LimitsPart(max_weight=0.5))
    assert investor.turnover == 0.2
    region = investor.problem.constraints
    assert isinstance(region, Polyhedron)
    assert bool(region.violation([0.5, 0.5, 0.0]) <= 1e-9)
    assert not bool(region.violation([0.55, 0.45, 0.0]) <= 1e-9)
    assert bool(region.violation([0.5, 0.5 + 1e-12, -1e-12]) <= 1e-9)
    assert OwnModel.load(path).file.constraints.max_weight == {"Oil": 0.3}


@pytest.mark.parametrize(
    "more",
    [
        "max_weight = 0.7\nsectors = { goods = ['Oil', 'Food'] }\nsector_cap = 0.8",
        "max_weight = 0.7\nsectors = 'sectors.csv'\nsector_cap = { goods = 0.8 }\nturnover = 0.2",
        "long_short = 1.6",
        "",
    ],
)
@pytest.mark.parametrize("limits", [LimitsPart(max_weight=0.45), LimitsPart(min_weight=0.1, turnover=0.3), None])
def test_a_saved_model_and_its_file_have_the_same_limits_replaced(tmp_path, more, limits):
    (tmp_path / "sectors.csv").write_text("asset,sector\nOil,goods\nFood,goods\nTech,services\n")
    path, saved = tmp_path / "model.toml", tmp_path / "elsewhere" / "model.json"
    path.write_text(MODEL.replace("{more}", f"[constraints]\n{more}"))
    saved.parent.mkdir()
    investor_of(path).save(saved)
    of_file, of_saved = investor_of(path, limits), investor_of(saved, limits)
    for belief in ([0.9, 0.1], [0.2, 0.8]):
        np.testing.assert_allclose(of_saved.problem.solve(belief), of_file.problem.solve(belief), atol=1e-9)
    assert of_saved.problem.constraints.names == of_file.problem.constraints.names
    assert of_saved.turnover == of_file.turnover


def test_limits_that_a_saved_model_does_not_name_are_not_replaced(tmp_path):
    region = simplex(3) & max_weights(3, 0.6)
    problem = MarkowitzProblem(own().problem.means, own().problem.covariances, 5.0, region)
    for limits in (None, LimitsPart(), LimitsPart(max_weight=0.7)):
        replace(own(), problem=problem, limits=limits).save(tmp_path / "model.json")
        with pytest.raises(InputError, match="does not name the limits"):
            investor_of(tmp_path / "model.json", LimitsPart(min_weight=0.1))
    assert investor_of(tmp_path / "model.json", LimitsPart(turnover=0.1)).turnover == 0.1


def test_turnover_is_read_row_by_row(tmp_path):
    """Each row's limit is against the row before; a decision under it is explained by the belief that made it."""
    path = tmp_path / "model.toml"
    path.write_text(MODEL.replace("{more}", "[constraints]\nturnover = 0.3"))
    investor = investor_of(path)
    rows = [investor.problem.solve([0.9, 0.1])]
    for belief in ([0.2, 0.8], [0.6, 0.4]):
        rows.append(investor.problem_after(rows[-1]).solve(belief))
    found = attack_weights(investor, pd.DataFrame(rows, columns=ASSETS))
    assert found.count(Reading.EXACT) == 3
    for row, belief in zip(found.rows, ([0.9, 0.1], [0.2, 0.8], [0.6, 0.4]), strict=True):
        assert (row.bounds[:, 0] <= np.array(belief) + 1e-9).all()
        assert (row.bounds[:, 1] >= np.array(belief) - 1e-9).all()
    asked = attack_weights(investor, pd.DataFrame([[0.2, 0.5, 0.3]], columns=ASSETS), regret=0.02)
    assert asked.count(Reading.NEAR) == 1
    assert "200 bp" in asked.summary()


def test_numbers_without_their_last_zeros_have_the_digits_of_the_others(tmp_path) -> None:
    file = tmp_path / "holdings.csv"
    file.write_text("date,Oil,Food,Tech\n2020-01,0.2211,0.6121,0.1668\n2020-02,0.2,0.6463,0.1537\n")
    short = read_holdings(file, assets=["Oil", "Food", "Tech"]).decimals
    file.write_text(file.read_text().replace("0.2,", "0.2000,"))
    assert short == read_holdings(file, assets=["Oil", "Food", "Tech"]).decimals == 4
    file.write_text("asset,weight\nOil,0.2211\nFood,0.6\nTech,0.1789\n")
    assert read_holdings(file, assets=["Oil", "Food", "Tech"]).decimals == 4
    file.write_text("Oil,Food,Tech\n33.3%,33.3%,33.3%\n")  # published percentages, whose sum is off by their rounding
    found = read_holdings(file, assets=["Oil", "Food", "Tech"])
    assert found.decimals == 3
    np.testing.assert_allclose(found.frame, 0.333, rtol=1e-15)
    file.write_text("date,Oil,Food,Tech,Cash\n2020-01,221,612,167,12.345678\n")  # what is left out does not count
    assert read_holdings(file, assets=["Oil", "Food", "Tech"]).decimals == 2
    file.write_text(
        "asset,shares,price\nOil,100,30\nFood,500,12\nTech,2000,0.12345\n"
    )  # nor a penny's price for others
    assert read_holdings(file, assets=["Oil", "Food", "Tech"]).decimals == 1


def test_decisions_of_any_number_of_digits_are_read(fresh_rng):
    """At the corners of the simplex regrets of beliefs far away are as small as those that rounding can cause."""
    for seed in (*some((0, 3, 8, 13), 4), fresh_rng):
        rng = np.random.default_rng(seed)
        factors = rng.normal(size=(2, 4, 4))
        covariances = 0.01 * (factors @ factors.transpose(0, 2, 1) / 4 + 0.3 * np.eye(4))
        problem = MarkowitzProblem(0.02 * rng.normal(size=(2, 4)), covariances, 5.0)
        for belief in rng.dirichlet(np.full(2, 0.2), 3):
            action, hidden = problem.solve(belief), CounterAdversarialDecisionMaker(problem, 0.1).decide(belief)
            for digits in some(range(1, 9), 3):
                assert consistent_beliefs(problem, action.round(digits), digits=digits).distance(belief) <= 1e-6
                read = consistent_beliefs(problem, hidden.action.round(digits), digits=digits)
                assert read.distance(belief) <= hidden.privacy + 1e-6
                assert np.isfinite(read.bounds()).all()


@pytest.mark.parametrize("net", [0.5, 0.0])
def test_weights_have_the_sum_of_the_model(net, tmp_path, capsys):
    model, weights = tmp_path / "model.toml", tmp_path / "weights.csv"
    model.write_text(MODEL.replace("{more}", f"[constraints]\nlong_short = 1.5\nnet = {net}"))
    investor = investor_of(model)
    assert investor.net == pytest.approx(net, abs=1e-12)
    best = OriginalDecisionMaker(investor.problem).decide([0.7, 0.3]).action
    pd.DataFrame([best], ["2020-01-31"], ASSETS).rename_axis("date").to_csv(weights)
    assert main(["attack", "--model", str(model), "--weights", str(weights)]) == 0
    assert "0.7" in capsys.readouterr().out
    pd.DataFrame([best + 0.1], ["2020-01-31"], ASSETS).rename_axis("date").to_csv(weights)
    assert main(["attack", "--model", str(model), "--weights", str(weights)]) == 3
    said = capsys.readouterr().err
    assert f"expected {net:g} within" in said
    assert "--normalise" not in said


def test_lists_of_holdings_may_name_the_unit_of_their_columns(tmp_path: Path) -> None:
    file = tmp_path / "fund.csv"
    file.write_text("Ticker,Weight (%)\nOil,75.00\nGas,25.00\n")
    assert read_holdings(file, assets=["Gas", "Oil"]).frame.to_numpy().tolist() == [[0.25, 0.75]]
    file.write_text('ticker,shares,"market value ($)"\nOil,3,30.00\nGas,1,10.00\n')
    assert read_holdings(file, assets=["Gas", "Oil"]).frame.to_numpy().tolist() == [[0.25, 0.75]]


def test_dollars_that_add_up_to_about_100_are_no_percentages(tmp_path: Path) -> None:
    file = tmp_path / "fund.csv"
    for text, held in (
        ("ticker,shares,price\nA,3,20\nB,2,10\nC,1,22\n", [60, 20, 22]),
        ('ticker,"market value ($)"\nA,83\nB,18\nC,0\n', [83, 18, 0]),
        ("ticker,dollars\nA,83\nB,18\nC,0\n", [83, 18, 0]),
        ("ticker,value\nA,$34\nB,$34\nC,$34\n", [34, 34, 34]),
        ("A,B,C\n$83,$18,$0\n", [83, 18, 0]),
    ):
        file.write_text(text)
        found = read_holdings(file, assets=["A", "B", "C"])
        np.testing.assert_allclose(found.frame.to_numpy(), [np.array(held) / sum(held)])
        assert found.sums is None


def test_a_row_of_totals_is_said_to_go(tmp_path: Path) -> None:
    file = tmp_path / "fund.csv"
    file.write_text("ticker,value\nOil,75.00\nGas,25.00\nTotal,100\n")
    with pytest.raises(InputError, match=r"line 4, column 'ticker': 'Total' is no holding: delete its line or column"):
        read_holdings(file, assets=["Gas", "Oil"])


def test_titles_and_notes_around_a_table_are_said_to_go(tmp_path: Path) -> None:
    file = tmp_path / "fund.csv"
    file.write_text("ticker,weight\nOil,75.00\nGas,25.00\nNo advice\n")
    with pytest.raises(InputError, match=r"line 4: 1 cells, expected 2 .* notes below it must be deleted"):
        read_holdings(file, assets=["Gas", "Oil"])


def test_labels_of_models_are_those_of_tables_however_accents_are_spelt(tmp_path: Path) -> None:
    """Tables are read with composed accents; a model may have them apart from their letters."""
    apart = unicodedata.normalize("NFD", "Öl")
    model, weights = tmp_path / "model.toml", tmp_path / "weights.csv"
    model.write_text(MODEL.replace("Oil", apart).replace("{more}", f'[constraints]\nmax_weight = {{"{apart}" = 0.9}}'))
    weights.write_text(f"{apart},Food,Tech\n0.5,0.25,0.25\n")
    investor = investor_of(model)
    saved = investor.save(tmp_path / "model.json")
    saved.write_text(unicodedata.normalize("NFD", saved.read_text()))
    for each in (investor, InvestorModel.load(saved)):
        assert read_weights(weights, assets=each.assets).frame.columns[0] == "Öl"
    capped = investor_of(saved, LimitsPart(max_weight={apart: 0.1})).problem.constraints
    assert "Öl <= 0.1" in capped.names


@pytest.mark.parametrize(
    "labels",
    ["2020Q1 2020Q2 2020Q3", "Fund-2020 Fund-2021 2020-01", "10107 14593 200001", "202001 202002 310", "old 2020-01"],
)
def test_labels_that_are_no_dates_stay_text(tmp_path: Path, labels: str) -> None:
    path = tmp_path / "weights.csv"
    path.write_text("row,Oil,Food,Tech\n" + "".join(f"{each},1,0,0\n" for each in labels.split()))
    assert read_weights(path, assets=ASSETS).frame.index.tolist() == labels.split()
