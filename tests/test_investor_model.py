"""The saved model: it comes back to the last digit, and a damaged file is refused with its name and key."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from inscrutable.budgets import Budget
from inscrutable.errors import InputError, ModelError
from inscrutable.experiments.attack import attack_weights
from inscrutable.experiments.attack_over_time import attack_over_time
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.problems import MarkowitzProblem, box, simplex
from inscrutable.worlds import CategoricalEmission, GaussianEmission, HiddenMarkovModel


def investor(seed: int = 0, n_states: int = 3, n_assets: int = 4) -> InvestorModel:
    """A market with awkward digits."""
    rng = np.random.default_rng(seed)
    means = 0.02 * rng.normal(size=(n_states, n_assets))
    factors = 0.05 * rng.normal(size=(n_states, n_assets, n_assets))
    covariances = factors @ factors.transpose(0, 2, 1) + 1e-4 * np.eye(n_assets)
    emission = GaussianEmission(means, covariances, asset_names=[f"asset {j}" for j in range(n_assets)])
    world = HiddenMarkovModel(rng.dirichlet(np.ones(n_states), size=n_states), emission)
    region = simplex(n_assets) & box(np.full(n_assets, -np.inf), np.full(n_assets, 2 / 3))
    problem = MarkowitzProblem(means, covariances, 1 / 0.3, region)
    names = tuple(f"asset {j}" for j in range(n_assets))
    return InvestorModel(world, problem, names, world.names, Budget.regret(1 / 3), "a note: ½ γ")


def saved(tmp_path: Path) -> tuple[Path, dict[str, Any]]:
    path = investor().save(tmp_path / "model.json")
    return path, json.loads(path.read_text("utf-8"))


@pytest.mark.parametrize("seed", range(5))
def test_a_model_comes_back_to_the_last_digit(tmp_path: Path, seed: int) -> None:
    model = investor(seed, n_states=2 + seed % 3, n_assets=2 + seed)
    back = InvestorModel.load(model.save(tmp_path / "a.json"))
    for one, two in (
        (model.problem.means, back.problem.means),
        (model.problem.covariances, back.problem.covariances),
        (model.world.transition, back.world.transition),
        (model.world.initial, back.world.initial),
        (model.problem.constraints.A_ub, back.problem.constraints.A_ub),
        (model.problem.constraints.b_ub, back.problem.constraints.b_ub),
        (model.problem.constraints.b_eq, back.problem.constraints.b_eq),
    ):
        assert np.array_equal(one, two)
    assert (back.assets, back.regimes, back.budget, back.note) == (
        model.assets,
        model.regimes,
        model.budget,
        model.note,
    )
    assert back.problem.risk_aversion == model.problem.risk_aversion
    assert back.problem.constraints.names == model.problem.constraints.names
    assert back.save(tmp_path / "b.json").read_bytes() == (tmp_path / "a.json").read_bytes()
    belief = np.full(model.problem.n_states, 1 / model.problem.n_states)
    assert np.array_equal(model.problem.solve(belief), back.problem.solve(belief))


def test_a_world_with_symbols_is_saved_too(tmp_path: Path) -> None:
    model = investor()
    world = HiddenMarkovModel(model.world.transition, CategoricalEmission(np.full((3, 2), 0.5)))
    other = InvestorModel(world, model.problem, model.assets, model.regimes)
    back = InvestorModel.load(other.save(tmp_path / "m.json"))
    assert isinstance(back.world.emission, CategoricalEmission)


def test_a_sensor_of_a_users_own_is_refused(tmp_path: Path) -> None:
    class Own:
        n_states = 3

        def log_likelihoods(self, observations: Any) -> Any: ...

        def sample(self, states: Any, *, rng: Any) -> Any: ...

        def to_dict(self) -> dict[str, Any]:
            return {"type": "own"}

    model = investor()
    world = HiddenMarkovModel(model.world.transition, Own())
    with pytest.raises(InputError, match="Own cannot be saved"):
        InvestorModel(world, model.problem, model.assets, model.regimes).save(tmp_path / "m.json")
    assert list(tmp_path.iterdir()) == []


Damage = Callable[[dict[str, Any]], None]

DAMAGES: list[tuple[str, Damage, str]] = [
    ("missing key", lambda d: d["problem"].pop("means"), r"key problem\.means"),
    ("unknown key", lambda d: d.update(extra=1), r"key extra"),
    ("text for a number", lambda d: d["problem"]["means"][1].__setitem__(2, "x"), r"key problem\.means\[1\]\[2\].*'x'"),
    ("null for a number", lambda d: d["budget"].update(amount=None), r"key budget\.amount"),
    ("number for a flag", lambda d: d["budget"].update(is_relative=1), r"key budget\.is_relative"),
    ("not a number", lambda d: d["problem"].update(risk_aversion=float("nan")), r"key problem\.risk_aversion"),
    ("negative budget", lambda d: d["budget"].update(amount=-1.0), r"key budget: budget must be at least 0"),
    ("wrong sensor", lambda d: d["world"]["emission"].update(type="own"), r"key world\.emission"),
    ("sensor's value", lambda d: d["world"]["emission"].update(means=[["a"]]), r"key world\.emission\.means\[0\]\[0\]"),
    ("ragged", lambda d: d["problem"]["means"][0].pop(), r"key problem: means must be numbers"),
    ("rows that do not sum", lambda d: d["world"]["transition"][0].__setitem__(0, 2.0), r"key world: transition row 0"),
    ("wrong number of assets", lambda d: d["assets"].pop(), r"key assets and regimes: assets must be 4"),
    ("label twice", lambda d: d["regimes"].__setitem__(0, d["regimes"][1]), r"regimes must be 3 different"),
    (
        "sides without rows",
        lambda d: d["problem"]["constraints"].update(A_eq=[]),
        r"key problem\.constraints: A_eq and",
    ),
    ("later version", lambda d: d.update(version=2), r"model version 2; this release reads version 1"),
    ("another format", lambda d: d.update(format="x"), r"no saved model"),
]


@pytest.mark.parametrize(("damage", "message"), [each[1:] for each in DAMAGES], ids=[each[0] for each in DAMAGES])
def test_a_damaged_file_is_named_with_its_key(tmp_path: Path, damage: Damage, message: str) -> None:
    path, data = saved(tmp_path)
    damage(data)
    path.write_text(json.dumps(data), "utf-8")
    with pytest.raises(InputError, match=message) as caught:
        InvestorModel.load(path)
    assert str(path) in str(caught.value)


def test_numbers_without_meaning_are_a_model_error(tmp_path: Path) -> None:
    path, data = saved(tmp_path)
    data["problem"]["covariances"][0] = (-np.eye(4)).tolist()
    path.write_text(json.dumps(data), "utf-8")
    with pytest.raises(ModelError, match=r"key problem: covariances\[0\] is indefinite"):
        InvestorModel.load(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"line 1, column 1: not JSON"),
        (b'{"format": ', r"not JSON"),
        (b"[1, 2]", r"no saved model"),
        (b"\xff\xfe\x00", r"not UTF-8"),
        (b"[" * 200_000, r"nested too deeply|not JSON"),
    ],
)
def test_what_is_no_model_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "m.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        InvestorModel.load(path)


def test_missing_files_and_folders(tmp_path: Path) -> None:
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(InputError, match="cannot be read"):
            InvestorModel.load(path)
    with pytest.raises(InputError, match="cannot be written"):
        investor().save(tmp_path / "none" / "m.json")


def test_a_model_checks_itself() -> None:
    model = investor()
    with pytest.raises(InputError, match="assets must be 4 different labels, got 3"):
        InvestorModel(model.world, model.problem, model.assets[:3], model.regimes)
    with pytest.raises(InputError, match="sequence of texts"):
        InvestorModel(model.world, model.problem, "abcd", model.regimes)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="world has 2 regimes, the problem 3"):
        InvestorModel(investor(n_states=2).world, model.problem, model.assets, model.regimes)
    with pytest.raises(InputError, match="budget must be a Budget"):
        InvestorModel(model.world, model.problem, model.assets, model.regimes, 0.1)  # type: ignore[arg-type]
    assert "3 regimes" in model.summary()


def test_names_of_the_world_must_be_those_of_the_model() -> None:
    model = investor()
    emission = model.world.emission
    assert isinstance(emission, GaussianEmission)

    def other(labels: Any = None, names: Any = None) -> HiddenMarkovModel:
        sensor = GaussianEmission(emission.means, emission.covariances, asset_names=labels)
        return HiddenMarkovModel(model.world.transition, sensor, names=names)

    def build(world: HiddenMarkovModel, regimes: tuple[str, ...] = ("calm", "normal", "wild")) -> InvestorModel:
        return InvestorModel(world, model.problem, model.assets, regimes)

    assert build(other()).regimes == ("calm", "normal", "wild")
    assert build(other(names=["calm", "normal", "wild"])).regimes == ("calm", "normal", "wild")
    turned = GaussianEmission(
        emission.means[:, ::-1], emission.covariances[:, ::-1, ::-1], asset_names=model.assets[::-1]
    )
    assert build(HiddenMarkovModel(model.world.transition, turned)).assets == model.assets
    with pytest.raises(InputError, match="the same means in each place"):
        build(other(labels=model.assets[::-1]))
    for names in (["wild", "normal", "calm"], ["a", "b", "c"]):
        with pytest.raises(InputError, match=r"states are .*the regimes .*calm.* same order"):
            build(other(names=names))
    with pytest.raises(InputError, match="same order"):
        build(other(), ("regime 3", "regime 2", "regime 1"))
    for labels in (range(4), ["asset 0", "asset 1", "asset 2", "gold"]):
        with pytest.raises(InputError, match="sensor has the assets"):
            build(other(labels=labels))


def test_a_model_is_made_of_a_world_and_a_problem() -> None:
    model = investor()
    with pytest.raises(InputError, match="world must be a HiddenMarkovModel"):
        InvestorModel(model.problem, model.problem, model.assets, model.regimes)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="problem must be a MarkowitzProblem"):
        InvestorModel(model.world, model.world, model.assets, model.regimes)  # type: ignore[arg-type]


def test_numbers_of_thousands_of_digits_are_bad_data(tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    path.write_text(f'{{"format": "inscrutable investor model", "version": {"9" * 10_000}}}', "utf-8")
    with pytest.raises(InputError, match=r"m\.json is not JSON that can be read"):
        InvestorModel.load(path)
    with pytest.raises(InputError, match="by its path"):
        InvestorModel.load({})  # type: ignore[arg-type]


def test_returns_and_decisions_of_another_step_are_named(tmp_path: Path) -> None:
    model = replace(investor(), step="month")
    model.save(tmp_path / "model.json")
    assert InvestorModel.load(tmp_path / "model.json").step == "month"
    rng = np.random.default_rng(0)

    def rows(frequency: str) -> pd.DataFrame:
        dates = pd.date_range("2020-01", periods=12, freq=frequency)
        return pd.DataFrame(0.01 * rng.normal(size=(12, len(model.assets))), dates, list(model.assets))

    assert model.belief_after(rows("ME")).sum() == pytest.approx(1.0)
    bare = GaussianEmission(model.world.emission.means, model.world.emission.covariances)
    world = HiddenMarkovModel(model.world.transition, bare, names=model.regimes)
    numbered = InvestorModel(world, model.problem, tuple(str(k) for k in range(len(model.assets))), model.regimes)
    months = rows("ME").set_axis(range(len(model.assets)), axis=1)
    assert np.array_equal(numbered.belief_after(months), numbered.belief_after(months.iloc[:, ::-1]))
    assert np.array_equal(model.belief_after(months), numbered.belief_after(months))
    assert replace(model, step="").belief_after(rows("W")).sum() == pytest.approx(1.0)
    for frequency, word in (("W", "week"), ("B", "trading day"), ("QE", "quarter")):
        with pytest.raises(InputError, match=f"returns have one row a {word}, the model one a month"):
            model.belief_after(rows(frequency))
    weights = pd.DataFrame(model.problem.solve(rng.dirichlet(np.ones(3), 12)), rows("W").index, list(model.assets))
    said = attack_over_time(attack_weights(model, weights), "optimal").summary()
    assert "Caution: rows come once a week, the steps of the model once a month" in said
    for frequency, told in (("2ME", "every 6"), ("6ME", "every 18"), ("YE", "once a year")):
        for some in (weights, weights.iloc[:2]):
            read = attack_weights(model, some.set_axis(rows(frequency).index[: len(some)], axis=0))
            assert f"Caution: rows come {told}" in attack_over_time(read, "optimal").summary(), frequency
    weights.index = rows("ME").index
    assert "the steps of the model" not in attack_over_time(attack_weights(model, weights), "optimal").summary()


def test_the_sum_of_weights_is_exact_for_any_number_of_assets() -> None:
    assert {investor(n_assets=size).net for size in range(2, 40)} == {1.0}
