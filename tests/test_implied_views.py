"""Implied views against lifted cone programmes, closed forms and forward solves."""

from __future__ import annotations

import itertools
import resource
from typing import Any

import cvxpy
import numpy as np
import pandas as pd
import pytest
from scipy.optimize import linprog
from threadpoolctl import threadpool_limits

from inscrutable import (
    AlphaProblem,
    Budget,
    DesiredObfuscation,
    FactorRisk,
    Infeasibility,
    InputError,
    MaximalObfuscation,
    ModelError,
    NonExistence,
    NonUniqueness,
    Polyhedron,
    ViewStatus,
    box,
    implied_views,
    obfuscated_decision,
    simplex,
)
from inscrutable.alphas import obfuscation
from sizes import instances, some

Array = Any
N, GAMMA = 6, 1.7
CASES = list(itertools.product(["free", "budget", "caps", "sector", "neutral"], [None, 0.05]))


def risk_of(rng: np.random.Generator, n: int = N, k: int = 2) -> FactorRisk:
    return FactorRisk(rng.normal(size=(n, k)), np.diag(rng.uniform(0.5, 2.0, k)), rng.uniform(0.5, 2.0, n))


def neutral_row(rng: np.random.Generator) -> Array:
    """Draw the sensitivities of N assets to a factor until portfolios within -.5 and .7 reach .1."""
    while True:
        row = rng.normal(size=N)
        least, most = (s * linprog(s * row, None, None, np.ones((1, N)), [1.0], (-0.5, 0.7)).fun for s in (1.0, -1.0))
        if least < 0.1 < most:
            return row


def regions(rng: np.random.Generator) -> dict[str, Polyhedron | None]:
    budget = Polyhedron(A_eq=np.ones((1, N)), b_eq=[1.0])
    caps = simplex(N) & box(np.zeros(N), np.full(N, 0.4))
    sector = Polyhedron(A_ub=[[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]], b_ub=[0.3])
    neutral = Polyhedron(A_eq=np.vstack([np.ones(N), neutral_row(rng)]), b_eq=[1.0, 0.1])
    bounds = box(np.full(N, -0.5), np.full(N, 0.7))
    return {"free": None, "budget": budget, "caps": caps, "sector": caps & sector, "neutral": neutral & bounds}


class Lifted:
    """The views of weights written down with multipliers and a changed decision, for CVXPY."""

    def __init__(
        self, covariance: Array, region: Polyhedron | None, loads: Array, weights: Array, regret: float
    ) -> None:
        self.view = cvxpy.Variable(loads.shape[1])
        moved = cvxpy.Variable(len(covariance))
        told: Any = 2.0 * GAMMA * covariance @ (weights + moved)
        spent: Any = GAMMA * cvxpy.sum_squares(np.linalg.cholesky(covariance).T @ moved)
        self.rows: list[Any] = [] if regret else [moved == 0]
        if region is not None:
            slack = np.where(region.b_ub - region.A_ub @ weights < 1e-9, 0.0, region.b_ub - region.A_ub @ weights)
            pushed = cvxpy.Variable(len(slack), nonneg=True)
            told = told + region.A_eq.T @ cvxpy.Variable(len(region.b_eq)) + region.A_ub.T @ pushed
            spent = spent + slack @ pushed
            self.rows += [] if regret else [cvxpy.multiply(slack, pushed) == 0]
        self.rows += [loads @ self.view == told, *([spent <= regret] if regret else [])]
        # Rows alone may leave a thin region, at which a cone solver fails.
        exact: Any = {"solver": "PIQP", "eps_abs": 1e-14, "eps_rel": 1e-14}
        self.linear, self.square = ({"solver": "CLARABEL"},) * 2 if regret else ({"solver": "SCIPY"}, exact)

    def most(self, direction: Array, limit: float = 1e3) -> float:
        """The greatest d'm; infinite beyond a limit."""
        ask = cvxpy.Problem(cvxpy.Maximize(direction @ self.view), [*self.rows, direction @ self.view <= limit])
        ask.solve(**self.linear)
        return np.inf if ask.value > 0.99 * limit else float(ask.value)

    def distance(self, mean: Array) -> float:
        ask = cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(self.view - mean)), self.rows)
        ask.solve(**self.square)
        return float(np.sqrt(max(ask.value, 0.0)))


