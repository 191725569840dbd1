"""The sequential rule in a backtest: what it may spend, what a rival reads who follows it, and what is said of it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    GaussianEmission,
    HiddenMarkovModel,
    InputError,
    PriceStatus,
)
from inscrutable.adversaries import SequentialAdversary
from inscrutable.experiments import backtest_aware, backtest_sequential
from inscrutable.experiments.backtest import Backtest, BacktestSettings, run_backtest
from inscrutable.experiments.backtest_aware import beliefs_resolution, doubted
from inscrutable.experiments.cell_mechanism import N_NEAREST, cell_beliefs, cell_mechanism
from inscrutable.experiments.rivals import RIVAL, loss_of
from inscrutable.geometry.grids import simplex_grid
from inscrutable.mechanisms import mechanism
from inscrutable.mechanisms.chains import predicted_chain
from inscrutable.privacy import DesiredObfuscation
from inscrutable.privacy.leaks import silence_regret
from inscrutable.reports.backtest import notes_of, summary_data, table_of, text_of, write_backtest
from inscrutable.reports.backtest_verdict import cautions, limits, verdict
from sizes import audited
from small_runs import coarse_rivals, repeated_fits, short_simulations

TRAINING, DECISIONS, GRID = 480, 120 if audited() else 48, 12
SETTINGS = BacktestSettings(regimes=2, train_until="2039-12")


def market() -> pd.DataFrame:
    """Returns of two regimes that last, of a world that a fit on forty years finds."""
    means = np.array([[0.03, 0.0, 0.01], [-0.05, 0.02, 0.0]])
    sensor = GaussianEmission(means, np.array([0.002 * np.eye(3), 0.005 * np.eye(3)]))
    world = HiddenMarkovModel([[0.95, 0.05], [0.08, 0.92]], sensor)
    rows = world.sample(TRAINING + DECISIONS, rng=np.random.default_rng(4)).observations
    months = pd.date_range("2000-01", periods=len(rows), freq="ME")
    return pd.DataFrame(np.asarray(rows), index=months, columns=["A", "B", "C"])


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    with coarse_rivals(120, 2), short_simulations(20, 100), repeated_fits():
        yield


@pytest.fixture(scope="module")
def found() -> Backtest:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(backtest_sequential, "_MOST_BELIEFS", GRID)
        return run_backtest(market(), SETTINGS, restarts=2)


def test_it_is_one_more_column_and_the_others_stay_as_they_were(found: Backtest) -> None:
    without = run_backtest(market(), replace(SETTINGS, sequential=False), restarts=2)
    assert found.names == ("ODM", "CDM", "PDM", "SDM")
    assert without.names == found.names[:3]
    for name in without.names:
        for key, value in without.figures[name].items():
            assert key == "error_ceiling" or found.figures[name][key] == pytest.approx(value, nan_ok=True), (name, key)
    assert np.isnan(without.figures["CDM"]["error_ceiling"])
    assert found.figures["SDM"]["annual_turnover"] < found.figures["PDM"]["annual_turnover"]
    assert "SDM" in table_of(found).columns


def test_a_budget_that_is_met_within_a_large_error_alone_is_a_caution(found: Backtest) -> None:
    assert found.sequential is not None
    maker = found.sequential.maker
    doubtful = replace(maker.calibration, status=PriceStatus.WITHIN_ERROR)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(maker, "_calibration", doubtful)
        assert doubtful.caution()
        assert doubtful.caution() in cautions(found)
    assert doubtful.caution() not in cautions(found)


def test_it_may_spend_half_of_what_silence_costs(found: Backtest) -> None:
    """Against all constant portfolios on a fine grid, under the rule's own law."""
    assert found.sequential is not None
    maker, problem = found.sequential.maker, found.problem
    prior = maker.chain.prior
    costs = prior.beliefs @ problem.state_costs(simplex_grid(3, 150)).T
    least = (prior.weights @ (costs - np.asarray(problem.optimal_cost(prior.beliefs))[:, None])).min()
    assert maker.limit == pytest.approx(0.5 * least, rel=1e-3)
    assert found.sequential.silence_regret <= least + 1e-15


