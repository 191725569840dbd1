"""The global optimum of the counter-adversarial decision for maximal obfuscation, support by support.

Maximise dist(π, Π(u)) over u in the simplex with u_j = 0 or u_j >= min_slack, ρ(π,u) <= budget and Π(u) not empty.
A set S of held assets falls in one of three classes:

- one asset: Π(u) is judged directly;
- two assets, three states: Π(u) is a segment, the distance is that of the segment, scanned densely in the one free
  weight; brackets of the best values, and of the edges beyond which Π(u) is empty or u too dear, are refined;
- at least as many assets as states: Π(u) is a single belief save at isolated actions, so SCIP maximises
  ‖π − y‖² over the pairs (u, y) that satisfy the first-order conditions, with a proven bound.

Maximising over pairs where several beliefs share an action would overestimate, hence the second class. Every
winner is judged again by the distance of its set. Two or three states, at most six assets.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from oracles import consistent, enumeration, markets
from oracles.markets import Market

Array = NDArray[np.float64]

SCAN = 2001  # actions per one-dimensional scan
NEAR_BEST = 0.05  # brackets of the scan that reach this close to its best are refined
PARALLEL = 1e-9  # gradients that differ between states by less than this share of their size draw no line
GAP = 1e-6  # relative gap asked of SCIP, in squared distance
FEASIBILITY = (1e-9, 1e-7, 1e-6)  # of SCIP's rows: the tightest at which its LP solver goes through
SECONDS = 60.0  # per support
ROUNDING = 1e-11  # slack of budget, weights and slopes when a winner is judged
HELD = 1e-12  # a weight above this is held: far below any min_slack in use
UNIQUE = 1e-13  # least relative curvature: a copied asset is at 1e-16, a ridge of 1e-10 well above


class Case(NamedTuple):
    """A seeded problem: budget in the cost's unit."""

    name: str
    market: Market
    belief: Array
    budget: float
    min_slack: float


@dataclass(frozen=True)
class Face:
    """What is known of one support: best distance found, where, a bound, how it was obtained and what SCIP took."""

    held: tuple[int, ...]
    privacy: float
    action: Array | None
    upper_bound: float
    status: str
    scip_seconds: float = 0.0


@dataclass(frozen=True)
class Problem:
    """One decision to be obfuscated: the market, π, V(π) + budget, and the smallest weight."""

    market: Market
    belief: Array
    allowed: float
    min_slack: float

    def cost(self, action: Array) -> float:
        return float(self.belief @ markets.costs(self.market, action))

    def affordable(self, action: Array) -> bool:
        return self.cost(action) <= self.allowed + ROUNDING

    def system(self, action: Array) -> consistent.System:
        return consistent.simplex_system(markets.gradients(self.market, action), action > HELD)

    def privacy(self, action: Array) -> float:
        """Return the distance from π to the corners' hull of Π(u): −inf where empty."""
        corners = consistent.vertices(self.system(action))
        return consistent.hull_distance(self.belief, corners) if len(corners) else -np.inf


def cases(seed: int = 20260801) -> Iterator[Case]:
    """Yield 24 seeded problems: 12 with 3 assets, 12 with 6; three states; every other one has V > 0 everywhere."""
    children = np.random.SeedSequence(seed).spawn(24)
    for index, child in enumerate(children):
        rng = np.random.default_rng(child)
        n_assets = 3 if index < 12 else 6
        market = markets.random_market(rng, 3, n_assets, positive_value=index % 2 == 0)
        belief = markets.random_belief(rng, 3)
        optimal = enumeration.value(market, belief)[0]
        yield Case(f"U{n_assets}-{index:02d}", market, belief, 0.1 * abs(optimal), 1e-4)