@pytest.mark.parametrize(
    ("name", "regret"), some(list(itertools.product(["free", "budget", "caps", "sector", "neutral"], [None, 0.05])), 5)
)
def test_bounds_and_distances_are_those_of_lifted_programmes(
    name: str, regret: float | None, fresh_rng: np.random.Generator
) -> None:
    rng = fresh_rng
    region, risk = regions(rng)[name], risk_of(rng)
    for loads in (None, rng.normal(size=(N, 2)), rng.normal(size=(N, N + 2))):
        problem = AlphaProblem(risk, GAMMA, region, loads)
        full = np.eye(N) if loads is None else loads
        mean = rng.normal(size=problem.n_signals)
        weights = problem.optimum(mean)
        lifted = Lifted(risk.dense(), region, full, weights, regret or 0.0)
        for reference in (None, 2):
            views = implied_views(problem, weights, regret=regret, reference=reference)
            direction = full[0] - (0.0 if reference is None else full[2])
            low, high = views.interval(0)
            assert high == pytest.approx(lifted.most(direction), abs=2e-4, rel=1e-3)
            assert low == pytest.approx(-lifted.most(-direction), abs=2e-4, rel=1e-3)
        other = mean + rng.normal(size=len(mean))
        assert views.distance(other) == pytest.approx(lifted.distance(other), abs=2e-4)
        assert views.contains(mean)
        nearest = np.asarray(views.nearest(other))
        assert views.contains(nearest)
        assert not views.contains(nearest + 0.01 * (other - nearest)) or views.distance(other) < 1e-9
        assert not views.contains(other) or views.distance(other) < 1e-9


@pytest.mark.parametrize("size", [0.0, 1e-9, 1.0])
@pytest.mark.parametrize("far", [1e-9, 1.0, 1e6])
def test_the_nearest_view_is_a_member_at_every_scale(size: float, far: float, fresh_rng: np.random.Generator) -> None:
    """Without limits one view of all assets explains weights; of more signals than assets a subspace does."""
    rng, risk = fresh_rng, risk_of(fresh_rng)
    for region in regions(rng).values():
        for loads in (None, rng.normal(size=(N, 2)), rng.normal(size=(N, N + 2))):
            problem = AlphaProblem(risk, GAMMA, region, loads)
            weights = problem.optimum(size * rng.normal(size=problem.n_signals))
            views, other = implied_views(problem, weights), far * rng.normal(size=problem.n_signals)
            nearest = views.nearest(other)
            assert views.contains(nearest)
            if region is None and (loads is None or loads.shape[1] > N):
                full = np.eye(N) if loads is None else loads
                told = other + np.linalg.pinv(full) @ (2.0 * GAMMA * risk.dense() @ weights - full @ other)
                np.testing.assert_allclose(nearest, told, rtol=0, atol=1e-9 * max(size, far))


def test_a_limit_that_others_imply_takes_no_view_away() -> None:
    """Of 400 means whose best weights are at such a vertex 113 were denied, at a distance of rounding."""
    rng = np.random.default_rng(0)
    loads = 0.04 * rng.normal(size=(3, 3))
    caps = simplex(3) & box(np.zeros(3), np.full(3, 0.4)) & Polyhedron(A_ub=[[1.0, 1.0, 0.0]], b_ub=[0.6])
    problem = AlphaProblem(loads @ loads.T + 1e-3 * np.eye(3), 5.0, caps)
    means = 0.05 * rng.normal(size=(200, 3))
    tight = [(mean, held) for mean in means if (held := problem.optimum(mean))[2] > 0.4 - 1e-9]
    assert len(tight) > 50
    for mean, held in tight:
        views = implied_views(problem, held)
        assert views.contains(mean)
        assert views.distance(mean) <= 1e-12


