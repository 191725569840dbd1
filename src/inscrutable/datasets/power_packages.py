"""Networks of pandapower and PyPSA, read from their own objects; neither package is needed to import this."""

from __future__ import annotations

import logging
from importlib import import_module
from typing import Any

import numpy as np
from pandas import DataFrame, Series
from pandas.errors import InvalidIndexError

from inscrutable.axes import few
from inscrutable.datasets._matlab import CaseTable
from inscrutable.datasets.matpower import CaseTables, Convention, checked_convention
from inscrutable.errors import InputError
from inscrutable.problems.power_network import PowerNetwork
from inscrutable.validation import Array

_TABLES = ("bus", "gen", "branch", "gencost")
_LEAST_COLUMNS = {"bus": 5, "gen": 10, "branch": 11, "gencost": 5}
_LINES, _CLOSED = ("lines", "transformers"), ("links", "stores", "storage_units", "processes", "global_constraints")
_UNREAD = ("dcline", "vsc", "b2b_vsc", "bi_vsc", "tcsc", "xward")
"""Elements of pandapower that its conversion leaves out, or gives no cost."""
_ERROR = "OPF parameters"
"""From pandapower's error for missing limits, which it names in its log alone."""
_HINT = "; generators and controllable loads, static generators and storage need min_p_mw, max_p_mw, min_q_mvar and max_q_mvar"


def from_pandapower(net: Any, *, convention: Convention = "matpower") -> PowerNetwork:
    """Return the network of a pandapower net, as pandapower converts it for its optimal flow.

    Formula: that of `load_matpower`, for the case from `to_ppc(net, mode="opf")` of `pandapower.converter.pypower`.

    Args:
        net: The net, with limits and costs of its generators. Buses keep its indices; buses joined by closed switches have the
            index of the first, and lines between them are left out. As in pandapower, what has no cost costs nothing, and a
            line without a limit has none.
        convention: As for `load_matpower`; pandapower's own is "matpower".

    Returns:
        A network for `dispatch_problem`.

    Raises:
        InputError: pandapower is not installed, or cannot convert the net; lines of direct current, converters, TCSCs or xwards
            are in service; or as `load_matpower`, with the table's row.

    Cost: pandapower's conversion. Source: Thurner et al., pandapower (IEEE Transactions on Power Systems 33, 2018).

    Example:
        >>> from_pandapower("net.json")
        Traceback (most recent call last):
        ...
        inscrutable.errors.InputError: net must be a pandapower net with the table bus, got 'net.json'
    """
    checked_convention(convention)
    if not hasattr(getattr(net, "bus", None), "index"):
        raise InputError(f"net must be a pandapower net with the table bus, got {net!r:.60}")
    for name in _UNREAD:
        _check_out_of_service(name, _active(getattr(net, name, ()), "in_service"))
    try:
        converter = import_module("pandapower.converter.pypower.to_ppc")
    except ImportError:
        raise InputError("a pandapower net needs pandapower: pip install pandapower") from None
    try:
        case = converter.to_ppc(net, calculate_voltage_angles=True, init="flat", mode="opf")
    except Exception as error:  # any error that pandapower raises for a net
        hint = _HINT if _ERROR in str(error) else ""
        raise InputError(f"pandapower cannot convert the net: {type(error).__name__}: {error}{hint}") from None
    values = {name: np.real(np.asarray(case[name])).astype(np.float64) for name in _TABLES if name in case}
    for name in _TABLES:
        if name not in values or values[name].ndim != 2 or values[name].shape[1] < _LEAST_COLUMNS[name]:
            raise InputError(f"the net gives no table {name}: expected generators with costs and limits, and branches")
    _name_buses(net, values)
    _say_what_is_left_out(values)
    tables = {name: CaseTable(each, ()) for name, each in values.items()}
    tables["baseMVA"] = CaseTable(np.array([[float(np.real(case["baseMVA"]))]]), ())
    return CaseTables("the net", tables).network(convention)


def _name_buses(net: Any, values: dict[str, Array]) -> None:
    """Give the converted buses the net's indices; a merged bus has the first of its indices."""
    lookup = getattr(net, "_pd2ppc_lookups", {}).get("bus")
    if lookup is None:
        return
    own: dict[int, int] = {}
    for index in net.bus.index:
        own.setdefault(int(lookup[index]), int(index))
    free = 1 + max(own.values(), default=0)  # buses that the conversion adds
    named = {int(number): own.get(int(number), free + k) for k, number in enumerate(values["bus"][:, 0])}
    for name, columns in (("bus", (0,)), ("gen", (0,)), ("branch", (0, 1))):
        for column in columns:
            values[name][:, column] = [named[int(number)] for number in values[name][:, column]]


