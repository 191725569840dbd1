"""Observers of whole paths of decisions in a comparison: by enumerated paths, by plain programmes, and where there are none."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from inscrutable import (
    Budget,
    DelayedDecisionMaker,
    FiniteProblem,
    MarkowitzProblem,
    Mechanism,
    OriginalDecisionMaker,
    PartialDecisionMaker,
    Prior,
    RoundingDecisionMaker,
    UniformDecisionMaker,
    consistent_beliefs,
    decoy_grid,
    leakage,
    uniform_prior,
)
from inscrutable.adversaries.cost_family import ExplainedDecisions
from inscrutable.experiments import comparison_watchers
from inscrutable.experiments.comparison import COMPARED, Comparison, ComparisonSettings, compare, makers_of
from inscrutable.experiments.comparison_sensor import sensor_error
from inscrutable.experiments.comparison_watchers import followed, learned, learned_cost, watched
from inscrutable.experiments.memory_rules import LONGEST_DELAY, PAST, delayed, partly
from inscrutable.experiments.random_markets import random_market
from inscrutable.experiments.setting import Behaviour, Setting, behaviour_of
from inscrutable.mechanisms.calendars import Schedule
from inscrutable.mechanisms.chains import BeliefChain, resting_chain
from inscrutable.mechanisms.joint import joint_law
from inscrutable.reports import comparison_plots
from inscrutable.reports.comparison import notes_of, short_table, terminal_table
from inscrutable.reports.names import spelled
from inscrutable.reports.page.comparison_page import comparison_content, page_data
from oracles.chain_paths import every_path
from strategies import uneven_chain

EVERY_MAKER = makers_of(COMPARED)


def market(seed: int = 3) -> MarkowitzProblem:
    return random_market(rng=np.random.default_rng(seed)).problem


def some_mechanism(chain: BeliefChain, n_actions: int = 3, seed: int = 1) -> Mechanism:
    rng = np.random.default_rng(seed)
    table = rng.dirichlet(np.full(n_actions, 0.6), size=len(chain.prior))
    return Mechanism(chain.prior.beliefs, rng.normal(size=(n_actions, 2)), table, np.zeros_like(table))


def setting_of(chain: BeliefChain, problem: MarkowitzProblem | None = None) -> Setting:
    problem = market() if problem is None else problem
    return Setting(problem, chain.prior, decoy_grid(problem, 3), chain)


def hidden(chain: BeliefChain, played: Mechanism, seen: tuple[int, ...], n_late: int) -> tuple[float, float, float]:
    """Of the belief `n_late` steps after the last decision: expected square error, the decisions' probability, naming."""
    beliefs, table = chain.prior.beliefs, np.asarray(played.probabilities)
    law = np.zeros(len(beliefs))
    for path, chance in every_path(chain, len(seen) + n_late):
        for place, column in zip(path, seen, strict=False):
            chance *= table[place, column]
        law[path[-1]] += chance
    total = float(law.sum())
    mean = sum(law[b] * beliefs[b] for b in range(len(beliefs))) / total
    error = sum(law[b] * float(((beliefs[b] - mean) ** 2).sum()) for b in range(len(beliefs))) / total
    named = max(
        sum(law[b] for b in range(len(beliefs)) if beliefs[b, i] == beliefs[b].max()) for i in range(beliefs.shape[1])
    )
    return error, total, named / total


# ---- over time ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("n_late", [0, 2])
def test_what_is_followed_equals_every_path(n_late: int) -> None:
    chain = uneven_chain()
    played = some_mechanism(chain)
    sequences = list(product(range(3), repeat=3))
    over_time, alone, named, surprise = followed(chain, played, np.array(sequences).T, Schedule(lag=n_late))
    for d, seen in enumerate(sequences):
        for t in range(3):
            error, chance, naming = hidden(chain, played, seen[: t + 1], n_late)
            before = hidden(chain, played, seen[:t], n_late)[1] if t else 1.0
            assert surprise[t, d] == pytest.approx(-np.log2(chance / before), abs=1e-12)
            assert over_time[t, d] == pytest.approx(error, abs=1e-12)
            assert named[t, d] == pytest.approx(naming, abs=1e-12)
            assert alone[t, d] == pytest.approx(hidden(chain, played, seen[t : t + 1], n_late)[0], abs=1e-12)


