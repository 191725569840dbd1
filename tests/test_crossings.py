"""Where a budget ends on a ray, on a step and in general: against closed forms and plain halving."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable.decision_makers.search.goal import Goal
from inscrutable.geometry.crossings import Bracket, farthest, first_met, narrowed
from inscrutable.problems import FiniteProblem, MarkowitzProblem

CURVES = {
    "straight": lambda x, c: x - c,
    "curved": lambda x, c: np.sqrt(x**2 + 5.0 * x**3) - np.sqrt(c**2 + 5.0 * c**3),
    "steep": lambda x, c: x**9 - c**9,
    "flat, then rising": lambda x, c: np.maximum(x - c, 0.0) - 1e-7,
    "leap": lambda x, c: np.where(x > c, 7.0, -1e-3),
    "endless": lambda x, c: np.where(x > 0.99, np.inf, x - c),
    "side": lambda x, c: np.where(x > c, np.inf, -np.inf),
}


@pytest.mark.parametrize("name", CURVES)
def test_brackets_close_around_the_crossing_in_few_steps(name, fresh_rng):
    crossing = fresh_rng.uniform(0.01, 0.98, 50)
    ends = Bracket(np.zeros(50), np.ones(50))
    calls = []

    def f(which, x):
        calls.append(which.size)
        return CURVES[name](x, crossing[which])

    found = narrowed(f, ends, Bracket(*(CURVES[name](x, crossing) for x in ends)))
    value = CURVES[name](found.inside, crossing)
    assert np.all(value <= 0)
    assert np.all((np.abs(found.outside - found.inside) <= 1e-9) | (value == 0))
    assert np.all(np.abs(found.inside - crossing) <= 2e-7)
    assert len(calls) <= 46  # thirty halvings in three quarters of the steps, and a few
    assert name not in ("straight", "curved") or sum(calls) <= 8 * 50


def test_what_may_stay_unspent_ends_the_search(fresh_rng):
    slopes, spare = fresh_rng.uniform(1.5, 9.0, 20), 1e-6
    reach = farthest(lambda which, x: np.sqrt(slopes[which] * x) - 1.0, -np.ones(20), spare=spare)
    assert np.all((np.sqrt(slopes * reach) <= 1.0) & (np.sqrt(slopes * reach) >= 1.0 - spare))
    assert farthest(lambda which, x: x - 2.0, -2.0 * np.ones(1))[0] == 1.0
    assert farthest(lambda which, x: x, np.zeros(1))[0] == 0.0
    assert first_met(lambda share: share >= 0.3) == pytest.approx(0.3, abs=1e-9)


def test_steps_end_where_the_quadratic_cost_does(fresh_rng):
    covariance = np.diag(fresh_rng.uniform(0.5, 2.0, 4))
    problem = MarkowitzProblem(fresh_rng.normal(size=(1, 4)), covariance[None], 1.0)
    belief, start = np.ones(1), problem.solve([1.0])
    limit = 10.0 ** fresh_rng.uniform(-6, -1)
    steps = np.vstack([fresh_rng.dirichlet(np.ones(4), 8) - start, np.zeros(4)])
    allowed = Goal(problem, belief, limit, float(problem.state_costs(start) @ belief))
    shares = allowed.along_steps(start, steps, 1e-9)
    bend = np.einsum("nu,uv,nv->n", steps, problem.hessians[0], steps) / 2.0
    lean = steps @ problem.cost_gradients(start)[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = np.minimum(2.0 * limit / (lean + np.sqrt(lean**2 + 4.0 * bend * limit)), 1.0)
    np.testing.assert_allclose(shares, expected, rtol=1e-8, atol=1e-9)
    assert np.all(allowed.regrets(start + shares[:, None] * steps) <= limit)


def test_rays_end_at_a_leap_and_at_once_without_a_budget():
    problem = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])  # the other choice is best beyond one half
    belief, ends = np.array([0.6, 0.4]), np.array([[0.0, 1.0], [1.0, 0.0]])
    optimal = problem.solve_points(belief)
    for limit in (0.0, 0.1):
        allowed = Goal(problem, belief, limit, 0.4)
        shares, decisions = allowed.along_rays(optimal, ends, 1e-2)
        assert np.all(allowed.regrets(decisions) <= limit + 1e-15)
        assert shares[1] == 1.0
        assert shares[0] == pytest.approx(1.0 / 6.0 if limit else 0.0, abs=1e-8)
