"""Constraints of CVXPY with norms, absolute values, maxima or variables of their own, as rows and limits on magnitudes.

CVXPY states them as rows in more variables: t ≥ x, t ≥ −x, Σt ≤ L for a norm. A variable that equalities determine is
substituted; one whose upper limits contain no other variable is removed by Fourier–Motzkin elimination; one with two lower
limits in the decision is their maximum, (a + b)/2 + |a − b|/2.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.errors import InputError, ModelError
from inscrutable.problems.constraints import Polyhedron
from inscrutable.problems.magnitudes import MOST_SIGNED, limited
from inscrutable.problems.segments import MagnitudeLimit
from inscrutable.validation import Array

_ROUNDING = tolerances.STATIONARITY
_LONGEST_NAME = 60


class Lifted(NamedTuple):
    """Rows A x ≤ b of a decision, of variables to be eliminated, and of magnitudes |α'u − β| with weights of at least 0."""

    rows: Array  # (m, U + W)
    sides: Array  # (m,)
    size: int  # U
    weights: Array  # (m, K)
    terms: Array  # (K, U)
    centers: Array  # (K,)


def constrained(cvxpy: Any, variable: Any, constraints: Sequence[Any], rows: Polyhedron) -> Polyhedron:
    """Return rows with constraints of CVXPY that are not affine in the decision alone.

    Raises:
        InputError: A constraint is not convex and piecewise linear, or more than sums of magnitudes of single coordinates.
        ModelError: A constraint holds for every decision.
    """
    alone = [each for each in constraints if all(other.id == variable.id for other in each.variables())]
    region = rows
    for group in [*([each] for each in alone), [each for each in constraints if not any(each is one for one in alone)]]:
        region = _read(cvxpy, variable, group, region) if group else region
    return region


def _read(cvxpy: Any, variable: Any, constraints: Sequence[Any], rows: Polyhedron) -> Polyhedron:
    """Rows with constraints that may share variables of their own."""
    name = "; ".join(str(each) for each in constraints)
    found = _without_others(_stated(cvxpy, variable, constraints, name), name)
    named = name[:_LONGEST_NAME]
    has_kinks = found.weights.any(axis=1)
    plain = Polyhedron(
        found.rows[~has_kinks], found.sides[~has_kinks], names=[f"{named}[{i}]" for i in range(int((~has_kinks).sum()))]
    )
    region = rows & plain if len(plain.b_ub) else rows
    for row in np.flatnonzero(has_kinks):
        for limit in _limits(found, int(row), name):
            region = limited(region, limit._replace(name=named))
    return region


def _stated(cvxpy: Any, variable: Any, constraints: Sequence[Any], name: str) -> Lifted:
    """The constraints as CVXPY hands them to a solver of linear programmes."""
    for each in constraints:
        if not getattr(each, "is_dcp", lambda: False)() or each.parameters():
            raise InputError(f"constraint {each} must be convex by CVXPY's rules, without parameters")
        if any(other.attributes["integer"] or other.attributes["boolean"] for other in each.variables()):
            raise InputError(f"constraint {each} has whole numbers: the feasible set must be convex")
    own = cvxpy.Variable(variable.size)  # a plain one, which CVXPY does not replace as it does one with declared signs
    problem = cvxpy.Problem(cvxpy.Minimize(0), [own == variable, *constraints])
    data = problem.get_problem_data(cvxpy.CLARABEL)[0]
    dims = data["dims"]
    if dims.soc or dims.psd or dims.exp or dims.p3d:
        raise InputError(f"constraint {name} must be affine or piecewise linear: norms 1 and inf, abs, max, pos")
    matrix = data["A"].toarray()
    first, size = data["param_prob"].var_id_to_col[own.id], int(own.size)
    order = np.r_[first : first + size, 0:first, first + size : matrix.shape[1]]
    matrix, sides = matrix[:, order], np.array(data["b"], dtype=np.float64)
    below, sides = _substituted(matrix, sides, int(dims.zero), size)
    nothing = np.zeros((len(sides), 0))
    return Lifted(below, sides, size, nothing, np.zeros((0, size)), np.zeros(0))


def _substituted(matrix: Array, sides: Array, n_equal: int, size: int) -> tuple[Array, Array]:
    """Inequalities after substitution of variables that equalities determine; remaining equalities become two inequalities."""
    matrix, sides = matrix.copy(), sides.copy()
    left = np.ones(n_equal, dtype=bool)
    for row in range(n_equal):
        others = np.abs(matrix[row, size:])
        if others.max(initial=0.0) <= _ROUNDING:
            continue
        column = size + int(others.argmax())
        touched = np.flatnonzero(np.abs(matrix[:, column]) > _ROUNDING)
        touched = touched[touched != row]
        factor = matrix[touched, column] / matrix[row, column]
        matrix[touched] -= factor[:, None] * matrix[row]
        sides[touched] -= factor * sides[row]
        matrix[touched, column] = 0.0
        left[row] = False
    kept = np.flatnonzero(left & (np.abs(matrix[:n_equal]).max(axis=1, initial=0.0) > _ROUNDING))
    both = np.vstack([matrix[n_equal:], matrix[kept], -matrix[kept]])
    both[np.abs(both) <= _ROUNDING] = 0.0
    return both, np.concatenate([sides[n_equal:], sides[kept], -sides[kept]])