def test_the_nearest_view_under_many_tight_limits_is_that_of_a_lifted_programme() -> None:
    """Where one multiplier moves what two assets leave, from one to the other, the whole step gained nothing and was taken."""
    views = implied_views(AlphaProblem(np.diag([0.04, 0.01]), 2.5, simplex(2)), [1.0, 0.0])
    near = views.nearest(np.array([0.19, 0.0]))  # of the views (0.2, 0) + t, less for the second
    np.testing.assert_allclose(near, [0.195, -0.005], rtol=0, atol=1e-12)
    for seed in range(instances(12, least=4)):
        rng = np.random.default_rng(seed)
        weights = rng.integers(0, 3, N) + np.eye(N)[0]
        weights /= weights.sum()
        groups = rng.integers(0, 2, (3, N)).astype(float) + np.eye(3, N)
        region = simplex(N) & Polyhedron(A_ub=groups, b_ub=groups @ weights)
        risk = risk_of(rng)
        problem, lifted = AlphaProblem(risk, GAMMA, region), Lifted(risk.dense(), region, np.eye(N), weights, 0.0)
        views = implied_views(problem, weights)
        for apart in rng.integers(-1, 2, (4, N)).astype(float):
            asked = 2.0 * GAMMA * risk.times(weights) + apart
            assert views.distance(asked) == pytest.approx(lifted.distance(asked), rel=1e-6, abs=1e-6)
            assert views.contains(views.nearest(asked))


def test_an_end_along_a_ray_is_infinite_in_every_unit(fresh_rng: np.random.Generator) -> None:
    for rng in (np.random.default_rng(2380298458), fresh_rng):
        region, risk = regions(rng)["neutral"], risk_of(rng)
        _, loads, _ = rng.normal(size=(N, 2)), rng.normal(size=(N, N + 2)), rng.normal(size=2 * N + 4)
        mean = rng.normal(size=N + 2)
        for unit in (1e-5, 1.0, 1e5):
            problem = AlphaProblem(risk, GAMMA, region, unit * loads)
            weights = problem.optimum(mean / unit)
            for reference in (None, 2):
                # Signals move all assets apart, by multiples of the second equality too, and no decision shows it.
                views = implied_views(problem, weights, regret=0.05, reference=reference)
                assert views.interval(0) == (-np.inf, np.inf)


@pytest.mark.parametrize("limits", [False, True])
def test_views_within_a_regret_are_the_same_in_every_unit(limits: bool, fresh_rng: np.random.Generator) -> None:
    """A signal with loadings of 1e-7 of another's was left out."""
    loads, mean = fresh_rng.normal(size=(3, 2)), fresh_rng.normal(size=2)
    region = box(np.full(3, -50.0), np.full(3, 50.0)) if limits else None
    theta = AlphaProblem(np.eye(3) * 0.04, 2.5, loadings=loads).theta
    width = np.sqrt(1e-3 * np.diag(np.linalg.inv(theta)))  # of the ellipsoid (m − m̂)'Θ(m − m̂) ≤ r
    shown = np.sqrt(1e-3 * np.diag(loads @ np.linalg.inv(theta) @ loads.T))
    for unit in (1.0, 1e-5, 1e-7, 1e-9, 1e7):
        units = np.array([1.0, unit])
        problem = AlphaProblem(np.eye(3) * 0.04, 2.5, region, loadings=loads * units)
        weights = problem.optimum(mean / units)
        views = implied_views(problem, weights, regret=1e-3)
        ends = np.column_stack([mean - width, mean + width])
        np.testing.assert_allclose(views.bounds * units[:, None], ends, rtol=1e-4, atol=1e-6)
        ends = np.column_stack([loads @ mean - shown, loads @ mean + shown])
        np.testing.assert_allclose(views.asset_bounds, ends, rtol=1e-4, atol=1e-6)
        assert views.contains(mean / units)


