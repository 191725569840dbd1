"""An audit of two tables claims one side only: its limits hold, it raises few false alarms, and it says what it did."""

from __future__ import annotations

import json
import sys
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.signal import lfilter

from inscrutable import InputError, Mechanism, Prior, audit_pairs, cli
from inscrutable.adversaries.learners import learners
from inscrutable.datasets import read_records
from inscrutable.experiments.audit import PairsAudit, pairs_audit
from inscrutable.experiments.audit.bounds import autocorrelations, design_effect, mean_limit, memory, share_limit
from inscrutable.experiments.audit.forward import best_before, blocks, learn_forward
from inscrutable.reports.audit import audit_table, write_audit
from sizes import instances

pytest.importorskip("sklearn", reason="the learners come with the [audit] extra")

DATES = pd.date_range("1990-01-31", periods=200, freq="ME")
Drawn = tuple[np.ndarray, np.ndarray, np.ndarray, float, float]


def drawn_pairs(rng: np.random.Generator, rows: int) -> Drawn:
    """Pairs of a drawn mechanism: classes, numbers and decisions, with the Bayes errors of both by enumeration."""
    n_states, n_beliefs, n_actions, width = (int(rng.integers(*ends)) for ends in ((2, 4), (4, 12), (2, 21), (1, 4)))
    beliefs = rng.dirichlet(np.ones(n_states), size=n_beliefs)
    kernel = rng.dirichlet(np.full(n_actions, 0.5), size=n_beliefs)
    prior = Prior(beliefs, rng.dirichlet(np.full(n_beliefs, 2.0)))
    played = Mechanism(beliefs, rng.normal(size=(n_actions, width)), kernel, np.zeros_like(kernel))
    law = prior.weights[:, None] * kernel
    top, value = beliefs.argmax(axis=1), beliefs[:, 0]
    right = sum(max(law[top == state, m].sum() for state in range(n_states)) for m in range(n_actions))
    means = (law * value[:, None]).sum(axis=0) / law.sum(axis=0)
    square = (law * (value[:, None] - means) ** 2).sum()
    seen = rng.choice(n_beliefs, size=rows, p=prior.weights)
    shown = (kernel[seen].cumsum(axis=1) > rng.random(rows)[:, None]).argmax(axis=1)
    return top[seen], value[seen], np.asarray(played.actions)[shown], 1.0 - float(right), float(np.sqrt(square))


def autocorrelated(rng: np.random.Generator, rows: int, columns: int, stay: float) -> np.ndarray:
    return np.asarray(lfilter([1.0], [1.0, -stay], rng.normal(size=(rows + 200, columns)), axis=0)[200:])


def count_below(rng: np.random.Generator, cases: int, rows: int, every: int = 1) -> tuple[int, int, list[float]]:
    """How often limits lie below the Bayes error, of classes and of numbers, and the learner's errors over the Bayes errors."""
    below, shares = [0, 0], []
    for case in range(cases):
        classes, numbers, shown, *errors = drawn_pairs(rng, rows)
        for k, (kind, secret) in enumerate((("classes", classes), ("numbers", numbers))):
            if (case + k) % every == 0 and len(np.unique(secret)) > 1:
                (found,) = audit_pairs(secret, shown, kind=kind, shifts=19, rng=rng).secrets  # type: ignore[arg-type]
                below[k] += found.error_limit < errors[k]
                shares.append(found.error / errors[k])
    return below[0], below[1], shares


def count_alarms(rng: np.random.Generator, cases: int, rows: int = 300) -> int:
    alarms = 0
    for k in range(cases):
        series = autocorrelated(rng, rows, 4, (0.8, 0.9, 0.95, 0.98)[k % 4])
        secret = series[:, 0] > np.median(series[:, 0]) if k % 2 else series[:, 0]
        alarms += audit_pairs(secret, series[:, 1:], shifts=39, rng=rng).is_found
    return alarms


@pytest.fixture
def without_sources(monkeypatch: pytest.MonkeyPatch) -> None:
    """What single columns tell is not looked for."""
    monkeypatch.setattr(pairs_audit, "_sources", lambda *arguments: ())


@pytest.mark.usefixtures("without_sources")
def test_limits_hold_for_the_best_observer(fresh_rng: np.random.Generator) -> None:
    # Each fails one time in twenty; more than four of twelve happen once in 5,000 runs.
    classes, numbers, _ = count_below(fresh_rng, instances(12, least=6), 300, every=2)
    assert classes + numbers <= 4