def _say_what_is_left_out(values: dict[str, Array]) -> None:
    """Write missing limits of lines and missing costs as MATPOWER does, and drop lines from a bus to itself."""
    lines, costs = values["branch"], values["gencost"]
    lines[np.isnan(lines[:, 5]), 5] = 0.0
    costs[costs[:, 3] == 0, :5] = (2.0, 0.0, 0.0, 1.0, 0.0)
    values["branch"] = lines[lines[:, 0] != lines[:, 1]]


def from_pypsa(network: Any, snapshot: Any = None) -> PowerNetwork:
    """Return one snapshot of a PyPSA network.

    Formula: the flow of a line is (θ_0 − θ_1 − φ)/x with PyPSA's effective per-unit reactance, and |θ_0 − θ_1| ≤ `v_ang_max`,
    which PyPSA before 1.4 does not enforce.

    Args:
        network: The network. Buses keep their names; elements that are inactive, or not built in the snapshot's investment
            period, are left out.
        snapshot: One of its snapshots; None is the first.

    Returns:
        A network for `dispatch_problem`.

    Raises:
        InputError: `network` is not a PyPSA network, has no such snapshot, or has what the dispatch problem does not support:
            links, processes, stores or storage units in service, global constraints, scenarios, extendable capacities, buses of
            direct current, phase shifts to be optimised, generators that are committed or maintained, of fixed output, of
            negative sign, of limited energy, with limits on ramps or with piecewise costs.

    Cost: O(elements). Source: Brown, Hörsch, Schlachtberger, PyPSA (Journal of Open Research Software 6, 2018).

    Example:
        >>> from_pypsa("network.nc")
        Traceback (most recent call last):
        ...
        inscrutable.errors.InputError: network must be a PyPSA network with buses and snapshots, got 'network.nc'
    """
    if not all(hasattr(network, name) for name in ("buses", "snapshots", "generators_t")):
        raise InputError(f"network must be a PyPSA network with buses and snapshots, got {network!r:.60}")
    if getattr(network, "has_scenarios", False):
        raise InputError("the network has scenarios; a dispatch here takes one: network.get_scenario(name)")
    snapshot = _one_snapshot(network.snapshots, snapshot)
    period = snapshot[0] if network.snapshots.nlevels > 1 else None
    for name in _CLOSED:  # older versions have no processes
        _check_out_of_service(name, _active(getattr(network, name, ()), period=period))
    network.calculate_dependent_values()
    direct = network.buses.index[network.buses["carrier"] == "DC"] if "carrier" in network.buses else ()
    if len(direct):
        raise InputError(f"the buses {few(direct)} are of direct current, whose flow depends on resistances")
    loads = Series(0.0, index=list(network.buses.index))
    demand = _at(network, "loads", "p_set", snapshot)
    for name, row in _active(network.loads).iterrows():
        if row["bus"] not in loads.index:
            raise InputError(f"the load {name!r} is at bus {row['bus']!r}, which is none of {few(loads.index)}")
        loads[row["bus"]] -= row.get("sign", -1.0) * demand[name]
    if len(network.shunt_impedances):
        logging.getLogger(__name__).warning(
            "inscrutable: shunt impedances are no load of a linear flow in PyPSA; left out"
        )
    units = _active(network.generators, period=period)
    _check_fixed(units, "p_nom_extendable", "generators")
    _check_units(network, units, snapshot)
    size = units["p_nom"].to_numpy(dtype=np.float64)
    least, most, slope, curvature = (
        _at(network, "generators", key, snapshot)[units.index].to_numpy(dtype=np.float64)
        for key in ("p_min_pu", "p_max_pu", "marginal_cost", "marginal_cost_quadratic")
    )
    ends, data = _branches(network, snapshot, period)
    return PowerNetwork(
        loads,
        units["bus"].to_numpy(dtype=object),
        np.column_stack([size * least, size * most]),
        curvature,
        slope,
        ends,
        data,
    )


def _one_snapshot(known: Any, snapshot: Any) -> Any:
    """Return the snapshot that is meant, the first for None; a day of many hours is none of them."""
    if snapshot is None and len(known):
        return known[0]
    try:
        place = known.get_loc(snapshot)
    except (KeyError, TypeError, ValueError, InvalidIndexError):
        place = None
    if not isinstance(place, (int, np.integer)):
        raise InputError(f"snapshot {snapshot!r} is none of {few(known)}")
    return known[place]


