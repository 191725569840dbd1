"""Kernels have room for faces whose cone of multipliers has more facets than rows: run in Python, where indices are checked."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from sizes import some

RUN = """
import numpy as np
from inscrutable import Budget, CounterAdversarialDecisionMaker, Polyhedron, QuadraticProblem, decoy_grid

rng = np.random.default_rng({seed})
size = 6
sides = np.vstack([np.eye(size - 1), -np.eye(size - 1)])
rows = np.column_stack([sides, np.ones(len(sides))])  # at 0 all ten are tight: |u_j| <= -u_6, a cone with 32 facets
region = Polyhedron(np.vstack([rows, -np.eye(size)]), [*np.zeros(len(rows)), *np.ones(size)])
toward = np.column_stack([0.5 * rng.normal(size=(3, size - 1)), np.ones(3)])
problem = QuadraticProblem([(1 + i) * np.eye(size) for i in range(3)], -toward, constraints=region)
maker = CounterAdversarialDecisionMaker(problem, Budget.regret(0.05), candidates=decoy_grid(problem, 6))
belief = rng.dirichlet(np.ones(3))
made = maker.decide(belief)
assert made.privacy >= 0 and made.regret <= 0.05
print(f"{{made.privacy:.12f}}")
"""


@pytest.mark.parametrize("seed", some(range(2), 2))
def test_faces_with_more_facets_than_rows(seed):
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    found = subprocess.run(
        [sys.executable, "-c", RUN.format(seed=seed)], env=environment, capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
