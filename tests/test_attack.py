"""Reading weights back: truth inside the bounds, rounding derived and not guessed, nonsense told apart."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import tolerances
from inscrutable.adversaries import consistent_beliefs
from inscrutable.datasets import WeightsTable, read_weights
from inscrutable.errors import InputError
from inscrutable.experiments.attack import Attack, Reading, attack_weights
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.geometry import simplex_grid
from inscrutable.problems import MarkowitzProblem, Polyhedron, box, long_short, max_weights, simplex
from inscrutable.reports.attack import attack_lines, attack_summary, attack_table, reading_notes, write_attack
from inscrutable.worlds import GaussianEmission, HiddenMarkovModel
from sizes import instances, some


def market(seed: int, n_assets: int, n_states: int = 3, region: Polyhedron | None = None) -> InvestorModel:
    """A random market of monthly size."""
    rng = np.random.default_rng(seed)
    means = 0.01 * rng.normal(size=(n_states, n_assets))
    common = 0.04 * rng.normal(size=(n_states, n_assets, 1))
    covariances = common @ common.transpose(0, 2, 1) + np.stack(
        [np.diag(rng.uniform(0.0005, 0.003, size=n_assets)) for _ in range(n_states)]
    )
    world = HiddenMarkovModel(rng.dirichlet(np.ones(n_states), size=n_states), GaussianEmission(means, covariances))
    problem = MarkowitzProblem(means, covariances, 3.0, region)
    names = tuple(f"A{j}" for j in range(n_assets))
    return InvestorModel(world, problem, names, world.names)


def published(model: InvestorModel, beliefs: np.ndarray, decimals: int | None) -> pd.DataFrame:
    """Optimal weights as they are printed."""
    weights = model.problem.solve(beliefs)
    return pd.DataFrame(weights if decimals is None else weights.round(decimals), columns=list(model.assets))


def inside(attack: Attack, beliefs: np.ndarray, slack: float = 0.0) -> np.ndarray:
    """Whether each true belief lies within its row's bounds."""
    low, high = attack.bounds[:, :, 0], attack.bounds[:, :, 1]
    return ((beliefs >= low - slack) & (beliefs <= high + slack)).all(axis=1)


def test_exact_weights_say_what_the_adversary_says() -> None:
    model = market(0, 6)
    beliefs = np.random.default_rng(1).dirichlet(np.ones(3), size=30)
    attack = attack_weights(model, published(model, beliefs, None))
    assert attack.count(Reading.EXACT) == 30
    assert inside(attack, beliefs, 1e-7).all()
    for row, weights in zip(attack.rows, model.problem.solve(beliefs), strict=True):
        assert np.allclose(row.estimate, consistent_beliefs(model.problem, weights).center())
        assert row.gap == row.allowance == row.adjustment == 0.0
        assert row.residual <= tolerances.EXPLAINED


@pytest.mark.parametrize(
    ("seed", "n_assets", "decimals"), some([(*each, n) for each in ((2, 3), (3, 6), (4, 12)) for n in (2, 3, 4, 6)], 5)
)
def test_rounded_weights_keep_the_truth_inside(seed: int, n_assets: int, decimals: int) -> None:
    model = market(seed, n_assets)
    beliefs = np.random.default_rng(seed).dirichlet(np.ones(3), size=10)
    attack = attack_weights(model, published(model, beliefs, decimals), decimals=decimals)
    assert attack.count(Reading.ROUNDED) == 10, "an honest row is never implausible"
    assert inside(attack, beliefs, 1e-9).mean() >= 0.95
    assert (model.problem.regret(beliefs, attack.actions) <= [1e-12 + row.allowance for row in attack.rows]).all()