def global_cdm(market: Market, belief: Array, budget: float, min_slack: float) -> tuple[float, Array | None, float]:
    """Return the best privacy, its action and an upper bound; −inf, None where no admissible action is affordable.

    The privacy is exact for its action. The bound is proven by SCIP except on two-asset supports of a three-state
    market, where it is the scan's own best value.
    """
    faces = solve_faces(market, belief, budget, min_slack)
    best = max(faces, key=lambda face: face.privacy)
    return best.privacy, best.action, max(face.upper_bound for face in faces)


def solve_faces(
    market: Market, belief: Array, budget: float, min_slack: float, *, seconds: float = SECONDS
) -> list[Face]:
    """Return one `Face` per support; a SCIP bound is cut off at the best privacy found so far."""
    n_states, n_assets = market.means.shape
    if n_states > 3 or n_assets > 6:
        raise ValueError(f"two or three states and at most six assets, got {n_states} and {n_assets}")
    if _least_curvature(market) < UNIQUE:
        raise ValueError("every belief needs one minimiser: a state's cost is flat along an exchange of assets")
    problem = Problem(market, belief, enumeration.value(market, belief)[0] + budget, min_slack)
    seeds = _seeds(problem)
    best = max((face.privacy for face in seeds.values()), default=-np.inf)
    faces = []
    for held in enumeration.supports(n_assets):
        if len(held) == 1:
            face = _single(problem, held)
        elif len(held) < n_states:
            face = _scan(problem, held)
        else:
            started = time.perf_counter()
            face = _scip(problem, held, seeds.get(tuple(held)), best, seconds)
            face = replace(face, scip_seconds=time.perf_counter() - started)
        best = max(best, face.privacy)
        faces.append(face)
    return faces


def _least_curvature(market: Market) -> float:
    """Return the smallest curvature along exchanges of assets, over the largest; 1 for a single asset."""
    size = market.means.shape[1]
    exchanges = np.eye(size)[1:] - np.eye(size)[:1]
    curvatures = [np.linalg.eigvalsh(exchanges @ covariance @ exchanges.T) for covariance in market.covariances]
    return float(min((values[0] / values[-1] for values in curvatures if size > 1), default=1.0))


def _single(problem: Problem, held: list[int]) -> Face:
    action = np.zeros(problem.market.means.shape[1])
    action[held] = 1.0
    privacy = problem.privacy(action) if problem.affordable(action) else -np.inf
    status = "judged" if np.isfinite(privacy) else "empty or too dear"
    return Face(tuple(held), privacy, action if np.isfinite(privacy) else None, privacy, status)


# --- two assets, three states -------------------------------------------------------------------------------------


def _segment_distances(problem: Problem, held: list[int], shares: Array) -> Array:
    """Return dist(π, Π(u)) for u = t e_a + (1−t) e_b, t in `shares`; −inf where empty.

    Equal gradients on the two assets cut the plane 1'y = 1 along a line y0 + τd; y >= 0 and the assets not
    held clip τ to an interval. Where the two gradients differ by the same in every state there is no line.
    """
    means, covariances, risk_aversion = problem.market
    actions = _two_held(problem, held, shares)
    slopes = 2 * risk_aversion * np.einsum("iab,tb->tai", covariances, actions) - means.T
    normal = slopes[:, held[0]] - slopes[:, held[1]]
    flat = normal - normal.mean(axis=1, keepdims=True)
    length = np.linalg.norm(flat, axis=1)
    plain = length > PARALLEL * np.abs(slopes).max()
    length = np.where(plain, length, 1.0)
    along = np.cross(flat / length[:, None], np.ones(3) / np.sqrt(3))
    start = 1 / 3 - flat * (normal.mean(axis=1) / length**2)[:, None]
    rest = [asset for asset in range(means.shape[1]) if asset not in held]
    signs = np.concatenate(
        [np.broadcast_to(np.eye(3), (len(shares), 3, 3)), slopes[:, rest] - slopes[:, [held[0]]]], axis=1
    )
    level = np.einsum("tri,ti->tr", signs, start)
    rate = np.einsum("tri,ti->tr", signs, along)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = -level / rate
    low = np.where(rate > 0, crossing, -np.inf).max(axis=1)
    high = np.where(rate < 0, crossing, np.inf).min(axis=1)
    position = np.clip(np.einsum("ti,ti->t", problem.belief - start, along), low, high)
    away = np.linalg.norm(start + position[:, None] * along - problem.belief, axis=1)
    blocked = (low > high) | ((rate == 0) & (level < 0)).any(axis=1)
    distances = np.where(blocked, -np.inf, away)
    distances[~plain] = [problem.privacy(action) for action in actions[~plain]]
    return np.asarray(distances)


