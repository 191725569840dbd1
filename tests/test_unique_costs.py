"""Where all optimal decisions of a belief cost the same in every state: claimed only where it holds."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import minimize

from inscrutable import (
    Budget,
    ConvexProblem,
    CounterAdversarialDecisionMaker,
    GlobalSearch,
    KellyProblem,
    MarkowitzProblem,
    Polyhedron,
    box,
    check_decision_problem,
    consistent_beliefs,
    decoy_grid,
    simplex,
    simplex_grid,
    with_transaction_costs,
)
from inscrutable.decision_makers.proofs import certificate
from sizes import instances, some
from strategies import SEEDS


def growth(rng, *, copied=False, fewer=False):
    """A market of growth; `copied` repeats an asset, `fewer` has fewer outcomes than assets."""
    n_states, n_outcomes, n_assets = 3, 2 if fewer else 5, 4
    returns = rng.lognormal(0, 0.3, (n_states, n_outcomes, n_assets))
    if copied:
        returns[..., -1] = returns[..., 0]
    return KellyProblem(returns, rng.dirichlet(np.ones(n_outcomes), n_states))


def beliefs_of(rng, n_states=3):
    """Inside, on edges and in corners of the simplex."""
    return np.vstack([rng.dirichlet(np.ones(n_states), 3), simplex_grid(n_states, 2)])


@settings(max_examples=instances(12), deadline=None)
@given(SEEDS)
def test_optimal_growth_costs_the_same_from_wherever_it_is_sought(seed):
    rng = np.random.default_rng(seed)
    problem = growth(rng, copied=bool(seed % 2))
    assert problem.costs_are_unique
    outcomes, shares = problem.gross_returns, problem.probabilities
    for belief in beliefs_of(rng):
        own = problem.state_costs(problem.solve(belief))
        for start in rng.dirichlet(np.ones(4), 2):
            other = minimize(
                lambda u: -belief @ (shares * np.log(outcomes @ u)).sum(axis=1),  # noqa: B023
                start,
                jac=lambda u: -np.einsum("x,xs,xsu->u", belief, shares / (outcomes @ u), outcomes),  # noqa: B023
                bounds=[(0, 1)] * 4,
                constraints={"type": "eq", "fun": lambda u: u.sum() - 1, "jac": lambda u: np.ones(4)},
                method="SLSQP",
                options={"ftol": 1e-15, "maxiter": 500},
            )
            costs = -(shares * np.log(outcomes @ np.maximum(other.x, 0))).sum(axis=1)
            np.testing.assert_allclose(own, costs, atol=2e-5)


def test_copied_assets_leave_the_decision_open_and_the_costs_not():
    problem = growth(np.random.default_rng(0), copied=True)
    action = problem.solve([0.2, 0.3, 0.5])
    swapped = action[[3, 1, 2, 0]]
    np.testing.assert_allclose(problem.state_costs(action), problem.state_costs(swapped), atol=1e-14)


def test_a_state_that_does_not_feel_a_difference_leaves_the_others_open():
    """In the first state both assets are one: certain of it, any mixture is optimal, and the second state tells them apart."""
    returns = np.array([[[1.1, 1.1], [0.9, 0.9]], [[1.2, 1.0], [0.9, 1.0]]])
    problem = KellyProblem(returns, np.full((2, 2), 0.5))
    sure = np.array([1.0, 0.0])
    assert problem.regret(sure, [1.0, 0.0]) == problem.regret(sure, [0.0, 1.0]) == 0.0
    assert abs(np.diff(problem.state_costs(np.eye(2))[:, 1])[0]) > 0.01
    assert not problem.costs_are_unique
    # An equality takes the open direction away; an outcome of no probability is felt by nobody.
    fixed = KellyProblem(returns, np.full((2, 2), 0.5), simplex(2) & Polyhedron(A_eq=[[1, 0]], b_eq=[0.4]))
    assert fixed.costs_are_unique
    unlikely = np.array([[[1.1, 1.1], [0.9, 0.9]], [[1.2, 1.2], [7.0, 1.0]]])
    assert KellyProblem(unlikely, [[0.5, 0.5], [1.0, 0.0]]).costs_are_unique


def test_fewer_outcomes_than_assets_prove_nothing():
    assert not growth(np.random.default_rng(1), fewer=True).costs_are_unique


def test_possible_ruin_claims_nothing():
    race = KellyProblem(np.diag([2.0, 3.0])[:, None, :], np.ones((2, 1)))
    assert not race.costs_are_unique
    half = np.array([[[2.0, 1.0], [0.0, 1.0]], [[1.5, 1.0], [0.0, 1.0]]])
    assert not KellyProblem(half, np.full((2, 2), 0.5)).costs_are_unique
    held = simplex(2) & box([0.0, 0.1], [1.0, 1.0])
    assert KellyProblem(half, np.full((2, 2), 0.5), held).costs_are_unique
    endless = Polyhedron(A_eq=[[1.0, 1.0]], b_eq=[1.0])
    assert not KellyProblem(half + 0.5, np.full((2, 2), 0.5), endless).costs_are_unique


def exponentials(strictly_convex):
    """c(i,u) = Σ_j exp(a_ij u_j), by functions."""
    rates = np.array([[1.0, -2.0], [-1.0, 1.5]])
    return ConvexProblem.from_functions(
        lambda u: np.exp(rates * u).sum(axis=1),
        lambda u: rates * np.exp(rates * u),
        box([-1, -1], [1, 1]),
        strictly_convex=strictly_convex,
    )


def test_strict_convexity_is_declared_and_looked_at():
    assert not exponentials(False).costs_are_unique
    problem = exponentials(True)
    assert problem.costs_are_unique
    check_decision_problem(problem)
    false = ConvexProblem.from_functions(
        lambda u: np.array([u[0] ** 4 + u[1], u[0] ** 4 - u[1]]),
        lambda u: np.array([[4 * u[0] ** 3, 1.0], [4 * u[0] ** 3, -1.0]]),
        box([0.5, -1], [0.5, 1]),
        strictly_convex=True,
    )
    with pytest.raises(AssertionError, match="broken promise: costs declared strictly convex"):
        check_decision_problem(false)


def test_declared_costs_are_the_same_from_other_starts():
    rng = np.random.default_rng(3)
    rates = np.array([[1.0, -2.0], [-1.0, 1.5]])
    problem = exponentials(True)
    for belief in beliefs_of(rng, 2):
        own = problem.state_costs(problem.solve(belief))
        for start in rng.uniform(-1, 1, (3, 2)):
            other = minimize(
                lambda u: belief @ np.exp(rates * u).sum(axis=1),  # noqa: B023
                start,
                bounds=[(-1, 1)] * 2,
                options={"ftol": 1e-16, "gtol": 1e-12},
            ).x
            np.testing.assert_allclose(own, np.exp(rates * other).sum(axis=1), atol=1e-5)


def test_expressions_that_are_quadratic_are_looked_at_and_not_believed():
    cp = pytest.importorskip("cvxpy")
    u = cp.Variable(2)
    costs = [cp.sum_squares(u - [1, 0]), cp.sum_squares(u - [0, 1])]
    assert ConvexProblem(u, costs, simplex(2)).costs_are_unique
    flat = ConvexProblem(u, [u[0], u[1]], simplex(2), strictly_convex=True)
    assert not flat.costs_are_unique
    assert not ConvexProblem(u, [cp.exp(u[0]), cp.exp(u[1])], simplex(2)).costs_are_unique


def test_trading_at_a_cost_changes_nothing_about_ties():
    bent = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
    assert with_transaction_costs(bent, [0.5, 0.5], linear=0.02).costs_are_unique
    flat = MarkowitzProblem([[0.1, 0.1], [0.2, 0.1]], [np.zeros((2, 2)), np.eye(2)], 1.0)
    assert not with_transaction_costs(flat, [0.5, 0.5], linear=0.02).costs_are_unique


@pytest.mark.parametrize("seed", some([2, 3], 2))
def test_shared_decisions_of_growth_close_their_cells(seed, monkeypatch):
    """With two assets in three states whole segments of beliefs share a decision; proofs by optimal costs alone need to
    know, those that look between corners do not."""
    rng = np.random.default_rng([seed, 17])
    returns = rng.lognormal(0, 0.3, (3, 5, 2))
    returns /= returns.mean(axis=(0, 1))
    problem = KellyProblem(returns, rng.dirichlet(np.ones(5), 3))
    belief, limit = rng.dirichlet(np.full(3, 3.0)), 0.002
    best = 0.0
    for share in np.linspace(0, 1, 201):
        action = np.array([share, 1 - share])
        if problem.regret(belief, action) <= limit:
            found = consistent_beliefs(problem, action)
            best = max(best, 0.0 if found.is_empty else found.distance(belief))

    def bound():
        method = GlobalSearch(certify=0.02, max_oracle_calls=800)
        candidates = decoy_grid(problem, 16)
        maker = CounterAdversarialDecisionMaker(
            problem, budget=Budget.regret(limit), candidates=candidates, method=method
        )
        return maker.decide(belief).privacy_bound

    bounds = []
    for claimed in (True, False):
        vars(problem)["costs_are_unique"] = claimed
        with monkeypatch.context() as patched:
            patched.setattr(certificate, "_smooth_cells", lambda problem, points: None)
            bounds.append(bound())
    assert bounds[0] >= best - 1e-9
    assert bounds[0] < 0.8 * bounds[1]
    assert best - 1e-9 <= bound() <= 1.04 * best
