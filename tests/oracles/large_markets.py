"""Large markets of the multistart oracle, ordinary and concentrated, and the best decisions that its runs have found.

In a concentrated market the optimal decision holds fewer assets than there are states, so that many beliefs share a
decision and its set has to be followed over faces: the hardest decisions there are. A run of the oracle takes minutes;
what it found is kept as weights in `large_markets.json`, and `multistart.judged` says from the weights what they are worth.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from oracles import multistart
from oracles.markets import Market

Array = NDArray[np.float64]

_FILE = Path(__file__).with_name("large_markets.json")
_CONCENTRATED = (  # states, assets, risk aversion, seed, belief, share of |c*|
    (5, 20, 1.5, 3, "open", 0.1),
    (5, 30, 1.0, 4, "certain", 0.1),
    (5, 50, 1.0, 1, "open", 0.1),
    (5, 50, 1.0, 2, "open", 0.1),
    (6, 25, 0.4, 159, "open", 0.02),
    (8, 20, 1.5, 1, "open", 0.1),
    (8, 20, 1.5, 2, "open", 0.1),
    (8, 20, 1.0, 6, "open", 0.02),
    (8, 30, 1.0, 3, "open", 0.1),
    (8, 35, 0.7, 69, "certain", 0.3),
    (8, 50, 1.5, 4, "open", 0.1),
    (8, 50, 1.0, 5, "certain", 0.1),
    (8, 90, 0.4, 168, "open", 0.02),
    (8, 90, 0.4, 174, "open", 0.02),
)


class Instance(NamedTuple):
    """A large market, one belief and the regret allowed, in the cost's unit."""

    name: str
    market: Market
    belief: Array
    limit: float


class Known(NamedTuple):
    """The oracle's best decision, its privacy, and the processor's seconds of the run and until it was found."""

    action: Array
    privacy: float
    run_seconds: float
    found_seconds: float


def instances() -> Iterator[Instance]:
    """Yield the large instances and then the concentrated ones."""
    yield from large_instances()
    for n_states, n_assets, risk_aversion, seed, label, share in _CONCENTRATED:
        market = large_market(n_states, n_assets, seed, risk_aversion)
        belief = belief_of(label, n_states)
        name = f"X{n_states}-U{n_assets}-gamma{risk_aversion:g}-seed{seed}-{label}-{share:g}"
        yield Instance(name, market, belief, share * abs(multistart.optimal_cost_of(market, belief)))


def best_known(instance: Instance) -> Known:
    """Return what is kept for an instance."""
    kept = _kept()[instance.name]
    action = np.zeros(instance.market.means.shape[1])
    action[[int(asset) for asset in kept["weights"]]] = list(kept["weights"].values())
    return Known(action, kept["privacy"], kept["run_seconds"], kept["found_seconds"])


@lru_cache(1)
def _kept() -> dict[str, Any]:
    return dict(json.loads(_FILE.read_text("utf-8")))


def large_market(n_states: int, n_assets: int, seed: int, risk_aversion: float = 5.0) -> Market:
    """Draw monthly regimes from good and calm to bad and wild, as five-factor models.

    The market's premium falls from 2 % to −3 % and its volatility grows from 2.5 % to 9 %; betas, loadings, factor
    premia and residual volatilities (3–9 %) differ between assets and shift between regimes; alphas of 0.4 %.
    """
    rng = np.random.default_rng(seed)
    beta, loadings = rng.uniform(0.4, 1.6, n_assets), rng.normal(0.0, 1.0, (n_assets, 4))
    residual = rng.uniform(0.03, 0.09, n_assets)
    volatilities = np.geomspace(0.025, 0.09, n_states)
    means, covariances = [], []
    for premium, volatility in zip(np.linspace(0.02, -0.03, n_states), volatilities, strict=True):
        stress = np.sqrt(volatility / volatilities[0])
        own_beta = beta + rng.normal(0.0, 0.25, n_assets)
        own = loadings + rng.normal(0.0, 0.5, loadings.shape)
        premia, spreads = rng.normal(0.0, 0.006, 4), rng.uniform(0.01, 0.03, 4) * stress
        means.append(0.004 + own_beta * premium + own @ premia + rng.normal(0.0, 0.004, n_assets))
        noise = residual * rng.uniform(0.7, 1.4, n_assets) * stress
        common = volatility**2 * np.outer(own_beta, own_beta)
        covariances.append(common + (own * spreads**2) @ own.T + np.diag(noise**2))
    return Market(np.array(means), np.array(covariances), risk_aversion)


def large_instances() -> Iterator[Instance]:
    """Yield 8 instances: 5 states with 50 assets and 8 with 100, an open belief and a nearly certain one, 10 % and 2 %.

    The open belief leans to the good regimes, so the optimal cost is well away from zero.
    """
    for n_states, n_assets, seed in ((5, 50, 0), (8, 100, 1)):
        market = large_market(n_states, n_assets, seed)
        for label in ("open", "certain"):
            belief = belief_of(label, n_states)
            least = abs(multistart.optimal_cost_of(market, belief))
            for share in (0.1, 0.02):
                yield Instance(f"X{n_states}-U{n_assets}-{label}-{share:g}", market, belief, share * least)


def belief_of(label: str, n_states: int) -> Array:
    """Return the open belief, leaning to the good regimes, or the certain one, 95 % on the second."""
    if label == "open":
        lean = np.linspace(1.6, 0.4, n_states)
        return np.asarray(lean / lean.sum())
    certain = np.full(n_states, 0.05 / (n_states - 1))
    certain[1] = 0.95
    return certain