def test_more_digits_say_more() -> None:
    model = market(4, 12)
    beliefs = np.random.default_rng(5).dirichlet(np.ones(3), size=6)
    widths, errors = [], []
    for decimals in (2, 3, 4):
        attack = attack_weights(model, published(model, beliefs, decimals), decimals=decimals)
        widths.append(np.mean(attack.bounds[:, :, 1] - attack.bounds[:, :, 0]))
        errors.append(np.linalg.norm(attack.estimates - beliefs, axis=1).mean())
    assert widths[0] > 3 * widths[1] > 9 * widths[2]
    assert errors[0] > errors[1] > errors[2]
    assert widths[1] < 0.1, "three digits say a good deal"


def test_the_allowance_covers_the_worst_rounding() -> None:
    """Against brute force: extreme roundings of a decision, completed to sum one, never cost more than ε."""
    rng = np.random.default_rng(6)
    model = market(6, 5)
    belief = np.array([0.2, 0.5, 0.3])
    weights = model.problem.solve(belief)
    held = weights > 0
    for _ in range(instances(40)):
        shift = 0.005 * rng.choice([-1.0, 1.0], size=5) * held
        frame = pd.DataFrame([np.maximum(weights + shift, 0.0)], columns=list(model.assets))
        row = attack_weights(model, frame, decimals=2).rows[0]
        assert float(model.problem.regret(belief, row.action)) <= row.allowance
        assert row.reading is Reading.ROUNDED


def test_eight_digits_count_as_rounded_only_where_needed() -> None:
    model = market(7, 8)
    beliefs = np.random.default_rng(7).dirichlet(np.ones(3), size=10)
    attack = attack_weights(model, WeightsTable(published(model, beliefs, 9), None))
    assert attack.count(Reading.IMPLAUSIBLE) == 0
    assert attack.count(Reading.EXACT) > 0, "two held assets fit a segment whatever their digits"
    assert attack.count(Reading.ROUNDED) > 0
    assert inside(attack, beliefs, 1e-6).all()


def test_weights_that_no_belief_explains() -> None:
    model = market(8, 8)
    honest = published(model, np.array([[0.3, 0.3, 0.4]]), 3)
    frame = pd.concat([honest, pd.DataFrame(np.full((1, 8), 0.125), columns=honest.columns)], ignore_index=True)
    attack = attack_weights(model, frame, decimals=3)
    assert [row.reading for row in attack.rows] == [Reading.ROUNDED, Reading.IMPLAUSIBLE]
    bad = attack.rows[1]
    assert np.isnan(bad.bounds).all()
    assert bad.corners.shape == (0, 3)
    assert bad.gap > bad.allowance > 0
    grid = np.random.default_rng(0).dirichlet(np.ones(3), size=3000)
    least = model.problem.regret(grid, np.full(8, 0.125)).min()
    assert bad.gap <= least + 1e-12, "the gap is the least regret of any belief"
    assert float(model.problem.regret(bad.estimate, np.full(8, 0.125))) == pytest.approx(bad.gap, rel=1e-6)
    table = attack_table(attack)
    assert "least regret" in table["reading"].iloc[1]
    assert "nearest explanation" in table["reading"].iloc[1]
    assert "rounded to 3 decimals" in table["reading"].iloc[0]
    assert len(reading_notes(attack)) == 2
    assert reading_notes(attack)[0].endswith("at most ε of regret; rounding causes no more.")
    assert "1 of 2 rows are explained" in attack.summary()


