"""The counter-adversarial decision for maximal obfuscation on large Markowitz markets, by multistart until time is up.

Maximise dist(π, Π(u)) over u in the simplex with u_j = 0 or u_j >= min_slack, ρ(π,u) <= limit and Π(u) not empty.
Every plausible u is optimal for a decoy z, and what is affordable is star-shaped around π, so each start is a ray:

1. `_climb` moves the end of an affordable ray along the boundary of the budget, faces ignored, by the gradient of the
   regret projected on the cone of directions that stay affordable and inside the simplex of beliefs;
2. `_settle` maximises on the face reached (the set of held assets) with every constraint written out, then on every
   neighbouring face: assets with the least weight go out, assets with no multiplier left come in;
3. later starts mix fresh rays, decoys judged by their sets and walked uphill at random, and the best decoys so far,
   perturbed by a random radius or with assets switched.

On a face of fewer assets than states Π(u) is larger than a point, and the weights are searched with the projection of
π as the objective. No proof of optimality; the value is exact for the action, as `judged` says from the action alone.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from typing import Any, NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from oracles import consistent, markets
from oracles.markets import Market

Array = NDArray[np.float64]
Held = NDArray[np.bool_]

MIN_SLACK = 1e-4  # smallest weight of a held asset
WEIGHT_MARGIN = 1e-5  # share of MIN_SLACK by which a searched weight stays above it
SLOPE_MARGIN = 1e-8  # searched multipliers stay above it, gradients scaled to a largest entry of one
LIMIT_MARGIN = 1e-7  # share of the limit left unspent
ROUNDING = 1e-12  # weights, scaled slopes and beliefs this far below zero are rounding
RANK = 1e-7  # singular values below this share of the largest leave a direction of the belief free
TIGHT = 1e-6  # scaled slack at the end of a face's search below which a constraint counts as tight
SUM = 1e-9  # how far the sum of the weights may be from one
AT_BELIEF = 1e-8  # a nearest belief this close to π is π
LIKE = 0.03  # two decoys closer than this on one face lead to one local optimum
ELITE = 12  # best local optima kept for perturbation
NEAR = 0.85  # a climb that ends below this share of the best privacy is not settled
SCOUTS = 60  # random decoys of one scouting
WALK = 80  # random steps uphill from the best of them
ON_FLAT = 1e-8  # scaled rows this close to zero at a projection carry it
FLATS = 4  # times the tight rows are read anew there
FEW = 5  # up to so many tight constraints are switched in all combinations


class Best(NamedTuple):
    """The action, its privacy, the nearest belief of its set, and (seconds, privacy) at each improvement."""

    action: Array
    privacy: float
    nearest: Array
    history: list[tuple[float, float]]


class Verdict(NamedTuple):
    """What an action amounts to: −inf and NaN for the first two where no belief explains it."""

    privacy: float
    nearest: Array
    regret: float
    admissible: bool


# --- the problem ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Game:
    means: Array
    hessians: Array  # 2γΣ, (X,U,U)
    belief: Array
    allowed: float
    limit: float

    def gradients(self, action: Array) -> Array:
        """Return G(u), (X,U)."""
        return np.asarray(self.hessians @ action - self.means)

    def cost(self, action: Array) -> float:
        return float(self.belief @ (0.5 * (self.hessians @ action) @ action - self.means @ action))


def _opened(market: Market, belief: Array, limit: float) -> tuple[_Game, _Point]:
    """Return the game of a market and u*(π)."""
    game = _Game(market.means, 2 * market.risk_aversion * market.covariances, belief, np.inf, limit)
    optimal = _optimal(game, belief)
    return replace(game, allowed=game.cost(optimal.action) + limit), optimal


class _Point(NamedTuple):
    """Where an asset set is stationary for a decoy: weights (U,), slopes above the common one (U,), derivatives."""

    decoy: Array
    held: Held
    action: Array
    slopes: Array
    weights_by: Array  # (U,X): du/dz
    slopes_by: Array  # (U,X)
    scale: float


def _stationary(game: _Game, decoy: Array, held: Held) -> _Point:
    """Solve H_SS u_S + ν1 = g_S, 1'u_S = 1 with H = Σ z_i H_i, and differentiate the solution by z."""
    index = np.flatnonzero(held)
    size, n_states = len(index), len(decoy)
    hessian = np.tensordot(decoy, game.hessians, 1)
    system = np.ones((size + 1, size + 1))
    system[:size, :size] = hessian[np.ix_(index, index)]
    system[size, size] = 0.0
    solution = np.linalg.solve(system, np.append((decoy @ game.means)[index], 1.0))
    action = np.zeros(len(held))
    action[index] = solution[:size]
    gradients = game.gradients(action)
    moved = np.linalg.solve(system, np.vstack([-gradients[:, index].T, np.zeros((1, n_states))]))
    weights_by = np.zeros((len(held), n_states))
    weights_by[index] = moved[:size]
    slopes = decoy @ gradients + solution[size]
    slopes[index] = 0.0
    slopes_by = gradients.T + hessian[:, index] @ moved[:size] + moved[size]
    slopes_by[index] = 0.0
    return _Point(decoy, held, action, slopes, weights_by, slopes_by, float(np.abs(gradients).max()))


