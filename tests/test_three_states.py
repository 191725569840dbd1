"""Three states: climbs in the plane of beliefs, segments and polygons, and the lotteries that are built from them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from inscrutable import (
    MarkowitzProblem,
    consistent_beliefs,
    decoy_grid,
)
from inscrutable.decision_makers.candidates import make_candidates
from inscrutable.decision_makers.search.atlas import Atlas
from inscrutable.decision_makers.search.face_search import rules_for
from inscrutable.decision_makers.search.plane import ground_of
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.kernels.three_sets import climb_line, polygon_distance, segment_of_line
from inscrutable.kernels.three_states import LOCAL, Here, bench, climb_three, look_three
from oracles import enumeration, markets
from strategies import SEEDS

Array = NDArray[np.float64]

BASIS = sum_zero_basis(3)
RULES = rules_for(3)
LEAST = 1e-4 * (1 + 1e-5)  # slack that a climb leaves to a held asset
SIGNS = pytest.mark.parametrize("sign", [1.0, -1.0], ids=["far", "near"])


# --- markets ------------------------------------------------------------------------------------------------------------


def drawn_market(seed: int, n_assets: int, spread: bool = True) -> markets.Market:
    """Means of ±0.1 leave most assets held; of ±0.6, few."""
    market = markets.random_market(np.random.default_rng([17, seed, n_assets]), 3, n_assets)
    return market._replace(means=market.means * (0.3 if spread else 2.0))


def plane_point(belief: Array) -> Array:
    return np.asarray(belief @ BASIS)


def here_of(belief: Array, point: Array, sign: float, optimal: float) -> Here:
    return Here(*(float(b) for b in belief), *(float(p) for p in plane_point(point)), sign, float(optimal))


class Face(NamedTuple):
    """Decisions that hold the assets of a mask, by a linear system in (weights, multiplier of the sum): NumPy alone."""

    market: markets.Market
    held: np.ndarray  # (U,)

    def actions(self, y: Array) -> Array:
        """The cheapest decisions (n,U) under y (n,3) among those that hold nothing else; weights may be negative."""
        held = np.flatnonzero(self.held)
        k, (means, covariances, aversion) = len(held), self.market
        system, sides = np.zeros((len(y), k + 1, k + 1)), np.ones((len(y), k + 1))
        system[:, :k, :k] = 2 * aversion * np.einsum("ni,iab->nab", y, covariances[:, held[:, None], held])
        system[:, :k, k] = system[:, k, :k] = 1.0
        sides[:, :k] = y @ means[:, held]
        actions = np.zeros((len(y), len(self.held)))
        actions[:, held] = np.linalg.solve(system, sides[:, :, None])[:, :k, 0]
        return actions

    def regrets(self, y: Array, belief: Array) -> Array:
        means, covariances, aversion = self.market
        u = self.actions(y)
        paid = aversion * np.einsum("na,iab,nb->ni", u, covariances, u) - u @ means.T
        return np.asarray(paid @ belief - enumeration.value(self.market, belief)[0])

    def rows(self, y: Array, scale: float = 1.0) -> Array:
        """Probabilities, multipliers of assets that are not held (over `scale`), spare weights: all ≥ 0 is allowed."""
        means, covariances, aversion = self.market
        u = self.actions(y)
        gradients = 2 * aversion * np.einsum("ni,iab,nb->na", y, covariances, u) - y @ means
        level = gradients[:, self.held].mean(axis=1, keepdims=True)
        return np.hstack([y, (gradients[:, ~self.held] - level) / scale, u[:, self.held] - LEAST])


class Ground(NamedTuple):
    """A market's faces as the kernels see them and as the oracle does."""

    market: markets.Market
    problem: MarkowitzProblem
    atlas: Atlas

    def faces(self, *sizes: int) -> list[int]:
        """Numbers of the faces with so many free coordinates; no size: with two or more."""
        found = self.atlas.arena.size
        return [int(f) for f in np.flatnonzero(np.isin(found, sizes) if sizes else found >= 2)]

    def face(self, number: int) -> Face:
        return Face(self.market, ~self.atlas.patterns[number][: self.problem.n_actions])

    def decoys(self, number: int) -> Array:
        return self.atlas.table.decoys[self.atlas.table.face == number]


def ground(seed: int, n_assets: int, spread: bool = True, resolution: int = 16) -> Ground:
    market = drawn_market(seed, n_assets, spread)
    problem = MarkowitzProblem(*market)
    return Ground(market, problem, Atlas(problem, decoy_grid(problem, resolution)))


