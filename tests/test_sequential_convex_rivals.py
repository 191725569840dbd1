"""The sequential rule against a rival whose answers are not finitely many: cone programmes, and the square error as one."""

from __future__ import annotations

from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest

from inscrutable import (
    Budget,
    FiniteProblem,
    InputError,
    MarkowitzProblem,
    PriceCalibration,
    Prior,
    RivalProblem,
    SequentialDecisionMaker,
    SquaredError,
    delayed,
    every,
    leakage,
)
from inscrutable.decision_makers.sequential.step import StepTable
from inscrutable.mechanisms.chains import resting_chain
from sizes import some
from test_sequential_losses import calibrated


def drawn(rng: np.random.Generator, *, told: float, stays: float | None = None) -> SequentialDecisionMaker:
    """A random finite problem on a chain that rests, and a rival with a portfolio of its own on the simplex."""
    while True:
        states, count = int(rng.integers(2, 4)), int(rng.integers(3, 9))
        problem = FiniteProblem(rng.random((states, int(rng.integers(2, 5)))))
        prior = Prior(rng.dirichlet(np.full(states, 0.4), count), rng.dirichlet(np.ones(count)))
        root = rng.normal(size=(3, 3))
        spread = 0.5 * np.eye(3) + root @ root.T / 6.0
        rival = MarkowitzProblem(rng.normal(size=(states, 3)), [spread] * states, 2.0)
        secret = float(rival.optimal_cost(prior.mean) - prior.weights @ rival.optimal_cost(prior.beliefs))
        regrets = prior.beliefs @ problem.costs
        silence = float((prior.weights @ (regrets - regrets.min(axis=1, keepdims=True))).min())
        if secret > 0.01 and silence > 0.02:
            break
    price = float(rng.choice([0.3, 1.0, 3.0])) * secret / silence
    return SequentialDecisionMaker(
        problem,
        Budget.regret(0.5 * silence),
        chain=resting_chain(prior, float(rng.uniform(0.3, 0.9)) if stays is None else stays),
        loss=RivalProblem(rival),
        calibration=PriceCalibration.at(price, told * secret),
        rng=rng,
    )


def value_of(maker: SequentialDecisionMaker, law: np.ndarray, rows: np.ndarray) -> float:
    """E L − s E ρ − λ I of a table, written out."""
    joint, prices = law[:, None] * rows, maker.calibration.prices(0)
    played, some = joint.sum(axis=0), joint > 0
    information = (joint[some] * np.log((rows / np.where(played > 0, played, 1.0))[some])).sum()
    paid = prices.regret * (joint * maker.mechanism_for(Prior(maker.beliefs, law)).regrets).sum()
    shown = played > 0
    means = (joint.T @ maker.beliefs)[shown]
    lost = played[shown] @ maker.loss.problem.optimal_cost(means / means.sum(axis=1, keepdims=True))
    return float(lost - paid - prices.information * information)


