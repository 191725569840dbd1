"""Data that cannot be right are named with row and column; fat tails and the embedded data are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import InputError
from inscrutable.datasets import load_industry_returns, read_returns, suspicious_entries
from inscrutable.experiments.backtest import BacktestSettings, run_backtest
from inscrutable.reports.backtest import warnings_of


def monthly(rng: np.random.Generator, n_rows: int = 198, n_assets: int = 12) -> pd.DataFrame:
    months = pd.date_range("2000-01", periods=n_rows, freq="ME", name="month")
    moves = rng.normal(0.008, 0.045, size=(n_rows, n_assets))
    return pd.DataFrame(moves, index=months, columns=[f"Fund {j}" for j in range(n_assets)])


def test_nothing_is_said_of_the_embedded_data() -> None:
    data = load_industry_returns()
    assert suspicious_entries(data.returns) == ()
    assert suspicious_entries(data.returns.loc["1970":"2004", ["NoDur", "Enrgy", "BusEq", "Utils"]].round(4)) == ()


def test_fat_tails_raise_no_alarm(fresh_rng: np.random.Generator) -> None:
    """Student's t, three degrees of freedom, 6 % a month: 0.6 % of 1,000 tables measured; more than 3 of 60 are 0.05 %."""
    months = pd.date_range("1990-01", periods=300, freq="ME")
    alarms = sum(
        bool(
            suspicious_entries(pd.DataFrame(np.maximum(0.06 * fresh_rng.standard_t(3, (300, 12)), -0.95), index=months))
        )
        for _ in range(60)
    )
    assert alarms <= 3


def test_a_month_of_1200_percent_is_named(fresh_rng: np.random.Generator) -> None:
    returns = monthly(fresh_rng)
    returns.iloc[70, 3] = 12.0
    (said,) = suspicious_entries(returns)
    assert said.startswith("Fund 3 on 2005-11-30: a return of +1200%")


def test_cash_in_percent_is_named(fresh_rng: np.random.Generator) -> None:
    returns = monthly(fresh_rng, n_assets=3)
    returns["Cash"] = 0.4 + 0.01 * fresh_rng.uniform(size=len(returns))
    (said,) = suspicious_entries(returns)
    assert said == f"Cash: it never falls and rises by {returns['Cash'].median():.0%} a row, as percentages do"
    assert suspicious_entries(returns.assign(Cash=returns["Cash"] / 100.0)) == ()


def test_a_column_of_years_is_no_asset(tmp_path: Path) -> None:
    returns = monthly(np.random.default_rng(0), n_assets=3)
    returns.insert(0, "Year", returns.index.year)
    returns.to_csv(tmp_path / "mine.csv")
    with pytest.raises(InputError, match=f"{len(returns)} of {len(returns)} returns of 'Year' exceed 1 in size"):
        read_returns(tmp_path / "mine.csv")


@pytest.mark.parametrize("first", [0, 1])
def test_a_column_of_row_numbers_is_no_asset_and_a_few_huge_returns_are(tmp_path: Path, first: int) -> None:
    returns = monthly(np.random.default_rng(0), n_assets=3)
    returns.iloc[::3, 1] = 1.5  # a third of all months
    returns.to_csv(tmp_path / "mine.csv")
    assert read_returns(tmp_path / "mine.csv").shape == returns.shape
    returns.assign(Row=np.arange(first, first + len(returns))).to_csv(tmp_path / "mine.csv")
    with pytest.raises(InputError, match=r"'Row' exceed 1 in size.* A column of years or numbers is no asset"):
        read_returns(tmp_path / "mine.csv")


def test_seventy_zeros_are_named_and_rounded_values_are_not(fresh_rng: np.random.Generator) -> None:
    returns = monthly(fresh_rng)
    returns.iloc[40:110, 5] = 0.0
    (said,) = suspicious_entries(returns)
    assert said.startswith("Fund 5 from 2003-05-31 to 2009-02-28: the same return, 0, in 70 rows running")
    rounded = pd.DataFrame(fresh_rng.normal(0, 0.01, size=(2000, 8)).round(2))  # a third of the values repeat
    assert suspicious_entries(rounded) == ()


def test_zeros_of_what_is_seldom_traded_are_no_cells_filled_in(fresh_rng: np.random.Generator) -> None:
    returns = fresh_rng.normal(0, 0.01, size=(1000, 4))
    returns[fresh_rng.random(returns.shape) < 0.7] = 0.0
    assert suspicious_entries(pd.DataFrame(returns)) == ()
    returns[300:400, 2] = 0.0
    (said,) = suspicious_entries(pd.DataFrame(returns))
    assert said.startswith("2 from ")


def test_two_rows_in_a_month_are_named(fresh_rng: np.random.Generator) -> None:
    returns = monthly(fresh_rng, 30)
    days = returns.index.to_list()
    days[12] = days[11] - pd.Timedelta(days=1)
    (said,) = suspicious_entries(returns.set_axis(pd.DatetimeIndex(sorted(days))))
    assert said.startswith("no row for 2001-01: ")
    assert said.endswith("; more than one row for 2000-12: each is taken for a step of its own")
    twice = pd.date_range("2000-01", periods=31, freq="SME")
    assert suspicious_entries(monthly(fresh_rng, 31).set_axis(twice)) == ()


