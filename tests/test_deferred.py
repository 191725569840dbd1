"""Kernels that the interpreter runs first: same digits, compiled when that pays."""

from __future__ import annotations

import time

import numba
import numpy as np
import pytest

from inscrutable import (
    CounterAdversarialDecisionMaker,
    DesiredObfuscation,
    MarkowitzProblem,
    MaximalObfuscation,
    NonUniqueness,
    ProbabilisticDecisionMaker,
)
from inscrutable.kernels import calls
from sizes import some

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


def market(rng: np.random.Generator, n_states: int, n_assets: int) -> MarkowitzProblem:
    factors = rng.normal(size=(n_states, n_assets, n_assets))
    covariances = 0.01 * (factors @ factors.swapaxes(1, 2) + np.eye(n_assets))
    return MarkowitzProblem(0.02 * rng.normal(size=(n_states, n_assets)), covariances, rng.uniform(1.0, 5.0))


def run_by_the_interpreter(kernel, *arguments):
    with np.errstate(all="ignore"):
        return calls.interpreted(kernel._compiled, {})(*arguments)


def numbers(decided) -> list[np.ndarray]:
    """Everything that decisions state, in order."""
    names = ("action", "regret", "privacy", "actions", "regrets", "privacies", "probabilities")
    return [np.asarray(getattr(one, name)) for one in decided for name in names if hasattr(one, name)]


@pytest.mark.parametrize(
    ("n_states", "n_assets"),
    [(2, 1), (3, 2), (4, 2), *(pytest.param(*each, marks=pytest.mark.audit) for each in ((3, 5), (4, 3)))],
)
def test_interpreted_and_compiled_decisions_have_the_same_digits(n_states, n_assets, fresh_rng, monkeypatch):
    problem = market(fresh_rng, n_states, n_assets)
    beliefs, target = fresh_rng.dirichlet(np.ones(n_states), 1), fresh_rng.dirichlet(np.ones(n_states))
    none, far, near = NonUniqueness(), MaximalObfuscation(), DesiredObfuscation(target)
    pairs = [(CounterAdversarialDecisionMaker, measure) for measure in (none, far, near)]
    pairs += [(ProbabilisticDecisionMaker, measure) for measure in (none, near, far)]
    # From another one on for every number of states: three numbers have all six pairs between them.
    for maker, measure in some(pairs[n_states - 2 :] + pairs[: n_states - 2], 3):
        compiled = numbers(maker(problem, measure).decide_many(beliefs))
        with monkeypatch.context() as interpreted:
            interpreted.setattr(calls._Deferred, "__call__", run_by_the_interpreter)
            found = numbers(maker(problem, measure).decide_many(beliefs))
        assert len(found) == len(compiled)
        for one, other in zip(found, compiled, strict=True):
            np.testing.assert_array_equal(one, other)


@numba.njit
def tripled(x):
    return 3.0 * x


def waiting(turns):
    """Takes a while in the interpreter."""
    total = 0.0
    for _ in range(turns):
        total += tripled(1.0)
    return total


def test_a_kernel_is_compiled_when_the_interpreter_had_its_time(monkeypatch):
    monkeypatch.setattr(calls, "_patience", [0.1])
    compiled = numba.njit(waiting)
    kernel = calls.deferred(lambda function: compiled)(waiting)
    start = time.perf_counter()
    assert kernel(1) == 3.0
    assert not compiled.signatures
    while not compiled.signatures:
        assert kernel(10_000) == 30_000.0
        assert time.perf_counter() - start < 60.0


def test_inside_the_context_kernels_are_compiled_at_their_first_call():
    compiled = numba.njit(tripled.py_func)
    kernel = calls.deferred(lambda function: compiled)(tripled.py_func)
    with calls.compiled_at_once():
        assert kernel(1.0) == 3.0
    assert len(compiled.signatures) == 1