def test_its_regret_is_within_the_budget_in_expectation(found: Backtest) -> None:
    assert found.sequential is not None
    path, limit = found.sequential.path, found.sequential.maker.limit
    for regrets in (path.expected_regrets, path.own_regrets):
        blocks = regrets.reshape(12, -1).mean(axis=1)
        assert regrets.mean() <= limit + 4.0 * blocks.std(ddof=1) / np.sqrt(len(blocks))
    record = found.episode.records["SDM"]
    np.testing.assert_array_equal(record.expected_regret, path.own_regrets)
    weights, beliefs = found.weights("SDM").to_numpy(), found.beliefs.to_numpy()
    np.testing.assert_allclose(found.problem.regret(beliefs, weights), record.decisions.regret, atol=1e-12)


def test_the_rival_who_follows_it_holds_the_law_that_it_keeps(found: Backtest) -> None:
    assert found.sequential is not None
    maker = found.sequential.maker
    read = SequentialAdversary(maker.chain, maker).filter(found.weights("SDM").to_numpy())
    np.testing.assert_allclose(found.followed_estimates("SDM"), read.mean, atol=1e-9)
    assert np.isnan(found.aware_estimates("SDM")).all(axis=None)
    assert found.figures["SDM"]["bits_followed"] == pytest.approx(found.sequential.path.bits.mean())


def test_the_rival_who_follows_another_by_loops(found: Backtest) -> None:
    """Bayes' rule with decisions near each one, one step after the other."""
    rng = np.random.default_rng(np.random.SeedSequence(found.settings.seed).spawn(4)[3])
    chain = doubted(predicted_chain(found.world, beliefs_resolution(2), rng=rng))
    maker = CounterAdversarialDecisionMaker(
        found.problem, found.settings.measure, found.budget, candidates=found.candidates
    )
    known = cell_mechanism(maker, chain.prior, cell_beliefs(chain.prior, found.world, beliefs_resolution(2), rng=rng))
    first, own = np.unique(known.actions.round(10), axis=0, return_inverse=True)
    near, played = np.zeros((len(chain.prior), len(first))), mechanism(maker, chain.prior.beliefs)
    for column, row in zip(own.reshape(-1), known.sparse.toarray().T, strict=True):
        near[:, column] += row
    table, moves = np.asarray(played.sparse.toarray()), chain.transition.toarray()
    law, told, read = chain.prior.weights, [], []
    for action in found.weights("CDM").to_numpy():
        chances = law @ table
        ratios = np.divide(table, chances, out=np.ones_like(table), where=(table > 0) & (chances > 0))
        told.append((law[:, None] * table * np.log2(ratios)).sum())
        apart = np.linalg.norm(first - action, axis=1)
        closest = np.argsort(apart)[: 1 if apart.min() < 1e-9 else N_NEAREST]
        law = law * near[:, closest[apart[closest] <= 1e4 * max(apart.min(), 1e-10)]].sum(axis=1)
        law = law / law.sum()
        read.append(law @ chain.prior.beliefs)
        law = law @ moves
    np.testing.assert_allclose(found.followed_estimates("CDM"), read, atol=1e-9)
    assert found.aware is not None
    np.testing.assert_allclose(found.aware.bits["CDM"], told, atol=1e-6)


def test_one_who_follows_reads_optimal_portfolios_as_well_as_one_who_does_not(found: Backtest) -> None:
    figures = found.figures["ODM"]
    assert figures["error_followed"] == pytest.approx(figures["error_aware"], abs=1e-3)
    assert np.isnan(figures["error_ceiling"])


def test_doubt_keeps_the_law_and_rules_nothing_out(found: Backtest) -> None:
    chain = predicted_chain(found.world, GRID, rng=np.random.default_rng(0))
    moved = doubted(chain)
    np.testing.assert_allclose(moved.transition.T @ chain.prior.weights, chain.prior.weights, atol=1e-12)
    assert (moved.transition.toarray() > 0).all()
    np.testing.assert_allclose(moved.transition.toarray(), chain.transition.toarray(), atol=0.011)


