"""Decision makers compared against observers: figures recomputed by loops, invariances, degenerate priors, files, the verb."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    Budget,
    CoinDecisionMaker,
    FiniteProblem,
    InputError,
    KeptDecisionMaker,
    MarkowitzProblem,
    Mechanism,
    Prior,
    ProbabilisticDecisionMaker,
    Study,
    calibrate,
    cli,
    consistent_beliefs,
    decoy_grid,
    mechanism,
    uniform_prior,
)
from inscrutable.decision_makers import LinearProgramme
from inscrutable.experiments.candidates_only import CandidateDecisionMaker
from inscrutable.experiments.comparison import Comparison, ComparisonSettings, compare, makers_of
from inscrutable.experiments.comparison_markets import market_of
from inscrutable.experiments.random_markets import random_market
from inscrutable.experiments.setting import Behaviour, Setting, behaviour_of, scaled_to
from inscrutable.experiments.studies.comparison_tasks import ComparisonFile, compared_pairs
from inscrutable.experiments.weight_limits import LimitsPart
from inscrutable.reports import comparison_plots
from inscrutable.reports.comparison import markdown_of, short_table, terminal_table, write_comparison
from inscrutable.reports.comparison_plots import draw_comparison
from inscrutable.reports.names import spelled
from inscrutable.tolerances import CALIBRATED
from sizes import audited, instances, some
from small_runs import learned_from_few, nothing_painted

SETTINGS = ComparisonSettings(budgets=(0.25, 0.75), repeats=(1, 20), draws=instances(100, least=25))


def small_market(seed: int = 0, resolution: int = 4 if audited() else 3) -> tuple[MarkowitzProblem, Prior]:
    prior = uniform_prior(3, resolution)
    weights = np.random.default_rng(seed).dirichlet(np.ones(len(prior)))
    return random_market(rng=np.random.default_rng(seed)).problem, Prior(prior.beliefs, weights)


@pytest.fixture(scope="module", autouse=True)
def soon() -> Iterator[None]:
    """What is learned of the risk aversion has tests of its own, in test_comparison_watchers.py."""
    with learned_from_few():
        yield


@pytest.fixture(scope="module")
def market() -> tuple[MarkowitzProblem, Prior]:
    return small_market()


@pytest.fixture(scope="module")
def found(market: tuple[MarkowitzProblem, Prior]) -> Comparison:
    return compare(*market, SETTINGS, rng=np.random.default_rng(1))


def some_mechanism(problem: MarkowitzProblem, prior: Prior, seed: int) -> Mechanism:
    """Optimal decisions, played at random, so that every figure is something between nothing and all."""
    rng = np.random.default_rng(seed)
    actions = problem.solve(rng.dirichlet(np.ones(3), size=5))
    table = rng.dirichlet(np.full(5, 0.4), size=len(prior))
    regrets = np.array([[max(float(problem.regret(b, u)), 0.0) for u in actions] for b in prior.beliefs])
    return Mechanism(prior.beliefs, actions, table, regrets)


# ---- figures ---------------------------------------------------------------------------------------


def test_figures_of_one_row_by_loops(market: tuple[MarkowitzProblem, Prior]) -> None:
    problem, prior = market
    played = some_mechanism(problem, prior, 2)
    limit = 0.002
    makers = {"it": lambda setting, regret: Behaviour(played, Budget.regret(limit))}
    row = compare(
        problem,
        prior,
        ComparisonSettings(budgets=(0.001,), unit="regret", repeats=(1,)),
        makers=makers,
        rng=np.random.default_rng(0),
    )
    found = row.of("it")[0]
    table, beliefs, weights = np.asarray(played.probabilities), prior.beliefs, prior.weights
    squared = {"naive": 0.0, "near": 0.0, "budget": 0.0, "bayes": 0.0}
    privacy = regret = information = named = 0.0
    for m, action in enumerate(played.actions):
        chance = sum(weights[b] * table[b, m] for b in range(len(prior)))
        posterior = sum(weights[b] * table[b, m] * beliefs[b] for b in range(len(prior))) / chance
        explained = consistent_beliefs(problem, action)
        guesses = {"naive": explained.vertices().mean(axis=0), "bayes": posterior}
        for key, most in (("near", 0.001), ("budget", limit)):
            fits = [b for b in range(len(prior)) if problem.regret(beliefs[b], action) <= most]
            assert fits, "the example should leave no empty set"
            guesses[key] = sum(weights[b] * beliefs[b] for b in fits) / sum(weights[b] for b in fits)
        for b, belief in enumerate(beliefs):
            mass = weights[b] * table[b, m]
            for key, guess in guesses.items():
                squared[key] += mass * float(((belief - guess) ** 2).sum())
            privacy += mass * explained.distance(belief)
            regret += mass * float(problem.regret(belief, action))
            information += mass * np.log2(table[b, m] / chance)
            named += mass * (belief[guesses["naive"].argmax()] == belief.max())
    assert found.naive_error == pytest.approx(np.sqrt(squared["naive"]), abs=1e-7)
    assert found.near_optimal_error == pytest.approx(np.sqrt(squared["near"]), abs=1e-9)
    assert found.budget_aware_error == pytest.approx(np.sqrt(squared["budget"]), abs=1e-9)
    assert found.bayes_error == pytest.approx(np.sqrt(squared["bayes"]), abs=1e-9)
    assert found.naive_privacy == pytest.approx(privacy, abs=1e-7)
    assert found.expected_regret == pytest.approx(regret, abs=1e-12)
    assert found.mutual_information == pytest.approx(information, abs=1e-9)
    assert found.naive_top_state == pytest.approx(named, abs=1e-9)
    assert found.cost_share == pytest.approx(regret / (weights @ np.abs(problem.optimal_cost(beliefs))))
    silence = min(
        float(weights @ [problem.regret(b, u) for b in beliefs])
        for u in [problem.solve(weights @ beliefs), *played.actions]
    )
    assert found.silence_share == pytest.approx(regret / silence)


def test_a_promise_that_is_not_given_is_the_largest_regret(market: tuple[MarkowitzProblem, Prior]) -> None:
    problem, prior = market
    played = some_mechanism(problem, prior, 3)
    worst = float(np.asarray(played.regrets)[np.asarray(played.probabilities) > 0].max())
    makers = {"open": lambda *_: Behaviour(played), "told": lambda *_: Behaviour(played, Budget.regret(worst))}
    found = compare(
        problem, prior, ComparisonSettings(budgets=(0.5,), repeats=(1,)), makers=makers, rng=np.random.default_rng(0)
    )
    assert found.of("open")[0].worst_regret == pytest.approx(worst)
    assert found.of("open")[0].budget_aware_error == pytest.approx(found.of("told")[0].budget_aware_error, abs=1e-12)


def test_everybody_spends_the_same_or_cannot(found: Comparison) -> None:
    for row in found.rows:
        if row.maker == "ODM":
            assert row.expected_regret == pytest.approx(0.0, abs=1e-15)
        elif row.maker in ("PDM", "PDM, candidates only"):
            assert row.expected_regret == pytest.approx(row.budget, rel=CALIBRATED)
        else:  # a few beliefs and single decisions cannot spend every amount
            assert 0.5 * row.budget < row.expected_regret <= (1.0 + 1e-12) * row.budget


def test_what_must_hold_of_every_row(found: Comparison) -> None:
    for row in found.rows:
        assert 0.0 <= row.bayes_error <= found.prior_error + 1e-12
        assert 0.0 <= row.least_error <= row.bayes_error + 1e-12
        assert 0.5 - 1e-9 <= row.read_auc <= row.auc + 1e-9 <= 1.0 + 2e-9
        for error in (row.naive_error, row.near_optimal_error, row.budget_aware_error):
            assert error >= row.bayes_error - 1e-9, "nobody does better than Bayes' rule"
        assert row.mutual_information <= found.prior_entropy + 1e-9
        assert row.min_entropy_leakage <= row.maximal_leakage + 1e-9
        assert row.naive_privacy <= row.naive_error + 1e-9 or row.implausible_share > 0
        assert row.repeated_errors[0] == row.bayes_error
        assert row.repeated_error_se[0] == 0.0
        assert row.repeated_information[1] >= row.mutual_information - 0.5


def test_the_original_decision_hides_nothing(found: Comparison) -> None:
    (row,) = found.of("ODM")
    # Several beliefs may share one decision, most of all where few assets are held.
    assert row.naive_privacy == pytest.approx(0.0, abs=1e-7)
    assert (row.auc, row.read_auc) == pytest.approx((0.5, 0.5))
    assert row.worst_regret == pytest.approx(0.0, abs=1e-12)


def test_costs_in_another_unit_change_regrets_alone(market: tuple[MarkowitzProblem, Prior]) -> None:
    problem, prior = market
    scaled = MarkowitzProblem(100 * problem.means, 100 * problem.covariances, problem.risk_aversion)
    makers = makers_of(("CDM", "PDM, candidates only"))
    one, other = (
        compare(
            each, prior, ComparisonSettings(budgets=(0.4,), repeats=(1,)), makers=makers, rng=np.random.default_rng(0)
        )
        for each in (problem, scaled)
    )
    assert other.silence_regret == pytest.approx(100 * one.silence_regret)
    for first, second in zip(one.rows, other.rows, strict=True):
        assert second.expected_regret == pytest.approx(100 * first.expected_regret, rel=1e-6)
        for name in ("naive_error", "bayes_error", "budget_aware_error", "mutual_information", "read_auc"):
            assert getattr(second, name) == pytest.approx(getattr(first, name), abs=1e-5), name


def test_the_order_of_beliefs_is_of_no_account(market: tuple[MarkowitzProblem, Prior]) -> None:
    problem, prior = market
    order = np.random.default_rng(4).permutation(len(prior))
    turned = Prior(prior.beliefs[order], prior.weights[order])
    makers = makers_of(("PDM, candidates only",))
    settings = ComparisonSettings(budgets=(0.4,), repeats=(1,))
    one, other = (
        compare(problem, each, settings, makers=makers, rng=np.random.default_rng(0)) for each in (prior, turned)
    )
    for name in ("expected_regret", "naive_error", "bayes_error", "mutual_information", "naive_privacy"):
        assert getattr(other.rows[0], name) == pytest.approx(getattr(one.rows[0], name), abs=1e-6), name


# ---- degenerate input --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def alone(market: tuple[MarkowitzProblem, Prior]) -> Comparison:
    """Of a prior with one belief."""
    settings = SETTINGS if audited() else SETTINGS.model_copy(update={"budgets": (0.75,)})
    return compare(market[0], Prior([[0.2, 0.3, 0.5]], [1.0]), settings, rng=np.random.default_rng(0))


def test_one_belief_leaves_nothing_to_hide(alone: Comparison) -> None:
    found = alone
    assert found.prior_error == 0.0
    assert found.silence_regret == pytest.approx(0.0, abs=1e-15)
    for row in found.rows:
        assert [row.bayes_error, row.mutual_information] == pytest.approx(
            [0.0, 0.0], abs=1e-15
        )  # sums of probabilities
        assert row.top_state_accuracy == 1.0
    assert "Nothing can be hidden" in found.summary()
    assert len(short_table(found)) == len(found.rows)


def test_no_budget_plays_the_optimal_decision(market: tuple[MarkowitzProblem, Prior]) -> None:
    found = compare(*market, ComparisonSettings(budgets=(0.0,), repeats=(1,)), rng=np.random.default_rng(0))
    for row in found.rows:
        assert row.expected_regret == pytest.approx(0.0, abs=1e-9)


def test_costs_that_are_zero_somewhere_have_budgets_of_regret() -> None:
    problem = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
    prior = uniform_prior(2, 6)
    setting = Setting(problem, prior, decoy_grid(problem, 6))
    assert not setting.is_relative
    assert setting.budget(0.25) == Budget.regret(0.25)
    found = compare(problem, prior, ComparisonSettings(budgets=(0.5,), repeats=(1,)), rng=np.random.default_rng(0))
    assert found.per_belief_unit == "regret"
    assert found.of("CDM")[0].expected_regret <= found.budgets[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"unit": "bits"}, "unit: should be 'silence'"),
        ({"budgets": ()}, "budgets: should have at least 1 entry"),
        ({"budgets": (0.5, 0.5)}, "budgets: should be numbers that rise"),
        ({"budgets": (-0.1,)}, r"budgets\.0: .* greater than or equal to 0, got -0\.1"),
        ({"repeats": (10, 1)}, "repeats: should be numbers that rise"),
        ({"repeats": (0,)}, "repeats"),
        ({"draws": 1}, "draws"),
    ],
)
def test_malformed_settings_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ComparisonSettings(**change)


def test_malformed_arguments_are_refused(market: tuple[MarkowitzProblem, Prior]) -> None:
    problem, prior = market
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="prior must be a Prior"):
        compare(problem, prior.beliefs, rng=rng)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="2 states"):
        compare(problem, uniform_prior(2, 3), rng=rng)
    with pytest.raises(InputError, match="makers must be"):
        compare(problem, prior, makers={}, rng=rng)
    with pytest.raises(InputError, match="candidates must be"):
        compare(problem, prior, candidates=decoy_grid(small_market(1)[0], 3), rng=rng)


# ---- makers ----------------------------------------------------------------------------------------


def test_choices_among_candidates_by_enumeration(market: tuple[MarkowitzProblem, Prior]) -> None:
    problem, prior = market
    candidates, budget = decoy_grid(problem, 5), Budget.relative(0.05)
    played = mechanism(CandidateDecisionMaker(problem, budget, candidates), prior.beliefs)
    sets = [consistent_beliefs(problem, action) for action in candidates.actions]
    for b, belief in enumerate(prior.beliefs):
        (column,) = np.flatnonzero(np.asarray(played.probabilities)[b])
        limit = 0.05 * abs(problem.optimal_cost(belief))
        best = max(
            (
                each.distance(belief)
                for each, u in zip(sets, candidates.actions, strict=True)
                if problem.regret(belief, u) <= limit
            ),
            default=0.0,
        )
        own = consistent_beliefs(problem, played.actions[column])
        assert played.regrets[b, column] <= limit + 1e-12
        assert own.distance(belief) == pytest.approx(best, abs=1e-7)


def test_lotteries_among_candidates_by_linear_programme(market: tuple[MarkowitzProblem, Prior]) -> None:
    problem, prior = market
    candidates, budget = decoy_grid(problem, 5), Budget.relative(0.05)
    played = mechanism(CandidateDecisionMaker(problem, budget, candidates, mixes=True), prior.beliefs)
    programme = ProbabilisticDecisionMaker(problem, None, budget, candidates=candidates, method=LinearProgramme())
    wanted = programme.decide_many(prior.beliefs).expected_privacy
    for b, belief in enumerate(prior.beliefs):
        reached = sum(
            share * consistent_beliefs(problem, action).distance(belief)
            for share, action in zip(np.asarray(played.probabilities)[b], played.actions, strict=True)
            if share > 0
        )
        assert reached == pytest.approx(wanted[b], abs=1e-7)


@pytest.mark.parametrize(
    ("spends", "regret", "expected"),
    [
        (lambda amount: amount, 0.3, 0.3),
        (lambda amount: 0.8 * amount, 0.3, 0.3),
        (lambda amount: min(amount, 0.2), 0.3, 0.2),
        (lambda amount: amount**2, 0.3, 0.3),
        (lambda amount: 0.0, 0.3, 0.0),
        (lambda amount: 0.0 if amount < 0.5 else 0.4, 0.3, 0.0),  # a leap over what is asked for
        (lambda amount: amount, 0.0, 0.0),
    ],
)
def test_budgets_are_scaled_until_the_regret_is_spent(
    spends: Callable[[float], float], regret: float, expected: float
) -> None:
    setting: Any = SimpleNamespace(prior=Prior([[1.0]], [1.0]))
    tried: list[float] = []

    def play(amount: float) -> Behaviour:
        tried.append(amount)
        return Behaviour(Mechanism([[1.0]], [[0.0]], [[1.0]], [[spends(amount)]]))

    made = scaled_to(setting, play, regret)
    assert float(made.mechanism.regrets[0, 0]) == pytest.approx(expected, rel=CALIBRATED)
    assert float(made.mechanism.regrets[0, 0]) <= max(regret, 0.0)
    assert len(tried) <= (30 if spends(0.49) == 0.0 < spends(0.5) else 12)


@pytest.mark.parametrize(
    ("family", "ends", "status", "spent"),
    [
        (lambda p: p, (0.0, 1.0), "REACHED", 0.1),
        (lambda p: 1.0 - p, (1e-3, 1.0), "REACHED", 0.1),
        (lambda p: 4.0 * p * (1.0 - p), (0.0, 1.0), "REACHED", 0.1),  # both ends lie below
        (lambda p: round(4.0 * p) / 16.0, (-1.0, 4.0), "JUMPED", 0.0625),
        (lambda p: round(3.0 * p) / 16.0, (1e-3, 1.0), "JUMPED", 0.0625),
        (lambda p: p, (0.0, 0.05), "ALL_CHEAPER", 0.05),
        (lambda p: p, (0.2, 1.0), "ALL_DEARER", 0.2),
    ],
)
def test_calibration_comes_to_the_target_from_below_or_says_why_not(family, ends, status, spent) -> None:
    problem, prior = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), Prior([[1.0, 0.0]], [1.0])  # a coin costs its probability
    found = calibrate(
        lambda p: CoinDecisionMaker(problem, min(max(family(p), 0.0), 1.0), [0.0, 1.0]), 0.1, prior, *ends
    )
    assert found.status.name == status
    assert found.regret == pytest.approx(spent, rel=1e-6)
    assert found.regret <= 0.1 or status == "ALL_DEARER"
    assert found.n_trials <= 80


def test_a_rule_that_draws_and_keeps_is_calibrated_along_a_path() -> None:
    problem, path = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), np.random.default_rng(0).dirichlet(np.ones(2), 50)
    kept, plain = (
        calibrate(lambda p, wrap=wrap: wrap(CoinDecisionMaker(problem, p)), 0.1, path, 0.0, 1.0)
        for wrap in (KeptDecisionMaker, lambda maker: maker)
    )
    assert kept.status.name == "REACHED"
    assert kept.parameter == pytest.approx(plain.parameter, rel=1e-5)


def test_a_maker_of_ones_own_is_one_entry(market: tuple[MarkowitzProblem, Prior]) -> None:
    problem, prior = market

    def lottery(setting: Setting, regret: float) -> Behaviour:
        def tried(amount: float) -> Behaviour:
            budget, candidates = setting.budget(amount), setting.candidates
            return behaviour_of(setting, ProbabilisticDecisionMaker(problem, None, budget, candidates=candidates))

        return scaled_to(setting, tried, regret)

    own = {"lottery": lottery}
    found = compare(
        problem, prior, ComparisonSettings(budgets=(0.5,), repeats=(1,)), makers=own, rng=np.random.default_rng(0)
    )
    assert found.makers == ("lottery",)
    assert found.of("lottery")[0].expected_regret == pytest.approx(found.budgets[0], rel=CALIBRATED)


# ---- results ---------------------------------------------------------------------------------------


def test_a_comparison_is_saved_and_loaded(found: Comparison, tmp_path: Path) -> None:
    found.save(tmp_path / "found.npz")
    again = Comparison.load(tmp_path / "found.npz")
    pd.testing.assert_frame_equal(again.frame(), found.frame())
    assert again.summary() == found.summary()
    assert again.header() == found.header()


def test_the_same_seed_gives_the_same_figures(market: tuple[MarkowitzProblem, Prior]) -> None:
    moves: list[tuple[int, int]] = []
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1, 5), draws=20)
    names = some(("PDM", "rate-distortion", "coin", "Dirichlet noise", "rounding"), 2)
    found, again = (
        compare(
            *market,
            settings,
            makers=makers_of(names),
            rng=np.random.default_rng(1),
            progress=lambda *move: moves.append(move),
        )
        for _ in range(2)
    )
    pd.testing.assert_frame_equal(again.frame(), found.frame())
    assert moves == 2 * [(done + 1, len(found.rows)) for done in range(len(found.rows))]


def test_the_sentence_names_who_holds(found: Comparison) -> None:
    for part in ("naive observer", "aware observer, who knows the rule and the prior", "sees 20 decisions"):
        assert part in found.summary()
    for part in (f"{found.n_beliefs} beliefs", "bits", "candidate", "silence regret"):
        assert part in found.header()


def test_an_unknown_name_is_refused(found: Comparison) -> None:
    with pytest.raises(InputError, match="no decision maker 'XDM'"):
        found.of("XDM")


# ---- files and pictures ----------------------------------------------------------------------------


def test_files_are_readable_and_repeatable(found: Comparison, tmp_path: Path) -> None:
    with nullcontext() if audited() else nothing_painted():
        written = write_comparison(found, tmp_path / "one", title="A small market")
        write_comparison(found, tmp_path / "two", title="A small market")
    names = {path.name for path in written}
    wanted = {"comparison.csv", "comparison.md", "comparison.png", "comparison.svg", "comparison.npz", "summary.json"}
    assert names == wanted == {path.name for path in (tmp_path / "one").iterdir()}
    for path in written:
        if path.suffix != ".npz":  # a zip file carries the time of day
            assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes(), path.name
    table = pd.read_csv(tmp_path / "one" / "comparison.csv")
    pd.testing.assert_frame_equal(table, found.frame())
    summary = json.loads((tmp_path / "one" / "summary.json").read_text("utf-8"))
    assert summary["sentence"] == found.summary()
    assert len(summary["rows"]) == len(found.rows)
    assert Comparison.load(tmp_path / "one" / "comparison.npz").makers == found.makers


def test_markdown_has_a_whole_table_for_every_budget(found: Comparison) -> None:
    text = markdown_of(found, "A small market")
    tables = [block for block in text.split("\n\n") if block.startswith("| decision maker")]
    assert len(tables) == len(found.budgets)
    for block in tables:
        lines = block.split("\n")
        assert len(lines) == 2 + len(found.makers)
        assert len({line.replace("\\|", "").count("|") for line in lines}) == 1
    assert found.summary() in text


def test_the_terminal_table_is_narrow(found: Comparison) -> None:
    table = terminal_table(found, found.budgets[0])
    width = sum(2 + max(len(part) for part in str(title).split("\n")) for title in table.columns)
    assert width + max(map(len, table.index)) < 150
    assert list(table.index) == list(found.makers)


@pytest.fixture
def kept(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Collect figures instead of writing them."""
    figures: list[Any] = []
    monkeypatch.setattr(comparison_plots, "save_figure", lambda figure, *_: figures.append(figure) or [])
    return figures


