"""The contract checker: silent on every problem type that is shipped, and loud on each promise that is broken."""

from __future__ import annotations

import re

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
    testing,
)
from sizes import some


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
        "growth": KellyProblem(rng.lognormal(0, 0.2, (3, 6, 4)), rng.dirichlet(np.ones(6), 3), sector),
        "horse race": KellyProblem(odds, np.ones((3, 1))),
        "one state": MarkowitzProblem(rng.normal(size=(1, 4)), covariances[:1], 1.0),
    }


@pytest.mark.parametrize("name", some(list(shipped()), 2))
@pytest.mark.parametrize("seed", some([1, 2], 2))
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


SHAPES = {
    "constraints.n_actions": broken(n_actions=2),
    "solve(belief)": broken(solve=lambda self, beliefs: np.atleast_2d(Broken.solve(self, beliefs))),
    "solve(beliefs)": broken(solve=lambda self, beliefs: np.atleast_2d(Broken.solve(self, beliefs))[0]),
    "state_costs(action)": broken(state_costs=lambda self, actions: np.atleast_2d(Broken.state_costs(self, actions))),
    "state_costs(actions)": broken(state_costs=lambda self, actions: Broken.state_costs(self, actions).T),
    "cost_gradients(action)": broken(cost_gradients=lambda self, action: Broken.cost_gradients(self, action).T),
    "cost_gradients(actions)": broken(
        cost_gradients=lambda self, action: Broken.cost_gradients(self, np.atleast_2d(action)[0])
    ),
}


@pytest.mark.parametrize("name", SHAPES)
def test_a_wrong_shape_is_named(name):
    with pytest.raises(AssertionError, match=re.escape(f"broken promise: the shape of {name}; found")):
        check_decision_problem(SHAPES[name])


@pytest.fixture
def met(monkeypatch):
    """Returns which promises a problem breaks, all of them and not the first alone."""
    found = []
    monkeypatch.setattr(testing.problems, "promise", lambda kept, promise, detail: kept or found.append(promise))

    def listed(problem):
        found.clear()
        check_decision_problem(problem)
        return set(found)

    return listed


class Hollow(Broken):
    """Costs that bend downwards, with their own gradients, and minimised exactly: at corners of the simplex."""

    def __init__(self):
        super().__init__()
        self.hessians = np.array([-0.1 * np.eye(3), 2 * np.eye(3)])
        self.hessians[1] = -0.1 * np.eye(3)

    def solve(self, beliefs):
        return np.eye(3)[(np.asarray(beliefs) @ self.state_costs(np.eye(3)).T).argmin(axis=-1)]


class Dearest(LinearProblem):
    """The last choice costs most in every state and is taken; every belief is said to explain everything."""

    def __init__(self):
        super().__init__([[1.0, 2.0, 5.0], [2.0, 1.0, 5.0]], simplex(3))

    def solve(self, beliefs):
        return np.broadcast_to([0.0, 0.0, 1.0], (*np.shape(beliefs)[:-1], 3))

    def explaining_rows(self, action):
        return np.zeros((1, 2))


class Overspent(LinearProblem):
    """Decisions a little larger than the simplex allows, where that pays."""

    def __init__(self):
        super().__init__([[-1.0, -2.0, -1.5], [-2.0, -1.0, -1.5]], simplex(3))

    def solve(self, beliefs):
        return (1 + 1e-8) * super().solve(beliefs)


class Bygone(QuadraticProblem):
    """What it has not solved for is said to have no explanation, where any mixture of the two assets has one."""

    def __init__(self):
        super().__init__([np.eye(2)] * 2, [[0.0, -1.0], [-1.0, 0.0]], constraints=simplex(2))
        self.known = []

    def solve(self, beliefs):
        solved = super().solve(beliefs)
        self.known.extend(np.atleast_2d(solved))
        return solved

    def explaining_rows(self, action):
        return None if any(np.array_equal(action, each) for each in self.known) else -np.ones((1, 2))


ALONE = {
    "many decisions cost what each costs alone": broken(
        state_costs=lambda self, actions: Broken.state_costs(self, actions) + 1e-6 * (np.ndim(actions) == 2)
    ),
    "state costs are convex": Hollow(),
    "cost_gradients are the slopes of state_costs": BREACHES["cost_gradients are the slopes"],
    "solve returns feasible decisions": Overspent(),
    "no feasible decision is cheaper than solve's": Dearest(),
    "many beliefs are solved as each alone": broken(
        solve=lambda self, beliefs: (
            Broken.solve(self, 0.9 * np.asarray(beliefs) + 0.05 * (np.ndim(beliefs) == 1))
            if np.ndim(beliefs) == 1
            else Broken.solve(self, beliefs)
        )
    ),
    "what a belief explains is optimal for it": BREACHES["what a belief explains is optimal"],
    "a belief explains the decision it leads to": BREACHES["a belief explains the decision"],
    "what no belief explains leaves every belief a regret": Bygone(),
}


@pytest.mark.parametrize("promise", ALONE)
def test_a_breach_is_caught_by_the_check_meant_for_it_alone(promise, met):
    assert met(ALONE[promise]) == {promise}


class Remembering(Broken):
    """Notes the batches of nine beliefs that it is asked for: the steps along rays."""

    def __init__(self):
        super().__init__()
        self.rays = []

    def solve(self, beliefs):
        if np.shape(beliefs) == (9, 2):
            self.rays.append(np.array(beliefs))
        return super().solve(beliefs)


def wrong_at(places, instead):
    """The sound problem, but for beliefs `places`, where it answers as for beliefs `instead`."""

    def solve(self, beliefs):
        held = np.array(beliefs, dtype=float)
        for place, other in zip(places, instead, strict=True):
            held[np.abs(held - place).max(axis=-1) <= 1e-12] = other
        return Broken.solve(self, held)

    return broken(solve=solve)


@pytest.mark.parametrize(
    ("promise", "places", "instead"),
    [
        # The decision stays behind for two steps, and in order: only the optimal cost shows it.
        ("the optimal cost is concave in the belief", [4, 5], [3, 3]),
        # It falls back behind its neighbour, but by so little that the optimal cost stays concave.
        ("regret never falls along a ray from the true belief", [6], [4.8]),
    ],
)
def test_what_only_rays_show(promise, places, instead, met):
    sound = Remembering()
    check_decision_problem(sound)
    long = [(ray, (ray[-1] - ray[0]) / 8) for ray in sound.rays if np.abs(ray[0] - ray[-1]).max() > 0.2]
    caught = (met(wrong_at(ray[places], [ray[0] + share * step for share in instead])) for ray, step in long)
    assert any(each == {promise} for each in caught)


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
