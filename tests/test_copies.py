"""Problems and decisions that are pickled or copied, as other processes need them, decide as the first ones."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import cvxpy as cp
import numpy as np
import pytest

from inscrutable import (
    ConvexProblem,
    CostLearningAdversary,
    CounterAdversarialDecisionMaker,
    DecisionProblem,
    decoy_grid,
    dispatch_problem,
    load_ieee_30_bus,
)
from sizes import audited, paired


def smooth() -> DecisionProblem:
    shares = cp.Variable(3)
    costs = [cp.sum_squares(shares - centre) + cp.exp(shares[0]) for centre in np.eye(3)[:2]]
    return ConvexProblem(shares, costs, [shares >= 0, cp.sum(shares) == 1])


def with_kinks() -> DecisionProblem:
    shares = cp.Variable(3)
    costs = [cp.norm1(shares - centre) + shares[1] for centre in np.eye(3)[:2]]
    return ConvexProblem(shares, costs, [shares >= 0, cp.sum(shares) == 1])


def network() -> DecisionProblem:
    return dispatch_problem(load_ieee_30_bus(), [5], [[5.0], [15.0]])


def maker_of(problem: DecisionProblem) -> CounterAdversarialDecisionMaker:
    """With few candidates, and in `make audit` with its own."""
    return CounterAdversarialDecisionMaker(
        problem, budget=0.1, candidates=None if audited() else decoy_grid(problem, 8)
    )


@pytest.mark.parametrize(
    ("made", "copied"),
    paired([smooth, with_kinks, network], [copy.deepcopy, lambda given: pickle.loads(pickle.dumps(given))]),
)
def test_a_copy_decides_as_the_first(made: Callable[[], DecisionProblem], copied: Callable[[Any], Any]) -> None:
    problem, belief = made(), [0.4, 0.6]
    found = maker_of(problem).decide(belief)  # stores what it compiles
    again = maker_of(copied(problem)).decide(belief)
    np.testing.assert_allclose(again.action, found.action, atol=1e-9)
    assert copied(found).regret == found.regret
    assert copied(found).belief_set.contains(found.belief_set.interior_point())


def test_what_an_observer_learned_can_be_pickled() -> None:
    observer = CostLearningAdversary.risk_aversion([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], (0.5, 2.0))
    found = observer.learn([[0.55, 0.45]])
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.intervals, found.intervals)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(observer)).learn([[0.55, 0.45]]).intervals, found.intervals)
    beliefs = found.consistent_beliefs([0.55, 0.45])
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(beliefs)).bounds(), beliefs.bounds())
