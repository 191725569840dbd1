"""Sets of beliefs where one state's costs are decades above the others', against exact corners."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from inscrutable import BeliefSet, LinearProblem, QuadraticProblem, consistent_beliefs, simplex
from sizes import instances

N_SETS = 60


def corners_of(rows):
    """Corners of {π ∈ Δ_3 : rows π ≥ 0} in rational numbers: the triangle cut row by row."""
    corners = [[Fraction(int(i == j)) for j in range(3)] for i in range(3)]
    for row in rows:
        exact = [Fraction(float(entry)) for entry in row]
        values = [sum(a * b for a, b in zip(exact, corner, strict=True)) for corner in corners]
        kept = []
        for k, (corner, value) in enumerate(zip(corners, values, strict=True)):
            if value >= 0:
                kept.append(corner)
            after, later = values[k - len(corners) + 1], corners[k - len(corners) + 1]
            if value * after < 0:
                share = value / (value - after)
                kept.append([a + share * (b - a) for a, b in zip(corner, later, strict=True)])
        corners = kept
    return np.array(corners, dtype=float)


def distance_to(corners, rows, belief):
    """The least distance to a side of a polygon, zero inside it."""
    if len(rows) == 0 or (rows @ belief >= 0).all():
        return 0.0
    found = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        way, square = end - start, (end - start) @ (end - start)
        share = np.clip((belief - start) @ way / square, 0.0, 1.0) if square > 0 else 0.0
        found.append(np.linalg.norm(belief - start - share * way))
    return min(found)


def unevenly(rng, n_states):
    """Sizes of states, one of them decades above the others."""
    sizes = np.ones(n_states)
    sizes[rng.integers(n_states)] = 10.0 ** rng.integers(5, 9)
    return sizes


def decided(problem, sizes, rng):
    """An optimal decision, mostly for a belief under which the states count alike."""
    belief = rng.dirichlet(np.ones(len(sizes))) / (sizes if rng.random() < 0.7 else 1.0)
    return problem.solve(belief / belief.sum())


def test_distances_are_those_to_exact_corners(fresh_rng):
    for _ in range(instances(3 * N_SETS)):
        sizes = unevenly(fresh_rng, 3)
        n_actions = int(fresh_rng.choice([2, 3, 5]))
        problem = LinearProblem(fresh_rng.normal(size=(3, n_actions)) * sizes[:, None], simplex(n_actions))
        found = consistent_beliefs(problem, decided(problem, sizes, fresh_rng))
        belief = fresh_rng.dirichlet(np.ones(3))
        exact = distance_to(corners_of(found.inequalities), found.inequalities, belief)
        # A belief within the tolerance, 1e-10 of the largest costs, counts as a member.
        if found.violation(belief) > found.tolerance:
            # The nearest one keeps rows to 1e-9, which moves it by far more along a state of small costs.
            assert found.distance(belief) <= exact + 1e-7
            assert found.violation(found.nearest(belief)) <= 10 * found.tolerance


@pytest.mark.parametrize(
    ("rows", "belief"),
    [
        ([[1.4833e-09, -7.356501e-09, -1.182461], [1.011413e-08, -1.381074e-09, -1.311736]], [0.881823, 0.036528, 0.081649]),
        ([[3.153425e-10, 8.970014e-10, -0.8190423], [-2.216608e-09, 1.758607e-09, -0.2772436],
          [-1.020437e-09, 2.557807e-09, 0.4023555], [-1.994429e-09, 1.191348e-09, 1.082575]], [0.725142, 0.125294, 0.149564]),
        ([[1.749084e-08, 3.295438e-09, 0.08071176], [2.074068e-09, 2.069603e-09, -1.478564],
          [1.440492e-08, -5.937571e-09, -1.092632], [1.048034e-08, 2.891051e-09, -0.7914714]], [0.124555, 0.531042, 0.344403]),
    ],
)  # fmt: skip
def test_a_thin_set_is_no_point_and_no_segment(rows, belief):
    """Sets as thick as the tolerance in one direction, long in another, were taken for .148, 1.146, .424 away."""
    rows, belief = np.array(rows), np.array(belief)
    found = BeliefSet(np.zeros((0, 3)), rows)
    assert found.distance(belief) <= distance_to(corners_of(rows), rows, belief) + 1e-7
    assert found.violation(found.nearest(belief)) <= 10 * found.tolerance


def test_no_set_of_uneven_states_is_beyond_projection(fresh_rng):
    for _ in range(instances(3 * N_SETS)):
        n_states, n_actions = int(fresh_rng.choice([3, 4, 5])), int(fresh_rng.choice([2, 3, 6]))
        sizes = unevenly(fresh_rng, n_states)
        roots = fresh_rng.normal(size=(n_states, n_actions, n_actions))
        hessians = roots @ roots.transpose(0, 2, 1) / n_actions + 0.1 * np.eye(n_actions)
        linear = fresh_rng.normal(size=(n_states, n_actions))
        problem = QuadraticProblem(
            hessians * sizes[:, None, None], linear * sizes[:, None], constraints=simplex(n_actions)
        )
        found = consistent_beliefs(problem, decided(problem, sizes, fresh_rng))
        belief = fresh_rng.dirichlet(np.ones(n_states))
        assert not found.is_empty
        assert np.isfinite(found.distance(belief))