def test_programmes_at_the_border_of_a_region_overflow_nothing() -> None:
    rng = np.random.default_rng(2380298458)
    region, risk, loads = regions(rng)["sector"], risk_of(rng), rng.normal(size=(N, 2))
    rng.normal(size=N * (N + 2) + 2 * N)
    problem = AlphaProblem(risk, GAMMA, region, loads)
    weights = problem.optimum(rng.normal(size=2))
    found = implied_views(problem, weights, regret=0.05, reference=2).interval(0)
    lifted, direction = Lifted(risk.dense(), region, loads, weights, 0.05), loads[0] - loads[2]
    np.testing.assert_allclose(found, [-lifted.most(-direction), lifted.most(direction)], rtol=1e-3)


def test_unconstrained_views_are_the_products_of_risk_and_weights(fresh_rng: np.random.Generator) -> None:
    risk = risk_of(fresh_rng)
    weights = fresh_rng.normal(size=N)
    for given in (risk, risk.dense()):
        views = implied_views(AlphaProblem(given, GAMMA), weights)
        told = 2.0 * GAMMA * risk.dense() @ weights
        assert views.status is ViewStatus.POINT
        assert views.dimension == 0
        np.testing.assert_allclose(views.bounds, np.column_stack([told, told]), rtol=0, atol=1e-10)
        np.testing.assert_allclose(views.nearest(np.zeros(N)), told, rtol=0, atol=1e-10)
    wide = implied_views(AlphaProblem(risk, GAMMA), weights, regret=0.01)
    reach = np.sqrt(4.0 * GAMMA * 0.01 * np.diag(risk.dense()))
    # An end may be near zero: its rounding is that of the two terms.
    rounding = 1e-12 * (np.abs(told) + reach)[:, None]
    assert (np.abs(wide.bounds - np.column_stack([told - reach, told + reach])) <= rounding).all()


def test_a_budget_leaves_a_common_shift_free() -> None:
    problem = AlphaProblem(np.diag([0.04, 0.01, 0.02]), 2.5, simplex(3))
    views = implied_views(problem, [0.5, 0.5, 0.0])
    assert views.status is ViewStatus.POLYHEDRON
    assert views.dimension == 2
    assert np.isinf(views.bounds).all()
    relative = implied_views(problem, [0.5, 0.5, 0.0], reference="portfolio").bounds
    np.testing.assert_allclose(relative[:2], [[0.0375, 0.0375], [-0.0375, -0.0375]], atol=1e-15)
    assert relative[2].tolist() == [-np.inf, pytest.approx(-0.0625)]
    # A weight at its bound says one side; a shift changes nothing.
    held = np.array([0.1, 0.025, -0.3])
    assert views.contains(held)
    assert views.contains(held + 7.0)
    assert not views.contains([0.1, 0.025, 0.1])
    named = implied_views(problem, [0.5, 0.5, 0.0], reference=1)
    assert named.bounds[0] == pytest.approx([0.075, 0.075])
    assert named.bounds[1].tolist() == [0.0, 0.0]


def test_a_weight_near_its_limit_may_hide_a_view_far_beyond() -> None:
    problem = AlphaProblem(np.eye(2), 0.5, box(np.zeros(2), np.ones(2)))
    views = implied_views(problem, [0.01, 0.5], regret=0.1)
    low, high = views.interval(0)
    # For so low a view nothing is best, and 0.01 costs 0.5·0.01² − 0.01 m more.
    assert low == pytest.approx(0.005 - 10.0, rel=1e-12)
    assert problem.regret([low, 0.5], [0.01, 0.5]) == pytest.approx(0.1, rel=1e-12)
    assert problem.regret([high, 0.5], [0.01, 0.5]) == pytest.approx(0.1, rel=1e-12)


def test_weights_that_no_signal_explains() -> None:
    problem = AlphaProblem(np.eye(3), 0.5, loadings=[[1.0], [1.0], [0.0]])
    views = implied_views(problem, [1.0, 3.0, 0.0])
    assert views.status is ViewStatus.EMPTY
    assert views.dimension == -1
    assert views.is_empty
    assert np.isnan(views.bounds).all()
    assert views.distance([0.0]) == np.inf
    np.testing.assert_allclose(views.nearest([0.0]), [2.0])  # least squares of (m, m, 0) against (1, 3, 0)
    assert views.plausibility_gap == pytest.approx(1.0)  # half of (1 − 2)² + (3 − 2)²
    within = implied_views(problem, [1.0, 3.0, 0.0], regret=1.5)
    # ½|(1,3,0) − (m,m,0)|² ≤ 1.5
    np.testing.assert_allclose(within.bounds, [[2.0 - np.sqrt(0.5), 2.0 + np.sqrt(0.5)]])
    assert implied_views(problem, [1.0, 3.0, 0.0], regret=0.9).is_empty