# --- kernels that Python cannot call, inside of functions that it can ---------------------------------------------------


def memory(ground: Any) -> Any:
    return getattr(bench, "py_func", bench)(ground)


def looked(ground: Any, face: int, rules: Any, here: Here, y: Any) -> Any:
    return _looked(ground, face, rules, here, y, memory(ground))


@numba.njit
def _looked(ground: Any, face: int, rules: Any, here: Any, y: Any, on: Any) -> Any:
    k, m, _, at, row_at = ground.faces[face]
    least, near = look_three(ground, at, row_at, m, k, rules, here, y[0], y[1], y[2], np.inf, on)
    return least, on[LOCAL].copy(), on[12:15, :near].copy()


def climbed(ground: Any, face: int, rules: Any, here: Here, aim: Any, z: Any) -> Any:
    return _climbed(ground, face, rules, here, aim, z, memory(ground))


@numba.njit
def _climbed(ground: Any, face: int, rules: Any, here: Any, aim: Any, z: Any, on: Any) -> Any:
    return climb_three(ground, face, rules, here, aim, z[0], z[1], on)


@numba.njit
def segment(ground: Any, face: int, v: float, p: Any) -> Any:
    return segment_of_line(ground, face, v, p[0], p[1], p[2])


@numba.njit
def climbed_line(ground: Any, face: int, rules: Any, here: Any, aim: Any, v: float) -> Any:
    return climb_line(ground, face, rules, here, aim, v)


@numba.njit
def from_polygon(ground: Any, face: int, rules: Any, z: Any) -> float:
    return polygon_distance(ground, face, rules, z[0], z[1])


# --- climbs in the plane ------------------------------------------------------------------------------------------------


@settings(max_examples=25)
@given(SEEDS, st.sampled_from([3, 4, 5, 7]), st.booleans())
def test_regret_rows_and_their_derivatives_are_those_of_differences(seed: int, n_assets: int, spread: bool) -> None:
    here, rng = ground(seed % 1000, n_assets, spread, 8), np.random.default_rng(seed)
    belief = rng.dirichlet(np.ones(3))
    optimal = enumeration.value(here.market, belief)[0]
    spot = here_of(belief, belief, 1.0, optimal)
    for number in here.faces()[:4]:
        face, arena = here.face(number), here.atlas.arena
        y = 0.9 * here.decoys(number)[0] + 0.1 / 3
        least, local, rows = looked(ground_of(arena), number, RULES, spot, y)
        wide = np.abs(face.regrets(y[None], belief)[0]) + np.abs(optimal) + 1.0
        np.testing.assert_allclose(local[0], face.regrets(y[None], belief)[0], atol=1e-12 * wide)
        h, eye = 1e-4, np.eye(3)
        slope = (face.regrets(y + h * eye, belief) - face.regrets(y - h * eye, belief)) / (2 * h)
        bent = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                four = y + h * np.array([eye[i] + eye[j], eye[i] - eye[j], eye[j] - eye[i], -eye[i] - eye[j]])
                bent[i, j] = face.regrets(four, belief) @ [1, -1, -1, 1] / (4 * h * h)
        size = np.abs(bent).max() + np.abs(slope).max()
        np.testing.assert_allclose(local[1:4], slope, atol=2e-6 * size + 1e-9)
        np.testing.assert_allclose(local[4:10], bent[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], atol=2e-4 * size + 1e-6)

        values = face.rows(y[None], arena.scale[number])[0]
        np.testing.assert_allclose(least, values.min(), atol=1e-11)
        normals = (face.rows(y + h * BASIS.T) - face.rows(y - h * BASIS.T)) / (2 * h)
        lengths = np.linalg.norm(normals, axis=0)
        leans = lengths > 1e-6
        if rows.shape[1] == lengths.size:
            rows = rows[:, leans]
        # Rows that are level have no side on which a step could lie; they are left out.
        near = 1e-5 * lengths.max() + 1e-9
        np.testing.assert_allclose(rows[1:] * lengths[leans], normals[:, leans], atol=near)
        np.testing.assert_allclose(rows[0] * lengths[leans], face.rows(y[None])[0][leans], atol=near)


