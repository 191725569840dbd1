"""Decisions of a private mean against CVXPY, factors against the matrix they stand for, and sets of bounds against rows."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import cvxpy
import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    AlphaDecisionMaker,
    AlphaProblem,
    FactorRisk,
    InputError,
    ModelError,
    Polyhedron,
    box,
    max_weights,
    simplex,
)

N, GAMMA = 8, 2.0


def risk_of(rng: np.random.Generator, n: int = N, k: int = 3) -> FactorRisk:
    return FactorRisk(rng.normal(size=(n, k)), np.diag(rng.uniform(0.5, 2.0, k)), rng.uniform(0.5, 2.0, n))


def test_factors_stand_for_their_matrix(fresh_rng: np.random.Generator) -> None:
    risk = risk_of(fresh_rng)
    matrix, columns = risk.dense(), fresh_rng.normal(size=(N, 3))
    np.testing.assert_allclose(
        matrix, risk.exposures @ risk.factor_covariance @ risk.exposures.T + np.diag(risk.specific)
    )
    np.testing.assert_allclose(risk.times(columns), matrix @ columns, rtol=1e-12)
    np.testing.assert_allclose(risk.solve(columns), np.linalg.solve(matrix, columns), rtol=0, atol=1e-12)
    np.testing.assert_allclose(risk.solve(columns[:, 0]), np.linalg.solve(matrix, columns[:, 0]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(risk.quadratic(columns), np.diag(columns.T @ matrix @ columns), rtol=1e-12)
    some = np.array([1, 4, 6])
    np.testing.assert_allclose(risk.part(some).dense(), matrix[np.ix_(some, some)], rtol=1e-12)
    np.testing.assert_allclose(risk.with_more(columns, 0.5).dense(), matrix + columns @ columns.T + 0.5 * np.eye(N))


@pytest.mark.parametrize("kind", ["free", "budget", "caps", "rows", "fixed"])
def test_decisions_are_those_of_cvxpy(kind: str, fresh_rng: np.random.Generator) -> None:
    rng = fresh_rng
    risk, mean = risk_of(rng), rng.normal(size=2)
    loads = rng.normal(size=(N, 2))
    neutral = Polyhedron(A_eq=np.vstack([np.ones(N), risk.exposures[:, 0]]), b_eq=[0.5, 0.05])
    group = Polyhedron(A_ub=[[1.0] * 4 + [0.0] * 4, [0.0] * 3 + [-1.0] * 5], b_ub=[0.3, -0.2])
    regions: dict[str, Polyhedron | None] = {
        "free": None,
        "budget": Polyhedron(A_eq=np.ones((1, N)), b_eq=[1.0]),
        "caps": simplex(N) & box(np.zeros(N), np.full(N, 0.3)),
        "rows": neutral & group & box(np.full(N, -0.3), np.full(N, 0.4)),
        "fixed": simplex(N) & box(np.r_[0.1, np.zeros(N - 1)], np.r_[0.1, np.full(N - 1, 0.4)]),
    }
    region, held = regions[kind], cvxpy.Variable(N)
    cost = GAMMA * cvxpy.sum_squares(np.linalg.cholesky(risk.dense()).T @ held) - (loads @ mean) @ held
    rows: list[Any] = [] if region is None else [region.A_ub @ held <= region.b_ub, region.A_eq @ held == region.b_eq]
    least = cvxpy.Problem(cvxpy.Minimize(cost), rows).solve(solver="CLARABEL")
    for given in (risk, risk.dense()):
        problem = AlphaProblem(given, GAMMA, region, loads)
        found = problem.optimum(mean)
        spent = GAMMA * found @ risk.dense() @ found - (loads @ mean) @ found
        assert spent == pytest.approx(least, abs=1e-6)
        assert region is None or region.violation(found) <= 1e-9
        other = problem.optimum(mean + 0.3 * rng.normal(size=2))
        lost = GAMMA * other @ risk.dense() @ other - (loads @ mean) @ other - spent
        assert problem.regret(mean, other) == pytest.approx(lost, abs=1e-9)
        np.testing.assert_allclose(problem.theta_times(np.eye(2)), problem.theta, rtol=0, atol=1e-12)


def test_theta_is_what_deciding_for_another_mean_costs(fresh_rng: np.random.Generator) -> None:
    rng = fresh_rng
    risk, loads = risk_of(rng), rng.normal(size=(N, 3))
    equalities = Polyhedron(A_eq=rng.normal(size=(2, N)), b_eq=rng.normal(size=2))
    for region in (None, equalities):
        for given in (risk, risk.dense()):
            problem = AlphaProblem(given, GAMMA, region, loads)
            mean, other = rng.normal(size=(2, 3))
            lost = (other - mean) @ problem.theta @ (other - mean)
            assert problem.regret(mean, problem.optimum(other)) == pytest.approx(lost, rel=1e-9)
    capped = AlphaProblem(risk, GAMMA, equalities & box(np.full(N, -5.0), np.full(N, 5.0)), loads)
    means = rng.normal(size=(20, 2, 3))
    for mean, other in means:
        assert capped.regret(mean, capped.optimum(other)) <= (other - mean) @ capped.theta @ (other - mean) + 1e-9


def test_bad_problems_are_refused() -> None:
    with pytest.raises(ModelError, match="risk is indefinite: smallest eigenvalue -1"):
        AlphaProblem([[1.0, 2.0], [2.0, 1.0]], 1.0)
    with pytest.raises(ModelError, match=r"specific is 0 at asset 1 \(Oil\)"):
        FactorRisk(pd.DataFrame([[1.0], [2.0]], ["Food", "Oil"]), [[1.0]], [0.1, 0.0])
    with pytest.raises(ModelError, match=r"factor_covariance is indefinite: smallest eigenvalue -0\.5"):
        FactorRisk([[1.0], [2.0]], [[-0.5]], [0.1, 0.1])
    with pytest.raises(ModelError, match="the risk is singular"):
        AlphaProblem(np.ones((2, 2)), 1.0).optimum([1.0, 2.0])
    with pytest.raises(InputError, match="n_factors is 3, expected at most 2"):
        FactorRisk.from_returns(np.eye(3), 3)
    with pytest.raises(InputError, match="mean has 3 entries, expected one per signal: 2"):
        AlphaProblem(np.eye(2), 1.0).optimum([1.0, 2.0, 3.0])
    for means, weights in ((np.zeros((3, 2)), np.zeros((2, 2))), (np.zeros((0, 2)), np.zeros((2, 2)))):
        with pytest.raises(InputError, match=rf"mean has {len(means)} rows and weights 2; expected as many"):
            AlphaProblem(np.eye(2), 1.0).regret(means, weights)
    with pytest.raises(InputError, match="other asset labels"):
        AlphaProblem(pd.DataFrame(np.eye(2), ["A", "B"], ["A", "B"]), 1.0, max_weights(["A", "C"], 0.5))


def test_a_singular_risk_decides_where_its_constraints_let_it() -> None:
    # Two assets that are one: the budget alone leaves a tie, bounds do not change the cost.
    problem = AlphaProblem(np.ones((2, 2)), 1.0, simplex(2))
    found = problem.optimum([0.0, 0.1])
    assert found.tolist() == [0.0, 1.0]
    # A budget leaves the exchange of one for the other, which has no risk: a gain in it is unbounded, a tie stays one.
    for scale in (1e-6, 0.04, 1.0, 1e6):
        alike = AlphaProblem(np.full((2, 2), scale), 1.0, Polyhedron(A_eq=[[1.0, 1.0]], b_eq=[1.0]))
        with pytest.raises(ModelError, match="the risk is singular"):
            alike.optimum([0.02, 0.01])
        np.testing.assert_allclose(alike.optimum([0.02, 0.02]), [0.5, 0.5])
        three = np.array([[1.0, 1.0, 0.3], [1.0, 1.0, 0.3], [0.3, 0.3, 2.0]]) * scale
        copied = AlphaProblem(three, 1.0, Polyhedron(A_eq=[[1.0, 1.0, 1.0]], b_eq=[1.0]))
        single = AlphaProblem(three[1:, 1:], 1.0, Polyhedron(A_eq=[[1.0, 1.0]], b_eq=[1.0]))
        found, wanted = copied.optimum([0.02, 0.02, 0.05]), single.optimum([0.02, 0.05])
        np.testing.assert_allclose([found[0] + found[1], found[2]], wanted, rtol=1e-9)
        with pytest.raises(ModelError, match="the risk is singular"):
            copied.optimum([0.02, 0.01, 0.05])
    flat = AlphaProblem(np.diag([1.0, 0.0]), 0.5, Polyhedron(A_eq=[[0.0, 1.0]], b_eq=[2.0]))
    np.testing.assert_allclose(flat.optimum([3.0, 7.0]), [3.0, 2.0])


@pytest.mark.parametrize(("count", "rows"), [(6, 4), (3, 2), (5, 5), (12, 12), (40, 40), (30, 31)])
def test_covariances_of_too_few_rows_are_singular_in_every_unit(
    count: int, rows: int, fresh_rng: np.random.Generator
) -> None:
    """Rounding let half of them pass, with weights of 1e15."""
    for scale in (1.0, 1e-8):
        units = np.append(np.ones(count - 1), scale)
        returns = 0.02 * fresh_rng.normal(size=(rows, count)) * units
        if rows > count:  # the last asset is the mean of the others
            returns[:, -1] = scale * returns[:, :-1].mean(axis=1)
        problem = AlphaProblem(np.cov(returns.T), 2.5)
        with pytest.raises(ModelError, match="the risk is singular"):
            problem.optimum(0.01 * units)
        with pytest.raises(ModelError, match="the risk is singular"):
            _ = AlphaDecisionMaker(problem, 0.5, prior_covariance=np.diag(units**2)).silence_regret
    apart = 0.02 * fresh_rng.normal(size=(2 * count, count)) * np.geomspace(1.0, 1e-6, count)
    matrix = np.cov(apart.T)
    found = AlphaProblem(matrix, 2.5).optimum(matrix @ np.ones(count))
    np.testing.assert_allclose(found, np.full(count, 0.2), rtol=1e-6)


def test_bounds_are_the_rows_that_they_stand_for(fresh_rng: np.random.Generator) -> None:
    low, high = -fresh_rng.uniform(size=5), fresh_rng.uniform(size=5)
    high[2], low[4] = np.inf, -np.inf
    names = list("edcba")
    bounds = simplex(5) & box(pd.Series(low, names), pd.Series(high, names)) & max_weights(names, 0.6)
    rows = Polyhedron(bounds.A_ub, bounds.b_ub, bounds.A_eq, bounds.b_eq, names=bounds.names, asset_names=names)
    plain = Polyhedron(-np.eye(5), np.zeros(5), np.ones((1, 5)), [1.0], names=simplex(5).names)
    caps = Polyhedron(np.vstack([-np.eye(5), np.eye(5)]), np.r_[-low, high], names=[f"r{i}" for i in range(10)])
    whole = plain & caps & Polyhedron(np.eye(5), np.full(5, 0.6))
    assert np.array_equal(whole.A_ub, bounds.A_ub)
    assert np.array_equal(whole.b_ub, bounds.b_ub)
    for copied in (pickle.loads(pickle.dumps(bounds)), copy.deepcopy(bounds)):
        assert np.array_equal(copied.A_ub, rows.A_ub)
    points = fresh_rng.normal(size=(20, 5))
    np.testing.assert_array_equal(bounds.slacks(points), rows.slacks(points))
    np.testing.assert_array_equal(bounds.coordinate_bounds, rows.coordinate_bounds)
    np.testing.assert_array_equal(bounds.violation(points), rows.violation(points))
    assert len(bounds.general_rows.sides) == len(rows.general_rows.sides) == 0
    problem = AlphaProblem(pd.DataFrame(np.diag(np.arange(1.0, 6.0)), sorted(names), sorted(names)), 1.0, bounds)
    assert problem.constraints is not None
    np.testing.assert_array_equal(problem.constraints.A_ub, bounds.A_ub[:, ::-1])
    tight = simplex(3) & box(np.zeros(3), np.full(3, 0.2))
    with pytest.raises(ModelError, match="cannot hold together"):
        tight.check_feasible()
    with pytest.raises(AttributeError, match="no attribute 'b_lb'"):
        _ = tight.b_lb  # type: ignore[attr-defined]


@pytest.mark.parametrize("count", [1, 2])
def test_equalities_that_fix_the_decision_leave_nothing_to_reveal(count: int, fresh_rng: np.random.Generator) -> None:
    sides = fresh_rng.normal(size=count)
    problem = AlphaProblem(0.04 * np.eye(count), 2.0, Polyhedron(A_eq=np.eye(count), b_eq=sides))
    assert not problem.theta.any()
    np.testing.assert_allclose(problem.optimum(fresh_rng.normal(size=count)), sides, atol=1e-12)
    maker = AlphaDecisionMaker(problem, 0.5, prior_covariance=1e-4 * np.eye(count))
    np.testing.assert_allclose(maker.decide(fresh_rng.normal(size=count), rng=fresh_rng).action, sides, atol=1e-12)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e6])
@pytest.mark.parametrize("kind", ["long-only", "loose caps", "caps", "a rest"])
def test_the_unit_of_many_weights_changes_no_decision(unit: float, kind: str) -> None:
    """Decisions over more than 60 assets with small weights were far from the best: their tolerances were absolute."""
    rng = np.random.default_rng(0)
    count = 150
    risk = FactorRisk(0.05 * rng.normal(size=(count, 3)), np.eye(3), rng.uniform(0.001, 0.02, count))
    means, whole, ones = 0.02 * rng.normal(size=count), np.eye(count), np.ones((1, count))
    first = whole[:1]

    def best(size: float) -> Any:
        cap = size * np.ones(count)
        limits = {
            "long-only": Polyhedron(-whole, 0.0 * cap, ones, [size]),
            "loose caps": Polyhedron(np.vstack([-whole, whole]), np.concatenate([0.0 * cap, 1e3 * cap]), ones, [size]),
            "caps": Polyhedron(np.vstack([-whole, whole]), np.concatenate([cap, cap]), ones, [0.0]),
            "a rest": Polyhedron(
                np.vstack([-whole, first]), np.append(0.0 * cap, 0.0), ones, [size]
            ),  # its row has no other
        }
        return AlphaProblem(risk, 2.5, limits[kind]).optimum(size * means) / size

    np.testing.assert_allclose(best(unit), best(1.0), atol=1e-9)
