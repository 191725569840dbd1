"""Costs stated in CVXPY with decisions in dollars, redundant rows, and rows beside large constants."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest

from inscrutable import Budget, ConvexProblem, CounterAdversarialDecisionMaker, consistent_beliefs, decoy_grid

cp = pytest.importorskip("cvxpy")

FRESH = int(os.environ.get("FRESH_SEED", "20260101"))
BELIEF = [0.4, 0.6]


def traded(wealth: float, seed: int) -> ConvexProblem:
    """Risk, returns and 5 % of turnover, of holdings in units of 1 / wealth."""
    rng = np.random.default_rng(seed)
    risks, returns = rng.normal(size=(2, 3, 3)), rng.normal(size=(2, 3))
    held = cp.Variable(3)
    shares = held / wealth
    costs = [
        cp.sum_squares(risks[i] @ shares) - returns[i] @ shares + 0.05 * cp.norm1(shares - 1 / 3) for i in range(2)
    ]
    return ConvexProblem(held, costs, [held >= 0, cp.sum(held) == wealth])


@pytest.mark.parametrize("wealth", [1e-5, 1e4, 1e6, 1e9])
def test_decisions_in_dollars_are_those_in_shares(wealth: float) -> None:
    """The solver's tolerances are for numbers near one: holdings of a million cost 2 % more, those of a billion anything."""
    one, other = traded(1.0, FRESH), traded(wealth, FRESH)
    decision = other.solve(BELIEF)
    np.testing.assert_allclose(decision / wealth, one.solve(BELIEF), atol=2e-4)
    assert other.optimal_cost(BELIEF) == pytest.approx(float(one.optimal_cost(BELIEF)), abs=2e-8)
    assert consistent_beliefs(other, decision).distance(BELIEF) <= 1e-6
    if wealth < 1.0:  # `min_slack` is in the unit of decisions
        return
    maker = CounterAdversarialDecisionMaker(other, budget=Budget.regret(0.002), candidates=decoy_grid(other, 8))
    hidden = maker.decide(BELIEF)
    assert one.regret(BELIEF, hidden.action / wealth) <= 0.002 + 1e-7
    assert consistent_beliefs(other, hidden.action).distance(BELIEF) == pytest.approx(hidden.privacy, abs=1e-6)
    assert hidden.privacy > 0.0


@pytest.mark.parametrize("rows", ["a pair of inequalities", "redundant bounds"])
def test_redundant_rows_change_no_decision(rows: str) -> None:
    rng = np.random.default_rng(FRESH)
    for _ in range(4):
        tilts, held = 3.0 * rng.normal(size=(2, 3, 3)), cp.Variable(3)
        plain = [cp.sum(held) == 1, held >= 0]
        more: dict[str, list[Any]] = {
            "a pair of inequalities": [cp.sum(held) <= 1, cp.sum(held) >= 1, held >= 0],
            "redundant bounds": [*plain, cp.sum(held) <= 1, held <= 1],
        }
        costs = [cp.log_sum_exp(tilt @ held) for tilt in tilts]
        one, other = (ConvexProblem(held, costs, limits) for limits in (plain, more[rows]))
        for belief in ([0.3, 0.7], [0.9, 0.1]):
            decision = other.solve(belief)
            np.testing.assert_allclose(decision, one.solve(belief), atol=1e-9)
            assert consistent_beliefs(other, decision).distance(belief) <= 1e-6


def test_rows_beside_large_constants_keep_their_digits() -> None:
    prices, wealth, bought = np.array([0.1, 0.3]), 3e10 + 0.37, cp.Variable(2)
    limits = [wealth - prices @ bought >= 0, bought >= 0]
    problem = ConvexProblem(bought, [-bought[0], -bought[1]], limits)
    np.testing.assert_array_equal(np.abs(problem.constraints.A_ub[0]), prices)
    assert prices @ problem.solve([1.0, 0.0]) == pytest.approx(wealth, rel=1e-12)


def test_rows_of_a_matrix_come_in_the_order_of_their_names() -> None:
    """An expression in a matrix has its rows column by column, as CVXPY lists its slopes."""
    u = cp.Variable(4)
    above = cp.reshape(u, (2, 2), order="C") - np.array([[0.1, 0.2], [0.3, 0.4]]) >= 0
    problem = ConvexProblem(u, [cp.sum(u), cp.sum_squares(u)], [above, u <= 1])
    np.testing.assert_allclose(problem.solve([1.0, 0.0]), [0.1, 0.2, 0.3, 0.4], atol=1e-9)


def test_smooth_costs_take_limits_on_magnitudes() -> None:
    u = cp.Variable(2)
    problem = ConvexProblem(u, [cp.sum(cp.exp(u)), cp.sum(cp.exp(-u))], [cp.norm1(u) <= 1])
    np.testing.assert_allclose(problem.solve([1.0, 0.0]), [-0.5, -0.5], atol=1e-6)
    np.testing.assert_allclose(problem.solve([0.5, 0.5]), [0.0, 0.0], atol=1e-4)


def test_bounds_of_a_variable_may_be_constants_of_cvxpy() -> None:
    u = cp.Variable(2, bounds=[cp.Constant(0.0), np.array([1.0, 0.7])])
    np.testing.assert_allclose(ConvexProblem(u, [-cp.sum(u)], []).solve([1.0]), [1.0, 0.7], atol=1e-9)


@pytest.mark.parametrize("scale", [1e6, 1e8])
def test_large_costs_on_a_bounded_set_have_a_minimum(scale: float) -> None:
    """Clarabel takes some of them for costs without one."""
    rng = np.random.default_rng(0)
    for _ in range(6):
        tilts, u = rng.normal(size=(3, 4, 3)), cp.Variable(3)
        kinds = [cp.max(tilts[0] @ u), cp.norm(tilts[1] @ u - 1), cp.sum(cp.huber(tilts[2] @ u - 1))]
        one, other = (ConvexProblem(u, [s * kind for kind in kinds], [cp.norm_inf(u) <= 1]) for s in (1.0, scale))
        for belief in np.vstack([np.eye(3), np.full(3, 1 / 3)]):
            assert other.optimal_cost(belief) == pytest.approx(
                scale * float(one.optimal_cost(belief)), rel=1e-5, abs=1e-5 * scale
            )
