"""The sequential rule beside all others on random markets, over time and at equal regret: run by `make audit`."""

from __future__ import annotations

import logging
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from inscrutable import MarkowitzProblem, Prior
from inscrutable.experiments.comparison import ComparisonSettings, compare, makers_of
from inscrutable.experiments.makers import behave
from inscrutable.mechanisms.chains import resting_chain
from oracles.markets import random_market

pytestmark = pytest.mark.audit

OTHERS = ("CDM", "PDM", "rate-distortion", "Stackelberg", "coin", "delay", "partial trades")
RESTS = (0.95, 0.9, 0.85, 0.8, 0.5, 0.2)
"""Probabilities that a belief rests; from 0.8 on it counts as persistent."""
N_MARKETS, N_BELIEFS = 100, 24
HALF_OF_SILENCE = 0.5


def sequential(setting, regret):
    """The rule at the best of several prices of information."""
    chosen = {"name": "sequential"}
    return behave(setting, chosen, setting.budget(regret), regret=regret, seed=lambda: np.random.default_rng(0))


def errors_over_time(job):
    """The error over time of each rule on one market, as shares of the error without decisions, the rule's own first."""
    seed, rest = job
    logging.getLogger("inscrutable").setLevel(logging.ERROR)
    rng = np.random.default_rng(seed)
    problem = MarkowitzProblem(*random_market(rng, 3, 4))
    prior = Prior(rng.dirichlet(np.ones(3), N_BELIEFS), rng.dirichlet(np.ones(N_BELIEFS)))
    makers = {"sequential": sequential, **makers_of(OTHERS)}
    settings = ComparisonSettings(budgets=(HALF_OF_SILENCE,), repeats=(1,), draws=10)
    found = compare(problem, resting_chain(prior, rest), settings, makers=makers, rng=rng)
    errors = {row.maker: row.path_error / found.prior_error for row in found.rows}
    return [errors[name] for name in makers]


def test_the_rule_lasts_longest_on_random_markets(fresh_rng, capsys):
    rests = np.resize(RESTS, N_MARKETS)
    jobs = list(zip(fresh_rng.integers(2**31, size=N_MARKETS).tolist(), rests.tolist(), strict=True))
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        errors = np.array(list(pool.map(errors_over_time, jobs)))
    with capsys.disabled():
        print("\n\nmedian error over time, as a share of that without decisions: sequential, " + ", ".join(OTHERS))
        for rest in RESTS:
            print(f"belief rests with {rest:g}:", *(f"{each:.3f}" for each in np.median(errors[rests == rest], axis=0)))
        for job, row in zip(jobs, errors, strict=True):
            if row[0] < row[1:].max():
                best = 1 + int(row[1:].argmax())
                print(
                    f"below {OTHERS[best - 1]}: market {job[0]}, rests with {job[1]:g}: {row[0]:.4f} of {row[best]:.4f}"
                )
    persistent = np.median(errors[rests >= 0.8], axis=0)
    assert persistent[0] > persistent[1:].max()
    for rest in (0.5, 0.2):
        moving = np.median(errors[rests == rest], axis=0)
        assert moving[0] >= 0.99 * moving[1:].max()
