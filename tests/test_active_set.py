"""The bulk solver against enumeration, the one-by-one solver, itself alone, and any number of threads."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from hypothesis import given, settings

from inscrutable import MarkowitzProblem, Polyhedron, QuadraticProblem, box, simplex
from inscrutable.kernels.calls import in_chunks, thread_count
from oracles import enumeration, markets
from sizes import instances
from strategies import SEEDS


def drawn(seed: int, n_states: int, size: int, **kinds: bool) -> MarkowitzProblem:
    return MarkowitzProblem(*markets.random_market(np.random.default_rng(seed), n_states, size, **kinds))


def beliefs_of(seed: int, n_states: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.vstack([np.eye(n_states), rng.dirichlet(np.full(n_states, 0.5), count)])


# --- answers ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("n_states", "size"), [(1, 1), (1, 6), (3, 1), (4, 12), (2, 40)])
def test_bulk_answers_are_the_slow_solvers(n_states, size):
    problem, beliefs = drawn(1, n_states, size), beliefs_of(2, n_states, 20)
    together = problem.solve(beliefs)
    np.testing.assert_allclose(together, problem._one_by_one(beliefs), atol=1e-13)
    assert np.all(together >= 0)


@pytest.mark.parametrize("kind", ["duplicate", "singular"])
def test_singular_programmes_keep_their_cost(kind):
    problem, beliefs = drawn(3, 3, 9, **{kind: True}), beliefs_of(4, 3, 17)
    together, apart = problem.solve(beliefs), problem._one_by_one(beliefs)
    np.testing.assert_allclose(
        problem.expected_cost(beliefs, together), problem.expected_cost(beliefs, apart), atol=1e-11
    )


def test_one_belief_is_solved_as_it_is_among_many():
    problem, beliefs = drawn(5, 4, 15), beliefs_of(6, 4, 30)
    together = problem.solve(beliefs)
    for belief, action in zip(beliefs, together, strict=True):
        np.testing.assert_allclose(problem.solve(belief), action, atol=1e-13)
    np.testing.assert_allclose(problem.solve(beliefs[:5]), together[:5], atol=1e-13)
    np.testing.assert_allclose(problem.solve(beliefs[::-1])[::-1], together, atol=1e-13)


@settings(max_examples=instances(40), deadline=None)
@given(SEEDS)
def test_boxes_with_fixed_coordinates_and_equalities_equal_enumeration(seed):
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 5))
    lower = -rng.uniform(0, 1, size)
    upper = np.where(rng.uniform(size=size) < 0.3, lower, rng.uniform(0, 1, size))
    inside = rng.uniform(lower, upper)
    normals = rng.normal(size=(int(rng.integers(0, 3)), size))
    region = box(lower, upper) & Polyhedron(A_eq=normals, b_eq=normals @ inside) if len(normals) else box(lower, upper)
    factors = rng.normal(size=(2, size, size + 2))
    hessians, linear = factors @ factors.transpose(0, 2, 1), 3 * rng.normal(size=(2, size))
    problem = QuadraticProblem(hessians, linear, constraints=region)
    beliefs = rng.dirichlet(np.ones(2), 3)
    for belief, action in zip(beliefs, problem.solve(beliefs), strict=True):
        rows = (region.A_ub, region.b_ub, region.A_eq, region.b_eq)
        value, _ = enumeration.quadratic_value(np.tensordot(belief, hessians, 1), belief @ linear, *rows)
        assert float(problem.expected_cost(belief, action)) == pytest.approx(value, abs=1e-8)
        assert region.violation(action) <= 1e-11


def test_a_vertex_with_fewer_free_coordinates_than_equalities_is_found():
    region = simplex(3) & Polyhedron(A_eq=[[1.0, 2.0, 3.0]], b_eq=[3.0])  # only (0, 0, 1)
    problem = QuadraticProblem([np.eye(3)] * 2, np.zeros((2, 3)), constraints=region)
    np.testing.assert_allclose(problem.solve(beliefs_of(7, 2, 16)), np.tile([0.0, 0.0, 1.0], (18, 1)), atol=1e-12)


def test_ties_stay_at_their_bound():
    """At π = (½, ½) asset 2 is exactly worth holding nothing of; its multiplier is zero as well."""
    problem = QuadraticProblem([np.eye(2)] * 2, [[0.0, 1.5], [0.0, 0.5]], constraints=simplex(2))
    np.testing.assert_array_equal(problem.solve(np.full((20, 2), 0.5)), np.tile([1.0, 0.0], (20, 1)))


@pytest.mark.parametrize("threads", ["2", "4"])
def test_any_number_of_threads_gives_the_same_bytes(threads, monkeypatch):
    problem, beliefs = drawn(8, 3, 8), beliefs_of(9, 3, 200)
    monkeypatch.setenv("NUMBA_NUM_THREADS", "1")
    alone = problem.solve(beliefs)
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    assert problem.solve(beliefs).tobytes() == alone.tobytes()


# --- chunks -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", ["1", "2", "4"])
@pytest.mark.parametrize("count", [0, 1, 63, 64, 65, 1000])
def test_chunks_cover_every_item_once(threads, count, monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    seen, told = np.zeros(count, dtype=int), []

    def work(first, last):
        assert first % 64 == 0
        assert last == min(first + 64, count)
        seen[first:last] += 1

    in_chunks(work, count, 64, lambda done, of: told.append((done, of)))
    assert np.all(seen == 1)
    assert told == sorted(told)
    assert not count or told[-1] == (count, count)


@pytest.mark.parametrize("threads", ["1", "3"])
@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_ends_the_chunks_and_is_raised(threads, error, monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    ran = []

    def work(first, _):
        ran.append(first)
        if threading.current_thread() is threading.main_thread():
            raise error("stop")

    with pytest.raises(error, match="stop"):
        in_chunks(work, 10**6, 1)
    assert len(ran) < 10**6


def test_an_error_on_a_helper_is_raised_here(monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    failed = threading.Event()

    def work(*_):
        if threading.current_thread() is not threading.main_thread():
            failed.set()
            raise ValueError("elsewhere")
        failed.wait(5)

    with pytest.raises(ValueError, match="elsewhere"):
        in_chunks(work, 20, 1)


def test_chunks_inside_chunks_end(monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "2")
    total = []
    in_chunks(lambda first, last: in_chunks(lambda a, b: total.append(b - a), 6, 1), 8, 1)
    assert sum(total) == 48


def test_the_number_of_threads_follows_the_environment(monkeypatch):
    monkeypatch.setenv("NUMBA_NUM_THREADS", "3")
    assert thread_count() == 3
    monkeypatch.delenv("NUMBA_NUM_THREADS")
    assert thread_count() >= 1
