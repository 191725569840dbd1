"""What the sequential rule hides on real returns from one who knows its laws: run by `make audit`, which keeps the log."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from inscrutable import Budget, DecisionSequence, SequentialDecisionMaker
from inscrutable.datasets import load_industry_returns
from inscrutable.experiments.backtest import run_backtest
from inscrutable.experiments.backtest_sequential import SHARE_OF_SILENCE, SequentialPart
from inscrutable.mechanisms.chains import resting_chain

pytestmark = pytest.mark.audit

N_STEPS, N_FIRST = 10_000, 50
"""Steps along a moving belief, of which the first do not count."""
N_DECISIONS, N_SEQUENCES = 100, 20
"""Decisions on a belief that stays, in so many sequences for each first decision."""


@dataclass
class Observer:
    """Bayes' rule by the law K_t(u|π) of every step, which it knows, and by how beliefs move."""

    beliefs: np.ndarray
    law: np.ndarray

    @property
    def loss(self) -> float:
        """The mean square error that it expects of its estimate."""
        return float(self.law @ ((self.beliefs - self.law @ self.beliefs) ** 2).sum(axis=1))

    def bits(self, table: np.ndarray) -> float:
        """H(u) − H(u|π), what a decision is to tell."""
        return entropy(self.law @ table) - float(self.law @ [entropy(row) for row in table])

    def pays(self, table: np.ndarray, regrets: np.ndarray) -> float:
        """The mean regret that it expects of a decision."""
        return float(self.law @ (table * regrets).sum(axis=1))

    def sees(self, likelihoods: np.ndarray) -> None:
        joint = self.law * likelihoods
        self.law = joint / joint.sum()


def entropy(law: np.ndarray) -> float:
    """In bits."""
    some = law[law > 0]
    return float(-some @ np.log2(some))


def played(sequence: DecisionSequence) -> tuple[np.ndarray, np.ndarray, Any]:
    """K_t of the decisions that some belief plays at this step, what they cost, and the decisions."""
    now = sequence.mechanism
    table = now.probabilities.toarray()
    some = table.any(axis=0)
    return table[:, some], now.regrets[:, some], now.actions[some]


def mean_and_error(values: np.ndarray, controls: np.ndarray) -> tuple[float, float]:
    """The mean of values along a path, and its standard error from means of long parts, given controls whose mean is zero."""
    design = np.column_stack([np.ones(len(values)), controls])
    kept = values - controls @ np.linalg.lstsq(design, values, rcond=None)[0][1:]
    parts = [part.mean() for part in np.array_split(kept, 30)]
    return float(kept.mean()), float(np.std(parts, ddof=1) / np.sqrt(len(parts)))


def second_order(beliefs: np.ndarray) -> np.ndarray:
    """Coordinates of the belief and their products: their means under the long-run law are known."""
    free = beliefs[:, 1:]
    first, second = np.triu_indices(free.shape[1])
    return np.hstack([free, free[:, first] * free[:, second]])


@pytest.fixture(scope="module")
def part() -> SequentialPart:
    """The rule of `inscrutable backtest` on the embedded returns."""
    found = run_backtest(load_industry_returns().returns).sequential
    assert found is not None
    assert found.maker.limit == pytest.approx(SHARE_OF_SILENCE * found.silence_regret)
    assert SHARE_OF_SILENCE == 0.5
    return found


