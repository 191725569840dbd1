"""Decoys on the seams of the plane of beliefs, where the decision changes its face: oracles by enumeration."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from inscrutable import (
    MarkowitzProblem,
    MaximalObfuscation,
    Polyhedron,
    ProbabilisticDecisionMaker,
    consistent_beliefs,
    decoy_grid,
    long_short,
    max_weights,
)
from inscrutable.decision_makers.candidates import make_candidates
from inscrutable.decision_makers.decoys import decided_by
from inscrutable.decision_makers.search import plane as plane_module
from inscrutable.decision_makers.search import seams
from inscrutable.decision_makers.search.atlas import Atlas, atlas_of
from inscrutable.decision_makers.search.plane import make_plane, plane_of
from inscrutable.decision_makers.search.seams import seam_decoys
from inscrutable.geometry import simplex_grid
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.kernels.lottery_polish import POLISHED
from oracles import enumeration, markets
from strategies import belief_problem
from test_three_lotteries import envelope

Array = NDArray[np.float64]

BASIS = sum_zero_basis(3)
MIN_SLACK = 1e-4
STEP = 1e-6
CASES = [(seed, n_assets, strength) for seed in range(3) for n_assets in (3, 4) for strength in (0.3, 2.0)]


def drawn_market(seed: int, n_assets: int, strength: float = 1.0) -> markets.Market:
    market = markets.random_market(np.random.default_rng([23, seed, n_assets]), 3, n_assets)
    return market._replace(means=market.means * strength)


class Side(NamedTuple):
    """Which assets a decoy's decision holds, and whether it holds all of these by enough."""

    held: tuple[bool, ...]
    admissible: bool


def side_of(market: markets.Market, decoy: Array) -> Side:
    action = enumeration.value(market, decoy)[1]
    held = action > 1e-11
    return Side(tuple(bool(h) for h in held), bool(action[held].min() >= MIN_SLACK * (1 - 1e-9)))


def triangulated(points: Array) -> set[tuple[int, int]]:
    """Edges of the triangles whose circle holds no other point."""
    edges: set[tuple[int, int]] = set()
    for corners in combinations(range(len(points)), 3):
        a, b, c = points[list(corners)]
        system = 2 * np.array([b - a, c - a])
        if abs(np.linalg.det(system)) < 1e-9:
            continue
        centre = np.linalg.solve(system, [b @ b - a @ a, c @ c - a @ a])
        if (np.linalg.norm(points - centre, axis=1) > np.linalg.norm(a - centre) - 1e-12).all():
            edges |= set(combinations(corners, 2))
    return edges


def changes(decoys: Array, sides: list[Side]) -> list[tuple[int, int]]:
    """Edges (near, far) along which the face changes, or whose far end is not admissible: near's is."""
    found = []
    for edge in triangulated(decoys @ BASIS):
        found += [(i, j) for i, j in (edge, edge[::-1]) if sides[i].admissible and sides[i] != sides[j]]
    return found


def few_decoys(seed: int) -> Array:
    return np.vstack([np.eye(3), np.random.default_rng(seed).dirichlet(np.ones(3), 9)])


def expect_last_of_their_sides(found: Array, decoys: Array, side: Callable[[Array], Side]) -> None:
    sides = [side(decoy) for decoy in decoys]
    expected = changes(decoys, sides)
    assert len(found) == len(expected)
    matched = np.zeros(len(found), dtype=bool)
    for i, j in expected:
        near, along, own = decoys[i], decoys[j] - decoys[i], sides[i]
        share = (found - near) @ along / (along @ along)
        off = np.linalg.norm(found - near - share[:, None] * along, axis=1)
        on_edge = np.flatnonzero((off < 1e-9) & (share > -1e-12) & (share < 1 + 1e-12))
        step = min(STEP / np.linalg.norm(along), 1.0)
        last = [
            f
            for f in on_edge
            if side(found[f]) == own and (share[f] + step >= 1 or side(near + (share[f] + step) * along) != own)
        ]
        assert last, "no decoy is the last of this side"
        matched[last] = True
    assert matched.all(), "a decoy on no edge where the face changes"


@pytest.mark.parametrize(("seed", "n_assets", "strength"), CASES)
def test_a_seam_decoy_is_the_last_of_its_side(seed: int, n_assets: int, strength: float) -> None:
    market, decoys = drawn_market(seed, n_assets, strength), few_decoys(seed)
    expect_last_of_their_sides(seam_decoys(MarkowitzProblem(*market), decoys), decoys, partial(side_of, market))


