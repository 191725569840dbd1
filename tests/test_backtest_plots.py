"""The pictures of a backtest: written whole, repeatable, and showing the numbers of the result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from inscrutable import InputError, NonExistence
from inscrutable.experiments.backtest import Backtest, BacktestSettings, run_backtest
from inscrutable.experiments.own_model import OwnModel
from inscrutable.experiments.weight_limits import LimitsPart
from inscrutable.reports import backtest_plots
from inscrutable.reports.backtest_plots import (
    draw_backtest,
    draw_beliefs,
    draw_frontier,
    draw_hidden,
    draw_month,
    draw_privacy_and_cost,
    draw_weights,
    step_of,
)
from inscrutable.reports.style import as_written, drawing
from sizes import audited
from small_runs import coarse_rivals, unpainted

FIGURES = ("hidden", "beliefs", "weights", "privacy_and_cost", "frontier", "month")
PAINTED = FIGURES if audited() else ("weights",)


def backtest(settings: BacktestSettings, n_assets: int, beliefs: int = 60 if audited() else 20) -> Backtest:
    rng = np.random.default_rng(0)
    rows = 200
    regime = (np.arange(rows) // 8) % 3
    tilt = np.linspace(-1.0, 1.0, n_assets)
    mean = 0.01 + 0.012 * np.stack([tilt, -tilt, np.cos(3 * tilt)])[regime]
    returns = mean + np.array([0.02, 0.04, 0.08])[regime][:, None] * rng.normal(size=(rows, n_assets))
    dates = pd.date_range("1995-01", periods=rows, freq="ME")
    labels = [f"Asset <{j}> & Söhne" for j in range(n_assets)]
    with coarse_rivals(beliefs):
        return run_backtest(pd.DataFrame(returns, index=dates, columns=labels), settings, restarts=3)


@pytest.fixture(scope="module")
def found() -> Backtest:
    return backtest(BacktestSettings(train_until="2010-12", budget=0.05, sequential=False), 12)  # type: ignore[arg-type]


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Collect figures instead of writing them."""
    figures: list[Any] = []
    monkeypatch.setattr(backtest_plots, "save_figure", lambda figure, *_: figures.append(figure) or [])
    return figures