def test_a_gap_of_ten_months_is_named(fresh_rng: np.random.Generator) -> None:
    returns = monthly(fresh_rng)
    (said,) = suspicious_entries(returns.drop(returns.index[100:110]))
    assert said.startswith("no row for 2008-05, 2008-06, ")
    assert "and 2 more" in said
    days = pd.bdate_range("2010-01-01", periods=400)
    daily = pd.DataFrame(fresh_rng.normal(0, 0.01, size=(400, 3)), index=days)
    assert suspicious_entries(daily.drop(days[[50, 51, 52, 53]])) == ()  # a long holiday
    (said,) = suspicious_entries(daily.drop(days[100:140]))
    assert said.startswith("no row between 2010-05-20 and 2010-07-16")


@pytest.mark.parametrize("ratio", [1 / 10, 1 / 3, 1 / 2, 2.0, 3.0])
def test_a_split_in_a_file_of_prices_is_named(ratio: float, fresh_rng: np.random.Generator, tmp_path: Path) -> None:
    moves = monthly(fresh_rng)
    # A split in a month of a large move may be missed: 2 of 300 without this limit.
    moves.iloc[120, 7] = np.clip(moves.iloc[120, 7], -0.05, 0.05)
    prices = 100.0 * (1.0 + moves).cumprod()
    prices.iloc[120:, 7] *= ratio
    prices.to_csv(tmp_path / "prices.csv")
    (said,) = suspicious_entries(read_returns(tmp_path / "prices.csv", prices=True))
    assert said.startswith("Fund 7 on 2010-01-31: a return of ")
    assert f"split of {f'1 to {1 / ratio:.0f}' if ratio < 1 else f'{ratio:.0f} to 1'}" in said


def test_splits_among_real_returns_are_mostly_found(fresh_rng: np.random.Generator) -> None:
    """Measured: 54 of 60."""
    real, found = load_industry_returns().returns, 0
    for _ in range(12):
        returns = real.copy()
        row, column = int(fresh_rng.integers(len(real))), int(fresh_rng.integers(12))
        returns.iloc[row, column] = (1.0 + returns.iloc[row, column]) * fresh_rng.choice([0.5, 1 / 3, 0.1, 2.0]) - 1.0
        found += any(said.startswith(f"{real.columns[column]} on") for said in suspicious_entries(returns))
    assert found >= 6


def test_degenerate_tables() -> None:
    assert suspicious_entries(pd.DataFrame(np.zeros((1, 2)))) == ()
    (first, second) = suspicious_entries(pd.DataFrame(np.full((30, 2), 0.01), columns=["A", "B"]))
    assert "in 30 rows running" in first
    assert second.startswith("B from 0 to 29")
    (lost,) = suspicious_entries(pd.DataFrame({"A": [0.01, -1.0, 0.02, 0.03]}))
    assert lost.startswith("A on 1: a return of -100%")
    assert suspicious_entries(pd.DataFrame()) == ()


@pytest.mark.parametrize("code", [-0.9999, -0.999])
def test_codes_of_missing_numbers_are_named(code: float, fresh_rng: np.random.Generator) -> None:
    returns = pd.DataFrame(fresh_rng.normal(0.01, 0.05, size=(300, 3)), columns=["A", "B", "C"])
    returns.iloc[[10, 11, 200], 1] = code
    found = suspicious_entries(returns)
    assert [
        each.startswith(f"B on {row}: a return of -100% (-99.99 and -999 often")
        for each, row in zip(found, (10, 11, 200), strict=True)
    ]
    assert len(found) == 3


def test_a_backtest_says_it_beside_the_result() -> None:
    returns = monthly(np.random.default_rng(3), 60, 2)
    returns.iloc[20, 1] = 12.0
    found = run_backtest(returns, BacktestSettings(regimes=2, train_until="2004-06", sequential=False), restarts=2)
    (said,) = found.market.suspicious
    assert f"Suspicious returns: {said}." in warnings_of(found)


def test_one_asset_under_two_names_is_named() -> None:
    returns = pd.DataFrame(np.random.default_rng(5).normal(0.0, 0.03, (30, 3)), columns=["A", "B", "Copy"])
    assert suspicious_entries(returns) == ()
    (said,) = suspicious_entries(returns.assign(Copy=returns["A"]))
    assert said == "Copy: the same returns as A in every row; how weight is divided between the two is arbitrary"


def test_a_column_that_is_a_combination_of_others_is_named(fresh_rng: np.random.Generator) -> None:
    returns = monthly(fresh_rng, 120, 5)
    total = 0.3 * returns["Fund 0"] + 0.7 * returns["Fund 3"] + 0.001
    double = 2.0 * returns["Fund 1"]
    for rounded in (returns, returns.round(6)):
        assert suspicious_entries(rounded) == ()
        (first, second) = suspicious_entries(rounded.assign(Total=total.round(6), Double=double.round(6)))
        said = {first.partition(":")[0]: first, second.partition(":")[0]: second}
        (pair,) = {"Double", "Fund 1"} & said.keys()
        (whole,) = {"Total", "Fund 0", "Fund 3"} & said.keys()
        assert "a combination of" in said[pair]
        assert all(name in said[whole] for name in {"Total", "Fund 0", "Fund 3"} - {whole})
        assert "Fund 2" not in said[whole] + said[pair]
    near = total + 0.003 * pd.Series(fresh_rng.normal(size=120), returns.index)
    assert suspicious_entries(returns.assign(Near=near)) == ()
    assert suspicious_entries(returns.iloc[:11].assign(Total=total)) == ()  # too few rows to tell
