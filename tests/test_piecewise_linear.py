"""Decisions under piecewise linear costs against an enumeration of all vertices, and against proofs."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from inscrutable import (
    Budget,
    ConvexProblem,
    CounterAdversarialDecisionMaker,
    GlobalSearch,
    PiecewiseLinearProblem,
    ProbabilisticDecisionMaker,
    box,
    cheapest_privacy,
    consistent_beliefs,
    decoy_grid,
    simplex,
)
from sizes import audited, instances, some

Array = NDArray[np.float64]


def drawn(rng: np.random.Generator, n_states: int, n_actions: int, n_pieces: int) -> PiecewiseLinearProblem:
    slopes, offsets = rng.normal(size=(n_states, n_pieces, n_actions)), 0.2 * rng.normal(size=(n_states, n_pieces))
    return PiecewiseLinearProblem(list(slopes), list(offsets), simplex(n_actions))


def vertex_costs(problem: PiecewiseLinearProblem) -> Array:
    """State costs (n,X) of the vertices of {(u, z) : u ∈ Δ, z_i ≥ a_ik + b_ik'u}, by trying all sets of tight rows."""
    n_states, n = problem.n_states, problem.n_actions
    rows = [np.append(-np.eye(n)[j], np.zeros(n_states)) for j in range(n)]
    sides = [0.0] * n
    for i, (slopes, offsets) in enumerate(zip(problem.slopes, problem.offsets, strict=True)):
        for slope, offset in zip(slopes, offsets, strict=True):
            rows.append(np.append(slope, -np.eye(n_states)[i]))
            sides.append(-offset)
    normals, limits, found = np.array(rows), np.array(sides), []
    total = np.append(np.ones(n), np.zeros(n_states))
    for tight in combinations(range(len(rows)), n + n_states - 1):
        system = np.vstack([normals[list(tight)], total])
        if abs(np.linalg.det(system)) > 1e-10:
            point = np.linalg.solve(system, np.append(limits[list(tight)], 1.0))
            if (normals @ point <= limits + 1e-9).all():
                found.append(point[n:])
    return np.array(found)


def best_by_enumeration(costs: Array, belief: Array, budget: float) -> float:
    """Over two states: a vertex is explained by the beliefs at which it is cheapest, a mixture of tied ones by theirs alone."""
    own = costs @ belief
    lowest, (start, rise), best = own.min(), (costs[:, 0], costs[:, 1] - costs[:, 0]), 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = (start[:, None] - start) / (rise - rise[:, None])
    places = np.unique(np.round(np.append(crossings[(crossings > 0) & (crossings < 1)], [0.0, 1.0]), 12))
    values = start + places[:, None] * rise
    is_cheapest = values <= values.min(axis=1, keepdims=True) + 1e-10
    distance = np.sqrt(2.0) * np.abs(places - belief[1])
    for k in np.flatnonzero(own <= lowest + budget):  # a vertex
        held = places[is_cheapest[:, k]]
        if held.size:
            best = max(best, np.sqrt(2.0) * max(held.min() - belief[1], belief[1] - held.max(), 0.0))
    for tied, away in zip(is_cheapest, distance, strict=True):  # a mixture of vertices of unlike costs
        lines = np.unique(np.round(costs[tied], 9), axis=0)
        if len(lines) > 1 and (costs[tied] @ belief).min() <= lowest + budget:
            best = max(best, away)
    return float(best)


def test_decisions_are_the_best_of_an_enumeration(fresh_rng: np.random.Generator, fresh_seed: int) -> None:
    for case in range(instances(60, 12)):
        problem = drawn(fresh_rng, 2, int(fresh_rng.integers(2, 4)), int(fresh_rng.integers(1, 4)))
        belief, budget = fresh_rng.dirichlet(np.ones(2)), float(fresh_rng.uniform(0.05, 0.5))
        size = abs(float(problem.optimal_cost(belief)))
        decision = CounterAdversarialDecisionMaker(problem, budget=budget).decide(belief)
        costs = vertex_costs(problem)
        # A mixture lies as far from its vertices as `min_slack` asks, at a regret of a few thousandths of the costs' range.
        least = best_by_enumeration(costs, belief, budget * size - 5e-3 * np.ptp(costs))
        most = best_by_enumeration(costs, belief, budget * size)
        assert least - 1e-6 <= decision.privacy <= most + 1e-6, (fresh_seed, case)
        assert consistent_beliefs(problem, decision.action).distance(belief) == pytest.approx(
            decision.privacy, abs=1e-8
        )
        lottery = ProbabilisticDecisionMaker(problem, budget=budget).decide(belief)
        assert lottery.expected_privacy >= decision.privacy - 1e-9


def test_no_proof_finds_a_better_decision(fresh_rng: np.random.Generator, fresh_seed: int) -> None:
    for case in range(instances(30, 3)):
        problem = drawn(fresh_rng, int(fresh_rng.integers(2, 5)), int(fresh_rng.integers(2, 6)), 3)
        belief = fresh_rng.dirichlet(np.ones(problem.n_states))
        found = CounterAdversarialDecisionMaker(problem, budget=0.2).decide(belief)
        proof = CounterAdversarialDecisionMaker(problem, budget=0.2, method=GlobalSearch(certify=0.01)).decide(belief)
        assert proof.privacy - 1e-6 <= found.privacy <= proof.privacy_bound + 1e-9, (fresh_seed, case)


@pytest.mark.parametrize("unit", [1e6, 1e-2, 1e-5, 1e-8])
def test_the_unit_of_costs_changes_no_decision(unit: float, fresh_rng: np.random.Generator) -> None:
    plain = drawn(fresh_rng, 2, 3, 3)
    parts = [unit * each for each in plain.slopes], [unit * each for each in plain.offsets]
    same = PiecewiseLinearProblem(*parts, plain.constraints)
    belief = fresh_rng.dirichlet(np.ones(2))
    cost = float(np.abs(plain.state_costs(np.eye(3))).max())
    one, other = (
        CounterAdversarialDecisionMaker(problem, budget=Budget.regret(0.1 * cost * factor)).decide(belief)
        for problem, factor in ((plain, 1.0), (same, unit))
    )
    np.testing.assert_allclose(other.action, one.action, atol=1e-6)
    assert other.privacy == pytest.approx(one.privacy, abs=1e-6)
    away = fresh_rng.dirichlet(np.ones(3))
    for point in (one.action, away):
        found = [consistent_beliefs(problem, point) for problem in (plain, same)]
        assert found[0].is_empty == found[1].is_empty
        np.testing.assert_allclose(*(each.bounds() for each in found), atol=1e-9)


def test_a_kink_between_flat_pieces_is_seen_in_any_unit() -> None:
    for unit in (1.0, 1e-5):
        slopes, offsets = [[[unit], [-unit]]] * 2, [[-0.2 * unit, 0.2 * unit], [-0.8 * unit, 0.8 * unit]]
        problem = PiecewiseLinearProblem(slopes, offsets, box([0.0], [1.0]))
        np.testing.assert_allclose(consistent_beliefs(problem, [0.5]).bounds(), 0.5)
        found = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(0.3 * unit)).decide([0.9, 0.1])
        assert found.privacy == pytest.approx(0.4 * np.sqrt(2.0))


