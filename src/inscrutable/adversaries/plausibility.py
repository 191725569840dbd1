"""The plausibility gap (inverse-optimality gap): the least regret over all beliefs, by cutting planes on the value function.

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
    """Return the plausibility gap, or a bound as soon as it is known whether the gap is above or below `margin`."""
    return nearest_explanation(problem, action, margin)[1]


def nearest_explanation(problem: DecisionProblem, action: Array, margin: float = np.inf) -> tuple[Array, float]:
    """Return the belief (X,) that leaves the decision the least regret, and that regret.

    With a finite `margin` the search ends as soon as the regret is known to lie above or below it, and returns a bound.
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
    """Return the least regret over all beliefs with the planes that prove it; `margin` as in `nearest_explanation`."""
    return planes_below(problem, problem.state_costs(action), margin)


def planes_below(problem: DecisionProblem, own: Array, margin: float = np.inf) -> ClosedPlanes:
    """Return min_π max(π·s − V(π), 0) for any state costs s (X,), with the planes that prove it, as `closed_planes`.

    Where the minimum may be zero because π·s < V(π), only a finite `margin` ends the search.
    """
    search = _Search(problem, own, margin)
    while not search.is_closed:
        search.take(problem.state_costs(problem.solve(search.waiting)))
    return search.found()


def nearest_explanations(problem: DecisionProblem, actions: Array) -> tuple[Array, Array]:
    """Return `nearest_explanation` of many decisions (M,U), solved together: beliefs (M,X) and regrets (M,)."""
    searches = [_Search(problem, own, np.inf) for own in np.atleast_2d(problem.state_costs(actions))]
    still = searches
    while still:
        costs = problem.state_costs(problem.solve(np.vstack([each.waiting for each in still])))
        ends = np.cumsum([len(each.waiting) for each in still])
        for each, own_costs in zip(still, np.split(costs, ends[:-1]), strict=True):
            each.take(own_costs)
        still = [each for each in still if not each.is_closed]
    found = [each.found() for each in searches]
    beliefs = np.array([each.belief for each in found]).reshape(-1, problem.n_states)
    return beliefs, np.array([each.gap for each in found], dtype=np.float64)


class _Search:
    """Cutting planes for one decision: a queue of beliefs to solve for; the costs of their optima give the planes."""

    def __init__(self, problem: DecisionProblem, own: Array, margin: float) -> None:
        self._own, self._margin, self._ruin = own, margin, problem.ruin_cost
        n_states = problem.n_states
        middle = np.full((1, n_states), 1.0 / n_states)
        self.waiting = np.vstack([middle, np.eye(n_states)]) if n_states > 1 else np.ones((1, 1))
        self.is_closed = False
        self._planes, self._points = np.empty((0, n_states)), np.empty((0, n_states))
        self._best, self._upper, self._bound = self.waiting[0], np.inf, np.inf
        self._game: PlaneGame | None = None
        self._rounds = 0

    def take(self, costs: Array) -> None:
        """Add the planes of the queued beliefs, given the state costs (n,X) of their optimal decisions."""
        planes = self._own - costs
        regrets = (self.waiting * planes).sum(axis=1)
        for point, regret in zip(self.waiting, regrets, strict=True):
            if regret < self._upper:
                self._best, self._upper = point, max(float(regret), 0.0)
        self._planes, self._points = np.vstack([self._planes, planes]), np.vstack([self._points, self.waiting])
        if self._game is None:
            sizes = np.abs(planes)[np.maximum(self._own, costs) < self._ruin]
            self._scale = max(float(sizes.max(initial=0.0)), np.finfo(float).tiny)
            self._game = PlaneGame(planes / self._scale)
        else:
            self._game.add(planes / self._scale)
        self._judge(self._game)

    def _judge(self, game: PlaneGame) -> None:
        """End the search, or queue the next beliefs."""
        lower, trial = game.lowest()
        if self._upper - lower * self._scale <= tolerances.GAP_STEP * self._scale:
            self.is_closed, self._bound = True, self._upper
            return
        above = lower * self._scale >= self._margin
        if np.isfinite(self._margin) and (above or self._upper < self._margin):
            self.is_closed, self._bound = True, max(lower * self._scale, 0.0) if above else self._upper
            return
        self._rounds += 1
        if self._rounds > MOST_PLANES:
            raise SolverError(
                f"the plausibility gap did not converge: between {lower * self._scale:.3g} and {self._upper:.3g}"
            )
        # Add the midpoint to the best belief so far: Kelley's minimisers alone zigzag.
        self.waiting = np.vstack([trial, 0.5 * (trial + self._best)])

    def found(self) -> ClosedPlanes:
        """Return the result of the finished search."""
        return ClosedPlanes(self._best, self._bound, self._planes, self._points)


def weights_of_planes(planes: Array) -> Array:
    """Return shares (n,) of planes (n,X) for which min_i Σ_j w_j a_j,i is min_π max_j π·a_j: the proof of that value."""
    return np.asarray(onto_simplex(-lowest_by_highs(planes).duals[None])[0])