def best_value(maker: SequentialDecisionMaker, law: np.ndarray) -> float:
    """The same of the table that a cone programme finds.

    The rival's least y·s(a) = −r·a + γ Y a·Σa over the simplex, with r = R'y and Y = Σy, is by duality the largest
    −|Σ^(−1/2) (r − ν + z)|² / (4 γ Y) − ν over ν and z ≥ 0.
    """
    regrets, prices = maker.mechanism_for(Prior(maker.beliefs, law)).regrets, maker.calibration.prices(0)
    rival = maker.loss.problem
    rows = cp.Variable(regrets.shape, nonneg=True)
    joint = cp.multiply(np.tile(law[:, None], (1, regrets.shape[1])), rows)
    played = cp.sum(joint, axis=0)
    gain = -prices.regret * cp.sum(cp.multiply(joint, regrets))
    gain -= prices.information * cp.sum(cp.rel_entr(joint, cp.vstack([weight * played for weight in law])))
    root = np.linalg.cholesky(np.linalg.inv(rival.covariances[0])).T
    for m in range(regrets.shape[1]):
        mean, level, above = maker.beliefs.T @ joint[:, m], cp.Variable(), cp.Variable(3, nonneg=True)
        pulled = root @ (rival.means.T @ mean - level * np.ones(3) + above)
        gain += -cp.quad_over_lin(pulled, 4.0 * rival.risk_aversion * cp.sum(mean)) - level
    cp.Problem(cp.Maximize(gain), [cp.sum(rows, axis=1) == 1]).solve(solver=cp.CLARABEL)
    found = np.maximum(rows.value, 0.0)
    return value_of(maker, law, found / found.sum(axis=1, keepdims=True))


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
@pytest.mark.parametrize("told", [1.0, 0.1, 0.03])
def test_a_step_is_as_good_as_a_cone_programme_finds(fresh_rng: np.random.Generator, told: float) -> None:
    for _ in range(2):
        maker = drawn(fresh_rng, told=told)
        law, unit = maker.chain.prior.weights, maker.table.unit
        mechanism = maker.mechanism_for(maker.chain.prior)
        rows = mechanism.probabilities.toarray()
        assert value_of(maker, law, rows) >= best_value(maker, law) - 2e-5 * unit
        found = leakage(mechanism, maker.chain.prior, loss=maker.loss)
        assert maker.begin().expected.loss == pytest.approx(found.bayes_loss, abs=1e-9)
        assert -1e-9 <= found.worth <= found.secret_worth + 1e-9


@pytest.mark.parametrize("told", [1.0, 0.1, 0.03])
def test_on_a_belief_that_stays_nothing_is_revealed_twice(fresh_rng: np.random.Generator, told: float) -> None:
    for _ in range(4):
        maker = drawn(fresh_rng, told=told, stays=1.0)
        first = maker.mechanism_for(maker.chain.prior)
        for choice in np.flatnonzero(first.played(maker.chain.prior.weights) > 1e-3):
            sequence = maker.begin()
            sequence.publish(first.actions[choice])
            held = sequence.observer.weights
            lottery = sequence.decide(maker.beliefs[int(held.argmax())])
            assert len(lottery.probabilities) == 1
            assert sequence.expected.bits <= 1e-12
            sequence.publish(first.actions[choice])
            np.testing.assert_allclose(sequence.observer.weights, held, atol=1e-12)


def test_a_decision_that_gains_nothing_does_not_enter_at_a_small_barrier() -> None:
    """Newton's steps for the rival's best answer to it stalled near a wrong one, and the step was not solved."""
    test_on_a_belief_that_stays_nothing_is_revealed_twice(np.random.default_rng(2659414260), 0.1)


def against_an_estimator(rng: np.random.Generator, disclosure=None, at=None) -> tuple[SequentialDecisionMaker, ...]:
    """The rule for the square error, and for a rival whose costs are |a|² − 2 π·a on the simplex."""
    given = drawn(rng, told=0.1)
    n, prior = given.problem.n_states, given.chain.prior
    rival = RivalProblem(MarkowitzProblem(2.0 * np.eye(n), [np.eye(n)] * n, 1.0))
    unit = float(prior.weights @ ((prior.beliefs - prior.mean) ** 2).sum(axis=1))
    prices = PriceCalibration.at(unit / (2.0 * given.limit), 0.1 * unit) if at is None else PriceCalibration.at(at, 0.0)
    return tuple(
        SequentialDecisionMaker(
            given.problem, given.budget, chain=given.chain, loss=loss, disclosure=disclosure, calibration=prices, rng=rng,
        )
        for loss in (SquaredError(), rival)
    )  # fmt: skip


def test_a_decision_that_no_belief_plays_while_a_step_is_solved() -> None:
    """All probabilities of it were 0 in floating point, and the rival's belief after it 0/0."""
    square, other = against_an_estimator(np.random.default_rng(34), at=9.886390377659874)
    one, two = (maker.begin().expected for maker in (square, other))
    assert two.regret == pytest.approx(one.regret, abs=1e-4 * square.limit)


