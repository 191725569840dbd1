"""The set of beliefs that explain an action, queried in its lifted form.

Π(u) = {π ∈ Δ : ∃ λ >= 0, ν : Gπ + A_act'λ + A_eq'ν = 0}, with G the (U,X) gradients at u and A_act the tight
rows of A_ub u <= b_ub. G is scaled to a largest entry of one, each row to unit length; neither changes the set.
Every query but `vertices` and `hull_distance` asks a solver about the variables (π, λ, ν) together.

Accuracy, as agreement of `bounds` and `distance` with `vertices` on hundreds of optimal actions in test_oracles.py:
`smallest_residual` 1e-13, `bounds`, `support` and `distance` 1e-11, `vertices` 1e-12, `hull_distance` 1e-13 while the
states' costs are of like size or the covariances singular; 1e-9 for all when they differ by three orders of magnitude,
1e-7 by five. From there on the set itself moves under rounding of the action, and Clarabel may stop with an error.
"""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import linprog

Array = NDArray[np.float64]
Domain = list[tuple[float | None, float | None]]

TIGHT = 1e-10  # HiGHS accepts no smaller feasibility tolerance
EXPLAINED = 1e-9  # largest stationarity residual, of a scaled system, that counts as zero
RANK = 1e-9  # singular values below this share of the largest count as zero


class System(NamedTuple):
    """Scaled gradients (U,X), tight inequality rows (m,U) and equality rows (p,U)."""

    gradients: Array
    active: Array
    equalities: Array


def kkt_system(gradients: Array, active: Array, equalities: Array) -> System:
    """Scale the three blocks; a gradient of zero stays zero."""
    size = gradients.shape[0]
    scale = float(np.abs(gradients).max()) or 1.0
    active, equalities = active.reshape(-1, size), equalities.reshape(-1, size)
    return System(gradients / scale, _unit_rows(active), _unit_rows(equalities))


def simplex_system(gradients: Array, held: NDArray[np.bool_]) -> System:
    """Return the system of {1'u = 1, u >= 0} for a boolean mask of held assets (U,)."""
    size = gradients.shape[0]
    return kkt_system(gradients, -np.eye(size)[~np.asarray(held, dtype=bool)], np.ones((1, size)))


def tight_rows(a_ub: Array, b_ub: Array, action: Array, min_slack: float = 0.0) -> NDArray[np.bool_]:
    """Return the mask of rows with less slack than `min_slack`, up to rounding."""
    slack = b_ub - a_ub @ action
    return np.asarray(slack < min_slack * (1 - 1e-9) + (1e-12 if min_slack == 0 else 0.0))


def _unit_rows(rows: Array) -> Array:
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.asarray(rows / np.where(lengths > 0, lengths, 1.0))


def _stationarity(system: System) -> Array:
    return np.hstack([system.gradients, system.active.T, system.equalities.T])


def _domain(system: System) -> Domain:
    n_states, n_active, n_equal = system.gradients.shape[1], len(system.active), len(system.equalities)
    return [(0, 1)] * n_states + [(0, None)] * n_active + [(None, None)] * n_equal


def _solve(objective: Array, a_ub: Array | None, b_ub: Array | None, a_eq: Array, b_eq: Array, domain: Domain) -> Array:
    """Return the minimiser of a linear programme by HiGHS; NaN when infeasible."""
    options: Any = {"primal_feasibility_tolerance": TIGHT, "dual_feasibility_tolerance": TIGHT}
    for presolve in (True, False):
        options["presolve"] = presolve
        answer: Any = linprog(objective, a_ub, b_ub, a_eq, b_eq, domain, method="highs", options=options)
        if answer.status == 0:
            return np.asarray(answer.x)
    if answer.status == 2:
        return np.full(len(objective), np.nan)
    raise RuntimeError(f"HiGHS: {answer.message}")