@SIGNS
@pytest.mark.parametrize("at_price", [True, False], ids=["price", "limit"])
def test_a_climb_that_begins_from_what_was_seen_for_a_neighbour_ends_where_a_fresh_one_does(
    at_price: bool, sign: float
) -> None:
    compared = 0
    for seed in range(8):
        here, rng = ground(seed, 3 + seed % 3), np.random.default_rng(seed)
        ground_here = ground_of(here.atlas.arena)
        for number in here.faces():
            belief, target = rng.dirichlet(np.ones(3)), rng.dirichlet(np.ones(3))
            beside = belief + 0.004 * BASIS @ rng.normal(size=2)
            if beside.min() < 0:
                continue
            regrets = here.face(number).regrets(here.decoys(number), belief)
            aim = (np.inf if at_price else float(np.median(regrets)), 0.5 / max(float(np.median(regrets)), 1e-12))
            spots = [
                here_of(b, b if sign > 0 else target, sign, enumeration.value(here.market, b)[0])
                for b in (belief, beside)
            ]
            on = memory(ground_here)
            first = _climbed(ground_here, number, RULES, spots[0], aim, plane_point(here.decoys(number)[0]), on)
            if not first[0]:
                continue
            place = np.array(first[1:3])
            warm, fresh = (
                _climbed(ground_here, number, RULES, spots[1], aim, place, each) for each in (on, memory(ground_here))
            )
            if warm[0] and fresh[0]:
                compared += 1
                worths = [end[4] - (aim[1] * end[3] if at_price else 0.0) for end in (warm, fresh)]
                assert worths[0] == pytest.approx(worths[1], abs=1e-7)
    assert compared >= 5


class Climb(NamedTuple):
    """One climb, what it was given, and its oracle."""

    face: Face
    belief: Array
    point: Array
    sign: float
    limit: float
    price: float
    start: Array
    reached: tuple[bool, float, float, float, float, float]
    scale: float

    @property
    def y(self) -> Array:
        return 1 / 3 + BASIS @ np.array(self.reached[1:3])

    @property
    def is_fair(self) -> bool:
        """Whether it starts where it may end, and there is no kink, a target that the face can reach, on which to stop."""
        kink = self.sign < 0 and np.isfinite(self.worth(self.point)[0])
        return bool(np.isfinite(self.worth(self.start)[0])) and not kink

    def worth(self, y: Array) -> Array:
        """Privacy at the price, or under the limit: −∞ where a row or the budget is broken."""
        y = np.atleast_2d(y)
        regrets, privacies = self.face.regrets(y, self.belief), self.sign * np.linalg.norm(y - self.point, axis=1)
        allowed = self.face.rows(y, self.scale).min(axis=1) >= -1e-9
        if np.isinf(self.limit):
            return np.where(allowed, privacies - self.price * regrets, -np.inf)
        return np.where(allowed & (regrets <= self.limit * (1 + 1e-9)), privacies, -np.inf)


def climbs(seed: int, n_assets: int, sign: float, at_price: bool, spread: bool = True) -> list[Climb]:
    here, rng = ground(seed, n_assets, spread), np.random.default_rng([seed, n_assets])
    found = []
    for number in here.faces():
        face, decoys = here.face(number), here.decoys(number)
        belief = rng.dirichlet(np.ones(3))
        point = belief if sign > 0 else rng.dirichlet(np.ones(3))
        optimal = enumeration.value(here.market, belief)[0]
        spot = here_of(belief, point, sign, optimal)
        for start in decoys[rng.permutation(len(decoys))[:3]]:
            regrets = face.regrets(decoys, belief)
            limit = np.inf if at_price else 0.97 * float(np.quantile(regrets, rng.uniform(0.3, 0.9)))
            price = float(rng.uniform(0.1, 2.0) / max(np.median(regrets), 1e-12))
            aim = (limit, price)
            reached = climbed(ground_of(here.atlas.arena), number, RULES, spot, aim, plane_point(start))
            found.append(
                Climb(face, belief, point, sign, limit, price, start, reached, float(here.atlas.arena.scale[number]))
            )
    return found