def test_more_signals_than_assets_leave_a_subspace(fresh_rng: np.random.Generator) -> None:
    loads = fresh_rng.normal(size=(2, 5))
    problem = AlphaProblem(np.eye(2), 1.0, loadings=loads)
    mean = fresh_rng.normal(size=5)
    views = implied_views(problem, problem.optimum(mean))
    assert views.status is ViewStatus.SUBSPACE
    assert views.dimension == 3
    hidden = np.linalg.svd(loads)[2][2:].T @ fresh_rng.normal(size=3)
    assert views.contains(mean + hidden)
    assert np.isinf(views.bounds).all()
    np.testing.assert_allclose(views.asset_bounds, np.repeat((loads @ mean)[:, None], 2, axis=1), atol=1e-7)


@pytest.mark.parametrize("name", ["free", "caps", "sector"])
def test_what_rounded_weights_say_holds_all_that_rounds_to_them(name: str, fresh_rng: np.random.Generator) -> None:
    rng = fresh_rng
    for loads in (None, rng.normal(size=(N, 2))):
        problem = AlphaProblem(risk_of(rng), GAMMA, regions(rng)[name], loads)
        mean = rng.normal(size=problem.n_signals)
        shown = problem.optimum(mean).round(2)
        views = implied_views(problem, shown, digits=2, reference=1)
        assert views.status is ViewStatus.OUTER
        assert views.contains(mean)
        assert views.plausibility_gap == 0.0
        full = np.eye(N) if loads is None else loads
        found = 0
        for _ in range(60):
            other = mean + 0.01 * rng.normal(size=len(mean))
            same = bool(np.abs(problem.optimum(other) - shown).max() <= 0.005)
            assert views.contains(other) == same
            if same:
                found += 1
                assert ((full @ other - full[1] @ other) >= views.asset_bounds[:, 0] - 1e-8).all()
                assert ((full @ other - full[1] @ other) <= views.asset_bounds[:, 1] + 1e-8).all()
        exact = implied_views(problem, problem.optimum(mean), reference=1).asset_bounds
        assert (views.asset_bounds[:, 0] <= exact[:, 0] + 1e-8).all()
        assert (views.asset_bounds[:, 1] >= exact[:, 1] - 1e-8).all()
        with pytest.raises(InputError, match="union of polyhedra"):
            views.nearest(mean)


def test_the_widest_rounded_interval_is_that_of_a_linear_programme(fresh_rng: np.random.Generator) -> None:
    rng = fresh_rng
    risk = risk_of(rng)
    problem = AlphaProblem(risk, GAMMA, simplex(N) & box(np.zeros(N), np.full(N, 0.4)))
    shown = np.array([0.3, 0.2, 0.2, 0.1, 0.1, 0.1])
    found = implied_views(problem, shown, digits=1, reference=1).interval(0)
    weights = cvxpy.Variable(N)
    rows = [cvxpy.sum(weights) == 1, weights >= shown - 0.05, weights <= np.minimum(shown + 0.05, 0.4)]
    slope = 2.0 * GAMMA * (risk.dense()[0] - risk.dense()[1])
    for side, sense in zip(found, (cvxpy.Minimize, cvxpy.Maximize), strict=True):
        assert side == pytest.approx(cvxpy.Problem(sense(slope @ weights), rows).solve(solver="CLARABEL"), abs=1e-6)