def test_panels_show_every_observer_and_the_main_makers(found: Comparison, kept: list[Any]) -> None:
    draw_comparison(found, Path())
    axes = [axis for axis in kept[0].axes if axis.get_visible()]
    assert len(axes) == 1 + len(found.repeats)
    assert [axis.get_title(loc="left") for axis in axes][1:] == [
        "aware observer, one decision",
        "aware observer, 20 decisions on one belief",
    ]
    assert len(comparison_plots.main_makers(found)) <= 6
    for place, axis in enumerate(axes):
        lines = {line.get_label(): line for line in axis.get_lines()}
        assert set(lines) == {*map(spelled, comparison_plots.main_makers(found)), "without decisions"}
        np.testing.assert_allclose(lines["without decisions"].get_ydata(), found.prior_error)
        for maker in comparison_plots.main_makers(found):
            rows = found.of(maker)
            wanted = [row.naive_error if place == 0 else row.repeated_errors[place - 1] for row in rows]
            np.testing.assert_allclose(lines[spelled(maker)].get_ydata(), wanted)
            np.testing.assert_allclose(lines[spelled(maker)].get_xdata(), [100 * row.silence_share for row in rows])


def test_a_budget_of_nothing_is_not_drawn_on_an_axis_of_rounding(found: Comparison, kept: list[Any]) -> None:
    rows = tuple(replace(row, budget=0.0, expected_regret=1e-19) for row in found.rows[: len(found.makers)])
    draw_comparison(replace(found, rows=rows, budgets=(0.0,)), Path())
    for axis in kept[0].axes:
        assert axis.get_xlim() == (0.0, 1.0) or not axis.get_visible()