@pytest.mark.parametrize(("lag", "period"), [(0, 1), (1, 1), (2, 2)])
def test_what_is_followed_beside_a_public_symbol_equals_every_path(lag: int, period: int) -> None:
    chain, rng = uneven_chain(), np.random.default_rng(5)
    share = rng.uniform(0.1, 0.9, size=(3, 3))
    tables = [chain.transition.toarray() * each for each in (share, 1 - share)]
    read_by = BeliefChain(chain.prior, chain.transition, tables)
    played, schedule = some_mechanism(chain), Schedule(period, 0, lag)
    cases = list(product(product(range(3), repeat=3), product(range(2), repeat=3 + lag)))
    columns, read = (np.array([case[k] for case in cases]).T for k in (0, 1))
    over_time, _, named, _ = followed(read_by, played, columns, schedule, read)
    beliefs, own, weights = chain.prior.beliefs, np.asarray(played.probabilities), chain.prior.weights
    for d in rng.choice(len(cases), size=20, replace=False):
        for t in range(3):
            law = np.zeros(3)
            for path in product(range(3), repeat=t + lag + 2):  # from a step before the first decision
                chance = weights[path[0]]
                for s in range(t + lag + 1):
                    chance *= tables[read[s, d]][path[s], path[s + 1]]
                    chance *= own[path[s + 1], columns[s, d]] if s <= t and s % period == 0 else 1.0
                law[path[-1]] += chance
            law /= law.sum()
            wanted = sum(law[b] * ((beliefs[b] - law @ beliefs) ** 2).sum() for b in range(3))
            assert over_time[t, d] == pytest.approx(wanted, abs=1e-12)
            top = beliefs == beliefs.max(axis=1, keepdims=True)
            assert named[t, d] == pytest.approx((law @ top).max(), abs=1e-12)


def test_the_error_over_time_is_that_of_all_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparison_watchers, "PATH_STEPS", 3)
    monkeypatch.setattr(comparison_watchers, "N_PATHS", 4000)
    chain = resting_chain(uneven_chain().prior, 0.9)
    played = some_mechanism(chain)
    bayes = leakage(played, chain.prior).bayes_error
    found = watched(setting_of(chain), Behaviour(played), bayes, np.random.default_rng(0))
    squared = [0.0, 0.0, 0.0]
    for t in range(3):
        for seen in product(range(3), repeat=t + 1):
            error, chance, _ = hidden(chain, played, seen, 0)
            squared[t] += chance * error
    assert squared[0] == pytest.approx(bayes**2)
    wanted = np.sqrt((squared[1] + squared[2]) / 2)  # the later half
    assert 0 < found.error_se < 0.002
    assert abs(found.error - wanted) <= 5 * found.error_se
    table = np.asarray(played.probabilities)
    own = float(chain.prior.weights @ -(table * np.log2(table)).sum(axis=1))
    told = [
        -sum(
            chance * np.log2(chance)
            for chance in (hidden(chain, played, seen, 0)[1] for seen in product(range(3), repeat=n))
        )
        for n in (1, 2, 3)
    ]
    assert abs(found.bits - ((told[2] - told[0]) / 2 - own)) <= 5 * found.bits_se
    assert 0 < found.bits_se < 0.01
    assert wanted < bayes - 0.01


def test_rules_with_a_memory_are_read_backwards_first() -> None:
    stay, prior = 0.7, uniform_prior(3, 5)
    setting = setting_of(resting_chain(prior, stay))
    honest = behaviour_of(setting, OriginalDecisionMaker(setting.problem))
    if leakage(honest.mechanism, prior).bayes_error > 1e-9:
        pytest.skip("the closed form needs a decision of its own for every belief")
    apart = float(np.mean([[setting.problem.regret(b, u) for b in prior.beliefs] for u in honest.mechanism.actions]))
    late = delayed(setting, 1.0001 * (1 - stay**2) * apart)
    assert late is not None
    assert late.memory is not None
    assert late.strength == 2
    for play, left in ((honest, 0.0), (late, prior.error * np.sqrt(1 - stay**4)), (partly(setting, 1e-5), 0.0)):
        assert play is not None
        bayes = leakage(play.mechanism if play.memory is None else play.memory(1), prior).bayes_error
        # The law of the belief is known to the last digit after every decision: nothing is left to chance.
        found = watched(setting, play, bayes, np.random.default_rng(0))
        assert found.error == pytest.approx(left, abs=1e-7)
        assert found.error_se == pytest.approx(0.0, abs=1e-7)


