"""The paper's local search from several starts."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import CounterAdversarialDecisionMaker, LocalSearch, MarkowitzProblem, MaximalObfuscation, decoy_grid
from inscrutable.decision_makers.local_search import privacies_by_start
from oracles import markets
from sizes import instances, some


def three_by_three(rng: np.random.Generator) -> tuple[MarkowitzProblem, np.ndarray, float]:
    """A market of the paper's size, a belief, and a tenth of its optimal cost."""
    market = markets.random_market(rng, 3, 3)
    problem = MarkowitzProblem(market.means, market.covariances, market.risk_aversion)
    belief = rng.dirichlet(np.ones(3))
    return problem, belief, 0.1 * abs(float(problem.optimal_cost(belief)))


@pytest.mark.parametrize("seed", some([0, 24, None], 2))
def test_starts_end_where_each_ends_alone(seed: int | None, fresh_seed: int) -> None:
    problem, belief, limit = three_by_three(np.random.default_rng(fresh_seed if seed is None else seed))

    def reached(n_starts: int, rng: np.random.Generator) -> np.ndarray:
        return privacies_by_start(problem, belief, MaximalObfuscation(), limit, LocalSearch(n_starts, rng))

    count = instances(8, least=4)
    together = reached(count, np.random.default_rng(1))
    rng = np.random.default_rng(1)
    alone = np.concatenate([reached(1, rng) for _ in range(count)])
    assert np.array_equal(together, alone)
    maker = CounterAdversarialDecisionMaker(
        problem, budget=0.1, method=LocalSearch(count, np.random.default_rng(1)), candidates=decoy_grid(problem, 6)
    )
    assert maker.decide(belief).privacy == pytest.approx(max(together.max(), 0.0), abs=1e-9)
