"""Whether a past record of weights hid the beliefs behind it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import cli
from inscrutable.decision_makers import CounterAdversarialDecisionMaker
from inscrutable.errors import InputError
from inscrutable.experiments.attack import Attack, attack_weights
from inscrutable.experiments.attack_judged import judge_attack
from inscrutable.experiments.attack_over_time import AttackOverTime, attack_over_time
from inscrutable.experiments.holding import Reached
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.worlds import HiddenMarkovModel
from test_attack import market, published

MODEL = market(20, 5)
REGIMES = list(MODEL.regimes)


def record(n_rows: int, seed: int = 3) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Beliefs by date, and the counter-adversarial weights for them."""
    dates = pd.date_range("2020-01", periods=n_rows, freq="ME", name="date")
    held = pd.DataFrame(np.random.default_rng(seed).dirichlet(np.ones(3), n_rows), dates, REGIMES)
    actions = CounterAdversarialDecisionMaker(MODEL.problem, 0.1).decide_many(held.to_numpy()).action
    return held, pd.DataFrame(actions, dates, list(MODEL.assets))


@pytest.fixture(scope="module")
def followed() -> tuple[pd.DataFrame, Attack, AttackOverTime]:
    """Twenty beliefs, what their weights say, and what the weights so far say to one who knows the rule."""
    held, weights = record(20)
    attack = attack_weights(MODEL, weights)
    return held, attack, attack_over_time(attack, "cdm")


def test_errors_and_namings_are_those_of_the_estimates(followed: tuple[pd.DataFrame, Attack, AttackOverTime]) -> None:
    held, attack, over_time = followed
    # Rows and columns of beliefs are joined by label, whatever their order.
    judged = judge_attack(attack, held.iloc[::-1, ::-1], over_time)
    eigenvalues, vectors = np.linalg.eig(MODEL.world.transition.T)
    long_run = np.real(vectors[:, np.argmax(np.real(eigenvalues))])
    long_run /= long_run.sum()
    true, commonest = held.to_numpy(), np.bincount(held.to_numpy().argmax(axis=1)).max() / 20
    said = judged.summary().splitlines()
    assert said[0] == "Compared with your own beliefs in 20 rows:"
    for line, each, estimates in zip(
        said[1:3], judged.observers, (attack.estimates, over_time.inferred.mean), strict=True
    ):
        assert each.asked
        assert each.asked.error_without == pytest.approx(float(np.sqrt(((true - long_run) ** 2).sum(axis=1).mean())))
        assert each.asked.chance == pytest.approx(commonest)
        assert each.reached.error == pytest.approx(float(np.sqrt(((true - estimates) ** 2).sum(axis=1).mean())))
        assert each.reached.named == pytest.approx(float((true.argmax(axis=1) == estimates.argmax(axis=1)).mean()))
        assert (": yes (" in line) == bool(each.is_hidden)
        assert ("cannot be judged" in line) == (each.is_hidden is None) == each.is_misled
        assert each.is_misled or each.is_hidden == each.asked.is_met(each.reached)


def test_optimal_weights_hide_nothing_and_rows_that_are_not_read_do_not_count() -> None:
    held, _ = record(5)
    weights = published(MODEL, held.to_numpy(), None).set_axis(held.index)
    judged = judge_attack(attack_weights(MODEL, weights), held)
    assert judged.observers[0].reached.error < 0.05  # sets larger than points have a centre
    assert ": no (error 0.0" in judged.summary()
    weights.iloc[2] = np.full(5, 0.2)
    judged = judge_attack(attack_weights(MODEL, weights), held)
    assert "5 rows; the naive observer reads 4 of them" in judged.summary()
    read = weights.index != weights.index[2]
    assert judged.observers == judge_attack(attack_weights(MODEL, weights[read]), held[read]).observers
    one = judge_attack(attack_weights(MODEL, weights.iloc[:1]), held)
    assert "in 1 row:\nError of the naive observer" in one.summary()
    none = judge_attack(attack_weights(MODEL, weights.iloc[[2, 2]].set_axis(held.index[:2])), held)
    assert "not known, as no belief explains any row" in none.summary()
    assert "nan" not in none.summary()
    assert none.figures()["observers"][0]["is_hidden"] is None


@pytest.mark.parametrize("likely", [0, 1, 2])
def test_weights_that_every_belief_explains_name_no_regime(likely: int) -> None:
    held, _ = record(4)
    held[:] = 0.1 + 0.7 * np.eye(3)[likely]
    weights = pd.DataFrame([[0, 0, 0, 0, 1]] * 4, held.index, list(MODEL.assets))
    (found,) = judge_attack(attack_weights(MODEL, weights, decimals=0), held).observers
    assert found.reached.named == pytest.approx(1 / 3)