def test_paths_are_published_as_the_rules_say() -> None:
    chain = uneven_chain(5)
    setting, path = setting_of(chain), np.array([0, 3, 3, 1, 4, 2, 0])
    beliefs = chain.prior.beliefs[path]
    regret = float(
        chain.prior.weights
        @ chain.lagged(behaviour_of(setting, OriginalDecisionMaker(setting.problem)).mechanism, 1).expected_regrets
    )
    late, part = delayed(setting, 1.0001 * regret), partly(setting, 0.5 * regret)
    assert late is not None
    assert part is not None
    assert late.memory is not None
    assert part.memory is not None
    assert late.strength >= 1
    rules = (
        DelayedDecisionMaker(setting.problem, int(late.strength)),
        PartialDecisionMaker(setting.problem, part.strength),
    )
    for play, rule in zip((late, part), rules, strict=True):
        assert play.memory is not None
        np.testing.assert_allclose(play.memory.published(path), rule.decide_many(beliefs).action, atol=1e-12)


def test_sampled_paths_have_the_law_of_the_chain() -> None:
    chain, n_draws = uneven_chain(), 20_000
    found = chain.paths(3, n_draws, rng=np.random.default_rng(0))
    for path, chance in every_path(chain, 3):
        share = float((np.array(path) == found.T).all(axis=1).mean())
        assert abs(share - chance) <= 5 * np.sqrt(chance * (1 - chance) / n_draws) + 1e-12


# ---- who learns the cost --------------------------------------------------------------------------------


def explained(problem: MarkowitzProblem, gamma: float, action: np.ndarray) -> bool:
    """Whether some belief makes weights optimal: stationarity on held assets, no smaller marginal cost elsewhere."""
    slopes = 2 * gamma * problem.covariances @ action - problem.means  # (X, U)
    held = action > 1e-9
    first = slopes[:, held][:, :1]
    free = slopes[:, ~held] - first
    answer = linprog(
        np.zeros(len(slopes)),
        A_ub=-free.T if free.size else None,
        b_ub=np.zeros(free.shape[1]) if free.size else None,
        A_eq=np.vstack([(slopes[:, held][:, 1:] - first).T * 1e3, np.ones(len(slopes))]),
        b_eq=np.append(np.zeros(held.sum() - 1), 1.0),
        bounds=(0, None),
    )
    return answer.status == 0


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_learned_values_are_those_that_explain_every_decision(seed: int) -> None:
    problem = market(seed)
    beliefs = np.random.default_rng(seed).dirichlet(4 * np.ones(3), size=6)
    actions = problem.solve(beliefs)
    low, high = learned_cost(problem, actions).interval
    assert low <= problem.risk_aversion <= high
    for gamma in np.geomspace(0.5, 50.0, 41):
        inside = low * 1.01 < gamma < high / 1.01
        outside = gamma < low / 1.01 or gamma > high * 1.01
        if inside or outside:
            assert all(explained(problem, gamma, u) for u in actions) == inside


def test_squares_and_programmes_agree() -> None:
    problem, rng = market(1), np.random.default_rng(0)
    drawn = np.vstack([problem.solve(rng.dirichlet(np.ones(3), size=6)), rng.dirichlet(np.ones(3), size=6)])

    def family(gamma: float) -> MarkowitzProblem:
        return MarkowitzProblem(problem.means, problem.covariances, gamma)

    decisions = ExplainedDecisions(family, drawn, 0.0, 1e-10)
    seen = set()
    for low, high in ((5.0, 5.0), (4.0, 4.0), (4.0, 6.0), (5.0, 5.001), (8.0, 12.0)):
        for number in range(len(drawn)):
            programme = decisions.programme(low, high, number)
            residual = programme.residual()
            assert programme.explains(decisions.tolerance) == (residual <= decisions.tolerance)
            seen.add(residual <= decisions.tolerance)
    assert seen == {True, False}