def _two_held(problem: Problem, held: list[int], shares: Array) -> Array:
    actions = np.zeros((len(shares), problem.market.means.shape[1]))
    actions[:, held[0]], actions[:, held[1]] = shares, 1 - shares
    return actions


def _affordable_shares(problem: Problem, held: list[int]) -> tuple[float, float]:
    """Return the interval of t on which u = t e_a + (1−t) e_b is admissible and affordable; (1, 0) if none.

    The expected cost is a parabola in t, read off three of its values.
    """
    at_zero, at_half, at_one = (problem.cost(action) for action in _two_held(problem, held, np.array([0.0, 0.5, 1.0])))
    curve = 2 * (at_zero - 2 * at_half + at_one)
    slope = at_one - at_zero - curve
    inside = slope**2 - 4 * curve * (at_zero - problem.allowed)
    if inside < 0 or curve <= 0:
        return 1.0, 0.0
    centre, reach = -slope / (2 * curve), np.sqrt(inside) / (2 * curve)
    least = max(problem.min_slack, 10 * HELD)
    return max(least, centre - reach), min(1 - least, centre + reach)


def _scan(problem: Problem, held: list[int]) -> Face:
    """Scan the share of the first asset, refine every bracket near the best value, judge the winner by its set."""

    def at(share: float) -> float:
        return float(_segment_distances(problem, held, np.array([share]))[0])

    first, last = _affordable_shares(problem, held)
    if first > last:
        return Face(tuple(held), -np.inf, None, -np.inf, "scan: too dear")
    special = [_stationary(problem, held, belief)[held[0]] for belief in (problem.belief, *np.eye(3))]
    shares = np.append(np.linspace(first, last, SCAN), [share for share in special if first <= share <= last])
    shares = np.unique(shares)
    values = _segment_distances(problem, held, shares)
    if not np.isfinite(values).any():
        return Face(tuple(held), -np.inf, None, -np.inf, "scan: empty")
    best_share, best = float(shares[values.argmax()]), float(values.max())
    for index in np.flatnonzero(np.isfinite(values)):
        bracket = [max(int(index) - 1, 0), int(index), min(int(index) + 1, len(shares) - 1)]
        if values[index] < values[bracket].max() or values[index] < best - NEAR_BEST:
            continue
        for share in _refined(at, shares[bracket], values[bracket]):
            if at(share) > best:
                best_share, best = share, at(share)
    action = _two_held(problem, held, np.array([best_share]))[0]
    privacy = problem.privacy(action)
    return Face(tuple(held), privacy, action, max(best, privacy), "scanned")


def _refined(at: Callable[[float], float], shares: Array, values: Array) -> list[float]:
    """Return candidates inside a bracket: the edges of the domain by bisection, and the best interior point."""
    edges = []
    low, middle, high = shares
    for outer, value in ((low, values[0]), (high, values[2])):
        inner = middle
        if np.isfinite(value):
            edges.append(outer)
            continue
        for _ in range(60):
            half = (inner + outer) / 2
            inner, outer = (half, outer) if np.isfinite(at(half)) else (inner, half)
        edges.append(inner)
    first, last = edges
    if last - first < 1e-14:
        return edges
    found = minimize_scalar(lambda share: -at(share), bounds=(first, last), method="bounded", options={"xatol": 1e-13})
    return [*edges, float(found.x)]


