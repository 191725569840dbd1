"""Other people's ways to hide one belief: the paper's grid with a modelling language, and a multistart of SLSQP.

Both work on the market itself and share nothing with the library; their answers are judged by it afterwards.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog, minimize

from oracles.markets import Market, costs, gradients, random_belief

Array = NDArray[np.float64]

HELD = 1e-9  # of a grid's multiples of 1/r, anything above is held
TIGHT = 1e-10  # complementarity that SLSQP is asked for, in units of the largest slope


class Answer(NamedTuple):
    """The privacy reached, NaN where nothing was found, and the seconds it took."""

    privacy: float
    seconds: float


class GridMethod:
    """The paper's way: dist(π, Π(ū)) by a convex programme for every action of a grid, then the best or an LP.

    The programme is canonicalised once, with π, the gradients and the held assets as parameters.
    """

    def __init__(self, market: Market, actions: Array) -> None:
        import cvxpy

        cp: Any = cvxpy
        self._solver, self._failure = cp.CLARABEL, cp.error.SolverError
        self.market, self.actions = market, actions
        self.state_costs = np.array([costs(market, action) for action in actions])
        slopes = [gradients(market, action) for action in actions]
        self.slopes = [each / np.abs(each).max() for each in slopes]
        n_assets, n_states = self.slopes[0].shape
        self._belief = cp.Parameter(n_states)
        self._slope = cp.Parameter((n_assets, n_states))
        self._free = cp.Parameter(n_assets, nonneg=True)
        decoy, level = cp.Variable(n_states, nonneg=True), cp.Variable()
        multipliers = cp.Variable(n_assets, nonneg=True)
        rows = [cp.sum(decoy) == 1, self._slope @ decoy == level + cp.multiply(self._free, multipliers)]
        self._programme = cp.Problem(cp.Minimize(cp.sum_squares(decoy - self._belief)), rows)

    def distance(self, belief: Array, index: int) -> float:
        """dist(π, Π(ū)), or −inf where the solver finds no belief that explains ū."""
        self._belief.value, self._slope.value = belief, self.slopes[index]
        self._free.value = (self.actions[index] <= HELD).astype(float)
        try:
            self._programme.solve(solver=self._solver)
        except self._failure:
            return -np.inf
        solved = self._programme.status in ("optimal", "optimal_inaccurate")
        return float(np.sqrt(max(self._programme.value, 0.0))) if solved else -np.inf

    def best(self, belief: Array, allowed: float) -> Answer:
        """The CDM: the most private action of the grid whose cost is at most `allowed`; only those are inverted."""
        started = time.perf_counter()
        affordable = np.flatnonzero(self.state_costs @ belief <= allowed)
        found = max((self.distance(belief, int(i)) for i in affordable), default=-np.inf)
        return Answer(_known(found), time.perf_counter() - started)

    def mixture(self, belief: Array, allowed: float) -> Answer:
        """The PDM: all actions are inverted, then HiGHS solves the paper's linear programme (12)."""
        started = time.perf_counter()
        privacies = np.array([self.distance(belief, i) for i in range(len(self.actions))])
        explained = np.isfinite(privacies)
        if not explained.any():
            return Answer(float("nan"), time.perf_counter() - started)
        expected = self.state_costs[explained] @ belief
        total = np.ones((1, int(explained.sum())))
        lottery: Any = linprog(-privacies[explained], expected[None], [allowed], total, [1.0])
        found = -float(lottery.fun) if lottery.success else -np.inf
        return Answer(_known(found), time.perf_counter() - started)


def slsqp_multistart(
    market: Market, belief: Array, allowed: float, *, n_starts: int, rng: np.random.Generator
) -> tuple[Array, float]:
    """Decoys (n,X) found by SLSQP from random starts, and the seconds.

    max ‖y − π‖² over actions u, decoys y and levels ν: slopes G(u)y − ν ≥ 0, complementary to u ≥ 0, cost ≤ `allowed`.
    """
    n_states, n_assets = market.means.shape
    scale = float(np.abs(gradients(market, np.full(n_assets, 1 / n_assets))).max())

    def slopes(point: Array) -> Array:
        action, decoy, level = point[:n_assets], point[n_assets:-1], point[-1]
        return np.asarray(gradients(market, action) @ decoy / scale - level)

    conditions: Any = [
        {"type": "eq", "fun": lambda point: [point[:n_assets].sum() - 1, point[n_assets:-1].sum() - 1]},
        {"type": "ineq", "fun": slopes},
        {"type": "ineq", "fun": lambda point: TIGHT - slopes(point) @ point[:n_assets]},
        {"type": "ineq", "fun": lambda point: (allowed - belief @ costs(market, point[:n_assets])) / scale},
    ]
    bounds: Any = [(0.0, 1.0)] * (n_assets + n_states) + [(None, None)]
    options: Any = {"maxiter": 300}
    started = time.perf_counter()
    found = []
    for _ in range(n_starts):
        action, decoy = rng.dirichlet(np.ones(n_assets)), random_belief(rng, n_states)
        start = np.concatenate([action, decoy, [0.0]])
        start[-1] = slopes(start).min()
        end = minimize(  # type: ignore[call-overload]
            lambda point: -float(((point[n_assets:-1] - belief) ** 2).sum()),
            start,
            method="SLSQP",
            bounds=bounds,
            constraints=conditions,
            options=options,
        )
        decoy = np.maximum(end.x[n_assets:-1], 0.0)
        if np.isfinite(decoy).all() and decoy.sum() > 0:
            found.append(decoy / decoy.sum())
    return np.array(found).reshape(-1, n_states), time.perf_counter() - started


def _known(value: float) -> float:
    return value if np.isfinite(value) else float("nan")