def test_the_error_over_time_at_half_the_silence_regret(
    part: SequentialPart, fresh_rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    maker = part.maker
    chain, prior, sequence = maker.chain, maker.chain.prior, maker.begin()
    moves, features = chain.transition.toarray(), second_order(prior.beliefs)
    observer = Observer(prior.beliefs, prior.weights)
    found, controls = np.empty((N_STEPS, 4)), np.empty((N_STEPS, features.shape[1]))
    for t, place in enumerate(chain.paths(N_STEPS, 1, rng=fresh_rng)[:, 0]):
        table, regrets, actions = played(sequence)
        atom = fresh_rng.choice(len(actions), p=table[place] / table[place].sum())
        controls[t] = observer.law @ features - prior.weights @ features
        found[t, :2] = observer.bits(table), observer.pays(table, regrets)
        observer.sees(table[:, atom])
        miss = prior.beliefs[place] - observer.law @ prior.beliefs
        found[t, 2:] = observer.loss, miss @ miss
        sequence.publish(actions[atom])
        np.testing.assert_allclose(sequence.observer.weights, observer.law, atol=1e-9)
        observer.law = observer.law @ moves
    figures = [mean_and_error(each, controls[N_FIRST:]) for each in found[N_FIRST:].T]
    (bits, bits_se), (regret, regret_se), (loss, loss_se), (missed, missed_se) = figures
    error, error_se = np.sqrt(loss), loss_se / (2.0 * np.sqrt(loss))
    limit, asked = maker.limit, maker.calibration
    with capsys.disabled():
        print(
            f"\n{N_STEPS} decisions on a moving belief, {len(prior)} beliefs: error {error:.4f} ± {error_se:.4f} of at most "
            f"{np.sqrt(maker.ceiling):.4f}, as it came {np.sqrt(missed):.4f}; {bits:.5f} ± {bits_se:.5f} bits a step; regret "
            f"{regret / limit:.5f} ± {regret_se / limit:.5f} of the budget"
        )
    assert error - 2.0 * error_se >= 0.52
    assert bits + 2.0 * bits_se <= 0.10
    assert abs(missed - loss) <= 4.0 * missed_se
    together = np.hypot(regret_se, asked.regret_se)
    assert together <= 0.015 * limit
    assert abs(regret - limit) <= 3.0 * together


def test_the_error_after_many_decisions_on_a_belief_that_is_known_to_stay(
    part: SequentialPart, fresh_rng: np.random.Generator, capsys: pytest.CaptureFixture[str]
) -> None:
    known = part.maker
    prior = known.chain.prior
    maker = SequentialDecisionMaker(
        known.problem,
        Budget.regret(known.limit),
        chain=resting_chain(prior, 1.0),
        calibration=known.calibration,
        rng=fresh_rng,
    )
    first, _, actions = played(maker.begin())
    chances = prior.weights @ first
    means, errors = [], []
    for atom in np.flatnonzero(chances > 0):
        runs = np.array([still_run(maker, actions[atom], first[:, atom], fresh_rng) for _ in range(N_SEQUENCES)])
        means.append(chances[atom] * runs.mean(axis=0))
        errors.append(chances[atom] * runs.std(axis=0, ddof=1) / np.sqrt(N_SEQUENCES))
    (loss, regret, bits), (loss_se, regret_se, _) = np.sum(means, axis=0), np.linalg.norm(errors, axis=0)
    error, error_se = np.sqrt(loss), loss_se / (2.0 * np.sqrt(loss))
    silence = part.silence_regret
    with capsys.disabled():
        print(
            f"\n{N_DECISIONS} decisions on a belief that is known to stay, {len(means)} first decisions: error {error:.4f} ± "
            f"{error_se:.4f}, {bits:.4f} bits in all, regret {regret / silence:.4f} ± {regret_se / silence:.4f} of silence"
        )
    assert error - 2.0 * error_se >= 0.52


def still_run(
    maker: SequentialDecisionMaker, begun: Any, likelihoods: np.ndarray, rng: np.random.Generator
) -> tuple[float, float, float]:
    """What is lost after the last decision on one belief, the mean regret, and bits in all, where the first one is given."""
    sequence, observer = maker.begin(), Observer(maker.beliefs, maker.chain.prior.weights)
    table, regrets, _ = played(sequence)
    bits, total = observer.bits(table), observer.pays(table, regrets)
    observer.sees(likelihoods)
    sequence.publish(begun)
    place = int(rng.choice(len(observer.law), p=observer.law))
    for _ in range(N_DECISIONS - 1):
        table, regrets, actions = played(sequence)
        bits, total = bits + observer.bits(table), total + observer.pays(table, regrets)
        atom = int(rng.choice(len(actions), p=table[place] / table[place].sum()))
        observer.sees(table[:, atom])
        sequence.publish(actions[atom])
    np.testing.assert_allclose(sequence.observer.weights, observer.law, atol=1e-9)
    return observer.loss, total / N_DECISIONS, bits
