"""The counter-adversarial decision for private means: its implied views are farthest from the true mean, within a budget."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.sparse.linalg import LinearOperator, eigsh

from inscrutable import tolerances, validation
from inscrutable.alphas.problem import AlphaProblem, checked_alpha_problem
from inscrutable.alphas.views import ImpliedViews, implied_views
from inscrutable.budgets import Budget, as_budget
from inscrutable.decision_makers.statuses import DecisionStatus
from inscrutable.errors import InputError, ModelError
from inscrutable.saved import Saved
from inscrutable.validation import Array

_LARGE = 400  # signals from which on eigenvectors are computed one by one
_MOST_DOUBLINGS = 20
_TURNS = (0.6, 0.3, 0.15)
"""Relative lengths by which the best direction turns towards the others."""


_STARTS = 4
"""Directions from which the search turns; with one, 5 of 60 capped problems of four assets lose 8 to 52 % to random decoys."""


@dataclass(frozen=True, eq=False)
class AlphaDecision(Saved):
    """The optimal decision of a decoy, a mean other than the true one.

    Args:
        weights: u, shape (n,): the optimal decision for the decoy.
        decoy: m̂, shape (k,): one of the views that explain u.
        privacy: Distance from the true mean to the implied views Π(u), in the unit of m.
        regret: ρ(m,u), in the unit of returns.
        status: PROVED in closed form, where C has no inequalities; else LOCAL_OPTIMUM.

    Example:
        >>> problem = AlphaProblem([[0.04, 0.0], [0.0, 0.01]], risk_aversion=2.5)
        >>> print(obfuscated_decision(problem, [0.02, 0.01], Budget.regret(0.001)))
        privacy 0.02 at a regret of 0.001 (proved: no affordable decision is more private)
    """

    weights: Array
    decoy: Array
    privacy: float
    regret: float
    status: DecisionStatus

    def summary(self) -> str:
        """Return privacy, regret and status in a line."""
        return f"privacy {self.privacy:.6g} at a regret of {self.regret:.6g} ({self.status.value})"

    def __str__(self) -> str:
        return self.summary()


def obfuscated_decision(
    problem: AlphaProblem, mean: ArrayLike, budget: Budget | float, *, n_directions: int = 6
) -> AlphaDecision:
    """Return the decision u*(m̂) whose implied views are farthest from the true mean at an affordable regret.

    Formula: max_m̂ dist(m, Π(u*(m̂))) subject to ρ(m, u*(m̂)) ≤ r. Without inequalities it is √(r/λ), λ the least eigenvalue of
    Θ above zero, along its eigenvector: for B = I and no constraints √(4γ r λ_max(V)), along V's first eigenvector, the
    riskiest direction. Privacy is concave in r, so randomisation gains nothing.

    Args:
        problem: The decision problem.
        mean: m, shape (k,), the true private mean.
        budget: A share of |c*|, or `Budget.regret(r)`.
        n_directions: With inequalities: the number of eigenvectors, of either sign, at which the search starts. Regret grows
            along each ray from m, and the search follows a ray until the budget is spent.

    Raises:
        InputError: Malformed arguments.
        ModelError: No signal changes any decision, so decisions reveal nothing.

    Returns:
        `AlphaDecision`; a closed form has two signs, and the one with the smaller positions is returned.

    Cost: one eigenvector; with inequalities some thousand decisions, half a second for four assets. Source: the paper,
        Section III-C, measure (e), for Gaussian beliefs.

    Example:
        >>> problem = AlphaProblem([[0.04, 0.0], [0.0, 0.01]], risk_aversion=2.5)
        >>> found = obfuscated_decision(problem, [0.02, 0.01], Budget.regret(0.001))
        >>> found.decoy.round(4).tolist(), round(found.privacy, 4)
        ([0.0, 0.01], 0.02)
    """
    checked_alpha_problem(problem)
    held = problem.check_mean(mean)
    if held.ndim != 1:
        raise InputError(f"mean must be one mean of shape ({problem.n_signals},), got shape {held.shape}")
    best = problem.optimum(held)
    cost = problem.risk_aversion * problem.risk.quadratic(best) - problem.alphas(held) @ best
    limit = as_budget(budget).limit(float(cost))
    directions = _cheapest_directions(problem, validation.count(n_directions, "n_directions"))
    if problem.has_inequalities:
        return _searched(problem, held, limit, directions)
    way = directions[0] / float(np.sqrt(directions[0] @ problem.theta_times(directions[0])))
    decoys = [held + sign * np.sqrt(limit) * way for sign in (1.0, -1.0)]
    found = [(problem.optimum(decoy), decoy) for decoy in decoys]
    weights, decoy = min(found, key=lambda pair: float(np.abs(pair[0]).sum()))
    privacy = float(np.sqrt(limit) * np.linalg.norm(way))
    return AlphaDecision(weights, decoy, privacy, float(problem.regret(held, weights)), DecisionStatus.PROVED)


def _cheapest_directions(problem: AlphaProblem, most: int) -> Array:
    """Return the eigenvectors (q,k) of Θ with the least positive eigenvalues, in ascending order."""
    if problem.loadings is None and problem.n_assets > max(_LARGE, 2 * most):
        rows = np.linalg.qr(problem.equalities[0].T)[0]

        def inside(values: Array) -> Array:
            return np.asarray(values - rows @ (rows.T @ values))

        n = problem.n_assets
        risk: Any = LinearOperator((n, n), matvec=lambda values: inside(problem.risk.times(inside(values.ravel()))))
        # The greatest eigenvalues of V on the null space of the equalities.
        vectors = eigsh(
            risk, k=most, which="LA", v0=inside(np.sqrt(problem.risk.diagonal)), tol=tolerances.STATIONARITY
        )[1]
        return np.asarray(vectors.T[::-1])
    values, vectors = np.linalg.eigh(problem.theta)
    felt = np.flatnonzero(values > tolerances.CURVATURE * max(float(values[-1]), 0.0))
    if not felt.size or values[-1] <= 0.0:
        raise ModelError("no signal moves any decision: decisions reveal nothing, and there is nothing to hide")
    return np.asarray(vectors[:, felt[:most]].T)


def _searched(problem: AlphaProblem, mean: Array, limit: float, directions: Array) -> AlphaDecision:
    """Return the best ray; rays turn towards each other while that helps."""

    def judged(direction: Array, share: float = tolerances.ROUGH_RAY) -> tuple[float, Array]:
        decoy = _end_of_ray(problem, mean, direction / np.linalg.norm(direction), limit, share)
        return _read(problem, decoy).distance(mean), decoy

    def climbed(privacy: float, way: Array) -> tuple[float, Array]:
        for turn in _TURNS:
            for direction in (sign * each for each in directions for sign in (1.0, -1.0)):
                turned = way + turn * direction
                found = judged(turned)[0]
                if found > privacy * (1.0 + tolerances.ROUGH_RAY):
                    privacy, way = found, turned / np.linalg.norm(turned)
        return privacy, way

    tried = [(judged(way)[0], way) for way in np.vstack([directions, -directions])]
    starts = sorted(tried, key=lambda item: -item[0])[:_STARTS]
    way = max((climbed(*start) for start in starts), key=lambda item: item[0])[1]
    privacy, decoy = max(judged(way, tolerances.CURVATURE), (0.0, mean), key=lambda item: item[0])
    weights = problem.optimum(decoy)
    return AlphaDecision(weights, decoy, privacy, float(problem.regret(mean, weights)), DecisionStatus.LOCAL_OPTIMUM)


def _read(problem: AlphaProblem, decoy: Array) -> ImpliedViews:
    return implied_views(problem, problem.optimum(decoy))


def _end_of_ray(problem: AlphaProblem, mean: Array, way: Array, limit: float, share: float) -> Array:
    """Return the farthest decoy m + t d whose decision is affordable; a distant one where all are affordable."""
    root = float(np.sqrt(limit))
    if root == 0.0:
        return mean

    def beyond(length: float) -> float:
        return float(np.sqrt(problem.regret(mean, problem.optimum(mean + length * way)))) - root

    # Without inequalities this length spends the budget; with them at most the budget.
    length = root / float(np.sqrt(way @ problem.theta_times(way)))
    for _ in range(_MOST_DOUBLINGS):
        if beyond(2.0 * length) > 0:
            return np.asarray(mean + _last_below(beyond, length, 2.0 * length, share) * way)
        length *= 2.0
    return np.asarray(mean + length * way)


def _last_below(function: Callable[[float], float], low: float, high: float, share: float) -> float:
    """Return the zero of an increasing function, approached from below."""
    if function(low) >= 0:
        return low
    found = float(brentq(function, low, high, xtol=share * low, rtol=max(share, 4.0 * np.finfo(float).eps)))
    while function(found) > 0:
        found -= 0.5 * share * low
    return max(found, low)
