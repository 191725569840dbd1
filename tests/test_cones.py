"""Cones of multipliers without the multipliers, against linear programmes with them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, nnls

from inscrutable import LinearProblem, Polyhedron, SolverError, box, consistent_beliefs, simplex
from inscrutable.geometry import cones
from inscrutable.geometry.cones import decomposed_rows
from sizes import instances, some


def is_stationary(active, equalities, gradient):
    """Whether −g = active'λ + equalities'ν with λ ≥ 0, by non-negative least squares."""
    columns = np.hstack([active.T, equalities.T, -equalities.T])
    return nnls(columns, -gradient, maxiter=1000)[1] <= 1e-9


def drawn(rng, size):
    """Rows with a corner, with lines, repeated, implied by others, and with or without equalities."""
    kind = int(rng.integers(4))
    active = rng.normal(size=(int(rng.integers(1, size + 4)), size))
    if kind == 1:  # lines
        active = np.vstack([active, -active[0], -(active[1:2] + active[:1])])
    if kind == 2:  # implied
        active = np.vstack([active, rng.uniform(0, 1, (3, len(active))) @ active])
    if kind == 3:  # a corner of a grid of limits
        active = np.vstack([np.eye(size), rng.integers(0, 2, (4, size)) + np.eye(4, size)])
    active = active[np.abs(active).max(axis=1) > 0]
    equalities = rng.normal(size=(int(rng.integers(0, 2)), size))
    return active, equalities


@pytest.mark.parametrize("seed", range(60))
def test_rows_say_what_multipliers_say(seed):
    rng = np.random.default_rng(seed)
    active, equalities = drawn(rng, int(rng.integers(2, 6)))
    rows = decomposed_rows(active, equalities)
    inside = -(rng.uniform(0, 1, (20, len(active))) * (rng.uniform(size=(20, len(active))) < 0.4)) @ active
    inside += rng.normal(size=(20, len(equalities))) @ equalities
    for gradient in [*inside, *rng.normal(size=(20, active.shape[1]))]:
        met = (rows.inequalities @ gradient >= -1e-8).all() and np.abs(rows.equalities @ gradient).max(
            initial=0
        ) <= 1e-8
        assert met == is_stationary(active, equalities, gradient)


@pytest.mark.parametrize("seed", range(60))
def test_facets_of_one_vector_more_than_directions_are_those_found_by_trying(seed):
    """Lines, repeated vectors and vectors of no part in the dependency among them."""
    rng = np.random.default_rng([20270601, seed])
    rank = int(rng.integers(1, 6))
    vectors = rng.normal(size=(rank + 1, rank)) if seed % 3 else rng.integers(-1, 2, (rank + 1, rank)).astype(float)
    if seed % 5 == 0:
        vectors[0] = -vectors[-1]
    if seed % 7 == 0:
        vectors[0] = 2 * vectors[-1]
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    if (lengths == 0).any() or np.linalg.matrix_rank(vectors) < rank:
        pytest.skip("a smaller cone")
    vectors /= lengths
    found, tried = cones._facets_of_one_more(vectors), cones._tried_facets(vectors, rank)
    assert len(found) == len(tried)
    for side in found:
        assert np.abs(tried - side).max(axis=1).min() <= 1e-9


def groups(size):
    """Caps of groups of five that add up to the whole: all of them are tight everywhere."""
    matrix = np.kron(np.eye(size // 5), np.ones(5))
    return simplex(size) & Polyhedron(matrix, np.full(size // 5, 5 / size))


def ring(size):
    """Every coordinate at most the next, and the last at most the first: all alike, by as many rows as coordinates."""
    return box([0.0] * size, [1.0] * size) & Polyhedron(np.eye(size) - np.roll(np.eye(size), 1, axis=1), np.zeros(size))


def ladder(size):
    """Every coordinate at most the next: corners at which as many rows meet as there are coordinates, or more."""
    matrix = (np.eye(size) - np.roll(np.eye(size), 1, axis=1))[1:]
    return box([0.0] * size, [1.0] * size) & Polyhedron(matrix, np.zeros(size - 1))


@pytest.mark.parametrize("region", some([groups, ladder, ring], 2))
def test_fifty_coordinates_with_many_rows_in_a_corner(region):
    rng = np.random.default_rng(3)
    region = region(50)
    problem = LinearProblem(rng.normal(size=(3, 50)), region)
    beliefs = rng.dirichlet(np.ones(3), instances(5, least=2))
    for belief, action in zip(beliefs, problem.solve(beliefs), strict=True):
        equal = {"A_eq": region.A_eq, "b_eq": region.b_eq} if len(region.b_eq) else {}
        least = linprog(belief @ problem.costs, region.A_ub, region.b_ub, **equal, bounds=(None, None)).fun
        assert belief @ problem.costs @ action == pytest.approx(least, abs=1e-7)
        found = consistent_beliefs(problem, action)
        members = rng.dirichlet(np.ones(3), instances(30))
        costs = members @ problem.costs
        other = [
            linprog(each, region.A_ub, region.b_ub, **equal, bounds=(None, None)).fun
            for each in costs
        ]  # fmt: skip
        assert [found.contains(member) for member in members] == (costs @ action <= np.array(other) + 1e-8).tolist()


def test_a_corner_with_too_many_faces_is_refused_with_what_to_do():
    rows = np.hstack([np.ones((90, 1)), np.random.default_rng(0).normal(size=(90, 39))])
    region = Polyhedron(rows, np.zeros(90))
    with pytest.raises(SolverError, match=r"span only 40 directions.*may have .* facets; remove constraints that meet"):
        region.stationarity(np.ones(90, dtype=bool))