@pytest.mark.usefixtures("undrawn")
def test_what_is_said_of_it(found: Backtest, tmp_path: Path) -> None:
    assert found.sequential is not None
    prices, figures = found.sequential.maker.calibration, found.figures["SDM"]
    assert prices.loss - 4.0 * prices.loss_se <= figures["error_ceiling"] ** 2
    said = "\n".join(limits(found))
    asked = (
        r"long run of the model's regimes (\S+) basis points a month on average \(50% of the (\S+) that silence costs\)"
    )
    spent = re.search(asked, said)
    assert spent is not None
    assert float(spent[1]) == pytest.approx(0.5 * float(spent[2]), rel=0.02)
    prior = found.sequential.maker.chain.prior
    silence = silence_regret(found.problem, prior.beliefs, prior.weights)
    assert found.sequential.maker.limit == pytest.approx(0.5 * silence)
    assert f"and {1e4 * silence:.2f} in the long run of the model's regimes (the silence regret" in notes_of(found)[-1]
    assert f"on the SDM's grid of {len(prior)} beliefs, of which its default budget is a share)" in notes_of(found)[-1]
    assert (
        f"and {figures['error_ceiling']:.2f} there. The error without weights is "
        f"{found.sequential.maker.chain.prior.error:.2f} there; in these months it is {figures['error_without']:.2f}"
        in said
    )
    assert "on a grid of" in text_of(found)
    written = {path.name for path in write_backtest(found, tmp_path)}
    assert {"weights_SDM.csv", "path_SDM.csv", "followed_SDM.csv", "followed_CDM.csv", "aware_CDM.csv"} <= written
    assert "aware_SDM.csv" not in written
    held = json.loads((tmp_path / "summary.json").read_text("utf-8"))["sequential"]
    assert held["mean_regret_allowed"] == found.sequential.maker.limit
    assert len(held["other_draws"]) == 2


def test_a_ceiling_is_that_of_the_regret_beside_it(found: Backtest) -> None:
    """The regret is that over the long-run law of the belief, as the ceiling is; the realised one may be far from it."""
    assert found.sequential is not None
    assert found.aware is not None
    table, prior = table_of(found), found.aware.prior
    (spent,) = (label for label in table.index if label.startswith("  regret in the long run of the model's regimes"))
    (most,) = (label for label in table.index if label.startswith("  ceiling"))
    maker = CounterAdversarialDecisionMaker(
        found.problem, found.settings.measure, found.budget, candidates=found.candidates
    )
    assert 1e-4 * table.loc[spent, "CDM"] == pytest.approx(prior.weights @ maker.decide_many(prior.beliefs).regret)
    assert 1e-4 * table.loc[spent, "SDM"] == pytest.approx(found.sequential.maker.calibration.regret)
    assert table.loc[spent, "ODM"] == pytest.approx(0.0, abs=1e-9)
    for name in found.names[1:]:
        assert table.loc[most, name] == pytest.approx(found.sequential.ceiling(1e-4 * table.loc[spent, name]))
    points = [f"{float(f'{each:.2g}'):g}" for each in table.loc[spent, "CDM":]]
    told = f"long run of the model's regimes ({points[0]}, {points[1]} and {points[2]} basis points a month), no rule"
    assert told in "\n".join(limits(found))


WAGER = np.array([[-1.0, 2.0, 0.0], [2.0, -1.0, 0.0]])  # on one of the two regimes at two to one, or none


