"""One step of a sequence of decisions that is kept in a file, by function and by command."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import multivariate_normal

from inscrutable import (
    Budget,
    GaussianEmission,
    HiddenMarkovModel,
    InputError,
    InvestorModel,
    MarkowitzProblem,
    SequentialDecisionMaker,
)
from inscrutable.cli import main
from inscrutable.decision_makers.sequential.state import SequenceState
from inscrutable.experiments import protect_sequence, silence
from inscrutable.experiments.attack import attack_weights
from inscrutable.experiments.attack_over_time import attack_over_time
from inscrutable.experiments.protect_sequence import protect_step
from inscrutable.experiments.silence import chain_of
from sizes import audited, instances
from small_runs import repeated_laws, short_simulations

ASSETS, REGIMES = ("A", "B", "C"), ("calm", "turbulent")
BELIEF = [0.25, 0.75]
SIMULATED = (20, 100) if audited() else (8, 50)
MEANS, SPREADS = np.array([[0.02, 0.0, 0.01], [-0.03, 0.01, 0.0]]), np.array([0.002 * np.eye(3), 0.006 * np.eye(3)])

TWO_MONTHS = pd.DataFrame(
    [[0.02, 0.01, 0.0], [-0.1, 0.0, 0.02]], pd.Index(["2024-01-31", "2024-02-29"], name="date"), list(ASSETS)
)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory):
    """A model of two regimes, its file, and a sequence that has begun; on a coarse grid, so that prices are found soon."""
    world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], GaussianEmission(MEANS, SPREADS), names=REGIMES)
    problem = MarkowitzProblem(MEANS, SPREADS, 4.0)
    model = InvestorModel(world, problem, ASSETS, REGIMES, Budget.regret(2e-4), "made for a test")
    folder = tmp_path_factory.mktemp("sequence")
    with pytest.MonkeyPatch.context() as patch, short_simulations(*SIMULATED), repeated_laws():
        patch.setattr(silence, "beliefs_resolution", lambda n_states: 6)
        begun = protect_step(model, BELIEF, folder / "state", Budget.regret(2e-4), rng=np.random.default_rng(0))
        yield model, model.save(folder / "model.json"), folder / "state", begun


def test_what_is_only_looked_at_is_not_recorded(small, tmp_path: Path) -> None:
    model, _, state, begun = small
    before = state.read_bytes()
    again = protect_step(model, BELIEF, state)
    assert state.read_bytes() == before
    assert again.published is None
    assert again.n_published == 0
    np.testing.assert_allclose(again.lottery.probabilities, begun.lottery.probabilities)
    assert 0.0 < again.long_run_error < again.prior_error
    assert again.table()["probability"].sum() == pytest.approx(1.0)
    assert "--publish draws once" in again.summary()


def test_a_published_decision_is_remembered(small, tmp_path: Path) -> None:
    model, _, state, begun = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    found = protect_step(model, BELIEF, copy, publish=True, rng=np.random.default_rng(1))
    assert found.published is not None
    assert np.abs(np.asarray(found.lottery.actions) - found.published).max(axis=1).min() < 1e-12
    assert (found.n_published, found.told > 0.0) == (1, True)
    follower = protect_step(model, BELIEF, copy)
    assert follower.n_published == 1
    # Between two steps the belief moves: the observer's mean goes back toward its long-run one.
    assert found.after is not None
    apart = np.abs(np.array([found.after, follower.before]) - begun.before).sum(axis=1)
    assert apart[1] < apart[0]
    # The same file and seed draw the same.
    other = Path(shutil.copy(state, tmp_path / "other"))
    repeated = protect_step(model, BELIEF, other, publish=True, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(repeated.published, found.published)


def test_the_budget_is_that_of_the_file_and_of_a_new_one_half_of_silence(small, tmp_path: Path) -> None:
    model, _, state, begun = small
    assert begun.budget == protect_step(model, BELIEF, state).budget == 2e-4
    prior = chain_of(model.world).prior
    costs = model.problem.state_costs(model.problem.solve(prior.beliefs))
    known = prior.weights @ (prior.beliefs * costs).sum(axis=1)
    silence = model.problem.optimal_cost(prior.weights @ prior.beliefs) - known
    new = protect_step(model, BELIEF, tmp_path / "new", rng=np.random.default_rng(0))
    assert [new.budget, new.silence] == pytest.approx([0.5 * silence, silence], rel=1e-9)
    assert "So the rule is silent" not in new.summary()
    silent = protect_step(model, BELIEF, tmp_path / "silent", Budget.regret(1.1 * silence))
    assert len(silent.lottery.probabilities) == 1
    assert "So the rule is silent" in silent.summary()


def test_a_new_sequence_has_a_budget_to_spend(small, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, file, _, _ = small
    for nothing in (Budget.regret(0.0), Budget.regret(1e-18), Budget.relative(0.0)):
        with pytest.raises(InputError, match="leaves only optimal decisions"):
            protect_step(model, BELIEF, tmp_path / "state", nothing)
    call = ["protect", "--model", str(file), "--belief", "0.25,0.75", "--state", str(tmp_path / "state")]
    assert main([*call, "--budget", "0"]) == 3
    assert "a budget of 0 leaves only optimal decisions" in capsys.readouterr().err
    assert not (tmp_path / "state").exists()
    same = MarkowitzProblem(MEANS[[0, 0]], SPREADS[[0, 0]], 4.0)  # silence is free
    alike = InvestorModel(model.world, same, ASSETS, REGIMES, Budget.regret(0.0), "made for a test")
    assert protect_step(alike, BELIEF, tmp_path / "state", Budget.regret(0.0)).silence == 0.0


def test_a_file_of_another_budget_or_a_damaged_one_is_refused_and_kept(small, tmp_path: Path) -> None:
    model, _, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    with pytest.raises(InputError, match="another budget"):
        protect_step(model, BELIEF, copy, Budget.regret(3e-4), publish=True)
    assert copy.read_bytes() == state.read_bytes()
    damaged = tmp_path / "damaged"
    damaged.write_bytes(state.read_bytes()[:200])
    with pytest.raises(InputError):
        protect_step(model, BELIEF, damaged, publish=True)
    assert damaged.read_bytes() == state.read_bytes()[:200]
    with pytest.raises(InputError, match="sum"):
        protect_step(model, [0.5, 0.6], copy, publish=True)
    assert copy.read_bytes() == state.read_bytes()


def test_what_was_recorded_last_is_shown_again(small, tmp_path: Path) -> None:
    model, _, state, begun = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    assert begun.latest is None
    assert "Last published" not in begun.summary()
    found = protect_step(model, BELIEF, copy, publish=True, rng=np.random.default_rng(3))
    looked = protect_step(model, BELIEF, copy)
    np.testing.assert_array_equal(looked.latest, found.published)
    assert f"Last published: A {found.published[0]:.6f}" in looked.summary()
    assert looked.figures()["last_published"] == dict(zip(ASSETS, found.published, strict=True))


def test_the_belief_of_the_next_step_comes_from_the_returns_so_far(
    small, tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    model, file, state, _ = small
    rows = TWO_MONTHS
    rows[["C", "A", "B"]].to_csv(tmp_path / "returns.csv")
    held = np.array([2.0, 1.0]) / 3.0  # the chain's long-run law
    for row in rows.to_numpy():
        seen = [multivariate_normal.pdf(row, mean, cov) for mean, cov in zip(MEANS, SPREADS, strict=True)]
        held = held * seen / (held @ seen) @ model.world.transition
    np.testing.assert_allclose(model.belief_after(rows[["B", "A", "C"]]), held, atol=1e-12)
    copy = shutil.copy(state, tmp_path / "state")
    call = ["protect", "--model", str(file), "--state", str(copy), "--json", "-q"]
    told = []
    for belief in (["--returns", str(tmp_path / "returns.csv")], ["--belief", ",".join(map(str, held))]):
        assert main([*call, *belief]) == 0
        told.append(json.loads(capsys.readouterr().out))
    assert told[0]["expected_regret"] == pytest.approx(told[1]["expected_regret"], rel=1e-9)
    assert main([*call[:-2], "--returns", str(tmp_path / "returns.csv")]) == 0
    assert "Caution: if these returns are public" in capsys.readouterr().out
    once = ["protect", "--model", str(file), "--returns", str(tmp_path / "returns.csv"), "-q"]
    assert main(once) == 0
    assert "Caution: if these returns are public" in capsys.readouterr().out
    few = [np.array(start) for start in np.eye(2)]  # the same from each regime before the first row
    for row in rows.to_numpy():
        seen = [multivariate_normal.pdf(row, mean, cov) for mean, cov in zip(MEANS, SPREADS, strict=True)]
        few = [each * seen / (each @ seen) @ model.world.transition for each in few]
    assert model.start_counts(rows) == pytest.approx(np.abs(few[0] - few[1]).max(), abs=1e-12)
    rows[:1].to_csv(tmp_path / "one.csv")
    for command in ([*call[:-2], "--returns"], once[:4]):
        assert main([*command, str(tmp_path / "one.csv")]) == 0
        assert "Caution: these returns are too few" in capsys.readouterr().out
    assert not caplog.text
    (0.4 * np.sign(rows)).to_csv(tmp_path / "percent.csv")
    assert main([*once[:4], str(tmp_path / "percent.csv")]) == 0
    assert "if they are percentages, divide them by 100" in caplog.text
    more = replace(model, reads="pmi").save(tmp_path / "more.json")
    assert InvestorModel.load(more).reads == "pmi"
    assert main(["protect", "--model", str(more), "--returns", str(tmp_path / "returns.csv"), "-q"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "backtest also rest on pmi. This belief is that of the returns alone." in shown
    for wrong, said in (
        (["--out", "x", "--belief", "1,0"], "--out does not go"),
        ([], "one of --belief and --returns"),
    ):
        assert main([*call, *wrong]) == 2
        assert said in capsys.readouterr().err


def test_one_decision_is_published_for_each_month_of_returns(
    small, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, file, state, _ = small
    copy, returns = shutil.copy(state, tmp_path / "state"), tmp_path / "returns.csv"
    call = ["protect", "--model", str(file), "--state", str(copy), "--returns", str(returns), "--json", "-q"]
    for months, code in ((1, 0), (1, 3), (2, 0), (1, 3), (2, 3)):
        TWO_MONTHS[:months].to_csv(returns)
        before = Path(copy).read_bytes()
        assert main([*call, "--publish", "--seed", "1"]) == code
        assert (Path(copy).read_bytes() == before) == (code != 0)
        assert main(call) == 0  # a look is free
    assert "has a decision on data to 2024-02-29 already, and these end at 2024-02-29" in capsys.readouterr().err
    days = ["2024-01-31", "2024-02-28", "2024-03-29"]  # the same month by another date, and one more
    pd.DataFrame(TWO_MONTHS.to_numpy()[[0, 1, 1]], pd.Index(days, name="date"), TWO_MONTHS.columns).to_csv(returns)
    assert main([*call, "--publish"]) == 3
    assert "has a decision on data to 2024-02-29, a date that these returns do not have" in capsys.readouterr().err


def test_revised_returns_are_named(small, tmp_path: Path) -> None:
    model, _, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    returns = pd.DataFrame(TWO_MONTHS.to_numpy(), pd.DatetimeIndex(TWO_MONTHS.index), TWO_MONTHS.columns)
    assert protect_step(model, BELIEF, copy, publish=True, periods=returns[:1]).revised is None
    assert protect_step(model, BELIEF, copy, periods=returns.iloc[:, ::-1] + 1e-17).revised is None
    old = protect_step(model, BELIEF, copy, periods=returns[:1])
    assert old.decided == old.figures()["no_returns_after"] == "2024-01-31"
    assert "no row after 2024-01-31" in old.summary()
    assert protect_step(model, BELIEF, copy, periods=returns).decided is None
    revised = returns.copy()
    revised.iloc[0, 0] += 1e-4
    for changed in (revised, 100 * returns, returns.assign(Other=0.0)):
        found = protect_step(model, BELIEF, copy, periods=changed)
        assert found.revised == found.figures()["returns_revised_to"] == "2024-01-31"
        assert "the returns to 2024-01-31 are not those of the last decision" in found.summary()
    assert protect_step(model, BELIEF, copy, publish=True, periods=revised).revised == "2024-01-31"
    assert protect_step(model, BELIEF, copy, periods=revised).revised is None
    with pytest.raises(InputError, match="dates as its index"):
        protect_step(model, BELIEF, copy, periods=revised.reset_index(drop=True))


def test_a_decision_without_a_date_says_so_and_a_missing_folder_is_refused(small, tmp_path: Path) -> None:
    model, _, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    said = "No date is recorded: publish once a period"
    assert said not in protect_step(model, BELIEF, copy).summary()
    assert said in protect_step(model, BELIEF, copy, publish=True).summary()
    assert said not in protect_step(model, BELIEF, copy, publish=True, periods=["2024-01-31"]).summary()
    with pytest.raises(InputError, match="does not exist: make it, or correct the path"):
        protect_step(model, BELIEF, tmp_path / "nowhere" / "state", Budget.regret(1.0))
    assert not (tmp_path / "nowhere").exists()


def test_two_rows_in_a_month_are_refused(small, tmp_path: Path) -> None:
    model, _, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    before = copy.read_bytes()
    months = [f"2023-{month:02d}-28" for month in range(1, 13)] + ["2024-01-30", "2024-01-31"]
    with pytest.raises(InputError, match="more than one row for 2024-01, expected one a period"):
        protect_step(model, BELIEF, copy, publish=True, periods=months)
    with pytest.raises(InputError, match="more than one row"):
        protect_step(model, BELIEF, tmp_path / "new", periods=months)
    assert not (tmp_path / "new").exists()
    assert copy.read_bytes() == before
    with pytest.raises(InputError, match="periods must be dates"):
        protect_step(model, BELIEF, copy, periods=["January"])
    days = ["2024-01-02", "2024-01-03", "2024-01-04"]  # daily rows are no months
    assert protect_step(model, BELIEF, copy, publish=True, periods=days).n_published == 1
    with pytest.raises(InputError, match="whose dates count the periods"):
        protect_step(model, BELIEF, copy, publish=True)
    assert protect_step(model, BELIEF, copy).n_published == 1  # a look needs no date


def test_dates_ascend_and_count_alike_in_any_spelling(small, tmp_path: Path) -> None:
    model, _, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    months = ["2024-04-30", "2024-05-31", "2024-06-30"]
    assert protect_step(model, BELIEF, copy, publish=True, periods=["20240430", "20240531"]).n_published == 1
    before = copy.read_bytes()
    for again in (["20240430", "20240531"], ["2024-W18-2", "2024-W22-5"], ["2024-04-30T00:00", "2024-05-31 00:00"]):
        with pytest.raises(InputError, match="has a decision on data to 2024-05-31 already"):
            protect_step(model, BELIEF, copy, publish=True, periods=again)
    returns = pd.DataFrame(0.01, pd.DatetimeIndex(months), list(ASSETS))
    for back in (months[::-1], returns[::-1], returns[1::-1], [months[2], *months]):
        with pytest.raises(InputError, match=r"periods must ascend: 2024-0(5|4)-3[01] comes after 2024-0(6|5)-3[01]"):
            protect_step(model, BELIEF, copy, publish=True, periods=back)
    with pytest.raises(InputError, match="periods must ascend: 2024-06-30 comes after 2024-06-30"):
        protect_step(model, BELIEF, copy, publish=True, periods=[*months, months[2]])
    assert copy.read_bytes() == before
    evening = ["2024-05-31T00:00:00", "2024-05-31T18:00:00"]  # midnight is the date alone
    assert [protect_step(model, BELIEF, copy, periods=each).n_skipped for each in (months, evening)] == [0, 0]


def test_a_date_written_otherwise_in_an_older_file_is_that_date(small, tmp_path: Path) -> None:
    model, _, state, _ = small
    copy = tmp_path / "state"
    for written in ("20240531", "2024-05-31T00:00:00"):
        replace(SequenceState.load(state), period=written).save(copy)
        with pytest.raises(InputError, match="has a decision on data to 2024-05-31 already"):
            protect_step(model, BELIEF, copy, publish=True, periods=["2024-05-31"])
    replace(SequenceState.load(state), period="May").save(copy)
    with pytest.raises(InputError, match="has a decision on data to 'May', expected a date"):
        protect_step(model, BELIEF, copy)


def test_hours_are_periods_of_their_own(small, tmp_path: Path) -> None:
    model, _, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    hours = pd.date_range("2024-01-31 22:00", periods=5, freq="h")
    returns = pd.DataFrame(0.001 * np.arange(15.0).reshape(5, 3), hours, list(ASSETS))
    assert protect_step(model, BELIEF, copy, publish=True, periods=returns[:1]).n_published == 1
    with pytest.raises(InputError, match="already, and these end at 2024-01-31T22:00:00"):
        protect_step(model, BELIEF, copy, publish=True, periods=returns[:1])
    found = protect_step(model, BELIEF, copy, publish=True, periods=returns[:4])
    assert (found.n_published, found.n_skipped, found.revised) == (2, 2, None)
    assert protect_step(model, BELIEF, copy, periods=returns.assign(A=returns["A"] + 1e-4)).revised
    later = returns.assign(A=[*returns["A"][:4], 1.0])  # a row after the last decision
    assert protect_step(model, BELIEF, copy, periods=later).revised is None
    midnight = protect_step(model, BELIEF, tmp_path / "state", publish=True, periods=later)
    assert (midnight.n_published, protect_step(model, BELIEF, copy, periods=later).revised) == (3, None)


def test_months_without_a_decision_pass_for_the_observer(small, tmp_path: Path) -> None:
    model, _, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    months = ["2024-01-31", "2024-02-29", "2024-03-31"]
    first = protect_step(model, BELIEF, copy, publish=True, rng=np.random.default_rng(3), periods=months[:1])
    assert first.n_skipped == 0
    looked = [protect_step(model, BELIEF, copy, periods=months[:n]) for n in (2, 3)]
    assert [each.n_skipped for each in looked] == [0, 1]
    np.testing.assert_allclose(looked[0].before, protect_step(model, BELIEF, copy).before, atol=1e-12)
    chain = chain_of(model.world)
    sequence = SequentialDecisionMaker(model.problem, Budget.regret(2e-4), chain=chain, rng=np.random.default_rng(0))
    law = sequence.begin().load(copy).observer.weights
    for found in looked:
        law = law @ chain.transition
        np.testing.assert_allclose(found.before, law @ chain.prior.beliefs, atol=1e-12)
    assert "Periods before this one without a decision: 1." in looked[1].summary()


def test_the_summary_names_the_ceiling_and_a_belief_off_the_grid(small) -> None:
    model, _, state, begun = small
    assert begun.is_off_grid
    assert f"between the {begun.n_beliefs} beliefs of the grid" in begun.summary()
    assert f"the ceiling is {begun.ceiling:.3f}, on a grid of {begun.n_beliefs} beliefs" in begun.summary()
    assert begun.long_run_error <= 1.02 * begun.ceiling <= 1.02 * begun.prior_error
    on_grid = protect_step(model, chain_of(model.world).prior.beliefs[0], state)
    assert not on_grid.is_off_grid
    assert "beliefs of the grid, as most" not in on_grid.summary()


def test_weights_that_the_rule_plays_under_no_belief_of_the_grid_count_as_the_nearest(
    small, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cap forbids all that is played to a belief between two of the grid, which then plays its own optimal decision."""
    model, _, _, _ = small
    capped = partial(SequentialDecisionMaker, worst_regret=Budget.regret(1e-6), information_price=float("inf"))
    monkeypatch.setattr(protect_sequence, "SequentialDecisionMaker", capped)
    found = protect_step(model, [0.41, 0.59], tmp_path / "state", publish=True, rng=np.random.default_rng(0))
    assert found.is_approximate
    assert "the observer's law takes the nearest" in found.summary()
    np.testing.assert_allclose(found.published, model.problem.solve([0.41, 0.59]), atol=1e-9)


