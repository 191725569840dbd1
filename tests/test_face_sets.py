"""The best decision on a face whose consistent sets are larger than points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from inscrutable.adversaries import consistent_sets
from inscrutable.decision_makers.search.face_search import rules_for, within
from inscrutable.decision_makers.search.faces import FaceProgramme, face_programme
from inscrutable.decision_makers.search.set_faces import SetFaceSearch
from inscrutable.kernels.climb import Aim
from inscrutable.kernels.face_ascent import set_distance_model
from inscrutable.kernels.set_distance import nearest_belief
from inscrutable.problems import MarkowitzProblem
from inscrutable.validation import Array


class Case(NamedTuple):
    """A face with the decision of some decoy on it."""

    problem: MarkowitzProblem
    face: FaceProgramme
    aim: Aim
    decoy: Array
    w: Array

    def regret(self, actions: Array) -> Array:
        return np.asarray(self.problem.state_costs(actions) @ self.aim.belief - self.aim.optimal_cost)

    def judged(self, actions: Array) -> Array:
        """Distance of each decision's set by the adversary's own arithmetic; −∞ where not allowed or not explained."""
        allowed = self.problem.constraints.is_admissible(actions) & (self.regret(actions) <= self.aim.limit)
        values = np.full(len(actions), -np.inf)
        if allowed.any():
            distance = consistent_sets(self.problem, actions[allowed]).distances(self.aim.point)
            values[allowed] = np.where(np.isfinite(distance), self.aim.sign * distance, -np.inf)
        return values

    def search(self, w: Array | None = None) -> tuple[float, Array, Array]:
        place, nearest = (self.w if w is None else w).copy(), self.decoy.copy()
        face = self.face
        search = SetFaceSearch(face, within(self.aim), rules_for(nearest.size))
        value = search.improve(place, nearest, 30)
        return value, face.action(search.place[:-1]), search.nearest


def market(n_states: int, n_assets: int, rng: np.random.Generator) -> MarkowitzProblem:
    factors = rng.normal(size=(n_states, n_assets, n_assets + 2)) * 0.2
    covariances = factors @ factors.transpose(0, 2, 1) / n_assets + 0.01 * np.eye(n_assets)
    return MarkowitzProblem(rng.normal(0.05, 0.1, (n_states, n_assets)), covariances, 2.0)


def cases(n_states: int, n_assets: int, free: int, count: int, sign: float = 1.0, seed: int = 0) -> list[Case]:
    """Faces of random markets, with an affordable decision each."""
    rng = np.random.default_rng(seed)
    found: list[Case] = []
    while len(found) < count:
        problem = market(n_states, n_assets, rng)
        belief = rng.dirichlet(np.ones(n_states))
        optimal = float(problem.optimal_cost(belief))
        limit = float(rng.choice([0.01, 0.1, 0.3])) * abs(optimal)
        point = belief if sign > 0 else rng.dirichlet(np.ones(n_states))
        decoys = belief + rng.uniform(size=(20, 1)) * (rng.dirichlet(np.ones(n_states), 20) - belief)
        aim = Aim(belief, point, sign, optimal, limit, 0.0)
        for decoy, action in zip(decoys, problem.solve(decoys), strict=True):
            tight = problem.constraints.tight_rows(action)
            if (~tight).sum() - 1 != free:
                continue
            face = face_programme(problem, tight)
            case = Case(problem, face, aim, decoy, np.append(face.span.T @ (action - face.origin), 1.0))
            if case.judged(action[None])[0] > -np.inf:
                found.append(case)
                break
    return found


def scattered(case: Case, rng: np.random.Generator, count: int) -> Array:
    """Decisions of the face spread over what the budget allows, a third of them on its edge."""
    k = len(case.face.place)
    hessian = np.einsum("x,xab->ab", case.aim.belief, case.face.curves)
    centre = -np.linalg.solve(hessian[:k, :k], hessian[:k, k])
    left = case.aim.limit - case.regret(case.face.action(centre)[None])[0]
    if left <= 0:
        return np.empty((0, case.problem.n_actions))
    axes = np.linalg.inv(np.linalg.cholesky(hessian[:k, :k])) * np.sqrt(2.0 * left)
    ball = rng.normal(size=(count, k))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    ball *= np.minimum(rng.uniform(size=(count, 1)) * 1.5, 1.0 - 1e-9) ** (1.0 / k)
    return np.asarray(case.face.origin + (centre + ball @ axes) @ case.face.span.T)


@pytest.mark.parametrize(("n_states", "n_assets", "free"), [(3, 3, 1), (4, 3, 2), (5, 4, 2), (5, 4, 3)])
def test_slope_and_curvature_of_a_sets_distance(n_states: int, n_assets: int, free: int) -> None:
    rules, checked = rules_for(n_states), 0
    for case in cases(n_states, n_assets, free, 8):
        face, size = case.face, free + n_states - 1
        rows = np.concatenate([case.face.curves.transpose(1, 0, 2)[:free] / face.scale, face.rows])
        active, nearest = np.zeros(free + face.n_set_rows, dtype=np.bool_), np.empty(n_states)

        def half_square(place: Array) -> float:
            w = np.append(place, 1.0)
            set_rows = face.rows[: face.n_set_rows]  # noqa: B023
            return (
                0.5 * nearest_belief(face.curves, set_rows, face.scale, w, case.aim.point, rules, nearest, active) ** 2  # noqa: B023
            )

        def model(place: Array) -> tuple[Array, Array, np.ndarray]:
            half_square(place)
            slope, hessian = np.zeros(size), np.zeros((size, size))  # noqa: B023
            w = np.append(place, 1.0)
            set_distance_model(rows, case.aim.point, rules.basis, w, nearest, active, slope, hessian)  # noqa: B023
            return slope[:free], hessian[:free, :free], active.copy()  # noqa: B023

        place = case.w[:-1]
        slope, hessian, held = model(place)
        ends = [(place + 1e-6 * axis, place - 1e-6 * axis) for axis in np.eye(free)]
        if any((model(end)[2] != held).any() for pair in ends for end in pair):
            continue  # a kink of the curvature
        checked += 1
        expected = [(half_square(a) - half_square(b)) / 2e-6 for a, b in ends]
        assert slope == pytest.approx(np.array(expected), rel=1e-5, abs=1e-7)
        bends = np.array([(model(a)[0] - model(b)[0]) / 2e-6 for a, b in ends])
        assert hessian == pytest.approx(bends, rel=1e-5, abs=1e-5 * np.abs(bends).max())
    assert checked >= 4


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("n_states", "n_assets", "free"), [(3, 3, 1), (4, 3, 2), (5, 4, 2), (5, 4, 3), (4, 3, 0)])
def test_a_result_is_allowed_worth_what_it_says_and_no_worse_than_its_start(
    n_states: int, n_assets: int, free: int, sign: float
) -> None:
    for case in cases(n_states, n_assets, free, 8, sign):
        value, action, nearest = case.search()
        assert case.judged(action[None])[0] == pytest.approx(value, abs=1e-8)
        assert np.linalg.norm(nearest - case.aim.point) == pytest.approx(abs(value), abs=1e-9)
        start = case.face.action(case.w[:-1])
        assert value >= case.judged(start[None])[0] - 1e-6


@pytest.mark.parametrize(("n_states", "n_assets", "free"), [(4, 3, 2), (5, 3, 2), (5, 4, 3)])
def test_no_scattered_decision_is_better(n_states: int, n_assets: int, free: int) -> None:
    rng = np.random.default_rng(1)
    behind = []
    for case in cases(n_states, n_assets, free, 12):
        actions = scattered(case, rng, 2000)
        values = case.judged(actions) if len(actions) else np.array([-np.inf])
        behind.append(values.max() - case.search()[0])
        if np.isfinite(values.max()):
            # Begun at the best of them, nothing of it is lost.
            place = case.face.span.T @ (actions[values.argmax()] - case.face.origin)
            assert case.search(np.append(place, 1.0))[0] >= values.max() - 1e-6
    assert np.mean(np.array(behind) <= 1e-3) >= 0.8
    assert np.mean(np.array(behind) <= 0.0) >= 0.5


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_free_coordinate_is_searched_as_well_as_by_a_fine_scan(sign: float) -> None:
    for case in cases(3, 2, 1, 6, sign):
        low, high = (case.face.action(scale * np.ones(1)) for scale in (-2.0, 2.0))
        share = np.linspace(0.0, 1.0, 20_001)[:, None]
        values = case.judged(low + share * (high - low))
        assert case.search()[0] >= values.max() - 1e-7


@pytest.mark.parametrize("far", [0.3, 3.0, 100.0])
def test_a_start_that_is_not_allowed_is_moved(far: float) -> None:
    rng = np.random.default_rng(3)
    for case in cases(4, 3, 2, 8):
        w = case.w.copy()
        w[:-1] += far * rng.normal(size=2)
        value, action, _ = case.search(w)
        assert value > -np.inf
        assert case.judged(action[None])[0] == pytest.approx(value, abs=1e-8)


def test_nothing_is_found_where_the_whole_face_costs_too_much() -> None:
    for case in cases(4, 3, 1, 8):
        hessian = np.einsum("x,xab->ab", case.aim.belief, case.face.curves)
        least = case.face.action(-hessian[:1, 1] / hessian[0, 0])
        if case.regret(least[None])[0] > 1e-9:
            poor = case._replace(aim=case.aim._replace(limit=0.5 * case.regret(least[None])[0]))
            assert poor.search()[0] == -np.inf


def test_a_price_is_weighed_against_distance() -> None:
    for case in cases(4, 3, 2, 8):
        dear = case._replace(aim=case.aim._replace(limit=np.inf, price=2.0 / case.aim.limit))
        value, action, _ = dear.search()
        distance = consistent_sets(case.problem, action[None]).distances(case.aim.point)[0]
        regret = float(case.regret(action[None])[0])
        assert value == pytest.approx(distance - 2.0 / case.aim.limit * regret, abs=1e-8)
        actions = scattered(case, np.random.default_rng(4), 500)
        if len(actions):
            worth = case.judged(actions) - 2.0 / case.aim.limit * case.regret(actions)
            assert dear._replace(w=case.w).search()[0] >= worth.max() - 0.05
