"""The backtest: causal, within budget, labelled, repeatable, and what it writes."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    Decisions,
    DesiredObfuscation,
    InputError,
    NonExistence,
    consistent_beliefs,
    filter_beliefs,
    simplex_grid,
)
from inscrutable.datasets import load_industry_returns, read_beliefs, read_weights
from inscrutable.decision_makers import privacy_frontier
from inscrutable.experiments.backtest import RESTARTS, Backtest, BacktestSettings, run_backtest
from inscrutable.experiments.backtest_aware import beliefs_resolution, rivals_chain
from inscrutable.experiments.cell_mechanism import N_NEAREST, cell_beliefs
from inscrutable.experiments.episodes import Record, relative_increase
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.experiments.own_model import OwnModel
from inscrutable.reports.backtest import table_of, text_of, timing_of, write_backtest
from inscrutable.reports.backtest_verdict import limits, verdict
from inscrutable.reports.names import FULL_NAMES
from sizes import instances, some
from small_runs import coarse_rivals, repeated_fits
from test_golden_tables import DATA, assert_same, golden

TRAINING, DECISIONS = 120, 9
TRAIN_UNTIL = "2009-12"
SETTINGS = BacktestSettings(regimes=2, train_until=TRAIN_UNTIL, sequential=False)


def market(seed: int = 0, n_assets: int = 3, extra: int = DECISIONS) -> pd.DataFrame:
    """Two regimes of blocks of months whose best assets differ, labelled by assets that are no identifiers."""
    rng = np.random.default_rng(seed)
    rows = TRAINING + extra
    wild = (np.arange(rows) // 7) % 2 == 1
    mean = np.where(wild[:, None], np.linspace(-0.02, 0.015, n_assets), np.linspace(0.03, 0.005, n_assets))
    returns = mean + np.where(wild, 0.07, 0.02)[:, None] * rng.normal(size=(rows, n_assets))
    labels = ["Bonds & bills", "Ölwerte", "3M", "Gold", "Tech"][:n_assets]
    return pd.DataFrame(returns, index=pd.date_range("2000-01", periods=rows, freq="ME", name="month"), columns=labels)


def run(returns: pd.DataFrame, settings: BacktestSettings = SETTINGS, **options: object) -> Backtest:
    return run_backtest(returns, settings, restarts=2, **options)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def found() -> Backtest:
    returns = market()
    return run(returns, riskless=pd.Series(0.001, index=returns.index))


def test_its_table_is_the_one_it_had(found: Backtest) -> None:
    """As in the first release, but for the aware observer: it reads a decision at a distance of noise as one alone since, and
    its law of the belief is simulated with the assets by rising variance."""
    table, wanted = table_of(found), golden("backtest")
    kept = [name for name in wanted.index if name in table.index]
    assert len(kept) >= len(wanted) - 3
    assert_same(table.loc[kept], wanted.loc[kept], rtol=1e-4, atol=1e-6)


def test_a_fit_that_one_start_alone_found_is_named(found: Backtest) -> None:
    one = found.fit.best
    for gap, said in ((0.5, False), (3.0, True)):
        fit = replace(found.fit, restarts=(replace(one, log_likelihood=one.log_likelihood - gap), one))
        text = text_of(replace(found, fit=fit))
        assert ("Only one of 2 starts of the fit came within one nat of its likelihood" in text) == said


def test_beliefs_that_never_move_have_no_share_of_silence(found: Backtest) -> None:
    """Silence costs a rounding there."""
    still = found.beliefs * 0.0 + found.beliefs.iloc[0]
    same = run(market(), beliefs=still)
    assert same.silence_regret == pytest.approx(0.0, abs=1e-12)
    for name in same.names:
        assert np.isnan(same.figures[name]["mean_regret_of_silence"])
    assert "these beliefs follow another" not in text_of(same) or same.figures["ODM"]["error_without"] > 0.01


def test_dates_and_labels_are_kept(found: Backtest) -> None:
    returns = market()
    assert found.assets == tuple(returns.columns)
    assert found.regimes == ("calm", "turbulent")
    assert found.market.n_training == TRAINING
    assert list(found.dates) == list(returns.index[TRAINING - 1 : -1])
    assert list(found.earned) == list(returns.index[TRAINING:])
    for name in ("ODM", "CDM", "PDM"):
        assert list(found.weights(name).columns) == list(returns.columns)
        assert found.weights(name).index.equals(found.dates)
        assert list(found.estimates(name).columns) == ["calm", "turbulent"]


def test_a_decision_earns_the_next_row(found: Backtest) -> None:
    returns = market()
    for name in found.names:
        weights, path = found.weights(name), found.path(name)
        for t in range(DECISIONS):
            earned = sum(weights.iloc[t, j] * returns.iloc[TRAINING + t, j] for j in range(3))
            assert path["gross_return"].iloc[t] == pytest.approx(earned, abs=1e-15)
            assert path["earned_in"].iloc[t] == returns.index[TRAINING + t]


def test_beliefs_are_predictions_from_the_past(found: Backtest) -> None:
    """By Bayes' rule with written-out normal densities, one step after the other."""
    world, emission, returns = found.world, found.world.emission, market().to_numpy()
    held = world.initial
    for t, row in enumerate(returns[:-1]):
        away = row - emission.means
        weights = np.array(
            [
                held[i] * np.exp(-0.5 * away[i] @ np.linalg.solve(sigma, away[i])) / np.sqrt(np.linalg.det(sigma))
                for i, sigma in enumerate(emission.covariances)
            ]
        )
        held = weights / weights.sum() @ world.transition
        if t >= TRAINING - 1:
            np.testing.assert_allclose(found.beliefs.iloc[t - TRAINING + 1], held, atol=1e-10)


