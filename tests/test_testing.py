"""The contract checker: silent on every problem type that is shipped, and loud on each promise that is broken."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import (
    FiniteProblem,
    InputError,
    KellyProblem,
    LinearProblem,
    MarkowitzProblem,
    Polyhedron,
    QuadraticProblem,
    box,
    check_decision_problem,
    simplex,
)


def shipped():
    """One problem of every type, and of every kind of feasible set."""
    rng = np.random.default_rng(0)
    factors = rng.normal(size=(3, 4, 5)) / 5
    covariances = factors @ factors.transpose(0, 2, 1)
    sector = simplex(4) & Polyhedron([[1, 1, 0, 0]], [0.6])
    odds = np.zeros((3, 1, 3))
    odds[np.arange(3), 0, np.arange(3)] = [2, 3, 4]
    return {
        "Markowitz": MarkowitzProblem(rng.normal(size=(3, 4)) / 10, covariances, 1.0),
        "quadratic": QuadraticProblem(covariances, rng.normal(size=(3, 4)), [1, 2, 3], constraints=sector),
        "unbounded": QuadraticProblem(
            covariances, rng.normal(size=(3, 4)), constraints=Polyhedron([[1, 1, 1, 1]], [2])
        ),
        "linear": LinearProblem(rng.normal(size=(3, 4)), sector),
        "linear in a box": LinearProblem(rng.normal(size=(2, 3)), box([-1] * 3, [2] * 3)),
        "finite": FiniteProblem(rng.normal(size=(3, 5))),
        "one choice": FiniteProblem([[1.0], [2.0]]),
        "horse race": KellyProblem(odds, np.ones((3, 1))),
        "growth": KellyProblem(rng.lognormal(0, 0.2, (3, 6, 4)), rng.dirichlet(np.ones(6), 3), sector),
        "one state": MarkowitzProblem(rng.normal(size=(1, 4)), covariances[:1], 1.0),
    }


@pytest.mark.parametrize("name", shipped())
@pytest.mark.parametrize("seed", [1, 2])
def test_what_is_shipped_keeps_its_promises(name, seed):
    check_decision_problem(shipped()[name], rng=np.random.default_rng(seed))


class Broken(QuadraticProblem):
    """A sound problem of which a test breaks one method."""

    def __init__(self):
        super().__init__([np.eye(3), 2 * np.eye(3)], [[0.0, -0.5, -0.2], [-0.7, 0.0, 0.1]], constraints=simplex(3))


def broken(**methods):
    """The sound problem with some methods replaced."""
    return type("Replaced", (Broken,), methods)()


BREACHES = {
    "the shape of solve": broken(solve=lambda self, beliefs: np.zeros((2, 2))),
    "the shape of cost_gradients": broken(cost_gradients=lambda self, action: np.zeros((3, 2))),
    "state costs are finite": broken(
        state_costs=lambda self, actions: np.log(np.maximum(np.asarray(actions)[..., :2], 0.4) - 0.4 + 1e-300) * np.inf
    ),
    "state costs are convex": broken(state_costs=lambda self, actions: -Broken.state_costs(self, actions)),
    "cost_gradients are the slopes": broken(
        cost_gradients=lambda self, action: 1.1 * Broken.cost_gradients(self, action)
    ),
    "solve returns feasible decisions": broken(solve=lambda self, beliefs: 1.01 * Broken.solve(self, beliefs)),
    "no feasible decision is cheaper": broken(
        solve=lambda self, beliefs: Broken.solve(self, np.full_like(np.asarray(beliefs, dtype=float), 0.5))
    ),
    "many beliefs are solved as each alone": broken(
        solve=lambda self, beliefs: Broken.solve(self, beliefs if np.ndim(beliefs) == 1 else np.asarray(beliefs)[::-1])
    ),
    "what a belief explains is optimal": broken(explaining_rows=lambda self, action: np.zeros((1, 2))),
    "a belief explains the decision": broken(
        solve=lambda self, beliefs: (1 - 1e-6) * Broken.solve(self, beliefs) + 1e-6 / 3
    ),
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("promise", BREACHES)
def test_a_broken_promise_is_named(promise):
    with pytest.raises(AssertionError, match=f"broken promise: {promise}"):
        check_decision_problem(BREACHES[promise])


def test_the_sound_problem_is_sound():
    check_decision_problem(Broken())


def test_what_is_no_problem_is_refused():
    with pytest.raises(InputError, match="problem must be a decision problem"):
        check_decision_problem(3)
