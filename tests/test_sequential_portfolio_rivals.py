"""The sequential rule against a rival with a portfolio, on a market with many beliefs and decisions: every step is solved."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.special import logsumexp

from inscrutable import (
    Budget,
    DecisionSequence,
    MarkowitzProblem,
    PriceCalibration,
    Prior,
    RivalProblem,
    SequentialDecisionMaker,
)
from inscrutable.decision_makers.sequential import step
from inscrutable.decision_makers.sequential.smooth_rival import ActedOn, SmoothRival
from inscrutable.decision_makers.sequential.step import StepRule
from inscrutable.errors import SolverError
from inscrutable.geometry.grids import simplex_grid
from inscrutable.mechanisms.chains import resting_chain
from sizes import audited, instances, some


def market(rng: np.random.Generator, *, told: float) -> SequentialDecisionMaker:
    """A portfolio of six assets in three states, a rival with another risk aversion, and 66 beliefs."""
    spread = rng.normal(size=(3, 6, 6))
    covariances = 1e-3 * (spread @ spread.swapaxes(1, 2) + 2.0 * np.eye(6))
    means = 0.02 * rng.normal(size=(3, 6))
    problem = MarkowitzProblem(means, covariances, 5.0)
    prior = Prior(simplex_grid(3, 10), rng.dirichlet(np.ones(66)))
    costs = problem.optimal_cost(prior.beliefs)
    silence = float(problem.optimal_cost(prior.mean) - prior.weights @ costs)
    rival = MarkowitzProblem(means, covariances, float(rng.choice([1.0, 5.0, 20.0])))
    unit = float(rival.optimal_cost(prior.mean) - prior.weights @ rival.optimal_cost(prior.beliefs))
    price = float(rng.choice([0.7, 1.5])) * (1.0 + told) * unit / silence
    return SequentialDecisionMaker(
        problem,
        Budget.regret(0.5 * silence),
        chain=resting_chain(prior, 0.8),
        loss=RivalProblem(rival),
        calibration=PriceCalibration.at(price, told * unit),
        rng=rng,
    )


class Rows(NamedTuple):
    """A step's rows (B,k) on the decisions that are played (k,), all regrets (B,M), and the rival's answers' costs (k,X)."""

    law: np.ndarray
    table: np.ndarray
    regrets: np.ndarray
    played: np.ndarray
    answers: np.ndarray


def rows_of(maker: SequentialDecisionMaker, sequence: DecisionSequence) -> Rows:
    """The rows at a step, on the decisions that are played, with the rival's answers to the means after them."""
    law, mechanism = sequence.observer.weights, sequence.mechanism
    table = mechanism.probabilities.toarray()
    played = np.flatnonzero(law @ table > 1e-9)
    means = (law[:, None] * table[:, played]).T @ maker.beliefs
    rival = maker.loss.problem
    means /= means.sum(axis=1, keepdims=True)
    return Rows(law, table[:, played], mechanism.regrets, played, rival.state_costs(rival.solve(means)))


def value_of(maker: SequentialDecisionMaker, rows: Rows) -> float:
    """E L − s E ρ − λ I, written out."""
    prices, joint = maker.calibration.prices(0), rows.law[:, None] * rows.table
    some = joint > 0
    nats = (joint[some] * np.log((rows.table / joint.sum(axis=0))[some])).sum()
    paid = prices.regret * (joint * rows.regrets[:, rows.played]).sum()
    return float(((joint.T @ maker.beliefs) * rows.answers).sum() - paid - prices.information * nats)


def best_logs(maker: SequentialDecisionMaker, rows: Rows) -> np.ndarray:
    """log Σ_m q_m e^(a_bm) under every belief, for the answers given."""
    prices = maker.calibration.prices(0)
    offers = maker.beliefs @ rows.answers.T - prices.regret * rows.regrets[:, rows.played]
    return np.asarray(logsumexp(offers / prices.information, b=rows.law @ rows.table, axis=1))


def gain_logs(maker: SequentialDecisionMaker, rows: Rows, m: int) -> np.ndarray:
    """log p − log z − s ρ / λ of a decision under every belief."""
    prices = maker.calibration.prices(0)
    with np.errstate(divide="ignore"):
        return np.asarray(
            np.log(rows.law) - best_logs(maker, rows) - prices.regret * rows.regrets[:, m] / prices.information
        )


def least_gain(maker: SequentialDecisionMaker, rows: Rows, m: int) -> float:
    """log c of a decision at the rival's best answer to it: convex in the rival's portfolio, but not in the belief behind that.

    Each step goes toward the answer to the mean belief under the weights at a portfolio: the gradient there is that answer's
    problem's, so that the step leads downwards until both are the same.
    """
    logs, rival, price = gain_logs(maker, rows, m), maker.loss.problem, maker.calibration.prices(0).information

    def terms(portfolio: np.ndarray) -> np.ndarray:
        return np.asarray(logs + maker.beliefs @ rival.state_costs(portfolio) / price)

    grid = rival.solve(simplex_grid(3, 40))
    at = grid[logsumexp(logs[:, None] + maker.beliefs @ rival.state_costs(grid).T / price, axis=0).argmin()]
    while True:
        now = float(logsumexp(terms(at)))
        away = rival.solve(np.exp(terms(at) - now) @ maker.beliefs) - at
        line = minimize_scalar(
            lambda share, at=at, away=away: logsumexp(terms(at + share * away)), bounds=(0.0, 1.0), method="bounded",
            options={"xatol": 1e-12},
        )  # fmt: skip
        if not line.fun < now - 1e-12:
            return now
        at = at + line.x * away