def smallest_residual(system: System) -> float:
    """Return min over π ∈ Δ, λ >= 0, ν of the largest |entry| of Gπ + A_act'λ + A_eq'ν, G scaled."""
    matrix = _stationarity(system)
    n_rows, n_columns = matrix.shape
    ones = np.ones((n_rows, 1))
    belief_sum = np.zeros((1, n_columns + 1))
    belief_sum[0, : system.gradients.shape[1]] = 1.0
    answer = _solve(
        np.append(np.zeros(n_columns), 1.0),
        np.block([[matrix, -ones], [-matrix, -ones]]),
        np.zeros(2 * n_rows),
        belief_sum,
        np.ones(1),
        [*_domain(system), (0, None)],
    )
    return float(np.abs(matrix @ answer[:-1]).max(initial=0.0))


def is_empty(system: System, tolerance: float = EXPLAINED) -> bool:
    """Say whether no belief makes the scaled action stationary within `tolerance`."""
    return smallest_residual(system) > tolerance


def support(system: System, direction: Array) -> Array:
    """Return a belief of Π(u) that maximises direction·π; NaN where Π(u) is empty."""
    return supports(system, np.asarray(direction, dtype=float)[None])[0]


def supports(system: System, directions: Array) -> Array:
    """Return the same for each row of `directions` (k,X), by one programme of k blocks that share nothing."""
    matrix = _stationarity(system)
    (n_rows, n_columns), n_states, n_blocks = matrix.shape, system.gradients.shape[1], len(directions)
    block = np.vstack([matrix, np.zeros((1, n_columns))])
    block[-1, :n_states] = 1.0
    objective = np.zeros((n_blocks, n_columns))
    objective[:, :n_states] = -np.asarray(directions, dtype=float)
    right = np.tile(np.append(np.zeros(n_rows), 1.0), n_blocks)
    rows = np.kron(np.eye(n_blocks), block)
    answer = _solve(objective.ravel(), None, None, rows, right, _domain(system) * n_blocks)
    return np.asarray(answer.reshape(n_blocks, n_columns)[:, :n_states])


def bounds(system: System) -> Array:
    """Return the least and the largest value of each belief coordinate, (X,2); NaN where empty."""
    unit = np.eye(system.gradients.shape[1])
    least, largest = np.split(supports(system, np.vstack([-unit, unit])), 2)
    return np.column_stack([np.diag(least), np.diag(largest)])


def distance(system: System, point: Array) -> float:
    """Return min ‖π − point‖ over Π(u) by an interior-point method in (π, λ, ν); +inf where empty."""
    return float(np.linalg.norm(nearest(system, point) - point)) if not is_empty(system) else np.inf


