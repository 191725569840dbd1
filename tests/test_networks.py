"""Networks of a reader's own: MATPOWER cases against angles in a modelling language and published optima; prices; studies."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import inscrutable as ins
from inscrutable import InputError, ModelError, dispatch_problem, load_matpower
from inscrutable.experiments.studies.worlds import network_of, plain_network

pytest.importorskip("cvxpy")

from sizes import some
from tests.oracles.networks import case_text, optimum_by_angles, random_case

DATA = Path(__file__).parent / "data" / "pglib"
PUBLISHED = {"case5_pjm": 1.7480e04, "case14_ieee": 2.0515e03, "case30_ieee": 7.4728e03}
PINNED = "e7112be0e201f6cf3a575e91318542d8c7ed76d530886ac50b2239c3db4ffb40"
"""SHA-256 of the 40 typical cases up to 3,120 buses, one after another in the order of BASELINE.md, at commit dc6be4b2."""


@pytest.mark.parametrize("name", PUBLISHED)
def test_published_optima(name):
    network = load_matpower(DATA / f"pglib_opf_{name}.m")
    assert dispatch_problem(network).optimal_cost([1.0]) == pytest.approx(PUBLISHED[name], rel=1e-4)


@pytest.mark.audit
def test_all_published_optima_up_to_three_thousand_buses():
    folder = Path(os.environ.get("PGLIB_OPF", "pglib-opf"))
    if not (folder / "BASELINE.md").is_file():
        pytest.skip("PGLIB_OPF names no folder with the cases and BASELINE.md of PGLib-OPF")
    typical = (folder / "BASELINE.md").read_text("utf-8").split("## Congested")[0]
    cells = [[cell.strip() for cell in line.split("|")] for line in typical.splitlines() if line.startswith("| pglib")]
    asked = [(row[1], float(row[4])) for row in cells if int(row[2]) <= 3120]
    content = b"".join((folder / f"{name}.m").read_bytes() for name, _ in asked)
    assert hashlib.sha256(content).hexdigest() == PINNED, "the cases of another commit"
    off = {}
    for name, value in asked:
        found = dispatch_problem(load_matpower(folder / f"{name}.m")).optimal_cost([1.0])
        off[name] = abs(float(found) / value - 1)
    assert len(off) == 40
    assert {name: by for name, by in off.items() if by > 1e-4} == {}


@pytest.mark.parametrize("convention", ["powermodels", "matpower"])
def test_drawn_cases_equal_their_optimum_by_angles(convention, fresh_rng, tmp_path):
    compared = 0
    for number in range(8):
        case = random_case(fresh_rng, int(fresh_rng.integers(2, 9)))
        path = tmp_path / f"{number}.m"
        path.write_text(case_text(case))
        value, prices = optimum_by_angles(case, convention)
        if np.isnan(value):
            with pytest.raises(
                (InputError, ModelError), match=r"no decision satisfies|the load is|no flow of the branch keeps"
            ):
                dispatch_problem(load_matpower(path, convention=convention))
            continue
        network = load_matpower(path, convention=convention)
        problem = dispatch_problem(network)
        assert problem.optimal_cost([1.0]) == pytest.approx(value, rel=1e-6)
        schedule = problem.solve([1.0])
        # prices of one MW more, where they are unique: the same from either side
        for bus in some(range(network.n_buses), 4):
            more, less = (_cost(network, bus, by) for by in (0.01, -0.01))
            here = problem.optimal_cost([1.0])
            if abs((more - here) - (here - less)) < 1e-6 * max(abs(here), 1.0):
                slope = (more - less) / 0.02
                assert problem.bus_prices(schedule)[bus] == pytest.approx(slope, rel=1e-4, abs=1e-3)
                assert prices[bus] == pytest.approx(slope, rel=1e-3, abs=1e-2)
        compared += 1
    assert compared >= 2


def _cost(network, bus, by):
    loads = network.loads.copy()
    loads.iloc[bus] += by
    try:
        return float(dispatch_problem(replace(network, loads=loads)).optimal_cost([1.0]))
    except ModelError:
        return np.inf


def two_buses(**changes):
    given = {
        "loads": pd.Series({"north": 0.0, "south": 50.0}), "generator_buses": ["north", "south"],
        "capacities": [[10.0, 80.0], [0.0, 40.0]], "quadratic_costs": [0.02, 0.01], "linear_costs": [[1.0, 7.0], [2.0, 5.0]],
        "line_ends": [["north", "south"]], "line_data": [[0.1, -20.0, 30.0, 4.0]],
    }  # fmt: skip
    return ins.PowerNetwork(**(given | changes))


def test_buses_are_named_by_labels_and_kept_so():
    network = two_buses()
    farmed = dispatch_problem(network, ["south"], [[5.0], [25.0]])
    by_number = dispatch_problem(
        ins.PowerNetwork([0.0, 50.0], [0, 1], network.capacities, network.quadratic_costs, network.linear_costs, [[0, 1]],
                         network.line_data), [1], [[5.0], [25.0]])  # fmt: skip
    np.testing.assert_array_equal(farmed.solve([[1, 0], [0, 1]]), by_number.solve([[1, 0], [0, 1]]))
    assert "line north-south <= 30 MW" in farmed.constraints.names
    assert "generator 0 at bus north >= 10 MW" in farmed.constraints.names
    assert farmed.constants[0] - by_number.without_common_costs.constants[0] == pytest.approx(12.0 + 25.0)
    narrower = replace(network, line_data=network.line_data * [[1, 0.5, 0.5, 1]])
    assert narrower.bus_labels == ("north", "south")
    with pytest.raises(
        InputError, match=r"wind_buses has bus 'soth', which is none of north, south; did you mean south"
    ):
        dispatch_problem(network, ["soth"], [[5.0], [25.0]])


def test_labels_are_texts_and_numbers_side_by_side():
    network = ins.PowerNetwork(
        {"a": 0.0, 1: 50.0}, ["a", 1], [80.0, 40.0], [0.02, 0.01], [1, 2], [["a", 1]], [[0.1, 30.0]]
    )
    assert list(network.generator_buses) == ["a", 1]
    assert network.places([1], "bus").tolist() == [1]
    plain = ins.PowerNetwork([0.0, 50.0], [0, 1], [80.0, 40.0], [0.02, 0.01], [1, 2], [[0, 1]], [[0.1, 30.0]])
    np.testing.assert_array_equal(dispatch_problem(network).solve([1.0]), dispatch_problem(plain).solve([1.0]))


def test_driven_flows_and_limits_that_differ_by_direction():
    """A shifter that drives 4 MW of 30 changes nothing between two buses, where the balance alone decides."""
    problem = dispatch_problem(two_buses())
    np.testing.assert_allclose(problem.solve([1.0]), [30.0, 20.0])
    ring = ins.PowerNetwork(
        [0.0, 0.0, 30.0], [0], [50.0], [0.0], [1.0], [[0, 1], [1, 2], [0, 2]],
        [[0.1, -99, 99, 0.0], [0.1, -99, 99, 0.0], [0.1, -99, 99, 6.0]],
    )  # fmt: skip
    # 30 MW split 10 and 20; the shifter's 6 MW circulate: its own line keeps 6 − 2·… = 6·2/3 of them
    np.testing.assert_allclose(ring.load_flows(), [10 - 4 + 2, 10 - 4 + 2, 20 + 4 - 2])


def test_what_an_observer_of_prices_and_of_single_units_reads():
    network = ins.load_ieee_30_bus()
    problem = dispatch_problem(network, [7, 29], [[5.0, 2.0], [25.0, 8.0], [10.0, 18.0]], [[2.0, 2.0]] * 3)
    prior = ins.uniform_prior(3, 6)
    played = ins.mechanism(ins.OriginalDecisionMaker(problem), prior.beliefs)
    shown = {
        text: ins.leakage(
            played, prior, problem, disclosure=ins.Disclosure.of(text).of_problem(problem)
        ).mutual_information
        for text in ("exact", "only([0])", "bus_prices()", "only([0, 1, 2, 3, 4, 5, 6, 7])")
    }
    assert shown["exact"] == pytest.approx(shown["only([0, 1, 2, 3, 4, 5, 6, 7])"])
    assert shown["only([0])"] <= shown["exact"] + 1e-9
    assert shown["bus_prices()"] <= shown["exact"] + 1e-9
    # without a full line there is one price, a function of any generator inside its limits: it tells what that tells
    assert np.ptp(problem.bus_prices(played.actions), axis=1).max() < 1e-9
    assert shown["bus_prices()"] == pytest.approx(shown["only([0])"], abs=0.05)
    with pytest.raises(InputError, match="bus_prices needs the dispatch problem"):
        ins.leakage(played, prior, problem, disclosure=ins.bus_prices())
    with pytest.raises(InputError, match="only shows place 8, but decisions have 8"):
        ins.only([8])(played.actions)
    for wrong in ([], [0, 0], [-1], ["a"], [0.5]):
        with pytest.raises(InputError, match="only"):
            ins.only(wrong)


STUDY = """
name = "own"
decision_makers = ["ODM", "coin"]
measures = ["error", "expected_regret"]
adversaries = {name = "bayesian", disclosure = ["exact", "only([0])", "bus_prices()"]}
[world]
kind = "given"
means = [[10.0], [60.0]]
covariances = [[[4.0]], [[9.0]]]
[problem]
kind = "dispatch"
network = "grid.m"
wind_buses = 4
[beliefs]
kind = "grid"
resolution = 4
[candidates]
resolution = 4
"""


def test_a_network_of_labels_that_are_text_beside_numbers_survives_plain_data():
    for labels in (["a", 7], ["1", 1]):
        network = ins.PowerNetwork(
            dict(zip(labels, (0.0, 50.0), strict=True)), labels, [50, 60], [0.1, 0.1], [1, 2], [labels], [[0.1, 30]]
        )
        read = network_of(json.loads(json.dumps(plain_network(network))))
        assert read.bus_labels == network.bus_labels
        assert read.generator_buses.tolist() == labels
        assert read.line_ends.tolist() == [labels]


def test_a_study_on_a_network_of_ones_own(tmp_path):
    case = (DATA / "pglib_opf_case5_pjm.m").read_text("utf-8")
    (tmp_path / "grid.m").write_text(case)
    (tmp_path / "own.toml").write_text(STUDY)
    study = ins.run_study(tmp_path / "own.toml", tmp_path / "out", limit=2)
    (tmp_path / "grid.m").unlink()  # what was begun needs the file no more
    rows = ins.resume_study(tmp_path / "out").frame()
    assert (rows["status"] == "done").all(), list(study.errors())
    problem = dispatch_problem(load_matpower(DATA / "pglib_opf_case5_pjm.m"), [4], [[10.0], [60.0]], [[2.0], [3.0]])
    prior = ins.uniform_prior(2, 4)
    played = ins.mechanism(ins.OriginalDecisionMaker(problem), prior.beliefs)
    for shown in ("exact", "only([0])", "bus_prices()"):
        ours = rows[(rows["decision_maker"] == "ODM") & (rows["adversary.disclosure"] == shown)]
        disclosure = ins.Disclosure.of(shown).of_problem(problem)
        assert ours["error"].item() == pytest.approx(
            ins.leakage(played, prior, problem, disclosure=disclosure).bayes_error
        )
    (tmp_path / "grid.m").write_text(case.replace("400.0\t 131.47", "300.0\t 131.47"))
    other = ins.Study.read(tmp_path / "own.toml")
    assert other.grid.task(0).key != study.grid.task(0).key
    for old, new, said in (
        ('"grid.m"', '"none.m"', r"line 12, key problem.network: the network .*none.m cannot be read"),
        ("wind_buses = 4", "wind_buses = 44", r"key problem.*: wind_buses has bus 44, which is none of 1, 2, 3, 4, 5"),
        ('network = "grid.m"', 'convention = "dc"', r"convention: unknown 'dc'"),
    ):
        (tmp_path / "own.toml").write_text(STUDY.replace(old, new))
        with pytest.raises(InputError, match=said):
            ins.Study.read(tmp_path / "own.toml")


def test_a_study_on_one_bus_without_lines(tmp_path):
    (tmp_path / "grid.m").write_text(
        "mpc.version='2'; mpc.baseMVA=100;\nmpc.bus=[4 3 100 0 0];\nmpc.gen=[4 0 0 0 0 1 100 1 120 10];\n"
        "mpc.gencost=[2 0 0 3 0.02 1 5];\nmpc.branch=[];\n"
    )
    (tmp_path / "own.toml").write_text(STUDY)
    study = ins.run_study(tmp_path / "own.toml", tmp_path / "out", limit=1)
    assert study.frame()["status"].iloc[0] == "done", list(study.errors())


# --- objects of other packages ----------------------------------------------------------------------------------------


def pypsa_like(**changes):
    """What `from_pypsa` asks of a network, in plain tables; the shapes are PyPSA's."""
    none = pd.DataFrame({"active": []})
    table = pd.DataFrame
    lines = {"bus0": ["a", "b", "a"], "bus1": ["b", "c", "c"], "x_pu_eff": [0.001, 0.001, 0.002], "s_nom": 60.0}
    generators = {"bus": ["a", "b"], "p_nom": [200.0, 100.0], "p_min_pu": [0.1, 0.0], "p_max_pu": 1.0}
    costs = {"marginal_cost": [10.0, 30.0], "marginal_cost_quadratic": [0.02, 0.0]}
    given = {
        "buses": table(index=["a", "b", "c"]), "snapshots": pd.Index(["noon", "night"]), "links": none, "stores": none,
        "storage_units": none, "shunt_impedances": none, "transformers": none,
        "lines": table({**lines, "s_max_pu": 1.0, "active": True}, ["ab", "bc", "ac"]),
        "lines_t": {"s_max_pu": table(index=["noon", "night"])},
        "generators": table({**generators, **costs, "p_set": np.nan, "active": True}, ["g1", "g2"]),
        "generators_t": {key: table(index=["noon", "night"]) for key in (*generators, *costs, "p_set")},
        "loads": table({"bus": ["c", "c"], "p_set": [90.0, 20.0], "active": [True, False]}, ["l", "off"]),
        "loads_t": {"p_set": table({"l": [100.0, 60.0]}, ["noon", "night"])},
        "components": {"Generator": {"attrs": table({"default": [np.nan]}, ["p_set"])}},
        "calculate_dependent_values": lambda: None,
    }  # fmt: skip
    return SimpleNamespace(**(given | changes))


