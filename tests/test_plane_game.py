"""The lowest point of planes over the simplex: against HiGHS, with planes added one by one, with ties and degenerate rows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from inscrutable.adversaries import plane_game
from inscrutable.adversaries.plane_game import PlaneGame
from sizes import instances


def wanted(planes: np.ndarray) -> float:
    n, x = planes.shape
    answer = linprog(
        [*np.zeros(x), 1.0],
        A_ub=np.column_stack([planes, -np.ones(n)]),
        b_ub=np.zeros(n),
        A_eq=[[*np.ones(x), 0.0]],
        b_eq=[1.0],
        bounds=[*[(0, None)] * x, (None, None)],
    )
    assert answer.status == 0
    return max(float(answer.fun), 0.0)


@pytest.mark.parametrize("n_states", [1, 2, 3, 5, 10])
def test_planes_added_one_by_one(n_states: int) -> None:
    rng = np.random.default_rng(n_states)
    for _ in range(instances(5, least=1)):
        game = PlaneGame(rng.uniform(-0.2, 1.0, (2, n_states)))
        for _ in range(15):
            value, belief = game.lowest()
            assert value == pytest.approx(wanted(game.planes), abs=1e-9)
            assert belief.min() >= 0
            assert belief.sum() == pytest.approx(1.0)
            assert max(float((game.planes @ belief).max()), 0.0) == pytest.approx(value, abs=1e-9)
            game.add(rng.uniform(-0.2, 1.0, n_states))


@pytest.mark.parametrize(
    "planes",
    [
        np.ones((4, 3)),
        np.zeros((2, 3)),
        np.eye(3),
        np.vstack([np.eye(3), np.eye(3), np.ones((2, 3)) / 3]),
        np.array([[1.0, 0.5, 0.5], [0.5, 1.0, 0.5], [0.5, 0.5, 0.5]]),
        -np.eye(3),
        np.array([[1.0, 1.0 + 1e-13], [1.0 + 1e-13, 1.0]]),
    ],
)
def test_ties(planes: np.ndarray) -> None:
    value, belief = PlaneGame(planes).lowest()
    assert value == pytest.approx(wanted(planes), abs=1e-9)
    assert max(float((planes @ belief).max()), 0.0) == pytest.approx(value, abs=1e-9)


def test_highs_takes_over_when_exchanges_run_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plane_game, "_MOST_EXCHANGES", 0)
    planes = np.random.default_rng(0).uniform(0, 1, (6, 4))
    value, belief = PlaneGame(planes).lowest()
    assert value == pytest.approx(wanted(planes), abs=1e-9)
    assert float((planes @ belief).max()) == pytest.approx(value, abs=1e-8)