def test_a_grid_has_mixtures_of_tied_decisions_where_they_are_asked_for() -> None:
    problem = drawn(np.random.default_rng(0), 3, 4, 3)
    plain, faces = decoy_grid(problem, 4), decoy_grid(problem, 4, faces=True)
    assert len(faces) > len(plain)
    added = np.asarray(faces.sets.dimension)[len(plain) :]
    assert (added < 2).any()
    assert (added >= 0).all()


def stated(cp: Any, rng: np.random.Generator, n_states: int, n_actions: int) -> tuple[Any, list[Any], list[Any]]:
    """A variable, costs of all atoms that are read, some of them inside others, and constraints."""
    u, flat = cp.Variable(n_actions), rng.normal(size=(n_states, n_actions))
    rows, limits = rng.normal(size=(n_states, 3, n_actions)), rng.normal(size=(n_states, 3))
    weights = rng.uniform(size=(n_states, 7))
    costs = []
    for g, b, a, w in zip(flat, rows, limits, weights, strict=True):
        kinks = [
            cp.max(b @ u + a),
            cp.sum(cp.pos(0.3 - u)),
            cp.norm1(u - 0.2),
            cp.norm_inf(b @ u),
            -cp.min(u) / 3.0,
            cp.maximum(u[0], cp.abs(u[1]) - 0.1, 0.2),
            cp.sum(cp.multiply(np.arange(1.0, n_actions + 1.0), cp.abs(u - 0.3))),
        ]
        costs.append(g @ u + sum(weight * kink for weight, kink in zip(w, kinks, strict=True)) + 0.7)
    return u, costs, [u >= 0, u <= 1, cp.sum(u) <= 1.5]


