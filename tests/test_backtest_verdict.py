"""The first sentence of a verdict where there is nothing to hide, where silence is cheaper, and where one month costs most."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from inscrutable import cli
from inscrutable.experiments.backtest import Backtest, BacktestSettings, run_backtest
from inscrutable.experiments.rivals import RIVAL, loss_of
from inscrutable.reports.backtest import files_told, text_of, write_backtest
from inscrutable.reports.backtest_verdict import cautions, limits, nothing_to_hide, verdict
from small_runs import coarse_rivals, few_starts, repeated_fits

N_TRAINING, N_DECISIONS = 66, 14
SETTINGS = BacktestSettings(regimes=2, train_until="2006-06", sequential=False)


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    with coarse_rivals(), few_starts(2), repeated_fits():
        yield


def market() -> pd.DataFrame:
    draw = np.random.default_rng(0)
    spread = np.repeat([0.01, 0.05, 0.02, 0.06], 20)[:, None]
    months = pd.date_range("2001-01", periods=N_TRAINING + N_DECISIONS, freq="ME", name="month")
    return pd.DataFrame(0.01 + spread * draw.normal(size=(80, 2)), index=months, columns=["A", "B"])


def holding(calm: list[float]) -> Backtest:
    """A backtest of an investor who gives these probabilities to the calm regime."""
    returns = market()
    dates = returns.index[N_TRAINING - 1 : -1]
    beliefs = pd.DataFrame({"calm": calm, "turbulent": 1.0 - np.array(calm)}, index=dates)
    return run_backtest(returns, SETTINGS, beliefs=beliefs, restarts=2)


@pytest.fixture(scope="module")
def moving() -> Backtest:
    return holding([0.9, 0.2, 0.7, 0.1, 0.6, 0.3, 0.8, 0.4, 0.9, 0.2, 0.3, 0.7, 0.1, 0.8])


def shifted(found: Backtest, each: dict[str, float], **by_name: dict[str, float]) -> Backtest:
    """The backtest with other figures: of all decision makers, and of some."""
    changed = replace(found)
    changed.__dict__["figures"] = {
        name: {**found.figures[name], **each, **by_name.get(name, {})} for name in found.names
    }
    return changed


def recommends(found: Backtest) -> bool:
    """Whether the first sentence says that weights hide the belief from an observer."""
    return bool(re.search(r"\bhides?\b", verdict(found)[0].replace(" to hide from", "")))


def test_a_regime_that_never_changes_leaves_nothing_to_hide() -> None:
    """The belief moves, but the commonest regime is right in all months."""
    found = holding([0.6, 0.9, 0.7, 0.95, 0.8, 0.65, 0.9, 0.7, 0.85, 0.6, 0.95, 0.75, 0.9, 0.7])
    assert found.doubts == ()
    first = verdict(found)[0]
    assert first.startswith("In short: there is no regime to hide from either observer: ")
    assert "no likeliest regime that the commonest one does not" in first
    assert "100% of 14 months" in first
    assert not recommends(found)
    assert sum("cannot be judged" in line for line in verdict(found)) == 2
    assert any("no regime to hide" in each for each in cautions(found))


def test_a_constant_belief_leaves_nothing_to_hide() -> None:
    found = holding([0.7] * N_DECISIONS)
    said = verdict(found)
    assert said[0].startswith("In short: there is nothing to hide from either observer: the belief hardly moves")
    assert not recommends(found)
    assert not any(": by " in line for line in said)
    assert any("nothing to hide" in each for each in cautions(found))
    assert "e-1" not in " ".join(said)  # regrets of rounding


def test_weights_that_name_the_regime_no_oftener_than_chance(moving: Backtest) -> None:
    """Wide sets of beliefs: the unprotected weights are named in 97 % of the months, the commonest regime in 98 %."""
    given = {"error_without": 0.29, "base_rate": 0.98, "share_regime_named": 0.98, "error_face_value": 0.2}
    unprotected = {"share_regime_named": 0.97, "error_face_value": 0.03, "share_regime_named_followed": 1.0}
    found = shifted(moving, given, ODM=unprotected)
    first = verdict(found)[0]
    assert first.startswith("In short: there is no regime to hide from the naive observer: ")
    assert "named in 97% of 14 months" in first
    assert "right in 98%" in first
    assert "(error 0.03, without weights 0.29)" in first
    assert not recommends(found)
    (at_face_value,) = (line for line in verdict(found) if "at face value" in line)
    assert "cannot be judged" in at_face_value
    assert cautions(found)[0] == "The verdict judges no rule against the naive observer: there is no regime to hide."
    alone = replace(found, aware=None)
    alone.__dict__["figures"] = found.figures
    assert verdict(alone)[0].startswith("In short: there is no regime to hide from the naive observer: ")


def test_a_single_month_of_another_regime_is_a_caution(moving: Backtest) -> None:
    found = shifted(moving, {"base_rate": 13 / 14}, ODM={"share_regime_named": 1.0, "share_regime_named_followed": 1.0})
    said = "in only 1 of 14 months the likeliest regime is another than the commonest"
    assert cautions(found)[0] == f"Few months tell whether the regime is hidden: {said}."
    assert said in verdict(found)[0]
    assert not any("commonest" in each for each in [*cautions(moving), verdict(moving)[0]])


def test_what_the_naive_observer_reads_is_not_said_to_be_unrevealed_to_the_aware_one(moving: Backtest) -> None:
    """The aware observer's grid may miss a month: the weights tell that regime all the same."""
    own = {
        "share_regime_named": 1.0,
        "error_face_value": 0.0,
        "share_regime_named_followed": 0.5,
        "error_followed": 0.01,
    }
    found = shifted(moving, {"base_rate": 0.55}, ODM=own)
    assert not nothing_to_hide(found)
    unread = {"share_regime_named": float("nan"), "error_face_value": float("nan")}  # no belief explains the weights
    assert not nothing_to_hide(shifted(found, {}, ODM=unread))
    assert set(nothing_to_hide(shifted(found, {}, ODM={**own, "share_regime_named": 0.5}))) == {"naive", "aware"}


