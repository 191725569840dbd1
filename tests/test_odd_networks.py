"""Odd network files: each is refused in words that name what is wrong and where, or read as what it says."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from inscrutable import InputError, InscrutableError, PowerNetwork, dispatch_problem, from_pandapower, load_matpower

CASE = """function mpc = two
mpc.version = '2';
mpc.baseMVA = 100;
mpc.bus = [
1 3 0 0 0;
7 1 50 0 0;
];
mpc.gen = [
1 0 0 0 0 1 100 1 80 10;
7 0 0 0 0 1 100 1 40 0;
];
mpc.gencost = [
2 0 0 3 0.02 1 5 0;
2 0 0 3 0.01 2 5 0;
];
mpc.branch = [
1 7 0 0.1 0 30 0 0 0 0 1 0 0;
];
"""
BEST = [30.0, 20.0]

# What is replaced in the case, by what, and what is said.
REFUSED = [
    ("mpc.baseMVA = 100;", "", "has no baseMVA"),
    ("mpc.baseMVA = 100;", "mpc.baseMVA = -1;", "baseMVA must be one number above 0"),
    ("mpc.version = '2';", "mpc.version = '1';", "a case of another version than 2"),
    ("7 1 50 0 0;", "7 1 50 0;", "line 6: a row of bus has 4 numbers, the first one 5"),
    ("7 1 50 0 0;", "7 1 fifty 0 0;", "line 6: bus has 'fifty'; expected numbers"),
    ("7 1 50 0 0;", "7 1 5_0 0 0;", "line 6: bus has '5_0'; expected numbers"),
    ("7 1 50 0 0;", "7 1 NaN 0 0;", "line 6: column 3 of bus is nan"),
    ("7 1 50 0 0;", "7 1 1e3 0 0;", r"load is 1000 MW, but all units together give 10 to 120 MW"),
    ("7 1 50 0 0;", "1 1 50 0 0;", "line 6: the bus 1 stands twice"),
    ("7 1 50 0 0;", "7.5 1 50 0 0;", "line 6: the bus 7.5 is no whole number"),
    ("7 1 50 0 0;", "7 1 50 0 0; 9 1 5 0 0;", "do not connect all buses: there are 2 islands.* 9"),
    ("1 3 0 0 0;\n7 1 50 0 0;", "", "bus has no rows"),
    (
        "1 0 0 0 0 1 100 1 80 10;",
        "2 0 0 0 0 1 100 1 80 10;",
        "line 9: a gen is at bus 2, which is not in the table bus",
    ),
    ("1 100 1 80 10;", "1 100 1 80 90;", "line 9: Pmin 90 MW is above Pmax 80 MW"),
    ("1 100 1 80 10;", "1 100 1 Inf 10;", "line 9: column 9 of gen is inf"),
    ("1 100 1 80 10;", "1 100 NaN 80 10;", "line 9: the status of a gen is NaN"),
    ("2 0 0 3 0.02 1 5 0;", "2 0 0 3 -0.02 1 5 0;", "line 13: the cost is not convex: -0.02 per MW²"),
    ("2 0 0 3 0.02 1 5 0;", "2 0 0 4 0.02 1 5 0;", "line 13: the cost is of a degree above two"),
    ("2 0 0 3 0.02 1 5 0;", "2 0 0 9 0.02 1 5 0;", "line 13: the cost has model 2 and 9 numbers"),
    ("2 0 0 3 0.02 1 5 0;", "3 0 0 3 0.02 1 5 0;", "line 13: the cost has model 3"),
    (
        "2 0 0 3 0.02 1 5 0;",
        "1 0 0 2 40 9 40 9;",
        "line 13: the points of a cost must be two or more with outputs that rise",
    ),
    ("2 0 0 3 0.02 1 5 0;\n", "", "gencost has 1 rows, expected one per generator: 2"),
    ("1 7 0 0.1", "1 8 0 0.1", "line 17: a branch is at bus 8, which is not in the table bus"),
    ("1 7 0 0.1", "1 1 0 0.1", "line 17: a branch has bus 1 at both ends"),
    ("1 7 0 0.1", "1 7 0 0", "line 17: a branch has no reactance"),
    ("0.1 0 30 0", "0.1 0 NaN 0", "line 17: a branch has a limit of nan MW"),
    ("0.1 0 30 0", "0.1 0 -30 0", "line 17: a branch has a limit of -30 MW"),
    ("0 0 1 0 0;", "0 0 0 0 0;", "do not connect all buses"),
    ("0 0 1 0 0;", "0 0 1 20 -20;", "line 17: the angle limits of a branch, 20 and -20 degrees, exclude"),
    ("0 0 1 0 0;", "0 0 1 20 0;", "line 17: the angle limits of a branch, 20 and 0 degrees, exclude"),
    (
        "0 0 1 0 0;",
        "0 0 1 5 20;",
        "line 17: no flow of the branch keeps its limit of 30 MW and its angle limits, 5 and 20 degrees",
    ),
    ("];\n", "];\nmpc.branch(:, 3) = mpc.branch(:, 3) / 10;\n", "is code, or no MATPOWER case"),
    ("0.02 1 5", "0.04/2 1 5", "line 13: gencost has '0.04/2'; expected numbers"),
    ("mpc.branch = [", "mpc.A = [1 1];\nmpc.branch = [", "has A: constraints and costs of a user's own are not read"),
    ("mpc.branch = [", "mpc.dcline = [1 7 1 0];\nmpc.branch = [", "dcline has lines of direct current in service"),
    ("1 0 0;\n];\n", "1 0 0;\n", "branch has no closing ]; the file is cut off"),
    ("mpc.bus = [", "mpc.bus = [1 2 3 4 5];\nmpc.bus = [", "bus stands twice"),
    ("];\nmpc.gen =", "]';\nmpc.gen =", "bus is followed by"),
    (CASE, "", "has no baseMVA, bus, gen, branch, gencost"),
    (CASE, '{"bus": 3}', "is code, or no MATPOWER case"),
    (CASE, "\x00\x01", "is no text"),
]
# Changes that leave the case what it is.
SAME = [
    ("mpc.baseMVA", "other.baseMVA"),
    ("7 1 50 0 0;", "7, 1, 50, 0, 0  % the load; [not a bracket]"),
    ("7 1 50 0 0;", "7 1 ...\n50 0 0;"),
    ("7 1 50 0 0;", "7 1 ... the load, [MW]\n50 0 0;"),
    ("mpc.bus = [", "%{\nmpc.bus = [9 9 9];\n%}\nmpc.bus = ["),
    ("mpc.bus = [", "mpc.bus_name = {\n'north';\n'so % uth';\n};\nmpc.bus = ["),
    ("mpc.branch = [", "mpc.dcline = [1 7 0 0];\nmpc.branch = ["),
    ("\n", "\r\n"),
    ("7 1 50 0 0;", "7 1 45 0 5;"),
    ("7 1 50 0 0;", "7 1 50 0 0;\n8 4 500 0 0;"),
    ("1 7 0 0.1 0 30 0 0 0 0 1 0 0;", "1 7 0 0.1 0 30 0 0 0 0 1 0 0;\n1 7 0 0.1 0 1 0 0 0 0 0 0 0;"),
    ("function mpc = two\n", "\ufefffunction mpc = two\n"),
    ("function mpc = two\n", ""),
    ("mpc.bus = [", "% a note\x85 and others\u2028 and more\x0c\nmpc.bus = ["),
    ("mpc.bus = [", "mpc.bus_name = {\"100% A}\"; 'B}'};\nmpc.bus = ["),
]


@pytest.mark.parametrize(("old", "new", "said"), REFUSED)
def test_an_odd_case_is_refused_in_words(old, new, said, tmp_path):
    assert old in CASE
    (tmp_path / "odd.m").write_text(CASE.replace(old, new, 1) if new != "" or old != CASE else "")
    with pytest.raises(InscrutableError) as refused:
        dispatch_problem(load_matpower(tmp_path / "odd.m"))
    assert re.search(said, str(refused.value)), refused.value


@pytest.mark.parametrize(("old", "new"), SAME)
def test_what_changes_nothing_changes_nothing(old, new, tmp_path):
    assert old in CASE
    (tmp_path / "same.m").write_bytes(CASE.replace(old, new).encode())
    np.testing.assert_allclose(dispatch_problem(load_matpower(tmp_path / "same.m")).solve([1.0]), BEST)


@pytest.mark.parametrize(
    ("angles", "least", "most"),
    [
        ("0 0", -np.inf, np.inf),
        ("0 1", 0.0, 1.0),
        ("-1 0", -1.0, 0.0),
        ("-360 360", -np.inf, np.inf),
        ("-1 360", -1.0, np.inf),
    ],
)
def test_limits_of_angles_in_matpower(angles: str, least: float, most: float, tmp_path: Path) -> None:
    """MATPOWER's manual, table of branch data: none where both are 0, none below from −360°, none above from 360° on."""
    (tmp_path / "angles.m").write_text(CASE.replace("0.1 0 30 0 0 0 0 1 0 0;", f"0.1 0 0 0 0 0 0 1 {angles};"))
    limits = load_matpower(tmp_path / "angles.m", convention="matpower").flow_limits
    np.testing.assert_allclose(limits, [[1000.0 * np.radians(least), 1000.0 * np.radians(most)]])