# --- at least as many assets as states ------------------------------------------------------------------------------


def _stationary(problem: Problem, held: list[int], decoy: Array) -> Array:
    """Return the action on S that is stationary for the decoy y (weights may be negative)."""
    means, covariances, risk_aversion = problem.market
    size = len(held)
    system = np.ones((size + 1, size + 1))
    system[:size, :size] = 2 * risk_aversion * np.tensordot(decoy, covariances, 1)[np.ix_(held, held)]
    system[size, size] = 0.0
    action = np.zeros(means.shape[1])
    action[held] = np.linalg.solve(system, np.append((decoy @ means)[held], 1.0))[:size]
    return action


def _slacks(problem: Problem, held: list[int], decoy: Array) -> Array:
    """Return what must be >= 0 for the decoy's action on S: weights, gradients off S, budget left, the decoy."""
    action = _stationary(problem, held, decoy)
    slope = markets.gradients(problem.market, action) @ decoy
    off = [asset for asset in range(len(action)) if asset not in held]
    return np.concatenate(
        [action[held] - problem.min_slack, slope[off] - slope[held[0]], [problem.allowed - problem.cost(action)], decoy]
    )


def _judged(problem: Problem, held: list[int], decoy: Array, bound: float, status: str) -> Face:
    """Return the face with the decoy's action, if it is admissible, judged by its set."""
    if _slacks(problem, held, decoy).min() < -ROUNDING:
        return Face(tuple(held), -np.inf, None, bound, status + ", point refused")
    action = _stationary(problem, held, decoy)
    return Face(tuple(held), problem.privacy(action), action, bound, status)


def _polished(problem: Problem, held: list[int], decoy: Array) -> Array:
    """Return the farthest admissible decoy near the given one within the same support.

    Sequential quadratic programming over all coordinates but the last; where it stops a rounding outside, the
    point is pulled towards π, along which the regret falls, by the least power of ten that makes it admissible.
    """

    def whole(free: Array) -> Array:
        return np.append(free, 1 - free.sum())

    def loss(free: Array) -> float:
        return -float(((whole(free) - problem.belief) ** 2).sum())

    starts = [decoy]
    for start in (decoy, 0.999 * decoy + 0.001 * problem.belief):
        inside: Any = [{"type": "ineq", "fun": lambda free: _slacks(problem, held, whole(free))}]
        options: Any = {"ftol": 1e-14, "maxiter": 200}
        free = minimize(loss, start[:-1], constraints=inside, method="SLSQP", options=options).x
        starts.append(whole(free))
    pulls = [0.0, *10.0 ** np.arange(-13.0, -4.0)]
    admissible = []
    for start in starts:
        pulled = (start + pull * (problem.belief - start) for pull in pulls)
        admissible += [y for y in pulled if _slacks(problem, held, y).min() >= -ROUNDING][:1]
    return max(admissible, key=lambda y: float(np.linalg.norm(y - problem.belief)), default=decoy)


def _seeds(problem: Problem, resolution: int = 40) -> dict[tuple[int, ...], Face]:
    """Return, per support of at least X assets, the polished best decoy of a grid: a start for SCIP."""
    n_states, n_assets = problem.market.means.shape
    grid = np.array(list(np.ndindex((resolution + 1,) * (n_states - 1)))) / resolution
    grid = grid[grid.sum(axis=1) <= 1]
    decoys = np.column_stack([grid, 1 - grid.sum(axis=1)])
    faces = {}
    for held in enumeration.supports(n_assets):
        if len(held) < n_states:
            continue
        usable = [y for y in decoys if _slacks(problem, held, y).min() >= 0]
        if usable:
            start = max(usable, key=lambda y: float(np.linalg.norm(y - problem.belief)))
            faces[tuple(held)] = _judged(problem, held, _polished(problem, held, start), np.inf, "grid")
    return faces