@pytest.mark.usefixtures("without_sources")
def test_the_share_explained_is_at_least_what_is_said() -> None:
    """The variance of the secret is estimated from the same rows as the error, and is as uncertain."""
    rng = np.random.default_rng(22)
    below, number = 0, instances(100, least=40)
    for _ in range(number):
        secret = np.sqrt(1 - 0.9**2) * autocorrelated(rng, 1000, 1, 0.9)[:, 0]
        said = audit_pairs(secret, secret + rng.normal(size=1000) / 3.0, shifts=19).secrets[0].summary()
        below += float(said.split("R² at least ")[1].split("%")[0]) > 90.0
    assert below <= number / 10  # four times as many, where the variance counted as known


@pytest.mark.usefixtures("without_sources")
def test_series_that_hang_together_but_not_with_each_other_seldom_alarm(fresh_rng: np.random.Generator) -> None:
    assert count_alarms(fresh_rng, instances(8, least=4), 200) <= 3  # more happen once in 2,700 runs


@pytest.mark.audit
@pytest.mark.usefixtures("without_sources")
def test_limits_hold_in_two_hundred_cases() -> None:
    classes, numbers, _ = count_below(np.random.default_rng(17), 200, 600)
    print(f"\naudit: limits below the Bayes error, of 200: classes {classes}, numbers {numbers}")
    assert max(classes, numbers) <= 18


@pytest.mark.audit
@pytest.mark.usefixtures("without_sources")
def test_five_thousand_pairs_are_learned_to_a_tenth_of_the_bayes_error() -> None:
    _, _, shares = count_below(np.random.default_rng(18), 40, 5000)
    print(f"\naudit: learner's error over the Bayes error, median {np.median(shares):.3f}, largest {max(shares):.3f}")
    assert np.median(shares) <= 1.1


@pytest.mark.audit
@pytest.mark.usefixtures("without_sources")
def test_false_alarms_of_two_hundred() -> None:
    alarms = count_alarms(np.random.default_rng(19), 200)
    print(f"\naudit: false alarms on independent autocorrelated series, of 200: {alarms}")
    assert alarms <= 18


@pytest.mark.audit
def test_a_hundred_thousand_pairs_take_a_minute_at_most() -> None:
    rng = np.random.default_rng(20)
    shown = rng.normal(size=(100_000, 10))
    start = time.process_time()
    found = audit_pairs(shown[:, 0] > 2 * rng.normal(size=100_000), shown)
    print(f"\naudit: 100,000 pairs of ten columns in {time.process_time() - start:.0f} s")
    assert found.is_found
    assert time.process_time() - start <= 60


@pytest.mark.audit
@pytest.mark.usefixtures("without_sources")
def test_what_would_have_been_found_is_found() -> None:
    found = 0
    for k in range(60):
        rng = np.random.default_rng([21, k])
        secret, other = rng.normal(size=300), rng.normal(size=(300, 3))
        share = audit_pairs(secret, np.column_stack([other, rng.normal(size=300)])).secrets[0].detectable
        told = np.where(rng.random(300) < share, secret, 0.0)
        found += audit_pairs(secret, np.column_stack([other, told])).is_found
    print(f"\naudit: leaks said to be found in four of five audits, found in {found} of 60")
    assert found >= 39  # fewer happen once in 500 runs at a power of 80 %


# ---- limits and learning ---------------------------------------------------------------------------


@pytest.mark.parametrize(("wrong", "rows"), [(0, 30), (7, 30), (29, 30), (30, 30)])
def test_the_limit_of_shares_is_clopper_and_pearsons(wrong: int, rows: int) -> None:
    # Spread evenly, or with all of them wrong or right, errors are no more alike than by chance.
    series = (np.diff(np.floor(np.arange(rows + 1) * wrong / rows)) > 0).astype(float)
    exact = stats.binomtest(wrong, rows, alternative="less").proportion_ci(0.95, "exact").high
    assert share_limit(series, 0.95) == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("stay", [0.0, 0.5, 0.9])
def test_the_design_effect_of_an_autoregression(stay: float) -> None:
    series = autocorrelated(np.random.default_rng(3), 20_000, 1, stay)[:, 0]
    assert design_effect(series) == pytest.approx((1 + stay) / (1 - stay), rel=0.25)
    direct = [np.mean((series - series.mean())[: len(series) - k] * (series - series.mean())[k:]) for k in (1, 4)]
    wanted = np.array(direct) * np.array([len(series) - 1, len(series) - 4]) / len(series) / series.var()
    assert autocorrelations(series)[[1, 4]] == pytest.approx(wanted, abs=1e-9)
    assert design_effect(1e-3 * series) == pytest.approx(design_effect(series))
    assert memory(np.ones(50)) == 0