def test_all_figures_are_written_and_repeatable(
    found: Backtest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Labels are escaped in them. One is painted, and in `make audit` all."""
    save = backtest_plots.save_figure
    monkeypatch.setattr(
        backtest_plots, "save_figure", lambda *asked: (save if asked[2] in PAINTED else unpainted)(*asked)
    )
    (tmp_path / "again").mkdir()
    written = draw_backtest(found, tmp_path)
    assert {path.name for path in written} == {f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")}
    assert all(path.stat().st_size > 5_000 for path in written if path.stem in PAINTED)
    text = (tmp_path / "weights.svg").read_text("utf-8")
    assert "&lt;3&gt;" in text
    assert "<3>" not in text
    draw_hidden(found, tmp_path / "again")
    draw_weights(found, tmp_path / "again")
    draw_month(found, tmp_path / "again", step_of(found))
    for again in (tmp_path / "again").iterdir():
        assert again.read_bytes() == (tmp_path / again.name).read_bytes(), again.name


@pytest.mark.parametrize(
    "name", ["US$ and C$", r"$\frac$", "_under", "$", "a name of more than twenty-four letters", " "]
)
def test_names_of_assets_are_no_formulas_and_never_left_out(name: str) -> None:
    with drawing() as (figure, axis):
        legend = figure.legend([axis.bar([0], [1])[0]], [as_written(name)])
        axis.set_yticks([0], [as_written(name)])
        figure.draw_without_rendering()
        listed = [text.get_text() for text in legend.get_texts()]
    assert [each.replace("\\$", "$").replace("\n", " ").lstrip("\u200b") for each in listed] == [name]


def test_panels_show_the_investor_and_every_reading(found: Backtest, kept: list[Any]) -> None:
    draw_beliefs(found, Path())
    titles = [axis.get_title(loc="left") for axis in kept[0].axes]
    assert titles == [
        "investor's belief",
        "optimal (ODM): read at face value",
        "counter-adversarial (CDM): read at face value",
        "probabilistic (PDM), drawn: read at face value",
        "counter-adversarial (CDM): read by the aware observer from all weights so far",
        "probabilistic (PDM), drawn: read by the aware observer from all weights so far",
    ]
    tops = found.beliefs.to_numpy().max(axis=1)
    for axis in kept[0].axes:
        assert axis.get_ylim() == (0.0, 1.0)
        assert len(axis.collections) == 3
    drawn = [area.get_paths()[0].vertices[:, 1].max() for area in kept[0].axes[0].collections]
    assert max(drawn) == pytest.approx(tops.max())  # as high as the likeliest regime is probable


def test_the_first_picture_shows_both_rivals_and_the_ceiling(found: Backtest, kept: list[Any]) -> None:
    draw_hidden(found, Path())
    (axis,) = kept[0].axes
    assert [text.get_text() for text in axis.get_yticklabels()] == [
        "optimal (ODM)",
        "counter-adversarial (CDM)",
        "probabilistic (PDM)",
    ]
    marks = {float(line.get_xdata()[0]) for line in axis.lines if len(line.get_xdata()) == 1}
    for figures in found.figures.values():
        assert {figures["error_face_value"], figures["error_followed"]} <= marks


def test_weights_reach_one_and_name_their_assets(found: Backtest, kept: list[Any]) -> None:
    draw_weights(found, Path())
    for axis in kept[0].axes:
        top = axis.collections[-1].get_paths()[0].vertices[:, 1].max()
        assert top == pytest.approx(1.0, abs=1e-9)
    listed = [text.get_text() for text in kept[0].legends[0].get_texts()]
    ever = {label for name in found.names for label in found.assets if (found.weights(name)[label] > 1e-3).any()}
    if len(ever) <= 9:
        assert set(listed) >= ever
    else:
        assert listed[0].endswith("others")


def test_short_weights_are_drawn_below_zero(kept: list[Any]) -> None:
    own = OwnModel.of_limits(LimitsPart(long_short=1.8, max_weight={"Asset <0> & Söhne": -0.1}))
    settings = BacktestSettings(regimes=2, train_until="2011-03", budget=0.01, sequential=False, own=own)  # type: ignore[arg-type]
    found = backtest(settings, 3, beliefs=20)
    draw_weights(found, Path())
    listed = [text.get_text() for text in kept[0].legends[0].get_texts()]
    assert len(listed) == 3  # also an asset that is only held short
    for axis, name in zip(kept[0].axes, found.names, strict=True):
        weights = found.weights(name)
        heights = np.concatenate([each.get_paths()[0].vertices[:, 1] for each in axis.collections])
        assert (weights < -0.01).any(axis=None)
        assert heights.max() == pytest.approx(weights.clip(lower=0.0).sum(axis=1).max())
        assert heights.min() == pytest.approx(weights.clip(upper=0.0).sum(axis=1).min())
        assert axis.get_ylim()[0] <= heights.min() < heights.max() <= axis.get_ylim()[1]


def test_time_panels_show_privacy_and_regret(found: Backtest, kept: list[Any]) -> None:
    draw_privacy_and_cost(found, Path())
    above, middle, below = kept[0].axes
    for line, name in zip(above.lines, found.names, strict=True):
        np.testing.assert_allclose(line.get_ydata(), found.privacy(name))
    shares = middle.lines[1].get_ydata()
    assert shares.max() <= 5.0 + 1e-9
    assert below.lines[0].get_ydata()[-1] == pytest.approx(np.prod(1 + found.path("ODM")["net_return"]))


def test_frontier_shows_the_decisions_on_the_curves(found: Backtest, kept: list[Any]) -> None:
    step = step_of(found)
    draw_frontier(found, Path(), step)
    (axis,) = kept[0].axes
    marks = {line.get_label(): line for line in axis.lines}
    lottery = found.episode.records["PDM"].lotteries
    assert lottery is not None
    assert marks["probabilistic (PDM),\nin expectation"].get_ydata()[0] == pytest.approx(lottery[step].expected_privacy)
    assert marks["counter-adversarial (CDM)"].get_xdata()[0] <= 5.0 + 1e-9
    mixed, single = marks["best lottery, in expectation"].get_ydata(), marks["best single decision"].get_ydata()
    assert (mixed >= single - 1e-12).all()
    assert (np.diff(mixed) >= -1e-12).all()
    # No decision lies above the curve that bounds it; the search finds better ones than the candidates.
    regrets = marks["best single decision"].get_xdata()
    for label, curve in (
        ("probabilistic (PDM),\nin expectation", mixed),
        ("probabilistic (PDM), atoms", single),
        ("counter-adversarial (CDM)", single),
    ):
        for regret, privacy in marks[label].get_xydata():
            assert privacy <= curve[np.searchsorted(regrets, regret)] + 1e-9, label
    assert "% of the optimal cost" in axis.get_xlabel()
    slope = next(line for label, line in marks.items() if label.startswith("slope: "))
    on = np.interp(slope.get_xdata(), marks["best lottery, in expectation"].get_xdata(), mixed)
    assert (slope.get_ydata() >= on - 1e-3).all()  # a tangent of a concave curve lies above it


def test_month_shows_the_distances(found: Backtest, kept: list[Any]) -> None:
    step = step_of(found)
    draw_month(found, Path(), step)
    axis = kept[0].axes[0]
    labels = [text.get_text() for text in axis.get_legend().get_texts()]
    assert f"counter-adversarial (CDM): distance {found.privacy('CDM')[step]:.2f}" in labels
    assert "π, the true belief" in labels
    shown = {each.get_label(): np.ravel(each.get_xdata()) for each in axis.lines} | {
        each.get_label(): each.get_xy() for each in axis.patches
    }
    assert all(len(shown[each]) for each in labels)
    assert f"{found.dates[step]:%Y-%m-%d}" in axis.get_title()


def test_nothing_is_clipped(found: Backtest, kept: list[Any]) -> None:
    """Every text of a figure lies inside what is saved: the tight box of the figure."""
    draw_backtest(found, Path())
    for figure in kept:
        figure.canvas.draw()
        tight = figure.get_tightbbox().transformed(figure.dpi_scale_trans)
        for axis in figure.axes:
            texts = [axis.xaxis.label, axis.yaxis.label, axis.title]
            for text in (one for one in texts if one.get_text()):
                box = text.get_window_extent()
                assert box.x0 >= tight.x0 - 1
                assert box.x1 <= tight.x1 + 1


def test_the_month_can_be_chosen(found: Backtest) -> None:
    assert step_of(found, "2011") == 7
    assert step_of(found, "2010-12") == 0
    assert step_of(found, "2011-02-28") == 2
    for wrong, message in (("1950-01", "they run from 2010-12-31"), ("soon", "must be a date"), ("", "must be a date")):
        with pytest.raises(InputError, match=message):
            step_of(found, wrong)


def test_missed_goals_and_two_regimes(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = BacktestSettings(
        regimes=2, train_until="2011-03", measure=NonExistence(margin=0.9), budget=0.01, sequential=False
    )  # type: ignore[arg-type]
    found, drawn = backtest(settings, 3, beliefs=20), list[str]()

    def laid_out(figure: Any, folder: Path, name: str) -> list[Path]:
        if audited() or name in ("privacy_and_cost", "frontier"):
            figure.draw_without_rendering()
        drawn.append(name)
        return []

    monkeypatch.setattr(backtest_plots, "save_figure", laid_out)
    draw_backtest(found, Path())
    assert sorted(drawn) == sorted(set(FIGURES) - {"month"})
