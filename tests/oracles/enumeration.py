"""Optimal costs by enumerating supports or active rows, and the best mixture of points by enumerating pairs."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from oracles.markets import Market

Array = NDArray[np.float64]

NEGATIVE_WEIGHT = 1e-12  # an enumerated point this far outside is the rounding of one on the boundary


def supports(n_assets: int) -> Iterator[list[int]]:
    """Yield every non-empty set of assets, smallest first."""
    for size in range(1, n_assets + 1):
        yield from (list(chosen) for chosen in combinations(range(n_assets), size))


def value(market: Market, belief: Array) -> tuple[float, Array]:
    """Return V(π) and a minimiser over the simplex: the cheapest non-negative stationary point of any support.

    Exact to about 1e-14 times the condition number of the covariances; 2^U − 1 small systems.
    """
    costs, actions = values(market, belief[None])
    return float(costs[0]), actions[0]


def values(market: Market, beliefs: Array) -> tuple[Array, Array]:
    """Return the same of many beliefs (B,X), support by support: shapes (B,), (B,U)."""
    hessians = 2 * market.risk_aversion * np.tensordot(beliefs, market.covariances, 1)
    linears = -(beliefs @ market.means)
    best, winners = np.full(len(beliefs), np.inf), np.full(linears.shape, np.nan)
    for held in supports(linears.shape[1]):
        actions = np.zeros(linears.shape)
        actions[:, held] = stationary(hessians[:, held][:, :, held], linears[:, held])
        costs = ((hessians @ actions[:, :, None])[:, :, 0] / 2 + linears) * actions
        found = np.where(feasible(actions), costs.sum(axis=1), np.inf)
        better = found < best
        best[better], winners[better] = found[better], actions[better]
    return best, winners


def stationary(hessians: Array, linears: Array) -> Array:
    """Return the stationary points of ½u'Hu + g'u where 1'u = 1, the shortest where there are several."""
    many, size = linears.shape
    systems = np.ones((many, size + 1, size + 1))
    systems[:, :size, :size] = hessians
    systems[:, size, size] = 0.0
    right = np.concatenate([-linears, np.ones((many, 1))], axis=1)
    inverses = np.linalg.pinv(systems, rcond=(size + 1) * np.finfo(float).eps)
    return np.asarray((inverses @ right[:, :, None])[:, :size, 0])


def feasible(actions: Array) -> NDArray[np.bool_]:
    """Whether points lie on the simplex, but for rounding."""
    return np.asarray((actions.min(axis=1) >= -NEGATIVE_WEIGHT) & (np.abs(actions.sum(axis=1) - 1) <= 1e-9))


def quadratic_value(
    hessian: Array, linear: Array, a_ub: Array, b_ub: Array, a_eq: Array, b_eq: Array
) -> tuple[float, Array]:
    """Return the least of ½u'Hu + g'u over {A_ub u <= b_ub, A_eq u = b_eq}, and where, for H positive definite.

    Every set of at most U rows is tried as the tight one; the cheapest feasible stationary point is the minimum.
    """
    size = linear.size
    best, winner = np.inf, np.full(size, np.nan)
    for n_tight in range(min(size, len(a_ub)) + 1):
        for tight in combinations(range(len(a_ub)), n_tight):
            rows = np.vstack([a_eq, a_ub[list(tight)]])
            zeros = np.zeros((len(rows), len(rows)))
            system = np.block([[hessian, rows.T], [rows, zeros]])
            right = np.concatenate([-linear, b_eq, b_ub[list(tight)]])
            solution = np.linalg.lstsq(system, right, rcond=None)[0]
            action = solution[:size]
            scale = 1 + np.abs(right).max()
            if np.abs(system @ solution - right).max() > 1e-9 * scale or (a_ub @ action - b_ub).max(initial=0) > 1e-9:
                continue
            cost = float(action @ hessian @ action / 2 + linear @ action)
            if cost < best:
                best, winner = cost, action
    return best, winner


def upper_concave_envelope(regrets: Array, privacies: Array, budget: float) -> float:
    """Return the best Σ pΨ over mixtures with Σ pρ <= budget, by trying all points and all pairs; −inf if none."""
    kept = np.isfinite(privacies)
    points = list(zip(regrets[kept].tolist(), privacies[kept].tolist(), strict=True))
    best = max((privacy for regret, privacy in points if regret <= budget), default=-np.inf)
    for low, below in points:
        for high, above in points:
            if low <= budget < high:
                share = (budget - low) / (high - low)
                best = max(best, (1 - share) * below + share * above)
    return float(best)


def pdm_lp(regrets: Array, privacies: Array, budget: float) -> tuple[float, Array]:
    """Return the value and probabilities of max p'Ψ, p'ρ <= budget, 1'p = 1, p >= 0; −inf, zeros if infeasible."""
    kept = np.flatnonzero(np.isfinite(privacies))
    probabilities = np.zeros(len(regrets))
    if kept.size == 0:
        return -np.inf, probabilities
    scale = max(1e-300, float(np.abs(regrets[kept]).max()))
    answer: Any = linprog(
        -privacies[kept],
        A_ub=regrets[kept][None, :] / scale,
        b_ub=[budget / scale],
        A_eq=np.ones((1, kept.size)),
        b_eq=[1.0],
        method="highs",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    if answer.status != 0:
        return -np.inf, probabilities
    probabilities[kept] = answer.x
    return float(-answer.fun), probabilities
