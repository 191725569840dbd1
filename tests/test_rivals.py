"""Rivals in files: compare and studies say what reading is worth to them; what is no rival is refused."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from inscrutable import (
    FiniteProblem,
    InputError,
    MarkowitzProblem,
    NamingError,
    RivalProblem,
    Study,
    compare,
    leakage,
    max_weights,
    mechanism,
    run_study,
    simplex,
)
from inscrutable.decision_makers import OriginalDecisionMaker
from inscrutable.experiments.comparison import ComparisonSettings, makers_of
from inscrutable.experiments.comparison_study import compared, comparison_study
from inscrutable.experiments.rivals import is_own, loss_of, read_rival
from inscrutable.reports.comparison import markdown_of, summary_data, write_comparison
from sizes import audited
from small_runs import learned_from_few
from test_comparison import small_market

WAGER = [[-1.0, 1.0, 1.0, 0.0], [1.0, -1.0, 1.0, 0.0], [1.0, 1.0, -1.0, 0.0]]
CHEAP = ["ODM", "rate-distortion", "coin", "CDM, candidates only"]


@pytest.fixture(scope="module", autouse=True)
def soon() -> Iterator[None]:
    """What is learned of the risk aversion has tests of its own, in test_comparison_watchers.py."""
    with learned_from_few(1):
        yield


def compared_with(rival):
    problem, prior = small_market(resolution=4 if audited() else 3)
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1,), draws=10, rival=rival)
    return compare(problem, prior, settings, makers=makers_of(CHEAP), rng=np.random.default_rng(0)), problem, prior


@pytest.mark.usefixtures("undrawn")
def test_a_copier_takes_what_the_agent_does_not_give_up(tmp_path: Path) -> None:
    found, problem, prior = compared_with({"kind": "own"})
    assert found.rival_is_own
    assert found.secret_worth == pytest.approx(found.silence_regret, rel=1e-9)
    for row in found.rows:
        assert row.rival_worth >= found.silence_regret - row.expected_regret - 1e-9 * found.silence_regret
        assert row.rival_worth <= found.secret_worth
    told = leakage(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, loss=RivalProblem(problem))
    assert found.of("ODM")[0].rival_worth == pytest.approx(told.worth, rel=1e-12)
    assert "it can always copy" in found.summary()
    assert "sum to at least the silence regret" in markdown_of(found, "a")
    names = {path.name for path in write_comparison(found, tmp_path)}
    assert {"comparison_rival.png", "comparison_rival.svg"} <= names
    assert summary_data(found, "a")["rival_is_own"]


@pytest.mark.parametrize(
    ("rival", "loss"),
    [({"kind": "finite", "costs": WAGER}, RivalProblem(FiniteProblem(WAGER))), ({"kind": "naming"}, NamingError())],
)
def test_another_rival_is_measured_in_its_own_unit(rival, loss) -> None:
    found, problem, prior = compared_with(rival)
    told = leakage(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, loss=loss)
    assert found.of("ODM")[0].rival_worth == pytest.approx(told.worth, rel=1e-12)
    assert not found.rival_is_own
    assert "copying" not in found.summary()
    assert found.rival == loss.unit


def test_without_a_rival_nothing_is_said_of_one() -> None:
    found, _, _ = compared_with(None)
    assert "rival_worth" not in found.frame()
    assert "rival" not in summary_data(found, "a")
    assert "worth to the rival" not in markdown_of(found, "a")


def test_a_portfolio_like_the_agents_is_the_agents_own() -> None:
    problem, _ = small_market()
    same = loss_of(
        ComparisonSettings(rival={"kind": "markowitz", "risk_aversion": problem.risk_aversion}).rival, problem
    )
    other = loss_of(ComparisonSettings(rival={"max_weight": 0.5}).rival, problem)
    assert is_own(same, problem)
    assert not is_own(other, problem)
    assert not is_own(NamingError(), problem)
    capped = MarkowitzProblem(problem.means, problem.covariances, 5.0, simplex(3) & max_weights(3, 0.5))
    belief = np.array([0.2, 0.5, 0.3])
    assert other.least(belief[None])[0] == pytest.approx(capped.optimal_cost(belief), rel=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[problem", "is not TOML"),
        ("[world]\n", "expected the section \\[problem\\] alone"),
        ('[problem]\nkind = "dispatch"\n', "expected tags|dispatch"),
        ("[problem]\nrisk_aversion = -1\n", "risk_aversion"),
        ('[problem]\nkind = "finite"\n', "costs"),
    ],
)
def test_files_that_hold_no_rival_are_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "rival.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(InputError, match=said):
        read_rival(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_rival(tmp_path / "none.toml")


def test_a_rival_on_other_regimes_is_refused() -> None:
    problem, _ = small_market()
    with pytest.raises(InputError, match="2 states, the beliefs 3"):
        loss_of(ComparisonSettings(rival={"kind": "finite", "costs": [[0.0], [1.0]]}).rival, problem)
    with pytest.raises(InputError, match="needs an agent with a portfolio"):
        loss_of(ComparisonSettings(rival={"kind": "markowitz"}).rival, FiniteProblem(np.eye(3)))


def test_a_kept_comparison_has_its_rival(tmp_path: Path) -> None:
    rival = tmp_path / "rival.toml"
    rival.write_text('[problem]\nkind = "own"\n', "utf-8")
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1,), draws=10, rival=read_rival(rival))
    study = comparison_study(settings, market="paper", resolution=3, seed=0)
    asked = Study.of(study.plan.model_dump(exclude_none=True) | {"decision_makers": ["ODM", "coin"]})
    found, _ = compared(asked, tmp_path / "study", say=lambda line: None, progress=lambda *_: None)
    assert found.rival_is_own
    coin = found.of("coin")[0]
    assert coin.rival_worth == pytest.approx(found.silence_regret - coin.expected_regret, rel=1e-6)


def test_a_study_measures_worth_and_hides_from_its_rival(tmp_path: Path) -> None:
    plan = {
        "name": "a",
        "world": {"kind": "random"},
        "beliefs": {"kind": "grid", "resolution": 3},
        "candidates": {"resolution": 4},
        "decision_makers": ["ODM", {"name": "Stackelberg", "loss": ["squared", "rival"]}],
        "budgets": {"values": 0.5, "unit": "silence"},
        "measures": ["worth", "secret_worth", "expected_regret"],
    }
    frame = run_study(Study.of(plan | {"rival": {"kind": "naming"}}), tmp_path / "one").frame()
    loss = frame["decision_maker.loss"].fillna("")
    worth = dict(zip(frame["decision_maker"] + loss, frame["worth"].astype(float), strict=True))
    assert worth["Stackelbergrival"] <= worth["Stackelbergsquared"] + 1e-6
    assert worth["ODM"] == pytest.approx(float(frame["secret_worth"].iloc[0]), rel=1e-9)
    alone = run_study(Study.of(plan), tmp_path / "two").frame()
    failed = alone[alone["status"] == "failed"]
    assert len(failed) == 1
    assert "needs the section [rival]" in failed["failure"].iloc[0]
