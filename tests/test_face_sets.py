"""The best decision on a face whose consistent sets are larger than points."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import NamedTuple, cast

import numba
import numpy as np
import pytest

from inscrutable.adversaries import consistent_sets
from inscrutable.decision_makers.search.partition import FaceProgramme, face_programme
from inscrutable.decision_makers.search.region_search import writable_basis
from inscrutable.kernels import face_ascent
from inscrutable.kernels.climb import Aim
from inscrutable.kernels.set_distance import NO_ROW, distance_room, nearest_belief
from inscrutable.problems import MarkowitzProblem
from inscrutable.validation import Array
from sizes import audited, some


def as_written() -> Callable[..., None]:
    """The kernel in Python, with the two that it calls: to compile it takes seconds, which it does in `make audit`."""
    plain = face_ascent.set_distance_model.py_func
    if audited():
        return cast(Callable[..., None], numba.njit(error_model="numpy")(plain))
    called = {name: getattr(each, "py_func", each) for name, each in vars(face_ascent).items()}
    return FunctionType(plain.__code__, called)


set_distance_model = as_written()


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
        aim = Aim(belief, point, sign, optimal, limit, 0.0, limit)
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


@pytest.mark.parametrize(("n_states", "n_assets", "free"), some([(4, 3, 2), (3, 3, 1), (5, 4, 2), (5, 4, 3)], 2))
def test_slope_and_curvature_of_a_sets_distance(n_states: int, n_assets: int, free: int) -> None:
    basis, checked = writable_basis(n_states), 0
    for case in cases(n_states, n_assets, free, 8):
        face, size = case.face, free + n_states - 1
        rows = np.concatenate([case.face.curves.transpose(1, 0, 2)[:free] / face.scale, face.rows])
        room, nearest = distance_room(n_states, free, len(face.rows)), np.empty(n_states)

        def half_square(place: Array) -> float:
            w = np.append(place, 1.0)
            return 0.5 * nearest_belief(face.arrays, w, case.aim.point, basis, NO_ROW, nearest, room) ** 2  # noqa: B023

        def model(place: Array) -> tuple[Array, Array, np.ndarray]:
            half_square(place)
            active = room.active[: free + face.n_set_rows].copy()  # noqa: B023
            slope, hessian = np.zeros(size), np.zeros((size, size))  # noqa: B023
            w = np.append(place, 1.0)
            set_distance_model(rows, case.aim.point, basis, w, nearest, active, slope, hessian)  # noqa: B023
            return slope[:free], hessian[:free, :free], active

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
