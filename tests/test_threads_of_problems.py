"""Threads that share a problem find what one thread finds; also where costs in CVXPY have one value at a time."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from inscrutable import DecisionProblem, LinearProblem, PiecewiseLinearProblem, simplex
from inscrutable.problems.modelled import Modelled
from sizes import instances

Array = NDArray[np.float64]
STATES, ASSETS, THREADS = 3, 8, 4


@pytest.fixture(autouse=True)
def switches_often() -> Iterator[None]:
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


def linear() -> DecisionProblem:
    return LinearProblem(np.random.default_rng(1).normal(size=(STATES, ASSETS)), simplex(ASSETS))


def piecewise_linear() -> DecisionProblem:
    rng = np.random.default_rng(1)
    slopes, offsets = rng.normal(size=(STATES, 4, ASSETS)), rng.normal(size=(STATES, 4))
    return PiecewiseLinearProblem(list(slopes), list(offsets), simplex(ASSETS))


def stated() -> tuple[Any, list[Any], list[Any]]:
    cp = pytest.importorskip("cvxpy")
    weights, returns = cp.Variable(ASSETS), np.random.default_rng(1).normal(0.05, 0.1, (STATES, 12, ASSETS))
    costs = [-cp.sum(cp.log(1 + each @ weights)) / 12 + cp.sum_squares(weights) for each in returns]
    return weights, costs, [cp.sum(weights) == 1, weights >= 0]


def shared(problem: Any, asked: Callable[[Any, Array], Array], beliefs: Array) -> Array:
    """Ask for each belief twice, in threads."""
    with ThreadPoolExecutor(THREADS) as pool:
        return np.array(list(pool.map(lambda belief: asked(problem, belief), np.concatenate([beliefs, beliefs[::-1]]))))


@pytest.mark.parametrize(("make", "rounds"), [(linear, instances(60)), (piecewise_linear, instances(40))])
def test_threads_share_the_vertices_found(make: Callable[[], DecisionProblem], rounds: int) -> None:
    beliefs = np.random.default_rng(2).dirichlet(np.ones(STATES), 16)
    alone = np.array([make().solve(belief) for belief in beliefs])
    for _ in range(rounds):
        found = shared(make(), lambda problem, belief: problem.solve(belief), beliefs)
        np.testing.assert_array_equal(found, np.concatenate([alone, alone[::-1]]))


def test_threads_share_a_cvxpy_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the programme that is read off CVXPY's, as where it cannot be read."""
    monkeypatch.setattr(Modelled, "_cones", None)
    beliefs = np.random.default_rng(2).dirichlet(np.ones(STATES), 6)
    alone = np.array([Modelled(*stated()).solve(belief) for belief in beliefs])
    found = shared(Modelled(*stated()), lambda model, belief: model.solve(belief), beliefs)
    np.testing.assert_array_equal(found, np.concatenate([alone, alone[::-1]]))


@pytest.mark.parametrize("figure", [Modelled.values, Modelled.gradients])
def test_threads_share_costs_that_cvxpy_values(
    figure: Callable[[Modelled, Array], Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the functions that are read off CVXPY's expressions."""
    monkeypatch.setattr(Modelled, "_trees", None)
    decisions = np.random.default_rng(2).dirichlet(np.ones(ASSETS), (20, 1))
    model = Modelled(*stated())
    alone = np.array([figure(model, each) for each in decisions])
    found = shared(model, figure, decisions)
    np.testing.assert_array_equal(found, np.concatenate([alone, alone[::-1]]))