class WithPieces(dict):
    """PyPSA's description of generators, of which g2 has piecewise costs."""

    @property
    def piecewise(self):
        return {"marginal_cost": pd.DataFrame(columns=[["g2", "g2"], ["p_pu", "marginal_cost"]])}


def test_a_network_with_the_tables_of_pypsa():
    """100 MW at c from a: 50 over each way, which the cheaper unit alone feeds: 10·100 + 0.02·100² (PyPSA's own optimum)."""
    noon, night = (dispatch_problem(ins.from_pypsa(pypsa_like(), each)) for each in ("noon", "night"))
    assert noon.optimal_cost([1.0]) == pytest.approx(1200.0)
    np.testing.assert_allclose(noon.bus_prices(noon.solve([1.0])), 14.0)
    assert night.optimal_cost([1.0]) == pytest.approx(60 * 10 + 0.02 * 3600)
    kept = pd.DataFrame({"active": [True]}, ["cable"])
    for changes, said in (
        ({"links": kept}, r"has links in service \(cable\)"),
        ({"generators": pypsa_like().generators.assign(p_nom_extendable=True)}, "to be extended"),
        ({"lines": pypsa_like().lines.assign(x_pu_eff=0.0)}, "'ab' has no reactance"),
        ({"processes": kept}, r"has processes in service \(cable\)"),
        ({"global_constraints": pd.DataFrame({"sense": ["<="]}, ["co2"])}, r"global_constraints in service \(co2\)"),
        ({"buses": pypsa_like().buses.assign(carrier=["AC", "DC", "AC"])}, "the buses b are of direct current"),
        (
            {"lines": pypsa_like().lines.assign(phase_shift_min=-5.0, phase_shift_max=5.0)},
            "a phase shift to be optimised",
        ),
        ({"loads": pypsa_like().loads.assign(bus="z")}, "the load 'l' is at bus 'z', which is none of a, b, c"),
        ({"has_scenarios": True}, "the network has scenarios"),
        ({"components": {"Generator": WithPieces(pypsa_like().components["Generator"])}}, "g2 have piecewise costs"),
        *(
            ({"generators": pypsa_like().generators.assign(**{key: values})}, f"the generators g2 {said}")
            for key, values, said in (
                ("committable", [False, True], "are committed"),
                ("p_set", [np.nan, 20.0], "have a fixed output"),
                ("sign", [1.0, -1.0], "have a sign"),
                ("e_sum_max", [np.inf, 10.0], "have a limit e_sum_max"),
                ("e_sum_min", [-np.inf, 10.0], "have a limit e_sum_min"),
                ("maintainable", [False, True], "are maintained"),
                ("ramp_limit_up", [np.nan, 0.3], "have a limit on ramps"),
                ("ramp_limit_down", [np.nan, 0.3], "have a limit on ramps"),
            )
        ),
    ):
        with pytest.raises(InputError, match=said):
            ins.from_pypsa(pypsa_like(**changes))
    fed = pypsa_like().loads.assign(sign=[-1.0, 1.0], active=True)
    assert dispatch_problem(ins.from_pypsa(pypsa_like(loads=fed))).optimal_cost([1.0]) == pytest.approx(
        800 + 0.02 * 80**2
    )
    with pytest.raises(InputError, match="snapshot 'dawn' is none of noon, night"):
        ins.from_pypsa(pypsa_like(), "dawn")


