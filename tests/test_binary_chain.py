"""Two beliefs that flip: what the sequential rule tells, in closed form.

With probability p the belief flips, a wrong decision costs 1, and only information is priced. At s = ln((1 − D)/D) nats per
unit of regret the rule spends D a step and tells H(p⊛D) − H(D) bits, which is the least of any causal rule (the nonanticipative
rate distortion function of the binary symmetric Markov source), after a first step of 1 − H(D); a guess is wrong with
probability D. The observer follows every sequence of decisions.
"""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from inscrutable import Budget, FiniteProblem, PriceCalibration, Prior, SequentialDecisionMaker
from inscrutable.mechanisms.chains import BeliefChain
from sizes import paired

N_STEPS = 5


def entropy(chance: float) -> float:
    return float(-sum(q * np.log2(q) for q in (chance, 1.0 - chance) if q > 0))


def rule_of(flip: float, wrong: float) -> SequentialDecisionMaker:
    chain = BeliefChain(Prior(np.eye(2), [0.5, 0.5]), [[1.0 - flip, flip], [flip, 1.0 - flip]])
    slope = float(np.log((1.0 - wrong) / wrong))
    return SequentialDecisionMaker(
        FiniteProblem([[0.0, 1.0], [1.0, 0.0]]),
        Budget.regret(wrong),
        chain=chain,
        information_price=np.inf,
        calibration=PriceCalibration.at(slope, np.inf),
        rng=np.random.default_rng(0),
    )


def rows(sequence: Any) -> np.ndarray:
    """What the rule plays now on both beliefs."""
    table = np.zeros((2, 2))
    for row, belief in zip(table, np.eye(2), strict=True):
        lottery = sequence.decide(belief)
        np.add.at(row, np.asarray(lottery.actions, dtype=int), lottery.probabilities)
    return table


def followed(rule: Any, flip: float) -> np.ndarray:
    """Bits, regret and chance of a wrong guess at each step, by every sequence of decisions, shape (T,3)."""
    moves = np.array([[1.0 - flip, flip], [flip, 1.0 - flip]])
    found = np.zeros((N_STEPS, 3))
    for seen in product(range(2), repeat=N_STEPS - 1):
        sequence, law, chance = rule.begin(), np.array([0.5, 0.5]), 1.0
        for t in range(N_STEPS):
            table = rows(sequence)
            joint = law[:, None] * table
            played = joint.sum(axis=0)
            some = joint > 0
            bits = float(joint[some] @ np.log2((table / np.where(played > 0, played, 1.0))[some]))
            regret, wrong = joint[0, 1] + joint[1, 0], joint.min(axis=0).sum()
            # A history of t decisions comes up once for each of its continuations.
            found[t] += chance * np.array([bits, regret, wrong]) / 2 ** (N_STEPS - 1 - t)
            if t == N_STEPS - 1 or not played[seen[t]] > 0:
                break
            law, chance = joint[:, seen[t]] / played[seen[t]] @ moves, chance * played[seen[t]]
            sequence.publish(seen[t])
    return found


@pytest.mark.parametrize(("flip", "wrong"), paired([0.05, 0.1, 0.2], [0.1, 0.25, 0.05]))
def test_bits_regret_and_guesses_are_those_of_the_closed_form(flip: float, wrong: float) -> None:
    found = followed(rule_of(flip, wrong), flip)
    mixed = flip * (1.0 - wrong) + (1.0 - flip) * wrong
    assert found[0, 0] == pytest.approx(1.0 - entropy(wrong), abs=1e-3)
    np.testing.assert_allclose(found[1:, 0], entropy(mixed) - entropy(wrong), atol=1e-3)
    np.testing.assert_allclose(found[:, 1], wrong, rtol=0.01)
    np.testing.assert_allclose(found[:, 2], wrong, rtol=0.01)
