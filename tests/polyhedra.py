"""Random feasible sets with everything that users' rows have: repeats, scales, implied equalities, corners, open ends."""

from __future__ import annotations

import numpy as np

from inscrutable import Polyhedron, QuadraticProblem, box, simplex

KINDS = [
    "plain",
    "redundant",
    "duplicated",
    "scaled",
    "opposite rows",
    "repeated equality",
    "implied equality",
    "degenerate vertex",
    "open",
    "pinned",
    "sectors",
    "long and short",
]


def random_region(rng: np.random.Generator, kind: str, size: int) -> Polyhedron:
    """Return a set with a decision that is well inside all rows that do not hold everywhere."""
    inner = rng.dirichlet(np.ones(size))
    count = int(rng.integers(size, 2 * size + 1))
    rows = rng.normal(size=(count, size))
    sides = rows @ inner + rng.uniform(0.02, 0.6, size=count)
    around = box(inner - rng.uniform(0.3, 1, size), inner + rng.uniform(0.3, 1, size))
    cut, ones = Polyhedron(rows, sides), np.ones(size)
    invested = Polyhedron(A_eq=[ones], b_eq=[1.0])
    if kind == "plain":
        return around & cut
    if kind == "redundant":
        return around & cut & invested & Polyhedron([rows[0] + rows[1], ones], [sides[0] + sides[1], 1.0])
    if kind == "duplicated":  # in one set: an intersection keeps each limit once
        both = around & cut
        return Polyhedron(np.vstack([both.A_ub, both.A_ub]), np.tile(both.b_ub, 2))
    if kind == "scaled":
        units = 10.0 ** rng.integers(-3, 4, size=count)
        scaled = (rows, rows * units[:, None], 7.3 * rows), (sides, sides * units, 7.3 * sides)
        return around & Polyhedron(np.vstack(scaled[0]), np.concatenate(scaled[1]))
    if kind == "opposite rows":
        return around & cut & Polyhedron([ones, -ones], [1.0, -1.0])
    if kind == "repeated equality":
        return around & Polyhedron(rows[:1], sides[:1], [ones, 3 * ones], [1.0, 3.0])
    if kind == "implied equality":
        other = rng.normal(size=size)
        level = other @ inner
        return around & invested & Polyhedron([ones, -ones, other, -other], [1.0, -1.0, level, -level])
    if kind == "degenerate vertex":  # more rows than coordinates meet where the costs lead
        normals = rng.normal(size=(size + int(rng.integers(1, 4)), size))
        normals[:, 0] = np.abs(normals[:, 0]) + 0.2
        return Polyhedron(normals, normals @ inner) & box(inner - 2, inner + 2)
    if kind == "open":
        return Polyhedron(rows[:2], sides[:2])
    if kind == "pinned":
        low, high = inner - 0.4, inner + 0.4
        low[0] = high[0] = inner[0]
        return box(low, high) & Polyhedron(rows[:2], sides[:2])
    if kind == "sectors":
        groups = np.zeros((2, size))
        groups[0, : size // 2], groups[1, size // 2 :] = 1, 1
        return simplex(size) & Polyhedron(groups, [0.7, 0.6]) & Polyhedron(-groups, [-0.2, -0.3])
    return box(-0.5 * ones, 0.5 * ones) & invested & Polyhedron(rng.choice([-1.0, 1.0], size=(4, size)), [1.2] * 4)


def random_problem(rng: np.random.Generator, kind: str, n_states: int, size: int) -> QuadraticProblem:
    """Return strictly convex costs over a random set; they close the directions in which an open one has no end."""
    region = random_region(rng, kind, size)
    factors = rng.normal(size=(n_states, size, size))
    hessians = factors @ factors.transpose(0, 2, 1) / size + 0.05 * np.eye(size)
    linear = rng.normal(size=(n_states, size)) * rng.choice([1, 1, 4, 20])
    if kind == "degenerate vertex":
        linear[:, 0] -= 4.0 * np.abs(linear).max()
    return QuadraticProblem(hessians, linear, constraints=region)
