"""The sequential rule against a rival with a portfolio, on a market with many beliefs and decisions: every step is solved."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import minimize
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
from inscrutable.geometry.grids import simplex_grid
from inscrutable.mechanisms.chains import resting_chain
from sizes import instances


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


def least_gain(maker: SequentialDecisionMaker, rows: Rows, m: int) -> float:
    """log c of a decision at the rival's best answer to it, by a grid and a simplex search over the belief it acts on."""
    prices, held = maker.calibration.prices(0), best_logs(maker, rows)
    some = rows.law > 0
    logs = np.log(rows.law[some]) - held[some] - prices.regret * rows.regrets[some, m] / prices.information

    def gain(free: np.ndarray) -> float:
        belief = np.exp(np.append(free, 0.0) - logsumexp(np.append(free, 0.0)))
        answer = maker.loss.problem.state_costs(maker.loss.problem.solve(belief))
        return float(logsumexp(logs + maker.beliefs[some] @ answer / prices.information))

    grid = np.maximum(simplex_grid(3, 40), 1e-6)
    answers = maker.loss.problem.state_costs(maker.loss.problem.solve(grid / grid.sum(axis=1, keepdims=True)))
    start = grid[logsumexp(logs[:, None] + maker.beliefs[some] @ answers.T / prices.information, axis=0).argmin()]
    return float(minimize(gain, np.log(start[:2] / start[2]), method="Nelder-Mead").fun)


@pytest.mark.parametrize("told", [1.0, 0.1, 0.03])
def test_every_step_of_a_path_is_solved_to_its_gap(fresh_rng: np.random.Generator, told: float) -> None:
    """By duality: with the rival's answers fixed no rows are worth more than λ Σ p log z, where no decision has log c > 0."""
    for _ in range(instances(4, least=1)):
        maker = market(fresh_rng, told=told)
        sequence, unit = maker.begin(), maker.table.unit
        for _ in range(6):
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