def test_what_weights_are_worth_to_another_rival_by_loops(found: Backtest) -> None:
    """Each row of the table, the sequential rule's too, against the rival's best choice belief by belief."""
    section = RIVAL.validate_python({"kind": "finite", "costs": WAGER.tolist()})
    asked = replace(found, rival=loss_of(section, found.problem), settings=replace(SETTINGS, rival=section))
    beliefs = found.beliefs.to_numpy()
    alone = [belief @ WAGER[:, (found.aware.prior.mean @ WAGER).argmin()] for belief in beliefs]
    secret = np.mean(alone) - np.mean([(belief @ WAGER).min() for belief in beliefs])
    for name in found.names:
        read = found.followed_estimates(name).to_numpy()
        played = [belief @ WAGER[:, (guess @ WAGER).argmin()] for belief, guess in zip(beliefs, read, strict=True)]
        figures = asked.figures[name]
        assert figures["worth_secret"] == pytest.approx(secret, rel=1e-9)
        assert figures["worth_followed"] == pytest.approx(np.mean(alone) - np.mean(played), rel=1e-9, abs=1e-12)
        assert np.isnan(figures["worth_copied"])  # the rival holds no weights
    table, said = table_of(asked), text_of(asked)
    assert "worth of the beliefs to the rival, the rival's cost" in table.index
    assert not any("published weights, as they are" in label for label in table.index)
    assert "SDM reveals least information, whatever the rival's problem" in said
    assert "Copying cannot be prevented" not in said
    assert summary_data(asked)["settings"]["rival"] == {"kind": "finite", "costs": WAGER.tolist()}
    own = replace(found, rival=loss_of(RIVAL.validate_python({"kind": "own"}), found.problem))
    assert own.figures["SDM"] == pytest.approx(found.figures["SDM"], nan_ok=True)
    assert text_of(own) == text_of(found)
    capped = replace(found, rival=loss_of(RIVAL.validate_python({"max_weight": 0.5}), found.problem))
    assert any(label == "worth of the beliefs to the rival, bp per month" for label in table_of(capped).index)


def test_none_holds_is_said_as_such(found: Backtest) -> None:
    weak = {name: {**found.figures[name], "error_followed": 0.0} for name in found.names}
    assert found.sequential is not None
    read = replace(found.sequential, others=(found.beliefs.to_numpy(),))
    shifted = replace(found, sequential=read)
    shifted.__dict__["figures"] = weak
    assert any("follows all months: by none of " in each for each in verdict(shifted))
    assert any("none of 1 other runs over all months would have hidden" in each for each in verdict(shifted))


def test_that_all_other_draws_hide_is_said_as_such(found: Backtest) -> None:
    assert found.sequential is not None
    away = 1.0 - found.beliefs.to_numpy()  # as far from the belief as it can be
    hidden = replace(found, sequential=replace(found.sequential, others=(away, away)))
    assert any("2 of 2 other runs over all months would have hidden the belief" in each for each in verdict(hidden))


def test_a_budget_of_its_own_none_and_what_it_is_not_played_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backtest_sequential, "_MOST_BELIEFS", 5)
    monkeypatch.setattr(backtest_sequential, "_OTHER_DRAWS", 0)
    monkeypatch.setattr(backtest_aware, "_MOST_BELIEFS", 120 if audited() else 20)
    returns = market().iloc[: TRAINING + 6]
    given = run_backtest(returns, replace(SETTINGS, budget=Budget.regret(1e-4)), restarts=1)
    assert given.sequential is not None
    assert given.sequential.maker.limit == 1e-4
    assert not any("of the silence regret" in each for each in limits(given))
    steps = replace(SETTINGS, measure=DesiredObfuscation(np.tile([0.3, 0.7], (6, 1))))
    for asked, why in (
        (replace(SETTINGS, budget=Budget.regret(0.0)), "its budget is 0"),
        (steps, "the target changes from step to step"),
    ):
        other = run_backtest(returns, asked, restarts=1)
        assert other.sequential is None
        assert text_of(other).count(f"Caution: the sequential rule is left out, as {why}.") == 1
    assert "is left out, as" not in text_of(given)
    with pytest.raises(InputError, match="sequential must be True or False"):
        replace(SETTINGS, sequential="no")  # type: ignore[arg-type]