@pytest.mark.usefixtures("coarse")
def test_the_future_changes_nothing_before_it(found: Backtest) -> None:
    returns = market()
    later = 4  # rows changed at the end
    other = returns.copy()
    other.iloc[-later:] = np.random.default_rng(9).normal(0.0, 0.2, (later, 3)).clip(-0.9)
    changed = run(other)
    known = DECISIONS - later + 1  # the decision at the end of row t knows row t, not t+1
    for name in found.names:
        assert np.array_equal(found.weights(name)[:known], changed.weights(name)[:known])
        assert np.array_equal(found.beliefs[:known], changed.beliefs[:known])
    assert not np.allclose(found.beliefs.iloc[known], changed.beliefs.iloc[known], atol=1e-6)


@pytest.mark.usefixtures("coarse")
def test_appended_rows_change_nothing_before_them(found: Backtest) -> None:
    shorter = run(market().iloc[:-3])
    for name in found.names:
        np.testing.assert_allclose(shorter.weights(name), found.weights(name)[:-3], atol=1e-9)


def test_regret_stays_within_budget_and_the_odm_hides_nothing(found: Backtest) -> None:
    problem, beliefs = found.problem, found.beliefs.to_numpy()
    for name in found.names:
        record = found.episode.records[name]
        limit = 0.1 * np.abs(record.decisions.optimal_cost)
        assert (record.expected_regret <= limit * (1 + 1e-9)).all()
        np.testing.assert_allclose(
            problem.regret(beliefs, found.weights(name).to_numpy()), record.decisions.regret, atol=1e-12
        )
    assert (found.privacy("ODM") == 0).all()
    assert (found.privacy("CDM") > 0.05).all()
    odm = found.figures["ODM"]
    assert odm["share_regime_named"] == 1.0
    assert odm["mean_regret"] == pytest.approx(0.0, abs=1e-15)
    assert odm["annual_sharpe_minus_odm"] == odm["annual_sharpe_minus_odm_high"] == 0.0


def test_privacy_and_naming_recomputed_from_the_weights(found: Backtest) -> None:
    beliefs = found.beliefs.to_numpy()
    for name in found.names:
        sets = [consistent_beliefs(found.problem, row) for row in found.weights(name).to_numpy()]
        distances = [one.distance(belief) for one, belief in zip(sets, beliefs, strict=True)]
        np.testing.assert_allclose(found.privacy(name), distances, atol=1e-9)
        named = [one.center().argmax() == belief.argmax() for one, belief in zip(sets, beliefs, strict=True)]
        assert found.figures[name]["share_regime_named"] == pytest.approx(np.mean(named))
        assert found.figures[name]["mean_privacy"] == pytest.approx(np.mean(distances))
    commonest = pd.Series(beliefs.argmax(axis=1)).value_counts(normalize=True).max()
    assert found.figures["CDM"]["base_rate"] == pytest.approx(commonest)