@pytest.mark.parametrize("region", [simplex(3), long_short(3, gross=1.4)])
def test_a_row_that_rounding_does_not_explain_is_implausible(region: Polyhedron) -> None:
    """Within a gross limit, as without one."""
    means = np.array([[0.008, 0.007, 0.012], [-0.02, 0.002, -0.03]])
    calm = [[0.002, 0.0004, 0.0006], [0.0004, 0.001, 0.0004], [0.0006, 0.0004, 0.003]]
    crisis = [[0.008, 0.002, 0.004], [0.002, 0.003, 0.002], [0.004, 0.002, 0.010]]
    problem = MarkowitzProblem(means, [calm, crisis], 5.0, region & max_weights(3, 0.6))
    model = replace(market(0, 3, 2), problem=problem)
    weights = pd.DataFrame([[0.1, 0.6, 0.3], [0.2, 0.6, 0.2]], columns=list(model.assets))
    attack = attack_weights(model, weights, decimals=2)
    assert [row.reading for row in attack.rows] == [Reading.IMPLAUSIBLE, Reading.ROUNDED]
    grid = simplex_grid(2, 2000)
    printed = (problem.solve(grid).round(2)[:, None] == weights.to_numpy()).all(axis=2)
    np.testing.assert_array_equal(printed.any(axis=0), [False, True])
    same = grid[printed[:, 1], 0]
    np.testing.assert_allclose(attack.bounds[1, 0], [same.min(), same.max()], atol=0.03)


def test_sums_off_by_rounding_are_completed_and_zeros_stay_zero() -> None:
    model = market(9, 6)
    weights = published(model, np.array([[0.1, 0.8, 0.1]]), 2)
    zero = weights.iloc[0].to_numpy() == 0
    assert zero.any()
    weights.iloc[0, int(np.flatnonzero(~zero)[0])] += 0.004
    weights.iloc[0, int(np.flatnonzero(zero)[0])] = -0.0
    row = attack_weights(model, weights, decimals=2).rows[0]
    assert row.action.sum() == pytest.approx(1.0, abs=1e-12)
    assert (row.action[zero] == 0).all()
    assert not np.signbit(row.action).any()
    assert 0 < row.adjustment < 0.01


def test_a_sum_missed_by_more_than_rounding_is_a_caution() -> None:
    """As with cash that the file leaves out: more digits then give intervals that are narrow and wrong."""
    model, beliefs = market(9, 6), np.array([[0.1, 0.8, 0.1], [0.3, 0.3, 0.4]])
    for decimals in (None, 4, 2):
        weights = published(model, beliefs, decimals)
        assert not attack_weights(model, weights, decimals=decimals).cautions()
        weights.iloc[1] *= 0.996
        found = attack_weights(model, weights, decimals=decimals)
        missed = 0.004 - 3e-8 if decimals is None else max(0.004 - 3 * 10.0**-decimals, 0.0)
        assert found.missed == pytest.approx([0.0, missed], abs=2e-4 if decimals else 1e-8)
        said = "".join(found.cautions())
        assert ("Caution: 1 of 2 rows miss the sum of the weights" in said) == (missed > 0)
        assert ("--normalise" in said) == (missed > 0)


def test_a_cap_that_rounding_hides_is_taken_as_tight() -> None:
    region = simplex(5) & box(np.full(5, -np.inf), np.full(5, 1 / 3))
    model = market(10, 5, region=region)
    beliefs = np.random.default_rng(10).dirichlet(np.ones(3), size=8)
    assert np.isclose(model.problem.solve(beliefs), 1 / 3).any()
    for decimals in some((2, 3, 4), 2):
        attack = attack_weights(model, published(model, beliefs, decimals), decimals=decimals)
        assert attack.count(Reading.IMPLAUSIBLE) == 0
        assert inside(attack, beliefs, 1e-9).all()


def test_tight_rows_in_conflict_fall_back_to_a_projection() -> None:
    """Caps of .5 and .504 on two assets: at two digits both look tight, together they exceed one."""
    region = simplex(2) & box([-np.inf, -np.inf], [0.5, 0.504])
    model = market(11, 2, region=region)
    belief = np.array([[0.2, 0.3, 0.5]])
    row = attack_weights(model, published(model, belief, 2), decimals=2).rows[0]
    assert row.reading is Reading.ROUNDED
    assert float(model.problem.regret(belief[0], row.action)) <= row.allowance


