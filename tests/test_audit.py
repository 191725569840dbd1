"""What takes minutes: run by `make audit`, which keeps the log."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import Budget, CounterAdversarialDecisionMaker, MarkowitzProblem
from inscrutable.experiments.claims import Verdict
from inscrutable.experiments.reproduction import ReproductionSettings, reproduce
from inscrutable.reports.reproduction import claims_table
from oracles import enumeration, markets, optimum

pytestmark = pytest.mark.audit

N_PROBLEMS = 400
N_MARKETS = 200


def drawn_case(seed: int) -> tuple[markets.Market, np.ndarray, float]:
    """A random market, belief and budget: two or three states, corners and faces of the simplex, small and large budgets."""
    rng = np.random.default_rng([20261121, seed])
    n_states = int(rng.choice([2, 3, 3]))
    n_assets = int(rng.choice([2, 3, 4, 5], p=[0.2, 0.4, 0.25, 0.15]))
    share = float(rng.choice([0.003, 0.03, 0.1, 0.3, 1.0]))
    market = markets.random_market(
        rng, n_states, n_assets, positive_value=bool(seed % 2), scale_spread=float(rng.choice([0, 0, 1.0]))
    )
    belief = markets.random_belief(rng, n_states) if seed % 3 else rng.dirichlet(np.full(n_states, 0.3))
    if seed % 7 == 0:
        belief = np.eye(n_states)[0]
    return market, belief, share * abs(enumeration.value(market, belief)[0])


def test_the_global_search_reaches_what_scip_proves(capsys):
    gaps, misses = [], []
    for seed in range(N_PROBLEMS):
        market, belief, budget = drawn_case(seed)
        best, _, bound = optimum.global_cdm(market, belief, budget, 1e-4)
        found = CounterAdversarialDecisionMaker(MarkowitzProblem(*market), budget=Budget.regret(budget)).decide(belief)
        assert found.privacy <= bound + 1e-6, seed
        gaps.append((best - found.privacy) / max(best, 1e-9))
        if found.privacy < best * (1 - 1e-4) - 1e-7:
            misses.append((seed, best, found.privacy))
    with capsys.disabled():
        print(f"\n{N_PROBLEMS} problems against SCIP: largest relative gap {max(gaps):.2e}, misses {misses}")
    assert not misses


def test_the_claims_on_other_markets_than_the_reported_ones(capsys):
    result = reproduce(ReproductionSettings(seed=1, markets=N_MARKETS))
    table = claims_table(result)
    with capsys.disabled():
        print(f"\nclaims on {N_MARKETS} markets of another seed\n{table.to_string()}")
    verdicts = {judged.key: judged.verdict for judged in result.claims}
    certain = [key for key, verdict in verdicts.items() if verdict is Verdict.HOLDS]
    assert {"odm_exposed", "cdm_within_budget", "pdm_within_budget_on_average"} <= set(certain)