def test_older_versions_of_pypsa_give_outputs_a_set_point_that_binds_nothing():
    """Before PyPSA 1.0 its default is 0, and power flow alone reads it."""
    older = {"Generator": {"attrs": pd.DataFrame({"default": [0.0]}, ["p_set"])}}
    network = ins.from_pypsa(pypsa_like(generators=pypsa_like().generators.assign(p_set=0.0), components=older))
    assert dispatch_problem(network).optimal_cost([1.0]) == pytest.approx(1200.0)


def test_limits_of_angles_and_phase_shifts_of_pypsa():
    """A quarter of 100 MW flows over ac if b feeds c, and a half if a does: 40 MW, 0.08 rad, leave 60 to the cheaper unit."""
    limited = pypsa_like().lines.assign(v_ang_max=[np.inf, np.inf, np.degrees(0.08)])
    problem = dispatch_problem(ins.from_pypsa(pypsa_like(lines=limited)))
    np.testing.assert_allclose(problem.solve([1.0]), [60.0, 40.0])
    shifted = {"transformers": limited.assign(phase_shift=0.0), "lines": limited[:2]}
    shifts = {"phase_shift": pd.DataFrame({"ac": [1.0, -2.0]}, ["noon", "night"])}
    changes = shifted | {"transformers_t": shifts | {"s_max_pu": pd.DataFrame()}}
    for snapshot, degrees in (("noon", 1.0), ("night", -2.0)):
        driven = -np.radians(degrees) / 0.002
        read = ins.from_pypsa(pypsa_like(**changes), snapshot).line_data[-1]
        np.testing.assert_allclose(read, [0.002, max(-60.0, driven - 40.0), min(60.0, driven + 40.0), driven])


