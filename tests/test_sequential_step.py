"""One step of the rule that keeps account of what the observer holds, against cone programmes and its own next step."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import logsumexp

from inscrutable import Budget, FiniteProblem, MarkowitzProblem, PriceCalibration, Prior, SequentialDecisionMaker
from inscrutable.decision_makers.sequential.step import Prices, StepRule
from inscrutable.mechanisms.chains import BeliefChain
from sizes import instances

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
    points = beliefs - law @ beliefs  # nearly equal beliefs: no digits are lost to what they share
    means = joint.T @ points / np.where(played > 0, played, 1.0)[:, None]
    loss = law @ (points**2).sum(axis=1) - played @ (means**2).sum(axis=1)
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
    for size in (1.0, maker.chain.prior.error**2):  # of another size where it does not solve it
        try:
            problem = cp.Problem(cp.Maximize(gain / size), limits)
            problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-9, tol_gap_rel=1e-9, tol_feas=1e-9)
            break
        except cp.SolverError:
            continue
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
    for _ in range(instances(6, least=2)):
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


@pytest.mark.parametrize("nats", [30.0, 300.0])
def test_steps_over_two_states_and_many_candidates_are_optimal(fresh_rng: np.random.Generator, nats: float) -> None:
    """Nearly alike candidates enter one after the other, in up to some hundred rounds; no log c_m is left above zero."""
    shares = np.linspace(0.0, 1.0, 21)
    beliefs = np.column_stack([shares, 1.0 - shares])
    prior = Prior(beliefs, np.full(21, 1 / 21))
    for _ in range(instances(16, least=2)):
        factors = fresh_rng.normal(size=(2, 4, 4))
        spread = 0.01 * (factors @ factors.swapaxes(1, 2) / 4 + 0.3 * np.eye(4))
        problem = MarkowitzProblem(0.02 * fresh_rng.normal(size=(2, 4)), spread, 5.0)
        costs = problem.optimal_cost(beliefs)
        price = nats / float(problem.optimal_cost(prior.mean) - prior.weights @ costs)
        maker = SequentialDecisionMaker(
            problem,
            0.1,
            chain=BeliefChain(prior, np.eye(21)),
            calibration=PriceCalibration.at(price, NO_PRICE),
            rng=fresh_rng,
        )
        mechanism = maker.mechanism_for(prior)
        rows, powers = mechanism.probabilities.toarray(), np.exp(-price * mechanism.regrets)
        played = prior.weights @ rows
        sums = powers @ played
        assert (prior.weights / sums @ powers).max() <= 1.0 + 1e-6
        np.testing.assert_allclose(rows, powers * played / sums[:, None], atol=1e-6)


def test_estimates_of_decisions_that_do_not_enter_are_found_between_two_beliefs() -> None:
    """At a small price log c_m is almost the largest of some quadratics; Newton's steps went from one to the other."""
    costs = [[0.861, 0.431, 0.468, 0.302], [0.256, 0.907, 0.741, 0.898], [0.998, 0.594, 0.188, 0.313]]
    some = [[0.043, 0.895], [0.211, 0.712], [0.208, 0.582], [0.26, 0.662], [0.816, 0.084], [0.384, 0.452]]
    beliefs = np.column_stack([some, 1.0 - np.sum(some, axis=1)])
    prior, price, told = Prior(beliefs, [0.322, 0.227, 0.029, 0.295, 0.036, 0.091]), 1.313, 1.627e-4
    maker = SequentialDecisionMaker(
        FiniteProblem(costs),
        Budget.regret(0.1),
        chain=BeliefChain(prior, np.eye(6)),
        calibration=PriceCalibration.at(price, told),
        rng=np.random.default_rng(0),
    )
    rows = maker.mechanism_for(prior).probabilities.toarray()
    np.testing.assert_allclose(rows.max(axis=0).sum(), 1.0, atol=1e-12)  # one decision whatever the belief
    found, best = value_of(maker, prior.weights, rows, price, told), best_value(maker, prior.weights, price, told)
    assert found >= best - 1e-7


@pytest.mark.parametrize("capped", [False, True])
@pytest.mark.parametrize("information", [NO_PRICE, 1.0, 0.03, 0.0])
def test_on_a_belief_that_stays_nothing_is_revealed_twice(
    fresh_rng: np.random.Generator, information: float, capped: bool
) -> None:
    for _ in range(instances(8, least=2)):
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


