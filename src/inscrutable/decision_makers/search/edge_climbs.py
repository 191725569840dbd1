"""Projected gradient ascent of decoys along the boundary of the budget, across critical regions.

The affordable decoys are star-shaped around the true belief, and on every ray √ρ is nearly linear, so each candidate tells how
far the budget reaches in its direction. The ascent starts from the farthest of these ends, in different directions, and moves
all decoys at once: along the gradient of the distance, projected on the directions that leave the regret and the
probabilities at zero unchanged; then back to the budget along the regret's gradient. Each step solves for the decisions
anew, so the active set may change on the way.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.search.rays import ray_ends
from inscrutable.kernels.climb import Aim
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array

_SEEDS, _FEW_SEEDS = 32, 8
_APART = 0.85  # cosine of the angle between two seeds
_ROUNDS, _RETURNS = 16, 3
_FIRST_STEP, _LONGER, _SHORTER, _SHORTEST = 0.3, 1.8, 0.3, 0.003  # shares of the distance from the true belief
_NEAR_EDGE, _BEYOND_EDGE = 0.97, 1.1  # shares of the budget: from here it binds, and up to here √ρ leads back
_TINY = float(np.finfo(float).tiny)


def edge_decoys(problem: QuadraticProblem, aim: Aim, decoys: Array, state_costs: Array) -> Array:
    """Return decoys (n,X) at the edge of the budget, the best for the aim first.

    The climbs start from `decoys` (D,X), whose decisions have the given state costs (D,X), and from rays in all directions.
    """
    edge = _Edge(problem, aim)
    ends = ray_ends(aim.belief)
    found = np.vstack([decoys, ends])
    regrets = np.concatenate([state_costs @ aim.belief - aim.optimal_cost, edge.regrets(ends)])
    seeds = _apart(aim, edge.affordable(found, regrets), _SEEDS if problem.solves_in_bulk else _FEW_SEEDS)
    return edge.climb(seeds)


def _apart(aim: Aim, ends: Array, count: int) -> Array:
    """The best ends for the aim, no two of them in nearly one direction."""
    away = ends - aim.belief
    length = np.linalg.norm(away, axis=1)
    unit = away / np.maximum(length, _TINY)[:, None]
    open_ = length > tolerances.SAME_BELIEF
    order = np.argsort(-aim.sign * np.linalg.norm(ends - aim.point, axis=1), kind="stable")
    chosen: list[int] = []
    for i in order:
        if open_[i]:
            chosen.append(int(i))
            open_ &= unit @ unit[i] < _APART
            if len(chosen) == count:
                break
    return ends[chosen]


@dataclass(frozen=True)
class _State:
    """The current decoys, their regrets and values."""

    decoys: Array
    regrets: Array
    values: Array


class _Edge:
    def __init__(self, problem: QuadraticProblem, aim: Aim) -> None:
        self.problem, self.aim = problem, aim
        belief = aim.belief
        self.hessian = np.tensordot(0.5 * belief, problem.hessians, axes=1)
        self.linear = belief @ problem.linear
        self.floor = aim.optimal_cost - float(belief @ problem.constants)

    def regrets(self, decoys: Array) -> Array:
        actions = self.problem.solve_rows(decoys)
        # Most coordinates are zero throughout where few assets are held.
        used = np.flatnonzero(actions.any(axis=0))
        held = actions[:, used]
        costs = ((held @ self.hessian[np.ix_(used, used)] + self.linear[used]) * held).sum(axis=1)
        return np.asarray(np.maximum(costs - self.floor, 0.0))

    def affordable(self, decoys: Array, regrets: Array) -> Array:
        """Move each decoy along its ray to where √ρ, taken as linear, meets the budget."""
        share = np.minimum(np.sqrt(self.aim.limit / np.maximum(regrets, _TINY)), 1.0)
        return np.asarray(self.aim.belief + share[:, None] * (decoys - self.aim.belief))

    def at(self, decoys: Array) -> _State:
        regrets = self.regrets(decoys)
        away = np.linalg.norm(self.affordable(decoys, regrets) - self.aim.point, axis=1)
        return _State(decoys, regrets, self.aim.sign * away)

    def climb(self, seeds: Array) -> Array:
        """Return where the climbs from the seeds end, inside the budget to rounding of √ρ, the best first."""
        now = self.at(seeds)
        for _ in range(_RETURNS):
            now = self.at(_beliefs(self.affordable(now.decoys, now.regrets)))
        moved = np.arange(len(seeds))
        steps = np.full(len(seeds), _FIRST_STEP)
        ways, slopes = np.zeros_like(seeds), np.zeros_like(seeds)
        for _ in range(_ROUNDS):
            ways[moved], slopes[moved] = self._ways(now.decoys[moved], now.regrets[moved])
            going = np.flatnonzero((steps > _SHORTEST) & (np.linalg.norm(ways, axis=1) > _SHORTEST))
            if not len(going):
                break
            trial = self._stepped(now.decoys[going], ways[going], slopes[going], steps[going])
            gain = tolerances.EDGE_GAIN * np.abs(now.values[going])
            better = (trial.values > now.values[going] + gain) & (trial.regrets <= _BEYOND_EDGE * self.aim.limit)
            moved = going[better]
            for held, tried in ((now.decoys, trial.decoys), (now.regrets, trial.regrets), (now.values, trial.values)):
                held[moved] = tried[better]
            steps[moved] *= _LONGER
            steps[going[~better]] *= _SHORTER
        order = np.argsort(-now.values, kind="stable")
        return self.affordable(now.decoys[order], now.regrets[order])

    def _ways(self, decoys: Array, regrets: Array) -> tuple[Array, Array]:
        """The projected gradients of the distance, and the regret's gradient along the faces of Δ on which the decoys lie."""
        away = self.aim.sign * (decoys - self.aim.point)
        away /= np.maximum(np.linalg.norm(away, axis=1), _TINY)[:, None]
        slope = self._slopes(decoys, regrets)
        binds = (regrets > _NEAR_EDGE * self.aim.limit)[:, None]
        free = np.ones(decoys.shape, dtype=bool)
        for _ in range(decoys.shape[1]):
            rise, way = _centred(slope, free), _centred(away, free)
            unit = rise / np.maximum(np.linalg.norm(rise, axis=1), _TINY)[:, None]
            way = way - binds * np.maximum((way * unit).sum(axis=1), 0.0)[:, None] * unit
            leaving = free & (decoys <= tolerances.ON_FACE) & (way < 0)
            if not leaving.any():
                break
            free &= ~leaving
        return way, rise

    def _slopes(self, decoys: Array, regrets: Array) -> Array:
        """∂ρ/∂y up to a constant, by differences toward the corners, which never leave Δ."""
        n_states, probe = decoys.shape[1], tolerances.EDGE_PROBE
        probed = (1.0 - probe) * decoys[:, None] + probe * np.eye(n_states)
        return np.asarray((self.regrets(probed.reshape(-1, n_states)).reshape(-1, n_states) - regrets[:, None]) / probe)

    def _stepped(self, decoys: Array, ways: Array, slopes: Array, steps: Array) -> _State:
        """A step as long as Δ allows, and back to the budget along the slope, by Newton's step on √ρ."""
        length = steps * np.linalg.norm(decoys - self.aim.belief, axis=1)
        falling = np.where(ways < 0, -ways, _TINY)
        room = np.where(ways < 0, decoys / falling, np.inf).min(axis=1)
        tried = _beliefs(decoys + np.minimum(length, room)[:, None] * ways)
        root = np.sqrt(self.regrets(tried))
        excess = 2.0 * root * np.maximum(root - np.sqrt(self.aim.limit), 0.0)
        steep = (slopes**2).sum(axis=1)
        # Where the regret has almost no slope, Newton's step would be infinitely long.
        rises = steep > (np.finfo(float).eps * self.aim.limit) ** 2 + _TINY / np.finfo(float).eps
        back = np.where(rises, excess / np.where(rises, steep, 1.0), 0.0)
        return self.at(_beliefs(tried - back[:, None] * slopes))


def _centred(vectors: Array, free: np.ndarray) -> Array:
    """Project on the vectors that sum to zero and vanish outside `free`."""
    held = np.where(free, vectors, 0.0)
    mean = held.sum(axis=1, keepdims=True) / np.maximum(free.sum(axis=1, keepdims=True), 1)
    return np.asarray(np.where(free, held - mean, 0.0))


def _beliefs(points: Array) -> Array:
    held = np.maximum(points, 0.0)
    return np.asarray(held / held.sum(axis=1, keepdims=True))
