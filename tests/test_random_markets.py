"""The law of random markets: positive optimal costs, documented shapes, and nothing but the generator decides."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable.errors import InputError, ModelError
from inscrutable.experiments import random_markets
from inscrutable.experiments.random_markets import MarketLaw, random_market

LAWS = [MarketLaw(), MarketLaw(sensor="gaussian"), MarketLaw(regimes=4, assets=2, persistence=1.0)]


@pytest.mark.parametrize("law", LAWS[:2], ids=["categorical", "gaussian"])
@pytest.mark.parametrize("seed", range(10))
def test_optimal_cost_is_positive_everywhere(law: MarketLaw, seed: int) -> None:
    problem = random_market(law, rng=np.random.default_rng(seed)).problem
    grid = np.random.default_rng(seed).dirichlet(np.full(3, 0.4), 300)
    assert problem.optimal_cost(np.eye(3)).min() > 0
    # Concavity: nowhere below the corners' average, found here from decisions on a grid and not from the solver.
    ticks = np.array([[i, j, 20 - i - j] for i in range(21) for j in range(21 - i)]) / 20
    costs = grid @ problem.state_costs(ticks).T
    assert costs.min() > 0
    assert np.all(problem.optimal_cost(grid) >= grid @ problem.optimal_cost(np.eye(3)) * (1 - 1e-9))


@pytest.mark.parametrize("seed", range(5))
def test_market_follows_its_law(seed: int) -> None:
    law = MarketLaw()
    market = random_market(law, rng=np.random.default_rng(seed))
    deviations = np.sqrt(np.diagonal(market.problem.covariances, axis1=1, axis2=2))
    assert law.means[0] <= market.problem.means.min() <= market.problem.means.max() <= law.means[1]
    assert law.volatilities[0] <= deviations.min() <= deviations.max() <= law.volatilities[1] * (1 + 1e-12)
    assert np.allclose(np.diag(market.world.transition), law.persistence)
    assert np.allclose(np.diag(market.world.emission.probabilities), law.accuracy)


def test_gaussian_sensor_reports_the_returns() -> None:
    market = random_market(LAWS[1], rng=np.random.default_rng(3))
    assert np.array_equal(market.world.emission.means, market.problem.means)
    assert np.allclose(market.world.emission.covariances, market.problem.covariances)


def test_same_generator_same_market_and_path() -> None:
    first, second = (random_market(rng=np.random.default_rng(8)) for _ in range(2))
    assert np.array_equal(first.problem.means, second.problem.means)
    paths = [each.beliefs(6, rng=np.random.default_rng(1)) for each in (first, second)]
    assert np.array_equal(*paths)
    assert np.allclose(paths[0].sum(axis=1), 1.0)
    assert paths[0].shape == (6, 3)
    other = random_market(rng=np.random.default_rng(9))
    assert not np.array_equal(first.problem.means, other.problem.means)


def test_impossible_law_says_what_to_change(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(random_markets, "_MOST_DRAWS", 50)
    with pytest.raises(ModelError, match="regime 1: 50 draws had no optimal cost above 0; lower the means"):
        random_market(MarketLaw(means=(0.5, 0.6)), rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"regimes": 1}, "regimes"),
        ({"assets": 2.5}, "assets"),
        ({"means": (0.1, 0.0)}, "means: should be a lowest and a highest value"),
        ({"volatilities": (0.0, 0.1)}, r"volatilities\.0: should be greater than 0"),
        ({"risk_aversion": 0.0}, "risk_aversion"),
        ({"persistence": 1.5}, "persistence: should be less than or equal to 1"),
    ],
)
def test_bad_law(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        MarketLaw(**change)  # type: ignore[arg-type]


def test_bad_sensor() -> None:
    with pytest.raises(InputError, match="sensor: should be 'categorical' or"):
        MarketLaw(sensor="radar")
    with pytest.raises(InputError, match="accuracy"):
        MarketLaw(accuracy=0.0)
    with pytest.raises(InputError, match="rng must be"):
        random_market(rng=0)  # type: ignore[arg-type]