def test_a_ceiling_is_near_the_largest_loss_where_few_beliefs_are_tempted() -> None:
    """The estimates after decisions that are not played were no least ones, by a hundredth of the prior loss."""
    square, _ = against_an_estimator(np.random.default_rng(1099720082))
    best = largest_loss(square.table, square.limit)
    assert -1e-7 <= (square.ceiling - best) / square.table.unit <= 1e-4


@pytest.mark.parametrize("disclosure", some([None, delayed(1), every(2)], 2), ids=str)
def test_a_rival_who_estimates_the_belief_is_the_square_error(fresh_rng: np.random.Generator, disclosure) -> None:
    """On the simplex |a|² − 2 π·a is least at a = π, where it is −|π|²: the square error less what no decision changes."""
    square, other = against_an_estimator(fresh_rng, disclosure)
    unit, prices = square.table.unit, square.calibration
    one, two = (maker.begin().expected for maker in (square, other))
    known = two.loss - other.table.floor - one.loss + square.table.floor
    late = square.table.prior_loss - (other.table.prior_loss - other.table.floor)  # what is uncertain whatever is known
    values = [each.loss - prices.regret_prices[0] * each.regret for each in (one, two)]
    nats = [prices.information_price * np.log(2.0) * each.bits for each in (one, two)]
    assert known == pytest.approx(-late, abs=2e-3 * unit)
    told = values[0] - nats[0] - (values[1] - nats[1] - other.table.floor)
    assert told == pytest.approx(late, abs=2e-5 * unit)
    best = largest_loss(square.table, square.limit * square.table.period)
    for ceiling, table in ((square.ceiling, square.table), (other.ceiling - other.table.floor + late, other.table)):
        assert -1e-7 <= (ceiling - best) / table.unit <= 1e-4


def largest_loss(table: StepTable, limit: float) -> float:
    """The largest square error of one step at a mean regret, as a cone programme."""
    law, stakes = table.prior.weights, table.stakes
    joint = cp.Variable(table.regrets.shape, nonneg=True)
    saved = [cp.quad_over_lin(each @ stakes.points, cp.sum(each)) for each in joint.T]
    rows = [cp.sum(joint, axis=1) == law, cp.sum(cp.multiply(joint, table.regrets)) <= limit]
    return float(cp.Problem(cp.Maximize(law @ (stakes.base + stakes.spare) - sum(saved)), rows).solve("CLARABEL"))


def test_what_is_played_depends_on_the_law_alone_and_is_gone_on_with(
    fresh_rng: np.random.Generator, tmp_path: Path
) -> None:
    maker = drawn(fresh_rng, told=0.1)
    sequence = maker.begin()
    for _ in range(2):
        sequence.observe()
        lottery = sequence.decide(maker.beliefs[0])
        again = sequence.mechanism_for(sequence.observer)
        if sequence.n_published == 0:
            np.testing.assert_array_equal(again.probabilities.toarray(), sequence.mechanism.probabilities.toarray())
        sequence.publish(lottery.actions[0])
    sequence.save(tmp_path / "state.npz")
    sequence.close()
    loaded = maker.begin().load(tmp_path / "state.npz")
    for each in (sequence, loaded):
        each.observe()
    np.testing.assert_array_equal(loaded.mechanism.probabilities.toarray(), sequence.mechanism.probabilities.toarray())
    loaded.close()
    wider = RivalProblem(MarkowitzProblem(2.0 * maker.loss.problem.means, maker.loss.problem.covariances, 2.0))
    other = SequentialDecisionMaker(
        maker.problem, maker.budget, chain=maker.chain, loss=wider, calibration=maker.calibration, rng=fresh_rng
    )
    with pytest.raises(InputError, match="another loss"):
        other.begin().load(tmp_path / "state.npz")


@pytest.mark.audit
def test_a_calibrated_rule_spends_its_budget_and_stays_below_the_ceiling(fresh_rng: np.random.Generator) -> None:
    maker, path = calibrated(drawn(fresh_rng, told=0.1, stays=0.5), fresh_rng)
    np.testing.assert_allclose(path.losses, maker.loss.problem.optimal_cost(path.observer_means), atol=1e-9)
