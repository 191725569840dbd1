"""A backtest with a limit on turnover, against the same limit written out as rows, and what an observer reads of it."""

from __future__ import annotations

import json
import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from inscrutable import InputError, MarkowitzProblem, Polyhedron, consistent_beliefs
from inscrutable.experiments.attack import attack_weights
from inscrutable.experiments.backtest import Backtest, BacktestSettings, run_backtest
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.experiments.own_model import OwnModel
from inscrutable.experiments.weight_limits import LimitsPart
from inscrutable.reports import backtest_plots
from inscrutable.reports.backtest import text_of, write_backtest
from sizes import audited, instances
from small_runs import coarse_rivals, short_simulations

LIMIT = 0.08


@pytest.fixture(scope="module")
def found() -> Backtest:
    return backtest(LIMIT, sequential=False)


def backtest(limit: float, *, sequential: bool, decisions: int = 7) -> Backtest:
    rng = np.random.default_rng(3)
    calm = rng.random(90) < 0.5
    means = np.where(calm[:, None], [0.03, 0.0, 0.01], [-0.03, 0.02, 0.01])
    months = pd.date_range("2001-01", periods=90, freq="ME")
    spread = np.where(calm, 0.03, 0.06)[:, None]
    returns = pd.DataFrame(means + spread * rng.normal(size=(90, 3)), index=months, columns=list("ABC"))
    own = OwnModel.of_limits(LimitsPart(turnover=limit))
    held = rng.dirichlet([1.0, 1.0], 7)
    beliefs = pd.DataFrame(held, index=months[82:89], columns=["calm", "turbulent"])
    settings = BacktestSettings(regimes=2, train_until="2007-11", sequential=sequential, own=own)
    return run_backtest(returns.iloc[: 83 + decisions], settings, beliefs=beliefs, restarts=1)


def test_every_decision_is_the_best_near_the_one_before(found: Backtest) -> None:
    beliefs, problem = found.beliefs.to_numpy(), found.problem
    for name in found.names:
        weights = found.weights(name).to_numpy()
        moved = np.abs(np.diff(weights, axis=0)).sum(axis=1)
        assert moved.max() <= LIMIT + 1e-8
        assert moved.max() > 0.9 * LIMIT, name
        signs = np.array(list(product([1.0, -1.0], repeat=3)))
        for t in range(1, len(weights)):
            sides = signs @ weights[t - 1] + LIMIT
            near = Polyhedron(np.vstack([-np.eye(3), signs]), [*np.zeros(3), *sides], np.ones((1, 3)), [1.0])
            month = MarkowitzProblem(problem.means, problem.covariances, problem.risk_aversion, near)
            best = month.optimal_cost(beliefs[t])
            record = found.episode.records[name]
            assert record.decisions.optimal_cost[t] == pytest.approx(best, abs=1e-9)
            spent = month.expected_cost(beliefs[t], weights[t]) - best
            assert record.decisions.regret[t] == pytest.approx(spent, abs=1e-9)
            if name == "CDM":
                assert spent <= found.budget.limit(float(best)) + 1e-9
                seen = consistent_beliefs(month, weights[t]).bounds()
                np.testing.assert_allclose(record.decisions.belief_set[t].bounds(), seen, atol=1e-6)
    assert np.allclose(found.weights("ODM").iloc[0], problem.solve(beliefs[0]))  # the first is free


