"""The study of private alphas: rules cost and tell what a simulated observer finds, and none is better than the best."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from inscrutable import Study, run_study
from inscrutable.cli import main

SMALL = {
    "kind": "alphas",
    "name": "small",
    "assets": 3,
    "factors": 1,
    "budgets": [0.25, 0.75],
    "persistence": [0.0, 0.8],
    "steps": 300,  # at 100 simulated shares miss their expectation by more than a quarter for one seed in four
    "repeats": 1,
}


def test_the_study_of_alphas_is_beside_the_best_of_any_rule(tmp_path: Path) -> None:
    study = run_study(Study.of(SMALL), tmp_path / "study")
    rows = study.frame()
    assert study.status().done == len(rows) == 8, list(study.errors())
    np.testing.assert_allclose(rows["regret_share"], rows["budget"], rtol=1e-6)
    assert (rows["bits"] >= rows["least_bits"] - 1e-6).all()
    assert (rows["error_share"] <= rows["most_error_share"] + 1e-6).all()
    told = rows["objective"] == "information"
    np.testing.assert_allclose(rows["bits"][told], rows["least_bits"][told], rtol=1e-4)
    np.testing.assert_allclose(rows["error_share"][~told], rows["most_error_share"][~told], rtol=1e-4)
    assert np.abs(rows["simulated_regret_share"] - rows["budget"]).max() < 0.2
    assert np.abs(rows["simulated_error_share"] - rows["error_share"]).max() < 0.25
    # Markets are those of the repeat: more may be hidden for more, and what lasts tells less a step.
    least = rows[told].set_index(["repeat", "persistence", "budget"])["least_bits"].unstack()
    assert (least[0.25] > least[0.75]).all()
    lasting = rows[told].set_index(["repeat", "budget", "persistence"])["least_bits"].unstack()
    assert (lasting[0.8] < lasting[0.0]).all()


def test_a_study_without_a_page_names_the_command_for_its_rows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    keys = SMALL | {"budgets": [0.25], "persistence": [0.0], "steps": 100}
    (tmp_path / "alphas.toml").write_text("".join(f"{key} = {json.dumps(value)}\n" for key, value in keys.items()))
    assert main(["study", "run", str(tmp_path / "alphas.toml"), "--out", str(tmp_path / "out")]) == 0
    *_, last = capsys.readouterr().err.splitlines()
    told, _, command = last.partition(": inscrutable ")
    assert told == "Its rows as a table"
    assert main(command.split()) == 0


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"budgets": [1.0]}, "less than 1"),
        ({"persistence": [1.0]}, "less than 1"),
        ({"asets": 3}, "did you mean assets"),
    ],
)
def test_what_no_study_of_alphas_holds(changed: dict[str, object], said: str) -> None:
    with pytest.raises(Exception, match=said):
        Study.of({**SMALL, **changed})
