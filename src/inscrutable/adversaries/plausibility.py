"""How nearly a decision can be explained: the least regret over all beliefs, by cutting planes on the value function.

V(π) = min_u π·s(u) lies below π·s(v) for every decision v, so each solved belief gives a valid plane:
ρ(π,u) ≥ π·(s(u) − s(v)), with equality where v = u*(π).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.plane_game import PlaneGame, lowest_by_highs
from inscrutable.errors import SolverError
from inscrutable.geometry.hulls import onto_simplex
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
    found = closed_planes(problem, action, margin)
    return found.belief, found.gap


class ClosedPlanes(NamedTuple):
    """The belief of least regret, that regret, and the planes π·(s(u) − s(v_j)) that prove it."""

    belief: Array  # (X,)
    gap: float
    planes: Array  # (n, X)
    beliefs: Array  # (n, X), v_j = u*(beliefs[j])


def closed_planes(problem: DecisionProblem, action: Array, margin: float = np.inf) -> ClosedPlanes:
    """Return the least regret over all beliefs with the planes that prove it, or a bound on its side of `margin`."""
    return planes_below(problem, problem.state_costs(action), margin)


def planes_below(problem: DecisionProblem, own: Array, margin: float = np.inf) -> ClosedPlanes:
    """Return min_π max(π·s − V(π), 0) for any state costs s (X,), with the planes that prove it, as `closed_planes`.

    Where it may be zero because π·s < V(π), only a finite `margin` ends the search.
    """
    n_states = problem.n_states
    points = np.vstack([np.full(n_states, 1.0 / n_states), np.eye(n_states)]) if n_states > 1 else np.ones((1, 1))
    planes = own - problem.state_costs(problem.solve(points))
    regrets = (points * planes).sum(axis=1)
    best, upper = points[int(regrets.argmin())], float(max(regrets.min(), 0.0))
    scale = max(float(np.abs(planes).max()), np.finfo(float).tiny)
    game = PlaneGame(planes / scale)
    for _ in range(MOST_PLANES):
        lower, trial = game.lowest()
        if upper - lower * scale <= tolerances.GAP_STEP * scale:
            break
        if np.isfinite(margin) and (lower * scale >= margin or upper < margin):
            bound = max(lower * scale, 0.0) if lower * scale >= margin else upper
            return ClosedPlanes(best, bound, planes, points)
        # Half-way to the best belief so far: Kelley's corners alone zigzag.
        for point in (trial, 0.5 * (trial + best)):
            plane = own - problem.state_costs(problem.solve(point))
            game.add(plane / scale)
            planes, points = np.vstack([planes, plane]), np.vstack([points, point])
            regret = float(point @ plane)
            if regret < upper:
                best, upper = point, max(regret, 0.0)
    else:
        raise SolverError(f"the plausibility gap did not close: between {lower * scale:.3g} and {upper:.3g}")
    return ClosedPlanes(best, upper, planes, points)


def lowest_of_planes(planes: Array) -> tuple[float, Array]:
    """Return min_π max_j π·a_j over the simplex for planes (n,X), and a belief where it is reached."""
    return PlaneGame(planes).lowest()


def weights_of_planes(planes: Array) -> Array:
    """Return shares (n,) of planes (n,X) for which min_i Σ_j w_j a_j,i is min_π max_j π·a_j: the proof of that value."""
    return np.asarray(onto_simplex(-lowest_by_highs(planes).duals[None])[0])