@pytest.mark.usefixtures("undrawn")
def test_strict_ends_with_a_code_where_there_is_nothing_to_hide(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("inscrutable.reports.page.can_write_pages", lambda: False)
    returns = market()
    returns.to_csv(tmp_path / "returns.csv")
    calm = np.where(np.arange(len(returns)) % 2, 0.9, 0.6)
    pd.DataFrame({"calm": calm, "turbulent": 1.0 - calm}, index=returns.index).to_csv(tmp_path / "beliefs.csv")
    given = [f"--{name}={tmp_path / name}.csv" for name in ("returns", "beliefs")]
    command = ["backtest", *given, "--train-until=2006-06", "--regimes=2", "--no-sequential", "-q"]
    run, made = run_backtest, list[Backtest]()

    def once(*asked: Any, **more: Any) -> Backtest:
        """The backtest of both commands, which differ in the code they end with."""
        made.extend([] if made else [run(*asked, **more)])
        return made[0]

    monkeypatch.setattr("inscrutable.experiments.backtest.run_backtest", once)
    assert cli.main([*command, f"--out={tmp_path / 'out'}"]) == 0
    assert cli.main([*command, f"--out={tmp_path / 'out'}", "--strict"]) == 4
    assert "doubtful: The verdict judges no rule" in capsys.readouterr().err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    assert "no regime to hide" in summary["cautions"][0]
    assert not summary["doubts"]


def test_what_costs_as_much_as_silence_is_named_in_the_first_sentence(moving: Backtest) -> None:
    """Silence as a constant portfolio that the observer knows beforehand, by the investor's beliefs, month by month."""
    assert moving.aware is not None
    beliefs, portfolio = moving.beliefs.to_numpy(), moving.problem.solve(moving.aware.prior.mean)
    silence = np.mean(
        [moving.problem.expected_cost(each, portfolio) - moving.problem.optimal_cost(each) for each in beliefs]
    )
    assert moving.known_silence_regret == pytest.approx(silence, rel=1e-9)
    told = "it is cheaper not to act on the belief at all"
    cheap = shifted(moving, {"mean_regret_unlimited": 0.5 * silence})
    assert not any(told in line for line in verdict(cheap))
    for regret in (moving.known_silence_regret, 1.5 * silence):
        dear = shifted(moving, {"mean_regret_unlimited": 0.5 * silence}, PDM={"mean_regret_unlimited": regret})
        first = verdict(dear)[0]
        assert "; probabilistic weights cost at least as much as silence" in first
        assert told in first
    both = shifted(moving, {"mean_regret_unlimited": 2.0 * silence})
    assert "counter-adversarial and probabilistic weights cost at least as much as silence" in verdict(both)[0]
    rival = loss_of(RIVAL.validate_python({"max_weight": 0.6}), moving.problem)
    other = replace(both, rival=rival)  # whoever else has a stake, silence costs the investor that
    other.__dict__["figures"] = both.figures
    assert told in verdict(other)[0]


def test_hiding_that_helps_the_aware_observer_is_a_caution(moving: Backtest) -> None:
    said = "CDM informs the aware observer better than no protection: error 0.15 instead of 0.24."
    open_to_all = shifted(moving, {"error_followed": 0.24, "error_without": 0.6})
    assert said not in cautions(open_to_all)
    assert said in cautions(shifted(open_to_all, {}, CDM={"error_followed": 0.15}))
    assert not any("informs" in each for each in cautions(shifted(open_to_all, {}, CDM={"error_followed": 0.23})))


HIDDEN = {"error_face_value": 1.2, "error_followed": 1.2, "share_regime_named": 0.3, "share_regime_named_followed": 0.3}


def test_an_aware_observer_with_another_law_or_a_coarse_grid_judges_nothing(moving: Backtest) -> None:
    """Where it errs more than the naive observer, or than its law expects, weights are not called hidden from it."""
    assert moving.aware is not None
    expected = moving.aware.prior.error
    read = {
        "error_face_value": 0.0,
        "error_followed": 0.0,
        "share_regime_named": 1.0,
        "share_regime_named_followed": 1.0,
    }
    good = shifted(moving, {"error_without": expected, **HIDDEN}, ODM=read)
    assert "from both observers" in verdict(good)[0]
    law = shifted(moving, {"error_without": 1.6 * expected, **HIDDEN}, ODM=read)
    grid = shifted(moving, {"error_without": expected, **HIDDEN}, ODM={**read, "error_followed": 0.11 * expected})
    for poor, said in ((law, "these beliefs follow another"), (grid, "errs more than the naive one (")):
        assert "from the naive observer (from the aware one it cannot be judged)" in verdict(poor)[0]
        assert any("cannot be judged, as its estimates are poor here" in line for line in verdict(poor))
        assert any(said in line for line in cautions(poor)) != any(said in line for line in cautions(good))
    plain = shifted(law, {"error_face_value": 0.0, "share_regime_named": 1.0})
    assert "market regimes from the naive observer (from the aware one it cannot be judged)" in verdict(plain)[0]
    assert "weights do not hide" in verdict(plain)[0]
    # Weights that say nothing are hidden from everybody.
    constant = shifted(law, {}, CDM={"bits_followed": 0.0})
    assert "counter-adversarial weights hide" in verdict(constant)[0]
    assert "both observers" in verdict(constant)[0]
    assert "counter-adversarial cannot be judged" not in " ".join(verdict(constant))
    unread = shifted(
        moving, {"error_without": expected, **HIDDEN}, ODM={**HIDDEN, **{k: read[k] for k in list(read)[::2]}}
    )
    assert "pass for hidden as well" not in " ".join(verdict(unread))


def test_the_worst_month_stands_beside_the_price(moving: Backtest) -> None:
    regrets = np.full(N_DECISIONS, 1e-4)
    regrets[4] = 60e-4
    record = moving.episode.records["CDM"]
    table = replace(record.decisions.table, regrets=regrets[:, None])
    worse = replace(record, decisions=type(record.decisions)(table))
    found = replace(moving, episode=replace(moving.episode, records={**moving.episode.records, "CDM": worse}))
    told = "60 in the worst month, 2006-10)"
    assert found.figures["CDM"]["mean_regret"] == pytest.approx(regrets.mean())
    assert sum(f"5.2 ({told}" in line for line in verdict(found)) == 1
    assert not any("worst month" in line for line in verdict(moving)[1:])
    silent = shifted(found, {"error_followed": float("nan")})  # without an answer
    assert f"5.2 (counter-adversarial; {told}" in verdict(silent)[-1]


def test_budgets_and_what_was_spent_are_told(moving: Backtest) -> None:
    assert "Budgets. CDM and PDM: 0.1 of |c*| each month, PDM on average over its two outcomes." in limits(moving)
    for name in moving.names[1:]:
        assert f"{moving.figures[name]['mean_regret_share']:.1%}" in verdict(moving)[-1]


def test_lucky_draws_stand_beside_the_expected_regret(moving: Backtest) -> None:
    even = shifted(moving, {"mean_regret": 2e-4, "mean_expected_regret": 2e-4})
    assert "in expectation" not in verdict(even)[-1]
    assert "1 (probabilistic; 2 in expectation)" in verdict(shifted(even, {}, PDM={"mean_regret": 1e-4}))[-1]


def test_what_no_belief_explains_to_the_naive_observer_is_judged_by_the_aware_one(moving: Backtest) -> None:
    assert moving.aware is not None
    blind = {
        "error_face_value": float("nan"),
        "share_regime_named": float("nan"),
        "error_without": moving.aware.prior.error,
    }
    read = {"error_followed": 0.0, "share_regime_named_followed": 1.0}
    own = {"error_face_value": 0.0, "share_regime_named": 1.0}
    found = shifted(moving, {**blind, **read}, ODM=own, PDM={**HIDDEN, **blind})
    first, second = verdict(found)[:2]
    assert first.startswith(
        "In short: probabilistic weights hide the investor's belief over 2 market regimes from the aware observer"
    )
    assert (
        "counter-adversarial weights do not hide it from the aware observer (no belief explains them to the naive one)"
        in first
    )
    assert second.startswith("The aware observer's law of the belief")
    poor = shifted(found, {"error_without": 1.6 * moving.aware.prior.error})
    assert "probabilistic weights may hide the investor's belief" in verdict(poor)[0]


def test_limits_of_the_answer_are_not_told_without_one(moving: Backtest) -> None:
    unknown = shifted(moving, {"error_followed": float("nan")})
    assert not any("law of the belief is that" in each for each in verdict(unknown))


@pytest.mark.usefixtures("undrawn")
def test_a_terminal_shows_the_verdict_below_the_table_and_families_of_files(moving: Backtest, tmp_path: Path) -> None:
    lines = text_of(moving).splitlines()
    start = lines.index(verdict(moving)[0])
    assert lines[start - 1] == ""
    assert lines[start - 2].startswith("months in which no privacy was affordable")
    written = write_backtest(moving, tmp_path)
    told = files_told(written)
    assert len(told) < 0.5 * len(written)
    assert any(re.fullmatch(r"weights_\*\.csv \(ODM, CDM, PDM\) +published weights", line) for line in told)
    for path in written:
        family = path.stem if path.suffix == ".png" else path.stem.partition("_")[0]
        assert any(family in line for line in told), path.name