def _optimal(game: _Game, decoy: Array, guess: Held | None = None) -> _Point:
    """Return u*(z), exact on its support: the guessed assets if they are the right ones, else by DAQP."""
    for _ in range(4):
        if guess is None or not guess.any():
            break
        point = _stationary(game, decoy, guess)
        wrong = (point.action < -ROUNDING) | (point.slopes < -ROUNDING * point.scale)
        if not wrong.any():
            return point
        guess = guess ^ wrong
    size = game.means.shape[1]
    hessian, linear = np.tensordot(decoy, game.hessians, 1), -(decoy @ game.means)
    scale = float(np.abs(hessian).max())
    upper, lower = np.append(np.full(size, 2.0), 1.0), np.append(np.zeros(size), 1.0)
    sense = np.append(np.zeros(size, dtype=np.int32), np.int32(5))
    tight: Any = {"primal_tol": 1e-12, "dual_tol": 1e-12}
    action, _, flag, _ = daqp.solve(hessian / scale, linear / scale, np.ones((1, size)), upper, lower, sense, **tight)
    if flag != 1:
        raise RuntimeError(f"DAQP: {flag}")
    return _stationary(game, decoy, np.asarray(action) > 1e-11)


def _over_budget(game: _Game, point: _Point) -> tuple[float, Array]:
    """Return (ρ − limit)/limit and its gradient by the decoy."""
    own = game.belief @ game.gradients(point.action)
    return (game.cost(point.action) - game.allowed) / game.limit, own @ point.weights_by / game.limit


# --- the set of a decision ------------------------------------------------------------------------------------------


def _rows(gradients: Array, held: Held) -> tuple[Array, Array]:
    """Return the equalities (independent rows) and the inequalities in z alone: slopes of held and of other assets."""
    scaled = gradients / (np.abs(gradients).max() or 1.0)
    first = int(np.flatnonzero(held)[0])
    slopes = (scaled - scaled[:, [first]]).T
    _, singular, right = np.linalg.svd(np.vstack([slopes[held], np.zeros((1, len(gradients)))]), full_matrices=False)
    return right[singular > RANK * max(1.0, singular[0])], slopes[~held]


def _project(gradients: Array, held: Held, belief: Array) -> Array | None:
    """Return the belief of Π(u) nearest to π by an active-set method in z alone; None where DAQP finds none."""
    equal, unequal = _rows(gradients, held)
    size = len(belief)
    matrix = np.vstack([np.ones((1, size)), equal, unequal])
    lower = np.concatenate([np.zeros(size), [1.0], np.zeros(len(equal) + len(unequal))])
    upper = np.concatenate([np.ones(size), [1.0], np.zeros(len(equal)), np.full(len(unequal), 1e30)])
    sense = np.zeros(len(lower), dtype=np.int32)
    sense[size : size + 1 + len(equal)] = 5
    nearest, _, flag, _ = daqp.solve(np.eye(size), -belief, matrix, upper, lower, sense, primal_tol=1e-9)
    return np.asarray(nearest) if flag == 1 else None


def _valued(game: _Game, point: _Point) -> tuple[float, _Point]:
    """Return dist(π, Π(u)), −inf unless admissible, affordable and stationary, and the point seen from the nearest."""
    action = point.action
    if action[point.held].min() < MIN_SLACK or game.cost(action) > game.allowed:
        return -np.inf, point
    if point.slopes.min() < -ROUNDING * point.scale or point.decoy.min() < 0:
        return -np.inf, point
    gradients, n_states = game.gradients(action), len(point.decoy)
    if point.held.sum() < n_states or len(_rows(gradients, point.held)[0]) < n_states - 1:
        nearest = _project(gradients, point.held, game.belief)
        if nearest is None:
            return -np.inf, point
        point = _stationary(game, _on_simplex(nearest), point.held)
    return float(np.linalg.norm(point.decoy - game.belief)), point


