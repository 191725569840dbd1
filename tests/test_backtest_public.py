"""A backtest whose rival follows something public, and whose investor may have a signal of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import InputError
from inscrutable.cli_values import UsageError, beside_of
from inscrutable.experiments.backtest import Backtest
from inscrutable.experiments.backtest_public import BesideReturns
from inscrutable.reports.backtest import table_of, text_of
from inscrutable.reports.backtest_verdict import verdict
from small_runs import coarse_rivals, repeated_fits
from test_backtest import DECISIONS, TRAINING, market, run

PUBLIC = ("error_public_without", "error_public_face_value", "error_public_followed")
RETURNS = market()
REGIMES = ["calm", "turbulent"]


def signal() -> pd.DataFrame:
    """Likelihoods on most dates, one of them scaled by a thousand."""
    rows = np.random.default_rng(4).uniform(0.1, 1.0, (len(RETURNS), 2))
    rows[-3] *= 1000.0
    return pd.DataFrame(rows, RETURNS.index, REGIMES).drop(RETURNS.index[[5, TRAINING + 2]])


def sentiment() -> pd.Series:
    """A number that is high in turbulent blocks of months."""
    wild = (np.arange(len(RETURNS)) // 7) % 2
    return pd.Series(wild + 0.8 * np.random.default_rng(6).normal(size=len(RETURNS)), RETURNS.index, name="fear")


@pytest.fixture(scope="module")
def runs() -> dict[str, Backtest]:
    options = {
        "market": None,
        "none": BesideReturns("none"),
        "all": BesideReturns("all"),
        "3M": BesideReturns("3M"),
        "portfolio": BesideReturns(market=RETURNS @ [0.5, 0.3, 0.2]),
        "private": BesideReturns(private=signal()),
        "fear": BesideReturns(sentiment()),
    }
    with coarse_rivals(20), repeated_fits():
        return {name: run(RETURNS, beside=each) for name, each in options.items()}


def normal(value: np.ndarray, mean: np.ndarray, spread: np.ndarray) -> float:
    apart = np.atleast_1d(value - mean)
    spread = np.atleast_2d(spread)
    return float(np.exp(-0.5 * apart @ np.linalg.solve(spread, apart)) / np.sqrt(np.linalg.det(2 * np.pi * spread)))


def predictions(found: Backtest, likelihood: object) -> np.ndarray:
    """Bayes' rule as written, one step after the other, on the rows of the decisions."""
    held, rows = found.world.initial, []
    for t in range(len(RETURNS) - 1):
        weights = held * [likelihood(t, i) for i in range(2)]
        held = weights / weights.sum() @ found.world.transition
        rows.append(held)
    return np.array(rows)[TRAINING - 1 :]


def rms(estimates: np.ndarray, found: Backtest) -> float:
    return float(np.sqrt(((estimates - found.beliefs.to_numpy()) ** 2).sum(axis=1).mean()))


def test_what_the_rival_follows_changes_no_other_figure(runs: dict[str, Backtest]) -> None:
    known = [key for key in runs["none"].figures["ODM"] if key not in PUBLIC]
    for name in ("market", "all", "3M", "portfolio"):
        for maker in ("ODM", "CDM", "PDM"):
            one, other = (runs[each].figures[maker] for each in (name, "none"))
            np.testing.assert_allclose([one[k] for k in known], [other[k] for k in known], rtol=1e-12, atol=1e-14)
    assert np.isnan([runs["none"].figures["ODM"][key] for key in PUBLIC]).all()
    assert all(
        each.figures["ODM"]["error_all_returns"] < 1e-12 for each in runs.values() if each is not runs["private"]
    )


def test_without_weights_it_is_a_filter_of_the_public_number(runs: dict[str, Backtest]) -> None:
    values = RETURNS.to_numpy()
    for name, weights in (("market", np.full(3, 1 / 3)), ("3M", [0.0, 0.0, 1.0]), ("portfolio", [0.5, 0.3, 0.2])):
        found = runs[name]
        sensor, read = found.world.emission, values @ weights
        expected = predictions(
            found,
            lambda t, i, w=weights, s=sensor, r=read: normal(
                r[t], s.means[i] @ w, w @ s.covariances[i] @ np.asarray(w)
            ),
        )
        np.testing.assert_allclose(found.public.without, expected, atol=1e-9)
        for maker in ("ODM", "CDM"):
            figures = found.figures[maker]
            assert figures["error_public_without"] == pytest.approx(rms(expected, found), rel=1e-9)
            assert np.isfinite(figures["error_public_followed"])
            sets = found.episode.records[maker].decisions.belief_set
            assert all(
                np.isnan(each.nearest(own)).any() or each.distance(face) < 1e-6
                for each, own, face in zip(sets, expected, found.public.face[maker], strict=True)
            )
    assert "mean return of the assets" in text_of(runs["market"])
    assert "R² 1.0000" in text_of(runs["portfolio"])


def test_where_all_is_public_nothing_is_left_to_hide(runs: dict[str, Backtest]) -> None:
    for figures in runs["all"].figures.values():
        assert figures["error_public_without"] == figures["error_public_followed"] == 0.0
    for name, found in runs.items():
        left = any("without any weights" in each for each in verdict(found))
        assert left == (name != "private")
        assert ("nothing can be hidden from it" in text_of(found)) == left
        assert ("error by following what is public, without weights" in table_of(found).index) == (name != "none")
        assert any(label.startswith("all: ") for label in table_of(found).index)


