"""What is done to a result is done to that result alone: neither decision makers nor other results change by it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from inscrutable import (
    CoinDecisionMaker,
    CounterAdversarialDecisionMaker,
    DesiredObfuscation,
    DirichletDecisionMaker,
    FiniteProblem,
    LinearProgramme,
    MarkowitzProblem,
    NonExistence,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    RateDistortionDecisionMaker,
    StackelbergDecisionMaker,
    UniformDecisionMaker,
    decoy_grid,
    uniform_prior,
)
from inscrutable.decision_makers.candidate_sources import default_decoys
from sizes import some

FIELDS = (
    "action", "actions", "probabilities", "regret", "regrets", "privacy", "privacies", "privacy_bound", "cost",
    "optimal_cost", "expected_cost", "expected_privacy", "price", "decoy", "decoys", "oracle_calls",
)  # fmt: skip


def market(rng: np.random.Generator, n_states: int) -> MarkowitzProblem:
    spreads = rng.uniform(0.5, 2.0, (n_states, 5))
    return MarkowitzProblem(rng.normal(0.0, 0.3, (n_states, 5)), np.array([np.diag(row) for row in spreads]), 1.0)


def makers_for(problem: Any) -> dict[str, Any]:
    n_states = problem.n_states
    candidates, prior = decoy_grid(problem, 5), uniform_prior(n_states, 5)
    shared = default_decoys(problem)
    target = DesiredObfuscation(np.eye(n_states)[0])
    found = {
        "original": OriginalDecisionMaker(problem),
        "single": CounterAdversarialDecisionMaker(problem),
        "single, target": CounterAdversarialDecisionMaker(problem, target, candidates=shared),
        "single, goal": CounterAdversarialDecisionMaker(problem, NonExistence(), candidates=shared),
        "single, of candidates": CounterAdversarialDecisionMaker(problem, candidates=candidates),
        "lottery": ProbabilisticDecisionMaker(problem),
        "lottery, goal": ProbabilisticDecisionMaker(problem, NonExistence(), candidates=shared),
        "programme": ProbabilisticDecisionMaker(problem, candidates=candidates, method=LinearProgramme()),
        "rate-distortion": RateDistortionDecisionMaker(problem, 0.1, prior=prior, candidates=candidates),
        "Stackelberg": StackelbergDecisionMaker(problem, 0.1, prior=prior, candidates=candidates),
        "uniform": UniformDecisionMaker(problem, 0.1, candidates=candidates),
        "coin": CoinDecisionMaker(problem, 0.3),
    }
    if not problem.is_discrete:
        noise = np.random.default_rng(0)
        found["noise"] = DirichletDecisionMaker(problem, 9.0, rng=noise, candidates=candidates, n_draws=50)
    return found


def copied(result: Any) -> dict[str, Any]:
    return {name: np.array(getattr(result, name)) for name in FIELDS if getattr(result, name, None) is not None}


def spoil(result: Any) -> int:
    """Scale every array of a result in place, as one who turns weights into money does."""
    spoiled = 0
    for name in FIELDS:
        value = getattr(result, name, None)
        if isinstance(value, np.ndarray) and value.flags.writeable:
            value *= np.asarray(7, dtype=value.dtype)
            value += np.asarray(1, dtype=value.dtype)
            spoiled += 1
    return spoiled


def assert_own(ask: Callable[[], Any]) -> None:
    first = ask()
    before = copied(first)
    assert spoil(first) > 0
    after = copied(ask())
    assert before.keys() == after.keys()
    for name in before:
        np.testing.assert_array_equal(before[name], after[name], err_msg=name)


@pytest.mark.parametrize("n_states", some([2, 3, 4], 3))
def test_scaling_a_result_changes_no_later_one(n_states: int, fresh_rng: np.random.Generator) -> None:
    problem = market(fresh_rng, n_states)
    beliefs = np.vstack([np.full(n_states, 1.0 / n_states), fresh_rng.dirichlet(np.ones(n_states), 2)])
    for maker in makers_for(problem).values():
        assert_own(lambda maker=maker: maker.decide(beliefs[1]))  # type: ignore[misc]
        assert_own(lambda maker=maker: maker.decide_many(beliefs))  # type: ignore[misc]
        assert_own(lambda maker=maker: maker.decide_many(beliefs)[1])  # type: ignore[misc]


def test_scaling_a_choice_of_candidates_changes_no_later_one(fresh_rng: np.random.Generator) -> None:
    problem = FiniteProblem(fresh_rng.normal(size=(3, 6)))
    belief = fresh_rng.dirichlet(np.ones(3))
    for maker in makers_for(problem).values():
        assert_own(lambda maker=maker: maker.decide(belief))  # type: ignore[misc]
        assert_own(lambda maker=maker: maker.decide_many(belief[None]))  # type: ignore[misc]


@pytest.mark.parametrize("n_states", [3, 4])
def test_decisions_made_on_access_do_not_follow_what_was_done_to_the_rest(
    n_states: int, fresh_rng: np.random.Generator
) -> None:
    problem = market(fresh_rng, n_states)
    beliefs = fresh_rng.dirichlet(np.ones(n_states), 4)
    single, mixed = CounterAdversarialDecisionMaker(problem), ProbabilisticDecisionMaker(problem)
    decided, drawn = single.decide_many(beliefs), mixed.decide_many(beliefs)
    sampled = drawn.sample(rng=np.random.default_rng(0))
    sampled.optimal_cost[:] = np.nan
    decided.decoy[:] = drawn.decoys[:] = np.nan
    np.testing.assert_array_equal(decided.action, single.decide_many(beliefs).action)
    again = mixed.decide_many(beliefs)
    np.testing.assert_array_equal(drawn.actions, again.actions)
    np.testing.assert_array_equal(drawn.optimal_cost, again.optimal_cost)
    row = again[0]
    row.probabilities[:] = row.regrets[:] = np.nan
    assert np.isfinite(again.probabilities).all()
    assert np.isfinite(again.regrets).all()


def test_what_decision_makers_share_is_read_only() -> None:
    problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
    prior = uniform_prior(2, 4)
    maker = StackelbergDecisionMaker(problem, 0.1, prior=prior, candidates=decoy_grid(problem, 4))
    candidates, played = CounterAdversarialDecisionMaker(problem).candidates, maker.mechanism
    shared = [candidates.actions, candidates.state_costs, candidates.decoys, played.probabilities, played.actions,
              played.regrets, prior.beliefs, prior.weights, maker.estimates]  # fmt: skip
    for array in shared:
        with pytest.raises(ValueError, match="read-only"):
            array *= 2.0
