"""An observer who has only data: never below Bayes, near it after many pairs, and absent where nobody asks for it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    BayesianAdversary,
    DataAdversary,
    FiniteProblem,
    InputError,
    LearningCurve,
    MarkowitzProblem,
    Mechanism,
    OriginalDecisionMaker,
    Prior,
    check_adversary,
    compare,
    leakage,
    learning_curve,
    mechanism,
    uniform_prior,
)
from inscrutable.experiments.comparison import COMPARED, ComparisonSettings, makers_of
from inscrutable.experiments.setting import Setting
from inscrutable.experiments.studies import Study, run_study
from inscrutable.reports.comparison import notes_of, short_table
from study_runs import SMALL

pytest.importorskip("sklearn", reason="the learners come with the [audit] extra")

PROBLEM = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
PRIOR = uniform_prior(2, 6)


def drawn(rng: np.random.Generator) -> tuple[Mechanism, Prior]:
    beliefs, kernel = rng.dirichlet(np.ones(3), size=8), rng.dirichlet(np.full(6, 0.3), size=8)
    return Mechanism(beliefs, rng.normal(size=(6, 2)), kernel, np.zeros((8, 6))), Prior(beliefs, np.full(8, 0.125))


def test_its_error_falls_to_bayes_and_never_below(fresh_rng: np.random.Generator) -> None:
    played, prior = drawn(fresh_rng)
    found = learning_curve(played, prior, (20, 4000), rng=fresh_rng, repeats=3)
    joint = prior.weights[:, None] * np.asarray(played.probabilities)
    means = joint.T @ prior.beliefs / joint.sum(axis=0)[:, None]
    apart = ((prior.beliefs[:, None] - means[None]) ** 2).sum(axis=2)
    bayes = np.sqrt((joint * apart).sum())
    assert found.bayes_error == pytest.approx(bayes, abs=1e-12)
    assert (found.errors >= bayes - 1e-12).all()
    assert found.errors[1] <= 1.1 * bayes
    assert found.errors[1] < found.errors[0]
    assert "4,000 pairs" in found.summary()


def test_the_curve_is_saved(tmp_path_factory: pytest.TempPathFactory) -> None:
    found = learning_curve(*drawn(np.random.default_rng(1)), (10,), rng=np.random.default_rng(2), repeats=1)
    assert np.isnan(found.error_se).all()
    file = tmp_path_factory.mktemp("curve") / "curve.npz"
    found.save(file)
    assert LearningCurve.load(file).summary() == found.summary()


def test_pairs_are_drawn_from_the_joint_law(fresh_rng: np.random.Generator) -> None:
    played, prior = drawn(fresh_rng)
    seen = DataAdversary.of(played, prior, 20_000, rng=fresh_rng)
    law = prior.weights @ np.asarray(played.probabilities)
    shares = [(np.abs(seen._points - action).max(axis=1) == 0).mean() for action in np.asarray(played.actions)]
    assert shares == pytest.approx(law, abs=0.02)
    for m in np.flatnonzero(law > 0.05):
        knows = BayesianAdversary(played, prior).estimate(np.asarray(played.actions)[m])
        here = np.abs(seen._points - np.asarray(played.actions)[m]).max(axis=1) == 0
        assert seen._beliefs[here].mean(axis=0) == pytest.approx(knows, abs=0.06)


@pytest.mark.parametrize(
    "problem", [PROBLEM, FiniteProblem([[0.0, 4.0, 3.0], [10.0, 4.0, 5.0]])], ids=["convex", "finite"]
)
def test_it_keeps_the_promises_of_an_adversary(problem: MarkowitzProblem | FiniteProblem) -> None:
    played = mechanism(OriginalDecisionMaker(problem), PRIOR.beliefs)
    check_adversary(DataAdversary.of(played, PRIOR, 200, rng=np.random.default_rng(0)), problem)


def test_what_says_nothing_is_read_as_the_mean() -> None:
    rng = np.random.default_rng(5)
    beliefs = rng.dirichlet(np.ones(3), size=400)
    seen = DataAdversary(beliefs, rng.normal(size=(400, 2)))
    assert seen.learner == "mean"
    assert seen.estimate([0.3, 9.0]) == pytest.approx(beliefs.mean(axis=0), abs=1e-12)
    assert seen.estimates(np.zeros((0, 2))).shape == (0, 3)
    assert "400 pairs" in repr(seen)


@pytest.mark.parametrize(
    ("beliefs", "actions", "message"),
    [
        (np.full((20, 2), 0.4), np.zeros((20, 1)), "sums to"),
        (np.full((20, 2), 0.5), np.zeros((19, 1)), "expected|as many decisions"),
        (np.full((20, 2), 0.5), np.zeros((20, 1, 1)), "as many decisions"),
        (np.full((5, 2), 0.5), np.zeros((5, 1)), "at least 10 pairs"),
        (np.full((20, 2), 0.5), np.full((20, 1), np.nan), "finite"),
    ],
)
def test_bad_pairs_are_refused(beliefs: np.ndarray, actions: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        DataAdversary(beliefs, actions)


def test_bad_decisions_are_refused() -> None:
    seen = DataAdversary(np.full((20, 2), 0.5), np.random.default_rng(0).normal(size=(20, 2)))
    for wrong in ([1.0, 2.0], [[1.0, 2.0, 3.0]]):
        with pytest.raises(InputError, match="shape"):
            seen.estimates(wrong)
    with pytest.raises(InputError, match="at least one number"):
        learning_curve(*drawn(np.random.default_rng(1)), (), rng=np.random.default_rng(2))


@pytest.mark.parametrize("missing", [np.nan, None, pd.NA])
def test_choices_that_are_missing_are_refused(missing: object) -> None:
    """A missing choice was read as one that no pair has."""
    beliefs, choices = np.full((20, 2), 0.5), np.array([1.0, 2.0] * 10, dtype=object)
    seen = DataAdversary(beliefs, choices)
    choices[3] = missing
    with pytest.raises(InputError, match=r"actions has .* at index \[3\]; every choice must be known"):
        DataAdversary(beliefs, choices)
    for wrong in ([1.0, missing], np.array([1.0, missing], dtype=object)):
        with pytest.raises(InputError, match="every choice must be known"):
            seen.estimates(wrong)
    days = np.array(["2024-01-01", "2024-01-02"] * 5 + ["NaT"], dtype="datetime64[D]")
    with pytest.raises(InputError, match=r"NaT at index \[10\]"):
        DataAdversary(np.full((11, 2), 0.5), days)


def test_the_unit_of_decisions_changes_no_estimate() -> None:
    """A tree takes numbers within 1e-7 for equal: of weights of a hundred-millionth it learned nothing."""
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(300, 4))
    likely = np.where(np.abs(weights[:, 3]) < 0.7, 0.9, 0.1)
    beliefs = np.column_stack([likely, 1.0 - likely])
    for scale, shift in ((1.0, 0.0), (1e-9, 0.0), (1e9, 0.0), (1.0, 1e8)):
        seen = scale * weights + shift
        found = DataAdversary(beliefs[:200], seen[:200]).estimates(seen[200:])
        assert np.abs(found - beliefs[200:]).mean() < 0.02, (scale, shift)


@pytest.mark.parametrize("held", [0.1, 0.3, 0.7, 1e6])
def test_a_constant_weight_changes_no_estimate(held: float) -> None:
    """The standard deviation of equal numbers is rounding, by which a query beside them was divided."""
    rng = np.random.default_rng(2)
    shown, asked = rng.normal(size=400), np.linspace(-1.0, 1.0, 9)
    likely = 0.5 + 0.4 * np.cos(3.0 * shown)
    beliefs = np.column_stack([likely, 1.0 - likely])
    plain, other = (DataAdversary(beliefs, np.column_stack([shown, np.full(400, each)])) for each in (0.0, held))
    assert plain.learner == other.learner == "nearest neighbours"
    wanted = plain.estimates(np.column_stack([asked, np.zeros(9)]))
    np.testing.assert_allclose(other.estimates(np.column_stack([asked, np.full(9, held + 1e-4)])), wanted, atol=1e-9)


def test_choices_may_be_numbers_and_texts() -> None:
    first = np.random.default_rng(0).random(200)
    beliefs, many = np.column_stack([first, 1.0 - first]), np.where(first > 0.6, 1, 0)
    mixed = np.array(["high" if each else 7 for each in many], dtype=object)
    plain, other = DataAdversary(beliefs, many), DataAdversary(beliefs, mixed)
    np.testing.assert_allclose(other.estimate("high"), plain.estimate(1))
    np.testing.assert_allclose(other.estimates(np.array([7, "high"], dtype=object)), plain.estimates([0, 1]))
    np.testing.assert_allclose(other.estimate("none"), plain.estimate(5))


def test_labels_are_put_in_order_or_refused() -> None:
    rng = np.random.default_rng(3)
    weights = pd.DataFrame(rng.normal(size=(60, 2)), columns=["Oil", "Gas"])
    first = (weights["Oil"] > 0).astype(float)
    beliefs = pd.DataFrame({"calm": first, "wild": 1 - first})
    seen = DataAdversary(beliefs, weights)
    action = pd.Series([1.5, -2.0], ["Oil", "Gas"])
    assert seen.estimate(action.iloc[::-1]) == pytest.approx(seen.estimate(action.to_numpy()))
    assert DataAdversary(beliefs, weights).estimate(action)[0] > 0.5
    with pytest.raises(InputError, match="rows of beliefs and actions"):
        DataAdversary(beliefs.iloc[::-1], weights)


def test_compare_has_it_where_it_is_asked_for_and_changes_nothing_else() -> None:
    setting = Setting.of(PROBLEM, PRIOR)
    makers = makers_of({name: COMPARED[name] for name in ("ODM", "CDM")}, setting)
    options = {"budgets": (0.5,), "repeats": (1,), "draws": 10}
    plain, asked = (
        compare(PROBLEM, PRIOR, ComparisonSettings(**options, pairs=pairs), makers=makers, rng=np.random.default_rng(0))
        for pairs in ((), (50, 2000))
    )
    frame = asked.frame()
    added = ["data_error_of_50_pairs", "data_error_of_2000_pairs"]
    assert frame.drop(columns=added).equals(plain.frame())
    assert (frame[added[1]] >= frame["bayes_error"] - 1e-12).all()
    assert "error, data alone, 50 pairs" in short_table(asked)
    assert any(note.startswith("data alone") for note in notes_of(asked))
    assert not any(note.startswith("data alone") for note in notes_of(plain))
    odm = mechanism(OriginalDecisionMaker(PROBLEM), PRIOR.beliefs)
    assert frame["bayes_error"][0] == pytest.approx(leakage(odm, PRIOR).bayes_error)
    with pytest.raises(InputError, match="pairs"):
        ComparisonSettings(pairs=(5,))


def test_a_study_has_it(tmp_path: Path) -> None:
    both = ["bayesian", {"name": "data", "pairs": [20, 2000]}]
    plan = SMALL | {"repeats": 1, "decision_makers": ["ODM"], "adversaries": both, "measures": ["error"]}
    found = run_study(Study.of(plan), tmp_path).frame()
    assert found["adversary"].str.contains("data").sum() == 2
    assert np.isfinite(found["error"]).all()


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn", None)
    with pytest.raises(InputError, match=r"pip install 'inscrutable\[audit\]'"):
        DataAdversary(np.full((20, 2), 0.5), np.zeros((20, 1)))