@pytest.mark.parametrize("limit", ["0", "Inf"])
def test_a_line_without_a_limit(limit, tmp_path):
    """The marginal costs 1 + 0.04 u and 2 + 0.02 (50 − u) are equal."""
    (tmp_path / "free.m").write_text(CASE.replace("0.1 0 30 0", f"0.1 0 {limit} 0"))
    np.testing.assert_allclose(dispatch_problem(load_matpower(tmp_path / "free.m")).solve([1.0]), [100 / 3, 50 / 3])


def test_a_net_of_pandapower_with_costs_and_limits_left_out(monkeypatch):
    """A unit of 40 MW at no cost, two lines without a limit beside one of 30 MW, and one between joined buses."""
    case = {
        "baseMVA": 100.0,
        "bus": np.array([[0.0, 3, 0, 0, 0], [1, 1, 50, 0, 0]]),
        "gen": np.array([[0.0, 0, 0, 0, 0, 1, 100, 1, 80, 10], [1, 0, 0, 0, 0, 1, 100, 1, 40, 0]]),
        "gencost": np.array([[2.0, 0, 0, 3, 0.02, 1, 5], [2, 0, 0, 0, 0, 0, 0]]),
        "branch": np.array([[0.0, 1, 0, 0.1, 0, rate, 0, 0, 0, 0, 1, 0, 0] for rate in (30.0, np.nan, np.nan)]),
    }
    case["branch"][2, 1] = 0
    monkeypatch.setitem(
        sys.modules, "pandapower.converter.pypower.to_ppc", SimpleNamespace(to_ppc=lambda net, **options: case)
    )
    network = from_pandapower(SimpleNamespace(bus=pd.DataFrame(index=[0, 1])))
    np.testing.assert_array_equal(network.flow_limits, [[-30, 30], [-np.inf, np.inf]])
    np.testing.assert_allclose(dispatch_problem(network).solve([1.0]), [10.0, 40.0])