def test_measures_judge_views(fresh_rng: np.random.Generator) -> None:
    problem = AlphaProblem(risk_of(fresh_rng), GAMMA, simplex(N))
    mean = fresh_rng.normal(size=N)
    honest, decoy = (implied_views(problem, problem.optimum(m)) for m in (mean, -mean))
    assert MaximalObfuscation()(mean, honest) == pytest.approx(0.0, abs=1e-12)
    assert MaximalObfuscation()(mean, decoy) == pytest.approx(decoy.distance(mean))
    assert NonExistence(0.01)(mean, honest) == -np.inf
    assert NonExistence(0.01)(mean, decoy) == 0.0
    assert NonUniqueness()(mean, honest) == 0.0  # a shift at least
    assert Infeasibility()(mean, honest) == -np.inf
    assert DesiredObfuscation(lambda m: -m)(mean, decoy) == pytest.approx(0.0, abs=1e-12)
    alone = implied_views(AlphaProblem(np.eye(2), 0.5), [1.0, 2.0])
    assert NonUniqueness()([1.0, 2.0], alone) == -np.inf
    assert NonUniqueness()([0.0, 0.0], alone) == 0.0
    unexplained = implied_views(AlphaProblem(np.eye(2), 0.5, loadings=[[1.0], [0.0]]), [1.0, 1.0])
    assert Infeasibility(0.4)([1.0], unexplained) == 0.0
    assert Infeasibility(0.6)([1.0], unexplained) == -np.inf


@pytest.mark.parametrize("name", ["free", "budget"])
def test_the_farthest_view_is_along_the_riskiest_direction(name: str, fresh_rng: np.random.Generator) -> None:
    rng = fresh_rng
    risk, limit = risk_of(rng), 0.01
    problem = AlphaProblem(risk, GAMMA, regions(rng)[name])
    mean = rng.normal(size=N)
    found = obfuscated_decision(problem, mean, Budget.regret(limit))
    inside = np.eye(N) - (np.ones((N, N)) / N if name == "budget" else 0.0)
    top = np.linalg.eigvalsh(inside @ risk.dense() @ inside)[-1]
    assert found.privacy == pytest.approx(np.sqrt(4.0 * GAMMA * limit * top), rel=1e-10)
    assert found.regret == pytest.approx(limit, rel=1e-9)
    assert implied_views(problem, found.weights).distance(mean) == pytest.approx(found.privacy, rel=1e-9)
    # By force: decoys in all directions at the length that spends the budget.
    for way in rng.normal(size=(2000, N)):
        decoy = mean + way * np.sqrt(limit / (way @ problem.theta @ way))
        assert np.linalg.norm(inside @ (decoy - mean)) <= found.privacy * (1.0 + 1e-9)


def test_loadings_hide_where_theta_is_least(fresh_rng: np.random.Generator) -> None:
    problem = AlphaProblem(risk_of(fresh_rng), GAMMA, loadings=fresh_rng.normal(size=(N, 3)))
    found = obfuscated_decision(problem, np.zeros(3), Budget.regret(0.01))
    assert found.privacy == pytest.approx(np.sqrt(0.01 / np.linalg.eigvalsh(problem.theta)[0]), rel=1e-10)


def test_directions_of_many_assets_are_those_of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """One eigenvector after the other, or all: under constraints the search turns between the same directions."""
    rng = np.random.default_rng(20261127)
    problem = AlphaProblem(risk_of(rng, 5), GAMMA, simplex(5) & box(np.zeros(5), np.full(5, 0.6)))
    mean, budget = rng.normal(size=5), Budget.regret(0.02)
    few = obfuscated_decision(problem, mean, budget, n_directions=2)
    monkeypatch.setattr(obfuscation, "_LARGE", 4)
    many = obfuscated_decision(problem, mean, budget, n_directions=2)
    assert many.privacy == pytest.approx(few.privacy, rel=1e-6)