@SIGNS
@pytest.mark.parametrize("at_price", [True, False], ids=["price", "limit"])
@pytest.mark.parametrize("n_assets", [3, 5])
def test_a_climb_ends_at_an_allowed_place_that_no_small_move_improves(
    n_assets: int, at_price: bool, sign: float
) -> None:
    rng = np.random.default_rng(3)
    around = rng.normal(size=(200, 2))
    around *= np.geomspace(1e-5, 3e-3, 200)[:, None] / np.linalg.norm(around, axis=1, keepdims=True)
    tried, ended = 0, 0
    for seed in range(12):
        for climb in climbs(seed, n_assets, sign, at_price, spread=seed % 2 == 0):
            ok, _, _, regret, privacy, _ = climb.reached
            tried += climb.is_fair
            ended += ok and climb.is_fair
            if not ok:
                continue
            y = climb.y
            assert climb.face.rows(y[None], climb.scale).min() >= -1e-9
            np.testing.assert_allclose(regret, max(climb.face.regrets(y[None], climb.belief)[0], 0.0), atol=1e-11)
            np.testing.assert_allclose(privacy, sign * np.linalg.norm(y - climb.point), atol=1e-12)
            assert regret <= climb.limit * (1 + 1e-9)
            worth = climb.worth(y)[0]
            assert worth >= climb.worth(climb.start)[0] - 1e-7
            assert worth >= climb.worth(y + around @ BASIS.T).max() - 1e-6
    assert tried >= 8
    assert ended >= 0.75 * tried


@SIGNS
@pytest.mark.parametrize("n_assets", [3, 5])
def test_the_price_of_a_limit_is_the_slope_of_the_best_privacy(n_assets: int, sign: float) -> None:
    compared, paid = 0, 0
    for seed in range(13):
        for climb in climbs(seed, n_assets, sign, at_price=False):
            compared_here = _slopes(climb, seed, n_assets)
            if compared_here is None:
                continue
            below, above, price = compared_here
            compared += 1
            paid += price > 0
            size = max(abs(below), abs(above), 1e-3)
            assert min(below, above) - 0.01 * size <= price <= max(below, above) + 0.01 * size
    assert compared >= 10
    assert paid >= 8


def _slopes(climb: Climb, seed: int, n_assets: int) -> tuple[float, float, float] | None:
    """Change of the best privacy when the limit shrinks and grows a little, each climbed from the optimum."""
    ok, z0, z1, _, privacy, price = climb.reached
    if not ok or climb.limit < 1e-6:
        return None
    here = ground(seed, n_assets)
    number = next(f for f in here.faces() if np.array_equal(here.face(f).held, climb.face.held))
    optimal = enumeration.value(here.market, climb.belief)[0]
    spot = here_of(climb.belief, climb.point, climb.sign, optimal)
    step, slopes = 2e-3 * climb.limit, []
    for way in (-1, 1):
        aim = (climb.limit + way * step, price)
        moved = climbed(ground_of(here.atlas.arena), number, RULES, spot, aim, np.array([z0, z1]))
        if not moved[0] or np.hypot(moved[1] - z0, moved[2] - z1) > 0.05:
            return None
        slopes.append((moved[4] - privacy) / (way * step))
    return slopes[0], slopes[1], price


# --- segments and polygons ----------------------------------------------------------------------------------------------


def places(here: Ground, number: int, count: int) -> Array:
    """Coordinates along an edge with both assets held, by enough."""
    programme = here.atlas.faces(here.atlas.patterns[number])
    held = ~here.atlas.patterns[number][: here.problem.n_actions]
    ends = (LEAST - programme.origin[held]) / programme.span[held, 0]
    inner = np.linspace(0, 1, count + 2)[1:-1]
    return np.asarray(ends[0] + (ends[1] - ends[0]) * inner)


def action_at(here: Ground, number: int, v: float) -> Array:
    return here.atlas.faces(here.atlas.patterns[number]).action(np.array([v]))


EDGES = [(2, True), (2, False), (3, True), (3, False)]


@pytest.mark.parametrize(("n_assets", "spread"), EDGES)
def test_a_segments_distance_nearest_belief_and_derivative(n_assets: int, spread: bool) -> None:
    judged, empty, sloped = 0, 0, 0
    for seed in range(8 if n_assets == 2 else 24):
        here, rng = ground(seed, n_assets, spread, 12), np.random.default_rng(seed)
        for number in here.faces(1):
            arena = here.atlas.arena
            for v in places(here, number, 9):
                point = rng.dirichlet(np.full(3, 0.7))
                found, distance, slope, *nearest = segment(ground_of(arena), number, v, point)
                seen = consistent_beliefs(here.problem, action_at(here, number, v))
                assert found == (not seen.is_empty)
                if not found:
                    empty += 1
                    continue
                judged += 1
                np.testing.assert_allclose(distance, seen.distance(point), atol=1e-8)
                np.testing.assert_allclose(nearest, seen.nearest(point), atol=1e-7)
                h = 1e-5
                sides = [consistent_beliefs(here.problem, action_at(here, number, v + w)) for w in (-h, h)]
                if any(side.is_empty for side in sides):
                    continue
                left, right = ((side.distance(point) - seen.distance(point)) / h for side in sides)
                if abs(left + right) < 1e-2 * (abs(left) + abs(right)):
                    sloped += 1
                    np.testing.assert_allclose(slope, 0.5 * (right - left), rtol=2e-2, atol=1e-4)
    assert judged > 20
    assert sloped > 15
    assert n_assets == 2 or empty > 0, "an edge of three assets has decisions that no belief explains"