def test_silence_regret_is_the_best_constant_portfolio(found: Backtest) -> None:
    beliefs = found.beliefs.to_numpy()
    costs = beliefs @ found.problem.state_costs(simplex_grid(3, 120)).T
    least = (costs - found.problem.optimal_cost(beliefs)[:, None]).mean(axis=0).min()
    assert found.silence_regret == pytest.approx(least, abs=2e-6)
    assert found.silence_regret <= least + 1e-12


def test_riskless_returns_enter_the_sharpe_ratio_only(found: Backtest) -> None:
    figures, excess = found.figures["ODM"], found.path("ODM")["gross_return"] - 0.001
    assert figures["annual_sharpe"] == pytest.approx(excess.mean() / excess.std() * np.sqrt(12))
    assert "excess of the riskless rate" in text_of(found)


def test_candidates_are_shared_and_solved_once(found: Backtest) -> None:
    frontier = privacy_frontier(found.problem, found.beliefs.iloc[0], None, candidates=found.candidates)
    limit = found.budget.limit(frontier.optimal_cost)
    assert found.episode.records["PDM"].expected_privacy[0] >= frontier.randomized(limit) - 1e-9


@pytest.mark.usefixtures("undrawn")
def test_same_seed_same_bytes(found: Backtest, tmp_path: Path) -> None:
    returns = market()
    again = run(returns, riskless=pd.Series(0.001, index=returns.index))
    written = write_backtest(found, tmp_path / "one")
    write_backtest(again, tmp_path / "two")
    for path in written:
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes(), path.name
    names = {path.name for path in written}
    assert {"table.csv", "beliefs.csv", "weights_PDM.csv", "summary.json", "frontier.svg", "weights.png"} <= names
    assert "month.png" not in names  # two regimes have no triangle
    summary = json.loads((tmp_path / "one" / "summary.json").read_text("utf-8"))
    assert summary["verdict"] == verdict(found)
    assert summary["settings"]["budget"] == {"amount": 0.1, "is_relative": True}
    assert summary["decision_makers"]["CDM"]["mean_regret"] == found.figures["CDM"]["mean_regret"]


@pytest.mark.usefixtures("undrawn")
def test_files_can_be_read_again(found: Backtest, tmp_path: Path) -> None:
    write_backtest(found, tmp_path)
    weights = read_weights(tmp_path / "weights_CDM.csv", assets=found.assets).frame
    assert np.array_equal(weights, found.weights("CDM"))
    beliefs = read_beliefs(tmp_path / "beliefs.csv", names=found.regimes)
    np.testing.assert_allclose(beliefs, found.beliefs, atol=1e-15)
    model = InvestorModel(found.world, found.problem, found.assets, found.regimes, found.budget)
    model.save(tmp_path / "model.json")
    loaded = InvestorModel.load(tmp_path / "model.json")
    assert np.array_equal(loaded.problem.solve(beliefs.to_numpy()), found.problem.solve(beliefs.to_numpy()))
    table = pd.read_csv(tmp_path / "table.csv", index_col=0)
    assert table.index.name == timing_of(found)
    np.testing.assert_array_equal(table, table_of(found))


def test_headers_state_the_timing_and_the_factor(found: Backtest) -> None:
    assert "month t+1 given data up to month t, earns the return of month t+1" in timing_of(found)
    assert "√12" in text_of(found)
    for name in found.names:
        assert any(FULL_NAMES[name] in each for each in verdict(found))


@pytest.mark.usefixtures("coarse")
def test_another_seed_draws_others(found: Backtest) -> None:
    """Lotteries whose atoms are all likely come out differently; the CDM, which draws nothing, does not."""
    chosen = replace(SETTINGS, budget=Budget(0.02))
    returns = market(extra=instances(DECISIONS))
    one, other = (run(returns, replace(chosen, seed=seed)) for seed in (1, 2))
    if np.allclose(one.world.transition, other.world.transition, atol=1e-6):
        np.testing.assert_allclose(one.weights("CDM"), other.weights("CDM"), atol=1e-4)
    assert not np.allclose(one.weights("PDM"), other.weights("PDM"), atol=1e-3)


