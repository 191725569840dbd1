"""Two states: every decision is compared with all supports at 50,001 beliefs, solved without the library."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    DesiredObfuscation,
    MarkowitzProblem,
    MaximalObfuscation,
    consistent_beliefs,
    decoy_grid,
)
from oracles import enumeration, markets
from oracles.markets import Market
from sizes import audited, instances

Array = NDArray[np.float64]

MIN_SLACK = 1e-4
FINE = np.linspace(0.0, 1.0, 50_001)
SHARES = FINE if audited() else FINE[::10]
HALVINGS = 60
ROUNDING = 1e-12

# The optimal decision is the second asset alone up to t = .937; beyond, a little of the first is held, and soon too much.
NARROW = Market(
    np.array([[-0.122, -0.106], [-0.933, 0.288]]),
    np.array([[[0.0246, 0.0127], [0.0127, 0.0428]], [[0.777, 0.264], [0.264, 0.17]]]),
    2.045,
)
NARROW_BELIEF, NARROW_BUDGET = np.array([0.5877, 0.4123]), 4e-4


class Explained(NamedTuple):
    """What is affordable and admissible on one support: shares t of decoys, or what explains a single asset."""

    shares: Array
    is_shared: bool  # by all beliefs between the least and the largest share

    def distance(self, point: Array) -> Array:
        nearest = np.clip(point[0], self.shares.min(), self.shares.max()) if self.is_shared else self.shares
        return np.asarray(np.sqrt(2.0) * np.abs(nearest - point[0]))


def explained(market: Market, belief: Array, budget: float, shares: Array = SHARES) -> list[Explained]:
    """Everything that some belief of the grid `shares` explains, support by support.

    Where a share beside one that will not do is allowed, the border between them is found by halving.
    """
    allowed = enumeration.value(market, belief)[0] + budget
    found = []
    for held in enumeration.supports(market.means.shape[1]):
        if len(held) == 1:
            found += _single(market, belief, allowed, held[0])
            continue
        fits = _fits(market, belief, allowed, held, shares)
        edges = np.flatnonzero(fits[1:] != fits[:-1])
        good = np.where(fits[edges], shares[edges], shares[edges + 1])
        bad = np.where(fits[edges], shares[edges + 1], shares[edges])
        for _ in range(HALVINGS if len(edges) else 0):
            middle = 0.5 * (good + bad)
            fine = _fits(market, belief, allowed, held, middle)
            good, bad = np.where(fine, middle, good), np.where(fine, bad, middle)
        if fits.any():
            found.append(Explained(np.concatenate([shares[fits], good]), False))
    return found


def farthest(found: list[Explained], point: Array) -> float:
    return float(max((each.distance(point).max() for each in found), default=-np.inf))


def nearest(found: list[Explained], point: Array) -> float:
    return float(min((each.distance(point).min() for each in found), default=np.inf))


def _fits(market: Market, belief: Array, allowed: float, held: list[int], shares: Array) -> np.ndarray:
    """Whether the decision of each share is held in these assets, optimal, admissible and affordable."""
    means, covariances, risk_aversion = market
    size, n = len(held), means.shape[1]
    beliefs = np.column_stack([shares, 1.0 - shares])
    bends = 2.0 * risk_aversion * np.tensordot(beliefs, covariances, axes=1)
    system = np.zeros((len(shares), size + 1, size + 1))
    system[:, :size, :size] = bends[:, np.array(held)[:, None], held]
    system[:, :size, size] = system[:, size, :size] = 1.0
    right = np.concatenate([(beliefs @ means)[:, held], np.ones((len(shares), 1))], axis=1)
    if np.linalg.cond(system[len(shares) // 2]) > 1e10:
        return np.zeros(len(shares), dtype=bool)
    actions = np.zeros((len(shares), n))
    actions[:, held] = np.linalg.solve(system, right[..., None])[:, :size, 0]
    slopes = np.einsum("tij,tj->ti", bends, actions) - beliefs @ means
    rest = [asset for asset in range(n) if asset not in held]
    priced = (slopes[:, rest] - slopes[:, held[:1]]).min(axis=1, initial=np.inf) >= 0.0
    own = risk_aversion * np.tensordot(belief, covariances, axes=1)
    costs = ((actions @ own) * actions).sum(axis=1) - actions @ (belief @ means)
    return (actions[:, held].min(axis=1) >= MIN_SLACK) & priced & (costs <= allowed)


def _single(market: Market, belief: Array, allowed: float, asset: int) -> list[Explained]:
    """One asset: its slope is the least of all on an interval of shares."""
    action = np.eye(market.means.shape[1])[asset]
    slopes = markets.gradients(market, action).T
    spare = slopes - slopes[:, [asset]]
    low, high = 0.0, 1.0
    for first, second in spare.T:
        if first == second:
            if first < 0.0:
                return []
            continue
        border = second / (second - first)  # t·first + (1−t)·second = 0
        low, high = (max(low, border), high) if first > second else (low, min(high, border))
    if low > high or belief @ markets.costs(market, action) > allowed + ROUNDING:
        return []
    return [Explained(np.array([low, high]), True)]


def draw(seed: int) -> tuple[Market, Array, float]:
    """Two to four assets, some copied; beliefs inside and at the corners; budgets from almost nothing to plenty."""
    rng = np.random.default_rng([7, seed])
    n_assets = int(rng.choice([2, 3, 4]))
    market = markets.random_market(
        rng, 2, n_assets, positive_value=bool(seed % 2), scale_spread=float(seed % 3 == 0), duplicate=seed % 5 == 0
    )
    belief = np.eye(2)[seed % 2] if seed % 6 == 0 else rng.dirichlet([0.7, 0.7])
    return market, belief, float(rng.choice([1e-5, 3e-4, 0.003, 0.03, 0.3])) * abs(enumeration.value(market, belief)[0])


@pytest.mark.parametrize("seed", range(instances(60)))
def test_no_decision_that_enumeration_reaches_is_missed(seed: int) -> None:
    market, belief, budget = draw(seed)
    problem = MarkowitzProblem(*market)
    target = np.array([0.15, 0.85]) if seed % 2 else np.array([0.9, 0.1])
    grid, found = decoy_grid(problem, 50), explained(market, belief, budget)
    best = (farthest(found, belief), -nearest(found, target))
    for measure, reached in zip((MaximalObfuscation(), DesiredObfuscation(target)), best, strict=True):
        decision = CounterAdversarialDecisionMaker(problem, measure, Budget.regret(budget), candidates=grid).decide(
            belief
        )
        assert decision.regret <= budget + ROUNDING
        expected = measure(belief, consistent_beliefs(problem, decision.action))
        assert decision.privacy == pytest.approx(expected, abs=2e-7)
        if decision.status is DecisionStatus.POLISHED:
            assert problem.constraints.is_admissible(decision.action)
        assert decision.privacy >= reached - 1e-6


def test_a_narrow_stretch_beyond_the_beliefs_that_share_a_corner_is_found() -> None:
    problem = MarkowitzProblem(*NARROW)
    best = farthest(explained(NARROW, NARROW_BELIEF, NARROW_BUDGET, FINE), NARROW_BELIEF)
    decision = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(NARROW_BUDGET)).decide(NARROW_BELIEF)
    assert problem.solve(NARROW_BELIEF)[0] == 0.0
    assert 0.0 < decision.action[0] < 1e-3
    assert decision.privacy == pytest.approx(best, abs=1e-6)
    assert best > 0.4


@pytest.mark.parametrize("n_assets", [1, 2])
def test_states_that_cost_the_same_hide_nothing_and_one_asset_says_nothing(n_assets: int) -> None:
    market = markets.random_market(np.random.default_rng(1), 1, n_assets)
    problem = MarkowitzProblem(np.repeat(market.means, 2, axis=0), np.repeat(market.covariances, 2, axis=0), 1.0)
    decision = CounterAdversarialDecisionMaker(problem).decide([0.3, 0.7])
    assert decision.privacy == pytest.approx(0.0, abs=1e-9)
    assert decision.status is DecisionStatus.NO_AFFORDABLE_PRIVACY
    wished = CounterAdversarialDecisionMaker(problem, DesiredObfuscation([0.9, 0.1])).decide([0.3, 0.7])
    assert wished.privacy == pytest.approx(0.0, abs=1e-9)


def test_a_state_without_risk() -> None:
    means = np.array([[0.1, 0.2, 0.05], [0.3, 0.1, 0.0]])
    risk = np.array([[0.3, 0.1, 0.0], [0.1, 0.2, 0.05], [0.0, 0.05, 0.4]])
    problem = MarkowitzProblem(means, np.array([np.zeros((3, 3)), risk]), 2.0)
    decision = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(0.01)).decide([0.4, 0.6])
    assert decision.privacy == pytest.approx(
        consistent_beliefs(problem, decision.action).distance([0.4, 0.6]), abs=1e-7
    )
    assert decision.regret <= 0.01