def side_among_rows(problem: MarkowitzProblem, decoy: Array) -> Side:
    """Which rows are tight at the best decision of all that are best with some rows tight, by enumeration."""
    region, n = problem.constraints, problem.n_actions
    hessian, linear = np.tensordot(decoy, problem.hessians, axes=1), decoy @ problem.linear
    best, lowest = np.zeros(n), np.inf
    for count in range(n):
        for rows in combinations(range(len(region.b_ub)), count):
            normals = np.vstack([region.A_ub[list(rows)], region.A_eq])
            held = len(normals)
            if np.linalg.matrix_rank(normals) < held:
                continue
            matrix = np.block([[hessian, normals.T], [normals, np.zeros((held, held))]])
            action = np.linalg.solve(matrix, np.concatenate([-linear, region.b_ub[list(rows)], region.b_eq]))[:n]
            cost = 0.5 * action @ hessian @ action + linear @ action
            if (region.A_ub @ action <= region.b_ub + 1e-10).all() and cost < lowest - 1e-14:
                best, lowest = action, cost
    slack = region.b_ub - region.A_ub @ best
    tight = slack < MIN_SLACK
    return Side(tuple(bool(t) for t in tight), bool((slack[tight] < 1e-10).all()))


def long_short_market(seed: int, kind: str) -> MarkowitzProblem:
    market = drawn_market(seed, 3, 2.0)
    region = long_short(3, gross=1.4)
    if kind == "capped":
        region = region & max_weights(3, 0.6)
    if kind == "a row that others imply":
        region = region & Polyhedron(A_ub=[region.A_ub[0] + region.A_ub[1]], b_ub=[region.b_ub[0] + region.b_ub[1]])
    return MarkowitzProblem(*market, region)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["plain", "capped", "a row that others imply"])
def test_a_seam_decoy_is_the_last_of_its_side_among_general_rows(seed: int, kind: str) -> None:
    problem, decoys = long_short_market(seed, kind), few_decoys(seed)
    found = seam_decoys(problem, decoys)
    assert len(found)
    expect_last_of_their_sides(found, decoys, partial(side_among_rows, problem))


