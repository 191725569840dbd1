"""How nearly a decision can be explained: the least regret over all beliefs, by cutting planes on the value function.

V(π) = min_u π·s(u) lies below π·s(v) for every decision v, so each solved belief gives a valid plane:
ρ(π,u) ≥ π·(s(u) − s(v)), with equality where v = u*(π).
"""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.errors import SolverError
from inscrutable.geometry.hulls import onto_simplex
from inscrutable.linear_programmes import Rows, minimum
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

MOST_PLANES = 500


def gap_compared(problem: DecisionProblem, action: Array, margin: float) -> float:
    """Return the plausibility gap, or any bound of it on the same side of `margin` as soon as the side is known."""
    return nearest_explanation(problem, action, margin)[1]


def nearest_explanation(problem: DecisionProblem, action: Array, margin: float = np.inf) -> tuple[Array, float]:
    """Return the belief (X,) that leaves the decision the least regret, and that regret.

    With a finite `margin` the search ends when the regret is known to lie above or below it, with a bound in its place.
    """
    own = problem.state_costs(action)
    n_states = problem.n_states
    points = np.vstack([np.full(n_states, 1.0 / n_states), np.eye(n_states)]) if n_states > 1 else np.ones((1, 1))
    planes = own - problem.state_costs(problem.solve(points))
    regrets = (points * planes).sum(axis=1)
    best, upper = points[int(regrets.argmin())], float(max(regrets.min(), 0.0))
    scale = max(float(np.abs(planes).max()), np.finfo(float).tiny)
    for _ in range(MOST_PLANES):
        lower, trial = lowest_of_planes(planes / scale)
        if upper - lower * scale <= tolerances.GAP_STEP * scale:
            break
        if np.isfinite(margin) and (lower * scale >= margin or upper < margin):
            return best, max(lower * scale, 0.0) if lower * scale >= margin else upper
        # Half-way to the best belief so far: Kelley's corners alone zigzag.
        for point in (trial, 0.5 * (trial + best)):
            plane = own - problem.state_costs(problem.solve(point))
            planes = np.vstack([planes, plane])
            regret = float(point @ plane)
            if regret < upper:
                best, upper = point, max(regret, 0.0)
    else:
        raise SolverError(f"the plausibility gap did not close: between {lower * scale:.3g} and {upper:.3g}")
    return best, upper


def lowest_of_planes(planes: Array) -> tuple[float, Array]:
    """Return min_π max_j π·a_j over the simplex for planes (n,X), and a belief where it is reached."""
    n_states = planes.shape[1]
    answer = minimum(
        np.concatenate([np.zeros(n_states), [1.0]]),
        Rows(np.column_stack([planes, -np.ones(planes.shape[0])]), np.zeros(planes.shape[0])),
        Rows(np.concatenate([np.ones(n_states), [0.0]])[None], np.ones(1)),
        (0, None),
    )
    return answer.value, onto_simplex(answer.x[None, :n_states])[0]