def test_the_rival_who_knows_the_method_by_loops(found: Backtest) -> None:
    """Bayes' rule for decisions near each published one, of beliefs of a path that are rounded to points of the grid."""
    assert found.aware is not None
    prior = found.aware.prior
    maker = CounterAdversarialDecisionMaker(
        found.problem, found.settings.measure, found.budget, candidates=found.candidates
    )
    rng = np.random.default_rng(np.random.SeedSequence(found.settings.seed).spawn(4)[3])
    rivals_chain(found.world, beliefs_resolution(2), None, rng=rng)
    cells = cell_beliefs(prior, found.world, beliefs_resolution(2), rng=rng)
    actions = np.concatenate([maker.decide_many(each).action for each in cells])
    shares = np.concatenate([prior.weights] * len(cells)) / len(cells)
    squared = []
    for action, belief, read in zip(
        found.weights("CDM").to_numpy(), found.beliefs.to_numpy(), found.aware.estimates["CDM"], strict=True
    ):
        apart = np.linalg.norm(actions - action, axis=1)
        others = sorted(apart[np.unique(actions.round(10), axis=0, return_index=True)[1]])
        near = apart <= max(others[N_NEAREST - 1] + 1e-12, 1e-10) if others[0] > 1e-10 else apart <= 1e-10
        near &= apart <= max(1e4 * others[0], 1e-10)
        guess = shares[near] @ np.vstack([prior.beliefs] * len(cells))[near] / shares[near].sum()
        np.testing.assert_allclose(read, guess, atol=1e-9)
        squared.append(((guess - belief) ** 2).sum())
    figures = found.figures["CDM"]
    assert figures["error_aware"] == pytest.approx(np.sqrt(np.mean(squared)))
    without = [((prior.mean - belief) ** 2).sum() for belief in found.beliefs.to_numpy()]
    assert figures["error_without"] == pytest.approx(np.sqrt(np.mean(without)))
    assert 0.0 <= figures["bits_aware"] <= figures["bits_prior"]
    # The grid is some 500 beliefs: what is not hidden is read to its width.
    assert found.figures["ODM"]["error_aware"] < 0.03


def test_the_prior_of_the_rival_is_about_the_next_row(found: Backtest) -> None:
    """One step ahead no belief is surer than the transition allows."""
    assert found.aware is not None
    moved = found.aware.prior.beliefs
    low, high = found.world.transition.min(axis=0), found.world.transition.max(axis=0)
    assert (moved >= low - 1e-12).all()
    assert (moved <= high + 1e-12).all()


@pytest.mark.usefixtures("undrawn")
def test_short_lines_say_what_is_hidden_from_whom_at_what_price(found: Backtest, tmp_path: Path) -> None:
    said = verdict(found)
    for line, part in zip(
        said,
        (
            "In short: ",
            "This holds for observers who see the weights alone",
            "Without protection: ",
            "naive observer, who takes the weights at face value",
            "aware observer, who knows the rules and follows all months",
            "Price: ",
        ),
        strict=True,
    ):
        assert part in line
        assert len(line) < 240
    assert any("its error without weights" in each for each in limits(found))
    write_backtest(found, tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text("utf-8"))["verdict"] == said
    read = pd.read_csv(tmp_path / "aware_PDM.csv", index_col=0)
    np.testing.assert_allclose(read, found.aware_estimates("PDM"))


def test_the_sentence_has_no_nan_where_no_weights_make_sense(found: Backtest) -> None:
    figures = {name: dict(found.figures[name], error_face_value=float("nan")) for name in found.names}
    shifted = replace(found)
    shifted.__dict__["figures"] = figures
    said = " ".join(verdict(shifted))
    assert "nan" not in said
    assert "no belief explains any decision of counter-adversarial or probabilistic" in said


def test_a_budget_of_regret_is_said_as_such(found: Backtest) -> None:
    shifted = replace(found, settings=replace(found.settings, budget=Budget.regret(0.01)))
    assert any("CDM and PDM: regret of 0.01 each month" in each for each in limits(shifted))