@pytest.mark.parametrize("shape", some([(2, 2), (3, 4), (3, 3)], 2))
def test_costs_of_maxima_in_cvxpy_are_linear_problems(
    shape: tuple[int, int], fresh_rng: np.random.Generator, fresh_seed: int
) -> None:
    cp = pytest.importorskip("cvxpy")
    u, costs, limits = stated(cp, fresh_rng, *shape)
    problem = ConvexProblem(u, costs, limits)
    assert problem.linear_form() is not None
    for point in fresh_rng.uniform(size=(10, shape[1])):
        u.value = point
        values = [float(cost.value) for cost in costs]
        np.testing.assert_allclose(problem.state_costs(point), values, atol=1e-12, err_msg=str(fresh_seed))
    for belief in fresh_rng.dirichlet(np.ones(shape[0]), instances(4, least=1)):
        lowest = cp.Problem(cp.Minimize(sum(p * cost for p, cost in zip(belief, costs, strict=True))), limits).solve()
        assert problem.optimal_cost(belief) == pytest.approx(lowest, abs=1e-6), fresh_seed
        decision = CounterAdversarialDecisionMaker(problem, budget=0.2).decide(belief)
        explained = consistent_beliefs(problem, decision.action)
        assert explained.distance(belief) == pytest.approx(decision.privacy, abs=1e-7), fresh_seed
        for other in explained.vertices():
            assert problem.regret(other, decision.action) <= 1e-7, fresh_seed
        for other in fresh_rng.dirichlet(np.ones(shape[0]), 5):
            # A belief beside the set has a regret as small as its distance times that of the decision from its corner.
            regret = problem.regret(other, decision.action)
            assert regret <= 1e-7 if explained.contains(other) else regret > 1e-9, fresh_seed


def test_one_maximum_a_state_is_the_problem_of_its_pieces() -> None:
    cp = pytest.importorskip("cvxpy")
    pieces, belief = drawn(np.random.default_rng(0), 3, 5, 4), [0.2, 0.5, 0.3]
    u = cp.Variable(5)
    pairs = zip(pieces.slopes, pieces.offsets, strict=True)
    written = ConvexProblem(u, [cp.max(b @ u + a) for b, a in pairs], [cp.sum(u) == 1, u >= 0])
    one, other = (CounterAdversarialDecisionMaker(each, budget=0.2).decide(belief) for each in (pieces, written))
    assert other.privacy == pytest.approx(one.privacy, abs=1e-8)


