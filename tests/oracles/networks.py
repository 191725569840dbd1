"""Random MATPOWER cases as text, and their direct-current optimum by bus angles in a modelling language."""

from __future__ import annotations

from typing import Any

import cvxpy as cp
import numpy as np


def random_case(rng: np.random.Generator, n_buses: int) -> dict[str, Any]:
    """Tables of a connected case with everything that a reader must heed: labels out of order, taps, shifts, shunts, angle
    limits, least outputs, elements out of service, an isolated bus, quadratic and piecewise linear costs."""
    labels = rng.permutation(np.arange(3, 3 + 2 * n_buses))[:n_buses]
    bus = np.zeros((n_buses + 1, 13))
    bus[:n_buses, 0], bus[n_buses, 0] = labels, 1000
    bus[:, 1] = 1
    bus[0, 1], bus[n_buses, 1] = 3, 4
    bus[:n_buses, 2], bus[:n_buses, 4] = rng.uniform(0, 60, n_buses), rng.choice([0.0, 2.5], n_buses)
    bus[n_buses, 2] = 500.0  # isolated
    pairs = [(k, int(rng.integers(k))) for k in range(1, n_buses)]
    pairs += [tuple(rng.choice(n_buses, 2, replace=False)) for _ in range(n_buses)]
    branch = np.zeros((len(pairs), 13))
    branch[:, :2] = labels[np.array(pairs)]
    branch[:, 2], branch[:, 3] = rng.uniform(0, 0.05, len(pairs)), rng.uniform(0.05, 0.3, len(pairs))
    branch[:, 5] = rng.choice([0.0, 60.0, 90.0, 200.0], len(pairs))
    branch[:, 8], branch[:, 9] = rng.choice([0.0, 0.95, 1.1], len(pairs)), rng.choice([0.0, 0.0, 3.0], len(pairs))
    branch[:, 10] = 1
    branch[n_buses:, 10] = rng.random(len(pairs) - n_buses) > 0.2
    branch[:, 11] = rng.choice([-30.0, -30.0, -360.0], len(pairs))
    branch[:, 12] = rng.choice([0.0, 15.0, 30.0, 360.0], len(pairs))
    branch[rng.random(len(pairs)) < 0.3, 11:13] = 0
    n = n_buses // 2 + 2
    gen = np.zeros((n + 1, 10))
    gen[:, 0] = rng.choice(labels, n + 1)
    gen[:, 7] = 1
    gen[:, 8] = 2.5 * bus[:n_buses, 2].sum() / n * rng.uniform(0.6, 1.4, n + 1)
    gen[:, 9] = 0.1 * gen[:, 8] * rng.integers(0, 2, n + 1)
    gen[n, 0] = 1000
    gen[1, 7] = 0
    costs: list[list[float]] = []
    for k in range(n + 1):
        if k % 3 == 2:
            widths, slopes = rng.uniform(0.2, 0.5, 3) * gen[k, 8], np.sort(rng.uniform(5, 60, 3))
            points = np.concatenate([[0.0], np.cumsum(widths)])
            heights = 100.0 + np.concatenate([[0.0], np.cumsum(widths * slopes)])
            costs.append([1, 0, 0, 4, *np.column_stack([points, heights]).ravel()])
        else:
            costs.append([2, 0, 0, 3, rng.choice([0.0, 0.02, 0.1]), rng.uniform(5, 50), 10.0, *[0.0] * 5])
    return {"baseMVA": 100.0, "bus": bus, "gen": gen, "branch": branch, "gencost": np.array(costs)}


def case_text(case: dict[str, Any]) -> str:
    """The case as MATPOWER writes it."""
    lines = ["function mpc = drawn", "mpc.version = '2';", f"mpc.baseMVA = {case['baseMVA']!r};"]
    for name in ("bus", "gen", "branch", "gencost"):
        lines.append(f"mpc.{name} = [")
        lines += ["\t" + "\t".join(repr(float(each)) for each in row) + ";" for row in case[name]]
        lines.append("];")
    return "\n".join(lines) + "\n"


def optimum_by_angles(case: dict[str, Any], convention: str) -> tuple[float, np.ndarray]:
    """The least cost, and the price at every bus that is not isolated; NaN where no schedule exists."""
    bus = case["bus"][case["bus"][:, 1] != 4]
    place = {label: k for k, label in enumerate(bus[:, 0])}
    on = [k for k, row in enumerate(case["gen"]) if row[7] > 0 and row[0] in place]
    branch = [row for row in case["branch"] if row[10] > 0]
    p, angle = cp.Variable(len(on)), cp.Variable(len(bus))
    rows = [angle[0] == 0]
    cost: Any = 0.0
    inflow: list[Any] = [0.0] * len(bus)
    for k, g in enumerate(on):
        row, terms = case["gen"][g], case["gencost"][g]
        rows += [p[k] <= row[8], p[k] >= row[9]]
        inflow[place[row[0]]] = inflow[place[row[0]]] + p[k]
        if terms[0] == 2:
            cost = cost + terms[4] * cp.square(p[k]) + terms[5] * p[k] + terms[6]
        else:
            points = terms[4 : 4 + 2 * int(terms[3])].reshape(-1, 2)
            steep = np.diff(points[:, 1]) / np.diff(points[:, 0])
            cost = cost + cp.maximum(*[points[i, 1] + steep[i] * (p[k] - points[i, 0]) for i in range(len(steep))])
    for number, given in enumerate(branch):
        row, a, b = given.copy(), place[given[0]], place[given[1]]
        beside = [each for each in branch[number:] if {each[0], each[1]} == {row[0], row[1]}]
        if row[8] and beside[-1][0] == row[1]:  # turned to point as the last of parallel ones
            row[2:4] = row[2:4] * row[8] ** 2 if convention == "powermodels" else row[2:4]
        difference = angle[a] - angle[b]
        if convention == "powermodels":
            flow = 100.0 * row[3] / (row[2] ** 2 + row[3] ** 2) * difference
            low, high = (-60.0 if row[11] <= -90 else row[11]), (60.0 if row[12] >= 90 else row[12])
            low, high = (-60.0, 60.0) if not row[11:13].any() else (low, high)
        else:
            flow = 100.0 * (difference - np.radians(row[9])) / (row[3] * (row[8] or 1.0))
            low, high = (-1e4 if row[11] <= -360 else row[11]), (1e4 if row[12] >= 360 else row[12])
            low, high = (-1e4, 1e4) if not row[11:13].any() else (low, high)
        rows += [difference <= np.radians(high), difference >= np.radians(low)]
        if row[5] > 0:
            rows += [flow <= row[5], flow >= -row[5]]
        inflow[a], inflow[b] = inflow[a] - flow, inflow[b] + flow
    balances = [each == load for each, load in zip(inflow, bus[:, 2] + bus[:, 4], strict=True)]
    programme = cp.Problem(cp.Minimize(cost), [*rows, *balances])
    programme.solve(solver=cp.CLARABEL)
    if programme.status != cp.OPTIMAL:
        return float("nan"), np.zeros(0)
    return float(programme.value), -np.array([float(each.dual_value) for each in balances])