def test_the_command_keeps_a_limit_on_turnover(small, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, file, _, _ = small
    state, published = tmp_path / "state", []
    for month, belief in enumerate(("0.1,0.9", "0.9,0.1", "0.2,0.8")[: instances(3, least=2)]):
        call = ["protect", "--model", str(file), "--belief", belief, "--state", str(state), "--publish", "--json"]
        assert main([*call, "--turnover", "0.6", "--seed", str(month)]) == 0
        published.append(list(json.loads(capsys.readouterr().out)["published"].values()))
    assert np.abs(np.diff(published, axis=0)).sum(axis=1).max() <= 0.6 + 1e-9
    assert main([*call, "--turnover", "0.5"]) == 3
    assert "another limit on turnover, 0.6 instead of 0.5" in capsys.readouterr().err
    assert main(call) == 3
    told = " ".join(capsys.readouterr().err.split())
    assert (
        "another limit on turnover, 0.6 instead of none. Go on as it was begun, with the same problem and limits"
        in told
    )
    assert main([*call, "--turnover", "0.6", "--max-weight", "0.7"]) == 3
    assert "other decisions, such as those of other limits" in " ".join(capsys.readouterr().err.split())
    dates = pd.date_range("2024-01-31", periods=len(published), freq="ME")
    pd.DataFrame(published, dates, list(ASSETS)).to_csv(tmp_path / "published.csv")
    ask = ["attack", "--model", str(file), "--weights", str(tmp_path / "published.csv"), "--mechanism", "sequential"]
    assert main([*ask, "--state", str(state), "--turnover", "0.6", "--digits", "17", "--json"]) == 0
    read = json.loads(capsys.readouterr().out)
    assert [row["reading"] for row in read["over_time"]] == ["used"] * len(published)


def test_what_may_be_wrong_about_an_observer_is_in_the_summary(small, tmp_path, capsys) -> None:
    _, file, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    pd.DataFrame([[0.1, 0.1, 0.8]], pd.DatetimeIndex(["2024-01-31"]), list(ASSETS)).to_csv(tmp_path / "published.csv")
    ask = ["attack", "--model", str(file), "--weights", str(tmp_path / "published.csv"), "--mechanism", "sequential"]
    assert main([*ask, "--state", str(copy), "--json"]) == 0
    assert "the rule plays nothing near" in json.loads(capsys.readouterr().out)["cautions"][0]


def test_a_sequence_goes_on_with_the_labels_that_it_began_with(small, tmp_path: Path) -> None:
    """Costs that are alike for other labels are those of another problem."""
    model, _, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    names = HiddenMarkovModel(model.world.transition, GaussianEmission(MEANS, SPREADS), names=REGIMES[::-1])
    plain = MarkowitzProblem(MEANS, SPREADS, 4.0)
    for assets, regimes, world in ((("B", "A", "C"), REGIMES, model.world), (ASSETS, REGIMES[::-1], names)):
        other = InvestorModel(world, plain, assets, regimes, Budget.regret(2e-4), "made for a test")
        with pytest.raises(
            InputError, match=r"of another problem: it has the (assets A, B, C|states calm, turbulent), not"
        ):
            protect_step(other, BELIEF, copy)


def test_the_command_publishes_once(small, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, file, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    call = ["protect", "--model", str(file), "--belief", "0.25,0.75", "--state", str(copy)]
    assert main([*call, "--publish", "--seed", "2"]) == 0
    shown = capsys.readouterr().out
    assert "Caution: whoever knows the seed knows the draw" in shown
    assert "Publish these weights" in shown
    assert "1 decision published so far" in shown
    assert main([*call, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["n_published"] == 1
    assert told["published"] is None
    assert sum(each["probability"] for each in told["lottery"]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "wrong", [["--publish"], ["--state", "s", "--out", "x"], ["--state", "s", "--measure", "desired"]]
)
def test_flags_that_do_not_go_together(small, wrong: list[str]) -> None:
    _, file, _, _ = small
    assert main(["protect", "--model", str(file), "--belief", "0.25,0.75", *wrong]) == 2


def test_who_knows_the_sequential_rule_reads_what_the_sequence_keeps(small, tmp_path: Path) -> None:
    model, _, state, _ = small
    copy = Path(shutil.copy(state, tmp_path / "state"))
    rng = np.random.default_rng(5)
    steps = [
        protect_step(model, belief, copy, publish=True, rng=rng)
        for belief in ([1 / 6, 5 / 6], [0.5, 0.5], [5 / 6, 1 / 6])
    ]
    published = pd.DataFrame([step.published for step in steps], columns=list(ASSETS))
    found = attack_over_time(attack_weights(model, published), "sequential", state=copy)
    np.testing.assert_allclose(found.inferred.mean, [step.after for step in steps], atol=1e-9)
    assert found.table()["expected error"].between(0.0, 1.0).all()
    rounded = attack_over_time(attack_weights(model, published.round(6), decimals=6), "sequential", state=copy)
    np.testing.assert_allclose(rounded.inferred.mean, found.inferred.mean, atol=1e-9)
    assert (found.n_off, rounded.n_off) == (0, 0)
    moved = published.round(6).assign(
        **{ASSETS[0]: published[ASSETS[0]] + 0.01, ASSETS[1]: published[ASSETS[1]] - 0.01}
    )
    assert attack_over_time(attack_weights(model, moved, decimals=6), "sequential", state=copy).n_off == 3
    with pytest.raises(InputError, match="another budget"):
        attack_over_time(found.attack, "sequential", Budget.regret(3e-4), state=copy)


def test_a_sequence_of_another_model_is_refused(small) -> None:
    model, _, state, _ = small
    bolder = InvestorModel(
        model.world,
        MarkowitzProblem(model.problem.means, model.problem.covariances, 2.0),
        ASSETS,
        REGIMES,
        model.budget,
    )
    attack = attack_weights(bolder, pd.DataFrame([[1.0, 0.0, 0.0]], columns=list(ASSETS)))
    with pytest.raises(InputError, match="cannot be continued: it is of another problem"):
        attack_over_time(attack, "sequential", state=state)


def test_optimal_weights_are_read_to_the_width_of_a_cell(small) -> None:
    """Cells are a hundredth wide, and less one step ahead."""
    model, _, _, _ = small
    beliefs = chain_of(model.world).prior.beliefs[[1, 2]]
    published = pd.DataFrame(model.problem.solve(beliefs), columns=list(ASSETS))
    found = attack_over_time(attack_weights(model, published), "optimal")
    np.testing.assert_allclose(found.inferred.mean, beliefs, atol=5e-3)
    assert "Caution" not in found.summary()
    assert found.n_off == 0
    none = pd.DataFrame([[0.0, 1.0, 0.0], *published.to_numpy()], columns=list(ASSETS))
    said = attack_over_time(attack_weights(model, none), "optimal").summary()
    assert "Caution: 1 of the 3 rows are explained by no belief" in said
    assert "the rule plays nothing near 1 of the 3 rows under any belief" in said
    with pytest.raises(InputError, match="rule must be one of"):
        attack_over_time(found.attack, "silence")
    dated = published.set_axis(pd.to_datetime(["2020-01-31", "2020-02-29"]))
    with pytest.raises(InputError, match="order of time: after 2020-02-29 comes 2020-01-31"):
        attack_over_time(attack_weights(model, dated[::-1]), "optimal")
    months = pd.to_datetime(["2020-01-31", "2020-02-29", "2020-03-31", "2020-08-31"])
    gaps = attack_over_time(attack_weights(model, pd.concat([published] * 2).set_axis(months)), "optimal")
    assert "their dates do not: no row for 2020-04" in gaps.summary()
    with pytest.raises(InputError, match="prices are in the file"):
        attack_over_time(found.attack, "sequential")


def test_no_row_contradicts_one_who_follows_optimal_weights(small, fresh_rng: np.random.Generator) -> None:
    """Also where the belief leaps as the simulated path never did."""
    model, _, _, _ = small
    beliefs = fresh_rng.dirichlet([0.5, 0.5], 30)
    published = pd.DataFrame(model.problem.solve(beliefs), columns=list(ASSETS))
    found = attack_over_time(attack_weights(model, published), "optimal")
    assert not found.table()["reading"].str.startswith("passed over").any()


def test_attack_by_command_with_the_rule(small, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, file, state, _ = small
    published = pd.DataFrame(model.problem.solve([[0.4, 0.6], [0.5, 0.5]]), columns=list(ASSETS))
    published.to_csv(tmp_path / "weights.csv", index=False, float_format="%.17g")
    call = ["attack", "--model", str(file), "--weights", str(tmp_path / "weights.csv")]
    assert main([*call, "--mechanism", "cdm", "--budget", "regret:0.0001", "--out", str(tmp_path / "out")]) == 0
    assert "the aware observer, who knows the rule (cdm)" in capsys.readouterr().out
    assert len(pd.read_csv(tmp_path / "out" / "attack_over_time.csv")) == 2
    assert main([*call, "--mechanism", "sequential", "--state", str(state), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["over_time"]) == 2
    assert main([*call, "--mechanism", "sequential", "--state", str(state), "--budget", "regret:0.0003"]) == 3
    assert "another budget" in capsys.readouterr().err
    assert main([*call, "--mechanism", "sequential"]) == 2
    assert main([*call, "--state", str(state)]) == 2