@pytest.mark.parametrize("name", ["curved", "other", "many"])
def test_other_costs_are_taken_as_they_are(name: str) -> None:
    cp = pytest.importorskip("cvxpy")
    u = cp.Variable(3)
    deep = cp.max(u)
    for _ in range(7):  # a maximum inside each other: 3 · 2^7 pieces
        deep = cp.maximum(deep, u[0] + 0.1) + cp.abs(u[1])
    kinds = {"curved": cp.max(u) + cp.sum_squares(u), "other": cp.sum_largest(u, 2), "many": cp.maximum(deep, u[2])}
    problem = ConvexProblem(u, [kinds[name], cp.abs(u[0] - 0.2)], [cp.sum(u) == 1, u >= 0])
    assert problem.linear_form() is None
    assert problem.solve([0.5, 0.5]) == pytest.approx(problem.solve([[0.5, 0.5]])[0])


def test_decisions_whose_rows_have_too_many_facets_are_left_out_and_said(caplog: pytest.LogCaptureFixture) -> None:
    """Thirty-four rows in 21 directions at some decoys' decisions; an error ended the search before."""
    cp = pytest.importorskip("cvxpy")
    u, costs, limits = stated(cp, np.random.default_rng(949341669), 3, 4)
    problem = ConvexProblem(u, costs, limits)
    candidates = None if audited() else decoy_grid(problem, 3, faces=True)
    decision = CounterAdversarialDecisionMaker(problem, budget=0.2, candidates=candidates).decide([0.2, 0.3, 0.5])
    assert "very many kinks and constraints meet are left out" in caplog.text
    caplog.clear()
    assert len(decoy_grid(problem, 3)) < 10, "a grid without mixtures of tied vertices leaves them out too"
    assert "very many kinks and constraints meet are left out" in caplog.text
    assert consistent_beliefs(problem, decision.action).distance([0.2, 0.3, 0.5]) == pytest.approx(decision.privacy)
    assert decision.privacy > 0.7


BEYOND_KINKS = [
    (
        PiecewiseLinearProblem(
            [[[-1.5], [0.5]], [[0.0], [0.5], [-1.0]], [[0.0], [0.5]]],
            [[-1.0, 0.5], [0.25, -1.25, -0.5], [0.25, 0.0]],
            box([-1.0], [1.0]),
        ),
        [0.55, 0.01, 0.44],
        [-0.76],
        0.01,
    ),
    (
        PiecewiseLinearProblem(
            [[[0.0], [-1.0]], [[0.5], [-1.5]], [[-1.5]]], [[0.25, -0.25], [0.5, -0.25], [-0.25]], box([-1.0], [1.0])
        ),
        [0.12427356, 0.7233536, 0.15237284],
        [-0.4],
        0.035,
    ),
    (
        PiecewiseLinearProblem(
            [[[0.0, -0.5, -1.0], [1.0, -0.5, 1.0]], [[0.0, 1.5, -2.5]],
             [[1.5, -0.5, 1.0], [1.5, 0.5, 0.5], [0.0, -0.5, 0.0]]],
            [[0.0, -0.5], [0.5], [0.5, -0.5, 0.75]],
            box(-np.ones(3), np.ones(3)),
        ),
        [0.28993862, 0.14334821, 0.56671317],
        [-0.4, -1.0, 1.0],
        1.35,
    ),
]  # fmt: skip


@pytest.mark.parametrize(("problem", "belief", "beyond", "budget"), BEYOND_KINKS)
def test_decisions_beyond_kinks_of_impossible_states_are_found(problem, belief, beyond, budget) -> None:
    """Only beliefs under which some state is impossible explain them, and the kinks of its cost divide their face."""
    assert problem.is_admissible(np.array(beyond))
    assert problem.regret(belief, beyond) <= budget
    privacy = consistent_beliefs(problem, beyond).distance(belief)
    decided = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(budget)).decide(belief)
    mixed = ProbabilisticDecisionMaker(problem, budget=Budget.regret(budget)).decide(belief)
    assert min(decided.privacy, mixed.expected_privacy) >= privacy - 1e-9
    assert cheapest_privacy(problem, belief, privacy=privacy - 1e-9).regret <= problem.regret(belief, beyond)
