"""Which costs written in CVXPY have kinks on the feasible set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems.constraints import Polyhedron
from inscrutable.problems.expressions import tree_of

_KINKED = {
    "abs",
    "cummax",
    "dotsort",
    "lambda_max",
    "lambda_sum_largest",
    "max",
    "maximum",
    "min",
    "minimum",
    "norm1",
    "norm_inf",
    "normNuc",
    "sigma_max",
    "sum_largest",
}
"""Names of CVXPY's atoms that have kinks inside their domain."""


def has_kinks(costs: Sequence[Any], variable: Any, region: Polyhedron) -> bool:
    """Whether some cost has an atom with a kink, or a norm of something that can be zero on the feasible set."""
    pending = list(costs)
    while pending:
        part = pending.pop()
        if part.is_affine():
            continue
        name, inner = type(part).__name__, part.args[0]
        if name in _KINKED and not (name in ("abs", "norm1") and (inner.is_nonneg() or inner.is_nonpos())):
            return True
        if name.lower().startswith("pnorm") and _can_be_zero(inner, variable, region):
            return True
        pending += part.args
    return False


def _can_be_zero(inner: Any, variable: Any, region: Polyhedron) -> bool:
    """Whether an expression is zero at some decision; assumed where it is not affine."""
    if not inner.is_affine():
        return True
    tree = tree_of(inner, variable)
    if tree.slope is None:
        return False
    equal = np.vstack([region.A_eq, tree.slope.T])
    sides = np.concatenate([region.b_eq, -np.ravel(tree.offset)])
    answer = minimise(np.zeros(region.n_actions), Rows(region.A_ub, region.b_ub), Rows(equal, sides))
    return answer.status == OPTIMAL
