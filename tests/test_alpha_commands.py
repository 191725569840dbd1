"""Private means by command and by file, and what a backtest of them says."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    AlphaDecisionMaker,
    AlphaProblem,
    AlphaSettings,
    FactorRisk,
    InputError,
    LinearGaussianWorld,
    alpha_backtest,
    box,
    cli,
    momentum_alphas,
    run_alpha_backtest,
    simplex,
)
from inscrutable.datasets import load_industry_returns, read_labelled_matrix
from inscrutable.experiments.alpha_protect import protect_alphas
from inscrutable.experiments.alpha_run import read_linear_world
from sizes import instances, some

NAMES = ["Oil", "Food", "Steel"]
WORLD = {
    "states": NAMES,
    "transition": (0.9 * np.eye(3)).tolist(),
    "process": (1e-4 * np.eye(3)).tolist(),
    "sensor": np.eye(3).tolist(),
    "noise": (1e-4 * np.eye(3)).tolist(),
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A risk, a prior with its rows in another order, a month of alphas, and a world."""
    risk = pd.DataFrame(np.diag([0.04, 0.01, 0.02]), NAMES, NAMES)
    risk.to_csv(tmp_path / "V.csv", index_label="asset")
    (risk.loc[NAMES[::-1], NAMES[::-1]] / 100).to_csv(tmp_path / "S.csv", index_label="asset")
    month = pd.DatetimeIndex(["2020-01-31"], name="date")
    pd.DataFrame([[0.01, 0.02, 0.03]], month, NAMES[::-1]).to_csv(tmp_path / "A.csv")
    (tmp_path / "W.json").write_text(json.dumps(WORLD), "utf-8")
    return tmp_path