@pytest.mark.parametrize("told", some([0.1, 1.0, 0.03], 3))
def test_every_step_of_a_path_is_solved_to_its_gap(fresh_rng: np.random.Generator, told: float) -> None:
    """By duality: with the rival's answers fixed no rows are worth more than λ Σ p log z, where no decision has log c > 0."""
    for _ in range(instances(4, least=1)):
        maker = market(fresh_rng, told=told)
        sequence, unit = maker.begin(), maker.table.unit
        for _ in range(instances(6, least=2)):
            sequence.observe()
            law = sequence.observer.weights
            lottery = sequence.decide(maker.beliefs[int(fresh_rng.choice(len(law), p=law / law.sum()))])
            rows = rows_of(maker, sequence)
            bound = told * unit * float(rows.law @ best_logs(maker, rows))
            assert value_of(maker, rows) == pytest.approx(bound, abs=2e-5 * unit)
            others = np.setdiff1d(np.arange(rows.regrets.shape[1]), rows.played)
            for m in fresh_rng.choice(others, size=2, replace=False):
                assert least_gain(maker, rows, m) <= 1e-5
            sequence.publish(lottery.actions[int(fresh_rng.choice(len(lottery.actions), p=lottery.probabilities))])


def decided(maker: SequentialDecisionMaker) -> None:
    """The first decision of a path."""
    sequence = maker.begin()
    sequence.observe()
    sequence.decide(maker.beliefs[0])


@pytest.mark.parametrize("seed", some([437117587, 1078], 2))
def test_no_answers_are_listed_where_they_move_smoothly(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """Here a decision gains near the belief it was priced from, and not where the rival holds another set of assets."""
    laws, smoothly = [], StepRule._smoothly

    def solved(self: StepRule, law: np.ndarray, *arguments: Any) -> Any:
        laws.append(law)
        return smoothly(self, law, *arguments)

    monkeypatch.setattr(StepRule, "_smoothly", solved)
    monkeypatch.setattr(StepRule, "_solved", lambda *_: pytest.fail("the rival's answers are listed"))
    decided(market(np.random.default_rng(seed), told=0.03))
    assert laws


def test_steps_go_on_where_the_rivals_answer_begins_to_differ() -> None:
    """Newton's steps for the answers on one side of such a belief lead to the other side, where others are best."""
    rng = np.random.default_rng(1)
    maker = market(rng, told=0.02)
    sequence = maker.begin()
    for _ in range(2):
        sequence.observe()
        lottery = sequence.decide(maker.beliefs[int(rng.integers(66))])
        sequence.publish(lottery.actions[0])


def test_bounds_of_gains_are_bounds_where_powers_overflow(fresh_rng: np.random.Generator) -> None:
    """Else a decision that gains is left out, and the step counts as solved."""
    offers, paid = (scale * fresh_rng.normal(size=(30, 50)) for scale in (1500.0, 1000.0))
    offers[fresh_rng.uniform(size=offers.shape) < 0.1] = -np.inf
    rival = MarkowitzProblem(np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1)), 1.0)
    bounds, _ = SmoothRival(rival, np.empty((1, 50, 2)), offers, 1.0)._bounded(np.full(30, np.inf), paid)
    least = logsumexp(offers[:, None] + paid, axis=2).min(axis=1)
    assert (bounds >= least - 1e-9).all()


def test_decisions_that_enter_in_vain_enter_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rounds end where pricing names a decision that the law then does not play, time after time."""
    calls: list[float] = []

    def same(self: SmoothRival, weights: np.ndarray, point: Any, known: Any) -> tuple[float, ActedOn, Any]:
        calls.append(self.price)
        return 1.0, ActedOn(point.numbers[:0], point.law[:0], point.beliefs[:0]), known

    monkeypatch.setattr(SmoothRival, "_entering", same)
    monkeypatch.setattr(StepRule, "_solved", lambda *_: pytest.fail("solved otherwise"))
    with pytest.raises(pytest.fail.Exception):
        decided(market(np.random.default_rng(1), told=0.03))
    assert max(calls.count(price) for price in calls) <= 20  # twice in every continuation, and some starts


def test_a_step_that_is_not_solved_ends_in_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the smooth solve fails, the list of answers grows, and with it the time of a round: the work is limited."""
    smoothly = StepRule._smoothly

    def failed(self: StepRule, *arguments: Any) -> Any:
        return *smoothly(self, *arguments)[:-1], np.inf

    monkeypatch.setattr(StepRule, "_smoothly", failed)
    monkeypatch.setattr(step, "_ANSWERING_WORK", 1e9 if audited() else 1e8)
    with pytest.raises(SolverError, match="take a larger information_price"):
        decided(market(np.random.default_rng(437117587), told=0.03))
