"""The paper's pictures: every set is drawn for what it is, nothing is clipped, wrong shapes are refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inscrutable.adversaries import consistent_beliefs
from inscrutable.decision_makers import MixedDecision, ProbabilisticDecisionMaker, action_grid
from inscrutable.errors import InputError
from inscrutable.experiments.random_markets import random_market
from inscrutable.geometry import BeliefSet
from inscrutable.problems import MarkowitzProblem
from inscrutable.reports.names import spelled
from inscrutable.reports.simplex_plots import plot_actions, plot_beliefs
from inscrutable.reports.style import COLUMN_WIDTH, around, drawing, save_figure
from inscrutable.reports.time_plots import plot_costs, plot_privacy
from inscrutable.reports.tradeoff_plots import plot_convergence, plot_tradeoff
from sizes import audited

NAMES = ("calm", "unsettled", "crisis")
POINT = BeliefSet(np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]), np.zeros((0, 3)))
SEGMENT = BeliefSet(np.array([[1.0, -1.0, 0.0]]), np.zeros((0, 3)))
AREA = BeliefSet(np.zeros((0, 3)), np.array([[1.0, -1.0, 0.0]]))
EMPTY = BeliefSet(np.array([[1.0, 1.0, 1.0]]), np.zeros((0, 3)))


@pytest.fixture
def triangle() -> Iterator[tuple[Any, Any]]:
    with drawing(COLUMN_WIDTH, 3.3, subplot_kw={"projection": "ternary"}) as pair:
        yield pair


@pytest.fixture
def chart() -> Iterator[tuple[Any, Any]]:
    with drawing(COLUMN_WIDTH, 2.5) as pair:
        yield pair


def words(axes: Any) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def assert_written_whole(figure: Any, folder: Path, *, is_painted: bool = True) -> None:
    """Nothing is clipped, and what is written is a picture; some are painted in `make audit` alone, which takes a second."""
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    for axes in figure.axes:
        tight = axes.get_tightbbox(renderer)
        assert tight.x0 >= -1
        assert tight.x1 <= figure.bbox.x1 + 1
        assert tight.y1 <= figure.bbox.y1 + 1
    if not is_painted and not audited():
        return
    png, svg = save_figure(figure, folder, "picture")
    assert png.read_bytes().startswith(b"\x89PNG")
    assert svg.read_text("utf-8").rstrip().endswith("</svg>")


def test_beliefs_of_every_shape(triangle: tuple[Any, Any], tmp_path: Path) -> None:
    figure, axes = triangle
    plot_beliefs(axes, [0.2, 0.7, 0.1], {"ODM": POINT, "CDM": SEGMENT, "PDM": AREA, "PDM rounded": EMPTY}, NAMES)
    assert words(axes) == [*map(spelled, ("ODM", "CDM", "PDM")), "PDM rounded: no belief", "private belief"]
    dashed = [line for line in axes.lines if line.is_dashed() and len(line.get_xdata()) == 2]
    assert len(dashed) == 3
    lengths = [np.hypot(*(np.diff(axis)[0] for axis in line.get_data())) for line in dashed]
    # The triangle's side is 2/√3 where the simplex's is √2.
    expected = [each.distance([0.2, 0.7, 0.1]) * 2 / np.sqrt(6) for each in (POINT, SEGMENT, AREA)]
    assert np.allclose(lengths, expected)
    assert len(axes.patches) == 1
    assert axes.get_tlabel() == "calm"
    assert_written_whole(figure, tmp_path)


def test_belief_inside_its_set_has_no_dashed_line(triangle: tuple[Any, Any]) -> None:
    _, axes = triangle
    plot_beliefs(axes, [1 / 3, 1 / 3, 1 / 3], {"ODM": POINT}, NAMES)
    assert not [line for line in axes.lines if line.is_dashed() and len(line.get_xdata()) == 2]


def lottery() -> tuple[MarkowitzProblem, MixedDecision]:
    for seed in range(20):
        market = random_market(rng=np.random.default_rng(seed))
        belief = market.beliefs(1, rng=np.random.default_rng(seed))[0]
        grid = action_grid(market.problem, 20)
        mixed = ProbabilisticDecisionMaker(market.problem, candidates=grid).decide(belief)
        if mixed.probabilities.min() > 0.02 and len(mixed.probabilities) == 2:
            return market.problem, mixed
    raise AssertionError("no market mixes two decisions")


def test_actions_with_bars(triangle: tuple[Any, Any], tmp_path: Path) -> None:
    figure, axes = triangle
    problem, mixed = lottery()
    grid = action_grid(problem, 20).actions
    plot_actions(axes, {"ODM": [1, 0, 0], "CDM": [0, 1, 0], "PDM": [0, 0, 1]}, NAMES, candidates=grid, lottery=mixed)
    assert words(axes)[0] == "candidates (231)"
    assert words(axes)[2:] == [*map(spelled, ("ODM", "CDM", "PDM"))]
    assert words(axes)[1] in {f"p = {a:.2f}, {b:.2f}" for a, b in (mixed.probabilities, mixed.probabilities[::-1])}
    bars = [line for line in axes.lines if line.get_linewidth() == 3.0]
    heights = sorted(np.ptp(line.get_ydata()) / 0.35 for line in bars)
    assert heights == pytest.approx(sorted(mixed.probabilities))
    assert all(np.ptp(line.get_xdata()) < 1e-12 for line in bars)
    assert_written_whole(figure, tmp_path, is_painted=False)


def test_markers_of_the_paper(triangle: tuple[Any, Any]) -> None:
    _, axes = triangle
    problem, _ = lottery()
    seen = {name: consistent_beliefs(problem, problem.solve(np.eye(3)[0])) for name in ("ODM", "CDM", "PDM")}
    plot_beliefs(axes, np.eye(3)[1], seen, NAMES)
    marks = {line.get_label(): line.get_marker() for line in axes.lines if not line.get_label().startswith("_")}
    assert {name: marks[spelled(name)] for name in seen} == {"ODM": "^", "CDM": "x", "PDM": "o"}


def test_wrong_number_of_coordinates(triangle: tuple[Any, Any]) -> None:
    _, axes = triangle
    with pytest.raises(InputError, match="action of ODM has 4 coordinates; a triangle needs 3"):
        plot_actions(axes, {"ODM": [1.0, 0, 0, 0]}, NAMES)
    with pytest.raises(InputError, match="one per state: 3"):
        plot_beliefs(axes, [0.5, 0.5], {}, NAMES)


def test_time_plots(chart: tuple[Any, Any], tmp_path: Path) -> None:
    figure, axes = chart
    plot_costs(axes, {"CDM": np.full(40, 0.1), "PDM": np.linspace(0, 0.3, 40)}, budget=0.1)
    assert words(axes) == [
        "counter-adversarial (CDM), mean 0.100",
        "probabilistic (PDM), mean 0.150",
        "cost budget $c_b$",
    ]
    assert "normalised cost increase" in axes.get_ylabel()
    assert_written_whole(figure, tmp_path)


def test_privacy_over_labelled_steps(chart: tuple[Any, Any], tmp_path: Path) -> None:
    figure, axes = chart
    plot_privacy(axes, {"ODM": [0, 0], "CDM": [0.5, 1], "PDM": [1, 1.4]}, steps=[7, 9])
    assert list(axes.lines[1].get_xdata()) == [7, 9]
    assert axes.get_ylabel().startswith("privacy level")
    assert_written_whole(figure, tmp_path)


def test_timesteps_are_whole_numbers(chart: tuple[Any, Any]) -> None:
    _, axes = chart
    plot_privacy(axes, {"ODM": [0, 0, 0], "CDM": [0.5, 1, 0.7]})
    assert all(tick == round(tick) for tick in axes.get_xticks())


def test_trade_off_shows_mean_and_spread(chart: tuple[Any, Any], tmp_path: Path) -> None:
    figure, axes = chart
    runs = np.random.default_rng(0).random((20, 3))
    plot_tradeoff(axes, [0.1, 1, 10], {"ODM": 0 * runs, "CDM": runs / 2, "PDM": runs})
    assert np.allclose(axes.lines[2].get_ydata(), runs.mean(axis=0))
    assert "cost budget" in axes.get_xlabel()
    assert len(axes.collections) == 3
    assert_written_whole(figure, tmp_path)


def test_convergence(chart: tuple[Any, Any], tmp_path: Path) -> None:
    figure, axes = chart
    runs = np.random.default_rng(0).random((5, 4))
    plot_convergence(axes, [21, 66, 231, 861], {"action grid": runs, "random actions": runs, "decoy grid": runs})
    assert [label.get_text() for label in axes.get_xticklabels()] == ["21", "66", "231", "861"]
    assert len({line.get_marker() for line in axes.lines}) == 3
    assert_written_whole(figure, tmp_path)


def test_shapes_must_agree(chart: tuple[Any, Any]) -> None:
    _, axes = chart
    with pytest.raises(InputError, match="values of CDM have 3 columns, expected 2"):
        plot_tradeoff(axes, [0.1, 1.0], {"CDM": np.zeros((4, 3))})


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("n_states", [3, 5])
def test_corners_are_put_in_their_order_around(seed: int, n_states: int) -> None:
    """A convex polygon walked around turns the same way at every corner and goes round once."""
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0.0, 2 * np.pi, size=int(rng.integers(3, 9))))
    plane = np.linalg.qr(np.column_stack([np.ones(n_states), rng.normal(size=(n_states, 2))]))[0][:, 1:]
    polygon = 1 / n_states + 0.1 / n_states * np.column_stack([np.cos(angles), np.sin(angles)]) @ plane.T
    ordered = around(polygon[rng.permutation(len(polygon))])
    place = [int(np.abs(polygon - corner).sum(axis=1).argmin()) for corner in ordered]
    steps = {(after - before) % len(polygon) for before, after in zip(place, [*place[1:], place[0]], strict=True)}
    assert steps in ({1}, {len(polygon) - 1})