def _scip(problem: Problem, held: list[int], seed: Face | None, best: float, seconds: float) -> Face:
    """Maximise ‖π − y‖² over first-order pairs on S; look only above the best privacy found on any support."""
    known = seed.privacy if seed else -np.inf
    floor = max(best, known)
    for feasibility in FEASIBILITY:
        model, decoy = _scip_model(problem, held)
        model.setParam("numerics/feastol", feasibility)
        model.setParam("limits/gap", GAP)
        model.setParam("limits/time", seconds)
        if floor > 0:
            model.setObjlimit(floor**2)
        try:
            model.optimize()
            break
        except Exception as error:  # pyscipopt raises nothing narrower; a bound that is not there is no bound
            if "LP solver" not in str(error):
                raise
    else:
        seeded = seed or Face(tuple(held), -np.inf, None, np.inf, "")
        return replace(seeded, upper_bound=np.inf, status="scip: error in its LP solver")
    status = f"scip: {model.getStatus()}, rows within {feasibility:g}"
    if model.getStatus() == "infeasible":
        return Face(tuple(held), known, seed.action if seed else None, floor, "scip: nothing above the best known")
    bound = max(floor, float(np.sqrt(max(0.0, model.getDualbound()))))
    found = Face(tuple(held), -np.inf, None, bound, status)
    if model.getNSols() > 0:
        point = np.maximum([model.getVal(variable) for variable in decoy], 0.0)
        found = _judged(problem, held, _polished(problem, held, point / point.sum()), bound, status)
    if seed is not None and seed.privacy > found.privacy:
        return Face(tuple(held), seed.privacy, seed.action, max(bound, seed.privacy), found.status)
    return found


def _scip_model(problem: Problem, held: list[int]) -> tuple[Any, list[Any]]:
    """Return the programme in (u_S, y): equal slopes on S, none smaller off S, cost at most what is allowed.

    Slopes are Σ_i y_i (2γΣ_i u − μ_i)_j, taken against the first held asset's and scaled to coefficients of about one.
    """
    scip = pytest.importorskip("pyscipopt")
    means, covariances, risk_aversion = problem.market
    model = scip.Model()
    model.hideOutput()
    model.setParam("randomization/randomseedshift", 1)
    weights = {j: model.addVar(f"u{j}", lb=problem.min_slack, ub=1.0) for j in held}
    decoy = [model.addVar(f"y{i}", lb=0.0, ub=1.0) for i in range(len(means))]
    model.addCons(scip.quicksum(weights.values()) == 1)
    model.addCons(scip.quicksum(decoy) == 1)
    first, scale = held[0], max(float(np.abs(means).max()), float(2 * risk_aversion * np.abs(covariances).max()))
    for asset in range(means.shape[1]):
        if asset == first:
            continue
        curved = 2 * risk_aversion * (covariances[:, asset] - covariances[:, first]) / scale
        flat = (means[:, asset] - means[:, first]) / scale
        slope = scip.quicksum(
            decoy[i] * (scip.quicksum(curved[i, j] * weights[j] for j in held) - flat[i]) for i in range(len(means))
        )
        model.addCons(slope == 0 if asset in held else slope >= 0)
    mean_covariance = risk_aversion * np.tensordot(problem.belief, covariances, 1) / scale
    mean_return = problem.belief @ means / scale
    cost = scip.quicksum(mean_covariance[j, k] * weights[j] * weights[k] for j in held for k in held)
    model.addCons(cost - scip.quicksum(mean_return[j] * weights[j] for j in held) <= problem.allowed / scale)
    reach = model.addVar("reach", lb=0.0, ub=2.0)
    gaps = [y - p for y, p in zip(decoy, problem.belief.tolist(), strict=True)]
    model.addCons(reach <= scip.quicksum(gap * gap for gap in gaps))
    model.setObjective(reach, "maximize")
    return model, decoy