def test_a_target_for_every_step_has_no_mechanism() -> None:
    returns = market()
    targets = np.tile([0.3, 0.7], (len(returns) - TRAINING, 1))
    found = run(returns, replace(SETTINGS, measure=DesiredObfuscation(targets)))
    assert found.aware is None
    assert not any("Hidden" in each for each in [*verdict(found), *limits(found)])
    assert np.isnan(found.aware_estimates("CDM")).all(axis=None)
    assert "changes from step to step" in text_of(found)


@pytest.mark.usefixtures("coarse")
def test_beliefs_of_the_users_own() -> None:
    returns = market()
    dates = returns.index[TRAINING - 1 : -1]
    rows = np.random.default_rng(3).dirichlet([1.0, 1.0], size=len(dates))
    given = pd.DataFrame(rows, index=dates, columns=["calm", "turbulent"])
    found = run(returns, beliefs=given)
    np.testing.assert_allclose(found.beliefs, rows, atol=1e-15)
    np.testing.assert_allclose(found.weights("ODM"), found.problem.solve(rows), atol=1e-12)
    swapped = given[["turbulent", "calm"]]
    more = pd.concat([swapped.iloc[:1].set_axis([pd.Timestamp("1999-01-31")]), swapped])
    for same in some([more, given.set_axis([0, 1], axis=1)[[1, 0]]], 2):
        np.testing.assert_allclose(run(returns, beliefs=same).beliefs, rows, atol=1e-15)
    with pytest.raises(InputError, match=r"beliefs lack 2 of the 9 dates of the decisions: 2010-02-28, 2010-05-31"):
        run(returns, beliefs=given.drop(dates[[2, 5]]))
    with pytest.raises(InputError, match=r"train_until (\S+) ") as late:
        run(returns, beliefs=given.iloc[3:])
    until = re.search(r"train_until (\S+) ", str(late.value))
    assert until
    assert len(run(returns, replace(SETTINGS, train_until=until[1]), beliefs=given.iloc[3:]).beliefs) == 6
    for names in (["bear", "bull"], ["calm", "crisis"]):
        with pytest.raises(
            InputError, match=rf"columns \['{names[0]}', '{names[1]}'\], the regimes are \['calm', 'turbulent'\]"
        ):
            run(returns, beliefs=given.set_axis(names, axis=1))
    with pytest.raises(InputError, match=r"3 columns .* expected one per regime, by rising volatility"):
        run(returns, beliefs=given.assign(third=0.0))
    with pytest.raises(InputError, match=r"belief of 2010-01-31 sums to 1\.1"):
        run(returns, beliefs=given.assign(calm=[0.3] + [0.5] * 8, turbulent=[0.7, 0.6] + [0.5] * 7))


OWN = """{note}
[regimes]
names = ["calm", "wild"]
assets = ["Bonds & bills", "Ölwerte", "3M"]
transition = [[0.9, 0.1], [0.2, 0.8]]
means = [[0.03, 0.02, 0.01], [-0.02, 0.0, 0.01]]
covariances = [
  [[0.0004, 0.0, 0.0], [0.0, 0.0004, 0.0], [0.0, 0.0, 0.0004]],
  [[0.005, 0.0, 0.0], [0.0, 0.005, 0.0], [0.0, 0.0, 0.005]],
]
"""


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize(
    ("note", "kept"), [('note = "my view of 2009"', "my view of 2009"), ("", "regimes as given by the model file")]
)
def test_regimes_of_the_users_own_are_not_called_fitted(tmp_path: Path, note: str, kept: str) -> None:
    (tmp_path / "own.toml").write_text(OWN.format(note=note), "utf-8")
    found = run(market(), replace(SETTINGS, own=OwnModel.load(tmp_path / "own.toml")))
    assert found.investor.note.split("; ")[0] == kept
    assert re.findall(r".*\bfitted", text_of(found)) == ["Regimes as the model gives them, nothing is fitted"]


