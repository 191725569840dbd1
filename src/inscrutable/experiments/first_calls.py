"""Calls that run, and thereby compile, every kernel."""

from __future__ import annotations

import gc
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
from joblib import Parallel, delayed

from inscrutable import validation
from inscrutable.decision_makers import (
    CounterAdversarialDecisionMaker,
    PriceCalibration,
    SequentialDecisionMaker,
)
from inscrutable.filtering import filter_beliefs
from inscrutable.mechanisms import Prior
from inscrutable.mechanisms.chains import resting_chain
from inscrutable.privacy import NonExistence, PrivacyMeasure, RivalProblem, SquaredError
from inscrutable.problems import FiniteProblem, MarkowitzProblem, Polyhedron, group_caps, simplex
from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel, fit_gaussian_hmm

_STATES, _ASSETS = 4, 3
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
    # In parallel, the first compiles the search and meanwhile the second all else, so that each takes one half of the time.
    calls = [delayed(_quietly)(part, os.getpid()) for part in (_search, _others)]
    progress(0, len(calls))
    for done, _ in enumerate(Parallel(n_jobs=n_jobs, return_as="generator_unordered")(calls), 1):
        progress(done, len(calls))
    return Path(cast(Any, filter_pass).stats.cache_path)


def _quietly(calls: Callable[[], None], parent: int) -> None:
    """Suppress the log message that kernels are being compiled, and collect garbage at the end, not after each kernel.

    A process of its own never does: to go through the millions of objects of a compiler, nearly all lasting, takes 2 s.
    """
    logger = logging.getLogger(_NOTICE)
    before, collects = logger.level, gc.isenabled()
    logger.setLevel(logging.ERROR)
    gc.disable()
    try:
        calls()
    finally:
        logger.setLevel(before)
        if os.getpid() != parent:
            gc.freeze()
        if collects:
            gc.enable()


def _others() -> None:
    from inscrutable.kernels.calls import compiled_at_once, put_off
    from inscrutable.kernels.region_search import search_regions

    with compiled_at_once(), put_off(search_regions):
        _worlds()
        _decide(simplex(_ASSETS))
        _decide(simplex(_ASSETS), NonExistence(), n_states=3)  # four take 2 s: the search is interpreted here


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


def _decide(constraints: Polyhedron, measure: PrivacyMeasure | None = None, n_states: int = _STATES) -> None:
    rng = np.random.default_rng(0)
    factors = rng.normal(size=(n_states, _ASSETS, _ASSETS))
    covariances = 0.01 * (factors @ factors.swapaxes(1, 2) + np.eye(_ASSETS))
    problem = MarkowitzProblem(0.02 * rng.normal(size=(n_states, _ASSETS)), covariances, 5.0, constraints)
    CounterAdversarialDecisionMaker(problem, measure).decide(rng.dirichlet(np.ones(n_states)))


def _search() -> None:
    from inscrutable.kernels.active_set import quadratic_costs
    from inscrutable.kernels.calls import compiled_at_once, put_off
    from inscrutable.kernels.region_search import best_starts, read_actions
    from inscrutable.kernels.set_distance import is_explained_once

    with compiled_at_once(), put_off(quadratic_costs, best_starts, read_actions, is_explained_once):
        # Over a set with a cap on a group, the decoys are decided without a kernel.
        _decide(simplex(_ASSETS) & group_caps(_ASSETS, {"pair": [0, 1]}, 0.9))