def test_a_chain_without_a_unique_stationary_law_has_no_verdict() -> None:
    held, weights = record(4)
    world = HiddenMarkovModel(np.eye(3), MODEL.world.emission, initial=np.full(3, 1 / 3))
    model = InvestorModel(world, MODEL.problem, MODEL.assets, MODEL.regimes)
    assert "\nError of the naive observer" in judge_attack(attack_weights(model, weights), held).summary()


def test_rows_and_regimes_that_are_missing_are_named() -> None:
    held, weights = record(4)
    attack = attack_weights(MODEL, weights)
    with pytest.raises(InputError, match="no row for 2020-03-31, expected one row for each of the 4"):
        judge_attack(attack, held.drop(held.index[2]))
    with pytest.raises(InputError, match="several rows under one label"):
        judge_attack(attack, pd.concat([held, held.iloc[:1]]))
    with pytest.raises(InputError, match="expected the model's regimes"):
        judge_attack(attack, held.rename(columns={REGIMES[0]: "else"}))
    with pytest.raises(InputError, match="sums to"):
        judge_attack(attack, 3 * held)


def test_regimes_have_names_of_their_own() -> None:
    held, weights = record(3)
    model = InvestorModel(MODEL.world, MODEL.problem, MODEL.assets, ("calm", "normal", "turbulent"))
    named = held.set_axis(["calm", "normal", "turbulent"], axis=1)
    plain = judge_attack(attack_weights(MODEL, weights), held)
    assert judge_attack(attack_weights(model, weights), named.iloc[:, ::-1]).figures() == plain.figures()


