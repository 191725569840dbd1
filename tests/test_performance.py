"""Returns, turnover and Sharpe ratios against sums done by hand, and the interval against the normal theory."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from inscrutable import InputError
from inscrutable.experiments.performance import (
    Frequency,
    _influence,
    frequency_of,
    sharpe_difference,
    track_portfolios,
)

MONTHLY = Frequency(12.0, "month")


def test_two_months_by_hand() -> None:
    # 60/40, then 50/50. Month 1: A +10 %, B -5 %: return 0.06 - 0.02 = 0.04; worth .66 + .38 = 1.04.
    # Drifted: .66/1.04 = .634615, .38/1.04 = .365385; to 50/50 one sells .134615 and buys .134615.
    held = track_portfolios([[0.6, 0.4], [0.5, 0.5]], [[0.10, -0.05], [0.0, 0.02]], MONTHLY, cost=0.01)
    np.testing.assert_allclose(held.gross, [0.04, 0.01], atol=1e-15)
    traded = 2 * (0.66 / 1.04 - 0.5)
    np.testing.assert_allclose(held.traded, [0.0, traded], atol=1e-15)
    np.testing.assert_allclose(held.net, [0.04, (1 - 0.01 * traded) * 1.01 - 1], atol=1e-15)
    assert held.turnover == pytest.approx(12 * traded)


def test_holding_still_trades_nothing() -> None:
    rng = np.random.default_rng(0)
    moves = rng.normal(0.0, 0.05, (6, 3))
    weights = [np.array([0.2, 0.3, 0.5])]
    for row in moves[:-1]:
        weights.append(weights[-1] * (1 + row) / (weights[-1] * (1 + row)).sum())
    held = track_portfolios(weights, moves, MONTHLY, cost=0.5)
    np.testing.assert_allclose(held.traded, 0.0, atol=1e-14)
    bought = np.array([0.2, 0.3, 0.5]) @ np.prod(1 + moves, axis=0)
    assert np.prod(1 + held.net) == pytest.approx(bought)


def test_annual_figures_by_plain_sums() -> None:
    rng = np.random.default_rng(1)
    returns, riskless = rng.normal(0.01, 0.04, (30, 1)), rng.uniform(0.0, 0.003, 30)
    held = track_portfolios(np.ones((30, 1)), returns, MONTHLY, riskless=riskless)
    plain = [float(value) for value in returns[:, 0]]
    excess = [value - float(rate) for value, rate in zip(plain, riskless, strict=True)]
    wealth = 1.0
    for value in plain:
        wealth *= 1 + value

    def spread(values: list[float]) -> float:
        middle = sum(values) / len(values)
        return math.sqrt(sum((value - middle) ** 2 for value in values) / (len(values) - 1))

    assert held.annual_return() == pytest.approx(wealth ** (12 / 30) - 1)
    assert held.volatility() == pytest.approx(spread(plain) * math.sqrt(12))
    assert held.sharpe_ratio() == pytest.approx(sum(excess) / 30 / spread(excess) * math.sqrt(12))


def test_a_total_loss_and_returns_that_do_not_vary() -> None:
    lost = track_portfolios([[1.0, 0.0], [1.0, 0.0]], [[-1.0, 0.1], [0.2, 0.1]], MONTHLY, cost=0.01)
    assert lost.annual_return() == -1.0
    assert np.isfinite(lost.net).all()
    flat = track_portfolios(np.ones((4, 1)), np.full((4, 1), 0.01), MONTHLY)
    assert math.isnan(flat.sharpe_ratio())
    assert math.isnan(sharpe_difference(flat.gross, [0.1, 0.2, 0.0, 0.1], rng=np.random.default_rng(0)).low)


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        ("B", (252, "trading day")),
        ("W", (52, "week")),
        ("ME", (12, "month")),
        ("QE", (4, "quarter")),
        ("YE", (1, "year")),
        ("D", (365.25, "day")),
    ],
)
def test_how_often_rows_come(rule: str, expected: tuple[float, str]) -> None:
    assert frequency_of(pd.date_range("2000-01-01", periods=40, freq=rule)) == expected


def test_rows_within_a_day_are_counted() -> None:
    assert frequency_of(pd.date_range("2000-01-01", periods=40, freq="h")) == (pytest.approx(24 * 365.25), "hour")
    assert frequency_of(pd.date_range("2000-01-01", periods=40, freq="15min"))[0] == pytest.approx(96 * 365.25)
    hours = pd.date_range("2000-01-03", "2001-12-31", freq="h")
    open_at = hours[(hours.hour >= 9) & (hours.hour < 16) & (hours.day_of_week < 5)]
    per_year, word = frequency_of(open_at)
    assert (round(per_year / (7 * 5 * 365.25 / 7), 2), word) == (1.0, "hour")


def test_hourly_wealth_that_doubles_in_a_year_doubles() -> None:
    hours = pd.date_range("2000-01-01", "2000-12-31", freq="h")
    growth = np.full(len(hours), 2.0 ** (1 / (24 * 365.25)) - 1.0)
    made = track_portfolios(np.ones((len(hours), 1)), growth[:, None], frequency_of(hours))
    assert made.annual_return() == pytest.approx(1.0, rel=1e-6)


def test_ruined_wealth_does_not_revive() -> None:
    weights, returns = np.array([[3.0, -2.0], [3.0, -2.0]]), np.array([[-0.6, 0.0], [-0.6, 0.0]])
    assert track_portfolios(weights, returns, Frequency(12.0, "month")).annual_return() == -1.0


def test_an_unusual_distance_of_dates_is_counted_in_days() -> None:
    assert frequency_of(pd.date_range("2000-01-01", periods=9, freq="14D")) == (365.25 / 14, "period")


def test_interval_agrees_with_normal_theory() -> None:
    """Jobson and Korkie (1981) as corrected by Memmel (2003) hold for independent normal returns."""
    rng = np.random.default_rng(2)
    rows, correlation = 600, 0.6
    shocks = rng.multivariate_normal([0.3, 0.1], [[1.0, correlation], [correlation, 1.0]], size=rows)
    found = sharpe_difference(shocks[:, 0], shocks[:, 1], rng=rng, block=1, replicates=1500)
    first, second = (series.mean() / series.std(ddof=1) for series in shocks.T)
    rho = np.corrcoef(shocks.T)[0, 1]
    variance = (2 - 2 * rho + 0.5 * (first**2 + second**2 - 2 * first * second * rho**2)) / rows
    assert found.difference == pytest.approx(first - second)
    assert (found.high - found.low) / 2 == pytest.approx(1.96 * math.sqrt(variance), rel=0.08)


def test_influence_is_the_derivative_of_the_difference() -> None:
    """Give one row a little more weight and see how the difference of the weighted Sharpe ratios moves."""
    series = np.random.default_rng(8).normal([[0.9], [0.4]], [[1.0], [0.5]], (2, 12))

    def difference(weights: np.ndarray) -> float:
        means = series @ weights
        first, second = means / np.sqrt((series**2) @ weights - means**2)
        return float(first - second)

    even, step = np.full(12, 1 / 12), 1e-6
    for row, influence in enumerate(_influence(series[:, None, :])[1][0]):
        moved = (1 - step) * even + step * np.eye(12)[row]
        assert (difference(moved) - difference(even)) / step == pytest.approx(influence, rel=1e-3, abs=1e-4)


def test_interval_sees_correlation_in_time() -> None:
    rng = np.random.default_rng(3)
    first, second = np.repeat(rng.normal(0.2, 1.0, (2, 150)), 4, axis=1)
    blind, seeing = (sharpe_difference(first, second, rng=rng, block=b, replicates=600) for b in (1, 12))
    # Every row four times over: the truth is twice as wide as independence would have it.
    assert seeing.high - seeing.low > 1.5 * (blind.high - blind.low)


def test_interval_of_nothing_and_the_same_draws() -> None:
    series = np.random.default_rng(4).normal(size=50)
    assert sharpe_difference(series, series, rng=np.random.default_rng(0)) == (0.0, 0.0, 0.0)
    one, again = (sharpe_difference(series, series**3, rng=np.random.default_rng(5)) for _ in range(2))
    assert one == again


def test_scale_does_not_change_the_interval() -> None:
    series = np.random.default_rng(6).normal(0.1, 1.0, (2, 80))
    one = sharpe_difference(*series, rng=np.random.default_rng(7), replicates=200)
    other = sharpe_difference(100 * series[0], 0.01 * series[1], rng=np.random.default_rng(7), replicates=200)
    np.testing.assert_allclose(one, other, rtol=1e-9)


def test_two_rows_determine_no_interval() -> None:
    """Their influences are equal up to the sign; intervals of width 0 were stated."""
    rng = np.random.default_rng(0)
    for first, second in rng.normal(size=(20, 2, 2)):
        found = sharpe_difference(first, second, rng=rng)
        assert (found.low, found.high) == (-np.inf, np.inf)


def test_refusals() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match=r"one shape \(T,U\)"):
        track_portfolios([[1.0]], [[0.1, 0.2]], MONTHLY)
    with pytest.raises(InputError, match="riskless has 3"):
        track_portfolios(np.ones((2, 1)), np.zeros((2, 1)), MONTHLY, riskless=[0, 0, 0])
    with pytest.raises(InputError, match="cost"):
        track_portfolios(np.ones((2, 1)), np.zeros((2, 1)), MONTHLY, cost=-0.1)
    with pytest.raises(InputError, match="two series"):
        sharpe_difference([0.1, 0.2], [0.1, 0.2, 0.3], rng=rng)
    with pytest.raises(InputError, match="level"):
        sharpe_difference([0.1, 0.2], [0.2, 0.1], rng=rng, level=1.0)
    with pytest.raises(InputError, match="at least 2"):
        frequency_of(pd.DatetimeIndex(["2020-01-31"]))


def test_weights_that_sum_to_nothing_drift_with_wealth() -> None:
    weights, returns = np.tile([0.5, -0.5], (3, 1)), np.tile([0.1, 0.05], (3, 1))
    found = track_portfolios(weights, returns, Frequency(12.0, "month"), cost=0.001)
    drifted = [0.5 * 1.1 / 1.025, -0.5 * 1.05 / 1.025]
    traded = abs(0.5 - drifted[0]) + abs(-0.5 - drifted[1])
    np.testing.assert_allclose(found.traded, [0.0, traded, traded])
    np.testing.assert_allclose(found.net, [0.025, *[1.025 * (1.0 - 0.001 * traded) - 1.0] * 2])


def test_excess_returns_that_vary_by_rounding_have_no_sharpe_ratio() -> None:
    riskless = np.array([0.01, 0.02, 0.03, 0.04])
    returns = np.column_stack([0.005 + riskless, riskless])
    found = track_portfolios(np.tile([1.0, 0.0], (4, 1)), returns, Frequency(12.0, "month"), riskless=riskless)
    assert math.isnan(found.sharpe_ratio())