@pytest.mark.parametrize("name", ["dcline", "vsc", "tcsc", "xward"])
def test_nets_of_pandapower_with_elements_that_are_not_converted(name, monkeypatch):
    """Stand-ins: pandapower itself is not needed."""

    def to_ppc(net, **options):
        raise KeyError("OPF parameters are not set correctly. See error log.")

    monkeypatch.setitem(sys.modules, "pandapower.converter.pypower.to_ppc", SimpleNamespace(to_ppc=to_ppc))
    table = pd.DataFrame({"in_service": [False, True]}, ["off", "on"])
    with pytest.raises(InputError, match=rf"the network has {name} in service \(on\)"):
        from_pandapower(SimpleNamespace(bus=pd.DataFrame(), **{name: table}))
    with pytest.raises(InputError, match=r"controllable loads, .* need min_p_mw, max_p_mw, min_q_mvar and max_q_mvar"):
        from_pandapower(SimpleNamespace(bus=pd.DataFrame(), **{name: table[:1]}))


def test_wrong_calls_on_networks(tmp_path):
    (tmp_path / "two.m").write_text(CASE)
    network = load_matpower(tmp_path / "two.m")
    one = ([0.0, 1.0], [0], [5.0], [1.0], [1.0], [[0, 1]], [[0.1, 5.0]])
    for call, said in (
        (lambda: load_matpower(tmp_path / "none.m"), "cannot be read: No such file"),
        (lambda: load_matpower(tmp_path), "is a folder"),
        (lambda: load_matpower(3), "must be given by its path"),
        (lambda: load_matpower("a\x00b"), "is no path|cannot be read"),
        (lambda: load_matpower(tmp_path / "two.m", convention="dc"), "convention must be one of powermodels, matpower"),
        (lambda: from_pandapower(network), "must be a pandapower net"),
        (lambda: dispatch_problem("two.m"), "network must be a PowerNetwork"),
        (lambda: dispatch_problem(network, [7]), "wind_means is missing"),
        (lambda: dispatch_problem(network, [2], [[1.0]]), "wind_buses has bus 2, which is none of 1, 7"),
        (lambda: dispatch_problem(network, [True], [[1.0]]), "wind_buses has bus True"),
        (lambda: dispatch_problem(network, [7], [[np.nan]]), "wind_means has nan"),
        (lambda: dispatch_problem(network).bus_prices([1.0]), "2"),
        (lambda: dispatch_problem(network).bus_prices([1.0, 1.0]), "outside the feasible set"),
        (lambda: PowerNetwork({"a": 0.0, "b": 1.0}, ["a"], [5], [1], [1], [["a", "c"]], [[0.1, 5]]), "bus 'c'"),
        (lambda: PowerNetwork({True: 0.0, False: 1.0}, [True], [5], [1], [1], [[1, 0]], [[0.1, 5]]), "is True or False"),
        (lambda: PowerNetwork(*one[:2], [[6.0, 5.0]], *one[3:]), "least output of 6 MW above its most"),
        (lambda: PowerNetwork(*one[:2], [[1.0, 2.0, 3.0]], *one[3:]), "expected one per generator"),
        (lambda: PowerNetwork(*one[:6], [[0.0, -5.0, 5.0, 0.0]]), "has the reactance 0"),
        (lambda: PowerNetwork(*one[:6], [[0.1, 5.0, -5.0, 0.0]]), "least flow of 5 MW above its most"),
        (lambda: PowerNetwork(*one[:6], [[0.1, -5.0, 5.0, np.inf]]), "driven flow that is infinite"),
        (lambda: PowerNetwork(*one[:6], [[0.1, np.nan]]), "line_data has nan"),
    ):  # fmt: skip
        with pytest.raises(InscrutableError) as refused:
            call()
        assert re.search(said, str(refused.value)), refused.value