def _without_others(found: Lifted, name: str) -> Lifted:
    """The rows without variables other than the decision's."""
    for alone in (True, False) * (found.rows.shape[1] - found.size + 1):
        left = found.size + np.flatnonzero(found.rows[:, found.size :].any(axis=0))
        if not left.size:
            return found._replace(rows=found.rows[:, : found.size])
        for column in left:
            found = _eliminated(found, int(column), alone)
    raise InputError(
        f"constraint {name} does not reduce to rows and sums of magnitudes of single coordinates: state it as affine rows"
    )


def _eliminated(found: Lifted, column: int, alone: bool) -> Lifted:
    """Rows without a variable, where that is possible: by pairs of limits (`alone`), or as a maximum of two lower ones."""
    values = found.rows[:, column]
    lower, upper, rest = np.flatnonzero(values < 0), np.flatnonzero(values > 0), np.flatnonzero(values == 0)
    others = [k for k in range(found.size, found.rows.shape[1]) if k != column]
    if found.rows[lower][:, others].any() or found.weights[lower].any():
        return found
    if not lower.size or not upper.size:
        return _picked(found, rest)
    if alone:
        if lower.size > 1 and (found.rows[upper][:, others].any() or found.weights[upper].any()):
            return found
        first, second = (each.ravel() for each in np.meshgrid(lower, upper, indexing="ij"))
        share = values[second] / -values[first]
        rows = found.rows[second] + share[:, None] * found.rows[first]
        rows[:, column] = 0.0
        sides = found.sides[second] + share * found.sides[first]
        kept = _picked(found, np.concatenate([rest, second]))
        return kept._replace(rows=np.vstack([found.rows[rest], rows]), sides=np.append(found.sides[rest], sides))
    if lower.size != 2:
        return found
    # t >= a'u − p and t >= b'u − q: t = ((a + b)'u − p − q)/2 + |(a − b)'u − (p − q)|/2.
    bounds = found.rows[lower] / -values[lower, None]
    shifts = found.sides[lower] / -values[lower]
    rows, sides = found.rows.copy(), found.sides.copy()
    mean = 0.5 * bounds.sum(axis=0)
    mean[column] = 0.0
    rows[upper] += values[upper, None] * mean
    rows[:, column] = 0.0
    sides[upper] += values[upper] * 0.5 * shifts.sum()
    weights = np.zeros((len(sides), 1))
    weights[upper, 0] = 0.5 * values[upper]
    term = (bounds[0] - bounds[1])[: found.size]
    grown = found._replace(
        rows=rows,
        sides=sides,
        weights=np.hstack([found.weights, weights]),
        terms=np.vstack([found.terms, term]),
        centers=np.append(found.centers, shifts[0] - shifts[1]),
    )
    return _picked(grown, np.concatenate([rest, upper]))


def _picked(found: Lifted, rows: np.ndarray) -> Lifted:
    return found._replace(rows=found.rows[rows], sides=found.sides[rows], weights=found.weights[rows])


def _limits(found: Lifted, row: int, name: str) -> list[MagnitudeLimit]:
    """One row as limits on sums of magnitudes of coordinates; other magnitudes by their signs."""
    used = np.flatnonzero((found.weights[row] > 0) & found.terms.any(axis=1))
    constant = (found.weights[row] * np.abs(found.centers))[~found.terms.any(axis=1)].sum()
    single = used[np.count_nonzero(found.terms[used], axis=1) == 1]
    mixed = np.setdiff1d(used, single)
    if mixed.size > MOST_SIGNED:
        raise InputError(
            f"constraint {name} has {mixed.size} magnitudes of combinations, expected {MOST_SIGNED} at most"
        )
    place = np.abs(found.terms[single]).argmax(axis=1)
    factor = found.terms[single, place]
    depth = np.array([int((place[:k] == j).sum()) for k, j in enumerate(place)], dtype=np.int64)
    weights = np.zeros((int(depth.max(initial=0)) + 1, found.size))
    centers = np.zeros_like(weights)
    weights[depth, place] = found.weights[row, single] * np.abs(factor)
    centers[depth, place] = found.centers[single] / factor
    limits = []
    for signs in product(*((1.0, -1.0),) * mixed.size):
        share = np.array(signs) * found.weights[row, mixed]
        most = float(found.sides[row] - constant + share @ found.centers[mixed])
        limits.append(MagnitudeLimit(weights, centers, most, name, found.rows[row] + share @ found.terms[mixed]))
    if not weights.any() and not limits:
        raise ModelError(f"constraint {name} holds for every decision: leave it out")
    return limits
