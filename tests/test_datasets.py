"""Embedded and optional data: complete, plausible, and what their provenance says they are."""

from __future__ import annotations

import bz2
import csv
import hashlib
import importlib.util
import sys
from importlib import resources
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from inscrutable.datasets import IndustryReturns, load_daily_returns, load_industry_returns
from inscrutable.datasets.french import INDUSTRIES
from inscrutable.errors import InputError

FOLDER = resources.files("inscrutable.datasets")


@pytest.fixture(scope="module")
def data() -> IndustryReturns:
    return load_industry_returns()


def test_819_months_without_a_gap(data: IndustryReturns) -> None:
    expected = [
        pd.Timestamp(year, month, 1) + pd.offsets.MonthEnd(0) for year in range(1949, 2018) for month in range(1, 13)
    ][:819]
    for index in (data.returns.index, data.market.index, data.riskless.index):
        assert list(index) == expected
    assert str(data.returns.index[-1].date()) == "2017-03-31"
    assert data.returns.shape == (819, 12)
    assert np.isfinite(data.returns.to_numpy()).all()
    assert np.isfinite(data.market).all()
    assert np.isfinite(data.riskless).all()


def test_columns_are_the_librarys_industries(data: IndustryReturns) -> None:
    assert list(data.returns.columns) == list(INDUSTRIES)
    assert len(INDUSTRIES) == 12


def test_every_number_of_the_file_arrives(data: IndustryReturns) -> None:
    text = bz2.decompress(FOLDER.joinpath("us_industries.csv.bz2").read_bytes()).decode("ascii")
    rows = list(csv.DictReader(text.splitlines()))
    assert [row["month"] for row in rows] == [f"{day:%Y-%m}" for day in data.returns.index]
    for name in INDUSTRIES:
        assert [float(row[name]) for row in rows] == data.returns[name].tolist()
    assert [float(row["RF"]) for row in rows] == data.riskless.tolist()
    assert [float(row["MktRF"]) + float(row["RF"]) for row in rows] == data.market.tolist()
    assert all(len(cell.partition(".")[2]) == 4 for row in rows for name, cell in row.items() if name != "month")


def test_known_months(data: IndustryReturns) -> None:
    """October 1987 and January 1949 as the library prints them, in per cent: -22.64 in all, -23.24 over the bill."""
    assert data.market["1987-10"].item() == pytest.approx(-0.2264, abs=5e-5)
    assert data.returns.loc["1949-01-31", "NoDur"] == 0.0367
    assert data.riskless["1981-05"].item() > 0.01


def test_scale_is_monthly_fractions(data: IndustryReturns) -> None:
    mean, volatility = data.returns.mean(), data.returns.std()
    assert mean.between(0.008, 0.013).all()
    assert volatility.between(0.03, 0.07).all()
    assert 0.04 < data.market.std() < 0.045
    assert data.riskless.between(0.0, 0.0135).all()
    assert data.returns.to_numpy().min() > -0.35


def test_industries_are_raw_returns_that_make_up_the_market(data: IndustryReturns) -> None:
    excess = data.market - data.riskless
    design = np.column_stack([np.ones(819), excess, data.riskless])
    loading = np.linalg.lstsq(design, data.returns.mean(axis=1).to_numpy(), rcond=None)[0]
    assert loading[2] == pytest.approx(1.0, abs=0.15)  # in excess of the riskless rate it would be near 0
    weights = np.linalg.lstsq(data.returns.to_numpy(), data.market.to_numpy(), rcond=None)[0]
    assert weights.sum() == pytest.approx(1.0, abs=0.02)
    assert weights.min() > 0
    miss = data.market - data.returns @ weights
    assert miss.std() < 0.006
    assert abs(miss.mean()) < 0.001


def test_provenance_names_the_file_that_is_there(data: IndustryReturns) -> None:
    packed = FOLDER.joinpath("us_industries.csv.bz2").read_bytes()
    digest = hashlib.sha256(packed).hexdigest()
    note = FOLDER.joinpath("PROVENANCE.md").read_text("utf-8")
    assert digest in data.provenance
    assert digest in note
    assert hashlib.sha256(bz2.decompress(packed)).hexdigest() in note
    assert "linearmodels 7.1" in data.provenance


def test_figures_of_the_provenance_hold(data: IndustryReturns) -> None:
    assert round(100 * data.returns.mean().mean(), 3) == 1.036
    assert round(100 * data.market.mean(), 3) == 0.988
    assert round(100 * (data.market - data.riskless).mean(), 3) == 0.645


def test_calls_share_nothing(data: IndustryReturns) -> None:
    other = load_industry_returns()
    other.returns.iloc[0, 0] = 99.0
    other.riskless.iloc[0] = 99.0
    assert load_industry_returns().returns.iloc[0, 0] == 0.0367
    assert load_industry_returns().riskless.iloc[0] == 0.0010


def test_summary_says_what_and_whence(data: IndustryReturns) -> None:
    assert data.summary().startswith("12 industries, 819 months (1949-01 to 2017-03), simple monthly returns, raw\n")
    assert data.provenance in data.summary()


@pytest.mark.skipif(importlib.util.find_spec("skfolio") is None, reason="needs the data extra")
def test_daily_returns_chain_back_to_the_prices() -> None:
    from skfolio.datasets import load_sp500_dataset

    prices = load_sp500_dataset()
    returns = load_daily_returns()
    assert returns.shape == (8312, 20)
    assert list(returns.columns) == list(prices.columns)
    assert list(returns.index) == list(prices.index[1:])
    assert np.isfinite(returns.to_numpy()).all()
    chained = prices.iloc[0] * (1.0 + returns).prod()
    np.testing.assert_allclose(chained, prices.iloc[-1], rtol=1e-9)
    assert returns.std().between(0.01, 0.06).all()


def test_daily_says_how_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skfolio", None)
    monkeypatch.setitem(sys.modules, "skfolio.datasets", None)
    with pytest.raises(InputError, match=r"pip install 'inscrutable\[data\]'"):
        load_daily_returns()


def test_daily_without_network(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> pd.DataFrame:
        raise OSError("no route to host")

    module = ModuleType("skfolio.datasets")
    module.load_sp500_dataset = fail  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "skfolio", ModuleType("skfolio"))
    monkeypatch.setitem(sys.modules, "skfolio.datasets", module)
    with pytest.raises(InputError, match=r"no route to host.*pip install --upgrade"):
        load_daily_returns()
