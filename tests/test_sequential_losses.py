"""The sequential rule against a rival with a decision of its own: cone and linear programmes, closed forms, and copying."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import linprog

from inscrutable import (
    Budget,
    FiniteProblem,
    InputError,
    MarkowitzProblem,
    NamingError,
    PathDecisions,
    PriceCalibration,
    Prior,
    RivalProblem,
    SequentialDecisionMaker,
    SquaredError,
    delayed,
    every,
)
from inscrutable.mechanisms.chains import BeliefChain, resting_chain
from inscrutable.privacy import Loss
from sizes import audited, instances
from small_runs import draft_simulations


def answers_of(loss: Loss, n_states: int) -> np.ndarray:
    """What each answer costs the rival in each state, shape (X,A)."""
    return loss.problem.costs if isinstance(loss, RivalProblem) else 1.0 - np.eye(n_states)


def drawn_maker(
    rng: np.random.Generator, *, told: float = 0.1, stays: float | None = None, disclosure=None, own: bool = False
) -> SequentialDecisionMaker:
    """A random finite problem on a chain that rests, and a rival of whom nothing is known but that the belief matters to it."""
    states, choices, count = int(rng.integers(2, 5)), int(rng.integers(2, 6)), int(rng.integers(3, 10))
    while True:
        problem = FiniteProblem(rng.random((states, choices)))
        prior = Prior(rng.dirichlet(np.full(states, 0.4), count), rng.dirichlet(np.ones(count)))
        loss: Loss = (
            NamingError() if rng.random() < 0.3 else RivalProblem(FiniteProblem(3.0 * rng.normal(size=(states, 4))))
        )
        loss = RivalProblem(problem) if own else loss
        chain = resting_chain(prior, float(rng.uniform(0.3, 0.9)) if stays is None else stays)
        schedule = every(1).schedule if disclosure is None else disclosure.schedule
        secret = 0.0
        for late in range(schedule.lag, schedule.lag + schedule.period):
            gains = np.linalg.matrix_power(chain.transition.toarray(), late) @ prior.beliefs @ answers_of(loss, states)
            secret += ((prior.weights @ gains).min() - prior.weights @ gains.min(axis=1)) / schedule.period
        regrets = prior.beliefs @ problem.costs
        silence = float((prior.weights @ (regrets - regrets.min(axis=1, keepdims=True))).min())
        if secret > 0.01 and silence > 0.02:
            break
    price = float(rng.choice([0.3, 1.0, 3.0])) * secret / silence
    return SequentialDecisionMaker(
        problem,
        Budget.regret(0.5 * silence),
        chain=chain,
        loss=loss,
        disclosure=disclosure,
        calibration=PriceCalibration.at(price, told * secret),
        rng=rng,
    )


def loss_of_tables(maker: SequentialDecisionMaker, joint: np.ndarray) -> float:
    """Σ_m of what the rival loses after each decision, mean over the steps in which it is the latest known."""
    schedule, total = maker.disclosure.schedule, 0.0
    gains = maker.beliefs @ answers_of(maker.loss, maker.problem.n_states)
    step = maker.chain.transition.toarray() if hasattr(maker.chain.transition, "toarray") else maker.chain.transition
    for late in range(schedule.lag, schedule.lag + schedule.period):
        total += (joint.T @ np.linalg.matrix_power(step, late) @ gains).min(axis=1).sum()
    return float(total / schedule.period)


def value_of(maker: SequentialDecisionMaker, law: np.ndarray, rows: np.ndarray) -> float:
    """E L − s E ρ − λ I of a table, written out."""
    joint = law[:, None] * rows
    played, some = joint.sum(axis=0), joint > 0
    information = (joint[some] * np.log((rows / np.where(played > 0, played, 1.0))[some])).sum()
    prices = maker.calibration.prices(0)
    paid = prices.regret * (joint * maker.mechanism_for(Prior(maker.beliefs, law)).regrets).sum()
    return loss_of_tables(maker, joint) - float(paid + prices.information * information)


def best_value(maker: SequentialDecisionMaker, law: np.ndarray) -> float:
    """The same of the table that a cone programme finds."""
    regrets, prices = maker.mechanism_for(Prior(maker.beliefs, law)).regrets, maker.calibration.prices(0)
    gains = maker.beliefs @ answers_of(maker.loss, maker.problem.n_states)
    step, schedule = maker.chain.transition, maker.disclosure.schedule
    step = step.toarray() if hasattr(step, "toarray") else step
    rows = cp.Variable(regrets.shape, nonneg=True)
    joint = cp.multiply(np.tile(law[:, None], (1, regrets.shape[1])), rows)
    played = cp.sum(joint, axis=0)
    gain = -prices.regret * cp.sum(cp.multiply(joint, regrets))
    gain -= prices.information * cp.sum(cp.rel_entr(joint, cp.vstack([law[b] * played for b in range(len(law))])))
    for late in range(schedule.lag, schedule.lag + schedule.period):
        for m in range(regrets.shape[1]):
            gain += cp.min((np.linalg.matrix_power(step, late) @ gains).T @ joint[:, m]) / schedule.period
    cp.Problem(cp.Maximize(gain), [cp.sum(rows, axis=1) == 1]).solve(solver=cp.CLARABEL)
    found = np.maximum(rows.value, 0.0)
    return value_of(maker, law, found / found.sum(axis=1, keepdims=True))


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize("disclosure", [None, delayed(2), every(2)], ids=str)
@pytest.mark.parametrize("told", [1.0, 0.1, 0.01, 0.001])
def test_a_step_is_as_good_as_a_cone_programme_finds(fresh_rng: np.random.Generator, told: float, disclosure) -> None:
    for _ in range(instances(4, least=2)):
        maker = drawn_maker(fresh_rng, told=told, disclosure=disclosure)
        law = maker.chain.prior.weights
        rows = maker.mechanism_for(maker.chain.prior).probabilities.toarray()
        np.testing.assert_allclose(rows.sum(axis=1), 1.0, atol=1e-12)
        unit = maker.table.unit
        assert value_of(maker, law, rows) >= best_value(maker, law) - 2e-5 * unit
        figures = maker.begin().expected
        assert figures.loss == pytest.approx(loss_of_tables(maker, law[:, None] * rows), abs=1e-9)


@pytest.mark.parametrize("told", [1.0, 0.03, 0.001])
def test_on_a_belief_that_stays_nothing_is_revealed_twice(fresh_rng: np.random.Generator, told: float) -> None:
    for _ in range(6):
        maker = drawn_maker(fresh_rng, told=told, stays=1.0)
        first = maker.mechanism_for(maker.chain.prior)
        for choice in np.flatnonzero(first.played(maker.chain.prior.weights) > 1e-6):
            sequence = maker.begin()
            sequence.publish(first.actions[choice])
            held = sequence.observer.weights
            for _ in range(2):
                lottery = sequence.decide(maker.beliefs[int(held.argmax())])
                assert len(lottery.probabilities) == 1
                assert sequence.expected.bits <= 1e-12
                sequence.publish(first.actions[choice])
            np.testing.assert_allclose(sequence.observer.weights, held, atol=1e-12)


@pytest.mark.parametrize("told", [1.0, 0.05, 0.001])
def test_nobody_can_be_stopped_from_copying(fresh_rng: np.random.Generator, told: float) -> None:
    """At every step: what is given up and what is taken are together at least what the secret is worth then."""
    for _ in range(4):
        maker = drawn_maker(fresh_rng, told=told, own=True)
        sequence = maker.begin()
        for _ in range(5):
            sequence.observe()
            law = sequence.observer.weights
            costs = maker.beliefs @ maker.problem.costs
            secret = (law @ costs).min() - law @ costs.min(axis=1)
            taken = (law @ costs).min() - sequence.expected.loss
            assert -1e-9 <= taken <= secret + 1e-9
            assert taken + sequence.expected.regret >= secret - 1e-9
            lottery = sequence.decide(maker.beliefs[int(fresh_rng.choice(len(law), p=law))])
            sequence.publish(
                lottery.actions[int(fresh_rng.choice(len(lottery.probabilities), p=lottery.probabilities))]
            )


def largest_loss(maker: SequentialDecisionMaker, limit: float) -> float:
    """max E L with E ρ ≤ limit under the long-run law: a linear programme over tables and all answers."""
    law, regrets = maker.chain.prior.weights, maker.mechanism_for(maker.chain.prior).regrets
    gains = maker.beliefs @ answers_of(maker.loss, maker.problem.n_states)
    (count, n), n_answers = regrets.shape, gains.shape[1]
    below, sides = [np.append((law[:, None] * regrets).ravel(), np.zeros(n))], [limit]
    for m in range(n):
        for a in range(n_answers):
            row = np.zeros((count, n))
            row[:, m] = -law * gains[:, a]
            below.append(np.append(row.ravel(), np.eye(n)[m]))
            sides.append(0.0)
    whole = np.hstack([np.kron(np.eye(count), np.ones((1, n))), np.zeros((count, n))])
    found = linprog(
        np.append(np.zeros(count * n), -np.ones(n)),
        np.array(below),
        sides,
        whole,
        np.ones(count),
        [(0, None)] * (count * n) + [(None, None)] * n,
    )
    return float(-found.fun)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_the_ceiling_is_the_largest_loss_of_one_shot(fresh_rng: np.random.Generator, share: float) -> None:
    for _ in range(4):
        given = drawn_maker(fresh_rng)
        maker = SequentialDecisionMaker(
            given.problem,
            Budget.regret(2.0 * share * given.limit),
            chain=given.chain,
            loss=given.loss,
            calibration=given.calibration,
            rng=fresh_rng,
        )
        exact, unit = largest_loss(maker, maker.limit), maker.table.unit
        assert exact - 1e-9 <= maker.ceiling <= exact + 2e-3 * unit
        assert maker.ceiling <= maker.table.prior_loss + 1e-12


@pytest.mark.parametrize("regret", [0.1, 0.25, 0.4])
def test_two_states_alike_lose_what_is_given_up(regret: float) -> None:
    """Cost 1 for the wrong state, rival and agent alike: V1(r) = r, as much as is given up."""
    maker = SequentialDecisionMaker(
        FiniteProblem(1.0 - np.eye(2)),
        Budget.regret(regret),
        chain=resting_chain(Prior(np.eye(2), [0.5, 0.5]), 0.8),
        loss=NamingError(),
        calibration=PriceCalibration.at(1.0, 0.1),
        rng=np.random.default_rng(0),
    )
    assert maker.ceiling == pytest.approx(regret, abs=1e-4)


def answered(loss: Loss, beliefs: np.ndarray) -> np.ndarray:
    """What the answer to each belief costs the rival under each."""
    if isinstance(loss, RivalProblem):
        return beliefs @ loss.problem.state_costs(loss.problem.solve(beliefs)).T
    return 1.0 - beliefs


def calibrated(
    given: SequentialDecisionMaker, rng: np.random.Generator
) -> tuple[SequentialDecisionMaker, PathDecisions]:
    """A rule calibrated for a rival on beliefs that rest half of the time, which holds what its calibration says: on paths at
    each of its prices, of which it draws one."""
    told = 0.1 * given.table.unit
    with_rival = partial(SequentialDecisionMaker, given.problem, chain=given.chain, loss=given.loss, rng=rng)
    maker = with_rival(given.budget, information_price=told)
    found = maker.calibration
    assert found.regret <= maker.limit * 1.03
    at_spent = with_rival(Budget.regret(max(maker.limit, found.regret)), information_price=told)
    assert found.loss <= at_spent.ceiling + 4 * found.loss_se + 1e-3 * maker.table.unit
    places = maker.chain.paths(200 if audited() else 120, 1, rng=rng)[:, 0]
    at = [with_rival(given.budget, calibration=PriceCalibration.at(price, told)) for price in found.regret_prices]
    paths = [each.decide_path(each.beliefs[places], rng=rng) for each in at]
    mean = found.shares @ [path.losses.mean() for path in paths]
    # A belief that rests half of the time: steps weigh as a third of independent ones. What no step has met may be met once.
    possible = answered(maker.loss, maker.chain.prior.beliefs)
    spread = [np.sqrt(path.losses.var() + np.ptp(possible) ** 2 / len(places)) for path in paths]
    error = found.shares @ spread * np.sqrt(3.0 / len(places))
    assert mean == pytest.approx(found.loss, abs=5.0 * float(np.hypot(error, found.loss_se)))
    return maker, paths[0]


def test_a_calibrated_rule_spends_its_budget_and_stays_below_the_ceiling(fresh_rng: np.random.Generator) -> None:
    with draft_simulations():
        maker, path = calibrated(drawn_maker(fresh_rng, stays=0.5), fresh_rng)
    assert str(maker.loss) in maker.summary()
    assert str(maker.loss) in str(maker.calibration)
    assert path.losses.min() >= maker.loss.least(maker.beliefs).min() - 1e-9
    np.testing.assert_allclose(  # the rival's best answers to what it holds, written out
        path.losses, (path.observer_means @ answers_of(maker.loss, maker.problem.n_states)).min(axis=1), atol=1e-9
    )


def test_the_square_error_is_the_same_said_or_not(fresh_rng: np.random.Generator) -> None:
    given = drawn_maker(fresh_rng)
    makers = [
        SequentialDecisionMaker(
            given.problem, given.budget, chain=given.chain, loss=loss, calibration=given.calibration, rng=fresh_rng
        )
        for loss in (None, SquaredError())
    ]
    tables = [maker.mechanism_for(maker.chain.prior).probabilities.toarray() for maker in makers]
    np.testing.assert_array_equal(*tables)


def test_a_sequence_is_gone_on_with_against_the_same_rival(fresh_rng: np.random.Generator, tmp_path: Path) -> None:
    maker = drawn_maker(fresh_rng)
    sequence = maker.begin()
    lottery = sequence.decide(maker.beliefs[0])
    sequence.publish(lottery.actions[0])
    sequence.save(tmp_path / "state.npz")
    sequence.close()
    again = maker.begin().load(tmp_path / "state.npz")
    np.testing.assert_array_equal(
        again.decide(maker.beliefs[1]).probabilities, sequence.decide(maker.beliefs[1]).probabilities
    )
    again.close()
    other = SequentialDecisionMaker(
        maker.problem, maker.budget, chain=maker.chain, calibration=maker.calibration, rng=fresh_rng
    )
    with pytest.raises(InputError, match="another loss"):
        other.begin().load(tmp_path / "state.npz")


@pytest.mark.parametrize(
    ("loss", "said"),
    [
        (
            RivalProblem(MarkowitzProblem(np.ones((2, 2)) / 50, [np.eye(2) / 100] * 2, 4.0)),
            "a hidden belief costs it nothing",
        ),
        (RivalProblem(MarkowitzProblem([[0.1, 0.2]] * 2, [np.eye(2)] * 2, 1.0)), "a hidden belief costs it nothing"),
        (RivalProblem(FiniteProblem([[0.0, 1.0], [0.0, 1.0]])), "a hidden belief costs it nothing"),
        (RivalProblem(FiniteProblem([[0.0], [1.0]])), "one best answer"),
        (RivalProblem(FiniteProblem(np.eye(3))), "3 states"),
        ("squared", "loss must be"),
    ],
)
def test_rivals_that_cannot_be_hidden_from_are_refused(loss: object, said: str) -> None:
    chain, problem = BeliefChain(Prior([[0.9, 0.1], [0.2, 0.8]], [0.5, 0.5]), np.eye(2)), FiniteProblem(1.0 - np.eye(2))
    with pytest.raises(InputError, match=said):
        _ = SequentialDecisionMaker(problem, 0.1, chain=chain, loss=loss, rng=np.random.default_rng(0)).ceiling