def optimal_cost_of(market: Market, belief: Array) -> float:
    """Return c* = min_u π·s(u)."""
    game, optimal = _opened(market, belief, 0.0)
    return game.cost(optimal.action)


def judged(market: Market, belief: Array, optimal_cost: float, action: Array) -> Verdict:
    """Judge an action from nothing but itself.

    A projection proposes the nearest belief; HiGHS, on the lifted system, then looks for the member of Π(u) farthest
    in the direction of π. The privacy is the distance to the half-space so found, which no member leaves.
    """
    held = action >= MIN_SLACK
    admissible = bool((held | (action == 0)).all()) and abs(action.sum() - 1) < SUM
    regret = float(belief @ markets.costs(market, action)) - optimal_cost
    gradients = markets.gradients(market, action)
    system = consistent.simplex_system(gradients, held)
    nearest = None if consistent.is_empty(system) else _project(gradients.T, held, belief)
    if nearest is None:
        return Verdict(-np.inf, np.full(len(belief), np.nan), regret, admissible)
    away = belief - nearest
    length = float(np.linalg.norm(away))
    if length < AT_BELIEF:
        return Verdict(0.0, nearest, regret, admissible)
    reached = float(away @ (belief - consistent.support(system, away))) / length
    return Verdict(reached, nearest, regret, admissible)


# --- along the boundary of the budget -------------------------------------------------------------------------------


def _on_simplex(decoy: Array) -> Array:
    clipped = np.maximum(decoy, 0.0)
    return np.asarray(clipped / clipped.sum())


def _ray_end(game: _Game, toward: Array, guess: Held | None, share: float = 1.0) -> _Point:
    """Return the farthest affordable point of the ray from π through `toward`, to 1e-4 of its length."""
    away = toward - game.belief
    most = float(np.min(-game.belief[away < 0] / away[away < 0], initial=np.inf))
    low, high, step = 0.0, most, min(share, most)
    found = None
    for _ in range(40):
        point = _optimal(game, _on_simplex(game.belief + step * away), guess)
        guess = point.held
        over, slope = _over_budget(game, point)
        low, high, found = (step, high, point) if over <= 0 else (low, step, found)
        if found is not None and (low >= most or high - low <= 1e-4 * high or -1e-3 < over <= 0):
            return found
        # The regret is about quadratic along the ray: a Newton step on its root, kept inside the bracket.
        root, along = np.sqrt(max(over + 1.0, 1e-16)), float(slope @ away)
        newton = step + (1.0 - 2e-4 - root) * 2 * root / along if along > 0 else high
        step = newton if low < newton < high else (0.5 * (low + high) if newton < high or high < most else most)
    return found if found is not None else _optimal(game, game.belief)


def _direction(game: _Game, point: _Point) -> Array:
    """Project the way from π on the directions that stay affordable and inside the simplex, to first order."""
    size = len(point.decoy)
    away = point.decoy - game.belief
    over, slope = _over_budget(game, point)
    lower = np.concatenate([np.where(point.decoy <= 1e-9, 0.0, -1e30), [0.0], [-1e30]])
    upper = np.concatenate([np.full(size, 1e30), [0.0], [0.0 if over > -1e-2 else 1e30]])
    sense = np.array([0] * size + [5, 0], dtype=np.int32)
    matrix = np.vstack([np.ones(size), slope / (np.linalg.norm(slope) or 1.0)])
    target = away / (np.linalg.norm(away) or 1.0)
    moved, _, flag, _ = daqp.solve(np.eye(size), -target, matrix, upper, lower, sense, primal_tol=1e-10)
    return np.asarray(moved) if flag == 1 else np.zeros(size)