def test_optimal_decisions_alone_are_not_drawn_on_an_axis_of_rounding(found: Comparison, kept: list[Any]) -> None:
    draw_comparison(replace(found, rows=found.of("ODM")), Path())
    assert {axis.get_xlim() for axis in kept[0].axes if axis.get_visible()} == {(0.0, 1.0)}


def test_nothing_overlaps_in_the_picture(found: Comparison, kept: list[Any]) -> None:
    draw_comparison(found, Path())
    figure = kept[0]
    figure.draw_without_rendering()
    (legend,) = figure.legends
    boxes = [axis.get_tightbbox() for axis in figure.axes if axis.get_visible()] + [legend.get_window_extent()]
    for i, one in enumerate(boxes):
        for other in boxes[i + 1 :]:
            assert not one.shrunk(0.98, 0.98).overlaps(other.shrunk(0.98, 0.98))


def test_a_comparison_without_silence_regret_is_drawn(alone: Comparison, tmp_path: Path) -> None:
    assert all(path.stat().st_size > 5_000 for path in draw_comparison(alone, tmp_path))


# ---- the verb --------------------------------------------------------------------------------------


@pytest.mark.usefixtures("undrawn")
def test_the_verb_writes_and_says_what_it_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "out"
    few = ",".join(some(["CDM", "rate-distortion", "coin", "rounding"], 2))
    arguments = ["compare", "--resolution", "3", "--budgets", "silence:0.5", "--makers", few, "--out", str(folder)]
    assert cli.main(arguments) == 0
    said = capsys.readouterr()
    assert "Hidden from the aware observer" in said.out
    assert "comparison.csv" in said.out
    assert "What the columns mean" in said.out
    assert "Decision makers at budgets" in said.err
    assert cli.main([*arguments, "--json", "-q"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    assert json.loads(said.out) == json.loads((folder / "summary.json").read_text("utf-8"))
    assert json.loads(said.out)["n_beliefs"] == 10


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--budgets", "x"], cli.USAGE),
        (["--budgets", "silent:0.5"], cli.USAGE),
        (["--budgets", ":0.5"], cli.USAGE),
        (["--budgets", "0.5,0.1"], 3),
        (["--seed", "-1"], cli.USAGE),
        (["--resolution", "0"], 3),
        (["--resolution", "x"], cli.USAGE),
        (["--resolution", "30.7"], cli.USAGE),
        (["--resolution", "500"], 3),
        (["--market", "nowhere.json"], 3),
        (["--unknown"], cli.USAGE),
    ],
)
def test_wrong_flags_end_with_one_message(
    arguments: list[str], code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["compare", "--out", str(tmp_path / "out"), *arguments]) == code
    said = capsys.readouterr()
    assert said.out == ""
    assert "inscrutable: " in said.err
    assert "Traceback" not in said.err
    assert "--market" not in arguments or "expected 'paper', 'returns' or the model.json" in said.err