def test_rows_that_repeat_others_take_nothing_from_the_privacy_of_many_assets(fresh_rng: np.random.Generator) -> None:
    """A repeated row took an arbitrary direction away, and less privacy was stated as proved."""
    n = 420
    exposures = fresh_rng.normal(size=(n, 3))
    risk, mean, ones = FactorRisk(exposures, 0.01 * np.eye(3), np.full(n, 0.02)), fresh_rng.normal(size=n), np.ones(n)
    for rows in ([ones], [ones, ones], [ones, 2.0 * ones], [ones, exposures[:, 0], ones + exposures[:, 0]]):
        problem = AlphaProblem(risk, 2.0, Polyhedron(A_eq=np.array(rows), b_eq=np.zeros(len(rows))))
        basis = np.linalg.svd(np.array(rows))[2][np.linalg.matrix_rank(np.array(rows)) :]
        top = np.linalg.eigvalsh(basis @ risk.dense() @ basis.T)[-1]
        found = obfuscated_decision(problem, 0.01 * mean, Budget.regret(1e-3))
        assert found.privacy == pytest.approx(np.sqrt(4.0 * 2.0 * 1e-3 * top), rel=1e-9)
        assert found.regret == pytest.approx(1e-3, rel=1e-9)


def test_the_search_under_constraints_is_affordable_and_beats_chance(fresh_rng: np.random.Generator) -> None:
    rng = fresh_rng
    problem = AlphaProblem(risk_of(rng, 4), GAMMA, simplex(4) & box(np.zeros(4), np.full(4, 0.6)))
    mean, limit = rng.normal(size=4), 0.02
    found = obfuscated_decision(problem, mean, Budget.regret(limit))
    assert found.regret <= limit * (1.0 + 1e-9)
    assert found.privacy == pytest.approx(implied_views(problem, found.weights).distance(mean), abs=1e-7)
    assert np.linalg.norm(found.decoy - mean) == pytest.approx(found.privacy, abs=1e-9)
    assert problem.optimum(found.decoy) == pytest.approx(found.weights, abs=1e-7)
    best = 0.0
    for _ in range(60):
        decoy = mean + rng.uniform(0.0, 1.5) * rng.normal(size=4)
        weights = problem.optimum(decoy)
        if problem.regret(mean, weights) <= limit:
            best = max(best, implied_views(problem, weights).distance(mean))
    assert found.privacy >= 0.99 * best


@pytest.mark.parametrize("limit", [1e-3, 0.02, 0.2])
def test_the_search_finds_what_a_grid_of_decisions_finds(limit: float, fresh_rng: np.random.Generator) -> None:
    # Three weights of at least .001 are a triangle; one view explains each, up to a shift of all returns.
    rng, least, steps = fresh_rng, 0.001, 300
    factors = rng.normal(size=(3, 3))
    risk = factors @ factors.T + 0.3 * np.eye(3)
    region = Polyhedron(-np.eye(3), np.zeros(3), np.ones((1, 3)), [1.0], min_slack=least)
    problem, mean = AlphaProblem(risk, GAMMA, region), rng.normal(size=3)
    found = obfuscated_decision(problem, mean, Budget.regret(limit))
    first, second = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1), indexing="ij")
    inside = first + second <= steps
    shares = np.stack([first[inside], second[inside], steps - first[inside] - second[inside]], axis=1) / steps
    weights = least * 1.01 + (1.0 - 3.0 * least * 1.01) * shares
    cost = GAMMA * np.einsum("ti,ij,tj->t", weights, risk, weights) - weights @ mean
    best = problem.optimum(mean)
    affordable = cost - (GAMMA * best @ risk @ best - mean @ best) <= limit
    apart = 2.0 * GAMMA * weights @ risk - mean
    distances = np.linalg.norm(apart - apart.mean(axis=1, keepdims=True), axis=1)
    assert found.privacy >= 0.999 * distances[affordable].max(initial=0.0)