def _climb(game: _Game, start: Array, guess: Held | None, deadline: float) -> _Point:
    """Move the end of the ray through `start` along the budget's boundary while that takes it farther from π."""
    point = _ray_end(game, start, guess)
    reach, step = float(np.linalg.norm(point.decoy - game.belief)), 0.1
    for _ in range(60):
        direction = _direction(game, point)
        if np.linalg.norm(direction) < 1e-4 or step < 1e-4 or time.process_time() > deadline:
            break
        trial = _ray_end(game, _on_simplex(point.decoy + step * direction), point.held)
        length = float(np.linalg.norm(trial.decoy - game.belief))
        longer = length > reach * (1 + 1e-6)
        point, reach, step = (trial, length, 2 * step) if longer else (point, reach, 0.3 * step)
    return point


# --- on one face ----------------------------------------------------------------------------------------------------


def _best_decoy(game: _Game, start: Array, held: Held) -> _Point:
    """Maximise ‖z − π‖ over the decoys whose decision holds exactly these assets, by SLSQP with exact derivatives."""
    at = lru_cache(1)(lambda coordinates: _stationary(game, np.frombuffer(coordinates), held))

    def slack(decoy: Array) -> Array:
        point = at(decoy.tobytes())
        rest = [-LIMIT_MARGIN - _over_budget(game, point)[0]]
        weights, slopes = point.action[held], point.slopes[~held] / point.scale
        return np.concatenate([weights - MIN_SLACK * (1 + WEIGHT_MARGIN), slopes - SLOPE_MARGIN, rest])

    def slack_by(decoy: Array) -> Array:
        point = at(decoy.tobytes())
        budget = -_over_budget(game, point)[1]
        return np.vstack([point.weights_by[held], point.slopes_by[~held] / point.scale, budget])

    def loss(decoy: Array) -> tuple[float, Array]:
        away = decoy - game.belief
        return -0.5 * float(away @ away), -away

    sum_to_one: Any = {"type": "eq", "fun": lambda z: z.sum() - 1, "jac": lambda z: np.ones((1, len(z)))}
    rows: Any = [sum_to_one, {"type": "ineq", "fun": slack, "jac": slack_by}]
    options: Any = {"ftol": 1e-11, "maxiter": 60}
    least: Any = [(0.0, 1.0)] * len(start)
    answer = minimize(loss, start, jac=True, bounds=least, constraints=rows, method="SLSQP", options=options)
    return _stationary(game, _on_simplex(answer.x), held)


def _best_weights(game: _Game, start: _Point) -> _Point:
    """Maximise dist(π, Π(u)) over the weights where Π(u) is larger than a point.

    The rows tight at the projection of π are held tight, so the nearest belief is a projection on a flat, smooth in
    the weights; other rows and the multipliers of the tight ones must stay non-negative. Then the rows are read anew.
    """
    value, best = _valued(game, start)
    held, first = start.held, best.action[start.held]
    for _ in range(FLATS):
        loose = _Flat(game, held, best.scale, np.zeros(int((~held).sum()) + len(best.decoy), dtype=bool))
        flat = replace(loose, tight=loose.rows(best.action[held])[1] @ best.decoy < ON_FLAT)
        rows: Any = [{"type": "eq", "fun": lambda w: w.sum() - 1}, {"type": "ineq", "fun": flat.slack}]
        least: Any = [(MIN_SLACK * (1 + WEIGHT_MARGIN), 1.0)] * len(first)
        options: Any = {"ftol": 1e-10, "maxiter": 40}
        answer = minimize(flat.loss, first, bounds=least, constraints=rows, method="SLSQP", options=options)
        # The action is optimal for its nearest belief: solved anew from it, the pair is exact.
        found = _valued(game, _stationary(game, _on_simplex(flat.nearest(answer.x)), held))
        if found[0] <= value + 1e-9:
            break
        value, best = found
        first = best.action[held]
    return best