def test_the_limit_of_means_holds_for_skewed_losses_in_time(fresh_rng: np.random.Generator) -> None:
    truth = float(np.exp(0.5 / (1 - 0.25)))  # of the exponential of an autoregression with ½
    held = sum(
        mean_limit(np.exp(autocorrelated(fresh_rng, 400, 1, 0.5)[:, 0]), 0.95, fresh_rng) >= truth for _ in range(300)
    )
    assert held >= 255  # fewer happen once in 30,000 runs: it holds in .916 of 4,000 draws


def test_no_row_is_read_with_what_comes_after_it(fresh_rng: np.random.Generator) -> None:
    features, targets = fresh_rng.normal(size=(200, 2)), fresh_rng.normal(size=(200, 1))
    first, bounds, embargo = 20, blocks(200), 7
    before = learn_forward(features, targets, np.zeros(1, dtype=int), embargo, learners())
    for start, stop in bounds[3::2]:
        other, secret = features.copy(), targets.copy()
        other[stop:], secret[start - embargo :] = 5.0, -9.0
        other[start - embargo : start] = 3.0
        again = learn_forward(other, secret, np.zeros(1, dtype=int), embargo, learners())
        rows = slice(start - first, stop - first)
        assert np.array_equal(again.predictions[:, rows], before.predictions[:, rows])
        assert np.array_equal(again.guesses[rows], before.guesses[rows])
        secret[start - embargo - 1] = 99.0
        assert not np.array_equal(
            learn_forward(other, secret, np.zeros(1, dtype=int), embargo, learners()).guesses[rows],
            before.guesses[rows],
        )


def test_learners_are_those_of_scikit_learn_with_all_its_checks() -> None:
    from sklearn.linear_model import Ridge
    from sklearn.tree import DecisionTreeRegressor

    rng = np.random.default_rng(3)
    known, read, secret = (
        rng.normal(size=(200, 3)).round(1),
        rng.normal(size=(40, 3)).round(1),
        rng.normal(size=(200, 2)),
    )
    found = {name: learn(known, read)(secret[:, None])[:, 0] for name, learn in learners().items()}
    tree = DecisionTreeRegressor(min_samples_leaf=10, max_leaf_nodes=32, random_state=0)
    whole = [part.astype(np.float32) for part in (known, read)]
    np.testing.assert_array_equal(found["tree"], tree.fit(whole[0], secret).predict(whole[1]))
    points, queries = ((part - known.mean(axis=0)) / known.std(axis=0) for part in (known, read))
    ridge = Ridge(alpha=0.3 * len(known), solver="cholesky").fit(points, secret)
    np.testing.assert_array_equal(found["ridge, penalty 0.3"], ridge.predict(queries))
    apart = np.linalg.norm(queries[:, None] - points, axis=2)
    nearest = np.argsort(apart, axis=1, kind="stable")[:, :14]
    clear = np.sort(apart, axis=1)[:, 14] > np.sort(apart, axis=1)[:, 13] + 1e-9
    assert clear.sum() > 5
    np.testing.assert_allclose(found["nearest neighbours"][clear], secret[nearest[clear]].mean(axis=1), atol=1e-12)


@pytest.mark.parametrize("unit", [1e-8, 1e9])
def test_learners_depend_on_no_unit_of_the_secret(unit: float) -> None:
    rng = np.random.default_rng(3)
    known, read = rng.normal(size=(200, 3)), rng.normal(size=(40, 3))
    secret = np.abs(known[:, :1]) + rng.normal(size=(200, 1))
    for name, learn in learners().items():
        fitted = learn(known, read)
        np.testing.assert_allclose(fitted(unit * secret[:, None]) / unit, fitted(secret[:, None]), err_msg=name)


@pytest.mark.parametrize("offset", [-3e7, 1e4, 1e10])
def test_learners_depend_on_no_offset_of_the_secret(offset: float) -> None:
    rng = np.random.default_rng(3)
    known, read = rng.normal(size=(200, 3)), rng.normal(size=(40, 3))
    secret = np.abs(known[:, :1]) + rng.normal(size=(200, 1))
    for name, learn in learners().items():
        fitted = learn(known, read)
        moved = fitted(secret[:, None] + offset) - offset
        np.testing.assert_allclose(moved, fitted(secret[:, None]), atol=1e-15 * abs(offset) * 100, err_msg=name)


def test_shifts_learned_together_are_those_learned_alone(fresh_rng: np.random.Generator) -> None:
    features, targets = fresh_rng.normal(size=(120, 2)), np.eye(2)[fresh_rng.integers(2, size=120)]
    together = learn_forward(features, targets, np.array([0, 31]), 3, learners())
    alone = learn_forward(features, np.roll(targets, 31, axis=0), np.array([0]), 3, learners())
    assert together.squares[:, 1] == pytest.approx(alone.squares[:, 0], abs=1e-9)
    assert best_before(np.array([[[1.0, 9.0, 9.0]], [[2.0, 0.0, 0.0]]])).tolist() == [[0, 0, 1]]


