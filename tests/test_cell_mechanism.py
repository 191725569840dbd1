"""The mechanism on cells of a grid, and the rival who reads decisions of other beliefs with it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from inscrutable import BayesianAdversary, Mechanism, OriginalDecisionMaker, Prior, SequentialAdversary
from inscrutable.experiments.backtest_aware import doubted
from inscrutable.experiments.cell_mechanism import N_NEAREST, cell_beliefs, cell_mechanism
from inscrutable.experiments.random_markets import MarketLaw, random_market
from inscrutable.mechanisms.chains import BeliefChain, predicted_chain

RESOLUTION = 20


@pytest.mark.parametrize("sensor", ["categorical", "gaussian"])
@pytest.mark.parametrize("regimes", [2, 3, 4])
def test_cells_consist_of_the_beliefs_that_are_rounded_to_their_point(regimes: int, sensor: str) -> None:
    rng = np.random.default_rng(regimes)
    market = random_market(MarketLaw(regimes=regimes, sensor=sensor), rng=rng)
    prior = predicted_chain(market.world, RESOLUTION, rng=rng).prior
    cells = cell_beliefs(prior, market.world, RESOLUTION, rng=rng)
    assert cells.shape[1:] == prior.beliefs.shape
    back = np.linalg.inv(market.world.transition)
    filtered, points = cells @ back, prior.beliefs @ back
    assert filtered.min() > -1e-9
    # Nearest of all points of the grid, in the filtered belief.
    own = np.linalg.norm(filtered - points, axis=2)
    assert (own <= cKDTree(points).query(filtered)[0] + 1e-9).all()
    assert (own > 1e-6).any()


@pytest.mark.parametrize("sensor", ["categorical", "gaussian"])
def test_a_rival_reads_what_many_beliefs_explain_as_well_as_one_who_knows_many_beliefs(sensor: str) -> None:
    """Two assets show one number of a belief over three states. The other rival takes 6,000 beliefs of a path, and those of
    the twenty nearest decisions; the grid's nearest decision alone left errors of .37 instead of .08, and .26 for .18."""
    rng = np.random.default_rng(7)
    market = random_market(MarketLaw(regimes=3, assets=2, sensor=sensor), rng=rng)
    problem, world = market.problem, market.world
    chain = doubted(predicted_chain(world, 30, rng=rng))
    known = cell_mechanism(OriginalDecisionMaker(problem), chain.prior, cell_beliefs(chain.prior, world, 30, rng=rng))
    beliefs, many = (market.beliefs(n, rng=rng) @ world.transition for n in (250, 6000))
    seen, known_of_many = problem.solve(beliefs), problem.solve(many)
    tree, dense = cKDTree(known_of_many), np.empty_like(beliefs)
    for t, action in enumerate(seen):
        same = tree.query_ball_point(action, 1e-9)
        dense[t] = many[same if len(same) >= 20 else tree.query(action, k=20)[1]].mean(axis=0)

    def error(estimates: np.ndarray) -> float:
        return float(np.sqrt(((estimates - beliefs) ** 2).sum(axis=1).mean()))

    alone = error(BayesianAdversary(known, chain.prior).estimates(seen, nearest=N_NEAREST))
    followed = error(SequentialAdversary(chain, known).filter(seen, nearest=N_NEAREST).mean)
    assert alone < 1.25 * error(dense)
    assert followed < alone


def test_a_played_decision_at_a_distance_of_noise_is_read_alone() -> None:
    """Nine beliefs, nine decisions; the observed one differs from a played one by 1e-9."""
    beliefs = np.column_stack([np.linspace(0.1, 0.9, 9), np.linspace(0.9, 0.1, 9)])
    actions = np.column_stack([np.linspace(0.0, 1.0, 9) ** 2, np.zeros(9)])
    plays, prior = Mechanism(beliefs, actions, np.eye(9), np.zeros((9, 9))), Prior(beliefs, np.full(9, 1 / 9))
    seen = actions[[7]] + 1e-9
    chain = BeliefChain(prior, np.full((9, 9), 1 / 9))
    alone = BayesianAdversary(plays, prior).estimates(seen, nearest=N_NEAREST)
    np.testing.assert_allclose(alone, beliefs[[7]], atol=1e-12)
    followed = SequentialAdversary(chain, plays).filter(seen, nearest=N_NEAREST).mean
    np.testing.assert_allclose(followed, beliefs[[7]], atol=1e-12)