def nearest(system: System, point: Array) -> Array:
    """Return the nearest belief of a non-empty Π(u), by Clarabel: min ½‖π − point‖² over the lifted system."""
    clarabel = pytest.importorskip("clarabel")
    matrix = _stationarity(system)
    n_states, n_active, n_columns = system.gradients.shape[1], len(system.active), matrix.shape[1]
    n_signed = n_states + n_active
    belief_sum = np.zeros((1, n_columns))
    belief_sum[0, :n_states] = 1.0
    rows = np.vstack([matrix, belief_sum, -np.eye(n_columns)[:n_signed]])
    right = np.concatenate([np.zeros(len(matrix)), [1.0], np.zeros(n_signed)])
    weights = np.append(np.ones(n_states), np.zeros(n_columns - n_states))
    linear = np.append(-np.asarray(point, dtype=float), np.zeros(n_columns - n_states))
    cones = [clarabel.ZeroConeT(len(matrix) + 1), clarabel.NonnegativeConeT(n_signed)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = settings.reduced_tol_feas = 1e-9
    # Now and then it makes no progress to the first accuracy.
    for accuracy in (1e-13, 1e-9):
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = accuracy
        answer = clarabel.DefaultSolver(
            sparse.csc_matrix(np.diag(weights)), linear, sparse.csc_matrix(rows), right, cones, settings
        ).solve()
        if "Solved" in str(answer.status):
            return np.asarray(answer.x[:n_states])
    raise RuntimeError(f"Clarabel: {answer.status}")


def vertices(system: System) -> Array:
    """Return the extreme points (V,X) of Π(u) by brute force, for X <= 4; (0,X) where empty.

    By Carathéodory the multipliers can be carried by linearly independent rows, so Π(u) is the union over such
    row sets of polytopes from which λ and ν are eliminated; their corners hold every extreme point.
    """
    n_states = system.gradients.shape[1]
    corners: list[Array] = []
    for chosen in _row_bases(system):
        for corner in _corners(system, chosen):
            if all(np.abs(corner - other).max() > EXPLAINED for other in corners):
                corners.append(corner)
    extreme = [
        corner
        for index, corner in enumerate(corners)
        if hull_distance(corner, np.array(corners[:index] + corners[index + 1 :]).reshape(-1, n_states)) > EXPLAINED
    ]
    return np.array(extreme).reshape(-1, n_states)


def _row_bases(system: System) -> list[list[int]]:
    """Return the largest sets of tight rows that are independent together with the equalities."""
    n_active = len(system.active)
    n_equal = np.linalg.matrix_rank(system.equalities, tol=RANK) if len(system.equalities) else 0
    full = np.linalg.matrix_rank(np.vstack([system.active, system.equalities]), tol=RANK) if n_active else n_equal
    return [
        list(chosen)
        for chosen in combinations(range(n_active), full - n_equal)
        if np.linalg.matrix_rank(np.vstack([system.active[list(chosen)], system.equalities]), tol=RANK) == full
    ]


def _corners(system: System, chosen: list[int]) -> list[Array]:
    """Return the corners of {π ∈ Δ : the chosen rows carry the multipliers}, the multipliers eliminated."""
    gradients = system.gradients
    size, n_states = gradients.shape
    normals = np.vstack([system.active[chosen], system.equalities]).T.reshape(size, -1)
    inverse = np.linalg.pinv(normals) if normals.size else np.zeros((0, size))
    stationary = gradients - normals @ (inverse @ gradients)
    signs = np.vstack([np.eye(n_states), -(inverse @ gradients)[: len(chosen)]])
    left, singular, right = np.linalg.svd(np.vstack([np.ones((1, n_states)), stationary]), full_matrices=False)
    rank = int((singular > RANK * singular[0]).sum())
    equal = right[:rank]
    level = left[0, :rank] / singular[:rank]
    if np.abs(stationary @ (equal.T @ level)).max() > EXPLAINED or abs((equal.T @ level).sum() - 1) > EXPLAINED:
        return []
    found = []
    for tight in combinations(range(len(signs)), n_states - rank):
        rows = np.vstack([equal, signs[list(tight)]])
        if np.linalg.matrix_rank(rows, tol=RANK) < n_states:
            continue
        corner = np.linalg.solve(rows, np.append(level, np.zeros(n_states - rank)))
        if (signs @ corner).min() > -EXPLAINED:
            found.append(np.maximum(corner, 0.0) / np.maximum(corner, 0.0).sum())
    return found


def hull_distance(point: Array, corners: Array) -> float:
    """Return the distance of `point` from the convex hull of `corners` (V,X); +inf for no corners.

    The nearest point lies in the relative interior of the hull of at most X independent corners, and is then the
    projection on their affine hull: all such sets are tried.
    """
    best = np.inf
    for size in range(1, min(len(corners), corners.shape[1]) + 1):
        for chosen in combinations(range(len(corners)), size):
            base, *others = corners[list(chosen)]
            edges = np.array(others).reshape(-1, base.size).T - base[:, None]
            if size > 1 and np.linalg.matrix_rank(edges, tol=RANK) < size - 1:
                continue
            shares = np.linalg.lstsq(edges, point - base, rcond=None)[0] if size > 1 else np.zeros(0)
            if size == 1 or (shares.min() >= -1e-12 and shares.sum() <= 1 + 1e-12):
                best = min(best, float(np.linalg.norm(base + edges @ shares - point)))
    return best