def scanned(here: Ground, number: int, scan: Array, point: Array, belief: Array, optimal: float) -> tuple[Array, Array]:
    """Distances (infinite where no belief explains the decision) and regrets along an edge."""
    actions = np.array([action_at(here, number, v) for v in scan])
    sets = make_candidates(here.problem, actions).sets
    distances = np.where(sets.dimension >= 0, sets.distances(point), np.inf)
    return distances, here.problem.state_costs(actions) @ belief - optimal


@SIGNS
@pytest.mark.parametrize("at_price", [True, False], ids=["price", "limit"])
@pytest.mark.parametrize(("n_assets", "spread"), EDGES)
def test_a_climb_along_an_edge_reaches_the_top_of_a_dense_scan(
    n_assets: int, spread: bool, at_price: bool, sign: float
) -> None:
    """Begun at the scan's best place, or beside it, the climb ends no lower; from anywhere, not below its start."""
    tried, ended = 0, 0
    for seed in range(6 if n_assets == 2 else 20):
        here, rng = ground(seed, n_assets, spread, 12), np.random.default_rng([seed, 5])
        for number in here.faces(1):
            belief = rng.dirichlet(np.ones(3))
            point = belief if sign > 0 else rng.dirichlet(np.ones(3))
            optimal = enumeration.value(here.market, belief)[0]
            spot = here_of(belief, point, sign, optimal)
            scan = places(here, number, 400)
            distances, regrets = scanned(here, number, scan, point, belief, optimal)
            explained = np.isfinite(distances)
            if not explained.any():
                continue
            limit = np.inf if at_price else float(np.quantile(regrets[explained], rng.uniform(0.3, 0.9)))
            price = float(rng.uniform(0.0, 2.0) / max(np.median(regrets[explained]), 1e-12))
            worth = np.where(explained, sign * distances - (price * regrets if at_price else 0.0), -np.inf)
            worth[regrets > limit] = -np.inf
            top = int(worth.argmax())
            for begin in (top, *rng.choice(np.flatnonzero(np.isfinite(worth)), 3)):
                tried += 1
                aim = (limit, price)
                ok, v, regret, privacy, _ = climbed_line(
                    ground_of(here.atlas.arena), number, RULES, spot, aim, scan[begin]
                )
                assert ok
                ended += 1
                assert regret <= limit * (1 + 1e-12)
                action = action_at(here, number, v)
                np.testing.assert_allclose(
                    privacy, sign * consistent_beliefs(here.problem, action).distance(point), atol=1e-7
                )
                np.testing.assert_allclose(
                    regret, max(here.problem.state_costs(action) @ belief - optimal, 0), atol=1e-12
                )
                reached = privacy - price * regret if at_price else privacy
                assert reached >= worth[begin] - 1e-8
                if begin == top:
                    assert reached >= worth[top] - 1e-8
    assert ended > 10


@pytest.mark.parametrize("n_assets", [2, 3, 5])
def test_a_polygons_distance_is_that_of_the_consistent_beliefs(n_assets: int) -> None:
    inside, outside = 0, 0
    for seed in range(16):
        here, rng = ground(seed, n_assets, spread=False), np.random.default_rng(seed)
        for number in here.faces(0):
            alone = np.eye(n_assets)[np.flatnonzero(here.face(number).held)[0]]
            seen = consistent_beliefs(here.problem, alone)
            assert not seen.is_empty
            for point in (*rng.dirichlet(np.full(3, 0.6), 12), *np.eye(3), seen.center()):
                distance = from_polygon(ground_of(here.atlas.arena), number, RULES, plane_point(point))
                np.testing.assert_allclose(distance, seen.distance(point), atol=1e-9)
                inside += distance == 0.0
                outside += distance > 1e-6
            assert from_polygon(ground_of(here.atlas.arena), number, RULES, plane_point(seen.center())) == 0.0
    assert inside > 20
    assert outside > 20