def test_an_investment_period_of_pypsa_has_what_stands_then():
    snapshots = pd.MultiIndex.from_product([[2030, 2040], ["noon", "night"]])
    built = pypsa_like().generators.assign(build_year=2020, lifetime=[15.0, np.inf], p_nom=200.0)
    network = pypsa_like(snapshots=snapshots, generators=built, loads_t={}, lines=pypsa_like().lines.assign(s_nom=90.0))
    for snapshot, dispatched in (((2030, "noon"), [90.0, 0.0]), ((2040, "noon"), [90.0])):
        problem = dispatch_problem(ins.from_pypsa(network, snapshot))
        np.testing.assert_allclose(problem.solve([1.0]), dispatched, atol=1e-9)
    with pytest.raises(InputError, match="snapshot 2030 is none of"):
        ins.from_pypsa(network, 2030)


def test_a_day_of_many_hours_is_no_snapshot():
    hours = pd.date_range("2030-01-01", periods=2, freq="h")
    network = pypsa_like(snapshots=hours, loads_t={"p_set": pd.DataFrame({"l": [100.0, 60.0]}, hours)})
    assert ins.from_pypsa(network, "2030-01-01 01:00").demand.sum() == 60.0
    for odd in ("2030-01-01", ["2030-01-01 01:00"]):
        with pytest.raises(InputError, match=r"snapshot .* is none of 2030-01-01 00:00:00"):
            ins.from_pypsa(network, odd)


