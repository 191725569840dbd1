"""The one interface to HiGHS: linear programmes with the tightest tolerances it accepts, and typed answers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linprog

from inscrutable import tolerances
from inscrutable.errors import SolverError
from inscrutable.validation import Array

OPTIMAL = 0
"""The status of `scipy.optimize.linprog` for a programme solved to its tolerance."""

_INFEASIBLE = 2
_DECIDED = (OPTIMAL, _INFEASIBLE, 3)
"""Statuses that answer the question: solved, infeasible, unbounded."""

_WAYS: Any = (("highs", {}), ("highs-ipm", {}), ("highs-ds", {"presolve": False}), ("highs-ipm", {"presolve": False}))
"""Methods of HiGHS, tried until one answers: at these tolerances each fails on some small programmes that others solve. Of
71,600 programmes of learned costs the first failed on one, which both interior-point methods solved. In a long comparison the
first three once failed on the same one; whether the last solves that is not known. With presolving each finds some feasible
programmes infeasible, such as Σ x = 1 between bounds 5e-11 beside .15, .25, …: what it excludes is solved again without."""

_FREE = (None, None)


class LinearAnswer(NamedTuple):
    """Answer of a linear programme; `x` is NaN unless the status is `OPTIMAL`."""

    status: int
    x: Array
    value: float
    duals: Array  # of the inequality rows, at most 0
    message: str


class Rows(NamedTuple):
    """Rows A x ≤ b or A x = b."""

    matrix: Any  # (n, k), plain or sparse
    sides: Array


Bound = tuple[float | None, float | None]


def minimise(
    objective: Array,
    below: Rows | None = None,
    equal: Rows | None = None,
    bounds: Bound | Sequence[Bound] = _FREE,
    *,
    interior: bool = False,
) -> LinearAnswer:
    """Return min objective'x over rows `below` and `equal`; variables are free unless bounded.

    `interior` tries the interior-point method first, which is faster on large, degenerate programmes.
    """
    upper = None if below is None or not len(below.sides) else below
    exact = None if equal is None or not len(equal.sides) else equal
    solve: Any = linprog  # its overloads are too many for a type checker
    answer: Any = None
    for method, options in (_WAYS[1], _WAYS[0], *_WAYS[2:]) if interior else _WAYS:
        is_plain = options.get("presolve") is False
        if answer is not None and answer.status == _INFEASIBLE and not is_plain:
            continue
        answer = solve(
            objective,
            A_ub=None if upper is None else upper.matrix,
            b_ub=None if upper is None else upper.sides,
            A_eq=None if exact is None else exact.matrix,
            b_eq=None if exact is None else exact.sides,
            bounds=bounds,
            method=method,
            options={
                "primal_feasibility_tolerance": tolerances.LINEAR_PROGRAMME,
                "dual_feasibility_tolerance": tolerances.LINEAR_PROGRAMME,
                **options,
            },
        )
        if answer.status in _DECIDED and (is_plain or answer.status != _INFEASIBLE):
            break
    if answer.x is None or answer.fun is None or answer.status != OPTIMAL:
        nothing = np.full(objective.size, np.nan)
        return LinearAnswer(int(answer.status), nothing, float("nan"), np.zeros(0), str(answer.message))
    duals = np.zeros(0) if upper is None else np.asarray(answer.ineqlin.marginals, dtype=np.float64)
    return LinearAnswer(OPTIMAL, np.asarray(answer.x, dtype=np.float64), float(answer.fun), duals, str(answer.message))


def minimum(
    objective: Array,
    below: Rows | None = None,
    equal: Rows | None = None,
    bounds: Bound | Sequence[Bound] = _FREE,
    *,
    interior: bool = False,
) -> LinearAnswer:
    """Return the answer of a programme that has an optimum; raise `SolverError` where HiGHS finds none."""
    answer = minimise(objective, below, equal, bounds, interior=interior)
    if answer.status != OPTIMAL:
        raise SolverError(f"HiGHS found no optimum of a linear programme that has one: {answer.message}")
    return answer