@pytest.mark.usefixtures("undrawn")
def test_the_command_compares_and_reads_other_digits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    held, weights = record(6)
    MODEL.save(tmp_path / "model.json")
    held.to_csv(tmp_path / "beliefs.csv")
    weights.to_csv(tmp_path / "weights.csv")
    command = ["attack", "--model", str(tmp_path / "model.json"), "--weights", str(tmp_path / "weights.csv"), "--quiet"]
    assert cli.main([*command, "--beliefs", str(tmp_path / "beliefs.csv"), "--mechanism", "cdm", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)["judged"]
    asked = judge_attack(attack_weights(MODEL, weights), held)
    assert figures["observers"][0]["error"] == pytest.approx(asked.observers[0].reached.error, abs=1e-6)
    assert len(figures["observers"]) == 2
    out = tmp_path / "out"
    assert cli.main([*command, "--beliefs", str(tmp_path / "beliefs.csv"), "--out", str(out)]) == 0
    assert json.loads((out / "summary.json").read_text())["judged"]["n_rows"] == 6
    assert "Hidden from the naive observer, who takes the weights at face value: " in capsys.readouterr().out
    assert cli.main([*command, "--beliefs", str(tmp_path / "beliefs.csv"), "--regret", "20bp"]) == 2
    assert "leave out --regret" in " ".join(capsys.readouterr().err.split())

    corner = pd.DataFrame([[0, 0, 0, 0, 1]], columns=list(MODEL.assets))
    corner.to_csv(tmp_path / "weights.csv", index_label="row")
    assert cli.main(command) == 0
    said = capsys.readouterr().out
    assert "Caution: whole numbers are read as weights rounded to whole numbers" in said
    assert " or ".join(REGIMES) in said, "no regime is likelier than another"
    assert cli.main([*command, "--digits", "8"]) == 0
    said = capsys.readouterr().out
    assert "Caution: whole numbers" not in said
    assert "rounding to" not in said
    assert cli.main([*command, "--beliefs", str(tmp_path / "beliefs.csv")]) == 2
    assert "give weights with a first column of dates" in capsys.readouterr().err
    assert cli.main([*command, "--digits", "8", "--normalise"]) == 2


def test_an_asset_without_a_column_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, weights = record(3)
    MODEL.save(tmp_path / "model.json")
    weights.drop(columns="A2").to_csv(tmp_path / "weights.csv")
    command = [
        "--model",
        str(tmp_path / "model.json"),
        "--weights",
        str(tmp_path / "weights.csv"),
        "--normalise",
        "--quiet",
    ]
    for verb in ("attack", "protect"):
        assert cli.main([verb, *command]) == 0
        assert "Caution: the file has no column for A2; the weight there counts as 0" in capsys.readouterr().out
    weights[["A0"]].mul(0.0).to_csv(tmp_path / "weights.csv")
    assert cli.main(["attack", *command]) == 3
    assert "the file does not name A1, A2, A3, A4" in capsys.readouterr().err


def test_rows_of_another_rule_are_not_judged_by_this_one() -> None:
    held, weights = record(12)
    turned = pd.DataFrame(weights.to_numpy()[:, ::-1], weights.index, weights.columns)
    attack = attack_weights(MODEL, turned, regret=1.0)
    over_time = attack_over_time(attack, "cdm")
    assert over_time.n_off > 6
    judged = judge_attack(attack, held, over_time)
    assert judged.observers[1].is_hidden is None
    assert f"cannot be judged, as {over_time.n_off} of 12 rows are none that this rule plays" in judged.summary()
    assert "cannot be judged, as it errs" in judge_attack(attack, held, replace(over_time, n_off=6)).summary()


def test_where_one_regime_is_always_the_likeliest_the_error_alone_decides() -> None:
    held, weights = record(6)
    held.iloc[:] = np.linspace([0.8, 0.15, 0.05], [0.5, 0.2, 0.3], 6)
    weights.iloc[:] = CounterAdversarialDecisionMaker(MODEL.problem, 0.5).decide_many(held.to_numpy()).action
    judged = judge_attack(attack_weights(MODEL, weights), held)
    assert judged.observers[0].asked is not None
    assert judged.observers[0].asked.chance == 1.0
    assert judged.observers[0].is_hidden
    assert "One regime is the likeliest in all the rows, so naming it tests nothing" in judged.summary()


def test_rounded_rows_are_those_that_the_rule_plays() -> None:
    """Four of the twenty are weights for beliefs that the filter does not reach, however they are rounded."""
    _, weights = record(20)
    for decimals in (None, 3, 2):
        written = weights if decimals is None else weights.round(decimals)
        assert attack_over_time(attack_weights(MODEL, written, decimals=decimals), "cdm").n_off == 4, decimals


def test_an_aware_observer_that_errs_far_more_than_it_expects_is_not_judged(
    followed: tuple[pd.DataFrame, Attack, AttackOverTime],
) -> None:
    """Counter-adversarial weights of another budget seemed hidden from an observer that took them for those of the model's."""
    held, attack, own = followed
    over_time = attack_over_time(attack, "cdm", 0.03)
    assert "a budget of 0.03 of |c*|" in over_time.summary()
    assert "the model's budget" in own.summary()
    observer = judge_attack(attack, held, over_time).observers[1]
    assert observer.expected == pytest.approx(np.sqrt(np.mean(over_time.inferred.spread**2)))
    assert observer.asked
    far = observer._replace(reached=Reached(observer.reached.name, 0.9 * observer.asked.error_without, 0.0), n_off=0)
    assert far._replace(expected=0.5 * far.reached.error).is_hidden
    assert far._replace(expected=0.4 * far.reached.error).is_hidden is None
    assert "cannot be judged, as it errs" in far._replace(expected=0.4 * far.reached.error).summary(REGIMES)


def test_an_aware_observer_that_errs_more_than_without_weights_is_pointed_out(
    followed: tuple[pd.DataFrame, Attack, AttackOverTime],
) -> None:
    """The columns of two regimes exchanged: the beliefs seemed hidden, though the weights tell them."""
    held, attack, over_time = followed
    first, second, third = held.columns
    exchanged = held.rename(columns={first: second, second: third, third: first})
    judged = judge_attack(attack, exchanged, over_time)
    assert judged.observers[1].is_misled
    assert judged.observers[1].is_hidden is None
    assert "each under its regime's name" in judged.summary()


@pytest.mark.usefixtures("undrawn")
def test_what_is_interrupted_leaves_the_results_of_an_earlier_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, weights = record(3)
    MODEL.save(tmp_path / "model.json")
    out = tmp_path / "out"
    command = [
        "attack",
        f"--model={tmp_path / 'model.json'}",
        f"--weights={tmp_path / 'weights.csv'}",
        f"--out={out}",
        "-q",
    ]
    weights.to_csv(tmp_path / "weights.csv")
    assert cli.main(command) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert "files.json" in before
    weights[::-1].set_axis(weights.index).to_csv(tmp_path / "weights.csv")

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("inscrutable.reports.attack.save_figure", interrupted)  # after the tables
        assert cli.main(command) == 130
    assert "has the results of an earlier run or of this one" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert cli.main(command) == 0
    assert (out / "attack.csv").read_bytes() != before["attack.csv"]
