"""What all decisions cost alike in a state changes no proof, however large it is; nor does the unit of costs."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from inscrutable import (
    Budget,
    ConvexProblem,
    CounterAdversarialDecisionMaker,
    DecisionProblem,
    DecisionStatus,
    FiniteProblem,
    GlobalSearch,
    KellyProblem,
    LinearProblem,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    consistent_beliefs,
    simplex,
)
from oracles import markets
from sizes import audited, instances, some
from strategies import OwnShares

CONSTANTS = [1e4, 1e6, 1e8, -1e6, -1e8]
SCALES = [1e-6, 1.0, 1e6]
SAME = 1e-5  # privacies of two searches of one optimum, whose budgets differ by 1e8 roundings
N_DECOYS = instances(300)
SLOW = ("growth", "smooth")
PROVEN = (DecisionStatus.PROVED, DecisionStatus.GAP_REACHED)


class Case(NamedTuple):
    """A problem for every constant (X,) and scale, a belief, and a budget at scale one."""

    of: Callable[..., DecisionProblem]
    belief: np.ndarray
    limit: float


def quadratic(rng, n_states, n_actions):
    market = markets.random_market(rng, n_states, n_actions)
    hessians, linear = 2 * market.risk_aversion * market.covariances, -market.means
    return lambda constants, scale: QuadraticProblem(
        scale * hessians, scale * linear, scale * constants, constraints=simplex(n_actions)
    )


def table(kind):
    def made(rng, n_states, n_actions):
        costs = rng.normal(size=(n_states, n_actions))
        return lambda constants, scale: kind(scale * (costs + constants[:, None]))

    return made


def growth(rng, n_states, n_actions):
    """Returns times e^c cost c less in every outcome; wealth below a millionth counts as that, so that it is not made less."""
    returns = np.exp(0.3 * rng.normal(size=(n_states, 4, n_actions)))
    shares = rng.dirichlet(np.ones(4), size=n_states)
    return lambda constants, scale: KellyProblem(returns * np.exp(2e-7 * np.abs(constants))[:, None, None], shares)


def smooth(rng, n_states, n_actions):
    """Σ exp(a_i'u + b_i) in functions that say nothing else of themselves."""
    slopes = rng.normal(size=(n_states, 3, n_actions))

    def of(constants, scale):
        return ConvexProblem.from_functions(
            lambda u: scale * (np.exp(slopes @ u).sum(axis=1) + constants),
            lambda u: scale * np.einsum("xk,xku->xu", np.exp(slopes @ u), slopes),
            simplex(n_actions),
            strictly_convex=True,
        )

    return of


KINDS = {
    "quadratic": quadratic,
    "linear": table(lambda costs: LinearProblem(costs, simplex(costs.shape[1]))),
    "finite": table(FiniteProblem),
    "table": table(OwnShares),
    "growth": growth,
    "smooth": smooth,
}


def drawn(rng, kind) -> Case:
    n_states, n_actions = 2 if kind in SLOW else int(rng.choice([2, 3])), int(rng.choice([2, 3, 4]))
    of = KINDS[kind](rng, n_states, n_actions)
    belief = rng.dirichlet(np.ones(n_states))
    plain = of(np.zeros(n_states), 1.0)
    spread = np.ptp(plain.state_costs(plain.solve(rng.dirichlet(np.ones(n_states), size=20))) @ belief)
    return Case(of, belief, float(rng.choice([0.03, 0.2, 0.6])) * max(float(spread), 0.01))


def proved(problem, belief, limit, lottery):
    budget = Budget.regret(limit)
    if lottery:
        made = ProbabilisticDecisionMaker(problem, budget=budget, certify=0.05).decide(belief)
        return made.expected_privacy, made.privacy_bound, made.status
    # A search that stops early states a wider bound, which must hold all the same.
    calls = 300 if audited() or not isinstance(problem, ConvexProblem) else 40
    method = GlobalSearch(certify=0.05, max_oracle_calls=calls)
    made = CounterAdversarialDecisionMaker(problem, budget=budget, method=method).decide(belief)
    return made.privacy, made.privacy_bound, made.status


def best_of_decoys(problem, belief, limit, rng):
    """The largest privacy of an affordable decision that is optimal for some belief."""
    decoys = rng.dirichlet(np.ones(belief.size), size=N_DECOYS)
    actions = problem.as_points(problem.solve(decoys))
    within = problem.state_costs(actions) @ belief - float(problem.optimal_cost(belief)) <= limit
    kept = np.unique(actions[within & problem.constraints.is_admissible(actions)], axis=0)
    return max((consistent_beliefs(problem, action).distance(belief) for action in kept), default=0.0)


@pytest.mark.parametrize("kind", some(list(KINDS), 2))
def test_a_large_constant_and_a_unit_change_no_proof(kind, fresh_rng):
    """Statuses stay, too, but where a user's functions lose the digits themselves: there a bound only widens."""
    first = int(fresh_rng.integers(2))  # a decision or a lottery; both where that takes no time
    for number in range(first, first + (1 if kind in SLOW else instances(6, least=2))):
        of, belief, limit = drawn(fresh_rng, kind)
        zero, lottery = np.zeros(belief.size), number % 2 == 1
        plain = of(zero, 1.0)
        reached = best_of_decoys(plain, belief, limit, fresh_rng)
        constants = fresh_rng.choice(CONSTANTS) * fresh_rng.choice([np.ones(belief.size), np.eye(belief.size)[0]])
        scale = float(fresh_rng.choice(SCALES)) if kind != "growth" else 1.0
        privacy, bound, status = proved(plain, belief, limit, lottery)
        assert bound >= reached - SAME
        for shift, unit in ((constants, scale),) if kind in SLOW else ((constants, 1.0), (zero, scale)):
            other, wider, other_status = proved(of(shift, unit), belief, limit * unit, lottery)
            shown = f"constants {shift}, unit {unit}, lottery {lottery}"
            assert wider >= max(reached, privacy) - SAME, shown
            assert other <= bound + SAME, shown
            if kind != "smooth":
                assert other == pytest.approx(privacy, abs=SAME), shown
                assert (other_status in PROVEN) == (status in PROVEN), shown


@pytest.mark.parametrize("constant", CONSTANTS)
def test_regrets_are_those_without_the_constant(constant):
    rng = np.random.default_rng(5)
    of = quadratic(rng, 3, 4)
    beliefs, actions = rng.dirichlet(np.ones(3), size=20), rng.dirichlet(np.ones(4), size=20)
    plain, moved = of(np.zeros(3), 1.0), of(np.full(3, constant), 1.0)
    np.testing.assert_array_equal(moved.regret(beliefs, actions), plain.regret(beliefs, actions))


def test_the_cheapest_choice_is_found_beside_a_large_cost_of_all():
    """Costs differ by a thousandth at a level where a share of 1e-12 is a ten-thousandth of that."""
    problem = FiniteProblem(np.array([[0.0, -1e-4, 1.0]]) + 2.0**29)
    assert problem.solve([1.0]) == 1
