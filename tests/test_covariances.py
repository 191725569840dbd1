"""Covariances within a fit: the published shrinkage, factors, a default that knows how much data it needs, and collapse."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from inscrutable import GaussianEmission, HiddenMarkovModel, InputError, fit_gaussian_hmm
from inscrutable.filtering import filter_beliefs
from inscrutable.worlds.covariances import FactorCovariance, LedoitWolfCovariance, SampleCovariance, covariance_rule


def factor_returns(rng: np.random.Generator, n_rows: int, n_assets: int) -> np.ndarray:
    """One common factor whose volatility lasts for a year at a time, and noise."""
    volatility = np.where((np.arange(n_rows) // 12) % 3 == 2, 0.08, 0.035)
    common = np.outer(rng.normal(size=n_rows) * volatility, rng.uniform(0.6, 1.4, n_assets))
    return np.asarray(common + 0.05 * rng.normal(size=(n_rows, n_assets)))


def test_equal_weights_give_the_published_shrinkage(fresh_rng: np.random.Generator) -> None:
    other = pytest.importorskip("sklearn.covariance")
    for _ in range(10):
        rows = fresh_rng.normal(size=(int(fresh_rng.integers(5, 60)), int(fresh_rng.integers(2, 20))))
        rows = rows @ np.diag(fresh_rng.uniform(0.1, 3.0, rows.shape[1]))
        used = fresh_rng.random(len(rows)) < 0.8
        used[:3] = True
        centred = rows - rows[used].mean(axis=0)
        found = LedoitWolfCovariance().estimate(centred, used / used.sum())
        wanted, share = other.ledoit_wolf(centred[used], assume_centered=True)
        np.testing.assert_allclose(found.covariance, wanted, atol=1e-12 * np.abs(wanted).max())
        full = rows.shape[1] * (rows.shape[1] + 1) / 2
        assert found.n_parameters == pytest.approx(1 + (1 - share) * (full - 1))


def test_factors_keep_every_variance_and_the_largest_components(fresh_rng: np.random.Generator) -> None:
    rows = factor_returns(fresh_rng, 80, 6)
    shares = fresh_rng.dirichlet(np.ones(80))
    sample = SampleCovariance().estimate(rows, shares).covariance
    one = FactorCovariance(1).estimate(rows, shares)
    np.testing.assert_allclose(np.diag(one.covariance), np.diag(sample))
    values, vectors = np.linalg.eigh(sample)
    common = values[-1] * np.outer(vectors[:, -1], vectors[:, -1])
    off = ~np.eye(6, dtype=bool)
    np.testing.assert_allclose(one.covariance[off], common[off], atol=1e-15)
    assert np.linalg.eigvalsh(one.covariance)[0] > 0
    assert one.n_parameters == 12
    all_of_them = FactorCovariance(6).estimate(rows, shares)
    np.testing.assert_allclose(all_of_them.covariance, sample, atol=1e-15)
    assert all_of_them.n_parameters == 21


def test_the_default_knows_how_much_data_it_needs() -> None:
    assert covariance_rule(None, 492, 12, 3).name == "sample"  # the embedded industries
    assert covariance_rule(None, 198, 60, 3).name == "ledoit-wolf"
    assert covariance_rule(None, 5, 1, 3).name == "sample"
    assert covariance_rule("factor:3", 492, 12, 3) == FactorCovariance(3)
    for wrong in ("full", "factor:0", "factor:x", "factor", 3):
        with pytest.raises(InputError, match='covariance must be "sample", "ledoit-wolf" or "factor:K"'):
            covariance_rule(wrong, 492, 12, 3)  # type: ignore[arg-type]


def test_as_many_factors_as_columns_are_refused(fresh_rng: np.random.Generator) -> None:
    rows = factor_returns(fresh_rng, 60, 4)
    assert fit_gaussian_hmm(rows, 1, rng=fresh_rng, covariance="factor:3").covariance == "factor:3"
    for covariance in ("factor:4", "factor:99"):
        with pytest.raises(InputError, match=f'"{covariance}", expected at most "factor:3"'):
            fit_gaussian_hmm(rows, 1, rng=fresh_rng, covariance=covariance)
    with pytest.raises(InputError, match='"factor:1", expected "sample"'):
        fit_gaussian_hmm(rows[:, 0], 1, rng=fresh_rng, covariance="factor:1")


def test_a_fit_with_too_few_rows_is_doubted_and_a_shrunk_one_is_not(
    fresh_rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    """60 assets and 198 months: three full covariances have 5,490 entries."""
    rows = factor_returns(fresh_rng, 198, 60)
    full = fit_gaussian_hmm(rows, 3, rng=fresh_rng, n_restarts=1, covariance="sample")
    for part in ("5,678 effective parameters", "11,880 numbers", "198 rows of 60 columns", "Use shrunk covariances"):
        assert part in full.doubt
    assert full.doubt in caplog.text
    if full.best.collapsed:
        i = full.best.collapsed[0]
        assert f"regime {i + 1} on {full.best.weights[i]:.1f} observations" in full.doubt
    caplog.clear()
    shrunk = fit_gaussian_hmm(rows, 3, rng=fresh_rng, n_restarts=1)
    assert shrunk.covariance == "ledoit-wolf"
    # Shrunk covariances count in part: of 150 seeds at most 771; a regime of six rows raised it to 1,313 once.
    assert shrunk.best.n_parameters < 0.5 * full.best.n_parameters
    if not shrunk.best.collapsed:
        assert shrunk.doubt == ""
        assert caplog.text == ""
    assert shrunk.log_likelihood == pytest.approx(shrunk.best.log_likelihood, rel=1e-9)


def test_a_regime_with_fewer_observations_than_parameters_is_doubted(caplog: pytest.LogCaptureFixture) -> None:
    """Full covariances of four assets: 14 parameters of its own; ten of 200 rows are far from the others."""
    rng = np.random.default_rng(5)
    for count, is_doubted in ((10, True), (40, False)):
        caplog.clear()
        rows = rng.normal(size=(200, 4))
        rows[:count] += 12.0
        found = fit_gaussian_hmm(rows, 2, rng=rng, n_restarts=3, covariance="sample")
        assert min(found.best.weights) == pytest.approx(count, abs=0.5)
        assert found.best.collapsed == ()
        said = f"rests on {min(found.best.weights):.1f} observations, for 14 parameters of its mean and covariance"
        assert (said in found.doubt) == is_doubted
        assert (said in caplog.text) == is_doubted
    assert fit_gaussian_hmm(rows[30:], 2, rng=rng, n_restarts=3, covariance="ledoit-wolf").doubt == ""


def test_units_change_nothing() -> None:
    rows = factor_returns(np.random.default_rng(1), 90, 8)
    units = 10.0 ** np.arange(-3, 5)
    one, other = (
        fit_gaussian_hmm(given, 2, rng=np.random.default_rng(0), n_restarts=2) for given in (rows, rows * units)
    )
    assert one.covariance == "ledoit-wolf"
    np.testing.assert_allclose(
        filter_beliefs(one.world, rows).beliefs, filter_beliefs(other.world, rows * units).beliefs, atol=1e-6
    )
    assert other.log_likelihood == pytest.approx(one.log_likelihood - 90 * np.log(units).sum(), abs=1e-4)


def test_shrunk_covariances_find_regimes_that_full_ones_miss() -> None:
    """Beliefs after the sample, against those under the true world, where there are two rows per regime and column."""
    rng, n_assets = np.random.default_rng([30, 20, 0]), 30
    market = rng.uniform(0.6, 1.4, n_assets)
    means = np.array([mean * market + rng.normal(0, 0.006, n_assets) for mean in (0.012, 0.008, -0.015)])
    own, common = rng.uniform(0.5, 1.5, n_assets), rng.normal(0, 0.5, (n_assets, 4))
    covariances = [
        moves**2 * np.outer(market, market) + noise**2 * (common @ common.T + np.diag(own))
        for moves, noise in ((0.028, 0.02), (0.045, 0.03), (0.075, 0.05))
    ]
    steps = [[0.93, 0.05, 0.02], [0.06, 0.9, 0.04], [0.05, 0.1, 0.85]]
    world = HiddenMarkovModel(steps, GaussianEmission(means, covariances))
    rows = world.sample(480, rng=rng).observations
    true = filter_beliefs(world, rows).predicted[180:]
    errors = {}
    for rule in ("sample", "ledoit-wolf"):
        fit = fit_gaussian_hmm(rows[:180], 3, rng=np.random.default_rng(1), n_restarts=2, covariance=rule)
        held = filter_beliefs(fit.world, rows).predicted[180:]
        errors[rule] = min(
            np.sqrt(((held[:, list(order)] - true) ** 2).sum(axis=1).mean()) for order in permutations(range(3))
        )
    assert errors["ledoit-wolf"] < 0.8 * errors["sample"]
