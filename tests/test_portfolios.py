"""Portfolio words: their sets are the ones their names say, and their rows carry the assets' names into messages."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    InputError,
    MarkowitzProblem,
    ModelError,
    QuadraticProblem,
    consistent_beliefs,
    group_caps,
    long_short,
    max_weights,
    min_weights,
    simplex,
    turnover,
)
from oracles import consistent
from sizes import instances

ASSETS = ["Food", "Oil", "Gas", "Tech"]


def is_inside(region, point):
    return bool(region.violation(point) <= 1e-12)


def test_caps_and_floors():
    region = max_weights(ASSETS, {"Oil": 0.25, "Tech": 0.5}) & min_weights(ASSETS, 0.1)
    assert region.names[:3] == ("Oil <= 0.25", "Tech <= 0.5", "Food >= 0.1")
    np.testing.assert_array_equal(max_weights(3, [0.2, np.inf, 0.4]).A_ub, [[1, 0, 0], [0, 0, 1]])
    np.testing.assert_array_equal(min_weights(3, 0.2).b_ub, [-0.2, -0.2, -0.2])
    assert min_weights(2, [-np.inf, 0.5], min_slack=0.0).min_slack == 0.0


def test_labels_that_are_numbers_name_assets_and_no_places():
    np.testing.assert_array_equal(max_weights([1, 2, 3], {1: 0.2}).A_ub, [[1, 0, 0]])
    np.testing.assert_array_equal(max_weights([1, 2, 0], pd.Series([0.5, 0.4, np.inf])).b_ub, [0.4, 0.5])
    np.testing.assert_array_equal(min_weights([10107, 14593], {"14593": 0.2}).A_ub, [[0, -1]])
    np.testing.assert_array_equal(group_caps(np.array([2, 5, 7]), {"g": [2, 5]}, 0.5).A_ub, [[1, 1, 0]])
    np.testing.assert_array_equal(long_short([3, 1, 2], gross=1.5, shortable=[1]).rows.A_ub, [[-1, 0, 0], [0, 0, -1]])
    np.testing.assert_array_equal(max_weights([1.0, 2.5], {2.5: 0.2}).A_ub, [[0, 1]])
    with pytest.raises(InputError, match=r"limits has 0, expected one of 1, 2, 3$"):
        max_weights([1, 2, 3], {0: 0.2})


def test_groups():
    region = group_caps(ASSETS, {"energy": ["Oil", "Gas"], "new": [3], "all": range(4)}, {"energy": 0.4, "new": 0.1})
    assert region.names == ("energy <= 0.4", "new <= 0.1")
    np.testing.assert_array_equal(region.A_ub, [[0, 1, 1, 0], [0, 0, 0, 1]])
    assert group_caps(2, {"both": [0, 1]}, 0.9).names == ("both <= 0.9",)


@pytest.mark.parametrize("net", [1.0, 0.0, (0.2, 1.1)])
@pytest.mark.parametrize("shortable", [None, ["Oil", 2]])
def test_long_and_short_is_the_sum_of_magnitudes(net, shortable):
    rng = np.random.default_rng(0)
    region = long_short(ASSETS, gross=1.5, net=net, shortable=shortable)
    low, high = (net, net) if np.ndim(net) == 0 else net
    seen = set()
    for _ in range(instances(3000)):
        point = rng.normal(size=4) * rng.uniform(0.1, 0.8)
        if shortable is not None and rng.random() < 0.7:
            point[[0, 3]] = np.abs(point[[0, 3]])
        if low == high:
            point += (low - point.sum()) / 4
        expected = np.abs(point).sum() <= 1.5 and low - 1e-12 <= point.sum() <= high + 1e-12
        if shortable is not None:
            expected &= bool((point[[0, 3]] >= 0).all())
        assert is_inside(region, point) == expected
        seen.add(bool(expected))
    assert seen == {True, False}


def test_turnover_is_the_sum_of_trades():
    rng = np.random.default_rng(1)
    previous = np.array([0.5, 0.0, 0.3, 0.2])
    region, only = turnover(previous, 0.3), turnover(previous, 0.3, long_only=True)
    rows = region.in_decision
    assert (len(rows.b_ub), len(only.in_decision.b_ub)) == (16, 8 + 1)
    assert rows.names[1] == "turnover <= 0.3 (below: u[3])"
    for _ in range(2000):
        point = previous + rng.normal(size=4) * 0.1
        traded = np.abs(point - previous).sum() <= 0.3
        assert is_inside(region, point) == is_inside(rows, point) == traded
        assert is_inside(only, point) == (traded and point[1] >= 0)
    assert is_inside(turnover(previous, 0.0), previous)


def test_names_come_from_a_mapping_or_a_series():
    pandas = pytest.importorskip("pandas")
    held = {"Food": 0.5, "Oil": 0.5}
    for previous in (held, pandas.Series(held)):
        assert turnover(previous, 0.1).in_decision.names[-1] == "turnover <= 0.1 (below: Food, Oil)"
    frame = pandas.DataFrame(np.zeros((1, 2)), columns=["Food", "Oil"])
    assert max_weights(frame.columns, 0.3).names == ("Food <= 0.3", "Oil <= 0.3")


@pytest.mark.parametrize("size", [4, 7, 9])
@pytest.mark.parametrize("which", ["gross", "turnover"])
def test_the_observer_inverts_limits_on_magnitudes(which, size):
    """Where many rows are tight at once (assets at zero, or not traded) the set is that of the rows of all signs."""
    rng = np.random.default_rng(size)
    factors = rng.normal(size=(3, size, size))
    hessians = factors @ factors.transpose(0, 2, 1) / size + 0.05 * np.eye(size)
    previous = rng.dirichlet(np.ones(size))
    limit = simplex(size) & turnover(previous, 0.15)
    region = long_short(size, gross=1.3) if which == "gross" else limit
    problem = QuadraticProblem(hessians, 0.3 * rng.normal(size=(3, size)), constraints=region)
    for belief, target in zip(rng.dirichlet(np.ones(3), 4), rng.dirichlet(np.ones(3), 4), strict=True):
        action = problem.solve(belief)
        assert np.abs(action).sum() <= 1.3 + 1e-9 or which == "turnover"
        rows = region.in_decision
        tight = rows.slacks(action) < region.min_slack
        gradients = np.stack([h @ action + g for h, g in zip(problem.hessians, problem.linear, strict=True)], axis=1)
        system = consistent.kkt_system(gradients, rows.A_ub[tight], rows.A_eq)
        found = consistent_beliefs(problem, action)
        assert found.contains(belief)
        np.testing.assert_allclose(found.bounds(), consistent.bounds(system), atol=1e-6)
        assert found.distance(target) == pytest.approx(consistent.distance(system, target), abs=1e-6)


def test_rows_in_conflict_are_told_by_the_assets_names():
    caps = group_caps(ASSETS, {"energy": ["Oil", "Gas"]}, 0.4) & min_weights(ASSETS, {"Oil": 0.3, "Gas": 0.25})
    with pytest.raises(ModelError) as caught:
        MarkowitzProblem(np.zeros((1, 4)), [np.eye(4)], 1.0, simplex(4) & caps)
    message = str(caught.value)
    for name in ("energy <= 0.4", "Oil >= 0.3", "Gas >= 0.25"):
        assert name in message
    assert "by 0.15" in message
    assert "u[0]" not in message


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: max_weights(ASSETS, {"Coal": 0.1}), "'Coal', expected one of Food, Oil"),
        (lambda: max_weights(["A", "A"], 0.1), "'A' twice"),
        (lambda: max_weights([], 0.1), "at least one name"),
        (lambda: max_weights(0, 0.1), "whole number of at least 1"),
        (lambda: max_weights("AB", 0.1), "whole number"),
        (lambda: max_weights(3, [0.1, 0.2]), "one number or 3"),
        (lambda: max_weights(2, [0.1, np.nan]), r"nan for u\[1\]"),
        (lambda: max_weights(2, [0.1, -np.inf]), r"-inf for u\[1\]; inf stands for no limit"),
        (lambda: min_weights(2, -np.inf), "no finite entry"),
        (lambda: group_caps(ASSETS, {}, 0.1), "must map"),
        (lambda: group_caps(ASSETS, {"energy": "Oil"}, 0.1), "list of assets"),
        (lambda: group_caps(ASSETS, {"energy": ["Oil", 1]}, 0.1), "Oil twice"),
        (lambda: group_caps(ASSETS, {"energy": [7]}, 0.1), "7, expected one of"),
        (lambda: group_caps(ASSETS, {"energy": [1]}, {"coal": 0.1}), "caps names 'coal', expected one of the groups"),
        (lambda: group_caps(ASSETS, {"energy": [1]}, np.nan), "must be finite"),
        (lambda: group_caps(ASSETS, {"energy": [1]}, {}), "names no group"),
        (lambda: long_short(3, gross=-1.0), "gross must be at least 0"),
        (lambda: long_short(3, gross=1.5, net=(0.1, 0.2, 0.3)), "got 3 numbers"),
        (lambda: turnover([0.5, 0.5], -0.1), "limit must be at least 0"),
        (lambda: turnover([0.5, np.nan], 0.1), r"previous has nan at index \[1\]"),
        (lambda: turnover([0.5, 0.5], 0.1, assets=["A"]), "2 weights, expected one per asset: 1"),
    ],
)
def test_malformed_words_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_limits_that_leave_nothing_are_refused():
    with pytest.raises(ModelError, match=r"gross limit 0.5 is below the net 1"):
        long_short(3, gross=0.5, net=1.0)
    with pytest.raises(ModelError, match=r"gross limit 0.5 is below the net -1"):
        long_short(3, gross=0.5, net=-1.0)
    with pytest.raises(ModelError, match="swap the two"):
        long_short(3, gross=2.0, net=(1.0, 0.5))
    long_short(11, gross=1.5, shortable=[0, 1])
    turnover(np.append(np.zeros(30), [0.5, 0.5]), 0.1, long_only=True)