def test_rounded_weights_are_explained_by_nothing() -> None:
    problem, prior = market(0), uniform_prior(3, 6)
    makers = {
        "ODM": EVERY_MAKER["ODM"],
        "it": lambda setting, regret: behaviour_of(setting, RoundingDecisionMaker(setting.problem, 0.1)),
    }
    found = compare(
        problem, prior, ComparisonSettings(budgets=(0.5,), repeats=(1,)), makers=makers, rng=np.random.default_rng(0)
    )
    (rounded,), (honest,) = found.of("it"), found.of("ODM")
    assert (rounded.learned_holds, honest.learned_holds) == (0.0, 1.0)
    assert all(np.isnan(each) for each in (rounded.learned_low, rounded.learned_high, rounded.learned_error))
    assert honest.learned_low <= problem.risk_aversion <= honest.learned_high
    told = short_table(found)["risk aversion learned"]
    assert told["it"] == "none explains all"
    assert short_table(found)["error, cost learned"]["it"] == "-"
    # On another market what is rounded is explained, by other values than the true one.
    found = compare(
        market(3), prior, ComparisonSettings(budgets=(0.5,), repeats=(1,)), makers=makers, rng=np.random.default_rng(0)
    )
    (misled,) = found.of("it")
    assert misled.learned_holds == 0.0
    assert misled.learned_high < market(3).risk_aversion
    assert misled.learned_error > misled.naive_error
    assert short_table(found)["risk aversion learned"]["it"].endswith("wrong")


def test_who_learned_reads_with_the_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, prior = market(1), uniform_prior(3, 4)
    monkeypatch.setattr(comparison_watchers, "PATH_STEPS", 2)  # too few to know the risk aversion by
    makers = {"ODM": EVERY_MAKER["ODM"]}
    found = compare(
        problem, prior, ComparisonSettings(budgets=(0.5,), repeats=(1,)), makers=makers, rng=np.random.default_rng(0)
    )
    (row,) = found.of("ODM")
    assert row.learned_low < 0.99 * row.learned_high
    believed = MarkowitzProblem(problem.means, problem.covariances, 0.5 * (row.learned_low + row.learned_high))
    squared = 0.0
    for belief, weight in zip(prior.beliefs, prior.weights, strict=True):
        action = problem.solve(belief)
        read = consistent_beliefs(believed, action)
        if read.is_empty:
            guess = min(prior.beliefs, key=lambda other: float(believed.regret(other, action)))
        else:
            guess = read.vertices().mean(axis=0)
        squared += weight * float(((belief - guess) ** 2).sum())
    assert row.learned_error == pytest.approx(np.sqrt(squared), abs=1e-6)
    assert row.learned_error > row.naive_error + 0.01


