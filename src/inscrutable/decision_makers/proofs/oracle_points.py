"""Known values and slopes of the optimal cost V at beliefs, each computed once."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

N_LEVELS = 16
"""Levels l of the shares of a ray. With five, 26 of 60 proofs for problems known by their solves take up to 55 times the calls;
with 48, none differs."""
_TRIED = (0, -1, 1)
"""Levels tried, relative to that of a cell. With the first alone, 8 of these 60 end up to 6.7 % higher, and 22 take up to 7 %
more calls; with two more, none ends lower."""
LEVELS_TRIED = len(_TRIED)


class OraclePoints:
    """Beliefs with optimal cost and the state costs of an optimal decision; at shares τ = 1 − 2^−l of the ray to each from the
    true belief, the optimal cost alone.

    Costs are those above the costs of one decision v, the optimal one for the belief in the middle: a constant added to all
    costs in a state changes none of them.
    """

    def __init__(self, problem: DecisionProblem, belief: Array, others: Array) -> None:
        self.problem = problem
        self.belief = belief
        self.calls = 0
        n_states = belief.size
        self.beliefs = np.zeros((0, n_states))
        self.values = np.zeros(0)
        self.costs = np.zeros((0, n_states))
        self.actions = np.zeros((0, problem.n_actions))
        self.on_the_way = np.zeros((0, N_LEVELS))
        self._between: dict[tuple[int, int], int] = {}
        self._shortfall = 0.0
        self.scale = 0.0
        """Largest expected size of a cost seen: costs in states that a belief rules out do not count."""
        self.rounding = 0.0
        """Largest rounding of an expected cost seen, relative to the cost before that of v is subtracted."""
        self._common = problem.state_costs(problem.solve_points(np.full(n_states, 1.0 / n_states)))
        self.add(np.vstack([belief, others]))
        self.optimal_cost = float(self.values[0])
        self.on_the_way[0] = self.optimal_cost

    @property
    def allowance(self) -> float:
        """The largest error of a computed optimal cost, which is above the true one."""
        return max(self.problem.cost_accuracy * self.scale, 10.0 * self._shortfall) + self.rounding

    def ask(self, beliefs: Array) -> tuple[Array, Array]:
        """Return optimal costs (T,) and state costs (T,X) of beliefs (T,X): T calls of the oracle."""
        values, costs, _ = self._solved(beliefs)
        return values, costs

    def _solved(self, beliefs: Array) -> tuple[Array, Array, Array]:
        self.calls += len(beliefs)
        actions = self.problem.solve_points(beliefs)
        costs = np.atleast_2d(self.problem.state_costs(actions))
        size = (np.abs(costs) * beliefs).sum(axis=1).max(initial=0.0)
        self.rounding = max(self.rounding, tolerances.COST_ROUNDING * float(size))
        costs = costs - self._common
        return (beliefs * costs).sum(axis=1), costs, actions

    def add(self, beliefs: Array) -> np.ndarray:
        """Return the indices of new points."""
        values, costs, actions = self._solved(beliefs)
        first = len(self.values)
        self.scale = max(self.scale, float((np.abs(costs) * beliefs).sum(axis=1).max(initial=0.0)))
        self.beliefs = np.concatenate([self.beliefs, beliefs])
        self.values = np.concatenate([self.values, values])
        self.costs = np.concatenate([self.costs, costs])
        self.actions = np.concatenate([self.actions, actions])
        self.on_the_way = np.concatenate([self.on_the_way, np.full((len(beliefs), N_LEVELS), np.nan)])
        return np.arange(first, len(self.values))

    def between(self, pairs: np.ndarray, shares: Array) -> np.ndarray:
        """Return the indices of points at shares (P,) of the way between pairs (P,2) of points; at another one where the
        pair was asked for before."""
        keys = [(min(a, b), max(a, b)) for a, b in pairs.tolist()]
        fresh = {key: place for place, key in enumerate(keys) if key not in self._between}
        if fresh:
            places = np.array(list(fresh.values()))
            first, second = self.beliefs[pairs[places].T]
            new = self.add(first + shares[places, None] * (second - first))
            self._between.update(zip(fresh, new.tolist(), strict=True))
        return np.array([self._between[key] for key in keys], dtype=np.intp)

    def look_on_the_way(self, corners: np.ndarray, levels: np.ndarray) -> None:
        """Compute V at the level (C,) of each cell's corners (C,X)."""
        points = np.repeat(corners, 1, axis=1).ravel()
        asked = np.column_stack([points, np.repeat(levels, corners.shape[1])])
        asked = np.unique(asked[np.isnan(self.on_the_way[asked[:, 0], asked[:, 1]])], axis=0)
        if len(asked):
            shares = 1.0 - 0.5 ** asked[:, 1]
            beliefs = self.belief + shares[:, None] * (self.beliefs[asked[:, 0]] - self.belief)
            self.on_the_way[asked[:, 0], asked[:, 1]] = self.ask(beliefs)[0]

    def upper_costs(self, corners: np.ndarray) -> Array:
        """Return the cost (C,X,X) at each corner of each corner's decision: no belief's optimal cost is above."""
        costs = np.einsum("cjx,ckx->cjk", self.beliefs[corners], self.costs[corners])
        excess = float((self.values[corners][:, :, None] - costs).max(initial=0.0))
        # A cheaper decision from another belief shows the solver's error.
        self._shortfall = max(self._shortfall, excess)
        return np.asarray(costs)

    def regret_bounds(self, corners: np.ndarray, levels: np.ndarray, upper: Array) -> Array:
        """Return columns (C,X,K) of lower bounds of the regret of every optimal decision, linear on each cell.

        Formula: for w = π + τ(y − π), ρ(π,u) ≥ (V(w) − τ V(y))/(1 − τ) − V(π), with the interpolation of V(w_j) below V(w)
        and each corner's decision above V(y).
        """
        columns = []
        for step in _TRIED:
            level = np.clip(levels + step, 1, N_LEVELS - 1)
            share = (1.0 - 0.5**level)[:, None, None]
            lower = self.on_the_way[corners, level[:, None]][:, :, None] - self.allowance
            columns.append((lower - share * upper) / (1.0 - share) - self.optimal_cost)
        found = np.concatenate(columns, axis=2)
        # Where a value on a ray is missing for some corner: the regret is at least 0.
        found[np.isnan(found).any(axis=1, keepdims=True).repeat(found.shape[1], axis=1)] = 0.0
        return found