def test_two_digit_files_are_read_whole(tmp_path: Path) -> None:
    model = market(12, 12)
    beliefs = np.random.default_rng(12).dirichlet(np.ones(3), size=5)
    frame = published(model, beliefs, 2)
    frame.to_csv(tmp_path / "w.csv", index_label="row")
    table = read_weights(tmp_path / "w.csv", assets=model.assets)
    assert table.decimals == 2
    assert inside(attack_weights(model, table), beliefs, 1e-9).all()


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (pd.DataFrame({"A0": [0.5], "A1": [0.5]}), r"missing: \['A2'\], unknown: \[\]"),
        (pd.DataFrame({"A0": [1.0], "A1": [0.0], "A2": [0.0], "B": [0.0]}), r"unknown: \['B'\]"),
        (pd.DataFrame({"A0": [1.0, 0.5], "A1": [0.0, 0.4], "A2": [0.0, 0.0]}), r"row 1 misses 'sum\(u\) = 1' by 0.1"),
        (pd.DataFrame({"A0": [1.2], "A1": [-0.2], "A2": [0.0]}), r"row 0 misses 'weight of A1 >= 0' by 0.2"),
        (pd.DataFrame({"A0": [np.nan], "A1": [0.5], "A2": [0.5]}), r"row 0, asset 'A0': nan"),
        (pd.DataFrame({"A0": ["x"], "A1": [0.5], "A2": [0.5]}), r"must be numbers"),
        (pd.DataFrame(columns=["A0", "A1", "A2"], dtype=float), r"no rows"),
        ([[0.5, 0.5, 0.0]], r"WeightsTable or a DataFrame, got list"),
    ],
)
def test_malformed_weights_are_named(frame: pd.DataFrame, message: str) -> None:
    with pytest.raises(InputError, match=message):
        attack_weights(market(0, 3), frame)


def test_dates_name_the_row() -> None:
    frame = pd.DataFrame([[0.5, 0.2, 0.2]], columns=["A0", "A1", "A2"], index=pd.DatetimeIndex(["2001-02-28"]))
    with pytest.raises(InputError, match=r"row 0 \(2001-02-28\) misses"):
        attack_weights(market(0, 3), frame)
    with pytest.raises(InputError, match="decimals must be a whole number"):
        attack_weights(market(0, 3), frame, decimals=-1)


@pytest.mark.parametrize(("n_states", "files"), some([(2, 4), (3, 6)], 2))
def test_files_are_written_and_hold_the_numbers(tmp_path: Path, n_states: int, files: int) -> None:
    model = market(13, 4, n_states)
    beliefs = np.random.default_rng(13).dirichlet(np.ones(n_states), size=3)
    frame = published(model, beliefs, 3)
    frame.index = pd.date_range("2001-01", periods=3, freq="ME", name="month")
    seen: list[tuple[int, int]] = []
    attack = attack_weights(model, frame, decimals=3, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 3), (2, 3), (3, 3)]
    written = write_attack(attack, tmp_path / "out")
    assert len(written) == files
    assert all(path.stat().st_size > 200 for path in written)
    table = pd.read_csv(tmp_path / "out" / "attack.csv", index_col=0)
    assert np.array_equal(table[list(model.regimes)].to_numpy(), attack.estimates)
    assert list(table.index) == ["2001-01-31", "2001-02-28", "2001-03-31"]
    assert attack_lines(attack).shape == (3, n_states + 2)
    assert attack_summary(attack)["readings"] == {"exact": 0, "rounded": 3, "implausible": 0}