def test_comparisons_with_silence_count_what_the_limit_costs(found: Backtest) -> None:
    """After other weights than the optimal ones nothing near is good, so the regret within the limit looks small."""
    beliefs, problem = found.beliefs.to_numpy(), found.problem

    def above(weights: Any) -> float:
        costs = [problem.expected_cost(b, w) - problem.optimal_cost(b) for b, w in zip(beliefs, weights, strict=True)]
        return float(np.mean(costs))

    silence = above(np.tile(problem.solve(beliefs.mean(axis=0)), (len(beliefs), 1)))
    assert found.silence_regret == pytest.approx(silence)
    spent = {name: above(found.weights(name).to_numpy()) for name in found.names}
    assert spent["CDM"] > silence > found.figures["CDM"]["mean_regret"]
    for name, regret in spent.items():
        assert found.figures[name]["mean_regret_unlimited"] == pytest.approx(regret)
        assert found.figures[name]["mean_regret_of_silence"] == pytest.approx(regret / silence)
    said = text_of(found)
    assert re.search(
        rf"In hindsight silence .* instead of {1e4 * spent['CDM']:.3g}[\d.]* \(counter-adversarial", said
    ), said
    assert f"without a limit: {1e4 * spent['ODM']:.3g} (optimal), {1e4 * spent['CDM']:.3g} (counter" in said


def test_an_observer_reads_it_with_the_model_that_is_kept(found: Backtest, tmp_path: Path) -> None:
    kept = InvestorModel.load(found.investor.save(tmp_path / "model.json"))
    assert kept.turnover == LIMIT
    read = attack_weights(kept, found.weights("CDM"))
    for row, seen in zip(read.bounds, found.episode.records["CDM"].decisions.belief_set, strict=True):
        np.testing.assert_allclose(row, seen.bounds(), atol=1e-9)
    assert found.aware is None
    assert "no aware observer is modelled" in text_of(found)
    assert text_of(found).count("No rule is judged: under a limit on turnover") == 1


@pytest.mark.usefixtures("undrawn")
def test_the_sequential_rule_keeps_the_limit_and_its_observer_follows_it(tmp_path: Path) -> None:
    with coarse_rivals(), short_simulations(*((20, 100) if audited() else (8, 50))):
        found = backtest(0.6, sequential=True, decisions=instances(7, least=4))
    weights, record = found.weights("SDM").to_numpy(), found.episode.records["SDM"]
    assert np.abs(np.diff(weights, axis=0)).sum(axis=1).max() <= 0.6 + 1e-9
    beliefs = found.beliefs.to_numpy()
    for t in range(1, len(weights)):
        month = found.problem_at("SDM", t)
        spent = month.expected_cost(beliefs[t], weights[t]) - month.optimal_cost(beliefs[t])
        assert record.decisions.regret[t] == pytest.approx(spent, abs=1e-12)
        assert spent >= -1e-12
    assert np.isfinite(found.followed_estimates("SDM").to_numpy()).all()
    assert np.isnan(found.followed_estimates("PDM").to_numpy()).all()
    said = text_of(found)
    assert "except that of the SDM" in said
    assert "Ceiling: no rule" not in said  # of a rule that follows no law of the weights before
    named, error = (100 * found.figures["SDM"][key] for key in ("share_regime_named_followed", "error_followed"))
    assert re.search(rf"from all sequential weights so far: {named:.0f}\.?\d*% \(error {error / 100:.2f}\)", said), said
    assert found.aware is None
    write_backtest(found, tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["verdict"]


def test_the_frontier_is_that_of_one_rule_near_its_own_weights(
    found: Backtest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other rules' weights before are others, so their decisions lie on other curves."""
    figures: list[Any] = []
    monkeypatch.setattr(backtest_plots, "save_figure", lambda figure, *_: figures.append(figure) or [])
    for step in (0, 3):
        backtest_plots.draw_frontier(found, Path(), step)
    legends = [[text.get_text() for text in figure.legends[0].get_texts()] for figure in figures]
    decided = [[label for label in labels if "(CDM)" in label or "(PDM)" in label] for labels in legends]
    assert any("(PDM)" in label for label in decided[0])  # the first decision has no weights before
    assert decided[1] == ["counter-adversarial (CDM)"]
    assert "near the counter-adversarial (CDM) weights before" in figures[1].axes[0].get_title()


def test_what_a_limit_on_turnover_does_not_go_with() -> None:
    own = OwnModel.of_limits(LimitsPart(turnover=LIMIT))
    with pytest.raises(InputError, match="leave out the disclosure"):
        BacktestSettings(own=own, sequential=False, disclosure="every(3)")