def run(capsys: pytest.CaptureFixture[str], folder: Path, *options: object) -> tuple[int, str, str]:
    """Protect the month's alphas."""
    fixed = ["protect", "--alphas", folder / "A.csv", "--covariance", folder / "V.csv", "--risk-aversion", 2.5]
    code = cli.main([str(each) for each in (*fixed, *options)])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_a_month_by_command(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    code, out, err = run(capsys, folder, "--prior-covariance", folder / "S.csv", "--seed", 1, "--json")
    assert code == 0, err
    assert "a law estimated from your own alphas reveals them" in err
    found = json.loads(out)
    assert found["bits_a_step"] == pytest.approx(1.5)  # equal costs of all directions: half a bit each
    risk = np.diag([0.04, 0.01, 0.02])
    maker = AlphaDecisionMaker(AlphaProblem(risk, 2.5), 0.5, prior_covariance=risk / 100)
    drawn = maker.decide([0.03, 0.02, 0.01], rng=np.random.default_rng(1))
    assert found["regrets"] == pytest.approx([drawn.regret])
    assert found["decisions"]["2020-01-31"] == pytest.approx(dict(zip(NAMES, drawn.action.tolist(), strict=True)))


def test_what_cannot_be_a_covariance_of_fractions_is_refused(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    risk = pd.read_csv(folder / "V.csv", index_col=0)
    pd.DataFrame([[0.5, 0.3, 0.2]], ["now"], NAMES).to_csv(folder / "w.csv")
    for table, said in (
        (pd.DataFrame(np.eye(3), NAMES, NAMES), "correlations"),
        (risk * 1e4, "variances of percentages"),
    ):
        table.to_csv(folder / "V.csv", index_label="asset")
        code, _, err = run(capsys, folder, "--prior-covariance", folder / "S.csv")
        assert code == 3
        assert "3 of 3 variances are 1 or more" in err
        assert f"look like {said};" in err
        given = ["--weights", folder / "w.csv", "--covariance", folder / "V.csv", "--risk-aversion", 2.5]
        assert cli.main(["views", *map(str, given)]) == 3
        assert said in capsys.readouterr().err


def test_alphas_far_outside_their_law_are_named(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    """At most two standard deviations as fractions."""
    table = pd.read_csv(folder / "A.csv", index_col=0)
    law = ("--prior-covariance", folder / "S.csv")
    assert "Caution: these alphas" not in run(capsys, folder, *law)[1]
    (100.0 * table).to_csv(folder / "A.csv")
    out = run(capsys, folder, *law)[1]
    assert "up to 200 standard deviations" in " ".join(out.split())


def test_a_month_of_what_may_be_held(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    code, out, err = run(
        capsys,
        folder,
        "--prior-covariance",
        folder / "S.csv",
        "--held",
        "long-only",
        "--cap",
        0.6,
        "--seed",
        1,
        "--json",
    )
    assert code == 0, err
    found = json.loads(out)
    held = np.array(list(found["decisions"]["2020-01-31"].values()))
    # Beside what the limits may cost at most stands the budget, half of what the constant portfolio costs under them.
    problem = AlphaProblem(np.diag([0.04, 0.01, 0.02]), 2.5, simplex(3) & box([-1.0] * 3, [0.6] * 3))
    means = np.random.default_rng(7).multivariate_normal(np.zeros(3), np.diag([0.04, 0.01, 0.02]) / 100, 4000)
    silent = problem.regret(means, problem.optimum(np.zeros(3)))
    simulated = found["simulated_regret"]
    spread = np.hypot(0.5 * silent.std() / np.sqrt(len(silent)), simulated["standard_error"])
    assert abs(simulated["mean"] - 0.5 * silent.mean()) <= 5 * spread
    assert simulated["mean"] < found["regret_a_step"]
    code, out, err = run(capsys, folder, "--prior-covariance", folder / "S.csv", "--held", "long-only")
    assert code == 0, err
    assert "The limits make hiding cheaper, so the rule hides more" in out
    assert re.findall(r"([\d.]+)% of silence", out) == ["50.0"], out  # of silence under the limits, not without them
    assert held.sum() == pytest.approx(1.0)
    assert held.min() >= -1e-9
    assert held.max() <= 0.6 + 1e-9


def test_limits_that_are_never_reached_hide_no_more(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    """It said that the rule hides more, whichever way the simulation was off."""
    pd.DataFrame(1e-8 * np.eye(3), NAMES, NAMES).to_csv(folder / "S.csv", index_label="asset")
    out = run(capsys, folder, "--prior-covariance", folder / "S.csv", "--held", "long-only")[1]
    stated, simulated = (float(x) for x in re.findall(r"regret a step +at most (\S+); simulated (\S+)", out)[0])
    assert simulated == pytest.approx(stated, rel=1e-3)
    assert "hides more" not in out


def test_a_month_of_signals(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    loads = pd.DataFrame([[1.0, 0.0], [0.5, 0.5], [0.0, 2.0]], NAMES, ["value", "trend"])
    loads.to_csv(folder / "B.csv", index_label="asset")
    prior = pd.DataFrame(1e-4 * np.eye(2), loads.columns, loads.columns)
    prior.to_csv(folder / "S.csv", index_label="signal")
    month = pd.DatetimeIndex(["2020-01-31"], name="date")
    pd.DataFrame([[0.01, 0.02]], month, loads.columns).to_csv(folder / "A.csv")
    code, out, err = run(
        capsys, folder, "--prior-covariance", folder / "S.csv", "--loadings", folder / "B.csv", "--seed", 1, "--json"
    )
    assert code == 0, err
    problem = AlphaProblem(np.diag([0.04, 0.01, 0.02]), 2.5, loadings=loads.to_numpy())
    maker = AlphaDecisionMaker(problem, 0.5, prior_covariance=1e-4 * np.eye(2))
    drawn = maker.decide([0.01, 0.02], rng=np.random.default_rng(1))
    found = json.loads(out)
    assert found["n_published"] == 0  # nothing is kept without a state
    assert found["bits_a_step"] == pytest.approx(maker.bits)
    assert found["decisions"]["2020-01-31"] == pytest.approx(dict(zip(NAMES, drawn.action.tolist(), strict=True)))


def test_a_budget_of_more_than_silence_is_remarked_on(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    """A share is one of the silence regret, however it is written: 5 may mean 5 per cent."""
    law = ("--prior-covariance", folder / "S.csv")
    for written in ("5", "500%", "silence:5"):
        code, _, err = run(capsys, folder, *law, "--budget", written)
        assert code == 0, err
        assert f"--budget {written}: a budget of 500% of the silence regret is more than a constant decision" in err
        assert "5 per cent are written silence:5%" in err
    assert "more than" not in run(capsys, folder, *law, "--budget", "5%")[2]


def test_months_that_are_remembered(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    options = ["--world", folder / "W.json", "--state", folder / "state"]
    for count in (1, 2):
        code, out, err = run(capsys, folder, *options, "--publish", "--seed", count)
        assert code == 0, err
        assert f"{count} decision" in out
        assert "whoever knows the seed knows the draw" in out
    before = (folder / "state").read_bytes()
    assert b"0.03" not in before
    code, out, _ = run(capsys, folder, *options)
    assert code == 0
    assert "Nothing was drawn or recorded" in out
    assert "seed" not in out
    code, _, err = run(capsys, folder, *options, "--budget", 0.4)
    assert code == 3
    assert "of another rule" in err
    assert (folder / "state").read_bytes() == before


def test_a_world_in_another_order_gives_the_same_decisions(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    found = []
    for order in ([0, 1, 2], [2, 0, 1]):
        rates = np.diag([0.9, 0.5, 0.2])[np.ix_(order, order)]
        named = {"states": [NAMES[k] for k in order], "transition": rates.tolist()}
        sensor = {"public_sensor": [np.array([1.0, 0.5, 0.0])[order].tolist()], "public_noise": [[1e-4]]}
        (folder / "W.json").write_text(json.dumps({**WORLD, **named, **sensor}), "utf-8")
        code, out, err = run(capsys, folder, "--world", folder / "W.json", "--seed", 1, "--json")
        assert code == 0, err
        found.append(json.loads(out)["decisions"]["2020-01-31"])
    assert found[0] == pytest.approx(found[1], rel=1e-6)


def test_a_world_whose_states_have_no_names_is_told(caplog: pytest.LogCaptureFixture, folder: Path) -> None:
    (folder / "W.json").write_text(json.dumps({key: WORLD[key] for key in WORLD if key != "states"}), "utf-8")
    read_linear_world(folder / "W.json")
    assert (
        "W.json names no states: they are taken in the order of the loadings' columns, or else of the assets"
        in caplog.text
    )


def test_means_from_a_given_start_are_not_compared_with_the_long_run() -> None:
    world = LinearGaussianWorld([[0.9]], [[0.19]], [[1.0]], [[0.1]], initial=([3.0], [[100.0]]))
    maker = AlphaDecisionMaker(AlphaProblem([[1.0]], 1.0), 0.5, world=world)
    found = protect_alphas(maker, pd.DataFrame([[13.0]]), rng=np.random.default_rng(0))
    assert "standard deviations" not in found.summary()


def test_a_period_that_repeats_or_is_missing_is_named(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    def published(date: str, *options: object) -> str:
        row = pd.DatetimeIndex([date], name="date")
        pd.DataFrame([[0.03, 0.02, 0.01]], row, NAMES).to_csv(folder / "A.csv")
        asked = ["--world", folder / "W.json", "--state", folder / "state", "--seed", 3]
        code, out, err = run(capsys, folder, *asked, *options)
        assert code == 0, err
        return " ".join(out.split())

    for date in ("2020-01-31", "2020-02-29", "2020-03-31"):
        out = published(date, "--publish")
        assert "Caution: whoever knows the seed" in out
        assert out.count("Caution") == 1
        assert f"The last one is of {date}." in out
    for date in ("2020-03-31", "2020-02-29"):
        assert f"of 2020-03-31 is recorded already, and these alphas are of {date}" in published(date)
        assert "It counts as one more period" in published(date, "--publish")
    assert "Caution" not in published("2020-05-31")
    out = published("2020-05-31", "--publish")
    assert "Caution: no row for 2020-04: the row after a gap is taken for the next step" in out
    assert "Caution: a decision of 2020-05-31 is recorded already" in published("2020-05-31")


def test_a_state_is_of_its_limits_and_loadings(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    # Orthogonal loadings whose scale and signs leave tr(ΘE), bits and error as they are.
    for name, signs in (("B", [1.0, 1.0, 1.0]), ("C", [1.0, 1.0, -1.0])):
        pd.DataFrame(np.diag(signs), NAMES, NAMES).to_csv(folder / f"{name}.csv", index_label="asset")
    asked = {"held": "long-only", "cap": 0.6, "loadings": folder / "B.csv"}

    def protected(**options: object) -> tuple[int, str, str]:
        rows = [each for name, value in options.items() for each in (f"--{name}", value)]
        return run(capsys, folder, "--world", folder / "W.json", "--state", folder / "state", *rows)

    code, _, err = protected(**asked)
    assert code == 0, err
    before = (folder / "state").read_bytes()
    others: dict[str, object] = {"held": "invested", "cap": 0.7, "loadings": folder / "C.csv"}
    for new in some([*({**asked, name: other} for name, other in others.items()), {}], 3):
        code, _, err = protected(**new)
        assert code == 3
        assert "of another rule" in err
        assert "limits, loadings" in err
        assert (folder / "state").read_bytes() == before
    code, _, err = protected(**asked)
    assert code == 0, err


def test_months_with_what_everybody_reads(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    public = {"public_sensor": [[1.0, 1.0, 0.0]], "public_noise": [[1e-4]]}
    (folder / "W.json").write_text(json.dumps({**WORLD, **public}), "utf-8")
    maker = AlphaDecisionMaker(
        AlphaProblem(read_labelled_matrix(folder / "V.csv", is_square=True), 2.5),
        0.5,
        world=read_linear_world(folder / "W.json"),
    )
    sequence, told = maker.begin(), [0.0, 0.015, -0.005][: instances(3, least=2)]
    for month, reading in enumerate(told):
        options: list[object] = ["--world", folder / "W.json", "--state", folder / "state", "--seed", month]
        if month:
            date = pd.DatetimeIndex(["2020-01-31"], name="date")
            pd.DataFrame([[reading]], date, ["news"]).to_csv(folder / "Z.csv")
            code, _, err = run(capsys, folder, *options, "--publish")
            assert code == 3
            assert "--public FILE" in err
            options += ["--public", folder / "Z.csv"]
            sequence.observe([reading])
        code, out, err = run(capsys, folder, *options, "--json")  # looks, and records nothing
        assert code == 0, err
        code, out, err = run(capsys, folder, *options, "--publish", "--json")
        assert code == 0, err
        drawn = sequence.decide([0.03, 0.02, 0.01], rng=np.random.default_rng(month))
        sequence.publish(drawn)
        found = json.loads(out)
        assert found["is_first_unread"] == (month == 0)
        expected = dict(zip(maker.problem.asset_names or (), drawn.action.tolist(), strict=True))
        assert found["decisions"]["2020-01-31"] == pytest.approx(expected)
        assert found["bits_so_far"] == pytest.approx(sequence.total_bits)
    dates = pd.date_range("2020-01-31", periods=len(told), freq="ME")
    means = pd.DataFrame([[0.03, 0.02, 0.01]] * len(told), dates, NAMES)
    found_path = protect_alphas(maker, means, public=pd.DataFrame(told, dates), rng=np.random.default_rng(7))
    path = maker.decide_path(means, public=np.array(told)[:, None], rng=np.random.default_rng(7))
    np.testing.assert_allclose([each.action for each in found_path.decisions], path.actions, rtol=1e-9, atol=1e-12)
    with pytest.raises(InputError, match="public=, or --public FILE"):
        protect_alphas(maker, means, rng=np.random.default_rng(7))
    code, _, err = run(capsys, folder, "--prior-covariance", folder / "S.csv", "--public", folder / "Z.csv")
    assert code == 2
    assert "--public needs --world, whose public sensor it reports" in err
    (folder / "W.json").write_text(json.dumps(WORLD), "utf-8")
    code, _, err = run(capsys, folder, "--world", folder / "W.json", "--public", folder / "Z.csv")
    assert code == 3
    assert "no world with a public sensor" in err


def test_public_columns_are_aligned_by_their_labels(folder: Path) -> None:
    names, read = NAMES[:2], ["news", "rates"]
    moves = pd.DataFrame(np.diag([0.9, 0.5]), names, names)
    public = (pd.DataFrame(np.eye(2), read, names), pd.DataFrame(np.diag([1e-4, 1e-2]), read, read))
    world = LinearGaussianWorld(moves, 1e-4 * np.eye(2), np.eye(2), 1e-4 * np.eye(2), public=public)
    maker = AlphaDecisionMaker(AlphaProblem(pd.DataFrame(np.diag([0.04, 0.01]), names, names), 2.5), 0.5, world=world)
    means = pd.DataFrame([[0.01, -0.02], [0.02, 0.01]], columns=names)
    told = pd.DataFrame([[0.01, 0.5], [0.02, -0.3]], columns=read)
    expected = maker.decide_path(means, public=told, rng=np.random.default_rng(0)).actions
    for given in (told, told[read[::-1]], pd.DataFrame(told.to_numpy())):
        found = protect_alphas(maker, means, public=given, rng=np.random.default_rng(0))
        np.testing.assert_allclose([each.action for each in found.decisions], expected, rtol=1e-12)
    steps = [
        protect_alphas(
            maker, means[:1], folder / f"state {k}", public=given[:1], publish=True, rng=np.random.default_rng(0)
        )
        for k, given in enumerate((told, told[read[::-1]]))
    ]
    np.testing.assert_array_equal(*(each.decisions[0].action for each in steps))
    with pytest.raises(InputError, match="other public column labels"):
        protect_alphas(maker, means, public=told.set_axis(["news", "size"], axis=1), rng=np.random.default_rng(0))


def test_public_columns_of_a_file_are_in_the_order_of_the_world(
    capsys: pytest.CaptureFixture[str], folder: Path
) -> None:
    public = {"public_sensor": [[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "public_noise": [[1e-4, 0.0], [0.0, 1e-4]]}
    (folder / "W.json").write_text(json.dumps({**WORLD, **public}), "utf-8")
    date = pd.DatetimeIndex(["2020-01-31"], name="date")
    pd.DataFrame([[0.01, 0.02]], date, ["news", "rates"]).to_csv(folder / "Z.csv")
    code, _, err = run(capsys, folder, "--world", folder / "W.json", "--public", folder / "Z.csv")
    assert code == 0, err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "one of --prior-covariance and --world"),
        (["--prior-covariance", "S.csv", "--world", "W.json"], "one of --prior-covariance and --world"),
        (["--prior-covariance", "S.csv", "--belief", "0.5,0.5"], "takes no --belief: the private means take the place"),
        (
            ["--prior-covariance", "S.csv", "--out", "o"],
            "takes no --out: the results are only printed, as data with --json",
        ),
        (["--prior-covariance", "S.csv", "--factors", "1"], "--factors needs --returns"),
        (["--prior-covariance", "S.csv", "--publish"], "give the file with --state"),
    ],
)
def test_options_that_do_not_go_together(
    capsys: pytest.CaptureFixture[str], folder: Path, options: list[str], said: str
) -> None:
    code, _, err = run(capsys, folder, *options)
    assert code == 2
    assert said in err


def test_protect_without_anything_says_what_it_needs(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["protect"]) == 2
    assert "--model" in capsys.readouterr().err
    assert cli.main(["protect", "--risk-aversion", "5"]) == 2
    assert "--risk-aversion belongs to --alphas" in capsys.readouterr().err


def test_alphas_of_other_names_are_refused(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    pd.DataFrame([[0.01, 0.02]], pd.DatetimeIndex(["2020-01-31"], name="date"), NAMES[:2]).to_csv(folder / "A.csv")
    code, _, err = run(capsys, folder, "--prior-covariance", folder / "S.csv")
    assert code == 3
    assert "Steel" in err


@pytest.mark.parametrize("wrong", ["V.csv", "S.csv"])
def test_a_wrong_covariance_is_named_by_its_file(capsys: pytest.CaptureFixture[str], folder: Path, wrong: str) -> None:
    text = (folder / wrong).read_text("utf-8")
    (folder / wrong).write_text(text.replace("Steel", "Steal"), "utf-8")
    code, _, err = run(capsys, folder, "--prior-covariance", folder / "S.csv")
    assert code == 3
    assert f"only in {folder / wrong}: Steal" in err
    indefinite = [[1e-4, 2e-4, 0.0], [2e-4, 1e-4, 0.0], [0.0, 0.0, 1e-4]]
    pd.DataFrame(indefinite, NAMES, NAMES).to_csv(folder / wrong, index_label="asset")
    code, _, err = run(capsys, folder, "--prior-covariance", folder / "S.csv")
    assert code == 3
    assert f"bad data: {folder / wrong} is indefinite" in err


def test_files_that_are_wrong_name_the_place(folder: Path) -> None:
    path = folder / "V.csv"
    path.write_text("asset,Oil,Food\nOil,1,0\nOil,0,1\n")
    with pytest.raises(InputError, match="row labels twice: 'Oil'; missing: 'Food'"):
        read_labelled_matrix(path, is_square=True)
    path.write_text("asset,Oil,Food\nOil,1,0\n")
    with pytest.raises(InputError, match="row labels missing: 'Food'"):
        read_labelled_matrix(path, is_square=True)
    file = folder / "W.json"
    file.write_text(json.dumps({**WORLD, "noise": "none"}), "utf-8")
    with pytest.raises(InputError, match="noise"):
        read_linear_world(file)
    file.write_text(json.dumps({**WORLD, "public_sensor": [[1.0, 0.0, 0.0]]}), "utf-8")
    with pytest.raises(InputError, match="go together"):
        read_linear_world(file)
    file.write_text("{", "utf-8")
    with pytest.raises(InputError, match="not JSON"):
        read_linear_world(file)


def test_a_risk_of_factors_from_returns(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture, folder: Path
) -> None:
    returns = load_industry_returns().returns.iloc[:60, :3].set_axis(NAMES, axis=1)
    returns.to_csv(folder / "R.csv", index_label="date")
    options = ["--returns", folder / "R.csv", "--factors", 1, "--risk-aversion", 2.5, "--seed", 1, "--json"]
    fixed = ["protect", "--alphas", folder / "A.csv", "--prior-covariance", folder / "S.csv"]
    code = cli.main([str(each) for each in (*fixed, *options)])
    said = capsys.readouterr()
    assert code == 0, said.err
    assert not caplog.text
    problem = AlphaProblem(FactorRisk.from_returns(returns, 1), 2.5)
    maker = AlphaDecisionMaker(problem, 0.5, prior_covariance=np.diag([0.04, 0.01, 0.02]) / 100)
    assert json.loads(said.out)["bits_a_step"] == pytest.approx(maker.bits, rel=1e-6)

    (0.4 * np.sign(returns)).to_csv(folder / "R.csv", index_label="date")  # percentages of what moves little
    assert cli.main([str(each) for each in (*fixed, *options)]) == 0
    assert "if they are percentages, divide them by 100" in caplog.text
    returns.assign(Food=0.01).to_csv(folder / "R.csv", index_label="date")
    assert cli.main([str(each) for each in (*fixed, *options)]) == 3
    assert "returns of asset Food are constant" in capsys.readouterr().err


def test_momentum_looks_back_only() -> None:
    returns = load_industry_returns().returns.iloc[:60]
    whole, cut = momentum_alphas(returns), momentum_alphas(returns.iloc[:50])
    pd.testing.assert_frame_equal(whole.iloc[: len(cut)], cut)
    changed = returns.copy()
    changed.iloc[49:] += 1.0
    pd.testing.assert_frame_equal(momentum_alphas(changed).iloc[: len(cut)], cut)


def test_given_up_and_taken_are_the_worth_on_embedded_returns() -> None:
    data = load_industry_returns()
    excess = data.returns.sub(data.riskless, axis=0)
    alphas = momentum_alphas(excess).iloc[240:]
    law = 0.05**2 * np.diag(excess.iloc[:240].var())
    world = LinearGaussianWorld(11 / 12 * np.eye(12), (1 - (11 / 12) ** 2) * law, np.eye(12), np.zeros((12, 12)))
    maker = AlphaDecisionMaker(AlphaProblem(excess.iloc[:240].cov(), 3.0), 0.5, world=world)
    found = alpha_backtest(maker, alphas, excess.loc[alphas.index], rng=np.random.default_rng(0))
    np.testing.assert_allclose(found.given_up + found.taken, found.worth, atol=1e-12)
    assert found.given_up.min() >= 0.0
    assert maker.status.name == "OPTIMAL"
    assert "basis points a month, 555 months" in str(found)
    assert list(found.table().columns[:3]) == ["worth", "given up", "taken"]
    with pytest.raises(InputError, match="other rows"):
        alpha_backtest(maker, alphas, excess, rng=np.random.default_rng(0))


def backtest(capsys: pytest.CaptureFixture[str], *options: object) -> tuple[int, str, str]:
    """A backtest of alphas by command."""
    code = cli.main(["backtest", *map(str, options)])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_a_backtest_of_alphas_by_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    dates = pd.date_range("2001-01-31", periods=60, freq="ME", name="date")
    returns = pd.DataFrame(rng.normal(0.005, [0.06, 0.03, 0.04], (60, 3)), dates, NAMES)
    own = pd.DataFrame(rng.normal(0.0, 0.01, (59, 3)), dates[:-1], NAMES)
    for _ in range(3):  # signals that decay
        own = 0.7 * own + 0.7 * own.shift(1).fillna(0.0)
    returns.to_csv(tmp_path / "R.csv")
    own[NAMES[::-1]].to_csv(tmp_path / "A.csv")
    options = ["--returns", tmp_path / "R.csv", "--alphas", tmp_path / "A.csv", "--train-until", "2003-12"]
    options += ["--risk-aversion", 3, "--budget", "0.4", "--seed", 2, "--out", tmp_path / "out"]
    code, out, err = backtest(capsys, *options)
    assert code == 0, err
    assert "basis points a month, 24 months" in out
    assert "a law estimated from your own alphas reveals them" in err
    table = pd.read_csv(tmp_path / "out" / "table.csv", index_col=0)
    np.testing.assert_allclose(table["given up"] + table["taken"], table["worth"], atol=1e-8)
    assert (tmp_path / "out" / "alphas.png").stat().st_size > 0

    # The months, the law and what was earned by hand: a row decides on the next one's return.
    past, training = own.iloc[:35].to_numpy(), returns.iloc[:36]
    second = past.T @ past / 35
    rate = (past[1:] * past[:-1]).sum() / np.sqrt((past[1:] ** 2).sum() * (past[:-1] ** 2).sum())
    world = LinearGaussianWorld(rate * np.eye(3), (1 - rate**2) * second, np.eye(3), np.zeros((3, 3)))
    maker = AlphaDecisionMaker(AlphaProblem(training.cov(), 3.0), 0.4, world=world)
    path = maker.decide_path(own.iloc[35:], rng=np.random.default_rng(2))
    earned = (path.actions * returns.iloc[36:].to_numpy()).sum(axis=1)
    np.testing.assert_allclose(table["published"], 1e4 * earned, rtol=1e-6)
    np.testing.assert_allclose(
        table["error"], ((own.iloc[35:].to_numpy() - path.estimates) ** 2).sum(axis=1), rtol=1e-6
    )
    summary = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
    assert summary["bits"]["by_law"] == pytest.approx(maker.bits)
    code, out, _ = backtest(capsys, *options, "--json")
    assert json.loads(out) == summary

    own.drop(dates[40]).to_csv(tmp_path / "A.csv")
    code, _, err = backtest(capsys, *options)
    assert code == 3
    assert "alphas lack 1 of the 24 dates of the decisions: 2004-05-31" in err
    own.drop(dates[10]).to_csv(tmp_path / "A.csv")
    code, _, err = backtest(capsys, *options)
    assert code == 3
    assert "alphas lack 1 of the 35 dates of the training sample: 2001-11-30" in err
    own.iloc[34:].to_csv(tmp_path / "A.csv")
    code, _, err = backtest(capsys, *options)
    assert code == 3
    assert "alphas have 1 rows before the first decision" in err
    assert "--prior-covariance or --world" in err


def test_alphas_in_per_cent_are_named_beside_the_figures() -> None:
    """A forecast that explains all of the returns' variance is as large as they are."""
    rng = np.random.default_rng(5)
    months = [f"{each:%Y-%m}" for each in pd.date_range("2001-01-31", periods=24, freq="ME")]
    for size, told in ((0.9, False), (1.2, True), (100.0, True)):
        alphas = pd.DataFrame(size * rng.normal(0.0, [0.06, 0.03, 0.04], (24, 3)), months, NAMES)
        risk = pd.DataFrame(np.diag([0.06, 0.03, 0.04]) ** 2, NAMES, NAMES)
        maker = AlphaDecisionMaker(AlphaProblem(risk, 3.0), 0.4, prior_covariance=alphas.cov())
        found = alpha_backtest(maker, alphas, rng=rng)
        assert ("are they in per cent?" in str(found)) == told


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--objective", "error"], "--objective belongs to --alphas"),
        (["--alphas", "momentum", "--no-sequential"], "--alphas takes no --no-sequential"),
        (["--alphas", "momentum", "--max-weight", "0.3"], "--alphas takes no --max-weight"),
        (["--alphas", "momentum", "--public", "market"], "--alphas takes no --public"),
        (["--alphas", "momentum", "--regimes", "2"], "--alphas takes no --regimes"),
        (["--alphas", "momentum", "--world", "W", "--prior-covariance", "S"], "at most one of"),
    ],
)
def test_options_that_a_backtest_of_alphas_does_not_take(
    capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    code, _, err = backtest(capsys, *options)
    assert code == 2
    assert said in err


def test_a_backtest_of_alphas_with_a_stated_law() -> None:
    data = load_industry_returns()
    returns, rates = data.returns.iloc[:120], data.riskless.iloc[:120]
    settings = AlphaSettings(train_until="1955-12", objective="error", covariance="factor:2")
    names = returns.columns
    prior = pd.DataFrame(1e-5 * np.eye(12), names, names)
    found = run_alpha_backtest(returns, None, settings, riskless=rates, prior_covariance=prior)
    np.testing.assert_allclose(found.given_up + found.taken, found.worth, atol=1e-12)
    means = momentum_alphas(returns.sub(rates, axis=0)).loc["1956-01":]
    best = found.maker.problem.optimum(means)
    assert found.realised is not None
    earned = (best * returns.sub(rates, axis=0).loc["1956-01":].to_numpy()).sum(axis=1)
    np.testing.assert_allclose(found.realised[:, 2], earned, rtol=1e-12)
    assert found.maker.error == pytest.approx(float(np.trace(found.maker.error_covariance)))
    with pytest.raises(InputError, match="labels than expected"):
        run_alpha_backtest(returns, means.iloc[:, :11], settings)