def test_other_measures_and_budgets() -> None:
    returns = market(extra=4)
    target = DesiredObfuscation([1.0, 0.0])
    with coarse_rivals(20), repeated_fits():
        desired = run(returns, replace(SETTINGS, measure=target, budget=Budget.regret(0.002)))
        absent = run(returns, replace(SETTINGS, measure=NonExistence(margin=0.05)))
    rows = desired.beliefs.to_numpy()
    np.testing.assert_allclose(desired.privacy("ODM"), -np.linalg.norm(rows - [1.0, 0.0], axis=1), atol=1e-6)
    assert (desired.episode.records["CDM"].decisions.regret <= 0.002 + 1e-12).all()
    assert (desired.privacy("CDM") >= desired.privacy("ODM") - 1e-9).all()
    assert absent.figures["ODM"]["n_privacy_not_finite"] == 4
    assert np.isnan(absent.figures["ODM"]["mean_privacy"])
    assert absent.figures["CDM"]["mean_privacy"] == 0.0
    assert "-" in text_of(absent)


@pytest.mark.usefixtures("coarse")
def test_the_order_of_the_assets_changes_no_figure() -> None:
    """Returns in whole per cent, so that their means tie with the cut points that discretise them."""
    returns = market(9, extra=instances(5)).round(2)
    one, other = (table_of(run(returns[names])) for names in (list(returns), list(returns)[::-1]))
    assert_same(other, one, rtol=1e-6, atol=1e-10)


@pytest.mark.usefixtures("coarse")
def test_duplicated_and_constant_assets_work() -> None:
    returns = market(extra=6)
    returns["copy"] = returns["3M"]
    returns["cash"] = 0.002
    found = run(returns)
    assert not found.summary.drop(columns="error_ceiling").isna().to_numpy().any()  # the sequential rule alone knows it
    np.testing.assert_allclose(found.weights("CDM").sum(axis=1), 1.0, atol=1e-9)


@pytest.mark.audit  # the shipped run; docs/commands.md shows figures of these regimes
def test_default_fit_has_three_recurring_regimes() -> None:
    """With the default number of restarts the regimes are the same for every seed, and each occurs after 1990."""
    data = load_industry_returns()
    recent = data.returns.loc[:"1990-03"]
    kept = pd.read_csv(DATA / "default_regimes.csv").to_numpy()  # of seed 0
    for seed in (0, 1):
        found = run_backtest(recent, BacktestSettings(seed=seed, sequential=False))
        assert len(found.fit.restarts) == RESTARTS
        np.testing.assert_allclose(found.problem.means, kept, atol=1e-5)
    beliefs = filter_beliefs(found.world, data.returns).predicted.loc["1990":]
    assert found.regimes == ("calm", "normal", "turbulent")
    assert (beliefs.max() > 0.7).all()
    assert found.figures["ODM"]["share_regime_named"] == 1.0


