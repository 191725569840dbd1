"""Feasible sets: rows, slacks, names, intersections, admissibility, and what is said where nothing is feasible."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from scipy.optimize import linprog

from inscrutable import (
    InputError,
    MarkowitzProblem,
    ModelError,
    Polyhedron,
    QuadraticProblem,
    box,
    consistent_beliefs,
    group_caps,
    max_weights,
    simplex,
)
from sizes import instances
from strategies import SEEDS


def test_the_simplex_has_its_rows():
    region = simplex(3)
    assert region.n_actions == 3
    np.testing.assert_array_equal(region.A_ub, -np.eye(3))
    np.testing.assert_array_equal(region.b_ub, np.zeros(3))
    np.testing.assert_array_equal(region.A_eq, np.ones((1, 3)))
    np.testing.assert_array_equal(region.b_eq, [1.0])
    assert region.names == ("u[0] >= 0", "u[1] >= 0", "u[2] >= 0", "sum(u) = 1")
    assert region.min_slack == 1e-4


def test_a_box_drops_its_infinite_bounds():
    region = box([0.0, -np.inf], [np.inf, 2.0])
    np.testing.assert_array_equal(region.A_ub, [[-1, 0], [0, 1]])
    np.testing.assert_array_equal(region.b_ub, [0, 2])
    assert region.names == ("u[0] >= 0", "u[1] <= 2")


def test_an_intersection_keeps_each_limit_once():
    region = simplex(2) & box([0.0, 0.2], [0.7, np.inf]) & Polyhedron([[2.0, 2.0], [3.0, 0.0]], [4.0, 2.1])
    assert region.names == ("u[0] >= 0", "u[1] >= 0.2", "u[0] <= 0.7", "A_ub[0]", "sum(u) = 1")
    assert region.slacks([0.5, 0.5]).round(12).tolist() == [0.5, 0.3, 0.2, 1.0]


def test_intersection_keeps_rows_names_and_the_larger_slack():
    first = Polyhedron([[1.0, 0.0]], [0.5], [[1.0, 1.0]], [1.0], names=["cap", "net"], min_slack=1e-3)
    second = Polyhedron([[0.0, -1.0]], [0.0], names=["floor"], min_slack=0.0)
    both = first & second
    assert both.names == ("cap", "floor", "net")
    np.testing.assert_array_equal(both.A_ub, [[1, 0], [0, -1]])
    assert both.min_slack == 1e-3
    assert "2 coordinates, 2 inequalities, 1 equalities" in repr(both)
    with pytest.raises(TypeError):
        first & 3
    with pytest.raises(InputError, match="2 and 3"):
        first & simplex(3)


def test_slacks_are_per_unit_of_the_rows_largest_coefficient():
    region = Polyhedron([[100.0, 50.0], [-1.0, 0.0]], [100.0, 0.0])
    np.testing.assert_allclose(region.slacks([0.5, 0.5]), [0.25, 0.5])
    np.testing.assert_allclose(region.slacks([[0.5, 0.5], [1.0, 0.0]]), [[0.25, 0.5], [0.0, 1.0]])
    assert float(region.violation([0.5, 0.5])) == 0
    # Per unit of the decision's size, here 2.
    assert float(region.violation([2.0, 0.0])) == pytest.approx(0.5)
    assert float(region.violation([-0.25, 0.0])) == pytest.approx(0.25)
    assert float(simplex(2).violation([0.5, 0.6])) == pytest.approx(0.1)


def test_admissible_is_tight_or_slack_by_the_smallest_slack():
    region = simplex(3)  # min_slack 1e-4
    rows = [
        ([0.5, 0.5, 0.0], True),
        ([0.5, 0.5 - 1e-4, 1e-4], True),
        ([0.5, 0.5 - 0.9e-4, 0.9e-4], False),
        ([0.5, 0.5 - 1e-12, 1e-12], True),  # rounding
        ([0.5, 0.5, 0.1], False),
        ([1.1, -0.1, 0.0], False),
    ]
    actions = np.array([action for action, _ in rows])
    expected = np.array([answer for _, answer in rows])
    np.testing.assert_array_equal(region.is_admissible(actions), expected)
    for action, answer in rows:
        assert bool(region.is_admissible(action)) is answer
    letter = Polyhedron(-np.eye(3), np.zeros(3), np.ones((1, 3)), [1.0], min_slack=0.0)
    assert bool(letter.is_admissible([0.5, 0.5 - 0.9e-4, 0.9e-4]))


def test_tight_rows_are_those_an_observer_counts():
    region = simplex(3)
    np.testing.assert_array_equal(region.tight_rows([0.5, 0.5 - 5e-5, 5e-5]), [False, False, True])
    np.testing.assert_array_equal(region.tight_rows([0.5, 0.5 - 2e-4, 2e-4]), [False, False, False])
    scaled = Polyhedron([[0.0, -1000.0]], [0.0], min_slack=1e-4)  # the slack is in units of the coordinate
    np.testing.assert_array_equal(scaled.tight_rows([[0.0, 5e-5], [0.0, 2e-4]]), [[True], [False]])


@settings(max_examples=instances(40), deadline=None)
@given(SEEDS)
def test_the_bounding_box_is_that_of_linear_programmes(seed):
    rng = np.random.default_rng(seed)
    size = int(rng.integers(1, 5))
    region = box(np.full(size, -1.0), np.full(size, 1.0)) & Polyhedron(rng.normal(size=(2, size)), np.full(2, 0.5))
    for j, (low, high) in enumerate(region.bounding_box):
        for sign, value in ((1, low), (-1, high)):
            answer = linprog(sign * np.eye(size)[j], region.A_ub, region.b_ub, bounds=(None, None))
            assert sign * answer.fun == pytest.approx(value, abs=1e-9)
    open_ended = box([0.0, -np.inf], [np.inf, 3.0]).bounding_box
    np.testing.assert_array_equal(open_ended, [[0, np.inf], [-np.inf, 3]])


# --- nothing feasible ---------------------------------------------------------------------------------------------------


def test_conflicting_rows_are_named_with_the_least_relaxation():
    region = simplex(3) & Polyhedron(
        [[-1.0, 0, 0], [0, -1.0, 0], [1.0, 1.0, 0]], [-0.5, -0.3, 0.6], names=["min A", "min B", "cap A+B"]
    )
    with pytest.raises(ModelError, match="no decision satisfies all constraints") as caught:
        region.check_feasible()
    assert "by 0.2" in str(caught.value)
    assert any(name in str(caught.value) for name in ("min A", "min B", "cap A+B"))
    with pytest.raises(ModelError, match="no decision satisfies"):
        QuadraticProblem([np.eye(3)], [np.zeros(3)], constraints=region)


@pytest.mark.parametrize("unit", [1.0, 1e-6, 1e6])
def test_infeasibility_is_seen_in_any_unit(unit):
    """0.3 above 0.2, in units of a millionth or a million."""
    region = Polyhedron([[1.0], [-1.0]], [0.2 * unit, -0.3 * unit])
    with pytest.raises(ModelError, match="no decision satisfies"):
        region.check_feasible()


def test_equalities_in_conflict_are_named():
    with pytest.raises(ModelError, match=r"net|gross"):
        Polyhedron(A_eq=[[1.0, 1.0], [1.0, 1.0]], b_eq=[1.0, 2.0], names=["net", "gross"]).check_feasible()


def test_a_single_feasible_point_is_feasible():
    region = Polyhedron(A_eq=np.eye(2), b_eq=[0.3, 0.7])
    region.check_feasible()
    problem = QuadraticProblem([np.eye(2)] * 2, np.zeros((2, 2)), constraints=region)
    np.testing.assert_allclose(problem.solve([0.5, 0.5]), [0.3, 0.7], atol=1e-14)
    pinned = simplex(2) & box([0.3, 0.0], [0.3, 1.0])
    problem = QuadraticProblem([np.eye(2)] * 2, np.zeros((2, 2)), constraints=pinned)
    np.testing.assert_allclose(problem.solve([0.5, 0.5]), [0.3, 0.7], atol=1e-14)


# --- rows that say nothing, or cannot be ---------------------------------------------------------------------------------


def test_rows_without_coefficients_are_dropped_where_they_hold(fresh_rng):
    """What is left decides and explains as if the empty rows had never been there; names stay with their rows."""
    size = int(fresh_rng.integers(2, 5))
    rows, sides = fresh_rng.normal(size=(5, size)), fresh_rng.uniform(0.5, 2.0, 5)
    empty = fresh_rng.choice(5, 2, replace=False)
    rows[empty], sides[empty[1]] = 0.0, 0.0
    held = np.setdiff1d(np.arange(5), empty)
    words = [f"row {i}" for i in range(5)]
    net = np.vstack([np.ones(size), np.zeros(size)])
    given = Polyhedron(rows, sides, net, [0.0, 0.0], names=[*words, "net", "nothing"])
    plain = Polyhedron(rows[held], sides[held], net[:1], [0.0], names=[*(words[i] for i in held), "net"])
    assert given.names == plain.names == (*(f"row {i}" for i in held), "net")
    assert Polyhedron(rows, sides).names == tuple(f"A_ub[{i}]" for i in held)
    fence = box(np.full(size, -5.0), np.append(np.full(size - 1, np.inf), 5.0))
    assert (given & fence).names == (*(f"row {i}" for i in held), *fence.names, "net")
    hessians, linear = np.tile(np.eye(size), (3, 1, 1)), fresh_rng.normal(size=(3, size))
    beliefs = fresh_rng.dirichlet(np.ones(3), 5)
    problems = [QuadraticProblem(hessians, linear, constraints=each & fence) for each in (given, plain)]
    actions = [each.solve(beliefs) for each in problems]
    np.testing.assert_array_equal(*actions)
    for action in actions[0]:
        np.testing.assert_array_equal(*(consistent_beliefs(each, action).bounds() for each in problems))
    outside = actions[0][0] + 10.0 * rows[held[0]]
    said = []
    for each in problems:
        with pytest.raises(InputError, match=r"is violated by|is off by") as caught:
            each.check_action(outside)
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_equalities_that_follow_from_others_are_dropped(fresh_rng):
    """With one of them no chart of a region had fast coordinates: search and proof took up to fifty times as long."""
    size = int(fresh_rng.integers(3, 7))
    rows, point = fresh_rng.normal(size=(2, size)), fresh_rng.normal(size=size)
    mixed = fresh_rng.normal(size=(3, 2)) @ rows
    given = Polyhedron(A_eq=np.vstack([rows, mixed]), b_eq=np.concatenate([rows @ point, mixed @ point]))
    assert given.names == ("A_eq[0]", "A_eq[1]")
    whole = fresh_rng.normal(size=(size + 2, size))
    assert len(Polyhedron(A_eq=whole, b_eq=whole @ point).b_eq) == size
    halves = Polyhedron(A_eq=np.kron(np.eye(2), np.ones(2)), b_eq=[0.5, 0.5], names=["half", "other half"])
    assert (halves & simplex(4)).names[-2:] == ("half", "other half")
    asked = Polyhedron(A_eq=np.vstack([rows, mixed]), b_eq=np.concatenate([rows @ point, mixed @ point + 1e-3]))
    with pytest.raises(ModelError, match="cannot hold together"):
        QuadraticProblem(np.eye(size)[None], np.zeros((1, size)), constraints=asked)


def test_a_set_without_any_limit_is_the_whole_space():
    region = Polyhedron([[0.0, 0.0], [1.0, 2.0]], [0.0, np.inf])
    assert (region.n_actions, region.names) == (2, ())
    problem = QuadraticProblem([np.eye(2)] * 2, [[1.0, 0.0], [0.0, 1.0]], constraints=region)
    np.testing.assert_allclose(problem.solve([0.25, 0.75]), [-0.25, -0.75], atol=1e-12)
    np.testing.assert_allclose(consistent_beliefs(problem, [-0.25, -0.75]).center(), [0.25, 0.75], atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Polyhedron([[1.0], [0.0]], [0.0, -1.0]), r"satisfies A_ub\[1\]: it asks that 0 <= -1"),
        (lambda: Polyhedron([[0.0]], [-1.0], names=["cap"]), "satisfies cap: it asks that 0 <= -1"),
        (lambda: Polyhedron(A_eq=[[0.0]], b_eq=[0.5], names=["net"]), "satisfies net: it asks that 0 = 0.5"),
        (lambda: Polyhedron([[1.0]], [-np.inf], names=["cap"]), "satisfies cap: it asks that a finite number <= -inf"),
        (lambda: box([0.0, 0.0], [1.0, -np.inf]), r"satisfies u\[1\] <= -inf"),
        (lambda: group_caps(["A", "B"], {"empty": [], "both": ["A", "B"]}, -0.1), "satisfies empty <= -0.1"),
    ],
)
def test_a_row_that_nothing_satisfies_is_named(make, message):
    with pytest.raises(ModelError, match=message):
        make()


def test_groups_without_assets_or_caps_limit_nothing():
    groups = {"none": [], "energy": ["Oil", "Gas"], "food": ["Food"]}
    region = group_caps(["Food", "Oil", "Gas"], groups, {"none": 0.1, "energy": 0.4, "food": np.inf})
    assert region.names == ("energy <= 0.4",)
    assert max_weights(["Food", "Oil"], {"Oil": 0.2, "Food": np.inf}).names == ("Oil <= 0.2",)


# --- malformed ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "needs A_ub with b_ub"),
        ({"A_ub": [[1.0]]}, "A_ub and b_ub must be given together"),
        ({"b_eq": [1.0], "A_ub": [[1.0]], "b_ub": [1.0]}, "A_eq and b_eq must be given together"),
        ({"A_ub": [[1.0, 2.0]], "b_ub": [1.0, 2.0]}, "1 rows but b_ub has 2"),
        ({"A_ub": [1.0, 2.0], "b_ub": [1.0]}, "A_ub must be 2-dimensional"),
        ({"A_ub": [[np.nan, 2.0]], "b_ub": [1.0]}, r"A_ub has nan at index \[0, 0\]"),
        ({"A_ub": [[1.0]], "b_ub": [np.nan]}, r"b_ub has nan at index \[0\]; -inf or inf stands for no limit"),
        ({"A_eq": [[1.0]], "b_eq": [np.inf]}, r"b_eq has inf at index \[0\]"),
        ({"A_ub": [[1.0]], "b_ub": [1.0], "A_eq": [[1.0, 1.0]], "b_eq": [1.0]}, "A_ub has 1 columns but A_eq has 2"),
        ({"A_ub": [[1.0]], "b_ub": [1.0], "names": ["a", "b"]}, "names has 2 entries, expected one per row: 1"),
        ({"A_ub": [[1.0]], "b_ub": [1.0], "min_slack": -1e-4}, "min_slack must be at least 0"),
    ],
)
def test_malformed_rows_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        Polyhedron(**arguments)


def test_malformed_boxes_and_simplices_are_refused():
    with pytest.raises(InputError, match="one length"):
        box([0.0], [1.0, 2.0])
    with pytest.raises(InputError, match="lower has nan"):
        box([np.nan], [1.0])
    with pytest.raises(InputError, match="at least one finite bound"):
        box([-np.inf], [np.inf])
    with pytest.raises(ModelError, match="lower bound 2 is above upper bound 1 at coordinate 1"):
        box([0.0, 2.0], [1.0, 1.0])
    for wrong in (0, -1, 2.5, True, "3"):
        with pytest.raises(InputError, match="whole number"):
            simplex(wrong)
    with pytest.raises(InputError):
        box(["a"], [1.0])
    with pytest.raises(ModelError, match=r"no decision satisfies u\[0\] >= inf"):
        box([np.inf], [np.inf])


def test_rows_without_names_have_the_labels_of_their_coordinates() -> None:
    region = simplex(3) & max_weights(["A", "B", "C"], {"A": 0.5})
    for order in (["A", "B", "C"], ["C", "A", "B"]):  # the market's order becomes that of the constraints
        problem = MarkowitzProblem(pd.DataFrame(np.eye(3)[:2], columns=order), [np.eye(3), np.eye(3)], 1.0, region)
        with pytest.raises(InputError, match=r"B >= 0 is violated by 0\.2"):
            problem.regret([0.5, 0.5], pd.Series({"A": 0.4, "B": -0.2, "C": 0.8}))
