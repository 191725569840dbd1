"""One step of the rule that keeps account of what the observer holds, against cone programmes and its own next step."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest

from inscrutable import Budget, FiniteProblem, PriceCalibration, Prior, SequentialDecisionMaker
from inscrutable.mechanisms.chains import BeliefChain

NO_PRICE = float("inf")


def drawn_case(
    rng: np.random.Generator, information: float, capped: bool
) -> tuple[SequentialDecisionMaker, float, float]:
    """A random finite problem on a belief that stays, the price of regret and that of information in loss per nat."""
    states, choices, count = int(rng.integers(2, 5)), int(rng.integers(2, 8)), int(rng.integers(2, 12))
    problem = FiniteProblem(rng.random((states, choices)))
    beliefs = rng.dirichlet(np.ones(states) * rng.choice([0.3, 1.0]), count)
    prior = Prior(beliefs, rng.dirichlet(np.ones(count)))
    regrets = beliefs @ problem.costs - (beliefs @ problem.costs).min(axis=1, keepdims=True)
    silence = float((prior.weights @ regrets).min())
    scale = 1.0 if np.isinf(information) else prior.error**2
    price = float(rng.choice([0.3, 1.0, 3.0, 10.0])) * scale / max(silence, 1e-3)
    cap = Budget.regret(float(np.quantile(regrets.max(axis=1), 0.5))) if capped else None
    chain = BeliefChain(prior, np.eye(count))
    told = information * prior.error**2 if np.isfinite(information) else information
    maker = SequentialDecisionMaker(
        problem,
        Budget.regret(silence),
        chain=chain,
        worst_regret=cap,
        calibration=PriceCalibration.at(price, told),
        rng=rng,
    )
    return maker, price, told


def value_of(maker: SequentialDecisionMaker, law: np.ndarray, rows: np.ndarray, price: float, told: float) -> float:
    """E L − s E ρ − λ I of a table of probabilities, written out."""
    joint = law[:, None] * rows
    played = joint.sum(axis=0)
    beliefs = maker.beliefs
    regret = (joint * maker.mechanism_for(Prior(beliefs, law)).regrets).sum()
    some = joint > 0
    information = (joint[some] * np.log((rows / np.where(played > 0, played, 1.0))[some])).sum()
    if np.isinf(told):
        return float(-price * regret - information)
    means = joint.T @ beliefs / np.where(played > 0, played, 1.0)[:, None]
    loss = law @ (beliefs**2).sum(axis=1) - played @ (means**2).sum(axis=1)
    return float(loss - price * regret - told * information)


def best_value(maker: SequentialDecisionMaker, law: np.ndarray, price: float, told: float) -> float:
    """The same of the table that a cone programme finds: no more than the best, which no table exceeds."""
    beliefs, regrets = maker.beliefs, maker.mechanism_for(Prior(maker.beliefs, law)).regrets
    rows = cp.Variable(regrets.shape, nonneg=True)
    joint = cp.multiply(np.tile(law[:, None], (1, regrets.shape[1])), rows)
    played = cp.sum(joint, axis=0)
    limits = [cp.sum(rows, axis=1) == 1]
    if maker.worst_regret is not None:
        limits.append(rows[regrets > maker.worst_regret.amount] == 0)
    information = cp.sum(cp.rel_entr(joint, cp.vstack([law[b] * played for b in range(len(law))])))
    gain = -price * cp.sum(cp.multiply(joint, regrets)) - (1.0 if np.isinf(told) else told) * information
    if np.isfinite(told):
        gain += law @ (beliefs**2).sum(axis=1)
        for m in range(regrets.shape[1]):
            gain -= cp.quad_over_lin(beliefs.T @ joint[:, m], played[m])
    problem = cp.Problem(cp.Maximize(gain), limits)
    problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-9, tol_gap_rel=1e-9, tol_feas=1e-9)
    found = np.maximum(rows.value, 0.0)
    if maker.worst_regret is not None:
        found[regrets > maker.worst_regret.amount] = 0.0
    return value_of(maker, law, found / found.sum(axis=1, keepdims=True), price, told)


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning:cvxpy")
@pytest.mark.parametrize("capped", [False, True])
@pytest.mark.parametrize("information", [NO_PRICE, 1.0, 0.1, 0.03, 0.0])
def test_a_step_is_as_good_as_a_cone_programme_finds(
    fresh_rng: np.random.Generator, information: float, capped: bool
) -> None:
    for _ in range(6):
        maker, price, told = drawn_case(fresh_rng, information, capped)
        law = maker.chain.prior.weights
        rows = maker.mechanism_for(maker.chain.prior).probabilities.toarray()
        np.testing.assert_allclose(rows.sum(axis=1), 1.0, atol=1e-12)
        if capped:
            assert maker.mechanism_for(maker.chain.prior).regrets[rows > 0].max() <= maker.worst_regret.amount + 1e-12
        found, best = value_of(maker, law, rows, price, told), best_value(maker, law, price, told)
        spread = 1.0 if np.isinf(told) else maker.chain.prior.error**2
        # A price of 0 is played as a thousandth of the prior loss, which costs at most that for every nat.
        lost = 1e-3 * np.log(len(law)) if information == 0.0 else 0.0
        assert found >= best - (lost + 1e-7) * spread - 1e-9


@pytest.mark.parametrize("capped", [False, True])
@pytest.mark.parametrize("information", [NO_PRICE, 1.0, 0.03, 0.0])
def test_on_a_belief_that_stays_nothing_is_revealed_twice(
    fresh_rng: np.random.Generator, information: float, capped: bool
) -> None:
    for _ in range(8):
        maker, *_ = drawn_case(fresh_rng, information, capped)
        first = maker.mechanism_for(maker.chain.prior)
        table = first.probabilities.toarray()
        for choice in np.flatnonzero(first.played(maker.chain.prior.weights) > 0):
            sequence = maker.begin()
            sequence.publish(first.actions[choice])
            held = sequence.observer.weights
            expected = maker.chain.prior.weights * table[:, choice]
            np.testing.assert_allclose(held, expected / expected.sum(), atol=1e-12)
            for _ in range(3):
                lottery = sequence.decide(maker.beliefs[int(held.argmax())])
                assert len(lottery.probabilities) == 1
                assert sequence.expected.bits <= 1e-12
                sequence.publish(first.actions[choice])
            np.testing.assert_allclose(sequence.observer.weights, held, atol=1e-12)
