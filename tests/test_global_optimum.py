"""The global counter-adversarial decision against the optimum that SCIP and dense scans prove, support by support."""

from __future__ import annotations

import pytest

from inscrutable import Budget, CounterAdversarialDecisionMaker, MarkowitzProblem, consistent_beliefs
from oracles import consistent, markets, optimum

pytest.importorskip("pyscipopt", reason="SCIP comes with the [global] extra")

CASES = list(optimum.cases())
MISSED = 1e-4  # relative: how far below the proven optimum a decision may stay
ABOVE = 1e-6  # how far above the proven bound rounding may carry it


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_the_global_search_reaches_the_proven_optimum(case):
    best, _, bound = optimum.global_cdm(case.market, case.belief, case.budget, case.min_slack)
    problem = MarkowitzProblem(*case.market)
    assert problem.constraints.min_slack == case.min_slack

    decision = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(case.budget)).decide(case.belief)

    assert decision.privacy >= best * (1 - MISSED), f"gap {best - decision.privacy:.3g} below {best:.6f}"
    assert decision.privacy <= bound + ABOVE
    assert decision.regret <= case.budget * (1 + 1e-9)
    assert decision.privacy_bound >= best * (1 - 1e-9)
    assert problem.constraints.is_admissible(decision.action)
    # The same privacy, recomputed from nothing but the action: by the library, and by the oracle's corners.
    assert decision.privacy == consistent_beliefs(problem, decision.action).distance(case.belief)
    system = consistent.simplex_system(markets.gradients(case.market, decision.action), decision.action > 1e-12)
    corners = consistent.vertices(system)
    assert decision.privacy == pytest.approx(consistent.hull_distance(case.belief, corners), abs=1e-6)
