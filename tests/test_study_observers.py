"""Observers who follow the belief, read something beside decisions, or are shown them late, in study files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inscrutable import InputError, Study, path_leakage, run_study
from inscrutable.experiments.studies.grid_tasks import GridRunner
from inscrutable.experiments.studies.tasks import Work
from sizes import some

WORLD = {
    "kind": "given",
    "means": [[0.02, 0.01], [-0.02, 0.0]],
    "covariances": [[[0.002, 0.0], [0.0, 0.001]], [[0.006, 0.001], [0.001, 0.002]]],
    "transition": [[0.9, 0.1], [0.2, 0.8]],
}
PLAN: dict[str, Any] = {
    "name": "followed",
    "world": WORLD,
    "beliefs": {"kind": "stationary", "resolution": 6},
    "candidates": {"resolution": 6},
    "decision_makers": ["ODM", {"name": "coin", "probability": 0.5}],
    "measures": ["error", "top_state"],
}
FOLLOWING: list[dict[str, Any]] = [
    {"name": "sequential"},
    {"name": "sequential", "public": ["market", 1, "all"]},
    {"name": "sequential", "disclosure": ["every(3)", "delayed(2)", "form_13f()", "n_port()"]},
    {"name": "sequential", "disclosure": "every(3)|delayed(2)", "public": "market"},
]


def plan_of(*adversaries: Any, **other: Any) -> Study:
    return Study.of(PLAN | {"adversaries": list(adversaries)} | other)


@pytest.fixture(scope="module")
def runner() -> GridRunner:
    return GridRunner(Work(GridRunner, plan_of("naive", *FOLLOWING).plan.model_dump_json(), None, "[]"))


@pytest.fixture(scope="module")
def rows(runner: GridRunner) -> dict[tuple[str, str, str, str], dict[str, float]]:
    """Figures by decision maker, observer, what is shown and what is read."""
    found = {}
    for number in range(len(runner.grid)):
        task = runner.grid.task(number)
        maker, _ = runner.grid.plays[task.places[5]]
        seen = runner.grid.adversaries[task.places[6]].data or {}
        key = (
            str((maker.data or {})["name"]),
            seen["name"],
            seen.get("disclosure", "exact"),
            str(seen.get("public", "none")),
        )
        found[key] = runner.figures(task)
    return found


def test_the_law_is_that_of_other_observers_whatever_is_read(runner: GridRunner) -> None:
    setting = runner.setting((0, 0, 0, 0, 0))
    plain = GridRunner(Work(GridRunner, plan_of("naive").plan.model_dump_json(), None, "[]")).setting((0, 0, 0, 0, 0))
    assert setting.chain is not None
    assert setting.read is not None
    assert plain.chain is None
    for chain in (setting.chain, setting.read("market"), setting.read(0)):
        assert np.array_equal(chain.prior.beliefs, plain.prior.beliefs)
        assert np.array_equal(chain.prior.weights, plain.prior.weights)
        assert (chain.transition != setting.chain.transition).nnz == 0
    assert len(setting.read("market").public or ()) == 8


@pytest.mark.parametrize(
    ("shown", "public"),
    some(
        [("exact", "none"), ("every(3)", "none"), ("delayed(2)", "none"), ("form_13f()", "none"), ("exact", "market")],
        2,
    ),
)
def test_who_follows_errs_as_path_leakage_says(
    runner: GridRunner, rows: dict[tuple[str, str, str, str], dict[str, float]], shown: str, public: str
) -> None:
    """Against the inverse filter on other paths."""
    setting = runner.setting((0, 0, 0, 0, 0))
    assert setting.read is not None
    chain = setting.chain if public == "none" else setting.read(public)
    assert chain is not None
    coin = runner.observed((0, 0, 0, 0, 0, 1)).behaviour.mechanism
    told = path_leakage(chain, coin, 40, rng=np.random.default_rng(3), n_draws=200, disclosure=shown)
    wanted = float(np.sqrt(np.mean(told.bayes_error[-18:] ** 2)))
    found = rows["coin", "sequential", shown, public]
    assert 0.0 < found["error"] < found["prior_error"]
    assert found["error"] == pytest.approx(wanted, abs=0.012)
    assert found["prior_error"] == pytest.approx(float(np.sqrt(np.mean(told.prior_error[-18:] ** 2))), abs=0.012)


def test_who_sees_more_errs_less(rows: dict[tuple[str, str, str, str], dict[str, float]]) -> None:
    followed = {key[2:]: each for key, each in rows.items() if key[:2] == ("coin", "sequential")}
    exact = followed["exact", "none"]
    for shown in ("every(3)", "delayed(2)", "form_13f()", "n_port()"):
        assert followed[shown, "none"]["error"] > exact["error"] + 0.01
    assert followed["exact", "market"]["error"] < exact["error"]
    assert followed["exact", "market"]["prior_error"] < exact["prior_error"] - 0.01
    assert followed["every(3)|delayed(2)", "market"]["prior_error"] < exact["prior_error"] - 0.01
    assert followed["exact", "1"]["prior_error"] < exact["prior_error"]
    assert followed["exact", "all"] == pytest.approx(
        exact | {"error": 0.0, "prior_error": 0.0, "top_state": 1.0, "prior_top_state": 1.0}
    )
    assert rows["ODM", "sequential", "exact", "none"]["error"] < exact["error"]


def test_protection_is_judged_by_what_each_observer_knows_without(tmp_path: Path) -> None:
    done = run_study(plan_of("bayesian", FOLLOWING[1]), tmp_path)
    lines = done.protection()
    assert [re.split(r": | \(for", line)[0] for line in lines] == [
        "Hidden from the aware (bayesian) observer",
        "Hidden from the aware over time (sequential), public market observer",
        "Hidden from the aware over time (sequential), public 1 observer",
        "Hidden means",
    ]
    means = done.means()
    known = means[means.measure == "prior_error"].groupby("adversary")["mean"].first()
    assert known["sequential, public market"] < known["bayesian"]
    assert known["sequential, public all"] == 0.0
    for line, observer in zip(lines, ("bayesian", "sequential, public market"), strict=False):
        asked = f"for it errors of {2 / 3 * known[observer]:.2f} and"
        assert (asked in line) == (observer != "bayesian")


@pytest.mark.parametrize(
    ("asked", "other", "said"),
    [
        ("sequential", {"beliefs": {"kind": "grid"}}, 'of kind "stationary", got "grid"'),
        ({"name": "naive", "disclosure": "every(3)"}, {}, 'the observer "sequential" alone reads'),
        ({"name": "sequential", "public": "all"}, {"beliefs": {"kind": "path"}}, 'got "path"'),
        ({"name": "sequential", "public": 0}, {"world": {"kind": "random"}}, 'expected sensor = "gaussian"'),
        ({"name": "sequential", "public": "markets"}, {}, "did you mean market?"),
    ],
)
def test_what_cannot_be_followed_is_refused(asked: Any, other: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said.replace("?", r"\?")):
        plan_of(asked, **other)


def test_an_asset_that_is_none_is_said_in_the_row(tmp_path: Path) -> None:
    done = run_study(plan_of({"name": "sequential", "public": 7}), tmp_path)
    assert all("public = 7 is no asset: they are numbered from 0 to 1" in line for line in done.errors())
    assert done.status().failed == 2


def test_observers_of_one_name_are_told_apart_by_keys_that_one_of_them_has(tmp_path: Path) -> None:
    asked = ["sequential", {"name": "sequential", "disclosure": "every(3)"}, {"name": "sequential", "public": "market"}]
    done = run_study(plan_of(*asked), tmp_path)
    means, rows = done.means(), done.frame()
    names = ["sequential", "sequential, every(3)", "sequential, public market"]
    for name, place in zip(names, range(3), strict=True):
        mine = means[(means.measure == "error") & (means.adversary == name)]["mean"].tolist()
        assert mine == rows["error"].tolist()[place::3]
    assert len(set(rows["error"].tolist()[3:])) == 3