def test_seams_of_general_rows_are_the_same_without_the_faces_decisions(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, grid = long_short_market(1, "a row that others imply"), simplex_grid(3, 16)
    quick = seam_decoys(problem, grid)
    monkeypatch.setattr(seams, "_along_faces", lambda problem, near, far, side: (far, near))
    slow = seam_decoys(problem, grid)
    assert len(quick) == len(slow)
    np.testing.assert_allclose(quick, slow, atol=1e-8)


def test_states_of_one_market_with_a_duplicated_asset_have_their_seams(monkeypatch: pytest.MonkeyPatch) -> None:
    """A face without a unique decision is halved by whole solutions."""
    market = drawn_market(0, 3, 2.0)
    twice = [0, 1, 2, 2]
    region = long_short(4, gross=1.4)
    problem = MarkowitzProblem(market.means[:, twice], market.covariances[:, twice][:, :, twice], 1.0, region)
    found = seam_decoys(problem, few_decoys(0))
    assert len(found)
    assert problem.constraints.is_admissible(problem.solve(found)).all()


@pytest.mark.parametrize(("seed", "n_assets", "strength"), CASES)
def test_the_decision_of_a_seam_decoy_is_one_that_its_side_explains(seed: int, n_assets: int, strength: float) -> None:
    """The decision that is played is the face's: it must be the decoy's own, and an observer must explain it."""
    market = drawn_market(seed, n_assets, strength)
    problem = MarkowitzProblem(*market)
    found = seam_decoys(problem, simplex_grid(3, 16))
    for decoy in found:
        side, action = side_of(market, decoy), enumeration.value(market, decoy)[1]
        assert side.admissible
        np.testing.assert_allclose(problem.solve(decoy), action, atol=1e-12)
        played = np.where(action > 1e-11, action, 0.0)
        assert problem.constraints.is_admissible(played)
        seen = consistent_beliefs(problem, played)
        assert not seen.is_empty
        assert seen.distance(decoy) < 1e-7


@pytest.mark.parametrize(("seed", "n_assets", "strength"), CASES)
def test_the_seams_of_a_plane_lie_on_the_faces_they_are_said_to(seed: int, n_assets: int, strength: float) -> None:
    market = drawn_market(seed, n_assets, strength)
    problem = MarkowitzProblem(*market)
    candidates = decoy_grid(problem, 16)
    atlas = Atlas(problem, candidates)
    plane = make_plane(atlas)
    assert plane is not None
    assert plane.face.size % 32 == 0
    costs = plane.slots.swapaxes(1, 2).reshape(-1, 8)[:, :3]
    slots = np.flatnonzero(plane.name == POLISHED)
    for slot in slots:
        decoy = 1 / 3 + BASIS @ plane.decoys[:, slot]
        action = enumeration.value(market, decoy)[1]
        assert np.array_equal(action <= 1e-8, atlas.patterns[plane.face[slot]][:n_assets])
        np.testing.assert_allclose(costs[slot], markets.costs(market, action), atol=1e-9)
    ours = np.flatnonzero(plane.name >= 0)
    points = np.unique(plane.name[ours])
    assert set(points) | set(plane.polygons) == set(range(len(atlas))), "every decision of the atlas has its place"
    np.testing.assert_allclose(costs[ours], atlas.table.costs[plane.name[ours]], atol=0.0)


def test_no_seams_where_there_is_one_face() -> None:
    problem = belief_problem(3, min_slack=1e-4)
    assert seam_decoys(problem, simplex_grid(3, 12)).shape == (0, 3)
    plane = make_plane(Atlas(problem, decoy_grid(problem, 12)))
    assert plane is not None
    assert (plane.name >= 0).all()


def test_no_seams_where_nothing_can_be_triangulated() -> None:
    problem = MarkowitzProblem(*drawn_market(0, 3, 2.0))
    edge = np.column_stack([np.linspace(0, 1, 30), 1 - np.linspace(0, 1, 30), np.zeros(30)])
    assert len(seam_decoys(problem, simplex_grid(3, 12)))
    for decoys in (np.eye(3)[:1], np.eye(3)[:2], edge, np.repeat(np.eye(3)[:1], 5, axis=0)):
        assert seam_decoys(problem, decoys).shape == (0, 3)


def test_decoys_may_come_twice_and_in_any_order() -> None:
    problem, grid = MarkowitzProblem(*drawn_market(1, 4)), few_decoys(1)
    once = seam_decoys(problem, grid)
    assert len(once)
    np.testing.assert_allclose(seam_decoys(problem, grid[::-1].copy()), once, atol=1e-7)
    np.testing.assert_allclose(seam_decoys(problem, np.vstack([grid, grid])), once, atol=1e-7)


def test_many_decoys_have_no_seams(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, grid = MarkowitzProblem(*drawn_market(0, 3, 2.0)), simplex_grid(3, 12)
    monkeypatch.setattr(seams, "_MOST_EDGES", 3)
    assert seam_decoys(problem, grid).shape == (0, 3)
    monkeypatch.undo()
    monkeypatch.setattr(seams, "_MOST_DECOYS", len(grid) - 1)
    assert seam_decoys(problem, grid).shape == (0, 3)
    monkeypatch.undo()
    assert len(seam_decoys(problem, grid))


def test_no_decoys_no_seams_and_no_plane_but_for_three_states() -> None:
    problem = MarkowitzProblem(*drawn_market(0, 3))
    plain = make_candidates(problem, problem.solve(simplex_grid(3, 10)))
    plane = make_plane(Atlas(problem, plain))
    assert plane is not None
    assert (plane.name >= 0).all()
    four = belief_problem(4, min_slack=1e-4)
    assert make_plane(Atlas(four, decoy_grid(four, 4))) is None


def test_a_plane_is_made_once_and_kept_with_its_candidates(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = MarkowitzProblem(*drawn_market(0, 3))
    candidates = decoy_grid(problem, 10)
    made = plane_of(atlas_of(problem, candidates))
    monkeypatch.setattr(plane_module, "make_plane", None)
    assert plane_of(atlas_of(problem, candidates)) is made


def test_seams_make_concentrated_portfolios_more_private(monkeypatch: pytest.MonkeyPatch) -> None:
    """A coarse grid has no decoy near the last decision before an asset is dropped."""
    beliefs = np.random.default_rng(3).dirichlet(np.ones(3), 60)
    gains = []
    for seed in range(6):
        problem = MarkowitzProblem(*drawn_market(seed, 6, 2.0))
        with_seams = ProbabilisticDecisionMaker(problem, MaximalObfuscation(), 0.05, candidates=decoy_grid(problem, 14))
        ours = with_seams.decide_many(beliefs).expected_privacy
        monkeypatch.setattr(plane_module, "seam_decoys", lambda problem, decoys: np.empty((0, 3)))
        without = ProbabilisticDecisionMaker(problem, MaximalObfuscation(), 0.05, candidates=decoy_grid(problem, 14))
        theirs = without.decide_many(beliefs).expected_privacy
        monkeypatch.undo()
        gains.append(float(np.max(ours - theirs)))
    # The best single decision, which every lottery starts from, hides the loss from most beliefs, not from all.
    assert max(gains) > 1e-2


@pytest.mark.parametrize("seed", range(4))
def test_a_lottery_is_no_worse_than_candidates_and_seams_together(seed: int) -> None:
    problem = MarkowitzProblem(*drawn_market(seed, 5, 2.0))
    beliefs = np.random.default_rng(seed).dirichlet(np.ones(3), 30)
    candidates = decoy_grid(problem, 14)
    maker = ProbabilisticDecisionMaker(problem, MaximalObfuscation(), 0.05, candidates=candidates)
    found = seam_decoys(problem, simplex_grid(3, 14))
    assert len(found)
    held = {tight.tobytes() for tight in Atlas(problem, candidates).patterns}
    known = [problem.constraints.tight_rows(problem.solve(decoy)).tobytes() in held for decoy in found]
    both = candidates.joined(decided_by(problem, found[known]))
    kept = both.usable & (both.sets.dimension >= 0)
    costs = problem.optimal_cost(beliefs)
    mixed = maker.decide_many(beliefs)
    for t, belief in enumerate(beliefs):
        regrets = np.maximum(both.state_costs[kept] @ belief - costs[t], 0.0)
        best = envelope(regrets, both.sets.distances(belief)[kept], 0.05 * abs(costs[t]))
        assert mixed.expected_privacy[t] >= best - 1e-6