def test_a_private_signal_is_filtered_and_keeps_something_from_who_follows_all_returns(
    runs: dict[str, Backtest],
) -> None:
    found, rows = runs["private"], signal().reindex(RETURNS.index, fill_value=1.0).to_numpy()
    sensor, values = found.world.emission, RETURNS.to_numpy()
    expected = predictions(found, lambda t, i: rows[t, i] * normal(values[t], sensor.means[i], sensor.covariances[i]))
    np.testing.assert_allclose(found.beliefs, expected, atol=1e-10)
    plain = runs["none"].beliefs.to_numpy()
    assert found.figures["ODM"]["error_all_returns"] == pytest.approx(rms(plain, found), rel=1e-9)
    assert found.figures["ODM"]["error_all_returns"] > 0.01
    assert f"{rms(plain, found):.3f}" in text_of(found)


def test_numbers_that_are_no_returns_are_read_by_the_investor_too(runs: dict[str, Backtest]) -> None:
    found = runs["fear"]
    read, sensor, values = sentiment().to_numpy(), found.world.emission, RETURNS.to_numpy()
    fear = found.world.public_emission
    assert fear.means[1, 0] > fear.means[0, 0] + 0.3
    density = [[normal(z, fear.means[i, 0], fear.covariances[i]) for i in range(2)] for z in read]
    expected = predictions(
        found, lambda t, i: density[t][i] * normal(values[t], sensor.means[i], sensor.covariances[i])
    )
    np.testing.assert_allclose(found.beliefs, expected, atol=1e-9)
    np.testing.assert_allclose(found.public.without, predictions(found, lambda t, i: density[t][i]), atol=1e-9)
    assert np.abs(found.beliefs.to_numpy() - runs["none"].beliefs.to_numpy()).max() > 0.01


def test_who_follows_all_that_is_public_takes_what_the_investor_read(runs: dict[str, Backtest]) -> None:
    """The filter of the returns alone, beside a number that it did not read, and that of both."""
    plain = runs["none"].beliefs
    with coarse_rivals(20), repeated_fits():
        own = run(RETURNS, beliefs=plain, beside=BesideReturns(sentiment()))
    for found, named in ((own, "these returns are public"), (runs["fear"], "these returns and fear are public")):
        assert found.figures["ODM"]["error_all_returns"] == pytest.approx(0.0, abs=1e-9)
        said = text_of(found)
        assert named in said
        assert f"All: {named}, and the belief comes from them alone" in said
    reads = {name: each.investor.reads for name, each in runs.items()}
    wanted = {"fear": "fear", "private": "a private signal, or beliefs of its own"}
    assert reads == {name: wanted.get(name, "") for name in runs}
    for name, each in runs.items():
        assert ("one who knows how these move the belief may read more" in text_of(each)) == (name == "private")
    assert "which the investor reads, too" in text_of(runs["fear"])
    assert "which the investor reads, too" not in text_of(own)
    assert "all: error by following these returns and fear, no weights" in table_of(runs["fear"]).index


def test_what_does_not_fit_is_refused() -> None:
    rows, late = signal(), sentiment().iloc[: TRAINING + DECISIONS - 2]
    bad = rows.copy()
    bad.iloc[7, 0] = -1.0
    moved = {date: date - pd.Timedelta(days=1) for date in rows.index[[9, 12]]}
    refused = [
        ("one of the assets", BesideReturns("Oil"), {}),
        ("public lacks 2 of", BesideReturns(late), {}),
        ("do not vary", BesideReturns(sentiment() * 0.0), {}),
        ("do not vary in the training sample: all are 0.3", BesideReturns(sentiment() * 0.0 + 0.3), {}),
        ("are the returns of 3M, .* the column 3M can be public", BesideReturns(RETURNS["3M"].rename("x")), {}),
        ("are the returns of 3M", BesideReturns((100.0 * RETURNS["3M"] + 1.0).round(4)), {}),
        ("are a combination of the returns", BesideReturns(RETURNS.mean(axis=1).rename("index")), {}),
        ("one per regime", BesideReturns(private=rows.rename(columns={"calm": "quiet"})), {}),
        ("likelihoods are at least 0", BesideReturns(private=bad), {}),
        ("none of the dates", BesideReturns(private=rows.shift(freq="D")), {}),
        ("2 of .* rows on dates that the returns do not have", BesideReturns(private=rows.rename(index=moved)), {}),
        ("beliefs or private", BesideReturns(private=rows), {"beliefs": rows}),
    ]
    for said, beside, more in refused:
        with pytest.raises(InputError, match=said):
            run(RETURNS, beside=beside, **more)
    with pytest.raises(InputError, match="public must be"):
        BesideReturns(3)
    with pytest.raises(InputError, match="private must be"):
        BesideReturns(private=rows.to_numpy())


def test_the_command_line_names_columns_and_files(tmp_path: Path) -> None:
    sentiment().to_csv(tmp_path / "fear.csv", index_label="date")
    signal().to_csv(tmp_path / "signal.csv", index_label="date")
    found = beside_of(str(tmp_path / "fear.csv"), tmp_path / "signal.csv", RETURNS, embedded=False)
    assert np.allclose(found.public, sentiment())
    assert found.private.equals(signal().rename_axis("date"))
    assert beside_of("3M", None, RETURNS, embedded=False).public == "3M"
    assert beside_of("market", None, RETURNS, embedded=False).market is None
    assert len(beside_of("market", None, RETURNS, embedded=True).market) > 800
    with pytest.raises(UsageError, match="--public oil"):
        beside_of("oil", None, RETURNS, embedded=False)
    with pytest.raises(InputError, match="has 2 columns of numbers"):
        beside_of(str(tmp_path / "signal.csv"), None, RETURNS, embedded=False)
