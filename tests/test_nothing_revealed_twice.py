"""While rule and observer both know that the belief stays, the second decision tells nothing, and no later one does.

With ψ_u(p) = L(p) + λ H(p) − s Σ p ρ(·,u) the best mechanism at p reaches the concave envelope of max_u ψ_u. After u the
posterior lies where ψ_u touches that envelope, so that from there playing u for certain is as good as anything. The observer,
the objective and the optimum by a cone programme are written here.
"""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import cvxpy as cp
import numpy as np
import pytest

from inscrutable import Budget, FiniteProblem, PriceCalibration, Prior, SequentialDecisionMaker
from inscrutable.mechanisms.chains import resting_chain
from sizes import audited, instances, paired, some

GAP = 2e-6
"""What the cone programme resolves, relative to the prior's loss."""

LEAST = 1e-3
"""Price of information, in prior losses, below which the rule takes this one."""

N_CHOICES = 4


class Step:
    """One step as a programme: a law of the belief, what each decision costs there, and the two prices."""

    def __init__(
        self, beliefs: np.ndarray, regrets: np.ndarray, allowed: np.ndarray, prices: tuple[float, float]
    ) -> None:
        self.beliefs, self.regrets, self.allowed = beliefs, regrets, allowed
        self.slope, self.price = prices
        # Information alone: in nats, without the observer's loss.
        self.weighs_loss = np.isfinite(self.price)

    def value(self, law: np.ndarray, table: np.ndarray) -> float:
        """E L(p_u) − s E ρ − λ I, or −s E ρ − I."""
        joint = law[:, None] * table
        played = joint.sum(axis=0)
        some = joint > 0
        ratio = joint[some] / (law[:, None] * played)[some]
        found = -self.slope * float((joint * self.regrets).sum())
        found -= (self.price if self.weighs_loss else 1.0) * float(joint[some] @ np.log(ratio))
        return found + (expected_loss(self.beliefs, joint) if self.weighs_loss else 0.0)

    def best(self, law: np.ndarray) -> float:
        """An upper bound of the value of any mechanism, which the optimum attains.

        For all multipliers v and estimates x_u with Σ_b p_b exp((|π_b − x_u|² − s ρ_bu)/λ − v_b) ≤ 1 for every decision u the
        bound is λ Σ p v; without a price it is Σ p max_u (|π_b − x_u|² − s ρ_bu). A cone programme finds v and x; what it
        leaves of the constraints is added, so that the bound holds however it ended.
        """
        some = law > 0
        law, points, regrets, allowed = law[some], self.beliefs[some], self.regrets[some], self.allowed[some]
        price = self.price if self.weighs_loss else 1.0
        unit, values, rules, estimates = price or 1.0, cp.Variable(len(law)), [], {}
        for u in np.flatnonzero(allowed.any(axis=0)):
            mine = np.flatnonzero(allowed[:, u])
            gains = -self.slope * regrets[mine, u] / unit - values[mine]
            estimates[u] = cp.Variable(points.shape[1])
            if self.weighs_loss:
                gains = gains + cp.hstack([cp.sum_squares(points[b] - estimates[u]) / unit for b in mine])
            rules.append(cp.log_sum_exp(np.log(law[mine]) + gains) <= 0 if price > 0 else gains <= 0)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of an inaccurate end
            cp.Problem(cp.Minimize(law @ values), rules).solve(solver=cp.CLARABEL)
        gains = np.where(allowed, -self.slope * regrets, -np.inf)
        for u, estimate in estimates.items():
            gains[:, u] += ((points - estimate.value) ** 2).sum(axis=1) if self.weighs_loss else 0.0
        if price == 0:
            return float(law @ gains.max(axis=1))
        left = np.log((law[:, None] * np.exp(gains / price - values.value[:, None])).sum(axis=0).max())
        return price * float(law @ values.value + left)


def expected_loss(beliefs: np.ndarray, joint: np.ndarray) -> float:
    """E‖π − E[π|u]‖² of the one who sees u."""
    played = joint.sum(axis=0)
    some = played > 0
    means = (joint.T @ beliefs)[some] / played[some, None]
    return float(joint.sum(axis=1) @ (beliefs**2).sum(axis=1) - played[some] @ (means**2).sum(axis=1))


def bits_told(law: np.ndarray, table: np.ndarray) -> float:
    joint = law[:, None] * table
    some = joint > 0
    return float(joint[some] @ np.log2(joint[some] / (law[:, None] * joint.sum(axis=0))[some]))


def rows(sequence: Any, beliefs: np.ndarray) -> np.ndarray:
    """What the rule plays now on every belief."""
    table = np.zeros((len(beliefs), N_CHOICES))
    for row, belief in zip(table, beliefs, strict=True):
        lottery = sequence.decide(belief)
        np.add.at(row, np.asarray(lottery.actions, dtype=int), lottery.probabilities)
    return table


