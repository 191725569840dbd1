"""Points that cover the simplex: grids, their rounding bound, the interior sequence, equal rows."""

from __future__ import annotations

from itertools import combinations
from math import comb, sqrt

import numpy as np
import pytest
from scipy.spatial import cKDTree

from inscrutable import InputError, simplex_grid
from inscrutable.geometry.equal_rows import first_equal
from inscrutable.geometry.grids import grid_size, resolution_for
from inscrutable.geometry.low_discrepancy import covering_radius, interior_points, simplex_cover


def flat_beliefs(n, size, seed=0):
    return np.random.default_rng(seed).dirichlet(np.ones(n), size)


def sparse_beliefs(n, size, seed=1):
    return np.random.default_rng(seed).dirichlet(np.full(n, 0.3), size)


@pytest.mark.parametrize(("n", "resolution"), [(1, 3), (2, 7), (3, 5), (4, 4), (7, 2)])
def test_size_is_known_without_making_the_grid(n, resolution):
    assert grid_size(n, resolution) == len(simplex_grid(n, resolution))


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 6])
def test_few_coordinates_are_covered_by_the_finest_regular_grid(n):
    points = simplex_cover(n, 700)
    np.testing.assert_array_equal(points, simplex_grid(n, resolution_for(n, 700)))
    assert n == 1 or len(points) <= 714 < grid_size(n, resolution_for(n, 700) + 1)


@pytest.mark.parametrize(("n", "size"), [(7, 1), (7, 5000), (8, 5000), (9, 300), (12, 5000), (40, 100), (40, 3000)])
def test_a_cover_lies_on_the_simplex_and_has_vertices_faces_and_interior(n, size):
    points = simplex_cover(n, size)
    assert (points >= 0).all()
    np.testing.assert_allclose(points.sum(axis=1), 1, atol=1e-12)
    assert min(size, n) <= len(points) <= max(1.3 * size, n + 1.25 * size)
    assert len(np.unique(points.round(9), axis=0)) == len(points)
    resolution = resolution_for(n, size)
    held = (points > 0).sum(axis=1)
    for k in range(1, min(resolution, n - 1) + 1):
        assert (held == k).sum() == comb(n, k) * comb(resolution - 1, k - 1)
    assert (held == n).sum() >= max(1, size // 4)
    np.testing.assert_array_equal(points, simplex_cover(n, size))


@pytest.mark.parametrize(("n", "resolution"), [(3, 11), (4, 6), (8, 5)])
def test_no_belief_of_a_face_is_farther_from_a_grid_than_rounding_takes_it(n, resolution):
    tree = cKDTree(simplex_grid(n, resolution))
    for k in range(2, n + 1):
        face = next(combinations(range(n), k))
        beliefs = np.zeros((400, n))
        beliefs[:, face] = flat_beliefs(k, 400, seed=k)
        assert tree.query(beliefs)[0].max() <= sqrt(k / 4) / resolution + 1e-12


@pytest.mark.parametrize("n", [7, 8, 10, 12])
def test_a_cover_is_nearer_to_every_kind_of_belief_than_the_grid(n):
    grid, cover = simplex_grid(n, resolution_for(n, 5000)), simplex_cover(n, 5000)
    for beliefs, gain in ((flat_beliefs(n, 3000), 0.92), (sparse_beliefs(n, 3000), 0.99)):
        before, after = cKDTree(grid).query(beliefs)[0], cKDTree(cover).query(beliefs)[0]
        assert after.mean() <= gain * before.mean()
        assert after.max() <= 1.02 * before.max()


@pytest.mark.parametrize("n", [2, 3, 5, 8])
def test_the_interior_sequence_is_flat_and_more_even_than_chance(n):
    points = interior_points(n, 4001)
    np.testing.assert_allclose(points[0], 1 / n)
    assert (points > 0).all()
    np.testing.assert_allclose(points.mean(axis=0), 1 / n, atol=2e-3)
    # The marginals of a flat law: P(x_j <= q) = 1 - (1 - q)^(n-1).
    for share in (0.05, 0.2, 0.5):
        below = (points <= share).mean(axis=0)
        np.testing.assert_allclose(below, 1 - (1 - share) ** (n - 1), atol=1.5 / sqrt(4001))
    beliefs = flat_beliefs(n, 3000, seed=5)
    even, chance = cKDTree(points).query(beliefs)[0], cKDTree(flat_beliefs(n, 4001, seed=6)).query(beliefs)[0]
    assert (even**2).mean() < (chance**2).mean()


@pytest.mark.parametrize("n", [2, 3, 5, 8, 12])
def test_the_estimated_radius_is_a_little_below_the_largest_distance(n):
    points = simplex_cover(n, 2000)
    beliefs = np.vstack([flat_beliefs(n, 20_000), sparse_beliefs(n, 20_000)])
    largest = cKDTree(points).query(beliefs)[0].max()
    assert 0.75 * largest <= covering_radius(points) <= 1.1 * largest


def test_the_radius_of_one_vertex_is_nearly_the_edge_and_of_one_state_nothing():
    assert 1.2 < covering_radius(np.array([[1.0, 0.0, 0.0]])) <= sqrt(2)
    assert covering_radius(np.ones((1, 1))) == 0


@pytest.mark.parametrize("arguments", [(0, 5), (3, 0), (2.5, 4), (3, 1.5)])
def test_a_cover_is_refused_for_what_is_no_size(arguments):
    with pytest.raises(InputError):
        simplex_cover(*arguments)


def test_equal_rows_are_found_by_all_pairs():
    rng = np.random.default_rng(3)
    for columns, count in ((1, 300), (2, 300), (20, 300), (1, 4), (2, 9)):
        rows = rng.integers(-2, 3, (count, columns)) * 0.25
        rows = np.vstack([rows, np.eye(columns), -0.0 * np.eye(columns), rows[::7] + 1e-13])
        near = np.abs(rows[:, None] - rows[None]).max(axis=2) <= 1e-11
        np.testing.assert_array_equal(first_equal(rows), near.argmax(axis=1))


def test_rows_that_differ_by_more_than_the_tolerance_are_two():
    rows = np.array([[0.5, 0.5], [0.5 + 1e-10, 0.5 - 1e-10], [0.5, 0.5]])
    assert first_equal(rows).tolist() == [0, 1, 0]


def test_equal_rows_do_not_depend_on_luck_with_hashes(monkeypatch):
    rows = np.random.default_rng(4).integers(0, 2, (200, 3)).astype(float)
    wanted = first_equal(rows)
    monkeypatch.setattr("inscrutable.geometry.equal_rows._hashed", lambda bits: np.zeros(len(bits), dtype=np.uint64))
    np.testing.assert_array_equal(first_equal(rows), wanted)


def test_equal_rows_of_no_rows_and_of_huge_ones():
    assert first_equal(np.zeros((0, 3))).tolist() == []
    assert first_equal(np.array([[1e200], [-1e200], [1e200]])).tolist() == [0, 1, 0]
