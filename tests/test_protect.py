"""Protection: within the budget, private against the adversary's own tools, honest about what is read."""

from __future__ import annotations

import json
import re
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import multivariate_normal

from inscrutable.adversaries import consistent_beliefs
from inscrutable.budgets import Budget
from inscrutable.cli import main
from inscrutable.datasets import read_weights
from inscrutable.decision_makers import CounterAdversarialDecisionMaker, DecisionStatus
from inscrutable.decision_makers.hiding import HidingDecisionMaker
from inscrutable.errors import InputError
from inscrutable.experiments.attack import Reading, attack_weights
from inscrutable.experiments.protect import implausible_rows, protect
from inscrutable.geometry import simplex_grid
from inscrutable.privacy import DesiredObfuscation, Infeasibility, MaximalObfuscation, NonExistence
from inscrutable.reports.protect import (
    option_lines,
    protect_summary,
    protect_table,
    published_weights,
    row_lines,
    write_protect,
)
from inscrutable.worlds import HiddenMarkovModel
from sizes import audited, some
from small_runs import nothing_painted
from test_attack import market, published

MODEL = market(20, 5)
BELIEFS = np.array([[0.2, 0.3, 0.5], [0.7, 0.2, 0.1]])


def test_an_unusual_budget_of_a_model_file_is_a_caution(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """5, meant as 5 per cent, published weights that cost four times the optimum."""
    regimes = """
[regimes]
names = ["calm", "crisis"]
transition = [[0.95, 0.05], [0.2, 0.8]]
assets = ["Oil", "Food"]
means = [[0.008, 0.007], [-0.02, 0.002]]
covariances = [[[0.002, 0.0004], [0.0004, 0.001]], [[0.008, 0.002], [0.002, 0.003]]]
"""
    for written, option, said in (("5", None, True), ("0.05", None, False), ("0.05", "5", True), ("5", "0.05", False)):
        (tmp_path / "model.toml").write_text(f"[investor]\nbudget = {written}\n{regimes}")
        asked = ["protect", "--model", str(tmp_path / "model.toml"), "--belief", "0.7,0.3", "--json"]
        assert main([*asked, *([] if option is None else ["--budget", option])]) == 0
        cautions = json.loads(capsys.readouterr().out)["cautions"]
        assert any("a budget of 5 of |c*| is more than the optimal cost" in each for each in cautions) == said


def test_budget_privacy_and_conclusion() -> None:
    budget = Budget.regret(3e-4)
    found = protect(MODEL, BELIEFS, budget, rng=np.random.default_rng(0))
    problem = MODEL.problem
    for step, belief in enumerate(BELIEFS):
        publish, lottery = found.deterministic[step], found.lotteries[step]
        assert float(problem.regret(belief, publish.action)) <= 3e-4 * (1 + 1e-9)
        assert lottery.expected_regret <= 3e-4 * (1 + 1e-9)
        assert publish.privacy == pytest.approx(consistent_beliefs(problem, publish.action).distance(belief), abs=1e-6)
        assert publish.privacy > 0.1
        assert lottery.expected_privacy >= publish.privacy - 1e-9
        assert any(np.array_equal(found.drawn[step].action, atom) for atom in lottery.actions)
        low, high = found.aware_bounds[step].T
        assert (low - 1e-6 <= belief).all()
        assert (belief <= high + 1e-6).all(), "who knows the budget is never wrong"
        assert found.optimal_sets[step].contains(belief)
    assert "regret" in found.summary()
    rows = found.deterministic
    assert f"({rows.regret.sum() / np.abs(rows.optimal_cost).sum():.1%} of |c*|)" in found.summary()


@pytest.mark.parametrize("budget", ["5%", "150%"])
def test_who_knows_a_share_of_the_cost_reads_what_is_affordable_by_it(budget: str) -> None:
    problem, belief = MODEL.problem, BELIEFS[1]
    found = protect(MODEL, belief, Budget.parse(budget), rng=np.random.default_rng(0))
    action, grid = found.deterministic.action[0], simplex_grid(3, 200)
    cost = problem.optimal_cost(grid)
    allowed = 0.05 * np.abs(cost) if budget == "5%" else 1.5 * abs(float(problem.optimal_cost(belief)))
    inside = grid[problem.regret(grid, action) <= allowed]
    low, high = found.aware_bounds[0].T
    np.testing.assert_allclose(low, inside.min(axis=0), atol=0.006)
    np.testing.assert_allclose(high, inside.max(axis=0), atol=0.006)


def test_the_decimals_that_keep_the_privacy_are_stated() -> None:
    """As an attack on a file of so many decimals reads them."""
    found = protect(MODEL, BELIEFS, 0.1, rng=np.random.default_rng(0))
    for step, belief in enumerate(BELIEFS):
        stated = re.search(
            r"at least (\d) decimals: with \d, the set that this library reads from .* as near to yours as (.*)\.$",
            found.rounding_note(step),
        )
        assert stated
        decimals, near = int(stated[1]), float(stated[2])
        for digits, most in ((decimals, np.inf), (decimals - 1, 0.9 * found.deterministic.privacy[step])):
            published = pd.DataFrame([found.deterministic.action[step]], columns=list(MODEL.assets)).round(digits)
            corners = attack_weights(MODEL, published, decimals=digits).rows[0].corners
            around = np.random.default_rng(1).dirichlet(np.ones(len(corners)), 4000) @ corners
            distance = float(np.linalg.norm(np.vstack([corners, around]) - belief, axis=1).min())
            assert distance <= most
            if digits == decimals:
                assert distance >= 0.88 * found.deterministic.privacy[step]
            else:
                assert distance == pytest.approx(near, abs=0.02)
    assert not protect(MODEL, BELIEFS[0], 0.0, rng=np.random.default_rng(0)).rounding_note()


def test_one_belief_frames_and_defaults() -> None:
    single = protect(MODEL, BELIEFS[0], rng=np.random.default_rng(1))
    assert len(single) == 1
    assert single.budget == MODEL.budget
    assert isinstance(single.measure, MaximalObfuscation)
    columns = list(MODEL.regimes)
    frame = pd.DataFrame(BELIEFS, columns=columns, index=["x", "y"])
    swapped = protect(MODEL, frame[columns[::-1]].iloc[:1], rng=np.random.default_rng(1))
    assert np.array_equal(swapped.beliefs, single.beliefs)
    assert np.array_equal(swapped.drawn.action, single.drawn.action)
    assert list(swapped.index) == ["x"]


def test_planned_weights_are_read_first() -> None:
    planned = published(MODEL, BELIEFS, None)
    found = protect(MODEL, attack_weights(MODEL, planned), 0.2, rng=np.random.default_rng(2))
    assert np.allclose(found.beliefs, BELIEFS, atol=1e-6)
    assert implausible_rows(found) == []
    odd = market(21, 8)
    equal = pd.DataFrame([np.full(8, 0.125)], columns=list(odd.assets))
    strange = protect(odd, attack_weights(odd, equal), 0.2)
    assert implausible_rows(strange) == [0]
    assert strange.beliefs.sum() == pytest.approx(1.0)


def test_desired_obfuscation_gets_nearer_to_its_target() -> None:
    target = DesiredObfuscation(lambda belief: belief[::-1])
    found = protect(MODEL, BELIEFS[:1], Budget.regret(1e-3), target, rng=np.random.default_rng(3))
    own = -consistent_beliefs(MODEL.problem, found.optimal[0]).distance(BELIEFS[0][::-1])
    assert found.deterministic.privacy[0] > own
    direct = CounterAdversarialDecisionMaker(MODEL.problem, target, Budget.regret(1e-3)).decide(BELIEFS[0])
    assert np.array_equal(found.deterministic.action[0], direct.action)


def test_a_privacy_of_nothing_has_no_sign() -> None:
    """A desired belief is reached up to rounding: its privacy is minus a small distance."""
    found = protect(MODEL, BELIEFS[:1], Budget.regret(1e-3), DesiredObfuscation(lambda belief: belief))
    assert -1e-4 < found.deterministic.privacy[0] <= 0.0
    shown = [*option_lines(found, 0).loc["privacy"], *row_lines(found)["privacy"]]
    assert {"0.0000", "0.000"} <= set(shown)
    assert "-0.000" not in " ".join([*shown, found.summary()])


def test_other_measures_and_a_budget_of_nothing() -> None:
    nothing = protect(MODEL, BELIEFS[:1], 0.0, rng=np.random.default_rng(4))
    assert nothing.deterministic.privacy[0] == pytest.approx(0.0, abs=1e-6)
    missed = protect(MODEL, BELIEFS[:1], 0.1, NonExistence(), rng=np.random.default_rng(4))
    assert missed.deterministic.privacy[0] == 0.0
    assert missed.deterministic.belief_set[0].distance(BELIEFS[0]) >= 0.01 - 1e-9


def test_the_verdict_says_what_silence_costs() -> None:
    """Against a path of the filter that is written out: the mean regret of the portfolio for the mean belief."""
    world, problem, rng = MODEL.world, MODEL.problem, np.random.default_rng(11)
    seen, belief, path = world.sample(20_000, rng=rng).observations, world.initial, []
    densities = [multivariate_normal(*each).pdf(seen) for each in zip(problem.means, problem.covariances, strict=True)]
    for likelihood in np.array(densities).T:
        belief = belief * likelihood / (belief @ likelihood) @ world.transition
        path.append(belief)
    own = problem.solve(np.mean(path, axis=0))
    silence = np.mean([problem.regret(each, own) for each in path[::20]])
    for budget, dearer in ((0.2 * silence, False), (3.0 * silence, True)):
        said = protect(MODEL, BELIEFS[:1], Budget.regret(budget), rng=np.random.default_rng(1)).verdict
        told = 1e-4 * float(said.partition("reveals nothing and costs ")[2].partition(" bp")[0])
        assert told == pytest.approx(silence, rel=0.1)
        assert ("not more than these weights" in said) == dearer


def test_under_a_limit_on_turnover_silence_costs_what_it_costs_without() -> None:
    """The constant portfolio is not held back by the limit, and a regret within the limit does not compare with it."""
    before = MODEL.problem.solve(BELIEFS[0])
    near = replace(MODEL, turnover=0.1).after(before)
    free, found = (protect(model, BELIEFS[1], 3.0, rng=np.random.default_rng(0)) for model in (MODEL, near))
    costs = [each.verdict.partition("reveals nothing and costs ")[2].partition(" bp")[0] for each in (free, found)]
    assert costs[0] == costs[1]
    assert "against the best without the limit on turnover." in found.verdict
    assert "not more than these weights" in free.verdict
    assert "not more than these weights" not in found.verdict
    assert not found.rounding_note()
    assert np.abs(found.deterministic.action[0] - before).sum() <= 0.1 + 1e-9


@pytest.mark.parametrize("calls", [10, 10_000])
def test_a_gap_that_is_not_reached_is_said(calls: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(HidingDecisionMaker._prove_within, "__defaults__", (calls,))
    found = protect(MODEL, BELIEFS[1], 0.2, certify=0.001, rng=np.random.default_rng(0))
    statuses = {*found.deterministic.status, *found.lotteries.status}
    assert (DecisionStatus.BOUNDED in statuses) == (calls == 10)
    assert ("the gap of 0.001 that was asked for is not reached" in found.summary()) == (calls == 10)


def test_regimes_that_practically_never_change_leave_the_cost_of_silence_unknown() -> None:
    stays = 1e-9 * np.ones((3, 3)) + (1.0 - 3e-9) * np.eye(3)
    model = replace(MODEL, world=HiddenMarkovModel(stays, MODEL.world.emission, np.full(3, 1.0 / 3.0)))
    said = protect(model, BELIEFS[0], Budget.regret(3e-4), rng=np.random.default_rng(0)).verdict
    assert "costs in the long run is not known: a simulated path" in said
    assert "Error of the naive observer" in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.5, 0.6, 0.1],), "sums to 1.2"),
        (([0.5, 0.5],), "2 entries, expected one per state: 3"),
        ((pd.DataFrame([[1.0, 0.0]], columns=["regime 1", "x"]),), r"missing: \['regime 2', 'regime 3'\]"),
        ((BELIEFS[0], -0.1), "at least 0"),
        ((BELIEFS[0], 0.1, "maximal"), "measure must be"),
        ((BELIEFS[0], 0.1, DesiredObfuscation([0.5, 0.5])), "expected one per state"),
    ],
)
def test_malformed_arguments(arguments: tuple[object, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        protect(MODEL, *arguments)  # type: ignore[arg-type]


def test_published_files_are_read_back_as_intended(tmp_path: Path) -> None:
    done: list[tuple[int, int]] = []
    frame = pd.DataFrame(
        BELIEFS, columns=list(MODEL.regimes), index=pd.DatetimeIndex(["2001-01-31", "2001-02-28"], name="month")
    )
    found = protect(
        MODEL, frame, 0.2, rng=np.random.default_rng(5), progress=lambda now, total: done.append((now, total))
    )
    assert done[-1] == (6, 6)
    assert [now for now, _ in done] == sorted(now for now, _ in done)
    with nullcontext() if audited() else nothing_painted():
        written = write_protect(found, tmp_path)
    assert all(path.stat().st_size > 100 for path in written)
    table = read_weights(tmp_path / "publish.csv", assets=MODEL.assets)
    assert np.array_equal(table.frame.to_numpy(), found.deterministic.action)
    read = attack_weights(MODEL, table)
    concluded = np.array([each.center() for each in found.deterministic.belief_set])
    assert np.allclose(read.estimates, concluded, atol=1e-6)
    drawn = read_weights(tmp_path / "publish_drawn.csv", assets=MODEL.assets)
    assert np.array_equal(drawn.frame.to_numpy(), published_weights(found, drawn=True).to_numpy())


def test_tables_say_what_each_publication_costs_and_says() -> None:
    found = protect(MODEL, BELIEFS, 0.2, rng=np.random.default_rng(6))
    table = protect_table(found)
    for step in range(2):
        rows = table.loc[step]
        assert rows.loc["ODM: optimal", "regret"] == 0.0
        assert rows.loc["ODM: optimal", "distance"] == pytest.approx(0.0, abs=1e-6)
        assert rows.loc["CDM: publish this", "regret"] == found.deterministic.regret[step]
        atoms = rows[rows.index.str.startswith("PDM: atom")]
        assert atoms["probability"].sum() == pytest.approx(1.0)
        weights = rows[[f"weight: {asset}" for asset in MODEL.assets]].to_numpy(dtype=float)
        assert np.allclose(weights.sum(axis=1), 1.0)
        assert option_lines(found, step).shape[1] == len(rows)
    assert list(row_lines(found).index) == [0, 1]
    summary = protect_summary(found)
    assert len(summary["rows"]) == 2
    assert summary["implausible_rows"] == []


def test_rounded_plans_are_read_as_rounded_and_the_bar_moves_all_along() -> None:
    plans = published(MODEL, BELIEFS, 2)
    seen: list[tuple[int, int]] = []
    found = protect(
        MODEL,
        attack_weights(MODEL, plans, decimals=2),
        rng=np.random.default_rng(0),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert found.planned is not None
    assert found.planned.decimals == 2
    assert found.planned.count(Reading.ROUNDED) == len(plans)
    assert np.array_equal(found.beliefs, attack_weights(MODEL, plans, decimals=2).estimates)
    shares = [done / total for done, total in seen]
    assert shares == sorted(shares)
    assert shares[0] >= 1 / 4, "the reading of the weights is a part of the work, and done"
    assert shares[-1] == 1.0


def test_the_model_must_be_one() -> None:
    for budget in (None, 0.1):
        with pytest.raises(InputError, match="model must be an InvestorModel"):
            protect(MODEL.problem, BELIEFS, budget)  # type: ignore[arg-type]


@pytest.mark.parametrize(("budget", "word"), [(Budget.regret(0.01), "met"), (Budget.regret(0.0), "missed")])
def test_a_goal_is_reported_in_words(budget: Budget, word: str) -> None:
    one = protect(MODEL, BELIEFS[0], budget, NonExistence(), rng=np.random.default_rng(0))
    lines = option_lines(one, 0).loc["privacy"].tolist()
    assert lines == ["missed", word, word, word]
    assert f"NonExistence(margin=0.01) is {word}, the lottery" in one.summary()
    many = protect(MODEL, BELIEFS, budget, NonExistence(), rng=np.random.default_rng(0))
    assert row_lines(many)["privacy"].tolist() == [word, word]
    assert f"is met in {2 if word == 'met' else 0} of 2" in many.summary()
    assert "inf" not in one.summary() + many.summary()


def test_where_nothing_explains_the_weights_the_observer_concludes_nothing() -> None:
    found = protect(MODEL, BELIEFS, Budget.regret(0.01), Infeasibility(), rng=np.random.default_rng(0))
    assert row_lines(found)["observer concludes"].tolist() == ["", ""]
    assert row_lines(found)["names"].tolist() == ["nothing", "nothing"]


@pytest.mark.parametrize("measure", some([None, DesiredObfuscation([0.6, 0.3, 0.1])], 2))
def test_a_proof_is_above_every_affordable_decision_met_at_random(measure: DesiredObfuscation | None) -> None:
    rng = np.random.default_rng(5)
    budget, problem = Budget.regret(3e-4), MODEL.problem
    found = protect(MODEL, BELIEFS, budget, measure, certify=0.01, rng=rng)
    plain = protect(MODEL, BELIEFS, budget, measure, rng=rng)
    actions = problem.solve(rng.dirichlet(np.full(3, 0.7), 400))
    for step, belief in enumerate(BELIEFS):
        chosen, lottery = found.deterministic[step], found.lotteries[step]
        privacies = [
            float(found.measure.at_step(step)(belief, consistent_beliefs(problem, action)))
            for action in actions
            if float(problem.regret(belief, action)) <= 3e-4
        ]
        assert max(privacies) <= chosen.privacy_bound + 1e-9
        assert chosen.privacy_bound <= chosen.privacy + 0.0101 * max(abs(chosen.privacy), 0.01)
        assert max(chosen.privacy_bound, lottery.expected_privacy) <= lottery.privacy_bound + 1e-9
        assert chosen.privacy_bound <= plain.deterministic[step].privacy_bound
    assert "proven" in found.summary()
    assert "proven" not in plain.summary()
    assert protect_summary(found)["certified"] == 0.01
    assert "at most" in row_lines(found)
    assert "at most" not in row_lines(plain)


def test_weights_that_were_read_already_stand_for_their_beliefs() -> None:
    planned = published(MODEL, BELIEFS, None)
    read = attack_weights(MODEL, planned)
    found = protect(MODEL, read, 0.2, rng=np.random.default_rng(2))
    same = protect(MODEL, read.estimates, 0.2, rng=np.random.default_rng(2))
    assert found.planned is read
    assert np.array_equal(found.beliefs, same.beliefs)
    assert np.array_equal(found.drawn.action, same.drawn.action)


def test_what_cannot_be_proven_is_refused_before_any_work() -> None:
    with pytest.raises(InputError, match="certify proves"):
        protect(MODEL, BELIEFS, measure=NonExistence(), certify=0.01)
    with pytest.raises(InputError, match="between 0 and 1"):
        protect(MODEL, BELIEFS, certify=1.5)