def _active(table: Any, key: str = "active", period: Any = None) -> Any:
    """Return the elements in service, in an investment period those that stand then."""
    if period is not None and {"build_year", "lifetime"} <= set(table):
        table = table[(table["build_year"] <= period) & (period < table["build_year"] + table["lifetime"])]
    return table[table[key].astype(bool)] if key in table and len(table) else table


def _check_out_of_service(name: str, kept: Any) -> None:
    if len(kept):
        raise InputError(f"the network has {name} in service ({few(kept.index)}), which a dispatch here does not know")


def _check_fixed(table: Any, key: str, what: str) -> None:
    extendable = table.index[table[key].astype(bool)] if key in table else ()
    if len(extendable):
        raise InputError(
            f"the {what} {few(extendable)} are to be extended; a dispatch here takes capacities as they are"
        )


def _check_units(network: Any, units: Any, snapshot: Any) -> None:
    """Raise `InputError` where a generator has what changes its dispatch and is not read."""
    kind = network.components["Generator"]
    # Before PyPSA 1.0 the default of p_set is 0, and power flow alone reads it.
    is_output = np.isnan(kind["attrs"].loc["p_set", "default"])
    up, down, fixed = (
        np.isfinite(_at(network, "generators", key, snapshot)[units.index])
        for key in ("ramp_limit_up", "ramp_limit_down", "p_set")
    )
    pieces = getattr(kind, "piecewise", {}).get("marginal_cost", DataFrame()).columns.get_level_values(0)
    for found, what in (
        (units.get("committable", 0) != 0, "are committed, which is no convex problem"),
        (units.get("maintainable", 0) != 0, "are maintained at times that PyPSA chooses"),
        (fixed & is_output, "have a fixed output p_set: give them equal p_min_pu and p_max_pu"),
        (up | down, "have a limit on ramps between snapshots"),
        (units.index.isin(pieces), "have piecewise costs"),
        (units.get("sign", 1.0) != 1.0, "have a sign other than 1"),
        (np.isfinite(units.get("e_sum_max", np.inf)), "have a limit e_sum_max on their energy"),
        (np.isfinite(units.get("e_sum_min", -np.inf)), "have a limit e_sum_min on their energy"),
    ):
        if np.any(found):
            raise InputError(f"the generators {few(units.index[found])} {what}; a dispatch here does not know that")


def _at(network: Any, name: str, key: str, snapshot: Any, unsaid: float = np.nan) -> Series:
    """Return an attribute of all elements of a kind at a snapshot, static or time-varying; `unsaid` where there is none."""
    table, varying = getattr(network, name), getattr(network, f"{name}_t").get(key, DataFrame())
    found = Series(table.get(key, unsaid), table.index, dtype=np.float64, copy=True)
    if len(varying.columns):
        found[varying.columns] = varying.loc[snapshot]
    return found


def _branches(network: Any, snapshot: Any, period: Any) -> tuple[np.ndarray, Array]:
    """Return ends (L,2), and reactance, minimum and maximum flow and shift flow (L,4), of lines and transformers."""
    ends: list[Any] = []
    data: list[tuple[float, ...]] = []
    for name in _LINES:
        table = _active(getattr(network, name), period=period)
        _check_fixed(table, "s_nom_extendable", name)
        if not len(table):
            continue
        shares, shifts = (_at(network, name, key, snapshot, 0.0) for key in ("s_max_pu", "phase_shift"))
        for label, row in table.iterrows():
            limit = float(row["s_nom"]) * float(shares[label])
            reactance = float(row["x_pu_eff"])
            if reactance == 0:
                raise InputError(f"{name} {label!r} has no reactance; expected one that is not 0")
            if row.get("phase_shift_min", 0.0) < row.get("phase_shift_max", 0.0):
                raise InputError(
                    f"{name} {label!r} has a phase shift to be optimised, which a dispatch here does not know"
                )
            driven = -float(np.radians(shifts[label])) / reactance
            turned = float(np.radians(row.get("v_ang_max", np.inf))) / abs(reactance)
            ends.append((row["bus0"], row["bus1"]))
            data.append((reactance, max(-limit, driven - turned), min(limit, driven + turned), driven))
    return np.array(ends, dtype=object).reshape(-1, 2), np.array(data, dtype=np.float64).reshape(-1, 4)