def test_bad_input_is_refused() -> None:
    problem = AlphaProblem(pd.DataFrame(np.eye(2), ["A", "B"], ["A", "B"]), 1.0, simplex(2))
    with pytest.raises(InputError, match="other asset labels than expected"):
        implied_views(problem, pd.Series([0.5, 0.5], ["A", "C"]))
    with pytest.raises(InputError, match=r"outside the feasible set: .*sum\(u\) = 1 is off by -0.2"):
        implied_views(problem, [0.5, 0.3])
    with pytest.raises(InputError, match="regret or digits, not both"):
        implied_views(problem, [0.5, 0.5], regret=0.1, digits=2)
    with pytest.raises(InputError, match="no asset is called 'C'; expected one of the assets A, B"):
        implied_views(problem, [0.5, 0.5], reference="C")
    with pytest.raises(InputError, match="no portfolio of them has weight one"):
        implied_views(AlphaProblem(np.eye(2), 1.0), [0.5, -0.5], reference="portfolio")
    with pytest.raises(InputError, match="other signal labels"):
        implied_views(problem, [0.5, 0.5]).distance(pd.Series([0.1, 0.2], ["A", "D"]))
    with pytest.raises(ModelError, match="there is nothing to hide"):
        obfuscated_decision(AlphaProblem(np.eye(2), 1.0, loadings=np.zeros((2, 1))), [1.0], 0.1)
    swapped = implied_views(problem, pd.Series([0.7, 0.3], ["B", "A"]))
    assert swapped.weights.tolist() == [0.3, 0.7]
    assert "expected return of an asset" in str(swapped)


def test_many_assets_take_little_memory() -> None:
    rng, n = np.random.default_rng(0), 3000
    risk = FactorRisk(rng.normal(size=(n, 60)), np.eye(60) * 1e-4, rng.uniform(0.5, 2.0, n) * 1e-3)
    region = simplex(n) & box(np.zeros(n), np.full(n, 0.004))
    problem = AlphaProblem(risk, 5.0, region)
    weights = problem.optimum(rng.normal(size=n) * 0.01)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with threadpool_limits(1):
        for reference in (None, "portfolio", "mean"):
            for regret in (None, 1e-4):
                views = implied_views(problem, weights, reference=reference, regret=regret)
                assert views.bounds.shape == (n, 2)
        implied_views(problem, weights).distance(np.zeros(n))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kB; one matrix of n by n is 72,000
    assert "A_ub" not in vars(region)


def test_views_of_weights_that_are_all_at_limits_are_among_those_that_explain_them(
    fresh_rng: np.random.Generator,
) -> None:
    """m explains u where m − 2γVu is at least as large at every weight at the cap as at every weight of zero."""
    n, cap, n_held = 4, 0.5, 0
    region = simplex(n) & box(np.zeros(n), np.full(n, cap))
    for _ in range(120):
        root, mean = fresh_rng.normal(size=(n, n)), 0.02 * fresh_rng.normal(size=n)
        problem = AlphaProblem(0.01 * root @ root.T / n + 1e-3 * np.eye(n), 4.0, region)
        weights = problem.optimum(mean)
        if not np.isin(weights, [0.0, cap]).all():
            continue
        n_held += 1
        views = implied_views(problem, weights)
        assert views.contains(mean)
        beyond = mean - 8.0 * problem.risk.dense() @ weights
        worst = mean - (beyond - beyond[weights == 0.0].max() + 1e-3) * (weights > 0.0)
        assert not views.contains(worst)
    assert n_held >= 3


@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-6, 1e-8])
@pytest.mark.parametrize("has_budget", [False, True])
def test_the_farthest_decoy_is_found_whatever_the_units_of_signals(unit: float, has_budget: bool) -> None:
    """Θ⁻¹ = D⁻¹ Θ₁⁻¹ D⁻¹ with Θ₁ that of unit 1: its greatest eigenvalue is the square of the privacy a unit of regret buys."""
    loads, sizes = np.array([[1.0, 0.5], [0.2, 1.0], [0.3, 0.3]]), np.array([1.0, unit])
    region = Polyhedron(A_eq=np.ones((1, 3)), b_eq=[1.0]) if has_budget else None
    plain, scaled = (AlphaProblem(np.eye(3) * 0.04, 2.5, region, each) for each in (loads, loads * sizes))
    greatest = np.linalg.eigvalsh(np.linalg.inv(plain.theta) / np.outer(sizes, sizes))[-1]
    found = obfuscated_decision(scaled, [0.1, 0.2 / unit], Budget.regret(1e-3))
    assert found.privacy == pytest.approx(np.sqrt(1e-3 * greatest), rel=1e-6)
    assert found.regret == pytest.approx(1e-3, rel=1e-4)