class Instance(NamedTuple):
    """A small problem, a prior, what each decision costs, which a cap leaves, and the rule at two prices."""

    prior: Prior
    regrets: np.ndarray
    allowed: np.ndarray
    prices: tuple[float, float]
    rule: SequentialDecisionMaker

    def step(self, price: float | None = None) -> Step:
        slope, own = self.prices
        return Step(self.prior.beliefs, self.regrets, self.allowed, (slope, own if price is None else price))


def instance(rng: np.random.Generator, share: float, *, capped: bool) -> Instance:
    """`share` is the price of information in prior losses; the price of regret makes the first decision tell something."""
    costs = rng.random((3, N_CHOICES))
    beliefs, weights = rng.dirichlet(np.full(3, 0.6), 5), rng.dirichlet(np.full(5, 3.0))
    prior, problem = Prior(beliefs, weights), FiniteProblem(costs)
    regrets = beliefs @ costs - (beliefs @ costs).min(axis=1, keepdims=True)
    cap = float(np.quantile(regrets, 0.7)) if capped else np.inf
    unit = 1.0 if np.isinf(share) else prior.error**2
    prices = 8.0 * unit / float(weights @ regrets.mean(axis=1)), share * unit
    rule = SequentialDecisionMaker(
        problem,
        Budget.regret(1.0),
        chain=resting_chain(prior, 1.0),
        information_price=prices[1],
        worst_regret=Budget.regret(cap) if capped else None,
        calibration=PriceCalibration.at(*prices),
        rng=rng,
    )
    return Instance(prior, regrets, regrets <= cap, prices, rule)


@pytest.mark.parametrize(("share", "capped"), paired([LEAST, 0.1, np.inf], [False, True]))
def test_the_second_decision_tells_nothing(share: float, capped: bool, fresh_rng: np.random.Generator) -> None:
    told = drawn = 0
    while drawn < instances(5, least=1) or not told:  # some rules tell nothing in their first decision
        drawn += 1
        held = instance(fresh_rng, share, capped=capped)
        law, beliefs, step = held.prior.weights, held.prior.beliefs, held.step()
        allowed_gap = GAP * (1.0 if np.isinf(share) else held.prior.error**2)
        first = rows(held.rule.begin(), beliefs)
        np.testing.assert_allclose(first.sum(axis=1), 1.0, atol=1e-12)
        assert (first[~held.allowed] == 0).all()
        assert step.value(law, first) >= step.best(law) - allowed_gap
        told += bits_told(law, first) > 1e-3
        joint = law[:, None] * first
        for u in np.flatnonzero(joint.sum(axis=0) > 0):
            after = joint[:, u] / joint[:, u].sum()
            # To stay is optimal, as the cone programme finds, ...
            sure = np.tile(np.eye(N_CHOICES)[u], (len(after), 1))
            assert held.allowed[after > 0, u].all()
            assert step.value(after, sure) >= step.best(after) - allowed_gap
            # ... and the rule stays.
            sequence = held.rule.begin()
            sequence.publish(int(u))
            second = rows(sequence, beliefs)
            assert bits_told(after, second) < 1e-12
            np.testing.assert_allclose(second[after > 0, u], 1.0, atol=1e-12)
            # Lotteries leave out what is played more rarely than once in a thousand million times.
            np.testing.assert_allclose(sequence.observer.weights, after, atol=1e-8)


@pytest.mark.parametrize("capped", [False, True])
def test_without_a_price_of_information_the_error_alone_counts(capped: bool, fresh_rng: np.random.Generator) -> None:
    """The least price that is taken moves the value by no more than that price times the most that can be told."""
    for _ in range(3):
        held = instance(fresh_rng, 0.0, capped=capped)
        law, step = held.prior.weights, held.step(0.0)
        first = rows(held.rule.begin(), held.prior.beliefs)
        assert step.value(law, first) >= step.best(law) - LEAST * held.prior.error**2 * np.log(N_CHOICES) - 1e-9


@pytest.mark.parametrize("share", some([np.inf, 0.0, 0.1], 2))
def test_after_a_hundred_decisions_the_error_is_that_after_one(share: float, fresh_rng: np.random.Generator) -> None:
    held = instance(fresh_rng, share, capped=False)
    beliefs = held.prior.beliefs
    for place in fresh_rng.choice(len(beliefs), size=instances(2, least=1), replace=False):
        sequence, law, means = held.rule.begin(), held.prior.weights, []
        for _ in range(100 if audited() else 25):
            table = rows(sequence, beliefs)
            u = int(fresh_rng.choice(N_CHOICES, p=table[place] / table[place].sum()))
            law = law * table[:, u]
            law = law / law.sum()
            means.append(law @ beliefs)
            sequence.publish(u)
        np.testing.assert_allclose(means, np.tile(means[0], (len(means), 1)), atol=1e-12)
