"""Rules with a memory in study files: delay, partial trades and the sequential rule, as `compare` judges them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inscrutable import InputError, ModelError, Study
from inscrutable.experiments.comparison import ComparisonSettings, compare, makers_of
from inscrutable.experiments.studies.grid_tasks import GridRunner
from inscrutable.experiments.studies.tasks import Work
from small_runs import draft_simulations, learned_from_few

PLAN: dict[str, Any] = {
    "name": "remembered",
    "world": {
        "kind": "given",
        "means": [[0.02, 0.01], [-0.02, 0.0]],
        "covariances": [[[0.002, 0.0], [0.0, 0.001]], [[0.006, 0.001], [0.001, 0.002]]],
        "transition": [[0.9, 0.1], [0.2, 0.8]],
    },
    "beliefs": {"kind": "stationary", "resolution": 4},
    "candidates": {"resolution": 4},
    "decision_makers": ["delay", "partial trades"],
    "budgets": {"unit": "silence", "hold": "mean", "values": 0.5},
    "adversaries": ["naive", "bayesian", "sequential"],
    "measures": ["error", "top_state", "expected_regret", "mutual_information"],
}
SEQUENTIAL = {"name": "sequential", "information_price": "infinite"}
COMPARED = {
    "naive": {"error": "naive_error", "top_state": "naive_top_state"},
    "bayesian": {"error": "bayes_error", "top_state": "top_state_accuracy"},
    "sequential": {"error": "path_error"},
}


def runner_of(**changed: Any) -> GridRunner:
    return GridRunner(Work(GridRunner, Study.of(PLAN | changed).plan.model_dump_json(), None, "[]"))


def check_as_compared(runner: GridRunner, names: list[str], near: float) -> None:
    """Figures of tasks are those of `compare` in the same setting; of an observer over time within `near`."""
    setting = runner.setting((0, 0, 0, 0, 0))
    settings = ComparisonSettings(budgets=(0.5,), unit="silence", repeats=(1,), draws=10)
    assert setting.chain is not None
    with learned_from_few():
        rows = compare(
            setting.problem,
            setting.chain,
            settings,
            makers=makers_of(names),
            candidates=setting.candidates,
            rng=np.random.default_rng(1),
        )
    for number in range(len(runner.grid)):
        task = runner.grid.task(number)
        maker, observer = runner.grid.plays[task.places[5]][0].data, runner.grid.adversaries[task.places[6]].data
        assert maker is not None
        assert observer is not None
        row, found = rows.of(str(maker["name"]))[0], runner.figures(task)
        drawn = near if row.maker == "sequential" else 1e-12
        for name, column in COMPARED[observer["name"]].items():
            within = near if observer["name"] == "sequential" else drawn
            assert found[name] == pytest.approx(getattr(row, column), abs=within), (row.maker, observer, name)
        assert found["expected_regret"] == pytest.approx(row.expected_regret, rel=max(drawn, 1e-12))
        assert found["mutual_information"] == pytest.approx(row.mutual_information, abs=drawn)


def test_late_and_partial_trades_are_judged_as_in_a_comparison() -> None:
    check_as_compared(runner_of(), ["delay", "partial trades"], 0.02)


@pytest.mark.audit
def test_the_sequential_rule_is_judged_as_in_a_comparison() -> None:
    check_as_compared(runner_of(decision_makers=SEQUENTIAL), ["sequential"], 0.05)


def test_rules_with_a_memory_need_beliefs_that_move() -> None:
    with pytest.raises(InputError, match=r'"delay" needs beliefs that move.*stationary'):
        Study.of(PLAN | {"beliefs": {"kind": "grid", "resolution": 6}, "adversaries": "naive"})


@pytest.mark.parametrize(
    ("maker", "observer", "said"),
    [
        ("delay", {"name": "naive", "disclosure": "rounded(1)"}, "read from all decisions as they are"),
        (
            {"name": "sequential", "information_price": "infinite"},
            {"name": "sequential", "disclosure": "every(2)"},
            "made for an observer",
        ),
        ({"name": "sequential", "loss": "rival"}, {"name": "naive"}, r"needs the section \[rival\]"),
    ],
)
def test_what_a_rule_with_a_memory_is_not_read_from_is_refused(maker: Any, observer: Any, said: str) -> None:
    runner = runner_of(decision_makers=maker, adversaries=observer, budgets={"unit": "silence", "values": 1.0})
    with draft_simulations(), pytest.raises((ModelError, InputError), match=said):
        runner.figures(runner.grid.task(0))