def dual_gap(maker: SequentialDecisionMaker, law: np.ndarray, price: float, told: float) -> float:
    """How far a step's value is from the optimum at most, in units of λ: no code is shared with the solver.

    Any z_b > 0 and estimates μ_m bound the optimum by λ (Σ p log z + log max_m Σ p e^{a_m} / z); here those of the played K.
    """
    mechanism = maker.mechanism_for(Prior(maker.beliefs, law))
    rows, regrets, beliefs = mechanism.probabilities.toarray(), mechanism.regrets, maker.beliefs
    joint = law[:, None] * rows
    played = joint.sum(axis=0)
    some = np.flatnonzero(played > 0)

    def offers(choice: int, estimate: np.ndarray) -> np.ndarray:
        return (((beliefs - estimate) ** 2).sum(axis=1) - price * regrets[:, choice]) / told

    means = joint.T @ beliefs / np.where(played > 0, played, 1.0)[:, None]
    log_z = logsumexp([np.log(played[m]) + offers(m, means[m]) for m in some], axis=0)
    held = law > 0
    least = []
    for choice in range(regrets.shape[1]):

        def gain(estimate: np.ndarray, choice: int = choice) -> float:
            return float(logsumexp((offers(choice, estimate) - log_z)[held], b=law[held]))

        starts = [means[choice]] if played[choice] > 0 else means[some]
        least.append(min(gain(start) for start in starts))
        if not played[choice] > 0:
            least[-1] = min(least[-1], *(float(minimize(gain, start, tol=1e-12).fun) for start in starts))
    return float(law @ log_z) + max(least) - value_of(maker, law, rows, price, told) / told


def test_a_law_of_a_decision_that_had_become_nothing_comes_back() -> None:
    """A decision left at a law of 0 was lost for ever, though it tempted by 20 nats: a step off by six times the prior loss."""
    costs = [[0.04, 0.17, 0.90, 0.95, 0.86], [0.72, 0.11, 0.79, 0.87, 0.10], [0.73, 0.52, 0.18, 0.20, 0.95]]
    beliefs = np.array([
        [0.471723378, 0.523225567, 0.005051055],
        [0.934955829, 0.0553735247, 0.0096706463],
        [8.18853350e-07, 0.0113601620, 0.98863901914665],
        [0.686705434, 0.0593601809, 0.2539343851],
    ])  # fmt: skip
    prior = Prior(beliefs, [0.20141312, 1.08658519e-05, 0.2575074441481, 0.54106857])
    problem = FiniteProblem(costs)
    regrets = beliefs @ problem.costs - (beliefs @ problem.costs).min(axis=1, keepdims=True)
    unit = prior.error**2
    price, told = 10.0 * unit / float((prior.weights @ regrets).min()), 0.3 * unit
    chain = BeliefChain(prior, np.eye(4))
    given = {"chain": chain, "calibration": PriceCalibration.at(price, told), "rng": np.random.default_rng(0)}
    maker = SequentialDecisionMaker(problem, Budget.regret(0.1), **given)
    assert dual_gap(maker, prior.weights, price, told) <= 1e-7
    rows = maker.mechanism_for(prior).probabilities.toarray()
    found, best = value_of(maker, prior.weights, rows, price, told), best_value(maker, prior.weights, price, told)
    assert found >= best - 1e-7 * unit


@pytest.mark.parametrize("information", [1.0, 0.1, 0.03])
def test_steps_of_uneven_laws_are_solved_to_their_dual_bound(
    fresh_rng: np.random.Generator, information: float
) -> None:
    for _ in range(instances(12, least=2)):
        maker, price, told = drawn_case(fresh_rng, information, False)
        law = fresh_rng.dirichlet(np.full(len(maker.beliefs), 0.1))
        law = np.where(law > 1e-6, law, 0.0)
        assert dual_gap(maker, law / law.sum(), price, told) <= 1e-6


@pytest.mark.parametrize("information", [NO_PRICE, 1.0, 0.1, 0.03])
def test_a_step_begun_from_another_one_is_as_good(fresh_rng: np.random.Generator, information: float) -> None:
    for _ in range(instances(12, least=5)):
        maker, price, told = drawn_case(fresh_rng, information, False)
        rule = StepRule(maker.table, Prices(price, told))
        laws = fresh_rng.dirichlet(np.full(len(maker.beliefs), 0.5), 2)
        begun, cold = rule.step(laws[1], near=rule.step(laws[0])), rule.step(laws[1])
        values = [
            value_of(maker, laws[1], rule.mechanism(step).probabilities.toarray(), price, told)
            for step in (begun, cold)
        ]
        assert abs(values[0] - values[1]) <= 1e-7 * (1.0 if np.isinf(told) else maker.chain.prior.error**2)


@pytest.mark.parametrize("seed", [4, 15])
def test_where_a_constant_decision_costs_nothing_no_rule_beats_it(seed: int) -> None:
    """Its regret is rounding alone, beyond a budget of zero: no price of regret may be read from it."""
    maker, *_ = drawn_case(np.random.default_rng([23, seed]), 0.3, True)
    assert maker.limit == 0.0
    assert 0.0 < (maker.chain.prior.weights @ maker.table.regrets).min() < 1e-15
    assert maker.ceiling == maker.table.prior_loss