@pytest.mark.usefixtures("coarse")
def test_the_unit_and_the_zone_of_dates_change_nothing() -> None:
    returns = market(extra=instances(DECISIONS))
    dates = pd.DatetimeIndex(returns.index)
    plain = run(returns)
    for index in some((dates.as_unit("ns").tz_localize("Europe/Berlin"), dates.as_unit("s")), 2):
        pd.testing.assert_frame_equal(run(returns.set_axis(index)).summary, plain.summary)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.to_numpy(), "must be a DataFrame"),
        (lambda r: r.reset_index(drop=True), "DatetimeIndex"),
        (lambda r: r.iloc[::-1], "2010-08-31 after 2010-09-30"),
        (lambda r: pd.concat([r, r.iloc[-1:]]), "2010-09-30 after 2010-09-30"),
        (lambda r: r[["3M"]], "at least 2 assets"),
        (lambda r: r.set_axis(["A", "B", "A"], axis=1), "'A' 2 times"),
        (lambda r: r.mask(r == r.iloc[5, 1]), r"nan in row 5 \(2000-06-30 00:00:00\), column 1 \(Ölwerte\)"),
        (lambda r: 100 * r, "a loss of more than everything"),
        (lambda r: r.loc["2009-06":], r"7 rows \(2009-06-30 to 2009-12-31\); 2 regimes of 3 assets need at least 8"),
        (lambda r: r.loc[:"2010-01"], "1 rows follow the training sample"),
        (lambda r: r.loc[:"2009-12"], "must lie inside, for example 2005-01-31"),
        (lambda r: r.loc["2010-01":], "cover 2010-01-31 to 2010-09-30"),
        (lambda r: r.iloc[:0], "no rows"),
    ],
)
def test_returns_that_do_not_fit(change: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        run(change(market()))  # type: ignore[operator]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"regimes": 1}, "regimes"),
        ({"risk_aversion": 0.0}, "risk_aversion"),
        ({"budget": -0.1}, "budget"),
        ({"cost_bps": float("nan")}, "cost_bps"),
        ({"seed": -1}, "seed"),
        ({"measure": "maximal"}, "privacy measure"),
    ],
)
def test_settings_that_do_not_fit(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        BacktestSettings(**settings)  # type: ignore[arg-type]


@pytest.mark.usefixtures("coarse")
def test_a_riskless_rate_per_year_on_rows_of_a_month_is_pointed_out() -> None:
    returns = market(extra=2)
    doubted, low, sound = (
        run(returns, riskless=pd.Series(rate, index=returns.index)).market.suspicious for rate in (0.04, 0.024, 0.0135)
    )
    assert sound == ()  # the largest month of the packaged bills
    assert "a riskless return of 4.00% a month on average is 48% a year" in doubted[0]
    assert "a riskless return of 2.40% a month on average is 29% a year" in low[0]


@pytest.mark.usefixtures("coarse")
def test_percentages_of_mild_returns_are_pointed_out() -> None:
    returns = market(extra=2)
    mild = 0.006 * np.tanh(returns / np.median(returns.abs()))
    doubted, sound = (run(returns).market.suspicious for returns in (100.0 * mild, mild))
    assert sound == ()
    assert "half of the returns exceed" in doubted[0]
    assert "if they are percentages, divide them by 100" in doubted[0]


def test_other_refusals(found: Backtest, tmp_path: Path) -> None:
    returns = market()
    with pytest.raises(InputError, match="train_until must be a date"):
        run(returns, replace(SETTINGS, train_until="then"))
    with pytest.raises(InputError, match="riskless lack 1 of the 9 dates"):
        run(returns, riskless=pd.Series(0.0, index=returns.index[:-1]))
    with pytest.raises(InputError, match="no decision maker 'RDM'"):
        found.weights("RDM")
    with pytest.raises(InputError, match="no decision was made in 2020-01"):
        write_backtest(found, tmp_path / "months", month="2020-01")
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_backtest(found, blocked)


@pytest.mark.parametrize(
    ("increase", "optimal", "expected"),
    [
        ([0.2, 0.0], [-2.0, 4.0], [0.1, 0.0]),
        ([0.0, 0.3], [0.0, 0.0], [0.0, np.inf]),
        (0.0, -0.0, 0.0),
        (1.0, 0.0, np.inf),
    ],
)
def test_the_increase_relative_to_nothing(increase: object, optimal: object, expected: object) -> None:
    assert np.array_equal(relative_increase(increase, optimal), expected)  # type: ignore[arg-type]


@pytest.mark.parametrize("spent", [0.0, 1e-3])
def test_optimal_costs_of_zero_give_no_nan(found: Backtest, spent: float) -> None:
    def at_zero(record: Record) -> Record:
        nothing = np.zeros(DECISIONS)
        table = record.decisions.table
        return Record(Decisions(replace(table, optimal_cost=nothing, regrets=np.full_like(table.regrets, spent))))

    records = {name: at_zero(record) for name, record in found.episode.records.items()}
    shifted = replace(found, episode=replace(found.episode, records=records))
    for record in records.values():
        assert set(record.relative_increase) == {np.inf if spent else 0.0}
    said = verdict(shifted)[-1]
    assert "nan" not in said
    points = (
        "10 (counter-adversarial) and 10 (probabilistic)" if spent else "0 (counter-adversarial) and 0 (probabilistic)"
    )
    own = f"{points} basis points a month by the investor's own belief"
    told = f"{own}." if spent else f"{own}, 0.0% and 0.0% of |c*|, the size of the optimal cost, 0 basis points"
    assert told in said
    assert not np.isnan(table_of(shifted).loc["regret, % of the optimal cost, summed over all months"]).any()
