"""The frontier of all budgets against its definition: every candidate judged, every pair mixed."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from inscrutable import (
    DesiredObfuscation,
    Infeasibility,
    MaximalObfuscation,
    NonExistence,
    NonUniqueness,
    action_grid,
    decoy_grid,
    privacy_frontier,
    random_candidates,
)
from sizes import some
from test_indicators import KINDS, beliefs_of, problem_of

REGRETS = np.concatenate([[0.0], np.geomspace(1e-9, 3.0, 60)])


class OwnDistance(MaximalObfuscation):
    """A user's own measure that happens to be the distance."""


def defined(problem, belief, measure, candidates):
    """Regrets and privacies of everything that may be played, each set judged by the measure itself."""
    sets, costs = candidates.sets, candidates.state_costs @ belief
    optimal = problem.solve(belief)
    least = float(problem.state_costs(optimal) @ belief)
    reference = measure.reference(belief)
    if reference is None:
        values = np.array([measure(belief, sets[i]) for i in range(len(candidates))])
    else:
        distances = sets.distances(reference.point)
        values = np.where(np.isinf(distances), -np.inf, reference.sign * distances)
    usable = candidates.usable & np.isfinite(values)
    own = measure(belief, type(sets)(problem, optimal[None], *[np.zeros(1, dtype=int)] * 3, np.zeros(1, dtype=int))[0])
    regrets = np.append(np.maximum(costs - least, 0.0)[usable], 0.0)
    privacies = np.append(values[usable], own)
    kept = np.isfinite(privacies)
    return regrets[kept], privacies[kept]


def best_mixture(regrets, privacies, limit):
    """The largest mean privacy of any two points with a mean regret of at most the limit."""
    inside, outside = regrets <= limit, regrets > limit
    if not inside.any():
        return -np.inf
    best = privacies[inside].max()
    if outside.any():
        low, high = regrets[inside][:, None], regrets[outside][None]
        share = (limit - low) / (high - low)
        best = max(best, float(((1 - share) * privacies[inside][:, None] + share * privacies[outside][None]).max()))
    return best


@pytest.mark.parametrize(("kind", "source"), some(list(product(KINDS, ["decoys", "actions", "draws"])), 5))
def test_the_frontier_is_its_definition(kind, source):
    problem = problem_of(kind)
    rng = np.random.default_rng(2)
    candidates = {
        "decoys": lambda: decoy_grid(problem, 10),
        "actions": lambda: action_grid(problem, 4),
        "draws": lambda: random_candidates(problem, 80, rng=rng),
    }[source]()
    target = rng.dirichlet(np.ones(problem.n_states))
    measures = [MaximalObfuscation(), DesiredObfuscation(target), DesiredObfuscation(np.eye(problem.n_states)[-1]),
                NonExistence(), NonUniqueness(), OwnDistance()]  # fmt: skip
    if source == "draws":
        measures.append(Infeasibility(0.0))
    for belief in beliefs_of(problem.n_states, 2):
        for measure in measures:
            found = privacy_frontier(problem, belief, measure, candidates=candidates)
            regrets, privacies = defined(problem, belief, measure, candidates)
            # A regret that rounding alone tells from another is no other.
            limits = REGRETS[np.abs(REGRETS[:, None] - regrets).min(axis=1, initial=1.0) > 1e-12]
            single = [privacies[regrets <= limit].max(initial=-np.inf) for limit in limits]
            np.testing.assert_allclose(found.deterministic(limits), single, rtol=0, atol=1e-12, err_msg=repr(measure))
            mixed = [best_mixture(regrets, privacies, limit) for limit in limits]
            np.testing.assert_allclose(found.randomized(limits), mixed, rtol=0, atol=1e-9, err_msg=repr(measure))


def test_points_name_their_candidates():
    problem = problem_of("plain")
    candidates = decoy_grid(problem, 20)
    belief = np.array([0.2, 0.3, 0.5])
    found = privacy_frontier(problem, belief, MaximalObfuscation(), candidates=candidates)
    assert len(found.points) > 5
    for (regret, privacy), index in zip(found.points, found.indices, strict=True):
        if index == len(candidates):
            assert (regret, privacy) == (0.0, 0.0)
            continue
        assert regret == pytest.approx(float(problem.regret(belief, candidates.actions[index])), abs=1e-14)
        assert privacy == pytest.approx(candidates.sets[index].distance(belief), abs=1e-9)
    assert (np.diff(found.points, axis=0) > 0).all()


def test_the_same_frontier_for_any_number_of_threads(monkeypatch):
    problem = problem_of("plain")
    answers = set()
    for threads in ("1", "3"):
        monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
        found = privacy_frontier(problem, [0.2, 0.3, 0.5], None, candidates=decoy_grid(problem, 300))
        answers.add(found.points.tobytes() + found.indices.tobytes())
    assert len(answers) == 1


def test_a_frontier_prints_its_summary():
    found = privacy_frontier(problem_of("plain"), [0.2, 0.3, 0.5])
    assert repr(found) == found.summary()
    assert f"{len(found.points)} decisions" in found.summary()
    assert f"{found.points[-1, 1]:.4f}" in found.summary()
    assert "\n" not in found.summary()