@pytest.mark.parametrize("maker", ["delay", "partial trades"])
def test_the_cost_is_learned_from_one_who_began_long_ago(maker: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """At its start a long delay repeats one decision, and a partial trade is whole; neither lasts."""
    learned_from: list[np.ndarray] = []

    def kept(problem: MarkowitzProblem, actions: np.ndarray) -> Any:
        learned_from.append(actions)
        return learned_cost(problem, actions)

    monkeypatch.setattr(comparison_watchers, "learned_cost", kept)
    setting = setting_of(resting_chain(uneven_chain(6).prior, 0.7))
    play = EVERY_MAKER[maker](setting, 10.0 if maker == "delay" else 3e-4)
    assert play is not None
    assert maker == "partial trades" or play.strength == LONGEST_DELAY
    assert maker == "delay" or 0 < play.strength < 1
    learned(setting, play, joint_law(play.mechanism, setting.prior), 0.0, np.random.default_rng(0))
    (published,) = learned_from
    assert len(published) == comparison_watchers.PATH_STEPS
    optimal = setting.problem.solve(setting.prior.beliefs)
    known = np.array([np.abs(optimal - each).max(axis=1).min() < 1e-9 for each in published])
    if maker == "delay":
        assert known.all()
        assert len(np.unique(published.round(9), axis=0)) > 1
    else:
        assert not known.any()


def test_what_is_not_scaled_down_to_a_tiny_budget_is_not_played() -> None:
    setting = setting_of(resting_chain(uniform_prior(3, 3), 0.8))
    for regret in (0.0, 1e-12):
        for name in ("rounding", "delay", "partial trades"):
            play = EVERY_MAKER[name](setting, regret)
            assert play is not None
            assert setting.prior.weights @ play.mechanism.expected_regrets <= 1.01 * regret + 1e-15
            assert name == "rounding" or play.strength == (0.0 if name == "delay" else pytest.approx(1.0))


def test_a_fraction_of_a_trade_is_one_that_a_past_can_be_sampled_for() -> None:
    play = partly(setting_of(resting_chain(uniform_prior(3, 3), 1.0)), 1e-3)  # nothing ever moves, nothing can be spent
    assert play is not None
    assert play.strength >= 1 / PAST


# ---- in a comparison ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def moving() -> Comparison:
    prior = uniform_prior(3, 4)
    makers = {
        **makers_of(("ODM", "CDM, candidates only", "rate-distortion", "coin", "delay", "partial trades")),
    }
    settings = ComparisonSettings(budgets=(0.5, 1.0), repeats=(1, 10), draws=50)
    return compare(market(), resting_chain(prior, 0.8), settings, makers=makers, rng=np.random.default_rng(0))


def test_who_sees_more_errs_less(moving: Comparison) -> None:
    for row in moving.rows:
        assert row.path_error <= row.bayes_error + 3 * row.path_error_se + 1e-7
        assert row.path_error <= moving.prior_error + 1e-9
        assert row.learned_holds in (0.0, 1.0)
        if row.learned_holds and row.learned_high / row.learned_low < 1 + 1e-7:
            assert row.learned_error == row.naive_error
    (coin,) = (row for row in moving.of("coin") if row.budget == moving.budgets[0])
    assert coin.repeated_errors[1] < coin.path_error < coin.bayes_error


def test_reports_show_both_observers(moving: Comparison) -> None:
    table = short_table(moving)
    for title in ("error, aware, over time", "error, cost learned", "risk aversion learned"):
        assert title in table.columns
    row = moving.of("rate-distortion")[0]
    assert table["error, aware, over time"]["rate-distortion"].iloc[0] == f"{row.path_error:.3f}"
    assert "aware observer over time" in moving.summary()
    assert "aware observer, who sees 10 decisions on one belief" in moving.summary()
    notes = " ".join(notes_of(moving))
    assert "paths of 40 decisions" in notes
    for column in table.columns:  # every column is explained where the table is
        for word in column.replace(",", "").replace("%", "").split():
            assert word in notes, column
    assert "cost learned: does not know the risk aversion" in notes
    assert any(str(title).startswith("error,\naware") for title in terminal_table(moving, moving.budgets[0]).columns)
    shown = page_data(moving)["rows"]["rate-distortion"][0]
    assert shown["aware"][-1] == pytest.approx(row.path_error, abs=1e-4)
    assert shown["se"][-1] == pytest.approx(row.path_error_se, abs=1e-4)
    slider = comparison_content(moving, None, {}).sliders[1]
    assert len(slider.texts) == len(shown["aware"]) == 3
    frame = moving.frame()
    for name in ("path_error", "path_error_se", "learned_low", "learned_high", "learned_holds", "learned_error"):
        assert frame[name].notna().any()


def test_the_picture_shows_the_observer_over_time(moving: Comparison, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Any] = []
    monkeypatch.setattr(comparison_plots, "save_figure", lambda figure, *_: figures.append(figure) or [])
    comparison_plots.draw_comparison(moving, Path())
    shown = [axis for axis in figures[0].axes if axis.get_visible()]
    assert len(shown) == 2 + len(moving.repeats)
    assert shown[-1].get_title(loc="left") == "aware observer, over time"
    lines = {line.get_label(): line for line in shown[-1].get_lines()}
    for maker in comparison_plots.main_makers(moving):
        np.testing.assert_allclose(lines[spelled(maker)].get_ydata(), [row.path_error for row in moving.of(maker)])


def test_observers_that_cannot_be_are_told_of() -> None:
    problem, prior = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), uniform_prior(2, 4)
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1,), draws=10)
    still = compare(problem, prior, settings, makers={"coin": EVERY_MAKER["coin"]}, rng=np.random.default_rng(0))
    (row,) = still.rows
    for name in ("path_error", "learned_low", "learned_holds", "learned_error"):
        assert np.isnan(getattr(row, name))
    assert "risk aversion learned" not in short_table(still).columns
    assert "over time" not in still.summary()
    notes = " ".join(notes_of(still))
    assert "no chain of beliefs is given" in notes
    assert "the cost has none" in notes
    moved = compare(
        problem, resting_chain(prior, 0.5), settings, makers={"coin": EVERY_MAKER["coin"]}, rng=np.random.default_rng(0)
    )
    assert moved.is_moving
    assert not moved.is_learned