@pytest.mark.usefixtures("undrawn")
def test_the_summary_keeps_every_row(tmp_path: Path) -> None:
    """Two rows of one day, and a label that comes twice, are rows of their own."""
    model = market(14, 4)
    beliefs = np.random.default_rng(14).dirichlet(np.ones(3), size=2)
    days = pd.to_datetime(["2001-01-02 10:00", "2001-01-02 16:00"])
    for index, labels in (
        (days, ["2001-01-02 10:00:00", "2001-01-02 16:00:00"]),
        (pd.Index(["fund", "fund"]), ["fund", "fund"]),
    ):
        attack = attack_weights(model, published(model, beliefs, None).set_axis(index))
        write_attack(attack, tmp_path)
        rows = json.loads((tmp_path / "summary.json").read_text("utf-8"))["rows"]
        assert [row["row"] for row in rows] == labels
        assert np.array_equal([row["estimate"] for row in rows], attack.estimates)
        assert np.array_equal([row["bounds"] for row in rows], attack.bounds)
        assert [row["reading"] for row in rows] == ["exact", "exact"]


def test_the_model_must_be_one() -> None:
    with pytest.raises(InputError, match="model must be an InvestorModel"):
        attack_weights(market(14, 4).problem, pd.DataFrame())  # type: ignore[arg-type]


def test_rows_over_a_limit_on_turnover_are_refused_and_named_and_each_row_limits_the_next() -> None:
    model = replace(market(3, 4), turnover=0.3)
    rng = np.random.default_rng(4)
    rows = [np.full(4, 0.25)]
    beliefs = rng.dirichlet(np.ones(3), size=5)
    for belief in beliefs:
        rows.append(model.problem_after(rows[-1]).solve(belief))
    months = pd.date_range("2001-01", periods=5, freq="ME")
    frame = pd.DataFrame(rows[1:], index=months, columns=list(model.assets))
    found = attack_weights(model, frame, previous=rows[0])
    assert inside(found, beliefs, 1e-6).all()
    assert not found.cautions()

    far = frame.copy()
    far.iloc[2] = np.eye(4)[int(frame.iloc[1].argmin())]
    with pytest.raises(InputError, match=r"row 2 \(2001-03-31\) misses 'turnover <= 0.3' by 1"):
        attack_weights(model, far, previous=rows[0])
    with pytest.raises(InputError, match="weights must be in the order of time"):
        attack_weights(model, frame[::-1], previous=rows[0])
    with pytest.raises(
        InputError, match=r"leave out the limit \(--turnover, or the key turnover of the model's file\)"
    ):
        attack_weights(model, frame, decimals=2, previous=rows[0])
    few = attack_weights(model, frame.drop(months[1]) * 0 + 0.25, previous=rows[0])
    assert "their dates do not" in few.cautions()[0]


def test_a_row_that_misses_its_sum_a_little_limits_the_next_from_where_it_was_moved() -> None:
    model = replace(market(3, 4), turnover=0.003)
    rows = pd.DataFrame([[0.25, 0.25, 0.25, 0.2537], [0.25, 0.25, 0.25, 0.25]], columns=list(model.assets))
    found = attack_weights(model, rows)
    assert "rows miss the sum" in found.cautions()[0]
    assert "--digits" not in found.cautions()[0]


def test_columns_that_are_numbers_are_the_assets_of_that_name() -> None:
    model = market(0, 3)
    numbered = replace(model, assets=("10107", "2", "0"))
    weights = published(model, np.array([[0.5, 0.3, 0.2]]), None)
    given = weights.set_axis([10107, 2, 0], axis=1)
    assert np.allclose(attack_weights(numbered, given.iloc[:, ::-1]).bounds, attack_weights(model, weights).bounds)


def test_a_limit_on_sums_of_magnitudes_that_is_missed_a_little_is_said_and_by_much_refused() -> None:
    model = market(5, 3, region=long_short(3, gross=1.4))
    within = pd.DataFrame([[0.7, 0.5, -0.2]], columns=list(model.assets))
    assert not attack_weights(model, within).cautions()
    little = attack_weights(model, within.add([0.001, 0.001, -0.002])).cautions()
    assert "1 of 1 rows miss the sum of the weights, or a limit, by up to 0.004" in little[0]
    with pytest.raises(InputError, match="gross"):
        attack_weights(model, within.add([0.1, 0.1, -0.2]))
