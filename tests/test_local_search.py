"""The paper's local search from several starts, whose trials are judged together."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable

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
def test_starts_judged_together_end_where_each_ends_alone(seed: int | None, fresh_seed: int) -> None:
    problem, belief, limit = three_by_three(np.random.default_rng(fresh_seed if seed is None else seed))

    def reached(n_starts: int, rng: np.random.Generator) -> np.ndarray:
        return privacies_by_start(problem, belief, MaximalObfuscation(), limit, LocalSearch(n_starts, rng))

    count = instances(8, least=4)
    together = reached(count, np.random.default_rng(1))
    rng = np.random.default_rng(1)
    alone = np.concatenate([reached(1, rng) for _ in range(count)])
    # All in 48 of 50 markets: at a corner, where a set is larger than a segment, last digits may be those of an equal trial.
    assert (together == alone).mean() >= (1.0 if seed is not None else 0.5)
    maker = CounterAdversarialDecisionMaker(
        problem, budget=0.1, method=LocalSearch(count, np.random.default_rng(1)), candidates=decoy_grid(problem, 6)
    )
    assert maker.decide(belief).privacy == pytest.approx(max(together.max(), 0.0), abs=1e-9)


def failed() -> None:
    """An error in the user's problem."""
    raise ZeroDivisionError


def interrupted() -> None:
    """Ctrl-C."""
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize(("fail", "error"), [(failed, ZeroDivisionError), (interrupted, KeyboardInterrupt)])
def test_an_error_at_one_start_or_an_interrupt_ends_all(fail: Callable[[], None], error: type[BaseException]) -> None:
    class Failing(MarkowitzProblem):
        """Fails, or is interrupted, at the twentieth slope."""

        calls = 0

        def cost_gradients(self, actions: np.ndarray) -> np.ndarray:
            self.calls += 1
            if self.calls == 20:
                fail()
            return super().cost_gradients(actions)

    problem, belief, limit = three_by_three(np.random.default_rng(0))
    failing = Failing(problem.means, problem.covariances, problem.risk_aversion)
    before = threading.active_count()
    with pytest.raises(error):
        privacies_by_start(failing, belief, MaximalObfuscation(), limit, LocalSearch(5, np.random.default_rng(1)))
    assert failing.calls < 100  # without it, some hundreds
    assert threading.active_count() == before