@dataclass(frozen=True)
class _Flat:
    """The projection of π on {z : equal slopes on S, the tight ones of the other rows, 1'z = 1} as weights vary."""

    game: _Game
    held: Held
    scale: float
    tight: NDArray[np.bool_]

    def rows(self, weights: Array) -> tuple[Array, Array]:
        """Return the equalities and the free inequalities in z: slopes of assets not held, entries of z."""
        action = np.zeros(len(self.held))
        action[self.held] = weights
        gradients = self.game.gradients(action).T / self.scale
        slopes = gradients - gradients[np.flatnonzero(self.held)[0]]
        size = slopes.shape[1]
        signed = np.vstack([slopes[~self.held], np.eye(size)])
        return np.vstack([np.ones(size), slopes[self.held][1:], signed[self.tight]]), signed[~self.tight]

    def nearest(self, weights: Array) -> Array:
        rows, belief = self.rows(weights)[0], self.game.belief
        level = np.append(1.0, np.zeros(len(rows) - 1))
        return np.asarray(belief + np.linalg.pinv(rows, rcond=RANK) @ (level - rows @ belief))

    def loss(self, weights: Array) -> float:
        return -float(np.linalg.norm(self.nearest(weights) - self.game.belief))

    def slack(self, weights: Array) -> Array:
        (rows, free), nearest = self.rows(weights), self.nearest(weights)
        multipliers = np.linalg.pinv(rows, rcond=RANK).T @ (nearest - self.game.belief)
        action = np.zeros(len(self.held))
        action[self.held] = weights
        budget = (self.game.allowed - self.game.cost(action)) / self.game.limit - LIMIT_MARGIN
        return np.concatenate([free @ nearest - SLOPE_MARGIN, multipliers[len(rows) - self.tight.sum() :], [budget]])


# --- over the faces -------------------------------------------------------------------------------------------------


class _Memory:
    """Local optima by face, so that no face is searched twice from nearly one start; the best of all; the clock."""

    def __init__(self, game: _Game, seconds: float, rng: np.random.Generator) -> None:
        self.game = game
        self.rng = rng
        self.started = time.process_time()
        self.deadline = self.started + seconds
        self.faces: dict[bytes, list[Array]] = {}
        self.elite: list[tuple[float, _Point]] = []
        self.history: list[tuple[float, float]] = []
        self.best = -np.inf

    def over(self) -> bool:
        return time.process_time() > self.deadline

    def seen(self, point: _Point, held: Held) -> bool:
        known = self.faces.setdefault(held.tobytes(), [])
        here = np.append(point.decoy, point.action)
        if any(np.linalg.norm(here - other) < LIKE for other in known):
            return True
        known.append(here)
        return False

    def keep(self, value: float, point: _Point) -> None:
        if value > self.best + 1e-9:
            self.history.append((time.process_time() - self.started, value))
        self.best = max(self.best, value)
        near = [i for i, (_, other) in enumerate(self.elite) if np.linalg.norm(other.decoy - point.decoy) < LIKE]
        if any(self.elite[i][0] >= value for i in near):
            return
        self.elite = [pair for i, pair in enumerate(self.elite) if i not in near]
        self.elite = sorted([*self.elite, (value, point)], key=lambda pair: -pair[0])[:ELITE]


def _scouted(memory: _Memory, best: _Point) -> _Point:
    """Judge many random affordable decoys by their sets, then walk at random uphill from the best, from u*(π) on."""
    game, rng, size = memory.game, memory.rng, len(best.decoy)
    value, step = 0.0, 0.1
    for number in range(SCOUTS + WALK):
        if memory.over():
            break
        if number < SCOUTS:
            end = _ray_end(game, _fresh(rng, game.belief), best.held)
            share = 1.0 if number % 2 else rng.uniform(0.4, 1.0)
            trial = game.belief + share * (end.decoy - game.belief)
        else:
            trial = best.decoy + rng.normal(size=size) * step / np.sqrt(size)
        point = _optimal(game, _on_simplex(trial), best.held)
        if game.cost(point.action) > game.allowed:
            point = _ray_end(game, point.decoy, point.held)
        found = _valued(game, point)
        better = found[0] > value
        value, best = found if better else (value, best)
        step = min(0.3, 1.5 * step) if better else max(1e-3, 0.93 * step)
    return best


def _on_face(game: _Game, decoy: Array, held: Held) -> tuple[float, _Point] | None:
    """Return the best admissible point found on a face from a decoy; None where the search ends at none."""
    try:
        if held.sum() >= len(decoy):
            value, point = _valued(game, _best_decoy(game, decoy, held))
        else:
            value, point = _valued(game, _stationary(game, decoy, held))
            if value > -np.inf:
                value, point = _valued(game, _best_weights(game, point))
    except np.linalg.LinAlgError:
        return None
    return (value, point) if value > -np.inf else None


