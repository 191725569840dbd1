"""When a belief is hidden: two parts, one definition, in every verb and on every page."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from inscrutable import GaussianEmission, HiddenMarkovModel, InputError, MarkowitzProblem, simplex
from inscrutable.experiments.attack import attack_weights
from inscrutable.experiments.attack_judged import judge_attack
from inscrutable.experiments.backtest import Backtest, BacktestSettings, run_backtest
from inscrutable.experiments.holding import Reached, Requirement, StateRanking, best_ranking, estimate_quality
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.experiments.protect import protect
from inscrutable.reports.backtest_verdict import cautions, limits, verdict


@pytest.fixture(scope="module")
def found() -> Backtest:
    draw = np.random.default_rng(0)
    spread = np.repeat([0.01, 0.05, 0.02, 0.06], 20)[:, None]
    months = pd.date_range("2001-01", periods=80, freq="ME")
    returns = pd.DataFrame(0.01 + spread * draw.normal(size=(80, 2)), index=months, columns=["A", "B"])
    return run_backtest(returns, BacktestSettings(regimes=2, train_until="2006-06", sequential=False), restarts=2)


def with_figures(found: Backtest, **given: float) -> Backtest:
    """The backtest with other figures of all its decision makers."""
    changed = replace(found)
    changed.__dict__["figures"] = {name: {**found.figures[name], **given} for name in found.names}
    return changed


def line_of(found: Backtest, part: str) -> str:
    """The line of the verdict that holds some words."""
    return next(each for each in verdict(found) if part in each)


def test_both_parts_are_needed(fresh_rng: np.random.Generator) -> None:
    for _ in range(200):
        without, chance = fresh_rng.uniform(0.1, 1.4), fresh_rng.uniform(0.2, 1.0)
        asked = Requirement(without, chance)
        error, named = fresh_rng.uniform(0.0, 1.4), fresh_rng.uniform()
        both = error >= without * 2 / 3 and named <= chance + (1 - chance) / 3
        assert asked.is_met(Reached("CDM", error, named)) == both
        assert (asked.judge([Reached("CDM", error, named)])[:6] == "by CDM") == both


def test_a_rival_who_names_the_regime_nearly_always_is_not_held_off(found: Backtest) -> None:
    """Far from the belief, but right in 95 % of the months where chance is right in 61 %."""
    figures = with_figures(found, error_without=0.5, base_rate=0.61, error_face_value=0.6, share_regime_named=0.95)
    at_face_value = line_of(figures, "at face value")
    assert "at face value: by none of" in at_face_value
    assert "(error 0.60, named 95% > 74%)" in at_face_value  # what was reached
    asked = "\n".join(limits(figures))
    assert re.search(r"at least 0\.33 .* 0\.50, .* at most 74% of months .* chance, 61%", asked)


def test_an_estimate_half_as_wrong_is_not_held_off(found: Backtest) -> None:
    figures = with_figures(found, error_without=0.5, base_rate=0.5, error_face_value=0.3, share_regime_named=0.6)
    assert "at face value: by none of" in line_of(figures, "at face value")


def test_nothing_is_judged_where_unprotected_weights_pass_as_well(found: Backtest) -> None:
    """One regime is nearly always the likeliest: what others reach is not their merit."""
    asked = Requirement(error_without=0.175, chance=0.986)
    unprotected, other = Reached("ODM", 0.561, 0.986), Reached("CDM", 0.3, 0.95)
    told = "cannot be judged, as without protection it is hidden as well, by ODM (error 0.56, named 99%)"
    assert asked.judge([other], unprotected) == told
    assert asked.judge([other], Reached("ODM", 0.1, 0.986)) == asked.judge([other]) == "by CDM (error 0.30, named 95%)"
    given = {"error_without": 0.175, "base_rate": 0.986, "error_face_value": 0.561, "share_regime_named": 0.986}
    figures = with_figures(found, **given, error_followed=0.0, share_regime_named_followed=1.0)
    assert "there is nothing to hide from the naive observer: the optimal weights, without" in verdict(figures)[0]
    assert "at face value: cannot be judged" in line_of(figures, "at face value")
    assert "by none of " in line_of(figures, "aware observer, who knows the rules")
    both = with_figures(found, **given, error_followed=0.3, share_regime_named_followed=0.95)
    assert "nothing to hide from either observer: the optimal weights" in verdict(both)[0]
    passing = {"error_without": 0.3, "base_rate": 0.5, "error_followed": 0.1, "share_regime_named_followed": 0.9}
    naive = with_figures(found, **passing, error_face_value=0.3, share_regime_named=0.6)
    assert (
        "from the naive observer: the optimal weights, without protection, pass for hidden as well" in verdict(naive)[0]
    )


def test_the_best_come_first_and_those_without_an_estimate_are_not_judged() -> None:
    asked = Requirement(0.6, 0.4)
    two = [Reached("A", 0.3, 0.4), Reached("B", 0.5, 0.5)]
    assert asked.judge(two) == "by B (error 0.50, named 50%), not by A (error 0.30 < 0.40, named 40%)"
    several = [Reached("A", 0.5, 0.4), Reached("B", 0.6, 0.4), Reached("C", 0.45, 0.4)]
    told = [f"{name} (error {error}, named 40%)" for name, error in (("B", "0.60"), ("A", "0.50"), ("C", "0.45"))]
    assert asked.judge(several) == f"by {told[0]}, {told[1]} and {told[2]}"
    unread = Reached("D", float("nan"), float("nan"))
    assert asked.judge([several[0], unread]) == f"by {told[1]} (no belief explains any decision of D)"
    assert asked.judge([unread]) == "not known, as no belief explains any decision of D"
    many = [Reached(f"M{k}", 0.1, 0.9) for k in range(6)]
    missed = ", ".join(f"M{k} (error 0.10 < 0.40, named 90% > 60%)" for k in range(3))
    assert asked.judge(many) == f"by none of {missed} and 3 more"


def test_who_is_best_goes_by_the_nearer_of_the_two_bounds() -> None:
    # The way to each bound: of the error .33 and .17, of the naming .03 and .08.
    told = Requirement(0.6, 0.4).judge([Reached("A", 0.6, 0.58), Reached("B", 0.5, 0.55)])
    assert told.index("B (") < told.index("A (")


@pytest.mark.parametrize(("chance", "cases"), [(0.7, 60), (0.1, 10), (0.55, 40), (0.4, 15)])
def test_rounding_decides_no_tie(chance: float, cases: int) -> None:
    """A share of right namings a third of the way from chance to always, as a count of cases, and two thirds of the error."""
    count = round(cases * (chance + (1.0 - chance) / 3.0))
    assert 3 * count / cases == pytest.approx(2 * chance + 1)
    for error in (0.3, 0.55, 0.7):
        asked = Requirement(error, chance)
        assert asked.is_met(Reached("CDM", error * 2.0 / 3.0, count / cases))
        assert ">" not in asked.compare(Reached("CDM", 2.0 * error / 3.0, count / cases))
        assert not asked.is_met(Reached("CDM", error * 0.66, count / cases))
        assert not asked.is_met(Reached("CDM", error, count / cases + 1e-9))


def test_a_figure_that_misses_its_bound_by_little_reads_differently_from_it() -> None:
    asked = Requirement(0.6, 0.4)
    close = Reached("A", 0.3996, 0.6000004)
    assert asked.judge([close]) == "by none of A (error 0.3996 < 0.4000, named 60.00004% > 60.00000%)"


def test_nothing_to_hide_and_certainty_by_chance() -> None:
    assert Requirement(0.0, 1.0).is_met(Reached("CDM", 0.0, 1.0))
    with pytest.raises(InputError, match=r"chance must be a share between 0 and 1, got 1\.2"):
        Requirement(0.5, 1.2)


def test_quality_of_estimates_by_hand() -> None:
    beliefs = np.array([[0.6, 0.4], [0.5, 0.5], [0.1, 0.9]])
    estimates = np.array([[0.2, 0.8], [1.0, 0.0], [np.nan, np.nan]])
    error, named = estimate_quality(estimates, beliefs)
    assert error == pytest.approx(np.sqrt((0.32 + 0.5) / 2))
    assert named == 0.5  # of two likeliest states either is right
    assert np.isnan(estimate_quality(estimates[2:], beliefs[2:])).all()


def test_protect_judges_by_the_same_rule(found: Backtest) -> None:
    model = InvestorModel(found.world, found.problem, found.assets, found.regimes)
    given = np.array([[0.9, 0.1], [0.2, 0.8], [0.3, 0.7]])
    protection = protect(model, given, 0.5, rng=np.random.default_rng(0))
    values, vectors = np.linalg.eig(found.world.transition.T)
    long_run = np.real(vectors[:, np.argmax(np.real(values))])
    long_run /= long_run.sum()
    without = np.sqrt(((long_run - given) ** 2).sum(axis=1).mean())
    chance = np.mean(given.argmax(axis=1) == long_run.argmax())
    centres = np.array([each.center() for each in protection.deterministic.belief_set])
    error = np.sqrt(((centres - given) ** 2).sum(axis=1).mean())
    named = np.mean(given.argmax(axis=1) == centres.argmax(axis=1))
    assert f"CDM (error {error:.2f}, named {named:.0%})" in protection.verdict
    assert f"at least {2 / 3 * without:.2f}" in protection.verdict
    assert f"chance, {chance:.0%}," in protection.verdict


def always_likeliest() -> tuple[InvestorModel, pd.DataFrame]:
    """A model of two regimes, and beliefs under which the same one is the likeliest in all rows."""
    sensor = GaussianEmission([[0.008, 0.012], [-0.02, -0.03]], [0.002 * np.eye(2), 0.008 * np.eye(2)])
    world = HiddenMarkovModel([[0.95, 0.05], [0.2, 0.8]], sensor)
    problem = MarkowitzProblem(sensor.means, sensor.covariances, 5.0, simplex(2))
    calm = np.array([0.82, 0.8, 0.78, 0.76])
    model = InvestorModel(world, problem, ("A", "B"), ("calm", "crisis"))
    return model, pd.DataFrame({"calm": calm, "crisis": 1.0 - calm})


def test_where_naming_tests_nothing_protect_and_attack_say_so_alike() -> None:
    model, given = always_likeliest()
    found = protect(model, given, 0.02, rng=np.random.default_rng(0))
    vacuous = "One regime is the likeliest in all the rows, so naming it tests nothing: the error alone decides."
    assert vacuous in found.verdict
    assert "chance" not in found.verdict
    published = pd.DataFrame(found.deterministic.action, columns=["A", "B"])
    assert vacuous in judge_attack(attack_weights(model, published), given).summary()
    for cases in ("months", "the cases"):
        assert f"in all {cases}, so" in Requirement(0.3, 1.0).meaning(without="it", state="state", cases=cases)


def test_that_the_opposite_is_right_is_said_by_protect_and_attack_alike(found: Backtest) -> None:
    model, given = always_likeliest()
    given["calm"] = [0.7, 0.3, 0.65, 0.35]
    given["crisis"] = 1.0 - given["calm"]
    reached = protect(model, given, 0.3, rng=np.random.default_rng(0))
    centres = np.array([each.center() for each in reached.deterministic.belief_set])
    named = estimate_quality(centres, given.to_numpy()).named
    assert named < 0.25
    told = f"with two regimes, an observer who reads the opposite is right in {1 - named:.0%}."
    assert f"CDM counts as hiding from the naive observer, but {told}" in reached.verdict
    published = pd.DataFrame(reached.deterministic.action, columns=["A", "B"])
    assert told in judge_attack(attack_weights(model, published), given).summary()
    figures = with_figures(found, base_rate=0.5, share_regime_named=named, error_face_value=1.0, error_without=0.5)
    assert f"CDM: {told}" in cautions(figures)
    asked, ranking = Requirement(0.5, 0.5), StateRanking(0, 0.9)
    assert asked.caution(0.5, ranking, model.regimes) == ranking.told(model.regimes, "row")
    assert not asked.caution(0.0, None, ("calm", "dull", "crisis"))


def test_the_best_ranking_is_that_of_all_pairs(fresh_rng: np.random.Generator) -> None:
    for _ in range(60):
        states, cases = int(fresh_rng.integers(2, 5)), int(fresh_rng.integers(2, 30))
        beliefs = fresh_rng.dirichlet(np.full(states, 0.5), cases)
        estimates = fresh_rng.dirichlet(np.ones(states), cases).round(1)  # ties
        estimates[fresh_rng.random(cases) < 0.2] = np.nan
        shares = {}
        for state in range(states):
            pairs = [
                np.sign(estimates[a, state] - estimates[b, state]) / 2 + 0.5
                for a in range(cases)
                for b in range(cases)
                if beliefs[a].argmax() == state != beliefs[b].argmax() and np.isfinite(estimates[[a, b]]).all()
            ]
            if pairs:
                shares[state] = float(np.mean(pairs))
        found = best_ranking(estimates, beliefs)
        assert (found is None) == (not shares)
        if found is not None:
            assert found.share == pytest.approx(max(shares.values()))
            assert shares[found.state] == pytest.approx(found.share)


def test_a_belief_that_is_seldom_named_and_yet_told_is_said_to_be(found: Backtest) -> None:
    """One regime holds nearly always: naming it cannot fail, and an estimate that rises with the other shows when it does."""
    assert found.aware is not None
    calm = np.where(np.arange(len(found.beliefs)) % 10 == 3, 0.2, 0.9)  # calm is likeliest in 9 of 10 months
    beliefs = found.beliefs.copy()
    beliefs.iloc[:] = np.column_stack([calm, 1.0 - calm])
    shrunk = 0.7 + 0.15 * calm
    followed = dict.fromkeys(found.aware.followed, np.column_stack([shrunk, 1.0 - shrunk]))
    shown = replace(found, beliefs=beliefs, aware=replace(found.aware, followed=followed))
    reached = estimate_quality(followed["CDM"], beliefs.to_numpy())
    figures = {"error_followed": reached.error, "share_regime_named_followed": reached.named, "error_without": 0.3}
    figures["error_face_value"] = reached.error
    shown.__dict__["figures"] = with_figures(found, **figures, base_rate=0.9, share_regime_named=1.0).figures
    told = [each for each in cautions(shown) if "counts as hiding from the aware observer, but its estimate" in each]
    assert {each.partition(" ")[0] for each in told} == {"CDM", "PDM"}
    assert all("in 100% of the pairs" in each for each in told)
    poor = with_figures(
        shown, error_face_value=0.0, share_regime_named=1.0
    )  # more than it, and of that nothing is judged
    assert not any("counts as hiding from" in each for each in cautions(poor))
    assert "cannot be judged, as its estimates are poor" in line_of(poor, "aware observer, who knows")
    assert not StateRanking(1, 0.7).told(found.regimes, "month")
