"""The law that the sequential rule keeps is the one of an observer who knows the rule."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inscrutable import (
    Budget,
    MarkowitzProblem,
    PriceCalibration,
    Prior,
    SequentialAdversary,
    SequentialDecisionMaker,
    decoy_grid,
    path_leakage,
)
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.privacy.leaks import silence_regret


@pytest.mark.parametrize("share", [0.1, np.inf])
def test_the_law_that_the_rule_keeps_is_the_observers(share: float, fresh_rng: np.random.Generator) -> None:
    rng = fresh_rng
    problem = MarkowitzProblem(rng.normal(size=(3, 3)), [np.diag(rng.uniform(0.5, 2.0, 3))] * 3, 2.0)
    transition = 0.7 * np.eye(6) + 0.3 * rng.dirichlet(np.ones(6), 6)
    weights = np.linalg.matrix_power(transition, 4000)[0]
    chain = BeliefChain(Prior(rng.dirichlet(np.full(3, 0.5), 6), weights / weights.sum()), transition)
    unit = 1.0 if np.isinf(share) else chain.prior.error**2
    silence = silence_regret(problem, chain.prior.beliefs, chain.prior.weights)
    candidates = decoy_grid(problem, 4)

    def at(price: float) -> SequentialDecisionMaker:
        prices = PriceCalibration.at(price * unit / silence, share * unit)
        given: Any = {"chain": chain, "candidates": candidates, "information_price": share * unit, "rng": rng}
        return SequentialDecisionMaker(problem, Budget.regret(1.0), calibration=prices, **given)

    # Regret so dear that the first decision tells something.
    maker = next(each for each in map(at, 3.0 * 2.0 ** np.arange(12)) if each.begin().expected.bits > 0.1)
    sequence, actions, kept = maker.begin(), [], []
    for place in chain.paths(30, 1, rng=rng)[:, 0]:
        lottery: Any = sequence.decide(chain.prior.beliefs[place])
        mine = sequence.mechanism
        shares = np.zeros(len(mine.actions))
        for action, chance in zip(lottery.actions, lottery.probabilities, strict=True):
            shares[np.abs(mine.actions - action).max(axis=1).argmin()] += chance
        np.testing.assert_allclose(mine.sparse.toarray()[place], shares, atol=1e-8)
        actions.append(lottery.actions[rng.choice(len(lottery.probabilities), p=lottery.probabilities)])
        sequence.publish(actions[-1])
        kept.append(sequence.observer.weights)
    found = SequentialAdversary(chain, maker).filter(np.array(actions))
    np.testing.assert_allclose(found.weights, kept, atol=1e-12)
    assert np.abs(kept[0] - chain.prior.weights).max() > 1e-3
    told = path_leakage(chain, maker, 2, rng=rng, n_draws=2000)
    assert (told.error_se == 0.0).all()  # every sequence: of sampled ones the average may lie above
    assert (told.bayes_error <= told.prior_error + 1e-9).all()
