"""Decisions as functions of the decoy on one face, their derivatives, and the climb to the best of them."""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import minimize

from inscrutable import (
    Budget,
    DesiredObfuscation,
    Polyhedron,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    box,
    simplex,
    tolerances,
)
from inscrutable.decision_makers.search.partition import FaceProgramme, face_programme
from inscrutable.decision_makers.search.region_search import writable_basis
from inscrutable.kernels import climb as climbing
from inscrutable.kernels import faces
from inscrutable.kernels.calls import interpreted
from inscrutable.kernels.climb import Aim
from sizes import audited, instances, some
from strategies import SEEDS

Array = NDArray[np.float64]


def plain(kernel: Any) -> Any:
    """A function that Python may call: these kernels are linked into others alone. Interpreted it has the same digits."""
    function = interpreted(kernel, {})

    def call(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return function(*arguments)

    return call


climb, solve_kkt = plain(climbing.climb), plain(faces.solve_kkt)
cost_at, row_value, row_slope = map(plain, (faces.cost_at, faces.row_value, faces.row_slope))
regret_slope, add_regret_curvature = map(plain, (faces.regret_slope, faces.add_regret_curvature))
add_row_curvature = plain(faces.add_row_curvature)

N_CASES = instances(5, least=2)
TINY_STEP = 1e-30  # of a complex step: no difference is formed, so nothing cancels


def region_of(kind: str, size: int, rng: np.random.Generator) -> Polyhedron:
    """The simplex; a fully invested long-short box with caps; a box with rows across, like a limit on turnover."""
    if kind == "simplex":
        return simplex(size)
    cap = 1.6 / size
    invested = Polyhedron(A_eq=np.ones((1, size)), b_eq=[1.0])
    if kind == "box":
        return box(np.full(size, -0.2), np.full(size, cap)) & invested
    before = rng.dirichlet(np.ones(size))
    sides = np.array(list(product([-1.0, 1.0], repeat=min(size, 3))))
    turnover = np.zeros((len(sides), size))
    turnover[:, : sides.shape[1]] = sides
    group = np.append(np.ones(size - 1), 0.0)[None]
    return box(np.full(size, -0.5), np.full(size, 1.0)) & Polyhedron(
        np.vstack([turnover, group]), np.append(turnover @ before + 0.4, 0.9), np.ones((1, size)), [1.0]
    )


def quadratic(n_states: int, region: Polyhedron, rng: np.random.Generator) -> QuadraticProblem:
    size = region.n_actions
    factors = rng.normal(size=(n_states, size, size + 2)) * 0.5
    hessians = factors @ factors.transpose(0, 2, 1) / size + 0.05 * np.eye(size)
    return QuadraticProblem(hessians, rng.normal(0, 0.15, (n_states, size)), np.ones(n_states), constraints=region)


def placed(face: FaceProgramme, decoys: Array) -> Array:
    """Coordinates w (…,k+1) of the decision that minimises Σ y_i ½w'C_i w, by a general solver; complex decoys too."""
    k = face.span.shape[1]
    hessian = np.einsum("...i,iab->...ab", decoys, face.curves[:, :k, :k])
    linear = np.einsum("...i,ia->...a", decoys, face.curves[:, :k, k])
    place = np.linalg.solve(hessian, -linear[..., None])[..., 0]
    return np.concatenate([place, np.ones((*place.shape[:-1], 1))], axis=-1)


def regrets(face: FaceProgramme, belief: Array, optimal_cost: float, decoys: Array) -> Array:
    w = placed(face, decoys)
    costs = 0.5 * np.einsum("iab,...a,...b->...i", face.curves, w, w)
    return np.asarray(costs @ belief - optimal_cost)


def row_values(face: FaceProgramme, decoys: Array) -> Array:
    return np.einsum("...i,ria,...a->...r", decoys, face.rows, placed(face, decoys))


def slopes_of(function: Any, y: Array) -> Array:
    """∂f/∂y by complex steps, exact to rounding: shape (X,…)."""
    steps = 1j * TINY_STEP * np.eye(y.size)
    return np.array([np.imag(function(y + step)) / TINY_STEP for step in steps])


def bends_of(function: Any, y: Array, width: float = 1e-5) -> Array:
    """∂²f/∂y² by central differences of those: shape (X,X,…)."""
    steps = width * np.eye(y.size)
    return np.array([(slopes_of(function, y + step) - slopes_of(function, y - step)) / (2 * width) for step in steps])


class Settled(NamedTuple):
    w: Array
    factor: Array
    gradients: Array
    slopes: Array


def settled(face: FaceProgramme, y: Array) -> Settled:
    k, n_states = face.span.shape[1], y.size
    room = Settled(np.empty(k + 1), np.empty((k, k)), np.empty((n_states, k)), np.empty((n_states, k)))
    assert solve_kkt(face.curves, y, 1e-10, *room)
    return room


# --- the functions of a face and their derivatives ----------------------------------------------------------------------


def drawn_face(kind: str, n_states: int, size: int, rng: np.random.Generator) -> tuple[FaceProgramme, Array, float]:
    """The face of some optimal decision with a belief under which it is judged, and that belief's optimal cost."""
    problem = quadratic(n_states, region_of(kind, size, rng), rng)
    decoy, belief = rng.dirichlet(np.ones(n_states), 2)
    face = face_programme(problem, problem.constraints.tight_rows(problem.solve(decoy)))
    return face, belief, float(problem.optimal_cost(belief))


@settings(max_examples=instances(15))
@given(SEEDS, st.sampled_from(["simplex", "box", "general"]), st.integers(1, 5), st.integers(2, 7))
def test_slopes_and_curvatures(seed: int, kind: str, n_states: int, size: int) -> None:
    """∂ρ/∂y, ∂²ρ/∂y², ∂f_r/∂y and ∂²f_r/∂y² against complex steps, off the simplex of beliefs as well."""
    rng = np.random.default_rng(seed)
    face, belief, optimal_cost = drawn_face(kind, n_states, size, rng)
    y = rng.uniform(0.2, 1.0, n_states)
    w, factor, gradients, slopes = settled(face, y)
    k = face.span.shape[1]
    np.testing.assert_allclose(w, placed(face, y), atol=1e-10)
    regret = cost_at(face.curves, belief, w) - optimal_cost
    np.testing.assert_allclose(regret, regrets(face, belief, optimal_cost, y), atol=1e-12)

    def in_regret(z: Array) -> Array:
        return regrets(face, belief, optimal_cost, z)

    found, scratch = np.full(n_states, np.nan), np.full((n_states + 1, k), np.nan)
    regret_slope(belief, gradients, slopes, found)
    expected = slopes_of(in_regret, y)
    np.testing.assert_allclose(found, expected, atol=1e-9 * (1 + np.abs(expected).max()))
    start = rng.normal(size=(n_states, n_states))
    bend = start.copy()
    add_regret_curvature(face.curves, belief, y, gradients, slopes, -1.5, scratch, bend)
    expected = -1.5 * bends_of(in_regret, y)
    np.testing.assert_allclose(bend - start, expected, atol=1e-6 * (1 + np.abs(expected).max()))

    all_slopes, all_bends = slopes_of(lambda z: row_values(face, z), y), bends_of(lambda z: row_values(face, z), y)
    for r, row in enumerate(face.rows):
        np.testing.assert_allclose(row_value(row, y, w), row_values(face, y)[r], atol=1e-10)
        row_slope(row, y, w, slopes, found)
        expected = all_slopes[:, r]
        np.testing.assert_allclose(found, expected, atol=1e-9 * (1 + np.abs(expected).max()))
        bend = start.copy()
        add_row_curvature(face.curves, row, y, factor, slopes, 0.7, scratch, bend)
        expected = 0.7 * all_bends[:, :, r]
        np.testing.assert_allclose(bend - start, expected, atol=1e-6 * (1 + np.abs(expected).max()))


@pytest.mark.parametrize("kind", ["simplex", "box", "general"])
def test_the_drawn_faces_are_not_all_interiors_or_corners(kind: str) -> None:
    """Else the test above would say little: free coordinates, multipliers and slacks all occur."""
    faces = [drawn_face(kind, 3, 6, np.random.default_rng(seed))[0] for seed in range(30)]
    free = [face.span.shape[1] for face in faces]
    assert 0 < np.mean(free) < 5
    assert max(free) >= 3
    assert max(face.tight.sum() for face in faces) >= 2
    assert max(len(face.rows) - face.n_set_rows for face in faces) >= 4
    if kind == "general":
        n_bounds = 12
        assert any(face.tight[n_bounds:].any() for face in faces)


def test_regret_has_no_slope_at_the_true_belief() -> None:
    rng = np.random.default_rng(3)
    face, belief, _ = drawn_face("simplex", 3, 5, rng)
    state = settled(face, belief)
    found = np.empty(3)
    regret_slope(belief, state.gradients, state.slopes, found)
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


def test_copies_of_an_asset_settle_nothing() -> None:
    """Where the Hessian is singular on the face there is no unique decision, and `solve_kkt` says so."""
    problem = QuadraticProblem(np.ones((2, 3, 3)), np.zeros((2, 3)), constraints=simplex(3))
    face = face_programme(problem, np.zeros(3, dtype=bool))
    k = face.span.shape[1]
    room = np.empty(k + 1), np.empty((k, k)), np.empty((2, k)), np.empty((2, k))
    assert not solve_kkt(face.curves, np.array([0.4, 0.6]), 1e-10, *room)


# --- climbs -------------------------------------------------------------------------------------------------------------


class Case(NamedTuple):
    """A face, an aim, and decoys on the face that keep the budget and all rows."""

    problem: QuadraticProblem
    face: FaceProgramme
    aim: Aim
    allowed: Array  # (S,X)

    def loss(self, decoys: Array) -> Array:
        distance = np.linalg.norm(decoys - self.aim.point, axis=-1)
        if self.aim.price == 0.0:
            return -self.aim.sign * distance
        return -self.aim.sign * distance + self.aim.price * self.regret(decoys)

    def regret(self, decoys: Array) -> Array:
        return regrets(self.face, self.aim.belief, self.aim.optimal_cost, decoys)

    def spare(self, decoys: Array) -> Array:
        """The least of all rows, and of the budget in its own unit: negative where something is broken."""
        rows = row_values(self.face, decoys).min(axis=-1)
        if np.isfinite(self.aim.limit):
            rows = np.minimum(rows, 1.0 - self.regret(decoys) / self.aim.limit)
        return rows

    def climb(self, start: Array) -> tuple[float, Array, Array]:
        y, w = start.copy(), np.full(self.face.span.shape[1] + 1, np.nan)
        loss, _ = climb(
            self.face.arrays,
            self.aim._replace(limit=self.aim.limit * (1.0 - tolerances.BUDGET_SAFETY)),
            writable_basis(y.size),
            y,
            w,
        )
        return float(loss), y, w


def cases(kind: str, n_states: int, sign: float, priced: bool, count: int, seed: int = 0) -> list[Case]:
    """Faces with at least X−1 free coordinates on which something is allowed, but not much."""
    rng = np.random.default_rng(seed)
    found: list[Case] = []
    while len(found) < count:
        problem = quadratic(n_states, region_of(kind, int(rng.integers(3, 6)), rng), rng)
        belief, target, decoy = rng.dirichlet(np.ones(n_states), 3)
        cost = float(problem.optimal_cost(belief))
        tight = problem.constraints.tight_rows(problem.solve(belief + rng.uniform(0.2, 0.8) * (decoy - belief)))
        face = face_programme(problem, tight)
        if face.span.shape[1] < n_states - 1:
            continue
        rough = lattice(n_states, 60)
        reach = regrets(face, belief, cost, rough)
        on_face = row_values(face, rough).min(axis=1) >= 0
        if on_face.sum() < 20:
            continue
        limit = np.inf if priced else float(np.quantile(reach[on_face], rng.uniform(0.2, 0.8)))
        price = 0.0
        if priced:
            price = float(rng.uniform(0.2, 3.0) / np.quantile(reach[on_face], 0.9))
        aim = Aim(belief, belief if sign > 0 else target, sign, cost, limit, price, limit)
        case = Case(problem, face, aim, rough)
        allowed = rough[case.spare(rough) > 1e-7]
        if len(allowed) >= 5:
            found.append(case._replace(allowed=allowed))
    return found


def lattice(n_states: int, resolution: int) -> Array:
    ticks = np.array(list(product(range(resolution + 1), repeat=n_states - 1)))
    ticks = ticks[ticks.sum(axis=1) <= resolution]
    return np.column_stack([ticks, resolution - ticks.sum(axis=1)]) / resolution


def brute(case: Case) -> tuple[float, Array]:
    """The least loss over a fine lattice, then over ever finer ones around the best few of its points, or by SLSQP from
    there, and where it lies: lattices lose a corner between two rows, SLSQP a kink."""
    basis = writable_basis(case.aim.belief.size)
    n_states, n = basis.shape
    width = 1.0 / (4000 if n == 1 else 300 if audited() else 100)
    points = lattice(n_states, round(1.0 / width))
    around = np.array(list(product(np.linspace(-3.0, 3.0, 13), repeat=n))) @ basis.T
    for _ in range(25):
        points = points[points.min(axis=1) >= 0]
        points = points[case.spare(points) >= 0]
        best, chosen = points[np.argsort(case.loss(points), kind="stable")[:400]], list[Array]()
        while len(best) and len(chosen) < 6:
            chosen.append(best[0])
            best = best[np.linalg.norm(best - best[0], axis=1) > 2.0 * width]
        points = np.concatenate([np.array(chosen), *(y + width * around for y in chosen)])
        width *= 0.6
    ends = [end for y in chosen for end in (y, by_slsqp(case, y)) if case.spare(end) >= -1e-9]
    where = min(ends, key=lambda y: float(case.loss(y)))
    return float(case.loss(where)), where


def by_slsqp(case: Case, start: Array) -> Array:
    def rows(y: Array) -> Array:
        spent = case.regret(y) / case.aim.limit if np.isfinite(case.aim.limit) else 0.0
        return np.append(row_values(case.face, y), 1.0 - spent)

    constraints: Any = [{"type": "ineq", "fun": rows}, {"type": "eq", "fun": lambda y: y.sum() - 1.0}]
    options: Any = {"maxiter": 200, "ftol": 1e-14}
    with np.errstate(all="ignore"):
        found = minimize(lambda y: float(case.loss(y)), start, method="SLSQP", constraints=constraints, options=options)
    return np.asarray(found.x) if np.isfinite(found.x).all() else start


CLIMBS = [
    pytest.param(kind, n_states, sign, priced, id=f"{kind}-X{n_states}-{'far' if sign > 0 else 'near'}-{how}")
    for kind, n_states, sign, (priced, how) in product(
        ["simplex", "box", "general"], [2, 3], [1.0, -1.0], [(False, "budget"), (True, "price")]
    )
]


@pytest.mark.parametrize(("kind", "n_states", "sign", "priced"), some(CLIMBS, 5))
def test_climbs_end_inside_and_the_best_is_that_of_brute_force(
    kind: str, n_states: int, sign: float, priced: bool
) -> None:
    rng, checked = np.random.default_rng(5), 0
    for case in cases(kind, n_states, sign, priced, N_CASES):
        order = np.argsort(case.loss(case.allowed))
        starts = np.vstack([case.allowed[order[:6]], case.allowed[rng.integers(0, len(order), 10)]])
        best = np.inf
        for start in starts:
            loss, y, w = case.climb(start)
            assert case.loss(y) <= case.loss(start) + 1e-12
            assert abs(y.sum() - 1.0) < 1e-12
            assert case.spare(y) >= -1e-8
            assert np.isinf(case.aim.limit) or case.regret(y) <= case.aim.limit
            measured = case.loss(y) if priced else -case.aim.sign * 0.5 * case.loss(y) ** 2
            np.testing.assert_allclose(loss, measured, atol=1e-10)
            np.testing.assert_allclose(w, placed(case.face, y), atol=1e-10)
            best = min(best, float(case.loss(y)))
        expected, where = brute(case)
        if priced and np.linalg.norm(where - case.aim.point) < 1e-3:
            continue  # a kink: every lottery knows the target itself
        checked += 1
        np.testing.assert_allclose(best, expected, atol=1e-6)
    assert checked >= (N_CASES + 1) // 2


@pytest.mark.parametrize("share", [0.25, 0.81, 1.0, 1.5])
def test_a_lottery_goes_toward_a_target_and_ends_there(share: float) -> None:
    """With ρ = ‖π−y‖²/4 a budget, a share of the target's regret, brings a decoy √share of the way; lotteries do no better."""
    problem = QuadraticProblem([2.0 * np.eye(3)] * 3, -np.eye(3), constraints=simplex(3))
    belief, target = np.array([0.3, 0.3, 0.4]), np.array([0.1, 0.7, 0.2])
    away = float(np.linalg.norm(target - belief))
    maker = ProbabilisticDecisionMaker(problem, DesiredObfuscation(target), Budget.regret(share * away**2 / 4.0))
    privacy = maker.decide(belief).expected_privacy
    assert privacy == pytest.approx(-away * max(1.0 - np.sqrt(share), 0.0), abs=1e-6)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_many_states_as_slsqp_climbs(sign: float) -> None:
    """X = 4 and 5: from the same starts, the best of the climbs is not below the best of SciPy's by more than 1e-6."""
    rng = np.random.default_rng(8)
    checked = 0
    while checked < instances(6, least=2):
        n_states = 4 + checked % 2
        problem = quadratic(n_states, simplex(7), rng)
        belief, target = rng.dirichlet(np.full(n_states, 3.0), 2)
        cost = float(problem.optimal_cost(belief))
        face = face_programme(problem, problem.constraints.tight_rows(problem.solve(belief)))
        if face.span.shape[1] < n_states - 1 or row_values(face, belief).min() <= 0:
            continue
        draws = belief + rng.uniform(size=(200, 1)) * (rng.dirichlet(np.ones(n_states), 200) - belief)
        limit = float(np.quantile(regrets(face, belief, cost, draws), 0.5))
        case = Case(problem, face, Aim(belief, belief if sign > 0 else target, sign, cost, limit, 0.0, limit), draws)
        allowed = draws[case.spare(draws) > 1e-6]
        if len(allowed) < 10:
            continue
        starts = allowed[np.argsort(case.loss(allowed))[: instances(5, least=2)]]
        own = min(float(case.loss(case.climb(start)[1])) for start in starts)
        ends = [end for start in starts if case.spare(end := by_slsqp(case, start)) >= -1e-8]
        assert own <= min((float(case.loss(end)) for end in ends), default=np.inf) + 1e-6
        checked += 1


@given(SEEDS)
@settings(max_examples=instances(30))
def test_a_budget_that_nothing_on_the_face_keeps(seed: int) -> None:
    """Infinite, the decoy left as it was; and where the start breaks a little, only allowed ends are taken."""
    rng = np.random.default_rng(seed)
    kind, n_states = str(rng.choice(["simplex", "box", "general"])), int(rng.integers(2, 4))
    case = cases(kind, n_states, 1.0, False, 1, seed)[0]
    fine = lattice(n_states, 200)
    fine = fine[row_values(case.face, fine).min(axis=1) >= -1e-3]
    least = float(case.regret(fine).min())
    if least > 1e-3:  # far above what the lattice misses
        broken = case._replace(aim=case.aim._replace(limit=0.2 * least))
        start = case.allowed[0]
        loss, y, _ = broken.climb(start)
        assert loss == np.inf
        assert np.array_equal(y, start)
    outside = rng.dirichlet(np.ones(n_states))
    loss, y, _ = case.climb(outside)
    assert case.spare(y) >= -1e-8 if loss < np.inf else np.array_equal(y, outside)


def test_the_whole_climb_from_the_true_belief_with_a_known_end() -> None:
    """X assets, identity Hessians: u*(y) = c + y/2 and ρ = ‖π−y‖²/4, so the far end lies on a circle around π.

    Toward a target beyond the circle the nearest point is where the segment leaves it.
    """
    problem = QuadraticProblem([2.0 * np.eye(3)] * 3, -np.eye(3), constraints=simplex(3))
    belief, target = np.array([0.3, 0.3, 0.4]), np.array([0.1, 0.8, 0.1])
    face = face_programme(problem, np.zeros(3, dtype=bool))
    cost = float(problem.optimal_cost(belief))
    limit = 0.01
    far = Case(problem, face, Aim(belief, belief, 1.0, cost, limit, 0.0, limit), np.zeros((0, 3)))
    _, y, _ = far.climb(np.array([0.31, 0.3, 0.39]))
    np.testing.assert_allclose(np.linalg.norm(y - belief), 0.2, atol=1e-7)
    near = Case(problem, face, Aim(belief, target, -1.0, cost, limit, 0.0, limit), np.zeros((0, 3)))
    _, y, _ = near.climb(belief)
    away = target - belief
    np.testing.assert_allclose(y, belief + 0.2 * away / np.linalg.norm(away), atol=1e-6)
    priced = Case(problem, face, Aim(belief, belief, 1.0, cost, np.inf, 4.0, np.inf), np.zeros((0, 3)))
    loss, y, _ = priced.climb(np.array([0.35, 0.3, 0.35]))
    np.testing.assert_allclose(np.linalg.norm(y - belief), 0.5, atol=1e-6)  # max d − 4·d²/4
    np.testing.assert_allclose(loss, -0.25, atol=1e-8)