def test_the_sensor_is_read_exactly_from_optimal_decisions_and_not_from_constant_ones() -> None:
    setting = Setting.of(market(0), resting_chain(uniform_prior(3, 6), 0.8))
    rng = np.random.default_rng(0)
    assert all(consistent_beliefs(setting.problem, each).dimension == 0 for each in setting.optimal.actions)
    assert sensor_error(setting, behaviour_of(setting, OriginalDecisionMaker(setting.problem)), rng) <= 1e-8
    beliefs = setting.prior.beliefs
    action = setting.problem.solve(setting.prior.mean)
    silent = Mechanism(beliefs, action[None], np.ones((len(beliefs), 1)), np.ones((len(beliefs), 1)))
    assert sensor_error(setting, Behaviour(silent), rng) > 0.5


def test_the_verdict_tells_how_well_the_sensor_is_read() -> None:
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1,), draws=10)
    chain = resting_chain(uniform_prior(3, 4), 0.8)
    makers = makers_of(("ODM", "rate-distortion"))
    found = compare(market(), chain, settings, makers=makers, rng=np.random.default_rng(0))
    read = found.of("ODM")[0].sensor_error
    assert f"error from {read:.2f} (ODM)" in found.sensor_summary()
    assert found.sensor_summary() in found.summary()
    assert short_table(found).loc["ODM", "error, sensor"] == f"{read:.2f}"
    assert any(note.startswith("error, sensor") for note in notes_of(found))
    hidden = compare(
        market(),
        chain,
        ComparisonSettings(budgets=(0.5,), repeats=(1,), draws=10, disclosure="every(2)"),
        makers=makers,
        rng=np.random.default_rng(0),
    )
    assert not hidden.sensor_summary()


def test_silence_is_among_the_candidates_that_bound_every_rule(fresh_rng: np.random.Generator) -> None:
    """Few decoys miss the best constant decision, which the coin plays: it left a larger error than the bound."""
    problem = MarkowitzProblem(0.02 * fresh_rng.normal(size=(2, 3)), [0.01 * np.eye(3), 0.02 * np.eye(3)], 5.0)
    setting = Setting.of(problem, Prior(fresh_rng.dirichlet([1.0, 1.0], size=3), fresh_rng.dirichlet(np.ones(3))))
    least = float((setting.candidates.state_costs @ setting.prior.mean).min())
    constant = least - float(setting.prior.weights @ setting.optimal_costs)
    assert constant == pytest.approx(setting.silence_regret, abs=1e-12)
    finite = Setting.of(FiniteProblem(1.0 - np.eye(3)), uniform_prior(3, 4))  # silence is among the decoys' choices
    uniform = UniformDecisionMaker(finite.problem, Budget.regret(1.0), candidates=finite.candidates)
    assert uniform.decide([0.5, 0.3, 0.2]).probabilities == pytest.approx([1 / 3] * 3)


@pytest.mark.parametrize(("disclosure", "is_judged"), [("exact", True), ("every(6)|delayed(6)", False)])
def test_what_optimal_decisions_hide_already_is_no_rules_merit(disclosure: str, is_judged: bool) -> None:
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1,), draws=10, disclosure=disclosure)
    makers = makers_of(("ODM", "coin"))
    found = compare(
        market(), resting_chain(uniform_prior(3, 4), 0.8), settings, makers=makers, rng=np.random.default_rng(0)
    )
    first, *lines = found.summary().splitlines()
    (line,) = (each for each in lines if each.startswith("Hidden from the aware observer over time"))
    assert ("cannot be judged, as without protection" in line) is not is_judged
    assert first.endswith("hiding the belief from the aware observer over time cannot be judged.") is not is_judged
    assert ("from the aware observer over time by none" in first) is is_judged
    assert "from the naive observer by none" in first


def test_one_decision_alone_hides_from_everybody() -> None:
    problem = MarkowitzProblem([[0.008], [-0.02]], [[[0.002]], [[0.008]]], 5.0)  # one asset: all of it, always
    makers = makers_of(("ODM", "coin"))
    found = compare(problem, uniform_prior(2, 4), makers=makers, rng=np.random.default_rng(0))
    first, *lines = found.summary().splitlines()
    assert "the belief is hidden" not in first
    assert first.count("cannot be judged") == 1
    assert [("as without protection it is hidden as well" in each) for each in lines[:3]] == [True] * 3