def test_ridge_is_ridge(fresh_rng: np.random.Generator) -> None:
    known, read, target = (fresh_rng.normal(size=shape) for shape in ((50, 3), (5, 3), (50, 1, 1)))
    unit = known.std(axis=0)
    points, queries = (known - known.mean(axis=0)) / unit, (read - known.mean(axis=0)) / unit
    slope = np.linalg.solve(points.T @ points + 0.01 * 50 * np.eye(3), points.T @ (target[:, 0, 0] - target.mean()))
    found = learners()["ridge, penalty 0.01"](known, read)(target)[:, 0, 0]
    assert found == pytest.approx(target.mean() + queries @ slope, abs=1e-9)


# ---- what is found, and said -----------------------------------------------------------------------


def leaking(rows: int = 240, since: int = 0) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Two secrets and three columns; one column tells of the regime from a row on, one row late of the number."""
    rng = np.random.default_rng(4)
    dates = pd.date_range("1990-01-31", periods=rows, freq="ME", name="date")
    regime, score = rng.random(rows) < 0.5, rng.normal(size=rows)
    told = np.where(np.arange(rows) >= since, regime, 0.5)
    late = np.concatenate([[0.0], score[:-1]])
    weights = {
        "Oil": told + 0.4 * rng.normal(size=rows),
        "Gas": rng.normal(size=rows),
        "Food": late + rng.normal(size=rows),
    }
    secrets = pd.DataFrame({"regime": np.where(regime, "wild", "calm"), "score": score}, index=dates)
    return secrets, pd.DataFrame(weights, index=dates)


@cache
def audited_leak() -> PairsAudit:
    return audit_pairs(*leaking(), shifts=19)


def test_lags_count_steps_in_time_though_rows_are_missing() -> None:
    """A decision tells the secret of the week before; where only some weeks are published, that stays its lag."""
    rng = np.random.default_rng(1)
    weeks = pd.date_range("2012-01-06", periods=400, freq="W")
    secret = pd.Series(rng.normal(size=400), weeks, name="signal")
    decisions = pd.DataFrame({"A": np.roll(secret, 1) + 0.3 * rng.normal(size=400)}, weeks)
    whole, second, some = (
        audit_pairs(secret, decisions[kept], lags=(1,), shifts=19).secrets[0]
        for kept in (np.full(400, True), np.arange(400) % 2 == 0, rng.random(400) < 0.7)
    )
    assert all(each.is_found for each in (whole, second, some))
    assert second.explained == pytest.approx(whole.explained, abs=0.05)
    assert some.explained == pytest.approx(whole.explained, abs=0.05)
    audited = audit_pairs(secret, decisions[::2], lags=(1,), shifts=19)
    assert "lags count the rows of both tables together" in audited.summary()
    assert audited.n_rows == 199
    two = pd.DataFrame({"signal": secret, "other": secret.where(np.arange(400) > 30)})
    said = audit_pairs(two, decisions[::2], lags=(1,), shifts=19).summary()
    assert (
        "of 400 rows of secrets have no decision at every lag or, 31 of them, lack a secret, and are left out" in said
    )


def test_columns_and_lags_that_tell_are_named() -> None:
    found = audit_pairs(*leaking(), lags=(0, 1), shifts=19)
    regime, score = found.of("regime"), found.of("score")
    assert regime.is_found
    assert score.is_found
    assert {(each.kind, each.name) for each in regime.telling()} == {("column", "Oil"), ("lag", "0")}
    assert {(each.kind, each.name) for each in score.telling()} == {("column", "Food"), ("lag", "1")}
    assert regime.error_limit < regime.guess_error
    assert found.embargo >= 1
    assert "lower bounds of the leak" in str(found)


def test_a_leak_that_begins_late_is_dated() -> None:
    secrets, published = leaking(600, 330)
    found = audit_pairs(secrets["regime"], published, shifts=19).secrets[0]
    assert found.is_found
    assert abs((pd.Timestamp(found.since) - secrets.index[330]).days) <= 31 * 45
    assert pd.Timestamp(found.noticed) > pd.Timestamp(found.since)


def test_nothing_found_claims_nothing_and_says_what_would_have_been() -> None:
    rng = np.random.default_rng(6)
    found = audit_pairs(rng.random(200) < 0.4, rng.normal(size=(200, 2)))
    (secret,) = found.secrets
    assert not found.is_found
    assert 0 < secret.detectable < 0.3
    assert secret.error_limit >= secret.guess_error
    assert (secret.since, secret.noticed) == ("", "")
    assert "nothing found" in str(found)
    assert "80%" in str(found)


def test_many_secrets_are_judged_together() -> None:
    rng = np.random.default_rng(8)
    number = instances(8, least=4)
    secrets, published = rng.normal(size=(150, number)), rng.normal(size=(150, 2))
    published[:, 0] += secrets[:, 3]
    found = audit_pairs(secrets, published, shifts=19)
    assert [each.is_found for each in found.secrets] == [k == 3 for k in range(number)]
    alone = audit_pairs(secrets[:, 0], published, shifts=19).secrets[0]
    assert found.secrets[0].p_value >= alone.p_value
    assert found.secrets[0].error_limit >= alone.error_limit


@pytest.mark.usefixtures("without_sources")
def test_limits_of_more_than_fifty_secrets_lie_above_their_errors() -> None:
    rng = np.random.default_rng(1)
    secrets = rng.normal(size=(60, 51))
    frame = audit_pairs(secrets, secrets[:, :1] + 0.1 * rng.normal(size=(60, 1)), shifts=19).frame()
    assert (frame["error_limit"] > frame["error"]).all()
    losses = rng.exponential(size=200)
    limits = [mean_limit(losses, 1.0 - 0.05 / count, np.random.default_rng(2)) for count in (1, 10, 51, 400)]
    assert losses.mean() < limits[0]
    assert sorted(limits) == limits


def test_labels_join_rows_and_the_order_of_columns_changes_nothing() -> None:
    secrets, published = leaking()
    expected = audited_leak()
    shuffled = audit_pairs(secrets.iloc[::-1], published[["Food", "Oil", "Gas"]], shifts=19)
    assert shuffled.frame().equals(expected.frame())
    bare = audit_pairs(secrets.to_numpy()[:, 0], published.to_numpy(), shifts=19).secrets[0]
    assert bare.error == pytest.approx(expected.of("regime").error)
    mixed = audit_pairs(secrets["regime"], published.to_numpy(), shifts=19).secrets[0]
    assert mixed.blocks[0].first == bare.blocks[0].first or mixed.blocks[0].first.startswith("19")
    with pytest.raises(InputError, match="expected rows in order of time"):
        audit_pairs(secrets, published.iloc[::-1])


@pytest.mark.usefixtures("without_sources")
def test_labels_that_are_whole_numbers_join_rows_too() -> None:
    rng = np.random.default_rng(1)
    secret = pd.Series(rng.normal(size=201), name="signal")
    shown = pd.DataFrame({"A": secret + 0.1 * rng.normal(size=201)})
    later = audit_pairs(secret[:-1], shown[2:], shifts=19)
    assert later.is_found
    assert later.n_rows == 198
    assert "2 of 200 rows of secrets have no partner, such as 0" in later.summary()
    expected = audit_pairs(secret, shown, shifts=19).frame()
    assert audit_pairs(secret[::-1], shown, shifts=19).frame().equals(expected)
    with pytest.raises(InputError, match="expected rows in order of time"):
        audit_pairs(secret, shown[::-1], shifts=19)
    # An array has no labels.
    for hidden, seen in ((secret[1:].to_numpy(), shown[1:]), (secret[1:], shown[1:].to_numpy())):
        by_place = audit_pairs(hidden, seen, shifts=19)
        assert by_place.is_found
        assert by_place.n_rows == 200


@pytest.mark.usefixtures("without_sources")
@pytest.mark.parametrize("labels", [int, float, str])
def test_tables_numbered_from_different_numbers_are_refused(labels: type) -> None:
    rng = np.random.default_rng(1)
    secret = pd.Series(rng.normal(size=80), name="signal")
    shown = pd.DataFrame({"A": secret + 0.1 * rng.normal(size=80)})
    from_0, from_1 = (pd.Index([labels(k + first) for k in range(80)]) for first in (0, 1))
    for hidden, seen in ((from_0, from_1), (from_1, from_0)):
        with pytest.raises(InputError, match=r"numbered .* use labels such as dates on both, or the same numbers"):
            audit_pairs(secret.set_axis(hidden), shown.set_axis(seen), shifts=19)
    dates = pd.Index(DATES[:80])
    for hidden, seen in ((from_1, from_1), (dates, dates), (dates, pd.RangeIndex(80)), (pd.RangeIndex(80), dates)):
        assert audit_pairs(secret.set_axis(hidden), shown.set_axis(seen), shifts=19).secrets[0].explained > 0.8
    with pytest.raises(InputError, match="secrets have 80 rows, published 79"):
        audit_pairs(secret, shown[:-1], shifts=19)
    years = audit_pairs(secret.set_axis(range(1900, 1980)), shown.set_axis(range(1905, 1985)), shifts=19)
    assert years.n_rows == 75


def test_treatments_are_said() -> None:
    secrets, published = leaking()
    published["Cash"] = 0.1
    published["call"] = np.where(published["Oil"] > 0.5, "buy", "sell")
    published.iloc[7, 0] = np.nan
    secrets.iloc[[9, 11], 1] = np.nan
    notes = " | ".join(audit_pairs(secrets.iloc[5:], published.iloc[:-4], shifts=19).notes)
    assert "4 of 235 rows of secrets have no partner, such as 2009-09-30" in notes
    assert "5 of 236 rows of published have no partner, such as 1990-01-31" in notes
    assert "3 rows in which a secret or a decision is missing are left out" in notes
    assert "constant: Cash" in notes
    assert "'call' is read as 2 choices: buy, sell" in notes


@pytest.mark.parametrize("held", [0.1, 0.3])
def test_a_column_that_is_constant_but_for_rounding_hides_no_leak(held: float) -> None:
    rng = np.random.default_rng(1)
    shown, noise = rng.normal(size=(2, 400))
    secret = np.cos(3.0 * shown) + 0.1 * rng.normal(size=400)
    late = np.where(np.arange(400) < 160, 0.0, 1e-4 * noise)
    one, other = (
        audit_pairs(secret, np.column_stack([shown, each + late]), shifts=19).secrets[0] for each in (0.0, held)
    )
    assert other.explained == pytest.approx(one.explained, abs=0.02)
    rounded = audit_pairs(secret, pd.DataFrame({"A": shown, "Cash": held + 1e-15 * noise}), shifts=19)
    assert "left out, since constant: Cash" in rounded.notes


COUNTED = np.arange(80) % 3
PERCENTS = np.array([f"{k % 4 + 1}%" for k in range(80)])


@pytest.mark.parametrize(
    ("secrets", "published", "options", "message"),
    [
        (np.ones(80), COUNTED, {}, "is 1.0 in every row: there is nothing to learn"),
        (COUNTED, np.ones(80), {}, "published decisions never change"),
        (COUNTED, np.ones(79), {}, "secrets have 80 rows, published 79"),
        (COUNTED[:40], COUNTED[:40], {}, "40 rows .* expected at least 60"),
        (
            pd.Series(range(80), pd.Index(range(100, 180))),
            pd.Series(range(80), DATES[:80]),
            {},
            "no row label of secrets",
        ),
        (pd.Series(COUNTED, [*"ab"] * 40), pd.Series(range(80), DATES[:80]), {}, "label a twice"),
        (COUNTED, np.where(COUNTED == 1, np.inf, 0.0), {}, "infinite in row 1"),
        (COUNTED, pd.Series([*map(float, range(79)), "sold"]), {}, "has 'sold' in row 79 among numbers"),
        (COUNTED, pd.Series(["sold", *np.arange(79)], dtype=object), {}, "has 'sold' in row 0 among numbers"),
        (pd.Series([*range(79), True], dtype=object), COUNTED, {}, "has True in row 79 among numbers"),
        (np.array([str(k) for k in range(80)]), COUNTED, {}, "80 different classes"),
        (COUNTED, np.array([str(k) for k in range(80)]), {}, "80 different texts"),
        (np.array(["a", "b"] * 40), COUNTED, {"kind": "numbers"}, "its kind is classes"),
        (COUNTED, COUNTED, {"kind": "words"}, 'kind must be "classes" or "numbers"'),
        (COUNTED, COUNTED, {"lags": ()}, "lags must be whole numbers"),
        (COUNTED, COUNTED, {"lags": (0, 0)}, "lags must be whole numbers"),
        (COUNTED, COUNTED, {"lags": (0.5,)}, "lags must be whole numbers"),
        (COUNTED, COUNTED, {"lags": (0, 12)}, "leaves too little to learn from"),
        (COUNTED, COUNTED, {"lags": (100,)}, "0 rows .* expected at least 60"),
        (COUNTED, COUNTED, {"embargo": 20}, "leaves too little to learn from"),
        (COUNTED, COUNTED, {"shifts": 5}, "shifts"),
        (np.zeros((2, 2, 2)), COUNTED, {}, "shape"),
        (
            PERCENTS,
            COUNTED,
            {},
            r"secrets column .* such as '1%' in row 0: write \.05 for 5%.* or ask for --kind classes",
        ),
        (COUNTED, PERCENTS, {}, r"published column .* such as '1%' in row 0"),
        (COUNTED, np.array(["$2,500", "$1.5", "(3)", "7"] * 20), {}, "currencies or thousands separators"),
        (
            pd.Series(COUNTED, DATES[:80]),
            pd.Series(range(80), DATES[:80].tz_localize("UTC")),
            {},
            r"times of published alone have UTC offsets",
        ),
    ],
)
def test_bad_tables_are_refused(secrets: Any, published: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        audit_pairs(secrets, published, **options)


def test_written_numbers_may_be_classes_if_one_asks_for_that() -> None:
    found = audit_pairs(PERCENTS, COUNTED, kind="classes", shifts=19)
    assert found.secrets[0].kind == "classes"


def test_a_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn", None)
    with pytest.raises(InputError, match=r"pip install 'inscrutable\[audit\]'"):
        audit_pairs(COUNTED, COUNTED)


def test_classes_that_are_long_whole_numbers_keep_their_digits() -> None:
    for names in (("20240101", "20240102"), ("1.0000001", "1.0000002")):
        ids = np.where(COUNTED == 1, *map(float, names))
        assert audit_pairs(ids, COUNTED, kind="classes", shifts=19).secrets[0].classes == names


@pytest.mark.usefixtures("without_sources")
@pytest.mark.parametrize(
    ("first", "dtype"),
    [
        *((2**53, dtype) for dtype in ("int64", "uint64", "Int64", "object")),
        *((2**63, dtype) for dtype in ("uint64", "UInt64", "object")),
        (10**20, "object"),
    ],
)
def test_classes_that_are_whole_numbers_are_not_rounded(first: int, dtype: Any) -> None:
    ids = pd.Series([first + 1 + int(k) for k in COUNTED], dtype=dtype)
    names = tuple(str(first + k) for k in (1, 2, 3))
    shown = pd.DataFrame({"A": COUNTED + 0.1 * np.random.default_rng(1).normal(size=80)})
    assert audit_pairs(ids, shown, shifts=19).secrets[0].classes == names
    # Rows that are missing, or have no partner, turn no whole number into a float.
    for hidden, lags in ((ids[5:], (0,)), (ids[5:], (0, 1)), (ids.astype(object).where(ids.index > 4), (0,))):
        found = audit_pairs(hidden, shown, lags=lags, shifts=19)
        assert found.secrets[0].classes == names
        assert found.n_rows == 75 - max(lags)


# ---- files and the command -------------------------------------------------------------------------


def test_the_result_is_written_and_loaded(tmp_path: Path) -> None:
    found = audited_leak()
    found.save(tmp_path / "audit.npz")
    assert PairsAudit.load(tmp_path / "audit.npz").summary() == found.summary()
    names = [path.name for path in write_audit(found, tmp_path)]
    assert names == ["audit.csv", "blocks.csv", "sources.csv", "summary.json", "audit.png", "audit.svg"]
    blocks_read = pd.read_csv(tmp_path / "blocks.csv")
    assert (len(blocks_read), blocks_read["is_judged"].sum()) == (18, 12)
    assert json.loads((tmp_path / "summary.json").read_text("utf-8"))["is_found"] is True
    assert audit_table(found)["leak"].str.contains("found").all()


def test_files_are_read_with_what_is_missing(tmp_path: Path) -> None:
    file = tmp_path / "signals.csv"
    file.write_text("date,regime,score\n2020-01-31,calm,0.5\n2020-02-29,NA,\n2020-03-31,wild,-1\n")
    frame = read_records(file)
    assert frame["score"].isna().tolist() == [False, True, False]
    assert frame["regime"].isna().tolist() == [False, True, False]
    file.write_text("date,score\n2020-01-31,calm\n2020-02-29,1\n")
    with pytest.raises(InputError, match=r"line 2, column 'score': found 'calm' where line 3 has the number '1'"):
        read_records(file)
    file.write_text("date,score\n2020-02-29,2\n2020-01-31,1\n")
    with pytest.raises(InputError, match="goes back in time"):
        read_records(file)
    file.write_text("date\n2020-02-29\n")
    with pytest.raises(InputError, match="one column"):
        read_records(file)


@pytest.mark.usefixtures("undrawn")
def test_the_command_prints_the_verdict_and_writes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    secrets, published = leaking(120)
    secrets.to_csv(tmp_path / "signals.csv")
    published.to_csv(tmp_path / "weights.csv")
    files = ["--secrets", str(tmp_path / "signals.csv"), "--published", str(tmp_path / "weights.csv")]
    out = tmp_path / "out"
    assert cli.main(["audit", *files, "--lags", "0,1", "--out", str(out), "-q"]) == 0
    said = capsys.readouterr().out
    assert "regime: leaks" in said
    assert str(out / "audit.csv") in said
    assert sorted(path.name for path in out.iterdir()) == sorted(
        ["audit.csv", "audit.png", "audit.svg", "blocks.csv", "files.json", "sources.csv", "summary.json"]
    )
    assert cli.main(["audit", *files, "--json", "-q", "--embargo", "2", "--kind", "classes"]) == 3
    assert "120 different classes" in capsys.readouterr().err
    assert cli.main(["audit", *files, "--json", "-q", "--embargo", "2", "--lags", "-1,0"]) == 0
    assert json.loads(capsys.readouterr().out)["embargo"] == 2
    assert cli.main(["audit", *files, "--lags", "soon"]) == 2
    assert "expected whole numbers" in capsys.readouterr().err
    assert cli.main(["audit", *files[:3], str(tmp_path / "none.csv")]) == 3


def test_a_secret_that_stands_still_at_the_mean_of_what_was_learned_is_told_by_nothing() -> None:
    """The guess without decisions then makes no error: no share of it is explained, and none is a number over zero."""
    secret = np.zeros(100)
    secret[:10] = np.tile([1.0, -1.0], 5)
    published = np.random.default_rng(3).normal(size=(100, 2))
    (found,) = audit_pairs(secret, published, kind="numbers", embargo=0, shifts=19).secrets
    assert not found.is_found
    assert found.guess_error == found.explained == 0.0
    assert all(each.explained == each.error == 0.0 and not each.tells for each in found.sources)
    assert all(block.explained == 0.0 for block in found.blocks)


@pytest.mark.usefixtures("without_sources")
def test_an_autocorrelated_secret_is_worth_few_rows_and_says_so(fresh_rng: np.random.Generator) -> None:
    steps = np.sqrt(1 - 0.98**2) * fresh_rng.normal(size=1000)
    for k in range(1, 1000):
        steps[k] += 0.98 * steps[k - 1]
    shown = fresh_rng.normal(size=(300, 2))
    found = audit_pairs(steps[-300:], shown, shifts=19)
    assert "180 test rows are worth about" in found.summary()
    assert not audit_pairs(fresh_rng.random(300), shown, shifts=19).notes
    halves = steps[-300:] > np.median(steps[-300:])
    (note,) = audit_pairs(halves, shown, shifts=19).notes
    assert "180 test rows are worth about" in note
    assert not audit_pairs(fresh_rng.random(300) < 0.3, shown, shifts=19).notes


@pytest.mark.usefixtures("without_sources")
def test_a_secret_that_repeats_cannot_be_tested_and_says_so() -> None:
    """Shifts by whole periods explain as much as the secret itself, so that no leak is found."""
    rng = np.random.default_rng(0)
    season = 1e7 + np.sin(np.arange(240) * np.pi / 6.0)
    for secret in (season, np.tile(rng.normal(size=12), 20), 0.1 + 0.2 * (np.arange(240) % 2), np.arange(240) % 3):
        told = np.column_stack([secret, rng.normal(size=240)])
        found = audit_pairs(secret, told)
        assert not found.is_found
        assert found.secrets[0].detectable == 1.0
        assert "secrets repeats itself" in found.summary()
        assert "The power is at most about 80%" in found.summary()
    both = audit_pairs(np.column_stack([secret, rng.normal(size=240)]), told, shifts=19)
    assert both.secrets[1].detectable < 1.0
    assert "secrets 1 repeats itself" in both.summary()
    assert "secrets 2 repeats itself" not in both.summary()


@pytest.mark.usefixtures("without_sources")
@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_a_narrow_range_is_no_repetition(offset: float) -> None:
    rng = np.random.default_rng(0)
    regime = rng.random(300) < 0.5
    secret = offset + 1e-6 * regime + 1e-9 * rng.normal(size=300)
    found = audit_pairs(secret, regime + 0.3 * rng.normal(size=300), shifts=39)
    assert found.is_found
    assert found.secrets[0].detectable < 0.5
    assert not found.notes


@pytest.mark.usefixtures("without_sources")
def test_heavy_tails_are_said(fresh_rng: np.random.Generator) -> None:
    shown, drawn = fresh_rng.normal(size=(300, 2)), fresh_rng.random(300)
    (note,) = audit_pairs(drawn**-3.0, shown, shifts=19).notes
    assert "seems to have heavy tails" in note
    assert audit_pairs(1e-8 * drawn**-3.0, shown, shifts=19).notes == (note,)
    assert not audit_pairs(drawn, shown, shifts=19).notes
    assert not audit_pairs(drawn > 0.7, shown, shifts=19).notes
