"""The counter-adversarial decision for private means: its implied views are farthest from the true mean, within a budget."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import LinearOperator, eigsh

from inscrutable import tolerances, validation
from inscrutable.alphas.mean_rays import MeanRays, inverse_of
from inscrutable.alphas.problem import AlphaProblem, checked_alpha_problem
from inscrutable.alphas.views import implied_views
from inscrutable.budgets import Budget, as_budget
from inscrutable.decision_makers.statuses import DecisionStatus
from inscrutable.errors import InputError, ModelError
from inscrutable.saved import Saved
from inscrutable.validation import Array

_LARGE = 400  # signals from which on eigenvectors are computed one by one


@dataclass(frozen=True, eq=False)
class AlphaDecision(Saved):
    """The optimal decision under a decoy, a mean other than the true one.

    Args:
        weights: u, shape (n,): the optimal decision under the decoy.
        decoy: m̂, shape (k,): the view nearest to the true mean among those that explain u.
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
    riskiest direction. There privacy is concave in r, so randomisation gains nothing.

    Args:
        problem: The decision problem.
        mean: m, shape (k,), the true private mean.
        budget: A share of |c*|, or `Budget.regret(r)`.
        n_directions: With inequalities: the number of eigenvectors, of either sign, at which the search starts. From each it
            follows a ray from m until the budget is spent, then the ray of the largest slope there, and so on. It does so in C,
            and in the part of C whose rows keep the slack `min_slack`, as many as the budget allows.

    Raises:
        InputError: Malformed arguments.
        ModelError: No signal changes any decision, so decisions reveal nothing.

    Returns:
        `AlphaDecision`; a closed form has two signs, and the one with the smaller positions is returned.

    Cost: one eigenvector; with inequalities some thousand decisions, .2 s for four assets. Source: the paper, Section III-C,
        measure (e), for Gaussian beliefs.

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
        axes, sizes, _ = np.linalg.svd(problem.equalities[0].T, full_matrices=False)
        rows = axes[:, sizes > tolerances.CURVATURE * sizes.max(initial=0.0)]  # equalities may depend on each other

        def inside(values: Array) -> Array:
            return np.asarray(values - rows @ (rows.T @ values))

        n = problem.n_assets
        risk: Any = LinearOperator((n, n), matvec=lambda values: inside(problem.risk.times(inside(values.ravel()))))
        # The greatest eigenvalues of V on the null space of the equalities.
        vectors = eigsh(
            risk, k=most, which="LA", v0=inside(np.sqrt(problem.risk.diagonal)), tol=tolerances.STATIONARITY
        )[1]
        return np.asarray(vectors.T[::-1])
    inverse, rank = inverse_of(problem.theta)
    if not rank:
        raise ModelError("no signal moves any decision: decisions reveal nothing, and there is nothing to hide")
    return np.asarray(np.linalg.eigh(inverse)[1].T[::-1][: min(rank, most)])


def _searched(problem: AlphaProblem, mean: Array, limit: float, directions: Array) -> AlphaDecision:
    """Return the best end of a ray, in the feasible set and in the one whose rows keep a slack."""
    rays = MeanRays(problem, mean, limit)
    ways = np.vstack([directions, -directions])
    ends = [rays.climbed(layout, way) for layout in (rays.layout, rays.loosened()) for way in ways]
    weights = max(ends, key=lambda end: end[0])[1]
    decoy = implied_views(problem, weights).nearest(mean)
    privacy, regret = float(np.linalg.norm(decoy - mean)), float(problem.regret(mean, weights))
    return AlphaDecision(weights, decoy, privacy, regret, DecisionStatus.LOCAL_OPTIMUM)
