"""What a fund's value, and a basket with a mask over it, say of its weights."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from inscrutable import InputError, Study, infer_weights, portfolio_return, run_study

ROOT = Path(__file__).parents[1]
RNG = np.random.default_rng(int(os.environ.get("FRESH_SEED", "3")))


@pytest.mark.parametrize("n_assets", [1, 2, 5, 12])
def test_one_return_less_than_assets_gives_the_weights(n_assets: int) -> None:
    for _ in range(5):
        weights = RNG.dirichlet(np.ones(n_assets)) + RNG.normal(size=n_assets) * 0.1
        weights += (1 - weights.sum()) / n_assets
        returns = RNG.normal(scale=0.02, size=(max(n_assets - 1, 1), n_assets))
        seen = portfolio_return()(np.tile(weights, (len(returns), 1)), returns=returns)[:, 0]
        found = infer_weights(seen, returns)
        assert found.is_identified
        np.testing.assert_allclose(found.weights, weights, atol=1e-9)
        values = 100 * np.cumprod([1.0, *(1 + seen)])  # what is published
        again = infer_weights(values[1:] / values[:-1] - 1, returns)
        np.testing.assert_allclose(again.weights, weights, atol=1e-8)
        if n_assets > 1:
            fewer = infer_weights(seen[:-1], returns[:-1]) if len(seen) > 1 else None
            assert fewer is None or not fewer.is_identified


def test_with_noise_estimate_and_covariance_are_those_of_the_equations() -> None:
    """The stationarity conditions with their multiplier, solved as one system."""
    n_assets, n_days, noise = 4, 30, 0.003
    returns = RNG.normal(scale=0.02, size=(n_days, n_assets))
    weights = RNG.dirichlet(np.ones(n_assets))
    ones = np.ones((n_assets, 1))
    system = np.linalg.inv(np.block([[returns.T @ returns, ones], [ones.T, np.zeros((1, 1))]]))
    draws = []
    for _ in range(400):
        seen = returns @ weights + RNG.normal(scale=noise, size=n_days)
        found = infer_weights(seen, returns, noise=noise)
        np.testing.assert_allclose(found.weights, (system @ [*(returns.T @ seen), 1.0])[:n_assets], atol=1e-10)
        draws.append(found.weights)
    np.testing.assert_allclose(found.covariance, noise**2 * system[:n_assets, :n_assets], rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(
        np.cov(np.array(draws).T), found.covariance, atol=0.25 * np.diagonal(found.covariance).max()
    )
    unknown = infer_weights(seen, returns)
    assert 0.5 * noise < unknown.noise < 1.6 * noise


def test_copies_and_constant_returns_leave_directions_open() -> None:
    base = RNG.normal(scale=0.02, size=(20, 3))
    twins = np.column_stack([base, base[:, 0]])
    weights = np.array([0.1, 0.2, 0.3, 0.4])
    found = infer_weights(twins @ weights, twins, noise=0.0)
    assert (found.rank, found.is_identified) == (2, False)
    np.testing.assert_allclose(found.weights[[1, 2]], weights[[1, 2]], atol=1e-9)
    assert found.weights[0] + found.weights[3] == pytest.approx(0.5)
    assert np.isinf(found.standard_errors).all()
    assert infer_weights([0.01], np.full((1, 3), 0.01)).rank == 0
    for seen, returns in (([0.1, 0.2], [[0.1, 0.2]]), ([], np.empty((0, 2))), ([0.1], [[np.nan, 0.1]])):
        with pytest.raises(InputError):
            infer_weights(seen, returns)
    with pytest.raises(InputError, match="noise"):
        infer_weights([0.1], [[0.1, 0.2]], noise=-1.0)


def test_masks_drawn_afresh_average_out_and_a_kept_one_does_not(tmp_path: Path) -> None:
    study = Study.read(ROOT / "studies" / "masked_basket.toml")
    frame = run_study(study, tmp_path / "study").frame()
    figures = [name for name in frame if name.startswith("error_after_")]
    frame[figures] = frame[figures] ** 2
    rows = frame.groupby("shown")[["slope", *figures]].mean()
    rows[figures] = np.sqrt(rows[figures])
    plan = study.plan
    per_weight = plan.mask * np.sqrt(1 - 1 / plan.assets)  # type: ignore[attr-defined]  # masks sum to zero
    fresh, kept, value = (rows.loc[name] for name in ("fresh mask", "kept mask", "value"))
    assert fresh["slope"] == pytest.approx(-0.5, abs=0.05)
    assert fresh["error_after_1"] == pytest.approx(per_weight, rel=0.1)
    assert fresh["error_after_250"] == pytest.approx(per_weight / np.sqrt(250), rel=0.1)
    assert kept["slope"] == pytest.approx(0.0, abs=1e-9)
    assert kept["error_after_250"] == pytest.approx(per_weight, rel=0.1)
    # Independent returns: the covariance is close to noise²/(volatility² (n − U)) in each direction that sums to zero.
    expected = plan.noise / plan.volatility * np.sqrt((1 - 1 / plan.assets) / (250 - plan.assets))  # type: ignore[attr-defined]
    assert value["error_after_250"] == pytest.approx(expected, rel=0.1)
