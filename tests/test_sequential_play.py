"""The sequential rule in a comparison: its long run, decisions on one belief, and chains that it has wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inscrutable import (
    Disclosure,
    MarkowitzProblem,
    Prior,
    decoy_grid,
    path_leakage,
)
from inscrutable.experiments import sequential_play
from inscrutable.experiments.comparison import ComparisonSettings, compare, makers_of
from inscrutable.experiments.sequential_play import SequentialPlay, sequential, staying
from inscrutable.experiments.setting import Setting
from inscrutable.mechanisms.chains import BeliefChain, resting_chain
from inscrutable.reports import comparison_plots
from inscrutable.reports.comparison import notes_of, short_table, terminal_table
from inscrutable.reports.page import comparison_page
from sizes import some
from small_runs import draft_simulations, learned_from_few


@cache
def setting() -> Setting:
    rng = np.random.default_rng(3)
    problem = MarkowitzProblem(rng.normal(size=(3, 3)), [np.diag(rng.uniform(0.5, 2.0, 3))] * 3, 2.0)
    prior = Prior(rng.dirichlet(np.full(3, 0.5), 6), rng.dirichlet(np.full(6, 4.0)))
    return Setting(problem, prior, decoy_grid(problem, 4), resting_chain(prior, 0.8))


@cache
def play() -> SequentialPlay:
    held = setting()
    with draft_simulations():
        behaviour = sequential(held, 0.5 * held.silence_regret, lambda: np.random.default_rng(0), float("inf"))
    assert behaviour is not None
    assert isinstance(behaviour.play, SequentialPlay)
    return behaviour.play


@pytest.fixture
def drafts() -> Iterator[None]:
    with draft_simulations(), learned_from_few():
        yield


def test_long_run_figures_are_those_of_sampled_paths() -> None:
    held, found = setting(), play()
    steps = sequential_play.LONG_PATHS[1]
    again = path_leakage(held.chain, found.maker, steps, rng=np.random.default_rng(5), n_draws=20)
    late = slice(sequential_play.WATCHED_FIRST, None)
    squared = float((again.bayes_error[late] ** 2).mean())
    spread = 2.0 * found.watched.error * found.watched.error_se + 2.0 * float(
        (again.bayes_error * again.error_se)[late].mean()
    )
    assert found.watched.error**2 == pytest.approx(squared, abs=4.0 * spread)
    bits_spread = found.watched.bits_se + float(again.added_se[late].mean())
    assert found.watched.bits == pytest.approx(float(again.added[late].mean()), abs=4.0 * bits_spread)
    # What it plays in the long run costs what it spends, and was asked for.
    spent = float(held.prior.weights @ found.mechanism.expected_regrets)
    assert spent == pytest.approx(0.5 * held.silence_regret, rel=0.15)
    assert found.watched.error <= found.watched.ceiling + 4.0 * found.watched.error_se


def test_decisions_on_one_belief_tell_nothing_new_where_the_rule_knows_that_it_stays() -> None:
    found = play()
    told = found.repeated((1, 10, 30), told=True)
    np.testing.assert_allclose(told.errors, told.errors[0], atol=1e-9)
    np.testing.assert_allclose(told.information, told.information[0], atol=1e-9)
    assert told.regret > 0
    astray = found.repeated((1, 10, 30), told=False)
    assert astray.errors[0] == pytest.approx(told.errors[0])
    assert astray.errors[2] < told.errors[2] - 0.05
    assert (np.diff(astray.information) > 0).all()


def test_chains_that_stay_otherwise_keep_the_prior() -> None:
    rng = np.random.default_rng(0)
    transition = rng.dirichlet(np.ones(4), 4)
    weights = np.linalg.matrix_power(transition, 4000)[0]
    chain = BeliefChain(Prior(rng.dirichlet(np.ones(3), 4), weights / weights.sum()), transition)
    np.testing.assert_allclose(staying(chain, 0.5).transition.toarray(), transition @ transition)
    stays = staying(resting_chain(chain.prior, 0.8), 2.0)
    np.testing.assert_allclose(stays.transition.toarray(), resting_chain(chain.prior, 0.9).transition.toarray())
    # Beliefs that stay longer than the rule thinks are found out.
    assert play().watched.error_double < play().watched.error


@pytest.mark.usefixtures("drafts")
def test_the_sequential_rule_stands_beside_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held = setting()
    monkeypatch.setattr(sequential_play, "LONG_PATHS", (2, 25))
    monkeypatch.setattr(sequential_play, "OTHER_PATHS", (2, 25))
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1, 5), draws=20)
    makers = makers_of(["ODM", "rate-distortion", "sequential"])
    found = compare(
        held.problem, held.chain, settings, makers=makers, candidates=held.candidates, rng=np.random.default_rng(0)
    )
    rows = found.of("sequential")
    assert len(rows) == 1
    for row in rows:
        assert np.isfinite(
            [row.path_error, row.path_bits, row.path_ceiling, row.path_error_half, row.told_regret]
        ).all()
    other = found.of("rate-distortion")[0]
    np.testing.assert_array_equal(other.told_errors, other.repeated_errors)
    assert np.isfinite(other.path_bits)
    assert np.isnan(other.path_ceiling)
    assert found.ceilings == {row.budget: row.path_ceiling for row in rows}
    table = short_table(found, found.budgets[0])
    assert table.loc["ceiling", "error, aware, over time"] == f"{rows[0].path_ceiling:.3f}"
    assert table.loc["sequential", "error, aware, 5 decisions, rule knows it stays"] != "-"
    assert any("All these figures hold for this chain alone" in note for note in notes_of(found))
    assert not any("told" in title for title in terminal_table(found, found.budgets[0]))
    stays = 0.8 + 0.2 * (held.prior.weights**2).sum()
    assert f"over time, on a chain where the belief stays the same in {stays:.0%} of the steps: " in found.summary()
    assert "5 decisions on one belief (the sequential rule assumes that chain): " in found.summary()
    drawn: Any = comparison_plots.draw_comparison(found, tmp_path)
    assert all(each.exists() for each in drawn)
    assert "upper bound of any rule on the candidates, over time" in (tmp_path / "comparison.svg").read_text("utf-8")
    shown = comparison_page.page_data(found)["ceilings"]
    np.testing.assert_allclose(shown, [[100.0 * row.silence_share, row.path_ceiling] for row in rows], rtol=1e-3)
    alone = compare(
        held.problem,
        held.prior,
        settings,
        makers=makers_of(["ODM"]),
        candidates=held.candidates,
        rng=np.random.default_rng(0),
    )
    assert not alone.ceilings
    assert "sequential" not in makers_of(["ODM", "sequential"], Setting.of(held.problem, held.prior, held.candidates))


@pytest.mark.parametrize("shown", some(["every(2)|delayed(1)", "every(3)", "rounded(1)"], 3))
@pytest.mark.usefixtures("drafts")
def test_under_a_disclosure_the_rule_goes_by_it(shown: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What one holds who sees so much is what `path_leakage` finds of the rule; fewer and later decisions hide more."""
    held = setting()
    monkeypatch.setattr(sequential_play, "LONG_PATHS", (4, 40))
    monkeypatch.setattr(sequential_play, "OTHER_PATHS", (2, 25))
    settings = ComparisonSettings(budgets=(0.25,), repeats=(1, 4), draws=20, disclosure=shown)
    found = compare(
        held.problem,
        held.chain,
        settings,
        makers=makers_of(["sequential", "rate-distortion", "delay"]),
        candidates=held.candidates,
        rng=np.random.default_rng(0),
    )
    assert found.left_out == ("delay",)
    row, seed = found.of("sequential")[0], lambda: np.random.default_rng(0)
    maker = sequential(replace(held, disclosure=Disclosure.of(shown)), row.budget, seed, float("inf")).play.maker
    sampled = path_leakage(held.chain, maker, 24, rng=np.random.default_rng(1), n_draws=60, disclosure=shown)
    window = slice(-6, None)
    error = float(np.sqrt(np.mean(sampled.bayes_error[window] ** 2)))
    assert row.path_error == pytest.approx(error, abs=0.03 + 4 * float(np.mean(sampled.error_se[window])))
    assert row.path_bits == pytest.approx(float(sampled.added[window].mean()), abs=0.05)
    assert row.path_error <= row.path_ceiling + 4 * row.path_error_se + 1e-9
    assert row.expected_regret == pytest.approx(row.budget, rel=0.08)
