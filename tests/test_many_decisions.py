"""What many decisions cost and which are admissible, against the plain definitions, one by one."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings

from inscrutable import MarkowitzProblem, QuadraticProblem, box, simplex, simplex_grid
from inscrutable.geometry.morton import morton_order
from oracles import markets
from strategies import SEEDS


def sparse(rng: np.random.Generator, count: int, size: int) -> np.ndarray:
    return rng.normal(size=(count, size)) * (rng.random((count, size)) < 0.4)


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_costs_are_written_out(seed):
    rng = np.random.default_rng(seed)
    n_states, size = int(rng.integers(1, 10)), int(rng.integers(1, 8))
    roots = rng.normal(size=(n_states, size, size))
    problem = QuadraticProblem(
        roots @ roots.transpose(0, 2, 1),
        rng.normal(size=(n_states, size)),
        rng.normal(size=n_states),
        constraints=box(-np.ones(size), np.ones(size)),
    )
    actions = sparse(rng, 40, size)
    written = [
        [
            0.5 * u @ h @ u + g @ u + r
            for h, g, r in zip(problem.hessians, problem.linear, problem.constants, strict=True)
        ]
        for u in actions
    ]
    np.testing.assert_allclose(problem.state_costs(actions), written, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_what_is_admissible_is_so_row_by_row(seed):
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 5))
    region = simplex(size) & box(np.zeros(size), np.full(size, 0.7))
    steps = [0.0, 1e-12, 1e-6, 5e-5, 2e-4, -1e-12, -1e-3]
    points = rng.dirichlet(np.ones(size), 60)
    points[:30, 0] = rng.choice([0.0, 0.7], 30) + rng.choice(steps, 30)
    points[:, -1] = 1 - points[:, :-1].sum(axis=1) + rng.choice([0.0, 0.0, 1e-5], 60)
    for point, found in zip(points, region.is_admissible(points), strict=True):
        slacks = [b - a @ point for a, b in zip(region.A_ub, region.b_ub, strict=True)]
        feasible = min(slacks) >= -1e-9 and abs(point.sum() - 1) <= 1e-9
        assert found == (feasible and all(abs(slack) <= 1e-9 or slack >= region.min_slack for slack in slacks))


def test_decisions_at_the_edge_of_what_is_admissible_are_told_apart():
    region = simplex(3)
    near = region.min_slack
    points = [
        [0.5, 0.5, 0],
        [0.5, 0.5 - near / 2, near / 2],
        [0.5, 0.5 - 2 * near, 2 * near],
        [0.6, 0.5, -0.1],
        [0.5] * 3,
    ]
    np.testing.assert_array_equal(region.is_admissible(points), [True, False, True, False, False])


@pytest.mark.parametrize(("n", "resolution"), [(1, 4), (2, 1), (3, 6), (5, 3)])
def test_the_grid_is_every_point_in_lexicographic_order(n, resolution):
    every = [k for k in product(range(resolution + 1), repeat=n) if sum(k) == resolution]
    np.testing.assert_array_equal(simplex_grid(n, resolution), np.array(every) / resolution)


@pytest.mark.parametrize("n_states", [1, 2, 4, 12, 80])
def test_the_order_of_solving_is_a_permutation_of_neighbours(n_states):
    points = np.random.default_rng(1).dirichlet(np.ones(n_states), 400)
    order = morton_order(points)
    np.testing.assert_array_equal(np.sort(order), np.arange(400))
    if 1 < n_states <= 4:
        steps = np.linalg.norm(np.diff(points[order], axis=0), axis=1).mean()
        assert steps < 0.5 * np.linalg.norm(np.diff(points, axis=0), axis=1).mean()


def test_the_order_follows_the_bits_of_the_cells():
    order = morton_order(simplex_grid(3, 4))  # cells of a quarter: (0,0) (0,1) (1,0) (1,1), then the next four
    corners = (simplex_grid(3, 4)[order][:4, :2] * 4).astype(int)
    assert {tuple(corner) for corner in corners} == {(0, 0), (0, 1), (1, 0), (1, 1)}


@pytest.mark.parametrize(("n_states", "size"), [(3, 3), (3, 9), (4, 30)])
def test_no_digit_of_an_answer_depends_on_other_beliefs(n_states, size):
    problem = MarkowitzProblem(*markets.random_market(np.random.default_rng(5), n_states, size))
    beliefs = np.random.default_rng(6).dirichlet(np.ones(n_states), 300)
    shuffled = np.random.default_rng(7).permutation(300)
    together = problem.solve(beliefs)
    np.testing.assert_array_equal(problem.solve(beliefs[shuffled]), together[shuffled])
    np.testing.assert_array_equal(problem.solve(beliefs[:37]), together[:37])
    np.testing.assert_array_equal([problem.solve(belief) for belief in beliefs[:20]], together[:20])