def _switches(point: _Point) -> Iterator[Held]:
    """Yield neighbouring faces: every tight asset switched, one by one, then all combinations of a few."""
    weight_left = np.where(point.held, point.action - MIN_SLACK, np.inf)
    slope_left = np.where(point.held, np.inf, point.slopes / point.scale)
    tight = np.flatnonzero((weight_left < 1e-3 * MIN_SLACK) | (slope_left < TIGHT))
    for size in range(1, len(tight) + 1) if len(tight) <= FEW else (1, 2):
        for chosen in combinations(tight, size):
            held = point.held.copy()
            held[list(chosen)] ^= True
            if held.any():
                yield held


def _settle(memory: _Memory, start: _Point) -> None:
    """Search the start's face and then the faces around the best point reached until none is better."""
    best: tuple[float, _Point] | None = None
    faces = [start.held, start.action >= MIN_SLACK]
    while faces:
        better = None
        for held in faces:
            here = start if best is None else best[1]
            if memory.over() or not held.any() or memory.seen(here, held):
                continue
            found = _on_face(memory.game, here.decoy, held)
            if found is not None:
                memory.keep(*found)
                if best is None or found[0] > best[0] + 1e-8:
                    best = better = found
                    if found[0] > memory.best - 1e-9:
                        break  # the most promising way on; its own neighbours include the faces left
        faces = [] if better is None else list(_switches(better[1]))


def _fresh(rng: np.random.Generator, belief: Array) -> Array:
    """Draw a decoy: corners, faces of any dimension, and the interior, concentrated or spread."""
    size = len(belief)
    chosen = rng.permutation(size)[: rng.integers(1, size + 1)]
    decoy = np.zeros(size)
    decoy[chosen] = rng.dirichlet(np.full(len(chosen), 10.0 ** rng.uniform(-0.7, 1.0)))
    return decoy if np.linalg.norm(decoy - belief) > LIKE else np.roll(decoy, 1)


def _perturbed(memory: _Memory, radius: float) -> None:
    """Shake one of the best: its decoy by a random step, or its face by a few nearly tight assets."""
    rng = memory.rng
    _, point = memory.elite[min(int(rng.geometric(0.35)) - 1, len(memory.elite) - 1)]
    if rng.random() < 0.5:
        step = rng.normal(size=len(point.decoy)) * radius / np.sqrt(len(point.decoy))
        decoy = _on_simplex(point.decoy + step)
        if point.held.sum() >= len(decoy):
            _settle(memory, _climb(memory.game, decoy, point.held, memory.deadline))
        else:
            _settle(memory, _ray_end(memory.game, decoy, point.held))
        return
    slack = np.where(point.held, point.action / point.action.max(), point.slopes / point.scale)
    ranked = np.argsort(slack)[: 4 + 2 * len(point.decoy)]
    held = point.held.copy()
    held[rng.choice(ranked, size=min(int(rng.integers(1, 4)), len(ranked)), replace=False)] ^= True
    if held.any():
        _settle(memory, point._replace(held=held, action=np.where(held, 1.0, 0.0)))


def best_by_multistart(
    means: Array,
    covariances: Array,
    risk_aversion: float,
    belief: Array,
    limit: float,
    *,
    seconds: float,
    rng: np.random.Generator,
) -> Best:
    """Return the most private affordable action found until time is up; u*(π) where nothing better is found.

    `limit` > 0 is the regret allowed, in the cost's unit, `seconds` and the history are the processor's time. Every
    belief needs one minimiser.
    """
    market = Market(means, covariances, risk_aversion)
    game, optimal = _opened(market, belief, limit)
    optimal_cost = game.cost(optimal.action)
    memory = _Memory(game, seconds, rng)
    round_ = 0
    while not memory.over():
        small_face = bool(memory.elite) and memory.elite[0][1].held.sum() < len(belief)
        if round_ % (3 if small_face else 4) == 1:
            _settle(memory, _scouted(memory, optimal))
        elif round_ < 2 * len(belief) or not memory.elite or rng.random() < 0.4:
            reached = _climb(game, _fresh(rng, belief), optimal.held, memory.deadline)
            if np.linalg.norm(reached.decoy - belief) > NEAR * memory.best:
                _settle(memory, reached)
        else:
            _perturbed(memory, 0.3 * 10.0 ** -rng.uniform(0.0, 2.0))
        round_ += 1
    for point in [*(point for _, point in memory.elite), optimal]:
        verdict = judged(market, belief, optimal_cost, point.action)
        if verdict.admissible and verdict.regret <= limit:
            break
    return Best(point.action, verdict.privacy, verdict.nearest, memory.history)