def test_help_gives_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["compare", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "Example: inscrutable compare" in said
    for option in ("--market", "--budgets", "--resolution", "--out", "--seed", "--json", "-q"):
        assert option in said


def test_the_papers_market_is_drawn_by_its_seed() -> None:
    one, other, again = (market_of("paper", 4, seed).problem for seed in (0, 1, 0))
    assert np.array_equal(one.means, again.means)
    assert not np.array_equal(one.means, other.means)


def test_limits_hold_in_a_comparison(tmp_path: Path) -> None:
    own = """
[regimes]
names = ["calm", "rough"]
assets = ["A", "B", "C"]
transition = [[0.9, 0.1], [0.2, 0.8]]
means = [[0.01, 0.02, 0.0], [-0.02, 0.0, 0.01]]
covariances = [[[0.002, 0, 0], [0, 0.003, 0], [0, 0, 0.001]], [[0.006, 0, 0], [0, 0.009, 0], [0, 0, 0.002]]]
[constraints]
max_weight = 0.9
"""
    (tmp_path / "own.toml").write_text(own)
    limits = LimitsPart(max_weight=0.4, min_weight=0.1)
    for name in ("paper", str(tmp_path / "own.toml")):
        free, found = (market_of(name, 4, 0, each) for each in (LimitsPart(), limits))
        played = found.problem.solve(found.prior.beliefs)
        assert played.max() == pytest.approx(0.4)
        assert played.min() >= 0.1 - 1e-9
        assert np.array_equal(found.problem.means, free.problem.means)
        assert np.array_equal(found.prior.beliefs, free.prior.beliefs)
        assert free.problem.solve(free.prior.beliefs).max() > 0.4
        with pytest.raises(InputError, match="leave turnover out"):
            market_of(name, 4, 0, LimitsPart(turnover=0.2))
    (tmp_path / "own.toml").write_text(own + "turnover = 0.3\n")
    with pytest.raises(InputError, match="leave turnover out"):
        market_of(str(tmp_path / "own.toml"), 4, 0)
    plan = {"kind": "comparison", "name": "c", "limits": {"max_weight": 0.4}}
    for given in (plan, {key: value for key, value in plan.items() if key != "limits"}):
        file = Study.of(given).plan
        assert isinstance(file, ComparisonFile)
        assert compared_pairs(file).task(0).parameters.get("limits") == given.get("limits")


def test_budgets_above_silence_are_named(market: tuple[MarkowitzProblem, Prior]) -> None:
    makers = {"open": lambda *_: Behaviour(some_mechanism(*market, 3))}
    settings = ComparisonSettings(budgets=(0.5, 25.0), repeats=(1,), draws=10)
    found = compare(*market, settings, makers=makers, rng=np.random.default_rng(0))
    said = [line for line in found.summary().splitlines() if line.startswith("Caution")]
    assert said == [
        "Caution: a budget of 2500% of the silence regret is more than a constant decision costs (25 per cent are written "
        "silence:25%)."
    ]


def test_a_row_does_not_depend_on_the_others_that_are_compared() -> None:
    """Neither on which rules there are, nor on their order, nor on other budgets."""
    problem, prior = FiniteProblem(1.0 - np.eye(2)), uniform_prior(2, 4)

    def rows(names: list[str], budgets: tuple[float, ...]) -> dict[tuple[str, float], str]:
        settings = ComparisonSettings(budgets=budgets, repeats=(1, 3), draws=20)
        made = makers_of(names, Setting.of(problem, prior, None))
        found = compare(problem, prior, settings, makers=made, rng=np.random.default_rng(3))
        return {(row.maker, row.budget): repr(vars(row)) for row in found.rows}

    alone = rows(["coin"], (0.5,))
    for names, budgets in ((["ODM", "CDM", "coin"], (0.5,)), (["coin", "CDM"], (0.2, 0.5))):
        found = rows(names, budgets)
        assert len(found) > len(alone)
        assert {key: found[key] for key in alone} == alone
