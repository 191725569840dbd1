"""Calls that run, and thereby compile, every kernel."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
from joblib import Parallel, delayed

from inscrutable import validation
from inscrutable.decision_makers import (
    CounterAdversarialDecisionMaker,
    GlobalSearch,
    LocalSearch,
    PriceCalibration,
    ProbabilisticDecisionMaker,
    SequentialDecisionMaker,
    privacy_frontier,
    random_candidates,
)
from inscrutable.filtering import filter_beliefs
from inscrutable.mechanisms import Prior
from inscrutable.mechanisms.chains import resting_chain
from inscrutable.privacy import (
    DesiredObfuscation,
    Infeasibility,
    MaximalObfuscation,
    NonExistence,
    NonUniqueness,
    PrivacyMeasure,
    RivalProblem,
    SquaredError,
)
from inscrutable.problems import FiniteProblem, MarkowitzProblem
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel, fit_gaussian_hmm

_STATES, _ASSETS = 4, 3
_BELIEFS = 32
_GAP = 0.05
_STAYS, _BUDGET = 0.8, 0.1
_NOTICE = "inscrutable.kernels"


def compile_kernels(*, n_jobs: int = -1, progress: Callable[[int, int], None] = lambda done, total: None) -> Path:
    """Compile every kernel, in `n_jobs` processes, so that no later call on this machine waits for the compiler.

    Args:
        n_jobs: Processes; −1 is one per core.
        progress: Called with the numbers of calls done and in all.

    Returns:
        The folder of the compiled kernels.

    Raises:
        InputError: `n_jobs` is neither −1 nor at least 1.
    """
    from inscrutable.kernels.hidden_markov import filter_pass

    validation.processes(n_jobs, "jobs")
    # In parallel, kernels that both need are compiled early by the first and late by the second, and so only once. The
    # exception is a large part of a search, with which the second begins: this saves some ten seconds in all.
    calls = [delayed(_quietly)(part) for part in (_decisions, _others)]
    progress(0, len(calls))
    for done, _ in enumerate(Parallel(n_jobs=n_jobs, return_as="generator_unordered")(calls), 1):
        progress(done, len(calls))
    return Path(cast(Any, filter_pass).stats.cache_path)


def _quietly(calls: Callable[[], None]) -> None:
    """Suppress the log message that kernels are being compiled."""
    logger = logging.getLogger(_NOTICE)
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        calls()
    finally:
        logger.setLevel(before)


def _others() -> None:
    from inscrutable.kernels.climb import climb
    from inscrutable.kernels.deferred import compiled_at_once
    from inscrutable.kernels.region_search import search_regions

    cast(Any, search_regions).compile_callee(climb)
    problem, beliefs = _market(np.random.default_rng(0))
    CounterAdversarialDecisionMaker(problem).decide(beliefs[0])
    with compiled_at_once():
        _worlds()


def _worlds() -> None:
    rng, n_states = np.random.default_rng(0), 2
    stays = np.full((n_states, n_states), 0.1) + (1.0 - 0.1 * n_states) * np.eye(n_states)
    world = HiddenMarkovModel(stays, CategoricalEmission(stays), np.full(n_states, 1.0 / n_states))
    filter_beliefs(world, world.sample(20, rng=rng).observations)
    fit_gaussian_hmm(rng.normal(size=(60, 2)), n_states, rng=rng)
    chain = resting_chain(Prior(np.eye(n_states), np.full(n_states, 1.0 / n_states)), _STAYS)
    prices = PriceCalibration.at(1.0, 1.0)
    problem = FiniteProblem(1.0 - np.eye(n_states))
    rival = RivalProblem(MarkowitzProblem(np.eye(n_states), np.tile(np.eye(n_states), (n_states, 1, 1)), 1.0))
    for loss in (SquaredError(), rival):
        SequentialDecisionMaker(problem, _BUDGET, chain=chain, calibration=prices, loss=loss, rng=rng).mechanism_for(
            chain.prior
        )


def _market(rng: np.random.Generator) -> tuple[MarkowitzProblem, Array]:
    factors = rng.normal(size=(_STATES, _ASSETS, _ASSETS))
    covariances = 0.01 * (factors @ factors.swapaxes(1, 2) + np.eye(_ASSETS))
    problem = MarkowitzProblem(0.02 * rng.normal(size=(_STATES, _ASSETS)), covariances, 5.0)
    return problem, rng.dirichlet(np.ones(_STATES), _BELIEFS)


def _decisions() -> None:
    from inscrutable.kernels.deferred import compiled_at_once

    with compiled_at_once():
        _decide()


def _decide() -> None:
    rng = np.random.default_rng(0)
    problem, beliefs = _market(rng)
    single = CounterAdversarialDecisionMaker(problem)
    for measure in _measures(beliefs[1]):
        CounterAdversarialDecisionMaker(problem, measure).decide(beliefs[0])
        CounterAdversarialDecisionMaker(problem, measure, candidates=single.candidates).decide_many(beliefs)
        ProbabilisticDecisionMaker(problem, measure, candidates=single.candidates).decide_many(beliefs)
    for some in (single.candidates, random_candidates(problem, _BELIEFS, rng=rng)):
        for distance in (None, DesiredObfuscation(beliefs[1])):
            privacy_frontier(problem, beliefs[0], distance, candidates=some)
    CounterAdversarialDecisionMaker(problem, method=LocalSearch()).decide(beliefs[0])
    CounterAdversarialDecisionMaker(problem, method=GlobalSearch(certify=_GAP)).decide(beliefs[0])
    ProbabilisticDecisionMaker(problem, certify=_GAP).decide(beliefs[0])


def _measures(desired: Array) -> tuple[PrivacyMeasure, ...]:
    return MaximalObfuscation(), DesiredObfuscation(desired), NonExistence(), NonUniqueness(), Infeasibility()