@pytest.mark.audit
@pytest.mark.filterwarnings("ignore")
def test_networks_of_pypsa_itself(fresh_rng):
    pypsa = pytest.importorskip("pypsa")
    n = pypsa.Network()
    n.set_snapshots(["noon", "night"])
    for bus in range(6):
        n.add("Bus", f"b{bus}", v_nom=220.0)
    for a, b in [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 0), (1, 4)]:
        x, limit = fresh_rng.uniform(20, 80), fresh_rng.uniform(60, 90)
        n.add("Line", f"{a}{b}", bus0=f"b{a}", bus1=f"b{b}", x=x, r=1.0, s_nom=limit)
    n.add("Transformer", "t", bus0="b0", bus1="b3", x=0.1, s_nom=90, tap_ratio=1.05, phase_shift=2.0, model="t")
    for g in range(4):
        n.add(
            "Generator", f"g{g}", bus=f"b{g}", p_nom=fresh_rng.uniform(60, 120), marginal_cost=fresh_rng.uniform(5, 40)
        )
    for bus in (2, 4, 5):
        n.add("Load", f"l{bus}", bus=f"b{bus}", p_set=[fresh_rng.uniform(20, 40), fresh_rng.uniform(10, 30)])
    n.optimize(solver_name="highs", log_to_console=False)
    for each in n.snapshots:
        problem = dispatch_problem(ins.from_pypsa(n, each))
        theirs = float((n.generators_t.p.loc[each] * n.generators.marginal_cost).sum())
        assert problem.optimal_cost([1.0]) == pytest.approx(theirs, rel=1e-6)
        prices = n.buses_t.marginal_price.loc[each].to_numpy()
        np.testing.assert_allclose(problem.bus_prices(problem.solve([1.0])), prices, rtol=1e-6)


@pytest.mark.audit
@pytest.mark.filterwarnings("ignore")
def test_nets_of_pandapower_itself():
    """The costs are those of MATPOWER's rundcopf on the cases of the same names."""
    networks = pytest.importorskip("pandapower.networks")
    for name, value in (("case9", 5216.03), ("case30", 565.21), ("case39", 41263.94), ("case118", 125947.87)):
        network = ins.from_pandapower(getattr(networks, name)())
        assert dispatch_problem(network).optimal_cost([1.0]) == pytest.approx(value, abs=0.01)
